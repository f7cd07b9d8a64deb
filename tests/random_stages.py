"""Stages with a drive drawn at random: any mechanism, dimensions, notch and material."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from flexstage.base.errors import FlexstageError
from flexstage.files.format import field_types, optional_part
from flexstage.files.ranges import Size
from flexstage.hinges import Profile, RightCircular
from flexstage.hinges.conic import Elliptical, Parabolic, PowerFunction
from flexstage.quantities.material import CATALOGUE
from flexstage.quantities.units import Length
from flexstage.stage import Stage, check
from flexstage.stage.designs.pieces import Leg
from flexstage.stage.designs.registry import TOPOLOGIES

# mechanisms of two to four necks
_SMALL = ("parallelogram", "double-parallelogram", "cartwheel", "trapezoidal-pivot")
# and of seven to nine
_LARGE = ("compound-parallelogram", "scott-russell", "rhombus", "three-rrr")
_WIDEST = 0.25  # part by which a dimension differs from the usual one


def random_stages(seed: int, *, small: bool = False) -> Iterator[Stage]:
    """Draw stages without end, of two to nine necks; small ones have up to four.

    Profiles whose contour is many arcs, which make many elements, are those of few necks alone.
    """
    rng = np.random.default_rng(seed)
    names = _SMALL if small else (*_SMALL, *_LARGE)
    while True:
        name = names[rng.integers(len(names))]
        yield _stage(name, rng, shapes=3 if name in _SMALL and not small else 0)


def _stage(name: str, rng: np.random.Generator, shapes: int) -> Stage:
    """Draw one of a mechanism, its notch of some shapes, until its dimensions go together."""
    topology = TOPOLOGIES[name]
    usual = topology.usual()
    assert usual is not None
    materials = sorted(CATALOGUE.values(), key=lambda m: m.name)
    while True:
        material, kind = materials[rng.integers(len(materials))], int(rng.integers(8))
        try:
            stage = topology.construct(_varied(usual.parameters, rng))
            hinges = tuple(
                replace(h, profile=_notch(h.profile, kind if kind <= shapes else 0))
                for h in stage.hinges
            )
        except FlexstageError:
            continue
        stage = replace(stage, material=material, hinges=hinges)
        if not any(issue.severity == "error" for issue in check(stage)):
            return stage


def _factor(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(-1.0, 1.0) * np.log1p(_WIDEST)))


def _varied(parameters: Any, rng: np.random.Generator) -> Any:
    """Change every length of a description by its own factor."""
    changed: dict[str, Any] = {}
    for field, (_, kind) in field_types(type(parameters)).items():
        value = getattr(parameters, field)
        if isinstance(value, (Leg, Profile)):
            changed[field] = _varied(value, rng)
        elif isinstance(value, float) and (optional_part(kind) or kind) in (Size, Length):
            changed[field] = value * _factor(rng)
    return replace(parameters, **changed)


def _notch(profile: Profile, kind: int) -> Profile:
    """Give a notch another shape between the same roots; a leaf stays one."""
    if not isinstance(profile, RightCircular) or not kind:
        return profile
    given: dict[str, Any] = {
        "neck_thickness": profile.neck_thickness,
        "half_length": profile.length / 2.0,
        "notch_depth": profile.depth,
        "one_sided": profile.one_sided,
    }
    if kind == 3:
        return PowerFunction(**given, exponent=3.0)
    return (Elliptical, Parabolic)[kind - 1](**given)
