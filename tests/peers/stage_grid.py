"""A whole stage as quadratic wedges, with its loads and readings as plain arrays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity.shapes import METRE
from flexstage.stage import Axis, Stage
from tests.peers.calculix import Answer, Job, solve
from tests.peers.grids import Grid, Sweep, sweep, triangles
from tests.peers.shape_functions import face_shares, wedge_points


def plane_grid(stage: Stage, *, neck_size: float, size: float, grading: float = 0.5) -> Grid:
    """Triangles of the stage's plane: the neck size is in neck thicknesses, the size in metres."""
    import ngsolve as ng
    from netgen import occ

    from flexstage.fem.geometry import stage_faces, surface_edge

    shape = stage_faces(stage).shape
    necks = {surface_edge(h.name): h.profile.neck_thickness for h in stage.hinges}
    for edge in shape.edges:
        if edge.name in necks:
            edge.maxh = neck_size * necks[edge.name] * METRE
    mesh = ng.Mesh(occ.OCCGeometry(shape, dim=2).GenerateMesh(maxh=size * METRE, grading=grading))
    mesh.Curve(5)
    return triangles(mesh)


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Natural frequencies with the drives removed, and output over input of each axis."""

    frequencies: Array  # [Hz]
    ratios: dict[str, float]
    unknowns: int
    seconds: float


def calculix_figures(
    stage: Stage,
    plane: Grid,
    *,
    levels: Sequence[float] = (0.0, 0.7, 1.0),
    modes: int = 2,
    threads: int | None = None,
) -> Figures:
    """Solve half the thickness, whose middle plane stays in its plane, in CalculiX.

    The levels between layers are parts of half the thickness, from the middle plane.
    """
    half = 0.5 * stage.thickness
    swept = sweep(plane, half * np.array(levels))
    nodes = swept.solid.nodes
    bolted = np.zeros(nodes.shape[0], dtype=bool)
    for hole in (h for b in stage.bodies if b.fixed for h in b.mounting_holes):
        away = np.hypot(nodes[:, 0] - hole.centre[0], nodes[:, 1] - hole.centre[1])
        bolted |= np.abs(away - hole.radius) < 1e-7
    middle = (nodes[:, 2] < 1e-9) & ~bolted
    inputs = {axis.name: _elongation(stage, axis, plane, swept) for axis in stage.axes}
    answer: Answer = solve(
        Job(
            grid=swept.solid,
            kind="C3D15",
            material=stage.material,
            held={"xyz": np.flatnonzero(bolted), "z": np.flatnonzero(middle)},
            loads=list(inputs.values()),
            modes=modes,
        ),
        threads=threads,
    )
    ratios = {}
    for axis, u in zip(stage.axes, answer.displacements, strict=True):
        reading = _reading(stage, axis, swept.solid)
        ratios[axis.name] = float((reading * u).sum() / (inputs[axis.name] * u).sum())
    return Figures(
        frequencies=answer.frequencies,
        ratios=ratios,
        unknowns=nodes.size,
        seconds=answer.seconds,
    )


def _elongation(stage: Stage, axis: Axis, plane: Grid, swept: Sweep) -> Array:
    """Mean displacement of the pushed patch less that of the reacting one, along the drive.

    A drive that stands on a fixed body stands on the ground.
    """
    fixed = {b.name for b in stage.bodies if b.fixed}
    drive = next(d for d in stage.drives if d.name == axis.drive)
    along = np.array([math.cos(drive.direction), math.sin(drive.direction)])
    aside = np.array([-along[1], along[0]])
    total = np.zeros_like(swept.solid.nodes)
    sides = zip(drive.at, (1.0, -1.0), (drive.pushes, drive.reacts), strict=True)
    for at, sign, body in sides:
        if body in fixed:
            continue

        def on_patch(p: Array, at: tuple[float, float] = at) -> NDArray[np.bool_]:
            arm = p - np.array(at)
            near = np.abs(arm @ along) < 1e-8
            return near & (np.abs(arm @ aside) < drive.patch_half_width + 1e-8)

        edges = plane.edges(on_patch)
        if not edges.size:
            raise ValueError(f"no edge of the grid lies on the patch of drive '{drive.name}'")
        # an edge between two regions would come twice
        edges = edges[np.unique(np.sort(edges, axis=1), axis=0, return_index=True)[1]]
        shares = face_shares(swept.solid.nodes, swept.faces(edges))
        total[:, :2] += sign * np.outer(shares, along)
    return total


def _reading(stage: Stage, axis: Axis, solid: Grid) -> Array:
    """The probe's displacement by the rigid motion nearest to that of the body that it reads."""
    probe = next(p for p in stage.probes if p.name == axis.probe)
    if probe.relative_to is not None:
        raise ValueError("only a probe against the ground is read here")
    halves = {
        f"notch {h.name} {'ab'[i]}"
        for h in stage.hinges
        for i in (0, 1)
        if h.bodies[i] == probe.body
    }
    own = [r == f"body {probe.body}" or r in halves for r in solid.regions]
    wedges = solid.elements[np.array(own)]
    N, places, volumes = wedge_points(solid.nodes, wedges)
    x, y = places[..., 0], places[..., 1]
    total = volumes.sum()
    centre = np.array([(volumes * x).sum(), (volumes * y).sum()]) / total
    dx, dy = x - centre[0], y - centre[1]
    turning = (volumes * (dx**2 + dy**2)).sum()
    mean, rotation = np.zeros((2, solid.nodes.shape[0])), np.zeros((2, solid.nodes.shape[0]))
    np.add.at(mean[0], wedges, volumes @ N / total)
    np.add.at(rotation[0], wedges, (volumes * -dy) @ N / turning)
    np.add.at(rotation[1], wedges, (volumes * dx) @ N / turning)
    along = (math.cos(probe.direction), math.sin(probe.direction))
    arm = np.array(probe.at) - centre
    lever = along[1] * arm[0] - along[0] * arm[1]
    total_reading = np.zeros((solid.nodes.shape[0], 3))
    total_reading[:, 0] = along[0] * mean[0] + lever * rotation[0]
    total_reading[:, 1] = along[1] * mean[0] + lever * rotation[1]
    return total_reading
