"""H1, H2 and Hv from averaged spectra, with coherence and variance."""

from typing import Literal, get_args

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.errors import ModelError, RecordError
from flexstage.experiment.spectra.sums import Spectra

Estimator = Literal["H1", "H2", "Hv"]

# inputs of which, at the median line, another explains more than this share are one input
_CORRELATED = 0.98


def require_estimator(estimator: str, inputs: int, noise_ratio: float | None) -> None:
    """Refuse an estimator that there is not."""
    if estimator not in get_args(Estimator):
        raise ModelError(f"an estimator is H1, H2 or Hv, got {estimator!r}")
    if estimator == "H2" and inputs > 1:
        raise ModelError("H2 is defined for one input: take H1 or Hv where there are several")
    if noise_ratio is not None and not (estimator == "Hv" and 0.0 < noise_ratio < np.inf):
        raise ModelError(
            f"a ratio of the noise powers is positive and belongs to Hv, got {noise_ratio!r} for "
            f"{estimator}"
        )


def transfer(
    spectra: Spectra, estimator: Estimator = "H1", noise_ratio: float | None = None
) -> tuple[Complex, Array | None, Array | None]:
    """Return responses, their variance and the coherence.

    H1 = G_yx G_xx^-1, H2 = G_yy / G_xy. Hv is the total least-squares solution, of which the power
    of the noise is spread over both sides: (x, y) scaled to unit power, or to the noise given, is
    orthogonal to the eigenvector of the least eigenvalue of their spectral matrix (Rocklin, Crowley
    and Vold, 1985, 3rd International Modal Analysis Conference). With one input and unit power it
    is sqrt(H1 H2) with the phase of H1.

    With n independent averages and q inputs, what the inputs leave of an output has the density (1
    - coherence) G_yy n / (n - q), and the variance of H1 is that times (G_xx^-1)_ii / n, as of any
    least-squares estimate; at one input (1 - coherence) abs(H)^2 / (coherence (n - 1)), twice the
    square of the random error of the magnitude (Bendat and Piersol, Random Data, 4th edition,
    chapter 9) but for the degree of freedom. That of H2 is the same share of abs(H)^2, that of the
    geometric mean Hv is (1 + coherence) / 2 times it. `noise_ratio` is for Hv: noise power of an
    output over that of an input [(output unit/input unit)^2]; where not given, noise takes the same
    share of the power of each. Response and variance, the expected square of the error of each
    complex value, have shape (k, outputs, inputs); the coherence, with several inputs the multiple
    one, has shape (k, outputs). There is no variance where there are no more averages than inputs.

    Validity
    --------
    The variance is that about the expectation of the estimate: bias by noise on the side that the
    estimator takes as clean, and by lines wider than a resonance, is not in it.
    """
    q = spectra.input_power.shape[1]
    xx, yx, yy = spectra.input_power, spectra.cross, spectra.output_power
    inverse = _inverse(xx) if q > 1 else 1.0 / xx
    h1 = yx @ inverse
    explained = np.einsum("koi,koi->ko", h1, np.conj(yx)).real
    coherence = np.divide(explained, yy, out=np.zeros_like(yy), where=yy > 0.0)
    coherence = np.clip(coherence, 0.0, 1.0)
    response = h1
    if estimator == "H2" or (estimator == "Hv" and q == 1):
        response = _one_input(
            h1, xx[:, :, 0].real, yx[:, :, 0], yy, coherence, estimator, noise_ratio
        )
    elif estimator == "Hv":
        response = _smallest(xx, yx, yy, noise_ratio)
    n = spectra.averages
    if n <= q:
        return response, None, None
    left = np.maximum(yy - explained, 0.0) / (n - q)
    variance = left[:, :, None] * np.einsum("kii->ki", inverse).real[:, None, :]
    if q == 1 and estimator != "H1":
        # the share of the power, which is the same for H1 and H2
        factor = 0.5 * (1.0 + coherence) if estimator == "Hv" and noise_ratio is None else 1.0
        share = _ratio(np.abs(response[:, :, 0]) ** 2, np.abs(h1[:, :, 0]) ** 2)
        variance = variance * (factor * share)[:, :, None]
    return response, variance, coherence


def _ratio(a: Array, b: Array) -> Array:
    return np.divide(a, b, out=np.ones_like(a), where=b > 0.0)


def _one_input(
    h1: Complex,
    xx: Array,
    yx: Complex,
    yy: Array,
    coherence: Array,
    estimator: Estimator,
    noise_ratio: float | None,
) -> Complex:
    """H2 or Hv where there is one input."""
    if np.any(coherence == 0.0):
        raise RecordError(
            f"{estimator} has no value where input and output have nothing in common: take H1, or "
            "a band in which the input excites"
        )
    h = h1[:, :, 0]
    if estimator == "H2":
        return (h / coherence)[:, :, None]
    if noise_ratio is None:
        return (h / np.sqrt(coherence))[:, :, None]
    # the larger root of the quadratic, in the form that does not cancel
    b = yy - noise_ratio * xx
    root = np.sqrt(b**2 + 4.0 * noise_ratio * np.abs(yx) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(
            b >= 0.0, (b + root) / (2.0 * np.conj(yx)), 2.0 * noise_ratio * yx / (root - b)
        )
    return value[:, :, None]


def _inverse(xx: Complex) -> Complex:
    """Inverse of the spectral matrices of the inputs, having made sure that they differ."""
    power = np.einsum("kii->ki", xx).real
    scale = 1.0 / np.sqrt(power)
    inverse = np.linalg.inv(_regular(xx * scale[:, :, None] * scale[:, None, :]))
    # 1 - 1 / (R^-1)_ii is the share of input i that the others explain
    shared = 1.0 - 1.0 / np.einsum("kii->ki", inverse).real
    worst = np.median(shared, axis=0)
    if worst.max() > _CORRELATED:
        raise _correlated(int(worst.argmax()), float(worst.max()))
    return inverse * scale[:, :, None] * scale[:, None, :]


def _regular(coherence: Complex) -> Complex:
    least = np.linalg.eigvalsh(coherence)[:, 0]
    if least.min() < 1e-12:
        raise _correlated(None, 1.0)
    return coherence


def _correlated(number: int | None, share: float) -> RecordError:
    which = "an input" if number is None else f"input {number + 1}"
    return RecordError(
        f"the inputs cannot be separated: the others explain {100.0 * share:.3g} % of the power "
        f"of {which}; drive them by signals of their own, or one after the other, with at least as "
        "many averages as inputs"
    )


def _smallest(xx: Complex, yx: Complex, yy: Array, noise_ratio: float | None) -> Complex:
    """Total least squares with several inputs, output by output."""
    lines, outputs, q = yx.shape
    response = np.empty((lines, outputs, q), dtype=np.complex128)
    power = np.einsum("kii->ki", xx).real
    for o in range(outputs):
        whole = np.empty((lines, q + 1, q + 1), dtype=np.complex128)
        whole[:, :q, :q], whole[:, q, q] = xx, yy[:, o]
        whole[:, q, :q], whole[:, :q, q] = yx[:, o], np.conj(yx[:, o])
        noise = np.ones((lines, q + 1))
        if noise_ratio is None:
            noise = np.concatenate((power, yy[:, o : o + 1]), axis=1)
        else:
            noise[:, q] = noise_ratio
        d = np.sqrt(noise)
        vectors = np.linalg.eigh(whole / (d[:, :, None] * d[:, None, :]))[1][:, :, 0]
        conjugate = np.conj(vectors)
        response[:, o] = -conjugate[:, :q] / conjugate[:, q:] * d[:, q:] / d[:, :q]
    return response
