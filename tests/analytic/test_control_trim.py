"""The delay of a drive from the phase of a run, against drives whose delay is known."""

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.control import compensate, sine, trimmed_model
from flexstage.control.trajectory import delayed
from flexstage.hysteresis import DriveModel, Lag, PrandtlIshlinskii, StageModes, ValidityRange

RATE = 10e3
WANTED = sine("x", 9e-6, 43e-6, 50.0, sample_rate_hz=RATE)


def drive(delay: float) -> DriveModel:
    return DriveModel(
        hysteresis=PrandtlIshlinskii(
            gain=3.1e-7, thresholds=np.array([3.0, 11.0, 29.0]),
            weights=np.array([9e-8, 7e-8, 5e-8]),
        ),
        modes=StageModes(frequency_hz=[823.0], damping_ratio=[0.013]),
        lag=Lag(time_constant=8e-5, delay=delay),
        validity=ValidityRange(
            input_range=(0.0, 120.0), output_range=(0.0, 6e-5), rate_range_hz=(1.0, 50.0)
        ),
    )  # fmt: skip


@pytest.mark.parametrize("lacks", [7e-6, -11e-6])
def test_what_the_delay_of_a_model_lacks_is_seen_in_a_run_by_its_inverse(lacks) -> None:
    true, taken = drive(2.4e-4), drive(2.4e-4 - lacks)
    u = np.tile(compensate({"x": taken}, WANTED).voltage.values["x"], 20)
    reading = true.simulate(u, 1.0 / RATE, true.conditioned())
    rng = np.random.default_rng(5)
    reading = reading + 5e-9 * rng.standard_normal(reading.size)
    made = trimmed_model(taken, WANTED, "x", reading, skip=8)
    assert made.lag is not None
    # 5 nm in the mean of 12 periods of 200 samples: an angle of 5 sqrt(2/2400)/17e3 = 9e-9, or
    # 0.03 us; the step of the simulation bends lines between samples by less
    assert made.lag.delay == pytest.approx(2.4e-4, abs=1.5e-7)
    assert made.lag.time_constant == 8e-5
    assert made.hysteresis is taken.hysteresis
    assert made.modes == taken.modes


@pytest.mark.parametrize("begins", [0.0, 7.3e-4, -3.1e-3])
def test_the_delay_is_the_same_wherever_in_its_cycle_a_trajectory_begins(begins) -> None:
    """The angle is that between reading and trajectory, not that of the reading alone."""
    wanted = delayed(WANTED, begins)
    t = np.arange(600) / RATE - begins
    late = 26e-6 - 17e-6 * np.cos(2.0 * np.pi * 50.0 * (t - 1.9e-5))
    made = trimmed_model(drive(2e-4), wanted, "x", late)
    assert made.lag is not None
    assert made.lag.delay == pytest.approx(2.19e-4, rel=1e-9)


def test_a_drive_without_a_lag_gets_one() -> None:
    """A reading that is a quarter of a sample late."""
    from dataclasses import replace

    t = np.arange(1000) / RATE - 2.5e-5
    late = 26e-6 - 17e-6 * np.cos(2.0 * np.pi * 50.0 * t)
    made = trimmed_model(replace(drive(0.0), lag=None), WANTED, "x", late)
    assert made.lag is not None
    assert made.lag.delay == pytest.approx(2.5e-5, rel=1e-9)
    assert made.lag.time_constant == 0.0


def test_the_mains_are_an_angle_of_their_amplitude_over_that_of_the_motion() -> None:
    t = np.arange(1000) / RATE
    mains = 1e-8 * np.sin(2.0 * np.pi * 50.0 * t)
    reading = np.tile(WANTED.positions["x"], 5) + mains
    made = trimmed_model(drive(2e-4), WANTED, "x", reading)
    assert made.lag is not None
    # 10 nm of 17 um, across the motion: at 50 Hz 1.9 us
    assert abs(made.lag.delay - 2e-4) == pytest.approx(1e-8 / 17e-6 / (100.0 * np.pi), rel=1e-6)


def test_what_cannot_be_a_run_of_the_trajectory_is_refused() -> None:
    still = np.full(600, 3e-6)
    with pytest.raises(RecordError, match=r"moves \S+ times as far"):
        trimmed_model(drive(2e-4), WANTED, "x", still)
    with pytest.raises(RecordError, match="no complete period"):
        trimmed_model(drive(2e-4), WANTED, "x", WANTED.positions["x"], skip=1)
    with pytest.raises(ModelError, match="ahead of the trajectory"):
        trimmed_model(drive(2e-4), WANTED, "x", np.tile(np.roll(WANTED.positions["x"], -5), 3))
