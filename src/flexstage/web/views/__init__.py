"""The views of the front panel, one file each."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexstage.web.page import Page


@dataclass(frozen=True, slots=True)
class PanelView:
    """A view, with the module of this folder whose `build` makes its page."""

    name: str
    """Name in the navigation."""
    icon: str
    """Name of its icon in Google's Material Icons."""
    module: str
    """Name of the module."""
    purpose: str
    """Purpose of the view, for the tooltip."""

    @property
    def path(self) -> str:
        """Path in the address."""
        return f"/{self.module}"

    @property
    def build(self) -> "Callable[[Page], None]":
        """The function that builds its page."""
        return import_module(f"{__name__}.{self.module}").build


#: The view of the address without a path.
START = PanelView("Start", "home", "start", "What do you want to do?")

#: In the order of the navigation.
VIEWS: tuple[PanelView, ...] = (
    PanelView("Design", "architecture", "design", "Choose a stage and change its parameters"),
    PanelView("Analyse", "insights", "analyse", "Run models of the stage and compare them"),
    PanelView(
        "Explore",
        "travel_explore",
        "explore",
        "Sweep, optimise, tolerance and sensitivity analysis",
    ),
    PanelView(
        "Hysteresis",
        "all_inclusive",
        "hysteresis",
        "Identify the hysteresis of a drive, and compensate it",
    ),
    PanelView("Bench", "speed", "bench", "Connect to a stage, move it and record it"),
    PanelView("Centring", "adjust", "centring", "Centre an encoder scale on a rotary table"),
    PanelView("Report", "description", "report", "Write a report of the stage"),
)
