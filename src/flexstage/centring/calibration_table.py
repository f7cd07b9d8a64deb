"""Table of a scale's own errors, for the correction of its readings."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.quantities.estimate import Component, Estimate
from flexstage.records import Channel, Record


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorSource:
    """Covariance of the errors of a division from one source, independent of the others."""

    source: str
    """Source of the contribution."""
    covariance: Array
    """Covariance of the errors [rad2], shape (n, n)."""
    degrees_of_freedom: float = math.inf
    """Degrees of freedom of a statistical estimate; infinite where it is given."""
    kind: Literal["A", "B"] = "B"
    """Type of evaluation: repeated observations (A) or other means (B), JCGM 100:2008, 4.2, 4.3."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Division:
    """Errors of evenly spaced points of a circle: of a scale, a table or the faces of a polygon.

    Their sum is zero. Errors of two points are correlated, so the uncertainty of the angle between
    them needs the covariance.

    Examples
    --------
    >>> noise = ErrorSource(source="noise", covariance=1e-14 * (np.eye(4) - 0.25))
    >>> quarters = Division(
    ...     name="faces", error=np.array([3e-7, -1e-7, 0.0, -2e-7]), contributions=(noise,)
    ... )
    >>> print(f"{quarters.uncertainty[0]:.2e}, {quarters.difference(1, 0).uncertainty:.2e} rad")
    8.66e-08, 1.41e-07 rad
    """

    name: str
    """What is divided."""
    error: Array
    """Angle minus nominal angle of a face or a table, reading minus angle of a scale [rad], shape
    (n,).
    """
    contributions: tuple[ErrorSource, ...]
    """Contributions to the covariance of `error`."""
    orders: tuple[int, ...] = ()
    """Orders of `error`."""
    blind: tuple[int, ...] = ()
    """Orders to which the method is blind: they are missing from `error`."""

    @property
    def angle(self) -> Array:
        """Nominal angles [rad], from 0, shape (n,)."""
        return np.asarray(2.0 * np.pi * np.arange(self.error.size) / self.error.size)

    @property
    def covariance(self) -> Array:
        """Covariance of `error` [rad2], shape (n, n)."""
        return np.sum([c.covariance for c in self.contributions], axis=0)

    @property
    def uncertainty(self) -> Array:
        """Standard uncertainty of `error` [rad], shape (n,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def combination(self, weights: ArrayLike) -> Estimate:
        """Return a weighted sum of the errors.

        Parameters
        ----------
        weights : array_like
            Weights of the points [1], shape (n,).

        Returns
        -------
        Estimate
            The sum [rad], with a component of uncertainty for each contribution.
        """
        w = np.asarray(weights, dtype=np.float64)
        # few points of many have a weight
        used = np.flatnonzero(w)
        selected, v = np.ix_(used, used), w[used]
        parts = tuple(
            Component(
                name=c.source,
                uncertainty=math.sqrt(max(float(v @ c.covariance[selected] @ v), 0.0)),
                degrees_of_freedom=c.degrees_of_freedom,
                kind=c.kind,
            )
            for c in self.contributions
        )
        note = f"without the orders {listed(self.blind)}" if self.blind else ""
        return Estimate(value=float(w @ self.error), unit="rad", components=parts, note=note)

    def estimate(self, point: int) -> Estimate:
        """Return the error of one point, numbered from 0 [rad]."""
        return self.combination(np.arange(self.error.size) == point)

    def difference(self, point: int, other: int) -> Estimate:
        """Return the error of the angle from another point to a point, numbered from 0 [rad]."""
        numbers = np.arange(self.error.size)
        return self.combination((numbers == point) * 1.0 - (numbers == other))

    def harmonic(self, order: int) -> tuple[Estimate, Estimate, Estimate]:
        """Return the amplitudes of cosine and sine of one order, and their resultant [rad]."""
        size = self.error.size
        share = (1.0 if 2 * order == size else 2.0) / size
        c, s = share * np.cos(order * self.angle), share * np.sin(order * self.angle)
        direction = math.atan2(float(s @ self.error), float(c @ self.error))
        along = math.cos(direction) * c + math.sin(direction) * s
        return self.combination(c), self.combination(s), self.combination(along)


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
    noise_covariance: Array | None = None
    """Covariance of the cosines, then the sines, by noise [rad2], shape (2 orders, 2 orders); None
    if they are independent.
    """
    head_shifts: Array | None = None
    """Change of the cosines, then the sines, by the standard uncertainty of the angle of each head
    [rad], shape (heads, 2 orders).
    """
    blind_allowance: float = 0.0
    """Standard uncertainty for blind orders [rad]."""

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
        blind = f"without the orders {listed(self.blind)}" if self.blind else ""
        return Estimate.of(
            float(self.error_at(angle)),
            float(u),
            "rad",
            source="readings",
            degrees_of_freedom=self.degrees_of_freedom,
            note=blind,
        )

    def division(self, points: int, name: str = "scale") -> Division:
        r"""Return the errors at evenly spaced angles, with their covariance.

        .. math:: \mathrm{cov} = W (Q + H^T H) W^T + u_b^2 K

        with the waves W = (cos n s, sin n s), the covariance Q of the amplitudes by noise, their
        change H by the angles of the heads, and the allowance u_b for blind orders. The phases of
        these are unknown, and their variances equal: K is the mean of cos k(s - s') over them.

        Parameters
        ----------
        points : int
            Number of angles, more than twice the highest order.
        name : str
            Name of the division.

        Returns
        -------
        Division
            Errors [rad] and covariance [rad2].

        Validity
        --------
        As for the method of the table: errors of head angles that are small compared with the
        period of the errors.

        Raises
        ------
        ModelError
            There are too few points.
        """
        require_points(max((*self.orders, *self.blind), default=0), points)
        s = 2.0 * np.pi * np.arange(points) / points
        phase = np.multiply.outer(s, np.asarray(self.orders, dtype=np.float64))
        waves = np.hstack((np.cos(phase), np.sin(phase)))
        Q = self.noise_covariance
        noise = (
            (waves * np.tile(self.order_uncertainty**2, 2)) @ waves.T
            if Q is None
            else waves @ Q @ waves.T
        )
        stated = math.isinf(self.degrees_of_freedom)
        contributions = [
            ErrorSource(
                source="noise of the readings",
                covariance=noise,
                degrees_of_freedom=self.degrees_of_freedom,
                kind="B" if stated else "A",
            )
        ]
        if self.head_shifts is not None and self.head_shifts.size:
            moved = waves @ self.head_shifts.T
            contributions.append(
                ErrorSource(source="angles of the heads", covariance=moved @ moved.T)
            )
        if self.blind_allowance and self.blind:
            apart = np.subtract.outer(s, s)
            together = np.mean([np.cos(k * apart) for k in self.blind], axis=0)
            contributions.append(
                ErrorSource(source="blind orders", covariance=self.blind_allowance**2 * together)
            )
        return Division(
            name=name,
            error=self.error_at(s),
            contributions=tuple(contributions),
            orders=self.orders,
            blind=self.blind,
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
        notes = [f"errors of a scale by {self.method}, orders {listed(self.orders)}"]
        if self.blind:
            notes.append(f"the method is blind to orders {listed(self.blind)}: they are missing")
        return Record(
            channels=tuple(Channel(name=name, values=v, unit="rad") for name, v in columns),
            time=np.arange(self.angle.size, dtype=np.float64),
            source=self.method,
            notes=tuple(notes),
            over="point",
        )


def require_points(highest: int, points: int) -> None:
    """Refuse too few points of a turn for its highest order."""
    if points <= 2 * highest:
        raise ModelError(
            f"order {highest} needs more than {2 * highest} points, got {points}: give more "
            "points, or fewer orders"
        )


def listed(orders: tuple[int, ...]) -> str:
    """Return the text of orders, with ranges for consecutive ones: "1-3, 7"."""
    runs: list[list[int]] = []
    for n in sorted(orders):
        if runs and n == runs[-1][1] + 1:
            runs[-1][1] = n
        else:
            runs.append([n, n])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs)
