"""A monitored input loses its noise and nothing else; a command stays as it is."""

import numpy as np
import pytest

from flexstage.hysteresis.identification.faults import denoised
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.measurement import measurement, without_history
from flexstage.records import Channel, Record

RATE = 200.0
TIME = np.arange(4000) / RATE


def play(u, radius):
    held, out = 0.0, np.empty_like(u)
    for k, x in enumerate(u):
        held = min(max(held, x - radius), x + radius)
        out[k] = held
    return out


def drive():
    """Loops of falling amplitude, quick at the end."""
    share = np.interp(TIME, [0.0, 4.0, 15.0, 15.5, 20.0], [1.0, 1.0, 0.15, 1.0, 0.3])
    phase = 2.0 * np.pi * np.cumsum(np.where(TIME < 15.0, 0.63, 3.7)) / RATE
    return 2.1 - 1.7 * share * np.cos(phase)


def motion(u, delay, seed):
    # straight lines between samples, computed four times as often
    fine = np.interp(np.arange(4 * u.size) / 4.0, np.arange(u.size), u)
    moved = 5.0 * fine + sum(w * play(fine, r) for r, w in ((0.17, 2.1), (0.46, 1.3), (0.9, 1.7)))
    y = np.interp(TIME - delay, np.arange(fine.size) / (4.0 * RATE), moved)
    return y + np.random.default_rng(seed).normal(0.0, 0.03, u.size)


def record(u, y):
    return Record(channels=(Channel(name="u", values=u), Channel(name="y", values=y)), time=TIME)


@pytest.mark.parametrize(
    "u",
    [
        drive(),
        np.abs(TIME % 1.3 - 0.65) * 5.1,
        np.repeat(1.8 - 1.7 * np.cos(np.arange(200) / 9.0), 20),
        np.round(drive(), 4),
        np.sin(2.0 * np.pi * TIME * RATE / 2.7) + drive(),
    ],
    ids=["smooth", "triangle", "staircase", "written with four digits", "quick"],
)
def test_a_command_is_not_touched(u):
    same, noise = denoised(u, motion(u, 0.007, 1))
    assert same is u
    assert noise == 0.0


def test_noise_is_taken_out_and_motion_stays():
    u = drive()
    y, highest, errors = motion(u, 0.007, 1), np.argsort(-u)[:80], []
    for seed in range(20):
        noisy = u + np.random.default_rng(seed).normal(0.0, 0.023, u.size)
        smooth, noise = denoised(noisy, y)
        assert noise == pytest.approx(0.023, rel=0.1)
        assert np.std(smooth - u) < 0.5 * noise
        errors.append(np.mean(smooth[highest] - u[highest]))
    # turning points are not rounded
    assert abs(np.mean(errors)) < 0.1 * 0.023


def test_jumps_stay():
    u = np.repeat([0.2, 1.9, 0.7, 3.1, 0.4], 800)
    noisy = u + np.random.default_rng(3).normal(0.0, 0.02, u.size)
    smooth, _ = denoised(noisy, motion(u, 0.0, 2))
    # a sample next to a jump may keep its own noise
    assert np.abs(smooth - u).max() < 0.15
    assert np.std(smooth - u) < 0.01


def test_what_the_output_follows_is_motion():
    u = drive() + np.random.default_rng(5).normal(0.0, 0.023, TIME.size)
    same, noise = denoised(u, motion(u, 0.012, 1))
    assert same is u
    assert noise == 0.0


@pytest.mark.slow
def test_noise_of_the_input_does_not_move_the_delay():
    """Half a sample averages two samples of noise: 7.5 ms or 12.5 ms would be preferred."""
    u = drive()
    y = motion(u, 0.0102, 1)
    noisy = u + np.random.default_rng(11).normal(0.0, 0.02, u.size)
    clean, found = (identify(record(v, y), "u", "y", model="dahl") for v in (u, noisy))
    values = [{e.name: e for e in f.chain}["delay"] for f in (clean, found)]
    assert values[0].value == pytest.approx(0.0102, abs=2.0 * values[0].standard_error)
    assert values[1].value == pytest.approx(0.0102, abs=2.0 * values[1].standard_error)
    assert values[1].standard_error < 1e-3
    assert abs(values[1].value - values[0].value) < 5e-4
    assert not any("noise" in w for w in clean.warnings)
    assert any("the input has noise of 0." in w for w in found.warnings)


def test_the_noise_of_a_section_is_that_of_its_input():
    u = drive()
    noisy = u + np.random.default_rng(2).normal(0.0, 0.031, u.size)
    section = measurement([record(noisy, motion(u, 0.0, 1))], "u", "y").sections[0]
    assert section.input_noise == pytest.approx(0.031, rel=0.1)
    # a short rest at the start is left out
    smooth = without_history(section).u
    assert np.std(smooth - u[-smooth.size :]) < 0.5 * section.input_noise
