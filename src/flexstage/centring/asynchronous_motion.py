"""Motion of the table's axis, told from errors of the scale by several heads."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.centring.geometry import require_radius
from flexstage.centring.harmonics import fit_many
from flexstage.centring.turns import find_turns
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Estimate


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
    return AxisMotion(
        x=motion[:, 0],
        y=motion[:, 1],
        rms_x=_rms(motion[:, 0], own[0], turns.bounds),
        rms_y=_rms(motion[:, 1], own[1], turns.bounds),
        noise=noise,
        notes=notes,
    )


def _rms(motion: Array, noise: float, bounds: Sequence[int]) -> Estimate:
    """Return the rms without noise, with the scatter of turns for its uncertainty."""
    squares = np.array([np.mean(motion[a:b] ** 2) for a, b in pairwise(bounds)])
    square = max(float(np.mean(motion**2)) - noise**2, 0.0)
    spread = float(np.std(squares, ddof=1)) / math.sqrt(squares.size)
    value = math.sqrt(square)
    freedom = squares.size - 1.0
    # the square is what scatters: its interval has ends where the root of it has
    half = Estimate.of(square, spread, "m^2", degrees_of_freedom=freedom).interval()
    low, high = (math.sqrt(max(end, 0.0)) for end in half)
    return Estimate.of(
        value,
        min(0.5 * spread / value, math.sqrt(spread)) if value else math.sqrt(spread),
        "m",
        source="turns differ",
        degrees_of_freedom=freedom,
        bounds=(low, high),
    )
