"""When the samples of a file were taken: a given rate, the file's own, or a column of time."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import RecordError
from flexstage.records.columns import FileColumns
from flexstage.records.record import Channel, column_and_unit
from flexstage.records.sampling import (
    require_rate,
    require_rising,
    step_uncertainty,
    time_jitter,
)
from flexstage.records.text_heading import X_VALUE

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
