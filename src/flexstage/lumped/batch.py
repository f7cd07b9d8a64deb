r"""The lumped model of many stages of one topology at once: systems, figures and derivatives."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.lumped.assemble import lumped_system
from flexstage.lumped.stage_arrays import StageArrays, StageTangents
from flexstage.stage import Stage
from flexstage.system.batch import SystemBatch, namespace_of, samples_first, samples_last
from flexstage.system.batch_analysis import batch_characteristics
from flexstage.system.mechanical import STANDARD_GRAVITY, MechanicalSystem

#: Fields that the system has as its description has them.
AS_DESCRIBED = (
    "drive_at",
    "probe_at",
    "drive_stiffness",
    "stroke",
    "smallest_displacement",
    "largest_force",
    "strength",
    "size",
)


@lru_cache(maxsize=16)
def _nominal(stage: Stage, method: str, plane: PlaneState | Literal["auto"]) -> MechanicalSystem:
    return lumped_system(stage, method=method, plane=plane)


def assemble_batch(arrays: StageArrays) -> SystemBatch:
    r"""Return the lumped models of many stages.

    As `flexstage.lumped.lumped_system` does of one: a hinge of stiffness k, turned into the plane,
    adds :math:`P_a^T k P_a`, :math:`P_b^T k P_b` and :math:`-P_a^T k P_b` to the blocks of its two
    bodies, with P the motion of the neck for that of the body's centre of mass.

    Parameters
    ----------
    arrays : StageArrays
        What they are made of.

    Returns
    -------
    SystemBatch
        The systems.

    Raises
    ------
    ModelError
        Every body of the nominal stage is fixed.
    """
    xp, stage = namespace_of(arrays), arrays.stage
    nominal = _nominal(stage, arrays.method, arrays.plane)
    every = {body.name: i for i, body in enumerate(stage.bodies)}
    free = {b.name: i for i, b in enumerate(b for b in stage.bodies if not b.fixed)}
    centre = samples_last(xp, arrays.centre)

    def taken(x: Array, which: list[int]) -> Array:
        return xp.take(x, xp.asarray(which, dtype=xp.int64), axis=0)

    def arm(at: Array, bodies: list[str]) -> tuple[Array, Array]:
        """From the centres of mass of bodies to points, x and y."""
        from_ = taken(centre, [every[name] for name in bodies])
        return at[:, 0, ...] - from_[:, 0, ...], at[:, 1, ...] - from_[:, 1, ...]

    def pair(names: Sequence[str]) -> tuple[int, int]:
        return free.get(names[0], -1), free.get(names[1], -1)

    joined = [pair(hinge.bodies) for hinge in stage.hinges]
    blocks, stress = {}, xp.zeros((0, 2, 3, 1))
    if stage.hinges:
        at, angle = samples_last(xp, arrays.hinge_at), samples_last(xp, arrays.hinge_direction)
        c, s = xp.cos(angle), xp.sin(angle)
        k = samples_last(xp, arrays.hinge_stiffness)
        arms = [arm(at, [hinge.bodies[side] for hinge in stage.hinges]) for side in (0, 1)]
        blocks = _blocks(xp, len(free), joined, _hinge_blocks(xp, k, c, s, arms))
        if arrays.stress_owner:
            owner = list(arrays.stress_owner)
            rows = samples_last(xp, arrays.stress_rows)
            local = [[taken(k[:, i, j, ...], owner) for j in range(3)] for i in range(3)]
            stress = _stress(
                xp,
                rows,
                local,
                (taken(c, owner), taken(s, owner)),
                [(taken(x, owner), taken(y, owner)) for x, y in arms],
            )
    drives = stage.drives
    drive = xp.zeros((0, 2, 3, 1))
    if drives:
        at, angle = samples_last(xp, arrays.drive_at), samples_last(xp, arrays.drive_direction)
        c, s = xp.cos(angle), xp.sin(angle)
        # one line of action, through the pushed point
        x, y = arm(at, [d.pushes for d in drives])
        u, v = arm(at, [d.reacts for d in drives])
        drive = _rows(xp, [(c, s, s * x - c * y), (-c, -s, c * v - s * u)])
    probes = stage.probes
    probe, along = xp.zeros((0, 2, 3, 1)), xp.zeros((0, 2, 1))
    if probes:
        at, angle = samples_last(xp, arrays.probe_at), samples_last(xp, arrays.probe_direction)
        moves = xp.asarray([[float(p.unit == "m")] for p in probes], dtype=xp.float64)
        c, s, turns = moves * xp.cos(angle), moves * xp.sin(angle), 1.0 - moves
        held = xp.asarray([[float(p.relative_to is not None)] for p in probes], dtype=xp.float64)
        x, y = arm(at, [p.body for p in probes])
        u, v = arm(at, [p.relative_to or p.body for p in probes])
        own = (c, s, s * x - c * y + turns)
        against = (-held * c, -held * s, held * (c * v - s * u - turns))
        probe, along = _rows(xp, [own, against]), _stacked(xp, (c, s), 1)
    mass, inertia = (samples_last(xp, x) for x in (arrays.mass, arrays.inertia))
    moving = [every[name] for name in free]
    own = taken(mass, moving)
    diagonal = _stacked(xp, (own, own, taken(inertia, moving)), 1)
    return SystemBatch(
        stage=stage,
        nominal=nominal,
        mass=samples_first(xp, xp.reshape(diagonal, (3 * len(free), -1))),
        stiffness=samples_first(xp, _stacked(xp, list(blocks.values()), 0)),
        blocks=tuple(blocks),
        drive=samples_first(xp, drive),
        drive_bodies=tuple(pair((d.pushes, d.reacts)) for d in drives),
        probe=samples_first(xp, probe),
        probe_bodies=tuple(pair((p.body, p.relative_to or "")) for p in probes),
        stress=samples_first(xp, stress),
        stress_bodies=tuple(joined[i] for i in arrays.stress_owner),
        weight=samples_first(xp, own * STANDARD_GRAVITY),
        weight_direction=samples_first(xp, along),
        body_mass=arrays.mass,
        **{name: getattr(arrays, name) for name in AS_DESCRIBED},
    )


def _stacked(xp: Any, parts: Sequence[Array], axis: int) -> Array:
    """Stack arrays of which some may have one sample for all."""
    return xp.stack(xp.broadcast_arrays(*parts), axis=axis)


def _rows(xp: Any, sides: Sequence[tuple[Array, Array, Array]]) -> Array:
    """Rows for the coordinates of two bodies, shape (k, 2, 3, S)."""
    flat = _stacked(xp, [part for side in sides for part in side], 1)
    return xp.reshape(flat, (flat.shape[0], 2, 3, flat.shape[-1]))


def _hinge_blocks(
    xp: Any, k: Array, c: Array, s: Array, arms: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array, Array]:
    """What each hinge adds to the blocks (a, a), (b, b) and (a, b), shape (3, 3, h, S)."""
    (xa, ya), (xb, yb) = arms
    kuu, kvv, ktt, kuv, kut, kvt = (
        k[:, i, j, ...] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    cc, ss, cs = c * c, s * s, c * s
    twice = 2.0 * cs * kuv
    kxx = cc * kuu - twice + ss * kvv
    kyy = ss * kuu + twice + cc * kvv
    kxy = cs * (kuu - kvv) + (cc - ss) * kuv
    kxt = c * kut - s * kvt
    kyt = s * kut + c * kvt
    # forces and moment at the neck for a rotation of each body about its centre
    ax, ay, at = kxt - ya * kxx + xa * kxy, kyt - ya * kxy + xa * kyy, ktt - ya * kxt + xa * kyt
    bx, by, bt = kxt - yb * kxx + xb * kxy, kyt - yb * kxy + xb * kyy, ktt - yb * kxt + xb * kyt
    aa, bb = at - ya * ax + xa * ay, bt - yb * bx + xb * by
    ab = bt - ya * bx + xa * by

    def block(parts: Sequence[Array]) -> Array:
        flat = _stacked(xp, parts, 0)
        return xp.reshape(flat, (3, 3, *flat.shape[1:]))

    return (
        block((kxx, kxy, ax, kxy, kyy, ay, ax, ay, aa)),
        block((kxx, kxy, bx, kxy, kyy, by, bx, by, bb)),
        block((-kxx, -kxy, -bx, -kxy, -kyy, -by, -ax, -ay, -ab)),
    )


def _blocks(
    xp: Any, count: int, joined: Sequence[tuple[int, int]], parts: tuple[Array, Array, Array]
) -> dict[tuple[int, int], Array]:
    """Add what the hinges do to the blocks of the stage, on and below its diagonal."""
    nothing = xp.zeros_like(parts[0][:, :, 0, ...])
    out: dict[tuple[int, int], Array] = {(i, i): nothing for i in range(count)}
    for h, (a, b) in enumerate(joined):
        found = []
        if a >= 0:
            found.append(((a, a), parts[0][:, :, h, ...]))
        if b >= 0:
            found.append(((b, b), parts[1][:, :, h, ...]))
        if a >= 0 and b >= 0:
            both = parts[2][:, :, h, ...]
            found.append(((a, b), both) if a > b else ((b, a), xp.permute_dims(both, (1, 0, 2))))
        for at, part in found:
            out[at] = out[at] + part if at in out else part
    return out


def _stress(
    xp: Any,
    rows: Array,
    k: Sequence[Sequence[Array]],
    turn: tuple[Array, Array],
    arms: Sequence[tuple[Array, Array]],
) -> Array:
    """Stress at each place for the coordinates of the two bodies of its hinge, (r, 2, 3, S)."""
    n, q, m = (rows[:, i, ...] for i in range(3))
    u, v, t = (n * k[0][j] + q * k[1][j] + m * k[2][j] for j in range(3))
    c, s = turn
    x, y = c * u - s * v, s * u + c * v
    (xa, ya), (xb, yb) = arms
    return _rows(xp, [(-x, -y, ya * x - xa * y - t), (x, y, xb * y - yb * x + t)])


# Samples that are computed side by side: few enough for a processor's cache, enough that the time
# is spent in arithmetic.
_AT_ONCE = 512


def lumped_characteristics(
    arrays: StageArrays, wanted: Collection[tuple[str, str]] | None = None
) -> dict[tuple[str, str], Array]:
    """Return the characteristics of the lumped models of any number of stages.

    Some hundreds at a time, so that memory stays small; a value does not depend on which.

    Parameters
    ----------
    arrays : StageArrays
        What the stages are made of.
    wanted : Collection of tuple, optional
        Figures as quantity and axis; all that are known where not given.

    Returns
    -------
    dict
        By quantity and axis the values, shape (S,), as `flexstage.system.batch_characteristics`
        gives them.

    Raises
    ------
    ModelError
        A figure is not known of this topology.

    Notes
    -----
    Validity: as `flexstage.lumped.lumped_system`.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import stage_arrays
    >>> arrays = stage_arrays([design("vgtu-piezo")])
    >>> stiffer = arrays.hinge_stiffness * np.linspace(1.0, 1.2, 3)[:, None, None, None]
    >>> arrays = replace(arrays, hinge_stiffness=stiffer)
    >>> key = ("natural_frequency_hz", "x")
    >>> lumped_characteristics(arrays, [key])[key].round(1)
    array([326. , 341.9, 357.1])
    """
    xp, count = namespace_of(arrays), arrays.samples
    parts = [
        batch_characteristics(assemble_batch(arrays.part(i, i + _AT_ONCE)), wanted)
        for i in range(0, count, _AT_ONCE)
    ]
    return {key: xp.concat([part[key] for part in parts]) for key in parts[0]}


def system_tangents(tangents: StageTangents) -> tuple[SystemBatch, SystemBatch]:
    r"""Return the system of a stage, and its derivatives by the parameters.

    By the product rule of the assembly: with the deformation :math:`e = Bq` of a hinge,

    .. math::

        \dot K = \sum \dot B^T k B + B^T \dot k B + B^T k \dot B

    Parameters
    ----------
    tangents : StageTangents
        Derivatives of what it is made of.

    Returns
    -------
    tuple of SystemBatch
        The system, one sample; its derivatives, with a leading axis of the parameters.

    Raises
    ------
    ModelError
        Every body is fixed.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import hinge_tangents
    >>> system, slopes = system_tangents(hinge_tangents(design("parallelogram")))
    >>> system.stiffness.shape[0], slopes.stiffness.shape[0]
    (1, 19)
    """
    a, d, count = tangents.arrays, tangents.slopes, len(tangents.names)
    batch, stage = assemble_batch(a), a.stage
    every = {body.name: i for i, body in enumerate(stage.bodies)}
    moving = [i for i, body in enumerate(stage.bodies) if not body.fixed]

    def arms(at: Array, at_slope: Array, names: Sequence[str]) -> tuple[Array, Array]:
        bodies = [every[name] for name in names]
        return at - a.centre[:, bodies], at_slope - d.centre[:, bodies]

    stiffness = np.zeros((count, *batch.stiffness.shape[1:]))
    stress = np.zeros((count, *batch.stress.shape[1:]))
    if stage.hinges:
        sides = [
            arms(a.hinge_at, d.hinge_at, [h.bodies[side] for h in stage.hinges]) for side in (0, 1)
        ]
        b, b_slope = _deformations(a.hinge_direction, d.hinge_direction, sides)
        k, k_slope = a.hinge_stiffness, d.hinge_stiffness
        force, force_slope = k @ b, k_slope @ b + k @ b_slope
        part = _turned(b_slope) @ force + _turned(b) @ force_slope
        stiffness += _scattered(batch, stage, np.broadcast_to(part, (count, *part.shape[1:])))
        owner = list(a.stress_owner)
        if owner:
            rows, rows_slope = a.stress_rows[:, :, None, :], d.stress_rows[:, :, None, :]
            found = rows_slope @ force[:, owner] + rows @ force_slope[:, owner]
            stress += found.reshape(*found.shape[:2], 2, 3)
    drive = np.zeros((count, *batch.drive.shape[1:]))
    if stage.drives:
        for side, name in enumerate(("pushes", "reacts")):
            pair = arms(a.drive_at, d.drive_at, [getattr(x, name) for x in stage.drives])
            row = _row_slope(a.drive_direction, d.drive_direction, *pair)
            drive[:, :, side] += (1.0, -1.0)[side] * row
    probe = np.zeros((count, *batch.probe.shape[1:]))
    along = np.zeros((count, *batch.weight_direction.shape[1:]))
    for i, p in enumerate(stage.probes):
        if p.unit == "rad":
            continue
        phi, turn = a.probe_direction[:, i], d.probe_direction[:, i]
        along[:, i] = np.stack((-np.sin(phi) * turn, np.cos(phi) * turn), axis=-1)
        for side, name in enumerate((p.body, p.relative_to)):
            if name is not None:
                pair = arms(a.probe_at[:, [i]], d.probe_at[:, [i]], [name])
                row = _row_slope(phi[:, None], turn[:, None], *pair)
                probe[:, i, side] = (1.0, -1.0)[side] * row[:, 0]
    mass = np.stack((d.mass, d.mass, d.inertia), axis=-1)[:, moving]
    return batch, replace(
        batch,
        mass=mass.reshape(mass.shape[0], -1),
        stiffness=stiffness,
        drive=drive,
        probe=probe,
        stress=stress,
        weight=d.mass[:, moving] * STANDARD_GRAVITY,
        weight_direction=along,
        body_mass=d.mass,
        **{name: getattr(d, name) for name in AS_DESCRIBED},
    )


def _turned(x: Array) -> Array:
    return np.swapaxes(x, -1, -2)


def _deformations(
    angle: Array, turn: Array, sides: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Deformation of each hinge for the coordinates of its bodies, and its derivatives.

    Shapes (1, h, 3, 6) and (p, h, 3, 6).
    """
    c, s = np.cos(angle), np.sin(angle)
    frame, frame_slope = np.zeros((*angle.shape, 3, 3)), np.zeros((*angle.shape, 3, 3))
    frame[..., 0, 0], frame[..., 0, 1], frame[..., 1, 0], frame[..., 1, 1] = c, s, -s, c
    frame[..., 2, 2] = 1.0
    frame_slope[..., :2, :2] = np.stack(
        (np.stack((-s, c), axis=-1), np.stack((-c, -s), axis=-1)), axis=-2
    )
    frame_slope = frame_slope * turn[..., None, None]
    value, slope = [], []
    for sign, (arm, arm_slope) in zip((-1.0, 1.0), sides, strict=True):
        point = np.zeros((*arm.shape[:2], 3, 3))
        point[..., 0, 0] = point[..., 1, 1] = point[..., 2, 2] = 1.0
        point[..., 0, 2], point[..., 1, 2] = -arm[..., 1], arm[..., 0]
        point_slope = np.zeros((*arm_slope.shape[:2], 3, 3))
        point_slope[..., 0, 2], point_slope[..., 1, 2] = -arm_slope[..., 1], arm_slope[..., 0]
        value.append(sign * (frame @ point))
        slope.append(sign * (frame_slope @ point + frame @ point_slope))
    return np.concatenate(value, axis=-1), np.concatenate(slope, axis=-1)


def _scattered(batch: SystemBatch, stage: Stage, part: Array) -> Array:
    """Add 6 x 6 parts of hinges, (p, h, 6, 6), to the blocks of a batch."""
    free = [body.name for body in stage.bodies if not body.fixed]
    number = {name: i for i, name in enumerate(free)}
    place = {at: i for i, at in enumerate(batch.blocks)}
    out = np.zeros((part.shape[0], len(place), 3, 3))
    for h, hinge in enumerate(stage.hinges):
        at = [number.get(name, -1) for name in hinge.bodies]
        for i in range(2):
            for j in range(2):
                # below the diagonal; both of a body with itself stand on it
                if min(at[i], at[j]) >= 0 and (at[i] > at[j] or i == j):
                    block = part[:, h, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
                    out[:, place[at[i], at[j]]] += block
    return out


def _row_slope(angle: Array, turn: Array, arm: Array, arm_slope: Array) -> Array:
    """Derivatives of the row (c, s, s X - c Y) for the coordinates of a body."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = arm[..., 0], arm[..., 1]
    moment = turn * (c * x + s * y) + s * arm_slope[..., 0] - c * arm_slope[..., 1]
    return np.stack(np.broadcast_arrays(-s * turn, c * turn, moment), axis=-1)
