"""What each figure is, and that a difference is printed between like things only."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest

from flexstage.base.errors import ModelError
from flexstage.hysteresis.loops import Tracking
from flexstage.quantities.characteristic import Characteristic, Characteristics, kind_of
from flexstage.quantities.comparison import ComparisonRow
from flexstage.quantities.quantity import QUANTITIES, display
from flexstage.quantities.table import Table
from flexstage.report import report_html
from flexstage.report.findings import front_page, measured, summary
from flexstage.report.study_sections import hysteresis_section
from flexstage.report.tables import characteristics_table, differences_table, published_table
from flexstage.stage.designs import DESIGNS, design
from flexstage.studies import Study
from flexstage.studies.measurement import compare_with_references
from tests.studies import study_of
from tests.system.test_measurement_report import as_measured, characterised
from tests.system.test_report import Page
from tests.undrawn import without_figures

STAGES = ("vgtu-mechanical", "vgtu-piezo")
#: Titles of published columns, in every table.
PUBLISHED = {
    "analytic": "published-analytic",
    "FEM": "published-fem",
    "published FEM": "published-fem",
    "measured": "published-measured",
}
COMPUTED = ("predicted", "fitted", "given")

Difference = tuple[ComparisonRow, str, str, str]


def rows_of(study: Study, label: str, axes: str) -> Iterator[ComparisonRow]:
    """The rows of a quantity by its label, without unit, and of the axes of a line."""
    for row in study.comparison.rows:
        if display(row.quantity).label == label.partition(" [")[0] and row.axis in axes.split(", "):
            yield row


def columns_of(study: Study, table: Table) -> dict[int, tuple[str, str]]:
    """The two origins that each column of differences compares, by its place."""
    pairs = {}
    for k, column in enumerate(table.columns):
        title = column.heading.replace("\u00ad", "")
        one, to, other = title.partition(" to ")
        if column.group.startswith("to "):
            pairs[k] = (title, PUBLISHED[column.group.removeprefix("to ")])
        elif title.startswith("prediction error"):
            pairs[k] = (study.main.system.model, "published-measured")
        elif title.startswith("difference"):
            pairs[k] = (study.main.system.model, PUBLISHED[other])
        elif to:
            pairs[k] = (PUBLISHED[one], PUBLISHED[other])
    return pairs


def differences(study: Study) -> Iterator[Difference]:
    """Every difference in the tables of a report: its row, both origins, and the text."""
    for table in (
        front_page(study).table,
        differences_table(study.comparison),
        published_table(study.comparison),
    ):
        assert table is not None
        columns = columns_of(study, table)
        assert columns, table.caption
        for line in table.rows:
            for row in rows_of(study, line[0].text, line[1].text):
                for k, (one, other) in columns.items():
                    if line[k].text not in ("", "–"):
                        yield row, one, other, line[k].text


def kind(study: Study, row: ComparisonRow, column: str, reference: str) -> str:
    """What a figure is next to another one, by the rules of the manual."""
    if column == "published-measured":
        return "measured"
    if row.quantity == "input_displacement":
        return "given"
    key = (row.quantity, row.axis, reference)
    known = [r for r in study.stage.published if (r.quantity, r.axis, r.origin) == key]
    return "fitted" if column in study.analyses and any(r.fitted for r in known) else "predicted"


@pytest.mark.parametrize("name", STAGES)
def test_a_difference_stands_between_like_things(name: str) -> None:
    study = study_of(name)
    found = list(differences(study))
    assert len(found) > 20
    for row, one, other, text in found:
        kinds = {kind(study, row, one, other), kind(study, row, other, one)}
        assert kinds in ({"predicted"}, {"given"}, {"measured", "predicted"}), (row, one, other)
        assert text.replace("−", "-").removesuffix(" %").lstrip("+-").replace(".", "").isdigit()
    # a prediction and a measurement are compared, and so are two computations
    pairs = {(one, other) for _, one, other, _ in found}
    assert {("lumped", "published-measured"), ("lumped", "published-analytic")} <= pairs
    # every finite-element figure was fitted to
    assert ("lumped", "published-fem") not in pairs


@pytest.mark.parametrize("name", STAGES)
def test_every_figure_of_a_report_says_what_it_is(name: str) -> None:
    study = study_of(name)
    cells = [cell for cell, _ in Page(without_figures(report_html, study)).cells]
    assert len(cells) > 50
    for cell in cells:
        column, axis = cell["data-column"], cell["data-axis"].split(", ")[0]
        (row,) = (
            r
            for r in study.comparison.rows
            if (r.quantity, r.axis) == (cell["data-quantity"], axis) and column in r.cells
        )
        shown = kind_of(row.cells[column], study.stage.published)
        assert cell["data-kind"] == shown
        assert column != "published-measured" or shown == "measured"
    table = characteristics_table(study.comparison, QUANTITIES, "")
    assert table is not None
    place = [column.heading for column in table.columns].index("kind")
    for line in table.rows:
        assert line[place].text.split(" ")[0] in COMPUTED
    said = {(line[0].text, line[1].text): line[place].text for line in table.rows}
    assert said["Natural frequency [Hz]", "x"] == "fitted to FEM"
    assert said["Input displacement [µm]", "x, y"] == "given"
    assert said["Input stiffness [N/µm]", "y"] == "predicted"
    rows = study.to_dict()["characteristics"]
    for row in rows:
        assert (row["kind"] == "fitted") == bool(row["fitted_to"])
    assert {row["kind"] for row in rows} == {"measured", "predicted", "fitted", "given"}


def test_a_resolution_that_a_step_was_inferred_from_is_no_prediction() -> None:
    study = study_of("vgtu-mechanical")
    assert not [row for row, one, _, _ in differences(study)
                if row.quantity == "resolution" and one in study.analyses]  # fmt: skip
    rows = [r for r in study.to_dict()["characteristics"] if r["quantity"] == "resolution"]
    ours = [r for r in rows if r["origin"] == "lumped"]
    assert [r["kind"] for r in ours] == ["fitted", "fitted"]
    assert ours[0]["fitted_to"] == ["published-analytic", "published-fem"]


def test_a_simulated_loop_is_not_set_against_a_measured_one() -> None:
    tracking = Tracking(loop_width=0.16e-6, rms=1e-7, largest=2e-7)
    run = SimpleNamespace(title="Bouc-Wen", tracking=tracking, reduction_percent=98.0)
    one = SimpleNamespace(axis="x", open_loop=tracking, runs=(run,), deviation=1.02e-6)
    study = replace(study_of("vgtu-piezo"), experiments={"x": one})
    (simulated,) = (s for s in summary(study) if "98.0 %" in s)
    assert simulated.startswith("Simulated, not measured:")
    assert "published" not in simulated
    assert not any("93.9" in s for s in summary(study))
    table = front_page(study).table
    assert table is not None
    assert not any("loop" in line[0].text.lower() for line in table.rows)
    (loops,) = (part for part in hysteresis_section(study) if isinstance(part, Table))
    kinds = {line[0].text: line[1].text for line in loops.rows}
    assert kinds == {
        "x, open loop": "simulated",
        "x, inverse of Bouc-Wen": "simulated",
        "x, published, open loop": "measured",
        "x, published, inverse of Bouc-Wen": "measured",
    }


def test_a_simulated_measurement_is_compared_with_nothing() -> None:
    stage = design("vgtu-mechanical")
    simulated = characterised(stage, kinds=("spheres",))
    references = Characteristics(study_of("vgtu-mechanical").characteristics)
    found = compare_with_references(simulated, stage, references)
    assert any(row.references for row in found.rows)
    assert not any(row.differences for row in found.rows)
    assert {row["kind"] for row in found.to_dict()["characteristics"]} == {"simulated"}
    real = compare_with_references(as_measured(simulated), stage, references)
    assert {row["kind"] for row in real.to_dict()["characteristics"]} == {"measured"}
    stroke = next(r for r in real.rows if r.figure.quantity == "output_displacement")
    assert {"published-measured", "published-fem", "lumped"} <= set(stroke.differences)


def test_a_stage_whose_figures_were_fitted_to_nothing_is_a_prediction() -> None:
    study = study_of("vgtu-piezo")
    own = tuple(replace(row, fitted=False) for row in study.stage.published)
    found = replace(study, stage=replace(study.stage, published=own))
    reproduced, predicted, _ = summary(found)
    rows = {(r.quantity, r.axis): r for r in found.comparison.rows}
    worst = max(
        abs(100.0 * (ours / printed - 1.0))
        for quantity in (
            "output_displacement", "transmission_ratio", "max_stress", "natural_frequency_hz"
        )
        for axis in "xy"
        if (ours := rows[quantity, axis].value("lumped"))
        and (printed := rows[quantity, axis].value("published-fem"))
    )  # fmt: skip
    assert f"within {worst:.1f} % (rigid-body model)" in reproduced
    assert "fitted" not in predicted
    table = front_page(found).table
    assert table is not None
    assert "difference to published FEM" in [column.heading for column in table.columns]
    # a fit to the measurement predicts none of it
    fitted = tuple(replace(r, fitted=r.origin == "published-measured") for r in own)
    study = replace(study, stage=replace(study.stage, published=fitted))
    assert "(prediction none)" in measured(study)
    assert not any(other == "published-measured" for _, one, other, _ in differences(study)
                   if one == "lumped")  # fmt: skip


def test_only_published_figures_can_be_fitted_to() -> None:
    for name in DESIGNS:
        for row in design(name).published:
            elements = row.origin == "published-fem" and row.quantity != "input_displacement"
            assert row.fitted == (elements or row.quantity == "resolution"), row
    with pytest.raises(ModelError, match="only a published figure can be fitted to"):
        Characteristic(
            quantity="resolution", axis="x", origin="measured", value=1e-8, unit="m", fitted=True
        )
