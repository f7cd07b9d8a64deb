"""An NI card with a stage as an instrument: sensors, drives behind amplifiers, one clock."""

import math
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, LimitError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_voltage, check_waveform
from flexstage.instruments.ni.recorder import NiRecorder
from flexstage.instruments.ni.setup import DriveOutput, NiBackend, NiSetup, OutputTask
from flexstage.instruments.protocol import (
    Capability,
    Identity,
    Instrument,
    MotionAxis,
    Waveform,
    WaveGenerator,
)
from flexstage.instruments.ramp import to_safe, wait_for_rest
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits, stage_limits

_LARGEST = 20_000_000  # samples of all drives in memory
_AGREES = 0.02  # largest difference of an output that is read back from its setting [V]


class NiOutputs(WaveGenerator):
    """The drives of a card, and the generator of their waveforms.

    During a record they use the clock of the recorder, which is informed of their voltages. Each
    query whether a waveform runs also reads new samples of the record; reading outputs back ends
    the record.
    """

    def __init__(
        self,
        backend: NiBackend,
        setup: NiSetup,
        limits: Mapping[str, AxisLimits],
        recorder: NiRecorder,
    ) -> None:
        self._backend, self._setup, self._limits = backend, setup, limits
        self._recorder = recorder
        recorder.busy = self.busy
        self.base_rate_hz, self.capacity = setup.output_rate_hz, _LARGEST
        self._drives: dict[str, DriveOutput] = {d.axis: d for d in setup.outputs}
        self._standing = {d.axis: d.begins_at for d in setup.outputs}
        self._lock = threading.RLock()
        self._task: OutputTask | None = None
        self._running: dict[str, Array] = {}
        self._loaded: Waveform | None = None
        self._stopped = False
        self.readable = False  # whether the card can read its outputs back
        if setup.outputs:
            self._look()
        self.began = dict(self._standing)  # voltages at the drives when connected [V]

    # the generator of waveforms -----------------------------------------------------------------

    def load(self, waveform: Waveform, *, feedforward: Waveform | None = None) -> None:
        if waveform.quantity != "voltage" or feedforward is not None:
            raise ModelError(
                f"card '{self._setup.device}' has no position control: give voltages only, without "
                "feedforward"
            )
        check_waveform(self._limits, waveform)
        self._loaded = waveform

    def start(self, cycles: int = 1) -> None:
        wave = self._loaded
        if wave is None:
            raise ControllerError("no waveform was loaded: load one first")
        if cycles < 1:
            raise LimitError(f"a waveform of a card needs at least 1 cycle, got {cycles}")
        if self.running():
            raise ControllerError("a waveform is running: wait for its end, or stop it")
        here = {name: self.voltage(name) for name in wave.values}
        check_waveform(self._limits, wave, cycles=cycles, start=here)
        self._put(lambda rate: _sampled(wave, cycles, rate))

    def running(self) -> bool:
        running = self.busy()
        self._recorder.drain()
        self._recorder.rest()
        return running

    def busy(self) -> bool:
        """Return whether a waveform runs, without reading the record."""
        with self._lock:
            if self._task is None:
                return False
            if self._task.done():
                self._finish()
                return False
            return True

    def stop(self) -> None:
        self._stopped = True
        task = self._task
        with suppress(ControllerError, NotConnectedError):
            if task is not None:  # before the lock, which another thread may hold
                task.stop()
            with self._lock:
                self._finish()

    # single voltages ----------------------------------------------------------------------------

    def voltage(self, axis: str) -> float:
        """Return the voltage of a drive [V]; NaN where it is unknown.

        After a stop it is read back from the card, which ends a running record.
        """
        with self._lock:
            if self.busy() and self._task is not None and axis in self._running:
                n = min(self._task.generated(), self._running[axis].size)
                return float(self._running[axis][n - 1]) if n > 0 else self._standing[axis]
            if math.isnan(self._standing[axis]) and self.readable:
                self._read_back()
            return self._standing[axis]

    def set_voltage(self, axis: str, voltage: float) -> None:
        """Set the voltage of a drive [V], by a ramp where a step would pass the slew limit."""
        limits = self._limits[axis]
        check_voltage(limits, voltage, axis)
        if self.running():
            raise ControllerError(
                f"a waveform is running: axis '{axis}' accepts no voltage until it ends"
            )
        here = self.voltage(axis)
        if not math.isfinite(here):
            raise ControllerError(
                f"the voltage of axis '{axis}' is unknown since its output was stopped, and this "
                "card cannot read it back: measure it, and give it as 'standing' when you connect "
                "again"
            )
        self._stopped = False
        step = abs(voltage - here)
        if limits.slew is None or step * self._setup.output_rate_hz <= limits.slew:
            drive = self._drives[axis]
            self._backend.write_now([drive], np.array([float(drive.output(np.array(voltage)))]))
            self._standing[axis] = float(voltage)
            self._recorder.note_voltages({axis: np.array([float(voltage)])}, False)
            return
        slew = limits.slew
        self._put(lambda rate: {axis: _ramp(here, float(voltage), slew / rate)}, ramp=True)
        waited, most = 0.0, 2.0 * step / slew + 5.0
        while self.running():
            if waited > most:
                self.stop()
                raise ControllerError(f"the ramp of axis '{axis}' did not end: it was stopped")
            self._backend.pause(0.002)
            waited += 0.002

    def close(self) -> None:
        """Stop and release the outputs; they keep their voltages."""
        self.stop()

    def _put(self, samples_at: Callable[[float], dict[str, Array]], *, ramp: bool = False) -> None:
        self._stopped = False
        source = self._recorder.clock()
        # A ramp does not start a record that waits for a waveform.
        if ramp and source is not None and not source[1]:
            source = None
        clock = None if source is None else source[0]
        rate = self._setup.output_rate_hz if clock is None else clock.rate_hz
        values = samples_at(rate)
        if (size := sum(v.size for v in values.values())) > _LARGEST:
            raise LimitError(
                f"the waveform has {size} samples at {rate:g} Hz, and the limit is {_LARGEST}: run "
                "fewer cycles at a time"
            )
        drives = [self._drives[name] for name in values]
        volts = np.array([d.output(v) for d, v in zip(drives, values.values(), strict=True)])
        waits = source is not None and not source[1]
        with self._lock:
            task = self._backend.open_output(drives, volts, rate, clock=clock)
            self._task, self._running = task, values
            task.start()
        self._recorder.note_voltages(values, waits)
        if self._stopped:
            raise ControllerError("the waveform was stopped before it started")
        if waits and clock is not None:
            clock.start()

    def _finish(self) -> None:
        """Close the task; the drives are at its last sample, or at an unknown one after a stop."""
        task, self._task = self._task, None
        if task is None:
            return
        values, self._running = self._running, {}
        try:
            complete, n = task.done(), task.generated()
            task.close()
        except (ControllerError, NotConnectedError):
            complete, n = False, -1
        for axis, v in values.items():
            if complete:
                self._standing[axis] = float(v[-1])
            elif n != 0:  # the outputs may be behind the counted samples
                self._standing[axis] = math.nan
        self._tell_standing()

    def _look(self) -> None:
        """Compare the voltages of the outputs with the setup, before the first command."""
        volts = self._backend.read_outputs(self._setup.outputs)
        self.readable = bool(np.all(np.isfinite(volts)))
        for drive, v in zip(self._setup.outputs, volts, strict=True):
            if not abs(v - float(drive.output(np.array(drive.begins_at)))) > _AGREES:
                continue
            measured = float(drive.voltage(v))
            if drive.standing is not None:
                raise ControllerError(
                    f"output '{drive.channel}' is at {v:.4g} V, which is {measured:.4g} V at the "
                    f"drive of axis '{drive.axis}', but the setup says {drive.standing:g} V: omit "
                    "'standing', or correct the gain or offset of the amplifier"
                )
            self._standing[drive.axis] = measured
        self._tell_standing()

    def _read_back(self) -> None:
        """Measure the drives whose voltages are unknown."""
        lost = [d for d in self._setup.outputs if math.isnan(self._standing[d.axis])]
        self._recorder.release()
        for drive, v in zip(lost, self._backend.read_outputs(lost), strict=True):
            self._standing[drive.axis] = float(drive.voltage(v))
        self._tell_standing()

    def _tell_standing(self) -> None:
        self._recorder.note_voltages(
            {axis: np.array([v]) for axis, v in self._standing.items()}, False
        )


def _sampled(wave: Waveform, cycles: int, rate: float) -> dict[str, Array]:
    """Return a waveform at another rate, interpolated linearly, up to its last sample."""
    n, ratio = wave.size, wave.sample_rate_hz / rate
    count = math.floor((n * cycles - 1) / ratio * (1.0 + 1e-12)) + 1
    k = np.arange(count) * ratio
    # The last sample is that of the waveform, even if the rates do not match.
    k = np.minimum(np.append(k, n * cycles - 1) if k[-1] < n * cycles - 1 else k, n * cycles - 1)
    at = np.arange(n + 1)
    return {a: np.interp(k % n, at, np.append(v, v[0])) for a, v in wave.values.items()}


def _ramp(begin: float, end: float, step: float) -> Array:
    """Return steps no larger than allowed, up to the end."""
    count = max(math.ceil(abs(end - begin) / step), 1)
    return np.linspace(begin, end, count + 1)[1:]


class NiAxis(MotionAxis):
    """An axis with its drive at an analogue output, without position control."""

    capabilities = frozenset({Capability.OPEN_LOOP})

    def __init__(self, owner: "NiAcquisition", drive: DriveOutput, limits: AxisLimits) -> None:
        self._owner, self._drive, self._limits = owner, drive, limits
        self.name = drive.axis

    @property
    def limits(self) -> AxisLimits:
        return self._limits

    def position(self) -> float:
        return self._owner.channel(self._owner.setup.number(self._drive.sensor))

    def voltage(self) -> float:
        return self._owner.outputs.voltage(self.name)

    def set_voltage(self, voltage: float) -> None:
        self._owner.outputs.set_voltage(self.name, voltage)

    def moving(self) -> bool:
        return self._owner.waves.running()

    def wait(self, timeout: float = 30.0) -> None:
        self._owner.wait(timeout)


class NiAcquisition(Instrument):
    """An NI card with its sensors and drives, and their stage.

    Inputs and outputs share one clock. The first sensor is sampled at the instant at which the
    output of the same number changes, so that a stage without delay responds one sample of the
    card's clock later. With a multiplexer, each further sensor is sampled one conversion later,
    which `settings` reports. Connecting does not move the stage; the outputs are read back where
    the card supports it. `close` ramps the drives to their safe voltages, unless the setup forbids
    it: otherwise a card keeps its output voltages. `limits` are further limits by axis, at the
    drive, in addition to those of the stage, the card and the amplifier.

    Validity: open loop; no anti-aliasing filter other than those of the sensors; the voltages of a
    record are commanded, not measured.
    """

    def __init__(
        self,
        setup: NiSetup,
        backend: NiBackend,
        *,
        stage: Stage | None = None,
        limits: Mapping[str, AxisLimits] | None = None,
    ) -> None:
        self.setup, self._backend = setup, backend
        self._card = backend.describe(setup)
        self.identity = Identity(
            vendor=self._card.vendor,
            model=self._card.model,
            serial_number=self._card.serial_number,
            simulated=self._card.simulated,
        )
        axis_limits = {d.axis: _limits(d, stage, (limits or {}).get(d.axis)) for d in setup.outputs}
        self._recorder = NiRecorder(backend, setup, self._card)
        self.outputs = NiOutputs(backend, setup, axis_limits, self._recorder)
        self._axes = {d.axis: NiAxis(self, d, axis_limits[d.axis]) for d in setup.outputs}
        self._closed = False

    @property
    def capabilities(self) -> frozenset[Capability]:
        waves = {Capability.WAVE_GENERATOR} if self._axes else set()
        return super().capabilities | {Capability.DATA_RECORDER, Capability.CHANNELS} | waves

    @property
    def axes(self) -> Mapping[str, NiAxis]:
        return self._axes

    @property
    def recorder(self) -> NiRecorder:
        return self._recorder

    @property
    def waves(self) -> NiOutputs:
        if not self._axes:
            raise ModelError(
                f"card '{self.setup.device}' has no drives, so it cannot run waveforms: name its "
                "analogue outputs"
            )
        return self.outputs

    def channel(self, number: int) -> float:
        if not 1 <= number <= len(self.setup.inputs):
            raise ModelError(
                f"card '{self.setup.device}' has sensors 1 to {len(self.setup.inputs)}, got "
                f"{number}"
            )
        self._recorder.rest()
        latest = self._recorder.latest()
        sensor = self.setup.inputs[number - 1]
        if latest is not None:
            return float(sensor.reading(latest[number - 1]))
        return float(sensor.reading(self._backend.read_now([sensor])[0]))

    def strike(self, axis: str) -> None:
        raise ModelError(
            f"an NI card cannot excite axis '{axis}' with a hammer: connect the hammer to an "
            "input, start a record, and excite by hand"
        )

    def pause(self, seconds: float) -> None:
        self._backend.pause(seconds)

    def wait(self, timeout: float = 30.0) -> None:
        """Wait until no waveform runs; stop it on timeout."""
        wait_for_rest(self, self.outputs.running, timeout, "a waveform still ran")

    def stop(self) -> None:
        self.outputs.stop()

    def settings(self) -> Mapping[str, str]:
        texts = {"driver": self._card.note, "output rate": f"{self.setup.output_rate_hz:g} Hz"}
        for k, s in enumerate(self.setup.inputs):
            low, high = s.voltage_range
            texts[f"sensor {s.name}"] = (
                f"{s.channel} ({s.terminal}, {low:g} to {high:g} V), {s.gain:.9g} {s.unit}/V, "
                f"{s.offset:.9g} {s.unit} at 0 V{_delay(k, self._recorder.interval)}"
            )
        begins = "read back" if self.outputs.readable else "assumed, this card cannot read it back"
        for d in self.setup.outputs:
            texts[f"drive {d.axis}"] = (
                f"{d.channel}, amplifier {d.gain:.9g} V/V, {d.offset:.9g} V at 0 V; "
                f"{self.outputs.began[d.axis]:.4g} V when connected ({begins})"
            )
        return texts

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self.outputs.stop()
        try:
            if self.setup.lead_to_safe:
                to_safe(self)
        finally:
            with suppress(ControllerError, NotConnectedError):
                self._recorder.release()
            self._backend.close()


def _delay(place: int, interval: float) -> str:
    """Return the sampling delay of a sensor as text, by its place in the scan."""
    if place == 0 or interval == 0.0:
        return ""
    if math.isnan(interval):
        return ", sampled after the first sensor by a time that the driver does not report"
    return f", sampled {1e6 * place * interval:.3g} us after the first sensor"


def _limits(drive: DriveOutput, stage: Stage | None, further: AxisLimits | None) -> AxisLimits:
    allowed = AxisLimits(voltage=drive.drive_range)
    if further is not None:
        allowed = further.within(allowed)
    if stage is None:
        return allowed
    of_stage = stage_limits(stage, drive.axis)
    if of_stage.voltage is None and (further is None or further.voltage is None):
        raise ModelError(
            f"the drive of axis '{drive.axis}' of stage '{stage.name}' has no voltage range, which "
            "its output needs as a limit: give one in the stage file, or as 'limits'"
        )
    return of_stage.within(allowed)
