"""The view Centring: its steps say what `flexstage scale`, `centre` and `calibrate` say."""

import asyncio
import copy
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexstage.base.errors import FlexstageError, ModelError, RecordError
from flexstage.centring.calibration_moves import OrderResponse, _best
from flexstage.centring.requests import CertificateRequest
from flexstage.cli import main
from flexstage.quantities.estimate import Component, Estimate
from flexstage.web.centring import work
from flexstage.web.centring.state import CentringState
from flexstage.web.centring.work import (
    EXAMPLE,
    certify,
    evaluate_files,
    gauge_record,
    likely_columns,
    move_to,
    stage_position,
    study_table,
    turn_history,
    turn_table,
)
from flexstage.web.live_history import POINTS
from flexstage.web.sessions import Preferences
from flexstage.web.views.centring import figures, position_text, turns_table
from tests.panel import come, looked_at, simulated, until
from tests.undrawn import undrawn


@pytest.fixture(autouse=True, scope="module")
def _fast_table() -> Iterator[None]:
    """Let simulated tables turn at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "_TURN_TIME", 1e-3)
        patch.setattr(work, "_FRAME", 1e-4)
        yield


def measured(state: CentringState, folder: Path) -> None:
    """Turn the simulated table once, and evaluate."""
    path = folder / f"turn-{len(state.turns) + 1}.csv"
    by = [at - first for at, first in zip(state.position, state.origin, strict=True)]
    history = turn_history(state.table)
    turn_table(state.table, by, len(state.turns), path, history)
    # every sample is on the page
    kept = history.samples(0.0, history.seconds, POINTS)
    assert np.allclose(kept.low, np.loadtxt(path, delimiter=",", skiprows=1), rtol=1e-12)
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


def centring(folder: Path, turns: int, *, by_trial: bool) -> CentringState:
    """Centre the scale of the example by so many turns, without drawing a figure."""
    state = CentringState(by_trial=by_trial)
    state.use_table(EXAMPLE, folder)
    state.begin("simulated", (10e-6, -1.8e-9))
    with undrawn():
        for _ in range(turns):
            measured(state, folder)
            target = state.target()
            assert target is not None
            state.position = target
    return state


@pytest.fixture(scope="module")
def centred(tmp_path_factory: pytest.TempPathFactory, _fast_table: None) -> CentringState:
    """The example after its trial moves."""
    return centring(tmp_path_factory.mktemp("centred"), 4, by_trial=True)


def printed(capsys: pytest.CaptureFixture[str], command: str, *arguments: str) -> dict[str, Any]:
    """Return what a command prints as JSON."""
    with pytest.raises(SystemExit) as end:
        main([command, *arguments, "--json"])
    assert not end.value.code
    return json.loads(capsys.readouterr().out)


HEADS = ("--angle", "angle", "--error", "head 1,head 2,head 3,head 4")


def test_trial_moves_centre_the_scale_as_the_command_says(
    centred: CentringState, capsys: pytest.CaptureFixture[str]
) -> None:
    state = centred
    assert [turn.kind for turn in state.turns] == ["start", "trial", "trial", "move"]
    assert state.result is not None
    first, *_, last = (s["eccentricity"] for s in state.result.setups)
    assert first["value"] == pytest.approx(50e-6, abs=0.02e-6)
    assert last["interval"][1] < 0.1e-6
    at = "; ".join(f"{1e6 * x},{1e6 * y}" for x, y in (m.position for m in state.turns))
    files = [str(m.file) for m in state.turns]
    options = ("--table", str(state.table_file), "--stage", "vgtu-mechanical", "--stage-at", at)
    said = printed(capsys, "centre", *files, *HEADS, *options)
    own = json.loads(json.dumps(state.result.data))  # a copy
    # places went through a text
    for one in (said, own):
        places = one["trial"].pop("positions")
        assert np.allclose(places, [m.position for m in state.turns], rtol=0.0, atol=1e-18)
    assert own["trial"]["centre"]["x"] == pytest.approx(said["trial"]["centre"]["x"], rel=1e-9)
    assert own["setups"] == said["setups"]
    elongations, wanted = (
        [drive["elongation"] for drive in one["settings"]["drives"]] for one in (own, said)
    )
    assert elongations == pytest.approx(wanted, rel=1e-6)
    name, value, remark = figures(own, state.table.scale.radius, Preferences())[0]
    assert (name, value.split()[-1], remark[:4]) == ("Eccentricity", "µm", "95 %")
    assert len(turns_table(state, Preferences(length="mm")).rows) == 4


def test_known_moves_leave_the_error_of_the_ratio_and_the_certificate_is_that_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state = centring(tmp_path, 3, by_trial=False)
    assert state.result is not None
    # each move of the stage is 3 % longer than its model says, and noise remains
    values = [s["eccentricity"]["value"] for s in state.result.setups]
    assert values == pytest.approx([50e-6, 1.5e-6, 0.045e-6], abs=0.02e-6)
    last = str(state.turns[-1].file)
    said = printed(
        capsys, "centre", last, *HEADS, "--table", str(state.table_file),
        "--stage", "vgtu-mechanical",
    )  # fmt: skip
    assert state.result.settings is not None
    assert state.result.settings.to_dict() == said["settings"]
    with undrawn():
        stated = CertificateRequest(certificate="page.html", **state.facts)
        written = certify(
            tmp_path / "report", state.table.name, state.turns[-1].file, state.calibration, stated,
            ("simulated records, not measured",),
        )  # fmt: skip
    result = json.loads((written.folder / "results.json").read_text())
    said = printed(capsys, "calibrate", last, *HEADS, "--method", "self", "--heads", "0,92,178,275")
    assert result["points"] == said["points"]
    page = (written.folder / "report.html").read_text("utf-8")
    assert "simulated scale of comparator" in page
    assert "simulated records, not measured" in page


def test_a_table_that_is_none_is_refused_and_the_last_one_remains(tmp_path: Path) -> None:
    state = CentringState()
    state.use_table(EXAMPLE, tmp_path)
    with pytest.raises(ModelError, match=r"line 10, scale\.tilt: unknown unit 'bananas'"):
        state.use_table(EXAMPLE.replace("10 arcsec", "10 bananas"), tmp_path)
    assert state.table.name == "comparator"
    assert (tmp_path / "table.yaml").read_text() == EXAMPLE
    studied = study_table(state.table, (), "key")
    assert [name for name, each in studied.stages.items() if each.suits] == [
        "bridge-xy", "vgtu-mechanical",
    ]  # fmt: skip


def test_a_move_below_the_noise_of_the_sensor_is_not_asked_for(centred: CentringState) -> None:
    state = copy.copy(centred)
    x, y = state.target() or (0.0, 0.0)
    at = state.turns[-1].position
    assert 0.0 < abs(x - at[0]) < 1e-6
    state.noise = (1.01 * abs(x - at[0]), 0.99 * abs(y - at[1]))
    assert state.target() == (at[0], y)
    # no digit of it is noise either
    assert position_text((15e-6, -1.8e-9), Preferences()) == "x 15.000, y −0.002 µm"


@pytest.mark.usefixtures("undrawn")
def test_the_last_turn_is_taken_back_and_another_source_begins_anew(tmp_path: Path) -> None:
    state = centring(tmp_path, 1, by_trial=False)
    state.position = (5e-6, 0.0)
    measured(state, tmp_path)
    state.undo_turn()
    assert (len(state.turns), state.position, state.result) == (1, (5e-6, 0.0), None)
    state.begin("gauge")
    assert (state.turns, state.request.names, state.next_kind) == ([], ("gauge",), "start")


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
    # the error of a scale of this radius
    arcsec = math.degrees(math.hypot(14e-6, 5e-6) / 48e-3) * 3600.0
    text = figures(found, state.table.scale.radius, Preferences())[1][1]
    assert float(text.split()[0]) == pytest.approx(arcsec, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 2 3", "at least 8 readings"),
        ("a b", "numbers separated by spaces"),
        ("1 2 3 4 5 6 7 8 nan", "finite"),
    ],
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
    assert (state.request.unit, state.request.error) == ("deg", ("h1", "h2"))
    path.write_text("h1\n" + "1\n" * 9)
    with pytest.raises(RecordError, match="has 1 column"):
        likely_columns(path)


@pytest.mark.usefixtures("undrawn")
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
        await user.should_see("Move in x")

    simulated(tmp_path, look)


@pytest.mark.usefixtures("undrawn")
def test_uploaded_records_never_replace_measured_turns(tmp_path: Path) -> None:
    """A laboratory calls its records what the view calls its own: each turn stays what it was."""
    from nicegui import ui
    from nicegui.elements.upload_files import SmallFileUpload

    def content(size: int) -> bytes:
        turn = np.arange(36) * 10.0
        errors = size * 1e-3 * np.sin(np.radians(turn))
        rows = (f"{t:g},{e:.9f}" for t, e in zip(turn, errors, strict=True))
        return "\n".join(("angle,h1", *rows)).encode()

    async def look(user: Any, panel: Any) -> None:
        await user.open("/centring")
        (session,) = panel.access._sessions.values()
        state = session.state(CentringState)
        state.begin("records")
        await user.open("/centring")
        user.find("3 Records").click()
        for count in (1, 2, 3):
            await user.should_see("Record of a turn: drop it here")
            (field,) = (
                e
                for e in user.find(ui.upload).elements
                if str(e.props.get("label", "")).startswith("Record of a turn")
            )
            await field.handle_uploads([SmallFileUpload(f"turn-{count}.csv", "", content(count))])
            await come(lambda count=count: len(state.turns) == count)
        assert [turn.file.read_bytes() for turn in state.turns] == [content(k) for k in (1, 2, 3)]

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
            state = session.state(CentringState)
            state.table_text = EXAMPLE.replace("eccentricity: 50 um", "eccentricity: 12 um")
            state.by_trial = True
            await user.open("/centring")
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


#: The direction of the farthest pixel of the curve of the first head [deg].
_FARTHEST = """chart => {
  const canvas = chart.querySelector("canvas");
  const { data, width, height } = canvas.getContext("2d")
    .getImageData(0, 0, canvas.width, canvas.height);
  const colour = [1, 3, 5].map(k => parseInt(chart.live.look.data[1].slice(k, k + 2), 16));
  let [farthest, direction] = [0, NaN];
  for (let k = 0; k < data.length; k += 4) {
    if (data[k + 3] < 250 || colour.some((c, j) => Math.abs(data[k + j] - c) > 8)) continue;
    const x = (k / 4) % width - width / 2, y = height / 2 + 2 - Math.floor(k / 4 / width);
    if (Math.hypot(x, y) > farthest) [farthest, direction] = [Math.hypot(x, y), Math.atan2(y, x)];
  }
  return direction * 180 / Math.PI;
}"""


def turned(page: Any, count: int) -> None:
    """Turn the simulated table, and wait until the turn is evaluated."""
    page.get_by_role("tab", name="Records").click()
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
        allowed = page.locator(".key-figure", has_text="Allowed eccentricity")
        allowed.wait_for()
        look.require_sound("centring-table")
        # the table is edited: what it forbids is said, what it allows is calculated anew
        text = page.get_by_label("Table, scale, heads and tolerance")
        text.fill(EXAMPLE.replace("radius: 48 mm", "radius: 48 bananas"))
        page.get_by_role("alert").filter(has_text="line 5, scale.radius").wait_for()
        text.fill(EXAMPLE.replace("eccentricity: 0.3 um", "eccentricity: 0.25 um"))
        allowed.filter(has_text="0.250 µm").wait_for()
        page.get_by_role("tab", name="Table").focus()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        page.locator(".issue.good", has_text="Smallest margin 1.08").wait_for()
        page.get_by_role("combobox", name="Stage").click()
        page.get_by_role("option", name="vgtu-piezo").click()
        page.locator(".issue.error", has_text="Stroke x 60.8 µm, 100 µm needed").wait_for()
        page.get_by_role("combobox", name="Stage").click()
        page.get_by_role("option", name="vgtu-mechanical").click()
        turned(page, 1)
        # the live chart has every sample; a scale off towards -0.6 rad is read with the error
        # e / R sin(theta + 0.6), by the head at 0
        page.wait_for_function("document.querySelector('.live-chart').live.points.count === 720")
        page.wait_for_function("document.querySelector('.live-chart').live.mode === 'polar'")
        largest = page.locator(".live-chart").evaluate(_FARTHEST)
        assert largest == pytest.approx(90.0 - math.degrees(0.6), abs=6.0)
        look.require_sound("centring-records")
        page.get_by_role("tab", name="Moves").click()
        page.get_by_role("cell", name="−67.4 deg").wait_for()
        turned(page, 2)
        turned(page, 3)
        page.get_by_role("button", name="To the moves").click()
        page.locator(".issue.good", has_text="The scale is centred").wait_for()
        # a phone shows it too
        page.set_viewport_size({"width": 390, "height": 844})
        assert look.overflow() <= 0
        look.require_sound("centring-moves")
        page.reload()
        page.locator(".issue.good").wait_for()
        page.get_by_role("tab", name="Certificate").click()
        page.get_by_label("Laboratory").fill("Angle laboratory")
        page.get_by_role("button", name="Write the certificate").click()
        page.get_by_role("link", name="Open in a new tab").wait_for()
        with page.context.expect_page() as opening:
            page.get_by_role("link", name="Open in a new tab").click()
        certificate = opening.value
        certificate.get_by_role("heading", name="Calibration certificate").wait_for()
        assert "Angle laboratory" in certificate.locator("main").inner_text()
        certificate.close()
        page.get_by_role("tab", name="Records").click()
        with page.expect_download() as waiting:
            page.get_by_role("button", name="Results (JSON)").click()
        found = json.loads(Path(waiting.value.path()).read_text())
        assert found["setups"][-1]["eccentricity"]["interval"][1] < 0.1e-6
        # records of one's own, of which the first is none
        page.get_by_role("combobox", name="Source of records").click()
        page.get_by_role("option", name="Records of the heads").click()
        files = page.locator("input[type=file]")
        (tmp_path / "none.csv").write_text("h1\n1\n2\n3\n")
        files.set_input_files(tmp_path / "none.csv")
        page.get_by_role("alert").filter(has_text="1 column").wait_for()
        (own,) = (p for p in (tmp_path / "files" / "centring").glob("*/turn-1.csv"))
        files.set_input_files(own)
        page.locator(".key-figure", has_text="Eccentricity").wait_for()
        page.get_by_role("combobox", name="Source of records").click()
        page.get_by_role("option", name="Readings of a gauge").click()
        page.get_by_label("Readings over one turn").fill("22 20 14 6 -2 -5 -6 -3 2 9 16 20")
        page.get_by_role("button", name="Use the readings").click()
        page.locator(".key-figure", has_text="Eccentricity").wait_for()
        assert not look.complaints, look.complaints
