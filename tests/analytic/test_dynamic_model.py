"""The dynamic model of a stage: of its description, its stacks, its screws."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.hysteresis import (
    BoucWen,
    DriveModel,
    DynamicModel,
    Lag,
    LogCreep,
    Sensor,
    dynamic_model,
    loop_width,
)
from flexstage.hysteresis.stack_models import usual_hysteresis
from flexstage.lumped import lumped_system
from flexstage.stage import PiezoStack
from flexstage.stage.assumptions import LOOP_WIDTH
from flexstage.stage.designs import design
from flexstage.system import frequency_response

_STAGE = design("vgtu-piezo")
_SYSTEM = lumped_system(_STAGE)
_SCREWS = design("vgtu-mechanical")


def _commands(n: int = 1500) -> dict[str, np.ndarray]:
    t = np.arange(n) * 1e-4
    return {
        "x": 61.0 + 55.0 * np.sin(2.0 * np.pi * 11.0 * t) * np.cos(2.0 * np.pi * 3.0 * t),
        "y": 47.0 - 40.0 * np.cos(2.0 * np.pi * 17.0 * t),
    }


def test_a_piezo_stage_answers_as_it_did() -> None:
    """Numbers of an implementation of its own, which stepped every drive apart."""
    model = dynamic_model(
        _STAGE,
        _SYSTEM,
        creep=LogCreep(rate_per_decade=0.017),
        bandwidth=1900.0,
        current=0.2,
        sensors={"x": Sensor(gain=1.01, offset=3e-8, bandwidth_hz=4100.0)},
    )
    found = model.simulate(_commands())
    at = [0, 137, 611, 1499]
    wanted = {
        "x": [34.1852347022605, 59.0753183621679, 31.0347838284591, 58.7162352873114],
        "y": [3.05244796044322, 21.295138414847, 9.27241703505113, 47.2295560134941],
    }
    for name, values in wanted.items():
        assert 1e6 * found.readings[name][at] == pytest.approx(values, rel=1e-11)
    free = [21.1283577451575, 36.6227825408577, 19.1801581106606, 36.3377792900242]
    assert 1e6 * found.free_displacement["x"][at] == pytest.approx(free, rel=1e-12)
    volts = [61.0, 103.993802978579, 41.2389786723852, 102.875995770447]
    assert found.voltage["x"][at] == pytest.approx(volts, rel=1e-12)


def test_samples_one_by_one_give_what_a_sequence_gives() -> None:
    model = dynamic_model(_STAGE, _SYSTEM, creep=LogCreep(rate_per_decade=0.02), bandwidth=2e3)
    commands = _commands(60)
    whole = model.simulate(commands)
    state = model.settled({name: float(u[0]) for name, u in commands.items()})
    for i in range(60):
        found = model.simulate({name: u[i : i + 1] for name, u in commands.items()}, state)
        state = found.state
        for name, value in found.readings.items():
            assert value[0] == pytest.approx(whole.readings[name][i], rel=1e-12, abs=1e-18)
    wanted = whole.state.deflections["x"]
    assert state.deflections["x"] == pytest.approx(wanted, rel=1e-11, abs=1e-17)


@pytest.mark.parametrize("frequency_hz", [37.0, 412.0, 655.0])
def test_an_imposed_displacement_answers_as_in_frequency(frequency_hz: float) -> None:
    system = lumped_system(_SCREWS)
    model = dynamic_model(_SCREWS, system, time_step=2e-5)
    n = 20000
    t = np.arange(n) * model.step
    u = {"x": 1e-4 * np.sin(2.0 * np.pi * frequency_hz * t), "y": np.zeros(n)}
    read = model.simulate(u).readings
    # whole periods after the transient, which is gone by then: the slowest mode falls by e^-18
    late = slice(n - round(round(0.2 * frequency_hz) / frequency_hz / model.step), n)
    turn = np.exp(-2j * np.pi * frequency_hz * t[late])
    for probe in ("x", "y"):
        found = (read[probe][late] @ turn) / (u["x"][late] @ turn)
        exact = frequency_response(system, [frequency_hz], "x", probe, drives="in place").value[0]
        straight = np.sinc(frequency_hz * model.step) ** 2  # what straight lines leave of a sine
        scale = abs(
            frequency_response(system, [frequency_hz], "x", "x", drives="in place").value[0]
        )
        assert abs(found / straight - exact) < 1e-4 * scale


@pytest.mark.parametrize("stage", [_STAGE, _SCREWS])
def test_modes_left_out_are_kept_at_rest(stage) -> None:
    system = lumped_system(stage)
    full = dynamic_model(stage, system, hysteresis="none")
    few = dynamic_model(stage, system, hysteresis="none", keep_modes=7)
    assert few.omega.size == 7
    value = {d.name: 31.0 if d.unit == "V" else 3.1e-5 for d in full.drives}
    at_rest = {name: np.full(3, u) for name, u in value.items()}
    wanted, found = full.simulate(at_rest).readings, few.simulate(at_rest).readings
    for probe in wanted:
        assert found[probe] == pytest.approx(wanted[probe], rel=1e-9, abs=1e-18)
    slow = {name: u * (1.0 - np.cos(np.arange(900) * 2e-3)) for name, u in value.items()}
    wanted, found = full.simulate(slow).readings, few.simulate(slow).readings
    for probe in wanted:
        # 3 Hz is far below the omitted modes
        assert np.abs(found[probe] - wanted[probe]).max() < 1e-5 * np.ptp(wanted[probe])
    assert any("7 of " in n and "modes are included" in n for n in few.notes)


def test_the_usual_hysteresis_has_the_stroke_and_the_width() -> None:
    stack = PiezoStack(
        name="s",
        pushes="a",
        reacts="b",
        at=((0.0, 0.0), (0.01, 0.0)),
        direction=0.0,
        patch_half_width=1e-3,
        free_stroke=23e-6,
        stiffness=3.1e7,
        voltage_range=(-19.0, 131.0),
    )
    model = usual_hysteresis(stack)
    line = np.linspace(-19.0, 131.0, 2000)
    cycle = np.concatenate((line, line[::-1]))
    u = np.concatenate((cycle, cycle, cycle, cycle[:1]))
    y = model.simulate(u).values
    late = slice(cycle.size, None)
    bounds = np.array([0, cycle.size, 2 * cycle.size])
    assert np.ptp(y[late]) == pytest.approx(23e-6, rel=1e-3)
    width = loop_width(u[late], y[late], bounds) / np.ptp(y[late])
    assert width == pytest.approx(LOOP_WIDTH, rel=0.01)
    assert all(c.holds for c in model.properties())


def _identified(**changes) -> DriveModel:
    values = {
        "hysteresis": BoucWen(gain=0.61, hysteresis_gain=0.2, beta=0.04, gamma=0.02),
        "creep": LogCreep(rate_per_decade=0.013),
        "lag": Lag(delay=1e-4),
        "output_unit": "um",
        "offset": 3.0,
    }
    return DriveModel(**(values | changes))


def test_an_identified_drive_reads_at_rest_what_it_was_identified_to() -> None:
    drive = _identified()
    model = dynamic_model(_STAGE, _SYSTEM, hysteresis={"x": drive})
    read = model.simulate({"x": np.full(2, 83.0), "y": np.zeros(2)}).readings
    w = float(drive.hysteresis.simulate([83.0]).values[0]) * drive.creep.static_gain
    assert read["x"][1] == pytest.approx(1e-6 * w, rel=1e-9)
    assert model.drive("x").creep is drive.creep
    assert model.drive("y").hysteresis is None
    assert any("their identified delay" in note for note in model.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"hysteresis": {"z": usual_hysteresis(_STAGE.drives[0])}}, "no piezo stack"),
        ({"hysteresis": {"x": _identified(output_unit="V")}}, "must be from V"),
        ({"hysteresis": {"x": _identified(output_unit="mm")}}, "free stroke"),
        ({"hysteresis": "typical"}, "usual or none"),
        ({"time_step": 0.0}, "must be from 1e-12 to"),
        ({"keep_modes": 0}, "a whole number from 1"),
        ({"current": 0.1}, "bandwidth"),
        ({"sensors": {"q": Sensor()}}, "no probe 'q'"),
    ],
)
def test_what_cannot_be_handed_on_is_refused(change, said) -> None:
    with pytest.raises(ModelError, match=said):
        dynamic_model(_STAGE, _SYSTEM, **change)


def test_commands_and_voltages_that_cannot_be_are_refused() -> None:
    model: DynamicModel = dynamic_model(_STAGE, _SYSTEM)
    with pytest.raises(ModelError, match="same length"):
        model.simulate({"x": [1.0, 2.0], "y": [1.0]})
    for what in (model.settled, model.simulate):
        with pytest.raises(ModelError, match="has no drive 'q'"):
            what({"q": 1.0})
    with pytest.raises(
        ModelError, match=r"is 121 V at sample 1, outside the range of its stack, 0 to 120 V"
    ):
        model.simulate({"x": [3.0, 121.0]})


def test_a_model_without_closed_form_is_stepped_too() -> None:
    stack = BoucWen(gain=3.6e-7, hysteresis_gain=1.3e-7, beta=2.1e4, gamma=1.3e4, exponent=1.9)
    model = dynamic_model(_STAGE, _SYSTEM, hysteresis={"y": stack})
    found = model.simulate({"y": _commands(300)["y"]}).readings
    # of the same equations by an implementation of its own
    at = [2.94563179339735e-06, 5.19952899509783e-06, 3.41920299557422e-05, 4.92760377438686e-05]
    assert found["y"][[0, 44, 181, 299]] == pytest.approx(at, rel=1e-11)
    beside = [0.0, 5.636209205408e-12, 6.0027545362868e-12, -4.21342516059092e-12]
    assert found["x"][[0, 44, 181, 299]] == pytest.approx(beside, abs=1e-16)


def test_notes_speak_of_the_drives_that_there_are() -> None:
    usual, linear = (
        dynamic_model(_STAGE, _SYSTEM),
        dynamic_model(_STAGE, _SYSTEM, hysteresis="none"),
    )
    screws = dynamic_model(_SCREWS, lumped_system(_SCREWS))
    assert any("usual width" in note for note in usual.notes)
    assert any("without hysteresis: x, y" in note for note in linear.notes)
    assert not any("hysteresis of the stacks" in note for note in (*screws.notes, *linear.notes))


def test_what_modes_left_out_add_creeps_too() -> None:
    creep = LogCreep(rate_per_decade=0.04)
    full = dynamic_model(_STAGE, _SYSTEM, creep=creep)
    few = dynamic_model(_STAGE, _SYSTEM, creep=creep, keep_modes=2)
    u = {"x": np.full(2, 71.0), "y": np.full(2, 23.0)}
    wanted, found = full.simulate(u).readings, few.simulate(u).readings
    for probe in wanted:
        # at rest creep has come to its end, in all modes
        assert found[probe] == pytest.approx(wanted[probe], rel=1e-9)


def test_a_reading_that_falls_with_the_command_falls() -> None:
    found = [
        dynamic_model(_STAGE, _SYSTEM, hysteresis={"x": _identified(sign=sign)})
        .simulate({"x": np.full(2, 83.0), "y": np.zeros(2)})
        .readings["x"][1]
        for sign in (1.0, -1.0)
    ]
    assert found[1] == pytest.approx(-found[0], rel=1e-12)


def test_an_amplifier_is_no_faster_than_its_stack_allows() -> None:
    (x, *others) = _STAGE.drives
    slow = replace(_STAGE, drives=(replace(x, largest_slew=3100.0), *others))
    model = dynamic_model(slow, _SYSTEM, bandwidth=9000.0)
    amplifier = model.drive("x").amplifier
    assert amplifier is not None
    assert amplifier.largest_rate == 3100.0
