"""Points that were looked at, as a page shows them: what was varied, and what came out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np

from flexstage.base.arrays import Array
from flexstage.quantities.characteristic import WHOLE_STAGE
from flexstage.quantities.quantity import number
from flexstage.report.sensitivity import short_label
from flexstage.studies.explore.batches import FinishedBatch
from flexstage.studies.explore.family import Family
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.front import Front, Generation, non_dominated
from flexstage.studies.explore.optimise.optimum import HistoryEntry, Optimum, SearchStep
from flexstage.studies.explore.optimise.problem import Problem
from flexstage.studies.explore.sampling import SweepPlan
from flexstage.studies.explore.sweep import Sweep
from flexstage.studies.explore.variables import Variable
from flexstage.web.explore.state import Run
from flexstage.web.preferences import Preferences

#: What points of a search for a front are called.
SEARCHED, ON_FRONT = "searched", "on the front"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointColumn:
    """A column of numbers."""

    name: str
    """What it is called among the others."""
    heading: str
    """Its name in words, with the unit."""
    short: str
    """The same where there is little room."""
    values: Array
    """Its numbers in that unit, NaN where there is none."""
    described: float
    """The number of the stage as it is described; NaN where that is not known."""
    is_varied: bool = False
    """Whether it is a parameter that was varied."""

    @property
    def varies(self) -> bool:
        """Whether its numbers differ by more than a ten-thousandth of their size."""
        known = self.values[np.isfinite(self.values)]
        return bool(known.size) and bool(np.ptp(known) > 1e-4 * np.abs(known).max())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointTable:
    """Points, a row each: those that are not computed yet have no figures."""

    variables: tuple[str, ...]
    """Names of what was varied."""
    points: Array
    """Their values in SI units, shape (S, d)."""
    columns: tuple[PointColumn, ...]
    """What is shown of each."""
    labels: tuple[str, ...] = ()
    """What rows are called beside their number."""
    counts: tuple[int, ...] = ()
    """Number of values of each variable on a grid; empty for other points."""
    computed: int = 0
    """Points that were looked at."""

    @property
    def shown(self) -> np.ndarray:
        """The rows that have figures."""
        outcome = [c.values for c in self.columns if not c.is_varied]
        return np.flatnonzero(np.any(np.isfinite(outcome), axis=0))

    @property
    def varied(self) -> tuple[PointColumn, ...]:
        """The columns of what was varied."""
        return tuple(c for c in self.columns if c.is_varied)

    @property
    def outcome(self) -> tuple[PointColumn, ...]:
        """The columns of what came out."""
        return tuple(c for c in self.columns if not c.is_varied)

    def column(self, name: str) -> PointColumn | None:
        """Return a column by its name."""
        return next((c for c in self.columns if c.name == name), None)

    def ordered(self, name: str, *, descending: bool) -> list[int]:
        """Return the rows that have figures in the order of a column.

        Without one as they are, those of a front that was not found yet before the others.
        """
        rows = self.shown
        column = self.column(name)
        if column is None:
            searched = [bool(self.labels) and self.labels[i] == SEARCHED for i in rows]
            return rows[np.argsort(searched, kind="stable")].tolist()
        values = column.values[rows]
        order = np.argsort(-values if descending else values, kind="stable")
        return rows[order].tolist()

    def values(self, row: int) -> dict[str, float]:
        """Return the parameters of a row, in SI units."""
        return dict(zip(self.variables, map(float, self.points[row]), strict=True))


def _varied(variable: Variable, values: Array) -> PointColumn:
    return PointColumn(
        name=variable.name,
        heading=variable.heading.replace("_", " "),
        short=variable.heading.replace("_", " "),
        values=values * variable.factor,
        described=variable.usual * variable.factor,
        is_varied=True,
    )


def _outcome(
    figure: Figure, values: Array, described: float, preferences: Preferences
) -> PointColumn:
    shown = preferences.shown(figure.display)
    known = np.abs(values[np.isfinite(values)])
    if shown == figure.display and known.size:
        shown = shown.fitting(float(known.max()))
    axis = "" if figure.axis == WHOLE_STAGE else figure.axis
    unit = f"[{shown.shown_unit}]" if shown.shown_unit else ""
    return PointColumn(
        name=figure.name,
        heading=figure.heading_in(shown),
        short=f"{short_label(figure)} {axis} {unit}".replace("\n", " "),
        values=np.where(np.abs(values) < shown.zero, 0.0, values) * shown.factor,
        described=described * shown.factor,
    )


def _table(
    variables: Sequence[Variable],
    figures: Sequence[Figure],
    points: Array,
    values: Array,
    described: Array,
    preferences: Preferences,
) -> PointTable:
    columns = [_varied(v, points[:, i]) for i, v in enumerate(variables)]
    columns += [
        _outcome(f, values[:, k], float(described[k]), preferences) for k, f in enumerate(figures)
    ]
    return PointTable(
        variables=tuple(v.name for v in variables),
        points=points,
        columns=tuple(columns),
        computed=len(points),
    )


def of_sweep(found: Sweep, preferences: Preferences) -> PointTable:
    """Return the points of a sweep, with the figures that vary."""
    order = list(found.varying) or list(range(len(found.figures)))
    table = _table(
        found.variables,
        [found.figures[k] for k in order],
        found.points,
        found.values[:, order],
        found.described[order],
        preferences,
    )
    return replace(table, counts=found.counts)


def of_batches(
    question: tuple[Family, tuple[Figure, ...], SweepPlan],
    batches: Iterable[object],
    preferences: Preferences,
) -> PointTable:
    """Return the points of a sweep that goes on, or was cancelled, as far as it came."""
    family, figures, plan = question
    points = plan.points(family.variables)
    values = np.full((len(points), len(figures)), np.nan)
    computed = 0
    for batch in batches:
        if isinstance(batch, FinishedBatch) and batch.job == "sweep":
            found = batch.arrays["values"]
            values[batch.start : batch.start + len(found)] = found
            computed += len(found)
    unknown = np.full(len(figures), np.nan)
    table = _table(family.variables, figures, points, values, unknown, preferences)
    return replace(table, counts=plan.counts(family.variables), computed=computed)


def of_front(found: Front, preferences: Preferences) -> PointTable:
    """Return the points of a front; the last row is the chosen design, made better."""
    best = found.optimum
    own = [best.figures.index(figure) for figure in found.figures]
    table = _front_table(
        found.problem,
        np.vstack((found.points, best.point)),
        np.vstack((found.values, best.levels[0].best[own])),
        preferences,
    )
    labels = [ON_FRONT] * len(found.points)
    labels[found.selected] = "chosen"
    return replace(table, labels=(*labels, "chosen, improved"))


class SearchedFront:
    """The stages of a search for a front that keep every requirement, as they are handed over.

    What was looked at once is not compared again: a search goes on for thousands of stages.

    Parameters
    ----------
    problem
        What is sought.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._taken = 0
        self._points = np.zeros((0, len(problem.family.variables)))
        self._values = np.zeros((0, len(problem.figures)))
        self._front = np.zeros(0, dtype=int)

    def table(self, found: Sequence[object], preferences: Preferences) -> PointTable | None:
        """Return the points so far; None of none yet."""
        new = [each for each in found[self._taken :] if isinstance(each, Generation)]
        self._taken = len(found)
        if new:
            before = len(self._points)
            self._points = np.vstack((self._points, *(each.points[each.feasible] for each in new)))
            self._values = np.vstack((self._values, *(each.values[each.feasible] for each in new)))
            rows = np.concatenate((self._front, np.arange(before, len(self._points))))
            self._front = rows[non_dominated(self._costs(rows))]
        if not len(self._points):
            return None
        table = _front_table(self._problem, self._points, self._values, preferences)
        labels = np.full(len(self._points), SEARCHED, dtype=object)
        labels[self._front] = ON_FRONT
        return replace(table, labels=tuple(labels))

    def _costs(self, rows: np.ndarray) -> Array:
        problem = self._problem
        columns = [problem.figures.index(goal.figure) for goal in problem.goals]
        return self._values[rows][:, columns] * np.array([goal.sign for goal in problem.goals])


def _front_table(
    problem: Problem, points: Array, values: Array, preferences: Preferences
) -> PointTable:
    unknown = np.full(len(problem.figures), np.nan)
    variables = problem.family.variables
    table = _table(variables, problem.figures, points, values, unknown, preferences)
    return replace(table, columns=(*table.outcome, *table.varied))


def of_steps(
    problem: Problem, found: Iterable[object], preferences: Preferences
) -> PointTable | None:
    """Return the steps of a search that goes on, or was cancelled; None before the first."""
    steps = [each for each in found if isinstance(each, SearchStep)]
    if not steps:
        return None
    points = np.array([step.point for step in steps])
    varied = [_varied(v, points[:, i]) for i, v in enumerate(problem.family.variables)]
    return PointTable(
        variables=tuple(v.name for v in problem.family.variables),
        points=points,
        columns=(*way_columns(problem, [s.entry for s in steps], preferences), *varied),
        computed=len(steps),
    )


def way_columns(
    problem: Problem, trace: Sequence[HistoryEntry], preferences: Preferences
) -> tuple[PointColumn, ...]:
    """Return the way of a search: evaluations, goal, and what the requirements are missed by."""
    objective = np.array([step.objective for step in trace])
    if problem.goals:
        goal = _outcome(problem.goals[0].figure, objective, np.nan, preferences)
    else:
        goal = _plain("distance", "Distance from the start [parts of the bounds]", objective)
    missed = 100.0 * np.array([step.violation for step in trace])
    at = np.array([float(step.evaluations) for step in trace])
    return (
        _plain("evaluations", "Evaluations by rigid bodies", at),
        goal,
        _plain("missed", "Requirements missed by [%]", missed),
    )


def _plain(name: str, heading: str, values: Array) -> PointColumn:
    return PointColumn(name=name, heading=heading, short=heading, values=values, described=np.nan)


def of_optimum(found: Optimum, preferences: Preferences) -> PointTable:
    """Return start and best stage, by the finest model."""
    level = found.levels[-1]
    table = _front_table(
        found.problem,
        np.array([found.start, found.point]),
        np.array([level.start, level.best]),
        preferences,
    )
    return replace(table, labels=("start", "best"))


#: Rows that are shown at a time.
ROWS = 12
_MARKS = {True: " ▼", False: " ▲"}
#: Puts the focus back on what was pressed, as the rows are made anew.
FOCUS = '[...document.querySelectorAll("[data-do]")].find(b => b.dataset.do === {pressed})?.focus()'
#: What a page hands on of a press in the rows: what is done, and with which row or column.
PRESSED = """(event) => {
  const button = event.target.closest("[data-do]");
  if (button) emit(button.dataset.do);
}"""


def row_name(table: PointTable, row: int) -> str:
    """Return what a row is called."""
    label = table.labels[row] if table.labels else ""
    if label in ("best", "start"):
        return label.capitalize()
    return f"Point {row + 1}" + (f", {label}" if label else "")


def rows_html(table: PointTable, run: Run, rows: list[int], pages: int) -> str:
    """Return the rows of a table with buttons to pick each, to sort by a column, to turn pages."""
    heads = []
    for column in table.columns:
        here = run.sort == column.name
        way = ("descending" if run.descending else "ascending") if here else "none"
        mark = _MARKS[run.descending] if here else ""
        heads.append(
            f'<th aria-sort="{way}"><button data-do="sort:{escape(column.name)}" '
            f'title="Sort by it">{escape(column.heading)}{mark}</button></th>'
        )
    body = []
    for row in rows:
        chosen = run.picked == row
        cells = "".join(f"<td>{_cell(c.values[row])}</td>" for c in table.columns)
        label = f" {escape(table.labels[row])}" if table.labels else ""
        body.append(
            f'<tr{" class=chosen" if chosen else ""}><td class="text"><button '
            f'data-do="pick:{row}" aria-pressed="{str(chosen).lower()}" '
            f'aria-label="Pick point {row + 1}">{row + 1}</button>{label}</td>{cells}</tr>'
        )
    turn = ""
    if pages > 1:
        at = run.page
        back, on = max(at - 1, 0), min(at + 1, pages - 1)
        turn = (
            f'<div class="turn"><button data-do="page:{back}" aria-label="Rows before">◀</button>'
            f" {at + 1} of {pages} "
            f'<button data-do="page:{on}" aria-label="Next rows">▶</button></div>'
        )
    return (
        f'<div class="scroll" tabindex="0"><table><thead><tr><th class="text">point</th>'
        f"{''.join(heads)}</tr></thead><tbody>{''.join(body)}</tbody></table></div>{turn}"
    )


def _cell(value: float) -> str:
    return number(float(value)).replace("-", "−") if np.isfinite(value) else "–"
