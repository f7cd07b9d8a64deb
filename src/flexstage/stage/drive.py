"""Drives of a stage: the actuator, and its place and spring between two bodies."""

import math
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import StageError
from flexstage.files.ranges import NOT_NEGATIVE, POSITIVE, Size, require_ranges
from flexstage.quantities.units import DIMENSIONS, Stiffness
from flexstage.stage.outline import Point
from flexstage.stage.seat import Preload, Seat, seats_stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveHeat:
    """Heat of an actuator, for the thermal drift in time."""

    capacity: Annotated[float, DIMENSIONS["heat capacity"], POSITIVE]
    """Heat capacity [J/K]."""
    conductance: Annotated[float, DIMENSIONS["thermal conductance"], POSITIVE]
    """Thermal conductance from end to end, of a bar conductivity times area over length [W/K]."""
    surface: Annotated[float, DIMENSIONS["area"], NOT_NEGATIVE] = 0.0
    """Surface in the air [m^2]."""
    power: Annotated[float, DIMENSIONS["power"], NOT_NEGATIVE] | None = None
    """Constant heat in it [W]; of a stack, where not given, that of a rate and a loss factor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuator:
    """Base class of actuators; use one of its kinds."""

    kind: ClassVar[str]

    mass: Annotated[float, DIMENSIONS["mass"], POSITIVE] | None = None
    """Mass that moves with the bodies of the stage [kg]; none where not given."""
    thermal_expansion: Annotated[float, DIMENSIONS["expansion"]] | None = None
    """Coefficient of linear expansion along the drive [1/K]; negative for poled stacks."""
    thermal_expansion_uncertainty: (
        Annotated[float, DIMENSIONS["expansion"], NOT_NEGATIVE] | None
    ) = None
    """Standard uncertainty of this coefficient [1/K]; none where not given."""
    length: Size | None = None
    """Length that expands with temperature [m]; in a stage the distance of its points where not
    given.
    """
    heat: DriveHeat | None = None
    """Its heat in time; without it, it has the mean temperature of its bodies and conducts none."""

    @property
    def stroke(self) -> float | None:
        """Largest free displacement [m]; None for a force."""
        return None

    @property
    def smallest_displacement(self) -> float | None:
        """Smallest commanded change of the free displacement [m]; None where not known."""
        return None

    @property
    def spring(self) -> float | None:
        """Stiffness of the actuator itself [N/m]; None if rigid or not given, 0 for a force."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScrewActuator(Actuator):
    """An adjustment screw."""

    kind: ClassVar[str] = "screw"

    pitch: Size
    """Advance in one turn [m]."""
    smallest_step: Size
    """Smallest displacement that can be set [m]."""
    travel: Size
    """Displacement that is used [m]."""
    stiffness: Annotated[Stiffness, POSITIVE] | None = None
    """Axial stiffness of screw and nut [N/m]; rigid where not given."""
    largest_speed: Annotated[float, DIMENSIONS["speed"], POSITIVE] | None = None
    """Largest speed at which it may be turned, as its advance [m/s]."""

    @property
    def stroke(self) -> float | None:
        return self.travel

    @property
    def smallest_displacement(self) -> float | None:
        return self.smallest_step

    @property
    def spring(self) -> float | None:
        return self.stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class StackActuator(Actuator):
    """A piezoelectric stack."""

    kind: ClassVar[str] = "piezo"

    free_stroke: Size
    """Free displacement over the voltage range [m]."""
    stiffness: Annotated[Stiffness, POSITIVE]
    """Axial stiffness of the stack [N/m]."""
    blocking_force: Annotated[float, DIMENSIONS["force"], POSITIVE] | None = None
    """Force at the full voltage and no displacement [N]."""
    capacitance: Annotated[float, DIMENSIONS["capacitance"], POSITIVE] | None = None
    """Electrical capacitance [F]."""
    voltage_range: Annotated[tuple[float, float], DIMENSIONS["voltage"]] | None = None
    """Lowest and highest allowed voltage [V]."""
    largest_slew: Annotated[float, DIMENSIONS["slew rate"], POSITIVE] | None = None
    """Largest rate at which its voltage may change [V/s]."""

    @property
    def blocked_force(self) -> float:
        """Blocking force of the maker, or stiffness times free stroke [N]."""
        return self.blocking_force or self.stiffness * self.free_stroke

    @property
    def stroke(self) -> float | None:
        return self.free_stroke

    @property
    def spring(self) -> float | None:
        return self.stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class VoiceCoil(Actuator):
    """A source of force that does not depend on displacement."""

    kind: ClassVar[str] = "force"

    largest_force: Annotated[float, DIMENSIONS["force"], POSITIVE]
    """Largest force [N]."""

    @property
    def spring(self) -> float | None:
        return 0.0


#: An actuator of any kind, distinguished by ``kind``.
AnyActuator = ScrewActuator | StackActuator | VoiceCoil


class MountedDrive(NamedTuple):
    """A drive with its seats and its preload spring, as the stage feels it at rest."""

    stiffness: float | None
    """Stiffness against small displacements [N/m]; None if rigid, 0 for a force."""
    stroke: float | None
    """Free displacement [m]; None for a force."""
    smallest_displacement: float | None
    """Smallest commanded change of the free displacement [m]; None where not known."""


@dataclass(frozen=True, kw_only=True)
class Drive(Actuator):
    """Base class of drives, an actuator and its place in a stage; use one of its kinds.

    Notes
    -----
    Push and reaction act along one line, which goes through the pushed point in the direction of
    the drive and turns with the reacting body. The point on the reacting body is the place of the
    drive; `flexstage.stage.check` warns where it is further from that line than the patch reaches.
    """

    __slots__ = ()  # a kind has room for these fields and those of its actuator

    name: str
    """Name."""
    pushes: str
    """The body that it moves."""
    reacts: str
    """The body that it reacts on."""
    at: tuple[Point, Point]
    """The points on the pushed and on the reacting body [m]."""
    direction: Annotated[float, DIMENSIONS["angle"]]
    """Direction in which it pushes, from the x axis to the left [rad]."""
    patch_half_width: Size = 3e-3
    """Half of the width over which the force is spread [m]."""
    seats: tuple[Seat, ...] = ()
    """Contacts at its ends, in series; where there are none, it is joined rigidly."""
    preload: Preload | None = None
    """Force that presses it on its seats."""

    def __post_init__(self) -> None:
        require_ranges(self, StageError, f"drive '{self.name}'")
        for part in (*self.seats, *filter(None, (self.preload, self.heat))):
            require_ranges(part, StageError, f"drive '{self.name}'")
        if self.spring == 0.0 and (self.seats or self.preload):
            raise StageError(
                f"drive '{self.name}' is a pure force, which has no seats and no preload: remove "
                "the keys 'seats' and 'preload'"
            )
        if self.preload is None and not all(seat.pulls for seat in self.seats):
            raise StageError(
                f"drive '{self.name}' stands on seats that only press: give its 'preload', the "
                "force at rest, such as preload: {force: 50 N}"
            )

    @property
    def pulls(self) -> bool:
        """True if no seat lifts off under a pulling force."""
        return all(seat.pulls for seat in self.seats)

    def compression(self, force: float) -> float:
        """Return by how much drive and seats shorten from rest under a force of the stage [m].

        Minus infinity where a seat lifts off.
        """
        shorter = 0.0 if self.spring is None else force / self.spring
        rest = self.preload.force if self.preload else 0.0
        if not self.pulls and rest + force < 0.0:
            return -math.inf
        return shorter + sum(seat.approach(rest + force, rest) for seat in self.seats)

    def compressions(self, force: Array) -> Array:
        """Return `compression` for many forces."""
        shorter = np.zeros_like(force) if self.spring is None else force / self.spring
        rest = self.preload.force if self.preload else 0.0
        for seat in self.seats:
            shorter = shorter + seat.approaches(rest + force, rest)
        return shorter if self.pulls else np.where(rest + force < 0.0, -math.inf, shorter)

    def tangent(self, force: float) -> float | None:
        """Return the stiffness of drive and seats under a pressing force [N/m]; None if rigid."""
        seats = seats_stiffness(self.seats, force)
        if math.isinf(seats) or self.spring is None:
            return self.spring if math.isinf(seats) else seats
        return self.spring * seats / (self.spring + seats)

    @property
    def mounted(self) -> MountedDrive:
        """The drive with its seats, under its preload, and with its preload spring."""
        chain = self.tangent(self.preload.force if self.preload else 0.0)
        spring = self.preload.spring_stiffness if self.preload else 0.0
        if chain is None or spring == 0.0:
            return MountedDrive(chain, self.stroke, self.smallest_displacement)
        share = chain / (chain + spring)
        least = self.smallest_displacement
        return MountedDrive(
            chain + spring,
            None if self.stroke is None else share * self.stroke,
            None if least is None else share * least,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Screw(ScrewActuator, Drive):
    """An adjustment screw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PiezoStack(StackActuator, Drive):
    """A piezoelectric stack."""

    def __post_init__(self) -> None:
        Drive.__post_init__(self)
        if self.voltage_range is not None and not self.voltage_range[0] < self.voltage_range[1]:
            raise StageError(
                f"drive '{self.name}': voltage_range must rise, got {self.voltage_range!r} V"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Force(VoiceCoil, Drive):
    """A force that does not depend on displacement, such as a voice coil's."""


#: Kinds of drives, as files name them.
DRIVES: dict[str, type[Drive]] = {kind.kind: kind for kind in (Screw, PiezoStack, Force)}


def placed(actuator: AnyActuator, **place: Any) -> Drive:
    """Return an actuator as a drive of a stage; `place` has the fields of every `Drive`."""
    actuator_fields = {f.name: getattr(actuator, f.name) for f in fields(actuator)}
    return DRIVES[actuator.kind](**place, **actuator_fields)
