"""`flexstage excite`: its table, its JSON, its file, and what it says about bad input."""

import json

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.lumped import lumped_system
from flexstage.records import read_record
from flexstage.stage import PiezoStack
from flexstage.stage.designs import design
from flexstage.system import modes


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["excite", *words])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


FREE = ("--voltage=-12:104", "--rates", "0.6,5.5", "--sample-rate", "1.5 kHz", "--duration", "19 s")


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".h5"])
def test_the_file_reads_back_within_the_limits(capsys, tmp_path, suffix):
    file = tmp_path / "new" / f"drive{suffix}"
    limits = ("--amplifier", "slew=1.8 V/ms,current=9 mA,capacitance=4.7 uF")
    status, out, err = run(capsys, *FREE, *limits, "--out", str(file), "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    record = read_record(file)
    u = record.channel("voltage").values
    assert record.channel("voltage").unit == "V"
    assert (u.min(), u.max()) == (-12.0, 104.0)
    assert record.size == result["samples"]
    assert record.time[-1] == pytest.approx(result["duration"], rel=1e-12)
    assert record.time[-1] <= 19.0
    slope = np.abs(np.diff(u)).max() * 1500.0
    assert slope == pytest.approx(result["largest_slope"], rel=1e-12)
    assert 4.7e-6 * slope == pytest.approx(result["largest_current"], rel=1e-12)
    assert slope <= 1800.0
    assert 4.7e-6 * slope <= 9e-3
    assert result["rates_hz"][1] == 5.5
    assert result["omitted"]
    assert result["parts"][0]["name"] == "conditioning"
    assert result["file"] == str(file)


def test_the_file_has_a_heading_with_units(capsys, tmp_path):
    file = tmp_path / "drive.csv"
    run(capsys, *FREE, "--out", str(file))
    lines = file.read_text("utf-8").splitlines()
    assert lines[0] == "time (s),voltage (V)"
    assert lines[1] == "0.0,0.0"
    assert all(len(line) < 40 for line in lines)
    assert [p.name for p in tmp_path.iterdir()] == ["drive.csv"]


def test_a_stage_gives_the_limits(capsys):
    words = ("vgtu-piezo", "--axis", "y", "--amplifier", "slew=2600 V/s", "--json")
    status, out, err = run(capsys, *words)
    assert (status, err) == (0, "")
    result = json.loads(out)
    stage = design("vgtu-piezo")
    stack = stage.drive("y")
    assert isinstance(stack, PiezoStack)
    assert stack.capacitance is not None
    assert tuple(result["voltage_range"]) == stack.voltage_range
    slope, current = result["largest_slope"], result["largest_current"]
    assert current == pytest.approx(stack.capacitance * slope)
    lowest = modes(lumped_system(stage), drives="in place").frequency_hz[0]
    assert result["natural_frequency_hz"] == pytest.approx(lowest, rel=1e-9)
    assert "multisine at the resonance" in {p["name"] for p in result["parts"]}
    without = json.loads(run(capsys, *words, "--no-multisine")[1])
    assert "multisine at the resonance" not in {p["name"] for p in without["parts"]}


def test_the_table_says_what_is_run_and_what_is_not(capsys):
    status, out, err = run(capsys, *FREE, "--shape", "sine", "--frequency", "140 Hz")
    assert (status, err) == (0, "")
    for part in ("sine", "conditioning", "nested loops about the middle", "reversals", "omitted:"):
        assert part in out
    assert "memory covered" in out
    assert "warning: no limit of slope" in out
    assert "mA" not in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--voltage is needed"),
        (("--voltage", "120"), 'must be a range LOW:HIGH, such as "10 V:20 V"'),
        (("--voltage", "0:12 m"), "not a unit of voltage"),
        (("--voltage", "30:30"), "must rise"),
        ((*FREE, "--axis", "x"), "--axis needs a STAGE"),
        (
            ("vgtu-piezo", "--voltage=-1:120"),
            "within 0 V to 120 V, the range of the stack of axis 'x'",
        ),
        (("vgtu-piezo", "--axis", "z"), "'z'"),
        (("vgtu-mechanical",), "driven by a screw"),
        (("vgtu-pieso",), "did you mean 'vgtu-piezo'"),
        (("vgtu-piezo", "--rates", "0.5,95"), "a tenth of the lowest natural frequency"),
        ((*FREE, "--rates", "1,fast"), "expected a frequency"),
        ((*FREE, "--amplifier", "slew=5 V"), "not a unit of slew rate"),
        ((*FREE, "--amplifier", "slew=900 V/s"), "too fast"),
        ((*FREE, "--amplifier", "current=5"), "has no unit"),
        ((*FREE, "--amplifier", "current=5 mA"), "needs the capacitance"),
        ((*FREE, "--duration", "2 s"), "need at least"),
        ((*FREE, "--duration", "2 V"), "not a unit of time"),
        ((*FREE, "--sample-rate", "0 Hz"), "'--sample-rate': must be above 0"),
        ((*FREE, "--shape", "squar"), "must be smooth, sine or triangle"),
        ((*FREE, "--rest", "105 V"), "rest voltage"),
        ((*FREE, "--seed", "-1"), "--seed"),
        ((*FREE, "--out", "drive.txt"), "must end in one of"),
    ],
)
def test_bad_input_gets_one_sentence_and_status_2(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *words)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_status_1(capsys, tmp_path):
    (tmp_path / "drive.csv").mkdir()
    status, out, err = run(capsys, *FREE, "--out", str(tmp_path / "drive.csv"))
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
