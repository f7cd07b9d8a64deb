"""Clearances, overlaps and free motions of figures whose answer is known by construction."""

import dataclasses
import math

import pytest

from flexstage.base.errors import StageError
from flexstage.hinges import Leaf, RightCircular
from flexstage.hinges.straight import CornerFilleted
from flexstage.quantities.characteristic import Characteristic
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Manufacture, Probe, Screw, Stage
from flexstage.stage.checks import check, free_motion
from flexstage.stage.designs import design
from flexstage.stage.transform import PlaneMotion, moved
from tests.reference_stages import NAMES, reference_stage

WIRE = 0.35e-3


def loop(*corners: tuple[float, float], bulges: tuple[float, ...] = ()) -> Loop:
    """A loop from corners in millimetres."""
    return Loop(tuple((x * 1e-3, y * 1e-3) for x, y in corners), bulges)


def test_parts_of_a_stage_are_found_by_their_names() -> None:
    stage = design("vgtu-piezo")
    for noun, parts in (
        ("body", stage.bodies), ("hinge", stage.hinges), ("drive", stage.drives),
        ("probe", stage.probes),
    ):  # fmt: skip
        find = getattr(stage, noun)
        assert [find(part.name) for part in parts] == list(parts)
        with pytest.raises(StageError, match=f"{noun} 'nobody'"):
            find("nobody")


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    return loop((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def stage_of(*bodies: Body, hinges: tuple[Hinge, ...] = (), drives: tuple = ()) -> Stage:
    return Stage(
        name="s",
        thickness=0.01,
        material=material("Al 7075-T6"),
        bodies=bodies,
        hinges=hinges,
        drives=drives,
        manufacture=Manufacture(wire_width=WIRE),
    )


def body(name: str, outline: Loop, **changes: object) -> Body:
    return Body(name=name, outline=outline, fixed=True, **changes)


def codes(stage: Stage) -> list[str]:
    return [f.code for f in check(stage)]


@pytest.mark.parametrize(
    ("gap", "found"), [(0.352, []), (0.35, []), (0.348, ["narrow-slot"]), (0.01, ["narrow-slot"])]
)
def test_a_gap_between_bodies_is_measured_to_two_micrometres(gap: float, found: list[str]) -> None:
    pair = stage_of(body("a", box(0, 0, 5, 3)), body("b", box(5 + gap, 1, 9, 4)))
    assert codes(pair) == found
    # between an arc and a straight line, where a polygon stands for the arc
    disc = body("disc", loop((0, 0), (4, 0), bulges=(1.0, 1.0)))
    assert codes(stage_of(disc, body("b", box(4 + gap, -5, 9, 4)))) == found


@pytest.mark.parametrize(
    ("depth", "found"), [(0.0, "narrow-slot"), (0.0015, "narrow-slot"), (0.0025, "overlap")]
)
def test_touching_is_not_overlapping(depth: float, found: str) -> None:
    assert codes(stage_of(body("a", box(0, 0, 5, 3)), body("b", box(5 - depth, 1, 9, 4)))) == [
        found
    ]


def test_a_body_of_metres_is_doubted() -> None:
    large = stage_of(body("a", box(0, 0, 2001, 30)))
    (found,) = [f for f in check(large) if f.code == "size"]
    assert found.severity == "warning"
    assert "a body of 2.001 m: check the length_unit" in found.message
    assert "size" not in codes(stage_of(body("a", box(0, 0, 1999, 30))))


def test_a_body_in_the_hole_of_another_is_no_overlap() -> None:
    hole = box(1, 1, 9, 9)
    assert (
        codes(stage_of(body("frame", box(0, 0, 10, 10), holes=(hole,)), body("b", box(2, 2, 8, 8))))
        == []
    )
    assert codes(stage_of(body("frame", box(0, 0, 10, 10)), body("b", box(2, 2, 8, 8)))) == [
        "overlap"
    ]
    close = stage_of(body("frame", box(0, 0, 10, 10), holes=(hole,)), body("b", box(1.3, 2, 8, 8)))
    assert codes(close) == ["narrow-slot"]


def slotted(width: float, angle: float = 0.0) -> Body:
    """A block with a dead-end slot from its top, turned as a whole."""
    c, s = math.cos(angle), math.sin(angle)
    outline = loop((0, 0), (11, 0), (11, 7), (5 + width, 7), (5 + width, 2), (5, 2), (5, 7), (0, 7))
    return body("block", outline.mapped(lambda p: (c * p[0] - s * p[1], s * p[0] + c * p[1])))


@pytest.mark.parametrize(
    ("wall", "severity"),
    [(0.301, None), (0.299, "warning"), (0.031, "warning"), (0.029, "error"), (0.0003, "error")],
)
@pytest.mark.parametrize("which", ["outline", "hole", "mounting hole", "window"])
def test_a_wall_is_held_to_the_thinnest_neck(wall: float, severity: str | None, which: str) -> None:
    hole = Circle((7.3e-3, (2.1 + wall) * 1e-3), 2.1e-3)
    if which == "outline":
        block = body("block", box(0, 0, 13, 9), mounting_holes=(hole,))
    elif which == "window":
        block = body("block", box(0, -4, 13, 9), holes=(box(3, -3, 11, 0),), mounting_holes=(hole,))
    else:
        other = Circle((7.3e-3, -1.7e-3), 1.7e-3)
        kind = "holes" if which == "hole" else "mounting_holes"
        both = (hole, other) if which == "mounting hole" else (hole,)
        holes = {"mounting_holes": both} | ({"holes": (other,)} if kind == "holes" else {})
        block = body("block", box(0, -9, 13, 9), **holes)
    found = check(stage_of(block))
    assert [(f.code, f.severity) for f in found] == (
        [] if severity is None else [("thin-wall", severity)]
    )
    if found:
        assert f"{wall:g} mm" in found[0].message


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.9])
def test_a_slot_within_a_body(angle: float) -> None:
    assert codes(stage_of(slotted(0.352, angle))) == []
    for width in (0.34, 0.011):
        (finding,) = check(stage_of(slotted(width, angle)))
        assert finding.code == "narrow-slot"
        assert f"only {width} mm wide" in finding.message


def test_sharp_corners_and_thin_walls_are_no_slots() -> None:
    # the wire rounds each corner of the window; the wall beside it is thinner than the wire
    window = (box(1, 1, 4, 4), box(4.1, 1, 7, 4))
    assert codes(stage_of(body("a", box(0, 0, 8, 5), holes=window))) == ["thin-wall"]
    wedge = loop((1, 1), (4, 1), (2.5, 3.5981))  # 60 degrees
    assert codes(stage_of(body("a", box(0, 0, 8, 5), holes=(wedge,)))) == []


def test_a_needle_and_a_pinhole_are() -> None:
    needle = loop((1, 1), (7, 1), (7, 1.4))  # 4 degrees: narrower than the wire over most of it
    assert codes(stage_of(body("a", box(0, 0, 8, 5), holes=(needle,)))) == ["narrow-slot"]
    for radius, found in ((0.18, []), (0.17, ["narrow-slot"])):
        hole = Circle((3e-3, 2e-3), radius * 1e-3)
        for field in ("holes", "mounting_holes"):
            block = body("a", box(0, 0, 8, 5), **{field: (hole,)})
            assert codes(stage_of(block)) == found


def notch(name: str, a: str, b: str, x: float, y: float, deg: float, **changes: float) -> Hinge:
    sizes = {"neck_thickness": 0.5e-3, "radius": 1e-3, **changes}
    return Hinge(
        name=name,
        bodies=(a, b),
        at=(x * 1e-3, y * 1e-3),
        direction=math.radians(deg),
        profile=RightCircular(**sizes),
    )


def test_the_opening_of_a_notch_is_not_a_slot_but_two_notches_side_by_side_are() -> None:
    a, b = body("a", box(0, 0, 9, 4)), body("b", box(0, 6, 9, 10))
    h = notch("h", "a", "b", 2.0, 5.0, 90.0)
    assert codes(stage_of(a, b, hinges=(h,))) == []
    for spacing, found in ((2.86, []), (2.7, ["narrow-slot"]), (2.3, ["hinges-coincide"])):
        other = notch("i", "a", "b", 2.0 + spacing, 5.0, 90.0)
        assert codes(stage_of(a, b, hinges=(h, other))) == found
    small = notch("h", "a", "b", 2.0, 5.0, 90.0, radius=0.15e-3)
    near = body("b", box(0, 4 + 2 * 1.15, 9, 10))
    assert set(codes(stage_of(a, near, hinges=(small,)))) == {"narrow-notch", "root-off-body"}


def test_strips_that_meet_in_a_corner_of_their_body_leave_no_slot() -> None:
    def strip(name: str, a: str, b: str, x: float, y: float, deg: float) -> Hinge:
        return Hinge(
            name=name,
            bodies=(a, b),
            at=(x * 1e-3, y * 1e-3),
            direction=math.radians(deg),
            profile=Leaf(neck_thickness=1e-3, leaf_length=5e-3, notch_depth=0.0),
        )

    base, corner = body("base", box(-3, -3, 3, 0)), body("corner", box(0, 5, 1, 6))
    end = body("end", box(6, 3, 9, 9))
    up = strip("up", "base", "corner", 0.5, 2.5, 90.0)
    across = strip("across", "corner", "end", 3.5, 5.5, 0.0)
    assert codes(stage_of(base, corner, end, hinges=(up, across))) == []
    # beside one another on one body they do
    for x, found in ((1.85, []), (1.8, ["narrow-slot"]), (1.5, ["narrow-slot"])):
        wide = body("wide", box(0, 5, 9, 9))
        beside = strip("beside", "base", "wide", x, 2.5, 90.0)
        first = strip("first", "base", "wide", 0.5, 2.5, 90.0)
        assert codes(stage_of(base, wide, hinges=(first, beside))) == found


def test_a_notch_that_its_body_fills_already_is_found() -> None:
    h = notch("h", "a", "b", 2.0, 5.0, 90.0)
    b = body("b", box(0, 6, 9, 10))
    # the root is on the lower edge of body a, which lies above it, where the notch is
    (finding,) = check(stage_of(body("a", box(0, 4, 9, 5)), b, hinges=(h,)))
    assert (finding.code, finding.what) == ("notch-overlap", ("a", "h"))
    # a third body in the opening of the notch, and one beside it
    a = body("a", box(0, 0, 9, 4))
    for x, found in ((2.1, ["notch-overlap"]), (2.6, ["narrow-slot"]), (2.9, [])):
        third = body("c", box(x, 4.5, x + 0.4, 5.5))
        assert codes(stage_of(a, b, third, hinges=(h,))) == found


def linkage(*links: str, drives: tuple = ()) -> Stage:
    """Pins at given places [mm] between bodies that only mark the middle of their pins."""
    pins = [(a, b, float(x), float(y)) for a, b, x, y in map(str.split, links)]
    bodies = [body("g", box(-9, -9, -8, -8))]
    for name in sorted({n for a, b, *_ in pins for n in (a, b)} - {"g"}):
        own = [p[2:] for p in pins if name in p[:2]]
        x, y = (sum(c) / len(own) for c in zip(*own, strict=True))
        bodies.append(Body(name=name, outline=box(x - 2, y - 7, x + 2, y + 7)))
    hinges = tuple(notch(f"h{k}", a, b, x, y, 90.0) for k, (a, b, x, y) in enumerate(pins))
    return stage_of(*bodies, hinges=hinges, drives=drives)


FOUR_BAR = ("g l 0 0", "l p 0 20", "g r 31 0", "r p 31 20")


@pytest.mark.parametrize(
    ("links", "freedoms"),
    [
        (("g a 1 2",), 1),
        (("g a 1 2", "a b 5 7"), 2),
        (FOUR_BAR, 1),
        # a parallelogram can have a third leg, parallel to the others, and still move
        ((*FOUR_BAR, "g m 12 0", "m p 12 20"), 1),
        # but not one that is askew
        ((*FOUR_BAR, "g m 12 0", "m p 15 20"), 0),
        (("g a 0 0", "a b 3 9", "b c 11 13", "c d 19 8", "d g 23 1"), 2),  # five bars
        (("g a 0 0", "a b 3 9", "b g 8 1"), 0),  # a triangle
        (("g a 0 0", "a b 4 0", "b g 9 0"), 1),  # flat, it can snap through
    ],
)
def test_mobility_of_known_linkages(links: tuple[str, ...], freedoms: int) -> None:
    assert free_motion(linkage(*links)).freedoms == freedoms


def test_what_moves_is_named_and_how() -> None:
    motion = free_motion(linkage(*FOUR_BAR))
    # a leg of 20 mm turns about its foot: its middle moves 10 mm per radian, and it is 14 mm long
    assert set(motion.turning) == {"l", "r"}
    assert motion.shifting == ("p",)


def screw(pushes: str, x: float, y: float, deg: float) -> Screw:
    at = (x * 1e-3, y * 1e-3)
    return Screw(
        name="d",
        pushes=pushes,
        reacts="g",
        at=(at, at),
        direction=math.radians(deg),
        pitch=5e-4,
        smallest_step=5e-7,
        travel=1e-4,
    )


def test_a_drive_holds_its_direction_only() -> None:
    # the platform moves along x at first
    for deg, freedoms in ((0.0, 0), (40.0, 0), (90.0, 1)):
        stage = linkage(*FOUR_BAR, drives=(screw("p", 4.0, 22.0, deg),))
        assert free_motion(stage).freedoms == freedoms
        assert free_motion(stage, hold_drives=False).freedoms == 1


def test_the_inner_stage_of_a_double_parallelogram_is_a_warning() -> None:
    links = (*FOUR_BAR, "p u 7 20", "u q 7 1", "p v 25 20", "v q 25 1")
    stage = linkage(*links, drives=(screw("q", 9.0, 0.0, 0.0),))
    # the bodies are only markers here, so other findings are of no interest
    found = [f for f in check(stage) if f.code == "free-motion"]
    assert [f.severity for f in found] == ["warning"]
    assert "'q'" not in found[0].message


def test_faults_of_a_hinge_by_itself() -> None:
    a, b = body("a", box(0, 0, 9, 4)), body("b", box(0, 6, 9, 10))
    thick = dataclasses.replace(
        stage_of(a, b, hinges=(notch("h", "a", "b", 2.0, 5.0, 90.0),)), thickness=0.4e-3
    )
    assert [(f.severity, f.code) for f in check(thick)] == [("warning", "thick-neck")]
    profile = CornerFilleted(neck_thickness=0.5e-3, notch_length=2e-3, fillet_radius=0.17e-3)
    tight = dataclasses.replace(notch("h", "a", "b", 2.0, 5.0, 90.0), profile=profile)
    (finding,) = check(stage_of(a, b, hinges=(tight,)))
    assert finding.code == "narrow-notch"
    assert "radius of 0.17 mm" in finding.message


def test_holes_that_overlap() -> None:
    holes = (box(1, 1, 4, 4), Circle((4.2e-3, 2e-3), 0.5e-3))
    (finding,) = check(stage_of(body("a", box(0, 0, 8, 5), holes=holes)))
    assert finding.message.startswith("holes[0] and holes[1] of body 'a' overlap")


def test_faults_of_a_drive() -> None:
    """Base below, platform above a gap of 2 mm with one hinge at its left end."""
    g = body("g", box(0, 0, 30, 4))
    p = Body(name="p", outline=box(0, 6, 30, 10))
    h = notch("h", "g", "p", 2.0, 5.0, 90.0)

    def found(**changes: object) -> list[tuple[str, str]]:
        drive = screw("p", 20.0, 6.0, 90.0)
        drive = dataclasses.replace(drive, **{"at": ((0.02, 0.006), (0.02, 0.004)), **changes})
        return [(f.severity, f.code) for f in check(stage_of(g, p, hinges=(h,), drives=(drive,)))]

    assert found() == []
    # the force is spread over 3 mm to either side
    assert found(at=((0.02, 0.006), (0.0229, 0.004))) == []
    assert found(at=((0.02, 0.006), (0.0231, 0.004))) == [("warning", "drive-askew")]
    assert ("error", "drive-on-one-body") in found(reacts="p")
    assert ("error", "drive-off-body") in found(at=((0.02, 0.006), (0.02, 0.003)))
    assert found(direction=-math.pi / 2) == [("warning", "drive-pulls")]
    held = stage_of(g, dataclasses.replace(p, fixed=True), hinges=(h,))
    drive = dataclasses.replace(screw("p", 20.0, 6.0, 90.0), at=((0.02, 0.006), (0.02, 0.004)))
    assert codes(dataclasses.replace(held, drives=(drive,))) == ["drive-between-fixed-bodies"]


def test_faults_of_a_probe() -> None:
    frame = body("frame", box(0, 0, 20, 10), holes=(box(1, 1, 9, 9), box(11, 1, 19, 9)))
    inner = body("inner", box(2, 2, 8, 8))

    def found(name: str, x: float, y: float, relative_to: str | None) -> list[str]:
        at = (x * 1e-3, y * 1e-3)
        probe = Probe(name="p", body=name, at=at, direction=0.0, relative_to=relative_to)
        return codes(dataclasses.replace(stage_of(frame, inner), probes=(probe,)))

    assert found("inner", 5, 5, "frame") == []
    assert found("inner", 8.009, 5, "frame") == []
    assert found("inner", 8.02, 5, "frame") == ["probe-off-body"]
    # an empty opening may hold what is read; one with a body in it does not
    assert found("frame", 15, 5, "inner") == []
    assert found("frame", 5, 5, "inner") == ["probe-off-body"]
    assert found("inner", 5, 5, None) == ["probe-on-fixed-body"]


@pytest.mark.parametrize("name", NAMES)
def test_the_reference_stages_have_two_motions_and_their_drives_hold_both(name: str) -> None:
    stage = reference_stage(name).stage
    assert check(stage) == ()
    assert free_motion(stage, hold_drives=False).freedoms == 2
    assert free_motion(stage).freedoms == 0


@pytest.mark.parametrize("name", NAMES)
def test_the_smallest_clearance_of_the_reference_stages(name: str) -> None:
    """1.0 mm was found when they were made."""
    stage = reference_stage(name).stage
    for wire, slots in ((0.998e-3, False), (1.002e-3, True)):
        limits = Manufacture(wire_width=wire)
        found = codes(dataclasses.replace(stage, manufacture=limits))
        assert ("narrow-slot" in found) is slots


@pytest.mark.parametrize("name", NAMES)
def test_findings_do_not_depend_on_the_frame(name: str) -> None:
    motion = PlaneMotion(angle=0.731, shift=(0.11, -0.07))
    assert check(moved(reference_stage(name).stage, motion)) == ()
    image = dataclasses.replace(motion, mirrored=True)
    assert check(moved(reference_stage(name).stage, image)) == ()


def test_published_figures_of_an_axis_that_does_not_exist() -> None:
    figure = Characteristic(
        quantity="resolution", axis="z", origin="published-fem", value=1e-8, unit="m"
    )
    stage = dataclasses.replace(stage_of(body("a", box(0, 0, 5, 3))), published=(figure,))
    (found,) = check(stage)
    assert (found.severity, found.code, found.what) == ("warning", "published-axis", ("z",))
    assert "which the stage does not have (it has none)" in found.message
