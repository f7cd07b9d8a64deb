"""The modes of a stage as a system of Simulink: drive chains, then one State-Space block."""

from flexstage.export.control_object import linear_part
from flexstage.export.model import DynamicModel, ModelDrive
from flexstage.export.simulink import chains
from flexstage.export.simulink.functions import Functions
from flexstage.export.simulink.matlab_text import identifiers
from flexstage.export.simulink.system import Node, System, Wiring
from flexstage.export.simulink.variables import Variables


def modal(
    model: DynamicModel, variables: Variables, functions: Functions, sample_time: str
) -> System:
    """Return the modes of a stage behind the chains of its drives.

    The State-Space block holds `flexstage.export.control_object.linear_part`: modes with the
    damping ratio of each, and the lags of creep. Inports are the drives and outports the probes,
    in the order of the model.
    """
    form = linear_part(model)
    w = Wiring(f"{model.name}: modes, with the damping of each")
    names = {
        letter: variables.add(f"modes_{letter}", matrix, meaning)
        for letter, matrix, meaning in (
            ("A", form.A, "state matrix: deflections and rates of the modes, lags of creep"),
            ("B", form.B, "input matrix: free displacements of the drives [m], or forces [N]"),
            ("C", form.C, "output matrix: motion of the probes"),
            ("D", form.D, "what the probes follow at once"),
        )
    }
    count = len(model.drives)
    w.add(
        Node(
            name="modes",
            kind="StateSpace",
            settings=names,
            meaning=f"{model.omega.size} modes: x' = A x + B w, y = C x + D w",
        )
    )
    inports = identifiers([d.name for d in model.drives], longest=40)
    for drive in model.drives:
        w.add(
            Node(
                name=f"command_{inports[drive.name]}",
                kind="Inport",
                settings={"PortDimensions": "1"},
                meaning=f"command of drive {drive.name} [{drive.unit}]",
            )
        )
    ends = [_chain(w, d, inports[d.name], variables, functions, sample_time) for d in model.drives]
    if count == 1:
        w.chain(ends[0], "modes")
    else:
        w.add(Node(name="w", kind="Mux", settings={"Inputs": str(count)}, inputs=count,
                   meaning="free displacements [m], or forces [N]"))  # fmt: skip
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
    """Add what lies between the command of a drive and its free displacement."""
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
    """Lead the outputs through sensors to outports."""
    count = len(model.probes)
    names = identifiers([p.name for p in model.probes], longest=40)
    at = "modes"
    if count > 1:
        at = w.add(Node(name="y", kind="Demux", settings={"Outputs": str(count)}, outputs=count,
                        meaning="motion of the probes"))  # fmt: skip
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
        out = w.add(Node(name=f"reading_{names[probe.name]}", kind="Outport", meaning=meaning))
        w.connect(source, out, output=port)
