"""A hysteresis without closed form between the samples, as segments that are fitted to it."""

import itertools

import numpy as np

from flexstage.hysteresis.model import Array, HysteresisModel, Response, Segments

_SHARES = np.arange(1, 7) / 6.0
# A segment is good where it is off by at most this part of the output. Where the output has a kink,
# 2^-40 of a step is past the rounding of its ends.
_GOOD = 1e-10
_DEEPEST = 40
# Most of an exponential over a third of a segment, and of its amplitude as a multiple of the
# output: a larger one would cancel with the constant and leave its rounding.
_STEEPEST, _LARGEST = 3.0, 1e3


def forcing(model: HysteresisModel, u: Array, state: Array) -> Segments:
    """Return the output of a model from the first to the last sample, known between them.

    The state is that before the first of u; closed form where the model has one, else segments that
    are fitted to its output.
    """
    found = model.segments(u, state)
    return fitted_segments(model, u, state) if found is None else found


def fitted_segments(model: HysteresisModel, u: Array, state: Array) -> Segments:
    """Return the output of a model between the samples within 1e-10 of its size in each step.

    A segment meets the output at its ends and at the thirds between, and is compared with it at
    sixths; where it is not good enough, because the hysteretic displacement passes zero there, say,
    it is halved. The state is that before the first of at least two inputs.
    """
    first = model.simulate(u[:1], state)
    found, end = _fitted(model, np.arange(float(u.size)), u, first, None, _DEEPEST)
    start, constant, slope, amplitude, rate = np.concatenate(found, axis=1)
    return Segments(
        start=start,
        constant=constant,
        slope=slope,
        amplitude=amplitude,
        rate=rate,
        samples=u.size,
        state=end.state,
    )


def _fitted(
    model: HysteresisModel, at: Array, u: Array, before: Response, size: Array | None, halvings: int
) -> tuple[list[Array], Response]:
    """Return the segments between inputs at some places, and the response at the last of them."""
    line = u[:-1, None] + np.diff(u)[:, None] * _SHARES
    line[:, -1] = u[1:]
    response = model.simulate(line.ravel(), before.state)
    y = response.values.reshape(line.shape)
    y = np.column_stack((np.append(before.values[-1], y[:-1, -1]), y))
    sizes = np.abs(y).max(axis=1) if size is None else size
    segments, off = _through(y, at, sizes)
    bad = off > _GOOD * sizes
    if halvings == 0 or not bad.any():
        return [segments], response
    found, now = [], before
    edges = (0, *(np.flatnonzero(np.diff(bad)) + 1).tolist(), bad.size)
    for a, b in itertools.pairwise(edges):
        if not bad[a]:
            found.append(segments[:, a:b])
            now = model.simulate(u[a + 1 : b + 1], now.state)
            continue
        middle = 0.5 * (at[a:b] + at[a + 1 : b + 1])
        halves = np.insert(at[a : b + 1], range(1, b - a + 1), middle)
        inputs = np.insert(u[a : b + 1], range(1, b - a + 1), line[a:b, 2])
        parts, now = _fitted(model, halves, inputs, now, np.repeat(sizes[a:b], 2), halvings - 1)
        found += parts
    return found, now


def _through(y: Array, at: Array, size: Array) -> tuple[Array, Array]:
    """Return segments through outputs at sixths, shape (5, m), and how far they are off between."""
    length = np.diff(at)
    first = y[:, 4] - 2.0 * y[:, 2] + y[:, 0]
    last = y[:, 6] - 2.0 * y[:, 4] + y[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = last / first
        # a straight line where the output has a point of inflection, or is straight
        curved = (r > 1.0 / _STEEPEST) & (r < _STEEPEST)
        least = np.sqrt(np.abs(first) / (_LARGEST * size))
    r = np.where(curved, r, 2.0)
    r = np.where(np.abs(r - 1.0) < least, 1.0 + np.copysign(least, r - 1.0), r)
    amplitude = np.where(curved, (first + last) / ((1.0 + r) * (1.0 - r) ** 2), 0.0)
    constant = y[:, 0] - amplitude
    slope = y[:, 6] - y[:, 0] - amplitude * (r * r * r - 1.0)
    off = np.zeros(size.size)
    for k in range(1, 6):
        here = constant + slope * (k / 6.0) + amplitude * np.sqrt(r) ** k
        off = np.maximum(off, np.abs(here - y[:, k]))
    rate = -3.0 * np.log(r) / length
    return np.array((at[:-1], constant, slope / length, amplitude, rate)), off
