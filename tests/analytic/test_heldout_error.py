"""The standard error of a held-out error, against errors whose root mean square is known."""

import numpy as np
import pytest

from flexstage.hysteresis.identification.fit_rows import ChainValues, Rows
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_fit import fit_data
from flexstage.hysteresis.identification.residuals import another_stretch, rms_standard_error

EACH = 30


def rows(cycles, used=None):
    """Return rows of cycles of as many samples, of which some cycles are in use."""
    cycle = np.repeat(np.arange(cycles), EACH)
    use = np.ones(cycle.size, dtype=bool) if used is None else np.isin(cycle, used)
    nothing = IdentificationData(
        sections=(), sign=1.0, input_unit="", output_unit="", stroke=1.0, warnings=()
    )
    own = Rows(at=np.arange(cycle.size), cycle=cycle)
    return fit_data(nothing, ChainValues(), (own,), (use,))


def test_ten_cycles_are_the_jackknife_in_closed_form():
    size = np.array([1.0, 1.3, 0.7, 1.1, 2.0, 0.4, 1.6, 0.9, 1.2, 0.8])
    without = np.array([np.sqrt(np.mean(np.delete(size, i) ** 2)) for i in range(10)])
    plain = np.sqrt(0.9 * np.sum((without - without.mean()) ** 2))
    # the 97.5 % point of the distribution of Student for nine degrees of freedom: 2.262
    found = rms_standard_error([np.repeat(size, EACH)], rows(10))
    assert found == pytest.approx(plain * 2.2622 / 1.96, rel=1e-4)


def test_its_interval_holds_the_truth():
    """Cycles are each off by an own amplitude: 400 records, of which 95 % are to be held."""
    rng, inside = np.random.default_rng(5), []
    data = rows(40)
    for _ in range(400):
        amplitude = np.repeat(rng.uniform(0.5, 1.5, 40), EACH)
        error = amplitude * np.sin(np.linspace(0.0, 80.0 * np.pi, 40 * EACH, endpoint=False))
        truth = np.sqrt(0.5 * (1.0 + 1.0 / 12.0))  # E a^2 = mean^2 + width^2 / 12
        found = rms_standard_error([error], data)
        assert found is not None
        inside.append(abs(np.sqrt(np.mean(error**2)) - truth) < 1.96 * found)
    assert 0.92 < np.mean(inside) < 0.98


def test_cycles_that_are_not_in_use_do_not_count():
    rng = np.random.default_rng(6)
    error = rng.normal(size=24 * EACH)
    held = list(range(12))
    other = error.copy()
    other[12 * EACH :] *= 50.0
    found = [rms_standard_error([e], rows(24, held)) for e in (error, other)]
    assert found[0] == found[1]
    assert rms_standard_error([error], rows(24, [3])) is None


def test_another_stretch_is_held_by_what_stretches_differ():
    """Stretches of a drive differ by an own factor: that of a further one is to be held."""
    rng, inside = np.random.default_rng(7), []
    for _ in range(400):
        rms = 1.0 + 0.3 * rng.normal(size=6)
        found = another_stretch(float(np.sqrt(np.mean(rms[:5] ** 2))), 0.02, rms[:5])
        inside.append(abs(rms[5] - np.mean(rms[:5])) < 1.96 * found)
    # of the mean of five, which has an error of its own: a little less than 95 %
    assert 0.89 < np.mean(inside) < 0.97


def test_extrapolating_to_a_stretch_counts():
    found = another_stretch(0.2, 0.03, np.full(5, 0.6))
    assert found == pytest.approx(np.hypot(0.03, 0.4))
