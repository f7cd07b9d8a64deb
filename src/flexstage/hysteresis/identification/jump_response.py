"""Delay and lowest mode, from how the output answers jumps of the input."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import least_squares, minimize_scalar

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.measurement import without_history
from flexstage.hysteresis.identification.projection import orthonormal
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.hysteresis.identification.resonance_search import Resonance


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """What a jump is, and what is believed of the ringing after it."""

    share: float = 0.02
    """A jump moves over this share of the range."""
    steeper: float = 6.0
    """It moves this many times as far as as many samples beside it do."""
    quiet: int = 12
    """Samples before and after a jump that it is compared with."""
    samples: int = 3000
    """What follows a jump is looked at for so many samples at most."""
    periods: float = 40.0
    """What follows a jump is looked at for so many periods of the mode, once that is known."""
    jumps: int = 12
    """Jumps that are looked at, the largest of a record."""
    worth: float = 0.3
    """A mode is believed where it takes this share of the misfit of a plain delay away."""
    vague: float = 0.01
    """A mode is believed where the standard error of its frequency is below this share of it."""
    least_damping: float = 5e-4
    """A mode that decays has this damping ratio or more."""
    most_damping: float = 0.3
    """Largest damping ratio that is looked for."""
    sampled: float = 2.5
    """A mode is sampled so many times in a period at least."""
    faint: float = 30.0
    """What may ring has a line in the spectrum this many times above the median."""
    line: float = 100.0
    """What surely rings has a line this many times above the median."""
    visible: float = 5.0
    """What surely rings is this many times as large as the noise."""
    bent: float = 0.1
    """The hysteresis in a jump moves the phase of a mode by this share of the duration."""


_THRESHOLDS = _Thresholds()
#: Numbers of samples within which a jump moves.
_WIDTHS = (2, 8)


#: Where a jump lies between two samples is not known: of the length of a sample.
_WITHIN = 1.0 / math.sqrt(12.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Window:
    """A jump: the output about it without what is slow, and the corners of the input."""

    t: Array
    y: Array
    slow: Array
    corners: Array
    bends: Array

    @classmethod
    def of(cls, t: Array, y: Array, slow: Array, corners: Array, bends: Array) -> "_Window":
        """Take what is slow out of the output."""
        basis = orthonormal(slow)
        y = y - basis @ (basis.T @ y)
        return cls(t=t, y=y, slow=basis, corners=corners, bends=bends)

    def bare(self, columns: Array) -> Array:
        """Columns without what the slow ones can say."""
        return columns - self.slow @ (self.slow.T @ columns)

    def ramps(self, delay: float) -> Array:
        """The jump itself, later, shape (n, 1)."""
        return (np.maximum(self.t[:, None] - self.corners - delay, 0.0) @ self.bends)[:, None]

    def rung(self, f: float, damping: float, delay: float) -> Array:
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

    A jump moves over more than 2 % of the range within two samples, or eight, and hardly in the
    twelve beside it.
    """
    found: list[tuple[int, int]] = []
    for width in _WIDTHS:
        if u.size < 4 * (_THRESHOLDS.quiet + width):
            break
        step = np.abs(u[width:] - u[:-width])
        # the largest of the neighbours on either side, beyond those that share in the jump
        pad = _THRESHOLDS.quiet + width + 1
        beside = maximum_filter1d(np.pad(step, pad), _THRESHOLDS.quiet - 1, mode="constant")
        middle, reach = np.arange(step.size) + pad, _THRESHOLDS.quiet // 2 + width + 1
        around = np.maximum(beside[middle - reach], beside[middle + reach])
        jumps = step > _THRESHOLDS.share * np.ptp(u)
        at = np.flatnonzero(jumps & (step > _THRESHOLDS.steeper * around))
        for run in np.split(at, np.flatnonzero(np.diff(at) > width + 1) + 1) if at.size else []:
            i = int(run[int(np.argmax(step[run]))])
            if all(abs(i - other) > _THRESHOLDS.quiet for other, _ in found):
                found.append(_whole(u, i, i + width))
    return np.array(sorted(found), dtype=np.intp).reshape(-1, 2)


def _whole(u: Array, start: int, stop: int) -> tuple[int, int]:
    """Where a jump that was seen between two samples begins, and where it is over."""
    little = 0.02 * abs(u[stop] - u[start])
    while start > 0 and stop - start < _WIDTHS[-1] and abs(u[start] - u[start - 1]) > little:
        start -= 1
    while stop < u.size - 1 and stop - start < _WIDTHS[-1] and abs(u[stop + 1] - u[stop]) > little:
        stop += 1
    while stop - start > 1 and abs(u[start + 1] - u[start]) < little:
        start += 1
    while stop - start > 1 and abs(u[stop] - u[stop - 1]) < little:
        stop -= 1
    return start, stop


def jump_response(section: RecordSection) -> Resonance | None:
    r"""Find the delay and the lowest mode of an output that answers jumps of its input.

    About each jump the output is a slow motion, the jump itself, and the jump behind a mode of
    second order, the last two later by the delay:

    .. math:: y = s(t) + a\, j(t - t_d) + b\, (h * j)(t - t_d), \qquad
              h = \frac{\omega_0}{\sqrt{1-\zeta^2}}\, e^{-\zeta\omega_0 t}
                  \sin(\omega_0 \sqrt{1-\zeta^2}\, t)

    in closed form for straight lines between samples of the input. All but frequency, damping and
    delay enter linearly and are projected out. None where the input does not jump, or the output
    does not answer.

    Validity: a jump is over before the mode has moved far, and what the hysteresis does in it is
    over with it. The standard error of a delay without a mode is no less than that of a jump that
    lies somewhere between two samples.
    """
    windows = _windows(without_history(section))
    if not windows:
        return None
    dt = section.dt
    longest = min(40.0 * dt, *(0.5 * float(w.t[-1]) for w in windows))
    plain_delay, plain_cost = _plain(windows, longest, dt)
    count = sum(w.t.size for w in windows)
    if plain_cost > 0.3 * sum(float(w.y @ w.y) for w in windows):
        plain = None
    else:
        error = _curvature_error(windows, plain_delay, plain_cost, dt, count)
        plain = Resonance(delay=plain_delay, delay_error=math.hypot(error, _WITHIN * dt))
    at, height = _line(windows, plain_delay, dt)
    if at == 0.0 or height < _THRESHOLDS.faint:
        return plain
    mode = _mode(windows, at, dt)
    if mode is not None:
        return mode
    large = _THRESHOLDS.visible * section.noise
    shown = height > _THRESHOLDS.line and _size(windows, plain_delay) > large
    if not shown or plain is None:
        return plain
    return Resonance(delay=plain.delay, delay_error=plain.delay_error, unexplained_hz=at)


def _windows(section: RecordSection) -> list[_Window]:
    u = section.u
    at = jumps(u)
    size = np.abs(u[at[:, 1]] - u[at[:, 0]])
    ends = np.append(at[1:, 0], u.size)
    made = []
    for k in np.sort(np.argsort(-size)[: _THRESHOLDS.jumps]):
        first, last = (int(i) for i in at[k])
        after = u[last : min(int(ends[k]), last + _THRESHOLDS.samples)]
        away = np.flatnonzero(np.abs(after - after[0]) > 0.5 * size[k])
        stop = last + (int(away[0]) if away.size else after.size)
        start = max(first - _THRESHOLDS.quiet, int(at[k - 1, 1]) if k else 0)
        if stop - last >= 2 * _THRESHOLDS.quiet:
            made.append(_window(section, slice(start, stop), first, last))
    return made


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


def _left(window: _Window, columns: Array) -> tuple[Array, Array]:
    """What columns leave of the output of a window, and their coefficients."""
    bare = window.bare(columns)
    own: Array = np.asarray(np.linalg.lstsq(bare, window.y, rcond=1e-9)[0], dtype=np.float64)
    return window.y - bare @ own, own


def _plain(windows: list[_Window], longest: float, dt: float) -> tuple[float, float]:
    """Delay of jumps that come through as they are, and the sum of squares that it leaves."""

    def cost(delay: float) -> float:
        return sum(float(np.sum(_left(w, w.ramps(delay))[0] ** 2)) for w in windows)

    steps = np.arange(0.0, longest + 0.5 * dt, 0.5 * dt)
    best = float(min(steps, key=cost))
    found: Any = minimize_scalar(
        cost,
        bounds=(max(best - dt, 0.0), best + dt),
        method="bounded",
        options={"xatol": 1e-3 * dt},
    )
    return (float(found.x), float(found.fun)) if found.fun < cost(best) else (best, cost(best))


def _curvature_error(
    windows: list[_Window], delay: float, cost: float, dt: float, count: int
) -> float:
    """Standard error of a delay, from jump to jump where there are several."""
    each = [_plain([w], delay + 4.0 * dt, dt)[0] for w in windows] if len(windows) > 2 else []
    if each:
        return float(np.std(each, ddof=1) / math.sqrt(len(each)))
    h = 0.25 * dt
    rate = 0.0
    for w in windows:
        ends = [_left(w, w.ramps(max(delay + s, 0.0)))[0] for s in (h, -h)]
        rate += float(np.sum(((ends[0] - ends[1]) / (2.0 * h)) ** 2))
    return math.sqrt(cost / max(count - 8, 1) / max(rate, 1e-300))


def _line(windows: list[_Window], delay: float, dt: float) -> tuple[float, float]:
    """Frequency of the highest line of what a plain delay leaves [Hz], and its height."""
    size = 1 << math.ceil(math.log2(max(w.t.size for w in windows))) + 1
    power = np.zeros(size // 2 + 1)
    for w in windows:
        left = _left(w, w.ramps(delay))[0][w.t > delay]
        power += np.abs(np.fft.rfft(left * np.hanning(2 * left.size)[left.size :], size)) ** 2
    f = np.fft.rfftfreq(size, dt)
    long = max(w.t[-1] for w in windows)
    inside = (f > 4.0 / long) & (f < 1.0 / (_THRESHOLDS.sampled * dt))
    if not inside.any():
        return 0.0, 0.0
    best = int(np.argmax(np.where(inside, power, 0.0)))
    return float(f[best]), float(power[best] / max(np.median(power[inside]), 1e-300))


def _size(windows: list[_Window], delay: float) -> float:
    """Largest part of what a plain delay leaves after a jump, in a typical window."""
    return float(
        np.median(
            [np.sort(np.abs(_left(w, w.ramps(delay))[0][w.t > delay]))[-8:].mean() for w in windows]
        )
    )


def _mode(windows: list[_Window], at: float, dt: float) -> Resonance | None:
    """The mode near a line, where it is one."""
    short = [_until(w, _THRESHOLDS.periods / at) for w in windows]
    scale = np.array([0.01 * at, 0.01, dt])

    def left(x: Array) -> Array:
        f, damping, delay = (float(v) for v in x * scale)
        return np.concatenate(
            [_left(w, np.hstack((w.rung(f, damping, delay), w.ramps(delay))))[0] for w in short]
        )

    def cost(x: Array) -> float:
        return float(np.sum(left(x) ** 2))

    longest = max(1.25 / at, 4.0 * dt)
    # a delay that is a period too long rings along almost as well: look over more than one
    starts = [
        np.array([at, damping, delay]) / scale
        for damping in (0.01, 0.06)
        for delay in np.linspace(0.0, longest, 25)
    ]
    low = np.array([0.8 * at, 1e-4, 0.0]) / scale
    high = np.array([1.25 * at, _THRESHOLDS.most_damping, 2.0 * longest]) / scale
    begins = sorted(starts, key=cost)[:2]
    found = min(
        (
            least_squares(
                left, np.clip(b, low + 1e-6, high - 1e-6), bounds=(low, high), max_nfev=30
            )
            for b in begins
        ),
        key=lambda r: r.cost,
    )
    f, damping, delay = (float(v) for v in found.x * scale)
    plain = _plain(short, 2.0 * longest, dt)[1]
    decays = _THRESHOLDS.least_damping < damping < 0.9 * _THRESHOLDS.most_damping
    if 2.0 * found.cost > (1.0 - _THRESHOLDS.worth) * plain or not decays:
        return None
    spread = np.linalg.pinv(found.jac.T @ found.jac) * 2.0 * found.cost
    spread /= max(found.fun.size - 3 - sum(w.slow.shape[1] + 2 for w in short), 1)
    error = np.sqrt(np.maximum(np.diag(spread), 0.0)) * scale
    if error[0] > _THRESHOLDS.vague * f:
        return None
    share = _share(short, f, damping, delay)
    width = max(float(w.corners[-1]) for w in short)
    if not share > 0.0:
        return None
    return Resonance(
        delay=delay,
        delay_error=math.hypot(float(error[2]), _THRESHOLDS.bent * width),
        frequency_hz=f,
        frequency_error_hz=float(error[0]),
        damping_ratio=damping,
        share=share,
    )


def _share(windows: list[_Window], f: float, damping: float, delay: float) -> float:
    """Part of the jumps that goes through a mode."""
    parts = []
    for w in windows:
        own = _left(w, np.hstack((w.rung(f, damping, delay), w.ramps(delay))))[1]
        parts.append(own)
    through, at_once = np.sum(parts, axis=0)
    share = float(through / (through + at_once))
    return 1.0 if share > 0.95 else share


def _until(window: _Window, end: float) -> _Window:
    """The first part of a window."""
    n = int(np.searchsorted(window.t, end))
    if n >= window.t.size or n < 4 * _THRESHOLDS.quiet:
        return window
    return _Window.of(
        t=window.t[:n], y=window.y[:n], slow=window.slow[:n], corners=window.corners,
        bends=window.bends,
    )  # fmt: skip
