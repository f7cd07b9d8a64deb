"""The Preisach model on plays: a density of memory, without relays."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.errors import ModelError
from flexstage.hysteresis.compiled import compiled
from flexstage.hysteresis.model import Array, samples
from flexstage.hysteresis.models.play import Indices, fixed, play_columns, rising
from flexstage.hysteresis.models.play_model import PlayModel, Sum, terms


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preisach(PlayModel):
    """Preisach operator: a sum of rising, piecewise-linear functions of plays.

    ``y = gain u + sum_i f_i(p_i)``, where ``p_i`` is the play of u with threshold ``r_i``, and
    ``f_i(0) = 0`` with slope ``slopes[i, j]`` between knots j and j + 1.

    A relay that switches up at ``s + r`` and down at ``s - r`` is on exactly if the play with
    threshold r is above s. A Preisach operator (Preisach 1935; Mayergoyz 1991) with a density of
    relays over threshold and mean is therefore a sum of rising functions of plays (Krasnosel'skii
    and Pokrovskii 1983; Brokate and Sprekels 1996, section 2.4): ``slopes[i, j]`` is the density
    of relays with threshold ``r_i`` and means between knots j and j + 1. Relays come in an endless
    number here, and do not quantise the output.

    Notes
    -----
    Validity: rate-independent hysteresis with wiping-out (a minor loop that closes leaves no
    trace) and congruent minor loops (between the same two inputs they differ by a shift only), to
    which the Preisach model is equivalent (Mayergoyz 1986, Phys. Rev. Lett. 56:1518). Asymmetric
    and saturating loops are within it. Loops that drift or change their shape with the output are
    not, nor is creep. Below the first knot and above the last, the functions go on with their
    outermost slopes, which is an extrapolation.

    Raises
    ------
    ModelError
        Shapes do not match, a number is not finite, or thresholds or knots do not rise.

    Examples
    --------
    >>> model = Preisach(
    ...     thresholds=np.array([2.0, 9.0]),
    ...     knots=np.array([0.0, 40.0, 90.0]),
    ...     slopes=np.array([[0.2e-6, 0.3e-6], [0.1e-6, 0.15e-6]]),
    ...     gain=0.4e-6,
    ... )
    >>> model.simulate([80.0, 30.0]).values * 1e6
    array([60.05, 22.3 ])
    """

    thresholds: Array
    """Half the gap of each play [V], none negative and rising, shape (m,). Threshold zero is a
    nonlinear gain without memory.
    """
    knots: Array
    """Means where the slopes change [V], rising, shape (k,), at least two."""
    slopes: Array
    """Slope of each play's function between knots [m/V], shape (m, k - 1)."""
    gain: float = 0.0
    """Part of the input itself [m/V]."""
    kind: ClassVar[str] = "preisach"

    def __post_init__(self) -> None:
        r = rising(self.thresholds, "thresholds of plays", lowest=0.0)
        k = rising(self.knots, "knots", least=2)
        slopes = fixed(self.slopes, "slopes", (r.size, k.size - 1))
        if not np.isfinite(self.gain):
            raise ModelError(f"the gain must be finite, got {self.gain}")
        for name, value in (("thresholds", r), ("knots", k), ("slopes", slopes)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "gain", float(self.gain))

    def _sum(self) -> Sum:
        # The outermost slopes go on, so only the knots between them matter.
        return terms(self.gain, self.thresholds, self.knots[1:-1], self.slopes)


def preisach_columns(
    u: ArrayLike, thresholds: ArrayLike, knots: ArrayLike, state: ArrayLike | None = None
) -> Array:
    """Return the output of a Preisach model per unit of each of its slopes.

    A model without gain gives ``preisach_columns(u, thresholds, knots) @ slopes.ravel()``.
    Thresholds [V], shape (m,), none negative and rising, and knots [V], shape (k,), at least two,
    as those of the model; columns [V], shape (n, m (k - 1)), play by play. The state is as in
    `play_columns`.

    Notes
    -----
    Validity: as `Preisach`.

    Examples
    --------
    >>> preisach_columns([80.0, 30.0], [2.0, 9.0], [0.0, 40.0, 90.0])
    array([[40., 38., 40., 31.],
           [32.,  0., 39.,  0.]])
    """
    k = rising(knots, "knots", least=2)
    plays = play_columns(u, thresholds, state)
    return _ramps(plays, k)


def preisach_gram(
    u: ArrayLike,
    thresholds: ArrayLike,
    knots: ArrayLike,
    others: ArrayLike,
    state: ArrayLike | None = None,
) -> Array:
    """Return the products of all columns of a Preisach model with each other and with others.

    The matrix is ``C.T @ C`` with C the columns of `preisach_columns` and then the others. It is
    formed without C: a function of a play is a sum of its values at the knots times hats, of which
    two only are not zero. The others are, say, the measured output, the input and ones, shape (n,
    q); products have the shape (N, N) with N = m (k - 1) + q. The rest is as in `preisach_columns`.

    Notes
    -----
    Validity: as `Preisach`. Products square the condition number of the columns.

    Examples
    --------
    >>> measured = [[60.0], [30.0]]
    >>> preisach_gram([80.0, 30.0], [2.0, 9.0], [0.0, 40.0, 90.0], measured)[-1]
    array([3360., 2280., 3570., 1860., 4500.])
    """
    k = rising(knots, "knots", least=2)
    given = samples(u, "input")
    more = fixed(others, "other columns", (given.size, -1))
    plays = play_columns(given, thresholds, state)
    count, points = plays.shape[1], k.size
    hats, mixed = _hat_products(plays, k, more)
    # Values at the knots of a function with unit slope in one interval.
    # a copy, as plays are: for what cannot be written all is compiled again
    at_knots = _ramps(k[:, None].copy(), k)
    blocks = hats.reshape(count, points, count, points)
    total = count * (points - 1)
    gram = np.empty((total + more.shape[1],) * 2)
    inner = np.einsum("ipjq,pa,qb->iajb", blocks, at_knots, at_knots, optimize=True)
    gram[:total, :total] = inner.reshape(total, total)
    outer = np.einsum("ipc,pa->iac", mixed.reshape(count, points, -1), at_knots)
    gram[:total, total:] = outer.reshape(total, -1)
    gram[total:, :total] = gram[:total, total:].T
    gram[total:, total:] = more.T @ more
    return gram


@compiled
def _ramps(plays: Array, knots: Array) -> Array:
    """Return the ramp over each interval for each play, zero where the play is zero.

    The outermost intervals have no outer end.
    """
    intervals = knots.size - 1
    count = plays.shape[1]
    none, full = np.zeros(intervals), knots[1:] - knots[:-1]
    zero = _inside(0.0, knots, 0)
    for j in range(intervals):
        at_zero = -knots[j] if j == zero else (full[j] if j < zero else 0.0)
        none[j] -= at_zero
        full[j] -= at_zero
    out = np.empty((plays.shape[0], count * intervals))
    where = np.zeros(count, dtype=np.int64)
    for n in range(plays.shape[0]):
        for i in range(count):
            inside = _inside(plays[n, i], knots, where[i])
            where[i] = inside
            first = i * intervals
            for j in range(inside):
                out[n, first + j] = full[j]
            out[n, first + inside] = (plays[n, i] - knots[inside]) + none[inside]
            for j in range(inside + 1, intervals):
                out[n, first + j] = none[j]
    return out


@compiled
def _inside(p: float, knots: Array, j: int) -> int:
    """Return the interval that holds p, searched from interval j on."""
    while j < knots.size - 2 and p > knots[j + 1]:
        j += 1
    while j > 0 and p < knots[j]:
        j -= 1
    return j


@compiled
def _hat_products(plays: Array, knots: Array, others: Array) -> tuple[Array, Array]:
    """Return the products of the hats of all plays with each other and with other columns."""
    count, points = plays.shape[1], knots.size
    hats = np.zeros((count * points, count * points))
    mixed = np.zeros((count * points, others.shape[1]))
    first = np.zeros(count, dtype=np.int64)
    share = np.zeros(count)
    for n in range(plays.shape[0]):
        _hats(plays[n], knots, first, share)
        for i in range(count):
            a, t = i * points + first[i], share[i]
            for c in range(others.shape[1]):
                mixed[a, c] += (1.0 - t) * others[n, c]
                mixed[a + 1, c] += t * others[n, c]
            for l in range(i + 1):  # noqa: E741 (index of the second play)
                b, s = l * points + first[l], share[l]
                hats[a, b] += (1.0 - t) * (1.0 - s)
                hats[a, b + 1] += (1.0 - t) * s
                hats[a + 1, b] += t * (1.0 - s)
                hats[a + 1, b + 1] += t * s
    for a in range(count * points):
        for b in range((a // points) * points):
            hats[b, a] = hats[a, b]
    return hats, mixed


@compiled
def _hats(plays: Array, knots: Array, first: Indices, share: Array) -> None:
    """Find the interval of each play from where it was, and the share of its upper knot."""
    for i in range(plays.size):
        j = _inside(plays[i], knots, first[i])
        first[i] = j
        share[i] = (plays[i] - knots[j]) / (knots[j + 1] - knots[j])
