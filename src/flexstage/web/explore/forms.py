"""The forms of the view Explore."""

from functools import partial
from typing import Any

from nicegui import ui

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
from flexstage.studies.explore.variables import variables_of
from flexstage.studies.explore.workers import duration
from flexstage.virtual.imperfections import Scatter
from flexstage.web.explore.facts import StageFacts
from flexstage.web.explore.fields import WAYS, Fields
from flexstage.web.explore.state import (
    ExploreForm,
    RangeWords,
)
from flexstage.web.page import PanelHeading, div, quiet_button, remark

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


def what_it_takes(request: ExploreRequest, facts: StageFacts) -> str:
    """Say how much work is asked for."""
    match request:
        case SweepRequest():
            over = variables_of(facts.template, request.over)
            points = len(usual_plan(over, request.model, samples=request.samples).points(over))
            seconds = max(1.0, points * typical_seconds(request.model))
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

    def choose(row: RangeWords, name: str | None) -> None:
        if name and name not in {other.name for other in form.over}:
            row.name, row.low, row.high = name, None, None
        again()

    def more() -> None:
        taken = {row.name for row in form.over}
        left = [name for name in names if name not in taken]
        first = [name for name in left if "neck" in name and name in facts.flexure] or left
        form.over.append(RangeWords(first[0]))
        again()

    def drop(row: RangeWords) -> None:
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
    fields.model(form, f"closer, about {typical_seconds('superelement'):g} s a point")


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

    def toggle(row: RangeWords, event: Any) -> None:
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
