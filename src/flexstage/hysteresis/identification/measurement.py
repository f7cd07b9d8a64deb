"""A measured input and output, prepared for identification."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.base.short_repr import short_repr
from flexstage.hysteresis.identification.cycles import (
    cycles,
    early_text,
    first_moving,
    held_samples,
    warm_up,
)
from flexstage.hysteresis.identification.faults import (
    RecordFault,
    butterfly,
    butterfly_text,
    findings_of_record,
    without_spikes,
)
from flexstage.hysteresis.identification.input_noise import denoised, smoothed_text
from flexstage.hysteresis.identification.record_section import RecordSection
from flexstage.records import Channel, Record
from flexstage.records.quality import difference_noise

#: A loop narrower than this share of the stroke says nothing about which column leads.
_NARROW_LOOP = 0.004
#: An output whose correlation with the input is less than this does not follow it.
_UNRELATED = 0.1
#: Ranges of a column whose squares and products are numbers.
_SMALLEST, _LARGEST = 1e-60, 1e60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentificationData:
    """What a model is identified from."""

    sections: tuple[RecordSection, ...]
    """One of each record."""
    sign: float
    """1 if the output rises with the input, -1 if it falls."""
    input_unit: str
    """Unit of the input; empty where nobody has said."""
    output_unit: str
    """Unit of the output; empty where nobody has said."""
    stroke: float
    """Range of the output after the warm-up, in its unit."""
    warnings: tuple[str, ...]
    """What the records cannot tell, and which experiment is missing."""
    findings: tuple[RecordFault, ...] = ()
    """Spikes that were taken out, clipping, butterfly loops."""
    drift: bool = False
    """Whether the last column beside the model is a drift."""

    __repr__ = short_repr

    @property
    def input_range(self) -> tuple[float, float]:
        """Lowest and highest input."""
        return (
            min(s.cycles.range[0] for s in self.sections),
            max(s.cycles.range[1] for s in self.sections),
        )

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Rates of the cycles of all records, that differ by more than half [Hz]."""
        return rates_of([f for s in self.sections for f in s.cycles.rates_hz])


def measurement(
    records: Sequence[Record],
    input_column: str | int,
    output_column: str | int,
    *,
    drift: bool = False,
) -> IdentificationData:
    """Prepare records for identification, after checking that they can serve.

    Parameters
    ----------
    records : sequence of Record
        Records of the same drive, at any rates.
    input_column : str or int
        The column that drives.
    output_column : str or int
        The column that follows.
    drift : bool
        Whether the output of each record drifts at a constant speed, to be fitted beside a model.

    Returns
    -------
    IdentificationData
        The prepared sections.

    Raises
    ------
    RecordError
        A column is missing or does not move, the samples are uneven, the output leads the input,
        or it does not follow it at all.
    """
    if not records:
        raise RecordError("an identification needs at least one record, got none")
    pairs = [(r, r.channel(input_column), r.channel(output_column)) for r in records]
    for _, i, o in pairs:
        if i is o:
            raise RecordError(
                f"input and output are the same column, '{i.name}': choose the one that drives and "
                "the one that follows"
            )
    units = {(i.unit, o.unit) for _, i, o in pairs}
    if len(units) > 1:
        raise RecordError(f"the records have different units: {sorted(units)}; give them by option")
    for r, i, o in pairs:
        require_usable(r, i, o)
    whole = [bool(np.isfinite(o.values).all()) for _, _, o in pairs]
    none = np.zeros(0, dtype=np.intp)
    mended = [
        without_spikes(i.values, o.values) if all_ else (o.values, none)
        for (_, i, o), all_ in zip(pairs, whole, strict=True)
    ]
    pairs = [(r, i, replace(o, values=y)) for (r, i, o), (y, _) in zip(pairs, mended, strict=True)]
    sign = _sign(pairs)
    sections = tuple(
        _section(i.values, sign * o.values, 1.0 / r.sample_rate_hz, r.source) for r, i, o in pairs
    )
    if drift:
        sections = tuple(_with_drift(s) for s in sections)
    _require_order(sections, pairs[0][1].name, pairs[0][2].name)
    stroke = max(float(np.ptp(s.y[s.warm_up :])) for s in sections)
    made = IdentificationData(
        sections=sections,
        sign=sign,
        input_unit=pairs[0][1].unit,
        output_unit=pairs[0][2].unit,
        stroke=stroke,
        warnings=(),
        drift=drift,
    )
    findings = [
        findings_of_record(k, without_history(s), spikes, sign, (made.input_unit, made.output_unit))
        for k, (s, (_, spikes)) in enumerate(zip(sections, mended, strict=True))
        if s.measured is None
    ]
    return replace(
        made, warnings=_warnings(made), findings=tuple(f for own in findings for f in own)
    )


def _with_drift(section: RecordSection) -> RecordSection:
    """Put a column beside the model that rises by 1 over the record."""
    rise = np.linspace(0.0, 1.0, section.u.size)
    return replace(section, nuisance=np.column_stack((section.nuisance, rise)))


def rates_of(rates_hz: Sequence[float]) -> tuple[float, ...]:
    """Return rates [Hz] in rising order, those left out that are less than half above another."""
    found: list[float] = []
    for f in sorted(rates_hz):
        if not found or f > 1.5 * found[-1]:
            found.append(f)
    return tuple(found)


def require_usable(record: Record, given: Channel, read: Channel) -> None:
    """Refuse an input and an output that cannot be computed with.

    Samples of the output may be missing that the record has not, as one of branches or curves.
    """
    _require_column(record, given, gaps=False)
    _require_column(record, read, gaps=True)
    if not record.uniform:
        raise RecordError(
            f"{record.source or 'the record'} is not evenly sampled: resample it to a constant rate"
        )


def _require_column(record: Record, channel: Channel, *, gaps: bool) -> None:
    where = f"column '{channel.name}' of {record.source or 'the record'}"
    values, least = channel.values, 50
    if gaps and record.numbers is not None and np.isnan(record.numbers).any():
        values, least = values[~np.isnan(record.numbers)], 20
    if values.size < least:
        raise RecordError(f"{where} has {values.size} samples: at least {least} are needed")
    if not np.all(np.isfinite(values)):
        first = int(np.argmin(np.isfinite(values)))
        raise RecordError(f"{where} holds {values[first]} at sample {first}: correct the record")
    size = float(np.ptp(values))
    if not size > 1e-13 * float(np.max(np.abs(values))):
        raise RecordError(f"{where} is constant at {values[0]:g}: choose a column that moves")
    if not _SMALLEST < size < _LARGEST:
        raise RecordError(
            f"{where} has a range of {size:.3g}: a range of {_SMALLEST:g} to {_LARGEST:g} is "
            "computed with; give it another unit"
        )


def _sign(pairs: Sequence[tuple[Record, Channel, Channel]]) -> float:
    """Whether the output rises or falls with the input; refused where it does neither."""
    found = []
    for r, i, o in pairs:
        known = np.isfinite(o.values)
        share = float(np.corrcoef(i.values[known], o.values[known])[0, 1])
        if abs(share) < _UNRELATED:
            moves = cycles(i.values, 1.0 / r.sample_rate_hz)
            turned = butterfly(i.values, o.values, moves) if moves.bounds.size > 1 else None
            if turned is not None:
                raise RecordError(butterfly_text(turned, i.unit))
            raise RecordError(
                f"column '{o.name}' of {r.source or 'the record'} does not follow '{i.name}' "
                f"(correlation {share:.3f}): choose the columns that belong together"
            )
        found.append(float(np.sign(share)))
    if len(set(found)) > 1:
        raise RecordError("the output rises with the input in one record and falls in another")
    return found[0]


def _section(u: Array, y: Array, dt: float, source: str) -> RecordSection:
    first = first_moving(u)
    u, y = u[first:], y[first:]
    measured = np.isfinite(y)
    taken = 0.0
    if measured.all():
        u, taken = denoised(u, y)
    else:
        at = np.arange(y.size)
        y = np.interp(at, at[measured], y[measured])
    moves = cycles(u, dt, taken)
    if moves.bounds.size < 2:
        raise RecordError(
            f"the input of {source or 'the record'} makes no whole cycle, from one lower turning "
            "point to the next: identification needs at least one, and better five, over the range "
            "that is to be used"
        )
    # differences of third order pass noise and hardly pass a smooth motion
    noise = difference_noise(y, 3)
    return with_history(
        RecordSection(
            u=np.ascontiguousarray(u),
            y=np.ascontiguousarray(y),
            dt=dt,
            cycles=moves,
            warm_up=warm_up(u, moves),
            nuisance=np.ones((u.size, 1)),
            noise=noise,
            input_noise=taken,
            first=first,
            begin=first * dt,
            measured=None if measured.all() else measured,
        )
    )


def with_history(section: RecordSection) -> RecordSection:
    """Return a section with both ends of its range before it, which leave their memory."""
    moves = section.cycles
    before = np.array([moves.range[1], moves.range[0]])
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
    """Return a section as it was measured."""
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
    """Refuse an output that leads: the loop of a drive is always run with the output behind."""
    whole = [s for s in sections if s.measured is None]
    if not whole:
        return
    widths = np.concatenate([_loop_areas(s) for s in whole])
    mean = float(widths.mean())
    error = float(widths.std() / np.sqrt(widths.size))
    if mean < -_NARROW_LOOP and mean < -3.0 * error:
        held = max(held_samples(without_history(s).u) for s in sections)
        late = f", is '{input_name}' read too seldom (it stands for {held} samples at a time)"
        raise RecordError(
            f"the output leads the input: column '{output_name}' moves before '{input_name}' (the "
            f"loop is run backwards, {100 * mean:.1f} % of its box); are the columns "
            f"swapped{late if held > 1 else ''}, or does the output lag by half a cycle and more?"
        )


def _loop_areas(section: RecordSection) -> Array:
    """Signed area of each large loop by that of its box; positive where the output lags."""
    c = section.cycles
    areas = []
    for i in range(c.swing.size):
        if c.swing[i] < 0.5:
            continue
        u = section.u[c.bounds[i] : c.bounds[i + 1] + 1]
        y = section.y[c.bounds[i] : c.bounds[i + 1] + 1]
        # closed by a straight line where drift has left a gap
        area = -float(
            np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(u)) + 0.5 * (y[-1] + y[0]) * (u[0] - u[-1])
        )
        areas.append(area / (np.ptp(u) * max(np.ptp(y), 1e-300)))
    return np.array(areas) if areas else np.zeros(1)


def _warnings(m: IdentificationData) -> tuple[str, ...]:
    found: list[str] = []
    if not any(s.cycles.has_minor_loops for s in m.sections):
        found.append(
            "no minor loops: what happens inside the major loop is not identified; record nested "
            "loops of falling or rising amplitude as well"
        )
    if sum(s.cycles.swing.size for s in m.sections) < 3:
        found.append(
            "fewer than three whole cycles: errors on cycles that were held out say little; record "
            "more"
        )
    rests = [f"{s.begin:.3g}" for s in m.sections if s.first > 0]
    if rests:
        found.append(
            f"the input rests for {' and '.join(dict.fromkeys(rests))} s before it moves: this is "
            "left out"
        )
    bare = map(without_history, m.sections)
    early = early_text([(s.u, s.cycles, s.dt, s.warm_up, s.begin) for s in bare])
    if early:
        found.append(early)
    if max(_levels(s.u) for s in m.sections) < 10:
        found.append(
            "the input jumps between few levels: what lies between them is not identified; drive "
            "with sines or triangles"
        )
    found += [
        f"the input stands for {held} samples ({held * s.dt:.3g} s) at a time: where it was only "
        "read so seldom, delay and loop are wrong by it; where the drive was stepped, the error "
        "holds its lag and ringing behind each step; drive and record it as often as the output"
        for s in m.sections
        if (held := held_samples(without_history(s).u)) > 1
    ]
    noise = max(s.input_noise for s in m.sections) / (m.input_range[1] - m.input_range[0])
    if noise > 0.0:
        found.append(smoothed_text(noise))
    if m.sign < 0:
        found.append("the output falls where the input rises: the sign of the output was turned")
    return tuple(found)


def _levels(u: Array) -> int:
    """How many twentieths of its range a signal visits."""
    return np.unique(np.floor(19.999 * (u - u.min()) / np.ptp(u))).size
