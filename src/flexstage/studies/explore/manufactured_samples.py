"""The stages of a lot as arrays: what deviations do to masses, springs, stress and places.

The spring of a notch as its neck and its radius change is a polynomial through exact values.
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
from flexstage.hinges import Profile, compliance, stress_rows
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.hinges.registry import with_neck_radius, with_neck_thickness
from flexstage.lumped.assemble import HingeSpring, hinge_springs
from flexstage.lumped.batch import assemble_batch
from flexstage.lumped.stage_arrays import StageArrays, stage_arrays
from flexstage.stage import PiezoStack, Stage, mass_properties
from flexstage.studies.explore.figures import Figure
from flexstage.system.batch_analysis import batch_characteristics
from flexstage.virtual.imperfections import Scatter

#: What the polynomial may be off by, as a share of the largest value of its kind.
TOLERANCE = 1e-9
#: Where the neck of a notch ends that a process may leave, as a share of what was drawn.
THINNEST = 0.2

_FEWEST = (6, 4)  # nodes in the directions of neck and radius
# rows and columns of a stiffness matrix that are not its mirror image
_UPPER = np.triu_indices(3)
_HALF = 4  # area, first moments and polar moment of half a notch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NotchTable:
    """Chebyshev polynomials of a notch over its neck and its radius.

    Values are those of a width of 1 m and a modulus of 1 Pa.
    """

    profile: Profile
    """The notch as it was drawn."""
    reach: tuple[tuple[float, float], tuple[float, float]]
    """Least and greatest deviation of the neck, and of the radius, that it holds [m]."""
    coefficients: Array
    """Of stiffness, stress rows and half the notch's area, shape (necks, radii, values)."""
    sizes: Array
    """Size of each value, by which it was divided, shape (values,)."""
    rows: int
    """Number of stress rows."""
    error: float
    """Largest difference from the exact function that was found between the nodes [1]."""

    def at(self, neck: Array, radius: Array) -> tuple[Array, Array, Array]:
        """Return stiffness, stress rows and half area of deviations within `reach`.

        Shapes (samples, 3, 3), (samples, rows, 3) and (samples, 4).
        """
        values = self._values(neck, radius) * self.sizes
        k = np.empty((len(values), 3, 3))
        k[:, _UPPER[0], _UPPER[1]] = values[:, :6]
        k[:, _UPPER[1], _UPPER[0]] = values[:, :6]
        return k, values[:, 6:-_HALF].reshape(-1, self.rows, 3), values[:, -_HALF:]

    def _values(self, neck: Array, radius: Array) -> Array:
        x, y = (_scaled(v, ends) for v, ends in zip((neck, radius), self.reach, strict=True))
        n, m, k = self.coefficients.shape
        powers = (
            chebyshev.chebvander(x, n - 1)[:, :, None] * chebyshev.chebvander(y, m - 1)[:, None, :]
        )
        return powers.reshape(-1, n * m) @ self.coefficients.reshape(n * m, k)


def notch_table(
    profile: Profile,
    poisson: float,
    plane: PlaneState,
    root_widths: tuple[float, float] | None,
    *,
    neck: float,
    radius: float,
    method: str = "wedge",
) -> NotchTable:
    """Build the table of a notch for deviations of its neck and radius up to the given ones [m].

    The number of nodes grows until the exact function is met between them to `TOLERANCE`, or there
    are 16 in each direction; `NotchTable.error` says what is left.

    Raises
    ------
    ModelError
        No notch can be made at the ends of the range.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3)
    >>> table = notch_table(notch, 0.33, "strain", None, neck=30e-6, radius=15e-6)
    >>> found, _, _ = table.at(np.array([12e-6]), np.array([-7e-6]))
    >>> made = with_neck_thickness(with_neck_radius(notch, -7e-6), 0.512e-3)
    >>> exact = compliance(made, 1.0, 0.33, 1.0, plane="strain").stiffness
    >>> bool(abs(found[0, 2, 2] / exact[2, 2] - 1.0) < 1e-8), table.error < 1e-8
    (True, True)
    """
    t = profile.neck_thickness
    reach = ((max(-neck, (THINNEST - 1.0) * t), neck), (-radius, radius))

    def exact(dt: float, dr: float) -> Array:
        made = with_neck_thickness(with_neck_radius(profile, dr), t + dt)
        spring = compliance(
            made, 1.0, poisson, 1.0, method=method, plane=plane, root_widths=root_widths
        )
        rows = stress_rows(made, 1.0, poisson, plane)
        return np.concatenate((spring.stiffness[_UPPER], rows.ravel(), made.half_area_integrals()))

    try:
        return _built(profile, exact, reach)
    except FlexstageError as error:
        raise ModelError(
            f"a scatter that reaches {neck * 1e6:.3g} um at the neck and {radius * 1e6:.3g} um at "
            f"the radius is too much for a {profile.kind} notch with a neck of {t * 1e6:.4g} um: "
            f"give a finer process ({error})"
        ) from error


def _built(
    profile: Profile,
    exact: Callable[[float, float], Array],
    reach: tuple[tuple[float, float], tuple[float, float]],
) -> NotchTable:
    rows = (exact(0.0, 0.0).size - 6 - _HALF) // 3
    # between the nodes of any number, and at the ends
    tries = [(x, y) for x in (-1.0, -0.413, 0.297, 0.871) for y in (-0.731, 0.157, 1.0)]
    truth = np.array([exact(*_length((x, y), reach)) for x, y in tries])
    sizes = np.abs(truth).max(axis=0)
    # the six of a stiffness are compared with what belongs to their row and column
    own = np.sqrt(sizes[[0, 3, 5]])
    sizes[:6] = own[_UPPER[0]] * own[_UPPER[1]]
    sizes[sizes == 0.0] = 1.0
    still = tuple(low == high for low, high in reach)
    counts = [1 if fixed else few for fixed, few in zip(still, _FEWEST, strict=True)]
    points = np.array([_length(point, reach) for point in tries])
    while True:
        c = _fitted(exact, reach, counts) / sizes
        table = NotchTable(
            profile=profile, reach=reach, coefficients=c, sizes=sizes, rows=rows, error=0.0
        )
        found = table._values(points[:, 0], points[:, 1])
        error = float(np.abs(found - truth / sizes).max())
        if error <= TOLERANCE or max(counts) >= 16:
            return replace(table, error=error)
        # more in the direction whose last terms have not died out
        last = (float(np.abs(c[-1]).max()), float(np.abs(c[:, -1]).max()))
        counts = [
            count if fixed or (tail < max(last) and tail < 0.1 * TOLERANCE) else count + 2
            for fixed, count, tail in zip(still, counts, last, strict=True)
        ]


def _fitted(
    exact: Callable[[float, float], Array],
    reach: tuple[tuple[float, float], tuple[float, float]],
    counts: list[int],
) -> Array:
    """Coefficients of the polynomial through the exact values at Chebyshev's nodes."""
    nodes = [np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in counts]
    values = np.array([[exact(*_length((x, y), reach)) for y in nodes[1]] for x in nodes[0]])
    for axis, points in enumerate(nodes):
        inverse = np.linalg.inv(chebyshev.chebvander(points, len(points) - 1))
        values = np.moveaxis(np.tensordot(inverse, values, axes=(1, axis)), 0, axis)
    return values


def _length(
    point: tuple[float, float], reach: tuple[tuple[float, float], tuple[float, float]]
) -> tuple[float, float]:
    """Return the deviations [m] of a point of the square from -1 to 1."""
    (a, b), (c, d) = reach
    return 0.5 * (a + b + point[0] * (b - a)), 0.5 * (c + d + point[1] * (d - c))


def _scaled(values: Array, ends: tuple[float, float]) -> Array:
    low, high = ends
    if low == high:
        return np.zeros_like(values)
    return (2.0 * values - low - high) / (high - low)


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
def process_of(stage: Stage, scatter: Scatter) -> Process:
    """Prepare a stage and its process, for deviations of up to `REACH` standard deviations.

    Raises
    ------
    ModelError
        The process is so coarse that a notch cannot be made.
    """
    necks = REACH * math.hypot(scatter.neck_common, scatter.neck_own)
    found: dict[object, int] = {}
    tables: list[NotchTable] = []
    table_of = []
    for spring in hinge_springs(stage):
        profile, roots = spring.hinge.profile, spring.root_widths
        rounded = None if roots is None else tuple(round(w, 12) for w in roots)  # [m]
        key = (profile, spring.plane, rounded)
        if key not in found:
            found[key] = len(tables)
            tables.append(_table(stage, spring, necks, REACH * scatter.radius))
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
    by kind, as `flexstage.studies.explore.deviations.draw` gives them; a kind not given is exact.

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
