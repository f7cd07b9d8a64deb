"""The rows of points, with buttons to pick each, to sort by a column, and to turn pages."""

from html import escape

import numpy as np

from flexstage.quantities import number
from flexstage.web.explore.points import PointTable
from flexstage.web.explore.state import Run

#: Rows that are shown at a time.
ROWS = 12
_MARKS = {True: " ▼", False: " ▲"}
#: Puts the focus back on what was pressed, as the rows are made anew.
FOCUS = '[...document.querySelectorAll("[data-do]")].find(b => b.dataset.do === {pressed})?.focus()'
#: What a page hands on of a press in the rows: what is done, and with which row or column.
PRESSED = """(event) => {
  const button = event.target.closest("[data-do]");
  if (button) emit(button.dataset.do);
}"""


def row_name(table: PointTable, row: int) -> str:
    """Return what a row is called."""
    label = table.labels[row] if table.labels else ""
    if label in ("best", "start"):
        return label.capitalize()
    return f"Point {row + 1}" + (f", {label}" if label else "")


def rows_html(table: PointTable, run: Run, rows: list[int], pages: int) -> str:
    """Return the rows of a table with buttons to pick each, to sort by a column, to turn pages."""
    heads = []
    for column in table.columns:
        here = run.sort == column.name
        way = ("descending" if run.descending else "ascending") if here else "none"
        mark = _MARKS[run.descending] if here else ""
        heads.append(
            f'<th aria-sort="{way}"><button data-do="sort:{escape(column.name)}" '
            f'title="Sort by it">{escape(column.heading)}{mark}</button></th>'
        )
    body = []
    for row in rows:
        chosen = run.picked == row
        cells = "".join(f"<td>{_cell(c.values[row])}</td>" for c in table.columns)
        label = f" {escape(table.labels[row])}" if table.labels else ""
        body.append(
            f'<tr{" class=chosen" if chosen else ""}><td class="text"><button '
            f'data-do="pick:{row}" aria-pressed="{str(chosen).lower()}" '
            f'aria-label="Pick point {row + 1}">{row + 1}</button>{label}</td>{cells}</tr>'
        )
    turn = ""
    if pages > 1:
        at = run.page
        back, on = max(at - 1, 0), min(at + 1, pages - 1)
        turn = (
            f'<div class="turn"><button data-do="page:{back}" aria-label="Rows before">◀</button>'
            f" {at + 1} of {pages} "
            f'<button data-do="page:{on}" aria-label="Next rows">▶</button></div>'
        )
    return (
        f'<div class="scroll" tabindex="0"><table><thead><tr><th class="text">point</th>'
        f"{''.join(heads)}</tr></thead><tbody>{''.join(body)}</tbody></table></div>{turn}"
    )


def _cell(value: float) -> str:
    return number(float(value)).replace("-", "−") if np.isfinite(value) else "–"
