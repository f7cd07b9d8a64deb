"""What the figures of stages are made of, be they those of many at once or with derivatives."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from flexstage.material import Material

#: A figure: its quantity and its axis.
Key = tuple[str, str]


class Source(Protocol):
    """What figures are made of, as values over samples or as values with derivatives.

    Drives and probes are numbered as the system has them.
    """

    def gram(self, i: int, j: int) -> Any:
        """Elongation of drive i for a unit force of drive j [m/N]."""

    def reach(self, probe: int, drive: int) -> Any:
        """Reading of a probe for a unit force of a drive."""

    def own(self, probe: int) -> Any:
        """Reading of a probe for a unit force along itself."""

    def sag(self, probe: int) -> Any:
        """Reading of a probe for the weight along its direction."""

    def sag_drive(self, probe: int, drive: int) -> Any:
        """Elongation of a drive for the weight along the direction of a probe."""

    def stress(self, drive: int) -> Any:
        """Stress at each place for a unit force of a drive [Pa/N], shape (r, ...)."""

    def rotation(self, probe: int, drive: int) -> Any:
        """Rotation of the body of a probe for a unit force of a drive [rad/N]."""

    def mode(self, axis: int) -> tuple[Any, Any]:
        """Squared frequency, and one over effective mass, of the mode of an axis."""
        ...

    def of_drive(self, field: str, drive: int) -> Any:
        """A field of the batch that is given by drive."""

    def strength(self, which: int) -> Any:
        """Yield strength, or largest pulsating stress [Pa]."""

    def length(self, drives: tuple[int, ...], probe: int) -> Any:
        """Mean distance of the pushed points of drives from a probe [m]."""

    def masses(self) -> list[Any]:
        """Mass of every body [kg]."""
        ...

    def size(self, which: int) -> Any:
        """Width, height and thickness of the plate [m]."""

    def fine(self) -> Any:
        """Samples whose stiffness is regular; None where no other comes up."""


def added(parts: list[Any]) -> Any:
    """Sum, one after the other."""
    out = parts[0]
    for part in parts[1:]:
        out = out + part
    return out


def stress_at(source: Source, forces: Mapping[int, Any]) -> Any:
    """Stress at each place for forces of drives."""
    return added([force * source.stress(j) for j, force in forces.items()])


def stress_rows(
    source: Source, material: Material, stress: Callable[[], Any]
) -> list[tuple[str, Callable[[], Any]]]:
    """Rows of a largest stress: it, and how far it is from yield and from fatigue."""
    rows = [("max_stress", stress)]
    if material.yield_strength is not None:
        rows.append(("safety_factor", lambda: source.strength(0) / stress()))
        if material.fatigue_limit is not None:
            rows.append(("fatigue_safety", lambda: source.strength(1) / stress()))
    return rows
