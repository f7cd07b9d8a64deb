"""Pareto fronts: none better in every goal, ends the best by one goal alone, the same numbers."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.report.optimise import optimum_notes, optimum_tables
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore import (
    Family,
    Front,
    Goal,
    Problem,
    SearchOptions,
    figure_of,
    find_front,
    find_optimum,
    known_figures,
    open_workers,
    requirement_of,
    variables_of,
    workers,
)
from flexstage.studies.explore.family import evaluate
from flexstage.studies.explore.optimise.front import non_dominated
from flexstage.studies.explore.optimise.optimum import TOLERANCE

OPTIONS = SearchOptions(model="lumped", evaluations=500, seed=3)


def problem() -> Problem:
    template = StageTemplate.of("parallelogram")
    known = known_figures(template.stage())
    ranges = ("leg.notch.neck_thickness=0.35..0.9 mm", "leg.bar_length=15..38 mm")
    return Problem(
        family=Family(template=template, variables=variables_of(template, ranges)),
        goals=(
            Goal(figure=figure_of("natural_frequency.x", known), direction="maximise"),
            Goal(figure=figure_of("stress.x", known), direction="minimise"),
        ),
        requirements=(requirement_of("height <= 68 mm", known),),
    )


@pytest.fixture(scope="module")
def front() -> Front:
    return find_front(problem(), OPTIONS)


def test_none_is_better_in_every_goal(front: Front) -> None:
    costs = front.values[:, :2] * np.array([-1.0, 1.0])
    assert len(costs) > 20
    assert non_dominated(costs).all()
    # in order along the front, and within what is required
    assert np.all(np.diff(costs[:, 0]) > 0.0)
    assert np.all(front.values[:, 2] <= 68e-3 * (1.0 + 1e-5))
    # nothing that was searched and keeps the requirement beats it
    both = np.vstack([costs, front.searched[:, :2] * np.array([-1.0, 1.0])])
    assert non_dominated(both)[len(costs) :].sum() == 0


def test_ends_are_the_best_by_one_goal(front: Front) -> None:
    for number, end in ((0, front.values[0]), (1, front.values[-1])):
        alone = replace(problem(), goals=(problem().goals[number],))
        best = find_optimum(alone, replace(OPTIONS, starts=0)).levels[-1].best[0]
        assert end[number] == pytest.approx(best, rel=2e-3)


def test_what_was_gained_counts_from_the_stage_as_described(front: Front) -> None:
    family = problem().family
    described = evaluate(family, family.usual[None], front.optimum.figures).values[0]
    assert front.optimum.levels[0].start == pytest.approx(described, rel=1e-9)
    assert front.optimum.start == pytest.approx(family.usual, rel=1e-12)


def test_chosen_design_loses_nothing_and_says_the_rate_of_exchange(front: Front) -> None:
    optimum = front.optimum
    before, after = front.values[front.selected], optimum.levels[-1].best
    assert after[0] >= before[0] * (1.0 - TOLERANCE)
    stress = optimum.figures.index(problem().goals[1].figure)
    assert after[stress] <= before[1] * (1.0 + TOLERANCE)
    (exchanged,) = optimum.trade_offs
    assert exchanged is not None
    assert (exchanged.kind, exchanged.name) == ("goal", "max_stress.x")
    rate = exchanged.rate
    # by the slope of the front there, whose points lie in the order of falling frequency
    near = front.values[max(front.selected - 8, 0) : front.selected + 9]
    slope = np.polyfit(near[:, 1], near[:, 0], 1)[0]
    assert rate == pytest.approx(slope, rel=0.1)


def test_what_goals_exchange_is_nothing_that_is_required(front: Front) -> None:
    """It has a table of its own, and is not among what is required, met, missed or held by."""
    optimum = front.optimum
    assert [r.figure.name for r in optimum.problem.all_requirements] == ["height"]
    assert len(optimum.excess) == 1
    figures, rates, *_ = optimum_tables(optimum)
    required = {row[0].text: row[2].text for row in figures.rows}
    assert required["Largest stress x"] == "minimise"
    assert rates.caption == "trade-off between goals at the selected point"
    (row,) = rates.rows
    stress = 1e6 * float(row[3].text.removeprefix("+"))
    assert float(row[4].text) == pytest.approx(optimum.trade_offs[0].rate * stress, rel=0.05)  # type: ignore[union-attr]
    assert not [note for note in optimum_notes(optimum) if "max_stress" in note]
    (told,) = optimum.to_dict()["trade_offs"]
    assert told["goal"] == "minimise max_stress.x"
    assert told["of"] == "natural_frequency.x"


@pytest.mark.slow
def test_numbers_are_the_same_whatever_the_workers(
    front: Front, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "_WORTH_SHARING", 0.0)
    monkeypatch.setattr(workers, "_FIRST_ESTIMATE", 0.0)
    with open_workers(2) as two:
        again = find_front(problem(), OPTIONS, two)
        assert two._others is not None, "the work was not shared"
    assert np.array_equal(front.points, again.points)
    assert np.array_equal(front.values, again.values)
    assert np.array_equal(front.optimum.point, again.optimum.point)


def test_refusals() -> None:
    one = replace(problem(), goals=problem().goals[:1])
    with pytest.raises(ModelError, match="a Pareto front needs two goals"):
        find_front(one, OPTIONS)
    known = known_figures(one.family.template.stage())
    never = replace(problem(), requirements=(requirement_of("height <= 10 mm", known),))
    with pytest.raises(ModelError, match=r"none of \d+ stages meets all requirements"):
        find_front(never, replace(OPTIONS, evaluations=100))
