"""Quantities in text: digits are kept, dimensions are told apart, nonsense is refused in words."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.errors import UnitError
from flexstage.quantities.units import DIMENSIONS, parse, readable, readable_unit, to_text
from flexstage.quantities.units.text import shortened, si_unit

finite = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e15, max_value=1e15)


# the first quantity waits for the units library
@settings(deadline=None)
@given(finite, st.sampled_from(sorted(DIMENSIONS)), st.data())
def test_text_reads_back_to_the_same_bits(value: float, dimension: str, data) -> None:
    unit = data.draw(st.sampled_from(DIMENSIONS[dimension].units))
    assert parse(to_text(value, dimension, unit), dimension) == value


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("38 um", "length", 38e-6),
        ("38um", "length", 38e-6),
        ("38 µm", "length", 38e-6),
        ("0.35 mm", "length", 0.35e-3),
        ("1 inch", "length", 0.0254),
        ("-2.5e-1 mm", "length", -0.25e-3),
        ("71.7 GPa", "pressure", 71.7e9),
        ("50 N/um", "stiffness", 50e6),
        ("2.81 g/cm^3", "density", 2810.0),
        ("2810 kg/m3", "density", 2810.0),
        ("180 deg", "angle", math.pi),
        ("1 arcsec", "angle", math.pi / 648000),
        ("23.6e-6 1/K", "expansion", 23.6e-6),
        ("23.6 um/m/K", "expansion", 23.6e-6),
        ("6.4 uF", "capacitance", 6.4e-6),
        ("1.2 kHz", "frequency", 1200.0),
    ],
)
def test_what_people_write(text: str, dimension: str, value: float) -> None:
    # one unit in the last place: pi and 1/K are not powers of ten
    assert parse(text, dimension) == pytest.approx(value, rel=3e-16)


@settings(deadline=None)
@given(st.floats(1e-11, 1e3), st.sampled_from(["m", "s", "m/V", "rad"]))
def test_a_readable_unit_makes_numbers_that_can_be_read(size: float, unit: str) -> None:
    name, factor = readable_unit(size, unit)
    assert name.endswith(unit)
    assert 0.05 <= size * factor < 1000.0 or factor == 1.0


def test_values_are_written_in_one_unit_of_their_own() -> None:
    assert readable("m", -119.806e-6, 41.37e-6, digits=4) == "-119.8 to 41.37 um"
    assert readable("m/V", 1.2386e-5) == "12.4 um/V"
    assert readable("V", 0.0, 120.0) == "0 to 120 V"
    assert readable("s", 457.0, digits=2) == "460 s"
    assert readable("Hz", 3000.0) == "3000 Hz"
    assert readable("", 7.25e-5) == "7.25e-05"


def test_hertz_is_not_an_angular_frequency() -> None:
    # pint converts 339 Hz to 339 rad/s without a word
    with pytest.raises(UnitError, match="not a unit of frequency"):
        parse("339 rad/s", "frequency")
    with pytest.raises(UnitError, match="not a unit of frequency"):
        parse("339 rpm", "frequency")


@pytest.mark.parametrize(
    ("text", "dimension", "part"),
    [
        ("38", "length", "has no unit"),
        (38, "length", "has no unit"),
        ("38 um", "pressure", "not a unit of pressure"),
        ("38 umm", "length", "unknown unit 'umm'"),
        ("38 MPA", "pressure", "did you mean"),
        ("thick", "length", "expected a length"),
        ("5 mm/m", "angle", "not a unit of angle"),
        ("5 mrad", "length", "not a unit of length"),
        ("1e400 m", "length", "too large"),
        ("1e309 m", "length", "too large"),
        ("9**9**9 m", "length", "expected a length"),
        ("__import__('os') m", "length", "expected a length"),
        ("1 m^9999999", "length", "expected a length"),
        (True, "length", "expected a length"),
        (None, "length", "expected a length"),
        ([1, 2], "length", "expected a length"),
        ("nan m", "length", "expected a length"),
        ("20 degC", "length", "not a unit of length"),
    ],
)
def test_nonsense_is_one_sentence(text: object, dimension: str, part: str) -> None:
    with pytest.raises(UnitError, match=part) as caught:
        parse(text, dimension)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize(("size", "shown"), [(58, 60), (59, 60)])
def test_long_values_are_shortened_in_messages(size: int, shown: int) -> None:
    text = shortened("x" * size)
    assert len(text) == shown
    assert text.endswith("...") == (size > 58)


@pytest.mark.parametrize("text", ["1", "-", "none", "strain", "m/m", "counts"])
def test_plain_numbers_over_columns_stay_what_they_are(text: str) -> None:
    assert si_unit(text)[0] == 1.0


def test_a_bare_number_takes_the_unit_that_is_given() -> None:
    assert parse(0.1, "length", bare_unit="mm") == 1e-4
    assert parse("7", "length", bare_unit="mm") == 7e-3
    # a unit that is written wins
    assert parse("7 um", "length", bare_unit="mm") == 7e-6
