"""One axis of a stage as it answers a slow command: stroke, hysteresis, steps, backlash."""

import math
from typing import TYPE_CHECKING

import numpy as np

from flexstage.characteristic import measured_value
from flexstage.errors import ModelError
from flexstage.stage import PiezoStack, Screw, Stage

if TYPE_CHECKING:
    from flexstage.hysteresis import HysteresisModel

#: Steps of a converter over the stroke.
_CONVERTER = 2**16
#: Range of voltage where the stage does not say: the hysteresis does not depend on it.
_VOLTAGE = (0.0, 120.0)
#: How far the slope of a move is from that of the whole loop, over the width of the loop [1].
_SLOPE_SPREAD = 1.6


class VirtualAxis:
    """An axis that is moved from command to command.

    Commands go half of the stroke to each side, in steps of `quantum` [m], 0 where there is none.
    The motion of a piezo is in proportion to the free displacement of its `stack` over the range of
    `voltage`; without a stack the axis follows its commands. `backlash` is the play on turning back
    [m], `hysteresis` the standard uncertainty of a move as a share of its length.
    """

    def __init__(
        self,
        name: str,
        stroke: float,
        quantum: float,
        *,
        stack: "HysteresisModel | None" = None,
        voltage: tuple[float, float] = _VOLTAGE,
        backlash: float = 0.0,
        hysteresis: float = 0.0,
    ) -> None:
        if not 0.0 < stroke < math.inf:
            raise ModelError(f"the stroke of axis '{name}' must be positive, got {stroke!r} m")
        if not (0.0 <= quantum < stroke and 0.0 <= backlash < stroke):
            raise ModelError(
                f"step and backlash of axis '{name}' must be 0 or more and less than its stroke, "
                f"got {quantum!r} and {backlash!r} m"
            )
        self.name = name
        self.half = 0.5 * stroke
        self.quantum = quantum
        self.hysteresis = hysteresis
        self.backlash = backlash
        self._stack = stack
        self._voltage = voltage
        self._play = 0.0
        if stack is not None:
            low, high = voltage
            # two whole cycles, as a stage is exercised before use; it comes to rest at the low end
            before = stack.simulate([high, low, high, low])
            self._state = before.state
            ends = before.values[2:]
            self._zero, self._gain = float(ends.mean()), stroke / float(ends[0] - ends[1])

    def settable(self, command: float) -> float:
        """Return the nearest command within the stroke that can be set [m]."""
        inside = min(max(command, -self.half), self.half)
        if self.quantum == 0.0:
            return inside
        steps = round(inside / self.quantum)
        # the last step before the end, where the end itself is none
        most = math.floor(self.half / self.quantum * (1.0 + 1e-12))
        return min(max(steps, -most), most) * self.quantum

    def move(self, command: float) -> float:
        """Move to a command that can be set, on a straight ramp; return the displacement [m]."""
        if self._stack is None:
            half = 0.5 * self.backlash
            self._play = max(command - half, min(command + half, self._play))
            return self._play
        low, high = self._voltage
        volts = 0.5 * (low + high) + 0.5 * (high - low) * command / self.half
        self._state, free = self._stack.step(self._state, volts)
        return self._gain * (free - self._zero)


def open_loop_axis(stage: Stage, axis: str, quantum: float | None, backlash: float) -> VirtualAxis:
    """Return an axis that is commanded by its drive, without a sensor.

    `quantum` is the step of the commands [m]: where None, that of a converter of 16 bits, or of the
    screw. `backlash` is at the output [m].
    """
    drive = stage.drive(stage.axis(axis).drive)
    stroke = _stroke(stage, axis)
    if isinstance(drive, Screw):
        step = drive.smallest_step * stroke / drive.travel if quantum is None else quantum
        return VirtualAxis(axis, stroke, step, backlash=backlash)
    if not isinstance(drive, PiezoStack):
        raise ModelError(
            f"axis '{axis}' of {stage.name} must be driven by a screw or a piezo stack to be "
            f"simulated, got {drive.kind}"
        )
    if backlash:
        raise ModelError("a piezo stack has hysteresis and no backlash: leave the backlash out")
    from flexstage.hysteresis.virtual_stack import USUAL_LOOP_WIDTH, virtual_stack

    measured = measured_value(stage.published, "hysteresis_loop_width", axis)
    share = USUAL_LOOP_WIDTH if measured is None else measured / stroke
    voltage = _VOLTAGE if drive.voltage_range is None else drive.voltage_range
    return VirtualAxis(
        axis,
        stroke,
        stroke / _CONVERTER if quantum is None else quantum,
        stack=virtual_stack(voltage, drive.free_stroke, share),
        voltage=voltage,
        hysteresis=_SLOPE_SPREAD * share,
    )


def closed_loop_axis(stage: Stage, axis: str, quantum: float | None) -> VirtualAxis:
    """Return an axis that a position sensor and a controller make follow its commands.

    `quantum` is the step of the commands [m], that of a converter of 16 bits where None.
    """
    stroke = _stroke(stage, axis)
    return VirtualAxis(axis, stroke, stroke / _CONVERTER if quantum is None else quantum)


def _stroke(stage: Stage, axis: str) -> float:
    """Stroke that was measured and is published, else that of the lumped model."""
    known = measured_value(stage.published, "output_displacement", axis)
    if known is not None:
        return known
    from flexstage.lumped import lumped_system
    from flexstage.system import static_displacements

    port = stage.axis(axis)
    stroke = stage.drive(port.drive).stroke
    if stroke is None:
        raise ModelError(
            f"the drive of axis '{axis}' of {stage.name} has no stroke: it cannot be simulated"
        )
    solution = static_displacements(lumped_system(stage), {port.drive: stroke})
    return abs(float(np.float64(solution.readings[port.probe])))
