"""What a frequency response is asked of: options, and records that are even, whole and alive."""

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
    """How hits of a hammer, or steps, are found and cut out."""

    trigger: float = 0.1
    """Level that a hit rises above, as a share of the greatest of the record [1]."""
    pre_trigger: int | None = None
    """Samples before the level that belong to the hit; where not given, some more than the contact
    lasts.
    """
    bounce: float = 0.05
    """A second contact above this share of the peak makes a double hit [1]."""
    exponential: float | None = None
    """What is left of an exponential window at the end of a hit [1]; no window where not given, as
    for a motion that has decayed by then.
    """

    def __post_init__(self) -> None:
        shares = {"trigger": self.trigger, "bounce": self.bounce, "exponential": self.exponential}
        for name, share in shares.items():
            if share is not None and not 0.0 < share < 1.0:
                raise ModelError(f"{name} is a share between 0 and 1, got {share!r}")
        if self.pre_trigger is not None and self.pre_trigger < 0:
            raise ModelError(f"samples before a hit are 0 or more, got {self.pre_trigger}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodOptions:
    """How the periods of a repeated excitation are cut out."""

    samples: int | None = None
    """Samples in a period; found where not given."""
    drop: int | None = None
    """Periods left out at the start, in which the motion settles; found where not given."""

    def __post_init__(self) -> None:
        if self.samples is not None and self.samples < 8:
            raise ModelError(f"a period has eight samples or more, got {self.samples}")
        if self.drop is not None and self.drop < 0:
            raise ModelError(f"the number of periods left out is 0 or more, got {self.drop}")


@dataclass(slots=True, kw_only=True, eq=False)
class Extremes:
    """The least and the greatest sample of a channel, and where they were met."""

    low: float = np.inf
    """The least, in the unit of the channel."""
    high: float = -np.inf
    """The greatest, in the unit of the channel."""
    at_low: list[tuple[int, int]] = field(default_factory=list)
    """First sample of each piece that holds the least, and the one behind its last."""
    at_high: list[tuple[int, int]] = field(default_factory=list)
    """First sample of each piece that holds the greatest, and the one behind its last."""

    def see(self, values: Array, start: int, stop: int) -> None:
        """Look at a piece of the channel."""
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
        """Say whether the channel stays at an end for some samples in a row.

        Only then a closer look is worth its time.
        """
        # a channel that is cut off rests at its end for so many samples
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
    """How many of them are inputs."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    sources: tuple[str, ...]
    """What each record is called in a message."""
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


def gathered(
    records: Sequence[Record], inputs: Sequence[str | int], outputs: Sequence[str | int]
) -> Signals:
    """Return the channels of records, having made sure that they belong together."""
    if not records or not inputs or not outputs:
        raise RecordError("a frequency response needs a record, an input and an output at least")
    first = records[0]
    chosen = [first.channel(c) for c in (*inputs, *outputs)]
    names, units = tuple(c.name for c in chosen), tuple(c.unit for c in chosen)
    for i, channel in enumerate(chosen):
        if any(channel is other for other in chosen[:i]):
            raise RecordError(
                f"column '{channel.name}' is named twice: an input or output is one column each"
            )
    rows, sources = [], []
    # rates of records that are averaged agree to this share
    same_rate = 1e-6
    for number, record in enumerate(records, start=1):
        source = f"'{record.source}'" if record.source else f"record {number}"
        _require_even(record, source)
        if abs(record.sample_rate_hz / first.sample_rate_hz - 1.0) > same_rate:
            raise RecordError(
                f"records that are averaged need one sample rate: {source} has "
                f"{record.sample_rate_hz:.9g} Hz, the first {first.sample_rate_hz:.9g} Hz; make "
                "them equal with resampled(record, rate)"
            )
        row = [record.channel(c) for c in (*inputs, *outputs)]
        for channel, name, unit in zip(row, names, units, strict=True):
            if channel.unit != unit:
                raise RecordError(
                    f"'{name}' is in '{unit}' in the first record and '{channel.name}' in "
                    f"'{channel.unit}' in {source}: records that are averaged need one unit"
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
        # all rates that the digits leave are as likely as the others
        rate_uncertainty=max(step_uncertainty(r.time) for r in records) / math.sqrt(3.0),
    )


def _require_even(record: Record, source: str) -> None:
    if record.over != "time":
        raise RecordError(
            f"{source} is a record over {record.over}, not over time: a frequency response is "
            "estimated from samples in time; one over frequency is taken by response_from_record"
        )
    low, high = extreme_steps(record.time)
    # the criterion of Record.uniform, of which the error then tells more
    if high - low > 1e-3 / record.sample_rate_hz:
        require_uniform(record)


def require_sound(
    signals: Signals, extremes: Sequence[Sequence[Extremes]], *, allow_clipped: bool = False
) -> None:
    """Refuse channels that are dead, cut off, or hold what is no number.

    The extremes go by record and channel.
    """
    for row, ends, source in zip(signals.channels, extremes, signals.sources, strict=True):
        for values, end, name in zip(row, ends, signals.names, strict=True):
            if not (np.isfinite(end.low) and np.isfinite(end.high)):
                require_complete(values, name)
            if end.low == end.high:
                raise RecordError(
                    f"column '{name}' of {source} never changes from {end.low:g}: is its sensor "
                    "connected, and the column the right one?"
                )
            if allow_clipped or not end.rests(values):
                continue
            cut = saturation(values)
            if cut.clipped:
                at, count = (cut.high, cut.at_high) if cut.clipped_high else (cut.low, cut.at_low)
                raise RecordError(
                    f"column '{name}' of {source} is cut off at {at:g}, where {count} of its "
                    f"{values.size} samples rest: measure again in a wider range, or pass "
                    "allow_clipped where the signal itself rests there"
                )


def all_extremes(signals: Signals) -> list[list[Extremes]]:
    """Return the least and greatest samples of all channels, by record and channel."""
    found = []
    # channels are looked through in pieces of so many samples, which stay in the cache
    piece = 65_536
    for row in signals.channels:
        ends = [Extremes() for _ in row]
        for end, values in zip(ends, row, strict=True):
            for start in range(0, values.size, piece):
                end.see(values, start, min(start + piece, values.size))
        found.append(ends)
    return found
