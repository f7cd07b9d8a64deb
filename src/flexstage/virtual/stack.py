"""A virtual piezo stack: a hysteresis that no model of the package is."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.hysteresis.compiled import compiled
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
from flexstage.hysteresis.models.power_law import saturating

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


_CYCLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargeDrive:
    r"""A stack driven by charge: what the amplifier leaves of the hysteresis, save in slow motion.

    The displacement of a stack is nearly proportional to its charge; the hysteresis lies between
    charge and voltage. No amplifier holds a charge for ever, so that below a corner it becomes one
    of voltage. With e the deviation of the displacement from its chord over the voltage range,

    .. math:: w = w_{chord} + \rho\, e + (1 - \rho)\, \mathrm{lowpass}(e)

    Notes
    -----
    Validity: a description of what such amplifiers do, with usual figures, and no model of a
    circuit: saturation, leakage of the stack, and the slow return of its offset are left out, and
    so is the voltage that the charge really needs. Creep is that of voltage.
    """

    corner_hz: float = 0.1
    """Frequency below which it drives by voltage [Hz]."""
    remainder: float = 0.08
    """Part of the hysteresis that is left far above the corner [1]."""
    voltage_range: tuple[float, float] = (0.0, 120.0)
    """Ends of the chord [V]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.corner_hz < math.inf:
            raise ModelError(
                f"the corner of a charge drive must be positive and finite, got {self.corner_hz!r}"
            )
        if not 0.0 <= self.remainder < 1.0:
            raise ModelError(
                "the part of the hysteresis that a charge drive leaves must be 0 or more and less "
                f"than 1, got {self.remainder!r}"
            )
        if not self.voltage_range[0] < self.voltage_range[1]:
            raise ModelError(f"the ends of a chord must rise, got {self.voltage_range!r} V")

    def row(self, stack: VirtualStack, dt: float) -> tuple[float, float, float, float, float]:
        """Return its numbers for one stack, as the stack is stepped every `dt` [s].

        Offset [m] and slope [m/V] of the chord, the part that is left, and decay and ramp share of
        the corner [1].
        """
        low, high = self.voltage_range
        ends = stack.simulate(np.tile([low, high], _CYCLES)).values[-2:]
        slope = float(ends[1] - ends[0]) / (high - low)
        ratio = 2.0 * math.pi * self.corner_hz * dt
        return (
            float(ends[0]) - slope * low,
            slope,
            self.remainder,
            float(decay_share(ratio)),
            float(ramp_share(ratio)),
        )


class StackArrays(NamedTuple):
    """Parameters of stacks, one row each."""

    plays: Array
    """Gain [m/V], then slope and rate of the fading part: curve offset [m], curve slope [m/V],
    tangent [m/V], rate [1/V], shape (axes, 5).
    """
    thresholds: Array
    """Half the gap of each play [V], infinite where there is none, shape (axes, m)."""
    weights: Array
    """Their weights [m/V], shape (axes, m); m is a multiple of 8."""
    knots: Array
    """Where the line after the plays changes its slope [m], infinite where there is none, shape
    (axes, c).
    """
    slopes: Array
    """Slopes of the line [1], shape (axes, c + 1)."""
    offsets: Array
    """Its constants [m], shape (axes, c + 1)."""
    charge: Array
    """Chord's offset [m] and slope [m/V], part of the hysteresis that is left [1], decay and ramp
    share of the corner in a sample [1]; shape (axes, 5).
    """
    creep: Array
    """Gain of each lag [1], its decay and ramp share in a sample, shape (3, axes, lags)."""


class StackState(NamedTuple):
    """What stacks remember; changed in place."""

    plays: Array
    """Outputs of the plays [V], shape (axes, m)."""
    piece: NDArray[np.int64]
    """Piece of the line that was used last, shape (axes,)."""
    last: Array
    """Last voltage [V], fading part [m], deviation from the chord [m], its slow part [m], and
    displacement before creep [m], shape (axes, 5).
    """
    lags: Array
    """Lags of the creep [m], shape (axes, lags)."""


def stack_arrays(
    stacks: Sequence[VirtualStack],
    sample_rate_hz: float,
    *,
    creep: Sequence[Creep | None] = (),
    charge: ChargeDrive | None = None,
) -> StackArrays:
    """Return the parameters of stacks as they are stepped; without `charge`, driven by voltage.

    Creep is that of each stack, none where not given. The fading part of a stack has a straight
    curve and a constant tangent.
    """
    lines = [stack.bent.line() for stack in stacks]
    # rows of one length: a play that never moves has no weight, a knot at infinity is never passed
    most = max(stack.bent.thresholds.size for stack in stacks)
    plays, knots = -(-most // 8) * 8, max(line.knots.size for line in lines)
    h = 1.0 / sample_rate_hz
    lags = [np.zeros((3, 0)) if c is None else _lags(c, h) for c in creep or [None] * len(stacks)]
    crept = max(lag.shape[1] for lag in lags)
    return StackArrays(
        plays=np.array([_scalars(stack) for stack in stacks]),
        thresholds=_rows([s.bent.thresholds for s in stacks], plays, np.inf),
        weights=_rows([s.bent.weights for s in stacks], plays, 0.0),
        knots=_rows([line.knots for line in lines], knots, np.inf),
        slopes=_rows([line.slopes for line in lines], knots + 1, 0.0),
        offsets=_rows([line.offsets() for line in lines], knots + 1, 0.0),
        charge=np.array(
            [(0.0, 0.0, 1.0, 0.0, 0.0) if charge is None else charge.row(s, h) for s in stacks]
        ),
        creep=np.array([_rows(list(row), crept, 0.0) for row in zip(*lags, strict=True)]),
    )


def relaxed_stacks(arrays: StackArrays) -> StackState:
    """Return the state of stacks without history, at no voltage."""
    axes = arrays.plays.shape[0]
    state = StackState(
        plays=np.zeros_like(arrays.thresholds),
        piece=np.zeros(axes, dtype=np.int64),
        last=np.zeros((axes, 5)),
        lags=np.zeros_like(arrays.creep[0]),
    )
    # from the chord to the relaxed stack, which is where a slow charge drive would lead too
    state.last[:, 2] = -arrays.charge[:, 0]
    state.last[:, 3] = -arrays.charge[:, 0]
    return state


@compiled
def step_stack(arrays: StackArrays, state: StackState, a: int, u: float) -> float:
    """Step stack `a` to a voltage [V], on a straight line; return displacement and creep [m]."""
    last = state.last[a]
    x = _memory(arrays, state, a, u, last)
    offset, slope, part, away, along = arrays.charge[a]
    if part != 1.0:
        chord = offset + slope * u
        e = x - chord
        last[3] += (last[2] - last[3]) * away + (e - last[2]) * along
        last[2] = e
        x = chord + part * e + (1.0 - part) * last[3]
    # the lags of `Creep`; a call for them makes the whole loop a tenth slower
    rise = x - last[4]
    total = 0.0
    for i in range(state.lags.shape[1]):
        lag = state.lags[a, i]
        lag += (last[4] - lag) * arrays.creep[1, a, i] + rise * arrays.creep[2, a, i]
        state.lags[a, i] = lag
        total += arrays.creep[0, a, i] * lag
    last[4] = x
    return x + total


@compiled
def _memory(arrays: StackArrays, state: StackState, a: int, u: float, last: Array) -> float:
    """Plays, the line after them, and the part that fades; last holds voltage and that part."""
    p, r, w = state.plays[a], arrays.thresholds[a], arrays.weights[a]
    for i in range(p.size):
        p[i] = max(u - r[i], min(u + r[i], p[i]))
    # eight sums side by side: a single one would wait for each addition
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for i in range(0, p.size, 8):
        s0 += w[i] * p[i]
        s1 += w[i + 1] * p[i + 1]
        s2 += w[i + 2] * p[i + 2]
        s3 += w[i + 3] * p[i + 3]
        s4 += w[i + 4] * p[i + 4]
        s5 += w[i + 5] * p[i + 5]
        s6 += w[i + 6] * p[i + 6]
        s7 += w[i + 7] * p[i + 7]
    gain, curve, steep, tangent, rate = arrays.plays[a]
    x = gain * u + (((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)))
    j, knots = state.piece[a], arrays.knots[a]
    while j < knots.size and x > knots[j]:
        j += 1
    while j > 0 and x <= knots[j - 1]:
        j -= 1
    state.piece[a] = j
    if u != last[0]:
        sign = 1.0 if u > last[0] else -1.0
        # how far it is below its curve tends to where curve and tangent drift apart
        behind = curve + steep * last[0] - last[1]
        behind = saturating(behind, sign * (steep - tangent), rate, sign * (u - last[0]))
        last[1] = curve + steep * u - behind
        last[0] = u
    return arrays.offsets[a, j] + arrays.slopes[a, j] * x + last[1]


def _scalars(stack: VirtualStack) -> tuple[float, ...]:
    f, g = stack.fading.anhysteretic, stack.fading.tangent
    if f.size != 2 or g.size != 1:
        raise ModelError(
            "a stack is stepped with a straight curve and a constant tangent of its fading part, "
            f"got {f.size} and {g.size} coefficients: give 2 and 1"
        )
    return stack.bent.gain, float(f[0]), float(f[1]), float(g[0]), stack.fading.rate


def _rows(rows: Sequence[Array], size: int, fill: float) -> Array:
    out = np.full((len(rows), size), fill)
    for row, given in zip(out, rows, strict=True):
        row[: given.size] = given
    return out


def _lags(creep: Creep, h: float) -> Array:
    ratio = h / creep.time_constants
    return np.array([creep.lag_gains, decay_share(ratio), ramp_share(ratio)])
