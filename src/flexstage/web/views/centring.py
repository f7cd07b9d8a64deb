"""Centring: from a table and its stage to records, moves and a certificate of its scale."""

import asyncio
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.centring import ARCSEC
from flexstage.centring.requests import CertificateRequest
from flexstage.centring.table_file import TABLE_FILE
from flexstage.files.nodes import read_text
from flexstage.files.schema import field_texts
from flexstage.files.write import write_whole
from flexstage.quantities.quantity import number, value_and_uncertainty
from flexstage.quantities.table import Table, table
from flexstage.records import FORMATS
from flexstage.report.scale import (
    budget_table,
    needs_table,
    one_stage_table,
    settings_table,
    stages_table,
)
from flexstage.stage.designs import find_stage
from flexstage.studies.scale import displayed
from flexstage.web.bench.readouts import shown_number
from flexstage.web.bench.state import bench_of
from flexstage.web.centring.state import CentringState, Source
from flexstage.web.centring.work import (
    ANGLE,
    EXAMPLE,
    CentringResult,
    StudiedTable,
    axes_of,
    certify,
    evaluate_files,
    gauge_record,
    likely_columns,
    limits_of,
    move_to,
    noise_of,
    stage_position,
    study_table,
    turn_history,
    turn_table,
)
from flexstage.web.figures import figure, in_page, picture, sentence, show_lines, show_table
from flexstage.web.live_chart import LiveChart
from flexstage.web.live_history import POSITION
from flexstage.web.page import (
    Page,
    PanelHeading,
    Task,
    choice,
    display_text,
    div,
    panel,
    quiet_button,
    remark,
    show_error,
)
from flexstage.web.reports import WrittenReport
from flexstage.web.request_form import RequestForm
from flexstage.web.sessions import LENGTHS, Preferences
from flexstage.web.uploads import upload

_STEPS = {
    "table": ("1 Table", "description"),
    "stage": ("2 Stage", "rule"),
    "records": ("3 Records", "radar"),
    "moves": ("4 Moves", "open_with"),
    "certificate": ("5 Certificate", "fact_check"),
}
#: Sources of records, with their labels and instructions.
_SOURCES: dict[Source, tuple[str, str]] = {
    "simulated": (
        "Simulated table",
        "The described table turns, with its largest eccentricity, in simulation. It needs no "
        "hardware; its stage moves 3 % more than its model.",
    ),
    "records": (
        "Records of the heads",
        "Turn the table once or more with the stage at rest, and upload the record of the angle "
        "and the error of each head (reading − true angle).",
    ),
    "magnet": (
        "Records of a magnet on the axis",
        "Its error once per turn is not only eccentricity: trial moves find the centre.",
    ),
    "gauge": (
        "Readings of a gauge",
        "Turn the table once by hand, and read the gauge at the rim at equal angles.",
    ),
}
_UNITS = {"": "unit in the file", "deg": "deg", "rad": "rad", "arcsec": "arcsec", "turn": "turn"}
#: Files of a certificate, with the texts of their links.
_CERTIFICATE = {"report.html": "Save the page", "results.json": "Save the results (JSON)"}
_LEAST = 1e-15  # uncertainty that a reading has [m]
_NO_TURN = "Measure a turn in the step Records."
_YAML = (".yaml", ".yml")
#: Folder of uploaded files: their names may be those of the table and of measured turns.
_UPLOADS = "centring/uploads"
_ENDINGS = tuple(suffix for suffixes in FORMATS.values() for suffix in suffixes)
_METHODS = {
    "self": "differences of the heads (self)",
    "reference": "against the angle of the record (reference)",
    "equal-division": "mean of evenly spaced heads (equal-division)",
}


_KINDS = {"start": "start", "trial": "trial move", "move": "move"}


def with_uncertainty(value: float, uncertainty: float, factor: float) -> str:
    """Return a value with its standard uncertainty, in the unit of a factor from SI."""
    return display_text(" ± ".join(value_and_uncertainty(factor * value, factor * uncertainty)))


def position_text(at: tuple[float, float], preferences: Preferences) -> str:
    """Return a stage position as text."""
    quantity = preferences.displayed(POSITION)
    parts = (f"{n} {shown_number(quantity, v)}" for n, v in zip("xy", at, strict=True))
    return f"{', '.join(parts)} {quantity.shown_unit}"


def figures(
    turn: dict[str, Any], radius: float | None, preferences: Preferences
) -> list[tuple[str, str, str]]:
    """Return name, value and note of the figures of a turn, the main one first."""
    unit, factor = preferences.length_unit()
    rows: list[tuple[str, str, str]] = []
    if (e := turn.get("eccentricity")) is not None:
        uncertainty = factor * e["uncertainty"]
        low, high = (value_and_uncertainty(factor * end, uncertainty)[0] for end in e["interval"])
        value = f"{with_uncertainty(e['value'], e['uncertainty'], factor)} {unit}"
        rows.append(("Eccentricity", value, f"95 %: {low} to {high} {unit}"))
    if (first := once_per_turn(turn, radius)) is not None:
        rows.append(("Error once per turn", f"{with_uncertainty(*first, 1.0)} arcsec", "amplitude"))
    rows.append(("Residual", residual(turn, preferences), "rms"))
    return rows


def once_per_turn(turn: dict[str, Any], radius: float | None) -> tuple[float, float] | None:
    """Return the amplitude of the once-per-turn error and its standard uncertainty [arcsec].

    For a gauge it is the error of a scale with this radius.
    """
    first = next((h for h in turn["harmonics"] if h["order"] == 1), None)
    if first is None:
        return None
    size = first["amplitude_arcsec"]
    if size is None:
        if radius is None:
            return None
        size = 1e-6 * first["amplitude_um"] / radius / ARCSEC
    amplitude = first["amplitude"]
    return size, first["amplitude_uncertainty"] * (size / amplitude if amplitude else 0.0)


def residual(turn: dict[str, Any], preferences: Preferences) -> str:
    """Return the residual of the harmonics as text."""
    first = turn["harmonics"][0]
    rms, size = turn["residual_rms"], first["amplitude"]
    if first["amplitude_arcsec"] is not None:
        return f"{number(rms * first['amplitude_arcsec'] / size, 3)} arcsec" if size else "–"
    unit, factor = preferences.length_unit()
    return (
        f"{number(rms * factor * 1e-6 * first['amplitude_um'] / size, 3)} {unit}" if size else "–"
    )


def turns_table(state: CentringState, preferences: Preferences) -> Table:
    """Return a table of the measured turns."""
    unit, factor = preferences.length_unit()
    heads = (
        "turn", f"stage x [{unit}]", f"y [{unit}]", f"eccentricity [{unit}]", "direction [°]",
        "once per turn [arcsec]", "residual, rms",
    )  # fmt: skip
    turns = state.result.setups if state.result is not None and state.up_to_date else []
    rows = []
    for i, turn in enumerate(state.turns):
        at = [shown_number(preferences.displayed(POSITION), v) for v in turn.position]
        cells = ["…"] * 4
        if i < len(turns):
            e, first = (
                turns[i].get("eccentricity"),
                once_per_turn(turns[i], state.table.scale.radius),
            )
            cells = [
                "–" if e is None else with_uncertainty(e["value"], e["uncertainty"], factor),
                "–" if e is None else display_text(f"{e['phase_deg']:.1f}"),
                "–" if first is None else with_uncertainty(*first, 1.0),
                residual(turns[i], preferences),
            ]
        rows.append((f"{i + 1} {_KINDS[turn.kind]}", *at, *cells))
    return table("", heads, rows)


def build(page: Page) -> None:
    """Build the view."""
    CentringView(page).build()


class CentringView:
    """The view in one page.

    Parameters
    ----------
    page
        The page.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._bench = page, bench_of(page)
        self._state = page.session.state(CentringState)
        self._folder = page.panel.folder(f"centring/{page.session.id}")
        if not self._state.turns and "turn" not in self._state.jobs:
            self._state.begin(self._state.source, stage_position(self._bench))
        if (limits := limits_of(self._bench)) is not None:
            self._state.limits, self._state.noise = limits, noise_of(self._bench)

    def build(self) -> None:
        """Build the view."""
        with (
            ui.tabs(on_change=self._stepped)
            .classes("steps")
            .props("inline-label no-caps dense align=left") as self._steps
        ):
            for name, (label, icon) in _STEPS.items():
                ui.tab(name, label, icon=icon)
        steps = (
            self._build_table,
            self._build_stage,
            self._build_records,
            self._build_moves,
            self._build_certificate,
        )
        panels = ui.tab_panels(self._steps, value=self._state.step, animated=False)
        with panels.classes("step centring"):
            for name, build_step in zip(_STEPS, steps, strict=True):
                with ui.tab_panel(name):
                    build_step()
        page, jobs = self._page, self._state.jobs
        again = self._show_turns
        self._study = Task(
            page, jobs, "study", self._studying, self._take_study, self._study_failed,
            self._show_study,
        )  # fmt: skip
        self._turning = Task(
            page, jobs, "turn", self._working, self._add_simulated, self._failed, again
        )
        self._fit = Task(page, jobs, "fit", self._working, self._take, self._failed, again)
        self._certifying = Task(
            page, jobs, "certificate", self._writing, self._take_certificate,
            elsewhere=self._show_certificate,
        )  # fmt: skip
        with page.show_errors(self._table_card):
            self._state.use_table(self._state.table_text, self._folder)
        self._show_study()
        self._show_columns()
        self._show_turns()
        if self._state.studied is None and not self._study.running:
            self._start_study()

    def _stepped(self, event: Any) -> None:
        self._state.step = event.value

    # table

    def _build_table(self) -> None:
        with div("columns table"):
            with panel() as self._table_card:
                upload(
                    self._page, "Table file: drop it here", _YAML, self._open_table, view=_UPLOADS
                ).classes("slim")
                self._text = ui.textarea(
                    "Table, scale, heads and tolerance (YAML)", value=self._state.table_text
                )
                self._text.props("outlined autogrow debounce=800 spellcheck=false")
                self._text.classes("full-width table-text")
                self._text.on_value_change(lambda e: self._edit(e.value or ""))
                with ui.row():
                    quiet_button("Save", icon="download", on_click=self._save_table)
                    quiet_button("Example", on_click=lambda: self._text.set_value(EXAMPLE))
                self._studying = div("full-width")
            self._budget = panel()

    def _open_table(self, path: Path) -> None:
        self._text.value = read_text(path, TABLE_FILE.noun, TABLE_FILE.error)

    def _save_table(self) -> None:
        ui.download.content(self._state.table_text.encode(), "table.yaml")

    def _edit(self, text: str) -> None:
        with self._page.show_errors(self._table_card):
            self._state.use_table(text, self._folder)
            if self._state.studied is None:
                self._turning.stop()
                self._start_study()
                self._evaluate()

    def _start_study(self) -> None:
        state = self._state
        key = f"budget{self._budget.id}"
        self._study.start(
            f"study of {state.table.name}", study_table, state.table, state.own_stages, key
        )
        self._show_study()

    def _take_study(self, studied: StudiedTable) -> None:
        self._state.studied = studied
        self._show_study()
        self._show_turns()

    def _study_failed(self, message: str) -> None:
        self._show_study()
        if message:
            show_error(message, self._table_card)

    def _show_study(self) -> None:
        """Show what the scale needs, and the judged stages."""
        self._budget.clear()
        self._judged.clear()
        studied = self._state.studied
        if studied is None:
            for area in (self._budget, self._judged):
                with area:
                    text = "Calculating …" if self._study.running else "See the step Table."
                    ui.label(text).classes("muted")
            return
        study = studied.study
        uncertainty = study.data()["expanded_uncertainty"]
        arcsec = {k: number(uncertainty[k] / ARCSEC, 3) for k in ("mounted", "centred")}
        with self._budget:
            with div("row-of-figures"):
                mounted = displayed(study.table.scale.eccentricity, "m")
                note = f"as mounted {mounted}"
                figure("Allowed eccentricity", displayed(study.allowed, "m"), note)
                note = f"95 %, allowed {number(study.table.tolerance.error / ARCSEC, 3)} arcsec"
                figure("Uncertainty when centred", f"{arcsec['centred']} arcsec", note)
                figure("Uncertainty as mounted", f"{arcsec['mounted']} arcsec", "95 %")
            picture(studied.svg).props("tabindex=0")
            show_table(in_page(budget_table(study)))
            show_lines(map(sentence, study.notes), "muted small")
        with self._judged:
            self._show_stages(studied)

    # stage

    def _build_stage(self) -> None:
        with panel():
            with ui.row().classes("items-center choices"):
                self._stages = choice({}, None, "Stage", lambda e: self._choose_stage(e.value))
                upload(
                    self._page,
                    "Another stage file: drop it here",
                    _YAML,
                    self._open_stage,
                    view=_UPLOADS,
                ).classes("slim")
            self._judged = ui.column().classes("full-width stretched")

    def _show_stages(self, studied: StudiedTable) -> None:
        state = self._state
        judged = studied.stages[state.stage]
        names = {
            name: f"{each.name}: {'suits' if each.suits else 'does not suit'}"
            for name, each in studied.stages.items()
        }
        self._stages.set_options(names, value=state.stage)
        ui.label(sentence(display_text(judged.reason))).classes(
            "issue good" if judged.suits else "issue error"
        )
        with div("columns stages"):
            with div("stacked"):
                show_table(in_page(stages_table(studied.study)))
            with div("stacked"):
                if judged.needs:
                    show_table(in_page(one_stage_table(judged)))
                else:
                    show_table(in_page(needs_table(studied.study)))

    def _choose_stage(self, name: str) -> None:
        if name != self._state.stage:
            self._state.stage = name
            self._show_study()
            self._evaluate()

    async def _open_stage(self, path: Path) -> None:
        await asyncio.to_thread(find_stage, path)
        state, name = self._state, str(path)
        state.own_stages = (*(other for other in state.own_stages if other != name), name)
        state.stage, state.studied = name, None
        self._start_study()
        self._evaluate()

    # records

    def _build_records(self) -> None:
        with div("columns with-form"):
            with panel():
                labels = {source: label for source, (label, _) in _SOURCES.items()}
                choice(
                    labels, self._state.source, "Source of records", lambda e: self._begin(e.value)
                )
                self._columns = ui.column().classes("full-width stretched")
                self._measure = ui.column().classes("full-width stretched")
                self._working = div("full-width")
            with panel():
                self._chart = div("full-width")
                self._results = ui.column().classes("full-width stretched")
        self._charted: object = None

    def _begin(self, source: Source) -> None:
        self._turning.stop()
        self._fit.stop()
        self._state.begin(source, stage_position(self._bench))
        self._show_columns()
        self._show_turns()

    def _add_turn(self, path: Path) -> None:
        self._state.add_turn(path)
        self._evaluate()

    def _add_simulated(self, path: Path) -> None:
        self._state.position = self._state.turned_at
        self._add_turn(path)

    async def _use_file(self, path: Path) -> None:
        path_in_folder = self._new_file(path.suffix)
        write_whole(path_in_folder, path.read_bytes())
        if not self._state.turns:
            self._state.use_columns(await asyncio.to_thread(likely_columns, path_in_folder))
            self._show_columns()
        self._add_turn(path_in_folder)

    def _use_readings(self) -> None:
        with self._page.show_errors():
            path = self._new_file(".csv")
            gauge_record(self._state.gauge_text, 1.0 / LENGTHS[self._state.gauge_unit], path)
            self._state.gauge_text = ""
            self._add_turn(path)

    def _turn(self) -> None:
        state = self._state
        state.history, state.turned_at = turn_history(state.table), state.position
        by = [at - first for at, first in zip(state.position, state.origin, strict=True)]
        self._turning.start(
            "simulated table", turn_table, state.table, by, len(state.turns),
            self._new_file(".csv"), state.history, in_thread=True,
        )  # fmt: skip
        self._show_turns()

    def _new_file(self, suffix: str) -> Path:
        existing = {path.stem for path in self._folder.iterdir()}
        number = next(k for k in range(1, len(existing) + 2) if f"turn-{k}" not in existing)
        return self._folder / f"turn-{number}{suffix}"

    def _undo_turn(self) -> None:
        self._turning.stop()
        self._state.undo_turn()
        self._evaluate()

    def _set_position(self, axis: int, value: float | None) -> None:
        _, factor = self._page.preferences.length_unit()
        if value is not None:
            at = list(self._state.position)
            at[axis] = value / factor
            self._state.position = (at[0], at[1])

    def _evaluate(self) -> None:
        self._fit.stop()
        if self._state.turns:
            with self._page.show_errors():
                for error in self._state.errors.values():
                    raise error
                key = f"centring{self._results.id}"
                self._fit.start("evaluation", evaluate_files, self._state.evaluation, key)
        self._show_turns()

    def _take(self, result: CentringResult) -> None:
        self._state.result = result
        target = self._state.target()
        if target is not None and axes_of(self._bench) is None:
            self._state.position = target
        self._show_turns()

    def _failed(self, message: str) -> None:
        if message:
            show_error(message)
        self._show_turns()

    def _show_turns(self) -> None:
        """Show the turns, and what follows from them."""
        self._measure.clear()
        with self._measure:
            self._measuring()
        history = self._state.history
        if history is not self._charted:
            self._charted = history
            self._chart.clear()
            if history is not None:
                with self._chart:
                    LiveChart(
                        self._page, history, alt_text="Reading error of each head", angle=ANGLE
                    )
        self._results.clear()
        with self._results:
            self._result()
        self._moves.clear()
        with self._moves:
            self._moving()
        self._show_certificate()

    def _measuring(self) -> None:
        state = self._state
        unit, factor = self._page.preferences.length_unit()
        with ui.row().classes("items-center place"):
            for axis in (0, 1):
                value = float(f"{factor * state.position[axis]:.6g}")
                field = ui.number(f"Stage at {'xy'[axis]} [{unit}]", value=value)
                field.props("dense outlined")
                field.on_value_change(lambda e, axis=axis: self._set_position(axis, e.value))
        self._record_field()
        with ui.row().classes("items-center"):
            if state.turns:
                quiet_button("Undo last turn", icon="undo", on_click=self._undo_turn)
                quiet_button(
                    "Start again", icon="restart_alt", on_click=partial(self._begin, state.source)
                )
            if state.up_to_date:
                go = partial(self._steps.set_value, "moves")
                quiet_button("To the moves", icon="arrow_forward", on_click=go)

    def _show_columns(self) -> None:
        """Show the source of records, and the fields of their columns."""
        state = self._state
        self._columns.clear()
        with self._columns:
            ui.label(_SOURCES[state.source][1])
            if state.source in ("records", "magnet") and state.columns:
                self._column_fields()

    def _column_fields(self) -> None:
        state = self._state
        form = RequestForm(self._page, lambda: state.request, self._ask_columns, state.errors)
        columns = list(state.columns)
        with div("entries"):
            form.choice("angle", columns)
            form.choice(state.column_kind, columns)
            form.choice("unit", _UNITS)
            form.choice("head_direction", {"ccw": "counter-clockwise", "cw": "clockwise"})
        box = ui.checkbox(
            "Columns are angle readings of the heads", value=state.column_kind == "reading"
        )
        box.props("dense").on_value_change(lambda e: self._set_column_kind(bool(e.value)))

    def _ask_columns(self, name: str, value: Any) -> None:
        self._state.ask(**{name: value})
        self._evaluate()

    def _set_column_kind(self, is_reading: bool) -> None:
        names = self._state.request.names
        self._state.ask(error=() if is_reading else names, reading=names if is_reading else ())
        self._show_columns()
        self._evaluate()

    def _record_field(self) -> None:
        source = self._state.source
        if source == "simulated":
            button = ui.button("Turn the simulated table", on_click=self._turn)
            button.set_enabled(not self._turning.running)
        elif source == "gauge":
            text = ui.textarea("Readings over one turn, at equal angles").props("outlined autogrow")
            text.classes("full-width").bind_value(self._state, "gauge_text")
            with ui.row().classes("items-center"):
                choice = ui.select(list(LENGTHS), label="Unit").props("dense outlined")
                choice.bind_value(self._state, "gauge_unit")
                ui.button("Use the readings", on_click=self._use_readings)
        else:
            label = "Record of a turn: drop it here"
            upload(self._page, label, _ENDINGS, self._use_file, view=_UPLOADS)

    def _result(self) -> None:
        state, preferences = self._state, self._page.preferences
        result = state.result if state.up_to_date else None
        if result is not None:
            with div("row-of-figures"):
                for row in figures(result.setups[-1], state.table.scale.radius, preferences):
                    figure(*row)
            picture(result.svg).props("tabindex=0")
        if state.turns:
            show_table(turns_table(state, preferences))
        elif state.history is None:
            ui.label("No turn measured yet").classes("muted")
        if result is not None:
            quiet_button("Results (JSON)", icon="download", on_click=self._download).classes(
                "own-width"
            )
            show_lines(map(sentence, dict.fromkeys(result.data["notes"])), "muted small")

    def _download(self) -> None:
        if self._state.result is not None:
            content = json.dumps(self._state.result.data, indent=1).encode()
            write_whole(self._folder / "centring.json", content)
            ui.download.content(content, "centring.json")

    # moves

    def _build_moves(self) -> None:
        with panel("moves"):
            self._trial = ui.checkbox(
                "Find direction and sense of the stage by trial moves", value=self._state.by_trial
            )
            self._trial.props("dense").on_value_change(lambda e: self._set_trial(bool(e.value)))
            self._moves = ui.column().classes("full-width stretched")

    def _moving(self) -> None:
        state = self._state
        self._trial.visible = state.source != "magnet"
        if not state.turns or not state.up_to_date:
            waits = bool(state.turns) and self._fit.running
            ui.label("Evaluating the records …" if waits else _NO_TURN).classes("muted")
            return
        assert state.result is not None
        self._show_eccentricity(state.result)
        target = state.target()
        if target is None:
            ui.label("These records determine no move.").classes("muted")
            show_lines(state.result.data.get("trial", {}).get("notes", ()), "issue")
        elif state.next_kind == "trial":
            self._show_trial(target)
        else:
            self._show_settings(state.result)
        if target is not None:
            self._go_button(target)
        go = partial(self._steps.set_value, "records")
        quiet_button("Measure the next turn", icon="radar", on_click=go).classes("own-width")

    def _set_trial(self, by_trial: bool) -> None:
        self._state.by_trial = by_trial
        self._evaluate()

    def _show_eccentricity(self, result: CentringResult) -> None:
        """Show the eccentricity, and whether the table allows it."""
        state = self._state
        rows = figures(result.setups[-1], state.table.scale.radius, self._page.preferences)[:2]
        with div("row-of-figures"):
            for row in rows:
                figure(*row)
            if state.studied is not None:
                figure("Allowed", displayed(state.studied.study.allowed, "m"))
        eccentricity = result.setups[-1].get("eccentricity")
        if state.studied is None or eccentricity is None:
            return
        # equal readings have no resolution, and no uncertainty
        is_known = eccentricity["uncertainty"] > _LEAST
        if is_known and eccentricity["interval"][1] <= state.studied.study.allowed:
            ui.label("The scale is centred: the table allows this eccentricity.").classes(
                "issue good"
            )

    def _show_trial(self, target: tuple[float, float]) -> None:
        state = self._state
        axis = len(state.turns) - 1
        unit, factor = self._page.preferences.length_unit()
        step = factor * (target[axis] - state.turns[-1].position[axis])
        destination = position_text(target, self._page.preferences)
        ui.label(
            f"Move the stage by {step:+.4g} {unit} in {'xy'[axis]} only, to {destination}, and "
            "measure the next turn. It calibrates the axis."
        )

    def _show_settings(self, result: CentringResult) -> None:
        """Show the move, and the settings of the drives that make it."""
        state, preferences = self._state, self._page.preferences
        unit, factor = preferences.length_unit()
        move, uncertainty = state.move() or (0.0, 0.0), self._uncertainty(result)
        with div("row-of-figures"):
            for axis, by, u, noise in zip("xy", move, uncertainty, state.noise, strict=True):
                stays = abs(by) <= noise
                note = "below the noise of the sensor: no move" if stays else ""
                figure(f"Move in {axis}", f"{with_uncertainty(by, u, factor)} {unit}", note)
        judged = state.studied.stages[state.stage] if state.studied is not None else None
        if judged is not None and not judged.suits:
            text = f"{judged.name} does not suit this table: {judged.reason}."
            ui.label(display_text(text)).classes("issue")
        if result.settings is not None:
            show_table(in_page(settings_table(result.settings)))
            show_lines(map(sentence, result.settings.notes), "muted small")
        elif result.problem:
            ui.label(sentence(display_text(result.problem))).classes("issue")
        if state.needs_trial:
            show_lines(result.data["trial"]["notes"], "muted small")

    def _uncertainty(self, result: CentringResult) -> tuple[float, float]:
        """Return the standard uncertainty of the move along each axis [m]."""
        by_trial = self._state.needs_trial
        move = result.data["trial"]["centre"] if by_trial else result.setups[-1]["move"]
        return move["uncertainty_x"], move["uncertainty_y"]

    def _go_button(self, target: tuple[float, float]) -> None:
        if self._state.source == "simulated" and axes_of(self._bench) is None:
            remark("The stage of the simulated table makes this move before its next turn.")
        elif axes_of(self._bench) is None:
            remark("Move the stage yourself, or connect it in the view Bench.")
        elif self._bench.control.holds(self._page.session.id):
            ui.button("Move the stage there", on_click=lambda: self._move(target))
        else:
            remark("This browser does not have control of the stage: take it in the view Bench.")

    async def _move(self, target: tuple[float, float]) -> None:
        with self._page.show_errors():
            session = self._page.session.id
            self._state.position = await asyncio.to_thread(move_to, self._bench, session, target)
            ui.notify(
                f"the stage is at {position_text(self._state.position, self._page.preferences)}"
            )
            self._show_turns()

    # certificate

    def _build_certificate(self) -> None:
        with div("columns with-form"):
            with panel():
                self._certificate = ui.column().classes("full-width stretched")
                self._writing = div("full-width")
            self._certified = panel()

    def _show_certificate(self) -> None:
        state = self._state
        self._certificate.clear()
        with self._certificate:
            if not state.turns:
                ui.label(_NO_TURN).classes("muted")
            else:
                ui.label("The last turn calibrates the scale. State what the certificate says.")
                choice(_METHODS, state.method.method, "Method", lambda e: self._method(e.value))
                for name, text in state.facts.items():
                    self._fact_field(name, text)
                ui.button("Write the certificate", on_click=self._certify)
        self._certified.clear()
        with self._certified:
            written = state.certified
            if written is None:
                remark(
                    "One page for print: object and standards, errors of the scale with their "
                    "uncertainty and its budget, and the hash of the record."
                )
                return
            PanelHeading(written.title)
            with div("file-links"):
                ui.link("Open in a new tab", written.address(), new_tab=True)
                for file, text in _CERTIFICATE.items():
                    link = ui.link(text, written.address(file))
                    link.props["download"] = f"{written.name}{Path(file).suffix}"

    def _method(self, name: Any) -> None:
        self._state.method = replace(self._state.method, method=name)

    def _fact_field(self, name: str, text: str) -> None:
        field = ui.input(name.capitalize(), value=text).props("outlined dense debounce=300")
        field.classes("full-width")
        field.props["hint"] = display_text(field_texts(CertificateRequest)[name])
        field.on_value_change(lambda e: self._state.stated.update({name: e.value or ""}))

    def _certify(self) -> None:
        state = self._state
        with self._page.show_errors():
            stated = CertificateRequest(certificate="certificate.html", **state.facts)
            is_simulated = state.source == "simulated"
            self._certifying.start(
                "certificate", certify, self._page.panel.folder("report"), state.table.name,
                state.turns[-1].file, state.calibration, stated,
                ("simulated records, not measured",) if is_simulated else (),
            )  # fmt: skip

    def _take_certificate(self, written: WrittenReport) -> None:
        self._state.certified = written
        self._show_certificate()
