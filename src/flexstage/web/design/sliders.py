"""A slider for each parameter of a stage, with the sensitivity of the figures."""

from collections.abc import Callable
from html import escape

import numpy as np
from nicegui import events, ui

from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.variables import Variable, is_data_sheet
from flexstage.web.design.state import FIRST, FIRST_OPEN, DesignState
from flexstage.web.design.work import SLIDER_FIGURES
from flexstage.web.page import PanelHeading, choice, div

_DIGITS = 5
_WHOLE_STAGE = "whole stage"
_EFFECTIVE, _OTHERS = "most effective dimensions", "other dimensions"
_ORDERS = {"": "stage file"} | {
    name: f"by {name}" for name in dict.fromkeys(SLIDER_FIGURES.values())
}


class _Slider(ui.slider):
    """A slider that moves in the browser without an answer of the server."""

    LOOPBACK = False


class Sliders:
    """The sliders of the open stage.

    Parameters
    ----------
    state
        State of the view.
    on_change
        Called after a change of the variant.
    """

    def __init__(self, state: DesignState, on_change: Callable[[], object]) -> None:
        self._state, self._on_change = state, on_change
        self._rows: dict[str, tuple[Variable, ui.slider, ui.number, ui.html]] = {}
        with ui.row().classes("items-center heading"):
            PanelHeading("Parameters")
            self._axis = ui.toggle([], on_change=self._choose_axis).props("dense no-caps")
            choice(_ORDERS, state.order, "Order", self._choose_order).classes("order")
        names = "".join(f"<span>{name}</span>" for name in dict.fromkeys(SLIDER_FIGURES.values()))
        ui.html(
            "<span>% change of each figure per 1 % change of the parameter</span>"
            f'<div class="slopes">{names}</div>',
            sanitize=False,
        ).classes("slopes-head muted small")
        self._list = div("sliders")

    def build(self) -> None:
        """Rebuild the sliders, for another stage or order."""
        self._list.clear()
        self._rows.clear()
        axes = [axis.name for axis in self._state.now.template.stage().axes]
        if self._state.axis not in axes:
            self._state.axis = axes[0] if axes else ""
        self._axis.set_options(axes, value=self._state.axis or None)
        self._axis.visible = len(axes) > 1
        with self._list:
            self._build_rows()
        self.show_slopes()

    def _build_rows(self) -> None:
        variables = self._state.variables
        if not variables:
            ui.label(
                "No parameter can be changed: the stage file has no named dimensions."
            ).classes("muted")
        slopes_of_variant = self._state.slopes.get(self._state.now)
        if self._state.order and slopes_of_variant is not None:

            def strength(variable: Variable) -> float:
                slopes = _elasticities(slopes_of_variant, variable.name, self._state.axis)
                return abs(slopes[self._state.order] or 0.0)

            for variable in sorted(variables, key=strength, reverse=True):
                self._row(variable, variable.name)
            return
        groups: dict[str, list[Variable]] = {}
        is_first = self._state.now.template.source == FIRST
        for variable in variables:
            group = variable.name.rpartition(".")[0]
            if is_first and not is_data_sheet(group):
                group = _EFFECTIVE if variable.name in FIRST_OPEN else _OTHERS
            groups.setdefault(group, []).append(variable)
        groups = {name: groups[name] for name in sorted(groups, key=lambda n: n != _EFFECTIVE)}
        for index, (group, members) in enumerate(groups.items()):
            if len(groups) == 1:
                for variable in members:
                    self._row(variable, variable.name)
                continue
            # data-sheet values are seldom changed
            is_open = index < 3 and group != _OTHERS and not is_data_sheet(group)
            with ui.expansion(group or _WHOLE_STAGE, value=is_open).classes("group"):
                for variable in members:
                    name = variable.name.removeprefix(f"{group}.")
                    self._row(variable, name.replace(".", " "))

    def _row(self, variable: Variable, label: str) -> None:
        factor = variable.factor
        low, high, value = (
            v * factor for v in (variable.low, variable.high, self._state.value(variable))
        )
        step = (high - low) / 240.0
        heading = variable.heading
        unit = escape(heading.removeprefix(variable.name))
        with div("slider"):
            name = ui.html(
                f'{escape(label.replace("_", " "))}<span class="muted">{unit}</span>',
                sanitize=False,
            )
            name.props["title"] = f"{heading}: {variable.description}"
            slider = _Slider(min=low, max=high, step=step, value=value)
            slider.props["aria-label"] = heading
            field = ui.number(value=_rounded(value), step=step)
            field.props("dense borderless input-class=number debounce=400")
            field.props["aria-label"] = f"Value of {heading}"
            slopes = ui.html("", sanitize=False).classes("slopes number small")
        slider.on_value_change(lambda e: self._set(variable, e.value, slider))
        field.on_value_change(lambda e: self._set(variable, e.value, field))
        self._rows[variable.name] = (variable, slider, field, slopes)

    def _set(self, variable: Variable, displayed: float | None, source: ui.element) -> None:
        if displayed is None:
            return
        present = self._state.value(variable) * variable.factor
        if abs(displayed - present) <= 10.0**-_DIGITS * abs(present):
            return
        nominal = variable.usual
        value = displayed / variable.factor
        value = nominal if abs(value - nominal) <= 1e-9 * abs(nominal) else value
        self._state.show(self._state.now.changed(variable.name, value, nominal))
        _, slider, field, _ = self._rows[variable.name]
        if source is slider:
            field.value = _rounded(displayed)
        else:
            slider.value = displayed
        self.show_slopes()
        self._on_change()

    def sync(self) -> None:
        """Set all sliders to the values of the variant, after an undo."""
        for variable, slider, field, _ in self._rows.values():
            value = self._state.value(variable) * variable.factor
            slider.value, field.value = value, _rounded(value)
        self.show_slopes()

    def show_slopes(self) -> None:
        """Show the sensitivities; while they are unknown, keep those of the last variant."""
        slopes = self._state.slopes.get(self._state.now)
        if slopes is None:
            self._list.classes(add="passed")
            return
        self._list.classes(remove="passed")
        for name, (_, _, _, cells) in self._rows.items():
            cells.content = _cells(slopes, name, self._state.axis)

    def _choose_axis(self, event: events.ValueChangeEventArguments) -> None:
        if event.value and event.value != self._state.axis:
            self._state.axis = event.value
            self.build() if self._state.order else self.show_slopes()

    def _choose_order(self, event: events.ValueChangeEventArguments) -> None:
        self._state.order = event.value
        self.build()


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _elasticities(slopes: Sensitivities, name: str, axis: str) -> dict[str, float | None]:
    """Return the change of each figure in per cent per 1 % change of a parameter."""
    values: dict[str, float | None] = dict.fromkeys(SLIDER_FIGURES.values())
    column = next((k for k, v in enumerate(slopes.variables) if v.name == name), None)
    for row, figure in enumerate(slopes.figures):
        if figure.axis == axis and column is not None:
            value = float(slopes.elasticities[row, column])
            values[SLIDER_FIGURES[figure.quantity]] = value if np.isfinite(value) else None
    return values


def _cells(slopes: Sensitivities, name: str, axis: str) -> str:
    cells = []
    for value in _elasticities(slopes, name, axis).values():
        # strong sensitivities are highlighted
        mark = ' class="strong"' if value is not None and abs(value) >= 0.3 else ""
        cells.append(f"<span{mark}>{_elasticity(value)}</span>")
    return "".join(cells)


def _elasticity(value: float | None) -> str:
    if value is None:
        return "·"
    return "0" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")
