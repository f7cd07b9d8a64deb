"""Sobol' indices against closed forms and SciPy's estimate; how often the intervals hold them.

Ishigami and Homma 1990, sin x1 + a sin^2 x2 + b x3^4 sin x1 between -pi and pi, with the variances
of Saltelli et al. 2008 (Global Sensitivity Analysis, sec. 4.6): V = a^2/8 + b pi^4/5 + b^2 pi^8/18
+ 1/2, V1 = (1 + b pi^4/5)^2/2, V2 = a^2/8, V13 = 8 b^2 pi^8/225. Sobol's g-function, the product of
(|4 x - 2| + a)/(1 + a), has V_i = 1/(3 (1 + a_i)^2) (Saltelli and Sobol' 1995).
"""

import math

import numpy as np
import pytest
from scipy import stats

from flexstage.base.errors import ModelError
from flexstage.studies.explore import saltelli_points, sobol_indices
from tests.tiers import limits, sizes

A, B = 7.0, 0.1
V = A**2 / 8 + B * math.pi**4 / 5 + B**2 * math.pi**8 / 18 + 0.5
V1, V2 = 0.5 * (1 + B * math.pi**4 / 5) ** 2, A**2 / 8
V13 = 8 * B**2 * math.pi**8 / 225
FIRST = np.array([V1, V2, 0.0]) / V
TOTAL = np.array([V1 + V13, V2, V13]) / V
ENDS = -math.pi * np.ones(3), math.pi * np.ones(3)

WEIGHTS = np.array([0.3, 1.2, 4.5, 60.0])
_PARTS = 1.0 / (3.0 * (1.0 + WEIGHTS) ** 2)
_G = np.prod(1.0 + _PARTS) - 1.0
G_FIRST = _PARTS / _G
G_TOTAL = _PARTS * np.prod(1.0 + _PARTS) / (1.0 + _PARTS) / _G


def ishigami(x):
    return np.sin(x[..., 0]) * (1 + B * x[..., 2] ** 4) + A * np.sin(x[..., 1]) ** 2


def g(x):
    return np.prod((np.abs(4.0 * x - 2.0) + WEIGHTS) / (1.0 + WEIGHTS), axis=-1)


def test_the_closed_forms_are_what_integrals_give():
    x, w = np.polynomial.legendre.leggauss(48)
    w = 0.5 * w
    f = ishigami(np.stack(np.meshgrid(*[math.pi * x] * 3, indexing="ij"), axis=-1))
    mean = np.einsum("ijk,i,j,k", f, w, w, w)
    variance = np.einsum("ijk,i,j,k", (f - mean) ** 2, w, w, w)
    assert variance == pytest.approx(V)
    alone = [np.einsum("ijk,j,k->i", np.moveaxis(f, i, 0), w, w) - mean for i in range(3)]
    assert [w @ part**2 / variance for part in alone] == pytest.approx(FIRST, abs=1e-9)
    rest = [np.einsum("ijk,i->jk", np.moveaxis(f, i, 0), w) - mean for i in range(3)]
    total = [1.0 - np.einsum("jk,j,k", part**2, w, w) / variance for part in rest]
    assert total == pytest.approx(TOTAL, abs=1e-9)


def test_ishigami_and_g_are_met():
    n = 4096
    both = sobol_indices(
        np.stack([ishigami(saltelli_points(*ENDS, n, 3)).reshape(n, 5)] * 2, axis=-1), 1
    )
    # the error of n = 4096 points of a sequence is far below 1/sqrt(n) = 0.016
    assert both.first[0] == pytest.approx(FIRST, abs=4e-3)
    assert both.total[1] == pytest.approx(TOTAL, abs=4e-3)
    found = sobol_indices(g(saltelli_points(np.zeros(4), np.ones(4), n, 6)).reshape(n, 6, 1), 1)
    assert found.first[0] == pytest.approx(G_FIRST, abs=4e-3)
    assert found.total[0] == pytest.approx(G_TOTAL, abs=4e-3)
    assert (found.samples, found.excluded) == (n, 0)


def test_scipy_estimates_the_same_of_the_same_points():
    n = 256
    points = saltelli_points(*ENDS, n, 11).reshape(n, 5, 3)
    # a mean far from zero, as that of a frequency, spoils an estimate that does not take it away
    values = np.stack([ishigami(points), 339.0 + 0.01 * ishigami(points[..., ::-1])], axis=-1)
    found = sobol_indices(values, 2)
    by_page = np.moveaxis(values, (1, 2, 0), (0, 1, 2))  # page, figure, sample
    peer = stats.sobol_indices(
        func={"f_A": by_page[0], "f_B": by_page[1], "f_AB": by_page[2:]}, n=n
    )
    assert found.first == pytest.approx(peer.first_order, abs=1e-9)
    assert found.total == pytest.approx(peer.total_order, abs=1e-9)


def coverage(draw, seeds):
    """How often the intervals of Ishigami's function hold the truth, for each index."""
    held = np.zeros(6)
    for seed in range(seeds):
        values = ishigami(draw(seed)).reshape(-1, 5, 1)
        found = sobol_indices(values, seed, resamples=400)
        for k, (low, high, truth) in enumerate(
            ((found.first_low, found.first_high, FIRST), (found.total_low, found.total_high, TOTAL))
        ):
            held[3 * k : 3 * k + 3] += (low[0] <= truth) & (truth <= high[0])
    return held / seeds


def independent(seed):
    a, b = np.random.default_rng(seed).uniform(-math.pi, math.pi, (2, 256, 3))
    points = np.repeat(a[:, None], 5, axis=1)
    points[:, 1] = b
    points[:, 2 + np.arange(3), np.arange(3)] = b
    return points


@pytest.mark.parametrize("seeds", sizes(slow=300, evidence=1000))
def test_intervals_hold_the_truth(seeds):
    # of independent points, for which the resampling stands, all six together
    low, high = limits(6 * seeds, 0.93, 0.97, full=6000)
    assert low <= coverage(independent, seeds).mean() <= high


@pytest.mark.slow
def test_intervals_of_a_sequence_are_on_the_safe_side():
    assert coverage(lambda seed: saltelli_points(*ENDS, 256, seed), 200).min() >= 0.94


def test_what_does_not_vary_has_no_indices():
    n = 32
    points = saltelli_points(*ENDS, n, 1).reshape(n, 5, 3)
    still = np.full((n, 5), 539.0) + 1e-10 * np.sin(points[..., 0])
    found = sobol_indices(np.stack([ishigami(points), still, np.zeros((n, 5))], axis=-1), 1)
    assert np.isfinite(found.first[0]).all()
    for part in (found.first, found.total, found.first_low, found.total_high):
        assert np.isnan(part[1:]).all()


def test_base_samples_with_an_impossible_stage_are_left_out_up_to_a_share():
    n = 128
    values = ishigami(saltelli_points(*ENDS, n, 2)).reshape(n, 5, 1)
    gaps = values.copy()
    gaps[[3, 70], [4, 0]] = np.nan
    found = sobol_indices(gaps, 5)
    whole = sobol_indices(np.delete(values, [3, 70], axis=0), 5)
    assert found.excluded == 2
    assert found.samples == 126
    assert (found.first == whole.first).all()
    assert (found.total_low == whole.total_low).all()
    gaps[10:20, 1] = np.nan
    with pytest.raises(ModelError, match="12 of 128 base samples have an impossible stage"):
        sobol_indices(gaps, 5)


def test_few_samples_are_refused():
    with pytest.raises(ModelError, match="16 or more base samples, got 8"):
        sobol_indices(ishigami(saltelli_points(*ENDS, 8, 2)).reshape(8, 5, 1), 5)
