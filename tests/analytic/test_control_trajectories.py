"""Trajectories: whole periods without a jump, round corners whose size is known in closed form.

Evidence (Instruments, twin, control): triangles and steps (closed forms): speed $10^{-9}$ (steps
$10^{-4}$), acceleration $10^{-5}$, jerk 0.2 %, overshoot rounding, ends 0.1 %, linear part 4
samples
"""

import numpy as np
import pytest

from flexstage.base.errors import LimitError, ModelError, RecordError
from flexstage.control import sine, steps, trajectory_of, triangle
from flexstage.records import Channel, Record
from flexstage.stage.limits import AxisLimits

LOW, HIGH = 3.1e-6, 58.7e-6


def speeds(made, axis):
    """Central differences over the closed period [m/s]."""
    x = made.positions[axis]
    return (np.roll(x, -1) - np.roll(x, 1)) * (0.5 * made.sample_rate_hz)


def accelerations(made, axis):
    """Second differences over the closed period [m/s^2]."""
    x = made.positions[axis]
    return (np.roll(x, -1) - 2.0 * x + np.roll(x, 1)) * made.sample_rate_hz**2


def every_kind():
    return [
        triangle("x", LOW, HIGH, 1.7, sample_rate_hz=9.1e3, turn_time=0.03),
        sine("y", LOW, HIGH, 13.0, sample_rate_hz=7e3),
        steps("x", LOW, HIGH, 11.0, sample_rate_hz=8e3, move_time=0.011),
        steps("y", LOW, HIGH, 2.3, sample_rate_hz=4.1e3),
    ]


@pytest.mark.parametrize("made", every_kind(), ids=lambda t: t.kind)
def test_the_end_joins_the_start_without_a_jump_of_position_or_speed(made) -> None:
    for axis in made.axes:
        x = np.tile(made.positions[axis], 2)
        steps = np.abs(np.diff(x))
        # the step over the seam is one like all others
        assert steps[made.size - 1] <= steps[: made.size - 1].max() * (1.0 + 1e-9)
        bends = np.abs(np.diff(x, 2))
        assert bends[made.size - 2 : made.size].max() <= bends[: made.size - 2].max() * (1 + 1e-3)


@pytest.mark.parametrize("made", every_kind(), ids=lambda t: t.kind)
def test_accelerations_are_bounded_and_do_not_grow_with_the_rate_of_samples(made) -> None:
    for axis in made.axes:
        every, second = made.positions[axis], made.positions[axis][::2]
        if made.size % 2:
            continue
        fine = np.max(np.abs(np.roll(every, -1) - 2 * every + np.roll(every, 1)))
        coarse = np.max(np.abs(np.roll(second, -1) - 2 * second + np.roll(second, 1)))
        # a corner would make them equal; a motion with bounded acceleration makes them 4
        assert coarse > 3.0 * fine


def test_the_turns_of_a_triangle_have_the_closed_form_of_least_jerk() -> None:
    rate, turn, fs = 1.0, 0.062, 50e3
    made = triangle("x", LOW, HIGH, rate, sample_rate_hz=fs, turn_time=turn)
    speed = (HIGH - LOW) / (0.5 / rate - 0.375 * turn)
    assert made.largest_speed("x") == pytest.approx(speed, rel=1e-9)
    # second differences of a cubic's peak, h = T/3100: off by h^2/12 of its own second derivative
    assert np.max(np.abs(accelerations(made, "x"))) == pytest.approx(3.0 * speed / turn, rel=1e-5)
    jerk = np.diff(accelerations(made, "x")) * fs
    assert np.max(np.abs(jerk)) == pytest.approx(12.0 * speed / turn**2, rel=2e-3)
    assert made.overshoot == pytest.approx(5.0 / 16.0 * speed * turn, rel=1e-12)
    x = made.positions["x"]
    assert (x.min(), x.max()) == (pytest.approx(LOW, abs=1e-18), pytest.approx(HIGH, rel=1e-12))
    ends = x[made.linear]
    assert ends.min() - LOW == pytest.approx(made.overshoot, rel=1e-3)
    assert made.linear_share == pytest.approx(1.0 - 2.0 * turn * rate, abs=4.0 / made.size)


def test_the_turn_has_less_jerk_than_other_turns_between_the_same_speeds() -> None:
    s = np.linspace(0.0, 1.0, 4001)
    # speeds from -1 to 1 without acceleration at the ends: cubic, fifth degree, raised cosine
    jerk = {
        "cubic": np.gradient(np.gradient(-1.0 + 6 * s**2 - 4 * s**3, s), s),
        "fifth": np.gradient(np.gradient(-1.0 + 2 * (10 * s**3 - 15 * s**4 + 6 * s**5), s), s),
        "cosine": np.gradient(np.gradient(-np.cos(np.pi * s), s), s),
    }
    size = {name: float(np.mean(j[2:-2] ** 2)) for name, j in jerk.items()}
    assert size["cubic"] == min(size.values())
    made = triangle("x", 0.0, 1.0, 1.0, sample_rate_hz=16e3, turn_time=0.25)
    speed = speeds(made, "x") / made.largest_speed("x")
    turn = np.roll(speed, 2000)[:4001]
    np.testing.assert_allclose(turn, -1.0 + 6 * s**2 - 4 * s**3, atol=2e-6)


def test_the_linear_part_has_constant_speed() -> None:
    made = triangle("x", LOW, HIGH, 11.0, sample_rate_hz=8e3)
    inside = made.linear & np.roll(made.linear, 1) & np.roll(made.linear, -1)
    speed = np.abs(speeds(made, "x")[inside])
    assert np.ptp(speed) < 1e-9 * speed.max()


def test_steps_rest_at_their_ends_and_move_with_constant_jerk() -> None:
    rate, move, fs = 2.0, 0.05, 100e3
    made = steps("x", LOW, HIGH, rate, sample_rate_hz=fs, move_time=move)
    x, distance = made.positions["x"], HIGH - LOW
    assert made.linear_share == pytest.approx(1.0 - 2.0 * move * rate, abs=4.0 / made.size)
    rests = np.unique(np.round(x[made.linear] * 1e15))
    np.testing.assert_allclose(rests * 1e-15, [LOW, HIGH], rtol=1e-9)
    # four phases of T/4: 2 D/T, 8 D/T^2, 32 D/T^3
    assert made.largest_speed("x") == pytest.approx(2.0 * distance / move, rel=1e-4)
    bend = np.max(np.abs(accelerations(made, "x")))
    assert bend == pytest.approx(8.0 * distance / move**2, rel=1e-3)
    jerk = np.abs(np.diff(x[::20], 3)) * (fs / 20) ** 3
    assert jerk.max() == pytest.approx(32.0 * distance / move**3, rel=1e-3)
    # the way back is the way there
    np.testing.assert_allclose(LOW + HIGH - np.roll(x, made.size // 2), x, atol=1e-15)


def test_limits_are_refused_in_words() -> None:
    made = sine("x", LOW, HIGH, 10.0, sample_rate_hz=5e3)
    made.check({"x": AxisLimits(position=(0.0, 60e-6), speed=2e-3)})
    with pytest.raises(LimitError, match=r"from 3\.100 to 58\.700 um, and its limits are 5\.000"):
        made.check({"x": AxisLimits(position=(5e-6, 60e-6))})
    with pytest.raises(LimitError, match="lower its rate"):
        made.check({"x": AxisLimits(speed=1e-3)})
    with pytest.raises(ModelError, match=r"the trajectory has no axis 'X': its axes are x"):
        made.largest_speed("X")


def test_a_path_from_a_record_is_resampled_and_closed() -> None:
    t = np.arange(300) / 1e3
    x = 2e-5 + 1e-5 * np.sin(7.0 * t) + 4e-6 * np.sin(31.0 * t)
    record = Record(channels=(Channel(name="path", values=x, unit="m"),), time=t)
    with pytest.raises(ModelError, match="give a closing time"):
        trajectory_of(record, {"x": "path"})
    made = trajectory_of(record, {"x": "path"}, close=0.1, sample_rate_hz=4e3)
    assert made.period == pytest.approx(0.4)
    at = np.arange(0, 290) * 4
    np.testing.assert_allclose(made.positions["x"][at], x[:290], atol=1e-15)
    between = 2e-5 + 1e-5 * np.sin(7.0 * made.time) + 4e-6 * np.sin(31.0 * made.time)
    # a cubic spline is off by (31 h)^4 / 384 of 4 um, away from the closing
    np.testing.assert_allclose(made.positions["x"][40:1100], between[40:1100], atol=1e-13)
    assert made.linear.sum() == 1200
    volts = Record(channels=(Channel(name="path", values=x, unit="V"),), time=t)
    with pytest.raises(RecordError, match="is in V"):
        trajectory_of(volts, {"x": "path"}, close=0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: triangle("x", HIGH, LOW, 1.0, sample_rate_hz=1e3), "must rise"),
        (lambda: triangle("x", LOW, HIGH, 300.0, sample_rate_hz=1e3), "at least 8"),
        (lambda: triangle("x", LOW, HIGH, 1.0, sample_rate_hz=1e3, turn_time=0.7), "at most half"),
        (lambda: sine("x", LOW, HIGH, -1.0, sample_rate_hz=1e3), "must be positive"),
        (lambda: steps("x", LOW, HIGH, 1.0, sample_rate_hz=1e3, move_time=0.7), "a move must last"),
        (
            lambda: steps("x", LOW, HIGH, 50.0, sample_rate_hz=1e3),
            "four phases need at least 4",
        ),
    ],
)
def test_impossible_trajectories_are_refused_in_words(make, words) -> None:
    with pytest.raises(ModelError, match=words):
        make()
