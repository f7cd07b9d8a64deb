"""Stages with any notch, for the tests of drawings."""

import math
from collections.abc import Iterable
from typing import Any

import pytest

from flexstage.hinges import AsDrawn, Profile, RightCircular
from flexstage.hinges.conic import Elliptical, Hyperbolic, Parabolic, PowerFunction
from flexstage.hinges.straight import CornerFilleted, Leaf, VFillet
from flexstage.quantities.material import material
from flexstage.stage import Body, Circle, Hinge, Loop, Stage
from flexstage.stage.curve import Curve, distance
from flexstage.stage.designs import DESIGNS, design

Pair = tuple[float, float]

#: Built-in designs that are one plate; a stack of two is drawn, cut and written plate by plate.
PLATES: dict[str, Stage] = {
    name: stage
    for name, stage in ((n, design(n)) for n in DESIGNS)
    if sum(body.fixed for body in stage.bodies) == 1
}

# what is slow to draw, and drawn like others: all designs but some, and some notches
_ALWAYS = {"vgtu-mechanical", "vgtu-piezo", "parallelogram"}
_LIKE_OTHERS = {"circular", "elliptical-one-sided", "leaf", "parabolic", "hyperbolic"}


def quick(name: str, value: Any) -> Any:
    """A parameter of a test, slow for a stage whose drawing is made like that of others."""
    is_slow = name in _LIKE_OTHERS or (name in PLATES and name not in _ALWAYS)
    return pytest.param(value, id=name, marks=pytest.mark.slow if is_slow else ())


_SIZES: dict[str, Any] = {"neck_thickness": 0.47e-3, "half_length": 2.3e-3, "notch_depth": 1.1e-3}

#: One of each kind, and some of them cut from one side.
NOTCHES: dict[str, Profile] = {
    "circular": RightCircular(neck_thickness=0.53e-3, radius=1.7e-3),
    "circular-one-sided": RightCircular(neck_thickness=0.53e-3, radius=1.7e-3, one_sided=True),
    "elliptical": Elliptical(**_SIZES),
    "elliptical-one-sided": Elliptical(**_SIZES, one_sided=True),
    "corner-filleted": CornerFilleted(
        neck_thickness=0.41e-3, notch_length=5.3e-3, fillet_radius=0.9e-3
    ),
    "leaf": Leaf(neck_thickness=0.37e-3, leaf_length=6.1e-3, notch_depth=1.3e-3),
    "leaf-one-sided": Leaf(
        neck_thickness=0.37e-3, leaf_length=6.1e-3, notch_depth=1.3e-3, one_sided=True
    ),
    "parabolic": Parabolic(**_SIZES),
    "hyperbolic": Hyperbolic(**_SIZES),
    "v": VFillet(
        neck_thickness=0.61e-3, half_opening_angle=0.6, fillet_radius=0.7e-3, notch_depth=1.9e-3
    ),
    "power": PowerFunction(**_SIZES, exponent=3.7),
    # a strip, an arc of 45 degrees, a flank
    "as-drawn": AsDrawn(
        neck_thickness=0.43e-3,
        distances=(1.1e-3, 1.1e-3 + 0.8e-3 * math.sqrt(0.5), 2.2e-3),
        depths=(0.0, 0.8e-3 * (1.0 - math.sqrt(0.5)), 1.4e-3),
        bulges=(0.0, math.tan(math.pi / 16.0), 0.0),
    ),
}


def guide(profile: Profile, turn: float = 0.31, shift: Pair = (7.3e-3, -4.1e-3)) -> Stage:
    """A platform on two bars with four notches; turned and shifted, with corners in its edges."""
    length, height = profile.length, profile.root_height
    c, s = math.cos(turn), math.sin(turn)

    def move(p: Pair) -> Pair:
        return shift[0] + c * p[0] - s * p[1], shift[1] + s * p[0] + c * p[1]

    bar, apart = 9.7e-3, 2.0 * height + 11.3e-3
    low, high = length, length + bar
    top = high + length
    left, right = height + 0.4e-3, height + 0.9e-3

    def rectangle(x0: float, y0: float, x1: float, y1: float) -> Loop:
        # a corner within an edge, which a drawing has no use for
        points = ((x0, y0), (0.3 * x0 + 0.7 * x1, y0), (x1, y0), (x1, y1), (x0, y1))
        return Loop(points).mapped(move)

    wide = (-left - 6.1e-3, apart + right + 5.3e-3)
    bodies = (
        Body(
            name="base",
            outline=rectangle(wide[0], -8.3e-3, wide[1], 0.0),
            mounting_holes=(Circle(move((0.7e-3, -4.4e-3)), 1.6e-3),),
            fixed=True,
        ),
        *(
            Body(name=f"bar{k}", outline=rectangle(x - left, low, x + right, high))
            for k, x in enumerate((0.0, apart))
        ),
        Body(
            name="platform",
            outline=rectangle(wide[0], top, wide[1], top + 7.7e-3),
            holes=(Circle(move((5.9e-3, top + 3.6e-3)), 2.1e-3),),
        ),
    )
    hinges = []
    for k, x in enumerate((0.0, apart)):
        ends = ((0.5 * length, ("base", f"bar{k}")), (high + 0.5 * length, (f"bar{k}", "platform")))
        for n, (y, pair) in enumerate(ends):
            flip = bool((k + n) % 2)
            hinges.append(
                Hinge(
                    name=f"h{k}{n}",
                    bodies=(pair[1], pair[0]) if flip else pair,
                    at=move((x, y)),
                    direction=turn + (-0.5 if flip else 0.5) * math.pi,
                    profile=profile,
                )
            )
    return Stage(
        name="guide",
        title="Guide <with> any notch & corners",
        thickness=6.3e-3,
        material=material("Al 7075-T6"),
        bodies=bodies,
        hinges=tuple(hinges),
    )


def least_distance(pairs: Iterable[tuple[Curve, Curve]]) -> float:
    """The least of the exact distances of pairs of curves.

    Pairs that cannot be as near as the nearest so far are left out: no point of a curve is further
    from its middle than half its length.
    """
    apart = [
        (math.dist(a.point(0.5), b.point(0.5)) - 0.5 * (a.length + b.length), a, b)
        for a, b in pairs
    ]
    least = math.inf
    for bound, a, b in sorted(apart, key=lambda pair: pair[0]):
        if bound > least:
            break
        least = min(least, distance(a, b))
    return least
