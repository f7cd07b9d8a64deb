r"""Fits a stage to what was measured on it: the most probable parameters, and their spread.

With measured y of covariance V, the model's f(theta), and parameters that are known before as
theta_0 with standard deviations sigma, the most probable theta minimises

.. math::

    \Phi = \tfrac12 (y-f)^T V^{-1} (y-f) + \tfrac12\sum_i(\theta_i-\theta_{0i})^2/\sigma_i^2

(A. Tarantola, Inverse Problem Theory, SIAM 2005, section 3.2), found by Gauss and Newton's steps.
The posterior covariance is the inverse of the curvature there (Laplace's approximation).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component, Estimate
from flexstage.measure.updating.problem import (
    Model,
    UpdateParameter,
    UpdatingProblem,
    half_square,
    most_probable,
)
from flexstage.stage import Stage
from flexstage.system import DriveCondition


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdatedRow:
    """One measured quantity beside the model before and after."""

    quantity: str
    """The quantity that was measured."""
    axis: str
    """The axis that it was measured of."""
    measured: Estimate
    """The measured value."""
    before: float
    """What the model says with the expected parameters, in the unit of `measured`."""
    after: float
    """What the model says with the fitted parameters, in the unit of `measured`."""
    before_uncertainty: float
    """Standard uncertainty of `before` from the parameters."""
    after_uncertainty: float
    """Standard uncertainty of `after` from the parameters."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Updated:
    """A stage fitted to measurements."""

    stage: Stage
    """The stage with the fitted necks and material."""
    parameters: tuple[UpdateParameter, ...]
    """What was fitted."""
    values: dict[str, Estimate]
    """The parameters by name; their contributions are what comes from the measurement and what
    comes from the knowledge before.
    """
    covariance: Array
    """Posterior covariance of the parameters, in their units, shape (p, p)."""
    learned: dict[str, float]
    """Part of the variance of each parameter that the measurements took away [1]."""
    unidentified: tuple[str, ...]
    """What the measurements do not tell, a sentence each."""
    rows: tuple[UpdatedRow, ...]
    """Each measured quantity beside the model before and after."""
    misfit: float
    """Twice the least Phi; of the chi-squared distribution with as many degrees of freedom as there
    are measured values, where model and expectation hold.
    """
    curvature_error: float
    """Largest relative error of the quadratic posterior one standard deviation away from its peak
    [1]: above some 0.3 the spread is a rough one.
    """
    iterations: int
    """Steps that were made."""

    @property
    def correlation(self) -> Array:
        """Posterior correlations of the parameters [1], shape (p, p)."""
        spread = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(spread, spread)

    @property
    def probability(self) -> float:
        """Probability of a misfit as large as this one, if model and expectation hold [1]."""
        from scipy.special import chdtrc

        return float(chdtrc(len(self.rows), self.misfit))

    def samples(self, count: int, *, seed: int = 0) -> Array:
        """Draw parameters from the posterior distribution, by its quadratic approximation.

        Values in the order of `parameters`, shape (count, p).
        """
        mean = [self.values[p.name].value for p in self.parameters]
        generator = np.random.default_rng(seed)
        return generator.multivariate_normal(mean, self.covariance, count, method="cholesky")


def update_stage(
    stage: Stage,
    measured: Mapping[tuple[str, str], Estimate],
    *,
    parameters: Sequence[UpdateParameter],
    model: Literal["lumped"] | Model = "lumped",
    drives: DriveCondition = "removed",
    model_uncertainty: float = 0.0,
) -> Updated:
    """Fit necks, modulus, density or damping of a stage to measured figures.

    Parameters
    ----------
    stage : Stage
        The stage as it was described.
    measured : Mapping
        Measured values by quantity (``natural_frequency_hz``, ``damping_ratio``,
        ``transmission_ratio``, ``output_displacement``, ``input_stiffness``) and name of the axis.
    parameters : sequence of UpdateParameter
        What is to be found, with what is known of it before.
    model : "lumped" or callable
        The model: the lumped one, or a function from a stage to its system.
    drives : str
        Condition of the drives that frequencies and damping were measured in: ``removed``,
        ``in place`` or ``locked``.
    model_uncertainty : float
        Relative standard uncertainty of the model itself [1], alike for all values of a quantity;
        damping is left out of it.

    Returns
    -------
    Updated
        The fitted stage, its parameters with their spread, and the model before and after.

    Raises
    ------
    ModelError
        Nothing is measured, or nothing to be found; a name is given twice; a pattern fits no hinge;
        a measured value has no uncertainty.
    ConvergenceError
        40 steps do not reach the most probable parameters.

    Notes
    -----
    Validity: normal errors and normal knowledge before, a model near enough to linear over the
    posterior spread (`Updated.curvature_error` measures it). A measured value of few degrees of
    freedom counts with the normal distribution of its 95 % interval. What is wrong with the model
    and not among the parameters goes into them: say so by `model_uncertainty`.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> noise = Component(name="noise", uncertainty=0.05)
    >>> frequency = Estimate(value=190.2, unit="Hz", components=(noise,))
    >>> seen = {("natural_frequency_hz", "x"): frequency}
    >>> necks = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> found = update_stage(design("parallelogram"), seen, parameters=[necks])
    >>> print(f"{found.values['necks'].value:.4f} +- {found.values['necks'].uncertainty:.4f}")
    0.9850 +- 0.0002
    """
    _require(stage, measured, parameters)
    problem = UpdatingProblem(stage, measured, tuple(parameters), model, drives, model_uncertainty)
    x, r, jacobian, first, steps = most_probable(problem)
    p = len(parameters)
    information = jacobian.T @ jacobian
    covariance: Array = np.linalg.inv(information + np.eye(p)).astype(np.float64)
    sigma = problem.sigma
    values = {
        parameter.name: _estimate(parameter, float(value), covariance, i)
        for i, (parameter, value) in enumerate(zip(parameters, problem.values(x), strict=True))
    }
    return Updated(
        stage=problem.stage_at(x),
        parameters=tuple(parameters),
        values=values,
        covariance=covariance * np.outer(sigma, sigma),
        learned={q.name: float(1.0 - covariance[i, i]) for i, q in enumerate(parameters)},
        unidentified=_unidentified(parameters, information),
        rows=_rows(problem, r, first, jacobian, covariance),
        misfit=2.0 * half_square(r, x),
        curvature_error=_curvature_error(problem, x, half_square(r, x), covariance),
        iterations=steps,
    )


def _require(
    stage: Stage,
    measured: Mapping[tuple[str, str], Estimate],
    parameters: Sequence[UpdateParameter],
) -> None:
    if not measured or not parameters:
        raise ModelError("updating needs at least one measured value and one parameter")
    names = [p.name for p in parameters]
    if len(set(names)) < len(names):
        raise ModelError(f"two parameters share a name: {', '.join(names)}")
    for (quantity, axis), estimate in measured.items():
        if not (math.isfinite(estimate.value) and estimate.expanded > 0.0):
            raise ModelError(
                f"the measured {quantity} of axis '{axis}' must be finite and have an uncertainty "
                "above 0: without one it would outweigh everything"
            )
    for p in parameters:
        necks = p.kind in {"neck_factor", "neck_offset"}
        if necks and not any(p.holds(h.name) for h in stage.hinges):
            raise ModelError(
                f"parameter '{p.name}' is for hinges like {', '.join(p.hinges)}, and the stage has "
                f"none (it has {', '.join(h.name for h in stage.hinges[:12])})"
            )
    if sum(p.kind == "damping_ratio" for p in parameters) > 1:
        raise ModelError("one damping ratio holds for all modes: give one parameter of that kind")


def _estimate(parameter: UpdateParameter, value: float, covariance: Array, i: int) -> Estimate:
    # C = C (J'J) C + C C: the first part is the noise of the measurement, the second what was
    # known before
    before = float(covariance[i] @ covariance[i])
    seen = max(float(covariance[i, i]) - before, 0.0)
    return Estimate(
        value=value,
        unit=parameter.unit,
        components=(
            Component(name="measured", uncertainty=parameter.spread * math.sqrt(seen), kind="B"),
            Component(name="before", uncertainty=parameter.spread * math.sqrt(before), kind="B"),
        ),
        note="most probable value, posterior spread",
    )


def _unidentified(parameters: Sequence[UpdateParameter], information: Array) -> tuple[str, ...]:
    """Name the combinations of parameters on which the measurements say less than is known."""
    found = []
    strengths, directions = np.linalg.eigh(information)
    for strength, direction in zip(strengths, directions.T, strict=True):
        if strength >= 1.0:
            continue
        main = np.flatnonzero(np.abs(direction) > 0.25 * np.abs(direction).max()).tolist()
        sign = math.copysign(1.0, direction[main[0]])
        parts = [f"{sign * direction[i]:+.2f} {parameters[i].name}" for i in main]
        remains = 1.0 / math.sqrt(1.0 + max(float(strength), 0.0))
        what = f"{' '.join(parts)} (in units of their spreads)"
        if len(main) == 1:
            what = parameters[main[0]].name
        found.append(
            f"the measured values hardly determine {what}: {100.0 * remains:.0f} % of its spread "
            "remains"
        )
    return tuple(found)


def _rows(
    problem: UpdatingProblem, r: Array, first: Array, last: Array, covariance: Array
) -> tuple[UpdatedRow, ...]:
    colour = np.linalg.inv(problem.whiten)
    before, after = problem.predicted(np.zeros(first.shape[1])), problem.y - colour @ r
    start, end = colour @ first, colour @ last
    spread_before = np.sqrt(np.einsum("ij,ij->i", start, start))
    spread_after = np.sqrt(np.einsum("ij,jk,ik->i", end, covariance, end))
    return tuple(
        UpdatedRow(
            quantity=quantity,
            axis=axis,
            measured=problem.measured[quantity, axis],
            before=float(before[i]),
            after=float(after[i]),
            before_uncertainty=float(spread_before[i]),
            after_uncertainty=float(spread_after[i]),
        )
        for i, (quantity, axis) in enumerate(problem.keys)
    )


def _curvature_error(problem: UpdatingProblem, x: Array, least: float, covariance: Array) -> float:
    """How far Phi is from a parabola, one standard deviation from its least value."""
    rise = []
    for column in np.linalg.cholesky(covariance).T:
        for there in (x - column, x + column):
            rise.append(half_square(problem.residual_or_refused(there), there) - least)
    return float(np.abs(2.0 * np.array(rise) - 1.0).max())
