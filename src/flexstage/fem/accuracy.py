"""Refinement until a named quantity is as accurate as it was asked for."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from flexstage import progress
from flexstage.characteristic import Characteristics
from flexstage.errors import ConvergenceError, ModelError
from flexstage.fem.mesh import MeshSettings
from flexstage.fem.model import StageModel
from flexstage.quantities import QUANTITIES
from flexstage.short_repr import short_repr
from flexstage.system import Analysis, analyse
from flexstage.system.characteristics import scatter_at_points

#: Meshes of rising accuracy, by model: order, then element size at the necks.
LADDERS: Mapping[str, tuple[MeshSettings, ...]] = {
    "plane": tuple(
        MeshSettings(order=p, neck_size=h)
        for p, h in ((3, 1.2), (4, 0.8), (5, 0.8), (6, 0.6), (7, 0.5), (8, 0.4))
    ),
    "solid": tuple(
        MeshSettings(order=p, neck_size=h) for p, h in ((2, 1.5), (3, 1.2), (4, 0.8), (5, 0.8))
    ),
}

# How much smaller the change at the next step can be taken to be than at the last one.
_BEST_RATE, _WORST_RATE = 0.15, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinementStep:
    """One mesh on the way."""

    settings: MeshSettings
    """How fine it was."""
    unknowns: int
    """Its unknowns."""
    seconds: float
    """Time that it took [s]."""
    values: Mapping[tuple[str, str], float]
    """Value of each quantity and axis."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refinement:
    """A model that was refined, with what was found on the way."""

    model: StageModel
    """The last model."""
    analysis: Analysis
    """Its analysis; each characteristic carries the estimate of its error as its uncertainty."""
    steps: tuple[RefinementStep, ...]
    """The meshes, coarsest first."""
    quantity: str
    """The quantity that was asked for."""
    accuracy: float
    """The relative accuracy that was asked for [1]."""

    __repr__ = short_repr

    @property
    def estimate(self) -> float:
        """Estimate of the relative error of the quantity that was asked for [1]."""
        return estimate(self.steps, self.quantity)


def estimate(steps: Sequence[RefinementStep], quantity: str) -> float:
    r"""Estimate the relative error of a quantity on the last mesh, the largest over the axes.

    Every step of a ladder raises the order, so that changes shrink as in a geometric series with
    the rate r of the last two: what is still to come is :math:`|d_k|\,r/(1-r)`. r counts as 0.15 at
    least, as a lucky step must not make an estimate small, and as 0.5 where only one change is
    known or the changes do not shrink; the estimate is the last change itself then.

    It is infinite from one mesh alone.
    """
    if len(steps) < 2:
        return math.inf
    return max(
        (
            _left(steps, key) / abs(value) if value else 0.0
            for key, value in steps[-1].values.items()
            if key[0] == quantity and key in steps[-2].values
        ),
        default=math.inf,
    )


def _left(steps: Sequence[RefinementStep], key: tuple[str, str]) -> float:
    """Estimate how far the last value of a quantity is from where it goes."""
    values = [step.values[key] for step in steps[-3:]]
    last = abs(values[-1] - values[-2])
    rate = _WORST_RATE
    if len(values) == 3 and (before := abs(values[-2] - values[-3])) > 0.0:
        rate = min(max(last / before, _BEST_RATE), _WORST_RATE)
    return last * rate / (1.0 - rate)


def refine(
    build: Callable[[MeshSettings], StageModel],
    ladder: Sequence[MeshSettings],
    *,
    accuracy: float,
    quantity: str = "natural_frequency_hz",
) -> Refinement:
    """Refine the mesh and raise the order until a quantity has settled.

    It has when `estimate` is within the accuracy. That does not see what all meshes share: the
    geometry, the material and how the stage is held.

    Parameters
    ----------
    build : callable
        Makes the model for a mesh.
    ladder : sequence of MeshSettings
        The meshes to try, coarsest first; see `LADDERS`.
    accuracy : float
        Relative accuracy that is asked for, above 0 [1].
    quantity : str
        One of the quantities of a stage, such as ``natural_frequency_hz`` or ``max_stress``.

    Returns
    -------
    Refinement
        The first model that is accurate enough.

    Raises
    ------
    ModelError
        The accuracy or the quantity is none.
    ConvergenceError
        The finest mesh of the ladder was not accurate enough.
    """
    if not 0.0 < accuracy < 1.0:
        raise ModelError(
            f"the accuracy must lie between 0 and 1 (0.001 is 0.1 %), got {accuracy!r}"
        )
    if quantity not in QUANTITIES:
        raise ModelError(f"unknown quantity '{quantity}': expected one of {', '.join(QUANTITIES)}")
    steps: list[RefinementStep] = []
    for k, settings in enumerate(ladder):
        # each step costs about twice the one before; how many there will be is not known
        with progress.subtask(1.0 - 0.5**k, 1.0 - 0.5 ** (k + 1)):
            begun = time.perf_counter()
            model = build(settings)
            analysis = analyse(model.stage, model.system)
        values = {(r.quantity, r.axis): r.value for r in analysis.characteristics}
        if not any(name == quantity for name, _ in values):
            raise ModelError(
                f"the model gives no {quantity}, so its accuracy cannot be reached: choose one of "
                f"{', '.join(sorted({name for name, _ in values})) or 'none'}"
            )
        seconds = time.perf_counter() - begun
        steps.append(
            RefinementStep(
                settings=settings, unknowns=model.unknowns, seconds=seconds, values=values
            )
        )
        if len(steps) > 1 and estimate(steps, quantity) <= accuracy:
            return Refinement(
                model=model,
                analysis=_with_estimates(analysis, steps, quantity, accuracy),
                steps=tuple(steps),
                quantity=quantity,
                accuracy=accuracy,
            )
    left = estimate(steps, quantity)
    raise ConvergenceError(
        f"the finest mesh leaves {quantity} uncertain by {left:.2g}, more than the {accuracy:.2g} "
        "that were asked for: ask for less, or look for a corner without a radius, where stress "
        "has no limit"
    )


def _with_estimates(
    analysis: Analysis, steps: Sequence[RefinementStep], quantity: str, accuracy: float
) -> Analysis:
    rows = []
    for row in analysis.characteristics:
        key = (row.quantity, row.axis)
        known = [] if row.uncertainty is None else [row.uncertainty]
        if all(key in step.values for step in steps):
            # several meshes tell how the largest stress moves between their points
            known = [scatter_at_points(row) if row.quantity == "max_stress" else k for k in known]
            known.append(_left(steps, key))
        rows.append(replace(row, uncertainty=max(known) if known else None))
    words = (
        f"Mesh refined until {quantity} converged to {100.0 * estimate(steps, quantity):.2g} % "
        f"(requested: {100.0 * accuracy:.2g} %). Uncertainties are estimated from the changes "
        "between meshes and exclude errors of geometry, material and supports."
    )
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        validity=(*analysis.validity, words),
    )
