r"""An FMU under another program's solver gives the readings of the model in Python.

Evidence (Exported files): model exchange, jumps, CVode (`DynamicModel`): $3\cdot10^{-6}$
"""

import ctypes
import itertools
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexstage.hysteresis.dynamic_model import DynamicModel
from tests.fmu_parts import STEPPED, Run, fmu_folder, model, needs_compiler

pytestmark = needs_compiler
_REST = {"x": 20.0, "y": 30.0}


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu")


def _ready(folder: Path, first: dict[str, float]) -> Run:
    """An instance at its first continuous-time mode, as a solver finds it."""
    run = Run(folder, exchange=True).start(
        {f"{d}.command": v for d, v in first.items()}, line=False
    )
    _event(run)
    return run


def _event(run: Run) -> None:
    if run.second:
        run.fmu.newDiscreteStates()
    else:
        run.fmu.updateDiscreteStates()
    run.fmu.enterContinuousTimeMode()


def _solve(run: Run, times: np.ndarray, commands: Callable[[float], dict[str, float]],
           names: list[str], rtol: float = 1e-11) -> np.ndarray:  # fmt: skip
    """Readings at `times`, each a completed integrator step, by a Runge-Kutta method of order 8."""
    n = run.description.numberOfContinuousStates
    x, rate, nominal = (np.zeros(n) for _ in range(3))
    run.fmu.getContinuousStates(_pointer(x), n)
    run.fmu.getNominalsOfContinuousStates(_pointer(nominal), n)

    def f(t: float, y: np.ndarray) -> np.ndarray:
        run.fmu.setTime(t)
        run.set(commands(t))
        run.fmu.setContinuousStates(_pointer(np.ascontiguousarray(y)), n)
        get = run.fmu.getDerivatives if run.second else run.fmu.getContinuousStateDerivatives
        get(_pointer(rate), n)
        return rate.copy()

    out = []
    for before, t in itertools.pairwise(times):
        found = solve_ivp(f, (before, t), x, method="DOP853", rtol=rtol, atol=1e-12 * nominal)
        x = found.y[:, -1]
        f(t, x)
        run.fmu.completedIntegratorStep()
        out.append(run.get(names))
    return np.array(out).T


def _pointer(a: np.ndarray):  # type: ignore[no-untyped-def]
    return a.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _lines(made: DynamicModel, times: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Corners of the commands, the first of them the rest from which all begins."""
    rng = np.random.default_rng(seed)
    out = {}
    for d in made.drives:
        low, high = d.input_range or (-1.0, 1.0)
        out[d.name] = low + (high - low) * rng.uniform(0.02, 0.98, times.size)
    return out


def _exact(name: str, version: str, here: Path, within: float) -> None:
    """Without amplifier and lag of a sensor both are exact for straight lines."""
    made = model(name)
    times = np.arange(13) * made.step
    u = _lines(made, times, seed=29)
    first = {d: float(v[0]) for d, v in u.items()}
    run = _ready(fmu_folder(here, name, version), first)

    def commands(t: float) -> dict[str, float]:
        return {f"{d}.command": float(np.interp(t, times, v)) for d, v in u.items()}

    found = _solve(run, times, commands, [f"{p.name}.reading" for p in made.probes])
    run.free()
    wanted = made.simulate({d: v[1:] for d, v in u.items()}, made.settled(first)).readings
    for p, y in zip(made.probes, found, strict=True):
        assert np.abs(y - wanted[p.name]).max() <= within * np.abs(wanted[p.name]).max(), p.name


# the solver is asked for eleven digits a step; its many steps lose some of them
@pytest.mark.parametrize("version", STEPPED)
@pytest.mark.parametrize("name", ["bare", "relaxing"])
def test_stacks_with_hysteresis_follow_straight_lines(name: str, version: str, here: Path) -> None:
    _exact(name, version, here, 1e-8)


@pytest.mark.parametrize("version", STEPPED)
def test_imposed_displacements_need_no_rate_of_the_command(version: str, here: Path) -> None:
    # the corners of the command are blows to the modes through the damping: exact in both
    _exact("screws", version, here, 1e-8)


def _stairs(version: str, here: Path, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Jumps of both commands under FMPy and CVode, and the model at a hundredth of the step."""
    end, fine = 0.01, 1e-6
    rows = [
        (0.0, 20.0, 30.0), (0.002, 20.0, 30.0), (0.002, 95.0, 30.0), (0.0053, 95.0, 30.0),
        (0.0053, 50.0, 71.0), (end, 50.0, 71.0),
    ]  # fmt: skip
    kinds = [("time", "f8"), ("x.command", "f8"), ("y.command", "f8")]
    result = fmpy.simulate_fmu(
        str(fmu_folder(here, "piezo", version)),
        fmi_type="ModelExchange",
        solver="CVode",
        stop_time=end,
        output_interval=1e-4,
        relative_tolerance=tolerance,
        input=np.array(rows, dtype=kinds),
        output=["x.reading", "y.reading"],
        record_events=False,
        start_values={"x.command": 20.0, "y.command": 30.0},
    )
    made = model("piezo", fine)
    memory = made.settled(_REST)
    wanted: dict[str, list[float]] = {"x": [], "y": []}
    for first, last in zip(rows[::2], rows[1::2], strict=True):
        n = round((last[0] - first[0]) / fine)
        levels = dict(zip(("x", "y"), first[1:], strict=True))
        for d, level in levels.items():
            memory.amplifiers[d][0] = level
        moved = made.simulate({d: np.full(n, v) for d, v in levels.items()}, memory)
        memory = moved.state
        for p in wanted:
            wanted[p] += moved.readings[p].tolist()
    found = np.array([result["x.reading"], result["y.reading"]])[:, 1:]
    return found, np.array([wanted[p][99::100] for p in ("x", "y")])


@pytest.mark.parametrize("version", STEPPED)
def test_the_full_stage_answers_jumps_under_cvode(version: str, here: Path) -> None:
    # amplifier that slews and follows, reversal in it, hysteresis, creep, 60 modes, lag of the
    # sensor. Measured 3e-7 to 7e-7 of the stroke: the solver at 1e-6, and the reference, which
    # takes the voltage as straight within 1 us.
    found, wanted = _stairs(version, here, 1e-6)
    assert np.all(np.abs(found - wanted).max(axis=1) < 3e-6 * np.abs(wanted).max(axis=1))
    assert np.all(np.ptp(wanted, axis=1) > 1e-5)


@pytest.mark.parametrize("version", STEPPED)
def test_the_voltage_stays_within_the_range_and_leaves_it_again(version: str, here: Path) -> None:
    # the range ends at 120 V; the command goes to 180 V and comes back
    rows = [(0.0, 20.0, 30.0), (0.001, 20.0, 30.0), (0.001, 180.0, -40.0), (0.006, 180.0, -40.0),
            (0.006, 100.0, 30.0), (0.01, 100.0, 30.0)]  # fmt: skip
    result = fmpy.simulate_fmu(
        str(fmu_folder(here, "piezo", version)),
        fmi_type="ModelExchange",
        stop_time=0.01,
        output_interval=1e-4,
        relative_tolerance=1e-6,
        input=np.array(rows, dtype=[("time", "f8"), ("x.command", "f8"), ("y.command", "f8")]),
        output=["x.voltage", "y.voltage"],
        record_events=False,
        start_values={"x.command": 20.0, "y.command": 30.0},
    )
    time, x, y = result["time"], result["x.voltage"], result["y.voltage"]
    # by the current 0.2 A into the stack, 31 or so kV/s: the end is met after 3.2 ms
    d = model("piezo").drives[0]
    assert d.amplifier is not None
    rate = d.amplifier.largest_rate
    rising = (time > 0.001 + 1e-9) & (time < 0.001 + 95.0 / rate)
    assert np.allclose(x[rising], 20.0 + rate * (time[rising] - 0.001), rtol=0.0, atol=1e-3)
    top = (time > 0.001 + 101.0 / rate) & (time <= 0.006 + 1e-9)
    assert np.all(x[top] == 120.0)
    assert np.all(y[(time > 0.004) & (time <= 0.006 + 1e-9)] == 0.0)
    late = d.amplifier.time_constant
    slewing = max(0.0, 20.0 - rate * late) / rate
    follows = time > 0.006 + slewing + 1e-4
    gone = 20.0 - rate * slewing
    wanted = 100.0 + gone * np.exp(-(time[follows] - 0.006 - slewing) / late)
    assert np.allclose(x[follows], wanted, rtol=0.0, atol=2e-2)
    assert abs(x[-1] - 100.0) < 1e-2


@pytest.mark.parametrize("version", STEPPED)
@pytest.mark.parametrize("name", ["piezo", "screws"])
def test_nothing_depends_on_what_it_is_not_said_to_depend_on(
    name: str, version: str, here: Path
) -> None:
    made = model(name)
    first = {d.name: 0.3 * (d.input_range or (0.0, 1.0))[1] for d in made.drives}
    run = _ready(fmu_folder(here, name, version), first)
    description = run.description
    n = description.numberOfContinuousStates
    x, nominal = np.zeros(n), np.zeros(n)
    run.fmu.getContinuousStates(_pointer(x), n)
    run.fmu.getNominalsOfContinuousStates(_pointer(nominal), n)
    unknowns = [*description.derivatives, *description.outputs]
    names = [u.variable.name for u in unknowns]
    states = [d.variable.derivative.name for d in description.derivatives]

    def values() -> np.ndarray:
        return np.array(run.get(names))

    base = values()
    moved: dict[str, np.ndarray] = {}
    for k, state in enumerate(states):
        changed = x.copy()
        changed[k] += 0.37 * nominal[k]
        run.fmu.setContinuousStates(_pointer(changed), n)
        moved[state] = values() != base
    run.fmu.setContinuousStates(_pointer(x), n)
    for d in made.drives:
        command = f"{d.name}.command"
        run.set({command: first[d.name] * 1.3 + 1e-7})
        moved[command] = values() != base
        run.set({command: first[d.name]})
    run.free()
    seen = 0
    for k, unknown in enumerate(unknowns):
        said = {v.name for v in unknown.dependencies}
        does = {source for source, rows in moved.items() if rows[k]}
        assert does <= said, unknown.variable.name
        seen += len(does)
    # each mode at least by its deflection and its rate
    assert seen > 4 * made.omega.size


@pytest.mark.parametrize("version", STEPPED)
def test_mains_and_steps_of_a_sensor_are_those_of_the_samples(version: str, here: Path) -> None:
    made = model("humming")
    drive, probe = made.drives[0].name, made.probes[0].name
    level = 0.4 if made.drives[0].unit == "N" else 0.4e-5
    run = _ready(fmu_folder(here, "humming", version), {drive: level})
    held = {d.name: np.full(60, level if d.name == drive else 0.0) for d in made.drives}
    wanted = made.simulate(held, made.settled({drive: level})).readings[probe]
    found = []
    for k in range(60):
        run.fmu.setTime((k + 1) * made.step)
        found += run.get([f"{probe}.reading"])
    run.free()
    assert np.ptp(wanted) > 1e-8
    assert np.allclose(found, wanted, rtol=0.0, atol=1e-14)


def test_derivatives_are_those_of_the_states(here: Path) -> None:
    """A short straight step of the solver's own states, by differences."""
    run = _ready(fmu_folder(here, "piezo", "3.0"), _REST)
    run.set({"x.command": 60.0})
    run.fmu.enterEventMode()
    _event(run)
    assert run.get(["der(x.amplifier.voltage)"])[0] == pytest.approx(
        model("piezo").drives[0].amplifier.largest_rate  # type: ignore[union-attr]
    )
    n = run.description.numberOfContinuousStates
    x, rate = np.zeros(n), np.zeros(n)
    run.fmu.getContinuousStates(_pointer(x), n)
    run.fmu.getContinuousStateDerivatives(_pointer(rate), n)
    names = [v.variable.name for v in run.description.derivatives]
    assert np.array_equal(rate, run.get(names))
    states = [v.variable.derivative.name for v in run.description.derivatives]
    assert np.array_equal(x, run.get(states))
    run.free()
