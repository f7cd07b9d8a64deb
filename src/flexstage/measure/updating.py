r"""Fits a stage to what was measured on it: the most probable parameters, and their spread.

With measured y of covariance V, the model's f(theta), and parameters that are known before as
theta_0 with standard deviations sigma, the most probable theta minimises

.. math::

    \Phi = \tfrac12 (y-f)^T V^{-1} (y-f) + \tfrac12\sum_i(\theta_i-\theta_{0i})^2/\sigma_i^2

(`flexstage.measure.posterior`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.choose import has_no
from flexstage.base.errors import ConvergenceError, FlexstageError, ModelError
from flexstage.measure.posterior import FAR, Posterior, half_square, most_probable
from flexstage.measure.update_parameters import UpdateParameter, stage_with
from flexstage.quantities.estimate import Component, Estimate
from flexstage.stage import Force, Stage
from flexstage.system import (
    AxisAnalysis,
    DriveCondition,
    MechanicalSystem,
    ModalDamping,
    analyse_axis,
    modes,
)
from flexstage.system.characteristics import axis_mode
from flexstage.system.mechanical import AxisPort

_MODAL = ("natural_frequency_hz", "damping_ratio")
_STATIC = ("transmission_ratio", "output_displacement", "input_stiffness")
#: Quantities that a stage can be fitted to.
UPDATABLE: tuple[str, ...] = (*_MODAL, *_STATIC)
Model = Callable[[Stage], MechanicalSystem]
_STEP = 1e-3
# fall of the doubled log-likelihood at the ends of a 95 % interval: chi-squared, one parameter
_LIKELY = 3.841458820694124
# doubled Phi of what no stage gives
_IMPOSSIBLE = 1e12


def predict(
    system: MechanicalSystem,
    quantities: Sequence[tuple[str, str]],
    *,
    drives: DriveCondition = "removed",
) -> Array:
    """Return what a model says of quantities of its axes.

    Parameters
    ----------
    system : MechanicalSystem
        The model.
    quantities : sequence of tuple of str
        Quantity, one of `UPDATABLE`, and name of an axis.
    drives : str
        Condition of the drives that frequencies and damping belong to; ratios and strokes are those
        of one drive over its stroke, the others removed.

    Returns
    -------
    numpy.ndarray
        The values [Hz, 1, m, N/m], shape (n,).

    Raises
    ------
    ModelError
        A quantity cannot be had, or the stage has no such axis.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> system = lumped_system(design("parallelogram"))
    >>> round(float(predict(system, [("natural_frequency_hz", "x")])[0]), 1)
    193.7
    """
    axes = {axis.name: axis for axis in system.axes}
    for quantity, name in quantities:
        if quantity not in UPDATABLE:
            raise ModelError(
                f"a stage cannot be fitted to '{quantity}': expected one of {', '.join(UPDATABLE)}"
            )
        if name not in axes:
            raise ModelError(has_no("the stage", "axis", name, axes))
    bare = modes(system, count=None)
    modal = bare if drives == "removed" else modes(system, drives=drives, count=None)
    pushed: dict[str, AxisAnalysis] = {
        name: analyse_axis(system, axes[name])
        for name in sorted({name for quantity, name in quantities if quantity in _STATIC})
    }

    def value(quantity: str, axis: AxisPort) -> float:
        if quantity in _STATIC:
            one = pushed[axis.name]
            if quantity == "transmission_ratio":
                return one.output_displacement / one.input_displacement
            return getattr(one, quantity)
        mode = axis_mode(system, modal, axis.drive, axis.probe)
        return float((modal.frequency_hz if quantity == _MODAL[0] else modal.damping_ratio)[mode])

    return np.array([value(quantity, axes[name]) for quantity, name in quantities])


class UpdatingProblem:
    """Residuals in units of their uncertainty, over parameters in units of their spread.

    Everywhere x is parameters less what is expected, over their spreads [1], shape (p,), or the
    coordinate of a seat; m values are measured, by quantity and name of the axis.
    `model_uncertainty` is relative [1].
    """

    def __init__(
        self,
        stage: Stage,
        measured: Mapping[tuple[str, str], Estimate],
        parameters: tuple[UpdateParameter, ...],
        model: Literal["lumped"] | Model,
        drives: DriveCondition,
        model_uncertainty: float,
    ) -> None:
        if not 0.0 <= model_uncertainty < 1.0:
            raise ModelError(
                f"the relative uncertainty of the model lies from 0 to below 1, got "
                f"{model_uncertainty!r}"
            )
        from flexstage.lumped import lumped_system

        self.stage, self.parameters = stage, parameters
        self.size = len(parameters)
        # frequencies bend strongly over the coordinate of a seat
        self.bent = any(p.limits is not None for p in parameters)
        self.drives: DriveCondition = drives
        self.measured = dict(measured)
        self.model: Model = lumped_system if model == "lumped" else model
        self.model_uncertainty = model_uncertainty
        self.keys = list(measured)
        self.y = np.array([e.value for e in measured.values()])
        # from standard to expanded uncertainty of a normal distribution at 95 %
        normal = 1.959963984540054
        # the normal distribution of the same 95 % interval, so that few observations count as such
        spread = np.array([e.expanded / normal for e in measured.values()])
        covariance = np.diag(spread**2)
        for quantity in {q for q, _ in self.keys} - {"damping_ratio"}:
            same = np.array([q == quantity for q, _ in self.keys]) * self.y
            covariance += model_uncertainty**2 * np.outer(same, same)
        self.whiten = np.linalg.inv(np.linalg.cholesky(covariance))

    def values(self, x: Array) -> Array:
        """Return the values of the parameters, in their units."""
        return np.array([p.value_at(v) for p, v in zip(self.parameters, x.tolist(), strict=True)])

    def slopes(self, x: Array) -> Array:
        """Return the derivatives of these values."""
        return np.array([p.slope_at(v) for p, v in zip(self.parameters, x.tolist(), strict=True)])

    def stage_at(self, x: Array) -> Stage:
        """Return the stage that has parameters."""
        values_by_name = dict(
            zip((p.name for p in self.parameters), self.values(x).tolist(), strict=True)
        )
        return stage_with(self.stage, self.parameters, values_by_name)

    def predicted(self, x: Array) -> Array:
        """Return what the model says of the measured quantities, in their units, shape (m,)."""
        system = self.model(self.stage_at(x))
        for p, value in zip(self.parameters, self.values(x).tolist(), strict=True):
            if p.kind == "damping_ratio":
                system = replace(system, damping=ModalDamping(ratio=value))
        return predict(system, self.keys, drives=self.drives)

    def residual(self, x: Array) -> Array:
        """Return measured less predicted values, whitened by their covariance."""
        return self.whiten @ (self.y - self.predicted(x))

    def residual_or_refused(self, x: Array) -> Array:
        """Return the residuals, infinite where there is no such stage."""
        try:
            return self.residual(x)
        except (FlexstageError, np.linalg.LinAlgError):
            return np.full(self.y.size, math.inf)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the whitened prediction, by central differences.

        Shape (m, p). Refused if there is no such stage near these parameters.
        """
        columns = []
        for step in _STEP * np.eye(x.size):
            low, high = self.residual_or_refused(x - step), self.residual_or_refused(x + step)
            if not np.isfinite(low + high).all():
                raise ConvergenceError(FAR)
            columns.append((low - high) / (2.0 * _STEP))
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdatedRow:
    """One measured quantity, with the model before and after."""

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
    after_uncertainty: float
    """Standard uncertainty of `after` from the parameters."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Updated:
    """A stage fitted to measurements."""

    stage: Stage
    """The stage with the fitted parameters."""
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
    """Each measured quantity, with the model before and after."""
    chi_squared: float
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
        """Probability of a chi-squared as large as this, if model and expectation are right [1]."""
        from scipy.special import chdtrc

        return float(chdtrc(len(self.rows), self.chi_squared))

    def samples(self, count: int, *, seed: int = 0) -> Array:
        """Draw parameters from the posterior distribution, by its quadratic approximation.

        Values in the order of `parameters`, shape (count, p).
        """
        mean = np.array([self.values[p.name].value for p in self.parameters])
        generator = np.random.default_rng(seed)
        sampled = generator.multivariate_normal(mean, self.covariance, count, method="cholesky")
        for i, p in enumerate(self.parameters):
            if p.limits is not None:
                # normal in the coordinate of a seat, which no draw leaves its limits by
                x = p.coordinate_of(float(mean[i]))
                there = x + (sampled[:, i] - mean[i]) / p.slope_at(x)
                sampled[:, i] = [p.value_at(v) for v in there.tolist()]
        return sampled


def update_stage(
    stage: Stage,
    measured: Mapping[tuple[str, str], Estimate],
    *,
    parameters: Sequence[UpdateParameter],
    model: Literal["lumped"] | Model = "lumped",
    drives: DriveCondition = "removed",
    model_uncertainty: float = 0.0,
) -> Updated:
    """Fit necks, material, damping, masses or seats of a stage to measured figures.

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
        Relative standard uncertainty of the model itself [1], equal for all values of a quantity;
        it does not apply to damping.

    Returns
    -------
    Updated
        The fitted stage, its parameters with their spread, and the model before and after.

    Raises
    ------
    ModelError
        Nothing is measured, or nothing to be found; a name is given twice; a pattern fits no hinge;
        a measured value has no uncertainty; there is no such body or drive, or a seat is to be
        found with its drive not in place.
    ConvergenceError
        40 steps, or 120 with a seat, do not reach the most probable parameters.

    Notes
    -----
    Validity: normal errors and normal knowledge before, a model near enough to linear over the
    posterior spread (`Updated.curvature_error` measures it). A measured value of few degrees of
    freedom counts with the normal distribution of its 95 % interval. What is wrong with the model
    and not among the parameters goes into them: say so by `model_uncertainty`.

    The interval of a seat is that of its profile likelihood, whose doubled logarithm falls by 3.84
    at its ends, with the other parameters fitted anew. Where it reaches a limit, the measured
    values give a bound and no value: `Updated.unidentified` states it. It is the stiffness against
    small vibrations, which says nothing of the stroke on a contact.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> noise = Component(name="noise", uncertainty=0.05)
    >>> frequency = Estimate(value=190.2, unit="Hz", components=(noise,))
    >>> seen = {("natural_frequency_hz", "x"): frequency}
    >>> necks = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> found = update_stage(design("parallelogram"), seen, parameters=[necks])
    >>> print(f"{found.values['necks'].value:.4f} +- {found.values['necks'].uncertainty:.4f}")
    0.9850 +- 0.0002
    """
    _require(stage, measured, parameters)
    _require_places(stage, parameters, drives)
    problem = UpdatingProblem(stage, measured, tuple(parameters), model, drives, model_uncertainty)
    x, r, jacobian, steps = most_probable(problem)
    information = jacobian.T @ jacobian
    posterior = Posterior.of(jacobian)
    covariance, learned = posterior.covariance, posterior.learned
    sigma = problem.slopes(x)
    values = {
        parameter.name: _estimate(parameter, float(x[i]), covariance, i, stage.materials_note)
        for i, parameter in enumerate(parameters)
    }
    bounds: list[str] = []
    for parameter in parameters:
        if parameter.limits is not None:
            interval = _profile_interval(problem, parameter, x)
            note = _bound(parameter, interval)
            bounds += [note] if note else []
            values[parameter.name] = replace(
                values[parameter.name],
                bounds=interval,
                note=note or values[parameter.name].note,
            )
    return Updated(
        stage=problem.stage_at(x),
        parameters=tuple(parameters),
        values=values,
        covariance=covariance * np.outer(sigma, sigma),
        learned={q.name: float(learned[i]) for i, q in enumerate(parameters)},
        unidentified=(*_unidentified(parameters, information), *bounds),
        rows=_rows(problem, r, jacobian, posterior),
        chi_squared=2.0 * half_square(r, x),
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
        raise ModelError("all modes have one damping ratio: give one parameter of that kind")


def _require_places(
    stage: Stage, parameters: Sequence[UpdateParameter], drives: DriveCondition
) -> None:
    for p in parameters:
        if p.kind == "added_mass":
            stage.body(p.body)
        if p.kind != "seat_stiffness":
            continue
        if isinstance(stage.drive(p.drive), Force):
            raise ModelError(f"drive '{p.drive}' is a pure force, which has no seats")
        if drives != "in place":
            raise ModelError(
                f"parameter '{p.name}': a seat changes nothing measured with drives {drives}: "
                "give drives='in place'"
            )


def _profile_interval(
    problem: UpdatingProblem, parameter: UpdateParameter, x: Array
) -> tuple[float, float]:
    """Return the 95 % interval of a seat by its profile likelihood, within its limits [N/m]."""
    from scipy.optimize import brentq

    assert parameter.limits is not None
    rest = tuple(p for p in problem.parameters if p is not parameter)
    which = problem.parameters.index(parameter)
    near = {"x": np.delete(x, which)}

    def deviance(log: float) -> float:
        seated = stage_with(problem.stage, [parameter], {parameter.name: math.exp(log)})
        there = UpdatingProblem(
            seated, problem.measured, rest, problem.model, problem.drives, problem.model_uncertainty
        )
        if not rest:
            r = there.residual_or_refused(np.zeros(0))
            return min(float(r @ r), _IMPOSSIBLE)
        try:
            near["x"], r, *_ = most_probable(there, near["x"])
        except (FlexstageError, np.linalg.LinAlgError):
            return _IMPOSSIBLE
        return 2.0 * half_square(r, near["x"])

    limits = [math.log(limit) for limit in parameter.limits]
    at_limits = [deviance(limit) for limit in limits]
    value = parameter.value_at(float(x[which]))
    here = math.log(value)
    at_here = deviance(here)
    level = min(*at_limits, at_here) + _LIKELY
    ends = list(parameter.limits)
    for i, (limit, at_limit) in enumerate(zip(limits, at_limits, strict=True)):
        if at_limit > level:
            inner = here if at_here < level else limits[1 - i]
            # the root of the deviance is nearly straight there
            try:
                root: Any = brentq(
                    lambda log: math.sqrt(deviance(log)) - math.sqrt(level), limit, inner, xtol=1e-8
                )
            except ValueError:  # another fit at the inner end: nothing is known on this side
                continue
            ends[i] = math.exp(root)
    return ends[0], ends[1]


def _bound(parameter: UpdateParameter, interval: tuple[float, float]) -> str:
    """Say in words what is known of a seat whose interval ends at a limit; empty if a value."""
    limits = parameter.limits
    assert limits is not None
    low, high = interval[0] > limits[0], interval[1] < limits[1]
    if low and high:
        return ""
    what = f"the measured values give no value of {parameter.name}"
    if high:
        return f"{what}: at most {interval[1]:.3g} N/m (95 %)"
    if low:
        return f"{what}: at least {interval[0]:.3g} N/m (95 %)"
    return f"{what}: all within its limits agrees with them"


def _estimate(
    parameter: UpdateParameter, x: float, covariance: Array, i: int, others: str
) -> Estimate:
    # C = C (J'J) C + C C: the first part is the noise of the measurement, the second what was
    # known before
    before = float(covariance[i] @ covariance[i])
    gain = max(float(covariance[i, i]) - before, 0.0)
    spread = parameter.slope_at(x)
    return Estimate(
        value=parameter.value_at(x),
        unit=parameter.unit,
        components=(
            Component(name="measured", uncertainty=spread * math.sqrt(gain), kind="B"),
            Component(name="before", uncertainty=spread * math.sqrt(before), kind="B"),
        ),
        note="most probable value, posterior spread"
        + (
            f"; {others}"
            if others and parameter.kind in {"modulus_factor", "density_factor"}
            else ""
        ),
    )


def _unidentified(parameters: Sequence[UpdateParameter], information: Array) -> tuple[str, ...]:
    """Name the combinations of parameters on which the measurements say less than is known."""
    notes = []
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
            if parameters[main[0]].kind == "seat_stiffness":
                continue  # its interval says what is known
            what = parameters[main[0]].name
        notes.append(
            f"the measured values hardly determine {what}: {100.0 * remains:.0f} % of its spread "
            "remains"
        )
    return tuple(notes)


def _rows(
    problem: UpdatingProblem, r: Array, jacobian: Array, posterior: Posterior
) -> tuple[UpdatedRow, ...]:
    colour = np.linalg.inv(problem.whiten)
    before, after = problem.predicted(np.zeros(jacobian.shape[1])), problem.y - colour @ r
    spread_after = posterior.spread(colour @ jacobian)
    return tuple(
        UpdatedRow(
            quantity=quantity,
            axis=axis,
            measured=problem.measured[quantity, axis],
            before=float(before[i]),
            after=float(after[i]),
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
