"""Why points are no stage, and the bound that leaves them out, of points whose bound is known."""

import numpy as np
import pytest

from flexstage.studies.explore.sweep import best_cut, common_faults

POINTS = np.random.default_rng(5).uniform((2.0, -7.0), (3.0, -1.0), (400, 2))


def test_reasons_are_counted_without_their_numbers():
    said = [
        "neck 0.11 mm is thin",
        "",
        "bolt 3 hits leg",
        "neck 0.2 mm is thin",
        "neck -1e-3 mm is thin",
    ]
    assert [(r.count, r.text) for r in common_faults(said)] == [
        (3, "neck 0.11 mm is thin"),
        (1, "bolt 3 hits leg"),
    ]
    assert common_faults(["", ""]) == ()


@pytest.mark.parametrize(("variable", "limit"), [(0, 2.31), (1, -2.4)])
@pytest.mark.parametrize("bound", ["low", "high"])
def test_a_bound_is_found_at_the_first_point_that_is_possible(variable, limit, bound):
    column = POINTS[:, variable]
    bad = column < limit if bound == "low" else column > limit
    cut = best_cut(POINTS, ["no" if b else "" for b in bad])
    assert cut is not None
    assert (cut.variable, cut.bound) == (variable, bound)
    assert (cut.impossible, cut.possible) == (1.0, 0.0)
    kept = column[~bad]
    assert cut.value == (kept.min() if bound == "low" else kept.max())


def test_where_another_variable_has_a_part_the_shares_say_so():
    # impossible below a line that is steeper in the first variable
    bad = POINTS[:, 0] - 0.05 * POINTS[:, 1] < 2.45
    cut = best_cut(POINTS, ["no" if b else "" for b in bad])
    assert cut is not None
    assert (cut.variable, cut.bound) == (0, "low")
    left_out = POINTS[:, 0] < cut.value
    assert cut.impossible == pytest.approx((left_out & bad).sum() / bad.sum())
    assert cut.possible == pytest.approx((left_out & ~bad).sum() / (~bad).sum())
    assert 0.5 < cut.impossible - cut.possible < 1.0


def test_no_bound_is_named_where_none_tells_them_apart():
    one_in_three = ["no" if i % 3 == 0 else "" for i in range(400)]
    assert best_cut(POINTS, one_in_three) is None
    assert best_cut(POINTS, ["no", "no"] + 398 * [""]) is None
    assert best_cut(POINTS, 400 * ["no"]) is None
