"""By how much modes lower the sum of squares, and what noise would make of it."""

import math
from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.projection import Block, Eliminated, eliminate

#: Damping of what may pass for a pole.
LEAST_DAMPING, MOST_DAMPING = 1e-7, 9.0
# what noise is of the response, at least, in anything measured
_DYNAMIC_RANGE = 1e-8


def significances(basis: ModalBasis, theta: Array, blocks: Sequence[Block]) -> Array:
    """Return by how much each mode lowers the sum of squares, over the mean square of noise.

    With the poles of the others as they are, shape (count,).
    """
    falls = np.zeros(basis.count)
    found = [eliminate(basis, theta, block) for block in blocks]
    for now in found:
        for r in range(basis.count):
            own = slice(basis.per_mode * r, basis.per_mode * (r + 1))
            factors = now.factors[own].T[:, :, None]
            falls[r] += float(np.sum(factors * np.linalg.solve(now.inverse[:, own, own], factors)))
    return falls / noise_level(basis, blocks, found)


def noise_level(basis: ModalBasis, blocks: Sequence[Block], found: Sequence[Eliminated]) -> float:
    """Return the mean square of noise, times by how much more it may look like a mode."""
    total, lagged, counted = 0.0, 0.0, 0
    for block, now in zip(blocks, found, strict=True):
        noise = now.residual * block.weights
        total += now.total
        lagged += float(np.sum(noise[:-1] * noise[1:].conj()).real)
        counted += 2 * noise.size - basis.linear * noise.shape[1]
    level = max(total / max(counted - basis.size, 1), rounding_level(blocks))
    # noise that neighbouring lines share forms peaks as wide as they are
    return level * (1.0 + 2.0 * max(lagged / max(total, 1e-300), 0.0))


def threshold(basis: ModalBasis, blocks: Sequence[Block]) -> float:
    """Return the fall of the sum of squares that a mode must make.

    Number of parameters times logarithm of the number of values (Schwarz 1978), and twice the
    logarithm of the number of lines, as the place of a mode is the best of so many. The fall is
    over the mean square of noise.
    """
    values = sum(2 * block.values.size for block in blocks)
    lines = sum(block.values.shape[0] for block in blocks)
    columns = sum(block.values.shape[1] for block in blocks)
    return (basis.per_mode * columns + 2) * math.log(values) + 2.0 * math.log(lines)


def rounding_level(blocks: Sequence[Block]) -> float:
    """Return the least mean square of noise that is believed: a smaller one is the computer's."""
    power = [np.sum((block.weights * np.abs(block.values)) ** 2) for block in blocks]
    return float(_DYNAMIC_RANGE**2 * sum(power) / sum(2 * block.values.size for block in blocks))


def without(basis: ModalBasis, theta: Array, modes: Sequence[int]) -> tuple[ModalBasis, Array]:
    """Leave modes out of a model."""
    from dataclasses import replace

    gone = [2 * m + d for m in modes for d in (0, 1)]
    return replace(basis, count=basis.count - len(modes)), np.delete(theta, gone)


def rising(theta: Array) -> Array:
    """Return frequencies and damping ratios of modes, in turn, in the order of the frequencies."""
    pairs = theta.reshape(-1, 2)
    return pairs[np.argsort(pairs[:, 0], kind="stable")].ravel()
