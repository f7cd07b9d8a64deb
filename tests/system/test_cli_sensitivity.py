"""The command `flexstage sensitivity`: what it prints, writes and refuses."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.quantities.table import Picture
from flexstage.report.figures.sensitivity import draw_moving_necks, draw_sensitivities
from flexstage.report.page import draw_picture, typeset
from flexstage.report.sensitivity import sensitivity_table
from flexstage.stage.designs import StageTemplate
from flexstage.studies.explore.family import Family, known_figures
from flexstage.studies.explore.figures import default_figures, figures_of
from flexstage.studies.explore.sensitivity import hinge_variables, sensitivities, variables_by


def said(capsys: pytest.CaptureFixture[str], *words: object, status: int = 0) -> str:
    with pytest.raises(SystemExit) as end:
        main(["sensitivity", *map(str, words), "--quiet"])
    assert int(end.value.code or 0) == status
    printed = capsys.readouterr()
    return printed.err if status else printed.out


def test_the_table_has_what_moves_most_at_the_top(capsys: pytest.CaptureFixture[str]) -> None:
    printed = said(capsys, "parallelogram", "--of", "frequency", "--of", "stress.x")
    rows = [line.split() for line in printed.splitlines() if re.search(r"[+-]\d+\.\d\d", line)]
    assert [row[0] for row in rows[:3]] == [
        "leg.notch.neck_thickness",
        "actuator.travel",
        "leg.bar_length",
    ]
    # thickness of the neck, frequency, stress
    assert rows[0][1:] == ["0.5", "mm", "+1.21", "+0.49"]
    assert "base_height" in printed.partition("have no effect")[0].rpartition("+")[2]
    assert "leg.notch.kind" in printed
    assert "it is a choice" in printed
    assert "note: figures by the lumped model" in printed
    assert "--model superelement gives those" in printed.replace("\n", " ")


def test_changes_by_a_length_in_the_units_of_the_figures(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ("parallelogram", "--by", "leg.notch.neck*", "--of", "frequency", "--per", "10 um")
    printed = said(capsys, *words, "--units")
    assert "+10 µm of each length" in printed.replace("\n", " ")
    # 1.21 % of 193.7 Hz for 1 % of 0.5 mm: twice that for 10 um
    assert float(re.findall(r"\+(\d+\.\d+)", printed)[-1]) == pytest.approx(4.68, abs=0.05)


def test_files_and_json_have_slopes_and_parts(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, figure = tmp_path / "out", tmp_path / "map.png"
    words = ("parallelogram", "--set", "leg_spacing=35 mm", "--by", "leg_*", "--by", "thickness")
    printed = said(capsys, *words, "--folder", folder, "--figure", figure, "--json")
    found = json.loads(printed)
    assert [p["name"] for p in found["parameters"]] == ["leg_spacing", "thickness"]
    assert found["parameters"][0]["value"] == pytest.approx(0.035)
    k = [f["name"] for f in found["figures"]].index("natural_frequency.x")
    slope, part = (found["parameters"][0][key][k] for key in ("slopes", "elasticities"))
    assert part == pytest.approx(slope * 0.035 / found["figures"][k]["value"])
    assert found["parameters"][0]["changes"][k] == pytest.approx(slope * 0.01 * 0.035)
    assert sorted(path.name for path in folder.iterdir()) == [
        "sensitivity.csv",
        "sensitivity.json",
        "sensitivity.svg",
    ]
    assert (
        json.loads((folder / "sensitivity.json").read_text())["parameters"] == found["parameters"]
    )
    with (folder / "sensitivity.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert float(lines[0]["d natural_frequency.x [Hz] / d parameter"]) == pytest.approx(slope)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert len(found["files"]) == 4


def test_hinges_alike_share_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    printed = said(capsys, "parallelogram", "--hinges", "--by", "*.neck", "--of", "frequency")
    assert re.search(r"left-lower\.neck \(×\d\)", printed)
    words = " ".join(printed.split())
    assert "for +10 µm of each length" in words
    assert "of all other parameters" not in words
    # which no other model moves
    assert "note: figures by the lumped model" in printed
    assert "--model" not in printed
    found = json.loads(
        said(capsys, "parallelogram", "--hinges", "--by", "left*", "--of", "frequency", "--json")
    )
    named = [name for p in found["parameters"] for name in p["equivalent"]]
    assert sorted(named) == sorted(
        f"left-{end}.{part}" for end in ("lower", "upper") for part in ("neck", "along", "across")
    )


def test_axes_of_one_frequency_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--by", "notch.neck*", "--of", "frequency")
    printed = said(capsys, "three-rrr", *words)
    told = "natural_frequency.x and natural_frequency.y are equal"
    assert printed.count("are equal") == 1
    assert told in printed
    assert told not in said(capsys, "vgtu-piezo", "--by", "x.leg_neck", "--of", "frequency")


def test_necks_stand_on_the_drawing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    said(capsys, "parallelogram", "--hinges", "--folder", tmp_path / "all")
    assert "Natural frequency x" in (tmp_path / "all" / "necks.svg").read_text()
    said(capsys, "parallelogram", "--hinges", "--by", "*.along", "--folder", tmp_path / "along")
    assert not (tmp_path / "along" / "necks.svg").exists()
    template = StageTemplate.of("vgtu-piezo")
    figures = figures_of(["frequency"], known_figures(template.stage()))
    found = sensitivities(hinge_variables(template, ["*.neck"]), figures)
    panel = draw_moving_necks(template.stage(), found).axes[0]
    widest = max(panel.lines, key=lambda disc: disc.get_markersize())
    # the levers' fulcra are the necks that the first frequency hangs on
    places = [tuple(1e3 * c for c in template.stage().hinge(f"xlko-{s}").at) for s in "ud"]
    at = np.asarray(widest.get_xydata())[0]
    assert any(at == pytest.approx(place) for place in places)
    with pytest.raises(ModelError, match="nothing to draw"):
        draw_moving_necks(template.stage(), replace(found, slopes=0.0 * found.slopes))


@pytest.mark.slow
def test_superelements_say_much_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("parallelogram", "--by", "leg.*", "--of", "frequency", "--json")
    both = [json.loads(said(capsys, *words, "--model", m)) for m in ("lumped", "superelement")]
    rigid, bending = ([p["elasticities"][0] for p in found["parameters"]] for found in both)
    assert rigid == pytest.approx(bending, abs=0.02)
    ways = [found["provenance"]["settings"]["slopes"] for found in both]
    assert ways[0].startswith("analytic derivatives")
    assert ways[1].startswith("difference quotients")
    printed = said(capsys, *words[:-1], "--model", "superelement")
    assert "note: slopes are difference quotients" in printed
    assert "lumped model" not in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("parallelogram", "--of", "beauty"), "there is no figure 'beauty'"),
        (("parallelogram", "--by", "leg_spasing"), "did you mean 'leg_spacing'"),
        (("parallelogram", "--by", "material"), "no parameter that changes continuously"),
        (("parallelogram", "--hinges", "--by", "middle"), "no hinge 'middle'"),
        (("parallelogram", "--hinges", "--model", "plane"), "--hinges needs --model lumped"),
        (("parallelogram", "--per", "2 s"), "length"),
        (("parallelogram", "--model", "wood"), "'--model': must be lumped"),
        (("nothing-like-it",), "no built-in design and no file"),
    ],
)
def test_refusals(words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert message in said(capsys, *words, status=2)


def test_the_picture_shows_the_numbers_of_the_table() -> None:
    template = StageTemplate.of("three-rrr")
    variables, _ = variables_by(template)
    figures = default_figures(known_figures(template.stage()))
    found = sensitivities(Family(template=template, variables=variables), figures)
    rows = sensitivity_table(found).rows[1:]
    shown = {typeset(cell.text) for row in rows for cell in row[2:]}
    for figure in (
        draw_sensitivities(found),
        draw_picture(Picture(result=found, title="", caption="")),
    ):
        texts = {text.get_text() for text in figure.axes[0].texts}
        assert texts == shown
