"""Expressions: any text is a value or one sentence, and sums of decimals are those of fractions."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexstage.base.errors import FlexstageError
from flexstage.files.expression import amount_of, evaluate, parse
from flexstage.quantities.units import parse as quantity
from flexstage.stage.designs import find_stage, parameters_of
from flexstage.stage.file import stage_from_text

NAMES = {"R": amount_of("1.5 mm"), "t": amount_of("0.3 mm"), "n": amount_of("3")}
SIGNS = [
    "R",
    "t",
    "n",
    "+",
    "-",
    "*",
    "/",
    "**",
    "(",
    ")",
    ",",
    "2",
    "1e9",
    "0",
    "sqrt(",
    "sin(",
    "max(",
    "atan2(",
    "pi",
    ".",
    "=",
    "_",
    "if",
    "lambda",
    "x",
    "[",
    "#",
]
WORDS = st.sampled_from(["R", "t", "n", "2", "1e9", "0", "pi", "x", "if", "0.3 mm", "30 deg"]) | (
    st.sampled_from(["+", "-", "*", "/", "**", "(", ")", ",", ".", "=", "[", "#", "sqrt(", "max("])
)
DECIMALS = st.decimals(-1000, 1000, places=4)


def of(text: str) -> None:
    """Evaluate a text: a finite number, or one sentence."""
    said = ""
    try:
        assert isinstance(evaluate(parse(text), NAMES).value, Fraction)
    except FlexstageError as error:
        said = str(error)
    assert said.isprintable()
    assert len(said) < 1000


@given(st.lists(WORDS, max_size=30).map(lambda words: "= " + " ".join(words)))
def test_arithmetic_of_any_words_is_a_value_or_a_sentence(text: str) -> None:
    of(text)


@given(st.text(max_size=600).map(lambda text: f"={text}"))
def test_any_text_is_a_value_or_a_sentence(text: str) -> None:
    of(text)


@given(st.lists(DECIMALS, min_size=1, max_size=12))
def test_a_sum_is_rounded_once(numbers: list[Decimal]) -> None:
    text = "= " + " + ".join(f"({number:f} mm)" for number in numbers)
    made = evaluate(parse(text.replace("(-", "-(")), {})
    assert float(made.value) == quantity(f"{sum(numbers):f} mm", "length")


@given(DECIMALS, st.sampled_from(["mm", "um", "deg", "N/um", "MPa", "g", "V"]))
def test_the_name_of_a_quantity_is_that_quantity_to_the_bit(number: Decimal, unit: str) -> None:
    amount = amount_of(f"{number:f} {unit}")
    name = {"mm": "length", "um": "length", "deg": "angle", "N/um": "stiffness", "MPa": "pressure",
            "g": "mass", "V": "voltage"}[unit]  # fmt: skip
    made = evaluate(parse("= q"), {"q": amount})
    assert float(made.value) == quantity(f"{number:f} {unit}", name)


NAMES_OF_A_DESIGN = st.sampled_from([p.name for p in parameters_of("parallelogram")])
VALUES = st.sampled_from(
    ["1 mm", "-1 mm", "1e9 mm", "3", "null", "true", "leaf", "[1 mm, 2 mm]", "{kind: v}", "= 2 mm"]
)


@given(
    st.dictionaries(
        NAMES_OF_A_DESIGN | st.text(max_size=9), VALUES | st.text(max_size=9), max_size=3
    )
)
def test_whatever_is_set_is_a_stage_or_a_sentence(values: dict[str, str]) -> None:
    said = ""
    try:
        assert find_stage("parallelogram", values).bodies
    except FlexstageError as error:
        said = str(error)
    assert "\n" not in said


@given(st.lists(st.tuples(st.sampled_from("abcde"), WORDS, WORDS, WORDS), max_size=5))
def test_any_parameters_of_a_file_are_read_or_refused(entries: list[tuple[str, ...]]) -> None:
    rows = "".join(f'  {name}: "= {" ".join(words)}"\n' for name, *words in entries)
    with pytest.raises(FlexstageError) as refused:  # it lacks bodies in the end
        stage_from_text(f"flexstage: 1\nparameters:\n{rows}name: a\n")
    assert str(refused.value).isprintable()
