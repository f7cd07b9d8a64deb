r"""Natural frequencies of many stages at once, of the modes by which the axes move.

Subspace iteration (K.-J. Bathe, E. L. Wilson, Int. J. Numer. Methods Eng. 6 (1973) 213) from modes
of the nominal stage: :math:`Y = K^{-1} M X`, then the small problem of :math:`Y^T K Y = Y^T M X`
and :math:`Y^T M Y`. It needs only the factor of the statics. A sample is complete when two
conditions hold: that the residual of the mode is negligible, and that no mode outside of the
subspace can give more of the static response than the selected one, by the inequality of A.
L. Cauchy and H. A. Schwarz. All others are solved in full.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.system.batch import samples_first, samples_last
from flexstage.system.block_cholesky import BlockFactor
from flexstage.system.characteristics import AS_MUCH, MODES_SEARCHED, SAME_FREQUENCY
from flexstage.system.forward_mode import array_namespace, root
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.modes import generalized_modes

# A subspace of more than this part of all coordinates costs more than all modes.
_LARGEST_SHARE = 0.25
# Ratio of the first frequency outside of the subspace to the last one in it, at least.
_GAP = 1.15
# On the nominal stage, what lies outside of the subspace gives less than the mode chosen by this.
_MARGIN = 2.0
# Steps before what is left is solved in full.
_STEPS = 16
# Largest residual of a mode, of its squared frequency: the square of it, over the distance to other
# modes, is what the squared frequency may be off; the shape is off by the residual itself.
_RESIDUAL_FREQUENCY = 1e-8
_RESIDUAL_SHAPE = 1e-11
# Shapes with a larger one are not modes yet: they count as outside of the subspace.
_CONVERGED = 1e-3


def start_shapes(
    system: MechanicalSystem, responses: Sequence[tuple[Array, Array]]
) -> Array | None:
    """Return modes of the nominal stage to begin with, shape (n, m); None where all are wanted.

    `responses` has the vectors of force and of reading of each axis.
    """
    omega, shapes = generalized_modes(system.K, system.M, np.zeros((system.order, 0)))
    n = system.order
    if not responses or omega[0] <= 0.0:
        return None
    count = 1
    parts = [(np.abs(shapes.T @ d), np.abs(shapes.T @ p)) for d, p in responses]
    for d, p in parts:
        count = max(count, int(np.argmax((d * p / omega**2)[:MODES_SEARCHED])) + 1)
    while count <= _LARGEST_SHARE * n:
        outside = [
            _MARGIN * np.sqrt(np.sum((d / omega)[count:] ** 2) * np.sum((p / omega)[count:] ** 2))
            < np.max((d * p / omega**2)[:count])
            for d, p in parts
        ]
        if all(outside) and omega[count] > _GAP * omega[count - 1]:
            return shapes[:, :count]
        count += 1
    return None


#: A vector of a few bodies: their numbers, and its parts, each of shape (3, S).
Form = Sequence[tuple[int, Array]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivenReading:
    """A force and a reading, for the mode that gives the largest share of the response."""

    force: Form
    """Force d on each coordinate."""
    reading: Form
    """Reading p of each coordinate."""
    pushed: Array
    """Static compliance at the force, :math:`d^T K^{-1} d`, shape (S,)."""
    read: Array
    """Static compliance at the reading, :math:`p^T K^{-1} p`, shape (S,)."""


def axis_modes(
    factor: BlockFactor,
    blocks: Mapping[tuple[int, int], Array],
    mass: Array,
    start: Array | None,
    responses: Sequence[DrivenReading],
    *,
    count: int,
    shapes: bool,
) -> tuple[list[Array], list[Array]]:
    """Find the modes by which axes move.

    `mass` is the diagonal of M by body, shape (k, 3, S), `blocks` are those of K, `count` is S;
    `shapes` asks for more digits, for what depends on the shapes. Returns by axis the squared
    angular frequency, and the sum of squares of the readings of its probe in this mode and those of
    the same frequency, which is the inverse of the effective mass, each of shape (S,).
    """
    xp = factor.xp
    mass = xp.broadcast_to(mass, (*mass.shape[:2], count))
    left = xp.arange(count)
    work = _Work(factor, mass, responses, shapes)
    results: list[tuple[Array, Array]] = []
    if start is not None:
        x = xp.reshape(xp.asarray(start, dtype=mass.dtype), (mass.shape[0], 3, -1, 1))
        for _ in range(_STEPS):
            values, x, done = work.step(x)
            finished, keep = xp.nonzero(done)[0], xp.nonzero(xp.logical_not(done))[0]
            results.append((xp.take(left, finished), xp.take(values, finished, axis=-1)))
            left = xp.take(left, keep)
            if not keep.shape[0]:
                break
            if finished.shape[0]:
                work, x = work.subset(keep), xp.take(x, keep, axis=-1)
    if left.shape[0]:
        some = {at: select_samples(xp, block, left) for at, block in blocks.items()}
        remaining = _Work(
            factor.subset(left),
            select_samples(xp, mass, left),
            [_select_response(xp, r, left) for r in responses],
            shapes,
        )
        results.append((left, remaining.in_full(some)))
    where = xp.argsort(xp.concat([at for at, _ in results]))
    values = xp.take(xp.concat([value for _, value in results], axis=-1), where, axis=-1)
    axes = range(len(responses))
    return [values[0, a, ...] for a in axes], [values[1, a, ...] for a in axes]


class _Work:
    """Samples that are not complete yet."""

    def __init__(
        self, factor: BlockFactor, mass: Array, responses: Sequence[DrivenReading], shapes: bool
    ) -> None:
        self.factor, self.mass, self.responses, self.shapes = factor, mass, responses, shapes

    def subset(self, numbers: Array) -> "_Work":
        """Return some of the samples, by their numbers."""
        xp = self.factor.xp
        return _Work(
            self.factor.subset(numbers),
            select_samples(xp, self.mass, numbers),
            [_select_response(xp, r, numbers) for r in self.responses],
            self.shapes,
        )

    def step(self, x: Array) -> tuple[Array, Array, Array]:
        """Do one step from shapes, (k, 3, m, S).

        Returns the results, shape (2, a, S), the next shapes, and which samples are complete.
        """
        xp, mass = self.factor.xp, self.mass[:, :, None, :]
        right = mass * x
        y = self.factor.solve([right[i, ...] for i in range(right.shape[0])])
        x = xp.broadcast_to(x, y.shape)
        value, z = _small_problem(xp, _gram(xp, y, right), _gram(xp, y, mass * y), self.factor)
        new, old = _mixed(xp, y, z), _mixed(xp, x, z)
        away = old - value * new
        squares = mass * away * away
        off = xp.sqrt(total(squares, 2)) / value
        values, done = self._selected_modes(value, new, off)
        return values, new, xp.logical_or(done, xp.logical_not(self.factor.regular))

    def _selected_modes(self, value: Array, shape: Array, off: Array) -> tuple[Array, Array]:
        """Select the mode of each axis; also return for which samples that is certain and exact."""
        xp = self.factor.xp
        limit = _RESIDUAL_SHAPE if self.shapes else _RESIDUAL_FREQUENCY
        converged = off < _CONVERGED
        omega, readings, sure = [], [], xp.ones_like(self.factor.regular)
        for response in self.responses:
            p, d = applied(response.reading, shape), applied(response.force, shape)
            share = xp.abs(p * d) / value
            last = min(value.shape[0], MODES_SEARCHED)
            best = xp.max(share[:last, ...], axis=0)
            squared, error = value[last - 1, ...], off[last - 1, ...]
            # the lowest of those that give as much, as `strongest` chooses it
            for k in reversed(range(last - 1)):
                as_much = share[k, ...] >= (1.0 - AS_MUCH) * best
                squared = xp.where(as_much, value[k, ...], squared)
                error = xp.where(as_much, off[k, ...], error)
            same_frequency = xp.abs(xp.sqrt(value / squared) - 1.0) < SAME_FREQUENCY
            squares = xp.where(same_frequency, p * p, xp.zeros_like(p))
            if self.shapes:
                error = xp.max(xp.where(same_frequency, off, xp.zeros_like(off)), axis=0)
            nothing = xp.zeros_like(value)
            read = response.read - total(xp.where(converged, p * p / value, nothing), 1)
            pushed = response.pushed - total(xp.where(converged, d * d / value, nothing), 1)
            outside = xp.sqrt(xp.clip(read, 0.0, None) * xp.clip(pushed, 0.0, None))
            sure = xp.logical_and(sure, xp.logical_and(error <= limit, outside < best))
            omega.append(squared)
            readings.append(total(squares, 1))
        return xp.stack((xp.stack(omega), xp.stack(readings))), sure

    def in_full(self, blocks: Mapping[tuple[int, int], Array]) -> Array:
        """Find all modes, and return the requested results, shape (2, a, S)."""
        xp = self.factor.xp
        bodies = self.mass.shape[0]
        scale = 1.0 / xp.sqrt(self.mass)
        usual = xp.eye(3, dtype=self.mass.dtype)[:, :, None]
        nothing = xp.zeros_like(self.mass[0, 0, :]) * usual

        def block(i: int, j: int) -> Array:
            if (i, j) in blocks:
                part = blocks[i, j]
            elif (j, i) in blocks:
                part = xp.permute_dims(blocks[j, i], (1, 0, 2))
            else:
                return nothing
            part = part * scale[i, :, None, :] * scale[j, None, :, :]
            return xp.where(self.factor.regular, part, usual * float(i == j))

        rows = [xp.concat([block(i, j) for j in range(bodies)], axis=1) for i in range(bodies)]
        vector = xp.linalg.eigh(samples_first(xp, xp.concat(rows)))[1]
        last = min(MODES_SEARCHED, vector.shape[1])
        shape = samples_last(xp, vector[:, :, :last])
        shape = xp.reshape(shape, (bodies, 3, last, -1)) * scale[:, :, None, :]
        # eigh errs by rounding of the stiffest mode; the factor corrects the softest ones
        return self.step(shape)[0]


def _small_problem(
    xp: Any, stiffness: list[list[Array]], mass: list[list[Array]], factor: BlockFactor
) -> tuple[Array, Array]:
    """Solve A z = theta B z of m x m matrices: theta, shape (m, S), and z, shape (m, m, S)."""
    m = len(mass)
    # B = L L^T, and with its inverse R the problem of R A R^T
    lower: list[list[Array]] = []
    for i in range(m):
        row: list[Array] = []
        for j in range(i):
            row.append(_less(mass[i][j], [(row[k], lower[j][k]) for k in range(j)]) / lower[j][j])
        row.append(root(_less(mass[i][i], [(x, x) for x in row])))
        lower.append(row)
    inverse: list[list[Array]] = []
    for i in range(m):
        one = 1.0 / lower[i][i]
        parts = [-one * _sum([lower[i][k] * inverse[k][j] for k in range(j, i)]) for j in range(i)]
        inverse.append([*parts, one])
    half = [
        [_sum([inverse[i][k] * stiffness[k][j] for k in range(i + 1)]) for j in range(m)]
        for i in range(m)
    ]
    small = [
        [_sum([half[i][k] * inverse[j][k] for k in range(j + 1)]) for j in range(i + 1)]
        for i in range(m)
    ]
    if m == 1:
        return xp.stack(small[0]), xp.stack((xp.stack(inverse[0]),))
    matrix = xp.stack([small[max(i, j)][min(i, j)] for i in range(m) for j in range(m)], axis=-1)
    fine = xp.logical_and(factor.regular, xp.isfinite(_sum([w for row in small for w in row])))
    usual = xp.eye(m, dtype=matrix.dtype)
    matrix = xp.where(fine[:, None, None], xp.reshape(matrix, (-1, m, m)), usual)
    value, vector = xp.linalg.eigh(matrix)
    value, vector = samples_last(xp, value), samples_last(xp, vector)
    z = [_sum([inverse[k][i] * vector[k, ...] for k in range(i, m)]) for i in range(m)]
    return value, xp.stack(z)


def _sum(parts: Sequence[Array]) -> Array:
    out = parts[0]
    for part in parts[1:]:
        out = out + part
    return out


def _less(value: Array, products: Sequence[tuple[Array, Array]]) -> Array:
    for a, b in products:
        value = value - a * b
    return value


def _gram(xp: Any, a: Array, b: Array) -> list[list[Array]]:
    """Products of each shape with each; symmetric."""
    m = a.shape[2]
    low = [[total(a[:, :, i, :] * b[:, :, j, :], 2) for j in range(i + 1)] for i in range(m)]
    return [[low[max(i, j)][min(i, j)] for j in range(m)] for i in range(m)]


def _mixed(xp: Any, shapes: Array, z: Array) -> Array:
    """Linear combinations of shapes, (k, 3, m, S), by the columns of z, (m, m, S)."""
    out = shapes[:, :, 0, None, :] * z[0, ...]
    for i in range(1, z.shape[0]):
        out += shapes[:, :, i, None, :] * z[i, ...]
    return out


def applied(form: Form, shape: Array) -> Array:
    """Apply a vector of few bodies to shapes (k, 3, m, S); (m, S) comes out."""
    return _sum([row[c, ...] * shape[body, c, ...] for body, row in form for c in range(3)])


def total(x: Array, axes: int) -> Array:
    """Sum over the first axes, in an order that their sizes alone decide.

    A library's own sum may add in another order for few samples than for many.
    """
    if axes > 1:
        x = array_namespace(x).reshape(x, (-1, *x.shape[axes:]))
    while x.shape[0] > 1:
        half = x.shape[0] // 2
        added = x[:half, ...] + x[half : 2 * half, ...]
        if x.shape[0] % 2:
            added[0, ...] = added[0, ...] + x[-1, ...]
        x = added
    return x[0, ...]


def select_samples(xp: Any, x: Array, numbers: Array) -> Array:
    """Return some samples of an array that has them last; one for all stays."""
    return x if x.shape[-1] == 1 else xp.take(x, numbers, axis=-1)


def _select_response(xp: Any, response: DrivenReading, numbers: Array) -> DrivenReading:
    def form(of: Form) -> Form:
        return [(body, select_samples(xp, row, numbers)) for body, row in of]

    return DrivenReading(
        force=form(response.force),
        reading=form(response.reading),
        pushed=select_samples(xp, response.pushed, numbers),
        read=select_samples(xp, response.read, numbers),
    )
