"""Write a diagram down block by block."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

from flexstage.errors import ModelError
from flexstage.export.diagram.graph import Block, BlockGroup, BlockKind, Diagram, SignalLine
from flexstage.system.mechanical import Array

# MATLAB cuts names after 63 characters; some room is left for what is put before or after one
_LONGEST = 48


def identifier(text: str) -> str:
    """Return a text as the name of a block: a letter, then letters, digits and underscores.

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
    """Collects blocks, lines and groups; names are made unlike each other."""

    __slots__ = ("_blocks", "_groups", "_late", "_lines", "_names", "_terms", "_units")

    def __init__(self) -> None:
        self._blocks: list[Block] = []
        self._lines: list[SignalLine] = []
        self._groups: list[BlockGroup] = []
        self._names: set[str] = set()
        self._terms: dict[str, list[tuple[str, int, str]]] = {}
        self._late: dict[str, list[tuple[str, int, str]]] = {}
        self._units: dict[str, str] = {}

    def group(self, wanted: str, **described: Any) -> str:
        """Add a group and return its name, changed where it is no identifier, or taken."""
        name = self._free(wanted)
        self._groups.append(BlockGroup(name=name, **described))
        return name

    def add(self, wanted: str, kind: BlockKind, label: str, meaning: str, **described: Any) -> str:
        """Add a block and return its name, changed where it is no identifier, or taken.

        Inputs and outputs take a ``unit`` besides.
        """
        name = self._free(wanted)
        if "unit" in described:
            self._units[name] = described.pop("unit")
        self._blocks.append(Block(name=name, kind=kind, label=label, meaning=meaning, **described))
        return name

    def connect(self, source: str, target: str, signal: str = "", *, port: int = 0) -> None:
        """Add a line from one block to an input of another."""
        self._lines.append(SignalLine(source=source, target=target, port=port, signal=signal))

    def matrix(self, name: str) -> Array:
        """Return the matrix of a gain."""
        for block in self._blocks:
            if block.name == name and block.matrix is not None:
                return block.matrix
        raise ModelError(f"there is no gain '{name}' yet")

    def chain(self, *names: str) -> str:
        """Connect blocks one behind the other and return the last."""
        for source, target in pairwise(names):
            self.connect(source, target)
        return names[-1]

    def term(
        self, total: str, source: str, sign: int, signal: str = "", *, last: bool = False
    ) -> None:
        """Lead a block, times 1 or -1, to a sum that was added without signs.

        A last one comes behind all others, as the feedbacks of a body do.
        """
        held = self._late if last else self._terms
        held.setdefault(total, []).append((source, sign, signal))

    def diagram(self, title: str, notes: tuple[str, ...]) -> Diagram:
        """Return the diagram."""
        blocks, lines = [], list(self._lines)
        for block in self._blocks:
            made = block
            if block.kind == "sum":
                terms = self._terms.get(block.name, []) + self._late.get(block.name, [])
                if not terms:
                    raise ModelError(f"nothing is added in '{block.name}': {block.meaning}")
                made = replace(block, signs=tuple(sign for _, sign, _ in terms))
                lines += [
                    SignalLine(source=source, target=block.name, port=port, signal=signal)
                    for port, (source, _, signal) in enumerate(terms)
                ]
            blocks.append(made)
        return Diagram(
            title=title,
            blocks=tuple(blocks),
            lines=tuple(lines),
            groups=tuple(self._groups),
            notes=notes,
            units=self._units,
        )

    def _free(self, wanted: str) -> str:
        name = base = identifier(wanted)
        count = 1
        while name in self._names:
            count += 1
            name = f"{base}_{count}"
        self._names.add(name)
        return name
