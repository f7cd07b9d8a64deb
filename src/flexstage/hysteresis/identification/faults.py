"""Faults of a record: spikes, and an output that does not follow its input, or at another time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from flexstage.base.arrays import Array
from flexstage.hysteresis.identification.cycles import RecordSection
from flexstage.hysteresis.identification.range_end import (
    butterfly,
    butterfly_text,
    range_end,
    range_end_text,
)
from flexstage.quantities.units import readable
from flexstage.records.quality import RMS_OVER_MEDIAN, quantisation_step

#: Largest number of samples of a spike, ...
_LONGEST_SPIKE = 3
#: ... its smallest size over the scatter of its neighbours, ...
_SPIKE_RATIO = 8.0
#: ... and number of these on each side; an input that moved within as many samples explains it.
_NEAR = 32
#: Largest number of times in a message.
_TIMES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordFault:
    """Fault of a record."""

    kind: str
    """``spikes``, ``clipping``, ``saturation``, ``butterfly``, ``jump``, ``gain``,
    ``shift`` or ``drift``.
    """
    record: int
    """Number of the record, from 0."""
    at: tuple[float, ...]
    """Times from the first sample of the record [s]; empty for a fault of the whole record."""
    size: float
    """Size, in the unit of the output; of a drift, over the record."""
    percent: float
    """The same over the stroke [%]."""
    text: str
    """Message with a remedy."""

    @classmethod
    def of(
        cls, kind: str, record: int, at: Sequence[float], size: float, stroke: float, text: str
    ) -> Self:
        """Return a fault of a record with this stroke."""
        percent = 100.0 * size / stroke
        return cls(kind=kind, record=record, at=tuple(at), size=size, percent=percent, text=text)


def record_faults(
    number: int,
    section: RecordSection,
    spikes: NDArray[np.intp],
    sign: float,
    units: tuple[str, str],
) -> tuple[RecordFault, ...]:
    """Return the faults of a record, from which the spikes are removed already.

    The sign is that of the recorded output over the input; units are of input and output.
    """
    if section.measured is not None:
        return ()
    u, y = section.u, section.y
    stroke = float(np.ptp(y[section.warm_up :]))

    def fault(kind: str, at: Sequence[float], size: float, text: str) -> RecordFault:
        return RecordFault.of(kind, number, at, size, stroke, text)

    faults: list[RecordFault] = []
    if spikes.size:
        at = (spikes * section.dt).tolist()
        places = ", ".join(f"{t:.6g}" for t in at[:_TIMES]) + (", ..." if len(at) > _TIMES else "")
        text = (
            f"{spikes.size} samples of the output are spikes (at {places} s): they were replaced "
            "by interpolation between their neighbours; check sensor and cable"
        )
        faults.append(fault("spikes", at, 0.0, text))
    turn = butterfly(u, y, section.cycles)
    if turn is not None:  # such an output has no end of range
        return (*faults, fault("butterfly", (), turn[2], butterfly_text(turn, units[0])))
    end = range_end(u, y, section.cycles, section.noise, section.input_noise)
    if end is not None:
        faults.append(
            fault(end.kind, (), end.lost, range_end_text(end, sign, units, stroke, y.size))
        )
    return tuple(faults)


def without_spikes(u: Array, y: Array) -> tuple[Array, NDArray[np.intp]]:
    """Replace isolated outliers of the output by interpolation.

    One to three samples are a spike if all deviate from the cubic through two samples before and
    two after by more than neighbourhood, converter, speed and the change of the input explain,
    and if the output continues after them undisturbed. So a jump is no spike, nor is ringing, whose
    neighbours deviate as well.
    """
    corrected = np.array(y, dtype=np.float64)
    if not np.isfinite(y).all():
        return corrected, np.zeros(0, dtype=np.intp)
    spikes: list[int] = []
    floor = 0.4 * quantisation_step(y)
    explained = _explained_motion(u, y)
    for length in range(1, _LONGEST_SPIKE + 1):
        for first in _spikes(corrected, length, floor, explained):
            at = np.arange(first, first + length)
            around = [first - 2, first - 1, first + length, first + length + 1]
            corrected[at] = _cubic(length) @ corrected[around]
            spikes += at.tolist()
    return corrected, np.unique(np.array(spikes, dtype=np.intp))


def _spikes(y: Array, length: int, floor: float, explained: Array) -> list[int]:
    """First samples of runs of a length that are spikes."""
    if y.size < length + 3 + 2 * _NEAR:
        return []
    off, around = _off_cubic(y, length)
    least = np.abs(off).min(axis=1)
    # deviation of each sample from its neighbours
    near = np.abs(_off_cubic(y, 1)[0][:, 0])
    typical = median_filter(near, size=2 * _NEAR + 1, mode="nearest")[: least.size]
    typical = np.maximum(RMS_OVER_MEDIAN * np.maximum(typical, np.median(near)), floor)
    # of a run, by the errors of the samples around it
    gains = [np.sum(_cubic(n) ** 2, axis=1).max() + 1.0 for n in (length, 1)]
    typical *= math.sqrt(gains[0] / gains[1])
    before, after = around[:, 1] - around[:, 0], around[:, 3] - around[:, 2]
    gap = around[:, 2] - around[:, 1] - 0.5 * (length + 1) * (before + after)
    one_side = np.abs(np.sign(off).sum(axis=1)) == length
    speed = np.maximum(np.abs(before), np.abs(after))
    is_off = least > _SPIKE_RATIO * typical + speed + explained[2 : 2 + least.size]
    starts: list[int] = []
    for k in (2 + np.flatnonzero(is_off & one_side & (np.abs(gap) < 0.5 * least))).tolist():
        if not starts or k > starts[-1] + length + 1:
            starts.append(k)
    return starts


def _off_cubic(y: Array, length: int) -> tuple[Array, Array]:
    """Deviations of each run from the cubic through two samples before and two after, and these."""
    runs = sliding_window_view(y, length + 4)
    around = runs[:, [0, 1, -2, -1]]
    return runs[:, 2:-2] - around @ _cubic(length).T, around


def _cubic(length: int) -> Array:
    """Weights of two samples before and two after for the samples between, shape (length, 4)."""
    around = np.array([-2.0, -1.0, length, length + 1.0])
    return np.vander(np.arange(length), 4) @ np.linalg.inv(np.vander(around))


def _explained_motion(u: Array, y: Array) -> Array:
    """Motion of the output that changes of the speed of the input explain, with their delay."""
    bend = np.abs(np.diff(u, 2, prepend=u[0], append=u[-1]))
    bend = np.maximum(bend - 5.0 * RMS_OVER_MEDIAN * float(np.median(bend)), 0.0)
    low, high = np.quantile(y, (0.005, 0.995))
    gain = float(high - low) / max(float(np.ptp(u)), 1e-300)
    return gain * maximum_filter1d(bend, size=2 * _NEAR + 1, origin=_NEAR - _LONGEST_SPIKE)


def likely_shifts(u: Array, y: Array, least: int) -> tuple[int, ...]:
    """Return shifts [samples] at which an output may follow an input: the best and the smallest.

    The squared correlation with the middle half of the input has a maximum of at least 0.5 there.
    Shifts count from the maximum within the least shift, which is the lag of hysteresis and delay;
    where there is none, that lag is unknown, so that some are tried.
    """
    from scipy.signal import correlate, find_peaks

    middle = y.size // 4
    x = u[middle : u.size - middle] - u[middle : u.size - middle].mean()
    product = correlate(y - y.mean(), x, mode="valid", method="fft")
    sums = [np.cumsum(np.append(0.0, (y - y.mean()) ** k)) for k in (1, 2)]
    mean, square = (c[x.size :] - c[: -x.size] for c in sums)
    variance = np.maximum(square - mean**2 / x.size, 1e-300)
    share = product**2 / (variance * max(float(x @ x), 1e-300))
    # symmetric cycles fit half a cycle later with the other sign: no shift, if they fit already
    if share[middle] > 0.8:
        share = np.where(product * product[middle] > 0.0, share, 0.0)
    near = share[middle - least : middle + least + 1]
    usual = int(np.argmax(near)) - least if 0 < np.argmax(near) < near.size - 1 else 0
    peaks = [int(k) - middle - usual for k in find_peaks(share, height=0.5)[0]]
    peaks = [k for k in peaks if abs(k) > least]
    best = sorted(peaks, key=lambda k: -share[middle + usual + k])
    shifts = dict.fromkeys((*best[:4], *sorted(peaks, key=abs)[:8]))
    return tuple(
        lag - less for lag in shifts for less in sorted({-least // 5, 0, least // 4, least // 2})
    )


def shift_text(seconds: float) -> str:
    """Return the message about an output that is shifted in time."""
    return (
        f"the output moves about {readable('s', abs(seconds), digits=3)} "
        f"{'before' if seconds < 0.0 else 'after'} the input, by the best correlation: check that "
        "both were recorded with one clock and begin with the same sample"
    )
