"""Forms of the view Explore: sweep, optimisation, tolerance and sensitivity analysis."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from nicegui import ui

from flexstage.files.request import request_fields
from flexstage.quantities.comparison import MODEL_WORDS
from flexstage.report.tolerance import scatter_text
from flexstage.studies.explore.deviations import KINDS as DEVIATIONS
from flexstage.studies.explore.optimise.multi_fidelity import SearchOptions
from flexstage.studies.explore.requests import (
    ExploreRequest,
    OptimiseRequest,
    SensitivityRequest,
    SweepRequest,
    ToleranceRequest,
)
from flexstage.studies.explore.sampling import usual_plan
from flexstage.studies.explore.sweep import typical_seconds
from flexstage.studies.explore.variables import Variable, variables_of
from flexstage.studies.explore.workers import duration
from flexstage.virtual.imperfections import Scatter
from flexstage.web.explore.state import (
    ExploreForm,
    RangeInput,
    RequirementInput,
    StageSummary,
)
from flexstage.web.page import Page, PanelHeading, div, quiet_button, remark
from flexstage.web.request_form import RequestForm

_FIELD = "outlined dense options-dense"
_RELATIONS = {">=": "≥", "<=": "≤", "=": "="}
#: Labels of the kinds of goals.
_GOALS = {
    name: request_fields(OptimiseRequest)[name].label for name in ("maximise", "minimise", "match")
}


class FormFields:
    """Fields that several forms have, for a stage and the units of a page.

    Parameters
    ----------
    summary, page, changed
        Stage, page, and function that is called after a change.
    """

    def __init__(self, summary: StageSummary, page: Page, changed: Callable[[], object]) -> None:
        self.summary, self._page, self.changed = summary, page, changed
        self.preferences = page.preferences

    def headings(self, names: Iterable[str]) -> dict[str, str]:
        """Return the headings of figures, with their units."""
        figures = self.summary.figures
        return {
            name: figures[name].heading_in(self.preferences.displayed(figures[name].display))
            for name in names
        }

    def figures(self, form: ExploreForm, names: Iterable[str]) -> None:
        """Show the selection of figures."""
        options = self.headings(names)
        field = ui.select(options, value=list(form.figures), multiple=True, label="Figures")
        field.props(_FIELD).classes("full-width")

        def show() -> None:
            is_default = tuple(form.figures) == self.summary.default_figures
            text = f"{len(form.figures)} figures" + (" (default)" if is_default else "")
            field.props["display-value"] = text
            field.update()

        def choose(event: Any) -> None:
            form.figures[:] = [name for name in options if name in event.value]
            show()
            self.changed()

        field.on_value_change(choose)
        show()

    def model(self, form: ExploreForm, finer: str) -> None:
        """Show the choice of the model; `finer` describes the condensed finite elements."""
        remarks = {"lumped": "fast, within a few per cent", "superelement": finer}
        options = {name: f"{MODEL_WORDS[name]} ({remark})" for name, remark in remarks.items()}
        self.builder(form).choice("model", options).classes("full-width")

    def builder(self, form: ExploreForm) -> RequestForm:
        """Return the builder of the fields of its request."""

        def assign(name: str, value: Any) -> None:
            form.assign(name, value)
            self.changed()

        return RequestForm(self._page, lambda: form.request, assign)

    def number(
        self,
        label: str | None,
        value: float | None,
        assign: Callable[[float | None], object],
        *,
        is_integer: bool = False,
        **properties: Any,
    ) -> ui.number:
        """Show a number; an empty field is None."""
        field = ui.number(label, value=value, **properties).props("outlined dense debounce=300")

        def changed(event: Any) -> None:
            number = event.value
            assign(None if number is None else int(number) if is_integer else float(number))
            self.changed()

        return field.on_value_change(changed)

    def bounds(self, row: RangeInput, variable: Variable) -> None:
        """Show the bounds of a parameter in its unit."""
        factor = variable.factor

        def assigner(name: str, default: float) -> Callable[[float | None], None]:
            def assign(value: float | None) -> None:
                bound_si = default if value is None else value / factor
                is_default = abs(bound_si - default) <= 1e-5 * abs(default)
                setattr(row, name, None if is_default else bound_si)

            return assign

        for name, label, bound, default in zip(
            ("low", "high"), ("from", "to"), row.bounds(variable), (variable.low, variable.high),
            strict=True,
        ):  # fmt: skip
            field = self.number(label, float(f"{bound * factor:.6g}"), assigner(name, default))
            field.props["aria-label"] = f"{variable.name} {label} [{variable.unit or '1'}]"
        ui.label(variable.heading.partition(" [")[2].rstrip("]")).classes("muted unit")

    def requirements(
        self,
        inputs: list[RequirementInput],
        names: Iterable[str],
        add_label: str,
        relations: Mapping[str, str] = _RELATIONS,
        *,
        at_least: int = 0,
    ) -> None:
        """Show requirements or goals, with buttons to add and remove one."""
        options = self.headings(names)
        box = div("rows")

        def show() -> None:
            box.clear()
            with box:
                for row in inputs:
                    self._requirement(
                        row,
                        options,
                        relations,
                        show,
                        None if len(inputs) <= at_least else remove_row,
                    )
                quiet_button(add_label, icon="add", on_click=add_row).props("dense")

        def add_row() -> None:
            used = {row.figure for row in inputs}
            available = [
                n
                for n in (*self.summary.default_figures, *options)
                if n in options and n not in used
            ]
            stress = [name for name in available if name.startswith("max_stress")]
            figure = (stress or available or list(options))[0]
            relation = list(relations)[bool(stress)]  # stress: minimise, or an upper limit
            inputs.append(RequirementInput(figure, relation, self.summary.values[figure]))
            show()
            self.changed()

        def remove_row(row: RequirementInput) -> None:
            inputs.remove(row)
            show()
            self.changed()

        show()

    def _requirement(
        self,
        row: RequirementInput,
        options: Mapping[str, str],
        relations: Mapping[str, str],
        rebuild: Callable[[], None],
        on_remove: Callable[[RequirementInput], None] | None,
    ) -> None:
        quantity = self.preferences.displayed(self.summary.figures[row.figure].display)

        def choose_figure(event: Any) -> None:
            row.figure, row.value = event.value, self.summary.values[event.value]
            rebuild()
            self.changed()

        def choose_relation(event: Any) -> None:
            row.relation = event.value
            if row.value is None:
                row.value = self.summary.values[row.figure]
            rebuild()
            self.changed()

        def assign(value: float | None) -> None:
            row.value = None if value is None else value / quantity.factor

        has_value = row.relation not in ("maximise", "minimise")
        with div("limit" if has_value else "limit goal"):
            figure = ui.select(dict(options), value=row.figure, with_input=True)
            figure.props(_FIELD).classes("figure").props["aria-label"] = "Figure"
            figure.props["hide-dropdown-icon"] = has_value  # room for the name
            relation = ui.select(dict(relations), value=row.relation)
            relation.props(_FIELD).classes("sign").props["aria-label"] = f"Relation of {row.figure}"
            if has_value:
                value = row.value
                number = None if value is None else float(f"{value * quantity.factor:.5g}")
                field = self.number(None, number, assign)
                field.props["aria-label"] = f"Value of {row.figure} [{quantity.shown_unit or '1'}]"
            if on_remove is not None:
                button = quiet_button(icon="close", on_click=lambda: on_remove(row)).props("dense")
                button.props["aria-label"] = f"Remove {row.figure}"
        figure.on_value_change(choose_figure)
        relation.on_value_change(choose_relation)


_MAX_PARAMETERS = 8  # of a sweep


def build_form(form: ExploreForm, fields: FormFields) -> None:
    """Build the fields of a form."""
    form.errors.clear()  # the new fields show the valid values
    match form.request:
        case SweepRequest():
            _sweep(form, fields)
        case OptimiseRequest():
            _optimise(form, form.request, fields)
        case ToleranceRequest():
            _tolerance(form, fields)
        case SensitivityRequest():
            _sensitivity(form, fields)


def work_estimate(request: ExploreRequest, summary: StageSummary) -> str:
    """Return the number of evaluations, and the time if it is known."""
    match request:
        case SweepRequest():
            variables = variables_of(summary.template, request.over)
            points = len(
                usual_plan(variables, request.model, samples=request.samples).points(variables)
            )
            seconds = max(1.0, points * typical_seconds(request.model))
            return f"{points} points, about {duration(seconds)}"
        case OptimiseRequest():
            search = SearchOptions(evaluations=request.evaluations)
            limit = search.budget(len(request.over or summary.flexure))
            return f"up to {limit} evaluations; Cancel keeps the best design so far"
        case ToleranceRequest():
            return f"{request.samples} simulated stages"
        case SensitivityRequest():
            is_lumped = request.model == "lumped"
            return "a few seconds" if is_lumped else "two analyses per parameter"


def _sweep(form: ExploreForm, fields: FormFields) -> None:
    summary = fields.summary
    PanelHeading("Over: varied parameters", 3)
    box = div("rows")
    names = {name: name.replace("_", " ") for name in summary.variables}

    def show() -> None:
        box.clear()
        with box:
            for row in form.ranges:
                with div("vary"):
                    with div("over"):
                        choice = ui.select(names, value=row.name, with_input=True)
                        choice.props("outlined dense options-dense")
                        choice.props["aria-label"] = "Parameter"
                        choice.on_value_change(lambda event, row=row: choose(row, event.value))
                        remove = quiet_button(
                            icon="close", on_click=lambda row=row: remove_row(row)
                        )
                        remove.props("dense").props["aria-label"] = f"Remove {row.name}"
                        remove.visible = len(form.ranges) > 1
                    fields.bounds(row, summary.variables[row.name])
                    if len(form.ranges) <= 2:
                        count = fields.number(
                            "values", row.count, lambda v, row=row: setattr(row, "count", v),
                            is_integer=True, min=2, max=400,
                            placeholder=str(25 if len(form.ranges) == 1 else 20),
                        ).props("stack-label")  # fmt: skip
                        count.props["aria-label"] = f"Number of values of {row.name}"
            if len(form.ranges) < min(_MAX_PARAMETERS, len(names)):
                quiet_button("Add parameter", icon="add", on_click=add).props("dense")
            if len(form.ranges) > 2:
                fields.builder(form).number("samples", "256")

    def choose(row: RangeInput, name: str | None) -> None:
        if name and name not in {other.name for other in form.ranges}:
            row.name, row.low, row.high = name, None, None
        rebuild()

    def add() -> None:
        used = {row.name for row in form.ranges}
        available = [name for name in names if name not in used]
        preferred = [
            name for name in available if "neck" in name and name in summary.flexure
        ] or available
        form.ranges.append(RangeInput(preferred[0]))
        rebuild()

    def remove_row(row: RangeInput) -> None:
        form.ranges.remove(row)
        rebuild()

    def rebuild() -> None:
        if len(form.ranges) > 2:
            for row in form.ranges:
                row.count = None
        else:
            form.assign("samples", None)
        show()
        fields.changed()

    show()
    fields.figures(form, summary.figures)
    fields.model(form, f"more accurate, about {typical_seconds('superelement'):g} s per point")


def _optimise(form: ExploreForm, request: OptimiseRequest, fields: FormFields) -> None:
    summary = fields.summary
    PanelHeading("Goals", 3)
    fields.requirements(form.goals, summary.figures, "Add goal", _GOALS, at_least=1)
    PanelHeading("Keep: requirements", 3)
    disabled = set(request.without)

    def toggle(name: str, event: Any) -> None:
        (disabled.discard if event.value else disabled.add)(name)
        form.assign(
            "without", tuple(name for name in summary.default_requirements if name in disabled)
        )
        fields.changed()

    with div("rows"):
        for name, words in summary.default_requirements.items():
            box = ui.checkbox(words, value=name not in disabled).props("dense")
            box.on_value_change(partial(toggle, name))
        remark("Clear a box to disable a default requirement")
    fields.requirements(form.requirements, summary.figures, "Add requirement")
    fold = ui.expansion().classes("group full-width")
    fold.on_value_change(lambda: _show_parameters(form, fields, fold, content))
    with fold:
        content = div("rows")
    _count(form, fold)
    fields.model(form, "corrects the rigid-body model, takes a few minutes")
    starts = {"described": "present dimensions", "middle": "middle of all bounds"}
    builder = fields.builder(form)
    builder.choice("start", starts).classes("full-width")
    budget = SearchOptions().budget(len(form.varied))
    builder.number("evaluations", str(budget)).classes("full-width")


def _count(form: ExploreForm, fold: ui.expansion) -> None:
    fold.text = f"Over: {len(form.varied)} of {len(form.ranges)} parameters and their bounds"


def _show_parameters(
    form: ExploreForm, fields: FormFields, fold: ui.expansion, box: ui.element
) -> None:
    """Show the parameters when the part is first opened: a stage has many."""
    if not fold.value or list(box):
        return

    def toggle(row: RangeInput, event: Any) -> None:
        row.is_varied = event.value
        fields.changed()
        _count(form, fold)

    with box:
        for row in form.ranges:
            with div("vary chosen"):
                choice = ui.checkbox(row.name.replace("_", " "), value=row.is_varied)
                choice.props("dense").on_value_change(partial(toggle, row))
                fields.bounds(row, fields.summary.variables[row.name])


def _tolerance(form: ExploreForm, fields: FormFields) -> None:
    summary = fields.summary
    figures = [name for name in summary.figures if name in summary.tolerance_figures]
    PanelHeading("Require: criteria of a good stage", 3)
    fields.requirements(form.requirements, figures, "Add requirement")
    builder = fields.builder(form)
    builder.number("samples").classes("full-width")
    builder.number("target_yield", "none: the given tolerances").classes("full-width")
    _scatter(form, fields)
    fields.figures(form, figures)
    fields.model(form, "corrects the rigid-body model by one analysis")


def _scatter(form: ExploreForm, fields: FormFields) -> None:
    """Show the standard deviations of manufacture."""
    assert isinstance(form.request, ToleranceRequest)
    deviations = dict(pair.split("=", 1) for pair in form.request.scatter)

    def assign(name: str, event: Any) -> None:
        deviations[name] = (event.value or "").strip()
        form.assign("scatter", tuple(f"{n}={text}" for n, text in deviations.items() if text))
        fields.changed()

    with ui.expansion("Scatter: standard deviations of manufacture").classes("group full-width"):
        for kind in DEVIATIONS:
            field = ui.input(
                kind.label[0].upper() + kind.label[1:],
                value=deviations.get(kind.name, ""),
                placeholder=scatter_text(Scatter(), kind.name),
            ).props("outlined dense stack-label debounce=400")
            field.classes("full-width").on_value_change(partial(assign, kind.name))


def _sensitivity(form: ExploreForm, fields: FormFields) -> None:
    builder = fields.builder(form)
    builder.tick("hinges", "thickness and position of each neck, not the parameters")
    builder.number("per", "1 % of each parameter; 10 µm for hinges").classes("full-width")
    fields.figures(form, fields.summary.figures)
    fields.model(form, "more accurate, two analyses per parameter")
