"""Stages by name: built-in stages, and the families on which stage files are based."""

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
_LISTED = 3

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

#: Built-in stages on which stage files can be based: two published ones, and the default of each
#: family.
PARAMETER_SETS: dict[str, ParameterSet] = {
    known.name: known
    for known in (
        MECHANICAL,
        PIEZO,
        *filter(None, (topology.usual() for topology in TOPOLOGIES.values())),
    )
}

#: Function that builds each of them.
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
    return _cached_stage(known_design(name))


def build(name: str, parameters: Mapping[str, object]) -> Stage:
    """Build a stage of a parametric family from plain data, as a stage file gives it.

    Parameters
    ----------
    name : str
        One of `TOPOLOGIES`; or one of `DESIGNS`, for all other dimensions.
    parameters : mapping
        Dimensions by name, as texts with units, nested as the dataclass of the family is; and
        ``based_on``, the name of the built-in design for all others.

    Returns
    -------
    Stage
        The stage. A stage that differs from its base has none of its published figures, and a note
        with the base.

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
    return construct(*design_parameters(name, parameters))


def construct(topology: Topology, base: ParameterSet | None, dimensions: Any) -> Stage:
    """Build a stage of a family; `base` is the built-in design that its dimensions vary."""
    if base is None:
        return topology.construct(dimensions)
    if dimensions == base.parameters:
        return design(base.name)
    return replace(
        topology.construct(dimensions),
        name=f"{base.name}-variation",
        notes=(f"Variation of {base.name}: figures published for that stage do not apply.",),
    )


def design_parameters(
    name: str, parameters: Mapping[str, object]
) -> tuple[Topology, ParameterSet | None, Any]:
    """Return the family, the built-in design that is varied, if any, and the dimensions."""
    name = _registered_name("design", name, {**DESIGNS, **TOPOLOGIES})
    base_name = parameters.get("based_on")
    if name not in TOPOLOGIES:
        parameter_set = PARAMETER_SETS[name]
        if base_name is not None:
            raise StageError(
                "'based_on' needs a parametric design, such as "
                f"'{parameter_set.topology.name}', got '{name}': name that design, or remove "
                "'based_on'"
            )
        name, base_name = parameter_set.topology.name, name
    topology = TOPOLOGIES[name]
    if base_name is None:
        usual = topology.usual()
        base = None if usual is None else usual.parameters
        return topology, None, _dimensions(topology, parameters, base)
    if not isinstance(base_name, str):
        raise StageError(f"'based_on' must be the name of a built-in design, got {base_name!r:.60}")
    base_name = _registered_name("built-in design", base_name, PARAMETER_SETS)
    parameter_set = PARAMETER_SETS[base_name]
    if parameter_set.topology is not topology:
        raise StageError(
            f"'{base_name}' is a {parameter_set.topology.name} design and cannot be the base of a "
            f"{topology.name} one"
        )
    return topology, parameter_set, _dimensions(topology, parameters, parameter_set.parameters)


def _dimensions(topology: Topology, settings: Mapping[str, object], base: Any) -> Any:
    """Read dimensions; missing ones are those of a base, where there is one."""
    node, path = node_of(settings), ""
    decoder = Decoder(f"the design '{topology.name}'", STAGE_FILE)
    if isinstance(settings, MappingData):  # in a file, whose lines are known
        decoder, path = settings.decoder, "design"
    missing = [
        name
        for name, (field, _) in field_types(topology.parameters).items()
        if base is None and required(field) and name not in settings
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
def _cached_stage(name: str) -> Stage:
    return DESIGNS[name]()


def some_of(names: Iterable[str]) -> str:
    """Return the first of many names for a message, and a reference to the others."""
    first, more = list(names)[:_LISTED], "'flexstage new' lists all"
    return f"{', '.join(first)}, ...; {more}"


def known_design(name: str) -> str:
    """Return the name of a built-in design as registered; refuse an unknown one."""
    return _registered_name("built-in design", name, DESIGNS)


def _registered_name(noun: str, name: str, names: Iterable[str]) -> str:
    """Return a name as registered."""
    folded = name.strip().casefold()
    if folded in set(names):
        return folded
    hint = did_you_mean(folded, names, 0.3)
    raise StageError(f"there is no {noun} '{name[:60]}' (there are: {some_of(names)}){hint}")
