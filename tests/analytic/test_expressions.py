"""Arithmetic of quantities: values against those worked out by hand, dimensions, and refusals."""

import math

import pytest

from flexstage.base.errors import UnitError
from flexstage.files.expression import amount_of, evaluate, parse

NAMES = {
    name: amount_of(text)
    for name, text in {
        "R": "1.5 mm",
        "t": "0.3 mm",
        "n": "7",
        "a": "30 deg",
        "k": "40 N/um",
        "rho": "2810 kg/m^3",
        "m": "3",
    }.items()
}


def value(text: str) -> tuple[float, str]:
    made = evaluate(parse(text), NAMES)
    return float(made.value), made.noun


@pytest.mark.parametrize(
    ("text", "expected", "noun"),
    [
        ("= R", 1.5e-3, "a length"),
        ("= 2*R + t", 3.3e-3, "a length"),
        ("=R-t*n", -0.6e-3, "a length"),
        ("= -R", -1.5e-3, "a length"),
        ("= -2**2", -4.0, "a number"),
        ("= 2**-1", 0.5, "a number"),
        ("= 2**3**2", 512.0, "a number"),
        ("= (R + t)/t", 6.0, "a number"),
        ("= 31.5 mm + 4.8 mm", 36.3e-3, "a length"),
        ("= 0.1 + 0.2", 0.3, "a number"),
        ("= R*0.1/3*30", 1.5e-3, "a length"),
        ("= 0.3mm + 5 µm", 0.305e-3, "a length"),
        ("= k*t", 12e3, "a force"),
        ("= R**2*rho*t", 1.89675e-6, "a mass"),
        ("= sqrt(R**2)", 1.5e-3, "a length"),
        ("= (R*t)**0.5 + t", math.sqrt(4.5e-7) + 0.3e-3, "a length"),
        ("= hypot(3*t, 4*t)", 1.5e-3, "a length"),
        ("= min(R, t, 1 mm) + max(R, t)", 1.8e-3, "a length"),
        ("= abs(t - R)", 1.2e-3, "a length"),
        ("= 2*a", math.pi / 3.0, "an angle"),
        ("= a/n", math.pi / 42.0, "an angle"),
        ("= a/a", 1.0, "a number"),
        ("= R*a", 1.5e-3 * math.pi / 6.0, "a length"),
        ("= atan2(R, R)", math.pi / 4.0, "an angle"),
        ("= asin(0.5) + acos(0.5)", math.pi / 2.0, "an angle"),
        ("= sin(a) + cos(60 deg)", 1.0, "a number"),
        ("= tan(pi/8)", math.sqrt(2.0) - 1.0, "a number"),
        ("= 1/(2 s)", 0.5, "a frequency"),
    ],
)
def test_values_are_those_worked_out_by_hand(text: str, expected: float, noun: str) -> None:
    found = value(text)
    assert found[0] == pytest.approx(expected, rel=1e-15)
    assert found[1] == noun


def test_decimal_numbers_are_rounded_once() -> None:
    # in floating-point numbers these are 0.36300000000000004 and 0.30000000000000004
    assert value("= 31.5 mm + 4.8 mm")[0] == 36.3e-3
    assert value("= 0.1 + 0.2")[0] == 0.3
    assert value("= t*n/n")[0] == 0.3e-3


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("= R + a", "a sum needs values of the same dimension, got a length and an angle"),
        ("= R - 1", "a difference needs values of the same dimension, got a length and a number"),
        ("= atan2(R, 1)", "atan2 needs values of the same dimension"),
        ("= min(R, a)", "min needs values of the same dimension"),
        ("= R**t", "an exponent must be a number of at most 100, got a length"),
        ("= 9**9**9", "an exponent must be a number of at most 100, got a larger one"),
        ("= a**2", "an angle cannot be raised to a power"),
        ("= 1/a", "a number cannot be divided by an angle"),
        ("= sin(R)", "sin needs an angle or a number, got a length"),
        ("= acos(1.5)", "acos needs a number from -1 to 1, got 1.5"),
        ("= acos(R)", "acos needs a number from -1 to 1, got a length"),
        ("= sqrt(t - R)", "sqrt needs a value of 0 or more"),
        ("= (-8)**(1/3)", "a negative value cannot be raised to a fractional power"),
        ("= 1/(t - 0.3 mm)", "division by zero"),
        ("= 0**-1", "division by zero"),
        ("= 1e300*1e300", "too large to be a number"),
        ("= 1e400", "too large to be a number"),
        ("= " + "9" * 61, "more than 60 digits"),
        ("= q", "there is no parameter 'q' (there are: R, t, n, a, k, rho, m)"),
        ("= rh0", "did you mean 'rho'?"),
        ("= 40 N/um", "define a quantity with a unit of several words as a parameter"),
        ("= 2 m", "a parameter has the same name"),
        ("= 2 R", "unknown unit 'R': expected one such as mm, deg, N/um or MPa; write a product"),
        ("= root(R)", "there is no function 'root'"),
        ("= __import__('os')", "there is no function '__import__'"),
        ("= min(R)", "min needs 2 or more values, got 1"),
        ("= sin(1, 2)", "sin needs 1 values, got 2"),
        ("= R.real", "'.' is not allowed"),
        ("= R^2", "write ** for a power"),
        ("= R if n else t", "is not an arithmetic expression"),
        ("= R t", "is not an arithmetic expression"),
        ("= (R", "is not an arithmetic expression"),
        ("= R // t", "is not an arithmetic expression"),
        ("= lambda: R", "':' is not allowed"),
        ("= [R][0]", "'[' is not allowed"),
        ("= R, t", "an expression consists of + - * / **"),
        ("= min(R, t)(2)", "an expression consists of + - * / **"),
        ("= min(*R, t)", "an expression consists of + - * / **"),
        ("= _0 + 1", "'_0' is not the name of a parameter"),
        ("=", "the expression is empty"),
        ("= " + "(" * 40 + "1" + ")" * 40, "nested more than 30 deep"),
        ("= " + "(" * 10_000, "at most 2000 characters"),
        ("= " + "-" * 400 + "1", "at most 250 operations in a row"),
    ],
)
def test_what_is_no_arithmetic_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(UnitError) as refused:
        value(text)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_fractions_of_very_many_digits_are_rounded() -> None:
    primes = (7, 11, 13, 17, 19, 23, 29)
    made = evaluate(parse("= " + " + ".join(f"1/{p}**100" for p in primes)), {})
    assert made.value.denominator.bit_length() < 2_100
    assert float(made.value) == pytest.approx(math.fsum(p**-100.0 for p in primes), rel=1e-15)
