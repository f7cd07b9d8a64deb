"""What a plan would send, without an instrument."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexstage.errors import FlexstageError, LimitError
from flexstage.experiments.axis_limits import (
    AxisSetting,
    axis_setting,
    estimated_stroke,
    lowest_frequency,
)
from flexstage.experiments.command import CommandWaveform, Strike
from flexstage.experiments.design import BASE_RATE_HZ, design_command
from flexstage.experiments.excite import Excite
from flexstage.experiments.plan import Plan, Step
from flexstage.experiments.reference import reference_rate, require_whole_cycles
from flexstage.experiments.verbs import Centre, Compensate, Measure, Verify
from flexstage.instruments.limits import check_waveform
from flexstage.stage import Stage
from flexstage.stage.limits import AxisLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedMotion:
    """What one axis would be told."""

    axis: str
    """The axis."""
    unit: str
    """``V`` or ``m``."""
    low: float
    """Smallest value [V or m]."""
    high: float
    """Largest value [V or m]."""
    largest_rate: float
    """Largest slope [V/s or m/s]."""
    limits: tuple[float, float]
    """Lowest and highest value that is allowed [V or m]."""
    rate_limit: float | None
    """Largest slope that is allowed [V/s or m/s]."""
    estimated: bool
    """Whether the limits are only estimated, and an instrument will tell them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStep:
    """What one step would do."""

    name: str
    """Name of the step."""
    verb: str
    """Its verb."""
    what: str
    """What it does, in words."""
    duration: float = 0.0
    """How long the stage moves or is recorded [s]; 0 of a step that only computes."""
    command_duration: float = 0.0
    """How long a command that is made here will take [s]."""
    samples: int = 0
    """Samples of the command."""
    signals: int = 0
    """Number of signals that are recorded."""
    motions: tuple[PlannedMotion, ...] = ()
    """What each axis would be told."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""
    problem: str = ""
    """Why it cannot be carried out; empty where it can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DryRun:
    """What a plan would do."""

    stage: str
    """Name of the stage."""
    steps: tuple[PlannedStep, ...]
    """Its steps."""

    @property
    def duration(self) -> float:
        """Time of all motion and recording together [s], the ways to a first sample left out."""
        return sum(step.duration for step in self.steps)

    @property
    def problems(self) -> tuple[str, ...]:
        """Why steps cannot be carried out."""
        return tuple(f"step '{s.name}': {s.problem}" for s in self.steps if s.problem)


def settings_of(
    wanted: Excite,
    stage: Stage,
    *,
    limits: Mapping[str, AxisLimits] | None = None,
    natural_frequency_hz: float | None = None,
) -> dict[str, AxisSetting]:
    """Return what the axes of a command allow."""
    closed = wanted.kind == "positioning" or bool(getattr(wanted, "closed_loop", False))
    return {
        axis: axis_setting(
            stage,
            axis,
            closed_loop=closed,
            limits=None if limits is None else limits.get(axis),
            natural_frequency_hz=natural_frequency_hz,
        )
        for axis in wanted.moved
    }


def dry_run(
    plan: Plan,
    stage: Stage,
    *,
    only: tuple[str, ...] | None = None,
    base_rate_hz: float = BASE_RATE_HZ,
) -> DryRun:
    """Say what a plan would do, without an instrument.

    Parameters
    ----------
    plan : Plan
        The plan.
    stage : Stage
        The stage.
    only : tuple of str, optional
        Steps that are wanted; those that they use are added.
    base_rate_hz : float
        Highest rate of samples of the instrument, of which all others are whole parts [Hz].

    Returns
    -------
    DryRun
        Every step, with what would be sent and how long it takes.

    Notes
    -----
    Validity: limits are those of the stage's description; those of an instrument may be narrower.
    Positions that a piezo axis reaches are estimated from its published or computed stroke. What
    compensation and feedback send is known when a model is; its duration is.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.experiments.file import plan_from_text
    >>> plan = plan_from_text('''
    ... plan: 1
    ... stage: vgtu-piezo
    ... sensors:
    ...   x: {channel: 1}
    ... steps:
    ...   - {name: loops, excite: {kind: cycles, axis: x, rate: 0.5 Hz}}
    ...   - {name: motion, measure: {of: loops, test: motion, along: x}}
    ... ''')
    >>> found = dry_run(plan, design("vgtu-piezo"))
    >>> found.duration, found.steps[0].motions[0].high
    (8.001, 120.0)
    """
    commands: dict[str, PlannedStep] = {}
    frequency = natural_frequency(plan, stage)
    steps = []
    for step in plan.chosen(only):
        try:
            planned = _planned(step, plan, stage, commands, frequency, base_rate_hz)
        except FlexstageError as error:
            planned = PlannedStep(name=step.name, verb=step.verb, what="", problem=str(error))
        commands[step.name] = planned
        steps.append(planned)
    return DryRun(stage=stage.name, steps=tuple(steps))


def natural_frequency(plan: Plan, stage: Stage) -> float | None:
    """Return the lowest natural frequency that commands keep clear of."""
    if plan.defaults.lowest_frequency is not None:
        return plan.defaults.lowest_frequency
    needed = any(getattr(step.action, "kind", "") == "designed" for step in plan.steps)
    return lowest_frequency(stage) if needed else None


def _planned(
    step: Step,
    plan: Plan,
    stage: Stage,
    before: Mapping[str, PlannedStep],
    frequency: float | None,
    base_rate_hz: float,
) -> PlannedStep:
    action = step.action
    if isinstance(action, Excite):
        settings = settings_of(action, stage, natural_frequency_hz=frequency)
        made = design_command(
            action, settings, plan.defaults.command_rate, base_rate_hz=base_rate_hz
        )
        return _command(step, action, made, settings)
    if isinstance(action, Measure):
        return _measured(step, action, plan, before[action.of])
    if isinstance(action, Compensate | Verify):
        reference = action.reference
        reference_rate(reference, plan.defaults.command_rate, base_rate_hz)
        if isinstance(action, Verify):
            require_whole_cycles(step.name, action, plan.defaults.rate)
        once = (reference.cycles + reference.settle) / reference.rate
        stroke = estimated_stroke(stage, plan.axis_of(step.name))
        runs = 0.0
        what = f"{reference.shape} of {1e6 * reference.share * stroke:.1f} um about the middle"
        if isinstance(action, Verify):
            # the trials of learning are counted, the last of which is kept
            runs = len(action.ways) + (action.trials - 1.0) * ("learning" in action.ways)
            what = f"{', '.join(action.ways)}: {what}"
        return PlannedStep(
            name=step.name,
            verb=step.verb,
            what=f"{what}, {reference.rate:g} Hz",
            duration=runs * once,
            command_duration=once,
            notes=("the voltages follow from the model that is identified",),
        )
    if isinstance(action, Centre):
        for axis in action.axes:
            axis_setting(stage, axis, closed_loop=True)
        moves = action.moves + 2
        return PlannedStep(
            name=step.name, verb=step.verb, what=f"up to {moves} moves of {', '.join(action.axes)}"
        )
    return PlannedStep(name=step.name, verb=step.verb, what=f"of {', '.join(step.needs)}")


def _command(
    step: Step, action: Excite, made: CommandWaveform | Strike, settings: Mapping[str, AxisSetting]
) -> PlannedStep:
    if isinstance(made, Strike):
        what = f"{made.hits} blows along {made.axis}, drives taken out"
        return PlannedStep(name=step.name, verb=step.verb, what=what, samples=0)
    problem = ""
    try:
        check_waveform({a: _limits(s) for a, s in settings.items()}, made.waveform)
    except LimitError as error:
        problem = str(error)
    return PlannedStep(
        name=step.name,
        verb=step.verb,
        what=f"{action.kind} of {', '.join(action.moved)}",
        command_duration=made.duration,
        samples=made.waveform.size,
        motions=tuple(_motion(made, s) for s in settings.values()),
        notes=made.notes,
        problem=problem,
    )


def _limits(s: AxisSetting) -> AxisLimits:
    if s.quantity == "voltage":
        return AxisLimits(voltage=(s.low, s.high), slew=s.largest_rate)
    return AxisLimits(position=(s.low, s.high), speed=s.largest_rate)


def _motion(made: CommandWaveform, s: AxisSetting) -> PlannedMotion:
    values = made.waveform.values[s.axis]
    return PlannedMotion(
        axis=s.axis,
        unit="V" if s.quantity == "voltage" else "m",
        low=float(np.min(values)),
        high=float(np.max(values)),
        largest_rate=made.waveform.largest_rate(s.axis),
        limits=(s.low, s.high),
        rate_limit=s.largest_rate,
        estimated=s.estimated,
    )


def _measured(step: Step, action: Measure, plan: Plan, source: PlannedStep) -> PlannedStep:
    rate = action.rate or plan.defaults.rate
    own = plan.step(action.of).action
    if source.problem:
        return PlannedStep(
            name=step.name, verb=step.verb, what="", problem=f"'{source.name}' cannot be made"
        )
    if getattr(own, "kind", "") == "blows":
        return PlannedStep(
            name=step.name, verb=step.verb, what=f"force and response of {source.what}", signals=2
        )
    kind = action.test or "for identification"
    sensors = {*action.roles.values(), *action.output, *action.also}
    return PlannedStep(
        name=step.name,
        verb=step.verb,
        what=f"{kind}, {rate:g} Hz",
        duration=source.command_duration,
        samples=source.samples,
        signals=len(sensors),
        motions=source.motions,
    )
