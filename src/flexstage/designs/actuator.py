"""What drives an axis of a parametric design: the bought part, without the place it stands in."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.stage import Drive, Force, PiezoStack, Point, Screw
from flexstage.units import DIMENSIONS

__all__ = ["Actuator", "Place", "ScrewActuator", "StackActuator", "VoiceCoil"]

Length = Annotated[float, DIMENSIONS["length"]]
Stiffness = Annotated[float, DIMENSIONS["stiffness"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a drive stands in a stage.

    Parameters
    ----------
    name : str
        Name of the drive.
    pushes : str
        The body that it moves.
    reacts : str
        The body that it stands on.
    at : tuple of tuple of float
        The points on the pushed and on the reacting body [m].
    direction : float
        Direction in which it pushes, from the x axis to the left [rad].
    patch_half_width : float
        Half of the width over which the force is spread [m].
    """

    name: str
    pushes: str
    reacts: str
    at: tuple[Point, Point]
    direction: Annotated[float, DIMENSIONS["angle"]]
    patch_half_width: Length

    def keywords(self) -> dict:
        """Return the place as the arguments that every `Drive` takes.

        Returns
        -------
        dict
            Argument names and values.
        """
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuator(ABC):
    """What every actuator can do; use one of its kinds."""

    kind: ClassVar[str]

    @abstractmethod
    def drive(self, place: Place) -> Drive:
        """Put the actuator into a stage.

        Parameters
        ----------
        place : Place
            Where it stands.

        Returns
        -------
        Drive
            The drive of the stage.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class ScrewActuator(Actuator):
    """An adjustment screw.

    Parameters
    ----------
    pitch : float
        Advance in one turn [m].
    smallest_step : float
        Smallest displacement that can be set [m].
    travel : float
        Displacement that is used [m].
    stiffness : float, optional
        Axial stiffness of screw and nut [N/m]; rigid where not given.
    largest_speed : float, optional
        Largest speed at which it may be turned, as its advance [m/s].
    """

    kind: ClassVar[str] = "screw"

    pitch: Length
    smallest_step: Length
    travel: Length
    stiffness: Stiffness | None = None
    largest_speed: Annotated[float, DIMENSIONS["speed"]] | None = None

    def drive(self, place: Place) -> Drive:
        """Put the screw into a stage.

        Parameters
        ----------
        place : Place
            Where it stands.

        Returns
        -------
        Drive
            A `Screw`.
        """
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
    """A piezoelectric stack.

    Parameters
    ----------
    free_stroke : float
        Free displacement over the voltage range [m].
    stiffness : float
        Axial stiffness of the stack [N/m].
    blocking_force : float, optional
        Force at the full voltage and no displacement [N].
    capacitance : float, optional
        Electrical capacitance [F].
    voltage_range : tuple of float, optional
        Lowest and highest allowed voltage [V].
    largest_slew : float, optional
        Largest rate at which its voltage may change [V/s].
    """

    kind: ClassVar[str] = "piezo"

    free_stroke: Length
    stiffness: Stiffness
    blocking_force: Annotated[float, DIMENSIONS["force"]] | None = None
    capacitance: Annotated[float, DIMENSIONS["capacitance"]] | None = None
    voltage_range: Annotated[tuple[float, float], DIMENSIONS["voltage"]] | None = None
    largest_slew: Annotated[float, DIMENSIONS["slew rate"]] | None = None

    def drive(self, place: Place) -> Drive:
        """Put the stack into a stage.

        Parameters
        ----------
        place : Place
            Where it stands.

        Returns
        -------
        Drive
            A `PiezoStack`.
        """
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
    """A force that does not depend on displacement.

    Parameters
    ----------
    largest_force : float
        Largest force [N].
    """

    kind: ClassVar[str] = "force"

    largest_force: Annotated[float, DIMENSIONS["force"]]

    def drive(self, place: Place) -> Drive:
        """Put the coil into a stage.

        Parameters
        ----------
        place : Place
            Where it stands.

        Returns
        -------
        Drive
            A `Force`.
        """
        return Force(**place.keywords(), largest_force=self.largest_force)
