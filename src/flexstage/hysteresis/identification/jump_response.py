"""Delay and lowest mode, from the response to jumps of the input."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import least_squares, minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.measurement import without_history
from flexstage.hysteresis.identification.projection import orthonormal
from flexstage.hysteresis.identification.resonance_search import Resonance


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of jumps, and of the ringing after them."""

    share: float = 0.02
    """Smallest jump, as a share of the range."""
    steeper: float = 6.0
    """Smallest ratio of a jump to the motion over as many neighbouring samples."""
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
    least_damping: float = 5e-4
    """Smallest damping ratio of a mode."""
    most_damping: float = 0.3
    """Largest damping ratio of a mode."""
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
    widths: tuple[int, int] = (2, 8)
    """Numbers of samples of a jump."""
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
    def of(cls, t: Array, y: Array, slow: Array, corners: Array, bends: Array) -> "_Window":
        """Remove slow motion from the output."""
        basis = orthonormal(slow)
        y = y - basis @ (basis.T @ y)
        return cls(t=t, y=y, slow=basis, corners=corners, bends=bends)

    def bare(self, columns: Array) -> Array:
        """Columns less their projection on slow motion."""
        return columns - self.slow @ (self.slow.T @ columns)

    def ramps(self, delay: float) -> Array:
        """The jump itself, later, shape (n, 1)."""
        return (np.maximum(self.t[:, None] - self.corners - delay, 0.0) @ self.bends)[:, None]

    def ringing(self, f: float, damping: float, delay: float) -> Array:
        """The jump behind a mode, in closed form, shape (n, 1)."""
        omega = 2.0 * math.pi * f
        quick = omega * math.sqrt(1.0 - damping**2)
        t = np.maximum(self.t[:, None] - self.corners - delay, 0.0)
        fading = np.exp(-damping * omega * t)
        swing = 2.0 * damping / omega * np.cos(quick * t)
        swing += (2.0 * damping**2 - 1.0) / quick * np.sin(quick * t)
        return ((t - 2.0 * damping / omega + fading * swing) @ self.bends)[:, None]


def jumps(u: Array) -> NDArray[np.intp]:
    """Return the last sample before each jump of an input and the first after it, shape (j, 2).

    A jump is a motion by more than 2 % of the range within two or eight samples, with hardly any
    motion in the twelve next to it.
    """
    pairs: list[tuple[int, int]] = []
    for width in _THRESHOLDS.widths:
        if u.size < 4 * (_THRESHOLDS.quiet + width):
            break
        step = np.abs(u[width:] - u[:-width])
        # the largest of the neighbours on either side, beyond those that share in the jump
        pad = _THRESHOLDS.quiet + width + 1
        neighbours = maximum_filter1d(np.pad(step, pad), _THRESHOLDS.quiet - 1, mode="constant")
        middle, reach = np.arange(step.size) + pad, _THRESHOLDS.quiet // 2 + width + 1
        around = np.maximum(neighbours[middle - reach], neighbours[middle + reach])
        jumps = step > _THRESHOLDS.share * np.ptp(u)
        at = np.flatnonzero(jumps & (step > _THRESHOLDS.steeper * around))
        for run in np.split(at, np.flatnonzero(np.diff(at) > width + 1) + 1) if at.size else []:
            i = int(run[int(np.argmax(step[run]))])
            if all(abs(i - other) > _THRESHOLDS.quiet for other, _ in pairs):
                pairs.append(_jump_extent(u, i, i + width))
    return np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)


def _jump_extent(u: Array, start: int, stop: int) -> tuple[int, int]:
    """Last sample before a jump, and first sample after it, from two samples of it."""
    first, longest = max(start - _THRESHOLDS.widths[-1], 0), _THRESHOLDS.widths[-1]
    moves = np.abs(np.diff(u[first : stop + longest + 1])) > 0.02 * abs(u[stop] - u[start])
    start, stop = start - first, stop - first
    while start > 0 and stop - start < longest and moves[start - 1]:
        start -= 1
    while stop < moves.size and stop - start < longest and moves[stop]:
        stop += 1
    inside = np.flatnonzero(moves[start:stop])
    return first + start + int(inside[0]), first + start + int(inside[-1]) + 1


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
    windows = _windows(without_history(section))
    if not windows:
        return None
    dt = section.dt
    longest = min(40.0 * dt, *(0.5 * float(w.t[-1]) for w in windows))
    delay, cost = _plain(windows, longest, dt)
    at, height = _line(windows, delay, dt)
    mode = _mode(windows, at, dt) if height > _THRESHOLDS.possible_line else None
    if mode is not None or cost > 0.3 * sum(float(w.y @ w.y) for w in windows):
        return mode
    rms = math.sqrt(cost / sum(w.t.size for w in windows))
    certain = height > _THRESHOLDS.certain_line and rms > _THRESHOLDS.certain_size * section.noise
    return Resonance(
        delay=delay,
        delay_error=math.hypot(_scatter(windows, delay, dt), _THRESHOLDS.within * dt),
        unexplained_hz=at if certain else 0.0,
    )


def _windows(section: RecordSection) -> list[_Window]:
    u = section.u
    at = jumps(u)
    size = np.abs(u[at[:, 1]] - u[at[:, 0]])
    ends = np.append(at[1:, 0], u.size)
    windows = []
    for k in np.sort(np.argsort(-size)[: _THRESHOLDS.jumps]):
        first, last = (int(i) for i in at[k])
        after = u[last : min(int(ends[k]), last + _THRESHOLDS.samples)]
        away = np.flatnonzero(np.abs(after - after[0]) > 0.5 * size[k])
        stop = last + (int(away[0]) if away.size else after.size)
        start = max(first - _THRESHOLDS.quiet, int(at[k - 1, 1]) if k else 0)
        if stop - last >= 2 * _THRESHOLDS.quiet:
            windows.append(_window(section, slice(start, stop), first, last))
    return windows


def _window(section: RecordSection, part: slice, first: int, last: int) -> _Window:
    u, dt = section.u, section.dt
    t = (np.arange(part.start, part.stop) - first) * dt
    long, late = float(t[-1]), np.maximum(t, 0.0)
    end = (last - first) * dt
    slow = np.column_stack(
        (
            np.ones(t.size),
            t,
            # creep, and a drive that moves before the jump and after it
            *(-np.expm1(-late / (long / k)) for k in (1.0, 4.0)),
            np.where(t <= 0.0, u[part] - u[first], 0.0),
            np.where(t >= end, u[part] - u[last], 0.0),
        )
    )
    bends = np.diff(np.diff(u[first : last + 1]) / dt, prepend=0.0, append=0.0)
    used = np.abs(bends) > 1e-6 * np.abs(bends).max()
    return _Window.of(
        t=t, y=section.y[part], slow=slow,
        corners=np.flatnonzero(used) * np.float64(dt), bends=bends[used],
    )  # fmt: skip


def _residual(window: _Window, columns: Array) -> tuple[Array, Array]:
    """Residual of the output of a window with columns, and their coefficients."""
    bare = window.bare(columns)
    coefficients: Array = np.asarray(
        np.linalg.lstsq(bare, window.y, rcond=1e-9)[0], dtype=np.float64
    )
    return window.y - bare @ coefficients, coefficients


def _plain(windows: list[_Window], longest: float, dt: float) -> tuple[float, float]:
    """Delay of jumps without a mode, and the sum of squares of the residual."""

    def cost(delay: float) -> float:
        return sum(float(np.sum(_residual(w, w.ramps(delay))[0] ** 2)) for w in windows)

    steps = np.arange(0.0, longest + 0.5 * dt, 0.5 * dt)
    best = float(min(steps, key=cost))
    minimum: Any = minimize_scalar(
        cost,
        bounds=(max(best - dt, 0.0), best + dt),
        method="bounded",
        options={"xatol": 1e-3 * dt},
    )
    return float(minimum.x), float(minimum.fun)


def _scatter(windows: list[_Window], delay: float, dt: float) -> float:
    """Standard error of a delay by its scatter between jumps; a sample for one or two of them."""
    each = [_plain([w], delay + 4.0 * dt, dt)[0] for w in windows] if len(windows) > 2 else []
    return float(np.std(each, ddof=1) / math.sqrt(len(each))) if each else dt


def _line(windows: list[_Window], delay: float, dt: float) -> tuple[float, float]:
    """Frequency of the highest line in the residual of a plain delay [Hz], and its height."""
    size = 1 << math.ceil(math.log2(max(w.t.size for w in windows))) + 1
    power = np.zeros(size // 2 + 1)
    for w in windows:
        residual = _residual(w, w.ramps(delay))[0][w.t > delay]
        power += (
            np.abs(np.fft.rfft(residual * np.hanning(2 * residual.size)[residual.size :], size))
            ** 2
        )
    f = np.fft.rfftfreq(size, dt)
    long = max(w.t[-1] for w in windows)
    inside = (f > 4.0 / long) & (f < 1.0 / (_THRESHOLDS.sampled * dt))
    if not inside.any():
        return 0.0, 0.0
    best = int(np.argmax(np.where(inside, power, 0.0)))
    return float(f[best]), float(power[best] / max(np.median(power[inside]), 1e-300))


def _mode(windows: list[_Window], at: float, dt: float) -> Resonance | None:
    """Mode near a spectral line; None if it is no mode."""
    short = [_until(w, _THRESHOLDS.periods / at) for w in windows]
    scale = np.array([0.01 * at, 0.01, dt])

    def left(x: Array) -> Array:
        f, damping, delay = (float(v) for v in x * scale)
        return np.concatenate(
            [
                _residual(w, np.hstack((w.ringing(f, damping, delay), w.ramps(delay))))[0]
                for w in short
            ]
        )

    def cost(x: Array) -> float:
        return float(np.sum(left(x) ** 2))

    longest = max(1.25 / at, 4.0 * dt)
    # a delay that is a period too long fits almost as well: search more than one period
    starts = [
        np.array([at, damping, delay]) / scale
        for damping in (0.01, 0.06)
        for delay in np.linspace(0.0, longest, 25)
    ]
    low = np.array([0.8 * at, 1e-4, 0.0]) / scale
    high = np.array([1.25 * at, _THRESHOLDS.most_damping, 2.0 * longest]) / scale
    begins = sorted(starts, key=cost)[:2]
    fit = min(
        (
            least_squares(
                left, np.clip(b, low + 1e-6, high - 1e-6), bounds=(low, high), max_nfev=30
            )
            for b in begins
        ),
        key=lambda r: r.cost,
    )
    f, damping, delay = (float(v) for v in fit.x * scale)
    plain = _plain(short, 2.0 * longest, dt)[1]
    decays = _THRESHOLDS.least_damping < damping < 0.9 * _THRESHOLDS.most_damping
    if 2.0 * fit.cost > (1.0 - _THRESHOLDS.reduction) * plain or not decays:
        return None
    spread = np.linalg.pinv(fit.jac.T @ fit.jac) * 2.0 * fit.cost
    spread /= max(fit.fun.size - 3 - sum(w.slow.shape[1] + 2 for w in short), 1)
    error = np.sqrt(np.maximum(np.diag(spread), 0.0)) * scale
    if error[0] > _THRESHOLDS.largest_error * f:
        return None
    columns = [np.hstack((w.ringing(f, damping, delay), w.ramps(delay))) for w in short]
    parts = [_residual(w, c)[1] for w, c in zip(short, columns, strict=True)]
    through, at_once = np.sum(parts, axis=0)
    share = float(through / (through + at_once))
    width = max(float(w.corners[-1]) for w in short)
    if not share > 0.0:
        return None
    return Resonance(
        delay=delay,
        delay_error=math.hypot(float(error[2]), _THRESHOLDS.phase * width),
        frequency_hz=f,
        frequency_error_hz=float(error[0]),
        damping_ratio=damping,
        share=1.0 if share > 0.95 else share,
    )


def _until(window: _Window, end: float) -> _Window:
    """First part of a window."""
    n = int(np.searchsorted(window.t, end))
    if n >= window.t.size or n < 4 * _THRESHOLDS.quiet:
        return window
    return _Window.of(
        t=window.t[:n], y=window.y[:n], slow=window.slow[:n], corners=window.corners,
        bends=window.bends,
    )  # fmt: skip
