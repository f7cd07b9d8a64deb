r"""Drives whose stage softens with the level of the force in the stacks, in steady state.

.. math:: y = G (u + s), \qquad w = A u + G_e (u + s), \qquad
          G_e = \sum_i \mu_i\, b_i b_i^T h_i(z)

with voltages u, readings y, and a quantity w of each stack that behaves like its force. The
response :math:`h_i` is that of a mode of unit static gain, exact for inputs that are straight
between the samples. The additional voltage of stack j,

.. math:: s_j = c_j (\sigma_j^p - \bar\sigma_j^p)\, w_j
          + g(z) (\sigma_{u,j}^q - \bar\sigma_{u,j}^q)\, u_j,

follows from slow levels: the rms :math:`\sigma_j` of w and :math:`\sigma_{u,j}` of u. Its mean over
the records is zero, so that G is the linear system at the mean level.

Source: structure and starting values from trials on the records of M. Floren and others (ISMA-USD
2024, 2042); the levels act like the slow dynamics of ceramics and contacts.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.base.progress import update
from flexstage.hysteresis.coupled_drives.periodic import PeriodicSpectra, best_linear
from flexstage.hysteresis.coupled_drives.state_space import IdentifiedModes

#: Exponent q of the level of the voltage: weakly determined by broad-band records.
VOLTAGE_EXPONENT = 0.8
#: Corners of the two lags in g [Hz]: the gain falls from 20 to 500 Hz as that of plays does.
MEMORY_CORNERS_HZ = (30.0, 300.0)


@dataclass(frozen=True, slots=True)
class _Scale:
    """What a unit step of a parameter is: the spread that modes of one linear fit have."""

    frequency: float = 0.003
    damping: float = 0.1
    shape: float = 0.1
    penalty: float = 1e-4
    """Weight of the square of such a step, in units of the weighted mean square residual."""
    exponents: tuple[float, float] = (0.05, 2.0)
    """Exponents of the level that the search tries; measured ones are 0.3 to 0.8."""
    smallest_gain: float = 1e-4
    """The search ends where a step lowers the residual by less than this part."""


_SCALE = _Scale()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Softening:
    """Parameters of the drives; M modes, m stacks."""

    compliance: Array
    """Compliance of each mode at the stacks, times the strength, at least 0, shape (M,)."""
    force_gains: Array
    """Gains A from voltages to w, shape (m, m)."""
    strength: Array
    """Strength c of the softening of each stack, shape (m,)."""
    exponent: float
    """Exponent p of the level of w."""
    memory_gains: Array
    """Gains of g: direct, and of each lag, shape (3,)."""
    frequency_hz: Array
    """Natural frequencies of the modes at the mean level [Hz], shape (M,)."""
    damping_ratio: Array
    """Their damping ratios [1], shape (M,)."""
    input_shapes: Array
    """Their input vectors, shape (M, m)."""
    force_reference: Array
    """Mean of the p-th power of the level of w, shape (m,)."""
    voltage_reference: Array
    """Mean of the q-th power of the level of u, shape (m,)."""

    def vector(self, modes: bool) -> Array:
        """Return the parameters that a fit changes; `modes` adds steps of modes, all zero."""
        parts = [
            self.compliance, self.force_gains.ravel(), self.strength, [self.exponent],
            self.memory_gains,
        ]  # fmt: skip
        steps = self.compliance.size * (2 + self.strength.size) if modes else 0
        return np.concatenate([*parts, np.zeros(steps)])

    def moved(self, vector: Array) -> "Softening":
        """Return the parameters of a vector, whose steps of modes count from those here."""
        k, m = self.compliance.size, self.strength.size
        sizes = [k, m * m, m, 1, 3]
        mu, a, c, p, g, steps = np.split(vector, np.cumsum(sizes))
        moved = replace(
            self,
            compliance=mu,
            force_gains=a.reshape(m, m),
            strength=c,
            exponent=float(p[0]),
            memory_gains=g,
        )
        if steps.size == 0:
            return moved
        frequency, damping, shapes = np.split(steps, [k, 2 * k])
        return replace(
            moved,
            frequency_hz=self.frequency_hz * (1.0 + _SCALE.frequency * frequency),
            damping_ratio=self.damping_ratio * (1.0 + _SCALE.damping * damping),
            input_shapes=self.input_shapes + _SCALE.shape * shapes.reshape(k, m),
        )


def starting_values(modes: IdentifiedModes, spectra: PeriodicSpectra) -> Softening:
    """Return generic values from which the fit begins, with modes of a linear fit."""
    m = spectra.inputs.shape[2]
    return Softening(
        compliance=np.full(modes.frequency_hz.size, 0.05),
        force_gains=-0.33 * np.eye(m),
        strength=np.full(m, 0.77),
        exponent=0.6,
        memory_gains=np.full(3, 0.05),
        frequency_hz=modes.frequency_hz,
        damping_ratio=modes.damping_ratio,
        input_shapes=modes.input_shapes,
        force_reference=np.zeros(m),
        voltage_reference=np.mean(rms_levels(spectra.inputs) ** VOLTAGE_EXPONENT, axis=0),
    )


def rms_levels(spectra: Complex) -> Array:
    """Return the rms of each channel over the lines, shape (R, m)."""
    return np.sqrt(np.sum(np.abs(spectra) ** 2, axis=1))


def straight_gains(
    pole: NDArray[Any], step: float
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return how a state x' = pole x + u is stepped for a u that is straight between samples.

    The factors e, b, d of ``x[k+1] = e x[k] + b u[k] + d u[k+1]``.
    """
    e = np.exp(pole * step)
    after = (e - 1.0 - pole * step) / (pole**2 * step)
    return e, (e - 1.0) / pole - after, after


def mode_poles(frequency_hz: Array, damping_ratio: Array) -> tuple[Complex, Complex]:
    """Return the upper pole of each mode [1/s], and its residue at unit static gain."""
    omega = 2.0 * np.pi * frequency_hz
    pole = omega * (-damping_ratio + 1j * np.sqrt(1.0 - damping_ratio**2))
    return pole, omega**2 / (2j * pole.imag)


def _straight_responses(pole: NDArray[Any], z: Complex, step: float) -> Complex:
    """Return the responses of states that inputs drive that are straight between the samples."""
    e, before, after = straight_gains(pole[:, None], step)
    return (before + after * z) / (z - e)


def mode_responses(frequency_hz: Array, damping_ratio: Array, z: Complex, step: float) -> Complex:
    """Return the response of modes of unit static gain, shape (M, L)."""
    pole, residue = mode_poles(frequency_hz, damping_ratio)
    upper = residue[:, None] * _straight_responses(pole, z, step)
    return upper + np.conj(residue[:, None] * _straight_responses(pole, np.conj(z), step))


def memory_responses(z: Complex, step: float) -> Complex:
    """Return the three responses that g is made of: direct, and lags of unit gain, shape (3, L)."""
    pole = -2.0 * np.pi * np.array(MEMORY_CORNERS_HZ)
    return np.vstack((np.ones_like(z)[None], -pole[:, None] * _straight_responses(pole, z, step)))


@dataclass(slots=True, kw_only=True, eq=False)
class SteadyState:
    """What drives do in R records: all that the residual and its derivatives need."""

    responses: Complex
    """Responses of the modes, shape (M, L)."""
    elongation: Complex
    """G_e, shape (L, m, m)."""
    closed_loop: Complex
    """Inverse of 1 - G_e times the softening gains, shape (R, L, m, m)."""
    force: Complex
    """w, shape (R, L, m)."""
    total: Complex
    """u + s, shape (R, L, m)."""
    sigma: Array
    """Level of w, shape (R, m)."""
    gains: Array
    """Deviation of the p-th power of the level from its mean, shape (R, m)."""
    reference: Array
    """That mean, shape (m,)."""


def steady_state(
    drives: Softening,
    spectra: PeriodicSpectra,
    *,
    fitted: bool,
    sigma: Array | None = None,
    sweeps: int = 12,
) -> SteadyState:
    """Return the steady state of drives under the inputs of records.

    The loop through the modes is solved at each line; its levels by fixed-point sweeps, as a level
    depends little on itself. With `fitted`, the mean level is that of these records.
    """
    step, u = 1.0 / spectra.sample_rate_hz, spectra.inputs
    responses = mode_responses(drives.frequency_hz, drives.damping_ratio, spectra.z, step)
    b = drives.input_shapes
    elongation = np.einsum(
        "kl,ki,kj->lij", drives.compliance[:, None] * responses, b, b, optimize=True
    )
    memory = drives.memory_gains @ memory_responses(spectra.z, step)
    level = rms_levels(u) ** VOLTAGE_EXPONENT - drives.voltage_reference
    direct = (1.0 + memory[None, :, None] * level[:, None, :]) * u
    open_force = np.einsum("ij,rlj->rli", drives.force_gains, u) + np.einsum(
        "lij,rlj->rli", elongation, direct
    )
    sigma = rms_levels(open_force) if sigma is None else sigma
    eye = np.eye(u.shape[2])
    while True:
        power = sigma**drives.exponent
        reference = power.mean(0) if fitted else drives.force_reference
        gains = power - reference
        loop = eye - elongation * (drives.strength * gains)[:, None, None, :]
        closed_loop = np.linalg.inv(loop)
        force = np.einsum("rlij,rlj->rli", closed_loop, open_force)
        before, sigma = sigma, rms_levels(force)
        sweeps -= 1
        if sweeps == 0 or np.max(np.abs(sigma / before - 1.0)) < 1e-7:
            break
    total = direct + (drives.strength * gains)[:, None, :] * force
    return SteadyState(
        responses=responses,
        elongation=elongation,
        closed_loop=closed_loop,
        force=force,
        total=total,
        sigma=sigma,
        gains=gains,
        reference=reference,
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Point:
    """A point of the search: parameters, steady state, linear system, residuals."""

    drives: Softening
    state: SteadyState
    response: Complex
    residuals: Complex
    cost: float


class SofteningFit:
    """Variable projection: the linear system G is eliminated line by line at each evaluation.

    Levenberg–Marquardt on the other parameters, with exact derivatives through the loop, its levels
    and their mean.
    """

    def __init__(self, spectra: PeriodicSpectra, weights: Array) -> None:
        self._spectra = spectra
        self._weights = weights
        self._count = spectra.outputs.shape[0] * spectra.outputs.shape[2]

    def fit(self, start: Softening, *, modes: bool, iterations: int) -> _Point:
        """Return the best point; `modes` fits frequencies, damping and input vectors as well."""
        vector = start.vector(modes)
        free = start.vector(False).size
        penalty = np.where(np.arange(vector.size) < free, 0.0, _SCALE.penalty)
        point = self._point(start.moved(vector), None)
        cost, damping, k = point.cost, 1e-3, start.compliance.size
        power = k + start.force_gains.size + start.strength.size
        for number in range(iterations):
            update("softening of the drives", number / iterations)
            jacobian = self._jacobian(start, point, modes).view(np.float32)
            residual = np.moveaxis(point.residuals * self._weights[:, None, None], 0, -1)
            residual = residual.reshape(-1).astype(np.complex64).view(np.float32)
            normal = (jacobian @ jacobian.T).astype(float) / self._count + np.diag(penalty)
            slope = (jacobian @ residual).astype(float) / self._count + penalty * vector
            moving = np.flatnonzero((vector > 0.0) | (slope < 0.0) | (np.arange(vector.size) >= k))
            for _ in range(8):
                damped = normal + damping * np.diag(np.diag(normal) + 1e-9)
                trial = vector.copy()
                trial[moving] -= np.linalg.solve(damped[np.ix_(moving, moving)], slope[moving])
                trial[:k] = np.maximum(trial[:k], 0.0)
                trial[power] = np.clip(trial[power], *_SCALE.exponents)
                candidate = self._point(start.moved(trial), point.state.sigma)
                gain = cost - candidate.cost - float(penalty @ trial**2)
                if gain > 0.0:
                    break
                damping *= 4.0
            else:
                return point
            cost, vector, point = cost - gain, trial, candidate
            damping = max(damping / 5.0, 1e-7)
            if gain < _SCALE.smallest_gain * cost:
                break
        return point

    def _point(self, drives: Softening, sigma: Array | None) -> _Point:
        state = steady_state(drives, self._spectra, fitted=True, sigma=sigma)
        response, residuals = best_linear(state.total, self._spectra.outputs, self._weights)
        weighted = residuals * self._weights[:, None, None]
        return _Point(
            drives=replace(drives, force_reference=state.reference),
            state=state,
            response=response,
            residuals=residuals,
            cost=float(np.sum(np.abs(weighted) ** 2)) / self._count,
        )

    def _jacobian(self, start: Softening, point: _Point, modes: bool) -> NDArray[np.complex64]:
        """Return the derivatives of the weighted residuals, G eliminated, shape (P, L p R)."""
        state, drives = point.state, point.drives
        records, lines, m = state.total.shape
        size = start.vector(modes).size
        outputs = point.residuals.shape[2]
        derivatives = np.empty((size, records, lines, outputs), np.complex64)
        by_gain = np.empty((records, lines, outputs, m), complex)
        loops = np.empty((records, m, m))
        directs = np.empty((records, m, size))
        for r in range(records):
            force = state.force[r]
            d_force, d_extra = self._explicit(start, point, r, modes)
            d_force = np.einsum("lij,plj->pli", state.closed_loop[r], d_force, optimize=True)
            # what a change of each gain does
            forced = drives.strength * force
            d_gain = (state.closed_loop[r] @ state.elongation) * forced[:, None, :]
            loops[r] = np.einsum("li,lij->ij", np.conj(force), d_gain).real
            loops[r] /= state.sigma[r][:, None]
            directs[r] = np.einsum("li,pli->ip", np.conj(force), d_force).real
            directs[r] /= state.sigma[r][:, None]
            gains = drives.strength * state.gains[r]
            extra = gains[:, None] * d_gain
            extra[:, range(m), range(m)] += forced
            weighted = -point.response * self._weights[r]
            by_gain[r] = weighted @ extra
            d_total = d_extra + gains * d_force
            derivatives[:, r] = np.einsum("lij,plj->pli", weighted, d_total, optimize=True)
        d_gains = _level_derivatives(drives.exponent, state.sigma, loops, directs)
        for r in range(records):
            derivatives[:, r] += np.einsum("lij,jp->pli", by_gain[r], d_gains[r], optimize=True)
        # less what the eliminated G takes up
        x = np.moveaxis(state.total, 0, -1) * self._weights
        x_h = np.conj(np.swapaxes(x, 1, 2))
        inverse = np.linalg.inv(x @ x_h).astype(np.complex64)
        by_line = derivatives.transpose(2, 0, 3, 1).reshape(lines, -1, records)
        by_line -= ((by_line @ x_h.astype(np.complex64)) @ inverse) @ x.astype(np.complex64)
        shaped = by_line.reshape(lines, size, outputs, records).transpose(1, 0, 2, 3)
        return np.ascontiguousarray(shaped).reshape(size, -1)

    def _explicit(
        self, start: Softening, point: _Point, r: int, modes: bool
    ) -> tuple[Complex, Complex]:
        """Return derivatives of w and s at constant levels and w, by parameter, shape (P, L, m)."""
        spectra, state, drives = self._spectra, point.state, point.drives
        u, force, total = spectra.inputs[r], state.force[r], state.total[r]
        lines, m = u.shape
        k = drives.compliance.size
        d_force = np.zeros((start.vector(modes).size, lines, m), complex)
        d_extra = np.zeros_like(d_force)
        b, h = drives.input_shapes, state.responses
        projected = total @ b.T
        d_force[:k] = (h * projected.T)[:, :, None] * b[:, None, :]
        at = k
        for i in range(m):
            d_force[at : at + m, :, i] = u.T
            at += m
        d_extra[range(at, at + m), :, range(m)] = (state.gains[r] * force).T
        at += m
        power = state.sigma**drives.exponent * np.log(state.sigma)
        d_extra[at] = drives.strength * (power[r] - power.mean(0)) * force
        at += 1
        level = rms_levels(spectra.inputs)[r] ** VOLTAGE_EXPONENT - drives.voltage_reference
        memory = memory_responses(spectra.z, 1.0 / spectra.sample_rate_hz)
        d_extra[at : at + 3] = memory[:, :, None] * (level * u)
        at += 3
        d_force += np.einsum("lij,plj->pli", state.elongation, d_extra, optimize=True)
        if modes:
            self._modes(start, point, projected, total, d_force[at:])
        return d_force, d_extra

    def _modes(
        self, start: Softening, point: _Point, projected: Complex, total: Complex, d_force: Complex
    ) -> None:
        """Put in what steps of frequency, damping and input vectors do to w."""
        drives, h = point.drives, point.state.responses
        b, mu = drives.input_shapes, drives.compliance
        f, zeta = drives.frequency_hz, drives.damping_ratio
        z, step = self._spectra.z, 1.0 / self._spectra.sample_rate_hz
        k, m = b.shape
        small = 1e-6
        d_f = (mode_responses(f * (1.0 + small), zeta, z, step) - h) / (small * f[:, None])
        d_zeta = (mode_responses(f, zeta * (1.0 + small), z, step) - h) / (small * zeta[:, None])
        for n, (slope, unit) in enumerate(
            (
                (d_f, _SCALE.frequency * start.frequency_hz),
                (d_zeta, _SCALE.damping * start.damping_ratio),
            )
        ):
            scaled = (mu * unit)[:, None] * slope * projected.T
            d_force[n * k : (n + 1) * k] = scaled[:, :, None] * b[:, None, :]
        for i in range(k):
            gain = _SCALE.shape * mu[i] * h[i]
            for j in range(m):
                change = (gain * total[:, j])[:, None] * b[i]
                change[:, j] += gain * projected[:, i]
                d_force[2 * k + i * m + j] = change


def _level_derivatives(exponent: float, sigma: Array, loops: Array, directs: Array) -> Array:
    """Return derivatives of the gains, whose mean over the records stays 0, shape (R, m, P).

    `loops` say what gains do to levels, `directs` what parameters do to levels at constant gains.
    """
    records, m, size = directs.shape
    slope = exponent * sigma ** (exponent - 1.0)
    system = np.eye(records * m).reshape(records, m, records, m)
    for r in range(records):
        for other in range(records):
            share = (r == other) - 1.0 / records
            system[r, :, other, :] -= loops[r] * (share * slope[other])
    flat = np.linalg.solve(system.reshape(records * m, -1), directs.reshape(records * m, size))
    by_level = slope[:, :, None] * flat.reshape(records, m, size)
    return by_level - by_level.mean(0)
