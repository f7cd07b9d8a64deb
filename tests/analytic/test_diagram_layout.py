"""A drawn axis can be read: nothing lies on anything else, and every line arrives."""

import functools
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import Diagram
from flexstage.export.diagram.page import PageLayout, Segment, layout
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.svg import diagram_files, diagram_svg
from flexstage.export.diagram.symbols import SMALL, PlacedBlock, plain
from flexstage.export.svg import text_width
from flexstage.hysteresis import DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage import drive
from flexstage.stage.designs import design
from flexstage.stage.drive import VoiceCoil
from flexstage.system import RayleighDamping

Box = tuple[float, float, float, float]

_FULL = {"bandwidth": 2100.0, "creep": LogCreep(rate_per_decade=0.02)}


@functools.cache
def _model(name: str) -> DynamicModel:
    stage = design(name)
    kinds = _FULL if name == "vgtu-piezo" else {}
    sensors = {stage.probes[0].name: Sensor(bandwidth_hz=4000.0)}
    return dynamic_model(stage, lumped_system(stage), sensors=sensors, **kinds)


# the design and its axis; one without dampers, one without a mass of its own, one pushed by a force
CASES: dict[str, tuple[str, str]] = {
    "piezo x": ("vgtu-piezo", "x"),
    "piezo y": ("vgtu-piezo", "y"),
    "undamped": ("vgtu-piezo", "x"),
    "mechanical y": ("vgtu-mechanical", "y"),
    "parallelogram x": ("parallelogram", "x"),
    "bridge y": ("bridge", "y"),
    "pivot": ("cartwheel", "theta"),
    "lever chain y": ("lever-chain", "y"),
    "force x": ("parallelogram", "x"),
    "force y": ("vgtu-piezo", "y"),
}


@functools.cache
def _diagram(case: str) -> Diagram:
    name, axis = CASES[case]
    if case.startswith("force"):
        stage = design(name)
        coil = VoiceCoil(largest_force=20.0)
        place = ("name", "pushes", "reacts", "at", "direction")
        coils = tuple(drive.placed(coil, **{n: getattr(d, n) for n in place}) for d in stage.drives)
        return stage_diagram(replace(stage, drives=coils), axis=axis)
    damping = RayleighDamping(alpha=0.0, beta=0.0) if case == "undamped" else None
    return stage_diagram(design(name), model=_model(name), axis=axis, damping=damping)


@functools.cache
def _placed(case: str) -> PageLayout:
    return layout(_diagram(case))


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Diagram, PageLayout]:
    return _diagram(request.param), _placed(request.param)


def cell_box(b: PlacedBlock) -> Box:
    return (b.x, b.y, b.x + b.cell.width, b.y + b.cell.height)


def label_box(text: str, x: float, y: float, end: bool) -> Box:
    # letters reach about 0.75 of their size above the base line, subscripts 0.3 below
    width = text_width(plain(text), SMALL)
    left = x - width if end else x
    return (left, y - 0.75 * SMALL, left + width, y + 0.3 * SMALL)


def overlap(a: Box, b: Box, by: float = 1e-6) -> bool:
    return min(a[2], b[2]) - max(a[0], b[0]) > by and min(a[3], b[3]) - max(a[1], b[1]) > by


def segment_box(segment: tuple[tuple[float, float], tuple[float, float]]) -> Box:
    (x1, y1), (x2, y2) = segment
    return (min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))


def runs_through(wire: Sequence[Segment], boxes: np.ndarray) -> np.ndarray:
    """Return whether a line runs inside each box, not only along or up to its edge."""
    b = np.array([segment_box(s) for s in wire])[:, None, :]
    x = (b[..., 0] < boxes[:, 2] - 0.5) & (b[..., 2] > boxes[:, 0] + 0.5)
    y = (b[..., 1] < boxes[:, 3] - 0.5) & (b[..., 3] > boxes[:, 1] + 0.5)
    return np.any(x & y, axis=0)


def test_boxes_are_apart_and_inside_their_groups(case: tuple[Diagram, PageLayout]) -> None:
    diagram, placed = case
    assert {b.block.name for b in placed.blocks} == {b.name for b in diagram.blocks}
    boxes = [cell_box(b) for b in placed.blocks]
    assert not any(overlap(a, b, by=-4.0) for a, b in combinations(boxes, 2))
    frames = {f.group.name: (f.x, f.y, f.right, f.bottom) for f in placed.frames}
    assert not any(overlap(a, b, by=-8.0) for a, b in combinations(frames.values(), 2))
    for b, box in zip(placed.blocks, boxes, strict=True):
        frame = frames[b.block.group]
        assert frame[0] < box[0]
        assert box[2] < frame[2]
        assert frame[1] + 20.0 < box[1]
        assert box[3] < frame[3]
    for frame in frames.values():
        assert frame[0] >= 0.0
        assert frame[1] >= 0.0
        assert frame[2] <= placed.width
        assert frame[3] <= placed.height


def test_lines_run_through_no_box(case: tuple[Diagram, PageLayout]) -> None:
    diagram, placed = case
    group_of = {b.name: b.group for b in diagram.blocks}
    boxes = np.array([cell_box(b) for b in placed.blocks])
    frames = np.array([(f.x, f.y, f.right, f.bottom) for f in placed.frames])
    for source, wire in placed.wires.items():
        assert not runs_through(wire, boxes).any(), source
        own = {group_of[x.target] for x in diagram.lines if x.source == source}
        own.add(group_of[source])
        through = {
            f.group.name
            for f, hit in zip(placed.frames, runs_through(wire, frames), strict=True)
            if hit
        }
        assert through <= own, source


def test_lines_of_two_signals_never_lie_on_each_other(case: tuple[Diagram, PageLayout]) -> None:
    _, placed = case
    for upright in (True, False):
        known: list[tuple[float, float, float, str]] = []
        for source, wire in placed.wires.items():
            for (x1, y1), (x2, y2) in wire:
                if (x1 == x2) == upright:
                    at, ends = (x1, (y1, y2)) if upright else (y1, (x1, x2))
                    known.append((at, min(ends), max(ends), source))
        known.sort()
        for i, (at, low, high, source) in enumerate(known):
            for other_at, other_low, other_high, other in known[i + 1 :]:
                if other_at - at > 2.5:
                    break
                shared = min(high, other_high) - max(low, other_low)
                assert source == other or shared < 0.5, (source, other, at)


def test_every_line_joins_its_block_with_all_that_it_feeds(
    case: tuple[Diagram, PageLayout],
) -> None:
    diagram, placed = case
    at = {b.block.name: b for b in placed.blocks}

    def pin(name: str, which: str) -> tuple[float, float]:
        b = at[name]
        found = b.cell.pins[which]
        return (b.x + (b.cell.width if found.side == "R" else 0.0), b.y + found.y)

    for source in {x.source for x in diagram.lines}:
        segments = [segment_box(s) for s in placed.wires[source]]
        wanted = [pin(source, "out")]
        wanted += [pin(x.target, f"in{x.port}") for x in diagram.lines if x.source == source]
        reached = {k for k, s in enumerate(segments) if touches(s, wanted[0])}
        grown = True
        while grown:
            more = {
                k
                for k, s in enumerate(segments)
                if k not in reached and any(meet(s, segments[j]) for j in reached)
            }
            grown, reached = bool(more), reached | more
        assert reached == set(range(len(segments))), f"a piece of {source} hangs loose"
        for point in wanted:
            assert any(touches(segments[k], point) for k in reached), (source, point)


def touches(segment: Box, point: tuple[float, float], by: float = 1e-6) -> bool:
    return (
        segment[0] - by <= point[0] <= segment[2] + by
        and segment[1] - by <= point[1] <= segment[3] + by
    )


def meet(a: Box, b: Box, by: float = 1e-6) -> bool:
    return min(a[2], b[2]) - max(a[0], b[0]) >= -by and min(a[3], b[3]) - max(a[1], b[1]) >= -by


def test_names_of_signals_are_free_of_boxes_and_of_each_other(
    case: tuple[Diagram, PageLayout],
) -> None:
    _, placed = case
    named = [x for x in placed.labels if x.text]
    labels = [label_box(x.text, x.x, x.y, x.end) for x in named]
    assert len(labels) >= 5
    for (a, one), (b, other) in combinations(zip(labels, named, strict=True), 2):
        assert not overlap(a, b), (one.text, other.text)
    for box, label in zip(labels, named, strict=True):
        for b in placed.blocks:
            assert not overlap(box, cell_box(b), by=1.5), (label.text, b.block.name)
        for f in placed.frames:
            frame = (f.x, f.y, f.right, f.bottom)
            inside = frame[0] < box[0] and box[2] < frame[2]
            assert not overlap(box, frame) or inside, label.text


def test_upright_lines_leave_the_names_of_signals_free(case: tuple[Diagram, PageLayout]) -> None:
    _, placed = case
    for x in placed.labels:
        box = label_box(x.text, x.x, x.y, x.end)
        if not x.text:
            continue
        for source, wire in placed.wires.items():
            for (x1, y1), (x2, y2) in wire:
                crosses = x1 == x2 and box[0] + 1.0 < x1 < box[2] - 3.0
                assert not (crosses and y1 < box[3] - 2.0 and y2 > box[1]), (x.text, source)


def test_the_drawing_is_a_file_that_stands_by_itself(case: tuple[Diagram, PageLayout]) -> None:
    diagram, placed = case
    content = diagram_svg(diagram)
    root = ET.fromstring(content)
    _, _, width, height = map(float, root.attrib["viewBox"].split())
    assert width >= placed.width
    assert height >= placed.height
    sizes = [float(e.attrib["font-size"]) for e in root.iter() if "font-size" in e.attrib]
    assert min(sizes) >= 9.0
    # nothing from outside, no scripts, no names that another drawing could use too
    words = content.decode()
    assert not re.search(r"\s(id|href|class|style)=|<script|<style|url\(", words)
    assert words.count("http") == 1
    said = "".join(root.itertext())
    for note in diagram.notes:
        assert note.split()[0] in said
    for b in diagram.blocks:
        assert b.meaning in said


def test_words_stay_on_the_page(case: tuple[Diagram, PageLayout]) -> None:
    diagram, _ = case
    root = ET.fromstring(diagram_svg(diagram))
    width, height = float(root.attrib["width"]), float(root.attrib["height"])

    def walk(element: ET.Element, dx: float, dy: float) -> None:
        moved = re.match(r"translate\(([-\d.e]+) ([-\d.e]+)\)", element.attrib.get("transform", ""))
        if moved:
            dx, dy = dx + float(moved[1]), dy + float(moved[2])
        if element.tag.endswith("text"):
            words = "".join(element.itertext())
            x = dx + float(element.attrib["x"])
            wide = text_width(words, float(element.attrib["font-size"]))
            wide = {"end": 0.0, "middle": 0.5 * wide}.get(
                element.attrib.get("text-anchor", "start"), wide
            )
            assert x > 0.0, words
            assert x + wide < width, words
            assert 0.0 < dy + float(element.attrib["y"]) < height, words
        for child in element:
            walk(child, dx, dy)

    walk(root, 0.0, 0.0)


def test_the_same_stage_gives_the_same_files() -> None:
    stage = design("vgtu-mechanical")
    assert diagram_files(stage) == diagram_files(stage)
    assert list(diagram_files(stage)) == ["diagram-x.svg", "diagram-y.svg"]


def test_what_is_no_axis_has_no_drawing() -> None:
    with pytest.raises(ModelError, match="no axis with a single drive"):
        diagram_files(design("three-rrr"))
    with pytest.raises(ModelError, match="only the diagram of a single axis"):
        layout(stage_diagram(design("parallelogram")))


def test_a_page_is_no_strip() -> None:
    for name in CASES:
        placed = _placed(name)
        assert 0.6 < placed.width / placed.height < 5.0, name
    # one axis fits on a landscape sheet at a size at which it can be read: 9 px are 4.5 points
    # where a page of 2000 px is printed on a width of 267 mm
    assert max(_placed(n).width for n in CASES) < 2000.0


def test_values_below_an_axis_are_those_of_its_gains() -> None:
    diagram = _diagram("mechanical y")
    said = "".join(ET.fromstring(diagram_svg(diagram)).itertext())
    inverse = diagram.block("output_inverse_mass").matrix
    spring = diagram.block("transmission_spring").matrix
    assert inverse is not None
    assert spring is not None
    assert f"{1e3 / inverse.item():.4g}g" in said.replace(" ", "")
    assert f"{1e-6 * spring.item():.4g}" in said
