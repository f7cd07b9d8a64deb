"""Readings of a head on an eccentric scale.

The frame x, y turns with the table. In it the scale is at rest, with its zero line along x and its
lines counted counter-clockwise, and the head travels round it:

.. code-block:: text

            y |        head, at theta + alpha, as far from the axis as its reading radius
              |      o
              |    .'
              |  .'   * centre of the scale, at (e_x, e_y), e long, in the direction phi
              |.'
        ------+---------------- x        + the axis

``theta`` is the true angle of the table, ``alpha`` the angle of the head in the room. An error is
reading minus true angle. Over a table that turns counter-clockwise as seen from above the head
travels clockwise: seen from above, y and alpha then have the opposite sign.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError

ScaleKind = Literal["disc", "drum"]

#: One second of arc [rad].
ARCSEC: float = float(np.pi / 648_000.0)
#: Kinds of scales: radial lines on a face, or lines along the axis on a rim.
SCALE_KINDS: tuple[str, ...] = ("disc", "drum")


def exact_error(
    angle: ArrayLike,
    eccentricity: ArrayLike,
    radius: float,
    *,
    head_angle: ArrayLike = 0.0,
    kind: ScaleKind = "disc",
    axis_motion: ArrayLike = (0.0, 0.0),
    ellipticity: tuple[float, float] = (0.0, 0.0),
    tilt: tuple[float, float] = (0.0, 0.0),
) -> Array:
    r"""Return the exact error of a head on an eccentric scale.

    With the direction of the head beta = theta + alpha and e as a complex number, a head at the
    distance r from the axis of a disc reads the line in the direction from the centre of the scale
    to the head, and the error is

    .. math:: d = \arg\left(1 - \frac{e}{r}\, \mathrm{e}^{-\mathrm{i}\beta}\right)
              = \sum_{n=1}^{\infty}
                \frac{1}{n} \left(\frac{|e|}{r}\right)^n \sin n(\beta - \varphi).

    On a drum the head reads the point where its own radius meets the rim, at R from the centre:

    .. math:: d = \arcsin\left(\frac{|e|}{R} \sin(\beta - \varphi)\right).

    Parameters
    ----------
    angle : array_like
        True angle of the table [rad], shape (n,) or any other.
    eccentricity : array_like
        Centre of the scale, x and y in the frame that turns with the table [m], shape (2,) or
        (n, 2).
    radius : float
        Of a disc, the distance of the head from the axis; of a drum, the radius of its rim [m].
    head_angle : array_like
        Angle of the head in the room [rad], of a shape that fits that of the angle.
    kind : {"disc", "drum"}
        Radial lines on a face, or lines along the axis on a rim.
    axis_motion : array_like
        Position of the table's axis, x and y in the room [m], shape (2,) or (n, 2).
    ellipticity : (float, float)
        Relative stretch of the scale in one direction, and shortening across [1]: the error has
        that amplitude [rad], twice per turn. And that direction in the scale [rad].
    tilt : (float, float)
        Angle between the axes of scale and table [rad], and the direction of the tilt axis in the
        scale [rad].

    Returns
    -------
    numpy.ndarray
        Reading minus true angle [rad], of the shape of angle and head angle together.

    Validity
    --------
    Rigid lines read at a point: the average over a scanning field, the interpolation error and the
    change of signal with distance are not included. The lines of a tilted scale are read along the
    table's axis. The order of deformations is stretch, then tilt.

    Raises
    ------
    ModelError
        The axis is not inside the circle on which the scale is read, the radius is not positive,
        the kind is unknown, or the deformation is impossible.

    Examples
    --------
    >>> error = exact_error([0.5 * np.pi], (50e-6, 0.0), 50e-3)
    >>> print(f"{error[0] / ARCSEC:.4f} arcsec")
    206.2647 arcsec
    """
    require_kind(kind)
    theta = np.asarray(angle, dtype=np.float64)
    beta = theta + np.asarray(head_angle, dtype=np.float64)
    motion = in_turning_frame(axis_motion, theta)
    # the axis is at rest in the frame: its motion moves the centre of the scale
    centre = _as_complex(eccentricity, "eccentricity") + motion
    _require_inside(centre, radius)
    outward = _unit(beta)
    undo = _undeformed(ellipticity, tilt)
    if kind == "disc":
        line = undo(radius * outward - centre)
    else:
        start = undo(-centre)
        _require_inside(start, radius)
        line = _on_rim(start, undo(outward), radius)
    return np.asarray(np.angle(line * np.conj(outward)), dtype=np.float64)


def first_order_error(
    angle: ArrayLike,
    eccentricity: ArrayLike,
    radius: float,
    *,
    head_angle: ArrayLike = 0.0,
    axis_motion: ArrayLike = (0.0, 0.0),
) -> Array:
    r"""Return the error of a head on an eccentric scale, to first order in the eccentricity.

    .. math:: d = \frac{|e|}{R} \sin(\theta + \alpha - \varphi)
              + \frac{m_x \sin\alpha - m_y \cos\alpha}{R}

    Its amplitude is 206 265 e / R arcsec, 412.5 arcsec for each um per mm of diameter.

    Parameters
    ----------
    angle : array_like
        True angle of the table [rad], shape (n,) or any other.
    eccentricity : array_like
        Centre of the scale, x and y in the frame that turns with the table [m], shape (2,) or
        (n, 2).
    radius : float
        Radius at which the scale is read [m].
    head_angle : array_like
        Angle of the head in the room [rad].
    axis_motion : array_like
        Position of the table's axis, x and y in the room [m], shape (2,) or (n, 2).

    Returns
    -------
    numpy.ndarray
        Reading minus true angle [rad].

    Validity
    --------
    It neglects up to (e / R)^2 / 2 on a disc, 0.1 arcsec at e / R = 1e-3, and (e / R)^3 / 6 on a
    drum.

    Raises
    ------
    ModelError
        The axis is not inside the circle on which the scale is read, or the radius is not positive.

    Examples
    --------
    >>> error = first_order_error([0.5 * np.pi], (50e-6, 0.0), 50e-3)
    >>> print(f"{error[0] / ARCSEC:.4f} arcsec")
    206.2648 arcsec
    """
    theta = np.asarray(angle, dtype=np.float64)
    beta = theta + np.asarray(head_angle, dtype=np.float64)
    centre = _as_complex(eccentricity, "eccentricity") + in_turning_frame(axis_motion, theta)
    _require_inside(centre, radius)
    return np.asarray(-np.imag(centre * np.conj(_unit(beta))) / radius, dtype=np.float64)


def exact_run_out(
    angle: ArrayLike,
    eccentricity: ArrayLike,
    radius: float,
    *,
    indicator_angle: ArrayLike = 0.0,
) -> Array:
    r"""Return the reading of an indicator on the round rim of an eccentric scale [m].

    Angles of table and indicator are in the room [rad], the indicator points at the axis; the
    eccentricity is in the frame that turns with the table [m].

    .. math:: s = |e| \cos(\beta - \varphi) + \sqrt{R^2 - |e|^2 \sin^2(\beta - \varphi)} - R

    Validity
    --------
    Point contact with a round rim, on a line through the axis. A ball or flat tip of radius a acts
    like a point on a rim of radius R + a.

    Examples
    --------
    >>> s = exact_run_out([0.0, np.pi], (50e-6, 0.0), 50e-3)
    >>> print(f"{1e6 * (s[0] - s[1]):.3f} um")
    100.000 um
    """
    theta = np.asarray(angle, dtype=np.float64)
    beta = theta + np.asarray(indicator_angle, dtype=np.float64)
    centre = _as_complex(eccentricity, "eccentricity")
    _require_inside(centre, radius)
    relative = centre * np.conj(_unit(beta))
    # sqrt(R^2 - a^2) - R, without the difference of two large numbers
    across = relative.imag / radius
    sag = -radius * across**2 / (1.0 + np.sqrt(1.0 - across**2))
    return np.asarray(relative.real + sag, dtype=np.float64)


def beyond_first_order(outward: Complex, relative: complex, kind: ScaleKind) -> Array:
    """Return the exact error of a rigid scale minus that of first order [rad].

    `outward` is the direction of the head in the frame of the table, exp(i beta), and `relative`
    the eccentricity over the radius, x + i y. A disc has radial lines on a face, a drum lines along
    the axis on a rim.

    Examples
    --------
    >>> wave = np.exp(1j * np.array([0.25 * np.pi]))
    >>> print(f"{beyond_first_order(wave, 1e-3 + 0j, 'disc')[0]:.2e} rad")
    5.00e-07 rad
    """
    local = relative * np.conj(outward)
    # the first order has the sign of the sine of beta minus the direction
    exact = np.angle(1.0 - local) if kind == "disc" else np.arcsin(-local.imag)
    return np.asarray(exact + local.imag, dtype=np.float64)


def in_turning_frame(vector: ArrayLike, angle: ArrayLike) -> Complex:
    """Return a vector of the room in the frame of the table, as a complex number x + i y.

    Examples
    --------
    >>> turned = in_turning_frame((1.0, 0.0), 0.5 * np.pi)
    >>> print(f"{turned.imag:.1f}")
    1.0
    """
    parts = _as_complex(vector, "axis motion")
    # an axis at rest needs no rotation
    return parts * _unit(np.asarray(angle, dtype=np.float64)) if np.any(parts) else parts


def _unit(angle: Array) -> Complex:
    """Return exp(i angle), three times as fast as the exponential of complex numbers."""
    out = np.empty(np.shape(angle), dtype=np.complex128)
    np.cos(angle, out=out.real)
    np.sin(angle, out=out.imag)
    return out


def _as_complex(vector: ArrayLike, what: str) -> Complex:
    parts = np.asarray(vector, dtype=np.float64)
    if parts.ndim == 0 or parts.shape[-1] != 2 or not np.isfinite(parts).all():
        raise ModelError(
            f"the {what} must be x and y, both finite, in metres, got an array of shape "
            f"{parts.shape}"
        )
    return parts[..., 0] + 1j * parts[..., 1]


def require_kind(kind: str) -> None:
    """Refuse an unknown kind of scale."""
    if kind not in SCALE_KINDS:
        raise ModelError(f"the kind of scale must be {' or '.join(SCALE_KINDS)}, got '{kind}'")


def require_radius(radius: float) -> None:
    """Refuse an impossible radius of a scale [m]."""
    if not 0.0 < radius < np.inf:
        raise ModelError(f"the radius of a scale must be positive and finite, got {radius!r} m")


def _require_inside(centre: Complex, radius: float) -> None:
    require_radius(radius)
    furthest = float(np.abs(centre).max()) if centre.size else 0.0
    if furthest >= radius:
        raise ModelError(
            f"the axis must be inside the circle on which the scale is read, got an eccentricity "
            f"of {furthest:g} m at a radius of {radius:g} m"
        )


def _undeformed(
    ellipticity: tuple[float, float], tilted: tuple[float, float]
) -> Callable[[Complex], Complex]:
    """Return the map from the position of a line on the deformed scale to its original one."""
    (stretch, direction), (tilt, tilted_about) = ellipticity, tilted
    if not abs(stretch) < 1.0:
        raise ModelError(f"the ellipticity must be between -1 and 1, got {stretch!r}")
    if not abs(tilt) < 0.5 * np.pi:
        raise ModelError(f"the tilt must be less than a quarter of a turn, got {tilt!r} rad")

    def undo(point: Complex) -> Complex:
        if tilt != 0.0:
            point = _scaled(point, 1.0, 1.0 / np.cos(tilt), tilted_about)
        if stretch != 0.0:
            point = _scaled(point, 1.0 / (1.0 + stretch), 1.0 / (1.0 - stretch), direction)
        return point

    return undo


def _scaled(point: Complex, along: float, across: float, direction: float) -> Complex:
    turn = np.exp(1j * direction)
    local = point * np.conj(turn)
    return (along * local.real + 1j * across * local.imag) * turn


def _on_rim(start: Complex, way: Complex, radius: float) -> Complex:
    """Return the intersection of a ray from a point inside with the circle about zero."""
    unit = way / np.abs(way)
    local = start * np.conj(unit)
    return (np.sqrt(radius**2 - local.imag**2) + 1j * local.imag) * unit
