"""Periods of a repeated excitation, and the response to it with its variance over them."""

from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex, Integers
from flexstage.base.errors import RecordError
from flexstage.measure.spectra.averaging import line_frequencies
from flexstage.measure.spectra.checks import PeriodOptions, Signals
from flexstage.measure.spectra.sums import Spectra, SumOfSpectra

# a fraction of a sample that matters, and the share of what a copy lacks that is due to it
_ASIDE = 0.01
_OWED = 0.1
# what the samples at the edges alone may shift a summit by, times the samples that overlap
_EDGE = 4.0
# and what noise alone may seem to be due to it, times the samples that overlap
_CHANCE = 30.0
# a line counts as excited where its mean is so many times its own variance from period to period
_EXCITED = 10.0


def likeness(values: Array) -> Array:
    """Return how much a signal is like itself some samples later.

    r_l = 2 sum_t x_t x_(t+l) / sum_t (x_t^2 + x_(t+l)^2), over the samples that overlap, of the
    signal less its mean: 1 for a copy and for nothing else. At lags from 0 to n / 2, shape (n // 2
    + 1,).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    x = values - values.mean()
    n = x.size
    lags = n // 2 + 1
    size = next_fast_len(n + lags, real=True)
    power = np.abs(np.asarray(rfft(x, size))) ** 2
    product = np.asarray(irfft(power, size))[:lags]
    energy = np.concatenate(([0.0], np.cumsum(x**2)))
    k = np.arange(lags)
    both = energy[n - k] + energy[n] - energy[k]
    return np.divide(2.0 * product, both, out=np.zeros(lags), where=both > 0.0)


def find_period(values: Array, name: str = "the input") -> int:
    """Return the period of a repeated signal.

    It is the least lag at which the signal is as like itself as at any, but for noise. In samples;
    the record holds two periods or more.

    Validity
    --------
    A whole number of samples in a period, and more than some ten times as much signal as noise.

    Examples
    --------
    >>> t = np.arange(500)
    >>> find_period(np.sin(2 * np.pi * t / 125) + np.cos(10 * np.pi * t / 125))
    125
    """
    r = likeness(np.asarray(values, dtype=np.float64))
    inner = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] >= r[2:])) + 1
    best = float(r[inner].max()) if inner.size else 0.0
    # a signal whose best copy of itself is less alike than this is not taken as repeated
    least_likeness = 0.9
    if best < least_likeness:
        raise RecordError(
            f"'{name}' does not repeat itself: its best copy within half of its {r.size * 2 - 2} "
            f"samples is {100.0 * best:.3g} % like it; record two periods at least, give the "
            "samples of a period, or take another kind of excitation"
        )
    # a copy that is worse than the best by no more than this counts as good
    rounding = 1e-9
    good = inner[1.0 - r[inner] <= 2.0 * (1.0 - best) + rounding]
    period = int(good[0])
    # the summit of a parabola through the likeness at the period and beside it
    before, at, after = r[period - 1], r[period], r[period + 1]
    bend = 2.0 * at - before - after
    aside = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
    gain, overlap = 0.5 * bend * aside**2, len(values) - period
    if abs(aside) > _ASIDE + _EDGE / overlap and gain > (_OWED + _CHANCE / overlap) * (1.0 - at):
        raise RecordError(
            f"'{name}' repeats itself after {period + aside:.6g} samples, which is not a whole "
            "number: choose clock and period so that it is, or resample the record"
        )
    return period


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repeated:
    """The response to a repeated excitation at the lines that it excites."""

    spectra: Spectra
    """Densities of the mean period at these lines, the output's with its noise."""
    response: Complex
    """Output over input, shape (k, outputs, inputs)."""
    variance: Array | None
    """Expected square of its error, shape (k, outputs, inputs); None where one period was kept."""
    coherence: Array | None
    """Share of the power of an output that repeats itself [1], shape (k, outputs)."""
    period: int
    """Samples in a period."""
    dropped: tuple[int, ...]
    """Periods left out at the start of each record."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """Mean periods of one record and sums of squares of what periods differ from them."""

    mean: Complex
    rest: SumOfSpectra
    drift: Complex
    periods: int


def periodic_response(signals: Signals, options: PeriodOptions, power_floor: float) -> Repeated:
    """Return the response to a repeated excitation.

    H = (sum_r m_r Y_r X_r^H) (sum_r m_r X_r X_r^H)^-1 over the mean periods X, Y of the records r
    with m_r periods: with one record and one input the ratio of the mean spectra, which noise of
    neither side biases (Pintelon and Schoukens, System Identification, 2nd edition, 2012, chapter
    2). The variance is that of Y - H X from period to period, so that noise that input and output
    share counts once. Several inputs need as many records at least, with the inputs in other
    phases. A line whose power is below the floor, a share of the strongest, is not excited.

    Validity
    --------
    A steady state, a whole number of samples in a period, and noise that one period does not
    remember of the one before.
    """
    q = signals.inputs
    period = options.samples or _common_period(signals)
    if len(signals.channels) < q:
        raise RecordError(
            f"{q} inputs that repeat together need as many records, with the inputs in other "
            f"phases in each, got {len(signals.channels)}; or drive them by random signals"
        )
    drops = tuple(_drop(signals, r, period, options) for r in range(len(signals.channels)))
    runs = [_run(row, signals, period, d) for row, d in zip(signals.channels, drops, strict=True)]
    lines = np.arange(1, (period - 1) // 2 + 1)
    total = sum(run.periods for run in runs)
    kept = _excited(runs, q, lines, power_floor)
    x = np.stack([run.mean[:q, kept] for run in runs])
    y = np.stack([run.mean[q:, kept] for run in runs])
    m = np.array([float(run.periods) for run in runs])
    xx = np.einsum("r,rik,rjk->kij", m, x, np.conj(x))
    yx = np.einsum("r,rok,rik->koi", m, y, np.conj(x))
    inverse = _solved(xx)
    response = yx @ inverse
    noise = _residual_power(runs, response, kept, q)
    explained = np.einsum("koi,kij,koj->ko", response, xx, np.conj(response)).real / total
    variance = coherence = None
    freedom = total - len(runs)
    if freedom > 0:
        power = noise / freedom
        variance = power[:, :, None] * np.einsum("kii->ki", inverse).real[:, None, :]
        both = explained + power
        coherence = np.divide(explained, both, out=np.ones_like(both), where=both > 0.0)
    fs = signals.sample_rate_hz
    scale = 2.0 / (fs * period)
    density = explained if freedom <= 0 else explained + noise / freedom
    spectra = Spectra(
        frequency_hz=line_frequencies(period, fs)[kept],
        input_power=scale / total * xx,
        cross=scale / total * yx,
        output_power=scale * density,
        segments=total,
        averages=float(total),
    )
    return Repeated(
        spectra=spectra,
        response=response,
        variance=variance,
        coherence=coherence,
        period=period,
        dropped=drops,
    )


def _common_period(signals: Signals) -> int:
    found = {find_period(row[0], signals.names[0]) for row in signals.channels}
    if len(found) > 1:
        raise RecordError(
            f"the records have periods of {', '.join(map(str, sorted(found)))} samples: give one "
            "period to all of them, or the samples of the period"
        )
    return found.pop()


def _drop(signals: Signals, record: int, period: int, options: PeriodOptions) -> int:
    """How many periods at the start are not settled."""
    row = signals.channels[record]
    whole = row[0].size // period
    least = 2 if options.drop is None else options.drop + 1
    if whole < least:
        raise RecordError(
            f"there are {row[0].size / period:.3g} periods of {period} samples in "
            f"{signals.sources[record]}, and {least} are needed: record longer"
        )
    if options.drop is not None:
        return options.drop
    unsettled = 0
    # a period counts as settled where it differs from the last no more than this times the usual
    settled = 2.0
    for values in row[signals.inputs :]:
        cut = values[: whole * period].reshape(whole, period)
        away = np.array([np.linalg.norm(part - cut[-1]) for part in cut[:-1]])
        # one period before the last differs by noise alone; the median of the later half says how
        usual = float(np.median(away[away.size // 2 :]))
        late = np.flatnonzero(away[: away.size // 2] > settled * usual)
        unsettled = max(unsettled, int(late[-1]) + 1 if late.size else 0)
    return unsettled


def _run(row: tuple[Array, ...], signals: Signals, period: int, drop: int) -> _Run:
    count = row[0].size // period - drop
    first = np.stack([np.fft.rfft(v[drop * period : (drop + 1) * period]) for v in row])
    rest = SumOfSpectra(first.shape[1], signals.inputs, signals.outputs)
    drift = np.zeros_like(first)
    for number in range(count):
        part = slice((drop + number) * period, (drop + number + 1) * period)
        # less the first period, so that the sums of squares do not cancel
        away = np.stack([np.fft.rfft(v[part]) for v in row]) - first
        rest.add(away[:, None, :])
        drift += away
    return _Run(mean=first + drift / count, rest=rest, drift=drift, periods=count)


def _excited(runs: list[_Run], inputs: int, lines: Integers, floor: float) -> Integers:
    """The lines that the inputs excite: each of them in one of the records at least."""
    excited = np.ones(lines.size, dtype=bool)
    for i in range(inputs):
        power = np.max([np.abs(run.mean[i, lines]) ** 2 for run in runs], axis=0)
        noise = np.zeros(lines.size)
        for run in runs:
            if run.periods > 1:
                spread = run.rest.power[i] - np.abs(run.drift[i]) ** 2 / run.periods
                spread = np.maximum(spread, 0.0) / ((run.periods - 1) * run.periods)
                noise = np.maximum(noise, spread[lines])
        excited &= (power > floor * power.max()) & (power > _EXCITED * noise)
    if excited.sum() < 2:
        raise RecordError(
            f"{int(excited.sum())} lines of the period are excited, and a response needs two: is "
            "the input the right column, and the period long enough?"
        )
    return lines[excited]


def _solved(xx: Complex) -> Complex:
    if xx.shape[1] == 1:
        return 1.0 / xx
    if np.any(np.linalg.cond(xx) > 1e10):
        raise RecordError(
            "the inputs of the records cannot be separated: repeat the measurement with other "
            "phases of one input against the others, one record for each input"
        )
    return np.asarray(np.linalg.inv(xx), dtype=np.complex128)


def _residual_power(runs: list[_Run], response: Complex, kept: Integers, q: int) -> Array:
    """Sum of squares of Y - H X about its mean, over all periods."""
    total = np.zeros(response.shape[:2])
    for run in runs:
        xx, yx, yy = run.rest.matrices()
        dx, dy = run.drift[:q, kept].T, run.drift[q:, kept].T
        n = run.periods
        xx = xx[kept] - dx[:, :, None] * np.conj(dx)[:, None, :] / n
        yx = yx[kept] - dy[:, :, None] * np.conj(dx)[:, None, :] / n
        yy = yy[kept] - np.abs(dy) ** 2 / n
        through = np.einsum("koi,kij,koj->ko", response, xx, np.conj(response)).real
        shared = np.einsum("koi,koi->ko", response, np.conj(yx)).real
        total += yy + through - 2.0 * shared
    return np.maximum(total, 0.0)
