"""Results of a run in the view Explore, while it is running and afterwards."""

import asyncio
import io
import json
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from flexstage.files.request import Request, command_line
from flexstage.quantities.quantity import number
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import TOLERANCE, Optimum, SearchStep
from flexstage.studies.explore.optimise.problem import Problem
from flexstage.studies.explore.requests import OptimiseRequest, SweepRequest, ToleranceRequest
from flexstage.studies.explore.sweep import Sweep
from flexstage.web.design.state import DesignState
from flexstage.web.explore import charts, samples_table
from flexstage.web.explore.charts import Chart, ToleranceChart
from flexstage.web.explore.samples_table import (
    FOCUS,
    PRESSED,
    ROWS,
    SamplesTable,
    SearchedFront,
    row_name,
    rows_html,
)
from flexstage.web.explore.state import KINDS, ExploreRun
from flexstage.web.explore.work import BEFORE_AFTER
from flexstage.web.figures import chart, picture, show_table
from flexstage.web.page import (
    Page,
    PanelHeading,
    choice,
    display_text,
    div,
    quiet_button,
    remark,
    show_job,
)
from flexstage.web.pictures import chart_figure


class Results:
    """Results of one run in a page.

    Parameters
    ----------
    page, run
        The page and the run.
    """

    def __init__(self, page: Page, run: ExploreRun) -> None:
        self._page, self._run = page, run
        self._shown_count = -1
        self._plot: ui.plotly | None = None
        self._histogram: ToleranceChart | None = None
        self._table: SamplesTable | None = None
        self._definition = run.definition
        self._front: SearchedFront | None = None
        if isinstance(run.definition, Problem) and len(run.definition.goals) > 1:
            self._front = SearchedFront(run.definition)

    def build(self) -> None:
        """Build the elements."""
        run = self._run
        with ui.row().classes("items-center heading"):
            PanelHeading(f"{_kind(run)} of {run.variant.name}")
            self._status = ui.label().classes("muted small").props('role="status"')
        if not run.job.is_over:
            show_job(self._page, run.job)
            self._page.watch(run.job, lambda _: self._finish())
        self._body = ui.column().classes("full-width results")
        self._rebuild()
        self._timer = ui.timer(0.4, self._look, active=not run.job.is_over)

    def _look(self) -> None:
        """Show new partial results."""
        job = self._run.job
        if job.is_over:
            self._timer.deactivate()
        elif len(job.partial_results) != self._shown_count:
            self._follow() if self._histogram is None else self._histogram.show()
            self._shown_count = len(job.partial_results)

    def _finish(self) -> None:
        if self._run.job.state == "done":
            self._run.selected_row = None  # the result has other rows
        self._rebuild()

    def _rebuild(self) -> None:
        """Rebuild all results."""
        run, job = self._run, self._run.job
        self._plot = None
        self._body.clear()
        with self._body:
            if job.state == "failed":
                ui.label(display_text(job.error)).classes("issue error").props('role="alert"')
            elif job.state == "cancelled":
                ui.label(_cancelled(run)).classes("issue")
            self._points()
            if job.state == "done":
                self._show_finished()
            show_command(run)

    # samples: chart, selected sample, table

    def _points(self) -> None:
        if isinstance(self._run.request, ToleranceRequest) and self._run.job.state != "done":
            self._histogram = ToleranceChart(self._run, self._page.preferences)
        if self._definition is None:
            return
        self._controls = ui.row().classes("items-center controls")
        self._chart_box = div("full-width")
        self._selected_box = div("full-width").props('aria-live="polite"')
        self._table_html = ui.html("", sanitize=False).classes("tables points")
        self._table_html.on("click", self._pressed, js_handler=PRESSED)
        self._follow()

    def _follow(self) -> None:
        """Show the present samples."""
        run = self._run
        previous = self._table
        self._table = table = self._present_table()
        if table is None:
            return
        self._status.text = _progress(run, table)
        if self._plot is None:
            self._show_controls(table)
        self._show_chart(table)
        self._show_table(table)
        if previous is None or run.job.is_over or self._is_history:
            self._show_selected(table)

    def _present_table(self) -> SamplesTable | None:
        job, units = self._run.job, self._page.preferences
        result = job.result.result if job.state == "done" else None
        match result:
            case Sweep():
                return samples_table.of_sweep(result, units)
            case Front():
                return samples_table.of_front(result, units)
            case Optimum():
                return samples_table.of_optimum(result, units)
        if self._front is not None:
            return self._front.table(job.partial_results, units)
        if isinstance(self._definition, Problem):
            return samples_table.of_steps(self._definition, job.partial_results, units)
        assert self._definition is not None
        return samples_table.of_batches(self._definition, job.partial_results, units)

    def _show_controls(self, table: SamplesTable) -> None:
        run = self._run
        self._controls.clear()
        if self._is_history:
            return
        kinds = charts.kinds(table)
        run.chart = run.chart if run.chart in kinds else kinds[0]
        for name, default in zip(("x_column", "y_column"), _default_axes(table), strict=True):
            if table.column(getattr(run, name)) is None:
                setattr(run, name, default)
        headings = {c.name: c.heading for c in table.columns}
        outcome = {c.name: c.heading for c in table.outcome}
        with self._controls:
            if len(kinds) > 1:
                ui.toggle(list(kinds), value=run.chart, on_change=self._choose("chart")).props(
                    "dense no-caps"
                )
            if run.chart == charts.SCATTER:
                choice(headings, run.x_column, "X axis", self._choose("x_column"))
            label = {charts.MAP: "Figure", charts.LINES: "Colour by"}.get(run.chart, "Y axis")
            options = headings if run.chart == charts.SCATTER else outcome
            value = run.y_column if run.y_column in options else next(iter(outcome))
            run.y_column = value
            choice(options, value, label, self._choose("y_column"))

    def _choose(self, name: str) -> Callable[[Any], None]:
        def on_change(event: Any) -> None:
            if event.value and self._table is not None:
                setattr(self._run, name, event.value)
                if name == "chart":
                    self._show_controls(self._table)
                self._show_chart(self._table)

        return on_change

    @property
    def _is_history(self) -> bool:
        """The chart is the history of a search for one goal."""
        job = self._run.job
        if job.state == "done":
            return isinstance(job.result.result, Optimum)
        return isinstance(self._definition, Problem) and self._front is None

    def _chart_data(self, table: SamplesTable) -> Chart:
        run = self._run
        if self._is_history:
            assert isinstance(self._definition, Problem)
            is_done = run.job.state == "done"
            steps = (each for each in run.job.partial_results if isinstance(each, SearchStep))
            trace = run.job.result.result.history if is_done else [step.entry for step in steps]
            history = samples_table.history_columns(self._definition, trace, self._page.preferences)
            return charts.draw_history(history, trace)
        x_column = table.varied[0] if run.chart == charts.CURVE else table.column(run.x_column)
        y_column = table.column(run.y_column)
        assert x_column is not None
        assert y_column is not None
        return charts.draw(table, run.chart, x_column, y_column, run.selected_row)

    def _show_chart(self, table: SamplesTable) -> None:
        if not table.computed_rows.size:
            return
        data, layout = self._chart_data(table)
        if self._plot is None:
            alt_text = f"{_kind(self._run)}: {layout['yaxis']['title']['text']} over "
            alt_text += f"{layout['xaxis']['title']['text']}; the table below has the same values"
            self._chart_box.clear()
            with self._chart_box:
                self._plot = chart(data, layout, alt_text).classes("tall")
            self._plot.on("plotly_click", self._clicked, js_handler=_CLICKED)
        else:
            self._plot.update_figure(chart_figure(data, layout))

    def _clicked(self, event: Any) -> None:
        is_done = self._run.job.state == "done"
        if self._table is not None and not (is_done and self._is_history):
            self._select(int(event.args))

    def _pressed(self, event: Any) -> None:
        """Sort, change the page or select a row, by a button in the table."""
        run, table = self._run, self._table
        action, _, value = str(event.args).partition(":")
        if table is None:
            return
        if action == "select" and value.isdecimal():
            self._select(int(value))
        elif action == "sort":
            run.descending = run.sort_column == value and not run.descending
            run.sort_column, run.page = value, 0
        elif action == "page" and value.isdecimal():
            run.page = int(value)
        self._show_table(table)
        ui.run_javascript(FOCUS.format(pressed=json.dumps(f"{action}:{value}")))

    def _select(self, row: int) -> None:
        table = self._table
        if table is None or row not in table.computed_rows:
            return
        self._run.selected_row = row
        self._show_selected(table)
        self._show_table(table)
        if not self._is_history:
            self._show_chart(table)

    def _show_selected(self, table: SamplesTable) -> None:
        run = self._run
        self._selected_box.clear()
        row = run.selected_row
        if row is None and self._is_history:
            row = self._best(table)
        if row is None or row >= len(table.points):
            if table.computed_rows.size:
                with self._selected_box:
                    remark("Click a point, or its number in the table, to select it.")
            return
        parts = [f"{c.heading}: {number(float(c.values[row]))}" for c in table.varied[:4]]
        others = len(table.varied) - len(parts)
        parts += [f"and {others} more"] if others > 0 else []
        with self._selected_box, ui.row().classes("selected-sample items-center"):
            ui.label(f"{row_name(table, row)}. {'; '.join(parts)}")
            ui.button("Open in Design", on_click=lambda: self._open(table.values(row)))

    def _best(self, table: SamplesTable) -> int:
        """Return the best row: the result, or the best step so far."""
        if table.labels:
            return len(table.points) - 1
        assert isinstance(self._definition, Problem)
        _, goal, violation = (column.values for column in table.outcome)
        sign = self._definition.goals[0].sign if self._definition.goals else 1.0
        return int(np.lexsort((sign * goal, np.maximum(violation, 100.0 * TOLERANCE)))[0])

    def _open(self, parameters: dict[str, float]) -> None:
        with self._page.show_errors():
            variant = self._run.variant_at(parameters)
            variant.stage()
            state = self._page.session.state(DesignState)
            state.commit()
            state.show(variant)
            state.commit()
            ui.navigate.to("/design")

    def _show_table(self, table: SamplesTable) -> None:
        run = self._run
        if self._is_history and run.job.state == "done":
            return  # the table of parameters has more
        order = table.ordered(run.sort_column, descending=run.descending)
        pages = max(1, -(-len(order) // ROWS))
        run.page = min(run.page, pages - 1)
        rows = order[run.page * ROWS : (run.page + 1) * ROWS]
        self._table_html.content = rows_html(table, run, rows, pages) if order else ""

    # results of a finished job

    def _show_finished(self) -> None:
        run, outcome = self._run, self._run.job.result
        pictures = list(outcome.pictures)
        if self._table is None and pictures:
            with div("picture main"):
                picture(pictures.pop(0)[1])
        for table in outcome.tables:
            show_table(table)
        show_downloads(run, outcome.files)
        for title, svg in pictures:
            is_open = isinstance(run.request, OptimiseRequest) and title == BEFORE_AFTER
            with ui.expansion(title, value=is_open).classes("group full-width"):
                ui.html(svg, sanitize=False).classes("picture main")
        with ui.expansion("Notes").classes("group full-width"), ui.element("ul"):
            for note in outcome.notes:
                with ui.element("li"):
                    ui.label(display_text(note))


_CLICKED = "(event) => { const at = event.points[0]?.customdata; if (at != null) emit(at); }"


def _kind(run: ExploreRun) -> str:
    return KINDS[run.request.job()]


def _cancelled(run: ExploreRun) -> str:
    if isinstance(run.request, OptimiseRequest):
        return "Cancelled. The designs so far are below."
    return "Cancelled. The results so far are saved; start the same run again to resume it."


def _progress(run: ExploreRun, table: SamplesTable) -> str:
    """Return the progress of a run."""
    if isinstance(run.request, SweepRequest):
        return f"{table.computed} of {len(table.points)} points"
    if run.job.state == "done":
        return ""
    return f"{len(table.points)} steps" if not table.labels else f"{table.computed} designs"


def _default_axes(table: SamplesTable) -> tuple[str, str]:
    """Return the default columns of the x and y axes."""
    first, *others = table.columns
    if table.labels:  # goals come first
        x_column = next((c for c in others if c.varies), others[0])
        return x_column.name, first.name
    frequencies = (c.name for c in table.outcome if c.name.startswith("natural_frequency"))
    return first.name, next(frequencies, table.outcome[0].name)


def show_downloads(run: ExploreRun, files: tuple[Path, ...]) -> None:
    """Show a download button for each data file, and one for all."""
    with ui.row().classes("items-center downloads"):
        for path in _data_files(files):
            quiet_button(path.name, icon="download", on_click=_download(path)).props("dense")
        name = f"{run.folder.name}.zip"
        button = quiet_button(
            "all (ZIP)", icon="download", on_click=lambda: _download_all(files, name)
        )
        button.props("dense")


def show_command(run: ExploreRun) -> None:
    """Show the equivalent command line, with a button to copy it."""
    text = equivalent_command(run.summary.template, run.request)
    with div("command"):
        remark("Command line")
        ui.label(text).classes("code").props("tabindex=0")

        def copy() -> None:
            ui.clipboard.write(text)
            ui.notify("copied", type="positive")

        quiet_button(icon="content_copy", on_click=copy).props("dense").props["aria-label"] = (
            "Copy the command line"
        )


def equivalent_command(template: StageTemplate, request: Request) -> str:
    """Return the command line of a request for a stage with its changed parameters."""
    settings = (word for n, text in template.settings for word in ("--set", f"{n}={text}"))
    return command_line(request, template.source, *settings)


def _data_files(files: Iterable[Path]) -> list[Path]:
    order = (".csv", ".json", ".yaml", ".parquet", ".html")
    data = [path for path in files if path.suffix in order]
    return sorted(data, key=lambda path: order.index(path.suffix))


def _download(path: Path) -> Callable[[], Any]:
    async def download() -> None:
        ui.download.content(await asyncio.to_thread(path.read_bytes), path.name)

    return download


async def _download_all(files: Iterable[Path], name: str) -> None:
    def pack() -> bytes:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in files:
                archive.write(path, path.name)
        return content.getvalue()

    ui.download.content(await asyncio.to_thread(pack), name)
