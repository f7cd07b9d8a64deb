"""A measured input and output, prepared for identification."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.base.short_repr import short_repr
from flexstage.hysteresis.identification.cycles import (
    RecordSection,
    cycles,
    first_moving,
    held_samples,
    input_noise,
    memories,
    turning_points,
    warm_up,
)
from flexstage.hysteresis.identification.faults import (
    RecordFault,
    butterfly,
    butterfly_text,
    denoised,
    input_noise_warning,
    likely_shifts,
    record_faults,
    shift_text,
    without_spikes,
)
from flexstage.hysteresis.requests import OSCILLATOR, Zero
from flexstage.quantities.units import readable
from flexstage.records import Channel, Record
from flexstage.records.quality import difference_noise, quantisation_step


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Limits of suitable columns."""

    narrow_loop: float = 0.004
    """A loop narrower than this share of its box does not show which column leads."""
    loop: float = 0.05
    """Smallest swing of a loop that does, as a share of the range."""
    unrelated: float = 0.1
    """Smallest correlation of an output that follows its input."""
    coherent: float = 0.5
    """Smallest coherent share of the power of an output that follows its input."""
    segments: int = 4
    """Segments of its spectra: with fewer a random walk is coherent with a loop by chance; with
    more the resonance of a stage is not resolved.
    """
    excited: float = 1e-3
    """Smallest power of an excited line, over the largest."""
    finite: tuple[float, float] = (1e-60, 1e60)
    """Ranges of a column whose squares and products are finite."""
    gain: tuple[float, float] = (1e-10, 1e-4)
    """Motion of drives [m/V]: films and shear plates of quartz move by less than 1 nm/V, amplified
    stages behind a control voltage of some volts by up to 100 um/V.
    """
    voltage: float = 2e4
    """Largest range of the voltage of a drive [V]."""
    step: float = 0.003
    """A step of the converter above this share of the stroke exceeds the error of a good model."""


_THRESHOLDS = _Thresholds()


@dataclass(frozen=True, slots=True)
class _Period:
    """Limits of a record that is one period of a steady motion."""

    major: float = 0.9
    """Smallest swing of the one major cycle, as a share of the range, as elsewhere."""
    cycles: int = 2
    """Most complete cycles of a record that is taken for a period by itself: with more of them the
    record shows by its own cycles how far they repeat.
    """
    steps: float = 1.5
    """Largest gap between the ends of a period, over the steps there: without a closing row it is
    one step.
    """
    noise: float = 5.0
    """The same, over the standard deviation of the noise."""
    largest_gap: float = 0.1
    """Largest gap beyond these of a record that is said to be a period, as a share of the range."""
    repeats: int = 4
    """Periods before the record, after which also a memory that only fades repeats."""
    samples: int = 20
    """Fewest samples, as of a table: turning points must remain."""


_PERIOD = _Period()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentificationData:
    """Prepared records of an identification."""

    sections: tuple[RecordSection, ...]
    """One of each record."""
    sign: float
    """1 if the output rises with the input, -1 if it falls."""
    input_unit: str
    """Unit of the input; empty if unknown."""
    output_unit: str
    """Unit of the output; empty if unknown."""
    stroke: float
    """Range of the output after the warm-up, in its unit."""
    warnings: tuple[str, ...]
    """Quantities that the records do not determine, and missing experiments."""
    findings: tuple[RecordFault, ...] = ()
    """Faults: removed spikes, clipping, butterfly loops."""
    zero: Zero = "one"
    """Zero of the output; with a drift, the last nuisance column is its rise over the record."""

    __repr__ = short_repr

    @property
    def input_range(self) -> tuple[float, float]:
        """Lowest and highest input."""
        return (
            min(s.cycles.range[0] for s in self.sections),
            max(s.cycles.range[1] for s in self.sections),
        )

    @property
    def periodic(self) -> bool:
        """True if each record is one period of a steady motion."""
        return bool(self.sections) and all(s.periodic for s in self.sections)

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Rates of the cycles of all records, that differ by more than half [Hz]."""
        return rates_of([f for s in self.sections for f in s.cycles.rates_hz])


def measurement(
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    *,
    zero: Zero = "one",
    periodic: bool | None = None,
) -> IdentificationData:
    """Prepare records for identification, after checking that they are suitable.

    Parameters
    ----------
    records : sequence of Record
        Records of the same drive, at any rates.
    input_column : str or int
        The column that drives.
    output_column : str or int
        The column that follows.
    zero : {"one", "each", "drift"}
        Zero of the output; a drift of constant speed is fitted to each record, with the model.
    periodic : bool, optional
        True if each record is one period of a steady motion; where not given, records are that
        close and have one major cycle.

    Returns
    -------
    IdentificationData
        The prepared sections.

    Raises
    ------
    RecordError
        A column is missing or constant, the sampling is not uniform, the output leads the input,
        or does not follow it.
    """
    if not records:
        raise RecordError("an identification needs at least one record, got none")
    pairs = [(r, r.channel(input_column), r.channel(output_column)) for r in records]
    for _, i, o in pairs:
        if i is o:
            raise RecordError(
                f"input and output are the same column, '{i.name}': select the command and the "
                "measured output"
            )
    units = {(i.unit, o.unit) for _, i, o in pairs}
    if len(units) > 1:
        raise RecordError(f"the records have different units: {sorted(units)}; give them by option")
    for r, i, o in pairs:
        require_usable(r, i, o, _PERIOD.samples if periodic else 50)
    complete = [bool(np.isfinite(o.values).all()) for _, _, o in pairs]
    no_spikes = np.zeros(0, dtype=np.intp)
    despiked = [
        without_spikes(i.values, o.values) if all_ else (o.values, no_spikes)
        for (_, i, o), all_ in zip(pairs, complete, strict=True)
    ]
    pairs = [
        (r, i, replace(o, values=y)) for (r, i, o), (y, _) in zip(pairs, despiked, strict=True)
    ]
    sign = _sign(pairs)
    prepared = [
        _section(i.values, sign * o.values, 1.0 / r.sample_rate_hz, r.source, zero, periodic)
        for r, i, o in pairs
    ]
    sections, open_ends = tuple(s for s, _ in prepared), tuple(text for _, text in prepared if text)
    _require_order(sections, pairs[0][1].name, pairs[0][2].name)
    stroke = max(float(np.ptp(s.y[s.warm_up :])) for s in sections)
    data = IdentificationData(
        sections=sections,
        sign=sign,
        input_unit=pairs[0][1].unit,
        output_unit=pairs[0][2].unit,
        stroke=stroke,
        warnings=(),
        zero=zero,
    )
    findings = [
        record_faults(k, without_history(s), spikes, sign, (data.input_unit, data.output_unit))
        for k, (s, (_, spikes)) in enumerate(zip(sections, despiked, strict=True))
        if s.measured is None
    ]
    return replace(
        data,
        warnings=(*open_ends, *_warnings(data)),
        findings=tuple(f for section_findings in findings for f in section_findings),
    )


def rates_of(rates_hz: Sequence[float]) -> tuple[float, ...]:
    """Return rates [Hz] in rising order, without those less than half above another."""
    rates: list[float] = []
    for f in sorted(rates_hz):
        if not rates or f > 1.5 * rates[-1]:
            rates.append(f)
    return tuple(rates)


def require_usable(
    record: Record, input_channel: Channel, output_channel: Channel, least: int = 50
) -> None:
    """Refuse an unusable input or output.

    Samples of the output may be missing where the record has none, as in a table of branches.
    """
    _require_column(record, input_channel, least, gaps=False)
    _require_column(record, output_channel, least, gaps=True)
    if not record.uniform:
        raise RecordError(
            f"{record.source or 'the record'} is not uniformly sampled: resample it at a constant "
            "rate"
        )


def _require_column(record: Record, channel: Channel, least: int, *, gaps: bool) -> None:
    where = f"column '{channel.name}' of {record.source or 'the record'}"
    values = channel.values
    if gaps and record.numbers is not None and np.isnan(record.numbers).any():
        values, least = values[~np.isnan(record.numbers)], _PERIOD.samples
    if values.size < least:
        raise RecordError(f"{where} has {values.size} samples: at least {least} are needed")
    if not np.all(np.isfinite(values)):
        first = int(np.argmin(np.isfinite(values)))
        raise RecordError(f"{where} is {values[first]} at sample {first}: correct the record")
    size = float(np.ptp(values))
    if not size > 1e-13 * float(np.max(np.abs(values))):
        raise RecordError(f"{where} is constant at {values[0]:g}: select a column that changes")
    low, high = _THRESHOLDS.finite
    if not low < size < high:
        raise RecordError(
            f"{where} has a range of {size:.3g}, which must be {low:g} to {high:g}: give it "
            "another unit"
        )


def _sign(pairs: Sequence[tuple[Record, Channel, Channel]]) -> float:
    """Sign of the output over the input; a RecordError if they are uncorrelated."""
    signs = []
    for r, i, o in pairs:
        measured = np.isfinite(o.values)
        share = float(np.corrcoef(i.values[measured], o.values[measured])[0, 1])
        if abs(share) < _THRESHOLDS.unrelated:
            moves = cycles(i.values, 1.0 / r.sample_rate_hz)
            turn = butterfly(i.values, o.values, moves) if moves.bounds.size > 1 else None
            if turn is not None:
                raise RecordError(butterfly_text(turn, i.unit))
            name = f"column '{o.name}' of {r.source or 'the record'}"
            coherence, frequency = _coherence(i.values, o.values, r.sample_rate_hz)
            shifts = likely_shifts(i.values, o.values, 0) if measured.all() else ()
            shift = shifts[0] / r.sample_rate_hz if shifts else 0.0
            # a resonance shifts by less than a period
            if coherence > _THRESHOLDS.coherent and abs(shift) * frequency < 1.0:
                raise RecordError(
                    f"{name} follows '{i.name}' (coherence {coherence:.2f}), but resonates or lags "
                    f"within its band, with the largest gain at {frequency:.3g} Hz: move slower "
                    f"than a tenth of that, or identify a resonant stage with --model {OSCILLATOR}"
                )
            together = (
                "select columns that belong together; a stage that resonates needs --model "
                f"{OSCILLATOR}"
            )
            raise RecordError(
                f"{name} does not follow '{i.name}' (correlation {share:.3f}, coherence "
                f"{coherence:.2f}): {shift_text(shift) if shift else together}"
            )
        signs.append(float(np.sign(share)))
    if len(set(signs)) > 1:
        raise RecordError("the output rises with the input in one record and falls in another")
    return signs[0]


def _coherence(u: Array, y: Array, rate: float) -> tuple[float, float]:
    """Return the coherent share of the power of an output, and the frequency of the largest gain.

    A lag or a resonance changes the correlation, and not the coherence (Bendat and Piersol 2010).
    """
    from scipy.signal import csd, welch

    length = max(u.size // _THRESHOLDS.segments, 16)
    y = np.where(np.isfinite(y), y, np.nanmean(y))
    frequency, cross = csd(u, y, rate, nperseg=length)
    power_in, power_out = (welch(signal, rate, nperseg=length)[1] for signal in (u, y))
    excited = power_in > _THRESHOLDS.excited * power_in.max()
    gain = np.abs(cross[excited]) / power_in[excited]
    share = np.sum(np.abs(cross[excited]) ** 2 / power_in[excited]) / np.sum(power_out)
    return float(share), float(frequency[excited][np.argmax(gain)])


def _section(
    u: Array, y: Array, dt: float, source: str, zero: Zero, periodic: bool | None
) -> tuple[RecordSection, str]:
    """Return a prepared record, and a warning about its ends."""
    source = source or "the record"
    loop = None if periodic is False else _closed_loop(u, y, source, bool(periodic))
    first, warning = first_moving(u), ""
    u, y = u[first:], y[first:]
    if loop is not None:
        u, y, first, warning = loop
    measured = np.isfinite(y)
    noise_removed = 0.0
    if measured.all():
        u, noise_removed = denoised(u, y)
    else:
        at = np.arange(y.size)
        y = np.interp(at, at[measured], y[measured])
    moves = cycles(u, dt, noise_removed, period=loop is not None)
    if moves.bounds.size < 2:
        raise RecordError(
            f"the input of {source} has no complete cycle, from one lower turning point to the "
            "next: identification needs at least one, better five, over the range of use; if it is "
            "one whole period of a steady motion, add --periodic"
        )
    # third differences contain the noise, and hardly any smooth motion; mostly none of a converter
    noise = max(difference_noise(y, 3), quantisation_step(y[measured]) / math.sqrt(12.0))
    section = RecordSection(
        u=np.ascontiguousarray(u),
        y=np.ascontiguousarray(y),
        dt=dt,
        cycles=moves,
        warm_up=warm_up(u, moves) if loop is None else 0,
        # 1, and time over duration for a drift
        nuisance=np.linspace(0.0, 1.0, u.size)[:, None] ** np.arange(1 + (zero == "drift")),
        noise=noise,
        input_noise=noise_removed,
        first=first,
        begin=first * dt,
        start="rested" if loop is None else "periodic",
        measured=None if measured.all() else measured,
    )
    return with_history(section), warning


@dataclass(frozen=True, slots=True)
class RecordEnds:
    """How a record closes if it is repeated."""

    samples: int
    """Samples of the period, without a closing row."""
    major_cycles: float
    """Major cycles of a period."""
    cycles: int
    """All cycles of a period."""
    gaps: tuple[float, float]
    """Gaps of input and output between its ends beyond steps and noise, as shares of the ranges."""

    @classmethod
    def of(cls, u: Array, y: Array) -> "RecordEnds":
        """Find the gaps of a complete record."""
        repeated, steps = np.tile(u, 3), (abs(u[1] - u[0]), abs(u[-1] - u[-2]))
        major = turning_points(repeated, _PERIOD.major * float(np.ptp(u)))
        return cls(
            samples=u.size - int(abs(u[-1] - u[0]) <= 0.5 * min(steps)),
            major_cycles=0.5 * np.count_nonzero(major // u.size == 1),
            cycles=int(np.count_nonzero(cycles(repeated, 1.0).bounds // u.size == 1)),
            gaps=(_gap(u, input_noise(u)), _gap(y, difference_noise(y, 3))),
        )

    @property
    def show_period(self) -> bool:
        """True for one major cycle that closes.

        A cycle that ends by chance at the reading of its begin is taken for a period, too.
        """
        few = self.major_cycles == 1.0 and self.cycles <= _PERIOD.cycles
        return few and max(self.gaps) <= 0.0


def _gap(x: Array, noise: float) -> float:
    allowed = _PERIOD.steps * max(abs(x[1] - x[0]), abs(x[-1] - x[-2])) + _PERIOD.noise * noise
    return max(float(abs(x[-1] - x[0]) - allowed), 0.0) / float(np.ptp(x))


def _closed_loop(
    u: Array, y: Array, source: str, stated: bool
) -> tuple[Array, Array, int, str] | None:
    """Return one period from its low end back to it, its first sample, and a warning of its ends.

    None if a record is not stated to be a period and does not show one.
    """
    first = int(np.argmax(np.isfinite(y)))  # rows before it only set the memory of a table
    u, y = u[first:], y[first:]
    if not np.isfinite(y).all():
        if stated:
            raise RecordError(f"{source} has unmeasured rows inside: omit --periodic")
        return None
    ends = RecordEnds.of(u, y)
    if stated and (ends.major_cycles != 1.0 or max(ends.gaps) > _PERIOD.largest_gap):
        raise RecordError(
            f"{source} has {ends.major_cycles:g} major cycles, and its ends differ by "
            f"{100 * ends.gaps[0]:.2g} % of the input range and {100 * ends.gaps[1]:.2g} % of the "
            "output range beyond noise: --periodic needs one major cycle and ends that differ by "
            f"at most {100 * _PERIOD.largest_gap:g} %; select one period by --rows, or omit "
            "--periodic"
        )
    if not stated and not ends.show_period:
        return None
    n = ends.samples
    order = (int(np.argmin(u[:n])) + np.arange(n + 1)) % n
    warning = (
        f"the ends of {source} differ by {100 * ends.gaps[1]:.2g} % of the output range beyond "
        "noise: the motion was not steady, or the sensor drifts or jumps within the period"
    )
    return u[order], y[order], first, warning if ends.gaps[1] > 0.0 else ""


def with_history(section: RecordSection) -> RecordSection:
    """Return a section that begins with the motion that set its memory.

    Before one period that is the turning points of several.
    """
    moves = section.cycles
    before = memories(moves.range, section.u[0])[section.memory]
    if section.periodic:
        before = np.tile(section.u[moves.turning], _PERIOD.repeats)
    n = before.size
    straight, known = section.straight, section.measured
    return replace(
        section,
        u=np.concatenate((before, section.u)),
        y=np.concatenate((np.full(n, section.y[0]), section.y)),
        cycles=replace(moves, bounds=moves.bounds + n, turning=moves.turning + n),
        warm_up=section.warm_up + n,
        nuisance=np.concatenate((section.nuisance[:1].repeat(n, axis=0), section.nuisance)),
        measured=None if known is None else np.concatenate((np.zeros(n, dtype=bool), known)),
        straight=None if straight is None else np.concatenate((np.ones(n, dtype=bool), straight)),
        history=n,
    )


def without_history(section: RecordSection) -> RecordSection:
    """Return the measured samples of a section."""
    n, moves, straight = section.history, section.cycles, section.straight
    return replace(
        section,
        u=section.u[n:],
        y=section.y[n:],
        cycles=replace(moves, bounds=moves.bounds - n, turning=moves.turning - n),
        warm_up=section.warm_up - n,
        nuisance=section.nuisance[n:],
        measured=None if section.measured is None else section.measured[n:],
        straight=None if straight is None else straight[n:],
        history=0,
    )


def _require_order(sections: Sequence[RecordSection], input_name: str, output_name: str) -> None:
    """Refuse an output that leads: the output of a drive always lags."""
    complete = [s for s in sections if s.measured is None]
    if not complete:
        return
    areas, boxes = np.concatenate([_loop_areas(s) for s in complete]).T
    total = max(float(boxes.sum()), 1e-300)
    mean = float(areas.sum()) / total
    error = float(np.linalg.norm(areas - mean * boxes)) / total
    if mean < -max(_THRESHOLDS.narrow_loop, 3.0 * error):
        hold = max(held_samples(without_history(s).u) for s in sections)
        late = f", '{input_name}' is read too rarely (it is constant for {hold} samples at a time)"
        raise RecordError(
            f"the output leads the input: column '{output_name}' moves before '{input_name}' (the "
            f"loop runs in reverse, {100 * mean:.1f} % of its box); check whether the columns are "
            f"swapped{late if hold > 1 else ''} or the output lags by half a cycle or more"
        )


def _loop_areas(section: RecordSection) -> Array:
    """Signed area of each loop, positive if the output lags, and area of its box, shape (c, 2)."""
    c = section.cycles
    areas = [(0.0, 0.0)]
    for first, stop, swing in zip(c.bounds[:-1], c.bounds[1:] + 1, c.swing, strict=True):
        if swing < _THRESHOLDS.loop:
            continue
        u, y = section.u[first:stop], section.y[first:stop]
        # closed by a straight line, as drift, and a random walk, leave a gap
        gap = 0.5 * (y[-1] + y[0]) * (u[0] - u[-1])
        area = -float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(u)) + gap)
        areas.append((area, float(np.ptp(u) * np.ptp(y))))
    return np.array(areas)


def _warnings(m: IdentificationData) -> tuple[str, ...]:
    warnings: list[str] = []
    if not any(s.cycles.has_minor_loops for s in m.sections):
        warnings.append(
            "no minor loops: behaviour inside the major loop is not identified; record nested "
            "loops of decreasing or increasing amplitude as well"
        )
    over_time = [s for s in m.sections if not s.periodic]
    if m.periodic and len(m.sections) == 1:
        warnings.append(
            "one period, taken as repeated: held-out errors are those of parts of this period and "
            "do not show how far another period, amplitude or rate differs; record five cycles"
        )
    elif sum(s.cycles.swing.size for s in m.sections) < 3:
        warnings.append(
            "fewer than three complete cycles: errors on held-out cycles are uncertain; record more"
        )
    dwells = [readable("s", s.begin, digits=3) for s in over_time if s.first > 0]
    if dwells:
        warnings.append(f"initial dwell of {' and '.join(dict.fromkeys(dwells))} ignored")
    if max(_levels(s.u) for s in m.sections) < 10:
        warnings.append(
            "the input jumps between few levels: behaviour between them is not identified; drive "
            "with sines or triangles"
        )
    warnings += [
        f"the input is constant for {hold} samples ({hold * s.dt:.3g} s) at a time: if it was read "
        "at this interval, delay and loop are wrong by it; if the drive was stepped, the error "
        "includes lag and ringing after each step; sample the input as often as the output"
        for s in m.sections
        if (hold := held_samples(without_history(s).u)) > 1
    ]
    noise = max(s.input_noise for s in m.sections) / (m.input_range[1] - m.input_range[0])
    if noise > 0.0:
        warnings.append(input_noise_warning(noise))
    warnings += [
        f"the output is read in steps of {readable(m.output_unit, step)}, "
        f"{100.0 * step / m.stroke:.2g} % of the stroke, and no model is better than that: use a "
        "finer range of its converter"
        for s in m.sections
        if s.measured is None
        and (step := quantisation_step(without_history(s).y)) > _THRESHOLDS.step * m.stroke
    ]
    warnings += _implausible_units(m)
    if m.sign < 0:
        warnings.append(
            "the output falls where the input rises: the sign of the output was reversed"
        )
    return tuple(warnings)


def _implausible_units(m: IdentificationData) -> tuple[str, ...]:
    """Warn of a motion per volt, or of a voltage, that no drive has."""
    if (m.input_unit, m.output_unit) != ("V", "m"):
        return ()
    volts = m.input_range[1] - m.input_range[0]
    gain, (low, high) = m.stroke / volts, _THRESHOLDS.gain
    if low <= gain <= high and volts <= _THRESHOLDS.voltage:
        return ()
    return (
        f"the output moves by {readable('m', m.stroke)} over {readable('V', volts)}, but piezo "
        f"drives move by {1e9 * low:g} nm to {1e6 * high:g} um per volt, of at most "
        f"{1e-3 * _THRESHOLDS.voltage:g} kV: check the units of both columns, such as mm for um or "
        "mV for V",
    )


def _levels(u: Array) -> int:
    """Number of twentieths of its range that a signal visits."""
    return np.unique(np.floor(19.999 * (u - u.min()) / np.ptp(u))).size
