"""The forms of the view Explore."""

from functools import partial
from typing import Any

from nicegui import ui

from flexstage.explore.deviations import KINDS as DEVIATIONS
from flexstage.explore.optimise.ladder import SearchOptions
from flexstage.explore.sampling import usual_plan
from flexstage.explore.sweep import usual_cost
from flexstage.explore.variables import variables_of
from flexstage.explore.workers import duration
from flexstage.report.tolerance import scatter_text
from flexstage.virtual.imperfections import Scatter
from flexstage.web.explore.facts import StageFacts
from flexstage.web.explore.fields import WAYS, Fields
from flexstage.web.explore.state import (
    Form,
    OptimiseForm,
    RangeWords,
    SensitivityForm,
    SweepForm,
    ToleranceForm,
)
from flexstage.web.page import PanelHeading, div, quiet_button

_MOST = 8  # parameters of a sweep


def build_form(form: Form, fields: Fields) -> None:
    """Make the fields of a form."""
    match form:
        case SweepForm():
            _sweep(form, fields)
        case OptimiseForm():
            _optimise(form, fields)
        case ToleranceForm():
            _tolerance(form, fields)
        case SensitivityForm():
            _sensitivity(form, fields)


def what_it_takes(form: Form, facts: StageFacts) -> str:
    """Say how much work a form asks for."""
    match form:
        case SweepForm():
            over = variables_of(
                facts.template, [w.variable(facts.variables[w.name]) for w in form.over]
            )
            samples = form.samples if len(form.over) > 2 else None
            points = len(usual_plan(over, form.model, samples=samples).points(over))
            return f"{points} points, about {duration(max(1.0, points * usual_cost(form.model)))}"
        case OptimiseForm():
            most = SearchOptions(evaluations=form.evaluations).budget(len(form.over))
            return f"up to {most} evaluations; what is best so far is kept when it is cancelled"
        case ToleranceForm():
            return f"{form.samples} stages"
        case SensitivityForm():
            return "some seconds" if form.model == "lumped" else "two analyses of each parameter"


def _sweep(form: SweepForm, fields: Fields) -> None:
    facts = fields.facts
    PanelHeading("What is varied", 3)
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
                fields.number(
                    "Number of points", form.samples, lambda v: setattr(form, "samples", v),
                    whole=True, min=2, max=100_000, placeholder="256",
                ).props("stack-label")  # fmt: skip

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
        show()
        fields.changed()

    show()
    fields.figures(form, facts.figures)
    fields.model(form, f"closer, about {usual_cost('superelement'):g} s a point")


def _optimise(form: OptimiseForm, fields: Fields) -> None:
    facts = fields.facts
    PanelHeading("What is sought", 3)
    fields.limits(form.goals, facts.figures, "One more goal", WAYS, at_least=1)
    PanelHeading("What is required", 3)
    with div("rows"):
        for name, words in facts.unasked.items():
            box = ui.checkbox(words, value=name in form.required).props("dense")
            box.on_value_change(lambda event, n=name: _toggle(form.required, n, event, fields))
    fields.limits(form.keep, facts.figures, "One more requirement")
    fold = ui.expansion().classes("group full-width")
    fold.on_value_change(lambda: _chosen(form, fields, fold, names))
    with fold:
        names = div("rows")
    _count(form, facts, fold)
    fields.model(form, "corrects the rigid ones, takes some minutes")
    starts = {"described": "the stage as it is", "middle": "the middle of all bounds"}
    fields.choice("Start", form, "start", starts)
    fields.number(
        "Evaluations at most", form.evaluations, lambda v: setattr(form, "evaluations", v),
        whole=True, min=1,
        placeholder=str(SearchOptions().budget(len(form.over))),
    ).props("stack-label").classes("full-width")  # fmt: skip


def _count(form: OptimiseForm, facts: StageFacts, fold: ui.expansion) -> None:
    fold.text = f"Parameters and bounds: {len(form.over)} of {len(facts.variables)}"


def _chosen(form: OptimiseForm, fields: Fields, fold: ui.expansion, box: ui.element) -> None:
    """Show what may change, once it is asked for: a stage has many parameters."""
    facts = fields.facts
    if not fold.value or list(box):
        return

    def toggle(name: str, event: Any) -> None:
        _toggle(form.over, name, event, fields)
        _count(form, facts, fold)

    with box:
        for name, variable in facts.variables.items():
            with div("vary chosen"):
                choice = ui.checkbox(name.replace("_", " "), value=name in form.over)
                choice.props("dense").on_value_change(partial(toggle, name))
                fields.bounds(form.bounds.setdefault(name, RangeWords(name)), variable)


def _toggle(names: list[str], name: str, event: Any, fields: Fields) -> None:
    if event.value and name not in names:
        names.append(name)
    elif not event.value and name in names:
        names.remove(name)
    fields.changed()


def _tolerance(form: ToleranceForm, fields: Fields) -> None:
    facts = fields.facts
    of_lots = [name for name in facts.figures if name in facts.of_lots]
    PanelHeading("What a good stage has", 3)
    fields.limits(form.require, of_lots, "One more requirement")
    fields.number(
        "Stages that are drawn", form.samples, lambda v: setattr(form, "samples", v or 10_000),
        whole=True, min=2, max=1_000_000,
    ).classes("full-width")  # fmt: skip
    fields.number(
        "Yield to reach [%]", form.target, lambda v: setattr(form, "target", v), min=1, max=100,
        placeholder="none: the tolerances as they are",
    ).props("stack-label").classes("full-width")  # fmt: skip
    with ui.expansion("Scatter of the workshop: standard deviations").classes("group full-width"):
        for kind in DEVIATIONS:
            usual = scatter_text(Scatter(), kind.name)
            field = ui.input(
                kind.label[0].upper() + kind.label[1:],
                value=form.scatter.get(kind.name, ""),
                placeholder=usual,
            ).props("outlined dense stack-label debounce=400")
            field.classes("full-width").on_value_change(
                lambda event, name=kind.name: _scatter(form, name, event.value, fields)
            )
    fields.figures(form, of_lots)
    fields.model(form, "corrects the rigid ones, one analysis more")


def _scatter(form: ToleranceForm, name: str, text: str | None, fields: Fields) -> None:
    if text and text.strip():
        form.scatter[name] = text.strip()
    else:
        form.scatter.pop(name, None)
    fields.changed()


def _sensitivity(form: SensitivityForm, fields: Fields) -> None:
    facts = fields.facts

    def hinges(event: Any) -> None:
        form.hinges = event.value
        fields.changed()

    ui.checkbox(
        "Neck and place of each hinge, in place of the parameters", value=form.hinges
    ).props("dense").on_value_change(hinges)
    fields.number(
        "Change of lengths [µm]", None if form.step is None else form.step * 1e6,
        lambda v: setattr(form, "step", None if not v else v * 1e-6), min=0.001,
        placeholder="1 % of each; 10 µm of hinges",
    ).props("stack-label").classes("full-width")  # fmt: skip
    fields.figures(form, facts.figures)
    fields.model(form, "closer, two analyses of each parameter")
