"""What an optimisation found: tables, and sentences of what holds it."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.version import __version__
from flexstage.quantities.quantity import number
from flexstage.quantities.section import Picture, Section
from flexstage.quantities.table import Column, Table, table
from flexstage.report.figures.optimum import draw_front
from flexstage.report.page import page_html
from flexstage.report.sweep import parallel_coordinates
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.optimise.default_requirements import walls_note
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import TOLERANCE, Optimum, round_step
from flexstage.studies.explore.variables import Variable

# limits that are named, and what the table says of a bound
_HELD, _BOUND = 8, {"low": "lower", "high": "upper"}


def optimum_tables(found: Optimum) -> Iterator[Table]:
    """Yield what people read of an optimum: its figures, then its dimensions."""
    yield _figures(found)
    if found.problem.exchanged:
        yield _exchange(found)
    yield _variables(found)


def optimum_notes(found: Optimum) -> tuple[str, ...]:
    """Return in sentences what was reached, what holds it and what it took."""
    problem = found.problem
    # what goals exchange has a table of its own
    holding = [held for held in found.held if held.kind != "goal"]
    notes = [_reached(found), *(held.text for held in holding[:_HELD])]
    if len(holding) > _HELD:
        notes.append(f"held by {len(holding) - _HELD} more, each of which matters less")
    unasked = [*(["check"] if problem.checked else []), *(r.text for r in problem.usual)]
    if unasked:
        asked = ", ".join(unasked)
        notes.append(f"required without being asked (--without NAME leaves one out): {asked}")
    if walls := walls_note(problem.usual):
        notes.append(walls)
    notes += found.notes
    notes.append(f"evaluations: {_work(found)}")
    return tuple(notes)


def front_tables(found: Front) -> Iterator[Table]:
    """Yield what people read of a front: its points, then the chosen design."""
    yield _front(found)
    yield from optimum_tables(found.optimum)


def front_notes(found: Front) -> tuple[str, ...]:
    """Return in sentences what the front is, and what holds the chosen design."""
    counted = ", ".join(f"{n} {model}" for model, n in found.evaluations.items())
    return (
        f"{len(found.points)} stages on the front after {found.generations} generations; "
        f"evaluations: {counted}; point {found.chosen + 1} was chosen, the nearest to the best of "
        "all goals, and made better at the same values of the others",
        *optimum_notes(found.optimum),
    )


def front_html(found: Front) -> str:
    """Return one HTML page of a front: parallel coordinates, picture and tables.

    Raises
    ------
    ModelError
        Plotly is not installed.
    """
    require_extra("explore", "plotly", "a page of parallel coordinates", ModelError)
    goals = [goal.figure for goal in found.problem.goals]
    columns = [found.figures.index(figure) for figure in goals]
    axes = [
        (figure.heading, found.values[:, i] * figure.shown.factor)
        for figure, i in zip(goals, columns, strict=True)
    ]
    axes += [
        (variable.heading, found.points[:, j] * variable.factor)
        for j, variable in enumerate(found.problem.family.variables)
    ]
    picture = Picture(
        result=partial(draw_front, found),
        title="Pareto front",
        caption="What the goals cost each other, by both models; the star is the chosen design.",
    )
    shown = Section(
        key="front", title="Front and chosen design", content=(picture, *front_tables(found))
    )
    return page_html(
        heading=f"{found.problem.family.template.source}: Pareto front",
        lead=" and ".join(goal.text for goal in found.problem.goals),
        version=__version__,
        links=(("coordinates", "Parallel coordinates"), (shown.key, shown.title)),
        sections=(shown,),
        notes=front_notes(found),
        template="sweep.html",
        said="A line for each stage of the front: goals by the lumped model, then dimensions. Draw "
        "along an axis to keep the lines that pass there, click beside the stretch to let go, drag "
        "a heading to move its axis.",
        drawing=parallel_coordinates(axes, 0),
    )


def _reached(found: Optimum) -> str:
    last = found.levels[-1]
    worst = int(np.argmax(found.excess)) if len(found.excess) else -1
    if found.problem.goals:
        goal = found.problem.goals[0].figure
        text = f"{goal.name} from {goal.text(last.start[0])} to {goal.text(last.best[0])}"
        if found.gain is not None and np.isfinite(found.gain):
            text += f" ({100.0 * found.gain:+.1f} %)"
        text += f" by the {last.model} model"
    else:
        text = f"the nearest stage to the start that was found, by the {last.model} model"
    if found.met:
        return f"{text}; every requirement is kept within {100.0 * TOLERANCE:g} %"
    missed = found.problem.all_requirements[worst]
    return (
        f"{missed.text} is missed by {100.0 * found.excess[worst]:.2g} %: no stage between the "
        f"bounds was found that keeps all requirements, and this one misses them least; {text}"
    )


def _work(found: Optimum) -> str:
    return ", ".join(
        f"{count} {model}" + (f" in {found.seconds[model]:.0f} s" if model in found.seconds else "")
        for model, count in found.evaluations.items()
    )


def _figures(found: Optimum) -> Table:
    problem, last = found.problem, found.levels[-1]
    others = (held.goal for held in problem.exchanged)
    goals = {goal.figure: goal.way for goal in (*problem.goals, *others)}
    columns = [
        Column("figure", "title"),
        Column("unit", "words"),
        Column("required", "words"),
        Column(last.model, group="start"),
        *(Column(level.model, group="best") for level in found.levels),
    ]
    rows = []
    for i, figure in enumerate(found.figures):
        asked = zip(problem.all_requirements, found.excess, strict=True)
        wanted = [
            _limit(r) + ("" if excess <= TOLERANCE else " missed")
            for r, excess in asked
            if r.figure == figure
        ]
        if figure in goals:
            wanted.insert(0, goals[figure])
        values = (last.start[i], *(level.best[i] for level in found.levels))
        cells = [figure.shown.text(float(v)) if np.isfinite(v) else "–" for v in values]
        rows.append([figure.label, figure.shown.shown_unit, ", ".join(wanted), *cells])
    return table(f"{found.problem.family.template.source}: figures", columns, rows)


def _exchange(found: Optimum) -> Table:
    """Tell what the first goal gains for a little less of each other one."""
    gained = found.problem.goals[0].figure
    rows = []
    for held, rate in zip(found.problem.exchanged, found.exchange, strict=True):
        figure = held.goal.figure
        step = round_step(abs(held.value) * figure.shown.factor) / figure.shown.factor
        worse = step if held.goal.way == "minimise" else -step
        told = "0"
        if rate is not None:
            told = f"{rate.rate * worse * gained.shown.factor:+.2g}".replace("-", "−")
        sign = "+" if worse > 0.0 else "−"
        at = figure.shown.text(held.value)
        given = f"{sign}{number(step * figure.shown.factor)}"
        rows.append((figure.label, figure.shown.shown_unit, at, given, told))
    heads = ("goal", "<unit", "chosen point", "given up", f"gives {gained.heading}")
    return table("rates of exchange between goals at the chosen point", heads, rows)


def _limit(requirement: Requirement) -> str:
    """Write a requirement without the name of its figure."""
    shown = requirement.figure.shown
    low, high = requirement.low, requirement.high
    if low is not None and high is not None:
        same = low == high
        return f"= {shown.text(low)}" if same else f"{shown.text(low)} to {shown.text(high)}"
    return f"≥ {shown.text(low)}" if low is not None else f"≤ {shown.text(high)}"


def _variables(found: Optimum) -> Table:
    at_bound = {h.name: _BOUND[h.side] for h in found.held if h.kind == "bound"}
    rows = [
        (
            variable.name,
            variable.unit,
            *(_every_digit(variable, v) for v in (variable.low, start, best, variable.high)),
            at_bound.get(variable.name, ""),
        )
        for variable, start, best in zip(
            found.problem.family.variables, found.start, found.point, strict=True
        )
    ]
    heads = ("parameter", "<unit", "from", "start", "best", "to", "<at bound")
    return table("parameters", heads, rows)


def _every_digit(variable: Variable, value: float) -> str:
    """Write a value as it stands in the file; with three decimals what a drawing has so."""
    shown = value * variable.factor
    rounded = f"{shown:.3f}"
    decimals = variable.unit in ("mm", "deg") and abs(float(rounded) - shown) < 1e-9
    return rounded if decimals else f"{shown:.12g}"


def _front(found: Front) -> Table:
    goals = [goal.figure for goal in found.problem.goals]
    at = [found.figures.index(figure) for figure in goals]
    models = list(dict.fromkeys(("lumped", found.model)))
    columns = [
        Column("point", "title"),
        *(Column(f.heading, group=model) for model in models for f in goals),
    ]
    rows = []
    for k, i in enumerate(found.asked):
        name = f"{i + 1} (chosen)" if i == found.chosen else f"{i + 1}"
        cells = _cells(goals, found.values[i, at])
        if found.model in models[1:]:
            cells += _cells(goals, found.found[k, at])
        rows.append([name, *cells])
    source = found.problem.family.template.source
    return table(f"{source}: Pareto front of {len(found.points)} stages", columns, rows)


def _cells(figures: list[Figure], values: Array) -> list[str]:
    return [f.shown.text(float(v)) for f, v in zip(figures, values, strict=True)]
