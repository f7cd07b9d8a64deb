"""Averaged spectra over hits of a hammer, or steps of a drive."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.measure.spectra.averaging import CutSpectra, finished, line_frequencies
from flexstage.measure.spectra.checks import HitOptions, Signals
from flexstage.measure.spectra.sums import SumOfSpectra
from flexstage.records import saturation
from flexstage.records.quality import RMS_OVER_MEDIAN, quantisation_step

# a contact is told from noise at so many times its rms
_ABOVE_NOISE = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse:
    """A part of a signal above a level."""

    start: int
    """Its first sample."""
    stop: int
    """The sample behind its last."""

    @property
    def width(self) -> int:
        """Number of samples."""
        return self.stop - self.start


def find_pulses(values: Array, trigger: float) -> list[Pulse]:
    """Return the parts of a signal above a share of its greatest value.

    The signal is 0 at rest; parts nearer than half the wider one are one.

    Examples
    --------
    >>> find_pulses(np.array([0.0, 0.0, 3.0, 2.0, 0.1, 0.0, 0.0, 1.0, 0.0]), 0.25)
    [Pulse(start=2, stop=4), Pulse(start=7, stop=8)]
    """
    above = values > trigger * float(values.max())
    edges = np.flatnonzero(np.diff(np.concatenate(([False], above, [False]))))
    found: list[Pulse] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and 2 * (start - found[-1].stop) < max(found[-1].width, stop - start):
            found[-1] = Pulse(start=found[-1].start, stop=stop)
        else:
            found.append(Pulse(start=start, stop=stop))
    return found


def starting_pulses(
    pulses: list[Pulse], size: int, pre: int, segment: int | None
) -> tuple[list[Pulse], int]:
    """Return which pulses start a segment, and its length.

    `pre` samples of a segment are before its pulse. The length is found from the gaps between
    pulses where not given.
    """
    if not pulses:
        raise RecordError("no hit was found in the record: is the input the right column?")
    starts = np.array([p.start for p in pulses])
    gaps = np.diff(np.concatenate((starts, [size])))
    # without a length of segment, pulses nearer than this share of the longest gap belong together
    together = 0.1
    least = together * float(gaps.max()) if segment is None else float(segment - pre)
    first = [pulses[0]]
    for pulse in pulses[1:]:
        if pulse.start - first[-1].start >= least:
            first.append(pulse)
    if segment is None:
        from scipy.fft import prev_fast_len

        starts = [pulse.start for pulse in first]
        room = int(np.diff(starts).min()) if len(starts) > 1 else size - starts[0] + pre
        if room < 8:
            raise RecordError(
                f"there are {room} samples from one hit to the next: give the samples of a segment"
            )
        segment = int(prev_fast_len(room, real=True) or room)
    return first, segment


def second_contact(force: Array, pulse: Pulse, share: float, noise: float) -> tuple[int, float]:
    """Return where the hammer touches again after its main contact.

    `share` is what counts as a contact, relative to the peak; `noise` the rms of the force at rest.
    Returned are the sample of the second peak, -1 where there is none, and its size relative to the
    first.
    """
    peak = float(force[pulse.start : pulse.stop].max())
    level = max(share * peak, _ABOVE_NOISE * noise)
    low = np.flatnonzero(force[pulse.stop :] < level)
    if low.size == 0:
        return -1, 0.0
    # past the foot of the main contact, which may tremble about the level
    behind = pulse.stop + int(low[0]) + max(pulse.width // 2, 1)
    rest = force[behind:]
    if rest.size == 0 or rest.max() <= level:
        return -1, 0.0
    at = behind + int(np.argmax(rest))
    return at, float(force[at]) / peak


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """A transient of a record: where it starts, and its main pulse."""

    record: int
    start: int
    pulse: Pulse


def _upright(force: Array) -> Array:
    """The force at rest at 0, with its hits upward."""
    away = force - np.median(force)
    return away if away.max() >= -away.min() else -away


def _find(
    signals: Signals, forces: list[Array], options: HitOptions, segment: int | None
) -> tuple[list[_Found], int, list[str]]:
    """Find the transients of all records, and a length that suits them all."""
    found: list[_Found] = []
    left_out: list[str] = []
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
                left_out.append(f"{_place(signals, number, pulse.start)}: {where} the record")
                continue
            found.append(_Found(record=number, start=start, pulse=pulse))
    return found, length, left_out


def _place(signals: Signals, record: int, sample: int) -> str:
    time = signals.start[record] + sample / signals.sample_rate_hz
    where = f" of {signals.sources[record]}" if len(signals.sources) > 1 else ""
    return f"the one at {time:.6g} s{where}"


def _require_some(kept: list[_Found], left_out: list[str], what: str) -> None:
    if not kept:
        raise RecordError(
            f"no {what} is left: "
            + "; ".join(left_out[:5])
            + ("; and more" if len(left_out) > 5 else "")
        )


def hammer_spectra(signals: Signals, options: HitOptions, segment: int | None = None) -> CutSpectra:
    """Return averages over the hits of a hammer.

    An exponential window on force and motion alike, exp(-a t) from the start of a hit, moves every
    pole of the response by -a along the real axis. Double hits and such as are cut off are left
    out. A segment is as long as from one hit to the next at the closest where not given.
    """
    forces = [_upright(row[0]) for row in signals.channels]
    found, length, left_out = _find(signals, forces, options, segment)
    noise = [RMS_OVER_MEDIAN * float(np.median(np.abs(f))) for f in forces]
    kept = []
    for hit in found:
        why = _fault(signals, forces, hit, length, options, noise[hit.record])
        if why:
            left_out.append(f"{_place(signals, hit.record, hit.pulse.start)}: {why}")
        else:
            kept.append(hit)
    _require_some(kept, left_out, "hit")
    share = options.exponential
    rate = 0.0 if share is None else -math.log(share) * signals.sample_rate_hz / length
    decay = np.exp(-rate / signals.sample_rate_hz * np.arange(length))
    parts = []
    for hit in kept:
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
    return _averaged(signals, parts, length, left_out, rate)


def _fault(
    signals: Signals,
    forces: list[Array],
    hit: _Found,
    length: int,
    options: HitOptions,
    noise: float,
) -> str:
    """Why a hit is of no use; empty where it is."""
    within = slice(hit.start, hit.start + length)
    force = forces[hit.record][within]
    peak = float(force.max())
    if _cut_off(force, peak):
        return f"the force is cut off at {_level(signals.channels[hit.record][0][within]):g}"
    pulse = Pulse(start=hit.pulse.start - hit.start, stop=hit.pulse.stop - hit.start)
    at, size = second_contact(force, pulse, options.bounce, noise)
    if at >= 0:
        later = 1e3 * (at - pulse.start) / signals.sample_rate_hz
        return f"a double hit, with {100.0 * size:.0f} % of the force again after {later:.3g} ms"
    names = signals.names[signals.inputs :]
    for name, values in zip(names, signals.channels[hit.record][1:], strict=True):
        part = values[within]
        if part.min() < part.max() and saturation(part).clipped:
            return f"'{name}' is cut off"
    return ""


def _cut_off(force: Array, peak: float) -> bool:
    """Whether the peak of a force is flat for three samples that a converter's step is not why."""
    top = force == peak
    if not np.any(top[2:] & top[1:-1] & top[:-2]):
        return False
    step = quantisation_step(force)
    below = float(force[~top].max())
    return step == 0.0 or peak - below > 2.5 * step or saturation(force).clipped_high


def _level(force: Array) -> float:
    return float(force[int(np.argmax(np.abs(force - np.median(force))))])


def step_spectra(signals: Signals, options: HitOptions, segment: int | None = None) -> CutSpectra:
    """Return averages over steps, from the differences of input and motion.

    Between samples a linear system answers the differences of its input with the differences of its
    motion, which both end where the motion comes to rest: no window is needed, and no derivative is
    approximated. Of the options `trigger` and `pre_trigger` count. A segment is as long as from one
    step to the next at the closest where not given.
    """
    changes = [np.abs(np.diff(row[0])) for row in signals.channels]
    found, length, left_out = _find(signals, changes, options, segment)
    _require_some(found, left_out, "step")
    parts = [
        [np.diff(v[s.start : s.start + length + 1]) for v in signals.channels[s.record]]
        for s in found
    ]
    return _averaged(signals, parts, length, left_out, 0.0)


def _averaged(
    signals: Signals, parts: list[list[Array]], length: int, left_out: list[str], rate: float
) -> CutSpectra:
    sums = SumOfSpectra(length // 2 + 1, signals.inputs, signals.outputs)
    for row in parts:
        sums.add(np.stack([np.fft.rfft(part)[None, :] for part in row]))
    fs = signals.sample_rate_hz
    spectra = finished(
        sums, line_frequencies(length, fs), 2.0 / (fs * length), float(sums.segments), signals
    )
    return CutSpectra(
        spectra=spectra, segment=length, left_out=tuple(left_out), added_damping_rate=rate
    )
