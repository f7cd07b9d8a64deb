"""An equation as text, computed by its own evaluator: arithmetic, and the functions of a list."""

import ast
import keyword
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexstage.errors import ModelError
from flexstage.experiment.uncertainty.dimension import require_dimension

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


def _applied(name: str, array_name: str, *arguments: Any) -> Any:
    if any(isinstance(a, np.ndarray) for a in arguments):
        # values outside the domain come back as no numbers, which the caller counts
        with np.errstate(all="ignore"):
            return getattr(np, array_name)(*arguments)
    if all(isinstance(a, (int, float)) for a in arguments):
        return getattr(math, name)(*map(float, arguments))
    import GTC

    return getattr(GTC, name)(*arguments)


def sqrt(x: Any) -> Any:
    """Return the square root, as all functions here of the kind of the argument."""
    return _applied("sqrt", "sqrt", x)


def sin(x: Any) -> Any:
    """Return the sine of an angle [rad].

    Examples
    --------
    >>> sin(0.5)
    0.479425538604203
    """
    return _applied("sin", "sin", x)


def cos(x: Any) -> Any:
    """Return the cosine of an angle [rad]."""
    return _applied("cos", "cos", x)


def tan(x: Any) -> Any:
    """Return the tangent of an angle [rad]."""
    return _applied("tan", "tan", x)


def asin(x: Any) -> Any:
    """Return the angle of a sine [rad]."""
    return _applied("asin", "arcsin", x)


def acos(x: Any) -> Any:
    """Return the angle of a cosine [rad]."""
    return _applied("acos", "arccos", x)


def atan(x: Any) -> Any:
    """Return the angle of a tangent [rad]."""
    return _applied("atan", "arctan", x)


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of a point [rad], in all four quadrants."""
    return _applied("atan2", "arctan2", y, x)


def exp(x: Any) -> Any:
    """Return the exponential function."""
    return _applied("exp", "exp", x)


def log(x: Any) -> Any:
    """Return the natural logarithm."""
    return _applied("log", "log", x)


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
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sqrt": sqrt,
    "sin": sin,
    "cos": cos,
    "tan": tan,
    "asin": asin,
    "acos": acos,
    "atan": atan,
    "atan2": atan2,
    "exp": exp,
    "log": log,
    "abs": fabs,
    "hypot": hypot,
}


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
