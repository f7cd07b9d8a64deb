"""Identities of error separation that hold for any heads and any scale."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.centring.calibration import (
    ScaleReadings,
    against_reference,
    cross_calibration,
    order_visibility,
    self_calibration,
)
from flexstage.centring.calibration_table import CalibrationTable
from flexstage.centring.move import nearest_in_box
from flexstage.virtual.table import ScaleErrors, scale_errors

TURN = 2.0 * np.pi
ANGLE = TURN * np.arange(96) / 96
HEADS = st.lists(st.floats(0.0, TURN), min_size=2, max_size=6)
SEEDS = st.integers(0, 10_000)
ORDERS = range(1, 24)


def calibrated(
    method, t, y, *, heads, orders, noise=None, head_uncertainty=0.0, **more
) -> CalibrationTable:
    """The table of a scale out of columns."""
    readings = ScaleReadings(
        angle=t, errors=y, heads=heads, noise=noise, head_uncertainty=head_uncertainty
    )
    return method(readings, orders, **more)


def kept(scale: ScaleErrors, orders: tuple[int, ...]) -> ScaleErrors:
    seen = np.isin(scale.orders, orders)
    return ScaleErrors(orders=orders, cosine=scale.cosine[seen], sine=scale.sine[seen])


@given(heads=HEADS, seed=SEEDS, motion=st.booleans())
def test_what_is_seen_is_found_and_the_rest_is_named(heads, seed, motion) -> None:
    alpha = np.array(heads)
    if motion and alpha.size < 4:
        return
    visible = order_visibility(alpha, ORDERS, axis_motion=motion)
    if not np.any(visible > 0.011):
        return
    scale, random = scale_errors(ORDERS, 1e-5, seed=seed), np.random.default_rng(seed)
    common = random.standard_normal((3, ANGLE.size)) * np.array([[1e-4], [motion], [motion]])
    y = scale.at(ANGLE + alpha[:, np.newaxis]) + common[0]
    y = y + 1e-5 * (np.outer(np.sin(alpha), common[1]) + np.outer(np.cos(alpha), common[2]))
    table = calibrated(
        self_calibration,
        ANGLE,
        y,
        heads=alpha,
        orders=ORDERS,
        noise=1e-6,
        axis_motion=motion,
        points=48,
    )
    assert sorted((*table.orders, *table.blind)) == list(ORDERS)
    assert all(visible[n - 1] < 0.0101 for n in table.blind)
    assert all(visible[n - 1] > 0.0099 for n in table.orders)
    # what rounding leaves of the common motion is magnified by what little is seen
    assert np.max(np.abs(table.error - kept(scale, table.orders).at(table.angle))) < 1e-15


@settings(max_examples=40, deadline=None)
@given(heads=HEADS, seed=SEEDS, turn=st.floats(-10.0, 10.0))
def test_turning_all_heads_turns_the_table(heads, seed, turn) -> None:
    alpha = np.array(heads)
    if order_visibility(alpha, (3,))[0] < 0.02:
        return
    y = 1e-6 * np.random.default_rng(seed).standard_normal((alpha.size, ANGLE.size))
    first = calibrated(self_calibration, ANGLE, y, heads=alpha, orders=(3,), noise=1e-6)
    second = calibrated(self_calibration, ANGLE, y, heads=alpha + turn, orders=(3,), noise=1e-6)
    at = np.array([0.3, 1.9, 4.4])
    assert np.max(np.abs(first.error_at(at) - second.error_at(at + turn))) < 1e-18
    assert np.allclose(first.uncertainty, second.uncertainty)


@settings(max_examples=40, deadline=None)
@given(heads=HEADS, seed=SEEDS, factor=st.floats(0.1, 5.0))
def test_tables_are_linear_in_the_readings(heads, seed, factor) -> None:
    alpha, random = np.array(heads), np.random.default_rng(seed)
    a, b = random.standard_normal((2, alpha.size, ANGLE.size))

    def table(y):
        return calibrated(against_reference, ANGLE, y, heads=alpha, orders=ORDERS, noise=1.0).error

    assert np.allclose(table(a + factor * b), table(a) + factor * table(b), atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(reading=st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=5), seed=SEEDS)
def test_correcting_undoes_the_error(reading, seed) -> None:
    scale = scale_errors(ORDERS, 1e-4, seed=seed)
    table = calibrated(
        against_reference, ANGLE, scale.at(ANGLE), heads=[0.0], orders=ORDERS, noise=1e-6
    )
    s = table.correct(reading)
    assert np.max(np.abs(s + scale.at(s) - np.array(reading))) < 1e-13


@settings(max_examples=40, deadline=None)
@given(positions=st.lists(st.floats(0.0, TURN), min_size=2, max_size=6), seed=SEEDS)
def test_two_scales_in_any_positions(positions, seed) -> None:
    phi = np.array(positions)
    visible = 1.0 - np.abs(np.exp(1j * np.outer(phi, ORDERS)).mean(axis=0)) ** 2
    if not np.any(visible > 0.011):
        return
    first, second = (scale_errors(ORDERS, 1e-5, seed=seed + k) for k in (0, 1))
    d = first.at(ANGLE) - second.at(ANGLE + phi[:, np.newaxis]) + phi[:, np.newaxis]
    found = cross_calibration(ANGLE, d, positions=phi, orders=ORDERS, noise=1e-6, points=48)
    for table, scale in zip(found, (first, second), strict=True):
        assert np.max(np.abs(table.error - kept(scale, table.orders).at(table.angle))) < 1e-12
    assert found[0].blind == found[1].blind


@given(seed=SEEDS)
def test_the_nearest_reachable_point(seed) -> None:
    random = np.random.default_rng(seed)
    matrix = np.eye(2) + 0.3 * random.standard_normal((2, 2))
    low, high = -random.uniform(0.2, 1.0, 2), random.uniform(0.2, 1.0, 2)
    target = 2.0 * random.standard_normal(2)
    best = nearest_in_box(matrix, target, low, high)
    assert np.all((low <= best) & (best <= high))
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 60).T)).reshape(2, -1)
    others = np.hypot(*(matrix @ grid - target[:, np.newaxis]))
    assert np.hypot(*(matrix @ best - target)) <= others.min() + 1e-12
