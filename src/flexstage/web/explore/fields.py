"""Fields that several forms of the view Explore have."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from nicegui import ui

from flexstage.files.request import request_fields
from flexstage.quantities.comparison import MODEL_WORDS
from flexstage.studies.explore.requests import OptimiseRequest
from flexstage.studies.explore.variables import Variable
from flexstage.web.explore.facts import StageFacts
from flexstage.web.explore.state import ExploreForm, LimitWords, RangeWords
from flexstage.web.page import Page, div, quiet_button
from flexstage.web.request_form import RequestForm

_FIELD = "outlined dense options-dense"
_SIGNS = {">=": "≥", "<=": "≤", "=": "="}
#: What is sought of a figure.
WAYS = {
    name: request_fields(OptimiseRequest)[name].label for name in ("maximise", "minimise", "match")
}


class Fields:
    """What fields of a form need: the stage, units, and what is called when one was changed.

    Parameters
    ----------
    facts, page, changed
        The stage, the page, and the function.
    """

    def __init__(self, facts: StageFacts, page: Page, changed: Callable[[], object]) -> None:
        self.facts, self._page, self.changed = facts, page, changed
        self.preferences = page.preferences

    def headings(self, names: Iterable[str]) -> dict[str, str]:
        """Return what figures are called, with their units."""
        figures = self.facts.figures
        return {
            name: figures[name].heading_in(self.preferences.shown(figures[name].display))
            for name in names
        }

    def figures(self, form: ExploreForm, names: Iterable[str]) -> None:
        """Show which figures are looked at."""
        options = self.headings(names)
        field = ui.select(options, value=list(form.of), multiple=True, label="Figures")
        field.props(_FIELD).classes("full-width")

        def show() -> None:
            usual = tuple(form.of) == self.facts.usual
            words = f"{len(form.of)} figures" + (", the usual ones" if usual else "")
            field.props["display-value"] = words
            field.update()

        def take(event: Any) -> None:
            form.of[:] = [name for name in options if name in event.value]
            show()
            self.changed()

        field.on_value_change(take)
        show()

    def model(self, form: ExploreForm, finer: str) -> None:
        """Show by which model: rigid bodies, or condensed ones, which cost more."""
        remarks = {"lumped": "quick, some per cent off", "superelement": finer}
        options = {name: f"{MODEL_WORDS[name]}: {remark}" for name, remark in remarks.items()}
        self.of(form).choice("model", options).classes("full-width")

    def of(self, form: ExploreForm) -> RequestForm:
        """Return what makes the fields of its request."""

        def take(name: str, value: Any) -> None:
            form.take(name, value)
            self.changed()

        return RequestForm(self._page, lambda: form.request, take)

    def number(
        self,
        label: str | None,
        value: float | None,
        take: Callable[[float | None], object],
        *,
        whole: bool = False,
        **given: Any,
    ) -> ui.number:
        """Show a number; a field that is emptied has none."""
        field = ui.number(label, value=value, **given).props("outlined dense debounce=300")

        def changed(event: Any) -> None:
            number = event.value
            take(None if number is None else int(number) if whole else float(number))
            self.changed()

        return field.on_value_change(changed)

    def bounds(self, row: RangeWords, variable: Variable) -> None:
        """Show the bounds of a parameter, in its unit."""
        factor = variable.factor

        def take(name: str, usual: float) -> Callable[[float | None], None]:
            def taken(value: float | None) -> None:
                given = usual if value is None else value / factor
                same = abs(given - usual) <= 1e-5 * abs(usual)
                setattr(row, name, None if same else given)

            return taken

        for name, label, bound, usual in zip(
            ("low", "high"), ("from", "to"), row.bounds(variable), (variable.low, variable.high),
            strict=True,
        ):  # fmt: skip
            field = self.number(label, float(f"{bound * factor:.6g}"), take(name, usual))
            field.props["aria-label"] = f"{variable.name} {label} [{variable.unit or '1'}]"
        ui.label(variable.heading.partition(" [")[2].rstrip("]")).classes("muted unit")

    def limits(
        self,
        rows: list[LimitWords],
        names: Iterable[str],
        add: str,
        signs: Mapping[str, str] = _SIGNS,
        *,
        at_least: int = 0,
    ) -> None:
        """Show what is required of figures, or sought of them, with buttons to add and remove."""
        options = self.headings(names)
        box = div("rows")

        def show() -> None:
            box.clear()
            with box:
                for row in rows:
                    self._limit(row, options, signs, show, None if len(rows) <= at_least else drop)
                quiet_button(add, icon="add", on_click=more).props("dense")

        def more() -> None:
            taken = {row.figure for row in rows}
            left = [n for n in (*self.facts.usual, *options) if n in options and n not in taken]
            stress = [name for name in left if name.startswith("max_stress")]
            figure = (stress or left or list(options))[0]
            sign = list(signs)[bool(stress)]  # what should be small, and at most so much
            rows.append(LimitWords(figure, sign, self.facts.values[figure]))
            show()
            self.changed()

        def drop(row: LimitWords) -> None:
            rows.remove(row)
            show()
            self.changed()

        show()

    def _limit(
        self,
        row: LimitWords,
        options: Mapping[str, str],
        signs: Mapping[str, str],
        again: Callable[[], None],
        drop: Callable[[LimitWords], None] | None,
    ) -> None:
        shown = self.preferences.shown(self.facts.figures[row.figure].display)

        def choose(event: Any) -> None:
            row.figure, row.value = event.value, self.facts.values[event.value]
            again()
            self.changed()

        def turn(event: Any) -> None:
            row.sign = event.value
            if row.value is None:
                row.value = self.facts.values[row.figure]
            again()
            self.changed()

        def take(value: float | None) -> None:
            row.value = None if value is None else value / shown.factor

        has_value = row.sign not in ("maximise", "minimise")
        with div("limit" if has_value else "limit goal"):
            figure = ui.select(dict(options), value=row.figure, with_input=True)
            figure.props(_FIELD).classes("figure").props["aria-label"] = "Figure"
            figure.props["hide-dropdown-icon"] = has_value  # its name needs the room
            sign = ui.select(dict(signs), value=row.sign)
            sign.props(_FIELD).classes("sign").props["aria-label"] = f"What of {row.figure}"
            if has_value:
                value = row.value
                number = None if value is None else float(f"{value * shown.factor:.5g}")
                field = self.number(None, number, take)
                field.props["aria-label"] = f"Value of {row.figure} [{shown.shown_unit or '1'}]"
            if drop is not None:
                remove = quiet_button(icon="close", on_click=lambda: drop(row)).props("dense")
                remove.props["aria-label"] = f"Remove {row.figure}"
        figure.on_value_change(choose)
        sign.on_value_change(turn)
