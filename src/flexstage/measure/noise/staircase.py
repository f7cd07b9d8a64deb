"""Resolution: from noise, and from the levels of a staircase whose steps are resolved or not."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.noise.hold import allan_freedom, power_of_noise
from flexstage.quantities.estimate import Estimate

#: Parts of a level whose means give the uncertainty of its mean.
PARTS = 6


def levels_of_command(command: ArrayLike, *, shortest: int = 1) -> Integers:
    """Return the bounds of the constant levels of a command.

    They are the first sample of each level, and the sample after the last. Levels shorter than
    `shortest`, as of a ramp, are joined to the next.

    Examples
    --------
    >>> levels_of_command([0.0, 0.0, 0.0, 0.7, 0.7, 1.4, 1.4, 1.4])
    array([0, 3, 5, 8])
    """
    u = np.asarray(command, dtype=np.float64)
    if u.ndim != 1 or u.size < 2 or not np.isfinite(u).all():
        raise RecordError(f"a command needs one finite number for each sample, got shape {u.shape}")
    starts = np.concatenate(([0], np.flatnonzero(np.diff(u)) + 1))
    lengths = np.diff(np.append(starts, u.size))
    # the samples of a ramp belong to the level after it
    after_ramp = np.concatenate(([False], lengths[:-1] < shortest))
    keep = ~after_ramp
    keep[0] = True
    bounds = np.append(starts[keep], u.size).astype(np.intp)
    if bounds.size < 3:
        raise RecordError("the command has fewer than two levels: select the column of the command")
    return bounds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelFit:
    """Means of levels and one drift for all."""

    means: Array
    """Means of the levels at the middle of the record, without drift, shape (k,)."""
    slope: float
    """Drift per sample."""
    residuals: Array
    """Means of the parts of each level minus the fit, shape (k, parts)."""
    covariance: Array
    """Covariance of the means and the slope, shape (k + 1, k + 1)."""
    degrees_of_freedom: float
    """Degrees of freedom of the covariance."""

    def combination(self, weights: Array, unit: str) -> Estimate:
        """Return the weighted sum of the steps."""
        by = np.concatenate([np.diff(-weights, prepend=0.0, append=0.0), [0.0]])
        return self._estimate(float(by[:-1] @ self.means), by, unit)

    def drift(self, rate: float, unit: str) -> Estimate:
        """Return the drift within the levels, per second; `rate` is in Hz."""
        by = np.concatenate([np.zeros(self.means.size), [rate]])
        return self._estimate(rate * self.slope, by, f"{unit}/s")

    def _estimate(self, value: float, by: Array, unit: str) -> Estimate:
        uncertainty = math.sqrt(max(float(by @ self.covariance @ by), 0.0))
        return Estimate.of(value, uncertainty, unit, degrees_of_freedom=self.degrees_of_freedom)


def fit_levels(y: Array, spans: Integers) -> LevelFit:
    """Fit means of levels and one drift, to means of parts of the levels.

    The covariance follows from the residuals of the parts.
    """
    k = len(spans)
    z, t = np.empty((k, PARTS)), np.empty((k, PARTS))
    for i, (a, b) in enumerate(spans.tolist()):
        length = (b - a) // PARTS
        start = b - PARTS * length
        z[i] = y[start:b].reshape(PARTS, length).mean(axis=1)
        t[i] = start + length * np.arange(PARTS) + 0.5 * (length - 1)
    # parts of longer levels are less uncertain
    weight = np.diff(spans, axis=1) / np.diff(spans, axis=1).mean()
    middle = float(t.mean())
    inner = t - t.mean(axis=1, keepdims=True)
    spread = float(np.sum(weight * inner**2))
    slope = float(np.sum(weight * inner * z)) / spread
    level_z, level_t = z.mean(axis=1), t.mean(axis=1) - middle
    residuals = z - level_z[:, None] - slope * inner
    freedom = k * (PARTS - 1) - 1
    variance = float(np.sum(weight * residuals**2)) / freedom
    # correlation of neighbouring parts increases the uncertainty of their mean; the subtracted mean
    # makes them anticorrelated by 1 / parts
    shared = float(np.sum(weight * residuals[:, 1:] * residuals[:, :-1])) / (k * (PARTS - 1))
    correlation = shared / variance + 1.0 / PARTS if variance > 0.0 else 0.0
    if correlation > 1.0 / math.sqrt(k * (PARTS - 1)):
        variance *= 1.0 + 2.0 * min(correlation, 0.5)
    # levels at the middle of the record: mean minus slope times its distance from there
    covariance = np.zeros((k + 1, k + 1))
    covariance[:k, :k] = np.diag(variance / (PARTS * weight[:, 0]))
    lever = np.append(-level_t, 1.0)
    covariance += np.outer(lever, lever) * variance / spread
    return LevelFit(
        means=level_z - slope * level_t,
        slope=slope,
        residuals=residuals,
        covariance=covariance,
        degrees_of_freedom=float(freedom),
    )


def settled(bounds: ArrayLike, n: int, settling: float) -> Integers:
    """Return the first and after last sample of each level without settling, shape (k, 2).

    The bounds are the first sample of each level and the sample after the last, shape (k + 1,).
    """
    edges = np.asarray(bounds, dtype=np.intp)
    if not 0.0 <= settling < 1.0:
        raise ModelError(f"the settling share must be from 0 to below 1, got {settling!r}")
    if edges.ndim != 1 or edges.size < 3 or np.any(np.diff(edges) < 1) or edges[0] < 0:
        raise RecordError("a staircase needs at least two levels, with bounds that rise from 0")
    if edges[-1] > n:
        raise RecordError(f"the levels end at sample {edges[-1]}, but there are only {n}")
    starts = edges[:-1] + np.ceil(settling * np.diff(edges)).astype(np.intp)
    spans = np.stack([starts, edges[1:]], axis=1)
    shortest = int(np.diff(spans, axis=1).min())
    if shortest < PARTS:
        raise RecordError(
            f"the shortest level has {shortest} samples after settling, but {PARTS} are needed: "
            "dwell longer, or reduce the settling share"
        )
    return spans


def resolution(
    values: ArrayLike,
    sample_rate_hz: float,
    *,
    samples: int,
    probability: float = 0.95,
    bounds: ArrayLike | None = None,
    unit: str = "m",
) -> Estimate:
    """Return the smallest step that averages of a number of samples resolve.

    Two neighbouring averages of n samples differ with the standard deviation ``sqrt(2) s(n)``, s
    being the Allan deviation at n. A difference of more than half a step R counts as a step. The
    risks of a false and of a missed step are both 1 - P for ``R = 2 sqrt(2) z_P s(n)``, z_P the
    quantile of the normal distribution (the detection limit of Currie, 1968, Analytical Chemistry
    40, with equal risks).

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    samples : int
        Samples per average, one or more: the bandwidth is the rate over twice this number.
    probability : float
        The confidence P [1], from 0.5 to 1.
    bounds : array_like, optional
        First and after last sample of intervals with the stage at rest, shape (k, 2); the full
        record if not given.
    unit : str
        Unit of the readings.

    Returns
    -------
    Estimate
        The resolution, with chi-squared bounds.

    Validity
    --------
    Gaussian noise. Drift during the two averages counts as noise; settling between them does not,
    as the averages are consecutive.

    Raises
    ------
    RecordError
        A reading is not finite, no interval is twice as long as the average, or all are constant.
    ModelError
        The probability, the rate or the number of samples is not possible.

    Examples
    --------
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(20_000)
    >>> step = resolution(noise, 1000.0, samples=100)
    >>> print(f"{1e9 * step.value:.2f} nm ({step.note})")
    1.38 nm (two averages of 100 samples, bandwidth 5 Hz, distinguishable at 95 %)
    """
    from scipy.special import ndtri

    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise RecordError(f"the readings must be one finite number for each time, got {y.shape}")
    if not 0.5 < probability < 1.0:
        raise ModelError(f"the confidence must be between 0.5 and 1, got {probability!r}")
    if samples < 1 or not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(
            f"an average needs at least one sample and a positive rate, got {samples} at "
            f"{sample_rate_hz!r} Hz"
        )
    spans = np.array([[0, y.size]]) if bounds is None else np.asarray(bounds, dtype=np.intp)
    deviation, freedom = _pooled(y, spans, samples)
    factor = 2.0 * math.sqrt(2.0) * float(ndtri(probability))
    note = (
        f"two averages of {samples} samples, bandwidth "
        f"{0.5 * sample_rate_hz / samples:.4g} Hz, distinguishable at {100.0 * probability:g} %"
    )
    return Estimate.of_deviation(deviation, freedom, unit, note=note).times(factor)


def _pooled(y: Array, spans: Integers, m: int) -> tuple[float, float]:
    """Return the Allan deviation over all intervals, and its degrees of freedom."""
    power, count, freedom = 0.0, 0, 0.0
    long = [(a, b) for a, b in spans.tolist() if b - a >= 2 * m]
    if not long:
        raise RecordError(
            f"no level has the {2 * m} samples of two averages: average fewer samples, or dwell "
            "longer at each level"
        )
    # the kind of noise is that of the longest averages with enough samples; correlated noise there
    # counts as slower, with fewer degrees of freedom
    first, last = max(long, key=lambda s: s[1] - s[0])
    octaves = np.append(2 ** np.arange(int(math.log2(m)) + 1), m)
    kind = power_of_noise(y[first:last], octaves)[-1]
    for a, b in long:
        total = np.concatenate(([0.0], np.cumsum(y[a:b] - y[a:b].mean())))
        d = total[2 * m :] - 2.0 * total[m:-m] + total[: -2 * m]
        power += float(d @ d)
        count += d.size
        freedom += allan_freedom(b - a, m, kind)
    if not power > 0.0:
        raise RecordError("all neighbouring readings are equal: the sensor is dead, or too coarse")
    return math.sqrt(power / (2.0 * count)) / m, freedom


def screw_resolution(step: Estimate, ratio: Estimate) -> Estimate:
    """Return the resolution of a stage with a screw: smallest step of the screw times ratio.

    Parameters
    ----------
    step : Estimate
        Smallest step of the screw [m].
    ratio : Estimate
        Displacement of the stage over that of the screw [1].

    Returns
    -------
    Estimate
        The product, with the uncertainties of both, taken as independent.

    Examples
    --------
    >>> step = Estimate.of(1e-6, 0.05e-6, "m", source="division")
    >>> ratio = Estimate(value=-0.157, unit="1")
    >>> smallest = screw_resolution(step, ratio)
    >>> print(f"{1e9 * smallest.value:.0f} nm +- {1e9 * smallest.expanded:.0f} nm")
    157 nm +- 15 nm
    """
    size, factor = abs(step.value), abs(ratio.value)
    product = step.times(math.copysign(factor, step.value))
    # bounds of the ratio, if any, are replaced by its standard uncertainty
    return product.plus(
        *(
            replace(c, name=f"ratio: {c.name}", uncertainty=size * c.uncertainty)
            for c in ratio.components
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StaircaseStep:
    """One step of a staircase."""

    size: Estimate
    """Measured step."""
    commanded: float
    """Commanded step, in the unit of the command; nan without a command."""
    resolved: str
    """Whether it exceeds the resolution: yes, no, or undecided within its interval."""
    probability: float
    """Probability that a step of this size is resolved [1]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Staircase:
    """Result of a staircase test."""

    steps: tuple[StaircaseStep, ...]
    """The steps in order."""
    sizes: tuple[Estimate, ...]
    """Mean magnitude of the steps of each commanded size, the largest first; the note has the
    number of resolved steps.
    """
    resolution: Estimate
    """Step that is resolved with `probability`, by averages of `samples` samples."""
    smallest_resolved: Estimate | None
    """The smallest of `sizes` whose steps are all resolved."""
    probability: float
    """Confidence [1]."""
    samples: int
    """Samples per average on each level."""
    bandwidth_hz: float
    """Noise bandwidth of that average [Hz]."""
    levels: Array
    """Means of the levels without drift, shape (k,)."""
    bounds: Integers
    """First and after last averaged sample of each level, shape (k, 2)."""
    drift: Estimate
    """Drift within the levels, in their unit per second."""
    notes: tuple[str, ...] = ()
    """Remarks on the result."""


def staircase(
    values: ArrayLike,
    sample_rate_hz: float,
    bounds: ArrayLike,
    *,
    command: ArrayLike | None = None,
    samples: int | None = None,
    probability: float = 0.95,
    settling: float = 0.3,
    unit: str = "m",
) -> Staircase:
    """Return the steps of a staircase, and which of them are resolved.

    Each level after settling is fitted by its mean, with one drift for all. The uncertainty of a
    mean is that of means of six parts of each level about the fit, so that neighbouring samples may
    be correlated; steps are differences of neighbouring levels, with the covariance from their
    common level and drift.

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    bounds : array_like
        First sample of each level and the sample after the last, shape (k + 1,).
    command : array_like, optional
        The command at each sample, shape (n,): steps of the same commanded size are one size.
    samples : int, optional
        Samples per average; half of the shortest level if not given.
    probability : float
        Confidence of a resolved step [1].
    settling : float
        Share of each level that is omitted at its start, from 0 to below 1.
    unit : str
        Unit of the readings.

    Returns
    -------
    Staircase
        Steps, sizes and resolution.

    Validity
    --------
    The drift is steady, noise shorter than an eighth of a level, and Gaussian. Creep after
    `settling` reduces the steps, and counts as drift if all steps have one sign: step up and down.
    A note reports levels whose slope or curvature follows the steps.

    Raises
    ------
    RecordError
        The readings are not finite, the bounds do not fit them, or a level is too short.
    ModelError
        The settling share, the probability or the number of samples is not possible.

    Examples
    --------
    >>> command = np.repeat(np.arange(8) * 10e-9, 400)
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(command.size)
    >>> test = staircase(command + noise, 1000.0, np.arange(9) * 400, command=command)
    >>> print(f"{1e9 * test.sizes[0].value:.2f} nm; resolution {1e9 * test.resolution.value:.2f}")
    10.00 nm; resolution 0.96
    >>> test.steps[0].resolved, test.samples
    ('yes', 140)
    """
    from scipy.special import ndtr, ndtri

    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise RecordError(f"the readings must be one finite number for each time, got {y.shape}")
    spans = settled(bounds, y.size, settling)
    fit = fit_levels(y, spans)
    shortest = int(np.diff(spans, axis=1).min())
    averaged = shortest // 2 if samples is None else samples
    smallest = resolution(
        y, sample_rate_hz, samples=averaged, probability=probability, bounds=spans, unit=unit
    )
    measured = np.diff(fit.means)
    commanded = _commanded_steps(command, spans, y.size)
    halves = ndtri(probability) / smallest.value
    steps = tuple(
        StaircaseStep(
            size=fit.combination(np.eye(measured.size)[i], unit),
            commanded=float(commanded[i]),
            resolved=_is_resolved(abs(measured[i]), smallest),
            probability=float(ndtr(abs(measured[i]) * halves)),
        )
        for i in range(measured.size)
    )
    sizes, all_resolved = _sizes(fit, measured, commanded, steps, unit)
    resolved = [size for size, every in zip(sizes, all_resolved, strict=True) if every]
    return Staircase(
        steps=steps,
        sizes=sizes,
        resolution=smallest,
        smallest_resolved=min(resolved, key=lambda s: s.value) if resolved else None,
        probability=probability,
        samples=averaged,
        bandwidth_hz=0.5 * sample_rate_hz / averaged,
        levels=fit.means,
        bounds=spans,
        drift=fit.drift(sample_rate_hz, unit),
        notes=_settling_note(fit, measured),
    )


def _commanded_steps(command: ArrayLike | None, spans: Integers, n: int) -> Array:
    if command is None:
        return np.full(len(spans) - 1, np.nan)
    u = np.asarray(command, dtype=np.float64)
    if u.shape != (n,) or not np.isfinite(u).all():
        raise RecordError(f"the command must be finite for each of {n} samples, got {u.shape}")
    return np.diff([float(np.median(u[a:b])) for a, b in spans.tolist()])


def _is_resolved(size: float, resolution: Estimate) -> str:
    low, high = resolution.interval()
    return "yes" if size >= high else "no" if size < low else "undecided"


def _sizes(
    fit: LevelFit, measured: Array, commanded: Array, steps: tuple[StaircaseStep, ...], unit: str
) -> tuple[tuple[Estimate, ...], list[bool]]:
    """Return the mean magnitude of equal commanded steps, and whether all are resolved."""
    has_command = np.isfinite(commanded).all()
    magnitude = np.abs(commanded) if has_command else np.zeros(measured.size)
    order = np.argsort(-magnitude)
    # sizes that differ by less than a hundredth of the larger are the same
    new = np.concatenate(([True], np.diff(magnitude[order]) < -0.01 * magnitude[order][:-1]))
    group = np.empty(measured.size, dtype=np.intp)
    group[order] = np.cumsum(new) - 1
    estimates, every = [], []
    for g in range(int(group.max()) + 1):
        inside = group == g
        sign = np.sign(commanded) if has_command else np.sign(measured)
        weights = np.where(inside, sign, 0.0) / inside.sum()
        resolved = [steps[i].resolved for i in np.flatnonzero(inside)]
        mean = fit.combination(weights, unit)
        note = f"{resolved.count('yes')} of {len(resolved)} steps resolved"
        estimates.append(replace(mean, note=note))
        every.append(resolved.count("yes") == len(resolved))
    return tuple(estimates), every


def _settling_note(fit: LevelFit, measured: Array) -> tuple[str, ...]:
    """Return a note if the change within levels correlates with the step before them."""
    if measured.size < 4:
        return ()
    parts, half, third = fit.residuals[1:], PARTS // 2, PARTS // 3
    change = parts[:, half:].mean(axis=1) - parts[:, :half].mean(axis=1)
    # steps of one sign give all levels an equal slope, which counts as drift, unlike the curvature
    curvature = 2.0 * parts[:, third:-third].mean(axis=1)
    curvature -= parts[:, :third].mean(axis=1) + parts[:, -third:].mean(axis=1)
    # least significant settling, in standard errors
    significant = 4.0
    for response in (curvature, change):
        share = float(response @ measured / (measured @ measured))
        residual = response - share * measured
        variance = float(residual @ residual) / (measured.size - 1)
        error = math.sqrt(variance / float(measured @ measured))
        if abs(share) > significant * error:
            how = "creeps" if share > 0.0 else "recovers from an overshoot"
            return (
                f"the reading still {how} after a step within the averaged samples: increase the "
                "settling share, or dwell longer",
            )
    return ()
