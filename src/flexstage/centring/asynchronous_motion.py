"""What does not repeat itself in every turn: of one head, and as motion of the axis of several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.geometry import require_radius
from flexstage.centring.harmonics import fit_many
from flexstage.centring.turns import find_turns
from flexstage.quantities.estimate import Estimate

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanTurn:
    """What is the same in every turn, and what is not."""

    angle: Array
    """Mean angle of the samples of each part of a turn [rad], shape (k,)."""
    synchronous: Array
    """Mean of the values there, shape (k,)."""
    uncertainty: Array
    """Standard uncertainty of that mean, from how turns differ, shape (k,)."""
    asynchronous: Array
    """What each sample is more than the mean, shape (n,)."""
    asynchronous_rms: Estimate
    """Root of the mean square of it over many turns."""
    turns: int
    """Number of turns."""


def mean_turn(angle: ArrayLike, value: ArrayLike, *, parts: int = 360) -> MeanTurn:
    """Tell what repeats itself in every turn from what does not.

    What repeats itself is eccentricity and errors of the scale, and motion of the axis that is
    synchronous; what does not is asynchronous motion of the axis (ISO 230-7:2015 has these words)
    and noise. One head cannot tell the parts of either from each other: a motion of the axis along
    the head's line of sight is not seen at all, and one across it looks like an error of the angle.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,).
    value : array_like
        The values, in any unit, shape (n,).
    parts : int
        Number of parts of a turn in which samples are averaged.

    Returns
    -------
    MeanTurn
        Both parts. The unit of the asynchronous part is left empty.

    Validity
    --------
    What changes within a part of a turn, and is not sampled at the same angles in every turn,
    counts as asynchronous: choose parts that are short against the highest order, or sample at
    equal angles.

    Raises
    ------
    RecordError
        There are fewer than two turns, a part of the turn without two samples, or shapes that
        do not belong together.

    Examples
    --------
    >>> theta = np.linspace(0.0, 8.0 * np.pi, 2881)[:-1]
    >>> wobble = 0.3e-6 * np.cos(1.25 * theta)
    >>> turn = mean_turn(theta, 2e-6 * np.sin(theta - 0.4) + wobble)
    >>> print(f"{1e6 * np.ptp(turn.synchronous):.2f} {1e6 * turn.asynchronous_rms.value:.2f}")
    4.00 0.25
    """
    turns = find_turns(angle)
    y = np.asarray(value, dtype=np.float64)
    if y.shape != turns.angle.shape or not np.isfinite(y).all():
        raise RecordError(
            f"the values must be finite, and as many as the angles, {turns.angle.size}, got shape "
            f"{y.shape}"
        )
    whole = len(turns.bounds) - 1
    if whole < 2 or turns.count < 1.9:
        raise RecordError(
            f"the samples go over {turns.count:.2f} turns: two turns or more are needed to "
            "tell what repeats itself"
        )
    if parts < 1:
        raise RecordError(f"a turn must have one part or more, got {parts}")
    part, offset = _parts(turns.angle, parts)
    turn = np.searchsorted(np.array(turns.bounds[1:-1]), np.arange(y.size), side="right")
    number = np.bincount(part, minlength=parts)
    if number.min() < 2:
        raise RecordError(
            f"a part of the turn has {int(number.min())} samples: with {y.size} samples over "
            f"{turns.count:.2f} turns, take fewer than {parts} parts"
        )
    mean = np.bincount(part, y, minlength=parts) / number
    left = y - mean[part]
    # what a turn adds to the mean of a part; its samples may all go astray together
    pulls = np.bincount(turn * parts + part, left, minlength=whole * parts).reshape(-1, parts)
    present = np.maximum(2, np.count_nonzero(pulls, axis=0))
    variance = np.sum(pulls**2, axis=0) / number**2 * present / (present - 1)
    centre = np.arange(parts) / parts + np.bincount(part, offset, minlength=parts) / number
    return MeanTurn(
        angle=turns.angle[0] + turns.direction * _TURN * centre,
        synchronous=mean,
        uncertainty=np.sqrt(variance),
        asynchronous=left,
        # what the mean takes away belongs to it
        asynchronous_rms=_rms(
            left, (float(np.sum(left**2)) + float(number @ variance)) / left.size, turns.bounds, ""
        ),
        turns=whole,
    )


def _parts(angle: Array, parts: int) -> tuple[NDArray[np.intp], Array]:
    """Return the part of the turn that each sample is in, and how far in [turn]."""
    u = np.abs(angle - angle[0]) / _TURN
    # samples at equal angles must not fall on both sides of an edge by jitter
    early = 0.5 * min(float(np.median(np.abs(np.diff(u)))), 1.0 / parts)
    part = np.floor((u + early) % 1.0 * parts).astype(np.intp) % parts
    return part, (u + early) % 1.0 - part / parts - early


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisMotion:
    """How the axis of a table moves, but for what repeats itself in every turn."""

    x: Array
    """Where the axis is in the room along x, asynchronous part, noise included [m], shape (n,)."""
    y: Array
    """The same along y [m], shape (n,)."""
    rms_x: Estimate
    """Root of the mean square of x, without the noise of the heads where that is known [m]."""
    rms_y: Estimate
    """The same of y [m]."""
    noise: float | None
    """Noise of one head [rad]; None where there are no heads to spare for it."""
    notes: tuple[str, ...]
    """What a reader should know."""


def axis_motion(
    angle: ArrayLike,
    errors: ArrayLike,
    head_angles: Sequence[float],
    *,
    radius: float,
    orders: int | Sequence[int] | None = None,
    reference: bool = True,
) -> AxisMotion:
    r"""Find the asynchronous motion of the axis from heads that were sampled together.

    What repeats itself in every turn, eccentricity and the scale's own errors, is taken from each
    head as harmonics. What is left is, of a head at alpha,

    .. math:: d_j = \frac{x \sin\alpha_j - y \cos\alpha_j}{R} + r,

    with r the error of the reference, and is solved for x, y and r at every sample by least
    squares.

    Parameters
    ----------
    angle : array_like
        True angle of the table [rad], shape (n,), over two turns or more.
    errors : array_like
        Error of each head [rad], shape (n, m).
    head_angles : sequence of float
        Where the heads stand in the room [rad], m of them.
    radius : float
        Radius at which the scale is read [m].
    orders : int or sequence of int, optional
        Harmonics of what repeats itself; 1 to 12, or fewer as samples allow, where not given.
    reference : bool
        Whether the reference has an error of its own: one more head is then needed.

    Returns
    -------
    AxisMotion
        The motion.

    Validity
    --------
    Motion that repeats itself in every turn is not in it: it cannot be told from errors of the
    scale in general, and once a turn in its sense never. Motion along the axis and tilt of it are
    not seen. One head sees no motion apart from an error of the angle.

    Raises
    ------
    RecordError
        There are fewer than two turns, or the shapes do not belong together.
    ModelError
        There are too few heads, or they stand so that x and y cannot be told apart.

    Examples
    --------
    >>> theta = np.arange(5 * 360) * np.pi / 180
    >>> heads = (0.1, 1.4, 2.9, 4.4)
    >>> sway = 2e-6 * np.cos(0.4 * theta)
    >>> errors = np.stack([sway * np.sin(a) / 50e-3 for a in heads], axis=1)
    >>> found = axis_motion(theta, errors, heads, radius=50e-3)
    >>> print(f"{1e6 * found.rms_x.value:.2f} um, {1e6 * found.rms_y.value:.2f} um")
    1.41 um, 0.00 um
    """
    y = np.asarray(errors, dtype=np.float64)
    alpha = np.asarray(head_angles, dtype=np.float64)
    if y.ndim != 2 or y.shape[1] != alpha.size:
        raise RecordError(
            f"the errors must have a column for each of {alpha.size} heads, got shape {y.shape}"
        )
    require_radius(radius)
    design = np.column_stack((np.sin(alpha) / radius, -np.cos(alpha) / radius, np.ones(alpha.size)))
    design = design if reference else design[:, :2]
    needed = design.shape[1]
    scaled = design * np.array([radius, radius, 1.0])[:needed]
    if alpha.size < needed or np.linalg.cond(scaled) > 1e3:
        raise ModelError(
            f"motion of the axis needs {needed} heads at different angles or more"
            + (", as the reference has an error too" if reference else "")
            + f", got heads at {np.degrees(alpha).round(1).tolist()} deg"
        )
    turns = find_turns(angle)
    if turns.count < 1.9:
        raise RecordError(
            f"the samples go over {turns.count:.2f} turns: two turns or more are needed to tell "
            "what does not repeat itself"
        )
    fits = fit_many(turns.angle, y, orders=orders, robust=False)
    left = np.column_stack([f.residual for f in fits])
    inverse = np.linalg.pinv(design)
    motion = left @ inverse.T
    spare = alpha.size - needed
    noise = None
    if spare > 0:
        rest = left - motion @ design.T
        noise = math.sqrt(float(np.mean(np.sum(rest**2, axis=1))) / spare)
    own = np.sqrt(np.sum(inverse**2, axis=1)) * (noise or 0.0)
    notes = () if noise is not None else ("the noise of the heads is in the motion of the axis",)
    # without the noise of the heads
    rms_x, rms_y = (
        _rms(m, float(np.mean(m**2)) - u**2, turns.bounds, "m")
        for m, u in zip(motion[:, :2].T, own[:2], strict=True)
    )
    return AxisMotion(
        x=motion[:, 0],
        y=motion[:, 1],
        rms_x=rms_x,
        rms_y=rms_y,
        noise=noise,
        notes=notes,
    )


def _rms(values: Array, square: float, bounds: Sequence[int], unit: str) -> Estimate:
    """Return the root of a mean square, with the scatter of turns for its uncertainty."""
    squares = np.array([np.mean(values[a:b] ** 2) for a, b in pairwise(bounds)])
    square = max(square, 0.0)
    spread = float(np.std(squares, ddof=1)) / math.sqrt(squares.size)
    value = math.sqrt(square)
    freedom = squares.size - 1.0
    # the square is what scatters: its interval has ends where the root of it has
    half = Estimate.of(square, spread, f"{unit}^2", degrees_of_freedom=freedom).interval()
    low, high = (math.sqrt(max(end, 0.0)) for end in half)
    return Estimate.of(
        value,
        min(0.5 * spread / value, math.sqrt(spread)) if value else math.sqrt(spread),
        unit,
        source="turns differ",
        degrees_of_freedom=freedom,
        bounds=(low, high),
    )
