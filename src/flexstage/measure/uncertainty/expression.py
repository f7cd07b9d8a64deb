"""An equation as text: its own evaluator, the functions of a list, and what dimension it has."""

import ast
import keyword
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NoReturn

import numpy as np

from flexstage.errors import ModelError
from flexstage.units import dimensions

_LONGEST = 2000
_NODES = 400
_ARGUMENTS = {"atan2": 2, "hypot": 2}
_CONSTANTS = {"pi": math.pi}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: lambda a: a,
    ast.USub: lambda a: -a,
}


_APPLIED = ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log")
Powers = dict[str, float]
_SYMBOLS = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}
#: Functions of two arguments of one kind.
_ALIKE = ("atan2", "hypot")


def _applied(name: str, *arguments: Any) -> Any:
    """A function by its name, of the kind of its arguments: floats, arrays or uncertain numbers.

    Angles are in rad.

    Examples
    --------
    >>> sin(0.5)
    0.479425538604203
    """
    if any(isinstance(a, np.ndarray) for a in arguments):
        # values outside the domain come back as no numbers, which the caller counts
        with np.errstate(all="ignore"):
            return getattr(np, name)(*arguments)
    if all(isinstance(a, (int, float)) for a in arguments):
        return getattr(math, name)(*map(float, arguments))
    import GTC

    return getattr(GTC, name)(*arguments)


def fabs(x: Any) -> Any:
    """Return the value without its sign; an uncertain number keeps its uncertainty."""
    if isinstance(x, np.ndarray):
        return np.abs(x)
    # GTC's own abs gives up the derivative
    return -x if x < 0.0 else +x


def hypot(x: Any, y: Any) -> Any:
    """Return the distance of a point from the origin."""
    return sqrt(x * x + y * y)


#: The functions by the name that an equation calls them by.
FUNCTIONS: dict[str, Callable[..., Any]] = {name: partial(_applied, name) for name in _APPLIED}
FUNCTIONS |= {"abs": fabs, "hypot": hypot}
sqrt, sin, cos, tan, asin, acos, atan, atan2, exp, log = (FUNCTIONS[name] for name in _APPLIED)


@dataclass(frozen=True, slots=True)
class Expression:
    """An equation such as ``l * (1 + c) / cos(a) - d * pitch``.

    It is parsed as Python and walked node by node. Only numbers, names, ``+ - * / **``, brackets,
    ``pi`` and the functions ``sqrt sin cos tan asin acos atan atan2 exp log abs hypot`` have a
    meaning; whatever else the text holds is refused before anything is computed.

    Notes
    -----
    Validity: all numbers are floats, so a power that is too large ends as an error and not as a
    number of many digits.

    Examples
    --------
    >>> volume = Expression("pi * d**2 / 4 * h")
    >>> volume.names, round(volume(d=2.0, h=3.0), 4)
    (('d', 'h'), 9.4248)
    """

    text: str
    """The equation."""
    _tree: ast.expr = field(init=False, repr=False, compare=False)
    names: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        tree = _parsed(self.text)
        names: dict[str, None] = {}
        for node in _walk(tree):
            _require_known(node)
            if isinstance(node, ast.Name) and node.id not in _CONSTANTS:
                names[node.id] = None
        # in their order of appearance
        object.__setattr__(self, "_tree", tree)
        object.__setattr__(self, "names", tuple(names))

    def __call__(self, **values: Any) -> Any:
        """Compute the equation with uncertain numbers, arrays or floats, one for each name."""
        missing = [name for name in self.names if name not in values]
        if missing:
            raise ModelError(
                f"the equation names {', '.join(missing)}, which nothing has a value for"
            )
        try:
            return _value(self._tree, values)
        except (ArithmeticError, ValueError) as error:
            raise ModelError(f"the equation '{_short(self.text)}' has no value: {error}") from error

    def require_unit(self, units: Mapping[str, str], unit: str) -> None:
        """Refuse the equation where what it adds is of two kinds, or its result not of a unit."""
        require_dimension(self._tree, units, unit)

    def ordered(self, names: tuple[str, ...]) -> Callable[..., Any]:
        """Return the equation as a function of values in a given order of names."""
        return lambda *values: self(**dict(zip(names, values, strict=True)))

    @staticmethod
    def is_name(text: str) -> bool:
        """Say whether a text can be the name of a quantity in an equation.

        A word of letters, digits and underscores, and no function or constant of equations.
        """
        taken = text in FUNCTIONS or text in _CONSTANTS or keyword.iskeyword(text)
        return text.isidentifier() and not taken and not text.startswith("__")


def _parsed(text: str) -> ast.expr:
    if not isinstance(text, str) or not text.strip():
        raise ModelError("the equation is empty: write one such as l * (1 + c)")
    if len(text) > _LONGEST:
        raise ModelError(f"the equation has {len(text)} characters, more than {_LONGEST}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = getattr(error, "msg", None) or "it cannot be parsed"
        raise ModelError(f"'{_short(text)}' is no equation: {reason}") from None
    return tree


def _walk(tree: ast.expr) -> list[ast.AST]:
    """All nodes, the meaningless context of a name left out."""
    found: list[ast.AST] = []
    stack: list[ast.AST] = [tree]
    while stack:
        node = stack.pop()
        found.append(node)
        if len(found) > _NODES:
            raise ModelError(f"the equation has more than {_NODES} parts: split it up")
        if isinstance(node, ast.Call):
            # its function is a name that is no quantity
            children: list[ast.AST] = [*node.args]
        else:
            children = [
                c for c in ast.iter_child_nodes(node) if not isinstance(c, ast.expr_context)
            ]
        stack += reversed(children)
    return found


def _require_known(node: ast.AST) -> None:
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise ModelError(f"an equation holds plain numbers, got {_short(repr(node.value))}")
        try:
            finite = math.isfinite(float(node.value))
        except OverflowError:
            finite = False
        if not finite:
            raise ModelError("a number of the equation is too large")
    elif isinstance(node, ast.Call):
        _require_call(node)
    elif isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise ModelError(f"'{node.id}' is a function: write {node.id}(...)")
        if not Expression.is_name(node.id) and node.id not in _CONSTANTS:
            raise ModelError(f"'{_short(node.id)}' cannot be a name in an equation")
    elif isinstance(node, ast.BinOp):
        if type(node.op) is ast.BitXor:
            raise ModelError("a power is written **, as in d**2, got ^")
        if type(node.op) not in _BINARY:
            raise ModelError(_refusal(node.op))
    elif isinstance(node, ast.UnaryOp):
        if type(node.op) not in _UNARY:
            raise ModelError(_refusal(node.op))
    elif not isinstance(node, (ast.operator, ast.unaryop)):
        raise ModelError(_refusal(node))


def _require_call(node: ast.Call) -> None:
    if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS:
        what = _short(node.func.id) if isinstance(node.func, ast.Name) else "that"
        raise ModelError(
            f"'{what}' is no function of an equation: expected one of {', '.join(FUNCTIONS)}"
        )
    count = _ARGUMENTS.get(node.func.id, 1)
    starred = any(isinstance(a, ast.Starred) for a in node.args)
    if node.keywords or starred or len(node.args) != count:
        raise ModelError(f"{node.func.id} takes {count} argument{'s' if count > 1 else ''}")


def _refusal(node: ast.AST) -> str:
    return (
        f"an equation is made of + - * / **, brackets, names and functions, got a "
        f"{type(node).__name__}"
    )


def _value(node: ast.AST, values: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        # a quantity goes before a constant, though none may be called like one
        return values[node.id] if node.id in values else _CONSTANTS[node.id]
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.UnaryOp):
        return _UNARY[type(node.op)](_value(node.operand, values))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return FUNCTIONS[node.func.id](*(_value(a, values) for a in node.args))
    raise ModelError(_refusal(node))


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def require_dimension(tree: ast.expr, units: Mapping[str, str], unit: str) -> None:
    """Refuse an equation whose result is not of the unit that it is to have.

    A number in the equation is a plain one, but beside a temperature in degrees Celsius, where it
    is one as well. Angles are plain numbers, as they are to SI.
    """
    found, wanted = _dimension(tree, units), dimensions(unit)
    if found != wanted:
        raise ModelError(
            f"the equation gives {_written(found)}, and the result is in {_written(wanted)}: "
            "correct the equation, the unit of the result or that of an influence"
        )


def _dimension(node: ast.expr, units: Mapping[str, str]) -> Powers:
    """Powers of the base quantities of an equation made of what `Expression` allows."""
    if isinstance(node, ast.Name) and node.id in units:
        return dimensions(units[node.id])
    if isinstance(node, ast.UnaryOp):
        return _dimension(node.operand, units)
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, (ast.Add, ast.Sub)):
            does = "adds" if isinstance(node.op, ast.Add) else "subtracts"
            return _alike((node.left, node.right), units, does)
        if isinstance(node.op, ast.Pow):
            return _power(node, units)
        sign = 1.0 if isinstance(node.op, ast.Mult) else -1.0
        left, right = _dimension(node.left, units), _dimension(node.right, units)
        return _nonzero({k: left.get(k, 0.0) + sign * right.get(k, 0.0) for k in (*left, *right)})
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _called(node.func.id, node.args, units)
    return {}


def _alike(parts: tuple[ast.expr, ...], units: Mapping[str, str], does: str) -> Powers:
    found = [_dimension(part, units) for part in parts]
    for part, other in ((0, 1), (1, 0)):
        # the reference temperature of an expansion is written as a number: t - 20
        if _number(parts[part]) is not None and _celsius(parts[other], units):
            return found[other]
    if found[0] != found[1]:
        first, second = (
            f"{ast.unparse(part)} in {_written(powers)}"
            for part, powers in zip(parts, found, strict=True)
        )
        hint = (
            "; a number with a unit is an influence of its own"
            if any(_number(part) is not None for part in parts)
            else ""
        )
        raise ModelError(
            f"the equation {does} {first} and {second}, which are of two kinds: give both the same "
            f"dimension{hint}"
        )
    return found[0]


def _celsius(node: ast.expr, units: Mapping[str, str]) -> bool:
    names = [n.id for n in ast.walk(node) if isinstance(n, ast.Name)]
    return any(units.get(name) == "degC" for name in names) and _dimension(
        node, units
    ) == dimensions("K")


def _number(node: ast.expr) -> float | None:
    """Value of what holds numbers alone."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return float(node.value)
    if isinstance(node, ast.UnaryOp):
        value = _number(node.operand)
        return None if value is None else -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Div, ast.Mult)):
        left, right = _number(node.left), _number(node.right)
        if left is not None and right is not None:
            if isinstance(node.op, ast.Mult):
                return left * right
            return left / right if right else None
    return None


def _power(node: ast.BinOp, units: Mapping[str, str]) -> Powers:
    base, above = _dimension(node.left, units), _dimension(node.right, units)
    if above:
        _refuse(f"raises to the power of {ast.unparse(node.right)} in {_written(above)}")
    if not base:
        return base
    exponent = _number(node.right)
    if exponent is None:
        _refuse(
            f"raises {ast.unparse(node.left)} in {_written(base)} to the power of "
            f"{ast.unparse(node.right)}, where only a number can stand"
        )
    return _nonzero({k: exponent * power for k, power in base.items()})


def _called(name: str, arguments: list[ast.expr], units: Mapping[str, str]) -> Powers:
    if name in _ALIKE:
        found = _alike((arguments[0], arguments[1]), units, f"takes {name} of")
        return {} if name == "atan2" else found
    found = _dimension(arguments[0], units)
    if name == "abs":
        return found
    if name == "sqrt":
        return {k: 0.5 * power for k, power in found.items()}
    if found:
        _refuse(
            f"takes {name} of {ast.unparse(arguments[0])} in {_written(found)}, where only a plain "
            "number or an angle has one"
        )
    return {}


def _refuse(what: str) -> NoReturn:
    raise ModelError(f"the equation {what}: divide by what makes it a plain number")


def _nonzero(powers: Powers) -> Powers:
    return {k: p for k, p in powers.items() if p}


def _written(powers: Powers) -> str:
    """A dimension in base units, for messages."""
    if not powers:
        return "plain numbers"
    ordered = sorted(powers.items(), key=lambda one: list(_SYMBOLS).index(one[0]))
    return "*".join(
        _SYMBOLS[base] + ("" if power == 1.0 else f"^{power:g}") for base, power in ordered
    )
