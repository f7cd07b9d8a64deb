"""Motion errors of an axis: every part by its closed form, and how they are joined."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.fem.stroke import FiniteStroke
from flexstage.hinges import RightCircular
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.stage.designs.parallelogram import ParallelogramParameters, parallelogram
from flexstage.stage.designs.pieces import Leg
from flexstage.studies.guided_axes import GuidedAxis, Mounting, axis_errors, plane_rates
from flexstage.system import static_displacements
from flexstage.virtual.imperfections import Scatter, displaced_system
from flexstage.virtual.scattered_motion import draw_deviations, motion_rates

#: No scatter at all.
EXACT = Scatter(**dict.fromkeys(Scatter.__dataclass_fields__, 0.0))
TRAVEL = 170e-6
STAGE = parallelogram(
    ParallelogramParameters(
        leg=Leg(notch=RightCircular(neck_thickness=0.09e-3, radius=1.9e-3), bar_length=17e-3),
        leg_spacing=43e-3,
    )
)
LENGTH = 17e-3 + 2.0 * 1.9e-3
GUIDE = GuidedAxis(stage=STAGE, axis="x")


def errors(guide: GuidedAxis, scatter: Scatter = EXACT, **options):
    return axis_errors(guide, TRAVEL, lumped_system(guide.stage), scatter, **options)


def test_the_arc_of_a_parallelogram_is_its_motion_across() -> None:
    found = errors(GUIDE, samples=3)
    arc = TRAVEL**2 / (2.0 * LENGTH)
    assert found.geometry == pytest.approx(arc, rel=3e-3)
    assert found.across == pytest.approx(3 * [found.geometry])
    # of a parabola a quarter is left beside its straight line
    assert found.straightness == pytest.approx(3 * [0.25 * arc], rel=3e-3)
    assert (found.bending, found.manufacture, found.assembly) == pytest.approx((0, 0, 0), abs=1e-18)
    assert found.figures("normal") == pytest.approx((0.0, 0.0), abs=1e-18)
    assert not found.finite_elements


def test_what_elastic_bodies_add_is_the_difference_of_two_models() -> None:
    # another model of it, whose legs are not parallel
    other = displaced_system(STAGE, {"left-upper": (60e-6, 0.0)})
    slope = plane_rates(other, STAGE, "x")[0] - plane_rates(lumped_system(STAGE), STAGE, "x")[0]
    assert slope == pytest.approx(-0.5 * 60e-6 / LENGTH, rel=0.02)
    found = axis_errors(GUIDE, TRAVEL, other, EXACT, samples=1)
    assert found.bending == pytest.approx(slope * TRAVEL, rel=1e-6)
    arc = TRAVEL**2 / (2.0 * LENGTH)
    assert found.across[0] == pytest.approx(arc - slope * TRAVEL, rel=3e-3)
    # straightness does not see a slope
    assert found.straightness[0] == pytest.approx(0.25 * arc, rel=3e-3)


def test_a_path_of_finite_elements_stands_for_both() -> None:
    u = np.linspace(0.0, TRAVEL, 7)
    path = FiniteStroke(
        axis="x",
        displacement=u,
        force=u,
        along=u,
        across=3e-3 * u,
        rotation=0.02 * u,
        frequency_hz=1.0,
        buckling_factor=9.0,
    )
    found = errors(GUIDE, path=path, samples=2)
    assert found.finite_elements
    assert found.across == pytest.approx(2 * [3e-3 * TRAVEL])
    assert found.yaw == pytest.approx(2 * [0.02 * TRAVEL])
    assert found.bending == pytest.approx(3e-3 * TRAVEL + TRAVEL**2 / (2.0 * LENGTH), rel=2e-3)


def test_an_offset_makes_motion_of_rotation() -> None:
    height, beside = 31e-3, 57e-3
    scatter = Scatter(neck_common=0.0, neck_own=0.0, drive=0.0)
    at_probe = errors(GUIDE, scatter, samples=80, seed=5)
    above = errors(replace(GUIDE, offset=(0.0, 0.0, height)), scatter, samples=80, seed=5)
    rates = motion_rates(STAGE, draw_deviations(STAGE, scatter, 80, seed=5))["x"]
    assert above.assembly == pytest.approx(np.std(rates[:, 3]) * height * TRAVEL, rel=1e-9)
    assert at_probe.assembly == 0.0
    assert above.manufacture == at_probe.manufacture
    # ahead of the probe the yaw of the stage as drawn counts as well
    ahead = errors(replace(GUIDE, offset=(beside, 0.0, 0.0)), EXACT, samples=1)
    yaw = plane_rates(lumped_system(STAGE), STAGE, "x")[1]
    assert ahead.coupling == pytest.approx(yaw * beside, rel=1e-6)
    arc = TRAVEL**2 / (2.0 * LENGTH)
    assert ahead.across[0] == pytest.approx(abs(yaw * beside * TRAVEL - arc), rel=0.01)


def test_a_guide_is_mounted_as_square_as_is_stated() -> None:
    limit = math.radians(20.0 / 3600.0)
    found = errors(replace(GUIDE, mounting=Mounting()), samples=4000)
    # any angle within 20 arcsec is as likely as another; 4000 samples are within 3.4 %
    assert found.assembly == pytest.approx(limit / math.sqrt(3.0) * TRAVEL, rel=0.04)
    # half of all samples are within 0.674 deviations
    normal = found.figures("normal")[0]
    assert normal == pytest.approx(0.6745 * limit / math.sqrt(3.0) * TRAVEL, rel=0.06)


def test_scatter_is_the_same_for_the_same_seed_and_of_each_plate_its_own() -> None:
    one, same = (errors(GUIDE, Scatter(), samples=30, seed=2) for _ in range(2))
    other = errors(replace(GUIDE, stream=1), Scatter(), samples=30, seed=2)
    assert np.array_equal(one.across, same.across)
    assert not np.allclose(one.across, other.across, rtol=1e-4)


def test_rates_of_a_model_are_those_of_its_probes() -> None:
    stage = design("vgtu-piezo")
    system = displaced_system(stage, {"ygp0-u": (40e-6, -25e-6), "xlko-d": (0.0, 70e-6)})
    for axis, other, sign in (("x", "y", 1.0), ("y", "x", -1.0)):
        state = static_displacements(system, {axis: 2e-6})
        across, turned = plane_rates(system, stage, axis)
        along = state.readings[axis]
        assert across == pytest.approx(sign * state.readings[other] / along, rel=1e-9)
        assert turned == pytest.approx(state.body_motion["PY"][2] / along, rel=1e-9)


def test_a_probe_that_sees_no_motion_against_the_ground_is_refused() -> None:
    probe = replace(STAGE.probe("x"), relative_to="left-leg")
    stage = replace(STAGE, probes=(probe,))
    with pytest.raises(ModelError, match="must measure a displacement against the ground"):
        plane_rates(lumped_system(stage), stage, "x")
