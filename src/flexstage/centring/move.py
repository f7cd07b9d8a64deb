"""The move that centres the scale: within the limits of the stage, with what will remain."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.move_model import MoveErrors, MoveModel, length_prediction
from flexstage.centring.positioner import Positioner
from flexstage.errors import ModelError
from flexstage.estimate import Estimate

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
    >>> from flexstage.designs import design
    >>> from flexstage.centring.positioner import VirtualPositioner
    >>> from flexstage.centring.move_model import unknown_moves
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
