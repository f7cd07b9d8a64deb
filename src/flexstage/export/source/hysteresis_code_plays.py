"""Models that are sums of plays, as C: Prandtl-Ishlinskii, Preisach, Maxwell-slip."""

import numpy as np

from flexstage.export.source.hysteresis_code_parts import (
    HysteresisCode,
    TunableParameter,
    code_of,
    tunable_of,
)
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.maxwell_slip import GeneralisedMaxwellSlip
from flexstage.hysteresis.models.modified_prandtl_ishlinskii import ModifiedPrandtlIshlinskii
from flexstage.hysteresis.models.play_model import Sum, terms
from flexstage.hysteresis.models.prandtl_ishlinskii import PrandtlIshlinskii
from flexstage.hysteresis.models.preisach import Preisach

_GAIN = "slope just after the voltage turns back"
_THRESHOLD = "half the gap of a play"
_WEIGHT = "weight of a play"


def prandtl_ishlinskii_code(model: PrandtlIshlinskii) -> HysteresisCode:
    """Return the code of Prandtl-Ishlinskii, whose gain and weights can be changed.

    Thresholds cannot, since the memory belongs to them.
    """
    return code_of(
        model, _numbers(_plays(model)), _play_parameters(model), model.thresholds.size + 1
    )


def modified_prandtl_ishlinskii_code(model: ModifiedPrandtlIshlinskii) -> HysteresisCode:
    """Return the code of modified Prandtl-Ishlinskii; gain and weights of plays can be changed."""
    line = model.line()
    count = line.knots.size
    numbers = np.concatenate(
        [_numbers(_plays(model)), [count], line.knots, line.slopes, line.offsets()]
    )
    tunable = [
        *_play_parameters(model),
        *_elements(model, "dead_zones", "where the slope of the second function changes"),
        *_elements(model, "dead_zone_weights", "by how much it changes there"),
    ]
    # Each piece of the plays may meet each knot, since the weights may have any sign.
    return code_of(model, numbers, tunable, (model.thresholds.size + 1) * (count + 1))


def maxwell_slip_code(model: GeneralisedMaxwellSlip) -> HysteresisCode:
    """Return the code of Maxwell-slip, all fixed: the state must fit to every parameter."""
    spring = model.spring()
    slopes = np.empty((model.thresholds.size + 1, spring.slopes.size))
    slopes[0] = spring.slopes
    slopes[1:] = -model.element_stiffness[:, None]
    thresholds = np.append(0.0, model.thresholds)
    total = terms(float(np.sum(model.element_stiffness)), thresholds, spring.knots, slopes)
    tunable = [
        tunable_of(model, "stiffness", None, "stiffness of the spring that never slides"),
        *_elements(model, "thresholds", "displacement from which an element slides"),
        *_elements(model, "element_stiffness", "stiffness of an element before it slides"),
        *_elements(model, "dead_zones", "where the stiffness of the spring changes", "m"),
        *_elements(model, "dead_zone_weights", "by how much it changes there"),
    ]
    return code_of(model, _numbers(total), tunable, _largest(total))


def preisach_code(model: Preisach) -> HysteresisCode:
    """Return the code of Preisach; the gain alone can be changed.

    A table is derived from knots and slopes.
    """
    # The outermost slopes go on, so only the knots between them matter.
    total = terms(model.gain, model.thresholds, model.knots[1:-1], model.slopes)
    slopes = [
        tunable_of(model, f"slopes[{i},{j}]", None, "density of the memory")
        for i, j in np.ndindex(*model.slopes.shape)
    ]
    tunable = [
        tunable_of(model, "gain", 2, "part of the voltage itself"),
        *_elements(model, "thresholds", _THRESHOLD),
        *_elements(model, "knots", "mean where the density changes"),
        *slopes,
    ]
    return code_of(model, _numbers(total), tunable, _largest(total))


def _numbers(total: Sum) -> Array:
    """Return a sum of functions of plays as C takes it."""
    gain, thresholds, knots, slopes, offsets = total
    sizes = [thresholds.size, knots.size, gain]
    return np.concatenate([sizes, thresholds, knots, slopes.ravel(), offsets.ravel()])


def _largest(total: Sum) -> int:
    """Return the largest number of pieces: each play may start, and pass each knot."""
    return total[1].size * (total[2].size + 1) + 1


def _plays(model: PrandtlIshlinskii | ModifiedPrandtlIshlinskii) -> Sum:
    return terms(model.gain, model.thresholds, np.empty(0), model.weights[:, None])


def _play_parameters(
    model: PrandtlIshlinskii | ModifiedPrandtlIshlinskii,
) -> list[TunableParameter]:
    """Return gain, thresholds and weights; the weights stand after the thresholds."""
    m = model.thresholds.size
    return [
        tunable_of(model, "gain", 2, _GAIN),
        *_elements(model, "thresholds", _THRESHOLD),
        *(tunable_of(model, f"weights[{i}]", 3 + m + i, _WEIGHT) for i in range(m)),
    ]


def _elements(
    model: PrandtlIshlinskii | ModifiedPrandtlIshlinskii | GeneralisedMaxwellSlip | Preisach,
    name: str,
    description: str,
    unit: str = "",
) -> list[TunableParameter]:
    """Return the elements of a list that cannot be changed."""
    return [
        tunable_of(model, f"{name}[{i}]", None, description, unit)
        for i in range(len(getattr(model, name)))
    ]
