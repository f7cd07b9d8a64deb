"""What stands below a diagram: values, the meaning of symbols and lines, and notes."""

import numpy as np

from flexstage.export.diagram.graph import Block, Diagram, SignalKind
from flexstage.export.diagram.markup import BASE, plain, text
from flexstage.export.diagram.page import PlacedBlock
from flexstage.export.diagram.shapes import block_cell
from flexstage.export.diagram.symbols import symbol
from flexstage.export.svg import element, moved, path, text_width, wrapped

#: Colour, dashes and name of each kind of line.
LINES: dict[SignalKind, tuple[str, str | None, str]] = {
    "motion": ("#0060a0", None, "displacement and rotation q"),
    "rate": ("#00664b", "7 3", "their rates q'"),
    "force": ("#b03a00", None, "force and moment"),
    "other": ("#333333", None, "command, voltage, acceleration"),
}

_ROW = 19.0
_HEAD = 24.0
_GAP = 36.0

#: Units in which sizes of such stages have few digits, and their factors.
_USUAL = {
    "kg": (1e3, "g"),
    "N/m": (1e-6, "N/µm"),
    "m/V": (1e9, "nm/V"),
    "1": (1.0, ""),
}


def foot(diagram: Diagram, width: float, used: set[SignalKind]) -> tuple[str, float]:
    """Return what stands below a diagram, its top at 0, and its height [px].

    Lines of the kinds that are used are explained.
    """
    out: list[str] = []
    columns = [_symbols(diagram), _lines(used)]
    columns += [_table(title, rows) for title, rows in _values(diagram) if rows]
    x, y, deep = 0.0, 0.0, 0.0
    for body, wide, high in columns:
        if x > 0.0 and x + wide > width:
            x, y, deep = 0.0, y + deep + 14.0, 0.0
        out.append(moved(body, x, y))
        x += wide + _GAP
        deep = max(deep, high)
    y += deep + 16.0
    if diagram.notes:
        out.append(text("Notes", 0.0, y + 12.0, size=13.0, font_weight="bold"))
        y += _HEAD
        for number, note in enumerate(diagram.notes, start=1):
            for k, line in enumerate(wrapped(note, min(width, 1100.0) - 24.0, BASE)):
                if k == 0:
                    out.append(text(f"{number}", 4.0, y + 10.0))
                out.append(text(line.replace("_", "_\u200b"), 24.0, y + 10.0))
                y += 17.0
    return "".join(out), y


def _symbols(diagram: Diagram) -> tuple[str, float, float]:
    """Return the meaning of the symbols that are there."""
    blocks = diagram.blocks
    kinds = {b.kind for b in blocks}
    roles = {b.role for b in blocks}
    many = any(b.kind == "gain" and b.matrix is not None and b.matrix.size > 1 for b in blocks)
    one = np.eye(1)
    two = np.eye(2)
    matrix = two if many else one
    shown: list[tuple[Block, str]] = []

    def entry(when: bool, kind: str, label: str, words: str, **described: object) -> None:
        if when:
            made = Block(name="x", kind=kind, label=label, meaning=words, **described)  # type: ignore[arg-type]
            shown.append((made, words))

    size = matrix.shape[0]
    inverse = "inverse mass and inertia" if many else "inverse mass"
    factor = any(
        b.kind == "gain"
        and b.matrix is not None
        and b.matrix.size == 1
        and b.role not in ("spring", "damper", "mass")
        for b in blocks
    )
    of_springs = {"matrix": matrix, "width": size}
    entry("sum" in kinds, "sum", "+", "sum, with signs", signs=(1, -1))
    entry("integrator" in kinds, "integrator", "1/s", "integral over time, zero at the start")
    entry("mass" in roles, "gain", "M⁻¹" if many else "1/m", inverse, role="mass", **of_springs)
    entry("spring" in roles, "gain", "K" if many else "k", "spring", role="spring", **of_springs)
    entry("damper" in roles, "gain", "βK" if many else "c", "damper", role="damper", **of_springs)
    across = "matrix; B and Bᵀ lead from bodies to a hinge and back"
    entry(many, "gain", "B", across, matrix=two, width=2)
    entry(factor, "gain", "c" if many else "i", "factor", matrix=one)
    entry("hysteresis" in kinds, "hysteresis", "", "hysteresis", role="drive")
    entry("amplifier" in kinds, "amplifier", "", "amplifier", role="drive")
    entry("creep" in kinds, "creep", "", "creep", role="drive")
    entry("sensor" in kinds, "sensor", "", "sensor")
    out = [text("Symbols", 0.0, 12.0, size=13.0, font_weight="bold")]
    x, y, deepest = 0.0, _HEAD, 0.0
    wide = 82.0 + max(text_width(words, BASE) for _, words in shown)
    for number, (block, words) in enumerate(shown):
        if number == -(-len(shown) // 2) and number > 2:
            x, y, deepest = wide + 20.0, _HEAD, y
        cell = block_cell(block, straight=0)
        high = 2.0 * cell.axis
        placed = PlacedBlock(
            block=block, x=x + 35.0 - 0.5 * cell.width, y=y, cell=cell, flipped=False
        )
        out.append(symbol(placed))
        out.append(text(words, x + 82.0, y + 0.5 * high + 4.0))
        y += high + 7.0
    return "".join(out), x + wide, max(y, deepest)


def _lines(used: set[SignalKind]) -> tuple[str, float, float]:
    out = [text("Lines", 0.0, 12.0, size=13.0, font_weight="bold")]
    y = _HEAD + 4.0
    for kind, (colour, dashes, words) in LINES.items():
        if kind in used:
            out.append(
                path([(0.0, y + 4.0), (44.0, y + 4.0)], stroke=colour, stroke_width=2.0,
                     stroke_dasharray=dashes)
            )  # fmt: skip
            out.append(text(words, 54.0, y + 8.0))
            y += _ROW
    out.append(path([(0.0, y + 4.0), (44.0, y + 4.0)], stroke="#333333", stroke_width=1.2))
    out.append(text("one signal; thick: several", 54.0, y + 8.0))
    y += _ROW
    out.append(element("circle", cx=22.0, cy=y + 4.0, r=3.0, fill="#333333"))
    last = "branch; lines that only cross do not meet"
    out.append(text(last, 54.0, y + 8.0))
    return "".join(out), 54.0 + text_width(last, BASE), y + _ROW


def _table(title: str, rows: list[tuple[str, ...]]) -> tuple[str, float, float]:
    """Return a table whose first row is its head."""
    count = len(rows[0])
    wide = [max(text_width(plain(r[k]), BASE) for r in rows) + 16.0 for k in range(count)]
    out = [text(title, 0.0, 12.0, size=13.0, font_weight="bold")]
    y = _HEAD + 12.0
    for number, row in enumerate(rows):
        x = 0.0
        for k, words in enumerate(row):
            number_like = k > 0 and number > 0 and words[:1] in "0123456789-"
            right = number_like or (k > 0 and number == 0 and rows[1][k][:1] in "0123456789-")
            out.append(
                text(words, x + wide[k] - 16.0 if right else x, y, anchor="end" if right else
                     "start", fill="#555555" if number == 0 else None)
            )  # fmt: skip
            x += wide[k]
        y += 17.0
    return "".join(out), max(sum(wide), text_width(title, 13.0)), y - 8.0


def _values(diagram: Diagram) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Return tables of what is known of bodies, hinges and single gains."""
    titles = {g.name: g for g in diagram.groups}
    bodies: list[tuple[str, ...]] = [("body", "mass [g]", "inertia [g mm²]")]
    hinges: list[tuple[str, ...]] = [("hinge", "along [N/µm]", "across [N/µm]", "turn [N m/rad]")]
    single: dict[str, tuple[str, ...]] = {}
    for b in diagram.blocks:
        if b.kind != "gain" or b.matrix is None:
            continue
        if b.matrix.size == 1:
            value = float(b.matrix[0, 0])
            words, unit, rest = _split(b.meaning)
            words, label = words + rest, b.label
            if label.startswith("1/m"):
                label, value, unit = label[2:], 1.0 / value, "kg"
                words = words.replace("inverse ", "")
            single.setdefault(
                f"{label} {words}" if label != "i" else label,
                (label, *_shown(value, unit), words.strip()),
            )
        elif b.role == "mass":
            mass, inertia = 1.0 / b.matrix[0, 0], 1.0 / b.matrix[2, 2]
            name = titles[b.group].title.removeprefix("Body ") if b.group else b.name
            bodies.append((_flat(name), f"{1e3 * mass:.4g}", f"{1e9 * inertia:.4g}"))
        elif b.role == "spring" and b.matrix.shape[0] % 3 == 0:
            name = titles[b.group].title.removeprefix("Hinge ") if b.group else b.name
            k = np.diag(b.matrix)
            hinges.append((_flat(name), f"{1e-6 * k[0]:.4g}", f"{1e-6 * k[1]:.4g}", f"{k[2]:.4g}"))
    rows = list(single.values())
    rows += [(b.label, "", "", b.meaning) for b in diagram.blocks if b.model is not None]
    return [
        ("Values", [("", "value", "unit", ""), *rows] if rows else []),
        ("Bodies", bodies if len(bodies) > 1 else []),
        ("Hinges", hinges if len(hinges) > 1 else []),
    ]


def _shown(value: float, unit: str) -> tuple[str, str]:
    """Return a number and its unit as one writes them for a stage of this size."""
    factor, name = _USUAL.get(unit, (1.0, unit))
    return f"{factor * value:.4g}", name


def _split(meaning: str) -> tuple[str, str, str]:
    """Return what stands before a unit, the unit, and what follows."""
    words, _, rest = meaning.partition(" [")
    unit, _, after = rest.partition("]")
    return words, unit, after


def _flat(name: str) -> str:
    """Keep an underscore of a name from being read as the mark of a subscript."""
    return name.replace("_", "\u2009")
