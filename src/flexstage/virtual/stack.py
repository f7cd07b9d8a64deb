"""A virtual piezo stack: a hysteresis that no model of the package is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.hysteresis.loops import loop_width
from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    ModelProperty,
    Response,
    Segments,
    samples,
)
from flexstage.hysteresis.models.duhem.law import Duhem
from flexstage.hysteresis.models.modified_prandtl_ishlinskii.law import ModifiedPrandtlIshlinskii

#: Widths that the loop of a virtual stack can have over its stroke [1].
WIDTHS = (0.03, 0.25)
#: So many plays that their kinks, below a nanometre, drown in any noise.
FINE_PLAYS = 192
_PLAYS = 48
#: Share of the output that comes from the part which forgets by degrees.
_FADING = 0.05
#: Slope of the gain at the upper end over that at the lower one, less one.
_BEND = -0.12
_KINKS = 24


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualStack(HysteresisModel):
    """A piezo stack whose hysteresis is of no class that is fitted.

    ``y = bent(u) + fading(u)``: plays with a curved gain, whose memory is wiped out, beside a part
    that forgets by degrees. Minor loops are neither congruent nor closed at once, and the major
    loop is not symmetric. Every model of the package leaves something of it, as of a measured
    stack.

    Notes
    -----
    Validity: an invention for trials, of the size and shape that stacks have; no measured one. It
    has no inverse. State: that of `bent`, then that of `fading`.

    Examples
    --------
    >>> stack = virtual_stack((0.0, 120.0), 38e-6, 0.125)
    >>> round(float(np.ptp(stack.simulate([120.0, 0.0, 120.0, 0.0]).values[2:])) * 1e6, 1)
    38.0
    """

    bent: ModifiedPrandtlIshlinskii
    """The part with wiping-out."""
    fading: Duhem
    """The part that forgets by degrees, with a straight curve."""
    kind: ClassVar[str] = "virtual-stack"

    def initial_state(self) -> Array:
        return np.concatenate((self.bent.initial_state(), self.fading.initial_state()))

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        given = samples(u, "input")
        first, second = self._parts(state)
        bent = self.bent.simulate(given, first)
        fading = self.fading.simulate(given, second)
        return Response(
            values=bent.values + fading.values, state=np.concatenate((bent.state, fading.state))
        )

    def segments(self, u: ArrayLike, state: ArrayLike | None = None) -> Segments:
        first, second = self._parts(state)
        bent, fading = self.bent.segments(u, first), self.fading.segments(u, second)
        # both have a closed form: the curve of the second is straight
        assert bent is not None
        assert fading is not None
        start = np.union1d(bent.start, fading.start)
        i = np.searchsorted(bent.start, start, side="right") - 1
        j = np.searchsorted(fading.start, start, side="right") - 1
        since_i, since_j = start - bent.start[i], start - fading.start[j]
        return Segments(
            start=start,
            constant=bent.constant[i]
            + bent.slope[i] * since_i
            + fading.constant[j]
            + fading.slope[j] * since_j,
            slope=bent.slope[i] + fading.slope[j],
            amplitude=fading.amplitude[j] * np.exp(-fading.rate[j] * since_j),
            rate=fading.rate[j],
            samples=bent.samples,
            state=np.concatenate((bent.state, fading.state)),
        )

    def _parts(self, state: ArrayLike | None) -> tuple[Array, Array]:
        before = HysteresisModel._state(self, state)
        cut = self.bent.initial_state().size
        return before[:cut], before[cut:]

    def inverse(self, y: ArrayLike, state: ArrayLike | None = None) -> Response:
        # it is there to be identified
        del y, state
        raise ModelError("a virtual stack has no inverse: identify a model, and invert that")

    def properties(self) -> tuple[ModelProperty, ...]:
        return (*self.bent.properties(), *self.fading.properties())


def virtual_stack(
    voltage_range: tuple[float, float], stroke: float, width: float, *, plays: int = _PLAYS
) -> VirtualStack:
    """Return a virtual stack with a stroke and a width of its loop.

    Parameters
    ----------
    voltage_range : tuple of float
        Lowest and highest voltage [V].
    stroke : float
        Free displacement over the range [m].
    width : float
        Width of the major loop over the stroke [1], from 0.03 to 0.25.
    plays : int
        Number of plays: the loop has a kink for each, which is the smaller the more there are.

    Returns
    -------
    VirtualStack
        The stack.

    Raises
    ------
    ModelError
        No stack of this kind has such a loop.
    """
    if not WIDTHS[0] <= width <= WIDTHS[1]:
        raise ModelError(f"the width of a loop must be 0.03 to 0.25 of the stroke, got {width:g}")
    low, high = voltage_range
    line = np.linspace(low, high, 400)
    cycle = np.concatenate((line, line[::-1][1:]))
    u = np.concatenate((cycle, *(cycle[1:],) * 3))
    bounds = np.arange(5) * (cycle.size - 1)

    def excess(share: float) -> float:
        y = _stack(voltage_range, 1.0, share, plays).simulate(u).values
        late = slice(bounds[2], None)
        return loop_width(u[late], y[late], bounds[2:] - bounds[2]) / np.ptp(y[late]) - width

    share = float(brentq(excess, 1e-3, 0.95, xtol=1e-10))  # type: ignore[arg-type]
    unit = _stack(voltage_range, 1.0, share, plays)
    late = unit.simulate(u).values[bounds[2] :]
    return _stack(voltage_range, stroke / float(np.ptp(late)), share, plays)


def _stack(
    voltage_range: tuple[float, float], stroke: float, share: float, plays: int
) -> VirtualStack:
    """Plays, of which some follow late, beside an exponential part; bent."""
    low, high = voltage_range
    span = high - low
    r = 0.5 * span * np.arange(1, plays + 1) / (plays + 1)
    weights = np.exp(-r / (0.22 * span)) * (1.0 + 0.3 * np.cos(9.0 * r / span))
    slope = stroke / span
    weights *= share * (1.0 - _FADING) * slope / weights.sum()
    gain = (1.0 - share) * (1.0 - _FADING) * slope
    # the curve that the fading part tends to, and its slope where it stands
    fading = Duhem(
        rate=6.0 / span,
        anhysteretic=np.array([0.0, _FADING * slope]),
        tangent=np.array([(1.0 - 0.8 * share) * _FADING * slope]),
        input_range=(min(low, 0.0), max(high, 0.0)),
    )
    # a parabola by short straight lines, flatter towards the end
    ends = (1.0 - _FADING) * stroke
    count = _KINKS * plays // _PLAYS
    kinks = ends * (np.arange(count) + 0.5) / count
    bent = ModifiedPrandtlIshlinskii(
        gain=gain,
        thresholds=r,
        weights=weights,
        dead_zones=kinks,
        dead_zone_weights=np.full(count, _BEND / count),
    )
    return VirtualStack(bent=bent, fading=fading)


def matched_stacks(
    sizes: Sequence[tuple[float, float]],
    wanted: Sequence[tuple[float | None, float]],
    measure: Callable[[Sequence[tuple[float, float]]], Sequence[tuple[float, float]]],
) -> list[tuple[float, float]]:
    """Return free displacements [m] and loop widths [1] of stacks that give what is wanted.

    Creep, amplifier and stage add to both, so that each stack by itself needs a little less.
    `measure` returns stroke [m] and width over it [1] of every axis with stacks of given sizes; a
    stroke that is None is left as it comes.
    """
    for _ in range(2):
        got = measure(sizes)
        sizes = [
            (
                free if stroke is None else free * stroke / reached,
                float(np.clip(own * share / width, *WIDTHS)),
            )
            for (free, own), (stroke, share), (reached, width) in zip(
                sizes, wanted, got, strict=True
            )
        ]
    return list(sizes)
