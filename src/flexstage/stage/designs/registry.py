"""Stages by name: those that are built in, and the families that stage files build from."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import StageError
from flexstage.files.decoder import Decoder
from flexstage.files.format import field_types, required
from flexstage.files.nodes import MappingData, node_of
from flexstage.stage import Stage
from flexstage.stage.designs.amplifiers import BRIDGE, RHOMBUS
from flexstage.stage.designs.bridge_xy import BRIDGE_XY
from flexstage.stage.designs.gantry import GANTRY
from flexstage.stage.designs.lever_chain import LEVER_CHAIN
from flexstage.stage.designs.nested_xy import NESTED_XY
from flexstage.stage.designs.parallelogram import (
    COMPOUND_PARALLELOGRAM,
    DOUBLE_PARALLELOGRAM,
    LINKED_PARALLELOGRAM,
    PARALLELOGRAM,
)
from flexstage.stage.designs.parameters import ParameterSet, Topology
from flexstage.stage.designs.pivots import CARTWHEEL, TRAPEZOIDAL_PIVOT
from flexstage.stage.designs.scott_russell import SCOTT_RUSSELL
from flexstage.stage.designs.three_rrr import THREE_RRR
from flexstage.stage.designs.two_guides import SIDE_BY_SIDE_XY, STACKED_XY
from flexstage.stage.designs.vgtu import MECHANICAL, PIEZO
from flexstage.stage.file import STAGE_FILE

# designs that a message names
_SHOWN = 3

#: Parametric families.
TOPOLOGIES: dict[str, Topology] = {
    topology.name: topology
    for topology in (
        NESTED_XY,
        PARALLELOGRAM,
        DOUBLE_PARALLELOGRAM,
        COMPOUND_PARALLELOGRAM,
        LINKED_PARALLELOGRAM,
        GANTRY,
        CARTWHEEL,
        TRAPEZOIDAL_PIVOT,
        SIDE_BY_SIDE_XY,
        STACKED_XY,
        BRIDGE,
        RHOMBUS,
        BRIDGE_XY,
        SCOTT_RUSSELL,
        LEVER_CHAIN,
        THREE_RRR,
    )
}

#: Built-in stages for stage files to start from: two that are known, and the usual one of a family.
PARAMETER_SETS: dict[str, ParameterSet] = {
    known.name: known
    for known in (
        MECHANICAL,
        PIEZO,
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
    if isinstance(given, MappingData):  # in a file, whose lines are known
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
