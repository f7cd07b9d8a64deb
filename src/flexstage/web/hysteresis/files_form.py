"""Form of files with measured data: upload, options of reading, and preview."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from nicegui import events, ui

from flexstage.base.errors import FlexstageError
from flexstage.files.request import request_fields
from flexstage.files.schema import field_texts, part_texts
from flexstage.records import FORMATS
from flexstage.records.contents import column_label, contents_table, length_in_words
from flexstage.records.read_options import DriveColumns, ReadOptions, TextLayout
from flexstage.web.figures import in_page, picture, show_table
from flexstage.web.hysteresis.requests import UNITS, FileSelection
from flexstage.web.hysteresis.state import MeasuredFiles
from flexstage.web.hysteresis.work import FilePreview, is_light, preview_files
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, Task, display_text, div, quiet_button, remark
from flexstage.web.uploads import upload

_ENDINGS = tuple(suffix for suffixes in FORMATS.values() for suffix in suffixes)
_MAX_SIZE = 128 * 2**20  # byte
_DELAYED = "outlined dense stack-label debounce=700"
#: Fields that most files do not need, with an example.
_SPECIAL = {
    "rows": "400:7200",
    "resample": "median, or 200 Hz",
    "dataset": "name of a group or variable",
    "text": "skip=6, delimiter=;, decimal=,",
    "branches": "UP,DOWN: two columns of a table without times",
    "curve": "column with the number of the reversal curve, or files, or columns",
}
_TABLES = ("branches", "curve")


_FIELDS = {**request_fields(DriveColumns), **request_fields(ReadOptions)}
_LABELS = {name: field.label for name, field in _FIELDS.items()}
_LABELS |= {name: name.replace("_", " ").capitalize() for name in UNITS}
_TEXTS = {**field_texts(DriveColumns), **field_texts(ReadOptions), **UNITS}
_TEXTS["text"] += f" {part_texts(TextLayout)}"


class FilesForm:
    """The fields of files with measured data.

    Parameters
    ----------
    page
        The page.
    source
        The selected files.
    jobs
        Jobs of the session by purpose.
    key
        Purpose of the files.
    label
        Label of the upload field.
    example
        Writes an example file into a folder.
    changed
        Called after every change.
    template
        Returns the options of reading for a new file.
    reference
        One file with one column, for a desired motion.
    """

    def __init__(
        self,
        page: Page,
        source: MeasuredFiles,
        jobs: dict[str, BackgroundJob],
        *,
        key: str,
        label: str,
        example: Callable[[Path], Path] | None,
        changed: Callable[[], object],
        template: Callable[[], FileSelection] = FileSelection,
        reference: bool = False,
    ) -> None:
        self._page, self._source, self._jobs, self._key = page, source, jobs, key
        self._label, self._example, self._changed = label, example, changed
        self._template, self._reference = template, reference
        self._fields: dict[str, Any] = {}
        self._invalid: dict[str, str] = {}  # messages of fields with invalid text
        self._reads = 0
        self._fallback: FileSelection | None = None
        self._syncing = False

    def build(self) -> None:
        """Build the fields."""
        with div("take"):
            upload(
                self._page,
                self._label,
                _ENDINGS,
                self._replace,
                view="hysteresis",
                max_size=_MAX_SIZE,
            ).classes("tall")
            if self._example is not None:
                quiet_button("Load example", on_click=self._load_example).props("outline")
        self._files = div("file-list")
        self._error = ui.label().classes("issue error").props('role="alert"')
        self._back = quiet_button(on_click=self._go_back).props("dense")
        with div("entries pairs") as self._grid:
            if not self._reference:
                self._column("input")
                self._text("input_unit", "V")
            self._column("output", "Column" if self._reference else "", clearable=True)
            self._text("output_unit", "um", "Reference unit" if self._reference else "")
            self._column("time", clearable=True)
            self._text("sample_rate", "200 Hz")
        with (
            ui.expansion(
                "How the file is read", value=self._source.selection.has_special_options
            ).classes("folded") as self._options,
            div("entries"),
        ):
            for name, example in _SPECIAL.items():
                if not (self._reference and name in _TABLES):
                    self._text(name, example)
            self._select("format", {name: name for name in FORMATS}, clearable=True)
            if not self._reference:
                upload(
                    self._page, "Another record of the same drive", _ENDINGS, self._add,
                    view="hysteresis", max_size=_MAX_SIZE,
                ).classes("whole")  # fmt: skip
        self._working = ui.column().classes("full-width")
        self._task = Task(
            self._page, self._jobs, self._key, self._working, self._take, self._show_failure,
            self._update,
        )  # fmt: skip
        self.sync()

    def begin(self) -> None:
        """Read files that have no preview yet, after all elements are built."""
        source = self._source
        if source.selection.files and source.preview is None and not source.error:
            self.look()

    # fields

    def _text(self, name: str, example: str, label: str = "") -> None:
        field = ui.input(label or _LABELS[name], placeholder=example)
        field.value = self._source.selection.text(name)
        self._fields[name] = field.props(_DELAYED).tooltip(_TEXTS[name])
        field.on_value_change(lambda event: self._set(name, event))

    def _select(
        self, name: str, options: dict[str, str], label: str = "", **properties: Any
    ) -> None:
        value = self._source.selection.text(name)
        if value and value not in options:
            options = {**options, value: value}
        field = ui.select(options, label=label or _LABELS[name], value=value or None, **properties)
        self._fields[name] = field.props("outlined dense options-dense stack-label")
        field.on_value_change(lambda event: self._set(name, event))

    def _column(self, name: str, label: str = "", **properties: Any) -> None:
        # several columns of curves are separated by commas
        self._select(
            name, self._columns(), label, with_input=True, new_value_mode="add-unique",
            key_generator=str, **properties,
        )  # fmt: skip

    def _columns(self) -> dict[str, str]:
        if self._source.preview is None:
            return {}
        columns = self._source.preview.contents[0]["columns"]
        return {str(column["number"]): column_label(column) for column in columns}

    def _set(self, name: str, event: events.ValueChangeEventArguments[Any]) -> None:
        value = (event.value or "").strip()
        if self._syncing:
            return
        self._invalid.pop(name, None)
        if value == self._source.selection.text(name):
            if self._source.error:  # a text was corrected
                self.look()
            return
        try:
            selection = self._source.selection.changed(name, value)
        except FlexstageError as error:  # the text stays in its field for correction
            self._invalid[name] = self._page.message(f"{_LABELS[name]}: {error}")
            self._source.error = self._invalid[name]
            self._show_error_state()
            self._changed()
            return
        if selection.columns.branches:  # two branches form the output
            selection = replace(selection, columns=replace(selection.columns, output=()))
        self._source.selection = selection
        self.look()

    def sync(self) -> None:
        """Show the state in the fields."""
        selection, columns = self._source.selection, self._columns()
        self._syncing = True
        for name, field in self._fields.items():
            value = selection.text(name)
            if name in self._invalid:
                continue
            if name in ("input", "output", "time"):
                options = {**columns, **({value: value} if value and value not in columns else {})}
                field.set_options(options, value=value or None)
            elif (field.value or "") != value:
                field.value = value or (None if name == "format" else "")
        self._syncing = False
        has_files = bool(selection.files)
        self._grid.visible = self._options.visible = has_files
        self._show_error_state()
        self._show_files()

    def _show_error_state(self) -> None:
        """Show the error of the files, and offer the last readable ones."""
        self._error.visible = bool(self._source.error)
        self._error.text = self._source.error
        previous = self._source.previous
        self._back.visible = bool(self._source.error and previous is not None)
        if previous is not None:
            self._back.text = f"Back to {', '.join(previous.selection.names)}"

    def _show_files(self) -> None:
        self._files.clear()
        with self._files:
            for file in self._source.selection.files:
                with ui.row().classes("items-center no-wrap file-entry"):
                    ui.icon("description").props("aria-hidden=true")
                    ui.label(Path(file).name)
                    button = quiet_button(
                        icon="close", on_click=lambda _, file=file: self._remove(file)
                    ).props("dense round")
                    button.props["aria-label"] = f"Remove {Path(file).name}"

    # files

    def _replace(self, path: Path) -> None:
        self._invalid.clear()
        self._fallback = FileSelection(files=(str(path),))
        template = self._template()
        options = replace(template.options, rows=None)
        self._source.open(replace(template, files=self._fallback.files, options=options))
        self.look()

    def _add(self, path: Path) -> None:
        selection = self._source.selection
        others = tuple(file for file in selection.files if file != str(path))
        self._source.selection = replace(selection, files=(*others, str(path)))
        self.look()

    def _remove(self, file: str) -> None:
        remaining = tuple(f for f in self._source.selection.files if f != file)
        if remaining:
            self._source.selection = replace(self._source.selection, files=remaining)
        else:
            self._source.open(FileSelection())
        self.look()

    async def _load_example(self) -> None:
        assert self._example is not None
        self._invalid.clear()
        folder = self._page.panel.folder(f"hysteresis/{self._page.session.id}")
        with self._page.show_errors():
            path = await asyncio.to_thread(self._example, folder)
            self._source.open(FileSelection(files=(str(path),)))
            self.look()

    def _go_back(self) -> None:
        self._invalid.clear()
        self._source.go_back()
        self.sync()
        self._changed()

    # preview

    def look(self) -> None:
        """Read the files for the preview."""
        selection = self._source.selection
        if not selection.files:
            self._source.preview, self._source.error = None, ""
            self.sync()
            self._changed()
            return
        self._reads += 1
        key = f"{self._key}{self._grid.id}-{self._reads}"
        self._show_files()
        if self._source.preview is None:
            self._changed()
        try:
            is_fast = is_light(selection)
        except OSError as error:
            self._show_failure(f"the file cannot be opened: {error.strerror}")
            return
        if is_fast:
            self._task.stop()
            self._page.begin(self._look, selection, key)
        else:
            self._task.start(f"reading {', '.join(selection.names)}", preview_files, selection, key)

    async def _look(self, selection: FileSelection, key: str) -> None:
        try:
            preview = await asyncio.to_thread(preview_files, selection, key)
        except (FlexstageError, OSError) as error:
            if self._source.selection == selection:
                self._show_failure(str(error))
        else:
            if self._source.selection == selection:
                self._take(preview)

    def _take(self, preview: FilePreview) -> None:
        self._source.preview, self._fallback = preview, None
        self._source.error = next(iter(self._invalid.values()), "")
        selection = preview.selection
        columns = selection.columns
        if self._reference and not columns.output:
            selection = replace(selection, columns=replace(columns, output=columns.input))
        self._source.selection = selection
        self.sync()
        self._changed()

    def _update(self) -> None:
        self.sync()
        self._changed()

    def _show_failure(self, sentence: str) -> None:
        fallback, self._fallback = self._fallback, None
        if fallback is not None and sentence and fallback != self._source.selection:
            self._source.selection = fallback  # its format differs from that of the template
            self.look()
            return
        self._source.error = (
            self._page.message(sentence) or "The file was not read: reading was cancelled."
        )
        self.sync()
        self._changed()


def show_contents(preview: FilePreview) -> None:
    """Show the preview of files."""
    picture(preview.svg)
    for content in preview.contents:
        name = Path(content["file"]).name
        ui.label(f"{name}: {length_in_words(content)}")
        show_table(in_page(contents_table(content)))
        gaps = content.get("gaps", [])
        if gaps:
            first = gaps[0]
            ui.label(
                f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the first of "
                f"{first['seconds']:.4g} s after sample {first['after_sample']}"
            ).classes("issue")
        for note in content["notes"]:
            remark(display_text(note.replace(content["file"], name)))
