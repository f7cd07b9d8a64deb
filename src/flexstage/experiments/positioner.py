"""Two axes of an instrument as the positioner that carries an encoder scale."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.move import Positioner, PositionerAxis
from flexstage.choose import has_no
from flexstage.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting, axis_setting, estimated_stroke
from flexstage.experiments.command import prepare_loops
from flexstage.instruments.protocol import Capability, Instrument
from flexstage.instruments.ramp import lead_to
from flexstage.stage import Stage

#: Readings that are averaged, a millisecond apart: one period of the mains.
_READINGS = 20
#: Uncertainty of a move in open loop, as a share of its length; of one under control [1].
_OPEN, _CLOSED = 0.05, 1e-4
#: Smallest move of an axis with a piezo stack [m].
_RESOLUTION = 5e-9


class InstrumentPositioner(Positioner):
    """Two axes of an instrument, commanded in metres from the middle of their ranges.

    A table below them is turned by `angle` [rad]. Every command is approached from below, so that
    there is no backlash.

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
        angle: float,
    ) -> None:
        self._instrument, self._channels = instrument, channels
        self._axes = [_instrument_axis(instrument, stage, a, closed_loop) for a in axes]
        super().__init__(self._axes)
        c, s = math.cos(angle), math.sin(angle)
        self._turn = np.array([[c, -s], [s, c]])
        self._middle = np.zeros(2)

    def _go(self, command: tuple[float, float]) -> None:
        for axis, value in zip(self._axes, command, strict=True):
            axis.go(value)

    def to_middle(self) -> None:
        """Go to the middle of both ranges, and take what the sensors read there for zero."""
        self.move_to(*(-a.half for a in self._axes))
        self.move_to(0.0, 0.0)
        self._middle = self._reading()

    def _reading(self) -> Array:
        """Where the sensors see the platform [m], shape (2,)."""
        found = np.zeros(2)
        for _ in range(_READINGS):
            found += [self._instrument.channel(number) for number in self._channels]
            self._instrument.pause(1e-3)
        return found / _READINGS

    @property
    def true_position(self) -> Array:
        """Where the sensors see the platform, from the middle, on the table [m], shape (2,)."""
        return self._turn @ (self._reading() - self._middle)


@dataclass(kw_only=True)
class _InstrumentAxis(PositionerAxis):
    """One axis: commands in metres from the middle, sent as positions or voltages."""

    instrument: Instrument
    setting: AxisSetting
    scale: float
    """What a metre is in the unit of the command."""

    def go(self, command: float) -> None:
        low, high = self.setting.low, self.setting.high
        value = min(max(0.5 * (low + high) + self.scale * command, low), high)
        if self.setting.quantity == "position":
            self.instrument.axes[self.name].move_to(value)
        else:
            lead_to(self.instrument, {self.name: value}, "voltage", time=0.2)


def _instrument_axis(
    instrument: Instrument, stage: Stage, name: str, closed_loop: bool
) -> _InstrumentAxis:
    if name not in instrument.axes:
        raise PlanError(has_no("the instrument", "axis", name, instrument.axes))
    axis = instrument.axes[name]
    can = Capability.CLOSED_LOOP in axis.capabilities
    setting = axis_setting(stage, name, closed_loop=closed_loop and can, limits=axis.limits)
    prepare_loops(instrument, [name], setting.quantity)
    by_position = setting.quantity == "position"
    span, step = setting.high - setting.low, setting.smallest_step
    scale = 1.0 if by_position else span / estimated_stroke(stage, name)
    return _InstrumentAxis(
        name=name,
        half=0.5 * span / scale,
        quantum=step or 0.0,
        resolution=0.5 * step if step else _RESOLUTION,
        hysteresis=_CLOSED if by_position or axis.limits.voltage is None else _OPEN,
        instrument=instrument,
        setting=setting,
        scale=scale,
    )
