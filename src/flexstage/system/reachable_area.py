"""What all drives of a stage reach together."""

import math
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.short_repr import short_repr

#: Drives whose ends of stroke are gone through, 2 to the power of their number.
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
    chosen = (generators[:, list(k)] for k in combinations(range(d), n))
    return float(sum(abs(np.linalg.det(g)) for g in chosen))


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
        raise ModelError(f"a workspace is found of at most {MOST_DRIVES} drives, got {d}")
    # a tiny part of the size, so that a section through a corner is not lost to rounding
    slack = 1e-12 * float(np.abs(generators[2]).sum())
    found = []
    for free in range(d):
        rest = np.delete(generators, free, axis=1)
        own = generators[:, free]
        for signs in product((-0.5, 0.5), repeat=d - 1):
            corner = rest @ np.array(signs)
            gap = level - corner[2]
            if abs(gap) <= 0.5 * abs(own[2]) + slack:
                share = 0.0 if own[2] == 0.0 else float(np.clip(gap / own[2], -0.5, 0.5))
                shares = (share,) if own[2] != 0.0 else (-0.5, 0.5)
                found += [corner[:2] + s * own[:2] for s in shares]
    points = np.array(found).reshape(-1, 2)
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
    """The positions that all drives reach together, and the angles with them.

    It is the sum of the strokes of the drives, each along its column of the Jacobian: a polygon, or
    with a rotation a polyhedron, whose points opposite of the middle are alike.
    """

    axes: tuple[str, ...]
    """The two displacements, and the rotation where there is one."""
    drives: tuple[str, ...]
    """The drives."""
    generators: Array
    """What the stroke of each drive does [m, m, rad], shape (2, d) or (3, d)."""
    lowest: Array
    """Where all drives are at the lower end of their strokes [m, m, rad], shape (2,) or (3,)."""
    middle: Array
    """Where all drives are in the middle of their strokes [m, m, rad], shape (2,) or (3,)."""

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
