"""What in a record no model of a drive explains: spikes, clipping, a butterfly loop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import Cycles
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.quantities.units import readable
from flexstage.records import saturation
from flexstage.records.quality import difference_noise, quantisation_step

#: A spike is this many samples long at most, ...
_LONGEST_SPIKE = 3
#: ... stands out from its neighbours by this many times what they scatter by, ...
_STANDS_OUT = 8.0
#: ... among this many samples to either side; an input that moved so many before explains it.
_NEAR = 32

#: Shares of the range of the input at its end that are looked at, the widest first: slow
#: saturation of an amplifier, and an end of range that is reached in 1 % of the samples.
_END_BANDS = np.geomspace(0.3, 0.005, 14)
#: The output is clipped where it rises there by less than this share of its rise further in.
_FLAT = 0.3
#: A swing over this share of the range and more is a large one.
_LARGE_SWING = 0.5
#: Intervals of the input that a branch is averaged in.
_INTERVALS = 16
#: The branches of a butterfly turn back by this share of the range of the output at least.
_TURNS_BACK = 0.03
#: Places that a sentence names.
_NAMED = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordFault:
    """One thing in a record that is not the motion of a drive."""

    kind: str
    """``spikes``, ``clipping``, ``butterfly``, ``jump`` or ``drift``."""
    record: int
    """Number of the record, from 0."""
    at: tuple[float, ...]
    """Where it is, from the first sample of the record [s]; empty where it is everywhere."""
    size: float
    """How large it is, in the unit of the output; of a drift, over the record."""
    percent: float
    """The same over the stroke [%]."""
    text: str
    """What a reader should know and do."""


def clipped(
    u: Array, y: Array, moves: Cycles, noise: float, input_noise: float = 0.0
) -> tuple[float, float, int] | None:
    """Find where the output stays at an end although the input goes on.

    Only branches on which the input goes out to its end are looked at: behind a turning point every
    drive hesitates. Their slope near the end is compared with that further in. Neither a delay nor
    creep makes it smaller, and noise does not hide a slope of many samples; over some times the
    noise of the input it is not looked at. Values that are exactly alike at the end tell by
    themselves where noise would have made them differ. Returned: the value at which the output
    stays, how far the input alone would have moved it on, and the samples there. The noise of the
    input is what was taken out of it.
    """
    for sign in (1.0, -1.0):
        found = _clipped_above(sign * u, sign * y, moves.turning, noise, input_noise)
        if found is not None:
            return sign * found[0], found[1], found[2]
    return None


def _clipped_above(
    u: Array, y: Array, turning: NDArray[np.intp], noise: float, input_noise: float
) -> tuple[float, float, int] | None:
    low, high = float(u.min()), float(u.max())
    rising = [s for s in _swings(u, turning) if u[s.stop - 1] > u[s.start]]
    inner = _slope(u, y, rising, low + 0.3 * (high - low), low + 0.7 * (high - low))
    jitter = max(difference_noise(u, 2), input_noise)
    if inner is None or inner[0] <= 0.0:
        return None
    step = quantisation_step(y)
    held = saturation(y)
    if held.clipped_high:
        lost = max(_rise(u, y, rising) - 3.0 * jitter, 0.0) * inner[0]
        if max(lost, noise) > 2.0 * step:
            return held.high, max(lost, noise), held.at_high
    for share in _END_BANDS:
        band = share * (high - low)
        # noise of the input makes every slope over less than some times it too small
        outer = _slope(u, y, rising, high - band, high) if band > 10.0 * jitter else None
        if outer is None or outer[1] == 0.0:
            continue
        # a step of the converter is an error of all samples in it
        error = 4.0 * noise / outer[1] + 2.0 * step / band
        if outer[0] + error < _FLAT * inner[0]:
            level = float(np.median(np.concatenate([y[s][u[s] > high - band] for s in rising])))
            lost = (inner[0] - outer[0]) * band
            return level, lost, int(np.sum(y > level - max(4.0 * noise, 0.05 * lost)))
    return None


def _rise(u: Array, y: Array, swings: Sequence[slice]) -> float:
    """Over how much of the input the output is exactly at its highest, on the way out."""
    spans = []
    for s in swings:
        ends = np.flatnonzero(np.diff(np.concatenate(([0], (y[s] == y.max()).astype(int), [0]))))
        spans += [float(np.ptp(u[s][a:b])) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return max(spans, default=0.0)


def _slope(
    u: Array, y: Array, swings: Sequence[slice], low: float, high: float
) -> tuple[float, float] | None:
    """Slope of the output in a band of the input, and the root of the squares it rests on."""
    product = square = 0.0
    count = 0
    for s in swings:
        inside = (u[s] >= low) & (u[s] <= high)
        if int(inside.sum()) < 3:
            continue
        du = u[s][inside] - u[s][inside].mean()
        product += float(du @ (y[s][inside] - y[s][inside].mean()))
        square += float(du @ du)
        count += int(inside.sum())
    if count < 5 or square == 0.0:
        return None
    return product / square, float(np.sqrt(square))


def _swings(u: Array, turning: NDArray[np.intp]) -> list[slice]:
    """The parts of a signal from one turning point to the next that lead over much of its range."""
    ends = np.concatenate(([0], turning, [u.size - 1]))
    size = _LARGE_SWING * float(np.ptp(u))
    pairs = zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
    return [slice(a, b + 1) for a, b in pairs if abs(u[b] - u[a]) > size]


def butterfly(u: Array, y: Array, moves: Cycles) -> tuple[float, float, float] | None:
    """Find out whether the output turns back inside the range of the input, in both directions.

    A lag too makes the output go on behind a turning point, but upwards on the way down and
    downwards on the way up. Where the polarity of a drive changes, both branches have a lowest
    point inside, or both a highest one. Returned: the input where the rising branch turns and where
    the falling one does, and by how much the output turns back.
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
    for sign in (1.0, -1.0):
        turns = [_turns_back(sign * branch[filled]) for branch in (up, down)]
        depth = min(t[1] for t in turns)
        if depth > _TURNS_BACK * size:
            at = middle[filled]
            return float(at[turns[0][0]]), float(at[turns[1][0]]), depth
    return None


def _branch(u: Array, y: Array, swings: Sequence[slice]) -> Array | None:
    """Mean of the output in intervals of the input; None where it does not follow the input."""
    if not swings:
        return None
    at, own = np.concatenate([u[s] for s in swings]), np.concatenate([y[s] for s in swings])
    low, high = float(u.min()), float(u.max())
    which = np.minimum((_INTERVALS * (at - low) / (high - low)).astype(int), _INTERVALS - 1)
    count = np.bincount(which, minlength=_INTERVALS)
    total = np.bincount(which, weights=own, minlength=_INTERVALS)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    # noise has a lowest interval as well
    return mean if np.var(own - mean[which]) < 0.5 * np.var(own) else None


def _turns_back(branch: Array) -> tuple[int, float]:
    """Where a branch is lowest, and by how much it is higher on the lower of its two sides."""
    k = int(np.argmin(branch))
    return k, float(min(branch[: k + 1].max(), branch[k:].max()) - branch[k])


def butterfly_text(turned: tuple[float, float, float], unit: str) -> str:
    """Say that the polarity changes, and what to do."""
    up, down = (readable(unit, value) for value in turned[:2])
    return (
        f"butterfly loop: the output turns back where the input rises through {up} and where it "
        f"falls through {down}: a piezo drive passes its coercive field there, and no model here "
        "changes its polarity; keep the drive voltage unipolar"
    )


def findings_of_record(
    number: int,
    section: RecordSection,
    spikes: NDArray[np.intp],
    sign: float,
    units: tuple[str, str],
) -> tuple[RecordFault, ...]:
    """What a record shows by itself, its spikes taken out already.

    The sign is that of the recorded output over the input; units are of input and output.
    """
    u, y = section.u, section.y
    stroke = float(np.ptp(y[section.warm_up :]))
    made: list[RecordFault] = []

    def add(kind: str, at: Sequence[float], size: float, text: str) -> None:
        percent = 100.0 * size / stroke
        made.append(
            RecordFault(
                kind=kind, record=number, at=tuple(at), size=size, percent=percent, text=text
            )
        )

    if spikes.size:
        at = (spikes * section.dt).tolist()
        places = ", ".join(f"{t:.6g}" for t in at[:_NAMED]) + (", ..." if len(at) > _NAMED else "")
        add(
            "spikes", at, 0.0,
            f"{spikes.size} samples of the output are spikes (at {places} s): they were taken out, "
            "and what lies between their neighbours was put there; look at sensor and cable",
        )  # fmt: skip
    turned = butterfly(u, y, section.cycles)
    if turned is not None:
        add("butterfly", (), turned[2], butterfly_text(turned, units[0]))
        return tuple(made)  # it has no end to be clipped at
    flat = clipped(u, y, section.cycles, section.noise, section.input_noise)
    if flat is not None:
        level, lost, count = flat
        stays = readable(units[1], sign * level, digits=4)
        add(
            "clipping", (), lost,
            f"the output stays at {stays} while the input goes on, in {count} samples "
            f"({100.0 * count / y.size:.1f} %), and some {100.0 * lost / stroke:.2g} % of the "
            "stroke are cut off: is the sensor or the amplifier saturated, or does the stage touch "
            "a stop? Leave that part of the input out",
        )  # fmt: skip
    return tuple(made)


def without_spikes(u: Array, y: Array) -> tuple[Array, NDArray[np.intp]]:
    """Replace isolated outliers of the output by what their neighbours say.

    One to three samples are a spike where all of them are off the cubic through two samples before
    and two after, by more than neighbourhood, converter, speed and the change of the input explain,
    and where the output goes on after them as if they were not there. So a jump is none, nor is
    ringing, whose neighbours are off as well.
    """
    mended = np.array(y, dtype=np.float64)
    found: list[int] = []
    floor = 0.4 * quantisation_step(y)
    moved = _moved(u, y)
    for length in range(1, _LONGEST_SPIKE + 1):
        for first in _spikes(mended, length, floor, moved):
            at = np.arange(first, first + length)
            around = [first - 2, first - 1, first + length, first + length + 1]
            mended[at] = _cubic(length) @ mended[around]
            found += at.tolist()
    return mended, np.unique(np.array(found, dtype=np.intp))


def _spikes(y: Array, length: int, floor: float, moved: Array) -> list[int]:
    n = y.size - length - 3
    if n < 2 * _NEAR:
        return []
    before = np.arange(2, 2 + n)
    a0, a1 = y[before - 2], y[before - 1]
    b1, b0 = y[before + length], y[before + length + 1]
    between = np.stack((a0, a1, b1, b0))
    off = np.stack([y[before + j] for j in range(length)]) - _cubic(length) @ between
    least = np.abs(off).min(axis=0)
    # how far any sample is off its neighbours near by
    near = np.abs(y[2:-2] - _cubic(1)[0] @ np.stack((y[:-4], y[1:-3], y[3:-1], y[4:])))
    typical = 1.4826 * median_filter(near, size=2 * _NEAR + 1, mode="nearest")
    typical = np.maximum(typical, max(1.4826 * float(np.median(near)), floor))[before - 2]
    gain = float(np.sqrt(np.sum(_cubic(length) ** 2, axis=1).max() + 1.0))
    typical *= gain / float(np.sqrt(np.sum(_cubic(1) ** 2) + 1.0))
    speed = np.maximum(np.abs(a1 - a0), np.abs(b0 - b1))
    goes_on = np.abs(b1 - a1 - 0.5 * (length + 1) * (a1 - a0 + b0 - b1)) < 0.5 * least
    one_side = np.all(off > 0.0, axis=0) | np.all(off < 0.0, axis=0)
    is_off = least > _STANDS_OUT * typical + speed + moved[before]
    found: list[int] = []
    for k in before[is_off & one_side & goes_on].tolist():
        if not found or k > found[-1] + length + 1:
            found.append(k)
    return found


def _cubic(length: int) -> Array:
    """Weights of two samples before and two after for those between, shape (length, 4)."""
    x = np.array([-2.0, -1.0, length, length + 1.0])
    at = np.arange(length, dtype=np.float64)
    others = [np.delete(x, i) for i in range(4)]
    return np.stack(
        [np.prod([(at - o) / (x[i] - o) for o in others[i]], axis=0) for i in range(4)], axis=1
    )


def _moved(u: Array, y: Array) -> Array:
    """What changes of the speed of the input explain in the output, up to some samples later."""
    bend = np.abs(np.diff(u, 2, prepend=u[0], append=u[-1]))
    bend = np.maximum(bend - 5.0 * 1.4826 * float(np.median(bend)), 0.0)
    low, high = np.quantile(y, (0.005, 0.995))
    gain = float(high - low) / max(float(np.ptp(u)), 1e-300)
    return gain * maximum_filter1d(bend, size=2 * _NEAR + 1, origin=_NEAR - _LONGEST_SPIKE)
