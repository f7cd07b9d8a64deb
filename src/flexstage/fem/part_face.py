"""A face of a solid: its kind, where it is and where it looks."""

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

from netgen.occ import TopoDS_Shape

from flexstage.elasticity.unit import METRE

# kinds of surface by their number in the text form of a shape (Open CASCADE, "BRep Format")
_KINDS = (
    *("", "plane", "cylinder", "cone", "sphere", "torus", "extrusion", "revolution"),
    *("bezier", "bspline", "trimmed", "offset"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFace:
    """A face of a part."""

    name: str
    """Its name, which the boundary of the mesh bears too; faces may share one."""
    kind: str
    """``plane``, ``cylinder``, ``cone``, ``sphere``, ``torus``, ``bspline``, ..."""
    area: float
    """Its area [m^2]."""
    centre: tuple[float, ...]
    """Its centroid [m]."""
    normal: tuple[float, ...] | None
    """Outward unit normal of a plane; None of any other."""
    low: tuple[float, ...]
    """Lowest corner of the box about it [m]."""
    high: tuple[float, ...]
    """Highest corner of the box about it [m]."""
    bodies: tuple[str, ...]
    """Names of the solids that it bounds: of two that are joined there, or of one."""
    forward: bool
    """Whether the normal of its surface, by its coordinates, looks out of the first of them."""


def box_of(shape: TopoDS_Shape) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the lowest and the highest corner [m] of the box about a shape in millimetres."""
    low, high = shape.bounding_box
    return (
        (low.x / METRE, low.y / METRE, low.z / METRE),
        (high.x / METRE, high.y / METRE, high.z / METRE),
    )


def face_of(shape: TopoDS_Shape, bodies: tuple[str, ...]) -> PartFace:
    """Measure a face.

    It has a name and is in millimetres; `bodies` are the solids that it bounds.
    """
    kind, forward = _kind(shape)
    normal = None
    if kind == "plane":
        normal = tuple((c if forward else -c) + 0.0 for c in tuple(shape.surf.Normal(0.0, 0.0)))
    low, high = box_of(shape)
    centre = shape.center
    return PartFace(
        name=str(shape.name),
        kind=kind,
        area=shape.mass / METRE**2,
        centre=(centre.x / METRE, centre.y / METRE, centre.z / METRE),
        normal=normal,
        low=low,
        high=high,
        bodies=bodies,
        forward=forward,
    )


def _kind(shape: TopoDS_Shape) -> tuple[str, bool]:
    """Return the kind of surface of a face, and whether its normal looks out of the solid.

    Only the text form of a shape tells: the kind as a number after the heading ``Surfaces``, and
    the orientation as the sign of the last shape.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "face.brep"
        shape.WriteBrep(str(file))
        text = file.read_text("latin-1")
    # a trimmed surface (10) is followed by its basis on the next line
    found = re.search(r"^Surfaces \d+\s+(?:10 [^\n]*\n)?(\d+) ", text, re.MULTILINE)
    number = int(found[1]) if found else 0
    kind = _KINDS[number] if 0 < number < len(_KINDS) else "surface"
    return kind, text.split()[-2].startswith("+")
