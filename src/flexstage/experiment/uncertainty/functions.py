"""Mathematical functions that take uncertain numbers of GTC, arrays and plain floats alike."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np


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
