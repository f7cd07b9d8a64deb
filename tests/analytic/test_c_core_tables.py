"""What C makes again when a parameter was changed: tables of modes and lags, and tuned models."""

import ctypes
from dataclasses import replace
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

from flexstage.export.source.render import c_variables, render_source
from flexstage.hysteresis import (
    BoucWen,
    Creep,
    CreepSpectrum,
    DynamicModel,
    LogCreep,
    Sensor,
    dynamic_model,
)
from flexstage.hysteresis.chain.modal import unit_step
from flexstage.hysteresis.dynamic_model import ModelDrive
from flexstage.hysteresis.model import Array
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from tests.c_compiler import load_library
from tests.c_stage import CStage, stepped, wandering

_TABLES = """
#include "stage.h"
void tables(double w, double zeta, double *transition, double *moments)
{
    fs_unit_step(w, zeta, transition, moments);
}
"""
ANGLES = (1e-5, 0.0099, 0.0101, 0.17, 0.93, 2.99, 7.9, 8.1, 11.7, 23.0)
DAMPING = (0.0, 0.004, 0.23, 0.93, 0.9989, 0.9991, 1.0, 1.07, 4.3)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    stage = design("parallelogram")
    model = dynamic_model(stage, lumped_system(stage))
    library = load_library(tmp_path_factory.mktemp("tables"), _TABLES, files=render_source(model))
    library.tables.argtypes = [ctypes.c_double] * 2 + [ctypes.c_void_p] * 2
    return library


def made_in_c(library: ctypes.CDLL, w: float, zeta: float) -> tuple[Array, Array]:
    transition, moments = np.empty(4), np.empty(13)
    library.tables(w, zeta, transition.ctypes.data, moments.ctypes.data)
    return transition, moments


def in_40_digits(w: float, zeta: float) -> tuple[Array, Array]:
    """Transition and moments from the impulse response by its power series, in many digits."""
    with mp.workdps(60 + int(2.2 * w * max(1.0, 2.0 * zeta))):
        a, x = 2 * mp.mpf(zeta) * mp.mpf(w), mp.mpf(w) ** 2
        series, low, high = [], mp.mpf(0), mp.mpf(1)
        for _ in range(120 + int(12.0 * w * max(1.0, 2.0 * zeta))):
            series.append(low)
            low, high = high, -a * high - x * low
        factorial = [mp.mpf(1)]
        for n in range(1, len(series) + 13):
            factorial.append(n * factorial[-1])
        g, *integrals = (
            mp.fsum(c / f for c, f in zip(series, factorial[j:], strict=False)) for j in range(13)
        )
        dg = mp.fsum(c / f for c, f in zip(series[1:], factorial, strict=False))
        transition = [dg + a * g, g, -x * g, dg]
        return (
            np.array([float(t) for t in transition]),
            np.array([float(x * i) for i in (g, *integrals)]),
        )


@pytest.mark.parametrize("w", ANGLES)
def test_tables_of_a_mode_have_13_digits(tables: ctypes.CDLL, w: float) -> None:
    for zeta in DAMPING:
        if w * max(1.0, 2.0 * zeta) > 50.0:
            continue  # the power series that it is compared with takes too many digits
        transition, moments = made_in_c(tables, w, zeta)
        exact_transition, exact_moments = in_40_digits(w, zeta)
        # close to critical damping W sqrt(1 - zeta^2) loses digits, not more than 1/sqrt(1 - zeta)
        bound = 1e-13 * (30.0 if 0.99 < zeta < 1.0 and w > 10.0 else 1.0)
        np.testing.assert_allclose(transition, exact_transition, rtol=bound, atol=0)
        np.testing.assert_allclose(moments, exact_moments, rtol=bound, atol=0)


def test_tables_of_a_mode_are_those_of_python(tables: ctypes.CDLL) -> None:
    # moments of the highest derivatives have fewer digits in Python; they are so small that they
    # matter to a force of unit size by less than this
    for w in (0.012, 0.4, 2.2, 9.3, 47.0):
        step = unit_step(np.full(3, w), np.array([0.003, 0.11, 0.8]))
        for i, zeta in enumerate((0.003, 0.11, 0.8)):
            transition, moments = made_in_c(tables, w, zeta)
            np.testing.assert_allclose(transition, step.transition[:, i], rtol=1e-13)
            difference = np.abs(moments - step.moments[:, i])
            assert np.all(difference <= 1e-13 * np.abs(step.moments[:3, i]).max())


def tuned(model: DynamicModel, variables: dict[str, float]) -> DynamicModel:
    """Python's model with the values that C is given; what probes read of modes at rest stays."""
    omega, zeta = model.omega.copy(), model.damping_ratio.copy()
    for name, value in variables.items():
        parts = name.split(".")
        if parts[0] == "mode" and parts[2] == "frequency_hz":
            omega[int(parts[1]) - 1] = 2.0 * np.pi * value
        elif parts[0] == "mode":
            zeta[int(parts[1]) - 1] = value
    drives = tuple(_tuned_drive(d, model, omega, zeta, variables) for d in model.drives)
    probes = []
    for p in model.probes:
        own = {
            name.split(".")[2]: value
            for name, value in variables.items()
            if name.startswith(f"sensor.{p.name}.")
        }
        probes.append(replace(p, sensor=replace(p.sensor, **own)) if p.sensor and own else p)
    return replace(model, omega=omega, damping_ratio=zeta, drives=drives, probes=tuple(probes))


def _tuned_drive(
    d: ModelDrive, model: DynamicModel, omega: Array, zeta: Array, variables: dict[str, float]
) -> ModelDrive:
    own = {n.removeprefix(f"{d.name}."): v for n, v in variables.items() if n.startswith(d.name)}
    given = {n.split(".")[1]: v for n, v in own.items() if n.startswith("hysteresis")}
    if given:
        assert isinstance(d.hysteresis, BoucWen)
        d = replace(d, hysteresis=replace(d.hysteresis, **given))
    if d.amplifier is not None:
        assert d.amplifier.voltage_range is not None
        amplifier = replace(
            d.amplifier,
            bandwidth_hz=own.get("amplifier.bandwidth_hz", d.amplifier.bandwidth_hz),
            gain=own.get("amplifier.gain", d.amplifier.gain),
            slew_limit=own.get("amplifier.largest_rate", d.amplifier.largest_rate),
            current_limit=None,
            voltage_range=(
                own.get("amplifier.lowest_voltage", d.amplifier.voltage_range[0]),
                own.get("amplifier.highest_voltage", d.amplifier.voltage_range[1]),
            ),
        )
        d = replace(d, amplifier=amplifier)
    d = replace(d, gain=own.get("gain", d.gain))
    if np.any(d.rate_time):
        d = replace(d, rate_time=2.0 * zeta / omega)
    if d.creep is None:
        return d
    rate = own.get("creep.rate_per_decade", d.creep.rate_per_decade)
    if isinstance(d.creep, CreepSpectrum):
        creep: Creep = d.creep.scaled(rate)
    else:
        creep = replace(d.creep, rate_per_decade=rate)
    # a mode behind a lag: residues of 1/(1 + tau s) times the mode
    reach, poles, a = model.probe_shapes * d.modal_gain, 1.0 / creep.time_constants, creep.lag_gains
    c = 1.0 / (1.0 - 2.0 * zeta * poles[:, None] / omega + (poles[:, None] / omega) ** 2)
    deflections = reach * (1.0 + a @ (1.0 - c))
    rates = -reach * ((a * poles) @ c) / omega**2
    return replace(
        d,
        creep=creep,
        mode_weights=np.hstack((deflections, rates)),
        lag_weights=a * (reach @ c.T + d.feedthrough[:, None]),
    )


LOGARITHM = LogCreep(rate_per_decade=0.017)
SPECTRUM = CreepSpectrum(times=(0.0004, 0.013, 5.1), weights=(0.21, 0.03, 0.08))


def piezo(creep: Creep = LOGARITHM) -> DynamicModel:
    stage = design("vgtu-piezo")
    return dynamic_model(
        stage,
        lumped_system(stage),
        keep_modes=17,
        bandwidth=1700.0,
        creep=creep,
        sensors={"y": Sensor(gain=1.02, bandwidth_hz=4100.0, quantisation=1e-9)},
    )


@pytest.mark.parametrize("creep", [LOGARITHM, SPECTRUM], ids=["logarithm", "spectrum"])
def test_tuned_parameters_give_the_model_built_with_them(creep: Creep, tmp_path: Path) -> None:
    model = piezo(creep)
    given = {
        "mode.1.frequency_hz": 417.0,
        "mode.2.damping_ratio": 0.083,
        "mode.3.damping_ratio": 1.2,
        "mode.9.frequency_hz": 11_300.0,
        "x.hysteresis.beta": 0.041,
        "y.hysteresis.gain": 2.9e-7,
        "x.creep.rate_per_decade": 0.031,
        "x.amplifier.bandwidth_hz": 930.0,
        "y.amplifier.gain": 0.87,
        "y.amplifier.largest_rate": 31_000.0,
        "y.amplifier.highest_voltage": 77.0,
        "sensor.y.gain": 0.993,
        "sensor.y.offset": -7e-8,
        "sensor.y.bandwidth_hz": 2300.0,
        "sensor.y.mains_amplitude": 3e-8,
        "sensor.y.mains_frequency_hz": 61.0,
        "sensor.y.mains_phase": 0.7,
        "sensor.y.quantisation": 0.0,
    }
    made = CStage(tmp_path, model)
    for name, value in given.items():
        made.put(name, value)
    assert made.prepare() is None
    made.settle(0.0, 0.0)
    u = wandering(150, [(0.0, 120.0)] * 2, seed=9)
    expected = stepped(tuned(model, given), u)[0]
    assert np.abs(expected - stepped(model, u)[0]).max() > 1e-6
    # rounding of tables, through some hundred steps of modes that ring
    size = np.abs(expected).max(axis=0)
    assert np.all(np.abs(made.run(u) - expected) <= 1e-12 * size)


def test_tuned_modes_of_an_imposed_displacement(tmp_path: Path) -> None:
    stage = design("vgtu-mechanical")
    model = dynamic_model(stage, lumped_system(stage))
    given = {"mode.1.damping_ratio": 0.11, "mode.2.frequency_hz": 301.0, "x.gain": 0.93}
    made = CStage(tmp_path, model)
    for name, value in given.items():
        made.put(name, value)
    assert made.prepare() is None
    u = wandering(300, [(-1e-4, 1.3e-4)] * 2, seed=4)
    expected = stepped(tuned(model, given), u)[0]
    assert np.all(np.abs(made.run(u) - expected) <= 1e-12 * np.abs(expected).max(axis=0))


def test_prepare_without_a_change_moves_nothing_beyond_rounding(tmp_path: Path) -> None:
    model = piezo()
    made = CStage(tmp_path, model)
    u = wandering(200, [(0.0, 120.0)] * 2, seed=17)
    untouched = made.run(u)
    made.bytes = made.fresh()
    made.run(u[:70])
    before = made.readings()
    assert made.prepare() is None
    np.testing.assert_allclose(made.readings(), before, rtol=0, atol=1.1e-9)
    size = np.abs(untouched[:, 0]).max()
    assert np.abs(made.run(u[70:])[:, 0] - untouched[70:, 0]).max() <= 1e-12 * size


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("mode.2.frequency_hz", 0.0, "frequency of a mode must be positive"),
        ("mode.2.frequency_hz", np.inf, "frequency of a mode must be positive"),
        ("mode.1.damping_ratio", -0.01, "damping ratio of a mode must be finite"),
        ("x.hysteresis.beta", np.nan, "parameter of the hysteresis must be finite"),
        ("x.amplifier.bandwidth_hz", -3.0, "bandwidth of an amplifier must be positive"),
        ("y.amplifier.gain", 0.0, "gain of an amplifier must be finite, not 0"),
        ("y.amplifier.largest_rate", 0.0, "largest rate of an amplifier must be positive"),
        ("x.amplifier.highest_voltage", -200.0, "range of an amplifier must rise"),
        ("x.creep.rate_per_decade", -0.1, "rate of the creep must be finite"),
        ("sensor.y.gain", 0.0, "gain of a sensor must be finite, not 0"),
        ("sensor.y.bandwidth_hz", -1.0, "bandwidth of a sensor must be positive"),
        ("sensor.y.quantisation", np.nan, "must not be negative"),
    ],
)
def test_parameters_that_make_no_model_are_said(
    name: str, value: float, said: str, refused: CStage
) -> None:
    refused.bytes = refused.fresh()
    refused.put(name, value)
    assert said in (refused.prepare() or "")


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> CStage:
    return CStage(tmp_path_factory.mktemp("refused"), piezo())


def test_variables_start_where_the_instance_starts(refused: CStage) -> None:
    refused.bytes = refused.fresh()
    found = c_variables(refused.model)
    assert len({v.name for v in found}) == len(found)
    for v in found:
        if v.causality in ("local", "parameter"):
            assert refused.get(v.name) == v.start, v.name
    outputs = [v for v in found if v.causality == "output"]
    np.testing.assert_array_equal(refused.readings(), [v.start for v in outputs])
    assert [v.expression for v in outputs] == ["readings[0]", "readings[1]"]
    units = {v.name: v.unit for v in found}
    assert units["x.command"] == "V"
    assert units["x.hysteresis.gain"] == "m/V"
    assert units["y.amplifier.largest_rate"] == "V/s"
