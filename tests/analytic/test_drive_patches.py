"""Where a drive acts on a mesh: beside an edge, and where there is no straight one."""

import functools
import math
from dataclasses import replace

import pytest

from flexstage.fem import MeshSettings, superelement_model
from flexstage.stage import Loop, Stage
from flexstage.stage.designs import design
from flexstage.system import static_displacements

MESH = MeshSettings(order=2, neck_size=1.5)


def pushed_at(offset: float, *, bow: float = 0.0) -> Stage:
    """A parallelogram whose drive acts beside the edge, or on an edge that is an arc."""
    stage = design("parallelogram")
    (drive,) = stage.drives
    (x, y), face = drive.at
    pushed = stage.body(drive.pushes)
    if bow:
        sides = pushed.outline.segments()
        bulges = tuple(bow if {a[0], b[0]} == {x} else 0.0 for a, b, _ in sides)
        (side,) = (s for s, bulge in zip(sides, bulges, strict=True) if bulge)
        offset = -0.5 * math.dist(side[0], side[1]) * bow  # the sagitta of the arc
        pushed = replace(pushed, outline=Loop(pushed.outline.points, bulges))
    bodies = tuple(pushed if body.name == pushed.name else body for body in stage.bodies)
    return replace(stage, bodies=bodies, drives=(replace(drive, at=((x + offset, y), face)),))


@functools.cache
def ratio(stage: Stage) -> float:
    system = superelement_model(stage, MESH, cache=False).system
    return static_displacements(system, {"x": 1e-4}).readings["x"] / 1e-4


@pytest.mark.parametrize("offset", [4e-9, -3e-6])
def test_a_drive_beside_an_edge_acts_on_it(offset: float) -> None:
    # a drawing's digits leave points some nanometres off edges that are not quite upright
    assert ratio(pushed_at(offset)) == pytest.approx(ratio(pushed_at(0.0)), rel=1e-9)


@pytest.mark.parametrize("bow", [0.11, 0.3])
def test_a_drive_on_an_arc_moves_a_stiff_platform_by_its_own_motion(bow: float) -> None:
    """The platform is 1e4 times as stiff as the legs: it moves as far as it is pushed."""
    assert ratio(pushed_at(0.0, bow=bow)) == pytest.approx(1.0, abs=1e-3)
