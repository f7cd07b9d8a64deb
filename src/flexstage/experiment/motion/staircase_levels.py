"""The rests of a staircase: where they are, at which level, reached from which side."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.experiment.motion.approaches import Approaches, Visits, group_levels
from flexstage.records.quality import difference_noise

#: Steps larger than so many times the noise, and than this share of the range, lead to a new level.
_STEP_OVER_NOISE = 8.0
_STEP_SHARE = 1e-4
#: A rest may spread so much wider than its largest step, as noise does over many samples.
_SPREAD = 2.0
#: Levels closer than this share of the range, beyond noise, are one.
_SAME_LEVEL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dwells(Visits):
    """Rests of a staircase, in the order of time."""

    start: NDArray[np.intp]
    """First sample of each rest, shape (d,)."""
    stop: NDArray[np.intp]
    """The sample after the last of each rest, shape (d,)."""

    def settled(self, size: int, settling: float = 0.3) -> NDArray[np.bool_]:
        """Say which of so many samples are in a rest, past the share at its beginning that settles.

        Shape (size,).
        """
        found = np.zeros(size, dtype=np.bool_)
        for first, stop in zip(self._begin(settling), self.stop, strict=True):
            found[first:stop] = True
        return found

    def means(self, values: ArrayLike, settling: float = 0.3) -> Array:
        """Return the mean of a reading over each rest."""
        y = np.asarray(values, dtype=np.float64)
        pairs = zip(self._begin(settling), self.stop, strict=True)
        return np.array([y[a:b].mean() for a, b in pairs])

    def approaches(self, values: ArrayLike, settling: float = 0.3) -> Approaches:
        """Sort the means over the rests by target and by the side that it was reached from."""
        return self.sort(self.means(values, settling))

    def _begin(self, settling: float) -> NDArray[np.intp]:
        if not 0.0 <= settling < 1.0:
            raise RecordError(
                f"the share of a rest to leave out must be 0 or more and below 1, got {settling!r}"
            )
        return self.start + np.floor(settling * (self.stop - self.start)).astype(np.intp)


def staircase_dwells(
    command: ArrayLike, *, fewest_samples: int = 3, side: ArrayLike | None = None
) -> Dwells | None:
    """Find the rests of a staircase.

    None where the command is no staircase, as it moves in more than half of the samples. `side`,
    positive from below and negative from above, is found from the command where not given.

    Validity
    --------
    Steps of 8 times the noise of the command and more; smaller ones are not seen. That a stage
    turned round beyond a level and came back is seen where the command is beyond it for two samples
    or more, or where `side` says it.

    Examples
    --------
    >>> found = staircase_dwells(np.repeat([0.0, 1.0, 2.5, 1.0, 0.0], 20))
    >>> found.target.tolist(), found.direction.tolist()
    ([0, 1, 2, 1, 0], [0, 1, 1, -1, -1])
    """
    x = np.asarray(command, dtype=np.float64)
    if x.ndim != 1 or x.size < 8 or not np.isfinite(x).all():
        raise RecordError(
            "to find rests, a command needs 8 or more samples, all of them finite, got an array of "
            f"shape {x.shape}"
        )
    extent = float(np.ptp(x))
    step = max(_STEP_OVER_NOISE * difference_noise(x, 2), _STEP_SHARE * extent)
    parted = np.abs(np.diff(x)) > step
    if side is not None:
        parted |= np.diff(np.sign(np.asarray(side, dtype=np.float64))) != 0.0
    edges = np.concatenate(([0], np.flatnonzero(parted) + 1, [x.size]))
    rests = [
        (a, b)
        for a, b in itertools.pairwise(edges)
        if b - a >= fewest_samples and np.ptp(x[a:b]) <= _SPREAD * step
    ]
    if len(rests) < 2 or sum(b - a for a, b in rests) < 0.5 * x.size:
        return None
    means = np.array([x[a:b].mean() for a, b in rests])
    levels, target = group_levels(means, max(step, _SAME_LEVEL * extent))
    if levels.size < 2:
        return None
    bounds = np.array(rests, dtype=np.intp)
    if side is None:
        direction = _directions(x, bounds, target, means)
    else:
        direction = np.sign(np.asarray(side, dtype=np.float64)[bounds[:, 0]]).astype(np.intp)
    return Dwells(
        start=bounds[:, 0], stop=bounds[:, 1], target=target, direction=direction, levels=levels
    )


def _directions(
    x: Array, bounds: NDArray[np.intp], target: NDArray[np.intp], means: Array
) -> NDArray[np.intp]:
    """From which side rests were reached."""
    steps = np.sign(np.diff(target)).astype(np.intp)
    direction = np.concatenate(([0], steps))
    starts, before = bounds[:, 0], np.concatenate(([0], bounds[:-1, 1]))
    for i in np.flatnonzero(direction == 0):
        # a rest that goes on at the same level was reached from where the one before was, unless
        # the command went beyond in between, and turns back; a single sample may be a spike
        direction[i] = direction[i - 1] if i else 0
        between = np.sign(x[before[i] : starts[i]] - means[i])
        following = steps[i:][steps[i:] != 0]
        beyond = int(between[0]) if between.size > 1 and np.ptp(between) == 0.0 else 0
        if beyond and direction[i] != -beyond and following[:1].tolist() in ([], [-beyond]):
            direction[i] = -beyond
    return direction
