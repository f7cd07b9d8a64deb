r"""Cholesky factors of thousands of stiffness matrices of one pattern, body by body.

A stage is a sparse graph: a body is joined to a few others, so most of K is empty and stays so in
its factor if the bodies are taken in a good order. The order is found once, for the pattern; then
every number of the elimination is an array over the samples, and each operation is done for all of
them at once. Only sums, products, quotients and roots of single numbers occur, which IEEE 754
rounds in one way: a sample has the same bits whatever other samples are computed with it.

Samples are the last axis of every array here, so that they lie next to each other in memory.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from flexstage.base.arrays import Array

# How far forces of about 1 move coordinates of a stage that is no mechanism, at most, where K
# has a unit diagonal. Rounding leaves 1e-16 of stiffness in a mechanism, and 3e15 or more comes out
# of thousands of them; of designs up to 1e4, with necks of a thousandth of theirs up to 7e9.
_FURTHEST = 1e13
# a pivot that is less than this of its diagonal is nothing but rounding
_PIVOT = 1e-16


@dataclass(frozen=True, slots=True, kw_only=True)
class Elimination:
    """Order of elimination of the bodies, and the later ones that each of them touches."""

    order: tuple[int, ...]
    """The bodies."""
    later: tuple[tuple[int, ...], ...]
    """By body, those that are eliminated after it and that it is joined to by then, in order."""


@lru_cache(maxsize=256)
def elimination(count: int, pairs: tuple[tuple[int, int], ...]) -> Elimination:
    """Return the order of elimination by least degree, with the fill-in.

    W. F. Tinney, J. W. Walker, Proc. IEEE 55 (1967) 1801, scheme 2: next comes the body that is
    joined to the fewest others. `pairs` are the bodies that are joined.

    Examples
    --------
    >>> elimination(4, ((0, 1), (0, 2), (0, 3))).order
    (1, 2, 0, 3)
    """
    joined: dict[int, set[int]] = {i: set() for i in range(count)}
    for i, j in pairs:
        if i != j:
            joined[i].add(j)
            joined[j].add(i)
    order: list[int] = []
    after: dict[int, set[int]] = {}
    while joined:
        body = min(joined, key=lambda i: (len(joined[i]), i))
        around = joined.pop(body)
        order.append(body)
        after[body] = around
        for i in around:
            joined[i] |= around
            joined[i] -= {i, body}
    place = {body: k for k, body in enumerate(order)}
    return Elimination(
        order=tuple(order),
        later=tuple(tuple(sorted(after[i], key=place.__getitem__)) for i in range(count)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockFactor:
    r"""The factor L of :math:`K = L L^T`, S of them."""

    xp: Any
    """The namespace of the arrays."""
    plan: Elimination
    """Order of elimination."""
    pivots: tuple[tuple[Array, ...], ...]
    """By body its own factor: the reciprocals of the diagonal l00, l11, l22, then l10, l20, l21,
    each of shape (S,).
    """
    panels: tuple[Array | None, ...]
    """By body the columns of L below it, those of its later bodies, shape (3 d, 3, S)."""
    regular: Any
    """True if the matrix of a sample is positive definite; the factor of one that is not is
    finite, and means nothing. Shape (S,).
    """

    def solve(self, right: Sequence[Array | None]) -> Array:
        """Solve K x = b.

        `right` has the part of b of each of k bodies, shape (3, r, S); None where it is zero.
        Returns x, shape (k, 3, r, S).
        """
        xp, plan = self.xp, self.plan
        b = list(right)
        for i in plan.order:
            right_side = b[i]
            if right_side is None:
                continue
            r0, r1, r2, l10, l20, l21 = self.pivots[i]
            y0 = right_side[0, ...] * r0
            y1 = (right_side[1, ...] - l10 * y0) * r1
            y2 = (right_side[2, ...] - l20 * y0 - l21 * y1) * r2
            b[i] = xp.stack((y0, y1, y2))
            w = self.panels[i]
            if w is None:
                continue
            moved = w[:, 0, None, :] * y0[None, ...]
            moved += w[:, 1, None, :] * y1[None, ...]
            moved += w[:, 2, None, :] * y2[None, ...]
            for k, j in enumerate(plan.later[i]):
                part, other = moved[3 * k : 3 * k + 3, ...], b[j]
                b[j] = -part if other is None else other - part
        nothing = next(part for part in b if part is not None) * 0.0
        x: list[Array] = [nothing] * len(b)
        for i in reversed(plan.order):
            y = b[i]
            z = nothing if y is None else y
            w = self.panels[i]
            if w is not None:
                for k, j in enumerate(plan.later[i]):
                    for row in range(3):
                        z = z - w[3 * k + row, :, None, :] * x[j][row, None, ...]
            r0, r1, r2, l10, l20, l21 = self.pivots[i]
            x2 = z[2, ...] * r2
            x1 = (z[1, ...] - l21 * x2) * r1
            x0 = (z[0, ...] - l10 * x1 - l20 * x2) * r0
            x[i] = xp.stack((x0, x1, x2))
        return xp.stack(xp.broadcast_arrays(*x))

    def subset(self, numbers: Array) -> "BlockFactor":
        """Return the factors of some samples, by their numbers."""

        def take(x: Array) -> Array:
            return x if x.shape[-1] == 1 else self.xp.take(x, numbers, axis=-1)

        return BlockFactor(
            xp=self.xp,
            plan=self.plan,
            pivots=tuple(tuple(take(x) for x in pivot) for pivot in self.pivots),
            panels=tuple(None if w is None else take(w) for w in self.panels),
            regular=take(self.regular),
        )


def factorise(xp: Any, count: int, blocks: Mapping[tuple[int, int], Array]) -> BlockFactor:
    """Factorise matrices of 3 x 3 blocks.

    `blocks` has those on and below the diagonal by (row, column), shape (3, 3, S), for `count`
    bodies; what is missing is zero.
    """
    plan = elimination(count, tuple(sorted(blocks)))
    k: dict[tuple[int, int], Array] = dict(blocks)
    diagonal = {i: k[i, i] for i in range(count)}
    regular: Any = None
    pivots: list[tuple[Array, ...]] = [()] * count
    panels: list[Array | None] = [None] * count

    def root(value: Array, full: Array) -> Array:
        nonlocal regular
        fine = value > _PIVOT * full
        regular = fine if regular is None else xp.logical_and(regular, fine)
        one = xp.ones_like(value)
        return 1.0 / xp.sqrt(xp.where(fine, value, xp.where(full > 0.0, full, one)))

    for i in plan.order:
        pivot, full = k[i, i], diagonal[i]
        r0 = root(pivot[0, 0, ...], full[0, 0, ...])
        l10, l20 = pivot[1, 0, ...] * r0, pivot[2, 0, ...] * r0
        r1 = root(pivot[1, 1, ...] - l10 * l10, full[1, 1, ...])
        l21 = (pivot[2, 1, ...] - l20 * l10) * r1
        r2 = root(pivot[2, 2, ...] - l20 * l20 - l21 * l21, full[2, 2, ...])
        pivots[i] = (r0, r1, r2, l10, l20, l21)
        later = plan.later[i]
        if not later:
            continue
        # a block above the diagonal is that below it, turned over
        below = xp.concat(
            [k[j, i] if (j, i) in k else xp.permute_dims(k[i, j], (1, 0, 2)) for j in later]
        )
        w0 = below[:, 0, ...] * r0
        w1 = (below[:, 1, ...] - w0 * l10) * r1
        w2 = (below[:, 2, ...] - w0 * l20 - w1 * l21) * r2
        panels[i] = xp.stack((w0, w1, w2), axis=1)
        for a, j in enumerate(later):
            rows, columns = slice(3 * a, 3 * a + 3), slice(0, 3 * a + 3)
            less = w0[rows, None, ...] * w0[None, columns, ...]
            less += w1[rows, None, ...] * w1[None, columns, ...]
            less += w2[rows, None, ...] * w2[None, columns, ...]
            for b, m in enumerate(later[: a + 1]):
                part = less[:, 3 * b : 3 * b + 3, ...]
                if (j, m) in k:
                    k[j, m] = k[j, m] - part
                elif (m, j) in k:
                    k[m, j] = k[m, j] - xp.permute_dims(part, (1, 0, 2))
                else:
                    k[j, m] = -part
    assert regular is not None
    factor = BlockFactor(
        xp=xp, plan=plan, pivots=tuple(pivots), panels=tuple(panels), regular=regular
    )
    return replace(factor, regular=xp.logical_and(regular, _furthest(factor, diagonal) < _FURTHEST))


def _furthest(factor: BlockFactor, diagonal: Mapping[int, Array]) -> Array:
    """Return the displacement by a unit force on each coordinate, scaled to a unit diagonal."""
    xp, count = factor.xp, len(diagonal)
    size = xp.stack([xp.stack([diagonal[i][c, c, ...] for c in range(3)]) for i in range(count)])
    size = xp.sqrt(xp.clip(size, 0.0, None))
    # signs by turns and sizes from 1 to 2, as N. J. Higham, ACM Trans. Math. Softw. 14 (1988) 381
    forces = [(-1.0) ** k * (1.0 + k / (3 * count)) for k in range(3 * count)]
    force = size * xp.reshape(xp.asarray(forces, dtype=size.dtype), (count, 3, 1))
    shape = factor.solve([force[i, :, None, :] for i in range(count)])
    return xp.max(xp.abs(shape[:, :, 0, :] * size), axis=(0, 1))
