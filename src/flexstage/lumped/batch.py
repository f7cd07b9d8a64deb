r"""The lumped model of many stages of one topology at once: systems, figures and derivatives."""

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.lumped.assemble import lumped_system
from flexstage.lumped.stage_arrays import StageArrays, StageTangents
from flexstage.stage import Stage
from flexstage.system.batch import (
    StageNumbers,
    SystemBatch,
    arrays_of,
    namespace_of,
    samples_first,
    samples_last,
)
from flexstage.system.batch_analysis import batch_characteristics
from flexstage.system.mechanical import STANDARD_GRAVITY, MechanicalSystem


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
        Data of the stages.

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

    def select(x: Array, which: list[int]) -> Array:
        return xp.take(x, xp.asarray(which, dtype=xp.int64), axis=0)

    def arm(at: Array, bodies: list[str]) -> tuple[Array, Array]:
        """Return the vectors from the centres of mass of bodies to points, x and y."""
        from_ = select(centre, [every[name] for name in bodies])
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
            local = [[select(k[:, i, j, ...], owner) for j in range(3)] for i in range(3)]
            stress = _stress(
                xp,
                rows,
                local,
                (select(c, owner), select(s, owner)),
                [(select(x, owner), select(y, owner)) for x, y in arms],
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
        has_reference = xp.asarray(
            [[float(p.relative_to is not None)] for p in probes], dtype=xp.float64
        )
        x, y = arm(at, [p.body for p in probes])
        u, v = arm(at, [p.relative_to or p.body for p in probes])
        reading = (c, s, s * x - c * y + turns)
        against = (-has_reference * c, -has_reference * s, has_reference * (c * v - s * u - turns))
        probe, along = _rows(xp, [reading, against]), _stacked(xp, (c, s), 1)
    mass, inertia = (samples_last(xp, x) for x in (arrays.mass, arrays.inertia))
    moving = [every[name] for name in free]
    reading = select(mass, moving)
    diagonal = _stacked(xp, (reading, reading, select(inertia, moving)), 1)
    return SystemBatch(
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
        weight=samples_first(xp, reading * STANDARD_GRAVITY),
        weight_direction=samples_first(xp, along),
        body_mass=arrays.mass,
        **_as_described(arrays),
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
    """Return the blocks (a, a), (b, b) and (a, b) of each hinge, shape (3, 3, h, S)."""
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
    """Return the blocks of the stage by its hinges, on and below its diagonal."""
    nothing = xp.zeros_like(parts[0][:, :, 0, ...])
    out: dict[tuple[int, int], Array] = {(i, i): nothing for i in range(count)}
    for h, (a, b) in enumerate(joined):
        assembled = []
        if a >= 0:
            assembled.append(((a, a), parts[0][:, :, h, ...]))
        if b >= 0:
            assembled.append(((b, b), parts[1][:, :, h, ...]))
        if a >= 0 and b >= 0:
            both = parts[2][:, :, h, ...]
            assembled.append(
                ((a, b), both) if a > b else ((b, a), xp.permute_dims(both, (1, 0, 2)))
            )
        for at, part in assembled:
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
    arrays: StageArrays, keys: Collection[tuple[str, str]] | None = None
) -> dict[tuple[str, str], Array]:
    """Return the characteristics of the lumped models of any number of stages.

    Some hundreds at a time, so that memory stays small; a value does not depend on which.

    Parameters
    ----------
    arrays : StageArrays
        Data of the stages.
    keys : Collection of tuple, optional
        Figures as quantity and axis; all where not given.

    Returns
    -------
    dict
        By quantity and axis the values, shape (S,), as `flexstage.system.batch_characteristics`
        gives them.

    Raises
    ------
    ModelError
        A figure is not available for this topology.

    Notes
    -----
    Validity: as `flexstage.lumped.lumped_system`.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from flexstage.stage.designs import design
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
        batch_characteristics(assemble_batch(arrays.part(i, i + _AT_ONCE)), keys)
        for i in range(0, count, _AT_ONCE)
    ]
    return {key: xp.concat([part[key] for part in parts]) for key in parts[0]}


def system_tangents(tangents: StageTangents) -> tuple[SystemBatch, SystemBatch]:
    r"""Return the system of a stage, and its derivatives by the parameters.

    The assembly is analytic in its data, so its value at an imaginary step h gives them to rounding
    (W. Squire, G. Trapp, SIAM Review 40 (1998) 110):

    .. math:: \dot K = \operatorname{Im} K(x + \mathrm{i} h \dot x) / h

    Parameters
    ----------
    tangents : StageTangents
        Derivatives of the data of the stage.

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
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import parameter_tangents
    >>> stage = design("parallelogram")
    >>> by_thickness = parameter_tangents(lambda t: replace(stage, thickness=t), stage.thickness)
    >>> system, slopes = system_tangents(by_thickness)
    >>> bool(np.allclose(slopes.mass * stage.thickness, system.mass))
    True
    """
    a, d, count = tangents.arrays, tangents.slopes, len(tangents.names)
    step = 1e-30  # nothing is subtracted: the smaller, the nearer
    changed = {name: x + 1j * step * getattr(d, name) for name, x in arrays_of(a).items()}
    batch, beside = assemble_batch(a), assemble_batch(replace(a, **changed))
    slopes: dict[str, Any] = {name: x.imag / step for name, x in arrays_of(beside).items()}
    slopes["stiffness"] = np.broadcast_to(
        slopes["stiffness"], (count, *slopes["stiffness"].shape[1:])
    )
    return batch, replace(batch, **slopes | _as_described(d))


def _as_described(arrays: StageNumbers) -> dict[str, Any]:
    """Return the data of a system that come straight from its description."""
    return {f.name: getattr(arrays, f.name) for f in fields(StageNumbers)}
