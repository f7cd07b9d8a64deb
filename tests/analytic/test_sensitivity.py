"""Which parameter moves what: closed forms, and what similar stages have in common."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError, StageError
from flexstage.lumped import lumped_system
from flexstage.stage.designs import DESIGNS, StageTemplate, find_stage
from flexstage.studies.explore.family import STAGE_FIGURES, Family, jacobian, known_figures
from flexstage.studies.explore.figures import Figure, figures_of
from flexstage.studies.explore.sensitivity import (
    Sensitivities,
    hinge_variables,
    sensitivities,
    variables_by,
)
from flexstage.system import analyse


def sensitive(
    template: StageTemplate, of: list[str], by: tuple[str, ...] = ()
) -> tuple[Sensitivities, dict[str, dict[str, float]]]:
    """Sensitivities, and per cent per per cent by figure and parameter."""
    variables, skipped = variables_by(template, by)
    figures = figures_of(of, known_figures(template.stage()))
    found = sensitivities(Family(template=template, variables=variables), figures, skipped=skipped)
    names = [v.name for v in found.variables]
    return found, {
        f.name: dict(zip(names, map(float, row), strict=True))
        for f, row in zip(found.figures, found.elasticities, strict=True)
    }


def test_a_guide_on_slender_leaves_is_a_beam() -> None:
    """f ~ (E b t^3/(L^3 m))^(1/2): 3/2 of the thickness, -3/2 of the length, none of the width."""
    leaf = {
        "leg.notch.kind": "leaf",
        "leg.notch.neck_thickness": "0.23 mm",
        "leg.notch.leaf_length": "47 mm",
        "leg.notch.notch_depth": "3 mm",
        "leg.bar_length": "null",
        "actuator.travel": "0.1 mm",
    }
    found, parts = sensitive(
        StageTemplate.of("parallelogram", leaf), ["frequency", "stress", "mass"], ("*",)
    )
    frequency, stress = parts["natural_frequency.x"], parts["max_stress.x"]
    # the roots of the leaves in their bodies are 1 % of their length
    assert frequency["leg.notch.neck_thickness"] == pytest.approx(1.5, rel=0.02)
    assert frequency["leg.notch.leaf_length"] == pytest.approx(-1.5, rel=0.04)
    assert frequency["thickness"] == pytest.approx(0.0, abs=1e-6)
    # of a guide that is pushed by a length: sigma ~ E t x/L^2
    assert stress["actuator.travel"] == pytest.approx(1.0, rel=1e-6)
    assert stress["leg.notch.leaf_length"] == pytest.approx(-2.0, rel=0.04)
    assert parts["mass"]["thickness"] == pytest.approx(1.0, rel=1e-6)
    k = [v.name for v in found.variables].index("leg.notch.neck_thickness")
    by_ten_um = found.changes(10e-6)[0, k]
    assert by_ten_um == pytest.approx(1.5 * found.values[0] * 0.01 / 0.23, rel=0.02)


LEVER = """\
flexstage: 1
length_unit: mm
name: lever
thickness: 8 mm
material: Al 7075-T6
parameters:
  a: {value: 7 mm, description: from the pivot to the drive}
  b: {value: 31 mm, description: from the pivot to the probe}
  reach: {value: = b + 2 mm, description: half of the lever}
  pitch: 0.25 mm
bodies:
  base: {fixed: true, outline: [[-30, -20], [60, -20], [60, -2], [-30, -2]]}
  lever: {outline: [[= -reach, 2], [= reach, 2], [= reach, 9], [= -reach, 9]]}
hinges:
  pivot:
    bodies: [base, lever]
    at: [0, 0]
    direction: 90 deg
    profile: {kind: circular, neck_thickness: 0.3 mm, radius: 2 mm}
drives:
  push:
    {kind: screw, pushes: lever, reacts: base, at: [[= a, 2], [= a, -2]], direction: 90 deg,
     pitch: = pitch, smallest_step: 1 um, travel: 0.1 mm}
probes:
  eye: {body: lever, at: [= b, 9], direction: 90 deg}
axes:
  y: {drive: push, probe: eye}
"""


def test_the_ratio_of_a_lever_goes_with_its_arms(tmp_path: Path) -> None:
    """b/a: +1 and -1, less what the pivot gives way; a length that follows others is none."""
    file = tmp_path / "lever.yaml"
    file.write_text(LEVER)
    found, parts = sensitive(StageTemplate.of(file), ["ratio"], ("a", "b", "reach", "pitch"))
    ratio = parts["transmission_ratio.y"]
    assert ratio["b"] == pytest.approx(1.0, rel=2e-3)
    assert ratio["a"] == pytest.approx(-1.0, rel=2e-3)
    assert ratio["pitch"] == 0.0
    assert found.skipped == {"reach": "it follows from others"}


#: Designs with lengths that no parameter names: in the guides of two axes, in the list of levers.
FIXED_LENGTHS = {"side-by-side-xy", "stacked-xy", "lever-chain"}
QUICK = ("parallelogram", "three-rrr")


def similar(name: str, *leave_out: str) -> None:
    """Euler's theorem of homogeneous functions, for a stage whose lengths all grow alike.

    With modulus and density as they are a frequency is of degree -1 in the lengths, a mass 3, a
    stiffness 1, a ratio and the stress under a stroke that grows alike 0. The two axes of bridge-xy
    have one frequency, and it holds of each.
    """
    template = StageTemplate.of(name)
    known = known_figures(template.stage())
    degrees = {
        "natural_frequency_hz": -1.0,
        "mass": 3.0,
        "moving_mass": 3.0,
        "input_stiffness": 1.0,
        "transmission_ratio": 0.0,
        "max_stress": 0.0,
        "width": 1.0,
        "drive_force": 2.0,
        "buckling_factor": 0.0,
    }
    figures = [Figure(quantity=q, axis=a) for q, a in known if q in degrees and q not in leave_out]
    found, parts = sensitive(template, [figure.name for figure in figures])
    lengths = [v.name for v in found.variables if v.dimension == "length"]
    for figure in found.figures:
        # a length that is zero stays zero
        total = float(np.nansum([parts[figure.name][name] for name in lengths]))
        tolerance = 1e-4 if figure.quantity in STAGE_FIGURES else 1e-7
        assert total == pytest.approx(degrees[figure.quantity], abs=tolerance), figure.name


@pytest.mark.parametrize("name", QUICK)
def test_all_lengths_together_make_a_similar_stage(name: str) -> None:
    similar(name, "drive_force", "buckling_factor")  # which are analysed one by one


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(DESIGNS) - FIXED_LENGTHS - set(QUICK)))
def test_all_lengths_of_every_design_make_a_similar_stage(name: str) -> None:
    similar(name)


def test_a_length_that_no_parameter_names_is_missed() -> None:
    """The check can fail: the bridge of two axes has 10 mm that are nobody's."""
    with pytest.raises(AssertionError):
        similar("stacked-xy", "drive_force", "buckling_factor")


def test_slopes_are_those_of_the_analysis_itself() -> None:
    """Of stages built anew with longer steps, Richardson's extrapolation of two."""
    template = StageTemplate.of("vgtu-piezo")
    found, _ = sensitive(template, ["frequency.x", "stress.x"], ("x.lever_neck", "x.lever_width"))
    for k, variable in enumerate(found.variables):

        def figures(value: float, name: str = variable.name) -> np.ndarray:
            stage = find_stage("vgtu-piezo", {name: f"{1e6 * value!r} um"})
            rows = analyse(stage, lumped_system(stage)).characteristics
            by = {(r.quantity, r.axis): r.value for r in rows}
            return np.array([by[f.key] for f in found.figures])

        h, at = 1e-3 * variable.usual, variable.usual
        one, two = (
            (figures(at + step) - figures(at - step)) / (2.0 * step) for step in (h, 2.0 * h)
        )
        np.testing.assert_allclose(found.slopes[:, k], (4.0 * one - two) / 3.0, rtol=2e-5)


def test_necks_of_hinges_add_up_to_the_parameter_that_they_share() -> None:
    template = StageTemplate.of("vgtu-piezo")
    of = ["frequency.x", "ratio.x"]
    figures = figures_of(of, known_figures(template.stage()))
    necks = hinge_variables(template, ["xl*.neck", "xinp*.neck", "xful*.neck"])
    _, slopes = jacobian(necks, necks.usual, figures)
    found, _ = sensitive(template, of, ("x.lever_neck",))
    # the parameter widens the ends of the levers as well
    np.testing.assert_allclose(slopes.sum(axis=1), found.slopes[:, 0], rtol=3e-3)
    rows = sensitivities(necks, figures)
    assert len(rows.equivalent) < 5
    assert sum(map(len, rows.equivalent)) == 8
    # A row has the mean of what its hinges do. It is a difference quotient: a step of 1e-5 of the
    # range moves a frequency by some 1e-7 of it, rounding by up to 1e-13.
    for alike, row in zip(rows.equivalent, rows.slopes.T, strict=True):
        own = slopes[:, [necks.names.index(name) for name in alike]]
        np.testing.assert_allclose(np.abs(row), np.abs(own).mean(axis=1), rtol=5e-6)


def test_mirror_images_share_a_row_and_what_is_moved_reads_zero() -> None:
    template = StageTemplate.of("parallelogram")
    figures = figures_of(["frequency", "stroke"], known_figures(template.stage()))
    found = sensitivities(hinge_variables(template), figures)
    necks = [alike for alike in found.equivalent if alike[0].endswith(".neck")]
    assert sum(len(alike) for alike in necks) == 4
    assert len(necks) <= 2
    assert all(v.usual == 0.0 for v in found.variables if v.name.endswith((".along", ".across")))
    assert np.isfinite(found.slopes).all()


def test_lengths_that_are_zero_have_slopes_and_no_part() -> None:
    template = StageTemplate.of("vgtu-mechanical")
    found, parts = sensitive(template, ["frequency"], ("aperture_offset",))
    assert np.isfinite(found.slopes).all()
    assert all(np.isnan(list(row.values())).all() for row in parts.values())
    assert found.steps().tolist() == [10e-6]


def test_what_cannot_change_is_named_with_the_reason() -> None:
    _, skipped = variables_by(StageTemplate.of("lever-chain"))
    assert skipped["levers"] == "it is a list"
    assert skipped["actuator.kind"] == "it is a choice"
    assert skipped["guide.bar_length"] == "it has no value"
    template = StageTemplate.of("parallelogram")
    with pytest.raises(
        ModelError, match=r"no parameter 'leg\.nick'; the names are thickness, .*did you mean"
    ):
        variables_by(template, ["leg.nick"])
    with pytest.raises(ModelError, match="no hinge"):
        hinge_variables(template, ["nothing"])
    with pytest.raises(ModelError, match="at least"):
        sensitivities(Family(template=template, variables=()), [])


def test_a_parameter_whose_every_step_is_no_stage_says_why() -> None:
    """A family that has the stage as it is, and none beside it."""

    class Touching(Family):
        def stage(self, point: np.ndarray):  # type: ignore[no-untyped-def]
            if point[0] != self.variables[0].usual:
                raise StageError("the hole touches the edge")
            return super().stage(point)

    template = StageTemplate.of("parallelogram")
    variables, _ = variables_by(template, ["leg_spacing", "platform_height"])
    found = sensitivities(
        Touching(template=template, variables=variables),
        figures_of(["frequency"], known_figures(template.stage())),
    )
    assert found.skipped == {"leg_spacing": "the hole touches the edge"}
    assert [v.name for v in found.variables] == ["platform_height"]


def test_figures_without_an_axis_are_those_of_all_axes() -> None:
    known = list(itertools.product(("max_stress", "transmission_ratio"), ("x", "y")))
    names = [figure.name for figure in figures_of(["stress", "ratio.y"], known)]
    assert names == ["max_stress.x", "max_stress.y", "transmission_ratio.y"]
    with pytest.raises(ModelError, match="no figure 'nonsense'"):
        figures_of(["stress", "nonsense"], known)
