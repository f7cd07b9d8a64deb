"""Motion of a simulated controller: targets, voltages, position control."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from flexstage.instruments.servo import ServoSettings

__all__ = ["MotionDevice"]


class MotionDevice(Protocol):
    """Motion and position control, as a server of commands sees them."""

    def servo_on(self, axis: str) -> bool:
        """Say whether position control is on.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        bool
            Whether it is so.
        """
        ...

    def set_servo(self, axis: str, on: bool) -> None:
        """Switch position control, without a jump.

        Parameters
        ----------
        axis : str
            The axis.
        on : bool
            Whether it shall be on.
        """
        ...

    def target(self, axis: str) -> float:
        """Return the position that is commanded [m].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def set_targets(self, targets: Mapping[str, float]) -> None:
        """Command positions [m] of one or more axes: all of them or none.

        Parameters
        ----------
        targets : Mapping
            Positions [m] by axis.
        """
        ...

    def command(self, axis: str) -> float:
        """Return the voltage that is commanded in open loop [V].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """Command voltages [V] in open loop of one or more axes: all of them or none.

        Parameters
        ----------
        commands : Mapping
            Voltages [V] by axis.
        """
        ...

    def speed(self, axis: str) -> float:
        """Return the speed of moves [m/s].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def set_speed(self, axis: str, speed: float) -> None:
        """Set the speed of moves [m/s].

        Parameters
        ----------
        axis : str
            The axis.
        speed : float
            The speed [m/s].
        """
        ...

    def largest_speed(self, axis: str) -> float:
        """Return the largest speed of moves [m/s].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def position(self, axis: str) -> float:
        """Return what the axis's own sensor reads now [m].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def voltage(self, axis: str) -> float:
        """Return the voltage at the drive now [V].

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        float
            The value.
        """
        ...

    def on_target(self, axis: str) -> bool:
        """Say whether the axis has come to its target and stays there.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        bool
            Whether it is so.
        """
        ...

    def moving(self, axis: str) -> bool:
        """Say whether the axis is being moved, by a command or a waveform.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        bool
            Whether it is so.
        """
        ...

    def channel(self, number: int) -> float:
        """Return what a sensor reads now [m, or rad].

        Parameters
        ----------
        number : int
            Number of the channel.

        Returns
        -------
        float
            The value.
        """
        ...

    def stop(self, axes: Sequence[str] | None = None) -> None:
        """Stop motion and waveforms at once; the axes hold where they are.

        Parameters
        ----------
        axes : sequence of str, optional
            The axes; all where not given.
        """
        ...

    def servo(self, axis: str) -> ServoSettings:
        """Return the settings of the position control.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        ServoSettings
            The settings.
        """
        ...

    def set_servo_settings(self, axis: str, settings: ServoSettings) -> None:
        """Change them.

        Parameters
        ----------
        axis : str
            The axis.
        settings : ServoSettings
            The settings.
        """
        ...
