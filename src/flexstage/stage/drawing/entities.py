"""The lines, arcs and curves of a DXF file, also those within blocks."""

import itertools
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from flexstage.base.choose import unknown
from flexstage.base.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.strokes import Pair

#: Units of drawings, by their names [m].
UNITS: dict[str, float] = {
    "um": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "inch": 25.4e-3,
    "mil": 25.4e-6,
}
# what $INSUNITS stands for (DXF reference, header variables)
_HEADER_UNITS = {1: "inch", 4: "mm", 5: "cm", 6: "m", 9: "mil", 13: "um"}

#: Layers whose arrows are drives and probes.
DRIVES_LAYER, PROBES_LAYER = "DRIVES", "PROBES"
# layers of the contours in drawings that flexstage writes
_OWN_LAYERS = ("OUTLINE", "SLOTS", "HOLES")
# parts of the names of layers, and of line types, that hold no contours
_OTHER_LAYERS = (
    *("dim", "text", "note", "hatch", "cent", "axis", "axes", "constr", "hidden", "border"),
    *("title", "defpoints", "viewport", "vport", "sketch", "wire_path", "start_holes", "lead_in"),
    *("cut_order", "hinges", "mass", "bemass", "hilfs", "mitte", "schraff"),
)
_OTHER_LINES = ("center", "hidden", "phantom", "dashdot", "dashed", "mitte", "verdeckt")

_CURVE = 0.1e-6  # corners of splines and ellipses are so close that chords are off by less [m]
# rounding that matters, and that which only round numbers can have [m]
_ALL_DIGITS, _TOO_FEW = 1e-9, 3e-6
_FLAT = 1e-6  # a direction is that of the plane to this


class Word(NamedTuple):
    """A text of a drawing."""

    text: str
    """Its words."""
    at: Pair
    """Where it begins [m]."""
    layer: str
    """Its layer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Contents of a drawing, in metres."""

    curves: tuple[tuple[Curve, str], ...]
    """Lines and arcs of contours, each with its layer."""
    unit: float
    """Unit of the drawing [m]."""
    unit_name: str
    """Its name."""
    arrows: tuple[tuple[Curve, str], ...] = ()
    """Lines on the layers of drives and probes, each with its layer."""
    words: tuple[Word, ...] = ()
    """Its texts on those layers."""
    rounding: float = 0.0
    """Largest rounding error of a coordinate in the file [m]."""
    left_out: tuple[tuple[str, int], ...] = ()
    """Kinds of excluded entities, and the number of each."""
    thickness: float | None = None
    """Thickness of the plate [m]; None of a DXF file."""


def read_dxf(
    path: str | os.PathLike[str], *, unit: str | None = None, layers: Iterable[str] | None = None
) -> Sheet:
    """Read the lines, arcs and curves of the contours in a DXF file.

    `unit` is one of `UNITS`, and counts where the file does not give its own; `layers` are those of
    the contours. Where none are named they are those that flexstage writes, or else all but those
    whose names or line types mark them as something else.
    """
    document = _document(Path(path))
    name = _HEADER_UNITS.get(int(document.header.get("$INSUNITS", 0) or 0))
    if unit is not None and unit not in UNITS:
        raise StageError(unknown("unit of a drawing", unit, UNITS))
    name = unit or name
    if name is None:
        raise StageError(
            f"the drawing '{path}' does not give its unit ($INSUNITS): give --contours unit=UNIT, "
            f"one of {', '.join(UNITS)}"
        )
    scale = UNITS[name]
    left: Counter[str] = Counter()
    found = [e for e in _flat(document.modelspace(), left) if _visible(document, e, left)]
    chosen = _choice(found, layers)
    curves: list[tuple[Curve, str]] = []
    arrows: list[tuple[Curve, str]] = []
    words: list[Word] = []
    for entity in found:
        layer = str(entity.dxf.layer)
        marks = layer.upper() in (DRIVES_LAYER, PROBES_LAYER)
        kind = entity.dxftype()
        if kind in ("TEXT", "MTEXT"):
            if marks:
                at = entity.dxf.insert
                text = entity.plain_text()
                words.append(Word(str(text).strip(), (at.x * scale, at.y * scale), layer.upper()))
            else:
                left["text"] += 1
        elif marks:
            arrows += [(c, layer.upper()) for c in _curves(entity, scale, left)]
        elif not chosen(entity):
            left[f"{kind.lower()} on layer {layer}"] += 1
        else:
            curves += [(c, layer) for c in _curves(entity, scale, left)]
    if not curves:
        have = ", ".join(sorted({str(e.dxf.layer) for e in found})) or "none"
        raise StageError(
            f"the drawing '{path}' has no contour on the requested layers (its layers are: "
            f"{have}): name those of the contours by --contours layers=NAMES"
        )
    return Sheet(
        curves=tuple(curves),
        unit=scale,
        unit_name=name,
        arrows=tuple(arrows),
        words=tuple(words),
        rounding=_rounding(curves, scale),
        left_out=tuple(sorted(left.items())),
    )


def _rounding(curves: list[tuple[Curve, str]], scale: float) -> float:
    """Return the error of coordinates that were written with few digits; 0 where they have all.

    Programs write so many significant digits, or so many decimals. Where even the longest numbers
    have few, they may be exact round figures: then no rounding is assumed.
    """
    import numpy as np

    values = np.unique([abs(v) / scale for c, _ in curves for p in c[:2] for v in p])
    largest = float(values[-1]) if len(values) else 0.0
    if largest <= 0.0:
        return 0.0
    decade = math.floor(math.log10(largest))
    # the longest numbers show how many digits there are, and then all must have no more: of
    # significant ones, or of decimals
    longest = values[values >= 10.0**decade].tolist()
    for digits in range(1, 13):
        forms = (f".{digits}g", f".{max(digits - decade - 1, 0)}f")
        if any(_written(longest, form) for form in forms):
            known = any(_written(values.tolist(), form) for form in forms)
            found = 0.5 * 10.0 ** (decade + 1 - digits) * scale
            return found if known and _ALL_DIGITS < found <= _TOO_FEW else 0.0
    return 0.0


def _written(values: list[float], form: str) -> bool:
    """Return whether numbers keep their value in a format."""
    return all(abs(float(f"{v:{form}}") - v) <= 1e-13 * v for v in values)


def _document(path: Path) -> Any:
    from ezdxf import recover
    from ezdxf.lldxf.const import DXFError

    if not path.is_file():
        raise StageError(f"there is no drawing '{path}'")
    try:
        return recover.readfile(str(path))[0]
    except (DXFError, UnicodeError, ValueError, KeyError, IndexError, OSError) as error:
        raise StageError(
            f"'{path}' cannot be read as a DXF file ({str(error).strip() or 'damaged'}): save the "
            "drawing as DXF again"
        ) from error


def _flat(entities: Iterable[Any], left: Counter[str], layer: str | None = None) -> Iterator[Any]:
    """Yield entities, those of blocks in their places; dimensions and hatches are not divided."""
    for entity in entities:
        # layer 0 of a block is that of its reference
        if layer is not None and entity.dxf.layer == "0":
            entity.dxf.layer = layer
        if entity.dxftype() == "INSERT":
            for one in entity.multi_insert() if entity.mcount > 1 else (entity,):
                yield from _flat(one.virtual_entities(), left, str(entity.dxf.layer))
        elif entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
            if entity.dxftype() == "POLYLINE" and not (
                entity.is_2d_polyline or entity.is_3d_polyline
            ):
                left["mesh"] += 1
                continue
            for piece in entity.virtual_entities():
                piece.dxf.layer = entity.dxf.layer
                yield piece
        else:
            yield entity


def _visible(document: Any, entity: Any, left: Counter[str]) -> bool:
    name = str(entity.dxf.layer)
    hidden = bool(entity.dxf.get("invisible", 0))
    if name in document.layers:
        layer = document.layers.get(name)
        hidden |= layer.is_off() or layer.is_frozen()
    if hidden:
        left["hidden"] += 1
    return not hidden


def _choice(entities: list[Any], layers: Iterable[str] | None) -> Any:
    """Return the test whether an entity belongs to a contour."""
    drawn = {"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"}
    have = {str(e.dxf.layer).upper() for e in entities if e.dxftype() in drawn}
    if layers is not None:
        wanted = {name.strip().upper() for name in layers}
        for name in sorted(wanted - have):
            raise StageError(unknown("layer with lines", name, sorted(have)))
        return lambda e: str(e.dxf.layer).upper() in wanted
    if _OWN_LAYERS[0] in have and have & set(_OWN_LAYERS[1:]):
        return lambda e: str(e.dxf.layer).upper() in _OWN_LAYERS

    def is_contour(entity: Any) -> bool:
        layer, line = str(entity.dxf.layer).lower(), str(entity.dxf.get("linetype", "")).lower()
        return not (
            any(word in layer for word in _OTHER_LAYERS)
            or any(word in line for word in _OTHER_LINES)
        )

    return is_contour


def _curves(entity: Any, scale: float, left: Counter[str]) -> list[Curve]:
    """Return the lines and arcs of an entity [m]."""
    kind = entity.dxftype()
    if kind == "LINE":
        corners = [entity.dxf.start, entity.dxf.end]
    elif kind in ("ARC", "CIRCLE"):
        _refuse_tilted(entity)
        return _bows(entity, scale)
    elif kind == "ELLIPSE":
        _refuse_tilted(entity)
        tool = entity.construction_tool()
        corners = list(tool.flattening(_CURVE / scale, 16))
    elif kind == "SPLINE":
        tool = entity.construction_tool()
        corners = list(tool.flattening(_CURVE / scale, 8))
    else:
        left[kind.lower()] += 1
        return []
    points = [(p.x * scale, p.y * scale) for p in corners]
    return [Curve(a, b) for a, b in itertools.pairwise(points) if a != b]


def _bows(entity: Any, scale: float) -> list[Curve]:
    """Return an arc, or the two halves of a circle; also on the mirrored side of the plane."""
    centre, radius = entity.dxf.center, float(entity.dxf.radius)
    first, sweep = 0.0, 2.0 * math.pi
    if entity.dxftype() == "ARC":
        first = math.radians(entity.dxf.start_angle)
        sweep = math.radians((entity.dxf.end_angle - entity.dxf.start_angle) % 360.0) or sweep
    parts = 2 if sweep > 1.5 * math.pi else 1
    ocs = entity.ocs()
    mirrored = entity.dxf.extrusion.z < 0.0

    def at(angle: float) -> Pair:
        x, y = centre.x + radius * math.cos(angle), centre.y + radius * math.sin(angle)
        p = ocs.to_wcs((x, y, centre.z))
        return p.x * scale, p.y * scale

    bulge = math.tan(0.25 * sweep / parts) * (-1.0 if mirrored else 1.0)
    ends = [at(first + sweep * k / parts) for k in range(parts + 1)]
    if parts == 2 and sweep == 2.0 * math.pi:
        ends[-1] = ends[0]
    return [Curve(a, b, bulge) for a, b in itertools.pairwise(ends)]


def _refuse_tilted(entity: Any) -> None:
    normal = entity.dxf.extrusion
    if math.hypot(normal.x, normal.y) > _FLAT * abs(normal.z):
        raise StageError(
            f"the drawing contains a {entity.dxftype().lower()} that does not lie in the plane "
            f"(its normal is {normal.x:.3g}, {normal.y:.3g}, {normal.z:.3g}): give a flat "
            "drawing, or the plate as a STEP file"
        )
