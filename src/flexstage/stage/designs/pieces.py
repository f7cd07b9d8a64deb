"""Elements of designs: blocks, legs, holes, dimensions and their limits."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from flexstage.base.errors import StageError
from flexstage.files.ranges import Size, require_ranges
from flexstage.hinges import CornerFilleted, Profile
from flexstage.quantities.material import CATALOGUE, Material
from flexstage.stage import (
    Axis,
    Body,
    Circle,
    Drive,
    Hinge,
    Loop,
    Manufacture,
    PlaneMotion,
    Probe,
    Stage,
)
from flexstage.stage.drive import AnyActuator, ScrewActuator, StackActuator, placed
from flexstage.stage.model import millimetres

Pair = tuple[float, float]

#: Rounding of sums of dimensions, far below what can be cut [m].
ROUNDING = 1e-10
#: Usual width of the narrowest slot [m].
WIRE = Manufacture().wire_width


def box(low: Pair, high: Pair) -> Loop:
    """Return a rectangle by two opposite corners [m], the lower left one first."""
    return Loop((low, (high[0], low[1]), high, (low[0], high[1])))


def block(name: str, low: Pair, high: Pair, **fields: Any) -> Body:
    """Return a rectangular body by two opposite corners [m]; `fields` are others of `Body`."""
    return Body(name=name, outline=box(low, high), **fields)


def bolt_holes(centres: Iterable[Pair], diameter: float) -> tuple[Circle, ...]:
    """Return mounting holes of one diameter [m] about points [m]."""
    return tuple(Circle(centre, 0.5 * diameter) for centre in centres)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateParameters:
    """Parameters of every plate besides the dimensions of its mechanism.

    Raises
    ------
    StageError
        A dimension is not positive and finite, or not in its range.
    """

    thickness: Size = 8e-3
    """Thickness of the plate [m]."""
    material: Material = field(default_factory=lambda: CATALOGUE["Al 7075-T6"])
    """Material of the plate."""
    mounting_hole_diameter: Size = 5.5e-3
    """Diameter of the holes by which it is bolted down [m]."""
    force_patch_half_width: Size = 2e-3
    """Half of the width over which a drive spreads its force [m]."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a design")

    def _at_least(self, name: str, limit: float, why: str) -> None:
        """Refuse a dimension, by name, that is below a limit [m]."""
        at_least(name, getattr(self, name), limit, why)

    def _at_most(self, name: str, limit: float, why: str) -> None:
        """Refuse a dimension, by name, that is above a limit [m]."""
        at_most(name, getattr(self, name), limit, why)

    def _holes_within(self, limit: str) -> None:
        """Refuse mounting holes that are not narrower than another dimension, by its name."""
        hole, largest = self.mounting_hole_diameter, getattr(self, limit)
        if not hole < largest:
            raise StageError(
                f"mounting_hole_diameter must be under the {limit} of {millimetres(largest)}, "
                f"got {millimetres(hole)}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A straight leg that guides: a bar with a notch at either end, or one leaf.

    Raises
    ------
    StageError
        The bar has no length, or the notch is cut from one side.
    """

    notch: Profile
    """The notch at either end of the bar, or the leaf."""
    bar_length: Size | None = None
    """Length of the bar between the notches [m]; where not given, the leg is one notch, a leaf."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, "a leg")
        two_sided(self.notch, "a leg")

    @property
    def length(self) -> float:
        """Length of the leg, from body to body [m]."""
        if self.bar_length is None:
            return self.notch.length
        return self.bar_length + 2.0 * self.notch.length

    @property
    def width(self) -> float:
        """Width of the leg: the height of its notches at their roots [m]."""
        return self.notch.root_height

    @property
    def neck_distance(self) -> float:
        """Distance between its two necks [m]; none of a leaf, which has one."""
        return self.length - self.notch.length

    def between(
        self,
        name: str,
        bodies: tuple[str, str],
        start: Pair,
        direction: float,
        *,
        ends: tuple[str, str] | None = None,
    ) -> tuple[list[Body], list[Hinge]]:
        """Return its bar, where it has one, and its hinges.

        It begins at the point `start` [m] of the first of its `bodies` and goes in a `direction`
        [rad] to the second. The bar is called ``name-leg`` and its hinges ``name-end``, by the
        `ends`, which are the two bodies where they are not given; a leaf is called `name`.

        Examples
        --------
        >>> from flexstage.hinges import RightCircular
        >>> leg = Leg(notch=RightCircular(neck_thickness=0.5e-3, radius=1e-3), bar_length=10e-3)
        >>> bars, hinges = leg.between("left", ("base", "platform"), (0.0, 2e-3), 0.0)
        >>> [h.name for h in hinges], hinges[1].at
        (['left-base', 'left-platform'], (0.013, 0.002))
        """
        at = PlaneMotion(angle=direction, shift=start).point

        def hinge(name: str, a: str, b: str, distance: float) -> Hinge:
            return Hinge(
                name=name,
                bodies=(a, b),
                at=at((distance, 0.0)),
                direction=direction,
                profile=self.notch,
            )

        first, last = bodies
        half = 0.5 * self.notch.length
        if self.bar_length is None:
            return [], [hinge(name, first, last, half)]
        near, far, side = 2.0 * half, 2.0 * half + self.bar_length, 0.5 * self.width
        bar = Body(name=f"{name}-leg", outline=box((near, -side), (far, side)).mapped(at))
        one, other = ends or bodies
        return [bar], [
            hinge(f"{name}-{one}", first, bar.name, half),
            hinge(f"{name}-{other}", bar.name, last, far + half),
        ]


def round_leaf(length: float, thickness: float = 0.4e-3, fillet: float = 0.5e-3) -> Leg:
    """Return a leaf of a length [m], of round thickness and fillets [m]."""
    return Leg(
        notch=CornerFilleted(neck_thickness=thickness, notch_length=length, fillet_radius=fillet)
    )


def fine_screw(travel: float) -> ScrewActuator:
    """Return an adjustment screw of fine thread with a travel [m]."""
    return ScrewActuator(pitch=0.25e-3, smallest_step=0.5e-6, travel=travel)


def legs(
    leg: Leg, rows: Iterable[tuple[str, tuple[str, str], Pair, float]]
) -> tuple[list[Body], list[Hinge]]:
    """Return the bars and hinges of equal legs, each by name, bodies, start [m] and direction."""
    bodies: list[Body] = []
    hinges: list[Hinge] = []
    for row in rows:
        bars, notches = leg.between(*row)
        bodies += bars
        hinges += notches
    return bodies, hinges


def pushing(
    p: Any, name: str, pushes: str, at: tuple[Pair, Pair], direction: float, reacts: str = "base"
) -> Drive:
    """Return the actuator of dimensions `p` as a drive that pushes a body, off the base."""
    return placed(
        p.actuator,
        name=name,
        pushes=pushes,
        reacts=reacts,
        at=at,
        direction=direction,
        patch_half_width=p.force_patch_half_width,
    )


def plate(
    p: PlateParameters,
    name: str,
    title: str,
    *,
    bodies: Iterable[Body],
    hinges: Iterable[Hinge],
    drives: Iterable[Drive],
    probes: Iterable[Probe],
    axes: Iterable[Axis] | None = None,
) -> Stage:
    """Return a stage in a plate of dimensions `p`; an axis for each drive if none are given."""
    drives = tuple(drives)
    return Stage(
        name=name,
        title=title,
        thickness=p.thickness,
        material=p.material,
        bodies=tuple(bodies),
        hinges=tuple(hinges),
        drives=drives,
        probes=tuple(probes),
        axes=tuple(Axis(name=d.name, drive=d.name, probe=d.name) for d in drives)
        if axes is None
        else tuple(axes),
    )


def cut_apart(of: Any, *names: str) -> None:
    """Refuse slots of a description, by name, that are narrower than the wire."""
    for name in names:
        at_least(name, getattr(of, name), WIRE, "for the wire that cuts it")


def two_sided(notch: Profile, of: str) -> None:
    """Refuse a notch that is cut from one side, where the design needs both."""
    if notch.one_sided:
        raise StageError(
            f"the notch of {of} must be cut from both sides, got one_sided: remove that"
        )


def at_least(name: str, value: float, limit: float, why: str) -> None:
    """Refuse a dimension [m] that is below a limit."""
    if value < limit - ROUNDING:
        raise StageError(
            f"{name} must be at least {millimetres(limit)}, {why}, got {millimetres(value)}"
        )


def at_most(name: str, value: float, limit: float, why: str) -> None:
    """Refuse a dimension [m] that is above a limit."""
    if value > limit + ROUNDING:
        raise StageError(
            f"{name} must be at most {millimetres(limit)}, {why}, got {millimetres(value)}"
        )


# what the data sheets of co-fired stacks come to: 0.1 % of the length, and 900 N when held on 5 mm
# by 5 mm, which is a modulus of 36 GPa
_STRAIN = 1e-3
_BLOCKING_FORCE = 900.0


def round_stack(length: float) -> StackActuator:
    """Return a piezoelectric stack of 5 mm by 5 mm and a length [m], with rounded figures.

    Examples
    --------
    >>> stack = round_stack(36e-3)
    >>> round(stack.free_stroke * 1e6, 6), round(stack.stiffness / 1e6, 6)
    (36.0, 25.0)
    """
    stroke = _STRAIN * length
    return StackActuator(
        free_stroke=stroke,
        stiffness=_BLOCKING_FORCE / stroke,
        blocking_force=_BLOCKING_FORCE,
        voltage_range=(0.0, 120.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenPlateParameters(PlateParameters):
    """The dimensions of a plate with a drive in a pocket."""

    actuator: AnyActuator = field(default_factory=lambda: round_stack(20e-3))
    """Actuator of each axis or leg."""
    actuator_length: Size = 20e-3
    """Distance between the two faces that a drive pushes apart [m]."""
    actuator_width: Size = 7e-3
    """Width of the room for a drive [m]."""
    edge: Size = 1e-3
    """Overhang of bodies beyond the roots of their outermost hinges [m]."""
    slot: Size = 1e-3
    """Width of the slots between bodies [m]."""
    frame_wall: Size = 10e-3
    """Thickness of the base around the moving parts [m]."""

    def __post_init__(self) -> None:
        PlateParameters.__post_init__(self)
        self._holes_within("frame_wall")


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedPlateParameters(DrivenPlateParameters):
    """The dimensions of a driven plate with a block that legs guide on two of its sides."""

    guide: Leg = field(default_factory=lambda: round_leaf(16e-3))
    """The four legs or leaves that guide the block, two on a side."""
    guide_spacing: Size = 6e-3
    """Distance between the two legs on a side of the block [m]."""

    def __post_init__(self) -> None:
        DrivenPlateParameters.__post_init__(self)
        at_least(
            "guide_spacing",
            self.guide_spacing,
            self.guide.width + self.slot,
            "so that the two legs on a side keep a slot between them",
        )
