"""Bridge and rhombus amplifiers against the closed forms of the literature."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flexstage.fem import MeshSettings, superelement_model
from flexstage.hinges import CornerFilleted, Leaf, RightCircular
from flexstage.lumped import hinge_springs, lumped_system
from flexstage.quantities.material import Material
from flexstage.stage import Stage, check
from flexstage.stage.designs.amplifiers import BridgeParameters, RhombusParameters, bridge, rhombus
from flexstage.stage.designs.pieces import round_leaf
from flexstage.stage.drive import StackActuator
from flexstage.system import MechanicalSystem, analyse_axis, probe_stiffness

#: Ratios are those of finer meshes to 2e-5.
MESH = MeshSettings(order=3, neck_size=1.2, grading=0.75)

# The closed forms were derived here by energy, and compared with those of others as M. Ling et al.,
# Mech. Syst. Signal Process. 119 (2019), eq. 19 to 24, quote them. These were read in a public
# program that evaluates them; the originals were not at hand.
NOTCH = RightCircular(neck_thickness=0.37e-3, radius=1.1e-3)
OFFSETS = (0.7e-3, 1.3e-3, 2.1e-3, 3.7e-3)


def unguided(stage: Stage) -> Stage:
    """Leave the guide of the output out, as the closed forms do."""
    return replace(stage, hinges=tuple(h for h in stage.hinges if not h.name.startswith("guide")))


def ratio(system: MechanicalSystem) -> float:
    axis = analyse_axis(system, system.axes[0])
    return axis.output_displacement / axis.input_displacement


def bridge_of(offset: float) -> tuple[BridgeParameters, Stage]:
    p = BridgeParameters(link_length=11.3e-3, link_offset=offset, notch=NOTCH, thickness=9e-3)
    return p, bridge(p)


def compliances(stage: Stage, *names: str) -> list[np.ndarray]:
    """Return compliance along, across and in rotation about the neck of hinges."""
    found = {s.hinge.name: s.stiffness for s in hinge_springs(stage)}
    return [np.linalg.inv(found[name]) for name in names]


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_bridge_has_the_ratio_of_its_necks(offset: float) -> None:
    p, stage = bridge_of(offset)
    near, far = compliances(stage, "upper-left-in", "upper-left-out")
    found = ratio(lumped_system(unguided(stage)))
    lx, ly = p.link_length, offset
    # the load turns each notch about its centre of compliance, which its two different roots shift
    # off the neck, towards the thinner body, by 30 um here
    shifted = lx + near[1, 2] / near[2, 2] - far[1, 2] / far[2, 2]
    assert abs(shifted - lx) < 0.01 * lx
    turning, stretch = 1.0 / near[2, 2] + 1.0 / far[2, 2], near[0, 0] + far[0, 0]
    # upper and lower limbs differ, as output and base are not equally wide behind the roots
    assert found == pytest.approx(shifted * ly / (ly**2 + turning * stretch), rel=3e-4)
    # eq. 23 there, for links with parallel necks: without the shift, half a percent of the length
    loss = turning * stretch
    assert found == pytest.approx(lx * ly / (ly**2 + loss), rel=0.01)
    # eq. 19, after H.-W. Ma et al., Sens. Actuators A 132 (2006) 730: the link stretches along
    # the line of its necks, so that the loss shrinks by cos^2 of its angle (by 10 % at most, of a
    # loss that is least there)
    length, angle = math.hypot(lx, ly), math.atan2(ly, lx)
    c, s = math.cos(angle), math.sin(angle)
    slanted = length**2 * s * c / (length**2 * s**2 + loss * c**2)
    assert found == pytest.approx(slanted, rel=0.012)
    # and pins, as J. Pokines, E. Garcia, Smart Materials and Structures 7 (1998) 105, are a bound
    assert found < lx / ly


def test_the_offset_of_the_largest_ratio() -> None:
    # d/d l_y of l_x l_y/(l_y^2 + c) is 0 at l_y^2 = c, where the ratio is half that of pins
    _, stage = bridge_of(1.3e-3)
    near, far = compliances(stage, "upper-left-in", "upper-left-out")
    best = math.sqrt((1.0 / near[2, 2] + 1.0 / far[2, 2]) * (near[0, 0] + far[0, 0]))
    below, at, above = (
        ratio(lumped_system(unguided(bridge_of(f * best)[1]))) for f in (0.6, 1.0, 1.6)
    )
    assert at > max(below, above)
    assert at == pytest.approx(11.3e-3 / best / 2.0, rel=0.01)


@pytest.mark.parametrize("offset", OFFSETS)
def test_the_guide_takes_its_part_of_a_bridge_s_ratio(offset: float) -> None:
    p, stage = bridge_of(offset)
    neck, leaf = compliances(stage, "upper-left-in", "guide-left-inner")
    held = probe_stiffness(lumped_system(unguided(stage)), "y", drives="locked")
    # four limbs, two by two in a row, each a link on two notches whose far end is held: by energy,
    # 1/k = l_x^2/(2 k_theta + k_u l_y^2/2) + 2/k_v
    k_u, k_v, k_theta = 1.0 / np.diag(neck)
    limb = p.link_length**2 / (2.0 * k_theta + 0.5 * k_u * offset**2) + 2.0 / k_v
    assert held == pytest.approx(1.0 / limb, rel=0.02)
    # four leaves that keep their direction
    guide = 4.0 / leaf[1, 1]
    free, loaded = (ratio(lumped_system(s)) for s in (unguided(stage), stage))
    assert loaded == pytest.approx(free * held / (held + guide), rel=1e-4)


@pytest.mark.parametrize(("offset", "low", "high"), [(1.3e-3, 0.02, 0.05), (3.7e-3, -0.001, 0.001)])
def test_what_the_bodies_of_a_bridge_take(offset: float, low: float, high: float) -> None:
    # Finite elements have what the closed form leaves out: links, blocks and base bend. That is in
    # series with the necks' stretching, whose part in the loss grows as 1/l_y^2: 8-fold here.
    _, stage = bridge_of(offset)
    lumped, condensed = ratio(lumped_system(stage)), ratio(superelement_model(stage, MESH).system)
    assert low < 1.0 - condensed / lumped < high


@pytest.mark.parametrize("degrees", [3.1, 5.3, 8.7, 14.2])
def test_a_rhombus_has_the_ratio_of_its_beams(degrees: float) -> None:
    length, thickness = 13.3e-3, 0.47e-3
    beam = Leaf(neck_thickness=thickness, leaf_length=length, notch_depth=0.6e-3)
    angle = math.radians(degrees)
    stage = rhombus(RhombusParameters(beam=beam, beam_angle=angle, guide=round_leaf(23e-3)))
    assert not [issue for issue in check(stage) if issue.severity == "error"]
    found = ratio(lumped_system(unguided(stage)))
    c, s = math.cos(angle), math.sin(angle)
    # bending against stretching of a beam built in at both ends; Young's modulus and width cancel
    q = (thickness / length) ** 2
    energy = (1.0 - q) * s * c / (s**2 + q * c**2)
    # the model has the bodies next to the roots as well, which stretch more than they turn: they
    # take 0.4 % at the least angle
    assert energy * (1.0 - 5e-3) < found < energy
    # Ling et al. (2016), eq. 21 of the quoting paper: q is a thousandth
    assert found == pytest.approx(s * c / (s**2 + q * c**2), rel=7e-3)
    # Two hinges of E I/l, which is what eq. 19 there puts in place of the beam, are six times too
    # soft: so much too large as Ling et al. say that earlier models are at small angles.
    earlier = s * c / (s**2 + q / 6.0 * c**2)
    assert 1.0 / math.tan(angle) > earlier > energy
    assert earlier / found - 1.0 == pytest.approx(5.0 / 6.0 * q / (math.tan(angle) ** 2), rel=0.3)


@pytest.mark.parametrize("degrees", [5.3, 8.7])
def test_finite_elements_of_a_rhombus(degrees: float) -> None:
    p = RhombusParameters(beam_angle=math.radians(degrees))
    stage = unguided(rhombus(p))
    lumped, condensed = ratio(lumped_system(stage)), ratio(superelement_model(stage, MESH).system)
    # blocks that give at the roots of the beams: 3 % where the beams are least inclined
    assert 0.97 < condensed / lumped < 0.995


def test_the_rhombus_that_comes_near_an_amplifier_that_one_buys() -> None:
    """APA300ML: arms of 1.40 mm, 9.97 deg, 20 mm wide (its STEP; see the Ansys comparison)."""
    steel = Material(name="steel", youngs_modulus=193e9, poissons_ratio=0.31, density=7750.0)
    run, rise = 34.555e-3 - 7.106e-3, 12.596e-3 - 7.768e-3
    arm = Leaf(neck_thickness=1.4e-3, leaf_length=math.hypot(run, rise), notch_depth=0.7e-3)
    p = RhombusParameters(
        beam=arm,
        beam_angle=math.atan2(rise, run),
        actuator_length=2.0 * 34.555e-3,
        actuator_width=12e-3,
        input_block_length=4.8e-3,
        guide=round_leaf(60e-3),
        thickness=20e-3,
        material=steel,
        actuator=StackActuator(free_stroke=60e-6, stiffness=75.4e6),
    )
    stage = unguided(rhombus(p))
    lumped, condensed = lumped_system(stage), superelement_model(stage).system
    # Its super-element by Ansys: ratio 5.075, 1.753 N/um at the output with the stacks in place,
    # which are 75.4 N/um. Our arms end in corners where its own run out into rounded ends, and how
    # far its pocket reaches is not known: stiffness 6 and 20 % above, ratio 4 % to either side.
    assert ratio(lumped) == pytest.approx(5.075, rel=0.04)
    assert ratio(condensed) == pytest.approx(5.075, rel=0.04)
    assert ratio(condensed) < 5.075 < ratio(lumped)
    assert probe_stiffness(condensed, "y", drives="in place") == pytest.approx(1.753e6, rel=0.08)
    assert probe_stiffness(lumped, "y", drives="in place") == pytest.approx(1.753e6, rel=0.22)


def test_fillets_shorten_the_beams_of_a_rhombus() -> None:
    """Between the beam of full length and that of the part between its fillets."""
    length, radius, thickness, angle = 13.3e-3, 0.8e-3, 0.47e-3, 0.1
    beam = CornerFilleted(neck_thickness=thickness, notch_length=length, fillet_radius=radius)
    p = RhombusParameters(beam=beam, beam_angle=angle, guide=round_leaf(23e-3))
    found = ratio(lumped_system(unguided(rhombus(p))))
    t = math.tan(angle)
    full, flat = (t / (t**2 + (thickness / x) ** 2) for x in (length, length - 2.0 * radius))
    assert flat < found < full
