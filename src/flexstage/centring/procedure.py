"""The centring procedure: measure, make trial moves, centre, and measure again."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.centring.calibration_moves import calibration_length, calibration_position
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.eccentricity import Eccentricity
from flexstage.centring.geometry import require_radius
from flexstage.centring.harmonic_fit import length_estimate
from flexstage.centring.move import (
    Approach,
    MoveModel,
    PlannedMove,
    Positioner,
    move_errors,
    planned_move,
    unknown_moves,
)
from flexstage.quantities.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentreReading:
    """A measured eccentricity."""

    vector: Array
    """Centre of the scale, x and y in the frame that turns with the table [m], shape (2,)."""
    covariance: Array
    """Its covariance [m^2], shape (2, 2)."""
    degrees_of_freedom: float = math.inf
    """Degrees of freedom of the covariance."""

    @property
    def length(self) -> Estimate:
        """The eccentricity [m]."""
        return length_estimate(
            self.vector, self.covariance, "m", degrees_of_freedom=self.degrees_of_freedom
        )

    def covers(self, vector: ArrayLike) -> bool:
        """Return whether the 95 % region of the centre contains a point, x and y [m].

        It is the ellipse of Hotelling (1931, Annals of Mathematical Statistics 2), of known shape.
        """
        from scipy.special import chdtri, fdtri

        off = np.asarray(vector, dtype=np.float64) - self.vector
        dof = self.degrees_of_freedom
        far = chdtri(2.0, 0.05) if math.isinf(dof) else 2.0 * fdtri(2.0, dof, 0.95)
        return bool(off @ np.linalg.solve(self.covariance, off) <= far)


def centre_reading(centre: Eccentricity) -> CentreReading:
    """Return an eccentricity from heads or indicators as a reading of the procedure.

    Examples
    --------
    >>> from flexstage.centring import HeadReadings, eccentricity
    >>> t = 2.0 * np.pi * np.arange(90) / 90
    >>> read = HeadReadings(angle=t, error=1e-3 * np.sin(t - 0.3))
    >>> reading = centre_reading(eccentricity(read, radius=50e-3))
    >>> print(f"{1e6 * reading.vector[0]:.3f} um, {1e6 * reading.vector[1]:.3f} um")
    47.767 um, 14.776 um
    """
    return CentreReading(
        vector=centre.vector,
        covariance=centre.covariance,
        degrees_of_freedom=min(centre.x.degrees_of_freedom, centre.y.degrees_of_freedom),
    )


def table_reading(table: CalibrationTable, radius: float) -> CentreReading:
    r"""Return the eccentricity that causes the first order of an error table.

    `radius` is that at which the scale is read [m].

    .. math:: e_x = R\, b_1, \quad e_y = -R\, a_1

    Validity
    --------
    It includes the scale's own graduation error of order 1: no number of heads, and no move,
    separates the two, since a move shows only a difference. Their sum makes the readings wrong, and
    a move removes it. If the position of the rim matters and not the reading, use indicators on it.
    For uneven sampling, each direction has the mean uncertainty of both.

    Examples
    --------
    >>> from flexstage.centring import ScaleReadings, against_reference
    >>> t = 2.0 * np.pi * np.arange(90) / 90
    >>> read = 1e-3 * np.sin(t - 0.3)
    >>> readings = ScaleReadings(angle=t, errors=read, heads=np.zeros(1), noise=5e-6)
    >>> reading = table_reading(against_reference(readings, range(1, 5)), 50e-3)
    >>> print(f"{1e6 * reading.length.value:.2f} um, {1e6 * reading.length.uncertainty:.3f} um")
    50.00 um, 0.037 um
    """
    require_radius(radius)
    a, b = table.harmonic(1)
    u = float(table.order_uncertainty[table.orders.index(1)])
    return CentreReading(
        vector=radius * np.array([b, -a]),
        covariance=(radius * u) ** 2 * np.eye(2),
        degrees_of_freedom=table.degrees_of_freedom,
    )


_AXES = ("x", "y")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringStep:
    """One measurement of the eccentricity, and the action before it."""

    kind: Literal["start", "trial", "move"]
    """The action."""
    command: tuple[float, float]
    """Commands of the axes [m]."""
    reading: CentreReading
    """The measurement after it."""
    predicted: Estimate | None = None
    """Predicted remaining eccentricity [m]; None before the moves are calibrated."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centring:
    """Result of the centring procedure."""

    steps: tuple[CentringStep, ...]
    """Every measurement, in order."""
    model: MoveModel
    """Calibration of the moves."""
    target: float
    """Target eccentricity [m]."""
    reached: bool
    """Whether the upper end of the 95 % interval of the last measurement is below the target."""
    reason: str
    """Reason for the end of the procedure."""

    @property
    def reading(self) -> CentreReading:
        """The last measurement."""
        return self.steps[-1].reading

    @property
    def eccentricity(self) -> Estimate:
        """Eccentricity of the last measurement [m]."""
        return self.reading.length

    @property
    def predicted(self) -> Estimate | None:
        """Predicted eccentricity after the last move [m]; None if there was none."""
        return self.steps[-1].predicted

    @property
    def trials(self) -> int:
        """Number of trial moves."""
        return sum(step.kind == "trial" for step in self.steps)

    @property
    def moves(self) -> int:
        """Number of moves towards the centre, without the trial moves."""
        return sum(step.kind == "move" for step in self.steps)


def centre(
    measure: Callable[[], CentreReading],
    positioner: Positioner,
    *,
    target: float = 0.1e-6,
    moves: int = 3,
    trials: int = 2,
    mirrored: bool = False,
    matrix: ArrayLike | None = None,
    matrix_uncertainty: float = 2.0,
    approach: Approach = "from below",
) -> Centring:
    r"""Centre the scale: measure, make a trial move of each axis, then centre in a few moves.

    A trial move shows the direction of an axis on the table, its sign and its gain; every further
    move improves them. The procedure ends when measurement and prediction of the last move reach
    the target with 95 % confidence; when limits, resolution or uncertainty permit no improvement;
    or after the largest number of moves.

    Parameters
    ----------
    measure : callable
        Turns the table and returns the eccentricity of the scale.
    positioner : Positioner
        Stage that moves the scale.
    target : float
        Target eccentricity [m].
    moves : int
        Largest number of moves towards the centre, not counting trial moves.
    trials : int
        Trial moves: 2, one of each axis; 1, of the first axis, with the other one taken as square
        and of equal gain; 0 if the matrix is known.
    mirrored : bool
        Whether the axes have the opposite handedness of those of the table; for one trial move.
    matrix : array_like, optional
        Assumed motion of the scale per command of each axis [1], shape (2, 2).
    matrix_uncertainty : float
        Standard uncertainty of each of its elements [1].
    approach : {"direct", "from below"}
        Approach of each command: from the lower end of both axes, which eliminates hysteresis and
        backlash, or directly.

    Returns
    -------
    Centring
        All steps, and the remaining eccentricity.

    Validity
    --------
    The procedure cancels the sum of the eccentricity and the scale's own errors of order 1. Trial
    moves calibrate the motion of the stage, and do not separate the two. With one head, once-per-
    turn motion of the axis is included too.

    Raises
    ------
    ModelError
        A figure is impossible, or there is no room for a trial move.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.virtual import (
    ...     TableMounting, VirtualBench, VirtualPositioner, VirtualTable,
    ... )
    >>> mounting = TableMounting(angle=0.7, mirrored=True)
    >>> stage = VirtualPositioner(design("vgtu-piezo"), start=(-1.0, -1.0), mounting=mounting)
    >>> x, y = -50e-6 * np.array([np.cos(0.2), np.sin(0.2)]) - stage.true_position
    >>> table = VirtualTable(
    ...     radius=50e-3, heads=(0.0, 1.6, 3.1, 4.8), eccentricity=(x, y), noise=4.8e-6
    ... )
    >>> result = centre(VirtualBench(table, stage).measure, stage)
    >>> print(result.reached, result.moves, f"{1e6 * result.steps[0].reading.length.value:.1f} um")
    True 3 50.0 um
    """
    _check(target, moves, trials, matrix)
    errors = move_errors(positioner, approach)
    # the start is on the same branch as all later moves
    _go(positioner, positioner.position, approach)
    first = measure()
    steps = [CentringStep(kind="start", command=positioner.position, reading=first)]
    model = unknown_moves(
        first.vector, first.covariance, matrix=matrix, matrix_uncertainty=matrix_uncertainty
    )
    if _meets(first, target):
        return _result(steps, model, target, "the scale was centred at the start")
    for axis in range(trials):
        command = _trial(positioner, axis, first)
        by = _go(positioner, command, approach)
        model, step = _measured(measure, positioner, model.moved(by, errors), "trial", None)
        steps.append(step)
        if trials == 1:
            model = model.square(mirrored=mirrored)
    for _ in range(moves):
        plan = planned_move(model, positioner, approach=approach)
        if not _improves(plan, steps[-1].reading):
            break
        by = _go(positioner, plan.command, approach)
        expected = model.moved(by, errors)
        model, step = _measured(measure, positioner, expected, "move", plan.remaining)
        steps.append(step)
        # the prediction counts as well, so that one lucky measurement does not end the procedure
        if _meets(step.reading, target) and plan.remaining.interval()[1] < target:
            return _result(steps, model, target, "the target is reached")
    plan = planned_move(model, positioner, approach=approach)
    return _result(steps, model, target, _reason(plan, steps[-1], target))


def _check(target: float, moves: int, trials: int, matrix: ArrayLike | None) -> None:
    if not 0.0 < target < math.inf:
        raise ModelError(f"the target must be positive and finite, got {target!r} m")
    if moves < 1:
        raise ModelError(f"there must be at least one move, got {moves}")
    if trials not in (0, 1, 2):
        raise ModelError(f"there must be 0, 1 or 2 trial moves, got {trials}")
    if trials == 0 and matrix is None:
        raise ModelError("without a trial move, the matrix of the moves must be given")


def _meets(reading: CentreReading, target: float) -> bool:
    return reading.length.interval()[1] < target


def _trial(positioner: Positioner, axis: int, reading: CentreReading) -> tuple[float, float]:
    """Return the command of a trial move."""
    u = math.sqrt(float(np.trace(reading.covariance))) + positioner.resolution[axis]
    length = calibration_length(float(np.hypot(*reading.vector)), u)
    command = list(positioner.position)
    try:
        command[axis] = calibration_position(command[axis], positioner.limits[axis], length)
    except ModelError as error:
        raise ModelError(f"axis {_AXES[axis]}: {error}") from None
    return command[0], command[1]


def _go(positioner: Positioner, command: tuple[float, float], approach: Approach) -> np.ndarray:
    before = np.asarray(positioner.position)
    if approach == "from below":
        positioner.move_to(*positioner.settable(*(low for low, _ in positioner.limits)))
    return np.asarray(positioner.move_to(*command)) - before


def _measured(
    measure: Callable[[], CentreReading],
    positioner: Positioner,
    model: MoveModel,
    kind: Literal["trial", "move"],
    predicted: Estimate | None,
) -> tuple[MoveModel, CentringStep]:
    reading = measure()
    step = CentringStep(
        kind=kind, command=positioner.position, reading=reading, predicted=predicted
    )
    return model.measured(reading.vector, reading.covariance), step


def _improves(plan: PlannedMove, now: CentreReading) -> bool:
    # a move is made if it is expected to leave less than this share
    largest_share = 0.9
    if not np.any(plan.by):
        return False
    return plan.remaining.value < largest_share * max(now.length.value, now.length.uncertainty)


def _reason(plan: PlannedMove, last: CentringStep, target: float) -> str:
    if _meets(last.reading, target):
        return "the target is reached"
    if not plan.within_limits:
        return (
            f"the limits of the stage leave an eccentricity of {1e6 * plan.shortfall:.2f} um: "
            "start with the axes at the other end of their stroke, or remount the scale at another "
            "angle on the stage"
        )
    if not _improves(plan, last.reading):
        return (
            f"resolution and noise leave {1e6 * plan.remaining.value:.3f} um on average: no "
            "improvement is expected from a further move"
        )
    return "the largest number of moves was made"


def _result(steps: list[CentringStep], model: MoveModel, target: float, reason: str) -> Centring:
    return Centring(
        steps=tuple(steps),
        model=model,
        target=target,
        reached=_meets(steps[-1].reading, target),
        reason=reason,
    )
