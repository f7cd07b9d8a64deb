"""What is optimised: variables, goals and requirements, as functions of numbers of size one."""

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
    """The discrepancy of two models, to first order about a point."""

    at: Array
    """The point, variables from 0 to 1, shape (d,)."""
    factor: Bools
    """Which figures have a factor, and which a difference, shape (m,)."""
    shift: Array
    """Logarithm of the factor, or the difference, there, shape (m,)."""
    slope: Array
    """How that changes with the variables, shape (m, d)."""

    @classmethod
    def none(cls, variables: int, figures: int) -> Self:
        """Return the correction of a model that is taken as it is."""
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
        """Return corrected values (m,) and slopes (m, d) at a point."""
        values = self.at_points(point[None], coarse[None])[0]
        shift = self.shift + self.slope @ (point - self.at)
        factor = np.exp(shift * self.factor)
        scaled = factor[:, None] * slopes + values[:, None] * self.slope
        return values, np.where(self.factor[:, None], scaled, slopes + self.slope)

    def updated(self, point: Array, coarse: Array, fine: Array) -> "Correction":
        """Return the correction that is exact at another point.

        The slope takes the least change by which it explains the old discrepancy too (Broyden 1965,
        Math. Comp. 19, 577, as manifold mapping has it: Echeverria, Hemker 2005).

        Parameters
        ----------
        point : array
            The point, shape (d,).
        coarse, fine : array
            What the two models say there, shape (m,).

        Examples
        --------
        >>> none = Correction.none(1, 1)
        >>> known = none.updated(np.array([0.5]), np.array([300.0]), np.array([330.0]))
        >>> known.at_points(np.array([[0.5], [0.6]]), np.array([[300.0], [310.0]]))
        array([[330.],
               [341.]])
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = fine / coarse
        # beyond a factor of five two values are unlike each other: then their difference is carried
        factor = np.isfinite(ratio) & (ratio > 1.0 / 5.0) & (ratio < 5.0)
        shift = np.where(factor, np.log(np.where(factor, ratio, 1.0)), fine - coarse)
        first = not (self.shift.any() or self.slope.any())
        step = point - self.at
        length = float(step @ step)
        slope = self.slope
        # shorter steps, in parts of the bounds, say nothing of how the discrepancy changes
        if not first and length > 0.01**2:
            missed = shift - self.shift - slope @ step
            slope = slope + np.outer(missed, step) / length
        slope = np.where((factor == self.factor)[:, None], slope, 0.0)
        return Correction(at=point, factor=factor, shift=shift, slope=slope)


Way = Literal["maximise", "minimise"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """A figure that shall be as large, or as small, as it can be."""

    figure: Figure
    """The figure."""
    way: Way
    """``maximise`` or ``minimise``."""

    @property
    def sign(self) -> float:
        """What the figure is multiplied by, so that less is better."""
        return -1.0 if self.way == "maximise" else 1.0

    @property
    def text(self) -> str:
        """It in words."""
        return f"{self.way} {self.figure.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldGoal:
    """A goal of a front that is held while another one is made better."""

    goal: Goal
    """The goal."""
    value: float
    """What its figure shall be no worse than, in the unit of it."""

    @property
    def requirement(self) -> Requirement:
        """What holds it."""
        if self.goal.way == "maximise":
            return Requirement(figure=self.goal.figure, low=self.value)
        return Requirement(figure=self.goal.figure, high=self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What is sought: a stage of a family.

    Without a goal it is the stage nearest to the start, in parts of the bounds, that meets all
    requirements: so target matching has one answer where there are more variables than targets.
    """

    family: Family
    """Stages among which it is sought, and the bounds of their variables."""
    goals: tuple[Goal, ...] = ()
    """What is made best; several have no single best, but a Pareto front."""
    requirements: tuple[Requirement, ...] = ()
    """What is required."""
    usual: tuple[Requirement, ...] = ()
    """What is required without being asked: what can be stressed and driven."""
    exchanged: tuple[HeldGoal, ...] = ()
    """Other goals of a front, held at a point of it: nobody requires these values."""
    checked: bool = True
    """Whether a stage that `flexstage.stage.check` finds at fault is no stage: what can be made."""
    notes: tuple[str, ...] = ()
    """What is to be known of how it is put."""

    def __post_init__(self) -> None:
        if not self.goals and not self.requirements:
            raise ModelError(
                "nothing is sought: name a figure to maximise or to minimise, or values to match"
            )

    @property
    def all_requirements(self) -> tuple[Requirement, ...]:
        """All requirements, those that were asked for first."""
        return (*self.requirements, *self.usual)

    @property
    def limits(self) -> tuple[Requirement, ...]:
        """What a search keeps: all requirements, then what holds other goals."""
        return (*self.all_requirements, *(held.requirement for held in self.exchanged))

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures of goals and requirements, each once."""
        found = (*(g.figure for g in self.goals), *(r.figure for r in self.limits))
        return tuple(dict.fromkeys(found))

    def data(self) -> dict[str, Any]:
        """Return what is sought, as plain data."""
        return {
            "stage": self.family.template.source,
            "goals": [goal.text for goal in self.goals],
            "requirements": [r.text for r in self.requirements],
            "required_unasked": [r.text for r in self.usual],
        }

    def named(self, values: Array) -> dict[str, float | None]:
        """Return values of its figures as plain data, by their names."""
        return dict(zip((f.name for f in self.figures), plain(values), strict=True))

    @property
    def low(self) -> Array:
        """Lower bounds of the variables, in SI."""
        return np.array([v.low for v in self.family.variables])

    @property
    def width(self) -> Array:
        """What lies between the bounds of the variables, in SI."""
        return np.array([v.high - v.low for v in self.family.variables])

    def point(self, x: Array) -> Array:
        """Return the variables in SI for variables from 0 to 1."""
        return self.low + x * self.width

    def fault(self, point: Array) -> str:
        """Return why a point in SI is no stage, in a sentence; empty where it is one."""
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
    """A figure as a number of size one: v = F / reference up to 1, 1 + log(F / reference) above.

    Figures may be wrong by large factors at first: the logarithm keeps them in reach of a linear
    model. It has one slope at the reference, where a requirement holds.
    """

    reference: float
    """What the figure is measured by, in its unit."""

    @classmethod
    def of(cls, requirement: Requirement) -> "Scale":
        """Return the scale of a requirement: its limit."""
        limits = [v for v in (requirement.low, requirement.high) if v is not None]
        largest = max(limits, key=abs)
        return cls(reference=largest or 1.0)

    def value(self, figure: Array) -> Array:
        """Return the number for values of the figure."""
        r = figure / abs(self.reference)
        return r if self.reference < 0.0 else np.where(r > 1.0, 1.0 + np.log(np.maximum(r, 1.0)), r)

    def slope(self, figure: Array) -> Array:
        """Return its derivative by the figure."""
        r = figure / abs(self.reference)
        bent = np.ones_like(r) if self.reference < 0.0 else 1.0 / np.maximum(r, 1.0)
        return bent / abs(self.reference)


@dataclass(slots=True, kw_only=True, eq=False)
class StageProgram(Program):
    """A problem with at most one goal as a `Program`: minimise, within limits, from 0 to 1."""

    problem: Problem
    """The problem."""
    nearest_to: Array
    """Where the point shall be near to where there is no goal, from 0 to 1."""
    goal_reference: float = 1.0
    """What the figure of the goal is measured by."""
    correction: Correction | None = None
    """What is known of a finer model."""
    model: str = "lumped"
    """The model that is searched."""
    counts: Counter[str] = field(default_factory=Counter)
    """Evaluations so far, by model."""

    def __post_init__(self) -> None:
        self._figures = self.problem.figures
        self._asked = self.problem.limits
        at = {figure: i for i, figure in enumerate(self._figures)}
        self._rows = [at[r.figure] for r in self._asked]
        self._scales = [Scale.of(r) for r in self._asked]

    _figures: tuple[Figure, ...] = field(init=False, repr=False)
    _asked: tuple[Requirement, ...] = field(init=False, repr=False)
    _rows: list[int] = field(init=False, repr=False)
    _scales: list[Scale] = field(init=False, repr=False)

    @property
    def low(self) -> Array:
        return self._limits([r.low for r in self._asked], -np.inf)

    @property
    def high(self) -> Array:
        return self._limits([r.high for r in self._asked], np.inf)

    def _limits(self, limits: list[float | None], none: float) -> Array:
        scaled = (
            none if limit is None else float(scale.value(np.array(limit)))
            for limit, scale in zip(limits, self._scales, strict=True)
        )
        return np.array(list(scaled))

    def coarse(self, points: Array) -> Array:
        """Return the figures (S, F) by the model that is searched, without correction."""
        self.counts[self.model] += len(points)
        family = self.problem.family
        return evaluate(family, self.problem.point(points), self._figures, self.model).values

    def figures(self, points: Array) -> Array:
        """Return the figures (S, F), corrected."""
        found = self.coarse(points)
        return found if self.correction is None else self.correction.at_points(points, found)

    def values(self, points: Array) -> Array:
        found = self.scaled(points, self.figures(points))
        if self.problem.checked:
            told = np.flatnonzero(np.all(np.isfinite(found), axis=1))
            found[told[~self.possible(points[told])]] = np.nan
        return found

    def scaled(self, points: Array, figures: Array) -> Array:
        """Return objective and constraints (S, 1 + m) of figures (S, F) at points (S, d)."""
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
        """Return the figure of the goal for a value of the objective."""
        r = self.problem.goals[0].sign * objective
        return self.goal_reference * (np.exp(r - 1.0) if r > 1.0 else r)

    def slopes(self, point: Array) -> tuple[Array, Array]:
        family, width = self.problem.family, self.problem.width
        self.counts[self.model] += 1 + 2 * len(point)
        try:
            figures, slopes = jacobian(family, self.problem.point(point), self._figures, self.model)
        except FlexstageError:  # no stage
            none = np.full((1 + len(self._asked), len(point)), np.nan)
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
        """Return why a point is impossible, in a sentence; empty where it is not."""
        return self._fault(self.problem.point(x))

    def _fault(self, point: Array) -> str:
        self.counts["geometry"] += 1
        return self.problem.fault(point)

    def corrected(self, correction: Correction) -> "StageProgram":
        """Return the same program by a model that is corrected otherwise."""
        return replace(self, correction=correction)
