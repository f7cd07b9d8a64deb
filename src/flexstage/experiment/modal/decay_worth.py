"""What the poles of a free decay are worth, in noise of the colour that the residual has."""

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.experiment.modal.decay_model import DecayFit

# lines of the residual's periodogram that are averaged: no fewer, no more, and share of all
_FEWEST, _MOST, _SHARE = 24, 400, 32


def decay_covariance(fit: DecayFit, mode: int) -> tuple[Array, float]:
    """Return the covariance of a mode's pole and amplitudes.

    The error of each is a weighted sum of the noise. Its variance is the sum over frequency of the
    squared transform of the weights times the noise's spectral density, which is the residual's
    periodogram averaged over some lines, over what the fit has left of white noise there. Channels
    may share noise: cross spectra are in it. It is that of decay rate, damped angular frequency,
    and real and imaginary part of the amplitude of each channel in turn; the number is its degrees
    of freedom.
    """
    count = fit.residual.shape[1]
    free = fit.orthogonal() * fit.weights[:, None, None]
    square = np.einsum("cnp,cnq->pq", free, free)
    inverse = np.linalg.pinv(square, hermitian=True)
    # influence of each sample of each channel on theta, shape (c, n, p)
    on_theta = (free @ inverse) * fit.weights[:, None, None]
    own = slice(2 * mode, 2 * mode + 2)
    influence = np.zeros((count, fit.residual.shape[0], 2 + 2 * count))
    influence[:, :, :2] = on_theta[:, :, own]
    for c in range(count):
        follow = fit.inverse[:, own].T @ fit.jacobian[c]
        at = slice(2 + 2 * c, 4 + 2 * c)
        influence[:, :, at] = -on_theta @ follow.T
        influence[c, :, at] += fit.inverse[:, own]
    lines = np.fft.rfft(influence, axis=1)
    density, width = _density(fit, free)
    # lines but the first, and the last of an even number, stand for two
    twice = np.full(lines.shape[1], 2.0)
    twice[0] = 1.0
    if fit.residual.shape[0] % 2 == 0:
        twice[-1] = 1.0
    covariance = np.zeros((influence.shape[2],) * 2)
    for a in range(count):
        for b in range(count):
            weighted = lines[b] * (density[a, b] * twice)[:, None]
            covariance += (lines[a].conj().T @ weighted).real
    covariance /= fit.residual.shape[0] ** 2
    # lines that a mode's pole rests on, each of two degrees of freedom
    power = _moving_mean(np.sum(np.abs(lines[:, :, :2]) ** 2, axis=(0, 2)), width)
    freedom = 2.0 * float(power.sum() ** 2 / np.sum(power**2))
    return 0.5 * (covariance + covariance.T), freedom


def noise_ratios(fit: DecayFit, rate: float) -> Array:
    """Return by how much each mode lowers the sum of squares, over the noise near its frequency.

    Near 2 (1 + channels) for what is noise itself. `rate` is in the unit of time of the fit.
    """
    size, count = fit.residual.shape
    density, _ = _density(fit, fit.orthogonal() * fit.weights[:, None, None])
    at = np.round(fit.theta[1::2] / (2.0 * np.pi) * size / rate).astype(int)
    at = np.clip(at, 0, density.shape[2] - 1)
    scale = np.outer(fit.weights, fit.weights)
    falls = fit.falls() * scale
    noise = density[:, :, at].real.transpose(2, 0, 1) * scale / size
    # what rounding leaves, or two equal channels, are no measure of noise
    noise = noise + (1e-30 * falls.max() + 1e-9 * noise.max()) * np.eye(count)
    return np.einsum("rab,rba->r", np.linalg.inv(noise), falls)


def _width(lines: int) -> int:
    return int(np.clip(lines // _SHARE, min(_FEWEST, lines // 2), _MOST))


def _density(fit: DecayFit, free: Array) -> tuple[Complex, int]:
    """Return auto and cross spectra of the noise, shape (c, c, lines), and lines averaged."""
    size, count = fit.residual.shape
    residual = np.fft.rfft(fit.residual, axis=0).T
    width = _width(residual.shape[1])
    # share of white noise that functions and poles take away from each line
    taken = np.sum(np.abs(np.fft.rfft(fit.functions, axis=0)) ** 2, axis=1) / size
    left = np.empty((count, residual.shape[1]))
    stacked = free.reshape(-1, free.shape[2])
    unit = np.linalg.qr(stacked)[0].reshape(free.shape)
    for c in range(count):
        poles = np.sum(np.abs(np.fft.rfft(unit[c], axis=0)) ** 2, axis=1) / size
        left[c] = _moving_mean(np.maximum(1.0 - taken - poles, 0.01), width)
    density = np.empty((count, count, residual.shape[1]), dtype=np.complex128)
    for a in range(count):
        for b in range(count):
            both = _moving_mean(residual[a] * residual[b].conj(), width)
            density[a, b] = both / np.sqrt(left[a] * left[b])
    return density, width


def _moving_mean(values: Array, width: int) -> Array:
    """Average over a number of lines, fewer at the ends."""
    half = width // 2
    total = np.concatenate([np.zeros(1, dtype=values.dtype), np.cumsum(values)])
    low = np.maximum(np.arange(values.size) - half, 0)
    high = np.minimum(np.arange(values.size) + half + 1, values.size)
    return (total[high] - total[low]) / (high - low)
