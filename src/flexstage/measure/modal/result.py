"""What a modal fit gives: modes, each with its uncertainty, their shapes, and the response."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.base.short_repr import short_repr
from flexstage.measure.modal.stabilisation import Stabilisation
from flexstage.measure.modal.variable_projection import ModalBasis
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.quantities.estimate import Component, Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode:
    """A mode of vibration that was measured."""

    frequency_hz: Estimate
    """Undamped natural frequency [Hz]."""
    damping_ratio: Estimate
    """Damping as a share of the critical [1]."""
    shape: Complex
    """Motion of each output over that of the one that moves most [1], shape (outputs,); not a
    number where the output has no response from the input that the shape is taken at.
    """
    shape_uncertainty: Array
    """Standard uncertainty of its real and imaginary part [1], shape (outputs, 2)."""
    residues: Complex
    """Residues of the responses to displacement at the pole, output over input times rad/s, shape
    (outputs, inputs); not a number where none was measured.
    """
    significance: float
    """By how much the mode lowers the sum of squares, over what noise would make of it [1]."""

    @property
    def pole(self) -> complex:
        """The pole in the upper half plane [rad/s]."""
        omega, zeta = 2.0 * math.pi * self.frequency_hz.value, self.damping_ratio.value
        return complex(-zeta * omega, omega * math.sqrt(max(1.0 - zeta * zeta, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedResponse:
    """One measured response and the factors of the modes in it."""

    measured: MeasuredResponse
    """What was fitted: the lines in the band."""
    powers: tuple[int, ...]
    """For each output, how often it is derived by time: 0 displacement, 1 velocity, 2 acceleration.
    """
    factors: Array
    """Linear factors of the model, shape (outputs, inputs, q)."""
    covariance: Array
    """Covariance of poles and factors, shape (outputs, inputs, p + q, p + q)."""
    deviation: Array
    """Expected root mean square of the error of each value of `measured`, by the fit, shape (k,
    outputs, inputs).
    """
    residual_rms: Array
    """Root mean square of measured less fitted over that of measured [1], shape (outputs, inputs).
    """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalFit:
    """Modes that were fitted to frequency responses."""

    modes: tuple[Mode, ...]
    """The modes, rising in frequency; none where nothing stands out of the noise."""
    background: tuple[Mode, ...]
    """Poles of an automatic fit that are no modes of the stage in the band: the fit needs them."""
    outputs: tuple[str, ...]
    """Outputs that shapes and residues go over."""
    inputs: tuple[str, ...]
    """Inputs that residues go over."""
    band: tuple[float, float]
    """Ends of the band [Hz]."""
    fitted: tuple[FittedResponse, ...]
    """The responses that were given."""
    delay: Estimate | None
    """Delay of the outputs [s]; None where not asked."""
    lag: Estimate | None
    """Time constant of the first-order lag of the outputs [s]; None where not asked."""
    correlation: Array
    """Correlation of the uncertainties of frequency and damping of all modes, in turn, shape (2
    modes, 2 modes).
    """
    reduced_chi_squared: float
    """Mean square of the residual over the variance that was given, near 1 where the model holds;
    over the one found from the residual itself where none was.
    """
    line_correlation: float
    """Sum of the correlations of the residual with its neighbours [1]: 0 for independent lines."""
    stabilisation: Stabilisation | None
    """Where the start of the fit came from."""
    notes: tuple[str, ...]
    """What a reader should know."""
    basis: ModalBasis
    """The form of the model."""
    theta: Array
    """Its parameters."""

    __repr__ = short_repr

    def response(self, frequency_hz: ArrayLike, number: int = 0) -> Complex:
        """Return the fitted response at frequencies above 0 [Hz], in the units of the measured one.

        `number` says which of the responses that were fitted together; shape (k, outputs, inputs).

        Validity
        --------
        The band of the fit: beyond it the residual terms stand for modes that are there.

        Raises
        ------
        ModelError
            A frequency is 0 or less, or there is no such response.
        """
        s, one = self._at(frequency_hz, number)
        functions = self.basis.functions(self.theta, s)
        value = np.einsum("kq,oiq->koi", functions, one.factors)
        return value * self._motion(s, one)[:, :, None]

    def response_uncertainty(self, frequency_hz: ArrayLike, number: int = 0) -> Array:
        """Return the standard uncertainty of the fitted response at frequencies above 0 [Hz].

        Root of the expected square of the complex error, shape (k, outputs, inputs).

        Raises
        ------
        ModelError
            A frequency is 0 or less, or there is no such response.
        """
        s, one = self._at(frequency_hz, number)
        functions = self.basis.functions(self.theta, s)
        out = np.empty((s.size, *one.factors.shape[:2]))
        for o, i in np.ndindex(*one.factors.shape[:2]):
            slopes = self.basis.derivatives(self.theta, s, functions, one.factors[o, i][:, None])
            jacobian = np.concatenate([slopes[:, :, 0].T, functions], axis=1)
            square = np.einsum("kp,pq,kq->k", jacobian, one.covariance[o, i], jacobian.conj()).real
            out[:, o, i] = np.sqrt(np.maximum(square, 0.0))
        return out * np.abs(self._motion(s, one))[:, :, None]

    def _at(self, frequency_hz: ArrayLike, number: int) -> tuple[Complex, FittedResponse]:
        f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        if f.ndim != 1 or not np.all(f > 0.0):
            raise ModelError("a fitted response is given at frequencies above 0 Hz, got another")
        if not 0 <= number < len(self.fitted):
            raise ModelError(f"there are {len(self.fitted)} fitted responses, got number {number}")
        s = np.asarray(2j * math.pi * f / self.basis.reference, dtype=np.complex128)
        return s, self.fitted[number]

    def _motion(self, s: Complex, one: FittedResponse) -> Complex:
        return (s * self.basis.reference)[:, None] ** np.array(one.powers)[None, :]


def modal_assurance(first: ArrayLike, second: ArrayLike) -> Array:
    """Return the modal assurance criterion of each shape with each.

    ``MAC = |a^H b|^2 / (a^H a b^H b)`` (Allemang and Brown, 1982, IMAC I): 1 where two shapes
    differ by a factor alone, 0 where they are orthogonal.

    Parameters
    ----------
    first, second : array_like
        Shapes, real or complex, shapes (outputs,) or (outputs, modes).

    Returns
    -------
    numpy.ndarray
        The criterion, shape (modes of the first, modes of the second).

    Raises
    ------
    ModelError
        The shapes do not have the same outputs, or one is zero or not finite.

    Examples
    --------
    >>> a, b = np.array([1.0, 0.4 + 0.1j]), np.array([[2j, 0.3], [0.8j - 0.2, -1.0]])
    >>> [round(float(v), 4) for v in modal_assurance(a, b)[0]]
    [1.0, 0.016]
    """
    a = np.asarray(first, dtype=np.complex128)
    b = np.asarray(second, dtype=np.complex128)
    a, b = (x[:, None] if x.ndim == 1 else x for x in (a, b))
    if a.ndim != 2 or b.ndim != 2 or a.shape[0] != b.shape[0]:
        raise ModelError(f"shapes must have the same outputs, got {a.shape} and {b.shape}")
    sizes = [np.sum(np.abs(x) ** 2, axis=0) for x in (a, b)]
    if not all(np.all(np.isfinite(s)) and np.all(s > 0.0) for s in sizes):
        raise ModelError("a mode shape must be finite and not zero to be compared")
    return np.abs(a.conj().T @ b) ** 2 / np.outer(*sizes)


def shape_from_residues(residues: Complex, covariance: Array) -> tuple[Complex, Array]:
    """Return the shape that residues have over the outputs, with its uncertainty.

    Residues of one mode are psi_o l_i. Their mean over the inputs, weighted so that each adds in
    phase, over that of the output that moves most is psi; where that product holds, it does not
    depend on the weights. Residues have shape (outputs, inputs), not a number where there is none;
    the covariance is of real and imaginary parts in turn. The uncertainty is that of real and
    imaginary part, shape (outputs, 2).
    """
    outputs, inputs = residues.shape
    is_finite = np.isfinite(residues)
    # the inputs that all outputs answer to, else the one that most do
    use = is_finite.all(axis=0)
    if not use.any():
        use = np.arange(inputs) == int(np.argmax(is_finite.sum(axis=0)))
    rows = is_finite[:, use].all(axis=1)
    part = residues[np.ix_(rows, use)]
    _, _, right = np.linalg.svd(part, full_matrices=False)
    weights = right[0].conj()
    mean = part @ weights
    largest = int(np.argmax(np.abs(mean)))
    shape = np.full(outputs, np.nan + 0.0j)
    spread = np.full((outputs, 2), np.nan)
    if mean[largest] == 0.0:
        return shape, spread
    values = mean / mean[largest]
    shape[rows] = values
    row_indices, column_indices = np.flatnonzero(rows), np.flatnonzero(use)
    for n, o in enumerate(row_indices):
        slope = np.zeros((outputs, inputs), dtype=np.complex128)
        slope[o, column_indices] += weights / mean[largest]
        slope[row_indices[largest], column_indices] -= values[n] * weights / mean[largest]
        spread[o] = _spread_of_parts(slope.ravel(), covariance)
    return shape, spread


def _spread_of_parts(slope: Complex, covariance: Array) -> Array:
    """Return the uncertainty of the real and the imaginary part of a sum of complex numbers.

    The covariance is of their real and imaginary parts in turn, `slope` their factors.
    """
    turn = np.stack([np.stack([slope.real, -slope.imag]), np.stack([slope.imag, slope.real])])
    rotated = turn.transpose(0, 2, 1).reshape(2, -1)
    return np.sqrt(np.maximum(np.einsum("ap,pq,aq->a", rotated, covariance, rotated), 0.0))


def noisy_estimate(
    value: float, uncertainty: float, unit: str, degrees_of_freedom: float, clock: float = 0.0
) -> Estimate:
    """Return a figure that noise makes uncertain, and `clock` the sample rate."""
    estimate = Estimate.of(value, uncertainty, unit, degrees_of_freedom=degrees_of_freedom)
    rate = Component(name="sample rate", uncertainty=clock, kind="B")
    return estimate.plus(rate) if clock > 0.0 else estimate
