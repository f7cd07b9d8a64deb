"""What a plan would send, without an instrument."""

from dataclasses import dataclass
from typing import Any, ClassVar

from flexstage.base.errors import FlexstageError
from flexstage.experiments.axis_limits import lowest_frequency
from flexstage.experiments.command import BASE_RATE_HZ
from flexstage.experiments.plan import Plan
from flexstage.experiments.verb import PlanContext, PlannedStep
from flexstage.files.plain import picked
from flexstage.files.result import Result
from flexstage.stage import Stage


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DryRun(Result):
    """What a plan would do."""

    table_key: ClassVar[str] = "steps"

    stage: str
    """Name of the stage."""
    steps: tuple[PlannedStep, ...]
    """Its steps."""

    def data(self) -> dict[str, Any]:
        return picked(self, "stage", "duration", "steps", "problems")

    @property
    def duration(self) -> float:
        """Time of all motion and recording together [s], the ways to a first sample left out."""
        return sum(step.duration for step in self.steps)

    @property
    def problems(self) -> tuple[str, ...]:
        """Why steps cannot be carried out."""
        return tuple(f"step '{s.name}': {s.problem}" for s in self.steps if s.problem)


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
    >>> from flexstage.stage.designs import design
    >>> from flexstage.experiments.plan import plan_from_text
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
    context = PlanContext(
        plan=plan,
        stage=stage,
        base_rate_hz=base_rate_hz,
        frequency=natural_frequency(plan, stage),
    )
    for step in plan.chosen(only):
        try:
            planned = step.action.preview(context, step.name)
        except FlexstageError as error:
            planned = PlannedStep(name=step.name, verb=step.verb, what="", problem=str(error))
        context.planned[step.name] = planned
    return DryRun(stage=stage.name, steps=tuple(context.planned.values()))


def natural_frequency(plan: Plan, stage: Stage) -> float | None:
    """Return the lowest natural frequency that commands keep clear of."""
    if plan.defaults.lowest_frequency is not None:
        return plan.defaults.lowest_frequency
    needed = any(step.action.needs_frequency for step in plan.steps)
    return lowest_frequency(stage) if needed else None
