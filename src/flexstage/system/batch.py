r"""Many stages of one topology as linear mechanical systems, all at once.

A `SystemBatch` is to thousands of stages as `MechanicalSystem` is to one: the same matrices, with a
leading axis of samples, and their common data once. Arrays may be NumPy's or those of any library
that follows the Python array API standard; numbers stay in that library.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.short_repr import short_repr
from flexstage.stage import Stage
from flexstage.system.forward_mode import array_namespace
from flexstage.system.mechanical import MechanicalSystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageNumbers:
    """Data of many stages that their systems share.

    With a leading axis of samples S; an array that is the same for all may have one of 1.
    """

    stage: Stage
    """The nominal stage: names, and decisions for all samples."""
    drive_at: Array
    """Pushed point of each drive [m], shape (S, d, 2)."""
    probe_at: Array
    """Point of each probe [m], shape (S, p, 2)."""
    drive_stiffness: Array
    """Stiffness of each drive [N/m]; infinite if rigid, 0 for a pure force; shape (S, d)."""
    stroke: Array
    """Largest free displacement of each drive [m]; not a number for a force; shape (S, d)."""
    smallest_displacement: Array
    """Smallest commanded change of each drive [m]; not a number where unknown; shape (S, d)."""
    largest_force: Array
    """Largest force of each drive that is a pure force [N]; else not a number; shape (S, d)."""
    strength: Array
    """Yield strength, and the largest pulsating stress that fatigue allows [Pa]; not a number where
    unknown; shape (S, 2).
    """
    size: Array
    """Width, height and thickness of the plate [m], shape (S, 3)."""

    __repr__ = short_repr

    @property
    def samples(self) -> int:
        """Number of samples S."""
        return max(x.shape[0] for x in arrays_of(self).values())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SystemBatch(StageNumbers):
    r"""Stages of one topology as systems of rigid bodies, with a leading axis of samples.

    Free bodies have three coordinates each, in the order of the stage: x, y, rotation. Bodies are
    numbered among the free ones, and -1 is the ground.
    """

    nominal: MechanicalSystem
    """The system of the nominal stage."""
    mass: Array
    """Diagonal of the mass matrix [kg, kg m^2], shape (S, n)."""
    stiffness: Array
    """Blocks of the stiffness matrix on and below its diagonal, shape (S, c, 3, 3)."""
    blocks: tuple[tuple[int, int], ...]
    """Row and column of each block, as bodies, the former not smaller; c of them."""
    drive: Array
    """Elongation of each drive for the coordinates of the two bodies that it joins, shape (S, d, 2,
    3).
    """
    drive_bodies: tuple[tuple[int, int], ...]
    """These bodies."""
    probe: Array
    """Reading of each probe for the coordinates of the body that it reads, and of the reference
    body, shape (S, p, 2, 3).
    """
    probe_bodies: tuple[tuple[int, int], ...]
    """These bodies."""
    stress: Array
    """Signed equivalent stress at each place for the coordinates of the two bodies of its hinge
    [Pa/m, Pa/rad], shape (S, r, 2, 3).
    """
    stress_bodies: tuple[tuple[int, int], ...]
    """These bodies."""
    weight: Array
    """Mass of each free body in standard gravity [N], shape (S, n/3)."""
    weight_direction: Array
    """Direction of each probe in the plane, zero for a rotation, shape (S, p, 2)."""
    body_mass: Array
    """Mass of every body, fixed ones too [kg], shape (S, b)."""


def arrays_of(batch: Any) -> dict[str, Array]:
    """Return the arrays of a batch by field, in the order of its fields."""
    arrays = {f.name: getattr(batch, f.name) for f in fields(batch)}
    return {name: value for name, value in arrays.items() if hasattr(value, "ndim")}


def namespace_of(batch: Any) -> Any:
    """Return the array namespace of a batch."""
    return array_namespace(*arrays_of(batch).values())


def samples_last(xp: Any, x: Array) -> Array:
    """Return an array with its leading axis last, samples side by side in memory."""
    turned = xp.permute_dims(x, (*range(1, x.ndim), 0))
    # one axis for a moment: a library then has to lay them out anew
    return xp.reshape(xp.reshape(turned, (-1,)), turned.shape)


def samples_first(xp: Any, x: Array) -> Array:
    """Return an array with its last axis leading, without a copy where the library can."""
    return xp.permute_dims(x, (x.ndim - 1, *range(x.ndim - 1)))


def full_stiffness(batch: SystemBatch) -> Array:
    """Return the stiffness matrix of every sample of a NumPy batch, shape (S, n, n)."""
    order = batch.nominal.order
    K = np.zeros((batch.samples, order, order))
    for (i, j), block in zip(batch.blocks, batch.stiffness.swapaxes(0, 1), strict=True):
        K[:, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = block
        K[:, 3 * j : 3 * j + 3, 3 * i : 3 * i + 3] = block.swapaxes(1, 2)
    return K


def full_vectors(batch: SystemBatch, parts: Array, bodies: Sequence[tuple[int, int]]) -> Array:
    """Return vectors of two bodies, shape (S, v, 2, 3), for all coordinates, shape (S, v, n)."""
    out = np.zeros((batch.samples, len(bodies), batch.nominal.order))
    for i, pair in enumerate(bodies):
        for side, body in enumerate(pair):
            if body >= 0:
                out[:, i, 3 * body : 3 * body + 3] += parts[:, i, side]
    return out


def sample_systems(batch: SystemBatch) -> Iterator[MechanicalSystem]:
    """Yield every sample of a NumPy batch as a system, for its vibration by drives and weight.

    Validity: centres of bodies, ends of drives with a mass, thermal loads and stress are nominal.
    """
    nominal, n = batch.nominal, batch.samples
    stiffness = full_stiffness(batch)
    drives = full_vectors(batch, batch.drive, batch.drive_bodies)
    probes = full_vectors(batch, batch.probe, batch.probe_bodies)
    mass = np.broadcast_to(batch.mass, (n, nominal.order))
    weight = np.broadcast_to(batch.weight, (n, nominal.order // 3))
    strokes = np.broadcast_to(batch.stroke, (n, len(nominal.drives)))
    for i in range(n):
        loads = {load.name: load for load in nominal.loads}
        for k, name in enumerate(("gravity x", "gravity y")):
            vector = np.zeros(nominal.order)
            vector[k::3] = weight[i]
            loads[name] = replace(loads[name], vector=vector)
        yield replace(
            nominal,
            M=np.diag(mass[i]),
            K=stiffness[i],
            drives=tuple(
                replace(port, vector=vector, stroke=None if port.stroke is None else float(stroke))
                for port, vector, stroke in zip(nominal.drives, drives[i], strokes[i], strict=True)
            ),
            probes=tuple(
                replace(port, vector=vector)
                for port, vector in zip(nominal.probes, probes[i], strict=True)
            ),
            loads=tuple(loads.values()),
        )
