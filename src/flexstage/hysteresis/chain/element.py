"""Elements of a linear chain, and inputs of them that are known between samples."""

import itertools
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import (
    Array,
    HysteresisModel,
    Response,
    SegmentArrays,
    Segments,
    checked,
)

#: Largest number of derivatives in a step.
ORDERS = 12

#: Largest rate of an exponential [per sample] for which these are exact to rounding.
LARGEST_RATE = 0.5

#: Range of the times of an element other than zero [s]; 1e9 s are 30 years.
SHORTEST, LONGEST = 1e-12, 1e9

_SHARES = np.arange(1, 7) / 6.0
# Largest error of a segment over the output. At a kink of the output, 2^-40 of a step is below the
# rounding of its ends.
_TOLERANCE = 1e-10
_HALVINGS = 40
# Largest factor of an exponential over a third of a segment, and of its amplitude over the output:
# a larger one would cancel with the constant and lose digits.
_LARGEST_FACTOR, _LARGEST_AMPLITUDE = 3.0, 1e3


class ChainElement(ABC):
    """A linear relation from a sampled input x to a sampled output y.

    The samples are a constant step dt apart and the input is a straight line between them; for such
    an input the output is exact at the samples.

    A state is an array at the last sample, and its first element is the last input: for a jump of
    the input, set it to the new value. The next sample is one step later. Without a state the
    element has settled at the first sample, after a long time at that input.
    """

    __slots__ = ()

    @abstractmethod
    def settled(self, x: float, dt: float) -> Array:
        """Return the state after a constant input for a long time.

        The step dt [s] is used only for a delay, which is stored as past samples.
        """

    @abstractmethod
    def simulate(self, x: ArrayLike, dt: float, state: ArrayLike | None = None) -> Response:
        """Return the output for a sequence of inputs."""

    def _initial_state(self, first: float, dt: float, state: ArrayLike | None, what: str) -> Array:
        """Return a private copy of a state after checking its size, or the settled one."""
        at_rest = self.settled(first, dt)
        return at_rest if state is None else checked_state(state, at_rest.size, what)

    @abstractmethod
    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the ratio of output to input for a steady sine."""


def positive_step(dt: float) -> float:
    """Return a step between samples after checking it."""
    return checked(dt, "step between samples", "positive and finite", "s")


def checked_state(state: ArrayLike, size: int, what: str) -> Array:
    """Return a private copy of a state after checking its size."""
    copy = np.array(state, dtype=np.float64)
    if copy.shape != (size,) or not np.all(np.isfinite(copy)):
        raise ModelError(
            f"a state of {what} is {size} finite numbers at this step, got shape {copy.shape}"
        )
    return copy


@compiled
def terms_needed(force: SegmentArrays) -> int:
    """Return the number of derivatives of complete steps for the fastest exponential.

    Rates are per sample; exponentials above `LARGEST_RATE` are not counted. From 2 to `ORDERS`.
    """
    _, _, _, amplitude, rate = force
    fastest = 0.0
    for i in range(rate.size):
        if amplitude[i] != 0.0 and abs(rate[i]) <= LARGEST_RATE:
            fastest = max(fastest, abs(rate[i]))
    terms, size = 2, 1.0
    while terms < ORDERS and size > 1e-18:
        size *= fastest / (terms + 2.0)
        terms += 1
    return terms


@compiled
def piece_from(
    force: SegmentArrays, i: int, here: float, following: float
) -> tuple[int, float, float, float, float, float]:
    """Return the piece of a sequence from a time to the next sample or segment.

    That is its segment, counted on from segment i, its end, and a, b, c and mu of its values a + b
    s + c exp(-mu s) at s after the time.
    """
    start, constant, slope, amplitude, rate = force
    last = start.size - 1
    while i < last and start[i + 1] <= here:
        i += 1
    end = following
    if i < last and start[i + 1] < end:
        end = start[i + 1]
    since = here - start[i]
    c = amplitude[i]
    if since != 0.0 and c != 0.0:
        c *= np.exp(-rate[i] * since)
    return i, end, constant[i] + slope[i] * since, slope[i], c, rate[i]


def values_at_samples(force: Segments) -> Array:
    """Return the values of a sequence that is known between the samples."""
    value = np.empty(force.samples)
    _values(force.arrays, value)
    return value


@compiled
def _values(force: SegmentArrays, value: Array) -> None:
    i = 0
    for n in range(value.size):
        i, _, at, _, amplitude, _ = piece_from(force, i, float(n), n + 1.0)
        value[n] = at + amplitude


def forcing(model: HysteresisModel, u: Array, state: Array) -> Segments:
    """Return the output of a model as segments from the first to the last sample.

    The state is that before the first of u. The segments are the closed form of the model, or else
    are fitted to its output.
    """
    segments = model.segments(u, state)
    return fitted_segments(model, u, state) if segments is None else segments


def fitted_segments(model: HysteresisModel, u: Array, state: Array) -> Segments:
    """Return the output of a model between the samples within 1e-10 of its size in each step.

    A segment equals the output at its ends and thirds, and is compared with it at sixths. If its
    error is too large, for instance at a zero of the hysteretic displacement, it is halved. The
    state is that before the first of at least two inputs.
    """
    first = model.simulate(u[:1], state)
    parts, end = _fitted(model, np.arange(float(u.size)), u, first, None, _HALVINGS)
    start, constant, slope, amplitude, rate = np.concatenate(parts, axis=1)
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
    """Return the segments between inputs at several places, and the response at the last."""
    line = u[:-1, None] + np.diff(u)[:, None] * _SHARES
    line[:, -1] = u[1:]
    response = model.simulate(line.ravel(), before.state)
    y = response.values.reshape(line.shape)
    y = np.column_stack((np.append(before.values[-1], y[:-1, -1]), y))
    sizes = np.abs(y).max(axis=1) if size is None else size
    segments, error = _through(y, at, sizes)
    inaccurate = error > _TOLERANCE * sizes
    if halvings == 0 or not inaccurate.any():
        return [segments], response
    pieces, response_here = [], before
    edges = (0, *(np.flatnonzero(np.diff(inaccurate)) + 1).tolist(), inaccurate.size)
    for a, b in itertools.pairwise(edges):
        if not inaccurate[a]:
            pieces.append(segments[:, a:b])
            response_here = model.simulate(u[a + 1 : b + 1], response_here.state)
            continue
        middle = 0.5 * (at[a:b] + at[a + 1 : b + 1])
        halves = np.insert(at[a : b + 1], range(1, b - a + 1), middle)
        inputs = np.insert(u[a : b + 1], range(1, b - a + 1), line[a:b, 2])
        parts, response_here = _fitted(
            model, halves, inputs, response_here, np.repeat(sizes[a:b], 2), halvings - 1
        )
        pieces += parts
    return pieces, response_here


def _through(y: Array, at: Array, size: Array) -> tuple[Array, Array]:
    """Return segments through outputs at sixths, shape (5, m), and their errors."""
    length = np.diff(at)
    first = y[:, 4] - 2.0 * y[:, 2] + y[:, 0]
    last = y[:, 6] - 2.0 * y[:, 4] + y[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = last / first
        # a straight line if the output is straight or has a point of inflection
        curved = (r > 1.0 / _LARGEST_FACTOR) & (r < _LARGEST_FACTOR)
        least = np.sqrt(np.abs(first) / (_LARGEST_AMPLITUDE * size))
    r = np.where(curved, r, 2.0)
    r = np.where(np.abs(r - 1.0) < least, 1.0 + np.copysign(least, r - 1.0), r)
    amplitude = np.where(curved, (first + last) / ((1.0 + r) * (1.0 - r) ** 2), 0.0)
    constant = y[:, 0] - amplitude
    slope = y[:, 6] - y[:, 0] - amplitude * (r * r * r - 1.0)
    error = np.zeros(size.size)
    for k in range(1, 6):
        here = constant + slope * (k / 6.0) + amplitude * np.sqrt(r) ** k
        error = np.maximum(error, np.abs(here - y[:, k]))
    rate = -3.0 * np.log(r) / length
    return np.array((at[:-1], constant, slope / length, amplitude, rate)), error
