"""Delay and lowest mode, from the response to jumps of the input."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.history import without_history
from flexstage.hysteresis.identification.projection import orthonormal
from flexstage.hysteresis.identification.resonance_search import Resonance


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of jumps, and of the ringing after them."""

    share: float = 0.02
    """Smallest jump, as a share of the range."""
    width: int = 8
    """Largest number of samples of a jump."""
    steeper: float = 6.0
    """Smallest ratio of a jump to the motion over the neighbouring samples."""
    quiet: int = 12
    """Neighbouring samples on each side of a jump."""
    samples: int = 3000
    """Largest number of samples of the response to a jump."""
    periods: float = 40.0
    """Largest number of periods of the response to a jump, with a known mode."""
    jumps: int = 12
    """Largest number of jumps of a record, the largest ones."""
    reduction: float = 0.3
    """Smallest reduction by a mode of the squared residual of a plain delay."""
    largest_error: float = 0.01
    """Largest relative standard error of the frequency of a mode."""
    damping: tuple[float, float] = (5e-4, 0.27)
    """Damping ratios of a mode; beyond these it is a lag, or does not decay."""
    sampled: float = 2.5
    """Fewest samples in a period of a mode."""
    possible_line: float = 30.0
    """Smallest ratio of a spectral line to the median, for possible ringing."""
    certain_line: float = 100.0
    """Smallest ratio of a spectral line to the median, for certain ringing."""
    certain_size: float = 2.0
    """Smallest ratio of the rms residual to the noise, for certain ringing."""
    phase: float = 0.1
    """Shift of the phase of a mode by the hysteresis in a jump, over the duration of the jump."""
    within: float = 1.0 / math.sqrt(12.0)
    """Standard deviation of the place of a jump between two samples [samples]."""


_THRESHOLDS = _Thresholds()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Window:
    """Jump of the input: the output about it without slow motion, and the corners of the input."""

    t: Array
    y: Array
    slow: Array
    corners: Array
    bends: Array

    @classmethod
    def of(cls, section: RecordSection, part: slice, first: int, last: int) -> "_Window":
        """Remove slow motion from the output about a jump between two samples."""
        u, dt = section.u, section.dt
        t = (np.arange(part.start, part.stop) - first) * dt
        late = np.maximum(t, 0.0) / t[-1]
        # creep, and a drive that moves before the jump and after it
        creep = (-np.expm1(-late), -np.expm1(-4.0 * late))
        before = np.where(t <= 0.0, u[part] - u[first], 0.0)
        after = np.where(t >= (last - first) * dt, u[part] - u[last], 0.0)
        slow = orthonormal(np.column_stack((np.ones(t.size), t, *creep, before, after)))
        y = section.y[part]
        bends = np.diff(np.diff(u[first : last + 1]) / dt, prepend=0.0, append=0.0)
        corners = np.arange(bends.size, dtype=np.float64) * dt
        return cls(t=t, y=y - slow @ (slow.T @ y), slow=slow, corners=corners, bends=bends)

    def fit(self, delay: float, *mode: float) -> tuple[Array, Array]:
        """Fit the jump, and the jump behind a mode, of a frequency [Hz] and a damping ratio.

        Returned: the residual of the output, and the coefficients, that of the mode first.
        """
        t = np.maximum(self.t[:, None] - self.corners - delay, 0.0)
        columns = [t @ self.bends]
        if mode:
            omega, damping = 2.0 * math.pi * mode[0], mode[1]
            quick = omega * math.sqrt(1.0 - damping**2)
            swing = 2.0 * damping / omega * np.cos(quick * t)
            swing += (2.0 * damping**2 - 1.0) / quick * np.sin(quick * t)
            rung = t - 2.0 * damping / omega + np.exp(-damping * omega * t) * swing
            columns.insert(0, rung @ self.bends)
        bare = np.stack(columns, axis=1)
        bare -= self.slow @ (self.slow.T @ bare)
        coefficients = np.linalg.lstsq(bare, self.y, rcond=1e-9)[0].astype(np.float64)
        return self.y - bare @ coefficients, coefficients


def jumps(u: Array) -> NDArray[np.intp]:
    """Return the last sample before each jump of an input and the first after it, shape (j, 2).

    A jump is a motion by more than 2 % of the range within at most eight samples, and by six times
    more than over the twelve samples before it and after it.
    """
    n, quiet = u.size, _THRESHOLDS.quiet
    pairs: list[tuple[int, int]] = []
    nearby = np.ptp(sliding_window_view(np.pad(u, quiet, mode="edge"), quiet + 1), axis=1)
    before, after = nearby[:n], nearby[quiet:]
    for width in range(1, min(_THRESHOLDS.width, n - 1) + 1):
        size = np.abs(u[width:] - u[:-width])
        least = _THRESHOLDS.steeper * np.maximum(before[:-width], after[width:])
        at = np.flatnonzero(size > np.maximum(least, _THRESHOLDS.share * np.ptp(u)))
        for i in at[np.argsort(-size[at])].tolist():
            if all(abs(i - other) > quiet for other, _ in pairs):
                pairs.append((i, i + width))
    return np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)


def jump_response(section: RecordSection) -> Resonance | None:
    r"""Find the delay and the lowest mode of an output from jumps of its input.

    About each jump the output is the sum of slow motion, the jump itself, and the jump behind a
    mode of second order, the last two later by the delay:

    .. math:: y = s(t) + a\, j(t - t_d) + b\, (h * j)(t - t_d), \qquad
              h = \frac{\omega_0}{\sqrt{1-\zeta^2}}\, e^{-\zeta\omega_0 t}
                  \sin(\omega_0 \sqrt{1-\zeta^2}\, t)

    in closed form for straight lines between samples of the input. The output is linear in all
    parameters but frequency, damping and delay; these are projected out. None without jumps of the
    input, or without a response.

    Validity: jumps that are short compared with the period of the mode. The standard error of a
    delay without a mode is at least that of a jump somewhere between two samples.
    """
    section = without_history(section)
    windows, dt = _windows(section, _THRESHOLDS.samples), section.dt
    if not windows:
        return None
    delay, cost = _plain(windows, min(40.0 * dt, *(0.5 * float(w.t[-1]) for w in windows)), dt)
    at, height = _line(windows, delay, dt)
    mode = _mode(section, at) if height > _THRESHOLDS.possible_line else None
    if mode is not None or cost > 0.3 * sum(float(w.y @ w.y) for w in windows):
        return mode
    rms = math.sqrt(cost / sum(w.t.size for w in windows))
    certain = height > _THRESHOLDS.certain_line and rms > _THRESHOLDS.certain_size * section.noise
    scatter = dt  # of one or two jumps, a sample
    if len(windows) > 2:
        each = [_plain([w], delay + 4.0 * dt, dt)[0] for w in windows]
        scatter = float(np.std(each, ddof=1)) / math.sqrt(len(each))
    return Resonance(
        delay=delay,
        delay_error=math.hypot(scatter, _THRESHOLDS.within * dt),
        unexplained_hz=at if certain else 0.0,
    )


def _windows(section: RecordSection, longest: int) -> list[_Window]:
    """Windows about the largest jumps, up to the next motion of the input by half of a jump."""
    u, at = section.u, jumps(section.u)
    size = np.abs(u[at[:, 1]] - u[at[:, 0]])
    ends = np.append(at[1:, 0], u.size).tolist()
    windows = []
    for k in np.sort(np.argsort(-size)[: _THRESHOLDS.jumps]).tolist():
        first, last = at[k].tolist()
        stop = min(ends[k], last + longest)
        away = np.flatnonzero(np.abs(u[last:stop] - u[last]) > 0.5 * size[k])
        stop = last + int(away[0]) if away.size else stop
        start = max(first - _THRESHOLDS.quiet, int(at[k - 1, 1]) if k else 0)
        if stop - last >= 2 * _THRESHOLDS.quiet:
            windows.append(_Window.of(section, slice(start, stop), first, last))
    return windows


def _plain(windows: list[_Window], longest: float, dt: float) -> tuple[float, float]:
    """Delay of jumps without a mode, and the sum of squares of the residual."""

    def cost(delay: float) -> float:
        return sum(float(np.sum(w.fit(delay)[0] ** 2)) for w in windows)

    best = float(min(np.arange(0.0, longest + 0.5 * dt, 0.5 * dt), key=cost))
    bounds, options = (max(best - dt, 0.0), best + dt), {"xatol": 1e-3 * dt}
    minimum: Any = minimize_scalar(cost, bounds=bounds, method="bounded", options=options)
    return float(minimum.x), float(minimum.fun)


def _line(windows: list[_Window], delay: float, dt: float) -> tuple[float, float]:
    """Frequency of the highest line in the residual of a plain delay [Hz], and its height."""
    size = 1 << math.ceil(math.log2(max(w.t.size for w in windows))) + 1
    power = np.zeros(size // 2 + 1)
    for w in windows:
        residual = w.fit(delay)[0][w.t > delay]
        fading = np.hanning(2 * residual.size)[residual.size :]
        power += np.abs(np.fft.rfft(residual * fading, size)) ** 2
    f, long = np.fft.rfftfreq(size, dt), max(w.t[-1] for w in windows)
    inside = (f > 4.0 / long) & (f < 1.0 / (_THRESHOLDS.sampled * dt))
    if not inside.any():
        return 0.0, 0.0
    best = int(np.argmax(np.where(inside, power, 0.0)))
    return float(f[best]), float(power[best] / max(np.median(power[inside]), 1e-300))


def _mode(section: RecordSection, at: float) -> Resonance | None:
    """Mode near a spectral line; None if it is no mode."""
    dt, (least, most) = section.dt, _THRESHOLDS.damping
    samples = max(math.ceil(_THRESHOLDS.periods / (at * dt)), 4 * _THRESHOLDS.quiet)
    windows = _windows(section, min(samples, _THRESHOLDS.samples))
    scale = np.array([dt, 0.01 * at, 0.01])

    def left(x: Array) -> Array:
        return np.concatenate([w.fit(*(x * scale).tolist())[0] for w in windows])

    longest = max(1.25 / at, 4.0 * dt)
    # a delay that is a period too long fits almost as well: search more than one period
    starts = [
        np.array([delay, at, damping]) / scale
        for damping in (0.01, 0.06)
        for delay in np.linspace(0.0, longest, 25)
    ]
    low = np.array([0.0, 0.8 * at, 0.2 * least]) / scale
    high = np.array([2.0 * longest, 1.25 * at, 1.1 * most]) / scale
    fits = [
        least_squares(left, np.clip(b, low + 1e-6, high - 1e-6), bounds=(low, high), max_nfev=30)
        for b in sorted(starts, key=lambda x: float(np.sum(left(x) ** 2)))[:2]
    ]
    fit = min(fits, key=lambda r: r.cost)
    delay, f, damping = (fit.x * scale).tolist()
    plain = _plain(windows, 2.0 * longest, dt)[1]
    free = sum(w.slow.shape[1] + 2 for w in windows) + 3
    spread = np.linalg.pinv(fit.jac.T @ fit.jac) * 2.0 * fit.cost / max(fit.fun.size - free, 1)
    error = np.sqrt(np.maximum(np.diag(spread), 0.0)) * scale
    through, at_once = np.sum([w.fit(delay, f, damping)[1] for w in windows], axis=0)
    share = float(through / (through + at_once))
    decays, placed = least < damping < most, error[1] <= _THRESHOLDS.largest_error * f
    reduces = 2.0 * fit.cost <= (1.0 - _THRESHOLDS.reduction) * plain
    if not (reduces and decays and placed and share > 0.0):
        return None
    width = max(float(w.corners[-1]) for w in windows)
    return Resonance(
        delay=delay,
        delay_error=math.hypot(float(error[0]), _THRESHOLDS.phase * width),
        frequency_hz=f,
        frequency_error_hz=float(error[1]),
        damping_ratio=damping,
        share=1.0 if share > 0.95 else share,
    )
