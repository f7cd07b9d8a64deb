"""What pushes a stage: a spring between two bodies with a commanded free displacement."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import StageError
from flexstage.stage.outline import Point
from flexstage.units import DIMENSIONS

__all__ = ["Drive", "Force", "PiezoStack", "Screw"]

Length = Annotated[float, DIMENSIONS["length"]]
Stiffness = Annotated[float, DIMENSIONS["stiffness"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """What every drive has; use one of its kinds.

    Parameters
    ----------
    name : str
        Its name.
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

    Notes
    -----
    Push and reaction act along one line, which goes through the pushed point in the direction of
    the drive and turns with the reacting body. The point on the reacting body says where the drive
    stands; `flexstage.stage.check` warns where it is further from that line than the patch reaches.
    """

    kind: ClassVar[str]

    name: str
    pushes: str
    reacts: str
    at: tuple[Point, Point]
    direction: Annotated[float, DIMENSIONS["angle"]]
    patch_half_width: Length = 3e-3

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
        """Stiffness of the drive itself [N/m]; None if rigid or not given, 0 for a force."""
        return None

    def _positive(self, *names: str) -> None:
        for name in ("patch_half_width", *names):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < float("inf"):
                raise StageError(
                    f"drive '{self.name}': {name} must be positive and finite, got {value!r}"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Screw(Drive):
    """An adjustment screw.

    Parameters
    ----------
    name : str
        Its name.
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

    def __post_init__(self) -> None:
        self._positive("pitch", "smallest_step", "travel", "stiffness", "largest_speed")

    @property
    def stroke(self) -> float | None:
        """Displacement that is used [m]."""
        return self.travel

    @property
    def smallest_displacement(self) -> float | None:
        """Smallest displacement that can be set [m]."""
        return self.smallest_step

    @property
    def spring(self) -> float | None:
        """Axial stiffness [N/m]; None if rigid."""
        return self.stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class PiezoStack(Drive):
    """A piezoelectric stack.

    Parameters
    ----------
    name : str
        Its name.
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

    def __post_init__(self) -> None:
        self._positive("free_stroke", "stiffness", "blocking_force", "capacitance", "largest_slew")
        if self.voltage_range is not None and not self.voltage_range[0] < self.voltage_range[1]:
            raise StageError(
                f"drive '{self.name}': voltage_range must rise, got {self.voltage_range!r} V"
            )

    @property
    def stroke(self) -> float | None:
        """Free displacement over the voltage range [m]."""
        return self.free_stroke

    @property
    def spring(self) -> float | None:
        """Axial stiffness of the stack [N/m]."""
        return self.stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class Force(Drive):
    """A force that does not depend on displacement, such as a voice coil's.

    Parameters
    ----------
    name : str
        Its name.
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
    largest_force : float
        Largest force [N].
    """

    kind: ClassVar[str] = "force"

    largest_force: Annotated[float, DIMENSIONS["force"]]

    def __post_init__(self) -> None:
        self._positive("largest_force")

    @property
    def spring(self) -> float | None:
        """A force has no stiffness [N/m]."""
        return 0.0
