"""Points of a sweep: order of a grid, slices of a Latin hypercube, nets of a Sobol' sequence."""

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.studies.explore.sampling import (
    grid_counts,
    grid_points,
    latin_hypercube_points,
    saltelli_points,
    sobol_points,
)

LOW, HIGH = np.array([0.31e-3, -2.0, 7.1e10]), np.array([0.79e-3, 5.0, 7.3e10])


def test_a_grid_is_nested_loops_with_both_ends() -> None:
    counts = (3, 2, 4)
    values = [np.linspace(a, b, n) for a, b, n in zip(LOW, HIGH, counts, strict=True)]
    looped = [[a, b, c] for a in values[0] for b in values[1] for c in values[2]]
    points = grid_points(LOW, HIGH, counts)
    assert points.tolist() == looped
    assert points.min(axis=0).tolist() == LOW.tolist()
    assert points.max(axis=0).tolist() == HIGH.tolist()
    # the shape of a grid gives each axis its own variable
    grid = points[:, 1].reshape(counts)
    assert (np.ptp(grid, axis=(0, 2)) == 0.0).all()
    assert np.ptp(grid) == 7.0


@pytest.mark.parametrize(
    ("samples", "given", "counts"),
    [
        (1000, (None, None, None), (10, 10, 10)),
        (999, (None, None, None), (9, 9, 9)),
        (100, (None, 7), (14, 7)),
        (5, (None, 7), (2, 7)),
        (3, (4, 6), (4, 6)),
    ],
)
def test_a_grid_has_no_more_points_than_are_asked_for(samples, given, counts) -> None:
    assert grid_counts(samples, given) == counts


def test_a_latin_hypercube_has_one_point_in_every_slice() -> None:
    n = 37
    points = latin_hypercube_points(LOW, HIGH, n, seed=4)
    slices = np.floor(n * (points - LOW) / (HIGH - LOW)).astype(int)
    assert (np.sort(slices, axis=0) == np.arange(n)[:, None]).all()


def test_a_sobol_sequence_fills_every_elementary_box() -> None:
    # of 2^6 points each box 1/8 x 1/8 of the first two variables holds exactly one: a (0, 6, 2)-net
    unit = (sobol_points(LOW, HIGH, 50, seed=9) - LOW) / (HIGH - LOW)
    assert len(unit) == 64
    for across in range(7):
        shape = np.array([2**across, 2 ** (6 - across)])
        boxes = np.floor(unit[:, :2] * shape).astype(int)
        assert len({tuple(box) for box in boxes}) == 64


@pytest.mark.parametrize("spread", [latin_hypercube_points, sobol_points, saltelli_points])
def test_a_seed_gives_the_same_points(spread) -> None:
    first = spread(LOW, HIGH, 32, 7)
    assert first.tobytes() == spread(LOW, HIGH, 32, 7).tobytes()
    assert first.tobytes() != spread(LOW, HIGH, 32, 8).tobytes()
    assert ((first >= LOW) & (first <= HIGH)).all()


def test_the_first_points_of_a_sequence_stay() -> None:
    assert (sobol_points(LOW, HIGH, 256, 7)[:64] == sobol_points(LOW, HIGH, 64, 7)).all()


def test_base_samples_differ_in_one_variable_from_the_first() -> None:
    n, d = 16, 3
    a, b, *mixed = np.moveaxis(saltelli_points(LOW, HIGH, n, 5).reshape(n, d + 2, d), 1, 0)
    for i, taken in enumerate(mixed):
        assert (taken[:, i] == b[:, i]).all()
        others = np.arange(d) != i
        assert (taken[:, others] == a[:, others]).all()
        assert (a[:, i] != b[:, i]).all()


@pytest.mark.parametrize("samples", [0, 10**9])
def test_senseless_numbers_are_refused(samples: int) -> None:
    with pytest.raises(ModelError, match="number of samples must be 1 to 10000000, got"):
        sobol_points(LOW, HIGH, samples, 0)
    with pytest.raises(ModelError, match="needs 2 or more values of a variable, got 1"):
        grid_points(LOW, HIGH, (1, 4, 4))
