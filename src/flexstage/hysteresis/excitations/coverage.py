"""Which part of a hysteretic memory a drive signal looks at."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.errors import ModelError
from flexstage.hysteresis.model import Array, samples


def memory_coverage(u: ArrayLike, cells: int = 16) -> NDArray[np.bool_]:
    r"""Return which cells of threshold and mean a drive signal sets in motion one by one.

    Since the input turned at :math:`u_r`, all plays with thresholds below
    :math:`r = |u - u_r| / 2` move. As u goes on, the play with threshold r begins to move, from
    the mean :math:`s = (u + u_r) / 2`, and the slope of the output changes by its weight there:
    by the Preisach density at (r, s) (Mayergoyz 1991, section 1.2: the second derivative of the
    reversal curves). A cell counts as looked at where such a front has gone through it. A front
    that meets an earlier turning point goes on from the one before that (wiping-out).

    Parameters
    ----------
    u : array_like
        Drive signal [V], shape (n,), or its turning points.
    cells : int
        Number of cells K between threshold zero and half of the range.

    Returns
    -------
    numpy.ndarray
        True where a cell was looked at, False where not or where it lies outside the triangle
        ``|s - middle| <= range / 2 - r``, shape (K, 2 K): row by threshold, column by mean. There
        are ``K (K + 1)`` cells in the triangle.

    Raises
    ------
    ModelError
        The signal is no finite sequence, does not move, or `cells` is not positive.

    Notes
    -----
    Validity: says where a signal looks, and not how exactly: a cell counts once, at any rate and
    any noise. What was before the signal is not known, so its first movement counts for nothing.

    Examples
    --------
    A major loop sees the edges of the triangle alone:

    >>> seen = memory_coverage([0.0, 120.0, 0.0, 120.0, 0.0])
    >>> int(seen.sum()), 16 * 17
    (32, 272)
    """
    turning = _turning(samples(u, "drive signal"))
    if cells < 1:
        raise ModelError(f"a grid of memory needs at least one cell, got {cells}")
    low, high = float(turning.min()), float(turning.max())
    if not high > low:
        raise ModelError(f"the drive signal must move, got {low:g} throughout")
    x = (turning - low) / (high - low)
    seen = np.zeros((cells, 2 * cells), dtype=np.bool_)
    extremes: list[float] = []
    for start, end in zip(x[:-1].tolist(), x[1:].tolist(), strict=True):
        for base, a, b in _fronts(extremes, start, end):
            _mark(seen, base, a, b)
        extremes.append(end)
    return seen


def _turning(u: Array) -> Array:
    """Return the first value, every turning point, and the last value."""
    moved = u[np.concatenate(([True], np.diff(u) != 0.0))]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moved))) != 0) + 1
    return moved[np.unique(np.concatenate(([0], turns, [moved.size - 1])))]


def _fronts(extremes: list[float], start: float, end: float) -> list[tuple[float, float, float]]:
    """Move from start to end; return turning point, beginning and end of each piece of the front.

    The stack holds the turning points that are remembered, the last of them `start`; those that
    the movement wipes out are taken off.
    """
    pieces: list[tuple[float, float, float]] = []
    sign = 1.0 if end > start else -1.0
    at = start
    while extremes:
        base = extremes[-1]
        limit = extremes[-2] if len(extremes) > 1 else None
        if limit is None or sign * (end - limit) < 0.0:
            pieces.append((base, at, end))
            return pieces
        pieces.append((base, at, limit))
        del extremes[-2:]
        at = limit
    return pieces


def _mark(seen: NDArray[np.bool_], base: float, a: float, b: float) -> None:
    k = seen.shape[0]
    n = max(int(np.ceil(abs(b - a) * 16 * k)), 1)
    u = a + (b - a) * (np.arange(n) + 0.5) / n
    row = np.minimum((np.abs(u - base) * k).astype(np.intp), k - 1)
    column = np.clip(((u + base) * k).astype(np.intp), row, 2 * k - 1 - row)
    seen[row, column] = True
