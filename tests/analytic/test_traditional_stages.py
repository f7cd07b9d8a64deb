"""Claims against traditional stages: how figures become verdicts, and how the stages are made."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.quantities.table import Section
from flexstage.report import traditional as report
from flexstage.report.page import sections_html
from flexstage.report.traditional import claim_table, drift_table, error_table, other_table
from flexstage.stage.checks import check
from flexstage.stage.designs import design
from flexstage.stage.designs.two_guides import SideBySideXYParameters, side_by_side_xy
from flexstage.stage.designs.vgtu import PredictedRanges
from flexstage.stage.drive import StackActuator, VoiceCoil
from flexstage.studies.guided_axes import (
    direct_actuator,
    guides_on_one_side,
    single_axis_guides,
)
from flexstage.studies.traditional import compare_traditional, conclusions, drift_conclusions
from tests.compared_stages import comparison

TRAVEL = {"x": 64.5e-6, "y": 62.7e-6}


def test_a_reduction_is_of_medians_of_the_worse_axis() -> None:
    found = {r.against: r for r in comparison().reductions()}
    assert found["worse"].reduction == pytest.approx(1.0 - 0.20 / 0.30)
    assert found["like it"].reduction == pytest.approx(1.0 - 0.20 / 0.22)
    assert found["better"].reduction == pytest.approx(1.0 - 0.20 / 0.05)
    # what a catalogue states is an upper limit of straightness
    assert found["crossed rollers (by their maker)"].reduction == pytest.approx(0.8)
    assert [r.against for r in found.values() if r.holds] == [
        "worse",
        "lame",
        "crossed rollers (by their maker)",
    ]


def test_the_share_counts_pairs_of_stages() -> None:
    found = {r.against: r for r in comparison().reductions()}
    assert found["worse"].share == 1.0
    assert found["better"].share == 0.0
    own, other = 0.20 * np.linspace(0.9, 1.1, 41), 0.22 * np.linspace(0.9, 1.1, 41)
    pairs = sum(a <= 0.83 * b for a in own for b in other)
    assert found["like it"].share == pytest.approx(pairs / 41**2)
    assert 0.0 < found["like it"].share < 0.5


def test_yaw_is_compared_with_what_has_one() -> None:
    rows = comparison().reductions("yaw")
    assert [r.against for r in rows] == ["worse", "like it", "better", "lame"]
    assert [r.reduction for r in rows] == pytest.approx(4 * [0.0])


def test_sentences_say_what_the_figures_say() -> None:
    text = " ".join(conclusions(comparison()))
    for words in (
        "over its stroke is predicted to be 0.200 µm (published, measured: 0.21 µm)",
        "Rigid bodies contribute 0.140 µm and elastic ones 0.060 µm",
        "17 % less transverse motion than a traditional stage holds against worse (33 % less) and "
        "lame (78 % less",
        "does not hold against like it (9 % less) and better (4.0 times as much)",
        "For straightness the claim holds against",
        "legs of at most 8.2 mm between the necks",
        "legs of the stage have 12 and 14 mm",
        "imply a transverse motion of 0.25 µm",
    ):
        assert words in text
    # a limit that a maker gives is no prediction
    assert "by their maker" not in text
    # without a path of finite elements nothing is known of its straightness
    assert "For straightness" not in " ".join(conclusions(comparison(finite_elements=False)))


def test_the_worse_axis_is_worse_by_its_median() -> None:
    found = comparison()
    x, y = found.stage.axes["x"], found.stage.axes["y"]
    rare = replace(x, across=np.where(np.arange(x.across.size) < 36, x.across, 9e-7))
    changed = replace(found, stage=replace(found.stage, axes={"x": rare, "y": y}))
    assert "Rigid bodies contribute 0.140 µm" in " ".join(conclusions(changed))


def test_the_longest_leg_has_the_arc_that_the_claim_asks_for() -> None:
    found = comparison()
    assert (63e-6) ** 2 / (2.0 * found.longest_leg) * (1.0 - 0.17) == pytest.approx(0.20e-6)
    assert found.implied == pytest.approx(0.21e-6 / 0.83)


def test_drift_is_set_against_the_stage_without_symmetry_and_the_others() -> None:
    one, other = drift_conclusions(comparison())
    assert "is 1500 nm instead of 2000 nm for a uniform kelvin" in one
    assert "Symmetry reduces the drift by a uniform change by 25 %" in one
    worse = replace(comparison(), asymmetric=comparison().others[1])
    assert "Symmetry increases the drift by a uniform change by 50 %" in drift_conclusions(worse)[0]
    assert other == (
        "Its drift for a uniform kelvin is smaller than that of worse and better and larger than "
        "that of like it."
    )


def test_tables_hold_every_stage_and_every_axis() -> None:
    found = comparison()
    assert len(claim_table(found).rows) == 5
    assert len(error_table(found).rows) == 10
    assert len(other_table(found).rows) == len(drift_table(found).rows) == 5
    words = {row[0].text: [cell.text for cell in row] for row in claim_table(found).rows}
    assert words["worse"][1:] == [*("predicted", "0.300", "0.67", "0.67", "1.0", "yes", "100 %")]
    assert words["crossed rollers (by their maker)"][1:] == ["given", "1.00 at most", *5 * ["–"]]
    assert [row.kind for row in found.reductions()] == [*4 * ["predicted"], "given"]
    differ = [cell.text for cell in other_table(found).rows[0]]
    assert differ[3] == f"{100.0 * 220.0 / 420.0:.0f}"
    page = sections_html(Section(title="T", content=(claim_table(found), error_table(found))))
    assert "straight" in page


def test_an_actuator_that_is_longer_has_the_same_strain_and_section() -> None:
    stack = StackActuator(free_stroke=38e-6, stiffness=43e6)
    longer, length = direct_actuator(stack, 36e-3, 95e-6)
    assert isinstance(longer, StackActuator)
    assert longer.free_stroke / length == pytest.approx(38e-6 / 36e-3)
    assert longer.stiffness * length == pytest.approx(43e6 * 36e-3)
    with pytest.raises(ModelError, match="kind 'force' has no adjustable stroke"):
        direct_actuator(VoiceCoil(largest_force=1.0), 1e-3, 1e-6)


def test_traditional_guides_have_the_legs_of_the_stage() -> None:
    stage = design("vgtu-piezo")
    guides = single_axis_guides(stage, "parallelogram", TRAVEL)
    made = side_by_side_xy(
        SideBySideXYParameters(
            x=guides["x"], y=guides["y"], thickness=stage.thickness, material=stage.material
        )
    )
    assert [issue for issue in check(made) if issue.severity == "error"] == []
    for axis in "xy":
        here, there = stage.hinge(f"{axis}gp0-u"), made.hinge(f"{axis}-left-upper")
        assert here.profile == there.profile
        spacing = math.dist(here.at, stage.hinge(f"{axis}gp1-u").at)
        assert math.dist(there.at, made.hinge(f"{axis}-right-upper").at) == pytest.approx(spacing)
        length = math.dist(here.at, stage.hinge(f"{axis}gg0-u").at)
        assert math.dist(there.at, made.hinge(f"{axis}-left-lower").at) == pytest.approx(length)
        assert made.drive(axis).stroke == pytest.approx(TRAVEL[axis])


def test_a_stage_with_guides_on_one_side_has_lost_four_legs() -> None:
    stage = design("vgtu-piezo")
    lame = guides_on_one_side(stage)
    gone = {b.name for b in stage.bodies} - {b.name for b in lame.bodies}
    assert gone == {"xG0d", "xG1d", "yG0d", "yG1d"}
    assert len(stage.hinges) - len(lame.hinges) == 8
    assert lame.published == ()


def test_a_stage_of_which_nothing_is_claimed_is_refused() -> None:
    with pytest.raises(ModelError, match="no claim on the motion errors of 'parallelo"):
        compare_traditional(design("parallelogram"))


def test_ranges_that_are_not_known_are_left_out(monkeypatch):
    axes = [SimpleNamespace(axis="x"), SimpleNamespace(axis="y")]
    characteristics = SimpleNamespace(value=lambda *_: 50e-6)
    main = SimpleNamespace(axes=axes, characteristics=characteristics)
    study = SimpleNamespace(stage=None, main=main)

    def said(values: dict[tuple[str, str], tuple[float, float]]) -> list[str]:
        ranges = PredictedRanges(values=values, source="Source.")
        monkeypatch.setattr(report, "predicted_ranges", lambda _: ranges)
        return [*report._ranges_of_motion(study), *report._ranges_of_drift(study)]

    # 0.2 and 0.4 % of 50 um
    motion, drift = said(
        {("cross_coupling", "x"): (2e-3, 4e-3), ("thermal_drift", "y"): (1e-9, 3e-9)}
    )
    assert "Without manufacture, motion across is 0.100 to 0.200 µm in x, at 95 %" in motion
    assert "drift at the probes is 1.00 to 3.00 nm/K in y. Source." in drift
    (turned,) = said({("parasitic_rotation", axis): (1e-6, 2e-6) for axis in "xy"})
    assert (
        "Without manufacture, rotation is 1.00 to 2.00 µrad in x and 1.00 to 2.00 µrad in y, "
        in turned
    )
    assert said({("mass", "stage"): (1.0, 2.0)}) == []
