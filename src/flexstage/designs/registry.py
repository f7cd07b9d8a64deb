"""Stages by name: those that are built in, and the families that stage files build from."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.choose import did_you_mean, nearest
from flexstage.designs import vgtu_mechanical, vgtu_piezo
from flexstage.designs.parameters import StageParameter, entries_of
from flexstage.designs.topology import ParameterSet, Topology
from flexstage.errors import StageError
from flexstage.files.decoder import Decoder
from flexstage.files.expression import dimension_named
from flexstage.files.format import field_types, required
from flexstage.files.nodes import Given, node_of, plain, read_text
from flexstage.files.settings import require_known, settings_of
from flexstage.stage import Stage
from flexstage.stage.drawing.endings import DRAWINGS
from flexstage.stage.format import STAGE_FILE

if TYPE_CHECKING:
    from flexstage.stage.drawing.drawn_stage import DrawingOptions

# designs that a message names
_SHOWN = 3

# a family is a module with a TOPOLOGY
_FAMILIES = (
    "nested_xy",
    "parallelogram",
    "double_parallelogram",
    "compound_parallelogram",
    "linked_parallelogram",
    "gantry",
    "cartwheel",
    "trapezoidal_pivot",
    "side_by_side_xy",
    "stacked_xy",
    "bridge",
    "rhombus",
    "bridge_xy",
    "scott_russell",
    "lever_chain",
    "three_rrr",
)

#: Parametric families.
TOPOLOGIES: dict[str, Topology] = {
    topology.name: topology
    for topology in (import_module(f"flexstage.designs.{f}").TOPOLOGY for f in _FAMILIES)
}

#: Built-in stages for stage files to start from: two that are known, and the usual one of a family.
PARAMETER_SETS: dict[str, ParameterSet] = {
    known.name: known
    for known in (
        vgtu_mechanical.PARAMETER_SET,
        vgtu_piezo.PARAMETER_SET,
        *filter(None, (topology.usual() for topology in TOPOLOGIES.values())),
    )
}

#: What builds each of them.
DESIGNS: dict[str, Callable[[], Stage]] = {
    name: known.construct for name, known in PARAMETER_SETS.items()
}


def design(name: str) -> Stage:
    """Return a built-in stage; it is built once.

    Parameters
    ----------
    name : str
        One of `DESIGNS`, upper or lower case.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is no such design; the nearest name is in the message.

    Examples
    --------
    >>> len(design("vgtu-piezo").bodies)
    21
    """
    return _built(known_design(name))


def build(name: str, parameters: Mapping[str, object]) -> Stage:
    """Build a stage of a parametric family from plain data, as a stage file gives it.

    Parameters
    ----------
    name : str
        One of `TOPOLOGIES`; or one of `DESIGNS`, from which all other dimensions are then taken.
    parameters : mapping
        Dimensions by name, as texts with units, nested as the dataclass of the family is; and
        ``based_on``, the name of the built-in design from which all others are taken.

    Returns
    -------
    Stage
        The stage. One that differs from the design it is based on carries none of its published
        figures, and says what it varies.

    Raises
    ------
    StageError
        An unknown family, design or parameter (with the nearest name), or impossible dimensions.
    UnitError
        A quantity has no unit, or a wrong one.

    Examples
    --------
    >>> longer = {"based_on": "vgtu-piezo", "x": {"lever_arm_input": "9.5 mm"}}
    >>> build("nested-xy", longer).hinge("xful-u").at[1]
    0.02134
    """
    return construct(*chosen(name, parameters))


def construct(topology: Topology, known: ParameterSet | None, dimensions: Any) -> Stage:
    """Build a stage of a family; `known` is the built-in design that its dimensions vary."""
    if known is None:
        return topology.construct(dimensions)
    if dimensions == known.parameters:
        return design(known.name)
    return replace(
        topology.construct(dimensions),
        name=f"{known.name}-variation",
        notes=(
            f"A variation of {known.name}: figures published for that stage do not belong to it.",
        ),
    )


def chosen(
    name: str, parameters: Mapping[str, object]
) -> tuple[Topology, ParameterSet | None, Any]:
    """Return the family, the built-in design that is varied, if any, and the dimensions."""
    name = _known("design", name, {**DESIGNS, **TOPOLOGIES})
    base_name = parameters.get("based_on")
    if name not in TOPOLOGIES:
        known = PARAMETER_SETS[name]
        if base_name is not None:
            raise StageError(
                f"'based_on' goes with a parametric design, such as '{known.topology.name}', got "
                f"'{name}': name that, or leave 'based_on' out"
            )
        name, base_name = known.topology.name, name
    topology = TOPOLOGIES[name]
    if base_name is None:
        usual = topology.usual()
        base = None if usual is None else usual.parameters
        return topology, None, _dimensions(topology, parameters, base)
    if not isinstance(base_name, str):
        raise StageError(f"'based_on' must be the name of a built-in design, got {base_name!r:.60}")
    base_name = _known("built-in design", base_name, PARAMETER_SETS)
    known = PARAMETER_SETS[base_name]
    if known.topology is not topology:
        raise StageError(
            f"'{base_name}' is a {known.topology.name} design and cannot be the base of a "
            f"{topology.name} one"
        )
    return topology, known, _dimensions(topology, parameters, known.parameters)


def _dimensions(topology: Topology, given: Mapping[str, object], base: Any) -> Any:
    """Read dimensions; those that are not given are those of a base, where there is one."""
    node, path = node_of(given), ""
    decoder = Decoder(f"the design '{topology.name}'", STAGE_FILE)
    if isinstance(given, Given):  # in a file, whose lines are known
        decoder, path = given.decoder, "design"
    missing = [
        name
        for name, (field, _) in field_types(topology.parameters).items()
        if base is None and required(field) and name not in given
    ]
    if missing:
        decoder.refuse(
            node,
            path,
            f"'{missing[0]}' is missing: give it, or name a design to start from in 'based_on'",
        )
    mapping = decoder.mapping(node, path)
    return decoder.build(topology.parameters, mapping, path, base=base, also=["based_on"])


@cache
def _built(name: str) -> Stage:
    return DESIGNS[name]()


def some_of(names: Iterable[str]) -> str:
    """Return the first of many names for a message, and where the others are listed."""
    first, more = list(names)[:_SHOWN], "'flexstage new' lists all"
    return f"{', '.join(first)}, ...; {more}"


def known_design(name: str) -> str:
    """Return the name of a built-in design as it is registered; refuse one that there is not."""
    return _known("built-in design", name, DESIGNS)


def _known(noun: str, name: str, names: Iterable[str]) -> str:
    """Return a name as it is registered."""
    wanted = name.strip().casefold()
    if wanted in set(names):
        return wanted
    hint = did_you_mean(wanted, names, 0.3)
    raise StageError(f"there is no {noun} '{name[:60]}' (there are: {some_of(names)}){hint}")


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
        values as a stage file has them: ``{"x.lever_neck": "0.45 mm"}``.
    drawing : DrawingOptions, optional
        What is to be known of a drawing beyond its file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, the file is no stage, or it has no such
        parameter.

    Examples
    --------
    >>> find_stage("vgtu-piezo").name
    'vgtu-piezo'
    >>> find_stage("parallelogram", {"leg_spacing": "35 mm"}).hinges[0].at[0]
    -0.0175
    """
    text = os.fspath(source)
    if drawing is not None and Path(text).suffix.lower() not in DRAWINGS:
        raise StageError(
            f"what is said of a drawing belongs to one ({', '.join(DRAWINGS)}), got '{text[:200]}'"
        )
    if text.casefold() in DESIGNS:
        return _design_with(text.casefold(), set) if set else design(text)
    path = _file(text)
    if path.suffix.lower() in DRAWINGS:
        from flexstage.stage.drawing.drawn_stage import DrawingOptions, stage_of_drawing

        for name in set or {}:
            require_known(f"the drawing '{text}'", name, (), StageError)
        return stage_of_drawing(path, drawing or DrawingOptions())
    from flexstage.stage.file import read_stage

    return read_stage(path, designs=build, set=set)


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
        There is neither such a design nor such a file, or the file is no stage.

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
    designed: Callable[[tuple[Topology, ParameterSet | None, Any]], None] | None = None,
) -> tuple[StageParameter, ...]:
    """Return the parameters of a built-in design, or of the text of a file, some of them set.

    `designed` is told family, built-in design and dimensions of the design that a file names.
    """
    if file is None:
        return _in_design(chosen_design(source, set or {})[2])
    from flexstage.stage.file import file_parameters

    dimensions: list[Any] = []

    def named(name: str, given: Mapping[str, object]) -> None:
        found = chosen(name, given)
        dimensions.append(found[2])
        if designed is not None:
            designed(found)

    own = file_parameters(file, named, set=set, source=source)
    return (
        *(
            StageParameter(
                name=name,
                value=float(found.amount.value),
                dimension=dimension_named(found.amount.powers) or "",
                text=found.text,
                description=found.description,
            )
            for name, found in own.items()
        ),
        *(parameter for found in dimensions for parameter in _in_design(found)),
    )


def _in_design(dimensions: Any) -> tuple[StageParameter, ...]:
    return tuple(e for e in entries_of(dimensions) if isinstance(e, StageParameter))


def _file(text: str) -> Path:
    """Return the path of a stage file that is there."""
    path = Path(text)
    if not text or not _exists(path):
        # a file that lies there, by another ending or a letter less, before a design of such a name
        beside = _files_beside(path)
        file = nearest(path.name, beside, 0.7)
        near = str(path.with_name(file)) if file else nearest(text, DESIGNS, 0.4)
        hint = f"did you mean '{near}'?" if near else f"the designs are {some_of(DESIGNS)}"
        raise StageError(f"no built-in design and no file is called '{text[:200]}': {hint}")
    return path


def _design_with(name: str, settings: Mapping[str, object]) -> Stage:
    return construct(*chosen_design(name, settings))


def chosen_design(
    name: str, settings: Mapping[str, object]
) -> tuple[Topology, ParameterSet | None, Any]:
    """Return family, built-in design and dimensions of a design with settings."""
    known = _names_of(name)
    # another kind of what stands there has parameters of its own, which are checked as in a file
    anew = tuple(setting.removesuffix("kind") for setting in settings if setting.endswith(".kind"))
    for setting in settings:
        if not setting.startswith(anew or ("kind",)) or setting in known:
            require_known(f"the design '{name}'", setting, known, StageError)
    given: Any = plain(settings_of(settings, StageError))
    return chosen(name, given)


@cache
def _names_of(name: str) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries_of(PARAMETER_SETS[name].parameters))


def _files_beside(path: Path) -> list[str]:
    """Names of the stage files in the folder that a path is in."""
    try:
        return [p.name for p in path.parent.iterdir() if p.suffix in (".yaml", ".yml", *DRAWINGS)]
    except (OSError, ValueError):  # no such folder, or a name that none can have
        return []


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long for any file
        return False
