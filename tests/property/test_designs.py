"""Parametric designs stay possible stages when their dimensions change.

Evidence (Stages, tolerances, designs): random sizes: `check` finds no error in any that is accepted
"""

import importlib
import itertools
import json
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from flexstage.base.errors import ModelError, StageError
from flexstage.files.format import field_types
from flexstage.files.ranges import Size
from flexstage.hinges import CornerFilleted, RightCircular
from flexstage.records import Record
from flexstage.stage import Body, Hinge, Loop, PiezoStack, Stage, check
from flexstage.stage.designs import DESIGNS, design
from flexstage.stage.designs.nested_xy import NestedXYParameters, nested_xy
from flexstage.stage.designs.nested_xy_axis import AxisParameters
from flexstage.stage.designs.parallelogram import ParallelogramParameters, parallelogram
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.designs.registry import TOPOLOGIES
from flexstage.stage.designs.vgtu import MECHANICAL, PIEZO
from flexstage.studies import run_study
from flexstage.studies.results import results_json
from tests.computed_once import computed_once
from tests.result_schema import require_valid
from tests.virtual_stages import set_once

BASES = {"mechanical": MECHANICAL.parameters, "piezo": PIEZO.parameters}


@st.composite
def axes(draw: st.DrawFn, base: AxisParameters) -> AxisParameters:
    # Half a millimetre is a moderate change of every arm, and the levers of the piezo stage, whose
    # ends lie 1.4 mm from touching each other, must still keep apart.
    change = st.floats(-0.5e-3, 0.5e-3)
    return replace(
        base,
        lever_arm_input=base.lever_arm_input + draw(change),
        lever_arm_output=base.lever_arm_output + draw(change),
        leg_neck=base.leg_neck * draw(st.floats(0.7, 1.5)),
    )


@st.composite
def stages(draw: st.DrawFn) -> NestedXYParameters:
    base = BASES[draw(st.sampled_from(sorted(BASES)))]
    return replace(base, x=draw(axes(base.x)), y=draw(axes(base.y)))


def polygon(body: Body) -> shapely.Polygon:
    """Return a body in millimetres without its circular holes, which hold nothing."""
    openings = [h.polyline() * 1e3 for h in body.holes if isinstance(h, Loop)]
    return shapely.Polygon(body.outline.polyline() * 1e3, openings)


def notch(hinge: Hinge) -> shapely.Polygon:
    """Return the rectangle in which a notch lies."""
    half, root = 0.5 * hinge.profile.length, 0.5 * hinge.profile.root_height
    corners = [(-half, -root), (half, -root), (half, root), (-half, root)]
    points = [hinge.to_plane(u, v) for u, v in corners]
    return shapely.Polygon([(x * 1e3, y * 1e3) for x, y in points])


def narrowest_slot(stage: Stage) -> float:
    """Return the smallest distance [m] between parts that are not joined to each other."""
    parts = [({b.name}, polygon(b)) for b in stage.bodies]
    parts += [(set(h.bodies), notch(h)) for h in stage.hinges]
    apart = [p.distance(q) for (a, p), (b, q) in itertools.combinations(parts, 2) if not a & b]
    return min(apart) * 1e-3


@given(stages())
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_moderate_changes_give_possible_stages(parameters: NestedXYParameters) -> None:
    stage = nested_xy(parameters)
    shapes = {b.name: polygon(b) for b in stage.bodies}
    assert all(s.is_valid for s in shapes.values())
    for a, b in itertools.combinations(shapes.values(), 2):
        assert a.intersection(b).area < 1e-9  # [mm^2], of bodies of 20 mm^2 and more
    # the slots are what the description says, to rounding
    assert narrowest_slot(stage) >= parameters.slot - 1e-9
    # and so are those between two faces of one body, such as pocket and recesses: an opening with
    # a square of the slot's width loses nothing of what is cut out
    solid = shapely.union_all([*shapes.values(), *map(notch, stage.hinges)])
    empty = shapely.Polygon(shapes["G"].exterior).difference(solid.buffer(1e-6, join_style="mitre"))
    reach = 0.5 * parameters.slot * 1e3 - 1e-4
    opened = empty.buffer(-reach, join_style="mitre").buffer(reach, join_style="mitre")
    assert empty.difference(opened.buffer(1e-5)).area < 1e-6


@given(stages())
@settings(max_examples=20, deadline=None)
def test_each_notch_ends_in_its_two_bodies(parameters: NestedXYParameters) -> None:
    stage = nested_xy(parameters)
    for hinge in stage.hinges:
        half, root = 0.5 * hinge.profile.length, 0.5 * hinge.profile.root_height
        for name, end in zip(hinge.bodies, (-half, half), strict=True):
            edge = shapely.LineString(
                [[c * 1e3 for c in hinge.to_plane(end, v)] for v in (-root, root)]
            )
            on_outline = polygon(stage.body(name)).boundary.buffer(1e-6)
            assert on_outline.contains(edge), (hinge.name, name)


def mirrored(points: tuple[tuple[float, float], ...]) -> set[tuple[int, int]]:
    """Return points reflected in the x axis, on a grid of 1e-12 m."""
    return {(round(x * 1e12), round(-y * 1e12)) for x, y in points}


def on_grid(points: tuple[tuple[float, float], ...]) -> set[tuple[int, int]]:
    return {(round(x * 1e12), round(y * 1e12)) for x, y in points}


def swap(name: str) -> str:
    """Return the name of the mirror image of a part of the x axis."""
    return {"u": f"{name[:-1]}d", "d": f"{name[:-1]}u"}.get(name[-1], name)


@given(stages())
@settings(max_examples=20, deadline=None)
def test_the_x_axis_is_its_own_mirror_image(parameters: NestedXYParameters) -> None:
    stage = nested_xy(parameters)
    own = [b for b in stage.bodies if b.name[0] == "x" or b.name in {"PX", "G"}]
    assert len(own) == 11
    for body in own:
        twin = stage.body(swap(body.name))
        assert mirrored(body.outline.points) == on_grid(twin.outline.points)
    window, bolts = stage.body("G").holes[0], stage.body("G").mounting_holes
    assert isinstance(window, Loop)
    assert mirrored(window.points) == on_grid(window.points)
    assert mirrored(tuple(b.centre for b in bolts)) == on_grid(tuple(b.centre for b in bolts))
    for hinge in (h for h in stage.hinges if h.name[0] == "x"):
        twin = stage.hinge(swap(hinge.name))
        assert mirrored((hinge.at,)) == on_grid((twin.at,))
        assert twin.bodies == tuple(map(swap, hinge.bodies))
        assert math.remainder(hinge.direction + twin.direction, math.tau) == pytest.approx(0.0)


def with_arm(arm: float) -> Stage:
    """Return a stage with this input arm whose links stay where they are."""
    base = BASES["mechanical"]
    x = replace(base.x, lever_arm_input=arm, lever_arm_output=arm - 18e-3)
    return nested_xy(replace(base, x=x))


@given(st.floats(20e-3, 90e-3))
@example(46.7e-3 - 4e-9)  # in the step, lever and platform become equally tall: 54.5 mm
@settings(max_examples=20, deadline=None)
def test_the_rules_are_continuous(arm: float) -> None:
    # from levers far shorter than the platform to levers that reach beyond its guide legs
    step = 1e-8
    before, after = with_arm(arm), with_arm(arm + step)
    for a, b in zip(before.hinges, after.hinges, strict=True):
        assert math.dist(a.at, b.at) <= step * (1 + 1e-6)
    for a, b in zip(before.bodies, after.bodies, strict=True):
        # no edge moves by more than a step or two, and all edges together are under 2 m long
        assert abs(polygon(a).area - polygon(b).area) * 1e-6 <= 2.0 * 2.0 * step


IMPOSSIBLE = [
    ("x", {"lever_arm_input": 3e-3}, "lever_arm_input"),
    ("x", {"lever_arm_output": 32e-3}, "lever_arm_output"),
    ("y", {"input_position": 1e-3}, "input_position"),
    ("y", {"link_length": 1e-3}, "link_length"),
    ("y", {"link_recess": 60e-3, "link_length": 70e-3}, "link_recess"),
    ("y", {"lever_arm_input": 50e-3}, "the links meet the left edge"),
    ("x", {"leg_position": 1e-3}, "leg_position"),
    ("y", {"leg_position": 24e-3}, "leg_position"),
    ("x", {"actuator_pocket_length": 0.4e-3}, "actuator_pocket_length"),
    ("y", {"actuator_pocket_width": 40e-3}, "actuator_pocket_width"),
    ("x", {"leg_neck": -1e-3}, "leg_neck"),
    ("x", {"lever_width": math.nan}, "lever_width"),
    ("", {"aperture_diameter": 45e-3}, "aperture_diameter"),
    ("", {"aperture_offset": 70e-3}, "aperture_offset"),
    ("", {"mounting_hole_diameter": 20e-3}, "mounting_hole_diameter"),
    ("", {"mounting_hole_station": 1.2}, "mounting_hole_station"),
    ("", {"slot": 0.0}, "slot"),
]


@pytest.mark.parametrize(("axis", "changes", "culprit"), IMPOSSIBLE)
def test_impossible_dimensions_are_refused(
    axis: str, changes: dict[str, Any], culprit: str
) -> None:
    base = BASES["mechanical"]

    def built() -> Stage:
        if not axis:
            return nested_xy(replace(base, **changes))
        return nested_xy(replace(base, **{axis: replace(getattr(base, axis), **changes)}))

    with pytest.raises(StageError, match=culprit) as caught:
        built()
    assert "\n" not in str(caught.value)
    assert "got" in str(caught.value)


@given(
    spacing=st.floats(15e-3, 80e-3),
    bar=st.floats(5e-3, 60e-3),
    radius=st.floats(0.5e-3, 4e-3),
    neck=st.floats(0.3e-3, 1.5e-3),
    gap=st.floats(0.5e-3, 40e-3),
)
@settings(max_examples=20, deadline=None)
def test_a_parallelogram_has_equal_legs_and_room_for_its_drive(
    spacing: float, bar: float, radius: float, neck: float, gap: float
) -> None:
    parameters = ParallelogramParameters(
        leg_spacing=spacing,
        leg=Leg(notch=RightCircular(neck_thickness=neck, radius=radius), bar_length=bar),
        actuator_length=gap,
    )
    stage = parallelogram(parameters)
    at = {h.name: h.at for h in stage.hinges}
    for end in ("lower", "upper"):
        left, right = at[f"left-{end}"], at[f"right-{end}"]
        assert (right[0] - left[0], right[1]) == pytest.approx((spacing, left[1]), rel=1e-12)
    for side in ("left", "right"):
        length = math.dist(at[f"{side}-lower"], at[f"{side}-upper"])
        assert length == pytest.approx(bar + 2.0 * radius, rel=1e-12)
    drive = stage.drive("x")
    assert math.dist(*drive.at) == pytest.approx(gap, rel=1e-9)
    for name, point in zip((drive.pushes, drive.reacts), drive.at, strict=True):
        spot = shapely.Point([c * 1e3 for c in point])
        assert polygon(stage.body(name)).boundary.distance(spot) < 1e-9
    shapes = [polygon(b) for b in stage.bodies]
    assert all(s.is_valid for s in shapes)
    for a, b in itertools.combinations(shapes, 2):
        assert a.intersection(b).area < 1e-9


def test_impossible_parallelograms_are_refused() -> None:
    with pytest.raises(StageError, match="leg_spacing"):
        ParallelogramParameters(leg_spacing=4e-3)
    with pytest.raises(StageError, match="mounting_hole_diameter"):
        ParallelogramParameters(base_height=5e-3)
    with pytest.raises(StageError, match="bar_length"):
        Leg(notch=RightCircular(neck_thickness=0.3e-3, radius=1e-3), bar_length=0.0)
    with pytest.raises(StageError, match="one_sided"):
        Leg(notch=RightCircular(neck_thickness=0.3e-3, radius=1e-3, one_sided=True))


@st.composite
def legs(draw: st.DrawFn) -> Leg:
    neck, radius = draw(st.floats(0.3e-3, 0.8e-3)), draw(st.floats(0.2e-3, 2e-3))
    if draw(st.booleans()):
        notch = RightCircular(neck_thickness=neck, radius=radius + 0.3e-3)
        return Leg(notch=notch, bar_length=draw(st.floats(3e-3, 40e-3)))
    length = 2.0 * radius + draw(st.floats(3e-3, 60e-3))
    return Leg(notch=CornerFilleted(neck_thickness=neck, notch_length=length, fillet_radius=radius))


@st.composite
def guides(draw: st.DrawFn) -> tuple[str, Any]:
    """Dimensions of a guide or pivot; some are impossible."""
    name = draw(st.sampled_from(GUIDES))
    size = st.floats(1e-3, 30e-3)
    parameters = TOPOLOGIES[name].parameters
    given: dict[str, Any] = {}
    for field, (_, kind) in field_types(parameters).items():
        if kind == Size and field not in ("thickness", "mounting_hole_diameter", "wall"):
            given[field] = draw(st.just(None) | size)
    given = {k: v for k, v in given.items() if v is not None}
    if "leaf" in parameters.__dataclass_fields__:
        given["leaf"] = draw(legs().filter(lambda leg: leg.bar_length is None)).notch
        given["half_angle"] = draw(st.floats(0.3, 1.15))
    else:
        given["leg"] = draw(legs())
    return name, given


GUIDES = [
    "parallelogram",
    "double-parallelogram",
    "compound-parallelogram",
    "linked-parallelogram",
    "gantry",
    "cartwheel",
    "trapezoidal-pivot",
]


@given(guides())
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_dimensions_of_a_guide_are_possible_or_refused(drawn: tuple[str, Any]) -> None:
    name, given_dimensions = drawn
    topology = TOPOLOGIES[name]
    try:
        parameters = topology.parameters(**given_dimensions)
    except StageError:
        return
    stage = topology.construct(parameters)
    assert [f.message for f in check(stage) if f.severity == "error"] == []


def renamed(stage: Stage) -> Stage:
    """Give every part another name, which says of what kind it is."""
    axes = {axis.name for axis in stage.axes}

    def body(name: str) -> str:
        return f"body_of_{name}"

    def published(name: str) -> str:
        return f"axis_of_{name}" if name in axes else name

    return replace(
        stage,
        bodies=tuple(replace(b, name=body(b.name)) for b in stage.bodies),
        hinges=tuple(
            replace(h, name=f"hinge_of_{h.name}", bodies=(body(h.bodies[0]), body(h.bodies[1])))
            for h in stage.hinges
        ),
        drives=tuple(
            replace(d, name=f"drive_of_{d.name}", pushes=body(d.pushes), reacts=body(d.reacts))
            for d in stage.drives
        ),
        probes=tuple(
            replace(
                p,
                name=f"probe_of_{p.name}",
                body=body(p.body),
                relative_to=None if p.relative_to is None else body(p.relative_to),
            )
            for p in stage.probes
        ),
        axes=tuple(
            replace(
                a,
                name=f"axis_of_{a.name}",
                drive=None if a.drive is None else f"drive_of_{a.drive}",
                drives=tuple(f"drive_of_{name}" for name in a.drives),
                probe=f"probe_of_{a.probe}",
            )
            for a in stage.axes
        ),
        published=tuple(replace(row, axis=published(row.axis)) for row in stage.published),
    )


def studied(stage: Stage, *, experiments: bool) -> dict[str, Any]:
    """Return all that a study of rigid bodies gives, by the names that the parts had at first."""
    study = run_study(stage, parts="identification,virtual" if experiments else "none")
    text = results_json(study.to_dict()).decode()
    require_valid(json.loads(text), "study")
    results = json.loads(re.sub("(body|hinge|drive|probe|axis)_of_", "", text))
    for made in (*results["models"].values(), *results["variants"].values()):
        del made["provenance"]  # the hash of the description
    return results


def takes_long(name: str) -> bool:
    """Say whether hysteresis is identified, or the stage is that of the study."""
    stage = design(name)
    one_drive = (stage.drive(axis.drive) for axis in stage.axes if axis.drive is not None)
    return name == "vgtu-mechanical" or any(isinstance(d, PiezoStack) for d in one_drive)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if takes_long(n) else ()) for n in DESIGNS],
)
def test_a_study_does_not_depend_on_names(name: str) -> None:
    stage = design(name)
    # experiments take long, and ask for no more of a stage than these have: one axis or two, one
    # that turns, several drives to an axis, drives with a stack and without
    experiments = name in ("parallelogram", "gantry", "cartwheel", "three-rrr", "vgtu-piezo")
    # what is identified of a record that is alike to the last bit, is alike; so is a stack of
    # the same loop
    with computed_once("flexstage.studies.compensation", "identify"), set_once():
        own, other = (studied(s, experiments=experiments) for s in (stage, renamed(stage)))
    assert other == own


def test_hysteresis_is_found_whatever_axis_and_probe_are_called(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def read(record: Record, given: str, follows: str, **_: Any) -> None:
        range_of = (np.ptp(record.channel(given).values), np.ptp(record.channel(follows).values))
        raise ModelError(f"{range_of[0]:.0f} V, {1e6 * range_of[1]:.1f} um")

    monkeypatch.setattr(importlib.import_module("flexstage.studies.compensation"), "identify", read)
    said = {}
    for stage in (design("bridge"), renamed(design("bridge"))):
        said |= run_study(stage, parts="identification").skipped_experiments
    assert said["axis_of_y"] == said["y"] == "120 V, 187.5 um"
