"""Fit a reading as a curve over the stroke to repeated cycles."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.measure.motion.approaches import staircase_dwells
from flexstage.measure.motion.cycles import MotionCycles, motion_cycles
from flexstage.measure.motion.motion_curve import CurveBasis, MotionCurve, position_weights
from flexstage.quantities.estimate import Estimate

#: Distinct places of the stroke for the number of terms.
_PLACES = 64
#: Pieces of the stroke in which the cycles are compared with the curve.
_BINS = 48


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """One run: triangular factor of its columns, and what they see of reading and time."""

    columns: Array
    position: Array
    reading: Array
    time: Array
    triangle: Array
    projections: Array  # (k, 2): reading, time
    square: Array  # (2, 2)

    def coefficients(self, size: int) -> Array:
        """Return the coefficients of reading and time, shape (size, 2)."""
        from scipy.linalg import solve_triangular

        return solve_triangular(self.triangle[:size, :size], self.projections[:size])


def fit_motion_curve(
    position: ArrayLike,
    reading: ArrayLike,
    time: ArrayLike,
    *,
    cycles: MotionCycles | None = None,
    order: int | None = None,
    drift: bool = True,
    unit: str = "m",
    position_unit: str = "m",
) -> MotionCurve:
    r"""Fit a reading as a curve over the stroke, forward and backward, drift and offsets apart.

    Each cycle gives its own coefficients by least squares, of the forward and of the backward run
    apart. A drift of rate r adds r t to the reading, and so adds to them r times the coefficients
    of t itself: r comes from the line through the mean levels of the cycles over their mean times,
    and is taken off. The mean of the rest over the cycles is the curve; the cycles are independent
    observations of it, with Student's t at one degree of freedom less than their number.

    Unless it is given, the order is two more than the last at which a term of both runs together
    exceeds its scatter from cycle to cycle, by an F test at 0.25 %, and six at least. A staircase
    has straight pieces between its levels instead, through the means over all but the first 30 % of
    each rest.

    Parameters
    ----------
    position : array_like
        Command or displacement along the stroke, shape (n,).
    reading : array_like
        What is measured, shape (n,).
    time : array_like
        Time, rising [s], shape (n,).
    cycles : MotionCycles, optional
        Cycles of the motion; found from the position where not given.
    order : int, optional
        Order of the polynomials; where not given up to 12, or less where a run has few stations, as
        a curve takes no more terms than half of them.
    drift : bool
        Whether to take a drift off; it needs three cycles.
    unit, position_unit : str
        Units of the reading and of the position.

    Returns
    -------
    MotionCurve
        The curve.

    Validity
    --------
    No polynomial follows a curve with kinks, or with jumps other than at the turning points;
    `MotionCurve.model_error` is the deviation. Noise of the position counts as noise of the reading
    times the slope. In a single cycle a drift looks like an open loop: only several cycles separate
    them, and only if the drift is linear.

    Raises
    ------
    RecordError
        The columns do not belong together or are not finite, there are too few cycles, or a run has
        too few samples for a curve.

    Examples
    --------
    >>> t = np.arange(4000) / 500.0
    >>> x = 50e-6 - 50e-6 * np.cos(2.0 * np.pi * t)
    >>> noise = 2e-9 * np.random.default_rng(4).standard_normal(t.size)
    >>> y = 3.0 * x * (1e-4 - x) + 4e-9 * t + noise
    >>> from flexstage.measure import curve_range
    >>> curve = fit_motion_curve(x, y, t)
    >>> bow = curve_range(curve, line="least_squares")
    >>> print(f"{1e9 * bow.value:.1f} nm of 7.5 nm; drift {1e9 * curve.drift_rate.value:.1f} nm/s")
    7.5 nm of 7.5 nm; drift 4.0 nm/s
    """
    x, y, t = _columns(position, reading, time)
    split = motion_cycles(x) if cycles is None else cycles
    if split.size != x.size:
        raise RecordError(
            f"the cycles belong to a record of {split.size} samples, got columns of {x.size}"
        )
    fewest = 3 if drift else 2
    if split.count < fewest:
        raise RecordError(
            f"{fewest} whole cycles are needed for a curve{' and its drift' if drift else ''}, got "
            f"{split.count}: record more{', or fit without drift' if drift else ''}"
        )
    where = [[_whole_run(split, x, c, d) for d in (0, 1)] for c in range(split.count)]
    use, knots = _rests(x, where)
    # the turning point at which a run ends is the first sample of the next
    parts = [x[run.start : run.stop + 1] for cycle in where for run in cycle]
    # what all runs have in common would be shorter than the stroke, by the scatter of its ends
    ends = np.mean([[part.min(), part.max()] for part in parts], axis=0)
    low, high = (ends[0], ends[1]) if knots is None else (knots[0], knots[-1])
    low, high = float(low), float(high)
    bound = _order_bound(parts, low, high) if order is None else order
    basis = CurveBasis(
        low=low, high=high, order=bound if knots is None else knots.size - 1, knots=knots
    )
    # time from the middle, so that the mean level of the curve has no drift in it
    origin = 0.5 * float(t[split.runs.min()] + t[split.runs.max() - 1])
    runs = [[_run(basis, x, y, t - origin, use, run) for run in cycle] for cycle in where]
    notes = list(split.notes)
    if knots is None and order is None:
        size = _chosen_size(runs, basis, drift)
        if size == bound + 1:
            notes.append(f"the polynomial order of the curve reached its upper limit, {bound}")
        basis = CurveBasis(low=low, high=high, order=size - 1)
    return _curve(runs, basis, drift, unit, position_unit, notes)


def _whole_run(split: MotionCycles, x: Array, cycle: int, direction: int) -> slice:
    """Return the samples of a run; of few stations, with the one at which it turns.

    That one is shared with the next run, unless the turn was read twice and each run has its own:
    cycles that share readings are not independent.
    """
    run = split.samples(cycle, direction)
    # runs of fewer samples are series of stations
    sparse = 64
    if run.stop - run.start >= sparse or run.stop >= split.size:
        return run
    usual = float(np.median(np.abs(np.diff(x[run]))))
    is_short = abs(float(x[run.stop] - x[run.stop - 1])) < 0.5 * usual
    return run if is_short else slice(run.start, run.stop + 1)


def _rests(x: Array, where: list[list[slice]]) -> tuple[NDArray[np.bool_], Array | None]:
    """Return which samples to use, and the levels of a staircase that all runs rest at."""
    use = np.ones(x.size, dtype=np.bool_)
    dwells = staircase_dwells(x)
    if dwells is None:
        return use, None
    use = dwells.settled(x.size, 0.3)
    level = np.full(x.size, -1)
    for a, b, target in zip(dwells.start, dwells.stop, dwells.target, strict=True):
        level[a:b] = target
    in_runs = [set(level[run][use[run]].tolist()) for cycle in where for run in cycle]
    common = sorted(set.intersection(*in_runs))
    # levels of a staircase that are fitted one by one, at most
    most_levels = 64
    if not 2 <= len(common) <= most_levels:
        return use, None
    if any(len(levels) > len(common) for levels in in_runs):
        # a measured position rests elsewhere on the way back: no level is common to both runs
        return use, None
    return use, dwells.levels[common]


def _order_bound(parts: list[Array], low: float, high: float) -> int:
    """Return the largest order to try: half as many terms as a run has places, at most."""
    places = min(np.unique(np.floor(_PLACES * (part - low) / (high - low))).size for part in parts)
    return max(min(12, places // 2 - 1), 1)


def _columns(position: ArrayLike, reading: ArrayLike, time: ArrayLike) -> tuple[Array, ...]:
    columns = tuple(np.asarray(v, dtype=np.float64) for v in (position, reading, time))
    shapes = {v.shape for v in columns}
    if len(shapes) != 1 or columns[0].ndim != 1:
        raise RecordError(
            "position, reading and time must be columns of one length, got shapes "
            + ", ".join(str(v.shape) for v in columns)
        )
    for name, v in zip(("position", "reading", "time"), columns, strict=True):
        if not np.isfinite(v).all():
            bad = int(np.flatnonzero(~np.isfinite(v))[0])
            raise RecordError(f"the {name} must be finite, got {v[bad]} at sample {bad}")
    if not np.all(np.diff(columns[2]) > 0.0):
        raise RecordError("the time must rise from sample to sample")
    return columns


def _run(
    basis: CurveBasis, x: Array, y: Array, t: Array, use: NDArray[np.bool_], where: slice
) -> _Run:
    keep = use[where]
    position, reading, time = x[where][keep], y[where][keep], t[where][keep]
    columns = basis.columns(position)
    if position.size < basis.size + 1:
        raise RecordError(
            f"a run has {position.size} samples, too few for a curve of {basis.size} terms: "
            "record more samples in a cycle, or choose a smaller order"
        )
    q, triangle = np.linalg.qr(columns)
    diagonal = np.abs(np.diag(triangle))
    if diagonal.min() <= 1e-6 * diagonal.max():
        raise RecordError(
            f"the positions of a run are too few or too uneven for a curve of {basis.size} terms: "
            "choose a smaller order"
        )
    both = np.stack((reading, time), axis=1)
    return _Run(
        columns=columns, position=position, reading=reading, time=time, triangle=triangle,
        projections=q.T @ both, square=both.T @ both,
    )  # fmt: skip


def _of_cycles(runs: list[list[_Run]], size: int) -> tuple[Array, Array]:
    """Return the coefficients of reading and of time, each of shape (c, 2, size)."""
    both = np.array([[run.coefficients(size) for run in cycle] for cycle in runs])
    return both[..., 0], both[..., 1]


def _drift_line(level: Array, at: Array) -> tuple[float, float]:
    """Return the slope of the levels of the cycles over their times, and its uncertainty."""
    centred = at - at.mean()
    spread = float(centred @ centred)
    rate = float(centred @ level) / spread
    left = level - level.mean() - rate * centred
    return rate, math.sqrt(float(left @ left) / (level.size - 2) / spread)


def _levels(basis: CurveBasis, coefficients: Array) -> Array:
    """Return the mean of both runs over the stroke, of each cycle."""
    x = basis.grid()
    return coefficients.mean(axis=1) @ (position_weights(x) @ basis.columns(x))


def _chosen_size(runs: list[list[_Run]], basis: CurveBasis, drift: bool) -> int:
    """Return the number of terms: two more than the last that exceeds noise, or the least."""
    from scipy.stats import f

    reading, time = _of_cycles(runs, basis.size)
    rate = _drift_line(_levels(basis, reading), _levels(basis, time))[0] if drift else 0.0
    weights = np.array([1.0, -rate])
    # signs of the orthogonal columns are those of the triangle's diagonal: make them equal
    repeats = np.array(
        [
            [np.sign(np.diag(r.triangle)) * (r.projections @ weights) for r in cycle]
            for cycle in runs
        ]
    )
    common = repeats.mean(axis=0)
    noise = _smoothed(np.sum((repeats - common) ** 2, axis=(0, 1)) / (2 * (len(runs) - 1)))
    # rounding of the sums is no term
    floor = 1e-24 * max(float(np.sum(repeats**2, axis=2).max()), 0.0)
    gain = len(runs) * np.sum(common**2, axis=0) / 2.0 / np.maximum(noise, floor)
    # a pair of terms (forward, backward) counts where noise gives as much with this probability
    term_chance = 0.0025
    limit = f.ppf(1.0 - term_chance, 2, 6 * (len(runs) - 1))
    counting = np.flatnonzero(gain > limit) if floor > 0.0 else np.array([], dtype=np.intp)
    last = int(counting[-1]) if counting.size else 0
    # orders beyond the last that counts, as smaller terms still bend the curve
    more_orders = 2
    # order that is fitted at least: a term that drowns in the noise bends the curve all the same
    least_order = 6
    return min(max(last + more_orders, least_order) + 1, basis.size)


def _smoothed(spectrum: Array) -> Array:
    """Return variances of terms, each averaged with its neighbours; the first stands alone.

    Noise that is correlated in time puts more into low orders than into high ones, smoothly so.
    """
    if spectrum.size < 3:
        return spectrum
    rest = spectrum[1:]
    padded = np.concatenate((rest[:1], rest, rest[-1:]))
    return np.concatenate((spectrum[:1], (padded[:-2] + padded[1:-1] + padded[2:]) / 3.0))


def _curve(
    runs: list[list[_Run]],
    basis: CurveBasis,
    drift: bool,
    unit: str,
    position_unit: str,
    notes: list[str],
) -> MotionCurve:
    reading, time = _of_cycles(runs, basis.size)
    count = len(runs)
    rate, estimate = 0.0, None
    if drift:
        rate, u = _drift_line(_levels(basis, reading), _levels(basis, time))
        estimate = Estimate.of(
            rate, u, f"{unit}/s", source="repeatability", degrees_of_freedom=count - 2
        )
    each = reading - rate * time
    mean = each.mean(axis=0)
    scatter = each - mean
    residual = [
        [run.reading - rate * run.time - run.columns[:, : basis.size] @ each[c, d]
         for d, run in enumerate(cycle)] for c, cycle in enumerate(runs)
    ]  # fmt: skip
    freedom = sum(r.size - basis.size for cycle in residual for r in cycle)
    power = sum(float(r @ r) for cycle in residual for r in cycle)
    noise = math.sqrt(power / max(freedom, 1))
    model_error = _model_error(runs, residual, basis)
    if model_error > 0.0:
        notes.append(
            f"the curve does not describe {model_error:.2g} {unit} rms, common to all cycles"
        )
    return MotionCurve(
        basis=basis, coefficients=mean, scatter=scatter, drift_rate=estimate,
        drift_effect=time.mean(axis=0), structure=_structure(runs, basis, scatter), noise=noise,
        model_error=model_error, unit=unit, position_unit=position_unit, notes=tuple(notes),
    )  # fmt: skip


def _structure(runs: list[list[_Run]], basis: CurveBasis, scatter: Array) -> Array:
    """Return a covariance of the mean coefficients of full rank, sized as the scatter is.

    The scatter of few cycles has too low a rank to simulate from. Of terms that are orthogonal over
    the samples the noise is taken as independent, its variance as that of the scatter. The offset
    of cycles is none of its business.
    """
    count, size = len(runs), basis.size
    level = _levels(basis, scatter)
    shape = scatter - level[:, None, None] * basis.constant
    triangles = np.array([[run.triangle[:size, :size] for run in cycle] for cycle in runs])
    signs = np.sign(np.diagonal(triangles, axis1=2, axis2=3))
    mean = (signs[..., None] * triangles).mean(axis=0)
    terms = np.einsum("dij,cdj->cdi", mean, shape)
    variance = np.sum(terms**2, axis=(0, 1)) / (2 * (count - 1))
    variance = _smoothed(variance) if basis.knots is None else np.full(size, variance.mean())
    inverse = np.linalg.inv(mean)
    return (inverse * variance) @ inverse.transpose(0, 2, 1) / count


def _model_error(runs: list[list[_Run]], residual: list[list[Array]], basis: CurveBasis) -> float:
    """Return the rms over pieces of the stroke of what the residuals of all cycles share."""
    means = np.array([
        [_binned(run.position, left, basis) for run, left in zip(cycle, lefts, strict=True)]
        for cycle, lefts in zip(runs, residual, strict=True)
    ])  # fmt: skip
    count = means.shape[0]
    filled = np.isfinite(means).all(axis=0)
    pieces = int(filled.sum()) - 2 * basis.size
    if pieces < 4:
        return 0.0
    from scipy.stats import f

    values = means[:, filled]
    common = values.mean(axis=0)
    of_mean = float(np.sum(common**2)) / pieces
    of_noise = float(np.sum((values - common) ** 2)) / (pieces * (count - 1)) / count
    if of_noise <= 0.0 or of_mean / of_noise < f.ppf(0.99, pieces, pieces * (count - 1)):
        return 0.0
    return math.sqrt(of_mean - of_noise)


def _binned(position: Array, values: Array, basis: CurveBasis) -> Array:
    share = (position - basis.low) / (basis.high - basis.low)
    number = np.clip((share * _BINS).astype(np.intp), 0, _BINS - 1)
    counts = np.bincount(number, minlength=_BINS)
    sums = np.bincount(number, weights=values, minlength=_BINS)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
