"""Verb *excite*: the design of a command of one axis or two."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import LimitError, PlanError
from flexstage.experiments.axis_limits import AxisSetting, axis_setting
from flexstage.experiments.command import BASE_RATE_HZ, Command, CommandWaveform, require_size
from flexstage.experiments.verb import (
    PlanContext,
    PlanLookup,
    PlannedMotion,
    PlannedStep,
    ResultLookup,
    RunContext,
    StepResult,
    Verb,
)
from flexstage.files.plain import picked
from flexstage.files.ranges import Range, require_ranges
from flexstage.instruments.limits import check_waveform
from flexstage.instruments.protocol import Waveform
from flexstage.stage.limits import AxisLimits

#: Smallest positive value.
TINY = 1e-12
SOME = Range(low=TINY, high=1e6)
NONE_OR_SOME = Range(low=0.0, high=1e6)
#: Fraction of the largest slew or speed that commands use.
OF_RATE = 0.8
#: Smallest number of samples of a cycle, and of a period of the highest line.
SAMPLES_PER_CYCLE = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Excite(Verb):
    """A command of one axis or two.

    Ends and positions are fractions of a range, from 0 at its low end to 1 at its high end: of the
    voltage of a piezo stack, the travel of a screw, and under position control the reachable
    positions of the axis.
    """

    verb: ClassVar[str] = "excite"
    kind: ClassVar[str] = ""

    def __post_init__(self) -> None:
        require_ranges(self, PlanError, self.kind)

    @property
    def moved_axes(self) -> tuple[str, ...]:
        """The axes that it moves."""
        axis = getattr(self, "axis", None)
        return (axis,) if axis is not None else tuple(getattr(self, "axes", ()))

    def axis_of(self, plan: PlanLookup) -> str:
        del plan
        return "".join(self.moved_axes)

    def settings(self, context: PlanContext) -> dict[str, AxisSetting]:
        """Return the limits of its axes."""
        return {
            axis: axis_setting(
                context.stage,
                axis,
                closed_loop=bool(getattr(self, "closed_loop", False)),
                limits=context.limits(axis),
                natural_frequency_hz=context.frequency,
            )
            for axis in self.moved_axes
        }

    def command(
        self,
        settings: Mapping[str, AxisSetting],
        sample_rate_hz: float,
        *,
        base_rate_hz: float = BASE_RATE_HZ,
    ) -> Command:
        """Return the command.

        Small sines have a higher sample rate. Every rate is an integer fraction of the base rate,
        the highest of the instrument [Hz].

        Examples
        --------
        >>> from flexstage.experiments.excitations.continuous import EqualCycles
        >>> x = AxisSetting(axis="x", quantity="voltage", low=0.0, high=120.0)
        >>> command = EqualCycles(axis="x", rate=0.5, cycles=3).command({"x": x}, 1000.0)
        >>> command.duration, command.first, float(command.values["x"].max())
        (8.001, 2000, 120.0)
        """
        return self.samples(settings, sample_rate_hz, base_rate_hz)

    def samples(
        self, settings: Mapping[str, AxisSetting], sample_rate_hz: float, base_rate_hz: float
    ) -> CommandWaveform:
        """Return its samples; refuse more than fit into memory."""
        fs = whole_part(sample_rate_hz, base_rate_hz)
        command = self.design([settings[axis] for axis in self.moved_axes], fs, base_rate_hz)
        require_size(command.waveform.size, self.kind)
        return command

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        """Return its samples at a sample rate, given the highest of the instrument [Hz]."""
        raise NotImplementedError

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        settings = self.settings(context)
        rate = context.plan.defaults.command_rate
        command = self.samples(settings, rate, context.base_rate_hz)
        problem = ""
        try:
            check_waveform({a: _limits(s) for a, s in settings.items()}, command.waveform)
        except LimitError as error:
            problem = str(error)
        return PlannedStep(
            name=name,
            verb=self.verb,
            what=f"{self.kind} of {', '.join(self.moved_axes)}",
            command_duration=command.duration,
            samples=command.waveform.size,
            motions=tuple(_motion(command.waveform, s) for s in settings.values()),
            notes=command.notes,
            problem=problem,
        )

    def result(
        self, context: RunContext, name: str, files: list[Path], *, now: bool
    ) -> "CommandedStep":
        del files, now
        rate = context.plan.defaults.command_rate
        command = self.command(self.settings(context), rate, base_rate_hz=context.base_rate_hz)
        context.commands[name] = command
        return CommandedStep(
            name=name,
            axis="".join(self.moved_axes),
            kind=self.kind,
            time=command.time,
            values=command.values,
            unit=command.unit,
            notes=command.notes,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandedStep(StepResult):
    """Result of a step of excite."""

    axis: str
    """The axis, or both such as ``xy``."""
    kind: str
    """Kind of the command."""
    time: Array
    """Times of its samples [s], shape (n,); empty for hammer impacts."""
    values: Mapping[str, Array]
    """Its samples by axis [V or m], each of shape (n,)."""
    unit: str
    """Unit of the samples."""
    notes: tuple[str, ...] = ()
    """Notes for the report."""

    def plain(self, result: ResultLookup) -> dict[str, Any]:
        del result
        return {
            **picked(self, "axis", "kind", "unit", "samples=time.size"),
            "range": {a: [float(np.min(v)), float(np.max(v))] for a, v in self.values.items()},
            "notes": list(self.notes),
        }


def require_stack(setting: AxisSetting, what: str) -> None:
    """Refuse a command that only a piezo stack in open loop can follow."""
    if setting.quantity != "voltage":
        raise PlanError(f"{what} only for a piezo stack, and axis '{setting.axis}' has none")


def require_span(kind: str, low: float, high: float) -> None:
    """Refuse ends that are not fractions of a range."""
    if not 0.0 <= low < high <= 1.0:
        raise PlanError(
            f"low and high of {kind} must be rising fractions from 0 to 1, got {low:g} and {high:g}"
        )


def command_of(setting: AxisSetting, values: Array, rate: float, **more: Any) -> CommandWaveform:
    """Return the command of one axis from its samples."""
    waveform = Waveform(
        values={setting.axis: values}, sample_rate_hz=rate, quantity=setting.quantity
    )
    return CommandWaveform(waveform=waveform, reference={}, **more)


def whole_part(rate_hz: float, base_rate_hz: float) -> float:
    """Return the integer fraction of the highest rate that is nearest to a rate.

    Examples
    --------
    >>> whole_part(3000.0, 10e3)
    3333.3333333333335
    """
    return base_rate_hz / max(round(base_rate_hz / rate_hz), 1)


def _limits(s: AxisSetting) -> AxisLimits:
    if s.quantity == "voltage":
        return AxisLimits(voltage=(s.low, s.high), slew=s.largest_rate)
    return AxisLimits(position=(s.low, s.high), speed=s.largest_rate)


def _motion(waveform: Waveform, s: AxisSetting) -> PlannedMotion:
    values = waveform.values[s.axis]
    return PlannedMotion(
        axis=s.axis,
        unit="V" if s.quantity == "voltage" else "m",
        low=float(np.min(values)),
        high=float(np.max(values)),
        largest_rate=waveform.largest_rate(s.axis),
        limits=(s.low, s.high),
        rate_limit=s.largest_rate,
        estimated=s.estimated,
    )
