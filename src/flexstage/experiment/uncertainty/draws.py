"""Draws the influences of a result at random, with their correlations."""

from collections.abc import Callable, Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.experiment.uncertainty.correlation import groups, normal_correlations
from flexstage.experiment.uncertainty.influence import Influence

_Draw = Callable[[np.random.Generator, int], list[Array]]


def sampler(influences: Sequence[Influence], matrix: Array) -> _Draw:
    """Return a function that draws all influences at once.

    An influence without correlations is drawn from its own distribution. Correlated normal ones are
    drawn together; correlated Student ones of the same degrees of freedom as a multivariate t
    distribution, since they were observed together; others by a Gaussian copula. The function takes
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
        found: dict[int, Array] = {}
        for group, one in zip(together, draws, strict=True):
            found.update(zip(group, one(generator, count), strict=True))
        return [found[k] for k in range(len(influences))]

    return draw


def _group(members: Sequence[Influence], matrix: Array) -> _Draw:
    if len(members) == 1:
        return lambda generator, count: [members[0].draw(generator, count)]
    laws = {(m.law, m.degrees_of_freedom if m.law == "student" else 0.0) for m in members}
    alike = len(laws) == 1 and members[0].law in {"normal", "student"}
    root = _root(matrix if alike else normal_correlations(members, matrix))
    freedom = members[0].degrees_of_freedom

    def draw(generator: np.random.Generator, count: int) -> list[Array]:
        from scipy.special import ndtr

        z = root @ generator.standard_normal((len(members), count))
        if not alike:
            return [m.quantile(ndtr(row)) for m, row in zip(members, z, strict=True)]
        if members[0].law == "student":
            z = z / np.sqrt(generator.chisquare(freedom, count) / freedom)
        return [m.value + m.standard_uncertainty * row for m, row in zip(members, z, strict=True)]

    return draw


def _root(matrix: Array) -> Array:
    """A matrix whose square is the given one, which may be singular."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.clip(values, 0.0, None))
