"""Saved states of an FMU: restored, serialised, and refused where they do not belong."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.fmu_parts import STEPPED, Run, Stepper, fmu_folder, model, needs_compiler

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu")


def _wave(n: int, seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {"x": 60.0 + 50.0 * rng.uniform(-1, 1, n), "y": 50.0 + 40.0 * rng.uniform(-1, 1, n)}


_FIRST = {"x.command": 33.0, "y.command": 71.0}


@pytest.mark.parametrize("version", STEPPED)
def test_a_restored_state_goes_on_with_the_same_bits(version: str, here: Path) -> None:
    made = model("piezo")
    run = Run(fmu_folder(here, "piezo", version)).start(_FIRST)
    stepper = Stepper(run, made)
    stepper.along(_wave(50, 1))
    run.set({"x.hysteresis.gain": 3.3e-7})
    state, time = run.fmu.getFMUState(), stepper.time
    first = stepper.along(_wave(60, 2))
    stepper.along(_wave(10, 3))
    run.fmu.setFMUState(state)
    stepper.time = time
    second = stepper.along(_wave(60, 2))
    for p in first:
        assert np.array_equal(first[p], second[p])
    # the state came with its parameters
    assert run.get(["x.hysteresis.gain"]) == [3.3e-7]
    run.fmu.freeFMUState(state)
    assert not state
    run.free()


@pytest.mark.parametrize("version", STEPPED)
def test_a_serialised_state_goes_on_in_another_instance(version: str, here: Path) -> None:
    made = model("piezo")
    folder = fmu_folder(here, "piezo", version)
    run = Run(folder).start(_FIRST)
    stepper = Stepper(run, made)
    stepper.along(_wave(50, 4))
    state = run.fmu.getFMUState()
    data = run.fmu.serializeFMUState(state)
    wanted = stepper.along(_wave(40, 5))
    run.fmu.freeFMUState(state)
    run.free()
    other = Run(folder).start({"x.command": 0.0, "y.command": 0.0})
    state = other.fmu.deserializeFMUState(data)
    other.fmu.setFMUState(state)
    goes_on = Stepper(other, made)
    goes_on.time = 50 * made.step
    found = goes_on.along(_wave(40, 5))
    for p in wanted:
        assert np.array_equal(wanted[p], found[p])
    other.fmu.freeFMUState(state)
    other.free()


@pytest.mark.parametrize("version", STEPPED)
def test_states_that_do_not_belong_are_refused(version: str, here: Path) -> None:
    run = Run(fmu_folder(here, "piezo", version)).start(_FIRST)
    state = run.fmu.getFMUState()
    data = bytearray(run.fmu.serializeFMUState(state))
    data[len(data) // 2] ^= 1
    with pytest.raises(FMICallException):
        run.fmu.deserializeFMUState(bytes(data))
    assert "damaged" in run.messages[-1]
    with pytest.raises(FMICallException):
        run.fmu.deserializeFMUState(bytes(data[:-8]))
    assert "damaged" in run.messages[-1]
    with pytest.raises(FMICallException):
        run.fmu.deserializeFMUState(b"")
    other = Run(fmu_folder(here, "bare", version)).start(_FIRST)
    with pytest.raises(FMICallException):
        other.fmu.setFMUState(state)
    assert "another model" in other.messages[-1]
    exchange = Run(fmu_folder(here, "piezo", version), exchange=True).start(_FIRST)
    with pytest.raises(FMICallException):
        exchange.fmu.setFMUState(state)
    assert "co-simulation" in exchange.messages[-1]
    with pytest.raises(FMICallException):
        run.fmu.setFMUState(ctypes.c_void_p())
    run.fmu.freeFMUState(state)
    for each in (run, other, exchange):
        each.free()


@pytest.mark.parametrize("version", STEPPED)
def test_looking_at_states_of_the_solver_does_not_change_the_steps(
    version: str, here: Path
) -> None:
    made = model("piezo")
    folder = fmu_folder(here, "piezo", version)
    u = _wave(30, 6)
    plain, looked = Run(folder).start(_FIRST), Run(folder).start(_FIRST)
    wanted = Stepper(plain, made).along(u)
    names = [v.name for v in looked.description.modelVariables if v.causality == "local"]
    stepper, found = Stepper(looked, made), []
    for k in range(30):
        y = stepper.along({d: v[k : k + 1] for d, v in u.items()})
        values = looked.get(names)
        assert np.all(np.isfinite(values))
        found.append(y["x"][0])
    assert np.array_equal(wanted["x"], found)
    # what the modes of the solver read is what the probe saw
    k = made.omega.size
    q = looked.get([f"mode[{i + 1}].deflection" for i in range(k)])
    y_found = float(made.probe_shapes[1] @ np.array(q))
    assert y_found == pytest.approx(float(wanted["y"][-1]), rel=1e-12)
    plain.free()
    looked.free()
