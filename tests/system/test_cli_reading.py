"""What commands that identify read: text beside numbers, jitter, parts, and what figures show."""

import json
import re

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.cli import main
from flexstage.records.drives import read_drive, train_range
from flexstage.records.read_options import DriveColumns, ReadOptions
from flexstage.virtual.stack import virtual_stack

RATE = 100.0
MODEL = ("--model", "prandtl-ishlinskii", "--known", "delay=0 s", "--json")


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["identify", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def refused(capsys, *words):
    status, out, err = run(capsys, *words)
    assert (status, err.count("\n")) == (2, 1)
    assert json.loads(out)["error"]["message"] in err if "--json" in words else out == ""
    return err


def volts(t):
    share = np.clip(1.2 - t / 14.0, 0.2, 1.0)
    return 3.0 + 55.0 * (1.0 - share * np.cos(2.0 * np.pi * 0.9 * t))


@pytest.fixture(scope="module")
def columns():
    """Time, voltage and micrometres of a stack that is of no fitted class."""
    t = np.arange(1200) / RATE
    u = volts(t)
    return t, u, 1e6 * virtual_stack((0.0, 120.0), 37e-6, 0.12).simulate(u).values


def read(*files, columns=None, **how):
    """Read a drive as the commands do."""
    columns = columns or DriveColumns(input=("u",), output=("y",))
    return read_drive(list(files), columns, ReadOptions(**how))


def write(path, names, *columns, row="{}"):
    lines = [",".join(f"{v:.9g}" for v in values) for values in zip(*columns, strict=True)]
    path.write_text("\n".join([names, *map(row.format, lines)]) + "\n")
    return path


# ------------------------------------------------------------------ text beside numbers


def test_words_and_dates_beside_the_columns_change_nothing(capsys, tmp_path, columns):
    plain = write(tmp_path / "plain.csv", "time (s),u,y", *columns)
    words = write(tmp_path / "w.csv", "day,time (s),u,y,state", *columns, row="06.05.2024,{},OK")
    found = [
        json.loads(run(capsys, file, "--input", "u", "--output", "y", *MODEL)[1])
        for file in (plain, words)
    ]
    assert found[0]["parameters"] == found[1]["parameters"]
    said = [n for n in found[1]["notes"] if n.startswith("skipped columns")]
    assert said == ["skipped columns with text: day ('06.05.2024'), state ('OK')"]


def test_a_word_in_a_column_that_is_asked_for(capsys, tmp_path, columns):
    file = write(tmp_path / "w.csv", "time (s),u,y,state", *columns, row="{},OK")
    lines = file.read_text().splitlines()
    lines[700] = lines[700].rsplit(",", 2)[0] + ",overload,bad"
    file.write_text("\n".join(lines))
    err = refused(capsys, file, "--input", "u", "--output", "y", *MODEL)
    assert "line 701, column 2: 'overload' is not a number" in err
    assert run(capsys, file, "--input", "u", "--output", "y", "--rows", ":690", *MODEL)[0] == 0


# ------------------------------------------------------------------ times


def jittered(seed, share=0.2, rate=10.4, size=1500):
    """Times of a logger whose steps are uneven, and a slow drive at those times."""
    steps = (1.0 + np.random.default_rng(seed).uniform(-share, share, size)) / rate
    t = np.cumsum(steps)
    u = 3.0 + 55.0 * (1.0 - np.clip(1.2 - t / 170.0, 0.2, 1.0) * np.cos(0.31 * t))
    return t, u, 1e6 * virtual_stack((0.0, 120.0), 37e-6, 0.12).simulate(u).values


def test_jittered_times_are_made_even_on_demand(capsys, tmp_path):
    t, u, y = jittered(5)
    file = write(tmp_path / "j.csv", "time (s),u,y", t, u, y)
    words = (file, "--input", "u", "--output", "y", *MODEL)
    err = refused(capsys, *words)
    assert "not evenly spaced" in err
    assert "option resample" in err
    even = json.loads(run(capsys, *words, "--resample", "median")[1])
    slow = json.loads(run(capsys, *words, "--resample", "5 Hz")[1])
    for result, manner in ((even, "linear interpolation"), (slow, "means over each step")):
        note = next(n for n in result["notes"] if n.startswith("resampled"))
        assert manner in note
        assert "uncertainty of a delay" in note
    # the stack, read at its own even times, leaves as much
    clean = write(tmp_path / "c.csv", "time (s),u,y", *jittered(5, 0.0))
    plain = json.loads(run(capsys, clean, "--input", "u", "--output", "y", *MODEL)[1])
    assert even["rms_percent"] < 1.2 * plain["rms_percent"]
    assert slow["rms_percent"] < 1.2 * plain["rms_percent"]


def test_what_resampling_refuses(capsys, tmp_path):
    t, u, y = jittered(7)
    words = ("--input", "u", "--output", "y", *MODEL)
    file = write(tmp_path / "j.csv", "time (s),u,y", t, u, y)
    assert "sample rate is 10" in refused(capsys, file, *words, "--resample", "20 Hz")
    assert "--resample needs one rate" in refused(capsys, file, *words, "--resample", "5,6,7")
    assert "frequency" in refused(capsys, file, *words, "--resample", "often")
    later = np.where(t > 60.0, t + 3.0, t)
    file = write(tmp_path / "gap.csv", "time (s),u,y", later, u, y)
    err = refused(capsys, file, *words, "--resample", "median")
    assert re.search(r"gap of 3\.\d+ s after sample \d+", err)
    assert "the part before or after by the option rows" in err
    for name, at, said in (("twice", 0.0, "is repeated"), ("back", -0.5, "goes back")):
        wrong = t.copy()
        wrong[800] = wrong[799] + at
        file = write(tmp_path / f"{name}.csv", "time (s),u,y", wrong, u, y)
        assert said in refused(capsys, file, *words, "--resample", "median")


def test_one_lost_sample_is_bridged_where_times_are_made_even(capsys, tmp_path):
    kept = np.arange(1500) != 700
    t, u, y = (c[kept] for c in jittered(9, 0.05))
    file = write(tmp_path / "j.csv", "time (s),u,y", t, u, y)
    words = (file, "--input", "u", "--output", "y", *MODEL)
    assert "use the option resample" in refused(capsys, *words)
    assert run(capsys, *words, "--resample", "median")[0] == 0


# ------------------------------------------------------------------ parts


def test_train_counts_in_the_file(capsys, tmp_path, columns):
    file = write(tmp_path / "a.csv", "u,y", *columns[1:])
    cut = write(tmp_path / "b.csv", "u,y", *(c[150:] for c in columns[1:]))
    words = ("--input", "u", "--output", "y", "--sample-rate", RATE, *MODEL)
    whole = json.loads(run(capsys, file, *words, "--rows", "150:", "--train", "300:1000")[1])
    part = json.loads(run(capsys, cut, *words, "--train", "150:850")[1])
    for name in ("rms_percent", "heldout_rms_percent", "parameters"):
        assert whole[name] == part[name]
    early = json.loads(run(capsys, file, *words, "--rows", "150:", "--train", "50:1000")[1])
    assert (
        early["parameters"]
        == json.loads(run(capsys, cut, *words, "--train", ":850")[1])["parameters"]
    )
    for given in ("0:150", "1200:", ":100"):
        err = refused(capsys, file, *words, "--rows", "150:", "--train", given)
        assert "none of the samples 150 to 1199" in err


def test_train_counts_in_the_file_that_was_resampled(tmp_path):
    t, u, y = jittered(11)
    file = write(tmp_path / "j.csv", "time (s),u,y", t, u, y)
    for resample, rows in (((None,), None), (4.0, None), (4.0, (100, 1400))):
        records, _, _ = read(file, resample=resample, rows=rows)
        first, stop = train_range((400, 1100), records)
        time = records[0].time
        # the samples between those that were named, and no more
        assert time[first - 1] < t[400] <= time[first]
        assert time[stop - 1] < t[1100] <= time[stop]
    both, _, _ = read(file, write(tmp_path / "k.csv", "time (s),u,y", *jittered(3)), resample=4.0)
    with pytest.raises(RecordError, match="their resampling differs"):
        train_range((400, 1100), both)


# ------------------------------------------------------------------ branches and curves


def test_options_that_do_not_go_together(capsys, tmp_path, columns):
    file = write(tmp_path / "a.csv", "time (s),u,y", *columns)
    for words, said in (
        (("--curve", "time"), "needs --input, and --output or --branches"),
        (("--branches", "u"), "needs two columns"),
        (("--branches", "y,time", "--output", "y"), "omit --output"),
        (("--branches", "y,time", "--curve", "time"), "omit --curve"),
        (("--branches", "y,time", "--time", "time"), "omit --time"),
        (("--output", "y", "--curve", "time", "--resample", "5"), "omit --resample"),
        (("--output", "y,u", "--curve", "time"), "--curve columns"),
        (("--output", "y", "--curve", "y"), "must be three columns"),
        (("--output", "y", "--curve", "time"), "does not number curves"),
        (("--output", "y", "--curve", "files", "--test-record", file), "omit --test-record"),
        (("--branches", "y,time"), "y in no unit, time in s"),
    ):
        assert said in refused(capsys, file, "--input", "u", *words)
    table = write(tmp_path / "t.csv", "u,up,down", *np.cumsum(np.ones((3, 9)), axis=1))
    records, _, _ = read(table, columns=DriveColumns(input=("u",), branches=("up", "down")))
    with pytest.raises(RecordError, match="for branches or curves"):
        train_range((0, 5), records)


# ------------------------------------------------------------------ figures


def test_the_figure_says_which_files_and_cycles_are_drawn(capsys, tmp_path, columns):
    files = [write(tmp_path / f"run $1_{i}.csv", "time (s),u,y", *columns) for i in range(5)]
    svg = tmp_path / "loops.svg"
    words = ("--input", "u", "--output", "y", *MODEL, "--figure", svg)
    for count, beyond in ((1, ""), (5, "1 more record not drawn")):
        assert run(capsys, *files[:count], *words)[0] == 0
        drawn = svg.read_text("utf-8")
        assert [f.name in drawn for f in files] == [i < min(count, 4) for i in range(5)]
        assert re.search(r"cycles \d+ to \d+ of \d+, [\d.]+ to [\d.]+ s", drawn)
        assert "shaded: cycles in the left diagram" in drawn
        assert beyond in drawn
        assert ("not drawn" in drawn) == bool(beyond)


# ------------------------------------------------------------------ columns that the file decides


@pytest.mark.parametrize(
    ("names", "order", "said"),
    [
        ("Zeit [s];Spannung [V];Weg [µm]", "uy", "input 1: Spannung [V]; output 2: Weg [µm]"),
        ("t [s];sensor [V];command [V]", "yu", "input 2: command [V]; output 1: sensor [V]"),
        ("time (s);gap (um);x (V)", "yu", "input 2: x [V]; output 1: gap [µm]"),
        ("t [s];u;y", "uy", "input 1: u; output 2: y"),
    ],
)
def test_input_and_output_are_taken_where_the_file_decides(tmp_path, columns, names, order, said):
    t, u, y = columns
    path = write(tmp_path / "a.csv", names, t, *((u, y) if order == "uy" else (y, u)))
    path.write_text(path.read_text().replace(",", ";"))
    (record,), driven, follows = read(path, columns=DriveColumns())
    assert record.notes[0] == f"{said}: selected by units and names"
    np.testing.assert_allclose(record.channel(driven).values, u, rtol=1e-8)
    # one that is given is kept
    for given in ({"input": (driven,)}, {"output": (follows,)}):
        assert read(path, columns=DriveColumns(**given))[1:] == (driven, follows)


@pytest.mark.parametrize(
    ("names", "option"),
    [
        ("t [s],a [V],b [V]", "input"),
        ("t [s],a [m],b [m]", "input"),
        ("t [s],a [V],b [N]", "output"),
    ],
)
def test_a_choice_is_left_to_the_user_with_the_columns(capsys, tmp_path, columns, names, option):
    said = refused(capsys, write(tmp_path / "a.csv", names, *columns))
    assert f"does not show which column is the {option}: name it by --{option} (columns: " in said
    assert "(columns: 0: t [s], 1: a [" in said
