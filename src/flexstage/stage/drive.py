"""What pushes a stage: a spring between two bodies with a commanded free displacement."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.errors import StageError
from flexstage.stage.outline import Point
from flexstage.units import DIMENSIONS, Length, Stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """What every drive has; use one of its kinds.

    Notes
    -----
    Push and reaction act along one line, which goes through the pushed point in the direction of
    the drive and turns with the reacting body. The point on the reacting body says where the drive
    stands; `flexstage.stage.check` warns where it is further from that line than the patch reaches.
    """

    kind: ClassVar[str]

    name: str
    """Its name."""
    pushes: str
    """The body that it moves."""
    reacts: str
    """The body that it stands on."""
    at: tuple[Point, Point]
    """The points on the pushed and on the reacting body [m]."""
    direction: Annotated[float, DIMENSIONS["angle"]]
    """Direction in which it pushes, from the x axis to the left [rad]."""
    patch_half_width: Length = 3e-3
    """Half of the width over which the force is spread [m]."""

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


@dataclass(frozen=True, kw_only=True)
class ScrewProperties:
    """What an adjustment screw is, wherever it stands."""

    __slots__ = ()
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Screw(ScrewProperties, Drive):
    """An adjustment screw."""

    def __post_init__(self) -> None:
        self._positive("pitch", "smallest_step", "travel", "stiffness", "largest_speed")

    @property
    def stroke(self) -> float | None:
        return self.travel

    @property
    def smallest_displacement(self) -> float | None:
        return self.smallest_step

    @property
    def spring(self) -> float | None:
        return self.stiffness


@dataclass(frozen=True, kw_only=True)
class StackProperties:
    """What a piezoelectric stack is, wherever it stands."""

    __slots__ = ()
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PiezoStack(StackProperties, Drive):
    """A piezoelectric stack."""

    def __post_init__(self) -> None:
        self._positive("free_stroke", "stiffness", "blocking_force", "capacitance", "largest_slew")
        if self.voltage_range is not None and not self.voltage_range[0] < self.voltage_range[1]:
            raise StageError(
                f"drive '{self.name}': voltage_range must rise, got {self.voltage_range!r} V"
            )

    @property
    def stroke(self) -> float | None:
        return self.free_stroke

    @property
    def spring(self) -> float | None:
        return self.stiffness


@dataclass(frozen=True, kw_only=True)
class ForceProperties:
    """What a source of force is, wherever it stands."""

    __slots__ = ()
    kind: ClassVar[str] = "force"

    largest_force: Annotated[float, DIMENSIONS["force"]]
    """Largest force [N]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Force(ForceProperties, Drive):
    """A force that does not depend on displacement, such as a voice coil's."""

    def __post_init__(self) -> None:
        self._positive("largest_force")

    @property
    def spring(self) -> float | None:
        return 0.0
