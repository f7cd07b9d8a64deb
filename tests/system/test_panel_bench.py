"""The view Bench without a browser: who drives, what is done, what is refused, what survives."""

import asyncio
import json
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, LimitError, ModelError, NotConnectedError
from flexstage.experiments import run_plan
from flexstage.experiments.plan import read_plan
from flexstage.instruments.lock import stage_lock
from flexstage.instruments.protocol import Identity
from flexstage.instruments.recording.metadata import RunMetadata
from flexstage.instruments.recording.writer import RunWriter
from flexstage.records import Channel, Record, read_record, write_record
from flexstage.stage.designs import design
from flexstage.web.bench import link
from flexstage.web.bench.link import CONTROL_TIMEOUT, BenchLink, Control
from flexstage.web.bench.runs import (
    RunDescription,
    WaveformRequest,
    build_waveform,
    interrupted_runs,
    loop_figures,
    recover_stream,
    run_command,
    run_plan_file,
    take_record,
    waveform_from,
)
from flexstage.web.jobs import EmergencyStop, Jobs
from flexstage.web.views.bench import run_name
from tests.panel import browser, come, looked_at, open_piezo_stage, served, simulated, until
from tests.simple_instrument import GAINS, SimpleInstrument

STAGE = design("vgtu-piezo")
PLAN = """\
plan: 1
stage: vgtu-piezo
sensors: {x: {channel: 1, calibration: 0.001}}
steps:
  - {name: loops, excite: {kind: cycles, axis: x, rate: 4 Hz, cycles: 3}}
  - {name: motion, measure: {of: loops, test: motion, along: x}}
  - {name: figures, characterise: {of: [motion]}}
"""
TWO_HZ = WaveformRequest(axis="x", shape="triangle", low=13.0, high=71.0, rate_hz=2.0, cycles=3)


@dataclass(kw_only=True)
class RealTime(SimpleInstrument):
    """An instrument whose time passes with that of the room, five times as fast."""

    def pause(self, seconds: float) -> None:
        time.sleep(seconds / 5.0)
        super().pause(seconds)


class Another(SimpleInstrument):
    """Another controller than the one before, as its serial number says."""

    @property
    def identity(self) -> Identity:
        return replace(super().identity, serial_number="another")


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., BenchLink]]:
    """Make a bench that is connected to an instrument by Ann's browser, `a`."""
    made: list[BenchLink] = []

    def at(instrument: Any, **options: Any) -> BenchLink:
        monkeypatch.setattr(link, "connect", lambda address, stage: instrument)
        found = BenchLink(EmergencyStop(), Jobs())
        made.append(found)
        found.connect("a", "Ann", "gcs://bench", STAGE, **options)
        return found

    yield at
    for each in made:
        if each.connected:
            each.close()


def about(folder: Path) -> RunDescription:
    return RunDescription(parent=folder, stage=STAGE, operator="Ann")


def ended(bench: BenchLink, state: str = "done") -> Any:
    assert bench.job is not None
    assert bench.job.wait(20.0)
    assert bench.job.state == state, bench.job.error
    return bench.job.result


def test_one_browser_drives_and_hands_over() -> None:
    now = [0.0]
    control = Control(lambda: now[0])
    control.take("a", "Ann")
    with pytest.raises(ModelError, match="Ann has control"):
        control.take("b", "Bob")
    with pytest.raises(ModelError, match=r"does not have control of the stage; Ann has control"):
        control.require("b")
    control.ask("b", "Bob")
    assert (control.requester, control.asks("b")) == ("Bob", True)
    control.keep("a")
    assert not control.requester
    control.ask("b", "Bob")
    control.give("a")
    assert (control.name, control.holds("b"), control.holds("a")) == ("Bob", True, False)
    # who is gone for a while can be followed by anybody
    now[0] = 0.9 * CONTROL_TIMEOUT
    control.keep_alive("b")
    now[0] = 1.8 * CONTROL_TIMEOUT
    assert not control.free
    now[0] = 2.0 * CONTROL_TIMEOUT
    assert control.free
    control.take("a", "Ann")
    with pytest.raises(ModelError, match="Ann has control"):
        control.release("b")


def test_to_connect_and_to_disconnect_moves_nothing(bench: Callable[..., BenchLink]) -> None:
    instrument = SimpleInstrument()
    made = bench(instrument)
    until(lambda: made.history is not None and made.history.span)
    with pytest.raises(ModelError, match="is connected: disconnect it first"):
        made.connect("b", "Bob", "gcs://other", STAGE)
    with pytest.raises(ModelError, match="Ann has control"):
        made.disconnect("b")
    made.disconnect("a")
    assert (instrument.log, instrument.closed, made.connected) == ([], True, False)
    assert not made.control.name


def test_drives_are_led_to_their_safe_voltages_where_that_was_asked(
    bench: Callable[..., BenchLink],
) -> None:
    instrument = SimpleInstrument()
    made = bench(instrument, ramps_to_safe=True)
    made.go("a", "x", 35.0).result(10.0)
    assert instrument.axes["x"].voltage() == pytest.approx(35.0)
    made.disconnect("a")
    assert instrument.axes["x"].voltage() == pytest.approx(0.0)


def test_steps_add_up_and_limits_are_refused_in_a_sentence(bench: Callable[..., BenchLink]) -> None:
    instrument = SimpleInstrument(noise=2e-9)
    made = bench(instrument)
    x = instrument.axes["x"]
    for _ in range(3):
        told = made.jog("a", "x", 7.0)
    told.result(10.0)
    assert x.voltage() == pytest.approx(21.0)
    with pytest.raises(LimitError, match="axis 'x' cannot be sent to 131 V: its limits are"):
        made.jog("a", "x", 110.0).result(10.0)
    assert x.voltage() == pytest.approx(21.0)
    until(lambda: made.readings["x"].voltage == pytest.approx(21.0))
    with pytest.raises(ModelError, match="does not have control of the stage; Ann has control"):
        made.jog("b", "x", 1.0)
    made.set_closed_loop("a", "x", True).result(10.0)
    made.go("a", "x", 17e-6).result(10.0)
    until(lambda: made.readings["x"].position == pytest.approx(17e-6, abs=2e-8))
    until(lambda: made.readings["x"].closed_loop)  # a reading may have begun before


def test_a_waveform_is_run_as_it_was_checked_and_kept(
    bench: Callable[..., BenchLink], tmp_path: Path
) -> None:
    made = bench(SimpleInstrument())
    assert made.device is not None
    command = build_waveform(made.device, STAGE, TWO_HZ)
    made.run("a", "waveform", run_command, about(tmp_path), command, 1000.0, moves=True)
    found = ended(made)
    record = read_record(found.file)
    u = record.channel("voltage x").values
    # 1.5 s, from the low end to the high end and back, three times
    assert record.size == pytest.approx(1500, abs=2)
    assert (u.min(), u.max()) == pytest.approx((13.0, 71.0), abs=0.3)
    at_quarters = u[:: record.size // 12][:13]
    assert at_quarters == pytest.approx([13.0, 42.0, 71.0, 42.0] * 3 + [13.0], abs=0.5)
    assert found.loop == ("voltage x", "x")
    # what was recorded may be run again
    again = waveform_from(made.device, found.file, "x", 1)
    assert again.duration == pytest.approx(command.duration, rel=1e-3)
    moves = build_waveform(
        made.device, STAGE, WaveformRequest(**_plain(TWO_HZ) | {"shape": "steps"})
    )
    # at rest but for a tenth of each half period
    resting = np.isclose(moves.values["x"], 13.0) | np.isclose(moves.values["x"], 71.0)
    assert resting.mean() == pytest.approx(0.9, abs=0.02)
    for wrong, told in (
        ({"high": 121.0}, "cannot be sent to 121 V"),
        ({"low": 80.0}, "low end of a waveform must be below its high end"),
        ({"rate_hz": 4000.0}, "raise command_rate"),
        ({"cycles": 2000}, "of the instrument: reduce the number of cycles"),
    ):
        with pytest.raises(FlexstageError, match=told):
            build_waveform(made.device, STAGE, WaveformRequest(**{**_plain(TWO_HZ), **wrong}))


def test_a_command_that_was_made_to_follow_says_how_well_it_does(
    bench: Callable[..., BenchLink], tmp_path: Path
) -> None:
    t = np.arange(3000) / 1000.0
    volts = 50.0 - 30.0 * np.cos(2.0 * np.pi * t)
    columns = {
        "input": Channel(name="input", values=np.full(t.size, 7.0), unit="V"),
        "command": Channel(name="command", values=volts, unit="V"),
        # the axis of the instrument is a straight line: all that is wanted lies 20 nm above it
        "reference": Channel(name="reference", values=GAINS["x"] * volts + 20e-9, unit="m"),
    }
    write_record(Record(channels=tuple(columns.values()), time=t), tmp_path / "wave.h5")
    made = bench(SimpleInstrument())
    assert made.device is not None
    command = waveform_from(made.device, tmp_path / "wave.h5", "x", 1)
    assert np.ptp(command.values["x"]) == pytest.approx(60.0, rel=1e-3)
    made.run("a", "waveform", run_command, about(tmp_path), command, 1000.0, moves=True)
    found = ended(made)
    assert found.loop == ("reference", "x")
    figures, count = loop_figures(found.record, found.loop)
    assert count == 3
    assert figures.rms == pytest.approx(20e-9, abs=2e-9)
    assert figures.loop_width < 5e-9
    # over its command it has no error, and a loop of what the axis lags behind
    alone, _ = loop_figures(found.record, ("command", "x"))
    assert math.isnan(alone.rms)
    cut = [replace(c, values=c.values[:200]) for c in columns.values()]
    flat = Record(channels=tuple(cut), time=t[:200])
    assert loop_figures(flat, ("command", "reference")) is None


def _plain(order: WaveformRequest) -> dict[str, Any]:
    return {name: getattr(order, name) for name in order.__slots__}


def test_stop_ends_what_goes_on_and_keeps_what_was_recorded(
    bench: Callable[..., BenchLink], tmp_path: Path
) -> None:
    instrument = RealTime()
    made = bench(instrument)
    job = made.run("a", "record", take_record, about(tmp_path), 60.0, 200.0, moves=True)
    with pytest.raises(ModelError, match="a run is in progress"):
        made.jog("a", "x", 1.0)
    with pytest.raises(ModelError, match="a run is in progress: stop it before"):
        made.disconnect("a")
    until(lambda: job.share > 0.01)
    began = time.monotonic()
    made.stop()
    ended(made, "cancelled")
    assert time.monotonic() - began < 30.0  # of 60
    assert instrument.stops >= 1
    (file,) = tmp_path.rglob("*.h5")
    assert 2 <= read_record(file).size < 12_000
    assert not interrupted_runs(tmp_path)
    # and the bench goes on
    made.go("a", "x", 5.0).result(10.0)


def test_stop_does_not_wait_for_what_waits(bench: Callable[..., BenchLink]) -> None:
    instrument = RealTime()
    made = bench(instrument)
    first = made.go("a", "x", 100.0)
    later = [made.go("a", "y", 50.0) for _ in range(3)]
    until(lambda: any(line.startswith("load") for line in instrument.log))
    made.stop()
    with pytest.raises(FlexstageError, match="stopped"):
        first.result(10.0)
    assert all(each.cancelled() for each in later)
    assert instrument.axes["y"].voltage() == pytest.approx(0.0)


def test_a_stop_that_overtakes_a_command_has_the_last_word(bench: Callable[..., BenchLink]) -> None:
    instrument = RealTime()
    made = bench(instrument)
    begun, goes_on = threading.Event(), threading.Event()

    def late(device: Any) -> None:
        begun.set()
        goes_on.wait(10.0)
        device.axes["x"].set_voltage(50.0)

    told = made.submit("a", late)
    assert begun.wait(10.0)
    made.stop()
    stops = instrument.stops
    goes_on.set()
    with pytest.raises(FlexstageError, match="stopped"):
        told.result(10.0)
    assert instrument.stops == stops + 1
    # and what is told later is done
    made.jog("a", "x", 1.0).result(10.0)


def test_a_lost_link_is_told_and_opened_again(
    bench: Callable[..., BenchLink], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, "_RETRY_INTERVAL", 0.02)
    instrument = SimpleInstrument()
    made = bench(instrument)
    until(lambda: made.readings)
    there = threading.Event()

    other = Another()

    def connect(address: str, stage: Any) -> SimpleInstrument:
        if not there.is_set():
            raise NotConnectedError("nobody answers there")
        return other if swapped.is_set() else SimpleInstrument()

    swapped = threading.Event()
    monkeypatch.setattr(link, "connect", connect)
    made.clear("a", True)
    instrument.cut_link_at = 0.0
    until(lambda: made.fault == "nobody answers there")
    assert made.is_lost
    with pytest.raises(NotConnectedError, match="the connection is lost"):
        made.jog("a", "x", 1.0)
    made.stop()  # which never fails
    # another stage at the same address is not taken for the one that was lost
    swapped.set()
    there.set()
    until(lambda: "is now another instrument" in made.fault)
    assert made.is_lost
    with pytest.raises(NotConnectedError, match="another instrument"):
        made.jog("a", "x", 1.0)
    assert other.log == []
    swapped.clear()
    until(lambda: not made.fault)
    assert not made.is_lost
    assert not made.path_clear
    made.jog("a", "x", 3.0).result(10.0)
    until(lambda: made.readings["x"].voltage == pytest.approx(3.0))


def test_a_real_stage_is_locked_and_moves_when_its_way_is_clear(
    bench: Callable[..., BenchLink], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FLEXSTAGE_STATE", str(tmp_path / "state"))
    with stage_lock("S7"), pytest.raises(NotConnectedError, match="'S7' is in use"):
        bench(SimpleInstrument(simulated=False))
    made = bench(SimpleInstrument(simulated=False, noise=1e-9))
    with pytest.raises(NotConnectedError, match="'S7' is in use"), stage_lock("S7"):
        pass
    with pytest.raises(ModelError, match="that the way of the stage is clear"):
        made.jog("a", "x", 1.0)
    made.clear("a", True)
    made.jog("a", "x", 1.0).result(10.0)
    # a plan is carried out under the lock that is held
    plan = tmp_path / "small.yaml"
    plan.write_text(PLAN)
    given = (about(tmp_path / "runs"), str(plan), None, None, made.lock_name)
    made.run("a", "plan", run_plan_file, *given, moves=True)
    found = ended(made)
    alone = run_plan(
        read_plan(plan),
        SimpleInstrument(noise=1e-9),
        tmp_path / "alone",
        stage=STAGE,
    )
    own = json.loads((found.folder / "results.json").read_text())["figures"]
    assert [f["quantity"] for f in own] == [f.quantity for f in alone.figures]
    assert own[0]["value"] == pytest.approx(alone.figures[0].value, rel=1e-3)
    assert (found.folder / "report.html").exists()
    made.disconnect("a")
    with stage_lock("S7"):
        pass


def test_an_interrupted_plan_is_gone_on_with(
    bench: Callable[..., BenchLink], tmp_path: Path
) -> None:
    plan = tmp_path / "small.yaml"
    plan.write_text(PLAN + "  - {name: later, measure: {of: loops, test: motion, along: x}}\n")
    instrument = SimpleInstrument(noise=1e-9)
    made = bench(instrument)
    instrument.nan_from = {"x": instrument.now + 1.8}  # in the second record
    given = (about(tmp_path / "runs"), str(plan), None, None, "")
    made.run("a", "plan", run_plan_file, *given, moves=True)
    ended(made, "failed")
    assert made.job is not None
    assert "step 'later'" in made.job.error
    (left,) = interrupted_runs(tmp_path / "runs")
    assert left.about == "unfinished plan"
    instrument.nan_from = {}
    given = (about(tmp_path / "runs"), str(left.plan), left.path, None, "")
    made.run("a", "plan", run_plan_file, *given, moves=True)
    found = ended(made)
    taken = {step.name: step.repeated for step in found.plan.of("measure")}
    assert taken == {"motion": False, "later": True}
    assert not interrupted_runs(tmp_path / "runs")


def test_what_a_killed_server_leaves_is_found_and_recovered(tmp_path: Path) -> None:
    records = tmp_path / "20310102T030405Z-vgtu-piezo-record" / "records"
    records.mkdir(parents=True)
    identity = SimpleInstrument().identity
    writer = RunWriter(
        records / "record.stream", [("x", "m")], 500.0,
        RunMetadata(stage="vgtu-piezo", instrument=identity),
    )  # fmt: skip
    writer.append(0, {"x": np.linspace(0.0, 3e-6, 700)})
    writer._file._file.close()  # as where the process ends
    (left,) = interrupted_runs(tmp_path)
    assert left.about == "700 samples saved"
    assert read_record(recover_stream(left.path)).size == 700
    assert not interrupted_runs(tmp_path)


def test_the_page_connects_and_a_reload_finds_the_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    instrument = SimpleInstrument()
    monkeypatch.setattr(link, "connect", lambda address, stage: instrument)

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/bench")
        await user.should_not_see("STOP")
        user.find(kind=ui.button, content="Connect").click()
        await user.should_see("You have control of the stage", retries=20)
        await user.should_see("STOP")
        await user.open("/bench")
        await user.should_see("Axis x")
        bench = panel.state(BenchLink)
        await asyncio.to_thread(until, lambda: "x" in bench.readings)
        assert instrument.log == []
        (session,) = panel.access._sessions.values()
        bench.control.give(session.id)
        bench.control.take("other", "Bob")
        await user.should_see("Bob has control: you can only watch", retries=20)
        bench.close()

    simulated(tmp_path, look)


def test_what_an_axis_refuses_stands_in_its_card_until_it_accepts_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, "connect", lambda address, stage: SimpleInstrument())

    async def look(user: Any, panel: Any) -> None:
        from nicegui import ui

        await user.open("/bench")
        user.find(kind=ui.button, content="Connect").click()
        await user.should_see("limits, position control", retries=40)
        await user.should_see("limits, voltage")
        bench = panel.state(BenchLink)
        await asyncio.to_thread(until, lambda: "x" in bench.readings)

        def told() -> list[str]:
            cards = [e for e in user.client.elements.values() if "axis" in e.classes]
            return [
                e.text for card in cards[:1] for e in card.descendants() if "refused" in e.classes
            ]

        try:
            await user.should_see("Target [V]", retries=40)
            target = min(
                (n for n in user.find(ui.number).elements if n.props["label"] == "Target [V]"),
                key=lambda n: n.id,
            )
            go = min(user.find(kind=ui.button, content="Go").elements, key=lambda b: b.id)
            for value, refused in ((500.0, True), (501.0, True), (5.0, False)):
                target.value = value
                with go:
                    for listener in go._event_listeners.values():
                        go._handle_event({"listener_id": listener.id, "args": {}})
                await come(lambda refused=refused: bool(told()) is refused)
                assert len(told()) == refused
                assert all("cannot be sent to" in said for said in told())
        finally:
            bench.close()

    simulated(tmp_path, look)


def test_a_run_has_the_name_that_a_person_gave(tmp_path: Path) -> None:
    named = replace(about(tmp_path), name="first loop").folder("waveform-x")
    assert run_name(named) == "first-loop-waveform-x"
    assert run_name(about(tmp_path).folder("record")) == "vgtu-piezo-record"
    assert run_name(tmp_path / "mine") == "mine"


def connected(page: Any, address: str = "") -> None:
    """Open the bench and connect, to the twin where no address is given."""
    page.get_by_role("link", name="Bench", exact=True).click()
    page.get_by_role("button", name="Connect").wait_for()
    if address:
        page.get_by_label("Address").fill(address)
    page.get_by_role("button", name="Connect").click()
    page.get_by_role("heading", name="Axis x").wait_for()


@pytest.mark.slow
def test_the_bench_is_sound_and_does_its_task(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        page = look.page
        page.get_by_role("link", name="Bench", exact=True).click()
        page.get_by_role("button", name="Connect").wait_for()
        listed = page.get_by_text("The latest runs")
        listed.or_(page.get_by_text("No run yet")).wait_for()
        look.shot("bench-before")
        connected(page)
        # from the 6 V of its zero, by the keyboard: two steps of 5 V up and one down
        page.get_by_role("region", name="Axis x").focus()
        for key in ("ArrowRight", "ArrowUp", "ArrowLeft"):
            page.keyboard.press(key)
        page.get_by_text("11.00", exact=True).first.wait_for()
        page.get_by_label("Target [V]").first.fill("130")
        page.get_by_role("button", name="Go", exact=True).first.click()
        page.get_by_text("axis 'x' cannot be sent to 130 V: its limits are 0 to 120 V").wait_for()
        # it stands in the card of the axis, and goes with what that accepts
        refused = page.get_by_role("region", name="Axis x").get_by_role("alert")
        assert "cannot be sent" in refused.inner_text()
        page.get_by_role("button", name="Step axis x up").click()
        refused.wait_for(state="hidden")
        page.get_by_role("button", name="Step axis x down").click()
        page.get_by_text("11.00", exact=True).first.wait_for()
        page.get_by_label("Frequency [Hz]").fill("2")
        page.get_by_text("1.501 s, 12.00 to 108.00 V").wait_for()
        page.get_by_role("button", name="Run the waveform").click()
        page.get_by_role("button", name="Download the record").wait_for()
        page.get_by_role("figure", name="The recorded loop").wait_for()
        look.require_sound("bench")
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Download the record").click()
        waiting.value.save_as(tmp_path / "record.h5")
        assert read_record(tmp_path / "record.h5").channel("x").values.max() > 50e-6
        page.reload()
        page.get_by_role("button", name="Download the record").wait_for()
        page.get_by_role("tab", name="Plan").click()
        page.get_by_text("42 steps").wait_for()
        page.get_by_role("tab", name="Runs").click()
        page.get_by_text("The latest runs").wait_for()
        look.require_sound("bench-runs")
        # a second browser sees all and drives nothing
        page.get_by_role("button", name="Disconnect").click()
        page.get_by_role("button", name="Connect").wait_for()
        assert not look.complaints


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_record_outlives_its_page_and_its_server(tmp_path: Path) -> None:
    twin = subprocess.Popen(
        [sys.executable, "-m", "flexstage", "twin", "vgtu-piezo", "--address", "0", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert twin.stdout is not None
        at = json.loads(twin.stdout.readline())["address"]
        with browser() as running:
            with served(tmp_path) as (address, process):
                context = running.new_context()
                page = context.new_page()
                page.goto(address)
                open_piezo_stage(page)
                connected(page, at)
                # a second browser sees all, and drives when the first one hands over
                assert process.stdout is not None
                other = running.new_context().new_page()
                other.goto(json.loads(process.stdout.readline())["address"])
                other.get_by_role("link", name="Bench", exact=True).click()
                other.get_by_text("you can only watch").wait_for()
                up = other.get_by_role("button", name="Step axis x up")
                assert up.is_disabled()
                other.get_by_role("button", name="Ask for control").click()
                page.get_by_role("button", name="Grant control").click()
                other.get_by_text("You have control of the stage").wait_for()
                up.click()
                page.get_by_text("11.00", exact=True).first.wait_for()
                other.get_by_role("button", name="Release control").click()
                page.get_by_role("button", name="Take control").click()
                page.get_by_role("tab", name="Record").click()
                page.get_by_label("Duration [s]").fill("50")
                page.get_by_label("Sample rate [Hz]").fill("500")
                page.get_by_role("button", name="Record", exact=True).click()
                page.get_by_text("recording, ").wait_for()
                page.close()
                # another page of the same browser finds it
                page = context.new_page()
                page.goto(address.partition("?")[0] + "bench")
                page.get_by_text("recording, ").wait_for()
                (stream,) = (tmp_path / "files" / "bench").rglob("*.stream")
                until(lambda: stream.stat().st_size > 40_000)
                process.send_signal(signal.SIGKILL)
                process.wait(10.0)
            assert stream.exists()
            with served(tmp_path) as (address, _):
                page = running.new_context().new_page()
                page.goto(address)
                open_piezo_stage(page)
                connected(page, at)
                page.get_by_role("tab", name="Runs").click()
                page.get_by_text("samples saved").wait_for()
                page.get_by_role("button", name="Recover").click()
                page.get_by_text("recovered as").wait_for()
                # a server that is asked to end stops the run and keeps what was recorded
                page.get_by_role("tab", name="Record").click()
                page.get_by_role("button", name="Record", exact=True).click()
                page.get_by_text("recording, ").wait_for()
                until(lambda: len([*(tmp_path / "files" / "bench").rglob("*.stream")]) == 1)
                page.wait_for_timeout(1500)
            assert not [*(tmp_path / "files" / "bench").rglob("*.stream")]
            assert len([*(tmp_path / "files" / "bench").rglob("*.h5")]) == 2
            assert read_record(stream.with_suffix(".h5")).size > 1000
    finally:
        twin.send_signal(signal.SIGINT)
        twin.communicate(timeout=120.0)
