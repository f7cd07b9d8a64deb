"""Warnings about prepared records, and missing experiments."""

from collections.abc import Sequence

import numpy as np

from flexstage.hysteresis.identification.cycles import RecordSection, held_samples
from flexstage.hysteresis.identification.input_noise import input_noise_warning
from flexstage.quantities.units import readable
from flexstage.records.quality import quantisation_step

#: Motion of drives [m/V]: films and shear plates of quartz move by less than 1 nm/V, amplified
#: stages behind a control voltage of some volts by up to 100 um/V.
_GAIN = 1e-10, 1e-4
#: Largest range of the voltage of a drive [V].
_VOLTAGE = 2e4
#: A step of the converter above this share of the stroke exceeds the error of a good model.
_STEP = 0.003
#: Of twenty levels of an input, those that it visits at least.
_LEVELS = 10


def record_warnings(
    sections: Sequence[RecordSection], stroke: float, sign: float, units: tuple[str, str]
) -> tuple[str, ...]:
    """Return what records with a common stroke, in units of input and output, do not determine."""
    warnings: list[str] = []
    if not any(s.cycles.has_minor_loops for s in sections):
        warnings.append(
            "no minor loops: behaviour inside the major loop is not identified; record nested "
            "loops of decreasing or increasing amplitude as well"
        )
    if len(sections) == 1 and sections[0].periodic:
        warnings.append(
            "one period, taken as repeated: held-out errors are those of parts of this period and "
            "do not show how far another period, amplitude or rate differs; record five cycles"
        )
    elif sum(s.cycles.swing.size for s in sections) < 3:
        warnings.append(
            "fewer than three complete cycles: errors on held-out cycles are uncertain; record more"
        )
    dwells = [readable("s", s.begin, digits=3) for s in sections if s.first > 0 and not s.periodic]
    if dwells:
        warnings.append(f"initial dwell of {' and '.join(dict.fromkeys(dwells))} ignored")
    levels = [np.floor(19.999 * (s.u - s.u.min()) / np.ptp(s.u)) for s in sections]
    if max(np.unique(visited).size for visited in levels) < _LEVELS:
        warnings.append(
            "the input jumps between few levels: behaviour between them is not identified; drive "
            "with sines or triangles"
        )
    warnings += [
        f"the input is constant for {hold} samples ({hold * s.dt:.3g} s) at a time: if it was read "
        "at this interval, delay and loop are wrong by it; if the drive was stepped, the error "
        "includes lag and ringing after each step; sample the input as often as the output"
        for s in sections
        if (hold := held_samples(s.u)) > 1
    ]
    low, high = zip(*(s.cycles.range for s in sections), strict=True)
    span = max(high) - min(low)
    noise = max(s.input_noise for s in sections) / span
    if noise > 0.0:
        warnings.append(input_noise_warning(noise))
    warnings += [
        f"the output is read in steps of {readable(units[1], step)}, "
        f"{100.0 * step / stroke:.2g} % of the stroke, and no model is better than that: use a "
        "finer range of its converter"
        for s in sections
        if s.measured is None and (step := quantisation_step(s.y)) > _STEP * stroke
    ]
    usual = _GAIN[0] <= stroke / span <= _GAIN[1] and span <= _VOLTAGE
    if units == ("V", "m") and not usual:
        warnings.append(
            f"the output moves by {readable('m', stroke)} over {readable('V', span)}, but piezo "
            f"drives move by {1e9 * _GAIN[0]:g} nm to {1e6 * _GAIN[1]:g} um per volt, of at most "
            f"{1e-3 * _VOLTAGE:g} kV: check the units of both columns, such as mm for um or mV for "
            "V"
        )
    if sign < 0:
        warnings.append(
            "the output falls where the input rises: the sign of the output was reversed"
        )
    return tuple(warnings)
