"""Arithmetic with quantities, as files write it behind an equals sign: ``= 2*R + 0.3 mm``.

A text is cut into numbers, quantities, names and signs first, so that nothing but arithmetic of
known names reaches the parser; what it then says is computed by `fold` over numbers of any kind.
In files of a stage they are fractions: sums and products are exact, and a decimal number is rounded
once, as if the result had been written into the file. The equation of an uncertainty budget has the
same grammar, over uncertain numbers and arrays.
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

#: Most characters of an expression.
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
# bits of a fraction from which on it is rounded: sums of fractions of many digits grow
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
    """A value in SI units, and the powers of base quantities that it has.

    An angle is one as long as it is scaled by numbers; times a length it is an arc, and its ratio
    to another angle is a number.
    """

    value: Fraction
    """The value [SI]."""
    powers: Powers = ()
    """Powers of base quantities, in alphabetical order; none for a number."""

    @property
    def noun(self) -> str:
        """What it is, with the article."""
        return noun_of(self.powers)


@dataclass(frozen=True, slots=True)
class Grammar:
    """The names and functions that expressions of a kind of file have."""

    noun: str
    """What a name stands for, in messages."""
    made_of: str
    """What an expression is made of beside operations, in messages."""
    functions: tuple[str, ...]
    """Names of the functions."""

    @property
    def a_noun(self) -> str:
        """The noun with its article."""
        return f"{'an' if self.noun[0] in 'aeiou' else 'a'} {self.noun}"


#: What the parameters of a file may be made of.
PARAMETERS = Grammar(
    "parameter",
    "numbers, units and names of parameters",
    ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan2", "hypot", "min", "max", "abs"),
)
#: Fewest and most arguments of the functions that do not take one.
_ARGUMENTS = {"atan2": (2, 2), "hypot": (2, 100), "min": (2, 100), "max": (2, 100)}


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
    """The names that it needs."""
    units: frozenset[str]
    """The units of its quantities."""

    def by_name(self, constants: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by the names that they have in the tree."""
        return {**constants, **{f"p_{name}": values[name] for name in self.names}}

    def part(self, node: ast.expr) -> str:
        """Return the text of a part of the tree."""

        def written(word: re.Match[str]) -> str:
            constant = self.constants.get(word[0])
            return word[0][2:] if constant is None else f"{float(constant.value):.6g}"

        return re.sub(r"\bp_\w+|\b_\d+\b", written, ast.unparse(node))


def powers_of(dimension: str) -> Powers:
    """Return the powers of base quantities of one of `flexstage.quantities.units.DIMENSIONS`."""
    if dimension in ("", "angle"):
        return _ANGLE if dimension else ()
    return powers_in(DIMENSIONS[dimension].si)


def powers_in(si: str) -> Powers:
    """Return the powers of base quantities of an SI unit, to which an angle is a number."""
    return tuple(sorted((base.strip("[]"), Fraction(p)) for base, p in dimensions(si).items()))


def dimension_named(powers: Powers) -> str | None:
    """Return one of `flexstage.quantities.units.DIMENSIONS` by powers; "" for a plain number."""
    return _named().get(powers)


@lru_cache(maxsize=1)
def _named() -> dict[Powers, str]:
    return {(): "", **{powers_of(name): name for name in reversed(DIMENSIONS)}}


def noun_of(powers: Powers) -> str:
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


def check_name(name: str, grammar: Grammar = PARAMETERS) -> None:
    """Refuse a name that could not stand in an expression."""
    if not _NAME.fullmatch(name) or len(name) > 80:
        raise UnitError(
            f"{grammar.a_noun} is called by letters, digits and underscores, from a letter "
            f"on, such as leg_spacing, got {name[:80]!r}"
        )
    if name in grammar.functions or name == "pi":
        raise UnitError(
            f"'{name}' is a {'constant' if name == 'pi' else 'function'} of expressions: give the "
            f"{grammar.noun} another name"
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
def parse(text: str, grammar: Grammar = PARAMETERS) -> QuantityExpression:
    """Read an expression, which begins with an equals sign in files of parameters.

    Examples
    --------
    >>> sorted(parse("= 2*R + max(t, 0.3 mm)").names)
    ['R', 't']
    """
    body = text.strip().removeprefix("=")
    if len(body) > LONGEST:
        raise UnitError(
            f"an expression has at most {LONGEST} characters, got {len(body)}: divide it among "
            f"{grammar.noun}s"
        )
    constants: dict[str, Amount] = {}
    names: set[str] = set()
    units: set[str] = set()
    words = []
    at, depth = 0, 0
    while body[at:].strip():
        token = _TOKEN.match(body, at)
        if token is None:
            _refuse_sign(body[at:].lstrip()[0], text, grammar)
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
                names |= {word} - {"pi"}
            elif token["name"] and word not in grammar.functions:
                _refuse_function(word, grammar)
        depth += {"(": 1, ")": -1}.get(word, 0)
        if depth > DEEPEST:
            raise UnitError(
                f"an expression is nested at most {DEEPEST} deep: {shown(text)} is "
                f"deeper; divide it among {grammar.noun}s"
            )
        words.append(word)
    if bad := next((n for n in names if not _NAME.fullmatch(n)), None):
        raise UnitError(f"'{bad[:60]}' is no name of {grammar.a_noun}, which begins with a letter")
    if not words:
        raise UnitError("an expression is empty: write one such as 2*R")
    # names that mean something to the parser become some that do not
    spelled = " ".join(f"p_{word}" if word in names else word for word in words)
    try:
        tree = ast.parse(spelled, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise UnitError(
            f"{shown(text)} is no arithmetic: write it of + - * / ** and parentheses, with "
            f"{grammar.made_of}"
        ) from None
    _require_arithmetic(tree, grammar, 0)
    return QuantityExpression(text, tree, constants, frozenset(names), frozenset(units))


def _require_arithmetic(node: ast.expr, grammar: Grammar, depth: int) -> None:
    """Refuse a tree that holds anything but operations, names, and functions as they are called."""
    if depth > _MOST_OPERATIONS:
        raise UnitError(
            f"an expression has at most {_MOST_OPERATIONS} operations in a row: divide it among "
            f"{grammar.noun}s"
        )
    match node:
        case ast.Name():
            pass
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in grammar.functions:
            least, most = _ARGUMENTS.get(name, (1, 1))
            if not least <= len(args) <= most:
                count = f"{least}" if least == most else f"{least} or more"
                raise UnitError(f"{name} takes {count} values, got {len(args)}")
        case ast.BinOp(op=op) | ast.UnaryOp(op=op) if type(op) in _OPERATIONS:
            pass
        case _:
            listed = ", ".join((*grammar.functions, "pi"))
            raise UnitError(
                f"an expression is of + - * / **, parentheses, {grammar.made_of}, and {listed}"
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
    """Compute a tree from its names up: `step` takes a node and the values of its parts."""
    return step(node, *(fold(part, step) for part in _parts(node)))


def computing(
    values: Mapping[str, Any],
    operations: Mapping[type, Callable[..., Any]],
    functions: Mapping[str, Callable[..., Any]],
) -> Callable[..., Any]:
    """Return the step of `fold` that computes values of any kind by operations of their own."""

    def step(node: Any, *parts: Any) -> Any:
        if isinstance(node, ast.Name):
            return values[node.id]
        if isinstance(node, ast.Call):
            return functions[ast.unparse(node.func)](*parts)
        return operations[type(node.op)](*parts)

    return step


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
            f"'{unit}' behind a number in {shown(expression.text)} is a unit, and a parameter has "
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
        raise UnitError(f"{error}; a product is written with *") from None
    return Amount(_bounded(amount.value), amount.powers)


def _too_large(text: str) -> UnitError:
    return UnitError(f"{shown(text)} is too large to be a number")


def _same(what: str, *amounts: Amount) -> Powers:
    """Return the powers that all have; refuse others."""
    for other in amounts[1:]:
        if other.powers != amounts[0].powers:
            raise UnitError(
                f"{what} needs values of one dimension, got {amounts[0].noun} and {other.noun}"
            )
    return amounts[0].powers


def product(first: Powers, second: Powers, sign: int) -> Powers:
    """Return the powers of a product; of a quotient where the sign is negative."""
    if first == () and second == _ANGLE and sign < 0:
        raise UnitError("a number is divided by an angle, which gives no quantity of a file")
    if () in (first, second):  # an angle stays one
        return first or tuple((base, sign * p) for base, p in second)
    total = {base: p for base, p in first if base != "angle"}
    for base, p in second:
        if base != "angle":
            total[base] = total.get(base, Fraction(0)) + sign * p
    return tuple(sorted((base, p) for base, p in total.items() if p))


def _divide(first: Amount, second: Amount) -> Amount:
    if not second.value:
        raise UnitError("it divides by zero")
    return Amount(first.value / second.value, product(first.powers, second.powers, -1))


def power(base: Amount, exponent: Amount) -> Amount:
    """Return a power whose exponent is a number."""
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


def _bounding(operation: Callable[..., Amount]) -> Callable[..., Amount]:
    def of(first: Amount, second: Amount) -> Amount:
        made = operation(first, second)
        return Amount(_bounded(made.value), made.powers)

    return of


def _sqrt(amount: Amount) -> Amount:
    if amount.value < 0:
        raise UnitError("sqrt takes no negative value")
    return power(amount, Amount(Fraction(1, 2)))


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
        ".": ": a name has no parts in an expression",
        ";": ": a file holds no program",
        "×": ": write * for a product",
        "·": ": write * for a product",
    }.get(sign, f": it is arithmetic of {grammar.made_of}")
    raise UnitError(f"{sign!r} has no meaning in {shown(text)}{instead}")


def _refuse_function(name: str, grammar: Grammar) -> NoReturn:
    hint = did_you_mean(name, grammar.functions, 0.6)
    raise UnitError(
        f"there is no function '{name[:60]}' (there are: {', '.join(grammar.functions)}){hint}"
    )


def shown(text: str) -> str:
    """Return a text for a message, cut where it is long."""
    plain = " ".join(text.split())
    return repr(plain if len(plain) <= 60 else plain[:57] + "...")
