"""The client on the simulated controller: what it reads and writes is what the device has.

Evidence (Instruments, twin, control): twin, by network (the same job in memory): bit by bit
"""

import threading
from collections.abc import Iterator
from contextlib import closing
from functools import cache
from typing import cast

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, LimitError
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.simulated.address import Loopback
from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.gcs_state import GENERIC, MODELS, ControllerModel
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import GcsServer
from flexstage.instruments.protocol import Capability, Instrument, Signal, Waveform
from flexstage.instruments.ramp import lead_to
from flexstage.instruments.transport import InProcess, TcpLink
from flexstage.stage.designs import design
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.stage import VirtualStage

STAGE = design("vgtu-piezo")
LONG = TransferLimits(line_limit=16384)


@cache
def _made(seed: int, number: int):
    return virtual_stage(STAGE, model="lumped", seed=seed)


def interpreter(seed: int, number: int = 0, *, model: ControllerModel = GENERIC) -> Interpreter:
    """Return a controller; the stage is made once for each number, and relaxed again."""
    stage = _made(seed, number)
    stage.reset()
    device = VirtualController(cast("VirtualStage", stage))
    return Interpreter(device, FastTime(device), model=model)


@pytest.fixture
def twin() -> Iterator[tuple[PiController, VirtualController]]:
    made = interpreter(5)
    controller = PiController.open(InProcess(Loopback(made)), STAGE, transfer=LONG, timeout=60.0)
    assert isinstance(made.device, VirtualController)
    yield controller, made.device
    controller.close()


def sine(low: float, high: float, size: int = 400) -> np.ndarray:
    return low + (high - low) * (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size))


def test_it_can_do_everything_that_the_device_can(twin):
    controller, device = twin
    assert isinstance(cast("object", controller), Instrument)
    assert controller.capabilities == frozenset(Capability)
    for name, axis in controller.axes.items():
        described = device.axes[axis.facts.identifier]
        assert described.stage_axis == name
        assert axis.capabilities == described.capabilities
        assert axis.limits.voltage == described.limits.voltage
        assert axis.limits.slew == described.limits.slew
        # ten digits are printed
        assert axis.limits.position == pytest.approx(described.limits.position, rel=1e-9)
    assert controller.identity.simulated
    assert controller.identity.model == device.identity.model
    assert [controller.channels.numbers[c.name] for c in device.channels] == [
        c.number for c in device.channels
    ]
    assert [controller.channels.units[c.name] for c in device.channels] == [
        c.unit for c in device.channels
    ]
    assert controller.recorder.base_rate_hz == pytest.approx(device.sample_rate_hz, rel=1e-9)
    assert controller.recorder.capacity == device.recorder.capacity
    assert controller.recorder.signals == device.recorder.count
    assert controller.waves.capacity == device.tables.capacity


def test_connecting_moves_and_switches_nothing(twin):
    _, device = twin
    for axis in device.axes:
        assert not device.servo_on(axis)
        assert not device.moving(axis)
        assert device.command(axis) == 6.0  # where it has set its zero
    assert not device.drives_out


def test_readings_are_those_of_the_device(twin):
    controller, device = twin
    controller.axes["y"].set_voltage(41.5)
    # simulated time has passed with the question: what was read is what the device still has
    assert controller.axes["y"].position() == pytest.approx(device.position("2"), rel=1e-9)
    assert controller.axes["y"].voltage() == pytest.approx(device.voltage("2"), rel=1e-9)
    for name in ("x.across", "y.roll"):
        number = controller.channels.numbers[name]
        assert controller.channel(number) == pytest.approx(device.channel(number), rel=1e-9)


def test_a_record_is_what_the_device_recorded(twin):
    controller, device = twin
    signals = (
        Signal(kind="voltage", source="x", name="u", unit="V"),
        Signal(kind="position", source="x", name="p"),
        controller.channels.signal("x.yaw"),
    )
    rate = controller.recorder.configure(signals, 2500.0, 1700)
    assert rate == 2500.0
    controller.axes["x"].set_voltage(0.0)
    controller.waves.load(
        Waveform(values={"x": sine(0.0, 90.0)}, sample_rate_hz=2000.0, quantity="voltage")
    )
    controller.recorder.arm()
    controller.waves.start(3)
    while controller.waves.running() or controller.recorder.available() < 1700:
        controller.pause(0.05)
    record = controller.recorder.read(0, 1700)
    for table, signal in enumerate(signals, 1):
        values = record.channel(signal.name).values
        np.testing.assert_allclose(
            values, device.recorder.read(table, 0, 1700), rtol=1e-9, atol=1e-18
        )
    assert record.sample_rate_hz == pytest.approx(2500.0, rel=1e-9)
    # it holds the waveform: a cosine from 0 to 90 V with a period of 0.2 s, late by 1 ms at most
    wanted = 45.0 - 45.0 * np.cos(2.0 * np.pi * record.time / 0.2)
    inside = record.time < 0.59
    error = record.channel("u").values - wanted
    assert np.max(np.abs(error[inside])) < 45.0 * 2.0 * np.pi / 0.2 * 1e-3


def test_tables_are_as_they_were_written_to_a_picometre(twin):
    controller, device = twin
    low, high = controller.axes["x"].limits.position
    rng = np.random.default_rng(3)
    values = np.clip(np.cumsum(rng.normal(0.0, 2e-8, 3000)) + 30e-6, low, high)
    controller.axes["x"].set_closed_loop(True)
    controller.axes["x"].move_to(values[0])
    controller.waves.load(Waveform(values={"x": values}, sample_rate_hz=10e3, quantity="position"))
    controller.waves.start()
    np.testing.assert_allclose(1e-6 * device.tables.samples(1), values, rtol=0.0, atol=0.51e-12)
    assert device.wave_divider == 1


def test_a_feedforward_is_chosen_and_taken_away(twin):
    controller, device = twin
    shape = Waveform(values={"x": sine(20e-6, 30e-6)}, sample_rate_hz=2e3, quantity="position")
    volts = Waveform(values={"x": sine(5.0, 9.0)}, sample_rate_hz=2e3, quantity="voltage")
    controller.axes["x"].set_closed_loop(True)
    controller.axes["x"].move_to(20e-6)
    controller.waves.load(shape, feedforward=volts)
    assert device.wave_choice("1") == (1, 3)
    controller.waves.start()
    np.testing.assert_allclose(device.tables.samples(3), volts.values["x"], rtol=0.0, atol=0.51e-6)
    while controller.waves.running():
        controller.pause(0.05)
    controller.waves.load(shape)
    assert device.wave_choice("1") == (1, 0)


def test_settings_of_control_are_those_of_the_device(twin):
    controller, device = twin
    settings = ServoSettings(
        proportional=1.7e5,
        integral=0.9e9,
        notches=(
            Notch(frequency_hz=870.0, zero_damping=0.03, pole_damping=0.45),
            Notch(frequency_hz=1530.0, zero_damping=0.0, pole_damping=0.2),
        ),
        lowpass_hz=2100.0,
    )
    controller.axes["y"].set_servo(settings)
    for found in (device.servo("2"), controller.axes["y"].servo()):
        assert found.proportional == pytest.approx(settings.proportional, rel=1e-8)
        assert found.integral == pytest.approx(settings.integral, rel=1e-8)
        assert found.lowpass_hz == pytest.approx(settings.lowpass_hz, rel=1e-8)
        for a, b in zip(found.notches, settings.notches, strict=True):
            assert a.frequency_hz == pytest.approx(b.frequency_hz, rel=1e-8)
            assert a.zero_damping == pytest.approx(b.zero_damping, rel=1e-8)
            assert a.pole_damping == pytest.approx(b.pole_damping, rel=1e-8)


def test_a_move_comes_to_its_target_within_the_window_and_noise(twin):
    controller, device = twin
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(33e-6)
    assert device.target("1") == pytest.approx(33e-6, abs=1e-12)
    # 20 nm of window, 5 nm rms of noise and 10 nm of mains
    assert axis.position() == pytest.approx(33e-6, abs=60e-9)
    axis.set_closed_loop(False)
    assert not device.servo_on("1")


def test_a_pause_is_simulated_time(twin):
    controller, device = twin
    for seconds in (0.02, 0.5, 2.25):
        before = device.now
        controller.pause(seconds)
        # a command and the question whether it went well take 1 ms each, for each piece of 1 s
        assert device.now - before == pytest.approx(seconds, abs=8e-3)


def test_a_blow_is_recorded_with_the_drives_out_which_are_back_for_the_next_motion(twin):
    controller, device = twin
    signals = (
        Signal(kind="force", source="y", name="force", unit="N"),
        Signal(kind="response", source="y", name="response", unit="m/s^2"),
    )
    controller.recorder.configure(signals, 10e3, 4000)
    controller.recorder.arm()
    controller.strike("y")
    assert device.drives_out
    while controller.recorder.available() < 4000:
        controller.pause(0.05)
    record = controller.recorder.read(0, 4000)
    force = record.channel("force").values
    assert force.max() > 1.0
    assert 0 < np.argmax(force) < 2000
    controller.axes["y"].set_voltage(2.0)
    assert not device.drives_out


def test_a_wave_that_is_endless_is_stopped_from_another_thread(twin):
    controller, device = twin
    controller.axes["x"].set_voltage(0.0)
    controller.waves.load(
        Waveform(values={"x": sine(0.0, 30.0)}, sample_rate_hz=2e3, quantity="voltage")
    )
    controller.waves.start(0)
    assert controller.waves.running()
    stopping = threading.Thread(target=controller.stop)
    stopping.start()
    stopping.join(10.0)
    assert not controller.waves.running()
    assert not device.wave_running("1")
    # nobody is blamed for the stop
    controller.recorder.configure([Signal(kind="position", source="x", name="p")], 1e3, 10)


def test_a_stop_at_rest_ends_no_later_motion_and_one_on_the_way_does(twin):
    controller, device = twin
    lead_to(controller, {"x": 17.0}, "voltage")
    controller.stop()
    lead_to(controller, {"x": 31.0}, "voltage")
    assert device.voltage("1") == pytest.approx(31.0)
    pause = controller.pause

    def stopped(seconds: float) -> None:
        controller.stop()
        pause(seconds)

    controller.pause = stopped
    with pytest.raises(ControllerError, match="axis 'x' was stopped before"):
        lead_to(controller, {"x": 73.0}, "voltage")
    assert device.voltage("1") < 73.0


def test_a_stop_just_before_a_waveform_begins_ends_it(twin, monkeypatch):
    controller, _ = twin
    waves = controller.waves
    controller.axes["x"].set_voltage(0.0)
    waves.load(
        Waveform(values={"x": np.linspace(0.0, 5.0, 50)}, sample_rate_hz=1000.0, quantity="voltage")
    )
    connection = waves._connection
    tell = connection.tell

    def told(line: str) -> object:
        if line.startswith("WGO") and line.endswith(" 1"):
            controller.stop()
        return tell(line)

    monkeypatch.setattr(connection, "tell", told)
    with pytest.raises(ControllerError, match="stopped"):
        waves.start(0)
    assert not waves.running()
    monkeypatch.setattr(connection, "tell", tell)
    waves.start(0)
    assert waves.running()
    controller.stop()


def test_a_second_client_may_look_and_stop():
    made = interpreter(5)
    links = [InProcess(Loopback(made)) for _ in range(2)]
    first, second = (PiController.open(link, STAGE, transfer=LONG) for link in links)
    with closing(first), closing(second):
        first.axes["x"].set_voltage(20.0)
        assert second.axes["x"].voltage() == pytest.approx(20.0, abs=0.01)
        first.axes["x"].set_closed_loop(True)
        first.axes["x"].move_to(50e-6, wait=False)
        second.stop()
        with pytest.raises(ControllerError, match="it was stopped, or another program"):
            first.axes["x"].wait()


@pytest.mark.parametrize("name", [name for name, m in MODELS.items() if not m.one_line])
def test_every_model_of_controller_is_driven(name):
    """The client goes by what a controller lists, and writes its unit as that does."""
    made = interpreter(5, model=MODELS[name])
    link = InProcess(Loopback(made))
    axes = {"x": "1"} if MODELS[name].axes == 1 else None
    with closing(PiController.open(link, STAGE, transfer=LONG, axes=axes)) as controller:
        assert (controller.identity.model, controller.identity.simulated) == (name, True)
        axis = controller.axes["x"]
        axis.set_closed_loop(True)
        axis.move_to(30e-6)
        assert axis.position() == pytest.approx(30e-6, abs=0.1e-6)
        controller.recorder.configure(
            [Signal(kind="position", source="x", name="p", unit="m")], 1e3, 50
        )
        controller.recorder.start()
        controller.pause(0.1)
        assert controller.recorder.read(0, 50).channel("p").values == pytest.approx(
            np.full(50, 30e-6), abs=0.2e-6
        )
        assert (Capability.WAVE_GENERATOR in controller.capabilities) != MODELS[name].motor


@pytest.mark.parametrize("name", ["E-727", "E-725", "E-753"])
def test_a_stage_that_is_switched_on_stands_within_its_range(name):
    session = Loopback(interpreter(5, model=MODELS[name]))

    def ask(text):
        session.send(text.encode() + b"\n")
        lines = session.receive().decode("latin-1").split(" \n")
        return [float(line.partition("=")[2]) for line in lines]

    for low, here, high in zip(ask("TMN?"), ask("POS?"), ask("TMX?"), strict=True):
        assert -1.5 < low < here < 0.1  # um; zero is a little above the low end
        assert high - low > 55.0
    session.send(b"SVO 1 1\nMOV 1 0\n")
    for _ in range(3):
        ask("ONT? 1")
    assert ask("ONT? 1") == [1.0]
    assert abs(ask("POS? 1")[0]) < 0.05


def test_axes_of_motors_are_referenced_before_they_move():
    design_of_screws = design("vgtu-mechanical")
    device = VirtualController(virtual_stage(design_of_screws, model="lumped", seed=3))
    made = Interpreter(device, FastTime(device), model=MODELS["C-884"])
    with closing(PiController.open(InProcess(Loopback(made)), design_of_screws)) as controller:
        axis = controller.axes["x"]
        assert axis.limits.position == pytest.approx(device.axes["1"].limits.position, rel=1e-9)
        assert axis.limits.speed == pytest.approx(device.axes["1"].limits.speed, rel=1e-9)
        with pytest.raises(ControllerError, match="not referenced"):
            axis.move_to(0.1e-3)
        axis.reference()
        axis.move_to(0.1e-3)
        assert device.position("1") == pytest.approx(0.1e-3, abs=1e-6)
        axis.reference()  # is nothing, the second time
        assert device.position("1") == pytest.approx(0.1e-3, abs=1e-6)


def test_a_restart_is_noticed():
    made = interpreter(5)
    with closing(PiController.open(InProcess(Loopback(made)), STAGE, transfer=LONG)) as controller:
        controller.axes["x"].set_closed_loop(True)
        controller.client.tell("RBT")
        with pytest.raises(ControllerError, match="restarted"):
            controller.axes["x"].move_to(30e-6)


def test_limits_are_checked_before_anything_is_sent(twin):
    controller, device = twin
    high = controller.axes["x"].limits.position[1]
    controller.axes["x"].set_closed_loop(True)
    before = device.target("1")
    with pytest.raises(LimitError):
        controller.axes["x"].move_to(high + 1e-9)
    assert device.target("1") == before
    controller.axes["x"].move_to(high)  # the end of the range itself is allowed


def job(controller: PiController) -> list[np.ndarray]:
    """Do a little of everything."""
    found = []
    for name, voltage in (("x", 35.0), ("y", 12.0)):
        controller.axes[name].set_voltage(voltage)
    signals = [Signal(kind="position", source=n, name=n) for n in ("x", "y")]
    controller.recorder.configure(signals, 5e3, 900)
    controller.recorder.start()
    controller.pause(0.3)
    found.append(np.array([c.values for c in controller.recorder.read(0, 900).channels]))
    controller.axes["x"].set_closed_loop(True)
    controller.axes["x"].move_to(25e-6)
    controller.waves.load(
        Waveform(values={"x": sine(25e-6, 32e-6)}, sample_rate_hz=2e3, quantity="position")
    )
    controller.recorder.arm()
    controller.waves.start(1)
    while controller.recorder.available() < 900:
        controller.pause(0.02)
    found.append(np.array([c.values for c in controller.recorder.read(0, 900).channels]))
    return found


def test_over_the_network_and_in_memory_the_same_job_gives_the_same_bits():
    # time passes with commands only, so the lines are told to be of one length
    with closing(
        PiController.open(InProcess(Loopback(interpreter(5))), STAGE, transfer=LONG)
    ) as memory:
        here = job(memory)
    server = GcsServer(interpreter(5, 1))
    server.start()
    try:
        with closing(
            PiController.open(TcpLink(*server.address), STAGE, transfer=LONG, timeout=30.0)
        ) as network:
            there = job(network)
    finally:
        server.close()
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_control_that_swings_is_switched_off_when_its_time_is_over(twin):
    piezo, _ = twin
    axis = piezo.axes["x"]
    axis.set_closed_loop(True)
    axis.set_servo(ServoSettings(integral=2e10))
    axis.move_to(30e-6, wait=False)
    with pytest.raises(ControllerError, match=r"after 2 s .* its position control switched off"):
        axis.wait(2.0)
    assert not axis.closed_loop
    piezo.pause(0.3)
    held = axis.voltage()
    piezo.pause(0.1)
    assert axis.voltage() == pytest.approx(held, abs=1e-3)
