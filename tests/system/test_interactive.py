"""`import flexstage as fs`: one import, and results that show themselves."""

import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import signal

import flexstage as fs
from flexstage import report
from flexstage.base.errors import HingeError, ModelError, StageError
from flexstage.base.short_repr import short_repr
from flexstage.centring import exact_error
from flexstage.experiments import Campaign, Columns, Test
from flexstage.experiments.campaign.plan import campaign_text
from flexstage.records import Channel, Record
from flexstage.report.notebook.jobs import StageAnalysis, StageStudy
from flexstage.report.notebook.show import HingeResult
from flexstage.stage import write_stage

LONGEST = 600  # characters of a text on a few lines


@pytest.fixture(scope="module")
def analysed() -> StageAnalysis:
    return fs.analyse("vgtu-piezo", "lumped")


@pytest.fixture(scope="module")
def studied() -> StageStudy:
    return fs.study("vgtu-piezo", ["lumped"])


@pytest.fixture(scope="module")
def notch() -> HingeResult:
    return fs.hinge("elliptical", neck_thickness="0.37 mm", half_length=1.3e-3, notch_depth="2 mm")


def test_the_names_are_listed() -> None:
    wanted = {
        "read", "design", "draw", "check", "analyse", "study", "compare", "sensitivity", "sweep",
        "optimise", "tolerance", "reconstruct", "hinge", "read_record", "identify", "characterise",
        "frf", "centre", "__version__",
    }  # fmt: skip
    assert wanted == set(dir(fs)) == set(fs.__all__)
    assert not any(isinstance(getattr(fs, name), ModuleType) for name in dir(fs))
    # the subpackages are there for all that, and their own names are listed
    assert "run_study" in dir(fs.studies)
    with pytest.raises(AttributeError, match="has no attribute 'analyze'"):
        fs.analyze  # type: ignore[attr-defined]  # noqa: B018


def test_a_name_can_be_replaced_by_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fs, "draw", json)
    assert fs.draw is json


def test_a_stage_is_read_by_file_or_by_name(tmp_path: Path) -> None:
    stage = fs.design("parallelogram")
    write_stage(stage, tmp_path / "guide.yaml")
    assert fs.read(tmp_path / "guide.yaml") == stage == fs.read("parallelogram")
    with pytest.raises(StageError, match="did you mean 'vgtu-piezo'"):
        fs.read("vgtu-pieso")
    # whatever takes a stage takes its name or file as well
    by_file = fs.analyse(str(tmp_path / "guide.yaml"), "lumped")
    assert by_file.value("max_stress", "x") == fs.analyse(stage, "lumped").value("max_stress", "x")


def test_texts_are_short(analysed: StageAnalysis, studied: StageStudy, notch: HingeResult) -> None:
    analysis = analysed.analysis
    large = [
        analysed, studied, notch, analysis, analysed.run, analysed.system, analysis.stage,
        analysis.characteristics, analysis.axes[0], analysis.axes[0].static,
        analysis.modes["removed"], analysis.responses[0], studied.study, studied.study.comparison,
    ]  # fmt: skip
    for thing in large:
        assert 10 < len(repr(thing)) < LONGEST, type(thing).__name__
    assert "natural frequency: x 326.0, y 538.7 Hz" in repr(analysed)
    assert "hinges=<32>" in repr(analysis.stage)


def test_an_array_is_shown_by_its_size_or_its_one_value() -> None:
    @dataclass
    class Pair:
        many: np.ndarray
        one: np.ndarray

    assert short_repr(Pair(np.zeros((3, 2)), np.array(2.7))) == "Pair(many=<3 × 2>, one=2.7)"


def test_tables_show_the_figures(
    analysed: StageAnalysis, studied: StageStudy, notch: HingeResult
) -> None:
    def cells(table: str) -> list[list[str | None]]:
        return [[cell.text for cell in row] for row in ElementTree.fromstring(table).iter("tr")]

    rows = {row[0]: row[1:] for row in cells(analysed._repr_html_())}
    assert rows["Natural frequency"] == ["326.0", "538.7", "Hz"]
    head, *body = cells(studied._repr_html_())
    found = {(row[0], row[1]): dict(zip(head, row, strict=True)) for row in body}
    assert found["Natural frequency", "x"]["published-analytic"] == "339.0"
    assert found["Natural frequency", "x"]["lumped"] == "326.0"
    by_method = {(row[0], row[1]): float(row[2] or 0) for row in cells(notch._repr_html_())[1:]}
    assert by_method["rotation", "wedge"] == pytest.approx(notch.stiffness(), rel=1e-3)


def test_a_notebook_shows_stages_and_figures(analysed: StageAnalysis) -> None:
    for text in (
        fs.design("parallelogram")._repr_html_(),
        fs.draw("parallelogram")._repr_svg_(),  # type: ignore[attr-defined]
        analysed.plot("stress")._repr_svg_(),  # type: ignore[attr-defined]
    ):
        assert ElementTree.fromstring(text or "").tag.endswith("svg")


def test_plots_are_chosen_by_name_and_axis(
    analysed: StageAnalysis, studied: StageStudy, notch: HingeResult
) -> None:
    assert analysed.plot().axes[0].get_ylabel().startswith("x / force")
    assert analysed.plot("response", "y").axes[0].get_ylabel().startswith("y / force")
    assert studied.plot("shape", "y").axes
    # the contour spans the notch and the roots on both sides
    limits = notch.plot().axes[0].dataLim
    assert (limits.width, limits.height) == pytest.approx((2.6, 4.37))
    with pytest.raises(ModelError, match=r"no plot 'strss'.*did you mean 'stress'"):
        analysed.plot("strss")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="axis 'z'"):
        analysed.plot("response", "z")


@pytest.mark.parametrize(
    ("make", "columns", "rows"),
    [
        (lambda: fs.analyse("vgtu-piezo", "lumped"), {"quantity", "axis", "value", "unit"}, 24),
        (lambda: fs.hinge(neck_thickness=0.5e-3, radius=1e-3), {"method", "stiffness"}, 20),
    ],
)
def test_a_data_frame_needs_pandas(
    make: Callable[[], StageAnalysis | HingeResult],
    columns: set[str],
    rows: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = make()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.to_frame()
    stand_in = ModuleType("pandas")
    stand_in.DataFrame = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    frame = result.to_frame()
    assert columns <= set(frame)
    assert all(len(column) >= rows for column in frame.values())  # type: ignore[operator]


def test_a_wrong_quantity_or_axis_names_the_right_one(
    analysed: StageAnalysis, studied: StageStudy
) -> None:
    with pytest.raises(ModelError, match="did you mean 'max_stress'"):
        analysed.value("max_stres", "x")
    with pytest.raises(ModelError, match="of axis 'z': it is known of axis x, y"):
        analysed.value("max_stress", "z")
    with pytest.raises(ModelError, match="from 'solid': it comes from published-fem, lumped"):
        studied.characteristics.value("max_stress", "x", "solid")
    with pytest.raises(ModelError, match="no analysis by 'plane': the study ran lumped"):
        studied.analysis("plane")


def test_modes_are_drawn_of_every_model() -> None:
    found = fs.analyse("parallelogram", "lumped")
    figure = found.plot("modes")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    frequencies = found.analysis.modes["removed"].frequency_hz
    assert [float(title.split()[0]) for title in titles] == pytest.approx(frequencies[:6], rel=1e-3)
    # in the lowest mode the platform moves furthest, along the guide: by 3 % of its size [mm]
    images = figure.axes[0].images
    assert len(images) == sum(not body.fixed for body in found.analysis.stage.bodies)
    moves = [(i.get_transform() - figure.axes[0].transData).transform((0.0, 0.0)) for i in images]
    assert sum(abs(x) == pytest.approx(0.03 * 68.5, rel=1e-3) for x, _ in moves) == 1


def test_rows_say_their_value_and_unit_for_display(analysed: StageAnalysis) -> None:
    rows = {(row.quantity, row.axis): row for row in analysed.characteristics}
    stress = rows["max_stress", "x"]
    assert (stress.unit, stress.shown_unit, stress.label) == ("Pa", "MPa", "Largest stress")
    assert stress.shown_value == pytest.approx(1e-6 * stress.value, rel=1e-12)
    assert float(stress.text()) == pytest.approx(stress.shown_value, rel=1e-3)
    ratio = rows["transmission_ratio", "x"]
    assert (ratio.unit, ratio.shown_unit, ratio.shown_value) == ("1", "", ratio.value)


def test_a_record_is_a_data_frame_with_units(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = ModuleType("pandas")
    stand_in.DataFrame = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    t = np.array([0.0, 0.1, 0.3])
    columns = [("x", 2.0 * t, "m"), ("count", 3.0 * t, ""), ("same", t + 1.0, "V"),
               ("same", t + 2.0, "V")]  # fmt: skip
    channels = tuple(Channel(name=n, values=v, unit=u) for n, v, u in columns)
    frame = Record(time=t, channels=channels).to_frame()
    assert list(frame) == ["time [s]", "x [m]", "count", "2: same [V]", "3: same [V]"]
    assert [frame[name][2] for name in frame] == pytest.approx([0.3, 0.6, 0.9, 1.3, 2.3])
    for over, name in (("point", "point"), ("frequency", "frequency [Hz]")):
        assert next(iter(Record(time=t, channels=channels, over=over).to_frame())) == name


def test_stages_are_compared_side_by_side() -> None:
    thick = fs.read("parallelogram", set={"leg.notch.neck_thickness": "0.6 mm"})
    found = fs.compare("parallelogram", fs.analyse(thick, "lumped"), model="lumped")
    assert found.columns == ("1: parallelogram, lumped", "2: parallelogram, lumped")
    lines = str(found).splitlines()
    (words,) = (line.split() for line in lines if line.startswith("Natural frequency"))
    frequencies = [
        fs.analyse(stage, "lumped").value("natural_frequency_hz", "x")
        for stage in ("parallelogram", thick)
    ]
    assert words[2] == "x"
    assert [float(word) for word in words[3:5]] == pytest.approx(frequencies, rel=1e-3)
    change = 100.0 * (frequencies[1] / frequencies[0] - 1.0)
    assert words[5] == "Hz"
    assert float(words[6]) == pytest.approx(change, abs=0.06)
    html = ElementTree.fromstring(found._repr_html_())
    assert len(list(html.iter("tr"))) == len(lines)
    three = fs.compare("parallelogram", thick, "rhombus", model="lumped")
    assert "change" not in str(three)


def test_requests_are_asked_by_their_fields() -> None:
    neck = "leg.notch.neck_thickness"
    found = fs.sweep("parallelogram", over={neck: "0.4..0.6 mm/3"}, of="natural_frequency.x")
    assert found.points[:, 0] == pytest.approx([0.4e-3, 0.5e-3, 0.6e-3])
    for value, text in zip(found.values[:, 0], ("0.4 mm", "0.5 mm", "0.6 mm"), strict=True):
        stage = fs.read("parallelogram", set={neck: text})
        own = fs.analyse(stage, "lumped").value("natural_frequency_hz", "x")
        assert value == pytest.approx(own, rel=1e-9)
    # two ways to say the same; and what is set throughout
    same = fs.sweep("parallelogram", over=[f"{neck}=0.4..0.6 mm/3"], of=["natural_frequency.x"])
    assert same.values == pytest.approx(found.values, rel=1e-12)
    short = fs.sweep("parallelogram", over=f"{neck}=0.4..0.6 mm/3", of="natural_frequency.x",
                     set={"leg.bar_length": "20 mm"})  # fmt: skip
    assert short.values.min() > 1.05 * found.values.min()
    slopes = fs.sensitivity("parallelogram", by=neck, of="natural_frequency.x").slopes
    central = (found.values[2, 0] - found.values[0, 0]) / 0.2e-3
    assert slopes[0, 0] == pytest.approx(central, rel=0.02)
    best = fs.optimise("parallelogram", maximise="natural_frequency.x", over=f"{neck}=0.4..0.6 mm",
                       model="lumped", without="check")  # fmt: skip
    assert best.point[0] > 0.5e-3  # type: ignore[union-attr]
    study = fs.tolerance("parallelogram", samples=64, model="lumped", scatter={"*": "0"},
                         of="natural_frequency.x")  # fmt: skip
    assert study.choice is None
    assert study.values[:, 0] == pytest.approx(found.values[1, 0], rel=1e-9)
    with pytest.raises(ModelError, match=r"unknown option 'sample'.*did you mean 'samples'"):
        fs.sweep("parallelogram", over=f"{neck}=0.4..0.6 mm", sample=3)
    with pytest.raises(StageError, match="no parameters to vary: give its file or design"):
        fs.sweep(fs.read("parallelogram"), over=f"{neck}=0.4..0.6 mm")  # type: ignore[arg-type]


def test_a_stage_is_checked() -> None:
    stage = fs.read("parallelogram")
    assert fs.check(stage) == fs.check("parallelogram") == ()
    loose = replace(stage, hinges=stage.hinges[1:])
    assert any(issue.severity == "error" for issue in fs.check(loose))


def test_modes_are_found_in_responses_and_in_records() -> None:
    rng = np.random.default_rng(3)
    # a mode at 137 Hz with 1.7 % of damping
    f = np.linspace(90.0, 190.0, 401)
    h = 2.3e-6 / (1.0 - (f / 137.0) ** 2 + 0.034j * f / 137.0)
    h += 1e-9 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    parts = (("h real", h.real), ("h imaginary", h.imag))
    response = Record(
        time=f,
        over="frequency",
        channels=tuple(Channel(name=name, values=v, unit="m/N") for name, v in parts),
        attributes={"output unit of h": "m", "input unit of h": "N"},
    )
    (mode,) = fs.frf(response).modes
    assert mode.frequency_hz.value == pytest.approx(137.0, rel=1e-4)
    assert mode.damping_ratio.value == pytest.approx(0.017, rel=0.01)
    with pytest.raises(ModelError, match="need an input and an output"):
        fs.frf(replace(response, over="time"))
    rate, n, w = 2048.0, 2**16, 2.0 * np.pi * 137.0
    t, force = np.arange(n) / rate, rng.standard_normal(n)
    system = signal.TransferFunction([2.3e-6 * w**2], [1.0, 0.034 * w, w**2])
    moved = signal.lsim(system, force, t)[1] + 1e-8 * rng.standard_normal(n)
    record = Record(time=t, channels=(Channel(name="F", values=force, unit="N"),
                                      Channel(name="x", values=moved, unit="m")))  # fmt: skip
    (mode,) = fs.frf(record, "F", "x", resolution=0.5, band=(110.0, 170.0)).modes
    assert mode.frequency_hz.value == pytest.approx(137.0, rel=2e-3)


def test_a_scale_is_centred_from_its_file_and_from_its_record(tmp_path: Path) -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
    e, radius = np.array([41e-6, -29e-6]), 50e-3
    columns = np.column_stack((np.degrees(theta), np.degrees(exact_error(theta, e, radius))))
    path = tmp_path / "bench.csv"
    np.savetxt(path, columns, delimiter=",", header="angle,error", comments="")
    asked = {"error": "error", "angle": "angle", "unit": "deg", "radius": radius}
    found = fs.centre(path, **asked)
    assert found.to_dict()["eccentricity"]["x"] == pytest.approx(e[0], abs=1e-10)
    again = fs.centre(fs.read_record(path, over="point"), **asked)
    assert again.to_dict()["eccentricity"] == found.to_dict()["eccentricity"]


def test_tests_and_drives_are_evaluated(tmp_path: Path) -> None:
    """Three cycles of 40 um of a drive that is a straight line."""
    t = np.arange(3001) / 1000.0
    u = 50.0 - 50.0 * np.cos(2.0 * np.pi * t)
    x = 0.4e-6 * u + 1e-9 * np.random.default_rng(4).standard_normal(t.size)
    path = tmp_path / "loops.csv"
    np.savetxt(path, np.column_stack((t, u, x)), delimiter=",", header="t (s),u (V),x (m)",
               comments="")  # fmt: skip
    test = Test(name="loops", test="motion", axis="x", records=(str(path),),
                columns=Columns(command="u", along="x"))  # fmt: skip
    campaign = Campaign(tests=(test,))
    stroke = fs.characterise(campaign).figure("output_displacement", "x").value
    assert stroke == pytest.approx(40e-6, abs=5e-9)
    (tmp_path / "tests.yaml").write_text(campaign_text(campaign))
    by_file = fs.characterise(tmp_path / "tests.yaml")
    assert by_file.figure("output_displacement", "x").value == stroke
    drive = fs.identify(fs.read_record(path), "u", "x", model="prandtl-ishlinskii")
    assert drive.rms_percent < 0.1


def test_a_hinge_takes_numbers_and_texts_alike(notch: HingeResult) -> None:
    same = fs.hinge("elliptical", neck_thickness=0.37e-3, half_length="1.3 mm", notch_depth=2e-3)
    assert same.figures == notch.figures
    wide = fs.hinge("elliptical", width="20 mm", neck_thickness=0.37e-3, half_length="1.3 mm",
                    notch_depth=2e-3, plane="strain")  # fmt: skip
    narrow = fs.hinge("elliptical", neck_thickness=0.37e-3, half_length="1.3 mm",
                      notch_depth=2e-3, plane="strain")  # fmt: skip
    # in plane strain a hinge twice as wide is twice as stiff
    assert wide.stiffness() == pytest.approx(2.0 * narrow.stiffness(), rel=1e-9)
    for sizes, message in (
        ({"neck_thickness": 1e-3}, "also needs radius"),
        ({"neck_thickness": 1e-3, "radius": 1e-3, "raduis": 1e-3}, "has no raduis"),
    ):
        with pytest.raises(HingeError, match=message):
            fs.hinge(**sizes)
    with pytest.raises(HingeError, match="did you mean 'wedge'"):
        notch.stiffness(method="wedg")
    with pytest.raises(HingeError, match="quantities are axial, shear and rotation"):
        notch.stiffness("bending")
    with pytest.raises(HingeError, match="must be auto, stress or strain"):
        fs.hinge(neck_thickness=1e-3, radius=1e-3, plane="strein")


@pytest.mark.usefixtures("undrawn")
def test_a_study_hands_out_its_analyses_and_writes_its_report(
    studied: StageStudy, tmp_path: Path
) -> None:
    # with the figures over the stroke that the study adds
    assert studied.analysis("lumped").analysis is studied.study.analyses["lumped"]
    page, results = fs.study("parallelogram", "lumped").write(tmp_path / "report")
    assert "<html" in page.read_text("utf-8")
    assert '"lumped"' in results.read_text("utf-8")


def test_every_figure_is_in_the_manual() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "python.md").read_text("utf-8")
    documented = set(re.findall(r"`(draw_\w+)\(", page))
    assert documented == {name for name in report.__all__ if name.startswith("draw_")}
