"""Kernels of a sum of functions of plays: forward, backward, and piece by piece.

``z = gain x + sum_i f_i(play_i(x))``, with f_i continuous and piecewise linear on common knots:
``f_i(p) = offset[i, j] + slope[i, j] p`` between knots j - 1 and j. Prandtl-Ishlinskii, Preisach
and Maxwell-slip models are all of this form, the last with input and output exchanged.

Plays with rising thresholds start to move one after the other, so that only the first few move in
one step, and the rest of the sum is kept. It is kept as sums from the last play on: each is
computed from the state alone, and no rounding piles up with the samples.

A sum of one-sided dead zones is another form of one such function.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, fixed, rising

Indices = NDArray[np.int64]

#: Relative error of a reachable state of plays.
STATE_ROUNDING = 1e-9

#: Some units in the last digit, as a part of a number.
ROUNDING = 1e-15


def play_columns(u: ArrayLike, thresholds: ArrayLike) -> Array:
    """Return the outputs of plays with one input and many thresholds.

    A play with threshold r follows its input like a slider with a gap of r to each side:
    ``p = max(u - r, min(u + r, p before))`` for a monotone input (Krasnosel'skii and Pokrovskii
    1983; Brokate and Sprekels 1996, section 2.1).

    Thresholds [V] are not negative and rise, shape (m,). Outputs are zero before the first sample,
    and have the shape (n, m).

    Notes
    -----
    Validity: every input that is monotone between samples; no rounding beyond one subtraction.

    Examples
    --------
    >>> play_columns([3.0, 1.0, 4.0], [0.5, 2.0])
    array([[2.5, 1. ],
           [1.5, 1. ],
           [3.5, 2. ]])
    """
    r = np.array(thresholds, dtype=np.float64)
    return _columns(np.ascontiguousarray(u, dtype=np.float64), r)


def play_state(state: Array, thresholds: Array) -> Array:
    """Return a state of plays after checking that an input can lead to it.

    Two plays with thresholds r and s on one input are never more than ``|r - s|`` apart, and the
    input itself is the play with threshold zero. So plays start to move in the order of their
    thresholds, on which the stepping relies. State: last input and outputs of the plays [V], shape
    (m + 1,).
    """
    gap = np.diff(thresholds, prepend=0.0)
    excess = np.abs(np.diff(state)) - gap
    allowed = STATE_ROUNDING * max(float(np.max(np.abs(state))), float(thresholds[-1]))
    if np.max(excess) > allowed:
        i = int(np.argmax(excess))
        raise ModelError(
            f"no input leads to this state: numbers {i} and {i + 1} of it are "
            f"{abs(state[i + 1] - state[i]):g} apart, and their thresholds allow {gap[i]:g}; "
            f"take a state from a simulation"
        )
    return state


@compiled
def _columns(u: Array, thresholds: Array) -> Array:
    """Return the plays for every sample, shape (n, m)."""
    count = thresholds.size
    out = np.empty((u.size, count))
    p = np.zeros(count)
    for n in range(u.size):
        for i in range(count):
            p[i] = max(u[n] - thresholds[i], min(u[n] + thresholds[i], p[i]))
            out[n, i] = p[i]
    return out


def offsets_of(knots: Array, slopes: Array) -> Array:
    """Return the constants of piecewise-linear functions that are zero at zero.

    So that a function is ``offset + slope p`` on each interval; knots (c,), slopes (m, c + 1)
    below, between and above them.
    """
    zero = int(np.sum(knots <= 0.0))
    steps = (slopes[:, :-1] - slopes[:, 1:]) * knots
    below = -np.cumsum(steps[:, :zero][:, ::-1], axis=1)[:, ::-1]
    above = np.cumsum(steps[:, zero:], axis=1)
    return np.hstack((below, np.zeros((len(slopes), 1)), above)) + 0.0  # no negative zero


@compiled
def _interval(p: float, knots: Array, j: int) -> int:
    """Return the interval of the knots that holds p, searched from interval j on."""
    while j < knots.size and p > knots[j]:
        j += 1
    while j > 0 and p < knots[j - 1]:
        j -= 1
    return j


@compiled
def _sums(p: Array, knots: Array, slopes: Array, offsets: Array, where: Indices) -> Array:
    """Find the interval of every play, and return the sums of f from each play to the last."""
    sums = np.zeros(p.size + 1)
    for i in range(p.size - 1, -1, -1):
        where[i] = _interval(p[i], knots, 0)
        sums[i] = sums[i + 1] + (offsets[i, where[i]] + slopes[i, where[i]] * p[i])
    return sums


@compiled
def _move(
    x: float,
    sign: float,
    p: Array,
    thresholds: Array,
    knots: Array,
    slopes: Array,
    offsets: Array,
    where: Indices,
    sums: Array,
) -> None:
    """Move the plays to an input x that was approached upwards (+1) or downwards (-1)."""
    moved = 0
    while moved < p.size and sign * (x - p[moved]) > thresholds[moved]:
        p[moved] = x - sign * thresholds[moved]
        where[moved] = _interval(p[moved], knots, where[moved])
        moved += 1
    for i in range(moved - 1, -1, -1):
        sums[i] = sums[i + 1] + (offsets[i, where[i]] + slopes[i, where[i]] * p[i])


@compiled
def simulate(
    x: Array,
    gain: float,
    thresholds: Array,
    knots: Array,
    slopes: Array,
    offsets: Array,
    state: Array,
) -> Array:
    """Return the sum for a sequence of inputs, and leave the state after it in its place.

    The gain is that of the input itself, knots (c,), slopes and offsets (m, c + 1) make the
    functions of the plays, and the state is last input and plays, shape (m + 1,).
    """
    p = state[1:]
    where = np.zeros(p.size, dtype=np.int64)
    sums = _sums(p, knots, slopes, offsets, where)
    last = state[0]
    z = np.empty(x.size)
    for n in range(x.size):
        if x[n] != last:
            sign = 1.0 if x[n] > last else -1.0
            _move(x[n], sign, p, thresholds, knots, slopes, offsets, where, sums)
            last = x[n]
        z[n] = gain * last + sums[0]
    state[0] = last
    return z


@compiled
def _piece(
    sign: float,
    moving: int,
    gain: float,
    p: Array,
    thresholds: Array,
    knots: Array,
    slopes: Array,
    where: Indices,
) -> tuple[float, float, int]:
    """Return the slope here, the input where it changes, and which play makes it change.

    The play is one of those that move, if it passes a knot; the next one, if that starts to move;
    or -1 if the slope stays for ever.
    """
    slope = gain
    end, cause = np.inf, -1
    if moving < p.size:
        end, cause = sign * p[moving] + thresholds[moving], moving
    for i in range(moving):
        slope += slopes[i, where[i]]
        knot = where[i] if sign > 0.0 else where[i] - 1
        if 0 <= knot < knots.size:
            passing = sign * knots[knot] + thresholds[i]
            if passing < end:
                end, cause = passing, i
    return slope, sign * end, cause


@compiled
def _moving(x: float, sign: float, p: Array, thresholds: Array) -> int:
    """Return how many plays move as soon as the input does."""
    count = 0
    # A play that was moved last is off its threshold by the rounding of a subtraction.
    while count < p.size and (
        sign * (x - p[count]) >= thresholds[count] - ROUNDING * (abs(x) + thresholds[count])
    ):
        count += 1
    return count


@compiled
def invert(
    z: Array,
    gain: float,
    thresholds: Array,
    knots: Array,
    slopes: Array,
    offsets: Array,
    state: Array,
) -> tuple[Array, int]:
    """Return the inputs that give a sequence of sums, and leave the state after it in its place.

    For a frozen memory the sum is a rising, piecewise-linear function of the input; the straight
    pieces are walked through until one of them reaches the wanted sum.

    The number is the first sample that no input reaches, at which the input stops where the sum
    does, or -1. Arguments as in `simulate`.
    """
    p = state[1:]
    where = np.zeros(p.size, dtype=np.int64)
    sums = _sums(p, knots, slopes, offsets, where)
    x, missed = state[0], -1
    out = np.empty(z.size)
    for n in range(z.size):
        here = gain * x + sums[0]
        if z[n] != here:
            sign = 1.0 if z[n] > here else -1.0
            moving = _moving(x, sign, p, thresholds)
            while True:
                slope, end, cause = _piece(sign, moving, gain, p, thresholds, knots, slopes, where)
                # Rounding can put the end of a piece a last digit behind its start.
                reach = max(0.0, sign * (end - x))
                if slope > 0.0 and (cause < 0 or sign * (z[n] - here) <= slope * reach):
                    x += (z[n] - here) / slope
                    break
                if cause < 0:
                    missed = n if missed < 0 else missed
                    break
                here += sign * slope * reach
                x += sign * reach
                if cause == moving:
                    moving += 1
                else:
                    where[cause] += 1 if sign > 0.0 else -1
            _move(x, sign, p, thresholds, knots, slopes, offsets, where, sums)
        out[n] = x
    state[0] = x
    return out, missed


@compiled
def pieces(
    values: Array,
    backward: bool,
    gain: float,
    thresholds: Array,
    knots: Array,
    slopes: Array,
    offsets: Array,
    state: Array,
    out: Array,
) -> int:
    """Return the number of straight pieces between the samples, and write as many as fit.

    Backward, the samples are of the sum and the pieces of the input that gives it; every slope must
    be positive then. Pieces are start [samples], value there and slope [per sample], shape (k, 3).
    The rest is as in `simulate`.
    """
    p = state[1:]
    where = np.zeros(p.size, dtype=np.int64)
    sums = _sums(p, knots, slopes, offsets, where)
    x = state[0]
    count = 0
    for n in range(values.size - 1):
        z = gain * x + sums[0]
        step = values[n + 1] - values[n]
        sign = 1.0 if step >= 0.0 else -1.0
        moving = _moving(x, sign, p, thresholds)
        start = float(n)
        while True:
            slope, end, cause = _piece(sign, moving, gain, p, thresholds, knots, slopes, where)
            reach = max(0.0, sign * (end - x))
            if backward:
                time = n + (z + sign * slope * reach - values[n]) / step if step != 0.0 else np.inf
            else:
                time = n + (x + sign * reach - values[n]) / step if step != 0.0 else np.inf
            if time > start:
                if count < out.shape[0]:
                    out[count, 0] = start
                    out[count, 1] = x if backward else z
                    out[count, 2] = step / slope if backward else step * slope
                count += 1
            if cause < 0 or time >= n + 1:
                break
            z += sign * slope * reach
            x += sign * reach
            start = max(start, time)
            if cause == moving:
                moving += 1
            else:
                where[cause] += 1 if sign > 0.0 else -1
        x = x + (values[n + 1] - z) / slope if backward else values[n + 1]
        _move(x, sign, p, thresholds, knots, slopes, offsets, where, sums)
    state[0] = x
    return count


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiecewiseLinear:
    """A continuous, piecewise-linear function that is zero at zero."""

    knots: Array
    """Places of changes of the slope, rising, shape (c,)."""
    slopes: Array
    """Slopes below, between and above the knots, shape (c + 1,)."""

    def at(self, x: ArrayLike) -> Array:
        """Return the function."""
        inputs = np.asarray(x, dtype=np.float64)
        j = np.searchsorted(self.knots, inputs)
        return self.offsets()[j] + self.slopes[j] * inputs

    def offsets(self) -> Array:
        """Return the values at zero of its straight lines, shape (c + 1,)."""
        return offsets_of(self.knots, self.slopes[None, :])[0]

    def inverse(self) -> "PiecewiseLinear":
        """Return the inverse, a piecewise-linear function as well.

        A ModelError if a slope is not positive.
        """
        if np.min(self.slopes) <= 0.0:
            raise ModelError(
                f"a line has an inverse if all its slopes are positive, got {np.min(self.slopes):g}"
            )
        return PiecewiseLinear(knots=self.at(self.knots), slopes=1.0 / self.slopes)


def dead_zones(thresholds: ArrayLike, weights: ArrayLike) -> tuple[Array, Array]:
    """Return thresholds and weights of dead zones after checking them."""
    r = rising(thresholds, "dead zones", least=0)
    w = fixed(weights, "weights of dead zones", r.shape)
    if np.any(r == 0.0):
        raise ModelError("a dead zone has a threshold that is not zero, got 0: use the gain there")
    return r, w


def dead_zone_line(gain: float, r: Array, w: Array) -> PiecewiseLinear:
    """Return the superposition of one-sided dead zones.

    ``S(x) = gain x + sum_i w_i max(x - r_i, 0)`` for positive, ``min(x - r_i, 0)`` for negative
    thresholds r_i and weights w_i, those of `dead_zones` (Kuhnen 2003, Eur. J. Control 9:407).

    Notes
    -----
    Validity: any continuous, piecewise-linear function that is zero at zero and has no kink there.

    Examples
    --------
    >>> line = dead_zone_line(1.0, *dead_zones([-4.0, 5.0], [-0.2, 0.3]))
    >>> line.at([-10.0, 2.0, 7.0])
    array([-8.8,  2. ,  7.6])
    """
    below = np.cumsum(w[r < 0.0][::-1])[::-1]
    above = np.cumsum(w[r > 0.0])
    return PiecewiseLinear(knots=r, slopes=gain + np.concatenate([below, [0.0], above]))
