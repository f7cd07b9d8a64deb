"""The study's claims of smaller motion errors, by finite elements: what holds, and against what.

The geometry of both stages was found from the published stroke, stress and frequencies alone, so
the motion errors that were measured are no part of it.

Evidence (The two stages of the study): motion across over the stroke (measurement): 24 % [*slow*]
"""

from dataclasses import replace

import pytest

from flexstage.fem import plane_model
from flexstage.fem.stroke import follow_stroke
from flexstage.stage import Stage, mass_properties
from flexstage.stage.designs import design
from flexstage.studies.guided_axes import traditional_axes
from flexstage.studies.traditional import TraditionalComparison, compare_traditional
from flexstage.system import analyse

#: Motion across that was measured over the stroke [m], from the study.
MEASURED = {
    "vgtu-mechanical": {"x": 0.80e-6, "y": 1.12e-6},
    "vgtu-piezo": {"x": 0.11e-6, "y": 0.20e-6},
}


def strokes(stage: Stage):
    """Every axis over its stroke by plane finite elements with finite displacements."""
    model = plane_model(stage)
    return [follow_stroke(model, axis, steps=3) for axis in analyse(stage, model.system).axes]


@pytest.fixture(scope="module", params=sorted(MEASURED))
def compared(request: pytest.FixtureRequest) -> TraditionalComparison:
    stage = design(request.param)
    return compare_traditional(stage, strokes=strokes(stage))


@pytest.mark.slow
def test_bending_of_bodies_explains_the_motion_errors_that_were_measured(compared) -> None:
    # 10, 2, -24 and -14 %: what is left would be drives that push askew, and the guide of the bench
    for axis, errors in compared.stage.axes.items():
        assert errors.figures("across")[0] == pytest.approx(
            MEASURED[compared.stage.title][axis], rel=0.27
        )
        # of which rigid bodies, and scatter of a few micrometres, explain next to nothing
        assert errors.geometry < 1e-12
        assert errors.manufacture < 0.1 * errors.figures("across")[0]


@pytest.mark.slow
def test_the_claims_hold_for_some_definitions_and_not_for_others(compared) -> None:
    holds = {row.against: row.holds for row in compared.reductions()}
    assert holds == {
        "stacked parallelograms": False,
        "stacked double parallelograms": False,
        "parallelograms side by side": True,
        "the same stage, guides on one side": True,
        "crossed rollers (by their maker)": compared.stage.title == "vgtu-piezo",
    }
    straight = {row.against: row.holds for row in compared.reductions("straightness")}
    assert [name for name, held in straight.items() if not held] == [
        "stacked double parallelograms"
    ]
    results = compared.data()
    assert [row["holds"] for row in results["reductions"]["across"]] == list(holds.values())
    assert len(results["stages"]) == 5
    assert results["stages"][0]["axes"]["x"]["across"]["upper"] < 1e-6


@pytest.mark.slow
def test_a_single_parallelogram_goes_along_its_arc(compared) -> None:
    stacked = compared.others[0]
    for axis, errors in stacked.axes.items():
        arc = errors.travel**2 / (2.0 * compared.legs[axis])
        # the pole of a thick neck lies off its middle, and the leg is longer or shorter by that
        assert errors.geometry == pytest.approx(arc, rel=0.1)


@pytest.mark.slow
def test_symmetry_takes_a_third_off_the_drift(compared) -> None:
    def total(stage) -> float:
        x, y, _ = stage.drift["temperature"]
        return (x**2 + y**2) ** 0.5

    # and no more: the claim of the study that it makes a stage robust holds as far as this
    assert total(compared.stage) / total(compared.asymmetric) == pytest.approx(0.66, abs=0.03)


@pytest.mark.slow
def test_a_stack_weighs_what_its_two_plates_do_and_is_as_high(compared) -> None:
    stage = design(compared.stage.title)
    travel = {name: axis.travel for name, axis in compared.stage.axes.items()}
    (_, stacked), *_ = traditional_axes(stage, travel)
    lower, upper = stacked["x"].stage, stacked["y"].stage
    plates = [
        sum(m.mass for m in mass_properties(part).values())
        for part in (
            replace(lower, bodies=tuple(replace(b, extra_masses=()) for b in lower.bodies)),
            upper,
        )
    ]
    assert compared.others[0].mass == pytest.approx(sum(plates))
    assert compared.others[0].size[2] == pytest.approx(2.0 * stage.thickness + 3e-3)


@pytest.mark.slow
def test_paths_of_traditional_guides_are_those_of_finite_elements(compared) -> None:
    travel = {name: axis.travel for name, axis in compared.stage.axes.items()}
    for (title, axes), found in zip(
        traditional_axes(design(compared.stage.title), travel), compared.others, strict=True
    ):
        if "side by side" in title:
            continue
        for name, guided in axes.items():
            (path,) = strokes(guided.stage)
            errors = found.axes[name]
            ours = errors.bending - errors.geometry
            limit = 0.025e-6 if "double" in title else 0.05e-6
            assert path.across[-1] == pytest.approx(ours, abs=limit)
