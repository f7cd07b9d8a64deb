"""The tidy table of characteristics."""

import pytest

from flexstage.base.errors import ModelError
from flexstage.quantities.characteristic import Characteristic, Characteristics
from flexstage.quantities.quantity import QUANTITIES, Quantity
from flexstage.quantities.units.text import si_unit


def row(axis: str, origin: str, value: float) -> Characteristic:
    return Characteristic(
        quantity="natural_frequency_hz", axis=axis, origin=origin, value=value, unit="Hz"
    )


TABLE = Characteristics(
    (row("x", "lumped", 326.0), row("y", "lumped", 538.7), row("x", "published-measured", 337.0))
)


def test_rows_are_found_by_any_of_their_keys() -> None:
    assert [r.value for r in TABLE.select(axis="x")] == [326.0, 337.0]
    assert [r.value for r in TABLE.select(origin="lumped")] == [326.0, 538.7]
    assert TABLE.select() == TABLE
    assert TABLE.value("natural_frequency_hz", "y") == 538.7
    assert TABLE.value("natural_frequency_hz", "x", "lumped") == 326.0


def test_short_names_are_those_of_the_quantity_and_others_are_refused() -> None:
    assert TABLE.select("natural_frequency") == TABLE.select("natural_frequency_hz") == TABLE
    assert TABLE.select("frequency", "y") == TABLE.select(axis="y")
    assert TABLE.value("natural_frequency", "y") == 538.7
    assert not TABLE.select("mass")  # a quantity that this table has not
    with pytest.raises(ModelError, match="no quantity 'natural_freq'; did you mean 'natural_freq"):
        TABLE.select("natural_freq")
    with pytest.raises(ModelError, match="the table has no axis 'X': its axes are x, y; did you"):
        TABLE.select(axis="X")
    with pytest.raises(ModelError, match="unknown origin 'lumpd'"):
        TABLE.select(origin="lumpd")
    assert not Characteristics(()).select("mass", "x", "lumped")


def test_what_is_not_there_or_not_clear_is_said() -> None:
    with pytest.raises(ModelError, match=r"there are 2 values .* lumped, published-measured"):
        TABLE.value("natural_frequency_hz", "x")
    with pytest.raises(ModelError, match="there is no resolution of axis 'x'"):
        TABLE.value("resolution", "x")


def test_columns_are_as_long_as_the_table() -> None:
    columns = TABLE.columns()
    assert columns["value"] == [326.0, 538.7, 337.0]
    assert {len(c) for c in columns.values()} == {3}


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"quantity": "frequency"}, "unknown quantity 'frequency'"),
        ({"origin": "guessed"}, "unknown origin 'guessed'"),
        ({"unit": "rad/s"}, "is 'Hz', got"),
    ],
)
def test_rows_that_mix_up_their_words_are_refused(changes: dict, part: str) -> None:
    sound = {
        "quantity": "natural_frequency_hz",
        "axis": "x",
        "origin": "lumped",
        "value": 1.0,
        "unit": "Hz",
    }
    with pytest.raises(ModelError, match=part):
        Characteristic(**{**sound, **changes})


def test_every_quantity_has_a_unit_that_stage_files_can_write() -> None:
    from flexstage.files.format import DIMENSION_OF_UNIT

    assert {q.unit for q in QUANTITIES.values() if q.unit != "1"} <= set(DIMENSION_OF_UNIT)


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=lambda q: q.name)
def test_what_is_shown_is_in_the_unit_that_stands_beside_it(quantity: Quantity) -> None:
    factor, _ = si_unit(quantity.shown_unit.replace(" ", "*") or "1")
    assert quantity.factor * factor == pytest.approx(1.0, rel=1e-12)
