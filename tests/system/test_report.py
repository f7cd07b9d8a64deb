"""The report of a study: whole, self-contained, and with the numbers of the results."""

import html
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.experiments.verbs.identify import IdentifiedStep
from flexstage.files.write import write_files
from flexstage.hinges import Leaf
from flexstage.quantities.material import material
from flexstage.quantities.quantity import QUANTITIES as QUANTITY_NAMES
from flexstage.quantities.quantity import display
from flexstage.report import report_html
from flexstage.report.figures.body_motion import draw_static_shape, draw_stroke, mode_motion
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.hinges import draw_stress
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.style import FORMATS, encode, inline_svg
from flexstage.report.figures.tracking import draw_drive_fit
from flexstage.report.findings import summary
from flexstage.report.study import CHAPTERS, SECTIONS
from flexstage.report.tables import characteristics_table
from flexstage.stage.designs import design
from flexstage.stage.designs.vgtu import IDEAL_SEATS, predicted_ranges
from flexstage.stage.mass import mass_properties
from flexstage.studies import Study, results_json, run_study
from flexstage.system import Analysis, modes
from flexstage.system.characteristics import pulsating_limit
from tests.result_schema import require_valid
from tests.studies import page_of, study_of

QUANTITIES = {
    "input_displacement",
    "output_displacement",
    "transmission_ratio",
    "max_stress",
    "safety_factor",
    "natural_frequency_hz",
    "cross_coupling",
    "parasitic_rotation",
    "input_stiffness",
}
BESIDE = {"virtual-measurement.html"}
#: Sections that every stage with drives has, however it is modelled.
ALWAYS = {
    "drawing", "hinges", "equations", "diagram", "characteristics", "static", "stroke",
    "frequencies", "bode", "modes", "safety", "stress", "bench", "validity", "provenance",
}  # fmt: skip
VOID = {"meta", "link", "br", "input", "img", "hr", "path", "use", "rect", "image"}


@pytest.fixture(scope="module")
def study() -> Study:
    return study_of("vgtu-piezo")


@pytest.fixture(scope="module")
def page() -> str:
    return page_of("vgtu-piezo")


class Page(HTMLParser):
    """What a page holds: ids, loads, cells of tables, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.references: list[str] = []
        self.loads: list[str] = []
        self.cells: list[tuple[dict[str, str], str]] = []
        self._open: list[str] = []
        self._cell: dict[str, str] | None = None
        self.feed(text)
        self.close()
        assert not self._open, f"left open: {self._open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {key: value or "" for key, value in attrs}
        self.ids += [values["id"]] if "id" in values else []
        for key in ("src", "href", "data", "action", "poster", "srcset"):
            target = values.get(key, "")
            if target.startswith("#"):
                self.references.append(target[1:])
            elif tag == "a" and target in BESIDE:
                pass  # a page of the same folder, which is opened by hand
            elif target and not target.startswith("data:"):
                self.loads.append(f"{tag} {key}={target}")
        for value in values.values():
            self.references += re.findall(r"url\(#([^)]+)\)", value)
        self._cell = values if "data-value" in values else None
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self.cells.append((self._cell, data))
            self._cell = None


def test_the_page_loads_nothing(page: str) -> None:
    assert not Page(page).loads
    assert "http://" not in page
    assert "https://" not in page
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)
    # and a browser would refuse to
    assert "default-src 'none'" in page
    assert len(page.encode()) < 5e6


def test_the_page_has_every_section_and_no_dangling_reference(page: str) -> None:
    parsed = Page(page)
    assert set(SECTIONS) >= ALWAYS
    assert ALWAYS | {"differences", "published"} <= set(parsed.ids)
    assert set(CHAPTERS) - {"compensation", "scale", "traditional"} <= set(parsed.ids)
    assert len(parsed.ids) == len(set(parsed.ids)), "an id stands twice in the page"
    assert set(parsed.references) <= set(parsed.ids)
    assert "$" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)


def test_the_page_says_that_the_stage_is_a_reconstruction(study: Study, page: str) -> None:
    head = page[: page.index('id="drawing"')]
    assert "reconstruction" in head
    for text in (study.main.provenance.input_hash, study.main.provenance.version):
        assert text in page


def test_predictions_say_that_the_geometry_is_fitted_and_show_their_range(
    study: Study, page: str
) -> None:
    ranges = predicted_ranges(study.stage)
    assert ranges is not None
    table = characteristics_table(study.comparison, set(QUANTITY_NAMES), "", ranges)
    assert table is not None
    place = [column.heading for column in table.columns].index("kind")
    cells = {(line[0].text.split(" [")[0], line[1].text): line[place] for line in table.rows}
    low, high = ranges.values["input_stiffness", "x"]
    kind = cells["Input stiffness", "x"]
    assert kind.text == "predicted, geometry fitted"
    assert kind.small == f"95 %: {1e-6 * low:.2f} to {1e-6 * high:.2f}"
    assert not cells["Natural frequency", "x"].small
    assert not any(c.text == "predicted" for c in cells.values())
    assert ranges.source in table.notes
    said = html.unescape(words(page)).replace("\u00a0", " ")
    assert "flexstage reconstruct vgtu-piezo --members 0" in said
    on_seats = "/".join(f"{v:.0f}" for v in ranges.values[IDEAL_SEATS, "x"]).replace("/", " to ")
    assert f"on ideal seats (geometry fitted, 95 %: {on_seats} Hz)" in said
    # and a stage that is only based on one has no range
    assert predicted_ranges(replace(study.stage, published=())) is None


def test_numbers_of_the_table_are_those_of_the_results(study: Study, page: str) -> None:
    results = json.loads(results_json(study.to_dict()))
    require_valid(results, "study")
    wanted = [(r["origin"], r) for r in results["characteristics"]]
    for name, variant in results["variants"].items():
        wanted += [(name, r) for r in variant["characteristics"]]
    expected = {(r["quantity"], r["axis"], column, r["value"]) for column, r in wanted}
    # a row that is the same on several axes stands once, with both names
    cells = [(c, axis, text) for c, text in Page(page).cells for axis in c["data-axis"].split(", ")]
    shown = {
        (c["data-quantity"], axis, c["data-column"], float(c["data-value"])) for c, axis, _ in cells
    }
    assert len(shown) > 50
    assert shown == expected
    for c, _, text in cells:
        if text == "≈ 0":
            continue
        value, digits = float(c["data-value"]), text.replace("−", "-")
        factor = display(c["data-quantity"]).factor * value
        # in the unit of the quantity, or in one a thousand or a million times smaller
        rest = min(abs(float(digits) / (factor * k) - 1.0) for k in (1.0, 1e3, 1e6))
        assert rest < (1e-9 if c["data-column"].startswith("published") else 1e-3), (c, text)


def test_published_figures_stand_as_they_are_printed(page: str) -> None:
    printed = {
        (c["data-quantity"], c["data-axis"], c["data-column"]): text
        for c, text in Page(page).cells
        if c["data-column"].startswith("published")
    }
    assert printed["output_displacement", "x", "published-fem"] == "64.6"
    assert printed["straightness_out_of_plane", "x", "published-measured"] == "0.09"
    assert printed["straightness", "y", "published-measured"] == "0.2"
    assert printed["input_displacement", "x, y", "published-fem"] == "38"


def words(page: str) -> str:
    """What is read in a page, figures included."""
    return re.sub(r"<[^>]+>", " ", re.sub(r"<(script|style)>.*?</\1>", "", page, flags=re.S))


def test_figures_and_tables_are_numbered_and_minus_signs_alike(page: str) -> None:
    for word, tag in (("Figure", "figcaption"), ("Table", "caption")):
        found = re.findall(rf"<{tag}><b>{word} (\d+)\.</b> \S", page)
        assert [int(n) for n in found] == list(range(1, page.count(f"<{tag}>") + 1))
        assert len(found) > 4
    assert not re.search(r"(?<![\w)\]–−-])-\d", words(page))
    assert "−" in words(page)


def test_the_first_page_says_what_was_reproduced_and_what_was_not(study: Study) -> None:
    fitted, measured, missing = summary(study)
    rows = {(r.quantity, r.axis): r for r in study.comparison.rows}

    def value(quantity: str, axis: str, column: str) -> float:
        found = rows[quantity, axis].value(column)
        assert found is not None
        return found

    main = "output displacement, transmission ratio, largest stress and natural frequency"
    assert f"Fitted: the geometry, to {main} of the published finite elements" in fitted
    # the largest difference of the only model that was run, found by hand
    off = max(
        100.0 * (value(q, axis, "lumped") / value(q, axis, "published-measured") - 1.0)
        for q, axis in (("output_displacement", "x"), ("output_displacement", "y"))
    )
    assert f"output displacement within {off:.1f} % (published FEM: 3.0 %)" in measured
    assert "motion errors (straightness in plane and straightness out of plane)" in missing


def test_motion_across_of_one_reconstruction_is_no_finding() -> None:
    """Another geometry that gives the published figures as well has half of it."""
    study = study_of("vgtu-piezo")
    # 0.11 and 0.20 um were measured
    compared = SimpleNamespace(stage=SimpleNamespace(axis_errors={"x": 0.121e-6, "y": 0.17e-6}))
    assert summary(replace(study, traditional=compared)) == summary(study)


@pytest.mark.usefixtures("undrawn")
def test_a_printed_ratio_that_its_own_displacements_contradict_is_named() -> None:
    study = study_of("vgtu-mechanical")
    fitted, _, missing = summary(study)
    assert "the printed FEM ratio 0.308 (the published displacements of x give 0.3187)" in missing
    assert "transmission ratio" not in fitted
    page = report_html(study)
    assert "0.308 †" in page
    # what the study prints of its own difference, and what its figures give
    row = next(
        r for r in study.comparison.rows if (r.quantity, r.axis) == ("output_displacement", "x")
    )
    own = row.difference_percent("published-measured", "published-analytic")
    assert own is not None
    assert f"printed 5.17 % below the analytic one; these figures give {-own:.2f} %" in page


def test_the_line_of_fatigue_and_its_safety_factor_agree(study: Study) -> None:
    allowed = pulsating_limit(study.stage.material)
    assert allowed is not None
    for axis in "xy":
        stress = study.main.characteristics.value("max_stress", axis)
        safety = study.main.characteristics.value("fatigue_safety", axis)
        assert safety * stress == pytest.approx(allowed, rel=1e-12)
    svg = encode(draw_stress(study.main), "svg").decode()
    assert f"pulsating fatigue limit {allowed / 1e6:.0f} MPa" in svg


@pytest.mark.usefixtures("undrawn")
def test_a_stack_without_a_voltage_range_says_why_it_is_not_tried() -> None:
    stage = design("vgtu-piezo")
    drives = tuple(replace(d, voltage_range=None) for d in stage.drives)
    study = run_study(replace(stage, drives=drives), model=["lumped"], parts="identification")
    assert set(study.skipped_experiments) == {"x", "y"}
    page = report_html(study)
    assert "Axis x was skipped: drive 'x' has no voltage range" in html.unescape(page)


def test_the_largest_error_of_a_drive_model_is_that_of_what_is_not_grey() -> None:
    time = np.linspace(0.0, 10.0, 1001)
    error = np.where(time < 0.8, 1170e-9, 718e-9) * np.sin(5.0 * time)
    step = IdentifiedStep(
        name="model x", axis="x", model=None, kind="bouc-wen", file=Path("m"),  # type: ignore[arg-type]
        errors_percent={}, time=time, voltage=time, measured=error, modelled=np.zeros_like(time),
        deviation=718e-9,
    )  # fmt: skip
    axes = draw_drive_fit(step).axes[1]
    grey = axes.patches[0].get_extents().transformed(axes.transData.inverted())
    assert grey.x1 == pytest.approx(1.0, abs=0.02)
    shown = axes.lines[1]
    late = np.asarray(shown.get_xdata()) > grey.x1
    assert np.abs(np.asarray(shown.get_ydata())[late]).max() <= 718.0 + 1e-6
    assert "718 nm at most after the grey part" in axes.get_title(loc="left")


@pytest.mark.usefixtures("undrawn")
def test_a_stage_of_which_nothing_is_published_says_what_is_known() -> None:
    study = study_of("parallelogram")
    size, motion, stress, nothing = summary(study)
    mass = sum(found.mass for found in mass_properties(study.stage).values())
    assert f"{mass:.3g} kg" in size
    assert "mm" in size
    frequency = study.analyses["lumped"].characteristics.value("natural_frequency_hz", "x")
    assert f"natural frequency {frequency:.1f} Hz in x" in motion
    assert "safety against yield" in stress
    assert nothing == "No reference data for this stage."
    page = report_html(study)
    assert "published, measured" not in page


def test_results_hold_the_tidy_table(study: Study) -> None:
    results = json.loads(results_json(study.to_dict()))
    ours = [r for r in results["characteristics"] if r["origin"] == "lumped"]
    assert {(r["quantity"], r["axis"]) for r in ours} >= {(q, a) for q in QUANTITIES for a in "xy"}
    named = ["quantity", "axis", "origin", "value", "unit", "uncertainty", "note", "failing"]
    named += ["kind", "fitted_to"]
    for r in results["characteristics"]:
        assert list(r) == named
    assert any(r["origin"] == "published-analytic" for r in results["characteristics"])
    lumped = results["models"]["lumped"]
    assert lumped["provenance"]["settings"]["plane"] == "strain"
    assert set(lumped["modes"]) == {"removed", "in place", "locked"}
    assert lumped["validity"]
    first = {c: lumped["modes"][c][0]["natural_frequency_hz"] for c in lumped["modes"]}
    # a spring, and then a held drive, can only raise the lowest frequency
    assert first["removed"] < first["in place"] < first["locked"]


def test_a_screw_stage_has_a_resolution() -> None:
    rows = study_of("vgtu-mechanical").characteristics
    assert {(r.axis, r.origin) for r in rows if r.quantity == "resolution"} >= {
        ("x", "lumped"),
        ("y", "lumped"),
    }


def test_the_other_plane_state_stands_beside(study: Study) -> None:
    assert list(study.variants) == ["lumped, plane stress"]
    soft = study.variants["lumped, plane stress"].modes["removed"].frequency_hz[0]
    hard = study.main.modes["removed"].frequency_hz[0]
    # both stiffness and frequency scale with E/(1 - nu^2) in the notches, nearly
    assert soft / hard == pytest.approx(np.sqrt(1.0 - 0.33**2), rel=0.01)


def test_plane_state_can_be_chosen() -> None:
    stage = design("vgtu-piezo")
    assert list(run_study(stage, model=["lumped"], plane="stress").variants) == [
        "lumped, plane strain"
    ]


@pytest.mark.parametrize("model", ["solids", "magic", ""])
def test_models_that_do_not_exist_are_refused(model: str) -> None:
    with pytest.raises(ModelError, match="one of lumped"):
        run_study(design("vgtu-piezo"), model=[model])


def test_no_model_is_refused() -> None:
    with pytest.raises(ModelError, match="no model"):
        run_study(design("vgtu-piezo"), model=[])


def test_mode_motion_is_scaled_to_one(study: Study) -> None:
    system = study.main.system
    shape = modes(system, drives="removed", count=1).shapes[:, 0]
    motion = mode_motion(system, shape, study.stage)
    # the first mode carries the platform along x; levers swing a little further than it
    ux, uy, angle = motion["PX"]
    assert 0.5 < abs(ux) < 1.0
    # the two halves of the stage are alike but for the rounding of their coordinates
    assert abs(uy) < 1e-4
    assert abs(angle) * 0.1 < 1e-3
    assert motion["G"] == (0.0, 0.0, 0.0)
    assert mode_motion(system, 7.0 * shape, study.stage)["PX"] == pytest.approx(motion["PX"])


@pytest.mark.parametrize("kind", FORMATS)
def test_the_drawing_is_the_same_every_time(kind: str) -> None:
    stage = design("parallelogram")
    first, second = (encode(draw_stage(stage), kind) for _ in range(2))
    assert first == second
    start = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[kind]
    assert first.startswith(start)


def test_the_drawing_names_everything() -> None:
    stage = design("vgtu-piezo")
    tree = ET.fromstring(encode(draw_stage(stage), "svg"))
    texts = {
        "".join(node.itertext()).strip() for node in tree.iter("{http://www.w3.org/2000/svg}text")
    }
    for thing in (*stage.bodies, *stage.hinges, *stage.drives, *stage.probes):
        assert thing.name in texts


@pytest.fixture(scope="module")
def many_peaks() -> Analysis:
    """Many close peaks, and the longest name of a model."""
    found = study_of("vgtu-mechanical").main
    return replace(found, system=replace(found.system, model="superelement-3d"))


@pytest.mark.parametrize("size", [(5.1, 5.0), (5.0, 3.1)], ids=["usual", "of the front page"])
def test_words_of_a_bode_diagram_have_room(many_peaks: Analysis, size: tuple[float, float]) -> None:
    figure = draw_bode(many_peaks, "x", size=size)
    figure.draw_without_rendering()
    for axes in figure.axes:
        drawn = axes.get_tightbbox()
        assert drawn is not None
        assert drawn.x1 <= figure.bbox.x1
        boxes = [text.get_window_extent() for text in axes.texts]
        for i, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[:i])
    assert sum(len(axes.texts) for axes in figure.axes) > 4


def test_figures_of_an_axis_that_does_not_exist_are_refused(study: Study) -> None:
    for draw in (draw_bode, draw_static_shape):
        with pytest.raises(ModelError, match="axis 'z'"):
            draw(study.main, "z")
    with pytest.raises(ModelError, match="svg, png, pdf"):
        encode(draw_stage(study.stage), "gif")


@pytest.mark.slow
def test_names_of_a_stage_cannot_break_the_page() -> None:
    base = design("parallelogram")
    odd = "$x^{ <script>alert(1)</script> & \"'</svg>"
    stage = replace(
        base,
        name=odd,
        title=odd,
        notes=(odd,),
        # yield below and close to fatigue: the words of both limits still have room
        material=material("Stainless steel 304"),
        hinges=tuple(replace(h, name=f"{odd}{i}") for i, h in enumerate(base.hinges)),
        drives=tuple(replace(d, name=odd) for d in base.drives),
        probes=tuple(replace(p, name=odd) for p in base.probes),
        axes=tuple(replace(a, name=odd, drive=odd, probe=odd) for a in base.axes),
    )
    page = report_html(run_study(stage))
    assert page.count("<script>") == 1
    assert set(Page(page).ids) >= ALWAYS


def test_a_stage_without_drives_still_has_a_report() -> None:
    stage = replace(design("parallelogram"), drives=(), axes=(), probes=())
    ids = Page(report_html(run_study(stage))).ids
    assert {"drawing", "modes", "hinges", "provenance"} <= set(ids)
    assert not {"bode", "static", "stress", "characteristics"} & set(ids)


def test_files_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("before")
    (tmp_path / "results.json").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_files(tmp_path, {"report.html": b"after", "results.json": b"{}"})
    assert (tmp_path / "report.html").read_text() == "before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "results.json"]


def test_a_write_that_breaks_off_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flexstage.files.write.os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_files(tmp_path / "new", {"a.txt": b"half"})
    assert not (tmp_path / "new").exists()


def test_words_in_figures_keep_their_digits() -> None:
    # coordinates of the picture are shortened, what is printed in it is not
    study = study_of("parallelogram")
    svg = inline_svg(draw_stroke(study.paths["x"], "x"), "s", "t")
    words = " ".join(re.findall(r">([^<>]+)<", svg))
    assert f"rotation {study.paths['x'].parasitic_rotation * 1e6:.3f} µrad" in words
    assert not re.search(r'="[^"#]*\d\.\d{3}', svg)


def test_straightness_follows_the_arc_of_the_legs() -> None:
    # the platform sinks by d^2/(2 l) on legs whose necks are l apart
    rows = study_of("parallelogram").characteristics
    row = next(r for r in rows if (r.quantity, r.axis) == ("straightness", "x"))
    length, stroke = 30e-3, 200e-6
    # a parabola leaves a quarter of its rise between itself and any line parallel to its chord
    assert row.value == pytest.approx(stroke**2 / (2 * length) / 4, rel=0.01)
    assert row.origin == "lumped"


def test_hinges_that_bend_over_a_length_shorten() -> None:
    stage = design("parallelogram")
    leaf = Leaf(neck_thickness=0.5e-3, leaf_length=4e-3, notch_depth=2e-3)
    bent = replace(stage, hinges=tuple(replace(h, profile=leaf) for h in stage.hinges))
    study = run_study(bent)
    rows = {r.quantity: r.value for r in study.characteristics if r.axis == "x"}
    # two springs 30 mm apart turn a bar between them, and each is longer by theta^2 l/12
    # roots in a wide face bend like 0.41 thicknesses of a leaf
    travel, bar, length = rows["output_displacement"], 30e-3, 4e-3 + 2.0 * 0.41 * 0.5e-3
    sag = travel**2 / (2.0 * bar) * (1.0 - length / (3.0 * bar))
    assert rows["straightness"] == pytest.approx(0.25 * sag, rel=0.01)


def test_what_is_zero_but_for_rounding_is_no_difference(study: Study) -> None:
    row = next(r for r in study.comparison.rows if (r.quantity, r.axis) == ("straightness", "x"))
    assert row.value("published-measured") == pytest.approx(0.11e-6)
    assert row.difference_percent("lumped", "published-measured") is None
