"""`flexstage identify`: every format, its JSON, its files, and what it says about bad input."""

import contextlib
import io
import json
import os

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.hysteresis.model_file import read_model_text
from flexstage.virtual.stack import virtual_stack
from tests.computed_once import computed_once

RATE = 200.0
SIZE = 2200
STROKE_UM = 37.3
NOISE_UM = 0.03


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["identify", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def drive(t, rate_hz, duration):
    """Cycles of falling amplitude, 3 to 113 V."""
    share = np.clip(1.25 - t / duration, 0.15, 1.0)
    return 3.0 + 55.0 * (1.0 - share * np.cos(2.0 * np.pi * rate_hz * t))


def measured(rate_hz=1.3, sample_rate=RATE, size=SIZE, delay=0.0, seed=11):
    """Voltages, and micrometres of a stack that is of no fitted class, with noise."""
    t = np.arange(size) / sample_rate
    stack = virtual_stack((0.0, 120.0), STROKE_UM * 1e-6, 0.12)
    duration = size / sample_rate
    late = drive(np.maximum(t - delay, 0.0), rate_hz, duration)
    y = 1e6 * stack.simulate(late).values - 61.7
    y += np.random.default_rng(seed).normal(0.0, NOISE_UM, size)
    return drive(t, rate_hz, duration), y


@pytest.fixture(scope="module", autouse=True)
def _the_same_is_identified_once():
    """Tests look at one identification from several sides: it is made once for all of them."""
    with computed_once("flexstage.hysteresis.identification.identify", "identify"):
        yield


@pytest.fixture(scope="module")
def table():
    """Five columns, of which 0 is the voltage and 4 the position."""
    u, y = measured()
    other = np.random.default_rng(3).normal(size=(3, u.size))
    return np.column_stack((u, *other, y))


def write_csv(path, table):
    np.savetxt(path, table, delimiter=",", header="drive (V),a,b,c,position (um)", comments="")


def write_text(path, table):
    np.savetxt(path, table, delimiter="\t")


def write_mat(path, table):
    savemat(path, {"data": table})


def write_h5(path, table):
    with h5py.File(path, "w") as file:
        file["data"] = table


def write_tdms(path, table):
    with TdmsWriter(path) as file:
        file.write_segment(
            [
                ChannelObject("measured", f"c{i}", np.ascontiguousarray(c))
                for i, c in enumerate(table.T)
            ]
        )


def write_npy(path, table):
    np.save(path, table)


def write_npz(path, table):
    np.savez(path, data=table)


WRITERS = {
    "r.csv": write_csv,
    "r.txt": write_text,
    "r.dat": write_text,
    "r.mat": write_mat,
    "r.h5": write_h5,
    "r.tdms": write_tdms,
    "r.npy": write_npy,
    "r.npz": write_npz,
}
COLUMNS = ("--input", 0, "--output", 4, "--sample-rate", 200)
IN_UNITS = ("--input", "0 V", "--output", "4 um", "--sample-rate", 200)


@pytest.fixture(scope="module")
def text_file(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("in") / "drive.dat"
    write_text(path, table)
    return path


QUICK = (*COLUMNS, "--model", "dahl", "--known", "delay=0 s", "--json")


@pytest.fixture(scope="module")
def plain(table, tmp_path_factory):
    """What the record gives as plain text, with a quick model."""
    path = tmp_path_factory.mktemp("plain") / "plain.txt"
    write_text(path, table)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit):
        main(["identify", str(path), *(str(word) for word in QUICK)])
    return json.loads(said.getvalue())


def test_the_command_of_the_description(capsys, text_file):
    status, out, err = run(capsys, text_file, *COLUMNS, "--model", "preisach", "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert {
        "rms_percent",
        "max_percent",
        "heldout_rms_percent",
        "parameters",
        "chain",
        "warnings",
    } <= set(result)
    noise = 100.0 * NOISE_UM / STROKE_UM
    assert result["model"] == "preisach"
    assert 0.9 * noise < result["rms_percent"] < result["heldout_rms_percent"] < 4.0 * noise
    assert result["rms_percent"] < result["max_percent"] < 10.0 * noise
    assert result["noise_percent"] == pytest.approx(noise, rel=0.15)
    # 110 V of 120 V move a little less than in proportion
    assert 0.85 * STROKE_UM < result["stroke"]["value"] < 0.95 * STROKE_UM
    slopes = result["parameters"]["slopes"]
    assert np.shape(slopes["value"]) == np.shape(slopes["standard_error"]) == (16, 16)
    assert np.min(slopes["value"]) >= 0.0
    assert slopes["unit"] == "output/input"
    assert result["chain"]["sign"] == 1.0
    assert result["chain"]["delay"]["unit"] == "s"
    assert abs(result["chain"]["delay"]["value"]) < 0.003
    assert any("one rate only (1.3 Hz)" in w for w in result["warnings"])
    assert not any("minor loops" in w for w in result["warnings"])
    assert result["files"] == []


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same(capsys, tmp_path, table, plain, name):
    WRITERS[name](tmp_path / name, table)
    status, out, err = run(capsys, tmp_path / name, *QUICK)
    assert (status, err) == (0, "")
    result = json.loads(out)
    gain = result["parameters"]["gain"]
    # the heading of one file says micrometres, so that its numbers are metres
    scale, unit = (1e-6, "m/V") if name == "r.csv" else (1.0, "output/input")
    assert gain["unit"] == unit
    assert gain["value"] == pytest.approx(scale * plain["parameters"]["gain"]["value"], rel=1e-6)
    assert result["rms_percent"] == pytest.approx(plain["rms_percent"], rel=1e-6)


def test_names_and_units_of_columns(capsys, tmp_path, table):
    write_csv(tmp_path / "r.csv", table)
    words = ("--sample-rate", "0.2 kHz", "--model", "dahl", "--known", "delay=0 s", "--json")
    named = ("--input", "drive", "--output", "position nm")
    result = json.loads(run(capsys, tmp_path / "r.csv", *named, *words)[1])
    also = ("--input", "0", "--output", "column 4")
    write_text(tmp_path / "plain.txt", table)
    plain = json.loads(run(capsys, tmp_path / "plain.txt", *also, *words)[1])
    assert (result["stroke"]["unit"], plain["stroke"]["unit"]) == ("m", "")
    assert result["stroke"]["value"] == pytest.approx(1e-9 * plain["stroke"]["value"], rel=1e-9)


@pytest.mark.slow
def test_two_rates_tell_the_delay(capsys, tmp_path):
    delay = 0.0047
    for name, rate_hz, sample_rate in (("slow", 0.7, 100.0), ("fast", 9.1, 1700.0)):
        u, y = measured(rate_hz, sample_rate, 1900, delay)
        np.savetxt(tmp_path / f"{name}.txt", np.column_stack((u, y)))
    words = ("--input", 0, "--output", 1, "--sample-rate", "100,1700", "--model", "preisach")
    files = (tmp_path / "slow.txt", tmp_path / "fast.txt")
    status, out, err = run(capsys, *files, *words, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    found = result["chain"]["delay"]
    assert found["value"] == pytest.approx(delay, abs=4.0 * found["standard_error"] + 2e-5)
    assert found["standard_error"] < 2e-4
    assert not any("one rate" in w for w in result["warnings"])
    assert result["records"] == [str(f) for f in files]


def test_a_part_is_held_out(capsys, text_file):
    words = (*COLUMNS, "--model", "prandtl-ishlinskii", "--known", "delay=0 s", "--json")
    whole = json.loads(run(capsys, text_file, *words)[1])
    first = json.loads(run(capsys, text_file, *words, "--train", ":1500")[1])
    also = json.loads(run(capsys, text_file, *words, "--train", f"0:{1500}")[1])
    last = json.loads(run(capsys, text_file, *words, "--train", "900:")[1])
    assert first.pop("request")["train"] == [None, 1500]
    assert also.pop("request")["train"] == [0, 1500]
    assert first == also
    assert len({r["heldout_rms_percent"] for r in (whole, first, last)}) == 3
    assert len({r["rms_percent"] for r in (whole, first, last)}) == 3


def test_rows_are_read_before_anything_else(capsys, tmp_path, table, plain):
    spoilt = np.concatenate((np.full((100, 5), 7.7), table))
    write_text(tmp_path / "r.txt", spoilt)
    cut = json.loads(run(capsys, tmp_path / "r.txt", *QUICK, "--rows", "100:")[1])
    assert cut["parameters"] == plain["parameters"]


def test_a_known_chain_is_not_searched_for(capsys, text_file):
    words = (*COLUMNS, "--model", "dahl", "--json", "--known", "delay=3 ms,creep=1.1%")
    chain = json.loads(run(capsys, text_file, *words)[1])["chain"]
    assert chain["delay"] == {"value": 0.003, "standard_error": None, "unit": "s"}
    assert chain["creep_per_decade"]["value"] == pytest.approx(0.011)
    assert chain["resonance"]["value"] is None


def test_a_picture_that_fails_leaves_no_model(capsys, tmp_path, text_file, monkeypatch):
    def fails(**_):
        raise ModelError("the picture cannot be made")

    monkeypatch.setattr("flexstage.report.figures.identification.draw_identification", fails)
    out = tmp_path / "m.yaml"
    words = (*QUICK[:-1], "--out", out, "--figure", tmp_path / "m.svg")
    status, said, err = run(capsys, text_file, *words)
    assert (status, said, list(tmp_path.iterdir())) == (2, "", [])
    assert "the picture cannot be made" in err


def test_model_and_figure_are_written(capsys, tmp_path, text_file):
    out, svg, png = (tmp_path / "new" / n for n in ("m.yaml", "loop.svg", "loop.png"))
    words = (*IN_UNITS, "--model", "preisach", "--known", "delay=0 s")
    status, said, err = run(capsys, text_file, *words, "--out", out, "--figure", svg)
    assert (status, err) == (0, "")
    assert f"wrote {out}" in said.replace("\n", "")
    file = read_model_text(out.read_text("utf-8"))
    assert not any("changed" in w for w in file.warnings)
    assert file.model.hysteresis.kind == "preisach"
    assert (file.model.input_unit, file.model.output_unit) == ("V", "m")
    validity = file.model.validity
    assert validity is not None
    assert validity.input_range == pytest.approx((3.0, 113.0), abs=0.2)
    assert file.provenance["records"][0]["file"] == str(text_file)
    assert len(file.provenance["records"][0]["sha256"]) == 64
    assert file.errors["heldout_rms"] == pytest.approx(0.1, abs=0.08)
    assert svg.read_bytes().lstrip().startswith(b"<?xml")
    assert b"</svg>" in svg.read_bytes()
    quick = (*COLUMNS, "--model", "dahl", "--known", "delay=0 s")
    assert run(capsys, text_file, *quick, "--figure", png)[0] == 0
    assert png.read_bytes().startswith(b"\x89PNG")


def test_the_table_names_the_chosen_model_and_its_warnings(capsys, text_file):
    status, out, err = run(capsys, text_file, *COLUMNS, "--rows", ":900")
    assert (status, err) == (0, "")
    for word in (
        "preisach",
        "bouc-wen",
        "held out, as predicted",
        "delay",
        "warning: one rate only",
    ):
        assert word in out
    assert "nan" not in out


def test_the_table_is_in_units_that_suit(capsys, text_file):
    words = (*IN_UNITS, "--model", "bouc-wen", "--known", "delay=7 ms")
    status, out, err = run(capsys, text_file, *words)
    assert (status, err) == (0, "")
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.strip()}
    assert rows["gain"][-1] == rows["hysteresis_gain"][-1] == "um/V"
    assert rows["delay"] == ["7", "ms"]
    assert rows["offset"][-1] == "um"
    assert 0.85 * STROKE_UM < float(rows["stroke"][0]) < 0.95 * STROKE_UM
    assert rows["stroke"][1] == "um"
    assert "e-0" not in out


def test_a_gain_that_a_model_does_without_is_not_printed(capsys, text_file):
    status, out, err = run(
        capsys, text_file, *COLUMNS, "--model", "preisach", "--known", "delay=0 s"
    )
    assert (status, err) == (0, "")
    assert "\n gain " not in out
    assert "output/input on average" in out


def test_what_was_fitted_is_counted_in_the_file(capsys, text_file):
    words = (
        *COLUMNS,
        "--model",
        "dahl",
        "--known",
        "delay=0 s",
        "--rows",
        "200:",
        "--train",
        "700:1500",
    )
    status, out, err = run(capsys, text_file, *words, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    count, total = (int(word) for word in result["fitted"].split(" samples")[0].split(" of "))
    assert count == 800
    assert result["fitted"].endswith("samples, 3.5 to 7.495 s")
    assert total == len(np.loadtxt(text_file)) - 200
    low, high = result["heldout_interval_percent"]
    assert low < result["heldout_rms_percent"] < high < 4.0 * result["heldout_rms_percent"]
    assert result["heldout_median_percent"] <= result["heldout_worst_percent"]


BAD_OPTIONS = [
    (("--model", "boucwen"), "the model 'boucwen' is not known: choose from auto, "),
    (("--output", "7"), "no column 7"),
    (("--output", "position"), "no column 'position'"),
    (("--output", "-1"), "no column '-1'"),
    (("--sample-rate", "fast"), "expected a frequency"),
    (("--sample-rate", "0"), "'--sample-rate': must be above 0"),
    (("--sample-rate", "-200"), "'--sample-rate': must be above 0"),
    (("--sample-rate", "200,100"), "got 2"),
    (("--train", "12"), "'--train': must be a range"),
    (("--train", "900:300"), "'--train': must rise"),
    (("--train", "0:30"), "at least 50 of each"),
    (("--train", "99999:"), "--train"),
    (("--rows", "a:b"), "'--rows': must be a range"),
    (("--rows", "0:40"), "at least 50"),
    (("--rows", "900:901"), "a record needs at least two samples"),
    (("--known", "delay=5"), "has no unit"),
    (("--known", "delay=-1 ms"), "delay"),
    (("--known", "delay=nan s"), "nan"),
    (("--known", "creep=much"), "much"),
    (("--known", "creep=-3%"), "'--known': creep must be from 0 to below 1"),
    (("--input", "0 furlong"), "furlong"),
    (("--format", "excel"), "excel"),
    (("--text", "skip=-2"), "'--text': skip must be a whole number from 0"),
    (("--text", "decimal=;"), "'--text': decimal must be"),
    (("--time", "9"), "9"),
    (("--figure", "loop.bmp"), "bmp"),
    (
        ("--figure", "loop"),
        "must end in one of .svg, .png, .pdf, which selects the format, got 'loop'",
    ),
    (("--out", ""), "--out"),
    (("--output", "0"), "same column"),
    (("--input", "4", "--output", "0"), "the output leads the input"),
]


@pytest.mark.parametrize(("words", "said"), BAD_OPTIONS)
def test_bad_options(capsys, tmp_path, monkeypatch, text_file, words, said):
    monkeypatch.chdir(tmp_path)
    given = dict(zip(COLUMNS[::2], COLUMNS[1::2], strict=True))
    given |= {"--model": "dahl", "--out": "model.yaml"}
    given |= dict(zip(words[::2], words[1::2], strict=True))
    status, out, err = run(capsys, text_file, *(f"{k}={v}" for k, v in given.items()))
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def bad_records(table):
    u, y = table[:, 0], table[:, 4]
    spoilt = y.copy()
    spoilt[700] = np.nan
    infinite = u.copy()
    infinite[5] = np.inf
    noise = np.random.default_rng(1).normal(size=u.size)
    half = np.linspace(0.0, 100.0, 300)
    return {
        "nan": (u, spoilt, "700"),
        "infinite": (infinite, y, "5"),
        "constant output": (u, np.full_like(y, 3.3), "constant"),
        "constant input": (np.full_like(u, -1.0), y, "constant"),
        "short": (u[:30], y[:30], "at least 50"),
        "half a cycle": (half, 0.3 * half + 0.001 * half**2, "no complete cycle"),
        "unrelated": (u, noise, "does not follow"),
        "swapped": (y, u, "leads the input"),
        "falling and swapped": (-y, u, "leads the input"),
        "too large": (u * 1e200, y, "another unit"),
        "too small": (u, y * 1e-150, "another unit"),
    }


BAD_RECORDS = tuple(bad_records(np.ones((800, 5))))


@pytest.mark.parametrize("name", BAD_RECORDS)
def test_bad_records(capsys, tmp_path, table, name):
    u, y, said = bad_records(table)[name]
    path = tmp_path / "r.txt"
    np.savetxt(path, np.column_stack((u, y)))
    out_file = tmp_path / "m.yaml"
    words = ("--input", 0, "--output", 1, "--sample-rate", 200, "--out", out_file)
    status, out, err = run(capsys, path, *words)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert not out_file.exists()


def test_uneven_sampling_and_no_sampling(capsys, tmp_path, table):
    t = np.arange(SIZE) / RATE
    t[1000:] += 0.4
    path = tmp_path / "r.csv"
    columns = np.column_stack((t, table[:, 0], table[:, 4]))
    np.savetxt(path, columns, delimiter=",", header="time (s),u (V),y (um)", comments="")
    status, _, err = run(capsys, path, "--input", "u", "--output", "y")
    assert status == 2
    assert "has a gap of 0.405" in err
    np.savetxt(path, columns[:, 1:], delimiter=",", header="u (V),y (um)", comments="")
    status, _, err = run(capsys, path, "--input", "u", "--output", "y")
    assert status == 2
    assert "--sample-rate" in err or "sample rate" in err


def test_files_that_are_not_there_or_no_records(capsys, tmp_path):
    for name, content in (("empty.csv", b""), ("noise.mat", bytes(range(256)))):
        (tmp_path / name).write_bytes(content)
    for name in ("none.csv", "empty.csv", "noise.mat", "."):
        status, out, err = run(capsys, tmp_path / name, *COLUMNS)
        assert status in (1, 2)
        assert out == ""
        assert err.count("\n") == 1
        assert "Traceback" not in err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written(capsys, tmp_path, text_file):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    status, _, err = run(capsys, text_file, *COLUMNS, "--model", "dahl", "--out", locked / "m.yaml")
    assert status == 1
    assert err.count("\n") == 1


def test_a_path_that_cannot_be_written_is_status_1(capsys, tmp_path, text_file):
    (tmp_path / "m.yaml").mkdir()
    status, out, err = run(
        capsys, text_file, *COLUMNS, "--model", "dahl", "--out", tmp_path / "m.yaml"
    )
    assert (status, out) == (1, "")
    assert err.count("\n") == 1


def test_a_known_resonance_is_taken(capsys, text_file):
    status, out, _ = run(
        capsys, text_file, *COLUMNS, "--model", "dahl", "--known", "resonance=71 Hz", "--json"
    )
    assert status == 0
    assert json.loads(out)["chain"]["resonance"]["value"] == 71.0
    status, _, err = run(capsys, text_file, *COLUMNS, "--known", "resonance=0 Hz")
    assert status == 2
    assert "'--known': resonance must be above 0" in err


def test_the_record_is_compared_with_the_description_of_the_drive(capsys, text_file):
    words = [text_file, "--sample-rate", RATE, "--model", "dahl", "--known", "delay=0 s"]
    words += ["--stage", "vgtu-piezo", "--json"]

    def said(input_unit, output_unit):
        columns = ["--input", f"0 {input_unit}", "--output", f"4 {output_unit}"]
        status, out, err = run(capsys, *words, *columns)
        assert (status, err) == (0, "")
        return [w for w in json.loads(out)["warnings"] if "vgtu-piezo" in w]

    assert said("V", "um") == []
    (voltage,) = said("mV", "um")
    assert "the voltage range of the drive of axis 'x' of vgtu-piezo is 120 V" in voltage
    assert "check the unit of the input" in voltage
    (motion,) = said("V", "mm")
    assert "check the unit of the output" in motion
    status, _, err = run(capsys, *words[:-3], "--axis", "x")
    assert status == 2
    assert "--axis needs --stage" in err


def test_the_verdict_is_told_and_drift_is_fitted_on_demand(capsys, tmp_path, table):
    moved = table.copy()
    moved[:, 4] += np.linspace(0.0, 0.3 * STROKE_UM, table.shape[0])
    moved[[700, 1501], 4] -= 4.0 * STROKE_UM
    path = tmp_path / "drifts.txt"
    write_text(path, moved)
    words = (*COLUMNS, "--model", "bouc-wen", "--known", "delay=0 s", "--json")
    blind, told = (
        json.loads(run(capsys, path, *words, *more)[1]) for more in ((), ("--zero", "drift"))
    )
    findings = {f["kind"]: f for f in blind["quality"]["findings"]}
    assert set(findings) == {"spikes", "drift"}
    assert findings["spikes"]["at"] == pytest.approx([700 / RATE, 1501 / RATE])
    assert blind["quality"]["fits"] == (blind["quality"]["reason"] == "")
    assert any("--zero drift" in w for w in blind["warnings"])
    assert [f["kind"] for f in told["quality"]["findings"]] == ["spikes"]
    assert told["heldout_rms_percent"] < 0.7 * blind["heldout_rms_percent"]
