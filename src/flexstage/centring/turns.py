"""Angles that wrap, turns, and what repeats itself in every turn."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.estimate import Estimate

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """The angles of a record without their wraps, and where its turns begin."""

    angle: Array
    """Angle of each sample [rad], shape (n,): from sample to sample it jumps no more."""
    direction: int
    """Whether the angle falls or rises on the whole; 0 where its samples are in no order."""
    count: float
    """How many turns the samples go over, that from the last to the first included."""
    bounds: tuple[int, ...]
    """First sample of each turn and, at the end, the number of samples. The last turn is at least
    half of one, or part of that before it.
    """
    coverage: float
    """Share of a turn that has samples [1]: what is left without the largest gap, less the usual
    one.
    """


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


def find_turns(angle: ArrayLike) -> Turns:
    """Take the wraps out of an angle, and find the turns.

    The angle [rad] rises or falls. One that goes over more than a turn is taken to have no wraps.
    Of another, a step of more than half a turn is a wrap. Where samples follow one another in no
    order, the angle stays as it is.

    Validity
    --------
    Neighbouring samples less than half a turn apart. Jitter is no matter.

    Examples
    --------
    >>> turns = find_turns(np.radians([350.0, 110.0, 230.0, 350.5, 110.5, 229.0]))
    >>> print(f"{turns.count:.2f} turns, the last angle is {np.degrees(turns.angle[-1]):.0f} deg")
    2.00 turns, the last angle is 949 deg
    """
    raw = np.asarray(angle, dtype=np.float64)
    if raw.ndim != 1 or raw.size < 2 or not np.isfinite(raw).all():
        raise RecordError(
            f"an angle needs two samples or more, all of them finite, got shape {raw.shape}"
        )
    if raw.max() == raw.min():
        raise RecordError(f"the angle is {raw[0]:g} in all samples: the table did not turn")
    u = raw / _TURN
    steps = np.diff(u)
    if u.max() - u.min() <= 1.0 + 1e-6 + float(np.median(np.abs(steps))):
        wrapped = steps - np.rint(steps)
        forward = float(np.sum(wrapped))
        # in no order the steps lead nowhere
        if abs(forward) >= 0.5 * float(np.abs(wrapped).sum()):
            u = u[0] + np.concatenate(([0.0], np.cumsum(wrapped)))
            # the sum of the steps gathers rounding: the fraction is that of the angle itself
            u = raw / _TURN + np.rint(u - raw / _TURN)
    return _described(u)


def _described(u: Array) -> Turns:
    steps = np.diff(u)
    net, way = float(u[-1] - u[0]), float(np.abs(steps).sum())
    ordered = abs(net) >= 0.5 * way
    gaps = np.diff(np.sort(u % 1.0))
    gap = max(float(gaps.max()), 1.0 - float(gaps.sum()))
    usual = min(gap, 1.0 / max(1, _places(u)))
    coverage = 1.0 - gap + usual
    if not ordered:
        return Turns(
            angle=_TURN * u, direction=0, count=max(1.0, float(np.ptp(u))),
            bounds=(0, u.size), coverage=coverage,
        )  # fmt: skip
    count = abs(net) * u.size / (u.size - 1)
    number = np.floor(np.abs(u - u[0]) + 1e-9 * count)
    whole = max(1, round(count))
    # the first sample at which a turn is full; jitter does not take it back
    reached = np.maximum.accumulate(number)
    starts = [int(np.searchsorted(reached, k)) for k in range(whole)]
    bounds = (*sorted(set(starts)), u.size)
    return Turns(
        angle=_TURN * u, direction=1 if net > 0.0 else -1, count=count,
        bounds=bounds, coverage=coverage,
    )  # fmt: skip


def _places(u: Array) -> int:
    """Return about how many different angles a turn has samples at."""
    return int(np.unique(np.rint((u % 1.0) * 1e6)).size)


def unwrap_error(error: ArrayLike) -> Array:
    """Take whole turns out of errors that were made as the difference of two wrapped angles.

    Errors are in rad. They are then within half a turn of their mean direction, that of the first
    turn.

    Validity
    --------
    Errors that lie within less than half a turn of each other.

    Examples
    --------
    >>> print(np.degrees(unwrap_error(np.radians([0.02, -359.97, 360.01, -0.01]))).round(3))
    [ 0.02  0.03  0.01 -0.01]
    """
    raw = np.asarray(error, dtype=np.float64)
    if not np.isfinite(raw).all():
        raise RecordError("an error must be finite in all samples")
    if raw.size == 0 or float(np.ptp(raw)) < 0.5 * _TURN:
        return raw.copy()
    turned = np.exp(2j * math.pi * raw / _TURN)
    middle = float(np.angle(turned.mean()))
    return raw - _TURN * np.rint((raw - middle) / _TURN)


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
        asynchronous_rms=_rms(left, turns, float(number @ variance)),
        turns=whole,
    )


def _parts(angle: Array, parts: int) -> tuple[NDArray[np.intp], Array]:
    """Return the part of the turn that each sample is in, and how far in [turn]."""
    u = np.abs(angle - angle[0]) / _TURN
    # samples at equal angles must not fall on both sides of an edge by jitter
    early = 0.5 * min(float(np.median(np.abs(np.diff(u)))), 1.0 / parts)
    part = np.floor((u + early) % 1.0 * parts).astype(np.intp) % parts
    return part, (u + early) % 1.0 - part / parts - early


def _rms(left: Array, turns: Turns, taken: float) -> Estimate:
    """Return the rms of all turns but for what their mean takes away, and how well it is known."""
    per_turn = np.array([np.mean(left[a:b] ** 2) for a, b in pairwise(turns.bounds)])
    square = (float(np.sum(left**2)) + taken) / left.size
    value = math.sqrt(square)
    spread = float(np.std(per_turn, ddof=1)) / math.sqrt(per_turn.size)
    u = 0.5 * spread / value if value > 0.0 else 0.0
    return Estimate.of(value, u, "", source="turns differ", degrees_of_freedom=per_turn.size - 1.0)
