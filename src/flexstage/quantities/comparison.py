"""Comparison of the characteristics of one stage by origin, with differences in percent."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from flexstage.base.choose import listed
from flexstage.base.lazy import data_frame
from flexstage.base.short_repr import short_repr
from flexstage.quantities.characteristic import (
    ORIGINS,
    Characteristic,
    comparable,
    fitted_to,
    kind_of,
    shown_units,
)
from flexstage.quantities.quantity import QUANTITIES, Quantity, display
from flexstage.quantities.table import Table, table

if TYPE_CHECKING:
    import pandas

#: Names of models in reports and tables.
MODEL_WORDS: Mapping[str, str] = {
    "lumped": "rigid bodies",
    "superelement": "finite elements, condensed",
    "plane": "finite elements of the whole",
    "superelement-3d": "finite elements in 3D, condensed",
    "solid": "finite elements in 3D of the whole",
}
#: Names of published origins in tables, below or after the word "published".
PUBLISHED_WORDS: Mapping[str, str] = {
    "published-analytic": "analytic",
    "published-fem": "FEM",
    "published-measured": "measured",
}
# names of columns in a document without an explanation of them
_TITLES = {
    **{origin: f"published, {word}" for origin, word in PUBLISHED_WORDS.items()},
    "virtual": "virtual measurement",
    **MODEL_WORDS,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRow:
    """One quantity on one axis, from every origin that has it.

    An origin that gives a quantity more than once, for different conditions, has a row for each.
    """

    quantity: str
    """One of `flexstage.quantities.quantity.QUANTITIES`."""
    axis: str
    """The axis."""
    cells: Mapping[str, Characteristic]
    """The characteristic of each column that has one."""
    remark: str = ""
    """Condition, if other rows have the same quantity and axis; else empty."""

    def value(self, column: str) -> float | None:
        """Return the value of a column in the unit of the quantity; None where there is none."""
        cell = self.cells.get(column)
        return None if cell is None else cell.value

    def difference_percent(self, column: str, reference: str) -> float | None:
        """Return the difference of a column from a reference column, in percent of the reference.

        None where one is missing, or is 0 except for rounding, or where they are not `comparable`.
        """
        cell, other = self.cells.get(column), self.cells.get(reference)
        if cell is not None and other is not None and not comparable(cell, other):
            return None
        values = self.value(column), self.value(reference)
        # a printed zero is an effect that the model neglects, not a difference of 100 %
        if any(v is not None and abs(v) < display(self.quantity).zero for v in values):
            return None
        return difference_percent(*values)

    @property
    def computed_kind(self) -> str:
        """Kind of its computed figures, and what they were fitted to; empty without any."""
        cells = self.cells.values()
        computed = (c for c in cells if c.origin in MODEL_WORDS)
        return next((kind_text(cell, cells) for cell in computed), "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A table: a row for each quantity and axis, a column for each origin."""

    published: tuple[str, ...]
    """Columns of published values."""
    ours: tuple[str, ...]
    """Columns of values that were computed or measured here."""
    rows: tuple[ComparisonRow, ...]
    """The rows."""

    __repr__ = short_repr

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns, the published ones first."""
        return (*self.published, *self.ours)

    @property
    def units(self) -> dict[str, Quantity]:
        """Printed unit of each quantity."""
        return shown_units(cell for row in self.rows for cell in row.cells.values())

    @property
    def best(self) -> str:
        """Our most complete column; empty if there is none."""
        for column in ("measured", "solid", "superelement-3d", "plane", "superelement", "lumped"):
            if column in self.ours:
                return column
        return (*self.ours, "")[0]

    def table(self, caption: str = "") -> Table:
        """Return the comparison as a table; two columns of ours with the change between them."""
        two = self.ours if len(self.columns) == len(self.ours) == 2 else ()
        rows = []
        for row in self.rows:
            quantity = display(row.quantity)
            values = [quantity.text(row.value(column)) for column in self.columns]
            change = row.difference_percent(*two[::-1]) if two else None
            changes = [] if not two else ["" if change is None else f"{change:+.1f}"]
            rows.append([quantity.label, row.axis, *values, quantity.shown_unit, *changes])
        return table(caption, ["", "<axis", *self.columns, "<", *["change [%]"][: len(two)]], rows)

    def __str__(self) -> str:
        return str(self.table())

    def si_columns(self) -> dict[str, list[object]]:
        """Return the columns with values in SI units, and a column of uncertainties where known."""
        out: dict[str, list[object]] = {
            "quantity": [row.quantity for row in self.rows],
            "axis": [row.axis for row in self.rows],
            "unit": [QUANTITIES[row.quantity].unit for row in self.rows],
            "condition": [row.remark for row in self.rows],
        }
        for column in self.columns:
            cells = [row.cells.get(column) for row in self.rows]
            out[column] = [cell and cell.value for cell in cells]
            uncertain: list[object] = [cell and cell.uncertainty for cell in cells]
            if any(value is not None for value in uncertain):
                out[f"{column} uncertainty"] = uncertain
        return out

    def to_frame(self) -> "pandas.DataFrame":
        """Return the columns of `si_columns` as a data frame; needs pandas."""
        return data_frame(self.si_columns())

    @property
    def models(self) -> tuple[str, ...]:
        """Columns of ours, without variants of a model."""
        return tuple(column for column in self.ours if column in ORIGINS)


def kind_text(figure: Characteristic, references: Iterable[Characteristic] = ()) -> str:
    """Return the kind of a figure in words, with the published figures that it was fitted to."""
    references = tuple(references)
    titles = listed(PUBLISHED_WORDS[origin] for origin in fitted_to(figure, references))
    kind = kind_of(figure, references)
    return f"{kind} to {titles}" if titles else kind


def difference_percent(value: float | None, reference: float | None) -> float | None:
    """Return the difference of a value from a reference, in percent of the reference.

    None where one is missing or the reference is 0.

    Examples
    --------
    >>> round(difference_percent(115.74, 111.53), 2)
    3.77
    """
    if value is None or reference is None or reference == 0.0:
        return None
    return 100.0 * (value - reference) / abs(reference)


def compare(
    rows: Iterable[Characteristic], variants: Mapping[str, Iterable[Characteristic]] | None = None
) -> Comparison:
    """Compare characteristics of any origin.

    Variants are further columns by name, each with its rows. Rows are ordered by quantity, then by
    axis in the order of first appearance.
    """
    cells: dict[tuple[str, str], list[dict[str, Characteristic]]] = {}
    axes: list[str] = []
    named = [(row.origin, row) for row in rows]
    variants = variants or {}
    named += [(name, row) for name, variant in variants.items() for row in variant]
    for column, row in named:
        if row.axis not in axes:
            axes.append(row.axis)
        lines = cells.setdefault((row.quantity, row.axis), [])
        free = next((line for line in lines if column not in line), None)
        if free is None:
            lines.append({column: row})
        else:
            free[column] = row
    present = {column for column, _ in named}
    known = [origin for origin in ORIGINS if origin in present]
    order = {quantity: i for i, quantity in enumerate(QUANTITIES)}
    keys = sorted(cells, key=lambda key: (order[key[0]], axes.index(key[1])))
    return Comparison(
        published=tuple(origin for origin in known if origin.startswith("published")),
        ours=(*(o for o in known if not o.startswith("published")), *variants),
        rows=tuple(
            ComparisonRow(
                quantity=quantity,
                axis=axis,
                cells=line,
                remark=next(iter(line.values())).note if len(cells[quantity, axis]) > 1 else "",
            )
            for quantity, axis in keys
            for line in cells[quantity, axis]
        ),
    )


def shared_rows(rows: Iterable[ComparisonRow]) -> list[ComparisonRow]:
    """Join rows of one quantity that are equal on several axes, and list their axes."""
    out: list[ComparisonRow] = []
    for row in rows:
        same = next((i for i, previous in enumerate(out) if _same(previous, row)), None)
        if same is None:
            out.append(row)
        else:
            out[same] = replace(out[same], axis=f"{out[same].axis}, {row.axis}")
    return out


def _same(one: ComparisonRow, other: ComparisonRow) -> bool:
    values = [{c: (cell.value, cell.note) for c, cell in r.cells.items()} for r in (one, other)]
    return one.quantity == other.quantity and values[0] == values[1]


def title_of(origin: str) -> str:
    """Return the name of an origin in a document that does not explain it."""
    return _TITLES.get(origin, origin)
