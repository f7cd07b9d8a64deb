"""The diagram of an axis as a drawing that stands by itself: SVG; those of a stage as files."""

from collections.abc import Sequence

import flexstage
from flexstage.errors import ModelError
from flexstage.export.diagram.graph import Diagram, SignalKind, signal_kinds
from flexstage.export.diagram.legend import LINES, foot
from flexstage.export.diagram.page import Frame, PageLayout, Segment, layout
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.symbols import SMALL, PlacedBlock, Point, inset, symbol, text
from flexstage.export.request import StageExport
from flexstage.export.svg import document, element, moved, number, path, wrapped
from flexstage.files.names import file_names
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.stage import Stage
from flexstage.system import RayleighDamping

_MARGIN = 24.0
_FRAMES = {
    "body": ("#6f4a8e", "#fbf9fc"),
    "hinge": ("#0072b2", "#f7fbfd"),
    "drive": ("#a85000", "#fffaf3"),
    "probe": ("#555555", "#fafafa"),
}
_LEAST_WIDTH = 900.0


def diagram_svg(diagram: Diagram, *, placed: PageLayout | None = None) -> bytes:
    """Draw the diagram of an axis on white ground.

    Nothing from outside (fonts, scripts) is needed, no name can clash with those of another drawing
    on the same page, and no letter is smaller than 9 px.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> diagram_svg(stage_diagram(design("parallelogram"), axis="x"))[:5]
    b'<?xml'
    """
    where = layout(diagram) if placed is None else placed
    kinds = signal_kinds(diagram)
    used: set[SignalKind] = {kinds[source] for source in where.wires}
    inner = max(where.width, _LEAST_WIDTH)
    titles = wrapped(diagram.title, inner, 18.0)
    head = 24.0 * len(titles) + 12.0
    below, deep = foot(diagram, inner, used)
    left = 0.5 * (inner - where.width)
    out = [text(line, 0.0, 18.0 + 24.0 * k, size=18.0, font_weight="bold")
           for k, line in enumerate(titles)]  # fmt: skip
    out.append(moved(_drawing(where, diagram), left, head))
    under = head + where.height + 24.0
    out.append(moved(below, 0.0, under))
    foot_y = under + deep + 22.0
    out.append(
        text(
            f"flexstage {flexstage.__version__}; equations of the lumped model",
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
    """Draw each axis of a stage that one drive moves, as ``diagram-AXIS.svg``.

    Where no model is given, amplifiers, hysteresis, creep and sensors are those of
    `hysteresis.dynamic_model`; damping is fitted to the two lowest modes where none is given.
    A stage without such an axis is refused.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> list(diagram_files(design("vgtu-mechanical")))
    ['diagram-x.svg', 'diagram-y.svg']
    """
    safe = file_names(axis.name for axis in stage.axes)
    axes = [(a.name, n) for a, n in zip(stage.axes, safe, strict=True) if a.drive is not None]
    if not axes:
        raise ModelError(
            f"stage '{stage.name}' has no axis that one drive moves, so that there is no diagram "
            "of one: a Simulink model holds the equations of the whole stage"
        )
    return {
        f"diagram-{name}.svg": diagram_svg(
            stage_diagram(stage, model=model, axis=axis, damping=damping)
        )
        for axis, name in axes
    }


def _drawing(where: PageLayout, diagram: Diagram) -> str:
    kinds = signal_kinds(diagram)
    out = [_frame(f) for f in where.frames]
    out += [_wire(segments, kinds[source]) for source, segments in where.wires.items()]
    sources = {(x.target, x.port): x.source for x in diagram.lines}
    for placed in where.blocks:
        out.append(symbol(placed))
        for port in range(placed.block.inputs):
            out.append(_arrow(placed, port, kinds[sources[(placed.block.name, port)]]))
    for label in where.labels:
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
        ways = set()
        for (x1, y1), (x2, y2) in segments:
            if y1 == y2 == y and x1 <= x <= x2:
                ways |= ({"left"} if x1 < x else set()) | ({"right"} if x < x2 else set())
            if x1 == x2 == x and y1 <= y <= y2:
                ways |= ({"up"} if y1 < y else set()) | ({"down"} if y < y2 else set())
        if len(ways) > 2:
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


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    return diagram_files(given.stage, model=given.dynamic_of_bodies)
