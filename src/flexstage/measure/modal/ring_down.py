"""Modes from a free decay: frequencies, damping and shapes without a measured force."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ConvergenceError, ModelError, RecordError
from flexstage.measure.modal.mode_selection import distinct
from flexstage.measure.modal.prepare import moving_mean
from flexstage.measure.modal.result import noisy_estimate, shape_from_residues
from flexstage.quantities.estimate import Estimate
from flexstage.records import Record, step_uncertainty
from flexstage.records.sampling import require_complete, require_uniform

# samples of a window of the subspace, at most, and windows that are summed
_WINDOW = 360
_SHIFTS = 8000
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
            columns = slice(2 * r, 2 * r + 2)
            out[r] = self.factors[columns].T @ np.linalg.solve(
                square[columns, columns], self.factors[columns]
            )
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
        f"the fit of {theta.size // 2} damped sines did not converge in {_ITERATIONS} iterations: "
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
    columns = slice(2 * mode, 2 * mode + 2)
    influence = np.zeros((count, fit.residual.shape[0], 2 + 2 * count))
    influence[:, :, :2] = on_theta[:, :, columns]
    for c in range(count):
        follow = fit.inverse[:, columns].T @ fit.jacobian[c]
        at = slice(2 + 2 * c, 4 + 2 * c)
        influence[:, :, at] = -on_theta @ follow.T
        influence[c, :, at] += fit.inverse[:, columns]
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
    absorbed = np.sum(np.abs(np.fft.rfft(fit.functions, axis=0)) ** 2, axis=1) / size
    left = np.empty((count, residual.shape[1]))
    stacked = free.reshape(-1, free.shape[2])
    unit = np.linalg.qr(stacked)[0].reshape(free.shape)
    for c in range(count):
        poles = np.sum(np.abs(np.fft.rfft(unit[c], axis=0)) ** 2, axis=1) / size
        left[c] = moving_mean(np.maximum(1.0 - absorbed - poles, 0.01), width)
    density = np.empty((count, count, residual.shape[1]), dtype=np.complex128)
    for a in range(count):
        for b in range(count):
            both = moving_mean(residual[a] * residual[b].conj(), width)
            density[a, b] = both / np.sqrt(left[a] * left[b])
    return density, width


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecayMode:
    """A mode seen in a free decay."""

    frequency_hz: Estimate
    """Undamped natural frequency [Hz]."""
    damping_ratio: Estimate
    """Damping as a share of the critical [1]."""
    amplitudes: Complex
    """Complex amplitude of each channel at the start of the decay, in its unit, shape (channels,).
    """
    shape: Complex
    """Amplitudes over that of the channel that moves most [1], shape (channels,)."""
    shape_uncertainty: Array
    """Standard uncertainty of its real and imaginary part [1], shape (channels, 2)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RingDown:
    """Modes that were fitted to a free decay."""

    modes: tuple[DecayMode, ...]
    """The modes, rising in frequency; none where nothing stands out of the noise."""
    channels: tuple[str, ...]
    """Names of the channels."""
    start: float
    """When the decay begins, in the time of the record [s]."""
    time: Array
    """Times of the samples that were fitted [s], shape (n,)."""
    measured: Array
    """Those samples, in the units of the channels, shape (n, channels)."""
    fitted: Array
    """The model at those samples, in the units of the channels, shape (n, channels)."""
    averaged: int
    """How many samples of the record are averaged in each."""
    residual_rms: Array
    """Root mean square of measured less fitted, shape (channels,)."""
    notes: tuple[str, ...]
    """What a reader should know."""


def ring_down(
    record: Record,
    channels: Sequence[str | int] | str | int,
    *,
    start: float | None = None,
    count: int | None = None,
) -> RingDown:
    """Fit damped sines to the free decay after a release, a hit or the end of a step.

    Each channel is a sum of A_r exp(-zeta_r w_r t) cos(w_r sqrt(1 - zeta_r^2) t + phi_r), with an
    offset and a drift. A subspace of the samples (Juang and Pappa, 1985) is the start; from there
    poles, which all channels share, are those of least squares, with amplitudes projected out
    (Golub and Pereyra, 1973). Covariances are those of the linearised fit, with the spectral
    density that the residual has near each mode, so that coloured noise counts where it is.

    Parameters
    ----------
    record : Record
        The record, evenly sampled.
    channels : sequence of str or int, or one
        Its channels, by name or number.
    start : float, optional
        When the decay begins, in the time of the record [s]; found where not given, from the
        largest motion at the frequency that stands out most.
    count : int, optional
        Number of modes; those that noise does not explain where not given (Schwarz 1978).

    Returns
    -------
    RingDown
        Modes, each with its uncertainty.

    Validity
    --------
    No force after the start; damping proportional to velocity, as friction gives no exponential.
    A tone from outside, as of the mains, is a mode that does not decay. Samples are averaged until
    about 12 are left in a period of the highest mode, which leaves poles as they are. Uncertainties
    contain noise alone.

    Raises
    ------
    RecordError
        The record is not evenly sampled, not complete, constant, or too short.
    ModelError
        An option is impossible, or fewer poles are found than modes were asked for.
    ConvergenceError
        The fit did not converge.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> t = np.arange(4000) / 5000.0
    >>> y = 0.3 + np.where(t < 0.1, 1.0, np.exp(-6.3 * (t - 0.1)) * np.cos(403.0 * (t - 0.1)))
    >>> y += 0.005 * np.random.default_rng(4).standard_normal(t.size)
    >>> record = Record(channels=(Channel(name="table", values=y, unit="m"),), time=t)
    >>> (mode,) = ring_down(record, "table").modes
    >>> print(f"{mode.frequency_hz.value:.2f} Hz, {100 * mode.damping_ratio.value:.2f} %")
    64.15 Hz, 1.56 %
    """
    names = [channels] if isinstance(channels, str | int) else list(channels)
    if not names:
        raise ModelError("a ring-down needs at least one channel, got none")
    if count is not None and count < 1:
        raise ModelError(f"the number of modes must be 1 or more, got {count!r}")
    columns = [record.channel(name) for name in names]
    t, values, rate = _samples(record, [c.values for c in columns], [c.name for c in columns])
    if start is None:
        first = decay_start(values, rate)
    elif t[0] <= start <= t[-1]:
        first = int(np.searchsorted(t, start))
    else:
        raise ModelError(
            f"the start of a decay must lie in the record, from {t[0]:g} to {t[-1]:g} s, got "
            f"{start!r} s"
        )
    t, values = t[first:], values[first:]
    if t.size < 32:
        raise RecordError(
            f"a decay needs at least 32 samples, got {t.size} from {record.time[first]:g} s on: "
            "record for longer, or give the start"
        )
    begin = float(t[0])
    top = highest_frequency(values, rate)
    # samples in a period of the highest mode that are enough: more are averaged
    per_period = 12.0
    times = max(1, min(int(rate / (per_period * top)), t.size // 64))
    values = values[: t.size // times * times].reshape(-1, times, len(columns)).mean(axis=1)
    # from the middle of the first average
    offset = 0.5 * (times - 1) / rate
    clock = np.arange(values.shape[0]) * times / rate
    fit = _fitted(clock, values, rate / times, count)
    # all rates that the digits leave are as likely as the others
    share = step_uncertainty(record.time) / math.sqrt(3.0)
    modes = [_mode(r, fit, times, rate, share) for r in range(fit.theta.size // 2)] if fit else []
    residual = fit.residual if fit else values - values.mean(axis=0)
    return RingDown(
        modes=tuple(modes),
        channels=tuple(c.name for c in columns),
        start=begin,
        time=begin + offset + clock,
        measured=values,
        fitted=values - residual,
        averaged=times,
        residual_rms=np.sqrt(np.mean(residual**2, axis=0)),
        notes=tuple(_notes(modes, clock, start is None, begin)),
    )


def _samples(
    record: Record, columns: Sequence[Array], names: Sequence[str]
) -> tuple[Array, Array, float]:
    require_uniform(record)
    for column, name in zip(columns, names, strict=True):
        require_complete(column, name)
    for column, name in zip(columns, names, strict=True):
        if np.all(column == column[0]):
            raise RecordError(f"channel '{name}' is constant: is its sensor connected?")
    return record.time, np.stack(columns, axis=1), record.sample_rate_hz


def _fitted(clock: Array, values: Array, rate: float, count: int | None) -> DecayFit | None:
    """Fit as many modes as asked for, or as are significant."""
    level = values - values[-values.shape[0] // 4 :].mean(axis=0)
    weights = 1.0 / np.sqrt(np.mean(level**2, axis=0))
    # default number of modes to search for
    most = 8
    poles = subspace_poles(level * weights, rate, 2 * (most if count is None else count + 4) + 2)
    size = np.abs(poles) / (2.0 * math.pi)
    # with less than two periods, drift is motion as well
    poles = poles[(size >= 2.0 / clock[-1]) & (size <= 0.5 * rate)]
    poles = distinct(poles, np.arange(poles.size)[::-1].astype(np.float64))
    if count is not None and poles.size < count:
        raise ModelError(
            f"{count} modes were requested, but only {poles.size} decays found: request fewer"
        )
    theta = np.stack([-poles.real, poles.imag], axis=1).ravel()
    needed = (2 * values.shape[1] + 2) * math.log(values.size)
    least = 0 if count is None else count
    rough = True
    while theta.size:
        if rough:
            fit = project_decay(theta, clock, values, weights)
        else:
            try:
                fit = fit_decay(theta, clock, values, weights)
                fit = fit_decay(fit.theta, clock, values, _weights(fit))
            except ConvergenceError:
                # modes that are not there keep a fit from settling
                if theta.size <= 2 * least:
                    raise
                fit = project_decay(theta, clock, values, weights)
        weights, theta = _weights(fit), fit.theta
        strength = noise_ratios(fit, rate)
        weakest = int(np.argmin(strength))
        weak = strength[weakest] < (0.25 if rough else 1.0) * needed
        if theta.size > 2 * least and (weak or count is not None):
            theta = np.delete(theta, [2 * weakest, 2 * weakest + 1])
        elif rough:
            rough = False
        else:
            break
    if not theta.size:
        return None
    order = np.argsort(theta[1::2], kind="stable")
    return project_decay(theta.reshape(-1, 2)[order].ravel(), clock, values, weights)


def _weights(fit: DecayFit) -> Array:
    rms = np.sqrt(np.mean(fit.residual**2, axis=0))
    size = np.sqrt(np.mean(np.square(fit.factors), axis=0))
    return 1.0 / np.maximum(rms, 1e-13 * size)


def _mode(r: int, fit: DecayFit, times: int, rate: float, share: float) -> DecayMode:
    sigma, omega = fit.theta[2 * r : 2 * r + 2]
    size = math.hypot(sigma, omega)
    amplitudes = fit.factors[2 * r] + 1j * fit.factors[2 * r + 1]
    covariance, freedom = decay_covariance(fit, r)
    slopes = np.array(
        [
            [sigma / size / (2.0 * math.pi), omega / size / (2.0 * math.pi)],
            [omega * omega / size**3, -sigma * omega / size**3],
        ]
    )
    pair = np.sqrt(np.maximum(np.diagonal(slopes @ covariance[:2, :2] @ slopes.T), 0.0))
    shape, spread = shape_from_residues(amplitudes[:, None], covariance[2:, 2:])
    frequency = size / (2.0 * math.pi)
    return DecayMode(
        frequency_hz=noisy_estimate(frequency, float(pair[0]), "Hz", freedom, share * frequency),
        damping_ratio=noisy_estimate(sigma / size, float(pair[1]), "1", freedom),
        # of the first sample, not of the average that begins with it
        amplitudes=amplitudes / np.exp(complex(-sigma, omega) / rate * np.arange(times)).mean(),
        shape=shape,
        shape_uncertainty=spread,
    )


def _notes(
    modes: Sequence[DecayMode], clock: Array, is_default_start: bool, begin: float
) -> list[str]:
    notes = []
    if is_default_start:
        notes.append(f"the decay is assumed to begin at {begin:.6g} s")
    if not modes:
        notes.append("no mode exceeds the noise")
    for mode in modes:
        f, zeta = mode.frequency_hz.value, mode.damping_ratio.value
        if 2.0 * math.pi * f * zeta * clock[-1] < 0.2:
            notes.append(
                f"the motion at {f:.5g} Hz hardly decays in the record: it may be an external tone"
            )
    return notes


def highest_frequency(values: Array, rate: float) -> float:
    """Return the highest frequency that stands out in a record.

    In Hz; the strongest where none stands out.
    """
    frequency, ratio = _prominence(values, rate)
    # a line of a periodogram of noise alone is seldom this many times its surroundings, beyond the
    # logarithm of their number
    above = 3.0
    out = np.flatnonzero(ratio > above * math.log(ratio.size) / math.log(2.0))
    strong = np.flatnonzero(ratio > 1e-4 * ratio.max())
    both = np.intersect1d(out, strong)
    return float(frequency[both[-1] if both.size else int(np.argmax(ratio))])


def decay_start(values: Array, rate: float) -> int:
    """Return the sample from which a record decays freely.

    It is where the motion at the frequency that stands out most, seen through a window of two of
    its periods, is largest: a release, hit or step lies half a window before that.
    """
    frequency, ratio = _prominence(values, rate)
    tone = float(frequency[int(np.argmax(ratio))])
    size = values.shape[0]
    width = round(2.0 * rate / tone)
    if width < 4 or 4 * width > size:
        return 0
    turn = np.exp(-2j * math.pi * tone / rate * np.arange(size))[:, None]
    # what is constant over a period turns round once in it: the window has two whole ones
    mixed = (values - values[-size // 4 :].mean(axis=0)) * turn
    total = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), mixed]), axis=0)
    envelope = np.sum(np.abs(total[width:] - total[:-width]) ** 2, axis=1)
    peak = int(np.argmax(envelope))
    return 0 if peak == 0 else peak + width // 2


def _prominence(values: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies and power of a record over that of its surroundings."""
    size = values.shape[0]
    ramp = np.linspace(-1.0, 1.0, size)[:, None]
    level = values - values.mean(axis=0)
    level = level - ramp * (level * ramp).sum(axis=0) / (ramp * ramp).sum()
    window = np.hanning(size + 2)[1:-1, None]
    power = np.abs(np.fft.rfft(level * window, axis=0)) ** 2
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    # lines in groups that widen with frequency, so that the slope of a step is level in each
    edges = np.unique(np.round(np.geomspace(1, power.shape[0], 40)).astype(int))
    ratio = np.zeros_like(power)
    for channel in range(power.shape[1]):
        quiet = [np.median(power[a:b, channel]) for a, b in itertools.pairwise(edges)]
        middle = [0.5 * (a + b - 1) for a, b in itertools.pairwise(edges)]
        floor = np.maximum(quiet, 1e-300)
        # a mode may fill a group: the lesser of its neighbours is the surroundings
        padded = np.concatenate([floor[:1], floor, floor[-1:]])
        floor = np.minimum(floor, np.minimum(padded[:-2], padded[2:]))
        surroundings = np.exp(np.interp(np.arange(power.shape[0]), middle, np.log(floor)))
        ratio[1:, channel] = power[1:, channel] / surroundings[1:]
    return np.asarray(frequency, dtype=np.float64), np.asarray(ratio.max(axis=1))


def subspace_poles(values: Array, rate: float, order: int) -> Complex:
    """Return the poles of a free decay by the shift invariance of its subspace.

    Windows of the record are the columns of a Hankel matrix; the subspace of its largest singular
    values turns into itself by one sample as U_2 = U_1 Z, and the eigenvalues of Z are exp(pole T)
    (Juang and Pappa, 1985, Journal of Guidance, Control and Dynamics 8; Hua and Sarkar, 1990).
    Those in the upper half plane that decay [rad/s], rising in frequency.
    """
    size = values.shape[0]
    window = min(size // 2, _WINDOW)
    order = min(order, window - 2)
    stride = max(1, (size - window) // _SHIFTS)
    square = np.zeros((window, window))
    for channel in values.T:
        hankel = np.lib.stride_tricks.sliding_window_view(channel, window)[::stride]
        square += hankel.T @ hankel
    subspace = np.linalg.eigh(square)[1][:, -order:]
    turn = np.linalg.lstsq(subspace[:-1], subspace[1:])[0]
    roots = np.linalg.eigvals(turn).astype(np.complex128)
    roots = roots[np.abs(roots) > 0.0]
    poles = rate * np.log(roots)
    # a little growth may be noise on a decay that is hardly there
    poles = poles[(poles.imag > 0.0) & (np.abs(poles.real) < 0.7 * np.abs(poles))]
    poles = -np.maximum(-poles.real, 1e-6 * np.abs(poles)) + 1j * poles.imag
    return np.asarray(poles[np.argsort(np.abs(poles), kind="stable")], dtype=np.complex128)
