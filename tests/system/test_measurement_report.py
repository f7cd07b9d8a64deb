"""Reports of what was measured: one file, whole, and with the numbers of the results."""

import functools
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.cli.characterise import print_measurement
from flexstage.cli.output import console
from flexstage.experiments.campaign.plan import read_campaign
from flexstage.experiments.campaign.results import evaluate
from flexstage.experiments.virtual_campaign import virtual_campaign
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.quantity import display
from flexstage.quantities.table import Table
from flexstage.report import report_html
from flexstage.report.measurement import measurement_text
from flexstage.report.study_sections import bench_section
from flexstage.stage.designs import design
from flexstage.studies import compare_measurement, results_json, run_study
from flexstage.studies.measurement import compare_with_references
from flexstage.virtual.as_built import as_built
from flexstage.virtual.laboratory import Laboratory
from tests.result_schema import require_valid
from tests.studies import sections_of
from tests.system.test_report import Page

#: A shorter campaign than the usual one: what is read of it matters here, not how sharply.
BENCH = ("measured", "virtual", "centring")
LAB = Laboratory(cycles=4, samples=120, hold=1024, levels=8, per_level=40, hits=3, repeats=3)


class Tables(HTMLParser):
    """Cells of every row, by the section that they stand in."""

    def __init__(self, text):
        super().__init__()
        self.rows = []
        self.sections = {}
        self._section = ""
        self._row = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "section":
            self._section = dict(attrs)["id"]
        elif tag == "tr":
            self._row = []
            self.sections.setdefault(self._section, []).append(self._row)
        elif tag in ("td", "th") and self._row is not None:
            self._row.append("")

    def handle_data(self, data):
        if self._row:
            self._row[-1] += data

    def handle_endtag(self, tag):
        if tag == "table":
            self._row = None


def as_measured(found):
    """The same figures as of a real stage, which are compared with models and publications."""
    return replace(found, origin="measured")


@functools.cache
def campaign(stage):
    return virtual_campaign(as_built(stage, seed=4), laboratory=LAB, seed=4)


def characterised(stage, kinds=None):
    made = campaign(stage)
    kept = tuple(t for t in made.campaign.tests if kinds is None or t.test in kinds)
    return evaluate(
        replace(made.campaign, tests=kept), lambda test: [made.records[n] for n in test.records]
    )


@pytest.fixture(
    scope="module",
    params=["vgtu-mechanical", pytest.param("vgtu-piezo", marks=pytest.mark.slow)],
)
def result(request):
    stage = design(request.param)
    return compare_measurement(as_measured(characterised(stage)), stage, ("lumped",))


def thinned(found, keep=()):
    """The same results with the pictures of the first test of every kind, or of kinds to keep."""
    seen, results = set(), []
    for r in found.results:
        drawn = r.test.test in keep or r.test.test not in seen
        results.append(r if drawn else replace(r, details={}))
        seen.add(r.test.test)
    return replace(found, results=tuple(results))


@pytest.fixture(scope="module")
def page(result):
    # both axes of one kind, whose pictures must not get one id
    return measurement_text(
        replace(result, characterisation=thinned(result.characterisation, keep=("motion",)))
    )


def loads_nothing(text):
    parsed = Page(text)
    assert not parsed.loads
    assert "http://" not in text
    assert "https://" not in text
    assert not re.search(r"url\((?!#)", text)
    assert "default-src 'none'" in text
    assert len(parsed.ids) == len(set(parsed.ids)), "an id stands twice in the page"
    assert set(parsed.references) <= set(parsed.ids)
    return parsed


def test_the_page_is_whole_and_loads_nothing(result, page):
    parsed = loads_nothing(page)
    wanted = {"figures", "motion", "workspace", "response", "standing", "budgets"}
    assert wanted <= set(parsed.ids)
    assert "virtual measurement: simulated data, not measured" in page
    assert len(page.encode()) < 5e6
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.S).lower().split()


def numeral(text):
    return float(text.replace("−", "-"))


def test_numbers_of_the_table_are_those_of_the_results(result, page):
    rows = Tables(page).sections["figures"][2:]
    results = result.to_dict()["characteristics"]
    assert len(rows) == len(results)
    for cells, one in zip(rows, results, strict=True):
        shown = display(one["quantity"])
        assert cells[0].startswith(shown.label)
        assert cells[1] == one["axis"]
        unit = re.search(r"\[(.*)\]", cells[0])
        steps = (
            "µnp".index(unit[1][0]) - "µnp".index(shown.shown_unit[0])
            if unit and (unit[1] != shown.shown_unit)
            else 0
        )
        factor = shown.factor * 1e3**steps
        half = 0.5 * factor * (one["interval"][1] - one["interval"][0])
        # to the second digit of its uncertainty
        assert numeral(cells[2]) == pytest.approx(factor * one["value"], abs=0.051 * half)
        assert numeral(cells[3]) == pytest.approx(half, rel=0.06)
        for cell, origin in zip(cells[4:], result.references, strict=True):
            given = one["differences"].get(origin)
            if given is None:
                assert cell == "–"
                continue
            assert cell.endswith("*") == bool(given["significant"])
            reference = given["reference"]
            if one["quantity"] == "parasitic_rotation":
                # a range has no sign, what a model gives has one
                reference = abs(reference)
            assert given["difference"] == pytest.approx(one["value"] - reference, abs=1e-18)
            if given["percent"] is not None and abs(given["percent"]) < 1e4:
                printed = re.search(r"([+−]\d+\.\d\d) %", cell)
                assert printed is not None, cell
                assert numeral(printed[1]) == pytest.approx(given["percent"], abs=0.006)


def test_budgets_add_up(result, page):
    rows = Tables(page).sections["budgets"]
    names = rows[0][4:]
    assert {"calibration", "alignment"} <= set(names)
    for cells, one in zip(rows[1:], result.to_dict()["characteristics"], strict=True):
        shares = {n: numeral(c) for n, c in zip(names, cells[4:], strict=True) if c}
        total = sum(c["uncertainty"] ** 2 for c in one["budget"])
        assert one["uncertainty"] == pytest.approx(np.sqrt(total), rel=1e-9)
        assert sum(shares.values()) == pytest.approx(100.0, abs=0.51 * len(shares))
        assert set(shares) == {c["name"] for c in one["budget"]}


def test_results_are_plain_data(result):
    results = result.to_dict()
    assert set(results) == {"stage", "origin", "characteristics", "tests", "sources", "notes"}
    assert json.loads(json.dumps(results, allow_nan=False)) == results
    kinds = {t["kind"] for t in results["tests"]}
    assert {"staircase", "hold", "response", "workspace"} < kinds
    for one in results["characteristics"]:
        assert one["interval"][0] <= one["value"] <= one["interval"][1]


def test_words_of_files_cannot_break_the_page(result):
    found = result.characterisation
    tricky = replace(found, notes=('<b>bold & "quoted"</b>',))
    first = found.results[0]
    named = replace(first, test=replace(first.test, name="<i>'m'"), notes=("a <script> b",))
    # with the pictures of one test
    quiet = [replace(r, details={}) for r in found.results[2:]]
    tricky = replace(tricky, results=(named, replace(found.results[1], details={}), *quiet))
    text = measurement_text(replace(result, characterisation=tricky))
    loads_nothing(text)
    assert "<b>bold" not in text
    assert "a <script>" not in text
    assert "<i>'m'" not in text


def test_a_model_that_cannot_be_made_is_left_out(monkeypatch, result):
    from flexstage.base.errors import ModelError
    from flexstage.studies import models

    def fail(stage, wanted):
        raise ModelError("no such notch")

    monkeypatch.setattr(models, "MODELS", {**models.MODELS, "plane": fail})
    found = compare_measurement(result.characterisation, result.stage, ("lumped", "plane"))
    assert found.skipped_models == {"plane": "no such notch"}
    assert "the plane model was skipped: no such notch" in found.notes
    with pytest.raises(ModelError, match="is unknown"):
        compare_measurement(result.characterisation, result.stage, ("lumped", "plain"))


@pytest.fixture(scope="module")
def study():
    stage = design("vgtu-piezo")
    found = characterised(stage, kinds=("motion",))
    real = replace(found, origin="measured", notes=("bench 7",))
    return run_study(stage, model=("lumped",), measured=real, parts="virtual", seed=2)


@pytest.fixture(scope="module")
def study_page(study):
    # one picture of the real stage beside those of the simulated one
    less = replace(study, measured=thinned(study.measured))
    return sections_of(less, *BENCH)


@pytest.mark.slow
def test_the_whole_report_of_a_study_loads_nothing(study, study_page):
    page = report_html(study)
    assert {"measured", "virtual", "centring", "drawing"} <= set(loads_nothing(page).ids)


def test_a_study_shows_what_was_measured_and_what_is_virtual(study, study_page):
    parsed = Page(study_page)
    # pictures of both measurements stand in one page
    assert len(parsed.ids) == len(set(parsed.ids))
    assert {"measured", "virtual", "centring"} <= set(parsed.ids)
    virtual = study_page[study_page.index('<section id="virtual">') :]
    assert "Simulated, not measured:" in virtual[:2000]
    assert "bench 7" in study_page
    rows = {(r.quantity, r.axis, r.origin): r for r in study.characteristics}
    row = rows["output_displacement", "x", "measured"]
    figure = study.measured.figure("output_displacement", "x").estimate
    assert (row.value, row.uncertainty) == (figure.value, figure.uncertainty)
    # the virtual ones are no row of the table of the stage
    assert "virtual" not in {r.origin for r in study.characteristics}
    # nothing is compared with itself
    heads = Tables(study_page).sections["measured"][1]
    assert "measured" in heads  # the published one
    assert sum("measured" in h for h in heads) == 1


def test_a_simulated_measurement_is_compared_with_nothing(result):
    found = replace(result.characterisation, origin="virtual")
    quiet = replace(found, results=tuple(replace(r, details={}) for r in found.results))
    text = measurement_text(compare_measurement(quiet, result.stage, ("lumped",)))
    rows = Tables(text).sections["figures"]
    assert rows[0] == ["", "", "simulated measurement"]
    assert {len(cells) for cells in rows[1:]} == {5}
    assert "measured here" not in text
    assert " *" not in re.sub(r"<(style|script)>.*?</\1>", "", text, flags=re.S)


def test_half_a_page_on_the_simulated_measurement_is_in_the_report(study, study_page):
    section = re.search(r'<section id="virtual">(.*?)</section>', study_page, flags=re.S)[1]
    rows = Tables(section).sections[""]
    assert [cells[0] for cells in rows][1] == "Output displacement [µm]"
    figure = next(
        r.figure for r in study.virtual.rows if r.figure.quantity == "output_displacement"
    )
    value = numeral(rows[1][1].split(" ± ")[0])
    assert value == pytest.approx(1e6 * figure.estimate.value, abs=1e-3)
    # the resonance with the published frequency beside it
    assert "published, measured: 337 Hz" in section
    assert 'href="virtual-measurement.html"' in section


def test_a_virtual_campaign_that_joins_a_study_is_not_its_own_reference(study):
    found = replace(study.measured, origin="virtual")
    found = replace(found, results=tuple(replace(r, details={}) for r in found.results))
    section = sections_of(replace(study, measured=found), "measured")
    heads = Tables(section).sections["measured"][1]
    assert "virtual" not in " ".join(heads)


def test_sections_that_were_not_asked_for_are_empty(study):
    bare = replace(study, measured=None, virtual=None, centring=None)
    assert sections_of(bare, *BENCH).strip() == ""


def test_results_of_a_study(study):
    results = json.loads(results_json(study.to_dict()))
    virtual = results["virtual_measurement"]
    assert virtual["origin"] == "virtual"
    assert {c["quantity"] for c in virtual["characteristics"]} > {"straightness", "workspace_area"}
    centring = results["centring"]
    assert centring["kind"] == "virtual experiment"
    assert centring["reached"] is True
    assert 0.0 <= centring["residual"] < 1e-7
    first, last = centring["steps"][0], centring["steps"][-1]
    assert first["length"] > 4e-5
    assert last["length"] < 2e-7
    assert sum(r["origin"] == "measured" for r in results["characteristics"]) == 22
    origins = {r["origin"] for r in results["characteristics"]}
    assert "virtual" not in origins


@pytest.mark.slow
def test_a_stage_of_one_axis_says_why_no_scale_is_centred():
    made = run_study(design("parallelogram"), model=("lumped",), parts="virtual", seed=3)
    assert isinstance(made.centring, str)
    assert "No scale could be centred: " in sections_of(made, "centring")
    results = made.to_dict()
    assert results["centring"] == {"reason": made.centring}
    require_valid(results, "study")
    assert results["virtual_measurement"]["stage"] == "parallelogram"


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["study", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


QUICK = ("parallelogram", "--model", "lumped", "--parts", "virtual,traditional")


@pytest.mark.usefixtures("undrawn")
def test_measured_files_join_a_study(capsys, tmp_path):
    rng = np.random.default_rng(6)
    s = 1.0 - np.abs(2.0 * (np.arange(801) % 160) / 160 - 1.0)
    data = np.column_stack((120.0 * s, 63.1 * s + 0.004 * rng.standard_normal(s.size)))
    np.savetxt(tmp_path / "x.csv", data, delimiter=",", header="u (V),p (um)", comments="")
    plan = tmp_path / "bench.yaml"
    plan.write_text(
        "campaign: 1\ntests:\n  stroke of x:\n    test: motion\n    axis: x\n"
        "    records: [x.csv]\n    columns: {command: u, along: p}\n"
        "    reading: {sample_rate: 40 Hz}\n"
    )
    out = tmp_path / "out"
    status, text, err = run(
        capsys, *QUICK[:3], "--parts", "traditional", "--measured", plan, "--folder", out, "--json"
    )
    assert (status, err) == (0, "")
    rows = [r for r in json.loads(text)["characteristics"] if r["origin"] == "measured"]
    stroke = next(r for r in rows if r["quantity"] == "output_displacement")
    assert stroke["value"] == pytest.approx(63.1e-6, rel=1e-3)
    assert stroke["uncertainty"] > 0.0
    parsed = loads_nothing((out / "report.html").read_text())
    assert "measured" in parsed.ids
    assert not {"virtual", "centring"} & set(parsed.ids)
    results = json.loads((out / "results.json").read_text())
    assert results["virtual_measurement"] == {}
    assert results["centring"] == {}


def test_a_bad_description_leaves_no_study(capsys, tmp_path):
    plan = tmp_path / "bench.yaml"
    plan.write_text("campaign: 1\ntests: {}\n")
    for path, said in ((plan, "no test"), (tmp_path / "none.yaml", "none.yaml")):
        status, text, err = run(capsys, *QUICK, "--measured", path, "--folder", tmp_path / "out")
        assert (status, text) == (2, "")
        assert said in err
        assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [plan]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["vgtu-piezo", "vgtu-mechanical"])
def test_the_study_of_the_two_stages_has_its_table(capsys, tmp_path, name):
    status, out, err = run(
        capsys,
        name,
        "--model",
        "lumped,superelement",
        "--parts",
        "virtual,traditional",
        "--folder",
        tmp_path,
    )
    assert (status, err) == (0, "")
    claim = {"vgtu-piezo": 17, "vgtu-mechanical": 44}[name]
    assert f"Claim of {claim} % less motion error" in out
    written = sorted(file.name for file in tmp_path.iterdir())
    assert written == ["report.html", "results.json", "virtual-measurement.html"]
    results = json.loads((tmp_path / "results.json").read_text())
    require_valid(results, "study")
    got = {(c["quantity"], c["axis"]): c for c in results["virtual_measurement"]["characteristics"]}
    rows = [r for r in design(name).published if r.origin == "published-measured"]
    count = 0
    for row in rows:
        if (row.quantity, row.axis) in got:
            one = got[row.quantity, row.axis]
            half = 0.5 * (one["interval"][1] - one["interval"][0])
            assert abs(one["value"] - row.value) < 2.0 * half + 2e-4 * row.value, row
            for origin in ("published-analytic", "published-fem", "lumped", "superelement"):
                if origin in one["differences"]:
                    given = one["differences"][origin]
                    assert given["difference"] == pytest.approx(
                        one["value"] - given["reference"], abs=1e-15
                    )
            count += 1
    assert count >= 10
    assert results["centring"]["reached"] is True


def test_a_range_is_compared_with_the_size_of_what_a_model_gives(result):
    from dataclasses import replace as changed

    from flexstage.quantities.characteristic import Characteristic, Characteristics
    from flexstage.studies.measurement import compare_with_references

    row = next(r for r in result.rows if r.figure.quantity == "parasitic_rotation")
    value = row.figure.estimate.value
    model = Characteristic(
        quantity="parasitic_rotation", axis=row.figure.axis, origin="solid", value=-2.0 * value,
        unit="rad",
    )  # fmt: skip
    for given in (model, changed(model, value=2.0 * value)):
        beside = compare_with_references(
            result.characterisation, result.stage, Characteristics((given,))
        )
        found = next(r for r in beside.rows if r.figure == row.figure).differences["solid"]
        assert found.percent == pytest.approx(-50.0)


def test_each_figure_of_a_simulated_stage_says_where_it_comes_from(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Published, model, scatter or assumed: in rows, results, pages and the printed table."""
    published = compare_with_references(
        characterised(design("vgtu-mechanical"), kinds=("spheres",)),
        design("vgtu-mechanical"),
        Characteristics(),
    )
    kinds = {row.figure.quantity: row.source_kind for row in published.rows}
    assert kinds["straightness"] == kinds["straightness_out_of_plane"] == "published"
    assert kinds["roll"] == "assumed"
    own = design("parallelogram")
    simulated = characterised(own)
    found = compare_with_references(simulated, own, Characteristics())
    kinds = {row.figure.quantity: row.source_kind for row in found.rows}
    assert all(kinds.values())
    assert {q for q, kind in kinds.items() if kind == "scatter"} == {"roll", "pitch"}
    assert {"straightness", "cross_coupling", "parasitic_rotation"} <= {
        q for q, kind in kinds.items() if kind == "model"
    }
    rows = {r["quantity"]: r for r in found.to_dict()["characteristics"]}
    assert rows["straightness"]["source"] == "model: lumped, over the stroke, with scatter"
    assert rows["straightness_out_of_plane"]["source"] == "assumed: 0.2 % of the stroke"
    require_valid(found.to_dict(), "measurement")
    assert any("path of x over the stroke is that of the lumped model" in n for n in found.notes)
    (table,) = (part for part in bench_section(found, "page") if isinstance(part, Table))
    shown = {row[0].text: row[-1].text for row in table.rows}
    assert shown["Straightness in plane [µm]"].startswith("model: lumped")
    assert shown["Straightness out of plane [µm]"].startswith("assumed")
    assert "assumed: 0.2 % of the stroke" in measurement_text(found)
    print_measurement(console(), found, [])
    (line,) = (x for x in capsys.readouterr().out.splitlines() if "Straightness in plane" in x)
    assert line.split()[-1] == "model"
    # a real stage whose figures are measured has none of it
    real = compare_with_references(as_measured(simulated), own, Characteristics())
    assert not any("source" in row for row in real.to_dict()["characteristics"])


def test_a_description_of_a_simulated_stage_keeps_the_origins(tmp_path: Path) -> None:
    words = "characterise --stage parallelogram --virtual-seed 1 --model lumped --quiet --folder"
    with pytest.raises(SystemExit, match="0"):
        main([*words.split(), str(tmp_path)])
    again = read_campaign(tmp_path / "campaign.yaml")
    assert again.origins["straightness x"] == "model: lumped, over the stroke, with scatter"
