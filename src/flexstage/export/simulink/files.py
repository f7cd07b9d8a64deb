"""Files from which Simulink builds the model of a stage with commands and scopes."""

import textwrap

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.base.version import __version__
from flexstage.export.diagram.graph import Block, Diagram, diagram_state_space
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.request import StageExport
from flexstage.export.simulink.chains import Functions
from flexstage.export.simulink.matlab_text import Variables, identifier, mat_file, plain, valid_name
from flexstage.export.simulink.structure import modal, structure
from flexstage.export.simulink.system import Node, System, Wiring, build_script
from flexstage.files.names import free_name
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.model import Array

_POINTS = 401
# Largest command of a drive without a range.
_USUAL = {"V": 10.0, "m": 1e-5, "N": 1.0}


def bench(
    diagram: Diagram,
    model: DynamicModel | None,
    *,
    name: str,
    sample_time: str,
    duration: float,
    variables: Variables,
    functions: Functions,
) -> tuple[System, dict[str, str], dict[str, str]]:
    """Return the top level of a Simulink model, its command variables, and its logged variables.

    Command variables are by input of the diagram, logged variables of the MATLAB workspace have
    their meanings. Without a dynamic model there is only the diagram. The sample time of the
    hysteresis is an expression [s]; commands last for the duration [s].
    """
    inputs = [b for b in diagram.blocks if b.kind == "input"]
    outputs = [b for b in diagram.blocks if b.kind == "output"]
    if not inputs or not outputs:
        raise ModelError("a diagram for Simulink needs an input and an output")
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
    return w.system(), commands, readings


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
    """Add a command: one cosine cycle from zero and back."""
    unit = diagram.units.get(block.name, "")
    highest = _USUAL.get(unit, 1.0)
    for drive in model.drives if model is not None else ():
        if block.label == f"u_{drive.name}" and drive.input_range is not None:
            highest = 0.75 * max(drive.input_range, key=abs)
    time = np.linspace(0.0, duration, _POINTS)
    shape = 0.5 * highest * (1.0 - np.cos(2.0 * np.pi * time / duration))
    values: Array = np.column_stack((time, *(shape,) * block.width))
    variable = variables.add(
        f"command_{block.name}", values, f"time [s] and {block.meaning}, for a run of the model"
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
    """Return the block of the diagram for each drive or probe."""
    by_label = {b.label: b.name for b in blocks}
    matches = {n: by_label[prefix + n] for n in names if prefix + n in by_label}
    if not matches and len(blocks) == len(names):
        return {n: b.name for n, b in zip(names, blocks, strict=True)}
    # a probe without motion may be missing in the diagram; a drive may not
    if len(matches) < len(names) and what == "inputs":
        raise ModelError(
            f"the {what} of the diagram are {', '.join(b.name for b in blocks)}, those of the "
            f"model {', '.join(names)}: give a diagram and a model of the same stage"
        )
    return matches


def _record(
    w: Wiring, outputs: list[Block], reader: dict[str, int], name: str, diagram: Diagram
) -> dict[str, str]:
    """Add a scope for each output with that of the modes, and log both."""
    readings: dict[str, str] = {}
    for port, b in enumerate(outputs, 1):
        _keep(w, readings, "structure", port, f"{name}_{b.name}", f"{b.meaning}, structure")
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
        variable = f"{name}_{b.name}_modes"
        _keep(w, readings, "modes", reader[b.name], variable, f"{b.meaning}, modes")
    return readings


def _keep(
    w: Wiring, readings: dict[str, str], source: str, output: int, base: str, words: str
) -> None:
    """Log an output in the MATLAB workspace under a free name."""
    variable = free_name(base[:58], readings.__contains__)
    readings[variable] = words
    at = w.block(
        f"keep_{variable}"[:63],
        "ToWorkspace",
        {"VariableName": variable, "SaveFormat": "Structure With Time"},
        words,
        outputs=0,
    )
    w.connect(source, at, output=output)


# Longest name of a model, which is part of names of functions and variables.
_LONGEST = 30
_ENDING = "_model"
_STEP = 1e-4
# Samples of the hysteresis per step; its output is held between them, which is a delay.
_SAMPLES = 10
# Fastest pole [1/s] for a solver of equations that are not stiff.
_FAST = 1e6


def model_name(text: str) -> str:
    """Return a name for a Simulink model, of at most 30 characters.

    It differs from the name of the script of the format ``mat``, so that neither hides the other.

    Examples
    --------
    >>> model_name("vgtu-piezo")
    'vgtu_piezo_model'
    """
    return identifier(text, longest=_LONGEST - len(_ENDING)) + _ENDING


def simulink_files(
    diagram: Diagram,
    *,
    name: str,
    model: DynamicModel | None = None,
    sample_time: float | None = None,
    duration: float = 0.2,
) -> dict[str, bytes]:
    """Return a script that builds a Simulink model, with its data and functions.

    The model has the structural diagram, with a subsystem for each of its groups. With a dynamic
    model it also has the modes in a State-Space block after separate drive chains; both have the
    same commands, and a scope compares their readings. All numbers are in the workspace of the
    model under the names of the blocks.

    ``NAME_build.m`` is the script, ``NAME_data.mat`` has the numbers, ``NAME_hysteresis_*.m`` is a
    function for each hysteresis, and ``README.txt`` is the manual. NAME is at most 30 letters,
    digits and underscores, see `model_name`. The sample time of the hysteresis [s] is by default a
    tenth of the step of the model, or 0.01 ms without a model; commands last for the duration [s].

    Notes
    -----
    Validity: that of the diagram and of the dynamic model. Amplifier, creep and sensors are exact,
    without sensor noise. The hysteresis is exact at its samples and held between them, an average
    delay of half a sample; all initial states are at rest. The script was tested with substitutes
    for the functions of Simulink, which check blocks, ports and parameters, not in Simulink.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> diagram = stage_diagram(design("parallelogram"))
    >>> sorted(simulink_files(diagram, name="parallelogram"))
    ['README.txt', 'parallelogram_build.m', 'parallelogram_data.mat']
    """
    valid_name(name, "name of a Simulink model", longest=_LONGEST)
    step = sample_time
    if step is None:
        step = (_STEP if model is None else model.step) / _SAMPLES
    for value, what in ((step, "sample time"), (duration, "duration")):
        if not (value > 0.0 and np.isfinite(value)):
            raise ModelError(f"the {what} must be positive and finite, got {value!r} s")
    variables, functions = Variables(), Functions(f"{name}_hysteresis_")
    rate = variables.add("sample_time", step, "time between samples of the hysteresis [s]")
    top, commands, readings = bench(
        diagram,
        model,
        name=name,
        sample_time=rate,
        duration=duration,
        variables=variables,
        functions=functions,
    )
    fastest = _fastest_pole(diagram, model)
    solver = "ode45" if fastest <= _FAST else "ode15s"
    settings = {
        "Solver": solver,
        "StopTime": f"{duration:.12g}",
        "RelTol": "1e-6",
        # displacements in metres are smaller than the default tolerance
        "AbsTol": "1e-12",
    }
    notes = _notes(diagram, model, step, bool(functions.texts))
    script = build_script(name, top, settings=settings, notes=notes)
    stiff = "is stiff" if solver == "ode15s" else "is not stiff"
    why = f"Solver {solver}: the fastest pole is {fastest:.3g} 1/s; the system {stiff}."
    readme = _readme(name, top, (commands, readings), variables, functions, (*notes, why))
    return {
        f"{name}_build.m": script.encode("ascii"),
        f"{name}_data.mat": mat_file(variables.values),
        **{f"{n}.m": text.encode("ascii") for n, text in functions.texts.items()},
        "README.txt": readme.encode("ascii"),
    }


def _fastest_pole(diagram: Diagram, model: DynamicModel | None) -> float:
    poles = np.linalg.eigvals(diagram_state_space(diagram).A)
    omega = np.zeros(1) if model is None else model.omega
    return float(max(np.max(np.abs(poles), initial=0.0), np.max(omega)))


def _notes(
    diagram: Diagram, model: DynamicModel | None, step: float, with_hysteresis: bool
) -> tuple[str, ...]:
    notes = [*diagram.notes]
    if model is not None:
        notes += [
            "Subsystem structure: the bodies, hinges, drives and probes of the structural diagram. "
            "Subsystem modes: the same stage as modes, each with its own damping ratio, after "
            "separate drive chains. The notes above on the diagram explain their differences.",
            *(_sentence(n) for n in _of_model(model) if _sentence(n) not in diagram.notes),
        ]
    if with_hysteresis:
        notes.append(
            f"The hysteresis is sampled every {step:g} s. It is exact at the samples for an input "
            "that is straight between them, and held between samples, an average delay of half a "
            "sample. For faster motion reduce sample_time in the workspace of the model."
        )
    notes.append("All initial states are at rest, at command zero.")
    return tuple(notes)


def _of_model(model: DynamicModel) -> tuple[str, ...]:
    """Return the notes of a model without that on sampled commands: here they are signals."""
    usual = any(d.hysteresis is not None for d in model.drives)
    skipped = ("commands move on straight lines", *(() if usual else ("the hysteresis",)))
    return tuple(n for n in model.notes if not n.lower().startswith(skipped))


def _sentence(note: str) -> str:
    note = note[:1].upper() + note[1:]
    return note if note.endswith((".", "!", "?")) else f"{note}."


def _readme(
    name: str,
    top: System,
    signals: tuple[dict[str, str], dict[str, str]],
    variables: Variables,
    functions: Functions,
    notes: tuple[str, ...],
) -> str:
    commands, readings = signals

    def table(rows: dict[str, str]) -> str:
        width = max((len(key) for key in rows), default=0)
        return "".join(f"  {key:<{width}}  {plain(text)}\n" for key, text in rows.items())

    def shape(key: str) -> str:
        rows, columns = variables.values[key].shape
        return f"{rows} x {columns}"

    files = {
        f"{name}_build.m": "builds the model in any release of Simulink, without toolboxes",
        f"{name}_data.mat": "parameters of its blocks (MATLAB, version 5)",
        **{f"{n}.m": "a hysteresis, for its MATLAB Function block or on its own"
           for n in functions.texts},
    }  # fmt: skip
    first = next(iter(commands.values()))
    blocks, subsystems = _counts(top)
    items = "".join(
        textwrap.fill(plain(note), 96, initial_indent="  - ", subsequent_indent="    ") + "\n"
        for note in notes
    )
    example = plain(f"assignin(get_param('{name}', 'ModelWorkspace'), '{first}', [time, command])")
    hysteresis = (
        "\nEach hysteresis function has a memory: 'clear' with its name resets it to rest. A "
        "MATLAB\nFunction block has a separate memory, at rest at the start of a simulation.\n"
        if functions.texts
        else ""
    )
    return f"""{name}: {plain(top.title)}
Written by flexstage {__version__}. SI units throughout.

Files
{table(files)}
Use
  1. In MATLAB, go to this folder and run  {name}_build
     It builds {blocks} blocks in {subsystems} subsystems, and saves {name}.slx.
  2. Run the model:  sim('{name}')  and open the scopes.
  3. Use your own commands, columns of time [s] and command:
     {example}
     or replace the From Workspace blocks.

Commands
{table({variable: variables.meanings[variable] for variable in commands.values()})}
Readings, in the MATLAB workspace after a run, or in the output of sim (structures with time)
{table(readings)}{hysteresis}
Validity
{items}
Tests
  The script was run in GNU Octave with substitutes for the functions of Simulink, which check that
  blocks, ports and parameters exist and that every parameter has the required size. The resulting
  model was integrated, and its hysteresis was run, for comparison with flexstage. The script was
  not tested in MATLAB or Simulink.

Variables in {name}_data.mat
{table({key: f"{shape(key):<9} {text}" for key, text in variables.meanings.items()})}"""


def _counts(system: System) -> tuple[int, int]:
    blocks, subsystems = len(system.nodes), 0
    for node in system.nodes:
        if node.inside is not None:
            inner, nested = _counts(node.inside)
            blocks, subsystems = blocks + inner, subsystems + 1 + nested
    return blocks, subsystems


def export(stage_export: StageExport) -> dict[str, bytes]:
    """Return the files of the format."""
    model = stage_export.dynamic_of_bodies
    diagram = stage_diagram(stage_export.stage, model=model)
    return simulink_files(diagram, name=model_name(stage_export.stage.name), model=model)
