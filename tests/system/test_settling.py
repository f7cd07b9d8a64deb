"""Settling of a move on the simulated piezo stage of the study: predicted, and simulated.

Evidence (Instruments, twin, control): settling of a 10 µm step to ±10 nm, by transforms against the
twin sample by sample: 0.2 ms in open loop (ZV, ZVD, jerk-limited, minimum time), 1 ms of 46 and 105
(EI, step); with feedback within the range of its tolerance
"""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import LimitError, ModelError
from flexstage.cli import main
from flexstage.control.loop_plant import LoopPlant
from flexstage.control.moves import MoveResponse
from flexstage.hysteresis import StageModes
from flexstage.hysteresis.requests import AmplifierLimits
from flexstage.records.read import read_record
from flexstage.stage.designs import design
from flexstage.stage.seat import BallSeat, Preload
from flexstage.studies.requests import SettleRequest
from flexstage.studies.settling import (
    SettlingTime,
    _Bench,
    _fitted_modes,
    _preload_acceleration,
    _shaped_modes,
    move_plant,
    settle,
)
from flexstage.system import modes
from flexstage.virtual.build import virtual_stage
from flexstage.virtual.piezo_loop import sampled_response
from flexstage.virtual.piezo_stage import PiezoStage

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "control.md"
REQUEST = SettleRequest(move=10e-6, within=10e-9)
SHORT = ("jerk-limited", "zv", "zvd", "minimum-time", "robust minimum-time")


@pytest.fixture(scope="module")
def study():
    return settle(design("vgtu-piezo"), REQUEST)


@pytest.mark.slow
def test_the_simulated_stage_settles_when_the_prediction_says(study) -> None:
    moves = {move.kind: move for move in study.moves}
    # a sample is 0.1 ms
    for kind in SHORT:
        times = moves[kind].open_loop
        assert times.simulated == pytest.approx(times.predicted, abs=2e-4)
        assert times.predicted < 5e-3
    for kind in ("step", "ei"):
        times = moves[kind].open_loop
        assert times.simulated == pytest.approx(times.predicted, rel=0.02)
    # the envelope of the mode: peak less end, decaying to the band
    step = moves["step"].open_loop
    zeta = study.plant.modes.damping_ratio[0]
    rate = zeta * study.plant.modes.omega[0]
    left = moves["step"].peak - study.distance
    assert step.predicted == pytest.approx(math.log(left / study.band) / rate, abs=3e-3)
    for move in study.moves:
        feedback = move.feedback
        assert feedback.simulated <= max(1.05 * feedback.quantile, feedback.predicted + 2e-4)
    # the order that the manual explains
    order = [moves[k].open_loop.quantile for k in ("zvd", "robust minimum-time", "zv", "step")]
    assert order == sorted(order)
    assert moves["minimum-time"].open_loop.predicted < moves["zv"].open_loop.predicted


@pytest.mark.slow
def test_the_commands_keep_the_limits_of_the_drive(study) -> None:
    # 40 kV/s into 6.4 uF
    for move in study.moves:
        assert 0.0 < move.current < 40e3 * 6.4e-6 * 1.05
        if move.voltage.size:
            total = study.start + move.voltage
            assert total.min() >= 0.0
            assert total.max() <= 120.0
            assert move.voltage[-1] * study.plant.gain == pytest.approx(10e-6, rel=1e-9)


@pytest.mark.slow
def test_feedback_alone_keeps_the_current_of_the_amplifier() -> None:
    stage = design("vgtu-piezo")
    twin = virtual_stage(stage, model="lumped", quiet=True, scatter=False)
    assert isinstance(twin, PiezoStage)
    rates = {}
    for current in (None, 20e-3):
        request = replace(REQUEST, amplifier=AmplifierLimits(current=current))
        motion, rates[current] = _Bench(stage, twin, "x", request)._simulated(
            np.zeros(1), np.array([REQUEST.move])
        )
        assert motion.position[-1] == pytest.approx(REQUEST.move, abs=20e-9)
    # 20 mA into the 6.4 uF of the data sheet; the loop alone asks for five times that
    assert rates[20e-3] == pytest.approx(20e-3 / 6.4e-6, rel=0.01)
    assert rates[None] > 4.0 * rates[20e-3]


@pytest.mark.slow
def test_the_manual_states_the_times(study) -> None:
    rows = dict(re.findall(r"^\|([a-z-]+(?: alone)?)\|(.*)\|$", PAGE.read_text("utf-8"), re.M))
    moves = {move.kind: move for move in study.moves}
    assert {*rows} >= {"step", "jerk-limited", "zv", "zvd", "ei", "minimum-time", "feedback alone"}
    for kind, text in rows.items():
        if kind not in moves:
            continue
        stated = [float(word) if word.strip() else math.nan for word in text.split("|")]
        both = (moves[kind].open_loop, moves[kind].feedback)
        got = [
            t * 1e3
            for times in both
            for t in (
                (math.nan,) * 3
                if times is None
                else (times.predicted, times.quantile, times.simulated)
            )
        ]
        # the last digit
        np.testing.assert_allclose(stated, got, atol=0.1)


@pytest.mark.slow
def test_the_command_writes_a_move_that_a_controller_can_run(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    # a fit of another mode: the shapers are those of the fit, and the tolerance its uncertainty
    mode = {"frequency_hz": {"value": 930.0, "uncertainty": 9.3},
            "damping_ratio": {"value": 0.01, "uncertainty": 1e-3}}  # fmt: skip
    Path("fit.json").write_text(json.dumps({"modes": [mode]}))
    words = [
        "settle",
        "vgtu-piezo",
        "--move",
        "4 um",
        "--within",
        "20 nm",
        "--modal-fit",
        "fit.json",
    ]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--out", "move.csv", "--figure", "move.svg", "--json", "--quiet"])
    assert ended.value.code in (0, None)
    printed = json.loads(capsys.readouterr().out)
    assert printed["modes"] == [{"frequency_hz": 930.0, "damping_ratio": 0.01}]
    assert "frequencies within 2 %, damping within 20 %" in printed["notes"][0]
    moves = {move["kind"]: move for move in printed["moves"]}
    assert moves["feedback alone"]["open_loop"] is None
    # 1.6 % off, a ZV shaper leaves about pi/2 of it
    assert moves["zv"]["open_loop"]["predicted"] > 5.0 * moves["zvd"]["open_loop"]["predicted"]
    record = read_record(Path("move.csv"))
    volts, reached = record.channel("command").values, record.channel("predicted").values
    assert record.channel("command").unit == "V"
    assert reached[-1] == pytest.approx(4e-6, abs=20e-9)
    assert np.ptp(volts) == pytest.approx(volts[-1] - volts[0])
    assert Path("move.svg").read_text("utf-8").startswith("<?xml")


def test_the_plant_is_that_of_the_simulated_loop_up_to_its_mode() -> None:
    twin = virtual_stage(design("vgtu-piezo"), model="lumped", quiet=True, scatter=False)
    assert isinstance(twin, PiezoStage)
    plant, part = move_plant(twin, "x"), twin.parts[0]
    f = np.array([100.0, 300.0, 700.0, 915.3, 1200.0])
    slope = plant.gain / twin.model.static_gain(part.drive, part.probe)
    # another way to the same response: the loop of the simulation in z, with creep and all modes
    other = sampled_response(twin.model, part.drive, part.probe, f, slope=slope)
    other = other * np.exp(-2j * np.pi * f / twin.sample_rate_hz)
    # 0.2 degrees, a delay of a tenth of a microsecond at 900 Hz
    assert np.max(np.abs(plant.response(f) / other - 1.0)) < 3e-3


def test_a_preload_limits_the_acceleration_by_the_force_of_the_first_mode() -> None:
    stage = design("vgtu-piezo")
    seat, preload = BallSeat(radius=5e-3, contact_modulus=110e9), Preload(force=300.0)
    drives = tuple(replace(d, seats=(seat,), preload=preload) for d in stage.drives)
    stage = replace(stage, drives=drives)
    twin = virtual_stage(stage, model="lumped", quiet=True, scatter=False)
    assert isinstance(twin, PiezoStage)
    # force over acceleration of the probe from the shape of the mode itself, of unit modal mass
    system = twin.model.system
    found = modes(system, drives="in place", count=None)
    at_probe = system.probe(twin.parts[0].probe).vector @ found.shapes
    at_drive = system.drive("x").vector @ found.shapes
    first = int(np.argmax(np.abs(at_probe * at_drive) / found.omega**2))
    expected = 300.0 * abs(at_probe[first] * at_drive[first])
    assert _preload_acceleration(stage, twin, "x") == pytest.approx(expected, rel=1e-9)
    assert _preload_acceleration(design("vgtu-piezo"), twin, "x") == math.inf


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: settle(design("vgtu-mechanical"), REQUEST), ModelError, "by a screw"),
        (
            lambda: settle(design("vgtu-piezo"), SettleRequest(move=90e-6)), LimitError,
            "needs .* V, and the range of axis 'x' is 0 to 120 V",
        ),
        (lambda: settle(design("cartwheel"), REQUEST), ModelError, "axis 'theta' reads rad"),
        (lambda: settle(replace(design("vgtu-piezo"), axes=()), REQUEST), ModelError, "no axis"),
        (lambda: SettleRequest(move=1e-6, within=1e-6), ModelError, "reduce --within"),
        (lambda: _fitted_modes(Path("absent.json")), ModelError, "cannot be read"),
    ],
)  # fmt: skip
def test_impossible_requests_are_refused_in_words(call, error, words) -> None:
    with pytest.raises(error, match=words):
        call()


def test_an_unknown_move_is_refused_before_the_work(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["settle", "vgtu-piezo", "--move", "4 um", "--write", "zvdd"])
    assert ended.value.code == 2
    assert "jerk-limited" in capsys.readouterr().err


def test_a_file_without_modes_is_refused(tmp_path) -> None:
    file = tmp_path / "frf.json"
    file.write_text('{"modes": []}')
    with pytest.raises(ModelError, match="flexstage frf --json"):
        _fitted_modes(file)


@pytest.mark.parametrize(
    ("frequency", "uncertainty", "damping"),
    [(0.0, 1.0, 0.01), (930.0, math.nan, 0.01), (930.0, 9.0, 0.0), (-930.0, 9.0, 0.01)],
)
def test_modes_without_use_are_refused(tmp_path, frequency, uncertainty, damping) -> None:
    file = tmp_path / "frf.json"
    mode = {"frequency_hz": {"value": frequency, "uncertainty": uncertainty},
            "damping_ratio": {"value": damping, "uncertainty": 1e-3}}  # fmt: skip
    file.write_text(json.dumps({"modes": [mode]}))
    with pytest.raises(ModelError, match="flexstage frf --json"):
        _fitted_modes(file)


def test_each_shaper_needs_a_fitted_mode_of_its_own(tmp_path) -> None:
    file = tmp_path / "frf.json"
    mode = {"frequency_hz": {"value": 930.0, "uncertainty": 9.0},
            "damping_ratio": {"value": 0.01, "uncertainty": 1e-3}}  # fmt: skip
    file.write_text(json.dumps({"modes": [mode]}))
    modes = StageModes(frequency_hz=[910.0, 2300.0], damping_ratio=[0.01] * 2, share=[0.9, 0.1])
    plant = LoopPlant(gain=5e-7, gain_range=(4e-7, 6e-7), modes=modes)
    one, two = (replace(REQUEST, modal_fit=str(file), modes=k) for k in (1, 2))
    assert _shaped_modes(plant, one)[0] == [(930.0, 0.01)]
    with pytest.raises(ModelError, match="near each of 910 Hz, 2300 Hz: fit more modes"):
        _shaped_modes(plant, two)


def test_a_move_that_never_settles_has_no_time_in_the_plain_data() -> None:
    still = MoveResponse(time=np.zeros(1), position=np.zeros(1), end=0.0)
    times = SettlingTime(
        predicted=2e-3, quantile=math.inf, simulated=math.inf, motion=still, simulation=still,
        voltage_rate=0.0,
    )  # fmt: skip
    assert times.data() == {"predicted": 2e-3, "quantile_95": None, "simulated": None}
