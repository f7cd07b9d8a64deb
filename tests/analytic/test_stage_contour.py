"""Bodies as they are cut: areas that add up, whatever the profile of the notch."""

import math

import pytest

from flexstage.base.errors import StageError
from flexstage.hinges import (
    CornerFilleted,
    Elliptical,
    Leaf,
    Profile,
    RightCircular,
)
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Stage, mass_properties
from flexstage.stage.contour import body_contour, half_notch, inner_notch
from flexstage.stage.designs import DESIGNS, design


def _area(shape: Loop | Circle) -> float:
    return (shape.loop() if isinstance(shape, Circle) else shape).integrals().area


@pytest.mark.parametrize("share", [0.0, 0.31, 0.8, 0.97])
@pytest.mark.parametrize("name", sorted(DESIGNS))
def test_the_area_of_a_contour_is_that_of_the_body_and_its_half_notches(
    name: str, share: float
) -> None:
    stage = design(name)
    masses = mass_properties(stage)
    for body in stage.bodies:
        outline, holes = body_contour(stage, body, share)
        area = _area(outline) - sum(_area(h) for h in (*holes, *body.mounting_holes))
        if share:
            area += sum(
                _area(inner_notch(h, i, share))
                for h in stage.hinges
                for i in (0, 1)
                if h.bodies[i] == body.name
            )
        mass = area * stage.thickness * stage.material.density
        extra = sum(e.mass for e in body.extra_masses)
        assert mass + extra == pytest.approx(masses[body.name].mass, rel=1e-9)


def _pair(profile: Profile, direction: float) -> Stage:
    """Two blocks with a notch between, the line between them turned by an angle."""
    half, height = 0.5 * profile.length, 0.5 * profile.root_height + 3e-3
    c, s = math.cos(direction), math.sin(direction)

    def turn(p: tuple[float, float]) -> tuple[float, float]:
        return (0.004 + c * p[0] - s * p[1], -0.002 + s * p[0] + c * p[1])

    left = ((-half - 0.02, -height), (-half, -height), (-half, height), (-half - 0.02, height))
    # the root spans two collinear segments here, and the loop runs the other way round
    right = ((half, 1e-4), (half, height), (half + 0.01, height), (half + 0.01, -height),
             (half, -height))  # fmt: skip
    return Stage(
        name="pair",
        thickness=7e-3,
        material=material("Al 7075-T6"),
        bodies=(
            Body(name="a", outline=Loop(left).mapped(turn), fixed=True),
            Body(name="b", outline=Loop(right).mapped(turn)),
        ),
        hinges=(
            Hinge(
                name="h",
                bodies=("a", "b"),
                at=turn((0.0, 0.0)),
                direction=direction,
                profile=profile,
            ),
        ),
    )


PROFILES = (
    RightCircular(neck_thickness=0.4e-3, radius=1.7e-3),
    RightCircular(neck_thickness=0.4e-3, radius=1.7e-3, one_sided=True),
    Elliptical(neck_thickness=0.5e-3, half_length=2.3e-3, notch_depth=1.1e-3),
    CornerFilleted(neck_thickness=0.3e-3, notch_length=6e-3, fillet_radius=0.7e-3),
    Leaf(neck_thickness=0.3e-3, leaf_length=5e-3, notch_depth=1.2e-3),
)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: f"{p.kind}-{p.one_sided}")
@pytest.mark.parametrize("direction", [0.0, 2.1])
def test_any_profile_at_any_angle(profile: Profile, direction: float) -> None:
    stage = _pair(profile, direction)
    masses = mass_properties(stage)
    for which, body in enumerate(stage.bodies):
        for share in (0.0, 0.6):
            outline, _ = body_contour(stage, body, share)
            area = _area(outline)
            if share:
                area += _area(inner_notch(stage.hinges[0], which, share))
            mass = area * stage.thickness * stage.material.density
            # the half notch of a profile that is no arc is drawn by short chords
            assert mass == pytest.approx(masses[body.name].mass, rel=1e-7)


def test_the_cut_of_an_ellipse_is_half_of_it() -> None:
    ellipse = PROFILES[2]
    assert isinstance(ellipse, Elliptical)
    a, b = ellipse.half_length, ellipse.notch_depth
    (hinge,) = _pair(ellipse, 0.7).hinges
    cut = a * ellipse.root_height - half_notch(hinge, 0).integrals().area
    # arcs within 10 nm along both quarters
    assert cut == pytest.approx(0.5 * math.pi * a * b, abs=10e-9 * 2.0 * (a + b))


def test_a_root_that_lies_on_no_edge_is_refused() -> None:
    stage = _pair(PROFILES[0], 0.0)
    far = Body(name="b", outline=Loop(((0.05, 0.0), (0.06, 0.0), (0.06, 0.01))))
    with pytest.raises(StageError, match="hinge 'h' is not attached to one straight edge of body"):
        body_contour(stage, far)
