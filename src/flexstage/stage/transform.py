"""Rigid motions and reflections of the plane, applied to the parts of a stage."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from flexstage.stage.drive import Drive
from flexstage.stage.model import Axis, Body, Hinge, Probe, Stage
from flexstage.stage.outline import Circle, Loop

_Pair = tuple[float, float]
_Part = TypeVar("_Part", bound=Loop | Circle | Body | Hinge | Drive | Probe | Axis | Stage)

#: New names: by a function, or by a mapping, which leaves names alone that it does not have.
Names = Callable[[str], str] | Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneMotion:
    """A motion of the plane that keeps distances: it mirrors at the x axis, turns, and shifts.

    Examples
    --------
    >>> PlaneMotion.rotation(math.pi / 2.0, about=(1.0, 0.0)).point((3.0, 0.5))
    (0.5, 2.0)
    >>> PlaneMotion.reflection(math.pi / 2.0, through=(1.0, 0.0)).point((3.0, 0.5))
    (-1.0, 0.5)
    """

    angle: float = 0.0
    """Angle by which it turns about the origin, to the left [rad]."""
    shift: _Pair = (0.0, 0.0)
    """Displacement after that [m]."""
    mirrored: bool = False
    """True if y is turned round before that."""

    @classmethod
    def rotation(cls, angle: float, *, about: _Pair = (0.0, 0.0)) -> "PlaneMotion":
        """Turn to the left by an angle [rad] about a point [m]."""
        return cls(angle=angle)._with_fixed(about)

    @classmethod
    def reflection(cls, direction: float, *, through: _Pair = (0.0, 0.0)) -> "PlaneMotion":
        """Mirror at the line of a direction [rad] through a point [m]."""
        return cls(angle=2.0 * direction, mirrored=True)._with_fixed(through)

    def _with_fixed(self, point: _Pair) -> "PlaneMotion":
        x, y = self.point(point)
        return replace(self, shift=(point[0] - x, point[1] - y))

    def point(self, point: _Pair) -> _Pair:
        """Move a point [m]."""
        c, s = _direction(self.angle)
        x, y = point[0], -point[1] if self.mirrored else point[1]
        return (c * x - s * y + self.shift[0], s * x + c * y + self.shift[1])

    def turned(self, direction: float) -> float:
        """Return what becomes of a direction [rad], between -pi and pi."""
        turned = self.angle - direction if self.mirrored else self.angle + direction
        return math.remainder(turned, 2.0 * math.pi)


def moved(part: _Part, motion: PlaneMotion, names: Names | None = None) -> _Part:
    """Move an outline, a body, a hinge, a drive, a probe or a whole stage.

    Parameters
    ----------
    part : Loop or Circle or Body or Hinge or Drive or Probe or Axis or Stage
        The part.
    motion : PlaneMotion
        The motion; of an axis, only the names change.
    names : callable or Mapping, optional
        New names, of the part itself and of the bodies, drives and probes that it names.

    Returns
    -------
    Loop or Circle or Body or Hinge or Drive or Probe or Axis or Stage
        The same, moved. A hinge whose notch is cut from one side goes from its second body to its
        first in a mirror, where the side that is open lies to the left again. A rotation is read to
        the left in a mirror too, so that its reading has the other sign.

    Examples
    --------
    >>> from flexstage.hinges import RightCircular
    >>> notch = RightCircular(neck_thickness=0.5e-3, radius=1e-3, one_sided=True)
    >>> hinge = Hinge(name="left", bodies=("base", "leg"), at=(-0.02, 0.001), direction=0.0,
    ...               profile=notch)
    >>> image = moved(hinge, PlaneMotion.reflection(math.pi / 2.0), {"left": "right"})
    >>> image.name, image.at, image.bodies, image.direction
    ('right', (0.02, 0.001), ('leg', 'base'), 0.0)
    """
    return _moved(part, motion, _renaming(names))


def _moved(part: Any, motion: PlaneMotion, new: Callable[[str], str]) -> Any:
    match part:
        case Loop():
            return part.mapped(motion.point)
        case Circle():
            return replace(part, centre=motion.point(part.centre))
        case Body():
            return replace(
                part,
                name=new(part.name),
                outline=part.outline.mapped(motion.point),
                holes=tuple(_moved(hole, motion, new) for hole in part.holes),
                mounting_holes=tuple(_moved(hole, motion, new) for hole in part.mounting_holes),
                extra_masses=tuple(replace(m, at=motion.point(m.at)) for m in part.extra_masses),
            )
        case Hinge():
            a, b = map(new, part.bodies)
            direction = motion.turned(part.direction)
            if motion.mirrored and part.profile.one_sided:
                a, b = b, a
                direction = math.remainder(direction + math.pi, 2.0 * math.pi)
            at = motion.point(part.at)
            return replace(part, name=new(part.name), bodies=(a, b), at=at, direction=direction)
        case Drive():
            return replace(
                part,
                name=new(part.name),
                pushes=new(part.pushes),
                reacts=new(part.reacts),
                at=(motion.point(part.at[0]), motion.point(part.at[1])),
                direction=motion.turned(part.direction),
            )
        case Probe():
            return replace(
                part,
                name=new(part.name),
                body=new(part.body),
                at=motion.point(part.at),
                direction=None if part.direction is None else motion.turned(part.direction),
                relative_to=None if part.relative_to is None else new(part.relative_to),
            )
        case Axis():
            return replace(
                part,
                name=new(part.name),
                drive=None if part.drive is None else new(part.drive),
                drives=tuple(map(new, part.drives)),
                probe=new(part.probe),
            )
        case Stage():
            return replace(
                part,
                bodies=tuple(_moved(body, motion, new) for body in part.bodies),
                hinges=tuple(_moved(hinge, motion, new) for hinge in part.hinges),
                drives=tuple(_moved(drive, motion, new) for drive in part.drives),
                probes=tuple(_moved(probe, motion, new) for probe in part.probes),
                axes=tuple(_moved(axis, motion, new) for axis in part.axes),
                published=tuple(replace(row, axis=new(row.axis)) for row in part.published),
            )


def _renaming(names: Names | None) -> Callable[[str], str]:
    if names is None:
        return lambda name: name
    if isinstance(names, Mapping):
        return lambda name: names.get(name, name)
    return names


def _direction(angle: float) -> _Pair:
    """Return cosine and sine, exact for quarter turns."""
    c, s = math.cos(angle), math.sin(angle)
    return (0.0 if abs(c) < 1e-15 else c, 0.0 if abs(s) < 1e-15 else s)
