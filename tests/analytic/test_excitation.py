"""The drive record for identification: limits, contents, and what it is worth."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import lfilter

from flexstage.base.errors import ModelError
from flexstage.files.request import request_fields
from flexstage.hysteresis.excitations.design import Excitation, excitation
from flexstage.hysteresis.excitations.excitation import memory_coverage, multisine
from flexstage.hysteresis.excitations.segments import (
    ExcitationDesign,
    Movement,
    design_within_limits,
    shortest,
)
from flexstage.hysteresis.identification.cycles import cycles
from flexstage.hysteresis.models.play_sum import play_columns
from flexstage.hysteresis.models.preisach.law import preisach_columns
from flexstage.hysteresis.requests import AmplifierLimits, ExciteRequest
from flexstage.records import Record

SHAPES = request_fields(ExciteRequest)["shape"].words
RANGE = (-17.0, 113.0)


def made(**options) -> Excitation:
    usual = {"sample_rate": 2000.0, "rates": (0.45, 4.7), "slew": 1900.0}
    asked = usual | options
    amplifier = {n: asked.pop(n) for n in ("slew", "current", "capacitance") if n in asked}
    return excitation(RANGE, amplifier=amplifier, **asked)


# ---------------------------------------------------------------------------------- movements


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("turn_time", [0.0, 0.013, 0.4])
def test_a_movement_has_the_largest_slope_that_its_shape_says(shape, turn_time):
    movement = Movement(
        shape=shape, span=97.0, sample_rate_hz=1e5, slope_limit=730.0, turn_time=turn_time
    )
    for distance in (2.3, 31.0, 97.0):
        time = movement.shortest(distance)
        n = math.ceil(time * 1e5)
        values = movement.samples(11.0, 11.0 - distance, n)
        steps = -np.diff(np.concatenate(([11.0], values))) * 1e5
        assert steps.min() > 0.0
        # the limit is met from below, and used
        assert 0.996 * 730.0 < steps.max() <= 730.0 * (1.0 + 1e-9)
        assert values[-1] == 11.0 - distance


def test_a_smooth_movement_has_no_jump_of_its_speed():
    movement = Movement(shape="smooth", span=60.0, sample_rate_hz=1e4, turn_time=0.02)
    speed = np.diff(np.concatenate(([0.0], movement.samples(0.0, 60.0, 2000)))) * 1e4
    speed = np.concatenate(([0.0], speed, [0.0]))
    # the speed of 333 V/s is reached in 200 samples as half a cosine: pi/2 of the mean step at most
    assert np.abs(np.diff(speed)).max() < 1.02 * 0.5 * math.pi * speed.max() / 200
    assert np.argmax(speed > 0.999 * speed.max()) == pytest.approx(200, abs=6)
    np.testing.assert_allclose(speed, speed[::-1], rtol=1e-9, atol=1e-6)


def test_small_loops_are_run_at_the_speed_of_the_large_ones_and_not_too_often():
    movement = Movement(shape="triangle", span=80.0, sample_rate_hz=1e4, highest_frequency_hz=9.0)
    assert movement.count(80.0, 2.0) == 2500
    assert movement.count(40.0, 2.0) == 1250
    # a loop of 1 V would repeat 160 times a second
    assert movement.count(1.0, 2.0) == math.ceil(1e4 / 18.0)
    assert movement.count(1.0, 0.5) == 2000


def test_a_multisine_stays_in_its_band_and_fades():
    x = multisine((70.0, 190.0), 2.0, 3000.0, 5)
    power = np.abs(np.fft.rfft(x)) ** 2
    f = np.fft.rfftfreq(x.size, 1.0 / 3000.0)
    inside = (f > 65.0) & (f < 195.0)
    assert power[~inside].sum() < 1e-5 * power.sum()
    assert x[-1] == 0.0
    assert abs(x[0]) < 1e-3
    assert np.abs(x).max() == 1.0
    # a crest factor of at most 3.6 with its fading
    assert np.sqrt(np.mean(x**2)) > 0.28
    assert not np.array_equal(x, multisine((70.0, 190.0), 2.0, 3000.0, 6))


# ------------------------------------------------------------------------------------- limits


@settings(max_examples=40, deadline=None)
@given(
    low=st.floats(-80.0, 40.0),
    span=st.floats(0.5, 900.0),
    fast=st.floats(0.8, 9.0),
    ratio=st.floats(1.0, 30.0),
    room=st.floats(1.0, 3.0),
    shape=st.sampled_from(SHAPES),
    duration=st.one_of(st.none(), st.floats(1.0, 80.0)),
    natural=st.one_of(st.none(), st.floats(95.0, 400.0)),
    rest=st.floats(0.0, 1.0),
)
def test_every_limit_holds_at_every_sample(
    low, span, fast, ratio, room, shape, duration, natural, rest
):
    """Range, slope, current, time and rest voltage, to the last bit."""
    rate, capacitance = 1500.0, 5.3e-6
    # a smooth movement may rise and fall for all of its time: twice the speed of a triangle
    limit = room * 4.0 * span * fast
    try:
        e = excitation(
            (low, low + span),
            sample_rate=rate,
            duration=duration,
            rates=(fast / ratio, fast),
            shape=shape,
            amplifier=AmplifierLimits(
                slew=limit, current=0.9 * capacitance * limit, capacitance=capacitance
            ),
            frequency=natural,
            rest=low + rest * span,
            hold_time=1.3,
        )
    except ModelError as error:
        if duration is None or "need at least" not in str(error):
            raise
        return
    u = e.voltage
    assert low <= u.min() < u.max() <= low + span
    assert u.min() == pytest.approx(low, abs=1e-6 * span)
    assert u.max() == pytest.approx(low + span, abs=1e-6 * span)
    assert u[0] == u[-1] == low + rest * span
    slope = np.abs(np.diff(u)).max() * rate
    assert slope <= limit
    assert e.largest_slope == slope
    assert e.largest_current is not None
    assert e.largest_current <= 0.9 * capacitance * limit
    np.testing.assert_array_equal(e.time, np.arange(u.size) / rate)
    assert duration is None or e.duration <= duration * (1.0 + 1e-12)
    # parts follow each other without a gap
    assert e.parts[0].first == 1
    assert all(a.last == b.first for a, b in itertools.pairwise(e.parts))
    assert e.parts[-1].last == u.size
    for p in e.parts:
        assert p.largest_slope <= e.largest_slope
        assert p.duration == pytest.approx((p.last - p.first) / rate)


@pytest.mark.parametrize("seed", range(4))
def test_a_limit_that_is_met_is_not_exceeded_by_rounding(seed):
    # the multisine is scaled to the limit of the slope
    options = {"rates": (0.2,), "slew": 61.3, "frequency": 83.0, "hold_time": 0.0}
    slope = made(**options, seed=seed).largest_slope
    assert 61.29 < slope <= 61.3


def test_the_rest_voltage_is_met_beside_an_end_of_the_range():
    low, rest = 1.57e-7, 2.0000001569999997
    e = excitation((low, low + 2.0), sample_rate=500.0, rates=(1.0,), rest=rest)
    assert e.voltage[0] == e.voltage[-1] == rest
    assert e.voltage.min() >= low


def test_the_current_is_the_capacitance_times_the_slope():
    e = made(capacitance=7.1e-6)
    i = 7.1e-6 * np.diff(e.voltage) * 2000.0
    assert e.largest_current == pytest.approx(np.abs(i).max(), rel=1e-12)
    assert e.rms_current == pytest.approx(np.sqrt(np.mean(i**2)), rel=1e-12)
    assert made().largest_current is None
    assert made().rms_current is None


def test_a_limit_of_the_current_bounds_the_rates():
    e = excitation(
        RANGE, sample_rate=2000.0, amplifier="current=3 mA,capacitance=7 uF", shape="triangle"
    )
    assert e.rates_hz[1] == pytest.approx(3e-3 / 7e-6 / 260.0, rel=1e-4)
    assert e.largest_current is not None
    assert 2.97e-3 < e.largest_current <= 3e-3


def test_not_a_sample_is_run_beyond_the_duration():
    longest = made(duration=21.0, hold_time=2.0).duration
    assert made(duration=longest, hold_time=2.0).duration == longest
    assert made(duration=longest - 0.4 / 2000.0, hold_time=2.0).duration < longest


def test_smooth_loops_rise_and_fall_over_two_periods_of_the_stage():
    e = made(frequency=83.0)
    part = next(p for p in e.parts if p.name == "major loops" and p.rate_hz == 4.7)
    steady = 260.0 * 4.7 / (1.0 - 2.0 / 83.0 * 2.0 * 4.7)
    assert part.largest_slope == pytest.approx(steady, rel=5e-3)


def test_the_rate_is_that_of_the_major_loops():
    e = made(shape="sine", slew=2500.0)
    for rate in (0.45, 4.7):
        part = next(p for p in e.parts if p.name == "major loops" and p.rate_hz == rate)
        assert part.duration == pytest.approx(2.0 / rate, rel=2e-3)
        assert part.largest_slope == pytest.approx(math.pi * 130.0 * rate, rel=4e-3)


def test_loops_stay_below_a_tenth_of_the_natural_frequency():
    e = made(frequency=83.0)
    turning = np.flatnonzero(np.diff(np.sign(np.diff(e.voltage))) != 0)
    quasi_static = e.parts[-3].last
    assert e.parts[-2].name == "multisine at the resonance"
    shortest_loop = np.diff(turning[turning < quasi_static]).min() / 2000.0
    assert shortest_loop >= 0.5 / 8.3 - 1.0 / 2000.0
    assert np.diff(turning[turning > quasi_static]).min() / 2000.0 < 0.5 / 83.0


def test_the_multisine_is_small_and_around_the_natural_frequency():
    e = made(frequency=83.0)
    part = e.parts[-2]
    x = e.voltage[part.first : part.last][-int(4.0 * 2000.0) :]
    assert 0.5 * 0.018 * 130.0 < np.ptp(x) <= 0.018 * 130.0 + 1e-9
    power = np.abs(np.fft.rfft(x - x.mean())) ** 2
    f = np.fft.rfftfreq(x.size, 1.0 / 2000.0)
    assert power[(f > 30.0) & (f < 135.0)].sum() > 0.999 * power.sum()
    assert not any("multisine" in p.name for p in made().parts)
    plain = made(frequency=83.0, multisine=False)
    assert not any("multisine" in p.name for p in plain.parts)
    # a low limit of the slope makes it smaller, and leaves it out in the end
    slow = made(frequency=83.0, rates=(0.02, 0.2), slew=64.0, hold_time=0.0)
    tiny = slow.voltage[slow.parts[-2].first : slow.parts[-2].last][-4000:]
    assert np.ptp(tiny) < 0.3
    none = excitation(
        RANGE,
        sample_rate=700.0,
        rates=(0.01,),
        amplifier="slew=3 V/s",
        frequency=83.0,
        hold_time=0.0,
    )
    assert "which is too small" in " ".join(none.warnings)
    coarse = made(frequency=300.0)
    assert "needs a sample rate of at least 2400 Hz" in " ".join(coarse.warnings)


# ------------------------------------------------------------------------------------ content


def test_what_was_before_is_wiped_out_by_the_conditioning():
    e = made()
    r = np.array([0.0, 3.1, 11.0, 24.5, 47.0, 61.0])
    rng = np.random.default_rng(8)
    outputs = []
    for _ in range(3):
        before = rng.uniform(*RANGE, 40)
        outputs.append(play_columns(np.concatenate((before, e.voltage)), r)[40:])
    end = e.parts[0].last
    assert np.ptp([o[0, 3] for o in outputs]) > 0.1
    for other in outputs[1:]:
        np.testing.assert_array_equal(other[end:], outputs[0][end:])


def test_the_identification_finds_two_rates_and_minor_loops_in_it():
    for options in ({}, {"duration": 9.0}, {"frequency": 150.0}):
        e = made(**options)
        found = cycles(e.voltage, 1.0 / e.sample_rate_hz)
        assert found.has_minor_loops
        for rate in e.rates_hz:
            assert min(abs(f / rate - 1.0) for f in found.rates_hz) < 0.02
    plain = cycles(50.0 - 50.0 * np.cos(np.arange(8000) * 0.007), 1e-3)
    assert not plain.has_minor_loops


def test_the_same_loops_are_run_at_every_rate():
    e = made(rates=(0.4, 1.3, 3.9))
    loops = {
        rate: {
            round(float(v), 6)
            for p in e.parts
            if p.rate_hz == rate and p.name.startswith(("nested", "ascending", "descending"))
            for v in e.voltage[p.first : p.last][_turns(e.voltage[p.first : p.last])]
        }
        for rate in (0.4, 1.3, 3.9)
    }
    assert len(loops[0.4]) > 30
    assert loops[0.4] == loops[1.3]
    # those of the fastest rate are among more
    assert len(loops[3.9] & loops[0.4]) > 0.8 * len(loops[0.4])
    assert len(loops[3.9]) > 1.6 * len(loops[0.4])


def _turns(u):
    return np.flatnonzero(np.diff(np.sign(np.diff(u))) != 0) + 1


def test_the_hold_waits_at_two_levels():
    e = made(hold_time=6.6)
    part = next(p for p in e.parts if p.name == "step and hold")
    u = e.voltage[part.first : part.last]
    assert np.count_nonzero(u == u.max()) == pytest.approx(4.4 * 2000, abs=2)
    assert np.count_nonzero(u == u[-1]) == pytest.approx(2.2 * 2000, abs=2)
    assert u[-1] < u.max() - 0.5 * 130.0
    assert not any(p.name == "step and hold" for p in made(hold_time=0.0).parts)


def test_what_does_not_fit_is_left_out_in_its_order():
    left = []
    raised = []
    for duration in (80.0, 40.0, 25.0, 18.0, 12.0, 9.0, 6.0):
        e = made(duration=duration, frequency=150.0)
        # most of the time is used
        assert 0.62 * duration < e.duration <= duration
        left.append(e.omitted)
        raised.append(
            any("rates were raised from 0.45, 4.7 Hz to 0.588, 4.7 Hz" in w for w in e.warnings)
        )
        names = {(p.name, p.rate_hz) for p in e.parts}
        assert ("nested loops about the middle", 4.7) in names
        assert {r for n, r in names if n == "major loops"} == set(e.rates_hz)
    assert left[0] == left[1] == ()
    assert [len(x) for x in left] == sorted(len(x) for x in left)
    assert len(left[-1]) > len(left[3]) > 0
    # what is left out of a longer record is left out of a shorter one
    assert all(b[: len(a)] == a for a, b in itertools.pairwise(left))
    assert left[-1][0] == "ascending reversal curves at the slower rates"
    assert raised == sorted(raised)
    assert raised[-1]
    assert not raised[0]


def test_rates_that_nobody_asked_for_are_raised_as_the_limits_allow():
    slow = excitation(RANGE, sample_rate=2000.0, amplifier="slew=4300 V/s", shape="triangle")
    assert slow.rates_hz == (0.5, 5.0)
    e = excitation(
        RANGE, sample_rate=2000.0, amplifier="slew=4300 V/s", shape="triangle", duration=17.0
    )
    assert 5.0 < e.rates_hz[1] < 4300.0 / 260.0
    assert e.rates_hz[1] == pytest.approx(10.0 * e.rates_hz[0])
    low = excitation(RANGE, sample_rate=2000.0, amplifier="slew=430 V/s", shape="triangle")
    assert low.rates_hz[1] == pytest.approx(430.0 / 260.0, rel=1e-4)


def test_the_least_time_is_the_least_time():
    movement = Movement(shape="smooth", span=130.0, sample_rate_hz=1000.0)
    design = ExcitationDesign(
        voltage_range=RANGE, rest_voltage=0.0, rates_hz=(0.5, 5.0), hold=4.0, multisine=0.0
    )
    least = shortest(design, movement, 0.0)
    found = design_within_limits(design, movement, least, 0.0)
    assert found is not None
    assert found.samples(movement) == least
    assert design_within_limits(design, movement, least - 1, 0.0) is None
    with pytest.raises(ModelError, match=r"need at least 3\.9\d s .* got a duration of 3\.7 s"):
        made(duration=3.7)


def test_one_rate_and_near_rates_are_warned_of():
    assert "one rate only" in made(rates=(2.0,)).warnings[0]
    assert "only a factor of 4 apart" in made(rates=(1.1, 4.4)).warnings[0]
    assert made().warnings == ()
    assert "no limit" in made(slew=None).warnings[0]


def test_equal_seeds_give_equal_records():
    a, b, c = (made(frequency=90.0, seed=s).voltage for s in (4, 4, 5))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_as_a_record():
    e = made(duration=14.0)
    record = e.record()
    assert isinstance(record, Record)
    assert record.channel("voltage").unit == "V"
    assert record.uniform
    assert record.sample_rate_hz == pytest.approx(2000.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rates": (0.5, 9.0)}, r"smooth loops over 130 V at 9 Hz .* slope or current .* 6\.57"),
        ({"rates": (0.5, 8.0), "shape": "sine"}, r"allows at most 4\.65"),
        ({"rates": (0.5, 8.0), "slew": None, "frequency": 61.0}, "6.1 Hz"),
        ({"rates": (0.5, 180.0), "slew": None}, "the sample rate allows"),
        ({"rates": (0.0, 1.0)}, "rates must be above 0"),
        ({"current": 0.01}, "needs the capacitance"),
        ({"capacitance": -1e-6}, "capacitance must be above 0"),
        ({"slew": 0.0}, "slew must be above 0"),
        ({"slew": 1e-3}, "too low to be resolved"),
        ({"sample_rate": math.nan}, "sample_rate must be a number"),
        ({"duration": math.inf}, "duration must be above 0"),
        ({"hold_time": -1.0}, "hold_time must be not below 0"),
        ({"shape": "square"}, "shape must be one of smooth, sine, triangle"),
        ({"rest": 120.0}, "rest voltage must be in -17 V to 113 V"),
        ({"rates": (1e-4, 1.0)}, "at most 20000000 are allowed"),
    ],
)
def test_impossible_requests_are_refused(options, said):
    with pytest.raises(ModelError, match=said) as refused:
        made(**options)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("given_range", [(5.0, 5.0), (9.0, -2.0), (0.0, math.inf)])
def test_an_impossible_range_is_refused(given_range):
    with pytest.raises(ModelError, match=r"(rising range|range must rise)"):
        excitation(given_range, sample_rate=1000.0)


# ----------------------------------------------------------------------------------- coverage


def _fronts_of_plays(u, k):
    """Cells in which a play begins to move, found from many plays on a fine input."""
    span = np.ptp(u)
    fine = np.concatenate(
        [np.linspace(a, b, 400, endpoint=False) for a, b in itertools.pairwise(u)] + [u[-1:]]
    )
    r = (np.arange(12 * k) + 0.5) / (12 * k) * 0.5 * span
    p = fine[0] + play_columns(fine - fine[0], r)  # all at the first input
    moving = np.diff(p, axis=0) != 0.0
    begins = moving[1:] & ~moving[:-1]
    seen = np.zeros((k, 2 * k), dtype=int)
    for j in range(r.size):
        at = p[1:-1][begins[:, j], j]
        row = int(r[j] / (0.5 * span) * k)
        column = ((at - u.min()) / span * 2 * k).astype(int)
        np.add.at(seen, (row, np.clip(column, row, 2 * k - 1 - row)), 1)
    return seen


def test_coverage_agrees_with_plays_that_begin_to_move():
    rng = np.random.default_rng(21)
    # saturated first: what was before is not known
    u = np.concatenate(([0.0, 93.0, 0.0], rng.uniform(2.0, 91.0, 9), [93.0, 0.0]))
    seen = memory_coverage(u, 6)
    plays = _fronts_of_plays(u, 6)
    # a cell of which only a corner is touched may be seen by one and not by the other
    assert np.all(seen[plays > 3])
    assert np.all(plays[seen] > 0) or np.mean(plays[seen] > 0) > 0.93
    assert 0.3 < seen.sum() / 42 < 0.95


def test_coverage_grows_with_what_is_run():
    major = [0.0, 10.0, 0.0, 10.0, 0.0]
    one = [*major, 6.3, 0.0]
    share = [memory_coverage(u, 9).sum() for u in (major, one, [*one, 3.1, 0.0], [*one, 6.3, 0.0])]
    assert share[0] == 18
    assert share[0] < share[1] < share[2]
    # the same once more shows nothing new
    assert share[3] == share[1]
    e = made(hold_time=0.0)
    assert e.coverage == memory_coverage(e.voltage).sum() / (16 * 17) > 0.97


def test_a_closed_minor_loop_leaves_no_front():
    seen = memory_coverage([0.0, 10.0, 0.0, 6.0, 3.0, 10.0, 0.0], 10)
    # down from 6 to 3 the play with a threshold of 0.75 begins to move at 5.25, up at 3.75
    assert seen[1, 10]
    assert seen[1, 7]
    # beyond 6 all small plays move already
    assert not seen[1, 13]
    # the front that began at 6 came to an end at 3
    assert not seen[4, 7]


def test_coverage_is_not_moved_by_scale_or_waiting():
    rng = np.random.default_rng(5)
    u = rng.uniform(-3.0, 8.0, 30)
    seen = memory_coverage(u)
    np.testing.assert_array_equal(memory_coverage(np.repeat(0.125 * u, 3)), seen)
    np.testing.assert_array_equal(memory_coverage(-u), seen[:, ::-1])


def test_coverage_refuses_what_does_not_move():
    with pytest.raises(ModelError, match="must move"):
        memory_coverage([3.0, 3.0])
    with pytest.raises(ModelError, match="at least one cell"):
        memory_coverage([3.0, 4.0], 0)


# -------------------------------------------------------------------------------------- worth

DT = 1.0 / 400.0
# a class of its own: saturating functions of plays and a quadratic part, so that its minor loops
# are not congruent
PLAYS = np.array([0.0, 1.7, 4.4, 9.1, 15.3, 23.9, 36.0, 52.0])
WEIGHTS = np.array([0.62, 0.05, 0.06, 0.08, 0.07, 0.08, 0.06, 0.05])


def _lagged(x, tau):
    """First-order lag along the first axis, exact for an input held over each step."""
    a = math.exp(-DT / tau)
    return lfilter([1.0 - a], [1.0, -a], x, axis=0, zi=a * x[:1])[0]


def _plant(u, seed):
    """Displacement of a stage that remembers, creeps, lags and is measured with noise."""
    rng = np.random.default_rng(seed)
    before = rng.uniform(*RANGE, 25)
    p = play_columns(np.concatenate((before, u)), PLAYS)[25:]
    h = 70.0 * np.tanh(p / 70.0) @ WEIGHTS
    h = h + 1.1e-3 * h**2
    crept = h + sum(0.011 * _lagged(h, tau) for tau in (0.04, 0.4, 4.0))
    return _lagged(crept, 0.0043) + rng.normal(0.0, 0.05, u.size)


def _columns(u, lag):
    """Preisach on plays and creep, both behind a lag, and an offset."""
    memory = preisach_columns(u, np.linspace(0.0, 60.0, 13), np.linspace(*RANGE, 12))
    creep = np.column_stack([_lagged(u, tau) for tau in (0.06, 0.6, 6.0)])
    one = np.ones((u.size, 1))
    return np.hstack((_lagged(np.hstack((memory, creep)), lag), one, -one))


def _identified(u, y, skip):
    """Lag and weights of least squares, the weights not negative and slightly damped."""

    def solved(lag):
        a = _columns(u, lag)[skip::2]
        scale = np.linalg.norm(a, axis=0) + 1e-9
        a = np.vstack((a / scale, 1e-3 * np.eye(a.shape[1])))
        found, left = nnls(a, np.concatenate((y[skip::2], np.zeros(a.shape[1]))))
        return left, found / scale

    best: Any = minimize_scalar(
        lambda lag: solved(lag)[0], bounds=(5e-4, 0.02), method="bounded", options={"xatol": 2e-4}
    )
    return best.x, solved(best.x)[1]


@pytest.mark.parametrize("other", ["one rate", pytest.param("two rates", marks=pytest.mark.slow)])
def test_it_identifies_better_than_sines_of_the_same_time(other):
    """Held-out error of a model of another class than the plant, fitted to either record."""
    rates = (0.4, 4.1)
    e = excitation(
        RANGE, sample_rate=400.0, rates=rates, duration=24.0, amplifier="slew=1500 V/s", seed=2
    )
    if other == "one rate":
        phase = 2.0 * np.pi * math.sqrt(rates[0] * rates[1]) * e.time
    else:
        phase = 2.0 * np.pi * DT * np.cumsum(np.where(e.time < 12.0, *rates))
    records = {"designed": e.voltage, "sine": 48.0 - 65.0 * np.cos(phase)}
    # another rate and other turning points
    movement = Movement(shape="smooth", span=130.0, sample_rate_hz=400.0)
    rng = np.random.default_rng(77)
    targets = [-17.0, 113.0, -17.0, *rng.uniform(-15.0, 111.0, 30)]
    held = np.concatenate(
        [
            movement.samples(a, b, movement.count(abs(b - a), 2.6))
            for a, b in itertools.pairwise(targets)
        ]
    )
    truth = _plant(held, 50)
    errors = {}
    for name, u in records.items():
        lag, found = _identified(u, _plant(u, 60), skip=700)
        left = (_columns(held, lag) @ found - truth)[300:]
        errors[name] = left.std() / np.ptp(truth)
    # the noise is 0.05 % of the stroke
    assert errors["designed"] < 0.0015
    assert errors["sine"] > 5.0 * errors["designed"]
