"""What stands below a diagram: values, the meaning of symbols and lines, and notes."""

from flexstage.export.diagram.graph import Block, Diagram, SignalKind
from flexstage.export.diagram.symbols import BASE, PlacedBlock, block_cell, plain, symbol, text
from flexstage.export.svg import element, moved, path, text_width, wrapped

#: Colour, dashes and name of each kind of line.
LINES: dict[SignalKind, tuple[str, str | None, str]] = {
    "motion": ("#0060a0", None, "displacement or rotation"),
    "rate": ("#00664b", "7 3", "its rate"),
    "force": ("#b03a00", None, "force or moment"),
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
    columns = [_symbols(diagram), _lines(used), _table("Values", _values(diagram))]
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
    shown: list[tuple[Block, str]] = []

    def entry(when: bool, kind: str, label: str, words: str, **described: object) -> None:
        if when:
            made = Block(name="x", kind=kind, label=label, meaning=words, **described)  # type: ignore[arg-type]
            shown.append((made, words))

    entry("sum" in kinds, "sum", "+", "sum, with signs", signs=(1, -1))
    entry("integrator" in kinds, "integrator", "1/s", "integral over time, zero at the start")
    entry("mass" in roles, "gain", "1/m", "inverse mass", role="mass")
    entry("spring" in roles, "gain", "k", "spring", role="spring")
    entry("damper" in roles, "gain", "c", "damper", role="damper")
    factor = any(b.kind == "gain" and b.role in ("", "geometry", "drive") for b in blocks)
    entry(factor, "gain", "i", "factor")
    for kind in ("hysteresis", "amplifier", "creep"):
        entry(kind in kinds, kind, "", kind, role="drive")
    entry("sensor" in kinds, "sensor", "", "sensor")
    out = [text("Symbols", 0.0, 12.0, size=13.0, font_weight="bold")]
    x, y, deepest = 0.0, _HEAD, 0.0
    wide = 82.0 + max(text_width(words, BASE) for _, words in shown)
    for number, (block, words) in enumerate(shown):
        if number == -(-len(shown) // 2) and number > 2:
            x, y, deepest = wide + 20.0, _HEAD, y
        cell = block_cell(block)
        high = 2.0 * cell.axis
        placed = PlacedBlock(block=block, x=x + 35.0 - 0.5 * cell.width, y=y, cell=cell)
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


def _values(diagram: Diagram) -> list[tuple[str, ...]]:
    """Return a table of what is known of the gains and of the models."""
    single: dict[str, tuple[str, ...]] = {}
    for b in diagram.blocks:
        if b.kind != "gain" or b.matrix is None:
            continue
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
    rows = list(single.values())
    rows += [(b.label, "", "", b.meaning) for b in diagram.blocks if b.model is not None]
    return [("", "value", "unit", ""), *rows]


def _shown(value: float, unit: str) -> tuple[str, str]:
    """Return a number and its unit as one writes them for a stage of this size."""
    factor, name = _USUAL.get(unit, (1.0, unit))
    return f"{factor * value:.4g}", name


def _split(meaning: str) -> tuple[str, str, str]:
    """Return what stands before a unit, the unit, and what follows."""
    words, _, rest = meaning.partition(" [")
    unit, _, after = rest.partition("]")
    return words, unit, after
