"""Several axes behind a constant matrix: exact matrix, poles of all loops, singular values.

Evidence (Instruments, twin, control): loops of several axes together: stability by the poles of the
exact loop, largest singular value in closed form, $10^{-6}$; cross-talk of a measured mirror of
three drives at 12 Hz from 0.85 to 0.06 of the own motion
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.control.loop_plant import LoopPlant
from flexstage.control.tuning import (
    Decoupling,
    decoupled,
    tune_axes,
    tune_files,
    tune_stage,
    whole_margins,
)
from flexstage.hysteresis import StageModes
from flexstage.lumped import lumped_system
from flexstage.measure.requests import TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.stage.designs import design
from flexstage.system.environment import PositionLoop, read_loop
from flexstage.system.servo import ServoSettings
from tests.shared_data import DATA, needs

RATE, GAIN = 10e3, 5e-7
MIXED = np.array([[0.9, -0.5], [0.7, 1.3]])
LINES = np.union1d(np.geomspace(1.0, 5000.0, 400), 910.0 + np.linspace(-100.0, 100.0, 161))


def measured(f: np.ndarray, response: np.ndarray, source: str = "made") -> MeasuredResponse:
    n = response.shape[1]
    return MeasuredResponse(
        frequency_hz=f, response=np.asarray(response, dtype=np.complex128), source=source,
        inputs=tuple(f"u{k}" for k in range(n)), outputs=tuple(f"y{k}" for k in range(n)),
        input_units=("V",) * n, output_units=("m",) * n,
    )  # fmt: skip


def request(**changes: object) -> TuneRequest:
    made = TuneRequest(servo_rate=RATE, delay=0.0, decouple=0.0, uncertainty=0.0, shift=0.0)
    return replace(made, **changes)


def plant(mode: float, delay: float = 2e-4) -> LoopPlant:
    modes = StageModes(frequency_hz=[mode], damping_ratio=[0.02])
    return LoopPlant(
        gain=GAIN, gain_range=(GAIN, GAIN), delay=delay, modes=modes, sample_rate_hz=RATE
    )


def test_axes_that_a_matrix_mixes_are_decoupled_exactly() -> None:
    own = np.stack([plant(mode).response(LINES) for mode in (910.0, 860.0)], axis=1)
    made = tune_axes([measured(LINES, own[:, :, None] * MIXED)], request(control="damping"))
    found = made.decoupling
    assert found.at == 0
    assert found.before[0] == pytest.approx([0.5 / 0.9, 0.7 / 1.3], rel=1e-4)
    assert found.after.max() < 1e-3
    assert (MIXED @ found.matrix) == pytest.approx(np.diag([0.9, 1.3]), abs=1e-3)
    # loops that do not meet have the sensitivity of the worse of both
    peaks = [axis.worst.sensitivity_peak for axis in made.axes]
    assert made.all_axes[0].sensitivity_peak == pytest.approx(max(peaks), rel=1e-3)
    assert made.all_axes[0].stable


def test_axes_of_unlike_units_are_as_dependent_as_of_like_units() -> None:
    # a rotation [rad] has a number some thousand times that of a length [m]
    unlike = np.diag([1.0, 2e4])
    own = plant(910.0).response(LINES)[:, None, None]
    like, other = (
        decoupled([measured(LINES, own * m)], request())[0] for m in (MIXED, unlike @ MIXED)
    )
    assert other.matrix == pytest.approx(like.matrix, rel=1e-9)
    assert other.gains == pytest.approx(unlike @ like.gains, rel=1e-9)
    assert other.after == pytest.approx(like.after, abs=1e-9)


@pytest.mark.parametrize("angle", [20.0, 75.0, 100.0])
def test_all_loops_together_by_the_poles_of_the_exact_loop(angle: float) -> None:
    # integral control with a delay of two samples, through a matrix that turns two of three axes:
    # with its eigenvalues e = 1, e^(+-ja) the poles are those of z^2 (z - 1) + k e z
    turned = math.radians(angle)
    rotation = np.eye(3)
    rotation[:2, :2] = [[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]
    f = np.geomspace(0.1, 0.5 * RATE, 3000)
    late = np.exp(-2j * np.pi * f / RATE * 2.0)
    response = measured(f, GAIN * late[:, None, None] * rotation)
    identity = Decoupling(
        frequency_hz=f[0], inputs=("a", "b", "c"), outputs=("a", "b", "c"), matrix=np.eye(3),
        gains=np.full(3, GAIN), lines_hz=f, before=np.zeros((1, 3)), after=np.zeros((1, 3)),
    )  # fmt: skip
    for k in (0.05, 0.2, 0.4, 0.7):
        settings = ServoSettings(integral=k * RATE / GAIN)
        loop = PositionLoop(name="i", settings=settings, sample_rate=RATE, delay=0.0)
        (whole,) = whole_margins([response], identity, [loop] * 3, request())
        eigenvalues = k * np.exp(1j * turned * np.array([0.0, 1.0, -1.0]))
        poles = [np.roots([1.0, -1.0, e]) for e in eigenvalues]
        assert whole.stable == (np.abs(poles).max() < 1.0)
        # a rotation is normal: singular values are those of its eigenvalues
        line = late / (1.0 - np.exp(-2j * np.pi * f / RATE))
        wanted = max(float((1.0 / np.abs(1.0 + e * line)).max()) for e in eigenvalues)
        assert whole.sensitivity_peak == pytest.approx(wanted, rel=1e-3)


def test_coupled_axes_lose_gain_together_or_are_refused() -> None:
    # the second mode moves both axes: a matrix from low frequencies does not decouple it
    own = np.stack([plant(910.0).response(LINES), plant(910.0).response(LINES)], axis=1)
    first = own[:, :, None] * np.eye(2)
    for share, refused in ((0.3, False), (10.0, True)):
        common = share * (plant(900.0).response(LINES) - plant(4000.0).response(LINES))
        coupled = first + common[:, None, None] * np.array([[0.0, 1.0], [1.0, 0.0]])
        words = request(control="damping")
        if refused:
            with pytest.raises(ModelError, match="the axes remain coupled"):
                tune_axes([measured(LINES, coupled)], words)
            continue
        made = tune_axes([measured(LINES, coupled)], words)
        assert made.all_axes[0].sensitivity_peak <= 2.0
        assert max(axis.worst.sensitivity_peak for axis in made.axes) < 1.95
        assert any("times those of each axis alone" in note for note in made.notes)


def test_responses_that_cannot_be_decoupled_are_refused() -> None:
    own = plant(910.0).response(LINES)[:, None, None]
    with pytest.raises(ModelError, match="as many inputs as outputs, two or more"):
        decoupled([measured(LINES, own)], request())
    mixed = replace(measured(LINES, own * MIXED), input_units=("V", "A"))
    with pytest.raises(ModelError, match="units V, A: --decouple needs inputs of one unit"):
        decoupled([mixed], request())
    with pytest.raises(ModelError, match="dependent or late"):
        decoupled([measured(LINES, own * np.ones((2, 2)))], request())
    prompt = plant(910.0, 0.0).response(LINES)[:, None, None]
    with pytest.raises(ModelError, match="dependent or late"):
        decoupled([measured(LINES, prompt * MIXED)], request(decouple=910.0))
    with pytest.raises(ModelError, match="--axis is that of a STAGE, got 'x'"):
        tune_files(request(frf=("x.csv",), axis="x"))
    stage, none = design("vgtu-piezo"), TuneRequest(decouple=0.0)
    with pytest.raises(ModelError, match="controls all axes: omit --axis"):
        tune_stage(stage, lumped_system(stage), replace(none, axis="y"))
    with pytest.raises(ModelError, match="--output is for measured responses"):
        tune_stage(stage, lumped_system(stage), replace(none, output="y"))
    with pytest.raises(ModelError, match="iff damps one axis"):
        tune_axes([measured(LINES, own * MIXED)], request(control="iff"))


def test_the_command_decouples_the_axes_of_a_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"tune vgtu-piezo --control integral --out {tmp_path / 'a.yaml'} --shift 0 "
    words += f"--uncertainty 0 --figure {tmp_path / 'a.svg'} --json --decouple"
    with pytest.raises(SystemExit) as end:
        main([*words.split(), "0 Hz"])
    assert end.value.code in (0, None)
    result = json.loads(capsys.readouterr().out)
    assert result["decoupling"]["outputs"] == ["x", "y"]
    assert result["all_axes"][0]["stable"]
    assert any("budget --loop applies them without it" in note for note in result["notes"])
    for axis, made in zip("xy", result["axes"], strict=True):
        loop = read_loop(tmp_path / f"a-{axis}.yaml")
        assert loop.settings.integral == made["settings"]["integral"]


@pytest.mark.slow
@needs("fine-steering-mirror")
def test_a_measured_mirror_of_three_drives_is_decoupled() -> None:
    rows = []
    f = np.fft.rfftfreq(8192, 1.0 / 6400.0)
    for level in (100, 200, 300):
        with np.load(DATA / "fine-steering-mirror" / f"train_{level}mV.npz") as arrays:
            u, y = (np.fft.rfft(arrays[name], axis=0).mean(axis=-1) for name in "uy")
        # every third line: 2.3 Hz, a seventh of the width of the mode
        used = (
            (f > 10.0)
            & (np.arange(f.size) % 3 == 0)
            & (np.abs(u[:, 0, 0]) > 1e-2 * np.abs(u[:, 0, 0]).max())
        )
        both = np.linalg.solve(np.swapaxes(u[used, :, :3], 1, 2), np.swapaxes(y[used, :, :3], 1, 2))
        rows.append(measured(f[used], np.swapaxes(both, 1, 2), f"{level} mV"))
    made = tune_axes(rows, request(servo_rate=6400.0, control="pi", phase_step=math.radians(89.0)))
    found = made.decoupling
    assert found.before[0].max() == pytest.approx(0.85, abs=0.01)
    assert found.after[0].max() == pytest.approx(0.06, abs=0.01)
    assert all(one.stable and one.sensitivity_peak <= 2.0 for one in made.all_axes)
