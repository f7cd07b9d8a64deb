"""Columns that are unsuitable for identification: by their values, or by their order in time."""

from collections.abc import Sequence

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.hysteresis.identification.cycles import RecordSection, cycles, held_samples
from flexstage.hysteresis.identification.faults import likely_shifts, shift_text
from flexstage.hysteresis.identification.range_end import butterfly, butterfly_text
from flexstage.hysteresis.requests import OSCILLATOR
from flexstage.records import Channel, Record

#: Fewest samples, and of a period or a table: turning points must remain.
LEAST_SAMPLES, LEAST_ROWS = 50, 20
#: Ranges of a column whose squares and products are finite.
_FINITE = 1e-60, 1e60
#: Smallest correlation of an output that follows its input.
_UNRELATED = 0.1
#: Smallest coherent share of the power of an output that follows its input, ...
_COHERENT = 0.5
#: ... and segments of its spectra: with fewer a random walk is coherent with a loop by chance; with
#: more the resonance of a stage is not resolved.
_SEGMENTS = 4
#: Smallest power of an excited line, over the largest.
_EXCITED = 1e-3
#: A loop narrower than this share of its box does not show which column leads.
_NARROW_LOOP = 0.004
#: Smallest swing of a loop that does, as a share of the range.
_LOOP = 0.05


def require_usable(
    record: Record, input_channel: Channel, output_channel: Channel, least: int = LEAST_SAMPLES
) -> None:
    """Refuse an unusable input or output.

    Samples of the output may be missing where the record has none, as in a table of branches.
    """
    for channel in (input_channel, output_channel):
        where = f"column '{channel.name}' of {record.source or 'the record'}"
        values = channel.values
        rows = record.numbers if channel is output_channel else None
        if rows is not None and np.isnan(rows).any():
            values, least = values[~np.isnan(rows)], LEAST_ROWS
        if values.size < least:
            raise RecordError(f"{where} has {values.size} samples: at least {least} are needed")
        if not np.all(np.isfinite(values)):
            first = int(np.argmin(np.isfinite(values)))
            raise RecordError(f"{where} is {values[first]} at sample {first}: correct the record")
        size = float(np.ptp(values))
        if not size > 1e-13 * float(np.max(np.abs(values))):
            raise RecordError(f"{where} is constant at {values[0]:g}: select a column that changes")
        low, high = _FINITE
        if not low < size < high:
            raise RecordError(
                f"{where} has a range of {size:.3g}, which must be {low:g} to {high:g}: give it "
                "another unit"
            )
    if not record.uniform:
        raise RecordError(
            f"{record.source or 'the record'} is not uniformly sampled: resample it at a constant "
            "rate"
        )


def sign_of(pairs: Sequence[tuple[Record, Channel, Channel]]) -> float:
    """Return the sign of the outputs over the inputs; a RecordError if they are uncorrelated."""
    signs = {_sign(*pair) for pair in pairs}
    if len(signs) > 1:
        raise RecordError("the output rises with the input in one record and falls in another")
    return signs.pop()


def _sign(record: Record, input_channel: Channel, output_channel: Channel) -> float:
    u, y, rate = input_channel.values, output_channel.values, record.sample_rate_hz
    measured = np.isfinite(y)
    share = float(np.corrcoef(u[measured], y[measured])[0, 1])
    if abs(share) >= _UNRELATED:
        return float(np.sign(share))
    moves = cycles(u, 1.0 / rate)
    turn = butterfly(u, y, moves) if moves.bounds.size > 1 else None
    if turn is not None:
        raise RecordError(butterfly_text(turn, input_channel.unit))
    names = f"'{output_channel.name}' of {record.source or 'the record'}", input_channel.name
    coherence, frequency = _coherence(u, y, rate)
    shifts = likely_shifts(u, y, 0) if measured.all() else ()
    shift = shifts[0] / rate if shifts else 0.0
    # a resonance shifts by less than a period
    if coherence > _COHERENT and abs(shift) * frequency < 1.0:
        raise RecordError(
            f"column {names[0]} follows '{names[1]}' (coherence {coherence:.2f}), but resonates or "
            f"lags within its band, with the largest gain at {frequency:.3g} Hz: move slower than "
            f"a tenth of that, or identify a resonant stage with --model {OSCILLATOR}"
        )
    remedy = shift_text(shift) if shift else (
        f"select columns that belong together; a stage that resonates needs --model {OSCILLATOR}"
    )  # fmt: skip
    raise RecordError(
        f"column {names[0]} does not follow '{names[1]}' (correlation {share:.3f}, coherence "
        f"{coherence:.2f}): {remedy}"
    )


def _coherence(u: Array, y: Array, rate: float) -> tuple[float, float]:
    """Return the coherent share of the power of an output, and the frequency of the largest gain.

    A lag or a resonance changes the correlation, and not the coherence (Bendat and Piersol 2010).
    """
    from scipy.signal import csd, welch

    length = max(u.size // _SEGMENTS, 16)
    y = np.where(np.isfinite(y), y, np.nanmean(y))
    frequency, cross = csd(u, y, rate, nperseg=length)
    power_in, power_out = (welch(signal, rate, nperseg=length)[1] for signal in (u, y))
    excited = power_in > _EXCITED * power_in.max()
    gain = np.abs(cross[excited]) / power_in[excited]
    share = np.sum(np.abs(cross[excited]) ** 2 / power_in[excited]) / np.sum(power_out)
    return float(share), float(frequency[excited][np.argmax(gain)])


def require_order(sections: Sequence[RecordSection], input_name: str, output_name: str) -> None:
    """Refuse an output that leads: the output of a drive always lags."""
    loops = [pair for s in sections if s.measured is None for pair in _loop_areas(s)]
    areas, boxes = np.array([(0.0, 0.0), *loops]).T
    total = max(float(boxes.sum()), 1e-300)
    mean = float(areas.sum()) / total
    error = float(np.linalg.norm(areas - mean * boxes)) / total
    if mean < -max(_NARROW_LOOP, 3.0 * error):
        hold = max(held_samples(s.u) for s in sections)
        late = f", '{input_name}' is read too rarely (it is constant for {hold} samples at a time)"
        raise RecordError(
            f"the output leads the input: column '{output_name}' moves before '{input_name}' (the "
            f"loop runs in reverse, {100 * mean:.1f} % of its box); check whether the columns are "
            f"swapped{late if hold > 1 else ''} or the output lags by half a cycle or more"
        )


def _loop_areas(section: RecordSection) -> list[tuple[float, float]]:
    """Signed area of each loop, positive if the output lags, and area of its box."""
    areas = []
    c = section.cycles
    for first, stop, swing in zip(c.bounds[:-1], c.bounds[1:] + 1, c.swing, strict=True):
        if swing >= _LOOP:
            u, y = section.u[first:stop], section.y[first:stop]
            # closed by a straight line, as drift, and a random walk, leave a gap
            gap = 0.5 * (y[-1] + y[0]) * (u[0] - u[-1])
            area = -float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(u)) + gap)
            areas.append((area, float(np.ptp(u) * np.ptp(y))))
    return areas
