"""How a platform strays from a straight line: smooth curves over its stroke, and their figures."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError

#: Motions beside the one along the axis: sideways in the plane, out of it, and the rotations about
#: the axis, about the sideways direction and about the normal of the plane.
MOTIONS: tuple[str, ...] = ("across", "vertical", "roll", "pitch", "yaw")

#: Highest order of a curve: what bending and manufacture leave is smooth.
_ORDER = 5
_GRID = 4001


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuideErrors:
    """Motions beside the one along the axis, as curves over the stroke.

    Examples
    --------
    >>> bow = GuideErrors(stroke=60e-6, coefficients={"across": np.array([0.0, 0.0, 1e-7])})
    >>> print(f"{bow.straightness('across') * 1e9:.0f} nm")
    150 nm
    """

    stroke: float
    """Length of the stroke [m]."""
    coefficients: Mapping[str, Array]
    """Coefficients of the Legendre polynomials over the stroke, from order 0 [m, or rad], by the
    names of `MOTIONS`, and ``along`` for what the position itself is off by.
    """

    def at(self, position: ArrayLike, motion: str) -> Array:
        """Return a motion.

        In m or rad, 0 at position 0; the motion is one of `MOTIONS`, or ``along``.
        """
        c = self.coefficients.get(motion)
        t = 2.0 * np.asarray(position, dtype=np.float64) / self.stroke - 1.0
        if c is None:
            return np.zeros_like(t)
        return legendre.legval(t, c) - legendre.legval(-1.0, c)

    def straightness(self, motion: str) -> float:
        """Return largest less smallest deviation from the least-squares straight line."""
        p = np.linspace(0.0, self.stroke, _GRID)
        e = self.at(p, motion)
        return float(np.ptp(e - straight_line(p, e)(p)))

    def slope(self, motion: str) -> float:
        """Return the slope of the least-squares straight line [1, or rad/m]."""
        p = np.linspace(0.0, self.stroke, _GRID)
        fitted = straight_line(p, self.at(p, motion)).convert().coef
        return float(fitted[1]) if fitted.size > 1 else 0.0

    def range(self, motion: str) -> float:
        """Return largest less smallest motion over the stroke [m, or rad]."""
        return float(np.ptp(self.at(np.linspace(0.0, self.stroke, _GRID), motion)))


def straight_line(x: Array, y: Array) -> np.polynomial.Polynomial:
    """Return the least-squares straight line of a curve, all positions alike.

    Of the integral over even positions, so that the ends count by half.
    """
    weight = np.ones(x.size)
    weight[[0, -1]] = 0.5**0.5
    return np.polynomial.Polynomial.fit(x, y, 1, w=weight)


def random_guide(
    stroke: float,
    straightness: Mapping[str, float],
    slopes: Mapping[str, float],
    rng: np.random.Generator,
) -> GuideErrors:
    """Draw smooth curves of given straightness and slope.

    Straightness is largest less smallest deviation from the least-squares line [m, or rad], slope
    that of the line [1, or rad/m], 0 where none is given. Drawn are Legendre polynomials of orders
    2 to 5, whose size falls with the order.
    """
    if not stroke > 0.0:
        raise ModelError(f"a stroke must be positive, got {stroke!r} m")
    coefficients: dict[str, Array] = {}
    for motion, wanted in straightness.items():
        order = np.arange(_ORDER + 1)
        c = np.where(order >= 2, rng.standard_normal(order.size) / np.maximum(order, 1) ** 1.5, 0.0)
        # one sign of the lowest order, so that no draw is nearly all high orders
        c[2] = np.copysign(0.5 + abs(c[2]), c[2])
        bent = GuideErrors(stroke=stroke, coefficients={motion: c}).straightness(motion)
        c *= wanted / bent
        c[1] = 0.5 * slopes.get(motion, 0.0) * stroke
        if motion == "along":
            # the position is right at both ends, which are those of the stroke
            c[1] = -float(c[3::2].sum())
        coefficients[motion] = c
    return GuideErrors(stroke=stroke, coefficients=coefficients)
