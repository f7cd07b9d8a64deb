r"""Reconstruction of a stage from figures: what they tell of its dimensions and other figures.

Dimensions d are log-normal before, :math:`d_i = m_i \exp(\sigma_i z_i)` with z normal, of mean 0
and covariance 1. The lumped model, times its ratio to a superelement model that is log-linear in
z, is fitted to the given figures. With the derivatives J of their superelement values there,
whitened by their noise, the covariance of z is :math:`(J^T J + 1)^{-1}`
(`flexstage.measure.posterior`).

Members of the ensemble are drawn by randomise-then-optimise: prior mean and given figures are
disturbed by their own distributions, and the most probable dimensions are found again (J. Bardsley
et al., SIAM J. Sci. Comput. 36 (2014) A1895). Draws that are no stage are refused, so that limits
of the geometry belong to what is known before.
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
from flexstage.measure.posterior import Posterior, most_probable
from flexstage.stage import check
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.batches import Job
from flexstage.studies.explore.ensemble import (
    Dimension,
    Ensemble,
    Given,
    rows_of,
    scaled,
)
from flexstage.studies.explore.family import Family, evaluate, jacobian
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.optimise.problem import Correction
from flexstage.studies.explore.sweep import evaluate_batch
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
    near: float = 0.3
    """Distance, in standard deviations before, at which derivatives need not be found again."""
    refinements: int = 6
    """Largest number of steps of a member."""
    settled: float = 0.02
    """Step at which a member is settled, in standard deviations before."""
    draws: int = 200
    """Largest number of draws for each member."""
    at_once: int = 12
    """Members between two looks at the clock."""
    off: float = 4.0
    """Distance of a member from a given figure beyond which it is refused, in its noise."""
    rounds: int = 4
    """Largest number of computed stages for each member."""


_EFFORT = _Effort()


def dimension_of(variable: Variable) -> Dimension:
    """Return the prior of a dimension: a standard deviation to either side within its range.

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
    inside = variable.low < variable.usual < variable.high
    middle = variable.usual if inside else math.copysign(math.sqrt(low * high), variable.low)
    return Dimension(variable=variable, median=middle, sigma=0.5 * math.log(high / low))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stages:
    """Stages over the coordinates z of their dimensions."""

    family: Family
    dimensions: tuple[Dimension, ...]

    @classmethod
    def of(cls, template: StageTemplate, dimensions: tuple[Dimension, ...]) -> "_Stages":
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
        # exactly as numbers, which texts of a file may round
        template = self.family.template.with_values(values)
        return replace(self, family=replace(self.family, template=template))

    def figures(self, z: Array, figures: Sequence[Figure], model: str) -> Array:
        """Return figures at coordinates (S, p), shape (S, f); NaN where there is no such stage."""
        return evaluate(self.family, self.points(z), figures, model).values


class _Fit:
    """Whitened residuals of the corrected lumped model, over coordinates less those of the prior.

    It implements `flexstage.measure.posterior.Residuals`.
    """

    bent = False

    def __init__(
        self, stages: _Stages, given: Sequence[Given], correction: Correction | None = None
    ) -> None:
        self.stages, self.given = stages, tuple(given)
        self.size = len(stages.dimensions)
        self.figures = tuple(g.figure for g in given)
        self.logarithmic = np.array([g.logarithmic for g in given])
        self.spread = np.array([g.spread for g in given])
        self.target = self.scaled(np.array([g.value for g in given])) / self.spread
        self.correction = correction or Correction.none(self.size, len(self.given))

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
        residual = self.residual(x)
        return residual if np.isfinite(residual).all() else np.full(residual.size, math.inf)

    def jacobian(self, x: Array) -> Array:
        values, slopes = jacobian(self.stages.family, self.stages.points(x), self.figures)
        slopes = np.nan_to_num(slopes) * self.stages.rates(x)
        values, slopes = self.correction.of_slopes(x, np.nan_to_num(values), slopes)
        return rows_of(slopes, values, self.logarithmic) / self.spread[:, None]

    def search(self, start: Array) -> tuple[Array, Array]:
        """Return the most probable coordinates, and those of the same by the linear model there.

        They differ only where limits of the geometry exclude the latter.
        """
        try:
            best, *_ = most_probable(self, start)
        except ConvergenceError:
            return self._up_to_limits(start)
        return best, best

    def _up_to_limits(self, start: Array) -> tuple[Array, Array]:
        """Search as `search` does, among stages that exist; coordinates at a limit stay there."""
        x, free = start, np.ones(self.size, dtype=bool)
        for _ in range(_EFFORT.refinements):
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
            x = x + fraction * step
        return x, x + _newton_step(self.jacobian(x), self.residual(x), x)

    def _fraction(self, x: Array, step: Array) -> float:
        fractions = (0.5**k for k in range(_EFFORT.halvings))
        return next((f for f in fractions if self.stages.exists(x + f * step)), 0.0)

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


def _gain(jacobian: Array) -> Array:
    """Return the change of the most probable coordinates by whitened given figures, (p, n)."""
    inner = jacobian @ jacobian.T + np.eye(len(jacobian))
    return np.linalg.solve(inner, jacobian).T.astype(np.float64)


def reconstruct(
    template: StageTemplate,
    given: Sequence[Given],
    unknown: Sequence[Dimension],
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
    given : sequence of Given
        Published or measured figures with their uncertainty.
    unknown : sequence of Dimension
        Dimensions with what is known of them before.
    model : str
        ``superelement``, or ``lumped`` for the lumped model alone.
    members : int
        Number of stages of the ensemble; 0 for Laplace's approximation alone.
    seed : int
        Random seed of the ensemble.
    seconds : float
        Time after which no more members are computed [s].
    workers : Workers, optional
        Worker processes; this process alone if not given.

    Raises
    ------
    ModelError
        Nothing is given or unknown, the model does not compute a given figure, or the described
        stage is impossible.

    Notes
    -----
    Validity: the form of the stage is known, log-normal dimensions and normal errors. Laplace's
    approximation is linear about the most probable stage, and knows no limits of the geometry; the
    ensemble does. What is not informed keeps what was put in before.
    """
    if not given or not unknown:
        raise ModelError("a reconstruction needs at least one given figure and one free dimension")
    workers = workers or Workers(1)
    began = time.monotonic()
    stages = _Stages.of(template, tuple(unknown))
    described = analyse_model(template.stage(), model)
    figures = tuple(Figure(quantity=r.quantity, axis=r.axis) for r in described.characteristics)
    usual = np.array([r.value for r in described.characteristics])
    at = [_row_of(g.figure, figures, model) for g in given]
    with progress.subtask(0.0, 0.1):
        fit, best = _nearest(stages, given, figures, at, model)
    with progress.subtask(0.1, 0.4):
        base, slopes = _slopes(stages, best, figures, model, workers)
    logarithmic = np.array([f.display.zero == 0.0 for f in figures]) & (base > 0.0)
    if model != "lumped":
        coarse, coarse_slopes = _coarse(fit, best)
        fit.correction = _exact(best, coarse, coarse_slopes, base[at], slopes[at])
    feasible, centre = fit.search(best)
    rows = rows_of(slopes, base, logarithmic)
    whitened = rows_of(slopes[at], base[at], fit.logarithmic) / fit.spread[:, None]
    posterior = Posterior.of(whitened)
    values = stages.near(best).figures(feasible[None], figures, model)[0]
    middle = scaled(values, logarithmic) + rows @ (centre - feasible)
    ensemble = Ensemble(
        template=template,
        model=model,
        given=tuple(given),
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
        found, values = _members(
            sampler, stages.near(best), figures, at, model, members, seconds, workers
        )
    return replace(
        ensemble,
        points=stages.points(found),
        values=values,
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
    stages: _Stages,
    given: Sequence[Given],
    figures: Sequence[Figure],
    at: Sequence[int],
    model: str,
) -> tuple[_Fit, Array]:
    """Search the most probable stage by the lumped model, corrected by superelements on the way."""
    fit = _Fit(stages, given)
    z = np.zeros(fit.size)
    if model == "lumped":
        return fit, fit.search(z)[0]
    for k in range(_EFFORT.approaches):
        progress.update("most probable stage", k / _EFFORT.approaches)
        fine = stages.figures(z[None], fit.figures, model)[0]
        fit.correction = fit.correction.updated(z, fit.coarse(z[None])[0], fine)
        before, z = z, fit.search(z)[0]
        if np.linalg.norm(z - before) < _EFFORT.near:
            break
    return fit, z


def _slopes(
    stages: _Stages, z: Array, figures: tuple[Figure, ...], model: str, workers: Workers
) -> tuple[Array, Array]:
    """Return figures (f,) and their derivatives by the coordinates (f, p).

    Those of superelements are one-sided difference quotients, towards the side that has a stage.
    """
    if model == "lumped":
        values, slopes = jacobian(stages.family, stages.points(z), figures, model)
        return values, slopes * stages.rates(z)
    steps = np.array([_step(stages, z, j) for j in range(z.size)])
    moved = np.vstack([z, z + np.diag(steps)])
    values = _evaluated(stages.near(z), moved, figures, model, workers, "derivatives")
    base, others = values[0], values[1:]
    if not np.isfinite(base).all():
        raise ModelError("the most probable stage has no superelement model: change the prior")
    slopes = np.divide(
        others - base,
        steps[:, None],
        out=np.zeros_like(others),
        where=steps[:, None] != 0.0,
    )
    return base, np.nan_to_num(slopes).T


def _step(stages: _Stages, z: Array, j: int) -> float:
    """Return the largest step of a coordinate to a stage that exists; 0 if there is none."""
    for k in range(_EFFORT.halvings):
        for sign in (1.0, -1.0):
            step = sign * _EFFORT.step * 0.5**k
            if stages.exists(z + step * np.eye(z.size)[j]):
                return step
    return 0.0


def _evaluated(
    stages: _Stages,
    z: Array,
    figures: tuple[Figure, ...],
    model: str,
    workers: Workers,
    name: str,
) -> Array:
    """Return figures at coordinates (S, p) by worker processes, shape (S, f)."""
    job = Job(
        name=name,
        work=evaluate_batch,
        payload=(stages.family, stages.points(z), figures, model),
        count=len(z),
        batch=1 if model != "lumped" else len(z),
    )
    return workers.run(job)["values"]


def _coarse(fit: _Fit, z: Array) -> tuple[Array, Array]:
    """Return the lumped figures (n,) and their derivatives (n, p); 0 if the model lacks one."""
    values, slopes = jacobian(fit.stages.family, fit.stages.points(z), fit.figures)
    return np.nan_to_num(values), np.nan_to_num(slopes) * fit.stages.rates(z)


def _exact(z: Array, coarse: Array, slopes: Array, fine: Array, fine_slopes: Array) -> Correction:
    """Return the correction that is exact at a point, with its derivatives."""
    correction = Correction.none(z.size, coarse.size).updated(z, coarse, fine)
    factor = correction.factor[:, None]
    ratio = fine_slopes / fine[:, None] - slopes / np.where(factor, coarse[:, None], 1.0)
    return replace(correction, slope=np.where(factor, ratio, fine_slopes - slopes))


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
        self.gain = _gain(jacobian)
        self.refused = {"impossible": 0, "off": 0}

    def draw(self, count: int) -> Array:
        """Return coordinates of so many possible stages, or fewer if they are rare, (S, p)."""
        starts: list[Array] = []
        means: list[Array] = []
        noises: list[Array] = []
        for _ in range(_EFFORT.draws * count):
            if len(starts) == count:
                break
            mean = self.generator.standard_normal(self.fit.size)
            noise = self.generator.standard_normal(len(self.jacobian))
            # exactly that of the disturbed fit where the model is linear
            z = self.centre + self.covariance @ (self.jacobian.T @ noise + mean)
            if self.fit.stages.exists(z):
                starts, means, noises = [*starts, z], [*means, mean], [*noises, noise]
            else:
                self.refused["impossible"] += 1
        if not starts:
            return np.zeros((0, self.fit.size))
        refined = self._refined(np.array(starts), np.array(means), np.array(noises))
        feasible = np.array([self.fit.stages.feasible(z) for z in refined])
        self.refused["impossible"] += int((~feasible).sum())
        return refined[feasible]

    def _refined(self, z: Array, means: Array, noises: Array) -> Array:
        """Fit the corrected lumped model to the disturbed figures of each draw."""
        moving = np.ones(len(z), dtype=bool)
        for _ in range(_EFFORT.refinements):
            rows = np.flatnonzero(moving)
            if not rows.size:
                break
            misfit = self.fit.target + noises[rows] - self.fit.predicted(z[rows])
            within = (z[rows] - means[rows]) @ self.jacobian.T
            aims = means[rows] + (misfit + within) @ self.gain.T
            for i, aim in zip(rows.tolist(), aims, strict=True):
                step = aim - z[i]
                moving[i] = bool(np.linalg.norm(step) > _EFFORT.settled)
                if not self.fit.stages.exists(aim):
                    moving[i] = False  # a limit of the geometry: the linear draw remains
                    continue
                z[i] = aim
        return z


def _members(
    sampler: _Sampler,
    stages: _Stages,
    figures: tuple[Figure, ...],
    at: Sequence[int],
    model: str,
    count: int,
    seconds: float,
    workers: Workers,
) -> tuple[Array, Array]:
    """Return coordinates and figures of members, by the finer model, until the time is up."""
    began, fit, computations = time.monotonic(), sampler.fit, 0
    found: list[Array] = []
    values: list[Array] = []
    while (
        len(found) < count
        and computations < _EFFORT.rounds * count
        and time.monotonic() - began < seconds
    ):
        progress.update("members", len(found) / count)
        wanted = min(count - len(found), _EFFORT.at_once if model != "lumped" else count)
        drawn = sampler.draw(wanted)
        if not len(drawn):
            break
        computations += len(drawn)
        computed = _evaluated(stages, drawn, figures, model, workers, "members")
        distance = np.abs(fit.target - fit.whitened(computed[:, at])).max(axis=1)
        good = distance <= _EFFORT.off  # without figures it is NaN
        sampler.refused["off"] += int((~good).sum())
        found += list(drawn[good])
        values += list(computed[good])
    shape = (-1, len(figures))
    return np.array(found).reshape(-1, fit.size), np.array(values).reshape(shape)
