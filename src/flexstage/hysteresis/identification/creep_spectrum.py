"""Weights of the time constants of creep, where records at several rates tell them apart."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.creep import CreepSpectrum
from flexstage.hysteresis.identification.chain_misfit import dictionary, short_data
from flexstage.hysteresis.identification.fit_rows import ChainValues, Rows, filtered
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_fit import equations, folds_of
from flexstage.hysteresis.identification.projection import (
    Normal,
    Solution,
    groups_summed,
    solve,
    square_left,
)
from flexstage.hysteresis.identification.record_section import RecordSection

#: Samples of a record that are filtered.
_SAMPLES = 50_000
#: The shortest time constant is one over the angular frequency of the fastest cycles and this many
#: times shorter, as what is faster acts on them as a delay; then comes one a decade.
_FASTER = 3.0
#: Parts of the cycles that are held out in turn, and runs of neighbours in each: small ones, so
#: that the offset of a record is not extrapolated.
_PARTS, _RUNS = 12, 3
#: Rounds in which densities and weights are found in turn, at most, and what ends them.
_ROUNDS = 40
_SETTLED = 1e-5
#: The spectrum is kept where it takes this share of the mean square away in a typical part: an
#: eighth is taken from creep of the logarithm too, where the dictionary is too coarse.
_WORTH = 0.2


def with_spectrum(
    data: IdentificationData, chain: ChainValues, *, train: tuple[int, int] | None = None
) -> ChainValues:
    r"""Give creep a weight for each time constant, where cycles that were not fitted ask for it.

    Output is linear in the density of a small Preisach model and in the weights of the lags behind
    it, but not in both: each is found by non-negative least squares with the other held, in turn.

    .. math:: y = \Big(1 + \sum_i \frac{a_i}{1 + \tau_i s}\Big) \sum_j w_j \phi_j(u),
              \qquad a_i, w_j \ge 0

    Delay and modes of the chain are kept. It comes back as it was at one rate, where hysteresis and
    spectrum are not told apart, and where held-out cycles are predicted no better by a tenth in
    rms.

    Notes
    -----
    Validity: records of one drive in one state. What differs between records of different rates for
    another reason, as the range of a sensor or the temperature, is taken for relaxation.
    """
    rates = data.rates_hz
    if len(rates) < 2:
        return chain
    longest = max(s.u.size * s.dt for s in data.sections)
    shortest = 1.0 / (2.0 * np.pi * _FASTER * rates[-1])
    if not shortest < longest:
        return chain
    count = 1 + max(1, round(np.log10(longest / shortest)))
    fit = _Fit(data, chain, np.geomspace(shortest, longest, count), train)
    if not _asked_for(*fit.held_out()):
        return chain
    weights = fit.weights(fit.whole)
    found = weights > 0.0
    if not found.any():
        return chain
    spectrum = CreepSpectrum(times=tuple(fit.times[found]), weights=tuple(weights[found]))
    return replace(chain, spectrum=spectrum, creep_per_decade=spectrum.rate_per_decade)


def _asked_for(before: Array, after: Array) -> bool:
    """Whether held-out parts are predicted better: a typical one by a good deal, and all together.

    Errors of parts differ by more than a decade, where one has jumps; their ratios differ less.
    """
    if before.size < 2 or not 0.0 < after.mean() < before.mean():
        return False
    ratio = np.log(np.maximum(after, 1e-300) / np.maximum(before, 1e-300))
    by_chance = float(np.std(ratio, ddof=1)) / np.sqrt(ratio.size)
    return bool(ratio.mean() < min(np.log(1.0 - _WORTH), -by_chance))


class _Fit:
    """Products of all columns with one another: those of the dictionary behind each of the lags."""

    def __init__(
        self,
        whole: IdentificationData,
        chain: ChainValues,
        times: Array,
        train: tuple[int, int] | None,
    ) -> None:
        self.times = times
        self._bare = replace(chain, creep_per_decade=0.0, spectrum=None)
        self._data = short_data(whole, self._bare, _SAMPLES, train)
        self._creep = (chain,) if chain.creep_per_decade > 0.0 else ()
        columns, _, penalty = dictionary(self._data)
        self._penalty = penalty * self._data.input_scale**2
        sections = self._data.sections
        self._behind = [
            self._at_rows(c, s, r)
            for c, s, r in zip(columns, sections, self._data.rows, strict=True)
        ]
        self.whole = equations(self._behind, self._data)

    def _at_rows(self, columns: Array, section: RecordSection, rows: Rows) -> Array:
        """Columns, and those behind each lag and behind the creep that is known, side by side."""
        plain = filtered(columns, section, rows, self._bare)
        lags = [
            replace(self._bare, spectrum=lag, creep_per_decade=lag.rate_per_decade)
            for lag in (CreepSpectrum(times=(float(t),), weights=(1.0,)) for t in self.times)
        ]
        crept = [filtered(columns, section, rows, c) - plain for c in (*lags, *self._creep)]
        return np.concatenate([plain, *crept], axis=1)

    def _factors(self, weights: Array | None) -> Array:
        """Factor of each set of columns: weights of the lags, or the creep that is known."""
        lags = np.zeros(self.times.size) if weights is None else weights
        return np.array([1.0, *lags, *(float(weights is None) for _ in self._creep)])

    def _densities(self, normal: Normal, lags: Array) -> Solution:
        return solve(groups_summed(normal, lags), smoothing=self._penalty * normal.count)

    def weights(self, normal: Normal) -> Array:
        """Find densities and weights in turn; return the weights, shape (m,)."""
        a = np.full(self.times.size, 0.01)
        last = np.inf
        for _ in range(_ROUNDS):
            w = self._densities(normal, self._factors(a)).coefficients
            by_lag = np.kron(np.eye(a.size + 1), w[:, None])
            rest = np.zeros((normal.columns - by_lag.shape[0], by_lag.shape[1]))
            found = _contracted(normal, np.vstack((by_lag, rest)))
            share = solve(found)
            if share.coefficients[0] <= 0.0:
                break
            a = share.coefficients[1:] / share.coefficients[0]
            left = square_left(found, share)
            if last - left <= _SETTLED * left:
                break
            last = left
        return a

    def held_out(self) -> tuple[Array, Array]:
        """Mean square of each held-out part, with the known creep and with a spectrum."""
        before, after = [], []
        for fold in folds_of(self._data, _PARTS, _RUNS):
            part = equations(self._behind, self._data.with_use(fold))
            if part.count in (0, self.whole.count):
                continue
            rest = self.whole - part
            for lags, kept in (
                (self._factors(None), before),
                (self._factors(self.weights(rest)), after),
            ):
                solution = self._densities(rest, lags)
                own = groups_summed(part, lags)
                kept.append(square_left(own, solution) / part.count)
        return np.array(before), np.array(after)


def _contracted(normal: Normal, to: NDArray[Any]) -> Normal:
    """Normal equations of sums of columns: `to` has a column for each of the sums."""
    m, k = to.shape
    whole = np.zeros((normal.gram.shape[0], k + normal.gram.shape[0] - m))
    whole[:m, :k] = to
    whole[m:, k:] = np.eye(normal.gram.shape[0] - m)
    return Normal(
        gram=whole.T @ normal.gram @ whole,
        right=whole.T @ normal.right,
        square=normal.square,
        count=normal.count,
        columns=k,
    )
