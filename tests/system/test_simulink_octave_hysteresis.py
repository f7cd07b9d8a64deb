"""Hysteresis functions that are exported to MATLAB give in Octave what the models give."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from flexstage.export.simulink.chains import hysteresis_function
from flexstage.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    Dahl,
    Duhem,
    GeneralisedBoucWen,
    GeneralisedMaxwellSlip,
    HysteresisModel,
    Line,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    Preisach,
)
from tests.hysteresis_vectors import VECTORS
from tests.octave_program import OCTAVE
from tests.simulink_recording import octave

pytestmark = pytest.mark.skipif(OCTAVE is None, reason="GNU Octave is not installed")

SHAPE = (0.05, 0.006, 0.002, 0.003, -0.001, 0.004)
GAPS, WEIGHTS = np.array([2.0, 9.0, 31.0]), np.array([0.1e-6, 0.15e-6, 0.07e-6])
# in um and V where the exponent is not 1: the saturation is within reach there
MODELS: dict[str, HysteresisModel] = {
    "bouc_wen": BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.05, gamma=0.03),
    "bouc_wen_hard": BoucWen(gain=0.593e-6, hysteresis_gain=0.441e-6, beta=0.03, gamma=0.05),
    "bouc_wen_ends": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.0, gamma=0.06),
    "square": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.005, gamma=0.003, exponent=2.0),
    "square_2": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.003, gamma=0.009, exponent=2.0),
    "square_3": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.004, gamma=0.004, exponent=2.0),
    "power_1": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.02, gamma=0.011, exponent=1.07),
    "power_2": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=0.02, gamma=0.011, exponent=1.4),
    "power_3": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=2e-3, gamma=3.1e-3, exponent=3.2),
    "power_4": BoucWen(gain=0.593, hysteresis_gain=0.441, beta=3e-4, gamma=3e-4, exponent=2.6),
    "asymmetric": AsymmetricBoucWen(
        gain=0.593e-6, quadratic=4e-10, cubic=-1e-12, beta=0.05, hysteresis_gain=0.441e-6,
        gamma=0.03, lowest_input=-20.0, highest_input=150.0,
    ),
    "generalised": GeneralisedBoucWen(
        gain=0.593e-6, hysteresis_gain=0.361e-6, centre=57.0, shape=SHAPE
    ),
    "generalised_power": GeneralisedBoucWen(
        gain=0.593, hysteresis_gain=0.361, centre=57.0, shape=SHAPE, exponent=1.7
    ),
    "line": Line(gain=0.593e-6),
    "dahl": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6),
    "dahl_power": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=1.4),
    "dahl_sharp": Dahl(gain=0.593e-6, stiffness=0.251e-6, limit=5.3e-6, exponent=0.4),
    "duhem": Duhem(
        rate=0.04, anhysteretic=np.array([2e-6, 0.45e-6, 0.4e-9, -1e-12]),
        tangent=np.array([0.3e-6, 1e-10]), input_range=(-50.0, 150.0),
    ),
    "plays": PrandtlIshlinskii(gain=0.4e-6, thresholds=GAPS, weights=WEIGHTS),
    "plays_and_line": ModifiedPrandtlIshlinskii(
        gain=0.4e-6, thresholds=GAPS, weights=WEIGHTS, dead_zones=np.array([-7e-6, 25e-6, 61e-6]),
        dead_zone_weights=np.array([0.3, -0.2, 0.1]),
    ),
    "preisach": Preisach(
        thresholds=np.array([0.0, 9.0]), knots=np.array([-10.0, 40.0, 90.0, 110.0]), gain=0.4e-6,
        slopes=np.array([[0.2e-6, 0.3e-6, 0.1e-6], [0.1e-6, 0.15e-6, 0.2e-6]]),
    ),
    "slip": GeneralisedMaxwellSlip(
        stiffness=1.5e6, thresholds=np.array([2e-6, 6e-6]),
        element_stiffness=np.array([0.4e6, 0.3e6]),
    ),
    "slip_bent": GeneralisedMaxwellSlip(
        stiffness=1.5e6, thresholds=np.array([2e-6, 6e-6]),
        element_stiffness=np.array([0.4e6, 0.3e6]), dead_zones=np.array([-3e-6, 20e-6, 40e-6]),
        dead_zone_weights=np.array([1e5, -2e5, 3e5]),
    ),
}  # fmt: skip


def voltages() -> np.ndarray:
    """Loops within loops, with jumps over the whole range, rests and steps of rounding."""
    t = np.arange(100)
    u = 60.0 + 55.0 * np.sin(2.0 * np.pi * t / 97.0) * np.cos(2.0 * np.pi * t / 311.0 + 0.3)
    u += 4.0 * np.random.default_rng(5).normal(size=t.size)
    u[50] = u[49]
    u[70:75] = 57.0
    u[75] = np.nextafter(57.0, 58.0)
    u[85:95:2], u[86:95:2] = -18.0, 131.0
    return u


def test_functions_give_what_the_models_give(tmp_path: Path) -> None:
    code = ["found = struct();"]
    for name, model in MODELS.items():
        (tmp_path / f"h_{name}.m").write_text(hysteresis_function(model, f"h_{name}"))
        # again after a clear, which takes the memory back to rest
        for trial, count in (("a", "numel(u)"), ("b", "20")):
            code.append(
                f"clear h_{name}; y = zeros(1, {count}); "
                f"for k = 1:{count}, y(k) = h_{name}(u(k)); end; found.{name}_{trial} = y;"
            )
    code.append("save('-v7', 'found.mat', '-struct', 'found');")
    done = octave(tmp_path, "\n".join(code), u=voltages())
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    ran = {k: np.ravel(v) for k, v in loadmat(tmp_path / "found.mat").items() if k[0] != "_"}
    for name, model in MODELS.items():
        expected = model.simulate(voltages()).values
        # the same formulas in another order of rounding; Newton's iterations end 1e-13 apart at
        # worst
        assert np.max(np.abs(ran[f"{name}_a"] - expected)) < 1e-12 * np.ptp(expected), name
        assert np.array_equal(ran[f"{name}_a"][:20], ran[f"{name}_b"]), name


def test_function_gives_the_test_vectors(tmp_path: Path) -> None:
    names = {f"v_{i}": vector for i, vector in enumerate(VECTORS.values())}
    code, given = ["found = struct();"], {}
    for name, vector in names.items():
        (tmp_path / f"{name}.m").write_text(hysteresis_function(vector.model, name))
        given[f"u_{name}"] = vector.inputs
        code.append(f"found.{name} = arrayfun(@{name}, u_{name});")
    code.append("save('-v7', 'found.mat', '-struct', 'found');")
    done = octave(tmp_path, "\n".join(code), **given)
    assert done.returncode == 0, done.stderr
    found = loadmat(tmp_path / "found.mat")
    for name, vector in names.items():
        error = np.max(np.abs(np.ravel(found[name]) - vector.outputs))
        assert error < 1e-12 * np.ptp(vector.outputs), vector.model


def test_function_does_not_depend_on_how_a_line_is_cut(tmp_path: Path) -> None:
    # a property of the model that the function must keep: every part of a line is exact
    names = ["bouc_wen", "power_2", "generalised", "duhem", "plays_and_line", "slip_bent"]
    for name in names:
        (tmp_path / f"h_{name}.m").write_text(hysteresis_function(MODELS[name], f"h_{name}"))
    code = "ends = [0 97.3 21.1 64.9 -11];\n" + "\n".join(
        f"""
        once = 0; for e = ends, once(end + 1) = h_{n}(e); end
        clear h_{n};
        parts = 0;
        for k = 2:numel(ends)
          for s = [0.13 0.31 0.77 1], p = h_{n}(ends(k - 1) + s * (ends(k) - ends(k - 1))); end
          parts(end + 1) = p;
        end
        missed.{n} = max(abs(once(3:end) - parts(2:end))) / (max(once) - min(once));
        """
        for n in names
    )
    done = octave(tmp_path, code + "save('-v7', 'missed.mat', '-struct', 'missed');")
    assert done.returncode == 0, done.stderr
    missed = loadmat(tmp_path / "missed.mat")
    for name in names:
        assert missed[name].item() < 1e-13, name
