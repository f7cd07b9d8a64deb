"""What moves the scale, and the move that centres it, by a model learned from measurements."""

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
    """Its name."""
    half: float
    """Half of its stroke, the largest command to either side [m]."""
    quantum: float = 0.0
    """Step of its commands [m]; 0 for none."""
    resolution: float = 0.0
    """Standard uncertainty with which it takes a command that can be set [m]."""
    hysteresis: float = 0.0
    """Standard uncertainty of a move as a share of its length [1]."""
    backlash: float = 0.0
    """Play on turning back, at the scale [m]."""

    def settable(self, command: float) -> float:
        """Return the nearest command within the stroke that can be set [m]."""
        inside = min(max(command, -self.half), self.half)
        if self.quantum == 0.0:
            return inside
        steps = round(inside / self.quantum)
        # the last step before the end, where the end itself is none
        most = math.floor(self.half / self.quantum * (1.0 + 1e-12))
        return min(max(steps, -most), most) * self.quantum


class Positioner(ABC):
    """Two axes that carry the scale, as the one who centres it sees them.

    Where the scale really goes is not known to it: the axes may be turned on the table by any
    angle, count the other way, differ in gain and not be square.
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
        """The last command, as it was set [m]."""
        return self._position

    @property
    def resolution(self) -> tuple[float, float]:
        """Standard uncertainty with which an axis takes a command, for short moves [m]."""
        return self._x.resolution, self._y.resolution

    @property
    def hysteresis(self) -> tuple[float, float]:
        """Standard uncertainty of a move as a share of its length, of each axis [1]."""
        return self._x.hysteresis, self._y.hysteresis

    @property
    def backlash(self) -> tuple[float, float]:
        """Play of each axis on turning back, at the scale [m]."""
        return self._x.backlash, self._y.backlash

    def settable(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest commands within the limits that can be set [m]."""
        return self._x.settable(x), self._y.settable(y)

    def move_to(self, x: float, y: float) -> tuple[float, float]:
        """Move both axes to commands [m]; return what was set."""
        self._position = self.settable(x, y)
        self._go(self._position)
        return self._position

    @abstractmethod
    def _go(self, command: tuple[float, float]) -> None:
        """Move both axes to commands that can be set [m]."""


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
    >>> print(model.matrix.round(3).tolist())
    [[0.9, -0.3], [0.3, 0.9]]
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
    mean, spread = float(length.mean()), float(length.std())
    return Estimate.of(mean, spread, "m", source="prediction", bounds=(low, high), note=note)


Approach = Literal["direct", "from below"]

#: Change of the gain over a whole stroke, over the hysteresis of a move. A branch of a loop is bent
#: by about as much as the slopes of its two branches differ.
_BEND = 4.0
#: What going down leaves of the memory: part of a stack's forgets by degrees. Share of the stroke,
#: over the hysteresis of a move.
_LEFT_OVER = 4e-4


def move_errors(positioner: Positioner, approach: Approach) -> MoveErrors:
    """Return what the axes of a stage may do beside what they are commanded.

    From below, each command is approached from the lower end of the stroke, where the memory of a
    piezo stack is wiped out and backlash is on one side. The branch that it rises on is then always
    the same one: it is bent, but has no hysteresis.
    """
    if approach not in ("direct", "from below"):
        raise ModelError(f"the approach is 'direct' or 'from below', got '{approach}'")
    x, y = (
        _BEND * share / (high - low)
        for share, (low, high) in zip(positioner.hysteresis, positioner.limits, strict=True)
    )
    if approach == "from below":
        first, second = (
            math.hypot(settling, _LEFT_OVER * share * (high - low))
            for settling, share, (low, high) in zip(
                positioner.resolution, positioner.hysteresis, positioner.limits, strict=True
            )
        )
        return MoveErrors(curvature=(x, y), resolution=(first, second))
    # whether a move meets the play depends on the last one: none or all of it
    a, b = (
        math.hypot(settling, 0.5 * play)
        for settling, play in zip(positioner.resolution, positioner.backlash, strict=True)
    )
    return MoveErrors(hysteresis=positioner.hysteresis, curvature=(x, y), resolution=(a, b))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedMove:
    """A move that is to bring the scale nearer to the axis."""

    command: tuple[float, float]
    """Commands of both axes after it, as they can be set [m]."""
    by: Array
    """Change of the commands [m], shape (2,)."""
    expected: Array
    """Eccentricity that is expected after it, x and y [m], shape (2,)."""
    covariance: Array
    """Its covariance [m^2], shape (2, 2)."""
    remaining: Estimate
    """Length of that eccentricity, from resolution, hysteresis and what is not known of
    eccentricity and matrix.
    """
    within_limits: bool
    """Whether the limits of the stage let it reach the centre."""
    shortfall: float
    """By how much the limits keep the scale from the centre [m]; 0 within them."""


def planned_move(
    model: MoveModel, positioner: Positioner, *, approach: Approach = "direct"
) -> PlannedMove:
    """Return the move that centres the scale, or brings it as near as the limits let it.

    It is not carried out.

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
            "how the scale moves is not known in both directions: make a trial move with each axis"
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
    """Return the point u of a box for which :math:`|J u - target|` is least.

    Examples
    --------
    >>> nearest_in_box(np.eye(2), np.array([3.0, 0.2]), -np.ones(2), np.ones(2))
    array([1. , 0.2])
    """
    free: Array = np.asarray(np.linalg.solve(matrix, target), dtype=np.float64)
    if np.all((low <= free) & (free <= high)):
        return free
    # outside, the nearest point is on an edge: there the other part has a least of its own
    candidates = []
    for fixed in (0, 1):
        other = 1 - fixed
        along = matrix[:, other]
        for end in (low[fixed], high[fixed]):
            rest = target - matrix[:, fixed] * end
            u = np.empty(2)
            u[fixed] = end
            u[other] = np.clip(along @ rest / (along @ along), low[other], high[other])
            candidates.append(u)
    return min(candidates, key=lambda u: float(np.hypot(*(matrix @ u - target))))
