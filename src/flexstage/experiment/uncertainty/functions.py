"""Mathematical functions that take uncertain numbers of GTC, arrays and plain floats alike."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = [
    "FUNCTIONS",
    "acos",
    "asin",
    "atan",
    "atan2",
    "cos",
    "exp",
    "fabs",
    "hypot",
    "log",
    "sin",
    "sqrt",
    "tan",
]


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
    """Return the square root.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The argument.

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The root, of the kind of the argument.
    """
    return _applied("sqrt", "sqrt", x)


def sin(x: Any) -> Any:
    """Return the sine.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The angle [rad].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The sine, of the kind of the argument.

    Examples
    --------
    >>> sin(0.5)
    0.479425538604203
    """
    return _applied("sin", "sin", x)


def cos(x: Any) -> Any:
    """Return the cosine.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The angle [rad].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The cosine, of the kind of the argument.
    """
    return _applied("cos", "cos", x)


def tan(x: Any) -> Any:
    """Return the tangent.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The angle [rad].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The tangent, of the kind of the argument.
    """
    return _applied("tan", "tan", x)


def asin(x: Any) -> Any:
    """Return the angle of a sine.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The sine, -1 to 1 [1].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The angle [rad], of the kind of the argument.
    """
    return _applied("asin", "arcsin", x)


def acos(x: Any) -> Any:
    """Return the angle of a cosine.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The cosine, -1 to 1 [1].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The angle [rad], of the kind of the argument.
    """
    return _applied("acos", "arccos", x)


def atan(x: Any) -> Any:
    """Return the angle of a tangent.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The tangent [1].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The angle [rad], of the kind of the argument.
    """
    return _applied("atan", "arctan", x)


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of a point, in all four quadrants.

    Parameters
    ----------
    y, x : uncertain number, numpy.ndarray or float
        Its coordinates.

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The angle [rad], of the kind of the arguments.
    """
    return _applied("atan2", "arctan2", y, x)


def exp(x: Any) -> Any:
    """Return the exponential function.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The argument [1].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The power of e, of the kind of the argument.
    """
    return _applied("exp", "exp", x)


def log(x: Any) -> Any:
    """Return the natural logarithm.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The argument [1].

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The logarithm, of the kind of the argument.
    """
    return _applied("log", "log", x)


def fabs(x: Any) -> Any:
    """Return the value without its sign.

    Parameters
    ----------
    x : uncertain number, numpy.ndarray or float
        The argument.

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The same where positive, else its negative: an uncertain number keeps its uncertainty.
    """
    if isinstance(x, np.ndarray):
        return np.abs(x)
    # GTC's own abs gives up the derivative
    return -x if x < 0.0 else +x


def hypot(x: Any, y: Any) -> Any:
    """Return the distance of a point from the origin.

    Parameters
    ----------
    x, y : uncertain number, numpy.ndarray or float
        Its coordinates.

    Returns
    -------
    uncertain number, numpy.ndarray or float
        The distance, of the kind of the arguments.
    """
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
