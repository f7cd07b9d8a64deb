"""Characteristics side by side: a row for each quantity and axis, a column for each origin."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from flexstage.characteristic import ORIGINS, Characteristic
from flexstage.quantities import QUANTITIES

_TITLES = {
    "published-analytic": "published, analytic",
    "published-fem": "published, FEM",
    "published-measured": "published, measured",
    "superelement": "FEM 2D, condensed",
    "plane": "FEM 2D",
    "solid": "FEM 3D",
    "virtual": "virtual measurement",
}
# of ours, what leaves least out is set against what was published
_BEST = ("measured", "solid", "plane", "superelement", "lumped")


@dataclass(frozen=True, slots=True, kw_only=True)
class SideBySideRow:
    """One quantity on one axis, from every origin that has it."""

    quantity: str
    """One of `flexstage.quantities.QUANTITIES`."""
    axis: str
    """Its axis."""
    condition: str
    """What tells it from other rows of the same quantity and axis; empty where there are none."""
    cells: Mapping[str, Characteristic]
    """The characteristic by origin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideBySide:
    """A table of rows, in the order of the quantities, then of the axes."""

    origins: tuple[str, ...]
    """The columns, published ones first."""
    rows: tuple[SideBySideRow, ...]
    """The rows."""

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The best of ours against each published origin."""
        best = next((o for o in _BEST if o in self.origins), None)
        published = [o for o in self.origins if o.startswith("published")]
        return tuple((best, o) for o in published) if best else ()

    @property
    def uncertain(self) -> tuple[str, ...]:
        """Origins of which an uncertainty is known."""
        return tuple(
            o
            for o in self.origins
            if any(o in r.cells and r.cells[o].uncertainty is not None for r in self.rows)
        )

    @staticmethod
    def title(origin: str) -> str:
        """Return what an origin is called."""
        return _TITLES.get(origin, origin)


def side_by_side(characteristics: Iterable[Characteristic]) -> SideBySide:
    """Set characteristics side by side.

    An origin that gives a quantity of an axis more than once has a row for each.
    """
    lines: dict[tuple[str, str], list[dict[str, Characteristic]]] = {}
    axes: list[str] = []
    present = set()
    for c in characteristics:
        present.add(c.origin)
        if c.axis not in axes:
            axes.append(c.axis)
        cells = lines.setdefault((c.quantity, c.axis), [])
        free = next((line for line in cells if c.origin not in line), None)
        if free is None:
            cells.append({c.origin: c})
        else:
            free[c.origin] = c
    order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
    keys = sorted(lines, key=lambda key: (order[key[0]], axes.index(key[1])))
    return SideBySide(
        origins=tuple(o for o in ORIGINS if o in present),
        rows=tuple(
            SideBySideRow(
                quantity=quantity,
                axis=axis,
                condition=next(iter(line.values())).note if len(lines[quantity, axis]) > 1 else "",
                cells=line,
            )
            for quantity, axis in keys
            for line in lines[quantity, axis]
        ),
    )
