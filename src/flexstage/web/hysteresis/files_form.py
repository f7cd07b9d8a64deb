"""Files of measured data in a page: dropped, told how to read, and what was read of them."""

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
from flexstage.web.hysteresis.requests import UNITS, Reading
from flexstage.web.hysteresis.state import MeasuredFiles
from flexstage.web.hysteresis.work import FilePreview, is_light, looked_at
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, Task, display_text, div, quiet_button, remark
from flexstage.web.uploads import upload

_ENDINGS = tuple(suffix for suffixes in FORMATS.values() for suffix in suffixes)
_MAX_SIZE = 128 * 2**20  # byte
_PATIENT = "outlined dense stack-label debounce=700"
#: Fields that most files do not need, and what is written as an example.
_UNUSUAL = {
    "rows": "400:7200",
    "resample": "median, or 200 Hz",
    "dataset": "name of a group or variable",
    "text": "skip=6, delimiter=;, decimal=,",
    "branches": "UP,DOWN: two columns of a table without times",
    "curve": "column that numbers reversal curves; or files, or columns",
}
_TABLES = ("branches", "curve")


_FIELDS = {**request_fields(DriveColumns), **request_fields(ReadOptions)}
_LABELS = {name: field.label for name, field in _FIELDS.items()}
_LABELS |= {name: name.replace("_", " ").capitalize() for name in UNITS}
_TEXTS = {**field_texts(DriveColumns), **field_texts(ReadOptions), **UNITS}
_TEXTS["text"] += f" {part_texts(TextLayout)}"


class FilesForm:
    """The fields of files, and beside them what was read.

    Parameters
    ----------
    page
        The page.
    source
        The files.
    jobs
        Jobs of the session by what they are for.
    key
        What the files are for.
    label
        What is asked for.
    example
        Makes a file to start from, in a folder.
    changed
        Called when anything is different.
    like
        Gives how a file is read that is dropped.
    reference
        Whether it is one file with one column, that of a wanted motion.
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
        like: Callable[[], Reading] = Reading,
        reference: bool = False,
    ) -> None:
        self._page, self._source, self._jobs, self._key = page, source, jobs, key
        self._label, self._example, self._changed = label, example, changed
        self._like, self._reference = like, reference
        self._fields: dict[str, Any] = {}
        self._refused: dict[str, str] = {}  # why texts that stand in fields are no values
        self._reads = 0
        self._plain: Reading | None = None
        self._syncing = False

    def build(self) -> None:
        """Make the fields."""
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
                quiet_button("Take the example", on_click=self._take_example).props("outline")
        self._files = div("taken-files")
        self._wrong = ui.label().classes("issue error").props('role="alert"')
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
            ui.expansion("How the file is read", value=self._source.reading.unusual).classes(
                "folded"
            ) as self._more,
            div("entries"),
        ):
            for name, example in _UNUSUAL.items():
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
            self._page, self._jobs, self._key, self._working, self._take, self._refuse,
            self._read_elsewhere,
        )  # fmt: skip
        self.sync()

    def begin(self) -> None:
        """Look into files that nobody has read yet, once all that follows them is there."""
        source = self._source
        if source.reading.files and source.looked is None and not source.wrong:
            self.look()

    # fields

    def _text(self, name: str, example: str, label: str = "") -> None:
        field = ui.input(label or _LABELS[name], placeholder=example)
        field.value = self._source.reading.text(name)
        self._fields[name] = field.props(_PATIENT).tooltip(_TEXTS[name])
        field.on_value_change(lambda event: self._set(name, event))

    def _select(self, name: str, options: dict[str, str], label: str = "", **more: Any) -> None:
        value = self._source.reading.text(name)
        if value and value not in options:
            options = {**options, value: value}
        field = ui.select(options, label=label or _LABELS[name], value=value or None, **more)
        self._fields[name] = field.props("outlined dense options-dense stack-label")
        field.on_value_change(lambda event: self._set(name, event))

    def _column(self, name: str, label: str = "", **more: Any) -> None:
        # of curves in columns several are written, with commas
        self._select(
            name, self._columns(), label, with_input=True, new_value_mode="add-unique",
            key_generator=str, **more,
        )  # fmt: skip

    def _columns(self) -> dict[str, str]:
        if self._source.looked is None:
            return {}
        columns = self._source.looked.contents[0]["columns"]
        return {str(column["number"]): column_label(column) for column in columns}

    def _set(self, name: str, event: events.ValueChangeEventArguments[Any]) -> None:
        value = (event.value or "").strip()
        if self._syncing:
            return
        self._refused.pop(name, None)
        if value == self._source.reading.text(name):
            if self._source.wrong:  # a text was mended
                self.look()
            return
        try:
            reading = self._source.reading.changed(name, value)
        except FlexstageError as error:  # the text stays in its field, to be mended
            self._refused[name] = self._page.message(f"{_LABELS[name]}: {error}")
            self._source.wrong = self._refused[name]
            self._say_wrong()
            self._changed()
            return
        if reading.columns.branches:  # two branches are the output
            reading = replace(reading, columns=replace(reading.columns, output=()))
        self._source.reading = reading
        self.look()

    def sync(self) -> None:
        """Show the state in the fields."""
        reading, columns = self._source.reading, self._columns()
        self._syncing = True
        for name, field in self._fields.items():
            value = reading.text(name)
            if name in self._refused:
                continue
            if name in ("input", "output", "time"):
                known = {**columns, **({value: value} if value and value not in columns else {})}
                field.set_options(known, value=value or None)
            elif (field.value or "") != value:
                field.value = value or (None if name == "format" else "")
        self._syncing = False
        given = bool(reading.files)
        self._grid.visible = self._more.visible = given
        self._say_wrong()
        self._show_files()

    def _say_wrong(self) -> None:
        """Say why the files cannot be read, and offer those that could be."""
        self._wrong.visible = bool(self._source.wrong)
        self._wrong.text = self._source.wrong
        before = self._source.before
        self._back.visible = bool(self._source.wrong and before is not None)
        if before is not None:
            self._back.text = f"Back to {', '.join(before.reading.names)}"

    def _show_files(self) -> None:
        self._files.clear()
        with self._files:
            for file in self._source.reading.files:
                with ui.row().classes("items-center no-wrap taken-file"):
                    ui.icon("description").props("aria-hidden=true")
                    ui.label(Path(file).name)
                    gone = quiet_button(
                        icon="close", on_click=lambda _, file=file: self._remove(file)
                    ).props("dense round")
                    gone.props["aria-label"] = f"Remove {Path(file).name}"

    # files

    def _replace(self, path: Path) -> None:
        self._refused.clear()
        self._plain = Reading(files=(str(path),))
        like = self._like()
        how = replace(like.how, rows=None)
        self._source.open(replace(like, files=self._plain.files, how=how))
        self.look()

    def _add(self, path: Path) -> None:
        reading = self._source.reading
        others = tuple(file for file in reading.files if file != str(path))
        self._source.reading = replace(reading, files=(*others, str(path)))
        self.look()

    def _remove(self, file: str) -> None:
        left = tuple(f for f in self._source.reading.files if f != file)
        if left:
            self._source.reading = replace(self._source.reading, files=left)
        else:
            self._source.open(Reading())
        self.look()

    async def _take_example(self) -> None:
        assert self._example is not None
        self._refused.clear()
        folder = self._page.panel.folder(f"hysteresis/{self._page.session.id}")
        with self._page.show_errors():
            path = await asyncio.to_thread(self._example, folder)
            self._source.open(Reading(files=(str(path),)))
            self.look()

    def _go_back(self) -> None:
        self._refused.clear()
        self._source.go_back()
        self.sync()
        self._changed()

    # what is in them

    def look(self) -> None:
        """Look into the files."""
        reading = self._source.reading
        if not reading.files:
            self._source.looked, self._source.wrong = None, ""
            self.sync()
            self._changed()
            return
        self._reads += 1
        key = f"{self._key}{self._grid.id}-{self._reads}"
        self._show_files()
        if self._source.looked is None:
            self._changed()
        try:
            light = is_light(reading)
        except OSError as error:
            self._refuse(f"the file is gone: {error.strerror}")
            return
        if light:
            self._task.stop()
            self._page.begin(self._look(reading, key))
        else:
            self._task.start(f"reading {', '.join(reading.names)}", looked_at, reading, key)

    async def _look(self, reading: Reading, key: str) -> None:
        try:
            found = await asyncio.to_thread(looked_at, reading, key)
        except (FlexstageError, OSError) as error:
            if self._source.reading == reading:
                self._refuse(str(error))
        else:
            if self._source.reading == reading:
                self._take(found)

    def _take(self, found: FilePreview) -> None:
        self._source.looked, self._plain = found, None
        self._source.wrong = next(iter(self._refused.values()), "")
        reading = found.reading
        columns = reading.columns
        if self._reference and not columns.output:
            reading = replace(reading, columns=replace(columns, output=columns.input))
        self._source.reading = reading
        self.sync()
        self._changed()

    def _read_elsewhere(self) -> None:
        self.sync()
        self._changed()

    def _refuse(self, sentence: str) -> None:
        plain, self._plain = self._plain, None
        if plain is not None and sentence and plain != self._source.reading:
            self._source.reading = plain  # it is not like the other one
            self.look()
            return
        self._source.wrong = (
            self._page.message(sentence) or "The file was not read: it was cancelled."
        )
        self.sync()
        self._changed()


def show_contents(looked: FilePreview) -> None:
    """Show what was read of files."""
    picture(looked.svg)
    for one in looked.contents:
        name = Path(one["file"]).name
        ui.label(f"{name}: {length_in_words(one)}")
        show_table(in_page(contents_table(one)))
        gaps = one.get("gaps", [])
        if gaps:
            first = gaps[0]
            ui.label(
                f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the first of "
                f"{first['seconds']:.4g} s after sample {first['after_sample']}"
            ).classes("issue")
        for note in one["notes"]:
            remark(display_text(note.replace(one["file"], name)))
