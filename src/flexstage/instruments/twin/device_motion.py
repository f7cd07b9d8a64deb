"""Motion of a simulated controller: targets, voltages, position control."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from flexstage.instruments.servo import ServoSettings


class MotionDevice(Protocol):
    """Motion and position control, as a server of commands sees them."""

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

    def largest_speed(self, axis: str) -> float:
        """Return the largest speed of moves [m/s]."""
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

    def servo(self, axis: str) -> ServoSettings:
        """Return the settings of the position control."""
        ...

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change them."""
        ...
