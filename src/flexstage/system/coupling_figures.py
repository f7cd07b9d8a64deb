"""What all drives of a stage do to all of its axes, for many stages at once or with derivatives."""

from collections.abc import Callable
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.characteristic import WHOLE_STAGE
from flexstage.stage import Stage
from flexstage.system.coupled_axes import CoupledAxes
from flexstage.system.figure_source import Key, Source, added, stress_at, stress_rows
from flexstage.system.forward_mode import (
    largest,
    largest_row,
    magnitude,
    power,
    singular_values,
    solved,
    where_larger,
)
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.zonotope import MOST_DRIVES


class CouplingFigures:
    """What all drives do to all axes."""

    def __init__(
        self, stage: Stage, system: MechanicalSystem, nominal: CoupledAxes, source: Source
    ) -> None:
        self.stage, self.system, self.nominal, self.source = stage, system, nominal, source
        drives, probes = ([port.name for port in ports] for ports in (system.drives, system.probes))
        self.drives = [drives.index(name) for name in nominal.drives]
        self.probes = [probes.index(axis.probe) for axis in nominal.axes]
        self.stiff = [j for j in self.drives if system.drives[j].stiffness != 0.0]
        # drives of no axis are held, where they hold
        self.rest = [
            j
            for j, drive in enumerate(system.drives)
            if j not in self.drives and drive.stiffness != 0.0
        ]

    @cached_property
    def forces(self) -> dict[int, dict[int, Any]]:
        """Forces of all drives for a unit elongation of each, the others held."""
        gram, out = self.source.gram, {}
        for j in self.drives:
            held = [*dict.fromkeys([*self.stiff, j]), *self.rest]
            unit = [float(i == j) for i in held]
            found = solved([[gram(a, b) for b in held] for a in held], unit)
            out[j] = dict(zip(held, found, strict=True))
        return out

    @cached_property
    def jacobian(self) -> list[list[Any]]:
        """What each axis reads for a unit of each drive."""
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
        """What an axis reads for a unit of each drive."""
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
        """Its figures, in the order of `flexstage.system.analyse`."""
        rows: dict[Key, Callable[[], Any]] = {}
        nominal = self.nominal
        if len(nominal.axes) < 2:
            return rows
        if nominal.independent:
            rows["condition_number", WHOLE_STAGE] = lambda: self.sigma[0] / self.sigma[-1]
            rows["isotropy", WHOLE_STAGE] = self._isotropy
        known = self.system.stress is not None and len(self.drives) <= MOST_DRIVES
        if nominal.coupled and known:
            found = stress_rows(self.source, self.stage.material, lambda: self._stress_anywhere)
            rows |= {(name, WHOLE_STAGE): row for name, row in found}
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
        whole = squares[0]
        for square in squares[1:]:
            whole = whole * square
        return power(whole, 1.0 / len(squares)) / (added(squares) / len(squares))

    @cached_property
    def _stress_anywhere(self) -> Any:
        each = [stress_at(self.source, self.forces[j]) for j in self.drives]
        ends = []
        for corner in product(*self.ranges):
            stress = added([w * s for w, s in zip(corner, each, strict=True)])
            ends.append(largest_row(magnitude(stress)))
        return largest(ends)

    def _area(self) -> Any:
        """Area of the workspace, with a rotation that at its middle."""
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
    """Order of rows by which elimination never meets a small pivot."""
    left, order = matrix / np.abs(matrix).max(), []
    rows = list(range(len(matrix)))
    for column in range(len(matrix)):
        best = max(rows, key=lambda r: abs(left[r, column]))
        rows.remove(best)
        order.append(best)
        for r in rows:
            left[r] -= left[r, column] / left[best, column] * left[best]
    return order
