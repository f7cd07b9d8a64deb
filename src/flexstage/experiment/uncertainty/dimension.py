"""The dimension of an equation: what it adds must be of one kind, and its result of the unit's."""

import ast
from collections.abc import Mapping
from typing import NoReturn

from flexstage.errors import ModelError
from flexstage.units import dimensions

Powers = dict[str, float]
_SYMBOLS = {
    "[mass]": "kg",
    "[length]": "m",
    "[time]": "s",
    "[current]": "A",
    "[temperature]": "K",
}
#: Functions of two arguments of one kind.
_ALIKE = ("atan2", "hypot")


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
            return _alike((node.left, node.right), units, "adds" if _adds(node) else "subtracts")
        if isinstance(node.op, ast.Pow):
            return _power(node, units)
        sign = 1.0 if isinstance(node.op, ast.Mult) else -1.0
        left, right = _dimension(node.left, units), _dimension(node.right, units)
        return _nonzero({k: left.get(k, 0.0) + sign * right.get(k, 0.0) for k in (*left, *right)})
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _called(node.func.id, node.args, units)
    return {}


def _adds(node: ast.BinOp) -> bool:
    return isinstance(node.op, ast.Add)


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
        hint = "; a number with a unit is an influence of its own" if _number_in(parts) else ""
        raise ModelError(
            f"the equation {does} {first} and {second}, which are of two kinds: give both the same "
            f"dimension{hint}"
        )
    return found[0]


def _number_in(parts: tuple[ast.expr, ...]) -> bool:
    return any(_number(part) is not None for part in parts)


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
