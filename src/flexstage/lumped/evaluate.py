"""Numbers for expressions: exact sums of products, so that determinants keep their digits.

An expression is walked once and its parts remembered; for the few hundred entries of a model this
is ten times faster than compiling it. Arithmetic is rational: expanded determinants cancel to a
small part of their terms, and rounding each term would leave nothing of them.
"""

# SymPy's own annotations are partial and contradict what its functions return.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false
# pyright: reportCallIssue=false, reportOptionalMemberAccess=false, reportIndexIssue=false

import math
from collections.abc import Mapping
from fractions import Fraction

import sympy as sp

Known = dict[sp.Basic, Fraction]


def starting_values(values: Mapping[sp.Symbol, float]) -> Known:
    """Prepare numbers for `exact` and `number`."""
    return {symbol: Fraction(value) for symbol, value in values.items()}


def number(expression: sp.Basic, known: Known) -> float:
    """Evaluate an expression.

    Correctly rounded but for sines and cosines; see `exact`.
    """
    return float(exact(expression, known))


def exact(expression: sp.Basic, known: Known) -> Fraction:
    """Evaluate an expression in rational arithmetic.

    It is made of sums, products, whole powers, sines and cosines of symbols and numbers; sines and
    cosines are rounded to a double first. `known` comes from `starting_values`, and parts that were
    evaluated are added.
    """
    value = known.get(expression)
    if value is not None:
        return value
    if isinstance(expression, sp.Symbol):
        raise KeyError(f"the symbol '{expression.name}' has no value")
    if isinstance(expression, sp.Add):
        value = sum((exact(a, known) for a in expression.args), Fraction(0))
    elif isinstance(expression, sp.Mul):
        value = Fraction(1)
        for a in expression.args:
            value *= exact(a, known)
    elif isinstance(expression, sp.Pow):
        value = exact(expression.base, known) ** int(expression.exp)
    elif isinstance(expression, (sp.cos, sp.sin)):
        angle = float(exact(expression.args[0], known))
        value = Fraction(math.cos(angle) if isinstance(expression, sp.cos) else math.sin(angle))
    elif isinstance(expression, sp.Rational):
        value = Fraction(int(expression.p), int(expression.q))
    else:
        value = Fraction(float(expression))
    known[expression] = value
    return value
