"""What drives an axis of a parametric design: the bought part, without the place it stands in."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.stage import Drive, Force, PiezoStack, Point, Screw
from flexstage.units import DIMENSIONS, Length, Stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a drive stands in a stage."""

    name: str
    """Name of the drive."""
    pushes: str
    """The body that it moves."""
    reacts: str
    """The body that it stands on."""
    at: tuple[Point, Point]
    """The points on the pushed and on the reacting body [m]."""
    direction: Annotated[float, DIMENSIONS["angle"]]
    """Direction in which it pushes, from the x axis to the left [rad]."""
    patch_half_width: Length
    """Half of the width over which the force is spread [m]."""

    def keywords(self) -> dict:
        """Return the place as the arguments that every `Drive` takes."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuator(ABC):
    """What every actuator can do; use one of its kinds."""

    kind: ClassVar[str]

    @abstractmethod
    def drive(self, place: Place) -> Drive:
        """Put the actuator into a stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScrewActuator(Actuator):
    """An adjustment screw."""

    kind: ClassVar[str] = "screw"

    pitch: Length
    """Advance in one turn [m]."""
    smallest_step: Length
    """Smallest displacement that can be set [m]."""
    travel: Length
    """Displacement that is used [m]."""
    stiffness: Stiffness | None = None
    """Axial stiffness of screw and nut [N/m]; rigid where not given."""
    largest_speed: Annotated[float, DIMENSIONS["speed"]] | None = None
    """Largest speed at which it may be turned, as its advance [m/s]."""

    def drive(self, place: Place) -> Drive:
        return Screw(
            **place.keywords(),
            pitch=self.pitch,
            smallest_step=self.smallest_step,
            travel=self.travel,
            stiffness=self.stiffness,
            largest_speed=self.largest_speed,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class StackActuator(Actuator):
    """A piezoelectric stack."""

    kind: ClassVar[str] = "piezo"

    free_stroke: Length
    """Free displacement over the voltage range [m]."""
    stiffness: Stiffness
    """Axial stiffness of the stack [N/m]."""
    blocking_force: Annotated[float, DIMENSIONS["force"]] | None = None
    """Force at the full voltage and no displacement [N]."""
    capacitance: Annotated[float, DIMENSIONS["capacitance"]] | None = None
    """Electrical capacitance [F]."""
    voltage_range: Annotated[tuple[float, float], DIMENSIONS["voltage"]] | None = None
    """Lowest and highest allowed voltage [V]."""
    largest_slew: Annotated[float, DIMENSIONS["slew rate"]] | None = None
    """Largest rate at which its voltage may change [V/s]."""

    def drive(self, place: Place) -> Drive:
        return PiezoStack(
            **place.keywords(),
            free_stroke=self.free_stroke,
            stiffness=self.stiffness,
            blocking_force=self.blocking_force,
            capacitance=self.capacitance,
            voltage_range=self.voltage_range,
            largest_slew=self.largest_slew,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class VoiceCoil(Actuator):
    """A force that does not depend on displacement."""

    kind: ClassVar[str] = "force"

    largest_force: Annotated[float, DIMENSIONS["force"]]
    """Largest force [N]."""

    def drive(self, place: Place) -> Drive:
        return Force(**place.keywords(), largest_force=self.largest_force)
