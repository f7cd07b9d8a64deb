"""Results of an optimisation: tables, and notes with the active constraints."""

from collections.abc import Iterator

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.version import __version__
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Column, Picture, Section, Table, table
from flexstage.report.page import page_html
from flexstage.report.sweep import INSTRUCTIONS, parallel_coordinates
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.optimise.default_requirements import wall_note
from flexstage.studies.explore.optimise.front import Front
from flexstage.studies.explore.optimise.optimum import TOLERANCE, Optimum, round_step
from flexstage.studies.explore.variables import Variable

#: Most active constraints with a note of their own.
_MOST_CONSTRAINTS = 8
_BOUND = {"low": "lower", "high": "upper"}


def optimum_tables(optimum: Optimum) -> Iterator[Table]:
    """Yield the tables of an optimum: its figures, then its dimensions."""
    yield _figures(optimum)
    if optimum.problem.other_goals:
        yield _trade_offs(optimum)
    yield _variables(optimum)


def optimum_notes(optimum: Optimum) -> tuple[str, ...]:
    """Return notes on the optimum, its active constraints and the evaluations."""
    problem = optimum.problem
    # the trade-off between goals has a table of its own
    active = [constraint for constraint in optimum.active_constraints if constraint.kind != "goal"]
    notes = [_reached(optimum), *(constraint.text for constraint in active[:_MOST_CONSTRAINTS])]
    if len(active) > _MOST_CONSTRAINTS:
        notes.append(
            f"{len(active) - _MOST_CONSTRAINTS} more active constraints, each with a smaller effect"
        )
    default_constraints = [
        *(["check"] if problem.checked else []),
        *(r.text for r in problem.defaults),
    ]
    if default_constraints:
        names = ", ".join(default_constraints)
        notes.append(f"default constraints (disable with --without NAME): {names}")
    if walls := wall_note(problem.defaults):
        notes.append(walls)
    notes += optimum.notes
    notes.append(f"evaluations: {_work(optimum)}")
    return tuple(notes)


def front_tables(front: Front) -> Iterator[Table]:
    """Yield the tables of a front: its points, then the selected design."""
    yield _front(front)
    yield from optimum_tables(front.optimum)


def front_notes(front: Front) -> tuple[str, ...]:
    """Return notes on the front, and on the selected design."""
    evaluations = ", ".join(f"{n} {model}" for model, n in front.evaluations.items())
    return (
        f"{len(front.points)} stages on the front after {front.generations} generations; "
        f"evaluations: {evaluations}; point {front.selected + 1}, the nearest to the best values "
        "of all goals, was selected and improved at fixed values of the other goals",
        *optimum_notes(front.optimum),
    )


def front_html(front: Front) -> str:
    """Return one HTML page of a front: parallel coordinates, picture and tables.

    Raises
    ------
    ModelError
        Plotly is not installed.
    """
    require_extra("explore", "plotly", "a page of parallel coordinates", ModelError)
    goals = [goal.figure for goal in front.problem.goals]
    columns = [front.figures.index(figure) for figure in goals]
    axes = [
        (figure.heading, front.values[:, i] * figure.display.factor)
        for figure, i in zip(goals, columns, strict=True)
    ]
    axes += [
        (variable.heading, front.points[:, j] * variable.factor)
        for j, variable in enumerate(front.problem.family.variables)
    ]
    picture = Picture(
        result=front,
        title="Pareto front",
        caption="Trade-off between the goals, by both models; star: selected design.",
    )
    section = Section(
        key="front", title="Front and selected design", content=(picture, *front_tables(front))
    )
    return page_html(
        heading=f"{front.problem.family.template.source}: Pareto front",
        lead=" and ".join(goal.text for goal in front.problem.goals),
        version=__version__,
        links=(("coordinates", "Parallel coordinates"), (section.key, section.title)),
        sections=(section,),
        notes=front_notes(front),
        template="sweep.html",
        instructions="Each line is a stage of the front: goals by the lumped model, then "
        f"dimensions. {INSTRUCTIONS}",
        drawing=parallel_coordinates(axes, 0),
    )


def _reached(optimum: Optimum) -> str:
    last = optimum.levels[-1]
    worst = int(np.argmax(optimum.excess)) if len(optimum.excess) else -1
    if optimum.problem.goals:
        goal = optimum.problem.goals[0].figure
        text = f"{goal.name} from {goal.text(last.start[0])} to {goal.text(last.best[0])}"
        if optimum.gain is not None and np.isfinite(optimum.gain):
            text += f" ({100.0 * optimum.gain:+.1f} %)"
        text += f" by the {last.model} model"
    else:
        text = f"the stage found nearest to the start, by the {last.model} model"
    if optimum.met:
        return f"{text}; all requirements are met within {100.0 * TOLERANCE:g} %"
    violated = optimum.problem.all_requirements[worst]
    return (
        f"{violated.text} is violated by {100.0 * optimum.excess[worst]:.2g} %: no design found "
        f"within the bounds meets all requirements, this one is the nearest; {text}"
    )


def _work(optimum: Optimum) -> str:
    return ", ".join(
        f"{count} {model}"
        + (f" in {optimum.seconds[model]:.0f} s" if model in optimum.seconds else "")
        for model, count in optimum.evaluations.items()
    )


def _figures(optimum: Optimum) -> Table:
    problem, last = optimum.problem, optimum.levels[-1]
    others = (constraint.goal for constraint in problem.other_goals)
    goals = {goal.figure: goal.direction for goal in (*problem.goals, *others)}
    columns = [
        Column("figure", "title"),
        Column("unit", "words"),
        Column("requirement", "words"),
        Column(last.model, group="start"),
        *(Column(level.model, group="best") for level in optimum.levels),
    ]
    rows = []
    for i, figure in enumerate(optimum.figures):
        requirements = zip(problem.all_requirements, optimum.excess, strict=True)
        limits = [
            _limit(r) + ("" if excess <= TOLERANCE else " violated")
            for r, excess in requirements
            if r.figure == figure
        ]
        if figure in goals:
            limits.insert(0, goals[figure])
        values = (last.start[i], *(level.best[i] for level in optimum.levels))
        cells = [figure.display.text(float(v)) if np.isfinite(v) else "–" for v in values]
        rows.append([figure.label, figure.display.shown_unit, ", ".join(limits), *cells])
    return table(f"{optimum.problem.family.template.source}: figures", columns, rows)


def _trade_offs(optimum: Optimum) -> Table:
    """Return the gain of the first goal for a small concession in each other one."""
    first_goal = optimum.problem.goals[0].figure
    rows = []
    for constraint, rate in zip(optimum.problem.other_goals, optimum.trade_offs, strict=True):
        figure = constraint.goal.figure
        step = round_step(abs(constraint.value) * figure.display.factor) / figure.display.factor
        worse = step if constraint.goal.direction == "minimise" else -step
        gain = "0"
        if rate is not None:
            gain = f"{rate.rate * worse * first_goal.display.factor:+.2g}".replace("-", "−")
        sign = "+" if worse > 0.0 else "−"
        at = figure.display.text(constraint.value)
        concession = f"{sign}{number(step * figure.display.factor)}"
        rows.append((figure.label, figure.display.shown_unit, at, concession, gain))
    heads = ("goal", "<unit", "selected point", "concession", f"gain in {first_goal.heading}")
    return table("trade-off between goals at the selected point", heads, rows)


def _limit(requirement: Requirement) -> str:
    """Return a requirement without the name of its figure."""
    quantity = requirement.figure.display
    low, high = requirement.low, requirement.high
    if low is not None and high is not None:
        same = low == high
        return (
            f"= {quantity.text(low)}" if same else f"{quantity.text(low)} to {quantity.text(high)}"
        )
    return f"≥ {quantity.text(low)}" if low is not None else f"≤ {quantity.text(high)}"


def _variables(optimum: Optimum) -> Table:
    at_bound = {h.name: _BOUND[h.side] for h in optimum.active_constraints if h.kind == "bound"}
    rows = [
        (
            variable.name,
            variable.unit,
            *(_every_digit(variable, v) for v in (variable.low, start, best, variable.high)),
            at_bound.get(variable.name, ""),
        )
        for variable, start, best in zip(
            optimum.problem.family.variables, optimum.start, optimum.point, strict=True
        )
    ]
    heads = ("parameter", "<unit", "lower bound", "start", "best", "upper bound", "<at bound")
    return table("parameters", heads, rows)


def _every_digit(variable: Variable, value: float) -> str:
    """Return a value as in the stage file; dimensions of a drawing have three decimals."""
    size = value * variable.factor
    rounded = f"{size:.3f}"
    decimals = variable.unit in ("mm", "deg") and abs(float(rounded) - size) < 1e-9
    return rounded if decimals else f"{size:.12g}"


def _front(front: Front) -> Table:
    goals = [goal.figure for goal in front.problem.goals]
    at = [front.figures.index(figure) for figure in goals]
    models = list(dict.fromkeys(("lumped", front.model)))
    columns = [
        Column("point", "title"),
        *(Column(f.heading, group=model) for model in models for f in goals),
    ]
    rows = []
    for k, i in enumerate(front.recomputed):
        name = f"{i + 1} (selected)" if i == front.selected else f"{i + 1}"
        cells = _cells(goals, front.values[i, at])
        if front.model in models[1:]:
            cells += _cells(goals, front.recomputed_values[k, at])
        rows.append([name, *cells])
    source = front.problem.family.template.source
    return table(f"{source}: Pareto front of {len(front.points)} stages", columns, rows)


def _cells(figures: list[Figure], values: Array) -> list[str]:
    return [f.display.text(float(v)) for f, v in zip(figures, values, strict=True)]
