"""Expressions of quantities in files, after an equals sign: ``= 2*R + 0.3 mm``.

A text is divided into numbers, quantities, names and signs first, so that only arithmetic of known
names reaches the parser. `fold` evaluates its tree over numbers of any kind. In stage files these
are fractions: sums and products are exact, and a decimal number is rounded once, as if the result
had been written into the file. The equation of an uncertainty budget has the same grammar, over
uncertain numbers and arrays.
"""

import ast
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any, NoReturn

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import UnitError
from flexstage.quantities.units import DIMENSIONS, dimensions, exact_quantity

#: Largest number of characters of an expression.
LONGEST = 2000
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
# a fraction of more bits is rounded: sums of fractions of many digits grow
_MOST_BITS = 2_000
_MOST_DIGITS = 60
_MOST_OPERATIONS = 250

Powers = tuple[tuple[str, Fraction], ...]
_ANGLE: Powers = (("angle", Fraction(1)),)
_UNIT_WORDS = frozenset(
    word
    for dimension in DIMENSIONS.values()
    for u in dimension.units
    for word in re.split(r"\W", u)
)
_BASE_UNITS = {"length": "m", "mass": "kg", "time": "s", "current": "A", "temperature": "K"}


@dataclass(frozen=True, slots=True)
class Amount:
    """A value in SI units with the powers of its base quantities.

    An angle times a number is an angle; an angle times a length is a length (an arc), and the ratio
    of two angles is a number.
    """

    value: Fraction
    """The value [SI]."""
    powers: Powers = ()
    """Powers of base quantities, in alphabetical order; none for a number."""

    @property
    def noun(self) -> str:
        """Quantity with an article, such as ``a length``."""
        return noun_of(self.powers)


@dataclass(frozen=True, slots=True)
class Grammar:
    """Names and functions of the expressions of a kind of file."""

    noun: str
    """Noun for a name in messages."""
    made_of: str
    """Constituents of an expression besides operations, in messages."""
    functions: tuple[str, ...]
    """Names of the functions."""

    @property
    def a_noun(self) -> str:
        """Noun with its article."""
        return f"{'an' if self.noun[0] in 'aeiou' else 'a'} {self.noun}"


#: Grammar of the parameters of a file.
PARAMETERS = Grammar(
    "parameter",
    "numbers, units and names of parameters",
    ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan2", "hypot", "min", "max", "abs"),
)
#: Smallest and largest number of arguments, of functions with more than one.
_ARGUMENTS = {"atan2": (2, 2), "hypot": (2, 100), "min": (2, 100), "max": (2, 100)}


@dataclass(frozen=True, slots=True)
class QuantityExpression:
    """A parsed expression."""

    text: str
    """Text."""
    tree: ast.expr
    """Tree of operations."""
    constants: Mapping[str, Amount]
    """Numbers and quantities, by their names in the tree."""
    names: frozenset[str]
    """Names."""
    units: frozenset[str]
    """Units of its quantities."""

    def by_name(self, constants: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by their names in the tree."""
        return {**constants, **{f"p_{name}": values[name] for name in self.names}}

    def part(self, node: ast.expr) -> str:
        """Return the text of a part of the tree."""

        def original(word: re.Match[str]) -> str:
            constant = self.constants.get(word[0])
            return word[0][2:] if constant is None else f"{float(constant.value):.6g}"

        return re.sub(r"\bp_\w+|\b_\d+\b", original, ast.unparse(node))


def powers_of(dimension: str) -> Powers:
    """Return the powers of base quantities of one of `flexstage.quantities.units.DIMENSIONS`."""
    if dimension in ("", "angle"):
        return _ANGLE if dimension else ()
    return powers_in(DIMENSIONS[dimension].si)


def powers_in(si: str) -> Powers:
    """Return the powers of base quantities of an SI unit, where an angle is a number."""
    return tuple(sorted((base.strip("[]"), Fraction(p)) for base, p in dimensions(si).items()))


def dimension_named(powers: Powers) -> str | None:
    """Return one of `flexstage.quantities.units.DIMENSIONS` by powers; "" for a plain number."""
    return _named().get(powers)


@lru_cache(maxsize=1)
def _named() -> dict[Powers, str]:
    return {(): "", **{powers_of(name): name for name in reversed(DIMENSIONS)}}


def noun_of(powers: Powers) -> str:
    """Return the quantity with such powers, with an article."""
    name = dimension_named(powers)
    if name is not None:
        return DIMENSIONS[name].noun if name else "a number"
    parts = (
        _BASE_UNITS.get(base, base) + ("" if power == 1 else f"^{power}") for base, power in powers
    )
    return f"a quantity in {'*'.join(parts)}"


def is_expression(value: object) -> bool:
    """Return whether a value of a file is an expression."""
    return isinstance(value, str) and value.lstrip().startswith("=")


def check_name(name: str, grammar: Grammar = PARAMETERS) -> None:
    """Refuse a name that is not valid in an expression."""
    if not _NAME.fullmatch(name) or len(name) > 80:
        raise UnitError(
            f"the name of {grammar.a_noun} must begin with a letter and have only letters, digits "
            f"and underscores, such as leg_spacing, got {name[:80]!r}"
        )
    if name in grammar.functions or name == "pi":
        raise UnitError(
            f"'{name}' is a {'constant' if name == 'pi' else 'function'} of expressions: give the "
            f"{grammar.noun} another name"
        )


def amount_of(text: str) -> Amount:
    """Return a number or a quantity in any unit.

    Examples
    --------
    >>> amount_of("0.45 mm").noun, float(amount_of("0.45 mm").value)
    ('a length', 0.00045)
    """
    value, dimension = exact_quantity(text)
    return Amount(value, powers_of(dimension))


@lru_cache(maxsize=1024)
def parse(text: str, grammar: Grammar = PARAMETERS) -> QuantityExpression:
    """Return a parsed expression; in files of parameters it begins with an equals sign.

    Examples
    --------
    >>> sorted(parse("= 2*R + max(t, 0.3 mm)").names)
    ['R', 't']
    """
    body = text.strip().removeprefix("=")
    if len(body) > LONGEST:
        raise UnitError(
            f"an expression may have at most {LONGEST} characters, got {len(body)}: divide it "
            f"among several {grammar.noun}s"
        )
    constants: dict[str, Amount] = {}
    names: set[str] = set()
    units: set[str] = set()
    words = []
    position, depth = 0, 0
    while body[position:].strip():
        token = _TOKEN.match(body, position)
        if token is None:
            _refuse_sign(body[position:].lstrip()[0], text, grammar)
        position = token.end()
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
            if token["name"] and not body[position:].lstrip().startswith("("):
                names |= {word} - {"pi"}
            elif token["name"] and word not in grammar.functions:
                _refuse_function(word, grammar)
        depth += {"(": 1, ")": -1}.get(word, 0)
        if depth > DEEPEST:
            raise UnitError(
                f"{short_text(text)} is nested more than {DEEPEST} deep: divide it among several "
                f"{grammar.noun}s"
            )
        words.append(word)
    if invalid := next((n for n in names if not _NAME.fullmatch(n)), None):
        raise UnitError(
            f"'{invalid[:60]}' is not the name of {grammar.a_noun}, which begins with a letter"
        )
    if not words:
        raise UnitError("the expression is empty: write one such as 2*R")
    # a prefix hides keywords of Python from the parser
    body_text = " ".join(f"p_{word}" if word in names else word for word in words)
    try:
        tree = ast.parse(body_text, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise UnitError(
            f"{short_text(text)} is not an arithmetic expression: use + - * / ** and parentheses "
            f"with {grammar.made_of}"
        ) from None
    _require_arithmetic(tree, grammar, 0)
    return QuantityExpression(text, tree, constants, frozenset(names), frozenset(units))


def _require_arithmetic(node: ast.expr, grammar: Grammar, depth: int) -> None:
    """Refuse a tree with anything but operations, names, and calls of known functions."""
    if depth > _MOST_OPERATIONS:
        raise UnitError(
            f"an expression may have at most {_MOST_OPERATIONS} operations in a row: divide it "
            f"among several {grammar.noun}s"
        )
    match node:
        case ast.Name():
            pass
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in grammar.functions:
            least, most = _ARGUMENTS.get(name, (1, 1))
            if not least <= len(args) <= most:
                count = f"{least}" if least == most else f"{least} or more"
                raise UnitError(f"{name} needs {count} values, got {len(args)}")
        case ast.BinOp(op=op) | ast.UnaryOp(op=op) if type(op) in _OPERATIONS:
            pass
        case _:
            listed = ", ".join((*grammar.functions, "pi"))
            raise UnitError(
                f"an expression consists of + - * / **, parentheses, {grammar.made_of}, "
                f"and {listed}"
            )
    for part in _parts(node):
        _require_arithmetic(part, grammar, depth + 1)


def _parts(node: ast.expr) -> tuple[ast.expr, ...]:
    match node:
        case ast.BinOp(left=left, right=right):
            return left, right
        case ast.UnaryOp(operand=operand):
            return (operand,)
        case ast.Call(args=args):
            return tuple(args)
    return ()


def fold(node: ast.expr, step: Callable[..., Any]) -> Any:
    """Evaluate a tree from its leaves up: `step` takes a node and the values of its parts."""
    return step(node, *(fold(part, step) for part in _parts(node)))


def computing(
    values: Mapping[str, Any],
    operations: Mapping[type, Callable[..., Any]],
    functions: Mapping[str, Callable[..., Any]],
) -> Callable[..., Any]:
    """Return the step of `fold` for values of any kind with given operations and functions."""

    def step(node: Any, *parts: Any) -> Any:
        if isinstance(node, ast.Name):
            return values[node.id]
        if isinstance(node, ast.Call):
            return functions[ast.unparse(node.func)](*parts)
        return operations[type(node.op)](*parts)

    return step


def require_names(expression: QuantityExpression, names: Collection[str]) -> None:
    """Refuse an expression with unknown names, or with a unit that is also a name."""
    for name in sorted(expression.names - set(names)):
        listed = ", ".join(names) or "none"
        hint = did_you_mean(name, names, 0.5)
        if name in _UNIT_WORDS:
            hint = "; define a quantity with a unit of several words as a parameter"
        raise UnitError(f"there is no parameter '{name[:60]}' (there are: {listed[:300]}){hint}")
    for unit in sorted(expression.units & set(names)):
        raise UnitError(
            f"'{unit}' after a number in {short_text(expression.text)} is a unit, and a parameter "
            f"has the same name: write a product with *, or rename the parameter"
        )


def evaluate(expression: QuantityExpression, parameters: Mapping[str, Amount]) -> Amount:
    """Return the value of an expression.

    Raises
    ------
    UnitError
        A name is unknown, dimensions do not agree, or the value is not finite.

    Examples
    --------
    >>> amount = evaluate(parse("= 2*R + 0.3 mm"), {"R": amount_of("1.5 mm")})
    >>> float(amount.value)
    0.0033
    """
    require_names(expression, parameters)
    values = expression.by_name({**expression.constants, "pi": _PI}, parameters)
    try:
        return fold(expression.tree, computing(values, _OPERATIONS, _FUNCTIONS))
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
        raise UnitError(f"{error}; write a product with *") from None
    return Amount(_bounded(amount.value), amount.powers)


def _too_large(text: str) -> UnitError:
    return UnitError(f"{short_text(text)} is too large to be a number")


def _same(what: str, *amounts: Amount) -> Powers:
    """Return the common powers; refuse different ones."""
    for other in amounts[1:]:
        if other.powers != amounts[0].powers:
            raise UnitError(
                f"{what} needs values of the same dimension, got {amounts[0].noun} and {other.noun}"
            )
    return amounts[0].powers


def product(first: Powers, second: Powers, sign: int) -> Powers:
    """Return the powers of a product; of a quotient where the sign is negative."""
    if first == () and second == _ANGLE and sign < 0:
        raise UnitError("a number cannot be divided by an angle")
    if () in (first, second):  # an angle stays one
        return first or tuple((base, sign * p) for base, p in second)
    total = {base: p for base, p in first if base != "angle"}
    for base, p in second:
        if base != "angle":
            total[base] = total.get(base, Fraction(0)) + sign * p
    return tuple(sorted((base, p) for base, p in total.items() if p))


def _divide(first: Amount, second: Amount) -> Amount:
    if not second.value:
        raise UnitError("division by zero")
    return Amount(first.value / second.value, product(first.powers, second.powers, -1))


def power(base: Amount, exponent: Amount) -> Amount:
    """Return a power whose exponent is a number."""
    if exponent.powers or abs(exponent.value) > LARGEST_EXPONENT:
        got = exponent.noun if exponent.powers else "a larger one"
        raise UnitError(f"an exponent must be a number of at most {LARGEST_EXPONENT}, got {got}")
    if base.powers == _ANGLE and exponent.value != 1:
        raise UnitError("an angle cannot be raised to a power: divide it by 1 rad first")
    powers = tuple((name, power * exponent.value) for name, power in base.powers if exponent.value)
    if not base.value and exponent.value < 0:
        raise UnitError("division by zero")
    if exponent.value.denominator == 1:
        return Amount(base.value ** int(exponent.value), powers)
    if base.value < 0:
        raise UnitError("a negative value cannot be raised to a fractional power")
    return Amount(_finite(float(base.value) ** float(exponent.value)), powers)


def _finite(value: float) -> Fraction:
    if not math.isfinite(value):
        raise OverflowError
    return Fraction(value)


def _bounded(value: Fraction) -> Fraction:
    """Round a fraction of very many digits; refuse one that is too large for a float."""
    rounded = float(value)  # raises OverflowError
    bits = value.numerator.bit_length() + value.denominator.bit_length()
    return value if bits <= _MOST_BITS else Fraction(rounded)


def _bounding(operation: Callable[..., Amount]) -> Callable[..., Amount]:
    def of(first: Amount, second: Amount) -> Amount:
        result = operation(first, second)
        return Amount(_bounded(result.value), result.powers)

    return of


def _sqrt(amount: Amount) -> Amount:
    if amount.value < 0:
        raise UnitError("sqrt needs a value of 0 or more")
    return power(amount, Amount(Fraction(1, 2)))


def _turn(function: Callable[[float], float]) -> Callable[[Amount], Amount]:
    """Return a function of an angle; a number is in radians."""

    def of(amount: Amount) -> Amount:
        if amount.powers not in ((), _ANGLE):
            raise UnitError(f"{function.__name__} needs an angle or a number, got {amount.noun}")
        return Amount(_finite(function(float(amount.value))))

    return of


def _turn_back(function: Callable[[float], float]) -> Callable[[Amount], Amount]:
    """Return a function whose result is an angle."""

    def of(amount: Amount) -> Amount:
        if amount.powers or abs(amount.value) > 1:
            got = amount.noun if amount.powers else f"{float(amount.value):.6g}"
            raise UnitError(f"{function.__name__} needs a number from -1 to 1, got {got}")
        return Amount(Fraction(function(float(amount.value))), _ANGLE)

    return of


def _atan2(y: Amount, x: Amount) -> Amount:
    _same("atan2", y, x)
    return Amount(Fraction(math.atan2(float(y.value), float(x.value))), _ANGLE)


def _hypot(*amounts: Amount) -> Amount:
    powers = _same("hypot", *amounts)
    return Amount(_finite(math.hypot(*(float(a.value) for a in amounts))), powers)


_OPERATIONS: dict[type, Callable[..., Amount]] = {
    ast.Add: lambda a, b: Amount(a.value + b.value, _same("a sum", a, b)),
    ast.Sub: lambda a, b: Amount(a.value - b.value, _same("a difference", a, b)),
    ast.Mult: lambda a, b: Amount(a.value * b.value, product(a.powers, b.powers, 1)),
    ast.Div: _divide,
    ast.Pow: power,
}
_OPERATIONS = {op: _bounding(operation) for op, operation in _OPERATIONS.items()}
_OPERATIONS |= {ast.UAdd: lambda amount: amount, ast.USub: lambda a: Amount(-a.value, a.powers)}
_FUNCTIONS: dict[str, Callable[..., Amount]] = {
    "sqrt": _sqrt,
    "sin": _turn(math.sin),
    "cos": _turn(math.cos),
    "tan": _turn(math.tan),
    "asin": _turn_back(math.asin),
    "acos": _turn_back(math.acos),
    "atan2": _atan2,
    "hypot": _hypot,
    "min": lambda *amounts: Amount(min(a.value for a in amounts), _same("min", *amounts)),
    "max": lambda *amounts: Amount(max(a.value for a in amounts), _same("max", *amounts)),
    "abs": lambda amount: Amount(abs(amount.value), amount.powers),
}
_PI = Amount(Fraction(math.pi))


def _refuse_sign(sign: str, text: str, grammar: Grammar) -> NoReturn:
    instead = {
        "^": ": write ** for a power",
        ".": ": names in an expression have no parts",
        ";": ": a file is not a program",
        "×": ": write * for a product",
        "·": ": write * for a product",
    }.get(sign, f": an expression consists of {grammar.made_of}")
    raise UnitError(f"{sign!r} is not allowed in {short_text(text)}{instead}")


def _refuse_function(name: str, grammar: Grammar) -> NoReturn:
    hint = did_you_mean(name, grammar.functions, 0.6)
    raise UnitError(
        f"there is no function '{name[:60]}' (there are: {', '.join(grammar.functions)}){hint}"
    )


def short_text(text: str) -> str:
    """Return a text for a message, cut if it is long."""
    plain = " ".join(text.split())
    return repr(plain if len(plain) <= 60 else plain[:57] + "...")
