"""What kind of excitation a signal is."""

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.experiment.spectra.options import Excitation
from flexstage.experiment.spectra.periods import find_period, likeness

# pulses take up less of the time than this, above a tenth of their height
_RARE = 0.02
# samples in which a period is looked for
_LOOK = 1_048_576
# parts of a sweep have less of their spectra in common than this
_COMMON = 0.3
_PARTS = 16


def recognised(values: Array, *, step_allowed: bool = True) -> Excitation:
    """Say what kind of excitation a signal is.

    Hammer: it leaves its median for less than 2 % of the time. Step: its differences do, and it
    stays where it went. Periodic: it repeats itself after less than half of the record, and of its
    first million samples. Sweep: the spectra of its sixteenths have little in common. Random: none
    of these. Steps and hits have one input, and are not looked for among several.

    Examples
    --------
    >>> recognised(np.random.default_rng(1).standard_normal(4096))
    'random'
    """
    x = values[:_LOOK]
    if step_allowed:
        away = values - np.median(x)
        # a step soon after the start is rare as well, but does not come back
        back = max(abs(away[0]), abs(away[-1])) <= 0.1 * np.abs(away).max()
        if back and _rare(away):
            return "hammer"
        if _rare(np.diff(values)):
            return "step"
    try:
        period = find_period(x)
    except RecordError:
        period = 0
    if period:
        r = likeness(x)
        last = (r.size - 1) // period * period
        # what merely swings for a while is unlike itself after many swings
        if min(r[period], r[last]) > 0.95:
            return "periodic"
    return "sweep" if _moves(values) else "random"


def _rare(values: Array) -> bool:
    size = np.abs(values)
    top = float(size.max())
    return top > 0.0 and int(np.count_nonzero(size > 0.1 * top)) < max(_RARE * size.size, 2)


def _moves(values: Array) -> bool:
    """Whether the spectrum moves along the record."""
    length = values.size // _PARTS
    if length < 64:
        return False
    # every part in a moderate length, so that a long record costs no more
    take = min(length, 4096)
    parts = values[: _PARTS * length].reshape(_PARTS, length)[:, :take]
    power = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * np.hanning(take))) ** 2
    bands = np.add.reduceat(power, np.arange(0, power.shape[1], max(1, take // 64)), axis=1)
    norm = np.linalg.norm(bands, axis=1)
    # before and after a sweep there may be quiet
    loud = norm > 1e-3 * norm.max()
    if loud.sum() < 4:
        return False
    shape = bands[loud] / norm[loud, None]
    alike = (shape @ shape.T)[np.triu_indices(int(loud.sum()), 1)]
    return float(np.median(alike)) < _COMMON
