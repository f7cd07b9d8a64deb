"""Optimisation problems: variables, goals and requirements, scaled to the order of 1."""

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.files.plain import plain
from flexstage.stage import check
from flexstage.studies.explore.family import Family, evaluate, jacobian
from flexstage.studies.explore.figures import Figure, Requirement
from flexstage.studies.explore.optimise.local_search import Bools, Program


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correction:
    """Difference or ratio of two models, to first order about a point."""

    at: Array
    """The point, variables from 0 to 1, shape (d,)."""
    factor: Bools
    """True for figures with a ratio, False for those with a difference, shape (m,)."""
    shift: Array
    """Logarithm of the ratio, or the difference, at the point, shape (m,)."""
    slope: Array
    """Gradient of the shift, shape (m, d)."""

    @classmethod
    def none(cls, variables: int, figures: int) -> Self:
        """Return the identity: no correction."""
        return cls(
            at=np.zeros(variables),
            factor=np.ones(figures, dtype=bool),
            shift=np.zeros(figures),
            slope=np.zeros((figures, variables)),
        )

    def at_points(self, points: Array, coarse: Array) -> Array:
        """Return corrected values, shape (S, m), at points (S, d)."""
        shift = self.shift + (points - self.at) @ self.slope.T
        return np.where(self.factor, coarse * np.exp(shift * self.factor), coarse + shift)

    def of_slopes(self, point: Array, coarse: Array, slopes: Array) -> tuple[Array, Array]:
        """Return corrected values (m,) and gradients (m, d) at a point."""
        values = self.at_points(point[None], coarse[None])[0]
        shift = self.shift + self.slope @ (point - self.at)
        factor = np.exp(shift * self.factor)
        scaled = factor[:, None] * slopes + values[:, None] * self.slope
        return values, np.where(self.factor[:, None], scaled, slopes + self.slope)

    def updated(self, point: Array, coarse: Array, fine: Array) -> "Correction":
        """Return the correction that is exact at another point.

        The gradient has the least change that keeps the correction exact at the previous point
        (Broyden 1965, Math. Comp. 19, 577; manifold mapping: Echeverria, Hemker 2005).

        Parameters
        ----------
        point : array
            The point, shape (d,).
        coarse, fine : array
            Figures by the two models, shape (m,).

        Examples
        --------
        >>> none = Correction.none(1, 1)
        >>> correction = none.updated(np.array([0.5]), np.array([300.0]), np.array([330.0]))
        >>> correction.at_points(np.array([[0.5], [0.6]]), np.array([[300.0], [310.0]]))
        array([[330.],
               [341.]])
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = fine / coarse
        # a ratio beyond five is not extrapolated: the difference is used instead
        factor = np.isfinite(ratio) & (ratio > 1.0 / 5.0) & (ratio < 5.0)
        shift = np.where(factor, np.log(np.where(factor, ratio, 1.0)), fine - coarse)
        first = not (self.shift.any() or self.slope.any())
        step = point - self.at
        length = float(step @ step)
        slope = self.slope
        # shorter steps, as shares of the bounds, are too short for a gradient
        if not first and length > 0.01**2:
            error = shift - self.shift - slope @ step
            slope = slope + np.outer(error, step) / length
        slope = np.where((factor == self.factor)[:, None], slope, 0.0)
        return Correction(at=point, factor=factor, shift=shift, slope=slope)


Direction = Literal["maximise", "minimise"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """An objective: a figure to maximise or to minimise."""

    figure: Figure
    """The figure."""
    direction: Direction
    """``maximise`` or ``minimise``."""

    @property
    def sign(self) -> float:
        """Factor on the figure for minimisation."""
        return -1.0 if self.direction == "maximise" else 1.0

    @property
    def text(self) -> str:
        """The goal in words."""
        return f"{self.direction} {self.figure.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedGoal:
    """A goal of a front as a constraint, while another goal is optimised."""

    goal: Goal
    """The goal."""
    value: float
    """Limit of its figure, in the unit of the figure."""

    @property
    def requirement(self) -> Requirement:
        """The constraint."""
        if self.goal.direction == "maximise":
            return Requirement(figure=self.goal.figure, low=self.value)
        return Requirement(figure=self.goal.figure, high=self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An optimisation problem: goals, requirements and variables of a stage.

    Without a goal the solution is the stage that meets all requirements and is nearest to the
    start, relative to the bounds. Target matching is thus unique with more variables than targets.
    """

    family: Family
    """The stage, its variables and their bounds."""
    goals: tuple[Goal, ...] = ()
    """Objectives; several have a Pareto front instead of an optimum."""
    requirements: tuple[Requirement, ...] = ()
    """Requested constraints."""
    defaults: tuple[Requirement, ...] = ()
    """Default constraints: stress, drive, stroke and walls."""
    other_goals: tuple[FixedGoal, ...] = ()
    """Other goals of a front, fixed at a point of it; they are not requirements."""
    checked: bool = True
    """True if a stage that fails `flexstage.stage.check` is infeasible."""
    notes: tuple[str, ...] = ()
    """Remarks on the problem."""

    def __post_init__(self) -> None:
        if not self.goals and not self.requirements:
            raise ModelError(
                "the problem has no objective: name a figure to maximise or to minimise, or values "
                "to match"
            )

    @property
    def all_requirements(self) -> tuple[Requirement, ...]:
        """Requested requirements, then the default ones."""
        return (*self.requirements, *self.defaults)

    @property
    def limits(self) -> tuple[Requirement, ...]:
        """All constraints of a search: requirements, then fixed goals."""
        return (*self.all_requirements, *(other.requirement for other in self.other_goals))

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures of goals and requirements, each once."""
        figures = (*(g.figure for g in self.goals), *(r.figure for r in self.limits))
        return tuple(dict.fromkeys(figures))

    def data(self) -> dict[str, Any]:
        """Return the problem as plain data."""
        return {
            "stage": self.family.template.source,
            "goals": [goal.text for goal in self.goals],
            "requirements": [r.text for r in self.requirements],
            "default_requirements": [r.text for r in self.defaults],
        }

    def by_name(self, values: Array) -> dict[str, float | None]:
        """Return values of the figures as plain data, by name."""
        return dict(zip((f.name for f in self.figures), plain(values), strict=True))

    @property
    def low(self) -> Array:
        """Lower bounds of the variables, in SI."""
        return np.array([v.low for v in self.family.variables])

    @property
    def width(self) -> Array:
        """Widths of the ranges of the variables, in SI."""
        return np.array([v.high - v.low for v in self.family.variables])

    def point(self, x: Array) -> Array:
        """Return the variables in SI for variables from 0 to 1."""
        return self.low + x * self.width

    def fault(self, point: Array) -> str:
        """Return why the stage of a point in SI is infeasible; empty if it is feasible."""
        try:
            stage = self.family.stage(point)
        except FlexstageError as error:
            return str(error)
        if not self.checked:
            return ""
        return next((issue.message for issue in check(stage) if issue.severity == "error"), "")

    def position(self, point: Array) -> Array:
        """Return variables from 0 to 1 for variables in SI."""
        return (point - self.low) / self.width


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Scale of a figure: v = F / reference up to 1, 1 + log(F / reference) above.

    Figures of a start may be far from their limits. The logarithm makes a linear model of them
    better, and its derivative is continuous at the reference, the limit of a requirement.
    """

    reference: float
    """Reference value, in the unit of the figure."""

    @classmethod
    def of(cls, requirement: Requirement) -> "Scale":
        """Return the scale of a requirement, with its limit as the reference."""
        limits = [v for v in (requirement.low, requirement.high) if v is not None]
        largest = max(limits, key=abs)
        return cls(reference=largest or 1.0)

    def value(self, figure: Array) -> Array:
        """Return scaled values of the figure."""
        r = figure / abs(self.reference)
        return r if self.reference < 0.0 else np.where(r > 1.0, 1.0 + np.log(np.maximum(r, 1.0)), r)

    def slope(self, figure: Array) -> Array:
        """Return the derivative of the scaled value by the figure."""
        r = figure / abs(self.reference)
        derivative = np.ones_like(r) if self.reference < 0.0 else 1.0 / np.maximum(r, 1.0)
        return derivative / abs(self.reference)


@dataclass(slots=True, kw_only=True, eq=False)
class StageProgram(Program):
    """A problem with at most one goal as a `Program`, with variables from 0 to 1."""

    problem: Problem
    """The problem."""
    nearest_to: Array
    """Start point, to which the distance is minimised without a goal, from 0 to 1."""
    goal_reference: float = 1.0
    """Reference value of the goal."""
    correction: Correction | None = None
    """Correction of the model by a finer one."""
    model: str = "lumped"
    """The model of the search."""
    counts: Counter[str] = field(default_factory=Counter)
    """Number of evaluations so far, by model."""

    def __post_init__(self) -> None:
        self._figures = self.problem.figures
        self._constraints = self.problem.limits
        at = {figure: i for i, figure in enumerate(self._figures)}
        self._rows = [at[r.figure] for r in self._constraints]
        self._scales = [Scale.of(r) for r in self._constraints]

    _figures: tuple[Figure, ...] = field(init=False, repr=False)
    _constraints: tuple[Requirement, ...] = field(init=False, repr=False)
    _rows: list[int] = field(init=False, repr=False)
    _scales: list[Scale] = field(init=False, repr=False)

    @property
    def low(self) -> Array:
        return self._limits([r.low for r in self._constraints], -np.inf)

    @property
    def high(self) -> Array:
        return self._limits([r.high for r in self._constraints], np.inf)

    def _limits(self, limits: list[float | None], none: float) -> Array:
        scaled = (
            none if limit is None else float(scale.value(np.array(limit)))
            for limit, scale in zip(limits, self._scales, strict=True)
        )
        return np.array(list(scaled))

    def uncorrected(self, points: Array) -> Array:
        """Return the figures (S, F) by the model of the search, without correction."""
        self.counts[self.model] += len(points)
        family = self.problem.family
        return evaluate(family, self.problem.point(points), self._figures, self.model).values

    def figures(self, points: Array) -> Array:
        """Return the corrected figures (S, F)."""
        figures = self.uncorrected(points)
        return figures if self.correction is None else self.correction.at_points(points, figures)

    def values(self, points: Array) -> Array:
        values = self.scaled(points, self.figures(points))
        if self.problem.checked:
            rows = np.flatnonzero(np.all(np.isfinite(values), axis=1))
            values[rows[~self.possible(points[rows])]] = np.nan
        return values

    def scaled(self, points: Array, figures: Array) -> Array:
        """Return objective and constraints (S, 1 + m) for figures (S, F) at points (S, d)."""
        rows = [s.value(figures[:, i]) for i, s in zip(self._rows, self._scales, strict=True)]
        if self.problem.goals:
            goal = self.problem.goals[0]
            objective = goal.sign * self._goal.value(figures[:, 0])
        else:
            objective = 0.5 * np.sum((points - self.nearest_to) ** 2, axis=1)
        return np.stack([objective, *rows], axis=1)

    @property
    def _goal(self) -> Scale:
        return Scale(reference=self.goal_reference)

    def goal_figure(self, objective: float) -> float:
        """Return the figure of the goal for an objective."""
        r = self.problem.goals[0].sign * objective
        return self.goal_reference * (np.exp(r - 1.0) if r > 1.0 else r)

    def slopes(self, point: Array) -> tuple[Array, Array]:
        family, width = self.problem.family, self.problem.width
        self.counts[self.model] += 1 + 2 * len(point)
        try:
            figures, slopes = jacobian(family, self.problem.point(point), self._figures, self.model)
        except FlexstageError:  # the stage is impossible
            none = np.full((1 + len(self._constraints), len(point)), np.nan)
            return none[:, 0], none
        slopes = slopes * width
        if self.correction is not None:
            figures, slopes = self.correction.of_slopes(point, figures, slopes)
        values = self.scaled(point[None], figures[None])[0]
        rows = [
            s.slope(figures[i]) * slopes[i] for i, s in zip(self._rows, self._scales, strict=True)
        ]
        if self.problem.goals:
            goal = self.problem.goals[0]
            objective = goal.sign * self._goal.slope(figures[0]) * slopes[0]
        else:
            objective = point - self.nearest_to
        return values, np.stack([objective, *rows])

    def possible(self, points: Array) -> Bools:
        return np.array([self._fault(p) == "" for p in self.problem.point(points)], dtype=bool)

    def fault(self, x: Array) -> str:
        """Return why a point is impossible; empty if it is possible."""
        return self._fault(self.problem.point(x))

    def _fault(self, point: Array) -> str:
        self.counts["geometry"] += 1
        return self.problem.fault(point)

    def corrected(self, correction: Correction) -> "StageProgram":
        """Return the same program with another correction."""
        return replace(self, correction=correction)
