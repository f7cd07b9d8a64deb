"""The description of a stage: bodies, hinges, drives, probes, material, thickness. No physics."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, TypeVar

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import FlexstageError, StageError
from flexstage.base.short_repr import short_repr
from flexstage.files.ranges import NOT_NEGATIVE, Size, require_ranges
from flexstage.hinges import Profile
from flexstage.quantities.characteristic import Characteristic
from flexstage.quantities.material import Material
from flexstage.quantities.units import DIMENSIONS, Angle, Length
from flexstage.stage.bench import Bench
from flexstage.stage.drive import Drive
from flexstage.stage.outline import Circle, Loop, Point

_T = TypeVar("_T", "Body", "Hinge", "Drive", "Probe", "Axis")


@dataclass(frozen=True, slots=True, kw_only=True)
class Issue:
    """An error in the description of a stage, or a likely one."""

    severity: Literal["error", "warning"]
    """``error`` if the stage is impossible as described, ``warning`` if it looks unintended."""
    code: str
    """Short name of the kind of issue."""
    what: tuple[str, ...]
    """Names of the bodies, hinges, drives or probes concerned."""
    message: str
    """The fault, the value, and the remedy, in one sentence."""


def millimetres(*values: float) -> str:
    """Format lengths for messages.

    One length, or the coordinates of a point [m].

    Examples
    --------
    >>> millimetres(0.2e-3), millimetres(3e-3, 4.5e-3)
    ('0.2 mm', '(3, 4.5) mm')
    """
    # nothing is known better than a nanometre; adding 0 turns -0 into 0
    texts = [f"{round(v * 1e3, 6) + 0.0:.6g}" for v in values]
    return f"{texts[0]} mm" if len(texts) == 1 else f"({', '.join(texts)}) mm"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtraMass:
    """A mass mounted on a body, not part of the plate.

    Raises
    ------
    StageError
        Mass or inertia is negative or not finite.
    """

    mass: Annotated[float, DIMENSIONS["mass"], NOT_NEGATIVE]
    """Mass [kg]."""
    at: Point
    """Centre of mass in the plane [m]."""
    inertia: Annotated[float, DIMENSIONS["inertia"], NOT_NEGATIVE] = 0.0
    """Moment of inertia about its own centre, normal to the plane [kg m^2]."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "an extra mass")


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A part of the plate that is meant to be rigid.

    Its outline excludes the notches; the half of each notch that touches it belongs to it.
    """

    name: str
    """Name."""
    outline: Loop
    """Outline, without the half notches cut into it."""
    holes: tuple[Loop | Circle, ...] = ()
    """Openings in it; other bodies may lie inside them."""
    mounting_holes: tuple[Circle, ...] = ()
    """Holes by which it is bolted down or carries a load."""
    fixed: bool = False
    """True if it is fixed."""
    extra_masses: tuple[ExtraMass, ...] = ()
    """Masses mounted on it."""
    material: Material | None = None
    """Material of its outline, bonded to its half notches; that of the plate where not given. In
    finite elements it reaches into a notch that is almost parallel to its root before it ends.
    """
    rigid: bool = False
    """True if its outline is deformed by temperature alone: in finite elements, and at the roots of
    its hinges in the lumped model.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class Hinge:
    """A notch between two bodies."""

    name: str
    """Name."""
    bodies: tuple[str, str]
    """The bodies a and b that it joins."""
    at: Point
    """Centre of the neck [m]."""
    direction: Angle
    """Direction from body a to body b, from the x axis to the left [rad]."""
    profile: Profile
    """The shape of the notch."""

    def to_plane(self, along: float, across: float) -> tuple[float, float]:
        """Map a point in the hinge's own axes to the plane of the stage.

        Parameters
        ----------
        along : float
            Distance from the neck towards body b [m].
        across : float
            Distance from the hinge's line, positive to the left [m].

        Returns
        -------
        tuple of float
            The point (x, y) [m].
        """
        c, s = math.cos(self.direction), math.sin(self.direction)
        return (self.at[0] + c * along - s * across, self.at[1] + s * along + c * across)

    def from_plane(self, point: tuple[float, float]) -> tuple[float, float]:
        """Map a point of the plane of the stage to the hinge's own axes.

        Parameters
        ----------
        point : tuple of float
            The point (x, y) [m].

        Returns
        -------
        tuple of float
            Distances along and across the hinge, the arguments of `to_plane` [m].
        """
        c, s = math.cos(self.direction), math.sin(self.direction)
        x, y = point[0] - self.at[0], point[1] - self.at[1]
        return c * x + s * y, c * y - s * x


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """A point at which motion is measured.

    Raises
    ------
    StageError
        It reads a displacement and has no direction, or a rotation and has one.
    """

    name: str
    """Name."""
    body: str
    """The measured body."""
    at: Point
    """The point [m]; of a rotation, where it is drawn and the distance of drives is taken from."""
    direction: Angle | None = None
    """The direction in which a displacement is read, from the x axis to the left [rad]."""
    relative_to: str | None = None
    """The reference body; the ground where not given."""
    reads: Literal["displacement", "rotation"] = "displacement"
    """Measured quantity: the displacement of the point [m], or the rotation of the body [rad]."""

    def __post_init__(self) -> None:
        if self.reads == "displacement" and self.direction is None:
            raise StageError(
                f"probe '{self.name}' reads a displacement, and its direction is missing (an angle "
                'such as "90 deg"): give one, or write "reads: rotation"'
            )
        if self.reads == "rotation" and self.direction is not None:
            raise StageError(
                f"probe '{self.name}' reads a rotation, which has no direction in the plane: "
                "remove its direction"
            )

    @property
    def unit(self) -> str:
        """Unit of its reading."""
        return "m" if self.direction is not None else "rad"

    @property
    def row(self) -> tuple[float, float, float]:
        """Reading for a unit of displacement x, y and of rotation of the body at its point."""
        if self.direction is None:
            return (0.0, 0.0, 1.0)
        return (math.cos(self.direction), math.sin(self.direction), 0.0)

    @property
    def along(self) -> tuple[float, float]:
        """The direction that is read, as a unit vector.

        Raises
        ------
        StageError
            A rotation is read.
        """
        if self.direction is None:
            raise StageError(
                f"probe '{self.name}' reads a rotation, where a displacement is needed: choose a "
                "probe with a direction"
            )
        return self.row[:2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One direction of positioning, with its drives and its probe.

    Raises
    ------
    StageError
        It has no drive, both `drive` and `drives`, or the same drive twice.
    """

    name: str
    """Name."""
    drive: str | None = None
    """The drive that moves it, where it is one."""
    probe: str
    """The probe that reads it."""
    drives: tuple[str, ...] = ()
    """The drives that move it together, where they are several."""

    def __post_init__(self) -> None:
        if (self.drive is None) == (not self.drives):
            raise StageError(
                f"axis '{self.name}' must name its drives: 'drive' for one, or 'drives' for "
                f"several, got {'none' if self.drive is None else 'both'}"
            )
        if len(set(self.drives)) < len(self.drives):
            raise StageError(f"axis '{self.name}' names a drive twice: {', '.join(self.drives)}")
        if len(self.drives) == 1:
            # one way to say it, so that equal stages are equal
            object.__setattr__(self, "drive", self.drives[0])
            object.__setattr__(self, "drives", ())

    @property
    def moved_by(self) -> tuple[str, ...]:
        """Names of all drives that move it."""
        return self.drives if self.drive is None else (self.drive,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Manufacture:
    """Limits of the process that cuts the stage.

    Raises
    ------
    StageError
        One is negative or not finite.
    """

    wire_width: Annotated[Length, NOT_NEGATIVE] = 0.35e-3
    """Width of the narrowest slot that can be cut [m]."""
    minimum_neck: Annotated[Length, NOT_NEGATIVE] = 0.3e-3
    """Thinnest neck that can be cut [m]."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "the manufacture")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """A monolithic flexure stage.

    Raises
    ------
    StageError
        Two parts share a name, or a name refers to no part.
    """

    name: str
    """Name."""
    title: str = ""
    """Description in one line."""
    thickness: Size
    """Thickness of the plate [m]."""
    material: Material
    """Material of the plate."""
    bodies: tuple[Body, ...]
    """Rigid parts."""
    hinges: tuple[Hinge, ...] = ()
    """Notches."""
    drives: tuple[Drive, ...] = ()
    """Drives."""
    probes: tuple[Probe, ...] = ()
    """Probes."""
    axes: tuple[Axis, ...] = ()
    """Directions of positioning."""
    manufacture: Manufacture = field(default_factory=Manufacture)
    """Limits of the cutting process."""
    bench: Bench | None = None
    """Base plate and sensor holder, for thermal drift."""
    published: tuple[Characteristic, ...] = ()
    """Published figures."""
    notes: tuple[str, ...] = ()
    """Notes for every result; those that begin with Published appear in a study only."""

    # how a notebook shows a stage; set by the room that draws
    _notebook_html: ClassVar["Callable[[Stage], str] | None"] = None

    __repr__ = short_repr

    def _repr_html_(self) -> str | None:
        draw = type(self)._notebook_html
        return None if draw is None else draw(self)

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a stage")
        if not self.bodies:
            raise StageError("a stage needs at least one body, got none")
        if any(b.material == self.material for b in self.bodies):
            # one way to say it, so that they keep to the plate where its material changes
            plain = (
                replace(b, material=None) if b.material == self.material else b for b in self.bodies
            )
            object.__setattr__(self, "bodies", tuple(plain))
        bodies = _unique("body", self.bodies)
        _unique("hinge", self.hinges)
        drives = _unique("drive", self.drives)
        probes = _unique("probe", self.probes)
        _unique("axis", self.axes)
        for h in self.hinges:
            for name in h.bodies:
                _require_name(f"hinge '{h.name}'", "body", name, bodies)
            if h.bodies[0] == h.bodies[1]:
                raise StageError(f"hinge '{h.name}' joins body '{h.bodies[0]}' to itself")
        for d in self.drives:
            for name in (d.pushes, d.reacts):
                _require_name(f"drive '{d.name}'", "body", name, bodies)
        for p in self.probes:
            for name in (p.body, *(() if p.relative_to is None else (p.relative_to,))):
                _require_name(f"probe '{p.name}'", "body", name, bodies)
        for a in self.axes:
            for name in a.moved_by:
                _require_name(f"axis '{a.name}'", "drive", name, drives)
            _require_name(f"axis '{a.name}'", "probe", a.probe, probes)

    @property
    def other_bodies(self) -> tuple[Body, ...]:
        """Bodies that are rigid or of another material than the plate."""
        return tuple(b for b in self.bodies if b.rigid or b.material is not None)

    @property
    def materials_note(self) -> str:
        """Which bodies keep their material where that of the plate changes; empty where none."""
        names = ", ".join(b.name for b in self.bodies if b.material is not None)
        return f"bodies of another material keep theirs ({names})" if names else ""

    @property
    def materials(self) -> str:
        """Material of the plate and what other bodies are, as text."""
        parts = [self.material.name]
        for body in self.other_bodies:
            words = [] if body.material is None else [body.material.name]
            parts.append(f"{body.name}: {', '.join([*words, *['rigid'] * body.rigid])}")
        return "; ".join(parts)

    @property
    def material_notes(self) -> tuple[str, ...]:
        """Note on the materials where there are several, or a rigid body."""
        note = f"Materials: {self.materials}; half notches are of the first."
        return (note,) if self.other_bodies else ()

    @property
    def expands(self) -> bool:
        """Whether plate and bodies have coefficients of expansion."""
        every = (self.material, *map(self.material_of, self.bodies))
        return all(m.thermal_expansion is not None for m in every)

    def material_of(self, body: Body) -> Material:
        """Return the material of a body without its half notches."""
        return body.material or self.material

    @property
    def own_notes(self) -> tuple[str, ...]:
        """Notes without those on published figures."""
        return tuple(note for note in self.notes if not note.startswith("Published"))

    def body(self, name: str) -> Body:
        """Return a body by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Body
            The body.
        """
        return _find("body", name, self.bodies)

    def hinge(self, name: str) -> Hinge:
        """Return a hinge by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Hinge
            The hinge.
        """
        return _find("hinge", name, self.hinges)

    def drive(self, name: str) -> Drive:
        """Return a drive by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Drive
            The drive.
        """
        return _find("drive", name, self.drives)

    def probe(self, name: str) -> Probe:
        """Return a probe by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Probe
            The probe.
        """
        return _find("probe", name, self.probes)

    def axis(self, name: str) -> Axis:
        """Return an axis by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        Axis
            The axis.
        """
        return _find("axis", name, self.axes)

    def drive_of(self, axis: str) -> Drive:
        """Return the drive that moves an axis alone.

        Parameters
        ----------
        axis : str
            Name of the axis.

        Returns
        -------
        Drive
            The drive.

        Raises
        ------
        StageError
            Several drives move it together.
        """
        return self.drive(only_drive(axis, self.axis(axis).moved_by, StageError))


def only_drive(axis: str, drives: tuple[str, ...], error: type[FlexstageError]) -> str:
    """Return the one drive of an axis; refuse, with an error of a class, one that has several."""
    if len(drives) != 1:
        raise error(
            f"axis '{axis}' is moved by the drives {', '.join(drives)} together, but this needs "
            "an axis with a single drive (its key 'drive')"
        )
    return drives[0]


def _unique(noun: str, things: tuple) -> set[str]:
    names: set[str] = set()
    for thing in things:
        if thing.name in names:
            raise StageError(
                f"two {noun} entries are called '{thing.name}': give each its own name"
            )
        names.add(thing.name)
    return names


def _require_name(who: str, noun: str, name: str, names: set[str]) -> None:
    if name not in names:
        hint = did_you_mean(name, names, 0.3)
        have = ", ".join(sorted(names)[:12]) or "none"
        raise StageError(
            f"{who} names the {noun} '{name}', which does not exist (there are: {have}){hint}"
        )


def _find(noun: str, name: str, things: tuple[_T, ...]) -> _T:
    for thing in things:
        if thing.name == name:
            return thing
    _require_name("the request", noun, name, {t.name for t in things})
    raise AssertionError
