"""Plans carried out on an instrument whose every reading has a closed form."""

import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, FlexstageError, NotConnectedError, PlanError
from flexstage.experiments import Plan, run_plan, runner
from flexstage.experiments.plan import plan_from_text
from flexstage.experiments.runner import clear_leftovers, read_state, write_state
from flexstage.experiments.verbs import Centre, Identify, Verify
from flexstage.experiments.verbs.compensate import Reference
from flexstage.experiments.verbs.measure import MeasuredStep
from flexstage.experiments.verbs.verify import _run as follow_run
from flexstage.hysteresis import (
    DriveModel,
    Lag,
    ModelFile,
    PrandtlIshlinskii,
    ValidityRange,
    model_text,
)
from flexstage.instruments.lock import stage_lock
from flexstage.instruments.protocol import Identity
from flexstage.instruments.recording.metadata import RUN, RunMetadata
from flexstage.records import Channel, Record, read_record
from flexstage.report.run import _lead
from flexstage.stage.limits import AxisLimits
from flexstage.studies.measurement import compare_plan
from tests.result_schema import require_valid
from tests.simple_instrument import SimpleInstrument

GAIN = 4.8e-7
SCREW_LIMITS = AxisLimits(position=(0.0, 350e-6), speed=0.35e-3)
TEXT = """\
plan: 1
title: small
stage: vgtu-piezo
serial_number: S-17
sensors:
  x: {channel: 1, calibration: 0.001}
  y: {channel: 2}
  beside: {channel: 3}
  turn: {channel: 4, unit: rad}
steps:
  - {name: loops, excite: {kind: cycles, axis: x, rate: 4 Hz, cycles: 3}}
  - name: motion
    measure: {of: loops, test: motion, along: x, across: beside, yaw: turn}
  - {name: stairs, excite: {kind: staircase, axis: x, step: 700 mV, levels: 5, dwell: 200 ms,
                            settle: 100 ms}}
  - {name: steps, measure: {of: stairs, test: staircase, along: x}}
  - {name: round, excite: {kind: workspace-corners, rounds: 3, dwell: 50 ms,
                            travel: 100 ms, high: 0.5}}
  - {name: area, measure: {of: round, test: workspace, x: x, y: y}}
  - {name: figures, characterise: {of: [motion, steps, area]}}
"""


def bench(**given) -> SimpleInstrument:
    """One whose sensors have noise, without which there is nothing to evaluate."""
    return SimpleInstrument(**{"noise": 1e-9, **given})


def made(text: str = TEXT) -> Plan:
    return plan_from_text(text)


def waves(instrument: SimpleInstrument) -> list[int]:
    """Sizes of the waveforms that were run, without the short ways to their beginnings."""
    sizes = [int(line.split()[-1]) for line in instrument.log if line.startswith("load")]
    return [n for n in sizes if n > 100]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a whole run, which tests copy."""
    folder = tmp_path_factory.mktemp("whole")
    run_plan(made(), bench(), folder)
    return folder


@pytest.fixture
def _whole_run(whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)


#: With a whole run in the folder of the test.
whole_run = pytest.mark.usefixtures("_whole_run")


def test_figures_are_those_of_the_closed_forms(tmp_path):
    instrument = SimpleInstrument(noise=2e-9, seed=5)
    found = run_plan(made(), instrument, tmp_path)

    def value(quantity: str, axis: str = "x") -> float:
        return found.figure(quantity, axis).estimate.value

    # noise of 2 nm over 250 samples on a run, and over some 10 at an end
    assert value("output_displacement") == pytest.approx(120.0 * GAIN, abs=2e-9)
    assert value("cross_coupling") == pytest.approx(0.013, abs=1e-4)
    # a rotation in proportion to x has the range of it
    assert value("parasitic_rotation") == pytest.approx(0.31 * 120.0 * GAIN, abs=4e-9)
    # y stands still while x moves, so that all of channel 3 is x
    assert value("straightness") < 2e-9
    assert value("workspace_area", "xy") == pytest.approx(60.0**2 * GAIN * 4.3e-7, rel=1e-4)
    assert found.origin == "virtual"
    assert found.run.instrument.model == "in memory"
    assert _lead(found).startswith(f"{len(found.steps)} steps on ")
    # the cycle that only prepares is left out of the evaluation
    (motion, *_) = found.step("figures").evaluation.results
    assert motion.details["stroke"].of_cycles.shape[0] == 3
    e = found.figure("output_displacement", "x").estimate
    assert any(c.kind == "B" and c.uncertainty == pytest.approx(1e-3 * e.value, rel=1e-6)
               for c in e.components)  # fmt: skip


def test_a_record_holds_command_and_readings_sample_by_sample(tmp_path):
    exact = SimpleInstrument()
    found = run_plan(made(), exact, tmp_path, only=("motion",), operator="A. N.", note="first")
    step = found.step("motion")
    assert isinstance(step, MeasuredStep)
    record = read_record(tmp_path / "records" / "motion.h5")
    names = {c.name: c.unit for c in record.channels}
    assert names == {"x": "m", "beside": "m", "turn": "rad", "voltage": "V", "command": "V"}
    u = record.channel("command").values
    assert record.channel("voltage").values == pytest.approx(u, abs=1e-9)
    assert record.channel("x").values == pytest.approx(GAIN * u, abs=1e-15)
    # one cycle of a triangle before those that count, at 1 kHz and 4 Hz
    assert (step.first, step.period, record.size) == (250, 250, 1001)
    assert step.evaluated.size == 751
    assert step.evaluated.time[0] == 0.0
    about = json.loads(record.attributes["run"])
    assert (about["operator"], about["note"]) == ("A. N.", "first")
    assert (about["step"], about["kind"], about["axis"]) == ("motion", "motion", "x")
    assert about["serial_number"] == "S-17"
    assert record.attributes["simulated"] == "yes"


def test_results_are_written_and_are_the_ones_returned(tmp_path):
    found = run_plan(made(), SimpleInstrument(noise=1e-9), tmp_path)
    read = json.loads((tmp_path / "results.json").read_text())
    require_valid(read, "run")
    assert read["origin"] == "virtual"
    rows = {(f["quantity"], f["axis"]): f for f in read["figures"]}
    assert len(rows) == len(found.figures)
    for figure in found.figures:
        row = rows[figure.quantity, figure.axis]
        assert row["value"] == figure.estimate.value
        assert row["step"] == figure.test
    published = rows["output_displacement", "x"]["published"]
    assert {"origin": "published-measured", "value": 63.12e-6} in published
    assert [s["name"] for s in read["steps"]] == [s.name for s in made().steps]


def test_the_stage_is_left_at_its_safe_voltages_without_control(tmp_path):
    instrument = bench()
    # the last step of these ends in the middle of the range
    found = run_plan(made(), instrument, tmp_path, only=("steps",))
    assert found.step("stairs").values["x"][-1] > 60.0
    assert instrument.axes["x"].voltage() == instrument.axes["y"].voltage() == 0.0
    assert not instrument.axes["x"].closed_loop


@whole_run
def test_a_folder_with_a_run_is_not_written_over(tmp_path):
    again = bench()
    with pytest.raises(PlanError, match="--resume"):
        run_plan(made(), again, tmp_path)
    assert again.log == []


def test_a_run_is_not_taken_up_while_it_lives(tmp_path, monkeypatch):
    run_steps, refused = runner._run_steps, []

    def beside(*given):
        with pytest.raises(NotConnectedError, match=r"in use by .*\(process \d+ on") as caught:
            run_plan(made(), again, tmp_path, resume=True)
        refused.append(str(caught.value))
        return run_steps(*given)

    again = bench()
    monkeypatch.setattr(runner, "_run_steps", beside)
    found = run_plan(made(), bench(), tmp_path)
    (said,) = refused
    assert said.startswith(f"the run in '{tmp_path}' is in use by")
    assert not waves(again)
    assert len(found.steps) == len(made().steps)
    # it ended, and so did the lock
    monkeypatch.undo()
    run_plan(made(), bench(), tmp_path, resume=True)


@whole_run
@pytest.mark.skipif(sys.platform == "win32", reason="there is no kill -9")
def test_a_run_that_was_killed_can_be_taken_up(tmp_path):
    hold = (
        "from flexstage.instruments.lock import folder_lock; from pathlib import Path; import sys"
    )
    hold += "\nwith folder_lock(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", hold, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(NotConnectedError, match=rf"\(process {other.pid} on .*choose another"):
            run_plan(made(), bench(), tmp_path, resume=True)
        other.kill()
    assert (tmp_path / ".lock.json").exists()  # its word is left, and holds nobody off
    run_plan(made(), bench(), tmp_path, resume=True)


def test_a_run_that_is_whole_is_read_and_nothing_moves(tmp_path):
    first = run_plan(made(), SimpleInstrument(noise=1e-9), tmp_path)
    again = SimpleInstrument(noise=1e-9, seed=9)
    second = run_plan(made(), again, tmp_path, resume=True)
    assert waves(again) == []
    assert [f.estimate.value for f in second.figures] == [f.estimate.value for f in first.figures]
    assert not any(step.repeated for step in second.of("measure"))
    assert second.run.started == first.run.started


def test_a_state_that_cannot_be_written_hides_no_failure(tmp_path, monkeypatch):
    def full(folder, state):
        if any(step.status == "failed" for step in state.steps.values()):
            raise OSError(28, "No space left on device")
        write_state(folder, state)

    monkeypatch.setattr("flexstage.experiments.runner.write_state", full)
    with pytest.raises(ControllerError, match=r"step 'motion'.*reads nan"):
        run_plan(made(), bench(nan_from={"x": 0.0}), tmp_path, only=("motion",))


def test_what_failed_is_taken_up_again_and_what_was_recorded_of_it_is_kept(tmp_path):
    # the first record takes 1 s and the way to it; the second one is cut short
    broken = bench(nan_from={"x": 2.3})
    with pytest.raises(ControllerError, match=r"step 'steps'.*'x' \(channel 1\)"):
        run_plan(made(), broken, tmp_path)
    assert broken.stops >= 1
    state = read_state(tmp_path)
    assert state is not None
    status = {name: step.status for name, step in state.steps.items()}
    assert status == {"loops": "complete", "motion": "complete", "stairs": "complete",
                      "steps": "failed"}  # fmt: skip
    assert "reads nan" in state.steps["steps"].message
    mended = bench()
    found = run_plan(made(), mended, tmp_path, resume=True)
    stairs = found.step("stairs")
    round_ = found.step("round")
    assert waves(mended) == [stairs.time.size, round_.time.size]
    assert [step.repeated for step in found.of("measure")] == [False, True, True]
    done = read_state(tmp_path)
    assert done is not None
    (partial,) = done.steps["steps"].partial
    kept = read_record(tmp_path / partial)
    assert 2 <= kept.size < found.step("steps").record.size
    assert np.all(np.isfinite(kept.channel("x").values))
    u = kept.channel("command").values
    assert kept.channel("x").values == pytest.approx(GAIN * u, abs=6e-9)


def test_an_interruption_stops_the_stage_and_can_be_taken_up(tmp_path):
    class Interrupted(SimpleInstrument):
        def pause(self, seconds: float) -> None:
            super().pause(seconds)
            if self.now > 3.0 and not self.stops:
                raise KeyboardInterrupt

    stopped = Interrupted(noise=1e-9)
    with pytest.raises(KeyboardInterrupt):
        run_plan(made(), stopped, tmp_path)
    assert stopped.stops >= 1
    # led to the safe voltage after it
    assert stopped.axes["x"].voltage() == 0.0
    state = read_state(tmp_path)
    assert state is not None
    assert state.finished == ""
    (which,) = [n for n, step in state.steps.items() if step.status == "interrupted"]
    found = run_plan(made(), bench(), tmp_path, resume=True)
    assert found.step(which).repeated
    assert found.figure("workspace_area", "xy").estimate.value > 0.0


def test_a_lost_link_says_how_much_is_safe(tmp_path):
    cut = bench(cut_link_at=2.3)
    with pytest.raises(NotConnectedError, match=r"step 'steps': .* samples are saved"):
        run_plan(made(), cut, tmp_path)
    assert not cut.log[-1].startswith(("load", "start"))


@whole_run
def test_a_record_that_was_changed_on_disk_is_taken_again_and_kept(tmp_path):
    path = tmp_path / "records" / "steps.h5"
    content = bytearray(path.read_bytes())
    content[-9] ^= 0x10
    path.write_bytes(content)
    again = bench()
    found = run_plan(made(), again, tmp_path, resume=True)
    assert [step.repeated for step in found.of("measure")] == [False, True, False]
    assert (tmp_path / "records" / "steps.replaced-1.h5").read_bytes() == bytes(content)


@whole_run
def test_a_step_that_changed_is_repeated_with_all_that_depends_on_it_and_nothing_else(tmp_path):
    changed = made(TEXT.replace("cycles: 3", "cycles: 4"))
    found = run_plan(changed, bench(), tmp_path, resume=True)
    assert [step.repeated for step in found.of("measure")] == [True, False, False]
    assert found.step("motion").record.size == 1251
    # how well a sensor is known changes figures, and no record
    better = made(TEXT.replace("cycles: 3", "cycles: 4").replace("0.001", "0.0002"))
    again = run_plan(better, bench(), tmp_path, resume=True)
    assert not any(step.repeated for step in again.of("measure"))
    a, b = (r.figure("output_displacement", "x").estimate.uncertainty for r in (found, again))
    assert b == pytest.approx(a / 5.0, rel=0.01)


@whole_run
def test_a_run_on_a_simulation_is_not_taken_up_on_a_real_stage(tmp_path):
    real = bench(simulated=False)
    with pytest.raises(PlanError, match="a simulated one, and this is a real instrument"):
        run_plan(made(), real, tmp_path, resume=True)
    assert real.log == []


def test_another_instrument_repeats_every_record(tmp_path):
    run_plan(made(), bench(), tmp_path)

    class Other(SimpleInstrument):
        @property
        def identity(self):
            from dataclasses import replace

            return replace(super().identity, serial_number="S8")

    found = run_plan(made(), Other(noise=1e-9), tmp_path, resume=True)
    assert all(step.repeated for step in found.of("measure"))


def test_a_plan_that_cannot_be_carried_out_moves_nothing(tmp_path):
    text = TEXT.replace("step: 700 mV", "step: 30 V")
    instrument = bench()
    with pytest.raises(PlanError, match=r"'stairs'.* would end at 180 V.*the stage has not moved"):
        run_plan(made(text), instrument, tmp_path)
    assert instrument.log == []
    assert not (tmp_path / "run.json").exists()


def test_narrower_limits_of_the_instrument_count(tmp_path):
    narrow = AxisLimits(position=(0.0, 58e-6), voltage=(0.0, 90.0), slew=4e4)
    instrument = bench(limits={"x": narrow, "y": narrow})
    found = run_plan(made(), instrument, tmp_path)
    u = found.step("motion").record.channel("command").values
    assert (u.min(), u.max()) == (0.0, 90.0)


def test_a_real_stage_is_locked_by_its_serial_number(tmp_path, monkeypatch):
    monkeypatch.setenv("FLEXSTAGE_STATE", str(tmp_path / "state"))
    instrument = bench(simulated=False)
    with stage_lock("S-17"), pytest.raises(NotConnectedError, match="'S-17' is in use"):
        run_plan(made(), instrument, tmp_path / "run")
    assert instrument.log == []
    found = run_plan(made(), instrument, tmp_path / "run", resume=True)
    assert found.origin == "measured"


def test_only_what_is_wanted_is_done(tmp_path):
    instrument = bench()
    found = run_plan(made(), instrument, tmp_path, only=("steps",))
    assert [step.name for step in found.steps] == ["stairs", "steps"]
    more = run_plan(made(), instrument, tmp_path, only=("motion",), resume=True)
    assert [step.name for step in more.steps] == ["loops", "motion"]
    with pytest.raises(PlanError, match="no step 'motions'"):
        run_plan(made(), instrument, tmp_path, only=("motions",), resume=True)


SCREWS = """\
plan: 1
stage: vgtu-mechanical
sensors: {x: {channel: 1, calibration: 0.002}, y: {channel: 2}}
defaults: {sample_rate: 100 Hz, command_rate: 100 Hz}
steps:
  - {name: loops, excite: {kind: cycles, axis: x, rate: 0.25 Hz, cycles: 3}}
  - {name: motion, measure: {of: loops, test: motion, along: x, smallest_step: 0.5 um}}
  - {name: places, excite: {kind: positioning, axis: y, targets: 5, rounds: 2, dwell: 100 ms}}
  - {name: targets, measure: {of: places, test: positioning, along: y}}
  - {name: figures, characterise: {of: [motion, targets]}}
"""


@pytest.mark.parametrize("generator", [True, False])
def test_screws_are_moved_by_waveforms_or_from_place_to_place(tmp_path, generator: bool):
    instrument = SimpleInstrument(
        limits={"x": SCREW_LIMITS, "y": SCREW_LIMITS},
        gains={},
        sensors={1: ("m", {"x": 0.33}), 2: ("m", {"y": 0.31})},
        generator=generator,
        noise=3e-9,
    )
    found = run_plan(made(SCREWS), instrument, tmp_path)
    assert any(line.startswith("load") for line in instrument.log) == generator
    # from place to place the last one may be missing: the range is that of those gone to
    assert found.figure("transmission_ratio", "x").estimate.value == pytest.approx(0.33, rel=1e-4)
    shown = {(r.figure.quantity, r.figure.axis) for r in compare_plan(found).rows}
    assert shown == {(f.quantity, f.axis) for f in found.figures}
    assert found.figure("resolution", "x").estimate.value == pytest.approx(0.165e-6, rel=1e-4)
    e = found.figure("transmission_ratio", "x").estimate
    assert e.uncertainty == pytest.approx(0.33 * 0.002, rel=0.05)
    # its scale is off by 1 - 0.31: that much of the way between first and last target
    way = 0.9 * 350e-6
    accuracy = found.figure("positioning_accuracy", "y").estimate.value
    assert accuracy == pytest.approx(0.69 * way, rel=1e-3)


def test_records_and_models_are_entered_into_the_catalogue(tmp_path):
    from flexstage.instruments.catalogue.catalogue import Catalogue

    text = TEXT + (
        "  - {name: pi, identify: {of: [motion], output: x, model: [prandtl-ishlinskii]}}\n"
    )
    address = str(tmp_path / "runs.sqlite")
    found = run_plan(made(text), SimpleInstrument(noise=1e-9), tmp_path / "run", catalogue=address)
    assert not any("catalogue" in note for note in found.notes)
    with Catalogue.open(address) as catalogue:
        runs = catalogue.runs()
        assert {(r.step, r.kind, r.status) for r in runs} == {
            ("motion", "motion", "complete"),
            ("steps", "staircase", "complete"),
            ("area", "workspace", "complete"),
        }
        assert all(r.simulated and r.stage.serial_number == "S-17" for r in runs)


def test_a_catalogue_that_fails_loses_nothing(tmp_path):
    bad = tmp_path / "no.sqlite"
    bad.write_bytes(b"no database at all, and long enough to be looked at" * 40)
    found = run_plan(made(), bench(), tmp_path / "run", catalogue=str(bad))
    assert any("flexstage runs add" in note for note in found.notes)
    assert (tmp_path / "run" / "results.json").exists()


def test_the_state_is_refused_where_it_is_none(tmp_path):
    (tmp_path / "run.json").write_text("[1, 2]")
    with pytest.raises(
        PlanError, match=r"run\.json: a state of a run begins with 'run: 1', got a list"
    ):
        run_plan(made(), bench(), tmp_path, resume=True)
    for text in ("{", "[" * 100_000, '{"run": 1, "note": ' + "9" * 5000 + "}"):
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(PlanError, match="is not the JSON of a state of a run"):
            run_plan(made(), bench(), tmp_path, resume=True)


STEP = {"status": "complete", "fingerprint": "", "partial": []}


@pytest.mark.parametrize(
    ("key", "change"),
    [
        (", instrument", {"instrument": "a text"}),
        (", steps", {"steps": "a text"}),
        (", steps.motion", {"steps": {"motion": "a text"}}),
        (", steps.motion.partial", {"steps": {"motion": {**STEP, "partial": 3}}}),
        (", steps.motion.status", {"steps": {"motion": {**STEP, "status": 3}}}),
        (", steps.motion.files", {"steps": {"motion": {**STEP, "files": "text"}}}),
        (", steps.motion.partial[0]", {"steps": {"motion": {**STEP, "partial": [[1]]}}}),
        (", started", {"started": 7}),
        (", stage", {"stage": ["x"]}),
        ("", {"unknown": 1}),
    ],
)
def test_a_state_with_a_field_of_another_kind_is_refused(tmp_path, key, change):
    whole = {"run": 1, "stage": "guide", "instrument": {"vendor": "v", "model": "m"}, "steps": {}}
    (tmp_path / "run.json").write_text(json.dumps(whole | change))
    with pytest.raises(PlanError, match=re.escape(f"run.json{key}: ")):
        run_plan(made(), bench(), tmp_path, resume=True)


def test_a_result_of_centring_that_is_none_is_refused(tmp_path):
    file = tmp_path / "fine.json"
    good = {
        "name": "fine", "axes": ["x", "y"], "target": 1e-7, "reached": True, "reason": "done",
        "moves": [{
            "kind": "start", "command": [0, 1e-6], "eccentricity": [0.0, 0.0], "length": 0.0,
            "uncertainty": 1e-9, "predicted": None, "true_length": math.nan,
        }],
        "notes": [],
    }  # fmt: skip
    file.write_text(json.dumps(good))
    assert Centre().result(None, "fine", [file], now=True).moves[0].command == (0.0, 1e-6)
    good["moves"][0]["command"] = [1e-6]
    file.write_text(json.dumps(good))
    with pytest.raises(PlanError, match=r"fine\.json, moves\[0\]\.command: expected .* 2 entries"):
        Centre().result(None, "fine", [file], now=True)


def test_a_missing_sensor_of_the_instrument_is_refused_before_it_moves(tmp_path):
    text = TEXT.replace("turn: {channel: 4", "turn: {channel: 9")
    instrument = bench()
    with pytest.raises(FlexstageError, match="no sensor 9"):
        run_plan(made(text), instrument, tmp_path)
    assert waves(instrument) == []


def test_folders_can_be_moved(tmp_path):
    run_plan(made(), bench(), tmp_path / "a")
    shutil.move(tmp_path / "a", tmp_path / "b")
    again = bench()
    run_plan(made(), again, tmp_path / "b", resume=True)
    assert waves(again) == []


def test_a_model_is_shown_at_the_rate_of_its_record(tmp_path):
    """A drive with a lag, read from its file, repeats the record that it made itself."""
    drive = DriveModel(
        hysteresis=PrandtlIshlinskii(gain=3.1e-7, thresholds=[5.0, 17.0], weights=[9e-8, 7e-8]),
        lag=Lag(time_constant=3.1e-3, delay=7e-4),
        validity=ValidityRange(
            input_range=(0.0, 110.0), output_range=(0.0, 5e-5), rate_range_hz=(1.0, 9.0)
        ),
    )
    rate, n = 730.0, 2200
    voltage = 55.0 - 55.0 * np.cos(2.0 * np.pi * 3.7 * np.arange(n) / rate)
    reading = drive.simulate(voltage, 1.0 / rate, drive.conditioned()) + 3e-6
    record = Record(time=np.arange(n) / rate, channels=(
        Channel(name="command", values=voltage, unit="V"),
        Channel(name="x", values=reading, unit="m")))  # fmt: skip
    file = tmp_path / "m.yaml"
    file.write_text(model_text(ModelFile(model=drive)))
    context = SimpleNamespace(plan=SimpleNamespace(axis_of=lambda _: "x"),
                              result_of=lambda *_: SimpleNamespace(evaluated=record))  # fmt: skip
    found = Identify(of=("motion",), output="x").result(context, "pi", [file], now=False)
    assert found.modelled == pytest.approx(reading, abs=1e-15)
    assert found.deviation < 1e-15


@pytest.mark.parametrize(("way", "more"), [("inverse", 1), ("feedback", 0)])
def test_the_last_cycles_of_a_reference_are_compared_each_by_itself(way, more):
    """A lag that differs from cycle to cycle has in each the width of its closed form."""
    action = Verify(model="pi", along="x", reference=Reference(rate=5.0, cycles=3, settle=2))
    period, half = 400, 17e-6
    t = np.arange(5 * period + more) / period
    angles = np.array([0.0, 0.0, 0.05, 0.11, 0.23])[np.minimum(t.astype(int), 4)]
    about = RunMetadata(stage="guide", instrument=Identity(vendor="v", model="m"))
    record = Record(time=t / 5.0, attributes={RUN: json.dumps(about.plain())}, channels=(
        Channel(name="reference", values=-half * np.cos(2.0 * np.pi * t), unit="m"),
        Channel(name="x", values=-half * np.cos(2.0 * np.pi * t - angles), unit="m"),
        Channel(name="voltage", values=0.0 * t, unit="V")))  # fmt: skip
    run = follow_run(way, record, Path("a.h5"), action)
    # an ellipse of the width 2 a sin(angle); the levels of the branches miss its middle by little
    assert run.widths == pytest.approx(2.0 * half * np.sin([0.05, 0.11, 0.23]), rel=2e-3)
    assert run.reference.size == 3 * period + more


def test_what_an_attempt_left_is_put_aside_whatever_its_step_is_called(tmp_path):
    records = tmp_path / "records"
    records.mkdir()
    for name in ("partial-way", "partial-way.both", "partial-way.replaced-1", "other"):
        (records / f"{name}.h5").write_bytes(b"record")
    aside = clear_leftovers(tmp_path, "partial-way", ("records/partial-way.replaced-1.h5",))
    # both ways of the step, each by a name of its own; what was aside stays as it is
    assert len(aside) == 3
    assert not (records / "partial-way.h5").exists()
    assert not (records / "partial-way.both.h5").exists()
    assert (records / "other.h5").exists()
    assert all((tmp_path / name).is_file() for name in aside)
