"""Least squares of harmonics: normal equations in one pass, and noise from the residuals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import RecordError

#: Samples per block: its tables fit in the cache of the processor.
_CHUNK = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalEquations:
    """Sums of the products of the fitted functions, with each other and with the values.

    The functions are 1, the turn number if there is a drift, then cosine and sine of each order.
    """

    gram: Array
    """Products of the functions, for each group of samples, shape (groups, p, p)."""
    right: Array
    """Products of the functions with each column of values, shape (groups, p, m)."""
    scatter: Array | None = None
    """Covariance of `right` for noise of variance 1, shape (p, p); None if it is the gram."""

    def unit_covariance(self) -> Array:
        """Return the covariance of the coefficients for white noise of variance 1."""
        inverse = np.linalg.inv(self.gram.sum(axis=0))
        return inverse if self.scatter is None else inverse @ self.scatter @ inverse.T


def accumulated(
    turns: Array,
    values: Array,
    orders: Sequence[int],
    *,
    drift: bool,
    weights: Array | None = None,
    bounds: Sequence[int] | None = None,
) -> NormalEquations:
    """Sum the normal equations of the harmonic fit over samples.

    `turns` is the angle of each sample [turn], `values` columns over it, shape (n, m). A weight of
    zero excludes a sample. `bounds` are the first sample of each group and the number of samples;
    all are one group without it.

    Products of cosines are cosines of sums and differences of orders. The sums are therefore of
    cosines and sines up to twice the highest order, each from the two before it.
    """
    edges = [0, turns.size] if bounds is None else list(bounds)
    highest = max(orders, default=0)
    m = values.shape[1]
    groups = len(edges) - 1
    # rows: cosine and sine of each order; columns: weight, weight x turn, weighted values
    table = np.zeros((groups, 2, 2 * highest + 1, 2 + m))
    drifts = np.zeros((groups, 1 + m))
    for g in range(groups):
        for start in range(edges[g], edges[g + 1], _CHUNK):
            part = slice(start, min(start + _CHUNK, edges[g + 1]))
            u, y = turns[part], values[part]
            w = np.ones(u.size) if weights is None else weights[part]
            columns = np.column_stack((w, w * u, y * w[:, None]))
            waves = _waves(u, 2 * highest)
            # the values are needed up to the highest order only
            table[g, :, :, :2] += waves @ columns[:, :2]
            table[g, :, : highest + 1, 2:] += waves[:, : highest + 1] @ columns[:, 2:]
            drifts[g] += u @ columns[:, 1:]
    return NormalEquations(
        gram=_gram(table, drifts, orders, drift),
        right=_right(table, drifts, orders, drift),
    )


def evaluated(turns: Array, coefficients: Array, orders: Sequence[int], *, drift: bool) -> Array:
    """Return the sum of the functions, in the order of `NormalEquations`, shape (n, m)."""
    # columns are contiguous, as later steps work on columns
    out = np.empty((coefficients.shape[1], turns.size)).T
    first = 2 if drift else 1
    at = np.asarray(orders, dtype=np.intp)
    for start in range(0, turns.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        waves = _waves(turns[part], max(orders, default=0))
        out[part] = (
            coefficients[0]
            + waves[0, at].T @ coefficients[first::2]
            + waves[1, at].T @ coefficients[first + 1 :: 2]
        )
        if drift:
            out[part] += turns[part, None] * coefficients[1]
    return out


def _waves(turns: Array, highest: int) -> Array:
    """Return cosine and sine of the orders 0 to the highest, shape (2, highest + 1, n)."""
    out = np.empty((2, highest + 1, turns.size))
    out[0, 0], out[1, 0] = 1.0, 0.0
    if highest == 0:
        return out
    # full turns are subtracted while they are exact
    x = 2.0 * np.pi * (turns - np.rint(turns))
    np.cos(x, out=out[0, 1])
    np.sin(x, out=out[1, 1])
    twice = 2.0 * out[0, 1]
    for k in range(2, highest + 1):
        np.multiply(out[:, k - 1], twice, out=out[:, k])
        out[:, k] -= out[:, k - 2]
    return out


def _gram(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    c, s = table[:, 0, :, 0], table[:, 1, :, 0]
    total, apart = k[:, None] + k[None, :], k[:, None] - k[None, :]
    near = c[:, np.abs(apart)]
    sine = np.sign(apart) * s[:, np.abs(apart)]
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, first + 2 * k.size))
    out[:, first::2, first::2] = 0.5 * (near + c[:, total])
    out[:, first + 1 :: 2, first + 1 :: 2] = 0.5 * (near - c[:, total])
    # cos(a) sin(b) = (sin(a + b) - sin(a - b)) / 2
    mixed = 0.5 * (s[:, total] - sine)
    out[:, first::2, first + 1 :: 2] = mixed
    out[:, first + 1 :: 2, first::2] = np.swapaxes(mixed, 1, 2)
    edge = [(0, c[:, 0], 0)] + ([(1, table[:, 0, 0, 1], 1)] if drift else [])
    for row, total_wave, column in edge:
        out[:, row, 0] = out[:, 0, row] = total_wave
        for offset, wave in ((first, 0), (first + 1, 1)):
            out[:, row, offset::2] = out[:, offset::2, row] = table[:, wave][:, k, column]
    if drift:
        out[:, 1, 1] = drifts[:, 0]
    return out


def _right(table: Array, drifts: Array, orders: Sequence[int], drift: bool) -> Array:
    k = np.asarray(orders, dtype=np.intp)
    first = 2 if drift else 1
    out = np.zeros((table.shape[0], first + 2 * k.size, table.shape[3] - 2))
    out[:, 0] = table[:, 0, 0, 2:]
    if drift:
        out[:, 1] = drifts[:, 1:]
    out[:, first::2] = table[:, 0, k, 2:]
    out[:, first + 1 :: 2] = table[:, 1, k, 2:]
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicProblem:
    """Columns of values over turns, and the functions fitted to them."""

    u: Array
    """Angle of each sample [turn], shape (n,)."""
    y: Array
    """The values, shape (n, m)."""
    orders: tuple[int, ...]
    """Orders, rising."""
    drift: bool
    """Whether a change in proportion to the angle is fitted."""
    middle: float
    """Middle of the angles [turn], at which the offset is defined."""
    bounds: Sequence[int] | None
    """First sample of each turn and, at the end, the number of samples; None for one group."""
    resolution: float = 0.0
    """Step of the values."""
    readings: tuple[Array, Array] | None = None
    """`Turns.readings` of each sample, shape (n,) each; None for plain least squares."""

    def column(self, j: int) -> "HarmonicProblem":
        """Return the problem of one column alone."""
        return replace(self, y=self.y[:, j : j + 1])

    def sums(self, weights: Array | None) -> NormalEquations:
        """Return the normal equations.

        With `readings`, all angles have the same weight, however often they are read, and the
        equation of the drift is that of the differences between readings of one angle. These are
        the least squares of a scale with an error of its own at each angle (fixed effects), of
        whose turn the harmonics are fitted: orders that are not fitted do not leak into them. An
        angle at which a reading is rejected keeps its weight, and has no part in the drift.
        """
        of = partial(accumulated, self.u, orders=self.orders, drift=self.drift, bounds=self.bounds)
        if self.readings is None:
            return of(self.y, weights=weights)
        inliers = np.ones(self.u.size) if weights is None else weights
        readings, later = self.readings
        for lost in self.u[inliers == 0.0]:
            again = np.abs((self.u - lost + 0.5) % 1.0 - 0.5) < 0.5 * np.ptp(self.u) / self.u.size
            readings, later = readings - again, later * ~again
        w, none = inliers / np.maximum(readings, 1.0), self.y[:, :0]
        sums, scatter = of(self.y, weights=w), of(none, weights=w * w).gram[0]
        if self.drift:
            # where no pair is left, its parts remain
            a = (later if np.any(later) else self.readings[1]) * inliers
            change = of(self.y, weights=a)
            sums.gram[0, 1], sums.right[0, 1] = change.gram[0, 0], change.right[0, 0]
            scatter[1] = scatter[:, 1] = of(none, weights=a * w).gram[0, 0]
            scatter[1, 1] = a @ a
        return replace(sums, scatter=scatter)

    def residual(self, coefficients: Array) -> Array:
        """Return the residuals of the values, shape (n, m), for coefficients of shape (p, m)."""
        fitted = evaluated(self.u, coefficients, self.orders, drift=self.drift)
        return np.subtract(self.y, fitted, out=fitted)

    @property
    def first(self) -> int:
        """Number of coefficients before those of the harmonics."""
        return 2 if self.drift else 1


def solved(equations: NormalEquations, orders: tuple[int, ...]) -> Array:
    """Return the coefficients, shape (p, m); `orders` are for the message."""
    # condition number from which functions are not separable in double precision
    worst_condition = 1e9
    gram = equations.gram.sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    if np.linalg.cond(gram * np.outer(scale, scale)) > worst_condition:
        raise RecordError(
            f"the samples do not separate the harmonics up to order {orders[-1]}: they need more "
            f"than {2 * orders[-1]} different angles per turn, without large gaps; fit fewer orders"
        )
    return np.linalg.solve(gram, equations.right.sum(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noise:
    """Spectrum of the residuals of a record, and the spectra that were tried for its noise."""

    frequency: Array
    """Frequencies [cycles per turn], shape (k,)."""
    amplitude: Complex
    """Amplitude at each, whose square is the density of the power, shape (k,)."""
    line: Array
    """Prior probability that it belongs to the scale, shape (k,)."""
    level: Array
    """Density of the white part of each spectrum, in the square of the unit, shape (s,)."""
    known: Array
    """Number of frequencies that determine each level, shape (s,)."""

    def logarithms(self) -> tuple[Array, Array]:
        """Return the logarithms of the likelihood of noise and of the scale, shape (s, k)."""
        # decades over which an error of the scale may exceed the noise
        decades = 6.0
        density = self.level[:, None] * _shapes(self.frequency)
        x = np.maximum(np.abs(self.amplitude) ** 2 / density, 1e-9)
        return -x - np.log(density), -4.0 / x - np.log(x * density * decades * math.log(10.0))


def from_turns(
    equations: NormalEquations, coefficients: Array, white: Array, slow: int
) -> tuple[Array, float]:
    """Return factors on the variance of each function from the scatter of turns, and their freedom.

    `equations` are of each turn and one column, `white` is the covariance of the coefficients for
    white noise; the first `slow` functions are no harmonics. Factors are not pooled.

    It is the variance from the scores of full turns, as of clustered samples (Liang and Zeger 1986,
    Biometrika 73), over that of white noise. It includes correlation within a turn.
    """
    groups = equations.gram.shape[0]
    scores = equations.right[:, :, 0] - equations.gram @ coefficients
    solved = np.linalg.solve(equations.gram.sum(axis=0), scores.T)
    variance = np.sum(solved**2, axis=1)
    # a slow drift is correlated between turns, and adds to the mean but not to harmonics
    lasting = 2.0 * np.sum(solved[:, 1:] * solved[:, :-1], axis=1)
    variance[:slow] += np.maximum(lasting[:slow], 0.0)
    variance *= groups / (groups - 1)
    return variance / np.maximum(np.diag(white), np.finfo(float).tiny), groups - 1.0


#: Least number of free frequencies that determine a spectrum.
_LEAST_FREE = 24
#: Highest frequency of the spectrum near order 1 [cycles per turn].
_HIGHEST = 128
#: Prior probability of white noise, of a random walk with it, of noise that falls beyond a
#: frequency, and of noise that rises up to one. With them simulated intervals hold white noise in
#: 95 to 98 % of all records, and noise with a corner in 95 %.
_WHITE, _WALK, _FALLING, _RISING = 0.75, 0.05, 0.17, 0.03
#: Prior probability that the scale has an error of order n, times n; and of an order not fitted.
_FITTED_LINE, _OTHER_LINE = 0.8, 0.02


def from_spectrum(
    residual: Array,
    frequencies: Sequence[float] | Array,
    fitted: Sequence[float],
    turn: float,
    count: int,
    harmonics: Array | None,
) -> tuple[Array, Array, bool, Noise] | None:
    r"""Return the noise at the frequency of each function, from the spectrum of the residuals.

    It is the variance of equivalent white noise, in the square of the residuals' unit, shape (p,);
    its degrees of freedom, shape (p,); whether white noise explains the residuals; and the spectra.

    Frequencies are in cycles per sample: of the functions, of all fitted functions, and of the
    turn. `count` is the number of full turns. `harmonics` are the fitted orders from 2 on of one
    full turn, shape (n,). The result is None if there are too few residuals, or if they are those
    of several turns and white noise explains them.

    The power ``I`` at a frequency has an exponential distribution about the spectral density ``S``
    of the noise (Whittle 1953, Arkiv för Matematik 2), and the variance of a harmonic is
    proportional to ``S`` at its frequency (Grenander 1954, Annals of Mathematical Statistics 25):

    .. math:: S(f) = L \left(1 + \frac{g}{(f^2 + c^2)^q}\right)

    that is white noise of density L, alone, with a random walk (``c = 0``), with the walk of a rate
    (``q = 2``) or with noise below a corner frequency c. The density near order 1 follows from the
    orders around it. A fitted order shows
    the sum of noise and scale; it bounds the noise from above. So each power is either noise or, at
    any size above it, an error of the scale, with a small prior probability, as in a mixture model
    of outliers (Box and Tiao 1968, Biometrika 55). The interval is that of the mean over all
    ``g`` and ``c`` with their posterior probability, so that it includes what the record does not
    tell: whether low orders are slow noise or the scale.

    For several turns, fitted frequencies are missing in the residuals and are omitted; if the
    residuals are synchronous, so are all multiples of one per turn.

    Validity
    --------
    Samples in sequence at about equal steps. Errors of the scale at most orders count as noise. A
    drift that is below the white noise from order 2 on has little probability and is omitted.
    """
    # distance [bins] below which a frequency belongs to a multiple of one per turn
    nearest = 0.75
    n = residual.size
    series = residual if harmonics is None else residual + harmonics
    spectrum = np.fft.rfft(series)[1:] / math.sqrt(n)
    power = np.abs(spectrum) ** 2
    bins = np.arange(1, power.size + 1, dtype=np.float64)
    free = bins <= _HIGHEST * turn * n
    if n % 2 == 0:
        free[-1] = False  # its power has only one degree of freedom
    line = np.full(bins.size, _OTHER_LINE)
    for f in fitted:
        off = np.abs(bins - f * n) < 0.99
        if harmonics is None or f <= turn:
            free &= ~off
        line[off] = max(_OTHER_LINE, _FITTED_LINE * turn / f)
    synchronous = False
    if count > 1:
        between = np.abs(bins - np.rint(bins / (turn * n)) * turn * n) >= nearest
        synchronous = _is_synchronous(power[free & ~between], power[free & between])
        if synchronous:
            free &= between
    square = float(np.mean(residual**2))
    least = _LEAST_FREE if harmonics is None else _LEAST_FREE // 3
    if free.sum() < least or square == 0.0 or float(power[free].mean()) <= 1e-20 * square:
        return None
    at = np.asarray(frequencies, dtype=np.float64) / turn
    noise = _candidates(bins[free] / (turn * n), spectrum[free], line[free])
    (density,), freedom, white = densities([noise], at)
    if count > 1 and white:
        if not synchronous:
            return None
        density = np.full(at.size, float(power[free].mean()))
        freedom = np.full(at.size, 2.0 * float(free.sum()))
    return density, freedom, white, noise


def _is_synchronous(multiples: Array, between: Array) -> bool:
    """Return whether the power at multiples of one per turn is significantly higher."""
    # least excess of that power, in standard deviations
    significant = 3.0
    if multiples.size == 0 or between.size < _LEAST_FREE:
        return False
    chance = math.sqrt(1.0 / multiples.size + 1.0 / between.size)
    return bool(multiples.mean() > (1.0 + significant * chance) * between.mean())


@cache
def _spectra() -> tuple[Array, Array, Array, Array]:
    """Return g, c and power of f of the spectra, in cycles per turn, and their probability."""
    corners = np.array([7.0, 20.0, 50.0])
    # density at low frequencies, over that at high ones, less 1
    rise, fall = 10.0 ** np.arange(0.25, 5.1, 0.5), 10.0 ** np.arange(-2.0, -0.1, 0.5) - 1.0
    walk = 10.0 ** np.arange(-1.0, 5.1, 0.5)
    none, ones = np.zeros(walk.size), np.ones(walk.size)
    parts = [
        (np.zeros(1), np.ones(1), np.ones(1), _WHITE),
        (walk, none, ones, 0.75 * _WALK),
        (walk, none, 2.0 * ones, 0.25 * _WALK),
    ]
    for excess, probability in ((rise, _FALLING), (fall, _RISING)):
        e, c = (x.ravel() for x in np.meshgrid(excess, corners))
        parts.append((e * c**2, c, np.ones(c.size), probability))
    shares = [np.full(g.size, probability / g.size) for g, _, _, probability in parts]
    g, c, power = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return g, c, power, np.concatenate(shares)


def _shapes(f: Array) -> Array:
    """Return each spectrum over its level, at frequencies in cycles per turn, shape (s, k)."""
    g, c, power, _ = _spectra()
    return 1.0 + g[:, None] / (f**2 + c[:, None] ** 2) ** power[:, None]


def _candidates(f: Array, spectrum: Complex, line: Array) -> Noise:
    """Return the level of each spectrum, at frequencies in cycles per turn."""
    rounds = 6
    power, s = np.abs(spectrum) ** 2, _shapes(f)
    level, known = np.median(power / s, axis=1) / math.log(2.0), np.empty(s.shape[0])
    noise = Noise(frequency=f, amplitude=spectrum, line=line, level=level, known=known)
    for _ in range(rounds):
        ours, scale = noise.logarithms()
        share = 1.0 / (1.0 + np.exp(np.minimum(scale - ours, 700.0)) * line / (1.0 - line))
        known = share.sum(axis=1)
        level = np.sum(share * power / s, axis=1) / known
        noise = replace(noise, level=level, known=known)
    return noise


def _of_noise(noises: Sequence[Noise]) -> tuple[Array, Array]:
    """Return logarithms for each spectrum and frequency: likelihood and share of noise, (s, k).

    An error of the scale at a frequency is one of all records.
    """
    parts = [n.logarithms() for n in noises]
    line = noises[0].line
    noise = np.log1p(-line) + np.sum([p[0] for p in parts], axis=0)
    either = np.logaddexp(noise, np.log(line) + np.sum([p[1] for p in parts], axis=0))
    return either, noise - either


def _chance(noises: Sequence[Noise], each: Array) -> Array:
    """Return the logarithm of the probability of each spectrum, shape (s,), but for a constant."""
    # the integral over the level, whose logarithm has the variance 1 / known
    over = -0.5 * np.sum([np.log(n.known) for n in noises], axis=0)
    return np.log(_spectra()[3]) + over + each.sum(axis=1)


def noise_amplitudes(noises: Sequence[Noise]) -> Complex:
    """Return the amplitudes of the noise in its band about order 1, shape (records, k).

    Frequencies that belong to the scale are omitted.
    """
    each, share = _of_noise(noises)
    best = int(np.argmax(_chance(noises, each)))
    # the band in which the density is about that of order 1
    band = _shapes(noises[0].frequency)[best] > 0.5 * _shapes(np.ones(1))[best]
    band[: _LEAST_FREE // 2] = True
    return np.stack([n.amplitude for n in noises])[:, band & (share[best] > math.log(0.5))]


def densities(noises: Sequence[Noise], at: Array) -> tuple[list[Array], Array, bool]:
    """Return the density of each noise at frequencies [cycles per turn], of one common shape.

    The second value are their degrees of freedom, shape (p,); the third tells whether they are
    white. Student's interval with both is that of the mean over the spectra.
    """
    from scipy.special import stdtr, stdtrit

    # end of the interval, and the least degrees of freedom, of which the uncertainty is finite
    most, least = 0.975, 3.0
    # probability from which white noise explains the record
    enough = 0.7
    frequencies, back = np.unique(at, return_inverse=True)
    each = _of_noise(noises)[0]
    # the power at a frequency shows its own harmonic, and does not count for it
    f = noises[0].frequency
    self_term = np.abs(f[:, None] - frequencies) < 0.5 * float(np.diff(f).min())
    chance = _chance(noises, each)[:, None] - each @ self_term
    p = np.exp(chance - chance.max(axis=0))
    likely = np.flatnonzero((p > 1e-4).any(axis=1))
    p = p[likely] / p[likely].sum(axis=0)
    # white noise is the first; others that a record only does not exclude are omitted
    sure = p[0] > enough if likely[0] == 0 else np.zeros(frequencies.size, dtype=bool)
    p[:, sure] = 0.0
    p[0, sure] = 1.0
    shape = _shapes(frequencies)[likely]
    known = np.sum([n.known[likely] for n in noises], axis=0)
    results = []
    freedom = np.empty(frequencies.size)
    for noise in noises:
        variance = shape * noise.level[likely, None]
        mean = np.sum(p * np.log(variance), axis=0)
        spread = np.sum(p * ((np.log(variance) - mean) ** 2 + 1.0 / known[:, None]), axis=0)
        # the logarithm of chi squared with nu degrees has the variance 2 / nu + 2 / nu^2, nearly
        freedom = np.maximum((1.0 + np.sqrt(1.0 + 2.0 * spread)) / spread, least)
        low, high = np.sqrt(variance.min(axis=0)), 13.0 * np.sqrt(variance.max(axis=0))
        for _ in range(16):
            end = np.sqrt(low * high)
            below = np.sum(p * stdtr(2.0 * known[:, None], end / np.sqrt(variance)), axis=0) < most
            low, high = np.where(below, end, low), np.where(below, high, end)
        results.append((low * high / stdtrit(freedom, most) ** 2)[back])
    return results, freedom[back], bool(likely[0] == 0 and p[0, 0] > 0.5)
