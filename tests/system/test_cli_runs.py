"""`flexstage runs`: its tables, its JSON, and what it says about bad input."""

import json
from datetime import UTC, datetime, timedelta

import pytest

from flexstage.cli import main
from flexstage.instruments.catalogue.catalogue import Catalogue
from flexstage.instruments.catalogue.entries import CalibrationEntry, ModelEntry, StageEntry
from flexstage.instruments.recording.metadata import utc_now
from flexstage.records import read_record
from tests.recordings import RATE, RunFolder, assert_true, metadata, truth, writer, written


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["runs", *map(str, words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def result(capsys, *words):
    status, out, err = run(capsys, *words, "--json")
    assert (status, err) == (0, "")
    return json.loads(out)


@pytest.fixture
def catalogue(tmp_path, monkeypatch):
    """The user's catalogue of this test."""
    address = str(tmp_path / "catalogue.sqlite")
    monkeypatch.setenv("FLEXSTAGE_CATALOGUE", address)
    return address


@pytest.fixture
def folder(tmp_path):
    """A folder with a whole run of today, and one of long ago that was killed."""
    place = RunFolder(tmp_path / "run")
    now = metadata(step="stroke", kind="motion", started=utc_now(), identifier="a1" * 16)
    whole, _ = written(place.stream("stroke"), [40], leave=False, metadata=now)
    whole.close()
    old = metadata(
        stage="vgtu-mechanical", serial_number="B-2", step="noise", kind="hold",
        started="2021-03-04T05:06:07+00:00", identifier="b2" * 16,
    )  # fmt: skip
    written(place.stream("noise"), [10, 7], metadata=old)
    return place


def test_a_folder_is_added_listed_and_shown(capsys, catalogue, folder):
    added = result(capsys, "add", folder.path)
    assert (added["entered"], added["known"], added["problems"]) == (2, 0, [])
    assert result(capsys, "add", folder.path)["known"] == 2
    found = result(capsys)
    assert found["catalogue"] == f"sqlite:///{catalogue}"
    assert [r["step"] for r in found["runs"]] == ["stroke", "noise"]
    first = found["runs"][0]
    assert (first["samples"], first["status"], first["simulated"]) == (40, "complete", True)
    assert first["duration"] == pytest.approx(40 / RATE)
    for words, steps in (
        (("--stage", "vgtu-piezo"), ["stroke"]),
        (("--serial-number", "B-2"), ["noise"]),
        (("--test", "hold"), ["noise"]),
        (("--since", "2 d"), ["stroke"]),
        (("--since", "2021-03-04"), ["stroke", "noise"]),
        (("--since", "2021-03-04T07:06:07+02:00"), ["stroke", "noise"]),
        (("--since", "2021-03-04T05:06:08"), ["stroke"]),
        (("--limit", "1"), ["stroke"]),
        (("--stage", "other"), []),
    ):
        assert [r["step"] for r in result(capsys, *words)["runs"]] == steps, words
    shown = result(capsys, "show", "a1a1")
    assert shown["identifier"] == "a1" * 16
    assert shown["file_is"] == "as entered"
    assert shown["seed"] == 2**70 + 1
    with folder.records()[0].open("r+b") as file:
        file.seek(-9, 2)
        file.write(b"!")
    assert result(capsys, "show", "a1a1")["file_is"] == "changed since it was entered"
    folder.records()[0].unlink()
    assert result(capsys, "show", "a1a1")["file_is"] == "missing"


@pytest.mark.parametrize("words", [(), ("show", "a1"), ("calibrations",)])
def test_looking_makes_no_catalogue(capsys, tmp_path, words):
    absent = tmp_path / "absent" / "catalogue.sqlite"
    run(capsys, *words, "--catalogue", absent)
    assert not absent.parent.exists()
    if words != ("show", "a1"):
        found = result(capsys, *words, "--catalogue", absent)
        assert found.pop("catalogue") == f"sqlite:///{absent}"
        assert list(found.values()) == [[]]


def test_the_tables_for_people(capsys, catalogue, folder):
    status, out, err = run(capsys, "add", folder.path)
    assert (status, err) == (0, "")
    assert "entered 2, already known 0" in out
    status, out, _ = run(capsys)
    assert status == 0
    assert "2 runs in sqlite:///" in out
    [line] = [line for line in out.splitlines() if "b2b2b2b2" in line]
    assert line.split() == [
        "b2b2b2b2", "2021-03-04", "05:06:07", "vgtu-mechanical", "B-2", "hold", "x", "17",
        "failed", "virtual", "noise",
    ]  # fmt: skip
    with Catalogue.open(catalogue) as opened:
        opened.enter_model(
            ModelEntry(
                kind="preisach",
                file="models/x.json",
                stage=StageEntry(name="vgtu-piezo"),
                axis="x",
                figures={"rms": 1.5e-9},
                run="b2" * 16,
            )
        )
    status, out, _ = run(capsys, "show", "b2")
    assert status == 0
    assert "run " + "b2" * 16 in out
    assert "preisach x: models/x.json rms 1.5e-09" in out
    assert "records/noise.stream" in out
    models = result(capsys, "show", "b2")["models"]
    assert models == [
        {"kind": "preisach", "file": "models/x.json", "axis": "x", "figures": {"rms": 1.5e-9}}
    ]


def test_a_stream_is_recovered(capsys, catalogue, folder):
    stream = folder.stream("noise")
    with stream.open("ab") as file:
        file.write(b"half a chunk")
    before = stream.read_bytes()
    looked = result(capsys, "recover", stream, "--look")
    assert (looked["samples"], looked["file"], looked["stream_removed"]) == (17, None, False)
    assert looked["channels"][1] == "drive"
    assert not looked["complete"]
    assert stream.read_bytes() == before
    status, out, err = run(capsys, "recover", stream)
    assert (status, err) == (0, "")
    assert "17 samples of 4 channels intact: 0.002176 s at 7812.5 Hz" in out
    assert "the last 12 bytes are an incomplete chunk" in out
    assert f"kept {stream}" in " ".join(out.split())
    assert_true(read_record(stream.with_suffix(".h5")), range(17))
    status, _, err = run(capsys, "recover", stream)
    assert status == 2
    assert "exists: runs are never overwritten" in err
    elsewhere = folder.path / "again.h5"
    told = result(capsys, "recover", stream, "--out", elsewhere, "--remove")
    assert told["stream_removed"]
    assert not stream.exists()
    assert_true(read_record(elsewhere), range(17))


def test_a_stream_that_is_damaged_inside_is_not_removed(capsys, folder):
    stream = folder.stream("noise")
    data = bytearray(stream.read_bytes())
    data[-300] ^= 8  # in the first of its chunks, which has 344 bytes before 248 of the other
    stream.write_bytes(data)
    told = result(capsys, "recover", stream, "--remove")
    assert (told["samples"], told["stream_removed"]) == (7, False)
    assert told["lost"] == [{"kind": "damage", "first": 0, "count": 10}]
    assert stream.exists()


def test_a_stream_that_is_being_written_is_left_alone(capsys, tmp_path):
    going = writer(tmp_path / "now.stream")
    going.append(0, truth(0, 5))
    status, _, err = run(capsys, "recover", going.path)
    assert status == 2
    assert "is being written by another program" in err
    assert result(capsys, "recover", going.path, "--look")["samples"] == 5
    going.leave()
    assert result(capsys, "recover", going.path)["samples"] == 5


def test_calibrations_are_listed(capsys, catalogue):
    start = datetime(2031, 5, 17, 9, 30, tzinfo=UTC)
    with Catalogue.open(catalogue) as opened:
        for day, value in ((0, 1.25e-5), (10, 1.2503e-5)):
            opened.enter_calibration(
                CalibrationEntry(
                    what="gain of sensor x",
                    value=value,
                    unit="m/V",
                    standard_uncertainty=3.5e-10,
                    valid_from=start + timedelta(days=day),
                    stage=StageEntry(name="vgtu-piezo", serial_number="A-1"),
                )
            )
    values = [c["value"] for c in result(capsys, "calibrations")["calibrations"]]
    assert values == [1.2503e-5, 1.25e-5]
    held = result(capsys, "calibrations", "--valid-at", "2031-05-20", "--serial-number", "A-1")
    assert [c["value"] for c in held["calibrations"]] == [1.25e-5]
    assert result(capsys, "calibrations", "--what", "offset")["calibrations"] == []
    status, out, _ = run(capsys, "calibrations", "--stage", "vgtu-piezo")
    assert status == 0
    [line] = [line for line in out.splitlines() if "1.2503e-05" in line]
    assert line.split() == [
        "gain", "of", "sensor", "x", "1.2503e-05", "3.5e-10", "m/V", "vgtu-piezo", "A-1",
        "2031-05-27", "09:30:00",
    ]  # fmt: skip


BAD = [
    (("show", "zz"), 2, "first digits of its identifier"),
    (("show", "12"), 2, "no run of the catalogue"),
    (("--since", "soon"), 2, "expected a date such as 2031-05-17"),
    (("--since", "5 parrots"), 2, "expected a date such as 2031-05-17"),
    (("--limit", "0"), 2, "--limit"),
    (("add", "nowhere"), 2, "there is no folder 'nowhere'"),
    (("add", ""), 2, "expected a path, got an empty text"),
    (("recover", "nowhere.stream"), 2, "cannot be read: No such file"),
    (("--catalogue", "mysql://u@h/d"), 2, "needs the driver 'MySQLdb'"),
    (("--catalogue", "postgresql://u@127.0.0.1:1/d"), 1, "runs add FOLDER"),
    (("--json", "show", "12"), 2, "give --json after 'show'"),
    (("--stage", "s", "calibrations"), 2, "give --stage after 'calibrations'"),
    (("nothing",), 2, "No such command 'nothing'"),
]


@pytest.mark.parametrize(("words", "status", "said"), BAD)
def test_bad_input_gets_one_sentence(capsys, catalogue, words, status, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found, out, err = run(capsys, *words)
    assert found == status
    assert json.loads(out)["error"]["message"] in err if "--json" in words else out == ""
    assert said in err
    assert err.startswith("flexstage: ")
    assert err.count("\n") == 1


def test_a_folder_without_records_is_told(capsys, catalogue, tmp_path):
    status, _, err = run(capsys, "add", tmp_path)
    assert status == 2
    assert f"no records of runs in '{tmp_path}'" in err


def test_what_cannot_be_read_is_told_beside_what_was_entered(capsys, catalogue, folder):
    (folder.path / "records" / "torn.h5").write_bytes(b"torn")
    status, out, err = run(capsys, "add", folder.path, "--json")
    assert (status, err) == (1, "")
    told = json.loads(out)
    assert told["entered"] == 2
    assert "torn.h5" in told["problems"][0]


@pytest.mark.parametrize("since", ["999999999 d", "0001-01-01T00:00+23:00", "1e400 d"])
def test_a_time_that_no_calendar_has_gets_a_sentence(capsys, tmp_path, since):
    with pytest.raises(SystemExit) as ended:
        main(["runs", "--since", since, "--catalogue", str(tmp_path / "runs.sqlite")])
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (2, "")
    assert since in said.err
