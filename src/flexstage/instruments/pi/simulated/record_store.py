"""Configuration and records of the data recorder of a controller."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import Refusal, require
from flexstage.instruments.protocol import Signal

#: SI value of micrometres and microradians.
_MICRO = 1e-6


@dataclass(frozen=True, slots=True)
class RecordOption:
    """A record option of the data recorder."""

    kind: str
    """Kind of the signal."""
    text: str
    """Text in the list."""
    source: str
    """Kind of its source."""
    unit: str
    """SI unit; that of the sensor for a channel."""


#: Record options by number; those from 200 exist only on the simulated controller.
RECORD_OPTIONS = {
    1: RecordOption("target", "Target Position of axis", "axis", "m"),
    2: RecordOption("position", "Current Position of axis", "axis", "m"),
    3: RecordOption("error", "Position Error of axis", "axis", "m"),
    7: RecordOption("voltage", "Control Voltage of output chan", "output", "V"),
    20: RecordOption("channel", "Sensor mech.linear of input chan", "channel", ""),
    200: RecordOption("force", "Hammer Force [N] at axis", "axis", "N"),
    201: RecordOption("response", "Response to Impact [m/s^2] of axis", "axis", "m/s^2"),
}
_OPTION_OF = {option.kind: number for number, option in RECORD_OPTIONS.items()}


class RecordStore:
    """Tables of the recorder with the numbers and units of the controller.

    `outputs` is the axis by output channel, `scale` the SI value of the unit of positions.
    """

    def __init__(
        self,
        device: VirtualController,
        axes: Iterable[str],
        outputs: Mapping[str, str],
        scale: float,
    ) -> None:
        self._device, self._axes, self._outputs, self._scale = device, axes, outputs, scale
        self._units = {str(channel.number): channel.unit for channel in device.channels}
        #: The trigger option, and the number of tables in use.
        self.trigger = 0
        self.tables = device.recorder.count
        #: Signals of the last record, by table, and its sample interval [s].
        self.recorded_signals: dict[int, Signal] = {}
        self.sample_step = 0.0
        self._by_client = False

    def sources(self, option: RecordOption) -> Iterable[str]:
        """Return the possible sources of an option."""
        known = {"axis": self._axes, "output": self._outputs, "channel": self._units}
        return tuple(known[option.source])

    def title(self, signal: Signal) -> str:
        """Return the title of a recorded signal: its option and its source."""
        option, source = RECORD_OPTIONS[_OPTION_OF[signal.kind]], signal.source
        if option.source == "output":
            source = next(k for k, axis in self._outputs.items() if axis == source)
        return f"{option.text} {source}"

    def signal(self, source: str, number: int) -> Signal | None:
        """Return the signal of a source and an option."""
        if number == 0:
            return None
        require(number in RECORD_OPTIONS, Refusal.UNKNOWN_RECORD_OPTION)
        option = RECORD_OPTIONS[number]
        require(source in self.sources(option), Refusal.UNKNOWN_RECORD_SOURCE)
        unit = option.unit
        if option.source == "output":
            source = self._outputs[source]
        elif option.source == "channel":
            unit = self._units[source]
        return Signal(kind=option.kind, source=source, name=f"{option.kind} {source}", unit=unit)

    def choose(self, table: int, signal: Signal | None) -> None:
        """Select the signal of a table; its record is deleted.

        A running record ends, so that the next one has the selected signals in all tables.
        """
        self._device.arm_recorder("wave")
        self._device.set_record_signal(table, signal)
        self.recorded_signals.pop(table, None)

    def use(self, tables: int) -> None:
        """Set the number of tables in use; the other tables record nothing."""
        require(1 <= tables <= self._device.recorder.count, Refusal.BAD_VALUE)
        for table in range(tables + 1, self._device.recorder.count + 1):
            self.choose(table, None)
        self.tables = tables

    def column(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table in `recorded_signals`, counted from 0, in units of the answer.

        These are the unit of positions, um and urad for sensors, V, N, or m/s^2.
        """
        values = np.array(self._device.recorder.read(table, first, count), dtype=np.float64)
        if self.recorded_signals[table].unit in ("m", "rad"):
            values /= _MICRO if self.recorded_signals[table].kind == "channel" else self._scale
        return values

    def move(self, command: Callable[[], None]) -> None:
        """Command a motion, which starts the recorder if this trigger is selected.

        Each motion restarts it, even while it still records the previous one.
        """
        command()
        if self.trigger == 1:
            self.now(by_client=False)

    def run(self, command: Callable[[], None]) -> None:
        """Start a waveform, or a hammer impact, which starts the recorder.

        A record that a client has started itself is not interrupted.
        """
        armed = not (self._by_client and self._device.recorder.recording)
        if armed:
            self._device.arm_recorder("wave")
        command()
        if armed:
            self._keep(by_client=False)

    def set_trigger(self, trigger: int) -> None:
        """Select the trigger of the recorder; a running record ends.

        The last record can be read until the next start, but only with the default trigger. With
        other triggers the tables are empty until the start, so that old data are not taken for new.
        """
        self.trigger = trigger
        self._by_client = False
        self._device.arm_recorder("wave")
        if trigger:
            self.recorded_signals = {}
        if trigger == 4:
            self.now()

    def now(self, *, by_client: bool = True) -> None:
        """Start the recorder."""
        self._device.arm_recorder("now")
        self._keep(by_client=by_client)

    def _keep(self, *, by_client: bool) -> None:
        """Note the signals and the rate of the record that has started."""
        if self._device.recorder.recording:
            tables = range(1, self._device.recorder.count + 1)
            signals = {table: self._device.recorder.signal(table) for table in tables}
            self.recorded_signals = {
                table: signal for table, signal in signals.items() if signal is not None
            }
            self.sample_step = self._device.recorder.divider / self._device.sample_rate_hz
            self._by_client = by_client
