"""Condensed bodies joined at their necks: matrices, drives, readings, loads, stress of a stage."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve, eigh

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.fem.condensation import Condensed, independent, softest_modes
from flexstage.fem.layered_plate import REFERENCE
from flexstage.fem.necks import InterfaceDofs, interface_dofs
from flexstage.fem.stage_system import Ports, lifted_probes, side_by_side, turned_bodies
from flexstage.fem.substructure import Placed
from flexstage.stage import Stage
from flexstage.system.mechanical import STANDARD_GRAVITY
from flexstage.system.stress_map import StressByForces, StressMap, StressOfForces
from flexstage.system.thermal_transient import heats

# what a load does inside the bodies, of all that it does, below which it is rounding
_NOTHING = 1e-10
_SAME = 1e-8  # what is left of a response that others make up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyLoads:
    """A load on the stage: for each body the sizes of its own loads, for the reference material.

    Without a unit it is not a load of the stage, but one by a drive or a probe inside a body.
    """

    unit: str
    parts: list[Array]


#: Mass of a body with its extra masses [kg], and their centre [m].
WholeBody = tuple[float, tuple[float, float]]


def reference_scales(stage: Stage, placed: Placed) -> tuple[float, float, float]:
    """Return stiffness, mass and expansion over those of the reference."""
    # a plane model is condensed with a thickness near that of the stage, one in space with its own
    thickness = stage.thickness / placed.part.through.thickness
    material = stage.material
    return (
        thickness * material.youngs_modulus / REFERENCE.youngs_modulus,
        thickness * material.density / REFERENCE.density,
        (material.thermal_expansion or 0.0) / (REFERENCE.thermal_expansion or 1.0),
    )


def own_centre(placed: Placed, condensed: Condensed) -> tuple[float, float]:
    """Return the centre of a body without its extra masses, in the plane of the stage."""
    _, x, y, _ = condensed.inertia
    return placed.origin[0] + x, placed.origin[1] + y


def whole_body(placed: Placed, condensed: Condensed, heavy: float) -> WholeBody:
    """Return mass and centre of a body with its extra masses."""
    x, y = own_centre(placed, condensed)
    body_mass = heavy * condensed.inertia[0]
    parts = [(body_mass, x, y), *((e.mass, *e.at) for e in placed.body.extra_masses)]
    mass = sum(m for m, _, _ in parts)
    centre = sum(m * px for m, px, _ in parts) / mass, sum(m * py for m, _, py in parts) / mass
    return mass, centre


def stage_loads(
    stage: Stage,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    wholes: Sequence[WholeBody],
    way: InterfaceDofs,
) -> dict[str, BodyLoads]:
    """Return the loads of the stage by name, on each body in terms of its own loads."""
    stiff, heavy, expand = reference_scales(stage, placed[0])
    loads = {}

    def load(key: str, unit: str = "") -> list[Array]:
        parts = [np.zeros(len(c.loads)) for c in condensed]
        loads[key] = BodyLoads(unit=unit, parts=parts)
        return parts

    for i, axis in enumerate(way.axes):
        for sizes, p, c in zip(load(f"gravity {axis}", "g"), placed, condensed, strict=True):
            weight = STANDARD_GRAVITY / stiff
            sizes[i] = weight * heavy * c.inertia[0]
            for e in () if p.body.fixed else p.body.extra_masses:
                sizes[:3] += weight * e.mass * way.read(own_centre(p, c), e.at)[i]
    if stage.expands:
        fields = {name: way.loads.index(name) for name in way.loads if "temperature" in name}
        total = sum(mass for mass, _ in wholes)
        middle = [sum(mass * centre[i] for mass, centre in wholes) / total for i in (0, 1)]
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
        return loads
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
    return loads


def reaction_offset(at: tuple[tuple[float, float], tuple[float, float]], direction: float) -> float:
    """Return the offset of the reacting point of a drive from its line, to the left [m]."""
    aside = (-math.sin(direction), math.cos(direction))
    offset = sum(c * (q - p) for c, p, q in zip(aside, *at, strict=True))
    return offset if abs(offset) > 1e-9 else 0.0


def _stands(placed: Placed, drive: str) -> bool:
    return any((drive, 1) in patch for patch in placed.patches)


def inner_responses(loads: Mapping[str, BodyLoads], condensed: Sequence[Condensed]) -> list[Array]:
    """Return the responses inside the bodies to the loads, as coordinates of the stage.

    Returns for each body the share of each of its own responses in them, shape (l, s).
    """
    shapes, gram, energy, work = [], 0.0, 0.0, 0.0
    for b, c in enumerate(condensed):
        parts = np.array([load.parts[b] for load in loads.values()]).reshape(-1, len(c.loads))
        energies = np.einsum("ij,ij->i", parts @ c.stiffness[c.inner, c.inner], parts)
        force = parts @ c.loads[:, c.modes]
        energy = energy + energies
        work = work + energies + np.sum(force**2 / np.diag(c.stiffness)[c.modes], axis=1)
        gram = gram + parts @ c.mass[c.inner, c.inner] @ parts.T
        shapes.append(parts.T)
    acts = np.flatnonzero(np.asarray(energy) > _NOTHING * np.asarray(work))
    gram = np.asarray(gram)[np.ix_(acts, acts)]
    shapes = [w[:, acts] for w in shapes]
    # loads that do the same count once
    size = 1.0 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * np.outer(size, size))
    mean = math.sqrt(sum(c.inertia[0] for c in condensed))
    independent = size[:, None] * vectors[:, values > _SAME] * mean
    return [w @ independent for w in shapes]


# Stages of fewer coordinates than this for each mode are solved densely; squares of frequencies of
# larger ones end with the last change of them.
_FEW, _SETTLED = 10, 1e-8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """The bodies of a stage, joined."""

    blocks: tuple[tuple[Array, Array], ...]
    """Stiffness and mass of each of its decoupled motions."""
    coordinates: tuple[str, ...]
    """Name and unit of each coordinate."""
    ports: Ports
    """Drives, probes, bodies and loads in these coordinates."""
    shares: tuple[tuple[NDArray[np.intp], Array], ...]
    """For each body the coordinates that move it, shape (c,), and its own coordinates for them,
    shape (r, c).
    """

    @property
    def K(self) -> Array:
        """Stiffness, shape (n, n)."""
        return _block_diagonal([K for K, _ in self.blocks])

    @property
    def M(self) -> Array:
        """Mass, shape (n, n)."""
        return _block_diagonal([M for _, M in self.blocks])


def _block_diagonal(blocks: list[Array]) -> Array:
    return blocks[0] if len(blocks) == 1 else np.asarray(block_diag(*blocks))


def join(stage: Stage, placed: Sequence[Placed], condensed: Sequence[Condensed]) -> Joint:
    """Join condensed bodies.

    The drives are removed.

    Notes
    -----
    The halves of a notch share the three coordinates of its neck. The response inside the bodies to
    a load, with fixed interfaces, is one more coordinate of the stage for each load, so that
    statics under loads are exact inside the bodies too.
    """
    stiff, heavy, _ = reference_scales(stage, placed[0])
    way = interface_dofs(placed[0].part.through)
    names, index = _coordinates(stage, placed, condensed, way)
    wholes = [whole_body(p, c, heavy) for p, c in zip(placed, condensed, strict=True)]
    loads = stage_loads(stage, placed, condensed, wholes, way)
    inside = inner_responses(loads, condensed)
    inner = np.arange(len(names), len(names) + inside[0].shape[1])
    names += [f"inside {k + 1} [m]" for k in range(inner.size)]
    n = len(names)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    stage_load_names = [key for key, load in loads.items() if load.unit]
    forces = np.zeros((len(stage_load_names), n))
    lifted = lifted_probes(stage) if way.out_of_plane else {}
    probes = {name: np.zeros(n) for name in (lifted or (p.name for p in stage.probes))}
    shares, bodies, heated = [], {}, {}
    for b, (p, c) in enumerate(zip(placed, condensed, strict=True)):
        at = np.concatenate((index[b], inner))
        local = np.zeros((c.stiffness.shape[0], at.size))
        local[: index[b].size, : index[b].size] = np.eye(index[b].size)
        local[c.inner, index[b].size :] = inside[b]
        shares.append((at, local))
        where = np.ix_(at, at)
        K[where] += stiff * _responding(c.stiffness, inside[b])
        M[where] += heavy * _responding(c.mass, inside[b])
        acting = np.hstack((c.loads[:, : index[b].size], c.loads[:, c.inner] @ inside[b]))
        for extra in () if p.body.fixed else p.body.extra_masses:
            riding = way.transferred(acting[:3], own_centre(p, c), extra.at)
            M[where] += riding.T @ (way.inertia(extra)[:, None] * riding)
        forces[:, at] += (
            stiff * np.array([loads[key].parts[b] for key in stage_load_names]) @ acting
        )
        for reading, uses in zip(acting[len(way.loads) :], p.readings, strict=True):
            for name, sign in uses:
                probes[name][at] += sign * reading
        for name, (body, place) in lifted.items():
            if body == p.body.name:
                probes[name][at] += way.transferred(acting[:3], own_centre(p, c), place)[0]
        motion = np.zeros((3, n))
        _, centre = wholes[b]
        motion[:, at] = way.transferred(acting[:3], own_centre(p, c), centre)
        bodies[p.body.name] = centre, motion
        if "temperature" in loads and heats(stage):
            heated[p.body.name] = np.zeros(n)
            heated[p.body.name][at] = stiff * loads["temperature"].parts[b] @ acting
    return Joint(
        blocks=((K, M),),
        coordinates=tuple(names),
        ports=Ports(
            drives=_drives(stage, placed, index, bodies, n),
            probes=probes,
            bodies=bodies,
            loads={
                key: (f, loads[key].unit) for key, f in zip(stage_load_names, forces, strict=True)
            },
            heated=heated,
            turned=turned_bodies(stage) if heated else (),
        ),
        shares=tuple(shares),
    )


def _responding(matrix: Array, inside: Array) -> Array:
    """Return a matrix of a body whose last coordinates, the inner ones, respond to loads."""
    first = len(matrix) - len(inside)
    extended = np.empty((first + inside.shape[1], first + inside.shape[1]))
    extended[:first, :first] = matrix[:first, :first]
    extended[:first, first:] = matrix[:first, first:] @ inside
    extended[first:, :first] = extended[:first, first:].T
    extended[first:, first:] = inside.T @ matrix[first:, first:] @ inside
    return extended


def _coordinates(
    stage: Stage, placed: Sequence[Placed], condensed: Sequence[Condensed], way: InterfaceDofs
) -> tuple[list[str], list[NDArray[np.intp]]]:
    """Return the names of the coordinates, and those of each body."""
    names = [f"hinge {h.name} {motion}" for h in stage.hinges for motion in way.necks]
    each = len(way.necks)
    index = []
    for p, c in zip(placed, condensed, strict=True):
        neck_numbers = [each * i + k for i in p.hinges for k in range(each)]
        new = []
        for patch in p.patches:
            uses = " and ".join(f"{drive} {('push', 'react')[which]}" for drive, which in patch)
            new.append(f"patch {uses} [m]")
        count = c.modes.stop - c.modes.start
        new += [f"body {p.body.name} mode {i + 1} [kg^0.5 m]" for i in range(count)]
        index.append(
            np.array([*neck_numbers, *range(len(names), len(names) + len(new))], dtype=np.intp)
        )
        names += new
    return names, index


def _drives(
    stage: Stage,
    placed: Sequence[Placed],
    index: Sequence[NDArray[np.intp]],
    bodies: Mapping[str, tuple[tuple[float, float], Array]],
    n: int,
) -> dict[str, Array]:
    vectors = {d.name: np.zeros(n) for d in stage.drives}
    each = len(interface_dofs(placed[0].part.through).necks)
    for p, local in zip(placed, index, strict=True):
        first = each * len(p.hinges)
        for k, uses in enumerate(p.patches):
            for name, which in uses:
                vectors[name][local[first + k]] += 1.0 if which == 0 else -1.0
                drive = stage.drive(name)
                if which == 1 and (offset := reaction_offset(drive.at, drive.direction)):
                    # the point on the line, to the right of the patch, is moved on by a turn
                    vectors[name] -= offset * bodies[p.body.name][1][2]
    return vectors


def stacked(joints: Sequence[Joint]) -> Joint:
    """Combine decoupled motions."""
    sizes = [len(j.coordinates) for j in joints]
    offsets = np.cumsum([0, *sizes])
    return Joint(
        blocks=tuple(block for j in joints for block in j.blocks),
        coordinates=tuple(
            f"{'out of plane, ' if k else ''}{name}"
            for k, j in enumerate(joints)
            for name in j.coordinates
        ),
        ports=side_by_side([j.ports for j in joints], sizes),
        shares=tuple(
            (at + offsets[k], local) for k, j in enumerate(joints) for at, local in j.shares
        ),
    )


def joined_stress(
    stage: Stage,
    joint: Joint,
    placed: Sequence[Placed],
    condensed: Sequence[Condensed],
    basis: Array,
) -> StressMap:
    """Return the stress of all notches; at the ends of a neck its two halves meet in one point."""
    scale = stage.material.youngs_modulus / REFERENCE.youngs_modulus
    # the motions in space know nothing of each other, but stress the same places
    ways = len(condensed) // len(stage.bodies)
    count = sum(c.neck.size for c in condensed) // ways
    levels = max((int(np.abs(c.seam).max(initial=1)) for c in condensed), default=1)
    shares = []
    owner, point = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp)
    at, used = 0, 2 * levels * len(stage.hinges)
    for k, (p, c, (index, local)) in enumerate(zip(placed, condensed, joint.shares, strict=True)):
        at %= count or 1
        here = slice(at, at + c.neck.size)
        if not c.neck.size:
            continue
        each = c.stress.shape[2]
        forces = scale * c.forces(local @ basis[index])
        ends = np.searchsorted(c.neck, np.arange(len(p.hinges) + 1))
        for i, (first, end) in enumerate(pairwise(ends.tolist())):
            carried = forces[each * i : each * (i + 1)]
            shares.append(StressByForces(at + first, c.stress[first:end], carried))
        if k < len(stage.bodies):
            owner[here] = np.array(p.hinges, dtype=np.intp)[c.neck]
            shared = 2 * (levels * owner[here] + np.abs(c.seam) - 1) + (c.seam > 0)
            point[here] = np.where(c.seam != 0, shared, used + c.point)
            used += int(c.point.max()) + 1
        at += c.neck.size
    return StressMap(
        hinges=tuple(h.name for h in stage.hinges),
        matrix=StressOfForces(count=count, shares=tuple(shares)),
        owner=owner,
        point=point,
    )


def lowest(joint: Joint, count: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the lowest modes of a stage and its static responses to drives, probes and loads.

    Returns the frequencies of the new coordinates [rad/s], shape (r,), of which the first `count`
    are natural ones; their shapes, with unit modal mass, shape (n, r); and which of them are
    modes, shape (r,).
    """
    try:
        if not np.all(np.diag(joint.M) > 0.0):
            raise np.linalg.LinAlgError
        # columns of unit mass: metres, radians and modes become comparable
        size = 1.0 / np.sqrt(np.diag(joint.M))
        K, M = (matrix * np.outer(size, size) for matrix in (joint.K, joint.M))
        n = size.size
        count = min(count, n)
        factor = cho_factor(K.T, check_finite=False)
        omega, modes = _softest(K, M, factor, count)
    except np.linalg.LinAlgError as error:
        raise ModelError(
            "a body has no mass or is not attached, so the stage has no natural frequencies"
        ) from error
    vectors = joint.ports.static_vectors
    if not vectors or count == n:
        return omega, size[:, None] * modes, np.ones(count, dtype=bool)
    forces = size[:, None] * np.array(vectors).T
    weighted = M @ modes
    basis = cho_solve(factor, forces - weighted @ (modes.T @ forces), check_finite=False)
    basis = basis[:, np.any(basis != 0.0, axis=0)]
    for _ in range(2):
        basis = basis - modes @ (weighted.T @ basis)
        basis = basis @ independent(basis.T @ M @ basis)
    rest, turn = np.linalg.eigh(basis.T @ K @ basis)
    residual = basis @ turn
    all_omega = np.concatenate((omega, np.sqrt(rest)))
    return (
        all_omega,
        size[:, None] * np.column_stack((modes, residual)),
        np.arange(all_omega.size) < count,
    )


def _softest(K: Array, M: Array, factor: tuple[Array, bool], count: int) -> tuple[Array, Array]:
    """Return the lowest frequencies [rad/s] and their modes, of unit mass."""
    n = len(K)
    if n < _FEW * count:
        # the largest eigenvalues of M against K: those asked for alone, and the softest modes,
        # which are the largest here, to all digits
        range_of_modes = (n - count, n - 1)
        inverses, shapes = eigh(
            M, K, subset_by_index=range_of_modes, driver="gvx", check_finite=False
        )
        omega = 1.0 / np.sqrt(inverses[::-1])
        return omega, shapes[:, ::-1] * omega
    squares, modes = softest_modes(
        lambda forces: np.asarray(cho_solve(factor, forces, check_finite=False)),
        lambda u: M @ u,
        np.random.default_rng(0).standard_normal((n, count)),
        count,
        _SETTLED,
    )
    return np.sqrt(squares), modes
