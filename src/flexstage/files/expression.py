"""Arithmetic with quantities, as files write it behind an equals sign: ``= 2*R + 0.3 mm``.

A text is cut into numbers, quantities, names and signs first, so that nothing but arithmetic of
known names reaches the parser. Values are fractions: sums and products are exact, and a decimal
number is rounded once, as if the result had been written into the file.
"""

import ast
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import NoReturn

from flexstage.choose import did_you_mean
from flexstage.errors import UnitError
from flexstage.units import DIMENSIONS, dimensions, exact_quantity

#: Most characters of an expression.
LONGEST = 500
#: Deepest nesting of an expression.
DEEPEST = 30
#: Largest exponent of a power.
LARGEST_EXPONENT = 100

_NUMBER = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_WORD = r"[A-Za-zµ\N{GREEK SMALL LETTER MU}°]+"
_TOKEN = re.compile(
    rf"\s*(?:(?P<number>{_NUMBER})(?:\s*(?P<unit>{_WORD})(?![\w(]))?"
    r"|(?P<name>[A-Za-z_]\w*)|(?P<sign>\*\*|[-+*/(),]))",
    re.ASCII,
)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
# bits of a fraction from which on it is rounded: sums of fractions of many digits grow
_MOST_BITS = 2_000
_MOST_DIGITS = 60
_MOST_OPERATIONS = 250

_Powers = tuple[tuple[str, Fraction], ...]
_ANGLE: _Powers = (("angle", Fraction(1)),)
_UNIT_WORDS = frozenset(
    word
    for dimension in DIMENSIONS.values()
    for u in dimension.units
    for word in re.split(r"\W", u)
)
_BASE_UNITS = {"length": "m", "mass": "kg", "time": "s", "current": "A", "temperature": "K"}


@dataclass(frozen=True, slots=True)
class Amount:
    """A value in SI units, and the powers of base quantities that it has.

    An angle is one as long as it is scaled by numbers; times a length it is an arc, and its ratio
    to another angle is a number.
    """

    value: Fraction
    """The value [SI]."""
    powers: _Powers = ()
    """Powers of base quantities, in alphabetical order; none for a number."""

    @property
    def noun(self) -> str:
        """What it is, with the article."""
        return noun_of(self.powers)


@dataclass(frozen=True, slots=True)
class QuantityExpression:
    """An expression that can be evaluated."""

    text: str
    """As it is written."""
    tree: ast.expr
    """Its operations."""
    constants: Mapping[str, Amount]
    """Its numbers and quantities, by their names in the tree."""
    names: frozenset[str]
    """The parameters that it needs."""
    units: frozenset[str]
    """The units of its quantities."""


def powers_of(dimension: str) -> _Powers:
    """Return the powers of base quantities of a dimension of `flexstage.units.DIMENSIONS`."""
    if dimension in ("", "angle"):
        return _ANGLE if dimension else ()
    found = dimensions(DIMENSIONS[dimension].si)
    return tuple(sorted((base.strip("[]"), Fraction(power)) for base, power in found.items()))


def dimension_named(powers: _Powers) -> str | None:
    """Return the dimension of `flexstage.units.DIMENSIONS` of powers; "" for a plain number."""
    return _named().get(powers)


@lru_cache(maxsize=1)
def _named() -> dict[_Powers, str]:
    return {(): "", **{powers_of(name): name for name in reversed(DIMENSIONS)}}


def noun_of(powers: _Powers) -> str:
    """Say what has such powers, with the article."""
    name = dimension_named(powers)
    if name is not None:
        return DIMENSIONS[name].noun if name else "a number"
    parts = (
        _BASE_UNITS.get(base, base) + ("" if power == 1 else f"^{power}") for base, power in powers
    )
    return f"a quantity in {'*'.join(parts)}"


def is_expression(value: object) -> bool:
    """Say whether a value of a file is an expression."""
    return isinstance(value, str) and value.lstrip().startswith("=")


def check_parameter_name(name: str) -> None:
    """Refuse a name that could not stand in an expression."""
    if not _NAME.fullmatch(name) or len(name) > 80:
        raise UnitError(
            f"a parameter is called by letters, digits and underscores, from a letter on, such as "
            f"leg_spacing, got {name[:80]!r}"
        )
    if name in _FUNCTIONS or name in _CONSTANTS:
        raise UnitError(
            f"'{name}' is a {'function' if name in _FUNCTIONS else 'constant'} of "
            "expressions: give the parameter another name"
        )


def amount_of(text: str) -> Amount:
    """Read a number or a quantity in any unit.

    Examples
    --------
    >>> amount_of("0.45 mm").noun, float(amount_of("0.45 mm").value)
    ('a length', 0.00045)
    """
    value, dimension = exact_quantity(text)
    return Amount(value, powers_of(dimension))


@lru_cache(maxsize=1024)
def parse(text: str) -> QuantityExpression:
    """Read an expression, which begins with an equals sign.

    Examples
    --------
    >>> sorted(parse("= 2*R + max(t, 0.3 mm)").names)
    ['R', 't']
    """
    body = text.strip().removeprefix("=")
    if len(body) > LONGEST:
        raise UnitError(
            f"an expression has at most {LONGEST} characters, got {len(body)}: divide it among "
            "parameters"
        )
    constants: dict[str, Amount] = {}
    names: set[str] = set()
    units: set[str] = set()
    words = []
    at, depth = 0, 0
    while body[at:].strip():
        token = _TOKEN.match(body, at)
        if token is None:
            _refuse_sign(body[at:].lstrip()[0], text)
        at = token.end()
        if token["number"] is not None:
            word = f"_{len(constants)}"
            try:
                constants[word] = _constant(token["number"], token["unit"])
            except OverflowError:
                raise _too_large(text) from None
            if token["unit"]:
                units.add(token["unit"])
        else:
            word = token["name"] or token["sign"]
            if token["name"] and not body[at:].lstrip().startswith("("):
                names |= {word} - _CONSTANTS.keys()
            elif token["name"] and word not in _FUNCTIONS:
                _refuse_function(word)
        depth += {"(": 1, ")": -1}.get(word, 0)
        if depth > DEEPEST:
            raise UnitError(
                f"an expression is nested at most {DEEPEST} deep: {_shown(text)} is "
                "deeper; divide it among parameters"
            )
        words.append(word)
    if bad := next((n for n in names if not _NAME.fullmatch(n)), None):
        raise UnitError(f"'{bad[:60]}' is no name of a parameter, which begins with a letter")
    if not words:
        raise UnitError("nothing stands behind the equals sign: write an expression such as = 2*R")
    # names that mean something to the parser become some that do not
    spelled = " ".join(f"p_{word}" if word in names else word for word in words)
    try:
        tree = ast.parse(spelled, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise UnitError(
            f"{_shown(text)} is no arithmetic: write it of + - * / ** and parentheses, with "
            "numbers, units and names of parameters"
        ) from None
    return QuantityExpression(text, tree, constants, frozenset(names), frozenset(units))


def require_names(expression: QuantityExpression, names: Collection[str]) -> None:
    """Refuse an expression that needs other names, or has a unit that is called like one."""
    for name in sorted(expression.names - set(names)):
        listed = ", ".join(names) or "none"
        hint = did_you_mean(name, names, 0.5)
        if name in _UNIT_WORDS:
            hint = "; a quantity with a unit of several words is a parameter of its own"
        raise UnitError(f"there is no parameter '{name[:60]}' (there are: {listed[:300]}){hint}")
    for unit in sorted(expression.units & set(names)):
        raise UnitError(
            f"'{unit}' behind a number in {_shown(expression.text)} is a unit, and a parameter has "
            f"that name: write a product with *, or call the parameter otherwise"
        )


def evaluate(expression: QuantityExpression, parameters: Mapping[str, Amount]) -> Amount:
    """Return the value of an expression.

    Raises
    ------
    UnitError
        A name is unknown, dimensions do not suit one another, or the value is no finite number.

    Examples
    --------
    >>> made = evaluate(parse("= 2*R + 0.3 mm"), {"R": amount_of("1.5 mm")})
    >>> float(made.value)
    0.0033
    """
    require_names(expression, parameters)
    spelled = {f"p_{name}": parameters[name] for name in expression.names}
    try:
        return _value(expression.tree, {**expression.constants, **spelled}, 0)
    except OverflowError:
        raise _too_large(expression.text) from None


def _constant(number: str, unit: str | None) -> Amount:
    if len(number) > _MOST_DIGITS:
        raise UnitError(f"a number has more than {_MOST_DIGITS} digits: {number[:20]}...")
    if unit is None:
        return Amount(_bounded(Fraction(Decimal(number))))
    try:
        amount = amount_of(f"{number} {unit}")
    except UnitError as error:
        raise UnitError(f"{error}; a product is written with *") from None
    return Amount(_bounded(amount.value), amount.powers)


def _too_large(text: str) -> UnitError:
    return UnitError(f"{_shown(text)} is too large to be a number")


def _value(node: ast.expr, values: Mapping[str, Amount], depth: int) -> Amount:
    if depth > _MOST_OPERATIONS:
        raise UnitError(
            f"an expression has at most {_MOST_OPERATIONS} operations in a row: divide it among "
            "parameters"
        )
    match node:
        case ast.Name(id=name) if name in values:
            return values[name]
        case ast.Name(id=name) if name in _CONSTANTS:
            return _CONSTANTS[name]
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            inner = _value(operand, values, depth + 1)
            return Amount(-inner.value, inner.powers) if isinstance(node.op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            first, second = _value(left, values, depth + 1), _value(right, values, depth + 1)
            made = _OPERATIONS[type(op)](first, second)
            return Amount(_bounded(made.value), made.powers)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            function, least, most = _FUNCTIONS[name]
            if not least <= len(args) <= most:
                count = f"{least}" if least == most else f"{least} or more"
                raise UnitError(f"{name} takes {count} values, got {len(args)}")
            return function(*(_value(arg, values, depth + 1) for arg in args))
    raise UnitError(
        "an expression is of + - * / **, parentheses, numbers with their units, names of "
        f"parameters and {', '.join((*_FUNCTIONS, *_CONSTANTS))}"
    )


def _same(what: str, *amounts: Amount) -> _Powers:
    """Return the powers that all have; refuse others."""
    for other in amounts[1:]:
        if other.powers != amounts[0].powers:
            raise UnitError(
                f"{what} needs values of one dimension, got {amounts[0].noun} and {other.noun}"
            )
    return amounts[0].powers


def _product(first: Amount, second: Amount, sign: int) -> _Powers:
    if first.powers == () and second.powers == _ANGLE and sign < 0:
        raise UnitError("a number is divided by an angle, which gives no quantity of a file")
    if () in (first.powers, second.powers):  # an angle stays one
        return first.powers or tuple((base, sign * power) for base, power in second.powers)
    total = {base: power for base, power in first.powers if base != "angle"}
    for base, power in second.powers:
        if base != "angle":
            total[base] = total.get(base, Fraction(0)) + sign * power
    return tuple(sorted((base, power) for base, power in total.items() if power))


def _add(first: Amount, second: Amount) -> Amount:
    return Amount(first.value + second.value, _same("a sum", first, second))


def _subtract(first: Amount, second: Amount) -> Amount:
    return Amount(first.value - second.value, _same("a difference", first, second))


def _multiply(first: Amount, second: Amount) -> Amount:
    return Amount(first.value * second.value, _product(first, second, 1))


def _divide(first: Amount, second: Amount) -> Amount:
    if not second.value:
        raise UnitError("it divides by zero")
    return Amount(first.value / second.value, _product(first, second, -1))


def _power(base: Amount, exponent: Amount) -> Amount:
    if exponent.powers or abs(exponent.value) > LARGEST_EXPONENT:
        got = exponent.noun if exponent.powers else "a larger one"
        raise UnitError(f"an exponent is a number of at most {LARGEST_EXPONENT}, got {got}")
    if base.powers == _ANGLE and exponent.value != 1:
        raise UnitError("an angle has no power: divide it by 1 rad first")
    powers = tuple((name, power * exponent.value) for name, power in base.powers if exponent.value)
    if not base.value and exponent.value < 0:
        raise UnitError("it divides by zero")
    if exponent.value.denominator == 1:
        return Amount(base.value ** int(exponent.value), powers)
    if base.value < 0:
        raise UnitError("a negative value has no power with a fraction")
    return Amount(_finite(float(base.value) ** float(exponent.value)), powers)


def _finite(value: float) -> Fraction:
    if not math.isfinite(value):
        raise OverflowError
    return Fraction(value)


def _bounded(value: Fraction) -> Fraction:
    """Round a fraction of very many digits, and refuse one that is no number of a file."""
    rounded = float(value)  # raises OverflowError
    bits = value.numerator.bit_length() + value.denominator.bit_length()
    return value if bits <= _MOST_BITS else Fraction(rounded)


def _sqrt(amount: Amount) -> Amount:
    if amount.value < 0:
        raise UnitError("sqrt takes no negative value")
    return _power(amount, Amount(Fraction(1, 2)))


def _turn(function: Callable[[float], float]) -> Callable[[Amount], Amount]:
    """A function of an angle; a number is one in radians."""

    def of(amount: Amount) -> Amount:
        if amount.powers not in ((), _ANGLE):
            raise UnitError(f"{function.__name__} takes an angle or a number, got {amount.noun}")
        return Amount(_finite(function(float(amount.value))))

    return of


def _turn_back(function: Callable[[float], float]) -> Callable[[Amount], Amount]:
    """A function that gives an angle."""

    def of(amount: Amount) -> Amount:
        if amount.powers or abs(amount.value) > 1:
            got = amount.noun if amount.powers else f"{float(amount.value):.6g}"
            raise UnitError(f"{function.__name__} takes a number from -1 to 1, got {got}")
        return Amount(Fraction(function(float(amount.value))), _ANGLE)

    return of


def _atan2(y: Amount, x: Amount) -> Amount:
    _same("atan2", y, x)
    return Amount(Fraction(math.atan2(float(y.value), float(x.value))), _ANGLE)


def _hypot(*amounts: Amount) -> Amount:
    powers = _same("hypot", *amounts)
    return Amount(_finite(math.hypot(*(float(a.value) for a in amounts))), powers)


def _min(*amounts: Amount) -> Amount:
    return Amount(min(a.value for a in amounts), _same("min", *amounts))


def _max(*amounts: Amount) -> Amount:
    return Amount(max(a.value for a in amounts), _same("max", *amounts))


def _abs(amount: Amount) -> Amount:
    return Amount(abs(amount.value), amount.powers)


_OPERATIONS: dict[type, Callable[[Amount, Amount], Amount]] = {
    ast.Add: _add,
    ast.Sub: _subtract,
    ast.Mult: _multiply,
    ast.Div: _divide,
    ast.Pow: _power,
}
_MANY = 100
_FUNCTIONS: dict[str, tuple[Callable[..., Amount], int, int]] = {
    "sqrt": (_sqrt, 1, 1),
    "sin": (_turn(math.sin), 1, 1),
    "cos": (_turn(math.cos), 1, 1),
    "tan": (_turn(math.tan), 1, 1),
    "asin": (_turn_back(math.asin), 1, 1),
    "acos": (_turn_back(math.acos), 1, 1),
    "atan2": (_atan2, 2, 2),
    "hypot": (_hypot, 2, _MANY),
    "min": (_min, 2, _MANY),
    "max": (_max, 2, _MANY),
    "abs": (_abs, 1, 1),
}
_CONSTANTS: dict[str, Amount] = {"pi": Amount(Fraction(math.pi))}


def _refuse_sign(sign: str, text: str) -> NoReturn:
    instead = {
        "^": ": write ** for a power",
        ".": ": a name has no parts in an expression",
        ";": ": a file holds no program",
        "×": ": write * for a product",
        "·": ": write * for a product",
    }.get(sign, ": it is arithmetic of numbers, quantities and parameters")
    raise UnitError(f"{sign!r} has no meaning in {_shown(text)}{instead}")


def _refuse_function(name: str) -> NoReturn:
    hint = did_you_mean(name, _FUNCTIONS, 0.6)
    raise UnitError(
        f"there is no function '{name[:60]}' (there are: {', '.join(_FUNCTIONS)}){hint}"
    )


def _shown(text: str) -> str:
    plain = " ".join(text.split())
    return repr(plain if len(plain) <= 60 else plain[:57] + "...")
