"""`flexstage compensate`: from a record by a model file to a command that makes a drive follow."""

import json
import re

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.hysteresis.loops import loop_width
from flexstage.hysteresis.model_file import read_model_text
from flexstage.records import read_record
from flexstage.virtual.stack import virtual_stack

RATE = 250.0
STACK = virtual_stack((0.0, 120.0), 38e-6, 0.12)
OFFSET = -17.2e-6


def run(capsys, command, *words):
    with pytest.raises(SystemExit) as ended:
        main([command, *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    """A Preisach model of the virtual stack, by the command that identifies it."""
    folder = tmp_path_factory.mktemp("identified")
    t = np.arange(3000) / RATE
    share = np.clip(1.25 - t / t[-1], 0.1, 1.0)
    u = 60.0 * (1.0 - share * np.cos(2.0 * np.pi * 1.25 * t))
    y = OFFSET + STACK.simulate(u).values + np.random.default_rng(8).normal(0.0, 2e-8, t.size)
    np.savetxt(
        folder / "drive.csv", np.column_stack((t, u, y)), delimiter=",",
        header="time (s),u (V),y (m)", comments="",
    )  # fmt: skip
    words = ["--input", "u", "--output", "y", "--model", "preisach", "--known", "delay=0 s"]
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(folder / "drive.csv"), *words, "--out", str(folder / "m.yaml")])
    assert ended.value.code == 0
    return folder / "m.yaml"


def reference():
    """Six cycles of sine and one small one, in micrometres of the sensor."""
    t = np.arange(1600) / RATE
    turns = np.where(t < 4.8, np.cos(2.0 * np.pi * 1.25 * t), 0.4 + 0.6 * np.cos(5.0 * np.pi * t))
    return 2.3 - 13.0 * turns


@pytest.fixture
def reference_file(tmp_path):
    path = tmp_path / "in" / "reference.csv"
    path.parent.mkdir()
    np.savetxt(path, reference(), header="wanted (um)", comments="")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".h5", ".mat"])
def test_the_drive_follows(capsys, tmp_path, model_file, reference_file, suffix):
    out_file = tmp_path / "new" / f"command{suffix}"
    words = (model_file, "--reference", reference_file, "--sample-rate", "250 Hz")
    status, out, err = run(capsys, "compensate", *words, "--out", out_file, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["file"] == str(out_file)
    assert (result["samples"], result["limited_samples"]) == (1600, 0)
    assert result["predicted_max_error"] < 1e-12
    assert (result["input_unit"], result["output_unit"]) == ("V", "m")
    record = read_record(out_file)
    command = record.channel("command").values
    assert [command.min(), command.max()] == pytest.approx(result["command_range"])
    assert record.channel("command").unit == "V"
    assert record.sample_rate_hz == pytest.approx(RATE)
    wanted = 1e-6 * reference()
    assert record.channel("reference").values == pytest.approx(wanted, abs=1e-15)
    # now the stack itself, which is of no class that was fitted, after cycles over its range
    before = STACK.simulate([120.0, 0.0] * 4).state
    came = OFFSET + STACK.simulate(command, before).values
    # the offset of a stack that was cycled differs from that of one that never moved
    error = came - wanted
    error -= error.mean()
    assert np.sqrt(np.mean(error**2)) < 4e-3 * np.ptp(wanted)
    bounds = np.arange(2, 6) * 200
    straight = np.interp(wanted, (wanted.min(), wanted.max()), (command.min(), command.max()))
    opened = loop_width(wanted, STACK.simulate(straight, before).values, bounds)
    closed = loop_width(wanted, came, bounds)
    assert opened > 0.08 * np.ptp(wanted)
    assert closed < 0.05 * opened


def test_the_printed_result(capsys, model_file, reference_file):
    words = (model_file, "--reference", reference_file, "--sample-rate", 250)
    status, out, err = run(capsys, "compensate", *words)
    assert (status, err) == (0, "")
    assert "1600 samples of" in out
    assert "by the inverse of preisach" in out
    assert "for the model itself" in out
    assert "note: from the identification of the model: one rate only" in out


def test_limits_and_slew_hold(capsys, tmp_path, model_file, reference_file):
    words = (model_file, "--reference", reference_file, "--sample-rate", 250, "--json")
    more = ("--voltage", "20:80", "--amplifier", "slew=190 V/s", "--out", tmp_path / "c.npz")
    status, out, err = run(capsys, "compensate", *words, *more)
    assert (status, err) == (0, "")
    result = json.loads(out)
    command = read_record(tmp_path / "c.npz").channel("command").values
    assert command.min() >= 20.0
    assert command.max() <= 80.0
    assert np.abs(np.diff(command)).max() <= 190.0 / RATE * (1.0 + 1e-12)
    assert result["limited_samples"] > 100
    assert result["predicted_max_error"] > 1e-6
    assert any("limits changed" in note for note in result["notes"])
    # 0.9 mA into 5 uF are 180 V/s, which is less
    more = ("--amplifier", "slew=190 V/s,current=0.9 mA,capacitance=5 uF")
    run(capsys, "compensate", *words, *more, "--out", tmp_path / "d.npz")
    slopes = np.abs(np.diff(read_record(tmp_path / "d.npz").channel("command").values))
    assert slopes.max() == pytest.approx(180.0 / RATE, rel=1e-9)


def test_a_relative_reference_starts_at_the_lowest_reading(capsys, tmp_path, model_file):
    drive = read_model_text(model_file.read_text("utf-8")).model
    assert drive.validity is not None
    lowest = drive.validity.output_range[0]
    wanted = 8.1e-6 * (1.2 - np.cos(np.arange(500) / 40.0))
    np.savetxt(tmp_path / "r.txt", wanted)
    np.savetxt(tmp_path / "a.txt", wanted + lowest)
    words = ("--sample-rate", 250, "--column", "0 m", "--json")
    relative, absolute = (
        json.loads(
            run(capsys, "compensate", model_file, "--reference", tmp_path / n, *words, *w)[1]
        )
        for n, w in (("r.txt", ("--relative",)), ("a.txt", ()))
    )
    assert relative["command_range"] == pytest.approx(absolute["command_range"], rel=1e-9)
    rest = run(
        capsys, "compensate", model_file, "--reference", tmp_path / "a.txt", *words, "--after",
        "rest",
    )  # fmt: skip
    assert rest[0] == 0
    assert json.loads(rest[1])["command_range"] != absolute["command_range"]


def test_a_reference_in_two_files_needs_the_command_of_one(capsys, tmp_path, model_file):
    for name, rows in (("one", slice(None)), ("first", slice(1150)), ("second", slice(1150, None))):
        np.savetxt(tmp_path / f"{name}.csv", reference()[rows], header="wanted (um)", comments="")
    commands = {}
    for name, *after in (("one",), ("first",), ("second", "first-sent.csv"), ("second",)):
        words = (model_file, "--reference", tmp_path / f"{name}.csv", "--sample-rate", 250)
        for file in after:
            words += ("--after", tmp_path / file)
        out = tmp_path / f"{name}-sent.csv"
        status, text, err = run(capsys, "compensate", *words, "--out", out, "--json")
        assert (status, err) == (0, "")
        assert bool(after) == any("first-sent.csv" in n for n in json.loads(text)["notes"])
        commands[name, *after] = read_record(out).channel("command").values
    told, blind = commands["second", "first-sent.csv"], commands["second",]
    assert told == pytest.approx(commands["one",][1150:], abs=1e-6)
    assert np.abs(blind - told).max() > 1.0


def test_an_edited_model_is_said(capsys, tmp_path, model_file, reference_file):
    text = model_file.read_text("utf-8")
    start = text.index("offset: ")
    end = text.index(",", start)
    (tmp_path / "e.yaml").write_text(f"{text[:start]}offset: -17.0e-6{text[end:]}", "utf-8")
    words = ("--reference", reference_file, "--sample-rate", 250, "--json")
    result = json.loads(run(capsys, "compensate", tmp_path / "e.yaml", *words)[1])
    assert "the file was changed since it was written" in result["notes"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--voltage", "5"), 'must be a range LOW:HIGH, such as "10 V:20 V"'),
        (("--voltage", "80:20"), "must rise"),
        (("--voltage", "0:9 m"), "not a unit of voltage"),
        (("--amplifier", "slew=5 V"), "'--amplifier': slew 'V' is not a unit of slew rate"),
        (("--amplifier", "slew=-5 V/s"), "'--amplifier': slew must be above 0"),
        (("--amplifier", "slew=0 V/s"), "'--amplifier': slew must be above 0"),
        (("--amplifier", "current=5 mA"), "needs the capacitance"),
        (("--amplifier", "current=5 mA,capacitance=0 uF"), "capacitance must be above 0"),
        (("--amplifier", "capacitance=5 uF"), "the capacitance needs the current limit"),
        (("--reference-bandwidth", "0 Hz"), "'--reference-bandwidth': must be above 0"),
        (("--reference-bandwidth", "1e-9 Hz"), "too low for a sequence"),
        (("--reference-bandwidth", "low"), "expected a frequency"),
        (("--after", "warm"), "--after must be conditioned, rest, a time"),
        (("--after", "rested"), "rested is called rest"),
        (("--after", "none.csv"), "none.csv"),
        (("--column", "3"), "no column 3"),
        (("--column", "wanted V"), "that of the model in m"),
        (("--column", "wanted furlong"), "furlong"),
        (("--sample-rate", "quick"), "expected a frequency"),
        (("--out", "c.txt"), "--out must end in one of"),
        (("--rows", "7:3"), "must rise"),
        (("--reference", "none.csv"), "none.csv"),
        (("--column", "wanted mm"), "shift the reference into that range; it spans"),
    ],
)
def test_bad_options(capsys, tmp_path, monkeypatch, model_file, reference_file, words, said):
    monkeypatch.chdir(tmp_path)
    given = {"--reference": reference_file, "--sample-rate": 250, "--out": "c.csv"}
    given |= dict(zip(words[::2], words[1::2], strict=True))
    status, out, err = run(
        capsys, "compensate", model_file, *(f"{k}={v}" for k, v in given.items())
    )
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert [p.name for p in tmp_path.iterdir()] == ["in"]


def test_a_reference_without_unit_is_refused(capsys, tmp_path, model_file):
    np.savetxt(tmp_path / "r.txt", reference())
    words = ("--reference", tmp_path / "r.txt", "--sample-rate", 250)
    status, _, err = run(capsys, "compensate", model_file, *words)
    assert status == 2
    assert 'give it after the column, such as --column "1 m"' in err


def test_a_model_without_unit_and_a_reference_with_one(
    capsys, tmp_path, model_file, reference_file
):
    """Numbers in um were taken for numbers in m: a flat command, without a word."""
    text = model_file.read_text("utf-8")
    changed = re.sub(r"(output:.*?unit:) m\b", r'\1 ""', text, flags=re.DOTALL)
    assert changed != text
    (tmp_path / "bare.yaml").write_text(changed, "utf-8")
    words = ("--reference", reference_file, "--sample-rate", 250)
    status, out, err = run(capsys, "compensate", tmp_path / "bare.yaml", *words)
    assert (status, out) == (2, "")
    assert "the reference is in m and the model was identified without a unit" in err
    # a model in um is told, and gives the command of the model in m
    scaled = changed.replace('unit: ""', "unit: mm")
    (tmp_path / "mm.yaml").write_text(scaled, "utf-8")
    status, _, err = run(capsys, "compensate", tmp_path / "mm.yaml", *words)
    assert status == 2  # its numbers are those of m, and so 20 um are 0.02 there
    assert "check its unit" in err


def test_rates_and_spans_that_do_not_suit_are_said(capsys, tmp_path, model_file):
    t = np.arange(1000) / RATE
    wanted = 2.3 - 13.0 * np.cos(2.0 * np.pi * 12.0 * t)
    np.savetxt(tmp_path / "fast.csv", wanted, header="wanted (um)", comments="")
    np.savetxt(tmp_path / "small.csv", 2.3e-3 * (1.0 - np.cos(8.0 * t)), header="wanted (um)",
               comments="")  # fmt: skip
    words = ("--sample-rate", 250, "--json")
    status, out, _ = run(
        capsys, "compensate", model_file, "--reference", tmp_path / "fast.csv", *words
    )
    assert status == 0
    notes = json.loads(out)["notes"]
    assert any("cycles repeat at 11.9" in n and "identified at 1.25 Hz" in n for n in notes)
    status, out, _ = run(
        capsys, "compensate", model_file, "--reference", tmp_path / "small.csv", *words
    )
    assert status == 0
    notes = json.loads(out)["notes"]
    assert sum("check its unit" in n for n in notes) == 2  # of the reference, of the command


def test_a_reference_of_uneven_times_is_made_even(capsys, tmp_path, model_file):
    y = reference()
    t = np.arange(y.size) / RATE + np.random.default_rng(4).uniform(-0.2, 0.2, y.size) / RATE
    even = np.arange(y.size) / RATE
    rows = [f"{a:.9f},{b:.9f},OK" for a, b in zip(t, np.interp(t, even, y), strict=True)]
    file = tmp_path / "r.csv"
    file.write_text("\n".join(["time (s),wanted (um),state", *rows]))
    words = ("--reference", file, "--column", "wanted")
    status, _, err = run(capsys, "compensate", model_file, *words)
    assert status == 2
    assert "option resample" in err
    status, out, _ = run(capsys, "compensate", model_file, *words, "--resample", "250", "--json")
    assert status == 0
    result = json.loads(out)
    assert result["samples"] == pytest.approx(y.size, abs=2)
    for said in ("resampled at 250 Hz", "skipped columns with text: state ('OK')"):
        assert any(note.startswith(said) for note in result["notes"])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty, expected a model file"),
        (b"\xff\xfe\x00\x01", "not UTF-8 text"),
        (b"name: vgtu-piezo\n", "begins with 'flexstage-drive-model: 1', which is missing"),
        (b"flexstage-drive-model: 3\n", "newer flexstage"),
        (None, "give the path of a model file from `flexstage identify --out`"),
    ],
)
def test_files_that_are_no_models(capsys, tmp_path, reference_file, content, said):
    if content is not None:
        (tmp_path / "m.yaml").write_bytes(content)
    words = ("--reference", reference_file, "--sample-rate", 250)
    status, out, err = run(capsys, "compensate", tmp_path / "m.yaml", *words)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    status, _, err = run(capsys, "compensate", tmp_path, *words)
    assert status == 2
    assert "is a directory" in err
