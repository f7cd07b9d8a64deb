"""Where the levels of a staircase begin and end, from its command or from the reading itself."""

import itertools

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Integers
from flexstage.errors import ModelError, RecordError

#: Rounds in which each change is put to its best place between its neighbours.
_ROUNDS = 30


def levels_of_command(command: ArrayLike, *, tolerance: float = 0.0, shortest: int = 1) -> Integers:
    """Return the bounds of the stretches in which a command stays.

    First sample of each level, and the sample after the last. Changes up to the
    tolerance, for a measured command several times its noise, count as none; stretches shorter than
    `shortest`, as of a ramp between two levels, are given to what follows.

    Examples
    --------
    >>> levels_of_command([0.0, 0.0, 0.0, 0.7, 0.7, 1.4, 1.4, 1.4])
    array([0, 3, 5, 8])
    """
    u = np.asarray(command, dtype=np.float64)
    if u.ndim != 1 or u.size < 2 or not np.isfinite(u).all():
        raise RecordError(f"a command is one finite number for each sample, got shape {u.shape}")
    starts = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(u)) > tolerance) + 1))
    lengths = np.diff(np.append(starts, u.size))
    # the samples of a ramp are the beginning of the level that it leads to
    after_ramp = np.concatenate(([False], lengths[:-1] < shortest))
    keep = ~after_ramp
    keep[0] = True
    bounds = np.append(starts[keep], u.size).astype(np.intp)
    if bounds.size < 3:
        raise RecordError(
            "the command has fewer than two levels: name the column that holds it, or give the "
            "number of levels"
        )
    return bounds


def levels_of_reading(values: ArrayLike, count: int, *, shortest: int = 4) -> Integers:
    """Return the bounds of a given number of levels that fit a reading best.

    Bounds are added one by one, each where it lowers the sum of squares about the level means most,
    and after each all are put to their best places between their neighbours until none moves
    (binary segmentation: Scott and Knott, 1974, Biometrics 30; with refinement). O(n) for each. The
    bounds are the first sample of each level and the sample after the last, shape (count + 1,).

    Validity
    --------
    Steps that stand out of the noise of the mean of a level. The best place of one bound at a time
    is not always the best of all together. Take a drift of more than a step over the record off
    first.

    Examples
    --------
    >>> noise = 0.2 * np.random.default_rng(5).standard_normal(90)
    >>> levels_of_reading(np.repeat([0.0, 1.0, 2.5], [25, 40, 25]) + noise, 3)
    array([ 0, 25, 65, 90])
    """
    y = np.asarray(values, dtype=np.float64)
    if count < 2 or shortest < 1:
        raise ModelError(
            f"a staircase has two levels or more, of one sample or more, got {count}, {shortest}"
        )
    if y.ndim != 1 or y.size < count * shortest or not np.isfinite(y).all():
        raise RecordError(
            f"{count} levels of {shortest} samples need {count * shortest} finite readings at "
            f"least, got an array of shape {y.shape}"
        )
    total = np.concatenate(([0.0], np.cumsum(y - y.mean())))
    bounds = [0, y.size]
    while len(bounds) < count + 1:
        found = [_best(total, a, b, shortest) for a, b in itertools.pairwise(bounds)]
        gain, place = max(found)
        if gain < 0.0:
            raise RecordError(
                f"the reading has no room for {count} levels of {shortest} samples: ask for fewer "
                "or shorter ones"
            )
        bounds = sorted([*bounds, place])
        bounds = _refined(total, bounds, shortest)
    return np.array(bounds, dtype=np.intp)


def _best(total: Array, a: int, b: int, shortest: int) -> tuple[float, int]:
    """Return what a bound between a and b saves at most of the sum of squares, and where it is."""
    at = np.arange(a + shortest, b - shortest + 1)
    if at.size == 0:
        return -1.0, -1
    left, right = total[at] - total[a], total[b] - total[at]
    saved = left**2 / (at - a) + right**2 / (b - at) - (total[b] - total[a]) ** 2 / (b - a)
    i = int(np.argmax(saved))
    return float(saved[i]), int(at[i])


def _refined(total: Array, bounds: list[int], shortest: int) -> list[int]:
    out = list(bounds)
    for _ in range(_ROUNDS):
        before = list(out)
        for i in range(1, len(out) - 1):
            out[i] = _best(total, out[i - 1], out[i + 1], shortest)[1]
        if out == before:
            break
    return out
