"""Octave runs the exported matrices and scripts, and gets what flexstage gets.

Evidence (Exported files): MATLAB files in Octave (`DynamicModel`; `expm`, `lsode`): $10^{-11}$;
$10^{-8}$
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from flexstage.export.matlab import matlab_files
from flexstage.hysteresis import Amplifier, BoucWen, DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import time_response
from tests.octave_program import OCTAVE, run_octave

pytestmark = pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")

_STAGES = {name: design(name) for name in ("vgtu-piezo", "vgtu-mechanical")}
_SYSTEMS = {name: lumped_system(stage) for name, stage in _STAGES.items()}
_BOTH = pytest.mark.parametrize("name", list(_STAGES))


def _octave(folder: Path, model: DynamicModel, script: str, **given: np.ndarray) -> dict:
    """Run a script beside the files of a model named `stage`; its `out` comes back."""
    stage = _STAGES[model.name]
    for file, content in matlab_files(stage, model, name="stage").items():
        (folder / file).write_bytes(content)
    savemat(folder / "given.mat", given)
    done = run_octave(
        folder,
        f"S = load('stage.mat'); load('given.mat');\n{script}\nsave('-v6', 'out.mat', 'out');",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = loadmat(folder / "out.mat", squeeze_me=True)
    return {"out": found["out"], "text": done.stdout}


def _free(count: int, step: float) -> np.ndarray:
    t = np.arange(count) * step
    turn = 2.0 * np.pi * t
    made = np.column_stack((np.sin(83.0 * turn) * np.cos(17.0 * turn), 0.7 * np.sin(911.0 * turn)))
    made[count // 2 :, 1] += 0.4  # a jump, over one step
    return 1e-5 * made


def _wanted(name: str, model: DynamicModel, w: np.ndarray) -> np.ndarray:
    """Readings for free displacements of straight lines."""
    if name == "vgtu-piezo":
        t = np.arange(len(w)) * model.step
        read = time_response(model.system, t, {"x": w[:, 0], "y": w[:, 1]}).readings
    else:
        read = (
            model.as_exported()
            .simulate({d.name: w[:, j] / d.gain for j, d in enumerate(model.drives)})
            .readings
        )
    return np.column_stack([read[p.name] for p in model.probes])


@_BOTH
def test_matrices_from_sample_to_sample(name: str, tmp_path: Path) -> None:
    model = dynamic_model(_STAGES[name], _SYSTEMS[name], hysteresis="none")
    w = _free(150, model.step)
    w -= w[0]
    script = """
    x = zeros(size(S.A, 1), 1); xi = x - S.Bd_end * w(1, :)'; out = zeros(rows(w), 4);
    for n = 1:rows(w)
      if n > 1
        x = S.Ad * x + S.Bd_start * w(n - 1, :)' + S.Bd_end * w(n, :)';
        xi = S.Ad * xi + S.Bd * w(n - 1, :)';
      end
      out(n, :) = [S.C * x + S.D * w(n, :)'; S.Cd * xi + S.Dd * w(n, :)']';
    end
    """
    found = _octave(tmp_path, model, script, w=w)["out"]
    wanted = _wanted(name, model, w)
    assert np.abs(found[:, :2] - wanted).max() < 1e-11 * np.ptp(wanted)
    assert np.abs(found[:, 2:] - wanted).max() < 1e-11 * np.ptp(wanted)


@_BOTH
def test_continuous_matrices_by_octaves_exponential(name: str, tmp_path: Path) -> None:
    """A, B, C, D stepped by Octave's own `expm` of the matrix with its straight inputs."""
    model = dynamic_model(_STAGES[name], _SYSTEMS[name], hysteresis="none")
    w = _free(150, model.step)
    w -= w[0]
    script = """
    n = size(S.A, 1); m = size(S.B, 2); k = numel(S.omega);
    # rates over their frequency: the exponential of badly scaled numbers loses digits
    T = diag([ones(k, 1); S.omega(:); ones(n - 2 * k, 1)]);
    E = expm(S.step * [T \\ S.A * T, T \\ S.B, zeros(n, m); ...
                       zeros(m, n + m), eye(m) / S.step; zeros(m, n + 2 * m)]);
    x = zeros(n, 1); out = zeros(rows(w), 2);
    for i = 1:rows(w)
      if i > 1
        all = E * [x; w(i - 1, :)'; w(i, :)' - w(i - 1, :)'];
        x = all(1:n);
      end
      out(i, :) = S.C * T * x + S.D * w(i, :)';
    end
    """
    found = _octave(tmp_path, model, script, w=w)["out"]
    wanted = _wanted(name, model, w)
    assert np.abs(found - wanted).max() < 1e-8 * np.ptp(wanted)


def test_mass_damping_and_stiffness_by_octaves_exponential(tmp_path: Path) -> None:
    model = dynamic_model(_STAGES["vgtu-piezo"], _SYSTEMS["vgtu-piezo"], hysteresis="none")
    w = _free(150, model.step)
    w -= w[0]
    script = """
    n = rows(S.M); m = 2; push = S.M \\ (S.drive_vectors * diag([S.drives.stiffness]));
    # balanced by one frequency, 1/step
    h = S.step; Z = zeros(n);
    E = expm([Z, eye(n), zeros(n, 2 * m); ...
              -h^2 * (S.M \\ S.K_in_place), -h * (S.M \\ S.C_damping), h^2 * push, zeros(n, m); ...
              zeros(m, 2 * n + m), eye(m); zeros(m, 2 * n + 2 * m)]);
    x = zeros(2 * n, 1); out = zeros(rows(w), 2);
    for i = 2:rows(w)
      all = E * [x; w(i - 1, :)'; w(i, :)' - w(i - 1, :)'];
      x = all(1:2 * n);
      out(i, :) = S.probe_vectors * x(1:n);
    end
    """
    found = _octave(tmp_path, model, script, w=w)["out"]
    wanted = _wanted("vgtu-piezo", model, w)
    assert np.abs(found - wanted).max() < 1e-8 * np.ptp(wanted)


@_BOTH
def test_continuous_matrices_by_octaves_integrator(name: str, tmp_path: Path) -> None:
    """The lowest modes by `lsode`, corner by corner."""
    system = _SYSTEMS[name]
    model = dynamic_model(_STAGES[name], system, hysteresis="none", keep_modes=4, time_step=2.3e-4)
    w = _free(60, model.step)
    w -= w[0]
    script = """
    lsode_options('relative tolerance', 1e-11); lsode_options('absolute tolerance', 1e-17);
    lsode_options('integration method', 'adams'); lsode_options('step limit', 1000000);
    x = zeros(size(S.A, 1), 1); out = zeros(rows(w), 2);
    for i = 2:rows(w)
      line = @(t) w(i - 1, :)' + (w(i, :) - w(i - 1, :))' * t / S.step;
      [found, state] = lsode(@(x, t) S.A * x + S.B * line(t), x, [0, S.step]);
      if state ~= 2, error('lsode stopped'), end
      x = found(end, :)';
      out(i, :) = S.C * x + S.D * w(i, :)';
    end
    """
    found = _octave(tmp_path, model, script, w=w)["out"]
    read = (
        model.as_exported()
        .simulate({d.name: w[:, j] / d.gain for j, d in enumerate(model.drives)})
        .readings
    )
    wanted = np.column_stack([read[p.name] for p in model.probes])
    assert np.abs(found - wanted).max() < 1e-8 * np.ptp(wanted)


def _commands(model: DynamicModel, count: int) -> np.ndarray:
    """Loops of two sizes, steps beyond the range, and rest, within each drive's own size."""
    t = np.arange(count) / count
    shape = np.column_stack(
        (
            0.5 - 0.55 * np.cos(14.0 * np.pi * t) * (1.0 - 0.7 * t),
            0.45 + 0.3 * np.sin(31.0 * np.pi * t) + 0.3 * (t > 0.31) - 0.6 * (t > 0.67),
        )
    )
    shape[count // 2 : count // 2 + 9, 0] = shape[count // 2, 0]
    return shape * [120.0 if d.unit == "V" else 3e-5 for d in model.drives]


_STEPS = """
out = zeros(rows(u), 2); s = [];
for n = 1:rows(u)
  [out(n, :), s] = stage_step(S, s, u(n, :));
end
"""


@pytest.mark.parametrize("case", ["piezo", "asymmetric laws", "screws"])
def test_hysteresis_amplifier_creep_and_sensor_step_by_step(case: str, tmp_path: Path) -> None:
    name = "vgtu-mechanical" if case == "screws" else "vgtu-piezo"
    choices: dict = {"sensors": {"y": Sensor(gain=0.98, offset=-4e-8, bandwidth_hz=2300.0)}}
    if case == "piezo":
        choices |= {
            "creep": LogCreep(rate_per_decade=0.017),
            "bandwidth": 1900.0,
            "current": 0.12,
        }
    if case == "asymmetric laws":
        # beta below gamma, where h runs off as it unloads; and beta equal to gamma, a straight line
        choices |= {
            "hysteresis": {
                "x": BoucWen(gain=0.4e-6, hysteresis_gain=0.1e-6, beta=0.02, gamma=0.031),
                "y": BoucWen(gain=0.4e-6, hysteresis_gain=0.1e-6, beta=0.023, gamma=0.023),
            },
            "creep": LogCreep(rate_per_decade=0.03, shortest=1e-5, longest=0.1, per_decade=3),
            "sensors": {
                "x": Sensor(mains_amplitude=3e-8, mains_phase=0.4, mains_frequency_hz=51.0)
            },
        }
    model = dynamic_model(_STAGES[name], _SYSTEMS[name], **choices)
    u = _commands(model, 200)
    found = _octave(tmp_path, model, _STEPS, u=u)["out"]
    read = (
        model.as_exported().simulate({d.name: u[:, j] for j, d in enumerate(model.drives)}).readings
    )
    wanted = np.column_stack([read[p.name] for p in model.probes])
    assert np.abs(found - wanted).max() < 1e-11 * np.ptp(wanted)
    assert np.ptp(wanted) > 1e-5


def test_every_way_of_an_amplifier(tmp_path: Path) -> None:
    """Following, slewing, resting at an end and leaving it inside a step, for random commands."""
    amplifier = Amplifier(
        bandwidth_hz=1100.0, slew_limit=41e3, voltage_range=(-20.0, 120.0), gain=1.07
    )
    model = dynamic_model(_STAGES["vgtu-piezo"], _SYSTEMS["vgtu-piezo"], bandwidth=1100.0)
    # without a limit of its rate the output passes an end and comes back inside a step
    quick = Amplifier(bandwidth_hz=2900.0, voltage_range=(-17.0, 110.0), gain=0.96)
    x, y = model.drives
    model = replace(model, drives=(replace(x, amplifier=amplifier), replace(y, amplifier=quick)))
    rng = np.random.default_rng(11)
    u = rng.uniform(-60.0, 160.0, size=(400, 2))
    u[:200, 0] = np.repeat(u[:20, 0], 10)
    found = _octave(tmp_path, model, _STEPS, u=u)["out"]
    read = model.as_exported().simulate({"x": u[:, 0], "y": u[:, 1]}).readings
    wanted = np.column_stack([read["x"], read["y"]])
    voltage = amplifier.simulate(u[:, 0], model.step).values
    assert {-20.0, 120.0} <= set(voltage.tolist())
    # bisection to an end of the range ends at one rounding of the time
    assert np.abs(found - wanted).max() < 1e-11 * np.ptp(wanted)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) for n in ("vgtu-piezo", "vgtu-mechanical")]
)
def test_the_script_runs_and_its_bode_diagram_is_the_response(name: str, tmp_path: Path) -> None:
    from flexstage.system import frequency_response

    system = _SYSTEMS[name]
    model = dynamic_model(_STAGES[name], system)
    ran = _octave(tmp_path, model, "stage; out = {f, H, u, y};")
    f, response, u, y = ran["out"]
    for j, drive in enumerate(model.drives):
        for i, probe in enumerate(model.probes):
            wanted = frequency_response(system, f, drive.name, probe.name, drives="in place").value
            own = frequency_response(system, f, drive.name, drive.name, drives="in place").value
            assert np.all(np.abs(response[i, j] - wanted) < 1e-9 * np.abs(own).max())
    read = (
        model.as_exported().simulate({d.name: u[:, j] for j, d in enumerate(model.drives)}).readings
    )
    for i, probe in enumerate(model.probes):
        assert np.abs(y[:, i] - read[probe.name]).max() < 1e-11 * np.ptp(read[probe.name])
        assert f"reading  {probe.name} [m]" in ran["text"]


def test_hysteresis_without_exact_step_is_refused_in_words(tmp_path: Path) -> None:
    other = BoucWen(gain=0.4e-6, hysteresis_gain=0.1e-6, beta=200.0, gamma=70.0, exponent=1.6)
    model = dynamic_model(_STAGES["vgtu-piezo"], _SYSTEMS["vgtu-piezo"], hysteresis={"x": other})
    script = "try, stage_step(S, [], [1; 2]); catch e, out = e.message; end"
    message = str(_octave(tmp_path, model, script)["out"])
    assert "no exact step of hysteresis of kind bouc-wen" in message
    assert "C code or FMU" in message
    ran = _octave(tmp_path, model, "stage; out = any(isfinite(y(:)));")
    assert ran["out"] == 0
    assert "no time response" in ran["text"]
