"""Choice of the stage, shared by the views: a built-in design, a stage file or a drawing."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from flexstage.files.write import write_whole
from flexstage.quantities.material import CATALOGUE
from flexstage.quantities.units import parse
from flexstage.report.tables import necks_table
from flexstage.stage.designs import DESIGNS, StageTemplate
from flexstage.stage.drawing import DRAWINGS
from flexstage.stage.drawing.drawn_stage import DrawnStage
from flexstage.stage.drawing.requests import DrawingOptions
from flexstage.web.design.state import DesignState
from flexstage.web.design.work import recognise_drawing, template_of
from flexstage.web.figures import show_table
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, PanelHeading, choice, div, named_dialog, quiet_button, show_job
from flexstage.web.uploads import upload

_FILES = (".yaml", ".yml", ".json", *DRAWINGS)


class StageChoice:
    """The fields that open a stage in the `DesignState` of a browser.

    Parameters
    ----------
    page
        The page.
    on_open
        Called after another stage was opened.
    """

    def __init__(self, page: Page, on_open: Callable[[], object]) -> None:
        self._page, self._on_open = page, on_open
        self._state = page.session.state(DesignState)
        designs = {name: name for name in sorted(DESIGNS)}
        self._choice = choice(designs, self._open_design(), "Design", self._choose, with_input=True)
        upload(
            page, "Stage file or drawing: drop it here", _FILES, self._use_file, view="design"
        ).classes("slim")

    def sync(self) -> None:
        """Show the open design, after an undo."""
        self._choice.value = self._open_design()

    def _open_design(self) -> str | None:
        source = self._state.now.template.source
        return source if source in DESIGNS else None

    def _choose(self) -> None:
        if self._choice.value and self._choice.value != self._state.now.template.source:
            self._open(StageTemplate.of(self._choice.value))

    async def _use_file(self, path: Path) -> None:
        if path.suffix.casefold() in DRAWINGS:
            ask_drawing(self._page, path, self._open)
        else:
            self._open(await asyncio.to_thread(template_of, path))

    def _open(self, template: StageTemplate) -> None:
        self._state.open(template)
        self.sync()
        self._on_open()


_DRIVE = "x: 12,4 -> 30,4; piezo, free_stroke=38 um, stiffness=50 N/um"
_PROBE = "x: 30,4 -> 40,4"


def ask_drawing(page: Page, path: Path, on_open: Callable[[StageTemplate], None]) -> None:
    """Recognise a stage in a drawing, ask for missing data, and open it."""
    with named_dialog(path.name).props("persistent") as dialog, ui.card().classes("dialog wide"):
        PanelHeading(path.name)
        DrawingDialog(page, path, on_open, dialog).build()
    dialog.open()


class DrawingDialog:
    """The dialog of a drawing.

    Parameters
    ----------
    page, path, on_open, dialog
        Page, drawing, function that is called with the stage, and the dialog to close then.
    """

    def __init__(
        self, page: Page, path: Path, on_open: Callable[[StageTemplate], None], dialog: ui.dialog
    ) -> None:
        self._page, self._path, self._on_open, self._dialog = page, path, on_open, dialog
        self._text = ""

    def build(self) -> None:
        """Build the dialog, and recognise the stage."""
        with div("columns"):
            with ui.column().classes("full-width"):
                self._thickness = ui.input("Thickness of the plate", placeholder="10 mm")
                self._material = ui.select(
                    sorted(CATALOGUE), label="Material", clearable=True, with_input=True
                )
                self._drives = ui.textarea("Drives, one per line", placeholder=_DRIVE)
                self._probes = ui.textarea("Probes, one per line", placeholder=_PROBE)
                for field in (self._thickness, self._material, self._drives, self._probes):
                    field.props("outlined dense stack-label").classes("full-width")
                self._missing = ui.label().classes("issue")
                self._working = ui.column().classes("full-width")
                with ui.row():
                    self._open = ui.button("Open stage", on_click=self._take)
                    quiet_button("Update", on_click=self._recognise).props("outline")
                    quiet_button("Cancel", on_click=self._dialog.close)
            self._recognised = ui.column().classes("full-width")
        self._necks = ui.column().classes("full-width")
        self._missing.visible = False
        self._open.disable()
        self._recognise()

    def _options(self) -> DrawingOptions:
        thickness = (self._thickness.value or "").strip()
        return DrawingOptions(
            thickness=parse(thickness, "length", bare_unit="mm") if thickness else None,
            material=self._material.value or None,
            drive=_lines(self._drives.value),
            probe=_lines(self._probes.value),
        )

    def _recognise(self) -> None:
        with self._page.show_errors():
            options = self._options()
            job = self._page.panel.jobs.start(
                f"reading {self._path.name}", recognise_drawing, str(self._path), options,
                f"recognised{self._recognised.id}", owner=self._page.session.id,
            )  # fmt: skip
            with self._working:
                show_job(self._page, job, self._show)

    def _show(self, job: BackgroundJob) -> None:
        self._recognised.clear()
        self._necks.clear()
        self._open.disable()
        if job.state != "done":
            return
        recognised: DrawnStage
        recognised, svg, self._text = job.result
        blanks = ", ".join(recognised.blanks)
        self._missing.text = f"The drawing does not contain: {blanks}." if blanks else ""
        self._missing.visible = bool(blanks)
        # a placeholder for thickness or material is not a value of this stage
        self._open.set_enabled(not {"thickness", "material"} & set(recognised.blanks))
        with self._recognised:
            ui.html(svg, sanitize=False).classes("picture on-paper")
        with self._necks:
            show_table(necks_table(recognised))

    def _take(self) -> None:
        with self._page.show_errors():
            path = self._path.with_suffix(".yaml")
            write_whole(path, self._text.encode("utf-8"))
            self._on_open(template_of(path))
            self._dialog.close()


def _lines(text: str | None) -> tuple[str, ...]:
    return tuple(line.strip() for line in (text or "").splitlines() if line.strip())
