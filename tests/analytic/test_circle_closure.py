"""Circle closure against closed forms, explicit least squares, and another published algorithm.

Evidence (Measuring and centring): polygons by closure: variance and covariance (Estler 1998), few
settings (Fourier), two autocollimators (Khamaysa and Iwasinska-Kowalska 2026): $10^{-12}$
"""

import re

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration import ScaleReadings, self_calibration
from flexstage.centring.closure import dual_closure, simple_closure

RNG = np.random.default_rng(12)
#: Settings of a polygon of 12 faces, and the mean variance of a face in units of that of a reading:
#: from the Fourier formula, worked out apart from the package.
FEW = {
    (0, 1): 1.99, (0, 1, 3): 0.47, (0, 1, 4, 6): 0.28, tuple(range(6)): 0.175,
    tuple(range(12)): 0.0764,
}  # fmt: skip


def rosette(a, b, settings, offsets):
    """Readings of a polygon a on a table b, as the definition has them."""
    n = len(a)
    return np.array([
        [a[i] - b[(i + s) % n] + c for s, c in zip(settings, offsets, strict=True)]
        for i in range(n)
    ])  # fmt: skip


def impulses(solve, shape):
    """The matrix from readings to faces, by a reading of one at each place in turn."""
    columns = []
    for place in np.ndindex(*shape):
        y = np.zeros(shape)
        y[place] = 1.0
        columns.append(solve(y).faces.error)
    return np.array(columns).T


@pytest.mark.parametrize("n", [3, 8, 12, 24])
def test_simple_closure_has_estlers_variance_and_covariance(n: int) -> None:
    # Estler 1998, J. Res. NIST 103, 141: u^2 = s^2 (1 - 1/n), and -s^2/n between segments
    found = simple_closure(RNG.standard_normal(n), noise=3.0).faces
    step = np.roll(np.eye(n), 1, axis=1) - np.eye(n)
    expected = 9.0 * (np.eye(n) - 1.0 / n)
    assert np.allclose(step @ found.covariance @ step.T, expected, rtol=0.0, atol=1e-12)
    assert found.difference(1, 0).uncertainty == pytest.approx(3.0 * np.sqrt(1.0 - 1.0 / n))


@pytest.mark.parametrize("n", [4, 7, 12, 36])
def test_dual_closure_has_estlers_variance_and_covariance(n: int) -> None:
    found = dual_closure(RNG.standard_normal((n, n)), range(n), noise=1.0)
    assert found.table is not None
    for circle in (found.faces, found.table):
        expected = np.eye(n) / n - 1.0 / n**2
        assert np.allclose(circle.covariance, expected, rtol=0.0, atol=1e-12)
        assert circle.difference(2, 0).uncertainty == pytest.approx(np.sqrt(2.0 / n))


def test_all_settings_give_row_means_after_column_means() -> None:
    y = RNG.standard_normal((12, 12))
    found = dual_closure(y, range(12))
    by_hand = (y - y.mean(axis=0)).mean(axis=1)
    assert np.allclose(found.faces.error, by_hand, rtol=0.0, atol=1e-13)
    assert found.degrees_of_freedom == 11 * 10


@pytest.mark.parametrize("settings", FEW, ids=str)
def test_few_settings_have_the_variance_of_each_order(settings) -> None:
    n, size = 12, len(settings)
    found = dual_closure(RNG.standard_normal((n, size)), settings, noise=1.0).faces
    assert np.mean(found.uncertainty**2) == pytest.approx(FEW[settings], rel=0.01)
    for k in range(1, n // 2 + 1):
        total = abs(np.exp(2j * np.pi * k * np.array(settings) / n).sum()) ** 2
        variance = size / (n * (size**2 - total))
        # a cosine of order k has the amplitude of two orders of the complex transform
        amplitude = found.harmonic(k)[0].uncertainty ** 2
        assert amplitude == pytest.approx(variance * (1.0 if 2 * k == n else 2.0))


def test_a_difference_set_is_nearly_flat() -> None:
    spread = {}
    for settings in ((0, 1, 4, 6), (0, 1, 2, 3)):
        found = dual_closure(RNG.standard_normal((12, 4)), settings, noise=1.0).faces
        u = [found.harmonic(k)[0].uncertainty for k in range(1, 6)]
        spread[settings] = max(u) / min(u)
    assert spread[0, 1, 4, 6] < 1.1
    assert spread[0, 1, 2, 3] > 1.4


@pytest.mark.parametrize(
    ("settings", "blind"), [((0, 3, 6, 9), (4,)), ((0, 4), (3, 6)), ((0, 6), (2, 4, 6))]
)
def test_orders_that_no_setting_tells_apart_are_missing(settings, blind) -> None:
    n = 12
    a, b = RNG.standard_normal((2, n))
    found = dual_closure(rosette(a, b, settings, RNG.standard_normal(len(settings))), settings,
                         noise=1e-3)  # fmt: skip
    assert found.table is not None
    assert found.faces.blind == blind
    for circle, truth in ((found.faces, a), (found.table, b)):
        seen = np.fft.rfft(truth)
        seen[[0, *blind]] = 0.0
        assert np.allclose(circle.error, np.fft.irfft(seen, n), rtol=0.0, atol=1e-12)
        assert all(circle.harmonic(k)[2].uncertainty < 1e-9 for k in blind)


@pytest.mark.parametrize("settings", [(0, 1, 4, 6), (0, 4), (0, 2, 7)], ids=str)
def test_covariance_is_that_of_readings_one_by_one(settings) -> None:
    shape = (12, len(settings))
    found = dual_closure(np.zeros(shape), settings, noise=1.0)
    per_reading = impulses(lambda y: dual_closure(y, settings, noise=1.0), shape)
    assert np.allclose(per_reading @ per_reading.T, found.faces.covariance, rtol=0.0, atol=1e-12)
    per_reading = impulses(lambda y: simple_closure(y, span=5, noise=1.0), shape)
    found = simple_closure(np.zeros(shape), span=5, noise=1.0)
    assert np.allclose(per_reading @ per_reading.T, found.faces.covariance, rtol=0.0, atol=1e-12)


def test_missing_readings_are_plain_least_squares_without_them() -> None:
    n, settings = 9, (0, 1, 3, 7)
    y = RNG.standard_normal((n, 4))
    y[[0, 3, 8], [1, 1, 3]] = np.nan
    found = dual_closure(y, settings)
    assert found.table is not None
    rows, read = [], []
    for i, j in np.argwhere(np.isfinite(y)):
        row = np.zeros(2 * n + 4)
        row[i], row[n + (i + settings[j]) % n], row[2 * n + j] = 1.0, -1.0, 1.0
        rows.append(row)
        read.append(y[i, j])
    # the sums of both circles are zero
    X = np.vstack([*rows, np.repeat((1.0, 0.0), (n, n + 4)), np.repeat((0.0, 1.0, 0.0), (n, n, 4))])
    x, _, rank, _ = np.linalg.lstsq(X, np.append(read, (0.0, 0.0)), rcond=None)
    assert rank == 2 * n + 4
    assert np.allclose(found.faces.error, x[:n], rtol=0.0, atol=1e-12)
    assert np.allclose(found.table.error, x[n : 2 * n], rtol=0.0, atol=1e-12)
    rest = np.append(read, (0.0, 0.0)) - X @ x
    freedom = len(read) - (2 * n + 4 - 2)
    assert found.degrees_of_freedom == freedom
    assert found.noise == pytest.approx(np.sqrt(rest @ rest / freedom))


def test_two_autocollimators_as_another_closed_form_has_it() -> None:
    """Khamaysa and Iwasinska-Kowalska, www.mchtr.pw.edu.pl/polygon (Measurement 280, 121770).

    Shifts d_i = (m_i - r_(i-1)) - (m_1 - r_n) of the measuring and the reference sensor give the
    faces by b_i - 2 b_(i-1) + b_(i-2) = d_i - d_(i-1) and a sum of zero.
    """
    n = 12
    measured, reference = RNG.standard_normal((2, n))
    d = measured - np.roll(reference, 1) - (measured[0] - reference[-1])
    second = np.roll(np.eye(n), 2, axis=1).T - 2.0 * np.roll(np.eye(n), 1, axis=1).T + np.eye(n)
    X = np.vstack([second, np.ones(n)])
    published = np.linalg.lstsq(X, np.append(d - np.roll(d, 1), 0.0), rcond=None)[0]
    # reading i here is from face i to face i + 1
    found = simple_closure(np.roll(measured - np.roll(reference, 1), -1), noise=1.0)
    assert np.allclose(found.faces.error, published, rtol=0.0, atol=1e-12)


def test_seven_faces_unfolded_in_steps_of_three() -> None:
    # as a national institute calibrates a polygon of seven faces whose segment no table divides
    a = RNG.standard_normal(7)
    a -= a.mean()
    y = np.array([a[(i + 3) % 7] - a[i] + 40.0 for i in range(7)])
    found = simple_closure(y, span=3, noise=1.0)
    assert np.allclose(found.faces.error, a)
    assert found.offsets == pytest.approx([40.0])
    assert found.faces.blind == ()
    assert simple_closure(RNG.standard_normal(12), span=3, noise=1.0).faces.blind == (4,)


def test_rounds_give_their_own_noise() -> None:
    n, rounds = 12, 40
    a = RNG.standard_normal(n)
    y = np.roll(a, -1)[:, np.newaxis] - a[:, np.newaxis] + RNG.standard_normal(rounds)
    found = simple_closure(y + 0.02 * RNG.standard_normal((n, rounds)))
    assert found.noise == pytest.approx(0.02, rel=0.1)
    assert found.degrees_of_freedom == (n - 1) * (rounds - 1)
    assert np.max(np.abs(found.faces.error - a + a.mean())) < 0.02


def test_gain_of_the_autocollimator_scales_all_faces() -> None:
    y = rosette(*RNG.standard_normal((2, 6)), range(6), np.zeros(6))
    found = dual_closure(y, range(6), noise=1e-6, gain_uncertainty=0.01).faces
    more = dual_closure(1.01 * y, range(6), noise=1e-6).faces
    assert np.allclose(found.uncertainty, np.abs(more.error - found.error), rtol=1e-6)
    assert found.difference(3, 1).components[1].uncertainty == pytest.approx(
        0.01 * abs(found.error[3] - found.error[1])
    )


@pytest.mark.parametrize(
    ("call", "error", "sentence"),
    [
        (lambda: simple_closure([1.0, 2.0, 3.0]), RecordError, "give it by --noise"),
        (lambda: simple_closure([1.0, 2.0]), RecordError, "three faces or more"),
        (lambda: simple_closure(np.zeros(6), span=6), ModelError, "multiple of the 6 faces"),
        (lambda: simple_closure(np.zeros(4), noise=-1.0), ModelError, "0 or more"),
        (lambda: dual_closure(np.zeros((6, 2)), (2, 8)), RecordError, "turn the polygon"),
        (lambda: dual_closure(np.zeros((6, 2)), (1,)), ModelError, "each of 2 columns"),
        (lambda: dual_closure(np.full((6, 3), np.inf), (0, 1, 2)), RecordError, "finite"),
    ],
)
def test_what_cannot_be_closed_says_so(call, error, sentence: str) -> None:
    with pytest.raises(error, match=re.escape(sentence)):
        call()


def test_faces_without_readings_are_named_as_unconnected() -> None:
    y = np.zeros((6, 3))
    y[2] = np.nan
    with pytest.raises(RecordError, match="unconnected"):
        dual_closure(y, (0, 1, 3))


@pytest.mark.parametrize("even", [True, False])
def test_covariance_of_a_scale_is_that_of_readings_one_by_one(even: bool) -> None:
    heads = np.radians([0.0, 20.0, 210.0, 320.0])
    t = 2.0 * np.pi * np.arange(24) / 24
    t = t if even else t + 0.2 * RNG.uniform(-1.0, 1.0, t.size)

    def table(y, **more):
        readings = ScaleReadings(angle=t, errors=y, heads=heads, noise=1.0, **more)
        return self_calibration(readings, range(1, 8), points=18)

    columns = []
    for place in np.ndindex(4, t.size):
        y = np.zeros((4, t.size))
        y[place] = 1.0
        columns.append(table(y).error)
    per_reading = np.array(columns).T
    found = table(np.zeros((4, t.size)))
    division = found.division(18)
    assert np.allclose(division.covariance, per_reading @ per_reading.T, rtol=0.0, atol=1e-12)
    assert np.allclose(division.uncertainty, found.uncertainty)


def test_head_angles_and_blind_orders_are_in_the_covariance() -> None:
    t = 2.0 * np.pi * np.arange(64) / 64
    step = 1e-3

    def table(nominal, stood, **more):
        s = t + stood[:, np.newaxis]
        y = 1e-5 * np.cos(3.0 * s - 0.7) + 4e-6 * np.sin(5.0 * s)
        readings = ScaleReadings(angle=t, errors=y, heads=nominal, noise=1e-12, **more)
        return self_calibration(readings, range(1, 9), points=32, blind_allowance=2e-7)

    uneven = np.radians([0.0, 20.0, 210.0, 320.0])
    found = table(uneven, uneven, head_uncertainty=step)
    moved = np.array([
        table(uneven, uneven + step * np.eye(4)[j]).error - found.error for j in range(4)
    ])  # fmt: skip
    by_hand = moved.T @ moved
    (_, heads) = found.division(32).contributions
    assert np.allclose(heads.covariance, by_hand, atol=5e-3 * by_hand.max())
    even = 2.0 * np.pi * np.arange(4) / 4
    division = table(even, even).division(32)
    assert division.blind == (4, 8)
    (_, unseen) = division.contributions
    assert np.allclose(np.diag(unseen.covariance), 4e-14)
    # orders 4 and 8 repeat after a quarter of a turn
    assert np.allclose(unseen.covariance, np.roll(unseen.covariance, 8, axis=0))
    assert division.difference(8, 0).components[1].uncertainty < 1e-12


def test_intervals_of_faces_and_of_angles_between_them_cover_the_truth() -> None:
    settings, covered = (0, 1, 3), []
    for _ in range(600):
        a, b = RNG.standard_normal((2, 7))
        y = rosette(a, b, settings, RNG.standard_normal(3)) + 0.1 * RNG.standard_normal((7, 3))
        found = dual_closure(y, settings).faces
        covered += [found.estimate(0).covers(a[0] - a.mean())]
        covered += [found.difference(4, 1).covers(a[4] - a[1])]
    # 6 degrees of freedom: the normal distribution would cover 90 %
    assert 0.93 < np.mean(covered) < 0.97
