"""Bench: connect to a stage, see what it does at every moment, move it, and record it."""

from typing import Any

from nicegui import ui

from flexstage.web.bench.connection import ConnectionBar
from flexstage.web.bench.outcome import RunList, show_outcome
from flexstage.web.bench.readouts import AxisCard
from flexstage.web.bench.run_forms import PlanForm, RecordForm, RunForm, WaveformForm
from flexstage.web.bench.runs import RunOutcome
from flexstage.web.bench.state import BenchForms, bench_of
from flexstage.web.jobs import BackgroundJob
from flexstage.web.live.chart import LiveChart
from flexstage.web.page import Page, PanelHeading, div, panel, show_job

_TABS: dict[str, tuple[str, type[RunForm]]] = {
    "Waveform": ("show_chart", WaveformForm),
    "Record": ("fiber_manual_record", RecordForm),
    "Plan": ("checklist", PlanForm),
    "Runs": ("history", RunList),
}


def build(page: Page) -> None:
    """Make the view."""
    BenchView(page).build()


class BenchView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._bench = page, bench_of(page)
        self._forms = page.session.state(BenchForms)
        self._cards: dict[str, AxisCard] = {}
        self._shown: Any = None
        self._form: Any = None
        self._job: BackgroundJob | None = None

    def build(self) -> None:
        """Make the view."""
        with div("stack") as self._whole:
            self._bar = ConnectionBar(self._page)
            self._trouble = ui.label().classes("issue error").props('role="alert"')
            self._area = div("columns bench")
        self._look()
        ui.timer(0.1, self._look)

    def _look(self) -> None:
        """Follow the bench: its link, its control, its readings, its runs."""
        bench, me = self._bench, self._page.session.id
        if self._page.client.has_socket_connection:
            bench.control.seen(me)
        control = bench.control
        present = (bench.history, control.name, control.asker, control.holds(me), control.free)
        if present != self._shown:
            before, self._shown = self._shown, present
            self._bar.build()
            if before is None or before[0] is not bench.history:
                self._anew()
        again = "The link is lost, and opened again when the instrument answers: "
        self._trouble.text = f"{again if bench.lost else ''}{bench.trouble}"
        self._trouble.visible = bool(bench.trouble)
        for name, card in self._cards.items():
            card.show(bench.readings.get(name), drives=control.holds(me), stale=bench.lost)
        if self._form is not None:
            self._form.look()
        self._follow_job()

    def _anew(self) -> None:
        """Show the stage that is connected now, or what there is to do where none is."""
        bench = self._bench
        self._area.clear()
        self._cards.clear()
        self._form = self._job = None
        if bench.device is None or bench.history is None:
            self._whole.classes(add="apart")
            with self._area, panel():
                PanelHeading("Runs")
                self._form = RunList(self._page, bench, self._show)
                self._form.build()
            with self._area:
                self._make_result()
            return
        self._whole.classes(remove="apart")
        with self._area:
            with div("stack"):
                self._cards |= {a: AxisCard(self._page, bench, a) for a in bench.device.axes}
                with panel():
                    self._runs()
            with div("stack"):
                with panel():
                    LiveChart(
                        self._page,
                        bench.history,
                        says="Position and voltage of every axis as they are read",
                    )
                self._make_result()

    def _make_result(self) -> None:
        self._result = panel().props('aria-live="polite"')
        self._result.visible = False

    def _show(self, outcome: RunOutcome) -> None:
        self._result.clear()
        self._result.visible = True
        with self._result:
            show_outcome(self._page, outcome)

    def _runs(self) -> None:
        with ui.tabs(on_change=self._open).props("dense no-caps align=left") as tabs:
            for name, (icon, _) in _TABS.items():
                ui.tab(name, icon=icon)
        self._doing = div("full-width doing")
        self._fields = div("run-form")
        tabs.value = self._forms.tab

    def _open(self, event: Any) -> None:
        self._forms.tab = event.value
        self._fields.clear()
        with self._fields, self._page.sentences():
            self._form = _TABS[event.value][1](self._page, self._bench, self._show)
            self._form.build()

    def _follow_job(self) -> None:
        """Show the run that goes on to everybody, and what it gave when it has ended."""
        job = self._bench.job
        if job is self._job or job is None or not self._cards:
            return
        self._job = job
        if job.is_over:
            self._ended(job)
            return
        self._doing.clear()
        with self._doing:
            show_job(self._page, job)
            self._page.watch(job, self._ended)

    def _ended(self, job: BackgroundJob) -> None:
        if job.state == "done":
            self._show(job.result)
            return
        self._result.clear()
        self._result.visible = True
        with self._result:
            PanelHeading(f"{job.name}: stopped" if job.state == "cancelled" else job.name)
            ui.label(
                job.error or "The stage was stopped; what was recorded until then is kept: see Runs"
            ).classes("issue" if job.state == "cancelled" else "issue error")
