"""A part from a STEP file: its solids, its faces by name, its mesh."""

import math
import pickle
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import ngsolve as ng
import numpy as np
from netgen.occ import Glue, OCCGeometry, TopoDS_Shape, Vertex, gp_Pnt

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import ModelError, StageError
from flexstage.elasticity.shapes import METRE
from flexstage.elasticity.step_file import in_step_file
from flexstage.fem.part_mesh import PartMesh, mesh_shape
from flexstage.quantities.material import Material

# kinds of surface by their number in the text form of a shape (Open CASCADE, "BRep Format")
_KINDS = (
    *("", "plane", "cylinder", "cone", "sphere", "torus", "extrusion", "revolution"),
    *("bezier", "bspline", "trimmed", "offset"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFace:
    """A face of a part."""

    name: str
    """Name, also that of the boundary of the mesh; faces may share one."""
    kind: str
    """``plane``, ``cylinder``, ``cone``, ``sphere``, ``torus``, ``bspline``, ..."""
    area: float
    """Area [m^2]."""
    centre: tuple[float, ...]
    """Centroid [m]."""
    normal: tuple[float, ...] | None
    """Outward unit normal of a plane; None of any other."""
    low: tuple[float, ...]
    """Lowest corner of the box about it [m]."""
    high: tuple[float, ...]
    """Highest corner of the box about it [m]."""
    bodies: tuple[str, ...]
    """Names of the solids that it bounds: two joined ones, or one."""
    forward: bool
    """True if the normal of its surface, by its coordinates, points out of the first of them."""


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
    """Return the kind of surface of a face, and whether its normal points out of the solid.

    Only the text form of a shape has both: the kind as a number after the heading ``Surfaces``, and
    the orientation as the sign of the last shape.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "face.brep"
        shape.WriteBrep(str(file))
        text = file.read_text("latin-1")
    # a trimmed surface (10) is followed by its basis on the next line
    match = re.search(r"^Surfaces \d+\s+(?:10 [^\n]*\n)?(\d+) ", text, re.MULTILINE)
    number = int(match[1]) if match else 0
    kind = _KINDS[number] if 0 < number < len(_KINDS) else "surface"
    return kind, text.split()[-2].startswith("+")


_NEAR = 1e-6  # faces at one level, and flat faces, to this part of the part's size
_NO_NAME = {"", "NONE", "none"}  # what programs write where a face has none
_AXES = "xyz"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """One solid, or several that are joined where they touch."""

    source: str
    """Source, for messages."""
    shape: TopoDS_Shape
    """The solids, in millimetres; every face has a name."""
    bodies: tuple[str, ...]
    """Names of the solids, which are the regions of its mesh."""
    faces: tuple[PartFace, ...]
    """Faces."""

    @classmethod
    def from_shape(cls, shape: TopoDS_Shape, *, source: str = "the shape") -> "Part":
        """Name the solids and faces of a shape and measure them.

        One solid, or solids that share faces (as `netgen.occ.Glue` makes them), in millimetres.
        """
        solids = list(shape.solids)
        if not solids:
            raise StageError(
                f"{source} holds no solid, only {len(list(shape.faces))} faces: export the body "
                "as a solid, or sew its faces into one"
            )
        for k, solid in enumerate(solids):
            if not solid.mass > 0.0:
                raise StageError(
                    f"solid {k} of {source} has the volume {solid.mass:.3g} mm^3, which must be "
                    "positive: its faces point inwards or do not close; repair it in the CAD "
                    "program and export it again"
                )
        bodies = _name_all(solids, "body")
        _name_all(list(shape.faces), "face")
        of: dict[TopoDS_Shape, list[str]] = {f: [] for f in shape.faces}  # one that two share, once
        for name, solid in zip(bodies, solids, strict=True):
            for f in solid.faces:
                of[f].append(name)
        faces = tuple(face_of(f, tuple(names)) for f, names in of.items())
        return cls(source=source, shape=shape, bodies=tuple(bodies), faces=faces)

    # ------------------------------------------------------------------ measures

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return sum(s.mass for s in self.shape.solids) / METRE**3

    @property
    def bounding_box(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lowest and highest corner of the box about it [m]."""
        return box_of(self.shape)

    def mass(self, material: Material | Mapping[str, Material]) -> float:
        """Return its mass [kg]."""
        of = [material] * len(self.bodies)
        if not isinstance(material, Material):
            of = [material[name] for name in self.bodies]
        volumes = [s.mass / METRE**3 for s in self.shape.solids]
        return sum(m.density * v for m, v in zip(of, volumes, strict=True))  # type: ignore[union-attr]

    # ------------------------------------------------------------------ bodies

    def require_joined(self) -> None:
        """Refuse an assembly that is not in one piece."""
        joined = {self.bodies[0]}
        joints = [set(f.bodies) for f in self.faces if len(f.bodies) > 1]
        for _ in self.bodies:
            joined |= set().union(*(j for j in joints if j & joined))
        apart = [name for name in self.bodies if name not in joined]
        if apart:
            raise StageError(
                f"'{apart[0]}' of {self.source} shares no face with "
                f"{', '.join(n for n in self.bodies if n in joined)}: solids join where their "
                "faces touch without a gap; move them together in the CAD program, or take only "
                "solids that touch"
            )

    # ------------------------------------------------------------------ faces

    def face_at(self, point: Sequence[float]) -> str:
        """Return the name of the face that is nearest to a point.

        The point is in metres; on the edge of two faces with different names it is refused.
        """
        vertex = Vertex(gp_Pnt(*(METRE * float(c) for c in point)))
        by_distance = sorted(
            (f.Distance(vertex), face.name)
            for f, face in zip(dict.fromkeys(self.shape.faces), self.faces, strict=True)
        )
        low, high = self.bounding_box
        margin = _NEAR * math.dist(low, high) * METRE
        for distance, name in by_distance[1:]:
            if distance - by_distance[0][0] < margin and name != by_distance[0][1]:
                raise StageError(
                    f"the point {tuple(point)} m is as near to face '{by_distance[0][1]}' as to "
                    f"'{name}': give a point inside the intended face"
                )
        return by_distance[0][1]

    def select(self, axis: str, end: str) -> tuple[str, ...]:
        """Return the names of the plane faces at one end of the part.

        Of all plane faces with outward normals along the axis ``x``, ``y`` or ``z`` those that lie
        lowest (``min``) or highest (``max``), in the order of the file.
        """
        if axis not in _AXES or len(axis) != 1 or end not in {"min", "max"}:
            raise StageError(
                f"faces are selected by an axis x, y or z and an end min or max, got {axis!r} "
                f"and {end!r}"
            )
        k, sign = _AXES.index(axis), 1.0 if end == "max" else -1.0
        there = [f for f in self.faces if f.normal is not None and sign * f.normal[k] > 1.0 - _NEAR]
        if not there:
            raise StageError(
                f"{self.source} has no plane face with its normal along "
                f"{'+' if sign > 0 else '-'}{axis}: name the face in the CAD program, or give a "
                "point on it"
            )
        outermost = max(sign * f.centre[k] for f in there)
        low, high = self.bounding_box
        margin = _NEAR * math.dist(low, high)
        level = [f.name for f in there if sign * f.centre[k] > outermost - margin]
        return tuple(dict.fromkeys(level))

    def boundary(self, names: str | Sequence[str]) -> str:
        """Return the regular expression of faces in a mesh."""
        words = (names,) if isinstance(names, str) else tuple(names)
        every = {f.name for f in self.faces}
        for name in words:
            if name not in every:
                raise StageError(
                    f"{self.source} has no face '{name}': it has {', '.join(sorted(every)[:12])}"
                    f"{', ...' if len(every) > 12 else ''}"
                )
        return "|".join(re.escape(name) for name in words)

    def touching(self, numbers: Sequence[int]) -> list[tuple[int, ...]]:
        """Return faces, given by their numbers in `faces`, in groups that touch."""
        shapes = list(dict.fromkeys(self.shape.faces))
        groups: list[tuple[tuple[int, ...], set[TopoDS_Shape]]] = []
        for k in numbers:
            vertices = set(shapes[k].vertices)
            met = [g for g in groups if g[1] & vertices]
            groups = [g for g in groups if g not in met]
            joined = (*(n for g in met for n in g[0]), k)
            groups.append((joined, vertices.union(*(g[1] for g in met))))
        return [group for group, _ in groups]

    # ------------------------------------------------------------------ mesh

    def mesh(self, settings: PartMesh | None = None, *, limit: float | None = None) -> ng.Mesh:
        """Mesh the part with tetrahedra that are curved to its surface.

        It is in millimetres; the mesher is stopped after `limit` seconds of computing time.

        Examples
        --------
        >>> from netgen.occ import Box
        >>> part = Part.from_shape(Box((0, 0, 0), (7.0, 2.0, 1.0)))
        >>> round(part.volume * 1e9, 6)
        14.0
        >>> sorted(part.mesh().GetBoundaries()) == sorted(f.name for f in part.faces)
        True
        """
        mesh_settings = settings if settings is not None else PartMesh()
        for name in mesh_settings.sizes:
            if name not in {f.name for f in self.faces}:
                raise ModelError(f"{self.source} has no face '{name}' to give a mesh size to")
        return mesh_shape(self.shape, mesh_settings, self.source, limit=limit)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartSurface:
    """Triangles of the faces of a part."""

    triangles: Array
    """Their corners, outwards counter-clockwise [m], shape (t, 3, 3)."""
    face: Integers
    """Number of the part's face that each belongs to, shape (t,)."""
    lines: Array
    """Both ends of the pieces of its edges [m], shape (e, 2, 3)."""
    edge: Integers
    """Number of the edge that each belongs to, shape (e,)."""

    @property
    def area_vectors(self) -> Array:
        """Outward normals of the triangles, as long as their areas [m^2], shape (t, 3)."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return 0.5 * np.cross(b - a, c - a)


def part_surface(part: Part) -> PartSurface:
    """Return the surface of a part as triangles.

    They are coarse where it is flat, and within about 1 % of the area of curved faces.
    """
    # what the library's own viewer draws; it has no other way to the kernel's triangles
    visualisation = OCCGeometry(part.shape)._visualizationData()
    triangles = np.array(visualisation["vertices"], dtype=float).reshape(-1, 3, 3) / METRE
    lines = np.array(visualisation["edges"], dtype=float).reshape(-1, 2, 3) / METRE
    face = np.array(visualisation["indices"], dtype=np.intp).reshape(len(triangles), -1)[:, 0]
    edge = np.array(visualisation["edge_indices"], dtype=np.intp).reshape(len(lines), -1)[:, 0]
    forward = np.array([f.forward for f in part.faces])[face]
    triangles[~forward] = triangles[~forward][:, ::-1]
    twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    there = np.linalg.norm(twice, axis=1) > 0.0
    return PartSurface(triangles=triangles[there], face=face[there], lines=lines, edge=edge)


def read_step(path: str | Path, *, solid: int | str | Sequence[int | str] | None = None) -> Part:
    """Read a part from a STEP file.

    The geometry kernel converts any unit of length to millimetres. `solid` selects from several
    solids, by number, counted from 0, or by name; ``all`` keeps all of them, and several are joined
    where they touch. Faces and solids that have no name in the file are called ``face1``, ...,
    ``body1``, ... in its order. A file is refused that is no STEP file or incomplete, or that has
    no solid, a solid without volume, several solids without a selection, or overlapping solids.
    """
    path = Path(path)
    packed, bodies, faces = in_step_file(path, _packed_part, path, solid)
    return Part(source=f"'{path}'", shape=pickle.loads(packed).shape, bodies=bodies, faces=faces)


def _packed_part(
    shape: TopoDS_Shape, path: Path, solid: int | str | Sequence[int | str] | None
) -> tuple[bytes, tuple[str, ...], tuple[PartFace, ...]]:
    """Return the shape of a part for another process, its names, and its faces."""
    part = _part_of(shape, path, solid)
    packed = pickle.dumps(OCCGeometry(part.shape))
    # all that is done with it there, but its mesh, is done here first: the kernel may break down
    there = replace(part, shape=pickle.loads(packed).shape)
    part_surface(there)
    for f in there.shape.faces:
        f.Distance(Vertex(gp_Pnt(*there.bounding_box[0])))
        sum(e.mass for e in f.edges)
    sum(s.mass for s in there.shape.solids)
    return packed, part.bodies, part.faces


def _part_of(
    shape: TopoDS_Shape, path: Path, solid: int | str | Sequence[int | str] | None
) -> Part:
    solids = list(shape.solids)
    count = len(solids)
    if count > 1 and solid is None:
        raise StageError(
            f"'{path}' holds {count} solids: choose one with solid=0 to {count - 1}, or keep "
            "them all, joined where they touch, with solid='all'"
        )
    if count:
        names = _name_all(solids, "body")
        words = [solid] if isinstance(solid, (int, str)) else list(solid or [])
        if words and words != ["all"]:
            solids = [solids[k] for k in dict.fromkeys(_number(w, names, path) for w in words)]
        shape = Glue(solids) if len(solids) > 1 else solids[0]
        if len(list(shape.solids)) != len(solids):
            raise StageError(
                f"solids of '{path}' overlap, {', '.join(str(s.name) for s in solids)}: joined "
                f"they fall into {len(list(shape.solids))} pieces; cut one out of the other in the "
                "CAD program"
            )
    return Part.from_shape(shape, source=f"'{path}'")


def _number(word: int | str, names: Sequence[str], path: Path) -> int:
    """Return the number of a solid by its name, or by text with a number from 1 (``body1``)."""
    if isinstance(word, int):
        if 0 <= word < len(names):
            return word
        raise StageError(f"'{path}' has the solids 0 to {len(names) - 1}, got {word}")
    if word in names:
        return names.index(word)
    if word.isdigit() and 0 < int(word) <= len(names):
        return int(word) - 1
    available = ", ".join(f"{k} {name}" for k, name in enumerate(names, 1))
    raise StageError(
        f"'{path}' has the solids {available}; got '{word}': give a name, a number or 'all'"
    )


def _name_all(shapes: Sequence[TopoDS_Shape], kind: str) -> list[str]:
    """Name every shape that has no name."""
    used = {s.name for s in shapes if s.name not in _NO_NAME}
    names = []
    for k, shape in enumerate(shapes, 1):
        if shape.name is None or shape.name in _NO_NAME:
            name = f"{kind}{k}"
            while name in used:
                name += "_"
            shape.name = name
        names.append(str(shape.name))
    if kind == "body" and len(set(names)) < len(names):
        # copies of one part in an assembly: each is a region of its own
        names = [f"{name}.{k}" for k, name in enumerate(names, 1)]
        for shape, name in zip(shapes, names, strict=True):
            shape.name = name
    return names
