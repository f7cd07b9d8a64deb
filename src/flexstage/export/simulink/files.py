"""The files from which Simulink builds the model of a stage."""

import textwrap

import numpy as np

from flexstage import __version__
from flexstage.errors import ModelError
from flexstage.export.diagram.graph import Diagram
from flexstage.export.diagram.stage_diagram import stage_diagram
from flexstage.export.diagram.state_space import diagram_state_space
from flexstage.export.request import StageExport
from flexstage.export.simulink.bench import Bench, bench
from flexstage.export.simulink.chains import Functions
from flexstage.export.simulink.matlab_text import Variables, identifier, plain, valid_name
from flexstage.export.simulink.script import build_script
from flexstage.export.simulink.system import System
from flexstage.hysteresis.dynamic_model import DynamicModel

# Longest name of a model: names of functions and variables are made of it.
_LONGEST = 30
_ENDING = "_model"
_STEP = 1e-4
# Samples of the hysteresis in such a step: it is held between them, which is a delay.
_SAMPLES = 10
# Fastest pole [1/s] up to which a solver for equations that are not stiff is the better one.
_FAST = 1e6


def model_name(text: str) -> str:
    """Return a name, of 30 characters at most, that a Simulink model of flexstage can have.

    It is not that of the script for MATLAB, which would hide the model or be hidden by it.

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
    """Return a script that builds a Simulink model, and what belongs to it.

    The model holds the structural diagram, a subsystem for each of its groups, and, where a
    dynamic model is given, the modes in a State-Space block behind drive chains of their own; both
    get the same commands, and a scope shows their readings beside each other. All numbers are in
    the workspace of the model, named as the blocks are.

    ``NAME_build.m`` is the script, ``NAME_data.mat`` has the numbers, ``NAME_hysteresis_*.m`` is a
    function for each hysteresis, and ``README.txt`` says how they are used. NAME is letters, digits
    and underscores, 30 at most; `model_name` makes one. The time between samples of the hysteresis
    [s] is a tenth of the step of the model where not given, and 0.01 ms without a model; commands
    last for the duration [s].

    Notes
    -----
    Validity: that of the diagram and of the dynamic model. Amplifier, creep and sensors are the
    equations themselves, without the noise of the sensors. The hysteresis is exact at its samples
    and held between them, which delays it by half a sample on average; all states begin at rest.
    The script was executed with stand-ins for the calls of Simulink, which check blocks, ports and
    parameters; it has not been run in Simulink itself.

    Examples
    --------
    >>> from flexstage.designs import design
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
    made = bench(
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
        # displacements are metres: the usual tolerance would be as large as they are
        "AbsTol": "1e-12",
    }
    notes = _notes(diagram, model, step, bool(functions.texts))
    script = build_script(name, made.system, settings=settings, notes=notes)
    readme = _readme(name, made, variables, functions, (*notes, *_solver_note(solver, fastest)))
    return {
        f"{name}_build.m": script.encode("ascii"),
        f"{name}_data.mat": variables.mat_file(),
        **{f"{n}.m": text.encode("ascii") for n, text in functions.texts.items()},
        "README.txt": readme.encode("ascii"),
    }


def _fastest_pole(diagram: Diagram, model: DynamicModel | None) -> float:
    poles = np.linalg.eigvals(diagram_state_space(diagram, nonlinear="pass").A)
    omega = np.zeros(1) if model is None else model.omega
    return float(max(np.max(np.abs(poles), initial=0.0), np.max(omega)))


def _notes(
    diagram: Diagram, model: DynamicModel | None, step: float, with_hysteresis: bool
) -> tuple[str, ...]:
    notes = [*diagram.notes]
    if model is not None:
        notes += [
            "Subsystem structure: the bodies, hinges, drives and probes of the structural diagram. "
            "Subsystem modes: the same stage as modes, each with its own damping ratio, behind "
            "drive chains of its own. The two differ where the diagram says so above.",
            *(_sentence(n) for n in _of_model(model) if _sentence(n) not in diagram.notes),
        ]
    if with_hysteresis:
        notes.append(
            f"The hysteresis is sampled every {step:g} s: exact at the samples for an input that "
            "is straight between them, and held from one to the next, a delay of half a sample on "
            "average. For a faster motion make sample_time smaller in the workspace of the model."
        )
    notes.append("All states begin at rest, at command zero.")
    return tuple(notes)


def _of_model(model: DynamicModel) -> tuple[str, ...]:
    """Notes of a model, but for how commands go between samples: here they are signals."""
    usual = any(d.hysteresis is not None for d in model.drives)
    skipped = ("commands move on straight lines", *(() if usual else ("the hysteresis",)))
    return tuple(n for n in model.notes if not n.lower().startswith(skipped))


def _sentence(note: str) -> str:
    note = note[:1].upper() + note[1:]
    return note if note.endswith((".", "!", "?")) else f"{note}."


def _solver_note(solver: str, fastest: float) -> tuple[str, ...]:
    why = "which is stiff" if solver == "ode15s" else "which is not stiff"
    return (f"Solver {solver}: the fastest pole is {fastest:.3g} 1/s, {why}.",)


def _readme(
    name: str, made: Bench, variables: Variables, functions: Functions, notes: tuple[str, ...]
) -> str:
    def table(rows: dict[str, str]) -> str:
        wide = max((len(key) for key in rows), default=0)
        return "".join(f"  {key:<{wide}}  {plain(text)}\n" for key, text in rows.items())

    def shape(key: str) -> str:
        rows, columns = variables.values[key].shape
        return f"{rows} x {columns}"

    files = {
        f"{name}_build.m": "builds the model, in any release of Simulink; needs no toolbox",
        f"{name}_data.mat": "the numbers of its blocks (MATLAB, version 5)",
        **{f"{n}.m": "a hysteresis, for its MATLAB Function block, and by itself"
           for n in functions.texts},
    }  # fmt: skip
    first = next(iter(made.commands.values()))
    blocks, subsystems = _counts(made.system)
    example = plain(f"assignin(get_param('{name}', 'ModelWorkspace'), '{first}', [time, command])")
    hysteresis = (
        "\nEach hysteresis function has a memory: 'clear' with its name brings it back to rest. A "
        "MATLAB\nFunction block has a memory of its own, which a new simulation begins at rest.\n"
        if functions.texts
        else ""
    )
    return f"""{name}: {plain(made.system.title)}
Written by flexstage {__version__}. SI units throughout.

Files
{table(files)}
How to use it
  1. In MATLAB, go to this folder and run  {name}_build
     It draws {blocks} blocks in {subsystems} subsystems, and saves {name}.slx.
  2. Run the model:  sim('{name}')  and look at the scopes.
  3. Give it commands of your own, columns of time [s] and command:
     {example}
     or put any block in the place of the From Workspace blocks.

Commands
{table({variable: variables.meanings[variable] for variable in made.commands.values()})}
Readings, in the workspace of MATLAB after a run, or in what sim returns (structures with time)
{table(dict(made.readings))}{hysteresis}
How far it holds
{"".join(_item(note) for note in notes)}
How it was tested
  The script was executed in GNU Octave with stand-ins for the calls of Simulink, which check that
  blocks, ports and parameters exist and that every parameter evaluates to the size it must have.
  The model that it built there was integrated, and its hysteresis run, against flexstage. It was
  not run in MATLAB or Simulink, which were not at hand.

Numbers in {name}_data.mat
{table({key: f"{shape(key):<9} {text}" for key, text in variables.meanings.items()})}"""


def _item(note: str) -> str:
    return textwrap.fill(plain(note), 96, initial_indent="  - ", subsequent_indent="    ") + "\n"


def _counts(system: System) -> tuple[int, int]:
    blocks, subsystems = len(system.nodes), 0
    for node in system.nodes:
        if node.inside is not None:
            inner, nested = _counts(node.inside)
            blocks, subsystems = blocks + inner, subsystems + 1 + nested
    return blocks, subsystems


def export(given: StageExport) -> dict[str, bytes]:
    """Write the format."""
    model = given.dynamic_of_bodies
    diagram = stage_diagram(given.stage, model=model)
    return simulink_files(diagram, name=model_name(given.stage.name), model=model)
