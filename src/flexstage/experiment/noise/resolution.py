"""Resolution: the step that averages of a noisy reading tell from none."""

import math

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Integers
from flexstage.errors import ModelError, RecordError
from flexstage.estimate import Component, Estimate
from flexstage.experiment.noise.allan import allan_freedom, deviation_bounds, power_of_noise


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
    low, high = deviation_bounds(deviation, freedom)
    spread = Component(
        name="finite record",
        uncertainty=factor * deviation / math.sqrt(2.0 * freedom),
        degrees_of_freedom=freedom,
    )
    return Estimate(
        value=factor * deviation,
        unit=unit,
        components=(spread,),
        bounds=(factor * low, factor * high),
        note=(
            f"two averages of {samples} samples, bandwidth "
            f"{0.5 * sample_rate_hz / samples:.4g} Hz, distinguishable at {100.0 * probability:g} %"
        ),
    )


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
        freedom += allan_freedom(b - a, m, kind, "overlapping")
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
    >>> turn = Component(name="division", uncertainty=0.05e-6, kind="B")
    >>> step = Estimate(value=1e-6, unit="m", components=(turn,))
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
            Component(
                name=f"ratio: {c.name}",
                uncertainty=size * c.uncertainty,
                degrees_of_freedom=c.degrees_of_freedom,
                kind=c.kind,
            )
            for c in ratio.components
        )
    )
