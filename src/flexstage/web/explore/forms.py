"""The forms of the view Explore."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from nicegui import ui

from flexstage.files.request import request_fields
from flexstage.quantities.comparison import MODEL_WORDS
from flexstage.report.tolerance import scatter_text
from flexstage.studies.explore.deviations import KINDS as DEVIATIONS
from flexstage.studies.explore.optimise.ladder import SearchOptions
from flexstage.studies.explore.requests import (
    ExploreRequest,
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.sampling import usual_plan
from flexstage.studies.explore.sweep import usual_cost
from flexstage.studies.explore.variables import Variable, variables_of
from flexstage.studies.explore.workers import duration
from flexstage.virtual.imperfections import Scatter
from flexstage.web.explore.stage_summary import StageSummary
from flexstage.web.explore.state import (
    ExploreForm,
    RangeInput,
    RequirementInput,
)
from flexstage.web.page import Page, PanelHeading, div, quiet_button, remark
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

    def __init__(self, facts: StageSummary, page: Page, changed: Callable[[], object]) -> None:
        self.facts, self._page, self.changed = facts, page, changed
        self.preferences = page.preferences

    def headings(self, names: Iterable[str]) -> dict[str, str]:
        """Return what figures are called, with their units."""
        figures = self.facts.figures
        return {
            name: figures[name].heading_in(self.preferences.shown(figures[name].shown))
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

    def bounds(self, row: RangeInput, variable: Variable) -> None:
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
        rows: list[RequirementInput],
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
            rows.append(RequirementInput(figure, sign, self.facts.values[figure]))
            show()
            self.changed()

        def drop(row: RequirementInput) -> None:
            rows.remove(row)
            show()
            self.changed()

        show()

    def _limit(
        self,
        row: RequirementInput,
        options: Mapping[str, str],
        signs: Mapping[str, str],
        again: Callable[[], None],
        drop: Callable[[RequirementInput], None] | None,
    ) -> None:
        shown = self.preferences.shown(self.facts.figures[row.figure].shown)

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


_MOST = 8  # parameters of a sweep


def build_form(form: ExploreForm, fields: Fields) -> None:
    """Make the fields of a form."""
    form.wrong.clear()  # the fields are made anew from what was taken
    match form.request:
        case SweepRequest():
            _sweep(form, fields)
        case OptimiseRequest():
            _optimise(form, form.request, fields)
        case ToleranceRequest():
            _tolerance(form, fields)
        case SensitivityRequest():
            _sensitivity(form, fields)


def what_it_takes(request: ExploreRequest, facts: StageSummary) -> str:
    """Say how much work is asked for."""
    match request:
        case SweepRequest():
            over = variables_of(facts.template, request.over)
            points = len(usual_plan(over, request.model, samples=request.samples).points(over))
            seconds = max(1.0, points * usual_cost(request.model))
            return f"{points} points, about {duration(seconds)}"
        case OptimiseRequest():
            most = SearchOptions(evaluations=request.evaluations)
            most = most.budget(len(request.over or facts.flexure))
            return f"up to {most} evaluations; what is best so far is kept when it is cancelled"
        case ToleranceRequest():
            return f"{request.samples} stages"
        case SensitivityRequest():
            lumped = request.model == "lumped"
            return "some seconds" if lumped else "two analyses of each parameter"


def _sweep(form: ExploreForm, fields: Fields) -> None:
    facts = fields.facts
    PanelHeading("Over: what is varied", 3)
    box = div("rows")
    names = {name: name.replace("_", " ") for name in facts.variables}

    def show() -> None:
        box.clear()
        with box:
            for row in form.over:
                with div("vary"):
                    with div("over"):
                        choice = ui.select(names, value=row.name, with_input=True)
                        choice.props("outlined dense options-dense")
                        choice.props["aria-label"] = "Parameter"
                        choice.on_value_change(lambda event, row=row: choose(row, event.value))
                        remove = quiet_button(icon="close", on_click=lambda row=row: drop(row))
                        remove.props("dense").props["aria-label"] = f"Remove {row.name}"
                        remove.visible = len(form.over) > 1
                    fields.bounds(row, facts.variables[row.name])
                    if len(form.over) <= 2:
                        count = fields.number(
                            "values", row.count, lambda v, row=row: setattr(row, "count", v),
                            whole=True, min=2, max=400,
                            placeholder=str(25 if len(form.over) == 1 else 20),
                        ).props("stack-label")  # fmt: skip
                        count.props["aria-label"] = f"Number of values of {row.name}"
            if len(form.over) < min(_MOST, len(names)):
                quiet_button("Vary one more", icon="add", on_click=more).props("dense")
            if len(form.over) > 2:
                fields.of(form).number("samples", "256")

    def choose(row: RangeInput, name: str | None) -> None:
        if name and name not in {other.name for other in form.over}:
            row.name, row.low, row.high = name, None, None
        again()

    def more() -> None:
        taken = {row.name for row in form.over}
        left = [name for name in names if name not in taken]
        first = [name for name in left if "neck" in name and name in facts.flexure] or left
        form.over.append(RangeInput(first[0]))
        again()

    def drop(row: RangeInput) -> None:
        form.over.remove(row)
        again()

    def again() -> None:
        if len(form.over) > 2:
            for row in form.over:
                row.count = None
        else:
            form.take("samples", None)
        show()
        fields.changed()

    show()
    fields.figures(form, facts.figures)
    fields.model(form, f"closer, about {usual_cost('superelement'):g} s a point")


def _optimise(form: ExploreForm, request: OptimiseRequest, fields: Fields) -> None:
    facts = fields.facts
    PanelHeading("What is sought", 3)
    fields.limits(form.goals, facts.figures, "One more goal", WAYS, at_least=1)
    PanelHeading("Keep: what is required", 3)
    left_out = set(request.without)

    def tick(name: str, event: Any) -> None:
        (left_out.discard if event.value else left_out.add)(name)
        form.take("without", tuple(name for name in facts.unasked if name in left_out))
        fields.changed()

    with div("rows"):
        for name, words in facts.unasked.items():
            box = ui.checkbox(words, value=name not in left_out).props("dense")
            box.on_value_change(partial(tick, name))
        remark("Without: those that have no tick")
    fields.limits(form.limits, facts.figures, "One more requirement")
    fold = ui.expansion().classes("group full-width")
    fold.on_value_change(lambda: _chosen(form, fields, fold, names))
    with fold:
        names = div("rows")
    _count(form, fold)
    fields.model(form, "corrects the rigid ones, takes some minutes")
    starts = {"described": "the stage as it is", "middle": "the middle of all bounds"}
    own = fields.of(form)
    own.choice("start", starts).classes("full-width")
    usual = SearchOptions().budget(len(form.chosen))
    own.number("evaluations", str(usual)).classes("full-width")


def _count(form: ExploreForm, fold: ui.expansion) -> None:
    fold.text = f"Over: {len(form.chosen)} of {len(form.over)} parameters, and their bounds"


def _chosen(form: ExploreForm, fields: Fields, fold: ui.expansion, box: ui.element) -> None:
    """Show what may change, once it is asked for: a stage has many parameters."""
    if not fold.value or list(box):
        return

    def toggle(row: RangeInput, event: Any) -> None:
        row.is_chosen = event.value
        fields.changed()
        _count(form, fold)

    with box:
        for row in form.over:
            with div("vary chosen"):
                choice = ui.checkbox(row.name.replace("_", " "), value=row.is_chosen)
                choice.props("dense").on_value_change(partial(toggle, row))
                fields.bounds(row, fields.facts.variables[row.name])


def _tolerance(form: ExploreForm, fields: Fields) -> None:
    facts = fields.facts
    of_lots = [name for name in facts.figures if name in facts.of_lots]
    PanelHeading("Require: what a good stage has", 3)
    fields.limits(form.limits, of_lots, "One more requirement")
    own = fields.of(form)
    own.number("samples").classes("full-width")
    own.number("target_yield", "none: the tolerances as they are").classes("full-width")
    _scatter(form, fields)
    fields.figures(form, of_lots)
    fields.model(form, "corrects the rigid ones, one analysis more")


def _scatter(form: ExploreForm, fields: Fields) -> None:
    """Show the standard deviations of the workshop, as they are typed."""
    assert isinstance(form.request, ToleranceRequest)
    given = dict(pair.split("=", 1) for pair in form.request.scatter)

    def take(name: str, event: Any) -> None:
        given[name] = (event.value or "").strip()
        form.take("scatter", tuple(f"{n}={text}" for n, text in given.items() if text))
        fields.changed()

    with ui.expansion("Scatter: standard deviations of the workshop").classes("group full-width"):
        for kind in DEVIATIONS:
            field = ui.input(
                kind.label[0].upper() + kind.label[1:],
                value=given.get(kind.name, ""),
                placeholder=scatter_text(Scatter(), kind.name),
            ).props("outlined dense stack-label debounce=400")
            field.classes("full-width").on_value_change(partial(take, kind.name))


def _sensitivity(form: ExploreForm, fields: Fields) -> None:
    own = fields.of(form)
    own.tick("hinges", "neck and place of each, in place of the parameters")
    own.number("per", "1 % of each; 10 µm of hinges").classes("full-width")
    fields.figures(form, fields.facts.figures)
    fields.model(form, "closer, two analyses of each parameter")
