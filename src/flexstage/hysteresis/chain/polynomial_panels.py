"""A hysteresis that has no closed form between the samples, on panels of polynomials."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.chain.lag import read_lags
from flexstage.hysteresis.chain.modal import read_modes
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, HysteresisModel

# Points of a panel (Gauss, Legendre): a polynomial of ninth degree is met exactly.
_POINTS = 10
# A panel is good where the two highest of its Legendre coefficients, times its length, are this
# part of the output; 2^-40 of a step is past the rounding of its ends. A kink beyond the outermost
# points shows only at the ends, whose error acts over a small part of the panel.
_GOOD = 4e-15
_END_SHARE = 0.05
_DEEPEST = 40

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_POINTS)
_SHARES = 0.5 + 0.5 * _NODES
# from values at the points to Legendre coefficients
_TO_LEGENDRE = (
    (np.arange(_POINTS) + 0.5)[:, None]
    * np.polynomial.legendre.legvander(_NODES, _POINTS - 1).T
    * _WEIGHTS
)
_TO_ENDS = np.polynomial.legendre.legvander(np.array((-1.0, 1.0)), _POINTS - 1) @ _TO_LEGENDRE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panels:
    """An output between the samples by its values at points of panels."""

    level: Array
    """Each panel is 2^-level of a step, shape (m,)."""
    values: Array
    """Output at the points, shape (m, points)."""
    ends: Array
    """True where a panel ends at a sample, shape (m,)."""
    samples: Array
    """Output at the samples, shape (n,)."""
    state: Array
    """State of the model at the last sample."""


def panels(model: HysteresisModel, u: Array, state: Array) -> Panels:
    """Return the output of a model on panels between the samples.

    The model is evaluated exactly at the points. Where a panel is not smooth enough, because the
    hysteretic displacement passes zero in it, say, it is halved until it is. The state is that
    before the first of at least two inputs.
    """
    first = model.simulate(u[:1], state)
    line = u[:-1, None] + np.diff(u)[:, None] * np.append(_SHARES, 1.0)
    line[:, -1] = u[1:]
    smooth = model.simulate(line.ravel(), first.state)
    values = smooth.values.reshape(line.shape)
    at_samples = np.append(first.values, values[:, -1])
    scale = max(float(np.abs(at_samples).max()), math.ulp(0.0))
    bad = np.flatnonzero(_roughness(at_samples[:-1], values) > _GOOD * scale)
    pieces: list[tuple[Array, Array]] = []
    now, done = first.state, 0
    for k in bad.tolist():
        if k > done:
            pieces.append((np.zeros(k - done), values[done:k, :-1]))
            now = model.simulate(u[done + 1 : k + 1], now).state
        pieces.append(_halved(model, u[k : k + 2], now, at_samples[k], scale))
        now = model.simulate(u[k + 1 : k + 2], now).state
        done = k + 1
    pieces.append((np.zeros(u.size - 1 - done), values[done:, :-1]))
    level = np.concatenate([piece[0] for piece in pieces])
    # panels fill each step, so their lengths add up to whole numbers, exactly in binary
    length = np.cumsum(0.5**level)
    return Panels(
        level=level,
        values=np.ascontiguousarray(np.concatenate([piece[1] for piece in pieces])),
        ends=(length == np.floor(length)).astype(np.float64),
        samples=at_samples,
        state=smooth.state,
    )


def _roughness(begin: Array, values: Array) -> Array:
    """How far panels are from polynomials; from their values at the start, points and end."""
    points = values[..., :-1]
    tail = np.abs(points @ _TO_LEGENDRE[-2:].T).max(axis=-1)
    ends = points @ _TO_ENDS.T - np.stack((begin, values[..., -1]), axis=-1)
    return np.maximum(tail, _END_SHARE * np.abs(ends).max(axis=-1))


def _halved(
    model: HysteresisModel, u: Array, state: Array, begin: float, scale: float
) -> tuple[Array, Array]:
    """Return levels and values of the panels of one step from u[0] to u[1]."""
    level: list[float] = []
    found: list[Array] = []
    waiting = [(0, 0.0)]
    now, y, here = state, begin, 0.0
    rise = u[1] - u[0]
    while waiting:
        depth, at = waiting.pop()
        length = 0.5**depth
        if at > here:
            moved = model.simulate([u[0] + rise * at], now)
            now, y, here = moved.state, float(moved.values[0]), at
        points = at + length * np.append(_SHARES, 1.0)
        values = model.simulate(u[0] + rise * points, now).values
        rough = float(_roughness(np.array(y), values))
        if depth >= _DEEPEST or length * rough <= _GOOD * scale:
            level.append(float(depth))
            found.append(values[:-1])
        else:
            waiting += [(depth + 1, at + 0.5 * length), (depth + 1, at)]
    return np.array(level), np.array(found)


def modes_through_panels(
    force: Panels, angle: Array, damping_ratio: Array, z: Array, v: Array, reader: Array, y: Array
) -> None:
    """Step modes through a force on panels, and add their readings.

    Arguments as in `coupled_stepping.modes_through`.
    """
    levels, index = np.unique(force.level, return_inverse=True)
    k = angle.size
    transition = np.empty((levels.size, 4, k))
    weights = np.empty((levels.size, 2, k, _POINTS))
    for i, level in enumerate(levels.tolist()):
        h = 0.5**level
        transition[i], weights[i] = _mode_tables(angle * h, damping_ratio)
        # rates are per sample, tables per panel
        transition[i, 1] *= h
        transition[i, 2] /= h
        weights[i, 1] /= h
    _modes_through(
        np.asarray(index, dtype=np.int64),
        force.values,
        force.ends,
        transition,
        weights,
        z,
        v,
        reader,
        y,
    )


def lags_through_panels(force: Panels, ratio: Array, lag: Array, reader: Array, y: Array) -> None:
    """Step lags through an input on panels, and add their readings.

    Arguments as in `lag.lags_through_segments`.
    """
    levels, index = np.unique(force.level, return_inverse=True)
    decay = np.exp(-ratio * 0.5 ** levels[:, None])
    weights = np.empty((levels.size, ratio.size, _POINTS))
    for i, level in enumerate(levels.tolist()):
        r = ratio * 0.5**level
        t, w = _fine_rule(float(r.max(initial=0.0)))
        kernel = r[:, None] * np.exp(-r[:, None] * (1.0 - t)) * w
        weights[i] = kernel @ _lagrange(t)
    _lags_through(
        np.asarray(index, dtype=np.int64), force.values, force.ends, decay, weights, lag, reader, y
    )


def _fine_rule(turn: float) -> tuple[Array, Array]:
    """Gauss points and weights on 0..1 that are exact for a kernel that turns this far."""
    t, w = np.polynomial.legendre.leggauss(24 + math.ceil(turn))
    return 0.5 + 0.5 * t, 0.5 * w


def _lagrange(t: Array) -> Array:
    """Values at t of the polynomials that are one at one point of a panel and zero at others."""
    return np.polynomial.legendre.legvander(2.0 * t - 1.0, _POINTS - 1) @ _TO_LEGENDRE


def _mode_tables(w: Array, zeta: Array) -> tuple[Array, Array]:
    """Transition of a panel, and weights of its points for z and z'."""
    g, dg = _impulse(w[:, None], zeta[:, None], np.ones(1))
    g, dg = g[:, 0], dg[:, 0]
    a = zeta * w
    transition = np.array((dg + 2.0 * a * g, g, -(w**2) * g, dg))
    t, weight = _fine_rule(float(np.max(w * np.maximum(1.0, 2.0 * zeta))))
    g, dg = _impulse(w[:, None], zeta[:, None], 1.0 - t)
    basis = _lagrange(t)
    force = w[:, None] ** 2
    return transition, np.array(((force * g * weight) @ basis, (force * dg * weight) @ basis))


def _impulse(w: Array, zeta: Array, t: Array) -> tuple[Array, Array]:
    """Response to an impulse and its rate, for any damping."""
    own = w**2 * (1.0 - zeta**2)
    x = np.sqrt(np.abs(own)) * t
    swing = own > 0.0
    fall = np.exp(-zeta * w * t)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # exp(-a t) sinh(x) without overflow: both exponents are negative
        up, down = np.exp(x - zeta * w * t), np.exp(-x - zeta * w * t)
        hyperbolic = np.where(x > 1e-4, 0.5 * (up - down) / x, fall * (1.0 + x**2 / 6.0))
        sine = np.where(swing, fall * np.sinc(x / np.pi), hyperbolic)
        cosine = np.where(swing, fall * np.cos(x), 0.5 * (up + down))
    g = t * sine
    return g, cosine - zeta * w * g


@compiled
def _modes_through(
    index: NDArray[np.int64],
    values: Array,
    ends: Array,
    transition: Array,
    weights: Array,
    z: Array,
    v: Array,
    reader: Array,
    y: Array,
) -> None:
    n = 0
    for i in range(index.size):
        table, weight, force = transition[index[i]], weights[index[i]], values[i]
        for m in range(z.size):
            at, speed = z[m], v[m]
            by_z = by_v = 0.0
            for j in range(force.size):
                by_z += weight[0, m, j] * force[j]
                by_v += weight[1, m, j] * force[j]
            z[m] = (table[0, m] * at + table[1, m] * speed) + by_z
            v[m] = (table[2, m] * at + table[3, m] * speed) + by_v
        if ends[i] != 0.0:
            read_modes(z, v, reader, y, n)
            n += 1


@compiled
def _lags_through(
    index: NDArray[np.int64],
    values: Array,
    ends: Array,
    decay: Array,
    weights: Array,
    lag: Array,
    reader: Array,
    y: Array,
) -> None:
    n = 0
    for i in range(index.size):
        weight, force = weights[index[i]], values[i]
        for m in range(lag.size):
            total = decay[index[i], m] * lag[m]
            for j in range(force.size):
                total += weight[m, j] * force[j]
            lag[m] = total
        if ends[i] != 0.0:
            read_lags(lag, reader, y, n)
            n += 1
