"""Verdicts on differences, against intervals computed by hand."""

import math

import pytest
from scipy import stats

from flexstage.base.errors import ModelError
from flexstage.experiments.campaign.results import difference
from flexstage.quantities.characteristic import Characteristic


def row(value: float, **more: object) -> Characteristic:
    return Characteristic(
        quantity="resolution", axis="x", origin="measured", value=value, unit="m", **more
    )


def test_student_decides_where_little_was_measured() -> None:
    measured = row(31e-9, uncertainty=1e-9, degrees_of_freedom=3.0)
    limit = stats.t.ppf(0.975, 3) * 1e-9
    assert difference(measured, row(31e-9 - 0.99 * limit)).significant is False
    assert difference(measured, row(31e-9 - 1.01 * limit)).significant is True
    assert difference(measured, row(20e-9)).expanded == pytest.approx(limit, rel=1e-12)


def test_both_uncertainties_count() -> None:
    a = row(7e-9, uncertainty=3e-10, degrees_of_freedom=7.0)
    b = row(6e-9, uncertainty=4e-10, degrees_of_freedom=12.0)
    nu = 5.0**4 / (3.0**4 / 7.0 + 4.0**4 / 12.0)
    found = difference(a, b)
    assert found.expanded == pytest.approx(stats.t.ppf(0.975, nu) * 5e-10, rel=1e-12)
    assert found.percent == pytest.approx(100.0 / 6.0, rel=1e-12)
    assert found.significant is False


def test_a_known_uncertainty_is_normal_and_none_is_no_verdict() -> None:
    found = difference(row(5e-9, uncertainty=1e-9), row(0.0))
    assert found.expanded == pytest.approx(stats.norm.ppf(0.975) * 1e-9, rel=1e-12)
    assert found.percent is None
    blind = difference(row(5e-9), row(4e-9))
    assert (blind.significant, blind.expanded) == (None, None)
    assert math.isclose(blind.value, 1e-9, rel_tol=1e-9)


def test_other_quantities_are_refused() -> None:
    noise = Characteristic(quantity="noise", axis="x", origin="measured", value=1e-9, unit="m")
    with pytest.raises(ModelError, match="cannot be compared"):
        difference(row(1e-9), noise)
