"""Synchronous and asynchronous motion of an axis, from indicators or from heads of a scale."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.geometry import require_radius
from flexstage.centring.harmonics import fit_many
from flexstage.centring.turns import Turns, find_turns
from flexstage.quantities.estimate import Estimate

_TURN = 2.0 * math.pi
#: Sensitive direction: radial and fixed, radial and turning with the axis, axial, or a tilt.
Direction = Literal["radial", "rotating", "axial", "tilt"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanTurn:
    """Synchronous and asynchronous parts of values over turns."""

    angle: Array
    """Mean angle of the samples of each part of a turn [rad], shape (k,)."""
    synchronous: Array
    """Mean of the values in each part, shape (k,)."""
    uncertainty: Array
    """Standard uncertainty of the mean, from the scatter of turns, shape (k,)."""
    asynchronous: Array
    """Deviation of each sample from the mean, shape (n,)."""
    asynchronous_rms: Estimate
    """Root mean square of the asynchronous part over many turns."""
    turns: int
    """Number of turns."""


def mean_turn(angle: ArrayLike, value: ArrayLike, *, parts: int = 360) -> MeanTurn:
    """Separate the synchronous part of values, equal in every turn, from the asynchronous part.

    The synchronous part is eccentricity, errors of the scale and synchronous motion of the axis;
    the asynchronous part is asynchronous motion of the axis (ISO 230-7:2015) and noise. One head
    does not separate these further: it cannot detect a motion of the axis along its line of sight,
    and reads one across it as an error of the angle.

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
    Changes within a part of a turn count as asynchronous unless every turn is sampled at the same
    angles: use parts that are short compared with the highest order, or sample at equal angles.

    Raises
    ------
    RecordError
        There are fewer than two turns, a part of the turn without two samples, or shapes that
        do not match.

    Examples
    --------
    >>> theta = np.linspace(0.0, 8.0 * np.pi, 2881)[:-1]
    >>> wobble = 0.3e-6 * np.cos(1.25 * theta)
    >>> turn = mean_turn(theta, 2e-6 * np.sin(theta - 0.4) + wobble)
    >>> print(f"{1e6 * np.ptp(turn.synchronous):.2f} {1e6 * turn.asynchronous_rms.value:.2f}")
    4.00 0.25
    """
    turns, y = _over_turns(angle, value)
    _require_two(turns, "synchronous")
    full_turns = len(turns.bounds) - 1
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
    deviation = y - mean[part]
    # contribution of a turn to the mean of a part; the errors of its samples may be correlated
    sums = np.bincount(turn * parts + part, deviation, minlength=full_turns * parts).reshape(
        -1, parts
    )
    present = np.maximum(2, np.count_nonzero(sums, axis=0))
    variance = np.sum(sums**2, axis=0) / number**2 * present / (present - 1)
    centre = np.arange(parts) / parts + np.bincount(part, offset, minlength=parts) / number
    return MeanTurn(
        angle=turns.angle[0] + turns.direction * _TURN * centre,
        synchronous=mean,
        uncertainty=np.sqrt(variance),
        asynchronous=deviation,
        # the part of it that the mean absorbs belongs to it
        asynchronous_rms=_rms(
            deviation,
            (float(np.sum(deviation**2)) + float(number @ variance)) / deviation.size,
            turns.bounds,
            "",
        ),
        turns=full_turns,
    )


def _require_two(turns: Turns, what: str) -> None:
    if turns.count < 1.9:
        raise RecordError(
            f"the samples cover {turns.count:.2f} turns: two turns or more are needed to separate "
            f"the {what} error"
        )


def _over_turns(angle: ArrayLike, value: ArrayLike) -> tuple[Turns, Array]:
    """Return the turns of the angles and the values, one for each angle."""
    turns = find_turns(angle)
    y = np.asarray(value, dtype=np.float64)
    if y.shape != turns.angle.shape or not np.isfinite(y).all():
        raise RecordError(
            f"the values must be finite, and as many as the angles, {turns.angle.size}, got shape "
            f"{y.shape}"
        )
    return turns, y


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisErrorMotion:
    """Error motion of an axis of rotation in one direction, as in ISO 230-7."""

    angle: Array
    """Angles of the mean turn from the first sample on [rad], shape (k,)."""
    mean: Array
    """Mean over the turns without what is removed [m or rad], shape (k,)."""
    once_per_turn: Estimate
    """Amplitude of order 1: of a fixed radial direction, the eccentricity [m or rad]."""
    synchronous: Estimate
    """Range of the mean over the turns [m or rad]."""
    asynchronous: Estimate
    """Largest range over the turns about their mean at any angle [m or rad]; grows with turns."""
    turns: int
    """Number of turns."""


def error_motion(
    angle: ArrayLike, value: ArrayLike, *, direction: Direction = "radial"
) -> AxisErrorMotion:
    r"""Evaluate an indicator over turns of an axis in the manner of ISO 230-7.

    The reading is interpolated to equal angles. Its mean over the turns is the synchronous motion,
    without what belongs to the place of the artefact: order 0, and order 1 of a radial direction,
    the least-squares centre. Order 1 of an axial or tilt motion is no eccentricity and stays.

    Parameters
    ----------
    angle : array_like
        Angle of each sample [rad], shape (n,), wrapped or not.
    value : array_like
        Reading of the indicator [m], of a tilt [rad], shape (n,).
    direction : str
        radial for an indicator that stands still; axial; tilt; rotating for
        :math:`x\cos\theta + y\sin\theta` of two radial ones, the second a quarter turn further
        in the direction of growing angle.

    Returns
    -------
    AxisErrorMotion
        Values as the standard defines them. Their intervals are simulated with the scatter of
        turns: noise widens a range.

    Validity
    --------
    The form of the artefact counts as synchronous motion: separate it by reversal or several
    indicators. Turns are independent; a drift from turn to turn counts as asynchronous. Orders well
    below half the samples of a turn: samples that fall between those angles are averaged in pairs.
    In the rotating direction order 2 is the one to distrust: an eccentricity e read with indicators
    whose gains differ by the share g gives an amplitude e g / 2 there, and all of e if the second
    indicator stands a quarter turn the other way.

    Raises
    ------
    RecordError
        There are fewer than two turns, a gap of more than 45 deg, or an angle that reverses.

    Examples
    --------
    >>> theta = np.arange(20 * 360) * np.pi / 180.0
    >>> reading = 30e-6 * np.cos(theta - 0.4) + 0.2e-6 * np.cos(3.0 * theta)
    >>> found = error_motion(theta, reading + 0.05e-6 * np.cos(1.5 * theta))
    >>> amounts = (found.once_per_turn, found.synchronous, found.asynchronous)
    >>> print(" ".join(f"{1e6 * amount.value:.3f}" for amount in amounts))
    30.000 0.400 0.100
    """
    turns, y = _over_turns(angle, value)
    per_turn = round(y.size / turns.count)
    full = turns.full
    u = turns.direction * (turns.angle - turns.angle[0]) / _TURN
    order = np.argsort(u, kind="stable")
    u, y = u[order], y[order]
    gap = float(np.diff(u).max())
    if full < 2 or turns.direction == 0 or gap > 0.125 + 1e-6:
        raise RecordError(
            f"the samples cover {turns.count:.2f} turns with a largest gap of {360.0 * gap:.3g} "
            "deg: error motion needs two whole turns or more in one direction, with gaps of at "
            "most 45 deg"
        )
    inside = u < full
    design = np.column_stack((np.ones(u.size), np.cos(_TURN * u), np.sin(_TURN * u)))
    centre = np.linalg.lstsq(design[inside], y[inside])[0]
    # straight lines between samples would fall short of a large order 1
    grid = np.arange(full * per_turn) / per_turn
    table = np.interp(grid, u, y - design @ centre).reshape(full, per_turn)
    theta = _TURN * grid[:per_turn]
    off = table - table.mean(axis=0)
    unit = "rad" if direction == "tilt" else "m"
    mean = table.mean(axis=0)
    if direction in ("axial", "tilt"):
        mean = mean + centre[1] * np.cos(theta) + centre[2] * np.sin(theta)
    amplitude = math.hypot(centre[1], centre[2])
    of_turns = 2.0 / per_turn * table @ np.cos(theta - math.atan2(centre[2], centre[1]))
    scatter = float(of_turns.std(ddof=1)) / math.sqrt(full)
    source = "scatter of turns"
    once = Estimate.of(amplitude, scatter, unit, source=source, degrees_of_freedom=full - 1)
    once = replace(once, bounds=(max(once.interval()[0], 0.0), once.interval()[1]))
    synchronous, asynchronous = _ranges(mean, off, unit)
    return AxisErrorMotion(
        angle=theta, mean=mean, once_per_turn=once, synchronous=synchronous,
        asynchronous=asynchronous, turns=full,
    )  # fmt: skip


def _ranges(mean: Array, off: Array, unit: str) -> tuple[Estimate, Estimate]:
    """Return the ranges of a mean turn, and of the turns about it, shape (turns, k)."""
    turns, freedom = len(off), len(off) - 1
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0,)))
    trials = int(np.clip(4e9 / (off.size * turns), 40, 400))
    ranges = np.empty((2, trials))
    for i in range(trials):
        # turns with the covariance over the angle that these have
        sampled = rng.standard_normal((turns, turns)) @ off / math.sqrt(freedom)
        shift = sampled.mean(axis=0)
        ranges[1, i] = np.ptp(sampled - shift, axis=0).max()
        # that covariance is known from few turns
        ranges[0, i] = np.ptp(mean + shift * math.sqrt(freedom / rng.chisquare(freedom)))
    range_of_mean, largest = float(np.ptp(mean)), float(np.ptp(off, axis=0).max())
    # noise widens the range of the mean, which is not taken off; the other one is a range of noise
    widened = ranges[0] - range_of_mean
    return (
        _range(range_of_mean, widened, float(widened.mean()), unit, freedom),
        _range(largest, ranges[1] - ranges[1].mean(), 0.0, unit, freedom),
    )


def _range(value: float, error: Array, bias: float, unit: str, freedom: int) -> Estimate:
    """Return a range with the interval that its simulated errors give."""
    low, high = value - np.quantile(error, (0.975, 0.025))
    return Estimate.of(
        value,
        float(error.std()),
        unit,
        source="scatter of turns",
        degrees_of_freedom=freedom,
        bounds=(min(max(float(low), 0.0), value), max(float(high) + bias, value)),
    )


def _parts(angle: Array, parts: int) -> tuple[NDArray[np.intp], Array]:
    """Return the part of the turn of each sample, and its position in that part [turn]."""
    u = np.abs(angle - angle[0]) / _TURN
    # samples at equal angles must not fall on both sides of an edge by jitter
    early = 0.5 * min(float(np.median(np.abs(np.diff(u)))), 1.0 / parts)
    part = np.floor((u + early) % 1.0 * parts).astype(np.intp) % parts
    return part, (u + early) % 1.0 - part / parts - early


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisMotion:
    """Asynchronous motion of the axis of a table."""

    x: Array
    """Position of the axis in the room along x, with noise [m], shape (n,)."""
    y: Array
    """The same along y [m], shape (n,)."""
    rms_x: Estimate
    """Root mean square of x, without the noise of the heads if that is known [m]."""
    rms_y: Estimate
    """The same of y [m]."""
    noise: float | None
    """Noise of one head [rad]; None if there are no redundant heads."""
    notes: tuple[str, ...]
    """Remarks on the result."""


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

    The synchronous error of each head, from eccentricity and the scale, is subtracted as harmonics.
    The residual of a head at alpha is

    .. math:: d_j = \frac{x \sin\alpha_j - y \cos\alpha_j}{R} + r,

    with r the error of the reference. Least squares solves it for x, y and r at every sample.

    Parameters
    ----------
    angle : array_like
        True angle of the table [rad], shape (n,), over two turns or more.
    errors : array_like
        Error of each head [rad], shape (n, m).
    head_angles : sequence of float
        Angles of the m heads in the room [rad].
    radius : float
        Radius at which the scale is read [m].
    orders : int or sequence of int, optional
        Harmonics of the synchronous error; 1 to 12, or fewer as samples allow, if not given.
    reference : bool
        Whether the reference has an error of its own: one more head is then needed.

    Returns
    -------
    AxisMotion
        The motion.

    Validity
    --------
    Synchronous motion is not included: in general it cannot be separated from errors of the scale,
    and a motion once per turn in the sense of rotation never can. Motion along the axis and its
    tilt are not measured. One head does not separate motion from an error of the angle.

    Raises
    ------
    RecordError
        There are fewer than two turns, or the shapes do not match.
    ModelError
        There are too few heads, or their angles do not separate x and y.

    Examples
    --------
    >>> theta = np.arange(5 * 360) * np.pi / 180
    >>> heads = (0.1, 1.4, 2.9, 4.4)
    >>> sway = 2e-6 * np.cos(0.4 * theta)
    >>> errors = np.stack([sway * np.sin(a) / 50e-3 for a in heads], axis=1)
    >>> motion = axis_motion(theta, errors, heads, radius=50e-3)
    >>> print(f"{1e6 * motion.rms_x.value:.2f} um, {1e6 * motion.rms_y.value:.2f} um")
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
            f"motion of the axis needs at least {needed} heads at different angles"
            + (", as the reference has an error too" if reference else "")
            + f", got heads at {np.degrees(alpha).round(1).tolist()} deg"
        )
    turns = find_turns(angle)
    _require_two(turns, "asynchronous")
    fits = fit_many(turns.angle, y, orders=orders, robust=False)
    asynchronous = np.column_stack([f.residual for f in fits])
    inverse = np.linalg.pinv(design)
    motion = asynchronous @ inverse.T
    spare = alpha.size - needed
    noise = None
    if spare > 0:
        residual = asynchronous - motion @ design.T
        noise = math.sqrt(float(np.mean(np.sum(residual**2, axis=1))) / spare)
    motion_noise = np.sqrt(np.sum(inverse**2, axis=1)) * (noise or 0.0)
    notes = () if noise is not None else ("the motion of the axis includes the noise of heads",)
    # without the noise of the heads
    rms_x, rms_y = (
        _rms(m, float(np.mean(m**2)) - u**2, turns.bounds, "m")
        for m, u in zip(motion[:, :2].T, motion_noise[:2], strict=True)
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
    # the mean square scatters: the ends of its interval give those of the root
    half = Estimate.of(square, spread, f"{unit}^2", degrees_of_freedom=freedom).interval()
    low, high = (math.sqrt(max(end, 0.0)) for end in half)
    return Estimate.of(
        value,
        min(0.5 * spread / value, math.sqrt(spread)) if value else math.sqrt(spread),
        unit,
        source="scatter of turns",
        degrees_of_freedom=freedom,
        bounds=(low, high),
    )
