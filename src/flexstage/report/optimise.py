"""Tables and notes of an optimisation: figures, dimensions, active constraints."""

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
from flexstage.studies.explore.optimise.default_requirements import wall_note
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import TOLERANCE, Optimum, round_step
from flexstage.studies.explore.variables import Variable

# number of reported active constraints, and words for bounds in the table
_CONSTRAINTS, _BOUND = 8, {"low": "lower", "high": "upper"}


def optimum_tables(found: Optimum) -> Iterator[Table]:
    """Yield the tables of an optimum: figures, trade-offs, dimensions."""
    yield _figures(found)
    if found.problem.other_goals:
        yield _trade_offs(found)
    yield _variables(found)


def optimum_notes(found: Optimum) -> tuple[str, ...]:
    """Return notes on the result, active constraints, defaults and evaluations of an optimum."""
    problem = found.problem
    # trade-offs of goals have a table
    active = [c for c in found.active_constraints if c.kind != "goal"]
    notes = [_reached(found), *(constraint.text for constraint in active[:_CONSTRAINTS])]
    if len(active) > _CONSTRAINTS:
        notes.append(f"{len(active) - _CONSTRAINTS} further active constraints with less influence")
    defaults = [*(["check"] if problem.checked else []), *(r.text for r in problem.defaults)]
    if defaults:
        notes.append(f"default constraints (--without NAME disables one): {', '.join(defaults)}")
    if walls := wall_note(problem.defaults):
        notes.append(walls)
    notes += found.notes
    notes.append(f"evaluations: {_work(found)}")
    return tuple(notes)


def front_tables(found: Front) -> Iterator[Table]:
    """Yield the tables of a front: its points, then the selected design."""
    yield _front(found)
    yield from optimum_tables(found.optimum)


def front_notes(found: Front) -> tuple[str, ...]:
    """Return notes on a front and its selected design."""
    counted = ", ".join(f"{n} {model}" for model, n in found.evaluations.items())
    return (
        f"{len(found.points)} stages on the front after {found.generations} generations; "
        f"evaluations: {counted}; point {found.selected + 1} is selected, the nearest to the best "
        "values of all goals, and is improved in the first goal with the others fixed",
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
        (figure.heading, found.values[:, i] * figure.display.factor)
        for figure, i in zip(goals, columns, strict=True)
    ]
    axes += [
        (variable.heading, found.points[:, j] * variable.factor)
        for j, variable in enumerate(found.problem.family.variables)
    ]
    picture = Picture(
        result=partial(draw_front, found),
        title="Pareto front",
        caption="Pareto front by both models; the star is the selected design.",
    )
    shown = Section(
        key="front", title="Front and selected design", content=(picture, *front_tables(found))
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
        text = f"the nearest stage to the start, by the {last.model} model"
    if found.met:
        return f"{text}; every requirement is met within {100.0 * TOLERANCE:g} %"
    missed = found.problem.all_requirements[worst]
    return (
        f"{missed.text} is violated by {100.0 * found.excess[worst]:.2g} %: no stage within the "
        f"bounds meets all requirements; this one has the least violation; {text}"
    )


def _work(found: Optimum) -> str:
    return ", ".join(
        f"{count} {model}" + (f" in {found.seconds[model]:.0f} s" if model in found.seconds else "")
        for model, count in found.evaluations.items()
    )


def _figures(found: Optimum) -> Table:
    problem, last = found.problem, found.levels[-1]
    others = (other.goal for other in problem.other_goals)
    goals = {goal.figure: goal.direction for goal in (*problem.goals, *others)}
    columns = [
        Column("figure", "title"),
        Column("unit", "words"),
        Column("required", "words"),
        Column(last.model, group="start"),
        *(Column(level.model, group="best") for level in found.levels),
    ]
    rows = []
    for i, figure in enumerate(found.figures):
        requirements = zip(problem.all_requirements, found.excess, strict=True)
        limits = [
            _limit(r) + ("" if excess <= TOLERANCE else " violated")
            for r, excess in requirements
            if r.figure == figure
        ]
        if figure in goals:
            limits.insert(0, goals[figure])
        values = (last.start[i], *(level.best[i] for level in found.levels))
        cells = [figure.display.text(float(v)) if np.isfinite(v) else "–" for v in values]
        rows.append([figure.label, figure.display.shown_unit, ", ".join(limits), *cells])
    return table(f"{found.problem.family.template.source}: figures", columns, rows)


def _trade_offs(found: Optimum) -> Table:
    """Return the gain of the first goal for a small loss in each other one."""
    first = found.problem.goals[0].figure
    rows = []
    for other, constraint in zip(found.problem.other_goals, found.trade_offs, strict=True):
        figure = other.goal.figure
        step = round_step(abs(other.value) * figure.display.factor) / figure.display.factor
        loss = step if other.goal.direction == "minimise" else -step
        gain = "0"
        if constraint is not None:
            gain = f"{constraint.rate * loss * first.display.factor:+.2g}".replace("-", "−")
        sign = "+" if loss > 0.0 else "−"
        value = figure.display.text(other.value)
        change = f"{sign}{number(step * figure.display.factor)}"
        rows.append((figure.label, figure.display.shown_unit, value, change, gain))
    heads = ("goal", "<unit", "selected point", "loss", f"gain in {first.heading}")
    return table("trade-offs between goals at the selected point", heads, rows)


def _limit(requirement: Requirement) -> str:
    """Write a requirement without the name of its figure."""
    quantity = requirement.figure.display
    low, high = requirement.low, requirement.high
    if low is not None and high is not None:
        same = low == high
        return (
            f"= {quantity.text(low)}" if same else f"{quantity.text(low)} to {quantity.text(high)}"
        )
    return f"≥ {quantity.text(low)}" if low is not None else f"≤ {quantity.text(high)}"


def _variables(found: Optimum) -> Table:
    at_bound = {h.name: _BOUND[h.side] for h in found.active_constraints if h.kind == "bound"}
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
    """Write a value with all digits of the file, and with three decimals if it is rounded."""
    number_in_unit = value * variable.factor
    rounded = f"{number_in_unit:.3f}"
    decimals = variable.unit in ("mm", "deg") and abs(float(rounded) - number_in_unit) < 1e-9
    return rounded if decimals else f"{number_in_unit:.12g}"


def _front(found: Front) -> Table:
    goals = [goal.figure for goal in found.problem.goals]
    at = [found.figures.index(figure) for figure in goals]
    models = list(dict.fromkeys(("lumped", found.model)))
    columns = [
        Column("point", "title"),
        *(Column(f.heading, group=model) for model in models for f in goals),
    ]
    rows = []
    for k, i in enumerate(found.recomputed):
        name = f"{i + 1} (selected)" if i == found.selected else f"{i + 1}"
        cells = _cells(goals, found.values[i, at])
        if found.model in models[1:]:
            cells += _cells(goals, found.recomputed_values[k, at])
        rows.append([name, *cells])
    source = found.problem.family.template.source
    return table(f"{source}: Pareto front of {len(found.points)} stages", columns, rows)


def _cells(figures: list[Figure], values: Array) -> list[str]:
    return [f.display.text(float(v)) for f, v in zip(figures, values, strict=True)]
