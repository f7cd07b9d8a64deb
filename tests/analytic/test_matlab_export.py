"""What a .mat file says equals the stage that it is made of."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.linalg import eigh

from flexstage.export.control_object import control_system, linear_part, rest_shape
from flexstage.export.matlab import damping_matrix, matlab_files, matlab_name, sampled_form
from flexstage.hysteresis import BoucWen, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import LossFactor, RayleighDamping, frequency_response, modes, time_response

_STAGES = {name: design(name) for name in ("vgtu-piezo", "vgtu-mechanical")}
_SYSTEMS = {name: lumped_system(stage) for name, stage in _STAGES.items()}
_BOTH = pytest.mark.parametrize("name", list(_STAGES))
_STACK = BoucWen(gain=0.37e-6, hysteresis_gain=0.09e-6, beta=0.043, gamma=0.021)


def _loaded(name: str, **choices) -> dict:
    stage, system = _STAGES[name], _SYSTEMS[name]
    model = dynamic_model(stage, system, **choices)
    files = matlab_files(stage, model)
    found = loadmat(
        io.BytesIO(files[f"{matlab_name(name)}.mat"]), squeeze_me=True, struct_as_record=False
    )
    return found | {"model": model}


@_BOTH
def test_mass_damping_and_stiffness_give_the_response_of_the_system(name: str) -> None:
    """The equations of motion as a reader of the file would write them, solved as they are."""
    system = _SYSTEMS[name].with_damping(LossFactor(eta=0.083))
    model = dynamic_model(_STAGES[name], system, hysteresis="none")
    file = matlab_files(_STAGES[name], model)[f"{matlab_name(name)}.mat"]
    data = loadmat(io.BytesIO(file))
    held = data["held_vectors"].reshape(system.order, -1)
    m = held.shape[1]
    stiff = [d.stiffness or 1.0 for d in system.drives]
    f = np.array([0.7, 93.0, 907.0, 2703.0, 11000.0])
    for i, drive in enumerate(system.drives):
        right = np.zeros(system.order + m)
        if m:
            right[system.order + i] = 1.0
        else:
            right[: system.order] = stiff[i] * data["drive_vectors"][:, i]
        found = []
        for g in f:
            w = 2.0 * np.pi * g
            own = data["K_in_place"] + 1j * w * data["C_damping"] - w**2 * data["M"]
            saddle = np.block([[own, held], [held.T, np.zeros((m, m))]])
            found.append(data["probe_vectors"] @ np.linalg.solve(saddle, right)[: system.order])
        wanted = np.array(
            [
                frequency_response(system, f, drive.name, p.name, drives="in place").value
                for p in system.probes
            ]
        ).T
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        # 60 equations whose stiffnesses span seven decades
        assert np.all(np.abs(found - wanted) < 1e-7 * scale)


def test_the_damping_matrix_is_rayleighs_where_that_is_given() -> None:
    system = _SYSTEMS["vgtu-piezo"].with_damping(RayleighDamping(alpha=3.7, beta=2.3e-7))
    added, _ = system.drive_springs("in place")
    wanted = 3.7 * system.M + 2.3e-7 * (system.K + added)
    assert np.abs(damping_matrix(system) - wanted).max() < 1e-9 * np.abs(wanted).max()


@_BOTH
def test_modes_of_the_file_solve_its_matrices(name: str) -> None:
    data = _loaded(name)
    base = np.eye(len(data["M"]))
    if data["held_vectors"].size:
        base = np.linalg.svd(data["held_vectors"].T)[2][data["held_vectors"].shape[1] :].T
    squares = eigh(base.T @ data["K_in_place"] @ base, base.T @ data["M"] @ base, eigvals_only=True)
    assert data["omega"] == pytest.approx(np.sqrt(squares), rel=1e-7)
    shapes = data["shapes"]
    assert shapes.T @ data["M"] @ shapes == pytest.approx(np.eye(shapes.shape[1]), abs=1e-9)
    assert data["A"].shape == (2 * data["omega"].size,) * 2
    assert data["frequency_hz"] == pytest.approx(data["omega"] / 6.283185307179586, rel=1e-14)


@pytest.mark.parametrize("hold", ["lines", "shifted", "held"])
def test_one_step_is_that_of_the_continuous_equations(hold: str) -> None:
    """The recursions of the file against scipy's continuous simulation in fine steps."""
    creep = LogCreep(rate_per_decade=0.06, shortest=3e-4, longest=0.05)
    stage, system = _STAGES["vgtu-piezo"], _SYSTEMS["vgtu-piezo"]
    model = dynamic_model(
        stage, system, time_step=1.3e-4, hysteresis={"y": _STACK}, creep=creep, keep_modes=3
    )
    form = linear_part(model)
    data = loadmat(io.BytesIO(matlab_files(stage, model)["vgtu_piezo.mat"]))
    rng = np.random.default_rng(37)
    w = rng.normal(size=(25, 2)) * 1e-5
    from scipy.integrate import solve_ivp

    state = rng.normal(size=form.A.shape[0]) * 1e-6
    state[3:6] *= 1e4  # rates
    x = state.copy()
    if hold == "shifted":
        x = x - data["Bd_end"] @ w[0]
    for i in range(24):

        def rates(t: float, s: np.ndarray, i: int = i) -> np.ndarray:
            share = 0.0 if hold == "held" else t / model.step
            return form.A @ s + form.B @ (w[i] + share * (w[i + 1] - w[i]))

        run = solve_ivp(rates, (0.0, model.step), state, method="DOP853", rtol=1e-11, atol=1e-17)
        state = run.y[:, -1]
        # the integrator's tolerance, and 1e-17 m of its own, in 24 steps
        wanted = form.C @ state + form.D @ w[i + 1]
        if hold == "lines":
            x = data["Ad"] @ x + data["Bd_start"] @ w[i] + data["Bd_end"] @ w[i + 1]
            found = data["C"] @ x + data["D"] @ w[i + 1]
        elif hold == "shifted":
            x = data["Ad"] @ x + data["Bd"] @ w[i]
            found = data["Cd"] @ x + data["Dd"] @ w[i + 1]
        else:
            x = data["Ad"] @ x + data["Bd_held"] @ w[i]
            found = data["C"] @ x + data["Dd_held"] @ w[i + 1]
        assert found == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())


def test_the_step_of_all_modes_equals_the_response_in_time() -> None:
    system = _SYSTEMS["vgtu-piezo"]
    model = dynamic_model(_STAGES["vgtu-piezo"], system, hysteresis="none")
    step, form = sampled_form(model), linear_part(model)
    n = 300
    t = np.arange(n) * model.step
    w = np.column_stack(
        (1e-5 * np.sin(2.0 * np.pi * 71.0 * t), 7e-6 * np.sin(2.0 * np.pi * 903.0 * t))
    )
    wanted = time_response(system, t, {"x": w[:, 0], "y": w[:, 1]}).readings
    x = np.zeros(form.A.shape[0])
    found = [form.C @ x]
    for i in range(1, n):
        x = step.transition @ x + step.start @ w[i - 1] + step.end @ w[i]
        found.append(form.C @ x + form.D @ w[i])
    for j, p in enumerate(model.probes):
        error = np.abs(np.array(found)[:, j] - wanted[p.name]).max()
        # sums over sixty modes in another order, 300 steps
        assert error < 1e-11 * np.abs(wanted["x"]).max()


def test_states_at_rest_stand_still() -> None:
    creep = LogCreep(rate_per_decade=0.021)
    for name, stage in _STAGES.items():
        model = dynamic_model(stage, _SYSTEMS[name], creep=creep)
        form, rest = linear_part(model), rest_shape(model)
        pull = np.abs(form.A) @ np.abs(rest) + np.abs(form.B)
        assert np.all(np.abs(form.A @ rest + form.B) <= 1e-13 * pull)
        # and read what the model reads there
        commands = {d.name: 0.21 * (i + 1) for i, d in enumerate(model.drives)}
        settled = model.simulate({key: [u] for key, u in commands.items()})
        w = [
            d.gain * commands[d.name]
            if d.hysteresis is None
            else float(d.hysteresis.simulate([commands[d.name]]).values[0])
            for d in model.drives
        ]
        found = (form.C @ rest + form.D) @ w
        assert found == pytest.approx(
            [settled.readings[p.name][0] for p in model.probes], rel=1e-11
        )
        assert settled.state.deflections["x"] == pytest.approx(w[0], rel=1e-11)


def test_the_file_names_everything() -> None:
    data = _loaded(
        "vgtu-piezo",
        hysteresis={"x": _STACK},
        creep=LogCreep(rate_per_decade=0.021),
        bandwidth=1700.0,
        sensors={"y": Sensor(gain=1.02, bandwidth_hz=900.0)},
    )
    model = data["model"]
    assert list(data["inputs"]) == ["x [m]", "y [m]"]
    assert list(data["outputs"]) == ["x [m]", "y [m]"]
    assert len(data["states"]) == data["A"].shape[0] == 2 * model.omega.size + 10
    assert list(data["coordinates"]) == list(_SYSTEMS["vgtu-piezo"].coordinates)
    x, y = data["drives"]
    assert (x.name, x.unit, x.hysteresis.kind, y.hysteresis.kind) == ("x", "V", "bouc-wen", "none")
    assert x.hysteresis.beta == 0.043
    assert x.hysteresis.hysteresis_gain == 0.09e-6
    assert list(x.input_range) == list(model.drives[0].input_range)
    assert x.amplifier.bandwidth_hz == 1700.0
    assert x.creep.time_constants.size == 10
    assert y.creep.time_constants.size == 0
    assert (data["probes"][0].sensor.present, data["probes"][1].sensor.gain) == (0.0, 1.02)
    assert data["step"] == model.step
    for note in model.notes:
        assert note in list(data["notes"])


def test_the_same_stage_gives_the_same_bytes_and_no_date() -> None:
    stage, system = _STAGES["vgtu-mechanical"], _SYSTEMS["vgtu-mechanical"]
    model = dynamic_model(stage, system)
    first, again = (matlab_files(stage, model, name="screws") for _ in range(2))
    assert first == again
    assert set(first) == {"screws.mat", "screws.m", "screws_step.m"}
    assert first["screws.mat"][:10] == b"MATLAB 5.0"
    assert not re.search(rb"Created on|20\d\d", first["screws.mat"][:116])
    for script in ("screws.m", "screws_step.m"):
        text = first[script].decode("ascii")
        assert "STAGE_" not in text
        assert "FLEXSTAGE_" not in text
        assert max(map(len, text.splitlines())) <= 110


def test_names_are_made_ones_that_matlab_takes() -> None:
    assert matlab_name("vgtu-piezo") == "vgtu_piezo"
    assert matlab_name("ÄÖ") == "stage"
    assert len(matlab_name("a" * 90) + "_step") == 63


@_BOTH
def test_python_control_gets_the_linear_part_with_names(name: str) -> None:
    pytest.importorskip("control", reason="python-control is an optional dependency")
    system = _SYSTEMS[name]
    f = 431.0
    for source in (system, dynamic_model(_STAGES[name], system)):
        made = control_system(source)
        assert made.input_labels == ["x [m]", "y [m]"]
        response = made(2j * np.pi * f)
        for i, probe in enumerate(system.probes):
            for j, drive in enumerate(system.drives):
                wanted = frequency_response(system, [f], drive.name, probe.name, drives="in place")
                # one axis answers the other's drive with a rounding
                assert abs(response[i, j] - wanted.value[0]) < 1e-9


def test_the_linear_part_of_creep_answers_as_its_parts() -> None:
    creep = LogCreep(rate_per_decade=0.031)
    system = replace(_SYSTEMS["vgtu-piezo"], probes=_SYSTEMS["vgtu-piezo"].probes[:1])
    model = dynamic_model(_STAGES["vgtu-piezo"], system, hysteresis={"x": _STACK}, creep=creep)
    form = linear_part(model)
    assert form.B.shape == (2 * modes(system, count=None).omega.size + 10, 2)
    for f in (0.002, 0.7, 905.0):
        s = 2j * np.pi * f
        found = form.C @ np.linalg.solve(s * np.eye(len(form.A)) - form.A, form.B) + form.D
        bare = frequency_response(system, [f], "x", "x", drives="in place").value[0]
        assert found[0, 0] == pytest.approx(bare * creep.frequency_response([f])[0], rel=1e-9)


def test_modes_left_out_creep_with_the_free_displacement() -> None:
    creep = LogCreep(rate_per_decade=0.2, shortest=0.01, longest=30.0)
    system = _SYSTEMS["vgtu-piezo"]
    full, few = (
        linear_part(
            dynamic_model(
                _STAGES["vgtu-piezo"],
                system,
                hysteresis={"x": _STACK, "y": _STACK},
                creep=creep,
                keep_modes=count,
            )
        )
        for count in (None, 1)
    )
    assert np.abs(few.D).max() > 0.1  # the mode of the other axis is among those left out
    for f in (0.003, 0.2):
        s = 2j * np.pi * f
        found, wanted = (
            form.C @ np.linalg.solve(s * np.eye(len(form.A)) - form.A, form.B) + form.D
            for form in (few, full)
        )
        # far below the modes: 2 zeta 0.2 Hz/2 kHz is left
        assert np.abs(found - wanted).max() < 4e-6 * np.abs(wanted).max()
