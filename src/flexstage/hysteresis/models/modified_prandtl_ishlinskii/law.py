"""The modified Prandtl-Ishlinskii model: plays, and then a line with kinks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    ModelProperty,
    Response,
    Segments,
    samples,
)
from flexstage.hysteresis.models.play_model import (
    Sum,
    elements,
    play_parameters,
    plays_and_line_matlab_code,
    sum_numbers,
)
from flexstage.hysteresis.models.play_sum import PiecewiseLinear, dead_zone_line, dead_zones
from flexstage.hysteresis.models.prandtl_ishlinskii.law import PrandtlIshlinskii
from flexstage.hysteresis.models.source_code import HysteresisCode, MatlabCode, code_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModifiedPrandtlIshlinskii(HysteresisModel):
    """Prandtl-Ishlinskii operator followed by a superposition of one-sided dead zones.

    ``y = S(H(u))`` with ``H(u) = gain u + sum_i w_i p_i`` and
    ``S(x) = x + sum_k v_k max(x - d_k, 0)`` for positive, ``min(x - d_k, 0)`` for negative dead
    zones d_k (Kuhnen 2003, Eur. J. Control 9:407). The slope of S about zero is one, since any
    other is a factor of H.

    Notes
    -----
    Validity: rate-independent hysteresis with wiping-out (a minor loop that closes leaves no
    trace). Loops may be asymmetric, and bend at the ends. Minor loops are congruent in H only, so
    after S their height depends on the output; loops that get wider or narrower with the bias in
    any other way are beyond it, and so is creep.

    Raises
    ------
    ModelError
        Shapes do not match, a number is not finite, or thresholds or dead zones do not rise.

    Examples
    --------
    >>> model = ModifiedPrandtlIshlinskii(
    ...     gain=0.4e-6, thresholds=np.array([2.0, 9.0]), weights=np.array([0.1e-6, 0.15e-6]),
    ...     dead_zones=np.array([-7e-6, 25e-6]), dead_zone_weights=np.array([0.3, -0.2]),
    ... )
    >>> model.simulate([80.0, 30.0, -40.0]).values * 1e6
    array([ 45.36 ,  21.05 , -29.685])
    """

    kind: ClassVar[str] = "modified-prandtl-ishlinskii"
    title: ClassVar[str] = "modified Prandtl-Ishlinskii"
    units: ClassVar[Mapping[str, str]] = {
        "gain": "{y}/{u}",
        "thresholds": "{u}",
        "weights": "{y}/{u}",
        "dead_zones": "{y}",
    }

    gain: float
    """Slope of H just after the input turns back [m/V]."""
    thresholds: Array
    """Half the gap of each play [V], positive and rising, shape (m,)."""
    weights: Array
    """Weight of each play [m/V], shape (m,); not negative for loops that take in energy."""
    dead_zones: Array
    """Where the slope of S changes [m], rising, none zero, shape (l,)."""
    dead_zone_weights: Array
    """By how much it changes there, away from zero [1], shape (l,). Every slope of S that results
    must be positive for an inverse.
    """

    def __post_init__(self) -> None:
        plays = self._plays()
        d, weights = dead_zones(self.dead_zones, self.dead_zone_weights)
        self._set(**plays.parameters(), dead_zones=d, dead_zone_weights=weights)

    def line(self) -> PiecewiseLinear:
        """Return the function S that follows the plays.

        Returns
        -------
        PiecewiseLinear
            The superposition of the dead zones [m] of [m].
        """
        return dead_zone_line(1.0, self.dead_zones, self.dead_zone_weights)

    def play_terms(self) -> Sum:
        """Return H as a sum of functions of plays, as `PrandtlIshlinskii.play_terms` does.

        Returns
        -------
        tuple
            Gain, thresholds, knots, slopes and offsets.
        """
        return self._plays().play_terms()

    def initial_state(self) -> Array:
        return self._plays().initial_state()

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        inner = self._plays().simulate(u, state)
        return Response(values=self.line().at(inner.values), state=inner.state)

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        play_output = self.line().inverse().at(samples(y, "output"))
        return self._plays().inverse(play_output, state)

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments:
        return _through(self.line(), self._plays().segments(u, state))

    def properties(self) -> tuple[ModelProperty, ...]:
        # a rising S keeps the sense in which each loop is run through, and so the sign of integral
        # u dy
        bounded, dissipative, invertible = self._plays().properties()
        slopes = self.line().slopes
        least, most = float(np.min(slopes)), float(np.max(np.abs(slopes)))
        return (
            ModelProperty(
                name="bounded",
                holds=bounded.holds,
                detail=f"of H, {bounded.detail}; of S, the slope is at most {most:g}",
            ),
            ModelProperty(
                name="dissipative",
                holds=dissipative.holds and least >= 0.0,
                detail=f"of H, {dissipative.detail}; S does not fall, its slope is at least "
                f"{least:g}",
            ),
            ModelProperty(
                name="invertible",
                holds=invertible.holds and least > 0.0,
                detail=f"of H, {invertible.detail}; of S, the slope is at least {least:g}, and "
                f"must be more than 0",
            ),
        )

    def _plays(self) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(gain=self.gain, thresholds=self.thresholds, weights=self.weights)


def _through(line: PiecewiseLinear, pieces: Segments) -> Segments:
    """Return straight pieces after a line with kinks: split where they cross one."""
    ends = np.append(pieces.start[1:], pieces.samples - 1.0)
    # A piece that stands still, and a knot that it never meets, give no time: no split.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        times = pieces.start[:, None] + (
            (line.knots[None, :] - pieces.constant[:, None]) / pieces.slope[:, None]
        )
    inside = (times > pieces.start[:, None]) & (times < ends[:, None])
    parent = np.concatenate([np.arange(ends.size), np.nonzero(inside)[0]])
    start = np.concatenate([pieces.start, times[inside]])
    order = np.lexsort((start, parent))
    start, parent = start[order], parent[order]
    slope = pieces.slope[parent]
    constant = pieces.constant[parent] + slope * (start - pieces.start[parent])
    # The slope is that in the middle of a piece, since its ends lie on the knots.
    middle = constant + 0.5 * slope * (np.append(start[1:], pieces.samples - 1.0) - start)
    inner = line.slopes[np.searchsorted(line.knots, middle)]
    return Segments.straight(start, line.at(constant), slope * inner, pieces.samples, pieces.state)


def c_code(model: ModifiedPrandtlIshlinskii) -> HysteresisCode:
    """Return the code in C; gain and weights of plays can be changed."""
    line, zones = model.line(), model.dead_zones
    count = line.knots.size
    numbers = np.concatenate(
        [sum_numbers(model.play_terms()), [count], line.knots, line.slopes, line.offsets()]
    )
    tunable = [
        *play_parameters(model, model.thresholds),
        *elements(model, "dead_zones", zones, "where the slope of the second function changes"),
        *elements(model, "dead_zone_weights", zones, "by how much it changes there"),
    ]
    # Each piece of the plays may meet each knot, since the weights may have any sign.
    return code_of(model, numbers, tunable, (model.thresholds.size + 1) * (count + 1))


def matlab_code(model: ModifiedPrandtlIshlinskii) -> MatlabCode:
    """Return the code in MATLAB."""
    return plays_and_line_matlab_code(model.play_terms(), model.line())
