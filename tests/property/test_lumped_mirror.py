"""A stage seen in a mirror behaves like its mirror image, notches cut from one side included.

Evidence (Stages, tolerances, designs): one-sided notches (mirror image): $10^{-9}$, *consistency*
"""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.hinges import CornerFilleted, Profile, RightCircular
from flexstage.lumped import lumped_system, mechanism, nonlinear, stroke_path, symbolic_model
from flexstage.quantities.material import material
from flexstage.stage import Body, Hinge, Loop, PiezoStack, Probe, Screw, Stage
from flexstage.stage.transform import PlaneMotion, moved
from flexstage.system import modes, static_displacements


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Loop:
    return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def elbow(low: Profile, high: Profile, offset: float) -> Stage:
    """A frame, an arm to its right and a bar on top of the arm; nothing in it is symmetric."""
    top = 5e-3
    a, b = 0.5 * low.length, 0.5 * high.length
    return Stage(
        name="elbow",
        thickness=8e-3,
        material=material("Ti-6Al-4V"),
        bodies=(
            Body(name="frame", outline=rectangle(-10e-3, -top, -a, top), fixed=True),
            Body(name="arm", outline=rectangle(a, -top, 20e-3, top)),
            Body(name="bar", outline=rectangle(8e-3, top + 2 * b, 16e-3, 21e-3)),
        ),
        hinges=(
            Hinge(
                name="low", bodies=("frame", "arm"), at=(0.0, offset), direction=0.0, profile=low
            ),
            Hinge(
                name="high",
                bodies=("arm", "bar"),
                at=(12e-3, top + b),
                direction=0.5 * math.pi,
                profile=high,
            ),
        ),
        drives=(
            Screw(
                name="d",
                pushes="bar",
                reacts="arm",
                at=((16e-3, 13e-3), (19e-3, top)),
                direction=2.1,
                pitch=0.5e-3,
                smallest_step=1e-6,
                travel=0.2e-3,
                stiffness=1.3e6,
            ),
            PiezoStack(
                name="e",
                pushes="bar",
                reacts="frame",
                at=((8e-3, 17e-3), (-4e-3, top)),
                direction=0.2,
                free_stroke=30e-6,
                stiffness=0.9e6,
            ),
        ),
        probes=(
            Probe(name="p", body="bar", at=(9e-3, 18e-3), direction=0.4, relative_to="arm"),
            Probe(name="ground", body="bar", at=(9e-3, 18e-3), direction=0.4),
        ),
    )


def mirrored(stage: Stage) -> Stage:
    """Turn y round."""
    return moved(stage, PlaneMotion.reflection(0.0))


sizes = st.floats(0.3e-3, 0.7e-3)


@st.composite
def elbows(draw: st.DrawFn) -> Stage:
    low = RightCircular(
        neck_thickness=draw(sizes), radius=draw(st.floats(1e-3, 2e-3)), one_sided=True
    )
    high = CornerFilleted(
        neck_thickness=draw(sizes), notch_length=3e-3, fillet_radius=draw(sizes), one_sided=True
    )
    return elbow(low, high, draw(st.floats(-1e-3, 1e-3)))


@given(elbows())
@settings(max_examples=20, deadline=None)
def test_mirror_image(stage: Stage) -> None:
    image = mirrored(stage)
    here, there = lumped_system(stage), lumped_system(image)
    for drives in ("removed", "in place"):
        # 1e-9: rounding of stiffnesses that differ by 1e8 among the coordinates of a body
        assert np.allclose(
            modes(here, drives=drives).omega, modes(there, drives=drives).omega, rtol=1e-9
        )
    a = static_displacements(here, {"d": 1.7e-5, "e": -0.6e-5})
    b = static_displacements(there, {"d": 1.7e-5, "e": -0.6e-5})
    for name, stress in a.hinge_stress.items():
        assert math.isclose(b.hinge_stress[name], stress, rel_tol=1e-9)
    for name, reading in a.readings.items():
        assert math.isclose(b.readings[name], reading, rel_tol=1e-9)
    for name, (x, y, turn) in a.body_motion.items():
        # some of them are small differences of motions of 1e-5 m
        assert np.allclose(b.body_motion[name], (x, -y, -turn), rtol=1e-9, atol=1e-14)


def test_the_side_of_the_cut_matters() -> None:
    # or the property above would hold for a model that does not know the side
    low = RightCircular(neck_thickness=0.45e-3, radius=1.2e-3, one_sided=True)
    stage = elbow(low, low, 0.7e-3)
    hinge = stage.hinges[0]
    other = replace(hinge, bodies=hinge.bodies[::-1], direction=math.pi)
    other_side = replace(stage, hinges=(other, stage.hinges[1]))
    here, there = (modes(lumped_system(s), count=1).omega[0] for s in (stage, other_side))
    assert abs(there / here - 1.0) > 1e-3


def test_the_three_forms_of_the_model_are_one() -> None:
    """Coupled hinges at odd places, and a drive whose points are beside each other's line."""
    low = RightCircular(neck_thickness=0.45e-3, radius=1.2e-3, one_sided=True)
    high = CornerFilleted(
        neck_thickness=0.5e-3, notch_length=3e-3, fillet_radius=0.7e-3, one_sided=True
    )
    stage = elbow(low, high, 0.7e-3)
    system, symbols = lumped_system(stage), symbolic_model(stage)
    finite = nonlinear(mechanism(stage))
    rest = np.zeros(system.order)
    scale = np.sqrt(np.outer(np.diag(system.K), np.diag(system.K)))
    assert abs(system.K[0, 2]) > 1e-3 * scale[0, 2]
    assert np.all(np.abs(symbols.numbers(symbols.K) - system.K) <= 1e-12 * scale)
    assert np.all(np.abs(finite.tangent(rest) - system.K) <= 1e-12 * scale)
    vector = system.drive("d").vector
    assert np.allclose(symbols.numbers(symbols.drive("d").vector).ravel(), vector, atol=1e-15)
    assert np.allclose(finite.elongation("d", rest)[1], vector, rtol=0.0, atol=1e-15)
    # both of its bodies are free: turning them together about any point does not stretch the drive
    centres = [np.array(system.body(name).centre) for name in ("arm", "bar")]
    about = np.array([0.013, -0.031])
    turn = np.concatenate([(-(c - about)[1], (c - about)[0], 1.0) for c in centres])
    assert abs(vector @ turn) < 1e-15
    # and its force on them has no moment, nor a resultant
    assert np.abs(vector.reshape(2, 3)[:, :2].sum(axis=0)).max() < 1e-15


def test_the_path_of_the_image_is_the_image_of_the_path() -> None:
    low = RightCircular(neck_thickness=0.45e-3, radius=1.2e-3, one_sided=True)
    stage = elbow(low, low, 0.7e-3)
    push = np.linspace(-0.2e-3, 0.2e-3, 5)
    here = stroke_path(stage, "d", "ground", push)
    there = stroke_path(mirrored(stage), "d", "ground", push)
    assert np.ptp(here.deviation) > 1e-7
    assert np.allclose(there.along, here.along, rtol=0.0, atol=1e-13)
    assert np.allclose(there.across, -here.across, rtol=0.0, atol=1e-13)
    assert np.allclose(there.drive_force, here.drive_force, rtol=1e-9, atol=1e-7)
