"""Where the scale is and how moves of the stage change it, learned from every measurement."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate

#: Rings and directions of the points that stand for a normal distribution in the plane.
_RINGS, _DIRECTIONS = 2400, 12


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveErrors:
    """What the axes of a stage may do beside what they are commanded."""

    hysteresis: tuple[float, float] = (0.0, 0.0)
    """Standard uncertainty of the move of each axis as a share of it [1]."""
    curvature: tuple[float, float] = (0.0, 0.0)
    """By how much the gain of each axis may change, as a share, for each metre of the way [1/m]."""
    resolution: tuple[float, float] = (0.0, 0.0)
    """Standard uncertainty of where each axis settles [m]."""

    def __post_init__(self) -> None:
        for name in ("hysteresis", "curvature", "resolution"):
            if not all(0.0 <= v < math.inf for v in getattr(self, name)):
                raise ModelError(
                    f"{name} of the axes must be 0 or more and finite, got {getattr(self, name)!r}"
                )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MoveModel:
    r"""Eccentricity e and matrix J of the moves, with their joint uncertainty.

    A move by :math:`\Delta u` makes the eccentricity :math:`e + J \Delta u`, which is linear in e
    and J together: both are the state of a Kalman filter (Kalman 1960, Journal of Basic Engineering
    82), which every measurement improves. What an axis does not do as commanded is its noise, and
    its gain wanders as it moves along a curve that is not straight.
    """

    state: Array
    """e_x, e_y [m], then J row by row [1], shape (6,)."""
    covariance: Array
    """Covariance of the state, shape (6, 6)."""
    moves: int = 0
    """Number of moves that it has learned from."""
    last: Array = field(default_factory=lambda: np.zeros(2))
    """The last of them, in commands [m], shape (2,)."""

    def __post_init__(self) -> None:
        if self.state.shape != (6,) or self.covariance.shape != (6, 6):
            raise ModelError(
                "a model of moves has 6 numbers and their covariance, got shapes "
                f"{self.state.shape} and {self.covariance.shape}"
            )

    @property
    def eccentricity(self) -> Array:
        """The eccentricity, x and y [m], shape (2,)."""
        return self.state[:2].copy()

    @property
    def eccentricity_covariance(self) -> Array:
        """Its covariance [m^2], shape (2, 2)."""
        return self.covariance[:2, :2].copy()

    @property
    def matrix(self) -> Array:
        """How the scale moves for a command of each axis [1], shape (2, 2), axes by column."""
        return self.state[2:].reshape(2, 2).copy()

    @property
    def mirrored(self) -> bool:
        """Whether the axes of the stage count the other way round than those of the table."""
        return bool(np.linalg.det(self.matrix) < 0.0)

    @property
    def gains(self) -> tuple[Estimate, Estimate]:
        """Motion of the scale over the command, of each axis [1]."""
        return self._column(0)[0], self._column(1)[0]

    @property
    def directions(self) -> tuple[Estimate, Estimate]:
        """Direction in which each axis moves the scale, from x towards y [rad]."""
        return self._column(0)[1], self._column(1)[1]

    def _column(self, axis: int) -> tuple[Estimate, Estimate]:
        at = [2 + axis, 4 + axis]
        v, cov = self.state[at], self.covariance[np.ix_(at, at)]
        size = math.hypot(v[0], v[1])
        if size == 0.0:
            raise ModelError("nothing is known of this axis yet: make a trial move with it")
        along = v / size
        across = np.array([-along[1], along[0]])
        return (
            _plain(size, math.sqrt(along @ cov @ along), "1"),
            _plain(math.atan2(v[1], v[0]), math.sqrt(across @ cov @ across) / size, "rad"),
        )

    def measured(self, vector: ArrayLike, covariance: ArrayLike) -> "MoveModel":
        """Return what is known after a measurement [m], each weighed by its uncertainty."""
        select = np.eye(2, 6)
        return self._learned(select, np.asarray(vector, dtype=np.float64), np.asarray(covariance))

    def moved(self, by: ArrayLike, errors: MoveErrors = MoveErrors()) -> "MoveModel":
        r"""Return what is known after the commands changed `by` so much [m], before a measurement.

        .. math:: J \leftarrow J + \delta J, \quad e \leftarrow e + J (\Delta u + w)

        J belongs to the middle of the last move, and changes up to the middle of the new one.
        """
        du = np.asarray(by, dtype=np.float64)
        J = self.matrix
        cov = self.covariance.copy()
        for axis, curvature in enumerate(errors.curvature):
            # the gain of an axis changes by one factor, in whatever direction it moves the scale
            way = np.zeros(6)
            way[[2 + axis, 4 + axis]] = J[:, axis]
            change = curvature * 0.5 * abs(self.last[axis] + du[axis])
            cov += change**2 * np.outer(way, way)
        step = np.eye(6)
        step[:2, 2:] = np.kron(np.eye(2), du[np.newaxis])
        cov = step @ cov @ step.T
        share, least = np.asarray(errors.hysteresis), np.asarray(errors.resolution)
        cov[:2, :2] += J @ np.diag((share * du) ** 2 + least**2) @ J.T
        # an axis that has not moved keeps the gain of its last move, and where that was
        last = np.where(du == 0.0, self.last, du)
        return MoveModel(state=step @ self.state, covariance=cov, moves=self.moves + 1, last=last)

    def square(
        self, *, mirrored: bool = False, gain_ratio: float = 1.0, uncertainty: float = 0.05
    ) -> "MoveModel":
        """Return what is known if the y axis is taken as square to the x axis.

        It is mirrored where its axes count the other way round than those of the table;
        `gain_ratio` is the gain of the y axis over that of the x axis, and `uncertainty` the
        standard one of squareness [rad] and of that ratio.

        It spares the trial move in y.
        """
        if not (gain_ratio > 0.0 and uncertainty > 0.0):
            raise ModelError("ratio of gains and uncertainty of squareness must be positive")
        g = -gain_ratio if mirrored else gain_ratio
        # J_y - g turned(J_x) = 0, in both parts
        row = np.zeros((2, 6))
        row[0, [3, 4]] = 1.0, g
        row[1, [5, 2]] = 1.0, -g
        length = math.hypot(*self.matrix[:, 0])
        return self._learned(row, np.zeros(2), (uncertainty * g * length) ** 2 * np.eye(2))

    def _learned(self, row: Array, value: Array, noise: Array) -> "MoveModel":
        P = self.covariance
        gain = np.linalg.solve(row @ P @ row.T + noise, row @ P).T
        rest = np.eye(6) - gain @ row
        # Joseph's form, which stays symmetric and positive
        cov = rest @ P @ rest.T + gain @ noise @ gain.T
        return replace(self, state=self.state + gain @ (value - row @ self.state), covariance=cov)


def unknown_moves(
    vector: ArrayLike,
    covariance: ArrayLike,
    *,
    matrix: ArrayLike | None = None,
    matrix_uncertainty: float = 2.0,
) -> MoveModel:
    """Return the model after the first measurement, before any move.

    `vector` is the measured eccentricity [m]; `matrix` how the scale is thought to move for a
    command of each axis [1], each element with the standard uncertainty `matrix_uncertainty`.
    Nothing is assumed where it is not given.

    Examples
    --------
    >>> model = unknown_moves((30e-6, -20e-6), 1e-16 * np.eye(2))
    >>> model = model.moved((10e-6, 0.0)).measured((39e-6, -17e-6), 1e-16 * np.eye(2)).square()
    >>> print(f"{model.gains[0].value:.3f} at {np.degrees(model.directions[0].value):.2f} deg")
    0.949 at 18.43 deg
    """
    e, cov = np.asarray(vector, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    J = np.zeros((2, 2)) if matrix is None else np.asarray(matrix, dtype=np.float64)
    if e.shape != (2,) or cov.shape != (2, 2) or J.shape != (2, 2):
        raise ModelError(
            f"an eccentricity has two parts, its covariance and the matrix four, got shapes "
            f"{e.shape}, {cov.shape} and {J.shape}"
        )
    if not 0.0 < matrix_uncertainty < math.inf:
        raise ModelError(f"the uncertainty of the matrix must be positive: {matrix_uncertainty!r}")
    whole = np.zeros((6, 6))
    whole[:2, :2] = cov
    whole[2:, 2:] = matrix_uncertainty**2 * np.eye(4)
    return MoveModel(state=np.concatenate((e, J.ravel())), covariance=whole)


def length_prediction(vector: ArrayLike, covariance: ArrayLike, *, note: str = "") -> Estimate:
    """Return the length of an expected vector [m], with the ends between which 95 % of cases lie.

    Its value is the mean length, which is more than the length of the mean (Rice 1945, Bell System
    Technical Journal 24, for equal uncertainty in all directions; Rayleigh's distribution about 0).

    Validity
    --------
    A normal distribution, taken at 28 800 points of equal weight: ends within 0.5 %.

    Examples
    --------
    >>> length = length_prediction((0.0, 0.0), 1e-16 * np.eye(2))
    >>> print(f"{1e9 * length.value:.1f} nm, at most {1e9 * length.interval()[1]:.0f} nm")
    12.5 nm, at most 27 nm
    """
    v, cov = np.asarray(vector, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    size, axes = np.linalg.eigh(0.5 * (cov + cov.T))
    p = (np.arange(_RINGS) + 0.5) / _RINGS
    ring = np.sqrt(-2.0 * np.log1p(-p))
    # neighbouring rings are turned by the golden angle, so that no direction is preferred
    turn = np.pi * (3.0 - math.sqrt(5.0)) * np.arange(_RINGS)
    angle = np.add.outer(turn, 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS)
    both = ring[:, np.newaxis] * np.stack((np.cos(angle), np.sin(angle)))
    points = both.reshape(2, -1)
    cloud = v[:, np.newaxis] + axes @ (np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * points)
    length = np.hypot(cloud[0], cloud[1])
    low, high = (float(end) for end in np.quantile(length, (0.025, 0.975)))
    part = Component(name="prediction", uncertainty=float(length.std()))
    return Estimate(
        value=float(length.mean()), unit="m", components=(part,), bounds=(low, high), note=note
    )


def _plain(value: float, uncertainty: float, unit: str) -> Estimate:
    part = Component(name="moves", uncertainty=uncertainty)
    return Estimate(value=value, unit=unit, components=(part,))
