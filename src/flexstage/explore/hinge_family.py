"""A stage of which each hinge is varied by itself: its neck, and the place of its notch."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from flexstage.arrays import Array
from flexstage.designs.template import StageTemplate
from flexstage.errors import ModelError
from flexstage.explore.family import Family
from flexstage.explore.variables import USUAL_SHARE, Variable, matching_names
from flexstage.stage import Hinge, Stage

#: What about a zero is called its range, of which a difference quotient takes a small part [m].
ABOUT_ZERO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeFamily(Family):
    """A stage of which each hinge is varied by itself; its bodies stay as they are."""

    places: tuple[tuple[str, str], ...]
    """Hinge and what of it each variable is: neck, along or across."""

    def stage(self, point: Array) -> Stage:
        described = self.template.stage()
        hinges = {hinge.name: hinge for hinge in described.hinges}
        for (name, part), value in zip(self.places, map(float, point), strict=True):
            hinges[name] = _changed(hinges[name], part, value)
        return replace(described, hinges=tuple(hinges.values()))

    def text(self, point: Array, name: str | None = None, title: str | None = None) -> str:
        raise ModelError("no parameter of a stage file is the neck of one hinge alone")


def _changed(hinge: Hinge, part: str, value: float) -> Hinge:
    if part == "neck":
        if value == hinge.profile.neck_thickness:
            return hinge
        return replace(hinge, profile=replace(hinge.profile, neck_thickness=value))
    return replace(hinge, at=hinge.to_plane(*((value, 0.0) if part == "along" else (0.0, value))))


_PARTS = {
    "neck": "thickness of its neck",
    "along": "place of its notch along the line from body to body",
    "across": "place of its notch across that line, to the left",
}


def hinge_family(template: StageTemplate) -> HingeFamily:
    """Return a stage with neck and place of every hinge as variables: ``NAME.neck``."""
    variables, places = [], []
    for hinge in template.stage().hinges:
        for part, told in _PARTS.items():
            usual = hinge.profile.neck_thickness if part == "neck" else 0.0
            around = USUAL_SHARE * usual or ABOUT_ZERO
            places.append((hinge.name, part))
            variables.append(
                Variable(
                    name=f"{hinge.name}.{part}",
                    low=usual - around,
                    high=usual + around,
                    usual=usual,
                    dimension="length",
                    description=told,
                )
            )
    return HingeFamily(template=template, variables=tuple(variables), places=tuple(places))


def hinge_variables(template: StageTemplate, patterns: Sequence[str] = ()) -> HingeFamily:
    """Return neck and place of the hinges of some names as variables, of all where none is given.

    A pattern is that of a hinge, ``x*``, or of what of it is varied, ``*.neck``.

    Raises
    ------
    ModelError
        No hinge has such a name.
    """
    family = hinge_family(template)
    if not patterns:
        return family
    names = dict.fromkeys(family.names)
    hinges = dict.fromkeys(name for name, _ in family.places)
    chosen: set[str] = set()
    for pattern in patterns:
        if any(fnmatchcase(hinge, pattern) for hinge in hinges):
            chosen |= {f"{h}.{p}" for h, p in family.places if fnmatchcase(h, pattern)}
        else:
            chosen |= set(matching_names(names, [pattern], template.source, "hinge"))
    kept = [k for k, name in enumerate(family.names) if name in chosen]
    return replace(
        family,
        variables=tuple(family.variables[k] for k in kept),
        places=tuple(family.places[k] for k in kept),
    )
