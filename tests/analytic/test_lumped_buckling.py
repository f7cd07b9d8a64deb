r"""Buckling of rigid bodies on springs and leaves, against columns whose load is known.

Evidence (Stages, tolerances, designs): buckling, lumped: leaf (Euler, Timoshenko)
$2\cdot10^{-6}$; with large fillets (beam elements) 0.02 %; notch ($k/h$) 0.1 %; bar on two notches
($2k/L$) 2 %

Evidence (Stages, tolerances, designs): the same (`plane`): four leaf stages at full stroke 1.8 %,
bar 0.6 and 1.7 %; *consistency* [*slow*]
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.elasticity.loaded import buckling
from flexstage.fem import plane_model
from flexstage.fem.stroke import _drive_row, _two_bar_rig, bar_buckling_load, two_notch_bars
from flexstage.hinges import CornerFilleted, Leaf, RightCircular
from flexstage.hinges.profile import Profile
from flexstage.lumped import hinge_springs, lumped_system, mechanism, nonlinear
from flexstage.lumped.large_displacement import lumped_buckling
from flexstage.stage import Body, Force, Hinge, Loop, Stage
from flexstage.stage.designs import design
from flexstage.system import analyse_axis
from tests.hinged_bars import MATERIAL

THICK, NECK, LONG = 7.3e-3, 0.31e-3, 19.7e-3
LEAF = Leaf(neck_thickness=NECK, leaf_length=LONG, notch_depth=1.1e-3)
EI = MATERIAL.youngs_modulus / (1.0 - MATERIAL.poissons_ratio**2) * THICK * NECK**3 / 12.0


def _box(x0: float, x1: float, y0: float, y1: float) -> Loop:
    return Loop(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def column(
    profile: Profile, head: float, places: tuple[float, ...] = (0.0,), held: bool = False
) -> Stage:
    """A block of a height on upright notches, pressed down in the middle of its top."""
    half, wide = 0.5 * profile.length, 6e-3 + max(map(abs, places))
    drives = [
        Force(
            name="press",
            pushes="head",
            reacts="ground",
            at=((0.0, half + head), (0.0, -half - 9e-3)),
            direction=-0.5 * math.pi,
            largest_force=1.0,
        )
    ]
    if held:
        drives.append(
            Force(
                name="side",
                pushes="head",
                reacts="ground",
                at=((-wide, half + 0.5 * head), (-wide, -half - 1e-3)),
                direction=0.0,
                largest_force=1.0,
            )
        )
    return Stage(
        name="column",
        thickness=THICK,
        material=MATERIAL,
        bodies=(
            Body(name="ground", outline=_box(-wide, wide, -half - 9e-3, -half), fixed=True),
            Body(name="head", outline=_box(-wide, wide, half, half + head)),
        ),
        hinges=tuple(
            Hinge(
                name=f"h{k}",
                bodies=("ground", "head"),
                at=(x, 0.0),
                direction=0.5 * math.pi,
                profile=profile,
            )
            for k, x in enumerate(places)
        ),
        drives=tuple(drives),
    )


def load(stage: Stage, *held: str) -> float:
    """Load at which it buckles, the drive that presses it free to follow, by beams alone."""
    forces = {"press": 1.0} | dict.fromkeys(held, 0.0)
    return lumped_buckling(stage, forces, method="euler-bernoulli", plane="strain")


def test_a_leaf_under_a_tall_block_is_a_column_with_a_rigid_end() -> None:
    """Timoshenko and Gere, Theory of Elastic Stability, sec. 2.1: k a tan(k l) = 1."""
    head = 8.9e-3
    k: float = brentq(lambda k: k * head * math.tan(k * LONG) - 1.0, 1.0, 0.499 * math.pi / LONG)  # type: ignore[assignment]
    assert load(column(LEAF, head)) == pytest.approx(EI * k**2, rel=1e-6)


@pytest.mark.parametrize("method", ["wedge", "timoshenko"])
def test_a_leaf_in_tension_buckles_where_shear_makes_it(method: str) -> None:
    """A beam that shears does so at G A/1.2 (J. M. Kelly, J. Eng. Mech. 129 (2003) 1363)."""
    # as high as their bodies are wide, its roots turn about points behind its ends
    stage = column(Leaf(neck_thickness=NECK, leaf_length=50e-3, notch_depth=5.8e-3), 8.9e-3)
    shear = MATERIAL.youngs_modulus / (2.0 * (1.0 + MATERIAL.poissons_ratio))
    for plane in ("stress", "strain"):
        factor = lumped_buckling(stage, {"press": -1.0}, method=method, plane=plane)  # type: ignore[arg-type]
        assert factor == pytest.approx(shear * THICK * NECK / 1.2, rel=0.04)


def test_two_leaves_far_apart_guide_their_block() -> None:
    """Between ends that stay parallel a column bears pi^2 E I/l^2."""
    euler = math.pi**2 * EI / LONG**2
    far = column(LEAF, 8.9e-3, (-0.4, 0.4))
    assert load(far) == pytest.approx(2.0 * euler, rel=1e-6)


def test_a_leaf_between_ends_at_rest_buckles_by_itself() -> None:
    """Held aside as well, its block cannot move: 4 pi^2 E I/l^2."""
    euler = 4.0 * math.pi**2 * EI / LONG**2
    far = column(LEAF, 8.9e-3, (-0.4, 0.4), held=True)
    assert load(far, "side") == pytest.approx(2.0 * euler, rel=5e-6)


FILLETED = CornerFilleted(neck_thickness=NECK, notch_length=LONG, fillet_radius=2.7e-3)


def _by_elements(guided: bool, count: int = 400) -> float:
    """Load of a column as high as `FILLETED` by beam elements, its top held or free to move aside.

    Each is uniform, with the stiffness and geometric stiffness of J. S. Przemieniecki, Theory of
    Matrix Structural Analysis (1968), eqs. 5.79 and 15.8.
    """
    size, r = LONG / count, FILLETED.fillet_radius
    x = size * (np.arange(count) + 0.5)
    into = np.clip(np.abs(x - 0.5 * LONG) - 0.5 * FILLETED.flat_length, 0.0, None)
    height = NECK + 2.0 * (r - np.sqrt(r**2 - into**2))
    elastic, geometric = np.zeros((2, 2 * count + 2, 2 * count + 2))
    a, b, c, d = 12.0, 6.0 * size, 4.0 * size**2, 2.0 * size**2
    bending = np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]]) / size**3
    a, b, c, d = 1.2 / size, 0.1, 2.0 * size / 15.0, -size / 30.0
    stress = np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]])
    for k in range(count):
        at = slice(2 * k, 2 * k + 4)
        elastic[at, at] += EI * (height[k] / NECK) ** 3 * bending
        geometric[at, at] += stress
    free = [*range(2, 2 * count), *([2 * count] if guided else [])]
    some = np.ix_(free, free)
    return 1.0 / float(eigh(geometric[some], elastic[some], eigvals_only=True)[-1])


@pytest.mark.parametrize("guided", [True, False])
def test_a_leaf_with_large_fillets_bends_where_it_is_thin(guided: bool) -> None:
    """Between ends that stay parallel, and that do not move at all; 64 % above a plain leaf's."""
    far = column(FILLETED, 8.9e-3, (-0.4, 0.4), held=not guided)
    held = () if guided else ("side",)
    assert load(far, *held) == pytest.approx(2.0 * _by_elements(guided), rel=2e-4)


def test_a_block_on_a_short_notch_is_an_inverted_pendulum() -> None:
    """P = k/h, with the height over a neck that is short beside it; pulled, it stands."""
    notch = RightCircular(neck_thickness=0.21e-3, radius=0.4e-3)
    stage = column(notch, 61e-3)
    stiffness = hinge_springs(stage)[0].stiffness[2, 2]
    assert lumped_buckling(stage, {"press": 1.0}) == pytest.approx(
        stiffness / (61e-3 + 0.4e-3), rel=2e-3
    )
    assert lumped_buckling(stage, {"press": -1.0}) == math.inf


def test_a_bar_between_two_notches_sways_as_a_rigid_one() -> None:
    """Ends that stay parallel: P = 2 k/L; what deflects within the notches, 2 of 15 parts, adds."""
    rig = _two_bar_rig(design("parallelogram"), "left-leg")
    spring, other = (s for s in hinge_springs(rig) if s.hinge.name.endswith("0"))
    length = math.dist(spring.hinge.at, other.hinge.at)
    rigid = 2.0 * spring.stiffness[2, 2] / length
    assert 0.5 * lumped_buckling(rig, {"press": 1.0}) == pytest.approx(rigid, rel=0.02)


def test_the_tangent_of_finite_rotations_is_singular_there() -> None:
    """At the load that is found the nonlinear model has no stiffness left."""
    stage = column(RightCircular(neck_thickness=0.21e-3, radius=0.4e-3), 31e-3)
    factor = lumped_buckling(stage, {"press": 1.0})
    model = nonlinear(mechanism(stage))
    _, gradient, hessian = model.elongation("press", np.zeros(model.order))
    q = np.linalg.solve(model.tangent(np.zeros(model.order)), gradient).astype(np.float64)
    scale = 1.0 / np.sqrt(np.diag(model.tangent(np.zeros(model.order))))
    lowest = []
    for load in (0.0, factor):
        tangent = model.tangent(np.multiply(load, q)) - load * hessian
        lowest.append(np.linalg.eigvalsh(tangent * np.outer(scale, scale))[0])
    # what a notch adds by its length is not in that model
    assert abs(lowest[1]) < 5e-3 * lowest[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallelogram", "vgtu-piezo"])
def test_bars_between_two_notches_bear_what_finite_elements_say(name: str) -> None:
    stage = design(name)
    body = two_notch_bars(stage)[0]
    # the block is pressed down and free to move aside, its drive too
    rig = _two_bar_rig(stage, body)
    assert 0.5 * lumped_buckling(rig, {"press": 1.0}) == pytest.approx(
        bar_buckling_load(stage, body), rel=0.03
    )


def test_a_block_that_nothing_holds_has_no_state_to_buckle_from() -> None:
    stage = column(LEAF, 8.9e-3)
    with pytest.raises(ModelError, match="without deforming a hinge"):
        lumped_buckling(replace(stage, hinges=()), {"press": 1.0})


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["trapezoidal-pivot", "cartwheel", "double-parallelogram", "linked-parallelogram"]
)
def test_stages_of_leaves_buckle_as_plane_finite_elements_do(name: str) -> None:
    """Each at the forces of its own full stroke; in plane stress, where their leaves are alike."""
    stage = design(name)
    model = plane_model(stage, plane="stress")
    axis = model.system.axes[0]
    state = model.problems[0].basis @ analyse_axis(model.system, axis).static.q
    row = _drive_row(model, axis.drive)
    theirs = buckling(model.problems[0].continuum, state, locked=row).positive[0]
    ours = analyse_axis(lumped_system(stage, plane="stress"), axis).static.drive_force
    assert lumped_buckling(stage, ours, plane="stress") == pytest.approx(theirs, rel=0.02)
