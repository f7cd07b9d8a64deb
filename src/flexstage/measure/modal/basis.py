"""The modal model of a frequency response: linear in its residues, not in its poles."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array, Complex


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalBasis:
    """Functions whose sum with real factors is a response to displacement.

    With s = i omega over the reference frequency,

        H = g(s) [sum (a_r + b_r s) / (s^2 + 2 zeta_r w_r s + w_r^2) + u + l / s^2],

    g(s) = exp(-s tau) / (1 + s T): a pair of conjugate poles, with its residue in a and b; u and l
    stand for modes above and below the band (Ewins, 2000, Modal Testing, 2nd ed.). The parameters
    are w_1, zeta_1, ..., then tau and T where they are in it. Everywhere theta has shape (size,),
    and s shape (k,).
    """

    count: int
    """Number of modes."""
    reference: float
    """The frequency that makes all others numbers of size 1 [rad/s]."""
    delay: bool = False
    """Whether there is a delay tau."""
    lag: bool = False
    """Whether there is a lag T."""
    residuals: bool = True
    """Whether u and l are in it."""
    real_modes: bool = False
    """Whether the b_r are left out, as in a system with proportional damping."""

    @property
    def size(self) -> int:
        """Number of parameters that are not linear."""
        return 2 * self.count + self.delay + self.lag

    @property
    def linear(self) -> int:
        """Number of linear factors of each response."""
        return self.per_mode * self.count + (2 if self.residuals else 0)

    @property
    def per_mode(self) -> int:
        """Number of linear factors of each mode."""
        return 1 if self.real_modes else 2

    def transfer(self, theta: Array, s: Complex) -> Complex:
        """Return the factor g that delay and lag make of a response, shape (k,)."""
        g = np.ones(s.size, dtype=np.complex128)
        if self.delay:
            g = np.exp(-s * theta[2 * self.count])
        if self.lag:
            g = g / (1.0 + s * theta[-1])
        return g

    def functions(self, theta: Array, s: Complex) -> Complex:
        """Return the functions at some frequencies, shape (k, linear)."""
        g = self.transfer(theta, s)
        columns = []
        for w, zeta in theta[: 2 * self.count].reshape(-1, 2):
            first = g / (s * s + 2.0 * zeta * w * s + w * w)
            columns += [first] if self.real_modes else [first, s * first]
        if self.residuals:
            columns += [g, g / (s * s)]
        return np.stack(columns, axis=1)

    def derivatives(self, theta: Array, s: Complex, functions: Complex, factors: Array) -> Complex:
        """Return how responses change with the parameters, their linear factors held.

        With factors of shape (linear, m), the derivatives have shape (size, k, m).
        """
        out = np.empty((self.size, s.size, factors.shape[1]), dtype=np.complex128)
        for r, (w, zeta) in enumerate(theta[: 2 * self.count].reshape(-1, 2)):
            own = slice(self.per_mode * r, self.per_mode * (r + 1))
            over = functions[:, own] / (s * s + 2.0 * zeta * w * s + w * w)[:, None]
            out[2 * r] = (over * (-2.0 * zeta * s - 2.0 * w)[:, None]) @ factors[own]
            out[2 * r + 1] = (over * (-2.0 * w * s)[:, None]) @ factors[own]
        if self.delay or self.lag:
            value = functions @ factors
            if self.delay:
                out[2 * self.count] = -s[:, None] * value
            if self.lag:
                out[-1] = -(s / (1.0 + s * theta[-1]))[:, None] * value
        return out

    def start(self, poles: Complex) -> Array:
        """Return parameters to start from poles [rad/s], delay and lag 0."""
        theta = np.zeros(self.size)
        size = np.abs(poles)
        theta[: 2 * self.count : 2] = size / self.reference
        theta[1 : 2 * self.count : 2] = -poles.real / size
        return theta

    def residue_weights(self, theta: Array, mode: int) -> Complex:
        """Return the residue of a mode's pole for each of its linear factors.

        A_r = (a + b lambda) / (lambda - lambda*), in the numbers of the reference; in rad/s, shape
        (per_mode,).
        """
        pole, other = self.poles(theta)[mode] / self.reference
        weights = np.array([1.0, pole]) * self.reference / (pole - other)
        return weights[: self.per_mode]

    def poles(self, theta: Array) -> Complex:
        """Return the pairs of poles: conjugates, or both real where damping is above critical.

        In rad/s, shape (count, 2).
        """
        w, zeta = theta[: 2 * self.count].reshape(-1, 2).T
        root: Complex = np.sqrt((zeta * zeta - 1.0).astype(np.complex128))
        root = np.where(root.imag < 0.0, -root, root)
        pair = np.stack([w * (-zeta + root), w * (-zeta - root)], axis=1)
        return np.asarray(self.reference * pair, dtype=np.complex128)


def reference_frequency(band: tuple[float, float]) -> float:
    """Return the geometric mean of the ends of a band [Hz], in rad/s."""
    return 2.0 * math.pi * math.sqrt(band[0] * band[1])
