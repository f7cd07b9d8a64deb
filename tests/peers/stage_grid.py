"""A whole stage on one grid: its loads and readings, in scikit-fem and in CalculiX."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.elasticity.loaded import von_mises_of
from flexstage.fem.geometry import MOUNTING, body_region, notch_region, patch_edge, surface_edge
from flexstage.stage import Axis, Probe, Stage
from tests.peers.calculix import Job, solve
from tests.peers.grids import Grid, Index, Sweep, sweep
from tests.peers.scikit_fem import Part
from tests.peers.shape_functions import face_shares, solid_points

# the largest stress is looked for at the ends of so many parts of an edge
_POINTS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What is asked of a stage: natural frequencies, and a unit of elongation of each drive."""

    frequencies: Array  # drives removed [Hz]
    ratios: dict[str, float]  # output over input of each axis
    stresses: dict[str, float]  # largest in any notch, over the input of each axis [Pa/m]
    unknowns: int
    seconds: float

    def values(self) -> Array:
        """All of them: two frequencies, ratios, stresses."""
        return np.array([*self.frequencies[:2], *self.ratios.values(), *self.stresses.values()])


def scikit_fem_figures(stage: Stage, plane: Grid, *, order: int = 2, threads: int = 2) -> Figures:
    """Solve the plane of a stage, all of it in plane stress, in scikit-fem."""
    start = time.perf_counter()
    part = Part(
        plane,
        stage.material,
        thickness=stage.thickness,
        plane_strain=False,
        held=plane.sides[MOUNTING],
        order=order,
        threads=threads,
    )
    inputs = {
        axis.name: np.sum([s * part.mean(plane.sides[p], d) for p, s, d in _pushed(stage, axis)], 0)
        for axis in stage.axes
    }
    found = part.displacements(np.array(list(inputs.values())).T).T
    notches = _beside_notches(stage, plane)
    ratios, stresses = {}, {}
    for axis, u in zip(stage.axes, found, strict=True):
        probe = _probe(stage, axis)
        own = part.region(read_by(stage, probe, plane))
        x, y = np.asarray(own.global_coordinates())
        weights = _rigid(probe, x, y, own.dx)
        reading = np.concatenate([part.integral(own, w) for w in weights / own.dx])
        moved = float(inputs[axis.name] @ u)
        ratios[axis.name] = float(reading @ u) / moved
        stresses[axis.name] = part.peak(u, notches, _POINTS) / moved
    return Figures(
        frequencies=part.frequencies(2),
        ratios=ratios,
        stresses=stresses,
        unknowns=part.size,
        seconds=time.perf_counter() - start,
    )


def calculix_figures(
    stage: Stage,
    plane: Grid,
    *,
    kind: str = "C3D15",
    levels: Sequence[float] = (0.0, 0.7, 1.0),
    modes: int = 2,
    threads: int | None = None,
) -> Figures:
    """Solve half the thickness, whose middle plane stays in its plane, in CalculiX.

    The levels between layers are parts of half the thickness, from the middle plane.
    """
    swept = sweep(plane, 0.5 * stage.thickness * np.array(levels))
    nodes = swept.solid.nodes
    bolted = _over(swept, plane.sides[MOUNTING])
    middle = np.setdiff1d(np.flatnonzero(nodes[:, 2] < 1e-9), bolted)
    notches = _over(swept, np.vstack([plane.sides[surface_edge(h.name)] for h in stage.hinges]))
    inputs = {axis.name: _elongation(stage, axis, plane, swept) for axis in stage.axes}
    answer = solve(
        Job(
            grid=swept.solid,
            kind=kind,
            material=stage.material,
            held={"xyz": bolted, "z": middle},
            loads=list(inputs.values()),
            stress=True,
            printed=notches,
            modes=modes,
        ),
        threads=threads,
    )
    ratios, stresses = {}, {}
    for axis, u, s in zip(stage.axes, answer.displacements, answer.stresses, strict=True):
        reading = _reading(stage, axis, swept.solid)
        moved = float((inputs[axis.name] * u).sum())
        ratios[axis.name] = float((reading * u).sum()) / moved
        stresses[axis.name] = float(von_mises_of(s[notches]).max()) / moved
    return Figures(
        frequencies=answer.frequencies,
        ratios=ratios,
        stresses=stresses,
        unknowns=nodes.size,
        seconds=answer.seconds,
    )


def _pushed(stage: Stage, axis: Axis) -> list[tuple[str, float, tuple[float, float]]]:
    """Sides that the drive of an axis pushes, each with its sign and direction.

    A drive that stands on a fixed body stands on the ground.
    """
    fixed = {b.name for b in stage.bodies if b.fixed}
    drive = next(d for d in stage.drives if d.name == axis.drive)
    along = (math.cos(drive.direction), math.sin(drive.direction))
    return [
        (patch_edge(drive.name, which), (1.0, -1.0)[which], along)
        for which, body in enumerate((drive.pushes, drive.reacts))
        if body not in fixed
    ]


def _probe(stage: Stage, axis: Axis) -> Probe:
    probe = next(p for p in stage.probes if p.name == axis.probe)
    if probe.relative_to is not None or probe.direction is None:
        raise ValueError("only a displacement against the ground is read here")
    return probe


def read_by(stage: Stage, probe: Probe, grid: Grid) -> Index:
    """Elements of the body that a probe reads, its half notches included."""
    names = {body_region(probe.body)} | {
        notch_region(h.name, i) for h in stage.hinges for i in (0, 1) if h.bodies[i] == probe.body
    }
    return np.flatnonzero([r in names for r in grid.regions])


def _rigid(probe: Probe, x: Array, y: Array, size: Array) -> Array:
    """Weights of displacements along x and y in a probe's reading, shape (2, ...).

    It reads the rigid motion that is nearest to that of its body, given by points and their sizes.
    """
    total = size.sum()
    dx, dy = x - (size * x).sum() / total, y - (size * y).sum() / total
    direction = probe.direction or 0.0
    along = (math.cos(direction), math.sin(direction))
    arm = (probe.at[0] - (x - dx).flat[0], probe.at[1] - (y - dy).flat[0])
    lever = (along[1] * arm[0] - along[0] * arm[1]) / (size * (dx**2 + dy**2)).sum()
    return size * np.stack((along[0] / total - lever * dy, along[1] / total + lever * dx))


def _beside_notches(stage: Stage, grid: Grid) -> Index:
    """Elements with an edge on the surface of a notch."""
    rows = np.vstack([grid.sides[surface_edge(h.name)] for h in stage.hinges])
    return np.flatnonzero(np.isin(grid.elements, rows[:, 1]).any(axis=1))


def _over(swept: Sweep, edges: Index) -> Index:
    """Nodes over edges of the plane."""
    found = np.unique(swept.full[:, np.unique(edges)])
    return found[found >= 0]


def _elongation(stage: Stage, axis: Axis, plane: Grid, swept: Sweep) -> Array:
    """Mean displacement of the pushed patch less that of the reacting one, along the drive."""
    total = np.zeros_like(swept.solid.nodes)
    for side, sign, along in _pushed(stage, axis):
        shares = face_shares(swept.solid.nodes, swept.faces(plane.sides[side]))
        total[:, :2] += sign * np.outer(shares, along)
    return total


def _reading(stage: Stage, axis: Axis, solid: Grid) -> Array:
    """The reading of an axis' probe as weights of displacements."""
    probe = _probe(stage, axis)
    own = solid.elements[read_by(stage, probe, solid)]
    N, places, volumes = solid_points(solid.nodes, own)
    weights = _rigid(probe, places[..., 0], places[..., 1], volumes)
    total = np.zeros((solid.nodes.shape[0], 3))
    for k in (0, 1):
        np.add.at(total[:, k], own, weights[k] @ N)
    return total
