"""A Bouc–Wen oscillator from a record of its force and its displacement alone."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.oscillator.oscillator import (
    BoucWenOscillator,
    Interpolation,
    parameter_row,
    prepared_input,
)
from benchmarks.oscillator.start import EquationError
from benchmarks.oscillator.steps import advance_each
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.hysteresis.model import Array, samples

#: Series within the search: 1e-11 of the motion, 1e5 times less than the differences that the
#: derivatives are taken from, and far below any sensor.
ORDER = 13
TOLERANCE = 1e-11
#: Step of the differences, in parts of the scale of each unknown.
DIFFERENCE = 1e-6
NAMES = tuple(field.name for field in fields(BoucWenOscillator))
INITIAL = ("initial_displacement", "initial_velocity", "initial_force")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OscillatorIdentification:
    """What a record says about an oscillator."""

    model: BoucWenOscillator
    """The oscillator."""
    initial: Array
    """Displacement [m], velocity [m/s] and hysteretic force [N] at the first sample, shape (3,)."""
    names: tuple[str, ...]
    """What was identified: fields of the model, then the three of the initial state."""
    covariance: Array
    """Covariance of these, for a white residual, shape (p, p)."""
    rms: float
    """Root mean square of the simulation error [m]."""
    evaluations: int
    """Number of simulations of the record that the search took."""
    warnings: tuple[str, ...]
    """What the record cannot say, and what would."""

    def standard_errors(self) -> dict[str, float]:
        """Return the standard error of all that was identified, by name, in the unit of each."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def identify_oscillator(
    u: ArrayLike,
    y: ArrayLike,
    sample_rate_hz: float,
    *,
    mass: float | None = None,
    exponent: float | None = 1.0,
    start: tuple[float, float] | None = None,
    interpolation: Interpolation = "band-limited",
) -> OscillatorIdentification:
    """Find the oscillator whose simulation comes nearest to a record.

    Two searches. The first takes the equation of motion at its word: with the measured displacement
    in it, the force is linear in m, c, k and alpha, so only beta gamma and beta delta are searched
    for (variable projection; Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). It is robust, but
    noise in the displacement biases it. From there the second minimises the error of a simulation,
    of which the initial state is a part, by Gauss–Newton steps in a trust region (Branch, Coleman
    and Li, SIAM J. Sci. Comput. 21, 1999): the maximum likelihood where the noise is white. The
    mass [kg] is identified where not given, the exponent where None. Start: beta gamma and beta
    delta [1/m], times ``alpha**(nu - 1)`` for another exponent than 1; a grid where not given, or
    where the start leads to no oscillator. A ConvergenceError where no start led to one.

    Notes
    -----
    Validity: a record that excites the resonance and the loop, sampled at twice the highest
    frequency of the force at least, without offset of the sensor. The standard errors assume a
    white residual; a warning says where it is not.

    Examples
    --------
    >>> truth = BoucWenOscillator(
    ...     mass=1.7, damping=8.0, stiffness=4.1e4, alpha=5.3e4,
    ...     beta_gamma=870.0, beta_delta=-420.0,
    ... )
    >>> rng = np.random.default_rng(3)
    >>> drive = 70.0 * np.convolve(rng.standard_normal(3000), np.hanning(9), "same")
    >>> record = truth.simulate(drive, 800.0).displacement
    >>> found = identify_oscillator(drive, record, 800.0)
    >>> print(f"{found.model.beta_gamma:.3f} {found.model.beta_delta:.3f}")
    870.000 -420.000
    """
    force, displacement = _record(u, y)
    pieces = prepared_input(force, sample_rate_hz, interpolation)
    if mass is not None and not (math.isfinite(mass) and mass > 0.0):
        raise ModelError(f"mass must be above zero, got {mass} kg")
    first = EquationError(force, displacement, sample_rate_hz, mass, exponent or 1.0)
    begin = first.search(start)
    velocity = (displacement[1] - displacement[0]) * sample_rate_hz
    problem = _Problem(
        pieces, displacement, sample_rate_hz, begin, velocity, mass is None, exponent is None
    )
    return problem.solve()


def _record(u: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    force, displacement = samples(u, "force"), samples(y, "displacement")
    if force.size != displacement.size:
        raise ModelError(
            f"force and displacement must be as long as each other, got {force.size} and "
            f"{displacement.size} samples"
        )
    if force.size < 200:
        raise ModelError(
            f"200 samples or more are needed to identify an oscillator, got {force.size}"
        )
    for name, values in (("force", force), ("displacement", displacement)):
        if np.ptp(values) == 0.0:
            raise ModelError(f"the {name} must move, got {values[0]} throughout")
    return force, displacement


class _Problem:
    """The simulation error as a function of the unknowns, each in parts of its scale."""

    def __init__(
        self,
        pieces: Array,
        displacement: Array,
        sample_rate_hz: float,
        begin: BoucWenOscillator,
        velocity: float,
        mass_free: bool,
        exponent_free: bool,
    ) -> None:
        self.pieces, self.displacement, self.rate = pieces, displacement, sample_rate_hz
        free = [*range(0 if mass_free else 1, 7 if exponent_free else 6), 7, 8, 9]
        self.free = np.array(free)
        self.names = tuple((NAMES + INITIAL)[i] for i in free)
        self.base = np.concatenate([parameter_row(begin), [displacement[0], velocity, 0.0]])
        stiffness = begin.stiffness + begin.alpha
        size = float(np.std(displacement))
        omega = math.sqrt(abs(stiffness) / begin.mass)
        scales = [begin.mass, begin.mass * omega, stiffness, stiffness, 1.0 / size, 1.0 / size]
        scales += [1.0, size, omega * size, stiffness * size]
        self.scale = np.abs(np.array(scales))[self.free]
        self.size = size
        self.evaluations = 0

    def unknowns(self, x: Array) -> Array:
        """Return parameters and initial state for unknowns in parts of their scale."""
        full = self.base.copy()
        full[self.free] = x * self.scale
        return full

    def simulate(self, full: Array) -> Array:
        """Return the errors of many simulations in parts of the displacement, shape (m, n)."""
        self.evaluations += len(full)
        motion = np.empty((len(full), self.displacement.size))
        # whatever their number, rows lie alike: for other layouts all is compiled again
        parameters, initial = (np.ascontiguousarray(part) for part in np.hsplit(full, [7]))
        advance_each(self.pieces, 1.0 / self.rate, parameters, initial, ORDER, TOLERANCE, motion)
        motion -= self.displacement
        motion /= self.size
        return motion

    def residual(self, x: Array) -> Array:
        """Return the error of the simulation; not finite where there is no such oscillator."""
        full = self.unknowns(x)
        if full[0] <= 0.0 or full[3] <= 0.0 or full[6] <= 0.0:
            return np.full(self.displacement.size, np.inf)
        return self.simulate(full[None, :])[0]

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the error by forward differences."""
        rows = np.array([self.unknowns(x + DIFFERENCE * e) for e in np.eye(x.size)])
        errors = self.simulate(np.vstack([self.unknowns(x), rows]))
        return (errors[1:] - errors[0]).T / DIFFERENCE

    def solve(self) -> OscillatorIdentification:
        """Minimise the error."""
        from scipy.optimize import least_squares

        x = self.base[self.free] / self.scale
        if not np.all(np.isfinite(self.residual(x))):
            raise ConvergenceError(
                "the simulation diverges from where the search began: give another start"
            )
        options: Any = {"jac": self.jacobian, "max_nfev": 60}
        result: Any = least_squares(self.residual, x, xtol=1e-10, ftol=1e-12, gtol=1e-12, **options)
        if result.status <= 0:
            raise ConvergenceError(
                "the search for the oscillator did not end within 60 steps: give another start"
            )
        full = self.unknowns(result.x)
        model = BoucWenOscillator(**dict(zip(NAMES, full[:7].tolist(), strict=True)))
        error = result.fun * self.size
        freedom = error.size - x.size
        normal = result.jac.T @ result.jac
        spread = np.linalg.pinv(normal, rcond=1e-15) * float(result.fun @ result.fun) / freedom
        covariance = spread * np.outer(self.scale, self.scale)
        identification = OscillatorIdentification(
            model=model,
            initial=full[7:],
            names=self.names,
            covariance=covariance,
            rms=float(np.sqrt(np.mean(error**2))),
            evaluations=self.evaluations,
            warnings=(),
        )
        return replace(identification, warnings=tuple(_warnings(identification, error, self.size)))


def _warnings(found: OscillatorIdentification, error: Array, size: float) -> list[str]:
    """Say what the record leaves open."""
    warnings = []
    errors = found.standard_errors()
    for name in ("damping", "stiffness", "alpha", "beta_gamma", "beta_delta"):
        value = abs(getattr(found.model, name))
        if errors[name] > 0.3 * value:
            warnings.append(
                f"the record does not identify {name} ({value:.3g} ± {errors[name]:.1g}): record "
                "a larger force, that moves the loop well into its curvature"
            )
    centred = error - np.mean(error)
    power = float(centred @ centred)
    # Below that it is rounding of the record and tolerance of the search.
    if found.rms > 1e-7 * size:
        neighbour = float(centred[1:] @ centred[:-1]) / power
        if neighbour > 0.3:
            warnings.append(
                f"neighbouring samples of the residual agree by {neighbour:.2f}: it is not noise "
                "alone, so the standard errors are too small and the model is not the whole plant"
            )
    model = found.model
    if model.beta_gamma + model.beta_delta <= 0.0:
        warnings.append(
            "beta gamma + beta delta is not above zero, so the hysteretic force grows without "
            "bound: do not use the model beyond the displacement of the record"
        )
    return warnings
