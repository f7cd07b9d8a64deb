"""Roots of hinges: on which edge of a body they lie, and how wide the body is behind them."""

import dataclasses
import math

import pytest

from flexstage.base.errors import StageError
from flexstage.hinges import RightCircular
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Stage
from flexstage.stage.contour import hinge_root, root_widths
from tests.reference_stages import NAMES, reference_stage

NOTCH = RightCircular(neck_thickness=0.4e-3, radius=1.2e-3)


def turned(angle: float, x: float, y: float) -> tuple[float, float]:
    """A point [mm] in a frame that is turned and moved."""
    c, s = math.cos(angle), math.sin(angle)
    return (1e-3 * (c * x - s * y + 7.0), 1e-3 * (s * x + c * y - 3.0))


def two_bars(
    angle: float, profile: RightCircular = NOTCH, left: float = 3.1, right: float = -2.3
) -> Stage:
    """Bars from -9 to -1.2 mm and from 1.2 to 8 mm along the hinge; b is wider and uneven."""

    def body(name: str, corners: list[tuple[float, float]]) -> Body:
        return Body(name=name, outline=Loop(tuple(turned(angle, *p) for p in corners)))

    return Stage(
        name="s",
        thickness=0.01,
        material=material("Al 7075-T6"),
        bodies=(
            body("a", [(-9.0, -1.9), (-1.2, -1.9), (-1.2, 1.7), (-9.0, 1.7)]),
            body("b", [(1.2, right), (8.0, right), (8.0, left), (1.2, left), (1.2, 0.3)]),
        ),
        hinges=(
            Hinge(
                name="h",
                bodies=("a", "b"),
                at=turned(angle, 0.0, 0.0),
                direction=angle,
                profile=profile,
            ),
        ),
    )


@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi, 2.217, -0.83])
def test_width_is_twice_the_distance_to_the_nearer_corner(angle: float) -> None:
    stage = two_bars(angle)
    # b has a corner in the middle of its edge, which is no corner of the body
    assert root_widths(stage, stage.hinges[0]) == pytest.approx((3.4e-3, 4.6e-3), rel=1e-9)
    root = hinge_root(stage, stage.hinges[0], 1)
    assert root.edge[1] == pytest.approx(turned(angle, 1.2, 3.1), abs=1e-12)
    assert math.dist(*root.ends) == pytest.approx(NOTCH.root_height)


def test_one_sided_root_is_measured_about_its_middle() -> None:
    notch = dataclasses.replace(NOTCH, one_sided=True)
    stage = two_bars(0.6, notch, left=3.1, right=-0.2)
    # the root runs from -0.2 to 1.4 mm: its right end is the corner, so the width is its height
    assert root_widths(stage, stage.hinges[0])[1] == pytest.approx(1.6e-3, rel=1e-9)


def test_a_root_may_be_off_by_a_micrometre_and_no_more() -> None:
    stage = two_bars(0.4)
    for off, fine in ((0.9e-6, True), (1.2e-6, False)):
        at = stage.hinges[0].to_plane(off, 0.0)
        moved = dataclasses.replace(stage.hinges[0], at=at)
        if fine:
            root_widths(stage, moved)
        else:
            with pytest.raises(StageError, match="'h' is not attached to body 'a'"):
                root_widths(stage, moved)


def test_roots_on_holes_and_not_on_arcs() -> None:
    stage = two_bars(0.0)
    frame = Body(
        name="frame",
        outline=Loop(tuple(turned(0.0, *p) for p in [(-20, -9), (20, -9), (20, 9), (-20, 9)])),
        holes=(stage.bodies[0].outline,),
    )
    framed = dataclasses.replace(
        stage,
        bodies=(frame, stage.bodies[1]),
        hinges=(dataclasses.replace(stage.hinges[0], bodies=("frame", "b")),),
    )
    assert root_widths(framed, framed.hinges[0])[0] == pytest.approx(3.4e-3)
    round_hole = dataclasses.replace(frame, holes=(Circle(turned(0.0, -5.0, 0.0), 3.8e-3),))
    bent = dataclasses.replace(framed, bodies=(round_hole, stage.bodies[1]))
    with pytest.raises(StageError, match="'frame'"):
        root_widths(bent, bent.hinges[0])


@pytest.mark.parametrize("name", NAMES)
def test_reference_bars_are_as_wide_as_printed(name: str) -> None:
    """Bars no wider than 3 root heights: the reference prints their widths, others it cuts off."""
    reference = reference_stage(name)
    compared = 0
    for hinge, entry in zip(reference.stage.hinges, reference.data["hinges"], strict=True):
        widths = root_widths(reference.stage, hinge)
        for which, key in enumerate(("a", "b")):
            # legs and links are plain bars; elsewhere the reference rounds to whole root heights
            if hinge.bodies[which][1:2] in ("G", "K"):
                compared += 1
                assert widths[which] * 1e3 == pytest.approx(entry[f"root_width_{key}"], abs=1e-9)
    assert compared == 24
