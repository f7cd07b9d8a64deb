"""Sweeps against the single analysis; what is no stage; files that give back the same bits."""

import csv
import io
import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.lumped import lumped_system
from flexstage.report.figures.sweep import draw_indices, draw_sweep
from flexstage.report.result_files import sweep_csv, sweep_parquet
from flexstage.report.sweep import sweep_html, sweep_notes, sweep_tables
from flexstage.report.tables import LUMPED_NOTE
from flexstage.stage import write_stage
from flexstage.stage.designs import StageTemplate, find_stage
from flexstage.stage.seat import FlatSeat, Preload
from flexstage.studies.explore import (
    Family,
    Figure,
    SweepPlan,
    figure_of,
    known_figures,
    open_workers,
    sweep,
    usual_plan,
    variables_of,
)
from flexstage.studies.explore import workers as workers_module
from flexstage.system import analyse

FREQUENCY = Figure(quantity="natural_frequency_hz", axis="x")
STRESS = Figure(quantity="max_stress", axis="x")
RATIO = Figure(quantity="transmission_ratio", axis="x")


def family(source, *texts):
    template = StageTemplate.of(source)
    return Family(template=template, variables=variables_of(template, texts))


@pytest.fixture(scope="module")
def over_neck():
    """The piezo stage over one neck."""
    return sweep(
        family("vgtu-piezo", "x.lever_neck=0.37..0.71 mm/5"),
        [RATIO, FREQUENCY, STRESS, Figure(quantity="cross_coupling", axis="x")],
        SweepPlan(sampling="grid", samples=5),
    )


@pytest.fixture(scope="module")
def over_legs():
    """The parallelogram over spacing and neck of its legs, below what its bolts leave room for."""
    return sweep(
        family("parallelogram", "leg_spacing=6..46 mm", "leg.notch.neck_thickness=0.31..0.52 mm/4"),
        [FREQUENCY, STRESS],
        SweepPlan(sampling="grid", samples=36),
    )


@pytest.fixture(scope="module")
def with_indices():
    """Sobol' indices of the parallelogram."""
    return sweep(
        family(
            "parallelogram", "leg_spacing=10 %", "leg.notch.neck_thickness=10 %", "thickness=5%"
        ),
        [RATIO, FREQUENCY, STRESS],
        SweepPlan(sampling="sobol", samples=30, seed=3, indices=True),
    )


def test_each_point_is_the_single_analysis(over_neck):
    for point, values in zip(over_neck.points, over_neck.values, strict=True):
        stage = find_stage("vgtu-piezo", {"x.lever_neck": f"{float(point[0])!r} m"})
        rows = analyse(stage, lumped_system(stage)).characteristics
        single = [rows.value(figure.quantity, figure.axis) for figure in over_neck.figures]
        assert values[:3] == pytest.approx(single[:3], rel=1e-9)
        assert abs(values[3] - single[3]) < 1e-9
    described = known_figures(find_stage("vgtu-piezo"))
    wanted = [described[figure.key] for figure in over_neck.figures[:3]]
    assert over_neck.described[:3] == pytest.approx(wanted, rel=1e-9)


def test_what_is_found_in_short(over_neck):
    assert over_neck.constant.tolist() == [False, False, False, True]
    assert over_neck.varying == (0, 1, 2)
    assert over_neck.least[1:3] == (0, 0)
    assert over_neck.greatest[1:3] == (4, 4)
    # a thicker neck is stiffer all the way, and lets less through
    assert over_neck.correlations[:3, 0] == pytest.approx([-1.0, 1.0, 1.0])
    assert math.isnan(over_neck.correlations[3, 0])
    assert over_neck.possible.all()
    assert over_neck.advice == ""
    assert sweep_notes(over_neck) == (
        "variation below 0.1 %: cross_coupling.x",
        LUMPED_NOTE,
    )
    assert sweep_notes(replace(over_neck, model="superelement")) == sweep_notes(over_neck)[:1]


def test_rounding_moves_nothing():
    # the axes of the piezo stage are in series: legs of y are not in the ratio of x
    found = sweep(
        family("vgtu-piezo", "x.actuator.free_stroke=30..45 um/3", "y.leg_neck=10 %/3"),
        [Figure(quantity="output_displacement", axis="x")],
        SweepPlan(sampling="grid", samples=9),
    )
    assert found.correlations[0] == pytest.approx([1.0, 0.0], abs=1e-12)
    assert found.variables[0].heading == "x.actuator.free_stroke [µm]"


def test_a_stiffer_material_scales_as_it_must(tmp_path):
    # M q'' + K q = 0 and K ~ E: frequencies go with the square root of E, stress of an imposed
    # motion with E, and the ratio not at all (Buckingham 1914: there is no other modulus)
    text = StageTemplate.of("vgtu-piezo").text({})
    material = "{name: trial, youngs_modulus: = E, poissons_ratio: 0.31, density: 2810 kg/m^3, "
    material += "yield_strength: 500 MPa, source: none}"
    lines = [
        f"  material: {material}" if line.strip().startswith("material:") else line
        for line in text.splitlines()
    ]
    at = next(i for i, line in enumerate(lines) if line.startswith("design:"))
    file = tmp_path / "stage.yaml"
    file.write_text("\n".join([*lines[:at], "parameters: {E: 71 GPa}", *lines[at:]]), "utf-8")
    found = sweep(
        family(file, "E=60..240 GPa/3"),
        [RATIO, FREQUENCY, STRESS],
        SweepPlan(sampling="grid", samples=3),
    )
    share = found.points[:, 0] / found.points[0, 0]
    assert share.tolist() == [1.0, 2.5, 4.0]
    assert found.values[:, 0] == pytest.approx(found.values[0, 0], rel=1e-9)
    assert found.values[:, 1] == pytest.approx(np.sqrt(share) * found.values[0, 1], rel=1e-9)
    assert found.values[:, 2] == pytest.approx(share * found.values[0, 2], rel=1e-9)
    assert found.constant.tolist() == [True, False, False]


def test_what_is_no_stage_stays_with_its_reason(over_legs):
    assert over_legs.counts == (9, 4)
    spacing = over_legs.points[:, 0]
    assert (over_legs.possible == (spacing >= 11e-3)).all()
    assert np.isnan(over_legs.values[~over_legs.possible]).all()
    assert np.isfinite(over_legs.values[over_legs.possible]).all()
    (reason,) = over_legs.common_faults
    assert reason.count == 4
    assert reason.text.startswith("leg_spacing must be at least 11 mm")
    assert over_legs.advice == "leg_spacing >= 11 mm excludes 100 % of the impossible stages"
    assert sweep_notes(over_legs)[:2] == (
        "4 of 36 points are infeasible",
        f"4 of them: {reason.text}",
    )
    assert over_legs.on_grid(0).shape == (9, 4)
    assert np.isnan(over_legs.on_grid(0)).all(axis=1).tolist() == [True] + 8 * [False]


def test_where_nothing_is_possible_it_is_said():
    with pytest.raises(ModelError, match=r"all 3 stages are impossible; 3 of them: leg"):
        sweep(
            family("parallelogram", "leg_spacing=5..8 mm"),
            [FREQUENCY],
            SweepPlan(sampling="grid", samples=3),
        )


def test_indices_of_a_guide(with_indices):
    found = with_indices.indices
    assert len(with_indices.points) == 32 * 5
    assert with_indices.notes == (
        "32 base samples instead of 30: the length of a Sobol' sequence is a power of 2",
    )
    # a straight guide has the ratio 1 whatever its legs: nothing has a share in what does not vary
    assert np.isnan(found.total[0]).all()
    # a neck of circular profile bends with t^(5/2) (Paros and Weisbord 1965), the inertia changes
    # little: the neck has nearly all of the frequency
    assert found.total[1].argmax() == 1
    assert found.total[1, 1] > 0.8
    # nothing but rounding separates one variable at a time from all
    assert found.first[1].sum() == pytest.approx(1.0, abs=0.05)


def test_an_interval_beyond_1_is_told_and_not_cut(with_indices):
    found = with_indices.indices
    ends = ("first_low", "first_high", "total_low", "total_high")
    inside = {name: np.clip(getattr(found, name), 0.0, 1.0) for name in ends}
    for name, end, shown in (("total_high", 1.06, "1.06"), ("first_low", -0.02, "-0.02")):
        changed = inside[name].copy()
        changed[1, 1] = end
        within, beyond = (
            replace(with_indices, indices=replace(found, **parts))
            for parts in (inside, inside | {name: changed})
        )
        said = [
            any("an index is between 0 and 1" in n for n in sweep_notes(s))
            for s in (within, beyond)
        ]
        assert said == [False, True]
        table = list(sweep_tables(beyond))[-1]
        assert any(shown in cell.text for row in table.rows for cell in row)


def test_what_is_rounding_has_no_indices():
    # both halves of the stage are mirror images: what one axis does to the other is rounding
    found = sweep(
        family("vgtu-piezo", "x.lever_neck=5 %"),
        [Figure(quantity="cross_coupling", axis="x"), FREQUENCY],
        SweepPlan(sampling="sobol", samples=16, indices=True),
    )
    assert 0.0 < np.abs(found.values[:, 0]).max() < 1e-9
    assert np.isnan(found.indices.first[0]).all()
    assert found.indices.total[1] == pytest.approx([1.0], abs=0.01)


def test_no_indices_where_much_is_impossible():
    found = sweep(
        family("parallelogram", "leg_spacing=6..46 mm", "leg.notch.neck_thickness=10 %"),
        [FREQUENCY],
        SweepPlan(sampling="sobol", samples=16, indices=True),
    )
    assert found.indices is None
    assert found.notes[0].startswith("no Sobol' indices: ")
    assert "bounds within which nearly every stage is possible" in found.notes[0]
    assert any(note.startswith("leg_spacing >=") for note in sweep_notes(found))
    assert found.to_dict()["indices"] is None


def test_indices_need_their_own_points():
    with pytest.raises(
        ModelError, match="Sobol' indices need points of a Sobol' sequence, got 'gr"
    ):
        SweepPlan(sampling="grid", samples=16, indices=True)


@pytest.mark.parametrize(
    ("count", "options", "wanted"),
    [
        (1, {}, ("grid", 25)),
        (2, {}, ("grid", 400)),
        (3, {}, ("sobol", 256)),
        (2, {"indices": True}, ("sobol", 256)),
        (2, {"sampling": "latin-hypercube"}, ("latin-hypercube", 256)),
        (3, {"samples": 40, "sampling": "grid"}, ("grid", 40)),
    ],
)
def test_what_is_left_open_is_chosen(count, options, wanted):
    texts = ["leg_spacing=10 %", "leg.notch.neck_thickness=10 %", "thickness=5 %"][:count]
    plan = usual_plan(family("parallelogram", *texts).variables, "lumped", **options)
    assert (plan.sampling, plan.samples) == wanted


@pytest.mark.slow
def test_two_workers_give_the_bits_of_one(over_legs, monkeypatch):
    monkeypatch.setattr(workers_module, "_FIRST_ESTIMATE", 0.0)
    monkeypatch.setattr(workers_module, "_WORTH_SHARING", 0.0)
    legs = family(
        "parallelogram", "leg_spacing=6..46 mm", "leg.notch.neck_thickness=0.31..0.52 mm/4"
    )
    with open_workers(2) as workers:
        shared = sweep(legs, over_legs.figures, over_legs.plan, workers=workers)
    assert shared.values.tobytes() == over_legs.values.tobytes()
    assert shared.faults == over_legs.faults


@pytest.mark.slow
def test_the_superelement_model_is_swept(tmp_path):
    found = sweep(
        family("parallelogram", "leg.notch.neck_thickness=0.31..0.52 mm/3"),
        [FREQUENCY, STRESS],
        SweepPlan(sampling="grid", samples=3),
        model="superelement",
    )
    from flexstage.studies import analyse_model

    stage = find_stage(
        "parallelogram", {"leg.notch.neck_thickness": f"{float(found.points[1, 0])!r} m"}
    )
    rows = analyse_model(stage, "superelement").characteristics
    single = [rows.value(figure.quantity, figure.axis) for figure in found.figures]
    assert found.values[1] == pytest.approx(single, rel=1e-6)


def test_text_gives_back_the_same_bits(over_legs):
    head, *rows = csv.reader(io.StringIO(sweep_csv(over_legs).decode()))
    assert head == [
        "leg_spacing [m]",
        "leg.notch.neck_thickness [m]",
        "natural_frequency.x [Hz]",
        "max_stress.x [Pa]",
        "fault",
    ]
    numbers = np.array([[float(word or "nan") for word in row[:4]] for row in rows])
    assert numbers[:, :2].tobytes() == over_legs.points.tobytes()
    possible = over_legs.possible
    assert numbers[possible, 2:].tobytes() == over_legs.values[possible].tobytes()
    assert np.isnan(numbers[~possible, 2:]).all()
    assert [row[4] for row in rows] == list(over_legs.faults)


def test_parquet_gives_back_the_same_bits_units_and_origin(over_legs):
    parquet = pytest.importorskip("pyarrow.parquet")
    found = parquet.read_table(io.BytesIO(sweep_parquet(over_legs)))
    assert found.column_names == [
        "leg_spacing",
        "leg.notch.neck_thickness",
        "natural_frequency.x",
        "max_stress.x",
        "fault",
    ]
    columns = [found.column(i).to_numpy() for i in range(4)]
    assert np.stack(columns[:2], axis=1).tobytes() == over_legs.points.tobytes()
    possible = over_legs.possible
    values = np.stack(columns[2:], axis=1)
    assert values[possible].tobytes() == over_legs.values[possible].tobytes()
    assert found.column(2).null_count == 4
    assert [fault or "" for fault in found.column("fault").to_pylist()] == list(over_legs.faults)
    units = [found.schema.field(i).metadata[b"unit"].decode() for i in range(4)]
    assert units == ["m", "m", "Hz", "Pa"]
    about = json.loads(found.schema.metadata[b"flexstage"])
    assert about["provenance"]["input_hash"] == over_legs.provenance.input_hash
    first = about["variables"][0]
    assert (first["low"], first["high"]) == (0.006, 0.046)
    assert "columns" not in about
    assert about["points"] == {"all": 36, "possible": 32}


def test_without_pyarrow_a_sentence_says_what_to_install(over_neck, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ModelError, match=r'pip install "flexstage\[explore\]"'):
        sweep_parquet(over_neck)


def test_results_are_plain_data(over_legs):
    told = json.loads(json.dumps(over_legs.to_dict(), allow_nan=False))
    assert told["plan"]["counts"] == [9, 4]
    assert told["variables"][1]["unit"] == "m"
    first = told["figures"][0]
    at = first["greatest"]
    assert at["value"] == np.nanmax(over_legs.values[:, 0])
    assert list(at["at"].values()) == over_legs.points[at["row"]].tolist()
    assert first["rank_correlation"]["leg.notch.neck_thickness"] > 0.5
    assert told["columns"]["natural_frequency.x"][0] is None
    assert told["columns"]["leg_spacing"] == over_legs.points[:, 0].tolist()


def drawn_titles(figure):
    return [axes.get_title("left") for axes in figure.axes if axes.get_title("left")]


def test_curves_are_drawn_of_what_varies(over_neck):
    figure = draw_sweep(over_neck)
    assert drawn_titles(figure) == [
        "Transmission ratio x",
        "Natural frequency x [Hz]",
        "Largest stress x [MPa]",
    ]
    curve, usual, mark = figure.axes[1].lines
    assert curve.get_ydata() == pytest.approx(over_neck.values[:, 1])
    assert curve.get_xdata() == pytest.approx(1e3 * over_neck.points[:, 0])
    assert usual.get_xdata()[0] == pytest.approx(0.55)
    assert mark.get_ydata()[0] == pytest.approx(over_neck.described[1])


def test_maps_leave_out_what_is_no_stage(over_legs):
    figure = draw_sweep(over_legs)
    # legs move the stress of a given stroke by their necks
    assert drawn_titles(figure) == ["Natural frequency x [Hz]", "Largest stress x [MPa]"]
    axes = figure.axes[0]
    shown = [path.vertices[:, 0] for area in axes.collections for path in area.get_paths()]
    assert min(map(np.min, (x for x in shown if len(x)))) == pytest.approx(11.0)
    assert [patch.get_hatch() for patch in axes.patches] == ["////"]
    words = {text.get_text() for text in figure.legends[0].get_texts()}
    assert words == {"stage as described", "infeasible"}


def test_many_variables_are_a_matrix(with_indices):
    figure = draw_sweep(with_indices)
    for axes in figure.axes:
        (low, high), x = axes.get_xlim(), axes.lines[0].get_xdata()
        # every point is in sight, and they fill the range
        assert low <= x.min() < x.max() <= high < low + 1.3 * np.ptp(x)
    assert len(figure.axes) == 2 * 3
    bars = draw_indices(with_indices)
    assert drawn_titles(bars) == ["Natural frequency x", "Largest stress x"]
    widths = [bar.get_width() for bar in bars.axes[0].patches]
    assert widths[3:] == pytest.approx(with_indices.indices.total[1])


def test_tables_say_what_moves_what(over_neck, with_indices):
    rows, ranges = sweep_tables(over_neck)
    assert [row[0].text for row in rows.rows] == ["0.370", "0.455", "0.540", "0.625", "0.710"]
    assert ranges.rows[1][-1].text == "+1.00"
    indices = list(sweep_tables(with_indices))[-1]
    assert indices.rows[0][1].text == "leg.notch.neck_thickness"


def test_the_page_needs_nothing_else(over_legs):
    pytest.importorskip("plotly")
    page = sweep_html(over_legs)
    assert page.count('<section id="') == 3
    assert "Each line is one of 32 stages." in page
    assert "4 infeasible points are omitted." in page
    # what a library would load from elsewhere is not asked for
    assert " src=" not in page.replace("<script", "\n<script").split("Plotly.newPlot")[1]
    assert "default-src 'none'" in page
    # the lines are the points, in the units of their headings
    data = page.split('"parallel-coordinates",', 1)[1].lstrip()
    (lines,), _ = json.JSONDecoder().raw_decode(data)
    kept = over_legs.possible
    for axis, column in zip(
        lines["dimensions"],
        (*(1e3 * over_legs.points.T), over_legs.values[:, 0], 1e-6 * over_legs.values[:, 1]),
        strict=True,
    ):
        assert axis["values"] == pytest.approx(column[kept].tolist(), rel=1e-5)
    assert [axis["label"] for axis in lines["dimensions"]][1:3] == [
        "leg.notch.neck_<br>thickness [mm]",
        "Natural<br>frequency x [Hz]",
    ]
    # its code stands as it is: a hyphen in it is no minus sign
    assert "−1" not in page.partition("<section")[0].partition("</nav>")[2]


def test_figures_are_found_by_name():
    known = known_figures(find_stage("parallelogram"))
    assert figure_of("stroke.x", known).name == "output_displacement.x"


def test_preload_and_roughness_of_a_seat_are_parameters_of_a_file(tmp_path):
    file, stage = tmp_path / "seated.yaml", find_stage("bridge")
    seat = FlatSeat(roughness_length=0.72e-6)
    drive = replace(stage.drives[0], seats=(seat,), preload=Preload(force=5.0))
    write_stage(replace(stage, drives=(drive,)), file)
    text = file.read_text().replace("0.00072 mm", "= rough").replace("force: 5 N", "force: = F")
    assert "= rough" in text
    assert "= F" in text
    file.write_text(f"{text}\nparameters:\n  F: 5 N\n  rough: 0.72 um\n")
    seated = sweep(
        family(str(file), "F=1..9 N/2", "rough=0.1..0.72 um/2"),
        [Figure(quantity="working_displacement", axis="y")],
        SweepPlan(sampling="grid", samples=4),
    )
    for point, (value,) in zip(seated.points.tolist(), seated.values.tolist(), strict=True):
        contact = FlatSeat(roughness_length=point[1])
        alone = replace(drive, seats=(contact,), preload=Preload(force=point[0]))
        one = replace(stage, drives=(alone,))
        table = analyse(one, lumped_system(one)).characteristics
        assert value == pytest.approx(table.value("working_displacement", "y"), rel=1e-9)
