"""Drawings of a stage as other programs write them, made without the code that reads them."""

import math
import random
from collections.abc import Callable
from typing import Any

import ezdxf
from ezdxf.math import Bezier4P, Vec3, bezier_to_bspline, cubic_bezier_arc_parameters

from flexstage.export.drawing.contours import plate_contours
from flexstage.stage import Stage
from flexstage.stage.outline import arc

Pair = tuple[float, float]
Segment = tuple[Pair, Pair, float]


def contours(stage: Stage, unit: float = 1e-3) -> list[list[Segment]]:
    """Return the closed contours of a plate, lines and arcs, in a unit [m]."""
    plate = plate_contours(stage)
    return [
        [
            ((a[0] / unit, a[1] / unit), (b[0] / unit, b[1] / unit), bulge)
            for a, b, bulge in c.loop.segments()
        ]
        for c in plate.contours
    ]


def joined(loop: list[Segment]) -> list[Segment]:
    """Put arcs together that are one circle's, as nobody draws a corner in the middle of an arc."""
    out: list[Segment] = []
    for segment in loop:
        if out and out[-1][2] * segment[2] > 0.0:
            one, other = arc(*out[-1]), arc(*segment)
            sweep = one[3] + other[3]
            if math.dist(one[0], other[0]) < 1e-9 and abs(sweep) < 1.6 * math.pi:
                out[-1] = (out[-1][0], segment[1], math.tan(0.25 * sweep))
                continue
        out.append(segment)
    return out


def new(insunits: int | None = 4, version: str = "R2010") -> Any:
    """Return an empty drawing; without a unit where None."""
    document = ezdxf.filemanagement.new(version)
    if insunits is not None:
        document.header["$INSUNITS"] = insunits
    return document


def chords(segment: Segment, error: float) -> list[Pair]:
    """Return the corners of a polyline on an arc, whose chords are off by an error at most."""
    start, end, bulge = segment
    if not bulge:
        return [start, end]
    (x, y), radius, first, sweep = arc(*segment)
    count = max(2, math.ceil(abs(sweep) / (2.0 * math.acos(1.0 - error / radius))))
    inner = [
        (x + radius * math.cos(a), y + radius * math.sin(a))
        for a in (first + sweep * k / count for k in range(1, count))
    ]
    return [start, *inner, end]


def draw_arc(space: Any, segment: Segment, **attributes: Any) -> None:
    """Draw a line or an arc."""
    start, end, bulge = segment
    if not bulge:
        space.add_line(start, end, dxfattribs=attributes)
        return
    centre, radius, first, sweep = arc(*segment)
    a, b = math.degrees(first), math.degrees(first + sweep)
    a, b = (a, b) if sweep > 0.0 else (b, a)
    space.add_arc(centre, radius, a, b, dxfattribs=attributes)


# ------------------------------------------------------------------------------ habits


def arcs_as_splines(stage: Stage) -> Any:
    """Arcs are cubic splines of Bezier curves, 16 of them, off by some 1e-8 of a radius."""
    document = new()
    space = document.modelspace()
    for loop in contours(stage):
        for segment in joined(loop):
            start, end, bulge = segment
            if not bulge:
                space.add_line(start, end)
                continue
            (x, y), radius, first, sweep = arc(*segment)
            low, high = sorted((first, first + sweep))
            parts = cubic_bezier_arc_parameters(low, high, segments=16)
            curves = [
                Bezier4P([Vec3(x + radius * p.x, y + radius * p.y) for p in part]) for part in parts
            ]
            space.add_spline().apply_construction_tool(bezier_to_bspline(curves))
    return document


def arcs_as_polylines(error: float) -> Callable[[Stage], Any]:
    """Return the habit to write every arc as chords, off by so many millimetres."""

    def drawn(stage: Stage) -> Any:
        document = new()
        for loop in contours(stage):
            points: list[Pair] = []
            for segment in joined(loop):
                points += chords(segment, error)[:-1]
            document.modelspace().add_lwpolyline(points, close=True)
        return document

    return drawn


def soup(stage: Stage, insunits: int | None = 4, unit: float = 1e-3, gap: float = 0.0) -> Any:
    """Lines and arcs, unjoined, in any order and direction, apart by a gap at their ends."""
    document = new(insunits)
    made: list[Segment] = []
    chance = random.Random(7)
    for loop in contours(stage, unit):
        for a, corner, bulge in joined(loop):
            b = corner
            if gap and not bulge:
                share = gap / math.dist(a, corner)
                b = (b[0] - share * (b[0] - a[0]), b[1] - share * (b[1] - a[1]))
            made.append((b, a, -bulge) if chance.random() < 0.5 else (a, b, bulge))
    chance.shuffle(made)
    for segment in made:
        draw_arc(document.modelspace(), segment)
    return document


def inches(stage: Stage) -> Any:
    """The same in inches."""
    return soup(stage, insunits=1, unit=25.4e-3)


def tiny_gaps(stage: Stage) -> Any:
    """Ends that are one micrometre apart."""
    return soup(stage, gap=1e-3)


def doubled(stage: Stage) -> Any:
    """Everything drawn twice, the second time from its end, and some of it a third time."""
    document = soup(stage)
    space = document.modelspace()
    for k, loop in enumerate(contours(stage)):
        for n, (a, b, bulge) in enumerate(joined(loop)):
            draw_arc(space, (b, a, -bulge))
            if (k + n) % 3 == 0:
                draw_arc(space, (a, b, bulge))
    return document


def mirrored_blocks(stage: Stage) -> Any:
    """Each contour is a block in a block, mirrored and turned, of half the size, on layer 0."""
    document = new()
    for k, loop in enumerate(contours(stage)):
        inner = document.blocks.new(f"INNER{k}")
        for (ax, ay), (bx, by), bulge in joined(loop):
            # the inverse of what the references do: mirror x, turn by 90 degrees, shift, enlarge
            def back(x: float, y: float) -> Pair:
                x, y = x - 3.0, y + 5.0
                x, y = y, -x
                return (-x / 2.0, y / 2.0)

            draw_arc(inner, (back(ax, ay), back(bx, by), -bulge), layer="0")
        outer = document.blocks.new(f"OUTER{k}")
        outer.add_blockref(
            f"INNER{k}", (0, 0), dxfattribs={"xscale": -2, "yscale": 2, "layer": "0"}
        )
        document.layers.add(f"PART{k}")
        document.modelspace().add_blockref(
            f"OUTER{k}", (3.0, -5.0), dxfattribs={"rotation": 90.0, "layer": f"PART{k}"}
        )
    return document


def with_words(stage: Stage) -> Any:
    """Texts, dimensions, hatches, centre lines and a title between the contours."""
    document = soup(stage)
    space = document.modelspace()
    document.layers.add("CENTERLINES")
    loops = contours(stage)
    xs = [p[0] for p, _, _ in loops[0]]
    ys = [p[1] for p, _, _ in loops[0]]
    low, high = (min(xs), min(ys)), (max(xs), max(ys))
    space.add_text("PLATE", height=2.0, dxfattribs={"insert": low})
    space.add_mtext("Al 7075\nall edges 0.1")
    space.add_linear_dim((low[0], low[1] - 8), low, (high[0], low[1])).render()
    space.add_line(low, high, dxfattribs={"layer": "CENTERLINES"})
    hatch = space.add_hatch(color=2)
    hatch.paths.add_polyline_path([low, (high[0], low[1]), high], is_closed=True)
    space.add_point(low)
    space.add_line((low[0], 0), (high[0], 0), dxfattribs={"linetype": "CENTER"})
    document.linetypes.add("CENTER", [2.0, 1.25, -0.25, 0.25, -0.25])
    return document


def from_below(stage: Stage) -> Any:
    """Arcs and polylines of a part that was drawn from below: their normal is -z."""
    document = new()
    space = document.modelspace()
    down = {"extrusion": (0, 0, -1)}
    for k, loop in enumerate(contours(stage)):
        if k % 2 == 0:
            points = [(-a[0], a[1], -bulge) for a, _, bulge in loop]
            space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=down)
            continue
        for a, b, bulge in joined(loop):
            if not bulge:
                space.add_line(a, b)
                continue
            (x, y), radius, first, sweep = arc((-a[0], a[1]), (-b[0], b[1]), -bulge)
            ends = sorted((math.degrees(first), math.degrees(first + sweep)))
            space.add_arc((x, y), radius, *ends, dxfattribs=down)
    return document


def r12_polylines(stage: Stage) -> Any:
    """POLYLINE with bulges, as release 12 has it; such a file does not say its unit."""
    document = new(None, "R12")
    for loop in contours(stage):
        points = [(a[0], a[1], 0.0, 0.0, bulge) for a, _, bulge in loop]
        document.modelspace().add_polyline2d(points, format="xyseb", close=True)
    return document


def six_digits(stage: Stage) -> Any:
    """Lines alone, circles as polygons of 96 sides, of six significant digits, without a unit."""
    document = new(None)
    space = document.modelspace()
    for loop in contours(stage):
        points: list[Pair] = []
        for segment in joined(loop):
            if segment[2]:
                (x, y), radius, first, sweep = arc(*segment)
                count = round(96 * abs(sweep) / (2.0 * math.pi))
                points += [
                    (x + radius * math.cos(a), y + radius * math.sin(a))
                    for a in (first + sweep * k / count for k in range(count))
                ]
            else:
                points.append(segment[0])
        short = [(float(f"{x:.6g}"), float(f"{y:.6g}")) for x, y in points]
        for a, b in zip(short, [*short[1:], short[0]], strict=True):
            space.add_line(a, b)
    return document
