"""An FMU stepped by another program's importer gives the readings of the model in Python.

Evidence (Exported files): co-simulation under FMPy (`DynamicModel.simulate`): $10^{-11}$
"""

from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from flexstage.hysteresis import BoucWen, LogCreep, Sensor, dynamic_model
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from tests.fmu_parts import STEPPED, Run, Stepper, fmu_folder, model, needs_compiler
from tests.tiers import sizes

pytestmark = needs_compiler
# Both sides do the same operations in double precision; sums over sixty modes and thousands of
# steps differ by rounding alone. The promise to users is 1e-9.
_SAME = 1e-11


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu")


def _commands(made: DynamicModel, n: int, seed: int) -> dict[str, np.ndarray]:
    """Loops of two sines with noise and rests on them, within the range of each drive."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * made.step
    out = {}
    for d in made.drives:
        low, high = d.input_range or (-1.0, 1.0)
        f = rng.uniform(3.0, 300.0, 2)
        phase = rng.uniform(0.0, 6.0, 2)
        wave = np.sin(2.0 * np.pi * f[0] * t + phase[0]) * np.cos(2.0 * np.pi * f[1] * t + phase[1])
        wave += 0.05 * rng.normal(size=n)
        wave[n // 2 : n // 2 + n // 5] = wave[n // 2]
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        out[d.name] = np.clip(middle + 0.98 * half * wave, low, high)
    return out


def _agree(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray], within: float) -> None:
    for name, y in wanted.items():
        assert np.abs(found[name] - y).max() <= within * np.abs(y).max(), name
    # readings that are all nothing agree with anything; at least one probe moves
    assert max(np.ptp(y) for y in wanted.values()) > 1e-9


def _reference(made: DynamicModel, u: dict[str, np.ndarray], first: dict[str, float]) -> dict:
    return made.simulate(u, made.settled(first)).readings


@pytest.mark.parametrize("version", STEPPED)
@pytest.mark.parametrize("name", ["piezo", "bare", "screws", "humming"])
def test_readings_are_those_of_the_model(name: str, version: str, here: Path) -> None:
    made = model(name)
    u = _commands(made, 400, seed=3)
    first = {d: 0.37 * float(v[0]) for d, v in u.items()}
    run = Run(fmu_folder(here, name, version)).start({f"{d}.command": v for d, v in first.items()})
    settled = run.get([f"{p.name}.reading" for p in made.probes])
    found = Stepper(run, made).along(u)
    run.fmu.terminate()
    run.free()
    wanted = _reference(made, u, first)
    _agree(found, wanted, _SAME)
    rest = _reference(made, {d: np.full(1, v) for d, v in first.items()}, first)
    for value, p in zip(settled, made.probes, strict=True):
        if p.sensor is not None and p.sensor.mains_amplitude:
            # the mains go on for a step between the two
            continue
        assert value == pytest.approx(float(rest[p.name][0]), rel=1e-12, abs=1e-18)


def _many(count: int, here: Path, version: str) -> None:
    made = model("piezo")
    folder = fmu_folder(here, "piezo", version)
    run = Run(folder)
    for seed in range(count):
        u = _commands(made, 60, seed=100 + seed)
        first = {d: float(v[0]) for d, v in u.items()}
        run.start({f"{d}.command": v for d, v in first.items()})
        found = Stepper(run, made).along(u)
        _agree(found, _reference(made, u, first), _SAME)
        run.fmu.reset()
    run.free()


def test_twenty_random_inputs_with_a_reset_between_them(here: Path) -> None:
    _many(20, here, "3.0")


@pytest.mark.parametrize("count", sizes(slow=100, evidence=1000))
@pytest.mark.parametrize("version", STEPPED)
def test_many_random_inputs(version: str, here: Path, count: int) -> None:
    _many(count, here, version)


@pytest.mark.parametrize("version", STEPPED)
def test_a_second_of_the_full_stage(version: str, here: Path) -> None:
    made = model("piezo")
    u = _commands(made, 10_000, seed=11)
    first = {d: float(v[0]) for d, v in u.items()}
    run = Run(fmu_folder(here, "piezo", version)).start(
        {f"{d}.command": v for d, v in first.items()}
    )
    found = Stepper(run, made).along(u)
    run.free()
    _agree(found, _reference(made, u, first), _SAME)


def test_rates_of_the_commands_give_straight_lines(here: Path) -> None:
    # the end of each line is found by a rate: rounding of that, about 1e-16 of the command a step
    made = model("piezo")
    u = _commands(made, 500, seed=5)
    first = {d: float(v[0]) for d, v in u.items()}
    run = Run(fmu_folder(here, "piezo", "2.0"))
    run.start({f"{d}.command": v for d, v in first.items()}, line=False)
    found = Stepper(run, made).along(u, slopes=True)
    run.free()
    _agree(found, _reference(made, u, first), 1e-10)


def test_a_rate_holds_for_one_step(here: Path) -> None:
    made = model("bare")
    run = Run(fmu_folder(here, "bare", "2.0"))
    run.start({"x.command": 30.0, "y.command": 30.0}, line=False)
    run.fmu.setRealInputDerivatives([run.references["x.command"]], [1], [4e4])
    run.step(0.0, 1e-4)
    found = [run.get(["x.reading"])[0]]
    run.set({"x.command": 34.0})
    run.step(1e-4, 2e-4)
    found.append(run.get(["x.reading"])[0])
    with pytest.raises(FMICallException):
        run.fmu.setRealInputDerivatives([run.references["x.command"]], [2], [1.0])
    assert "of order 1" in run.messages[-1]
    run.free()
    u = {"x": np.array([34.0, 34.0, 34.0]), "y": np.full(3, 30.0)}
    wanted = _reference(made, u, {"x": 30.0, "y": 30.0})["x"]
    assert np.allclose(found, wanted[[0, 2]], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("version", STEPPED)
def test_a_step_of_seven_is_seven_steps_on_one_line(version: str, here: Path) -> None:
    made = model("piezo")
    u = _commands(made, 40, seed=7)
    first = {d: float(v[0]) for d, v in u.items()}
    run = Run(fmu_folder(here, "piezo", version)).start(
        {f"{d}.command": v for d, v in first.items()}
    )
    found = Stepper(run, made).along(u, every=7)
    run.free()
    k = np.arange(41) * 7
    fine = {
        d: np.interp(np.arange(1, 281), k, np.concatenate(([first[d]], v))) for d, v in u.items()
    }
    wanted = {p: y[6::7] for p, y in _reference(made, fine, first).items()}
    # points on a line are rounded in another order
    _agree(found, wanted, 1e-10)


@pytest.mark.parametrize("version", STEPPED)
@pytest.mark.parametrize("name", ["piezo", "bare"])
def test_a_command_jumps_and_holds_where_nothing_else_is_said(
    name: str, version: str, here: Path
) -> None:
    made = model(name)
    run = Run(fmu_folder(here, name, version)).start(
        {"x.command": 31.0, "y.command": 12.0}, line=False
    )
    u = {"x": np.array([88.0, 88.0, 23.0, 41.5]), "y": np.array([12.0, 67.0, 67.0, 9.0])}
    found = Stepper(run, made).along(u, every=5)
    run.free()
    memory = made.settled({"x": 31.0, "y": 12.0})
    wanted: dict[str, list[float]] = {"x": [], "y": []}
    for k in range(4):
        for d in made.drives:
            level = float(u[d.name][k])
            if d.amplifier is not None:
                memory.amplifiers[d.name][0] = level
            else:
                # the hysteresis passes through; no time goes by
                assert d.hysteresis is not None
                state = d.hysteresis.simulate([level], memory.hysteresis[d.name]).state
                memory.hysteresis[d.name] = state
                memory.amplifiers[d.name][:] = level
        held = {name: np.full(5, float(v[k])) for name, v in u.items()}
        moved = made.simulate(held, memory)
        memory = moved.state
        for p, values in wanted.items():
            values.append(float(moved.readings[p][-1]))
    _agree(found, {p: np.array(v) for p, v in wanted.items()}, _SAME)


@pytest.mark.parametrize("version", STEPPED)
def test_a_bad_step_is_refused_and_nothing_has_moved(version: str, here: Path) -> None:
    made = model("piezo")
    first = {"x.command": 40.0, "y.command": 20.0}
    u = _commands(made, 30, seed=13)
    folder = fmu_folder(here, "piezo", version)
    plain, tried = Run(folder).start(first), Run(folder).start(first)
    a, b = Stepper(plain, made), Stepper(tried, made)
    wanted = a.along({d: v[:10] for d, v in u.items()})
    b.along({d: v[:10] for d, v in u.items()})
    for size in (1.5e-4, 1.00001e-4, 0.0, -1e-4, float("nan")):
        message = tried.refused(b.time, size)
        assert "whole multiple of the step of the model, 0.0001 s" in message
        assert "use 0.0001 s" in message or "use 0.0002 s" in message
    assert "must start where the last one ended, at 0.001 s" in tried.refused(7e-3, 1e-4)
    found = b.along({d: v[10:] for d, v in u.items()})
    wanted = a.along({d: v[10:] for d, v in u.items()})
    for p, y in wanted.items():
        assert np.array_equal(found[p], y)
    plain.free()
    tried.free()


def test_an_importer_that_adds_up_its_steps_may_drift_by_rounding(here: Path) -> None:
    run = Run(fmu_folder(here, "bare", "3.0")).start({"x.command": 1.0, "y.command": 2.0})
    run.step(3e-6, 1.0000000004e-4)
    run.free()


@pytest.mark.parametrize("version", STEPPED)
def test_tuned_parameters_give_the_model_that_is_built_with_them(version: str, here: Path) -> None:
    made = model("piezo")
    x, y = made.drives
    assert isinstance(x.hysteresis, BoucWen)
    changed = BoucWen(
        gain=1.07 * x.hysteresis.gain,
        hysteresis_gain=x.hysteresis.hysteresis_gain,
        beta=0.81 * x.hysteresis.beta,
        gamma=x.hysteresis.gamma,
    )
    stage = design("vgtu-piezo")
    other = dynamic_model(
        stage,
        lumped_system(stage),
        bandwidth=1900.0,
        current=0.2,
        creep=LogCreep(rate_per_decade=0.029),
        hysteresis={"x": changed, "y": y.hysteresis},  # type: ignore[dict-item]
        sensors={"x": Sensor(gain=0.97, offset=2e-8, bandwidth_hz=2300.0)},
    )
    run = Run(fmu_folder(here, "piezo", version))
    run.set(
        {
            "x.hysteresis.gain": changed.gain,
            "x.hysteresis.beta": changed.beta,
            "x.creep.rate_per_decade": 0.029,
            "y.creep.rate_per_decade": 0.029,
            "sensor.x.gain": 0.97,
            "sensor.x.bandwidth_hz": 2300.0,
        }
    )
    first = {"x": 22.0, "y": 61.0}
    run.start({f"{d}.command": v for d, v in first.items()})
    u = _commands(made, 300, seed=17)
    found = Stepper(run, made).along(u)
    wanted = _reference(other, u, first)
    _agree(found, wanted, 1e-10)
    as_exported = _reference(made, u, first)
    assert np.abs(wanted["x"] - as_exported["x"]).max() > 0.01 * np.ptp(wanted["x"])
    # while it runs: the state stays, the tables are new
    run.set({"mode[1].frequency_hz": 777.0})
    assert run.get(["mode[1].frequency_hz"]) == [777.0]
    more = _commands(made, 50, seed=18)
    stepper = Stepper(run, made)
    stepper.time = 300 * made.step
    tuned = stepper.along(more)
    run.fmu.reset()
    assert run.get(["mode[1].frequency_hz"])[0] == pytest.approx(made.omega[0] / (2 * np.pi))
    run.free()
    assert np.all(np.isfinite(tuned["x"]))


@pytest.mark.parametrize("version", STEPPED)
def test_ten_instances_do_not_know_of_one_another(version: str, here: Path) -> None:
    made = model("piezo")
    folder = fmu_folder(here, "piezo", version)
    waves = [_commands(made, 40, seed=200 + k) for k in range(10)]
    runs = [Run(folder).start({f"{d}.command": float(v[0]) for d, v in u.items()}) for u in waves]
    steppers = [Stepper(run, made) for run in runs]
    found = [{p.name: [] for p in made.probes} for _ in waves]
    for k in range(40):
        for u, stepper, out in zip(waves, steppers, found, strict=True):
            for p, y in stepper.along({d: v[k : k + 1] for d, v in u.items()}).items():
                out[p].append(float(y[0]))
    for run in runs:
        run.free()
    for u, out in zip(waves, found, strict=True):
        wanted = _reference(made, u, {d: float(v[0]) for d, v in u.items()})
        _agree({p: np.array(y) for p, y in out.items()}, wanted, _SAME)


@pytest.mark.parametrize("version", STEPPED)
def test_calls_out_of_order_and_bad_values_are_refused_with_a_message(
    version: str, here: Path
) -> None:
    run = Run(fmu_folder(here, "piezo", version))
    assert "instantiated" in run.refused(0.0, 1e-4)

    def message(call: str) -> str:
        return run.messages[-1] if call else ""

    with pytest.raises(FMICallException):
        run.interpolate(2)
    assert message("interpolation") == "interpolation must be 0 (hold) or 1 (line), got 2"
    with pytest.raises(FMICallException):
        run.set({"x.command": float("nan")})
    assert "finite" in message("nan")
    with pytest.raises(FMICallException):
        run.set({"x.reading": 1.0})
    assert "only inputs and parameters" in message("output")
    run.start({"x.command": 5.0, "y.command": 5.0})
    with pytest.raises(FMICallException):
        run.interpolate(0)
    run.set({"mode[3].frequency_hz": -5.0})
    assert "frequency of a mode" in run.refused(0.0, 1e-4)
    # another value mends it
    run.set({"mode[3].frequency_hz": 4000.0})
    run.step(0.0, 1e-4)
    run.fmu.terminate()
    assert "terminated" in run.refused(1e-4, 1e-4)
    run.free()


@pytest.mark.parametrize("version", STEPPED)
def test_a_library_of_another_description_is_not_started(version: str, here: Path) -> None:
    folder = fmu_folder(here, "bare", version)
    with pytest.raises(Exception, match=r"[Ff]ailed to instantiate"):
        Run(folder, token="{00000000-0000-4000-8000-000000000000}")
