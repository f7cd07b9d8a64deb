"""Bodies and notches of a stage as polygons, for the checks that compare them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from flexstage.hinges import Profile
from flexstage.stage.contour import half_notch
from flexstage.stage.model import Body, Hinge, Issue, Stage, millimetres
from flexstage.stage.outline import Circle, Loop

#: Largest distance of a polygon from the arc that it approximates [m].
CHORD = 0.5e-6
#: How far a hole may reach over the edge before it counts [m].
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Shape:
    """A body without its notches, or a notch, as a polygon."""

    name: str
    """Name of the body or hinge."""
    polygon: Any
    """The area that it fills, to `CHORD`."""
    bodies: tuple[str, ...]
    """The body itself, or the two that a notch joins."""
    is_notch: bool
    """True if it is a notch."""

    @property
    def label(self) -> str:
        """Name in messages."""
        return f"the notch of hinge '{self.name}'" if self.is_notch else f"body '{self.name}'"


# the checks of a stage, and of its next variation, ask for the same again and again
@lru_cache(maxsize=1024)
def ring(shape: Loop | Circle) -> Any:
    """Return the polygon of a closed line, to `CHORD`."""
    from shapely import Polygon

    loop = shape.loop() if isinstance(shape, Circle) else shape
    return Polygon(loop.polyline(CHORD))


def drawn_openings(body: Body, narrower_than: float = 0.0) -> Any:
    """Return a body with the openings that may have narrow places, or None where it has none.

    They are those of its outline, and its holes except round ones that are wide enough [m].
    """
    holes = [
        ring(hole)
        for hole in (*body.holes, *body.mounting_holes)
        if not (isinstance(hole, Circle) and 2.0 * hole.radius >= narrower_than)
    ]
    outline = ring(body.outline)
    if not holes and outline.convex_hull.area <= outline.area * (1.0 + 1e-9):
        return None
    for hole in holes:
        outline = outline.difference(hole)
    return outline


def body_shapes(stage: Stage) -> tuple[list[Shape], list[Issue]]:
    """Return the polygons of bodies with valid outlines, and the issues of the others."""
    results = [_body_shape(body) for body in stage.bodies]
    shapes = [shape for shape, _ in results if shape is not None]
    return shapes, [issue for _, issues in results for issue in issues]


# checks and figures of one stage ask for the same bodies
@lru_cache(maxsize=256)
def _body_shape(body: Body) -> tuple[Shape | None, tuple[Issue, ...]]:
    faults = tuple(_outline_faults(body))
    if faults:
        return None, faults
    polygon = ring(body.outline)
    for hole in (*body.holes, *body.mounting_holes):
        polygon = polygon.difference(ring(hole))
    return Shape(body.name, polygon, (body.name,), False), ()


def notch_shapes(hinges: list[Hinge]) -> list[Shape]:
    """Return the polygons of notches, both halves in one."""
    from shapely import transform

    shapes = []
    for hinge in hinges:
        c, s = math.cos(hinge.direction), math.sin(hinge.direction)
        turn, at = np.array([[c, s], [-s, c]]), np.array(hinge.at)
        polygon = transform(_notch(hinge.profile), lambda xy, t=turn, a=at: xy @ t + a)
        shapes.append(Shape(hinge.name, polygon, hinge.bodies, True))
    return shapes


# a stage has dozens of hinges but a handful of profiles
@lru_cache(maxsize=256)
def _notch(profile: Profile) -> Any:
    """Return the polygon of a notch about its neck, along x."""
    hinge = Hinge(name="", bodies=("", ""), at=(0.0, 0.0), direction=0.0, profile=profile)
    # a step at the root leaves a line without width, which a buffer of nothing takes away
    halves = [ring(half_notch(hinge, which)).buffer(0.0) for which in (0, 1)]
    return halves[0].union(halves[1])


def _outline_faults(body: Body) -> Iterator[Issue]:
    from shapely.validation import explain_validity

    def fault(code: str, text: str) -> Issue:
        return Issue(severity="error", code=code, what=(body.name,), message=text)

    outline = ring(body.outline)
    labelled = [("outline", outline)]
    labelled += [(f"holes[{k}]", ring(hole)) for k, hole in enumerate(body.holes)]
    labelled += [(f"mounting_holes[{k}]", ring(h)) for k, h in enumerate(body.mounting_holes)]
    for label, polygon in labelled:
        if not polygon.is_valid:
            # "Self-intersection[x y]"
            place = explain_validity(polygon).partition("[")[2].rstrip("]").split()
            where = f" at {millimetres(*map(float, place))}" if len(place) == 2 else ""
            yield fault(
                "self-intersection",
                f"{label} of body '{body.name}' crosses or touches itself{where}: order its "
                "points once around",
            )
            return
    for label, hole in labelled[1:]:
        if not outline.buffer(_ROUNDING).contains(hole):
            yield fault(
                "hole-outside",
                f"{label} of body '{body.name}' reaches beyond its outline: draw the opening as "
                "part of the outline, or move the hole",
            )
            return
    for i, (label, hole) in enumerate(labelled[1:], start=1):
        for other_label, other in labelled[i + 1 :]:
            if not hole.intersection(other).buffer(-_ROUNDING).is_empty:
                yield fault(
                    "holes-overlap",
                    f"{label} and {other_label} of body '{body.name}' overlap: join them into one",
                )
                return
