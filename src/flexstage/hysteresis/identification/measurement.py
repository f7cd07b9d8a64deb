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
    warm_up,
)
from flexstage.hysteresis.identification.faults import RecordFault, record_faults, without_spikes
from flexstage.hysteresis.identification.history import with_history
from flexstage.hysteresis.identification.input_noise import denoised
from flexstage.hysteresis.identification.period import closed_loop
from flexstage.hysteresis.identification.record_warnings import record_warnings
from flexstage.hysteresis.identification.suitability import (
    LEAST_ROWS,
    LEAST_SAMPLES,
    require_order,
    require_usable,
    sign_of,
)
from flexstage.hysteresis.requests import Zero
from flexstage.records import Record
from flexstage.records.quality import difference_noise, quantisation_step


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
        low, high = zip(*(s.cycles.range for s in self.sections), strict=True)
        return min(low), max(high)

    @property
    def periodic(self) -> bool:
        """True if each record is one period of a steady motion."""
        return bool(self.sections) and all(s.periodic for s in self.sections)

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Rates of the cycles of all records, without those less than half above another [Hz]."""
        rates: list[float] = []
        for rate in sorted(f for s in self.sections for f in s.cycles.rates_hz):
            if not rates or rate > 1.5 * rates[-1]:
                rates.append(rate)
        return tuple(rates)


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
        require_usable(r, i, o, LEAST_ROWS if periodic else LEAST_SAMPLES)
    despiked = [without_spikes(i.values, o.values) for _, i, o in pairs]
    pairs = [
        (r, i, replace(o, values=y)) for (r, i, o), (y, _) in zip(pairs, despiked, strict=True)
    ]
    sign = sign_of(pairs)
    prepared = [
        _section(i.values, sign * o.values, 1.0 / r.sample_rate_hz, r.source, zero, periodic)
        for r, i, o in pairs
    ]
    sections = [s for s, _ in prepared]
    require_order(sections, pairs[0][1].name, pairs[0][2].name)
    (both_units,) = units
    stroke = max(float(np.ptp(s.y[s.warm_up :])) for s in sections)
    return IdentificationData(
        sections=tuple(map(with_history, sections)),
        sign=sign,
        input_unit=both_units[0],
        output_unit=both_units[1],
        stroke=stroke,
        warnings=(
            *(text for _, text in prepared if text),
            *record_warnings(sections, stroke, sign, both_units),
        ),
        findings=tuple(
            fault
            for k, (s, (_, spikes)) in enumerate(zip(sections, despiked, strict=True))
            for fault in record_faults(k, s, spikes, sign, both_units)
        ),
        zero=zero,
    )


def _section(
    u: Array, y: Array, dt: float, source: str, zero: Zero, periodic: bool | None
) -> tuple[RecordSection, str]:
    """Return a prepared record, and a warning about its ends."""
    source = source or "the record"
    loop = None if periodic is False else closed_loop(u, y, source, stated=bool(periodic))
    first = first_moving(u)
    u, y, first, warning = loop or (u[first:], y[first:], first, "")
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
    return RecordSection(
        u=np.ascontiguousarray(u),
        y=np.ascontiguousarray(y),
        dt=dt,
        cycles=moves,
        warm_up=warm_up(u, moves) if loop is None else 0,
        # 1, and time over duration for a drift
        nuisance=np.linspace(0.0, 1.0, u.size)[:, None] ** np.arange(1 + (zero == "drift")),
        # third differences contain the noise, and hardly any smooth motion; mostly none of a
        # converter
        noise=max(difference_noise(y, 3), quantisation_step(y[measured]) / math.sqrt(12.0)),
        input_noise=noise_removed,
        first=first,
        begin=first * dt,
        start="rested" if loop is None else "periodic",
        measured=None if measured.all() else measured,
    ), warning
