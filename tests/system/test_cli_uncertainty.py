"""`flexstage uncertainty`: tables, JSON, figure, and what it says about bad input."""

import json
import math

import pytest
import typer
from typer.testing import CliRunner

from flexstage.base.errors import FlexstageError
from flexstage.cli.uncertainty import uncertainty
from flexstage.measure.uncertainty.budget_file import budget_from_text
from flexstage.measure.uncertainty.monte_carlo import validate
from flexstage.measure.uncertainty.propagate import propagate
from flexstage.report.figures.distributions import draw_budget
from flexstage.report.figures.style import encode

BUDGET = """
quantity: stroke
unit: um
notes: ten strokes of the x axis
equation: l * (1 + c) / cos(a) - d * p
influences:
  - {name: l, value: 63.12 um, uncertainty: 12 nm, dof: 9, source: ten strokes}
  - {name: c, value: 0, half_width: 0.03 %, source: certificate}
  - {name: a, value: 0 deg, uncertainty: 0.6 deg}
  - {name: d, value: 3 mm, uncertainty: 0.2 mm}
  - {name: p, value: 4.1 urad, uncertainty: 0.8 urad}
correlations:
  - [d, p, 0.25]
"""
LINEAR = """
quantity: sum
unit: nm
equation: a + 2 * b
influences:
  - {name: a, value: 1 um, uncertainty: 3 nm}
  - {name: b, value: 2 um, uncertainty: 2 nm}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "budget.yaml"
    path.write_text(BUDGET, encoding="utf-8")
    return path


def run(*words):
    app = typer.Typer()
    app.command()(uncertainty)
    return CliRunner().invoke(app, [str(word) for word in words])


def test_json_is_one_object_and_right(file):
    done = run(file, "--json", "--trials", "50000", "--seed", "3")
    assert done.exit_code == 0
    found = json.loads(done.stdout)
    assert found["unit"] == "um"
    assert found["gum"]["value"] == pytest.approx(63.12 - 3e-3 * 4.1e-6 * 1e6, rel=1e-12)
    parts = {row["name"]: row["contribution"] for row in found["influences"]}
    assert parts["l"] == pytest.approx(0.012)
    assert parts["c"] == pytest.approx(63.12 * 3e-4 / math.sqrt(3))
    assert parts["a"] == 0.0
    slopes = {row["name"]: row["sensitivity"] for row in found["influences"]}
    assert slopes == pytest.approx({"l": 1e6, "c": 63.12, "a": 0.0, "d": -4.1, "p": -3e3})
    assert sum(row["share"] for row in found["influences"]) == pytest.approx(1.0)
    u = found["gum"]["standard_uncertainty"]
    covariance = 2 * 0.25 * parts["d"] * parts["p"]
    assert u == pytest.approx(math.sqrt(sum(v**2 for v in parts.values()) + covariance))
    low, high = found["gum"]["interval"]
    assert high - low == pytest.approx(2 * found["gum"]["coverage_factor"] * u)
    # the mean cosine error is what the first order does not see
    lift = 63.12 * 0.5 * math.radians(0.6) ** 2
    shift = found["monte_carlo"]["value"] - found["gum"]["value"]
    assert shift == pytest.approx(lift, abs=4 * 0.02 / math.sqrt(50_000))
    assert found["monte_carlo"]["trials"] == 50_000
    assert found["monte_carlo"]["tolerance"] is None
    assert not found["agreement"]["valid"]
    assert found["correlations"] == [{"between": ["d", "p"], "coefficient": 0.25}]
    assert found["influences"][1]["degrees_of_freedom"] is None
    assert "ten strokes of the x axis" in found["notes"]


def test_the_same_seed_gives_the_same_and_another_another(file):
    one, two, three = (
        run(file, "--json", "--trials", "2000", "--seed", seed).stdout for seed in (3, 3, 4)
    )
    assert one == two
    assert one != three


def test_a_linear_budget_agrees(tmp_path):
    path = tmp_path / "linear.yaml"
    path.write_text(LINEAR, encoding="utf-8")
    found = json.loads(run(path, "--json", "--confidence", "0.9").stdout)
    assert found["agreement"]["valid"]
    assert found["gum"]["expanded_uncertainty"] == pytest.approx(1.6448536 * 5.0, rel=1e-6)
    assert found["monte_carlo"]["interval"] == pytest.approx(found["gum"]["interval"], abs=0.05)
    assert found["monte_carlo"]["tolerance"] <= 0.02
    said = run(path).stdout
    assert "agree" in said
    assert "do not agree" not in said


def test_tables_and_figure(file, tmp_path):
    picture = tmp_path / "budget.svg"
    done = run(file, "--trials", "20000", "--figure", picture)
    assert done.exit_code == 0
    for word in ("stroke = l * (1 + c)", "uniform", "student", "GUM", "Monte Carlo", "shortest"):
        assert word in done.stdout
    assert "do not agree" in done.stdout
    assert "degrees of freedom" in done.stdout
    text = picture.read_text(encoding="utf-8")
    for word in ("share of the variance", "stroke [µm]", "first order"):
        assert word in text


@pytest.mark.parametrize("equation", ["l * 0", "l * 1"])
def test_a_result_without_uncertainty_is_drawn(tmp_path, equation):
    path, picture = tmp_path / "b.yaml", tmp_path / "b.svg"
    given = "5 nm" if equation == "l * 0" else "0 nm"
    path.write_text(
        f"quantity: stroke\nunit: um\nequation: {equation}\n"
        f"influences:\n  - {{name: l, value: 63.12 um, uncertainty: {given}}}\n"
    )
    done = run(path, "--figure", picture, "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["monte_carlo"]["standard_uncertainty"] < 1e-12
    assert "stroke [µm]" in picture.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--trials", "some"), "whole number or auto"),
        (("--trials", "1.5"), "whole number or auto"),
        (("--confidence", "95"), "between 0 and 1"),
    ],
)
def test_options_that_are_none_are_refused(file, words, message):
    done = run(file, *words)
    assert done.exit_code == 2
    assert f"'{words[0]}': must be" in done.output
    assert message in done.output


def test_too_few_trials_are_one_sentence(file):
    done = run(file, "--trials", "10")
    assert isinstance(done.exception, FlexstageError)
    # a value error is bad input, for which the command line ends with 2
    assert isinstance(done.exception, ValueError)
    assert "1000 to" in str(done.exception)
    assert "\n" not in str(done.exception)


def test_a_figure_is_a_picture(file):
    done = run(file, "--figure", "x.gif")
    assert done.exit_code == 2
    assert "must end in one of .svg" in done.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("- 1\n- 2\n", "begins with 'quantity: NAME'"),
        ("quantity: [", "not YAML"),
        (BUDGET.replace("cos(a)", "cos(a).real"), "line 5"),
        (BUDGET.replace("cos(a)", "__import__('os').getcwd()"), "line 5"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    done = run(path)
    assert isinstance(done.exception, FlexstageError)
    assert message in str(done.exception)
    assert "stage" not in str(done.exception)


def test_a_file_that_is_not_there(tmp_path):
    done = run(tmp_path / "none.yaml")
    assert isinstance(done.exception, ValueError)
    assert "there is no file" in str(done.exception)
    assert "budget file" in str(done.exception)
    picture = tmp_path / "made.png"
    run(tmp_path / "none.yaml", "--figure", picture)
    assert not picture.exists()


def test_many_influences_and_a_negative_share_are_drawn():
    names = [f"x{i}" for i in range(17)]
    rows = "\n".join(
        f"  - {{name: {n}, value: {i}, uncertainty: 0.{i + 1}}}" for i, n in enumerate(names)
    )
    text = (
        f"equation: {' + '.join(names)}\ninfluences:\n{rows}\ncorrelations:\n  - [x8, x1, -0.9]\n"
    )
    budget = budget_from_text(text)
    first, drawn = budget.propagate(), budget.monte_carlo(trials=5000)
    assert min(line.share for line in first.lines) < 0.0
    figure = draw_budget(first, drawn)
    assert len(figure.axes[1].patches) == 13
    assert encode(figure, "png")[:4] == b"\x89PNG"


def test_an_exact_result_is_drawn_too():
    budget = budget_from_text(
        "equation: 2 * a\ninfluences:\n  - {name: a, value: 3, uncertainty: 0}\n"
    )
    first, drawn = budget.propagate(), budget.monte_carlo(trials=1000)
    assert first.uncertainty == 0.0
    assert validate(first, drawn).valid
    assert encode(draw_budget(first, drawn), "svg")
    assert propagate(lambda a: 2 * a, budget.influences).value == 6.0
