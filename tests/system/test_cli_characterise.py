"""`flexstage characterise`: what it measured it finds again; files of any bench; bad input."""

import json
import re

import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter

from flexstage.cli import main
from flexstage.stage.designs import design
from flexstage.stage.file import stage_to_text
from tests.measuring_files import report
from tests.result_schema import require_valid
from tests.undrawn import undrawn

STROKE = 63.7


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["characterise", *(str(word) for word in words)])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def found(capsys, *words):
    status, out, err = run(capsys, *words, "--json")
    assert (status, err) == (0, ""), err
    return json.loads(out)


def refused(capsys, said, folder, *words):
    before = sorted(folder.rglob("*"))
    status, out, err = run(capsys, *words, "--folder", folder / "made")
    assert (status, out) == (2, ""), err
    assert err.startswith("flexstage: ")
    assert err.count("\n") == 1, "more than one line"
    assert re.search(said, err), err
    assert sorted(folder.rglob("*")) == before, "something was written"


def values(result):
    return {(c["quantity"], c["axis"]): c for c in result["characteristics"]}


@pytest.fixture(
    scope="module", params=["vgtu-piezo", pytest.param("vgtu-mechanical", marks=pytest.mark.slow)]
)
def made(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("virtual")
    words = ("--stage", request.param, "--virtual-seed", "7", "--model", "lumped")
    with undrawn(), pytest.raises(SystemExit) as ended:
        main(["characterise", *words, "--folder", str(folder)])
    assert ended.value.code == 0
    return request.param, folder


def test_files_give_the_figures_that_they_were_made_with(capsys, made):
    stage, folder = made
    first = json.loads((folder / "results.json").read_text())
    require_valid(first, "measurement")
    again = found(capsys, folder / "campaign.yaml", "--model", "lumped")
    assert [c["quantity"] for c in again["characteristics"]] == [
        c["quantity"] for c in first["characteristics"]
    ]
    for a, b in zip(first["characteristics"], again["characteristics"], strict=True):
        # records are written with all digits
        assert b["value"] == pytest.approx(a["value"], rel=1e-9), a["quantity"]
        assert b["uncertainty"] == pytest.approx(a["uncertainty"], rel=1e-6)
        # a simulated figure is compared with nothing
        assert a["differences"] == b["differences"] == {}
        assert a["kind"] == "simulated"
    assert (again["stage"], again["origin"]) == (stage, "virtual")
    # every file that was read is known by its hash; the description itself names the stage
    records = {r for test in again["tests"] for r in test["records"]}
    assert set(again["sources"]) == {str(folder / r) for r in records}
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in again["sources"].values())


def as_of_a_bench(capsys, folder):
    """The figures of the same records, evaluated as if they were of a real bench."""
    description = (folder / "campaign.yaml").read_text()
    assert "origin: virtual" in description
    real = folder / "real.yaml"
    real.write_text(description.replace("origin: virtual", "origin: measured"))
    return values(found(capsys, real, "--model", "lumped"))


def test_what_is_virtual_says_so(made):
    _, folder = made
    results = json.loads((folder / "results.json").read_text())
    assert results["origin"] == "virtual"
    assert results["notes"][0] == "virtual measurement: simulated data, not measured"
    assert (
        "virtual measurement: simulated data, not measured"
        in (folder / "campaign.yaml").read_text()
    )
    assert "virtual measurement" in (folder / "report.html").read_text()


def test_published_measured_figures_come_back(capsys, made):
    stage, folder = made
    measured = as_of_a_bench(capsys, folder)
    rows = [r for r in design(stage).published if r.origin == "published-measured"]
    covered = []
    # what an inverse of the loop leaves is not measured here
    for row in (r for r in rows if (r.quantity, r.axis) in measured):
        figure = measured[row.quantity, row.axis]
        half = 0.5 * (figure["interval"][1] - figure["interval"][0])
        # twice the interval of 95 %: of twenty figures one may lie beside its interval
        assert abs(figure["value"] - row.value) < 2.0 * half + 2e-4 * row.value, row
        covered.append(abs(figure["value"] - row.value) < half + 2e-4 * row.value)
        difference = figure["differences"]["published-measured"]
        assert difference["reference"] == row.value
    assert len(covered) >= 10
    assert np.mean(covered) > 0.75


def test_differences_of_the_piezo_stage_are_those_that_are_printed(capsys, made):
    stage, folder = made
    if stage != "vgtu-piezo":
        pytest.skip("of the piezo stage")
    measured = as_of_a_bench(capsys, folder)

    def percent(quantity, axis, origin):
        return measured[quantity, axis]["differences"][origin]["percent"]

    # the study prints how far the measured stroke is below the other: 2.89 and 6.3 %, 2.13 and
    # 2.87 %; of its own figures 63.12 um is 2.29 % below 64.6 um
    for axis, analytic, elements in (("x", 2.89, 2.29), ("y", 6.3, 2.89)):
        figure = measured["output_displacement", axis]
        spread = 100.0 * (figure["interval"][1] - figure["interval"][0]) / figure["value"]
        near = 0.02 + spread
        assert -percent("output_displacement", axis, "published-analytic") == pytest.approx(
            analytic, abs=near
        )
        assert -percent("output_displacement", axis, "published-fem") == pytest.approx(
            elements, abs=near
        )
        assert figure["differences"]["published-analytic"]["significant"] is True
        assert figure["differences"]["published-measured"]["significant"] is False
    for axis, analytic in (("x", 339.0), ("y", 533.0)):
        below = percent("natural_frequency_hz", axis, "published-analytic")
        own = measured["natural_frequency_hz", axis]["value"]
        assert below == pytest.approx(100.0 * (own / analytic - 1.0), abs=1e-9)
        # "less than 3.4 %"
        assert -3.4 < below < 0.0


def test_differences_of_the_mechanical_stage(capsys, made):
    stage, folder = made
    if stage != "vgtu-mechanical":
        pytest.skip("of the mechanical stage")
    measured = as_of_a_bench(capsys, folder)
    # to finite elements as printed, 1.28 and 1.02 %; to the analytic 116.5 um of the study its own
    # figures give 5.49 and 3.95 %
    for axis, elements, analytic in (("x", 1.28, 5.49), ("y", 1.02, 3.95)):
        figure = measured["output_displacement", axis]
        given = figure["differences"]
        near = 0.005 + 100.0 * (figure["interval"][1] - figure["interval"][0]) / figure["value"]
        assert near < 0.3
        assert -given["published-fem"]["percent"] == pytest.approx(elements, abs=near)
        assert -given["published-analytic"]["percent"] == pytest.approx(analytic, abs=near)
        # and the model of the reconstruction is nearer to the measured one than 12 %
        assert abs(given["lumped"]["percent"]) < 12.0


@pytest.mark.usefixtures("undrawn")
def test_a_stage_of_ones_own_with_one_axis(capsys, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text(stage_to_text(design("parallelogram")))
    out = tmp_path / "made"
    first = found(
        capsys, "--stage", mine, "--virtual-seed", "3", "--model", "lumped", "--folder", out
    )
    assert {c["axis"] for c in first["characteristics"]} == {"x"}
    assert "workspace_area" not in {c["quantity"] for c in first["characteristics"]}
    assert (out / "stage.yaml").exists()
    again = found(capsys, out / "campaign.yaml", "--model", "lumped")
    assert values(again).keys() == values(first).keys()
    assert again["characteristics"][0]["differences"] == {}


def loop(path, seed=1, count=5, samples=200, head=None):
    rng = np.random.default_rng(seed)
    k = np.arange(count * samples + 1)
    s = 1.0 - np.abs(2.0 * (k % samples) / samples - 1.0)
    way = np.where(k % samples < samples / 2, 1.0, -1.0)
    hump = 4.0 * s * (1.0 - s)
    along = STROKE * s - 1.5 * way * hump + 0.003 * rng.standard_normal(k.size)
    across = 0.21 * hump + 0.003 * rng.standard_normal(k.size)
    data = np.column_stack((k / 40.0, 3.0 + 97.0 * s, along, across))
    np.savetxt(
        path, data, delimiter=",", comments="",
        header=head or "time (s),drive (V),sensor (um),side (um)",
    )  # fmt: skip
    return path


def columns(*texts):
    return tuple(word for text in texts for word in ("--column", text))


ROLES = columns("command=drive", "along=sensor", "across=side")


def test_a_file_of_ones_own(capsys, tmp_path):
    path = loop(tmp_path / "loop.csv")
    result = found(
        capsys, path, *ROLES, "--axis", "u", "--sensor", "calibration=0.2%,alignment=3 mrad"
    )
    got = values(result)
    stroke = got["output_displacement", "u"]
    assert stroke["value"] == pytest.approx(STROKE * 1e-6, rel=1e-3)
    assert got["hysteresis_loop_width", "u"]["value"] == pytest.approx(3e-6, rel=1e-2)
    assert got["straightness", "u"]["value"] == pytest.approx(0.21e-6, rel=5e-2)
    parts = {c["name"]: c["uncertainty"] for c in stroke["budget"]}
    assert parts["calibration"] == pytest.approx(2e-3 * STROKE * 1e-6, rel=1e-2)
    assert "alignment" in parts
    assert (result["stage"], result["origin"]) == ("", "measured")
    assert list(result["sources"]) == [str(path)]
    assert stroke["differences"] == {}


def test_cycles_of_another_size_are_no_part_of_the_stroke(capsys, tmp_path):
    """A mean of 40 um over 0 to 100 V and 36 um over 5 to 95 V is the stroke of no cycle."""
    triangle = 1.0 - np.abs(np.arange(400) / 200.0 - 1.0)
    command = np.concatenate(
        (np.tile(100.0 * triangle, 3), [0.0], np.tile(5.0 + 90.0 * triangle, 4), [5.0])
    )
    noise = 2e-3 * np.random.default_rng(5).standard_normal(command.size)
    rows = zip(np.arange(command.size) / 200.0, command, 0.4 * command + noise, strict=True)
    path = tmp_path / "mixed.csv"
    lines = ["t [s],u [V],y [um]", *(f"{t:.4f},{u:.4f},{y:.5f}" for t, u, y in rows)]
    path.write_text("\n".join(lines))
    columns = ("--column", "command=u", "--column", "along=y")
    result = found(capsys, path, *columns)
    stroke = values(result)["output_displacement", "x"]
    assert stroke["value"] == pytest.approx(40e-6, abs=3e-9)
    assert stroke["interval"][0] <= 40e-6 <= stroke["interval"][1]
    (test,) = result["tests"]
    assert [(r["command"], r["cycles"]) for r in test["ranges"]] == [
        (pytest.approx([0.0, 100.0], abs=1e-9), 3),
        (pytest.approx([5.0, 95.0], abs=1e-9), 3),
    ]
    assert test["ranges"][0]["stroke"]["value"] == stroke["value"]
    assert test["ranges"][1]["stroke"]["value"] == pytest.approx(36e-6, abs=3e-9)
    said = "3 cycles from 0 to 100 V, 3 cycles from 5 to 95 V: those from 0 to 100 V are evaluated"
    assert said in test["notes"][0]
    out = run(capsys, path, *columns, "--folder", tmp_path / "out")[1]
    assert re.search(r"5 to 95 V +3 +3(6\.00|5\.99)", out)
    assert "stroke by range of the command" in (tmp_path / "out" / "report.html").read_text()


def test_table(capsys, tmp_path):
    path = loop(tmp_path / "loop.csv")
    status, out, err = run(capsys, path, *ROLES, "--folder", tmp_path / "out")
    assert (status, err) == (0, "")
    assert re.search(r"Output displacement +x +63\.(?:7|69[5-9])\d* ", out)
    assert (tmp_path / "out" / "report.html").exists()
    assert "results.json" in out


def test_units_that_the_file_does_not_say(capsys, tmp_path):
    bare = loop(tmp_path / "bare.csv", head="time (s),drive,sensor,side")
    words = (bare, *columns("command=drive V", "along=sensor um", "across=side nm"))
    got = values(found(capsys, *words))
    assert got["output_displacement", "x"]["value"] == pytest.approx(STROKE * 1e-6, rel=1e-3)
    assert got["straightness", "x"]["value"] == pytest.approx(0.21e-9, rel=5e-2)
    refused(capsys, "'side' does not give its unit", tmp_path, bare, *ROLES)
    refused(capsys, "unknown unit|no unit|unit", tmp_path, *words[:-1], "across=side parsec2")


def test_tab_separated_text_without_names(capsys, tmp_path):
    loop(tmp_path / "loop.csv")
    data = np.loadtxt(tmp_path / "loop.csv", delimiter=",", skiprows=1)
    path = tmp_path / "loop.dat"
    np.savetxt(path, data[:, 1:], delimiter="\t")
    words = (
        path,
        *columns("command=0 V", "along=1 um"),
    )
    got = values(
        found(
            capsys, *words, "--sample-rate", "40 Hz", "--format", "text", "--text", "delimiter=\\t"
        )
    )
    assert got["output_displacement", "x"]["value"] == pytest.approx(STROKE * 1e-6, rel=1e-3)
    refused(capsys, "sample rate|times", tmp_path, *words)


def sphere_report(folder, decimal="."):
    """Stations of a measuring machine, of which the command stands in the same table."""
    rng = np.random.default_rng(5)
    s = np.linspace(0.0, 1.0, 9)
    s = np.tile(np.concatenate((s, s[::-1])), 4)
    plate = {"A": (-20.0, -17.0, 12.0), "B": (19.0, -22.0, 11.0), "C": (3.0, 23.0, 17.0)}
    columns, names = [0.35 * s], ["screw (mm)"]
    for name, centre in plate.items():
        for letter, start, moved in zip("XYZ", centre, (0.1165, 1e-4, -2e-4), strict=True):
            columns.append(start + moved * s + 2e-5 * rng.standard_normal(s.size))
            names.append(f"{name}.{letter} (mm)")
    sign = ";" if decimal == "," else ","
    lines = [sign.join(names)]
    for row in zip(*columns, strict=True):
        lines.append(sign.join(f"{v:.6f}".replace(".", decimal) for v in row))
    path = folder / f"spheres{'comma' if decimal == ',' else ''}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("decimal", [".", ","])
def test_spheres_of_a_table(capsys, tmp_path, decimal):
    path = sphere_report(tmp_path, decimal)
    words = ("--test", "spheres", "--column", "command=screw", "--column", "spheres=A,B,C")
    got = values(found(capsys, path, *words))
    assert got["output_displacement", "x"]["value"] == pytest.approx(116.5e-6, rel=2e-3)
    assert got["cross_coupling", "x"]["value"] == pytest.approx(1e-4 / 0.1165, abs=5e-4)
    other = values(found(capsys, path, *words, "--axis", "u"))
    assert other["output_displacement", "u"]["value"] == got["output_displacement", "x"]["value"]
    refused(capsys, "at least three", tmp_path, path, *words[:4], "--column", "spheres=A,B")


def test_a_report_with_decimal_commas_is_no_motion(capsys, tmp_path):
    point = [("SPH1", [("X", 10.0, 10.0012), ("Y", -25.5, -25.5031)])]
    text = report([point, point], opening="DIM L{number}= LOCATION OF SPHERE {feature}")
    path = tmp_path / "spheres.txt"
    path.write_bytes(re.sub(rb"(\d)\.(\d)", rb"\1,\2", text.encode()))
    refused(
        capsys, "over point, and it needs samples with times or a rate", tmp_path, path,
        "--column", "command=SPH1.X", "--column", "along=SPH1.Y",
    )  # fmt: skip


def spoiled(folder, name, change):
    data = np.loadtxt(loop(folder / "whole.csv"), delimiter=",", skiprows=1)
    data = change(data)
    (folder / "whole.csv").unlink()
    path = folder / f"{name}.csv"
    np.savetxt(
        path, data, delimiter=",", header="time (s),drive (V),sensor (um),side (um)", comments=""
    )
    return path


def _put(rows, column, value):
    def change(data):
        data[rows, column] = value(data[rows, column]) if callable(value) else value
        return data

    return change


BAD_DATA = {
    "nan": (_put(417, 2, np.nan), "column 'sensor'"),
    "clipped": (
        _put(slice(None), 2, lambda v: np.minimum(v, 51.0)),
        "'sensor' is clipped at 5.1e-05",
    ),
    "dead": (_put(slice(None), 3, 0.4), "'side' is 4e-07 m in all of its 1001 samples"),
    "still": (_put(slice(None), 1, 12.0), "'drive' is 12 V in all"),
    "short": (lambda data: data[:590], "3 whole cycles .* are needed, got 2"),
    "backwards": (lambda data: data[::-1], "time"),
}


@pytest.mark.parametrize("name", BAD_DATA)
def test_bad_records(capsys, tmp_path, name):
    change, said = BAD_DATA[name]
    refused(capsys, said, tmp_path, spoiled(tmp_path, name, change), *ROLES)


def test_volts_where_a_length_is_needed(capsys, tmp_path):
    path = loop(tmp_path / "v.csv", head="time (s),drive (V),sensor (V),side (um)")
    refused(capsys, "'sensor' is in V, and 'along' needs a unit of length", tmp_path, path, *ROLES)


def test_a_truncated_tdms(capsys, tmp_path):
    data = np.loadtxt(loop(tmp_path / "loop.csv"), delimiter=",", skiprows=1)
    path = tmp_path / "loop.tdms"

    def channel(name, unit, values):
        properties = {"unit_string": unit, "wf_increment": 0.025, "wf_samples": len(values)}
        return ChannelObject("g", name, np.ascontiguousarray(values), properties=properties)

    with TdmsWriter(path) as file:
        file.write_segment(
            [RootObject(), channel("drive", "V", data[:, 1]), channel("sensor", "um", data[:, 2])]
        )
    words = ("--column", "command=drive", "--column", "along=sensor")
    assert values(found(capsys, path, *words))["output_displacement", "x"]["value"] > 6e-5
    whole = path.read_bytes()
    for size in (len(whole) // 2, len(whole) - 3, 40):
        path.write_bytes(whole[:size])
        refused(capsys, "loop.tdms", tmp_path, path, *words)


def test_bad_options(capsys, tmp_path):
    path = loop(tmp_path / "loop.csv")
    other = loop(tmp_path / "other.csv", seed=2)
    campaign = tmp_path / "c.yaml"
    campaign.write_text("campaign: 1\ntests: {}\n")
    for said, words in (
        ("no files: give measured files", ()),
        ("there is no file .*nothing.csv", (tmp_path / "nothing.csv", *ROLES)),
        ("nothing.yaml", (tmp_path / "nothing.yaml",)),
        ("the campaign has no test", (campaign,)),
        ("takes no further files", (campaign, path)),
        ("--column cannot be used", (campaign, "--column", "along=1 um")),
        ("--virtual-seed needs --stage", ("--virtual-seed", "3")),
        ("--virtual-seed needs --stage", (path, "--virtual-seed", "3", "--stage", "vgtu-piezo")),
        ("--column cannot be used with --virtual-seed",
         ("--virtual-seed", "3", "--stage", "parallelogram", "--column", "across=1")),
        ("no built-in design", (path, *ROLES, "--stage", "vgtu-pieso")),
        ("did you mean 'lumped'",
         (path, *ROLES, "--stage", "parallelogram", "--model", "lumbed")),
        ("unknown kind 'wave': choose from motion", (path, *ROLES, "--test", "wave")),
        ("evaluated from one file, got 2", (path, other, *ROLES)),
        ("no column 'sensr'", (path, "--column", "command=drive", "--column", "along=sensr")),
        ("needs the column of 'along'", (path, "--column", "command=drive")),
        ("--column must be a role and a column", (path, *ROLES, "--column", "um")),
        ("--column must be a role and a column.*roles", (path, *ROLES, "--column", "alonng=1 um")),
        ("'--sensor': calibration must be from 0 to below 1",
         (path, *ROLES, "--sensor", "calibration=120%")),
        ("angle", (path, *ROLES, "--sensor", "alignment=3 mm")),
        ("frequency", (path, *ROLES, "--sample-rate", "3 mm")),
        ("'input' and 'output'", (path, "--test", "response", "--column", "input=drive")),
        ("columns of 'output'", (path, "--test", "ring-down")),
        ("needs the column of 'corner'", (path, "--test", "workspace")),
        ("targets are positions in m",
         (path, "--test", "positioning", "--column", "command=drive", "--column", "along=sensor")),
        ("test 'staircase'",
         (path, "--test", "staircase", "--column", "command=drive", "--column", "along=sensor")),
    ):  # fmt: skip
        refused(capsys, said, tmp_path, *words)


def test_a_stage_without_axes(capsys, tmp_path):
    text = stage_to_text(design("parallelogram"))
    bare = re.sub(r"(?m)^axes:\n(?:[ -].*\n)+", "", text)
    assert bare != text
    path = tmp_path / "bare.yaml"
    path.write_text(bare)
    refused(capsys, "has no axis", tmp_path, "--virtual-seed", "1", "--stage", path)
    # a measured one can still be set beside its models, which then have nothing to say
    result = found(capsys, loop(tmp_path / "l.csv"), *ROLES, "--stage", path, "--model", "lumped")
    assert len(result["characteristics"]) == 7


def approaches(path, mark, heading, rows=lambda listed: listed):
    """Write a standard cycle: 3 targets [mm], 2 runs, with deviations [um] by hand."""
    up, down = ((2.0, 4.0), (7.0, 11.0), (-5.0, 1.0)), ((6.0, 10.0), (12.0, 14.0), (2.0, 10.0))
    listed = [
        (target, target + 1e-3 * off[i][run], mark[way])
        for run in range(2)
        for way, off, order in ((0, up, (0, 1, 2)), (1, down, (2, 1, 0)))
        for i, target in zip(order, np.array([10.0, 25.0, 55.0])[list(order)], strict=True)
    ]
    lines = [heading, *(",".join(str(v) for v in row) for row in rows(listed))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_positioning_as_the_standard_has_it(capsys, tmp_path):
    heading = "target (mm),reached (mm),side"
    words = ("--test", "positioning", "--column", "command=target", "--column", "along=reached")
    arrows = approaches(tmp_path / "a.csv", "↑↓", heading)
    result = found(capsys, arrows, *words, "--column", "direction=side")
    figures = result["tests"][0]["positioning"]["figures"]
    r = 2.0**0.5
    # as worked by hand in tests/literature/test_positioning_standard.py
    for name, value in (
        ("accuracy", 8.0 + 28.0 / r), ("accuracy_upward", 11.0 + 20.0 / r), ("systematic", 15.0),
        ("mean_deviation", 9.0), ("repeatability", 28.0 / r + 8.0), ("reversal", 8.0),
        ("mean_reversal", -17.0 / 3.0),
    ):  # fmt: skip
        assert figures[name]["value"] == pytest.approx(1e-6 * value, rel=1e-6), name
        low, high = figures[name]["interval"]
        assert low <= figures[name]["value"] <= high
    quantities = {c["quantity"]: c["value"] for c in result["characteristics"]}
    assert quantities["positioning_repeatability"] == figures["repeatability"]["value"]
    targets = result["tests"][0]["positioning"]["targets"]
    assert targets["target"] == pytest.approx([0.010, 0.025, 0.055])
    assert targets["mean_upward"] == pytest.approx([3e-6, 9e-6, -2e-6], rel=1e-6)
    assert targets["reversal"] == pytest.approx([-5e-6, -4e-6, -8e-6], rel=1e-6)
    # sorted rows need the column, and in those of the cycle their order says the same
    shuffled = approaches(tmp_path / "s.csv", ("fwd", "bwd"), heading, sorted)
    again = found(capsys, shuffled, *words, "--column", "direction=side")
    assert again["tests"][0]["positioning"]["figures"]["accuracy"]["value"] == pytest.approx(
        figures["accuracy"]["value"]
    )
    said = "0 of 3 positions were reached from both sides.*name the column"
    refused(capsys, said, tmp_path, shuffled, *words)
    _, out, err = run(capsys, arrows, *words, "--folder", tmp_path / "made")
    assert err == ""
    assert re.search(r"R +repeatability +16\.971 .* 27\.799", out)
    assert re.search(r"\n25 +9\.0+ +13\.0+ +11\.0+ +−4\.0+ ", out)
    page = (tmp_path / "made" / "report.html").read_text()
    assert "mean upward" in page
    assert "27.799" in page


ROTARY = ("--test", "positioning", "--axis", "c", "--column", "command=0")


def turned(path, angles, head="target (deg),u1 (deg),u2 (deg),d1 (deg),d2 (deg)"):
    """Write targets [deg] of which the table is 1, 3 arcsec off upward and 5, 7 downward."""
    off = np.array([1.0, 3.0, 5.0, 7.0]) / 3600.0
    # an encoder that begins again at 0 after a turn
    rows = [(f"{a}", *(f"{(a + o) % 360.0:.9f}" for o in off)) for a in angles]
    path.write_text("\n".join((head, *(",".join(row) for row in rows))) + "\n")
    return path


def test_rotary_positioning(capsys, tmp_path):
    path = turned(tmp_path / "turn.csv", range(0, 361, 60))
    words = (*ROTARY, "--column", "upward=1,2", "--column", "downward=3,4")
    _, out, err = run(capsys, path, *words)
    assert err == ""
    # means 2 and 6, s = sqrt 2: A = 4 + 4 sqrt 2, R = 4 sqrt 2 + 4, B = 4
    assert re.search(r"Reversal B +c +4\.000000 .* arcsec", out)
    assert re.search(r"\nA +accuracy +5\.6568 .* 9\.6568 ", out)
    assert re.search(r"closure error of the turn +0\.0000 ", out)
    assert re.search(r"\n360 +2\.0000 +6\.0000 +4\.0000 +−4\.0000 ", out)
    flat = " ".join(out.split())
    assert "asks for 8 targets or more over 360 deg and for 5 runs each way" in flat
    assert "this test has 6 and 2" in flat
    assert "targets 0, 360 deg are one position" in flat
    # deviations in another unit of angle; seven targets of half a turn close nothing
    rows = "".join(f"{a},1,3,5,7\n" for a in range(0, 181, 30))
    path.write_text("target (deg),u1 (arcsec),u2 (arcsec),d1 (arcsec),d2 (arcsec)\n" + rows)
    result = found(capsys, path, *words, "--deviations", "--sensor", "calibration=1e-6")
    accuracy = next(c for c in result["characteristics"] if c["quantity"] == "rotation_accuracy")
    arcsec = np.radians(1.0 / 3600.0)
    assert accuracy["unit"] == "rad"
    assert accuracy["value"] == pytest.approx((4.0 + 4.0 * 2.0**0.5) * arcsec, rel=1e-9)
    gain = next(part for part in accuracy["budget"] if part["name"] == "calibration")
    assert gain["uncertainty"] == pytest.approx(1e-6 * np.pi, rel=1e-6)
    notes = result["tests"][0]["notes"]
    assert any("asks for 5 targets or more over 180 deg" in note for note in notes)
    assert not any("one position" in note for note in notes)


def test_rotary_positioning_that_is_refused(capsys, tmp_path):
    lengths = "target (deg),u1 (um),u2 (um),d1 (um),d2 (um)"
    words = (*ROTARY, "--column", "upward=1,2", "--column", "downward=3,4")
    path = turned(tmp_path / "t.csv", (0, 45, 90), lengths)
    refused(capsys, "'u1' is in m, and 'upward' needs a unit of angle", tmp_path, path, *words)
    path = turned(tmp_path / "t.csv", (0, 45, 90), "target,u1,u2,d1,d2")
    refused(capsys, "'target' does not give its unit, and 'command' needs", tmp_path, path, *words)
    volts = turned(
        tmp_path / "t.csv", (0, 45, 90), "target (V),u1 (deg),u2 (deg),d1 (deg),d2 (deg)"
    )
    refused(capsys, "positions in m or angles, and the command is in 'V'", tmp_path, volts, *words)
    again = "target (deg),read (deg)\n" + "".join(f"{a},{a}\n" for a in (0, 120, 240, 0, 120, 240))
    path.write_text(again)
    said = "row 4 begins again at target 0 deg after 240 deg"
    refused(capsys, said, tmp_path, path, *ROTARY, "--column", "along=1")


def test_axis_of_rotation(capsys, tmp_path):
    angle = np.arange(5.0 * 90.0) * 4.0
    theta = np.radians(angle)
    wobble = 0.05 * np.cos(1.2 * theta)
    columns = {
        "angle (deg)": angle % 360.0,
        "x (um)": 30.0 * np.cos(theta) + 0.2 * np.cos(2.0 * theta) + wobble,
        "y (um)": 30.3 * np.sin(theta),
        "z (um)": 2.0 * np.cos(theta - 1.0),
        "tilt (arcsec)": 3.0 * np.sin(theta),
    }
    path = tmp_path / "axis.csv"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9f")
    words = ("--test", "axis-of-rotation", "--axis", "c", "--column", "angle=0")
    roles = [w for k, r in enumerate(("radial", "radial_90", "axial", "tilt"), start=1)
             for w in ("--column", f"{r}={k}")]  # fmt: skip
    result = found(capsys, path, *words, *roles, "--sensor", "calibration=0.1%")
    figures = {c["quantity"]: c for c in result["characteristics"]}
    arcsec = np.radians(1.0 / 3600.0)
    for quantity, value in (
        ("eccentricity", 30e-6), ("radial_synchronous", 0.4e-6), ("axial_synchronous", 4e-6),
        ("axial_once_per_turn", 4e-6), ("tilt_synchronous", 6.0 * arcsec),
        ("tilt_once_per_turn", 6.0 * arcsec),
    ):  # fmt: skip
        assert figures[quantity]["value"] == pytest.approx(value, rel=5e-3), quantity
    # five fifths of a turn of the wobble: cos over 0, 72, ... deg, at its widest
    widest = 2.0 * 0.05e-6 * np.cos(np.pi / 10.0)
    assert figures["radial_asynchronous"]["value"] == pytest.approx(widest, rel=5e-3)
    gain = next(p for p in figures["eccentricity"]["budget"] if p["name"] == "calibration")
    assert gain["uncertainty"] == pytest.approx(30e-9, rel=1e-3)
    notes = " ".join(result["tests"][0]["notes"])
    assert "5 turns: asynchronous" in notes
    assert "order 1 of axial motion and tilt is no eccentricity" in notes
    # x cos + y sin: half of 1 % of 30 um as order 2, beside order 3 of the motion
    assert "rotating direction: order 2 has 0.15 um" in notes
    turning = np.ptp(0.1 * np.cos(3.0 * theta) - 0.15 * np.cos(2.0 * theta))
    value = figures["rotating_synchronous"]["value"]
    assert value == pytest.approx(1e-6 * float(turning), rel=5e-3)
    for said, more in (
        ("needs the column of 'radial', 'axial' or", ()),
        ("that of 'radial' with 'radial_90'", ("axial=3", "radial_90=2")),
        ("'tilt' is in rad, and 'radial' needs a unit of length", ("radial=4",)),
    ):
        named = [word for role in more for word in ("--column", role)]
        refused(capsys, said, tmp_path, path, *words, *named)


PLAN = """campaign: 1
stage: {stage}
instruments:
  gauge: {{calibration: 0.001}}
tests:
  loop:
    test: motion
    axis: x
    records: [loop.csv]
    columns: {{command: drive, along: {along}}}
    along: gauge
"""


def test_a_description_finds_its_files_from_its_own_folder(capsys, tmp_path, monkeypatch):
    folder = tmp_path / "bench"
    folder.mkdir()
    loop(folder / "loop.csv")
    (folder / "stage.yaml").write_text(stage_to_text(design("parallelogram")))
    (folder / "plan.yaml").write_text(PLAN.format(stage="stage.yaml", along="sensor"))
    monkeypatch.chdir(tmp_path)
    result = found(capsys, "bench/plan.yaml", "--model", "lumped")
    assert result["stage"] == "parallelogram"
    assert values(result)["output_displacement", "x"]["differences"].keys() == {"lumped"}
    (folder / "plan.yaml").write_text(PLAN.format(stage="gone.yaml", along="sensor"))
    refused(capsys, "gone.yaml", tmp_path, "bench/plan.yaml")
    (folder / "plan.yaml").write_text(PLAN.format(stage="''", along="spy"))
    refused(capsys, "loop.*no column 'spy'", tmp_path, "bench/plan.yaml")
    wrong = PLAN.replace("along: gauge", "along: eyes").format(stage="''", along="sensor")
    (folder / "plan.yaml").write_text(wrong)
    refused(capsys, "line 11.*instrument 'eyes' is not described", tmp_path, "bench/plan.yaml")


def test_help(capsys):
    status, out, _ = run(capsys, "--help")
    assert status == 0
    for option in ("--stage", "--virtual-seed", "--folder", "--json", "--column"):
        assert option in out


def test_a_report_of_a_measuring_machine(capsys, tmp_path):
    """Spheres of a plate, as the machine prints them, with the commands on the command line."""
    plate = np.array([(-21.0, -17.0, 12.0), (19.0, -22.0, 11.0), (3.0, 23.0, 17.0)])
    share = np.tile(np.concatenate((np.linspace(0.0, 1.0, 9), np.linspace(1.0, 0.0, 9))), 3)
    rng = np.random.default_rng(5)
    points = []
    for s in share:
        centres = plate + (0.0837 * s, 0.0, 0.0) + 2e-5 * rng.standard_normal(plate.shape)
        points.append(
            [
                (f"S{i + 1}", list(zip("XYZ", nominal, centre, strict=True)))
                for i, (nominal, centre) in enumerate(zip(plate, centres, strict=True))
            ]
        )
    path = tmp_path / "report.txt"
    path.write_text(report(points, digits=5))
    told = ",".join(f"{300.0 * s:.3f} um" for s in share)
    words = (path, "--test", "spheres", "--column", "spheres=S1,S2,S3", "--commands")
    stroke = values(found(capsys, *words, told))["output_displacement", "x"]
    assert stroke["value"] == pytest.approx(83.7e-6, abs=3e-8)
    assert stroke["interval"][0] < 83.7e-6 < stroke["interval"][1]
    refused(capsys, "gives 2 commands for 54 stations", tmp_path, *words, "0 um, 5 um")
    refused(capsys, "length", tmp_path, *words, "0 V")
