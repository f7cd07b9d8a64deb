"""The front panel without a browser: its shell, jobs, uploads and what it keeps."""

import asyncio
import gc
import os
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from nicegui import ui

from flexstage.base.errors import ModelError
from flexstage.stage.designs import StageTemplate
from flexstage.web.bench.state import BenchForms
from flexstage.web.design.state import DesignState
from flexstage.web.figures import chart_figure
from flexstage.web.jobs import EmergencyStop, Jobs
from flexstage.web.page import pages_of
from flexstage.web.sessions import Access, History, Preferences
from flexstage.web.uploads import plain_name, require_ending
from flexstage.web.views import VIEWS
from tests.panel import simulated, until
from tests.panel_work import counted, ended_from_outside, refused


@pytest.fixture
def jobs() -> Any:
    made = Jobs(at_once=1)
    yield made
    made.close()


def test_the_shell_opens_every_view_by_its_address(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        for view in VIEWS:
            await user.open(view.path)
            for each in VIEWS:
                await user.should_see(each.name)
        assert panel.options.folder == tmp_path

    simulated(tmp_path, look)


def test_units_chosen_once_are_kept_over_a_reload(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/")
        (angles,) = (s for s in user.find(ui.select).elements if s.props.get("label") == "Angles")
        angles.value = "arcsec"
        await user.open("/")
        kept = [s.value for s in user.find(ui.select).elements if s.props.get("label") == "Angles"]
        assert kept == ["arcsec"]

    simulated(tmp_path, look)


def test_stop_is_there_on_every_view_while_a_stage_is_connected(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/")
        await user.should_not_see("STOP")
        stopped: list[str] = []
        panel.emergency_stop.add("first", lambda: 1 / 0)
        panel.emergency_stop.add("second", lambda: stopped.append("second"))
        await user.open(VIEWS[-1].path)
        await user.should_see("STOP")
        user.find("STOP").click()
        assert stopped == ["second"]  # though the first one failed

    # the failure of the first is logged as an error
    simulated(tmp_path, look)


def test_long_work_is_in_the_bar_also_after_a_reload(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/")
        await user.should_not_see(kind=ui.badge)
        (session,) = panel.access._sessions.values()
        job = panel.jobs.start_thread("long", counted, 1000, 0.02, owner=session.id)
        job.began -= 10.0
        panel.jobs.start_thread("of another", counted, 1000, 0.02, owner="another").began -= 10.0
        await user.open("/")
        await user.should_see("1", kind=ui.badge, retries=10)
        job.cancel()
        assert job.wait(5.0)

    simulated(tmp_path, look)


def test_a_job_tells_how_far_it_is_and_its_process_does_the_next(jobs: Jobs) -> None:
    first = jobs.start("count", counted, 3, 0.15, owner="me")
    seen = set()
    while not first.wait(0.02):
        seen.add((first.activity, round(first.share, 2)))
    assert first.state == "done"
    assert ("counting", 0.33) in seen
    assert first.result != os.getpid()
    second = jobs.start("count", counted, 1)
    assert second.wait(20.0)
    assert second.result == first.result
    assert jobs.of("me") == [first]


def test_a_job_is_cancelled_while_it_works_and_while_it_waits(jobs: Jobs) -> None:
    long = jobs.start("long", counted, 1000, 0.1)
    waiting = jobs.start("waiting", counted, 1000, 0.1)
    while not long.activity:
        time.sleep(0.02)
    for job in (waiting, long):
        job.cancel()
        assert job.wait(20.0)
        assert job.state == "cancelled"


def test_a_job_that_fails_says_why_in_a_sentence(jobs: Jobs) -> None:
    failed = jobs.start("refused", refused, 0.3)
    assert failed.wait(20.0)
    assert (failed.state, failed.error) == ("failed", "there is no such value, got 0.3")
    lost = jobs.start("lost", ended_from_outside)
    assert lost.wait(20.0)
    assert lost.state == "failed"
    assert "its process was killed" in lost.error


def test_a_job_that_reports_without_a_pause_is_cancelled(jobs: Jobs) -> None:
    job = jobs.start("without end", counted, 10**9)
    until(lambda: job.share > 0.0)
    job.cancel()
    assert job.wait(300.0)
    assert job.state == "cancelled"


def test_work_in_a_thread_is_cancelled_where_it_says_how_far_it_is(jobs: Jobs) -> None:
    job = jobs.start_thread("wait", counted, 1000, 0.02)
    while not job.activity:
        time.sleep(0.01)
    job.cancel()
    assert job.wait(5.0)
    assert job.state == "cancelled"
    done = jobs.start_thread("wait", counted, 2)
    assert done.wait(5.0)
    assert done.result == os.getpid()


def test_undo_goes_back_and_redo_forth() -> None:
    history = History("a")
    for state in ("b", "b", "c"):
        history.put(state)
    history.undo()
    assert (history.now, history.can_undo, history.can_redo) == ("b", True, True)
    history.undo()
    assert (history.now, history.can_undo) == ("a", False)
    history.redo()
    history.put("d")
    assert (history.now, history.can_redo) == ("d", False)


def test_what_is_shown_is_in_the_unit_that_was_chosen() -> None:
    chosen = Preferences(length="mm", angle="arcsec")
    assert chosen.displayed("output_displacement").text(64.6e-6) == "0.06460"
    # 1 arcsec = pi / (180 * 3600) rad
    assert chosen.displayed("parasitic_rotation").text(4.8481368e-6) == "1.000"
    assert chosen.displayed("natural_frequency_hz").heading == "Natural frequency [Hz]"
    assert Preferences().displayed("smallest_neck").shown_unit == "mm"


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("../../../etc/passwd", "passwd"),
        ("..\\..\\boot.yaml", "boot.yaml"),
        (".bashrc", "bashrc"),
        ("stage\0.yaml", "stage_.yaml"),
        ("…/..", "file"),
        ("a" * 300 + ".dxf", "a" * 96 + ".dxf"),
    ],
)
def test_a_given_file_has_a_plain_name(given: str, name: str) -> None:
    assert plain_name(given) == name


def test_a_file_of_another_kind_is_refused() -> None:
    require_ending("Stage.DXF", (".dxf", ".step"))
    with pytest.raises(ModelError, match=r"'run\.exe' is not of an accepted type: \.dxf, \.step"):
        require_ending("run.exe", (".dxf", ".step"))


def test_a_chart_whose_axis_says_nothing_is_refused() -> None:
    time = {"title": {"text": "t [s]"}}
    titled = {"xaxis": time, "yaxis": {"title": {"text": "x [µm]"}}}
    assert chart_figure([], titled)["layout"]["xaxis"] == time
    for untitled in ({}, {"title": "x [µm]"}):
        with pytest.raises(ModelError, match="yaxis of a chart has no title"):
            chart_figure([], {"xaxis": time, "yaxis": untitled})
    with pytest.raises(ModelError, match="yaxis2 of a chart"):
        chart_figure([], titled | {"yaxis2": {"title": {"text": ""}}})


def test_a_stage_that_is_gone_is_not_stopped() -> None:
    stops, stopped = EmergencyStop(), []
    stops.add("twin", lambda: stopped.append(1))
    stops.remove("twin")
    stops.stop()
    assert not stops.active
    assert not stopped


def test_a_session_ends_a_day_after_it_was_last_used_and_by_logging_out(tmp_path: Path) -> None:
    now = [1000.0]
    access = Access(clock=lambda: now[0])
    first, second = access.open_session(), access.open_session()
    kept = access.session(first)
    assert kept is not None
    now[0] += 80000.0
    assert access.session(first) is kept
    now[0] += 80000.0
    # the first was used less than a day ago, the second was not
    assert access.session(second) is None
    assert access.sessions() == [(kept, 80000.0)]
    access.end(kept)
    assert access.session(first) is None

    async def look(user: Any, panel: Any) -> None:
        await user.open("/bench")
        gone = user.client
        user.find("Log out").click()
        assert (await user.http_client.get("/bench")).status_code == 401
        await collected(lambda: gone.is_deleted)
        with pytest.raises(AssertionError, match="401"):
            await user.open("/")

    simulated(tmp_path, look)


def test_what_a_browser_left_is_opened_again_in_another(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        await user.open("/design")
        (left,) = panel.access._sessions.values()
        left.state(BenchForms).operator = "Ann"
        left.state(DesignState).open(StageTemplate.of("cartwheel"))
        user.http_client.cookies.clear()
        await user.http_client.get("/", params={"token": panel.access.new_token()})
        await user.open("/")
        await user.should_see("Operate a stage")
        # as long as it is open there, nobody else takes it
        await user.should_not_see("Reopen")
        for client in pages_of(left):
            client.tab_id = None
        await user.open("/")
        await user.should_not_see("Reopen")
        left.last_seen -= 60.0
        await user.open("/")
        await user.should_see("Ann: cartwheel; last seen 2 min ago")
        user.find("Reopen").click()
        await user.open("/design")
        await user.should_see("cartwheel", retries=20)
        assert {*panel.access._sessions.values()} == {left}

    simulated(tmp_path, look)


async def opened(user: Any, path: str) -> Any:
    """Open a page in a task of its own, whose end lets go of what the test itself would hold."""

    async def open_() -> None:
        await user.open(path)

    await asyncio.create_task(open_())
    return user.client


def of_views() -> Iterator[str]:
    """Name the views that there are."""
    known = {f"flexstage.web.views.{view.module}" for view in VIEWS}
    for each in gc.get_objects():
        kind = type(each)
        if str(kind.__module__) in known and kind.__name__.endswith("View"):
            yield kind.__name__


async def collected(gone: Callable[[], bool]) -> None:
    """Wait until something is gone: what a page last sent ends within a second."""
    end = time.monotonic() + 300.0
    while not gone():
        assert time.monotonic() < end, "it stays"
        await asyncio.sleep(0.02)
        gc.collect()


def test_nothing_of_a_view_stays_when_its_browser_is_gone(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        gone: dict[tuple[str, float], weakref.ref[Any]] = {}
        for view in VIEWS:
            client = await opened(user, view.path)
            gone[view.path, 0.0] = weakref.ref(client)
            client.delete()
        clients = {view.path: await opened(user, view.path) for view in VIEWS}
        await asyncio.sleep(0.3)  # while they still read and draw
        for path, client in clients.items():
            gone[path, 0.3] = weakref.ref(client)
            client.delete()
        clients.clear()
        user.client = client = None
        await collected(lambda: not [at for at, client in gone.items() if client() is not None])
        assert [*of_views()] == []
        await user.open("/report")  # the library ends in a page

    simulated(tmp_path, look)


def test_nothing_of_a_view_stays_when_another_is_opened_in_the_same_page(tmp_path: Path) -> None:
    async def look(user: Any, panel: Any) -> None:
        client = await opened(user, "/report")
        for view in (*VIEWS, VIEWS[-1]):
            with client:
                await client.sub_pages_router._handle_navigate(view.path)
            await asyncio.sleep(0.05)
        await collected(lambda: [*of_views()] == ["ReportView"])

    simulated(tmp_path, look)
