r"""Guides and pivots against the closed forms of the literature, as their designs quote them.

Linear stiffness: beams of Euler and Bernoulli in plane stress, which is what the closed forms are
of; what is left is the stretch of legs, which they leave out. Second order: S. Awtar, A. H.
Slocum, E. Sevincer, J. Mech. Des. 129 (2007) 625, for a leaf, normalised by its length L, E I/L^2
and E I/L, with a = 12, e = 1.2, i = -0.6, r = 1/700.

Evidence (Stages, tolerances, designs): guides, gantry: leaves (12 to 96 $EI/L^3$) $10^{-9}$, where
legs stretch 0.2 %; notches ($2k/l^2$ a leg) 3 %; parallelogram, motion across: leaves
($\tfrac35d^2/L$) 1.5 %, *slow*; notches ($d^2/2l$) 2 %

Evidence (Stages, tolerances, designs): double parallelogram, loss of cross stiffness (Awtar's
$y^2(r/4-ei/2a)$; $y^2/8k$): 3 %, leaves *slow*; pivots (Haringx, Wittrick): 0.1 %, cross-spring
$10^{-6}$; centre shift (Wittrick, Awtar): 5 %, *slow*
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexstage.base.arrays import Array
from flexstage.base.errors import StageError
from flexstage.elasticity.loaded import follow_drive
from flexstage.fem import MeshSettings, plane_model
from flexstage.fem.geometry import patches
from flexstage.fem.stage_system import body_motion, body_path, drive_vector
from flexstage.hinges import CornerFilleted, Leaf, RightCircular
from flexstage.lumped import equilibrium, hinge_springs, lumped_system, mechanism, nonlinear
from flexstage.stage import Force, Hinge, Stage, check
from flexstage.stage.designs.gantry import GantryParameters, gantry
from flexstage.stage.designs.parallelogram import (
    DoubleParallelogramParameters,
    LinkedParallelogramParameters,
    ParallelogramParameters,
    compound_parallelogram,
    double_parallelogram,
    linked_parallelogram,
    parallelogram,
)
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.designs.pivots import (
    CartwheelParameters,
    PivotParameters,
    TrapezoidalPivotParameters,
    cartwheel,
    trapezoidal_pivot,
)
from flexstage.stage.drive import VoiceCoil
from flexstage.system import analyse, modes, static_displacements, static_forces

LENGTH, NECK = 31e-3, 0.37e-3
LEAF = Leg(notch=Leaf(neck_thickness=NECK, leaf_length=LENGTH, notch_depth=0.4e-3))
NOTCH = RightCircular(neck_thickness=0.43e-3, radius=1.3e-3)
BAR = Leg(notch=NOTCH, bar_length=23e-3)
STIFF, STIFFENING, BOW, STRETCH = 12.0, 1.2, -0.6, 1.0 / 700.0


def bending(stage: Stage, neck: float = NECK) -> float:
    """E I of a leaf [N m^2]."""
    return stage.material.youngs_modulus * stage.thickness * neck**3 / 12.0


# ------------------------------------------------------------------------------- along the motion


@pytest.mark.parametrize(
    ("stage", "leaves", "tolerance"),
    [
        # the platform turns as the force acts beside the middle of the legs, by their stretch
        (parallelogram(ParallelogramParameters(leg=LEAF)), 24.0, 3e-4),
        (double_parallelogram(DoubleParallelogramParameters(leg=LEAF)), 12.0, 5e-4),
        (compound_parallelogram(DoubleParallelogramParameters(leg=LEAF)), 24.0, 1e-9),
        # legs that stretch are between the drive and the platform
        (gantry(GantryParameters(leg=LEAF)), 96.0, 2e-3),
    ],
    ids=lambda value: value.name if isinstance(value, Stage) else "",
)
def test_stiffness_of_leaves(stage: Stage, leaves: float, tolerance: float) -> None:
    system = lumped_system(stage, method="euler-bernoulli", plane="stress")
    for axis in analyse(stage, system).axes:
        expected = leaves * bending(stage) / LENGTH**3
        assert axis.input_stiffness == pytest.approx(expected, rel=tolerance)
        assert axis.output_displacement / axis.input_displacement == pytest.approx(1.0, abs=2e-3)


def neck_stiffness(stage: Stage) -> float:
    """Rotational stiffness of a neck of a leg; all are alike."""
    found = [1.0 / np.linalg.inv(s.stiffness)[2, 2] for s in hinge_springs(stage)]
    assert found == pytest.approx([found[0]] * len(found), rel=0.02)
    return float(np.mean(found))


@pytest.mark.parametrize(
    ("stage", "links"),
    [
        (parallelogram(ParallelogramParameters(leg=BAR)), 4.0),
        (double_parallelogram(DoubleParallelogramParameters(leg=BAR)), 2.0),
        (compound_parallelogram(DoubleParallelogramParameters(leg=BAR)), 4.0),
        (gantry(GantryParameters(leg=BAR)), 16.0),
    ],
    ids=lambda value: value.name if isinstance(value, Stage) else "",
)
def test_stiffness_of_notches(stage: Stage, links: float) -> None:
    """A leg of two necks k is a link of 2 k/l^2."""
    found = analyse(stage, lumped_system(stage)).axes[0].input_stiffness
    # necks give way across as well, which links do not, and roots shift where they turn
    expected = links * neck_stiffness(stage) / BAR.neck_distance**2
    assert found == pytest.approx(expected, rel=0.03)


def test_a_gantry_does_not_turn_and_its_axes_do_not_see_each_other() -> None:
    stage = gantry(GantryParameters())
    static = static_displacements(lumped_system(stage), {"x": 0.4e-3})
    assert abs(static.readings["y"]) < 1e-5 * static.readings["x"]
    assert abs(static.readings["yaw"]) < 1e-7
    # two of its legs held by a stage that is not its own image, and it would
    half = replace(stage, hinges=tuple(h for h in stage.hinges if not h.name.startswith("top")))
    held = replace(half, bodies=tuple(b for b in stage.bodies if not b.name.startswith("top")))
    lame = static_displacements(lumped_system(held), {"x": 0.4e-3})
    assert abs(lame.readings["yaw"]) > 100.0 * abs(static.readings["yaw"])


def test_opposed_drives_share_the_work_of_an_axis() -> None:
    coil = VoiceCoil(largest_force=3.0)
    one, two = (gantry(GantryParameters(actuator=coil, opposed=flag)) for flag in (False, True))
    assert two.axis("y").moved_by == ("y", "y-opposed")
    assert check(two) == ()
    alone = static_forces(lumped_system(one), {"y": 2.6})
    both = static_forces(lumped_system(two), {"y": 1.3, "y-opposed": 1.3})
    # half of the force stretches the legs to the platform from either side
    assert both.readings["y"] == pytest.approx(alone.readings["y"], rel=2e-3)


# ------------------------------------------------------------------------------- across the motion


def with_load(stage: Stage) -> Stage:
    """Add a force on the platform across the motion."""
    low, under = (stage.body(n).outline.points[0][1] for n in ("platform", "base"))
    load = Force(
        name="load",
        pushes="platform",
        reacts="base",
        at=((0.0, low), (0.0, under)),
        direction=0.5 * math.pi,
        largest_force=1.0,
    )
    return replace(stage, drives=(*stage.drives, load), axes=())


def across_rigid(stage: Stage, way: float, load: float = 0.0) -> float:
    """Motion of the platform across [m], by rigid bodies with finite rotations."""
    model = nonlinear(mechanism(with_load(stage)))
    start = None
    for part in (0.25, 0.5, 0.75, 1.0):
        found = equilibrium(model, {"x": part * way}, forces={"load": part * load}, start=start)
        start = found.q
    return float(model.reading("x", found.q)[..., 1].reshape(-1)[0])


@pytest.fixture(scope="module")
def notched() -> Stage:
    return double_parallelogram(DoubleParallelogramParameters(leg=BAR))


def test_a_double_parallelogram_on_notches_goes_straight_and_a_single_one_does_not(
    notched: Stage,
) -> None:
    way = 1.1e-3
    single = parallelogram(ParallelogramParameters(leg=BAR))
    sag = way**2 / (2.0 * BAR.neck_distance)
    assert across_rigid(single, way) == pytest.approx(-sag, rel=0.02)
    assert abs(across_rigid(notched, way)) < 1e-3 * sag


@pytest.mark.parametrize("way", [0.4e-3, 0.9e-3, 1.7e-3])
def test_a_double_parallelogram_on_notches_gives_way_where_it_has_moved(
    notched: Stage, way: float
) -> None:
    """x = p y^2/8 in addition: a way of P y^2/(8 k), as the secondary stage leaves its half."""
    load = 0.3
    first = across_rigid(notched, 0.0, load)
    found = across_rigid(notched, way, load) - across_rigid(notched, way) - first
    assert found == pytest.approx(load * way**2 / (8.0 * neck_stiffness(notched)), rel=0.03)


def test_a_compound_guide_gives_way_half_as_much(notched: Stage) -> None:
    way, load = 0.9e-3, 0.3
    compound = compound_parallelogram(DoubleParallelogramParameters(leg=BAR))
    one, two = (
        across_rigid(s, way, load) - across_rigid(s, way) - across_rigid(s, 0.0, load)
        for s in (notched, compound)
    )
    assert two == pytest.approx(0.5 * one, rel=0.01)


def test_levers_hold_the_secondary_stage(notched: Stage) -> None:
    linked = linked_parallelogram(
        LinkedParallelogramParameters(
            leg=BAR, link=Leg(notch=NOTCH, bar_length=6e-3), pivot=NOTCH, lever_width=6e-3
        )
    )
    # what the check says of one, as of a mechanism of pins, and not of the other
    assert [f.code for f in check(notched)] == ["free-motion"]
    assert check(linked) == ()
    system = lumped_system(linked)
    moved = static_displacements(system, {"x": 0.3e-3}).body_motion
    # the necks of the levers give way across, and the platform turns a little
    assert moved["secondary"][0] == pytest.approx(0.5 * moved["platform"][0], rel=0.03)
    # with the platform held, the secondary stage swings on its legs alone, or not at all
    free, held = (
        modes(s, drives="locked", count=1).frequency_hz[0] for s in (lumped_system(notched), system)
    )
    assert held > 5.0 * free
    way, load = 0.9e-3, 0.3
    loose, firm = (
        across_rigid(s, way, load) - across_rigid(s, way) - across_rigid(s, 0.0, load)
        for s in (notched, linked)
    )
    assert abs(firm) < 0.05 * loose


def test_impossible_levers_are_refused() -> None:
    refused: tuple[tuple[dict[str, Any], str], ...] = (
        ({"overhang": 5e-3}, "overhang"),
        ({"lever_width": 1e-3}, "lever_width"),
        ({"actuator_length": 20e-3}, "link.length"),
        ({"leg": replace(LEAF, notch=replace(LEAF.notch, leaf_length=11e-3))}, "leg.length"),
    )
    for changes, culprit in refused:
        with pytest.raises(StageError, match=culprit):
            LinkedParallelogramParameters(**changes)


# ----------------------------------------------- finite displacements of the mesh on leaves


SLENDER = Leg(notch=CornerFilleted(neck_thickness=NECK, notch_length=LENGTH, fillet_radius=0.25e-3))
COARSE = MeshSettings(order=4, neck_size=2.0)


class Followed:
    """A stage on its mesh over a part of its way, with and without a load across."""

    def __init__(self, stage: Stage, ways: Array, load: float = 0.0) -> None:
        # beams in plane stress, as the closed forms have them
        model = plane_model(stage, COARSE, plane="stress")
        continuum = model.problems[0].continuum
        probe, drive = stage.probes[0], stage.drives[0]
        motion = body_motion(continuum, stage, probe.body, (0.0, 0.0))
        row = drive_vector(continuum, stage, drive, patches(drive, stage.bodies))
        path = follow_drive(continuum, row, ways)
        #: Displacement x, y and rotation of the platform, shape (k, 3).
        self.motion = path.displacement @ motion.T
        self.stiffness = path.force / ways
        if load:
            other = follow_drive(continuum, row, ways, load=load * motion[1])
            #: Way across for a unit of load, at rest first.
            self.compliance = (other.displacement - path.displacement) @ motion[1] / load
            self.at_rest = float(motion[1] @ continuum.solve(motion[1]))
        continuum.release()


WAYS = np.array([0.03, 0.06, 0.1]) * LENGTH


@pytest.mark.slow
def test_a_parallelogram_on_leaves_goes_down_by_three_fifths() -> None:
    found = Followed(parallelogram(ParallelogramParameters(leg=SLENDER)), WAYS)
    # 1.3 % less length between the fillets shorten the bow by as much, the roots lengthen it
    assert found.motion[:, 1] == pytest.approx(BOW * WAYS**2 / LENGTH, rel=0.015)


@pytest.mark.slow
def test_a_double_parallelogram_on_leaves_loses_its_stiffness_across() -> None:
    stage = double_parallelogram(DoubleParallelogramParameters(leg=SLENDER, secondary_height=14e-3))
    found = Followed(stage, WAYS, load=0.4)
    # two thousandths of what a single one deviates
    assert np.all(np.abs(found.motion[:, 1]) < 1e-3 * -BOW * WAYS**2 / LENGTH)
    # E I/L^3 by the stiffness along, which has the roots and fillets of these leaves in it
    unit = found.stiffness[0] / STIFF
    lost = (0.25 * STRETCH - 0.5 * STIFFENING * BOW / STIFF) * (WAYS / LENGTH) ** 2 / unit
    assert found.compliance - found.at_rest == pytest.approx(lost, rel=0.03)
    # where it has moved by a tenth of its leaves, it is more than ten times as soft
    assert found.compliance[-1] > 10.0 * found.at_rest


@pytest.mark.slow
def test_levers_keep_the_stiffness_across() -> None:
    stage = linked_parallelogram(LinkedParallelogramParameters())
    ways = np.array([1e-3, 4e-3])  # up to a tenth of its leaves
    found = Followed(stage, ways, load=0.4)
    assert np.all(found.compliance < 1.3 * found.at_rest)
    # but the levers' arcs draw at the platform: it goes as straight as its linkage
    assert 2e-8 < abs(found.motion[0, 1]) < 2e-7


# ---------------------------------------------------------------------------------------- pivots


def couple(stage: Stage) -> Stage:
    """Put two opposite forces in the place of the drive, which turn the arm and do not shift it."""
    x, y = stage.drives[0].at[0]
    return replace(
        stage,
        axes=(),
        drives=tuple(
            Force(
                name=name,
                pushes="arm",
                reacts="base",
                at=((side * x, y), (side * x, y - 1e-3)),
                direction=side * 0.5 * math.pi,
                largest_force=1.0,
            )
            for name, side in (("up", 1.0), ("down", -1.0))
        ),
    )


def pivots(leaf: Leaf | CornerFilleted) -> list[tuple[Stage, PivotParameters, float, float]]:
    """Both pivots with the factors of E I/L in stiffness and of L/cos(alpha) in shift."""
    cart = CartwheelParameters(leaf=leaf, half_angle=0.7, centre_distance=2.3e-3)
    trapezoid = TrapezoidalPivotParameters(leaf=leaf, half_angle=0.6, centre_distance=9e-3)
    return [
        (cartwheel(cart), cart, 4.0, 1.0 / 30.0),
        (trapezoidal_pivot(trapezoid), trapezoid, 8.0, 1.0 / 15.0),
    ]


@pytest.mark.parametrize(
    ("stage", "p", "factor", "_shift"),
    pivots(Leaf(neck_thickness=NECK, leaf_length=17e-3, notch_depth=0.4e-3)),
    ids=["cartwheel", "trapezoidal"],
)
def test_stiffness_of_pivots(
    stage: Stage, p: PivotParameters, factor: float, _shift: float
) -> None:
    """Haringx (1949), Wittrick (1951): 4 (1 + 3 p + 3 p^2) E I/L of each leaf about the centre."""
    system = lumped_system(couple(stage), method="euler-bernoulli", plane="stress")
    turned = static_forces(system, {"up": 0.9, "down": 0.9}).body_motion["arm"]
    moment = 0.9 * 2.0 * stage.drives[0].at[0][0]
    ratio = p.centre_distance / p.leaf.length
    expected = factor * bending(stage) / p.leaf.length * (1.0 + 3.0 * ratio + 3.0 * ratio**2)
    # the leaves need forces to turn about the centre, without which it shifts as they stretch
    assert moment / turned[2] == pytest.approx(expected, rel=2e-3)
    # about the centre, which is the origin: the centre of mass goes round it
    centre = system.body("arm").centre
    assert turned[0] == pytest.approx(-turned[2] * centre[1], rel=2e-2)


def test_a_cross_spring_pivot_is_a_quarter_as_stiff_and_cannot_be_cut() -> None:
    """Haringx (1949): E I/L for each of two leaves that cross in their middles."""
    leaf = Leaf(neck_thickness=NECK, leaf_length=14e-3, notch_depth=0.4e-3)
    p = CartwheelParameters(leaf=leaf, half_angle=0.7, centre_distance=2.3e-3)
    joined = couple(cartwheel(p))
    long = replace(leaf, leaf_length=2.0 * p.radius)
    crossed = replace(
        joined,
        bodies=tuple(b for b in joined.bodies if b.name != "hub"),
        hinges=tuple(
            Hinge(
                name=name,
                bodies=("base", "arm"),
                at=(0.0, 0.0),
                direction=0.5 * math.pi - side * p.half_angle,
                profile=long,
            )
            for name, side in (("rising", 1.0), ("falling", -1.0))
        ),
    )
    system = lumped_system(crossed, method="euler-bernoulli", plane="stress")
    turned = static_forces(system, {"up": 0.9, "down": 0.9}).body_motion["arm"][2]
    stiffness = 1.8 * crossed.drives[0].at[0][0] / turned
    assert stiffness == pytest.approx(2.0 * bending(crossed) / long.leaf_length, rel=1e-6)
    assert "hinges-coincide" in {f.code for f in check(crossed)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stage", "p", "_factor", "shift"),
    pivots(CornerFilleted(neck_thickness=NECK, notch_length=17e-3, fillet_radius=0.25e-3)),
    ids=["cartwheel", "trapezoidal"],
)
def test_shift_of_the_centre_of_pivots(
    stage: Stage, p: PivotParameters, _factor: float, shift: float
) -> None:
    pure = couple(stage)
    model = plane_model(pure, COARSE, plane="stress")
    continuum = model.problems[0].continuum
    motion = body_motion(continuum, pure, "arm", (0.0, 0.0))
    path = follow_drive(continuum, motion[2], np.sin([0.03, 0.06]))
    y = body_path(continuum, pure, "arm", (0.0, 0.0), path.displacement)[-1, 1]
    continuum.release()
    ratio = p.centre_distance / p.leaf.length
    polynomial = 1.0 + 9.0 * ratio + 9.0 * ratio**2
    expected = shift * p.leaf.length * polynomial / math.cos(p.half_angle) * 0.06**2
    assert y == pytest.approx(-expected, rel=0.05)
