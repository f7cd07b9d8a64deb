"""Figures of an axis and their ingredients, for every way to compute them.

For one stage they are its states (`flexstage.system.characteristics`), for many stages and for
derivatives the responses to unit forces (`flexstage.system.batch_figures`).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from flexstage.quantities.material import Material
from flexstage.system.forward_mode import largest, magnitude
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.statics import AxisAnalysis

#: A figure: its quantity and its axis.
Key = tuple[str, str]
# an axis that moves by less than this of what another does is not moved by its drive
_NOTHING = 0.1
# what a figure of an axis is called where the axis is a rotation
_OF_ROTATION = {
    "output_displacement": "rotation_stroke",
    "resolution": "rotation_resolution",
    "output_stiffness": "rotational_stiffness",
    "effective_mass": "effective_inertia",
}


def axis_quantity(quantity: str, unit: str) -> str:
    """Return the name of a figure of an axis, by the unit in which the axis is read."""
    return _OF_ROTATION[quantity] if unit == "rad" else quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMeasures:
    """Ingredients of the figures of an axis, for one stage, over samples or with derivatives.

    Each is computed when it is called.
    """

    input: Callable[[], Any]
    """Largest elongation of a drive over the stroke [m]."""
    output: Callable[[], Any]
    """Reading of the probe of the axis over it [m, or rad]."""
    stress: Callable[[], Any]
    """Largest equivalent stress [Pa]."""
    strength: Callable[[int], Any]
    """Yield strength (0), and largest pulsating stress (1) [Pa]."""
    step: Callable[[str], Any]
    """Reading of the probe for the smallest displacement of a drive, signed."""
    frequency_hz: Callable[[], Any]
    """Frequency of the mode by which the axis moves [Hz]."""
    reading_squares: Callable[[], Any]
    """Sum of squares of the readings in this mode and those of its frequency [1/kg, 1/(kg m^2)]."""
    worst: Callable[[list[str]], Any]
    """Reading of some probes over the stroke that is the largest, with its sign."""
    rotation: Callable[[], Any]
    """Rotation of the body that the probe reads over the stroke [rad]."""
    input_stiffness: Callable[[], Any]
    """Twice the energy of the motion over the square of the input [N/m]."""
    output_stiffness: Callable[[], Any]
    """Force on the probe over its reading, drives in place [N/m, or N m/rad]."""
    sag: Callable[[], Any]
    """Reading of the probe for the weight along the axis, drives in place [m]."""
    yields: bool
    """True if a force on the probe moves it."""
    visible: bool
    """True if the probe reads the modes by which the axis moves."""


def axis_figures(
    system: MechanicalSystem, axis: AxisAnalysis, material: Material, measures: AxisMeasures
) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield the figures of an axis, in their order: quantity, and its function.

    The choice of figures is made on one stage, `system` with the full stroke of its `axis`, for all
    stages of the `measures`.
    """
    port = system.probe(axis.probe)
    unit, turns = port.unit, port.unit == "rad"
    yield "input_displacement", measures.input
    yield axis_quantity("output_displacement", unit), measures.output
    if not turns:
        yield "transmission_ratio", lambda: measures.output() / measures.input()
    if stress := axis.static.hinge_stress:
        stressed = any(stress.values())
        yield from stress_figures(material, measures.strength, measures.stress, stressed)
    steps = [name for name in axis.drives if system.drive(name).smallest_displacement]
    if steps:
        yield (
            axis_quantity("resolution", unit),
            lambda: largest([magnitude(measures.step(name)) for name in steps]),
        )
    yield "natural_frequency_hz", measures.frequency_hz
    for quantity, probes in _cross_figures(system, axis):
        reference = measures.output if quantity == "cross_coupling" else lambda: 1.0
        yield (
            quantity,
            lambda probes=probes, reference=reference: measures.worst(probes) / reference(),
        )
    if not turns and port.body in axis.static.body_motion:
        yield "parasitic_rotation", measures.rotation
    yield "input_stiffness", measures.input_stiffness
    if measures.yields:
        yield axis_quantity("output_stiffness", unit), measures.output_stiffness
    if measures.visible:
        yield axis_quantity("effective_mass", unit), lambda: 1.0 / measures.reading_squares()
    if not turns and {"gravity x", "gravity y"} <= {load.name for load in system.loads}:
        yield "gravity_sag", measures.sag


def _cross_figures(system: MechanicalSystem, axis: AxisAnalysis) -> Iterator[tuple[str, list[str]]]:
    """Yield the figures for the probes of other axes over the stroke of one.

    Each is the largest reading of some of them: relative to the motion of the axis
    (``cross_coupling``) where they are of the same kind and that motion is not negligible;
    otherwise absolute.
    """
    others = [other.probe for other in system.axes if other.name != axis.axis]
    unit = system.probe(axis.probe).unit
    same_kind = [p for p in others if system.probe(p).unit == unit]
    unlike = [p for p in others if system.probe(p).unit != unit]
    ways = ("cross_rotation", "cross_displacement")
    if same_kind:
        worst, own_motion = (
            max(abs(axis.static.readings[p]) for p in same_kind),
            abs(axis.output_displacement),
        )
        moves = own_motion >= _NOTHING * worst and own_motion != 0.0
        yield "cross_coupling" if moves else ways[unit == "m"], same_kind
    if unlike:
        yield ways[unit == "rad"], unlike


class Source(Protocol):
    """Ingredients of figures, as values over samples or as values with derivatives.

    Drives and probes are numbered as the system has them.
    """

    def gram(self, i: int, j: int) -> Any:
        """Elongation of drive i for a unit force of drive j [m/N]."""

    def reach(self, probe: int, drive: int) -> Any:
        """Reading of a probe for a unit force of a drive."""

    def self_response(self, probe: int) -> Any:
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
        """Return a field of the batch that is given by drive."""

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
        """Samples whose stiffness is regular; None where all are."""


def added(parts: list[Any]) -> Any:
    """Sum, one after the other."""
    out = parts[0]
    for part in parts[1:]:
        out = out + part
    return out


def stress_at(source: Source, forces: Mapping[int, Any]) -> Any:
    """Stress at each place for forces of drives."""
    return added([force * source.stress(j) for j, force in forces.items()])


def stress_figures(
    material: Material,
    strength: Callable[[int], Any],
    stress: Callable[[], Any],
    stressed: bool = True,
) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield a largest stress and, where it is not zero, the safety against yield and fatigue."""
    yield "max_stress", stress
    if stressed and material.yield_strength is not None:
        yield "safety_factor", lambda: strength(0) / stress()
        if material.fatigue_limit is not None:
            yield "fatigue_safety", lambda: strength(1) / stress()
