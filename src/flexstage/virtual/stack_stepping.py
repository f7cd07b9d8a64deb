r"""Piezo stacks stepped one sample at a time: memory, charge drive and creep, as in their models.

A `VirtualStack` takes a whole sequence of voltages. A loop with feedback has only the next one, so
that the same operators are stepped here, several stacks side by side.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.models.power_law import saturating
from flexstage.virtual.stack import VirtualStack

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
