"""From the generic hinge to the stage: constants put in, blocks and energies summed."""

# SymPy's own annotations are partial and contradict what its functions return.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportReturnType=false
# pyright: reportCallIssue=false, reportOptionalMemberAccess=false, reportIndexIssue=false

from dataclasses import dataclass

import sympy as sp

from flexstage.lumped.hinge_block import generic_hinge
from flexstage.lumped.rigid_bodies import Mechanism, Sight
from flexstage.lumped.symbols import SymbolTable

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
    c, s = table.direction(sight.direction)
    # the line of action goes through the point on body b and turns with body a: its first order
    at = sight.points[1]
    out = sp.zeros(3 * len(numbers), 1)
    for side, sign in ((0, -1), (1, 1)):
        body = sight.bodies[side]
        if body not in numbers:
            continue
        first = 3 * (numbers[body] - 1)
        X, Y = (table.length(at[k] - source.bodies[body].centre[k]) for k in (0, 1))
        for j, value in enumerate((c, s, s * X - c * Y)):
            out[first + j] += sign * value
    return sp.ImmutableMatrix(out)
