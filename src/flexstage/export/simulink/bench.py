"""The model that is run: commands, the stage in two forms, and what records its readings."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexstage.errors import ModelError
from flexstage.export.diagram.graph import Block, Diagram
from flexstage.export.simulink.chains import Functions
from flexstage.export.simulink.matlab_text import Variables
from flexstage.export.simulink.structure import modal, structure
from flexstage.export.simulink.system import Node, System, Wiring
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.model import Array

_SAMPLES = 401
# Largest command where nobody has said how far a drive goes.
_USUAL = {"V": 10.0, "m": 1e-5, "N": 1.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """A model and what it records."""

    system: System
    """The top of the model."""
    commands: Mapping[str, str]
    """Variable of the command by input of the diagram."""
    readings: Mapping[str, str]
    """What is held, by variable in the workspace of MATLAB."""


def bench(
    diagram: Diagram,
    model: DynamicModel | None,
    *,
    name: str,
    sample_time: str,
    duration: float,
    variables: Variables,
    functions: Functions,
) -> Bench:
    """Return the top of a Simulink model; without a dynamic model, with the diagram alone.

    The sample time of the hysteresis is an expression [s]; commands last for the duration [s].
    """
    inputs = [b for b in diagram.blocks if b.kind == "input"]
    outputs = [b for b in diagram.blocks if b.kind == "output"]
    if not inputs or not outputs:
        raise ModelError("a diagram for Simulink needs an input and an output: it has none")
    w = Wiring(diagram.title)
    commands = {b.name: _source(w, b, diagram, model, duration, variables) for b in inputs}
    w.nest("structure", structure(diagram, variables, functions, sample_time))
    for port, b in enumerate(inputs, 1):
        w.connect(commands[b.name], "structure", port=port, signal=_signal(b, diagram))
    reader: dict[str, int] = {}
    if model is not None:
        w.nest("modes", modal(model, variables, functions, sample_time))
        of_drive = _matched(inputs, [d.name for d in model.drives], "u_", "inputs")
        for port, d in enumerate(model.drives, 1):
            w.connect(commands[of_drive[d.name]], "modes", port=port)
        of_probe = _matched(outputs, [p.name for p in model.probes], "y_", "outputs")
        reader = {of_probe[p.name]: i for i, p in enumerate(model.probes, 1) if p.name in of_probe}
    readings = _record(w, outputs, reader, name, diagram)
    spare = [] if model is None else [
        i for i in range(1, len(model.probes) + 1) if i not in reader.values()
    ]  # fmt: skip
    for i in spare:
        assert model is not None
        probe = model.probes[i - 1]
        words = f"{probe.name} [{probe.unit}], modes"
        _keep(w, readings, "modes", i, f"{name}_modes_{i}", words)
    return Bench(system=w.system(), commands=commands, readings=readings)


def _signal(block: Block, diagram: Diagram) -> str:
    unit = diagram.units.get(block.name, "")
    return f"{block.label} [{unit}]" if unit else block.label


def _source(
    w: Wiring,
    block: Block,
    diagram: Diagram,
    model: DynamicModel | None,
    duration: float,
    variables: Variables,
) -> str:
    """Add a command: up and down again on half a cosine, from zero."""
    unit = diagram.units.get(block.name, "")
    highest = _USUAL.get(unit, 1.0)
    for drive in model.drives if model is not None else ():
        if block.label == f"u_{drive.name}" and drive.input_range is not None:
            highest = 0.75 * max(drive.input_range, key=abs)
    time = np.linspace(0.0, duration, _SAMPLES)
    shape = 0.5 * highest * (1.0 - np.cos(2.0 * np.pi * time / duration))
    values: Array = np.column_stack((time, *(shape,) * block.width))
    variable = variables.add(
        f"command_{block.name}", values, f"time [s] and {block.meaning}, to run the model with"
    )
    return w.block(
        variable,
        "FromWorkspace",
        {
            "VariableName": variable,
            "SampleTime": "0",
            "Interpolate": "on",
            "OutputAfterFinalValue": "Holding final value",
        },
        block.meaning,
        inputs=0,
    )


def _matched(blocks: list[Block], names: list[str], prefix: str, what: str) -> dict[str, str]:
    """Find the block of the diagram that belongs to each drive or probe."""
    by_label = {b.label: b.name for b in blocks}
    found = {n: by_label[prefix + n] for n in names if prefix + n in by_label}
    if not found and len(blocks) == len(names):
        return {n: b.name for n, b in zip(names, blocks, strict=True)}
    # a probe that reads nothing need not be drawn; a drive must be
    if len(found) < len(names) and what == "inputs":
        raise ModelError(
            f"the {what} of the diagram are {', '.join(b.name for b in blocks)}, those of the "
            f"model {', '.join(names)}: make both of one stage, or leave the model out"
        )
    return found


def _record(
    w: Wiring, outputs: list[Block], reader: dict[str, int], name: str, diagram: Diagram
) -> dict[str, str]:
    """Show each output, that of the modes beside it, and keep both."""
    made: dict[str, str] = {}
    for port, b in enumerate(outputs, 1):
        _keep(w, made, "structure", port, f"{name}_{b.name}", f"{b.meaning}, structure")
        scope = Node(f"scope_{b.name}", "Scope", outputs=0, meaning=b.meaning)
        if b.name not in reader:
            w.connect("structure", w.add(scope), output=port, signal=_signal(b, diagram))
            continue
        both = w.block(
            f"both_{b.name}", "Mux", {"Inputs": "2"}, f"{b.meaning}: structure, modes", inputs=2
        )
        w.connect("structure", both, output=port, signal=_signal(b, diagram))
        w.connect("modes", both, output=reader[b.name], port=2)
        w.chain(both, w.add(scope))
        wanted = f"{name}_{b.name}_modes"
        _keep(w, made, "modes", reader[b.name], wanted, f"{b.meaning}, modes")
    return made


def _keep(
    w: Wiring, made: dict[str, str], source: str, output: int, wanted: str, words: str
) -> None:
    """Keep an output in the workspace of MATLAB, by a name that nothing else has."""
    variable, count = wanted[:58], 1
    while variable in made:
        count += 1
        variable = f"{wanted[:58]}_{count}"
    made[variable] = words
    at = w.block(
        f"keep_{variable}"[:63],
        "ToWorkspace",
        {"VariableName": variable, "SaveFormat": "Structure With Time"},
        words,
        outputs=0,
    )
    w.connect(source, at, output=output)
