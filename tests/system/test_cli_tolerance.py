"""The command `flexstage tolerance`: what it prints, writes and refuses.

Evidence (Stages, tolerances, designs): killed runs; one, two, four workers: identical,
*consistency* [*slow*]
"""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.progress import listen
from flexstage.cli import main
from flexstage.report.figures.distributions import draw_spreads
from flexstage.stage import stage_to_text
from flexstage.stage.designs import design
from flexstage.studies.explore import open_workers
from flexstage.studies.explore.family import known_figures
from flexstage.studies.explore.figures import Figure, Requirement, default_figures
from flexstage.studies.explore.prepare import scatter_of
from flexstage.studies.explore.tolerance import tolerance
from flexstage.virtual.imperfections import Scatter

FREQUENCY = Figure(quantity="natural_frequency_hz", axis="x")
QUICK = ("parallelogram", "--samples", "600", "--model", "lumped", "--quiet")


def run(capsys, *words):
    with pytest.raises(SystemExit) as end:
        main(["tolerance", *words])
    out, err = capsys.readouterr()
    return end.value.code, out, err


def test_it_tells_spread_yield_and_what_to_tighten(capsys, tmp_path):
    words = ("--require", "natural_frequency.x >= 190 Hz", "--require", "stress.x <= 103 MPa")
    code, out, _ = run(
        capsys, *QUICK, *words, "--target-yield", "95 %", "--every-sample",
        "--folder", str(tmp_path / "lot"),
    )  # fmt: skip
    assert code == 0
    assert "parallelogram: 600 simulated parts." in out
    assert "all necks (wire offset)" in out
    assert "natural_frequency.x >= 190 Hz" in out
    assert "stages are good" in out
    found = json.loads((tmp_path / "lot" / "tolerance.json").read_text())
    assert [y["required"] for y in found["yields"]][-1] == "all"
    assert found["tighten"]["reached"]
    assert found["tighten"]["yields"][-1]["low"] >= 0.95
    with (tmp_path / "lot" / "samples.csv").open() as file:
        rows = list(csv.reader(file))
    assert len(rows) == 601
    column = rows[0].index("natural_frequency.x [Hz]")
    mean = sum(float(row[column]) for row in rows[1:]) / 600
    spread = next(f for f in found["figures"] if f["name"] == "natural_frequency.x")
    assert mean == pytest.approx(spread["mean"], rel=1e-12)
    assert sorted(p.name for p in (tmp_path / "lot").iterdir()) == [
        "figures.svg", "samples.csv", "shares.svg", "tolerance.html", "tolerance.json",
    ]  # fmt: skip
    page = (tmp_path / "lot" / "tolerance.html").read_text()
    assert "parallelogram: tolerance analysis" in page
    assert page.count("<svg") == 2


@pytest.mark.usefixtures("undrawn")
def test_what_is_not_known_is_not_written(capsys, tmp_path):
    code, out, err = run(
        capsys, "parallelogram", "--samples", "7", "--model", "lumped", "--quiet",
        "--folder", str(tmp_path / "few"),
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "the 95 % range needs at least 40 samples" in out
    row = next(line for line in out.splitlines() if "Natural frequency" in line)
    assert row.split()[-6:-3] == ["194", "–", "–"]
    assert "needs at least 40 samples" in (tmp_path / "few" / "tolerance.html").read_text()


@pytest.mark.usefixtures("undrawn")
def test_changes_and_shares_have_the_same_decimals_in_each_figure(capsys, tmp_path):
    code, out, _ = run(
        capsys, *QUICK, "--of", "natural_frequency.x", "--of", "stroke.x", "--scatter",
        "stroke=5 %", "--folder", str(tmp_path / "lot"),
    )  # fmt: skip
    assert code == 0
    page = (tmp_path / "lot" / "tolerance.html").read_text()
    assert not re.search(r"\de\+\d+ ?%", out + page)
    table = out[out.index("Contributions to the scatter") :]
    changes = re.findall(r"-?\d+\.(\d+) Hz", table)
    assert len(changes) > 1
    assert {len(decimals) for decimals in changes} == {2}


def test_all_numbers_of_a_row_have_the_same_decimals(capsys):
    # the ratio of a guide is 1 but for some parts in a million
    _, out, _ = run(capsys, *QUICK, "--of", "ratio", "--of", "frequency", "--of", "mass")
    for label, least in (("Transmission ratio", 7), ("Natural frequency", 1), ("Mass", 1)):
        line = next(line for line in out.splitlines() if line.strip().startswith(label))
        numbers = re.findall(r" (-?\d+(?:\.\d+)?)(?= )", line)[:4]
        decimals = {len(number.partition(".")[2]) for number in numbers}
        assert len(numbers) == 4
        assert len(decimals) == 1
        assert decimals.pop() >= least


@pytest.mark.usefixtures("undrawn")
def test_a_stage_that_misses_what_is_required_has_no_table_of_tolerances(capsys, tmp_path):
    code, out, _ = run(
        capsys, *QUICK, "--require", "natural_frequency.x >= 250 Hz", "--target-yield", "90 %",
        "--folder", str(tmp_path / "lot"),
    )  # fmt: skip
    assert code == 0
    assert "the nominal stage does not meet natural_frequency.x" in out
    page = (tmp_path / "lot" / "tolerance.html").read_text()
    assert "change the stage" in page
    assert "Least expensive scatter" not in out + page


def test_the_share_that_is_done_is_that_of_the_batches(monkeypatch):
    monkeypatch.setattr(sys.modules["flexstage.studies.explore.tolerance"], "BATCH", 100)
    heard = []
    with listen(lambda what, done: heard.append((what, done))):
        tolerance(design("parallelogram"), figures=[FREQUENCY], samples=800, model="lumped")
    found = [
        (int(m[1]) / 8, done)
        for what, done in heard
        if (m := re.match(r"tolerance, (\d) of 8 batches", what))
    ]
    assert len(found) == 9
    assert all(share == done for share, done in found)


def test_what_is_rounding_has_neither_shares_nor_a_picture():
    # the three legs of this stage are alike: what one axis does to another is rounding
    coupling = Figure(quantity="cross_coupling", axis="x")
    study = tolerance(
        design("three-rrr"), figures=[coupling, FREQUENCY], samples=150, model="lumped"
    )
    assert [spread.constant for spread in study.spreads] == [True, False]
    told = {shares.figure for shares in study.shares}
    assert coupling not in told
    assert FREQUENCY in told
    titles = [axes.get_title("left") for axes in draw_spreads(study).axes]
    assert titles == ["Natural frequency x [Hz]"]
    # limits a little beyond the lot are drawn, and one far away is not
    edges = study.spreads[1].edges
    width = edges[-1] - edges[0]
    for low, high, drawn in ((0.5, 0.5, 2), (0.5, 5.0, 1), (-0.2, -0.2, 2)):
        limits = Requirement(
            figure=FREQUENCY, low=edges[0] - low * width, high=edges[-1] + high * width
        )
        limited = replace(study, yields=(SimpleNamespace(requirement=limits),))
        axes = draw_spreads(limited).axes[0]
        assert sum(line.get_linestyle() == "-" for line in axes.lines) == drawn
    (alone,) = tolerance(
        design("three-rrr"), figures=[coupling], samples=150, model="lumped"
    ).spreads
    assert alone.constant
    assert draw_spreads(replace(study, spreads=(alone,))).axes


def test_json_is_one_object_and_the_seed_makes_the_lot(capsys):
    one, again, other = (
        json.loads(run(capsys, *QUICK, "--of", "stress.x", "--seed", seed, "--json")[1])
        for seed in ("3", "3", "4")
    )
    assert one["figures"] == again["figures"]
    assert one["figures"][0]["mean"] != other["figures"][0]["mean"]
    assert [f["name"] for f in one["figures"]] == ["max_stress.x"]
    assert one["scatter"]["neck_common"] == Scatter().neck_common


def test_a_scatter_is_read_in_order():
    found = scatter_of(["*=0", "neck_*=1.5 um", "neck_own=2 um", "modulus=0.4 %", "stroke=0.02"])
    assert found == Scatter(
        neck_common=1.5e-6, neck_own=2e-6, radius=0.0, position=0.0, thickness=0.0, modulus=0.004,
        density=0.0, temperature=0.0, stroke=0.02, drive=0.0,
    )  # fmt: skip
    assert scatter_of(["temperature=2 K"]).temperature == 2.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--scatter", "nck_own=2 um"), "did you mean 'neck_own'"),
        (("--scatter", "neck_own"), "needs a name and a value"),
        (("--scatter", "neck_own=2"), "no unit"),
        (("--scatter", "modulus=much"), "expected a share"),
        (("--scatter", "neck_own=-1 um"), "scatter of neck_own must be 0 or more"),
        (("--scatter", "neck_own=3 mm"), "reduce the scatter"),
        (("--target-yield", "99 %"), "needs at least one --require"),
        (("--require", "stress.x <= 200 MPa", "--target-yield", "much"), "expected a share"),
        (("--require", "stress.x <= 200 MPa", "--target-yield", "100 %"), "between 0 and 100 %"),
        (("--require", "stress.x <= 200 MPa", "--target-yield", "99"), 'write "99 %"'),
        (("--require", "stress.x <= 200 MPa", "--target-yield", "99.9 %"), "use 3688 or more"),
        (("--require", "stress.z <= 200 MPa"), "stress.x"),
        (("--require", "stress.x"), "is not a requirement"),
        (("--of", "colour.x"), "there is no figure 'colour.x'"),
        (("--of", "drive_force.x"), "there is no figure 'drive_force.x' here"),
        (("--every-sample",), "give a --folder"),
        (("--samples", "1"), "--samples"),
        (("--model", "plane"), "superelement or lumped"),
        (("--cost", "modulus=2", "--require", "stress.x <= 1 GPa"), "--cost needs --target-yield"),
    ],
)  # fmt: skip
def test_what_it_cannot_do_is_one_sentence(capsys, words, said):
    code, out, err = run(capsys, *QUICK, *words)
    assert code == 2
    assert out == ""
    assert said in err
    assert err.count("\n") == 1


def test_a_stage_without_axes_has_no_figures(capsys, tmp_path):
    file = tmp_path / "bare.yaml"
    file.write_text(stage_to_text(replace(design("parallelogram"), axes=())))
    for words in ((), ("--of", "smallest_slot"), ("--require", "stress.x <= 90 MPa")):
        code, out, err = run(capsys, str(file), *QUICK[1:], *words)
        assert (code, out) == (2, "")
        assert "the stage has no axes" in err
        assert "add 'axes' to the stage file" in err
        assert err.count("\n") == 1


def test_a_stage_of_more_drives_than_axes_is_told_what_a_lot_leaves_out(capsys, tmp_path):
    stage = design("three-rrr")
    file = tmp_path / "redundant.yaml"
    file.write_text(stage_to_text(replace(stage, axes=stage.axes[:2])))
    told = "this stage has more drives than axes"
    code, out, _ = run(capsys, str(file), *QUICK[1:], "--json")
    found = json.loads(out)
    assert code == 0
    assert [figure["name"] for figure in found["figures"]] == ["max_stress"]
    assert any(note.startswith(told) for note in found["notes"])
    assert told not in run(capsys, "three-rrr", *QUICK[1:], "--of", "stress.x")[1]
    code, out, err = run(capsys, str(file), *QUICK[1:], "--of", "stroke.x")
    assert (code, out) == (2, "")
    assert "there is no figure 'stroke.x' here" in err


def test_a_figure_without_its_axis_is_that_of_every_axis(capsys):
    _, out, _ = run(
        capsys, "vgtu-piezo", "--samples", "9", "--model", "lumped", "--of", "frequency", "--json"
    )
    names = [figure["name"] for figure in json.loads(out)["figures"]]
    assert names == ["natural_frequency.x", "natural_frequency.y"]


@pytest.mark.usefixtures("undrawn")
def test_the_page_says_what_the_description_is_and_no_other_claim_of_it(capsys, tmp_path):
    run(
        capsys, "vgtu-piezo", "--samples", "9", "--model", "lumped", "--of", "frequency",
        "--quiet", "--folder", str(tmp_path),
    )  # fmt: skip
    page = (tmp_path / "tolerance.html").read_text()
    first, *others = design("vgtu-piezo").notes
    assert first in page
    assert len(others) > 3
    assert not any(note in page for note in others)


@pytest.mark.slow
def test_one_and_four_workers_give_the_same_bits(monkeypatch):
    monkeypatch.setattr("flexstage.studies.explore.workers._FIRST_ESTIMATE", 0.0)
    monkeypatch.setattr("flexstage.studies.explore.workers._WORTH_SHARING", 0.0)
    stage = design("vgtu-piezo")
    figures = default_figures(known_figures(stage))
    lots = []
    for count in (1, 4):
        with open_workers(count) as workers:
            lots.append(
                tolerance(
                    stage, figures=figures, samples=20_100, seed=7, model="lumped", workers=workers
                )
            )
    assert np.array_equal(lots[0].values, lots[1].values)
    # and the first of them are those of a small lot, in another batch
    few = tolerance(stage, figures=figures, samples=123, seed=7, model="lumped")
    assert few.values == pytest.approx(lots[0].values[:123], rel=1e-10, abs=1e-12)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_from_what_is_there(tmp_path):
    words = [
        sys.executable, "-m", "flexstage", "tolerance", "vgtu-piezo", "--samples", "30000",
        "--model", "lumped", "--json", "--workers", "1", "--folder",
    ]  # fmt: skip

    def figures(folder):
        done = subprocess.run([*words, folder], capture_output=True, check=True, text=True)
        return json.loads(done.stdout)["figures"]

    whole = figures(tmp_path / "whole")
    batches = tmp_path / "broken" / "unfinished"
    process = subprocess.Popen(
        [*words, tmp_path / "broken"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 300.0
    while len(list(batches.glob("batch-*.npz"))) < 4 and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    kept = {p.name: p.stat().st_mtime_ns for p in batches.glob("batch-*.npz")}
    assert 4 <= len(kept) < 12
    assert figures(tmp_path / "broken") == whole
    assert not batches.exists()
