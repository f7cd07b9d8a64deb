"""Condensed bodies joined at their necks: matrices, drives, readings, loads, stress of a stage."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.fem.condensation import LOADS, Condensed
from flexstage.fem.cutting import Placed
from flexstage.fem.model import STANDARD_GRAVITY
from flexstage.fem.plate_condensation import LOADS_OUT_OF_PLANE, neck_coordinates
from flexstage.fem.substructure import REFERENCE
from flexstage.fem.through_thickness import ThroughThickness
from flexstage.stage import ExtraMass, Stage
from flexstage.stage.outline import Point

# what a load does inside the bodies, of all that it does, below which it is rounding
_NOTHING = 1e-10
_SAME = 1e-8  # what is left of a response that others make up


@dataclass(frozen=True, slots=True, kw_only=True)
class Freedom:
    """In which way the bodies of a stage move: in a plane model, in the plane in space, or out."""

    necks: tuple[str, ...]
    """Name and unit of each motion of a neck."""
    loads: tuple[str, ...]
    """Loads inside each body; the first three are those on its mean motion."""
    out_of_plane: bool = False
    """Whether it is the motion out of the plane."""

    def carried(self, motion: Array, centre: Point, at: Point) -> Array:
        """Carry the motion of a body, one a row, from its centre to another point."""
        x, y = at[0] - centre[0], at[1] - centre[1]
        moved = motion.copy()
        if self.out_of_plane:  # displacement z, rotations about x and y
            moved[0] += y * motion[1] - x * motion[2]
        else:  # displacements x and y, rotation
            moved[0] -= y * motion[2]
            moved[1] += x * motion[2]
        return moved

    def inertia(self, extra: ExtraMass) -> Array:
        """Return what rides on a body, for each of its motions; out of the plane it is a point."""
        out = (extra.mass, 0.0, 0.0)
        return np.array(out if self.out_of_plane else (extra.mass, extra.mass, extra.inertia))


#: Motion in a plane model: along and across each hinge, and rotation.
PLANE = Freedom(necks=("along [m]", "across [m]", "rotation [rad]"), loads=LOADS)


def freedom(through: ThroughThickness | None) -> Freedom:
    """Return in which way bodies move that are condensed with functions through the thickness."""
    if through is None:
        return PLANE
    out = through.out_of_plane
    return Freedom(
        necks=tuple(f"{name} [m]" for name in neck_coordinates(out_of_plane=out)),
        loads=LOADS_OUT_OF_PLANE if out else LOADS,
        out_of_plane=out,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """The bodies of a stage, joined."""

    K: Array
    """Stiffness, shape (n, n)."""
    M: Array
    """Mass, shape (n, n)."""
    coordinates: tuple[str, ...]
    """Name and unit of each coordinate."""
    drives: dict[str, Array]
    """Elongation of each drive, shape (n,)."""
    probes: dict[str, Array]
    """Reading of each probe, shape (n,)."""
    bodies: dict[str, tuple[tuple[float, float], Array]]
    """Centre [m] of each body and its motion there, shape (3, n)."""
    loads: dict[str, tuple[Array, str]]
    """Force on the coordinates, shape (n,), and unit of each load."""
    shares: tuple[tuple[NDArray[np.intp], Array], ...]
    """For each body which coordinates move it, shape (c,), and its own coordinates for them, shape
    (r, c).
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Load:
    """A load on the stage: for each body the sizes of its own loads, for the reference material.

    Without a unit it is not of the stage, but what a drive or a probe adds inside a body.
    """

    unit: str
    parts: list[Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Whole:
    """Mass of a body with what rides on it."""

    mass: float
    centre: tuple[float, float]


def _scales(stage: Stage, placed: Placed) -> tuple[float, float, float]:
    """How much more than the reference stiffness, mass and expansion are."""
    part = placed.part
    # bodies in space are condensed as thick as they are
    thickness = stage.thickness / part.thickness if part.through is None else 1.0
    material = stage.material
    return (
        thickness * material.youngs_modulus / REFERENCE.youngs_modulus,
        thickness * material.density / REFERENCE.density,
        (material.thermal_expansion or 0.0) / (REFERENCE.thermal_expansion or 1.0),
    )


def join(stage: Stage, placed: Sequence[Placed], condensed: Sequence[Condensed]) -> Joint:
    """Join condensed bodies.

    The drives are removed.

    Notes
    -----
    The halves of a notch share the three coordinates of its neck. What a load does inside the
    bodies while their interfaces are held is one more coordinate of the whole stage for each load,
    so that statics under loads are exact inside the bodies too.
    """
    stiff, heavy, expand = _scales(stage, placed[0])
    way = freedom(placed[0].part.through)
    names, index = _coordinates(stage, placed, condensed, way)
    wholes = [_whole(p, c, heavy) for p, c in zip(placed, condensed, strict=True)]
    find = _loads_out_of_plane if way.out_of_plane else _loads
    loads = find(stage, placed, condensed, wholes, (stiff, heavy, expand))
    inside = _inside(loads, condensed)
    inner = np.arange(len(names), len(names) + inside[0].shape[1])
    names += [f"inside {k + 1} [m]" for k in range(inner.size)]
    n = len(names)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    whole = [key for key, load in loads.items() if load.unit]
    forces = np.zeros((len(whole), n))
    lifted = _lifted(stage) if way.out_of_plane else {}
    probes = {name: np.zeros(n) for name in (lifted or (p.name for p in stage.probes))}
    shares, bodies = [], {}
    for b, (p, c) in enumerate(zip(placed, condensed, strict=True)):
        at = np.concatenate((index[b], inner))
        own = np.zeros((c.stiffness.shape[0], at.size))
        own[: index[b].size, : index[b].size] = np.eye(index[b].size)
        own[c.inner, index[b].size :] = inside[b]
        shares.append((at, own))
        where = np.ix_(at, at)
        K[where] += stiff * (own.T @ c.stiffness @ own)
        M[where] += heavy * (own.T @ c.mass @ own)
        acting = c.loads @ own
        for extra in () if p.body.fixed else p.body.extra_masses:
            riding = way.carried(acting[:3], _centre(p, c), extra.at)
            M[where] += riding.T @ (way.inertia(extra)[:, None] * riding)
        forces[:, at] += stiff * np.array([loads[key].parts[b] for key in whole]) @ acting
        for reading, uses in zip(acting[len(way.loads) :], p.readings, strict=True):
            for name, sign in uses:
                probes[name][at] += sign * reading
        for name, (body, place) in lifted.items():
            if body == p.body.name:
                probes[name][at] += way.carried(acting[:3], _centre(p, c), place)[0]
        motion = np.zeros((3, n))
        motion[:, at] = way.carried(acting[:3], _centre(p, c), wholes[b].centre)
        bodies[p.body.name] = wholes[b].centre, motion
    return Joint(
        K=0.5 * (K + K.T),
        M=0.5 * (M + M.T),
        coordinates=tuple(names),
        drives=_drives(stage, placed, index, bodies, n),
        probes=probes,
        bodies=bodies,
        loads={key: (f, loads[key].unit) for key, f in zip(whole, forces, strict=True)},
        shares=tuple(shares),
    )


def _coordinates(
    stage: Stage, placed: Sequence[Placed], condensed: Sequence[Condensed], way: Freedom
) -> tuple[list[str], list[NDArray[np.intp]]]:
    """Name the coordinates; for each body say which are its own."""
    names = [f"hinge {h.name} {motion}" for h in stage.hinges for motion in way.necks]
    each = len(way.necks)
    index = []
    for p, c in zip(placed, condensed, strict=True):
        own = [each * i + k for i in p.hinges for k in range(each)]
        new = []
        for patch in p.patches:
            uses = " and ".join(f"{drive} {('push', 'react')[which]}" for drive, which in patch)
            new.append(f"patch {uses} [m]")
        count = c.modes.stop - c.modes.start
        new += [f"body {p.body.name} mode {i + 1} [kg^0.5 m]" for i in range(count)]
        index.append(np.array([*own, *range(len(names), len(names) + len(new))], dtype=np.intp))
        names += new
    return names, index


def _centre(placed: Placed, condensed: Condensed) -> tuple[float, float]:
    """Centre of a body without what rides on it, in the plane of the stage."""
    _, x, y, _ = condensed.inertia
    return placed.origin[0] + x, placed.origin[1] + y


def _whole(placed: Placed, condensed: Condensed, heavy: float) -> _Whole:
    x, y = _centre(placed, condensed)
    own = heavy * condensed.inertia[0]
    parts = [(own, x, y), *((e.mass, *e.at) for e in placed.body.extra_masses)]
    mass = sum(m for m, _, _ in parts)
    centre = sum(m * px for m, px, _ in parts) / mass, sum(m * py for m, _, py in parts) / mass
    return _Whole(mass=mass, centre=centre)


def _loads(
    stage: Stage,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    wholes: Sequence[_Whole],
    scales: tuple[float, float, float],
) -> dict[str, _Load]:
    """What loads the stage, on each body in the sizes of its own loads."""
    stiff, heavy, expand = scales
    found = {}

    def load(key: str, unit: str = "") -> list[Array]:
        parts = [np.zeros(len(c.loads)) for c in condensed]
        found[key] = _Load(unit=unit, parts=parts)
        return parts

    for i, axis in enumerate("xy"):
        parts = load(f"gravity {axis}", "g")
        for sizes, p, c in zip(parts, placed, condensed, strict=True):
            weight = STANDARD_GRAVITY / stiff
            sizes[i] = weight * heavy * c.inertia[0]
            x, y = _centre(p, c)
            for e in () if p.body.fixed else p.body.extra_masses:
                sizes[i] += weight * e.mass
                sizes[2] += weight * e.mass * (y - e.at[1], e.at[0] - x)[i]
    if stage.material.thermal_expansion is not None:
        total = sum(w.mass for w in wholes)
        middle = [sum(w.mass * w.centre[i] for w in wholes) / total for i in (0, 1)]
        for sizes in load("temperature", "K"):
            sizes[3] = expand
        for i, axis in enumerate("xy"):
            for sizes, p in zip(load(f"temperature gradient {axis}", "K/m"), placed, strict=True):
                sizes[4 + i] = expand
                sizes[3] = expand * (p.origin[i] - middle[i])
    for drive in stage.drives:
        offset = _offset(drive.at, drive.direction)
        for b, p in enumerate(placed):
            if offset and p.body.name == drive.reacts and _stands(p, drive.name):
                load(f"drive {drive.name}")[b][2] = offset / stiff
    for probe in stage.probes:
        parts = load(f"probe {probe.name}")
        for sizes, p in zip(parts, placed, strict=True):
            for k, uses in enumerate(p.readings):
                sizes[len(LOADS) + k] += sum(s for name, s in uses if name == probe.name) / stiff
    return found


def _lifted(stage: Stage) -> dict[str, tuple[str, Point]]:
    """Name the readings out of the plane: of each body that a probe reads, at the first of them."""
    found: dict[str, tuple[str, Point]] = {}
    for probe in stage.probes:
        found.setdefault(f"{probe.body} out of plane", (probe.body, probe.at))
    return found


def _loads_out_of_plane(
    stage: Stage,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    wholes: Sequence[_Whole],
    scales: tuple[float, float, float],
) -> dict[str, _Load]:
    """What loads the stage out of its plane, on each body in the sizes of its own loads."""
    stiff, heavy, expand = scales
    found = {}

    def load(key: str, unit: str = "") -> list[Array]:
        parts = [np.zeros(len(c.loads)) for c in condensed]
        found[key] = _Load(unit=unit, parts=parts)
        return parts

    def push(sizes: Array, force: float, centre: Point, at: Point) -> None:
        x, y = at[0] - centre[0], at[1] - centre[1]
        sizes[:3] += np.array([force, y * force, -x * force]) / stiff

    for sizes, p, c, whole in zip(load("gravity z", "g"), placed, condensed, wholes, strict=True):
        own = _centre(p, c)
        fixed = p.body.fixed
        mass, at = (heavy * c.inertia[0], own) if fixed else (whole.mass, whole.centre)
        push(sizes, STANDARD_GRAVITY * mass, own, at)
    if stage.material.thermal_expansion is not None:
        for sizes in load("temperature gradient z", "K/m"):
            sizes[LOADS_OUT_OF_PLANE.index("temperature gradient z")] = expand
    for name, (body, at) in _lifted(stage).items():
        for sizes, p, c in zip(load(f"probe {name}"), placed, condensed, strict=True):
            if p.body.name == body:
                push(sizes, 1.0, _centre(p, c), at)
    return found


def _offset(at: tuple[tuple[float, float], tuple[float, float]], direction: float) -> float:
    """How far the reacting point of a drive lies beside its line, to the left [m]."""
    aside = (-math.sin(direction), math.cos(direction))
    offset = sum(c * (q - p) for c, p, q in zip(aside, *at, strict=True))
    return offset if abs(offset) > 1e-9 else 0.0


def _stands(placed: Placed, drive: str) -> bool:
    return any((drive, 1) in patch for patch in placed.patches)


def _inside(loads: Mapping[str, _Load], condensed: Sequence[Condensed]) -> list[Array]:
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


def _drives(
    stage: Stage,
    placed: Sequence[Placed],
    index: Sequence[NDArray[np.intp]],
    bodies: Mapping[str, tuple[tuple[float, float], Array]],
    n: int,
) -> dict[str, Array]:
    found = {d.name: np.zeros(n) for d in stage.drives}
    each = len(freedom(placed[0].part.through).necks)
    for p, own in zip(placed, index, strict=True):
        first = each * len(p.hinges)
        for k, uses in enumerate(p.patches):
            for name, which in uses:
                found[name][own[first + k]] += 1.0 if which == 0 else -1.0
                drive = stage.drive(name)
                if which == 1 and (offset := _offset(drive.at, drive.direction)):
                    # the point on the line, to the right of the patch, is moved on by a turn
                    found[name] -= offset * bodies[p.body.name][1][2]
    return found


def stacked(joints: Sequence[Joint]) -> Joint:
    """Put motions side by side that know nothing of each other.

    Drives and bodies are those of the first.
    """
    first = joints[0]
    offsets = np.cumsum([0, *(len(j.coordinates) for j in joints)])
    n = int(offsets[-1])

    def whole(k: int, rows: Array) -> Array:
        found = np.zeros((*rows.shape[:-1], n))
        found[..., offsets[k] : offsets[k + 1]] = rows
        return found

    return Joint(
        K=np.asarray(block_diag(*(j.K for j in joints))),
        M=np.asarray(block_diag(*(j.M for j in joints))),
        coordinates=tuple(
            f"{'out of plane, ' if k else ''}{name}"
            for k, j in enumerate(joints)
            for name in j.coordinates
        ),
        drives={name: whole(0, v) for name, v in first.drives.items()},
        probes={name: whole(k, v) for k, j in enumerate(joints) for name, v in j.probes.items()},
        bodies={name: (at, whole(0, rows)) for name, (at, rows) in first.bodies.items()},
        loads={
            name: (whole(k, v), unit)
            for k, j in enumerate(joints)
            for name, (v, unit) in j.loads.items()
        },
        shares=tuple((at + offsets[k], own) for k, j in enumerate(joints) for at, own in j.shares),
    )


def lowest(joint: Joint, count: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the lowest modes of a stage and its static responses to drives, probes and loads.

    Returns the frequencies of the new coordinates [rad/s], shape (r,), of which the first `count`
    are natural ones; what they move, with unit modal mass, shape (n, r); and which of them are
    modes, shape (r,).
    """
    # columns of unit mass: metres, radians and modes become comparable
    size = 1.0 / np.sqrt(np.diag(joint.M))
    try:
        squares, shapes = eigh(
            joint.K * np.outer(size, size),
            joint.M * np.outer(size, size),
            driver="gvd",
            check_finite=False,
        )
    except np.linalg.LinAlgError as error:
        raise ModelError("a body has no mass, so the stage has no natural frequencies") from error
    shapes *= size[:, None]
    count = min(count, squares.size)
    vectors = [
        *joint.drives.values(),
        *joint.probes.values(),
        *(v for v, _ in joint.loads.values()),
    ]
    omega = np.sqrt(np.clip(squares[:count], 0.0, None))
    high, above = shapes[:, count:], squares[count:]
    if not vectors or not above.size:
        return omega, shapes[:, :count], np.ones(count, dtype=bool)
    response = (high.T @ np.array(vectors).T) / above[:, None]
    length = np.linalg.norm(response, axis=0)
    response = response[:, length > 0.0] / length[length > 0.0]
    left, values, _ = np.linalg.svd(response, full_matrices=False)
    basis = left[:, values > 1e-9 * values.max(initial=0.0)]
    rest, turn = np.linalg.eigh(basis.T @ (above[:, None] * basis))
    residual = high @ (basis @ turn)
    all_omega = np.concatenate((omega, np.sqrt(rest)))
    return (
        all_omega,
        np.column_stack((shapes[:, :count], residual)),
        np.arange(all_omega.size) < count,
    )
