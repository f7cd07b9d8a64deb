"""Tetrahedra for a solid of any shape, fine where it is thin."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import ngsolve as ng
from netgen.occ import OCCGeometry, TopoDS_Shape

from flexstage.elasticity.own_process import BrokenDownError, in_own_process
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ModelError
from flexstage.fem import mesher

_LOST = 0.01  # part of the volume that a mesh may lack


@dataclass(frozen=True, slots=True, kw_only=True)
class PartMesh:
    """How fine a mesh of a part is."""

    order: int = 3
    """Order to which the elements are curved; the displacement's order is given apart, and should
    be no less [1].
    """
    size: float | None = None
    """Largest element [m]; a quarter of the diagonal of the part where not given."""
    thin: float = 1.5
    """Largest element where the part is thin, in local thicknesses; 0 does not look for thin places
    [1].
    """
    grading: float = 0.5
    """How fast elements grow, 0.1 (slowly) to 1 [1]."""
    curvature: float = 1.0
    """Elements to a radius of curvature, 0.2 to 20 [1]."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """Largest element at faces, by their names [m]."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("order", 1, 8),
            ("thin", 0.0, 100.0),
            ("grading", 0.1, 1.0),
            ("curvature", 0.2, 20.0),
        ):
            if not low <= (value := getattr(self, name)) <= high:
                raise ModelError(f"{name} of a mesh must be {low:g} to {high:g}, got {value!r}")
        for value in (self.size, *self.sizes.values()):
            if value is not None and not value > 0.0:
                raise ModelError(f"a mesh size must be positive [m], got {value!r}")

    def largest(self, diagonal: float) -> float:
        """Return the largest element [m] of a part whose box has a diagonal [m]."""
        return self.size if self.size is not None else 0.25 * diagonal


def diagonal(shape: TopoDS_Shape) -> float:
    """Return the diagonal of the box about a shape, in the shape's unit."""
    low, high = shape.bounding_box
    return math.dist((low.x, low.y, low.z), (high.x, high.y, high.z))


def mesh_shape(
    shape: TopoDS_Shape, settings: PartMesh, source: str, *, limit: float | None = None
) -> ng.Mesh:
    """Mesh solids with curved tetrahedra.

    The mesh is in millimetres, as the shape; `limit` is the computing time after which the mesher
    is given up [s], where the system can do so.

    Notes
    -----
    The mesher runs in a process of its own, on one thread: on slivers it may abort, which would end
    the program.
    """
    kept = [(f, f.maxh) for f in shape.faces]
    try:
        for f in shape.faces:
            if f.name in settings.sizes:
                f.maxh = min(f.maxh, settings.sizes[f.name] * METRE)
        task = mesher.MeshTask(
            geometry=OCCGeometry(shape),
            diagonal=diagonal(shape),
            order=settings.order,
            largest=settings.largest(diagonal(shape) / METRE) * METRE,
            thin=settings.thin,
            grading=settings.grading,
            curvature=settings.curvature,
        )
        made = in_own_process(mesher.generate_alone, task, seconds=limit)
    except BrokenDownError as error:
        raise ModelError(f"the mesher {error} on {source}: {_mend(shape)}") from None
    except mesher.MesherError as error:
        raise ModelError(
            f"the mesher could not mesh {source} ({str(error) or 'no reason given'}): "
            f"{_mend(shape)}"
        ) from error
    finally:
        for f, before in kept:
            f.maxh = before
    if made is None:
        raise ModelError(
            f"curving to order {settings.order} folds many elements of {source}: give smaller "
            "sizes, more elements to a radius (curvature), or a lower order"
        )
    mesh = ng.Mesh(made)
    mesh.Curve(settings.order)
    mesher.unfold(mesh, settings.order)
    whole = sum(s.mass for s in shape.solids)
    meshed = float(ng.Integrate(ng.CoefficientFunction(1.0), mesh))
    if settings.order > 1 and abs(meshed - whole) > _LOST * whole:
        raise ModelError(
            f"the mesh of {source} holds {meshed:.6g} mm^3 of its {whole:.6g} mm^3: the mesher "
            "lost a face; change the mesh size or repair the part"
        )
    return mesh


def _mend(shape: TopoDS_Shape) -> str:
    """Say what to look at in a part that cannot be meshed."""
    width = {f.name: 2.0 * f.mass / sum(e.mass for e in f.edges) for f in shape.faces}
    narrow = min(width, key=lambda name: width[name])
    edge = min(e.mass for e in shape.edges)
    return (
        f"its narrowest face, '{narrow}', is {width[narrow]:.2g} mm wide and its shortest edge "
        f"{edge:.2g} mm long; repair slivers in the CAD program, or change the mesh size"
    )
