"""Blocks and lines as Simulink has them: systems within systems, before they become a script."""

from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from itertools import pairwise
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import wiring_faults
from flexstage.files.names import free_name

#: Where each type of block comes from; these paths are those of every release since 2006.
LIBRARY: Mapping[str, str] = {
    "Inport": "simulink/Sources/In1",
    "Outport": "simulink/Sinks/Out1",
    "Gain": "simulink/Math Operations/Gain",
    "Sum": "simulink/Math Operations/Sum",
    "Constant": "simulink/Sources/Constant",
    "SineWave": "simulink/Sources/Sine Wave",
    "FromWorkspace": "simulink/Sources/From Workspace",
    "ToWorkspace": "simulink/Sinks/To Workspace",
    "Scope": "simulink/Sinks/Scope",
    "Integrator": "simulink/Continuous/Integrator",
    "TransferFcn": "simulink/Continuous/Transfer Fcn",
    "StateSpace": "simulink/Continuous/State-Space",
    "ZeroOrderHold": "simulink/Discrete/Zero-Order Hold",
    "Saturate": "simulink/Discontinuities/Saturation",
    "Quantizer": "simulink/Discontinuities/Quantizer",
    "Mux": "simulink/Signal Routing/Mux",
    "Demux": "simulink/Signal Routing/Demux",
    "MatlabFunction": "simulink/User-Defined Functions/MATLAB Function",
    "SubSystem": "built-in/Subsystem",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulinkLine:
    """A line between two blocks of one system."""

    source: str
    """Name of the block that it comes from."""
    target: str
    """Name of the block that it leads to."""
    output: int = 1
    """Output of the source, counted from 1."""
    port: int = 1
    """Input of the target, counted from 1."""
    signal: str = ""
    """What it carries; empty where the blocks say it."""


@dataclass(frozen=True, slots=True)
class Node:
    """A block."""

    name: str
    """Its name, unlike every other of its system."""
    kind: str
    """Its type, a key of `LIBRARY`."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Its parameters by name, as Simulink takes them."""
    meaning: str = ""
    """What it is, with its unit."""
    _: KW_ONLY
    label: str = ""
    """What is written below it."""
    inputs: int = 1
    """Number of its inputs."""
    outputs: int = 1
    """Number of its outputs."""
    inside: "System | None" = None
    """What a ``SubSystem`` holds."""
    function: str = ""
    """Of a ``MatlabFunction``: name of the function whose text it takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """Blocks and lines of one window."""

    title: str
    """What it holds."""
    nodes: tuple[Node, ...]
    """The blocks; ports first and last, in the order of their numbers."""
    wires: tuple[SimulinkLine, ...]
    """The lines."""
    notes: tuple[str, ...] = ()
    """What is written beside the blocks."""

    def ports(self, kind: str) -> tuple[str, ...]:
        """Return the names of the ``Inport`` or ``Outport`` blocks, by their numbers."""
        return tuple(n.name for n in self.nodes if n.kind == kind)


class Wiring:
    """Collects the blocks and lines of one system."""

    __slots__ = ("_nodes", "_wires", "title")

    def __init__(self, title: str) -> None:
        self.title = title
        self._nodes: dict[str, Node] = {}
        self._wires: list[SimulinkLine] = []

    def add(self, node: Node) -> str:
        """Add a block and return its name; a number is put behind one that is taken.

        An ``Inport`` or ``Outport`` gets its own number here.
        """
        name = free_name(node.name, self._nodes.__contains__)
        if node.kind in ("Inport", "Outport"):
            number = 1 + sum(n.kind == node.kind for n in self._nodes.values())
            node = replace(
                node,
                settings={"Port": str(number), **node.settings},
                inputs=int(node.kind == "Outport"),
                outputs=int(node.kind == "Inport"),
            )
        self._nodes[name] = replace(node, name=name)
        return name

    def block(self, name: str, kind: str, *described: Any, **more: Any) -> str:
        """Add the block that a `Node` of these describes, and return its name."""
        return self.add(Node(name, kind, *described, **more))

    def nest(self, name: str, inside: System, meaning: str = "") -> str:
        """Add a subsystem and return its name; it means what its title says, where not given."""
        return self.add(
            Node(
                name,
                "SubSystem",
                meaning=meaning or inside.title,
                inputs=len(inside.ports("Inport")),
                outputs=len(inside.ports("Outport")),
                inside=inside,
            )
        )

    def connect(
        self, source: str, target: str, *, output: int = 1, port: int = 1, signal: str = ""
    ) -> None:
        """Add a line; outputs and ports (inputs) are counted from 1."""
        self._wires.append(
            SimulinkLine(source=source, target=target, output=output, port=port, signal=signal)
        )

    def chain(self, *names: str) -> str:
        """Connect blocks one behind the other, first output to first input; return the last."""
        for source, target in pairwise(names):
            self.connect(source, target)
        return names[-1]

    def system(self, notes: Iterable[str] = ()) -> System:
        """Return the system."""
        ends = {name: (n.inputs, n.outputs) for name, n in self._nodes.items()}
        lines = [(w.source, w.output - 1, w.target, w.port - 1) for w in self._wires]
        for fault in wiring_faults(ends, lines):
            raise ModelError(fault)
        return System(
            title=self.title,
            nodes=tuple(self._nodes.values()),
            wires=tuple(self._wires),
            notes=tuple(notes),
        )
