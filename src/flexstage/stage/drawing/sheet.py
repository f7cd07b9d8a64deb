"""Sheets of drawings: lines and arcs of a DXF file, or of the face of a plate in a STEP file."""

import itertools
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import unknown
from flexstage.base.errors import StageError
from flexstage.stage.curve import Curve
from flexstage.stage.drawing.strokes import Pair, circle_of

if TYPE_CHECKING:
    from netgen.occ import TopoDS_Shape

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
    """The words."""
    at: Pair
    """Start of the text [m]."""
    layer: str
    """Layer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Contents of a drawing, in metres."""

    curves: tuple[tuple[Curve, str], ...]
    """Lines and arcs of contours, each with its layer."""
    unit: float
    """Unit of the drawing [m]."""
    unit_name: str
    """Name of the unit."""
    arrows: tuple[tuple[Curve, str], ...] = ()
    """Lines on the layers of drives and probes, each with its layer."""
    words: tuple[Word, ...] = ()
    """Texts on those layers."""
    rounding: float = 0.0
    """Largest rounding error of a coordinate in the file [m]."""
    excluded: tuple[tuple[str, int], ...] = ()
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
    excluded: Counter[str] = Counter()
    entities = [
        e for e in _flat(document.modelspace(), excluded) if _visible(document, e, excluded)
    ]
    is_contour = _choice(entities, layers)
    curves: list[tuple[Curve, str]] = []
    arrows: list[tuple[Curve, str]] = []
    words: list[Word] = []
    for entity in entities:
        layer = str(entity.dxf.layer)
        marks = layer.upper() in (DRIVES_LAYER, PROBES_LAYER)
        kind = entity.dxftype()
        if kind in ("TEXT", "MTEXT"):
            if marks:
                at = entity.dxf.insert
                text = entity.plain_text()
                words.append(Word(str(text).strip(), (at.x * scale, at.y * scale), layer.upper()))
            else:
                excluded["text"] += 1
        elif marks:
            arrows += [(c, layer.upper()) for c in _curves(entity, scale, excluded)]
        elif not is_contour(entity):
            excluded[f"{kind.lower()} on layer {layer}"] += 1
        else:
            curves += [(c, layer) for c in _curves(entity, scale, excluded)]
    if not curves:
        have = ", ".join(sorted({str(e.dxf.layer) for e in entities})) or "none"
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
        excluded=tuple(sorted(excluded.items())),
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
        if any(_keeps_values(longest, form) for form in forms):
            exact_format = any(_keeps_values(values.tolist(), form) for form in forms)
            rounding = 0.5 * 10.0 ** (decade + 1 - digits) * scale
            return rounding if exact_format and _ALL_DIGITS < rounding <= _TOO_FEW else 0.0
    return 0.0


def _keeps_values(values: list[float], form: str) -> bool:
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


def _flat(
    entities: Iterable[Any], excluded: Counter[str], layer: str | None = None
) -> Iterator[Any]:
    """Yield entities, those of blocks in their places; dimensions and hatches are not divided."""
    for entity in entities:
        # layer 0 of a block is that of its reference
        if layer is not None and entity.dxf.layer == "0":
            entity.dxf.layer = layer
        if entity.dxftype() == "INSERT":
            for one in entity.multi_insert() if entity.mcount > 1 else (entity,):
                yield from _flat(one.virtual_entities(), excluded, str(entity.dxf.layer))
        elif entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
            if entity.dxftype() == "POLYLINE" and not (
                entity.is_2d_polyline or entity.is_3d_polyline
            ):
                excluded["mesh"] += 1
                continue
            for piece in entity.virtual_entities():
                piece.dxf.layer = entity.dxf.layer
                yield piece
        else:
            yield entity


def _visible(document: Any, entity: Any, excluded: Counter[str]) -> bool:
    name = str(entity.dxf.layer)
    hidden = bool(entity.dxf.get("invisible", 0))
    if name in document.layers:
        layer = document.layers.get(name)
        hidden |= layer.is_off() or layer.is_frozen()
    if hidden:
        excluded["hidden"] += 1
    return not hidden


def _choice(entities: list[Any], layers: Iterable[str] | None) -> Any:
    """Return the test whether an entity belongs to a contour."""
    contour_kinds = {"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"}
    have = {str(e.dxf.layer).upper() for e in entities if e.dxftype() in contour_kinds}
    if layers is not None:
        layer_names = {name.strip().upper() for name in layers}
        for name in sorted(layer_names - have):
            raise StageError(unknown("layer with lines", name, sorted(have)))
        return lambda e: str(e.dxf.layer).upper() in layer_names
    if _OWN_LAYERS[0] in have and have & set(_OWN_LAYERS[1:]):
        return lambda e: str(e.dxf.layer).upper() in _OWN_LAYERS

    def is_contour(entity: Any) -> bool:
        layer, line = str(entity.dxf.layer).lower(), str(entity.dxf.get("linetype", "")).lower()
        return not (
            any(word in layer for word in _OTHER_LAYERS)
            or any(word in line for word in _OTHER_LINES)
        )

    return is_contour


def _curves(entity: Any, scale: float, excluded: Counter[str]) -> list[Curve]:
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
        excluded[kind.lower()] += 1
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


_SAMPLES = 65  # points of an edge that tell what it is
_CURVE_POINTS = 257  # points of an edge that is neither line nor arc
_SAME = 1e-6  # of lengths, areas and volumes, in parts of them
_EXACT = 1e-8  # points of a line or an arc are off by less [m]
_CANDIDATES = 40  # largest faces that may be the plate's


def read_step_plate(path: str | os.PathLike[str]) -> Sheet:
    """Read the edges of the face of a plate, and its thickness.

    A plate that lies across an axis of the file keeps its coordinates: x and y where it lies
    across z, y and z across x, z and x across y.
    """
    from flexstage.elasticity.step_file import in_step_file

    return in_step_file(Path(path), _sheet, path)


def _sheet(shape: "TopoDS_Shape", path: str | os.PathLike[str]) -> Sheet:
    from flexstage.elasticity.shapes import METRE

    solids = list(shape.solids)
    if len(solids) != 1:
        raise StageError(
            f"'{path}' contains {len(solids)} solids instead of one plate: export the plate alone"
        )
    solid = solids[0]
    faces = sorted(solid.faces, key=lambda f: -f.mass)[:_CANDIDATES]
    for face in faces:
        axes_and_thickness = _as_plate(solid, face, faces)
        if axes_and_thickness is not None:
            axes, thickness = axes_and_thickness
            curves = [
                (Curve(a, b, bulge), "")
                for edge in face.edges
                for a, b, bulge in _pieces(_points(edge, _SAMPLES), edge, axes, METRE)
            ]
            return Sheet(
                curves=tuple(curves), unit=1e-3, unit_name="mm", thickness=thickness / METRE
            )
    raise StageError(
        f"the solid in '{path}' is not a plate of constant thickness: it has no two equal, "
        "parallel faces with all material between them; 'flexstage part' analyses such parts in "
        "three dimensions"
    )


def _points(edge: Any, count: int) -> Array:
    first, last = edge.parameter_interval
    points = [edge.Value(first + (last - first) * k / (count - 1)) for k in range(count)]
    return np.array([(p.x, p.y, p.z) for p in points])


def _as_plate(
    solid: "TopoDS_Shape", face: Any, faces: list[Any]
) -> tuple[tuple[Array, Array], float] | None:
    """Return the axes in a face and the thickness [mm] if the solid is its extrusion."""
    edges = list(face.edges)
    # the tip of a cone is an edge without a curve, which the kernel cannot walk along
    if not all(e.mass > 0.0 for e in edges):
        return None
    points = np.vstack([_points(e, 9) for e in edges])
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if sizes[2] > _SAME * sizes[0]:
        return None
    normal = np.asarray(axes[2], dtype=np.float64)
    thickness = round(float(solid.mass / face.mass), 9)
    twin = any(
        abs(other.mass - face.mass) < _SAME * face.mass
        and abs(abs((_centre(other) - _centre(face)) @ normal) - thickness) < 1e-5 * thickness
        and np.hypot(*np.cross(_centre(other) - _centre(face), normal)[:2]) < _SAME * sizes[0]
        for other in faces
    )
    if not twin:
        return None
    # all of the solid lies between the two
    corners = np.array([(v.p.x, v.p.y, v.p.z) for v in solid.vertices])
    height = (corners - middle) @ normal
    if float(np.ptp(height)) > thickness * (1.0 + 1e-5):
        return None
    k = int(np.argmax(np.abs(normal)))
    if abs(normal[k]) > 1.0 - 1e-12:
        unit = np.eye(3)
        return (unit[(k + 1) % 3], unit[(k + 2) % 3]), thickness
    normal = normal * math.copysign(1.0, normal[k])
    v = np.cross(normal, np.eye(3)[(k + 1) % 3]).astype(float)
    v = v / math.sqrt(float(v @ v))
    return (np.cross(v, normal).astype(float), v), thickness


def _centre(face: Any) -> Array:
    c = face.center
    return np.array([c.x, c.y, c.z])


def _pieces(
    points: Array, edge: Any, axes: tuple[Array, Array], metre: float
) -> list[tuple[tuple[float, float], tuple[float, float], float]]:
    """Return an edge as a line, as arcs, or as a polyline [m]."""

    def flat(points: Array) -> Array:
        return np.column_stack([points @ axes[0], points @ axes[1]]) / metre

    plane = flat(points)
    at = [(x, y) for x, y in plane.tolist()]
    chord = plane[-1] - plane[0]
    length = float(np.hypot(*chord))
    if length > 0.0:
        off = (plane - plane[0]) @ np.array([-chord[1], chord[0]]) / length
        if float(np.max(np.abs(off))) < _EXACT:
            return [(at[0], at[-1], 0.0)]
    centre, _, off = circle_of(plane)
    if off < _EXACT:
        angles = np.unwrap(np.arctan2(*(plane - np.array(centre)).T[::-1]))
        sweep = float(angles[-1] - angles[0])
        half = _SAMPLES // 2
        ends = [0, half, _SAMPLES - 1] if abs(sweep) > 1.5 * math.pi else [0, _SAMPLES - 1]
        pieces = []
        for a, b in itertools.pairwise(ends):
            bulge = math.tan(0.25 * float(angles[b] - angles[a]))
            pieces.append((at[a], at[b], bulge))
        return pieces
    fine = [(x, y) for x, y in flat(_points(edge, _CURVE_POINTS)).tolist()]
    return [(a, b, 0.0) for a, b in itertools.pairwise(fine)]
