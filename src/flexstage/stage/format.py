"""The kind of file that holds a stage, how outlines are written in it, and its JSON Schema."""

import inspect
import math
from pathlib import Path
from typing import Any

from flexstage.errors import FlexstageError, StageError
from flexstage.files.decoder import Decoder
from flexstage.files.encoder import Encoder, same
from flexstage.files.format import Form, Format
from flexstage.files.forms import FORMS
from flexstage.files.nodes import Mapping, Node, Sequence
from flexstage.files.parameters import KEY as PARAMETERS
from flexstage.files.schema import SchemaBuilder, file_schema
from flexstage.files.yaml_text import Number
from flexstage.hinges import Profile
from flexstage.hinges.registry import PROFILES
from flexstage.stage.drive import DRIVES, Drive
from flexstage.stage.model import Stage
from flexstage.stage.outline import LARGEST, SMALLEST, Circle, Loop
from flexstage.stage.transform import PlaneMotion
from flexstage.units import DIMENSIONS

#: The schema that is shipped with the package.
SCHEMA_PATH = Path(__file__).with_name("stage.schema.json")


# More than a drawn curve needs; checks of clearance take tens of seconds beyond it.
_MOST_POINTS = 10_000
_LENGTH = DIMENSIONS["length"]


def _read_outline(decoder: Decoder, node: Node, path: str, _base: Any) -> Loop | Circle:
    if isinstance(node, Mapping):
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
        if isinstance(item, Mapping):
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
        if not isinstance(item, Mapping):
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
            "to": {**point, "description": "Where the arc ends."},
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
    if isinstance(node, Mapping):
        if len(node.items) != 1 or not node.items.keys() <= {"x", "y"}:
            decoder.refuse(node, path, f"{what}, got the keys {', '.join(node.items) or 'none'}")
        ((axis, place),) = node.items.items()
        at = decoder.own_quantity(_LENGTH, place, f"{path}.{axis}")
        along, through = ("y", (at, 0.0)) if axis == "x" else ("x", (0.0, at))
    elif node.text in ("x", "y"):
        along, through = node.text, (0.0, 0.0)
    else:
        decoder.refuse(node, path, f"{what}, got {decoder.shown(node)}")
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
        Profile: PROFILES,
    },
    forms={
        **FORMS,
        Loop: Form(read=_read_loop, write=_write_loop, schema=_loop_schema),
        Loop | Circle: Form(read=_read_outline),
        PlaneMotion: Form(read=_read_line, schema=_line_schema),
    },
)


def stage_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of stage files."""
    from flexstage.stage.copies import COPIES
    from flexstage.stage.copies import PROFILES as SHARED

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
    only = [*head, "design", "name", "title"]
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
