r"""The system of the lumped model of a stage with its derivatives, by the product rule."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexstage.arrays import Array
from flexstage.lumped.batch import AS_DESCRIBED, assemble_batch
from flexstage.lumped.stage_tangents import StageTangents
from flexstage.stage import Stage
from flexstage.system.batch import SystemBatch
from flexstage.system.mechanical import STANDARD_GRAVITY


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
