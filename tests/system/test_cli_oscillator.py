"""`flexstage identify` of a stage that resonates within the band of its command."""

import json
from pathlib import Path

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.hysteresis import BoucWenOscillator, read_oscillator
from flexstage.hysteresis.oscillator.model_file import OscillatorModel
from flexstage.records import Channel, Record, write_record

RATE, N = 800.0, 1600
TRUE = BoucWenOscillator(
    mass=1.7, damping=8.0, stiffness=4.1e4, alpha=5.3e4, beta_gamma=870.0, beta_delta=420.0
)
COLUMNS = ("--input", "force", "--output", "position")
OSCILLATOR = ("--model", "bouc-wen-oscillator")


def written(folder: Path, name: str, force: np.ndarray, position: np.ndarray) -> str:
    channels = (
        Channel(name="force", values=force, unit="N"),
        Channel(name="position", values=position, unit="m"),
    )
    record = Record(channels=channels, time=np.arange(force.size) / RATE)
    return str(write_record(record, folder / name))


def pushes(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 90.0 * np.convolve(rng.standard_normal(N), np.hanning(9), "same")


def run(capsys: pytest.CaptureFixture, *words: str) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([*words, "--quiet"])
    output = capsys.readouterr()
    return ended.value.code, output.out, output.err


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return a record from rest, and one period of a motion that repeats; the sensor has a zero."""
    folder = tmp_path_factory.mktemp("records")
    noise = 1e-7 * np.random.default_rng(9).standard_normal(N)
    force = pushes(3)
    position = 4e-4 + TRUE.simulate(force, RATE).displacement + noise
    first = written(folder, "first.csv", force, position)
    force = pushes(5)
    again = TRUE.simulate(np.tile(force, 4), RATE, interpolation="periodic").displacement[3 * N :]
    return [first, written(folder, "again.csv", force, 4e-4 + again)]


def test_identify_names_the_resonance_and_the_model_for_it(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    status, out, err = run(capsys, "identify", files[0], *COLUMNS)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "follows 'force' (coherence 0." in err
    assert "--model bouc-wen-oscillator" in err
    # small motion resonates at 37.4 Hz; the loop softens it
    frequency = float(err.split("largest gain at ")[1].split(" Hz")[0])
    assert 25.0 < frequency < 38.0
    model, figure = tmp_path / "stage.yaml", tmp_path / "stage.svg"
    words = ("--out", str(model), "--figure", str(figure), "--test-record", files[1])
    status, out, _ = run(capsys, "identify", files[0], *COLUMNS, *OSCILLATOR, *words)
    assert status == 0
    printed = " ".join(out.split())
    for expected in ("natural frequency of small motion 37.4", "kg", "again.csv is taken to begin"):
        assert expected in printed
    assert "measured less predicted" in figure.read_text("utf-8")
    read = read_oscillator(model)
    assert read.offset == pytest.approx(4e-4, abs=1e-7)
    for name in ("mass", "stiffness", "alpha", "beta_gamma", "beta_delta"):
        assert getattr(read.oscillator, name) == pytest.approx(getattr(TRUE, name), rel=5e-3)
    status, out, _ = run(capsys, "predict", str(model), *files, "--json")
    assert status == 0
    from_rest, repeated = json.loads(out)["records"]
    assert from_rest["error"] == pytest.approx(1e-7, rel=0.1)
    assert repeated["error"] < 1e-6
    _, out, _ = run(capsys, "predict", str(model), files[1], "--figure", str(figure))
    assert "begin in a motion that repeats" in " ".join(out.split())
    status, _, err = run(capsys, "predict", str(model), files[0], "--after", "rest")
    assert (status, err.count("\n")) == (2, 1)
    assert "--after is not known for an oscillator" in err


@pytest.mark.parametrize(
    "words",
    [
        (*OSCILLATOR, "--zero", "drift"),
        ("--model", "bouc-wen-oscillator,preisach"),
        (*OSCILLATOR, "--stage", "vgtu-piezo"),
    ],
)
def test_other_options_are_refused(
    files: list[str], words: tuple[str, ...], capsys: pytest.CaptureFixture
) -> None:
    status, _, err = run(capsys, "identify", files[0], *COLUMNS, *words)
    assert (status, err.count("\n")) == (2, 1)
    assert "bouc-wen-oscillator is identified without other models" in err


# Hardening, which no Bouc-Wen force has, in a motion of other code.
def test_another_plant_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    force, y, v, step = pushes(3), 0.0, 0.0, 1.0 / RATE / 32
    position = np.empty(N)
    for i in range(N):
        position[i] = y
        for _ in range(32):
            v += step * (force[i] - 8.0 * v - 9e4 * y - 4e11 * y**3) / 1.7
            y += step * v
    file = written(tmp_path, "hard.csv", force, position)
    status, _, err = run(capsys, "identify", file, *COLUMNS, *OSCILLATOR)
    assert status == 1
    assert "oscillator" in err
    assert err.count("\n") == 1


# The first input is reached in a quarter of a second and held for a second, by linear steps.
def test_a_record_may_begin_at_rest_under_a_load() -> None:
    force = 60.0 + np.concatenate((np.zeros(2), pushes(3)[: N - 2]))
    rise = np.interp(np.arange(1000), [0, 200, 1000], [0.0, 60.0, 60.0])
    position = TRUE.simulate(np.concatenate((rise, force)), RATE, interpolation="linear")
    model = OscillatorModel(
        oscillator=TRUE, offset=-2e-3, inputs=("u",), outputs=("y",), input_unit="N",
        output_unit="m", largest=2e-3, error=0.0,
    )  # fmt: skip
    values = {"u": force, "y": position.displacement[1000:] - 2e-3}
    channels = (
        Channel(name="u", values=values["u"], unit="N"),
        Channel(name="y", values=1e3 * values["y"], unit="mm"),
    )
    prediction = model.predict(Record(channels=channels, time=np.arange(N) / RATE), "u", "y")
    assert "at rest under its first input" in prediction.notes[0]
    assert prediction.error < 0.03 * prediction.output_rms
    assert prediction.output_rms == pytest.approx(np.std(values["y"]))
