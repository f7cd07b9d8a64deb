"""What jumps show, against an oscillator that is integrated by other code."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.jump_response import jump_response, jumps
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.records import Channel, Record

RATE, DENSE = 10000.0, 8
STAIRS = np.repeat([3.0, 41.0, 12.5, 71.0, 34.0], 3000)


def play(u, radius):
    """A play over runs of equal or monotone input is a clip of what it held."""
    held, out = u[0], np.empty_like(u)
    for k, x in enumerate(u.tolist()):
        held = x - radius if held < x - radius else x + radius if held > x + radius else held
        out[k] = held
    return out


def filtered(numerator, denominator, x):
    made: Any = cont2discrete((numerator, denominator), 1.0 / (DENSE * RATE), method="foh")
    b, a, _ = made
    return lfilter(b[0], a, x - x[0]) + x[0]


def motion(u, *, mode=970.0, damping=0.02, share=1.0, delay=0.00023, noise=0.02, creep=0.02):
    fine = np.interp(np.arange(DENSE * u.size) / DENSE, np.arange(u.size), u)
    v = 0.31 * fine + 0.07 * play(fine, 3.1) + 0.09 * play(fine, 11.7)
    v = v + creep * sum(filtered([1.0], [tau, 1.0], v) for tau in (0.0316, 0.316, 3.16))
    omega = 2.0 * math.pi * mode
    if share:
        rung = filtered([omega**2], [1.0, 2.0 * damping * omega, omega**2], v)
        v = share * rung + (1.0 - share) * v
    t = np.arange(u.size) / RATE
    y = np.interp(t - delay, np.arange(fine.size) / (DENSE * RATE), v)
    return y + np.random.default_rng(5).normal(0.0, noise, u.size)


def record(u, y):
    channels = (Channel(name="u", values=u), Channel(name="y", values=y))
    return Record(channels=channels, time=np.arange(u.size) / RATE)


def section(u, y):
    slow = 40.0 - 37.0 * np.cos(2.0 * np.pi * np.arange(8000) / 4000.0)
    return measurement([record(np.append(slow, u), np.append(motion(slow), y))], "u", "y").sections[
        0
    ]


@pytest.mark.parametrize(
    "plant",
    [
        {"noise": 0.05},
        {"share": 0.13},
        {"mode": 287.0, "damping": 0.06, "delay": 0.0011},
        {"mode": 180.0, "damping": 0.2},
    ],
    ids=["whole", "small", "low", "damped"],
)
def test_ringing_gives_mode_and_delay(plant):
    found = jump_response(section(STAIRS, motion(STAIRS, **plant)))
    truth = {"mode": 970.0, "damping": 0.02, "share": 1.0, "delay": 0.00023, **plant}
    assert found is not None
    assert found.frequency_hz == pytest.approx(truth["mode"], rel=1e-3)
    assert found.damping_ratio == pytest.approx(truth["damping"], rel=0.03)
    assert found.share == pytest.approx(truth["share"], rel=0.05)
    assert abs(found.delay - truth["delay"]) < 2.0 * found.delay_error
    assert found.delay_error < 0.2 / RATE


def test_jumps_without_ringing_give_the_delay():
    found = jump_response(section(STAIRS, motion(STAIRS, share=0.0, delay=0.00167)))
    assert found is not None
    assert found.frequency_hz == 0.0
    assert found.unexplained_hz == 0.0
    assert abs(found.delay - 0.00167) < 2.0 * found.delay_error
    assert found.delay_error < 0.4 / RATE


def test_ringing_that_is_no_mode_is_said():
    growing = motion(STAIRS, share=0.0)
    for k in range(3000, STAIRS.size, 3000):
        t = np.arange(2600) / RATE
        growing[k : k + 2600] += 2.0 * np.sin(2.0 * np.pi * 611.0 * t) * (t / t[-1])
    slow = 40.0 - 37.0 * np.cos(2.0 * np.pi * np.arange(8000) / 4000.0)
    whole = record(np.append(slow, STAIRS), np.append(motion(slow, share=0.0), growing))
    found = identify(whole, "u", "y", model="dahl")
    assert any("rings at about 61" in w for w in found.warnings)
    assert found.model.modes is None


def test_one_jump_tells_a_record_of_one_rate_its_delay():
    slow = 40.0 - 40.0 * np.cos(2.0 * np.pi * np.arange(10000) / 5000.0)
    u = np.concatenate((np.zeros(200), np.full(4000, 30.0), np.linspace(30.0, 0.0, 1500), slow))
    # the drive has run over all of the range before
    y = motion(np.append(slow, u), share=0.3)[slow.size :]
    found = identify(record(u, y), "u", "y", model="preisach")
    chain = {e.name: e for e in found.chain}
    assert chain["resonance_hz"].value == pytest.approx(970.0, rel=2e-3)
    assert chain["delay"].value == pytest.approx(0.00023, abs=2.0 * chain["delay"].standard_error)
    assert chain["delay"].standard_error < 2e-5
    assert chain["creep_per_decade"].standard_error == math.inf
    assert any("the values of creep are not individually identifiable" in w for w in found.warnings)
    # the ringing is in the model
    assert found.model.modes is not None
    assert found.model.modes.share == pytest.approx((0.3,), rel=0.1)
    assert found.max_percent < 2.0


def test_what_counts_as_a_jump():
    quiet = np.zeros(40)
    assert jumps(np.concatenate((quiet, np.ones(40)))).tolist() == [[39, 40]]
    slewed = np.concatenate((quiet, np.linspace(0.0, 1.0, 6)[1:], np.ones(40)))
    assert jumps(slewed).tolist() == [[39, 44]]
    # a sine of few samples, a staircase of few, a triangle: none
    assert jumps(np.sin(np.arange(400) / 1.3)).size == 0
    assert jumps(np.repeat(np.sin(np.arange(60)), 5)).size == 0
    assert jumps(np.abs(np.arange(400) % 50 - 25.0)).size == 0


@pytest.mark.parametrize("late", [2, 4, 6])
@pytest.mark.parametrize("lag", [0.1, 0.3, 0.5])
def test_a_jump_that_an_amplifier_spreads_over_samples_is_not_later_by_a_part(lag, late):
    """The whole of it is one jump: half of it would be taken for motion without delay."""
    jump = lfilter([1.0 - lag], [1.0, -lag], np.tile(np.repeat([0.0, 60.0], 200), 12))
    u = 10.0 + jump
    y = 0.31 * np.concatenate((np.full(late, u[0]), u[:-late]))
    y += np.random.default_rng(1).normal(0.0, 0.005, u.size)
    channels = (Channel(name="u", values=u), Channel(name="y", values=y))
    steps = Record(channels=channels, time=np.arange(u.size) / 1000.0)
    response = jump_response(measurement([steps], "u", "y").sections[0])
    # none where the jump is too wide for its delay to be seen
    assert response is None or response.delay == pytest.approx(1e-3 * late, abs=5e-5)
    assert response is not None or late < 6 or lag == 0.5
