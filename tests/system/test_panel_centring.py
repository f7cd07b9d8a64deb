"""The view Centring: its four steps centre a scale, and say what `flexstage centre` says."""

import asyncio
import copy
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, ModelError, RecordError
from flexstage.centring.calibration_moves import OrderResponse, _best
from flexstage.cli import main
from flexstage.quantities.estimate import Component, Estimate
from flexstage.web.centring.state import CentringState
from flexstage.web.centring.work import (
    evaluate_files,
    gauge_record,
    likely_columns,
    move_to,
    simulated_record,
    stage_position,
)
from flexstage.web.sessions import Preferences
from flexstage.web.views.centring import figures, position_text, turns_table
from tests.panel import looked_at, simulated, until
from tests.undrawn import undrawn


def measured(state: CentringState, folder: Path) -> None:
    """Turn the simulated table once, and evaluate."""
    path = folder / f"turn-{len(state.turns) + 1}.csv"
    by = [at - first for at, first in zip(state.position, state.origin, strict=True)]
    simulated_record(by, len(state.turns), path)
    state.add_turn(path)
    state.result = evaluate_files(state.evaluation, "key")


def test_of_a_magnet_the_order_counts_that_tells_the_centre_best() -> None:
    def order(number: int, deviation: float | None) -> OrderResponse:
        own = () if deviation is None else (Component(name="noise", uncertainty=deviation),)
        at = Estimate(value=1e-5, unit="m", components=own) if own else None
        return OrderResponse(
            order=number, change=1e-6, relation="linear", gain=1.0, residual=0.0, x=at, y=at,
            positions=4,
        )  # fmt: skip

    found = [order(1, 3e-6), order(2, 1e-6), order(3, None), order(4, 2e-6)]
    assert _best(found, "magnet") is found[1]
    assert _best(found, None) is found[0]


@pytest.fixture(scope="module")
def centred(tmp_path_factory: pytest.TempPathFactory) -> tuple[CentringState, list[int]]:
    """The example after its four steps, none of which drew a figure, and the steps."""
    folder = tmp_path_factory.mktemp("centred")
    state = CentringState()
    state.begin("example", (10e-6, -1.8e-9))
    steps = []
    with undrawn():
        for _ in range(4):
            steps.append(state.step)
            measured(state, folder)
            target = state.target()
            assert target is not None
            state.position = target
    return state, steps


def test_four_steps_centre_the_scale_as_the_command_says(
    centred: tuple[CentringState, list[int]], capsys: pytest.CaptureFixture[str]
) -> None:
    state, steps = centred
    assert steps == [1, 2, 2, 3]
    assert state.result is not None
    first, *_, last = (s["eccentricity"] for s in state.result.setups)
    # the centre of the example, and noise of 1 arcsec of 1440 samples at 50 mm
    assert first["value"] == pytest.approx(math.hypot(17.3e-6, 11.2e-6), abs=0.05e-6)
    assert last["interval"][1] < 0.1e-6
    at = "; ".join(f"{1e6 * x},{1e6 * y}" for x, y in (m.position for m in state.turns))
    options = ["--angle", "angle", "--error", "head 1,head 2", "--heads", "0,180", "--kind", "disc"]
    files = [str(m.file) for m in state.turns]
    with pytest.raises(SystemExit) as end:
        main(["centre", *files, *options, "--radius", "50 mm", "--stage-at", at, "--json"])
    assert not end.value.code
    printed = json.loads(capsys.readouterr().out)
    own = json.loads(json.dumps(state.result.data))  # a copy
    # places went through a text
    for one in (printed, own):
        places = one["trial"].pop("positions")
        assert np.allclose(places, [m.position for m in state.turns], rtol=0.0, atol=1e-18)
    assert own["trial"]["centre"]["x"] == pytest.approx(printed["trial"]["centre"]["x"], rel=1e-9)
    assert own["setups"] == printed["setups"]
    name, value, remark = figures(own, state.request.radius, Preferences())[0]
    assert (name, value.split()[-1], remark[:4]) == ("Eccentricity", "µm", "95 %")
    assert len(turns_table(state, Preferences(length="mm")).rows) == 4


def test_a_move_below_the_noise_of_the_sensor_is_not_asked_for(
    centred: tuple[CentringState, list[int]],
) -> None:
    state = copy.copy(centred[0])
    x, y = state.target() or (0.0, 0.0)
    at = state.turns[-1].position
    assert 0.0 < abs(x - at[0]) < 1e-6
    state.noise = (1.01 * abs(x - at[0]), 0.99 * abs(y - at[1]))
    assert state.target() == (at[0], y)
    # no digit of it is noise either
    assert position_text((15e-6, -1.8e-9), Preferences()) == "x 15.000, y −0.002 µm"


@pytest.mark.usefixtures("undrawn")
def test_the_last_turn_is_taken_back_and_another_source_begins_anew(tmp_path: Path) -> None:
    state = CentringState()
    state.begin("example")
    measured(state, tmp_path)
    state.position = (5e-6, 0.0)
    measured(state, tmp_path)
    state.undo_turn()
    assert (len(state.turns), state.position, state.result) == (1, (5e-6, 0.0), None)
    state.begin("gauge")
    assert (state.turns, state.request.names, state.step) == ([], ("gauge",), 1)


@pytest.mark.usefixtures("undrawn")
def test_typed_readings_of_a_gauge_say_the_runout(tmp_path: Path) -> None:
    state = CentringState()
    state.begin("gauge")
    turn = np.arange(12) * math.pi / 6.0
    readings = 8.0 + 14.0 * np.cos(turn) - 5.0 * np.sin(turn)
    text = " ".join(f"{value:.3f}".replace("-", "−") for value in readings)
    gauge_record(text, 1e-6, tmp_path / "gauge.csv")
    state.add_turn(tmp_path / "gauge.csv")
    found = evaluate_files(state.evaluation, "key").data
    assert found["eccentricity"]["value"] == pytest.approx(math.hypot(14e-6, 5e-6), rel=1e-3)
    assert figures(found, 50e-3, Preferences())[1][1].startswith("61.3")


@pytest.mark.parametrize(
    ("text", "told"), [("1 2 3", "at least 8 readings"), ("a b", "numbers separated by spaces")]
)
def test_readings_that_are_none_are_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(RecordError, match=told):
        gauge_record(text, 1e-6, tmp_path / "gauge.csv")
    assert not list(tmp_path.iterdir())


def test_the_columns_of_a_record_are_seen(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text("time,theta,h1,h2\n" + "".join(f"{k},{k},1,2\n" for k in range(9)))
    likely = likely_columns(path)
    assert (likely.angle, likely.errors, likely.has_units) == ("theta", ("h1", "h2"), False)
    state = CentringState()
    state.use_columns(likely)
    assert (state.request.unit, state.request.heads) == ("deg", (0.0, math.pi))
    path.write_text("h1\n" + "1\n" * 9)
    with pytest.raises(RecordError, match="has 1 column"):
        likely_columns(path)


def test_a_turn_is_found_again_after_a_reload(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/centring")
        await user.should_see("No turn measured yet")
        user.find("Turn the simulated table").click()
        (session,) = panel.access._sessions.values()
        state = session.state(CentringState)
        await come(lambda: state.result)
        target = state.target()
        assert target is not None
        assert state.position == target
        await user.open("/centring")
        await user.should_see("1 start")
        await user.should_see("Move the stage by")

    simulated(tmp_path, look)


@pytest.mark.slow
def test_the_bench_moves_only_for_who_drives_and_within_limits(tmp_path: Path) -> None:
    from flexstage.stage.designs import design
    from flexstage.web.bench.link import BenchLink
    from flexstage.web.jobs import EmergencyStop, Jobs

    jobs = Jobs()
    bench = BenchLink(EmergencyStop(), jobs)
    with pytest.raises(ModelError, match="no two-axis stage is connected"):
        move_to(bench, "me", (0.0, 0.0))
    bench.connect("me", "Ann", "twin://?seed=1", design("vgtu-piezo"))
    try:
        until(lambda: stage_position(bench) is not None)
        with pytest.raises(ModelError, match="does not have control"):
            move_to(bench, "other", (10e-6, 10e-6))
        with pytest.raises(ModelError, match="position control of axis x and y is off"):
            move_to(bench, "me", (10e-6, 10e-6))
        for axis in bench.readings:
            bench.set_closed_loop("me", axis, True).result()
        until(lambda: all(r.closed_loop for r in bench.readings.values()))
        before = stage_position(bench)
        with pytest.raises(FlexstageError, match="its limits are"):
            move_to(bench, "me", (10e-6, 1.0))
        assert stage_position(bench) == pytest.approx(before, abs=0.1e-6)
        assert move_to(bench, "me", (12e-6, 9e-6)) == pytest.approx((12e-6, 9e-6), abs=0.1e-6)
    finally:
        bench.close()
        jobs.close()


@pytest.mark.slow
def test_the_page_moves_a_connected_stage(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        from flexstage.stage.designs import design
        from flexstage.web.bench.link import BenchLink

        bench = panel.state(BenchLink, lambda: BenchLink(panel.emergency_stop, panel.jobs))
        (session,) = panel.access._sessions.values()
        await asyncio.to_thread(
            bench.connect, session.id, "Ann", "twin://?seed=1", design("vgtu-piezo")
        )
        try:
            for axis in ("x", "y"):
                await asyncio.to_thread(bench.set_closed_loop(session.id, axis, True).result)
                await asyncio.to_thread(bench.go(session.id, axis, 38e-6).result)
            await come(lambda: all(r.closed_loop and not r.moving for r in bench.readings.values()))
            await asyncio.sleep(0.3)
            await user.open("/centring")
            state = session.state(CentringState)
            assert state.position == pytest.approx((38e-6, 38e-6), abs=0.2e-6)
            for turn in range(1, 5):
                user.find("Turn the simulated table").click()
                await come(lambda turn=turn: len(state.turns) == turn and state.up_to_date)
                target, before = state.target(), state.position
                assert target is not None
                if turn < 4:
                    await user.should_see("Move the stage there")
                    user.find("Move the stage there").click()
                    await come(lambda before=before: state.position != before)
                    assert state.position == pytest.approx(target, abs=0.1e-6)
            assert state.result is not None
            assert state.result.data["eccentricity"]["value"] < 0.1e-6
            bench.control.release(session.id)
            await user.open("/centring")
            await user.should_see("does not have control of the stage")
        finally:
            bench.close()

    simulated(tmp_path, look)


async def come(condition: Callable[[], Any], seconds: float = 40.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        await asyncio.sleep(0.02)


def turned(page: Any, count: int) -> None:
    """Turn the simulated table, and wait until the turn is evaluated."""
    page.get_by_role("button", name="Turn the simulated table").click()
    page.locator(".tables tbody tr").nth(count - 1).wait_for()
    page.wait_for_function(
        "!document.querySelector('.tables').textContent.includes('…') &&"
        " document.querySelectorAll('main .job').length === 0"
    )


@pytest.mark.slow
def test_a_scale_is_centred_in_the_page(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        page = look.page
        page.get_by_role("link", name="Centring").click()
        page.get_by_text("No turn measured yet").wait_for()
        look.shot("centring-empty")
        turned(page, 1)
        turned(page, 2)
        look.shot("centring-trial")
        turned(page, 3)
        page.get_by_text("Stage position x").wait_for()
        turned(page, 4)
        left = page.locator(".step .issue.good", has_text="Eccentricity").inner_text()
        assert "initially" in left
        look.require_sound("centring-verified")
        page.reload()
        page.locator(".step .issue.good").wait_for()
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Results (JSON)").click()
        found = json.loads(Path(waiting.value.path()).read_text())
        assert found["eccentricity"]["interval"][1] < 0.1e-6
        # records of one's own, of which the first is none
        page.get_by_role("combobox", name="Source of records").click()
        page.get_by_role("option", name="Records of an encoder").click()
        files = page.locator("input[type=file]")
        (tmp_path / "none.csv").write_text("h1\n1\n2\n3\n")
        files.set_input_files(tmp_path / "none.csv")
        page.get_by_role("alert").filter(has_text="1 column").wait_for()
        (own,) = (p for p in (tmp_path / "files" / "centring").glob("*/turn-1.csv"))
        files.set_input_files(own)
        page.locator(".key-figure", has_text="Eccentricity").wait_for()
        look.require_sound("centring-records")
        page.get_by_role("combobox", name="Source of records").click()
        page.get_by_role("option", name="Readings of a gauge").click()
        page.get_by_label("Readings over one turn").fill("22 20 14 6 -2 -5 -6 -3 2 9 16 20")
        page.get_by_role("button", name="Use the readings").click()
        page.locator(".key-figure", has_text="Eccentricity").wait_for()
        assert not look.complaints
