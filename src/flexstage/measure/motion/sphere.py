"""Centre and radius of a sphere from points probed on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ConvergenceError, ModelError, RecordError
from flexstage.estimate import Component, Estimate

_ROUNDS = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SphereFit:
    """A sphere through probed points."""

    centre: Array
    """Its centre [m], shape (3,)."""
    radius: Estimate
    """Its radius [m]; without uncertainty where it was given."""
    covariance: Array
    """Covariance of the centre [m^2], shape (3, 3)."""
    residuals: Array
    """Distance of each point from the sphere, positive outside [m], shape (n,)."""
    degrees_of_freedom: float
    """Of the uncertainty: infinite where the noise of the points was given."""


def sphere_fit(
    points: ArrayLike, *, noise: float | None = None, radius: float | None = None
) -> SphereFit:
    """Return the sphere whose squared distances from the points have the least sum.

    Gauss and Newton's method on ``|p_i - c| - r``, from the sphere that is linear least squares in
    ``2 c . p + (r^2 - c^2) = p^2``.

    Parameters
    ----------
    points : array_like
        Points on the sphere, corrected for the ball of the probe or not: then the radius is the
        sum of both [m], shape (n, 3).
    noise : float, optional
        Standard deviation of a point square to the surface [m]; found from the residuals where not
        given.
    radius : float, optional
        The radius, where it is known [m].

    Returns
    -------
    SphereFit
        Centre and radius with their covariance.

    Validity
    --------
    First order in noise over radius. Points on a cap that is small leave centre and radius hard to
    tell apart, which the covariance says; the form error of the ball counts as noise.

    Raises
    ------
    RecordError
        There are too few points, one is not finite, or all lie in a plane.
    ModelError
        The noise or the radius is not positive, or there are no points to find the noise from.
    ConvergenceError
        The points are not on a sphere that can be told from a plane.

    Examples
    --------
    >>> normal = np.array([[1, 0, 0], [0, 1, 0], [-0.6, 0, 0.8], [0, -0.6, 0.8], [0, 0, 1.0]])
    >>> ball = sphere_fit([3e-3, 1e-3, 0.0] + 5e-3 * normal, noise=0.2e-6)
    >>> print(f"{1e3 * ball.radius.value:.3f} mm +- {1e6 * ball.radius.expanded:.2f} um")
    5.000 mm +- 0.56 um
    """
    p = np.asarray(points, dtype=np.float64)
    unknowns = 4 if radius is None else 3
    least = max(4, unknowns + (noise is None))
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < least or not np.isfinite(p).all():
        raise RecordError(
            f"a sphere needs at least {least} finite points in space here, got shape {p.shape}"
        )
    for name, value in (("noise of a point", noise), ("radius of a sphere", radius)):
        if value is not None and not 0.0 < value < np.inf:
            raise ModelError(f"the {name} must be positive, got {value!r}")
    origin = p.mean(0)
    size = float(np.sqrt(np.mean((p - origin) ** 2)))
    q = (p - origin) / (size or 1.0)
    if np.linalg.matrix_rank(q, tol=1e-7 * np.sqrt(len(q))) < 3:
        raise RecordError("the points of a sphere lie in a plane: probe some off it")
    start, *_ = np.linalg.lstsq(
        np.column_stack([2.0 * q, np.ones(len(q))]), np.sum(q**2, axis=1), rcond=None
    )
    known = None if radius is None else radius / size
    r = float(np.sqrt(start[3] + start[:3] @ start[:3])) if known is None else known
    c, r, J, residuals = _rounds(q, start[:3], r, fixed=known is not None)
    normal = np.linalg.inv(J.T @ J)
    freedom = np.inf if noise is not None else float(len(p) - unknowns)
    variance = noise**2 if noise is not None else float(residuals @ residuals) * size**2 / freedom
    covariance = np.asarray(normal * variance, dtype=np.float64)
    parts = ()
    if known is None:
        spread = Component(
            name="noise of the points",
            uncertainty=float(np.sqrt(covariance[3, 3])),
            degrees_of_freedom=freedom,
        )
        parts = (spread,)
    return SphereFit(
        centre=origin + size * c,
        radius=Estimate(value=size * r, unit="m", components=parts),
        covariance=covariance[:3, :3],
        residuals=size * residuals,
        degrees_of_freedom=freedom,
    )


def _rounds(q: Array, c: Array, r: float, *, fixed: bool) -> tuple[Array, float, Array, Array]:
    step, J = np.full(3, np.inf), np.empty((0, 3))
    for _ in range(_ROUNDS):
        away = q - c
        distance = np.linalg.norm(away, axis=1)
        J = -away / distance[:, None]
        if not fixed:
            J = np.column_stack([J, -np.ones(len(q))])
        step, *_ = np.linalg.lstsq(J, r - distance, rcond=None)
        c, r = c + step[:3], r if fixed else r + float(step[3])
        if np.abs(step).max() < 1e-14 * max(1.0, r):
            break
        if not r < 1e6:
            break
    else:
        # rounding may keep the last digits moving; a step that still matters may not
        if np.abs(step).max() > 1e-9 * max(1.0, r):
            raise ConvergenceError(f"the fit of a sphere did not settle in {_ROUNDS} rounds")
    if not 0.0 < r < 1e6:
        raise ConvergenceError("the points determine no sphere: they lie nearly in a plane")
    return c, r, J, np.linalg.norm(q - c, axis=1) - r
