"""The simulated controller around the simulated stages themselves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.protocol import Signal
from flexstage.stage.designs import design
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.stage import VirtualStage

KINDS = (("position", "1"), ("voltage", "1"), ("target", "2"), ("position", "2"), ("channel", "7"))


@pytest.fixture(scope="module")
def stage() -> VirtualStage:
    return virtual_stage(design("vgtu-piezo"), model="lumped", seed=7)


@pytest.fixture
def device(stage: VirtualStage) -> VirtualController:
    device = VirtualController(stage)
    device.reboot()
    return device


def record_all(device: VirtualController) -> None:
    for table, (kind, source) in enumerate(KINDS, start=1):
        signal = Signal(kind=kind, source=source, name=kind)
        device.set_record_signal(table, signal)


def converse(device: VirtualController, portion: float) -> list[np.ndarray]:
    """Do a little of everything, time passing in portions."""

    def wait(seconds: float) -> None:
        left = round(seconds * 1e4)
        while left > 0:
            step = min(left, max(1, round(portion * 1e4)))
            device.advance(step * 1e-4)
            left -= step

    record_all(device)
    device.arm_recorder("now")
    device.set_commands({"1": 71.0, "2": 33.0})
    wait(0.05)
    device.set_servo("1", True)
    wait(0.0123)
    device.set_targets({"1": 30e-6})
    wait(0.1)
    n = 200
    sine = np.sin(2.0 * np.pi * np.arange(n) / n)
    device.set_wave(1, 30e-6 + 4e-6 * sine)
    device.set_wave(2, 60.0 + 8.0 * sine)
    device.set_wave(3, 33.0 + 12.0 * sine)
    device.choose_wave("1", 1, 2)
    device.choose_wave("2", 3)
    device.set_wave_cycles("1", 3)
    device.set_wave_cycles("2", 0)
    device.start_waves(["1", "2"])
    wait(0.0711)
    device.stop()
    wait(0.01)
    device.set_servo("1", False)
    wait(0.02)
    return [
        device.recorder.read(table, 0, device.recorder.recorded)
        for table in range(1, len(KINDS) + 1)
    ]


def test_time_in_portions_makes_no_difference(device: VirtualController) -> None:
    expected = converse(device, 1.0)
    for portion in (1.3e-3, 0.0171):
        device.reboot()
        for got, want in zip(converse(device, portion), expected, strict=True):
            assert got.size == 2634
            assert np.isfinite(got).all()
            assert_array_equal(got, want)


def test_control_is_switched_without_a_jump(device: VirtualController) -> None:
    device.set_commands({"1": 64.0})
    device.advance(0.3)
    record_all(device)
    device.recorder.set_divider(1)
    device.arm_recorder("now")
    device.advance(0.05)
    device.set_servo("1", True)
    device.advance(0.05)
    device.set_servo("1", False)
    device.advance(0.05)
    voltage, position = device.recorder.read(2, 0, 1500), device.recorder.read(1, 0, 1500)
    # The target is one reading, 5 nm rms and 10 nm of mains off, and creep goes on: the loop
    # corrects some tens of nanometres at 0.5 um/V.
    assert np.ptp(voltage) < 0.2
    assert np.ptp(position) < 120e-9


def test_a_move_arrives_and_stays(device: VirtualController) -> None:
    device.set_servo("1", True)
    device.set_servo("2", True)
    device.set_targets({"1": 41e-6, "2": 19e-6})
    taken = 0
    while not (device.on_target("1") and device.on_target("2")):
        device.advance(1e-3)
        taken += 1
        assert taken < 300
    # It may leave the window once more in the next period of the mains, while it still comes near.
    device.advance(0.05)
    record_all(device)
    device.arm_recorder("now")
    away = 0
    for _ in range(200):
        device.advance(5e-3)
        away += not device.on_target("1")
    assert away == 0  # noise and mains do not lead it out of its window again
    position = device.recorder.read(1, 0, 10_000)
    assert_allclose(position.mean(), 41e-6, atol=2e-9)
    assert position.std() < 12e-9


def test_feedforward_does_most_of_the_work(device: VirtualController) -> None:
    device.set_servo("1", True)
    device.set_targets({"1": 30e-6})
    device.advance(0.3)
    n = 100  # 100 Hz
    sine = np.sin(2.0 * np.pi * np.arange(n) / n)
    device.set_wave(1, 30e-6 + 3e-6 * sine)
    gain = 3e-6 / 0.45e-6  # V, from what the stage moves a volt in small loops
    device.set_wave(2, 60.0 + gain * sine)
    record_all(device)
    device.set_record_signal(3, Signal(kind="target", source="1", name="target"))
    errors = []
    for beside in (0, 2):
        device.choose_wave("1", 1, beside)
        device.set_wave_cycles("1", 20)
        device.arm_recorder("wave")
        device.start_waves(["1"])
        device.advance(0.2)
        error = device.recorder.read(1, 1000, 1000) - device.recorder.read(3, 1000, 1000)
        errors.append(error.std())
        device.advance(0.1)
    assert errors[0] > 1e-6  # the integral alone is far too slow for 100 Hz
    assert errors[1] < 0.45 * errors[0]


def test_a_blow_rings_at_the_natural_frequency(device: VirtualController) -> None:
    for table, kind in ((1, "force"), (2, "response")):
        device.set_record_signal(table, Signal(kind=kind, source="1", name=kind))
    device.remove_drives(True)
    device.recorder.set_divider(2)
    device.arm_recorder("wave")
    device.strike("1")
    while device.recorder.recording:
        device.advance(0.1)
    n = device.recorder.recorded
    force, response = device.recorder.read(1, 0, n), device.recorder.read(2, 0, n)
    assert 4.0 < force.max() < 16.0
    assert 0.005 < np.argmax(force) / 5e3 < 0.05
    spectrum = np.abs(np.fft.rfft(response)) / np.maximum(np.abs(np.fft.rfft(force)), 1e-2)
    f = np.fft.rfftfreq(n, 1.0 / 5e3)
    peak = f[np.argmax(np.where((f > 50.0) & (f < 1000.0), spectrum, 0.0))]
    # the same blow at its own rate
    device.stage.reset()
    blow = device.stage.strike("x")
    own = np.abs(np.fft.rfft(blow.response)) / np.maximum(np.abs(np.fft.rfft(blow.force)), 1e-2)
    f_own = np.fft.rfftfreq(blow.force.size, 1.0 / blow.sample_rate_hz)
    expected = f_own[np.argmax(np.where((f_own > 50.0) & (f_own < 1000.0), own, 0.0))]
    assert_allclose(peak, expected, atol=2.0)  # both have lines 1.1 Hz apart


def test_a_reboot_repeats_the_numbers(device: VirtualController) -> None:
    first = converse(device, 0.01)
    device.reboot()
    for got, want in zip(converse(device, 0.01), first, strict=True):
        assert_array_equal(got, want)


def test_a_fast_conversation_repeats_its_numbers(stage: VirtualStage) -> None:
    said = []
    for _ in range(2):
        device = VirtualController(stage)
        device.reboot()
        pace = FastTime(device)
        numbers = []
        pace.before_command(poll=False)
        device.set_servo("2", True)
        pace.before_command(poll=False)
        device.set_targets({"2": 50e-6})
        asked = 0
        while True:
            pace.before_command(poll=True)
            asked += 1
            numbers.append(device.position("2"))
            if device.on_target("2"):
                break
            assert asked < 10
        said.append((numbers, device.now))
    assert said[0] == said[1]


def test_screws_drive_the_reduction_stage() -> None:
    device = VirtualController(virtual_stage(design("vgtu-mechanical"), model="lumped", seed=3))
    travel = device.axes["1"].limits.position
    assert travel is not None
    device.set_targets({"1": 0.4 * travel[1]})
    device.advance(0.4 * travel[1] / device.speed("1") + 0.02)
    assert device.on_target("1")
    assert_allclose(device.position("1"), 0.4 * travel[1], atol=1e-6)
    reading = device.channel(1)
    assert 0.0 < reading < 0.2 * travel[1]  # a reduction
    device.advance(0.1)
    assert_allclose(device.channel(1), reading, atol=200e-9)  # noise of 20 nm rms, and mains
