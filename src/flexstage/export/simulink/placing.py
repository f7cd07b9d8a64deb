"""Where the blocks of a system stand in its window."""

from flexstage.export.simulink.system import Node, System

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
_ACROSS, _DOWN, _MARGIN = 110, 46, 60  # room for lines, and for names below blocks
_MANY = 8  # subsystems from which a system is a web rather than a chain


def positions(system: System) -> dict[str, Box]:
    """Return where blocks stand, from left to right as signals go; no two overlap."""
    nodes = {n.name: n for n in system.nodes}
    layer = _layers(system)
    columns: dict[int, list[str]] = {}
    for name in nodes:
        columns.setdefault(layer[name], []).append(name)
    before: dict[str, list[str]] = {name: [] for name in nodes}
    for w in system.wires:
        if layer[w.source] < layer[w.target]:
            before[w.target].append(w.source)
    made: dict[str, Box] = {}
    x = _MARGIN
    for at in sorted(columns):
        sizes = {name: _size(nodes[name]) for name in columns[at]}
        order = {name: i for i, name in enumerate(columns[at])}

        def height(name: str, order: dict[str, int] = order) -> tuple[float, int]:
            seen = [made[s] for s in before[name] if s in made]
            middle = sum(b[1] + b[3] for b in seen) / (2 * len(seen)) if seen else _MARGIN
            return (middle, order[name])

        free = _MARGIN
        for name in sorted(columns[at], key=height):
            wide, tall = sizes[name]
            top = max(free, round(height(name)[0] - tall / 2))
            made[name] = (x, top, x + wide, top + tall)
            free = top + tall + _DOWN
        x += max(wide for wide, _ in sizes.values()) + _ACROSS
    return made


def _size(node: Node) -> tuple[int, int]:
    ports = max(node.inputs, node.outputs)
    if node.kind == "Sum":
        return (28, 28) if ports <= 3 else (28, _PITCH * ports)
    if node.kind == "SubSystem":
        return (180, max(56, _PITCH * ports + 16))
    wide, tall = _SIZES.get(node.kind, (70, 40))
    return (wide, max(tall, _PITCH * ports if node.kind in ("Mux", "Demux") else 0))


def _layers(system: System) -> dict[str, int]:
    """Return the column of each block: how far it is from the inputs."""
    after: dict[str, list[str]] = {n.name: [] for n in system.nodes}
    for w in system.wires:
        after[w.source].append(w.target)
    if sum(n.kind == "SubSystem" for n in system.nodes) > _MANY:
        layer = _shortest(system, after)
    else:
        layer = _longest(system, after)
    last = max((layer[n.name] for n in system.nodes if n.kind != "Outport"), default=0)
    layer |= {n.name: 0 for n in system.nodes if n.kind == "Inport"}
    layer |= {n.name: last + 1 for n in system.nodes if n.kind == "Outport"}
    return layer


def _starts(system: System) -> list[str]:
    named = [n.name for n in system.nodes if n.inputs == 0]
    return named + [n.name for n in system.nodes if n.inputs > 0]


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


def _longest(system: System, after: dict[str, list[str]]) -> dict[str, int]:
    """The longest way from an input, without the lines that close a loop."""
    forward: dict[str, list[str]] = {n.name: [] for n in system.nodes}
    done: list[str] = []
    seen: set[str] = set()
    on_path: set[str] = set()
    for start in _starts(system):
        path = [(start, iter(after[start]))] if start not in seen else []
        seen.add(start)
        on_path.add(start)
        while path:
            name, following = path[-1]
            target = next(following, None)
            if target is None:
                path.pop()
                on_path.discard(name)
                done.append(name)
                continue
            if target not in on_path:
                forward[name].append(target)
            if target not in seen:
                seen.add(target)
                on_path.add(target)
                path.append((target, iter(after[target])))
        on_path.discard(start)
    layer = dict.fromkeys(forward, 0)
    for name in reversed(done):
        for target in forward[name]:
            layer[target] = max(layer[target], layer[name] + 1)
    return layer
