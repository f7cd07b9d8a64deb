"""The plate of a stage as a solid in a STEP file, for CAD, CAM and other finite elements."""

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
_ON_FACE = 1e-5  # a point lies on a face [mm]
_TIME = "1970-01-01T00:00:00"  # of every file


def step_files(stage: Stage) -> dict[str, bytes]:
    """Return the plate of a stage as a STEP file.

    Bodies and notches are one solid without seams between them. Arcs are cylinders and straight
    edges planes, exactly; the two sides of each neck are faces named after the hinge.

    ``NAME.step`` is ISO 10303-21 text, application protocol 214, in millimetres. The plate lies
    from z = -thickness/2 to thickness/2, so that z = 0 is its middle plane, as in every other file
    that flexstage writes. The time in its header is the same for every file, so that the same stage
    gives the same bytes.

    Notes
    -----
    Validity: the nominal shape, without the radius of the wire and without tolerances; coordinates
    have 13 digits. Profiles that are no arcs and lines, such as ellipses, are arcs with common
    tangents within 10 nm. Masses mounted on bodies are left out. A body that no hinge joins to the
    others is a solid of its own.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> files = step_files(design("parallelogram"))
    >>> files["parallelogram.step"].count(b"= CYLINDRICAL_SURFACE(")
    10
    """
    # numbers stand for the names until the text is written: the kernel breaks long lines, within a
    # letter of several bytes as well
    names: list[str] = []
    text = _written(_solids(stage, names))
    text = re.sub(r"'flexstage(\d+)name'", lambda found: _quoted(names[int(found[1])]), text)
    return {f"{file_name(stage.name)}.step": _headed(text, stage).encode("ascii")}


# ------------------------------------------------------------------ the shape


def _solids(stage: Stage, names: list[str]) -> "list[TopoDS_Shape]":
    """Return the solids; the names of solids and faces are added to a list."""
    from netgen.occ import Fuse, Z

    from flexstage.elasticity.shapes import METRE

    parts, total = [], 0.0
    for body in stage.bodies:
        outline, holes = body_contour(stage, body)
        shape, area = _face(body.name, outline, (*holes, *body.mounting_holes))
        parts.append(shape)
        total += area
    whole = Fuse(parts) if len(parts) > 1 else parts[0]
    # without the seams between them, and without corners in a straight edge
    joined = whole.UnifySameDomain(unifyEdges=True, unifyFaces=True, concatBSplines=False)
    faces = list(joined.faces)
    area = sum(f.mass for f in faces) / METRE**2
    if abs(area - total) > _SAME_SIZE * total:
        raise StageError(
            f"bodies or notches of stage '{stage.name}' overlap: together they cover "
            f"{area * 1e6:.6g} mm^2 instead of {total * 1e6:.6g} mm^2; see what 'flexstage check' "
            "says"
        )
    found = []
    for number, plane in enumerate(faces, start=1):
        half = 0.5 * stage.thickness * METRE
        solid = plane.Move((0.0, 0.0, -half)).Extrude(2.0 * half, Z).solids[0]
        solid.name = _token(names, stage.name if len(faces) == 1 else f"{stage.name} {number}")
        found.append(solid)
    _name_necks(stage.hinges, [f for s in found for f in s.faces], names)
    return found


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
            f"body '{body}' is in {len(shape.faces)} pieces once its holes are cut: see what "
            "'flexstage check' says about it"
        )
    return shape.faces[0], area


def _name_necks(hinges: Iterable[Hinge], faces: "list[TopoDS_Shape]", names: list[str]) -> None:
    """Name the faces on both sides of each neck, which other programs load and refine."""
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
    """Put a name down, and return what stands for it in the text of the kernel."""
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
    """Put a header and product names of our own in place of those of the geometry kernel."""
    begin = text.index("DATA;")
    said = (
        f"plate of the flexure stage {stage.name}, {stage.thickness * 1e3:.10g} mm thick, "
        f"{stage.material.name}; millimetres; z = 0 is the middle plane"
    )
    name, title = _quoted(stage.name), _quoted(stage.title or stage.name)
    ours = _quoted(f"flexstage {__version__}")
    header = (
        "ISO-10303-21;\nHEADER;\n"
        f"FILE_DESCRIPTION((\n{_quoted(said)}),\n'2;1');\n"
        f"FILE_NAME({_quoted(file_name(stage.name) + '.step')},{_quoted(_TIME)},\n"
        f"(''),(''),'Open CASCADE',{ours},'');\n"
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
    """Write a text as ISO 10303-21 does: quotes and backslashes twice, no control characters."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return _ascii("'" + plain.replace("\\", "\\\\").replace("'", "''") + "'")


def _ascii(text: str) -> str:
    r"""Write characters outside ASCII as \X2\....\X0\, in the hexadecimal digits of UTF-16."""
    return re.sub(
        r"[^\x00-\x7f]+",
        lambda found: f"\\X2\\{found.group().encode('utf-16-be').hex().upper()}\\X0\\",
        text,
    )


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return step_files(given.stage)
