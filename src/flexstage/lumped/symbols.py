"""Symbols for the numbers of a mechanism, one for equal numbers, and numbers for expressions."""

# SymPy's own annotations are partial and contradict what its functions return.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false
# pyright: reportCallIssue=false, reportOptionalMemberAccess=false, reportIndexIssue=false

import math
import re
from collections.abc import Mapping
from fractions import Fraction

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from flexstage.lumped.rigid_bodies import Mechanism


def upright(name: str) -> str:
    r"""Write a name of a drive or probe as an index of a symbol, in LaTeX.

    What means something to LaTeX is left out.

    Examples
    --------
    >>> print(upright("x_1 50%"))
    \mathrm{x\_1 50-}
    """
    plain = re.sub(r"[^\w .+-]", "-", name).replace("_", r"\_")
    return rf"\mathrm{{{plain}}}"


# Two numbers closer than this to each other, relative to the largest of their kind, are one: it is
# some roundings of a coordinate, a thousandth of what the matrices are compared to.
_SAME = 2e-15

_TEXT = {
    "uu": "u",
    "vv": "v",
    "tt": r"\theta",
    "uv": "uv",
    "ut": r"u\theta",
    "vt": r"v\theta",
}


class SymbolTable:
    """Gives a symbol for each number, the same symbol for the same number.

    The size of the mechanism sets how close two lengths must be to be one.
    """

    def __init__(self, source: Mechanism) -> None:
        points = [b.centre for b in source.bodies] + [h.at for h in source.hinges]
        self._size = float(np.abs(np.array(points)).max(initial=1e-300))
        self._known: dict[str, list[tuple[float, sp.Symbol]]] = {}
        self._types: list[NDArray[np.float64]] = []
        self.values: dict[sp.Symbol, float] = {}

    def mass(self, value: float) -> sp.Symbol:
        """Return the symbol of a mass [kg]: m_1, m_2, ..."""
        return self._symbol("m", value, 1e-13 * value, positive=True)

    def inertia(self, value: float) -> sp.Symbol:
        """Return the symbol of a moment of inertia [kg m^2]: J_1, J_2, ..."""
        return self._symbol("J", value, 1e-13 * value, positive=True)

    def length(self, value: float) -> sp.Expr:
        """Return the symbol of a lever arm [m], with its sign: l_1 or -l_1, ..., or 0."""
        near = _SAME * self._size
        if abs(value) <= near:
            return sp.S.Zero
        symbol = self._symbol("ell", abs(value), near, positive=True)
        return symbol if value > 0.0 else -symbol

    def direction(self, angle: float) -> tuple[sp.Expr, sp.Expr]:
        """Return cosine and sine of a direction; numbers where it is along x or y.

        The symbol is the acute angle to the x axis: mirror images share it.
        """
        c, s = math.cos(angle), math.sin(angle)
        if min(abs(c), abs(s)) < 1e-15:
            return sp.Integer(round(c)), sp.Integer(round(s))
        symbol = self._symbol("phi", math.atan2(abs(s), abs(c)), _SAME, positive=False)
        along, across = sp.cos(symbol), sp.sin(symbol)
        return along if c > 0.0 else -along, across if s > 0.0 else -across

    def hinge_type(self, stiffness: NDArray[np.float64]) -> int:
        """Return the number of a kind of hinge, from 1: one for all of the same stiffness."""
        for i, known in enumerate(self._types):
            scale = np.sqrt(np.outer(np.diag(known), np.diag(known)))
            if np.all(np.abs(stiffness - known) <= 1e-13 * scale):
                return i + 1
        self._types.append(stiffness)
        return len(self._types)

    def spring(
        self, letter: str, key: str, group: int, stiffness: float, *, value: float | None = None
    ) -> sp.Expr:
        """Return the symbol of an entry of a hinge's stiffness or damping.

        `letter` is ``k`` or ``c``, `key` two letters, ``uu`` for along the hinge and so on, `group`
        the kind of hinge; `value` is the number of the symbol, if not `stiffness`. It is 0 where
        the stiffness has no such coupling.
        """
        known = self._types[group - 1]
        i, j = ("uvt".index(c) for c in key)
        # rounding leaves couplings that a symmetric notch does not have
        if abs(stiffness) <= 1e-14 * math.sqrt(known[i, i] * known[j, j]):
            return sp.S.Zero
        symbol = sp.Symbol(f"{letter}_{{{_TEXT[key]}{group}}}", real=True)
        self.values.setdefault(symbol, float(stiffness if value is None else value))
        return symbol

    def drive_stiffness(self, number: int, value: float) -> sp.Symbol:
        """Return the symbol of a drive's stiffness [N/m]: k_d1, k_d2, ..."""
        symbol = sp.Symbol(f"k_{{d{number}}}", positive=True)
        self.values[symbol] = value
        return symbol

    def rayleigh(self) -> tuple[sp.Symbol, sp.Symbol]:
        """Return the symbols of Rayleigh damping, with value 0."""
        alpha, beta = sp.symbols("alpha beta", nonnegative=True)
        self.values |= {alpha: 0.0, beta: 0.0}
        return alpha, beta

    def _symbol(self, letter: str, value: float, near: float, *, positive: bool) -> sp.Symbol:
        known = self._known.setdefault(letter, [])
        for other, symbol in known:
            if abs(other - value) <= near:
                return symbol
        number = len(known) + 1
        if positive:
            symbol = sp.Symbol(f"{letter}_{number}", positive=True)
        else:
            symbol = sp.Symbol(f"{letter}_{number}", real=True)
        known.append((value, symbol))
        self.values[symbol] = value
        return symbol


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
    evaluated are added: for the few hundred entries of a model this is ten times faster than
    compiling them. Expanded determinants cancel to a small part of their terms, and rounding each
    term would leave nothing of them.
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
