"""How results are written: as text, as an HTML table, as a data frame."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from flexstage.characteristic import Characteristics
from flexstage.quantities import display

if TYPE_CHECKING:
    import pandas

#: Quantities that the text of a result shows, of those that it has.
_HEADLINE = ("output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz")


def headline(figures: Characteristics) -> list[str]:
    """Return the figures that a result is known by."""
    lines = []
    for quantity in _HEADLINE:
        rows = figures.select(quantity)
        shown = display(quantity)
        texts = [f"{row.axis} {shown.text(row.value)}" for row in rows]
        if texts:
            lines.append(f"  {shown.label.lower()}: {', '.join(texts)} {shown.shown_unit}".rstrip())
    return lines


def data_frame(columns: Mapping[str, Sequence[object]]) -> "pandas.DataFrame":
    """Return columns as a data frame."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "a data frame needs pandas, which is not installed: run 'pip install pandas'"
        ) from error
    return pandas.DataFrame(columns)


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a small HTML table."""

    def line(cells: Sequence[str], tag: str) -> str:
        return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><caption>{escape(caption)}</caption>{line(head, 'th')}{body}</table>"
