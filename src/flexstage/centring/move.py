"""Stage that moves the scale, and the centring move, by a model learned from measurements."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Estimate


@dataclass(kw_only=True)
class PositionerAxis:
    """One of the two axes, commanded in metres from the middle of its stroke."""

    name: str
    """Name of the axis."""
    half: float
    """Half of the stroke, the largest command to either side [m]."""
    quantum: float = 0.0
    """Step of the commands [m]; 0 for none."""
    resolution: float = 0.0
    """Standard uncertainty of the position after a settable command [m]."""
    hysteresis: float = 0.0
    """Standard uncertainty of a move as a share of its length [1]."""
    backlash: float = 0.0
    """Backlash on reversal, at the scale [m]."""

    def settable(self, command: float) -> float:
        """Return the nearest settable command within the stroke [m]."""
        inside = min(max(command, -self.half), self.half)
        if self.quantum == 0.0:
            return inside
        steps = round(inside / self.quantum)
        # the last step before the end, if the end is not a step
        most = math.floor(self.half / self.quantum * (1.0 + 1e-12))
        return min(max(steps, -most), most) * self.quantum


class Positioner(ABC):
    """Two axes that carry the scale, as the centring procedure uses them.

    The true motion of the scale is unknown: the axes may have any angle on the table, the opposite
    handedness, unequal gains and a squareness error.
    """

    def __init__(self, axes: Sequence[PositionerAxis]) -> None:
        self._x, self._y = axes
        self._position = (0.0, 0.0)

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest command of each axis [m]."""
        return (-self._x.half, self._x.half), (-self._y.half, self._y.half)

    @property
    def position(self) -> tuple[float, float]:
        """The last command, rounded to settable values [m]."""
        return self._position

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty of the position of each axis after short moves [m]."""
        return self._x.resolution, self._y.resolution

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length, of each axis [1]."""
        return self._x.hysteresis, self._y.hysteresis

    @property
    def backlash(self) -> tuple[float, float]:
        """Backlash of each axis, at the scale [m]."""
        return self._x.backlash, self._y.backlash

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest settable commands within the limits [m]."""
        return self._x.settable(x), self._y.settable(y)

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes to commands [m]; return the rounded commands."""
        self._position = self.settable(x, y)
        self._go(self._position)
        return self._position

    @abstractmethod
    def _go(self, command: tuple[float, float]) -> None:
        """Move both axes to settable commands [m]."""


#: Rings and directions of the points that represent a normal distribution in the plane.
_RINGS, _DIRECTIONS = 2400, 12


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveErrors:
    """Errors of the moves of a stage."""

    hysteresis: tuple[float, float] = (0.0, 0.0)
    """Standard uncertainty of the move of each axis as a share of it [1]."""
    curvature: tuple[float, float] = (0.0, 0.0)
    """Relative change of the gain of each axis per metre of travel [1/m]."""
    resolution: tuple[float, float] = (0.0, 0.0)
    """Standard uncertainty of the settled position of each axis [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MoveModel:
    r"""Eccentricity e and matrix J of the moves, with their joint uncertainty.

    A move by :math:`\Delta u` makes the eccentricity :math:`e + J \Delta u`, which is linear in e
    and J together: both are the state of a Kalman filter (Kalman 1960, Journal of Basic Engineering
    82), which every measurement improves. Errors of the moves are its noise, and the gains change
    along a curved characteristic.
    """

    state: Array
    """e_x, e_y [m], then J row by row [1], shape (6,)."""
    covariance: Array
    """Covariance of the state, shape (6, 6)."""
    moves: int = 0
    """Number of moves in the model."""
    last: Array = field(default_factory=lambda: np.zeros(2))
    """The last move, in commands [m], shape (2,)."""

    @property
    def eccentricity(self) -> Array:
        """The eccentricity, x and y [m], shape (2,)."""
        return self.state[:2].copy()

    @property
    def eccentricity_covariance(self) -> Array:
        """Covariance of the eccentricity [m^2], shape (2, 2)."""
        return self.covariance[:2, :2].copy()

    @property
    def matrix(self) -> Array:
        """Motion of the scale per command of each axis [1], shape (2, 2), axes by column."""
        return self.state[2:].reshape(2, 2).copy()

    def measured(self, vector: ArrayLike, covariance: ArrayLike) -> "MoveModel":
        """Return the model after a measurement [m], each weighted by its uncertainty."""
        select = np.eye(2, 6)
        return self._updated(select, np.asarray(vector, dtype=np.float64), np.asarray(covariance))

    def moved(self, by: ArrayLike, errors: MoveErrors = MoveErrors()) -> "MoveModel":
        r"""Return the model after a move `by` a change of commands [m], before a measurement.

        .. math:: J \leftarrow J + \delta J, \quad e \leftarrow e + J (\Delta u + w)

        J belongs to the middle of the last move, and changes up to the middle of the new one.
        """
        du = np.asarray(by, dtype=np.float64)
        J = self.matrix
        cov = self.covariance.copy()
        for axis, curvature in enumerate(errors.curvature):
            # the gain of an axis changes by one factor for both components
            way = np.zeros(6)
            way[[2 + axis, 4 + axis]] = J[:, axis]
            change = curvature * 0.5 * abs(self.last[axis] + du[axis])
            cov += change**2 * np.outer(way, way)
        step = np.eye(6)
        step[:2, 2:] = np.kron(np.eye(2), du[np.newaxis])
        cov = step @ cov @ step.T
        share, least = np.asarray(errors.hysteresis), np.asarray(errors.resolution)
        cov[:2, :2] += J @ np.diag((share * du) ** 2 + least**2) @ J.T
        # an axis that has not moved keeps the gain and the place of its last move
        last = np.where(du == 0.0, self.last, du)
        return MoveModel(state=step @ self.state, covariance=cov, moves=self.moves + 1, last=last)

    def square(
        self, *, mirrored: bool = False, gain_ratio: float = 1.0, uncertainty: float = 0.05
    ) -> "MoveModel":
        """Return the model with the y axis taken as square to the x axis.

        The axes are `mirrored` if their handedness is opposite to that of the table; `gain_ratio`
        is the gain of the y axis over that of the x axis, and `uncertainty` the standard
        uncertainty of squareness [rad] and of that ratio.

        This saves the trial move in y.
        """
        if not (gain_ratio > 0.0 and uncertainty > 0.0):
            raise ModelError("ratio of gains and uncertainty of squareness must be positive")
        g = -gain_ratio if mirrored else gain_ratio
        # J_y - g turned(J_x) = 0, in both parts
        row = np.zeros((2, 6))
        row[0, [3, 4]] = 1.0, g
        row[1, [5, 2]] = 1.0, -g
        length = math.hypot(*self.matrix[:, 0])
        return self._updated(row, np.zeros(2), (uncertainty * g * length) ** 2 * np.eye(2))

    def _updated(self, row: Array, value: Array, noise: Array) -> "MoveModel":
        P = self.covariance
        gain = np.linalg.solve(row @ P @ row.T + noise, row @ P).T
        remainder = np.eye(6) - gain @ row
        # Joseph's form, which stays symmetric and positive
        cov = remainder @ P @ remainder.T + gain @ noise @ gain.T
        return replace(self, state=self.state + gain @ (value - row @ self.state), covariance=cov)


def unknown_moves(
    vector: ArrayLike,
    covariance: ArrayLike,
    *,
    matrix: ArrayLike | None = None,
    matrix_uncertainty: float = 2.0,
) -> MoveModel:
    """Return the model after the first measurement, before any move.

    `vector` is the measured eccentricity [m]; `matrix` the assumed motion of the scale per command
    of each axis [1], each element with the standard uncertainty `matrix_uncertainty`. Without it
    nothing is assumed.

    Examples
    --------
    >>> model = unknown_moves((30e-6, -20e-6), 1e-16 * np.eye(2))
    >>> model = model.moved((10e-6, 0.0)).measured((39e-6, -17e-6), 1e-16 * np.eye(2)).square()
    >>> print(model.matrix.round(3).tolist())
    [[0.9, -0.3], [0.3, 0.9]]
    """
    e, cov = np.asarray(vector, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    J = np.zeros((2, 2)) if matrix is None else np.asarray(matrix, dtype=np.float64)
    if e.shape != (2,) or cov.shape != (2, 2) or J.shape != (2, 2):
        raise ModelError(
            "an eccentricity needs two components, its covariance and the matrix 2 x 2, got shapes "
            f"{e.shape}, {cov.shape} and {J.shape}"
        )
    if not 0.0 < matrix_uncertainty < math.inf:
        raise ModelError(f"the uncertainty of the matrix must be positive: {matrix_uncertainty!r}")
    joint = np.zeros((6, 6))
    joint[:2, :2] = cov
    joint[2:, 2:] = matrix_uncertainty**2 * np.eye(4)
    return MoveModel(state=np.concatenate((e, J.ravel())), covariance=joint)


def length_prediction(vector: ArrayLike, covariance: ArrayLike, *, note: str = "") -> Estimate:
    """Return the length of an expected vector [m], with its 95 % prediction interval.

    The value is the mean length, which exceeds the length of the mean (Rice 1945, Bell System
    Technical Journal 24, for equal uncertainty in all directions; Rayleigh's distribution about 0).

    Validity
    --------
    A normal distribution, sampled at 28 800 points of equal weight: ends within 0.5 %.

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
    mean, spread = float(length.mean()), float(length.std())
    return Estimate.of(mean, spread, "m", source="prediction", bounds=(low, high), note=note)


Approach = Literal["direct", "from below"]

#: Change of the gain over the full stroke, over the hysteresis of a move. The curvature of a branch
#: is about the difference of the slopes of the two branches.
_BEND = 4.0
#: Remaining memory of a stack at the lower end, as it decays gradually. Share of the stroke, over
#: the hysteresis of a move.
_REMANENCE = 4e-4


def move_errors(positioner: Positioner, approach: Approach) -> MoveErrors:
    """Return the errors of the moves of a stage.

    From below, each command is approached from the lower end of the stroke, where the memory of a
    piezo stack is erased and backlash is on one side. The rising branch is then always the same:
    it is curved, but has no hysteresis.
    """
    if approach not in ("direct", "from below"):
        raise ModelError(f"the approach must be 'direct' or 'from below', got '{approach}'")
    x, y = (
        _BEND * share / (high - low)
        for share, (low, high) in zip(positioner.hysteresis, positioner.limits, strict=True)
    )
    if approach == "from below":
        first, second = (
            math.hypot(settling, _REMANENCE * share * (high - low))
            for settling, share, (low, high) in zip(
                positioner.resolution, positioner.hysteresis, positioner.limits, strict=True
            )
        )
        return MoveErrors(curvature=(x, y), resolution=(first, second))
    # the effect of backlash depends on the last move: none or all of it
    a, b = (
        math.hypot(settling, 0.5 * play)
        for settling, play in zip(positioner.resolution, positioner.backlash, strict=True)
    )
    return MoveErrors(hysteresis=positioner.hysteresis, curvature=(x, y), resolution=(a, b))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedMove:
    """Planned move towards the centre."""

    command: tuple[float, float]
    """Settable commands of both axes after it [m]."""
    by: Array
    """Change of the commands [m], shape (2,)."""
    expected: Array
    """Expected eccentricity after it, x and y [m], shape (2,)."""
    covariance: Array
    """Covariance of the expected eccentricity [m^2], shape (2, 2)."""
    remaining: Estimate
    """Length of that eccentricity, with resolution, hysteresis and the uncertainty of eccentricity
    and matrix.
    """
    within_limits: bool
    """Whether the centre is within the limits of the stage."""
    shortfall: float
    """Distance of the scale from the centre at the limits [m]; 0 within them."""


def planned_move(
    model: MoveModel, positioner: Positioner, *, approach: Approach = "direct"
) -> PlannedMove:
    """Return the move that centres the scale, or brings it as near as the limits permit.

    This function moves nothing.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.centring.move import unknown_moves
    >>> from flexstage.virtual import VirtualPositioner
    >>> stage = VirtualPositioner(design("vgtu-mechanical"))
    >>> model = unknown_moves(
    ...     (-30e-6, 9e-6), 1e-16 * np.eye(2), matrix=np.eye(2), matrix_uncertainty=0.01
    ... )
    >>> move = planned_move(model, stage)
    >>> print(f"{1e6 * move.by[0]:.2f} um, {1e6 * move.by[1]:.2f} um")
    29.97 um, -9.01 um
    """
    J = model.matrix
    size = np.linalg.norm(J, ord=2)
    if not size > 0.0 or np.linalg.cond(J) > 1e3:
        raise ModelError(
            "the motion of the scale is not known in both directions: make trial moves of both axes"
        )
    now = np.asarray(positioner.position)
    low, high = np.asarray(positioner.limits).T
    best = nearest_in_box(J, J @ now - model.eccentricity, low, high)
    left = model.eccentricity + J @ (best - now)
    shortfall = float(np.hypot(*left))
    reached = shortfall <= 1e-9 * float(np.hypot(*model.eccentricity)) + 1e-15
    command = positioner.settable(float(best[0]), float(best[1]))
    by = np.asarray(command) - now
    after = model.moved(by, move_errors(positioner, approach))
    note = "" if reached else "as near as the limits of the stage allow"
    return PlannedMove(
        command=command,
        by=by,
        expected=after.eccentricity,
        covariance=after.eccentricity_covariance,
        remaining=length_prediction(after.eccentricity, after.eccentricity_covariance, note=note),
        within_limits=reached,
        shortfall=0.0 if reached else shortfall,
    )


def nearest_in_box(matrix: Array, target: Array, low: Array, high: Array) -> Array:
    """Return the point u of a box with the least :math:`|J u - target|`.

    Examples
    --------
    >>> nearest_in_box(np.eye(2), np.array([3.0, 0.2]), -np.ones(2), np.ones(2))
    array([1. , 0.2])
    """
    free: Array = np.asarray(np.linalg.solve(matrix, target), dtype=np.float64)
    if np.all((low <= free) & (free <= high)):
        return free
    # outside, the nearest point is on an edge, at the minimum over the other component
    candidates = []
    for fixed in (0, 1):
        other = 1 - fixed
        along = matrix[:, other]
        for end in (low[fixed], high[fixed]):
            distance = target - matrix[:, fixed] * end
            u = np.empty(2)
            u[fixed] = end
            u[other] = np.clip(along @ distance / (along @ along), low[other], high[other])
            candidates.append(u)
    return min(candidates, key=lambda u: float(np.hypot(*(matrix @ u - target))))
