"""A diagram as a drawing that stands by itself: SVG; those of a stage as files."""

import flexstage
from flexstage.export.diagram.graph import Diagram, SignalKind, signal_kinds
from flexstage.export.diagram.legend import LINES, foot
from flexstage.export.diagram.markup import SMALL, text
from flexstage.export.diagram.page import Frame, PageLayout, PlacedBlock, PlacedLine, layout
from flexstage.export.diagram.shapes import branches
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.symbols import inset, symbol
from flexstage.export.request import ExportRequest
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
    """Draw a diagram on white ground.

    Nothing from outside (fonts, scripts) is needed, no name can clash with those of another drawing
    on the same page, and no letter is smaller than 9 px.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> diagram_svg(stage_diagram(design("parallelogram")))[:5]
    b'<?xml'
    """
    where = layout(diagram) if placed is None else placed
    kinds = signal_kinds(diagram)
    used: set[SignalKind] = {kinds[w.source] for w in where.wires if w.segments}
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
    """Draw a stage and each of its axes that one drive moves.

    ``diagram.svg`` and, for each of these axes, ``diagram-AXIS.svg``. Where no model is given,
    amplifiers, hysteresis, creep and sensors are those of `hysteresis.dynamic_model`; damping is
    fitted to the two lowest modes where none is given.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> sorted(diagram_files(design("parallelogram")))
    ['diagram-x.svg', 'diagram.svg']
    """
    out = {"diagram.svg": diagram_svg(stage_diagram(stage, model=model, damping=damping))}
    safe = file_names(axis.name for axis in stage.axes)
    for axis, name in zip(stage.axes, safe, strict=True):
        if axis.drive is None:
            continue
        made = stage_diagram(stage, model=model, axis=axis.name, damping=damping)
        out[f"diagram-{name}.svg"] = diagram_svg(made)
    return out


def _drawing(where: PageLayout, diagram: Diagram) -> str:
    kinds = signal_kinds(diagram)
    wide = {b.name: b.width > 1 for b in diagram.blocks}
    out = [_frame(f) for f in where.frames]
    out += [_wire(w, kinds[w.source], wide[w.source]) for w in where.wires]
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
    edge, fill = _FRAMES.get(frame.group.kind, ("#777777", "#ffffff"))
    if not frame.group.title:
        return ""
    out = [
        element("rect", x=frame.x, y=frame.y, width=frame.width, height=frame.height, rx=6,
                fill=fill, stroke=edge, stroke_width=1.1),
        text(frame.group.title.replace("_", "\u2009"), frame.x + 10.0, frame.y + 18.0, size=13.0,
             font_weight="bold", fill=edge),
    ]  # fmt: skip
    for k, line in enumerate(frame.subtitle):
        out.append(
            text(line.replace("_", "\u2009"), frame.x + 10.0, frame.y + 32.0 + 14.0 * k,
                 size=SMALL, fill="#555555")
        )  # fmt: skip
    return "".join(out)


def _wire(wire: PlacedLine, kind: SignalKind, wide: bool) -> str:
    colour, dashes, _ = LINES[kind]
    d = "".join(
        f"M{number(x1)} {number(y1)}L{number(x2)} {number(y2)}"
        for (x1, y1), (x2, y2) in wire.segments
    )
    line = element(
        "path", d=d, stroke=colour, stroke_width=1.9 if wide else 1.2, stroke_dasharray=dashes,
        stroke_linecap="square" if dashes is None else None, fill="none",
    )  # fmt: skip
    dots = (element("circle", cx=x, cy=y, r=2.8, fill=colour) for x, y in branches(wire.segments))
    return line + "".join(dots)


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


def export(request: ExportRequest) -> dict[str, bytes]:
    """Write the format."""
    return diagram_files(request.stage, model=request.dynamic_of_bodies)
