"""When samples were taken, whether they rise evenly and are complete; parts and even times."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.quantities.units import readable
from flexstage.records.columns import FileColumns
from flexstage.records.quality import quantisation_step
from flexstage.records.record import Channel, Record, column_and_unit
from flexstage.records.text_rows import X_VALUE

#: A step this many times the usual one means that samples are missing, ...
LARGEST_STEP = 1.5
#: ... and of times that are to be made even, that more than one is.
LARGEST_UNEVEN_STEP = 2.5
#: A rate below this share of that of the samples has several in each new step.
_COARSE = 0.8
#: A step of fewer digits is meant, and so is one whose reciprocal has no more than ...
_FEW, _MANY = 3, 5
# times are looked through in pieces of so many steps
_PIECE = 65_536


def require_complete(values: Array, name: str) -> None:
    """Refuse a column with samples that are no numbers."""
    bad = ~np.isfinite(values)
    if bad.any():
        first, count = int(bad.argmax()), int(bad.sum())
        kind = "missing or no number (NaN)" if np.isnan(values[first]) else "infinite"
        raise RecordError(
            f"column '{name}' is {kind} at sample {first}, and {count} of its {values.size} "
            "samples are not finite: correct them, read rows without them by the option rows, or "
            "name the columns that you need by the option columns"
        )


def require_rate(rate_hz: float | None) -> None:
    """Refuse a sample rate that is given and is none."""
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise RecordError(f"the sample rate must be positive, got {rate_hz} Hz")


def require_rising(time: Array, name: str = "time", largest_step: float = LARGEST_STEP) -> None:
    """Refuse times that do not rise, and gaps between them.

    `largest_step` is the longest step that is no gap, over the median one.
    """
    require_complete(time, name)
    if time.size < 2:
        raise RecordError(f"a record needs at least two samples, got {time.size}")
    steps = np.diff(time)
    if not np.all(steps > 0.0):
        at = int((steps <= 0.0).argmax())
        count = int((steps <= 0.0).sum())
        if steps[at] == 0.0:
            raise RecordError(
                f"the time in '{name}' is repeated: samples {at} and {at + 1} are both at "
                f"{time[at]:.9g} s ({count} such steps): if it was written with too few digits, "
                f"give the sample rate instead{_mean_rate(time)}; if rows stand there twice, take "
                "them out"
            )
        raise RecordError(
            f"the time in '{name}' goes back from {time[at]:.9g} s to {time[at + 1]:.9g} s after "
            f"sample {at} ({count} such steps): is it a column of time, and the file one "
            "recording? Read a part by the option rows, or give the sample rate instead"
        )
    usual = float(np.median(steps))
    wide = steps > largest_step * usual
    if wide.any():
        at = int(wide.argmax())
        even = steps.max() <= LARGEST_UNEVEN_STEP * usual
        uneven = (
            ", or, if no more than one sample is lost, make the times even by the option resample"
        )
        raise RecordError(
            f"the time in '{name}' has a gap of {steps[at]:.6g} s after sample {at} (t = "
            f"{time[at]:.9g} s), where a step is {usual:.6g} s; {int(wide.sum())} such gaps: read "
            f"the part before or after by the option rows{uneven if even else ''}"
        )


def _mean_rate(time: Array) -> str:
    span = float(time[-1] - time[0])
    return f" (in the mean it is {(time.size - 1) / span:.6g} Hz)" if span > 0.0 else ""


def extreme_steps(time: Array) -> tuple[float, float]:
    """Return the least and the greatest step of times, in pieces that stay in the cache.

    Examples
    --------
    >>> extreme_steps(np.array([0.0, 0.75, 2.0]))
    (0.75, 1.25)
    """
    steps = (np.diff(time[i : i + _PIECE + 1]) for i in range(0, time.size - 1, _PIECE))
    ends = np.array([(piece.min(), piece.max()) for piece in steps])
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def time_jitter(time: Array) -> float:
    """Return the largest difference of a rising time's steps from their mean, over that mean.

    Examples
    --------
    >>> time_jitter(np.array([0.0, 0.9, 2.0]))
    0.1
    """
    steps = np.diff(time)
    mean = float(time[-1] - time[0]) / steps.size
    return float(np.abs(steps - mean).max() / mean)


def step_uncertainty(time: Array) -> float:
    """Return how far the step of even times is unknown, as it was written with few digits.

    A step such as 0.000977 s is that of 1024 Hz, and of all rates from 1023.0 to 1024.1 Hz: the
    mean of the steps does not tell, as they are all the same. A step of one or two digits, or one
    whose reciprocal has no more than five, is taken as meant: 0.3 ms, 0.00128 s of 781.25 Hz.

    Parameters
    ----------
    time : numpy.ndarray
        Times [s], shape (n,).

    Returns
    -------
    float
        Half a unit of the last digit over the step; 0 where that is below what a crystal promises,
        50 in a million, or steps differ.

    Validity
    --------
    A clock whose period happens to be a number of three or four digits, such as 0.000977 s itself,
    is taken for a rounded one.

    Examples
    --------
    >>> round(step_uncertainty(0.000977 * np.arange(100)), 6), step_uncertainty(np.arange(9) / 1e3)
    (0.000512, 0.0)
    """
    step = float(time[-1] - time[0]) / (time.size - 1)
    low, high = extreme_steps(time)
    # times that were made by adding a step differ by rounding alone
    same_step = 1e-6
    if max(abs(low / step - 1.0), abs(high / step - 1.0)) > same_step:
        return 0.0
    digits = _digits(step)
    if digits < _FEW or _digits(1.0 / step) <= _MANY:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(step)) - digits + 1)
    share = 0.5 * unit / step
    # what a crystal clock is good for
    crystal = 5e-5
    return share if share > crystal else 0.0


def _digits(value: float) -> int:
    """How many digits a number has, as far as it stands for more than rounding."""
    return next(
        (n for n in range(1, 9) if abs(float(f"{value:.{n - 1}e}") / value - 1.0) < 1e-9), 9
    )


def require_uniform(record: Record) -> None:
    """Refuse a record whose samples are not evenly spaced in time."""
    if not record.uniform:
        mend = "make them even by the option resample, resampled(record) in Python, or"
        if _is_rounded(record.time):
            mend = "they are even but for the digits that times are written with:"
        raise RecordError(
            f"the samples of '{record.source or 'the record'}' are not evenly spaced: steps "
            f"differ from their mean by up to {100.0 * time_jitter(record.time):.3g} %; {mend} "
            f"give the sample rate instead of the time{_mean_rate(record.time)}"
        )


def _is_rounded(time: Array) -> bool:
    """Say whether times are even but for the digits that they are written with."""
    # even times that were rounded when they were written are told from uneven ones by so many
    fewest = 20
    if time.size < fewest:
        return False
    number = np.arange(time.size)
    even = np.polynomial.Polynomial.fit(number, time, 1)(number)
    return bool(np.abs(time - even).max() <= quantisation_step(time))


def resampled(
    record: Record,
    sample_rate_hz: float | None = None,
    *,
    kind: Literal["linear", "cubic", "mean"] = "cubic",
) -> Record:
    """Return a record at evenly spaced times, by interpolation.

    Parameters
    ----------
    record : Record
        A record without gaps.
    sample_rate_hz : float, optional
        The new sample rate [Hz]; the mean one of the record where not given.
    kind : {"linear", "cubic", "mean"}
        Straight lines between the samples, a cubic spline through them, or the mean of the straight
        lines over each new step.

    Returns
    -------
    Record
        The same columns from the first time to the last, with a note; means are at the middle of
        their steps.

    Validity
    --------
    Interpolation is no filter: below the record's own rate, what is faster than half the new rate
    comes back as slow motion, but from means. A line lowers a sine of f by (pi f / rate)^2 / 2 at
    the most, a mean by (pi f / rate)^2 / 6, a spline far less where there are more than some 5
    samples in a period; a spline swings over at a step.

    Raises
    ------
    RecordError
        The rate is not positive, or leaves fewer than two samples.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.array([0.0, 0.9, 2.1, 3.0])
    >>> r = Record(channels=(Channel(name="x", values=2.0 * t),), time=t)
    >>> resampled(r, 1.0).channel("x").values
    array([0., 2., 4., 6.])
    """
    if kind not in ("linear", "cubic", "mean"):
        raise RecordError(f"the kind of interpolation must be linear, cubic or mean, got {kind!r}")
    rate = record.sample_rate_hz if sample_rate_hz is None else sample_rate_hz
    require_rate(rate)
    old = record.time
    span = float(old[-1] - old[0])
    # the last sample is kept where it falls on the new times but for rounding
    count = int(np.floor(span * rate * (1.0 + 1e-12) + 1e-9)) + (kind != "mean")
    if count < 2 or count > 2**29:
        raise RecordError(f"at {rate:g} Hz a record of {span:g} s would have {count} samples")
    middle = 0.5 if kind == "mean" else 0.0
    time = np.minimum(old[0] + (np.arange(count) + middle) / rate, old[-1])
    channels = tuple(
        replace(c, values=_interpolated(time, old, c.values, kind, rate)) for c in record.channels
    )
    numbers = np.arange(old.size) if record.numbers is None else record.numbers
    note = f"resampled at {rate:g} Hz by {_MANNERS[kind]}"
    if kind != "mean" and rate < 0.999 * record.sample_rate_hz:
        note += f", below its {record.sample_rate_hz:g} Hz and without a filter"
    return replace(
        record,
        channels=channels,
        time=time,
        notes=(*record.notes, note),
        numbers=np.interp(time, old, numbers),
    )


_MANNERS = {
    "linear": "linear interpolation",
    "cubic": "cubic interpolation",
    "mean": "means over each step",
}


def _interpolated(time: Array, old: Array, values: Array, kind: str, rate: float) -> Array:
    if kind == "mean":
        area = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(old))))
        ends = np.append(time - 0.5 / rate, time[-1] + 0.5 / rate)
        at = np.clip(np.searchsorted(old, ends, "right") - 1, 0, old.size - 2)
        # the trapezoid from the sample before on, so that each end is exact
        there = np.interp(ends, old, values)
        integral = area[at] + 0.5 * (values[at] + there) * (ends - old[at])
        return np.diff(integral) * rate
    if kind == "linear" or old.size < 4 or not np.isfinite(values).all():
        return np.interp(time, old, values)
    from scipy.interpolate import make_interp_spline

    # times from the first on, so that the spline does not lose digits to a distant origin
    return np.asarray(make_interp_spline(old - old[0], values, k=3)(time - old[0]))


def resample_uniform(record: Record, sample_rate_hz: float | None = None) -> Record:
    """Return a record whose samples came at uneven times at even ones, no finer than they were.

    Straight lines between the samples make no turning point that was not measured, as a spline
    does; of a lower rate each sample is the mean over its step.

    Parameters
    ----------
    record : Record
        A record without gaps.
    sample_rate_hz : float, optional
        The new sample rate [Hz]; the reciprocal of the record's median step where not given.

    Returns
    -------
    Record
        The same columns, with a note that says what is lost.

    Raises
    ------
    RecordError
        The rate is higher than that of the samples, or leaves fewer than two.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.array([0.0, 0.9, 2.1, 3.0])
    >>> r = Record(channels=(Channel(name="x", values=2.0 * t),), time=t)
    >>> resample_uniform(r).channel("x").values.round(2)
    array([0. , 1.8, 3.6, 5.4])
    """
    steps = np.diff(record.time)
    usual = float(np.median(steps))
    rate = 1.0 / usual if sample_rate_hz is None else sample_rate_hz
    # an even rate may be said with so few digits that it is a little above that of the samples
    finest = 1.05
    if rate * usual > finest:
        raise RecordError(
            f"'{record.source or 'the record'}' cannot be resampled at {rate:g} Hz, as its samples "
            f"come at {1.0 / usual:.6g} Hz: give that rate or a lower one"
        )
    coarse = rate * usual < _COARSE
    made = resampled(record, rate, kind="mean" if coarse else "linear")
    off = steps - usual
    # where a sine is lowered by a hundredth, by the straight lines and by the means
    slow = np.sqrt(0.01 / (usual**2 / 2.0 + coarse / (6.0 * rate**2))) / np.pi
    rms, largest = float(np.std(off)), float(np.abs(off).max())
    # turning points lie anywhere in a step that is averaged
    late = float(np.hypot(rms, 0.1 * coarse / rate))
    lost = (
        f"steps of time differ from their median by {100.0 * rms / usual:.3g} % rms and up to "
        f"{100.0 * largest / usual:.3g} %; a delay is uncertain to about "
        f"{readable('s', late, digits=2)}, and motion above {slow:.3g} Hz is lowered by more "
        "than 1 %"
    )
    return replace(made, notes=(*record.notes, f"{made.notes[-1]}: {lost}"))


#: What a column of times may be called.
TIME_NAMES = frozenset(("t", "time", "times", "timestamp", "zeit", "x_value"))
# two statements of one sample rate may differ by their printed digits, and by no more
_SAME_RATE = 0.01


def timed(
    raw: FileColumns,
    channels: list[Channel],
    wanted: str | int | None,
    rate: float | None,
    largest_step: float,
) -> tuple[list[Channel], NDArray[np.float64], list[str]]:
    """Return the times, and the channels with the column of time in seconds.

    The channel that is chosen as time is replaced by one in seconds. `largest_step` is the longest
    step that is no gap, over the median one. The strings say where the times come from.
    """
    require_rate(rate)
    names = [c.name for c in channels]
    if wanted is not None:
        number = column_and_unit(names, wanted)[0]
        raw.require_numbers(number)
        channels[number], notes = _as_seconds(channels[number])
        times = channels[number].values
        require_rising(times, names[number], largest_step)
        given = rate if rate is not None else raw.sample_rate_hz
        where = "given" if rate is not None else f"in {raw.rate_source}"
        _require_same_rate(times, given, names[number], where)
        return channels, times, notes + _unevenness(times) + _coarseness(times)
    size = channels[0].values.size
    own = raw.sample_rate_hz
    if rate is not None and own is not None and abs(own / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the sample rate is given as {rate:g} Hz, and {raw.rate_source} of the file says "
            f"{own:g} Hz: leave one out, or correct it"
        )
    called = [
        i
        for i, c in enumerate(channels)
        if (c.name.lower() in TIME_NAMES and c.unit in ("s", ""))
        # a column without a name whose unit is said
        or (c.name == f"column {i}" and c.unit == "s")
    ]
    sure = [i for i in called if channels[i].unit == "s"]
    if rate is not None or own is not None:
        used = rate if rate is not None else own
        assert used is not None
        for i in sure:
            if np.isfinite(channels[i].values).all():
                _require_same_rate(channels[i].values, used, names[i], "given")
        source = "as given" if rate is not None else f"from {raw.rate_source} of the file"
        start = raw.start if own is not None else 0.0
        times = start + np.arange(size) / used
        notes = [f"sample rate {used:g} Hz, {source}"]
        return channels, times, notes if rate is not None else notes + _coarseness(times)
    number = _own_time(names, sure)
    if number is not None:
        raw.require_numbers(number)
        times = channels[number].values
        require_rising(times, names[number], largest_step)
        said = [f"times from column '{names[number]}'", *_unevenness(times), *_coarseness(times)]
        return channels, times, said
    raise RecordError(_no_time(raw, names, called))


def _own_time(names: Sequence[str], sure: Sequence[int]) -> int | None:
    """Return the only column of time, or the one that is called just so among several."""
    exact = [i for i in sure if names[i] == "time"]
    found = exact or list(sure)
    return found[0] if len(found) == 1 else None


def _no_time(raw: FileColumns, names: Sequence[str], called: Sequence[int]) -> str:
    hint = raw.hint
    several = [name for name in names if name.startswith(f"{X_VALUE} of ")]
    if several:
        hint = f"; its channels have different times: choose one by time, such as '{several[0]}'"
    if called and not hint:
        listed = " or ".join(f"'{names[i]}'" for i in called)
        hint = f"; column {listed} may be it: choose it by time"
    return (
        "the file does not say when its samples were taken: give the sample rate, or the column of "
        f"time (columns: {', '.join(f'{i}: {n}' for i, n in enumerate(names[:20]))}){hint}"
    )


def _as_seconds(channel: Channel) -> tuple[Channel, list[str]]:
    """Return a column that was chosen as time, in seconds."""
    if channel.unit == "":
        return replace(channel, unit="s"), [
            f"times from column '{channel.name}', which has no unit: taken as seconds"
        ]
    if channel.unit != "s":
        raise RecordError(
            f"column '{channel.name}' is in {channel.unit}, and cannot be the time: choose "
            "another, or give its unit, s or ms"
        )
    return channel, [f"times from column '{channel.name}'"]


def _require_same_rate(
    times: NDArray[np.float64], rate: float | None, name: str, where: str
) -> None:
    if rate is None or times.size < 2:
        return
    span = float(times[-1] - times[0])
    found = (times.size - 1) / span if span > 0.0 else np.inf
    if abs(found / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the sample rate {rate:g} Hz ({where}) and the times in column '{name}', whose mean "
            f"rate is {found:g} Hz, conflict: leave one out, or give the unit of the time (s or ms)"
        )


def _unevenness(times: NDArray[np.float64]) -> list[str]:
    jitter = time_jitter(times)
    if jitter <= 1e-3:
        return []
    return [f"steps of time differ from their mean by up to {100.0 * jitter:.3g} %"]


def _coarseness(times: NDArray[np.float64]) -> list[str]:
    """Say between which rates a step of few digits leaves the choice."""
    share = step_uncertainty(times) if times.size > 1 else 0.0
    if share == 0.0:
        return []
    step = float(times[-1] - times[0]) / (times.size - 1)
    low, high = 1.0 / step / (1.0 + share), 1.0 / step / (1.0 - share)
    return [
        f"the step of time is written as {step:.4g} s, which leaves the sample rate between "
        f"{low:.6g} and {high:.6g} Hz, and every frequency uncertain by {100.0 * share:.2g} %: say "
        "the rate by the option sample-rate"
    ]
