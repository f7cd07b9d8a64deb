"""Stacks at work: working lines and electrical supply against closed forms.

Evidence (Stages, tolerances, designs): working line of a stack against the load line of its stage,
with a soft tip and a preload spring: stroke and force 1e-9
"""

import contextlib
import json
import math
from dataclasses import replace

import pytest

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.lumped import lumped_system
from flexstage.report.figures.drives import draw_working_line
from flexstage.report.stacks import stack_section, stack_tables
from flexstage.stage import Stage
from flexstage.stage.designs import design
from flexstage.stage.seat import BallSeat, Preload, TipSeat
from flexstage.stage.stack_supply import ChargeControl, StackSupply
from flexstage.studies import run_study
from flexstage.studies.models import run_model
from flexstage.studies.requests import StackOptions, StudyRequest
from flexstage.studies.stacks import stacks_at_work
from flexstage.system.analysis import analyse
from flexstage.system.seated_drives import WorkingLine, working_lines
from flexstage.system.statics import drive_stiffness

STAGE = design("vgtu-piezo")


def one_stack(**changes: object) -> Stage:
    """Return the piezo stage without its second drive."""
    return replace(
        STAGE,
        drives=(replace(STAGE.drives[0], **changes),),
        axes=tuple(axis for axis in STAGE.axes if axis.drive == "x"),
    )


def command(*words: str) -> None:
    with contextlib.suppress(SystemExit):
        main(["analyse", *words, "--model", "lumped"])


def line_of(stage: Stage) -> WorkingLine:
    return working_lines(stage, lumped_system(stage))[0]


def test_the_stroke_is_that_of_two_springs() -> None:
    stage = one_stack()
    line, drive = line_of(stage), stage.drives[0]
    load = drive_stiffness(lumped_system(stage), "x")
    stroke = drive.free_stroke * drive.stiffness / (drive.stiffness + load)
    assert line.stroke == pytest.approx(stroke, rel=1e-9)
    assert line.force == pytest.approx(load * stroke, rel=1e-9)
    assert line.stage_stiffness == pytest.approx(load, rel=1e-9)
    assert line.force_share == pytest.approx(load * stroke / 1850.0, rel=1e-9)
    assert line.lost_on_seats == 0.0
    assert line.contact_force == line.force


def test_a_tip_and_a_preload_spring_are_in_series_and_parallel() -> None:
    stage = one_stack(
        seats=(TipSeat(axial_stiffness=30e6),), preload=Preload(force=80.0, spring_stiffness=4e6)
    )
    line, drive = line_of(stage), stage.drives[0]
    load = drive_stiffness(lumped_system(one_stack()), "x")
    chain = 1.0 / (1.0 / drive.stiffness + 1.0 / 30e6)
    stroke = drive.free_stroke * chain / (chain + load + 4e6)
    assert line.stroke == pytest.approx(stroke, rel=1e-9)
    assert line.force == pytest.approx((load + 4e6) * stroke, rel=1e-9)
    assert line.stage_stiffness == pytest.approx(load, rel=1e-9)
    assert line.lost_on_seats == pytest.approx(line.force / 30e6, rel=1e-9)
    assert line.contact_force == pytest.approx(line.force + 80.0)


def test_the_blocking_force_is_stiffness_times_stroke_where_not_given() -> None:
    assert line_of(one_stack(blocking_force=None)).drive.blocked_force == pytest.approx(1900.0)
    assert line_of(one_stack()).drive.blocked_force == 1850.0


def test_the_figure_shows_where_the_lines_meet() -> None:
    ball = BallSeat(radius=4e-3, contact_modulus=59.7e9)
    line = line_of(one_stack(seats=(ball,), preload=Preload(force=100.0, spring_stiffness=3e6)))
    (axes,) = draw_working_line(line).axes
    curves = {curve.get_label(): curve.get_xydata() for curve in axes.lines}
    x, y = curves["stack, full voltage"].T
    point = next(c for c in axes.lines if c.get_marker() == "o").get_xydata()[0]
    # the point is on the line of the stack
    assert x[1] * (1.0 - point[1] / y[0]) == pytest.approx(point[0], rel=1e-9)
    way, force = curves["stage and spring, with seats"].T
    assert way[40] == pytest.approx(point[0], rel=1e-9)
    assert force[40] == pytest.approx(line.force)
    assert curves["preload spring"][40, 1] == pytest.approx(3e6 * line.stroke)


SUPPLY = StackSupply(
    capacitance=6.4e-6,
    voltage=100.0,
    rate=50.0,
    voltage_span=120.0,
    largest_current=0.3,
    largest_slew=40e3,
    loss_factor=0.02,
    thermal_resistance=20.0,
)


def test_the_supply_of_a_sine() -> None:
    assert SUPPLY.charge == pytest.approx(640e-6)
    # maxima of u = U/2 sin(2 pi f t)
    assert SUPPLY.slew == pytest.approx(100.0 / 2.0 * 2.0 * math.pi * 50.0)
    assert SUPPLY.peak_current == pytest.approx(SUPPLY.capacitance * SUPPLY.slew)
    assert SUPPLY.mean_current == pytest.approx(0.032)
    effective = 100.0 / (2.0 * math.sqrt(2.0))
    power = 2.0 * math.pi * 50.0 * 6.4e-6 * effective**2
    assert SUPPLY.reactive_power == pytest.approx(power)
    assert SUPPLY.heat == pytest.approx(0.02 * power)
    assert SUPPLY.temperature_rise == pytest.approx(0.4 * power)
    assert replace(SUPPLY, thermal_resistance=None).temperature_rise is None
    assert replace(SUPPLY, loss_factor=None).heat is None


@pytest.mark.parametrize(("rate", "limit"), [(50.0, "voltage"), (200.0, "slew"), (130.0, "slew")])
def test_the_least_limit_counts(rate: float, limit: str) -> None:
    supply = replace(SUPPLY, rate=rate)
    assert supply.limited_by == limit
    weak = replace(supply, largest_current=0.01)
    assert weak.limited_by == "current"
    assert replace(weak, voltage=weak.limits["current"]).peak_current == pytest.approx(0.01)


def test_at_the_largest_rate_one_limit_is_reached() -> None:
    at = replace(SUPPLY, rate=SUPPLY.largest_rate)
    assert at.slew == pytest.approx(40e3)
    assert at.peak_current < 0.3
    weak = replace(SUPPLY, largest_current=0.1)
    assert replace(weak, rate=weak.largest_rate).peak_current == pytest.approx(0.1)


def test_too_much_voltage_is_refused() -> None:
    with pytest.raises(ModelError, match=r"150 V from peak to peak is more than the 120 V"):
        replace(SUPPLY, voltage=150.0)


def test_charge_control_is_voltage_control_below_its_corner() -> None:
    circuit = ChargeControl(capacitance=1e-6, sensing_capacitance=10e-6, leak_resistance=1e6)
    assert circuit.gain == pytest.approx(1e5)
    assert circuit.corner == pytest.approx(1.0 / (2.0 * math.pi))
    assert circuit.loop_width(0.0, 0.12) == pytest.approx(0.12)
    assert circuit.loop_width(1e6, 0.12) == pytest.approx(0.024)
    half = 0.12 * math.sqrt((1.0 + 0.04) / 2.0)
    assert circuit.loop_width(circuit.corner, 0.12) == pytest.approx(half)


def test_the_rate_may_be_that_of_the_axis() -> None:
    analysis = analyse(STAGE, lumped_system(STAGE))
    stacks = stacks_at_work(analysis, StackOptions(rate="natural"))
    rates = [s.supply.rate for s in stacks if s.supply]
    # with the drives in place; a row of it is printed where no frequency was published
    unpublished = replace(STAGE, published=())
    rows = analyse(unpublished, lumped_system(unpublished)).characteristics
    in_place = [r.value for r in rows if r.quantity == "natural_frequency_with_stack_hz"]
    assert rates == pytest.approx(in_place)
    # the capacitance of the amplifier's load replaces that of the stack
    options = StackOptions(rate=50.0, amplifier=replace(StackOptions().amplifier, capacitance=1e-5))
    supply = stacks_at_work(analysis, options)[0].supply
    assert supply is not None
    assert supply.charge == pytest.approx(1.2e-3)
    assert stacks_at_work(analysis, StackOptions()) == ()


def test_without_a_capacitance_there_is_the_working_line_only() -> None:
    run = run_model(one_stack(capacitance=None), "lumped")
    stacks = stacks_at_work(run.analysis, StackOptions(rate=50.0))
    assert stacks[0].supply is None
    assert [t.caption for t in stack_tables(stacks)] == [
        "working line of each stack at full voltage"
    ]


def test_the_command_prints_and_gives_both(capsys, tmp_path, monkeypatch) -> None:
    # diagrams of other figures take the longest
    monkeypatch.setattr("flexstage.report.result_files.bode_files", lambda _: {})
    words = ("vgtu-piezo", "--rate", "50", "--loss-factor", "2%")
    command(*words, "--folder", str(tmp_path))
    printed = capsys.readouterr().out
    assert "working line of each stack at full voltage" in printed
    assert "heat, W" in " ".join(printed.split())
    assert (tmp_path / "working-line-x.svg").exists()
    command(*words, "--json")
    stacks = json.loads(capsys.readouterr().out)["stacks"]
    assert stacks["x"]["working_line"]["stroke"] == pytest.approx(34.22e-6, rel=1e-3)
    assert stacks["y"]["supply"]["mean_current"] == pytest.approx(50.0 * 6.4e-6 * 120.0)
    command("vgtu-piezo")
    assert "working line" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("stage", "rate", "message"),
    [
        ("vgtu-mechanical", "50", "--rate is for piezo stacks"),
        ("vgtu-piezo", "-5", "above 0, or natural"),
        ("vgtu-piezo", "soon", "or natural"),
        ("vgtu-piezo", "50 --voltage -20:100", "must rise within the range 0:120 V of the stack"),
    ],
)
def test_a_rate_that_cannot_be_is_refused(stage: str, rate: str, message: str, capsys) -> None:
    command(stage, "--rate", *rate.split())
    assert message in capsys.readouterr().err


def test_the_report_has_a_section_on_stacks() -> None:
    study = run_study(STAGE, StudyRequest.of_models("lumped"))
    pictures, line, supply, words = stack_section(study)
    assert len(pictures.pictures) == 2
    assert line.caption == "Working line of each stack at full voltage"
    assert len(supply.rows) == 2
    assert "upper bound" in words
    screws = run_study(design("vgtu-mechanical"), StudyRequest.of_models("lumped"))
    assert not list(stack_section(screws))
