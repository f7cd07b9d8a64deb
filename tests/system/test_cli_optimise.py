"""`flexstage optimise`: tables, JSON, files, and what it says about bad input."""

import json

import pytest

from flexstage.cli import main

OVER = (
    *("--over", "leg.notch.neck_thickness=0.3..0.9 mm"),
    *("--over", "leg.bar_length=15..40 mm"),
)
LUMPED = ("--model", "lumped", "--evaluations", "600", "--quiet")
#: Where the first few tell as much as the best.
FEW = ("--evaluations", "40")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run(capsys):
    """Run a command; return its exit status, and what it printed on both outputs."""

    def call(*words):
        with pytest.raises(SystemExit) as end:
            main(words)
        return (int(end.value.code or 0), *capsys.readouterr())

    return call


@pytest.mark.usefixtures("undrawn")
def test_best_stage_is_analysed_as_it_was_promised(run, tmp_path):
    goal = ("--maximise", "natural_frequency.x", "--keep", "stress.x <= 110 MPa")
    status, out, _ = run("optimise", "parallelogram", *goal, *OVER, *LUMPED, "--folder", "out")
    assert status == 0
    assert "all requirements are met" in out
    assert "note: active constraint max_stress.x <= 110.0 MPa; relaxing it by" in out
    assert "default constraints (disable with --without NAME): check" in out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *("best.yaml", "optimise.json"),
        *("history.svg", "before-after.svg", "figures.svg"),
    }
    result = json.loads((tmp_path / "out" / "optimise.json").read_text())
    words = "analyse", "out/best.yaml", "--model", "lumped", "--json", "--quiet"
    rows = json.loads(run(*words)[1])["characteristics"]
    single = {row["quantity"]: row["value"] for row in rows}
    promised = result["figures"][-1]["best"]
    assert single["natural_frequency_hz"] == pytest.approx(
        promised["natural_frequency.x"], rel=1e-9
    )
    assert single["max_stress"] == pytest.approx(110e6, rel=2e-3)
    assert run("check", "out/best.yaml")[0] == 0


def test_match_prints_one_object_as_json(run):
    words = ("--match", "natural_frequency.x = 240 Hz", "--start", "middle", "--json")
    status, out, _ = run("optimise", "parallelogram", *words, *OVER, *LUMPED)
    assert status == 0
    found = json.loads(out)
    assert found["met"]
    assert found["goals"] == []
    assert found["figures"][0]["best"]["natural_frequency.x"] == pytest.approx(240.0, rel=2e-3)
    assert [v["start"] for v in found["variables"]] == pytest.approx([0.6e-3, 27.5e-3])
    assert found["files"] == []


@pytest.mark.usefixtures("undrawn")
def test_what_is_missed_is_said_first_and_fails(run, tmp_path):
    words = ("--maximise", "natural_frequency.x", "--keep", "natural_frequency.x >= 900 Hz")
    words += (*OVER, *LUMPED, *FEW)
    status, out, _ = run("optimise", "parallelogram", *words, "--folder", "out")
    assert status == 1
    first = next(line for line in out.splitlines() if line.startswith("note: "))
    assert first.startswith("note: natural_frequency.x >= 900 Hz is violated by")
    assert "≥ 900.0 violated" in out
    assert (tmp_path / "out" / "best.yaml").exists()
    status, out, _ = run("optimise", "parallelogram", *words, "--json")
    assert status == 1
    assert not json.loads(out)["met"]


def test_front_of_three_goals_has_a_page(run, tmp_path):
    goals = ("--maximise", "natural_frequency.x", "--minimise", "stress.x", "--minimise", "mass")
    small = ("--model", "lumped", "--evaluations", "60", "--workers", "1", "--quiet")
    words = (*goals, *OVER, *small, "--folder", "out", "--figure", "front.png")
    status, out, _ = run("optimise", "parallelogram", *words)
    assert status == 0
    assert "(selected)" in out
    assert (tmp_path / "front.png").read_bytes().startswith(b"\x89PNG")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"best.yaml", "front.svg", "front.html"} <= names
    page = (tmp_path / "out" / "front.html").read_text("utf-8")
    assert "parallel-coordinates" in page
    assert "maximise natural_frequency.x and minimise max_stress.x and minimise mass" in page
    result = json.loads((tmp_path / "out" / "optimise.json").read_text())
    assert len(result["front"]) == len({tuple(p["variables"].values()) for p in result["front"]})
    assert result["optimum"]["met"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "the objective is missing: use --maximise or --minimise for a figure, or --match"),
        (("--maximise", "frequenzy.x"), "there is no figure 'frequenzy.x'"),
        (("--match", "stroke.x >= 2 um"), "--match needs a figure and its value"),
        (
            ("--maximise", "frequency.x", "--match", "stroke.x = 200 um"),
            "--match cannot be combined with a goal",
        ),
        (("--match", "published"), "no published finite-element values of parallelogram"),
        (
            ("--maximise", "frequency.x", "--start", "centre"),
            "'--start': must be described or middle",
        ),
        (
            ("--maximise", "frequency.x", "--confirm", "lumped"),
            "'--confirm': must be plane, superelement-3d or solid",
        ),
        (("--maximise", "frequency.x", "--over", "leg_neck=1..2 mm"), "no parameter 'leg_neck'"),
        (
            ("--maximise", "frequency.x", "--without", "yield"),
            "there is no default constraint 'yield'",
        ),
        (("--maximise", "frequency.x", "--keep", "stress 5"), "is not a requirement"),
    ],
)
def test_bad_input_is_one_sentence(run, words, said):
    status, out, err = run("optimise", "parallelogram", *words)
    assert status == 2
    assert out == ""
    assert said in err
    assert err.count("\n") == 1


def test_what_belongs_to_bought_parts_is_held_and_said(run):
    words = ("--match", "natural_frequency.x = 262 Hz", "--without", "safety_factor")
    _, out, _ = run("optimise", "parallelogram", *words, *LUMPED, *FEW)
    out = " ".join(out.split())
    assert "note: fixed dimensions of bought parts, bolts and the plate" in out
    assert "thickness, mounting_hole_diameter, force_patch_half_width, actuator_length" in out
