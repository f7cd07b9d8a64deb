"""Lowest resonance, from a part of a record that excites it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexstage.base.arrays import Array
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.measurement import without_history

#: Lowest frequency of an excitation of a resonance, over the rate of the fastest cycle.
_ABOVE = 5.0
#: Smallest coherence of input and output in the bins of the spectrum that are used.
_COHERENCE = 0.9
_FEWEST_BINS = 12
#: Smallest reduction by a mode of the squared residual of a plain gain with delay.
_REDUCTION = 0.75
_LARGEST_DAMPING = 0.3
#: Largest relative standard error of the frequency.
_LARGEST_ERROR = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Resonance:
    """Mode in the output, and its delay."""

    frequency_hz: float = 0.0
    """Its natural frequency [Hz]; 0 for a delay alone."""
    damping_ratio: float = 0.0
    """Its damping ratio [1]."""
    frequency_error_hz: float = math.inf
    """Standard error of the frequency [Hz]."""
    delay: float = 0.0
    """Delay of the output against the input [s]."""
    delay_error: float = 0.0
    """Its standard error [s]."""
    share: float = 1.0
    """Share of the motion through the mode; the rest follows without delay [1]."""
    unexplained_hz: float = 0.0
    """Frequency of ringing that is not one mode [Hz]; 0 for none."""


def find_resonance(section: RecordSection) -> Resonance | None:
    r"""Find the lowest resonance of an output whose input excites it.

    For a small multisine or chirp about the resonance, the hysteresis is a gain. The ratio of cross
    to power spectrum (Welch 1967) is fitted by

    .. math:: H = g\, e^{-i\omega t_d} \left(1 - c
              + \frac{c\,\omega_0^2}{\omega_0^2 - \omega^2 + 2 i \zeta \omega_0 \omega}\right)

    and then the same mode to the samples, which avoids the leakage of spectral windows. None if the
    record has no such content, or shows no mode.
    """
    section = without_history(section)
    rate = 1.0 / section.dt
    fastest = float(section.cycles.frequency_hz.max(initial=0.0))
    low = max(_ABOVE * fastest, 20.0 / (section.u.size * section.dt))
    if low > 0.4 * rate:
        return None
    part = _excited(section, low)
    if part is None:
        return None
    rough = _fit(*_response(section.u[part], section.y[part], rate, low))
    if rough is None:
        return None
    mode = _refined(section, part, low, *rough)
    # a peak of the largest damping, or of uncertain frequency, is no resonance
    sharp = mode.damping_ratio < 0.9 * _LARGEST_DAMPING
    inside = mode.delay < 0.99 * _longest_delay(low)
    placed = mode.frequency_error_hz < _LARGEST_ERROR * mode.frequency_hz
    return mode if sharp and placed and inside else None


def _longest_delay(low: float) -> float:
    """Largest delay [s], for content above a frequency [Hz]."""
    return 0.1 / low


def _refined(
    section: RecordSection, part: slice, low: float, frequency_hz: float, damping: float
) -> Resonance:
    """Fit the mode to the samples of the part, with slow motion removed from input and output."""
    dt = section.dt
    margin = int(3.0 / (low * dt))
    start, stop = max(part.start - margin, 0), min(part.stop + margin, section.u.size)
    u, y = (_without_slow(x[start:stop], low * dt) for x in (section.u, section.y))
    inside = slice(part.start - start, part.stop - start)
    at = np.arange(u.size, dtype=np.float64)

    def left(p: Array) -> Array:
        stage = StageModes(frequency_hz=(p[0],), damping_ratio=(p[1],), share=(p[2],))
        shifted = stage.simulate(u, dt).values
        shifted = np.interp(at - p[3] / dt, at, shifted)[inside]
        target = y[inside]
        gain = float(shifted @ target) / max(float(shifted @ shifted), 1e-300)
        return (target - gain * shifted) / max(float(np.std(target)), 1e-300)

    begin = np.array([frequency_hz, damping, 0.98, 0.5 * dt])
    least = np.array([0.7 * begin[0], 1e-4, 0.02, 0.0])
    most = np.array([1.3 * begin[0], _LARGEST_DAMPING, 1.0, _longest_delay(low)])
    fit = least_squares(
        left,
        np.clip(begin, least + 1e-6 * (most - least), most - 1e-6 * (most - least)),
        bounds=(least, most),
        x_scale=[begin[0], 0.02, 1.0, dt],
        diff_step=1e-6,
    )
    J, cost = fit.jac, 2.0 * fit.cost / max(fit.fun.size - 5, 1)
    scale = np.maximum(np.sqrt(np.sum(J**2, axis=0)), 1e-300)
    variance = np.diag(np.linalg.pinv((J / scale).T @ (J / scale))) * cost
    error = np.sqrt(np.maximum(variance, 0.0)) / scale
    return Resonance(
        frequency_hz=float(fit.x[0]),
        damping_ratio=float(fit.x[1]),
        frequency_error_hz=float(error[0]),
        delay=float(fit.x[3]),
        delay_error=float(error[3]),
    )


def _excited(section: RecordSection, low: float) -> slice | None:
    """Part of a record with fast, small motion of the input."""
    quick = np.abs(_without_slow(section.u, low * section.dt))
    width = max(1, int(4.0 / (low * section.dt)))
    envelope = np.convolve(quick, np.ones(width) / width, mode="same")
    span = float(np.ptp(section.u))
    # corners of a triangle are fast as well, but short
    inside = envelope > max(0.3 * float(envelope.max()), 1e-5 * span)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], inside.astype(np.int8), [0]))))
    runs = edges.reshape(-1, 2)
    if runs.size == 0:
        return None
    start, stop = max(runs, key=lambda run: run[1] - run[0])
    if (stop - start) * section.dt * low < 40.0:
        return None
    return slice(int(start), int(stop))


def _without_slow(values: Array, low: float) -> Array:
    """High-pass filter at a frequency [per sample]: Butterworth of order four, both ways."""
    n = values.size - 1
    straight = values - np.linspace(values[0], values[-1], n + 1)
    # reflected at its ends, the remainder is periodic
    content = np.fft.rfft(np.concatenate((straight[:-1], -straight[:0:-1])))
    f = np.tan(0.5 * np.pi * np.arange(n + 1) / n) / np.tan(np.pi * low)
    return np.fft.irfft(content * (f**8 / (1.0 + f**8)), 2 * n)[: n + 1]


def _response(u: Array, y: Array, rate: float, low: float) -> tuple[Array, NDArray, Array]:
    from scipy.signal import csd, welch

    length = int(min(u.size // 4, max(256, 2 ** int(np.log2(12.0 * rate / low)))))
    settings = {"fs": rate, "nperseg": length, "detrend": "linear"}
    f, input_power = welch(u, **settings)
    _, output_power = welch(y, **settings)
    _, cross = csd(u, y, **settings)
    coherence = np.abs(cross) ** 2 / np.maximum(input_power * output_power, 1e-300)
    used = (f > low) & (coherence > _COHERENCE) & (input_power > 1e-4 * input_power[f > low].max())
    # the variance of a ratio of spectra at a given coherence (Bendat and Piersol 2010)
    spread = np.sqrt(np.maximum(1.0 - coherence[used], 1e-6) / coherence[used])
    return f[used], cross[used] / input_power[used], 1.0 / spread


def _fit(f: Array, H: NDArray, weight: Array) -> tuple[float, float] | None:
    """Frequency [Hz] and damping ratio of the mode of a response; None if it shows none."""
    if f.size < _FEWEST_BINS:
        return None
    omega = 2.0 * np.pi * f
    size = np.abs(H)
    level = float(np.median(size))

    def left(p: Array, share: bool = True) -> Array:
        w0 = 2.0 * np.pi * p[2]
        mode = w0**2 / (w0**2 - omega**2 + 2j * p[3] * w0 * omega)
        part = p[4] if share else 0.0
        model = level * p[0] * np.exp(-1j * omega * p[1] / omega.max()) * (1.0 - part + part * mode)
        error = (H - model) / size * weight
        return np.concatenate((error.real, error.imag))

    peak = float(f[int(np.argmax(size))])
    starts = [np.array([0.5, 0.0, at, 0.02, 1.0]) for at in (peak, 1.02 * peak, 0.97 * peak)]
    bounds = ([1e-3, -1.0, f[0] * 0.7, 1e-4, 0.02], [1e3, 20.0, f[-1] * 1.3, _LARGEST_DAMPING, 1.0])
    scale = [1.0, 1.0, peak, 0.02, 1.0]
    fits = [least_squares(left, s, bounds=bounds, x_scale=scale) for s in starts]
    best = min(fits, key=lambda r: r.cost)
    plain = least_squares(
        lambda q: left(np.array([q[0], q[1], peak, 0.1, 0.0]), share=False), [1.0, 0.0]
    )
    at, damping = float(best.x[2]), float(best.x[3])
    shows_mode = best.cost <= (1.0 - _REDUCTION) * plain.cost and f[0] < at < f[-1]
    return (at, damping) if shows_mode else None
