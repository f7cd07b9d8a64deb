"""Buckling of rigid bodies on springs and leaves, against columns whose load is known."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from flexstage.designs import design
from flexstage.fem.stroke import _rig, bar_buckling_load, two_notch_bars
from flexstage.hinges import Leaf, RightCircular
from flexstage.hinges.profile import Profile
from flexstage.lumped import hinge_springs, mechanism, nonlinear
from flexstage.lumped.buckling import lumped_buckling
from flexstage.stage import Body, Force, Hinge, Loop, Stage
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
    assert load(column(LEAF, head)) == pytest.approx(EI * k**2, rel=1e-3)


def test_two_leaves_far_apart_guide_their_block() -> None:
    """Between ends that stay parallel a column bears pi^2 E I/l^2."""
    euler = math.pi**2 * EI / LONG**2
    far = column(LEAF, 8.9e-3, (-0.4, 0.4))
    assert load(far) == pytest.approx(2.0 * euler, rel=1e-3)


def test_a_leaf_between_ends_at_rest_buckles_by_itself() -> None:
    """Held aside as well, its block cannot move: 4 pi^2 E I/l^2."""
    euler = 4.0 * math.pi**2 * EI / LONG**2
    far = column(LEAF, 8.9e-3, (-0.4, 0.4), held=True)
    assert load(far, "side") == pytest.approx(2.0 * euler, rel=2e-3)


def test_a_block_on_a_short_notch_is_an_inverted_pendulum() -> None:
    """P = k/h, with the height over a neck that is short beside it; pulled, it stands."""
    notch = RightCircular(neck_thickness=0.21e-3, radius=0.4e-3)
    stage = column(notch, 61e-3)
    stiffness = hinge_springs(stage)[0].stiffness[2, 2]
    assert lumped_buckling(stage, {"press": 1.0}) == pytest.approx(
        stiffness / (61e-3 + 0.4e-3), rel=2e-3
    )
    assert lumped_buckling(stage, {"press": -1.0}) == math.inf


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
    rig = _rig(stage, body)
    assert 0.5 * lumped_buckling(rig, {"press": 1.0}) == pytest.approx(
        bar_buckling_load(stage, body), rel=0.03
    )
