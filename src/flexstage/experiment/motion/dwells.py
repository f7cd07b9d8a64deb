"""The rests of a staircase: where they are, at which level, reached from which side."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.errors import RecordError
from flexstage.records import difference_noise

__all__ = ["Dwells", "staircase_dwells"]

Array = NDArray[np.float64]

#: Steps larger than so many times the noise, and than this share of the range, lead to a new level.
_STEP_OVER_NOISE = 8.0
_STEP_SHARE = 1e-4
#: A rest may spread so much wider than its largest step, as noise does over many samples.
_SPREAD = 2.0
#: Levels closer than this share of the range, beyond noise, are one.
_SAME_LEVEL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dwells:
    """Rests of a staircase, in the order of time.

    Parameters
    ----------
    start, stop : numpy.ndarray
        First sample of each rest and the sample after its last, shape (d,).
    target : numpy.ndarray
        Number of the level of each, counted from the lowest, shape (d,).
    direction : numpy.ndarray
        1 where it was reached from below, -1 from above, 0 for the first, shape (d,).
    levels : numpy.ndarray
        The command at the levels, rising, shape (m,).
    """

    start: NDArray[np.intp]
    stop: NDArray[np.intp]
    target: NDArray[np.intp]
    direction: NDArray[np.intp]
    levels: Array

    def settled(self, size: int, settling: float = 0.3) -> NDArray[np.bool_]:
        """Say which samples are in a rest, past its beginning.

        Parameters
        ----------
        size : int
            Number of samples of the record, n.
        settling : float
            Share of each rest that is left out at its beginning [1].

        Returns
        -------
        numpy.ndarray
            Whether a sample is in the later part of a rest, shape (n,).
        """
        found = np.zeros(size, dtype=np.bool_)
        for first, stop in zip(self._begin(settling), self.stop, strict=True):
            found[first:stop] = True
        return found

    def means(self, values: ArrayLike, settling: float = 0.3) -> Array:
        """Return the mean of a reading over each rest.

        Parameters
        ----------
        values : array_like
            The reading, shape (n,).
        settling : float
            Share of each rest that is left out at its beginning [1].

        Returns
        -------
        numpy.ndarray
            Its means, shape (d,).
        """
        y = np.asarray(values, dtype=np.float64)
        pairs = zip(self._begin(settling), self.stop, strict=True)
        return np.array([y[a:b].mean() for a, b in pairs])

    def approaches(
        self, values: ArrayLike, settling: float = 0.3
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """Sort the means over the rests by target and by the side that it was reached from.

        Parameters
        ----------
        values : array_like
            The reading, shape (n,).
        settling : float
            Share of each rest that is left out at its beginning [1].

        Returns
        -------
        upward, downward : numpy.ndarray
            Means of the targets that were reached from both sides, shape (m, r): r runs, the number
            that every such target has.
        targets : numpy.ndarray
            Numbers of these targets among the levels, shape (m,).

        Raises
        ------
        RecordError
            No target was reached from both sides.
        """
        y = self.means(values, settling)
        ups = [y[(self.target == i) & (self.direction > 0)] for i in range(self.levels.size)]
        downs = [y[(self.target == i) & (self.direction < 0)] for i in range(self.levels.size)]
        both = [i for i in range(self.levels.size) if ups[i].size and downs[i].size]
        if not both:
            raise RecordError(
                "no level of the staircase was reached both from below and from above: record "
                "steps up and steps down over the same levels"
            )
        runs = min(min(ups[i].size, downs[i].size) for i in both)
        return (
            np.array([ups[i][:runs] for i in both]),
            np.array([downs[i][:runs] for i in both]),
            np.array(both, dtype=np.intp),
        )

    def _begin(self, settling: float) -> NDArray[np.intp]:
        if not 0.0 <= settling < 1.0:
            raise RecordError(
                f"the share of a rest to leave out must be 0 or more and below 1, got {settling!r}"
            )
        return self.start + np.floor(settling * (self.stop - self.start)).astype(np.intp)


def staircase_dwells(command: ArrayLike, *, fewest_samples: int = 3) -> Dwells | None:
    """Find the rests of a staircase.

    Parameters
    ----------
    command : array_like
        The command, shape (n,); a measured one may be noisy.
    fewest_samples : int
        How many samples a rest must have.

    Returns
    -------
    Dwells or None
        The rests; None where the command is no staircase, as it moves in more than half of the
        samples.

    Validity
    --------
    Steps of 8 times the noise of the command and more; smaller ones are not seen.

    Raises
    ------
    RecordError
        The command has fewer than 8 samples, or one is not finite.

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
    edges = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(x)) > step) + 1, [x.size]))
    rests = [
        (a, b)
        for a, b in itertools.pairwise(edges)
        if b - a >= fewest_samples and np.ptp(x[a:b]) <= _SPREAD * step
    ]
    if len(rests) < 2 or sum(b - a for a, b in rests) < 0.5 * x.size:
        return None
    means = np.array([x[a:b].mean() for a, b in rests])
    levels, target = _levels(means, max(step, _SAME_LEVEL * extent))
    if levels.size < 2:
        return None
    direction = np.concatenate(([0], np.sign(np.diff(target)))).astype(np.intp)
    # a rest that goes on at the same level was reached from where the one before was
    for i in range(1, direction.size):
        direction[i] = direction[i] or direction[i - 1]
    bounds = np.array(rests, dtype=np.intp)
    return Dwells(
        start=bounds[:, 0], stop=bounds[:, 1], target=target, direction=direction, levels=levels
    )


def _levels(means: Array, tolerance: float) -> tuple[Array, NDArray[np.intp]]:
    order = np.argsort(means, kind="stable")
    group = np.concatenate(([0], np.cumsum(np.diff(means[order]) > tolerance)))
    target = np.empty(means.size, dtype=np.intp)
    target[order] = group
    levels = np.array([means[target == i].mean() for i in range(int(group[-1]) + 1)])
    return levels, target
