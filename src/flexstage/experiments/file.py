"""The file of a plan."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.choose import nearest
from flexstage.errors import PlanError
from flexstage.experiments.excitations import EXCITATIONS
from flexstage.experiments.plan import Plan, SensorEntry, Step, problems
from flexstage.experiments.verbs import VERBS
from flexstage.experiments.verbs.excite import Excite
from flexstage.files.decoder import Decoder, read, read_file
from flexstage.files.format import Form, Format, check_name
from flexstage.files.nodes import Mapping, Node, Sequence

if TYPE_CHECKING:
    from flexstage.stage import Stage


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
    return _plan(*read_file(Path(path), PLAN_FILE))


def plan_stage(plan: Plan, folder: str | os.PathLike[str] = ".") -> "Stage":
    """Return the stage that a plan names: a built-in design, or a file as seen from a folder.

    Examples
    --------
    >>> plan_stage(read_plan(find_plan("vgtu-piezo"))).name
    'vgtu-piezo'
    """
    from flexstage.designs import find_stage

    return find_stage(stage_source(plan, folder))


def stage_source(plan: Plan, folder: str | os.PathLike[str] = ".") -> str:
    """Return what `flexstage.designs.find_stage` takes for the stage that a plan names."""
    from flexstage.designs import DESIGNS
    from flexstage.designs.registry import some_of

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
    return _plan(*read(text, source, PLAN_FILE))


def _plan(decoder: Decoder, root: Mapping) -> Plan:
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
