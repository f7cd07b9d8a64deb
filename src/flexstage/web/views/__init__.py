"""The views of the front panel: a file each, and a line here."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexstage.web.page import Page


@dataclass(frozen=True, slots=True)
class PanelView:
    """A view: how it is called, and the module beside this file whose `build` makes its page."""

    name: str
    """Its name in the navigation."""
    icon: str
    """Its icon, by its name among Google's Material Icons."""
    module: str
    """Its module."""
    purpose: str
    """What one does there, for the tooltip."""

    @property
    def path(self) -> str:
        """Its path in the address."""
        return f"/{self.module}"

    @property
    def build(self) -> "Callable[[Page], None]":
        """The function that makes its page."""
        return import_module(f"{__name__}.{self.module}").build


#: What the address alone opens.
START = PanelView("Start", "home", "start", "What have you come to do?")

#: In the order of the navigation.
VIEWS: tuple[PanelView, ...] = (
    PanelView("Design", "architecture", "design", "Choose a stage, change it, see what that does"),
    PanelView("Analyse", "insights", "analyse", "Run models of the stage, and look at its motion"),
    PanelView("Explore", "travel_explore", "explore", "Sweep, optimise, tolerance, sensitivity"),
    PanelView(
        "Hysteresis", "all_inclusive", "hysteresis", "Identify a drive from a record, and undo it"
    ),
    PanelView("Bench", "speed", "bench", "Connect to a stage, move it and record it"),
    PanelView("Centring", "adjust", "centring", "Centre an encoder scale on a turning table"),
    PanelView("Report", "description", "report", "All that is known of a stage on one page"),
)
