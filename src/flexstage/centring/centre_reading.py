"""A measured eccentricity, as the procedure asks a table for it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.eccentricity import Eccentricity
from flexstage.centring.vector_interval import length_estimate
from flexstage.errors import RecordError
from flexstage.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentreReading:
    """A measured eccentricity."""

    vector: Array
    """Centre of the scale, x and y in the frame that turns with the table [m], shape (2,)."""
    covariance: Array
    """Its covariance [m^2], shape (2, 2)."""
    degrees_of_freedom: float = math.inf
    """Those of the covariance."""

    @property
    def length(self) -> Estimate:
        """The eccentricity [m]."""
        return length_estimate(
            self.vector, self.covariance, "m", degrees_of_freedom=self.degrees_of_freedom
        )

    def covers(self, vector: ArrayLike) -> bool:
        """Say whether the 95 % region of the centre holds a point, x and y [m].

        It is the ellipse of Hotelling (1931, Annals of Mathematical Statistics 2), of known shape.
        """
        from scipy.special import chdtri, fdtri

        off = np.asarray(vector, dtype=np.float64) - self.vector
        dof = self.degrees_of_freedom
        far = chdtri(2.0, 0.05) if math.isinf(dof) else 2.0 * fdtri(2.0, dof, 0.95)
        return bool(off @ np.linalg.solve(self.covariance, off) <= far)


def centre_reading(found: Eccentricity) -> CentreReading:
    """Return an eccentricity that was found from heads or indicators as the procedure takes it.

    Examples
    --------
    >>> from flexstage.centring import HeadReadings, eccentricity
    >>> t = 2.0 * np.pi * np.arange(90) / 90
    >>> read = HeadReadings(angle=t, error=1e-3 * np.sin(t - 0.3))
    >>> found = centre_reading(eccentricity(read, radius=50e-3))
    >>> print(f"{1e6 * found.vector[0]:.3f} um, {1e6 * found.vector[1]:.3f} um")
    47.767 um, 14.776 um
    """
    return CentreReading(
        vector=found.vector,
        covariance=found.covariance,
        degrees_of_freedom=min(found.x.degrees_of_freedom, found.y.degrees_of_freedom),
    )


def table_reading(table: CalibrationTable, radius: float) -> CentreReading:
    r"""Return the eccentricity that the first order of a table of errors stands for.

    `radius` is that at which the scale is read [m].

    .. math:: e_x = R\, b_1, \quad e_y = -R\, a_1

    Validity
    --------
    Errors of order 1 that the lines of the scale have themselves are in it: no number of heads, and
    no move, tells the two apart, since a move shows no more than a difference. It is their sum that
    makes the readings wrong, and that a move removes. Where the place of the rim matters and not
    the reading, use indicators on it. For uneven sampling, the mean uncertainty of both directions
    is taken for each.

    Examples
    --------
    >>> from flexstage.centring import against_reference
    >>> t = 2.0 * np.pi * np.arange(90) / 90
    >>> read = 1e-3 * np.sin(t - 0.3)
    >>> table = against_reference(t, read, heads=[0.0], orders=range(1, 5), noise=5e-6)
    >>> found = table_reading(table, 50e-3)
    >>> print(f"{1e6 * found.length.value:.2f} um, {1e6 * found.length.uncertainty:.3f} um")
    50.00 um, 0.037 um
    """
    if not 0.0 < radius < math.inf:
        raise RecordError(f"the radius of the scale must be positive and finite, got {radius!r} m")
    a, b = table.harmonic(1)
    u = float(table.order_uncertainty[table.orders.index(1)])
    return CentreReading(
        vector=radius * np.array([b, -a]),
        covariance=(radius * u) ** 2 * np.eye(2),
        degrees_of_freedom=table.degrees_of_freedom,
    )
