"""What loads a stage of condensed bodies: weight, temperature, drives and probes, body by body."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array
from flexstage.fem.condensation import Condensed
from flexstage.fem.cutting import Placed
from flexstage.fem.neck_motions import Freedom
from flexstage.fem.stage_system import lifted_probes
from flexstage.fem.substructure import REFERENCE
from flexstage.stage import Stage
from flexstage.system.mechanical import STANDARD_GRAVITY

# what a load does inside the bodies, of all that it does, below which it is rounding
_NOTHING = 1e-10
_SAME = 1e-8  # what is left of a response that others make up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyLoads:
    """A load on the stage: for each body the sizes of its own loads, for the reference material.

    Without a unit it is not of the stage, but what a drive or a probe adds inside a body.
    """

    unit: str
    parts: list[Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeBody:
    """Mass of a body with what rides on it."""

    mass: float
    centre: tuple[float, float]


def reference_scales(stage: Stage, placed: Placed) -> tuple[float, float, float]:
    """How much more than the reference stiffness, mass and expansion are."""
    # a plane model is condensed with a thickness near that of the stage, one in space with its own
    thickness = stage.thickness / placed.part.through.thickness
    material = stage.material
    return (
        thickness * material.youngs_modulus / REFERENCE.youngs_modulus,
        thickness * material.density / REFERENCE.density,
        (material.thermal_expansion or 0.0) / (REFERENCE.thermal_expansion or 1.0),
    )


def own_centre(placed: Placed, condensed: Condensed) -> tuple[float, float]:
    """Centre of a body without what rides on it, in the plane of the stage."""
    _, x, y, _ = condensed.inertia
    return placed.origin[0] + x, placed.origin[1] + y


def whole_body(placed: Placed, condensed: Condensed, heavy: float) -> WholeBody:
    """Return mass and centre of a body with what rides on it."""
    x, y = own_centre(placed, condensed)
    own = heavy * condensed.inertia[0]
    parts = [(own, x, y), *((e.mass, *e.at) for e in placed.body.extra_masses)]
    mass = sum(m for m, _, _ in parts)
    centre = sum(m * px for m, px, _ in parts) / mass, sum(m * py for m, _, py in parts) / mass
    return WholeBody(mass=mass, centre=centre)


def stage_loads(
    stage: Stage,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    wholes: Sequence[WholeBody],
    way: Freedom,
) -> dict[str, BodyLoads]:
    """Return what loads the stage, on each body in the sizes of its own loads, by name."""
    stiff, heavy, expand = reference_scales(stage, placed[0])
    found = {}

    def load(key: str, unit: str = "") -> list[Array]:
        parts = [np.zeros(len(c.loads)) for c in condensed]
        found[key] = BodyLoads(unit=unit, parts=parts)
        return parts

    for i, axis in enumerate(way.axes):
        for sizes, p, c in zip(load(f"gravity {axis}", "g"), placed, condensed, strict=True):
            weight = STANDARD_GRAVITY / stiff
            sizes[i] = weight * heavy * c.inertia[0]
            for e in () if p.body.fixed else p.body.extra_masses:
                sizes[:3] += weight * e.mass * way.read(own_centre(p, c), e.at)[i]
    if stage.material.thermal_expansion is not None:
        fields = {name: way.loads.index(name) for name in way.loads if "temperature" in name}
        total = sum(w.mass for w in wholes)
        middle = [sum(w.mass * w.centre[i] for w in wholes) / total for i in (0, 1)]
        for name, at in fields.items():
            parts = load(name, "K/m" if "gradient" in name else "K")
            for sizes, p in zip(parts, placed, strict=True):
                sizes[at] = expand
                if name[-1] in "xy":  # about the middle of the stage, not of the body
                    i = "xy".index(name[-1])
                    sizes[fields["temperature"]] = expand * (p.origin[i] - middle[i])
    if way.out_of_plane:
        for name, (body, place) in lifted_probes(stage).items():
            for sizes, p, c in zip(load(f"probe {name}"), placed, condensed, strict=True):
                if p.body.name == body:
                    sizes[:3] += way.read(own_centre(p, c), place)[0] / stiff
        return found
    for drive in stage.drives:
        offset = reaction_offset(drive.at, drive.direction)
        for b, p in enumerate(placed):
            if offset and p.body.name == drive.reacts and _stands(p, drive.name):
                load(f"drive {drive.name}")[b][2] = offset / stiff
    for probe in stage.probes:
        for sizes, p in zip(load(f"probe {probe.name}"), placed, strict=True):
            for k, uses in enumerate(p.readings):
                size = sum(s for name, s in uses if name == probe.name) / stiff
                sizes[len(way.loads) + k] += size
    return found


def reaction_offset(at: tuple[tuple[float, float], tuple[float, float]], direction: float) -> float:
    """How far the reacting point of a drive lies beside its line, to the left [m]."""
    aside = (-math.sin(direction), math.cos(direction))
    offset = sum(c * (q - p) for c, p, q in zip(aside, *at, strict=True))
    return offset if abs(offset) > 1e-9 else 0.0


def _stands(placed: Placed, drive: str) -> bool:
    return any((drive, 1) in patch for patch in placed.patches)


def inner_responses(loads: Mapping[str, BodyLoads], condensed: Sequence[Condensed]) -> list[Array]:
    """Find what the loads do inside the bodies: coordinates of the whole stage.

    Returns for each body how much of each of its own responses is in them, shape (l, s).
    """
    shapes, gram, energy, work = [], 0.0, 0.0, 0.0
    for b, c in enumerate(condensed):
        parts = np.array([load.parts[b] for load in loads.values()]).reshape(-1, len(c.loads))
        own = np.einsum("ij,ij->i", parts @ c.stiffness[c.inner, c.inner], parts)
        force = parts @ c.loads[:, c.modes]
        energy = energy + own
        work = work + own + np.sum(force**2 / np.diag(c.stiffness)[c.modes], axis=1)
        gram = gram + parts @ c.mass[c.inner, c.inner] @ parts.T
        shapes.append(parts.T)
    acts = np.flatnonzero(np.asarray(energy) > _NOTHING * np.asarray(work))
    gram = np.asarray(gram)[np.ix_(acts, acts)]
    shapes = [w[:, acts] for w in shapes]
    # loads that do the same count once
    size = 1.0 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * np.outer(size, size))
    mean = math.sqrt(sum(c.inertia[0] for c in condensed))
    kept = size[:, None] * vectors[:, values > _SAME] * mean
    return [w @ kept for w in shapes]
