"""The figures of the axes of a stage, each from the responses to unit forces of the drives.

They are those of `flexstage.system.characteristics` and `flexstage.system.coupled_axes`, which take
them from the states of any model, whose stress need not be linear. Here they are functions of the
responses to unit forces, for values over many samples or values with derivatives: a source gives
either. Decisions that an engineer would make are made on the nominal stage, for all.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.stage import Stage
from flexstage.system.batch_modes import start_shapes
from flexstage.system.characteristics import axis_states
from flexstage.system.coupled_axes import MOST_DRIVES, CoupledAxes
from flexstage.system.figure_source import (
    AxisMeasures,
    Key,
    Source,
    added,
    axis_figures,
    stress_at,
    stress_figures,
)
from flexstage.system.forward_mode import (
    largest,
    largest_row,
    magnitude,
    power,
    root,
    singular_values,
    solved,
    where_larger,
)
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.statics import AxisAnalysis, probe_stiffness


class CouplingFigures:
    """Coupling of all drives and axes."""

    def __init__(
        self, stage: Stage, system: MechanicalSystem, nominal: CoupledAxes, source: Source
    ) -> None:
        self.stage, self.system, self.nominal, self.source = stage, system, nominal, source
        drives, probes = ([port.name for port in ports] for ports in (system.drives, system.probes))
        self.drives = [drives.index(name) for name in nominal.drives]
        self.probes = [probes.index(axis.probe) for axis in nominal.axes]
        self.stiff = [j for j in self.drives if system.drives[j].stiffness != 0.0]
        # drives of no axis are held, where they hold
        self.other_drives = [
            j
            for j, drive in enumerate(system.drives)
            if j not in self.drives and drive.stiffness != 0.0
        ]

    @cached_property
    def forces(self) -> dict[int, dict[int, Any]]:
        """Forces of all drives for a unit elongation of each, the others held."""
        gram, out = self.source.gram, {}
        for j in self.drives:
            locked = [*dict.fromkeys([*self.stiff, j]), *self.other_drives]
            unit = [float(i == j) for i in locked]
            solution = solved([[gram(a, b) for b in locked] for a in locked], unit)
            out[j] = dict(zip(locked, solution, strict=True))
        return out

    @cached_property
    def jacobian(self) -> list[list[Any]]:
        """Reading of each axis for unit elongation of each drive."""
        reach = self.source.reach
        return [
            [added([f * reach(p, i) for i, f in self.forces[j].items()]) for j in self.drives]
            for p in self.probes
        ]

    @cached_property
    def scaled(self) -> list[list[Any]]:
        """The same with rotations times the characteristic length."""
        units = self.nominal.units
        if "rad" not in units:
            return self.jacobian
        probe = self.probes[units.index("rad")]
        length = self.source.length(tuple(self.drives), probe)
        return [
            [length * x for x in row] if unit == "rad" else row
            for row, unit in zip(self.jacobian, units, strict=True)
        ]

    def gains(self, axis: int) -> dict[int, Any]:
        """Reading of an axis for unit elongation of each drive."""
        return dict(zip(self.drives, self.jacobian[axis], strict=True))

    @cached_property
    def ranges(self) -> list[tuple[Any, Any]]:
        """Least and greatest elongation of each drive."""
        out = []
        for j in self.drives:
            if self.system.drives[j].stroke is None:
                reach = self.source.of_drive("largest_force", j) / self.forces[j][j]
                out.append((-reach, reach))
            else:
                stroke = self.source.of_drive("stroke", j)
                out.append((0.0 * stroke, stroke))
        return out

    def motion(self, axis: int) -> tuple[dict[int, Any], dict[int, Any], dict[int, Any]]:
        """Elongations, forces, and those with drives that only hold, of one axis alone."""
        # pivots as a plain elimination of the nominal J has them, the same ones for all samples
        order = _pivot_rows(self.nominal.scaled)
        unit = [float(row == axis) for row in order]
        direction = solved([self.jacobian[row] for row in order], unit)
        parts = [
            magnitude(w) / (high - low)
            for w, (low, high) in zip(direction, self.ranges, strict=True)
        ]
        longest = largest(parts)
        moved = {j: w / longest for j, w in zip(self.drives, direction, strict=True)}
        every: dict[int, Any] = {}
        for j, elongation in moved.items():
            for i, f in self.forces[j].items():
                every[i] = every[i] + f * elongation if i in every else f * elongation
        return moved, {j: every[j] for j in self.drives}, every

    def rows(self) -> dict[Key, Callable[[], Any]]:
        """Figures, in the order of `flexstage.system.analyse`."""
        rows: dict[Key, Callable[[], Any]] = {}
        nominal = self.nominal
        if len(nominal.axes) < 2:
            return rows
        if nominal.independent:
            rows["condition_number", WHOLE_STAGE] = lambda: self.sigma[0] / self.sigma[-1]
            rows["isotropy", WHOLE_STAGE] = self._isotropy
        with_stress = self.system.stress is not None and len(self.drives) <= MOST_DRIVES
        if nominal.coupled and with_stress:
            stress_rows = stress_figures(
                self.stage.material, self.source.strength, lambda: self._stress_anywhere
            )
            rows |= {(name, WHOLE_STAGE): row for name, row in stress_rows}
        reached = nominal.workspace
        if reached is not None and (len(reached.axes) == 2 or len(self.drives) == 3):
            rows["workspace_area", "".join(reached.axes[:2])] = self._area
        return rows

    @cached_property
    def sigma(self) -> list[Any]:
        """Singular values of the scaled J."""
        return singular_values(self.scaled, self.source.fine())

    def _isotropy(self) -> Any:
        squares = [s * s for s in self.sigma]
        product = squares[0]
        for square in squares[1:]:
            product = product * square
        return power(product, 1.0 / len(squares)) / (added(squares) / len(squares))

    @cached_property
    def _stress_anywhere(self) -> Any:
        each = [stress_at(self.source, self.forces[j]) for j in self.drives]
        ends = []
        for corner in product(*self.ranges):
            stress = added([w * s for w, s in zip(corner, each, strict=True)])
            ends.append(largest_row(magnitude(stress)))
        return largest(ends)

    def _area(self) -> Any:
        """Area of the workspace; with a rotation, at its middle."""
        units = self.nominal.units
        straight = [i for i, unit in enumerate(units) if unit == "m"][:2]
        turning = [i for i, unit in enumerate(units) if unit == "rad"]
        spans = [high - low for low, high in self.ranges]
        reach = [
            [x * span for x, span in zip(self.jacobian[i], spans, strict=True)]
            for i in (*straight, *turning)
        ]
        (x, y), pairs = reach[:2], list(combinations(range(len(spans)), 2))
        minors = {(i, j): x[i] * y[j] - x[j] * y[i] for i, j in pairs}
        if not turning:
            return added([magnitude(minor) for minor in minors.values()])
        # a parallelepiped: its volume, times how likely the middle is for a sum of uniform parts
        z = reach[2]
        volume = z[0] * minors[1, 2] - z[1] * minors[0, 2] + z[2] * minors[0, 1]
        a, b, c = (magnitude(part) for part in z)
        most = largest([a, b, c])
        four = 2.0 * (a * b + b * c + c * a) - a * a - b * b - c * c
        # 1/most where one part is as large as the others together; else none of them is nothing
        alone = where_larger(most + most, a + b + c, 4.0 * a * b * c * 0.0 + 1.0, 4.0 * a * b * c)
        return magnitude(volume) * where_larger(most + most, a + b + c, 1.0 / most, four / alone)


def _pivot_rows(matrix: Array) -> list[int]:
    """Return an order of rows in which elimination has no small pivot."""
    left, order = matrix / np.abs(matrix).max(), []
    rows = list(range(len(matrix)))
    for column in range(len(matrix)):
        best = max(rows, key=lambda r: abs(left[r, column]))
        rows.remove(best)
        order.append(best)
        for r in rows:
            left[r] -= left[r, column] / left[best, column] * left[best]
    return order


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decisions:
    """Decisions on the nominal stage, for all samples of its topology."""

    stage: Stage
    """The nominal stage."""
    system: MechanicalSystem
    """The system of the nominal stage."""
    coupling: CoupledAxes | None
    """Coupling of all drives and axes."""
    together: CoupledAxes | None
    """The same, where all drives together make the motion of each axis."""
    axes: tuple[AxisAnalysis, ...]
    """The full stroke of each axis."""
    start: Array | None
    """Initial modes of the iteration; None where all modes are needed."""


@lru_cache(maxsize=32)
def decisions(stage: Stage, system: MechanicalSystem) -> Decisions:
    """Return the decisions on the nominal stage."""
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
    """All figures of a topology, each computed when it is called."""

    def __init__(self, decided: Decisions, source: Source) -> None:
        self.decisions, self.source = decided, source
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
            self.rows |= self._stage_rows()

    def _stage_rows(self) -> dict[Key, Callable[[], Any]]:
        source = self.source
        fixed = [body.fixed for body in self.decisions.stage.bodies]

        def mass(moving: bool) -> Any:
            masses = zip(source.masses(), fixed, strict=True)
            return added([m for m, is_fixed in masses if not (moving and is_fixed)])

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
        self.together = stage.coupling if stage.decisions.together is not None else None

    @cached_property
    def motion(self) -> tuple[dict[int, Any], dict[int, Any], dict[int, Any]]:
        """Elongations, forces, and forces with those of drives that only hold, by drive."""
        if self.together is not None:
            return self.together.motion(self.index)
        drive = self.stage.drive[self.nominal.drive]
        against = self.source.gram(drive, drive)
        if self.stage.decisions.system.drives[drive].stroke is None:
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
    def probe_compliance(self) -> tuple[Any, dict[int, Any]]:
        """Reading for a unit force on the probe, drives in place, and the forces of the drives."""
        system, source = self.stage.decisions.system, self.source
        drives = [j for j, d in enumerate(system.drives) if d.stiffness != 0.0]
        soft = source.self_response(self.probe)
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

    def rows(self) -> Iterator[tuple[str, Callable[[], Any]]]:
        """Figures, in the order of `flexstage.system.analyse`."""
        decided, source, nominal = self.stage.decisions, self.source, self.nominal
        system = decided.system
        measures = AxisMeasures(
            input=lambda: self.input,
            output=lambda: self.output,
            stress=lambda: largest_row(magnitude(stress_at(source, self.motion[2]))),
            strength=source.strength,
            step=self._step,
            frequency_hz=lambda: root(source.mode(self.index)[0]) / math.tau,
            reading_squares=lambda: source.mode(self.index)[1],
            worst=lambda probes: largest(
                [self.reading(self.stage.probe[p]) for p in probes], by_magnitude=True
            ),
            rotation=lambda: added(
                [f * source.rotation(self.probe, j) for j, f in self.motion[2].items()]
            ),
            input_stiffness=self._input_stiffness,
            output_stiffness=lambda: 1.0 / self.probe_compliance[0],
            sag=self._sag,
            yields=math.isfinite(probe_stiffness(system, nominal.probe, drives="in place")),
            visible=bool(np.any(system.probes[self.probe].vector)),
        )
        return axis_figures(system, nominal, decided.stage.material, measures)

    def _step(self, drive: str) -> Any:
        j, together = self.stage.drive[drive], self.together
        gain = self.output / self.input if together is None else together.gains(self.index)[j]
        return gain * self.source.of_drive("smallest_displacement", j)

    def _input_stiffness(self) -> Any:
        moved, force, _ = self.motion
        if self.together is None:
            (drive,) = moved
            return force[drive] / moved[drive]
        energy = added([moved[j] * force[j] for j in moved])
        return energy / (self.input * self.input)

    def _sag(self) -> Any:
        source = self.source
        parts = [f * source.sag_drive(self.probe, j) for j, f in self.probe_compliance[1].items()]
        sag = source.sag(self.probe)
        return sag - added(parts) if parts else sag
