"""A chart that follows a history on a page."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from flexstage.errors import ModelError
from flexstage.web.live.history import VOLTAGE, LiveChannel, LiveHistory
from flexstage.web.live.transfer import SharedHistories, add_live_data
from flexstage.web.page import Page, Panel

_STATIC = Path(__file__).parents[1] / "static"

#: How long the windows are that one chooses from [s].
WINDOWS = (10.0, 60.0, 600.0, 3600.0)


def add_live_charts(app: FastAPI, panel: Panel) -> None:
    """Let pages of a panel have live charts; before the first page, which loads their script."""
    add_live_data(app, panel)


@dataclass(slots=True)
class ChartViews:
    """What a browser shows in each live chart: window, loop, hidden channels."""

    views: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)
    """By what the charts say that they show, and the names of their channels."""


class LiveChart(
    Element, component=_STATIC / "live_chart.js", dependencies=[_STATIC / "live_drawing.js"]
):
    """A chart of a history that pages share: over time, one channel over another, or spectra.

    Parameters
    ----------
    page
        The page; its preferences choose the units.
    history
        What is shown.
    says
        What it shows, for those who do not see it; different for each chart of a view.
    loop
        The loop that it begins with: the names of its channels, x and y. Over time where none is
        given; a loop is then that of the first voltage and the first channel that is none.
    """

    def __init__(
        self,
        page: Page,
        history: LiveHistory,
        *,
        says: str = "Live chart",
        loop: tuple[str, str] | None = None,
    ) -> None:
        super().__init__()
        # pages are answered as long as somebody holds it
        self._history = history
        self._views = page.session.state(ChartViews).views
        self._key = (says, *(channel.name for channel in history.channels))
        self.classes("live-chart")
        self.props["address"] = page.panel.state(SharedHistories).add(history)
        self.props["channels"] = [described(page, channel) for channel in history.channels]
        self.props["rate"], self.props["seconds"] = history.rate_hz, history.seconds
        self.props["windows"], self.props["says"] = list(WINDOWS), says
        self.props["begins"] = "loop" if loop else "time"
        self.props["pair"] = _pair(history, loop)
        self.props["view"] = self._views.get(self._key, {})
        self.on("view", self._keep)

    def _keep(self, event: GenericEventArguments) -> None:
        self._views[self._key] = event.args


def _pair(history: LiveHistory, loop: tuple[str, str] | None) -> list[int]:
    """Return the places of the channels of a loop."""
    names = [channel.name for channel in history.channels]
    if loop is None:
        # what is driven, and the first that follows it
        driven = [channel.quantity == VOLTAGE for channel in history.channels]
        mixed = len({*driven}) > 1
        return [driven.index(True), driven.index(False)] if mixed else [0, len(names) - 1]
    for name in loop:
        if name not in names:
            raise ModelError(f"there is no channel '{name}' to show: there are {', '.join(names)}")
    return [names.index(name) for name in loop]


def described(page: Page, channel: LiveChannel) -> dict[str, Any]:
    """Return a channel as the script of the chart takes it, in the units of the page."""
    shown = page.preferences.shown(channel.quantity)
    return {
        "name": channel.name,
        "quantity": shown.name,
        "label": shown.label,
        "unit": shown.shown_unit,
        "factor": shown.factor,
    }
