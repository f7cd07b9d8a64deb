"""Design: choose a stage and see what it is."""

from dataclasses import dataclass

from nicegui import ui

from flexstage.designs import DESIGNS, find_stage
from flexstage.report.figures.drawing import draw_stage
from flexstage.web.figures import picture
from flexstage.web.page import Page


@dataclass
class DesignState:
    """What is open in the view."""

    source: str = "vgtu-piezo"
    """Design, or path of a stage file."""


def build(page: Page) -> None:
    """Make the view."""
    state = page.session.state(DesignState)
    with ui.element("section").classes("panel"):
        choice = ui.select(sorted(DESIGNS), value=state.source, label="Design")
        shown = ui.column().classes("w-full")

    def show() -> None:
        state.source = choice.value
        shown.clear()
        with shown, page.sentences():
            stage = find_stage(state.source)
            picture(draw_stage(stage), f"Drawing of {stage.name}")

    choice.on_value_change(show)
    show()
