"""What the lines of a diagram carry: motion, rates, forces, or commands."""

from typing import Literal

from flexstage.export.diagram.graph import Block, Diagram

SignalKind = Literal["motion", "rate", "force", "other"]

_OF_UNIT: dict[str, SignalKind] = {"m": "motion", "m/s": "rate", "N": "force"}


def signal_kinds(diagram: Diagram) -> dict[str, SignalKind]:
    """Return what each block gives; commands, voltages and accelerations are ``other``."""
    feeds = {}
    for line in diagram.lines:
        if line.port == 0:
            feeds[line.target] = line.source
    blocks = {b.name: b for b in diagram.blocks}
    found: dict[str, SignalKind] = {}
    for name in blocks:
        path = [name]
        # a loop has an integrator in it, and an integrator says itself what it gives
        while (kind := _by_itself(blocks[path[-1]])) is None and path[-1] in feeds:
            path.append(feeds[path[-1]])
            if len(path) > len(blocks):
                break
        found[name] = kind or "other"
    return found


def _by_itself(block: Block) -> SignalKind | None:
    match block.kind:
        case "integrator":
            return _by_unit(block.meaning)
        case "input" | "amplifier":
            return "other" if block.kind == "amplifier" else _by_unit(block.meaning)
        case "hysteresis":
            return _by_unit(block.meaning)
        case "gain" if block.role in ("spring", "damper"):
            return "force"
        case "gain" if block.role == "mass":
            return "other"
        case "gain" if block.role == "drive":
            return "motion" if "displacement" in block.meaning else "force"
        case _:
            return None


def _by_unit(meaning: str) -> SignalKind:
    unit = meaning.rpartition("[")[2].rstrip("]").split(",")[0]
    return _OF_UNIT.get(unit, "other")
