"""Parameters of a stage, what a model with them says, and the search for the most probable."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal

import numpy as np

from flexstage.arrays import Array
from flexstage.choose import has_no
from flexstage.errors import ConvergenceError, FlexstageError, ModelError
from flexstage.estimate import Estimate
from flexstage.hinges.registry import with_neck_thickness
from flexstage.stage import Hinge, Stage
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

Kind = Literal["neck_factor", "neck_offset", "modulus_factor", "density_factor", "damping_ratio"]
#: Kinds of parameters: the unit, and the expectation where none is given.
PARAMETER_KINDS: dict[str, tuple[str, float | None]] = {
    "neck_factor": ("1", 1.0),
    "neck_offset": ("m", 0.0),
    "modulus_factor": ("1", 1.0),
    "density_factor": ("1", 1.0),
    "damping_ratio": ("1", None),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateParameter:
    """A parameter of a stage that measurements are to tell, and what is known of it before.

    Raises
    ------
    ModelError
        The kind is unknown, or a figure is impossible.

    Examples
    --------
    >>> legs = UpdateParameter(name="legs", kind="neck_offset", spread=8e-6, hinges=("xg*",))
    >>> legs.unit, legs.mean
    ('m', 0.0)
    """

    name: str
    """Its name."""
    kind: Kind
    """One of `PARAMETER_KINDS`: a factor of neck thicknesses or what is added to them, a factor of
    Young's modulus or of the density, or the damping ratio of all modes.
    """
    spread: float
    """Standard deviation of what is known before [1], of an offset [m]: the scatter of the machine,
    of the alloy.
    """
    hinges: tuple[str, ...] = ("*",)
    """Patterns of the names of the hinges that it is for, as ``xgp*``; all where not given."""
    expected: float | None = None
    """What is expected before; 1 of a factor, 0 of an offset. A damping ratio needs it."""

    def __post_init__(self) -> None:
        if self.kind not in PARAMETER_KINDS:
            raise ModelError(
                f"parameter '{self.name}': unknown kind {self.kind!r}: expected one of "
                f"{', '.join(PARAMETER_KINDS)}"
            )
        if not 0.0 < self.spread < math.inf:
            raise ModelError(
                f"parameter '{self.name}': the spread must be positive and finite, got "
                f"{self.spread!r}"
            )
        if self.expected is None and self.kind == "damping_ratio":
            raise ModelError(f"parameter '{self.name}': say which damping ratio is expected")
        if self.expected is not None and not math.isfinite(self.expected):
            raise ModelError(
                f"parameter '{self.name}': what is expected must be finite, got {self.expected!r}"
            )

    @property
    def unit(self) -> str:
        """Unit of its value."""
        return PARAMETER_KINDS[self.kind][0]

    @property
    def mean(self) -> float:
        """What is expected of it before."""
        usual = PARAMETER_KINDS[self.kind][1]
        return self.expected if self.expected is not None else float(usual or 0.0)

    def holds(self, hinge: str) -> bool:
        """Say whether it is for a hinge of this name: whether one of its patterns fits."""
        return any(fnmatchcase(hinge, pattern) for pattern in self.hinges)


def stage_with(
    stage: Stage, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Stage:
    """Return a stage with other values of parameters.

    Parameters
    ----------
    stage : Stage
        The stage as it was described.
    parameters : sequence of UpdateParameter
        The parameters; where several are for one hinge, factors come before offsets.
    values : Mapping
        Value of each parameter by its name.

    Returns
    -------
    Stage
        The same bodies with these necks and this material; a damping ratio is no part of a stage.

    Raises
    ------
    HingeError
        A neck is impossible.
    StageError
        The material is.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> thin = UpdateParameter(name="necks", kind="neck_factor", spread=0.02)
    >>> other = stage_with(design("parallelogram"), [thin], {"necks": 0.96})
    >>> round(other.hinges[0].profile.neck_thickness * 1e3, 6)
    0.48
    """
    modulus, density = stage.material.youngs_modulus, stage.material.density
    for p in parameters:
        if p.kind == "modulus_factor":
            modulus *= values[p.name]
        elif p.kind == "density_factor":
            density *= values[p.name]
    return replace(
        stage,
        material=replace(stage.material, youngs_modulus=modulus, density=density),
        hinges=tuple(_hinge(h, parameters, values) for h in stage.hinges),
    )


def _hinge(
    hinge: Hinge, parameters: Sequence[UpdateParameter], values: Mapping[str, float]
) -> Hinge:
    thickness = hinge.profile.neck_thickness
    for p in parameters:
        if p.kind == "neck_factor" and p.holds(hinge.name):
            thickness *= values[p.name]
    for p in parameters:
        if p.kind == "neck_offset" and p.holds(hinge.name):
            thickness += values[p.name]
    return replace(hinge, profile=with_neck_thickness(hinge.profile, thickness))


_MODAL = ("natural_frequency_hz", "damping_ratio")
_STATIC = ("transmission_ratio", "output_displacement", "input_stiffness")
#: Quantities that a stage can be fitted to.
UPDATABLE: tuple[str, ...] = (*_MODAL, *_STATIC)
Model = Callable[[Stage], MechanicalSystem]
_STEP = 1e-3
# in standard deviations of what is known after: a step that ends the search, and one over which
# derivatives need not be found again
_CLOSE = 1e-4
_SAME = 1e-2
_FAR = (
    "the most probable parameters are not reached: the measured values may be far from what the "
    "model can give; widen the spread, or check the units"
)
_ITERATIONS = 40


def predict(
    system: MechanicalSystem,
    wanted: Sequence[tuple[str, str]],
    *,
    drives: DriveCondition = "removed",
) -> Array:
    """Return what a model says of quantities of its axes.

    Parameters
    ----------
    system : MechanicalSystem
        The model.
    wanted : sequence of tuple of str
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
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> system = lumped_system(design("parallelogram"))
    >>> round(float(predict(system, [("natural_frequency_hz", "x")])[0]), 1)
    193.7
    """
    axes = {axis.name: axis for axis in system.axes}
    for quantity, name in wanted:
        if quantity not in UPDATABLE:
            raise ModelError(
                f"a stage cannot be fitted to '{quantity}': expected one of {', '.join(UPDATABLE)}"
            )
        if name not in axes:
            raise ModelError(has_no("the stage", "axis", name, axes))
    bare = modes(system, count=None)
    found = bare if drives == "removed" else modes(system, drives=drives, count=None)
    pushed: dict[str, AxisAnalysis] = {
        name: analyse_axis(system, axes[name])
        for name in sorted({name for quantity, name in wanted if quantity in _STATIC})
    }

    def value(quantity: str, axis: AxisPort) -> float:
        if quantity in _STATIC:
            one = pushed[axis.name]
            if quantity == "transmission_ratio":
                return one.output_displacement / one.input_displacement
            return getattr(one, quantity)
        mode = axis_mode(system, found, axis.drive, axis.probe)
        return float((found.frequency_hz if quantity == _MODAL[0] else found.damping_ratio)[mode])

    return np.array([value(quantity, axes[name]) for quantity, name in wanted])


class UpdatingProblem:
    """Residuals in units of their uncertainty, over parameters in units of their spread.

    Everywhere x is parameters less what is expected, over their spreads [1], shape (p,); m values
    are measured, by quantity and name of the axis. `model_uncertainty` is relative [1].
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
        self.drives: DriveCondition = drives
        self.measured = dict(measured)
        self.model: Model = lumped_system if model == "lumped" else model
        self.mean = np.array([p.mean for p in parameters])
        self.sigma = np.array([p.spread for p in parameters])
        self.keys = list(measured)
        self.y = np.array([e.value for e in measured.values()])
        # from standard to expanded uncertainty of a normal distribution at 95 %
        normal = 1.959963984540054
        # the normal distribution of the same 95 % interval, so that few observations count as such
        spread = np.array([e.expanded / normal for e in measured.values()])
        covariance = np.diag(spread**2)
        for quantity in {q for q, _ in self.keys} - {"damping_ratio"}:
            alike = np.array([q == quantity for q, _ in self.keys]) * self.y
            covariance += model_uncertainty**2 * np.outer(alike, alike)
        self.whiten = np.linalg.inv(np.linalg.cholesky(covariance))

    def values(self, x: Array) -> Array:
        """Return the values of the parameters, in their units."""
        return self.mean + self.sigma * x

    def stage_at(self, x: Array) -> Stage:
        """Return the stage that has parameters."""
        named = dict(zip((p.name for p in self.parameters), self.values(x).tolist(), strict=True))
        return stage_with(self.stage, self.parameters, named)

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

        Shape (m, p). Refused where there is no such stage beside these parameters.
        """
        columns = []
        for step in _STEP * np.eye(x.size):
            low, high = self.residual_or_refused(x - step), self.residual_or_refused(x + step)
            if not np.isfinite(low + high).all():
                raise ConvergenceError(_FAR)
            columns.append((low - high) / (2.0 * _STEP))
        return np.stack(columns, axis=1)


def half_square(residual: Array, x: Array) -> float:
    """Return Phi, half of the squares of residuals and parameters.

    Examples
    --------
    >>> half_square(np.array([1.0, 2.0]), np.array([0.5]))
    2.625
    """
    return 0.5 * float(residual @ residual + x @ x)


def most_probable(problem: UpdatingProblem) -> tuple[Array, Array, Array, Array, int]:
    """Search by Gauss and Newton's steps.

    Returned are the most probable parameters less what is expected, over their spreads; there the
    whitened residual and the derivatives of the whitened prediction; these derivatives at what is
    expected; and the number of steps.
    """
    x = np.zeros(len(problem.parameters))
    r = problem.residual(x)
    first = jacobian = problem.jacobian(x)
    for iteration in range(_ITERATIONS):
        curvature = jacobian.T @ jacobian + np.eye(x.size)
        step: Array = np.linalg.solve(curvature, jacobian.T @ r - x).astype(np.float64)
        # length of the step in standard deviations of what is known after
        length = math.sqrt(float(step @ curvature @ step))
        if length < _CLOSE:
            return x, r, jacobian, first, iteration
        x, r = _descended(problem, x, r, step)
        if length > _SAME:
            jacobian = problem.jacobian(x)
    raise ConvergenceError(_FAR)


def _descended(problem: UpdatingProblem, x: Array, r: Array, step: Array) -> tuple[Array, Array]:
    """Take a step, halved until it descends."""
    least = half_square(r, x)
    for halvings in range(20):
        there = x + 0.5**halvings * step
        new = problem.residual_or_refused(there)
        # rounding leaves that much of the cost
        if half_square(new, there) <= least + 1e-9 * (1.0 + least):
            return there, new
    raise ConvergenceError(_FAR)
