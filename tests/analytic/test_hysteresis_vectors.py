"""The test vectors beside each hysteresis model, in Python and in C."""

import numpy as np
import pytest

from tests.c_hysteresis import Compiled
from tests.hysteresis_vectors import VECTORS

# what exponentials and logarithms of two libraries differ by, some roundings of the largest number
TOLERANCE = 1e-13


@pytest.mark.parametrize("name", VECTORS)
def test_law_gives_the_vector(name: str) -> None:
    v = VECTORS[name]
    state = v.model.initial_state()
    scale = np.ptp(v.states, axis=0)
    for u, output, after in zip(v.inputs.tolist(), v.outputs, v.states, strict=True):
        state, y = v.model.step(state, u)
        assert abs(y - output) <= TOLERANCE * np.ptp(v.outputs)
        assert np.all(np.abs(state - after) <= TOLERANCE * scale)


@pytest.mark.parametrize("name", VECTORS)
def test_c_gives_the_vector(name: str) -> None:
    v = VECTORS[name]
    compiled = Compiled(v.model)
    found = compiled.moves(v.inputs)
    assert np.max(np.abs(found - v.outputs)) <= TOLERANCE * np.ptp(v.outputs)
    scale = np.ptp(v.states, axis=0)
    assert np.all(np.abs(compiled.memory - v.states[-1]) <= TOLERANCE * scale)
