"""What an instrument says of itself, and what it is asked to record."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Capability(StrEnum):
    """Something that an instrument, or one of its axes, can do."""

    CLOSED_LOOP = "position control by a sensor"
    OPEN_LOOP = "command of the voltage"
    SERVO_TUNING = "settings of the position control can be read and written"
    WAVE_GENERATOR = "waveforms from a table"
    FEEDFORWARD_TABLE = "a table of voltages beside the position control"
    DATA_RECORDER = "records at the rate of the controller"
    CHANNELS = "further sensors can be read and recorded"
    IMPACT = "a blow of a hammer on the stage, its drives taken out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What an instrument says it is."""

    vendor: str
    """Who made it, and what it is."""
    model: str
    """Who made it, and what it is."""
    serial_number: str = ""
    """Its serial number; empty where it tells none."""
    firmware: str = ""
    """Version of its firmware."""
    simulated: bool = False
    """Whether it is a simulation, so that nothing measured with it is a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """Something that can be recorded."""

    kind: str
    """``position``, ``target``, ``voltage`` (of an axis, named by `source`), ``channel`` (a sensor,
    whose number is `source`), ``force`` and ``response`` (of a blow).
    """
    source: str
    """The axis, or the number of the channel."""
    name: str
    """What its column is called in the record."""
    unit: str = "m"
    """SI unit of the recorded values: ``m``, ``V``, ``rad``, ``N``, ``m/s^2``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMap:
    """Sensors of an instrument by what they read."""

    numbers: Mapping[str, int] = field(default_factory=dict)
    """Number of the channel by name."""
    units: Mapping[str, str] = field(default_factory=dict)
    """SI unit by name."""

    def signal(self, name: str) -> Signal:
        """Return the signal of a sensor."""
        return Signal(
            kind="channel",
            source=str(self.numbers[name]),
            name=name,
            unit=self.units.get(name, "m"),
        )
