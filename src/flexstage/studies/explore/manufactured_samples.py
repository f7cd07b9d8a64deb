"""Manufactured samples of a stage as arrays: masses, springs, stress and positions.

The stiffness of a notch as a function of neck and radius is a polynomial through exact values.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.control.dynamic_budget import open_rms
from flexstage.hinges import Profile, compliance, stress_rows
from flexstage.hinges.hinge_spring import ROOT_REACH, PlaneState
from flexstage.hinges.registry import with_neck_radius, with_neck_thickness
from flexstage.lumped import lumped_system
from flexstage.lumped.assemble import HingeSpring, hinge_springs
from flexstage.lumped.batch import assemble_batch
from flexstage.lumped.stage_arrays import StageArrays, stage_arrays
from flexstage.stage import Force, PiezoStack, Stage, mass_properties
from flexstage.studies.explore.figures import NOISE_FIGURES, Figure
from flexstage.system import analyse
from flexstage.system.batch import SystemBatch, full_stiffness, full_vectors, sample_systems
from flexstage.system.batch_analysis import batch_characteristics
from flexstage.system.environment import Environment
from flexstage.system.seated_drives import contact_forces
from flexstage.virtual.imperfections import Scatter

#: Error of the polynomial, as a share of the largest value of its kind.
TOLERANCE = 1e-9
#: Least thickness of a manufactured neck, as a share of the nominal one.
THINNEST = 0.2

_FEWEST = (6, 4)  # nodes in the directions of neck and radius
# rows and columns of the upper half of a stiffness matrix
_UPPER = np.triu_indices(3)
_INTEGRALS = 4  # area, first moments and polar moment of half a notch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NotchTable:
    """Chebyshev polynomials of a notch over its neck and its radius.

    Values are for a width of 1 m and a modulus of 1 Pa.
    """

    profile: Profile
    """The nominal notch."""
    reach: tuple[tuple[float, float], tuple[float, float]]
    """Least and greatest deviation of the neck, and of the radius [m]."""
    coefficients: Array
    """Coefficients of stiffness, stress rows and half area, shape (necks, radii, values)."""
    sizes: Array
    """Scale of each value, shape (values,)."""
    rows: int
    """Number of stress rows."""
    error: float
    """Largest relative difference from the exact function between the nodes [1]."""

    def at(self, neck: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Return stiffness, stress rows and half area for deviations within `reach`.

        Shapes (samples, 3, 3), (samples, rows, 3) and (samples, 4).
        """
        values = self._values(neck, radius) * self.sizes
        k = np.empty((len(values), 3, 3))
        k[:, _UPPER[0], _UPPER[1]] = values[:, :6]
        k[:, _UPPER[1], _UPPER[0]] = values[:, :6]
        return k, values[:, 6:-_INTEGRALS].reshape(-1, self.rows, 3), values[:, -_INTEGRALS:]

    def _values(self, neck: Array, radius: Array) -> Array:
        x, y = (_scaled(v, ends) for v, ends in zip((neck, radius), self.reach, strict=True))
        n, m, k = self.coefficients.shape
        terms = (
            chebyshev.chebvander(x, n - 1)[:, :, None] * chebyshev.chebvander(y, m - 1)[:, None, :]
        )
        return terms.reshape(-1, n * m) @ self.coefficients.reshape(n * m, k)


def notch_table(
    profile: Profile,
    poisson: float,
    plane: PlaneState,
    root_widths: tuple[float, float] | None,
    *,
    neck: float,
    radius: float,
    method: str = "wedge",
    root_reaches: tuple[float, float] = (ROOT_REACH, ROOT_REACH),
) -> NotchTable:
    """Return the table of a notch for deviations of neck and radius up to given ones [m].

    The number of nodes grows until the error between them is below `TOLERANCE`, or is 16 in each
    direction; `NotchTable.error` is the remaining error.

    Raises
    ------
    ModelError
        The notch is impossible at an end of the range.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> table = notch_table(notch, 0.33, "strain", None, neck=30e-6, radius=15e-6)
    >>> stiffness, _, _ = table.at(np.array([12e-6]), np.array([-7e-6]))
    >>> profile = with_neck_thickness(with_neck_radius(notch, -7e-6), 0.512e-3)
    >>> exact = compliance(profile, 1.0, 0.33, 1.0, plane="strain").stiffness
    >>> bool(abs(stiffness[0, 2, 2] / exact[2, 2] - 1.0) < 1e-8), table.error < 1e-8
    (True, True)
    """
    t = profile.neck_thickness
    reach = ((max(-neck, (THINNEST - 1.0) * t), neck), (-radius, radius))

    def exact(dt: float, dr: float) -> Array:
        notch = with_neck_thickness(with_neck_radius(profile, dr), t + dt)
        spring = compliance(
            notch,
            1.0,
            poisson,
            1.0,
            method=method,
            plane=plane,
            root_widths=root_widths,
            root_reaches=root_reaches,
        )
        rows = stress_rows(notch, 1.0, poisson, plane)
        return np.concatenate((spring.stiffness[_UPPER], rows.ravel(), notch.half_area_integrals()))

    try:
        return _table_of(profile, exact, reach)
    except FlexstageError as error:
        raise ModelError(
            f"deviations of {neck * 1e6:.3g} um of the neck and {radius * 1e6:.3g} um of the "
            f"radius are too large for a {profile.kind} notch with a neck of {t * 1e6:.4g} um: "
            f"reduce the scatter ({error})"
        ) from error


def _table_of(
    profile: Profile,
    exact: Callable[[float, float], Array],
    reach: tuple[tuple[float, float], tuple[float, float]],
) -> NotchTable:
    rows = (exact(0.0, 0.0).size - 6 - _INTEGRALS) // 3
    # between the nodes, whatever their number, and at the ends
    checks = [(x, y) for x in (-1.0, -0.413, 0.297, 0.871) for y in (-0.731, 0.157, 1.0)]
    truth = np.array([exact(*_length((x, y), reach)) for x, y in checks])
    sizes = np.abs(truth).max(axis=0)
    # the scale of an element of a stiffness matrix is that of its row and column
    diagonal = np.sqrt(sizes[[0, 3, 5]])
    sizes[:6] = diagonal[_UPPER[0]] * diagonal[_UPPER[1]]
    sizes[sizes == 0.0] = 1.0
    constant = tuple(low == high for low, high in reach)
    counts = [1 if fixed else few for fixed, few in zip(constant, _FEWEST, strict=True)]
    points = np.array([_length(point, reach) for point in checks])
    while True:
        c = _coefficients(exact, reach, counts) / sizes
        table = NotchTable(
            profile=profile, reach=reach, coefficients=c, sizes=sizes, rows=rows, error=0.0
        )
        values = table._values(points[:, 0], points[:, 1])
        error = float(np.abs(values - truth / sizes).max())
        if error <= TOLERANCE or max(counts) >= 16:
            return replace(table, error=error)
        # more nodes in the direction whose last coefficients are not small
        last = (float(np.abs(c[-1]).max()), float(np.abs(c[:, -1]).max()))
        counts = [
            count if fixed or (tail < max(last) and tail < 0.1 * TOLERANCE) else count + 2
            for fixed, count, tail in zip(constant, counts, last, strict=True)
        ]


def _coefficients(
    exact: Callable[[float, float], Array],
    reach: tuple[tuple[float, float], tuple[float, float]],
    counts: list[int],
) -> Array:
    """Return the coefficients of the polynomial through exact values at Chebyshev nodes."""
    nodes = [np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in counts]
    values = np.array([[exact(*_length((x, y), reach)) for y in nodes[1]] for x in nodes[0]])
    for axis, points in enumerate(nodes):
        inverse = np.linalg.inv(chebyshev.chebvander(points, len(points) - 1))
        values = np.moveaxis(np.tensordot(inverse, values, axes=(1, axis)), 0, axis)
    return values


def _length(
    point: tuple[float, float], reach: tuple[tuple[float, float], tuple[float, float]]
) -> tuple[float, float]:
    """Return the deviations [m] at a point of the square from -1 to 1."""
    (a, b), (c, d) = reach
    return 0.5 * (a + b + point[0] * (b - a)), 0.5 * (c + d + point[1] * (d - c))


def _scaled(values: Array, ends: tuple[float, float]) -> Array:
    low, high = ends
    if low == high:
        return np.zeros_like(values)
    return (2.0 * values - low - high) / (high - low)


#: Range of the tables of notches in standard deviations; one neck in 4e11 is outside.
REACH = 7.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Process:
    """A stage with the scatter of its process, and data common to all samples."""

    stage: Stage
    """The nominal stage."""
    scatter: Scatter
    """Scatter of the process."""
    tables: tuple[NotchTable, ...]
    """Tables of its different notches."""
    table_of: tuple[int, ...]
    """Index of the table of each hinge."""
    plate: Array
    """Integrals of 1, x, y and x^2 + y^2 over each body without half notches, about `origin`, shape
    (bodies, 4).
    """
    halves: Array
    """Map from integrals of half notches to those of bodies, shape (hinges, 4, bodies, 4)."""
    mounted: Array
    """Mass, first moments and polar moment of added masses of each body, shape (bodies, 4)."""
    origin: Array
    """Reference point of the integrals of each body [m], shape (bodies, 2)."""

    nominal: StageArrays
    """The nominal stage as a batch of one."""
    environment: Environment | None = None
    """Where the stages stand, for their rms."""

    def outside(self, neck: Array, radius: Array) -> NDArray[np.bool_]:
        """Return which samples have a neck or radius outside the tables, shape (samples,)."""
        out = np.zeros(len(neck), dtype=bool)
        for values, axis in ((neck, 0), (radius, 1)):
            ends = np.array([self.tables[i].reach[axis] for i in self.table_of]).reshape(-1, 2)
            out |= ((values < ends[:, 0]) | (values > ends[:, 1])).any(axis=1)
        return out

    @property
    def error(self) -> float:
        """Largest error of the tables [1]."""
        return max((table.error for table in self.tables), default=0.0)


# a tolerance analysis and the search of tolerances use the same process
@lru_cache(maxsize=16)
def process_of(stage: Stage, scatter: Scatter, environment: Environment | None = None) -> Process:
    """Return a stage with its process, for deviations of up to `REACH` standard deviations.

    Raises
    ------
    ModelError
        The scatter is so large that a notch is impossible, or a body is rigid or of another
        material.
    """
    if stage.other_bodies:
        raise ModelError(
            f"tolerances are those of a plate of one material, and body "
            f"'{stage.other_bodies[0].name}' is rigid or of another: remove its keys 'material' "
            "and 'rigid'"
        )
    necks = REACH * math.hypot(scatter.neck_common, scatter.neck_own)
    indices: dict[object, int] = {}
    tables: list[NotchTable] = []
    table_of = []
    for spring in hinge_springs(stage):
        profile, roots = spring.hinge.profile, spring.root_widths
        rounded = (
            None if roots is None else tuple(round(w, 12) for w in roots + spring.root_reaches)
        )
        key = (profile, spring.plane, rounded)
        if key not in indices:
            indices[key] = len(tables)
            tables.append(_table(stage, spring, necks, REACH * scatter.radius))
        table_of.append(indices[key])
    bare = replace(
        stage, hinges=(), bodies=tuple(replace(body, extra_masses=()) for body in stage.bodies)
    )
    surface = stage.thickness * stage.material.density
    properties = mass_properties(bare).values()
    origin = np.array([p.centre for p in properties])
    plate = np.array([(p.mass / surface, 0.0, 0.0, p.inertia / surface) for p in properties])
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
        environment=environment,
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
        root_reaches=spring.root_reaches,
    )


def _halves(stage: Stage, origin: Array) -> Array:
    """Return the map from integrals of half notches (along, across) to those of the bodies."""
    index = {body.name: i for i, body in enumerate(stage.bodies)}
    out = np.zeros((len(stage.hinges), 4, len(stage.bodies), 4))
    for h, hinge in enumerate(stage.hinges):
        c, s = math.cos(hinge.direction), math.sin(hinge.direction)
        for name, side in zip(hinge.bodies, (-1.0, 1.0), strict=True):
            body = index[name]
            x, y = np.array(hinge.at) - origin[body]
            # each row adds to area, x, y and polar moment of the body
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


def manufactured_samples(
    process: Process, numbers: Mapping[str, Array], samples: int
) -> tuple[StageArrays, NDArray[np.bool_]]:
    r"""Return manufactured stages, and which of them are impossible, as a neck is lost.

    The nominal stage replaces impossible ones. `numbers` are standard normal, by kind, as from
    `flexstage.studies.explore.deviations.draw`; other kinds have no deviation.

    Notes
    -----
    The in-plane stiffness of a hinge is proportional to Young's modulus E and to the plate
    thickness b, and its stress to 1/b. Tables give the effect of necks and radii. A temperature
    changes every length of the plate by the factor :math:`\lambda = 1 + \alpha\Delta T` at constant
    mass.

    Validity: roots, outlines and mouths of notches, and the plane state, are nominal. Young's
    modulus and drives do not depend on the temperature, for lack of data in the catalogue of
    materials.
    """
    stage, scatter = process.stage, process.scatter
    hinges, drives = len(stage.hinges), len(stage.drives)

    def deviation(kind: str, count: int, each: int = 1) -> Array:
        normal = numbers.get(kind)
        if normal is None:
            return np.zeros((samples, count, each))
        return getattr(scatter, kind) * normal

    def factor(kind: str) -> Array:
        return 1.0 + deviation(kind, 1)[:, 0, 0]

    neck = (deviation("neck_common", 1) + deviation("neck_own", hinges))[..., 0]
    radius = deviation("radius", hinges)[..., 0]
    impossible = process.outside(neck, radius)
    neck[impossible], radius[impossible] = 0.0, 0.0
    k, rows, half = _notches(process, neck, radius)
    thickness = stage.thickness + deviation("thickness", 1)[:, 0, 0]
    modulus = stage.material.youngs_modulus * factor("modulus")
    expansion = stage.material.thermal_expansion or 0.0
    stretch = 1.0 + expansion * deviation("temperature", 1)[:, 0, 0]

    integrals = process.plate + np.tensordot(half, process.halves, axes=((1, 2), (0, 1)))
    surface = stage.material.density * factor("density") * thickness
    integrals = surface[:, None, None] * integrals + process.mounted
    mass = integrals[..., 0]
    offset = integrals[..., 1:3] / mass[..., None]
    inertia = integrals[..., 3] - mass * (offset**2).sum(axis=-1)

    # forces scale with the length, moments with its square
    powers = np.stack((np.ones(samples), np.ones(samples), stretch), axis=-1)
    k *= (modulus * thickness * stretch)[:, None, None, None]
    k *= powers[:, None, :, None] * powers[:, None, None, :]
    rows /= (thickness[:, None] * stretch[:, None] ** 2 * powers)[:, None, :]
    scale, nominal = stretch[:, None, None], process.nominal
    angle = nominal.drive_direction
    lateral = np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
    stacks = np.array([isinstance(drive, PiezoStack) for drive in stage.drives], dtype=float)
    size = nominal.size * stretch[:, None]
    size[:, 2] = thickness * stretch
    stages = replace(
        nominal,
        mass=mass,
        inertia=inertia * stretch[:, None] ** 2,
        centre=(process.origin + offset) * scale,
        hinge_at=(nominal.hinge_at + deviation("position", hinges, 2)) * scale,
        hinge_stiffness=k,
        stress_rows=rows,
        drive_at=(nominal.drive_at + deviation("drive", drives) * lateral) * scale,
        probe_at=nominal.probe_at * scale,
        stroke=nominal.stroke * (1.0 + deviation("stroke", drives)[..., 0] * stacks),
        size=size,
    )
    return stages, impossible


def _notches(process: Process, neck: Array, radius: Array) -> tuple[Array, Array, Array]:
    """Return stiffness, stress rows and half areas of all hinges from their tables."""
    samples, hinges = neck.shape
    owner = np.array(process.nominal.stress_owner, dtype=np.intp)
    k = np.empty((samples, hinges, 3, 3))
    rows = np.empty((samples, owner.size, 3))
    half = np.empty((samples, hinges, 4))
    table_of = np.array(process.table_of)
    for i, table in enumerate(process.tables):
        indices = np.flatnonzero(table_of == i)
        stiffness, stress, area = table.at(neck[:, indices].ravel(), radius[:, indices].ravel())
        k[:, indices] = stiffness.reshape(samples, -1, 3, 3)
        half[:, indices] = area.reshape(samples, -1, 4)
        rows[:, np.flatnonzero(table_of[owner] == i)] = stress.reshape(samples, -1, 3)
    return k, rows, half


def sample_figures(
    process: Process, numbers: Mapping[str, Array], samples: int, figures: Sequence[Figure]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return figures of manufactured stages by the lumped model, and which are impossible.

    Shapes (samples, figures) and (samples,). NaN for impossible stages, and for those whose axes
    are coupled differently from the nominal ones.
    """
    stages, impossible = manufactured_samples(process, numbers, samples)
    batch, keys = assemble_batch(stages), {figure.key for figure in figures}
    on_seats = {key for key in keys if key[0] in _ON_SEATS}
    noise = {key for key in keys if key[0] in NOISE_FIGURES}
    frequencies = {("natural_frequency_hz", axis) for _, axis in on_seats}
    columns = batch_characteristics(batch, (keys - on_seats - noise) | frequencies)
    if on_seats:
        columns |= _on_seats(batch, columns)
    if noise and process.environment is not None:
        rows = [
            open_rms(process.stage, system, process.environment, noise)
            for system in sample_systems(batch)
        ]
        columns |= {key: np.array([row[key] for row in rows]) for key in noise}
    values = np.empty((samples, len(figures)))
    for i, figure in enumerate(figures):
        values[:, i] = columns[figure.key]
    values[impossible] = np.nan
    return values, impossible


# quantities of drives on their seats
_ON_SEATS = ("working_displacement", "lift_off_frequency_hz")


@lru_cache(maxsize=32)
def seated_figures(stage: Stage) -> tuple[tuple[str, str], ...]:
    """Return the figures of drives on their seats that samples have, by quantity and axis.

    They are those of an analysis, of axes that one drive moves.
    """
    if not any(drive.seats or drive.preload for drive in stage.drives):
        return ()
    analysis = analyse(stage, lumped_system(stage))
    alone = {state.axis for state in analysis.axes if len(state.drives) == 1}
    rows = ((row.quantity, row.axis) for row in analysis.characteristics)
    return tuple(key for key in rows if key[0] in _ON_SEATS and key[1] in alone)


def _on_seats(
    batch: SystemBatch, columns: Mapping[tuple[str, str], Array]
) -> dict[tuple[str, str], Array]:
    """Return the figures of `seated_figures` of samples, as an analysis computes them of one."""
    stage, samples = batch.stage, batch.samples
    drives = [d for d in stage.drives if not isinstance(d, Force)]
    which = [stage.drives.index(d) for d in drives]
    K = full_stiffness(batch)
    d = full_vectors(batch, batch.drive, batch.drive_bodies)[:, which]
    p = full_vectors(batch, batch.probe, batch.probe_bodies)
    springs = np.array([o.preload.spring_stiffness if o.preload else 0.0 for o in drives])
    sprung = K + np.einsum("i,sij,sik->sjk", springs, d, d)
    bare, shapes = (np.linalg.solve(k, d.swapaxes(1, 2)) for k in (K, sprung))
    alone, together = d @ bare, d @ shapes
    strokes = np.broadcast_to(batch.stroke, (samples, len(stage.drives)))
    out = {}
    for quantity, axis in seated_figures(stage):
        drive = stage.drive_of(axis)
        i, length = drives.index(drive), strokes[:, stage.drives.index(drive)]
        if quantity == "working_displacement":
            # the batch has the elongation of the drive with its preload spring
            free = np.zeros((samples, len(drives)))
            free[:, i] = length * (drive.stroke or 0.0) / (drive.mounted.stroke or math.inf)
            forces = contact_forces(drives, together, free)
            probe = [o.name for o in stage.probes].index(stage.axis(axis).probe)
            reading = np.einsum("sj,sji->si", p[:, probe], shapes)
            out[quantity, axis] = np.einsum("si,si->s", reading, forces)
        elif drive.preload is not None and ("natural_frequency_hz", axis) in columns:
            force = length / alone[:, i, i]
            ratio = 1.0 + (springs[i] * length + drive.preload.force) / force
            out[quantity, axis] = columns["natural_frequency_hz", axis] * np.sqrt(2.0 * ratio)
    return out
