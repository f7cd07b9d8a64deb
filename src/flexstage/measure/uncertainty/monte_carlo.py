"""The distribution of a result by drawing its influences at random (JCGM 101:2008)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.measure.uncertainty.propagate import (
    Correlations,
    Influence,
    Propagated,
    correlation_matrix,
    groups,
)
from flexstage.quantities.estimate import Component, Estimate

_Draw = Callable[[np.random.Generator, int], list[Array]]
#: Trials drawn from one stream.
BLOCK = 10_000
#: Blocks before an adaptive run may end: two can agree by chance (Wuebbeler, Harris, Cox and
#: Elster, 2010, Metrologia 47, 317).
_LEAST = 20
_MOST = 2_000
_FINEST = 3e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MonteCarlo:
    """A result drawn at random."""

    value: float
    """Mean of the trials, in `unit`."""
    uncertainty: float
    """Their standard deviation, in `unit`."""
    unit: str
    """Unit of the result."""
    confidence: float
    """Probability that an interval holds the value [1]."""
    symmetric: tuple[float, float]
    """Probabilistically symmetric interval: as much below as above it, in `unit`."""
    shortest: tuple[float, float]
    """The shortest interval, in `unit`."""
    values: Array
    """The trials, rising, in `unit`, shape (trials,)."""
    tolerance: float | None
    """Numerical tolerance that value, uncertainty and both ends of the symmetric interval have come
    to rest within, in `unit`; None where the number of trials was given.
    """
    seed: int
    """Seed of the draws."""

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.values.size

    def estimate(self) -> Estimate:
        """Return mean, spread, and the symmetric interval as the bounds of the value.

        It needs the intervals to be for a confidence of 0.95.
        """
        if self.confidence != 0.95:
            raise ModelError(f"an estimate is bounded at 0.95, these are for {self.confidence!r}")
        part = Component(name="all influences", uncertainty=self.uncertainty, kind="B")
        return Estimate(
            value=self.value,
            unit=self.unit,
            components=(part,),
            bounds=self.symmetric,
            note=f"Monte Carlo, {self.trials} trials",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """Whether the first-order interval may be used in place of the Monte Carlo one."""

    valid: bool
    """Whether both ends agree."""
    tolerance: float
    """How near they must be: half of the last of `digits` significant digits of the uncertainty."""
    low: float
    """Distance of the lower ends."""
    high: float
    """Distance of the upper ends."""
    digits: int
    """Significant digits of the uncertainty that are meant."""


def numerical_tolerance(uncertainty: float, digits: int = 2) -> float:
    """Return half of the last significant digit of an uncertainty (JCGM 101:2008, 7.9.2).

    Examples
    --------
    >>> numerical_tolerance(0.0754), numerical_tolerance(0.0754, 1)
    (0.0005, 0.005)
    """
    if uncertainty <= 0.0:
        return 0.0
    # by its printed digits, so that 0.0996 counts as 0.10
    exponent = int(f"{uncertainty:.{digits - 1}e}".partition("e")[2])
    return 0.5 * 10.0 ** (exponent - digits + 1)


def monte_carlo(
    function: Callable[..., Any],
    influences: Sequence[Influence],
    correlations: Correlations | None = None,
    *,
    trials: int | Literal["auto"] = "auto",
    seed: int = 0,
    confidence: float = 0.95,
    digits: int = 2,
    unit: str = "",
) -> MonteCarlo:
    """Draw a result at random, by JCGM 101:2008.

    With ``auto``, blocks of 10 000 trials are added until twice the standard deviations of the mean
    over the blocks of value, uncertainty, and both ends of the interval are below a fifth of the
    numerical tolerance (7.9.4 and 8.2 there), or below 0.3 % of the uncertainty where that is more.

    Parameters
    ----------
    function : callable
        The result from the influences, in their order; it takes arrays, shape (10 000,).
    influences : sequence of Influence
        What it depends on.
    correlations : Mapping, optional
        Correlation coefficients by the names of two influences.
    trials : int or "auto"
        Number of trials, at least 1000; or as many as the tolerance needs, 200 000 or more.
    seed : int
        Seed; block i draws from stream i of it, so that more trials begin with the same.
    confidence : float
        Probability that the intervals hold the value [1].
    digits : int
        Significant digits of the uncertainty that are wanted of ``auto``, 1 to 3.
    unit : str
        Unit of the result.

    Returns
    -------
    MonteCarlo
        Mean, standard deviation, both intervals, and the trials.

    Raises
    ------
    ModelError
        There is no influence, a figure is impossible, the correlations are, or a trial has no
        finite value.
    ConvergenceError
        20 million trials do not reach the tolerance, as where the result has no variance.

    Notes
    -----
    Validity: the intervals are those of the distribution of the influences as they are declared.
    The least number of blocks guards against stopping by chance; it makes no proof.

    Examples
    --------
    >>> wide = [Influence(name=n, value=0.0, half_width=3.0**0.5) for n in "abcd"]
    >>> found = monte_carlo(lambda a, b, c, d: a + b + c + d, wide, trials=400_000)
    >>> print(f"{found.uncertainty:.1f}, {found.symmetric[1]:.1f}")
    2.0, 3.9
    """
    if not influences:
        raise ModelError("a result needs at least one influence, got none")
    if not 0.0 < confidence < 1.0:
        raise ModelError(f"the confidence must be between 0 and 1, got {confidence!r}")
    if trials != "auto" and not 1000 <= trials <= BLOCK * _MOST:
        raise ModelError(f"the trials must be 1000 to {BLOCK * _MOST}, or 'auto', got {trials!r}")
    if not 1 <= digits <= 3:
        raise ModelError(f"the significant digits of an uncertainty must be 1 to 3, got {digits}")
    draw = sampler(influences, correlation_matrix(influences, (correlations or {}).items()))

    def block(index: int, count: int) -> Array:
        stream = np.random.SeedSequence(seed, spawn_key=(index,))
        return _evaluated(function, draw(np.random.default_rng(stream), BLOCK))[:count]

    if trials == "auto":
        parts, tolerance = _adaptive(block, confidence, digits)
    else:
        sizes = [min(BLOCK, trials - first) for first in range(0, trials, BLOCK)]
        parts, tolerance = [block(i, size) for i, size in enumerate(sizes)], None
    values = np.sort(np.concatenate(parts))
    symmetric, shortest = _intervals(values, confidence)
    return MonteCarlo(
        value=float(values.mean()),
        uncertainty=float(values.std(ddof=1)),
        unit=unit,
        confidence=confidence,
        symmetric=symmetric,
        shortest=shortest,
        values=values,
        tolerance=tolerance,
        seed=seed,
    )


def _evaluated(function: Callable[..., Any], samples: list[Array]) -> Array:
    with np.errstate(all="ignore"):
        try:
            results = np.asarray(function(*samples), dtype=np.float64)
        except (ArithmeticError, ValueError, TypeError) as error:
            raise ModelError(f"the result cannot be computed from arrays: {error}") from error
    values = np.broadcast_to(results, samples[0].shape) if results.ndim == 0 else results
    if values.shape != samples[0].shape:
        raise ModelError(f"the result must be one number a trial, got an array {values.shape}")
    wrong = int(np.count_nonzero(~np.isfinite(values)))
    if wrong:
        raise ModelError(
            f"the result is not finite in {wrong} of {values.size} trials: its influences reach "
            "values at which it is undefined"
        )
    return values


def _adaptive(
    block: Callable[[int, int], Array], confidence: float, digits: int
) -> tuple[list[Array], float]:
    parts: list[Array] = []
    rows: list[tuple[float, float, float, float]] = []
    count = _LEAST
    while True:
        while len(parts) < count:
            one = block(len(parts), BLOCK)
            low, high = np.quantile(one, (0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence))
            rows.append((float(one.mean()), float(one.std(ddof=1)), float(low), float(high)))
            parts.append(one)
            progress.update("drawing trials", min(len(parts) / count, 1.0))
        table = np.array(rows)
        # the spread of all trials, as the root of the mean square of the blocks
        u = math.sqrt(float(np.mean(table[:, 1] ** 2)) + float(np.var(table[:, 0])))
        # a fifth of half a digit would be one in a thousand of 0.99, for 30 million trials
        tolerance = max(0.2 * numerical_tolerance(u, digits), _FINEST * u)
        # nor does rounding fall with the number
        tolerance = max(tolerance, float(np.spacing(np.abs(table[:, 0]).max())))
        error = 2.0 * table.std(axis=0, ddof=1).max() / math.sqrt(len(parts))
        if error <= tolerance:
            return parts, tolerance
        if len(parts) >= _MOST:
            raise ConvergenceError(
                f"{_MOST * BLOCK} trials give an error of {error:.2g} in an uncertainty {u:.3g}, "
                f"more than {tolerance:.2g}: ask for fewer significant digits, or give the number "
                "of trials"
            )
        # errors fall with the root of the number; the estimate of it may be off
        needed = len(parts) * (error / tolerance) ** 2
        count = int(min(_MOST, max(len(parts) + 1, min(1.05 * needed, 4.0 * len(parts)))))


def _intervals(values: Array, confidence: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Symmetric and shortest interval of sorted trials (JCGM 101:2008, 7.7)."""
    m = values.size
    q = min(int(confidence * m + 0.5), m - 1)
    first = (m - q) // 2
    widths = values[q:] - values[: m - q]
    least = int(np.argmin(widths))
    return (
        (float(values[first]), float(values[first + q])),
        (float(values[least]), float(values[least + q])),
    )


def validate(propagated: Propagated, simulated: MonteCarlo, *, digits: int = 2) -> Validation:
    """Say whether the first-order interval agrees with the Monte Carlo one (JCGM 101:2008, 8).

    Parameters
    ----------
    propagated : Propagated
        The result to first order.
    simulated : MonteCarlo
        The same result, drawn at random.
    digits : int
        Significant digits of the uncertainty that must be right.

    Returns
    -------
    Validation
        Distances of the ends of the symmetric intervals, and their assessment.

    Examples
    --------
    >>> from flexstage.measure.uncertainty.propagate import propagate
    >>> x = Influence(name="x", value=3.0, uncertainty=0.2)
    >>> first = propagate(lambda x: 2 * x, [x])
    >>> validate(first, monte_carlo(lambda x: 2 * x, [x], seed=4)).valid
    True
    """
    tolerance = numerical_tolerance(propagated.uncertainty, digits)
    ends = propagated.interval(simulated.confidence)
    low, high = (abs(a - b) for a, b in zip(ends, simulated.symmetric, strict=True))
    return Validation(
        valid=max(low, high) <= tolerance, tolerance=tolerance, low=low, high=high, digits=digits
    )


def sampler(influences: Sequence[Influence], matrix: Array) -> _Draw:
    """Return a function that draws all influences at once.

    An influence without correlations is drawn from its own distribution. Correlated normal ones are
    drawn together; correlated Student ones of the same degrees of freedom as a multivariate t
    distribution, since they were observed together; no others can be correlated. The function takes
    a random generator and a number of draws m, and gives n arrays of shape (m,).

    Examples
    --------
    >>> pair = [Influence(name=n, value=0.0, uncertainty=2.0) for n in "ab"]
    >>> draw = sampler(pair, np.array([[1.0, 0.7], [0.7, 1.0]]))
    >>> a, b = draw(np.random.default_rng(1), 100_000)
    >>> round(float(np.corrcoef(a, b)[0, 1]), 2)
    0.7
    """
    together = groups(matrix)
    draws = [
        _group([influences[k] for k in group], matrix[np.ix_(group, group)]) for group in together
    ]

    def draw(generator: np.random.Generator, count: int) -> list[Array]:
        columns: dict[int, Array] = {}
        for group, one in zip(together, draws, strict=True):
            columns.update(zip(group, one(generator, count), strict=True))
        return [columns[k] for k in range(len(influences))]

    return draw


def _group(members: Sequence[Influence], matrix: Array) -> _Draw:
    if len(members) == 1:
        return lambda generator, count: [members[0].draw(generator, count)]
    laws = {(m.law, m.degrees_of_freedom if m.law == "student" else 0.0) for m in members}
    law, freedom = laws.pop()
    if laws or law not in ("normal", "student"):
        names = " and ".join(f"'{m.name}' ({m.law})" for m in members)
        raise ModelError(
            f"the influences {names} are correlated, and only normal ones, or Student ones of "
            "equal degrees of freedom, can be drawn together: give each its standard uncertainty, "
            "with the distribution normal"
        )
    values, vectors = np.linalg.eigh(matrix)
    # a root of the matrix, which may be singular
    root = vectors * np.sqrt(np.clip(values, 0.0, None))

    def draw(generator: np.random.Generator, count: int) -> list[Array]:
        z = root @ generator.standard_normal((len(members), count))
        if law == "student":
            z = z / np.sqrt(generator.chisquare(freedom, count) / freedom)
        return [m.value + m.standard_uncertainty * row for m, row in zip(members, z, strict=True)]

    return draw
