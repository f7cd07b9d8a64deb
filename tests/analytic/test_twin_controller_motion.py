"""The simulated controller's motion against closed forms, on a stage whose samples are exact."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from flexstage.base.errors import ModelError
from flexstage.instruments.pi.simulated.axis_state import Ramp
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.protocol import Capability, Signal
from flexstage.system.servo import Notch, ServoSettings
from tests.simple_stage import ACROSS, GAIN, PIEZO, RANGE, SCREW, STEP, SimpleStage

T = 1e-4  # a sample of the loop [s]


@pytest.fixture
def stage() -> SimpleStage:
    return SimpleStage()


@pytest.fixture
def device(stage: SimpleStage) -> VirtualController:
    return VirtualController(stage, zero_at_start=False)


@pytest.fixture
def screws() -> VirtualController:
    return VirtualController(SimpleStage("screw"))


def refusal(call: object, *args: object) -> RefusedError:
    with pytest.raises(RefusedError) as caught:
        call(*args)  # type: ignore[operator]
    return caught.value


# ramps ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "end", "step"),
    [(0.3, 7.1, 0.9), (5.2, -3.3, 0.85), (1.0, 1.0, 0.4), (2.0, 2.4, 3.0), (0.0, 0.3, 0.1)],
)
def test_a_ramp_steps_evenly_and_ends_exactly(start: float, end: float, step: float) -> None:
    ramp = Ramp(first=40, start=start, end=end, step=step)
    values = np.concatenate(([start], ramp.values(40, 60)))
    steps = np.abs(np.diff(values))
    # sums of a handful of numbers below 10: some 1e-15 of rounding
    assert np.all(steps <= step + 1e-14)
    assert values[-1] == end
    first_at_end = 40 + int(np.flatnonzero(values[1:] == end)[0])
    assert ramp.last == first_at_end
    assert first_at_end - 39 == max(1, math.ceil(abs(end - start) / step - 1e-9))
    assert_array_equal(
        ramp.values(30, 10), np.full(10, start) if start != end else np.full(10, end)
    )


def test_a_held_value_has_no_way_to_go() -> None:
    ramp = Ramp.hold(-2.5)
    assert ramp.last == 0
    assert_array_equal(ramp.values(3, 2), [-2.5, -2.5])


# as delivered -----------------------------------------------------------------------------------


def test_switched_on_it_stands_in_open_loop_and_has_a_reading(device: VirtualController) -> None:
    assert device.now == 0.0
    assert [device.servo_on(a) for a in device.axes] == [False, False]
    assert device.position("2") == device.voltage("2") == device.command("2") == 0.0
    assert device.on_target("1")
    assert not device.moving("1")
    assert device.identity.simulated
    one = device.axes["2"]
    assert (one.stage_axis, one.kind, one.limits) == ("y", "piezo", PIEZO)
    assert Capability.FEEDFORWARD_TABLE in one.capabilities


def test_a_move_under_control_is_a_ramp_at_the_speed_of_the_axis(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("1", True)
    device.set_speed("1", 0.3e-3)
    device.advance(0.01)
    device.set_targets({"1": 17e-6})
    assert device.moving("1")
    assert device.target("1") == 17e-6
    device.advance(0.2)
    sent = stage.commands[0, 101:]  # the sample at time 0, then 100
    # it stood below its range at 0, and control has led it to the low end
    expected = np.minimum(0.4e-6 + np.arange(1, sent.size + 1) * 0.3e-3 * T, 17e-6)
    assert_allclose(sent, expected, rtol=1e-13)
    assert sent[-1] == 17e-6
    assert not device.moving("1")
    assert device.target("1") == 17e-6
    assert_allclose(
        device.position("1"), 17e-6, atol=1e-11
    )  # the integral's error decays as e^-300t
    assert_array_equal(stage.commands[1], 0.0)


def test_a_voltage_is_led_along_at_the_largest_slew(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_commands({"2": 50.0, "1": -2.0})
    device.advance(0.01)
    ramp = np.minimum(3.0 * np.arange(1, 101), 50.0)
    assert_allclose(stage.commands[1, 1:], ramp, rtol=1e-14)
    assert_array_equal(stage.commands[0, 1:], np.full(100, -2.0))  # a step below the slew
    assert device.command("2") == 50.0
    assert_allclose(device.voltage("2"), 50.0)
    assert_allclose(device.position("2"), 50.0 * GAIN[1], rtol=1e-9)
    assert_allclose(device.channel(3), -2.0 * GAIN[0] * ACROSS, rtol=1e-9)


def test_a_new_target_takes_over_where_the_old_ramp_is(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_commands({"1": 90.0})
    device.advance(10 * T)
    device.set_commands({"1": 12.0})
    device.advance(10 * T)
    assert_allclose(stage.commands[0, 1:], [*range(3, 31, 3), 27, 24, 21, 18, 15, *[12] * 5])


# time -------------------------------------------------------------------------------------------


def test_parts_of_samples_are_kept(device: VirtualController, stage: SimpleStage) -> None:
    for _ in range(1000):
        device.advance(0.37e-4)
    assert stage.samples == 371  # 370 whole ones after that of time 0
    assert_allclose(device.now, 0.037, rtol=1e-14)
    device.advance(0.0)
    assert stage.samples == 371
    device.advance(0.99e-4)
    assert stage.samples == 371  # never ahead of what was asked for
    device.advance(0.01e-4)
    assert stage.samples == 372


@pytest.mark.parametrize("seconds", [-1e-3, math.nan, math.inf])
def test_time_does_not_go_back(device: VirtualController, seconds: float) -> None:
    with pytest.raises(ModelError, match="time can advance by 0 s or more"):
        device.advance(seconds)


# control ----------------------------------------------------------------------------------------


def test_control_begins_where_the_stage_is_and_ends_with_its_voltage(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_commands({"1": 43.0})
    device.advance(0.05)
    here = device.position("1")
    device.set_servo("1", True)
    assert device.target("1") == here
    device.advance(0.02)
    # the reading had settled to 1e-9 of itself, and so stays
    assert_allclose(device.position("1"), here, rtol=1e-8)
    assert_allclose(device.voltage("1"), 43.0, rtol=1e-8)
    device.set_targets({"1": 25e-6})
    device.advance(0.3)
    volts = device.voltage("1")
    device.set_servo("1", False)
    assert device.command("1") == volts
    device.advance(0.01)
    assert_array_equal(stage.commands[0, -100:], np.full(100, volts))
    assert device.target("1") == 25e-6  # the last one


def test_switching_to_what_it_is_changes_nothing(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("1", True)
    device.set_targets({"1": 9e-6})
    device.advance(0.002)
    device.set_servo("1", True)
    device.advance(0.3)
    assert stage.commands[0, -1] == 9e-6


def test_on_target_only_after_it_has_settled(device: VirtualController) -> None:
    device.set_servo("1", True)
    device.set_speed("1", 2e-3)
    device.set_targets({"1": 30e-6})
    arrived, errors = [], []
    for _ in range(900):
        device.advance(T)
        arrived.append(device.on_target("1"))
        errors.append(abs(device.position("1") - 30e-6))
    first = arrived.index(True)
    assert all(arrived[first:])
    # The integral closes the loop at 600e6 * 0.47e-6 = 282 /s: 30 um has shrunk to 20 nm after
    # some 26 ms. The smoothing lags by 1 ms, 50 samples must pass, and the ramp takes 15 ms.
    assert errors[first - 60] < 25e-9
    assert errors[first - 75] > 20e-9
    device.set_targets({"1": 29e-6})
    assert not device.on_target("1")


def test_a_stage_that_stands_is_on_target_as_soon_as_it_has_settled(
    device: VirtualController,
) -> None:
    device.set_commands({"1": 80.0})
    device.advance(0.1)
    device.set_servo("1", True)
    device.advance(49 * T)
    assert not device.on_target("1")
    device.advance(T)
    assert device.on_target("1")


def test_settings_reach_the_stage_of_their_axis(
    device: VirtualController, stage: SimpleStage
) -> None:
    settings = ServoSettings(proportional=3e4, integral=5e8, notches=(Notch(frequency_hz=433.0),))
    device.set_servo_settings("2", settings)
    assert device.servo("2") == settings == stage.servo_settings("y")
    assert device.servo("1") == stage.servo_settings("x") != settings
    above = ServoSettings(integral=1.0, notches=(Notch(frequency_hz=5.1e3),))
    assert refusal(device.set_servo_settings, "2", above).reason is Refusal.BAD_VALUE
    assert device.servo("2") == settings


# stops ------------------------------------------------------------------------------------------


def test_a_stop_in_open_loop_holds_the_voltage(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_commands({"1": 90.0, "2": 60.0})
    device.advance(7 * T)
    device.stop(["1"])
    device.advance(100 * T)
    assert_allclose(stage.commands[0, 8:], np.full(100, 21.0))
    assert stage.commands[1, -1] == 60.0
    assert not device.moving("1")
    assert_allclose(device.command("1"), 21.0)


def test_a_stop_under_control_holds_what_is_read(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("1", True)
    device.set_targets({"1": 33e-6})
    device.advance(0.03)
    here = device.position("1")
    assert 5e-6 < here < 30e-6
    device.stop()
    assert device.target("1") == here
    assert not device.moving("1")
    device.advance(0.2)
    assert_array_equal(stage.commands[0, -2000:], np.full(2000, here))


def test_a_screw_stops_where_it_is(screws: VirtualController) -> None:
    screws.set_targets({"2": 1.9e-3})
    screws.advance(0.5)
    screws.stop()
    here = screws.position("2")
    screws.advance(0.5)
    assert screws.position("2") == here
    assert_allclose(screws.target("2"), 0.55e-3, rtol=1e-12)  # 1.1 mm/s for half a second
    assert_allclose(here, 0.55e-3, atol=0.51 * STEP)


# screws -----------------------------------------------------------------------------------------


def test_a_screw_takes_positions_at_once_and_counts_its_steps(screws: VirtualController) -> None:
    assert screws.servo_on("1")
    assert screws.axes["1"].limits == SCREW
    screws.set_targets({"1": 0.73123e-3})
    screws.advance(0.66)
    assert screws.moving("1")
    screws.advance(0.01)
    assert screws.on_target("1")
    assert_allclose(screws.position("1"), 0.731e-3, rtol=1e-12)  # half micrometres
    assert_allclose(screws.channel(1), 0.037 * 0.731e-3, rtol=1e-12)
    screws.set_servo("1", True)


def test_what_a_screw_cannot_do(screws: VirtualController) -> None:
    for call, *args in (
        (screws.set_servo, "1", False),
        (screws.set_commands, {"1": 3.0}),
        (screws.command, "1"),
        (screws.voltage, "1"),
        (screws.servo, "1"),
        (screws.choose_wave, "1", 1, 2),
    ):
        assert refusal(call, *args).reason is Refusal.NOT_ABLE, call


# refusals ---------------------------------------------------------------------------------------


def test_refusals_have_their_reason_and_change_nothing(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("2", True)
    for reason, call, *args in (
        (Refusal.SERVO_OFF, device.set_targets, {"1": 5e-6}),
        (Refusal.SERVO_OFF, device.set_targets, {"2": 5e-6, "1": 5e-6}),
        (Refusal.SERVO_ON, device.set_commands, {"1": 5.0, "2": 5.0}),
        (Refusal.OUT_OF_LIMITS, device.set_targets, {"2": 41.001e-6}),
        (Refusal.OUT_OF_LIMITS, device.set_targets, {"2": 0.399e-6}),
        (Refusal.VOLTAGE_OUT_OF_LIMITS, device.set_commands, {"1": 113.1}),
        (Refusal.VOLTAGE_OUT_OF_LIMITS, device.set_commands, {"1": -7.1}),
        (Refusal.BAD_VALUE, device.set_commands, {"1": math.nan}),
        (Refusal.BAD_VALUE, device.set_targets, {"2": math.inf}),
        (Refusal.UNKNOWN, device.set_targets, {"3": 5e-6}),
        (Refusal.UNKNOWN, device.set_commands, {"x": 5.0}),
        (Refusal.UNKNOWN, device.position, "0"),
        (Refusal.UNKNOWN, device.channel, 4),
        (Refusal.UNKNOWN, device.channel, 0),
        (Refusal.SPEED_OUT_OF_LIMITS, device.set_speed, "2", 0.0),
        (Refusal.SPEED_OUT_OF_LIMITS, device.set_speed, "2", 11e-3),
        (Refusal.SPEED_OUT_OF_LIMITS, device.set_speed, "2", math.nan),
    ):
        error = refusal(call, *args)
        assert error.reason is reason, (call, args)
        assert str(error).count("\n") == 0
    device.advance(0.05)
    assert_array_equal(stage.commands[0], 0.0)
    assert device.target("2") == stage.commands[1, -1] == 0.4e-6  # the low end of its range


def test_a_value_rounded_past_the_end_is_the_end(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_commands({"1": RANGE[1] + 5e-5})
    device.advance(0.1)
    assert stage.commands[0, -1] == RANGE[1]


def test_the_largest_speed_follows_from_the_slew_where_none_is_named(
    device: VirtualController,
) -> None:
    largest = 3e4 * (41e-6 - 0.4e-6) / 120.0  # slew times the travel a volt
    device.set_speed("1", largest)
    assert_allclose(device.speed("1"), largest)
    device.set_speed("1", largest * (1.0 + 5e-7))  # rounded in a text
    assert device.speed("1") <= largest * (1.0 + 1e-12)
    assert refusal(device.set_speed, "1", 1.01 * largest).reason is Refusal.SPEED_OUT_OF_LIMITS


# zero -------------------------------------------------------------------------------------------


def test_switched_on_it_stands_within_its_range_and_counts_from_there() -> None:
    stage = SimpleStage()
    device = VirtualController(stage)
    low = RANGE[0] + 0.05 * (RANGE[1] - RANGE[0])
    for axis, gain in zip(device.axes, GAIN, strict=True):
        bounds = device.axes[axis].limits.position
        assert bounds is not None
        assert_allclose(bounds, np.array([0.4e-6, 41e-6]) - gain * low, rtol=1e-9)
        assert (device.position(axis), device.command(axis)) == (0.0, low)
        assert not device.moving(axis)
    # the whole range was gone through, and nothing jumped
    assert (stage.commands.min(), stage.commands.max()) == RANGE
    assert np.abs(np.diff(stage.commands)).max() <= 3e4 * T
    assert device.now == 0.0


def test_under_control_positions_count_from_zero() -> None:
    stage = SimpleStage()
    device = VirtualController(stage)
    zero = 0.4e-6 - (device.axes["1"].limits.position or (0.0,))[0]
    device.set_record_signal(1, Signal(kind="position", source="1", name="p"))
    device.set_record_signal(2, Signal(kind="channel", source="1", name="c"))
    device.set_record_signal(3, Signal(kind="target", source="1", name="t"))
    device.set_record_signal(4, Signal(kind="error", source="1", name="e"))
    device.arm_recorder("move")
    device.set_servo("1", True)
    device.set_targets({"1": 17e-6})
    device.advance(0.2)
    p, c, t, e = (device.recorder.read(table, 0, device.recorder.recorded) for table in range(1, 5))
    assert_array_equal(p, c)
    assert_array_equal(e, t - p)
    assert t[-1] == 17e-6
    assert_allclose(device.position("1"), 17e-6, atol=1e-11)
    assert_allclose(stage.position[0], 17e-6 + zero, atol=1e-11)
    # the end of the range is counted from there too
    device.set_targets({"1": 41e-6 - zero - 1e-9})
    beyond = {"1": 41e-6 - zero + 1e-9}
    assert refusal(device.set_targets, beyond).reason is Refusal.OUT_OF_LIMITS


@pytest.mark.parametrize("portion", [1, 7, 1000])
def test_a_zero_is_set_wherever_the_axis_was_and_in_whatever_portions_time_passes(
    portion: int,
) -> None:
    stage = SimpleStage()
    device = VirtualController(stage)
    device.set_servo("1", True)
    device.set_targets({"1": 30e-6})
    device.advance(0.1)
    before = stage.position[0] - device.position("1")
    device.set_record_signal(1, Signal(kind="position", source="1", name="p"))
    device.arm_recorder("now")
    device.set_zero({"1": 20.0})
    assert not device.servo_on("1")
    assert (device.zeroing("1"), device.wave_running("1")) == (True, False)
    assert refusal(device.set_zero, {"1": None}).reason is Refusal.WAVE_RUNNING
    assert refusal(device.set_zero, {"2": 113.1}).reason is Refusal.VOLTAGE_OUT_OF_LIMITS
    for _ in range(6000 // portion):
        device.advance(portion * T)
    assert not device.zeroing("1")
    # three ways of 0.1 s and a rest of 0.2 s, and from the next sample on it counts from there
    recorded = device.recorder.read(1, 0, device.recorder.recorded)
    assert_array_equal(np.abs(recorded) > 1e-12, np.arange(recorded.size) < 5000)
    assert_allclose(stage.position[0] - device.position("1"), 20.0 * GAIN[0], rtol=1e-12)
    assert not np.isclose(before, 20.0 * GAIN[0])
    assert device.position("2") == 0.0
    # one that is stopped on its way counts as before
    device.set_zero({"1": None})
    device.advance(0.05)
    device.stop()
    assert not device.zeroing("1")
    device.advance(1.0)
    assert_allclose(stage.position[0] - device.position("1"), 20.0 * GAIN[0], rtol=1e-12)


def test_control_that_begins_outside_the_range_leads_to_its_end() -> None:
    stage = SimpleStage()
    device = VirtualController(stage)
    device.set_commands({"1": RANGE[0]})
    device.advance(0.1)
    low = (device.axes["1"].limits.position or (0.0,))[0]
    assert device.position("1") < low
    device.set_servo("1", True)
    assert device.target("1") == low
    device.advance(0.1)
    assert_allclose(device.position("1"), low, atol=1e-11)


# switching off and on ---------------------------------------------------------------------------


def test_a_reboot_returns_to_what_was_delivered(
    device: VirtualController, stage: SimpleStage
) -> None:
    delivered = device.servo("1")
    device.set_servo("1", True)
    device.set_servo_settings("1", ServoSettings(integral=1e8))
    device.set_speed("1", 1e-4)
    device.set_targets({"1": 12e-6})
    device.set_wave(3, np.linspace(0.0, 1.0, 7))
    device.choose_wave("2", 3)
    device.set_wave_cycles("2", 5)
    device.set_wave_rate_divider(4)
    device.arm_recorder("move")
    device.advance(0.3)
    device.reboot()
    fresh = VirtualController(SimpleStage(), zero_at_start=False)
    assert device.servo("1") == delivered
    assert device.now == 0.0
    assert stage.samples == 1
    for ask in ("servo_on", "speed", "target", "command", "position", "wave_choice"):
        assert [getattr(device, ask)(a) for a in "12"] == [getattr(fresh, ask)(a) for a in "12"], (
            ask
        )
    assert device.tables.samples(3).size == 0
    assert device.wave_divider == 1
    assert device.recorder.recorded == 0


# arrival and portions of time -------------------------------------------------------------------


def switch_on_the_way(device: VirtualController) -> None:
    """Switch control on while the stage still follows its voltage."""
    device.set_commands({"1": 40.0})
    device.advance(14 * T)
    device.set_servo("1", True)


def end_a_waveform(device: VirtualController) -> None:
    """Run a waveform that ends so slowly that the stage is near it all the time."""
    device.set_servo("1", True)
    device.set_targets({"1": 10e-6})
    device.advance(0.2)
    device.set_wave(1, 10e-6 + 1e-12 * np.arange(30))
    device.choose_wave("1", 1)
    device.start_waves(["1"])


@pytest.mark.parametrize("begin", [switch_on_the_way, end_a_waveform])
def test_the_arrival_is_the_same_sample_in_whatever_portions(
    begin: Callable[[VirtualController], None],
) -> None:
    slow = VirtualController(SimpleStage(), zero_at_start=False)
    begin(slow)
    count = 0
    while not slow.on_target("1"):
        slow.advance(T)
        count += 1
        assert count < 2000
    assert count > 20
    for samples in (count - 1, count):
        fast = VirtualController(SimpleStage(), zero_at_start=False)
        begin(fast)
        fast.advance(samples * T)
        assert fast.on_target("1") == (samples == count)
