"""A drive record for identification, and its parts."""

from dataclasses import dataclass

from flexstage.hysteresis.model import Array
from flexstage.records.record import Channel, Record


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationPart:
    """One part of a drive record."""

    name: str
    """What it is."""
    first: int
    """Its first sample."""
    last: int
    """The sample after its last one."""
    start: float
    """Time of its first sample [s]."""
    duration: float
    """How long it takes [s]."""
    rate_hz: float
    """Rate of a major loop at its speed [Hz]."""
    voltage_range: tuple[float, float]
    """Lowest and highest voltage in it [V]."""
    turning_points: int
    """How often it turns."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation:
    """A drive record for identification, and what it asks of the amplifier."""

    time: Array
    """Time of each sample [s], shape (n,)."""
    voltage: Array
    """Command voltage [V], shape (n,)."""
    parts: tuple[ExcitationPart, ...]
    """What is run when."""
    shape: str
    """Shape of the movements."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""
    sampled_for: str
    """What the sample rate was chosen for; empty where it was given."""
    rates_hz: tuple[float, ...]
    """Rates of the major loops [Hz]."""
    rest_voltage: float
    """Voltage at which it starts and ends [V]."""
    largest_slope: float
    """Largest change of voltage between two samples, over the time between them [V/s]."""
    largest_current: float | None
    """The same times the capacitance [A]; None where that is not given."""
    rms_current: float | None
    """Root mean square of the current [A]."""
    coverage: float
    """Share of the cells of threshold and mean that are set in motion one by one, of
    `memory_coverage` [1].
    """
    left_out: tuple[str, ...]
    """What did not fit into the time."""
    warnings: tuple[str, ...]
    """What the record cannot tell, and what was changed."""

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1])

    def record(self) -> Record:
        """Return the drive signal as a record of one channel, ``voltage``."""
        channel = Channel(name="voltage", values=self.voltage, unit="V")
        return Record(channels=(channel,), time=self.time, source="flexstage excite")
