"""Characteristics as text with commas between, RFC 4180."""

import csv
import io
from collections.abc import Iterable
from dataclasses import fields

from flexstage.characteristic import Characteristic
from flexstage.comparison import Comparison
from flexstage.quantities import QUANTITIES


def values_csv(characteristics: Iterable[Characteristic]) -> bytes:
    """Write one line for each value, with all the digits that give back the same bits."""
    names = [f.name for f in fields(Characteristic)]
    return _csv(names, ([getattr(c, n) for n in names] for c in characteristics))


def comparison_csv(table: Comparison) -> bytes:
    """Write one line for each quantity and axis, with a column of values for each origin.

    An origin of which an uncertainty is known has a column for it as well.
    """
    head = ["quantity", "axis", "unit", "condition"]
    for origin in table.columns:
        head += [origin, f"{origin} uncertainty"] if origin in table.uncertain else [origin]
    lines = []
    for row in table.rows:
        line: list[object] = [row.quantity, row.axis, QUANTITIES[row.quantity].unit, row.remark]
        for origin in table.columns:
            cell = row.cells.get(origin)
            line.append(None if cell is None else cell.value)
            if origin in table.uncertain:
                line.append(None if cell is None else cell.uncertainty)
        lines.append(line)
    return _csv(head, lines)


def _csv(head: list[str], lines: Iterable[list[object]]) -> bytes:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\r\n")
    rows.writerow(head)
    for line in lines:
        # repr gives back the same bits
        rows.writerow(
            ["" if v is None else repr(float(v)) if isinstance(v, float) else v for v in line]
        )
    return text.getvalue().encode()
