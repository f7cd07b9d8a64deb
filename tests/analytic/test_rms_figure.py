"""The rms of an environment as a figure of many stages, against exponents and the budget.

A white force on a platform of mass m leaves F/(m (8 zeta omega^3)^(1/2)) at every mode: so does it
fall as one over the thickness of the plate, as E^(-3/4) and as the density to -1/4.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.control.dynamic_budget import dynamic_budget
from flexstage.lumped import assemble_batch, lumped_system, stage_arrays
from flexstage.quantities.table import Table
from flexstage.report.study import study_section
from flexstage.report.tables import rms_unit
from flexstage.stage.designs import StageTemplate, design
from flexstage.studies import run_study
from flexstage.studies.explore.family import Family, evaluate, jacobian, known_figures
from flexstage.studies.explore.figures import Figure, figures_of
from flexstage.studies.explore.manufactured_samples import process_of, sample_figures
from flexstage.studies.explore.optimise.optimum import Optimum
from flexstage.studies.explore.prepare import ready_optimise, ready_sweep, ready_tolerance
from flexstage.studies.explore.requests import OptimiseRequest, SweepRequest, ToleranceRequest
from flexstage.studies.explore.tolerance import MonteCarloSamples, tolerance, with_necks
from flexstage.studies.explore.variables import variables_of
from flexstage.studies.explore.workers import Workers
from flexstage.studies.models import open_budget
from flexstage.studies.requests import StudyRequest
from flexstage.studies.results import results_json
from flexstage.studies.study import environment_of
from flexstage.system.batch import sample_systems
from flexstage.system.environment import (
    Environment,
    Point,
    environment_from_text,
)
from flexstage.virtual.imperfections import Scatter
from tests.result_schema import require_valid

RMS = Figure(quantity="rms_displacement", axis="x")
FORCE = """
environment: 1
name: sound
band: [0.1 Hz, 20 kHz]
sources:
  air: {kind: force, body: platform, along: x, spectrum: {kind: white, level: 2 uN/√Hz, sided: one}}
"""
PIEZO = design("vgtu-piezo")
LABORATORY = environment_from_text("""
environment: 1
name: laboratory
band: [0.1 Hz, 5 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: vc, curve: C, slope_above: -5}}
  turning: {kind: ground, along: rotation, spectrum: {kind: white, level: 1 nrad/s/√Hz, sided: one}}
  sensor: {kind: sensor, spectrum: {kind: white, level: 0.02 nm/rtHz, sided: one, corner: 5 Hz}}
  x: {kind: voltage, drive: x, spectrum: {kind: lowpass, rms: 1 mV, bandwidth: 1 kHz}}
  y: {kind: voltage, drive: y, spectrum: {kind: quantiser, step: 2.29 mV, rate: 10 kHz}}
""")

SENSOR = tuple(s for s in LABORATORY.sources if s.name == "sensor")
SHAKEN = environment_from_text("""
environment: 1
name: floor
band: [1 Hz, 1 kHz]
sources:
  floor: {kind: ground, along: x, spectrum: {kind: white, level: 1 um/s^2/rtHz, sided: one}}
""")


@pytest.fixture(scope="module")
def guide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A parallelogram that a pure force moves, its thickness a parameter."""
    text = (Path(__file__).parents[1] / "spelled_out_parallelogram.yaml").read_text("utf-8")
    text = text.replace("thickness: 10 mm", "thickness: = b\nparameters: {b: 10 mm}")
    text = re.sub(r"    extra_masses:\n.*\n", "", text)
    text = text.replace("kind: piezo", "kind: force\n    largest_force: 20 N")
    text = re.sub(r"    (free_stroke|stiffness|voltage_range): .*\n", "", text)
    folder = tmp_path_factory.mktemp("guide")
    (folder / "sound.yaml").write_text(FORCE, "utf-8")
    (folder / "guide.yaml").write_text(text, "utf-8")
    return folder / "guide.yaml"


def rms_of(stage: object, made: Environment, axis: str = "x") -> float:
    return dynamic_budget(stage, lumped_system(stage), made, axis=axis).budget().total


def test_sweep_and_its_derivative_by_the_thickness_of_the_plate(guide: Path) -> None:
    template = StageTemplate.of(guide)
    family = Family(
        template=template,
        variables=variables_of(template, ["b=6..14 mm"]),
        environment=environment_from_text(FORCE),
    )
    thickness = np.array([6e-3, 10e-3, 14e-3])
    values = evaluate(family, thickness[:, None], [RMS]).values[:, 0]
    assert values == pytest.approx(values[1] * 10e-3 / thickness, rel=1e-9)
    assert values[1] == pytest.approx(rms_of(template.stage(), family.environment), rel=1e-9)
    _, slope = jacobian(family, thickness[1:2], [RMS])
    assert slope[0, 0] == pytest.approx(-values[1] / 10e-3, rel=1e-4)
    # a sweep of the command, with a note on what the rms holds for
    request = SweepRequest(over=("b=6..14 mm/3",), environment=guide.with_name("sound.yaml"))
    swept = ready_sweep(request, template)()
    column = [figure.name for figure in swept.figures].index("rms_displacement.x")
    assert swept.values[:, column] == pytest.approx(values, rel=1e-9)
    assert any("'sound' from 0.1 to 20000 Hz, without position control" in n for n in swept.notes)


def test_lightest_plate_of_a_required_rms(guide: Path) -> None:
    template = StageTemplate.of(guide)
    described = rms_of(template.stage(), environment_from_text(FORCE))
    request = OptimiseRequest(
        minimise=("mass",),
        keep=(f"rms <= {1.25e9 * described!r} nm",),
        over=("b=6..14 mm",),
        without=("stroke", "safety_factor", "check"),
        environment=guide.with_name("sound.yaml"),
        model="lumped",
        evaluations=40,
    )
    best = ready_optimise(request, template)(Workers(1))
    assert isinstance(best, Optimum)
    assert best.met
    # rounded to 0.001 mm
    assert best.stage.thickness == pytest.approx(8e-3, abs=2e-6)
    assert any("'sound'" in note for note in best.problem.notes)


def test_samples_have_the_exponents_of_modulus_density_and_thickness(guide: Path) -> None:
    stage, scatter = StageTemplate.of(guide).stage(), Scatter()
    sizes = {"modulus": scatter.modulus, "density": scatter.density}
    sizes["thickness"] = scatter.thickness / stage.thickness
    process = process_of(stage, scatter, environment_from_text(FORCE))
    numbers = {kind: np.zeros((4, 1, 1)) for kind in sizes}
    for k, kind in enumerate(sizes):
        numbers[kind][k + 1] = 3.0
    values = sample_figures(process, numbers, 4, [RMS])[0][:, 0]
    powers = {"modulus": -0.75, "density": -0.25, "thickness": -1.0}
    expected = [1.0, *((1.0 + 3.0 * size) ** powers[kind] for kind, size in sizes.items())]
    assert values / values[0] == pytest.approx(expected, rel=1e-5)


def test_a_sample_is_a_stage_with_its_budget() -> None:
    offset = 8e-6
    # notches of drawn radius have tables of one variable
    scatter = Scatter(neck_common=offset, radius=0.0, stroke=0.05)
    process = process_of(PIEZO, scatter, LABORATORY)
    figures = [RMS, replace(RMS, axis="y")]
    values, _ = sample_figures(process, {"neck_common": np.array([[[0.0]], [[1.0]]])}, 2, figures)
    for k, stage in enumerate((PIEZO, with_necks(PIEZO, offset))):
        budgets = [rms_of(stage, LABORATORY, axis) for axis in "xy"]
        # centres of bodies are nominal, which a rotation of the ground notices
        assert values[k] == pytest.approx(budgets, rel=(1e-6, 1e-5)[k])
    # noise of a voltage acts by the stroke of its stack
    alone = replace(LABORATORY, sources=LABORATORY.sources[-2:])
    process = replace(process, environment=alone)
    longer = np.array([[[0.0], [0.0]], [[1.0], [1.0]]])
    values, _ = sample_figures(process, {"stroke": longer}, 2, figures)
    assert values[1] / values[0] == pytest.approx([1.05, 1.05], rel=1e-9)


def test_systems_of_a_batch_are_those_of_its_stages() -> None:
    template = StageTemplate.of("vgtu-piezo")
    other = template.stage({"thickness": 7e-3, "x.lever_arm_input": 8e-3})
    moved = (replace(p, at=(p.at[0] + 1e-3, p.at[1] + 2e-3)) for p in other.probes)
    other = replace(other, probes=tuple(moved))
    batch = assemble_batch(stage_arrays([PIEZO, other]))
    for system, stage in zip(sample_systems(batch), (PIEZO, other), strict=True):
        single = lumped_system(stage)
        for name in ("M", "K"):
            matrix = getattr(single, name)
            assert np.abs(getattr(system, name) - matrix).max() < 1e-9 * np.abs(matrix).max()
        for ports in ("drives", "probes"):
            for port, expected in zip(getattr(system, ports), getattr(single, ports), strict=True):
                assert port.vector == pytest.approx(expected.vector, abs=1e-12)
        assert [d.stroke for d in system.drives] == [d.stroke for d in single.drives]
        for direction in ("x", "y"):
            assert system.base_force(direction, "in place") == pytest.approx(
                single.base_force(direction, "in place"), abs=1e-12
            )


def test_yield_of_a_required_rms(guide: Path) -> None:
    stage = StageTemplate.of(guide).stage()
    described = rms_of(stage, environment_from_text(FORCE))
    request = ToleranceRequest(
        samples=400,
        scatter=("*=0", "thickness=0.1 mm"),
        of=("rms",),
        require=(f"rms <= {1e9 * described!r} nm",),
        environment=guide.with_name("sound.yaml"),
        model="lumped",
    )
    study = ready_tolerance(request, stage)(Workers(1), None)
    # the relative scatter of the thickness is that of the rms, and half of the plates are thicker
    assert study.spreads[0].standard_deviation / described == pytest.approx(0.01, rel=0.1)
    assert study.yields[0].share == pytest.approx(0.5, abs=0.1)
    assert any("'sound'" in note for note in study.notes)


def test_scatter_of_an_rms_that_symmetry_leaves_at_zero() -> None:
    """A model that corrects it by the ratio of two roundings would multiply all samples."""
    stage = design("three-rrr")
    figures = [RMS, Figure(quantity="rms_rotation", axis="theta")]
    study = tolerance(stage, figures=figures, samples=20, environment=SHAKEN)
    along, about = (spread.mean for spread in study.spreads)
    # the floor shakes the platform along x; only scattered necks turn it, by less than its width
    assert 0.0 < 0.1 * about < along


def test_an_rms_that_an_offset_corrects_is_not_negative() -> None:
    samples = MonteCarloSamples(
        process=process_of(design("parallelogram"), Scatter()),
        seed=0,
        figures=(RMS, Figure(quantity="cross_coupling", axis="x")),
        factor=np.ones(2),
        added=np.array([-3.0, -3.0]),
        per_neck=np.zeros(2),
    )
    assert samples.corrected(np.array([[2.0, 2.0], [4.0, 4.0]])).tolist() == [[0, -1], [1, 1]]


def test_rms_belongs_to_every_axis_or_point_and_needs_an_environment() -> None:
    three = design("three-rrr")
    names = [figure.name for figure in figures_of(["rms"], known_figures(three, SHAKEN))]
    assert names == ["rms_displacement.x", "rms_displacement.y", "rms_rotation.theta"]
    # noise of a sensor in metres does nothing to an axis that turns, without control
    turned = replace(three, axes=three.axes[::-1])
    still = open_budget(turned, lumped_system(turned), replace(LABORATORY, sources=SENSOR))
    assert [(b.point, b.total) for b in still.budgets] == [("theta", 0.0), ("y", 0.0), ("x", 0.0)]
    with pytest.raises(ModelError, match="sensor of axis 'theta' reads rad"):
        dynamic_budget(turned, lumped_system(turned), LABORATORY, ["100 Hz"])
    points = replace(SHAKEN, points=(Point(name="tip", probe="x", relative_to="room"),))
    names = [figure.name for figure in figures_of(["rms"], known_figures(three, points))]
    assert names == ["rms_displacement.tip"]
    with pytest.raises(ModelError, match=r"'rms.x' is one of a stage in its surroundings.*--env"):
        figures_of(["rms.x"], known_figures(three))


def test_study_shows_the_rms_of_every_axis_by_source(tmp_path: Path) -> None:
    (tmp_path / "sound.yaml").write_text(FORCE.replace("platform", "PY"), "utf-8")
    study = run_study(PIEZO, model="lumped", environment=tmp_path / "sound.yaml")
    words, *_ = study_section(study, "quiet").content
    assert "The environment 'sound' is the one given. Rms from 0.1 to 20000 Hz" in str(words)
    require_valid(json.loads(results_json(study.to_dict())), "study")
    assert environment_of(PIEZO, StudyRequest.of_models("lumped")) is None
    assert environment_of(replace(PIEZO, name="a" * 300), StudyRequest()) is None
    room = replace(SHAKEN, points=(Point(name="tip", probe="x", relative_to="room"),))
    moved = replace(study, budget=open_budget(PIEZO, lumped_system(PIEZO), room))
    words, *_ = study_section(moved, "quiet").content
    assert "against what each point names" in str(words)
    for name in ("vgtu-piezo", "vgtu-mechanical"):
        stage, request = design(name), StudyRequest()
        environment = environment_of(stage, request)
        assert environment is not None
        budget = open_budget(stage, lumped_system(stage), environment)
        assumed = replace(study, request=request, stage=stage, budget=budget)
        words, rows, *_ = study_section(assumed, "quiet").content
        assert "The environment 'assumed laboratory' is assumed, not measured" in str(words)
        assert isinstance(rows, Table)
        shown = np.array([[float(cell.text) for cell in row[2:]] for row in rows.rows])
        # three digits are shown
        assert np.sqrt(np.sum(shown[:-1] ** 2, axis=0)) == pytest.approx(shown[-1], rel=6e-3)
        for column, axis in enumerate("xy"):
            alone = rms_of(stage, replace(environment, points=()), axis)
            factor, unit = rms_unit(budget.budgets)
            assert shown[-1, column] == pytest.approx(factor * alone, rel=6e-3)
            assert f"[{unit}]" in rows.caption
