"""`flexstage records`: what it says of files, and what it refuses."""

import json
import re

import numpy as np
import pytest

from flexstage.cli import main


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["records", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def found(capsys, *words):
    status, out, err = run(capsys, *words, "--json")
    assert (status, err) == (0, "")
    return json.loads(out)["files"]


@pytest.fixture
def gapped(tmp_path):
    file = tmp_path / "gapped.csv"
    t = np.delete(np.arange(60) / 50.0, [20, 21, 22])
    rows = [f"{a:.6g},{2.5 * a:.6g},{'' if i == 7 else i},on" for i, a in enumerate(t)]
    file.write_text("time (s),drive (mV),pos (um),state\n" + "\n".join(rows) + "\n")
    return file


def test_columns_rate_and_gaps(capsys, gapped):
    (one,) = found(capsys, gapped)
    assert [(c["name"], c["unit"], c["missing"]) for c in one["columns"]] == [
        ("time", "s", 0), ("drive", "V", 0), ("pos", "m", 1), ("state", "", 57),
    ]  # fmt: skip
    assert one["columns"][2]["largest"] == pytest.approx(56e-6)
    assert (one["over"], one["samples"], one["uniform"]) == ("time", 57, False)
    assert one["sample_rate_hz"] == pytest.approx(50.0)
    assert one["gaps"] == [{"after_sample": 19, "seconds": pytest.approx(0.08)}]
    status, out, _ = run(capsys, gapped)
    assert status == 0
    assert "57 samples over time, 50 Hz, non-uniform, from 0 to 1.18 s" in out
    assert "gap of 0.08 s after sample 19" in out


def test_responses_and_tables_without_times(capsys, tmp_path):
    response, table = tmp_path / "h.csv", tmp_path / "t.csv"
    response.write_text("freq (kHz),H_mag,H_phase_deg\n0.5,1.5,-10\n1,2.5,-90\n")
    table.write_text("u,y\n1,2\n2,5\n3,4\n")
    first, second = found(capsys, response, table)
    assert first["responses"] == ["H"]
    assert (first["from"], first["to"]) == (500.0, 1000.0)
    assert not any("sample rate" in note for note in first["notes"])
    assert second["over"] == "point"
    assert any("give the sample rate" in note for note in second["notes"])
    assert "frequency responses H: 2 lines from 500 to 1000 Hz" in run(capsys, response)[1]


@pytest.mark.parametrize(
    ("content", "goes_on"),
    [
        ("t [s];Spannung [V];Weg [µm]\n0;0;0\n0,1;5;2,5\n0,2;9;41,6\n", "identify"),
        ("t [s];force [N];a1 [m/s^2];a2 [m/s^2]\n0;1;2;3\n0,1;2;3;5\n0,2;1;0;4\n", "frf"),
        ("Winkel [deg];Fehler [arcsec]\n0;1,5\n120;2,5\n240;-4\n", "centre"),
        ("freq (kHz);H_mag;H_phase_deg\n0,5;1,5;-10\n1;2,5;-90\n", "frf"),
        ("t [s];a [V];b [V]\n0;1;2\n1;2;4\n2;3;5\n", ""),
        ("Winkel [deg];gap [arcsec]\n0;1,5\n120;2,5\n240;-4\n", ""),
    ],
)
def test_it_ends_with_the_command_that_goes_on(capsys, tmp_path, content, goes_on):
    path = tmp_path / "a b.csv"
    path.write_text(content)
    out = run(capsys, path)[1]
    assert out.endswith(f"next command: flexstage {goes_on} '{path}'\n") == bool(goes_on)
    assert ("next command" in out) == bool(goes_on)
    if "Weg" in content:
        assert re.search(r"2 +Weg +µm +0 +41\.6 ", out)


def test_bad_input(capsys, gapped, tmp_path):
    for words, said in (
        ((tmp_path / "none.csv",), "there is no file"),
        ((gapped, "--time", "state"), "is not a number"),
        ((gapped, "--rows", "9:3"), "'--rows': must rise"),
    ):
        status, out, err = run(capsys, *words)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert said in err


def test_the_next_command_has_the_options_of_its_own_file(capsys, tmp_path):
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    for file in files:
        file.write_text("u (V),y (um)\n0,1\n1,2\n2,4\n1,3\n")
    status, out, err = run(capsys, *files, "--sample-rate", "200,12.5", "--resample", "median")
    assert (status, err) == (0, "")
    lines = [line for line in out.splitlines() if line.startswith("next command")]
    for line, file, rate in zip(lines, files, ("200", "12.5"), strict=True):
        assert line.endswith(f"{file} --sample-rate {rate} --resample median")
    assert out.count("--resample applies to the next command") == 2
