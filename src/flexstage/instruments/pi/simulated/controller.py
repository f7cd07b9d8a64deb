"""A simulated controller with its stage, in simulated time; its recorder and its test bench."""

from fractions import Fraction
from typing import Literal

import numpy as np

from flexstage import __version__
from flexstage.arrays import Array
from flexstage.instruments.pi.simulated.controller_motion import ControllerMotion
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.protocol import Identity, Signal
from flexstage.virtual.stage import VirtualStage

_KINDS = ("position", "target", "voltage", "channel", "force", "response")


class VirtualController(ControllerMotion):
    """A controller of a stage that is simulated: axes, control, waveforms and a recorder.

    Everything is SI and in simulated time. The axes are ``1``, ``2`` ... in the order of the
    stage's; tables, channels and records are numbered from 1. Time passes only by `advance`; in
    which portions it passes makes no difference to any sample. A command acts with the next sample
    of the loop. What a client says wrong is refused by a `RefusedError` with its reason, nothing
    else, and nothing has changed then.

    A piezo axis has arrived within 20 nm of its target for 5 ms; of a screw the window is its
    smallest step. A recording goes on until its tables are full, as long as nobody
    stops the motion that started it; at a slower rate nothing is averaged.

    Notes
    -----
    Moves are straight ramps at the speed of the axis, without a limit of acceleration, as piezo
    controllers make them: the corners of an open-loop ramp ring at the first mode of the stage.
    Signals are recorded at the instant at which they are there, without the delays inside a real
    controller. One thread at a time: a server holds a lock while it uses it.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.virtual.build import virtual_stage
    >>> device = VirtualController(virtual_stage(design("vgtu-piezo"), model="lumped", seed=2))
    >>> device.set_servo("1", True)
    >>> device.set_targets({"1": 20e-6})
    >>> device.advance(0.5)
    >>> device.on_target("1"), round(device.position("1") * 1e6)
    (True, 20)
    """

    def __init__(self, stage: VirtualStage, *, serial_number: str = "") -> None:
        super().__init__(stage)
        self._identity = Identity(
            vendor="flexstage",
            model=f"simulated {stage.stage.name}",
            serial_number=serial_number,
            firmware=__version__,
            simulated=True,
        )

    @property
    def identity(self) -> Identity:
        """What it is: it says that it is simulated."""
        return self._identity

    @property
    def record_tables(self) -> int:
        """Number of tables of the recorder."""
        return self._recorder.count

    @property
    def record_capacity(self) -> int:
        """Samples of each of them."""
        return self._recorder.capacity

    def record_signal(self, table: int) -> Signal | None:
        """Return what a table records; None for nothing."""
        return self._recorder.signals.get(self._recorder.known(table))

    def set_record_signal(self, table: int, signal: Signal | None) -> None:
        """Choose what a table records, from the next recording on; None for nothing.

        The `source` of a signal is the identifier of an axis or the number of a channel.
        """
        self._recorder.known(table)
        if signal is not None:
            self._require_signal(signal)
        self._recorder.choose(table, signal)

    def record_divider(self) -> int:
        """Return how many samples of the loop one sample of a record lasts."""
        return self._recorder.divider

    def set_record_divider(self, divider: int) -> None:
        """Set how many samples of the loop one sample of a record lasts."""
        self._recorder.set_divider(divider)

    def arm_recorder(self, trigger: Literal["wave", "move", "now"]) -> None:
        """Start recording with the next waveform or blow, the next move, or now.

        What was recorded before can be read until then.
        """
        if trigger not in ("wave", "move", "now"):
            raise RefusedError(
                Refusal.BAD_VALUE, f"a recording starts with wave, move or now, got {trigger!r}"
            )
        self._recorder.arm(trigger)
        if trigger == "now":
            self._recorder.trigger("now", self._sample + 1)

    def recorded(self) -> int:
        """Return the number of samples that are there, the same for every table."""
        return self._recorder.recorded

    def recording(self) -> bool:
        """Say whether samples are still to come; not while it waits for its trigger."""
        return self._recorder.recording

    def record(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, from number `first`, counted from 0."""
        return self._recorder.read(table, first, count)

    def drives_removed(self) -> bool:
        """Say whether the drives are taken out, so that the stage can be struck."""
        return self._drives_out

    def remove_drives(self, removed: bool) -> None:
        """Take the drives out, or put them back; no axis may move or be under control."""
        for name, state in self._states.items():
            if state.moving(self._sample):
                reason = Refusal.WAVE_RUNNING if state.wave is not None else Refusal.NOT_ABLE
                raise RefusedError(
                    reason, f"axis '{name}' moves: let it come to rest before drives are handled"
                )
            if state.servo and not state.screw:
                raise RefusedError(
                    Refusal.SERVO_ON,
                    f"the control of axis '{name}' is on: switch it off before drives are handled",
                )
        self._drives_out = bool(removed)

    def strike(self, axis: str) -> None:
        """Strike the stage with a hammer; a recorder armed for a waveform records it.

        The record begins a little before the blow. Force and answer have a rate of their own and
        are resampled, without a change within their band, to that of the record: above half of
        the lower of both there is nothing in it. They come in as simulated time passes. The answer
        is that along the axis that was struck; of another axis nothing is recorded but zeros.
        """
        state = self._axis(axis)
        if not self._drives_out:
            raise RefusedError(
                Refusal.NOT_ABLE, "take the drives out before the stage is struck with a hammer"
            )
        blow = self.stage.strike(state.description.stage_axis)
        rate = self.sample_rate_hz / self._recorder.divider
        force = resampled(blow.force, blow.sample_rate_hz, rate)
        response = resampled(blow.response, blow.sample_rate_hz, rate)

        def samples(kind: str, source: str) -> Array:
            if kind == "force":
                return force
            return response if source == axis else np.zeros_like(response)

        self._recorder.trigger("wave", self._sample + 1, samples)

    def _require_signal(self, signal: Signal) -> None:
        if signal.kind not in _KINDS:
            raise RefusedError(
                Refusal.UNKNOWN,
                f"nothing of the kind '{signal.kind}' is recorded: it is one of "
                f"{', '.join(_KINDS)}",
            )
        if signal.kind == "channel":
            numbers = {str(c.number) for c in self.stage.channels}
            if signal.source not in numbers:
                raise RefusedError(
                    Refusal.UNKNOWN,
                    f"there is no channel '{signal.source}': they are 1 to {len(numbers)}",
                )
        elif signal.kind == "voltage":
            self._piezo(signal.source)
        else:
            self._axis(signal.source)


def resampled(values: Array, from_hz: float, to_hz: float) -> Array:
    """Return a decaying record at another rate, by its Fourier series; the first sample stays.

    Notes
    -----
    What lies below half of both rates is kept as it is, and what lies above is left out. Validity:
    a record that does not begin and end at 0 rings at its ends.

    Examples
    --------
    >>> t = np.arange(512) / 512.0
    >>> pulse = np.exp(-0.5 * ((t - 0.4) / 0.02) ** 2)
    >>> finer = resampled(pulse, 512.0, 800.0)
    >>> finer.size, round(float(finer[320]), 6)
    (800, 1.0)
    """
    ratio = Fraction(to_hz / from_hz).limit_denominator(10**5)
    # whole periods at both rates: zeros behind the record
    padded = np.zeros(-(-values.size // ratio.denominator) * ratio.denominator)
    padded[: values.size] = values
    size = padded.size * ratio.numerator // ratio.denominator
    spectrum = np.fft.rfft(padded)
    kept = np.zeros(size // 2 + 1, dtype=np.complex128)
    below = (min(padded.size, size) + 1) // 2  # what is below both Nyquist frequencies
    kept[:below] = spectrum[:below]
    out = np.fft.irfft(kept, n=size) * (size / padded.size)
    return out[: max(1, int(values.size * ratio))]
