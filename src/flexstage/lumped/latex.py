"""Elements of a sheet of equations, and their output as LaTeX, plain text, MathML or plain data."""

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.printing.mathml import MathMLPresentationPrinter


@dataclass(frozen=True, slots=True, kw_only=True)
class Paragraph:
    """A sentence or two."""

    text: str
    """Plain text."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Formula:
    """An equation."""

    left: sp.Basic | str
    """Left side; LaTeX where it is a text."""
    right: sp.Basic | str
    """Right side; LaTeX where it is a text."""
    plain: str = ""
    """Left side in plain text, where `left` is LaTeX."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tabular:
    """A table of texts, numbers and expressions."""

    header: tuple[str | sp.Basic, ...]
    """Heads of the columns: texts or expressions."""
    rows: tuple[tuple[str | float | sp.Basic, ...], ...]
    """Cells: texts, numbers or expressions."""


Item = Paragraph | Formula | Tabular


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetSection:
    """A section of the sheet."""

    key: str
    """Short name by which a program finds it."""
    title: str
    """Heading."""
    items: tuple[Item, ...]
    """Paragraphs, formulas and tables in order."""


_ESCAPES = {c: "\\" + c for c in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
}

# width of a line of a long sum, in characters of LaTeX: about a line of the page
_LINE = 130
# the same for the rows of a matrix, whose entries are mostly indices; a wider one is listed
_WIDE = 200

_MATH = '<math xmlns="http://www.w3.org/1998/Math/MathML">'

_HEAD = r"""\documentclass[a4paper,10pt]{article}
\usepackage[margin=20mm]{geometry}
\usepackage{amsmath}
\usepackage{longtable}
\allowdisplaybreaks
\setlength{\parindent}{0pt}
\setcounter{MaxMatrixCols}{24}
"""


def latex_document(title: str, sections: Sequence[SheetSection]) -> str:
    """Write a sheet of equations as a LaTeX document.

    Parameters
    ----------
    title : str
        Title of the document.
    sections : Sequence of SheetSection
        The sheet.

    Returns
    -------
    str
        A complete document; it needs the packages amsmath, geometry and longtable.
    """
    parts = [_HEAD, rf"\title{{{_escaped(title)}}}", r"\date{}", r"\begin{document}", r"\maketitle"]
    for section in sections:
        parts.append(rf"\section{{{_escaped(section.title)}}}")
        run: list[str] = []
        for item in section.items:
            if isinstance(item, Formula):
                run += _lines(item)
                continue
            parts += _aligned(run)
            run = []
            parts.append(
                f"{_escaped(item.text)}\n" if isinstance(item, Paragraph) else _longtable(item)
            )
        parts += _aligned(run)
    parts.append(r"\end{document}")
    return "\n".join(parts) + "\n"


def plain_text(title: str, sections: Sequence[SheetSection]) -> str:
    """Write a sheet of equations as plain text."""
    parts = [title, "=" * len(title)]
    for section in sections:
        parts += ["", section.title, "-" * len(section.title)]
        for item in section.items:
            if isinstance(item, Paragraph):
                parts += ["", item.text]
            elif isinstance(item, Formula):
                left = item.plain or _plain(item.left)
                right = item.right
                if isinstance(right, sp.MatrixBase):
                    rows = [[_plain(e) for e in right.row(i)] for i in range(right.rows)]
                    parts.append(f"  {left} =")
                    parts += ["    [" + ",  ".join(row) + "]" for row in rows]
                else:
                    parts.append(f"  {left} = {_plain(right)}")
            else:
                parts += ["", *_columns(item)]
    return "\n".join(parts) + "\n"


def sheet_data(sections: Sequence[SheetSection]) -> list[dict[str, Any]]:
    """Return a sheet of equations as plain data, each formula as LaTeX, MathML and text."""
    return [
        {"key": s.key, "title": s.title, "items": [_item_data(item) for item in s.items]}
        for s in sections
    ]


def mathml(expression: sp.Basic) -> str:
    r"""Write an expression as presentation MathML, which browsers show without any script.

    Parameters
    ----------
    expression : sympy.Basic
        The expression.

    Returns
    -------
    str
        A ``<math>`` element.

    Examples
    --------
    >>> "<mover" in mathml(sp.Symbol(r"\dot{x}_1"))
    True
    """
    printer = _Printer()
    inner = printer._print(expression).toxml()
    # XML knows five entities by name, SymPy writes more
    inner = re.sub(r"&(?!lt;|gt;|amp;|quot;|apos;)\w+;", lambda m: html.unescape(m[0]), inner)
    return f"{_MATH}{inner}</math>"


class _Printer(MathMLPresentationPrinter):
    """Printer for the dots and indices that symbols have as LaTeX."""

    def _print_Symbol(self, sym: sp.Symbol, style: str = "plain") -> Any:
        del style
        base, _, index = _split(sym.name)
        dots = 0
        match = re.fullmatch(r"\\(d?)dot\{(.*)\}", base)
        if match:
            dots, base = 1 + len(match[1]), match[2]
        node = self._identifier(base)
        if dots:
            over = self.dom.createElement("mover")
            over.appendChild(node)
            dot = self.dom.createElement("mo")
            dot.appendChild(self.dom.createTextNode("." * dots))
            over.appendChild(dot)
            node = over
        if not index:
            return node
        sub = self.dom.createElement("msub")
        sub.appendChild(node)
        sub.appendChild(self._identifier(index))
        return sub

    def _identifier(self, name: str) -> Any:
        name = re.sub(r"\\mathrm\{(.*)\}", r"\1", name).replace(r"\_", "_")
        for word, letter in _GREEK.items():
            name = re.sub(rf"\\?{word}(?![a-z])", letter, name)
        node = self.dom.createElement("mi")
        node.appendChild(self.dom.createTextNode(name))
        return node


_GREEK = {
    "vartheta": "ϑ",
    "theta": "θ",
    "lambda": "λ",
    "alpha": "α",
    "beta": "β",
    "phi": "φ",
    "eta": "η",
    "ell": "ℓ",
}


def _split(name: str) -> tuple[str, str, str]:
    """Split a symbol's name into base and index."""
    match = re.fullmatch(r"(\\d?dot\{[^}]*\}|[^_]+)(_)?(.*)", name)
    if match is None:
        return name, "", ""
    index = match[3] or ""
    if index.startswith("{") and index.endswith("}"):
        index = index[1:-1]
    return match[1], match[2] or "", index


def _item_data(item: Item) -> dict[str, Any]:
    if isinstance(item, Paragraph):
        return {"kind": "paragraph", "text": item.text}
    if isinstance(item, Formula):
        latex = f"{_tex(item.left)} = {_tex(item.right)}"
        data = {
            "kind": "formula",
            "latex": latex,
            "text": f"{item.plain or _plain(item.left)} = {_plain(item.right)}",
        }
        data["mathml"] = _equation_mathml(item)
        return data
    return {
        "kind": "table",
        "header": [_plain(h) for h in item.header],
        "rows": [[_plain(c) for c in row] for row in item.rows],
    }


def _equation_mathml(formula: Formula) -> str:
    """Left = right; a side that is given as LaTeX is shown as plain text."""
    sides = []
    for side, plain in ((formula.left, formula.plain), (formula.right, "")):
        if isinstance(side, str):
            sides.append(f"<mtext>{html.escape(plain or _plain(side), quote=False)}</mtext>")
        else:
            markup = mathml(_shortened(side))
            sides.append(f"<mrow>{markup[markup.index('>') + 1 : -len('</math>')]}</mrow>")
    return _MATH + "<mo>=</mo>".join(sides) + "</math>"


def _tex(value: str | float | sp.Basic) -> str:
    if isinstance(value, str):
        return value
    return sp.latex(_shortened(value), mat_delim="[", order="none")


def _shortened(value: Any) -> Any:
    """Numbers with eight digits: more say nothing to a reader."""
    if isinstance(value, sp.Basic | sp.MatrixBase):
        return value.xreplace({x: sp.Float(x, 8) for x in value.atoms(sp.Float)})
    return value


def _lines(formula: Formula) -> list[str]:
    """One or more lines of an aligned display; long sums are broken between terms."""
    left, right = formula.left, formula.right
    if isinstance(right, sp.MatrixBase) and _width(right) > _WIDE:
        entries = []
        for row in range(right.rows):
            for column in range(right.cols):
                if right[row, column] != 0:
                    name = f"\\bigl[{_tex(left)}\\bigr]_{{{row + 1}{column + 1}}}"
                    entries += _lines(Formula(left=name, right=right[row, column]))
        return entries
    if isinstance(left, sp.Add):
        pieces, tail, head = _pieces(left), f" = {_tex(right)}", "&"
    elif isinstance(right, sp.Expr):
        pieces, tail, head = _pieces(right), "", f"{_tex(left)} ={{}}&"
    else:
        return [f"{_tex(left)} ={{}}& {_tex(right)}"]
    lines, current = [], ""
    for piece in pieces:
        if current and len(current) + len(piece) > _LINE:
            lines.append(current)
            current = ""
        current += (" " if current else "") + piece
    lines.append(current + tail)
    return [head + " " + lines[0], *(rf"&\quad {line}" for line in lines[1:])]


def _width(matrix: sp.MatrixBase) -> int:
    """Characters of LaTeX that a row of a matrix takes."""
    return sum(
        max(len(_tex(matrix[row, column])) for row in range(matrix.rows))
        for column in range(matrix.cols)
    )


def _pieces(expression: sp.Expr) -> list[str]:
    """Terms with their signs; a bracket that fills a line is given term by term as well."""
    pieces: list[str] = []
    for term in expression.as_ordered_terms():
        text = _tex(term)
        sums = [f for f in sp.Mul.make_args(term) if isinstance(f, sp.Add)]
        if len(text) > _LINE and len(sums) == 1:
            # multiplying out a bare bracket would hide what belongs together
            front = _tex(term / sums[0])
            inner = _pieces(sums[0])
            start = "" if front == "1" else "-" if front == "-1" else front
            parts = [rf"{start} \bigl( {inner[0]}".strip(), *inner[1:-1]]
            parts.append(rf"{inner[-1]} \bigr)")
        else:
            parts = [text]
        if pieces and not parts[0].startswith("-"):
            parts[0] = f"+ {parts[0]}"
        pieces += parts
    return pieces


def _aligned(lines: list[str]) -> list[str]:
    if not lines:
        return []
    body = " \\\\\n".join(lines)
    return ["\\begin{align*}\n" + body + "\n\\end{align*}"]


def _longtable(table: Tabular) -> str:
    def cell(value: str | float | sp.Basic) -> str:
        return f"${_tex(value)}$" if isinstance(value, sp.Basic) else _escaped(str(value))

    rows = [" & ".join(map(cell, row)) + r" \\" for row in table.rows]
    head = " & ".join(map(cell, table.header)) + r" \\ \hline \endhead"
    columns = "l" * len(table.header)
    return "\n".join(
        [r"{\footnotesize", rf"\begin{{longtable}}{{{columns}}}", head, *rows, r"\end{longtable}}"]
    )


def _columns(table: Tabular) -> list[str]:
    rows = [[_plain(c) for c in row] for row in (table.header, *table.rows)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(table.header))]
    lines = [
        "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return [lines[0], "  " + "-" * (sum(widths) + 2 * len(widths) - 2), *lines[1:]]


def _plain(value: str | float | sp.Basic) -> str:
    text = value if isinstance(value, str) else str(_shortened(value))
    text = re.sub(r"\\ddot\{\\?(\w+)\}(_\w+)?", r"\1\2''", text)
    text = re.sub(r"\\dot\{\\?(\w+)\}(_\w+)?", r"\1\2'", text)
    text = text.replace(r"\ddot q", "q''").replace(r"\dot q", "q'").replace(r"\tfrac12", "1/2 ")
    text = re.sub(r"\\mathrm\{([^}]*)\}", r"\1", text).replace(r"\_", "_").replace(r"\,", " ")
    text = re.sub(r"\\([a-zA-Z]+)", r"\1", text)
    return re.sub(r"_\{([^}]*)\}", r"_\1", text).replace("**", "^")


def _escaped(text: str) -> str:
    # one pass, so that what stands for a character is not escaped again
    return "".join(_ESCAPES.get(c, c) for c in text)
