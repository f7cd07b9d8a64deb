"""Lines of the mains in a reading."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.estimate import Estimate

#: Share by which the mains frequency strays, and at which a line counts as a multiple of it.
_STRAY = 0.004
#: Chance that noise alone gives a line.
_FALSE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class MainsLine:
    """A line at the mains frequency or a multiple of it."""

    frequency_hz: float
    """Where it is [Hz]."""
    mains_hz: int
    """The mains: 50 or 60."""
    multiple: int
    """Which multiple of it."""
    rms: Estimate
    """Its rms, in the unit of the reading."""


def mains_lines(
    values: ArrayLike, sample_rate_hz: float, *, unit: str = "m"
) -> tuple[MainsLine, ...]:
    """Return the lines at 50 or 60 Hz and their multiples that stand out of the noise.

    The whole record is one segment with a Hann window. A line is a peak within 0.4 % of a multiple
    that noise of the height around it would show in one of 10 000 searches; its frequency and
    amplitude are those of the sine of least squares there. Of 50 and 60 Hz the one with more power
    in its lines is named.

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    unit : str
        Unit of the readings.

    Returns
    -------
    tuple of MainsLine
        The lines, by frequency; none where there is none, or fewer than 25 periods.

    Validity
    --------
    A steady line: mains whose frequency wanders by more than 1 / record over the record gives less
    than its rms.

    Raises
    ------
    RecordError
        A reading is not finite.

    Examples
    --------
    >>> t = np.arange(20_000) / 2000.0
    >>> hum = 2e-9 * np.sin(2.0 * np.pi * 49.97 * t)
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(20_000)
    >>> line, = mains_lines(hum + noise, 2000.0)
    >>> print(f"{line.frequency_hz:.2f} Hz, {1e9 * line.rms.value:.2f} nm")
    49.97 Hz, 1.42 nm
    """
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise RecordError("the readings must be one finite number for each time")
    n = y.size
    if n * 50.0 < 25.0 * sample_rate_hz:
        return ()
    y = y - y.mean()
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    power = np.abs(np.fft.rfft(y * window)) ** 2
    found = {mains: _multiples(y, power, sample_rate_hz, mains, unit) for mains in (50, 60)}
    best = max(found.values(), key=lambda lines: sum(line.rms.value**2 for line in lines))
    return tuple(best)


def _multiples(y: Array, power: Array, rate: float, mains: int, unit: str) -> list[MainsLine]:
    n, lines = y.size, []
    for k in range(1, int(0.498 * rate / mains) + 1):
        at = k * mains * n / rate
        reach = max(int(_STRAY * at), 2)
        low, high = max(int(at) - reach, 1), min(int(at) + reach + 2, power.size)
        wide = max(8 * reach, 60)
        around = np.concatenate([power[max(low - wide, 1) : low], power[high : high + wide]])
        if high - low < 3 or around.size < 40:
            continue
        floor = float(np.median(around)) / math.log(2.0)
        peak = low + int(np.argmax(power[low:high]))
        if power[peak] > floor * math.log((high - low) / _FALSE):
            lines.append(_line(y, peak, rate, mains, k, unit))
    return lines


def _line(y: Array, peak: int, rate: float, mains: int, k: int, unit: str) -> MainsLine:
    from scipy.optimize import minimize_scalar

    t = (np.arange(y.size) - 0.5 * (y.size - 1)) / rate

    def fit(f: float) -> complex:
        return complex(2.0 / y.size * (y @ np.exp(-2j * np.pi * f * t)))

    width = rate / y.size
    best: Any = minimize_scalar(
        lambda f: -abs(fit(f)), bounds=((peak - 1.0) * width, (peak + 1.0) * width),
        method="bounded", options={"xatol": 1e-4 * width},
    )  # fmt: skip
    f = float(best.x)
    amplitude = fit(f)
    # noise about the line, from lines near it on both sides, beyond its own width
    near = [abs(fit(f + s * j * width)) ** 2 for s in (-1, 1) for j in range(2, 12)]
    uncertainty = math.sqrt(float(np.mean(near)) / 2.0)
    rms = Estimate.of(
        abs(amplitude) / math.sqrt(2.0),
        uncertainty / math.sqrt(2.0),
        unit,
        source="noise about the line",
        degrees_of_freedom=2.0 * len(near),
    )
    return MainsLine(frequency_hz=f, mains_hz=mains, multiple=k, rms=rms)
