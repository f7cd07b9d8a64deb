"""What a server of commands needs of a simulated controller, whatever protocol it speaks.

Everything is SI and in simulated time. A refusal is a `RefusedError` with its reason; the server
turns the reason into a number of its protocol. Nothing else is raised for what a client says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import FlexstageError
from flexstage.instruments.limits import AxisLimits
from flexstage.instruments.protocol import Capability, Identity, Signal
from flexstage.instruments.servo import ServoSettings

__all__ = ["AxisDescription", "ChannelDescription", "Device", "Refusal", "RefusedError"]

Array = NDArray[np.float64]


class Refusal(Enum):
    """Why a device does not do what it is told."""

    OUT_OF_LIMITS = auto()
    SERVO_OFF = auto()  # a position is asked for, and there is no position control on
    SERVO_ON = auto()  # a voltage is asked for under position control
    SPEED_OUT_OF_LIMITS = auto()
    WAVE_RUNNING = auto()
    NO_WAVE = auto()  # no table chosen, or an empty one
    TABLE_FULL = auto()
    BAD_VALUE = auto()  # a parameter outside its range
    UNKNOWN = auto()  # no such axis, channel, table or signal
    NOT_ABLE = auto()  # the axis cannot do this at all
    STOPPED = auto()  # motion was stopped by a command


class RefusedError(FlexstageError, RuntimeError):
    """A device refuses a command; nothing has changed.

    Parameters
    ----------
    reason : Refusal
        Why.
    message : str
        One sentence.
    """

    def __init__(self, reason: Refusal, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisDescription:
    """What an axis of the device is.

    Parameters
    ----------
    name : str
        Its identifier at the controller: ``1``, ``2``.
    stage_axis : str
        The axis of the stage that it moves: ``x``, ``y``.
    kind : {"piezo", "screw"}
        A piezo axis is controlled by its platform's sensor and has a voltage; a screw axis by the
        turns of its screw, and its position is the advance of the screw.
    limits : AxisLimits
        What it accepts.
    capabilities : frozenset of Capability
        What it can do.
    """

    name: str
    stage_axis: str
    kind: Literal["piezo", "screw"]
    limits: AxisLimits
    capabilities: frozenset[Capability]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelDescription:
    """A sensor of the device.

    Parameters
    ----------
    number : int
        Its number, from 1; the first ones are the sensors of the axes, in their order.
    name : str
        What it reads: ``x``, ``y``, then ``across``, ``vertical``, ``roll``, ``pitch``, ``yaw`` of
        each axis as ``x.across`` and so on.
    unit : str
        ``m`` or ``rad``.
    """

    number: int
    name: str
    unit: str


class Device(Protocol):
    """A controller with a stage, in simulated time."""

    @property
    def identity(self) -> Identity:
        """What it is."""
        ...

    @property
    def axes(self) -> Mapping[str, AxisDescription]:
        """Its axes by identifier."""
        ...

    @property
    def channels(self) -> Sequence[ChannelDescription]:
        """Its sensors, in the order of their numbers."""
        ...

    @property
    def sample_rate_hz(self) -> float:
        """Rate of its loop [Hz]."""
        ...

    @property
    def now(self) -> float:
        """Simulated time since it was switched on [s]."""
        ...

    def advance(self, seconds: float) -> None:
        """Let simulated time pass, rounded to whole samples; the rest is kept."""
        ...

    def reboot(self) -> None:
        """Switch off and on: control off, tables and settings as delivered, the stage relaxed."""
        ...

    # motion ---------------------------------------------------------------------------------

    def servo_on(self, axis: str) -> bool:
        """Say whether position control is on."""
        ...

    def set_servo(self, axis: str, on: bool) -> None:
        """Switch position control, without a jump."""
        ...

    def target(self, axis: str) -> float:
        """Return the position that is commanded [m]."""
        ...

    def set_targets(self, targets: Mapping[str, float]) -> None:
        """Command positions [m] of one or more axes: all of them or none."""
        ...

    def command(self, axis: str) -> float:
        """Return the voltage that is commanded in open loop [V]."""
        ...

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """Command voltages [V] in open loop of one or more axes: all of them or none."""
        ...

    def speed(self, axis: str) -> float:
        """Return the speed of moves [m/s]."""
        ...

    def set_speed(self, axis: str, speed: float) -> None:
        """Set the speed of moves [m/s]."""
        ...

    def position(self, axis: str) -> float:
        """Return what the axis's own sensor reads now [m]."""
        ...

    def voltage(self, axis: str) -> float:
        """Return the voltage at the drive now [V]."""
        ...

    def on_target(self, axis: str) -> bool:
        """Say whether the axis has come to its target and stays there."""
        ...

    def moving(self, axis: str) -> bool:
        """Say whether the axis is being moved, by a command or a waveform."""
        ...

    def channel(self, number: int) -> float:
        """Return what a sensor reads now [m, or rad]."""
        ...

    def stop(self, axes: Sequence[str] | None = None) -> None:
        """Stop motion and waveforms at once; the axes hold where they are."""
        ...

    # settings of the control ----------------------------------------------------------------

    def servo(self, axis: str) -> ServoSettings:
        """Return the settings of the position control."""
        ...

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change them."""
        ...

    # waveforms ------------------------------------------------------------------------------

    @property
    def wave_tables(self) -> int:
        """Number of tables."""
        ...

    @property
    def wave_capacity(self) -> int:
        """Samples over all tables."""
        ...

    def wave(self, table: int) -> Array:
        """Return the samples of a table [m or V: whichever the axis takes that runs it]."""
        ...

    def set_wave(self, table: int, samples: Array) -> None:
        """Replace the samples of a table; an empty sequence clears it."""
        ...

    def wave_rate_divider(self) -> int:
        """Return how many samples of the loop one sample of a table lasts."""
        ...

    def set_wave_rate_divider(self, divider: int) -> None:
        """Set it; straight lines join the samples."""
        ...

    def wave_choice(self, axis: str) -> tuple[int, int]:
        """Return the table of an axis and that of its feedforward, 0 for none."""
        ...

    def choose_wave(self, axis: str, table: int, feedforward: int = 0) -> None:
        """Choose them."""
        ...

    def wave_cycles(self, axis: str) -> int:
        """Return how often the waveform of an axis is run; 0 for endlessly."""
        ...

    def set_wave_cycles(self, axis: str, cycles: int) -> None:
        """Set it."""
        ...

    def start_waves(self, axes: Sequence[str]) -> None:
        """Check every sample of the chosen tables against the limits, then start all in step."""
        ...

    def stop_waves(self, axes: Sequence[str]) -> None:
        """Stop them; the axes hold where they are."""
        ...

    def wave_running(self, axis: str) -> bool:
        """Say whether a waveform runs on an axis."""
        ...

    # recorder -------------------------------------------------------------------------------

    @property
    def record_tables(self) -> int:
        """Number of tables of the recorder."""
        ...

    @property
    def record_capacity(self) -> int:
        """Samples of each of them."""
        ...

    def record_signal(self, table: int) -> Signal | None:
        """Return what a table records; None for nothing."""
        ...

    def set_record_signal(self, table: int, signal: Signal | None) -> None:
        """Choose it; `Signal.source` is the identifier of an axis or the number of a channel."""
        ...

    def record_divider(self) -> int:
        """Return how many samples of the loop one sample of a record lasts."""
        ...

    def set_record_divider(self, divider: int) -> None:
        """Set it."""
        ...

    def arm_recorder(self, trigger: Literal["wave", "move", "now"]) -> None:
        """Start recording with the next waveform or blow, the next move, or now."""
        ...

    def recorded(self) -> int:
        """Return the number of samples that are there."""
        ...

    def recording(self) -> bool:
        """Say whether the recorder runs."""
        ...

    def record(self, table: int, first: int, count: int) -> Array:
        """Return samples of a table, counted from 0."""
        ...

    # bench ----------------------------------------------------------------------------------

    def drives_removed(self) -> bool:
        """Say whether the drives are taken out, so that the stage can be struck."""
        ...

    def remove_drives(self, removed: bool) -> None:
        """Take the drives out, or put them back; the stage must be at rest and control off."""
        ...

    def strike(self, axis: str) -> None:
        """Strike the stage with a hammer; an armed recorder starts a little before the blow."""
        ...
