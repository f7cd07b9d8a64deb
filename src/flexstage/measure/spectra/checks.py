"""Options of frequency responses, and checks of the records."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.records import Record, saturation, step_uncertainty
from flexstage.records.sampling import extreme_steps, require_complete, require_uniform

Excitation = Literal["auto", "random", "periodic", "hammer", "step", "sweep"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HitOptions:
    """Detection and segmentation of hammer hits or steps."""

    trigger: float = 0.1
    """Trigger level, as a share of the maximum of the record [1]."""
    pre_trigger: int | None = None
    """Samples before the trigger that belong to the hit; by default a little more than the duration
    of the contact.
    """
    bounce: float = 0.05
    """Level of a second contact, as a share of the peak, that makes a double hit [1]."""
    exponential: float | None = None
    """Value of an exponential window at the end of a hit [1]; no window if not given, as for a
    motion that has decayed by then.
    """

    def __post_init__(self) -> None:
        shares = {"trigger": self.trigger, "bounce": self.bounce, "exponential": self.exponential}
        for name, share in shares.items():
            if share is not None and not 0.0 < share < 1.0:
                raise ModelError(f"{name} must be a share between 0 and 1, got {share!r}")
        if self.pre_trigger is not None and self.pre_trigger < 0:
            raise ModelError(f"samples before a hit must be 0 or more, got {self.pre_trigger}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodOptions:
    """Segmentation of the periods of a periodic excitation."""

    samples: int | None = None
    """Samples per period; estimated if not given."""
    drop: int | None = None
    """Settling periods to omit at the start; estimated if not given."""

    def __post_init__(self) -> None:
        if self.samples is not None and self.samples < 8:
            raise ModelError(f"a period must have at least 8 samples, got {self.samples}")
        if self.drop is not None and self.drop < 0:
            raise ModelError(f"the number of omitted periods must be 0 or more, got {self.drop}")


@dataclass(slots=True, kw_only=True, eq=False)
class Extremes:
    """Minimum and maximum of a channel, and the blocks that contain them."""

    low: float = np.inf
    """The minimum, in the unit of the channel."""
    high: float = -np.inf
    """The maximum, in the unit of the channel."""
    at_low: list[tuple[int, int]] = field(default_factory=list)
    """Start and stop of each block with the minimum."""
    at_high: list[tuple[int, int]] = field(default_factory=list)
    """Start and stop of each block with the maximum."""

    def update(self, values: Array, start: int, stop: int) -> None:
        """Include a block of the channel."""
        piece = values[start:stop]
        low, high = float(np.min(piece)), float(np.max(piece))
        if not (np.isfinite(low) and np.isfinite(high)):
            self.low = self.high = np.nan
        if low <= self.low:
            self.at_low = [*self.at_low, (start, stop)] if low == self.low else [(start, stop)]
            self.low = low
        if high >= self.high:
            self.at_high = [*self.at_high, (start, stop)] if high == self.high else [(start, stop)]
            self.high = high

    def rests(self, values: Array) -> bool:
        """Return whether the channel stays at an extreme for several consecutive samples.

        Only then it is examined further.
        """
        # least number of consecutive samples of a clipped channel
        run = 3
        for level, places in ((self.low, self.at_low), (self.high, self.at_high)):
            for start, stop in places:
                same = values[max(start - run, 0) : stop + run] == level
                if same.size >= run and np.any(same[2:] & same[1:-1] & same[:-2]):
                    return True
        return False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals:
    """Channels of one or several records, inputs before outputs."""

    channels: tuple[tuple[Array, ...], ...]
    """Samples by record and channel, each of shape (n of the record,)."""
    start: tuple[float, ...]
    """Time of the first sample of each record [s]."""
    names: tuple[str, ...]
    """Names of the channels."""
    units: tuple[str, ...]
    """Units of the channels."""
    inputs: int
    """Number of inputs."""
    sample_rate_hz: float
    """Sample rate [Hz]."""
    sources: tuple[str, ...]
    """Name of each record in messages."""
    rate_uncertainty: float
    """Standard uncertainty of the sample rate over it [1], by the digits of the times."""

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return len(self.names) - self.inputs

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of samples of each record."""
        return tuple(c[0].size for c in self.channels)


def gather_signals(
    records: Sequence[Record], inputs: Sequence[str | int], outputs: Sequence[str | int]
) -> Signals:
    """Return the channels of records, after a check that they match."""
    if not records or not inputs or not outputs:
        raise RecordError("a frequency response needs at least a record, an input and an output")
    first = records[0]
    selected = [first.channel(c) for c in (*inputs, *outputs)]
    names, units = tuple(c.name for c in selected), tuple(c.unit for c in selected)
    for i, channel in enumerate(selected):
        if any(channel is other for other in selected[:i]):
            raise RecordError(
                f"column '{channel.name}' is given twice: each input or output needs its own column"
            )
    rows, sources = [], []
    # largest relative difference between the rates of averaged records
    same_rate = 1e-6
    for number, record in enumerate(records, start=1):
        source = f"'{record.source}'" if record.source else f"record {number}"
        _require_uniform_time(record, source)
        if abs(record.sample_rate_hz / first.sample_rate_hz - 1.0) > same_rate:
            raise RecordError(
                f"averaged records need equal sample rates: {source} has "
                f"{record.sample_rate_hz:.9g} Hz, the first {first.sample_rate_hz:.9g} Hz; make "
                "them equal with resampled(record, rate)"
            )
        row = [record.channel(c) for c in (*inputs, *outputs)]
        for channel, name, unit in zip(row, names, units, strict=True):
            if channel.unit != unit:
                raise RecordError(
                    f"'{name}' is in '{unit}' in the first record and '{channel.name}' in "
                    f"'{channel.unit}' in {source}: averaged records need equal units"
                )
        rows.append(tuple(c.values for c in row))
        sources.append(source)
    return Signals(
        channels=tuple(rows),
        start=tuple(float(r.time[0]) for r in records),
        names=names,
        units=units,
        inputs=len(inputs),
        sample_rate_hz=first.sample_rate_hz,
        sources=tuple(sources),
        # all rates within the resolution of the digits are equally likely
        rate_uncertainty=max(step_uncertainty(r.time) for r in records) / math.sqrt(3.0),
    )


def _require_uniform_time(record: Record, source: str) -> None:
    if record.over != "time":
        raise RecordError(
            f"{source} is a record over {record.over}, not over time: a frequency response is "
            "estimated from samples in time; use response_from_record for one over frequency"
        )
    low, high = extreme_steps(record.time)
    # the criterion of Record.uniform; the error has more details
    if high - low > 1e-3 / record.sample_rate_hz:
        require_uniform(record)


def require_sound(
    signals: Signals, extremes: Sequence[Sequence[Extremes]], *, allow_clipped: bool = False
) -> None:
    """Refuse channels that are constant, clipped or not finite.

    The extremes are by record and channel.
    """
    for row, ends, source in zip(signals.channels, extremes, signals.sources, strict=True):
        for values, end, name in zip(row, ends, signals.names, strict=True):
            if not (np.isfinite(end.low) and np.isfinite(end.high)):
                require_complete(values, name)
            if end.low == end.high:
                raise RecordError(
                    f"column '{name}' of {source} is constant, {end.low:g}: is the sensor "
                    "connected, and is it the right column?"
                )
            if allow_clipped or not end.rests(values):
                continue
            cut = saturation(values)
            if cut.clipped:
                at, count = (cut.high, cut.at_high) if cut.clipped_high else (cut.low, cut.at_low)
                raise RecordError(
                    f"column '{name}' of {source} is clipped at {at:g}, in {count} of its "
                    f"{values.size} samples: measure again in a wider range, or pass allow_clipped "
                    "if the signal itself rests there"
                )


def all_extremes(signals: Signals) -> list[list[Extremes]]:
    """Return the extremes of all channels, by record and channel."""
    extremes = []
    # samples per block, which fits in the cache
    block = 65_536
    for row in signals.channels:
        ends = [Extremes() for _ in row]
        for end, values in zip(ends, row, strict=True):
            for start in range(0, values.size, block):
                end.update(values, start, min(start + block, values.size))
        extremes.append(ends)
    return extremes
