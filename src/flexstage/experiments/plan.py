"""A plan of experiments: sensors, steps that use results of earlier steps, file, and dry run."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from flexstage.base.choose import has_no, nearest
from flexstage.base.errors import FlexstageError, PlanError
from flexstage.experiments.axis_limits import lowest_frequency
from flexstage.experiments.command import BASE_RATE_HZ
from flexstage.experiments.excitations import EXCITATIONS
from flexstage.experiments.verb import Defaults, PlanContext, PlannedStep, SensorEntry, Verb
from flexstage.experiments.verbs import VERBS
from flexstage.experiments.verbs.excite import Excite
from flexstage.files.decoder import Decoder, read, read_file
from flexstage.files.format import Form, Format, check_name
from flexstage.files.nodes import Mapping, Node, Sequence
from flexstage.files.plain import picked
from flexstage.files.result import Result

if TYPE_CHECKING:
    from flexstage.stage import Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step."""

    name: str
    """Its name."""
    action: Verb
    """Its action, with the options of its verb."""

    @property
    def verb(self) -> str:
        """Its verb."""
        return self.action.verb

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return self.action.needs


_Part = TypeVar("_Part", Step, SensorEntry)


def _by_name(what: str, parts: tuple[_Part, ...], name: str) -> _Part:
    for part in parts:
        if part.name == name:
            return part
    raise PlanError(has_no("the plan", what, name, (part.name for part in parts)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Steps of an experiment on an instrument, in their order.

    Raises
    ------
    PlanError
        A name is used twice, or a step uses a missing step or sensor.
    """

    stage: str
    """Stage file, or name of a built-in design."""
    title: str = ""
    """Title of the plan."""
    serial_number: str = ""
    """Serial number of the stage."""
    sensors: tuple[SensorEntry, ...] = ()
    """The sensors."""
    defaults: Defaults = field(default_factory=Defaults)
    """Defaults of all steps."""
    steps: tuple[Step, ...]
    """The steps."""
    notes: tuple[str, ...] = ()
    """Remarks on all figures."""

    def __post_init__(self) -> None:
        if not self.steps:
            raise PlanError("a plan needs at least one step, got none")
        for _, message in problems(self.steps, self.sensors):
            raise PlanError(message)

    def step(self, name: str) -> Step:
        """Return a step by name; refused where there is none."""
        return _by_name("step", self.steps, name)

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor by name; refused where there is none."""
        return _by_name("sensor", self.sensors, name)

    def action_of(self, name: str) -> Verb:
        """Return the action of a step; refused where there is none."""
        return self.step(name).action

    def axis_of(self, name: str) -> str:
        """Return the axis of a step; both, such as ``xy``, for two axes."""
        return self.action_of(name).axis_of(self)

    def selected(self, names: tuple[str, ...] | None) -> tuple[Step, ...]:
        """Return steps by name and those that they use, in their order; all steps for None."""
        if names is None:
            return self.steps
        required: set[str] = set()
        pending = [self.step(name) for name in names]
        while pending:
            step = pending.pop()
            if step.name not in required:
                required.add(step.name)
                pending += [self.step(name) for name in step.needs]
        return tuple(step for step in self.steps if step.name in required)


def problems(
    steps: tuple[Step, ...], sensors: tuple[SensorEntry, ...]
) -> Iterator[tuple[int, str]]:
    """Yield messages about what steps use and is missing, with the number of the step."""
    before: dict[str, Verb] = {}
    sensor_names = [s.name for s in sensors]
    # files are named after steps, and some file systems ignore case
    names: dict[str, str] = {}
    for k, step in enumerate(steps):
        other = names.setdefault(step.name.casefold(), step.name)
        if step.name in before:
            yield k, f"two steps are called '{step.name}': use different names"
        elif other != step.name:
            yield k, f"the steps '{other}' and '{step.name}' differ only in case: rename one"
        for message in step.action.problems(step.name, before, sensor_names):
            yield k, message
        before[step.name] = step.action


def ready_plans() -> dict[str, Path]:
    """Return the files of the built-in plans, by name.

    Examples
    --------
    >>> "vgtu-piezo" in ready_plans()
    True
    """
    folder = Path(__file__).parent / "ready"
    return {p.stem: p for p in sorted(folder.glob("*.yaml"))}


def find_plan(text: str) -> Path:
    """Return the file of a plan, from its path or the name of a built-in plan."""
    ready = ready_plans()
    if text.casefold() in ready:
        return ready[text.casefold()]
    path = Path(text)
    try:
        exists = bool(text) and path.exists()
    except OSError:  # a name that is too long for any file
        exists = False
    if not exists:
        near = nearest(text, ready, 0.4)
        hint = f"did you mean '{near}'?" if near else f"the plans are {', '.join(ready)}"
        raise PlanError(f"'{text[:200]}' is neither a built-in plan nor a file: {hint}")
    return path


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a plan from a YAML file whose first key is ``plan: 1``.

    The message about an invalid plan names file, line and key.
    """
    return _plan_of(*read_file(Path(path), PLAN_FILE))


def plan_stage(plan: Plan, folder: str | os.PathLike[str] = ".") -> "Stage":
    """Return the stage of a plan: a built-in design, or a file relative to a folder.

    Examples
    --------
    >>> plan_stage(read_plan(find_plan("vgtu-piezo"))).name
    'vgtu-piezo'
    """
    from flexstage.stage.designs import find_stage

    return find_stage(stage_source(plan, folder))


def stage_source(plan: Plan, folder: str | os.PathLike[str] = ".") -> str:
    """Return the stage of a plan as an argument of `flexstage.stage.designs.find_stage`."""
    from flexstage.stage.designs import DESIGNS
    from flexstage.stage.designs.registry import some_of

    if plan.stage.casefold() in DESIGNS:
        return plan.stage
    path = Path(folder) / plan.stage
    if not path.exists():
        raise PlanError(
            f"the plan's stage '{plan.stage[:200]}' is neither a built-in design nor a file: the "
            f"designs are {some_of(DESIGNS)}"
        )
    return str(path)


def plan_from_text(text: str, *, source: str = "plan") -> Plan:
    """Read a plan from the text of its file.

    Examples
    --------
    >>> plan = plan_from_text('''
    ... plan: 1
    ... stage: vgtu-piezo
    ... sensors:
    ...   x: {channel: 1}
    ... steps:
    ...   - {name: loops, excite: {kind: cycles, axis: x, rate: 0.5 Hz}}
    ...   - {name: motion, measure: {of: loops, test: motion, along: x}}
    ... ''')
    >>> plan.axis_of("motion"), plan.step("loops").action.rate
    ('x', 0.5)
    """
    return _plan_of(*read(text, source, PLAN_FILE))


def _plan_of(decoder: Decoder, root: Mapping) -> Plan:
    kinds = {"sensors": tuple[SensorEntry, ...], "steps": tuple[Step, ...]}
    listed = root.items.get("steps")
    if listed is not None and (not isinstance(listed, Sequence) or not listed.items):
        decoder.refuse(listed, "steps", "expected a list of steps, each with a name and a verb")
    parts = {k: decoder.decode(kinds[k], root.items[k], k) for k in kinds if k in root.items}
    if isinstance(listed, Sequence):
        # a problem between steps is reported at the line of the step
        for k, message in problems(parts["steps"], parts.get("sensors", ())):
            decoder.refuse(listed.items[k], f"steps[{k}]", message)
    return decoder.build(Plan, root, "", parts, also=parts)


def _read_step(decoder: Decoder, node: Node, path: str, _base: Any) -> Step:
    if not isinstance(node, Mapping):
        decoder.refuse(node, path, "a step is a mapping of its name and a verb")
    decoder.check_keys(node, path, ["name", *VERBS])
    if "name" not in node.items:
        decoder.refuse(node, path, "'name' is missing")
    place = node.items["name"]
    name = decoder.text(place, f"{path}.name")
    check_name(name, lambda text: decoder.refuse(place, f"{path}.name", text))
    if any(c in name for c in '/\\:. *?"<>|'):
        decoder.refuse(
            place,
            f"{path}.name",
            f"files are named after their step, so '{name}' must not contain a space, dot, colon, "
            "slash or other character that file names cannot have",
        )
    verbs = [key for key in node.items if key != "name"]
    if len(verbs) != 1:
        decoder.refuse(
            node,
            path,
            f"step '{name}' needs exactly one verb of {', '.join(VERBS)}, got "
            f"{', '.join(verbs) or 'none'}",
        )
    verb = verbs[0]
    inner, here = node.items[verb], f"{path}.{verb}"
    if not isinstance(inner, Mapping):
        decoder.refuse(inner, here, f"{verb} is a mapping of its options")
    return Step(name=name, action=decoder.decode(VERBS[verb], inner, here))


def _step_schema(builder: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "description": "A step: its name and one verb with its options.",
        "properties": {
            "name": {"type": "string", "description": "Name of the step and of its files."},
            **{verb: builder.of(kind) for verb, kind in VERBS.items()},
        },
        "additionalProperties": False,
        "required": ["name"],
        "minProperties": 2,
        "maxProperties": 2,
    }


#: Format of a plan file.
PLAN_FILE = Format(
    noun="plan",
    key="plan",
    error=PlanError,
    only=True,
    families={Excite: EXCITATIONS},
    forms={Step: Form(read=_read_step, schema=_step_schema)},
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DryRun(Result):
    """Result of a dry run."""

    table_key: ClassVar[str] = "steps"

    stage: str
    """Name of the stage."""
    steps: tuple[PlannedStep, ...]
    """Previews of its steps."""

    def data(self) -> dict[str, Any]:
        return picked(self, "stage", "duration", "steps", "problems")

    @property
    def duration(self) -> float:
        """Total time of motion and recording [s], without the moves to the first samples."""
        return sum(step.duration for step in self.steps)

    @property
    def problems(self) -> tuple[str, ...]:
        """Reasons why steps cannot be carried out."""
        return tuple(f"step '{s.name}': {s.problem}" for s in self.steps if s.problem)


def dry_run(
    plan: Plan,
    stage: "Stage",
    *,
    only: tuple[str, ...] | None = None,
    base_rate_hz: float = BASE_RATE_HZ,
) -> DryRun:
    """Preview a plan without an instrument.

    Parameters
    ----------
    plan : Plan
        The plan.
    stage : Stage
        The stage.
    only : tuple of str, optional
        Selected steps; those that they use are added.
    base_rate_hz : float
        Highest sample rate of the instrument [Hz], which all other rates divide.

    Returns
    -------
    DryRun
        Previews of all steps: motions, and their duration.

    Notes
    -----
    Validity: limits are those of the stage's description; those of an instrument may be narrower.
    Positions that a piezo axis reaches are estimated from its published or computed stroke. The
    commands of compensation and feedback need a model; only their duration is known.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> plan = plan_from_text('''
    ... plan: 1
    ... stage: vgtu-piezo
    ... sensors:
    ...   x: {channel: 1}
    ... steps:
    ...   - {name: loops, excite: {kind: cycles, axis: x, rate: 0.5 Hz}}
    ...   - {name: motion, measure: {of: loops, test: motion, along: x}}
    ... ''')
    >>> preview = dry_run(plan, design("vgtu-piezo"))
    >>> preview.duration, preview.steps[0].motions[0].high
    (8.001, 120.0)
    """
    context = PlanContext(
        plan=plan,
        stage=stage,
        base_rate_hz=base_rate_hz,
        frequency=natural_frequency(plan, stage),
    )
    for step in plan.selected(only):
        try:
            planned = step.action.preview(context, step.name)
        except FlexstageError as error:
            planned = PlannedStep(name=step.name, verb=step.verb, what="", problem=str(error))
        context.planned[step.name] = planned
    return DryRun(stage=stage.name, steps=tuple(context.planned.values()))


def natural_frequency(plan: Plan, stage: "Stage") -> float | None:
    """Return the lowest natural frequency, which commands must not excite; None if not needed."""
    if plan.defaults.lowest_frequency is not None:
        return plan.defaults.lowest_frequency
    needed = any(step.action.needs_frequency for step in plan.steps)
    return lowest_frequency(stage) if needed else None
