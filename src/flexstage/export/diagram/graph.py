"""A diagram as data: blocks, lines and groups, its builder, and its equations."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.files.names import free_name
from flexstage.hysteresis import Amplifier, Creep, HysteresisModel, Sensor
from flexstage.system import StateSpace

# MATLAB truncates names after 63 characters; prefixes and suffixes need some of them
_LONGEST = 48
#: Kinds of blocks. Signals are columns of numbers.
#: ``input``, ``output``: ends of the diagram. ``gain``: matrix times input. ``sum``: signed sum of
#: the inputs. ``integrator``: integral over time, initially zero. ``hysteresis``, ``amplifier``,
#: ``creep``, ``sensor``: the model in `model`.
BlockKind = Literal[
    "input",
    "output",
    "gain",
    "sum",
    "integrator",
    "hysteresis",
    "amplifier",
    "creep",
    "sensor",
]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """A block of a diagram, with one output unless it is an ``output``."""

    name: str
    """Unique name: letters, digits and underscores, beginning with a letter."""
    kind: BlockKind
    """Kind."""
    label: str
    """Symbol in the block: ``1/m``, ``k``, ``d``."""
    meaning: str
    """Description with unit: ``stiffness of hinge P1 [N/m, N, N m/rad]``."""
    group: str = ""
    """Name of its group; empty for none."""
    width: int = 1
    """Number of signals at its output (at its input, for ``output``)."""
    matrix: Array | None = None
    """Matrix of a ``gain``, shape (width, width of its input)."""
    signs: tuple[int, ...] = ()
    """Signs of a ``sum``: 1 or -1 for each input."""
    model: HysteresisModel | Amplifier | Creep | Sensor | None = None
    """Model of a ``hysteresis``, ``amplifier``, ``creep`` or ``sensor``."""
    role: str = ""
    """Role in the drawing: ``spring``, ``damper``, ``mass``, ``geometry``, ``drive`` or empty."""

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        if self.kind == "sum":
            return len(self.signs)
        return 0 if self.kind == "input" else 1


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalLine:
    """A line from the output of one block to an input of another."""

    source: str
    """Name of its source block."""
    target: str
    """Name of its target block."""
    port: int = 0
    """Input of the target, counted from 0."""
    signal: str = ""
    """Signal with unit: ``q_P1 [m, m, rad]``; empty where the blocks make it clear."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockGroup:
    """Blocks that are drawn together, such as those of one body."""

    name: str
    """Name, as in `Block.group`."""
    title: str
    """Title."""
    kind: str
    """``body``, ``hinge``, ``drive``, ``probe`` or ``modes``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagram:
    """A structural diagram."""

    title: str
    """Title."""
    blocks: tuple[Block, ...]
    """The blocks."""
    lines: tuple[SignalLine, ...]
    """The lines; every input has exactly one."""
    groups: tuple[BlockGroup, ...] = ()
    """The groups."""
    notes: tuple[str, ...] = ()
    """Simplifications, as sentences."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each ``input`` and ``output`` block, by its name."""

    def block(self, name: str) -> Block:
        """Return a block by name."""
        for b in self.blocks:
            if b.name == name:
                return b
        raise ModelError(f"the diagram has no block '{name}'")


SignalKind = Literal["motion", "rate", "force", "other"]
_OF_UNIT: dict[str, SignalKind] = {"m": "motion", "m/s": "rate", "N": "force"}


def signal_kinds(diagram: Diagram) -> dict[str, SignalKind]:
    """Return the kind of output of each block; commands, voltages, accelerations are ``other``."""
    feeds = {}
    for line in diagram.lines:
        if line.port == 0:
            feeds[line.target] = line.source
    blocks = {b.name: b for b in diagram.blocks}
    kinds: dict[str, SignalKind] = {}
    for name in blocks:
        path = [name]
        # a loop has an integrator, whose unit determines its kind
        while (kind := _kind_by_block(blocks[path[-1]])) is None and path[-1] in feeds:
            path.append(feeds[path[-1]])
            if len(path) > len(blocks):
                break
        kinds[name] = kind or "other"
    return kinds


def _kind_by_block(block: Block) -> SignalKind | None:
    match block.kind:
        case "integrator" | "input" | "hysteresis":
            unit = block.meaning.rpartition("[")[2].rstrip("]").split(",")[0]
            return _OF_UNIT.get(unit, "other")
        case "amplifier":
            return "other"
        case "gain" if block.role in ("spring", "damper"):
            return "force"
        case "gain" if block.role == "mass":
            return "other"
        case "gain" if block.role == "drive":
            return "motion" if "displacement" in block.meaning else "force"
        case _:
            return None


def identifier(text: str) -> str:
    """Return a valid name of a block for a text: a letter, then letters, digits and underscores.

    Examples
    --------
    >>> identifier("left-leg 2"), identifier("3rd")
    ('left_leg_2', 'n3rd')
    """
    letters = "".join(c if c.isascii() and c.isalnum() else "_" for c in text).strip("_")
    if not letters or not letters[0].isalpha():
        letters = f"n{letters}"
    return letters[:_LONGEST]


class DiagramBuilder:
    """Builder of a diagram from blocks, lines and groups with unique names."""

    __slots__ = ("_blocks", "_groups", "_last_terms", "_lines", "_names", "_terms", "_units")

    def __init__(self) -> None:
        self._blocks: list[Block] = []
        self._lines: list[SignalLine] = []
        self._groups: list[BlockGroup] = []
        self._names: set[str] = set()
        self._terms: dict[str, list[tuple[str, int, str]]] = {}
        self._last_terms: dict[str, list[tuple[str, int, str]]] = {}
        self._units: dict[str, str] = {}

    def group(self, base: str, **described: Any) -> "GroupBuilder":
        """Add a group; its name is changed if it is not an identifier, or taken."""
        name = self._free(base)
        self._groups.append(BlockGroup(name=name, **described))
        return GroupBuilder(self, name)

    def add(self, base: str, kind: BlockKind, label: str, meaning: str, **described: Any) -> str:
        """Add a block and return its name, changed if it is not an identifier, or taken.

        Inputs and outputs also have a ``unit``.
        """
        name = self._free(base)
        if "unit" in described:
            self._units[name] = described.pop("unit")
        self._blocks.append(Block(name=name, kind=kind, label=label, meaning=meaning, **described))
        return name

    def connect(self, source: str, target: str, signal: str = "", *, port: int = 0) -> None:
        """Add a line from one block to an input of another."""
        self._lines.append(SignalLine(source=source, target=target, port=port, signal=signal))

    def chain(self, *names: str) -> str:
        """Connect blocks in series and return the last."""
        for source, target in pairwise(names):
            self.connect(source, target)
        return names[-1]

    def term(
        self, total: str, source: str, sign: int, signal: str = "", *, last: bool = False
    ) -> None:
        """Add a block, times 1 or -1, to a sum.

        A last term follows all others, like the feedbacks of a body.
        """
        terms = self._last_terms if last else self._terms
        terms.setdefault(total, []).append((source, sign, signal))

    def diagram(self, title: str, notes: tuple[str, ...]) -> Diagram:
        """Return the diagram."""
        blocks, lines = [], list(self._lines)
        for block in self._blocks:
            complete = block
            if block.kind == "sum":
                terms = self._terms.get(block.name, []) + self._last_terms.get(block.name, [])
                if not terms:
                    raise ModelError(f"sum '{block.name}' has no terms: {block.meaning}")
                complete = replace(block, signs=tuple(sign for _, sign, _ in terms))
                lines += [
                    SignalLine(source=source, target=block.name, port=port, signal=signal)
                    for port, (source, _, signal) in enumerate(terms)
                ]
            blocks.append(complete)
        return Diagram(
            title=title,
            blocks=tuple(blocks),
            lines=tuple(lines),
            groups=tuple(self._groups),
            notes=notes,
            units=self._units,
        )

    def _free(self, base: str) -> str:
        name = free_name(identifier(base), self._names.__contains__)
        self._names.add(name)
        return name


class GroupBuilder:
    """Builder of one group: names of its blocks begin with its name."""

    __slots__ = ("_builder", "name")

    def __init__(self, builder: DiagramBuilder, name: str) -> None:
        self._builder = builder
        self.name = name

    def add(self, what: str, kind: BlockKind, label: str, meaning: str, **described: Any) -> str:
        """Add a block and return its name."""
        base = f"{self.name}_{what}"
        return self._builder.add(base, kind, label, meaning, group=self.name, **described)

    def sum(self, what: str, meaning: str, width: int = 1) -> str:
        """Add a sum, whose terms follow by `DiagramBuilder.term`, and return its name."""
        return self.add(what, "sum", "+", meaning, width=width)

    def integrator(self, what: str, meaning: str, width: int = 1) -> str:
        """Add an integrator and return its name."""
        return self.add(what, "integrator", "1/s", meaning, width=width)

    def gain(self, what: str, label: str, meaning: str, matrix: ArrayLike, role: str = "") -> str:
        """Add a gain, a matrix or a number, and return its name."""
        factors = np.atleast_2d(np.asarray(matrix, dtype=np.float64))
        return self.add(
            what, "gain", label, meaning, width=factors.shape[0], matrix=factors, role=role
        )


def diagram_state_space(diagram: Diagram) -> StateSpace:
    """Return the state space of a diagram; states are those of its integrators.

    Inputs and outputs have the names of their blocks, one entry for each signal. Hysteresis,
    amplifiers, creep and sensors are replaced by 1.

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
    blocks = {b.name: b for b in diagram.blocks}
    sources: dict[str, dict[int, str]] = {name: {} for name in blocks}
    for line in diagram.lines:
        sources[line.target][line.port] = line.source
    integrators, inputs, outputs = (
        [b for b in diagram.blocks if b.kind == kind] for kind in ("integrator", "input", "output")
    )
    states = sum(b.width for b in integrators)
    unit = np.eye(states + sum(b.width for b in inputs))
    # the signals of each block as rows over the states and inputs
    rows: dict[str, Array] = {}
    first = 0
    for b in (*integrators, *inputs):
        rows[b.name] = unit[first : first + b.width]
        first += b.width
    order = TopologicalSorter({n: s.values() for n, s in sources.items() if n not in rows})
    try:
        for name in order.static_order():
            if name not in rows:
                fed = [rows[source] for _, source in sorted(sources[name].items())]
                rows[name] = _output(blocks[name], fed)
    except CycleError as error:
        raise ModelError(
            f"the lines through '{error.args[1][0]}' form a loop without an integrator"
        ) from error
    derivative = np.vstack([unit[:0], *(rows[sources[b.name][0]] for b in integrators)])
    reading = np.vstack([unit[:0], *(rows[b.name] for b in outputs)])
    return StateSpace(
        A=derivative[:, :states],
        B=derivative[:, states:],
        C=reading[:, :states],
        D=reading[:, states:],
        inputs=_each(inputs),
        outputs=_each(outputs),
    )


def _each(blocks: list[Block]) -> tuple[str, ...]:
    return tuple(b.name for b in blocks for _ in range(b.width))


def _output(block: Block, fed: list[Array]) -> Array:
    if block.kind == "sum":
        return np.sum([sign * x for sign, x in zip(block.signs, fed, strict=True)], axis=0)
    return fed[0] if block.matrix is None else block.matrix @ fed[0]
