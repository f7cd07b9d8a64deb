"""A Bouc–Wen oscillator from a record of its force and its displacement alone."""

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.files.result import Result
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.coupled_drives.prediction import CoupledPrediction, CoupledPredictions
from flexstage.hysteresis.model import Array, samples
from flexstage.hysteresis.oscillator.model import (
    BoucWenOscillator,
    parameter_row,
    prepared_input,
)
from flexstage.hysteresis.oscillator.model_file import OscillatorModel
from flexstage.hysteresis.oscillator.steps import advance_each
from flexstage.records.record import Record

#: Where the search begins, in parts of 1 / (twice the standard deviation of the displacement).
GAMMAS = (0.3, 1.0, 3.0, 9.0)
DELTAS = (-3.0, -1.0, 0.0, 1.0, 3.0)


class EquationError:
    """The error of the equation of motion with the measured displacement in it.

    ``F u = m F y'' + c F y' + k F (y - o) + alpha F h(y; beta gamma, beta delta)`` where o is the
    offset, h the hysteretic force for alpha = 1, which the motion determines, and F a low pass of
    the frequencies at which the mass moves and drops the rest, which is noise.

    Notes
    -----
    Validity: noise in the displacement biases what it finds, by percents where it is percents; it
    is where a search begins, not where it ends.
    """

    def __init__(
        self,
        force: Array,
        displacement: Array,
        sample_rate_hz: float,
        exponent: float,
    ) -> None:
        n = displacement.size
        self.displacement, self.exponent = displacement, exponent
        self.omega = 2.0 * np.pi * sample_rate_hz / n * np.arange(n // 2 + 1, dtype=np.float64)
        self.low_pass = _low_pass(displacement, self.omega)
        edge = max(32, n // 50)
        self.inside = slice(edge, n - edge)
        derivatives = [self.filtered(displacement, power) for power in (2, 1, 0)]
        self.target = self.filtered(force, 0)
        self.columns = np.stack([*derivatives, np.ones(self.target.size)], axis=1)
        self.unit = 1.0 / (2.0 * float(np.std(displacement)))
        self.scale = self.unit**exponent

    def filtered(self, values: Array, derivative: int) -> Array:
        """Return derivative 0, 1 or 2 of a sequence after the low pass, without its ends."""
        spectrum = np.fft.rfft(values) * self.low_pass * (1j * self.omega) ** derivative
        return np.fft.irfft(spectrum, values.size)[self.inside]

    def project(self, x: Array) -> tuple[Array, Array]:
        """Return the best m, c, k, - k o and alpha, and the error over the force.

        x is beta gamma and beta delta, in parts of the unit of this record.
        """
        hysteretic = np.empty(self.displacement.size)
        scaled = x * self.scale
        force_of_motion(self.displacement, scaled[0], scaled[1], self.exponent, hysteretic)
        size = float(np.sqrt(np.mean(self.target**2))) * math.sqrt(self.target.size)
        if not np.all(np.abs(hysteretic) < 1e3 / self.unit):
            return np.zeros(0), np.full(self.target.size, 10.0 / math.sqrt(self.target.size))
        matrix = np.column_stack([self.columns, self.filtered(hysteretic, 0)])
        norms = np.linalg.norm(matrix, axis=0)
        linear = np.linalg.lstsq(matrix / norms, self.target, rcond=None)[0] / norms
        return linear, (matrix @ linear - self.target) / size

    def search(self, start: tuple[float, float] | None) -> tuple[BoucWenOscillator, float]:
        """Return the oscillator of least error, and the offset.

        The start is beta gamma and beta delta for alpha = 1; the best of a grid where None, or
        where it leads to no oscillator. A ConvergenceError where the best has a mass or a
        hysteretic stiffness below zero.
        """
        best = None if start is None else self._from([np.array(start) / self.scale])
        if best is None:
            grid = [np.array([a, b]) for a in GAMMAS for b in DELTAS]
            grid.sort(key=lambda x: float(np.sum(self.project(x)[1] ** 2)))
            best = self._from(grid[:3])
        if best is None:
            raise ConvergenceError(
                "the record fits no oscillator with a mass and a hysteretic stiffness above zero: "
                "check that the force is in N and the displacement in m and of the same sign"
            )
        return best

    def _from(self, starts: list[Array]) -> tuple[BoucWenOscillator, float] | None:
        """Return the best that some starts lead to, None where it is no oscillator."""
        from scipy.optimize import least_squares

        results = [
            least_squares(lambda x: self.project(x)[1], x, xtol=1e-6, ftol=1e-8, diff_step=1e-5)
            for x in starts
        ]
        best = min(results, key=lambda result: float(result.cost)).x
        values = self.project(best)[0].tolist()
        if not values or values[0] <= 0.0 or values[4] <= 0.0 or values[2] == 0.0:
            return None
        mass, damping, stiffness, constant, alpha = values
        gamma, delta = (best * self.scale).tolist()
        # h is z / alpha: |z|**nu brings alpha**nu, of which one alpha is in front.
        shrink = alpha ** (1.0 - self.exponent)
        model = BoucWenOscillator(
            mass=mass,
            damping=damping,
            stiffness=stiffness,
            alpha=alpha,
            beta_gamma=gamma * shrink,
            beta_delta=delta * shrink,
            exponent=self.exponent,
        )
        return model, -constant / stiffness


def _low_pass(displacement: Array, omega: Array) -> Array:
    """Return a low pass: all up to where 99.5 % of the power is, nothing beyond twice that."""
    spectrum = np.abs(np.fft.rfft(displacement - np.mean(displacement))) ** 2
    power = np.cumsum(spectrum) / np.sum(spectrum)
    edge = max(float(omega[np.searchsorted(power, 0.995)]), float(omega[-1]) / 50.0)
    return 0.5 + 0.5 * np.cos(np.pi * np.clip(omega / edge - 1.0, 0.0, 1.0))


@compiled
def force_of_motion(
    displacement: Array, beta_gamma: float, beta_delta: float, exponent: float, force: Array
) -> None:
    """Find the hysteretic force for alpha = 1 along a sampled motion.

    ``dh = dy (1 - (beta gamma sign(dy h) + beta delta) |h|**nu)``, from h = 0, by one Runge–Kutta
    step a sample. The force is written in parts of alpha [m].
    """
    h = 0.0
    force[0] = h
    for i in range(1, displacement.size):
        d = displacement[i] - displacement[i - 1]
        gamma = math.copysign(beta_gamma, d * beta_gamma)
        k1 = d * _stiffness(h, gamma, beta_delta, exponent)
        k2 = d * _stiffness(h + 0.5 * k1, gamma, beta_delta, exponent)
        k3 = d * _stiffness(h + 0.5 * k2, gamma, beta_delta, exponent)
        k4 = d * _stiffness(h + k3, gamma, beta_delta, exponent)
        h += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        force[i] = h


@compiled
def _stiffness(h: float, gamma: float, delta: float, exponent: float) -> float:
    power = abs(h) if exponent == 1.0 else abs(h) ** exponent
    return 1.0 - (math.copysign(gamma, gamma * h) + delta) * power


#: Series within the search: 1e-11 of the motion, 1e5 times less than the differences that the
#: derivatives are taken from, and far below any sensor.
ORDER = 13
TOLERANCE = 1e-11
#: Step of the differences, in parts of the scale of each unknown.
DIFFERENCE = 1e-6
#: A model that leaves more than this part of the output does not describe the record.
_POOR = 0.5
#: Neighbouring samples of an error that correlate by more are not noise alone.
_NOT_NOISE = 0.3
#: A free exponent must reduce the error to less than this part.
_BETTER = 0.95
NAMES = tuple(field.name for field in fields(BoucWenOscillator))
INITIAL = ("initial_displacement", "initial_velocity", "initial_force", "offset")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OscillatorFit:
    """What a record says about an oscillator."""

    model: BoucWenOscillator
    """The oscillator."""
    initial: Array
    """Displacement [m], velocity [m/s] and hysteretic force [N] at the first sample, shape (3,)."""
    offset: float
    """Reading of the sensor at zero displacement [m]."""
    values: dict[str, float]
    """What was identified: fields of the model, the three of the initial state, the offset."""
    standard_errors: dict[str, float]
    """Standard errors of these, for a white residual, in the unit of each."""
    error: Array
    """Simulated less measured displacement [m], shape (n,)."""
    warnings: tuple[str, ...] = ()
    """What the record cannot say, and what would."""

    @property
    def rms(self) -> float:
        """Root mean square of the error [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def neighbours(self) -> float:
        """Correlation of neighbouring samples of the error: zero for white noise."""
        return float(np.corrcoef(self.error[1:], self.error[:-1])[0, 1])


def fit_oscillator(
    u: ArrayLike,
    y: ArrayLike,
    sample_rate_hz: float,
    *,
    exponent: float | None = 1.0,
    start: tuple[float, float] | None = None,
) -> OscillatorFit:
    """Find the oscillator whose simulation comes nearest to a record.

    Two searches. The first puts the measured displacement into the equation of motion: there the
    force is linear in m, c, k and alpha, so only beta gamma and beta delta are searched
    for (variable projection; Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). It is robust, but
    noise in the displacement biases it. From there the second minimises the error of a simulation,
    of which the initial state is a part, by Gauss–Newton steps in a trust region (Branch, Coleman
    and Li, SIAM J. Sci. Comput. 21, 1999): the maximum likelihood where the noise is white. The
    exponent is identified where None. Start: beta gamma and beta delta [1/m], times
    ``alpha**(nu - 1)`` for another exponent than 1; a grid where not given, or where the start
    leads to no oscillator. A ConvergenceError where no start led to one.

    Notes
    -----
    Validity: a record that excites the resonance and the loop, sampled at twice the highest
    frequency of the force at least. The standard errors assume a white residual; a warning says
    where it is not.

    Examples
    --------
    >>> truth = BoucWenOscillator(
    ...     mass=1.7, damping=8.0, stiffness=4.1e4, alpha=5.3e4,
    ...     beta_gamma=870.0, beta_delta=-420.0,
    ... )
    >>> rng = np.random.default_rng(3)
    >>> drive = 70.0 * np.convolve(rng.standard_normal(3000), np.hanning(9), "same")
    >>> record = truth.simulate(drive, 800.0).displacement
    >>> result = fit_oscillator(drive, 3e-4 + record, 800.0)
    >>> print(f"{result.model.beta_gamma:.3f} {result.model.beta_delta:.3f} {result.offset:.6f}")
    870.000 -420.000 0.000300
    """
    force, displacement = _record(u, y)
    pieces = prepared_input(force, sample_rate_hz, "band-limited")
    begin = EquationError(force, displacement, sample_rate_hz, exponent or 1.0).search(start)
    return _Problem(pieces, displacement, sample_rate_hz, *begin, exponent is None).solve()


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
        offset: float,
        exponent_free: bool,
    ) -> None:
        self.pieces, self.displacement, self.rate = pieces, displacement, sample_rate_hz
        self.free = np.array([i for i in range(11) if i != 6 or exponent_free])
        velocity = (displacement[1] - displacement[0]) * sample_rate_hz
        state = [displacement[0] - offset, velocity, 0.0, offset]
        self.base = np.concatenate([parameter_row(begin), state])
        stiffness = begin.stiffness + begin.alpha
        size = float(np.std(displacement))
        omega = math.sqrt(abs(stiffness) / begin.mass)
        scales = [begin.mass, begin.mass * omega, stiffness, stiffness, 1.0 / size, 1.0 / size]
        scales += [1.0, size, omega * size, stiffness * size, size]
        self.scale = np.abs(np.array(scales))[self.free]
        self.size = size

    def unknowns(self, x: Array) -> Array:
        """Return parameters, initial state and offset for unknowns in parts of their scale."""
        full = self.base.copy()
        full[self.free] = x * self.scale
        return full

    def simulate(self, full: Array) -> Array:
        """Return the errors of many simulations in parts of the displacement, shape (m, n)."""
        motion = np.empty((len(full), self.displacement.size))
        # contiguous whatever their number: for other layouts all is compiled again
        parameters, initial, offset = map(np.ascontiguousarray, np.hsplit(full, [7, 10]))
        advance_each(self.pieces, 1.0 / self.rate, parameters, initial, ORDER, TOLERANCE, motion)
        motion += offset - self.displacement
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

    def solve(self) -> OscillatorFit:
        """Minimise the error."""
        from scipy.optimize import least_squares

        x = self.base[self.free] / self.scale
        if not np.all(np.isfinite(self.residual(x))):
            raise ConvergenceError(
                "the simulation diverges from where the search began: give another start"
            )
        options: Any = {"jac": self.jacobian, "max_nfev": 60}
        result: Any = least_squares(self.residual, x, xtol=1e-10, ftol=1e-12, gtol=1e-12, **options)
        full = self.unknowns(result.x)
        model = BoucWenOscillator(**dict(zip(NAMES, full[:7].tolist(), strict=True)))
        error = result.fun * self.size
        freedom = error.size - x.size
        normal = result.jac.T @ result.jac
        spread = np.linalg.pinv(normal, rcond=1e-15) * float(result.fun @ result.fun) / freedom
        names = [(NAMES + INITIAL)[i] for i in self.free]
        errors = np.sqrt(np.diag(spread * np.outer(self.scale, self.scale)))
        fit = OscillatorFit(
            model=model,
            initial=full[7:10],
            offset=float(full[10]),
            values=dict(zip(names, full[self.free].tolist(), strict=True)),
            standard_errors=dict(zip(names, errors.tolist(), strict=True)),
            error=error,
        )
        warnings = _warnings(fit, self.size)
        if result.status <= 0:
            warnings.append("the search did not end within 60 steps: parameters are uncertain")
        return replace(fit, warnings=tuple(warnings))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OscillatorIdentification(Result):
    """The oscillator of a record."""

    table_key: ClassVar[str] = "parameters"

    model: OscillatorModel
    """The model, which is written to its file."""
    fit: OscillatorFit
    """The fit."""
    fitted: CoupledPredictions
    """The model on its record."""
    tested: CoupledPredictions | None = None
    """The model on other records."""
    notes: tuple[str, ...] = ()
    """How the record was read."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the record does not determine."""
        return self.fit.warnings

    def data(self) -> dict[str, Any]:
        """Return parameters and errors as plain data."""
        errors = self.fit.standard_errors
        return {
            "record": self.fitted.predictions[0].source,
            "parameters": [
                {"name": name, "value": value, "standard_error": errors[name]}
                for name, value in self.fit.values.items()
            ],
            "frequency_hz": self.model.frequency_hz,
            "output_rms": self.fitted.predictions[0].output_rms,
            "error": self.fit.rms,
            "tested": None if self.tested is None else self.tested.data()["records"],
            "warnings": list(self.fit.warnings),
            "notes": list(self.notes),
        }


def identify_oscillator(
    record: Record, input_column: str | int, output_column: str | int
) -> OscillatorIdentification:
    """Identify an oscillator with a Bouc–Wen force in its loop from a resonant record.

    Parameters
    ----------
    record : Record
        A record whose input excites the resonance and moves the loop into its curvature.
    input_column, output_column : str or int
        Columns of the force, or of a voltage that is proportional to it, and of the displacement.

    Returns
    -------
    OscillatorIdentification
        The model, with its errors.

    Raises
    ------
    ModelError
        The record is too short, or a column does not move.
    ConvergenceError
        No oscillator with a mass and a hysteretic stiffness above zero fits the record.

    Notes
    -----
    The exponent is one, unless the error is not noise and a free exponent reduces it.

    Validity: as `fit_oscillator` and `BoucWenOscillator`.
    """
    driven, follows = record.channel(input_column), record.channel(output_column)
    fit = fit_oscillator(driven.values, follows.values, record.sample_rate_hz)
    if fit.neighbours > _NOT_NOISE:
        free = fit_oscillator(driven.values, follows.values, record.sample_rate_hz, exponent=None)
        fit = free if free.rms < _BETTER * fit.rms else fit
    motion = follows.values - fit.offset
    model = OscillatorModel(
        oscillator=fit.model,
        offset=fit.offset,
        inputs=(driven.name,),
        outputs=(follows.name,),
        input_unit=driven.unit,
        output_unit=follows.unit,
        largest=float(np.max(np.abs(motion))),
        error=fit.rms,
        warnings=fit.warnings,
    )
    on_record = CoupledPrediction(
        source=Path(record.source).name or "record",
        time=record.time,
        measured=motion[:, None],
        predicted=(motion + fit.error)[:, None],
        warm_up=0,
    )
    fitted = CoupledPredictions(model=model, predictions=(on_record,))
    return OscillatorIdentification(model=model, fit=fit, fitted=fitted, notes=record.notes)


def _warnings(result: OscillatorFit, size: float) -> list[str]:
    """Say what the record leaves open."""
    warnings = []
    errors = result.standard_errors
    if result.rms > _POOR * size:
        raise ConvergenceError(
            f"the best oscillator with a Bouc-Wen force leaves {100.0 * result.rms / size:.0f} % "
            "of the output: another resonance, hysteresis or drive moves it; record fewer at a time"
        )
    for name in ("damping", "stiffness", "alpha", "beta_gamma", "beta_delta"):
        value = abs(getattr(result.model, name))
        if errors[name] > 0.3 * value:
            warnings.append(
                f"the record does not identify {name} ({value:.3g} ± {errors[name]:.1g}): record "
                "a larger force, that moves the loop well into its curvature"
            )
    # below that it is rounding of the record and tolerance of the search
    if result.rms > 1e-7 * size and result.neighbours > _NOT_NOISE:
        warnings.append(
            f"neighbouring samples of the residual agree by {result.neighbours:.2f}: it is not "
            "noise alone, so the standard errors are too small and the model is not the whole plant"
        )
    model = result.model
    if model.beta_gamma + model.beta_delta <= 0.0:
        warnings.append(
            "beta gamma + beta delta is not above zero, so the hysteretic force grows without "
            "bound: do not use the model beyond the displacement of the record"
        )
    return warnings
