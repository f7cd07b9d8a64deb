"""The equations that a diagram holds, by walking along its lines."""

from typing import Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import Block, Diagram
from flexstage.system import StateSpace

_NONLINEAR = ("hysteresis", "amplifier", "creep", "sensor")


def diagram_state_space(
    diagram: Diagram, *, nonlinear: Literal["refuse", "pass", "cut"] = "refuse"
) -> StateSpace:
    """Return the linear equations that a diagram holds; states are those of its integrators.

    Inputs and outputs have the names of their blocks, one entry for each signal.

    Hysteresis, amplifiers, creep and sensors are refused (``refuse``), let their input through
    (``pass``), or are where the diagram is ``cut``: the output of the last of them is an input.

    Examples
    --------
    >>> import numpy as np
    >>> from flexstage.export.diagram.graph import Block, Diagram, SignalLine
    >>> blocks = (
    ...     Block(name="u", kind="input", label="u", meaning="force [N]"),
    ...     Block(name="a", kind="sum", label="+", meaning="sum", signs=(1, -1)),
    ...     Block(name="i", kind="integrator", label="1/s", meaning="rate"),
    ...     Block(name="k", kind="gain", label="k", meaning="gain", matrix=np.array([[3.0]])),
    ...     Block(name="y", kind="output", label="y", meaning="reading"),
    ... )
    >>> pairs = (("u", "a", 0), ("k", "a", 1), ("a", "i", 0), ("i", "k", 0), ("i", "y", 0))
    >>> lines = tuple(SignalLine(source=s, target=t, port=p) for s, t, p in pairs)
    >>> diagram_state_space(Diagram(title="lag", blocks=blocks, lines=lines)).A
    array([[-3.]])
    """
    if nonlinear == "refuse":
        for b in diagram.blocks:
            if b.kind in _NONLINEAR:
                raise ModelError(
                    f"block '{b.name}' is no linear one but a {b.kind}: let it pass, or cut there"
                )
    walk = _Walk(diagram, cut=nonlinear == "cut")
    integrators = [b for b in diagram.blocks if b.kind == "integrator"]
    outputs = [b for b in diagram.blocks if b.kind == "output"]
    n = walk.state_count
    derivative = np.vstack([np.zeros((0, walk.size)), *(walk.into(b) for b in integrators)])
    reading = np.vstack([np.zeros((0, walk.size)), *(walk.into(b) for b in outputs)])
    return StateSpace(
        A=derivative[:, :n],
        B=derivative[:, n:],
        C=reading[:, :n],
        D=reading[:, n:],
        inputs=_each(walk.sources),
        outputs=_each(outputs),
    )


def _each(blocks: list[Block]) -> tuple[str, ...]:
    return tuple(b.name for b in blocks for _ in range(b.width))


class _Walk:
    """Finds the output of each block as rows over the states and inputs."""

    def __init__(self, diagram: Diagram, *, cut: bool) -> None:
        self._blocks = {b.name: b for b in diagram.blocks}
        self._feeds: dict[str, dict[int, str]] = {}
        for line in diagram.lines:
            self._feeds.setdefault(line.target, {})[line.port] = line.source
        readers: dict[str, list[str]] = {}
        for line in diagram.lines:
            readers.setdefault(line.source, []).append(line.target)
        self.sources = [
            b
            for b in diagram.blocks
            if (b.kind == "input" and not (cut and self._only_nonlinear(b, readers)))
            or (cut and self._last_nonlinear(b, readers))
        ]
        own = [b for b in diagram.blocks if b.kind == "integrator"]
        self.state_count = sum(b.width for b in own)
        self.size = self.state_count + sum(b.width for b in self.sources)
        self._known: dict[str, Array] = {}
        first = 0
        for b in (*own, *self.sources):
            rows = np.zeros((b.width, self.size))
            rows[:, first : first + b.width] = np.eye(b.width)
            self._known[b.name] = rows
            first += b.width
        self._order()

    def _only_nonlinear(self, block: Block, readers: dict[str, list[str]]) -> bool:
        """Whether an input leads to blocks that are not linear only, behind which is the cut."""
        to = readers.get(block.name, [])
        return bool(to) and all(self._blocks[t].kind in _NONLINEAR[:3] for t in to)

    def _last_nonlinear(self, block: Block, readers: dict[str, list[str]]) -> bool:
        # a sensor lets its input pass: its lag and offset belong to the reading, not to the stage
        return block.kind in _NONLINEAR[:3] and not self._only_nonlinear(block, readers)

    def _order(self) -> None:
        """Fill in all blocks, each after those that feed it."""
        for start in self._blocks:
            path, on_path = [start], {start}
            while path:
                name = path[-1]
                block = self._blocks[name]
                if name in self._known or block.kind == "output":
                    on_path.discard(path.pop())
                    continue
                fed = self._feeds.get(name, {}).values()
                missing = next((s for s in fed if s not in self._known), None)
                if missing is None:
                    self._known[name] = self._value(block)
                elif missing in on_path:
                    raise ModelError(
                        f"the lines through '{missing}' form a loop without an integrator"
                    )
                else:
                    path.append(missing)
                    on_path.add(missing)

    def _value(self, block: Block) -> Array:
        if block.kind == "input":
            # behind the cut: nobody asks for it
            return np.zeros((block.width, self.size))
        if block.kind == "sum":
            feeds = self._feeds[block.name]
            return sum(
                (sign * self._known[feeds[port]] for port, sign in enumerate(block.signs)),
                start=np.zeros((block.width, self.size)),
            )
        rows = self._known[self._feeds[block.name][0]]
        if block.kind == "gain":
            assert block.matrix is not None
            return block.matrix @ rows
        return rows

    def into(self, block: Block) -> Array:
        """Return what flows into a block, as rows over the states and inputs."""
        return self._known[self._feeds[block.name][0]]
