"""Responses to repeated excitations: periods, hits of a hammer, steps of a drive."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array, Complex, Integers
from flexstage.base.errors import RecordError
from flexstage.measure.spectra.averaging import SegmentSpectra, line_frequencies, single_sided
from flexstage.measure.spectra.checks import HitOptions, PeriodOptions, Signals
from flexstage.measure.spectra.sums import Spectra, SumOfSpectra
from flexstage.records import saturation
from flexstage.records.quality import RMS_OVER_MEDIAN, quantisation_step

# significant fraction of a sample, and the least share of the dissimilarity that it explains
_FRACTION = 0.01
_EXPLAINED = 0.1
# shift of a maximum by samples at the edges, times the number of overlapping samples
_EDGE = 4.0
# share that noise alone may seem to explain, times the number of overlapping samples
_CHANCE = 30.0
# least ratio of the mean power of an excited line to its variance from period to period
_EXCITED = 10.0
# level of a contact, in rms of the noise
_ABOVE_NOISE = 6.0


def self_similarity(values: Array) -> Array:
    """Return the normalised autocorrelation of a signal.

    r_l = 2 sum_t x_t x_(t+l) / sum_t (x_t^2 + x_(t+l)^2), over the overlapping samples, of the
    signal minus its mean: 1 for an exact copy only. At lags from 0 to n / 2, shape (n // 2 + 1,).
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
    """Return the period of a repeated signal [samples].

    It is the least lag of largest self-similarity, within noise. The record must have at least two
    periods.

    Validity
    --------
    An integer number of samples per period, and a signal-to-noise ratio above about ten.

    Examples
    --------
    >>> t = np.arange(500)
    >>> find_period(np.sin(2 * np.pi * t / 125) + np.cos(10 * np.pi * t / 125))
    125
    """
    r = self_similarity(np.asarray(values, dtype=np.float64))
    inner = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] >= r[2:])) + 1
    best = float(r[inner].max()) if inner.size else 0.0
    # least self-similarity of a periodic signal
    least_similarity = 0.9
    if best < least_similarity:
        raise RecordError(
            f"'{name}' is not periodic: its largest self-similarity within half of its "
            f"{r.size * 2 - 2} samples is {100.0 * best:.3g} %; record at least two periods, give "
            "the samples of a period, or use another kind of excitation"
        )
    # allowance for rounding errors of the similarity
    rounding = 1e-9
    good = inner[1.0 - r[inner] <= 2.0 * (1.0 - best) + rounding]
    period = int(good[0])
    # the vertex of a parabola through the similarity at the period and next to it
    before, at, after = r[period - 1], r[period], r[period + 1]
    bend = 2.0 * at - before - after
    fraction = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
    gain, overlap = 0.5 * bend * fraction**2, len(values) - period
    explained = _EXPLAINED + _CHANCE / overlap
    if abs(fraction) > _FRACTION + _EDGE / overlap and gain > explained * (1.0 - at):
        raise RecordError(
            f"the period of '{name}' is {period + fraction:.6g} samples, not an integer number: "
            "choose clock and period so that it is, or resample the record"
        )
    return period


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicResponse:
    """Response to a periodic excitation at its excited lines."""

    spectra: Spectra
    """Densities of the mean period at these lines, the output's with its noise."""
    response: Complex
    """Output over input, shape (k, outputs, inputs)."""
    variance: Array | None
    """Expected square of its error, shape (k, outputs, inputs); None for a single period."""
    coherence: Array | None
    """Share of the power of an output that is periodic [1], shape (k, outputs)."""
    period: int
    """Samples per period."""
    dropped: tuple[int, ...]
    """Omitted settling periods at the start of each record."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """Mean periods of one record, and sums of squares of the deviations from the first period."""

    mean: Complex
    deviations: SumOfSpectra
    drift: Complex
    periods: int


def periodic_response(
    signals: Signals, options: PeriodOptions, power_floor: float
) -> PeriodicResponse:
    """Return the response to a periodic excitation.

    H = (sum_r m_r Y_r X_r^H) (sum_r m_r X_r X_r^H)^-1 over the mean periods X, Y of the records r
    with m_r periods: with one record and one input the ratio of the mean spectra, without bias by
    noise of either side (Pintelon and Schoukens, System Identification, 2nd edition, 2012, chapter
    2). The variance is that of Y - H X from period to period, so that common noise of input and
    output counts once. Several inputs need at least as many records, with different phases of the
    inputs. A line whose power is below the floor, a share of the strongest, is not excited.

    Validity
    --------
    A steady state, an integer number of samples per period, and noise without correlation between
    periods.
    """
    q = signals.inputs
    period = options.samples or _common_period(signals)
    if len(signals.channels) < q:
        raise RecordError(
            f"{q} periodic inputs need at least {q} records, with different phases of the inputs, "
            f"got {len(signals.channels)}; or drive them by random signals"
        )
    drops = tuple(_drop(signals, r, period, options) for r in range(len(signals.channels)))
    runs = [_run(row, signals, period, d) for row, d in zip(signals.channels, drops, strict=True)]
    lines = np.arange(1, (period - 1) // 2 + 1)
    total = sum(run.periods for run in runs)
    excited = _excited(runs, q, lines, power_floor)
    x = np.stack([run.mean[:q, excited] for run in runs])
    y = np.stack([run.mean[q:, excited] for run in runs])
    m = np.array([float(run.periods) for run in runs])
    xx = np.einsum("r,rik,rjk->kij", m, x, np.conj(x))
    yx = np.einsum("r,rok,rik->koi", m, y, np.conj(x))
    inverse = _inverse_power(xx)
    response = yx @ inverse
    noise = _residual_power(runs, response, excited, q)
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
        frequency_hz=line_frequencies(period, fs)[excited],
        input_power=scale / total * xx,
        cross=scale / total * yx,
        output_power=scale * density,
        segments=total,
        averages=float(total),
    )
    return PeriodicResponse(
        spectra=spectra,
        response=response,
        variance=variance,
        coherence=coherence,
        period=period,
        dropped=drops,
    )


def _common_period(signals: Signals) -> int:
    periods = {find_period(row[0], signals.names[0]) for row in signals.channels}
    if len(periods) > 1:
        raise RecordError(
            f"the records have periods of {', '.join(map(str, sorted(periods)))} samples: use "
            "records with equal periods, or give the samples of the period"
        )
    return periods.pop()


def _drop(signals: Signals, record: int, period: int, options: PeriodOptions) -> int:
    """Return the number of settling periods at the start."""
    row = signals.channels[record]
    count = row[0].size // period
    least = 2 if options.drop is None else options.drop + 1
    if count < least:
        raise RecordError(
            f"{signals.sources[record]} has {row[0].size / period:.3g} periods of {period} "
            f"samples, but {least} are needed: record longer"
        )
    if options.drop is not None:
        return options.drop
    unsettled = 0
    # largest deviation of a settled period from the last, over the usual deviation
    settled = 2.0
    for values in row[signals.inputs :]:
        periods = values[: count * period].reshape(count, period)
        away = np.array([np.linalg.norm(part - periods[-1]) for part in periods[:-1]])
        # late periods deviate by noise only: the median of the second half is the usual deviation
        usual = float(np.median(away[away.size // 2 :]))
        late = np.flatnonzero(away[: away.size // 2] > settled * usual)
        unsettled = max(unsettled, int(late[-1]) + 1 if late.size else 0)
    return unsettled


def _run(row: tuple[Array, ...], signals: Signals, period: int, drop: int) -> _Run:
    count = row[0].size // period - drop
    first = np.stack([np.fft.rfft(v[drop * period : (drop + 1) * period]) for v in row])
    deviations = SumOfSpectra(first.shape[1], signals.inputs, signals.outputs)
    drift = np.zeros_like(first)
    for number in range(count):
        part = slice((drop + number) * period, (drop + number + 1) * period)
        # minus the first period, so that the sums of squares do not cancel
        deviation = np.stack([np.fft.rfft(v[part]) for v in row]) - first
        deviations.add(deviation[:, None, :])
        drift += deviation
    return _Run(mean=first + drift / count, deviations=deviations, drift=drift, periods=count)


def _excited(runs: list[_Run], inputs: int, lines: Integers, floor: float) -> Integers:
    """Return the lines that each input excites in at least one record."""
    excited = np.ones(lines.size, dtype=bool)
    for i in range(inputs):
        power = np.max([np.abs(run.mean[i, lines]) ** 2 for run in runs], axis=0)
        noise = np.zeros(lines.size)
        for run in runs:
            if run.periods > 1:
                spread = run.deviations.power[i] - np.abs(run.drift[i]) ** 2 / run.periods
                spread = np.maximum(spread, 0.0) / ((run.periods - 1) * run.periods)
                noise = np.maximum(noise, spread[lines])
        excited &= (power > floor * power.max()) & (power > _EXCITED * noise)
    if excited.sum() < 2:
        raise RecordError(
            f"{int(excited.sum())} lines of the period are excited, but a response needs two: is "
            "the input the right column, and is the period long enough?"
        )
    return lines[excited]


def _inverse_power(xx: Complex) -> Complex:
    if xx.shape[1] == 1:
        return 1.0 / xx
    if np.any(np.linalg.cond(xx) > 1e10):
        raise RecordError(
            "the inputs of the records are not separable: repeat the measurement with different "
            "relative phases of the inputs, one record for each input"
        )
    return np.asarray(np.linalg.inv(xx), dtype=np.complex128)


def _residual_power(runs: list[_Run], response: Complex, excited: Integers, q: int) -> Array:
    """Return the sum of squares of Y - H X about its mean, over all periods."""
    total = np.zeros(response.shape[:2])
    for run in runs:
        xx, yx, yy = run.deviations.matrices()
        dx, dy = run.drift[:q, excited].T, run.drift[q:, excited].T
        n = run.periods
        xx = xx[excited] - dx[:, :, None] * np.conj(dx)[:, None, :] / n
        yx = yx[excited] - dy[:, :, None] * np.conj(dx)[:, None, :] / n
        yy = yy[excited] - np.abs(dy) ** 2 / n
        through = np.einsum("koi,kij,koj->ko", response, xx, np.conj(response)).real
        shared = np.einsum("koi,koi->ko", response, np.conj(yx)).real
        total += yy + through - 2.0 * shared
    return np.maximum(total, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse:
    """Part of a signal above a level."""

    start: int
    """First sample."""
    stop: int
    """Sample after the last."""

    @property
    def width(self) -> int:
        """Number of samples."""
        return self.stop - self.start


def find_pulses(values: Array, trigger: float) -> list[Pulse]:
    """Return the parts of a signal above a share of its maximum.

    The signal is 0 at rest; parts closer than half the width of the wider one are joined.

    Examples
    --------
    >>> find_pulses(np.array([0.0, 0.0, 3.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0]), 0.25)
    [Pulse(start=2, stop=4), Pulse(start=7, stop=8)]
    """
    above = values > trigger * float(values.max())
    edges = np.flatnonzero(np.diff(np.concatenate(([False], above, [False]))))
    pulses: list[Pulse] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if pulses and 2 * (start - pulses[-1].stop) < max(pulses[-1].width, stop - start):
            pulses[-1] = Pulse(start=pulses[-1].start, stop=stop)
        else:
            pulses.append(Pulse(start=start, stop=stop))
    return pulses


def starting_pulses(
    pulses: list[Pulse], size: int, pre: int, segment: int | None
) -> tuple[list[Pulse], int]:
    """Return the pulses that start a segment, and its length.

    `pre` samples of a segment are before its pulse. The default length follows from the gaps
    between pulses.
    """
    if not pulses:
        raise RecordError("the record has no hit: is the input the right column?")
    starts = np.array([p.start for p in pulses])
    gaps = np.diff(np.concatenate((starts, [size])))
    # without a segment length, pulses closer than this share of the longest gap belong together
    close = 0.1
    least = close * float(gaps.max()) if segment is None else float(segment - pre)
    first = [pulses[0]]
    for pulse in pulses[1:]:
        if pulse.start - first[-1].start >= least:
            first.append(pulse)
    if segment is None:
        from scipy.fft import prev_fast_len

        starts = [pulse.start for pulse in first]
        room = int(np.diff(starts).min()) if len(starts) > 1 else size - starts[0] + pre
        if room < 8:
            raise RecordError(f"hits are only {room} samples apart: give the samples of a segment")
        segment = int(prev_fast_len(room, real=True) or room)
    return first, segment


def second_contact(force: Array, pulse: Pulse, share: float, noise: float) -> tuple[int, float]:
    """Return the sample of a second contact of the hammer, and its size relative to the first.

    `share` is the least force of a contact, relative to the peak; `noise` the rms of the force at
    rest. Without a second contact the sample is -1.
    """
    peak = float(force[pulse.start : pulse.stop].max())
    level = max(share * peak, _ABOVE_NOISE * noise)
    low = np.flatnonzero(force[pulse.stop :] < level)
    if low.size == 0:
        return -1, 0.0
    # after the end of the main contact, which may oscillate about the level
    end = pulse.stop + int(low[0]) + max(pulse.width // 2, 1)
    later = force[end:]
    if later.size == 0 or later.max() <= level:
        return -1, 0.0
    at = end + int(np.argmax(later))
    return at, float(force[at]) / peak


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Transient:
    """Hit or step of a record: its start and its main pulse."""

    record: int
    start: int
    pulse: Pulse


def _upright(force: Array) -> Array:
    """Return the force with its rest at 0 and positive hits."""
    away = force - np.median(force)
    return away if away.max() >= -away.min() else -away


def _find(
    signals: Signals, forces: list[Array], options: HitOptions, segment: int | None
) -> tuple[list[_Transient], int, list[str]]:
    """Return the transients of all records, their common length, and rejected ones."""
    transients: list[_Transient] = []
    rejected: list[str] = []
    lengths: list[int] = []
    pulses = [find_pulses(f, options.trigger) for f in forces]
    widths = [p.width for row in pulses for p in row]
    pre = options.pre_trigger
    if pre is None:
        pre = min(2 * max(widths) + 4, *(row[0].start for row in pulses))
    rows = []
    for force, row in zip(forces, pulses, strict=True):
        first, length = starting_pulses(row, force.size, pre, segment)
        rows.append(first)
        lengths.append(length)
    length = min(lengths)
    for number, first in enumerate(rows):
        size = forces[number].size
        for pulse in first:
            start = pulse.start - pre
            if start < 0 or start + length > size:
                where = "begins before" if start < 0 else "ends after"
                rejected.append(f"{_place(signals, number, pulse.start)}: {where} the record")
                continue
            transients.append(_Transient(record=number, start=start, pulse=pulse))
    return transients, length, rejected


def _place(signals: Signals, record: int, sample: int) -> str:
    time = signals.start[record] + sample / signals.sample_rate_hz
    where = f" of {signals.sources[record]}" if len(signals.sources) > 1 else ""
    return f"the one at {time:.6g} s{where}"


def _require_some(transients: list[_Transient], rejected: list[str], kind: str) -> None:
    if not transients:
        raise RecordError(
            f"no {kind} is usable: "
            + "; ".join(rejected[:5])
            + ("; and more" if len(rejected) > 5 else "")
        )


def hammer_spectra(
    signals: Signals, options: HitOptions, segment: int | None = None
) -> SegmentSpectra:
    """Return averages over the hits of a hammer.

    An exponential window on both force and motion, exp(-a t) from the start of a hit, moves every
    pole of the response by -a along the real axis. Double and clipped hits are rejected. The
    default segment is the shortest time between hits.
    """
    forces = [_upright(row[0]) for row in signals.channels]
    candidates, length, rejected = _find(signals, forces, options, segment)
    noise = [RMS_OVER_MEDIAN * float(np.median(np.abs(f))) for f in forces]
    hits = []
    for hit in candidates:
        fault = _fault(signals, forces, hit, length, options, noise[hit.record])
        if fault:
            rejected.append(f"{_place(signals, hit.record, hit.pulse.start)}: {fault}")
        else:
            hits.append(hit)
    _require_some(hits, rejected, "hit")
    share = options.exponential
    rate = 0.0 if share is None else -math.log(share) * signals.sample_rate_hz / length
    decay = np.exp(-rate / signals.sample_rate_hz * np.arange(length))
    parts = []
    for hit in hits:
        before = slice(hit.start, hit.pulse.start)
        row = []
        for number, values in enumerate(signals.channels[hit.record]):
            part = values[hit.start : hit.start + length]
            if number == 0:
                part = part - np.median(values)
            elif share is not None and hit.pulse.start > hit.start:
                # a constant offset is one line without a window, but many with one
                part = part - values[before].mean()
            row.append(part * decay if share is not None else part)
        parts.append(row)
    return _averaged(signals, parts, length, rejected, rate)


def _fault(
    signals: Signals,
    forces: list[Array],
    hit: _Transient,
    length: int,
    options: HitOptions,
    noise: float,
) -> str:
    """Return the fault of a hit; empty for a usable one."""
    within = slice(hit.start, hit.start + length)
    force = forces[hit.record][within]
    peak = float(force.max())
    if _clipped(force, peak):
        return f"the force is clipped at {_level(signals.channels[hit.record][0][within]):g}"
    pulse = Pulse(start=hit.pulse.start - hit.start, stop=hit.pulse.stop - hit.start)
    at, size = second_contact(force, pulse, options.bounce, noise)
    if at >= 0:
        later = 1e3 * (at - pulse.start) / signals.sample_rate_hz
        return f"a double hit, with {100.0 * size:.0f} % of the force again after {later:.3g} ms"
    names = signals.names[signals.inputs :]
    for name, values in zip(names, signals.channels[hit.record][1:], strict=True):
        part = values[within]
        if part.min() < part.max() and saturation(part).clipped:
            return f"'{name}' is clipped"
    return ""


def _clipped(force: Array, peak: float) -> bool:
    """Return whether the peak of a force is flat for three samples, other than by quantisation."""
    top = force == peak
    if not np.any(top[2:] & top[1:-1] & top[:-2]):
        return False
    step = quantisation_step(force)
    below = float(force[~top].max())
    return step == 0.0 or peak - below > 2.5 * step or saturation(force).clipped_high


def _level(force: Array) -> float:
    return float(force[int(np.argmax(np.abs(force - np.median(force))))])


def step_spectra(
    signals: Signals, options: HitOptions, segment: int | None = None
) -> SegmentSpectra:
    """Return averages over steps, from the differences of input and motion.

    A linear system responds to the differences of its input with the differences of its motion.
    Both end when the motion has settled: no window is needed, and no derivative is approximated. Of
    the options, `trigger` and `pre_trigger` apply. The default segment is the shortest time between
    steps.
    """
    changes = [np.abs(np.diff(row[0])) for row in signals.channels]
    steps, length, rejected = _find(signals, changes, options, segment)
    _require_some(steps, rejected, "step")
    parts = [
        [np.diff(v[s.start : s.start + length + 1]) for v in signals.channels[s.record]]
        for s in steps
    ]
    return _averaged(signals, parts, length, rejected, 0.0)


def _averaged(
    signals: Signals, parts: list[list[Array]], length: int, rejected: list[str], rate: float
) -> SegmentSpectra:
    sums = SumOfSpectra(length // 2 + 1, signals.inputs, signals.outputs)
    for row in parts:
        sums.add(np.stack([np.fft.rfft(part)[None, :] for part in row]))
    fs = signals.sample_rate_hz
    spectra = single_sided(
        sums, line_frequencies(length, fs), 2.0 / (fs * length), float(sums.segments), signals
    )
    return SegmentSpectra(
        spectra=spectra, segment=length, rejected=tuple(rejected), added_damping_rate=rate
    )
