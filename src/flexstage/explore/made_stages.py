"""The stages of a lot as arrays: what deviations do to masses, springs, stress, drives and places."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.explore.notch_table import NotchTable, notch_table
from flexstage.lumped.assemble import HingeSpring, hinge_springs
from flexstage.stage import PiezoStack, Stage, mass_properties
from flexstage.virtual.imperfections import Scatter

#: How many standard deviations the tables of the notches reach; one sample in 4e11 is further off.
REACH = 7.0

_DIGITS = 12  # of a root's width [m] that tell notches apart


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Process:
    """A stage, how its process scatters, and what follows from both for all of its samples."""

    stage: Stage
    """The stage as it was drawn."""
    scatter: Scatter
    """How far the process misses it."""
    tables: tuple[NotchTable, ...]
    """The springs of its different notches."""
    table_of: tuple[int, ...]
    """Which table each hinge has."""
    plate: Array
    """Integrals of 1, x, y and x^2 + y^2 over each body without its half notches, about `origin`,
    shape (bodies, 4).
    """
    halves: Array
    """What takes the integrals of all half notches to those of the bodies, shape (hinges, 4,
    bodies, 4).
    """
    mounted: Array
    """Mass, first moments and polar moment of what is mounted on each body, shape (bodies, 4)."""
    origin: Array
    """Point of each body that its integrals are about [m], shape (bodies, 2)."""

    @property
    def error(self) -> float:
        """Largest error of the tables [1]."""
        return max((table.error for table in self.tables), default=0.0)


def process_of(stage: Stage, scatter: Scatter, *, reach: float = REACH) -> Process:
    """Prepare a stage and its process: `reach` is how many standard deviations are covered.

    Raises
    ------
    ModelError
        The process is so coarse that a notch cannot be made.
    """
    necks = reach * math.hypot(scatter.neck_common, scatter.neck_own)
    found: dict[object, int] = {}
    tables: list[NotchTable] = []
    table_of = []
    for spring in hinge_springs(stage):
        profile, roots = spring.hinge.profile, spring.root_widths
        rounded = None if roots is None else tuple(round(w, _DIGITS) for w in roots)
        key = (profile, spring.plane, rounded)
        if key not in found:
            found[key] = len(tables)
            tables.append(_table(stage, spring, necks, reach * scatter.radius))
        table_of.append(found[key])
    bare = replace(
        stage, hinges=(), bodies=tuple(replace(body, extra_masses=()) for body in stage.bodies)
    )
    surface = stage.thickness * stage.material.density
    found_plate = mass_properties(bare).values()
    origin = np.array([p.centre for p in found_plate])
    plate = np.array([(p.mass / surface, 0.0, 0.0, p.inertia / surface) for p in found_plate])
    return Process(
        stage=stage,
        scatter=scatter,
        tables=tuple(tables),
        table_of=tuple(table_of),
        plate=plate,
        halves=_halves(stage, origin),
        mounted=_mounted(stage, origin),
        origin=origin,
    )


def _table(stage: Stage, spring: HingeSpring, neck: float, radius: float) -> NotchTable:
    return notch_table(
        spring.hinge.profile,
        stage.material.poissons_ratio,
        spring.plane,
        spring.root_widths,
        neck=neck,
        radius=radius,
        method=spring.method,
    )


def _halves(stage: Stage, origin: Array) -> Array:
    """Map area, first moments (along, across) and polar moment of half notches to the bodies."""
    index = {body.name: i for i, body in enumerate(stage.bodies)}
    out = np.zeros((len(stage.hinges), 4, len(stage.bodies), 4))
    for h, hinge in enumerate(stage.hinges):
        c, s = math.cos(hinge.direction), math.sin(hinge.direction)
        for name, side in zip(hinge.bodies, (-1.0, 1.0), strict=True):
            body = index[name]
            x, y = np.array(hinge.at) - origin[body]
            # what stands in a row goes into area, x, y and polar moment of the body
            out[h, :, body] += [
                (1.0, x, y, x * x + y * y),
                (0.0, side * c, side * s, 2.0 * side * (x * c + y * s)),
                (0.0, -s, c, 2.0 * (y * c - x * s)),
                (0.0, 0.0, 0.0, 1.0),
            ]
    return out


def _mounted(stage: Stage, origin: Array) -> Array:
    out = np.zeros((len(stage.bodies), 4))
    for i, body in enumerate(stage.bodies):
        for extra in body.extra_masses:
            x, y = np.array(extra.at) - origin[i]
            out[i] += (
                extra.mass,
                extra.mass * x,
                extra.mass * y,
                extra.inertia + extra.mass * (x * x + y * y),
            )
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MadeStages:
    """Stages as they come from the machine; what they share is that of the drawing."""

    mass: Array
    """Mass of every body [kg], shape (samples, bodies)."""
    inertia: Array
    """Moment of inertia about its centre of mass [kg m^2], shape (samples, bodies)."""
    centre: Array
    """Its centre of mass [m], shape (samples, bodies, 2)."""
    at: Array
    """Place of every neck [m], shape (samples, hinges, 2)."""
    stiffness: Array
    """Stiffness of every hinge in its own axes, shape (samples, hinges, 3, 3)."""
    stress: tuple[Array, ...]
    """Stress rows of every hinge, by the forces in its neck, each of shape (samples, rows, 3)."""
    drive_at: Array
    """Point that each drive pushes [m], shape (samples, drives, 2)."""
    probe_at: Array
    """Point that each probe reads [m], shape (samples, probes, 2)."""
    stroke: Array
    """Free displacement of each drive over that of the drawing [1], shape (samples, drives)."""
    faulty: Array
    """Whether a neck is gone, so that there is no such stage, shape (samples,)."""


def made_stages(process: Process, numbers: Mapping[str, Array]) -> MadeStages:
    r"""Return the stages of deviations.

    `numbers` are standard normal, by kind, as `flexstage.explore.deviations.draw` gives them; a
    kind that is left out is exact.

    Notes
    -----
    Young's modulus E and the thickness b of the plate multiply the stiffness of a hinge in its
    plane, b divides the stress; both are exact. Necks and radii go through the tables. A
    temperature makes every length of the plate :math:`\lambda = 1 + \alpha\Delta T` times as long
    at the same mass.

    Validity: roots, outlines and mouths of notches stay where they were drawn, as the plane state
    does. Young's modulus does not follow the temperature, for which the catalogue of materials has
    no figures, nor do drives.
    """
    stage, scatter = process.stage, process.scatter
    samples = len(next(iter(numbers.values())))
    hinges, drives = len(stage.hinges), len(stage.drives)

    def off(kind: str, count: int, each: int = 1) -> Array:
        drawn = numbers.get(kind)
        if drawn is None:
            return np.zeros((samples, count, each))
        return getattr(scatter, kind) * drawn

    def factor(kind: str) -> Array:
        return 1.0 + off(kind, 1)[:, 0, 0]

    neck = (off("neck_common", 1) + off("neck_own", hinges))[..., 0]
    k, rows, half = _notches(process, neck, off("radius", hinges)[..., 0])
    thickness = stage.thickness + off("thickness", 1)[:, 0, 0]
    modulus = stage.material.youngs_modulus * factor("modulus")
    expansion = stage.material.thermal_expansion or 0.0
    longer = 1.0 + expansion * off("temperature", 1)[:, 0, 0]

    integrals = process.plate + np.tensordot(half, process.halves, axes=((1, 2), (0, 1)))
    surface = stage.material.density * factor("density") * thickness
    integrals = surface[:, None, None] * integrals + process.mounted
    mass = integrals[..., 0]
    apart = integrals[..., 1:3] / mass[..., None]
    inertia = integrals[..., 3] - mass * (apart**2).sum(axis=-1)
    centre = process.origin + apart

    # a spring of the same shape: forces as the length, moments as its square, and so on
    powers = np.stack((np.ones(samples), np.ones(samples), longer), axis=-1)
    k *= (modulus * thickness * longer)[:, None, None, None]
    k *= powers[:, None, :, None] * powers[:, None, None, :]
    per_force = 1.0 / (thickness[:, None] * longer[:, None] ** 2 * powers)
    at = np.array([hinge.at for hinge in stage.hinges]).reshape(-1, 2)
    scale = longer[:, None, None]
    drive_at = np.array([drive.at[0] for drive in stage.drives]).reshape(-1, 2)
    left = np.array([(-math.sin(d.direction), math.cos(d.direction)) for d in stage.drives])
    stacks = np.array([isinstance(drive, PiezoStack) for drive in stage.drives])
    return MadeStages(
        mass=mass,
        inertia=inertia * longer[:, None] ** 2,
        centre=centre * scale,
        at=(at + off("position", hinges, 2)) * scale,
        stiffness=k,
        stress=tuple(r * per_force[:, None, :] for r in rows),
        drive_at=(drive_at + off("drive", drives) * left.reshape(-1, 2)) * scale,
        probe_at=np.array([probe.at for probe in stage.probes]).reshape(-1, 2) * scale,
        stroke=1.0 + off("stroke", drives)[..., 0] * stacks,
        faulty=np.isnan(k).any(axis=(1, 2, 3)),
    )


def _notches(process: Process, neck: Array, radius: Array) -> tuple[Array, list[Array], Array]:
    """Stiffness, stress rows and half areas of all hinges, each from the table that it has."""
    samples, hinges = neck.shape
    k = np.empty((samples, hinges, 3, 3))
    rows: list[Array] = [np.empty(0)] * hinges
    half = np.empty((samples, hinges, 4))
    of = np.array(process.table_of)
    for i, table in enumerate(process.tables):
        which = np.flatnonzero(of == i)
        found, stress, area = table.at(neck[:, which].ravel(), radius[:, which].ravel())
        k[:, which] = found.reshape(samples, -1, 3, 3)
        half[:, which] = area.reshape(samples, -1, 4)
        stress = stress.reshape(samples, len(which), table.rows, 3)
        for j, hinge in enumerate(which):
            rows[hinge] = stress[:, j]
    return k, rows, half
