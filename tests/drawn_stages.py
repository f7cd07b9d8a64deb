"""What a drawing gave, held against the stage that it was drawn from."""

import io
import math
from dataclasses import fields, replace
from typing import Any

import ezdxf
import pytest

from flexstage.export.drawing.dxf import dxf_files
from flexstage.hinges import Elliptical, Leaf, Profile, RightCircular
from flexstage.lumped import lumped_system
from flexstage.stage import Body, Hinge, Stage
from flexstage.system import analyse

#: Figures that must be the same, as they are called.
FIGURES = ("natural_frequency_hz", "transmission_ratio", "max_stress")

_PURE = ("exponent", "half_opening_angle", "bulges")  # fields that are no lengths


def dxf_without_hinges(stage: Stage) -> Any:
    """Return the drawing that flexstage writes of a stage, as a document without its hinges."""
    (content,) = dxf_files(stage).values()
    document = ezdxf.filemanagement.read(io.StringIO(content.decode("utf-8")))  # type: ignore[arg-type]
    space = document.modelspace()
    for entity in list(space.query('*[layer=="HINGES"]')):
        space.delete_entity(entity)
    return document


def _key(body: Body) -> tuple[float, float, float]:
    a = body.outline.integrals()
    return a.area, a.x / a.area, a.y / a.area


def bodies_of(
    found: Stage, meant: Stage, *, within: float = 1e-9, layers: bool = True
) -> dict[str, str]:
    """Match all bodies by their outlines [m]; names in the drawing to those that are meant.

    Without layers a small opening is a mounting hole.
    """
    assert len(found.bodies) == len(meant.bodies)
    names: dict[str, str] = {}
    for body in meant.bodies:
        area, x, y = _key(body)

        def off(other: Body, area: float = area, x: float = x, y: float = y) -> float:
            a, u, v = _key(other)
            return abs(a - area) / math.sqrt(area) + math.dist((u, v), (x, y))

        near = min(found.bodies, key=off)
        assert off(near) < within, (body.name, near.name, off(near))
        assert near.name not in names
        names[near.name] = body.name
        if layers:
            assert len(near.mounting_holes) == len(body.mounting_holes), body.name
        openings = [len(b.mounting_holes) + len(b.holes) for b in (near, body)]
        assert openings[0] == openings[1], body.name
    return names


def require_same(
    found: Stage, meant: Stage, *, within: float = 1e-9, layers: bool = True
) -> dict[str, str]:
    """Require the same bodies, necks and profiles, to so many metres; return names of bodies."""
    names = bodies_of(found, meant, within=within, layers=layers)
    assert len(found.hinges) == len(meant.hinges)
    for hinge in meant.hinges:
        near = min(found.hinges, key=lambda h: math.dist(h.at, hinge.at))
        require_same_hinge(near, hinge, names, within=within)
    return names


def require_same_hinge(
    near: Hinge, hinge: Hinge, names: dict[str, str], *, within: float = 1e-9
) -> None:
    """Require that a neck is where and what is meant, seen from either body."""
    assert math.dist(near.at, hinge.at) < within, hinge.name
    bodies = tuple(names[b] for b in near.bodies)
    turned = bodies != hinge.bodies
    assert bodies == (hinge.bodies[::-1] if turned else hinge.bodies)
    lean = math.remainder(near.direction - hinge.direction - math.pi * turned, 2.0 * math.pi)
    assert abs(lean) * hinge.profile.length < 2.0 * within, hinge.name
    if hinge.profile.one_sided and near.profile.one_sided:
        assert not turned, "the cut side of a one-sided notch is on its left"
    require_same_profile(near.profile, hinge.profile, within=within)


def require_same_profile(found: Profile, meant: Profile, *, within: float = 1e-9) -> None:
    """Require the same kind and sizes [m]; how deep the step of a leaf is no contour says.

    An ellipse of equal half axes is a circle.
    """
    if isinstance(meant, Elliptical) and abs(meant.half_length - meant.notch_depth) < within:
        meant = RightCircular(
            neck_thickness=meant.neck_thickness,
            one_sided=meant.one_sided,
            radius=meant.half_length,
        )
    assert found.kind == meant.kind
    for field in fields(meant):
        if isinstance(meant, Leaf) and field.name in ("notch_depth", "one_sided"):
            continue
        a, b = getattr(found, field.name), getattr(meant, field.name)
        # an angle, or an exponent, changes by what lengths do over some tenths of a millimetre
        room = 1e4 * within if field.name in _PURE else within
        assert a == pytest.approx(b, rel=0.0, abs=room), field.name


def with_drives_of(found: Stage, meant: Stage, names: dict[str, str]) -> Stage:
    """Return the stage of a drawing with what no contour says: drives, probes, axes."""
    called = {b: a for a, b in names.items()}
    return replace(
        found,
        drives=tuple(
            replace(d, pushes=called[d.pushes], reacts=called[d.reacts]) for d in meant.drives
        ),
        probes=tuple(
            replace(
                p,
                body=called[p.body],
                relative_to=None if p.relative_to is None else called[p.relative_to],
            )
            for p in meant.probes
        ),
        axes=meant.axes,
        bodies=tuple(
            replace(b, fixed=old.fixed, extra_masses=old.extra_masses)
            for b in found.bodies
            for old in [meant.body(names[b.name])]
        ),
    )


def figures(stage: Stage, system: Any = None) -> dict[tuple[str, str], float]:
    """Return the figures that must come back, by quantity and axis."""
    made = analyse(stage, lumped_system(stage) if system is None else system)
    return {(c.quantity, c.axis): c.value for c in made.characteristics if c.quantity in FIGURES}
