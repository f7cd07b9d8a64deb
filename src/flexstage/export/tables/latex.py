"""Characteristics as a LaTeX table."""

import re
from collections.abc import Callable, Mapping, Sequence

import flexstage
from flexstage.characteristic import Characteristic
from flexstage.comparison import Comparison, ComparisonRow, title_of
from flexstage.quantities import Quantity, beside, number

#: Shares of the width of the text: the names of the quantities beside a few columns of figures, and
#: both together; the rest is for the axis.
_NAMES, _FEW, _TOGETHER = 0.34, 4, 0.92
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "µ": r"$\mu$",
    "μ": r"$\mu$",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
    "°": r"\textdegree{}",
    "±": r"$\pm$",
    "≈": r"$\approx$",
    "−": "$-$",
    "·": r"$\cdot$",
    "–": "--",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
} | {c: f"\\{c}" for c in "&%$#_{}"}


def escaped(text: str) -> str:
    r"""Return text that LaTeX prints as it is, symbols of units too.

    Examples
    --------
    >>> print(escaped("5 µm & 3_x"))
    5 $\mu$m \& 3\_x
    """
    return "".join(_SPECIAL.get(c, c if c.isprintable() else " ") for c in text)


def latex(
    name: str,
    title: str,
    table: Comparison,
    display: Callable[[str], Quantity],
    about: Mapping[str, str],
    notes: Sequence[str],
) -> bytes:
    r"""Write a table to be included by ``\input``; `about` and the notes are comments in it.

    It needs the packages array, booktabs and longtable.
    """
    lines = [
        f"% {title}; written by flexstage {flexstage.__version__}",
        r"% needs \usepackage{array,booktabs,longtable}",
        "% and LaTeX of 2020 or later (else also textcomp)",
        *(f"% {key}: {value}" for key, value in about.items()),
        *(f"% validity: {note}" for note in notes),
    ]
    # a comment ends with its line
    lines = [" ".join(line.split()) for line in lines]
    caption = f"Characteristics of {escaped(title)}."
    known = any(c.uncertainty is not None for r in table.rows for c in r.cells.values())
    if known:
        caption += r" Figures after $\pm$ are standard uncertainties."
    label = re.sub(r"[^A-Za-z0-9-]", "-", name)
    head = _head(table)
    lines += [
        # a table of its own length and width: it goes on over pages, and long titles are broken
        r"{\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"\begin{{longtable}}{{{_columns(len(table.columns))}}}",
        rf"  \caption{{{caption}}}\label{{tab:{label}}}\\",
        r"  \toprule",
        *(f"  {line}" for line in head),
        r"  \midrule",
        r"  \endfirsthead",
        r"  \toprule",
        *(f"  {line}" for line in head),
        r"  \midrule",
        r"  \endhead",
        r"  \bottomrule",
        r"  \endlastfoot",
    ]
    before = ""
    for row in table.rows:
        if before and row.quantity != before:
            lines.append(r"  \addlinespace")
        lines.append("  " + _row(row, row.quantity != before, table, display(row.quantity)))
        before = row.quantity
    lines += [r"\end{longtable}}", ""]
    return "\n".join(lines).encode()


def _columns(count: int) -> str:
    """Columns that share the width of the text, whatever that is."""
    first = _NAMES if count <= _FEW else _NAMES - 0.06
    wide = (_TOGETHER - first) / max(count, 1)
    names = rf">{{\raggedright\arraybackslash}}p{{{first:.3f}\linewidth}}"
    figures = rf">{{\raggedleft\arraybackslash}}p{{\dimexpr {wide:.3f}\linewidth-6pt\relax}}"
    return rf"@{{}}{names}l*{{{count}}}{{{figures}}}@{{}}"


def _head(table: Comparison) -> list[str]:
    """Write the titles of the columns, published ones below a common one."""
    published = table.published
    titles = [escaped(title_of(o).removeprefix("published, ")) for o in table.columns]
    lines = [" & ".join(("Quantity", "Axis", *titles)) + r" \\"]
    if published:
        last = 2 + len(published)
        rest = " &" * (len(table.columns) - len(published))
        lines.insert(0, rf" & & \multicolumn{{{len(published)}}}{{c}}{{published}}{rest} \\")
        lines.insert(1, rf"\cmidrule(lr){{3-{last}}}")
    return lines


def _row(row: ComparisonRow, first: bool, table: Comparison, how: Quantity) -> str:
    label = f"{how.label} [{how.shown_unit}]" if how.shown_unit else how.label
    words = [label] if first else []
    if row.remark:
        words.append(f"({row.remark})")
    cells = [escaped(" ".join(words)), escaped(row.axis)]
    cells += [_cell(row.cells.get(origin), how) for origin in table.columns]
    return " & ".join(cells) + r" \\"


def _cell(cell: Characteristic | None, how: Quantity) -> str:
    if cell is None:
        return "--"
    if abs(cell.value) < how.zero:
        return r"$\approx 0$"
    if cell.origin.startswith("published") and cell.uncertainty is None:
        return _number(f"{cell.value * how.factor:.6g}")  # with the digits that were printed
    if cell.uncertainty is None:
        return _number(number(cell.value * how.factor))
    value, spread = beside(cell.value * how.factor, cell.uncertainty * abs(how.factor))
    return rf"{_number(value)} $\pm$ {_number(spread)}"


def _number(text: str) -> str:
    """Write a number with a true minus, and an exponent as a power of ten."""
    mantissa, _, exponent = text.partition("e")
    if mantissa.lstrip("-") == "inf":
        return rf"${mantissa.replace('inf', '')}\infty$"
    if exponent:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return f"${mantissa}$" if mantissa.startswith("-") else mantissa
