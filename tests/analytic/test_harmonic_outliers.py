"""What is set aside is alone and leaves no trace; what is the scale's is kept."""

import math

import numpy as np
import pytest

from flexstage.centring import fit_harmonics
from tests.tiers import limits

COUNT = 3600
PER_TURN = 720
NOISE = 0.5


# a few are left out at once, many by weights that are lowered step by step
@pytest.mark.parametrize("many", [3, 60, 240])
def test_the_fit_is_that_of_the_samples_kept(many: int) -> None:
    rng = np.random.default_rng(4)
    # from eight turns on an angle weighs as its readings, which those left out are not
    count = 10 * PER_TURN
    theta = 0.3 + np.arange(count) * 2.0 * np.pi / PER_TURN
    y = 1e-3 * np.sin(theta - 0.7) + 2e-5 * np.cos(3.0 * theta) + rng.normal(0.0, 5e-6, count)
    # no two beside each other, nor at the same place of two turns
    wrong = 3 * rng.choice(PER_TURN // 3, many, replace=False)
    wrong += PER_TURN * rng.integers(0, count // PER_TURN, many)
    y[wrong] += 3e-4
    found = fit_harmonics(theta, y, orders=5)
    outliers = {o.index for o in found.outliers}
    assert outliers >= set(wrong.tolist())
    kept = np.setdiff1d(np.arange(count), list(outliers))
    plain = fit_harmonics(theta[kept], y[kept], orders=5, robust=False)
    assert found.samples == kept.size
    assert found.residual_rms == pytest.approx(plain.residual_rms, rel=1e-9)
    for own, other in zip(found.harmonics, plain.harmonics, strict=True):
        assert own.cosine.value == pytest.approx(other.cosine.value, abs=1e-14)
        assert own.sine.value == pytest.approx(other.sine.value, abs=1e-14)
    np.testing.assert_allclose(found.residual[kept], plain.residual, atol=1e-14)
    assert (found.with_all is not None) == (len(outliers) > 0.01 * count)


def test_below_eight_turns_it_is_nearly_that_of_the_samples_kept() -> None:
    # an angle weighs as one that is read in each turn, or as its readings that are kept
    rng = np.random.default_rng(4)
    theta = 0.3 + np.arange(COUNT) * 2.0 * np.pi / PER_TURN
    y = 1e-3 * np.sin(theta - 0.7) + rng.normal(0.0, 5e-6, COUNT)
    y[[5, 800, 2400]] += 3e-4
    found = fit_harmonics(theta, y, orders=1)
    assert [o.index for o in found.outliers] == [5, 800, 2400]
    kept = np.delete(np.arange(COUNT), [5, 800, 2400])
    plain = fit_harmonics(theta[kept], y[kept], orders=1, robust=False)
    for own, other in zip(found.harmonics, plain.harmonics, strict=True):
        assert own.cosine.value == pytest.approx(
            other.cosine.value, abs=0.1 * own.cosine.uncertainty
        )
        assert own.sine.value == pytest.approx(other.sine.value, abs=0.1 * own.sine.uncertainty)


def test_intervals_cover_both_fits_where_many_are_set_aside() -> None:
    rng = np.random.default_rng(7)
    theta = 0.3 + np.arange(500) * 2.0 * np.pi / 500
    y = np.sin(theta - 0.7) + rng.normal(0.0, 0.01, 500)
    y[20:200:9] += 0.4
    found = fit_harmonics(theta, y, orders=3)
    assert len(found.outliers) == 20
    assert found.with_all is not None
    plain = fit_harmonics(theta, y, orders=3, robust=False)
    for own, other in zip(found.harmonics, plain.harmonics, strict=True):
        for name in ("cosine", "sine", "amplitude"):
            low, high = getattr(own, name).interval()
            for end in getattr(other, name).interval():
                assert low <= end <= high
    assert any("also cover the fit with all" in note for note in found.notes)


@pytest.mark.parametrize("turns", [1, 3, 12])
def test_runs_and_what_repeats_are_kept(turns: int) -> None:
    rng = np.random.default_rng(8)
    size = 400 * turns
    theta = 1.1 + np.arange(size) * 2.0 * np.pi / 400
    y = 2.0 * np.cos(theta) + rng.normal(0.0, 0.05, size)
    y[np.arange(size) % 400 == 111] += 3.0  # a code of one sample
    y[(np.arange(size) % 400 >= 200) & (np.arange(size) % 400 < 204)] -= 8.0
    y[[57, 303]] += (4.0, -1.0)
    found = {o.index for o in fit_harmonics(theta, y, orders=4).outliers}
    # within one turn a code of one sample is like an outlier
    assert found == ({57, 111, 303} if turns == 1 else {57, 303})


def test_samples_in_no_order_have_neighbours_by_place() -> None:
    rng = np.random.default_rng(9)
    place = rng.permutation(600)
    theta = place * 2.0 * np.pi / 600
    y = np.cos(theta - 0.3) + rng.normal(0.0, 0.02, 600)
    y[(place >= 300) & (place < 310)] += 1.0
    wrong = int(np.flatnonzero(place == 77)[0])
    y[wrong] += 1.0
    assert [o.index for o in fit_harmonics(theta, y, orders=3).outliers] == [wrong]


def _scale(kind: str, rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """Errors of an encoder at places of the turn, with rms noise NOISE to be added."""
    size = np.array([10.0, 4.0, 2.0, 1.0, 1.0, 0.5]) * rng.normal(size=6)
    out = np.zeros(place.size) + sum(
        a * np.cos(2.0 * np.pi * n * place - p)
        for n, a, p in zip(range(1, 7), size, rng.uniform(0.0, 2.0 * np.pi, 6), strict=True)
    )
    if kind == "steps":
        many = rng.integers(2, 7)
        edges = np.sort(rng.uniform(size=many))
        return out + rng.normal(0.0, 8.0 * NOISE, many)[np.searchsorted(edges, place) % many]
    if kind == "dead codes":
        many = rng.integers(3, 9)
        for start, width in zip(
            rng.uniform(size=many), rng.uniform(0.003, 0.02, many), strict=True
        ):
            into = (place - start) % 1.0
            out = out - np.where(into < width, 24.0 * NOISE * into / width, 0.0)
        return out
    signals = rng.integers(32, 200)
    phase = 2.0 * np.pi * signals * place - rng.uniform(0.0, 2.0 * np.pi)
    first, second = rng.uniform((2.0, 0.0), (8.0, 4.0)) * NOISE
    return out + first * np.cos(phase) + second * np.cos(2.0 * phase)


def _trial(kind: str, turns: int, seed: int) -> tuple[list[bool], int, int, int]:
    """Return whether intervals hold orders 1 to 6; samples set aside, rightly, wrong in all."""
    rng = np.random.default_rng(np.random.SeedSequence(turns, spawn_key=(seed,)))
    size = PER_TURN * turns
    u = rng.uniform() + np.arange(size) / PER_TURN
    clean = _scale(kind, rng, u % 1.0)
    y = clean + rng.normal(0.0, NOISE, size)
    wrong = rng.choice(size, 1 + rng.poisson(0.004 * size), replace=False)
    y[wrong] += rng.choice((-1.0, 1.0), wrong.size) * rng.uniform(16.0, 160.0, wrong.size) * NOISE
    theta = 2.0 * np.pi * u
    fit = fit_harmonics(theta, y)
    hits = []
    for n in range(1, 7):
        h = fit.harmonic(n)
        c = 2.0 * float(np.mean(clean * np.cos(n * theta)))
        s = 2.0 * float(np.mean(clean * np.sin(n * theta)))
        hits += [h.cosine.covers(c), h.sine.covers(s), h.amplitude.covers(math.hypot(c, s))]
    found = {o.index for o in fit.outliers}
    return hits, len(found), len(found & set(wrong.tolist())), wrong.size


@pytest.mark.parametrize("kind", ["steps", "dead codes", "interpolation"])
@pytest.mark.parametrize(
    "count", [pytest.param(25, id="few"), pytest.param(1000, id="full", marks=pytest.mark.evidence)]
)
@pytest.mark.parametrize("turns", [1, 3, 12])
def test_encoders_with_errors_of_their_own(kind: str, count: int, turns: int) -> None:
    trials = [_trial(kind, turns, seed) for seed in range(count)]
    covered = np.mean([t[0] for t in trials], axis=0).reshape(6, 3)
    set_aside, rightly, wrong = np.sum([t[1:] for t in trials], axis=0)
    low, high = limits(count, 0.93, 0.97, full=1000)
    assert covered.min() >= low, covered
    # of one turn, what the scale does is in the noise, and makes the intervals too wide
    assert turns == 1 or covered.max() <= high, covered
    assert rightly >= 0.9 * wrong
    # of one turn, what is dead for a single sample is like an outlier
    assert rightly >= (0.95 if turns > 1 else 0.85) * set_aside
