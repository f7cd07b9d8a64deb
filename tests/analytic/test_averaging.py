"""A long record is averaged: a delay stays, noise falls, what means cannot follow is left out."""

import numpy as np
import pytest

from flexstage.hysteresis.identification.fit_rows import averaged
from flexstage.hysteresis.identification.measurement import measurement, without_history
from flexstage.records import Channel, Record

DT = 1.0 / 7000.0
TIME = np.arange(63_000) * DT


def section(u, y):
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    record = Record(channels=channels, time=np.arange(u.size) * DT)
    return measurement([record], "u", "y").sections[0]


def means(whole, most):
    """What was measured of a section, averaged; and the time of its first sample."""
    short = without_history(averaged(whole, most))
    every = round(short.dt / whole.dt)
    assert short.u.size == without_history(whole).u.size // every
    return short, whole.begin


def sine(time, rate_hz=1.7):
    return 47.0 - 41.0 * np.cos(2.0 * np.pi * rate_hz * time)


def phase(values, dt, rate_hz=1.7):
    """Phase of a sine, by least squares."""
    angle = 2.0 * np.pi * rate_hz * np.arange(values.size) * dt
    basis = np.column_stack((np.cos(angle), np.sin(angle), np.ones(values.size)))
    a, b, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return float(np.arctan2(b, a))


def test_a_delay_that_is_no_whole_number_of_samples_stays() -> None:
    delay = 0.000813
    short, _ = means(section(sine(TIME), sine(TIME - delay)), 9000)
    assert short.dt == pytest.approx(7.0 * DT)
    lag = (phase(short.y, short.dt) - phase(short.u, short.dt)) % (2.0 * np.pi)
    assert lag / (2.0 * np.pi * 1.7) == pytest.approx(delay, abs=1e-12)


def test_white_noise_falls_with_the_square_root() -> None:
    noise = np.random.default_rng(6).normal(0.0, 0.05, TIME.size)
    short, _ = means(section(sine(TIME), sine(TIME) + noise), 7000)
    left = short.y - short.u
    assert np.std(left) == pytest.approx(0.05 / 3.0, rel=0.03)
    assert short.noise == pytest.approx(0.05 / 3.0, rel=0.05)
    assert short.straight is not None
    assert np.mean(short.straight) > 0.99


def test_jumps_and_tones_are_left_out_and_nothing_else() -> None:
    tone = np.where((TIME > 4.0) & (TIME < 4.1), 0.4 * np.sin(2.0 * np.pi * 900.0 * TIME), 0.0)
    jump = np.where(TIME > 6.0303, 5.0, 0.0)
    u = sine(TIME) + tone + jump
    short, begin = means(section(u, u), 9000)
    assert short.straight is not None
    middle = begin + (np.arange(short.u.size) + 0.5) * short.dt
    near = ((middle > 3.997) & (middle < 4.103)) | (np.abs(middle - 6.0303) < 0.004)
    assert short.straight[~near].all()
    assert not short.straight[(middle > 4.002) & (middle < 4.098)].any()
    assert not short.straight[np.argmin(np.abs(middle - 6.0303))]


def test_no_turning_point_is_blunted() -> None:
    # the means of a triangle stay behind its ends by a quarter of what it moves in a block
    period = 350 * DT
    swing = 80.0 * np.abs(2.0 * ((TIME / period) % 1.0) - 1.0)
    whole = section(swing, swing)
    assert averaged(whole, 9000) is whole
    slow = 80.0 * np.abs(2.0 * ((TIME / (60.0 * period)) % 1.0) - 1.0)
    short, _ = means(section(slow, slow), 9000)
    assert float(np.ptp(short.u)) == pytest.approx(80.0, abs=80.0 * 7e-4)


def test_a_short_record_stays_as_it_is() -> None:
    whole = section(sine(TIME), sine(TIME - 0.001))
    assert averaged(whole, TIME.size) is whole
