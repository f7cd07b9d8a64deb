r"""Reconstruction of a stage from figures: what they tell of its dimensions and other figures.

Dimensions d are log-normal before, :math:`d_i = m_i \exp(\sigma_i z_i)` with z normal, of mean 0
and covariance 1. The lumped model, times its ratio to a superelement model that is log-linear in
z, is fitted to the given figures. With the derivatives J of their superelement values there,
whitened by their noise, the covariance of z is :math:`(J^T J + 1)^{-1}`
(`flexstage.measure.posterior`).

Members of the ensemble are drawn by randomise-then-optimise: prior mean and given figures are
disturbed by their own distributions, and the most probable dimensions are found again (J. Bardsley
et al., SIAM J. Sci. Comput. 36 (2014) A1895). Infeasible draws are refused, so that limits of the
geometry belong to what is known before.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, FlexstageError, ModelError
from flexstage.base.provenance import provenance
from flexstage.measure.posterior import FAR, Posterior, half_square, most_probable
from flexstage.stage import check
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.batches import Job
from flexstage.studies.explore.ensemble import (
    Ensemble,
    FreeDimension,
    Observation,
    Stop,
    rows_of,
    scaled,
    unscaled,
)
from flexstage.studies.explore.family import Family, evaluate, jacobian
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.problem import Correction
from flexstage.studies.explore.variables import Variable
from flexstage.studies.explore.workers import Workers
from flexstage.studies.models import analyse_model


@dataclass(frozen=True, slots=True, kw_only=True)
class _Effort:
    """Steps and limits of a reconstruction, tuned on the piezo stage and on a bridge."""

    step: float = 0.2
    """Step of difference quotients of superelements, in standard deviations before."""
    halvings: int = 4
    """Number of times that a step is halved where there is no such stage."""
    approaches: int = 5
    """Largest number of superelements on the way to the most probable stage."""
    starts: int = 12
    """Starts of further searches where the first one leaves figures unexplained: draws about the
    best linear estimate so far, of stages that exist.
    """
    near: float = 0.3
    """Distance, in standard deviations before, over which derivatives hold: a stage this far from
    the most probable one needs no others, and a member is corrected by no more.
    """
    refinements: int = 6
    """Largest number of steps of a member."""
    settled: float = 0.02
    """Step at which a member is settled, in standard deviations before."""
    draws: int = 200
    """Largest number of draws for each member."""
    at_once: int = 12
    """Members between two looks at the clock."""
    rounds: int = 4
    """Largest number of computed stages for each member."""


_EFFORT = _Effort()
#: Probability of a chi-squared below which a search is repeated from elsewhere [1].
_UNLIKELY = 0.01


def dimension_of(variable: Variable) -> FreeDimension:
    """Return the prior of a dimension: a standard deviation to either side within its range.

    The median is the described value where the range is symmetric about it, as one in per cent is;
    of any other range the geometric mean.

    Raises
    ------
    ModelError
        The range contains zero.
    """
    if variable.low * variable.high <= 0.0:
        raise ModelError(
            f"the range of '{variable.name}', {variable.range_text}, contains 0, and its "
            "logarithm is normal: give a range on one side of 0"
        )
    low, high = sorted((abs(variable.low), abs(variable.high)))
    symmetric = math.isclose(variable.usual, variable.middle, rel_tol=1e-9)
    middle = variable.usual if symmetric else math.copysign(math.sqrt(low * high), variable.low)
    return FreeDimension(variable=variable, median=middle, sigma=0.5 * math.log(high / low))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stages:
    """Stages over the coordinates z of their dimensions."""

    family: Family
    dimensions: tuple[FreeDimension, ...]

    @classmethod
    def of(cls, template: StageTemplate, dimensions: tuple[FreeDimension, ...]) -> "_Stages":
        variables = tuple(d.variable for d in dimensions)
        return cls(family=Family(template=template, variables=variables), dimensions=dimensions)

    def points(self, z: Array) -> Array:
        """Return dimensions [SI] at coordinates, shape (..., p)."""
        median = np.array([d.median for d in self.dimensions])
        sigma = np.array([d.sigma for d in self.dimensions])
        return median * np.exp(sigma * z)

    def rates(self, z: Array) -> Array:
        """Return the derivatives of dimensions by their coordinates, shape (p,)."""
        return self.points(z) * np.array([d.sigma for d in self.dimensions])

    def exists(self, z: Array) -> bool:
        """Return whether there is such a stage."""
        try:
            self.family.stage(self.points(z))
        except FlexstageError:
            return False
        return True

    def feasible(self, z: Array) -> bool:
        """Return whether there is such a stage, and it can be made."""
        try:
            stage = self.family.stage(self.points(z))
        except FlexstageError:
            return False
        return all(issue.severity != "error" for issue in check(stage))

    def near(self, z: Array) -> "_Stages":
        """Return the same stages, with superelements near those of a stage among them."""
        values = self.family.values(self.points(z))
        template = self.family.template.with_values(values)
        return replace(self, family=replace(self.family, template=template))

    def figures(self, z: Array, figures: Sequence[Figure], model: str) -> Array:
        """Return figures at coordinates (S, p), shape (S, f); NaN where there is no such stage."""
        return evaluate(self.family, self.points(z), figures, model).values


class _Fit:
    """Whitened residuals of the corrected lumped model, over coordinates less those of the prior.

    It implements `flexstage.measure.posterior.WhitenedProblem`.
    """

    bent = False

    def __init__(
        self,
        stages: _Stages,
        observations: Sequence[Observation],
        correction: Correction | None = None,
    ) -> None:
        self.stages, self.observations = stages, tuple(observations)
        self.size = len(stages.dimensions)
        self.figures = tuple(o.figure for o in observations)
        self.logarithmic = np.array([o.logarithmic for o in observations])
        self.spread = np.array([o.spread for o in observations])
        self.target = self.scaled(np.array([o.value for o in observations])) / self.spread
        self.correction = correction or Correction.none(self.size, len(self.observations))
        self._last: tuple[Array, Array, Array] | None = None
        self._refused = 0

    def scaled(self, values: Array) -> Array:
        """Return values, or their logarithms."""
        return scaled(values, self.logarithmic)

    def whitened(self, values: Array) -> Array:
        """Return values of the given figures in units of their noise, shape (..., n)."""
        return self.scaled(values) / self.spread

    def coarse(self, z: Array) -> Array:
        """Return the lumped figures (S, n); 0 for a figure that this model does not have."""
        evaluation = evaluate(self.stages.family, self.stages.points(z), self.figures, "lumped")
        possible = np.array([not fault for fault in evaluation.faults])
        missing = np.isnan(evaluation.values) & possible[:, None]
        return np.where(missing, 0.0, evaluation.values)

    def predicted(self, z: Array) -> Array:
        """Return the corrected figures at coordinates (S, p), whitened, shape (S, n)."""
        return self.whitened(self.correction.at_points(z, self.coarse(z)))

    def residual(self, x: Array) -> Array:
        return self.target - self.predicted(x[None])[0]

    def residual_or_refused(self, x: Array) -> Array:
        residual = self._possible(x)
        self._refused = 0 if np.isfinite(residual).all() else self._refused + 1
        # a step that is refused however short leads to a limit, along which `_up_to_limits` goes
        if self._refused > _EFFORT.halvings:
            raise ConvergenceError(FAR)
        return residual

    def _possible(self, x: Array) -> Array:
        residual = self.residual(x)
        return residual if np.isfinite(residual).all() else np.full(residual.size, math.inf)

    def coarse_slopes(self, x: Array) -> tuple[Array, Array]:
        """Return the lumped figures (n,) and their derivatives (n, p); 0 if the model lacks one."""
        # the last ones again where a search continues with another correction
        if self._last is None or not np.array_equal(self._last[0], x):
            values, slopes = jacobian(self.stages.family, self.stages.points(x), self.figures)
            rates = self.stages.rates(x)
            self._last = x.copy(), np.nan_to_num(values), np.nan_to_num(slopes) * rates
        return self._last[1:]

    def jacobian(self, x: Array) -> Array:
        values, slopes = self.correction.of_slopes(x, *self.coarse_slopes(x))
        return rows_of(slopes, values, self.logarithmic) / self.spread[:, None]

    def search(self, start: Array) -> tuple[Array, Array]:
        """Return the most probable coordinates, and those of the same by the linear model there.

        They differ only where limits of the geometry exclude the latter. A search that leaves the
        given figures unexplained is repeated from elsewhere, until one explains them.
        """
        best = self._from(start)
        if self._explained(best[0]):
            return best
        # limits of the geometry may stop the search on the way
        generator, starts = np.random.default_rng(0), 0
        root = self._root(best[0])
        for draw in generator.standard_normal((_EFFORT.draws, self.size)):
            z = best[1] + root @ draw
            if not self.stages.exists(z):
                continue
            other = self._from(z)
            if self._explained(other[0]):
                return other
            if self._cost(other[0]) < self._cost(best[0]):
                best, root = other, self._root(other[0])
            starts += 1
            if starts == _EFFORT.starts:
                break
        return best

    def _root(self, x: Array) -> Array:
        """Return a root of the covariance by the linear model at x."""
        covariance = Posterior.of(self.jacobian(x)).covariance
        return np.asarray(np.linalg.cholesky(covariance), dtype=float)

    def _from(self, start: Array) -> tuple[Array, Array]:
        self._refused = 0
        try:
            best, *_ = most_probable(self, start)
        except ConvergenceError:
            return self._up_to_limits(start)
        return best, best

    def _cost(self, x: Array) -> float:
        return half_square(self._possible(x), x)

    def _explained(self, x: Array) -> bool:
        """Return whether figures and prior do not contradict each other at x."""
        from scipy.special import chdtrc

        return bool(chdtrc(len(self.target), 2.0 * self._cost(x)) > _UNLIKELY)

    def _up_to_limits(self, start: Array) -> tuple[Array, Array]:
        """Search as `search` does, among stages that exist; coordinates at a limit wait there."""
        x, free = start, np.ones(self.size, dtype=bool)
        for _ in range(2 * _EFFORT.refinements):
            jacobian, residual = self.jacobian(x), self.residual(x)
            step = _newton_step(jacobian, residual, x, free)
            if np.linalg.norm(step) < _EFFORT.settled:
                break
            fraction = self._fraction(x, step)
            if fraction == 0.0:
                limited = [j for j in np.flatnonzero(step).tolist() if self._blocked(x, step, j)]
                if not limited:
                    break
                free[limited] = False
            else:
                free[:] = True
            x = x + fraction * step
        return x, x + _newton_step(self.jacobian(x), self.residual(x), x)

    def _fraction(self, x: Array, step: Array) -> float:
        """Return the part of a step to the most probable stage along it; 0 if none is better."""
        fractions = np.array([0.0, *(0.5**k for k in range(_EFFORT.halvings))])
        there = x + fractions[:, None] * step
        squares = (self.target - self.predicted(there)) ** 2
        costs = np.sum(squares, axis=1) + np.sum(there**2, axis=1)
        return float(fractions[np.nanargmin(costs)])

    def _blocked(self, x: Array, step: Array, j: int) -> bool:
        moved = x.copy()
        moved[j] += 0.5**_EFFORT.halvings * step[j]
        return not self.stages.exists(moved)


def _newton_step(
    jacobian: Array, residual: Array, x: Array, free: NDArray[np.bool_] | None = None
) -> Array:
    """Return Gauss and Newton's step of the free coordinates."""
    at = np.arange(x.size) if free is None else np.flatnonzero(free)
    columns, step = jacobian[:, at], np.zeros(x.size)
    step[at] = np.linalg.solve(columns.T @ columns + np.eye(at.size), columns.T @ residual - x[at])
    return step


def reconstruct(
    template: StageTemplate,
    observations: Sequence[Observation],
    unknown: Sequence[FreeDimension],
    *,
    model: str = "superelement",
    members: int = 60,
    seed: int = 0,
    seconds: float = math.inf,
    workers: Workers | None = None,
) -> Ensemble:
    """Return what given figures tell of the dimensions of a stage and of its other figures.

    Parameters
    ----------
    template : StageTemplate
        The stage, whose form is known.
    observations : sequence of Observation
        Published or measured figures with their uncertainty.
    unknown : sequence of FreeDimension
        Dimensions with what is known of them before.
    model : str
        ``superelement``, or ``lumped`` for the lumped model alone.
    members : int
        Number of stages of the ensemble; 0 for Laplace's approximation alone.
    seed : int
        Random seed of the ensemble.
    seconds : float
        Time after which no more members are computed [s]. Laplace's approximation is not in it.
    workers : Workers, optional
        Worker processes; this process alone if not given.

    Raises
    ------
    ModelError
        Nothing is given or unknown, the model does not compute a given figure, or the described
        stage is impossible.

    Notes
    -----
    Members have superelements of a lower order on the meshes of the most probable stage, moved,
    less what these differ by there. On meshes of their own their stresses differed by some 0.5 %,
    other figures by 0.2 % or less (piezo stage and bridge).

    Validity: the form of the stage is known, log-normal dimensions and normal errors. Laplace's
    approximation is linear about the most probable stage, and knows no limits of the geometry; the
    ensemble does. Ctrl-C ends the members, and those so far are kept. What is not
    informed keeps what was put in before.
    """
    if not observations or not unknown:
        raise ModelError("a reconstruction needs at least one given figure and one free dimension")
    workers = workers or Workers(1)
    began = time.monotonic()
    stages = _Stages.of(template, tuple(unknown))
    described = analyse_model(template.stage(), model)
    figures = tuple(Figure(quantity=r.quantity, axis=r.axis) for r in described.characteristics)
    usual = np.array([r.value for r in described.characteristics])
    at = [_row_of(o.figure, figures, model) for o in observations]
    with progress.subtask(0.0, 0.1):
        fit, best, centre = _nearest(stages, observations, model)
    with progress.subtask(0.1, 0.4):
        values, slopes, moved = _slopes(stages, best, figures, model, workers)
    logarithmic = np.array([f.display.zero == 0.0 for f in figures]) & (values > 0.0)
    rows = rows_of(slopes, values, logarithmic)
    whitened = rows_of(slopes[at], values[at], fit.logarithmic) / fit.spread[:, None]
    posterior = Posterior.of(whitened)
    of_meshes = scaled(values, logarithmic) - scaled(moved, logarithmic)
    feasible = best
    if model != "lumped":
        fit.correction = _exact(best, *fit.coarse_slopes(best), values[at], slopes[at])
        feasible, centre = fit.search(best)
        values = stages.near(best).figures(feasible[None], figures, model)[0]
    middle = scaled(values, logarithmic) + rows @ (centre - feasible)
    ensemble = Ensemble(
        template=template,
        model=model,
        observations=tuple(observations),
        dimensions=tuple(unknown),
        figures=figures,
        described=usual,
        logarithmic=logarithmic,
        coordinates=centre,
        best=stages.points(feasible),
        best_values=values,
        middle=middle,
        rows=rows,
        posterior=posterior,
        points=np.zeros((0, len(unknown))),
        values=np.zeros((0, len(figures))),
        requested=members,
        stopped="",
        seed=seed,
        refused={},
        seconds={"laplace": time.monotonic() - began},
        provenance=provenance(template),
    )
    if members == 0:
        return ensemble
    began = time.monotonic()
    with progress.subtask(0.4, 1.0):
        sampler = _Sampler(fit, whitened, posterior, centre, np.random.default_rng(seed))
        z, values, stopped = _members(
            sampler, ensemble, stages.near(best), of_meshes, at, seconds, workers
        )
    return replace(
        ensemble,
        points=stages.points(z),
        values=values,
        stopped=stopped,
        refused=dict(sampler.refused),
        seconds=dict(ensemble.seconds) | {"members": time.monotonic() - began},
    )


def _row_of(figure: Figure, figures: Sequence[Figure], model: str) -> int:
    if figure not in figures:
        names = ", ".join(f.name for f in figures)
        raise ModelError(
            f"the {model} model does not compute {figure.name}: give other figures, of {names}"
        )
    return figures.index(figure)


def _nearest(
    stages: _Stages, observations: Sequence[Observation], model: str
) -> tuple[_Fit, Array, Array]:
    """Search the most probable stage by the lumped model, corrected by superelements on the way.

    Returned are the fit, and coordinates as `_Fit.search` gives them.
    """
    fit = _Fit(stages, observations)
    z = centre = np.zeros(fit.size)
    if model == "lumped":
        return fit, *fit.search(z)
    for k in range(_EFFORT.approaches):
        progress.update("most probable stage", k / _EFFORT.approaches)
        fine = stages.figures(z[None], fit.figures, model)[0]
        fit.correction = fit.correction.updated(z, fit.coarse(z[None])[0], fine)
        before = z
        z, centre = fit.search(z)
        if np.linalg.norm(z - before) < _EFFORT.near:
            break
    return fit, z, centre


def _slopes(
    stages: _Stages, z: Array, figures: tuple[Figure, ...], model: str, workers: Workers
) -> tuple[Array, Array, Array]:
    """Return figures (f,), their derivatives by the coordinates (f, p), and those on moved meshes.

    Derivatives of superelements are one-sided difference quotients, towards the side that has a
    stage, on meshes that move with the bodies.
    """
    if model == "lumped":
        values, slopes = jacobian(stages.family, stages.points(z), figures, model)
        return values, slopes * stages.rates(z), values
    values = stages.near(z).figures(z[None], figures, model)[0]
    if not np.isfinite(values).all():
        raise ModelError("the most probable stage has no superelement model: change the prior")
    near = stages.near(z)
    steps = np.array([_step(stages, z, j, _EFFORT.step) for j in range(z.size)])
    around = np.vstack([z, z + np.diag(steps)])
    base, *others = _on_moved_meshes(near, around, figures, model, workers, "derivatives")
    differences = np.array(others) - base
    refused = np.flatnonzero(~np.isfinite(differences).all(axis=1))
    if refused.size:  # the mesher may refuse one stage and take a nearer one
        steps[refused] = [_step(stages, z, j, -0.5 * steps[j]) for j in refused.tolist()]
        around = z + np.diag(steps)[refused]
        differences[refused] = (
            _on_moved_meshes(near, around, figures, model, workers, "derivatives") - base
        )
    refused = np.flatnonzero(~np.isfinite(differences).all(axis=1))
    if refused.size:
        names = [stages.dimensions[j].name for j in refused]
        raise ModelError(
            "superelements about the most probable stage cannot be computed on moved meshes, for "
            f"changes of {', '.join(names)}: give them smaller ranges, or fewer of them"
        )
    some = steps != 0.0
    slopes = np.where(some[:, None], differences / np.where(some, steps, 1.0)[:, None], 0.0)
    return values, slopes.T, base


def _on_moved_meshes(
    stages: _Stages,
    z: Array,
    figures: tuple[Figure, ...],
    model: str,
    workers: Workers,
    name: str,
) -> Array:
    """Return figures at coordinates (S, p) on the meshes of the described stage, moved, (S, f)."""
    job = Job(
        name=name,
        work=_evaluate,
        payload=(stages.family, stages.points(z), figures, model),
        count=len(z),
        batch=1 if model != "lumped" else len(z),
    )
    return workers.run(job)["values"]


def _evaluate(
    payload: tuple[Family, Array, tuple[Figure, ...], str], start: int, stop: int
) -> dict[str, Array]:
    """Evaluate a batch of points."""
    family, points, figures, model = payload
    moved = model != "lumped"
    return {"values": evaluate(family, points[start:stop], figures, model, moved=moved).values}


def _step(stages: _Stages, z: Array, j: int, largest: float) -> float:
    """Return the largest step of a coordinate to a stage that exists; 0 if there is none."""
    for k in range(_EFFORT.halvings):
        for sign in (1.0, -1.0):
            step = sign * largest * 0.5**k
            if stages.exists(z + step * np.eye(z.size)[j]):
                return step
    return 0.0


def _exact(z: Array, coarse: Array, slopes: Array, fine: Array, fine_slopes: Array) -> Correction:
    """Return the correction that is exact at a point, with its derivatives."""
    correction = Correction.none(z.size, coarse.size).updated(z, coarse, fine)
    factor = correction.factor[:, None]
    ratio = fine_slopes / fine[:, None] - slopes / np.where(factor, coarse[:, None], 1.0)
    return replace(correction, slope=np.where(factor, ratio, fine_slopes - slopes))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Draws:
    """Stages that are fitted to disturbed figures, about disturbed means of the prior."""

    z: Array
    """Coordinates, shape (S, p)."""
    means: Array
    """Means of the prior, shape (S, p)."""
    noises: Array
    """Errors of the given figures, whitened, shape (S, n)."""

    def at(self, rows: NDArray[np.intp]) -> "_Draws":
        """Return some of the draws."""
        return _Draws(z=self.z[rows], means=self.means[rows], noises=self.noises[rows])


class _Sampler:
    """Draws of the ensemble: disturbed given figures and prior means, fitted again."""

    def __init__(
        self,
        fit: _Fit,
        jacobian: Array,
        posterior: Posterior,
        centre: Array,
        generator: np.random.Generator,
    ) -> None:
        self.fit, self.jacobian, self.centre = fit, jacobian, centre
        self.covariance, self.generator = posterior.covariance, generator
        inner = jacobian @ jacobian.T + np.eye(len(jacobian))
        self.gain: Array = np.linalg.solve(inner, jacobian).T.astype(np.float64)
        self.refused = {"impossible": 0, "off": 0}

    def draw(self, count: int) -> _Draws:
        """Return so many possible stages, or fewer if they are rare."""
        z, means, noises = [], [], []
        for _ in range(_EFFORT.draws * count):
            if len(z) == count:
                break
            mean = self.generator.standard_normal(self.fit.size)
            noise = self.generator.standard_normal(len(self.jacobian))
            # exactly that of the disturbed fit where the model is linear
            sample = self.centre + self.covariance @ (self.jacobian.T @ noise + mean)
            if self.fit.stages.exists(sample):
                z, means, noises = [*z, sample], [*means, mean], [*noises, noise]
            else:
                self.refused["impossible"] += 1
        draws = _Draws(
            z=np.array(z).reshape(-1, self.fit.size),
            means=np.array(means).reshape(-1, self.fit.size),
            noises=np.array(noises).reshape(-1, len(self.jacobian)),
        )
        self._refine(draws)
        feasible = np.array([self.fit.stages.feasible(z) for z in draws.z], dtype=bool)
        self.refused["impossible"] += int((~feasible).sum())
        return draws.at(np.flatnonzero(feasible))

    def _refine(self, draws: _Draws) -> None:
        """Fit the corrected lumped model to the disturbed figures of each draw."""
        moving = np.ones(len(draws.z), dtype=bool)
        for _ in range(_EFFORT.refinements):
            rows = np.flatnonzero(moving)
            if not rows.size:
                break
            steps = self.steps(draws.at(rows), self.fit.predicted(draws.z[rows]))
            for i, step in zip(rows.tolist(), steps, strict=True):
                moving[i] = bool(np.linalg.norm(step) > _EFFORT.settled)
                if self.fit.stages.exists(draws.z[i] + step):
                    draws.z[i] += step
                else:  # a limit of the geometry
                    moving[i] = False

    def steps(self, draws: _Draws, predicted: Array) -> Array:
        """Return the steps of draws to their best fit, for whitened figures (S, n) of them."""
        misfit = self.fit.target + draws.noises - predicted
        within = (draws.z - draws.means) @ self.jacobian.T
        return draws.means + (misfit + within) @ self.gain.T - draws.z

    def corrected(
        self, draws: _Draws, values: Array, ensemble: Ensemble, at: Sequence[int]
    ) -> tuple[Array, Array]:
        """Return coordinates and figures of the draws that agree with the given figures.

        What finite elements (S, f) differ by from the corrected lumped model is made up by a small
        step of the dimensions, and the figures follow to first order.
        """
        steps = self.steps(draws, self.fit.whitened(values[:, at]))
        z, moved = draws.z + steps, scaled(values, ensemble.logarithmic) + steps @ ensemble.rows.T
        # a length is NaN without a model
        small = np.linalg.norm(steps, axis=1) < _EFFORT.near
        good = small & np.array([self.fit.stages.exists(y) for y in z], dtype=bool)
        self.refused["off"] += int((~good).sum())
        return z[good], unscaled(moved[good], ensemble.logarithmic)


def _members(
    sampler: _Sampler,
    ensemble: Ensemble,
    stages: _Stages,
    of_meshes: Array,
    at: Sequence[int],
    seconds: float,
    workers: Workers,
) -> tuple[Array, Array, Stop]:
    """Return coordinates and figures of members, by the finer model, and what ended them early.

    Superelements are on moved meshes; what these differ by for the most probable stage,
    `of_meshes`, is added to figures or their logarithms.
    """
    began, computations, count = time.monotonic(), 0, ensemble.requested
    members = np.zeros((0, sampler.fit.size))
    values = np.zeros((0, len(ensemble.figures)))
    stopped: Stop = ""
    while len(members) < count:
        if time.monotonic() - began >= seconds:
            stopped = "time"
            break
        if computations >= _EFFORT.rounds * count:
            stopped = "draws"
            break
        try:
            with progress.subtask(len(members) / count, 1.0):
                draws = sampler.draw(min(count - len(members), _EFFORT.at_once))
                if not len(draws.z):
                    stopped = "draws"
                    break
                computations += len(draws.z)
                z, figures = (
                    draws.z,
                    _on_moved_meshes(
                        stages, draws.z, ensemble.figures, ensemble.model, workers, "members"
                    ),
                )
            if ensemble.model != "lumped":
                scale = ensemble.logarithmic
                figures = unscaled(scaled(figures, scale) + of_meshes, scale)
                z, figures = sampler.corrected(draws, figures, ensemble, at)
        except KeyboardInterrupt:
            stopped = "interrupted"
            break
        members, values = np.vstack([members, z]), np.vstack([values, figures])
    return members, values, stopped
