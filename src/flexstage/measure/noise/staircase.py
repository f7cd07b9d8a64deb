"""Resolution: by noise alone, and by the levels of a staircase whose steps are told from none."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Integers
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.noise.hold import allan_freedom, power_of_noise
from flexstage.quantities.estimate import Estimate

#: Parts of a level whose means tell how certain its mean is.
PARTS = 6


def levels_of_command(command: ArrayLike, *, shortest: int = 1) -> Integers:
    """Return the bounds of the stretches in which a command stays.

    First sample of each level, and the sample after the last. Stretches shorter than `shortest`, as
    of a ramp between two levels, are given to what follows.

    Examples
    --------
    >>> levels_of_command([0.0, 0.0, 0.0, 0.7, 0.7, 1.4, 1.4, 1.4])
    array([0, 3, 5, 8])
    """
    u = np.asarray(command, dtype=np.float64)
    if u.ndim != 1 or u.size < 2 or not np.isfinite(u).all():
        raise RecordError(f"a command is one finite number for each sample, got shape {u.shape}")
    starts = np.concatenate(([0], np.flatnonzero(np.diff(u)) + 1))
    lengths = np.diff(np.append(starts, u.size))
    # the samples of a ramp are the beginning of the level that it leads to
    after_ramp = np.concatenate(([False], lengths[:-1] < shortest))
    keep = ~after_ramp
    keep[0] = True
    bounds = np.append(starts[keep], u.size).astype(np.intp)
    if bounds.size < 3:
        raise RecordError("the command has fewer than two levels: name the column that holds it")
    return bounds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelFit:
    """Means of levels and one drift for all."""

    means: Array
    """Means of the levels as if all were at the middle of the record, shape (k,)."""
    slope: float
    """Drift in a sample."""
    rest: Array
    """Means of the parts of each level less the fit, shape (k, parts)."""
    covariance: Array
    """Covariance of the means and the slope, shape (k + 1, k + 1)."""
    degrees_of_freedom: float
    """Of that."""

    def combination(self, weights: Array, unit: str) -> Estimate:
        """Return the sum of the steps times weights."""
        by = np.concatenate([np.diff(-weights, prepend=0.0, append=0.0), [0.0]])
        return self._estimate(float(by[:-1] @ self.means), by, unit)

    def drift(self, rate: float, unit: str) -> Estimate:
        """Return the drift within the levels.

        In the unit of the readings in a second; `rate` in Hz.
        """
        by = np.concatenate([np.zeros(self.means.size), [rate]])
        return self._estimate(rate * self.slope, by, f"{unit}/s")

    def _estimate(self, value: float, by: Array, unit: str) -> Estimate:
        uncertainty = math.sqrt(max(float(by @ self.covariance @ by), 0.0))
        return Estimate.of(value, uncertainty, unit, degrees_of_freedom=self.degrees_of_freedom)


def fit_levels(y: Array, spans: Integers) -> LevelFit:
    """Fit means of levels and one drift, to means of parts of the levels.

    The covariance is from what the parts differ from the fit by.
    """
    k = len(spans)
    z, t = np.empty((k, PARTS)), np.empty((k, PARTS))
    for i, (a, b) in enumerate(spans.tolist()):
        length = (b - a) // PARTS
        start = b - PARTS * length
        z[i] = y[start:b].reshape(PARTS, length).mean(axis=1)
        t[i] = start + length * np.arange(PARTS) + 0.5 * (length - 1)
    # longer levels have the surer parts
    weight = np.diff(spans, axis=1) / np.diff(spans, axis=1).mean()
    middle = float(t.mean())
    inner = t - t.mean(axis=1, keepdims=True)
    spread = float(np.sum(weight * inner**2))
    slope = float(np.sum(weight * inner * z)) / spread
    level_z, level_t = z.mean(axis=1), t.mean(axis=1) - middle
    rest = z - level_z[:, None] - slope * inner
    freedom = k * (PARTS - 1) - 1
    variance = float(np.sum(weight * rest**2)) / freedom
    # what neighbouring parts share makes a mean of them less certain; a mean that is taken off
    # makes them look opposed by 1 / parts
    shared = float(np.sum(weight * rest[:, 1:] * rest[:, :-1])) / (k * (PARTS - 1))
    linked = shared / variance + 1.0 / PARTS if variance > 0.0 else 0.0
    if linked > 1.0 / math.sqrt(k * (PARTS - 1)):
        variance *= 1.0 + 2.0 * min(linked, 0.5)
    # levels at the middle of the record: mean less slope times its distance from there
    covariance = np.zeros((k + 1, k + 1))
    covariance[:k, :k] = np.diag(variance / (PARTS * weight[:, 0]))
    lever = np.append(-level_t, 1.0)
    covariance += np.outer(lever, lever) * variance / spread
    return LevelFit(
        means=level_z - slope * level_t,
        slope=slope,
        rest=rest,
        covariance=covariance,
        degrees_of_freedom=float(freedom),
    )


def settled(bounds: ArrayLike, n: int, settling: float) -> Integers:
    """Return the first and after last sample of each level without its start.

    The bounds are the first sample of each level and the sample after the last, shape (k + 1,); the
    stretches have shape (k, 2).
    """
    edges = np.asarray(bounds, dtype=np.intp)
    if not 0.0 <= settling < 1.0:
        raise ModelError(f"the share left out for settling is 0 to below 1, got {settling!r}")
    if edges.ndim != 1 or edges.size < 3 or np.any(np.diff(edges) < 1) or edges[0] < 0:
        raise RecordError("a staircase has two levels or more whose bounds rise from 0")
    if edges[-1] > n:
        raise RecordError(f"the levels end at sample {edges[-1]} of {n}: their bounds are others'")
    starts = edges[:-1] + np.ceil(settling * np.diff(edges)).astype(np.intp)
    spans = np.stack([starts, edges[1:]], axis=1)
    shortest = int(np.diff(spans, axis=1).min())
    if shortest < PARTS:
        raise RecordError(
            f"the shortest level has {shortest} samples after settling, {PARTS} are needed: hold "
            "it for longer, or leave out less"
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
    """Return the step that averages of so many samples tell from no step.

    Two neighbouring averages of n samples differ with the standard deviation ``sqrt(2) s(n)``, s
    being the Allan deviation at n. A difference of more than half a step R counts as a step. No
    step is taken for one, and a step for none, with probability 1 - P each where
    ``R = 2 sqrt(2) z_P s(n)``, z_P the quantile of the normal distribution (Currie, 1968,
    Analytical Chemistry 40, whose detection limit has both risks alike).

    Parameters
    ----------
    values : array_like
        Evenly spaced readings, shape (n,).
    sample_rate_hz : float
        Readings in a second [Hz].
    samples : int
        Samples that are averaged, one or more: the bandwidth of the average is the rate over twice
        this.
    probability : float
        The confidence P [1], from 0.5 to 1.
    bounds : array_like, optional
        First and after last sample of stretches in which the stage stood, shape (k, 2); the whole
        record where not given.
    unit : str
        Unit of the readings.

    Returns
    -------
    Estimate
        The resolution, with chi-squared bounds.

    Validity
    --------
    Gaussian noise. Drift during the two averages counts as noise; settling between them does not,
    as the averages follow one another without a pause.

    Raises
    ------
    RecordError
        A reading is not finite, no stretch is twice as long as the average, or none changes.
    ModelError
        The probability, the rate or the number of samples is not possible.

    Examples
    --------
    >>> noise = 3e-9 * np.random.default_rng(4).standard_normal(20_000)
    >>> found = resolution(noise, 1000.0, samples=100)
    >>> print(f"{1e9 * found.value:.2f} nm ({found.note})")
    1.38 nm (two averages of 100 samples, bandwidth 5 Hz, distinguishable at 95 %)
    """
    from scipy.special import ndtri

    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise RecordError(f"the readings must be one finite number for each time, got {y.shape}")
    if not 0.5 < probability < 1.0:
        raise ModelError(f"a confidence lies between 0.5 and 1 here, got {probability!r}")
    if samples < 1 or not 0.0 < sample_rate_hz < math.inf:
        raise ModelError(
            f"one sample or more is averaged at a positive rate, got {samples} at "
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
    """Allan deviation over all stretches, and its degrees of freedom."""
    power, count, freedom = 0.0, 0, 0.0
    long = [(a, b) for a, b in spans.tolist() if b - a >= 2 * m]
    if not long:
        raise RecordError(
            f"no level has the two times {m} samples that are to be averaged: average fewer, or "
            "hold each level for longer"
        )
    # the kind of noise is that of the longest averages of which a stretch has enough to tell; noise
    # that hangs together there is taken for slower than it is, with fewer degrees of freedom
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
        raise RecordError(
            "no reading differs from its neighbours: the sensor is dead, or too coarse"
        )
    return math.sqrt(power / (2.0 * count)) / m, freedom


def screw_resolution(step: Estimate, ratio: Estimate) -> Estimate:
    """Return the resolution of a stage behind a screw: smallest step of the screw times ratio.

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
    >>> found = screw_resolution(step, ratio)
    >>> print(f"{1e9 * found.value:.0f} nm +- {1e9 * found.expanded:.0f} nm")
    157 nm +- 15 nm
    """
    size, factor = abs(step.value), abs(ratio.value)
    product = step.times(math.copysign(factor, step.value))
    # bounds of the ratio, where it has any, are replaced by its standard uncertainty
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
    """The step that was made."""
    commanded: float
    """The step that was asked for, in the unit of the command; nan where there is no command."""
    told: str
    """Whether it is larger than the resolution; undecided within the interval of that."""
    probability: float
    """Chance that a step of this size is told from none [1]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Staircase:
    """What a staircase test shows."""

    steps: tuple[StaircaseStep, ...]
    """The steps in order."""
    sizes: tuple[Estimate, ...]
    """Mean magnitude of the steps of each size that was asked for, the largest first; the note
    tells how many were told.
    """
    resolution: Estimate
    """Step that is told from none with `probability`, by averages of `samples` samples."""
    smallest_told: Estimate | None
    """The smallest of `sizes` of which all steps are told."""
    probability: float
    """The stated confidence [1]."""
    samples: int
    """Samples that are averaged on each level."""
    bandwidth_hz: float
    """Noise bandwidth of that average [Hz]."""
    levels: Array
    """Means of the levels without drift, shape (k,)."""
    bounds: Integers
    """First and after last sample of each level that its mean is of, shape (k, 2)."""
    drift: Estimate
    """Drift within the levels, their unit in a second."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


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
    """Return the steps of a staircase, and which of them are told from none.

    What is left of each level after settling is fitted by its mean and one drift for all. The
    uncertainty of a mean is that of means of six parts of each level about the fit, so that
    neighbouring samples may hang together; steps are differences of neighbouring levels, with the
    covariance that they have through the level and the drift that they share.

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
        Samples that are averaged to tell a step; half of the shortest level where not given.
    probability : float
        Confidence at which a step is to be told from none [1].
    settling : float
        Share of each level that is left out at its start, from 0 to below 1.
    unit : str
        Unit of the readings.

    Returns
    -------
    Staircase
        Steps, sizes, resolution, verdicts.

    Validity
    --------
    The drift is steady, noise shorter than an eighth of a level, and Gaussian. Creep that goes on
    after `settling` makes steps small, and where all steps have one sign it passes for drift: step
    up and down. The notes say where the levels lean or bend with the steps.

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
    >>> found = staircase(command + noise, 1000.0, np.arange(9) * 400, command=command)
    >>> print(f"{1e9 * found.sizes[0].value:.2f} nm; resolution {1e9 * found.resolution.value:.2f}")
    10.00 nm; resolution 0.96
    >>> found.steps[0].told, found.samples
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
    told = resolution(
        y, sample_rate_hz, samples=averaged, probability=probability, bounds=spans, unit=unit
    )
    made = np.diff(fit.means)
    asked = _asked(command, spans, y.size)
    halves = ndtri(probability) / told.value
    steps = tuple(
        StaircaseStep(
            size=fit.combination(np.eye(made.size)[i], unit),
            commanded=float(asked[i]),
            told=_verdict(abs(made[i]), told),
            probability=float(ndtr(abs(made[i]) * halves)),
        )
        for i in range(made.size)
    )
    sizes, verdicts = _sizes(fit, made, asked, steps, unit)
    smallest = [size for size, every in zip(sizes, verdicts, strict=True) if every]
    return Staircase(
        steps=steps,
        sizes=sizes,
        resolution=told,
        smallest_told=min(smallest, key=lambda s: s.value) if smallest else None,
        probability=probability,
        samples=averaged,
        bandwidth_hz=0.5 * sample_rate_hz / averaged,
        levels=fit.means,
        bounds=spans,
        drift=fit.drift(sample_rate_hz, unit),
        notes=_settling_note(fit, made),
    )


def _asked(command: ArrayLike | None, spans: Integers, n: int) -> Array:
    if command is None:
        return np.full(len(spans) - 1, np.nan)
    u = np.asarray(command, dtype=np.float64)
    if u.shape != (n,) or not np.isfinite(u).all():
        raise RecordError(f"the command must be finite, one for each of {n} samples, got {u.shape}")
    return np.diff([float(np.median(u[a:b])) for a, b in spans.tolist()])


def _verdict(size: float, told: Estimate) -> str:
    low, high = told.interval()
    return "yes" if size >= high else "no" if size < low else "undecided"


def _sizes(
    fit: LevelFit, made: Array, asked: Array, steps: tuple[StaircaseStep, ...], unit: str
) -> tuple[tuple[Estimate, ...], list[bool]]:
    """Mean magnitude of the steps that were asked to be the same, and whether all are told."""
    known = np.isfinite(asked).all()
    magnitude = np.abs(asked) if known else np.zeros(made.size)
    order = np.argsort(-magnitude)
    # sizes that differ by less than a hundredth of the larger are the same
    new = np.concatenate(([True], np.diff(magnitude[order]) < -0.01 * magnitude[order][:-1]))
    group = np.empty(made.size, dtype=np.intp)
    group[order] = np.cumsum(new) - 1
    estimates, every = [], []
    for g in range(int(group.max()) + 1):
        inside = group == g
        sign = np.sign(asked) if known else np.sign(made)
        weights = np.where(inside, sign, 0.0) / inside.sum()
        verdicts = [steps[i].told for i in np.flatnonzero(inside)]
        mean = fit.combination(weights, unit)
        note = f"{verdicts.count('yes')} of {len(verdicts)} steps resolved"
        estimates.append(replace(mean, note=note))
        every.append(verdicts.count("yes") == len(verdicts))
    return tuple(estimates), every


def _settling_note(fit: LevelFit, made: Array) -> tuple[str, ...]:
    """Say whether what the levels do in themselves goes with the step before them."""
    if made.size < 4:
        return ()
    rest, half, third = fit.rest[1:], PARTS // 2, PARTS // 3
    change = rest[:, half:].mean(axis=1) - rest[:, :half].mean(axis=1)
    # steps of one sign lean all levels alike, which passes for drift: their bend does not
    bend = 2.0 * rest[:, third:-third].mean(axis=1)
    bend -= rest[:, :third].mean(axis=1) + rest[:, -third:].mean(axis=1)
    # how often a settling that is left exceeds its standard error before it is spoken of
    settling = 4.0
    for leaned in (bend, change):
        share = float(leaned @ made / (made @ made))
        left = leaned - share * made
        error = math.sqrt(float(left @ left) / (made.size - 1) / float(made @ made))
        if abs(share) > settling * error:
            how = "creeps on after" if share > 0.0 else "comes back from an overshoot after"
            return (
                f"the reading still {how} a step within what is averaged: leave out more, or wait "
                "for longer",
            )
    return ()
