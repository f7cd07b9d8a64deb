"""The states that an importer's solver sees: names, units, usual sizes, and their order."""

from dataclasses import dataclass

import numpy as np

from flexstage.export.fmu.names import structured
from flexstage.export.model import DynamicModel, ModelDrive

_SMALLEST_SHARE = 1e-6  # of the largest usual size, for modes that hardly move


@dataclass(frozen=True, slots=True)
class SolverState:
    """A state of the differential equations."""

    name: str
    """Its name."""
    unit: str
    """Unit of the state and of its derivative."""
    rate_unit: str
    """Unit of the state and of its derivative."""
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
    """Where the voltage and the first lag of each drive are; -1 for none."""
    lag_at: tuple[int, ...]
    """Where the voltage and the first lag of each drive are; -1 for none."""
    deflection_at: int
    """Where the deflections of the modes begin; their rates come right after."""
    seen_at: tuple[int, ...]
    """Where the lag of the sensor of each probe is; -1 for none."""


def usual_command(d: ModelDrive) -> float:
    """Return the usual size of the command of a drive, which is that of its voltage too."""
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
