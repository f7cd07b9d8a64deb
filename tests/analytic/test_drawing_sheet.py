"""The drawing with dimensions: every number is on it, and every word can be read."""

import dataclasses
import itertools
import math
import re
import xml.etree.ElementTree as ET
from functools import cache

import pytest
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from flexstage.export.drawing.contours import plate_contours
from flexstage.export.drawing.sheet import drawing_svg
from flexstage.export.drawing.views import notch_kinds, ratio
from flexstage.export.svg import text_width, wrapped
from flexstage.hinges import RightCircular
from flexstage.quantities.quantity import round_below
from flexstage.stage import Stage
from flexstage.stage.designs import design
from tests.drawing_stages import NOTCHES, PLATES, guide, quick

SVG = "{http://www.w3.org/2000/svg}"


def unlike() -> Stage:
    """A stage whose notches all differ, with long names: more than a usual sheet holds."""
    stage = design("vgtu-mechanical")
    hinges = []
    for k, h in enumerate(stage.hinges):
        assert isinstance(h.profile, RightCircular)
        # as high at its root, which stays within the micrometre that an edge allows it
        radius, neck = h.profile.radius + 1e-8 * k, h.profile.neck_thickness - 2e-8 * k
        profile = RightCircular(neck_thickness=neck, radius=radius)
        hinges.append(dataclasses.replace(h, name=f"{h.name}-with-a-long-name", profile=profile))
    return dataclasses.replace(stage, hinges=tuple(hinges))


STAGES = {
    **PLATES,
    **{n: guide(p, shift=(0.2573, -0.1641)) for n, p in NOTCHES.items()},
}
ALL = pytest.mark.parametrize("name", [quick(n, n) for n in STAGES])


def drawn(stage: Stage) -> ET.Element:
    return ET.fromstring(drawing_svg(stage).decode())


@cache
def of(name: str) -> ET.Element:
    return drawn(STAGES[name])


def words(root: ET.Element) -> list[str]:
    return [t.text or "" for t in root.iter(f"{SVG}text")]


@cache
def extents(text: str, size: float, weight: str) -> tuple[float, float, float]:
    """Width, and how far a text reaches over and under its baseline, at most."""
    font = FontProperties(family="DejaVu Sans", weight=weight)
    # an outline is within the points that control it
    points = TextPath((0.0, 0.0), text, size=size, prop=font).vertices
    if not len(points):
        return 0.0, 0.0, 0.0
    return points[:, 0].max(), points[:, 1].max(), points[:, 1].min()


def box(element: ET.Element) -> tuple[float, float, float, float]:
    """Room of a text in DejaVu Sans, the widest of the usual sans-serif faces."""
    size = float(element.get("font-size", ""))
    width, over, under = extents(element.text or "", size, element.get("font-weight", "normal"))
    x, y = float(element.get("x", "")), float(element.get("y", ""))
    before = {"start": 0.0, "middle": 0.5 * width, "end": width}[element.get("text-anchor", "")]
    if element.get("transform"):
        return x - over, y - width + before, x - under, y + before
    return x - before, y - over, x - before + width, y - under


def overlapping(root: ET.Element) -> list[tuple[str, str]]:
    texts = [(t.text or "", box(t)) for t in root.iter(f"{SVG}text")]
    return [
        (a, b)
        for (a, p), (b, q) in itertools.combinations(texts, 2)
        if p[0] < q[2] and q[0] < p[2] and p[1] < q[3] and q[1] < p[3]
    ]


@ALL
def test_no_word_lies_over_another_or_leaves_the_sheet(name: str) -> None:
    root = of(name)
    assert overlapping(root) == []
    _, _, width, height = map(float, root.get("viewBox", "").split())
    for text in root.iter(f"{SVG}text"):
        left, top, right, bottom = box(text)
        # the frame is 8 mm inside
        assert left > 8.0, text.text
        assert right < width - 8.0, text.text
        assert top > 8.0, text.text
        assert bottom < height - 8.0, text.text


@ALL
def test_every_notch_is_dimensioned(name: str) -> None:
    stage = STAGES[name]
    found = words(of(name))
    for kind in notch_kinds(stage):
        profile = kind.profile
        assert f"{kind.letter}   {len(kind.hinges)} ×   {profile.kind}" in " ".join(found)
        assert f"{profile.neck_thickness * 1e3:.6g}" in found
        assert f"{profile.length * 1e3:.5g}" in found
        assert f"{profile.root_height * 1e3:.5g}" in found
        # in one cell, not cut off; a profile as drawn has none
        assert not kind.dimensions or kind.dimensions in found
        radius = getattr(profile, "radius", getattr(profile, "fillet_radius", None))
        if radius is not None:
            assert f"R{radius * 1e3:.6g}" in found


@ALL
def test_every_hinge_hole_drive_and_probe_is_listed_and_marked(name: str) -> None:
    stage = STAGES[name]
    found = words(of(name))
    letters = {h.name: kind.letter for kind in notch_kinds(stage) for h in kind.hinges}
    for k, hinge in enumerate(stage.hinges, start=1):
        assert found.count(f"{letters[hinge.name]}{k}") >= 2  # in the table and at the neck
        assert hinge.name in found
        for value in hinge.at:
            assert f"{round(value * 1e3, 3) + 0.0:.6g}" in found
    plate = plate_contours(stage)
    circles = [c for c in plate.contours if c.circle is not None]
    assert sum(w.startswith("H") and w[1:].isdigit() for w in found) == 2 * len(circles)
    for word in [f"drive {d.name}" for d in stage.drives] + [
        f"probe {p.name}" for p in stage.probes
    ]:
        assert word in found
    assert not [w for w in found if w.endswith("…")]


def test_title_block_and_overall_dimensions() -> None:
    found = words(of("vgtu-mechanical"))
    for word in ("184", "167", "10 mm", "Al 7075-T6", "1:1", "A3", "vgtu-mechanical"):
        assert word in found


def test_the_plate_is_drawn_to_scale() -> None:
    root = drawn(design("parallelogram"))
    assert "2:1" in words(root)
    path = max((p.get("d", "") for p in root.iter(f"{SVG}path")), key=len)
    points = re.findall(r"[ML](\S+) ([^LAMZ]+)", path)
    x = [float(a) for a, _ in points]
    y = [float(b) for _, b in points]
    # 68.5 and 61 mm, twice
    assert (max(x) - min(x), max(y) - min(y)) == pytest.approx((137.0, 122.0), abs=1e-3)


@pytest.mark.parametrize("name", ["parallelogram", "circular", "elliptical"])
def test_the_plate_is_drawn_with_its_arcs_the_right_way_round(name: str) -> None:
    root = of(name)
    scale = float(next(w for w in words(root) if re.fullmatch(r"\d+:1", w)).split(":")[0])
    d = max((p.get("d", "") for p in root.iter(f"{SVG}path")), key=len)
    total = 0.0
    x, y = first = 0.0, 0.0
    for letter, numbers in re.findall(r"([MLAZ])([^MLAZ]*)", d):
        v = [float(n) for n in numbers.split()]
        if letter == "M":
            first = x, y = v[0], v[1]
            continue
        ex, ey = first if letter == "Z" else v[-2:]
        total += 0.5 * (x * ey - y * ex)
        if letter == "A":
            # the area between chord and arc, by the flags of the format
            half = math.asin(min(0.5 * math.dist((x, y), (ex, ey)) / v[0], 1.0))
            angle = 2.0 * (math.pi - half if v[3] else half)
            total += (1.0 if v[4] else -1.0) * 0.5 * v[0] ** 2 * (angle - math.sin(angle))
        x, y = ex, ey
    area = plate_contours(STAGES[name]).area * (1e3 * scale) ** 2
    # coordinates to 1e-4 mm on edges of some 100 mm
    assert abs(total) == pytest.approx(area, rel=1e-4)


@pytest.mark.slow
def test_a_stage_of_unlike_notches_gets_a_larger_sheet() -> None:
    root = drawn(unlike())
    assert "32 ×" not in " ".join(words(root))
    assert len([w for w in words(root) if "1 ×   circular" in w]) == 32
    assert float(root.get("viewBox", "").split()[3]) > 841.0
    assert overlapping(root) == []


def test_the_same_stage_gives_the_same_drawing() -> None:
    assert drawing_svg(guide(NOTCHES["v"])) == drawing_svg(guide(NOTCHES["v"]))


def test_words_of_a_title_are_no_markup() -> None:
    assert "Guide <with> any notch & corners" in words(drawn(guide(NOTCHES["leaf"])))


def test_letters_go_on_after_z() -> None:
    letters = [k.letter for k in notch_kinds(unlike())]
    assert letters[6:8] == ["G", "J"]
    assert letters[19:23] == ["Y", "Z", "AA", "AB"]


@pytest.mark.parametrize(
    ("limit", "scale", "text"),
    [
        (7.3, 5.0, "5:1"),
        (1.0, 1.0, "1:1"),
        (0.99, 0.5, "1:2"),
        (23.0, 20.0, "20:1"),
        (0.04, 0.02, "1:50"),
    ],
)
def test_scales_are_usual_ones(limit: float, scale: float, text: str) -> None:
    assert round_below(limit) == scale
    assert ratio(scale) == text


def test_lines_are_broken_at_words_or_where_a_word_is_too_long() -> None:
    text = "a stage of " + "x" * 90
    lines = wrapped(text, 40.0, 2.6, break_words=True)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert all(text_width(line, 2.6) <= 40.0 for line in lines)
