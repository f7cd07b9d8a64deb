"""The file of a plan."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from flexstage.choose import nearest, unknown
from flexstage.errors import FlexstageError, PlanError
from flexstage.plans.excite import EXCITATIONS
from flexstage.plans.plan import Defaults, Plan, SensorEntry, Step, problems
from flexstage.plans.verbs import Centre, Characterise, Compensate, Identify, Measure, Verify
from flexstage.stage.decoder import Decoder
from flexstage.stage.field_types import check_name
from flexstage.stage.yaml_reader import Mapping as MappingNode
from flexstage.stage.yaml_reader import Node, Scalar, Sequence, parse_yaml, read_text

_VERSION = 1
_VERBS: dict[str, type] = {
    v.verb: v for v in (Measure, Characterise, Identify, Compensate, Verify, Centre)
}
_HEAD = ("plan", "title", "stage", "serial_number", "sensors", "defaults", "steps", "notes")


@dataclass(slots=True)
class _PlanDecoder(Decoder):
    """A decoder whose errors are those of a plan."""

    def refuse(
        self, node: Node, path: str, message: str, error: type[Exception] = PlanError
    ) -> NoReturn:
        wanted = PlanError if issubclass(error, FlexstageError) else error
        where = f", {path}" if path else ""
        raise wanted(f"{self.source}, line {node.line}{where}: {message}")


def ready_plans() -> dict[str, Path]:
    """Return the plans that come with flexstage.

    Returns
    -------
    dict
        Files by name.

    Examples
    --------
    >>> "vgtu-piezo" in ready_plans()
    True
    """
    folder = Path(__file__).parent / "ready"
    return {p.stem: p for p in sorted(folder.glob("*.yaml"))}


def find_plan(text: str) -> Path:
    """Return the file of a plan that the command line names.

    Parameters
    ----------
    text : str
        Path of a file, or name of a plan that comes with flexstage.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    PlanError
        There is neither.
    """
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
    """Read a plan from a file.

    Parameters
    ----------
    path : str or os.PathLike
        A YAML file whose first key is ``plan: 1``.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    PlanError
        There is no such file, or it describes no possible plan; the message is one sentence with
        file, line and key.
    """
    text = read_text(Path(path), "plan", PlanError)
    return plan_from_text(text, source=os.fspath(path))


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
    root = parse_yaml(text, source, "plan", PlanError)
    decoder = _PlanDecoder(source)
    if not isinstance(root, MappingNode) or "plan" not in root.items:
        decoder.refuse(root, "", "a plan begins with 'plan: 1'")
    version: Any = decoder.decode(float, root.items["plan"], "plan")
    if version != _VERSION:
        decoder.refuse(
            root.items["plan"],
            "plan",
            f"version {version:g} is not known: this flexstage reads version {_VERSION}",
        )
    decoder.check_keys(root, "", list(_HEAD))
    for key in ("stage", "steps"):
        if key not in root.items:
            decoder.refuse(root, "", f"'{key}' is missing")
    sensors = _optional(decoder, root, "sensors", tuple[SensorEntry, ...], ())
    steps = _steps(decoder, root.items["steps"], sensors)
    try:
        return Plan(
            stage=decoder.decode(str, root.items["stage"], "stage"),
            title=_optional(decoder, root, "title", str, ""),
            serial_number=_optional(decoder, root, "serial_number", str, ""),
            sensors=sensors,
            defaults=_optional(decoder, root, "defaults", Defaults, Defaults()),
            steps=steps,
            notes=_optional(decoder, root, "notes", tuple[str, ...], ()),
        )
    except FlexstageError as error:
        if str(error).startswith(source):
            raise
        decoder.refuse(root, "", str(error))


def _optional(decoder: Decoder, root: MappingNode, key: str, kind: Any, usual: Any) -> Any:
    node = root.items.get(key)
    return usual if node is None else decoder.decode(kind, node, key)


def _steps(decoder: Decoder, node: Node, sensors: tuple[SensorEntry, ...]) -> tuple[Step, ...]:
    if not isinstance(node, Sequence) or not node.items:
        decoder.refuse(node, "steps", "expected a list of steps, each with a name and a verb")
    steps = tuple(_step(decoder, item, f"steps[{k}]") for k, item in enumerate(node.items))
    for k, message in problems(steps, sensors):
        decoder.refuse(node.items[k], f"steps[{k}]", message)
    return steps


def _step(decoder: Decoder, node: Node, path: str) -> Step:
    if not isinstance(node, MappingNode):
        decoder.refuse(node, path, "a step is a mapping of its name and a verb")
    decoder.check_keys(node, path, ["name", "excite", *_VERBS])
    if "name" not in node.items:
        decoder.refuse(node, path, "'name' is missing")
    name = decoder.decode(str, node.items["name"], f"{path}.name")
    check_name(name, lambda text: decoder.refuse(node.items["name"], f"{path}.name", text))
    if any(c in name for c in '/\\:. *?"<>|'):
        decoder.refuse(
            node.items["name"],
            f"{path}.name",
            f"a step names its files: no space, dot, colon, slash or other mark that files cannot "
            f"have may be in '{name}'",
        )
    verbs = [key for key in node.items if key != "name"]
    if len(verbs) != 1:
        decoder.refuse(
            node,
            path,
            f"step '{name}' needs one verb of excite, {', '.join(_VERBS)}, got "
            f"{', '.join(verbs) or 'none'}",
        )
    verb = verbs[0]
    inner, here = node.items[verb], f"{path}.{verb}"
    if not isinstance(inner, MappingNode):
        decoder.refuse(inner, here, f"{verb} is a mapping of its options")
    if verb != "excite":
        return Step(name=name, action=decoder.build(_VERBS[verb], inner, here))
    return Step(name=name, action=_excitation(decoder, inner, here))


def _excitation(decoder: Decoder, node: MappingNode, path: str) -> Any:
    listed = ", ".join(EXCITATIONS)
    if "kind" not in node.items:
        decoder.refuse(node, path, f"'kind' is missing (one of {listed})")
    place = node.items["kind"]
    kind = place.text if isinstance(place, Scalar) else ""
    if kind not in EXCITATIONS:
        decoder.refuse(place, f"{path}.kind", unknown("kind", kind, EXCITATIONS, 0.4))
    rest = {key: value for key, value in node.items.items() if key != "kind"}
    return decoder.build(EXCITATIONS[kind], MappingNode(node.line, rest, node.key_lines), path)
