"""Damped sines with offset and drift, fitted to samples with the amplitudes projected out."""

from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.errors import ConvergenceError

_ITERATIONS = 60
# how many times its time constant a motion may grow in the record: noise makes no decay grow more
_GROWTH = 3.0


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
                and np.all(trial_theta[::2] * t[-1] > -_GROWTH)
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
