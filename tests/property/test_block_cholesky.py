"""Factors of sparse matrices of blocks, of any pattern, against a dense solution."""

import numpy as np
import pytest

from flexstage.system.block_cholesky import factorise


@pytest.mark.parametrize("seed", range(20))
def test_any_pattern_of_bodies_is_solved(seed: int) -> None:
    """Bodies joined at random; a body without a force is given as None."""
    draw = np.random.default_rng(seed)
    count, samples = int(draw.integers(2, 13)), 4
    pairs = {(i, i) for i in range(count)}
    pairs |= {(i, j) for i in range(count) for j in range(i) if draw.uniform() < 0.5}
    blocks = {at: np.zeros((3, 3, samples)) for at in pairs}
    whole = np.zeros((samples, 3 * count, 3 * count))
    for i, j in pairs:
        # a spring between two bodies, or of one to the ground
        half = draw.standard_normal((samples, 3, 6))
        if i == j:
            half[:, :, 3:] = 0.0
        part = np.swapaxes(half, 1, 2) @ half
        rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        for s in range(samples):
            np.add.at(whole[s], np.ix_(rows, rows), part[s])
    for i, j in blocks:
        block = whole[:, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        blocks[i, j] = np.moveaxis(block, 0, -1)
    right = draw.standard_normal((count, 3, 2, samples))
    idle = int(draw.integers(count))
    right[idle] = 0.0
    factor = factorise(np, count, blocks)
    assert factor.regular.all()
    found = factor.solve([None if i == idle else right[i] for i in range(count)])
    for s in range(samples):
        wanted = np.linalg.solve(whole[s], right[..., s].reshape(3 * count, 2))
        np.testing.assert_allclose(found[..., s].reshape(3 * count, 2), wanted, rtol=1e-9)
