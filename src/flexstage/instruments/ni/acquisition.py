"""An NI card with a stage as an instrument: sensors, drives behind amplifiers, one clock."""

import math
from collections.abc import Mapping
from contextlib import suppress

from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.ni.outputs import NiOutputs
from flexstage.instruments.ni.recorder import NiRecorder
from flexstage.instruments.ni.setup import DriveOutput, NiBackend, NiSetup
from flexstage.instruments.protocol import Capability, Identity, Instrument, MotionAxis
from flexstage.instruments.ramp import to_safe, wait_for_rest
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits, stage_limits


class NiAxis(MotionAxis):
    """An axis whose drive an analogue output commands, without position control."""

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
    """An NI card, the sensors and drives wired to it, and the stage that they belong to.

    Inputs and outputs share one clock. The first sensor is sampled at the instant at which the
    output of the same number changes, so that a stage without delay shows it one sample of the
    card's clock later; where a multiplexer leads the inputs to one converter, each further sensor
    is sampled one conversion later, which `settings` says. Connecting moves nothing; the outputs
    are read back where the card can. `close` leads the drives to their safe voltages, unless the
    setup says not to, since a card goes on giving what it gave. `limits` are further ones by axis,
    at the drive, beside those of the stage, the card and the amplifier.

    Validity: open loop; the sensors have no filter against aliasing but their own; the voltages
    of a record are those that were commanded and not measured.
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
        found = {d.axis: _limits(d, stage, (limits or {}).get(d.axis)) for d in setup.outputs}
        self._recorder = NiRecorder(backend, setup, self._card)
        self.outputs = NiOutputs(backend, setup, found, self._recorder)
        self._axes = {d.axis: NiAxis(self, d, found[d.axis]) for d in setup.outputs}
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
                f"no drive is wired to card '{self.setup.device}', so that it runs no waveforms: "
                "name its analogue outputs"
            )
        return self.outputs

    def channel(self, number: int) -> float:
        if not 1 <= number <= len(self.setup.inputs):
            raise ModelError(
                f"card '{self.setup.device}' has the sensors 1 to {len(self.setup.inputs)}, got "
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
            f"an NI card does not strike axis '{axis}': wire the hammer to an input, record now, "
            "and strike by hand"
        )

    def pause(self, seconds: float) -> None:
        self._backend.pause(seconds)

    def wait(self, timeout: float = 30.0) -> None:
        """Wait until nothing runs; stop it on time-out."""
        wait_for_rest(self, self.outputs.running, timeout, "a waveform still ran")

    def stop(self) -> None:
        self.outputs.stop()

    def settings(self) -> Mapping[str, str]:
        found = {"driver": self._card.note, "output rate": f"{self.setup.output_rate_hz:g} Hz"}
        for k, s in enumerate(self.setup.inputs):
            low, high = s.voltage_range
            found[f"sensor {s.name}"] = (
                f"{s.channel} ({s.terminal}, {low:g} to {high:g} V), {s.gain:.9g} {s.unit}/V, "
                f"{s.offset:.9g} {s.unit} at 0 V{_delay(k, self._recorder.interval)}"
            )
        begins = "read back" if self.outputs.readable else "assumed, this card cannot read it back"
        for d in self.setup.outputs:
            found[f"drive {d.axis}"] = (
                f"{d.channel}, amplifier {d.gain:.9g} V/V, {d.offset:.9g} V at 0 V; "
                f"{self.outputs.began[d.axis]:.4g} V when connected ({begins})"
            )
        return found

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
    """Say when a sensor is sampled, by its place in the scan and the time between conversions."""
    if place == 0 or interval == 0.0:
        return ""
    if math.isnan(interval):
        return ", sampled after the first sensor by a time that the driver does not report"
    return f", sampled {1e6 * place * interval:.3g} us after the first sensor"


def _limits(drive: DriveOutput, stage: Stage | None, more: AxisLimits | None) -> AxisLimits:
    found = AxisLimits(voltage=drive.drive_range)
    if more is not None:
        found = more.within(found)
    if stage is None:
        return found
    own = stage_limits(stage, drive.axis)
    if own.voltage is None and (more is None or more.voltage is None):
        raise ModelError(
            f"the drive of axis '{drive.axis}' of stage '{stage.name}' has no voltage range, so "
            "that no output can be limited for it: give one in the stage file, or as 'limits'"
        )
    return own.within(found)
