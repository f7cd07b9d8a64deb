"""Two axes of an instrument as the positioner that carries an encoder scale."""

import math

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.head_averaging import against_reference
from flexstage.centring.rotary_table import CentreReading, table_reading
from flexstage.centring.virtual_table import VirtualTable
from flexstage.choose import has_no
from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting, axis_setting, estimated_stroke
from flexstage.experiments.command import prepare_loops
from flexstage.instruments.protocol import Capability, Instrument, MotionAxis
from flexstage.instruments.ramp import lead_to
from flexstage.stage import Stage

#: Readings that are averaged, a millisecond apart: one period of the mains.
_READINGS = 20
#: Uncertainty of a move in open loop, as a share of its length; of one under control [1].
_OPEN, _CLOSED = 0.05, 1e-4
#: Smallest move of an axis with a piezo stack [m].
_RESOLUTION = 5e-9
_ORDERS = range(1, 25)


class InstrumentPositioner:
    """Two axes of an instrument, commanded in metres from the middle of their ranges.

    Notes
    -----
    Validity: in open loop a command in metres is a share of the estimated stroke, and hysteresis is
    part of the uncertainty of a move.
    """

    def __init__(
        self,
        instrument: Instrument,
        stage: Stage,
        axes: tuple[str, str],
        channels: tuple[int, int],
        *,
        closed_loop: bool,
    ) -> None:
        self._instrument, self._channels = instrument, channels
        self._axes = [_AxisOf(instrument, stage, a, closed_loop) for a in axes]
        self._position = (0.0, 0.0)
        self.middle = np.zeros(2)

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest command of each axis [m]."""
        x, y = self._axes
        return (-x.half, x.half), (-y.half, y.half)

    @property
    def position(self) -> tuple[float, float]:
        """The last command [m]."""
        return self._position

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty with which an axis takes a command [m]."""
        x, y = self._axes
        return x.resolution, y.resolution

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length [1]."""
        x, y = self._axes
        return x.share, y.share

    @property
    def backlash(self) -> tuple[float, float]:
        """Play of each axis on turning back; every command is approached from below [m]."""
        return 0.0, 0.0

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest commands within the limits that can be set."""
        first, second = (a.settable(c) for a, c in zip(self._axes, (x, y), strict=True))
        return first, second

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes."""
        self._position = self.settable(x, y)
        for axis, command in zip(self._axes, self._position, strict=True):
            axis.go(command)
        return self._position

    def to_middle(self) -> None:
        """Go to the middle of both ranges, and take what the sensors read there for zero."""
        self.move_to(*(-a.half for a in self._axes))
        self.move_to(0.0, 0.0)
        self.middle = np.zeros(2)
        self.middle = self.reading()

    def reading(self) -> Array:
        """Return where the sensors see the platform, from the middle [m], shape (2,)."""
        found = np.zeros(2)
        for _ in range(_READINGS):
            found += [self._instrument.channel(number) for number in self._channels]
            self._instrument.pause(1e-3)
        return found / _READINGS - self.middle


class _AxisOf:
    """One axis: commands in metres from the middle, sent as positions or voltages."""

    def __init__(self, instrument: Instrument, stage: Stage, name: str, closed: bool) -> None:
        if name not in instrument.axes:
            raise PlanError(has_no("the instrument", "axis", name, instrument.axes))
        self._instrument, self.name = instrument, name
        self._axis: MotionAxis = instrument.axes[name]
        can = Capability.CLOSED_LOOP in self._axis.capabilities
        voltage = self._axis.limits.voltage is not None
        self._setting: AxisSetting = axis_setting(
            stage, name, closed_loop=closed and can, limits=self._axis.limits
        )
        self._by_position = self._setting.quantity == "position"
        prepare_loops(instrument, [name], self._setting.quantity)
        span = self._setting.high - self._setting.low
        # what a metre is in the unit of the command
        self._scale = 1.0 if self._by_position else span / estimated_stroke(stage, name)
        self.half = 0.5 * span / self._scale
        step = self._setting.smallest_step
        self._quantum = step or 0.0
        self.resolution = 0.5 * step if step else _RESOLUTION
        self.share = _CLOSED if self._by_position or not voltage else _OPEN

    def settable(self, command: float) -> float:
        inside = min(max(command, -self.half), self.half)
        if not self._quantum:
            return inside
        steps = round(inside / self._quantum)
        most = int(self.half / self._quantum)
        return min(max(steps, -most), most) * self._quantum

    def go(self, command: float) -> None:
        middle = 0.5 * (self._setting.low + self._setting.high)
        value = min(max(middle + self._scale * command, self._setting.low), self._setting.high)
        if self._by_position:
            self._axis.move_to(value)
        else:
            lead_to(self._instrument, {self.name: value}, "voltage", time=0.2)


class ScaleBench:
    """A simulated table, whose scale is carried by the stage of an instrument."""

    def __init__(self, table: VirtualTable, positioner: InstrumentPositioner, angle: float) -> None:
        self._table, self._positioner = table, positioner
        c, s = math.cos(angle), math.sin(angle)
        self._turn = np.array([[c, -s], [s, c]])
        self.true_lengths: list[float] = []

    def measure(self) -> CentreReading:
        """Turn the table and return the eccentricity of the scale."""
        x, y = self._turn @ self._positioner.reading()
        moved = self._table.moved(float(x), float(y))
        angle, *errors = (c.values for c in moved.record(index=len(self.true_lengths)).channels)
        self.true_lengths.append(float(np.hypot(*moved.apparent_eccentricity)))
        found = against_reference(angle, np.stack(errors), heads=self._table.heads, orders=_ORDERS)
        return table_reading(found, self._table.radius)
