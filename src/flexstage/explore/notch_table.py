"""The spring of a notch as its neck and its radius change: a polynomial through exact values."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from flexstage.arrays import Array
from flexstage.errors import FlexstageError, ModelError
from flexstage.hinges import Profile, compliance, stress_rows
from flexstage.hinges.hinge_spring import PlaneState
from flexstage.hinges.other_notch import with_neck_radius, with_neck_thickness

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
