"""The best stage: closed forms, multipliers against searches again, the ladder, what is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.stage import check, stage_from_text
from flexstage.stage.designs import StageTemplate
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
from flexstage.studies.explore.family import Evaluated
from flexstage.studies.explore.optimise import multi_fidelity
from flexstage.studies.explore.optimise.default_requirements import (
    default_requirements,
    default_variables,
    fixed_dimensions_note,
    published_targets,
)
from flexstage.studies.explore.optimise.local_search import LocalOptimum, local_search
from flexstage.studies.explore.optimise.optimum import find_active_constraints
from flexstage.studies.explore.optimise.problem import StageProgram
from flexstage.studies.explore.prepare import problem_of
from flexstage.studies.explore.requests import OptimiseRequest

RANGES = (
    "leg.notch.neck_thickness=0.3..0.9 mm",
    "leg.bar_length=15..40 mm",
    "platform_height=8..20 mm",
    "leg_spacing=30..60 mm",
)
LUMPED = SearchOptions(model="lumped", evaluations=1500, starts=0)
#: From another start as well, which a seed gives.
AGAIN = replace(LUMPED, starts=1)


def problem(
    *kept: str,
    goal: str | None = "natural_frequency.x",
    ranges: tuple[str, ...] = RANGES,
    settings: dict[str, str] | None = None,
    way: str = "maximise",
    walls: bool = False,
) -> Problem:
    template = StageTemplate.of("parallelogram", settings)
    known = known_figures(template.stage())
    requirements = tuple(requirement_of(text, known) for text in kept)
    goals = () if goal is None else (Goal(figure=figure_of(goal, known), direction=way),)  # type: ignore[arg-type]
    return Problem(
        family=Family(template=template, variables=variables_of(template, ranges)),
        goals=goals,
        requirements=requirements,
        # walls are far from their limits in all of these; to measure them takes half of the time
        defaults=default_requirements(
            template.stage(), known, requirements, () if walls else ("smallest_wall", "output_wall")
        ),
    )


@pytest.fixture(scope="module")
def sound() -> Optimum:
    return find_optimum(problem("stress.x <= 90 MPa", walls=True), AGAIN)


def rate(found: Optimum, name: str) -> float:
    return next(held.rate for held in found.active_constraints if held.name == name)


def best(found: Optimum) -> float:
    return float(found.levels[-1].best[0])


def test_leaf_of_a_stated_stiffness_is_that_of_beams() -> None:
    """Two legs whose ends bend over a length l: k = 3 E' I / (a³ - (a - l)³), a half of a leg.

    By Castigliano from the moment F (a - x)/2 at each end; E' = E/(1 - nu²), as a leaf is wide. The
    roots of the leaves in the bodies give way too: a leaf is a per cent thicker for it.
    """
    length, bar, width, thickness = 10e-3, 30e-3, 8e-3, 0.33e-3
    modulus, half = 71.7e9 / (1.0 - 0.33**2), bar / 2.0 + length
    inertia = width * thickness**3 / 12.0
    stiffness = 3.0 * modulus * inertia / (half**3 - (half - length) ** 3)
    leaf = {
        "leg.notch.kind": "leaf",
        "leg.notch.neck_thickness": "0.4 mm",
        "leg.notch.leaf_length": "10 mm",
        "leg.notch.notch_depth": "2 mm",
        "leg.bar_length": "30 mm",
    }
    wanted = problem(
        f"input_stiffness.x = {stiffness!r} N/m",
        goal=None,
        ranges=("leg.notch.neck_thickness=0.15..0.6 mm",),
        settings=leaf,
    )
    found = find_optimum(wanted, replace(LUMPED, start="middle"))
    assert found.met
    assert found.point[0] == pytest.approx(1.01 * thickness, rel=0.01)


def test_nearest_of_many_that_match() -> None:
    """One target, four variables: the way from the start is along the slope of the figure."""
    wanted = problem("natural_frequency.x = 240 Hz", goal=None)
    found = find_optimum(wanted, LUMPED)
    assert found.met
    assert found.free_directions == 3
    from flexstage.studies.explore import jacobian

    at = (found.point + found.start) / 2.0
    slope = jacobian(wanted.family, at, wanted.figures)[1][0] * wanted.width
    way = wanted.position(found.point) - wanted.position(found.start)
    cosine = slope @ way / np.linalg.norm(slope) / np.linalg.norm(way)
    assert cosine == pytest.approx(1.0, abs=2e-3)


def test_multipliers_are_what_moved_limits_give() -> None:
    """Of a requirement and of a bound, against searches with the limit moved by a per cent."""
    first = find_optimum(problem("stress.x <= 120 MPa", "height <= 70 mm"), LUMPED)
    assert first.met
    assert first.stationarity_residual < 1e-3
    stressed = find_optimum(problem("stress.x <= 121.2 MPa", "height <= 70 mm"), LUMPED)
    assert (best(stressed) - best(first)) / 1.2e6 == pytest.approx(
        rate(first, "max_stress.x"), rel=0.02
    )
    ranges = ("leg.notch.neck_thickness=0.3..0.91 mm", *RANGES[1:])
    thicker = find_optimum(problem("stress.x <= 120 MPa", "height <= 70 mm", ranges=ranges), LUMPED)
    assert (best(thicker) - best(first)) / 0.01e-3 == pytest.approx(
        rate(first, "leg.notch.neck_thickness"), rel=0.03
    )
    # the limit of the height is not reached, and holds nothing
    assert "height" not in {held.name for held in first.active_constraints}
    assert (
        "relaxing it by 2.000 MPa changes natural_frequency.x by +8.3 Hz"
        in first.active_constraints[0].text
    )


def test_limit_that_nothing_moves_holds_nothing() -> None:
    """Slopes of a figure that are rounding balance anything, with a multiplier of nonsense."""
    wanted = problem("stress.x <= 120 MPa", "stroke.x >= 200 um")
    program = StageProgram(problem=wanted, nearest_to=np.full(4, 0.5), goal_reference=400.0)
    found = LocalOptimum(
        point=np.full(4, 0.5),
        values=np.array([-1.0, 1.0, 1.0]),
        violation=0.0,
        slopes=np.array([[-0.8, 0.3, 0.0, 0.0], [0.9, -0.2, 0.0, 0.0], [1e-6, 2e-6, 0.0, 0.0]]),
        converged=True,
    )
    held, free, left = find_active_constraints(program, found)
    assert [limit.name for limit in held] == ["max_stress.x"]
    assert free == 3
    assert left > 0.01


def test_ladder_ends_where_the_finer_model_keeps_the_limits() -> None:
    wanted = problem("stress.x <= 120 MPa", "height <= 70 mm")
    found = find_optimum(wanted, replace(LUMPED, model="superelement"))
    assert found.met
    fine = evaluate(wanted.family, found.point[None], wanted.figures, "superelement").values[0]
    assert found.levels[-1].best == pytest.approx(fine)
    # the lumped model alone would have missed it: it is some per cent off
    assert found.iterations[0].computed != pytest.approx(found.iterations[0].predicted, rel=2e-3)
    assert found.iterations[-1].computed == pytest.approx(found.iterations[-1].predicted, rel=2e-3)
    assert found.evaluations["superelement"] <= 6


def test_best_is_a_sound_stage_and_its_file_loses_nothing(sound: Optimum) -> None:
    from flexstage.stage.designs.registry import build

    again = stage_from_text(sound.text, build, source="best.yaml")
    assert again == sound.stage
    assert not [issue for issue in check(sound.stage) if issue.severity == "error"]


def test_same_seed_same_optimum(sound: Optimum) -> None:
    again = find_optimum(problem("stress.x <= 90 MPa"), AGAIN)
    assert np.array_equal(sound.point, again.point)


def test_what_cannot_be_reached_is_missed_by_the_least() -> None:
    wanted = problem("stress.x <= 20 MPa", "natural_frequency.x >= 400 Hz", goal=None)
    found = find_optimum(wanted, replace(LUMPED, evaluations=500))
    assert not found.met
    assert found.excess.max() > 0.1


def finer(monkeypatch: pytest.MonkeyPatch, change: Callable[[np.ndarray, np.ndarray], str]) -> None:
    """Have the ladder ask a finer model: the lumped one, changed by how far necks go."""

    def asked(family: Family, points: np.ndarray, figures: object, model: str) -> Evaluated:
        found = evaluate(family, points, figures)  # type: ignore[arg-type]
        faults = found.faults
        if model != "lumped":
            values = found.values.copy()
            faults = tuple(change(x, row) for x, row in zip(points, values, strict=True))
            return replace(found, values=values, faults=faults)
        return found

    monkeypatch.setattr(multi_fidelity, "evaluate", asked)


def test_stages_without_figures_by_the_finer_model_are_gone_back_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The lumped search goes to the upper bound of the neck; the finer model ends at 0.72 mm."""

    def change(x: np.ndarray, row: np.ndarray) -> str:
        if x[0] <= 0.72e-3:
            return ""
        row[:] = np.nan
        return "the equations of the stage cannot be solved"

    ranges = ("leg.notch.neck_thickness=0.3..0.9 mm",)
    finer(monkeypatch, change)
    found = find_optimum(problem("stress.x <= 500 MPa", ranges=ranges), SearchOptions(starts=0))
    assert found.met
    assert 0.5e-3 < found.point[0] <= 0.72e-3
    assert not np.all(np.isfinite(found.iterations[0].computed))


def test_start_is_kept_where_the_finer_model_refuses_all_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another stage than the start misses the frequency by a half, whatever is corrected."""

    ranges = ("leg.notch.neck_thickness=0.45..0.55 mm", "leg.bar_length=24..28 mm")
    wanted = problem("natural_frequency.x >= 140 Hz", goal="mass", way="minimise", ranges=ranges)
    at = wanted.figures.index(wanted.requirements[0].figure)

    def off(x: np.ndarray, row: np.ndarray) -> str:
        row[at] *= 1.0 if abs(x[0] - 0.5e-3) < 1e-12 and abs(x[1] - 26e-3) < 1e-12 else 0.5
        return ""

    finer(monkeypatch, off)
    found = find_optimum(wanted, SearchOptions(starts=0, evaluations=300))
    assert found.met
    np.testing.assert_allclose(found.point, [0.5e-3, 26e-3], rtol=1e-12)
    assert "no better stage than the start was found" in found.notes


def test_no_figures_at_all_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def change(x: np.ndarray, row: np.ndarray) -> str:
        row[:] = np.nan
        return "the equations of the stage cannot be solved"

    finer(monkeypatch, change)
    with pytest.raises(ModelError, match=r"nor of the start: the equations of the stage cannot"):
        find_optimum(problem(), SearchOptions(starts=0, evaluations=150))


def test_what_the_finest_model_finds_missed_is_mended_nearby(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It has 1 % more stress than the searched one, whose evaluations are used up by then."""
    wanted = problem("stress.x <= 113 MPa", ranges=RANGES[:2])
    stress = wanted.figures.index(wanted.requirements[0].figure)

    def more(x: np.ndarray, row: np.ndarray) -> str:
        row[stress] *= 1.01
        return ""

    finer(monkeypatch, more)
    options = SearchOptions(model="lumped", confirm="solid", evaluations=250, starts=0)
    found = find_optimum(wanted, options)
    first, second = found.iterations
    assert first.computed[stress] / 113e6 == pytest.approx(1.01, abs=2e-3)
    assert found.met
    assert second.computed[stress] <= 113e6 * 1.002
    width = wanted.width
    assert np.max(np.abs(second.point - first.point) / width) <= 0.1 + 1e-3


def test_usual_requirements_give_way_to_those_that_are_asked() -> None:
    stage = StageTemplate.of("vgtu-piezo").stage()
    known = known_figures(stage)
    usual = default_requirements(stage, known, ())
    assert [r.text for r in usual] == [
        "safety_factor.x >= 1.5",
        "safety_factor.y >= 1.5",
        # 1850 N over 38 um: less than the 50 N/um of the stack itself
        "input_stiffness.x <= 48.6842 N/µm",
        "input_stiffness.y <= 48.6842 N/µm",
        # of the bodies; of the platform, which both axes share
        "smallest_wall >= 1 mm",
        "output_wall.x >= 3.3 mm",
        # nine tenths of the stroke as described
        "output_displacement.x >= 60.8 µm",
        "output_displacement.y >= 57.9 µm",
    ]
    assert known["output_displacement", "x"] == pytest.approx(60.8e-6 / 0.9, rel=1e-3)
    asked = (requirement_of("stress.x <= 200 MPa", known),)
    left = default_requirements(stage, known, asked, ["input_stiffness", "output_wall", "stroke"])
    assert [r.text for r in left] == ["safety_factor.y >= 1.5", "smallest_wall >= 1 mm"]
    # a stroke or ratio that is sought or asked for says itself what it is to be
    for words, goals in (("ratio.x = 1.7", ()), ("mass <= 1 kg", ("stroke.x",))):
        chosen = [figure_of(name, known) for name in goals]
        told = default_requirements(stage, known, (requirement_of(words, known),), goals=chosen)
        strokes = [r.figure.name for r in told if r.figure.quantity == "output_displacement"]
        assert strokes == ["output_displacement.y"]
    # no more is asked than the stage has, in whole um
    thin = StageTemplate.of("parallelogram", {"platform_height": "2.3456789 mm"}).stage()
    usual = default_requirements(thin, known_figures(thin), asked)
    walls = [r.text for r in usual if "wall" in r.text]
    assert walls == ["smallest_wall >= 1 mm", "output_wall.x >= 2.345 mm"]
    with pytest.raises(ModelError, match="did you mean 'safety_factor"):
        default_requirements(stage, known, (), ["safety_facto"])


@pytest.mark.parametrize(
    ("name", "over", "axis"), [("bridge", "edge=20 %", "y"), ("vgtu-piezo", "x.leg_neck=9 %", "x")]
)
def test_the_frequency_with_its_stack_is_told_of_a_stage_that_has_one(
    name: str, over: str, axis: str
) -> None:
    template = StageTemplate.of(name)
    known = known_figures(template.stage())
    wanted = Problem(
        family=Family(template=template, variables=variables_of(template, [over])),
        goals=(Goal(figure=figure_of(f"natural_frequency.{axis}", known), direction="maximise"),),
    )
    found = find_optimum(wanted, SearchOptions(model="lumped", evaluations=30, starts=0))
    (note,) = (n for n in found.notes if "with stack" in n)
    told = ("natural_frequency_with_stack_hz", axis)
    text = figure_of("natural_frequency_with_stack", {told}).text
    assert f"{text(known_figures(found.stage)[told])} at the optimum" in note
    # of the start where nothing was published of it
    assert ("at the start" in note) == (told in known)
    if told in known:
        assert f"{text(known[told])} at the start" in note


@pytest.mark.slow
def test_a_description_that_lies_on_walls_is_no_end_of_a_search() -> None:
    """The links of both axes have their least length in the piezo stage as it is described."""
    template = StageTemplate.of("vgtu-piezo")
    wanted = problem_of(OptimiseRequest(maximise=("natural_frequency.x",)), template)
    start = wanted.position(wanted.family.usual)
    program = StageProgram(problem=wanted, nearest_to=start)
    program.goal_reference = float(program.figures(start[None])[0, 0])
    found = local_search(program, start, steps=3)
    assert found is not None
    assert found.values[0] < -1.2  # from 326 Hz, in parts of it and then by the logarithm
    assert not program.fault(found.point)
    values = dict(zip(wanted.figures, program.figures(found.point[None])[0], strict=True))
    for requirement in wanted.defaults:
        assert requirement.excess(np.array(values[requirement.figure])) < 0.05


def test_published_targets_leave_out_what_follows() -> None:
    stage = StageTemplate.of("vgtu-mechanical").stage()
    targets = published_targets(stage, known_figures(stage))
    assert [(t.figure.name, t.low) for t in targets] == [
        ("output_displacement.x", 111.53e-6),
        ("output_displacement.y", 113.05e-6),
        ("max_stress.x", 467.5e6),
        ("max_stress.y", 384.4e6),
        ("natural_frequency.x", 516.75),
        ("natural_frequency.y", 728.42),
    ]
    with pytest.raises(ModelError, match="no published finite-element values of parallelogram"):
        published_targets(StageTemplate.of("parallelogram").stage(), {("mass", "stage")})


def test_bought_parts_are_not_varied_unasked() -> None:
    names = {variable.name for variable in default_variables(StageTemplate.of("parallelogram"))}
    assert "leg.notch.neck_thickness" in names
    assert not [n for n in names if "actuator" in n or "mounting" in n or "patch" in n]
    assert "thickness" not in names
    held = fixed_dimensions_note(StageTemplate.of("vgtu-piezo"))
    assert "x.actuator_pocket_length" in held
    assert "x.actuator.stiffness" not in held


def test_a_pattern_leaves_the_data_sheet_of_an_actuator() -> None:
    template = StageTemplate.of("vgtu-piezo")
    names = [v.name for v in variables_of(template, ["x.*=5 %"])]
    assert "x.leg_neck" in names
    assert not any(name.startswith("x.actuator.") for name in names)
    sheet = [v.name for v in variables_of(template, ["x.actuator.*=5 %"])]
    assert "x.actuator.stiffness" in sheet


def test_refusals() -> None:
    with pytest.raises(ModelError, match="the problem has no objective"):
        replace(problem(), goals=())
    with pytest.raises(ModelError, match="lies outside the bounds of leg_spacing"):
        find_optimum(problem(ranges=("leg_spacing=50..60 mm",)), LUMPED)
    with pytest.raises(ModelError, match=r"none of \d+ stages within the bounds is possible"):
        find_optimum(
            problem(ranges=("platform_overhang=-9..-8 mm",)), replace(LUMPED, start="middle")
        )
    wanted = problem()
    with pytest.raises(ModelError, match="Pareto front"):
        find_optimum(replace(wanted, goals=wanted.goals * 2), LUMPED)
