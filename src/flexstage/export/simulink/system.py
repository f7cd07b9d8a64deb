"""Nested systems of Simulink blocks and lines, and the script that builds a model of them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from itertools import pairwise
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.simulink.matlab_text import comment, identifier, plain, quoted, wrapped
from flexstage.files.names import free_name

#: Library paths of block types, valid in every release since 2006.
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
    """Name of its source block."""
    target: str
    """Name of its target block."""
    output: int = 1
    """Output of the source, counted from 1."""
    port: int = 1
    """Input of the target, counted from 1."""
    signal: str = ""
    """Signal; empty where the blocks make it clear."""


@dataclass(frozen=True, slots=True)
class Node:
    """A block."""

    name: str
    """Name, unique in its system."""
    kind: str
    """Type, a key of `LIBRARY`."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Parameters of Simulink by name."""
    meaning: str = ""
    """Description with unit."""
    _: KW_ONLY
    label: str = ""
    """Caption below the block."""
    inputs: int = 1
    """Number of inputs."""
    outputs: int = 1
    """Number of outputs."""
    inside: "System | None" = None
    """Content of a ``SubSystem``."""
    function: str = ""
    """Name of the function of a ``MatlabFunction``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """Blocks and lines of one window."""

    title: str
    """Title."""
    nodes: tuple[Node, ...]
    """Blocks; ports first and last, in the order of their numbers."""
    wires: tuple[SimulinkLine, ...]
    """Lines."""
    notes: tuple[str, ...] = ()
    """Notes on the system."""

    def ports(self, kind: str) -> tuple[str, ...]:
        """Return the names of the ``Inport`` or ``Outport`` blocks, by their numbers."""
        return tuple(n.name for n in self.nodes if n.kind == kind)


def wiring_faults(
    ends: Mapping[str, tuple[int, int]], lines: Iterable[tuple[str, int, str, int]]
) -> Iterator[str]:
    """Yield faults of the lines between blocks: every input must have exactly one.

    `ends` has the numbers of inputs and outputs of blocks; lines are source, output, target and
    input, counted from 0.
    """
    connected: set[tuple[str, int]] = set()
    for source, output, target, port in lines:
        if source not in ends or target not in ends:
            yield f"a line joins '{source}' and '{target}', of which one does not exist"
        elif not 0 <= output < ends[source][1]:
            yield f"block '{source}' has no output {output}"
        elif not 0 <= port < ends[target][0] or (target, port) in connected:
            yield f"input {port} of block '{target}' does not exist or has another line"
        connected.add((target, port))
    for name, (inputs, _) in ends.items():
        for port in range(inputs):
            if (name, port) not in connected:
                yield f"input {port} of block '{name}' has no line"


class Wiring:
    """Builder of one system from blocks and lines."""

    __slots__ = ("_nodes", "_wires", "title")

    def __init__(self, title: str) -> None:
        self.title = title
        self._nodes: dict[str, Node] = {}
        self._wires: list[SimulinkLine] = []

    def add(self, node: Node) -> str:
        """Add a block and return its name, with a number if the name is taken.

        An ``Inport`` or ``Outport`` gets its port number.
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
        """Add a `Node` with these arguments, and return its name."""
        return self.add(Node(name, kind, *described, **more))

    def nest(self, name: str, inside: System, meaning: str = "") -> str:
        """Add a subsystem and return its name; its title is the default meaning."""
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
        """Connect blocks in series, first output to first input; return the last."""
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


_INDENT = "    "
_WIDTH = 96
#: Left, top, right and bottom [pixels].
Box = tuple[int, int, int, int]
_SIZES = {
    "Inport": (30, 14),
    "Outport": (30, 14),
    "Gain": (60, 40),
    "Integrator": (44, 40),
    "FromWorkspace": (150, 26),
    "ToWorkspace": (190, 26),
    "Scope": (36, 36),
    "StateSpace": (110, 50),
    "MatlabFunction": (120, 50),
    "TransferFcn": (90, 44),
    "Saturate": (44, 36),
    "Mux": (6, 44),
    "Demux": (6, 44),
}
_PITCH = 24  # between the ports of a block
_ACROSS, _DOWN, _MARGIN = 110, 46, 60  # space for lines, and for names below blocks
_MANY = 8  # with more subsystems a system is a network rather than a chain


def build_script(
    name: str, top: System, *, settings: Mapping[str, str], notes: tuple[str, ...]
) -> str:
    """Return the script: the function ``NAME_build``, which loads ``NAME_data.mat``.

    It has a local function for each subsystem. Settings are parameters of the model, such as those
    of its solver; notes become its description.
    """
    systems = list(_walk(top))
    # systems contain mappings and are not hashable: the key is their identity
    names = {
        id(system): f"fill_{i}_{identifier(system.title)[:36]}" if i else "fill_model"
        for i, system in enumerate(systems)
    }
    text = _head(name, top, notes) + _main(name, top, settings, notes)
    text += "".join(_fill(system, names) for system in systems)
    return text + _helpers(with_functions=_has_function(top))


def _walk(system: System) -> Iterator[System]:
    yield system
    for node in system.nodes:
        if node.inside is not None:
            yield from _walk(node.inside)


def _has_function(system: System) -> bool:
    return any(
        node.function or (node.inside is not None and _has_function(node.inside))
        for node in system.nodes
    )


def _arguments(system: System, at: str) -> str:
    return f"({at}, here)" if _has_function(system) else f"({at})"


def _head(name: str, top: System, notes: tuple[str, ...]) -> str:
    text = f"function {name}_build()\n"
    text += comment(f"{name.upper()}_BUILD Builds the Simulink model '{name}': {top.title}.")
    text += "%\n" + comment(
        f"Run it in the folder with {name}_data.mat and the functions of the hysteresis. It adds "
        "all blocks with add_block, add_line and set_param, which exist in every release of "
        "Simulink, loads the parameters into the workspace of the model, and saves the model in "
        "this folder. It needs no toolbox. README.txt describes its tests."
    )
    for note in notes:
        text += "%\n" + comment(note)
    text += "%\n" + comment(f"Written by flexstage {__version__}. SI units throughout.")
    return text + "\n"


def _main(name: str, top: System, settings: Mapping[str, str], notes: tuple[str, ...]) -> str:
    words = " ".join([f"{top.title}.", *notes, f"Written by flexstage {__version__}."])
    parameters = _pairs([(key, quoted(value)) for key, value in settings.items()], 2 * _INDENT)
    return f"""model = '{name}';
here = fileparts(mfilename('fullpath'));
data = fullfile(here, '{name}_data.mat');
if exist('new_system') == 0
    error('flexstage:simulink', 'Simulink is not installed: {name}_build needs it.');
end
if exist(data, 'file') ~= 2
    error('flexstage:data', ['{name}_data.mat is missing: put it into the folder of ' ...
        '{name}_build.m.']);
end
if bdIsLoaded(model)
    error('flexstage:open', ['A model named {name} is open: save it under another name, ' ...
        'close it with close_system(''{name}'', 0), then run {name}_build again.']);
end
load_system('simulink');
new_system(model);
try
    set_param(model, 'Description', ...
        {_long(words, 2 * _INDENT)});
    set_param(model, {parameters});
    fill_workspace(model, data);
    fill_model{_arguments(top, "model")};
catch problem
    % discard the incomplete model
    close_system(model, 0);
    rethrow(problem);
end
open_system(model);
if exist(fullfile(here, [model '.slx']), 'file') || exist(fullfile(here, [model '.mdl']), 'file')
    warning('flexstage:saved', ['{name} is built but not saved, since a file of this name ' ...
        'exists: save it under another name, or remove that file.']);
else
    save_system(model, fullfile(here, model));
end
end

function fill_workspace(model, data)
% Parameters of all blocks, in the workspace that is saved with the model.
numbers = load(data);
names = fieldnames(numbers);
space = get_param(model, 'ModelWorkspace');
for k = 1:numel(names)
    assignin(space, names{{k}}, numbers.(names{{k}}));
end
end
"""


def _fill(system: System, names: Mapping[int, str]) -> str:
    places = positions(system)
    text = f"\nfunction {names[id(system)]}{_arguments(system, 'at')}\n" + comment(system.title)
    for note in system.notes:
        text += comment(note)
    for node in system.nodes:
        text += _block(node, places[node.name])
        path = f"[at '/{node.name}']"
        if node.inside is not None:
            text += f"{names[id(node.inside)]}{_arguments(node.inside, path)};\n"
        if node.function:
            text += f"write_function({path}, fullfile(here, '{node.function}.m'));\n"
    labelled: set[tuple[str, int]] = set()
    for w in system.wires:
        signal = "" if (w.source, w.output) in labelled else w.signal
        labelled |= {(w.source, w.output)} if signal else set()
        ends = f"'{w.source}/{w.output}', '{w.target}/{w.port}'"
        text += f"wire(at, {ends}, {quoted(signal)});\n"
    return text + "end\n"


def _block(node: Node, place: Box) -> str:
    pairs = [("Position", "[" + " ".join(map(str, place)) + "]")]
    pairs += [(key, quoted(value)) for key, value in node.settings.items()]
    if node.meaning:
        pairs.append(("Description", quoted(node.meaning)))
    label = plain(node.label).replace("%", "").replace("\\", "")
    if label:
        pairs.append(("AttributesFormatString", quoted(label)))
    return f"add_block('{LIBRARY[node.kind]}', [at '/{node.name}'], {_pairs(pairs)});\n"


def _pairs(pairs: list[tuple[str, str]], indent: str = _INDENT) -> str:
    """Return names and values of parameters, each pair on its own line."""
    return f"...\n{indent}" + f", ...\n{indent}".join(f"'{k}', {v}" for k, v in pairs)


def _long(text: str, indent: str) -> str:
    """Return a long text as a string in pieces."""
    *pieces, last = wrapped(plain(text), _WIDTH - len(indent) - 7)
    strings = ["'" + s.replace("'", "''") + "'" for s in (*(f"{p} " for p in pieces), last)]
    return "[" + f" ...\n{indent}".join(strings) + "]"


def _helpers(*, with_functions: bool) -> str:
    text = """
function wire(at, from, to, signal)
% A line between two blocks, with the name of its signal.
line = add_line(at, from, to, 'autorouting', 'on');
if ~isempty(signal)
    set_param(line, 'Name', signal);
end
end
"""
    if with_functions:
        text += """
function write_function(block, file)
% The text of a MATLAB Function block.
if exist(file, 'file') ~= 2
    error('flexstage:function', '%s is missing: put it into the folder of the script.', file);
end
text = fileread(file);
try
    chart = find(sfroot, '-isa', 'Stateflow.EMChart', 'Path', block);
    chart.Script = text;
catch problem
    error('flexstage:script', ['The text of block %s cannot be set in this release (%s): ' ...
        'open the block, and paste the text of %s into it.'], block, problem.message, file);
end
end
"""
    return text


def positions(system: System) -> dict[str, Box]:
    """Return the positions of blocks, from left to right along the signals, without overlap."""
    nodes = {n.name: n for n in system.nodes}
    layer = _layers(system)
    columns: dict[int, list[str]] = {}
    for name in nodes:
        columns.setdefault(layer[name], []).append(name)
    before: dict[str, list[str]] = {name: [] for name in nodes}
    for w in system.wires:
        if layer[w.source] < layer[w.target]:
            before[w.target].append(w.source)
    boxes: dict[str, Box] = {}
    x = _MARGIN
    for at in sorted(columns):
        sizes = {name: _size(nodes[name]) for name in columns[at]}
        order = {name: i for i, name in enumerate(columns[at])}

        def height(name: str, order: dict[str, int] = order) -> tuple[float, int]:
            placed = [boxes[s] for s in before[name] if s in boxes]
            middle = sum(b[1] + b[3] for b in placed) / (2 * len(placed)) if placed else _MARGIN
            return (middle, order[name])

        free = _MARGIN
        for name in sorted(columns[at], key=height):
            wide, tall = sizes[name]
            top = max(free, round(height(name)[0] - tall / 2))
            boxes[name] = (x, top, x + wide, top + tall)
            free = top + tall + _DOWN
        x += max(wide for wide, _ in sizes.values()) + _ACROSS
    return boxes


def _size(node: Node) -> tuple[int, int]:
    ports = max(node.inputs, node.outputs)
    if node.kind == "Sum":
        return (28, 28) if ports <= 3 else (28, _PITCH * ports)
    if node.kind == "SubSystem":
        return (180, max(56, _PITCH * ports + 16))
    wide, tall = _SIZES.get(node.kind, (70, 40))
    return (wide, max(tall, _PITCH * ports if node.kind in ("Mux", "Demux") else 0))


def _layers(system: System) -> dict[str, int]:
    """Return the column of each block: its distance from the inputs."""
    after: dict[str, list[str]] = {n.name: [] for n in system.nodes}
    for w in system.wires:
        after[w.source].append(w.target)
    if sum(n.kind == "SubSystem" for n in system.nodes) > _MANY:
        layer = _shortest(system, after)
    else:
        back = _backward_lines(_starts(system), after)
        layer = _longest_paths(
            {s: [t for t in targets if (s, t) not in back] for s, targets in after.items()}
        )
    last = max((layer[n.name] for n in system.nodes if n.kind != "Outport"), default=0)
    layer |= {n.name: 0 for n in system.nodes if n.kind == "Inport"}
    layer |= {n.name: last + 1 for n in system.nodes if n.kind == "Outport"}
    return layer


def _backward_lines(names: Iterable[str], after: Mapping[str, list[str]]) -> set[tuple[str, str]]:
    """Return the lines that close a loop, by depth-first search from the first block."""
    finished: set[str] = set()
    back: set[tuple[str, str]] = set()
    for start in names:
        if start in finished:
            continue
        path = [(start, iter(after[start]))]
        on_path = {start}
        while path:
            name, targets = path[-1]
            step = next(targets, None)
            if step is None:
                path.pop()
                on_path.discard(name)
                finished.add(name)
            elif step in on_path:
                back.add((name, step))
            elif step not in finished:
                path.append((step, iter(after[step])))
                on_path.add(step)
    return back


def _longest_paths(forward: Mapping[str, list[str]]) -> dict[str, int]:
    """Return the length of the longest path to each block; lines have no loops."""
    lengths = dict.fromkeys(forward, 0)
    changed = True
    while changed:
        changed = False
        for name, targets in forward.items():
            for target in targets:
                if lengths[target] <= lengths[name]:
                    lengths[target] = lengths[name] + 1
                    changed = True
    return lengths


def _starts(system: System) -> list[str]:
    sources = [n.name for n in system.nodes if n.inputs == 0]
    return sources + [n.name for n in system.nodes if n.inputs > 0]


def _shortest(system: System, after: dict[str, list[str]]) -> dict[str, int]:
    layer: dict[str, int] = {}
    sources = [n.name for n in system.nodes if n.inputs == 0]
    for start in [*([sources] if sources else []), *([n] for n in _starts(system))]:
        front = [n for n in start if n not in layer]
        depth = 0
        while front:
            layer |= dict.fromkeys(front, depth)
            front = list(dict.fromkeys(t for s in front for t in after[s] if t not in layer))
            depth += 1
    return layer
