"""The figures of the axes of a stage, each from what unit forces of the drives do.

They are those of `flexstage.system.characteristics` and `flexstage.system.coupled_axes`, which read
them off the states of any model, whose stress need not be linear. Here they are written in what
unit forces do, for values over many samples or values with derivatives: a source gives either. What
an engineer would decide by looking is decided on the nominal stage, for all.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.characteristic import WHOLE_STAGE
from flexstage.stage import Stage
from flexstage.system.axis_states import axis_states
from flexstage.system.batch_modes import start_shapes
from flexstage.system.characteristics import axis_quantity, cross_figures
from flexstage.system.coupled_axes import CoupledAxes
from flexstage.system.coupling_figures import CouplingFigures
from flexstage.system.figure_source import Key, Source, added, stress_at, stress_rows
from flexstage.system.forward_mode import largest, largest_row, magnitude, root, solved
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.statics import AxisAnalysis, probe_stiffness


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decisions:
    """What is decided on the nominal stage, for all samples of its topology."""

    stage: Stage
    """The nominal stage."""
    system: MechanicalSystem
    """Its system."""
    coupling: CoupledAxes | None
    """What all drives do to all axes."""
    together: CoupledAxes | None
    """The same, where all drives together make the motion of each axis."""
    axes: tuple[AxisAnalysis, ...]
    """The full stroke of each axis."""
    start: Array | None
    """Modes to begin with; None where all modes are wanted."""


@lru_cache(maxsize=32)
def decisions(stage: Stage, system: MechanicalSystem) -> Decisions:
    """Decide on the nominal stage, once."""
    coupling, together, axes = axis_states(stage, system)
    responses = [
        (_force(system, axis.static.drive_force), system.probe(axis.probe).vector) for axis in axes
    ]
    return Decisions(
        stage=stage,
        system=system,
        coupling=coupling,
        together=together,
        axes=axes,
        start=start_shapes(system, responses),
    )


def _force(system: MechanicalSystem, forces: Mapping[str, float]) -> Array:
    parts = [f * system.drive(name).vector for name, f in forces.items()]
    return np.sum(parts, axis=0)


class StageFigures:
    """All figures that are known of a topology, each computed when it is called for."""

    def __init__(self, decided: Decisions, source: Source) -> None:
        self.decided, self.source = decided, source
        names = [drive.name for drive in decided.system.drives]
        self.drive = {name: i for i, name in enumerate(names)}
        self.probe = {probe.name: i for i, probe in enumerate(decided.system.probes)}
        self.axes: list[AxisFigures] = []
        self.rows: dict[Key, Callable[[], Any]] = {}
        coupling, together = decided.coupling, decided.together
        self.coupling = (
            None
            if coupling is None
            else CouplingFigures(decided.stage, decided.system, coupling, source)
        )
        # with more drives than axes the longest motion is a linear programme for each sample
        if together is None or len(together.drives) == len(together.axes):
            self.axes = [AxisFigures(self, i, axis) for i, axis in enumerate(decided.axes)]
        for axis in self.axes:
            self.rows |= {(name, axis.name): row for name, row in axis.rows()}
        if decided.axes:
            self.rows |= self._whole()

    def _whole(self) -> dict[Key, Callable[[], Any]]:
        source = self.source
        fixed = [body.fixed for body in self.decided.stage.bodies]

        def mass(moving: bool) -> Any:
            masses = zip(source.masses(), fixed, strict=True)
            return added([m for m, held in masses if not (moving and held)])

        rows: dict[Key, Callable[[], Any]] = {
            ("mass", WHOLE_STAGE): lambda: mass(False),
            ("moving_mass", WHOLE_STAGE): lambda: mass(True),
            ("width", WHOLE_STAGE): lambda: source.size(0),
            ("height", WHOLE_STAGE): lambda: source.size(1),
            ("thickness", WHOLE_STAGE): lambda: source.size(2),
        }
        return rows if self.coupling is None else rows | self.coupling.rows()


class AxisFigures:
    """Figures of one axis."""

    def __init__(self, stage: StageFigures, index: int, nominal: AxisAnalysis) -> None:
        self.stage, self.source, self.index, self.nominal = stage, stage.source, index, nominal
        self.name = nominal.axis
        self.probe = stage.probe[nominal.probe]
        system = stage.decided.system
        self.port = system.probes[self.probe]
        self.together = stage.coupling if stage.decided.together is not None else None

    @cached_property
    def motion(self) -> tuple[dict[int, Any], dict[int, Any], dict[int, Any]]:
        """Elongations, forces, and forces with those of drives that only hold, by drive."""
        if self.together is not None:
            return self.together.motion(self.index)
        drive = self.stage.drive[self.nominal.drive]
        against = self.source.gram(drive, drive)
        if self.stage.decided.system.drives[drive].stroke is None:
            moved = self.source.of_drive("largest_force", drive) * against
        else:
            moved = self.source.of_drive("stroke", drive)
        force = {drive: moved / against}
        return {drive: moved}, force, force

    @cached_property
    def input(self) -> Any:
        """Largest elongation of a drive."""
        moved = list(self.motion[0].values())
        return moved[0] if self.together is None else largest([magnitude(m) for m in moved])

    def reading(self, probe: int) -> Any:
        """Reading of a probe over the stroke."""
        return added([f * self.source.reach(probe, j) for j, f in self.motion[2].items()])

    @cached_property
    def output(self) -> Any:
        """Reading of its own probe."""
        return self.reading(self.probe)

    @cached_property
    def stress(self) -> Any:
        """Largest equivalent stress."""
        return largest_row(magnitude(stress_at(self.source, self.motion[2])))

    @cached_property
    def held(self) -> tuple[Any, dict[int, Any]]:
        """Reading for a unit force on the probe, drives in place, and the forces that they hold."""
        system, source = self.stage.decided.system, self.source
        drives = [j for j, d in enumerate(system.drives) if d.stiffness != 0.0]
        soft = source.own(self.probe)
        if not drives:
            return soft, {}
        matrix = [
            [
                source.gram(i, j) + 1.0 / source.of_drive("drive_stiffness", i)
                if i == j
                else source.gram(i, j)
                for j in drives
            ]
            for i in drives
        ]
        reached = [source.reach(self.probe, j) for j in drives]
        force = dict(zip(drives, solved(matrix, reached), strict=True))
        return soft - added([f * source.reach(self.probe, j) for j, f in force.items()]), force

    def rows(self) -> list[tuple[str, Callable[[], Any]]]:
        """Its figures, in the order of `flexstage.system.analyse`."""
        source, system, nominal = self.source, self.stage.decided.system, self.nominal
        turns, unit = self.port.unit == "rad", self.port.unit
        rows: list[tuple[str, Callable[[], Any]]] = [
            ("input_displacement", lambda: self.input),
            (axis_quantity("output_displacement", unit), lambda: self.output),
        ]
        if not turns:
            rows.append(("transmission_ratio", lambda: self.output / self.input))
        if nominal.static.hinge_stress:
            rows += stress_rows(source, self.stage.decided.stage.material, lambda: self.stress)
        steps = [
            self.stage.drive[n] for n in nominal.drives if system.drive(n).smallest_displacement
        ]
        if steps:
            rows.append((axis_quantity("resolution", unit), lambda: self._resolution(steps)))
        rows.append(("natural_frequency_hz", lambda: root(source.mode(self.index)[0]) / math.tau))
        rows += self._cross()
        if not turns:
            rows.append(("parasitic_rotation", self._parasitic))
        rows.append(("input_stiffness", self._input_stiffness))
        if math.isfinite(probe_stiffness(system, nominal.probe, drives="in place")):
            rows.append((axis_quantity("output_stiffness", unit), lambda: 1.0 / self.held[0]))
        if np.any(self.port.vector):
            inertia = axis_quantity("effective_mass", unit)
            rows.append((inertia, lambda: 1.0 / source.mode(self.index)[1]))
        if not turns and {"gravity x", "gravity y"} <= {load.name for load in system.loads}:
            rows.append(("gravity_sag", self._sag))
        return rows

    def _resolution(self, steps: list[int]) -> Any:
        gains = (
            {steps[0]: self.output / self.input}
            if self.together is None
            else self.together.gains(self.index)
        )
        step = "smallest_displacement"
        return largest([magnitude(gains[j]) * self.source.of_drive(step, j) for j in steps])

    def _cross(self) -> list[tuple[str, Callable[[], Any]]]:
        system = self.stage.decided.system
        others = [axis.probe for axis in system.axes if axis.name != self.name]

        def worst(probes: list[str]) -> Any:
            readings = [self.reading(self.stage.probe[p]) for p in probes]
            return largest(readings, by_magnitude=True)

        def row(quantity: str, probes: list[str]) -> Callable[[], Any]:
            if quantity == "cross_coupling":
                return lambda: worst(probes) / self.output
            return lambda: worst(probes)

        return [(q, row(q, probes)) for q, probes in cross_figures(system, self.nominal, others)]

    def _parasitic(self) -> Any:
        return added([f * self.source.rotation(self.probe, j) for j, f in self.motion[2].items()])

    def _input_stiffness(self) -> Any:
        moved, force, _ = self.motion
        if self.together is None:
            (drive,) = moved
            return force[drive] / moved[drive]
        energy = added([moved[j] * force[j] for j in moved])
        return energy / (self.input * self.input)

    def _sag(self) -> Any:
        source = self.source
        parts = [f * source.sag_drive(self.probe, j) for j, f in self.held[1].items()]
        sag = source.sag(self.probe)
        return sag - added(parts) if parts else sag
