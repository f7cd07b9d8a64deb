r"""Symbols for the numbers of a mechanism, and one generic body and hinge derived in symbols.

Equal numbers share a symbol. The Hessian of the energy of a whole stage costs the square of its
coordinates in derivatives of a sum over all hinges. A hinge touches six coordinates only, so its
6 x 6 block is derived here once by Lagrange's equations, and every hinge of a stage is that block
with its own constants put in.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from flexstage.lumped.rigid_bodies import Mechanism, Sight


def upright(name: str) -> str:
    r"""Write a name of a drive or probe as an index of a symbol, in LaTeX.

    Special characters of LaTeX are omitted.

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
    """Table of symbols for numbers, the same symbol for the same number.

    The size of the mechanism sets the tolerance for equal lengths.
    """

    def __init__(self, source: Mechanism) -> None:
        points = [b.centre for b in source.bodies] + [h.at for h in source.hinges]
        self._size = float(np.abs(np.array(points)).max(initial=1e-300))
        self._symbols: dict[str, list[tuple[float, sp.Symbol]]] = {}
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
        """Return the number of a type of hinge, from 1: one for each stiffness."""
        for i, known_stiffness in enumerate(self._types):
            scale = np.sqrt(np.outer(np.diag(known_stiffness), np.diag(known_stiffness)))
            if np.all(np.abs(stiffness - known_stiffness) <= 1e-13 * scale):
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
        type_stiffness = self._types[group - 1]
        i, j = ("uvt".index(c) for c in key)
        # rounding leaves couplings that a symmetric notch does not have
        if abs(stiffness) <= 1e-14 * math.sqrt(type_stiffness[i, i] * type_stiffness[j, j]):
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
        numbers = self._symbols.setdefault(letter, [])
        for other, symbol in numbers:
            if abs(other - value) <= near:
                return symbol
        number = len(numbers) + 1
        kind = {"positive": True} if positive else {"real": True}
        symbol = sp.Symbol(f"{letter}_{number}", **kind)
        numbers.append((value, symbol))
        self.values[symbol] = value
        return symbol


Evaluated = dict[sp.Basic, Fraction]


def starting_values(values: Mapping[sp.Symbol, float]) -> Evaluated:
    """Prepare numbers for `exact` and `number`."""
    return {symbol: Fraction(value) for symbol, value in values.items()}


def number(expression: sp.Basic, evaluated: Evaluated) -> float:
    """Evaluate an expression.

    Correctly rounded but for sines and cosines; see `exact`.
    """
    return float(exact(expression, evaluated))


def exact(expression: sp.Basic, evaluated: Evaluated) -> Fraction:
    """Evaluate an expression in rational arithmetic.

    It is made of sums, products, whole powers, sines and cosines of symbols and numbers; sines and
    cosines are rounded to a double first. `evaluated` comes from `starting_values`, and further
    parts are added: for the few hundred entries of a model this is ten times faster than
    compiling them. Expanded determinants cancel to a small part of their terms, so that rounding
    each term would destroy them.
    """
    value = evaluated.get(expression)
    if value is not None:
        return value
    if isinstance(expression, sp.Symbol):
        raise KeyError(f"the symbol '{expression.name}' has no value")
    if isinstance(expression, sp.Add):
        value = sum((exact(a, evaluated) for a in expression.args), Fraction(0))
    elif isinstance(expression, sp.Mul):
        value = Fraction(1)
        for a in expression.args:
            value *= exact(a, evaluated)
    elif isinstance(expression, sp.Pow):
        value = exact(expression.base, evaluated) ** int(expression.exp)
    elif isinstance(expression, (sp.cos, sp.sin)):
        angle = float(exact(expression.args[0], evaluated))
        value = Fraction(math.cos(angle) if isinstance(expression, sp.cos) else math.sin(angle))
    elif isinstance(expression, sp.Rational):
        value = Fraction(int(expression.p), int(expression.q))
    else:
        value = Fraction(float(expression))
    evaluated[expression] = value
    return value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GenericBody:
    """A rigid body in the plane, in symbols."""

    coordinates: tuple[sp.Symbol, ...]
    """x, y, theta."""
    rates: tuple[sp.Symbol, ...]
    """Their rates."""
    mass: sp.Symbol
    """m."""
    inertia: sp.Symbol
    """J about the centre of mass."""
    kinetic_energy: sp.Expr
    """T."""
    momenta: tuple[sp.Expr, ...]
    """Derivatives of T with respect to the rates."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GenericHinge:
    """A hinge between two bodies, in symbols."""

    coordinates: tuple[sp.Symbol, ...]
    """x, y, theta of body a, then of body b."""
    rates: tuple[sp.Symbol, ...]
    """Their rates."""
    arms: tuple[sp.Symbol, ...]
    """Lever arms from the centres of mass to the neck: X, Y on body a, X, Y on body b."""
    cosine: sp.Symbol
    """Cosine of the hinge's direction."""
    sine: sp.Symbol
    """Sine of the hinge's direction."""
    stiffness: dict[str, sp.Symbol]
    """k_uu, k_vv, k_tt, k_uv, k_ut, k_vt by their two letters."""
    damping: dict[str, sp.Symbol]
    """The same of the damper."""
    deformation: tuple[sp.Expr, ...]
    """u, v, theta of b against a at the neck, in the hinge's axes."""
    potential_energy: sp.Expr
    """V, in the deformation put in full."""
    dissipation: sp.Expr
    """Rayleigh's function D of the rates."""
    forces: tuple[sp.Expr, ...]
    """Derivatives of V with respect to the coordinates."""
    block: sp.ImmutableMatrix
    """Hessian of V, shape (6, 6)."""
    damping_block: sp.ImmutableMatrix
    """Hessian of D with respect to the rates, shape (6, 6)."""


@lru_cache(maxsize=1)
def generic_body() -> GenericBody:
    r"""Return the generic body.

    Examples
    --------
    >>> generic_body().kinetic_energy
    J*\dot{\theta}**2/2 + m*(\dot{x}**2 + \dot{y}**2)/2
    """
    q = sp.symbols("x y theta", real=True)
    rates = sp.symbols(r"\dot{x} \dot{y} \dot{\theta}", real=True)
    m, J = sp.symbols("m J", positive=True)
    T = m * (rates[0] ** 2 + rates[1] ** 2) / 2 + J * rates[2] ** 2 / 2
    return GenericBody(
        coordinates=q,
        rates=rates,
        mass=m,
        inertia=J,
        kinetic_energy=T,
        momenta=tuple(sp.diff(T, v) for v in rates),
    )


@lru_cache(maxsize=1)
def generic_hinge() -> GenericHinge:
    """Return the generic hinge, derived by Lagrange's equations.

    Examples
    --------
    >>> generic_hinge().deformation[2]
    -theta_a + theta_b
    """
    q = sp.symbols("x_a y_a theta_a x_b y_b theta_b", real=True)
    rates = sp.symbols(
        r"\dot{x}_a \dot{y}_a \dot{\theta}_a \dot{x}_b \dot{y}_b \dot{\theta}_b", real=True
    )
    arms = sp.symbols("X_a Y_a X_b Y_b", real=True)
    c, s = sp.symbols("c s", real=True)
    stiffness, damping = _spring("k"), _spring("c")
    deformation = _deformation(q, arms, c, s)
    V = quadratic(stiffness, deformation)
    D = quadratic(damping, _deformation(rates, arms, c, s))
    forces = tuple(sp.diff(V, x) for x in q)
    damping_forces = tuple(sp.diff(D, x) for x in rates)
    return GenericHinge(
        coordinates=q,
        rates=rates,
        arms=arms,
        cosine=c,
        sine=s,
        stiffness=stiffness,
        damping=damping,
        deformation=deformation,
        potential_energy=V,
        dissipation=D,
        forces=forces,
        block=sp.ImmutableMatrix(6, 6, lambda i, j: sp.expand(sp.diff(forces[i], q[j]))),
        damping_block=sp.ImmutableMatrix(
            6, 6, lambda i, j: sp.expand(sp.diff(damping_forces[i], rates[j]))
        ),
    )


def _spring(letter: str) -> dict[str, sp.Symbol]:
    return {key: sp.Symbol(f"{letter}_{{{name}}}", real=True) for key, name in _TEXT.items()}


def _deformation(
    q: tuple[sp.Symbol, ...], arms: tuple[sp.Symbol, ...], c: sp.Symbol, s: sp.Symbol
) -> tuple[sp.Expr, ...]:
    xa, ya, ta, xb, yb, tb = q
    Xa, Ya, Xb, Yb = arms
    dx = (xb - tb * Yb) - (xa - ta * Ya)
    dy = (yb + tb * Xb) - (ya + ta * Xa)
    return c * dx + s * dy, c * dy - s * dx, tb - ta


def quadratic(k: dict[str, sp.Symbol], x: tuple[sp.Expr, ...]) -> sp.Expr:
    """Return the energy of a spring or the dissipation of a damper of a hinge."""
    u, v, t = x
    return (k["uu"] * u**2 + k["vv"] * v**2 + k["tt"] * t**2) / 2 + (
        k["uv"] * u * v + k["ut"] * u * t + k["vt"] * v * t
    )


_KEYS = {"uu": (0, 0), "vv": (1, 1), "tt": (2, 2), "uv": (0, 1), "ut": (0, 2), "vt": (1, 2)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HingeConstants:
    """Constants of a hinge in the generic block."""

    name: str
    """Name of the hinge."""
    bodies: tuple[int, int]
    """Numbers of bodies a and b among the free ones, from 1; 0 for fixed bodies."""
    constants: dict[sp.Symbol, sp.Expr]
    """Expression for each symbol of `flexstage.lumped.symbols.generic_hinge`."""


def hinge_constants(
    source: Mechanism, table: SymbolTable, i: int, damping: str
) -> dict[sp.Symbol, sp.Expr]:
    """Return the constant of a hinge for each symbol of the generic hinge.

    With `damping` ``hinge`` it has a damper as well.
    """
    hinge, generic = source.hinges[i], generic_hinge()
    out: dict[sp.Symbol, sp.Expr] = {}
    for side, body in enumerate(hinge.bodies):
        for axis in (0, 1):
            is_fixed = source.bodies[body].fixed
            arm = hinge.at[axis] - source.bodies[body].centre[axis]
            out[generic.arms[2 * side + axis]] = sp.S.Zero if is_fixed else table.length(arm)
    out[generic.cosine], out[generic.sine] = table.direction(hinge.direction)
    group = table.hinge_type(hinge.stiffness)
    for key, at in _KEYS.items():
        out[generic.stiffness[key]] = table.spring("k", key, group, hinge.stiffness[at])
        if damping == "hinge":
            out[generic.damping[key]] = table.spring(
                "c", key, group, hinge.stiffness[at], value=0.0
            )
    return out


def assemble_blocks(
    hinges: tuple[HingeConstants, ...],
    block: sp.ImmutableMatrix,
    energy: sp.Expr,
    local: tuple[sp.Symbol, ...],
    q: tuple[sp.Symbol, ...],
) -> tuple[dict[tuple[int, int], sp.Expr], sp.Expr]:
    """Sum the blocks and energies of all hinges; fixed bodies have no coordinates.

    `block` and `energy` are those of the generic hinge, `local` its six coordinates or rates, and
    `q` those of the stage. Returns the entries of the matrix by row and column, and the energy of
    all hinges.
    """
    terms: dict[tuple[int, int], list[sp.Expr]] = {}
    energies = []
    for hinge in hinges:
        where = [
            None if body == 0 else 3 * (body - 1) + j for body in hinge.bodies for j in range(3)
        ]
        moves = {x: sp.S.Zero if at is None else q[at] for x, at in zip(local, where, strict=True)}
        energies.append(energy.xreplace(hinge.constants | moves))
        for r in range(6):
            for c in range(r, 6):
                i, j = where[r], where[c]
                if i is None or j is None:
                    continue
                entry = block[r, c].xreplace(hinge.constants)
                if entry != 0:
                    terms.setdefault((i, j), []).append(entry)
                    if i != j:
                        terms.setdefault((j, i), []).append(entry)
    sums = {key: sp.Add(*parts) for key, parts in terms.items()}
    return {key: value for key, value in sums.items() if value != 0}, sp.Add(*energies)


def sight_vector(
    source: Mechanism, table: SymbolTable, sight: Sight, numbers: dict[int, int]
) -> sp.ImmutableMatrix:
    """Return the elongation of a drive or the reading of a probe for each coordinate.

    Shape (n, 1); `numbers` has the number of each free body, from 1, by its index in the mechanism.
    """
    turns = sight.direction is None
    c, s = (sp.S.Zero, sp.S.Zero) if sight.direction is None else table.direction(sight.direction)
    # the line of action goes through the point on body b and turns with body a: its first order
    at = sight.points[1]
    out = sp.zeros(3 * len(numbers), 1)
    for side, sign in ((0, -1), (1, 1)):
        body = sight.bodies[side]
        if body not in numbers:
            continue
        first = 3 * (numbers[body] - 1)
        X, Y = (table.length(at[k] - source.bodies[body].centre[k]) for k in (0, 1))
        for j, value in enumerate((c, s, sp.S.One if turns else s * X - c * Y)):
            out[first + j] += sign * value
    return sp.ImmutableMatrix(out)
