"""Straightness against brute force, finite differences, conditions of optimality, and coverage."""

import itertools

import numpy as np
import pytest

from flexstage.arrays import Array
from flexstage.errors import ConvergenceError, ModelError, RecordError
from flexstage.measure.motion.narrowest_zone import minimum_zone_cylinder, narrowest_strip
from flexstage.measure.motion.straightness import (
    end_point_straightness,
    least_squares_straightness,
    less_noise,
    minimum_zone,
)
from tests.tiers import limits, sizes


def points(number: int, size: int | None = None) -> tuple[Array, Array]:
    random = np.random.default_rng([11, number])
    n = int(random.integers(3, 40)) if size is None else size
    x = np.sort(random.uniform(0.0, 3.1, n))
    return x, random.normal(size=n) + 0.37 * random.normal() * x


def brute_force(x: Array, y: Array, *, orthogonal: bool) -> float:
    """Width of the strip along every pair of points, the narrowest of them."""
    widths = []
    for i, j in itertools.combinations(range(x.size), 2):
        slope = (y[j] - y[i]) / (x[j] - x[i])
        share = np.hypot(1.0, slope) if orthogonal else 1.0
        widths.append(np.ptp(y - slope * x) / share)
    return float(min(widths))


@pytest.mark.parametrize("measured", ["across", "orthogonal"])
def test_the_minimum_zone_equals_a_search_over_all_pairs(measured: str) -> None:
    for number in range(120):
        x, y = points(number)
        found = minimum_zone(x, y, measured=measured)  # type: ignore[arg-type]
        expected = brute_force(x, y, orthogonal=measured == "orthogonal")
        assert found.deviation.value == pytest.approx(expected, rel=1e-12)
        # the line is in the middle of the zone
        assert found.distances.max() == pytest.approx(0.5 * expected, rel=1e-9)
        assert found.distances.min() == pytest.approx(-0.5 * expected, rel=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 40.0])
def test_points_on_a_grid_and_on_a_line(tilt: float) -> None:
    # many points one over the other, and three on one edge
    x = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 4.0])
    y = np.array([0.0, 1.0, 1.5, 0.5, -0.25, 0.0, 1.75, 0.0]) + tilt * x
    upper = max(np.interp(t, [0, 2, 4], [1, 1.75, 0]) - np.interp(t, [0, 1, 4], [0, -0.25, 0])
                for t in (0.0, 1.0, 2.0, 4.0))  # fmt: skip
    assert minimum_zone(x, y).deviation.value == pytest.approx(upper, rel=1e-12)
    line = np.linspace(0.0, 2.3, 7)
    assert minimum_zone(line, 0.7 * line + tilt).deviation.value == pytest.approx(0.0, abs=1e-13)


def test_many_points_give_what_few_of_them_give() -> None:
    random = np.random.default_rng(3)
    x = np.sort(random.uniform(0.0, 1.0, 60_000))
    y = 0.3 * np.sin(7.3 * x) + 0.02 * random.normal(size=x.size)
    first, second, third = narrowest_strip(x, y, orthogonal=False)
    slope = (y[second] - y[first]) / (x[second] - x[first])
    width = minimum_zone(x, y).deviation.value
    assert np.ptp(y - slope * x) == pytest.approx(width, rel=1e-12)
    # a convex function of the slope that grows on both sides is least
    assert np.ptp(y - (slope + 1e-6) * x) > width
    assert np.ptp(y - (slope - 1e-6) * x) > width
    assert third not in {first, second}


def test_least_squares_lines_leave_the_least_sum_of_squares() -> None:
    x, y = points(4, 23)
    for measured in ("across", "orthogonal"):
        found = least_squares_straightness(x, y, measured=measured)  # type: ignore[arg-type]
        least = float(found.distances @ found.distances)
        for change, up in ((1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)):
            other = y - (found.slope + change) * x - found.offset - up
            share = np.hypot(1.0, found.slope + change) if measured == "orthogonal" else 1.0
            assert float(other @ other) / share**2 > least
        assert found.deviation.value == pytest.approx(np.ptp(found.distances), rel=1e-12)
    slope, offset = np.polyfit(x, y, 1)
    assert least_squares_straightness(x, y).slope == pytest.approx(slope, rel=1e-10)
    assert least_squares_straightness(x, y).offset == pytest.approx(offset, rel=1e-10)


def test_end_points_are_on_their_line() -> None:
    x, y = points(7, 15)
    shuffled = np.random.default_rng(1).permutation(15)
    found = end_point_straightness(x[shuffled], y[shuffled])
    line = np.interp(x, x[[0, -1]], y[[0, -1]])
    assert found.deviation.value == pytest.approx(np.ptp(y - line), rel=1e-12)
    assert found.slope == pytest.approx((y[-1] - y[0]) / (x[-1] - x[0]), rel=1e-12)


@pytest.mark.parametrize("number", [1, 2, 3, 5])
@pytest.mark.parametrize("kind", ["zone", "zone square", "least", "least square", "ends"])
def test_sensitivities_equal_differences(kind: str, number: int) -> None:
    x, y = points(number, 14)
    square = "orthogonal" if kind.endswith("square") else "across"

    def figure(values: Array):
        if kind.startswith("zone"):
            return minimum_zone(x, values, measured=square)
        if kind.startswith("least"):
            return least_squares_straightness(x, values, measured=square)
        return end_point_straightness(x, values)

    found = figure(y)
    h = 1e-6
    for i in range(x.size):
        up, down = (figure(y + s * h * np.eye(x.size)[i]).deviation.value for s in (1.0, -1.0))
        assert found.sensitivity[i] == pytest.approx((up - down) / (2.0 * h), abs=1e-6)
    c = 0.1 * np.eye(x.size) + 0.02
    expected = float(found.sensitivity @ c @ found.sensitivity) ** 0.5
    given = {"zone": minimum_zone, "least": least_squares_straightness}.get(kind)
    if given:
        assert given(x, y, covariance=c).deviation.uncertainty == pytest.approx(expected)
        # a shift of all points together changes nothing
        shared = given(x, y, covariance=np.full(c.shape, 0.3)).deviation.uncertainty
        assert shared == pytest.approx(0.0, abs=1e-7)


def test_the_cylinder_is_balanced_by_its_contacts() -> None:
    random = np.random.default_rng(8)
    for _ in range(12):
        n = int(random.integers(4, 60))
        x = np.sort(random.uniform(0.0, 1.3, n))
        y, z = random.normal(size=n) + 2.0 * x, 2.7 * random.normal(size=n)
        found = minimum_zone_cylinder(x, y, z)
        axis = found.offsets + x[:, None] * found.slopes
        away = np.stack([y, z], axis=1) - axis
        radius = 0.5 * found.diameter.value
        assert np.hypot(*away.T).max() == pytest.approx(radius, rel=1e-12)
        # Karush, Kuhn and Tucker: weights of 0 or more that balance prove it least
        e, on = away[list(found.contacts)], x[list(found.contacts)]
        assert np.hypot(*e.T) == pytest.approx(np.full(len(e), radius), rel=1e-9)
        assert found.weights.min() >= 0.0
        assert found.weights @ e == pytest.approx(np.zeros(2), abs=1e-9)
        assert (found.weights * on) @ e == pytest.approx(np.zeros(2), abs=1e-9)
        assert 2 <= len(found.contacts) <= 5
        assert found.gap < 1e-9


def test_a_cylinder_about_a_plane_curve_is_the_minimum_zone() -> None:
    x, y = points(6, 31)
    direction = np.array([0.6, 0.8])
    found = minimum_zone_cylinder(x, direction[0] * y, direction[1] * y, covariance=0.01)
    zone = minimum_zone(x, y, covariance=0.01)
    assert found.diameter.value == pytest.approx(zone.deviation.value, rel=1e-9)
    assert found.diameter.uncertainty == pytest.approx(zone.deviation.uncertainty, rel=1e-6)
    assert found.slopes == pytest.approx(zone.slope * direction, rel=1e-6)


def test_an_anisotropic_covariance_reaches_the_diameter() -> None:
    x, y = points(9, 12)
    # all of the noise square to the plane of the curve changes nothing to first order
    found = minimum_zone_cylinder(x, y, 0.0 * y, covariance=np.diag([0.0, 0.04]))
    assert found.diameter.uncertainty == pytest.approx(0.0, abs=1e-6)
    other = minimum_zone_cylinder(x, y, 0.0 * y, covariance=np.diag([0.04, 0.0]))
    same = minimum_zone(x, y, covariance=0.04).deviation.uncertainty
    assert other.diameter.uncertainty == pytest.approx(same, rel=1e-6)


def test_noise_is_told_and_taken_off() -> None:
    x = np.linspace(0.0, 60e-6, 41)
    form = 40e-9 * np.cos(x / 11e-6)
    truth = minimum_zone(x, form).deviation.value
    before, after = [], []
    for seed in range(12):
        y = form + 12e-9 * np.random.default_rng([5, seed]).standard_normal(41)
        found = less_noise(x, y, (12e-9) ** 2, draws=60, seed=seed)
        before.append(minimum_zone(x, y).deviation.value)
        after.append(found.value)
    assert np.mean(before) - truth > 15e-9
    assert abs(np.mean(after) - truth) < 8e-9
    assert "smooth curve" in minimum_zone(x, y, covariance=(12e-9) ** 2).deviation.note
    assert "upper bound" in minimum_zone(x, y).deviation.note
    assert minimum_zone(x, form, covariance=(1e-12) ** 2).deviation.note == ""


def coverage(form: Array, noise: float, seeds: int) -> float:
    x = np.linspace(0.0, 1.0, form.size)
    truth = minimum_zone(x, form).deviation.value
    held = 0
    for seed in range(seeds):
        y = form + noise * np.random.default_rng([17, seed]).standard_normal(form.size)
        held += less_noise(x, y, noise**2, draws=100, seed=seed).covers(truth)
    return held / seeds


@pytest.mark.parametrize("seeds", sizes(slow=100, evidence=300))
@pytest.mark.parametrize("share", [0.01, 0.1, 0.4])
@pytest.mark.parametrize("shape", ["wave", "bow"])
def test_the_corrected_interval_covers(shape: str, share: float, seeds: int) -> None:
    u = np.linspace(0.0, 1.0, 41)
    form = np.sin(6.1 * u) if shape == "wave" else (u - 0.43) ** 2
    form = form / minimum_zone(u, form).deviation.value
    # 300 cases have a standard error of 1.3 %; a bias that the bootstrap leaves may take 2 % more,
    # and the doubt about the growth, which is added to all, may give 3.5 % back
    low, high = limits(seeds, 0.905, 0.99, full=300)
    assert low <= coverage(form, share, seeds) <= high


def test_linear_intervals_cover_where_contacts_stand_alone() -> None:
    # a form of few points, whose contacts noise does not exchange
    x = np.array([0.0, 1.0, 2.2, 3.1, 4.0])
    form = np.array([0.0, 0.4, 1.0, 0.3, 0.1])
    for figure in (minimum_zone, least_squares_straightness, end_point_straightness):
        truth = figure(x, form).deviation.value
        held = 0
        for seed in range(400):
            y = form + 0.01 * np.random.default_rng([23, seed]).standard_normal(5)
            held += figure(x, y, covariance=1e-4).deviation.covers(truth)
        assert 0.925 <= held / 400 <= 0.975


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: minimum_zone([0.0, 1.0], [0.0, 1.0]), RecordError, "three points"),
        (lambda: minimum_zone([0.0, 1.0, np.nan], [0.0, 1.0, 2.0]), RecordError, "finite"),
        (lambda: minimum_zone([2.0] * 3, [0.0, 1.0, 2.0]), RecordError, "same position"),
        (lambda: minimum_zone([0.0, 1, 2], [0.0, 1, 2], covariance=np.ones(2)), RecordError, "3"),
        (lambda: minimum_zone([0.0, 1, 2], [0.0, 1, 2], covariance=-1.0), RecordError, "negative"),
        (
            lambda: minimum_zone([0.0, 1, 2], [0.0, 1, 2], measured="up"),  # type: ignore[arg-type]
            ModelError,
            "orthogonal",
        ),
        (lambda: minimum_zone_cylinder([0.0, 1], [0.0, 1], [0.0, 1]), RecordError, "three points"),
        (lambda: minimum_zone_cylinder([1.0] * 3, [0.0, 1, 2], [0.0] * 3), RecordError, "differ"),
        (
            lambda: minimum_zone_cylinder([0.0, 1, 2], [0.0, 1, 2], [0.0] * 3, covariance=[1.0]),
            RecordError,
            "shape",
        ),
        (lambda: less_noise([0.0, 1, 2, 3], [0.0, 1, 0, 2], 0.0), RecordError, "variance"),
        (lambda: less_noise([0.0, 1, 2, 3], [0.0, 1, 0, 2], 1.0, draws=3), ModelError, "draws"),
        (
            lambda: less_noise(np.arange(12.0), np.arange(12.0) % 2, 1e-4),
            ConvergenceError,
            "true covariance",
        ),
    ],
)
def test_bad_input_is_one_sentence(call, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
