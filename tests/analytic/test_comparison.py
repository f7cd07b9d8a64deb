"""Side by side: columns, order, differences, and how numbers are written."""

import math
from dataclasses import replace

import pytest

from flexstage.quantities.characteristic import Characteristic
from flexstage.quantities.comparison import difference_percent
from flexstage.quantities.quantity import display, number, prefixed
from flexstage.quantities.table import Table
from flexstage.report.figures.body_motion import exaggeration
from flexstage.studies import compare


def row(quantity: str, axis: str, origin: str, value: float, unit: str) -> Characteristic:
    return Characteristic(quantity=quantity, axis=axis, origin=origin, value=value, unit=unit)


ROWS = [
    row("natural_frequency_hz", "y", "lumped", 538.7, "Hz"),
    row("output_displacement", "y", "lumped", 64.4e-6, "m"),
    row("output_displacement", "x", "lumped", 67.6e-6, "m"),
    row("output_displacement", "x", "published-measured", 63.1e-6, "m"),
    row("natural_frequency_hz", "y", "published-analytic", 533.0, "Hz"),
]


def test_rows_and_columns_have_a_fixed_order() -> None:
    variant = [row("output_displacement", "x", "lumped", 67.7e-6, "m")]
    table = compare(ROWS, {"lumped, plane stress": variant})
    assert table.columns == (
        "published-analytic",
        "published-measured",
        "lumped",
        "lumped, plane stress",
    )
    # by quantity as they are defined, then by axis as they first appear
    assert [(r.quantity, r.axis) for r in table.rows] == [
        ("output_displacement", "y"),
        ("output_displacement", "x"),
        ("natural_frequency_hz", "y"),
    ]
    assert table.rows[1].value("lumped, plane stress") == 67.7e-6
    assert table.rows[0].value("published-analytic") is None


def test_differences_are_of_the_reference() -> None:
    table = compare(ROWS)
    assert table.rows[2].difference_percent("lumped", "published-analytic") == pytest.approx(
        100.0 * (538.7 / 533.0 - 1.0), rel=1e-12
    )
    assert table.rows[0].difference_percent("lumped", "published-measured") is None
    # a negative reference: above it is a positive difference
    assert difference_percent(-3.0, -4.0) == pytest.approx(25.0)
    assert difference_percent(1.0, 0.0) is None
    # nor of a reference, or to one, that is rounding
    coupling = [row("cross_coupling", "x", "lumped", 1e-12, "1"),
                row("cross_coupling", "x", "plane", 2e-3, "1")]  # fmt: skip
    (shown,) = compare(coupling).rows
    assert shown.difference_percent("plane", "lumped") is None
    assert shown.difference_percent("lumped", "plane") is None


def test_an_origin_that_gives_a_quantity_twice_has_two_rows() -> None:
    again = replace(ROWS[3], value=61.0e-6, note="upside down")
    table = compare([*ROWS, again])
    assert [r.value("published-measured") for r in table.rows[1:3]] == [63.1e-6, 61.0e-6]
    assert [r.value("lumped") for r in table.rows[1:3]] == [67.6e-6, None]
    assert [r.remark for r in table.rows] == ["", "", "upside down", ""]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.99996, "1.000"),
        (9.9999, "10.00"),
        (-1234.56, "-1235"),
        (2.3e-5, "2.300e-05"),
        (123456.0, "123456"),
        (math.inf, "inf"),
    ],
)
def test_numbers_keep_four_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_quantities_are_shown_in_their_prefixed_unit() -> None:
    stress = display("max_stress")
    assert (stress.shown_unit, stress.text(211.4e6), stress.text(None)) == ("MPa", "211.4", "–")
    # rounding of the rigid-body model is no motion; a real rotation of a nanoradian is one
    assert display("parasitic_rotation").text(4e-19) == "≈ 0"
    assert display("parasitic_rotation").text(1.3e-9) == "0.001300"


def test_a_prefix_keeps_numbers_short_and_says_its_power_of_ten() -> None:
    powers = {"": 0, "m": 3, "µ": 6, "n": 9, "p": 12}
    for exponent in range(-15, 4):
        factor, prefix = prefixed(1.7 * 10.0**exponent)
        assert factor == 10.0 ** powers[prefix]
        assert 0.5 <= factor * 1.7 * 10.0**exponent < 500.0 or prefix == (
            "p" if exponent < 0 else ""
        )
    assert prefixed(0.0) == (1.0, "")


@pytest.mark.parametrize("motion", [3.1e-9, 65e-6, 1.7e-3, 0.9])
def test_exaggeration_is_round_and_shows_about_a_fiftieth(motion: float) -> None:
    factor = exaggeration(0.2, motion)
    mantissa = factor / 10.0 ** math.floor(math.log10(factor) + 1e-9)
    assert min(abs(mantissa - m) for m in (1.0, 2.0, 5.0)) < 1e-9
    # steps of 1, 2, 5 lose at most a factor 2.5
    assert 0.02 / 2.5 <= factor * motion / 0.2 * (1.0 + 1e-9) <= 0.02 * (1.0 + 1e-9)
    assert exaggeration(0.2, 0.0) == 1.0


def test_every_model_against_what_was_published() -> None:
    from flexstage.report.tables import characteristics_table, differences_table

    values = {"published-fem": 200.0, "lumped": 220.0, "plane": 199.0, "solid": 200.4}
    rows = [
        Characteristic(
            quantity="natural_frequency_hz", axis="x", origin=origin, value=value, unit="Hz"
        )
        for origin, value in values.items()
    ]
    table = compare(rows)
    assert table.best == "solid"
    assert table.models == ("lumped", "plane", "solid")

    def texts(table: Table | None) -> list[str]:
        assert table is not None
        return [cell.text for row in table.rows for cell in row]

    differences = texts(differences_table(table))
    for signed in ("+10.0", "−0.5", "+0.2"):
        assert signed in differences
    few = texts(differences_table(compare(rows[:3])))
    assert "−0.5" in few
    assert "+0.2" not in few
    values_of = characteristics_table(table, ["natural_frequency_hz"], "what it is")
    assert values_of is not None
    assert values_of.caption == "what it is"
    assert {"200", "220.0", "199.0", "200.4"} <= set(texts(values_of))
    # nothing of ours, no row
    assert characteristics_table(compare(rows[:1]), ["natural_frequency_hz"], "") is None


def test_the_report_prints_how_far_a_figure_may_be_off() -> None:
    from flexstage.report.tables import characteristics_table

    rows = [
        Characteristic(
            quantity="natural_frequency_hz", axis=axis, origin="superelement", value=value,
            unit="Hz", uncertainty=spread,
        )
        for axis, value, spread in (("x", 321.2, 1.1), ("y", 533.9, None))
    ]  # fmt: skip
    shown = characteristics_table(compare(rows), ["natural_frequency_hz"], "Frequencies.")
    assert shown is not None
    assert [row[-1].small for row in shown.rows] == ["± 1.1", ""]
    assert "estimated error of the mesh" in shown.notes[0]
