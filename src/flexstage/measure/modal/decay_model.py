"""Damped sines with offset and drift, fitted to samples, and the covariance of their poles."""

from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ConvergenceError
from flexstage.measure.modal.prepare import moving_mean

# lines of the residual's periodogram that are averaged: no fewer, no more, and share of all
_FEWEST, _MOST, _SHARE = 24, 400, 32
_ITERATIONS = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecayFit:
    """Damped sines at given poles."""

    theta: Array
    """Decay rate and damped angular frequency of each, in turn, per unit of time, shape (p,)."""
    functions: Array
    """Orthonormal basis of what amplitudes, offset and drift can follow, shape (n, q)."""
    inverse: Array
    """Transposed pseudo-inverse of the functions, shape (n, q)."""
    factors: Array
    """Amplitudes, real and imaginary part of each mode, then offset and drift, shape (q, c)."""
    residual: Array
    """Measured less fitted, shape (n, c)."""
    jacobian: Array
    """Derivatives of the model by theta, shape (c, n, p)."""
    weights: Array
    """What the error of each channel counts, shape (c,)."""

    @property
    def total(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum((self.residual * self.weights) ** 2))

    def orthogonal(self) -> Array:
        """Return the derivatives without what the amplitudes can follow, shape (c, n, p)."""
        inside = self.functions @ (self.functions.T @ self.jacobian)
        return self.jacobian - inside

    def falls(self) -> Array:
        """Return by how much each mode lowers sums of squares, and of products of channels.

        With the poles of the others as they are, shape (modes, c, c).
        """
        square = self.inverse.T @ self.inverse
        count = self.factors.shape[1]
        out = np.empty((self.theta.size // 2, count, count))
        for r in range(out.shape[0]):
            own = slice(2 * r, 2 * r + 2)
            out[r] = self.factors[own].T @ np.linalg.solve(square[own, own], self.factors[own])
        return out


def project_decay(theta: Array, t: Array, values: Array, weights: Array) -> DecayFit:
    """Fit amplitudes, offset and drift at given poles.

    v_c = Re(sum_r A_rc exp((-sigma_r + i omega_r) t)) + a_c + b_c t. theta holds sigma and omega of
    each mode in turn, t starts at 0, values have shape (n, c).
    """
    sigma, omega = theta.reshape(-1, 2).T
    wave: Complex = np.exp(t[:, None] * np.asarray(-sigma + 1j * omega, dtype=np.complex128))
    columns = np.empty((t.size, theta.size + 2))
    columns[:, :-2:2], columns[:, 1:-2:2] = wave.real, -wave.imag
    columns[:, -2], columns[:, -1] = 1.0, t / t[-1] - 0.5
    scale = np.linalg.norm(columns, axis=0)
    q, r = np.linalg.qr(columns / scale)
    solver = np.linalg.pinv(r, rcond=1e-13)
    along = q.T @ values
    factors = solver @ along / scale[:, None]
    amplitudes = factors[:-2:2] + 1j * factors[1:-2:2]
    slope = t[:, None, None] * wave[:, :, None] * amplitudes[None, :, :]
    jacobian = np.empty((values.shape[1], t.size, theta.size))
    jacobian[:, :, ::2] = -slope.real.transpose(2, 0, 1)
    jacobian[:, :, 1::2] = -slope.imag.transpose(2, 0, 1)
    return DecayFit(
        theta=theta,
        functions=q,
        inverse=q @ (solver / scale[:, None]).T,
        factors=factors,
        residual=values - q @ along,
        jacobian=jacobian,
        weights=weights,
    )


def fit_decay(theta: Array, t: Array, values: Array, weights: Array) -> DecayFit:
    """Make the weighted sum of squares least over the poles (Levenberg 1944, Marquardt 1963)."""
    now = project_decay(theta, t, values, weights)
    damping = 1e-6
    # how many times its time constant a motion may grow in the record: noise makes no decay grow
    # more
    growth = 3.0
    for _ in range(_ITERATIONS):
        free = now.orthogonal() * weights[:, None, None]
        square = np.einsum("cnp,cnq->pq", free, free)
        gradient = np.einsum("cnp,nc->p", free, now.residual * weights)
        scale = np.sqrt(np.maximum(np.diagonal(square), 1e-300))
        scaled = square / np.outer(scale, scale)
        while True:
            step = np.linalg.solve(scaled + damping * np.eye(scale.size), gradient / scale) / scale
            largest = float(np.abs(step / np.repeat(now.theta[1::2], 2)).max())
            if largest <= 1e-13:
                return now
            trial_theta = now.theta + step
            if (
                np.all(np.abs(step[1::2]) < 0.3 * now.theta[1::2])
                and np.all(trial_theta[::2] < 3.0 * trial_theta[1::2])
                and np.all(trial_theta[::2] * t[-1] > -growth)
            ):
                trial = project_decay(trial_theta, t, values, weights)
                if trial.total <= now.total:
                    break
                if largest <= 1e-9:
                    return now
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e12:
                return now
        small = now.total - trial.total <= 1e-11 * now.total and largest <= 1e-7
        now = trial
        damping = max(0.1 * damping, 1e-14)
        if small:
            return now
    raise ConvergenceError(
        f"the fit of {theta.size // 2} damped sines did not settle in {_ITERATIONS} iterations: "
        "fit fewer modes, or give the start of the decay"
    )


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
    power = moving_mean(np.sum(np.abs(lines[:, :, :2]) ** 2, axis=(0, 2)), width)
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


def _density(fit: DecayFit, free: Array) -> tuple[Complex, int]:
    """Return auto and cross spectra of the noise, shape (c, c, lines), and lines averaged."""
    size, count = fit.residual.shape
    residual = np.fft.rfft(fit.residual, axis=0).T
    lines = residual.shape[1]
    width = int(np.clip(lines // _SHARE, min(_FEWEST, lines // 2), _MOST))
    # share of white noise that functions and poles take away from each line
    taken = np.sum(np.abs(np.fft.rfft(fit.functions, axis=0)) ** 2, axis=1) / size
    left = np.empty((count, residual.shape[1]))
    stacked = free.reshape(-1, free.shape[2])
    unit = np.linalg.qr(stacked)[0].reshape(free.shape)
    for c in range(count):
        poles = np.sum(np.abs(np.fft.rfft(unit[c], axis=0)) ** 2, axis=1) / size
        left[c] = moving_mean(np.maximum(1.0 - taken - poles, 0.01), width)
    density = np.empty((count, count, residual.shape[1]), dtype=np.complex128)
    for a in range(count):
        for b in range(count):
            both = moving_mean(residual[a] * residual[b].conj(), width)
            density[a, b] = both / np.sqrt(left[a] * left[b])
    return density, width
