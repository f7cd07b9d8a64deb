"""Figures of a loop: its width, and the tracking error."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.errors import ModelError
from flexstage.hysteresis.model import Array, HysteresisModel, samples

#: Number of levels at which the two branches of a loop are compared.
_LEVELS = 401


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracking:
    """Tracking error of an output.

    The width of the loop excludes every error that both of its branches share; the other two
    figures include it.
    """

    loop_width: float
    """Largest difference between the branches, of the mean cycle."""
    rms: float
    """Root mean square of output less reference."""
    largest: float
    """Largest absolute difference."""


def loop_branches(x: ArrayLike, y: ArrayLike, bounds: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the mean rising and falling branch of the cycles of a loop.

    Bounds are the first sample of each cycle, and the sample after the last, shape (c + 1,); a
    cycle begins at a lower turning point of x. Returned: levels of x that all cycles reach, and y
    on the rising and on the falling branch there, averaged over the cycles.
    """
    abscissa, ordinate = samples(x, "abscissa of a loop"), samples(y, "ordinate of a loop")
    edges = np.asarray(bounds, dtype=np.intp)
    if edges.size < 2:
        raise ModelError("a loop needs one whole cycle at least, got none")
    parts = [(abscissa[a : b + 1], ordinate[a : b + 1]) for a, b in itertools.pairwise(edges)]
    low = max(max(p[0], p[-1]) for p, _ in parts)
    high = min(float(p.max()) for p, _ in parts)
    if not low < high:
        raise ModelError("the cycles of the loop have no level in common")
    levels = np.linspace(low, high, _LEVELS)
    rising, falling = np.zeros(_LEVELS), np.zeros(_LEVELS)
    for p, q in parts:
        top = int(np.argmax(p))
        rising += _over(levels, p[: top + 1], q[: top + 1])
        falling += _over(levels, p[top:][::-1], q[top:][::-1])
    return levels, rising / len(parts), falling / len(parts)


def _over(levels: Array, x: Array, y: Array) -> Array:
    """Interpolate y over x, of which noise may make single steps fall."""
    order = np.argsort(x, kind="stable")
    return np.interp(levels, x[order], y[order])


def loop_width(x: ArrayLike, y: ArrayLike, bounds: ArrayLike) -> float:
    """Return the largest difference between the branches of the mean cycle.

    Parameters
    ----------
    x : array_like
        Abscissa of the loop, shape (n,).
    y : array_like
        Ordinate of the loop, shape (n,).
    bounds : array_like
        First sample of each cycle, and the sample after the last, shape (c + 1,).

    Returns
    -------
    float
        The width, in the unit of y.

    Examples
    --------
    >>> t = np.arange(401) / 100.0
    >>> x, y = -np.cos(2.0 * np.pi * t), -np.cos(2.0 * np.pi * (t - 0.02))
    >>> round(loop_width(x, y, [0, 100, 200, 300, 400]), 3)
    0.251
    """
    _, rising, falling = loop_branches(x, y, bounds)
    return float(np.max(np.abs(falling - rising)))


def settled_loop(
    model: HysteresisModel, inputs: tuple[float, float], points: int
) -> tuple[float, float]:
    """Return width and range of the settled response to triangles over a range of inputs.

    These are of the last two of four cycles, with a number of points in each branch.

    Examples
    --------
    A play of 1 to each side adds twice that to the width, and takes it from the range:

    >>> from flexstage.hysteresis import PrandtlIshlinskii
    >>> play = PrandtlIshlinskii(gain=1.0, thresholds=np.ones(1), weights=np.ones(1))
    >>> width, size = settled_loop(play, (0.0, 10.0), 101)
    >>> round(width, 9), size
    (2.0, 18.0)
    """
    line = np.linspace(*inputs, points)
    cycle = np.concatenate((line, line[::-1][1:]))
    u = np.concatenate((cycle, *(cycle[1:],) * 3))
    bounds = np.arange(5) * (cycle.size - 1)
    y = model.simulate(u).values[bounds[2] :]
    return loop_width(u[bounds[2] :], y, bounds[2:] - bounds[2]), float(np.ptp(y))


def tracking(reference: ArrayLike, y: ArrayLike, bounds: ArrayLike) -> Tracking:
    """Compare an output with its reference over whole cycles.

    Parameters
    ----------
    reference : array_like
        Requested output, shape (n,).
    y : array_like
        Actual output, in the same unit, shape (n,).
    bounds : array_like
        First sample of each cycle, and the sample after the last, shape (c + 1,).

    Returns
    -------
    Tracking
        Width of the loop over the reference, and the difference from it.
    """
    edges = np.asarray(bounds, dtype=np.intp)
    target, output = samples(reference, "reference"), samples(y, "output")
    within = slice(int(edges[0]), int(edges[-1]) + 1)
    error: NDArray[np.float64] = output[within] - target[within]
    return Tracking(
        loop_width=loop_width(target, output, edges),
        rms=float(np.sqrt(np.mean(error**2))),
        largest=float(np.max(np.abs(error))),
    )
