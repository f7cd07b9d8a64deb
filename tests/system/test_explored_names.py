"""Ranges of parameters, figures and requirements as they are written, and what refuses them."""

import math

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import known_figures
from flexstage.studies.explore.figures import Figure, Requirement, figure_of, requirement_of
from flexstage.studies.explore.variables import every_variable, variables_of

_KNOWN = [
    ("output_displacement", "x"),
    ("output_displacement", "y"),
    ("natural_frequency_hz", "x"),
    ("max_stress", "x"),
    ("cross_coupling", "x"),
    ("transmission_ratio", "x"),
    ("mass", "stage"),
]


@pytest.fixture(scope="module")
def piezo() -> StageTemplate:
    return StageTemplate.of("vgtu-piezo")


@pytest.mark.parametrize(
    ("text", "low", "high", "count"),
    [
        ("x.leg_neck=0.3..0.8 mm", 0.3e-3, 0.8e-3, None),
        ("x.leg_neck = 300 um .. 0.8 mm / 6", 0.3e-3, 0.8e-3, 6),
        ("x.leg_neck=25 %", 0.543e-3, 0.905e-3, None),
        ("x.leg_neck=±25%", 0.543e-3, 0.905e-3, None),
        ("x.leg_neck=25 %/7", 0.543e-3, 0.905e-3, 7),
        ("x.leg_n?ck = 25 % / 7", 0.543e-3, 0.905e-3, 7),
    ],
)
def test_a_range_is_read(
    piezo: StageTemplate, text: str, low: float, high: float, count: int | None
) -> None:
    (found,) = variables_of(piezo, [text])
    assert (found.low, found.high, found.count) == (pytest.approx(low), pytest.approx(high), count)
    assert found.usual == pytest.approx(0.724e-3)
    assert found.heading == "x.leg_neck [mm]"


def test_a_pattern_takes_all_that_fit(piezo: StageTemplate) -> None:
    names = [v.name for v in variables_of(piezo, ["?.leg_neck=10 %", "y.lever_width=4..6 mm"])]
    assert names == ["x.leg_neck", "y.leg_neck", "y.lever_width"]


def test_every_variable_leaves_out_what_is_no_number(piezo: StageTemplate) -> None:
    names = {v.name for v in every_variable(piezo)}
    assert {"x.leg_neck", "platform_wall"} <= names
    assert not {"material", "x.actuator.kind"} & names


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["x.leg_neck"], "is not a range"),
        (["x.leg_neck=3 mm"], "is not a range"),
        (["x.legneck=1..2 mm"], "did you mean 'x.leg_neck'"),
        (["x.leg_neck=1..0.2 mm"], "from a lower to a higher value, got 1 mm to 0.2 mm"),
        (["x.leg_neck=1..2 kg"], "'kg' is not a unit of length"),
        (["x.leg_neck=1..2"], "no unit"),
        (["x.leg_neck=0 %"], "give a range"),
        (["x.leg_neck=0.3..0.8 mm/1"], "2 to 100 000 values"),
        (["material=20 %"], "is not continuous"),
        (["x.leg_neck=1..2 mm", "x.leg_*=3 %"], "given twice"),
    ],
)
def test_a_range_that_is_none_is_refused(
    piezo: StageTemplate, texts: list[str], sentence: str
) -> None:
    with pytest.raises(ModelError, match=sentence):
        variables_of(piezo, texts)


@pytest.mark.parametrize(
    ("text", "quantity", "axis"),
    [
        ("stroke.y", "output_displacement", "y"),
        ("natural_frequency.x", "natural_frequency_hz", "x"),
        ("natural_frequency", "natural_frequency_hz", "x"),
        ("mass", "mass", "stage"),
    ],
)
def test_a_figure_has_short_names(text: str, quantity: str, axis: str) -> None:
    assert figure_of(text, _KNOWN) == Figure(quantity=quantity, axis=axis)
    found = figure_of(text, _KNOWN)
    assert figure_of(found.name, _KNOWN) == found


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("stroke", "of which axis: choose stroke.x, stroke.y"),
        ("stroke.z", "choose stroke.x, stroke.y"),
        ("natural_freqency.x", "did you mean 'natural_frequency'"),
    ],
)
def test_a_figure_that_there_is_not_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        figure_of(text, _KNOWN)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("stroke.x >= 60 um", 60e-6, None),
        ("stress.x<=200MPa", None, 200e6),
        ("ratio.x = 1.7 +- 1 %", 1.683, 1.717),
        ("natural_frequency = 300 Hz ± 5 Hz", 295.0, 305.0),
        ("coupling.x <= 0.2 %", -0.002, 0.002),
        ("mass = 0.3 kg", 0.3, 0.3),
    ],
)
def test_a_requirement_is_read_and_written(
    text: str, low: float | None, high: float | None
) -> None:
    found = requirement_of(text, _KNOWN)
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))
    if low is None or high is None or low == high:
        assert requirement_of(found.text, _KNOWN) == found


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("stroke.x", "is not a requirement"),
        ("stroke.x >= 60", "has no unit"),
        ("stress.x >= 3 Hz", "'Hz' is not a unit of pressure"),
        ("ratio.x >= 1.7 +- 1 %", "a tolerance belongs to '='"),
        ("ratio.x = 1.7 +- x %", "is not a percentage"),
        ("ratio.x = 1.7 +- -1 %", "must be 0 or more"),
    ],
)
def test_a_requirement_that_is_none_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        requirement_of(text, _KNOWN)


def test_excess_is_in_parts_of_the_bound_and_nan_meets_nothing() -> None:
    stress = Requirement(figure=Figure(quantity="max_stress", axis="x"), low=1e8, high=2e8)
    values = np.array([0.9e8, 1.5e8, 2.5e8, math.nan])
    assert stress.met(values).tolist() == [False, True, False, False]
    assert stress.excess(values)[:3] == pytest.approx([0.1, -0.25, 0.25])
    assert math.isnan(stress.excess(values)[3])


def test_known_figures_of_a_stage_can_all_be_named(piezo: StageTemplate) -> None:
    known = known_figures(piezo.stage())
    for key in known:
        figure = Figure(quantity=key[0], axis=key[1])
        assert figure_of(figure.name, known) == figure


def test_the_stroke_of_a_rotation_is_meant_by_its_short_name() -> None:
    known = [("output_displacement", "x"), ("rotation_stroke", "theta")]
    assert figure_of("stroke.theta", known).quantity == "rotation_stroke"
    assert figure_of("stroke.x", known).quantity == "output_displacement"
