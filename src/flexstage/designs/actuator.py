"""What drives an axis of a parametric design: the bought part, without the place it stands in."""

from dataclasses import dataclass, fields
from typing import Annotated, ClassVar

from flexstage.stage import Drive, Force, PiezoStack, Point, Screw
from flexstage.stage.drive import ForceProperties, ScrewProperties, StackProperties
from flexstage.units import DIMENSIONS, Length


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivePlace:
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
class Actuator:
    """What every actuator can do; use one of its kinds."""

    kind: ClassVar[str]
    becomes: ClassVar[type[Drive]]
    """The kind of drive that it is in a stage."""

    def drive(self, place: DrivePlace) -> Drive:
        """Put the actuator into a stage."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        return self.becomes(**place.keywords(), **own)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScrewActuator(ScrewProperties, Actuator):
    """An adjustment screw."""

    becomes: ClassVar[type[Drive]] = Screw


@dataclass(frozen=True, slots=True, kw_only=True)
class StackActuator(StackProperties, Actuator):
    """A piezoelectric stack."""

    becomes: ClassVar[type[Drive]] = PiezoStack


@dataclass(frozen=True, slots=True, kw_only=True)
class VoiceCoil(ForceProperties, Actuator):
    """A force that does not depend on displacement."""

    becomes: ClassVar[type[Drive]] = Force
