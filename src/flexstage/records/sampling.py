"""Times of samples, checks that they are uniform and complete, and resampling."""

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

#: Largest step over the median, beyond which samples are missing, ...
LARGEST_STEP = 1.5
#: ... and for resampling, beyond which more than one is missing.
LARGEST_UNEVEN_STEP = 2.5
#: New rate over that of the samples, below which each new step has several samples.
_COARSE = 0.8
#: A step with fewer digits is exact, and so is one whose reciprocal has at most ...
_FEW, _MANY = 3, 5
# steps per block, which fits in the cache
_PIECE = 65_536


def require_complete(values: Array, name: str) -> None:
    """Refuse a column with samples that are not finite."""
    bad = ~np.isfinite(values)
    if bad.any():
        first, count = int(bad.argmax()), int(bad.sum())
        kind = "missing or not a number (NaN)" if np.isnan(values[first]) else "infinite"
        raise RecordError(
            f"column '{name}' is {kind} at sample {first}, and {count} of its {values.size} "
            "samples are not finite: correct them, select rows without them by the option rows, or "
            "name only the required columns by the option columns"
        )


def require_rate(rate_hz: float | None) -> None:
    """Refuse an impossible sample rate."""
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise RecordError(f"the sample rate must be positive, got {rate_hz} Hz")


def require_rising(time: Array, name: str = "time", largest_step: float = LARGEST_STEP) -> None:
    """Refuse times that do not rise, and gaps between them.

    `largest_step` is the longest step that is no gap, over the median step.
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
                f"give the sample rate instead{_mean_rate(time)}; if rows are duplicated, remove "
                "them"
            )
        raise RecordError(
            f"the time in '{name}' goes back from {time[at]:.9g} s to {time[at + 1]:.9g} s after "
            f"sample {at} ({count} such steps): is it a column of time, and is the file one "
            "recording? Read a part by the option rows, or give the sample rate instead"
        )
    usual = float(np.median(steps))
    wide = steps > largest_step * usual
    if wide.any():
        at = int(wide.argmax())
        even = steps.max() <= LARGEST_UNEVEN_STEP * usual
        resample = ", or, if only single samples are lost, use the option resample"
        raise RecordError(
            f"the time in '{name}' has a gap of {steps[at]:.6g} s after sample {at} (t = "
            f"{time[at]:.9g} s), where a step is {usual:.6g} s; {int(wide.sum())} such gaps: read "
            f"the part before or after by the option rows{resample if even else ''}"
        )


def _mean_rate(time: Array) -> str:
    span = float(time[-1] - time[0])
    return f" (its mean is {(time.size - 1) / span:.6g} Hz)" if span > 0.0 else ""


def extreme_steps(time: Array) -> tuple[float, float]:
    """Return the smallest and the largest step of times.

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
    """Return the relative uncertainty of the step of uniform times written with few digits.

    A step such as 0.000977 s may be of 1024 Hz, or of any rate from 1023.0 to 1024.1 Hz; the mean
    does not help, as all steps are equal. A step of one or two digits, or one whose reciprocal has
    at most five, is taken as exact: 0.3 ms, 0.00128 s of 781.25 Hz.

    Parameters
    ----------
    time : numpy.ndarray
        Times [s], shape (n,).

    Returns
    -------
    float
        Half a unit of the last digit over the step; 0 if that is below the accuracy of a crystal,
        50 ppm, or if steps differ.

    Validity
    --------
    A clock whose period is exactly a number of three or four digits, such as 0.000977 s, counts as
    rounded.

    Examples
    --------
    >>> round(step_uncertainty(0.000977 * np.arange(100)), 6), step_uncertainty(np.arange(9) / 1e3)
    (0.000512, 0.0)
    """
    step = float(time[-1] - time[0]) / (time.size - 1)
    low, high = extreme_steps(time)
    # times from sums of a step differ only by rounding
    same_step = 1e-6
    if max(abs(low / step - 1.0), abs(high / step - 1.0)) > same_step:
        return 0.0
    digits = _digits(step)
    if digits < _FEW or _digits(1.0 / step) <= _MANY:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(step)) - digits + 1)
    share = 0.5 * unit / step
    # accuracy of a crystal clock
    crystal = 5e-5
    return share if share > crystal else 0.0


def _digits(value: float) -> int:
    """Return the number of significant digits of a number, within rounding."""
    return next(
        (n for n in range(1, 9) if abs(float(f"{value:.{n - 1}e}") / value - 1.0) < 1e-9), 9
    )


def require_uniform(record: Record) -> None:
    """Refuse a record whose samples are not evenly spaced in time."""
    if not record.uniform:
        mend = "use the option resample, resampled(record) in Python, or"
        if _is_rounded(record.time):
            mend = "they are uniform except for the rounding of the times:"
        raise RecordError(
            f"the samples of '{record.source or 'the record'}' are not evenly spaced: steps "
            f"differ from their mean by up to {100.0 * time_jitter(record.time):.3g} %; {mend} "
            f"give the sample rate instead of the time{_mean_rate(record.time)}"
        )


def _is_rounded(time: Array) -> bool:
    """Return whether times are uniform except for the rounding of their digits."""
    # number of samples that distinguishes rounded uniform times from non-uniform ones
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
    """Return a record at uniform times, by interpolation.

    Parameters
    ----------
    record : Record
        A record without gaps.
    sample_rate_hz : float, optional
        The new sample rate [Hz]; by default the mean rate of the record.
    kind : {"linear", "cubic", "mean"}
        Linear interpolation, a cubic spline, or the mean of linear interpolation over each new
        step.

    Returns
    -------
    Record
        The same columns from the first time to the last, with a note; means are at the middle of
        their steps.

    Validity
    --------
    Interpolation is no anti-aliasing filter: at a lower rate, content above half the new rate
    aliases, except with means. Linear interpolation attenuates a sine of f by up to (pi f /
    rate)^2 / 2, a mean by (pi f / rate)^2 / 6, a spline far less with more than about 5 samples per
    period; a spline overshoots at a step.

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
    # the last sample is included if it is on a new time within rounding
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
    """Return a record with non-uniform samples at uniform times, at most at their rate.

    Linear interpolation adds no turning point, unlike a spline; at a lower rate each sample is the
    mean over its step.

    Parameters
    ----------
    record : Record
        A record without gaps.
    sample_rate_hz : float, optional
        The new sample rate [Hz]; by default the reciprocal of the median step.

    Returns
    -------
    Record
        The same columns, with a note on the loss of accuracy.

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
    # a rate with few digits may be a little above that of the samples
    finest = 1.05
    if rate * usual > finest:
        raise RecordError(
            f"'{record.source or 'the record'}' cannot be resampled at {rate:g} Hz, as its sample "
            f"rate is {1.0 / usual:.6g} Hz: give this rate or a lower one"
        )
    coarse = rate * usual < _COARSE
    uniform = resampled(record, rate, kind="mean" if coarse else "linear")
    deviation = steps - usual
    # frequency at which interpolation and means attenuate a sine by 1 %
    slow = np.sqrt(0.01 / (usual**2 / 2.0 + coarse / (6.0 * rate**2))) / np.pi
    rms, largest = float(np.std(deviation)), float(np.abs(deviation).max())
    # turning points are anywhere in an averaged step
    late = float(np.hypot(rms, 0.1 * coarse / rate))
    loss = (
        f"steps of time differ from their median by {100.0 * rms / usual:.3g} % rms and up to "
        f"{100.0 * largest / usual:.3g} %; the uncertainty of a delay is about "
        f"{readable('s', late, digits=2)}, and motion above {slow:.3g} Hz is attenuated by more "
        "than 1 %"
    )
    return replace(uniform, notes=(*record.notes, f"{uniform.notes[-1]}: {loss}"))


#: Accepted names of a column of times.
TIME_NAMES = frozenset(("t", "time", "times", "timestamp", "zeit", "x_value"))
# largest relative difference of two statements of a sample rate, by their printed digits
_SAME_RATE = 0.01


def timed(
    raw: FileColumns,
    channels: list[Channel],
    time_column: str | int | None,
    rate: float | None,
    largest_step: float,
) -> tuple[list[Channel], NDArray[np.float64], list[str]]:
    """Return the channels with the time column in seconds, the times, and notes on their source.

    `largest_step` is the longest step that is no gap, over the median step.
    """
    require_rate(rate)
    names = [c.name for c in channels]
    if time_column is not None:
        number = column_and_unit(names, time_column)[0]
        raw.require_numbers(number)
        channels[number], notes = _as_seconds(channels[number])
        times = channels[number].values
        require_rising(times, names[number], largest_step)
        stated = rate if rate is not None else raw.sample_rate_hz
        where = "given" if rate is not None else f"in {raw.rate_source}"
        _require_same_rate(times, stated, names[number], where)
        return channels, times, notes + _unevenness(times) + _coarseness(times)
    size = channels[0].values.size
    file_rate = raw.sample_rate_hz
    if rate is not None and file_rate is not None and abs(file_rate / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the given sample rate, {rate:g} Hz, conflicts with {raw.rate_source} of the file, "
            f"{file_rate:g} Hz: omit or correct it"
        )
    candidates = [
        i
        for i, c in enumerate(channels)
        if (c.name.lower() in TIME_NAMES and c.unit in ("s", ""))
        # a column without a name but with a unit
        or (c.name == f"column {i}" and c.unit == "s")
    ]
    sure = [i for i in candidates if channels[i].unit == "s"]
    if rate is not None or file_rate is not None:
        used = rate if rate is not None else file_rate
        assert used is not None
        for i in sure:
            if np.isfinite(channels[i].values).all():
                _require_same_rate(channels[i].values, used, names[i], "given")
        source = "as given" if rate is not None else f"from {raw.rate_source} of the file"
        start = raw.start if file_rate is not None else 0.0
        times = start + np.arange(size) / used
        notes = [f"sample rate {used:g} Hz, {source}"]
        return channels, times, notes if rate is not None else notes + _coarseness(times)
    number = _own_time(names, sure)
    if number is not None:
        raw.require_numbers(number)
        times = channels[number].values
        require_rising(times, names[number], largest_step)
        notes = [f"times from column '{names[number]}'", *_unevenness(times), *_coarseness(times)]
        return channels, times, notes
    raise RecordError(_no_time(raw, names, candidates))


def _own_time(names: Sequence[str], sure: Sequence[int]) -> int | None:
    """Return the only column of time, or the only one called "time" among several."""
    exact = [i for i in sure if names[i] == "time"]
    candidates = exact or list(sure)
    return candidates[0] if len(candidates) == 1 else None


def _no_time(raw: FileColumns, names: Sequence[str], candidates: Sequence[int]) -> str:
    hint = raw.hint
    several = [name for name in names if name.startswith(f"{X_VALUE} of ")]
    if several:
        hint = (
            "; its channels have different times: select one by the option time, such as "
            f"'{several[0]}'"
        )
    if candidates and not hint:
        listed = " or ".join(f"'{names[i]}'" for i in candidates)
        hint = f"; column {listed} may be the time: select it by the option time"
    return (
        "the file has no times of its samples: give the sample rate, or the column of time "
        f"(columns: {', '.join(f'{i}: {n}' for i, n in enumerate(names[:20]))}){hint}"
    )


def _as_seconds(channel: Channel) -> tuple[Channel, list[str]]:
    """Return the selected time column, in seconds."""
    if channel.unit == "":
        return replace(channel, unit="s"), [
            f"times from column '{channel.name}', without unit: assumed in seconds"
        ]
    if channel.unit != "s":
        raise RecordError(
            f"column '{channel.name}' is in {channel.unit}, and cannot be the time: select "
            "another, or give its unit, s or ms"
        )
    return channel, [f"times from column '{channel.name}'"]


def _require_same_rate(
    times: NDArray[np.float64], rate: float | None, name: str, where: str
) -> None:
    if rate is None or times.size < 2:
        return
    span = float(times[-1] - times[0])
    mean_rate = (times.size - 1) / span if span > 0.0 else np.inf
    if abs(mean_rate / rate - 1.0) > _SAME_RATE:
        raise RecordError(
            f"the sample rate {rate:g} Hz ({where}) conflicts with the times in column '{name}', "
            f"whose mean rate is {mean_rate:g} Hz: omit one, or give the unit of the time (s or ms)"
        )


def _unevenness(times: NDArray[np.float64]) -> list[str]:
    jitter = time_jitter(times)
    if jitter <= 1e-3:
        return []
    return [f"steps of time differ from their mean by up to {100.0 * jitter:.3g} %"]


def _coarseness(times: NDArray[np.float64]) -> list[str]:
    """Return a note on the range of rates for a step of few digits."""
    share = step_uncertainty(times) if times.size > 1 else 0.0
    if share == 0.0:
        return []
    step = float(times[-1] - times[0]) / (times.size - 1)
    low, high = 1.0 / step / (1.0 + share), 1.0 / step / (1.0 - share)
    return [
        f"the step of time, {step:.4g} s, has so few digits that the sample rate is between "
        f"{low:.6g} and {high:.6g} Hz, and every frequency uncertain by {100.0 * share:.2g} %: "
        "give the rate by the option sample-rate"
    ]
