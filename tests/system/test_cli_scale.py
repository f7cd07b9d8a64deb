"""`flexstage scale` and the settings of `flexstage centre --stage`."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.centring import ARCSEC, exact_error
from flexstage.centring.error_budget import allowed_eccentricity
from flexstage.centring.from_records import centre_records
from flexstage.centring.requests import CentreRequest
from flexstage.centring.table_file import RotaryTable, read_table, table_from_text
from flexstage.cli import main
from flexstage.records import Channel, Record
from flexstage.stage.designs import StageTemplate, design
from flexstage.studies.explore.prepare import problem_of
from flexstage.studies.explore.requests import OptimiseRequest
from flexstage.studies.requests import ScaleRequest
from flexstage.studies.scale import needs_as_constraints, study_scale
from flexstage.studies.settings import RATIO_UNCERTAINTY, move_settings, settings_of
from flexstage.virtual.as_built import loop_share

TABLE = """
table: 1
name: comparator
scale: {radius: 48 mm, eccentricity: 50 um, mass: 250 g, tilt: 20 arcsec}
heads: {angles: [0 deg, 92 deg, 178 deg, 275 deg], noise: 0.1 arcsec, gap_change: 50 um}
axis: {axial: 1 um, speed: 10 rpm}
mounting_angle: 30 deg
space: {diameter: 400 mm, height: 12 mm, hole: 20 mm}
tolerance: {error: 2 arcsec, reading: each, eccentricity: 0.3 um}
"""


def judged(text: str = TABLE, *stages: str):
    study = study_scale(table_from_text(text), ScaleRequest(stage=stages))
    return {stage.name: stage for stage in study.stages}, study


def test_both_study_stages_are_judged_with_reasons() -> None:
    stages, study = judged()
    assert len(stages) >= 6
    # 67.54 um at 38 um of the stack, 50 N/um of it against 5.520 N/um of the stage
    assert "stroke x 60.8 µm, 100 µm needed" in stages["vgtu-piezo"].reason
    assert not stages["vgtu-piezo"].suits
    # by hand: 2 * 50 um; sqrt(2) * half of the allowed eccentricity
    needs = {need.what: need.limit for need in study.needs}
    assert needs["stroke"] == pytest.approx(100e-6)
    assert needs["step"] == pytest.approx(study.allowed / math.sqrt(2.0))
    assert not stages["gantry"].suits
    assert "step x 0.500 µm" in stages["gantry"].reason
    assert not stages["stacked-xy"].suits
    assert "several plates" in stages["stacked-xy"].reason
    assert any("shim of 9.31 µm" in note for note in study.notes)


def test_the_circle_is_about_the_point_that_probes_read() -> None:
    (stage,) = judged(TABLE, "vgtu-mechanical")[0].values()
    values = {need.what: need.value for need in stage.needs}
    described = design("vgtu-mechanical")
    at = next(p.at for p in described.probes if p.body == "PY")
    corners = np.array([p for body in described.bodies for p in body.outline.points])
    farthest = np.hypot(*(corners - at).T).max()
    assert values["circle about the axis"] == pytest.approx(2.0 * farthest, rel=1e-6)
    # the hole of the platform, of 24 mm
    assert values["hole about the axis"] == pytest.approx(24e-3, rel=1e-3)


def test_forces_of_rotation_grow_with_the_square_of_speed() -> None:
    def stiffness(speed: str) -> float:
        text = TABLE.replace("10 rpm", speed)
        (stage,) = judged(text, "vgtu-mechanical")[0].values()
        return next(n.limit for n in stage.needs if n.what == "output stiffness")

    assert stiffness("30 rpm") == pytest.approx(9.0 * stiffness("10 rpm"))


def test_needs_are_constraints_of_an_optimisation(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TABLE)
    request = OptimiseRequest(minimise=("mass",), for_=str(path))
    template = StageTemplate.of("vgtu-mechanical")
    kept = {r.figure.name for r in problem_of(request, template).requirements}
    plain = problem_of(OptimiseRequest(minimise=("mass",)), template)
    new = kept - {r.figure.name for r in plain.requirements}
    assert {"resolution.x", "resolution.y", "thickness"} <= new
    # a stack of 50 N/um that gives way by a tenth
    described = design("vgtu-piezo")
    limits = {
        text.split()[0]: text for _, text in needs_as_constraints(read_table(path), described)
    }
    assert float(limits["input_stiffness.x"].split()[2]) == pytest.approx(50e6 / 9.0)
    assert float(limits["output_displacement.x"].split()[2]) == pytest.approx(100e-6 / 0.9)


def test_settings_move_the_scale_onto_the_axis() -> None:
    stage = design("vgtu-mechanical")
    move, u = np.array([-21e-6, 45e-6]), np.array([1e-8, 1e-8])
    settings = move_settings(stage, move, u, radius=50e-3, target=0.3e-6)
    x, y = settings.drives
    pitch = stage.drive("x").pitch
    # ratios of the study's stage by the lumped model: 0.3301 and 0.3371
    assert x.turns == pytest.approx(-21e-6 / 0.3301 / pitch, rel=1e-3)
    assert y.turns == pytest.approx(45e-6 / 0.3371 / pitch, rel=1e-3)
    assert x.back > -x.turns
    assert y.back == 0.0
    assert x.eccentricity == pytest.approx(45e-6, rel=1e-6)
    assert y.eccentricity < 1e-12
    piezo = move_settings(design("vgtu-piezo"), move, u)
    assert piezo.success == ()
    # 2.128 N/um at the drive compress the stack of 50 N/um
    free = 45e-6 / 1.6938 * (1.0 + 2.128 / 50.0)
    assert piezo.drives[1].voltage == pytest.approx(free / 38e-6 * 120.0, rel=1e-3)
    with pytest.raises(ModelError, match="mount the scale closer to the axis"):
        move_settings(stage, 10.0 * move, u)


def test_success_of_one_move_is_that_of_its_normal_scatter() -> None:
    # equal scatter of both axes: 1 - exp(-t^2 / 2 sigma^2)
    stage = design("bridge-xy")
    move, u, target = np.array([30e-6, 30e-6]), np.array([0.2e-6, 0.2e-6]), 4e-6
    settings = move_settings(stage, move, u, target=target)
    # anywhere within the loop besides
    gain = math.hypot(RATIO_UNCERTAINTY, loop_share(stage, "x", 197e-6) / math.sqrt(12.0))
    variance = (gain * 30e-6) ** 2 + 0.2e-6**2
    assert settings.success[0] == pytest.approx(-math.expm1(-0.5 * target**2 / variance), abs=0.02)
    assert list(settings.success) == sorted(settings.success)
    assert settings.success[-1] > 0.99


def test_the_commands_print_budget_verdict_and_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TABLE)
    with pytest.raises(SystemExit) as ended:
        main(["scale", str(path), "--stage", "vgtu-mechanical", "--json"])
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    assert printed["stages"][0]["suits"]
    eccentric = printed["contributions"][0]
    assert eccentric["each"] / ARCSEC == pytest.approx(206264.806 * 50e-6 / 48e-3, rel=1e-6)
    table = table_from_text(TABLE)
    assert isinstance(table, RotaryTable)
    assert printed["allowed_eccentricity"]["value"] == allowed_eccentricity(table)
    with pytest.raises(SystemExit) as ended:
        main(["scale", str(path), "--stage", "vgtu-piezo"])
    assert ended.value.code == 1
    shown = capsys.readouterr().out
    assert "What the stage needs" in shown
    assert "vgtu-piezo" in shown

    theta = np.arange(720) * np.pi / 360.0
    error = 0.04 / 48.0 * np.sin(theta - 0.4)
    np.savetxt(
        tmp_path / "r.csv", np.degrees([theta, error]).T, delimiter=",", comments="",
        header="angle,error",
    )  # fmt: skip
    path.write_text(TABLE.replace("0 deg, 92 deg, 178 deg, 275 deg", "0 deg"))
    words = ["centre", str(tmp_path / "r.csv"), "--unit", "deg", "--table", str(path)]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--stage", "vgtu-mechanical", "--json"])
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    assert printed["eccentricity"]["value"] == pytest.approx(40e-6, rel=1e-3)
    assert {d["drive"] for d in printed["settings"]["drives"]} == {"x", "y"}
    with pytest.raises(SystemExit) as ended:
        main([*words, "--radius", "48 mm"])
    assert ended.value.code == 2
    assert "--table describes --radius already" in capsys.readouterr().err


def test_settings_follow_the_trial_moves_of_a_mirrored_stage() -> None:
    # the axes carry the scale by (1, 0) and (0, -1): the trial finds it, the angle alone cannot
    theta = 2.0 * np.pi * np.arange(360) / 360
    centre, mount = np.array([20e-6, -10e-6]), np.diag([1.0, -1.0])
    positions = ((0.0, 0.0), (20e-6, 0.0), (0.0, 20e-6), (20e-6, 20e-6))
    records = [
        Record(
            channels=(
                Channel(name="angle", values=theta, unit="rad"),
                Channel(
                    name="error",
                    values=exact_error(theta, centre + mount @ np.array(at), 50e-3),
                    unit="rad",
                ),
            ),
            time=np.arange(360.0),
            over="point",
        )
        for at in positions
    ]
    request = CentreRequest(
        angle="angle", error=("error",), radius=50e-3, kind="disc", stage_at=positions
    )
    settings = settings_of(centre_records(records, request), "vgtu-mechanical")
    pitch = design("vgtu-mechanical").drive("x").pitch
    # from the last position (20, 20) to (-20, -10) um of the axes
    x, y = settings.drives
    assert x.turns == pytest.approx(-40e-6 / 0.3301 / pitch, rel=2e-3)
    assert y.turns == pytest.approx(-30e-6 / 0.3371 / pitch, rel=2e-3)
    alone = settings_of(centre_records(records[:1], replace(request, stage_at=())), "three-rrr")
    assert any("not mirrored" in note for note in alone.notes)
    assert len(alone.drives) == 3
    assert alone.radius == 50e-3


def test_the_error_of_a_ratio_is_the_same_in_every_move() -> None:
    # along one axis, with nothing else: |g|^k e below the target
    stage = design("vgtu-mechanical")
    move, target = np.array([0.0, 45e-6]), 0.3e-6
    settings = move_settings(stage, move, np.zeros(2), target=target)
    for k, share in enumerate(settings.success[:2], start=1):
        within = (target / 45e-6) ** (1.0 / k) / RATIO_UNCERTAINTY
        assert share == pytest.approx(math.erf(within / math.sqrt(2.0)), abs=0.02)
    # in the end anywhere within half a step of each axis, of 0.1604 and 0.1639 um
    fine = move_settings(stage, move, np.zeros(2), target=0.05e-6)
    assert fine.success[-1] == pytest.approx(math.pi * 0.05**2 / (0.1604 * 0.1639), abs=0.02)
    assert not move_settings(stage, np.zeros(2), np.zeros(2)).drives
    with pytest.raises(ModelError, match="the move must be finite"):
        move_settings(stage, np.array([math.nan, 0.0]), np.zeros(2))


def test_the_gap_is_that_of_tilt_and_axial_motion() -> None:
    text = TABLE.replace("{axial: 1 um,", "{axial: 1 um, tilt: 10 arcsec, overhang: 100 mm,")
    text = text.replace("error: 2 arcsec", "error: 60 arcsec")
    # 1 um + 48 mm (2 * 20 + 10 arcsec)
    assert any("changes by 12.6 µm over" in note for note in judged(text)[1].notes)
    drum = judged(text.replace("radius: 48 mm,", "kind: drum, radius: 48 mm,"))[1].notes
    # 2 * 50 um + 100 mm * 10 arcsec
    assert any("changes by 105 µm over" in note and "more than" in note for note in drum)
