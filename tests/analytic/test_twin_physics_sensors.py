"""What the sensors of a simulated stage add: noise, mains, drift, steps, gains."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.stage.designs import design
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.sensors import Disturbances, SensorBench, SimulatedSensor, kinds_of
from tests.twin_parts import small_stage

BENCH = SensorBench(
    along=SimulatedSensor(
        noise_rms=4.3e-9, mains_amplitude=9.1e-9, resolution_step=1e-10, calibration=3e-3
    ),
    mains_frequency_hz=60.0,
)
KINDS = ["along", "along", "transverse", "angle"]


def still(bench: SensorBench, seed: int, seconds: float = 4.0) -> Array:
    """Readings of both axes while nothing moves."""
    stage = small_stage(straight=True, quiet=False, sensors=bench, seed=seed)
    return stage.run(np.zeros((2, round(seconds * 10e3))), (False, False)).reading[:2]


def test_noise_and_mains_have_the_size_that_is_said() -> None:
    readings = still(BENCH, 5)
    t = np.arange(readings.shape[1]) / 10e3
    unit = np.exp(-2j * np.pi * 60.0 * t)
    for seen in readings:
        y = seen - np.polynomial.Polynomial.fit(t, seen, 3)(t)
        mains = 2.0 * np.mean(y * unit)
        # its deviation is sqrt(2 / 40 000) of the noise, 0.03 nm
        assert abs(mains) == pytest.approx(9.1e-9, abs=0.15e-9)
        rest = y - np.real(mains * np.conj(unit))
        # of 40 000 samples, 0.35 % at one sigma
        assert np.std(rest) == pytest.approx(4.3e-9, rel=0.015)
        neighbours = np.mean(rest[1:] * rest[:-1]) / np.var(rest)
        assert abs(neighbours) < 4.0 / np.sqrt(rest.size)


def test_sensors_have_noise_and_phases_of_their_own() -> None:
    x, y = still(BENCH, 5)
    t = np.arange(x.size) / 10e3
    unit = np.exp(-2j * np.pi * 60.0 * t)
    turned = np.angle(np.mean((x - x.mean()) * unit) / np.mean((y - y.mean()) * unit))
    assert abs(turned) > 0.05
    rough_x, rough_y = np.diff(x, 2), np.diff(y, 2)
    assert abs(np.corrcoef(rough_x, rough_y)[0, 1]) < 6.0 / np.sqrt(x.size)


def test_readings_are_whole_steps_of_the_sensor() -> None:
    readings = still(BENCH, 2, 0.1) / 1e-10
    assert np.abs(readings - np.round(readings)).max() < 1e-6
    assert np.ptp(np.round(readings)) > 100


def test_a_seed_repeats_and_another_differs() -> None:
    assert np.array_equal(still(BENCH, 8, 0.2), still(BENCH, 8, 0.2))
    assert not np.any(np.all(still(BENCH, 8, 0.2) == still(BENCH, 9, 0.2), axis=1))


def test_gains_scatter_as_they_are_said_to() -> None:
    gains = np.array([Disturbances(KINDS, BENCH, 10e3, seed).gain[:2] - 1.0 for seed in range(150)])
    # 300 draws know their deviation to 4 %
    assert gains.std() == pytest.approx(3e-3, rel=0.15)
    assert np.all(Disturbances(KINDS, BENCH, 10e3, 3, scatter=False).gain == 1.0)


def test_a_reading_is_gain_times_motion() -> None:
    stage = virtual_stage(design("vgtu-piezo"), model="lumped", seed=4)
    gain = Disturbances(kinds_of(stage.channels), SensorBench(), 10e3, 4).gain[:2]
    assert np.all(np.abs(gain - 1.0) > 2e-6)
    block = stage.run(np.full((2, 20_000), 90.0), (False, False))
    ratio = block.reading[:2].mean(axis=1) / block.position.mean(axis=1)
    # the mean of 20 000 samples of 5 nm, over 50 um, is known to 1e-6
    assert ratio == pytest.approx(gain, abs=3e-6)


def test_quiet_sensors_add_nothing() -> None:
    quiet = Disturbances(KINDS, BENCH, 10e3, 4, quiet=True)
    drift, noise = quiet.take(7, 20)
    assert drift.shape == noise.shape == (4, 20)
    assert not drift.any()
    assert not noise.any()
    assert not quiet.step.any()


def test_drift_begins_at_nothing_and_has_the_rate_that_is_said() -> None:
    step = 4096 / 400.0
    squares = []
    for seed in range(16):
        drawn = Disturbances(KINDS, BENCH, 400.0, seed)
        at = np.array([drawn.take(4096 * k, 1)[0][:, 0] for k in range(100)])
        assert np.all(at[0] == 0.0)
        # one room: all sensors drift together, each by a part of its own
        by_sensor = at[1:] / at[1:, :1]
        assert np.allclose(by_sensor, by_sensor[0])
        squares.append(np.mean((np.diff(at[:, :2], axis=0) / step) ** 2))
    # 16 rooms of 1000 s are some 50 independent rates; the parts scatter from 0.6 to 1.4
    assert np.sqrt(np.mean(squares)) == pytest.approx(10e-9 / 60.0, rel=0.3)


def test_drift_goes_on_where_a_block_of_samples_ends() -> None:
    drift = Disturbances(KINDS, BENCH, 400.0, 5).take(0, 8 * 4096)[0]
    steps = np.abs(np.diff(drift, axis=1))
    at_ends = steps[:, 4095::4096]
    within = np.delete(steps, np.s_[4095::4096], axis=1)
    assert np.all(at_ends.max(axis=1) <= within.max(axis=1) * (1.0 + 1e-9))


def test_drift_is_motion_of_the_platform_and_noise_is_not() -> None:
    fast = replace(BENCH, drift_rate=1e-6)
    stage = small_stage(straight=True, quiet=False, sensors=fast, seed=6)
    block = stage.run(np.zeros((2, 20_000)), (False, False))
    kinds = kinds_of(stage.channels)
    drift, noise = Disturbances(kinds, fast, 10e3, 6, scatter=False).take(0, 20_000)
    assert np.abs(drift[:, -1]).min() > 1e-7
    assert block.position == pytest.approx(drift[:2], abs=1e-18)
    names = [c.name for c in stage.channels]
    for a, source in ((0, 0), (1, 1), (names.index("x.across"), 1), (names.index("y.across"), 0)):
        # a sensor across one axis reads the motion along the other, its drift once
        assert block.reading[a] == pytest.approx(drift[source] + noise[a], abs=0.51e-10)
    for name in ("x.vertical", "y.yaw"):
        a = names.index(name)
        assert block.reading[a] == pytest.approx(drift[a] + noise[a], abs=0.51e-9)


def test_noise_never_comes_again() -> None:
    noise = Disturbances(KINDS, BENCH, 10e3, 5).take(0, 3 * 4096)[1][0]
    rough = np.diff(noise, 2)
    for shift in (4096, 8192):
        likeness = np.corrcoef(rough[:-shift], rough[shift:])[0, 1]
        assert abs(likeness) < 6.0 / np.sqrt(4096)


def test_bad_sensors_are_refused() -> None:
    with pytest.raises(ModelError, match="noise_rms"):
        SimulatedSensor(noise_rms=-1e-9)
    with pytest.raises(ModelError, match="resolution_step"):
        SimulatedSensor(noise_rms=0.0, resolution_step=float("inf"))
