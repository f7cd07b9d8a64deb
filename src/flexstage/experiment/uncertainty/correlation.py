"""How influences depend on one another: their correlations, and groups of them."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.experiment.uncertainty.influence import Influence

#: Correlation coefficient by the names of two influences.
Correlations = Mapping[tuple[str, str], float]


def correlation_matrix(
    influences: Sequence[Influence], correlations: Correlations | None = None
) -> Array:
    """Return the correlation matrix of influences.

    Pairs are given by their names; the coefficient of all others is 0.

    Examples
    --------
    >>> a, b = (Influence(name=n, value=1.0, uncertainty=0.1) for n in "ab")
    >>> float(correlation_matrix((a, b), {("a", "b"): 0.25})[1, 0])
    0.25
    """
    names = [i.name for i in influences]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"two influences are called '{name}': give each its own name")
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for pair, coefficient in (correlations or {}).items():
        for name in pair:
            if name not in names:
                raise ModelError(
                    f"a correlation names '{name}', which is no influence (there are: "
                    f"{', '.join(names)})"
                )
        if pair[0] == pair[1] or frozenset(pair) in seen:
            raise ModelError(f"the correlation of {' and '.join(pair)} must be given once, of two")
        if not -1.0 <= coefficient <= 1.0:
            raise ModelError(
                f"the correlation of {' and '.join(pair)} lies from -1 to 1, got {coefficient!r}"
            )
        seen.add(frozenset(pair))
        i, j = map(names.index, pair)
        matrix[i, j] = matrix[j, i] = coefficient
    _require_possible(matrix, "the correlations contradict one another: no quantities have all")
    return matrix


def _require_possible(matrix: Array, sentence: str) -> None:
    if matrix.size and float(np.linalg.eigvalsh(matrix)[0]) < -1e-9:
        raise ModelError(sentence)


def groups(matrix: Array) -> tuple[tuple[int, ...], ...]:
    """Return the indices of influences that hang together by their correlations, group by group."""
    left = set(range(matrix.shape[0]))
    found = []
    while left:
        group, edge = set(), {min(left)}
        while edge:
            group |= edge
            edge = {int(j) for i in edge for j in np.flatnonzero(matrix[i])} - group
        left -= group
        found.append(tuple(sorted(group)))
    return tuple(found)


def normal_correlations(influences: Sequence[Influence], matrix: Array) -> Array:
    """Return the correlations of normal variables that give influences theirs.

    Each influence is its own quantile at the probability of a normal variable (a Gaussian copula).
    Their correlation is an integral over two normal variables, done by a Gauss-Hermite rule, and
    inverted (Cario and Nelson, 1997, "Modeling and generating random vectors with arbitrary
    marginal distributions and correlation matrix", Northwestern University).

    Notes
    -----
    Validity: two or fewer degrees of freedom leave a Student distribution without a variance, so
    that no correlation is defined there.

    Examples
    --------
    >>> a, b = (Influence(name=n, value=0.0, half_width=1.0) for n in "ab")
    >>> matrix = normal_correlations((a, b), np.array([[1.0, 0.5], [0.5, 1.0]]))
    >>> round(float(matrix[0, 1]), 4)  # 2 sin(pi/12)
    0.5176
    """
    found = np.eye(len(influences))
    for i, j in itertools.combinations(range(len(influences)), 2):
        if matrix[i, j]:
            r = _inverted(influences[i], influences[j], float(matrix[i, j]))
            found[i, j] = found[j, i] = r
    _require_possible(
        found, "the correlations do not go together with the distributions of their influences"
    )
    return found


def _inverted(a: Influence, b: Influence, wanted: float) -> float:
    if a.law == b.law == "normal":
        return wanted
    from scipy.optimize import brentq
    from scipy.special import ndtr

    for one in (a, b):
        if one.law == "student" and one.degrees_of_freedom <= 2.0:
            raise ModelError(
                f"influence '{one.name}' has {one.degrees_of_freedom:g} degrees of freedom, and a "
                "correlation needs more than 2: declare it normal"
            )
    z, w = np.polynomial.hermite_e.hermegauss(96)
    w = w / w.sum()

    # a correlation depends on neither place nor scale, whose digits would be lost, or run over
    one_a, one_b = (
        replace(i, value=0.0, uncertainty=1.0, half_width=None, distribution=i.law) for i in (a, b)
    )

    def at_normal(one: Influence, at: Array) -> Array:
        # where the weights are nothing, and a probability would round to 1
        return one.quantile(ndtr(np.clip(at, -7.5, 7.5)))

    first = at_normal(one_a, z)
    spread = math.sqrt(float(w @ first**2) * float(w @ at_normal(one_b, z) ** 2))

    def correlation(r: float) -> float:
        other = at_normal(one_b, r * z[:, None] + math.sqrt(1.0 - r * r) * z[None, :])
        return float((w * first) @ other @ w) / spread

    low, high = correlation(-1.0), correlation(1.0)
    if not low - 1e-3 <= wanted <= high + 1e-3:
        raise ModelError(
            f"the distributions of '{a.name}' and '{b.name}' allow a correlation from {low:.3f} to "
            f"{high:.3f}, got {wanted!r}"
        )
    if wanted >= high:
        return 1.0
    if wanted <= low:
        return -1.0
    root: Any = brentq(lambda r: correlation(r) - wanted, -1.0, 1.0, xtol=1e-10)
    return float(root)
