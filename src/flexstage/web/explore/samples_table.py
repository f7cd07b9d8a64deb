"""Table of the samples of a study: varied parameters and figures of each."""

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
from flexstage.web.explore.state import ExploreRun
from flexstage.web.sessions import Preferences

#: Labels of the points of a multi-objective search.
DOMINATED, ON_FRONT = "dominated", "on the front"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SamplesColumn:
    """A column of numbers."""

    name: str
    """Identifier of the column."""
    heading: str
    """Heading with the unit."""
    short: str
    """Short heading for narrow axes."""
    values: Array
    """Values in that unit; NaN if unknown."""
    described: float
    """Value of the described stage; NaN if unknown."""
    is_varied: bool = False
    """The column is a varied parameter."""

    @property
    def varies(self) -> bool:
        """The values differ by more than a ten-thousandth of their size."""
        finite = self.values[np.isfinite(self.values)]
        return bool(finite.size) and bool(np.ptp(finite) > 1e-4 * np.abs(finite).max())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SamplesTable:
    """Samples, one per row; figures of a sample that is not computed yet are NaN."""

    variables: tuple[str, ...]
    """Names of the varied parameters."""
    points: Array
    """Parameters of the samples [SI], shape (S, d)."""
    columns: tuple[SamplesColumn, ...]
    """Columns of the table."""
    labels: tuple[str, ...] = ()
    """Labels of the rows, in addition to their number."""
    counts: tuple[int, ...] = ()
    """Number of values of each parameter on a grid; empty for other samples."""
    computed: int = 0
    """Number of computed samples."""

    @property
    def computed_rows(self) -> np.ndarray:
        """Rows whose figures are computed."""
        outcome = [c.values for c in self.columns if not c.is_varied]
        return np.flatnonzero(np.any(np.isfinite(outcome), axis=0))

    @property
    def varied(self) -> tuple[SamplesColumn, ...]:
        """Columns of the varied parameters."""
        return tuple(c for c in self.columns if c.is_varied)

    @property
    def outcome(self) -> tuple[SamplesColumn, ...]:
        """Columns of the figures."""
        return tuple(c for c in self.columns if not c.is_varied)

    def column(self, name: str) -> SamplesColumn | None:
        """Return a column by its identifier."""
        return next((c for c in self.columns if c.name == name), None)

    def ordered(self, name: str, *, descending: bool) -> list[int]:
        """Return the computed rows in the order of a column.

        Without a column the points of a front come first.
        """
        rows = self.computed_rows
        column = self.column(name)
        if column is None:
            searched = [bool(self.labels) and self.labels[i] == DOMINATED for i in rows]
            return rows[np.argsort(searched, kind="stable")].tolist()
        values = column.values[rows]
        order = np.argsort(-values if descending else values, kind="stable")
        return rows[order].tolist()

    def values(self, row: int) -> dict[str, float]:
        """Return the parameters of a row [SI]."""
        return dict(zip(self.variables, map(float, self.points[row]), strict=True))


def _varied(variable: Variable, values: Array) -> SamplesColumn:
    return SamplesColumn(
        name=variable.name,
        heading=variable.heading.replace("_", " "),
        short=variable.heading.replace("_", " "),
        values=values * variable.factor,
        described=variable.usual * variable.factor,
        is_varied=True,
    )


def _outcome(
    figure: Figure, values: Array, described: float, preferences: Preferences
) -> SamplesColumn:
    quantity = preferences.displayed(figure.display)
    sizes = np.abs(values[np.isfinite(values)])
    if quantity == figure.display and sizes.size:
        quantity = quantity.fitting(float(sizes.max()))
    axis = "" if figure.axis == WHOLE_STAGE else figure.axis
    unit = f"[{quantity.shown_unit}]" if quantity.shown_unit else ""
    return SamplesColumn(
        name=figure.name,
        heading=figure.heading_in(quantity),
        short=f"{short_label(figure)} {axis} {unit}".replace("\n", " "),
        values=np.where(np.abs(values) < quantity.zero, 0.0, values) * quantity.factor,
        described=described * quantity.factor,
    )


def _table(
    variables: Sequence[Variable],
    figures: Sequence[Figure],
    points: Array,
    values: Array,
    described: Array,
    preferences: Preferences,
) -> SamplesTable:
    columns = [_varied(v, points[:, i]) for i, v in enumerate(variables)]
    columns += [
        _outcome(f, values[:, k], float(described[k]), preferences) for k, f in enumerate(figures)
    ]
    return SamplesTable(
        variables=tuple(v.name for v in variables),
        points=points,
        columns=tuple(columns),
        computed=len(points),
    )


def of_sweep(sweep: Sweep, preferences: Preferences) -> SamplesTable:
    """Return the samples of a sweep, with the figures that vary."""
    order = list(sweep.varying) or list(range(len(sweep.figures)))
    table = _table(
        sweep.variables,
        [sweep.figures[k] for k in order],
        sweep.points,
        sweep.values[:, order],
        sweep.described[order],
        preferences,
    )
    return replace(table, counts=sweep.counts)


def of_batches(
    question: tuple[Family, tuple[Figure, ...], SweepPlan],
    batches: Iterable[object],
    preferences: Preferences,
) -> SamplesTable:
    """Return the samples of a running or cancelled sweep."""
    family, figures, plan = question
    points = plan.points(family.variables)
    values = np.full((len(points), len(figures)), np.nan)
    computed = 0
    for batch in batches:
        if isinstance(batch, FinishedBatch) and batch.job == "sweep":
            values_of_batch = batch.arrays["values"]
            values[batch.start : batch.start + len(values_of_batch)] = values_of_batch
            computed += len(values_of_batch)
    unknown = np.full(len(figures), np.nan)
    table = _table(family.variables, figures, points, values, unknown, preferences)
    return replace(table, counts=plan.counts(family.variables), computed=computed)


def of_front(front: Front, preferences: Preferences) -> SamplesTable:
    """Return the points of a front; the last row is the selected design after refinement."""
    best = front.optimum
    figure_columns = [best.figures.index(figure) for figure in front.figures]
    table = _front_table(
        front.problem,
        np.vstack((front.points, best.point)),
        np.vstack((front.values, best.levels[0].best[figure_columns])),
        preferences,
    )
    labels = [ON_FRONT] * len(front.points)
    labels[front.selected] = "selected"
    return replace(table, labels=(*labels, "selected, refined"))


class SearchedFront:
    """The feasible designs of a running multi-objective search, with its present front.

    Each design is compared once with the front, as a search has thousands of designs.

    Parameters
    ----------
    problem
        The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._processed = 0
        self._points = np.zeros((0, len(problem.family.variables)))
        self._values = np.zeros((0, len(problem.figures)))
        self._front = np.zeros(0, dtype=int)

    def table(
        self, partial_results: Sequence[object], preferences: Preferences
    ) -> SamplesTable | None:
        """Return the points so far; None if there are none."""
        generations = [
            each for each in partial_results[self._processed :] if isinstance(each, Generation)
        ]
        self._processed = len(partial_results)
        if generations:
            count = len(self._points)
            self._points = np.vstack(
                (self._points, *(each.points[each.feasible] for each in generations))
            )
            self._values = np.vstack(
                (self._values, *(each.values[each.feasible] for each in generations))
            )
            rows = np.concatenate((self._front, np.arange(count, len(self._points))))
            self._front = rows[non_dominated(self._costs(rows))]
        if not len(self._points):
            return None
        table = _front_table(self._problem, self._points, self._values, preferences)
        labels = np.full(len(self._points), DOMINATED, dtype=object)
        labels[self._front] = ON_FRONT
        return replace(table, labels=tuple(labels))

    def _costs(self, rows: np.ndarray) -> Array:
        problem = self._problem
        columns = [problem.figures.index(goal.figure) for goal in problem.goals]
        return self._values[rows][:, columns] * np.array([goal.sign for goal in problem.goals])


def _front_table(
    problem: Problem, points: Array, values: Array, preferences: Preferences
) -> SamplesTable:
    unknown = np.full(len(problem.figures), np.nan)
    variables = problem.family.variables
    table = _table(variables, problem.figures, points, values, unknown, preferences)
    return replace(table, columns=(*table.outcome, *table.varied))


def of_steps(
    problem: Problem, partial_results: Iterable[object], preferences: Preferences
) -> SamplesTable | None:
    """Return the steps of a running or cancelled search; None before the first."""
    steps = [each for each in partial_results if isinstance(each, SearchStep)]
    if not steps:
        return None
    points = np.array([step.point for step in steps])
    varied = [_varied(v, points[:, i]) for i, v in enumerate(problem.family.variables)]
    return SamplesTable(
        variables=tuple(v.name for v in problem.family.variables),
        points=points,
        columns=(*history_columns(problem, [s.entry for s in steps], preferences), *varied),
        computed=len(steps),
    )


def history_columns(
    problem: Problem, trace: Sequence[HistoryEntry], preferences: Preferences
) -> tuple[SamplesColumn, ...]:
    """Return the history of a search: evaluations, goal and constraint violation."""
    objective = np.array([step.objective for step in trace])
    if problem.goals:
        goal = _outcome(problem.goals[0].figure, objective, np.nan, preferences)
    else:
        goal = _plain("distance", "Distance from the start [range of the bounds]", objective)
    violation = 100.0 * np.array([step.violation for step in trace])
    evaluations = np.array([float(step.evaluations) for step in trace])
    return (
        _plain("evaluations", "Evaluations of the rigid-body model", evaluations),
        goal,
        _plain("violation", "Constraint violation [%]", violation),
    )


def _plain(name: str, heading: str, values: Array) -> SamplesColumn:
    return SamplesColumn(name=name, heading=heading, short=heading, values=values, described=np.nan)


def of_optimum(optimum: Optimum, preferences: Preferences) -> SamplesTable:
    """Return the start and the best design by the finest model."""
    level = optimum.levels[-1]
    table = _front_table(
        optimum.problem,
        np.array([optimum.start, optimum.point]),
        np.array([level.start, level.best]),
        preferences,
    )
    return replace(table, labels=("start", "best"))


#: Rows of one page of the table.
ROWS = 12
_MARKS = {True: " ▼", False: " ▲"}
#: Script that returns the focus to the pressed button, as the rows are rebuilt.
FOCUS = '[...document.querySelectorAll("[data-do]")].find(b => b.dataset.do === {pressed})?.focus()'
#: Script that emits the action of a pressed button, and its row or column.
PRESSED = """(event) => {
  const button = event.target.closest("[data-do]");
  if (button) emit(button.dataset.do);
}"""


def row_name(table: SamplesTable, row: int) -> str:
    """Return the name of a row."""
    label = table.labels[row] if table.labels else ""
    if label in ("best", "start"):
        return label.capitalize()
    return f"Point {row + 1}" + (f", {label}" if label else "")


def rows_html(table: SamplesTable, run: ExploreRun, rows: list[int], pages: int) -> str:
    """Return the rows as HTML, with buttons to select, to sort by a column, and to turn pages."""
    headings = []
    for column in table.columns:
        is_sorted = run.sort_column == column.name
        order = ("descending" if run.descending else "ascending") if is_sorted else "none"
        mark = _MARKS[run.descending] if is_sorted else ""
        headings.append(
            f'<th aria-sort="{order}"><button data-do="sort:{escape(column.name)}" '
            f'title="Sort by this column">{escape(column.heading)}{mark}</button></th>'
        )
    body = []
    for row in rows:
        is_selected = run.selected_row == row
        cells = "".join(f"<td>{_cell(c.values[row])}</td>" for c in table.columns)
        label = f" {escape(table.labels[row])}" if table.labels else ""
        body.append(
            f'<tr{" class=chosen" if is_selected else ""}><td class="text"><button '
            f'data-do="select:{row}" aria-pressed="{str(is_selected).lower()}" '
            f'aria-label="Select point {row + 1}">{row + 1}</button>{label}</td>{cells}</tr>'
        )
    pager = ""
    if pages > 1:
        page = run.page
        previous, following = max(page - 1, 0), min(page + 1, pages - 1)
        pager = (
            f'<div class="turn"><button data-do="page:{previous}" aria-label="Previous rows">◀'
            f"</button> {page + 1} of {pages} "
            f'<button data-do="page:{following}" aria-label="Next rows">▶</button></div>'
        )
    return (
        f'<div class="scroll" tabindex="0"><table><thead><tr><th class="text">point</th>'
        f"{''.join(headings)}</tr></thead><tbody>{''.join(body)}</tbody></table></div>{pager}"
    )


def _cell(value: float) -> str:
    return number(float(value)).replace("-", "−") if np.isfinite(value) else "–"
