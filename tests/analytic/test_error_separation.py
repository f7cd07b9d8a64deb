"""Errors of a scale out of readings whose truth is known.

Evidence (Measuring and centring): scale tables: $10^{-9}$ arcsec, *consistency*; self-calibration
with its covariance (least squares over all samples): $10^{-9}$; 100 turns with 1 arcsec noise and
20 arcsec wander 0.02 arcsec rms, *simulated*
"""

import math

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.centring.calibration import (
    ScaleReadings,
    against_reference,
    best_heads,
    cross_calibration,
    equal_division,
    order_visibility,
    self_calibration,
)
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.geometry import ARCSEC, exact_error
from flexstage.records import read_record, write_record
from flexstage.virtual.table import ScaleErrors, VirtualTable, scale_errors

HEADS = np.radians([7.0, 44.3, 158.1, 229.2])
EVEN = 2.0 * np.pi * np.arange(7) / 7 + 0.11
ORDERS = range(1, 41)
SCALE = scale_errors(ORDERS, 3.0 * ARCSEC, seed=11)


def calibrated(
    method, t, y, *, heads, orders, noise=None, head_uncertainty=0.0, **more
) -> CalibrationTable:
    """The table of a scale out of columns."""
    readings = ScaleReadings(
        angle=t, errors=y, heads=heads, noise=noise, head_uncertainty=head_uncertainty
    )
    return method(readings, orders, **more)


def truth(table: CalibrationTable, scale: ScaleErrors = SCALE, shift: float = 0.0):
    """The scale's error at the points of a table, without the orders that the table cannot hold."""
    seen = np.isin(scale.orders, table.orders)
    kept = ScaleErrors(
        orders=tuple(np.asarray(scale.orders)[seen]),
        cosine=scale.cosine[seen],
        sine=scale.sine[seen],
    )
    return kept.at(table.angle + shift)


def readings(heads, samples=360, turns=1, *, even=True, noise=0.0, common=0.0, motion=0.0, seed=5):
    """Angles and readings: the scale, a wandering table, a radial motion of order 3, and noise."""
    random = np.random.default_rng(seed)
    t = 2.0 * np.pi * np.arange(samples * turns) / samples + 0.37
    if not even:
        t = t + 0.8 * np.pi / samples * random.uniform(-1.0, 1.0, t.size)
    alpha = np.asarray(heads)[:, np.newaxis]
    y = SCALE.at(t + alpha) + noise * random.standard_normal((alpha.size, t.size))
    y = y + common * (np.sin(3.0 * t + 0.2) + 0.3 * random.standard_normal(t.size))
    x_axis, y_axis = radial_motion(t, motion)
    return t, y + x_axis * np.sin(alpha) - y_axis * np.cos(alpha)


def radial_motion(t, size):
    """What repeats and what does not repeat from turn to turn, over the radius."""
    x = np.cos(3.0 * t + 0.5) + 0.4 * np.cos(0.43 * t)
    return size * x, size * np.sin(2.0 * t - 0.9)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize(
    ("method", "heads", "common"),
    [
        (against_reference, HEADS, 0.0),
        (against_reference, HEADS[:1], 0.0),
        (self_calibration, HEADS, 20.0 * ARCSEC),
        (self_calibration, HEADS[:2], 20.0 * ARCSEC),
        (equal_division, EVEN, 20.0 * ARCSEC),
        (equal_division, np.append(EVEN, 0.5), 20.0 * ARCSEC),
    ],
)
def test_noise_free_tables_are_exact(method, heads, common, even) -> None:
    reference = {"reference": len(heads) - 1} if len(heads) == 8 else {}
    t, y = readings(heads, even=even, common=common)
    table = calibrated(method, t, y, heads=heads, orders=ORDERS, noise=ARCSEC, **reference)
    assert np.max(np.abs(table.error - truth(table))) < 1e-9 * ARCSEC
    assert set(table.orders) | set(table.blind) == set(ORDERS)
    assert table.error_at(table.angle) == pytest.approx(table.error, abs=1e-18)
    corrected = table.correct(table.angle + truth(table))
    assert np.max(np.abs(corrected - table.angle)) < 1e-14


def test_several_turns_that_begin_anywhere_and_run_backwards() -> None:
    t, y = readings(HEADS, samples=180, turns=3, common=5.0 * ARCSEC)
    table = calibrated(
        self_calibration, t[::-1], y[:, ::-1], heads=HEADS, orders=ORDERS, noise=ARCSEC
    )
    assert np.max(np.abs(table.error - truth(table))) < 1e-9 * ARCSEC


def test_even_heads_are_blind_to_multiples_only() -> None:
    t, y = readings(EVEN)
    assert calibrated(equal_division, t, y, heads=EVEN, orders=ORDERS, noise=1.0).blind == (
        7,
        14,
        21,
        28,
        35,
    )
    assert calibrated(self_calibration, t, y, heads=EVEN, orders=ORDERS, noise=1.0).blind == (
        7,
        14,
        21,
        28,
        35,
    )


def test_axis_motion_is_told_from_the_scale() -> None:
    heads = np.append(HEADS, 5.61)
    t, y = readings(heads, turns=2, common=9.0 * ARCSEC, motion=30.0 * ARCSEC)
    table = calibrated(
        self_calibration, t, y, heads=heads, orders=ORDERS, noise=ARCSEC, axis_motion=True
    )
    assert table.blind == (1,)
    assert np.max(np.abs(table.error - truth(table))) < 1e-9 * ARCSEC
    without = calibrated(self_calibration, t, y, heads=heads, orders=ORDERS, noise=ARCSEC)
    assert np.max(np.abs(without.error - truth(without))) > ARCSEC


@pytest.mark.parametrize("motion", [False, True])
def test_visibility_is_the_price_in_noise(motion: bool) -> None:
    heads = np.append(HEADS, 5.61)
    t, y = readings(heads)
    alone = calibrated(
        self_calibration,
        t,
        y,
        heads=heads,
        orders=range(2, 30),
        noise=1e-6,
        axis_motion=motion,
        blindness=1e-4,
    )
    best = calibrated(against_reference, t, y, heads=heads, orders=range(2, 30), noise=1e-6)
    price = (best.order_uncertainty / alone.order_uncertainty) ** 2
    assert price == pytest.approx(order_visibility(heads, range(2, 30), axis_motion=motion))
    assert best.uncertainty == pytest.approx(1e-6 * math.sqrt(2.0 * 28 / (5 * 360)))


def test_a_realistic_table_to_a_fiftieth_of_an_arcsecond() -> None:
    # 100 turns with 1 arcsec of noise in each reading, and a table that wanders by 20 arcsec
    t, y = readings(HEADS, samples=720, turns=100, noise=ARCSEC, common=20.0 * ARCSEC)
    table = calibrated(self_calibration, t, y, heads=HEADS, orders=ORDERS, noise=None)
    error = table.error - truth(table)
    assert np.sqrt(np.mean(error**2)) < 0.02 * ARCSEC
    assert np.sqrt(np.mean(error**2)) == pytest.approx(table.uncertainty[0], rel=0.3)
    assert table.noise == pytest.approx(ARCSEC, rel=0.01)


@pytest.mark.parametrize(
    ("method", "even", "known"),
    [
        (against_reference, True, True),
        (against_reference, True, False),
        (self_calibration, True, False),
        (self_calibration, False, False),
        (self_calibration, False, True),
        (equal_division, True, False),
    ],
)
def test_intervals_cover_the_truth(method, even, known) -> None:
    heads = EVEN if method is equal_division else HEADS[:3]
    noise = None if not known else (ARCSEC if method is equal_division else ARCSEC * np.ones(3))
    inside = total = 0
    for seed in range(60):
        t, y = readings(heads, samples=90, even=even, noise=ARCSEC, seed=seed)
        table = calibrated(method, t, y, heads=heads, orders=range(1, 41), noise=noise)
        factor = table.estimate(0.0).coverage_factor
        off = np.abs(table.error - truth(table)) / table.uncertainty
        # points as far apart as this are nearly independent: 80 parameters on a turn
        inside += int(np.sum(off[::12] <= factor))
        total += off[::12].size
    assert 0.93 < inside / total < 0.97


@pytest.mark.parametrize("method", [against_reference, self_calibration, equal_division])
@pytest.mark.parametrize("even", [True, False])
def test_uncertainty_is_that_of_each_reading_by_itself(method, even: bool) -> None:
    # tables are linear in the readings: what each of them does to the table adds up in squares
    heads = EVEN[:3] * 7.0 / 3.0 if method is equal_division else HEADS[:3]
    t, y = readings(heads, samples=30, even=even)
    if not even:
        t = t + 0.12 * np.sin(t) + 0.1 * np.cos(3.0 * t)
    noise = 0.7 if method is equal_division else np.array([0.3, 1.1, 0.7])
    settings = {"heads": heads, "orders": (1, 2, 4, 5), "noise": noise, "points": 24}
    variance = np.zeros(24)
    for j, sigma in enumerate(np.broadcast_to(noise, 3)):
        for k in range(t.size):
            one = np.zeros_like(y)
            one[j, k] = sigma
            variance += calibrated(method, t, one, **settings).error ** 2
    assert calibrated(method, t, y, **settings).uncertainty == pytest.approx(
        np.sqrt(variance), rel=1e-9
    )


def test_unequal_heads_are_weighted() -> None:
    sigma = np.array([0.3, 4.0, 1.1, 0.7]) * ARCSEC
    off, stated = [], []
    for seed in range(30):
        t, y = readings(HEADS, samples=120, seed=seed)
        y = y + sigma[:, np.newaxis] * np.random.default_rng(seed + 900).standard_normal(y.shape)
        table = calibrated(self_calibration, t, y, heads=HEADS, orders=range(1, 41), noise=sigma)
        off.append(np.mean((table.error - truth(table)) ** 2))
        stated.append(table.uncertainty[0])
    assert math.sqrt(np.mean(off)) == pytest.approx(stated[0], rel=0.05)
    equal = calibrated(
        self_calibration, t, y, heads=HEADS, orders=range(1, 41), noise=np.full(4, sigma.max())
    )
    assert stated[0] < 0.5 * equal.uncertainty[0]


def test_head_angle_errors_are_in_the_uncertainty() -> None:
    u = 2e-3
    off = []
    for seed in range(100):
        wrong = HEADS + u * np.random.default_rng(seed).standard_normal(4)
        t, y = readings(wrong, samples=120)
        table = calibrated(
            self_calibration,
            t,
            y,
            heads=HEADS,
            orders=ORDERS,
            noise=1e-12,
            head_uncertainty=u,
            points=90,
        )
        off.append((table.error - truth(table)) / table.uncertainty)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.1)


def test_rosette_recovers_both_scales() -> None:
    t = 2.0 * np.pi * np.arange(36) / 36
    first, second = (
        scale_errors(range(1, 18), 2e-5, seed=3),
        scale_errors(range(1, 18), 3e-5, seed=4),
    )
    zero = np.random.default_rng(8).standard_normal((36, 1))
    d = zero + first.at(t) - second.at(t + t[:, np.newaxis])
    found = cross_calibration(t, d, positions=t, orders=range(1, 18), noise=1e-7, points=72)
    for table, scale in zip(found, (first, second), strict=True):
        assert table.blind == ()
        assert np.max(np.abs(table.error - truth(table, scale))) < 1e-14
        # every order is seen in full: 36 positions, of which the other scale takes one half each
        assert table.order_uncertainty == pytest.approx(1e-7 * math.sqrt(2.0 / (36 * 36)))


@pytest.mark.parametrize("even", [True, False])
def test_few_positions_and_noise(even: bool) -> None:
    positions = np.array([0.0, 1.1, 2.9, 4.0])
    first, second = (
        scale_errors(range(1, 12), 2e-5, seed=3),
        scale_errors(range(1, 12), 3e-5, seed=4),
    )
    inside = total = 0
    for seed in range(75):
        random = np.random.default_rng(seed)
        t = 2.0 * np.pi * np.arange(48) / 48 + 0.2
        if not even:
            t = t + 0.04 * random.uniform(-1.0, 1.0, t.size)
        d = first.at(t) - second.at(t + positions[:, np.newaxis])
        d = d + 1e-6 * random.standard_normal(d.shape)
        tables = cross_calibration(t, d, positions=positions, orders=range(1, 12))
        for table, scale in zip(tables, (first, second), strict=True):
            off = np.abs(table.error - truth(table, scale)) / table.uncertainty
            inside += int(np.sum(off[::40] <= table.estimate(0.0).coverage_factor))
            total += off[::40].size
    assert 0.93 < inside / total < 0.97


def test_positions_that_repeat_an_order_are_blind_to_it() -> None:
    t = 2.0 * np.pi * np.arange(60) / 60
    positions = np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
    first, second = cross_calibration(
        t, np.zeros((3, 60)), positions=positions, orders=range(1, 13), noise=1.0
    )
    assert first.blind == second.blind == (3, 6, 9, 12)


def test_allowance_for_blind_orders() -> None:
    t, y = readings(EVEN)
    plain = calibrated(equal_division, t, y, heads=EVEN, orders=ORDERS, noise=1e-6)
    wide = calibrated(
        equal_division, t, y, heads=EVEN, orders=ORDERS, noise=1e-6, blind_allowance=2e-6
    )
    assert wide.uncertainty**2 == pytest.approx(plain.uncertainty**2 + 4e-12)
    assert "7, 14, 21, 28, 35" in wide.estimate(0.3).note


def test_the_table_as_a_file(tmp_path) -> None:
    t, y = readings(HEADS)
    table = calibrated(self_calibration, t, y, heads=HEADS, orders=ORDERS, noise=ARCSEC, points=120)
    path = write_record(table.record(), tmp_path / "table.csv")
    again = read_record(path, over="point")
    assert np.array_equal(again.channel("error").values, table.error)
    assert again.channel("uncertainty").unit == "rad"


def test_the_virtual_table_reads_by_its_exact_geometry() -> None:
    table = VirtualTable(
        radius=41e-3,
        heads=(0.3, 2.2),
        head_angle_errors=(1e-3, -2e-3),
        head_radius_errors=(20e-6, -35e-6),
        eccentricity=(31e-6, -17e-6),
        scale=SCALE,
        axis_orders=(2,),
        axis_motion=np.array([[3e-7, -1e-7, 2e-7, 4e-7]]),
        samples=72,
        start=0.4,
    )
    record = table.record()
    t = record.channel("angle").values
    motion = np.stack(
        (
            3e-7 * np.cos(2 * t) - 1e-7 * np.sin(2 * t),
            2e-7 * np.cos(2 * t) + 4e-7 * np.sin(2 * t),
        ),
        axis=1,
    )
    d = exact_error(t, (31e-6, -17e-6), 41e-3 - 35e-6, head_angle=2.2 - 2e-3, axis_motion=motion)
    expected = d + SCALE.at(t + 2.2 - 2e-3 + d)
    assert record.channel("head 2").values == pytest.approx(expected, abs=1e-18)
    assert record.over == "point"
    assert "not measured" in record.notes[0]


def test_noise_of_the_virtual_table_is_seeded_and_of_the_size_given() -> None:
    table = VirtualTable(
        radius=50e-3, heads=(0.0, 1.0), noise=2e-6, reference_noise=5e-6, samples=4000, seed=3
    )
    first, second = (table.record().channel(f"head {k}").values for k in (1, 2))
    assert np.std(first - second) == pytest.approx(2e-6 * math.sqrt(2.0), rel=0.05)
    assert np.std(first + second) == pytest.approx(math.sqrt(4 * 25.0 + 8.0) * 1e-6, rel=0.05)
    assert np.array_equal(first, table.record().channel("head 1").values)
    assert not np.array_equal(first, table.record(index=1).channel("head 1").values)
    wander = VirtualTable(radius=50e-3, asynchronous=4e-7, samples=300, turns=40, seed=6).record()
    assert np.std(wander.channel("head 1").values) * 50e-3 == pytest.approx(4e-7, rel=0.1)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda t, y: calibrated(self_calibration, t, y[:1], heads=[0.0], orders=(1,)),
            "at least 2 heads",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y, heads=HEADS[:3], orders=(1,)),
            "3 heads, but readings",
        ),
        (
            lambda t, y: calibrated(self_calibration, t[:90], y[:, :90], heads=HEADS, orders=(1,)),
            "gap of",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y * np.nan, heads=HEADS, orders=(1,)),
            "finite",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y, heads=HEADS, orders=(180,), points=400),
            "got 360",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y, heads=HEADS, orders=(0, 1)),
            "1 or more, got 0",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y, heads=HEADS, orders=(1,), noise=0.0),
            "positive",
        ),
        (
            lambda t, y: calibrated(self_calibration, t, y, heads=HEADS, orders=(90,), points=180),
            "points",
        ),
        (
            lambda t, y: calibrated(equal_division, t, y, heads=HEADS, orders=(1,)),
            "divide the turn evenly",
        ),
        (
            lambda t, y: calibrated(equal_division, t, y, heads=EVEN[:4], orders=(7,)),
            "divide the turn evenly",
        ),
        (
            lambda t, y: calibrated(against_reference, t, y, heads=HEADS, orders=(1,)).harmonic(2),
            "not requested",
        ),
        (lambda t, y: cross_calibration(t, y[:1], positions=[0.0], orders=(1,)), "two positions"),
        (
            lambda t, y: cross_calibration(t, y, positions=[0.1] * 4, orders=(1,)),
            "do not separate the scales",
        ),
        (
            lambda t, y: calibrated(
                self_calibration, t, y[:2], heads=[0.0, np.pi], orders=(2, 4), axis_motion=False
            ),
            "are blind to all orders",
        ),
        (
            lambda t, y: calibrated(
                against_reference, t, 1e5 * y, heads=HEADS, orders=ORDERS
            ).correct(0.3),
            "in radians",
        ),
    ],
)
def test_what_cannot_be_done_says_so(call, sentence: str) -> None:
    t, y = readings(HEADS)
    with pytest.raises((ModelError, RecordError), match=sentence):
        call(t, y)


def test_self_calibration_is_plain_least_squares_over_all_samples() -> None:
    """A second implementation: every angle of the table an unknown, and no Fourier transform."""
    t, y = readings(HEADS, samples=48, noise=ARCSEC, common=20.0 * ARCSEC)
    orders, size = range(1, 9), t.size
    table = calibrated(self_calibration, t, y, heads=HEADS, orders=orders)
    blocks = []
    for j, alpha in enumerate(HEADS):
        phase = np.outer(t + alpha, orders)
        zero = np.zeros((size, HEADS.size))
        zero[:, j] = 1.0
        blocks.append(np.hstack((np.cos(phase), np.sin(phase), zero, np.eye(size))))
    X = np.vstack(blocks)
    x, _, rank, _ = np.linalg.lstsq(X, y.ravel(), rcond=None)
    assert np.allclose(np.concatenate((table.cosine, table.sine)), x[:16], rtol=1e-9, atol=0.0)
    freedom = X.shape[0] - rank
    rest = y.ravel() - X @ x
    assert table.degrees_of_freedom == freedom
    assert table.noise == pytest.approx(math.sqrt(rest @ rest / freedom))
    covariance = table.noise**2 * np.linalg.pinv(X.T @ X)[:16, :16]
    phase = np.outer(table.angle[::10], orders)
    waves = np.hstack((np.cos(phase), np.sin(phase)))
    division = table.division(36)
    assert np.allclose(division.covariance, waves @ covariance @ waves.T, rtol=1e-9, atol=1e-22)


@pytest.mark.parametrize(
    ("heads", "step", "angles", "gain"),
    [(2, 2.5, (0.0, 190.0), 4.07), (3, 5.0, (0.0, 65.0, 255.0), 1.03),
     (4, 10.0, (0.0, 20.0, 210.0, 320.0), 0.640)],
)  # fmt: skip
def test_heads_are_placed_by_the_noise_that_they_give(heads, step, angles, gain) -> None:
    found = best_heads(heads, range(1, 17), step=math.radians(step))
    assert found.examined == math.comb(round(360.0 / step) - 1, heads - 1)
    assert found.gain.max() == pytest.approx(gain, abs=6e-3)

    def worst(alpha):
        waves = np.exp(1j * np.outer(alpha, np.arange(1, 17)))
        left = np.sum(np.abs(waves - waves.mean(axis=0)) ** 2, axis=0)
        return float(np.max(1.0 / np.sqrt(left)))

    # an arrangement that was found elsewhere is as good, and none at random is better
    assert worst(np.radians(angles)) == pytest.approx(found.gain.max())
    assert worst(found.heads) == pytest.approx(found.gain.max())
    random = np.random.default_rng(heads)
    grid = np.radians(step) * random.integers(0, round(360.0 / step), (3000, heads))
    with np.errstate(divide="ignore"):
        assert min(map(worst, grid)) > found.gain.max() - 1e-9
