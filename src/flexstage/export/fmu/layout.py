"""The variables of an FMU, their value references, and the states that a solver sees."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from flexstage.export.fmu.names import identifier, plain_names, structured
from flexstage.export.fmu.solver_states import SolverStates, solver_states, usual_command
from flexstage.export.model import DynamicModel
from flexstage.export.source.variables import c_variables

Causality = Literal["independent", "parameter", "input", "output", "local"]

#: Events of an amplifier, in the order in which the C code counts them.
INDICATORS = (
    ("turn", "how far the voltage is from turning"),
    ("slew", "how far the amplifier is from its largest rate"),
    ("top", "how far the voltage is from the top of its range"),
    ("bottom", "how far the voltage is from the bottom of its range"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
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
                    reference=len(found),
                    name=structured(v.name),
                    causality=v.causality,
                    variability="tunable" if kind == "parameter" else "continuous",
                    description=v.description,
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
    for d, plain in zip(model.drives, named.drives, strict=True):
        if d.amplifier is not None:
            for name, what in INDICATORS:
                text = f"event of the amplifier of drive {d.name}: {what}"
                called = structured(f"{plain.name}.amplifier.{name}")
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
    drives = plain_names(d.name for d in model.drives)
    probes = plain_names(p.name for p in model.probes)
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
    found.append(
        FmuVariable(
            reference=0,
            name="time",
            causality="independent",
            variability="continuous",
            description="simulation time",
            unit="s",
        )
    )
    found.append(
        FmuVariable(
            reference=1,
            name="interpolation",
            causality="parameter",
            variability="fixed",
            description="co-simulation: 0 = a command jumps at the start of a step and holds, "
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
        reference=len(found),
        name=name,
        causality="local",
        variability="continuous",
        description=description,
        unit=unit,
        nominal=nominal,
        state=state,
    )
