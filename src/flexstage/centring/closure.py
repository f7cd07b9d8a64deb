"""Circle closure: the faces of a polygon, by an unknown angle or together with the table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration_table import Division, ErrorSource


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closure:
    """Faces of a polygon by circle closure, and the table on which it stood."""

    faces: Division
    """Angle of each face minus its nominal angle."""
    table: Division | None
    """Angle of the table at each position minus its nominal angle; None for a simple closure."""
    offsets: Array
    """Of each column: the unknown angle between the autocollimators, minus its nominal value; or
    the common offset of a setting [rad], shape (columns,).
    """
    noise: float
    """Standard deviation of one reading [rad]."""
    degrees_of_freedom: float
    """Degrees of freedom of the noise; infinite if it was given."""


def simple_closure(
    readings: ArrayLike, *, span: int = 1, noise: float | None = None, gain_uncertainty: float = 0.0
) -> Closure:
    r"""Return the faces of a polygon whose segments are compared with one unknown angle.

    Two autocollimators at a fixed angle see a face each. The sum of all segments is known, so that
    their readings m give both the segments and the unknown angle x of each round r (Estler 1998,
    Journal of Research of NIST 103, 141),

    .. math:: m_{ir} = a_{i+p} - a_i + x_r + \text{noise}, \qquad \sum_i a_i = 0.

    A segment (p = 1) then has the variance s^2 (1 - 1/n) in one round, and any two the covariance
    -s^2/n.

    Parameters
    ----------
    readings : array_like
        Readings m [rad], shape (faces,) or (faces, rounds); NaN where there is none. They grow with
        the angle from face i to face i + p.
    span : int
        Number of faces p from one autocollimator to the other.
    noise : float, optional
        Standard deviation of a reading [rad]; from the residuals if not given, which needs two
        rounds or more.
    gain_uncertainty : float
        Relative standard uncertainty of the gain of the autocollimator [1].

    Returns
    -------
    Closure
        The faces, without orders k for which k p is a multiple of n.

    Validity
    --------
    White noise, flat faces, and an unknown angle that does not change within a round.

    Raises
    ------
    RecordError
        The readings do not match, do not connect all faces, or do not give their noise.
    ModelError
        The span or an uncertainty is impossible.

    Examples
    --------
    >>> segments = np.array([[3.0, 1.0], [-1.0, -3.0], [2.0, 0.0], [0.0, -2.0]]) * 1e-6
    >>> found = simple_closure(segments, noise=1e-7)
    >>> print(f"{found.faces.difference(1, 0).value * 1e6:.3f} urad, offset", found.offsets)
    2.000 urad, offset [ 1.e-06 -1.e-06]
    """
    y = _checked(readings)
    n = y.shape[0]
    if span % n == 0:
        raise ModelError(f"the span must not be a multiple of the {n} faces, got {span}")
    face, column = np.indices(y.shape)
    rows = np.stack(((face + span) % n, face, n + column), axis=-1)
    blind = [k for k in range(1, n // 2 + 1) if k * span % n == 0]
    if n // 2 == len(blind):
        raise RecordError(f"{n} faces with a span of {span} show no order: use another span")
    return _closed(y, rows, (1.0, -1.0, 1.0), 1, blind, noise, gain_uncertainty)


def dual_closure(
    readings: ArrayLike,
    settings: Sequence[int],
    *,
    noise: float | None = None,
    gain_uncertainty: float = 0.0,
) -> Closure:
    r"""Return the faces of a polygon and the positions of the table on which it stands (rosette).

    The polygon is read at all faces i, then turned by s faces on the table (Estler 1998, Journal of
    Research of NIST 103, 141):

    .. math:: y_{is} = a_i - b_{i+s} + c_s + \text{noise}, \qquad \sum_i a_i = \sum_i b_i = 0.

    The common offset c absorbs the drift from one setting to the next. With all n settings a face
    has the variance s^2 (n - 1)/n^2, and any two the covariance -s^2/n^2. An order k has in S
    settings the variance

    .. math:: \frac{S s^2}{n\,(S^2 - |\sum_s w^{ks}|^2)}, \qquad w = e^{2\pi j/n},

    which settings whose differences are all different make flat, such as 0, 1, 4, 6 of 12.

    Parameters
    ----------
    readings : array_like
        Readings y [rad], shape (faces, settings); NaN where there is none. They grow with the angle
        of the face.
    settings : sequence of int
        Number of faces s by which the polygon is turned in each column. Columns of the same setting
        have an offset each.
    noise : float, optional
        Standard deviation of a reading [rad]; from the residuals if not given.
    gain_uncertainty : float
        Relative standard uncertainty of the gain of the autocollimator [1].

    Returns
    -------
    Closure
        Faces and table, without orders k for which exp(2 pi j k s / n) is the same in all settings.

    Validity
    --------
    White noise, flat faces, and a table that repeats its positions within the noise. The numbers of
    faces and positions grow in the same direction.

    Raises
    ------
    RecordError
        The readings do not match, do not connect all faces, or do not give their noise.
    ModelError
        The settings or an uncertainty are impossible.

    Examples
    --------
    >>> a, b = np.array([2.0, -1.0, 3.0, -4.0]), np.array([5.0, -5.0, 1.0, -1.0])
    >>> y = np.stack([a - np.roll(b, -s) + 7.0 * s for s in range(4)], axis=1) * 1e-6
    >>> found = dual_closure(y, range(4), noise=1e-7)
    >>> print((found.faces.error * 1e6).round(6), f"{found.faces.uncertainty[0]:.3e} rad")
    [ 2. -1.  3. -4.] 4.330e-08 rad
    """
    y = _checked(readings)
    n, columns = y.shape
    s = np.asarray(settings)
    if s.shape != (columns,) or not np.array_equal(s, np.rint(s)):
        raise ModelError(
            f"each of {columns} columns needs its setting as a whole number of faces, got "
            f"{', '.join(map(str, settings)) or 'none'}"
        )
    s = s.astype(np.int64)
    face, column = np.indices(y.shape)
    rows = np.stack((face, n + (face + s) % n, 2 * n + column), axis=-1)
    blind = [k for k in range(1, n // 2 + 1) if not np.any(k * (s - s[0]) % n)]
    if n // 2 == len(blind):
        raise RecordError(
            "one setting does not separate the faces from the table: turn the polygon on the table "
            "and read it again"
        )
    return _closed(y, rows, (1.0, -1.0, 1.0), 2, blind, noise, gain_uncertainty)


def _checked(readings: ArrayLike) -> Array:
    y = np.asarray(readings, dtype=np.float64)
    y = y[:, np.newaxis] if y.ndim == 1 else y
    if y.ndim != 2 or y.shape[0] < 3 or np.isinf(y).any():
        raise RecordError(
            "a closure needs a row for each of three faces or more, and finite readings, got shape "
            f"{y.shape}"
        )
    return y


def _closed(
    y: Array,
    rows: NDArray[np.int64],
    signs: tuple[float, ...],
    circles: int,
    blind: list[int],
    noise: float | None,
    gain_uncertainty: float,
) -> Closure:
    """Return the least-squares solution of readings, each a signed sum of three unknowns.

    `rows` are the numbers of the unknowns, shape (faces, columns, 3): those of the circles, then an
    offset for each column.
    """
    for value in (noise, gain_uncertainty):
        if value is not None and not 0.0 <= value < math.inf:
            raise ModelError("noise and uncertainty must be 0 or more and finite")
    n, columns = y.shape
    size = circles * n + columns
    complete, part = rows.reshape(-1, 3), rows[np.isfinite(y)]
    read = y[np.isfinite(y)]
    inverse, rank = _inverse(part, signs, size, circles, n)
    if len(part) < len(complete) and rank < _inverse(complete, signs, size, circles, n)[1]:
        raise RecordError(
            "the readings that are missing leave faces unconnected: read these faces as well"
        )
    right = np.zeros(size)
    for k, sign in enumerate(signs):
        np.add.at(right, part[:, k], sign * read)
    x = inverse @ right
    freedom = math.inf
    if noise is None:
        freedom = float(read.size - rank)
        if freedom < 1.0:
            raise RecordError(
                "the readings are as many as the unknowns, and do not give their noise: give it by "
                "--noise, or measure one more round or setting"
            )
        residual = read - x[part] @ np.asarray(signs)
        noise = math.sqrt(float(residual @ residual) / freedom)
    orders = tuple(k for k in range(1, n // 2 + 1) if k not in blind)
    visible = _without(n, blind)
    divisions = []
    for name, first in zip(("faces", "table")[:circles], (0, n), strict=False):
        circle = slice(first, first + n)
        error = visible @ x[circle]
        contributions = [
            ErrorSource(
                source="noise of the readings",
                covariance=noise**2 * (visible @ inverse[circle, circle] @ visible),
                degrees_of_freedom=freedom,
                kind="B" if math.isinf(freedom) else "A",
            )
        ]
        if gain_uncertainty:
            moved = gain_uncertainty * error
            contributions.append(
                ErrorSource(source="gain of the autocollimator", covariance=np.outer(moved, moved))
            )
        divisions.append(
            Division(
                name=name,
                error=error,
                contributions=tuple(contributions),
                orders=orders,
                blind=tuple(blind),
            )
        )
    return Closure(
        faces=divisions[0],
        table=divisions[1] if circles == 2 else None,
        offsets=x[circles * n :],
        noise=noise,
        degrees_of_freedom=freedom,
    )


def _inverse(
    rows: NDArray[np.int64], signs: tuple[float, ...], size: int, circles: int, n: int
) -> tuple[Array, int]:
    """Return the inverse of the normal equations, with circles of mean zero, and their rank."""
    normal = np.zeros((size, size))
    for k, sign in enumerate(signs):
        for m, other in enumerate(signs):
            np.add.at(normal, (rows[:, k], rows[:, m]), sign * other)
    centred = np.eye(size)
    for circle in range(circles):
        part = slice(circle * n, (circle + 1) * n)
        centred[part, part] -= 1.0 / n
    values, vectors = np.linalg.eigh(centred @ normal @ centred)
    nonzero = values > 1e-9 * values[-1]
    used = vectors[:, nonzero]
    return (used / values[nonzero]) @ used.T, int(nonzero.sum())


def _without(n: int, blind: list[int]) -> Array:
    """Return the projection that removes the blind orders and the mean."""
    apart = np.subtract.outer(np.arange(n), np.arange(n)) * (2.0 * np.pi / n)
    gone = [(1.0 if 2 * k == n else 2.0) * np.cos(k * apart) for k in blind]
    return np.eye(n) - (1.0 + np.sum(gone, axis=0)) / n
