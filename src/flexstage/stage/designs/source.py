"""Sources of stages, a built-in design, a stage file or a drawing: parameters, templates, texts."""

import os
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from flexstage.base.choose import nearest
from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.encoder import flow_text
from flexstage.files.expression import dimension_named
from flexstage.files.nodes import Mapping as MappingNode
from flexstage.files.nodes import Node, Scalar, parse_yaml, plain, read_text
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.parameters import require_known, settings_of
from flexstage.quantities.units import DIMENSIONS, to_text
from flexstage.stage import Stage, stage_from_text, stage_to_text
from flexstage.stage.designs.parameters import (
    Group,
    ParameterSet,
    StageParameter,
    Topology,
    entries_of,
)
from flexstage.stage.designs.registry import (
    DESIGNS,
    PARAMETER_SETS,
    build,
    construct,
    design,
    design_parameters,
    some_of,
)
from flexstage.stage.drawing import DRAWINGS
from flexstage.stage.file import STAGE_FILE

if TYPE_CHECKING:
    from flexstage.stage.drawing.requests import DrawingOptions


def find_stage(
    source: str | os.PathLike[str],
    set: Mapping[str, object] | None = None,
    *,
    drawing: "DrawingOptions | None" = None,
) -> Stage:
    """Return a built-in stage, or read one from a stage file or out of a drawing.

    Parameters
    ----------
    source : str or os.PathLike
        Name of a built-in design, or path of a stage file or a drawing (DXF, STEP).
    set : mapping, optional
        Parameters of the design or of the file by name, with dots for those of a group, and their
        values as a stage file has them, ``{"x.lever_neck": "0.45 mm"}``; a number is in SI units.
    drawing : DrawingOptions, optional
        Data of a drawing beyond its file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, the file is invalid, or it has no such
        parameter.

    Examples
    --------
    >>> find_stage("vgtu-piezo").name
    'vgtu-piezo'
    >>> find_stage("parallelogram", {"leg_spacing": "35 mm"}).hinges[0].at[0]
    -0.0175
    >>> find_stage("parallelogram", {"leg_spacing": 0.035}).hinges[0].at[0]
    -0.0175
    """
    text = os.fspath(source)
    set = si_settings(text, set)
    if drawing is not None and Path(text).suffix.lower() not in DRAWINGS:
        raise StageError(
            f"options of a drawing apply to drawings only ({', '.join(DRAWINGS)}), got "
            f"'{text[:200]}'"
        )
    if text.casefold() in DESIGNS:
        return construct(*chosen_design(text.casefold(), set)) if set else design(text)
    path = _file(text)
    if path.suffix.lower() in DRAWINGS:
        from flexstage.stage.drawing.drawn_stage import stage_of_drawing
        from flexstage.stage.drawing.requests import DrawingOptions

        for name in set or {}:
            require_known(f"the drawing '{text}'", name, (), StageError)
        return stage_of_drawing(path, drawing or DrawingOptions())
    from flexstage.stage.file import read_stage

    return read_stage(path, designs=build, set=set)


def si_settings(source: str, settings: Mapping[str, object] | None) -> Mapping[str, object]:
    """Return settings of a design or file in which a number has the SI unit of its quantity."""
    values = dict(settings or {})
    numbers = [n for n, v in values.items() if isinstance(v, Real) and not isinstance(v, bool)]
    if numbers:
        units = {p.name: DIMENSIONS[p.dimension].si for p in parameters_of(source) if p.dimension}
        values |= {n: f"{values[n]} {units[n]}" for n in numbers if n in units}
    return values


def parameters_of(source: str | os.PathLike[str]) -> tuple[StageParameter, ...]:
    """Return the parameters of a built-in design or of a stage file, which `find_stage` sets.

    Parameters
    ----------
    source : str or os.PathLike
        Name of a built-in design, or path of a stage file.

    Returns
    -------
    tuple of StageParameter
        Those of a file in its order, then the dimensions of the design that it names.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, or the file is invalid.

    Examples
    --------
    >>> neck = next(p for p in parameters_of("vgtu-piezo") if p.name == "x.lever_neck")
    >>> neck.text, neck.value, neck.dimension
    ('0.55 mm', 0.00055, 'length')
    """
    text = os.fspath(source)
    if text.casefold() in DESIGNS:
        return parameters_in(text.casefold(), None)
    path = _file(text)
    if path.suffix.lower() in DRAWINGS:
        return ()  # what a drawing says is fixed: `flexstage import` gives its necks names
    return parameters_in(text, read_text(path, STAGE_FILE.noun, StageError))


def parameters_in(
    source: str,
    file: str | None,
    set: Mapping[str, object] | None = None,
    on_design: Callable[[tuple[Topology, ParameterSet | None, Any]], None] | None = None,
) -> tuple[StageParameter, ...]:
    """Return the parameters of a built-in design, or of the text of a file, with settings.

    `on_design` receives family, built-in design and dimensions of the design that a file names.
    """
    if file is None:
        return _in_design(chosen_design(source, set or {})[2])
    from flexstage.stage.file import file_parameters

    dimensions: list[Any] = []

    def read_design(name: str, settings: Mapping[str, object]) -> None:
        selection = design_parameters(name, settings)
        dimensions.append(selection[2])
        if on_design is not None:
            on_design(selection)

    file_settings = file_parameters(file, read_design, set=set, source=source)
    return (
        *(
            StageParameter(
                name=name,
                value=float(entry.amount.value),
                dimension=dimension_named(entry.amount.powers) or "",
                text=entry.text,
                description=entry.description,
            )
            for name, entry in file_settings.items()
        ),
        *(parameter for entry in dimensions for parameter in _in_design(entry)),
    )


def _in_design(dimensions: Any) -> tuple[StageParameter, ...]:
    return tuple(e for e in entries_of(dimensions) if isinstance(e, StageParameter))


def _file(text: str) -> Path:
    """Return the path of an existing stage file."""
    path = Path(text)
    if not text or not _exists(path):
        # a file that lies there, by another ending or a letter less, before a design of such a name
        # similar names without their ending: a name of five letters shares four with many files
        neighbours = {Path(name).stem: name for name in _files_in_folder(path)}
        file = neighbours.get(nearest(path.stem, neighbours, 0.75) or "")
        near = (
            str(path.with_name(file))
            if file
            else nearest(text, DESIGNS, 0.7 if path.suffix else 0.4)
        )
        hint = f"did you mean '{near}'?" if near else f"the designs are {some_of(DESIGNS)}"
        raise StageError(f"no built-in design and no file is called '{text[:200]}': {hint}")
    return path


def chosen_design(
    name: str, settings: Mapping[str, object]
) -> tuple[Topology, ParameterSet | None, Any]:
    """Return family, built-in design and dimensions of a design with settings."""
    design = _names_of(name)
    # another kind of what stands there, or a bought part, has parameters of its own, which are
    # checked as in a file
    anew = tuple(
        setting.removesuffix(key)
        for setting in settings
        for key in ("kind", "as")
        if setting.endswith(f".{key}")
    )
    for setting in settings:
        if not setting.startswith(anew or ("kind",)) or setting in design:
            require_known(f"the design '{name}'", setting, design, StageError)
    values: Any = plain(settings_of(settings, StageError))
    return design_parameters(name, values)


@cache
def _names_of(name: str) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries_of(PARAMETER_SETS[name].parameters))


def _files_in_folder(path: Path) -> list[str]:
    """Return the names of the stage files in the folder of a path."""
    try:
        return [p.name for p in path.parent.iterdir() if p.suffix in (".yaml", ".yml", *DRAWINGS)]
    except (OSError, ValueError):  # no such folder, or a name that none can have
        return []


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long for any file
        return False


# a key with its value, plain or in quotes, and the comment behind it
_COMMENT = re.compile(r"""\w+:\s*(?:'(?:[^']|'')*'|"(?:[^"\\]|\\.)*"|[^'"#].*?)(\s+#.*)""")


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTemplate:
    """A design or a stage file whose parameters are changed often.

    It holds the text of a file, so that it can be sent to another machine.

    Examples
    --------
    >>> template = StageTemplate.of("parallelogram")
    >>> template.stage({"leg_spacing": 0.035}).hinges[0].at[0]
    -0.0175
    """

    source: str
    """Name of the design or path of the file."""
    file: str | None = None
    """Text of the file; None for a built-in design."""
    settings: tuple[tuple[str, str], ...] = ()
    """Parameters with fixed values, as in a file."""

    @classmethod
    def of(cls, source: str | os.PathLike[str], settings: Mapping[str, str] | None = None) -> Self:
        """Return the template of a design, by its name, or of a stage file.

        Raises
        ------
        StageError
            There is neither such a design nor such a file, it is a drawing, or it has no such
            parameter.
        """
        text, short = os.fspath(source), os.fspath(source)[:200]
        if Path(text).suffix.lower() in DRAWINGS and text.casefold() not in DESIGNS:
            raise StageError(
                f"'{short}' is a drawing, whose dimensions are fixed: make a stage file with "
                f"parameters of it first (flexstage import '{short}')"
            )
        find_stage(text, settings or {})
        # as words of a file, in which true and false are small
        pairs = tuple(
            (name, str(v).lower() if isinstance(v, bool) else str(v))
            for name, v in si_settings(text, settings).items()
        )
        if text.casefold() in DESIGNS:
            return cls(source=text.casefold(), settings=pairs)
        file = read_text(Path(text), STAGE_FILE.noun, StageError)
        return cls(source=text, file=file, settings=pairs)

    @property
    def parameters(self) -> tuple[StageParameter, ...]:
        """All parameters, with their present values."""
        return _parameters(self)

    def stage(self, values: Mapping[str, float] | None = None) -> Stage:
        """Return the stage with other values of parameters, in SI units.

        Raises
        ------
        FlexstageError
            The stage is impossible: incompatible dimensions, or an unknown parameter.
        """
        if self.file is None:
            return construct(*_design(self)[:2], self._dimensions(values or {}))
        return stage_from_text(
            self.file,
            build,
            set=dict(self.settings) | self._texts(values or {}),
            source=self.source,
        )

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Return the template with other fixed values of parameters, in SI units."""
        settings = dict(self.settings) | self._texts(values)
        return replace(self, settings=tuple(settings.items()))

    def text(
        self, values: Mapping[str, float], name: str | None = None, title: str | None = None
    ) -> str:
        """Return a stage file of the stage with other values, and another name and title.

        That of a design gives all of its dimensions. A file keeps its text and comments if each
        changed value is in a line of it; otherwise it is written anew.
        """
        words = {k: v for k, v in (("name", name), ("title", title)) if v is not None}
        target = replace(self.stage(values), **words)  # type: ignore[arg-type]
        if self.file is None:
            topology, base, _ = _design(self)
            return _with_name_and_title(
                text_of_dimensions(topology, base, self._dimensions(values)), words
            )
        texts = dict(self.settings) | self._texts(values)
        edited = _edited(self, texts)
        edited = None if edited is None else _with_name_and_title(edited, words)
        if edited is not None:
            try:
                if stage_from_text(edited, build, source=self.source) == target:
                    return edited
            except FlexstageError:
                pass  # a line that was not what it seemed: written out below
        places: list[Any] = []
        parameters_in(self.source, self.file, texts, places.append)
        if places:
            return _with_name_and_title(text_of_dimensions(*places[0]), words)
        return stage_to_text(target, shared=True)

    def _dimensions(self, values: Mapping[str, float]) -> Any:
        return _with(_design(self)[2], values, self.source)

    def _texts(self, values: Mapping[str, float]) -> dict[str, str]:
        by_name = {parameter.name: parameter for parameter in self.parameters}
        texts = {}
        for name, value in values.items():
            require_known(self.source, name, by_name, StageError)
            dimension = by_name[name].dimension
            texts[name] = to_text(value, dimension) if dimension else repr(float(value))
        return texts


@lru_cache(maxsize=32)
def _design(template: StageTemplate) -> tuple[Topology, ParameterSet | None, Any]:
    """Family, built-in design and dimensions of a template of a design, read once."""
    return chosen_design(template.source, dict(template.settings))


@lru_cache(maxsize=32)
def _parameters(template: StageTemplate) -> tuple[StageParameter, ...]:
    return parameters_in(template.source, template.file, dict(template.settings))


def _with(dimensions: Any, values: Mapping[str, float], source: str) -> Any:
    """Return dimensions with other values, also of nested groups, all at once."""
    changes: dict[str, Any] = {}
    groups: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        first, _, rest = name.partition(".")
        require_known(source, first, type(dimensions).__dataclass_fields__, StageError)
        if rest:
            groups.setdefault(first, {})[rest] = value
        else:
            changes[first] = value
    changes |= {n: _with(getattr(dimensions, n), inner, source) for n, inner in groups.items()}
    return replace(dimensions, **changes)


def _edited(template: StageTemplate, texts: Mapping[str, str]) -> str | None:
    """Replace values in a file, each in its line; None where one has no such line."""
    assert template.file is not None
    lines = template.file.splitlines(keepends=True)
    root = parse_yaml(template.file, template.source, STAGE_FILE.noun, StageError)
    for name, text in texts.items():
        place = _place(root, name)
        if place is None or place.line is None:
            return None
        line = lines[place.line - 1]
        before, match, behind = line.partition(place.text)
        if not match or place.text in before + behind:
            return None
        # a comment behind it stays where it stood
        spare = len(behind) - len(behind.lstrip(" "))
        longer = len(text) - len(match)
        behind = " " * -longer * bool(spare) + behind[min(max(longer, 0), max(spare - 1, 0)) :]
        lines[place.line - 1] = before + text + behind
    return "".join(lines)


def _with_name_and_title(text: str, words: Mapping[str, str]) -> str:
    """Set name and title of a stage in a file, in their lines or below its first key."""
    lines = text.splitlines()
    for key, value in words.items():
        line_text = f"{key}: {flow_text(value)}"
        at = [i for i, line in enumerate(lines) if line.startswith(f"{key}:")]
        if at:
            comment = _COMMENT.fullmatch(lines[at[0]])
            lines[at[0]] = line_text + (comment[1] if comment else "")
            # what it has said in more lines goes with it
            while at[0] + 1 < len(lines) and lines[at[0] + 1].startswith((" ", "\t")):
                del lines[at[0] + 1]
        else:
            above = ("name:", f"{STAGE_FILE.key}:") if key == "title" else (f"{STAGE_FILE.key}:",)
            at = [i for a in above for i, line in enumerate(lines) if line.startswith(a)]
            lines.insert(at[0] + 1 if at else 0, line_text)
    end = "\r\n" if "\r\n" in text else "\n"
    return end.join(lines) + end


def _place(root: Node, name: str) -> Scalar | None:
    """Return the position of the value of a parameter in a file."""
    for key, path in ((PARAMETERS, [name]), ("design", name.split("."))):
        node = root
        for part in (key, *path):
            if not isinstance(node, MappingNode) or part not in node.items:
                break
            node = node.items[part]
        else:
            if isinstance(node, MappingNode):  # a value with its description
                node = node.items.get("value", node)
            return node if isinstance(node, Scalar) else None
    return None


_WIDTH = 100
_COLUMN = 34  # where comments begin, at least

_OF_KEYS = {
    "parameters": 'Dimensions of the notches: change one here, or by --set NAME="VALUE". The gap '
    "between two bodies is as long as the notch that fills it.",
    "profiles": "Notch profiles, to which hinges refer by name.",
    "name": "The plate.",
    "bodies": (
        "Outlines exclude the notches: each notch fills the gap between the edges of two bodies."
    ),
    "hinges": (
        "Each joins two bodies: its neck is at a point, its direction is from the first to the "
        "second."
    ),
    "drives": "Each pushes one body and reacts on another, at two points: the pushed one first.",
    "probes": "Each reads the motion of a body at a point, in a direction.",
    "axes": "Each joins its drives and the probe that reads their motion.",
    "published": "Published figures of this stage: delete them when you change it.",
}


def design_text(name: str) -> str:
    """Return a stage file that names a built-in design and gives all of its dimensions.

    Examples
    --------
    >>> print(design_text("parallelogram").splitlines()[0])
    # Parallelogram guide on two legs of notches or leaves.
    """
    base = PARAMETER_SETS[name]
    return text_of_dimensions(base.topology, base, base.parameters)


def text_of_dimensions(topology: Topology, base: ParameterSet | None, dimensions: Any) -> str:
    """Return a stage file that names a family and gives all dimensions.

    `base` is the built-in design that they vary, where there is one.
    """
    lines = [
        *_head(
            topology,
            "All dimensions of the design, with their values: change or delete any of them.",
        ),
        "flexstage: 1",
        "design:",
        f"  name: {topology.name}",
    ]
    if base is not None and base.name != topology.name:
        lines.append(f"  based_on: {base.name}")
    return "\n".join([*lines, *_entries(entries_of(dimensions))]) + "\n"


def spelled_out_text(name: str) -> str:
    """Return a stage file in which the stage of a built-in design is described part by part."""
    note = "Full description of the stage, independent of the design it was made from."
    text = _with_comments(stage_to_text(design(name), shared=True), _OF_KEYS)
    return "\n".join([*_head(PARAMETER_SETS[name].topology, note), text])


def _head(topology: Topology, note: str) -> list[str]:
    title = topology.title
    lines = [
        f"{title[:1].upper()}{title[1:]}" + ("" if title.endswith(".") else "."),
        f"Source: {topology.source.removesuffix('.')}.",
        note,
        "'flexstage check FILE' reports its faults, 'flexstage show FILE' draws it.",
    ]
    return [line for text in lines for line in _comment(text, "")] + [""]


def _comment(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(
        text, _WIDTH, initial_indent=prefix, subsequent_indent=prefix, break_on_hyphens=False
    )


def _entries(entries: Iterable[StageParameter | Group]) -> list[str]:
    """Lines of a mapping of parameters, nested as their names are, with comments."""
    lines = []
    for entry in entries:
        *groups, key = entry.name.split(".")
        indent = "  " * (len(groups) + 1)
        if isinstance(entry, Group):
            lines += [*_comment(entry.description, indent), f"{indent}{key}:"]
            continue
        line = f"{indent}{key}: {entry.text}"
        behind = f"{line:<{_COLUMN}}  # {entry.description.removesuffix('.')}"
        if not entry.description:
            lines.append(line)
        elif len(behind) <= _WIDTH:
            lines.append(behind)
        else:
            lines += [*_comment(entry.description, indent), line]
    return lines


def _with_comments(text: str, comments: Mapping[str, str]) -> str:
    """Insert comments above the outermost keys of a file."""
    lines = []
    for line in text.splitlines():
        comment = comments.get(line.partition(":")[0])
        if comment is not None:
            lines += ["", *_comment(comment, "")]
        lines.append(line)
    return "\n".join(lines) + "\n"
