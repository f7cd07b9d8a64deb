"""Virtual piezo stacks: hysteresis of no class that is fitted, as a model and sample by sample.

A `VirtualStack` takes a whole sequence of voltages. A loop with feedback has only the next one, so
that `step_stack` steps the same operators, with charge drive and creep, several stacks at a time.
"""

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
from flexstage.hysteresis.loops import settled_loop
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
#: Number of plays at which the kinks of the loop, below a nanometre, are lost in any noise.
FINE_PLAYS = 192
_PLAYS = 48
#: Share of the output that comes from the part with fading memory.
_FADING = 0.05
#: Relative change of the gain from the lower to the upper end.
_BEND = -0.12
_KINKS = 24


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualStack(HysteresisModel):
    """A piezo stack whose hysteresis is of no class that is fitted.

    ``y = bent(u) + fading(u)``: plays with a curved gain and wiping-out, and a part with fading
    memory. Minor loops are neither congruent nor closed at once, and the major loop is not
    symmetric. Every model of the package leaves a residual, as with a measured stack.

    Notes
    -----
    Validity: synthetic, with the size and shape of the loops of real stacks; not measured. It has
    no inverse. State: that of `bent`, then that of `fading`.

    Examples
    --------
    >>> stack = virtual_stack((0.0, 120.0), 38e-6, 0.125)
    >>> round(float(np.ptp(stack.simulate([120.0, 0.0, 120.0, 0.0]).values[2:])) * 1e6, 1)
    38.0
    """

    bent: ModifiedPrandtlIshlinskii
    """Part with wiping-out."""
    fading: Duhem
    """Part with fading memory, with a straight curve."""
    kind: ClassVar[str] = "virtual-stack"

    def initial_state(self) -> Array:
        return np.concatenate((self.bent.initial_state(), self.fading.initial_state()))

    def simulate(self, u: ArrayLike, state: ArrayLike | None = None) -> Response:
        voltage = samples(u, "input")
        first, second = self._parts(state)
        bent = self.bent.simulate(voltage, first)
        fading = self.fading.simulate(voltage, second)
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
        # a virtual stack is a target of identification
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
        Number of plays: each makes a kink in the loop; more plays make smaller kinks.

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

    def excess(share: float) -> float:
        loop, stroke = settled_loop(_stack(voltage_range, 1.0, share, plays), voltage_range, 400)
        return loop / stroke - width

    share = float(brentq(excess, 1e-3, 0.95, xtol=1e-10))  # type: ignore[arg-type]
    _, unit = settled_loop(_stack(voltage_range, 1.0, share, plays), voltage_range, 400)
    return _stack(voltage_range, stroke / unit, share, plays)


def _stack(
    voltage_range: tuple[float, float], stroke: float, share: float, plays: int
) -> VirtualStack:
    """Return a stack whose plays have a share of the gain, with an exponential part; bent."""
    low, high = voltage_range
    span = high - low
    r = 0.5 * span * np.arange(1, plays + 1) / (plays + 1)
    weights = np.exp(-r / (0.22 * span)) * (1.0 + 0.3 * np.cos(9.0 * r / span))
    slope = stroke / span
    weights *= share * (1.0 - _FADING) * slope / weights.sum()
    gain = (1.0 - share) * (1.0 - _FADING) * slope
    # limit curve of the fading part, and its tangent
    fading = Duhem(
        rate=6.0 / span,
        anhysteretic=np.array([0.0, _FADING * slope]),
        tangent=np.array([(1.0 - 0.8 * share) * _FADING * slope]),
        input_range=(min(low, 0.0), max(high, 0.0)),
    )
    # a parabola of short straight lines, flatter towards the end
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
    targets: Sequence[tuple[float | None, float]],
    measure: Callable[[Sequence[tuple[float, float]]], Sequence[tuple[float, float]]],
) -> list[tuple[float, float]]:
    """Return free displacements [m] and loop widths [1] of stacks that reach the targets.

    Creep, amplifier and stage add to both, so that each stack alone needs a little less. `measure`
    returns stroke [m] and relative width [1] of every axis with stacks of given sizes; a stroke of
    None is not matched.
    """
    for _ in range(2):
        measured = measure(sizes)
        sizes = [
            (
                free if target is None else free * target / stroke,
                float(np.clip(width * target_width / measured_width, *WIDTHS)),
            )
            for (free, width), (target, target_width), (stroke, measured_width) in zip(
                sizes, targets, measured, strict=True
            )
        ]
    return list(sizes)


_CYCLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargeDrive:
    r"""Charge drive of a stack: reduced hysteresis above a corner frequency.

    The displacement of a stack is nearly proportional to its charge; the hysteresis is between
    charge and voltage. Amplifiers leak charge, so that below a corner frequency they drive by
    voltage. With e the deviation of the displacement from its chord over the voltage range,

    .. math:: w = w_{chord} + \rho\, e + (1 - \rho)\, \mathrm{lowpass}(e)

    Notes
    -----
    Validity: the behaviour of such amplifiers with usual figures, not a model of a circuit.
    Saturation, leakage of the stack, the slow return of its offset, and the voltage that the charge
    needs are neglected. Creep is that of voltage drive.
    """

    corner_hz: float = 0.1
    """Frequency below which it drives by voltage [Hz]."""
    remainder: float = 0.08
    """Residual share of the hysteresis far above the corner [1]."""
    voltage_range: tuple[float, float] = (0.0, 120.0)
    """Ends of the chord [V]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.corner_hz < math.inf:
            raise ModelError(
                f"the corner of a charge drive must be positive and finite, got {self.corner_hz!r}"
            )
        if not 0.0 <= self.remainder < 1.0:
            raise ModelError(
                "the residual share of the hysteresis under charge drive must be 0 or more and "
                f"less than 1, got {self.remainder!r}"
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
    """Parameters of stacks, a row for each axis."""

    plays: Array
    """Gain [m/V], then slope and rate of the fading part: curve offset [m], curve slope [m/V],
    tangent [m/V], rate [1/V], shape (axes, 5).
    """
    thresholds: Array
    """Half the gap of each play [V], infinite where there is none, shape (axes, m)."""
    weights: Array
    """Their weights [m/V], shape (axes, m); m is a multiple of 8."""
    knots: Array
    """Kinks of the line after the plays [m], infinite where there is none, shape (axes, c)."""
    slopes: Array
    """Slopes of that line [1], shape (axes, c + 1)."""
    offsets: Array
    """Constants of that line [m], shape (axes, c + 1)."""
    charge: Array
    """Offset [m] and slope [m/V] of the chord, residual share of the hysteresis [1], decay and ramp
    share of the corner in a sample [1]; shape (axes, 5).
    """
    creep: Array
    """Gain of each creep lag [1], its decay and ramp share in a sample, shape (3, axes, lags)."""


#: Columns of `StackState.last`: voltage, fading part, deviation from the chord, its low-pass part,
#: and displacement before creep.
VOLTAGE, FADING, DEVIATION, SLOW_DEVIATION, DISPLACEMENT = range(5)


class StackState(NamedTuple):
    """State of stacks; changed in place."""

    plays: Array
    """Outputs of the plays [V], shape (axes, m)."""
    piece: NDArray[np.int64]
    """Current piece of the line after the plays, shape (axes,)."""
    last: Array
    """Last values, by `VOLTAGE` [V], `FADING`, `DEVIATION`, `SLOW_DEVIATION` and `DISPLACEMENT`
    [m], shape (axes, 5).
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
    """Return the parameters of stacks for `step_stack`; without `charge`, driven by voltage.

    Creep is that of each stack, by default none. The fading part of a stack must have a straight
    curve and a constant tangent.
    """
    lines = [stack.bent.line() for stack in stacks]
    # padding: a play without weight never moves, a knot at infinity is never passed
    largest = max(stack.bent.thresholds.size for stack in stacks)
    plays, knots = -(-largest // 8) * 8, max(line.knots.size for line in lines)
    h = 1.0 / sample_rate_hz
    lags = [np.zeros((3, 0)) if c is None else _lags(c, h) for c in creep or [None] * len(stacks)]
    lag_count = max(lag.shape[1] for lag in lags)
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
        creep=np.array([_rows(list(row), lag_count, 0.0) for row in zip(*lags, strict=True)]),
    )


def relaxed_stacks(arrays: StackArrays) -> StackState:
    """Return the state of stacks without history, at zero voltage."""
    axes = arrays.plays.shape[0]
    state = StackState(
        plays=np.zeros_like(arrays.thresholds),
        piece=np.zeros(axes, dtype=np.int64),
        last=np.zeros((axes, 5)),
        lags=np.zeros_like(arrays.creep[0]),
    )
    # from the chord to the relaxed stack, the limit of a slow charge drive too
    state.last[:, DEVIATION] = -arrays.charge[:, 0]
    state.last[:, SLOW_DEVIATION] = -arrays.charge[:, 0]
    return state


@compiled
def step_stack(arrays: StackArrays, state: StackState, a: int, u: float) -> float:
    """Step stack `a` to a voltage [V] on a straight line; return displacement with creep [m]."""
    last = state.last[a]
    x = _step_memory(arrays, state, a, u, last)
    offset, slope, share, decay, ramp = arrays.charge[a]
    if share != 1.0:
        chord = offset + slope * u
        e = x - chord
        before = last[DEVIATION]
        last[SLOW_DEVIATION] += (before - last[SLOW_DEVIATION]) * decay + (e - before) * ramp
        last[DEVIATION] = e
        x = chord + share * e + (1.0 - share) * last[SLOW_DEVIATION]
    # lags of `Creep`, inlined: a call makes the whole loop a tenth slower
    before = last[DISPLACEMENT]
    rise = x - before
    total = 0.0
    for i in range(state.lags.shape[1]):
        lag = state.lags[a, i]
        lag += (before - lag) * arrays.creep[1, a, i] + rise * arrays.creep[2, a, i]
        state.lags[a, i] = lag
        total += arrays.creep[0, a, i] * lag
    last[DISPLACEMENT] = x
    return x + total


@compiled
def _step_memory(arrays: StackArrays, state: StackState, a: int, u: float, last: Array) -> float:
    """Step the plays, the line after them, and the fading part; return their output [m]."""
    p, r, w = state.plays[a], arrays.thresholds[a], arrays.weights[a]
    for i in range(p.size):
        p[i] = max(u - r[i], min(u + r[i], p[i]))
    # eight partial sums: a single one would wait for each addition
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
    gain, curve_offset, curve_slope, tangent, rate = arrays.plays[a]
    x = gain * u + (((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)))
    j, knots = state.piece[a], arrays.knots[a]
    while j < knots.size and x > knots[j]:
        j += 1
    while j > 0 and x <= knots[j - 1]:
        j -= 1
    state.piece[a] = j
    before = last[VOLTAGE]
    if u != before:
        sign = 1.0 if u > before else -1.0
        # the lag behind the curve tends to where curve and tangent drift apart
        behind = curve_offset + curve_slope * before - last[FADING]
        behind = saturating(behind, sign * (curve_slope - tangent), rate, sign * (u - before))
        last[FADING] = curve_offset + curve_slope * u - behind
        last[VOLTAGE] = u
    return arrays.offsets[a, j] + arrays.slopes[a, j] * x + last[FADING]


def _scalars(stack: VirtualStack) -> tuple[float, ...]:
    f, g = stack.fading.anhysteretic, stack.fading.tangent
    if f.size != 2 or g.size != 1:
        raise ModelError(
            "the fading part of a stack must have a straight curve and a constant tangent, 2 and 1 "
            f"coefficients, got {f.size} and {g.size}"
        )
    return stack.bent.gain, float(f[0]), float(f[1]), float(g[0]), stack.fading.rate


def _rows(rows: Sequence[Array], size: int, fill: float) -> Array:
    out = np.full((len(rows), size), fill)
    for row, values in zip(out, rows, strict=True):
        row[: values.size] = values
    return out


def _lags(creep: Creep, h: float) -> Array:
    ratio = h / creep.time_constants
    return np.array([creep.lag_gains, decay_share(ratio), ramp_share(ratio)])
