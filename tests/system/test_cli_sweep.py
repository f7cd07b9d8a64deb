"""`flexstage sweep`: tables, JSON, files, and what it says about bad input."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.stage import stage_to_text
from flexstage.stage.designs import design
from flexstage.studies.explore import Job

NECK = ("--over", "leg.notch.neck_thickness=0.31..0.52 mm/4")
SPACING = ("--over", "leg_spacing=6..46 mm/5")


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


def test_one_parameter_is_a_table_of_rows(run):
    status, out, _ = run("sweep", "parallelogram", *NECK)
    assert status == 0
    lines = [line.split() for line in out.splitlines()]
    assert [row[0] for row in lines if row and row[0].startswith("0.")] == [
        "0.31",
        "0.38",
        "0.45",
        "0.52",
    ]
    assert "parallelogram: lumped, 4 points, grid of 4" in out
    # by default what an engineer looks at first, as far as the stage has it
    for label in ("Transmission ratio x", "Output displacement x", "Natural frequency x"):
        assert label in out
    assert "note: variation below 0.1 %: transmission_ratio.x, output_displacement.x" in out
    assert "note: figures by the lumped model" in out


@pytest.mark.parametrize("command", ["sweep", "sensitivity"])
def test_help_names_no_drawing_where_none_is_taken(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0
    assert "A stage file, or the name of a built-in design." in " ".join(out.split())


def test_it_is_the_analysis_with_a_setting(run):
    _, out, _ = run("sweep", "parallelogram", *NECK, "--of", "stress.x", "--json")
    swept = json.loads(out)["columns"]
    neck = f"leg.notch.neck_thickness={1e3 * swept['leg.notch.neck_thickness'][1]!r} mm"
    words = "analyse", "parallelogram", "--model", "lumped", "--set", neck, "--json", "--quiet"
    rows = json.loads(run(*words)[1])["characteristics"]
    (single,) = [row["value"] for row in rows if row["quantity"] == "max_stress"]
    assert swept["max_stress.x"][1] == pytest.approx(single, rel=1e-12)


def test_a_setting_holds_throughout(run):
    words = "sweep", "parallelogram", *NECK, "--of", "frequency.x", "--json"
    thin = json.loads(run(*words)[1])
    thick = json.loads(run(*words, "--set", "thickness=11 mm")[1])
    # bending stiffness and mass both go with the thickness, but for the drive's own mass, and the
    # plane state of the notches is told by their width
    assert thick["figures"][0]["described"] != thin["figures"][0]["described"]
    assert thick["provenance"]["input_hash"] != thin["provenance"]["input_hash"]


def test_the_folder_has_every_file(run, tmp_path):
    words = "sweep", "parallelogram", *NECK, *SPACING, "--folder", "out", "--figure", "map.png"
    status, out, _ = run(*words)
    assert status == 0
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == ["sweep.csv", "sweep.html", "sweep.json", "sweep.parquet", "sweep.svg"]
    for name in names:
        assert f"wrote out/{name}" in out
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads((tmp_path / "out" / "sweep.json").read_text("utf-8"))
    assert told["points"] == {"all": 20, "possible": 16}
    assert "columns" not in told
    assert "note: 4 of 20 points are infeasible" in out
    # bounds in the digits that were given, not in those of a number of a computer
    page = (tmp_path / "out" / "sweep.html").read_text("utf-8")
    assert "6 mm to 46 mm" in page
    assert "0.31 mm to 0.52 mm" in page
    assert not re.search(r">\d+\.\d{6,} \w+ to", page)


def test_indices_are_printed_and_written(run, tmp_path):
    over = "--over", "leg.*=8 %", "--samples", "16", "--of", "frequency"
    status, out, _ = run("sweep", "parallelogram", *over, "--indices", "--folder", "out")
    assert status == 0
    assert "16 base samples of a Sobol' sequence" in out
    assert "leg.notch.neck_thickness" in out
    assert (tmp_path / "out" / "indices.svg").exists()
    told = json.loads((tmp_path / "out" / "sweep.json").read_text("utf-8"))
    shares = told["indices"]["shares"]["natural_frequency.x"]
    names = [variable["name"] for variable in told["variables"]]
    assert list(shares) == names
    assert len(names) >= 3
    neck = shares["leg.notch.neck_thickness"]["total"]
    assert neck["low"] < neck["value"] < neck["high"]
    assert told["points"]["all"] == 16 * (len(names) + 2)


def test_a_figure_without_its_axis_is_that_of_every_axis(run):
    words = "--over", "x.lever_neck=5 %/2", "--of", "frequency", "--json", "--quiet"
    told = json.loads(run("sweep", "vgtu-piezo", *words)[1])
    assert [f["name"] for f in told["figures"]] == ["natural_frequency.x", "natural_frequency.y"]


def test_a_stage_without_axes_is_told_what_it_lacks(run, tmp_path):
    file = tmp_path / "bare.yaml"
    text = stage_to_text(replace(design("parallelogram"), axes=()))
    assert "thickness: 8 mm" in text
    text = text.replace("thickness: 8 mm", "thickness: = plate")
    file.write_text(text.replace("length_unit: mm", "length_unit: mm\nparameters: {plate: 8 mm}"))
    for words in (("sweep", "bare.yaml", "--over", "plate=10 %"), ("sensitivity", "bare.yaml")):
        status, out, err = run(*words, "--quiet")
        assert (status, out) == (2, "")
        assert "the stage has no axes" in err
        assert "or name one of its other figures, smallest_neck, smallest_slot" in err
        assert err.count("\n") == 1
    # which need no axis
    words = "sweep", "bare.yaml", "--over", "plate=10 %/3", "--of", "smallest_slot", "--quiet"
    status, out, _ = run(*words)
    assert status == 0
    assert "plate [mm]" not in out
    assert "variation below 0.1 %: smallest_slot" in out


def test_a_seed_draws_the_same_points(run):
    words = "sweep", "parallelogram", *NECK, *SPACING, "--plan", "latin-hypercube"
    words = *words, "--samples", "7", "--of", "mass", "--json"
    first, again = (json.loads(run(*words, "--seed", "5")[1]) for _ in range(2))
    other = json.loads(run(*words, "--seed", "6")[1])
    assert first["columns"] == again["columns"]
    assert first["columns"]["leg_spacing"] != other["columns"]["leg_spacing"]
    assert len(np.unique(first["columns"]["leg_spacing"])) == 7


def test_without_libraries_the_other_files_are_written(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "plotly", None)
    status, out, _ = run("sweep", "parallelogram", *NECK, "--folder", "out", "--json")
    assert status == 0
    told = json.loads(out)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "sweep.csv",
        "sweep.json",
        "sweep.svg",
    ]
    assert told["files"] == ["out/sweep.csv", "out/sweep.json", "out/sweep.svg"]
    for name, note in zip(("sweep.parquet", "sweep.html"), told["notes"], strict=True):
        assert note.startswith(f"{name} was not written: ")
        assert note.endswith('pip install "flexstage[explore]"')


def test_what_cannot_be_drawn_is_said_and_the_rest_is_written(run, tmp_path):
    words = "sweep", "parallelogram", *SPACING, "--of", "ratio", "--folder", "out"
    status, out, _ = run(*words, "--figure", "a.png")
    assert status == 0
    assert "note: a.png was not written: no figure of the sweep varies" in out
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "sweep.csv",
        "sweep.json",
        "sweep.parquet",
    ]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["parallelogram"],
            'name a parameter and its range, such as --over "leg.notch.neck_thickness=0.',
        ),
        (["parallelogram", "--over", "leg_spacing"], "is not a range of a parameter"),
        (["parallelogram", "--over", "spacing=1..2 mm"], "has no parameter 'spacing'"),
        (["parallelogram", *NECK, "--of", "beauty.x"], "there is no figure 'beauty.x'"),
        (["parallelogram", *NECK, "--plan", "gridd"], "did you mean 'grid'?"),
        (["parallelogram", *NECK, "--model", "liquid"], "'--model': must be lumped"),
        (["parallelogram", *NECK, "--indices", "--plan", "grid"], "omit the plan"),
        (["parallelogram", *NECK, "--indices", "--samples", "9"], "16 or more base samples, got 9"),
        (["parallelogram", "--over", "leg_spacing=5..8 mm"], "stages are impossible"),
        (["nowhere.yaml", *NECK], "no built-in design and no file is called 'nowhere.yaml'"),
        (["part.dxf", *NECK], "is a drawing, whose dimensions are fixed"),
        (["parallelogram", *NECK, "--samples", "0"], "'--samples'"),
    ],
)
def test_bad_input_is_one_sentence(run, words, sentence):
    status, out, err = run("sweep", *words, "--quiet")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert sentence in err


@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_sweep_goes_on(run, tmp_path, monkeypatch):
    words = "sweep", "parallelogram", *NECK, "--of", "frequency", "--folder", "out", "--json"
    words = *words, "--workers", "1"
    whole = json.loads(run(*words)[1])["columns"]
    compute, numbers = Job.compute, []

    def interrupted(job, number):
        numbers.append(number)
        if len(numbers) == 3:
            raise KeyboardInterrupt
        return compute(job, number)

    monkeypatch.setattr(Job, "compute", interrupted)
    assert run(*words)[0] == 130
    kept = sorted((tmp_path / "out" / "unfinished").iterdir())
    assert len(kept) == 3
    # a wrong word takes nothing away
    assert run(*words[:-1], "0")[0] == 2
    assert sorted((tmp_path / "out" / "unfinished").iterdir()) == kept
    status, out, _ = run(*words)
    assert status == 0
    assert numbers == [0, 1, 2, 2, 3]
    assert json.loads(out)["columns"] == whole
    assert not (tmp_path / "out" / "unfinished").exists()


def test_a_refused_sweep_leaves_nothing(run, tmp_path):
    run("sweep", "parallelogram", "--over", "leg_spacing=5..8 mm/3", "--folder", "out", "--quiet")
    assert [path for path in tmp_path.rglob("*") if path != tmp_path / "out"] == []
