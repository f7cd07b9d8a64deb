"""`flexstage run`: a plan from its file to its figures, as a user would carry it out."""

import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from flexstage.cli import main
from flexstage.experiments.runner import read_state
from flexstage.records import read_record
from tests.result_schema import require_valid

TWIN = "twin://?seed=7&model=lumped"
TIMEOUT = 300.0
PLAN = """\
plan: 1
title: a small one
stage: vgtu-piezo
sensors:
  x: {channel: 1, calibration: 0.0005}
  y: {channel: 2}
  x.across: {channel: 3}
steps:
  - {name: loops, excite: {kind: cycles, axis: x, rate: 2 Hz, cycles: 3, shape: cosine}}
  - {name: motion, measure: {of: loops, test: motion, along: x, across: x.across}}
  - {name: blows, excite: {kind: hammer-impacts, axis: y, impacts: 3}}
  - name: blow
    measure: {of: blows, test: response, sample_rate: 10 kHz, band: [200 Hz, 800 Hz]}
  - {name: figures, characterise: {of: [motion, blow]}}
"""


@pytest.fixture(autouse=True)
def own_places(tmp_path, monkeypatch):
    """Nothing of the user's is touched."""
    monkeypatch.setenv("FLEXSTAGE_CATALOGUE", str(tmp_path / "catalogue.sqlite"))
    monkeypatch.setenv("FLEXSTAGE_STATE", str(tmp_path / "state"))


@pytest.fixture
def plan(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(PLAN)
    return file


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["run", *map(str, words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


@pytest.mark.usefixtures("undrawn")
def test_a_plan_on_the_twin_gives_the_published_figures(capsys, plan, tmp_path):
    out = tmp_path / "run"
    status, said, err = run(capsys, plan, "--instrument", TWIN, "--folder", out, "--json",
                            "--operator", "A. N.", "--note", "a test")  # fmt: skip
    assert (status, err) == (0, "")
    result = json.loads(said)
    figures = {(f["quantity"], f["axis"]): f for f in result["figures"]}
    # the stage is made with scatter of some per cent about what was published
    assert figures["output_displacement", "x"]["value"] == pytest.approx(63.12e-6, rel=0.1)
    assert figures["hysteresis_loop_width", "x"]["value"] == pytest.approx(7.91e-6, rel=0.2)
    assert figures["natural_frequency_hz", "y"]["value"] == pytest.approx(526.93, rel=0.05)
    assert all(f["origin"] == "virtual" for f in figures.values())
    assert (result["operator"], result["note"]) == ("A. N.", "a test")
    assert json.loads((out / "results.json").read_text()) == result
    require_valid(result, "run")
    record = read_record(out / "records" / "motion.h5")
    assert {c.name for c in record.channels} == {"x", "x.across", "voltage", "command"}


@pytest.mark.slow
def test_tables_say_what_was_found_and_that_it_is_simulated(capsys, plan, tmp_path):
    status, said, err = run(capsys, plan, "--instrument", TWIN, "--folder", tmp_path / "run")
    assert (status, err) == (0, "")
    assert "vgtu-piezo, virtual" in said
    assert "hysteresis loop width" in said
    assert "63.12" in said
    assert "these are not measured data" in said
    assert f"wrote {tmp_path / 'run' / 'report.html'}" in said
    page = (tmp_path / "run" / "report.html").read_text()
    assert "no value on this page was measured on a real stage" in page
    # the figure of this run, and none of the publication, from which the twin is made
    assert "Output displacement" in page
    assert "no value is compared with a model or a publication" in page
    for name in ("motion.h5", "blow.h5"):
        assert name in page
    # it loads nothing
    assert "http" not in page.replace("http-equiv", "")
    status, said, _ = run_of("runs", capsys, "--json")
    assert status == 0
    assert {r["step"] for r in json.loads(said)["runs"]} == {"motion", "blow"}


def run_of(command, capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main([command, *words])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def test_a_dry_run_needs_no_instrument_and_writes_nothing(capsys, plan, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(p.name for p in tmp_path.iterdir())
    status, said, err = run(capsys, plan, "--dry-run")
    assert (status, err) == (0, "")
    assert "a small one, vgtu-piezo" in said
    assert "120 V" in said
    status, said, _ = run(capsys, plan, "--dry-run", "--json", "--only", "motion")
    tried = json.loads(said)
    assert [s["name"] for s in tried["steps"]] == ["loops", "motion"]
    # a cycle before three of them, at 2 Hz
    assert tried["duration"] == pytest.approx(2.001)
    # pi f times the range
    assert tried["steps"][0]["motions"][0]["largest_rate"] == pytest.approx(754.0, rel=1e-3)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_a_dry_run_of_what_cannot_be_done_fails(capsys, plan):
    plan.write_text(PLAN.replace("axis: x, rate", "axis: z, rate"))
    status, said, err = run(capsys, plan, "--dry-run")
    assert status == 2
    assert "has no axis 'z'" in err
    assert "loops" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nothing.yaml",), "'nothing.yaml' is neither a built-in plan nor a file"),
        (("PLAN",), "no instrument: give --instrument"),
        (("PLAN", "--instrument", "gsc://x"), "gcs://HOST:PORT"),
        (("PLAN", "--instrument", TWIN, "--resume"), "--resume needs --folder"),
        (("PLAN", "--instrument", TWIN, "--only", "motions"), "no step 'motions'"),
        (("PLAN", "--instrument", TWIN, "--only", ","), "'--only': must name at least one"),
        (("PLAN", "--instrument", TWIN, "--stage", "vgtu"), "no built-in design"),
    ],
)
def test_bad_input_gets_a_sentence_and_status_2(capsys, plan, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *(plan if w == "PLAN" else w for w in words))
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_an_instrument_that_is_not_there_is_status_1(capsys, plan, tmp_path):
    # a port that is taken, and where nobody listens
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"gcs://127.0.0.1:{taken.getsockname()[1]}"
        status, out, err = run(capsys, plan, "--instrument", address, "--folder", tmp_path / "run")
    assert (status, out) == (1, "")
    assert "127.0.0.1" in err
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_run_is_not_written_over(capsys, plan, tmp_path):
    out = tmp_path / "run"
    words = (plan, "--instrument", TWIN, "--folder", out, "--only", "motion", "--catalogue", "none")
    assert run(capsys, *words)[0] == 0
    before = (out / "records" / "motion.h5").read_bytes()
    status, _, err = run(capsys, *words)
    assert status == 2
    assert "--resume" in err
    assert run(capsys, *words, "--resume")[0] == 0
    assert (out / "records" / "motion.h5").read_bytes() == before
    assert not (tmp_path / "catalogue.sqlite").exists()


@pytest.mark.usefixtures("undrawn")
def test_the_folder_of_a_run_is_named_by_time_and_stage(capsys, plan, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, plan, "--instrument", TWIN, "--only", "motion")[0] == 0
    (made,) = (tmp_path / "runs").iterdir()
    assert made.name.endswith("Z-vgtu-piezo-small")
    state = read_state(made)
    assert state is not None
    assert state.finished


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
@pytest.mark.parametrize("by", ["SIGINT", "SIGTERM"])
def test_an_interrupted_run_says_how_it_is_taken_up_and_can_be(capsys, plan, tmp_path, by):
    more = (
        "  - {name: rest, excite: {kind: dwell, axis: x, duration: 1 s}}\n"
        "  - {name: held, measure: {of: rest, test: hold, along: x}}\n  - {name: loops"
    )
    long = PLAN.replace("rate: 2 Hz, cycles: 3", "rate: 2 Hz, cycles: 20")
    plan.write_text(long.replace("  - {name: loops", more))
    out = tmp_path / "run"
    # in step with real time, so that the second record takes ten seconds
    address = f"{TWIN}&fast=0"
    words = ["run", str(plan), "--instrument", address, "--folder", str(out)]
    started = subprocess.Popen(
        [sys.executable, "-m", "flexstage", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ),
    )  # fmt: skip
    try:
        stream = out / "records" / "motion.stream"
        _until(lambda: stream.exists() and stream.stat().st_size > 45_000, started)
        started.send_signal(getattr(signal, by))
        said, err = started.communicate(timeout=TIMEOUT)
    finally:
        started.kill()
        started.communicate()
    assert started.returncode == {"SIGINT": 130, "SIGTERM": 143}[by]
    assert said == ""
    assert "the stage was stopped" in err
    assert f"--resume --folder {out}" in err
    assert "Traceback" not in err
    state = read_state(out)
    assert state is not None
    assert {n: s.status for n, s in state.steps.items()} == {
        "rest": "complete", "held": "complete", "loops": "complete", "motion": "interrupted",
    }  # fmt: skip
    held = (out / "records" / "held.h5").read_bytes()
    status, said, err = run(
        capsys, plan, "--instrument", TWIN, "--folder", out, "--resume", "--json"
    )
    assert (status, err) == (0, "")
    assert (out / "records" / "held.h5").read_bytes() == held
    partial = read_record(out / "records" / "motion.partial-1.h5")
    assert 1000 < partial.size < 30_000
    taken = {s["name"]: s["taken_now"] for s in json.loads(said)["steps"] if "taken_now" in s}
    assert taken == {"held": False, "motion": True, "blow": True}


def _until(there, process):
    end = time.monotonic() + TIMEOUT
    while not there():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.usefixtures("undrawn")
def test_a_real_instrument_moves_only_when_it_was_allowed(capsys, plan, tmp_path, monkeypatch):
    from tests.simple_instrument import SimpleInstrument

    made = SimpleInstrument(simulated=False, noise=1e-9)
    # the function of that name hides the module on the face of its room
    module = importlib.import_module("flexstage.instruments.connect")
    monkeypatch.setattr(module, "connect", lambda *_: made)
    out = tmp_path / "run"
    words = (plan, "--instrument", "gcs://host", "--folder", out, "--only", "motion")
    status, _, err = run(capsys, *words)
    assert status == 2
    assert "give --yes" in err
    assert made.log == []
    assert made.closed
    status, said, err = run(capsys, *words, "--yes")
    assert (status, err) == (0, "")
    assert "these are not measured data" not in said
