"""An output that does not follow its input: at an end of its range, or in a butterfly loop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import Cycles
from flexstage.quantities.units import readable
from flexstage.records import saturation
from flexstage.records.quality import difference_noise, quantisation_step


@dataclass(frozen=True, slots=True)
class _EndThresholds:
    """Limits of the search for an end of the range that the output does not follow."""

    bands: tuple[float, ...] = tuple(np.geomspace(0.3, 0.02, 10).tolist())
    """Widths of the end, as shares of the range of the input: slow saturation of an amplifier, and
    an end that is reached in 1 % of the samples.
    """
    flat: float = 0.4
    """Largest slope there, as a share of the slope further inside."""
    near: float = 0.6
    """Width of the part of a branch that is fitted, as a share of the range, and ..."""
    after_turn: float = 0.1
    """... its smallest distance from the turning point before."""
    scatter: float = 0.01
    """Largest residual of a branch with a sharp bend, as a share of the stroke: a ferroelectric
    that saturates leaves more.
    """
    smooth: float = 0.04
    """Width of the end over which a cubic saturates, as a share of the range."""


_END = _EndThresholds()
#: A swing over this share of the range and more is a large one.
_LARGE_SWING = 0.5
#: Number of intervals of the input over which a branch is averaged.
_INTERVALS = 40
#: Smallest turn of the branches of a butterfly, as a share of the range of the output.
_TURNS_BACK = 0.03


@dataclass(frozen=True, slots=True)
class RangeEnd:
    """End of the range at which an output stops, bends or turns back while the input moves."""

    kind: str
    """``clipping``, ``saturation`` or ``butterfly``."""
    at: float
    """Input at which it begins."""
    level: float
    """Output beyond that."""
    lost: float
    """Motion that is missing at the end."""
    samples: int
    """Number of samples concerned."""


def range_end(
    u: Array, y: Array, moves: Cycles, noise: float, input_noise: float = 0.0
) -> RangeEnd | None:
    """Find an end of the range at which the output does not follow the input.

    Only branches towards the end of the range are used, as every drive hesitates after a turning
    point. A parabola with a bend, at the input where it fits best, is compared with a cubic: noise
    does not hide a slope of many samples. The output is clipped beyond a sharp bend into a
    constant, saturates where the cubic fits better, and turns back where it then falls. Equal
    values at the end are clipped if noise would have changed them. The noise of the input is that
    removed from it.

    Validity: at most 30 % of the range beyond the bend; no bend within ten times the noise of the
    input, which reduces every slope there.
    """
    for sign in (1.0, -1.0):
        end = _upper_end(sign * u, sign * y, moves.turning, noise, input_noise)
        if end is not None:
            return replace(end, at=sign * end.at, level=sign * end.level)
    return None


def _upper_end(
    u: Array, y: Array, turning: NDArray[np.intp], noise: float, input_noise: float
) -> RangeEnd | None:
    high, span = float(u.max()), float(np.ptp(u))
    rising = [s for s in _swings(u, turning) if u[s.stop - 1] > u[s.start]]
    parts = [(u[s][at], y[s][at]) for s in rising if (at := _approach(u[s], high, span)).sum() > 5]
    if not parts:
        return None
    x, z = (np.concatenate(values) for values in zip(*parts, strict=True))
    x = (x - high) / span
    branch = np.repeat(np.arange(len(parts)), [part[0].size for part in parts])
    step, jitter = quantisation_step(y), max(difference_noise(u, 2), input_noise) / span

    def centred(values: Array) -> Array:
        return values - (np.bincount(branch, weights=values) / np.bincount(branch))[branch]

    target = centred(z)

    def fit(third: Array) -> tuple[float, Array, Array]:
        """Fit a parabola and a third column: mean square, coefficients, covariance."""
        columns = np.column_stack([centred(c) for c in (x, x**2, third)])
        inverse = np.asarray(np.linalg.pinv(columns), dtype=np.float64)
        c = inverse @ target
        return float(np.mean((target - columns @ c) ** 2)), c, inverse @ inverse.T

    levels, slope = saturation(y), float(centred(x) @ target / (centred(x) @ centred(x)))
    if levels.clipped_high and slope > 0.0:
        equal = [u[s][y[s] == levels.high] for s in rising]
        at_top = max((float(np.ptp(inputs)) for inputs in equal if inputs.size), default=0.0)
        lost = max(max(at_top / span - 3.0 * jitter, 0.0) * slope, noise)
        if lost > 2.0 * step:
            return RangeEnd("clipping", high - at_top, levels.high, lost, levels.at_high)
    bands = [b for b in _END.bands if b > 10.0 * jitter and np.sum(x > -b) > 4]
    if not bands:
        return None
    # a branch is curved: a bend is an excess over a parabola; slopes are inside, and at the end
    trials = [
        (fit(np.maximum(x + b, 0.0)), b, [(1.0, -2.0 * b, 0.0), (1.0, -b, 1.0)]) for b in bands
    ]
    smooth = _END.smooth
    slopes = [(1.0, -1.0, 0.75), (1.0, -smooth, 0.75 * smooth**2)]
    trials.append((fit(x**3), smooth, slopes))
    (square, c, spread), band, slopes = min(trials, key=lambda trial: trial[0][0])
    sharp = square < max(2.0 * noise**2, (_END.scatter * float(np.ptp(y))) ** 2)
    inside, outside = np.array(slopes)
    before, after = float(inside @ c), float(outside @ c)
    error = 3.0 * math.sqrt(max(noise**2, square) * float(outside @ spread @ outside))
    error += 2.0 * step / band  # a step of the converter is an error of all samples in it
    if before <= 0.0 or after + error > _END.flat * before:
        return None
    level, lost = float(np.median(z[x > -band])), (before - after) * band
    turns = after < -max(3.0 * error, 0.1 * before)
    return RangeEnd(
        "butterfly" if turns else "clipping" if sharp and band != smooth else "saturation",
        high - band * span, level, lost, int(np.sum(y > level - max(4.0 * noise, 0.05 * lost))),
    )  # fmt: skip


def _approach(u: Array, high: float, span: float) -> NDArray[np.bool_]:
    """Moving samples of a branch in the upper part of the range, well after its turning point."""
    step = np.abs(np.diff(u, prepend=u[0]))
    moves = (step > 0.0) & (step < 0.1 * span)
    return moves & (u > max(high - _END.near * span, u[0] + _END.after_turn * span))


def _swings(u: Array, turning: NDArray[np.intp]) -> list[slice]:
    """Parts of a signal between turning points that cover much of its range."""
    ends = np.concatenate(([0], turning, [u.size - 1]))
    size = _LARGE_SWING * float(np.ptp(u))
    pairs = zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
    return [slice(a, b + 1) for a, b in pairs if abs(u[b] - u[a]) > size]


def butterfly(u: Array, y: Array, moves: Cycles) -> tuple[float, float, float] | None:
    """Find a turn of the output inside the range of the input, in both directions.

    A lag also delays the turn of the output after a turning point of the input, but upwards on the
    falling branch and downwards on the rising one. If the polarity of a drive changes, both
    branches have a minimum inside, or both a maximum. Returned: the input at which the rising
    branch turns, that of the falling branch, and the size of the turn.
    """
    low, high = moves.range
    middle = low + (high - low) * (np.arange(_INTERVALS) + 0.5) / _INTERVALS
    large = _swings(u, moves.turning)
    up, down = (
        _branch(u, y, [s for s in large if (u[s.stop - 1] > u[s.start]) == rises])
        for rises in (True, False)
    )
    if up is None or down is None:
        return None
    filled = np.isfinite(up) & np.isfinite(down)
    if filled.sum() < _INTERVALS // 2:
        return None
    size = float(np.ptp(np.concatenate((up[filled], down[filled]))))
    for sign, against_lag in ((1.0, 1), (-1.0, 0)):
        turns = [_turns_back(sign * branch[filled]) for branch in (up, down)]
        depth = turns[against_lag][1]
        if depth > _TURNS_BACK * size:
            at = middle[filled]
            return float(at[turns[0][0]]), float(at[turns[1][0]]), depth
    return None


def _branch(u: Array, y: Array, swings: Sequence[slice]) -> Array | None:
    """Mean of the output in intervals of the input; None if it does not follow the input."""
    if not swings:
        return None
    at, outputs = np.concatenate([u[s] for s in swings]), np.concatenate([y[s] for s in swings])
    low, high = float(u.min()), float(u.max())
    which = np.minimum((_INTERVALS * (at - low) / (high - low)).astype(int), _INTERVALS - 1)
    count = np.bincount(which, minlength=_INTERVALS)
    total = np.bincount(which, weights=outputs, minlength=_INTERVALS)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    # noise has a minimum as well
    return mean if np.var(outputs - mean[which]) < 0.5 * np.var(outputs) else None


def _turns_back(branch: Array) -> tuple[int, float]:
    """Minimum of a branch, and the rise to the lower of its two ends."""
    k = int(np.argmin(branch))
    return k, float(min(branch[: k + 1].max(), branch[k:].max()) - branch[k])


def butterfly_text(turn: tuple[float, float, float], unit: str) -> str:
    """Return the message about a change of polarity."""
    up, down = (readable(unit, value) for value in turn[:2])
    return (
        f"butterfly loop: the output turns back where the input rises through {up} and where it "
        f"falls through {down}: a piezo drive passes its coercive field there, and no model "
        "includes the change of polarity; keep the drive voltage unipolar"
    )


def range_end_text(
    end: RangeEnd, sign: float, units: tuple[str, str], stroke: float, size: int
) -> str:
    """Return the message about an end of the range that the output does not follow."""
    at, level = readable(units[0], end.at), readable(units[1], sign * end.level, digits=4)
    lost = f"in {end.samples} samples ({100.0 * end.samples / size:.1f} %)"
    lost += f", and loses about {100.0 * end.lost / stroke:.2g} % of the stroke"
    if end.kind == "clipping":
        return (
            f"the output is clipped at {level} while the input still moves, {lost}: check for "
            "saturation of sensor or amplifier and for contact of the stage with a stop, and "
            "exclude that range of the input"
        )
    if end.kind == "saturation":
        return (
            f"the output saturates beyond an input of {at}, {lost}: its slope falls below "
            f"{100 * _END.flat:g} % without a sharp bend, as by a ferroelectric at high field or "
            "an amplifier that limits softly; exclude that range of the input unless it is used"
        )
    return (
        f"partial butterfly loop: the output turns back beyond an input of {at}, at {level}: the "
        "polarity of a piezo drive begins to change there, and no model includes that; exclude "
        "that range of the input"
    )
