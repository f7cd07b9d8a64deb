"""What the procedure asks of a table: the eccentricity, measured; and a simulated one."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.eccentricity import Eccentricity, HeadReadings, eccentricity
from flexstage.centring.head_averaging import against_reference
from flexstage.centring.positioner import VirtualPositioner
from flexstage.centring.self_calibration import self_calibration
from flexstage.centring.vector_interval import length_estimate
from flexstage.centring.virtual_table import VirtualTable
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


class RotaryTable(Protocol):
    """A table that is turned, with a scale on it that is read."""

    def measure(self) -> CentreReading:
        """Turn the table and return the eccentricity of the scale."""
        ...


def centre_reading(found: Eccentricity) -> CentreReading:
    """Return an eccentricity that was found from heads or indicators as the procedure takes it.

    Examples
    --------
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


class VirtualBench:
    """A simulated table with a simulated stage on it that carries the scale.

    Parameters
    ----------
    table : VirtualTable
        The table, with the eccentricity of the scale for the stage in the middle of its stroke.
    positioner : VirtualPositioner
        The stage.
    method : {"reference", "heads alone", "eccentricity"}
        How the readings are evaluated: compared with the reference of angle, by
        `flexstage.centring.head_averaging.against_reference`; with one another, of two heads or
        more; or by `flexstage.centring.eccentricity.eccentricity`, which looks for outliers and
        correlated noise and takes longer.
    orders : iterable of int
        Orders of the errors that are solved for beside the eccentricity.

    Raises
    ------
    RecordError
        One head is to be read alone, or the method is none.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> stage = VirtualPositioner(design("vgtu-mechanical"))
    >>> table = VirtualTable(radius=50e-3, eccentricity=(30e-6, 40e-6), noise=5e-6)
    >>> print(f"{1e6 * VirtualBench(table, stage).measure().length.value:.2f} um")
    49.98 um
    """

    def __init__(
        self,
        table: VirtualTable,
        positioner: VirtualPositioner,
        *,
        method: Literal["reference", "heads alone", "eccentricity"] = "reference",
        orders: Iterable[int] = range(1, 25),
    ) -> None:
        if method not in ("reference", "heads alone", "eccentricity"):
            raise RecordError(
                f"the method is 'reference', 'heads alone' or 'eccentricity', got '{method}'"
            )
        if method == "heads alone" and len(table.heads) < 2:
            raise RecordError("one head needs a reference of angle to be compared with")
        self._table, self._positioner = table, positioner
        self._orders = tuple(orders)
        self._method = method
        self._count = 0

    @property
    def true_eccentricity(self) -> Array:
        """Where the centre really appears to be [m], shape (2,): the scale's order 1 is in it."""
        return self._table.apparent_eccentricity + self._positioner.true_position

    def measure(self) -> CentreReading:
        """Turn the table and return the eccentricity of the scale."""
        x, y = self._positioner.true_position
        record = self._table.moved(float(x), float(y)).record(index=self._count)
        self._count += 1
        angle, *errors = (channel.values for channel in record.channels)
        heads = self._table.heads
        if self._method != "eccentricity":
            separate = against_reference if self._method == "reference" else self_calibration
            found = separate(angle, np.stack(errors), heads=heads, orders=self._orders)
            return table_reading(found, self._table.radius)
        readings = [
            HeadReadings(angle=angle, error=error, head_angle=alpha)
            for alpha, error in zip(heads, errors, strict=True)
        ]
        return centre_reading(
            eccentricity(
                readings, radius=self._table.radius, kind=self._table.kind, orders=self._orders
            )
        )
