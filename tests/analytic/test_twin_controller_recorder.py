"""The simulated controller's recorder: which samples it keeps, when it starts and when it ends."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import resample

from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.pi.simulated.tables import resampled
from flexstage.instruments.protocol import Signal
from tests.simple_stage import ACROSS, GAIN, SimpleStage, pulse, ring

TABLE = np.linspace(0.0, 9.0, 31)


def signal(kind: str, source: str) -> Signal:
    return Signal(kind=kind, source=source, name=f"{kind} {source}")


@pytest.fixture
def stage() -> SimpleStage:
    return SimpleStage()


@pytest.fixture
def device(stage: SimpleStage) -> VirtualController:
    device = VirtualController(stage, zero_at_start=False)
    device.set_wave(1, TABLE)
    device.choose_wave("1", 1)
    device.set_record_signal(1, signal("voltage", "1"))
    device.set_record_signal(3, signal("position", "1"))
    return device


def refusal(call: object, *args: object) -> Refusal:
    with pytest.raises(RefusedError) as caught:
        call(*args)  # type: ignore[operator]
    return caught.value.reason


def test_the_first_sample_is_the_first_of_the_waveform(device: VirtualController) -> None:
    device.arm_recorder("wave")
    device.advance(0.013)
    assert device.recorder.recorded == 0
    assert not device.recorder.recording
    device.start_waves(["1"])
    device.advance(20e-4)
    assert device.recorder.recorded == 20
    assert device.recorder.recording
    device.advance(0.1)
    assert_array_equal(device.recorder.read(1, 0, 40), np.append(TABLE, np.full(9, 9.0)))
    # the first-order lag of the stage, by its own recursion
    x, expected = 0.0, []
    for u in device.recorder.read(1, 0, 40):
        x = 0.62 * x + 0.38 * GAIN[0] * u
        expected.append(x)
    assert_allclose(device.recorder.read(3, 0, 40), expected, rtol=1e-12)


@pytest.mark.parametrize("divider", [2, 5, 7])
def test_every_dth_sample_is_kept_as_it_is(device: VirtualController, divider: int) -> None:
    device.recorder.set_divider(divider)
    device.arm_recorder("wave")
    device.start_waves(["1"])
    for _ in range(31):
        device.advance(1e-4)
    count = -(-31 // divider)
    assert device.recorder.recorded == count
    assert_array_equal(device.recorder.read(1, 0, count), TABLE[::divider])
    assert_array_equal(device.recorder.read(1, 2, 2), TABLE[::divider][2:4])


def test_it_ends_when_the_tables_are_full_and_not_with_the_waveform(
    device: VirtualController,
) -> None:
    device.arm_recorder("wave")
    device.start_waves(["1"])
    device.advance(1.0)
    assert not device.wave_running("1")
    assert device.recorder.recording
    device.recorder._length = 10_321  # so that the test need not run for 26 s
    device.advance(1.0)
    assert device.recorder.recorded == 10_321
    assert not device.recorder.recording
    assert device.recorder.read(1, 10_320, 1)[0] == 9.0
    assert (device.recorder.count, device.recorder.capacity) == (8, 2**18)


def test_each_signal_is_what_it_says(device: VirtualController, stage: SimpleStage) -> None:
    for table, kind, source in ((2, "target", "2"), (4, "channel", "3"), (5, "position", "2"),
                                (6, "force", "1"), (7, "voltage", "2")):  # fmt: skip
        device.set_record_signal(table, signal(kind, source))
    device.set_servo("2", True)
    device.set_targets({"2": 5e-6})
    device.arm_recorder("now")
    device.set_commands({"1": 20.0})
    before = stage.samples
    device.advance(0.005)
    assert_array_equal(device.recorder.read(2, 0, 50), stage.commands[1, before:])
    assert_array_equal(device.recorder.read(4, 0, 50), ACROSS * device.recorder.read(3, 0, 50))
    assert device.recorder.read(5, 49, 1)[0] == device.position("2")
    assert device.recorder.read(7, 49, 1)[0] == device.voltage("2")
    assert_array_equal(device.recorder.read(6, 0, 50), 0.0)
    assert refusal(device.recorder.read, 8, 0, 1) is Refusal.UNKNOWN


def test_in_open_loop_the_target_is_the_last_one(device: VirtualController) -> None:
    device.set_record_signal(2, signal("target", "2"))
    device.set_servo("2", True)
    device.set_targets({"2": 5e-6})
    device.advance(0.1)
    device.set_servo("2", False)
    device.arm_recorder("now")
    device.advance(0.001)
    assert_array_equal(device.recorder.read(2, 0, 10), np.full(10, 5e-6))


def test_it_starts_once_with_what_it_was_armed_for(device: VirtualController) -> None:
    device.arm_recorder("move")
    device.start_waves(["1"])
    device.advance(0.01)
    assert device.recorder.recorded == 0
    device.set_commands({"2": 30.0})
    device.advance(0.01)
    assert device.recorder.recorded == 100
    device.set_commands({"2": 10.0})
    device.advance(0.01)
    assert device.recorder.recorded == 200  # it went on, and did not begin anew
    device.arm_recorder("wave")
    assert device.recorder.recorded == 200  # still to be read
    assert not device.recorder.recording
    device.advance(0.01)
    assert device.recorder.recorded == 200
    device.set_commands({"1": 0.0})
    device.advance(0.01)
    device.start_waves(["1"])
    device.advance(0.001)
    assert device.recorder.recorded == 10


def test_a_refused_command_starts_nothing(device: VirtualController) -> None:
    device.arm_recorder("move")
    assert refusal(device.set_commands, {"1": 500.0}) is Refusal.VOLTAGE_OUT_OF_LIMITS
    device.advance(0.01)
    assert device.recorder.recorded == 0


def test_a_stop_ends_a_recording_of_a_waveform_and_no_other(device: VirtualController) -> None:
    device.arm_recorder("wave")
    device.start_waves(["1"])
    device.advance(0.001)
    device.stop()
    device.advance(0.01)
    assert device.recorder.recorded == 10
    device.arm_recorder("now")
    device.advance(0.001)
    device.stop()
    device.advance(0.001)
    assert device.recorder.recorded == 20


def test_a_stop_of_one_axis_leaves_the_recording_of_the_other(device: VirtualController) -> None:
    device.choose_wave("2", 1)
    device.arm_recorder("wave")
    device.start_waves(["1", "2"])
    device.advance(0.001)
    device.stop(["1"])
    device.advance(0.001)
    assert device.recorder.recorded == 20
    device.stop(["2"])
    device.advance(0.001)
    assert device.recorder.recorded == 20


def test_a_change_of_settings_waits_for_the_next_recording(device: VirtualController) -> None:
    device.arm_recorder("now")
    device.advance(0.001)
    device.recorder.set_divider(10)
    device.set_record_signal(3, None)
    device.advance(0.001)
    assert device.recorder.recorded == 20
    assert device.recorder.read(3, 0, 20).size == 20
    device.arm_recorder("now")
    device.advance(0.001)
    assert device.recorder.recorded == 1
    assert refusal(device.recorder.read, 3, 0, 1) is Refusal.UNKNOWN
    assert device.recorder.signal(3) is None
    assert device.recorder.signal(1) == signal("voltage", "1")
    assert device.recorder.divider == 10


def test_nothing_chosen_records_nothing(stage: SimpleStage) -> None:
    device = VirtualController(stage, zero_at_start=False)
    device.arm_recorder("now")
    device.advance(0.01)
    assert not device.recorder.recording
    assert device.recorder.recorded == 0


def test_refusals(device: VirtualController) -> None:
    device.arm_recorder("now")
    device.advance(0.001)
    for reason, call, *args in (
        (Refusal.UNKNOWN, device.set_record_signal, 0, None),
        (Refusal.UNKNOWN, device.set_record_signal, 9, signal("position", "1")),
        (Refusal.UNKNOWN, device.set_record_signal, 1, signal("position", "3")),
        (Refusal.UNKNOWN, device.set_record_signal, 1, signal("channel", "4")),
        (Refusal.UNKNOWN, device.set_record_signal, 1, signal("channel", "x")),
        (Refusal.UNKNOWN, device.set_record_signal, 1, signal("current", "1")),
        (Refusal.BAD_VALUE, device.recorder.set_divider, 0),
        (Refusal.BAD_VALUE, device.arm_recorder, "noon"),
        (Refusal.BAD_VALUE, device.recorder.read, 1, 0, 11),
        (Refusal.BAD_VALUE, device.recorder.read, 1, -1, 2),
        (Refusal.BAD_VALUE, device.recorder.read, 1, 0, -1),
        (Refusal.UNKNOWN, device.recorder.read, 9, 0, 1),
    ):
        assert refusal(call, *args) is reason, (call, args)
    screws = VirtualController(SimpleStage("screw"))
    assert refusal(screws.set_record_signal, 1, signal("voltage", "1")) is Refusal.NOT_ABLE


# the hammer -------------------------------------------------------------------------------------


@pytest.mark.parametrize("divider", [1, 2])
def test_a_blow_is_recorded_at_the_rate_of_the_recorder(
    device: VirtualController, divider: int
) -> None:
    for table, kind, source in ((1, "force", "2"), (2, "response", "2"), (4, "response", "1")):
        device.set_record_signal(table, signal(kind, source))
    device.recorder.set_divider(divider)
    device.arm_recorder("wave")
    device.remove_drives(True)
    device.strike("2")
    assert device.recorder.recording
    assert device.recorder.recorded == 0
    device.advance(0.1)
    assert device.recorder.recorded == 1000 // divider
    device.advance(1.0)
    assert not device.recorder.recording
    n = device.recorder.recorded
    assert n == 5000 // divider  # half a second
    t = np.arange(n) * divider * 1e-4
    # A Gaussian of 0.3 ms has 530 Hz: beyond 2.5 kHz is exp(-11) = 1.5e-5 of it, beyond 4.1 kHz
    # exp(-30). Several times that is lost in the blow; the answer lies at 300 to 400 Hz.
    force = pulse(t - 0.051, 9.0)
    assert_allclose(
        device.recorder.read(1, 0, n), force, atol=9.0 * (1e-6 if divider == 1 else 1e-4)
    )
    assert_allclose(device.recorder.read(2, 0, n), ring(t, "y"), atol=1e-9)
    assert_array_equal(device.recorder.read(4, 0, n), 0.0)  # only the struck axis is read


def test_resampling_is_that_of_scipy_over_whole_periods() -> None:
    t = np.arange(4096) / 8192.0
    values = ring(t, "x")
    assert_allclose(resampled(values, 8192.0, 1e4), resample(values, 5000), atol=1e-12)
    assert_allclose(resampled(values, 8192.0, 2048.0), resample(values, 1024), atol=1e-12)


def test_drives_are_handled_at_rest_only(device: VirtualController, stage: SimpleStage) -> None:
    assert refusal(device.strike, "1") is Refusal.NOT_ABLE
    device.set_commands({"1": 50.0})
    assert refusal(device.remove_drives, True) is Refusal.NOT_ABLE
    device.advance(0.1)
    device.set_servo("2", True)
    device.advance(0.1)
    assert refusal(device.remove_drives, True) is Refusal.SERVO_ON
    device.set_servo("2", False)
    device.remove_drives(True)
    assert device.drives_out
    for call, *args in (
        (device.set_commands, {"1": 1.0}),
        (device.set_targets, {"1": 1e-6}),
        (device.set_servo, "1", True),
        (device.start_waves, ["1"]),
    ):
        assert refusal(call, *args) is Refusal.NOT_ABLE
    assert refusal(device.strike, "3") is Refusal.UNKNOWN
    device.stop()
    device.advance(0.01)
    assert stage.commands[0, -1] == 50.0
    device.remove_drives(False)
    device.set_commands({"1": 1.0})
