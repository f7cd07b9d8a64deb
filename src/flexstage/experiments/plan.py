"""A plan of experiments: sensors, steps that use what earlier ones gave, and its file."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexstage.base.choose import has_no, nearest
from flexstage.base.errors import PlanError
from flexstage.experiments.excitations import EXCITATIONS
from flexstage.experiments.verb import Defaults, SensorEntry, Verb
from flexstage.experiments.verbs import VERBS
from flexstage.experiments.verbs.excite import Excite
from flexstage.files.decoder import Decoder, read, read_file
from flexstage.files.format import Form, Format, check_name
from flexstage.files.nodes import Mapping, Node, Sequence

if TYPE_CHECKING:
    from flexstage.stage import Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step."""

    name: str
    """Its name."""
    action: Verb
    """What it does."""

    @property
    def verb(self) -> str:
        """What it does, in a word."""
        return self.action.verb

    @property
    def needs(self) -> tuple[str, ...]:
        """Earlier steps that it uses."""
        return self.action.needs


_Part = TypeVar("_Part", Step, SensorEntry)


def _named(what: str, parts: tuple[_Part, ...], name: str) -> _Part:
    for part in parts:
        if part.name == name:
            return part
    raise PlanError(has_no("the plan", what, name, (part.name for part in parts)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Steps to be carried out on an instrument, in their order.

    Raises
    ------
    PlanError
        Names are given twice, or a step uses what is not there.
    """

    stage: str
    """Stage file, or name of a built-in design."""
    title: str = ""
    """What the plan is for."""
    serial_number: str = ""
    """Serial number of the stage."""
    sensors: tuple[SensorEntry, ...] = ()
    """The sensors."""
    defaults: Defaults = field(default_factory=Defaults)
    """What holds for all steps."""
    steps: tuple[Step, ...]
    """The steps."""
    notes: tuple[str, ...] = ()
    """Remarks that belong to every figure."""

    def __post_init__(self) -> None:
        if not self.steps:
            raise PlanError("a plan needs one step at least, got none")
        for _, message in problems(self.steps, self.sensors):
            raise PlanError(message)

    def step(self, name: str) -> Step:
        """Return a step by name; refused where there is none."""
        return _named("step", self.steps, name)

    def sensor(self, name: str) -> SensorEntry:
        """Return a sensor by name; refused where there is none."""
        return _named("sensor", self.sensors, name)

    def action_of(self, name: str) -> Verb:
        """Return what a step does; refused where there is none."""
        return self.step(name).action

    def axis_of(self, name: str) -> str:
        """Return the axis that a step is about; both, such as ``xy``, where it is about two."""
        return self.action_of(name).axis_of(self)

    def chosen(self, names: tuple[str, ...] | None) -> tuple[Step, ...]:
        """Return steps by name with all that they use, in their order; every step for None."""
        if names is None:
            return self.steps
        wanted: set[str] = set()
        left = [self.step(name) for name in names]
        while left:
            step = left.pop()
            if step.name not in wanted:
                wanted.add(step.name)
                left += [self.step(name) for name in step.needs]
        return tuple(step for step in self.steps if step.name in wanted)


def problems(
    steps: tuple[Step, ...], sensors: tuple[SensorEntry, ...]
) -> Iterator[tuple[int, str]]:
    """Say what steps use that is not there."""
    before: dict[str, Verb] = {}
    known = [s.name for s in sensors]
    # files are named after steps, and some systems do not tell large letters from small ones
    taken: dict[str, str] = {}
    for k, step in enumerate(steps):
        other = taken.setdefault(step.name.casefold(), step.name)
        if step.name in before:
            yield k, f"two steps are called '{step.name}': give each its own name"
        elif other != step.name:
            yield k, f"the steps '{other}' and '{step.name}' differ in capitals only: rename one"
        for said in step.action.problems(step.name, before, known):
            yield k, said
        before[step.name] = step.action


def ready_plans() -> dict[str, Path]:
    """Return the files of the plans that come with flexstage, by name.

    Examples
    --------
    >>> "vgtu-piezo" in ready_plans()
    True
    """
    folder = Path(__file__).parent / "ready"
    return {p.stem: p for p in sorted(folder.glob("*.yaml"))}


def find_plan(text: str) -> Path:
    """Return the file of a plan: a path, or the name of one that comes with flexstage."""
    ready = ready_plans()
    if text.casefold() in ready:
        return ready[text.casefold()]
    path = Path(text)
    try:
        found = bool(text) and path.exists()
    except OSError:  # a name that is too long for any file
        found = False
    if not found:
        near = nearest(text, ready, 0.4)
        hint = f"did you mean '{near}'?" if near else f"the plans are {', '.join(ready)}"
        raise PlanError(f"no ready plan and no file is called '{text[:200]}': {hint}")
    return path


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a plan from a YAML file whose first key is ``plan: 1``.

    Where it describes no possible plan, the message is one sentence with file, line and key.
    """
    return _plan_of(*read_file(Path(path), PLAN_FILE))


def plan_stage(plan: Plan, folder: str | os.PathLike[str] = ".") -> "Stage":
    """Return the stage that a plan names: a built-in design, or a file as seen from a folder.

    Examples
    --------
    >>> plan_stage(read_plan(find_plan("vgtu-piezo"))).name
    'vgtu-piezo'
    """
    from flexstage.stage.designs import find_stage

    return find_stage(stage_source(plan, folder))


def stage_source(plan: Plan, folder: str | os.PathLike[str] = ".") -> str:
    """Return what `flexstage.stage.designs.find_stage` takes for the stage that a plan names."""
    from flexstage.stage.designs import DESIGNS
    from flexstage.stage.designs.registry import some_of

    if plan.stage.casefold() in DESIGNS:
        return plan.stage
    path = Path(folder) / plan.stage
    if not path.exists():
        raise PlanError(
            f"the plan's stage '{plan.stage[:200]}' is no built-in design and no file: the designs "
            f"are {some_of(DESIGNS)}"
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
        # what is wrong between steps is told at the step
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
            f"a step names its files: no space, dot, colon, slash or other mark that files cannot "
            f"have may be in '{name}'",
        )
    verbs = [key for key in node.items if key != "name"]
    if len(verbs) != 1:
        decoder.refuse(
            node,
            path,
            f"step '{name}' needs one verb of {', '.join(VERBS)}, got {', '.join(verbs) or 'none'}",
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
            "name": {"type": "string", "description": "Its name, which names its files."},
            **{verb: builder.of(kind) for verb, kind in VERBS.items()},
        },
        "additionalProperties": False,
        "required": ["name"],
        "minProperties": 2,
        "maxProperties": 2,
    }


#: The kind of file that holds a plan.
PLAN_FILE = Format(
    noun="plan",
    key="plan",
    error=PlanError,
    only=True,
    families={Excite: EXCITATIONS},
    forms={Step: Form(read=_read_step, schema=_step_schema)},
)
