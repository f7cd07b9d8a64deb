"""Stage files, their format and JSON Schema: YAML with units in the text.

A file begins with ``flexstage: 1``, the version of the format. It either spells the stage out or
names a parametric design. ``length_unit: mm`` at the top gives lengths without a unit one.
"""

import inspect
import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexstage.base.choose import unknown
from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.decoder import Decoder, read
from flexstage.files.encoder import Encoder, Number, same, yaml_text
from flexstage.files.format import DIMENSION_OF_UNIT, Form, Format, check_name, field_types
from flexstage.files.nodes import Mapping as MappingNode
from flexstage.files.nodes import MappingData, Node, Scalar, Sequence, read_text
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.parameters import FileParameter, overridden, require_known, settings_of
from flexstage.files.schema import SchemaBuilder, file_schema
from flexstage.files.write import write_whole
from flexstage.hinges import Profile
from flexstage.hinges.registry import PROFILES
from flexstage.quantities.characteristic import ORIGINS, Characteristic
from flexstage.quantities.material import CATALOGUE, Material, material
from flexstage.quantities.quantity import QUANTITIES
from flexstage.quantities.units import DIMENSIONS, to_text
from flexstage.stage.bench import Bench
from flexstage.stage.bought_parts import bought_drives
from flexstage.stage.copies import (
    COPIES,
    read_with_copies,
    with_profiles_written_out,
    with_shared_profiles,
)
from flexstage.stage.copies import PROFILES as SHARED
from flexstage.stage.drive import DRIVES, AnyActuator, Drive
from flexstage.stage.model import Stage
from flexstage.stage.outline import LARGEST, SMALLEST, Circle, Loop
from flexstage.stage.seat import SEATS, Seat
from flexstage.stage.transform import PlaneMotion

#: The schema that is shipped with the package.
SCHEMA_PATH = Path(__file__).with_name("stage.schema.json")


def _read_material(decoder: Decoder, node: Node, path: str, base: Any) -> Material:
    if isinstance(node, MappingNode):
        return decoder.build(Material, node, path, base=base)
    name = decoder.text(node, path)
    try:
        return material(name)
    except FlexstageError as error:
        decoder.refuse_again(node, path, error)


def _write_material(encoder: Encoder, value: Material) -> Any:
    return value.name if CATALOGUE.get(value.name) == value else encoder.fields(value)


def _material_schema(builder: Any) -> dict[str, Any]:
    # names of the catalogue are not case-sensitive
    pattern = (
        "|".join(
            "".join(f"[{c.upper()}{c.lower()}]" if c.isalpha() else re.escape(c) for c in name)
            for name in CATALOGUE
        )
        .replace(r"\ ", " ")
        .replace(r"\-", "-")
        .replace(r"\<", "<")
        .replace(r"\>", ">")
    )
    return {
        "anyOf": [
            {"enum": list(CATALOGUE)},
            {"type": "string", "pattern": f"^({pattern})$"},
            builder.describe(Material, named=True),
        ]
    }


def _read_characteristic(decoder: Decoder, node: Node, path: str, _base: Any) -> Characteristic:
    entry = decoder.mapping(node, path)
    quantity = entry.items.get("quantity")
    name = decoder.text(quantity, f"{path}.quantity") if quantity else ""
    if quantity is not None and name not in QUANTITIES:
        sentence = unknown("quantity", name, QUANTITIES, 0.5)
        decoder.refuse(quantity, f"{path}.quantity", sentence)
    unit = QUANTITIES[name].unit if name in QUANTITIES else "1"
    fields: dict[str, Any] = {"unit": unit}
    for key in ("value", "uncertainty"):
        value = entry.items.get(key)
        if value is not None and unit != "1":
            dimension = DIMENSIONS[DIMENSION_OF_UNIT[unit]]
            fields[key] = decoder.quantity(dimension, value, f"{path}.{key}")
    others = {k: v for k, v in entry.items.items() if k not in fields or k == "unit"}
    return decoder.build(
        Characteristic, MappingNode(entry.line, others, entry.key_lines), path, fields
    )


def _write_characteristic(encoder: Encoder, value: Characteristic) -> dict[str, Any]:
    out = encoder.fields(value, skip="unit")
    if value.unit != "1":
        for key in ("value", "uncertainty"):
            if (quantity_value := getattr(value, key)) is not None:
                out[key] = to_text(quantity_value, DIMENSION_OF_UNIT[value.unit])
    return out


def _characteristic_schema(builder: Any) -> dict[str, Any]:
    out = builder.describe(Characteristic)
    del out["properties"]["unit"]
    out["required"] = [name for name in out["required"] if name != "unit"]
    out["properties"]["quantity"] = {"enum": list(QUANTITIES)}
    out["properties"]["origin"] = {"enum": list(ORIGINS)}
    for name in ("value", "uncertainty"):
        text = {"type": ["string", "number"], "description": "With its unit, if it has one."}
        out["properties"][name] = text
    return out


_QUANTITY_FORMS: dict[Any, Form] = {
    Material: Form(read=_read_material, write=_write_material, schema=_material_schema),
    Characteristic: Form(
        read=_read_characteristic, write=_write_characteristic, schema=_characteristic_schema
    ),
}


# More than a drawn curve needs; checks of clearance take tens of seconds beyond it.
_MOST_POINTS = 10_000
_LENGTH = DIMENSIONS["length"]


def _read_outline(decoder: Decoder, node: Node, path: str, _base: Any) -> Loop | Circle:
    if isinstance(node, MappingNode):
        return decoder.build(Circle, node, path)
    return _read_loop(decoder, node, path, None)


def _read_loop(decoder: Decoder, node: Node, path: str, _base: Any) -> Loop:
    items = decoder.items(node, path, None, "points")
    if len(items) > _MOST_POINTS:
        decoder.refuse(
            node, path, f"an outline has at most {_MOST_POINTS} points, got {len(items)}: use arcs"
        )
    points = []
    for k, item in enumerate(items):
        where = f"{path}[{k}]"
        if isinstance(item, MappingNode):
            decoder.check_keys(item, where, ["to", "bulge", "through"])
            if "to" not in item.items or len(item.items) != 2:
                decoder.refuse(
                    item,
                    where,
                    "an arc is {to: [x, y], bulge: b} or {to: [x, y], through: [x, y]}",
                )
            points.append(_point(decoder, item.items["to"], f"{where}.to"))
        else:
            points.append(_point(decoder, item, where))
    bulges = [0.0] * len(points)
    for k, item in enumerate(items):
        if not isinstance(item, MappingNode):
            continue
        # an entry says how its point is reached, a bulge how a point is left
        if "bulge" in item.items:
            bulge = decoder.number(item.items["bulge"], f"{path}[{k}].bulge")
        else:
            via = _point(decoder, item.items["through"], f"{path}[{k}].through")
            bulge = _through_to_bulge(points[k - 1], via, points[k])
            if not math.isfinite(bulge):
                decoder.refuse(item, f"{path}[{k}]", "no arc runs through these three points")
        bulges[k - 1] = bulge
    try:
        return Loop(tuple(points), tuple(bulges) if any(bulges) else ())
    except FlexstageError as error:
        decoder.refuse_again(node, path, error)


def _point(decoder: Decoder, node: Node, path: str) -> tuple[float, float]:
    x, y = decoder.items(node, path, 2, "2 coordinates")
    return (
        decoder.own_quantity(_LENGTH, x, f"{path}[0]"),
        decoder.own_quantity(_LENGTH, y, f"{path}[1]"),
    )


def _through_to_bulge(
    start: tuple[float, float], via: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return the bulge of the arc from start to end through a point; infinite if there is none."""
    ax, ay, bx, by = via[0] - start[0], via[1] - start[1], end[0] - via[0], end[1] - via[1]
    # the direction of travel turns by half of the arc's angle between the two chords
    turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return math.tan(0.5 * turn) if abs(turn) < math.pi - 1e-9 else math.inf


def _write_loop(encoder: Encoder, loop: Loop) -> list[Any]:
    out: list[Any] = []
    for k, point in enumerate(loop.points):
        pair = [encoder.coordinate(c, _LENGTH) for c in point]
        bulge = loop.bulges[k - 1] if loop.bulges else 0.0
        straight = same(bulge, 0.0)
        out.append(pair if straight else {"to": pair, "bulge": Number(repr(float(bulge)))})
    return out


def _loop_schema(builder: Any) -> dict[str, Any]:
    point = builder.list_of(builder.quantity(_LENGTH), 2)
    arc = {
        "type": "object",
        "properties": {
            "to": {**point, "description": "End of the arc."},
            "bulge": {
                **builder.of(float),
                "description": "Tangent of a quarter of its angle, positive if it turns left.",
            },
            "through": {**point, "description": "A point on the arc."},
        },
        "additionalProperties": False,
        "required": ["to"],
        "minProperties": 2,
        "maxProperties": 2,
    }
    return {"type": "array", "items": {"anyOf": [point, arc]}, "minItems": 2}


def _read_line(decoder: Decoder, node: Node, path: str, _base: Any) -> PlaneMotion:
    """Read a line of symmetry."""
    what = "a line of symmetry is x, y, {x: 40 mm}, {y: 40 mm} or two points [[0, 0], [1, 1]]"
    if isinstance(node, Sequence):
        ends = [_point(decoder, p, path) for p in decoder.items(node, path, 2, "2 points")]
        (x, y), (u, v) = ends
        if ends[0] == ends[1]:
            decoder.refuse(node, path, f"{what}, and its two points are the same")
        return PlaneMotion.reflection(math.atan2(v - y, u - x), through=(x, y))
    if isinstance(node, MappingNode):
        if len(node.items) != 1 or not node.items.keys() <= {"x", "y"}:
            decoder.refuse(node, path, f"{what}, got the keys {', '.join(node.items) or 'none'}")
        ((axis, place),) = node.items.items()
        at = decoder.own_quantity(_LENGTH, place, f"{path}.{axis}")
        along, through = ("y", (at, 0.0)) if axis == "x" else ("x", (0.0, at))
    elif node.text in ("x", "y"):
        along, through = node.text, (0.0, 0.0)
    else:
        decoder.refuse(node, path, f"{what}, got {decoder.describe(node)}")
    return PlaneMotion.reflection(0.0 if along == "x" else 0.5 * math.pi, through=through)


def _line_schema(builder: Any) -> dict[str, Any]:
    at = builder.quantity(_LENGTH)
    across = {
        "type": "object",
        "properties": {"x": at, "y": at},
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
    }
    two = builder.list_of(builder.list_of(at, 2), 2)
    return {"anyOf": [{"enum": ["x", "y"]}, across, two]}


#: The kind of file that holds a stage.
STAGE_FILE = Format(
    noun="stage file",
    key="flexstage",
    error=StageError,
    length_unit=True,
    parameters=True,
    longest=LARGEST,
    shortest=SMALLEST,
    families={
        Drive: DRIVES,
        Seat: SEATS,
        Profile: PROFILES,
    },
    forms={
        **_QUANTITY_FORMS,
        Loop: Form(read=_read_loop, write=_write_loop, schema=_loop_schema),
        Loop | Circle: Form(read=_read_outline),
        PlaneMotion: Form(read=_read_line, schema=_line_schema),
    },
    bought={Drive: bought_drives, AnyActuator: bought_drives},
)


def stage_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of stage files."""
    schema = file_schema(STAGE_FILE, Stage)
    head, needed = [STAGE_FILE.key, "length_unit", PARAMETERS], schema["required"]
    properties, builder = schema["properties"], SchemaBuilder(STAGE_FILE)
    design = {
        "type": "object",
        "description": "A parametric design by name, with its parameters.",
        "properties": {"name": {"type": "string"}},
        "required": ["name"],
    }
    profiles = {
        "type": "object",
        "description": "Profiles that hinges have by name.",
        "additionalProperties": builder.of(Profile),
    }
    copies = {
        key: {
            "type": "array",
            "items": builder.of(kind),
            "description": (inspect.getdoc(kind) or "").splitlines()[0],
        }
        for key, kind in COPIES.items()
    }
    rest = {key: value for key, value in properties.items() if key not in head}
    only = [*head, "design", *_CALLED, _BENCH]
    definitions = {**builder.definitions, **schema["$defs"]}
    # a hinge has a profile of its own, or one of those by name
    definitions["Hinge"]["properties"]["profile"] = {
        "anyOf": [{"type": "string"}, definitions["Hinge"]["properties"]["profile"]],
        "description": definitions["Hinge"]["properties"]["profile"].pop("description"),
    }
    return {
        **{key: value for key, value in schema.items() if key != "$defs"},
        "properties": {
            **{key: properties[key] for key in head},
            "design": design,
            SHARED: profiles,
            **rest,
            **copies,
        },
        "required": [STAGE_FILE.key],
        "if": {"required": ["design"]},
        "then": {"propertyNames": {"enum": sorted(only)}},
        "else": {"required": [key for key in needed if key not in head]},
        "$defs": dict(sorted(definitions.items())),
    }


#: Builds a stage from the name of a design and its parameters.
DesignBuilder = Callable[[str, Mapping[str, object]], Stage]

_HEAD = ("flexstage", "length_unit", "parameters", "design")
# what a file may call the stage of a design, and what it may add to it
_CALLED = ("name", "title")
_BENCH = "bench"
_GROUP_OF_NOUN = {"hinge": "hinges", "drive": "drives", "probe": "probes", "axis": "axes"}


def read_stage(
    path: str | os.PathLike[str],
    designs: DesignBuilder | None = None,
    *,
    set: Mapping[str, object] | None = None,
) -> Stage:
    """Read a stage file.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters, such as
        ``flexstage.stage.designs.build``; without it a file with ``design:`` is refused.
    set : mapping, optional
        Parameters of its design by name, with dots for those of a group, and values as the file
        has them; they replace those in the file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    FlexstageError
        There is no such file, or it does not describe a possible stage; the message has file, line
        and key.
    """
    text = read_text(Path(path), STAGE_FILE.noun, StageError)
    return stage_from_text(text, designs, set=set, source=os.fspath(path))


def stage_from_text(
    text: str,
    designs: DesignBuilder | None = None,
    *,
    set: Mapping[str, object] | None = None,
    source: str = "stage file",
) -> Stage:
    """Read a stage from the text of a stage file.

    Parameters
    ----------
    text : str
        The text.
    designs : callable, optional
        Builds a stage from the name of a design and its parameters.
    set : mapping, optional
        Parameters by name, as `read_stage` takes them.
    source : str
        Name of the text in messages.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    FlexstageError
        The text does not describe a possible stage.

    Examples
    --------
    >>> stage = stage_from_text('''
    ... flexstage: 1
    ... length_unit: mm
    ... name: plate
    ... thickness: 8 mm
    ... material: Al 7075-T6
    ... bodies:
    ...   base: {fixed: true, outline: [[0, 0], [30, 0], [30, 20], [0, 20]]}
    ... ''')
    >>> stage.body("base").outline.points[2]
    (0.03, 0.02)
    """
    decoder, root = read(text, source, STAGE_FILE, settings_of(set or {}, StageError))
    if "design" in root.items:
        decoder.check_keys(root, "", (*_HEAD, *_CALLED, _BENCH))
        designed_stage = _from_design(decoder, root.items["design"], designs)
        words: dict[str, Any] = {
            key: decoder.text(root.items[key], key) for key in _CALLED if key in root.items
        }
        if "name" in words:
            check_name(words["name"], lambda text: decoder.refuse(root.items["name"], "name", text))
        if _BENCH in root.items:
            words[_BENCH] = decoder.decode(Bench | None, root.items[_BENCH], _BENCH)
        return replace(designed_stage, **words) if words else designed_stage
    for name in decoder.settings.items:
        require_known(source, name, decoder.parameters, StageError)
    also = (*_HEAD, SHARED, *COPIES)
    decoder.check_keys(root, "", [*also, *field_types(Stage)])
    root = with_profiles_written_out(decoder, root)
    parts: dict[str, Any] = {}
    origins: dict[tuple[str, str], tuple[int | None, str]] = {}
    if COPIES.keys() & root.items.keys():
        parts, origins = read_with_copies(decoder, root)
    # the names are looked up by the stage itself, which does not know lines: find them again
    try:
        stage = decoder.build(Stage, root, "", parts, also=(*also, *parts))
    except FlexstageError as error:
        raise _placed(error, decoder, root, origins) from None
    check_name(stage.name, lambda text: decoder.refuse(root.items["name"], "name", text))
    return stage


def file_parameters(
    text: str,
    designs: Callable[[str, Mapping[str, object]], object],
    *,
    set: Mapping[str, object] | None = None,
    source: str = "stage file",
) -> dict[str, FileParameter]:
    """Return the parameters of a stage file; `designs` is given the design that it may name."""
    decoder, root = read(text, source, STAGE_FILE, settings_of(set or {}, StageError))
    if "design" in root.items:
        _from_design(decoder, root.items["design"], designs)
    return decoder.parameters


def stage_to_text(stage: Stage, *, shared: bool = False) -> str:
    """Write a stage as the text of a stage file.

    Parameters
    ----------
    stage : Stage
        The stage.
    shared : bool
        Whether each profile is written once, under a name that its hinges have, with its dimensions
        as parameters of the file.

    Returns
    -------
    str
        YAML that `stage_from_text` reads back to the same bits.

    Raises
    ------
    StageError
        A name could not be read back.
    """
    for thing in (stage, *stage.bodies, *stage.hinges, *stage.drives, *stage.probes, *stage.axes):
        check_name(thing.name, _refuse_name)
    encoder = Encoder(STAGE_FILE, DIMENSIONS["length"].units[0])
    return yaml_text(with_shared_profiles(encoder, stage) if shared else encoder.document(stage))


def write_stage(stage: Stage, path: str | os.PathLike[str], *, shared: bool = False) -> None:
    """Write a stage file; it appears complete or not at all.

    Parameters
    ----------
    stage : Stage
        The stage.
    path : str or os.PathLike
        The file; an existing one is replaced.
    shared : bool
        Whether profiles are shared and have parameters, as in `stage_to_text`.

    Raises
    ------
    StageError
        The file cannot be written, or a name could not be read back.
    """
    write_whole(path, stage_to_text(stage, shared=shared).encode("utf-8"), StageError)


def _from_design(
    decoder: Decoder, node: Node, designs: Callable[[str, Mapping[str, object]], Any] | None
) -> Any:
    if not isinstance(node, MappingNode) or not isinstance(node.items.get("name"), Scalar):
        decoder.refuse(node, "design", "expected a mapping with the name of a design")
    if designs is None:
        decoder.refuse(node, "design", "parametric designs are not available here")
    name = node.items["name"]
    for key in ("name", "based_on"):
        if key in decoder.settings.items:
            raise StageError(
                f"'{key}' of a design is not a parameter: change it in {decoder.source}"
            )
    rest = {key: value for key, value in node.items.items() if key != "name"}
    entry = overridden(MappingNode(node.line, rest, node.key_lines), decoder.settings)
    settings = MappingData(entry, decoder)
    try:
        return designs(name.text if isinstance(name, Scalar) else "", settings)
    except FlexstageError as error:
        # the parameter that is at fault is named in the message: point at its line
        culprit = next(
            (k for k in node.items if f"'{k}'" in str(error) or f"{k}:" in str(error)), None
        )
        place = node if culprit is None else node.items[culprit]
        decoder.refuse_again(place, "design", error)


def _placed(
    error: FlexstageError,
    decoder: Decoder,
    root: MappingNode,
    origins: Mapping[tuple[str, str], tuple[int | None, str]],
) -> FlexstageError:
    """Attribute an error of the whole stage to the part that it concerns."""
    text = str(error)
    start = f"{decoder.source}, line {root.line}: "
    if not text.startswith(start):
        return error
    text = text.removeprefix(start)
    if match := re.match(r"(hinge|drive|probe|axis) '(.*?)' ", text):
        group = root.items.get(_GROUP_OF_NOUN[match[1]])
        if (copied := (_GROUP_OF_NOUN[match[1]], match[2])) in origins:
            line, path = origins[copied]
            return type(error)(f"{decoder.source}, line {line}, {path}: {text}")
        if isinstance(group, MappingNode) and match[2] in group.key_lines:
            path = f"{_GROUP_OF_NOUN[match[1]]}.{match[2]}"
            return type(error)(
                f"{decoder.source}, line {group.key_lines[match[2]]}, {path}: {text}"
            )
    return error


def _refuse_name(message: str) -> None:
    raise StageError(message)
