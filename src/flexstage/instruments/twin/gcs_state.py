"""What a GCS controller knows beside its device, and shares between its clients."""

import copy
import math
from collections.abc import Iterator, Mapping

from flexstage.instruments.servo import ServoSettings
from flexstage.instruments.twin import errors_gcs as code
from flexstage.instruments.twin.clock import Pace
from flexstage.instruments.twin.controller import VirtualController
from flexstage.instruments.twin.controller_models import OWN, ControllerModel
from flexstage.instruments.twin.device import AxisDescription
from flexstage.instruments.twin.errors_gcs import GcsError
from flexstage.instruments.twin.record_store import RecordStore
from flexstage.instruments.twin.servo_parameters import ServoDraft
from flexstage.instruments.twin.wave_store import WaveStore

#: Micrometres, and microradians, of the wire in SI.
MICRO = 1e-6

Range = tuple[float, float]


class ControllerState:
    """State of a controller that is shared by all its clients."""

    def __init__(self, device: VirtualController, pace: Pace, model: ControllerModel = OWN) -> None:
        self.device, self.pace, self.model = device, pace, model
        #: Where it is reached.
        self.host, self.port = "127.0.0.1", 0
        #: How often motion was stopped.
        self.stops = 0
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
        #: Narrower limits that clients have set, by axis [m], [V].
        self.soft_positions: dict[str, Range] = {}
        self.soft_voltages: dict[str, Range] = {}
        #: Outputs that take commands; axes that are switched off; axes on their way to zero; speeds
        #: of axes without control of speed [m/s]; axes with compensation of drift.
        self.online = dict.fromkeys(self.outputs, True)
        self.disabled: set[str] = set()
        self.zeroing: set[str] = set()
        self.free_speeds: dict[str, float] = {}
        self.drift_compensation = dict.fromkeys(self.axes, False)
        #: Start mode of each wave generator; settings of the digital outputs, by line and number.
        self.start_modes = dict.fromkeys(self.generators, 0)
        self.trigger_points: dict[tuple[int, int], bool] = {}
        self.trigger_settings: dict[tuple[int, int], str] = {}

    # positions ------------------------------------------------------------------------------

    def position_range(self, axis: str) -> tuple[float, float]:
        """Return the reachable positions of an axis [m]; wide open where it says none."""
        return self.axes[axis].limits.position or (-1.0, 1.0)

    def voltage_range(self, axis: str) -> tuple[float, float]:
        """Return the voltages of an axis [V]; both 0 where it has none."""
        return self.axes[axis].limits.voltage or (0.0, 0.0)

    def require_ready(self, targets: Mapping[str, float], *, voltages: bool = False) -> None:
        """Refuse a motion of axes that take none, or beyond limits that clients have set."""
        limits = self.soft_voltages if voltages else self.soft_positions
        offline = {self.outputs[name] for name, on in self.online.items() if not on}
        for axis, value in targets.items():
            if axis in self.disabled:
                raise GcsError(code.SWITCHED_OFF)
            if axis in offline:
                raise GcsError(code.NOT_POSSIBLE)
            low, high = limits.get(axis, (-math.inf, math.inf))
            if not low <= value <= high and math.isfinite(value):
                raise GcsError(code.VOLTAGE_OUT_OF_LIMITS if voltages else code.OUT_OF_LIMITS)

    # position control -----------------------------------------------------------------------

    def servo_draft(self, axis: str) -> ServoDraft:
        """Return the settings of an axis's position control as numbers that can be changed."""
        settings = self.device.servo(axis)
        draft, gave = self._drafts.get(axis, (None, None))
        # they may have been changed beside this conversation
        return ServoDraft(settings) if draft is None or gave != settings else copy.deepcopy(draft)

    def apply_draft(self, axis: str, draft: ServoDraft) -> None:
        """Change the settings of an axis's position control."""
        settings = draft.settings()
        settings.sections(self.device.sample_rate_hz)
        self.device.set_servo_settings(axis, settings)
        self._drafts[axis] = draft, self.device.servo(axis)

    # time -----------------------------------------------------------------------------------

    def pass_time(self, seconds: float) -> Iterator[str]:
        """Let simulated time [s] pass in pieces, between which other clients are heard."""
        left = seconds
        while left > 0.0:
            piece = min(left, 0.05)
            with self.pace.lock:
                self.pace.pass_time(piece)
            left -= piece
            yield ""
