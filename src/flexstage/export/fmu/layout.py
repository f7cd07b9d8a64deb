"""The variables of an FMU: names, value references, and the states that a solver sees."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np

from flexstage.export.simulink.matlab_text import plain
from flexstage.export.source.render import c_variables
from flexstage.files.names import free_name
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive

_SMALLEST_SHARE = 1e-6  # of the largest usual size, for modes that hardly move


@dataclass(frozen=True, slots=True)
class SolverState:
    """A state of the differential equations."""

    name: str
    """Its name."""
    unit: str
    """Its unit."""
    rate_unit: str
    """Unit of its derivative."""
    description: str
    """What it is."""
    nominal: float
    """Usual size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverStates:
    """All states, and where each kind is."""

    states: tuple[SolverState, ...]
    """Voltages, lags of creep, deflections, rates, lags of sensors."""
    voltage_at: tuple[int, ...]
    """Where the voltage of each drive is; -1 for none."""
    lag_at: tuple[int, ...]
    """Where the first lag of each drive is; -1 for none."""
    deflection_at: int
    """Where the deflections of the modes begin; their rates come right after."""
    seen_at: tuple[int, ...]
    """Where the lag of the sensor of each probe is; -1 for none."""


Causality = Literal["independent", "parameter", "input", "output", "local"]
#: Events of an amplifier, in the order in which the C code counts them.
INDICATORS = (
    ("turn", "how far the voltage is from turning"),
    ("slew", "how far the amplifier is from its largest rate"),
    ("top", "how far the voltage is from the top of its range"),
    ("bottom", "how far the voltage is from the bottom of its range"),
)


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable of an FMU."""

    reference: int
    """Value reference; variables are listed in this order, from 0."""
    name: str
    """Its name."""
    causality: Causality
    """``independent``, ``parameter``, ``input``, ``output`` or ``local``."""
    variability: Literal["continuous", "tunable", "fixed"]
    """``continuous``, ``tunable`` or ``fixed``."""
    description: str
    """What it is."""
    _: KW_ONLY
    unit: str = "1"
    """Its unit; ``1`` for none."""
    start: float | None = None
    """Its value at first, of parameters and inputs."""
    whole: bool = False
    """Whether it is an integer."""
    expression: str = ""
    """Where it is in C, of parameters and of locals that the core has."""
    nominal: float | None = None
    """Usual size, of states."""
    state: int | None = None
    """Value reference of the state whose derivative it is."""
    limits: tuple[float, float] | None = None
    """Lowest and highest value, where there are such."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FmuLayout:
    """The variables of an FMU, and where each kind begins."""

    identifier: str
    """Name of the FMU as C takes it."""
    variables: tuple[FmuVariable, ...]
    """The variables, by value reference."""
    first: dict[str, int]
    """First value reference by kind: ``parameter``, ``input``, ``output``, ``local``, ``state``,
    ``derivative``, ``indicator``.
    """
    count: dict[str, int]
    """Number of variables by kind."""
    states: SolverStates
    """The states of the solver, in their order."""
    usual_voltage: tuple[float, ...]
    """Usual size of the voltage of each drive [V]."""

    def of(self, kind: str) -> tuple[FmuVariable, ...]:
        """Return the variables of a kind, one of the keys of `first`."""
        start = self.first[kind]
        return self.variables[start : start + self.count[kind]]


def fmu_layout(model: DynamicModel) -> FmuLayout:
    """Return the variables of the FMU of a model."""
    found: list[FmuVariable] = []
    first: dict[str, int] = {}
    count: dict[str, int] = {}

    def start(kind: str) -> None:
        first[kind] = len(found)

    def end(kind: str) -> None:
        count[kind] = len(found) - first[kind]

    _first_two(found, model)
    # descriptions have the names of the stage, variables the nearest that FMI takes
    named = _named(model)
    given = [
        replace(v, name=p.name) for v, p in zip(c_variables(model), c_variables(named), strict=True)
    ]
    ranges = {f"{d.name}.command": d.input_range for d in named.drives}
    for kind in ("parameter", "input", "output", "local"):
        start(kind)
        for v in given:
            if v.causality != kind or _without_state(v.name, v.start):
                continue
            found.append(
                FmuVariable(
                    len(found),
                    structured(v.name),
                    v.causality,
                    "tunable" if kind == "parameter" else "continuous",
                    v.description,
                    unit=v.unit,
                    start=v.start if kind in ("parameter", "input") else None,
                    expression=v.expression if kind in ("parameter", "local") else "",
                    limits=ranges.get(v.name),
                )
            )
        end(kind)
    states = _states(model, named)
    start("state")
    for s in states.states:
        found.append(_local(found, s.name, s.unit, s.description, s.nominal))
    end("state")
    start("derivative")
    for k, s in enumerate(states.states):
        name, what = f"der({s.name})", f"rate of {s.name}"
        found.append(_local(found, name, s.rate_unit, what, state=first["state"] + k))
    end("derivative")
    start("indicator")
    for d, simple in zip(model.drives, named.drives, strict=True):
        if d.amplifier is not None:
            for name, what in INDICATORS:
                text = f"event of the amplifier of drive {d.name}: {what}"
                called = structured(f"{simple.name}.amplifier.{name}")
                found.append(_local(found, called, "V", text))
    end("indicator")
    return FmuLayout(
        identifier=identifier(model.name),
        variables=tuple(found),
        first=first,
        count=count,
        usual_voltage=tuple(usual_command(d) for d in model.drives),
        states=states,
    )


def _named(model: DynamicModel) -> DynamicModel:
    """The same with drives and probes by names that FMI takes."""
    drives = plain_names("drive", (d.name for d in model.drives))
    probes = plain_names("probe", (p.name for p in model.probes))
    return replace(
        model,
        drives=tuple(replace(d, name=n) for d, n in zip(model.drives, drives, strict=True)),
        probes=tuple(replace(p, name=n) for p, n in zip(model.probes, probes, strict=True)),
    )


def _states(model: DynamicModel, named: DynamicModel) -> SolverStates:
    found = solver_states(model)
    names = [s.name for s in solver_states(named).states]
    renamed = (replace(s, name=n) for s, n in zip(found.states, names, strict=True))
    return replace(found, states=tuple(renamed))


def _first_two(found: list[FmuVariable], model: DynamicModel) -> None:
    found.append(FmuVariable(0, "time", "independent", "continuous", "simulation time", unit="s"))
    found.append(
        FmuVariable(
            1,
            "interpolation",
            "parameter",
            "fixed",
            "co-simulation: 0 = a command jumps at the start of a step and holds, "
            "1 = it moves on a straight line from the last command and is met at the end of the "
            f"step; the model steps by {model.step:g} s inside",
            start=0,
            whole=True,
            limits=(0, 1),
        )
    )


def _without_state(name: str, start: float) -> bool:
    """Whether it is the lag of a sensor that has none: the solver has no state for it."""
    return name.startswith("sensor.") and name.endswith(".bandwidth_hz") and start == 0.0


def _local(
    found: Sequence[FmuVariable],
    name: str,
    unit: str,
    description: str,
    nominal: float | None = None,
    state: int | None = None,
) -> FmuVariable:
    return FmuVariable(
        len(found),
        name,
        "local",
        "continuous",
        description,
        unit=unit,
        nominal=nominal,
        state=state,
    )


def usual_command(d: ModelDrive) -> float:
    """Return the usual size of a command [V, m or N], and of the voltage; never 0."""
    ranges = [r for r in (d.amplifier and d.amplifier.voltage_range, d.input_range) if r]
    size = max((abs(v) for r in ranges for v in r if np.isfinite(v)), default=0.0)
    return size or {"V": 100.0, "m": 1e-5}.get(d.unit, 1.0)


def solver_states(model: DynamicModel) -> SolverStates:
    """Return the states of a model under an importer's solver."""
    found: list[SolverState] = []
    outputs = [_usual_output(d) for d in model.drives]
    voltage_at = tuple(_voltage(found, d) for d in model.drives)
    lag_at = tuple(_lags(found, d, w) for d, w in zip(model.drives, outputs, strict=True))
    deflection_at = len(found)
    _modes(found, model, np.array(outputs))
    seen_at = tuple(_sensor(found, model, p, outputs) for p in range(len(model.probes)))
    return SolverStates(
        states=tuple(found),
        voltage_at=voltage_at,
        lag_at=lag_at,
        deflection_at=deflection_at,
        seen_at=seen_at,
    )


def _usual_output(d: ModelDrive) -> float:
    u = usual_command(d)
    if d.hysteresis is None:
        return abs(d.gain) * u or 1e-6
    return abs(float(d.hysteresis.simulate([u], d.hysteresis.initial_state()).values[-1])) or 1e-6


def _voltage(found: list[SolverState], d: ModelDrive) -> int:
    if d.amplifier is None:
        return -1
    name, what = structured(f"{d.name}.amplifier.voltage"), f"voltage of the amplifier of {d.name}"
    found.append(SolverState(name, "V", "V/s", what, usual_command(d)))
    return len(found) - 1


def _lags(found: list[SolverState], d: ModelDrive, size: float) -> int:
    first, count = len(found), int(d.lag_weights.shape[1])
    unit = "N" if d.stiffness == 0.0 else "m"
    for j in range(1, count + 1):
        name = structured(f"{d.name}.creep.lag.{j}")
        what = f"lag {j} of the creep of drive {d.name}"
        found.append(SolverState(name, unit, f"{unit}/s", what, size))
    return first if count else -1


def _modes(found: list[SolverState], model: DynamicModel, outputs: np.ndarray) -> None:
    gains = np.abs(np.array([d.modal_gain for d in model.drives]))
    sizes = (gains * outputs[:, None]).max(axis=0)
    sizes = np.maximum(sizes, _SMALLEST_SHARE * sizes.max()) if sizes.any() else sizes + 1.0
    imposed = any(np.any(d.rate_time != 0.0) for d in model.drives)
    less = ", less what the imposed displacements give at once" if imposed else ""
    for i, size in enumerate(sizes.tolist(), 1):
        what = f"deflection of mode {i}, scaled to a modal mass of 1 kg"
        found.append(SolverState(f"mode[{i}].deflection", "m", "m/s", what, size))
    for i, size in enumerate((sizes * model.omega).tolist(), 1):
        what = f"rate of mode {i}, scaled to a modal mass of 1 kg{less}"
        found.append(SolverState(f"mode[{i}].rate", "m/s", "m/s2", what, size))


def _sensor(found: list[SolverState], model: DynamicModel, p: int, outputs: list[float]) -> int:
    probe = model.probes[p]
    if probe.sensor is None or probe.sensor.bandwidth_hz is None:
        return -1
    k = model.omega.size
    at_rest = [
        abs(float(d.mode_weights[p, :k].sum() + d.feedthrough[p])) * w
        for d, w in zip(model.drives, outputs, strict=True)
    ]
    name = structured(f"sensor.{probe.name}.lag")
    what = f"motion of probe {probe.name} behind the lag of its sensor"
    found.append(SolverState(name, probe.unit, f"{probe.unit}/s", what, max(at_rest) or 1e-6))
    return len(found) - 1


_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[[0-9]+(,[0-9]+)*\])?")


def identifier(name: str) -> str:
    """Return a name as C takes it, not a digit first.

    Examples
    --------
    >>> identifier("vgtu-piezo"), identifier("2 axes")
    ('vgtu_piezo', 'stage_2_axes')
    """
    kept = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return kept if re.match(r"[A-Za-z]", kept) else f"stage_{kept}".rstrip("_")


def plain_names(noun: str, names: Iterable[str]) -> list[str]:
    """Return a name of one part, in ASCII, for each name of drives or of probes, no two alike.

    One that begins with a digit, which would be quoted, gets the noun before it.

    Examples
    --------
    >>> plain_names("drive", ["x", "x.1", "x_1", "Kühler", "1"])
    ['x', 'x_1', 'x_1_2', 'Kuhler', 'drive_1']
    """
    found: list[str] = []
    for name in names:
        base = re.sub(r"^(?=\d)", f"{noun}_", plain(name).replace(".", "_")) or "_"
        # these two begin names of other variables
        found.append(free_name(base, {"mode", "sensor", *found}.__contains__))
    return found


def structured(name: str) -> str:
    """Return a dotted name as FMI's structured naming convention has it.

    A part that is a number counts the part before it; others that are no identifiers are quoted.

    Examples
    --------
    >>> structured("mode.3.damping_ratio"), structured("left-x.command")
    ('mode[3].damping_ratio', "'left-x'.command")
    """
    out: list[str] = []
    for part in name.split("."):
        if part.isdigit() and out:
            out[-1] += f"[{part}]"
        elif _PLAIN.fullmatch(part):
            out.append(part)
        else:
            plain = part.encode("ascii", "replace").decode()
            out.append("'" + plain.replace("\\", "\\\\").replace("'", "\\'") + "'")
    return ".".join(out)
