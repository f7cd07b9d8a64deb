"""The distribution of a figure among the stages of a lot, while they are drawn."""

from typing import Any

import numpy as np
from nicegui import ui

from flexstage.arrays import Array
from flexstage.explore.batches import FinishedBatch
from flexstage.explore.figures import Figure
from flexstage.explore.tolerance import Lot
from flexstage.report.figures.style import CYCLE
from flexstage.web.explore.charts import Chart
from flexstage.web.explore.state import Run
from flexstage.web.figures import chart
from flexstage.web.pictures import chart_figure
from flexstage.web.preferences import Preferences

_BINS = 40


class LotChart:
    """A histogram that fills, and a field for its figure.

    Parameters
    ----------
    run, preferences
        The run, and units.
    """

    def __init__(self, run: Run, preferences: Preferences) -> None:
        self._run, self._preferences = run, preferences
        self._box = ui.column().classes("full-width")
        self._plot: ui.plotly | None = None
        self._count: ui.label | None = None
        self.show()

    def show(self) -> None:
        """Show what was drawn so far."""
        found = self._run.job.found
        lot = next((each for each in found if isinstance(each, Lot)), None)
        batches = [each for each in found if isinstance(each, FinishedBatch)]
        if lot is None or not batches:
            return
        values = lot.corrected(np.concatenate([each.arrays["values"] for each in batches]))
        if self._plot is None:
            self._begin(lot.figures)
        names = [figure.name for figure in lot.figures]
        at = names.index(self._run.up)
        assert self._plot is not None
        assert self._count is not None
        self._count.text = f"{len(values)} stages"
        figure = lot.figures[at]
        self._plot.update_figure(chart_figure(*histogram(figure, values[:, at], self._preferences)))

    def _begin(self, figures: tuple[Figure, ...]) -> None:
        run, names = self._run, {f.name: f.label for f in figures}
        if run.up not in names:
            frequencies = (name for name in names if name.startswith("natural_frequency"))
            run.up = next(frequencies, next(iter(names)))

        def choose(event: Any) -> None:
            run.up = event.value
            self.show()

        with self._box:
            with ui.row().classes("items-center controls"):
                field = ui.select(names, value=run.up, label="Figure", on_change=choose)
                field.props("dense options-dense outlined")
                self._count = ui.label().classes("muted small")
            empty = histogram(figures[0], np.zeros(0), self._preferences)
            self._plot = chart(*empty, "Distribution of a figure among the stages").classes("tall")


def histogram(figure: Figure, values: Array, preferences: Preferences) -> Chart:
    """Return how values of a figure are distributed; those of what is no stage are left out."""
    shown = preferences.shown(figure.shown)
    known = values[np.isfinite(values)] * shown.factor
    counts, edges = np.histogram(known, bins=_BINS) if known.size else (np.zeros(1), np.zeros(2))
    bars = {
        "type": "bar", "x": (0.5 * (edges[1:] + edges[:-1])).tolist(),
        "y": (100.0 * counts / max(len(values), 1)).tolist(),
        "marker": {"color": CYCLE[0]}, "hoverinfo": "x+y", "showlegend": False,
    }  # fmt: skip
    return [bars], {
        "xaxis": {"title": {"text": figure.heading_in(shown)}},
        "yaxis": {"title": {"text": "Stages in a bin [%]"}},
        "bargap": 0.05,
    }
