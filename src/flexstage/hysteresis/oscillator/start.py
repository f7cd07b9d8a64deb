"""A first guess of an oscillator: the measured displacement in its equation of motion."""

import math

import numpy as np

from flexstage.base.errors import ConvergenceError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.oscillator.model import BoucWenOscillator

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

    Examples
    --------
    >>> truth = BoucWenOscillator(
    ...     mass=1.7, damping=8.0, stiffness=4.1e4, alpha=5.3e4,
    ...     beta_gamma=870.0, beta_delta=-420.0,
    ... )
    >>> rng = np.random.default_rng(3)
    >>> drive = 70.0 * np.convolve(rng.standard_normal(3000), np.hanning(9), "same")
    >>> record = truth.simulate(drive, 800.0).displacement
    >>> start, _ = EquationError(drive, record, 800.0, 1.0).search(None)
    >>> print(f"{start.mass:.2f} kg")
    1.70 kg
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
