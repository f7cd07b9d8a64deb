"""Values with uncertainty, against Student's t and sums of squares by hand."""

import math

import numpy as np
import pytest
from scipy import stats

from flexstage.base.errors import ModelError
from flexstage.quantities.estimate import Component, Estimate

NOISE = Component(name="noise", uncertainty=3.0, degrees_of_freedom=7.0)
GAIN = Component(name="gain", uncertainty=4.0, kind="B")
DRIFT = Component(name="drift", uncertainty=1.2, degrees_of_freedom=3.0)


def test_welch_and_satterthwaite() -> None:
    found = Estimate(value=50.0, unit="m", components=(NOISE, GAIN, DRIFT))
    u = math.sqrt(9.0 + 16.0 + 1.44)
    nu = u**4 / (3.0**4 / 7.0 + 1.2**4 / 3.0)
    assert found.uncertainty == pytest.approx(u, rel=1e-12)
    assert found.degrees_of_freedom == pytest.approx(nu, rel=1e-12)
    for confidence in (0.68, 0.95, 0.99):
        half = stats.t.ppf(0.5 + 0.5 * confidence, nu) * u
        assert found.interval(confidence) == pytest.approx((50.0 - half, 50.0 + half), rel=1e-9)
    assert found.expanded == pytest.approx(stats.t.ppf(0.975, nu) * u, rel=1e-9)


def test_what_is_known_exactly_is_normal() -> None:
    found = Estimate(value=-2.0, unit="m", components=(GAIN,))
    assert found.coverage_factor == pytest.approx(stats.norm.ppf(0.975), rel=1e-12)
    assert Estimate(value=7.0, unit="m").interval() == (7.0, 7.0)


def test_bounds_move_out_by_their_squares() -> None:
    found = Estimate(value=10.0, unit="m", components=(NOISE,), bounds=(8.0, 15.0))
    wider = found.plus(GAIN)
    half = stats.norm.ppf(0.975) * 4.0
    assert wider.bounds is not None
    assert wider.bounds == pytest.approx(
        (10.0 - math.hypot(2.0, half), 10.0 + math.hypot(5.0, half)), rel=1e-12
    )
    assert wider.uncertainty == pytest.approx(5.0, rel=1e-12)
    assert found.plus().bounds == found.bounds
    with pytest.raises(ModelError, match=r"0\.95 only"):
        wider.interval(0.99)


def test_a_negative_factor_turns_the_bounds_round() -> None:
    found = Estimate(value=10.0, unit="m", components=(NOISE,), bounds=(8.0, 15.0)).times(-2.0, "1")
    assert (found.value, found.unit, found.bounds) == (-20.0, "1", (-30.0, -16.0))
    assert found.uncertainty == pytest.approx(6.0, rel=1e-12)
    assert found.covers(-29.9)
    assert not found.covers(-15.9)


def test_impossible_ones_are_refused() -> None:
    with pytest.raises(ModelError, match="0 or more"):
        Component(name="noise", uncertainty=-1.0)
    with pytest.raises(ModelError, match="must be positive"):
        Component(name="noise", uncertainty=1.0, degrees_of_freedom=0.0)
    with pytest.raises(ModelError, match="between 0 and 1"):
        Estimate(value=1.0, unit="m").interval(1.0)


def test_a_deviation_of_fifty_degrees_of_freedom_is_known_to_a_tenth() -> None:
    """JCGM 100:2008, table E.1, and the scatter of such deviations themselves."""
    found = Estimate.of_deviation(3e-9, 50.0, "m")
    assert found.uncertainty == pytest.approx(0.3e-9, rel=1e-12)
    drawn = np.sqrt(np.random.default_rng(8).chisquare(50.0, 100_000) / 50.0)
    assert found.uncertainty == pytest.approx(3e-9 * drawn.std(), rel=0.01)
