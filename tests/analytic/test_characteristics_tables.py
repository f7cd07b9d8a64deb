"""Tables of characteristics, read back by other libraries: every number, unit and word."""

import csv
import io
import math
import re
import sys
from types import ModuleType
from typing import Any

import pytest

from flexstage.export.tables import table_files
from flexstage.lumped import lumped_system
from flexstage.quantities.characteristic import ORIGINS, Characteristic
from flexstage.quantities.quantity import QUANTITIES, display, value_and_uncertainty
from flexstage.quantities.table import Cell, table
from flexstage.stage.designs import design
from flexstage.studies import compare
from flexstage.system import analyse

STAGE = design("vgtu-piezo")
NASTY = '=SUM(A1:A9), "quoted" & 50 % of $x_1$ {~^\\#}\nsecond line, µ'


def row(quantity: str, axis: str, origin: str, value: float, unit: str, **more: Any) -> Any:
    return Characteristic(
        quantity=quantity, axis=axis, origin=origin, value=value, unit=unit, **more
    )


ROWS = (
    row("output_displacement", "x", "published-fem", 64.6e-6, "m", note="printed"),
    row("output_displacement", "x", "lumped", 1.0 / 3.0 * 2e-4, "m", note=NASTY),
    row(
        "output_displacement", "x", "measured", 63.1234567e-6, "m", uncertainty=0.0671e-6,
        degrees_of_freedom=7.5,
    ),
    row("natural_frequency_hz", "y", "measured", 338.9104, "Hz", uncertainty=0.243),
    row("natural_frequency_hz", "y", "solid", 341.0, "Hz"),
    row("cross_coupling", "x", "lumped", -2.8e-15, "1"),
    row("safety_factor", "x", "lumped", math.inf, "1"),
    row("input_stiffness", "x", "lumped", 5520153.068222156, "N/m", note="drives removed"),
    row("input_stiffness", "x", "lumped", 6520153.0, "N/m", note="drives in place"),
)  # fmt: skip


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return table_files(ROWS, name="my stage")


def test_csv_gives_back_every_value_to_the_bit(files: dict[str, bytes]) -> None:
    text = files["my-stage-values.csv"].decode()
    lines = list(csv.DictReader(io.StringIO(text, newline="")))
    assert len(lines) == len(ROWS)
    for line, c in zip(lines, ROWS, strict=True):
        assert float(line["value"]) == c.value
        known = line["uncertainty"], line["degrees_of_freedom"]
        assert tuple(float(w) if w else None for w in known) == (
            c.uncertainty,
            c.degrees_of_freedom,
        )
        words = [line[k] for k in ("quantity", "axis", "origin", "unit", "note")]
        assert words == [c.quantity, c.axis, c.origin, c.unit, c.note]


def test_csv_is_as_rfc_4180_has_it(files: dict[str, bytes]) -> None:
    for name in ("my-stage-values.csv", "my-stage-comparison.csv"):
        text = files[name].decode()
        assert text.endswith("\r\n")
        # outside quotes lines end with both characters, and there are no bare ones
        plain = re.sub(r'"(?:[^"]|"")*"', "quoted", text)
        assert plain.count("\r") == plain.count("\n") == plain.count("\r\n")
        assert '"' not in plain
        (width,) = {line.count(",") for line in plain.strip().split("\r\n")}
        assert width == text.split("\r\n", 1)[0].count(",")


def test_comparison_has_a_column_for_each_origin(files: dict[str, bytes]) -> None:
    lines = list(csv.DictReader(io.StringIO(files["my-stage-comparison.csv"].decode())))
    head = list(lines[0])
    assert head[4:] == [
        "published-fem", "lumped", "solid", "measured", "measured uncertainty",
    ]  # fmt: skip
    first = lines[0]
    assert (first["quantity"], first["unit"]) == ("output_displacement", "m")
    assert [float(first[o]) for o in head[4:6]] == [64.6e-6, 1.0 / 3.0 * 2e-4]
    assert first["solid"] == ""
    assert float(first["measured uncertainty"]) == 0.0671e-6
    # two values of one origin stand below each other, told apart by their notes
    stiff = [line for line in lines if line["quantity"] == "input_stiffness"]
    assert [line["condition"] for line in stiff] == ["drives removed", "drives in place"]


def test_tables_are_data_frames_of_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = ModuleType("pandas")
    stand_in.DataFrame = lambda data, **more: (data, more)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    found: Any = compare(ROWS)
    columns, more = found.to_frame()
    assert more == {}
    assert columns["quantity"][0] == "output_displacement"
    assert columns["lumped"][0] == 1.0 / 3.0 * 2e-4
    assert columns["solid"][0] is None
    assert columns["measured uncertainty"][0] == 0.0671e-6
    shown: Any = table("", ("", "<", "value"), [("a", "b", Cell("1.23", value=1.2345))])
    assert shown.to_frame() == ([["a", "b", 1.2345]], {"columns": ["", "", "value"]})


def test_columns_and_rows_are_those_of_the_report() -> None:
    """The report's own comparison, in another room, of a stage with published figures."""
    analysis = analyse(STAGE, lumped_system(STAGE))
    rows = (*STAGE.published, *analysis.characteristics)
    theirs = compare(rows)
    files = table_files(rows, name=STAGE.name)
    lines = list(csv.DictReader(io.StringIO(files["vgtu-piezo-comparison.csv"].decode())))
    assert len(lines) == len(theirs.rows)
    for line, expected in zip(lines, theirs.rows, strict=True):
        assert (line["quantity"], line["axis"]) == (expected.quantity, expected.axis)
        found = {o: float(line[o]) for o in ORIGINS if line.get(o)}
        assert found == {o: c.value for o, c in expected.cells.items()}


def test_value_and_uncertainty_share_their_decimals() -> None:
    assert value_and_uncertainty(338.9104, 0.243) == ("338.91", "0.24")
    assert value_and_uncertainty(63.1234, 0.0996) == ("63.12", "0.10")
    assert value_and_uncertainty(-729.23, 2814.0) == ("-729", "2814")
    assert value_and_uncertainty(1.25, math.inf) == ("1.250", "inf")


def test_every_quantity_has_a_label_and_a_unit_that_people_use() -> None:
    for quantity in QUANTITIES.values():
        assert quantity.factor > 0.0
        assert quantity.label[0].isupper()
        # what has a unit is shown in one
        assert quantity.shown_unit or quantity.unit == "1"
    assert (display("max_stress").shown_unit, display("max_stress").factor) == ("MPa", 1e-6)
    assert (display("thermal_drift").shown_unit, display("thermal_drift").factor) == ("nm/K", 1e9)
