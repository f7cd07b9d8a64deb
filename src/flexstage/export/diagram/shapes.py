"""Sizes of blocks in a drawing, and where lines meet them."""

from collections.abc import Mapping

from flexstage.export.diagram.cells import Cell, Pin
from flexstage.export.diagram.graph import Block
from flexstage.export.diagram.markup import BASE, SMALL, plain, text_width

SUM_RADIUS = 15.0
# Distance of the inputs of a long sum, and of the outer ones from its ends.
_APART = 19.0
_END = 16.0
# Offsets of the inputs of a round sum: the straight one, and the other below or above.
_ROUND = (0.0, 10.5)
_CAPTION = 15.0


def round_sum(block: Block) -> bool:
    """Return whether a sum is drawn as a circle: one with few inputs is."""
    return len(block.signs) <= len(_ROUND)


def shape_width(block: Block) -> float:
    """Return the width of what is drawn for a block, without its caption [px]."""
    label = text_width(plain(block.label), BASE)
    match block.kind:
        case "sum":
            return 2.0 * SUM_RADIUS
        case "integrator":
            return 34.0
        case "input" | "output":
            return label + 20.0
        case "gain":
            if block.role in ("spring", "damper"):
                return label + 46.0
            return label + (34.0 if block.width == 1 and _scalar(block) else 22.0)
        case _:
            return 56.0


def _scalar(block: Block) -> bool:
    return block.matrix is not None and block.matrix.shape == (1, 1)


def block_cell(
    block: Block,
    *,
    flipped: bool = False,
    straight: int | None = None,
    lower: Mapping[int, bool] | None = None,
    long: bool = False,
) -> Cell:
    """Return the cell of a block, with pins ``out``, ``in0``, ``in1`` and so on.

    A flipped one is drawn from right to left. Of a sum, the input `straight` lies on its axis (the
    first of a round one and the middle of a long one where not given); `lower` says which inputs
    of a round one come from below, and `long` draws one of few inputs long all the same.
    """
    into, out = ("R", "L") if flipped else ("L", "R")
    width = shape_width(block)
    if block.kind == "sum":
        if long or not round_sum(block):
            height = _APART * (len(block.signs) - 1) + 2.0 * _END
            pins = {f"in{k}": Pin(into, _END + _APART * k) for k in range(len(block.signs))}
            axis = 0.5 * height if straight is None else pins[f"in{straight}"].y
            pins["out"] = Pin(out, axis)
            return Cell(width=width, height=height, axis=axis, pins=pins)
        pins = {"out": Pin(out, SUM_RADIUS)}
        for k in range(len(block.signs)):
            offset = _ROUND[k != (straight or 0)]
            if not (lower or {}).get(k, True):
                offset = -offset
            pins[f"in{k}"] = Pin(into, SUM_RADIUS + offset)
        return Cell(width=width, height=2.0 * SUM_RADIUS, axis=SUM_RADIUS, pins=pins)
    height, caption = {
        "integrator": (36.0, 0.0),
        "input": (26.0, 0.0),
        "output": (26.0, 0.0),
        "gain": (34.0, 0.0),
    }.get(block.kind, (42.0, _CAPTION))
    if caption:
        width = max(width, text_width(plain(block.label), SMALL))
    pins = {"out": Pin(out, 0.5 * height), "in0": Pin(into, 0.5 * height)}
    return Cell(width=width, height=height + caption, axis=0.5 * height, pins=pins)
