"""Where a stage is chosen, in every view that works on one: a built-in design, or a file."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from flexstage.designs import DESIGNS, StageTemplate
from flexstage.stage.drawing import DRAWINGS
from flexstage.web.design.drawing_dialog import ask_drawing
from flexstage.web.design.state import DesignState
from flexstage.web.design.work import template_of
from flexstage.web.page import Page
from flexstage.web.uploads import upload

_FILES = (".yaml", ".yml", ".json", *DRAWINGS)


class StageChoice:
    """The fields that open a stage in the `DesignState` of a browser, which its views share.

    Parameters
    ----------
    page
        The page.
    opened
        Called when another stage was opened.
    """

    def __init__(self, page: Page, opened: Callable[[], object]) -> None:
        self._page, self._opened = page, opened
        self._state = page.session.state(DesignState)
        designs = {name: name for name in sorted(DESIGNS)}
        self._choice = ui.select(
            designs, value=self._shown(), label="Design", with_input=True
        ).props("dense options-dense outlined")
        self._choice.on_value_change(self._choose)
        upload(
            page, "Stage file or drawing: drop it here", _FILES, self._given, view="design"
        ).classes("slim")

    def sync(self) -> None:
        """Name the design that is open, after an undo."""
        self._choice.value = self._shown()

    def _shown(self) -> str | None:
        source = self._state.now.template.source
        return source if source in DESIGNS else None

    def _choose(self) -> None:
        if self._choice.value and self._choice.value != self._state.now.template.source:
            self._open(StageTemplate.of(self._choice.value))

    async def _given(self, path: Path) -> None:
        if path.suffix.casefold() in DRAWINGS:
            ask_drawing(self._page, path, self._open)
        else:
            self._open(await asyncio.to_thread(template_of, path))

    def _open(self, template: StageTemplate) -> None:
        self._state.open(template)
        self.sync()
        self._opened()
