"""The whole procedure: measure, try, move, and measure again, until the scale is centred."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
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
    >>> from flexstage.centring import ScaleReadings, against_reference
    >>> t = 2.0 * np.pi * np.arange(90) / 90
    >>> read = 1e-3 * np.sin(t - 0.3)
    >>> readings = ScaleReadings(angle=t, errors=read, heads=np.zeros(1), noise=5e-6)
    >>> found = table_reading(against_reference(readings, range(1, 5)), 50e-3)
    >>> print(f"{1e6 * found.length.value:.2f} um, {1e6 * found.length.uncertainty:.3f} um")
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


#: The shortest one, in uncertainties of what it is measured and set with.
_SHORTEST_TRIAL = 30.0
_AXES = ("x", "y")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringStep:
    """One measurement of the eccentricity, and what was done before it."""

    kind: Literal["start", "trial", "move"]
    """What was done."""
    command: tuple[float, float]
    """Commands of the axes [m]."""
    reading: CentreReading
    """What was measured then."""
    predicted: Estimate | None = None
    """What a move was expected to leave [m]; None before the moves are known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centring:
    """What the procedure came to."""

    steps: tuple[CentringStep, ...]
    """Every measurement, in order."""
    model: MoveModel
    """What is known of the moves."""
    target: float
    """Eccentricity that was asked for [m]."""
    reached: bool
    """Whether the upper end of the 95 % interval of what was measured last is below it."""
    reason: str
    """Why it ended."""

    @property
    def reading(self) -> CentreReading:
        """The last measurement."""
        return self.steps[-1].reading

    @property
    def eccentricity(self) -> Estimate:
        """What was measured last [m]."""
        return self.reading.length

    @property
    def predicted(self) -> Estimate | None:
        """What the last move was expected to leave [m]; None if there was none."""
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
    r"""Centre the scale: measure, move each axis on trial, and then go to the centre in few moves.

    A trial move tells how an axis is turned on the table, which way it counts, and its gain; every
    further move improves that. It ends when the target is reached, with 95 % confidence in what is
    measured and in what was predicted of the last move; when the limits, the resolution or what is
    not known promise no improvement; or when the moves are used up.

    Parameters
    ----------
    measure : callable
        Turns the table and returns the eccentricity of the scale.
    positioner : Positioner
        What moves the scale.
    target : float
        Eccentricity that shall be reached [m].
    moves : int
        The most moves towards the centre, not counting trial moves.
    trials : int
        Trial moves: 2, one of each axis; 1, of the first, with the other one taken as square and of
        equal gain; 0 where the matrix is known.
    mirrored : bool
        Whether the axes count the other way round than those of the table; for one trial move.
    matrix : array_like, optional
        How the scale is thought to move for a command of each axis [1], shape (2, 2).
    matrix_uncertainty : float
        Standard uncertainty of each of its elements [1].
    approach : {"direct", "from below"}
        Whether each command is approached from the lower end of both axes, which takes hysteresis
        and backlash out, or directly.

    Returns
    -------
    Centring
        All steps, and what is left.

    Validity
    --------
    What is brought to zero is what the readings show: the eccentricity and the scale's own errors
    of order 1 together. Trial moves tell how the stage moves the scale, and not how much of the
    error is of the scale's own. The first order of an axis that runs out once in a turn is in it
    for one head.

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
    >>> done = centre(VirtualBench(table, stage).measure, stage)
    >>> print(done.reached, done.moves, f"{1e6 * done.steps[0].reading.length.value:.1f} um")
    True 3 50.0 um
    """
    _check(target, moves, trials, matrix)
    errors = move_errors(positioner, approach)
    # the start belongs to the same branch as all that follows
    _go(positioner, positioner.position, approach)
    first = measure()
    steps = [CentringStep(kind="start", command=positioner.position, reading=first)]
    model = unknown_moves(
        first.vector, first.covariance, matrix=matrix, matrix_uncertainty=matrix_uncertainty
    )
    if _good(first, target):
        return _ended(steps, model, target, "it was centred from the start")
    for axis in range(trials):
        command = _trial(positioner, axis, first)
        by = _go(positioner, command, approach)
        model, step = _measured(measure, positioner, model.moved(by, errors), "trial", None)
        steps.append(step)
        if trials == 1:
            model = model.square(mirrored=mirrored)
    for _ in range(moves):
        plan = planned_move(model, positioner, approach=approach)
        if not _worth_while(plan, steps[-1].reading):
            break
        by = _go(positioner, plan.command, approach)
        expected = model.moved(by, errors)
        model, step = _measured(measure, positioner, expected, "move", plan.remaining)
        steps.append(step)
        # what was expected as well, so that a lucky measurement alone does not end it
        if _good(step.reading, target) and plan.remaining.interval()[1] < target:
            return _ended(steps, model, target, "the target is reached")
    plan = planned_move(model, positioner, approach=approach)
    return _ended(steps, model, target, _why(plan, steps[-1], target))


def _check(target: float, moves: int, trials: int, matrix: ArrayLike | None) -> None:
    if not 0.0 < target < math.inf:
        raise ModelError(f"the target must be positive and finite, got {target!r} m")
    if moves < 1:
        raise ModelError(f"there must be at least one move, got {moves}")
    if trials not in (0, 1, 2):
        raise ModelError(f"the trial moves are 0, 1 or 2, got {trials}")
    if trials == 0 and matrix is None:
        raise ModelError("without a trial move, the matrix of the moves must be given")


def _good(reading: CentreReading, target: float) -> bool:
    return reading.length.interval()[1] < target


def trial_length(eccentricity: float, uncertainty: float) -> float:
    r"""Return how long a trial move of one axis should be [m].

    About as long as the later moves, :math:`e / \sqrt 2`, and 30 standard uncertainties u at least,
    with which eccentricity and place are known [m].

    Examples
    --------
    >>> f"{trial_length(50e-6, 0.1e-6):.3g}", f"{trial_length(0.2e-6, 0.1e-6):.3g}"
    ('3.54e-05', '3e-06')
    """
    return max(eccentricity / math.sqrt(2.0), _SHORTEST_TRIAL * uncertainty)


def trial_position(now: float, limits: tuple[float, float], wanted: float) -> float:
    """Return where a trial move of an axis leads [m]: to the side of it that has more room.

    Raises
    ------
    ModelError
        There is no room.
    """
    # the longest trial move, as a share of the stroke: the gain beyond it is known less well.
    longest_trial = 0.6
    low, high = limits
    room = max(high - now, now - low)
    length = min(wanted, longest_trial * (high - low), room)
    if not length > 0.0:
        raise ModelError("there is no room for a trial move")
    return now + (length if high - now >= now - low else -length)


def _trial(positioner: Positioner, axis: int, reading: CentreReading) -> tuple[float, float]:
    """Command of a trial move: about as long as the later moves, to the side with more room."""
    u = math.sqrt(float(np.trace(reading.covariance))) + positioner.resolution[axis]
    wanted = trial_length(float(np.hypot(*reading.vector)), u)
    command = list(positioner.position)
    try:
        command[axis] = trial_position(command[axis], positioner.limits[axis], wanted)
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


def _worth_while(plan: PlannedMove, now: CentreReading) -> bool:
    # A move is worth while if it is expected to leave less than this share.
    worth_while = 0.9
    if not np.any(plan.by):
        return False
    return plan.remaining.value < worth_while * max(now.length.value, now.length.uncertainty)


def _why(plan: PlannedMove, last: CentringStep, target: float) -> str:
    if _good(last.reading, target):
        return "the target is reached"
    if not plan.within_limits:
        return (
            f"the limits of the stage leave {1e6 * plan.shortfall:.2f} um: begin with the axes at "
            "the other end of their stroke, or mount the scale again, turned on the stage"
        )
    if not _worth_while(plan, last.reading):
        return (
            f"resolution and noise leave {1e6 * plan.remaining.value:.3f} um on average: a further "
            "move is not expected to improve it"
        )
    return "the moves are used up"


def _ended(steps: list[CentringStep], model: MoveModel, target: float, reason: str) -> Centring:
    return Centring(
        steps=tuple(steps),
        model=model,
        target=target,
        reached=_good(steps[-1].reading, target),
        reason=reason,
    )
