"""Table of a scale's own errors, for the correction of its readings."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.quantities.estimate import Estimate
from flexstage.records import Channel, Record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationTable:
    r"""Error of a scale over a turn, reading minus true scale angle.

    .. math:: g(s) = \sum_n a_n \cos n s + b_n \sin n s

    over the orders n of the table. The angle s of the scale is the reading of an error-free scale:
    with the table turned by theta and a head at alpha, s = theta + alpha, as in
    `flexstage.centring.geometry`.

    Examples
    --------
    >>> s = 2.0 * np.pi * np.arange(72) / 72
    >>> heads = np.array([0.0, 0.7, 1.9])
    >>> read = 4e-6 * np.sin(3.0 * (s + heads[:, np.newaxis]))
    >>> from flexstage.centring.calibration import ScaleReadings, self_calibration
    >>> readings = ScaleReadings(angle=s, errors=read, heads=heads, noise=1e-9)
    >>> table = self_calibration(readings, range(2, 9))
    >>> print(f"{table.error_at(0.5) * 1e6:.3f} urad")
    3.990 urad
    """

    angle: Array
    """Angles of the scale [rad], evenly spaced over a turn from 0, shape (k,)."""
    error: Array
    """Reading minus angle at these angles [rad], shape (k,), of mean zero."""
    uncertainty: Array
    """Standard uncertainty of `error` [rad], shape (k,)."""
    degrees_of_freedom: float = math.inf
    """Degrees of freedom of the uncertainty: infinite if the noise was given."""
    orders: tuple[int, ...]
    """The orders of the table."""
    blind: tuple[int, ...] = ()
    """Requested orders to which the method is blind: they are missing from `error`, and from its
    uncertainty unless an allowance was given for them.
    """
    cosine: Array
    """Amplitudes a of the cosines [rad], shape (orders,)."""
    sine: Array
    """Amplitudes b of the sines [rad], shape (orders,)."""
    order_uncertainty: Array
    """Standard uncertainty of each of them [rad], root mean square of the two, shape (orders,)."""
    noise: float
    """Standard deviation of one reading [rad]."""
    method: str
    """Calibration method."""

    def error_at(self, angle: ArrayLike) -> Array:
        """Return the error of the scale at any angle.

        Parameters
        ----------
        angle : array_like
            Angles of the scale [rad], of any shape.

        Returns
        -------
        numpy.ndarray
            Reading minus angle [rad], of the same shape.
        """
        s = np.asarray(angle, dtype=np.float64)
        flat = np.atleast_1d(s).ravel()
        out = np.zeros_like(flat)
        # in parts, so that the angles times the orders stay small in memory
        n = np.asarray(self.orders, dtype=np.float64)
        step = max(1, 1_000_000 // max(1, n.size))
        for i in range(0, flat.size, step):
            phase = np.multiply.outer(flat[i : i + step], n)
            out[i : i + step] = np.cos(phase) @ self.cosine + np.sin(phase) @ self.sine
        return out.reshape(s.shape)

    def correct(self, reading: ArrayLike) -> Array:
        """Return the true scale angles of readings.

        The reading is s + g(s); s is found by repeated substitution.

        Parameters
        ----------
        reading : array_like
            Readings of the scale [rad], of any shape.

        Returns
        -------
        numpy.ndarray
            Angles of the scale [rad], of the same shape.

        Raises
        ------
        RecordError
            The errors are so steep that readings repeat themselves.
        """
        r = np.asarray(reading, dtype=np.float64)
        n = np.asarray(self.orders, dtype=np.float64)
        steepest = float(n @ np.hypot(self.cosine, self.sine)) if n.size else 0.0
        if steepest >= 0.5:
            raise RecordError(
                f"the errors of the table may change by {steepest:.2g} rad per radian, at most 0.5 "
                "is allowed for a unique angle of each reading: is the table in radians?"
            )
        s = r.copy()
        # every iteration reduces the error by at least the steepest slope
        for _ in range(60):
            better = r - self.error_at(s)
            moved = float(np.max(np.abs(better - s), initial=0.0))
            s = better
            if moved * steepest < 1e-16:
                break
        return s

    def estimate(self, angle: float) -> Estimate:
        """Return the error at one angle with its uncertainty.

        Parameters
        ----------
        angle : float
            Angle of the scale [rad].

        Returns
        -------
        Estimate
            Reading minus angle [rad].
        """
        u = np.interp(angle, self.angle, self.uncertainty, period=2.0 * np.pi)
        blind = f"without the orders {_listed(self.blind)}" if self.blind else ""
        return Estimate.of(
            float(self.error_at(angle)),
            float(u),
            "rad",
            source="readings",
            degrees_of_freedom=self.degrees_of_freedom,
            note=blind,
        )

    def harmonic(self, order: int) -> tuple[float, float]:
        """Return the amplitudes of one order.

        Parameters
        ----------
        order : int
            The order.

        Returns
        -------
        tuple of float
            Amplitudes of cosine and sine [rad].

        Raises
        ------
        RecordError
            The table does not have this order.
        """
        if order not in self.orders:
            why = "the method is blind to it" if order in self.blind else "it was not requested"
            raise RecordError(f"the table has no order {order}: {why}")
        i = self.orders.index(order)
        return float(self.cosine[i]), float(self.sine[i])

    def record(self) -> Record:
        """Return the table as a record, to be written to a file.

        Returns
        -------
        Record
            Columns angle, error and uncertainty [rad], over the points.
        """
        columns = (("angle", self.angle), ("error", self.error), ("uncertainty", self.uncertainty))
        notes = [f"errors of a scale by {self.method}, orders {_listed(self.orders)}"]
        if self.blind:
            notes.append(f"the method is blind to orders {_listed(self.blind)}: they are missing")
        return Record(
            channels=tuple(Channel(name=name, values=v, unit="rad") for name, v in columns),
            time=np.arange(self.angle.size, dtype=np.float64),
            source=self.method,
            notes=tuple(notes),
            over="point",
        )


def _listed(orders: tuple[int, ...]) -> str:
    """Return the text of orders, with ranges for consecutive ones."""
    runs: list[list[int]] = []
    for n in sorted(orders):
        if runs and n == runs[-1][1] + 1:
            runs[-1][1] = n
        else:
            runs.append([n, n])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs)
