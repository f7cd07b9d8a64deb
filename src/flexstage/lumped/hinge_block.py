r"""One generic body and one generic hinge, in symbols: derived once, put in for all of a stage.

The Hessian of the energy of a whole stage costs the square of its coordinates in derivatives of a
sum over all hinges. A hinge touches six coordinates only, so its 6 x 6 block is derived here once
by Lagrange's equations and every hinge of a stage is that block with its own constants put in.
"""

# SymPy's own annotations are partial and contradict what its functions return.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false
# pyright: reportCallIssue=false, reportOptionalMemberAccess=false, reportIndexIssue=false

from dataclasses import dataclass
from functools import lru_cache

import sympy as sp

from flexstage.lumped.rigid_bodies import Mechanism, Sight
from flexstage.lumped.symbols import SymbolTable


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
    damping_forces: tuple[sp.Expr, ...]
    """Derivatives of D with respect to the rates."""
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
    V = _quadratic(stiffness, deformation)
    D = _quadratic(damping, _deformation(rates, arms, c, s))
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
        damping_forces=damping_forces,
        block=sp.ImmutableMatrix(6, 6, lambda i, j: sp.expand(sp.diff(forces[i], q[j]))),
        damping_block=sp.ImmutableMatrix(
            6, 6, lambda i, j: sp.expand(sp.diff(damping_forces[i], rates[j]))
        ),
    )


def _spring(letter: str) -> dict[str, sp.Symbol]:
    names = {
        "uu": "u",
        "vv": "v",
        "tt": r"\theta",
        "uv": "uv",
        "ut": r"u\theta",
        "vt": r"v\theta",
    }
    return {key: sp.Symbol(f"{letter}_{{{name}}}", real=True) for key, name in names.items()}


def _deformation(
    q: tuple[sp.Symbol, ...], arms: tuple[sp.Symbol, ...], c: sp.Symbol, s: sp.Symbol
) -> tuple[sp.Expr, ...]:
    xa, ya, ta, xb, yb, tb = q
    Xa, Ya, Xb, Yb = arms
    dx = (xb - tb * Yb) - (xa - ta * Ya)
    dy = (yb + tb * Xb) - (ya + ta * Xa)
    return c * dx + s * dy, c * dy - s * dx, tb - ta


def _quadratic(k: dict[str, sp.Symbol], x: tuple[sp.Expr, ...]) -> sp.Expr:
    u, v, t = x
    return (k["uu"] * u**2 + k["vv"] * v**2 + k["tt"] * t**2) / 2 + (
        k["uv"] * u * v + k["ut"] * u * t + k["vt"] * v * t
    )


_KEYS = {"uu": (0, 0), "vv": (1, 1), "tt": (2, 2), "uv": (0, 1), "ut": (0, 2), "vt": (1, 2)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HingeConstants:
    """What a hinge puts into the generic block."""

    name: str
    """Name of the hinge."""
    bodies: tuple[int, int]
    """Numbers of bodies a and b among the free ones, from 1; 0 for what is held."""
    constants: dict[sp.Symbol, sp.Expr]
    """Expression for each symbol of `flexstage.lumped.hinge_block.generic_hinge`."""


def hinge_constants(
    source: Mechanism, table: SymbolTable, i: int, damping: str
) -> dict[sp.Symbol, sp.Expr]:
    """Return what a hinge puts in the place of each symbol of the generic hinge.

    With `damping` ``hinge`` it has a damper as well.
    """
    hinge, generic = source.hinges[i], generic_hinge()
    out: dict[sp.Symbol, sp.Expr] = {}
    for side, body in enumerate(hinge.bodies):
        for axis in (0, 1):
            held = source.bodies[body].fixed
            arm = hinge.at[axis] - source.bodies[body].centre[axis]
            out[generic.arms[2 * side + axis]] = sp.S.Zero if held else table.length(arm)
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
    """Sum the blocks and energies of all hinges; held bodies have no coordinates.

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
