"""Commands on coupled drives: identified from records at levels, tested, and inverted."""

import json
from pathlib import Path

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.hysteresis.coupled_drives.model_file import read_coupled_model
from flexstage.records import write_record
from flexstage.records.read import read_files
from tests.coupled_records import PERIOD, multisine, simulated_records


def status(words: list[str]) -> object:
    with pytest.raises(SystemExit) as ended:
        main(words)
    return ended.value.code


COLUMNS = ("--input", "a,b", "--output", "x,y,z")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("records")
    return [write_record(r, folder / f"{k}.csv") for k, r in enumerate(simulated_records())]


def test_one_command_gives_table_model_and_figure(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    fitted = [str(f) for k, f in enumerate(files) if k % 4]
    tests = [word for f in files[::4] for word in ("--test-record", str(f))]
    out, figure = tmp_path / "model.yaml", tmp_path / "figure.svg"
    written = ["--out", str(out), "--figure", str(figure)]
    assert status(["identify", *fitted, *COLUMNS, *tests, *written]) == 0
    words = " ".join(capsys.readouterr().out.split())
    for expected in ("input rms [V]", "held out", "imaginary share", "from a, b to x, y, z"):
        assert expected in words
    assert "one model of all levels" in figure.read_text("utf-8")
    readings, _ = read_coupled_model(out).simulate(np.tile(multisine(0.4, 10), (6, 1)))
    # files have SI units
    measured = 1e-6 * simulated_records()[4].channel("x").values
    difference = readings[-2 * 1024 :, 0] - measured
    assert np.std(difference) < 0.02 * np.std(measured)
    picture = tmp_path / "prediction.svg"
    words = [str(out), str(files[4]), *COLUMNS, "--figure", str(picture), "--json"]
    assert status(["predict", *words]) == 0
    (row,) = json.loads(capsys.readouterr().out)["records"]
    assert row["error"] < 0.05 * row["output_rms"]
    assert row["samples_not_counted"] == 682
    assert "measured less predicted" in picture.read_text("utf-8")
    assert status(["predict", str(out), str(files[4]), *COLUMNS[:3], "x,y"]) == 2
    assert "the model has 3 outputs, x, y, z; got 2 columns" in capsys.readouterr().err
    assert status(["predict", str(out), str(files[4]), "--input", "a", "--output", "x"]) == 2
    assert "the model has 2 inputs, a, b; got 1 columns" in capsys.readouterr().err
    assert status(["predict", str(out), str(files[4])]) == 2
    assert "coupled drives need --input and --output" in capsys.readouterr().err
    follow(out, files[4], tmp_path, capsys)


def follow(model: Path, measured: Path, folder: Path, capsys: pytest.CaptureFixture) -> None:
    """Let the drives repeat the motion of a record, of which they made it."""
    command, figure = folder / "command.csv", folder / "command.svg"
    words = ["compensate", str(model), "--reference", str(measured), "--reference-bandwidth", "440"]
    assert status([*words, "--out", str(command), "--figure", str(figure)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "predicted error: x " in text
    assert "predicted less reference" in figure.read_text("utf-8")
    (record,) = read_files([command], ["a", "b"])
    voltages = np.column_stack([record.channel(n).values for n in "ab"])[-PERIOD:]
    true = multisine(0.4, 10)
    # levels have not settled from rest, as they had in the record; its ends are smoothed
    difference = (voltages - true)[200:-200]
    assert np.sqrt(np.mean(difference**2)) < 0.1 * np.sqrt(np.mean(true**2))
    assert status([*words, "--voltage=-0.5:0.5", "--column", "x,y,z", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["command_range"]["a"] == [-0.5, 0.5]
    assert data["limited_samples"] > 0
    assert sorted(data["predicted_rms_error"]) == ["x", "y", "z"]
    simulated = folder / "simulated.csv"
    assert status(["twin", str(model), "--play", str(command), "--out", str(simulated)]) == 0
    (played,) = read_files([simulated], ["x", "y", "z"])
    (expected,) = read_files([command], ["x predicted", "z predicted"])
    for name in "xz":
        values = expected.channel(f"{name} predicted").values
        assert played.channel(name).values == pytest.approx(values, abs=1e-12)
    capsys.readouterr()
    assert status(["twin", str(model)]) == 2
    assert "no simulated controller" in " ".join(capsys.readouterr().err.split())
    assert status(["export", str(model), "--to", "all", "--folder", str(folder / "out")]) == 0
    written = sorted(path.name for path in (folder / "out").rglob("*.*"))
    assert written == ["model.h", "model.mat", "model_check.csv"]
    assert "model: exported files" in capsys.readouterr().out
    assert status(["export", str(model), "--to", "c", "--model", "lumped"]) == 2
    assert "has no options of a stage" in " ".join(capsys.readouterr().err.split())
    for other, message in (
        (("--after", "rest"), "omit --relative and --after"),
        (("--column", "x,y"), "the model has 3 outputs, x, y, z; got 2 columns"),
    ):
        assert status([*words, *other]) == 2
        assert message in " ".join(capsys.readouterr().err.split())


def test_json_has_levels_modes_and_warnings(
    files: list[Path], capsys: pytest.CaptureFixture
) -> None:
    assert status(["identify", *map(str, files[:4]), *COLUMNS, "--json", "--quiet"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [level["records"] for level in data["levels"]] == [4]
    assert len(data["modes"][0]["input_shape"]) == 2
    assert data["warnings"][0].startswith("one level only: the model is linear")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--input", "a,b"), "several inputs need --output"),
        ((*COLUMNS, "--model", "preisach"), "options of a single drive"),
    ],
)
def test_requests_that_do_not_fit_are_refused(
    files: list[Path], words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture
) -> None:
    assert status(["identify", str(files[0]), *words]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
