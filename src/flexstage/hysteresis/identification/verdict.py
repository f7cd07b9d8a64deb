"""Whether a model explains a measurement at all, and what in the records it cannot explain."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexstage.hysteresis.identification.families.family import Data, Family, Fit
from flexstage.hysteresis.identification.faults import RecordFault, with_unit
from flexstage.hysteresis.identification.misfit import Misfit, misfit

__all__ = ["Verdict", "verdict"]

Array = NDArray[np.float64]

#: Of the stroke, a fitted model of a piezo drive leaves 0.1 to 2 %, from session to session.
#: One that leaves more, and ...
_USUAL = 2.0
#: ... more than this share of what a straight line leaves, has explained no hysteresis; ...
_SHARE_OF_LINE = 1.0 / 3.0
#: ... and one that leaves this much serves nothing [% of the stroke].
_USELESS = 5.0
#: A jump is this many times larger than the largest step of the misfit elsewhere, ...
_JUMPS = 3.0
#: ... larger than this [% of the stroke], ...
_SMALLEST_JUMP = 0.5
#: ... and this many times what is left without it, rms, in the record and in the cycles beside it:
#: over so much a misfit of the shape of a sine moves anyway.
_ABOVE_REST = 2.0 * 2.0**0.5
#: The input moves over much the same way in the cycle before a jump and in the one after.
_AS_FAST = 2.0
#: Jumps that are looked for in a record.
_MOST_JUMPS = 3
#: Drift over the record is named from this [% of the stroke] on, ...
_SMALLEST_DRIFT = 1.0
#: ... where it exceeds this many times its standard error, and what the model leaves, ...
_CERTAIN = 4.0
#: ... and goes on in the slower half of the record at this share of its speed in the other: creep,
#: which goes with the logarithm of time, is several times slower there.
_GOES_ON = 0.5
#: A trend is taken for drift where it takes this share of the mean square away: where the amplitude
#: changes with time, what a model lacks looks like a trend and is hardly less with one.
_WORTH = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """How far the best model explains the records.

    Parameters
    ----------
    fits : bool
        Whether it explains them.
    reason : str
        Why it does not; empty where it does.
    line_percent : float
        What a straight line would leave, over the stroke, rms [%].
    findings : tuple of RecordFault
        What is in the records that is not the motion of a drive.
    """

    fits: bool
    reason: str
    line_percent: float
    findings: tuple[RecordFault, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a reader should know, the verdict first."""
        own = () if self.fits else (self.reason,)
        return (*own, *(f.text for f in self.findings))


def verdict(
    family: Family, fit: Fit, data: Data, left: Misfit, error_percent: float, noise_percent: float
) -> Verdict:
    """Compare what the best model leaves with the noise and with what a straight line leaves.

    Parameters
    ----------
    family : Family
        The model that was chosen.
    fit : Fit
        Its fit.
    data : Data
        The data.
    left : Misfit
        What it leaves.
    error_percent : float
        Root mean square of that, over the stroke, held out where there is such an error [%].
    noise_percent : float
        Noise of the output, over the stroke [%].

    Returns
    -------
    Verdict
        The verdict, with jumps and drift beside what the records showed by themselves.
    """
    m = data.measurement
    percent = 100.0 / m.stroke
    found = list(m.findings)
    if not any(f.kind == "butterfly" for f in found):
        rms = float(np.sqrt(np.mean(left.at(data.use) ** 2)))
        jumps = _jumps(data, left)
        # a jump makes a trend, and a drift makes no jump
        found += jumps or ([] if m.drift else _drifts(family, fit, data, rms))
    line = _line(data) * percent
    excess = float(np.sqrt(max(error_percent**2 - noise_percent**2, 0.0)))
    explains = excess <= _USUAL or (excess <= _USELESS and excess <= _SHARE_OF_LINE * line)
    turned = any(f.kind == "butterfly" for f in found)
    reason = ""
    if turned or not explains:
        named = sorted({f.kind for f in found} - {"spikes"})
        why = f"look at the {' and the '.join(named)} named here" if named else (
            "do input and output belong together, and is all that moves the output recorded?"
        )  # fmt: skip
        reason = (
            f"nothing here fits: the best model leaves {error_percent:.2g} % of the stroke, the "
            f"noise is {noise_percent:.2g} %, a straight line leaves {line:.2g} %, and a drive is "
            f"usually explained to {_USUAL:g} % or better; {why}"
        )
    return Verdict(fits=not reason, reason=reason, line_percent=line, findings=tuple(found))


def _line(data: Data) -> float:
    """What a straight line with the columns beside the model leaves, in the unit of the output."""
    squares, count = 0.0, 0
    for s, r, use in zip(data.measurement.sections, data.rows, data.use, strict=True):
        at = r.at[use]
        if at.size == 0:
            continue
        columns = np.column_stack((s.u[at], s.nuisance[at]))
        own = np.linalg.lstsq(columns / np.ptp(s.u), s.y[at], rcond=None)[0]
        squares += float(np.sum((s.y[at] - columns / np.ptp(s.u) @ own) ** 2))
        count += at.size
    return float(np.sqrt(squares / max(count, 1)))


def _jumps(data: Data, left: Misfit) -> list[RecordFault]:
    m = data.measurement
    least = 0.01 * _SMALLEST_JUMP * m.stroke
    made: list[RecordFault] = []
    for number, (s, r, e) in enumerate(zip(m.sections, data.rows, left.left, strict=True)):
        cycle = max(int(np.median(np.diff(s.cycles.bounds))), 1)
        every = int(r.at[1] - r.at[0]) if r.at.size > 1 else 1
        rows = max(cycle // every, 8)
        steps = steps_of(e, s.u[r.at], rows)
        levels = np.searchsorted(sorted(k for k, _ in steps), np.arange(e.size), side="right")
        mean = np.bincount(levels, weights=e) / np.bincount(levels)
        rest = float(np.var(e - mean[levels]))
        for k, size in steps:
            beside = 0.5 * float(np.var(e[max(k - rows, 0) : k]) + np.var(e[k : k + rows]))
            if abs(size) < max(least, _ABOVE_REST * max(rest, beside) ** 0.5):
                continue
            at, jump = s.begin + float(r.at[k] - s.history) * s.dt, m.sign * size
            percent = 100.0 * jump / m.stroke
            made.append(
                RecordFault(
                    kind="jump",
                    record=number,
                    at=(at,),
                    size=jump,
                    percent=percent,
                    text=f"the output jumps by {with_unit(f'{jump:.3g}', m.output_unit)} "
                    f"({percent:.2g} % of the stroke) at {at:.6g} s and stays there, and the input "
                    "does not: has the zero of the sensor changed, or has something slipped? "
                    "Identify one side of it, by --rows",
                )
            )
    return made


def steps_of(e: Array, u: Array, cycle: int) -> list[tuple[int, float]]:
    """Where a misfit jumps for good: on average over few samples and over a whole cycle as well.

    Parameters
    ----------
    e : numpy.ndarray
        Output less model, shape (r,).
    u : numpy.ndarray
        Input, shape (r,). No jump is looked for where it has a step, nor where it begins or ends to
        move, as what a model lacks changes there.
    cycle : int
        Samples of a cycle.

    Returns
    -------
    list of tuple
        Place and size of each jump, the largest first.
    """
    widths = np.unique(np.round(np.geomspace(max(4, cycle // 20), cycle, 6)).astype(int))
    most, n = int(widths[-1]), e.size
    if n < 8 * most:
        return []
    total = np.concatenate(([0.0], np.cumsum(e)))
    at = np.arange(most, n - most + 1)
    change = np.stack([(total[at + w] - 2.0 * total[at] + total[at - w]) / w for w in widths])
    alike = np.all(change > 0.0, axis=0) | np.all(change < 0.0, axis=0)
    size = np.where(alike, np.abs(change).min(axis=0), 0.0)
    moved = np.abs(np.diff(u, prepend=u[0]))
    path = np.concatenate(([0.0], np.cumsum(moved)))
    before, after = path[at] - path[at - most], path[at + most] - path[at]
    size[np.maximum(before, after) > _AS_FAST * np.minimum(before, after)] = 0.0
    usual = float(np.median(moved[moved > 0.0])) if moved.any() else 0.0
    near = 2 * int(widths[0])
    for k in np.flatnonzero(moved > max(20.0 * usual, 0.01 * float(np.ptp(u)))) - most:
        size[max(k - near, 0) : max(k + near, 0)] = 0.0
    peaks: list[tuple[int, float, float]] = []
    for _ in range(_MOST_JUMPS + 1):
        k = int(np.argmax(size))
        peaks.append((int(at[k]), float(size[k]), float(np.median(change[:, k]))))
        size[max(k - most, 0) : k + most + 1] = 0.0
    ratios = [peaks[i][1] / max(peaks[i + 1][1], 1e-300) for i in range(_MOST_JUMPS)]
    best = int(np.argmax(ratios))
    if ratios[best] < _JUMPS:
        return []
    return [(k, mean) for k, _, mean in peaks[: best + 1]]


def _drifts(family: Family, fit: Fit, data: Data, rms: float) -> list[RecordFault]:
    """Fit once more, with a trend in each half of each record beside the model."""
    m = data.measurement
    sections = tuple(
        replace(s, nuisance=np.column_stack((s.nuisance[:, 0], _halves(s.u.size, r.at))))
        for s, r in zip(m.sections, data.rows, strict=True)
    )
    # what families keep for all rows knows the columns beside them, but for the weight of a penalty
    memo = {name: kept for name, kept in data.memo.items() if name.endswith(" smoothing")}
    more = replace(data, measurement=replace(m, sections=sections), memo=memo)
    again = misfit(family.fit(more, fit.search if fit.search.size else None).model, more)
    if np.mean(again.at(data.use) ** 2) > (1.0 - _WORTH) * rms**2:
        return []
    made: list[RecordFault] = []
    for number, (s, r, use) in enumerate(zip(sections, data.rows, data.use, strict=True)):
        if not use.any():
            continue
        first, second = (float(v) for v in again.nuisance[number][-2:])
        slow, fast = sorted((abs(first), abs(second)))
        # over what is compared, and then over the record
        longer = s.u.size / float(r.at[-1] - r.at[0])
        size = longer * m.sign * (first + second)
        error = longer * _error_of_trend(again.left[number][use], r.cycle[use])
        percent = 100.0 * size / m.stroke
        if (
            first * second <= 0.0
            or slow < _GOES_ON * fast
            or abs(percent) < _SMALLEST_DRIFT
            or abs(size) < max(rms, _CERTAIN * error)
        ):
            continue
        seconds = s.u.size * s.dt
        made.append(
            RecordFault(
                kind="drift",
                record=number,
                at=(),
                size=size,
                percent=percent,
                text=f"the output drifts by {size / seconds:.3g} {m.output_unit or 'units'}/s "
                f"(standard error {error / seconds:.1g}), {percent:.2g} % of the stroke over the "
                "record, and does not slow down as creep does: fit it beside the model by --drift, "
                "and look for what warms up",
            )
        )
    return made


def _halves(size: int, rows: NDArray[np.intp]) -> Array:
    """Rise from 0 to 1 in the first half of what is compared, and in the second, shape (n, 2)."""
    t = np.arange(size, dtype=np.float64)
    first, last = float(rows[0]), float(rows[-1])
    middle = 0.5 * (first + last)
    half = max(middle - first, 1.0)
    return np.column_stack((np.minimum(t, middle) - first, np.maximum(t, middle) - middle)) / half


def _error_of_trend(e: Array, cycle: NDArray[np.intp]) -> float:
    """Standard error of a rise over all samples, by sums over cycles."""
    t = np.linspace(-0.5, 0.5, e.size)
    _, which = np.unique(cycle, return_inverse=True)
    sums = np.bincount(which, weights=t * e)
    many = sums.size
    return float(np.sqrt(np.sum(sums**2) * many / max(many - 1, 1)) / np.sum(t**2))
