"""Straightness of a motion: by least squares, by end points and by minimum zone; less its noise."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ConvergenceError, ModelError, RecordError
from flexstage.estimate import Component, Estimate
from flexstage.measure.motion.narrowest_zone import narrowest_strip

Measured = Literal["across", "orthogonal"]
Method = Literal["minimum zone", "least squares", "end points"]

_NOISY = (
    "noise widens a distance between extremes: without the variance of the points the value is an "
    "upper bound on average"
)
_NOTICEABLE = (
    "noise contributes to it noticeably: subtract it (less_noise), or take the width of a smooth "
    "curve through the points"
)
#: Share of a deviation above which noise moves its extremes from point to point.
_SHARE_OF_NOISE = 0.1
#: Highest degree of the curve that stands for the form, and the points that each of them needs.
_HIGHEST_DEGREE, _POINTS_FOR_DEGREE = 20, 3
#: Probability at which a curve that is right would be thrown away.
_REJECTED = 1e-4
#: Standard uncertainty of the growth, as a share of it: it changes with the form that is found,
#: which noise changes as well. With a third the interval held the truth in 92 to 98 % of the cases
#: in simulations of forms from 0 to 300 times the noise.
_DOUBT_OF_GROWTH = 1.0 / 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Straightness:
    """Deviation of points in a plane from a straight line."""

    deviation: Estimate
    """Straightness deviation, peak to valley: width between the two lines parallel to the reference
    line that hold all points [m].
    """
    method: Method
    """The reference line: the one of the narrowest zone (ISO 12780-1:2011, MZLI), least squares
    (LSLI), or through the two ends.
    """
    measured: Measured
    """Whether distances are measured in the direction of `across`, or square to the line."""
    slope: float
    """Slope of the reference line, across over along [1]."""
    offset: float
    """Its height where along is 0 [m]."""
    distances: Array
    """Distance of each point from the reference line, positive above it [m], shape (n,)."""
    contacts: tuple[int, ...]
    """Numbers of the points that the width hangs on: of a minimum zone two on one side and the one
    between them on the other; else the highest and the lowest.
    """
    sensitivity: Array
    """Change of the width with `across` of each point [1], shape (n,)."""


def minimum_zone(
    along: ArrayLike,
    across: ArrayLike,
    *,
    covariance: ArrayLike | None = None,
    measured: Measured = "across",
) -> Straightness:
    """Return the width of the narrowest pair of parallel lines that hold all points.

    Measured in the direction of `across` it is the longest chord of the convex hull in that
    direction, which begins at a corner: the width is ``y_i - (1 - w) y_j - w y_k`` of three contact
    points, j and k on one line and i between them on the other (Chebyshev's fit of a line).
    Measured square to the lines it is the least height of the hull over one of its edges
    (Houle and Toussaint, 1988, IEEE Transactions on Pattern Analysis and Machine Intelligence 10).
    Both are exact, in O(n log n).

    Parameters
    ----------
    along : array_like
        Position along the motion [m], shape (n,).
    across : array_like
        Deviation square to it [m], shape (n,).
    covariance : array_like, optional
        Covariance of `across` [m^2]: shape (n, n), or (n,) of variances where the points do not
        hang together, or one variance for all. Positions along count as exact.
    measured : {"across", "orthogonal"}
        Direction of the width: of `across`, or square to the lines.

    Returns
    -------
    Straightness
        Width, line, and contact points; the zone lies half the width on each side of the line.

    Validity
    --------
    The uncertainty is linear: that of the contact points, while they stay the contact points. Noise
    widens a zone, by one to three of its standard deviations where neighbouring points differ by
    less than it: the interval then misses the truth (it holds it in nine of ten cases at noise of
    1 % of the width, in four of five at 5 %). `less_noise` takes the widening off.

    Raises
    ------
    RecordError
        There are fewer than three points, one is not finite, all have the same position along, or
        the covariance has a wrong shape.
    ModelError
        The direction of measurement is not known.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 2.0, 3.5, 5.0]) * 1e-3
    >>> y = np.array([0.0, 2.1, 1.4, 3.0, 0.5]) * 1e-6
    >>> zone = minimum_zone(x, y, covariance=(0.1e-6) ** 2)
    >>> print(f"{1e6 * zone.deviation.value:.3f} um +- {1e6 * zone.deviation.expanded:.3f} um")
    2.650 um +- 0.246 um
    >>> zone.contacts
    (0, 4, 3)
    """
    x, y = _points(along, across)
    _known(measured)
    first, second, opposite = narrowest_strip(x, y, orthogonal=measured == "orthogonal")
    slope = (y[second] - y[first]) / (x[second] - x[first])
    share = 1.0 / np.hypot(1.0, slope) if measured == "orthogonal" else 1.0
    edge = y[first] + slope * (x[opposite] - x[first])
    height = (y[opposite] - edge) * share
    # from the edge to the middle of the zone
    offset = y[first] - slope * x[first] + 0.5 * height / share
    foot = (x[opposite] - x[first]) / (x[second] - x[first])
    if measured == "orthogonal":
        run, rise = x[second] - x[first], y[second] - y[first]
        foot = ((x[opposite] - x[first]) * run + (y[opposite] - y[first]) * rise) / (
            run**2 + rise**2
        )
    sign = 1.0 if height >= 0.0 else -1.0
    gradient = np.zeros(x.size)
    # a point may be its own neighbour where two lie one over the other
    np.add.at(gradient, [opposite, first, second], sign * share * np.array([1, foot - 1, -foot]))
    return Straightness(
        deviation=_estimate(abs(float(height)), gradient, covariance),
        method="minimum zone",
        measured=measured,
        slope=float(slope),
        offset=float(offset),
        distances=(y - offset - slope * x) * share,
        contacts=(first, second, opposite),
        sensitivity=gradient,
    )


def least_squares_straightness(
    along: ArrayLike,
    across: ArrayLike,
    *,
    covariance: ArrayLike | None = None,
    measured: Measured = "across",
) -> Straightness:
    """Return the distance from the highest to the lowest point about the least-squares line.

    Measured across, the line makes the sum of squares in that direction least; square to the line
    it is the principal axis of the points (Pearson, 1901, Philosophical Magazine 2).

    Parameters
    ----------
    along : array_like
        Position along the motion [m], shape (n,).
    across : array_like
        Deviation square to it [m], shape (n,).
    covariance : array_like, optional
        Covariance of `across` [m^2]: shape (n, n), (n,) or (), as of `minimum_zone`.
    measured : {"across", "orthogonal"}
        Direction of the distances.

    Returns
    -------
    Straightness
        Width, line, and the highest and the lowest point.

    Validity
    --------
    As of `minimum_zone`: the uncertainty is linear in the points, and noise makes the width grow.
    The points count alike, so that uneven spacing leans the line towards where they are dense.

    Raises
    ------
    RecordError
        There are fewer than three points, one is not finite, all have the same position along, or
        the covariance has a wrong shape.
    ModelError
        The direction of measurement is not known.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 2.0, 3.5, 5.0]) * 1e-3
    >>> y = np.array([0.0, 2.1, 1.4, 3.0, 0.5]) * 1e-6
    >>> print(f"{1e6 * least_squares_straightness(x, y).deviation.value:.3f} um")
    2.671 um
    """
    x, y = _points(along, across)
    _known(measured)
    a, b = x - x.mean(), y - y.mean()
    if measured == "across":
        angle, slope = 0.0, float(a @ b / (a @ a))
        distances, lever = b - slope * a, a / float(a @ a)
        turn = lever
    else:
        angle = 0.5 * float(np.arctan2(2.0 * (a @ b), a @ a - b @ b))
        slope = float(np.tan(angle))
        lever, distances = (
            a * np.cos(angle) + b * np.sin(angle),
            b * np.cos(angle) - a * np.sin(angle),
        )
        # how the angle of the principal axis changes with `across` of each point
        spread = float(lever @ lever - distances @ distances)
        turn = (lever * np.cos(angle) + distances * np.sin(angle)) / spread
    top, bottom = int(np.argmax(distances)), int(np.argmin(distances))
    gradient = np.zeros(x.size)
    # the shift of the line is common to both, its tilt is not
    gradient[top] += np.cos(angle)
    gradient[bottom] -= np.cos(angle)
    reach = a if measured == "across" else lever
    gradient -= (reach[top] - reach[bottom]) * turn
    return Straightness(
        deviation=_estimate(float(distances[top] - distances[bottom]), gradient, covariance),
        method="least squares",
        measured=measured,
        slope=slope,
        offset=float(y.mean() - slope * x.mean()),
        distances=distances,
        contacts=(top, bottom),
        sensitivity=gradient,
    )


def end_point_straightness(
    along: ArrayLike, across: ArrayLike, *, covariance: ArrayLike | None = None
) -> Straightness:
    """Return the distance from the highest to the lowest point about the line through the ends.

    Parameters
    ----------
    along : array_like
        Position along the motion [m], shape (n,); the ends are the least and the greatest.
    across : array_like
        Deviation square to it [m], shape (n,).
    covariance : array_like, optional
        Covariance of `across` [m^2]: shape (n, n), (n,) or (), as of `minimum_zone`.

    Returns
    -------
    Straightness
        Width in the direction of `across`, line, and the highest and the lowest point.

    Validity
    --------
    As of `minimum_zone`. The line hangs on two points alone, so it is the least certain of the
    three, and the width is up to twice that of the minimum zone.

    Raises
    ------
    RecordError
        There are fewer than three points, one is not finite, all have the same position along, or
        the covariance has a wrong shape.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 2.0, 3.5, 5.0]) * 1e-3
    >>> y = np.array([0.0, 2.1, 1.4, 3.0, 0.5]) * 1e-6
    >>> print(f"{1e6 * end_point_straightness(x, y).deviation.value:.3f} um")
    2.650 um
    """
    x, y = _points(along, across)
    start, end = int(np.argmin(x)), int(np.argmax(x))
    share = (x - x[start]) / (x[end] - x[start])
    distances = y - (1.0 - share) * y[start] - share * y[end]
    # without the rounding that would make an end the highest or the lowest by nothing
    distances[[start, end]] = 0.0
    top, bottom = int(np.argmax(distances)), int(np.argmin(distances))
    gradient = np.zeros(x.size)
    for point, sign in ((top, 1.0), (bottom, -1.0)):
        gradient[point] += sign
        gradient[start] -= sign * (1.0 - share[point])
        gradient[end] -= sign * share[point]
    slope = float((y[end] - y[start]) / (x[end] - x[start]))
    return Straightness(
        deviation=_estimate(float(distances[top] - distances[bottom]), gradient, covariance),
        method="end points",
        measured="across",
        slope=slope,
        offset=float(y[start] - slope * x[start]),
        distances=distances,
        contacts=(top, bottom),
        sensitivity=gradient,
    )


def _points(along: ArrayLike, across: ArrayLike) -> tuple[Array, Array]:
    x, y = np.asarray(along, dtype=np.float64), np.asarray(across, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape or x.size < 3:
        raise RecordError(
            "a straightness needs at least three points, one position along for each deviation "
            f"across, got shapes {x.shape} and {y.shape}"
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise RecordError("the points of a straightness must be finite: leave out the others")
    if not np.ptp(x) > 0.0:
        raise RecordError("all points have the same position along: a line needs two")
    return x, y


def _known(measured: str) -> None:
    if measured not in {"across", "orthogonal"}:
        raise ModelError(f"a distance is measured 'across' or 'orthogonal', got {measured!r}")


def _covariance_matrix(covariance: ArrayLike, n: int) -> tuple[Array, bool]:
    """Return variances (n,), or a covariance (n, n), and which of the two it is."""
    given = np.asarray(covariance, dtype=np.float64)
    if given.shape not in {(), (n,), (n, n)} or not np.isfinite(given).all():
        raise RecordError(
            f"the covariance of {n} points must be finite, of shape ({n}, {n}), ({n},) or (), got "
            f"shape {given.shape}"
        )
    variances = given.diagonal() if given.ndim == 2 else given
    if np.any(variances < 0.0):
        raise RecordError("a variance of a point is negative: give squares of standard deviations")
    return (given, True) if given.ndim == 2 else (np.broadcast_to(given, (n,)), False)


def _estimate(value: float, gradient: Array, covariance: ArrayLike | None) -> Estimate:
    if covariance is None:
        return Estimate(value=value, unit="m", note=_NOISY)
    c, full = _covariance_matrix(covariance, gradient.size)
    variance = float(gradient @ c @ gradient if full else gradient**2 @ c)
    uncertainty = float(np.sqrt(max(variance, 0.0)))
    mean = float(np.sqrt(np.mean(c.diagonal() if full else c)))
    note = _NOTICEABLE if mean > _SHARE_OF_NOISE * value else ""
    return Estimate.of(value, uncertainty, "m", source="noise of the points", note=note)


_METHODS: dict[str, Callable[..., Straightness]] = {
    "minimum zone": minimum_zone,
    "least squares": least_squares_straightness,
    "end points": end_point_straightness,
}


def less_noise(
    along: ArrayLike,
    across: ArrayLike,
    covariance: ArrayLike,
    *,
    method: Method = "minimum zone",
    draws: int = 400,
    seed: int = 1,
) -> Estimate:
    """Return a straightness deviation without what noise adds to it, by a parametric bootstrap.

    A distance between extremes grows with noise, as the highest point is likely to be one that
    noise has lifted. The form is taken for a polynomial, of the degree that Akaike's criterion
    chooses (1974, IEEE Transactions on Automatic Control 19); noise of the given covariance is
    added to it many times (Efron and Tibshirani, 1993, An Introduction to the Bootstrap, 6.5 and
    10.2). The mean growth of the deviation is taken off, its scatter is the uncertainty.

    Parameters
    ----------
    along : array_like
        Position along the motion [m], shape (n,).
    across : array_like
        Deviation square to it [m], shape (n,).
    covariance : array_like
        Covariance of `across` [m^2]: shape (n, n), or (n,) of variances where the points do not
        hang together, or one variance for all.
    method : {"minimum zone", "least squares", "end points"}
        The reference line; distances are measured across.
    draws : int
        How many times noise is added, 50 or more.
    seed : int
        Seed of the noise.

    Returns
    -------
    Estimate
        The deviation [m], 0 or more.

    Validity
    --------
    A form that a polynomial of degree 20 or less, with three points for each degree, describes to
    within the noise. The covariance must be known, and not only a guess: where it is too small no
    curve agrees, where it is too large the form is taken for noise.

    Raises
    ------
    RecordError
        The points or the covariance are not usable, or a variance is 0.
    ModelError
        The method is not known, or there are fewer than 50 draws.
    ConvergenceError
        No curve agrees with the points.

    Examples
    --------
    >>> x = np.linspace(0.0, 60e-6, 41)
    >>> form = 37e-9 * np.cos(x / 13e-6)
    >>> y = form + 6e-9 * np.random.default_rng(2).standard_normal(41)
    >>> found = less_noise(x, y, (6e-9) ** 2)
    >>> points = [1e9 * minimum_zone(x, v).deviation.value for v in (form, y)]
    >>> print(f"{points[0]:.1f} nm, with noise {points[1]:.1f} nm")
    47.8 nm, with noise 61.3 nm
    >>> print(f"{1e9 * found.value:.1f} nm +- {1e9 * found.expanded:.1f} nm")
    49.9 nm +- 11.9 nm
    """
    if method not in _METHODS:
        raise ModelError(f"a straightness is by {', '.join(_METHODS)}, got {method!r}")
    if draws < 50:
        raise ModelError(f"the scatter of a figure needs 50 draws or more, got {draws}")
    evaluate = _METHODS[method]
    measured = evaluate(along, across).deviation.value
    x, y = np.asarray(along, dtype=np.float64), np.asarray(across, dtype=np.float64)
    root = _root(covariance, x.size)
    form, degree = _curve(x, y, root)
    random = np.random.default_rng(seed)
    noise = random.standard_normal((draws, x.size)) @ root.T
    drawn = np.array([evaluate(x, form + e).deviation.value for e in noise])
    growth = float(drawn.mean()) - evaluate(x, form).deviation.value
    value = max(measured - growth, 0.0)
    components = (
        Component(name="noise of the points", uncertainty=float(drawn.std(ddof=1))),
        Component(name="choice of the form", uncertainty=_DOUBT_OF_GROWTH * abs(growth), kind="B"),
    )
    half = Estimate(value=value, unit="m", components=components).expanded
    return Estimate(
        value=value,
        unit="m",
        components=components,
        bounds=(max(measured - growth - half, 0.0), value + half),
        note=(
            f"{growth:.2g} m of {measured:.3g} m taken off as noise, of a form of degree {degree}"
        ),
    )


def _root(covariance: ArrayLike, n: int) -> Array:
    """Return a matrix that makes noise of this covariance from independent numbers."""
    given, full = _covariance_matrix(covariance, n)
    matrix = given if full else np.diag(given)
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise RecordError(
            "the covariance of the points must be positive definite: give each point a variance"
        ) from None


def _curve(x: Array, y: Array, root: Array) -> tuple[Array, int]:
    """Return the polynomial that Akaike's criterion chooses, at the points, and its degree."""
    from scipy.special import chdtri

    n = x.size
    scaled = 2.0 * (x - x.min()) / np.ptp(x) - 1.0
    basis = np.polynomial.legendre.legvander(scaled, min(_HIGHEST_DEGREE, n // _POINTS_FOR_DEGREE))
    white, target = np.linalg.solve(root, basis), np.linalg.solve(root, y)
    q, triangle = np.linalg.qr(white)
    part = q.T @ target
    misfit = float(target @ target) - np.cumsum(part**2)
    degrees = np.arange(1, basis.shape[1])
    degree = int(degrees[np.argmin(misfit[1:] + 2.0 * degrees)])
    if misfit[degree] <= chdtri(n - degree - 1, _REJECTED):
        k = degree + 1
        return basis[:, :k] @ np.linalg.solve(triangle[:k, :k], part[:k]), degree
    raise ConvergenceError(
        f"no polynomial of degree {basis.shape[1] - 1} or less agrees with the {n} points to "
        "within their noise: give the true covariance, or more points"
    )
