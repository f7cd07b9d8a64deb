"""STEP file of the plate of a stage as a solid, for CAD, CAM and other finite elements."""

import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from flexstage.base.errors import StageError
from flexstage.base.version import __version__
from flexstage.export.request import StageExport
from flexstage.files.names import file_name
from flexstage.stage import Circle, Hinge, Loop, Stage
from flexstage.stage.contour import body_contour

if TYPE_CHECKING:
    from netgen.occ import TopoDS_Shape

_SAME_SIZE = 1e-9  # relative, of an area before and after faces are joined
_ON_FACE = 1e-5  # tolerance of a point on a face [mm]
_TIME = "1970-01-01T00:00:00"  # of every file


def step_files(stage: Stage) -> dict[str, bytes]:
    """Return the plate of a stage as a STEP file.

    Bodies and notches are one solid without seams. Arcs are exact cylinders and straight edges
    planes; the two sides of each neck are faces named after the hinge.

    ``NAME.step`` is ISO 10303-21 text, application protocol 214, in millimetres. The plate extends
    from z = -thickness/2 to thickness/2, so that z = 0 is its middle plane, as in every file of
    flexstage. The time in its header is constant, so that the same stage gives the same bytes.

    Notes
    -----
    Validity: the nominal shape, without wire radius and tolerances; coordinates have 13 digits.
    Other profiles than arcs and lines, such as ellipses, are arcs with common tangents within
    10 nm. Masses mounted on bodies are not included. A body without a hinge to the others is a
    separate solid.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> files = step_files(design("parallelogram"))
    >>> files["parallelogram.step"].count(b"= CYLINDRICAL_SURFACE(")
    10
    """
    # numbers replace names until the text is complete: the kernel breaks long lines, even within
    # a multi-byte character
    names: list[str] = []
    text = _written(_solids(stage, names))
    text = re.sub(r"'flexstage(\d+)name'", lambda match: _quoted(names[int(match[1])]), text)
    return {f"{file_name(stage.name)}.step": _headed(text, stage).encode("ascii")}


# ------------------------------------------------------------------ the shape


def _solids(stage: Stage, names: list[str]) -> "list[TopoDS_Shape]":
    """Return the solids, and append the names of solids and faces to a list."""
    from netgen.occ import Fuse, Z

    from flexstage.elasticity.shapes import METRE

    parts, total = [], 0.0
    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        shape, area = _face(body.name, outline, (*holes, *body.mounting_holes))
        parts.append(shape)
        total += area
    fused = Fuse(parts) if len(parts) > 1 else parts[0]
    # remove seams, and vertices within straight edges
    joined = fused.UnifySameDomain(unifyEdges=True, unifyFaces=True, concatBSplines=False)
    faces = list(joined.faces)
    area = sum(f.mass for f in faces) / METRE**2
    if abs(area - total) > _SAME_SIZE * total:
        raise StageError(
            f"bodies or notches of stage '{stage.name}' overlap: together they cover "
            f"{area * 1e6:.6g} mm^2 instead of {total * 1e6:.6g} mm^2; run 'flexstage check'"
        )
    solids = []
    for number, plane in enumerate(faces, start=1):
        half = 0.5 * stage.thickness * METRE
        solid = plane.Move((0.0, 0.0, -half)).Extrude(2.0 * half, Z).solids[0]
        solid.name = _token(names, stage.name if len(faces) == 1 else f"{stage.name} {number}")
        solids.append(solid)
    _name_necks(stage.hinges, [f for s in solids for f in s.faces], names)
    return solids


def _face(body: str, outline: Loop, holes: Iterable[Loop | Circle]) -> "tuple[TopoDS_Shape, float]":
    """Return a body as one face, and its area [m^2] in closed form."""
    from flexstage.elasticity import face

    shape, area = face(outline.points, outline.bulges), outline.integrals().area
    for hole in holes:
        loop = hole.loop() if isinstance(hole, Circle) else hole
        shape = shape - face(loop.points, loop.bulges)
        area -= loop.integrals().area
    if len(shape.faces) != 1:
        raise StageError(
            f"body '{body}' is in {len(shape.faces)} pieces after its holes are cut: run "
            "'flexstage check' for details"
        )
    return shape.faces[0], area


def _name_necks(hinges: Iterable[Hinge], faces: "list[TopoDS_Shape]", names: list[str]) -> None:
    """Name the faces on both sides of each neck, for loads and mesh refinement elsewhere."""
    from netgen.occ import Pnt, Vertex

    from flexstage.elasticity.shapes import METRE

    boxes = [f.bounding_box for f in faces]
    for hinge in hinges:
        half = 0.5 * hinge.profile.neck_thickness
        for side, across in (("left", half), ("right", -half)):
            x, y = (METRE * c for c in hinge.to_plane(0.0, across))
            at = Vertex(Pnt(x, y, 0.0))
            for shape, (low, high) in zip(faces, boxes, strict=True):
                inside = all(
                    lo - _ON_FACE <= c <= hi + _ON_FACE
                    for c, lo, hi in ((x, low.x, high.x), (y, low.y, high.y))
                )
                if inside and at.Distance(shape) < _ON_FACE:
                    shape.name = _token(names, f"{hinge.name} neck {side}")


def _token(names: list[str], name: str) -> str:
    """Append a name, and return its placeholder in the text of the kernel."""
    names.append(name)
    return f"flexstage{len(names) - 1}name"


# ------------------------------------------------------------------ the text


def _written(solids: "list[TopoDS_Shape]") -> str:
    from netgen.occ import Compound

    shape = solids[0] if len(solids) == 1 else Compound(solids)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plate.step"
        shape.WriteStep(str(path))
        return path.read_text(encoding="utf-8")


def _headed(text: str, stage: Stage) -> str:
    """Replace header and product names of the geometry kernel."""
    begin = text.index("DATA;")
    description = (
        f"plate of the flexure stage {stage.name}, {stage.thickness * 1e3:.10g} mm thick, "
        f"{stage.materials}; millimetres; z = 0 is the middle plane"
    )
    name, title = _quoted(stage.name), _quoted(stage.title or stage.name)
    program = _quoted(f"flexstage {__version__}")
    header = (
        "ISO-10303-21;\nHEADER;\n"
        f"FILE_DESCRIPTION((\n{_quoted(description)}),\n'2;1');\n"
        f"FILE_NAME({_quoted(file_name(stage.name) + '.step')},{_quoted(_TIME)},\n"
        f"(''),(''),'Open CASCADE',{program},'');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\n"
    )
    data = re.sub(
        r"= PRODUCT\('(?:[^']|'')*',\s*'(?:[^']|'')*',\s*'(?:[^']|'')*',",
        lambda _: f"= PRODUCT({name},\n{name},\n{title},",
        text[begin:],
        count=1,
    )
    return header + _ascii(data)


def _quoted(text: str) -> str:
    """Return a string of ISO 10303-21: quotes and backslashes doubled, no control characters."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return _ascii("'" + plain.replace("\\", "\\\\").replace("'", "''") + "'")


def _ascii(text: str) -> str:
    r"""Return a text with characters outside ASCII as \X2\....\X0\, hexadecimal UTF-16."""
    return re.sub(
        r"[^\x00-\x7f]+",
        lambda match: f"\\X2\\{match.group().encode('utf-16-be').hex().upper()}\\X0\\",
        text,
    )


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return step_files(stage_export.stage)
