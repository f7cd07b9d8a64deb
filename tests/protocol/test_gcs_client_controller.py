"""What leaves for a PI controller, byte for byte, for each job; and what is made of the answers.

Evidence (Instruments, twin, control): commands of client and twin (published set): exact
"""

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, LimitError, ModelError
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.replies import VOLTS, WireUnit, axis_unit
from flexstage.instruments.pi.tables import point_lines
from flexstage.instruments.protocol import (
    Capability,
    Instrument,
    MotionAxis,
    Recorder,
    Signal,
    Waveform,
    WaveGenerator,
)
from flexstage.instruments.transport import InProcess
from flexstage.stage.designs import design
from flexstage.system.servo import Notch, ServoSettings
from tests.gcs_script import COMMANDS, InMemory, ScriptedController

STAGE = design("vgtu-piezo")


def opened(
    script: ScriptedController | None = None, **options
) -> tuple[PiController, ScriptedController]:
    script = ScriptedController() if script is None else script
    controller = PiController.open(
        InProcess(InMemory(script)), STAGE, sleep=lambda _: None, **options
    )
    script.log.clear()
    return controller, script


def moved(log: list[str]) -> list[str]:
    """Commands that move something, or could."""
    return [line for line in log if line.split()[0] in ("MOV", "SVA", "SVO", "WGO", "MVR")]


def without_checks(log: list[str]) -> list[str]:
    return [line for line in log if line != "ERR?"]


# connecting -----------------------------------------------------------------------------------


def test_connecting_asks_and_neither_moves_nor_switches_anything():
    script = ScriptedController()
    link = InMemory(script)
    PiController.open(InProcess(link), STAGE)
    assert b"".join(link.sent).decode() == (
        "*IDN?\nCSV?\nERR?\nHLP?\nHPA?\nHDR?\nSAI?\nTPC?\n"
        "PUN? 1\nTMN? 1\nTMX? 1\nVMI? 1\nVMA? 1\n"
        "PUN? 2\nTMN? 2\nTMX? 2\nVMI? 2\nVMA? 2\n"
        "SVO? 1 2\nSPA? 1 0x0E000200\nTSC?\nTNR?\n"
        "SPA? 1 0x16000201\nSPA? 1 0x1300010A\nSPA? 1 0x13000004\n"
    )
    assert all(line.endswith("?") or "? " in line for line in script.log)


def test_what_it_is_and_can_do_follows_from_what_it_says():
    controller, _ = opened()
    assert isinstance(controller, Instrument)
    assert isinstance(controller.recorder, Recorder)
    assert isinstance(controller.waves, WaveGenerator)
    assert all(isinstance(axis, MotionAxis) for axis in controller.axes.values())
    assert controller.identity.model == "P-727.3"
    assert controller.identity.serial_number == "117"
    assert not controller.identity.simulated
    assert controller.capabilities == {
        Capability.CLOSED_LOOP,
        Capability.OPEN_LOOP,
        Capability.DATA_RECORDER,
        Capability.WAVE_GENERATOR,
        Capability.CHANNELS,
    }
    assert controller.recorder.base_rate_hz == pytest.approx(20e3, rel=1e-12)
    assert (controller.recorder.signals, controller.recorder.capacity) == (3, 2000)
    assert controller.waves.capacity == 4000


def test_commands_that_are_not_listed_are_neither_used_nor_promised():
    known = "*IDN? CSV? HLP? SAI? MOV POS? SVO SVO? TMN? TMX?"
    controller, script = opened(ScriptedController(commands=known))
    assert controller.capabilities == {Capability.CLOSED_LOOP}
    with pytest.raises(ModelError, match="no commands of a data recorder"):
        _ = controller.recorder
    with pytest.raises(ModelError, match="no commands of a wave generator"):
        _ = controller.waves
    with pytest.raises(ModelError, match="it has no command of the voltage"):
        controller.axes["x"].set_voltage(5.0)
    with pytest.raises(ModelError, match="there is no sensor 1"):
        controller.channel(1)
    assert script.log == []


def test_half_an_answer_is_told_from_what_a_controller_lacks():
    half = "*IDN? CSV? ERR? HLP? MOV POS?"
    with pytest.raises(
        ControllerError, match=r"6 commands, none .* starts with T .* is incomplete"
    ):
        opened(ScriptedController(commands=half))


@pytest.mark.parametrize("missing", ["DRC", "DRR?", "DRL?", "RTR", "DRT"])
def test_a_recorder_needs_all_its_commands(missing):
    commands = " ".join(c for c in COMMANDS.split() if c != missing)
    controller, _ = opened(ScriptedController(commands=commands))
    assert Capability.DATA_RECORDER not in controller.capabilities


def test_gains_without_a_unit_are_never_set():
    controller, script = opened()
    with pytest.raises(ModelError, match="setting of the position control"):
        controller.axes["x"].set_servo(ServoSettings(integral=1e9))
    assert script.log == []


def test_an_impulse_of_a_real_controller_is_no_hammer():
    controller, script = opened(ScriptedController(commands=COMMANDS + " IMP"))
    assert Capability.IMPACT not in controller.capabilities
    with pytest.raises(ModelError, match="has no hammer"):
        controller.strike("x")
    assert script.log == []


def test_limits_are_the_narrower_of_stage_and_controller():
    controller, _ = opened()
    limits = controller.axes["x"].limits
    assert limits.position == pytest.approx((-5e-6, 95e-6))
    # stage 0 to 120 V, controller -20 to 110 V
    assert limits.voltage == (0.0, 110.0)
    assert limits.slew == 40e3


def test_limits_that_have_nothing_in_common_are_refused_at_once():
    script = ScriptedController()
    script.volts = (-120.0, -10.0)
    link = InMemory(script)
    with pytest.raises(ModelError, match="the ranges do not overlap"):
        PiController.open(InProcess(link), STAGE)
    assert link.closed


def test_axes_are_those_that_are_named():
    controller, script = opened(axes={"x": "3", "y": "1"})
    controller.axes["x"].set_closed_loop(True)
    controller.axes["x"].move_to(7.5e-6)
    assert moved(script.log) == ["SVO 3 1", "MOV 3 7.5"]
    assert controller.axes["y"].limits.position == pytest.approx((-5e-6, 95e-6))
    controller.axes["x"].voltage()
    assert script.log[-1] == "VOL? 3"


@pytest.mark.parametrize(
    ("axes", "kind", "sentence"),
    [
        ({"x": "4"}, ControllerError, "no axis '4': it has 1, 2, 3"),
        ({"z": "1"}, ModelError, "the stage has no axis 'z': it has x, y"),
        ({"x": "1", "y": "1"}, ModelError, "a different axis of the controller"),
        ({}, ModelError, "a different axis of the controller"),
    ],
)
def test_axes_that_are_not_there_are_refused(axes, kind, sentence):
    with pytest.raises(kind, match=sentence):
        opened(axes=axes)


# units ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "scale"), [("um", 1.0), ("UM", 1.0), ("\xb5m", 1.0), ("mm", 1e-3), ("nm", 1e3)]
)
def test_positions_are_told_in_the_unit_of_the_controller(unit, scale):
    script = ScriptedController(unit=unit)
    script.low = dict.fromkeys("123", 0.0)
    script.high = dict.fromkeys("123", float(90.0 * scale))
    controller, script = opened(script)
    axis = controller.axes["x"]
    assert axis.limits.position == pytest.approx((0.0, 90e-6))
    axis.set_closed_loop(True)
    axis.move_to(12.345678e-6)
    sent = next(line for line in script.log if line.startswith("MOV "))
    # to a picometre
    assert float(sent.split()[2]) == pytest.approx(12.345678 * scale, abs=0.5e-6 * scale)
    assert "e" not in sent
    script.target["1"] = 30.0 * scale
    assert axis.position() == pytest.approx(30e-6, abs=1.01e-3 * 1e-6 / scale)


@pytest.mark.parametrize("unit", ["deg", "mrad", "counts", ""])
def test_an_axis_that_does_not_count_in_lengths_is_refused(unit):
    with pytest.raises(ControllerError, match="the unit of axis '1' of the controller is"):
        opened(ScriptedController(unit=unit))


def test_rounding_never_leaves_the_limits():
    um = WireUnit(factor=1e-6, decimals=6)
    high = 70.1234567891e-6
    assert um.text(high, (0.0, high)) == "70.123456"
    assert um.text(-high, (-high, 0.0)) == "-70.123456"
    assert VOLTS.text(120.0, (0.0, 120.0)) == "120"
    assert VOLTS.text(-1e-9) == "0"


def test_a_limit_of_ten_digits_can_be_commanded_exactly():
    um = axis_unit("um", "1", "x")
    for printed in ("9.912345e+01", "6.993672e+01", "1.300000e-01"):
        high = float(printed) * um.factor
        assert float(um.text(high, (0.0, high))) == float(printed)


# motion ---------------------------------------------------------------------------------------


def test_switching_control_on_a_move_and_the_wait_for_it():
    controller, script = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    script.arrives = False
    script.faults["ONT? 1"] = lambda said: setattr(script, "arrives", True) or said
    axis.move_to(12.5e-6)
    assert script.log == [
        "SVO 1 1", "ERR?", "SVO? 1",
        "MOV 1 12.5", "ERR?", "SVO? 1", "ONT? 1", "ONT? 1", "MOV? 1",
    ]  # fmt: skip


def test_control_that_is_on_already_is_not_switched_again():
    controller, script = opened()
    axis = controller.axes["y"]
    axis.set_closed_loop(True)
    script.log.clear()
    axis.set_closed_loop(True)
    assert moved(script.log) == []


def test_readings():
    controller, script = opened()
    script.target["2"], script.sva["2"] = 17.0, 33.25
    axis = controller.axes["y"]
    assert axis.position() == pytest.approx(17.001e-6)
    assert axis.voltage() == 33.25
    assert controller.channel(3) == pytest.approx(0.75e-6)
    script.moving = 0b10
    assert axis.moving()
    assert not controller.axes["x"].moving()
    assert script.log == ["POS? 2", "VOL? 2", "TSP? 3", "#5", "#5"]


def test_a_voltage_is_reached_in_steps_and_the_first_one_is_looked_at():
    controller, script = opened()
    controller.axes["x"].set_voltage(11.0)
    # 40 V/ms: 4 V at once; 1 V first, to see that the controller counts in volts
    assert without_checks(script.log) == [
        "VOL? 1",
        "SVA 1 1", "VOL? 1",
        "SVA 1 5", "VOL? 1",
        "SVA 1 9", "VOL? 1",
        "SVA 1 11", "VOL? 1",
    ]  # fmt: skip
    script.log.clear()
    controller.axes["x"].set_voltage(9.5)
    assert without_checks(script.log) == ["VOL? 1", "SVA 1 9.5"]


def test_a_stop_from_any_thread_is_one_character():
    script = ScriptedController()
    link = InMemory(script)
    controller = PiController.open(InProcess(link), STAGE)
    controller.stop()
    assert link.sent[-1] == b"\x18"


def test_closing_sends_nothing():
    script = ScriptedController()
    link = InMemory(script)
    controller = PiController.open(InProcess(link), STAGE)
    before = len(link.sent)
    controller.close()
    controller.close()
    assert len(link.sent) == before
    assert link.closed


# limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [95.001e-6, -5.001e-6, np.nan, np.inf, -np.inf, 1.0])
def test_a_position_outside_the_limits_never_leaves(value):
    controller, script = opened()
    controller.axes["x"].set_closed_loop(True)
    script.log.clear()
    with pytest.raises(LimitError, match="axis 'x'"):
        controller.axes["x"].move_to(value)
    assert script.log == []


@pytest.mark.parametrize("value", [110.01, -0.01, np.nan, np.inf, 1e9])
def test_a_voltage_outside_the_limits_never_leaves(value):
    controller, script = opened()
    with pytest.raises(LimitError, match="axis 'y'"):
        controller.axes["y"].set_voltage(value)
    assert script.log == []


def wave(quantity: str = "voltage", **values) -> Waveform:
    return Waveform(
        values={k: np.asarray(v, dtype=float) for k, v in values.items()},
        sample_rate_hz=4e3,
        quantity=quantity,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        (wave(x=[1.0, 2.0, 110.5, 1.0]), LimitError),  # one sample
        (wave(x=[0.0, 12.0]), LimitError),  # 48 kV/s
        (wave("position", x=[1e-6, 96e-6]), LimitError),
        (wave(x=np.linspace(0, 5, 4001)), LimitError),  # longer than the tables
        (wave(z=[1.0, 2.0]), LimitError),
        (Waveform(values={"x": np.ones(5)}, sample_rate_hz=3e3, quantity="voltage"), ModelError),
    ],
)
def test_a_waveform_that_cannot_run_never_leaves(given, kind):
    controller, script = opened()
    with pytest.raises(kind):
        controller.waves.load(given)
    assert script.log == []


# waveforms ------------------------------------------------------------------------------------


def test_a_waveform_from_the_tables_to_its_end():
    controller, script = opened(transfer=TransferLimits(line_limit=40))
    shape = wave(x=[0.0, 1.5, 2.25, 1.0, 0.5, 0.0], y=[0.0, 1.0, 2.0, 3.0, 2.0, 1.0])
    controller.waves.load(shape)
    assert without_checks(script.log) == [
        "WTR 0 5 1",
        "WAV 1 X PNT 1 6 0 1.5 2.25 1 0.5 0",
        "WAV 2 X PNT 1 6 0 1 2 3 2 1",
        "GWD? 1 3 1", "GWD? 3 3 1", "GWD? 4 3 1",
        "GWD? 1 3 2", "GWD? 4 3 2",
        "WSL 1 1 2 2",
    ]  # fmt: skip
    assert script.waves == {"1": list(shape.values["x"]), "2": list(shape.values["y"])}
    script.log.clear()
    controller.waves.start(3)
    assert controller.waves.running()
    controller.waves.stop()
    assert without_checks(script.log) == [
        "SVO? 1", "VOL? 1", "SVO? 2", "VOL? 2",
        "WGC 1 3 2 3", "WGO 1 1 2 1", "#9", "WGO 1 0 2 0",
    ]  # fmt: skip
    assert not controller.waves.running()


def test_a_waveform_of_positions_is_told_in_the_unit_of_the_axis():
    controller, script = opened()
    axis = controller.axes["x"]
    axis.set_closed_loop(True)
    axis.move_to(10e-6)
    shape = wave("position", x=[10e-6, 10.5e-6, 10.25e-6, 10e-6])
    controller.waves.load(shape)
    assert script.waves["1"] == [10.0, 10.5, 10.25, 10.0]
    controller.waves.start()
    assert moved(script.log)[-1] == "WGO 1 1"


def test_lines_of_points_are_never_longer_than_the_limit_and_lose_nothing():
    rng = np.random.default_rng(7)
    texts = VOLTS.texts(rng.uniform(0.0, 110.0, 3000))
    for limit in (60, 256, 1024):
        lines = point_lines(2, texts, limit)
        assert max(map(len, lines)) <= limit
        assert min(map(len, lines[:-1])) > limit - 15  # and well filled
        words = [line.split() for line in lines]
        assert [w for line in words for w in line[6:]] == texts
        assert all(len(line) == int(line[5]) + 6 for line in words)
        assert [line[2] for line in words] == ["X"] + ["&"] * (len(lines) - 1)
        starts = np.cumsum([1] + [int(line[5]) for line in words[:-1]])
        assert [int(line[4]) for line in words] == starts.tolist()


def test_an_offset_of_an_earlier_user_is_taken_away():
    controller, script = opened(ScriptedController(commands=COMMANDS + " WOS"))
    controller.waves.load(wave(x=[0.0, 1.0], y=[0.0, 0.5]))
    assert "WOS 1 0 2 0" in script.log


def test_a_waveform_that_begins_elsewhere_is_not_started():
    controller, script = opened()
    controller.axes["x"].set_voltage(40.0)
    controller.waves.load(wave(x=[0.0, 1.0, 2.0]))
    script.log.clear()
    with pytest.raises(LimitError, match="axis 'x' is at 40 V and the waveform starts at 0 V"):
        controller.waves.start()
    assert moved(script.log) == []


def test_a_waveform_that_jumps_when_it_is_repeated_runs_once_only():
    controller, script = opened()
    controller.waves.load(wave(x=np.linspace(0.0, 60.0, 80)))
    with pytest.raises(LimitError, match="step by -60 V"):
        controller.waves.start(2)
    with pytest.raises(LimitError, match="step by -60 V"):
        controller.waves.start(0)
    assert moved(script.log) == []
    controller.waves.start(1)
    assert moved(script.log) == ["WGO 1 1"]


def test_a_waveform_needs_control_as_its_quantity_needs_it():
    controller, script = opened()
    controller.waves.load(wave("position", x=[10e-6, 11e-6]))
    with pytest.raises(ControllerError, match="switch the control on first"):
        controller.waves.start()
    controller.waves.load(wave(x=[0.0, 1.0]))
    controller.axes["x"].set_closed_loop(True)
    script.log.clear()
    with pytest.raises(ControllerError, match="switch the control off first"):
        controller.waves.start()
    assert moved(script.log) == []


def test_nothing_is_started_that_was_not_loaded():
    controller, script = opened()
    with pytest.raises(ControllerError, match="load one before"):
        controller.waves.start()
    assert script.log == []


def test_a_feedforward_needs_a_table_that_the_controller_lists():
    controller, script = opened()
    shape = wave("position", x=[10e-6, 10e-6])
    with pytest.raises(ModelError, match="cannot add voltages under position control"):
        controller.waves.load(shape, feedforward=wave(x=[3.0, 4.0]))
    assert script.log == []


# records --------------------------------------------------------------------------------------

SIGNALS = (
    Signal(kind="position", source="y", name="motion"),
    Signal(kind="voltage", source="x", name="drive", unit="V"),
)


def test_a_record_from_its_choice_to_its_samples():
    controller, script = opened(transfer=TransferLimits(rows=20))
    rate = controller.recorder.configure(SIGNALS, 3.9e3, 50)
    assert rate == pytest.approx(4e3)
    controller.recorder.arm()
    assert controller.recorder.available() == 0
    controller.waves.load(wave(x=[0.0, 1.0]))
    controller.waves.start()
    assert controller.recorder.available() == 50
    record = controller.recorder.read(5, 45)
    told = [line for line in without_checks(script.log) if line[0] in "DR"]
    assert told == [
        "DRC 1 2 2", "DRC 2 1 7", "DRC 3 0 0", "RTR 5", "DRT 0 1 0", "RTR?",
        "DRL? 1 2", "DRR? 6 20 1 2", "DRR? 26 20 1 2", "DRR? 46 5 1 2",
    ]  # fmt: skip
    k = np.arange(5, 50)
    np.testing.assert_allclose(record.time, k / 4e3, rtol=1e-12)
    # the script records t + k/1000, k from 1: micrometres in one column, volts in the other
    np.testing.assert_allclose(record.channel("motion").values, (1 + (k + 1) / 1e3) * 1e-6)
    np.testing.assert_allclose(record.channel("drive").values, 2 + (k + 1) / 1e3)
    assert [c.unit for c in record.channels] == ["m", "V"]


def test_a_record_that_is_started_by_itself():
    controller, script = opened()
    controller.recorder.configure(SIGNALS, 20e3, 50)
    script.recorded = 37  # of somebody else
    assert controller.recorder.available() == 0
    controller.recorder.start()
    assert "DRT 0 4 0" in script.log
    assert controller.recorder.available() == 50


@pytest.mark.parametrize(
    ("kind", "source", "told"),
    [
        ("target", "x", "DRC 1 1 1"),
        ("position", "x", "DRC 1 1 2"),
        ("channel", "4", "DRC 1 4 20"),
    ],
)
def test_signals_become_options_by_what_these_are_called(kind, source, told):
    controller, script = opened()
    controller.recorder.configure([Signal(kind=kind, source=source, name="q")], 20e3, 10)
    assert script.log[0] == told


@pytest.mark.parametrize(
    ("signal", "sentence"),
    [
        (Signal(kind="force", source="x", name="f", unit="N"), "cannot record the kind 'force'"),
        (Signal(kind="position", source="z", name="p"), "no axis 'z' to record"),
        (Signal(kind="channel", source="5", name="c"), "no sensor '5' to record"),
        (Signal(kind="channel", source="x", name="c"), "no sensor 'x' to record"),
        (Signal(kind="voltage", source="x", name="u", unit="mV"), "is recorded in V"),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_anything_is_sent(signal, sentence):
    controller, script = opened()
    with pytest.raises(ModelError, match=sentence):
        controller.recorder.configure([SIGNALS[0], signal], 20e3, 10)
    assert script.log == []


@pytest.mark.parametrize(
    ("signals", "rate", "samples", "kind"),
    [
        (SIGNALS * 2, 1e3, 10, LimitError),
        ((), 1e3, 10, LimitError),
        (SIGNALS, 1e3, 2001, LimitError),
        (SIGNALS, 1e3, 1, LimitError),
        (SIGNALS, 0.0, 10, ModelError),
        (SIGNALS, np.nan, 10, ModelError),
    ],
)
def test_a_record_that_does_not_fit_is_refused_before_anything_is_sent(
    signals, rate, samples, kind
):
    controller, script = opened()
    with pytest.raises(kind):
        controller.recorder.configure(signals, rate, samples)
    assert script.log == []


def test_a_record_has_only_the_samples_that_were_asked_for():
    controller, _ = opened()
    controller.recorder.configure(SIGNALS, 20e3, 30)
    controller.recorder.start()
    for first, count in ((0, 31), (29, 2), (-1, 5), (3, 1)):
        with pytest.raises(ModelError, match="samples 0 to 29"):
            controller.recorder.read(first, count)


# settings of control --------------------------------------------------------------------------

TUNED = {
    0x07000300: ("Servo Loop P-Term [V/um]", "0.5"),
    0x07000301: ("Servo Loop I-Term [V/(um s)]", "1500"),
    0x08000100: ("Notch Frequency 1 [Hz], 0 for none", "800"),
    0x08000101: ("Notch Frequency 2 [Hz], 0 for none", "0"),
    0x08000200: ("Notch Rejection 1: gain at the frequency", "0.025"),
    0x08000201: ("Notch Rejection 2: gain at the frequency", "0.1"),
    0x08000300: ("Notch Bandwidth 1: twice the damping ratio of the poles", "0.8"),
    0x08000301: ("Notch Bandwidth 2: twice the damping ratio of the poles", "1"),
    0x7F000010: ("Servo Loop Low-Pass Frequency [Hz], 0 for none", "0"),
}


def tuned_script() -> ScriptedController:
    script = ScriptedController()
    script.parameters |= {k: (n, dict.fromkeys("123", v)) for k, (n, v) in TUNED.items()}
    return script


def test_settings_of_control_are_read_in_si():
    controller, _ = opened(tuned_script())
    assert Capability.SERVO_TUNING in controller.axes["x"].capabilities
    read = controller.axes["x"].servo()
    assert read.proportional == pytest.approx(0.5e6)
    assert read.integral == pytest.approx(1.5e9)
    assert read.lowpass_hz is None
    # bandwidth 0.8: poles damped by 0.4; gain 0.025 at the notch: zeros by 0.01
    (notch,) = read.notches
    assert (notch.frequency_hz, notch.pole_damping) == (800.0, 0.4)
    assert notch.zero_damping == pytest.approx(0.01)


SETTINGS = ServoSettings(
    proportional=0.25e6,
    integral=1.25e9,
    notches=(
        Notch(frequency_hz=911.0, zero_damping=0.02, pole_damping=0.4),
        Notch(frequency_hz=1405.5, zero_damping=0.0, pole_damping=0.3),
    ),
    lowpass_hz=2.2e3,
)


@pytest.mark.parametrize("limit", [120, 256, 4000])
def test_settings_of_control_that_were_written_are_read_again(limit):
    controller, script = opened(tuned_script(), transfer=TransferLimits(line_limit=limit))
    axis = controller.axes["y"]
    axis.set_servo(SETTINGS)
    read = axis.servo()
    assert read.proportional == pytest.approx(SETTINGS.proportional, rel=1e-8)
    assert read.integral == pytest.approx(SETTINGS.integral, rel=1e-8)
    assert read.lowpass_hz == SETTINGS.lowpass_hz
    for a, b in zip(read.notches, SETTINGS.notches, strict=True):
        assert a.frequency_hz == b.frequency_hz
        assert (a.zero_damping, a.pole_damping) == pytest.approx((b.zero_damping, b.pole_damping))
    assert max(len(line) for line in script.log) <= limit
    assert script.parameters[0x07000301][1]["1"] == "1500"  # the other axis is as it was


def test_settings_in_several_lines_begin_with_gains_of_zero_and_end_with_the_gains():
    controller, script = opened(tuned_script(), transfer=TransferLimits(line_limit=120))
    controller.axes["x"].set_servo(SETTINGS)
    lines = [line for line in script.log if line.startswith("SPA ")]
    assert len(lines) > 3
    assert lines[0] == "SPA 1 0x07000300 0 1 0x07000301 0"
    assert lines[-1] == "SPA 1 0x07000300 0.25 1 0x07000301 1250"


def test_more_notches_than_the_controller_has_are_refused():
    controller, script = opened(tuned_script())
    notch = Notch(frequency_hz=500.0)
    with pytest.raises(ModelError, match="3 notches, and the controller has 2"):
        controller.axes["x"].set_servo(ServoSettings(notches=(notch,) * 3))
    assert script.log == []


def test_what_was_set_is_told_without_asking():
    controller, script = opened()
    controller.axes["x"].set_closed_loop(True)
    controller.recorder.configure(SIGNALS, 1e3, 20)
    script.log.clear()
    told = controller.settings()
    assert script.log == []
    assert told["controller"] == script.identity
    assert told["axes"] == "x=1, y=2"
    assert told["position control of axis 1"] == "on"
    assert told["record rate divider"] == "20"
