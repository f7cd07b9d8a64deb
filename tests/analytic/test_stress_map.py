"""A stress map whose matrix is kept as a product, against the same one written out."""

import numpy as np
import pytest

from flexstage.system.stress_map import StressByForces, StressMap, StressOfForces


def maps(plane: bool) -> tuple[StressMap, StressMap]:
    """Return one as a product and one written out: two hinges, forces of two kinds on the first."""
    rng = np.random.default_rng(3)
    components = [0, 1, 2, 5] if plane else list(range(6))
    shares = tuple(
        StressByForces(first, rng.normal(size=(count, len(components), e)), rng.normal(size=(e, 7)))
        for first, count, e in ((0, 4, 3), (0, 4, 2), (4, 5, 3))
    )
    matrix = np.zeros((9, 6, 7))
    for first, stress, forces in shares:
        matrix[first : first + len(stress), components] += stress @ forces
    found = [
        StressMap(
            hinges=("left", "right"),
            matrix=m,
            owner=np.array([0] * 4 + [1] * 5),
            point=np.array([0, 1, 1, 2, 3, 4, 5, 5, 6]),
        )
        for m in (StressOfForces(count=9, shares=shares), matrix)
    ]
    return found[0], found[1]


@pytest.mark.parametrize("plane", [True, False])
def test_a_product_says_what_its_matrix_says(plane: bool) -> None:
    product, whole = maps(plane)
    rng = np.random.default_rng(5)
    q = rng.normal(size=7)
    np.testing.assert_allclose(product.components(q), whole.components(q), atol=1e-12)
    assert product.largest(q) == pytest.approx(whole.largest(q))
    assert product.scatter(q) == pytest.approx(whole.scatter(q))
    for hinge in whole.hinges:
        own = product.of(hinge), whole.of(hinge)
        np.testing.assert_allclose(own[0].components(q), own[1].components(q), atol=1e-12)
        assert own[0].largest(q) == pytest.approx({hinge: whole.largest(q)[hinge]})
