r"""Leaves that bend far, against the elastica, columns, pivots and solids of others.

The elastica of a cantilever with a force across at its tip (Bisshopp, Drucker, Q. Appl. Math. 3
(1945) 272) is evaluated with SciPy's elliptic integrals; a guided leaf is two of half its length,
end to end.

Evidence (Stages, tolerances, designs): leaves that bend far: elastica to $FL^2/EI=10$, guided leaf
to $0.4\,L$ (elliptic integrals) $10^{-5}$, its largest moment $3\cdot10^{-4}$; bent to a circle
$10^{-9}$; stiffness along (SciPy's boundary values) $2\cdot10^{-4}$; cross-spring pivot (Wittrick)
$3\cdot10^{-4}$

Evidence (Stages, tolerances, designs): parallelogram of leaves on 26 loads to $0.3\,L$ (CalculiX
solids of H. Su): motion 0.5 %, sag 2 %, rotation 3 %; double parallelogram to $0.2\,L$ (`plane`):
force 0.2 %, motion across 3 % [*slow*]
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from flexstage.base.arrays import Array
from flexstage.fem import follow_stroke, plane_model
from flexstage.hinges import CornerFilleted, Leaf, compliance, stress_rows
from flexstage.hinges.hinge_spring import held_leaf_stiffening
from flexstage.hinges.profile import Profile
from flexstage.lumped import (
    Mechanism,
    RigidBody,
    Sight,
    SpringHinge,
    equilibrium,
    lumped_system,
    mechanism,
    motion,
    nonlinear,
    stroke_path,
)
from flexstage.lumped.finite_rotation import NonlinearMechanism
from flexstage.lumped.leaf import Leaves, leaf_beam, leaves
from flexstage.stage.designs import design
from flexstage.stage.designs.parallelogram import ParallelogramParameters, parallelogram
from flexstage.stage.designs.pieces import Leg
from flexstage.system import analyse_axis, static_displacements

MODULUS, POISSON, WIDTH, LENGTH = 113e9, 0.31, 7.3e-3, 83e-3


def strip(thickness: float) -> Leaf:
    return Leaf(neck_thickness=thickness, leaf_length=LENGTH, notch_depth=1e-3)


def stiffness(profile: Profile, method: str = "timoshenko") -> Array:
    roots = (9e-3, 23e-3) if method == "wedge" else None
    return compliance(
        profile, MODULUS, POISSON, WIDTH, method=method, plane="stress", root_widths=roots
    ).stiffness


def one(profile: Profile, method: str = "timoshenko") -> Leaves:
    return leaves([leaf_beam(profile, MODULUS, POISSON, WIDTH)], stiffness(profile, method)[None])


def bending(thickness: float) -> float:
    return MODULUS * WIDTH * thickness**3 / 12.0


# thin enough not to stretch
THIN = LENGTH / 1000.0
EI = bending(THIN)


def elastica(load: float) -> tuple[float, float]:
    """Place of the tip over the length, for the root of F L2/EI."""
    m: float = brentq(
        lambda m: ellipk(m) - ellipkinc(math.asin(math.sqrt(0.5 / m)), m) - load,
        0.5 + 1e-14,
        1.0 - 1e-14,
        xtol=1e-15,
    )  # type: ignore[assignment]
    start = math.asin(math.sqrt(0.5 / m))
    across = 1.0 - 2.0 / load * (ellipe(m) - ellipeinc(start, m))
    return math.sqrt(2.0 * (2.0 * m - 1.0)) / load, float(across)


def body(name: str, x: float, *, fixed: bool = False) -> RigidBody:
    return RigidBody(name=name, mass=0.13, inertia=7e-5, centre=(x, 0.0), fixed=fixed)


def across_at_the_tip(direction: float) -> Sight:
    ends = ((LENGTH, 0.0), (LENGTH, 0.0))
    return Sight(name="push", bodies=(0, 1), points=ends, direction=direction)


def cantilever(thickness: float = THIN) -> NonlinearMechanism:
    profile = strip(thickness)
    hinge = SpringHinge(
        name="leaf",
        bodies=(0, 1),
        at=(0.5 * LENGTH, 0.0),
        direction=0.0,
        stiffness=stiffness(profile),
        leaf=leaf_beam(profile, MODULUS, POISSON, WIDTH),
        stress=stress_rows(profile, WIDTH, POISSON, "stress"),
    )
    return nonlinear(
        Mechanism(
            name="cantilever",
            bodies=(body("ground", 0.0, fixed=True), body("tip", LENGTH)),
            hinges=(hinge,),
            drives=(across_at_the_tip(0.5 * math.pi),),
        )
    )


@pytest.mark.parametrize("load", [1.0, 2.0, 5.0, 10.0])
def test_a_force_at_the_tip_bends_a_leaf_to_its_elastica(load: float) -> None:
    found = None
    for part in (0.25, 0.5, 0.75, 1.0):
        push = part * load * EI / LENGTH**2
        found = equilibrium(cantilever(), {}, forces={"push": push}, start=found)
    assert found is not None
    along, across = elastica(math.sqrt(load))
    assert found.q[1] / LENGTH == pytest.approx(across, rel=2e-6)
    assert 1.0 + found.q[0] / LENGTH == pytest.approx(along, rel=2e-6)


@pytest.mark.parametrize("angle", [0.5, 0.5 * math.pi, math.pi, 2.0 * math.pi])
def test_a_moment_bends_it_to_an_arc_as_far_as_the_full_circle(angle: float) -> None:
    element, state = one(strip(THIN)), None
    for turn in np.linspace(0.0, angle, 1 + math.ceil(4.0 * angle))[1:]:
        radius = LENGTH / turn
        place = (radius * math.sin(turn) - LENGTH, radius * (1.0 - math.cos(turn)), turn)
        state = element.solve(np.array([place]), state)
    assert state is not None
    moment = angle * EI / LENGTH
    assert state.force[0] * [LENGTH, LENGTH, 1.0] == pytest.approx(
        [0, 0, moment], abs=1e-9 * moment
    )
    assert element.energy(state) == pytest.approx(0.5 * moment * angle, rel=1e-12)
    assert element.section_forces(state)[0, :, 1] == pytest.approx(moment, rel=1e-9)


@pytest.mark.parametrize("way", [0.04, 0.08, 0.153, 0.2, 0.3, 0.4])
def test_a_guided_leaf_is_two_elasticas(way: float) -> None:
    """Force, moment at the root and sag; they are 20, 8 and 6 % above their linear ones at 0.4."""
    load: float = brentq(lambda a: elastica(a)[1] - way, 1e-3, 8.0)  # type: ignore[assignment]
    along, _ = elastica(load)
    element = one(strip(THIN))
    x, state = np.array([[(along - 1.0) * LENGTH, way * LENGTH, 0.0]]), None
    for _ in range(6):
        state = element.solve(x, state)
        tangent = element.tangent(state, x)
        x[0, 0] -= tangent.force[0, 0] / tangent.stiffness[0, 0, 0]
    assert state is not None
    assert x[0, 0] / LENGTH == pytest.approx(along - 1.0, rel=1e-5)
    force = load**2 * EI / (0.5 * LENGTH) ** 2
    assert state.force[0, 1] == pytest.approx(force, rel=1e-5)
    root = element.section_forces(state)[0, :, 1]
    assert root == pytest.approx(force * 0.5 * LENGTH * along * np.array([1.0, -1.0]), rel=3e-4)


def by_boundary_values(thickness: float, way: float, along: float) -> float:
    """Axial force of a guided leaf that stretches, by SciPy's collocation (lengths over LENGTH)."""
    stretch = bending(thickness) / (MODULUS * WIDTH * thickness * LENGTH**2)

    def rates(s: Array, state: Array, force: Array) -> Array:
        _, _, angle, _ = state
        c, n = np.cos(angle), np.sin(angle)
        longer = 1.0 + stretch * (force[0] * c + force[1] * n)
        return np.array([longer * c, longer * n, state[3], (force[0] * n - force[1] * c) * longer])

    def ends(a: Array, b: Array, _: Array) -> Array:
        return np.array([a[0], a[1], a[2], b[0] - along, b[1] - way, b[2]])

    s = np.linspace(0.0, 1.0, 81)
    guess = np.array([s, way * s**2 * (3 - 2 * s), 6 * way * s * (1 - s), 6 * way * (1 - 2 * s)])
    found = solve_bvp(
        rates, ends, s, guess, p=np.array([0.0, 12.0 * way]), tol=1e-7, max_nodes=9999
    )
    assert found.success
    return float(found.p[0])


@pytest.mark.parametrize("way", [0.08, 0.2, 0.4])
def test_a_bent_leaf_gives_way_along_as_a_stretched_elastica(way: float) -> None:
    """At L/t = 50: 0.779, 0.349 and 0.100 of EA/L. Three modes of the moment would keep 0.95."""
    thickness, step = LENGTH / 50.0, 1e-4
    ei = bending(thickness)
    # without shear, as the other has none
    element = one(strip(thickness), "euler-bernoulli")
    along: float = brentq(lambda x: by_boundary_values(thickness, way, x), 0.99 - way**2, 1.0)  # type: ignore[assignment]
    state = element.solve(np.array([[along - 1.0, way, 0.0]]) * [LENGTH, LENGTH, 1.0])
    assert abs(state.force[0, 0]) < 1e-3 * 12.0 * way * ei / LENGTH**2
    x = np.array([[(along - 1.0) * LENGTH, way * LENGTH, 0.0]])
    ours = element.tangent(state, x).stiffness[0, 0, 0] * LENGTH**3 / ei
    pair = [by_boundary_values(thickness, way, along + side * step) for side in (-1, 1)]
    assert ours == pytest.approx((pair[1] - pair[0]) / (2.0 * step), rel=2e-4)


FILLETED = CornerFilleted(neck_thickness=0.3e-3, notch_length=21e-3, fillet_radius=2.6e-3)
CUT_ON_ONE_SIDE = CornerFilleted(
    neck_thickness=0.3e-3, notch_length=9e-3, fillet_radius=0.4e-3, one_sided=True
)
SHORT = Leaf(neck_thickness=0.5e-3, leaf_length=0.6e-3, notch_depth=0.7e-3)


@pytest.mark.parametrize(
    ("profile", "method"),
    [
        *(
            (profile, method)
            for profile in (strip(0.4e-3), SHORT, FILLETED, CUT_ON_ONE_SIDE)
            for method in ("euler-bernoulli", "timoshenko", "wedge")
        ),
        (FILLETED, "finite-element"),
    ],
)
def test_at_rest_it_has_the_stiffness_of_the_hinge(profile: Profile, method: str) -> None:
    k, element = stiffness(profile, method), one(profile, method)
    found = element.tangent(element.at_rest(), np.zeros((1, 3))).stiffness[0]
    # from the end to the neck
    shift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5 * profile.length], [0.0, 0.0, 1.0]])
    scale = np.sqrt(np.outer(np.diag(k), np.diag(k)))
    assert np.all(np.abs(shift.T @ found @ shift - k) <= 1e-11 * scale)


@pytest.mark.parametrize(("crossing", "factor"), [(0.5, 2.0), (0.1273, 5.3337), (0.0, 8.0)])
def test_a_cross_spring_pivot_is_as_stiff_as_wittrick_says(crossing: float, factor: float) -> None:
    """K = 8 (1 - 3 l + 3 l^2) EI/L for two leaves (W. H. Wittrick, Aeronaut. Q. 2 (1951) 1)."""
    assert factor == pytest.approx(8.0 * (1.0 - 3.0 * crossing + 3.0 * crossing**2), rel=1e-4)
    profile = strip(THIN)
    directions = (0.25 * math.pi, 0.75 * math.pi)
    hinges = tuple(
        SpringHinge(
            name=f"{angle:.1f}",
            bodies=(0, 1),
            # from their crossing at the origin
            at=tuple((0.5 - crossing) * LENGTH * np.array([math.cos(angle), math.sin(angle)])),
            direction=angle,
            stiffness=stiffness(profile),
            leaf=leaf_beam(profile, MODULUS, POISSON, WIDTH),
        )
        for angle in directions
    )
    arm = 2.0 * LENGTH
    drives = tuple(
        Sight(name=name, bodies=(0, 1), points=((x, 0.0), (x, 0.0)), direction=0.5 * math.pi)
        for name, x in (("up", arm), ("down", -arm))
    )
    pivot = Mechanism(
        name="pivot",
        bodies=(body("ground", 0.0, fixed=True), body("arm", 0.0)),
        hinges=hinges,
        drives=drives,
    )
    push = 2e-3 * EI / LENGTH / (2.0 * arm)
    turned = equilibrium(nonlinear(pivot), {}, forces={"up": push, "down": -push}).q[2]
    assert 2.0 * arm * push / turned == pytest.approx(factor * EI / LENGTH, rel=3e-4)


# ------------------------------------------------------------------------------------ whole stages


def leaf_guide(length: float, thickness: float) -> Leg:
    profile = Leaf(neck_thickness=thickness, leaf_length=length, notch_depth=0.5e-3)
    return Leg(notch=profile)


@pytest.mark.parametrize(("length", "travel"), [(253e-3, 50e-3), (100e-3, 50e-3)])
def test_a_parallelogram_on_long_leaves_sags_by_millimetres(length: float, travel: float) -> None:
    guide = parallelogram(
        ParallelogramParameters(leg=leaf_guide(length, 1e-3), leg_spacing=3.0 * length)
    )
    # as thin lines, which the elastica is of
    thin = mechanism(guide, method="euler-bernoulli", plane="stress")
    path = stroke_path(thin, "x", "x", np.linspace(0.0, travel, 11))
    load: float = brentq(lambda a: elastica(a)[1] - travel / length, 1e-3, 8.0)  # type: ignore[assignment]
    sag = length * (1.0 - elastica(load)[0])
    assert path.across[-1] == pytest.approx(-sag, rel=3e-3)
    assert sag > 0.6 * travel**2 / length
    # and stiffens: the force is that of two guided leaves
    linear = path.drive_stiffness[0]
    stiffer = load**2 / (3.0 * travel / length)
    assert path.drive_force[-1] / (linear * travel) == pytest.approx(stiffer, rel=5e-3)
    # the tangent stiffness is the slope of the force
    slope = np.gradient(path.drive_force, path.displacement, edge_order=2)
    assert path.drive_stiffness[1:-1] == pytest.approx(slope[1:-1], rel=0.03)


def far_out(name: str, way: float) -> tuple[NonlinearMechanism, Array]:
    """A stage whose leaves are bent, and pulled and pressed a little."""
    model = nonlinear(mechanism(design(name)))
    path = stroke_path(model, "x", "x", np.linspace(0.0, way, 6))
    shake = np.random.default_rng(3).normal(size=model.order)
    return model, path.q[-1] + shake * np.tile([1e-7, 1e-7, 1e-5], model.order // 3)


@pytest.mark.parametrize("name", ["double-parallelogram", "gantry"])
def test_force_and_tangent_of_bent_leaves_are_derivatives_of_their_energy(name: str) -> None:
    model, q = far_out(name, 4e-3)
    steps = np.tile([1e-7, 1e-7, 1e-5], model.order // 3)

    def difference(of: object) -> Array:
        columns = [
            (of(q + h * e) - of(q - h * e)) / (2.0 * h)  # type: ignore[operator]
            for h, e in zip(steps, np.eye(q.size), strict=True)
        ]
        return np.stack(columns, axis=-1)

    force, tangent = model.force(q), model.tangent(q)
    scale = np.sqrt(np.diag(tangent))
    assert (
        np.abs((difference(model.potential_energy) - force) / scale).max()
        < 1e-5 * np.abs(force / scale).max()
    )
    error = (difference(model.force) - tangent) / np.outer(scale, scale)
    assert np.abs(error).max() < 1e-5


def test_it_does_not_matter_which_end_of_a_leaf_is_called_a() -> None:
    model, q = far_out("double-parallelogram", 4e-3)
    flip = np.diag([1.0, 1.0, -1.0])
    swapped = tuple(
        replace(
            h,
            bodies=h.bodies[::-1],
            direction=h.direction + math.pi,
            stiffness=flip @ h.stiffness @ flip,
        )
        for h in model.mechanism.hinges
    )
    other = nonlinear(replace(model.mechanism, hinges=swapped))
    assert other.potential_energy(q) == pytest.approx(model.potential_energy(q), rel=1e-10)
    scale = np.abs(model.force(q)).max()
    assert np.abs(other.force(q) - model.force(q)).max() < 1e-8 * scale


def test_stress_over_the_stroke_begins_as_in_the_linear_model() -> None:
    stage = design("double-parallelogram")
    path = stroke_path(stage, "x", "x", [0.0, 1e-6])
    linear = static_displacements(lumped_system(stage), {"x": 1e-6}).hinge_stress
    assert linear.keys() == path.hinge_stress.keys()
    for name, stress in linear.items():
        assert path.hinge_stress[name][1] == pytest.approx(stress, rel=1e-3)


def test_stress_of_a_bent_leaf_is_that_of_the_moment_at_its_root() -> None:
    """F x with the shorter arm of the elastica: 0.61 L at F L2/EI = 5."""
    model, state = cantilever(), None
    push = 5.0 * EI / LENGTH**2
    for part in (0.25, 0.5, 0.75, 1.0):
        state = equilibrium(model, {}, forces={"push": part * push}, start=state)
    assert state is not None
    along, _ = elastica(math.sqrt(5.0))
    stress = model.hinge_stress(state.q, state.leaves)["leaf"]
    # and along its tip it is pulled by what the force has in that direction
    pull = model.leaves.section_forces(state.leaves)[0, 1, 0]
    assert pull == pytest.approx(push * math.sin(state.q[2]), rel=1e-6)
    assert stress == pytest.approx(6.0 * push * along * LENGTH / (WIDTH * THIN**2), rel=1e-4)


def test_a_free_leaf_spring_keeps_its_energy() -> None:
    """A pendulum on a leaf, let go with its tip a fifth of the leaf's length aside."""
    model = cantilever(LENGTH / 150.0)
    start = equilibrium(model, {"push": 0.2 * LENGTH})
    stiffness = start.drive_stiffness["push"]
    period = 2.0 * math.pi * math.sqrt(model.mass[1] / stiffness)
    run = motion(model, np.arange(31) * period / 100.0, start.q, stages=2)
    assert np.abs(run.energy / run.energy[0] - 1.0).max() < 1e-10
    assert run.kinetic_energy.max() > 0.5 * run.energy[0]


@pytest.mark.slow
def test_a_double_parallelogram_strays_as_plane_finite_elements_do() -> None:
    """To a fifth of the leaves' length, in plane stress, where both have the same section."""
    stage = design("double-parallelogram")
    model = plane_model(stage, plane="stress")
    axis = replace(analyse_axis(model.system, model.system.axes[0]), input_displacement=6e-3)
    theirs = follow_stroke(model, axis, steps=7)
    ours = stroke_path(mechanism(stage, plane="stress"), "x", "x", theirs.displacement)
    assert ours.drive_force[-1] == pytest.approx(theirs.force[-1], rel=3e-3)
    # 0.67 um, which leaves that only shorten by their slopes would make 0.23
    assert ours.across[-1] == pytest.approx(theirs.across[-1], rel=0.05)


# ---------------------------------------------------------------------- solids of another programme

SU_LENGTH, SU_THICK, SU_WIDE, SU_APART = 0.25, 5e-3, 50e-3, 0.15
SU_MODULUS, SU_POISSON = 210e9, 0.3
SU_EI = SU_MODULUS * SU_WIDE * SU_THICK**3 / 12.0
# their solids of 3 mm over those of 10 mm, at Ay = 5 (fea_models/3d/temp, mesh refinement)
FINER = np.array([5.7723 / 5.7117, 48.6102 / 48.3180, 1.0])
# The rotation is that of two corner nodes, where the roots of the leaves dent the stage: what it
# reads beside the rotation, for a unit of Ay, from the two smallest loads.
CORNERS = 3.77e-6


#: Ay, ux, uy, phi by Ax and B: loads at the middle of the inner face of the stage in EI/L^2, the
#: couple B in EI/L (EI without plane strain), motion in lengths of the leaves. CalculiX, solids
#: of 10 mm (H. Su, github.com/haijunsu-osu/parallelogram_model_comparison at ca92a0e).
SOLIDS = {
    (0.0, 0.0): """
        0 0 0 -0
        0.5 -0.00024305 0.020062 4.8967e-05
        1 -0.00097028 0.040077 0.00010278
        2 -0.0038507 0.079774 0.00024419
        3 -0.0085533 0.11874 0.00046129
        4 -0.014942 0.15665 0.00078813
        5 -0.022847 0.19327 0.0012551
        6 -0.03208 0.22842 0.0018879
        7 -0.042433 0.26193 0.0027097
        8 -0.053729 0.29377 0.0037355
        9 -0.06578 0.32392 0.0049819
        10 -0.078428 0.35239 0.0064566
        12 -0.10496 0.40448 0.010124
        14 -0.13243 0.4506 0.014768
        16 -0.16022 0.49145 0.020413
        18 -0.18785 0.52761 0.026988
        20 -0.21522 0.55988 0.034597
    """,
    (-5.0, 1.0): """
        0 -8.5894e-05 0.0001131 0.00018389
        0.5 -0.00051573 0.026607 0.00025317
        1 -0.0017975 0.053058 0.00034677
        2 -0.0068289 0.10514 0.00065123
        3 -0.014911 0.15553 0.001181
        4 -0.025608 0.20343 0.002003
        5 -0.038566 0.24884 0.0031851
        6 -0.05322 0.29115 0.004758
        7 -0.06918 0.33044 0.006754
        8 -0.086105 0.36683 0.0091995
        9 -0.1034 0.39995 0.012029
        10 -0.12169 0.43146 0.01548
        12 -0.1583 0.48658 0.023646
        14 -0.1945 0.53322 0.0334
        16 -0.23177 0.575 0.045921
        18 -0.26808 0.6109 0.06016
        20 -0.30343 0.6421 0.076002
    """,
    (10.0, 3.0): """
        0 0.00017176 0.00019328 0.00055078
        0.5 5.9024e-05 0.013777 0.0005898
        1 -0.00027318 0.027326 0.00063797
        2 -0.0015967 0.054416 0.00076784
        3 -0.0037802 0.081273 0.00095097
        4 -0.0068264 0.10804 0.0012001
        5 -0.010639 0.13413 0.0015204
        6 -0.01524 0.15992 0.0019264
        7 -0.020561 0.1852 0.0024252
        8 -0.026588 0.21002 0.0030299
        9 -0.033203 0.2341 0.0037402
        10 -0.040498 0.25785 0.0045772
        12 -0.056118 0.30199 0.0065682
        14 -0.073521 0.34376 0.0091046
        16 -0.091956 0.38227 0.012155
        18 -0.11133 0.41811 0.015781
        20 -0.13125 0.4512 0.019972
    """,
}


@cache
def su_stage() -> NonlinearMechanism:
    leaf = Leaf(neck_thickness=SU_THICK, leaf_length=SU_LENGTH, notch_depth=SU_THICK)
    # both ends hold the width of a leaf, which is neither in plane stress nor in plane strain
    held = held_leaf_stiffening(SU_WIDE, SU_LENGTH, SU_POISSON)
    beam = leaf_beam(leaf, SU_MODULUS, SU_POISSON, SU_WIDE)
    beam = replace(beam, bending=beam.bending / held)
    c = compliance(
        leaf, SU_MODULUS, SU_POISSON, SU_WIDE, method="timoshenko", plane="stress"
    ).matrix
    bent = np.array([0.0, SU_LENGTH**3 / 12.0, SU_LENGTH]) / SU_EI
    k = np.linalg.inv(c - np.diag(bent) * (1.0 - 1.0 / held))
    hinges = tuple(
        SpringHinge(
            name=f"{side}",
            bodies=(0, 1),
            at=(0.5 * SU_LENGTH, 0.5 * side * SU_APART),
            direction=0.0,
            stiffness=k,
            leaf=beam,
        )
        for side in (-1, 1)
    )

    def push(name: str, y: float, direction: float) -> Sight:
        at = (SU_LENGTH, y)
        return Sight(name=name, bodies=(0, 1), points=(at, at), direction=direction)

    drives = (
        push("x", 0.0, 0.0),
        push("y", 0.0, 0.5 * math.pi),
        push("below", -10e-3, 0.0),
        push("above", 10e-3, 0.0),
    )
    bodies = (body("ground", 0.0, fixed=True), body("stage", SU_LENGTH))
    return nonlinear(Mechanism(name="Su", bodies=bodies, hinges=hinges, drives=drives))


def along_the_loads(ax: float, b: float, farthest: float) -> tuple[Array, Array]:
    """Motion of the stage for each Ay, ours and theirs, as long as theirs stays within."""
    rows = np.array(SOLIDS[ax, b].split(), dtype=float).reshape(-1, 4)
    unit, couple = SU_EI / SU_LENGTH**2, b * SU_EI / SU_LENGTH / 20e-3
    ours, theirs, state = [], [], None
    for ay, *motion_of_theirs in rows[np.abs(rows[:, 2]) <= farthest]:
        forces = {"x": ax * unit, "y": ay * unit, "below": couple, "above": -couple}
        state = equilibrium(su_stage(), {}, forces=forces, start=state)
        ours.append(state.q / [SU_LENGTH, SU_LENGTH, 1.0] + [0.0, 0.0, CORNERS * ay])
        theirs.append(motion_of_theirs * FINER)
    return np.array(ours), np.array(theirs)


@pytest.mark.parametrize(("ax", "b"), SOLIDS)
def test_a_parallelogram_moves_as_solids_do(ax: float, b: float) -> None:
    """Beyond 0.42 of its length, theirs flattens as it bends, which the model leaves out."""
    ours, theirs = along_the_loads(ax, b, 1.0)
    assert len(ours) == 17
    way, error = np.abs(theirs[:, 1]), np.abs(ours / np.where(theirs, theirs, np.nan) - 1.0)
    near, far = (way >= 0.02) & (way <= 0.3), (way > 0.3) & (way < 0.42)
    assert np.count_nonzero(near) >= 7
    assert np.all(error[near].max(axis=0) <= [0.02, 0.005, 0.03])
    assert np.all(error[far].max(axis=0) <= [0.02, 0.01, 0.03])
    assert np.all(np.median(error[way > 0.42], axis=0) <= [0.02, 0.012, 0.04])
