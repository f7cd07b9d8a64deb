"""Lines with kinks: a superposition of one-sided dead zones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.models.play import fixed, rising
from flexstage.hysteresis.models.play_sum import offsets_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiecewiseLinear:
    """A continuous, piecewise-linear function that is zero at zero."""

    knots: Array
    """Where the slope changes, rising, shape (c,)."""
    slopes: Array
    """Slopes below, between and above the knots, shape (c + 1,)."""

    def at(self, x: ArrayLike) -> Array:
        """Return the function."""
        given = np.asarray(x, dtype=np.float64)
        j = np.searchsorted(self.knots, given)
        return self.offsets()[j] + self.slopes[j] * given

    def offsets(self) -> Array:
        """Return the values at zero of the straight lines that it is made of, shape (c + 1,)."""
        return offsets_of(np.array(self.knots), self.slopes[None, :].copy())[0]

    def inverse(self) -> "PiecewiseLinear":
        """Return the inverse, again such a line; its knots are the values at the knots.

        A ModelError where a slope is not positive.
        """
        if np.min(self.slopes) <= 0.0:
            raise ModelError(
                f"a line has an inverse if all its slopes are positive, got {np.min(self.slopes):g}"
            )
        return PiecewiseLinear(knots=self.at(self.knots), slopes=1.0 / self.slopes)


def dead_zone_line(gain: float, thresholds: ArrayLike, weights: ArrayLike) -> PiecewiseLinear:
    """Return the superposition of one-sided dead zones.

    ``S(x) = gain x + sum_i w_i max(x - r_i, 0)`` for positive, ``min(x - r_i, 0)`` for negative
    thresholds r_i (Kuhnen 2003, Eur. J. Control 9:407).

    Notes
    -----
    Validity: any continuous, piecewise-linear function that is zero at zero and has no kink there.

    Examples
    --------
    >>> dead_zone_line(1.0, [-4.0, 5.0], [-0.2, 0.3]).at([-10.0, 2.0, 7.0])
    array([-8.8,  2. ,  7.6])
    """
    r = rising(thresholds, "thresholds of dead zones", least=0)
    w = fixed(weights, "weights of dead zones", r.shape)
    if np.any(r == 0.0):
        raise ModelError("a dead zone has a threshold that is not zero, got 0: use the gain there")
    below = np.cumsum(w[r < 0.0][::-1])[::-1]
    above = np.cumsum(w[r > 0.0])
    return PiecewiseLinear(knots=r, slopes=gain + np.concatenate([below, [0.0], above]))


def dead_zones(line: PiecewiseLinear) -> tuple[float, Array, Array]:
    """Return gain, thresholds and weights of the dead zones whose superposition is a line.

    Notes
    -----
    Validity: as `dead_zone_line`.

    Examples
    --------
    >>> inverse = dead_zone_line(1.0, [-4.0, 5.0], [-0.2, 0.25]).inverse()
    >>> gain, thresholds, weights = dead_zones(inverse)
    >>> weights
    array([ 0.25, -0.2 ])
    """
    if np.any(line.knots == 0.0):
        raise ModelError("dead zones have no threshold at zero, got a line with a knot there")
    zero = int(np.searchsorted(line.knots, 0.0))
    steps = np.diff(line.slopes)
    weights = np.concatenate([-steps[:zero], steps[zero:]])
    return float(line.slopes[zero]), line.knots, weights
