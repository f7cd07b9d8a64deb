"""The stages of a lot as arrays: what deviations do to masses, springs, stress and places."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.explore.figures import Figure
from flexstage.explore.notch_table import NotchTable, notch_table
from flexstage.lumped.assemble import HingeSpring, hinge_springs
from flexstage.lumped.batch import assemble_batch
from flexstage.lumped.stage_arrays import StageArrays, stage_arrays
from flexstage.stage import PiezoStack, Stage, mass_properties
from flexstage.system.batch_analysis import batch_characteristics
from flexstage.virtual.imperfections import Scatter

#: How many standard deviations the tables of the notches reach; one neck in 4e11 is further off.
REACH = 7.0


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

    nominal: StageArrays
    """The stage as it was drawn, as a batch of one."""

    def beyond(self, neck: Array, radius: Array) -> NDArray[np.bool_]:
        """Say which samples have a neck or radius that no table holds, shape (samples,)."""
        out = np.zeros(len(neck), dtype=bool)
        for values, axis in ((neck, 0), (radius, 1)):
            ends = np.array([self.tables[i].reach[axis] for i in self.table_of]).reshape(-1, 2)
            out |= ((values < ends[:, 0]) | (values > ends[:, 1])).any(axis=1)
        return out

    @property
    def error(self) -> float:
        """Largest error of the tables [1]."""
        return max((table.error for table in self.tables), default=0.0)


# a lot, the search for its tolerances and other lots of the same stage begin with the same one
@lru_cache(maxsize=16)
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
        rounded = None if roots is None else tuple(round(w, 12) for w in roots)  # [m]
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
        nominal=stage_arrays([stage]),
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


def made_stages(
    process: Process, numbers: Mapping[str, Array], samples: int
) -> tuple[StageArrays, NDArray[np.bool_]]:
    r"""Return the stages of deviations, and which of them are none, as a neck is gone.

    In place of those that are none stands the one that was drawn. `numbers` are standard normal,
    by kind, as `flexstage.explore.deviations.draw` gives them; a kind that is left out is exact.

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
    hinges, drives = len(stage.hinges), len(stage.drives)

    def off(kind: str, count: int, each: int = 1) -> Array:
        drawn = numbers.get(kind)
        if drawn is None:
            return np.zeros((samples, count, each))
        return getattr(scatter, kind) * drawn

    def factor(kind: str) -> Array:
        return 1.0 + off(kind, 1)[:, 0, 0]

    neck = (off("neck_common", 1) + off("neck_own", hinges))[..., 0]
    radius = off("radius", hinges)[..., 0]
    gone = process.beyond(neck, radius)
    neck[gone], radius[gone] = 0.0, 0.0
    k, rows, half = _notches(process, neck, radius)
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

    # of a body of another size: forces as its length, moments as the square, and so on
    powers = np.stack((np.ones(samples), np.ones(samples), longer), axis=-1)
    k *= (modulus * thickness * longer)[:, None, None, None]
    k *= powers[:, None, :, None] * powers[:, None, None, :]
    rows /= (thickness[:, None] * longer[:, None] ** 2 * powers)[:, None, :]
    scale, nominal = longer[:, None, None], process.nominal
    angle = nominal.drive_direction
    left = np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
    stacks = np.array([isinstance(drive, PiezoStack) for drive in stage.drives], dtype=float)
    size = nominal.size * longer[:, None]
    size[:, 2] = thickness * longer
    made = replace(
        nominal,
        mass=mass,
        inertia=inertia * longer[:, None] ** 2,
        centre=(process.origin + apart) * scale,
        hinge_at=(nominal.hinge_at + off("position", hinges, 2)) * scale,
        hinge_stiffness=k,
        stress_rows=rows,
        drive_at=(nominal.drive_at + off("drive", drives) * left) * scale,
        probe_at=nominal.probe_at * scale,
        stroke=nominal.stroke * (1.0 + off("stroke", drives)[..., 0] * stacks),
        size=size,
    )
    return made, gone


def _notches(process: Process, neck: Array, radius: Array) -> tuple[Array, Array, Array]:
    """Stiffness, stress rows and half areas of all hinges, each from the table that it has."""
    samples, hinges = neck.shape
    owner = np.array(process.nominal.stress_owner, dtype=np.intp)
    k = np.empty((samples, hinges, 3, 3))
    rows = np.empty((samples, owner.size, 3))
    half = np.empty((samples, hinges, 4))
    of = np.array(process.table_of)
    for i, table in enumerate(process.tables):
        which = np.flatnonzero(of == i)
        found, stress, area = table.at(neck[:, which].ravel(), radius[:, which].ravel())
        k[:, which] = found.reshape(samples, -1, 3, 3)
        half[:, which] = area.reshape(samples, -1, 4)
        rows[:, np.flatnonzero(of[owner] == i)] = stress.reshape(samples, -1, 3)
    return k, rows, half


def lot_figures(
    process: Process, numbers: Mapping[str, Array], samples: int, figures: Sequence[Figure]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return figures of the stages of deviations by the lumped model, and which are no stage.

    Shapes (samples, figures) and (samples,). NaN where there is no such stage, or where its axes
    are coupled otherwise than those of the drawing.
    """
    made, gone = made_stages(process, numbers, samples)
    found = batch_characteristics(assemble_batch(made), {figure.key for figure in figures})
    values = np.empty((samples, len(figures)))
    for i, figure in enumerate(figures):
        values[:, i] = found[figure.key]
    values[gone] = np.nan
    return values, gone
