"""Published examples of uncertainty: the GUM's annex H, and clause 9 of its Supplement 1.

Evidence (Measuring and centring): budgets (JCGM 100, H.1, H.2; JCGM 101, 9.2 to 9.4): printed
digits, Monte Carlo 0.6 %
"""

import math

import numpy as np
import pytest

from flexstage.measure.uncertainty.budget_file import cos, sin
from flexstage.measure.uncertainty.monte_carlo import monte_carlo, validate
from flexstage.measure.uncertainty.propagate import Influence, propagate
from flexstage.quantities.units import parse


def normal(name, value, u, **more):
    return Influence(name=name, value=value, uncertainty=u, **more)


def uniform(name, low, high):
    return Influence(name=name, value=0.5 * (low + high), half_width=0.5 * (high - low))


def end_gauge():
    """JCGM 100:2008, H.1, in nanometres and kelvin; the comparison is d = mean + d1 + d2."""
    influences = (
        normal("standard", 50_000_623.0, 25.0, degrees_of_freedom=18),
        normal("mean", 215.0, 5.8, degrees_of_freedom=24, kind="A"),
        normal("random", 0.0, 3.9, degrees_of_freedom=5),
        normal("systematic", 0.0, 6.7, degrees_of_freedom=8),
        uniform("expansion", 9.5e-6, 13.5e-6),
        normal("temperature", -0.1, 0.2),
        Influence(name="cycle", value=0.0, half_width=0.5, distribution="arcsine"),
        Influence(name="expansions apart", value=0.0, half_width=1e-6, degrees_of_freedom=50),
        Influence(name="temperatures apart", value=0.0, half_width=0.05, degrees_of_freedom=2),
    )

    def length(ls, d, d1, d2, alpha, theta, cycle, expansions, temperatures):
        return ls + d + d1 + d2 - ls * (expansions * (theta + cycle) + alpha * temperatures)

    return length, influences


def test_end_gauge_block():
    found = propagate(*end_gauge(), unit="nm")
    assert found.value == pytest.approx(50_000_838.0, abs=1e-6)
    assert round(found.uncertainty) == 32
    # the GUM drops the fraction of 16.7
    assert math.floor(found.degrees_of_freedom) == 16
    by_name = {line.name: line for line in found.lines}
    assert by_name["standard"].contribution == pytest.approx(25.0)
    comparison = [by_name[n].contribution for n in ("mean", "random", "systematic")]
    assert math.hypot(*comparison) == pytest.approx(9.7, abs=0.05)
    assert by_name["expansion"].contribution == 0.0
    assert by_name["cycle"].contribution == 0.0
    assert by_name["expansions apart"].contribution == pytest.approx(2.9, abs=0.05)
    assert by_name["temperatures apart"].contribution == pytest.approx(16.6, abs=0.05)
    # 93 nm is 2.92 of 16 degrees of freedom times 32; with all digits it is 1 % less
    low, high = found.interval(0.99)
    assert 0.5 * (high - low) == pytest.approx(93.0, rel=0.013)


READINGS = {
    "V": (5.007, 4.994, 5.005, 4.990, 4.999),
    "I": (19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3),
    "phi": (1.0456, 1.0438, 1.0468, 1.0428, 1.0433),
}


def circuit():
    """JCGM 100:2008, H.2: five simultaneous readings of voltage, current and phase."""
    table = np.array(list(READINGS.values()))
    u = table.std(axis=1, ddof=1) / math.sqrt(5)
    influences = [
        normal(name, float(row.mean()), float(one), degrees_of_freedom=4, kind="A")
        for name, row, one in zip(READINGS, table, u, strict=True)
    ]
    r = np.corrcoef(table)
    pairs = (("V", "I", 0, 1), ("V", "phi", 0, 2), ("I", "phi", 1, 2))
    return influences, {(a, b): float(r[i, j]) for a, b, i, j in pairs}


@pytest.mark.parametrize(
    ("function", "value", "uncertainty", "digits"),
    [
        (lambda v, i, phi: v * cos(phi) / i, 127.732, 0.071, 3),
        (lambda v, i, phi: v * sin(phi) / i, 219.847, 0.295, 3),
        (lambda v, i, phi: v / i + 0.0 * phi, 254.260, 0.236, 3),
    ],
)
def test_resistance_and_reactance(function, value, uncertainty, digits):
    influences, correlations = circuit()
    assert correlations["V", "I"] == pytest.approx(-0.36, abs=0.005)
    assert correlations["V", "phi"] == pytest.approx(0.86, abs=0.005)
    assert correlations["I", "phi"] == pytest.approx(-0.65, abs=0.006)
    found = propagate(function, influences, correlations, unit="ohm")
    assert round(found.value, digits) == value
    # of X the GUM prints 0.295, the scatter of five reactances; to first order it is 0.2956
    assert found.uncertainty == pytest.approx(uncertainty, abs=1.05 * 10.0**-digits)
    # observed together, so there are four degrees of freedom and no more
    assert found.degrees_of_freedom == pytest.approx(4.0)
    assert len(found.estimate.components) == 1
    assert sum(line.share for line in found.lines) == pytest.approx(1.0)


def total(*x):
    return sum(x[1:], x[0])


def test_sum_of_four_normal():
    found = monte_carlo(total, [normal(n, 0.0, 1.0) for n in "abcd"], seed=1)
    assert found.uncertainty == pytest.approx(2.00, abs=0.005)
    assert found.symmetric == pytest.approx((-3.92, 3.92), abs=0.01)


def test_sum_of_four_rectangular():
    """JCGM 101:2008, 9.2.3: the first order gives 3.92, the convolution 3.88."""
    four = [uniform(n, -math.sqrt(3), math.sqrt(3)) for n in "abcd"]
    first, found = propagate(total, four), monte_carlo(total, four, seed=2)
    assert first.interval()[1] == pytest.approx(3.92, abs=0.005)
    assert found.symmetric == pytest.approx((-3.88, 3.88), abs=0.01)
    assert validate(first, found, digits=1).valid
    assert not validate(first, found, digits=3).valid


def test_one_wide_rectangular():
    """JCGM 101:2008, 9.2.4: one influence is ten times as wide as the others."""
    wide = [uniform(n, -math.sqrt(3), math.sqrt(3)) for n in "abc"]
    wide.append(uniform("d", -10.0 * math.sqrt(3), 10.0 * math.sqrt(3)))
    first, found = propagate(total, wide), monte_carlo(total, wide, seed=3)
    assert first.uncertainty == pytest.approx(10.1, abs=0.05)
    assert first.interval()[1] == pytest.approx(19.9, abs=0.05)
    assert found.uncertainty == pytest.approx(10.1, abs=0.05)
    assert found.symmetric == pytest.approx((-17.0, 17.0), abs=0.05)
    assert not validate(first, found).valid


def test_mass_calibration():
    """JCGM 101:2008, 9.3: deviation from 100 g, in milligrams."""
    influences = (
        normal("reference", 100_000.000, 0.050),
        normal("balance", 1.234, 0.020),
        uniform("air", 1.10, 1.30),
        uniform("weight", 7e3, 9e3),
        uniform("reference density", 7.95e3, 8.05e3),
    )

    def deviation(m, dm, air, weight, reference):
        return (m + dm) * (1 + (air - 1.2) * (1 / weight - 1 / reference)) - 100_000.0

    first = propagate(deviation, influences, unit="mg")
    assert (round(first.value, 4), round(first.uncertainty, 4)) == (1.2340, 0.0539)
    assert first.interval() == pytest.approx((1.1285, 1.3395), abs=1.5e-4)
    found = monte_carlo(deviation, influences, seed=4, trials=2_000_000)
    assert found.value == pytest.approx(1.2341, abs=2e-4)
    assert found.uncertainty == pytest.approx(0.0754, abs=2e-4)
    assert found.shortest == pytest.approx((1.0834, 1.3825), abs=1.5e-3)
    assert not validate(first, found).valid


@pytest.mark.parametrize(
    ("x1", "r", "value", "u", "shortest"),
    [
        # values, standard uncertainties and shortest intervals in 1e-6
        (0.0, 0.0, 50, 50, (0, 150)),
        (0.010, 0.0, 150, 112, (0, 367)),
        (0.050, 0.0, 2551, 502, (1590, 3543)),
        (0.0, 0.9, 50, 67, (0, 185)),
    ],
)
def test_comparison_loss(x1, r, value, u, shortest):
    """JCGM 101:2008, 9.4: a loss that is quadratic about its least value."""
    pair = (normal("x1", x1, 0.005), normal("x2", 0.0, 0.005))
    correlations = {("x1", "x2"): r} if r else None
    found = monte_carlo(lambda a, b: a * a + b * b, pair, correlations, seed=5, trials=1_000_000)
    assert found.value * 1e6 == pytest.approx(value, rel=3e-3, abs=0.5)
    assert found.uncertainty * 1e6 == pytest.approx(u, rel=5e-3, abs=0.5)
    assert np.array(found.shortest) * 1e6 == pytest.approx(shortest, rel=6e-3, abs=2.0)
    first = propagate(lambda a, b: a * a + b * b, pair, correlations)
    assert first.uncertainty == pytest.approx(2.0 * x1 * 0.005)
    assert not validate(first, found).valid


def test_units_of_the_end_gauge_as_text():
    """The same budget in mixed units is the same to the last digit of the GUM's table."""
    assert parse("50.000838 mm", "length") == pytest.approx(
        propagate(*end_gauge()).value * 1e-9, abs=1e-15
    )
