"""A stage as systems of Simulink: its structural diagram, and its modes.

Each group of the diagram is a subsystem; the modes are drive chains and one State-Space block.
"""

import numpy as np

from flexstage.export.control_object import linear_part
from flexstage.export.diagram.graph import Block, Diagram
from flexstage.export.simulink import chains
from flexstage.export.simulink.chains import Functions
from flexstage.export.simulink.matlab_text import Variables, identifiers, literal
from flexstage.export.simulink.system import Node, System, Wiring
from flexstage.hysteresis import Amplifier, Creep, HysteresisModel, Sensor
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive

_ROUND = 3  # largest number of inputs of a round sum


def structure(
    diagram: Diagram, variables: Variables, functions: Functions, sample_time: str
) -> System:
    """Return a structural diagram as a system of Simulink.

    Every gain, sum and integrator of the diagram becomes the block of its name and kind. Each group
    becomes a subsystem, whose ports have the names of their source blocks. Inports and outports are
    the inputs and outputs of the diagram, in order.
    """
    top = Wiring(diagram.title)
    inner = {g.name: Wiring(g.title) for g in diagram.groups}
    places = _Places(diagram, top, inner)
    for block in diagram.blocks:
        if block.kind == "input":
            places.put(block, _port(block, "Inport", {"PortDimensions": str(block.width)}))
    for block in diagram.blocks:
        if block.kind not in ("input", "output"):
            places.put(block, _node(block, variables, functions, sample_time))
    for block in diagram.blocks:
        if block.kind == "output":
            places.put(block, _port(block, "Outport", {}))
    places.wire()
    return top.system(diagram.notes)


class _Places:
    """Placement of blocks in the systems of their groups, with lines through their ports."""

    def __init__(self, diagram: Diagram, top: Wiring, inner: dict[str, Wiring]) -> None:
        self._diagram, self._top, self._inner = diagram, top, inner
        self._blocks = {b.name: b for b in diagram.blocks}
        self._names: dict[str, str] = {}
        # by group: blocks whose output leaves it, and blocks whose output enters it
        self._outgoing: dict[str, list[str]] = {g: [] for g in inner}
        self._incoming: dict[str, list[str]] = {g: [] for g in inner}
        self._signals: dict[str, str] = {}
        for line in diagram.lines:
            if line.signal:
                self._signals.setdefault(line.source, line.signal)
            source_group, target_group = self._group(line.source), self._group(line.target)
            if source_group != target_group:
                if source_group and line.source not in self._outgoing[source_group]:
                    self._outgoing[source_group].append(line.source)
                if target_group and line.source not in self._incoming[target_group]:
                    self._incoming[target_group].append(line.source)

    def _group(self, name: str) -> str:
        # inputs and outputs are ports of the top level
        block = self._blocks[name]
        return "" if block.kind in ("input", "output") else block.group

    def put(self, block: Block, node: Node) -> None:
        group = self._group(block.name)
        where = self._inner[group] if group else self._top
        if isinstance(node.inside, System):
            self._names[block.name] = where.nest(node.name, node.inside, node.meaning)
        else:
            self._names[block.name] = where.add(node)

    def wire(self) -> None:
        ports: dict[tuple[str, str], str] = {}
        for group, w in self._inner.items():
            for source in self._incoming[group]:
                width = self._blocks[source].width
                ports[group, source] = w.block(
                    source, "Inport", {"PortDimensions": str(width)}, self._blocks[source].meaning
                )
            for source in self._outgoing[group]:
                out = w.block(f"{source}_out", "Outport", meaning=self._blocks[source].meaning)
                w.connect(self._names[source], out, signal=self._signals.get(source, ""))
        for line in self._diagram.lines:
            group = self._group(line.target)
            w = self._inner[group] if group else self._top
            if self._group(line.source) == group:
                source = self._names[line.source]
            elif group:
                source = ports[group, line.source]
            else:
                continue
            signal = self._signals.get(line.source, "")
            w.connect(source, self._names[line.target], port=line.port + 1, signal=signal)
        self._wire_groups()

    def _wire_groups(self) -> None:
        """Add the lines between groups, and to the outputs of the top level."""
        titles = {g.name: g for g in self._diagram.groups}
        nested = {
            group: self._top.nest(group, w.system(), titles[group].title)
            for group, w in self._inner.items()
            if any(self._group(b.name) == group for b in self._diagram.blocks)
        }

        def at_top(source: str) -> tuple[str, int]:
            group = self._group(source)
            if not group:
                return self._names[source], 1
            return nested[group], 1 + self._outgoing[group].index(source)

        for group, name in nested.items():
            for port, source in enumerate(self._incoming[group], 1):
                at, output = at_top(source)
                signal = self._signals.get(source, "")
                self._top.connect(at, name, output=output, port=port, signal=signal)
        for line in self._diagram.lines:
            if not self._group(line.target) and self._group(line.source):
                at, output = at_top(line.source)
                self._top.connect(
                    at,
                    self._names[line.target],
                    output=output,
                    port=line.port + 1,
                    signal=self._signals.get(line.source, ""),
                )


def _port(block: Block, kind: str, settings: dict[str, str]) -> Node:
    return Node(block.name, kind, settings, block.meaning, label=block.label)


def _node(block: Block, variables: Variables, functions: Functions, sample_time: str) -> Node:
    if block.kind == "gain":
        variable = variables.add(block.name, block.matrix, block.meaning)  # type: ignore[arg-type]
        return chains.gain(block.name, variable, block.meaning, block.label)
    if block.kind == "integrator":
        return Node(
            block.name,
            "Integrator",
            {"InitialCondition": f"zeros({block.width}, 1)"},
            block.meaning,
        )
    if block.kind == "sum":
        return _sum(block)
    inside = _element(block, variables, functions, sample_time)
    return Node(block.name, "SubSystem", inside=inside, meaning=block.meaning)


def _sum(block: Block) -> Node:
    if not block.signs:
        value = literal(np.zeros((block.width, 1)))
        return Node(block.name, "Constant", {"Value": value}, block.meaning, inputs=0)
    if len(block.signs) == 1:
        # a Sum with one input would add up its elements
        settings = {"Gain": literal(block.signs[0]), "Multiplication": "Element-wise(K.*u)"}
        return Node(block.name, "Gain", settings, block.meaning)
    return Node(
        block.name,
        "Sum",
        {
            "Inputs": "".join("+" if s > 0 else "-" for s in block.signs),
            "IconShape": "round" if len(block.signs) <= _ROUND else "rectangular",
        },
        block.meaning,
        inputs=len(block.signs),
    )


def _element(block: Block, variables: Variables, functions: Functions, sample_time: str) -> System:
    model = block.model
    if isinstance(model, Amplifier):
        return chains.amplifier(model, block.name, variables)
    if isinstance(model, Creep):
        return chains.creep(model, block.name, variables)
    if isinstance(model, Sensor):
        return chains.sensor(model, block.name, variables)
    assert isinstance(model, HysteresisModel)
    return chains.hysteresis(functions.add(model, block.name), sample_time, block.meaning)


def modal(
    model: DynamicModel, variables: Variables, functions: Functions, sample_time: str
) -> System:
    """Return the modes of a stage after the chains of its drives.

    The State-Space block is `flexstage.export.control_object.linear_part`: modes with individual
    damping ratios, and the lags of creep. Inports are the drives and outports the probes, in the
    order of the model.
    """
    form = linear_part(model)
    w = Wiring(f"{model.name}: modes with individual damping")
    names = {
        letter: variables.add(f"modes_{letter}", matrix, meaning)
        for letter, matrix, meaning in (
            ("A", form.A, "state matrix: deflections and rates of the modes, lags of creep"),
            ("B", form.B, "input matrix: free displacements of the drives [m], or forces [N]"),
            ("C", form.C, "output matrix: motion of the probes"),
            ("D", form.D, "feedthrough to the probes"),
        )
    }
    count = len(model.drives)
    w.block(
        "modes", "StateSpace", names, f"{model.omega.size} modes: x' = A x + B w, y = C x + D w"
    )
    inports = identifiers([d.name for d in model.drives], longest=40)
    for drive in model.drives:
        w.block(
            f"command_{inports[drive.name]}",
            "Inport",
            {"PortDimensions": "1"},
            f"command of drive {drive.name} [{drive.unit}]",
        )
    ends = [_chain(w, d, inports[d.name], variables, functions, sample_time) for d in model.drives]
    if count == 1:
        w.chain(ends[0], "modes")
    else:
        w.block(
            "w",
            "Mux",
            {"Inputs": str(count)},
            "free displacements [m], or forces [N]",
            inputs=count,
        )
        for port, end in enumerate(ends, 1):
            w.connect(end, "w", port=port)
        w.chain("w", "modes")
    _read(w, model, variables)
    return w.system(model.notes)


def _chain(
    w: Wiring,
    drive: ModelDrive,
    name: str,
    variables: Variables,
    functions: Functions,
    sample_time: str,
) -> str:
    """Add the chain between the command of a drive and its free displacement."""
    at = f"command_{name}"
    what = "force" if drive.stiffness == 0.0 else "free displacement"
    unit = "N" if drive.stiffness == 0.0 else "m"
    if drive.amplifier is not None:
        inside = chains.amplifier(drive.amplifier, f"modes_{name}_amplifier", variables)
        at = w.chain(at, w.nest(f"amplifier_{name}", inside))
    if drive.hysteresis is not None:
        meaning = f"{drive.hysteresis.kind} of drive {drive.name}, from voltage [V] to {what}"
        inside = chains.hysteresis(functions.add(drive.hysteresis, name), sample_time, meaning)
        return w.chain(at, w.nest(f"hysteresis_{name}", inside))
    meaning = f"{what} over command of drive {drive.name} [{unit}/{drive.unit}]"
    gain = variables.add(f"modes_{name}_gain", drive.gain, meaning)
    return w.chain(at, w.add(chains.gain(f"gain_{name}", gain, meaning)))


def _read(w: Wiring, model: DynamicModel, variables: Variables) -> None:
    """Connect the outputs through sensors to outports."""
    count = len(model.probes)
    names = identifiers([p.name for p in model.probes], longest=40)
    at = "modes"
    if count > 1:
        at = w.block("y", "Demux", {"Outputs": str(count)}, "motion of the probes", outputs=count)
        w.chain("modes", at)
    for output, probe in enumerate(model.probes, 1):
        source, port = at, output
        if probe.sensor is not None:
            name = names[probe.name]
            inside = chains.sensor(probe.sensor, f"modes_{name}_sensor", variables)
            source = w.nest(f"sensor_{name}", inside)
            w.connect(at, source, output=output)
            port = 1
        meaning = f"reading of probe {probe.name} [{probe.unit}]"
        out = w.block(f"reading_{names[probe.name]}", "Outport", meaning=meaning)
        w.connect(source, out, output=port)
