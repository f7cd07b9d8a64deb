"""Points of a family: the figures of a single analysis of each, and nothing stopped by one."""

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.lumped import lumped_system
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import Family, evaluate, jacobian, known_figures
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.variables import variables_of
from flexstage.studies.models import analyse_model


def _family(source: str, *ranges: str) -> Family:
    template = StageTemplate.of(source)
    return Family(template=template, variables=variables_of(template, ranges))


@pytest.mark.parametrize(
    ("source", "ranges"),
    [
        ("vgtu-piezo", ("x.leg_neck=0.6..0.75 mm", "x.lever_arm_input=9..9.4 mm")),
        ("three-rrr", ("notch.neck_thickness=5 %", "thickness=10 %")),
        ("bridge", ("thickness=10 %", "notch.neck_thickness=4 %")),
    ],
)
def test_every_figure_is_that_of_the_single_analysis(source: str, ranges: tuple[str, ...]) -> None:
    family = _family(source, *ranges)
    known = known_figures(family.template.stage())
    figures = [Figure(quantity=q, axis=a) for q, a in known]
    low, width = family.bounds[:, 0], np.ptp(family.bounds, axis=1)
    points = low + width * np.array([[0.13, 0.71], [0.58, 0.29]])
    found = evaluate(family, points, figures)
    assert found.faults == ("", "")
    for point, values in zip(points, found.values, strict=True):
        single = known_figures(family.stage(point))
        for figure, value in zip(figures, values, strict=True):
            rounding = max(figure.display.zero, 1e-12 * abs(single[figure.key]))
            assert value == pytest.approx(single[figure.key], rel=1e-8, abs=rounding), figure.name


def test_a_point_that_is_no_stage_has_a_sentence_and_stops_nothing() -> None:
    family = _family("vgtu-piezo", "platform_length=30..60 mm")
    ratio = Figure(quantity="transmission_ratio", axis="x")
    found = evaluate(family, np.array([[0.052], [0.032]]), [ratio])
    assert np.isfinite(found.values[0, 0])
    assert np.isnan(found.values[1, 0])
    assert "aperture" in found.faults[1]


def test_finer_models_are_asked_for_by_name() -> None:
    family = _family("parallelogram", "leg_spacing=10 %")
    frequency = Figure(quantity="natural_frequency_hz", axis="x")
    found = evaluate(family, family.usual[None], [frequency], "superelement")
    rows = analyse_model(family.template.stage(), "superelement").characteristics
    assert found.values[0, 0] == rows.value("natural_frequency_hz", "x")


def test_slopes_scale_as_dimensions_say() -> None:
    # K goes with the thickness of the plate, and so does M: no frequency changes, stiffness does
    family = _family("parallelogram", "thickness=10 %", "leg_spacing=10 %")
    stage = family.template.stage()
    assert lumped_system(stage).order == 9
    figures = [
        Figure(quantity="natural_frequency_hz", axis="x"),
        Figure(quantity="input_stiffness", axis="x"),
    ]
    values, slopes = jacobian(family, family.usual, figures)
    relative = slopes[:, 0] * family.usual[0] / values
    # plane stress or strain is chosen by width against neck, which a small step does not change
    assert relative == pytest.approx([0.0, 1.0], abs=1e-6)


def test_slopes_need_a_stage_to_start_from() -> None:
    family = _family("vgtu-piezo", "platform_length=30..60 mm")
    with pytest.raises(ModelError, match="aperture"):
        jacobian(family, np.array([0.032]), [Figure(quantity="mass", axis="stage")])
