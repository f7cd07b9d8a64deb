"""Properties of trajectories, tuning and feedforward that hold for any numbers."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.control import compensate, jerk_limited, loop_margins, sine, triangle
from flexstage.control.design import tune_plant
from flexstage.control.loop_plant import LoopPlant
from flexstage.control.trajectory import delayed, there_and_back
from flexstage.hysteresis import DriveModel, PrandtlIshlinskii, StageModes, ValidityRange
from flexstage.hysteresis.limited_inverse import steady_input
from flexstage.system.servo import ServoSettings

unit = st.floats(0.0, 1.0)


@given(st.floats(-3.0, 3.0), st.floats(0.01, 1.0))
def test_there_and_back_is_even_and_odd_where_it_should_be(phase, turn) -> None:
    at = there_and_back(np.array([phase, -phase, phase + 1.0, phase + 0.5]), turn)
    assert np.all((at >= -1e-12) & (at <= 1.0 + 1e-12))
    np.testing.assert_allclose(at[:3], at[0], atol=1e-9)
    assert abs(at[0] + at[3] - 1.0) < 1e-9


@given(
    st.floats(1e-6, 5e-5), st.floats(1e-6, 5e-5), st.floats(0.3, 40.0), st.floats(0.03, 1.0),
    st.sampled_from([3.1e3, 10e3]),
)  # fmt: skip
def test_a_triangle_keeps_to_its_ends_and_its_stated_limits(low, span, rate, turn, fs) -> None:
    count = round(fs / rate)
    half = 0.5 * count / fs
    made = triangle("x", low, low + span, rate, sample_rate_hz=fs, turn_time=turn * half)
    x = made.positions["x"]
    assert x[0] == low
    assert x.max() <= low + span * (1.0 + 1e-12)
    speed = span / (half - 0.375 * turn * half)
    assert made.largest_speed("x") <= speed * (1.0 + 1e-9)
    acceleration = (np.roll(x, -1) - 2.0 * x + np.roll(x, 1)) * fs**2
    assert np.max(np.abs(acceleration)) <= 3.0 * speed / (turn * half) * (1.0 + 1e-6)


@given(st.floats(1e-7, 1e-4), st.floats(-5.0, 1.0), st.floats(-2.0, 4.0), st.floats(1.0, 8.0))
def test_a_jerk_limited_move_keeps_every_limit_and_ends_at_rest(distance, v, a, j) -> None:
    limits = {"speed": 10.0**v, "acceleration": 10.0**a, "jerk": 10.0**j}
    longest = distance / limits["speed"] + 4.0 * (distance / limits["jerk"]) ** (1.0 / 3.0)
    longest += 2.0 * (distance / limits["acceleration"]) ** 0.5
    longest += limits["speed"] / limits["acceleration"]
    rate = 4000.0 / longest
    x = jerk_limited(distance, sample_rate_hz=rate, **limits)
    assert (x[0], x[-1]) == (0.0, distance)
    noise = 1e-11 * distance
    for order, name in enumerate(("speed", "acceleration", "jerk"), start=1):
        steps = np.abs(np.diff(np.concatenate(([0.0] * 3, x, [distance] * 3)), order))
        assert steps.max() <= limits[name] / rate**order * (1.0 + 1e-6) + 2**order * noise
    # and it is one way
    assert np.diff(x).min() >= -noise


@given(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01))
def test_delays_add_up(first, second) -> None:
    made = sine("x", 1e-6, 4e-5, 7.0, sample_rate_hz=1.4e3)
    twice = delayed(delayed(made, first), second).positions["x"]
    np.testing.assert_allclose(twice, delayed(made, first + second).positions["x"], atol=1e-17)


@given(
    st.floats(1e-7, 1e-6), st.floats(0.3, 1.0), st.floats(1.0, 2.0), st.floats(0.0, 4.0),
    st.floats(150.0, 1900.0), st.floats(0.004, 0.1), st.sampled_from(["auto", "integral", "pi"]),
)  # fmt: skip
@settings(max_examples=10, deadline=None)
def test_every_tuning_is_stable_and_keeps_its_peak(gain, low, high, delay, f, zeta, kind) -> None:
    plant = LoopPlant(
        gain=gain, gain_range=(low * gain, high * gain), delay=delay / 10e3, sample_rate_hz=10e3,
        modes=StageModes(frequency_hz=[f], damping_ratio=[zeta]),
    )  # fmt: skip
    made = tune_plant(plant, kind=kind)
    assert made.worst.stable
    assert made.worst.sensitivity_peak <= made.requirements.sensitivity_peak * (1.0 + 1e-6)
    assert made.worst.gain_margin >= made.requirements.gain_margin * (1.0 - 1e-3)


@given(st.floats(0.05, 0.95), st.floats(1e-7, 1e-6), st.floats(0.0, 3.0))
def test_margins_scale_with_the_gain_alone(share, gain, delay) -> None:
    """A plant twice as sensitive under half the gain is the same loop."""
    values = []
    for factor in (1.0, 2.0):
        plant = LoopPlant(gain=factor * gain, gain_range=(factor * gain,) * 2,
                          delay=delay / 10e3, sample_rate_hz=10e3)  # fmt: skip
        servo = ServoSettings(integral=0.3 * share * 10e3 / (factor * gain))
        made = loop_margins(plant, servo)
        values.append([made.gain_margin, made.phase_margin, made.sensitivity_peak])
    np.testing.assert_allclose(values[0], values[1], rtol=1e-9)


@st.composite
def drives(draw):
    count = draw(st.integers(1, 5))
    r = np.sort(np.array([draw(st.floats(0.5, 45.0)) for _ in range(count)]))
    r += 0.01 * np.arange(count)
    w = np.array([draw(st.floats(1e-9, 1.5e-7)) for _ in range(count)])
    model = PrandtlIshlinskii(gain=draw(st.floats(1e-7, 6e-7)), thresholds=r, weights=w)
    top = model.simulate([120.0, 0.0, 120.0]).values
    return DriveModel(
        hysteresis=model,
        validity=ValidityRange(input_range=(0.0, 120.0), output_range=(top[1], top[2]),
                               rate_range_hz=(1.0, 5.0)),
    )  # fmt: skip


@given(drives(), st.floats(0.03, 0.4), st.floats(0.5, 0.97))
@settings(max_examples=20, deadline=None)
def test_what_is_within_reach_is_followed_exactly(drive, low, high) -> None:
    bottom, top = drive.validity.output_range
    span = top - bottom
    wanted = sine("x", bottom + low * span, bottom + high * span, 5.0, sample_rate_hz=1e3)
    made = compensate({"x": drive}, wanted, periods=2)
    assert made.limited == 0
    u = np.concatenate((made.lead_in.values["x"], made.voltage.values["x"]))
    y = drive.hysteresis.simulate(u).values[made.lead_in.size :]
    np.testing.assert_allclose(y, np.tile(wanted.positions["x"], 2), atol=1e-9 * span)
    steady = steady_input(drive, wanted.positions["x"])
    assert not steady.missed.any()
    np.testing.assert_allclose(steady.command, made.voltage.values["x"][200:], atol=1e-5)
