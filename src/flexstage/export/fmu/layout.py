"""Variables of an FMU: names, value references, and states of the solver."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np

from flexstage.export.simulink.matlab_text import plain
from flexstage.export.source.render import c_variables
from flexstage.files.names import free_name
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive

_SMALLEST_SHARE = 1e-6  # of the largest nominal value, for modes with little motion


@dataclass(frozen=True, slots=True)
class SolverState:
    """A state of the differential equations."""

    name: str
    """Name."""
    unit: str
    """Unit."""
    rate_unit: str
    """Unit of the derivative."""
    description: str
    """Description."""
    nominal: float
    """Nominal value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverStates:
    """All states, and the indices of each kind."""

    states: tuple[SolverState, ...]
    """Voltages, lags of creep, deflections, rates, lags of sensors."""
    voltage_at: tuple[int, ...]
    """Index of the voltage of each drive; -1 for none."""
    lag_at: tuple[int, ...]
    """Index of the first lag of each drive; -1 for none."""
    deflection_at: int
    """Index of the first deflection of the modes; their rates follow the deflections."""
    seen_at: tuple[int, ...]
    """Index of the lag of the sensor of each probe; -1 for none."""


Causality = Literal["independent", "parameter", "input", "output", "local"]
#: Events of an amplifier, in the order of the C code.
INDICATORS = (
    ("turn", "distance of the voltage from a reversal"),
    ("slew", "distance of the amplifier from its largest rate"),
    ("top", "distance of the voltage from the top of its range"),
    ("bottom", "distance of the voltage from the bottom of its range"),
)


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable of an FMU."""

    reference: int
    """Value reference, the index in the list of variables from 0."""
    name: str
    """Name."""
    causality: Causality
    """``independent``, ``parameter``, ``input``, ``output`` or ``local``."""
    variability: Literal["continuous", "tunable", "fixed"]
    """``continuous``, ``tunable`` or ``fixed``."""
    description: str
    """Description."""
    _: KW_ONLY
    unit: str = "1"
    """Unit; ``1`` for none."""
    start: float | None = None
    """Start value of parameters and inputs."""
    integer: bool = False
    """An integer variable."""
    expression: str = ""
    """Expression in C, of parameters and of locals of the core."""
    nominal: float | None = None
    """Nominal value of a state."""
    state: int | None = None
    """Value reference of the state of a derivative."""
    limits: tuple[float, float] | None = None
    """Lowest and highest value, if limited."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FmuLayout:
    """Variables of an FMU, and the first reference of each kind."""

    identifier: str
    """Identifier of the FMU in C."""
    variables: tuple[FmuVariable, ...]
    """Variables by value reference."""
    first: dict[str, int]
    """First value reference by kind: ``parameter``, ``input``, ``output``, ``local``, ``state``,
    ``derivative``, ``indicator``.
    """
    count: dict[str, int]
    """Number of variables by kind."""
    states: SolverStates
    """States of the solver, in order."""
    usual_voltage: tuple[float, ...]
    """Nominal voltage of each drive [V]."""

    def of(self, kind: str) -> tuple[FmuVariable, ...]:
        """Return the variables of a kind, one of the keys of `first`."""
        start = self.first[kind]
        return self.variables[start : start + self.count[kind]]


def fmu_layout(model: DynamicModel) -> FmuLayout:
    """Return the variables of the FMU of a model."""
    variables: list[FmuVariable] = []
    first: dict[str, int] = {}
    count: dict[str, int] = {}

    def start(kind: str) -> None:
        first[kind] = len(variables)

    def end(kind: str) -> None:
        count[kind] = len(variables) - first[kind]

    _first_two(variables, model)
    # descriptions have the names of the stage, variables names that are valid in FMI
    plain_model = _named(model)
    named_variables = [
        replace(v, name=p.name)
        for v, p in zip(c_variables(model), c_variables(plain_model), strict=True)
    ]
    ranges = {f"{d.name}.command": d.input_range for d in plain_model.drives}
    for kind in ("parameter", "input", "output", "local"):
        start(kind)
        for v in named_variables:
            if v.causality != kind or _without_state(v.name, v.start):
                continue
            variables.append(
                FmuVariable(
                    len(variables),
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
    states = _states(model, plain_model)
    start("state")
    for s in states.states:
        variables.append(_local(variables, s.name, s.unit, s.description, s.nominal))
    end("state")
    start("derivative")
    for k, s in enumerate(states.states):
        name, what = f"der({s.name})", f"rate of {s.name}"
        variables.append(_local(variables, name, s.rate_unit, what, state=first["state"] + k))
    end("derivative")
    start("indicator")
    for d, simple in zip(model.drives, plain_model.drives, strict=True):
        if d.amplifier is not None:
            for name, what in INDICATORS:
                text = f"event of the amplifier of drive {d.name}: {what}"
                called = structured(f"{simple.name}.amplifier.{name}")
                variables.append(_local(variables, called, "V", text))
    end("indicator")
    return FmuLayout(
        identifier=identifier(model.name),
        variables=tuple(variables),
        first=first,
        count=count,
        usual_voltage=tuple(usual_command(d) for d in model.drives),
        states=states,
    )


def _named(model: DynamicModel) -> DynamicModel:
    """Return the model with names of drives and probes that are valid in FMI."""
    drive_names = plain_names("drive", (d.name for d in model.drives))
    probe_names = plain_names("probe", (p.name for p in model.probes))
    return replace(
        model,
        drives=tuple(replace(d, name=n) for d, n in zip(model.drives, drive_names, strict=True)),
        probes=tuple(replace(p, name=n) for p, n in zip(model.probes, probe_names, strict=True)),
    )


def _states(model: DynamicModel, plain_model: DynamicModel) -> SolverStates:
    states = solver_states(model)
    names = [s.name for s in solver_states(plain_model).states]
    renamed = (replace(s, name=n) for s, n in zip(states.states, names, strict=True))
    return replace(states, states=tuple(renamed))


def _first_two(variables: list[FmuVariable], model: DynamicModel) -> None:
    variables.append(
        FmuVariable(0, "time", "independent", "continuous", "simulation time", unit="s")
    )
    variables.append(
        FmuVariable(
            1,
            "interpolation",
            "parameter",
            "fixed",
            "co-simulation: 0 = a command jumps at the start of a step and holds, "
            "1 = it moves on a straight line from the last command to the new one over the step; "
            f"the internal step of the model is {model.step:g} s",
            start=0,
            integer=True,
            limits=(0, 1),
        )
    )


def _without_state(name: str, start: float) -> bool:
    """Return whether it is the bandwidth of a sensor without lag, for which there is no state."""
    return name.startswith("sensor.") and name.endswith(".bandwidth_hz") and start == 0.0


def _local(
    variables: Sequence[FmuVariable],
    name: str,
    unit: str,
    description: str,
    nominal: float | None = None,
    state: int | None = None,
) -> FmuVariable:
    return FmuVariable(
        len(variables),
        name,
        "local",
        "continuous",
        description,
        unit=unit,
        nominal=nominal,
        state=state,
    )


def usual_command(d: ModelDrive) -> float:
    """Return the nominal value of a command [V, m or N] and of the voltage; never 0."""
    ranges = [r for r in (d.amplifier and d.amplifier.voltage_range, d.input_range) if r]
    size = max((abs(v) for r in ranges for v in r if np.isfinite(v)), default=0.0)
    return size or {"V": 100.0, "m": 1e-5}.get(d.unit, 1.0)


def solver_states(model: DynamicModel) -> SolverStates:
    """Return the states of a model for the solver of an importer."""
    states: list[SolverState] = []
    outputs = [_usual_output(d) for d in model.drives]
    voltage_at = tuple(_voltage(states, d) for d in model.drives)
    lag_at = tuple(_lags(states, d, w) for d, w in zip(model.drives, outputs, strict=True))
    deflection_at = len(states)
    _modes(states, model, np.array(outputs))
    seen_at = tuple(_sensor(states, model, p, outputs) for p in range(len(model.probes)))
    return SolverStates(
        states=tuple(states),
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


def _voltage(states: list[SolverState], d: ModelDrive) -> int:
    if d.amplifier is None:
        return -1
    name, what = structured(f"{d.name}.amplifier.voltage"), f"voltage of the amplifier of {d.name}"
    states.append(SolverState(name, "V", "V/s", what, usual_command(d)))
    return len(states) - 1


def _lags(states: list[SolverState], d: ModelDrive, size: float) -> int:
    first, count = len(states), int(d.lag_weights.shape[1])
    unit = "N" if d.stiffness == 0.0 else "m"
    for j in range(1, count + 1):
        name = structured(f"{d.name}.creep.lag.{j}")
        what = f"lag {j} of the creep of drive {d.name}"
        states.append(SolverState(name, unit, f"{unit}/s", what, size))
    return first if count else -1


def _modes(states: list[SolverState], model: DynamicModel, outputs: np.ndarray) -> None:
    gains = np.abs(np.array([d.modal_gain for d in model.drives]))
    sizes = (gains * outputs[:, None]).max(axis=0)
    sizes = np.maximum(sizes, _SMALLEST_SHARE * sizes.max()) if sizes.any() else sizes + 1.0
    imposed = any(np.any(d.rate_time != 0.0) for d in model.drives)
    less = ", less the direct part of the imposed displacements" if imposed else ""
    for i, size in enumerate(sizes.tolist(), 1):
        what = f"deflection of mode {i}, scaled to a modal mass of 1 kg"
        states.append(SolverState(f"mode[{i}].deflection", "m", "m/s", what, size))
    for i, size in enumerate((sizes * model.omega).tolist(), 1):
        what = f"rate of mode {i}, scaled to a modal mass of 1 kg{less}"
        states.append(SolverState(f"mode[{i}].rate", "m/s", "m/s2", what, size))


def _sensor(states: list[SolverState], model: DynamicModel, p: int, outputs: list[float]) -> int:
    probe = model.probes[p]
    if probe.sensor is None or probe.sensor.bandwidth_hz is None:
        return -1
    k = model.omega.size
    at_rest = [
        abs(float(d.mode_weights[p, :k].sum() + d.feedthrough[p])) * w
        for d, w in zip(model.drives, outputs, strict=True)
    ]
    name = structured(f"sensor.{probe.name}.lag")
    what = f"motion of probe {probe.name} after the lag of its sensor"
    states.append(SolverState(name, probe.unit, f"{probe.unit}/s", what, max(at_rest) or 1e-6))
    return len(states) - 1


_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[[0-9]+(,[0-9]+)*\])?")


def identifier(name: str) -> str:
    """Return a valid identifier of C for a name.

    Examples
    --------
    >>> identifier("vgtu-piezo"), identifier("2 axes")
    ('vgtu_piezo', 'stage_2_axes')
    """
    letters = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return letters if re.match(r"[A-Za-z]", letters) else f"stage_{letters}".rstrip("_")


def plain_names(noun: str, names: Iterable[str]) -> list[str]:
    """Return a unique ASCII name of one part for each name of drives or probes.

    A name that begins with a digit, which would need quotes, gets the noun as prefix.

    Examples
    --------
    >>> plain_names("drive", ["x", "x.1", "x_1", "Kühler", "1"])
    ['x', 'x_1', 'x_1_2', 'Kuhler', 'drive_1']
    """
    unique: list[str] = []
    for name in names:
        base = re.sub(r"^(?=\d)", f"{noun}_", plain(name).replace(".", "_")) or "_"
        # these two are prefixes of other variables
        unique.append(free_name(base, {"mode", "sensor", *unique}.__contains__))
    return unique


def structured(name: str) -> str:
    """Return a dotted name in the structured naming convention of FMI.

    A number becomes the index of the part before it; other parts that are not identifiers are
    quoted.

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
