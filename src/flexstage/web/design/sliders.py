"""A slider for each parameter of a stage, and beside it what it does to the figures."""

from collections.abc import Callable
from html import escape

import numpy as np
from nicegui import events, ui

from flexstage.studies.explore.sensitivity import Sensitivities
from flexstage.studies.explore.variables import Variable, is_data_sheet
from flexstage.web.design.state import FIRST, FIRST_OPEN, DesignState
from flexstage.web.design.work import BESIDE
from flexstage.web.page import PanelHeading, choice, div

_DIGITS = 5
_OF_ALL = "whole stage"
_FIRST, _OTHERS = "what moves the figures", "other dimensions"
_ORDERS = {"": "as described"} | {name: f"by {name}" for name in dict.fromkeys(BESIDE.values())}


class _Slider(ui.slider):
    """A slider that the browser moves itself: it does not wait for the server to say so."""

    LOOPBACK = False


class Sliders:
    """The sliders of the stage that is open.

    Parameters
    ----------
    state
        What is open.
    moved
        Called after a slider has changed the variant.
    """

    def __init__(self, state: DesignState, moved: Callable[[], object]) -> None:
        self._state, self._moved = state, moved
        self._rows: dict[str, tuple[Variable, ui.slider, ui.number, ui.html]] = {}
        with ui.row().classes("items-center heading"):
            PanelHeading("Parameters")
            self._axis = ui.toggle([], on_change=self._choose_axis).props("dense no-caps")
            choice(_ORDERS, state.order, "Order", self._choose_order).classes("order")
        names = "".join(f"<span>{name}</span>" for name in dict.fromkeys(BESIDE.values()))
        ui.html(
            f'<span>% of each figure per 1 % of the parameter</span><div class="slopes">{names}'
            "</div>",
            sanitize=False,
        ).classes("slopes-head muted small")
        self._list = div("sliders")

    def build(self) -> None:
        """Make the sliders anew, for another stage or in another order."""
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
                "No parameter can be changed here: the stage file gives its dimensions no names."
            ).classes("muted")
        found = self._state.slopes.get(self._state.now)
        if self._state.order and found is not None:

            def strength(variable: Variable) -> float:
                slopes = _elasticities(found, variable.name, self._state.axis)
                return abs(slopes[self._state.order] or 0.0)

            for variable in sorted(variables, key=strength, reverse=True):
                self._row(variable, variable.name)
            return
        groups: dict[str, list[Variable]] = {}
        is_first = self._state.now.template.source == FIRST
        for variable in variables:
            group = variable.name.rpartition(".")[0]
            if is_first and not is_data_sheet(group):
                group = _FIRST if variable.name in FIRST_OPEN else _OTHERS
            groups.setdefault(group, []).append(variable)
        groups = {name: groups[name] for name in sorted(groups, key=lambda n: n != _FIRST)}
        for place, (group, members) in enumerate(groups.items()):
            if len(groups) == 1:
                for variable in members:
                    self._row(variable, variable.name)
                continue
            # what is bought is seldom changed
            is_open = place < 3 and group != _OTHERS and not is_data_sheet(group)
            with ui.expansion(group or _OF_ALL, value=is_open).classes("group"):
                for variable in members:
                    name = variable.name.removeprefix(f"{group}.")
                    self._row(variable, name.replace(".", " "))

    def _row(self, variable: Variable, label: str) -> None:
        factor = variable.factor
        low, high, value = (
            v * factor for v in (variable.low, variable.high, self._state.value(variable))
        )
        step = (high - low) / 240.0
        said = variable.heading
        unit = escape(said.removeprefix(variable.name))
        with div("slider"):
            name = ui.html(
                f'{escape(label.replace("_", " "))}<span class="muted">{unit}</span>',
                sanitize=False,
            )
            name.props["title"] = f"{said}: {variable.description}"
            slider = _Slider(min=low, max=high, step=step, value=value)
            slider.props["aria-label"] = said
            field = ui.number(value=_shown(value), step=step)
            field.props("dense borderless input-class=number debounce=400")
            field.props["aria-label"] = f"Value of {said}"
            slopes = ui.html("", sanitize=False).classes("slopes number small")
        slider.on_value_change(lambda e: self._set(variable, e.value, slider))
        field.on_value_change(lambda e: self._set(variable, e.value, field))
        self._rows[variable.name] = (variable, slider, field, slopes)

    def _set(self, variable: Variable, shown: float | None, source: ui.element) -> None:
        if shown is None:
            return
        now = self._state.value(variable) * variable.factor
        if abs(shown - now) <= 10.0**-_DIGITS * abs(now):
            return
        usual = variable.usual
        value = shown / variable.factor
        value = usual if abs(value - usual) <= 1e-9 * abs(usual) else value
        self._state.show(self._state.now.changed(variable.name, value, usual))
        _, slider, field, _ = self._rows[variable.name]
        if source is slider:
            field.value = _shown(shown)
        else:
            slider.value = shown
        self.show_slopes()
        self._moved()

    def sync(self) -> None:
        """Put all sliders to the values of the variant, after an undo."""
        for variable, slider, field, _ in self._rows.values():
            value = self._state.value(variable) * variable.factor
            slider.value, field.value = value, _shown(value)
        self.show_slopes()

    def show_slopes(self) -> None:
        """Show what each parameter does; of a variant of which that is not known yet, the last."""
        found = self._state.slopes.get(self._state.now)
        if found is None:
            self._list.classes(add="passed")
            return
        self._list.classes(remove="passed")
        for name, (_, _, _, cells) in self._rows.items():
            cells.content = _cells(found, name, self._state.axis)

    def _choose_axis(self, event: events.ValueChangeEventArguments) -> None:
        if event.value and event.value != self._state.axis:
            self._state.axis = event.value
            self.build() if self._state.order else self.show_slopes()

    def _choose_order(self, event: events.ValueChangeEventArguments) -> None:
        self._state.order = event.value
        self.build()


def _shown(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _elasticities(found: Sensitivities, name: str, axis: str) -> dict[str, float | None]:
    """Return per cent of each figure beside the sliders per per cent of a parameter."""
    out: dict[str, float | None] = dict.fromkeys(BESIDE.values())
    column = next((k for k, v in enumerate(found.variables) if v.name == name), None)
    for row, figure in enumerate(found.figures):
        if figure.axis == axis and column is not None:
            value = float(found.elasticities[row, column])
            out[BESIDE[figure.quantity]] = value if np.isfinite(value) else None
    return out


def _cells(found: Sensitivities, name: str, axis: str) -> str:
    cells = []
    for value in _elasticities(found, name, axis).values():
        # what is set off
        strong = ' class="strong"' if value is not None and abs(value) >= 0.3 else ""
        cells.append(f"<span{strong}>{_elasticity(value)}</span>")
    return "".join(cells)


def _elasticity(value: float | None) -> str:
    if value is None:
        return "·"
    return "0" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")
