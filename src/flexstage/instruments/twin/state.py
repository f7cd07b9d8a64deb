"""What a GCS controller knows beside its device, and shares between its clients."""

import copy
from collections.abc import Iterator

from flexstage.instruments.servo import ServoSettings
from flexstage.instruments.twin.clock import Pace
from flexstage.instruments.twin.device import AxisDescription, Device
from flexstage.instruments.twin.record_store import RecordStore
from flexstage.instruments.twin.servo_draft import ServoDraft
from flexstage.instruments.twin.wave_store import WaveStore

__all__ = ["MICRO", "ControllerState"]

#: Micrometres, and microradians, of the wire in SI.
MICRO = 1e-6


class ControllerState:
    """State of a controller that is shared by all its clients.

    Parameters
    ----------
    device : Device
        The device.
    pace : Pace
        How its time passes; its lock is held while this state is used.
    """

    def __init__(self, device: Device, pace: Pace) -> None:
        self.device = device
        self.pace = pace
        self.axes: dict[str, AxisDescription] = dict(device.axes)
        piezo = [name for name, axis in self.axes.items() if axis.kind == "piezo"]
        #: Axis by output channel, by wave generator; description by input channel.
        self.outputs = {str(i): name for i, name in enumerate(piezo, 1)}
        self.generators = {str(i): name for i, name in enumerate(self.axes, 1)}
        self.channels = {str(channel.number): channel for channel in device.channels}
        #: Texts of the parameters as delivered, by item and number.
        self.delivered: dict[tuple[str, int], str] = {}
        self.forget()

    def forget(self) -> None:
        """Be as when it was switched on."""
        self.waves = WaveStore(self.device)
        self.recorder = RecordStore(self.device, self.outputs)
        #: Drafts with the settings that they gave.
        self._drafts: dict[str, tuple[ServoDraft, ServoSettings]] = {}

    # positions ------------------------------------------------------------------------------

    def position_range(self, axis: str) -> tuple[float, float]:
        """Return the reachable positions of an axis.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        tuple of float
            Lowest and highest [m]; wide open for an axis that says none.
        """
        return self.axes[axis].limits.position or (-1.0, 1.0)

    def voltage_range(self, axis: str) -> tuple[float, float]:
        """Return the voltages of an axis.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        tuple of float
            Lowest and highest [V]; both 0 for an axis without voltage.
        """
        return self.axes[axis].limits.voltage or (0.0, 0.0)

    # position control -----------------------------------------------------------------------

    def servo_draft(self, axis: str) -> ServoDraft:
        """Return the settings of an axis's position control as numbers that can be changed.

        Parameters
        ----------
        axis : str
            The axis.

        Returns
        -------
        ServoDraft
            A draft of its own.
        """
        settings = self.device.servo(axis)
        draft, gave = self._drafts.get(axis, (None, None))
        # they may have been changed beside this conversation
        return ServoDraft(settings) if draft is None or gave != settings else copy.deepcopy(draft)

    def apply_draft(self, axis: str, draft: ServoDraft) -> None:
        """Change the settings of an axis's position control.

        Parameters
        ----------
        axis : str
            The axis.
        draft : ServoDraft
            The numbers.
        """
        settings = draft.settings()
        settings.sections(self.device.sample_rate_hz)
        self.device.set_servo_settings(axis, settings)
        self._drafts[axis] = draft, self.device.servo(axis)

    # time -----------------------------------------------------------------------------------

    def pass_time(self, seconds: float) -> Iterator[str]:
        """Let simulated time pass in pieces, between which other clients are heard.

        Parameters
        ----------
        seconds : float
            How long [s].

        Yields
        ------
        str
            Nothing to be sent.
        """
        left = seconds
        while left > 0.0:
            piece = min(left, 0.05)
            with self.pace.lock:
                self.pace.pass_time(piece)
            left -= piece
            yield ""
