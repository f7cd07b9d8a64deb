"""Dimensions of the best stage as a drawing has them, and what is left as it was described."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import StageError
from flexstage.base.progress import listen
from flexstage.quantities.units import parse
from flexstage.stage import stage_from_text
from flexstage.stage.designs import StageTemplate
from flexstage.stage.designs.registry import build
from flexstage.stage.designs.source import spelled_out_text
from flexstage.studies.explore import (
    Family,
    Goal,
    Optimum,
    Problem,
    SearchOptions,
    evaluate,
    figure_of,
    find_optimum,
    known_figures,
    requirement_of,
    variables_of,
)
from flexstage.studies.explore.optimise.local_search import LocalOptimum
from flexstage.studies.explore.optimise.problem import StageProgram
from flexstage.studies.explore.optimise.rounding import round_optimum, rounded_point, rounded_values
from flexstage.studies.explore.variables import Variable

LUMPED = SearchOptions(model="lumped", evaluations=600, starts=1)


def problem(
    *kept: str, ranges: tuple[str, ...], goal: str | None = "natural_frequency.x"
) -> Problem:
    template = StageTemplate.of("parallelogram")
    known = known_figures(template.stage())
    return Problem(
        family=Family(template=template, variables=variables_of(template, ranges)),
        goals=(Goal(figure=figure_of("natural_frequency.x", known), direction="maximise"),),
        requirements=tuple(requirement_of(text, known) for text in kept),
    )


def variable(low: float, high: float, dimension: str, name: str = "x") -> Variable:
    return Variable(name=name, low=low, high=high, usual=low, dimension=dimension)


def test_values_that_a_drawing_has() -> None:
    length = variable(0.3e-3, 0.9004e-3, "length")
    assert rounded_values(length, 0.71234567e-3) == [0.000712]
    assert rounded_values(length, 0.71234567e-3, neighbours=1) == [0.000712, 0.000713, 0.000711]
    # not beyond a bound that is none of them, and the bound itself where none is left
    assert rounded_values(length, 0.90039e-3) == [0.0009]
    assert rounded_values(variable(0.1001e-3, 0.1002e-3, "length"), 0.10019e-3) == [0.1002e-3]
    angle = variable(0.0, 1.5, "angle")
    assert rounded_values(angle, np.radians(31.41592)) == [parse("31.416 deg", "angle")]
    # six digits of whatever else, and of a length that a data sheet has
    assert rounded_values(variable(1.0, 1e9, "stiffness"), 48684215.3) == [48684200.0]
    assert rounded_values(
        variable(1e-6, 1e-4, "length", "x.actuator.free_stroke"), 3.81234567e-5
    ) == [3.81235e-05]


@pytest.fixture(scope="module")
def best() -> Optimum:
    """Necks, bars and their distance move the frequency; the column of the base moves nothing."""
    ranges = (
        *("leg.notch.neck_thickness=0.3..0.9 mm", "leg.bar_length=15..40 mm"),
        *("column_width=7.1237 mm..19 mm", "leg_spacing=30..60 mm"),
    )
    return find_optimum(problem("stress.x <= 113 MPa", "height <= 71 mm", ranges=ranges), LUMPED)


def test_what_is_written_reported_and_analysed_is_the_same_rounded_stage(best: Optimum) -> None:
    assert best.met
    um = best.point / 1e-6
    assert um == pytest.approx(np.round(um), abs=1e-9)
    changed = [v.text(x) for v, x in zip(best.problem.family.variables, best.point, strict=True)]
    assert all(text in best.text for text in changed)
    assert max(len(text) for text in changed) <= len("12.345 mm")
    read = stage_from_text(best.text, build, source="best.yaml")
    assert read == best.stage
    family = best.problem.family
    again = evaluate(family, best.point[None], best.figures).values[0]
    assert best.levels[-1].best == pytest.approx(again, rel=1e-12)


def test_rounding_keeps_what_is_required_and_costs_little(best: Optimum) -> None:
    """Both limits hold the optimum: rounded at random, one in two would be beyond them."""
    held = {held.name for held in best.active_constraints}
    assert {"max_stress.x", "leg.notch.neck_thickness"} & held
    assert np.max(best.excess) < 2e-4
    # the best that the search itself had seen, by its own model
    seen = max(step.objective for step in best.history if step.violation < 1e-6)
    assert best.levels[-1].best[0] == pytest.approx(seen, rel=2e-3)


def test_rounds_the_other_way_where_the_nearest_misses() -> None:
    """One neck against one stress, whose limit is at 0.6008 mm: 0.601 mm are nearer, and beyond."""
    ranges = ("leg.notch.neck_thickness=0.3..0.9 mm",)
    wanted = problem("stress.x <= 113 MPa", ranges=ranges)
    x = wanted.position(np.array([0.6008e-3]))
    stress = float(evaluate(wanted.family, wanted.point(x)[None], wanted.figures).values[0, 1])
    wanted = problem(f"stress.x <= {stress!r} Pa", ranges=ranges)
    program = StageProgram(problem=wanted, nearest_to=x, goal_reference=200.0)
    values, slopes = program.slopes(x)
    found = LocalOptimum(point=x, values=values, violation=0.0, slopes=slopes, converged=True)
    kept, drawing = round_optimum(program, found)
    assert kept.point == pytest.approx(x, abs=1e-15)
    assert rounded_point(wanted, drawing.point)[0] == 0.6e-3
    assert drawing.violation == 0.0


def test_what_moves_nothing_stays_as_it_is_described(best: Optimum) -> None:
    """Searches from other starts begin with other columns; no figure depends on them."""
    at = best.problem.family.names.index("column_width")
    assert best.point[at] == best.problem.family.variables[at].usual


def test_a_move_that_gains_nothing_measurable_goes_back() -> None:
    """A neck that is 0.01 um thicker gains two parts in 1e5."""
    wanted = problem("height <= 90 mm", ranges=("leg.notch.neck_thickness=0.3..0.9 mm",))
    home = wanted.position(wanted.family.usual)
    program = StageProgram(problem=wanted, nearest_to=home, goal_reference=190.0)

    def of(neck: float) -> np.ndarray:
        x = wanted.position(np.array([neck]))
        values, slopes = program.slopes(x)
        here = LocalOptimum(point=x, values=values, violation=0.0, slopes=slopes, converged=True)
        return rounded_point(wanted, round_optimum(program, here)[1].point)

    assert of(0.50001e-3)[0] == 0.5e-3
    # what does gain stays, as the best of the two um to either side, as nothing limits it here
    assert of(0.5104e-3)[0] == 0.512e-3


def test_name_and_title_say_what_it_is(best: Optimum) -> None:
    assert best.stage.name == "parallelogram-optimised"
    assert best.stage.title.endswith(", optimised: maximise natural_frequency.x")


def test_middle_of_bounds_in_per_cent_is_the_start() -> None:
    ranges = ("leg.notch.neck_thickness=20 %", "leg.bar_length=10 %")
    options = replace(LUMPED, start="middle", evaluations=60, starts=0)
    found = find_optimum(problem("stress.x <= 113 MPa", ranges=ranges), options)
    assert [n for n in found.notes if n.startswith("--start middle is the described stage")]
    ranges = ("leg.notch.neck_thickness=0.4..0.7 mm", "leg.bar_length=10 %")
    found = find_optimum(problem("stress.x <= 113 MPa", ranges=ranges), options)
    assert not [n for n in found.notes if n.startswith("--start middle")]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_file_keeps_its_comments_under_another_name(end: str) -> None:
    text = spelled_out_text("parallelogram")
    text = text.replace("name: parallelogram\n", "name: 'no #1'  # of May\n")
    text = text.replace("title: Parallelogram guide\n", "title: >-\n  A guide\n  on legs\n")
    text = text.replace("\n", end)
    template = StageTemplate(source="mine.yaml", file=text)
    made = template.text({"neck_thickness": 0.5001e-3}, "no #1-optimised", "A guide: better")
    before, after = text.split(end), made.split(end)
    assert [line for line in after if line not in before] == [
        "  neck_thickness: 0.5001 mm",
        "name: 'no #1-optimised'  # of May",
        "title: 'A guide: better'",
    ]
    comments = [line for line in before if line.startswith("#")]
    assert [line for line in after if line.startswith("#")] == comments
    stage = stage_from_text(made)
    assert (stage.name, stage.title) == ("no #1-optimised", "A guide: better")


def test_the_stage_of_a_design_has_the_name_that_its_file_gives_it() -> None:
    text = "flexstage: 1\nname: mine  # of May\ndesign:\n  name: parallelogram\n"
    text += "  leg_spacing: 41 mm\n"
    assert stage_from_text(text, build).name == "mine"
    template = StageTemplate(source="mine.yaml", file=text)
    made = template.text({"leg_spacing": 0.042}, "mine-optimised", "Stiff legs")
    assert made.splitlines()[1:3] == ["name: mine-optimised  # of May", "title: Stiff legs"]
    assert "leg_spacing: 42 mm" in made
    with pytest.raises(StageError, match="a name must be 1 to 80 printable characters"):
        stage_from_text(text.replace("mine ", "m" * 81 + " "), build)


def test_progress_says_the_rung_the_best_so_far_and_the_share_of_the_evaluations() -> None:
    told: list[tuple[str, float]] = []
    ranges = ("leg.notch.neck_thickness=0.3..0.9 mm", "leg.bar_length=15..40 mm")
    with listen(lambda what, done: told.append((what, done))):
        options = SearchOptions(evaluations=200, starts=1)
        find_optimum(problem("stress.x <= 113 MPa", ranges=ranges), options)
    shares = [done for _, done in told]
    assert shares == sorted(shares)
    assert len({round(share, 3) for share in shares if share < 0.5}) > 5
    assert shares[-1] > 0.6
    searched = [what for what, _ in told if what.startswith("lumped search 2 of 2, best natural_")]
    best = [float(what.split()[-2]) for what in searched]
    assert best == sorted(best)
    assert [
        what
        for what, _ in told
        if what.startswith("iteration 1: search of the lumped model corrected by superelem")
    ]
