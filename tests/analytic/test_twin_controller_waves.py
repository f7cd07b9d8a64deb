"""Waveforms of the simulated controller: what reaches the stage, and what is refused before it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.pi.simulated.tables import WaveRun, WaveTables
from tests.simple_stage import SimpleStage

TABLE = np.array([3.0, 4.5, 4.1, 2.2, 2.9])


@pytest.fixture
def stage() -> SimpleStage:
    return SimpleStage()


@pytest.fixture
def device(stage: SimpleStage) -> VirtualController:
    device = VirtualController(stage, zero_at_start=False)
    device.set_commands({"1": 3.0, "2": 3.0})
    device.advance(0.01)
    return device


def refusal(call: object, *args: object) -> RefusedError:
    with pytest.raises(RefusedError) as caught:
        call(*args)  # type: ignore[operator]
    return caught.value


def load(
    device: VirtualController, axis: str, table: int, samples: object, beside: int = 0
) -> None:
    device.set_wave(table, np.asarray(samples, dtype=float))
    device.choose_wave(axis, table, beside)


# runs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("divider", [1, 2, 3, 7])
@pytest.mark.parametrize("cycles", [1, 2, 4, 0])
def test_straight_lines_join_the_samples(divider: int, cycles: int) -> None:
    run = WaveRun(first=13, table=TABLE, divider=divider, cycles=cycles)
    n = TABLE.size
    k = np.arange(6 * n * divider)
    repeated = np.append(np.tile(TABLE, cycles or 6), [] if cycles else TABLE[:1])
    # numpy's interpolation holds the last value beyond the end
    expected = np.interp(k / divider, np.arange(repeated.size), repeated)
    # sums and products of numbers below 5 in another order: rounding of some 1e-15
    assert_allclose(run.values(13, k.size), expected, rtol=0, atol=1e-14)
    assert run.last == (13 + cycles * n * divider - 1 if cycles else None)


@pytest.mark.parametrize("divider", [1, 2, 3, 7])
@pytest.mark.parametrize("cycles", [2, 4, 0])
def test_cycles_that_go_on_where_the_last_has_ended(divider: int, cycles: int) -> None:
    shift = TABLE[-1] - TABLE[0]
    run = WaveRun(first=13, table=TABLE, divider=divider, cycles=cycles, shift=shift)
    k = np.arange(6 * TABLE.size * divider)
    going = np.concatenate([TABLE + shift * cycle for cycle in range(cycles or 7)])
    expected = np.interp(k / divider, np.arange(going.size), going)
    assert_allclose(run.values(13, k.size), expected, rtol=0, atol=1e-14)
    assert run.end == pytest.approx(TABLE[-1] + shift * max(cycles - 1, 0), abs=1e-14)


def test_an_axis_climbs_by_steps_that_go_on(device: VirtualController, stage: SimpleStage) -> None:
    load(device, "2", 5, [3.0, 3.5, 5.0])
    device.set_wave_cycles("2", 3)
    device.start_waves(["2"], onward=["2"])
    device.advance(0.01)
    climbed = [3.0, 3.5, 5.0, 5.0, 5.5, 7.0, 7.0, 7.5, 9.0, 9.0]
    assert_allclose(stage.commands[1, 101:111], climbed, rtol=1e-12)
    assert device.command("2") == pytest.approx(9.0, rel=1e-12)
    # the last cycle must be within the limits, and there must be a last one
    device.set_commands({"2": 3.0})
    device.advance(0.01)
    device.set_wave_cycles("2", 1000)
    assert refusal(device.start_waves, ["2"], ["2"]).reason is Refusal.OUT_OF_LIMITS
    device.set_wave_cycles("2", 0)
    assert refusal(device.start_waves, ["2"], ["2"]).reason is Refusal.OUT_OF_LIMITS
    assert not device.wave_running("2")


def test_a_waveform_in_open_loop_reaches_the_drive_sample_by_sample(
    device: VirtualController, stage: SimpleStage
) -> None:
    load(device, "2", 5, TABLE)
    device.set_wave_cycles("2", 2)
    device.start_waves(["2"])
    assert device.wave_running("2")
    assert not device.wave_running("1")
    assert device.moving("2")
    for k in range(10):
        assert device.wave_running("2"), k
        device.advance(1e-4)
        assert device.command("2") == TABLE[k % 5]
    assert not device.wave_running("2")
    assert not device.moving("2")
    device.advance(0.01)
    assert_array_equal(stage.commands[1, 101:], np.append(np.tile(TABLE, 2), np.full(100, 2.9)))
    assert device.command("2") == 2.9
    assert_array_equal(stage.commands[0, 101:], np.full(110, 3.0))


def test_two_axes_run_in_step_with_cycles_of_their_own(
    device: VirtualController, stage: SimpleStage
) -> None:
    load(device, "1", 1, TABLE)
    load(device, "2", 2, TABLE[:3])
    device.set_wave_cycles("1", 0)
    device.set_wave_rate_divider(2)
    device.start_waves(["2", "1"])
    device.advance(0.1)
    x, y = stage.commands[:, 101:]
    assert_allclose(x[::2], np.tile(TABLE, 100))
    assert_allclose(y[:8], [3.0, 3.75, 4.5, 4.3, 4.1, 4.1, 4.1, 4.1])
    assert device.wave_running("1")
    assert not device.wave_running("2")
    device.set_commands({"2": 5.0})  # the other axis is free
    assert refusal(device.set_commands, {"1": 5.0}).reason is Refusal.WAVE_RUNNING


def test_under_control_a_table_holds_positions(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("1", True)
    device.set_targets({"1": 2e-6})
    device.advance(0.1)
    load(device, "1", 1, [2e-6, 2.1e-6, 2.3e-6])
    device.start_waves(["1"])
    device.advance(2e-4)
    assert device.target("1") == 2.1e-6
    device.advance(0.2)
    assert device.target("1") == 2.3e-6
    assert_allclose(device.position("1"), 2.3e-6, rtol=1e-6)
    assert device.on_target("1")
    assert np.isnan(stage.beside).all()


def test_feedforward_runs_beside_the_control_and_ends_with_the_waveform(
    device: VirtualController, stage: SimpleStage
) -> None:
    device.set_servo("1", True)
    device.set_targets({"1": 2e-6})
    device.advance(0.1)
    load(device, "1", 1, [2e-6, 2.1e-6, 2.3e-6], beside=7)
    device.set_wave(7, np.array([5.0, 5.5, 6.5]))
    device.set_wave_cycles("1", 2)
    device.set_wave_rate_divider(2)
    device.start_waves(["1"])
    before = stage.samples
    device.advance(0.01)
    expected = [5.0, 5.25, 5.5, 6.0, 6.5, 5.75, 5.0, 5.25, 5.5, 6.0, 6.5, 6.5]
    assert_array_equal(stage.beside[0, before : before + 12], expected)
    assert np.isnan(stage.beside[0, before + 12 :]).all()
    assert np.isnan(stage.beside[1]).all()


def test_screws_run_waveforms_of_their_advance() -> None:
    stage = SimpleStage("screw")
    device = VirtualController(stage, zero_at_start=False)
    load(device, "1", 1, [0.0, 2e-6, 4e-6, 1e-6])
    device.set_wave_rate_divider(30)
    device.start_waves(["1"])
    device.advance(0.02)
    assert_allclose(stage.commands[0, 1::30][:5], [0.0, 2e-6, 4e-6, 1e-6, 1e-6])
    assert device.position("1") == 1e-6


def test_a_stopped_waveform_holds_and_the_other_goes_on(
    device: VirtualController, stage: SimpleStage
) -> None:
    for axis, table in (("1", 1), ("2", 2)):
        load(device, axis, table, TABLE)
        device.set_wave_cycles(axis, 0)
    device.start_waves(["1", "2"])
    device.advance(7e-4)
    device.stop_waves(["1"])
    device.advance(8e-4)
    assert_array_equal(stage.commands[0, 108:], np.full(8, TABLE[1]))
    assert_array_equal(stage.commands[1, 101:], np.tile(TABLE, 3))
    device.stop_waves(["1", "2"])
    assert not device.wave_running("2")
    assert device.command("2") == TABLE[4]


def test_a_waveform_that_is_stopped_before_its_first_sample_moves_nothing(
    device: VirtualController, stage: SimpleStage
) -> None:
    load(device, "1", 1, [4.0, 5.0])
    device.start_waves(["1"])
    assert device.command("1") == 3.0
    device.stop()
    device.advance(0.01)
    assert_array_equal(stage.commands[0, 101:], np.full(100, 3.0))


# refusals ---------------------------------------------------------------------------------------

STEEP = 3e4 * 1e-4  # of the voltage in a sample of the loop [V]


@pytest.mark.parametrize(
    ("samples", "cycles"),
    [
        (np.linspace(3.0, 113.2, 50).tolist(), 1),  # beyond 113 V
        ([3.0, 3.0 + 1.01 * STEEP], 1),  # a step between samples
        ([3.0, 5.5, 8.0], 2),  # the step from the last one to the first
        ([3.0, 5.5, 8.0], 0),
        ([3.0 + 1.01 * STEEP, 7.0], 1),  # the step from where the axis stands
    ],
)
def test_a_waveform_is_looked_at_whole_before_its_first_sample(
    device: VirtualController, stage: SimpleStage, samples: list[float], cycles: int
) -> None:
    load(device, "2", 2, [3.0, 3.1])
    load(device, "1", 1, samples)
    device.set_wave_cycles("1", cycles)
    assert refusal(device.start_waves, ["2", "1"]).reason is Refusal.OUT_OF_LIMITS
    device.advance(0.01)
    assert_array_equal(stage.commands[:, 101:], np.full((2, 100), 3.0))  # neither of them


@pytest.mark.parametrize(
    ("samples", "cycles"),
    [
        ([3.0, 5.5, 8.0], 1),
        ([3.0 + STEEP, 3.0 + 2.0 * STEEP], 1),
        ([3.0, 3.0 + 1.0009 * STEEP], 1),
        ([3.0, 3.0], 0),
        ([3.0], 3),
    ],
)
def test_a_waveform_at_its_limits_runs(
    device: VirtualController, samples: list[float], cycles: int
) -> None:
    load(device, "1", 1, samples)
    device.set_wave_cycles("1", cycles)
    device.start_waves(["1"])
    assert device.wave_running("1")


def test_a_slower_table_may_step_further(device: VirtualController) -> None:
    load(device, "1", 1, [3.0, 3.0 + 4.0 * STEEP])
    device.set_wave_rate_divider(3)
    assert refusal(device.start_waves, ["1"]).reason is Refusal.OUT_OF_LIMITS
    device.set_wave_rate_divider(4)
    device.start_waves(["1"])


def test_a_slow_table_must_begin_where_the_axis_stands_too(device: VirtualController) -> None:
    device.set_wave_rate_divider(50)
    load(device, "1", 1, [3.0 + 1.01 * STEEP, 7.0])
    assert refusal(device.start_waves, ["1"]).reason is Refusal.OUT_OF_LIMITS


def test_positions_have_limits_of_their_own(device: VirtualController) -> None:
    device.set_servo("1", True)  # at 1.4 um
    speed = 3e4 * (41e-6 - 0.4e-6) / 120.0
    here = device.target("1")
    for samples in ([here, 41.1e-6], [here, here + 1.01 * speed * 1e-4], [here - 2e-6, here]):
        load(device, "1", 1, samples)
        assert refusal(device.start_waves, ["1"]).reason is Refusal.OUT_OF_LIMITS
    load(device, "1", 1, [here, here + speed * 1e-4])
    device.start_waves(["1"])


def test_feedforward_is_looked_at_too(device: VirtualController) -> None:
    load(device, "1", 1, [1.41e-6, 1.42e-6, 1.41e-6], beside=2)
    device.set_wave(2, np.array([1.0, 2.0, 1.0]))
    assert refusal(device.start_waves, ["1"]).reason is Refusal.SERVO_OFF
    device.set_servo("1", True)
    for reason, voltages in (
        (Refusal.BAD_VALUE, [1.0, 2.0]),
        (Refusal.OUT_OF_LIMITS, [1.0, 2.0, -7.2]),
        (Refusal.OUT_OF_LIMITS, [1.0, 4.5, 3.0]),
        (Refusal.NO_WAVE, []),
    ):
        device.set_wave(2, np.array(voltages))
        assert refusal(device.start_waves, ["1"]).reason is reason
    device.set_wave(2, np.array([1.0, 2.0, 1.0]))
    device.start_waves(["1"])


def test_refusals_around_tables(device: VirtualController) -> None:
    load(device, "1", 1, TABLE)
    device.set_wave_cycles("1", 0)
    for reason, call, *args in (
        (Refusal.NO_WAVE, device.start_waves, ["2"]),
        (Refusal.NO_WAVE, device.start_waves, ["1", "2"]),
        (Refusal.UNKNOWN, device.start_waves, ["1", "7"]),
        (Refusal.UNKNOWN, device.stop_waves, ["7"]),
        (Refusal.UNKNOWN, device.choose_wave, "1", 9),
        (Refusal.UNKNOWN, device.choose_wave, "1", 1, 9),
        (Refusal.UNKNOWN, device.choose_wave, "1", -1),
        (Refusal.UNKNOWN, device.set_wave, 0, TABLE),
        (Refusal.UNKNOWN, device.tables.samples, 9),
        (Refusal.BAD_VALUE, device.set_wave, 2, np.array([1.0, np.nan])),
        (Refusal.BAD_VALUE, device.set_wave_cycles, "1", -1),
        (Refusal.BAD_VALUE, device.set_wave_rate_divider, 0),
        (Refusal.TABLE_FULL, device.set_wave, 2, np.zeros(2**18 - 4)),
    ):
        assert refusal(call, *args).reason is reason, (call, args)
    assert not device.wave_running("1")
    device.set_wave(2, np.zeros(2**18 - 5))  # what is left
    device.set_wave(2, np.zeros(0))
    device.start_waves(["1"])
    for call, *args in (
        (device.start_waves, ["1"]),
        (device.set_wave, 1, TABLE),
        (device.choose_wave, "1", 2),
        (device.set_wave_cycles, "1", 3),
        (device.set_wave_rate_divider, 2),
        (device.set_servo, "1", True),
        (device.set_commands, {"2": 1.0, "1": 1.0}),
        (device.remove_drives, True),
    ):
        assert refusal(call, *args).reason is Refusal.WAVE_RUNNING, (call, args)
    device.set_servo("2", True)
    assert refusal(device.set_targets, {"2": 1e-6, "1": 1e-6}).reason is Refusal.WAVE_RUNNING


def test_tables_keep_what_they_were_given(device: VirtualController) -> None:
    given = TABLE.copy()
    device.set_wave(4, given)
    given[0] = 99.0
    assert_array_equal(device.tables.samples(4), TABLE)
    with pytest.raises(ValueError, match="read-only"):
        device.tables.samples(4)[0] = 1.0
    assert device.tables.capacity == 2**18
    assert device.tables.count == 8
    assert device.tables.samples(3).size == 0
    assert WaveTables(2, 5).samples(2).size == 0


def test_what_is_appended_is_read_behind_what_was_there(device: VirtualController) -> None:
    for k in range(5):
        device.append_wave(4, TABLE + k)
        given = np.concatenate([TABLE + i for i in range(k + 1)])
        assert device.tables.size(4) == given.size
        if k % 2:  # read in between, or not
            assert_array_equal(device.tables.samples(4), given)
    assert_array_equal(device.tables.samples(4), given)
    with pytest.raises(ValueError, match="read-only"):
        device.tables.samples(4)[0] = 1.0
    room = device.tables.room(4) - given.size
    assert refusal(device.append_wave, 4, np.array([1.0, np.inf])).reason is Refusal.BAD_VALUE
    assert refusal(device.append_wave, 4, np.zeros(room + 1)).reason is Refusal.TABLE_FULL
    assert refusal(device.append_wave, 9, TABLE).reason is Refusal.UNKNOWN
    assert_array_equal(device.tables.samples(4), given)
    device.set_wave(4, TABLE)
    assert_array_equal(device.tables.samples(4), TABLE)
    assert device.tables.room(3) == 2**18 - TABLE.size
