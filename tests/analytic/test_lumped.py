"""The lumped model against mechanisms whose motion is known by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError, StageError
from flexstage.hinges import CornerFilleted, RightCircular, compliance
from flexstage.hinges.hinge_spring import WIDE_NECK
from flexstage.lumped import hinge_springs, lumped_system, parameter_tangents, stage_arrays
from flexstage.quantities.material import material
from flexstage.stage import (
    Axis,
    Body,
    Force,
    Hinge,
    Loop,
    Probe,
    Stage,
    mass_properties,
)
from flexstage.stage.transform import PlaneMotion, moved
from flexstage.system import analyse, modes, probe_stiffness, static_displacements

NECK, RADIUS = 0.31e-3, 0.9e-3
NOTCH = RightCircular(neck_thickness=NECK, radius=RADIUS)
HEIGHT = NOTCH.root_height


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Loop:
    return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def lever(input_arm: float = 7e-3, output_arm: float = 19e-3) -> Stage:
    """A bar on one hinge: the fulcrum at the origin, the bar to the right above it."""
    half = HEIGHT / 2
    base = Body(name="base", outline=rectangle(-6e-3, -9e-3, 6e-3, -RADIUS), fixed=True)
    bar = Body(name="bar", outline=rectangle(-half, RADIUS, output_arm + 2e-3, 6e-3))
    return Stage(
        name="lever",
        thickness=8e-3,
        material=material("Ti-6Al-4V"),
        bodies=(base, bar),
        hinges=(
            Hinge(
                name="h",
                bodies=("base", "bar"),
                at=(0.0, 0.0),
                direction=math.pi / 2,
                profile=NOTCH,
            ),
        ),
        drives=(
            Force(
                name="f",
                pushes="bar",
                reacts="base",
                at=((input_arm, RADIUS), (input_arm, -RADIUS)),
                direction=math.pi / 2,
                largest_force=2.0,
            ),
        ),
        probes=(
            Probe(name="p", body="bar", at=(output_arm, RADIUS), direction=math.pi / 2),
            Probe(name="side", body="bar", at=(output_arm, RADIUS), direction=0.0),
        ),
        axes=(Axis(name="y", drive="f", probe="p"),),
    )


def test_lever_frequency_is_that_of_a_pendulum_on_a_spring() -> None:
    stage = lever()
    spring = hinge_springs(stage)[0]
    body = mass_properties(stage)["bar"]
    arm2 = body.centre[0] ** 2 + body.centre[1] ** 2
    omega = math.sqrt(spring.stiffness[2, 2] / (body.inertia + body.mass * arm2))
    # the hinge also gives sideways: at 1e3 times the stiffness that lowers omega by about 1e-3
    found = modes(lumped_system(stage), count=1).omega[0]
    assert omega * 0.99 < found < omega
    # without the translations the pendulum is exact
    system = lumped_system(stage)
    rigid = replace(system, K=_stiffened(stage))
    assert modes(rigid, count=1).omega[0] == pytest.approx(omega, rel=1e-6)


def _stiffened(stage: Stage) -> np.ndarray:
    from flexstage.lumped.assemble import hinge_matrix, layout_of

    spring = hinge_springs(stage)[0]
    b = hinge_matrix(layout_of(stage), spring.hinge)
    # times the squared arms, 1e4 times stiffer than in the hinge; more would drown the rotation
    return b.T @ np.diag([1e12, 1e12, spring.stiffness[2, 2]]) @ b


def test_static_force_superposes_the_three_springs() -> None:
    stage = lever()
    k = hinge_springs(stage)[0].stiffness
    c = np.linalg.inv(k)
    # in hinge axes: 1 along y, 2 along -x; a force F in y at the arm a, read at the arm b
    a, b = 7e-3, 19e-3
    force = np.array([1.0, 0.0, a])
    motion = c @ force
    expected = motion[0] + b * motion[2]
    analysis = analyse(stage, lumped_system(stage))
    axis = analysis.axes[0]
    assert axis.output_displacement / 2.0 == pytest.approx(expected, rel=1e-10)
    side = axis.static.readings["side"] / 2.0
    assert side == pytest.approx(-motion[1] - RADIUS * motion[2], rel=1e-9)


def test_parallelogram_guide_has_four_rotational_springs() -> None:
    # two legs of length L between the necks: K = 4 k_theta / L^2, axial and shear give ~1e-4
    length = 22e-3
    half = HEIGHT / 2
    legs = []
    for i, x in enumerate((0.0, 30e-3)):
        legs.append(
            Body(
                name=f"leg{i}",
                outline=rectangle(x - half, RADIUS, x + half, length - RADIUS),
            )
        )
    base = Body(name="base", outline=rectangle(-9e-3, -8e-3, 39e-3, -RADIUS), fixed=True)
    top = Body(name="top", outline=rectangle(-9e-3, length + RADIUS, 39e-3, length + 12e-3))
    hinges = []
    for i, x in enumerate((0.0, 30e-3)):
        for name, pair, y in (
            ("low", ("base", f"leg{i}"), 0.0),
            ("high", (f"leg{i}", "top"), length),
        ):
            hinges.append(
                Hinge(
                    name=f"{name}{i}",
                    bodies=pair,
                    at=(x, y),
                    direction=math.pi / 2,
                    profile=NOTCH,
                )
            )
    stage = Stage(
        name="guide",
        thickness=8e-3,
        material=material("Ti-6Al-4V"),
        bodies=(base, *legs, top),
        hinges=tuple(hinges),
        probes=(Probe(name="x", body="top", at=(15e-3, length), direction=0.0),),
    )
    system = lumped_system(stage, method="timoshenko")
    e, nu = stage.material.youngs_modulus, stage.material.poissons_ratio
    rotation = compliance(NOTCH, e, nu, 8e-3, method="timoshenko").stiffness[2, 2]
    # 1 %: the shear and axial give of the necks
    assert probe_stiffness(system, "x") == pytest.approx(4 * rotation / length**2, rel=0.01)


def test_scaling_a_stage() -> None:
    # twice the size in the plane and in thickness: stiffness doubles, frequency halves
    def scaled(stage: Stage, s: float) -> Stage:
        def p(q):
            return (s * q[0], s * q[1])

        return replace(
            stage,
            thickness=s * stage.thickness,
            bodies=tuple(
                replace(b, outline=Loop(tuple(map(p, b.outline.points)))) for b in stage.bodies
            ),
            hinges=tuple(
                replace(
                    h,
                    at=p(h.at),
                    profile=RightCircular(neck_thickness=s * NECK, radius=s * RADIUS),
                )
                for h in stage.hinges
            ),
            drives=tuple(replace(d, at=(p(d.at[0]), p(d.at[1]))) for d in stage.drives),
            probes=tuple(replace(q, at=p(q.at)) for q in stage.probes),
        )

    small, large = lever(), scaled(lever(), 2.0)
    ratio = modes(lumped_system(large)).omega / modes(lumped_system(small)).omega
    assert ratio == pytest.approx(0.5, rel=1e-9)
    stiff = [probe_stiffness(lumped_system(s), "p") for s in (small, large)]
    assert stiff[1] / stiff[0] == pytest.approx(2.0, rel=1e-9)


def test_turning_the_stage_changes_nothing() -> None:
    stage = lever()
    turned = moved(stage, PlaneMotion(angle=0.7, shift=(0.013, -0.004)))
    before, after = lumped_system(stage), lumped_system(turned)
    assert modes(after).omega == pytest.approx(modes(before).omega, rel=1e-9)
    a = static_displacements(before, {"f": 1e-5})
    b = static_displacements(after, {"f": 1e-5})
    assert b.readings["p"] == pytest.approx(a.readings["p"], rel=1e-9)
    assert b.hinge_stress["h"] == pytest.approx(a.hinge_stress["h"], rel=1e-9)


def test_stress_of_the_lever_is_bending_and_tension_with_their_factors() -> None:
    stage = lever()
    analysis = analyse(stage, lumped_system(stage, plane="stress"))
    stress = analysis.axes[0].static.hinge_stress["h"]
    width, force, arm = stage.thickness, 2.0, 7e-3
    nominal = 6 * force * arm / (width * NECK**2) + force / (width * NECK)
    # Neuber's factors of a deep notch of t/R = 0.344 are 1.066 in bending, 1.11 in tension
    assert stress == pytest.approx(1.067 * nominal, rel=0.003)


def test_what_cannot_be_modelled() -> None:
    stage = lever()
    fixed = replace(stage, bodies=tuple(replace(b, fixed=True) for b in stage.bodies))
    with pytest.raises(ModelError, match="every body"):
        lumped_system(fixed)
    loose = replace(stage, hinges=(replace(stage.hinges[0], at=(0.0, 1e-4)),))
    with pytest.raises(StageError, match="is not attached to"):
        lumped_system(loose)
    with pytest.raises(ModelError, match="without deforming a hinge"):
        analyse(replace(stage, hinges=()), lumped_system(replace(stage, hinges=())))


def _with_profile(stage: Stage, profile: CornerFilleted) -> Stage:
    return replace(stage, hinges=(replace(stage.hinges[0], profile=profile),))


def test_a_flat_part_that_some_hinges_lack_is_told() -> None:
    """Stress is read at its two ends, and at the neck where there is none."""
    bare = CornerFilleted(neck_thickness=NECK, notch_length=2.0 * RADIUS, fillet_radius=RADIUS)
    flat = replace(bare, fillet_radius=0.8 * RADIUS)
    with pytest.raises(ModelError, match=r"of 'lever' has a flat part in some stages"):
        stage_arrays([_with_profile(lever(), bare), _with_profile(lever(), flat)])
    arrays = stage_arrays([_with_profile(lever(), bare)], method="timoshenko")

    def longer(length: float) -> Stage:
        return _with_profile(lever(), replace(bare, notch_length=length))

    with pytest.raises(ModelError, match=r"begins or ends near 0\.0018 of parameter 'length'"):
        parameter_tangents(longer, 2.0 * RADIUS, name="length", arrays=arrays)


def test_derivatives_keep_the_plane_state_of_the_hinge() -> None:
    """At the least width in plane strain, of steps to both sides: one state for all of them."""

    def wide(width: float) -> Stage:
        return replace(lever(), thickness=width)

    least = WIDE_NECK * NECK
    assert hinge_springs(wide(least))[0].plane == "strain"
    assert hinge_springs(wide(0.9999 * least))[0].plane == "stress"
    found = parameter_tangents(wide, least, arrays=stage_arrays([wide(least)]))
    fixed = stage_arrays([wide(least)], plane="strain")
    wanted = parameter_tangents(wide, least, arrays=fixed)
    np.testing.assert_array_equal(found.slopes.hinge_stiffness, wanted.slopes.hinge_stiffness)
