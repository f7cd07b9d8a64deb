"""Axes that drives move together: Jacobian, conditioning, decoupling, stroke, reachable area."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.stage import Stage
from flexstage.system.mechanical import AxisPort, DrivePort, MechanicalSystem
from flexstage.system.statics import static_displacements

#: Most drives of which all combinations of stroke ends are evaluated.
MOST_DRIVES = 12


def zonotope_volume(generators: Array) -> float:
    r"""Return the volume of the sum of segments from nothing to each generator.

    .. math:: V = \sum_{i_1<\dots<i_n} |\det(g_{i_1},\dots,g_{i_n})|

    P. McMullen's formula, in G. C. Shephard, Canad. J. Math. 26 (1974) 302, eq. (57).

    Parameters
    ----------
    generators : numpy.ndarray
        One a column, shape (n, d); in any units.

    Returns
    -------
    float
        The volume, in the product of the units of the rows; an area for n = 2.

    Notes
    -----
    Validity: exact, in any dimension.

    Examples
    --------
    >>> zonotope_volume(np.array([[3.0, 0.0, 1.0], [0.0, 2.0, 1.0]]))
    11.0
    """
    n, d = generators.shape
    combined = (generators[:, list(k)] for k in combinations(range(d), n))
    return float(sum(abs(np.linalg.det(g)) for g in combined))


def zonogon_outline(generators: Array) -> Array:
    """Return the corners of the sum of segments in a plane, counterclockwise.

    The segments are centred, so that the middle is at the origin. Sides in the order of their
    direction are its outline; parallel ones join.

    Parameters
    ----------
    generators : numpy.ndarray
        One a column, shape (2, d).

    Returns
    -------
    numpy.ndarray
        The corners, shape (k, 2); 2 where all segments are parallel.

    Notes
    -----
    Validity: exact.

    Examples
    --------
    >>> zonogon_outline(np.array([[4.0, 0.0], [0.0, 2.0]])).tolist()
    [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]
    """
    sides: list[Array] = []
    # each as one that goes up, or to the right
    up = [g if (g[1], g[0]) > (0.0, 0.0) else -g for g in generators.T if np.any(g)]
    for g in sorted(up, key=lambda g: math.atan2(g[1], g[0])):
        last = sides[-1] if sides else None
        if last is not None and abs(last[0] * g[1] - last[1] * g[0]) <= 1e-12 * np.hypot(
            *last
        ) * np.hypot(*g):
            sides[-1] = last + g
        else:
            sides.append(g)
    around = np.array([*sides, *(-s for s in sides)]).reshape(-1, 2)
    start = -0.5 * sum(sides, np.zeros(2))
    return start + np.concatenate((np.zeros((1, 2)), np.cumsum(around, axis=0)))[: len(around)]


def box_section(generators: Array, level: float) -> Array:
    r"""Return the corners of a section of the sum of segments, counterclockwise.

    The segments are centred; the section is where the last coordinate has a value. Its corners are
    images of points on edges of the box: all segments but one end at one of their ends.

    Parameters
    ----------
    generators : numpy.ndarray
        One a column, shape (3, d).
    level : float
        The last coordinate, from that of the middle.

    Returns
    -------
    numpy.ndarray
        First and second coordinate of the corners, shape (k, 2); none where nothing is reached.

    Raises
    ------
    ModelError
        There are more than 12 segments.

    Notes
    -----
    Validity: exact; the effort doubles with each segment.
    """
    from scipy.spatial import ConvexHull, QhullError

    d = generators.shape[1]
    if d > MOST_DRIVES:
        raise ModelError(f"a workspace is computed for at most {MOST_DRIVES} drives, got {d}")
    # a tiny part of the size, so that a section through a corner is not lost to rounding
    slack = 1e-12 * float(np.abs(generators[2]).sum())
    corners = []
    for free in range(d):
        rest = np.delete(generators, free, axis=1)
        edge = generators[:, free]
        for signs in product((-0.5, 0.5), repeat=d - 1):
            corner = rest @ np.array(signs)
            gap = level - corner[2]
            if abs(gap) <= 0.5 * abs(edge[2]) + slack:
                share = 0.0 if edge[2] == 0.0 else float(np.clip(gap / edge[2], -0.5, 0.5))
                shares = (share,) if edge[2] != 0.0 else (-0.5, 0.5)
                corners += [corner[:2] + s * edge[:2] for s in shares]
    points = np.array(corners).reshape(-1, 2)
    if len(points) < 3:
        return points
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        # a line, or a point
        far = points - points.mean(axis=0)
        along = far @ np.linalg.svd(far)[2][0]
        return points[[int(np.argmin(along)), int(np.argmax(along))]]


def polygon_area(corners: Array) -> float:
    """Return the area of a polygon, of corners counterclockwise, shape (k, 2)."""
    if len(corners) < 3:
        return 0.0
    x, y = (corners - corners[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReachableArea:
    """The positions, and angles, that all drives reach together.

    It is the sum of the strokes of the drives, each along its column of the Jacobian: a polygon, or
    with a rotation a polyhedron, which is symmetric about its middle.
    """

    axes: tuple[str, ...]
    """The two displacements, and the rotation where there is one."""
    drives: tuple[str, ...]
    """The drives."""
    generators: Array
    """Motion for the stroke of each drive [m, m, rad], shape (2, d) or (3, d)."""
    lowest: Array
    """Position with all drives at the start of their strokes [m, m, rad], shape (2,) or (3,)."""
    middle: Array
    """Position with all drives in the middle of their strokes [m, m, rad], shape (2,) or (3,)."""

    __repr__ = short_repr

    @property
    def projection(self) -> Array:
        """Corners of the positions reached at any angle, counterclockwise [m], shape (k, 2)."""
        return zonogon_outline(self.generators[:2]) + self.middle[:2]

    def section(self, angle: float | None = None) -> Array:
        """Return the corners of the positions that are reached at one angle.

        Parameters
        ----------
        angle : float, optional
            The reading of the rotation [rad], 0 where all drives are at no elongation; that of the
            middle, where the area is largest, if not given. Without a rotation there is none.

        Returns
        -------
        numpy.ndarray
            The corners, counterclockwise [m], shape (k, 2); fewer than 3 where it has no area.

        Notes
        -----
        Validity: exact for linear stages.
        """
        if len(self.axes) < 3:
            return self.projection
        level = 0.0 if angle is None else angle - float(self.middle[2])
        return box_section(self.generators, level) + self.middle[:2]

    @property
    def area(self) -> float:
        """Area reached at the angle of the middle [m^2]."""
        return polygon_area(self.section())

    @property
    def projected_area(self) -> float:
        """Area reached at any angle [m^2]."""
        return zonotope_volume(self.generators[:2])

    @property
    def volume(self) -> float:
        """Area or volume of all that is reached [m^2, or m^2 rad]."""
        return zonotope_volume(self.generators)


#: A singular value below this part of the largest counts as zero.
SINGULAR = 1e-9
#: A drive that moves another axis by more than this part of its own motion couples them.
COUPLED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledAxes:
    r"""Coupling of all drives and axes of a stage.

    .. math:: y = J w

    with the readings y of the axes and the elongations w of the drives. A column of J is the state
    with one drive at unit length and all others held at no elongation, as in a parallel mechanism,
    by their own stiffness or by a sensor of their length. A drive that is a pure force has no
    stiffness: its column is for the force that alone gives unit elongation.
    """

    axes: tuple[AxisPort, ...]
    """The axes, in the order of the rows of J."""
    units: tuple[str, ...]
    """Unit of each axis: m or rad."""
    drives: tuple[str, ...]
    """The drives, in the order of the columns of J."""
    strokes: Array
    """Least and greatest elongation of each drive [m], shape (d, 2)."""
    jacobian: Array
    """J, in m/m or rad/m, shape (a, d)."""
    shapes: Array
    """Coordinates of the system for a unit of each drive, shape (n, d)."""
    forces: Array
    """Force of each drive for a unit of each drive [N/m], shape (d, d)."""
    length: float | None
    """Characteristic length, by which rotations are multiplied to be compared with displacements
    [m]; None where no axis is a rotation.
    """

    __repr__ = short_repr

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(axis.name for axis in self.axes)

    @property
    def scaled(self) -> Array:
        """J with rotations times the characteristic length [m/m], shape (a, d)."""
        scale = [(self.length or 1.0) if unit == "rad" else 1.0 for unit in self.units]
        return np.array(scale, dtype=np.float64)[:, None] * self.jacobian

    @property
    def singular_values(self) -> Array:
        """Singular values of the scaled J, falling [m/m], shape (min(a, d),)."""
        return np.asarray(np.linalg.svd(self.scaled, compute_uv=False), dtype=np.float64)

    @property
    def independent(self) -> bool:
        """True if the drives can move every axis alone: J has the rank of its rows."""
        values = self.singular_values
        return len(values) == len(self.axes) and bool(values[-1] > SINGULAR * values[0])

    @property
    def condition_number(self) -> float:
        r"""Largest over smallest singular value of the scaled J [1]; infinite if dependent.

        J.-P. Merlet, J. Mech. Des. 128 (2006) 199, section 4. Its inverse over the workspace is the
        global conditioning index (C. Gosselin, J. Angeles, J. Mech. Des. 113 (1991) 220); over
        the small motion of flexures J does not change, and that is the inverse at rest.
        """
        values = self.singular_values
        return float(values[0] / values[-1]) if self.independent else math.inf

    @property
    def isotropy(self) -> float:
        r"""Geometric over arithmetic mean of the squared singular values of the scaled J [1].

        J.-O. Kim, P. K. Khosla, IROS (1991) 758: 1 if all directions are equal, 0 if one is lost.
        """
        squares = self.singular_values**2
        if len(squares) < len(self.axes):
            return 0.0
        return float(np.prod(squares) ** (1.0 / squares.size) / squares.mean())

    @property
    def manipulability(self) -> float:
        r"""Product of the singular values, :math:`\sqrt{\det JJ^T}`, of the scaled J [1].

        T. Yoshikawa, Int. J. Robotics Research 4 (1985) 3.
        """
        values = self.singular_values
        return float(np.prod(values)) if len(values) == len(self.axes) else 0.0

    @property
    def coupled(self) -> bool:
        """True if the axes have to be treated together.

        This holds where an axis has several drives, or where a drive moves the axis of another by
        more than half of the motion of its own, rotations times the characteristic length.

        Notes
        -----
        Validity: a convention. Two axes that name each other's drives are called coupled, though
        each drive moves one axis alone; and with a rotation and a displacement the answer depends
        on the length, so that it may differ for a larger platform.
        """
        if any(len(axis.drives) > 1 for axis in self.axes):
            return True
        size = np.abs(self.scaled)
        for i, axis in enumerate(self.axes):
            j = self.drives.index(axis.drives[0])
            others = [k for k, a in enumerate(self.axes) if a.drives != axis.drives]
            if others and size[others, j].max() > COUPLED * size[i, j]:
                return True
        return False

    @property
    def decoupling(self) -> Array:
        r"""W, by which commands of the axes become elongations of the drives, shape (d, a).

        :math:`W = J^{-1}`; with more drives than axes the pseudo-inverse, which takes the least
        :math:`\sum w^2`. In m/m, or m/rad for a rotation.

        Raises
        ------
        ModelError
            The drives cannot move every axis alone.
        """
        if not self.independent:
            raise ModelError(
                f"the drives {', '.join(self.drives)} cannot move the axes "
                f"{', '.join(self.names)} one by one, because their effects are not independent: "
                "remove an axis, or add a drive"
            )
        return np.linalg.pinv(self.jacobian / self._sizes[:, None]) / self._sizes

    @property
    def _sizes(self) -> Array:
        """Size of the motion of each axis, by which the solvers scale metres and radians."""
        return np.abs(self.jacobian).max(axis=1)

    def gains(self, axis: str) -> dict[str, float]:
        """Return the reading of an axis for unit elongation of each drive [m/m, or rad/m]."""
        row = self.jacobian[self.names.index(axis)]
        return dict(zip(self.drives, row.tolist(), strict=True))

    def elongations(self, axis: str) -> Array:
        r"""Return the elongation of each drive for the longest motion along an axis alone.

        The motion t is the largest for which drives within their strokes begin and end it, from
        wherever suits it: :math:`J v = t e` with :math:`|v_j|` at most the stroke of drive j. For
        a square J that is :math:`t = \min_j s_j/|W_{ji}|`; otherwise a linear programme, of which
        several solutions may be equally good.

        Parameters
        ----------
        axis : str
            Its name.

        Returns
        -------
        numpy.ndarray
            Elongations at the end less those at the beginning [m], shape (d,).

        Raises
        ------
        ModelError
            The drives cannot move every axis alone.
        """
        i, span = self.names.index(axis), np.ptp(self.strokes, axis=1)
        direction = self.decoupling[:, i]
        if len(self.drives) > len(self.axes):
            direction = self._redundant(i, span)
        return direction / (np.abs(direction) / span).max()

    def _redundant(self, i: int, span: Array) -> Array:
        from scipy.optimize import linprog

        # unknowns: the part of its stroke that each drive takes, and the motion, of the order of 1
        rows = self.jacobian * span / (self._sizes * span.max())[:, None]
        unit_motion = np.zeros((len(self.axes), 1))
        unit_motion[i] = -1.0
        d = len(self.drives)
        solution = linprog(
            np.r_[np.zeros(d), -1.0],
            A_eq=np.hstack((rows, unit_motion)),
            b_eq=np.zeros(len(self.axes)),
            bounds=[(-1.0, 1.0)] * d + [(0.0, None)],
            method="highs",
        )
        return span * solution.x[:d]

    @property
    def workspace(self) -> ReachableArea | None:
        """Workspace of all drives, in two displacements and at most one rotation; else None."""
        straight = [i for i, unit in enumerate(self.units) if unit == "m"]
        turning = [i for i, unit in enumerate(self.units) if unit == "rad"]
        if len(straight) < 2 or len(turning) > 1:
            return None
        rows = [*straight[:2], *turning]
        reach = self.jacobian[rows] * np.ptp(self.strokes, axis=1)
        return ReachableArea(
            axes=tuple(self.names[i] for i in rows),
            drives=self.drives,
            generators=reach,
            lowest=self.jacobian[rows] @ self.strokes[:, 0],
            middle=self.jacobian[rows] @ self.strokes.mean(axis=1),
        )


def characteristic_length(stage: Stage, drives: Sequence[str], probe: str) -> float:
    r"""Return the mean distance of the pushed points of drives from a probe.

    The mean radius of the platform, as rotations are usually compared with displacements where no
    other length is natural (for a review see L. Stocco, S. E. Salcudean, F. Sassani, ICRA (1998)
    1388). A rotation of the platform moves a point at that distance by this length times the angle.

    Parameters
    ----------
    stage : Stage
        The stage.
    drives : Sequence of str
        Names of the drives.
    probe : str
        Name of the probe of a rotation.

    Returns
    -------
    float
        The length [m].

    Notes
    -----
    Validity: a convention; condition number and isotropy change with it, strokes, decoupling and
    workspace do not.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> print(f"{characteristic_length(design('parallelogram'), ['x'], 'x'):.4f} m")
    0.0262 m
    """
    at = stage.probe(probe).at
    return float(np.mean([math.dist(at, stage.drive(name).at[0]) for name in drives]))


def coupled_axes(
    stage: Stage, system: MechanicalSystem, *, length: float | None = None
) -> CoupledAxes:
    """Return the coupling of the drives and axes of a stage.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.
    length : float, optional
        Characteristic length [m], if there is a rotation; that of `characteristic_length`, from
        the first probe of a rotation to all drives, if not given.

    Returns
    -------
    CoupledAxes
        Jacobian, conditioning, decoupling, workspace.

    Raises
    ------
    ModelError
        There is no axis; a drive has no stroke, moves nothing, or is redundant.

    Notes
    -----
    Validity: small displacements, as the system. The drives keep the elongation that they are
    given: a stack reaches less than its free displacement, by its stiffness against that of the
    stage.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> found = coupled_axes(stage, lumped_system(stage))
    >>> print(found.jacobian.diagonal().round(3), found.coupled)
    [1.777 1.694] False
    >>> print(f"condition {found.condition_number:.3f}, {found.workspace.area * 1e12:.0f} um2")
    condition 1.049, 4347 um2
    """
    if not system.axes:
        raise ModelError(f"stage '{stage.name}' has no axis: add one, with its drives and probe")
    axes = system.axes
    names = tuple(d.name for d in system.drives if any(d.name in a.drives for a in axes))
    stiff = [n for n in names if system.drive(n).stiffness != 0.0]
    shapes, forces, strokes = [], np.zeros((len(names), len(names))), []
    for j, name in enumerate(names):
        # a drive of no axis that holds is held as well
        state = static_displacements(
            system,
            {**dict.fromkeys(stiff, 0.0), name: 1.0},
            others="locked",
        )
        shapes.append(state.q)
        for i, other in enumerate(names):
            forces[i, j] = state.drive_force.get(other, 0.0)
        strokes.append(_range(system.drive(name), forces[j, j]))
    probes = [system.probe(axis.probe) for axis in axes]
    units = tuple(probe.unit for probe in probes)
    if "rad" in units and length is None:
        length = characteristic_length(stage, names, axes[units.index("rad")].probe)
    q = np.array(shapes).T
    return CoupledAxes(
        axes=axes,
        units=units,
        drives=names,
        strokes=np.array(strokes),
        jacobian=np.array([probe.vector @ q for probe in probes]),
        shapes=q,
        forces=forces,
        length=length if "rad" in units else None,
    )


def _range(port: DrivePort, stiffness: float) -> tuple[float, float]:
    """Return the least and greatest elongation of a drive; a force acts both ways."""
    if port.stroke is not None:
        return 0.0, port.stroke
    if port.largest_force is None:
        raise ModelError(f"drive '{port.name}' has neither a stroke nor a largest force")
    reach = port.largest_force / stiffness
    return -reach, reach
