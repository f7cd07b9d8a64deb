"""One circular hinge between two blocks, the piece on which finite-element codes are compared.

A plate of 19 x 10 mm, 10 mm thick, from x = -7 mm (clamped) to 12 mm. A slot 4 mm wide from each
side ends in a half circle of 2 mm, and leaves a neck of 0.5 mm at x = 0. A force of 1 N along y is
spread over the right face.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import ngsolve as ng
import numpy as np
from netgen import occ
from netgen.meshing import IdentificationType
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity import Continuum, face, von_mises
from flexstage.elasticity.loaded import von_mises_of
from flexstage.elasticity.shapes import METRE
from flexstage.quantities.material import Material
from tests.peers import calculix
from tests.peers.grids import Grid, join, patch, sweep
from tests.peers.shape_functions import edge_shares, face_shares

MATERIAL = Material(
    name="the reference piece", youngs_modulus=71.7e9, poissons_ratio=0.33, density=2810.0
)
LEFT, RIGHT, HALF_HEIGHT, THICKNESS = -7e-3, 12e-3, 5e-3, 10e-3
RADIUS, HALF_NECK = 2e-3, 0.25e-3
ROOT = RADIUS + HALF_NECK


def piece() -> occ.TopoDS_Shape:
    """The plane of the piece; its edges are called left, right and notch."""
    r, h, w = RADIUS, ROOT, HALF_HEIGHT
    upper = [(RIGHT, w), (r, w), (r, h), (-r, h), (-r, w), (LEFT, w)]
    lower = [(x, -y) for x, y in reversed(upper)]
    bulges = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0] * 2
    shape = face((*lower, *upper), bulges)
    for edge in shape.edges:
        first, last = edge.parameter_interval
        middle = edge.Value(0.5 * (first + last))
        if abs(middle.x) < 1e-6:
            edge.name = "notch"
        elif abs(middle.x - METRE * LEFT) < 1e-6:
            edge.name = "left"
        elif abs(middle.x - METRE * RIGHT) < 1e-6:
            edge.name = "right"
    return shape


def _refined(neck_size: float) -> occ.TopoDS_Shape:
    shape = piece()
    for edge in shape.edges:
        if edge.name == "notch":
            edge.maxh = neck_size * 2.0 * HALF_NECK * METRE
    return shape


def plane_mesh(
    order: int, *, neck_size: float = 1.0, size: float = 4e-3, grading: float = 0.5
) -> ng.Mesh:
    """Curved triangles; the neck size is in neck thicknesses, the size in metres."""
    geometry = occ.OCCGeometry(_refined(neck_size), dim=2)
    mesh = ng.Mesh(geometry.GenerateMesh(maxh=size * METRE, grading=grading))
    mesh.Curve(order)
    return mesh


def prism_mesh(
    order: int,
    *,
    neck_size: float = 1.0,
    size: float = 4e-3,
    grading: float = 0.5,
    levels: Sequence[float] = (0.0, 1.0),
) -> ng.Mesh:
    """Layers of prisms through half the thickness, to these parts of it; z = 0 is called middle."""
    half = 0.5 * THICKNESS * METRE
    plane = _refined(neck_size)
    slabs = [
        plane.Move(occ.Vec(0.0, 0.0, a * half)).Extrude(occ.Vec(0.0, 0.0, (b - a) * half))
        for a, b in pairwise(levels)
    ]
    whole = slabs[0] if len(slabs) == 1 else occ.Glue(slabs)
    flat = {}
    for f in whole.faces:
        box = f.bounding_box
        if box[1].z - box[0].z < 1e-6:
            flat[round(f.center.z, 6)] = f
    flat[0.0].name = "middle"
    for k, (a, b) in enumerate(pairwise(levels)):
        below, above = flat[round(a * half, 6)], flat[round(b * half, 6)]
        below.Identify(above, f"layer {k}", IdentificationType.CLOSESURFACES)
    # threads of the mesher wait in circles
    made = occ.OCCGeometry(whole).GenerateMesh(
        maxh=size * METRE, grading=grading, parallel_meshing=False
    )
    mesh = ng.Mesh(made)
    mesh.Curve(order)
    return mesh


def peak_stress(continuum: Continuum, u: Array, samples: int = 9) -> float:
    """Largest von Mises stress on the surface of the notch [Pa]."""
    at = np.linspace(0.0, 1.0, samples)
    points = [(s, t, 0.0) for s in at for t in at]
    flat = continuum.dimension == 2
    rule = ng.IntegrationRule(
        points=[(s, 0.0, 0.0) for s in at] if flat else points,
        weights=[0.0] * (samples if flat else samples**2),
    )
    kind = ng.ET.SEGM if flat else ng.ET.QUAD
    where = continuum.mesh.Boundaries("notch")
    mapped = continuum.mesh.MapToAllElements({kind: rule}, where)
    stress = ng.BoundaryFromVolumeCF(von_mises(continuum.stress(u)))
    return float(np.max(stress(mapped)))


def quadrilaterals(along: int, across: int, outside: int, *, finer: float = 2.0) -> Grid:
    """A grid of quadrilaterals that follows the notch, for codes without curves of higher order.

    Elements along a quarter of the notch, across half the neck, and along the right block; `finer`
    is how much they crowd towards the neck.
    """

    def graded(count: int, power: float) -> Array:
        s = np.linspace(0.0, 1.0, count + 1)
        return _with_middles(s**power)

    half_across = _with_middles(np.linspace(0.0, 1.0, across + 1))
    angle = 0.5 * np.pi * graded(along, finer)
    foot = 2.0 * RADIUS  # where the line from the end of the notch meets the axis
    patches = []
    for side, end in ((1.0, RIGHT), (-1.0, -LEFT)):
        count = max(1, round(outside * (end - foot) / (RIGHT - foot)))
        along_block = graded(count, 1.3)
        above = max(1, round(outside * (HALF_HEIGHT - ROOT) / (RIGHT - foot)))
        for up in (1.0, -1.0):
            x0, y0 = foot * np.sin(angle), np.zeros_like(angle)
            x1, y1 = RADIUS * np.sin(angle), HALF_NECK + RADIUS * (1.0 - np.cos(angle))
            parts = [_between((x0, y0), (x1, y1), half_across)]
            line = (
                foot + (RADIUS - foot) * half_across,
                ROOT * half_across,
            )
            wall = (np.full_like(half_across, end), ROOT * half_across)
            x, y = _between(line, wall, along_block)
            parts.append((x.T, y.T))
            low = (RADIUS + (end - RADIUS) * along_block, np.full_like(along_block, ROOT))
            high = (low[0], np.full_like(along_block, HALF_HEIGHT))
            parts.append(_between(low, high, _with_middles(np.linspace(0.0, 1.0, above + 1))))
            for x, y in parts:
                nodes, elements = patch(side * x, up * y)
                if side * up < 0.0:
                    elements = elements[:, [0, 3, 2, 1, 7, 6, 5, 4]]
                patches.append((nodes, elements))
    return join(patches)


def _with_middles(s: Array) -> Array:
    found = np.empty(2 * s.size - 1)
    found[::2] = s
    found[1::2] = 0.5 * (s[1:] + s[:-1])
    return found


def _between(
    first: tuple[Array, Array], second: tuple[Array, Array], s: Array
) -> tuple[Array, Array]:
    """Points on straight lines from one curve to another."""
    x, y = (a[:, None] * (1.0 - s) + b[:, None] * s for a, b in zip(first, second, strict=True))
    return x, y


def on_left(points: Array) -> NDArray[np.bool_]:
    """Which points, shape (n, 2 or 3), lie on the clamped face."""
    return points[:, 0] < LEFT + 1e-9


def on_right(points: Array) -> NDArray[np.bool_]:
    """Which points, shape (n, 2 or 3), lie on the loaded face."""
    return points[:, 0] > RIGHT - 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What a code finds of the piece."""

    compliance: float  # [m/N]
    frequencies: Array  # in the plane [Hz]
    stress: float  # largest von Mises stress [Pa]
    unknowns: int
    seconds: float


def by_calculix(
    plane: Grid,
    kind: str,
    *,
    levels: Array | None = None,
    modes: int = 1,
    threads: int | None = None,
) -> Figures:
    """Solve a grid of the plane, or half the thickness swept to parts of it, in CalculiX."""
    edges = plane.edges(on_right)
    if levels is None:
        grid, shares, copies = plane, edge_shares(plane.nodes, edges), 1
    else:
        swept = sweep(plane, 0.5 * THICKNESS * levels)
        grid, copies = swept.solid, 2
        shares = face_shares(grid.nodes, swept.faces(edges))
    nodes = grid.nodes
    clamped = on_left(nodes)
    held = {"xyz"[: nodes.shape[1]]: np.flatnonzero(clamped)}
    if levels is not None:
        held["z"] = np.flatnonzero((nodes[:, 2] < 1e-9) & ~clamped)
    load = np.zeros_like(nodes)
    load[:, 1] = shares / copies
    job = calculix.Job(
        grid=grid,
        kind=kind,
        material=MATERIAL,
        thickness=THICKNESS if levels is None else None,
        held=held,
        loads=[load],
        stress=True,
        modes=modes,
    )
    answer = calculix.solve(job, threads=threads)
    return Figures(
        compliance=float(shares @ answer.displacements[0][:, 1]),
        frequencies=answer.frequencies,
        stress=float(von_mises_of(answer.stresses[0]).max()),
        unknowns=nodes.size,
        seconds=answer.seconds,
    )


def by_flexstage(
    order: int,
    *,
    neck_size: float,
    size: float,
    grading: float,
    levels: Sequence[float] | None = None,
    strain: str = "",
    modes: int = 1,
) -> Figures:
    """Mesh and solve the plane, or half the thickness in layers of prisms, here."""
    start = time.perf_counter()
    fineness = {"neck_size": neck_size, "size": size, "grading": grading}
    if levels is None:
        mesh = plane_mesh(order, **fineness)
        part = Continuum(
            mesh, MATERIAL, order=order, thickness=THICKNESS, fixed="left", strain=strain
        )
    else:
        mesh = prism_mesh(order, **fineness, levels=levels)
        part = Continuum(
            mesh, MATERIAL, order=order, fixed="left", fixed_components={"z": "middle"}, copies=2
        )
    reading = part.mean("right", (0.0, 1.0))
    u = part.solve(reading)
    omega = part.modes(modes, tolerance=1e-6)[0]
    stress = peak_stress(part, u)
    return Figures(
        compliance=float(reading @ u),
        frequencies=omega / (2.0 * np.pi),
        stress=stress,
        unknowns=part.size,
        seconds=time.perf_counter() - start,
    )
