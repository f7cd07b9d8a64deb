"""What was found in the view Explore: while it is computed, and afterwards."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import ui

from flexstage.quantities.quantity import number
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import TOLERANCE, Optimum, SearchStep
from flexstage.studies.explore.optimise.problem import Problem
from flexstage.studies.explore.requests import OptimiseRequest, SweepRequest, ToleranceRequest
from flexstage.studies.explore.sweep import Sweep
from flexstage.web.design.state import DesignState
from flexstage.web.explore import charts, points
from flexstage.web.explore.charts import Chart, LotChart
from flexstage.web.explore.downloads import show_command, show_downloads
from flexstage.web.explore.points import (
    FOCUS,
    PRESSED,
    ROWS,
    PointTable,
    SearchedFront,
    row_name,
    rows_html,
)
from flexstage.web.explore.state import KINDS, Run
from flexstage.web.explore.work import BEFORE_AFTER
from flexstage.web.figures import chart, picture, show_table
from flexstage.web.page import (
    Page,
    PanelHeading,
    choice,
    div,
    in_page_words,
    remark,
    show_job,
)
from flexstage.web.pictures import chart_figure


class Results:
    """What one run found, in a page.

    Parameters
    ----------
    page, run
        The page, and the run.
    """

    def __init__(self, page: Page, run: Run) -> None:
        self._page, self._run = page, run
        self._seen = -1
        self._plot: ui.plotly | None = None
        self._lot: LotChart | None = None
        self._table: PointTable | None = None
        self._question = run.question
        self._front: SearchedFront | None = None
        if isinstance(run.question, Problem) and len(run.question.goals) > 1:
            self._front = SearchedFront(run.question)

    def build(self) -> None:
        """Make it."""
        run = self._run
        with ui.row().classes("items-center heading"):
            PanelHeading(f"{_kind(run)} of {run.variant.name}")
            self._said = ui.label().classes("muted small").props('role="status"')
        if not run.job.is_over:
            show_job(self._page, run.job)
            self._page.watch(run.job, lambda _: self._over())
        self._body = ui.column().classes("full-width results")
        self._all()
        self._timer = ui.timer(0.4, self._look, active=not run.job.is_over)

    def _look(self) -> None:
        """Show what was handed over since the last look."""
        job = self._run.job
        if job.is_over:
            self._timer.deactivate()
        elif len(job.found) != self._seen:
            self._follow() if self._lot is None else self._lot.show()
            self._seen = len(job.found)

    def _over(self) -> None:
        if self._run.job.state == "done":
            self._run.picked = None  # the rows of the result are others
        self._all()

    def _all(self) -> None:
        """Show all anew."""
        run, job = self._run, self._run.job
        self._plot = None
        self._body.clear()
        with self._body:
            if job.state == "failed":
                ui.label(in_page_words(job.error)).classes("issue error").props('role="alert"')
            elif job.state == "cancelled":
                ui.label(_cancelled(run)).classes("issue")
            self._points()
            if job.state == "done":
                self._done()
            show_command(run)

    # points: chart, what was picked, table

    def _points(self) -> None:
        if isinstance(self._run.request, ToleranceRequest) and self._run.job.state != "done":
            self._lot = LotChart(self._run, self._page.preferences)
        if self._question is None:
            return
        self._controls = ui.row().classes("items-center controls")
        self._chart_box = div("full-width")
        self._picked_box = div("full-width").props('aria-live="polite"')
        self._table_html = ui.html("", sanitize=False).classes("tables points")
        self._table_html.on("click", self._pressed, js_handler=PRESSED)
        self._follow()

    def _follow(self) -> None:
        """Show the points that are known now."""
        run = self._run
        before = self._table
        self._table = table = self._known()
        if table is None:
            return
        self._said.text = _so_far(run, table)
        if self._plot is None:
            self._show_controls(table)
        self._show_chart(table)
        self._show_table(table)
        if before is None or run.job.is_over or self._is_way:
            self._show_picked(table)

    def _known(self) -> PointTable | None:
        job, units = self._run.job, self._page.preferences
        result = job.result.result if job.state == "done" else None
        match result:
            case Sweep():
                return points.of_sweep(result, units)
            case Front():
                return points.of_front(result, units)
            case Optimum():
                return points.of_optimum(result, units)
        if self._front is not None:
            return self._front.table(job.found, units)
        if isinstance(self._question, Problem):
            return points.of_steps(self._question, job.found, units)
        assert self._question is not None
        return points.of_batches(self._question, job.found, units)

    def _show_controls(self, table: PointTable) -> None:
        run = self._run
        self._controls.clear()
        if self._is_way:
            return
        kinds = charts.kinds(table)
        run.chart = run.chart if run.chart in kinds else kinds[0]
        for name, usual in zip(("across", "up"), _usual_axes(table), strict=True):
            if table.column(getattr(run, name)) is None:
                setattr(run, name, usual)
        headings = {c.name: c.heading for c in table.columns}
        outcome = {c.name: c.heading for c in table.outcome}
        with self._controls:
            if len(kinds) > 1:
                ui.toggle(list(kinds), value=run.chart, on_change=self._choose("chart")).props(
                    "dense no-caps"
                )
            if run.chart == charts.SCATTER:
                choice(headings, run.across, "Across", self._choose("across"))
            label = {charts.MAP: "Figure", charts.LINES: "Colour by"}.get(run.chart, "Upwards")
            several = headings if run.chart == charts.SCATTER else outcome
            value = run.up if run.up in several else next(iter(outcome))
            run.up = value
            choice(several, value, label, self._choose("up"))

    def _choose(self, name: str) -> Callable[[Any], None]:
        def chosen(event: Any) -> None:
            if event.value and self._table is not None:
                setattr(self._run, name, event.value)
                if name == "chart":
                    self._show_controls(self._table)
                self._show_chart(self._table)

        return chosen

    @property
    def _is_way(self) -> bool:
        """Whether the chart is the way of a search to one goal."""
        job = self._run.job
        if job.state == "done":
            return isinstance(job.result.result, Optimum)
        return isinstance(self._question, Problem) and self._front is None

    def _drawn(self, table: PointTable) -> Chart:
        run = self._run
        if self._is_way:
            assert isinstance(self._question, Problem)
            done = run.job.state == "done"
            steps = (each for each in run.job.found if isinstance(each, SearchStep))
            trace = run.job.result.result.history if done else [step.entry for step in steps]
            way = points.way_columns(self._question, trace, self._page.preferences)
            return charts.draw_way(way, trace)
        across = table.varied[0] if run.chart == charts.CURVE else table.column(run.across)
        up = table.column(run.up)
        assert across is not None
        assert up is not None
        return charts.draw(table, run.chart, across, up, run.picked)

    def _show_chart(self, table: PointTable) -> None:
        if not table.shown.size:
            return
        data, layout = self._drawn(table)
        if self._plot is None:
            says = f"{_kind(self._run)}: {layout['yaxis']['title']['text']} over "
            says += f"{layout['xaxis']['title']['text']}; the table below has the same numbers"
            self._chart_box.clear()
            with self._chart_box:
                self._plot = chart(data, layout, says).classes("tall")
            self._plot.on("plotly_click", self._clicked, js_handler=_CLICKED)
        else:
            self._plot.update_figure(chart_figure(data, layout))

    def _clicked(self, event: Any) -> None:
        done = self._run.job.state == "done"
        if self._table is not None and not (done and self._is_way):
            self._pick(int(event.args))

    def _pressed(self, event: Any) -> None:
        """Sort, turn the page, or pick, by what was pressed in the table."""
        run, table = self._run, self._table
        what, _, value = str(event.args).partition(":")
        if table is None:
            return
        if what == "pick" and value.isdecimal():
            self._pick(int(value))
        elif what == "sort":
            run.descending = run.sort == value and not run.descending
            run.sort, run.page = value, 0
        elif what == "page" and value.isdecimal():
            run.page = int(value)
        self._show_table(table)
        ui.run_javascript(FOCUS.format(pressed=json.dumps(f"{what}:{value}")))

    def _pick(self, row: int) -> None:
        table = self._table
        if table is None or row not in table.shown:
            return
        self._run.picked = row
        self._show_picked(table)
        self._show_table(table)
        if not self._is_way:
            self._show_chart(table)

    def _show_picked(self, table: PointTable) -> None:
        run = self._run
        self._picked_box.clear()
        row = run.picked
        if row is None and self._is_way:
            row = self._best(table)
        if row is None or row >= len(table.points):
            if table.shown.size:
                with self._picked_box:
                    remark("Click a point, or its number in the table, to pick it.")
            return
        told = [f"{c.heading}: {number(float(c.values[row]))}" for c in table.varied[:4]]
        more = len(table.varied) - len(told)
        told += [f"and {more} more"] if more > 0 else []
        with self._picked_box, ui.row().classes("picked items-center"):
            ui.label(f"{row_name(table, row)}. {'; '.join(told)}")
            ui.button("Open in Design", on_click=lambda: self._open(table.values(row)))

    def _best(self, table: PointTable) -> int:
        """Return the best row: that of the result, or the step that is best so far."""
        if table.labels:
            return len(table.points) - 1
        assert isinstance(self._question, Problem)
        _, goal, missed = (column.values for column in table.outcome)
        sign = self._question.goals[0].sign if self._question.goals else 1.0
        return int(np.lexsort((sign * goal, np.maximum(missed, 100.0 * TOLERANCE)))[0])

    def _open(self, picked: dict[str, float]) -> None:
        with self._page.sentences():
            variant = self._run.values(picked)
            variant.stage()
            state = self._page.session.state(DesignState)
            state.commit()
            state.show(variant)
            state.commit()
            ui.navigate.to("/design")

    def _show_table(self, table: PointTable) -> None:
        run = self._run
        if self._is_way and run.job.state == "done":
            return  # the table of its parameters says more
        order = table.ordered(run.sort, descending=run.descending)
        pages = max(1, -(-len(order) // ROWS))
        run.page = min(run.page, pages - 1)
        rows = order[run.page * ROWS : (run.page + 1) * ROWS]
        self._table_html.content = rows_html(table, run, rows, pages) if order else ""

    # when it is done

    def _done(self) -> None:
        run, found = self._run, self._run.job.result
        pictures = list(found.pictures)
        if self._table is None and pictures:
            with div("picture main"):
                picture(pictures.pop(0)[1])
        for shown in found.tables:
            show_table(shown)
        show_downloads(run, found.files)
        for title, svg in pictures:
            is_open = isinstance(run.request, OptimiseRequest) and title == BEFORE_AFTER
            with ui.expansion(title, value=is_open).classes("group full-width"):
                ui.html(svg, sanitize=False).classes("picture main")
        with ui.expansion("What to know of it").classes("group full-width"), ui.element("ul"):
            for note in found.notes:
                with ui.element("li"):
                    ui.label(in_page_words(note))


_CLICKED = "(event) => { const at = event.points[0]?.customdata; if (at != null) emit(at); }"


def _kind(run: Run) -> str:
    return KINDS[run.request.job()]


def _cancelled(run: Run) -> str:
    if isinstance(run.request, OptimiseRequest):
        return "Cancelled: what was found until then is below."
    return "Cancelled: what was found until then is kept, and the same run goes on from there."


def _so_far(run: Run, table: PointTable) -> str:
    """Say how far it has come."""
    if isinstance(run.request, SweepRequest):
        return f"{table.computed} of {len(table.points)} points"
    if run.job.state == "done":
        return ""
    return f"{len(table.points)} steps" if not table.labels else f"{table.computed} stages"


def _usual_axes(table: PointTable) -> tuple[str, str]:
    """Return which columns are shown at first: across and upwards."""
    first, *others = table.columns
    if table.labels:  # goals stand first
        across = next((c for c in others if c.varies), others[0])
        return across.name, first.name
    frequencies = (c.name for c in table.outcome if c.name.startswith("natural_frequency"))
    return first.name, next(frequencies, table.outcome[0].name)
