"""The equation of a budget: an expression of files over uncertain numbers, arrays or dimensions."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any, NoReturn

import numpy as np

from flexstage.errors import ModelError, UnitError
from flexstage.files.expression import (
    Amount,
    Grammar,
    Powers,
    QuantityExpression,
    computing,
    evaluate,
    fold,
    noun_of,
    parse,
    power,
    powers_in,
    product,
    shown,
)

_APPLIED = ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log")


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


def hypot(x: Any, *others: Any) -> Any:
    """Return the distance of a point from the origin."""
    return sqrt(sum((other * other for other in others), x * x))


#: The functions by the name that an equation calls them by.
FUNCTIONS: dict[str, Callable[..., Any]] = {name: partial(_applied, name) for name in _APPLIED}
FUNCTIONS |= {"abs": fabs, "hypot": hypot}
sqrt, sin, cos, tan, asin, acos, atan, atan2, exp, log = (FUNCTIONS[name] for name in _APPLIED)

#: What an equation may be made of.
INFLUENCES = Grammar("influence", "numbers and names of influences", tuple(FUNCTIONS))
_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_TEMPERATURE = powers_in("K")


def equation_of(text: str) -> QuantityExpression:
    """Read an equation such as ``l * (1 + c) / cos(a) - d * pitch``.

    Only numbers, names, ``+ - * / **``, brackets, ``pi`` and the functions ``sqrt sin cos tan asin
    acos atan atan2 exp log abs hypot`` have a meaning; whatever else the text holds is refused
    before anything is computed.

    Examples
    --------
    >>> volume = equation_of("pi * d**2 / 4 * h")
    >>> round(compute(volume, {"d": 2.0, "h": 3.0}), 4)
    9.4248
    """
    equation = parse(text, INFLUENCES)
    for unit in sorted(equation.units):
        raise UnitError(f"a number with a unit, '{unit}', is an influence of its own")
    return equation


def compute(equation: QuantityExpression, values: Mapping[str, Any]) -> Any:
    """Compute an equation with uncertain numbers, arrays or floats, one for each of its names.

    Numbers are floats, so that a power that is too large ends as an error.
    """
    constants = {name: float(amount.value) for name, amount in equation.constants.items()}
    named = equation.by_name({**constants, "pi": math.pi}, values)
    try:
        return fold(equation.tree, computing(named, _OPERATIONS, FUNCTIONS))
    except (ArithmeticError, ValueError) as error:
        raise ModelError(f"the equation {shown(equation.text)} has no value: {error}") from error


def require_unit(equation: QuantityExpression, units: Mapping[str, str], unit: str) -> None:
    """Refuse an equation that joins what is of two kinds, or whose result is not of its unit.

    A number in the equation is a plain one, but beside a temperature in degrees Celsius, where it
    is one as well: the reference of an expansion is written so, ``t - 20``. Angles are plain
    numbers, as they are to SI.
    """
    plain: Powers = ()
    named = equation.by_name(
        dict.fromkeys([*equation.constants, "pi"], plain),
        {name: powers_in(one) for name, one in units.items()},
    )
    celsius = {f"p_{name}" for name, one in units.items() if one == "degC"}

    def in_celsius(node: ast.expr, kind: Powers) -> bool:
        return kind == _TEMPERATURE and not celsius.isdisjoint(_names(node))

    def alike(does: str, nodes: list[ast.expr], kinds: tuple[Powers, ...]) -> Powers:
        (a, b), (first, second) = nodes, kinds
        if first == second or (_is_number(b) and in_celsius(a, first)):
            return first
        if _is_number(a) and in_celsius(b, second):
            return second
        hint = "; a number with a unit is an influence of its own"
        raise ModelError(
            f"the equation {does} {equation.part(a)}, {noun_of(first)}, and {equation.part(b)}, "
            f"{noun_of(second)}, which are of two kinds: give both the same dimension"
            f"{hint if _is_number(a) or _is_number(b) else ''}"
        )

    def step(node: ast.expr, *kinds: Powers) -> Powers:
        match node:
            case ast.Name(id=name):
                return named[name]
            case ast.UnaryOp():
                return kinds[0]
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
                does = "adds" if isinstance(op, ast.Add) else "subtracts"
                return alike(does, [left, right], kinds)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return _raised(equation, left, right, kinds)
            case ast.BinOp(op=op):
                return product(kinds[0], kinds[1], 1 if isinstance(op, ast.Mult) else -1)
            case ast.Call(func=ast.Name(id="atan2" | "hypot" as name), args=args):
                found = kinds[0]
                for one, kind in zip(args[1:], kinds[1:], strict=True):
                    found = alike(f"takes {name} of", [args[0], one], (found, kind))
                return found if name == "hypot" else plain
            case ast.Call(func=ast.Name(id="abs")):
                return kinds[0]
            case ast.Call(func=ast.Name(id="sqrt")):
                return power(Amount(Fraction(1), kinds[0]), Amount(Fraction(1, 2))).powers
            case ast.Call(func=ast.Name(id=name), args=args) if kinds[0]:
                _refuse(
                    f"takes {name} of {equation.part(args[0])}, {noun_of(kinds[0])}, where only a "
                    "plain number or an angle has one"
                )
        return plain

    found, wanted = fold(equation.tree, step), powers_in(unit)
    if found != wanted:
        raise ModelError(
            f"the equation gives {noun_of(found)}, and the result is {noun_of(wanted)}: "
            "correct the equation, the unit of the result or that of an influence"
        )


def _raised(
    equation: QuantityExpression, base: ast.expr, exponent: ast.expr, kinds: tuple[Powers, ...]
) -> Powers:
    """The dimension of a power."""
    if kinds[1]:
        _refuse(f"raises to the power of {equation.part(exponent)}, {noun_of(kinds[1])}")
    if not kinds[0]:
        return kinds[0]
    if not _is_number(exponent):
        _refuse(
            f"raises {equation.part(base)}, {noun_of(kinds[0])}, to the power of "
            f"{equation.part(exponent)}, where only a number can stand"
        )
    alone = replace(equation, tree=exponent, names=frozenset())
    return power(Amount(Fraction(1), kinds[0]), evaluate(alone, {})).powers


def _names(node: ast.expr) -> set[str]:
    return {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def _is_number(node: ast.expr) -> bool:
    """Say whether a part of the tree is made of numbers alone."""
    words = _names(node) - {"pi"}
    return all(word.startswith("_") for word in words)


def _refuse(what: str) -> NoReturn:
    raise ModelError(f"the equation {what}: divide by what makes it a plain number")
