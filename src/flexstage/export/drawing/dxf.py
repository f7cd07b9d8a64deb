"""DXF file of a stage for wire cutting: closed contours with arcs, on named layers."""

import contextlib
import io
import math
from collections.abc import Iterator
from typing import Any

from flexstage.base.errors import StageError
from flexstage.base.version import __version__
from flexstage.export.drawing.canvas import millimetres
from flexstage.export.drawing.contours import Pair, PlateContours, plate_contours
from flexstage.export.drawing.wire import CUT_ORDER_RULE, Cut, cuts, offset_contours
from flexstage.export.request import StageExport
from flexstage.files.names import file_name
from flexstage.hinges.profile import ARC_TOLERANCE, CurvedProfile
from flexstage.stage import Circle, Loop, Stage

#: Layers by name: content, colour index, line width in 1/100 mm.
DXF_LAYERS: dict[str, tuple[str, int, int]] = {
    "OUTLINE": ("outer contour of the plate", 7, 50),
    "SLOTS": ("slots between bodies, and openings", 7, 50),
    "HOLES": ("mounting holes, to be drilled", 4, 35),
    "HINGES": ("necks of the hinges from surface to surface, with names", 3, 18),
    "WIRE_PATH": ("centre of the wire", 1, 25),
    "START_HOLES": ("holes for threading the wire", 5, 25),
    "LEAD_IN": ("lead-in from each start hole to the wire path", 6, 18),
    "CUT_ORDER": ("number of each cut", 2, 18),
    "DIMENSIONS": ("overall dimensions of the plate", 8, 18),
    "NOTES": ("title and notes", 8, 18),
}

_MM = 1e3
_DECIMALS = 3  # of a dimension [mm]
_START_HOLE = 1e-3  # m


def dxf_files(stage: Stage, *, kerf: float | None = None) -> dict[str, bytes]:
    """Return the drawing of a stage for wire cutting.

    ``NAME.dxf`` is of version R2010, in millimetres, with the layers of `DXF_LAYERS`. Contours are
    closed polylines with bulges for arcs, or circles. The kerf is the width of the cut [m]: wire
    diameter plus both spark gaps. With a kerf, the path of the wire centre is drawn too, with start
    holes, lead-in lines and cutting order. Start holes have a diameter of 1 mm, or the width of a
    wider cut.

    Notes
    -----
    Validity: coordinates have all digits of a double. Profiles other than lines and arcs are arcs
    with common tangents within 10 nm. The same stage gives the same bytes; the dates in the file
    are constant.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> files = dxf_files(design("parallelogram"), kerf=0.3e-3)
    >>> list(files), b"WIRE_PATH" in files["parallelogram.dxf"]
    (['parallelogram.dxf'], True)
    """
    plate = plate_contours(stage)
    if kerf is not None and not 0.0 < kerf < math.inf:
        raise StageError(f"the kerf must be positive and finite, got {kerf!r} m")
    start_hole = max(_START_HOLE, kerf or 0.0)
    wire_cuts: tuple[Cut, ...] = ()
    if kerf is not None:
        paths = offset_contours(plate, 0.5 * kerf)
        wire_cuts = cuts(plate, paths, 0.5 * kerf, start_hole)
    with _fixed_dates():
        document = _document()
        space = document.modelspace()
        for contour in plate.contours:
            layer = {"outline": "OUTLINE", "slot": "SLOTS", "hole": "HOLES"}[contour.kind]
            _polyline(space, contour.loop, contour.circle, layer)
        size = _extent(plate)
        _hinges(space, plate, 0.006 * size)
        for cut in wire_cuts:
            _cut(space, cut, start_hole, 0.012 * size)
        _dimensions(space, plate, start_hole if wire_cuts else 0.0)
        _words(space, stage, plate, kerf, start_hole)
        _view(document, space)
        content = _written(document)
    return {f"{file_name(stage.name)}.dxf": content}


def _document() -> Any:
    from ezdxf import units
    from ezdxf.filemanagement import new

    document = new("R2010", units=units.MM)
    document.header["$MEASUREMENT"] = 1
    document.header["$LUNITS"] = 2
    document.header["$LUPREC"] = 6
    # for programs without dimension styles: three decimals after a point
    document.header["$DIMDSEP"], document.header["$DIMDEC"] = ord("."), _DECIMALS
    document.header["$LWDISPLAY"] = 1
    for name, (description, colour, width) in DXF_LAYERS.items():
        layer = document.layers.add(name, color=colour, lineweight=width)
        layer.description = description
    return document


def _view(document: Any, space: Any) -> None:
    """Set the extents of the drawing, and a view of the entire drawing."""
    from ezdxf import bbox

    box = bbox.extents(space, fast=True)
    space.reset_extents(box.extmin, box.extmax)
    # for a window of 16:9
    height = max(box.size.y, box.size.x * 9.0 / 16.0)
    document.set_modelspace_vport(1.1 * height, center=(box.center.x, box.center.y))


def _mm(p: Pair) -> Pair:
    return p[0] * _MM, p[1] * _MM


def _polyline(space: Any, loop: Loop, circle: Circle | None, layer: str) -> None:
    attributes = {"layer": layer}
    if circle is not None:
        space.add_circle(_mm(circle.centre), circle.radius * _MM, dxfattribs=attributes)
        return
    points = [(*_mm(start), bulge) for start, _, bulge in loop.segments()]
    space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=attributes)


def _text(space: Any, text: str, at: Pair, height: float, layer: str) -> None:
    """Add a line of text; `at` and `height` are in millimetres."""
    # two percent signs would start a special character
    plain = text.replace("%%", "% %")
    space.add_text(plain, height=height, dxfattribs={"layer": layer, "insert": at})


def _extent(plate: PlateContours) -> float:
    """Return the larger side of the plate [mm]."""
    (x0, y0), (x1, y1) = _bounds(plate)
    return max(x1 - x0, y1 - y0)


def _bounds(plate: PlateContours) -> tuple[Pair, Pair]:
    """Return the corners of the plate [mm]."""
    x0, y0, x1, y1 = plate.outline.loop.bounds()
    return _mm((x0, y0)), _mm((x1, y1))


def _hinges(space: Any, plate: PlateContours, height: float) -> None:
    for neck in plate.necks:
        right, left = _mm(neck.right), _mm(neck.left)
        space.add_line(right, left, dxfattribs={"layer": "HINGES"})
        _text(space, neck.hinge, (left[0] + 0.3 * height, left[1]), height, "HINGES")


def _cut(space: Any, cut: Cut, start_hole: float, height: float) -> None:
    _polyline(space, cut.path.loop, cut.path.circle, "WIRE_PATH")
    start = _mm(cut.start)
    radius = 0.5 * start_hole * _MM
    space.add_circle(start, radius, dxfattribs={"layer": "START_HOLES"})
    space.add_line(start, _mm(cut.entry), dxfattribs={"layer": "LEAD_IN"})
    _text(
        space,
        str(cut.number),
        (start[0] + 1.3 * radius, start[1] - 0.5 * height),
        height,
        "CUT_ORDER",
    )


def _dimensions(space: Any, plate: PlateContours, start_hole: float) -> None:
    """Add the dimensions of width and height, clear of a start hole outside the plate."""
    (x0, y0), (x1, y1) = _bounds(plate)
    height = 0.012 * _extent(plate)
    away = 5.0 * height + 4.0 * start_hole * _MM
    space.doc.dimstyles.new(
        "PLATE",
        dxfattribs={
            "dimtxt": height,  # letters
            "dimasz": height,  # arrows
            "dimexe": 0.5 * height,  # extension lines beyond the dimension line
            "dimexo": 0.3 * height,  # and off the plate
            "dimgap": 0.3 * height,
            "dimtad": 1,  # text above the line, and along it
            "dimtih": 0,
            "dimtoh": 0,
            "dimdec": _DECIMALS,  # a point before them, no zeros at their end
            "dimdsep": ord("."),
            "dimzin": 8,
        },
    )
    corner, attributes = (x0, y1), {"layer": "DIMENSIONS"}
    for base, start, end, angle in (
        ((x0, y1 + away), corner, (x1, y1), 0.0),
        ((x0 - away, y1), (x0, y0), corner, 90.0),
    ):
        dimension = space.add_linear_dim(
            base, start, end, angle=angle, dimstyle="PLATE", dxfattribs=attributes
        )
        dimension.render()


def _words(
    space: Any, stage: Stage, plate: PlateContours, kerf: float | None, start_hole: float
) -> None:
    """Add title and notes below the plate."""
    (x0, y0), _ = _bounds(plate)
    height = 0.012 * _extent(plate)
    lines = [f"{label}: {text}" for label, text in _title_lines(stage)]
    if kerf is not None:
        lines.append(f"Kerf: {millimetres(kerf)} mm")
    lines += _notes(stage, kerf=kerf, start_hole=start_hole, order=CUT_ORDER_RULE)
    y = y0 - 4.0 * height
    for line in lines:
        _text(space, line, (x0, y), height, "NOTES")
        y -= 1.7 * height


@contextlib.contextmanager
def _fixed_dates() -> Iterator[None]:
    """Suppress time and random identifiers of the library in the file."""
    from ezdxf import options

    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _written(document: Any) -> bytes:
    # the library registers used types in the order of a set, which differs between runs
    for kind in sorted(document.entitydb.dxf_types_in_use()):
        document.classes.add_class(kind)
    stream = io.StringIO()
    document.write(stream)
    return document.encode(stream.getvalue())


def _title_lines(stage: Stage) -> list[tuple[str, str]]:
    """Return label and text of each line of the title block."""
    return [
        ("Stage", stage.name),
        ("Title", stage.title or "-"),
        ("Material", stage.materials),
        ("Thickness", f"{millimetres(stage.thickness)} mm"),
        ("Units", "mm"),
        ("Software", f"flexstage {__version__}"),
    ]


def _notes(stage: Stage, *, kerf: float | None, start_hole: float, order: str) -> list[str]:
    """Return the notes of a drawing."""
    profiles = {h.profile.kind for h in stage.hinges if isinstance(h.profile, CurvedProfile)}
    lines = ["Contours are those of the finished part; mounting holes are drilled."]
    if profiles:
        lines.append(
            f"Notches ({', '.join(sorted(profiles))}): arcs within {ARC_TOLERANCE * 1e9:.0f} nm of "
            "the profile, with common tangents."
        )
    if kerf is None:
        lines.append("No wire path: the workshop sets the wire offset.")
    else:
        lines += [
            f"WIRE_PATH is the path of the wire centre in the waste, {millimetres(0.5 * kerf)} mm "
            f"from the contour, for a kerf of {millimetres(kerf)} mm (wire and both spark gaps).",
            f"Internal corners have a fillet of {millimetres(0.5 * kerf)} mm.",
            f"Start holes: diameter {millimetres(start_hole)} mm, one for each closed contour.",
            f"Cutting order: {order}.",
        ]
    return lines


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return dxf_files(stage_export.stage, kerf=stage_export.request.kerf)
