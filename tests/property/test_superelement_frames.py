"""A stage's figures do not depend on where it lies, which way it points, and what came before."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.fem.mesh import MeshSettings
from flexstage.fem.substructure import cut_free
from flexstage.fem.superelement import SuperelementModel, superelement_model
from flexstage.stage import Stage
from flexstage.stage.transform import PlaneMotion, moved
from flexstage.system import modes, static_forces, static_loads
from tests.hinged_bars import hinged_bars

FINE = MeshSettings(order=5, neck_size=0.5, grading=0.4)
COARSE = MeshSettings(order=2, neck_size=1.5)
SHIFT = st.floats(-0.4, 0.4, allow_nan=False)


def figures(model: SuperelementModel) -> np.ndarray:
    """Frequencies, ratio, stress, and what a load that has no direction does."""
    pushed = static_forces(model.system, {"push": 11.0})
    warm = static_loads(model.system, {"temperature": 2.0})
    return np.array(
        [
            *modes(model.system, count=2).frequency_hz,
            pushed.readings["tip"],
            pushed.drive_displacement["push"],
            pushed.hinge_stress["first"],
            warm.readings["tip"],
        ]
    )


def keys(stage: Stage) -> list[str]:
    return [p.part.key() for p in cut_free(stage, COARSE, modes=2)]


@settings(max_examples=25, deadline=None)
@given(SHIFT, SHIFT)
def test_bodies_at_other_places_are_the_same(x: float, y: float) -> None:
    """Coordinates are rounded to a picometre, a shift by any float to 1e-16 of its size."""
    stage = hinged_bars()
    nice = (round(x, 6), round(y, 6))
    assert keys(moved(stage, PlaneMotion(shift=nice))) == keys(stage)


def test_a_shifted_stage_has_the_same_figures() -> None:
    stage = hinged_bars()
    shifted = moved(stage, PlaneMotion(shift=(0.2137, -0.0618)))
    # gravity's moments and the gradient's middle go along with the stage as well
    a, b = (superelement_model(s, COARSE, cache=False) for s in (stage, shifted))
    np.testing.assert_allclose(figures(a), figures(b), rtol=1e-9)
    for load in ("gravity x", "temperature gradient y"):
        u, v = (static_loads(m.system, {load: 1.0}).readings["tip"] for m in (a, b))
        assert u == pytest.approx(v, rel=1e-9)


@lru_cache
def as_described() -> np.ndarray:
    """Figures of the stage that is turned and mirrored."""
    return figures(superelement_model(hinged_bars(), FINE, cache=False))


@settings(max_examples=2, deadline=None)
@given(st.floats(0.05, 2.0 * math.pi - 0.05))
def test_a_turned_stage_has_the_same_figures(angle: float) -> None:
    turned = moved(hinged_bars(), PlaneMotion(angle=angle, shift=(0.01, 0.03)))
    a, b = as_described(), figures(superelement_model(turned, FINE, cache=False))
    # the mesher makes another mesh of a part that is turned: 1e-5 in displacement at this fineness
    np.testing.assert_allclose(a[[0, 1, 2, 3, 5]], b[[0, 1, 2, 3, 5]], rtol=1e-4)
    assert a[4] == pytest.approx(b[4], rel=1e-2)


def test_a_mirrored_stage_has_the_same_figures() -> None:
    """Outlines run the other way round then, and arcs turn to the other side."""
    mirrored = moved(hinged_bars(), PlaneMotion.reflection(0.4, through=(0.01, 0.03)))
    a, b = as_described(), figures(superelement_model(mirrored, FINE, cache=False))
    np.testing.assert_allclose(a[[0, 1, 2, 3, 5]], b[[0, 1, 2, 3, 5]], rtol=1e-4)
    assert a[4] == pytest.approx(b[4], rel=1e-2)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: replace(s, name="other", notes=("a note",)),
        lambda s: replace(s, bodies=s.bodies[::-1]),
        lambda s: replace(s, axes=()),
        lambda s: replace(s, drives=(replace(s.drives[0], stiffness=3e7, free_stroke=1e-6),)),
        lambda s: replace(s, material=replace(s.material, youngs_modulus=3e10, density=2e3)),
        lambda s: replace(s, thickness=6.05e-3),
        lambda s: replace(s, bodies=tuple(replace(b, extra_masses=()) for b in s.bodies)),
    ],
)
def test_what_needs_no_new_body(change: Callable[[Stage], Stage]) -> None:
    stage = hinged_bars()
    assert sorted(keys(change(stage))) == sorted(keys(stage))


def _body(s: Stage, name: str, **changes: Any) -> Stage:
    return replace(
        s, bodies=tuple(replace(b, **changes) if b.name == name else b for b in s.bodies)
    )


def _drive(s: Stage, **changes: Any) -> Stage:
    return replace(s, drives=(replace(s.drives[0], **changes),))


def _hinge(s: Stage, i: int, **changes: Any) -> Stage:
    return replace(
        s, hinges=tuple(replace(h, **changes) if i == j else h for j, h in enumerate(s.hinges))
    )


S = hinged_bars()
NECK = S.hinges[1].at
BOLT = replace(S.bodies[0].mounting_holes[0], radius=2.1e-3)
THICKER = replace(S.hinges[0].profile, neck_thickness=0.47e-3)


@pytest.mark.parametrize(
    ("changed", "touched"),
    [
        (replace(S, material=replace(S.material, poissons_ratio=0.35)), (0, 1, 2)),
        (replace(S, thickness=9e-3), (0, 1, 2)),
        (replace(S, thickness=0.4 * S.thickness), (0, 1, 2)),
        (_body(S, "standing", holes=()), (2,)),
        (_body(S, "block", mounting_holes=(BOLT,)), (0,)),
        (_body(S, "block", fixed=False), (0,)),
        (_drive(S, patch_half_width=1.2e-3), (1,)),
        (_drive(S, direction=1.5), (1,)),
        (_drive(S, at=((6.1e-3, -2e-3), S.drives[0].at[1])), (1,)),
        (replace(S, probes=(replace(S.probes[0], direction=0.4), S.probes[1])), (2,)),
        (replace(S, probes=S.probes[:1]), (1, 2)),
        (_hinge(S, 0, profile=THICKER), (0, 1)),
        (_hinge(S, 1, at=(NECK[0] + 1e-5, NECK[1])), (1, 2)),
        (_hinge(S, 1, bodies=("lying", "standing"), direction=math.pi / 2), (1, 2)),
    ],
)
def test_what_needs_new_bodies(changed: Stage, touched: tuple[int, ...]) -> None:
    old, new = keys(S), keys(changed)
    assert tuple(i for i in range(3) if old[i] != new[i]) == touched


def test_settings_are_part_of_the_key() -> None:
    stage = hinged_bars()
    base = {p.part.key() for p in cut_free(stage, COARSE, modes=2)}
    for other in (
        cut_free(stage, replace(COARSE, order=3), modes=2),
        cut_free(stage, replace(COARSE, grading=0.59), modes=2),
        cut_free(stage, COARSE, modes=3),
        cut_free(stage, COARSE, modes=2, plane="stress"),
    ):
        assert not base & {p.part.key() for p in other}
