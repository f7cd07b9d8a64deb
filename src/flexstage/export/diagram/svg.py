"""Diagrams of axes as self-contained SVG files."""

from collections.abc import Sequence

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.diagram.graph import Block, Diagram, SignalKind, signal_kinds
from flexstage.export.diagram.page import Frame, PageLayout, Segment, layout
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.symbols import (
    BASE,
    SMALL,
    PlacedBlock,
    Point,
    block_cell,
    inset,
    plain,
    symbol,
    text,
)
from flexstage.export.request import StageExport
from flexstage.export.svg import document, element, moved, number, path, text_width, wrapped
from flexstage.files.names import file_names
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.stage import Stage
from flexstage.system import RayleighDamping

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

#: Display units for values of such stages, and their factors.
_USUAL = {
    "kg": (1e3, "g"),
    "N/m": (1e-6, "N/µm"),
    "m/V": (1e9, "nm/V"),
    "1": (1.0, ""),
}


def foot(diagram: Diagram, width: float, used: set[SignalKind]) -> tuple[str, float]:
    """Return the legend below a diagram, its top at 0, and its height [px].

    It explains symbols and kinds of lines, and has values and notes.
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
    """Return the legend of the symbols in the diagram."""
    blocks = diagram.blocks
    kinds = {b.kind for b in blocks}
    roles = {b.role for b in blocks}
    entries: list[tuple[Block, str]] = []

    def entry(when: bool, kind: str, label: str, words: str, **described: object) -> None:
        if when:
            block = Block(name="x", kind=kind, label=label, meaning=words, **described)  # type: ignore[arg-type]
            entries.append((block, words))

    entry("sum" in kinds, "sum", "+", "sum, with signs", signs=(1, -1))
    entry("integrator" in kinds, "integrator", "1/s", "integral over time, initially zero")
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
    wide = 82.0 + max(text_width(words, BASE) for _, words in entries)
    for place, (block, words) in enumerate(entries):
        if place == -(-len(entries) // 2) and place > 2:
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
    last = "branch; crossing lines are not joined"
    out.append(text(last, 54.0, y + 8.0))
    return "".join(out), 54.0 + text_width(last, BASE), y + _ROW


def _table(title: str, rows: list[tuple[str, ...]]) -> tuple[str, float, float]:
    """Return a table with its first row as heading."""
    count = len(rows[0])
    wide = [max(text_width(plain(r[k]), BASE) for r in rows) + 16.0 for k in range(count)]
    out = [text(title, 0.0, 12.0, size=13.0, font_weight="bold")]
    y = _HEAD + 12.0
    for line, row in enumerate(rows):
        x = 0.0
        for k, words in enumerate(row):
            # a heading is aligned like the column below it
            right = k > 0 and (row if line else rows[1])[k][:1] in "0123456789-"
            at, anchor = (x + wide[k] - 16.0, "end") if right else (x, "start")
            out.append(text(words, at, y, anchor=anchor, fill=None if line else "#555555"))
            x += wide[k]
        y += 17.0
    return "".join(out), max(sum(wide), text_width(title, 13.0)), y - 8.0


def _values(diagram: Diagram) -> list[tuple[str, ...]]:
    """Return the table of values of gains and models."""
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
        # in the display unit
        factor, unit_text = _USUAL.get(unit, (1.0, unit))
        single.setdefault(
            f"{label} {words}" if label != "i" else label,
            (label, f"{factor * value:.4g}", unit_text, words.strip()),
        )
    rows = list(single.values())
    rows += [(b.label, "", "", b.meaning) for b in diagram.blocks if b.model is not None]
    return [("", "value", "unit", ""), *rows]


def _split(meaning: str) -> tuple[str, str, str]:
    """Return the text before a unit, the unit, and the text after it."""
    words, _, rest = meaning.partition(" [")
    unit, _, after = rest.partition("]")
    return words, unit, after


_MARGIN = 24.0
_FRAMES = {
    "body": ("#6f4a8e", "#fbf9fc"),
    "hinge": ("#0072b2", "#f7fbfd"),
    "drive": ("#a85000", "#fffaf3"),
    "probe": ("#555555", "#fafafa"),
}
_LEAST_WIDTH = 900.0


def diagram_svg(diagram: Diagram) -> bytes:
    """Return the diagram of an axis as SVG on a white background.

    It needs no external fonts or scripts, its names cannot clash with those of another drawing on
    the same page, and no letter is smaller than 9 px.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> diagram_svg(stage_diagram(design("parallelogram"), axis="x"))[:5]
    b'<?xml'
    """
    page_layout = layout(diagram)
    kinds = signal_kinds(diagram)
    used: set[SignalKind] = {kinds[source] for source in page_layout.wires}
    inner = max(page_layout.width, _LEAST_WIDTH)
    titles = wrapped(diagram.title, inner, 18.0)
    head = 24.0 * len(titles) + 12.0
    below, deep = foot(diagram, inner, used)
    left = 0.5 * (inner - page_layout.width)
    out = [text(line, 0.0, 18.0 + 24.0 * k, size=18.0, font_weight="bold")
           for k, line in enumerate(titles)]  # fmt: skip
    out.append(moved(_drawing(page_layout, diagram), left, head))
    under = head + page_layout.height + 24.0
    out.append(moved(below, 0.0, under))
    foot_y = under + deep + 22.0
    out.append(
        text(
            f"flexstage {__version__}; equations of the lumped model",
            0.0, foot_y, size=SMALL, fill="#555555",
        )
    )  # fmt: skip
    width, height = inner + 2.0 * _MARGIN, foot_y + 8.0 + 2.0 * _MARGIN
    return document(
        round(width),
        round(height),
        [moved("\n".join(out), _MARGIN, _MARGIN)],
        title=diagram.title,
        role="img",
        fill="#1a1a1a",
    )


def diagram_files(
    stage: Stage, *, model: DynamicModel | None = None, damping: RayleighDamping | None = None
) -> dict[str, bytes]:
    """Return the diagram of each axis with a single drive, as ``diagram-AXIS.svg``.

    Amplifiers, hysteresis, creep and sensors are by default those of `hysteresis.dynamic_model`;
    damping is by default fitted to the two lowest modes. A stage without such an axis is refused.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> list(diagram_files(design("vgtu-mechanical")))
    ['diagram-x.svg', 'diagram-y.svg']
    """
    safe = file_names(axis.name for axis in stage.axes)
    axes = [(a.name, n) for a, n in zip(stage.axes, safe, strict=True) if a.drive is not None]
    if not axes:
        raise ModelError(
            f"stage '{stage.name}' has no axis with a single drive, so there is no diagram of an "
            "axis: export a Simulink model for the equations of the entire stage"
        )
    return {
        f"diagram-{name}.svg": diagram_svg(
            stage_diagram(stage, model=model, axis=axis, damping=damping)
        )
        for axis, name in axes
    }


def _drawing(page_layout: PageLayout, diagram: Diagram) -> str:
    kinds = signal_kinds(diagram)
    out = [_frame(f) for f in page_layout.frames]
    out += [_wire(segments, kinds[source]) for source, segments in page_layout.wires.items()]
    sources = {(x.target, x.port): x.source for x in diagram.lines}
    for placed in page_layout.blocks:
        out.append(symbol(placed))
        for port in range(placed.block.inputs):
            out.append(_arrow(placed, port, kinds[sources[(placed.block.name, port)]]))
    for label in page_layout.labels:
        out.append(
            text(label.text, label.x, label.y, size=SMALL, anchor="end" if label.end else "start")
        )
    return "\n".join(out)


def _frame(frame: Frame) -> str:
    edge, fill = _FRAMES[frame.group.kind]
    title = frame.group.title.replace("_", "\u2009")
    style = {"fill": fill, "stroke": edge, "stroke_width": 1.1}
    wide, high = frame.right - frame.x, frame.bottom - frame.y
    box = element("rect", x=frame.x, y=frame.y, width=wide, height=high, rx=6, **style)
    at = (frame.x + 10.0, frame.y + 18.0)
    return box + text(title, *at, size=13.0, font_weight="bold", fill=edge)


def _wire(segments: Sequence[Segment], kind: SignalKind) -> str:
    colour, dashes, _ = LINES[kind]
    d = "".join(
        f"M{number(x1)} {number(y1)}L{number(x2)} {number(y2)}" for (x1, y1), (x2, y2) in segments
    )
    line = element(
        "path", d=d, stroke=colour, stroke_width=1.2, stroke_dasharray=dashes,
        stroke_linecap="square" if dashes is None else None, fill="none",
    )  # fmt: skip
    dots = (element("circle", cx=x, cy=y, r=2.8, fill=colour) for x, y in branches(segments))
    return line + "".join(dots)


def branches(segments: Sequence[Segment]) -> list[Point]:
    """Return the points at which a line branches."""
    points = sorted({p for s in segments for p in s})
    out = []
    for x, y in points:
        directions = set()
        for (x1, y1), (x2, y2) in segments:
            if y1 == y2 == y and x1 <= x <= x2:
                directions |= ({"left"} if x1 < x else set()) | ({"right"} if x < x2 else set())
            if x1 == x2 == x and y1 <= y <= y2:
                directions |= ({"up"} if y1 < y else set()) | ({"down"} if y < y2 else set())
        if len(directions) > 2:
            out.append((x, y))
    return out


def _arrow(placed: PlacedBlock, port: int, kind: SignalKind) -> str:
    colour = LINES[kind][0]
    pin = placed.cell.pins[f"in{port}"]
    into = inset(placed, port)
    y = placed.y + pin.y
    if pin.side == "L":
        x, back = placed.x + into, -1.0
    else:
        x, back = placed.x + placed.cell.width - into, 1.0
    stem = path([(x + back * into, y), (x + 4.0 * back, y)], stroke=colour, stroke_width=1.2)
    head = path(
        [(x, y), (x + 8.0 * back, y - 3.4), (x + 8.0 * back, y + 3.4)], closed=True, fill=colour
    )
    return (stem if into > 4.0 else "") + head


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    return diagram_files(stage_export.stage, model=stage_export.dynamic_of_bodies)
