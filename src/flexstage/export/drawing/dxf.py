"""A stage as a DXF file for wire cutting: closed contours with arcs, on named layers."""

import contextlib
import io
from collections.abc import Iterator
from typing import Any

from flexstage.base.version import __version__
from flexstage.export.drawing.canvas import millimetres
from flexstage.export.drawing.contours import Pair, PlateContours, plate_contours
from flexstage.export.drawing.wire import CUT_ORDER_RULE, Cut, cuts, offset_contours
from flexstage.export.request import StageExport
from flexstage.files.names import file_name
from flexstage.hinges.profile import ARC_TOLERANCE, CurvedProfile
from flexstage.stage import Circle, Loop, Stage

#: Layers by name: what they hold, colour index, line width in 1/100 mm.
DXF_LAYERS: dict[str, tuple[str, int, int]] = {
    "OUTLINE": ("outer contour of the plate", 7, 50),
    "SLOTS": ("slots between bodies, and openings", 7, 50),
    "HOLES": ("mounting holes, to be drilled", 4, 35),
    "HINGES": ("necks of the hinges, from surface to surface, and their names", 3, 18),
    "WIRE_PATH": ("centre of the wire", 1, 25),
    "START_HOLES": ("holes for threading the wire", 5, 25),
    "LEAD_IN": ("from each start hole to the wire path", 6, 18),
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
    closed polylines whose arcs are bulges, full circles are circles. The kerf is the width of the
    cut [m]: diameter of the wire and both spark gaps. Where given, the path of the wire's centre is
    drawn as well, with start holes, lead-in lines and order of cutting. Start holes have a diameter
    of 1 mm, or the width of a wider cut.

    Notes
    -----
    Validity: coordinates carry all digits of a double. Profiles that are neither lines nor arcs are
    drawn as arcs with common tangents within 10 nm. The same stage gives the same bytes; the dates
    in the file are fixed.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> files = dxf_files(design("parallelogram"), kerf=0.3e-3)
    >>> list(files), b"WIRE_PATH" in files["parallelogram.dxf"]
    (['parallelogram.dxf'], True)
    """
    plate = plate_contours(stage)
    start_hole = max(_START_HOLE, kerf or 0.0)
    made: tuple[Cut, ...] = ()
    if kerf is not None:
        paths = offset_contours(plate, 0.5 * kerf)
        made = cuts(plate, paths, 0.5 * kerf, start_hole)
    with _fixed_dates():
        document = _document()
        space = document.modelspace()
        for contour in plate.contours:
            layer = {"outline": "OUTLINE", "slot": "SLOTS", "hole": "HOLES"}[contour.kind]
            _polyline(space, contour.loop, contour.circle, layer)
        size = _extent(plate)
        _hinges(space, plate, 0.006 * size)
        for cut in made:
            _cut(space, cut, start_hole, 0.012 * size)
        _dimensions(space, plate, start_hole if made else 0.0)
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
    # programs that have no styles take these: three decimals, behind a point
    document.header["$DIMDSEP"], document.header["$DIMDEC"] = ord("."), _DECIMALS
    document.header["$LWDISPLAY"] = 1
    for name, (description, colour, width) in DXF_LAYERS.items():
        layer = document.layers.add(name, color=colour, lineweight=width)
        layer.description = description
    return document


def _view(document: Any, space: Any) -> None:
    """Say how far the drawing reaches, and open it as a whole."""
    from ezdxf import bbox

    box = bbox.extents(space, fast=True)
    space.reset_extents(box.extmin, box.extmax)
    # of a window as wide as most screens are
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
    """Write a line of text; `at` and `height` in millimetres."""
    # a percent sign twice would start a special character
    plain = text.replace("%%", "% %")
    space.add_text(plain, height=height, dxfattribs={"layer": layer, "insert": at})


def _extent(plate: PlateContours) -> float:
    """Larger side of the plate [mm]."""
    (x0, y0), (x1, y1) = _bounds(plate)
    return max(x1 - x0, y1 - y0)


def _bounds(plate: PlateContours) -> tuple[Pair, Pair]:
    """Corners of the plate [mm]."""
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
    """Dimension width and height, above and at the left, clear of a start hole beside the plate."""
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
        made = space.add_linear_dim(
            base, start, end, angle=angle, dimstyle="PLATE", dxfattribs=attributes
        )
        made.render()


def _words(
    space: Any, stage: Stage, plate: PlateContours, kerf: float | None, start_hole: float
) -> None:
    """Write title and notes below the plate."""
    (x0, y0), _ = _bounds(plate)
    height = 0.012 * _extent(plate)
    lines = [f"{label}: {text}" for label, text in _title_lines(stage)]
    if kerf is not None:
        lines.append(f"Cut: {millimetres(kerf)} mm wide")
    lines += _notes(stage, kerf=kerf, start_hole=start_hole, order=CUT_ORDER_RULE)
    y = y0 - 4.0 * height
    for line in lines:
        _text(space, line, (x0, y), height, "NOTES")
        y -= 1.7 * height


@contextlib.contextmanager
def _fixed_dates() -> Iterator[None]:
    """Keep the time and random identifiers, which the library would write, out of the file."""
    from ezdxf import options  # pyright: ignore[reportPrivateImportUsage]

    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _written(document: Any) -> bytes:
    # the library registers what is used in the order of a set, which differs from run to run
    for kind in sorted(document.entitydb.dxf_types_in_use()):
        document.classes.add_class(kind)
    stream = io.StringIO()
    document.write(stream)
    return document.encode(stream.getvalue())


def _title_lines(stage: Stage) -> list[tuple[str, str]]:
    """Return what stands in the title block: label and text of each line."""
    return [
        ("Stage", stage.name),
        ("Title", stage.title or "-"),
        ("Material", stage.material.name),
        ("Thickness", f"{millimetres(stage.thickness)} mm"),
        ("Units", "mm"),
        ("Made by", f"flexstage {__version__}"),
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
        lines.append("No wire path: the shop sets the offset.")
    else:
        lines += [
            f"WIRE_PATH is the centre of the wire, {millimetres(0.5 * kerf)} mm inside the waste, "
            f"for a cut {millimetres(kerf)} mm wide (wire and both spark gaps).",
            f"Re-entrant corners keep a fillet of {millimetres(0.5 * kerf)} mm.",
            f"Start holes: diameter {millimetres(start_hole)} mm, one for each closed cut.",
            f"Order of cutting: {order}.",
        ]
    return lines


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return dxf_files(given.stage, kerf=given.request.kerf)
