"""Axes that several drives move, and probes of rotation: the description, and every model of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, ModelError, StageError
from flexstage.experiments.axis_limits import axis_setting
from flexstage.export import stage_diagram
from flexstage.export.drawing.sheet import drawing_svg
from flexstage.fem import MeshSettings, plane_model, superelement_model
from flexstage.lumped import lumped_system, mechanism, nonlinear, stroke_path, symbolic_model
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.drawn_stage import draw_bench
from flexstage.stage import Axis, Probe, Stage, check, stage_from_text, stage_to_text
from flexstage.stage.designs import design
from flexstage.stage.limits import stage_limits
from flexstage.system import static_displacements
from flexstage.virtual import virtual_stage
from tests.hinged_bars import hinged_bars
from tests.parallel_stage import three_legs


def test_a_file_of_an_axis_with_several_drives_reads_back():
    stage = three_legs()
    assert check(stage) == ()
    text = stage_to_text(stage)
    assert "drives:" in text
    assert "reads: rotation" in text
    assert stage_from_text(text) == stage
    assert stage.axis("theta").moved_by == ("a", "b", "c")


def test_one_drive_is_said_one_way():
    """An axis of one drive is the same however it is written, and its file is as before."""
    axis = Axis(name="x", drives=("a",), probe="p")
    assert axis == Axis(name="x", drive="a", probe="p")
    assert axis.moved_by == ("a",)
    text = stage_to_text(design("parallelogram"))
    assert "drives:\n  x:" in text
    assert "drive: x" in text
    assert "reads" not in text


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Axis(name="x", probe="p"), "must name its drives.* got none"),
        (lambda: Axis(name="x", drive="a", drives=("b", "c"), probe="p"), "got both"),
        (lambda: Axis(name="x", drives=("b", "c", "b"), probe="p"), "names a drive twice"),
        (lambda: Probe(name="p", body="b", at=(0.0, 0.0)), "its direction is missing"),
        (
            lambda: Probe(name="p", body="b", at=(0.0, 0.0), direction=1.0, reads="rotation"),
            "remove its direction",
        ),
        (lambda: three_legs(drives=("a", "b", "d")), "names the drive 'd', which does not exist"),
    ],
)
def test_what_a_description_refuses(make: Callable[[], object], said: str):
    with pytest.raises(StageError, match=said):
        make()


@pytest.mark.parametrize(
    "use",
    [
        lambda s: s.drive_of("x"),
        lambda s: stage_limits(s, "y"),
        lambda s: axis_setting(s, "x"),
        lambda s: virtual_stage(s, model="lumped", quiet=True),
        lambda s: stage_diagram(s, axis="x"),
    ],
)
def test_what_needs_one_drive_says_so(use: Callable[[Stage], object]):
    with pytest.raises(FlexstageError, match="by the drives a, b, c together, but this needs"):
        use(three_legs())


def _with_turns(stage: Stage) -> Stage:
    """Add probes of the rotation of a body, alone and against another."""
    at = (16.4e-3, 8.2e-3)
    more = (
        Probe(name="turn", body="standing", at=at, reads="rotation"),
        Probe(name="bend", body="standing", at=at, reads="rotation", relative_to="lying"),
    )
    return replace(stage, probes=(*stage.probes, *more))


def test_every_model_reads_the_rotation_of_a_body():
    """Of the lumped model it is a coordinate; of finite elements the mean rotation of the body.

    The two are 4 % apart, as the bars bend; the superelements are the same continuum as the plane
    model and agree with it to the error of the meshes.
    """
    stage = _with_turns(hinged_bars())
    fine = MeshSettings(order=4)
    lumped = lumped_system(stage)
    plane = plane_model(stage, fine).system
    condensed = superelement_model(stage, fine, cache=False).system
    found = {s.model: static_displacements(s, {"push": 3.1e-6}) for s in (lumped, plane, condensed)}
    for state in found.values():
        standing, lying = state.body_motion["standing"][2], state.body_motion["lying"][2]
        assert state.readings["turn"] == pytest.approx(standing, rel=1e-9)
        assert state.readings["bend"] == pytest.approx(standing - lying, rel=1e-9)
    assert lumped.probe("turn").unit == "rad"
    turn = {name: state.readings["turn"] for name, state in found.items()}
    assert turn["lumped"] == pytest.approx(turn["plane"], rel=0.05)
    assert turn["superelement"] == pytest.approx(turn["plane"], rel=2e-4)


def test_symbols_and_finite_rotations_read_it_too():
    stage = _with_turns(hinged_bars())
    symbolic, numeric = symbolic_model(mechanism(stage)), lumped_system(stage)
    for name in ("tip", "turn", "bend"):
        row = symbolic.numbers(symbolic.probe(name).vector)[:, 0]
        assert row == pytest.approx(numeric.probe(name).vector, rel=1e-12, abs=1e-15)
    model, q = nonlinear(mechanism(stage)), np.linspace(0.01, 0.06, 6)
    assert model.reading("bend", q)[2] == pytest.approx(q[5] - q[2])
    with pytest.raises(ModelError, match="reads a rotation, so it has no path"):
        stroke_path(stage, "push", "turn", [1e-6])


def test_a_rotation_is_drawn_as_an_arrow_that_turns():
    """Its arrow goes round the point of the probe, in each drawing of the stage."""
    stage = three_legs()
    at = np.array(stage.probe("turn").at) * 1e3
    for figure in (draw_stage(stage), draw_bench(stage)):
        lines = [np.column_stack(line.get_data()) for line in figure.axes[0].lines]
        reach = [np.hypot(*(line - at).T) for line in lines if len(line) == 55]
        assert len(reach) == 1
        assert np.ptp(reach[0]) < 1e-9 * reach[0][0]
    svg = drawing_svg(_with_turns(hinged_bars())).decode()
    assert "probe turn" in svg
    assert "rotation" in svg


def test_a_diagram_has_the_rotation_with_its_unit():
    stage = _with_turns(hinged_bars())
    stage = replace(stage, drives=(replace(stage.drives[0], voltage_range=(0.0, 120.0)),))
    words = [b.meaning for b in stage_diagram(stage).blocks]
    assert any("rotation at probe bend [rad]" in w for w in words)
    assert any("rotation of probe turn [rad or rad/s]" in w for w in words)
