"""How far the figures may be off: meshes that were refined, and estimates of errors."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nicegui import ui

from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.quantities.comparison import title_of
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Table, table
from flexstage.web.analyse.state import AnalyseState
from flexstage.web.analyse.work import Analysed
from flexstage.web.figures import picture, show_table
from flexstage.web.page import Page, div, quiet_button
from flexstage.web.preferences import Preferences

#: What the mesh of a model is refined to where it is not said [1].
USUAL_ACCURACY = 0.005


class Convergence:
    """What is known of the errors of what was found.

    Parameters
    ----------
    page
        The page.
    start
        Starts a model with what is asked for now.
    """

    def __init__(self, page: Page, start: Callable[[str], bool]) -> None:
        self._page = page
        self._state = page.session.state(AnalyseState)
        self._start = start
        self._place = div("full-width stacked")

    def show(self, found: dict[str, Analysed]) -> None:
        """Show what is known."""
        self._place.clear()
        refined = [one for one in found.values() if one.convergence]
        estimated = [one for one in found.values() if one.options.estimate]
        with self._place:
            for one in refined:
                picture(one.convergence)
                show_table(meshes_table(self._page.preferences, one))
            for one in (*refined, *estimated):
                with ui.expansion(f"Estimated errors, {title_of(one.model)}", value=True):
                    show_table(errors_table(self._page.preferences, one))
            if not refined:
                ui.label(
                    "Refine the mesh of a model of finite elements to see how its figures settle."
                ).classes("muted")
                ui.button(
                    f"Refine {title_of('plane')}",
                    on_click=lambda: self._ask("plane", accuracy=USUAL_ACCURACY),
                ).classes("own-width")
            if not estimated:
                ui.label(
                    "Condensed bodies estimate their errors by a lower order and more modes."
                ).classes("muted")
                quiet_button(
                    "Estimate errors", on_click=lambda: self._ask("superelement", estimate=True)
                ).props("outline").classes("own-width")

    def _ask(self, model: str, **asked: Any) -> None:
        self._state.asked = replace(self._state.asked, **asked)
        self._start(model)


def meshes_table(preferences: Preferences, one: Analysed) -> Table:
    """Return the meshes of a model that was refined, and the quantity that was asked for."""
    found = one.results["refinement"]
    quantity = preferences.shown(found["quantity"])
    steps = found["steps"]
    axes = [v["axis"] for v in steps[-1]["values"] if v["quantity"] == quantity.name]
    rows = []
    for step in steps:
        values = {v["axis"]: v["value"] for v in step["values"] if v["quantity"] == quantity.name}
        rows.append(
            [
                str(step["order"]), number(step["neck_size"], 2), str(step["unknowns"]),
                number(step["seconds"], 2), *(quantity.text(values.get(axis)) for axis in axes),
            ]
        )  # fmt: skip
    heads = ["order", "element / neck [1]", "unknowns", "time [s]"]
    heads += [f"{quantity.heading}{'' if axis == WHOLE_STAGE else f', {axis}'}" for axis in axes]
    return table("", heads, rows)


def errors_table(preferences: Preferences, one: Analysed) -> Table:
    """Return the estimated error of each figure of a model."""
    rows = []
    for row in one.analysis.characteristics:
        if not row.uncertainty:
            continue  # none is known, or nothing is uncertain
        shown = preferences.shown(row.quantity)
        share = f"{number(100.0 * row.uncertainty / abs(row.value), 2)} %" if row.value else "–"
        spread = number(row.uncertainty * shown.factor, 2)
        axis = "" if row.axis == WHOLE_STAGE else row.axis
        rows.append([shown.heading, axis, shown.text(row.value), spread, share])
    return table("", ["figure", "<axis", "value", "± estimate", "share"], rows)
