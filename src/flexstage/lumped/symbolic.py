r"""The linear equations of motion of a stage in symbols, by Lagrange's method.

.. math::

    \frac{d}{dt}\frac{\partial T}{\partial\dot q_i} - \frac{\partial T}{\partial q_i}
    + \frac{\partial D}{\partial\dot q_i} + \frac{\partial V}{\partial q_i} = Q_i
    \qquad\Rightarrow\qquad M\ddot q + C\dot q + Kq = Q

Bodies of one mass, hinges of one stiffness, lever arms of one length share their symbols, so that
a symmetric stage has symmetric equations and a table of constants that can be read.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import sympy as sp

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.lumped.rigid_bodies import Mechanism, Sight, mechanism
from flexstage.lumped.symbols import (
    HingeConstants,
    SymbolTable,
    assemble_blocks,
    generic_hinge,
    hinge_constants,
    number,
    sight_vector,
    starting_values,
)
from flexstage.stage.model import Stage
from flexstage.system.mechanical import find_named
from flexstage.system.requests import DampingKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SymbolicPort:
    """A drive or a probe in symbols."""

    name: str
    """Name."""
    vector: sp.ImmutableMatrix
    """Elongation or reading for each coordinate, shape (n, 1)."""
    stiffness: sp.Expr | None = sp.S.Zero
    """Stiffness of a drive; None if rigid, 0 for a force and for a probe."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equations:
    """Linear equations of motion in symbols, with drives and probes."""

    has: ClassVar[str] = ": the model has"
    """Subject of the message for an unknown name."""

    name: str
    """Name of the stage."""
    coordinates: tuple[sp.Symbol, ...]
    """Coordinates; n of them."""
    M: sp.MatrixBase
    """Mass, shape (n, n)."""
    C: sp.MatrixBase
    """Damping, shape (n, n)."""
    K: sp.MatrixBase
    """Stiffness, shape (n, n)."""
    drives: tuple[SymbolicPort, ...]
    """Drives, as far as the coordinates can describe them."""
    probes: tuple[SymbolicPort, ...]
    """Probes, as far as the coordinates can describe them."""
    values: dict[sp.Symbol, float]
    """The value of each symbol [SI]."""
    damping: DampingKind
    """``none``, ``hinge`` or ``rayleigh``."""

    @property
    def order(self) -> int:
        """Number of coordinates n."""
        return len(self.coordinates)

    def drive(self, name: str) -> SymbolicPort:
        """Return a drive by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        SymbolicPort
            The drive.

        Raises
        ------
        ModelError
            There is no such drive.
        """
        return find_named("drive", name, self.drives, self.has)

    def probe(self, name: str) -> SymbolicPort:
        """Return a probe by name.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        SymbolicPort
            The probe.

        Raises
        ------
        ModelError
            There is no such probe.
        """
        return find_named("probe", name, self.probes, self.has)

    def symbol(self, name: str) -> sp.Symbol:
        """Return a symbol that has a value, by its name."""
        return next(symbol for symbol in self.values if symbol.name == name)

    def numbers(self, matrix: sp.MatrixBase) -> Array:
        """Evaluate a matrix of the model.

        Parameters
        ----------
        matrix : sympy.Matrix
            A matrix whose symbols have values.

        Returns
        -------
        numpy.ndarray
            Its numbers, of the matrix's shape.
        """
        out = np.zeros(matrix.shape)
        evaluated = starting_values(self.values)
        for at, entry in sp.ImmutableSparseMatrix(matrix).todok().items():
            out[at] = number(entry, evaluated)
        return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SymbolicModel(Equations):
    """Equations of motion in symbols, M q'' + C q' + K q = Q.

    For each free body q has x, y of its centre of mass and its rotation theta.
    """

    bodies: tuple[str, ...]
    """Names of the free bodies: number i is ``bodies[i - 1]``."""
    fixed: tuple[str, ...]
    """Names of the fixed bodies."""
    rates: tuple[sp.Symbol, ...]
    """First derivatives of q in time."""
    accelerations: tuple[sp.Symbol, ...]
    """Second derivatives of q in time."""
    forces: tuple[sp.Symbol, ...]
    """Generalised forces Q."""
    kinetic_energy: sp.Expr
    """T."""
    potential_energy: sp.Expr
    """V."""
    dissipation: sp.Expr
    """Rayleigh's function D."""
    hinges: tuple[HingeConstants, ...]
    """The hinges."""
    body_constants: tuple[tuple[sp.Expr, sp.Expr], ...]
    """Mass and inertia of each free body."""
    source: Mechanism
    """The bodies and springs that it was derived from."""

    def equations(self) -> tuple[sp.Eq, ...]:
        """Return Lagrange's equations of motion, one for each coordinate.

        Returns
        -------
        tuple of sympy.Eq
            The equations in coordinates, rates and accelerations.
        """
        left = [sp.S.Zero] * self.order
        for matrix, unknown in (
            (self.M, self.accelerations),
            (self.C, self.rates),
            (self.K, self.coordinates),
        ):
            for (i, j), entry in sorted(matrix.todok().items(), key=lambda item: item[0]):
                left[i] += entry * unknown[j]
        return tuple(sp.Eq(a, Q) for a, Q in zip(left, self.forces, strict=True))

    def operator(self, s: sp.Symbol) -> sp.ImmutableSparseMatrix:
        """Return the operator form M s^2 + C s + K.

        Parameters
        ----------
        s : sympy.Symbol
            Laplace's variable.

        Returns
        -------
        sympy.ImmutableSparseMatrix
            The dynamic stiffness, shape (n, n).
        """
        return sp.ImmutableSparseMatrix(self.M * s**2 + self.C * s + self.K)

    def with_values(self, **numbers: float) -> "SymbolicModel":
        """Return the model with other numbers for some symbols.

        Parameters
        ----------
        **numbers : float
            Number by name of the symbol, such as ``beta=1e-5`` [SI].

        Returns
        -------
        SymbolicModel
            The new model.

        Raises
        ------
        ModelError
            The model has no such symbol.
        """
        by_name = {symbol.name: symbol for symbol in self.values}
        for name in numbers:
            if name not in by_name:
                raise ModelError(
                    f"the model has no symbol '{name}': it has "
                    f"{', '.join(sorted(by_name)[:12])}, ..."
                )
        return replace(self, values=self.values | {by_name[k]: v for k, v in numbers.items()})


def symbolic_model(stage: Stage | Mechanism, *, damping: DampingKind = "rayleigh") -> SymbolicModel:
    """Derive the equations of motion of a stage in symbols.

    Parameters
    ----------
    stage : Stage or Mechanism
        The stage, or its bodies and springs.
    damping : str
        ``rayleigh`` for C = alpha M + beta K, ``hinge`` for a damper in each hinge (c_u, c_v,
        c_theta), ``none``. Their values are 0 until `SymbolicModel.with_values` sets them.

    Returns
    -------
    SymbolicModel
        Energies, matrices and the value of each symbol.

    Raises
    ------
    ModelError
        Every body is fixed, or the kind of damping is unknown.

    Notes
    -----
    Validity: small displacements of rigid bodies, as `flexstage.lumped.lumped_system`, whose
    matrices these equal to rounding.
    """
    if damping not in ("none", "hinge", "rayleigh"):
        raise ModelError(f"unknown damping '{damping}': expected none, hinge or rayleigh")
    source = mechanism(stage) if isinstance(stage, Stage) else stage
    free = [source.bodies[i] for i in source.free]
    if not free:
        raise ModelError(f"every body of '{source.name}' is fixed: nothing can move")
    numbers = {i: k + 1 for k, i in enumerate(source.free)}
    n = len(free)

    def names(pattern: str) -> tuple[sp.Symbol, ...]:
        letters = ("x", "y", r"\theta" if "{" in pattern else "theta")
        return tuple(
            sp.Symbol(pattern.replace("@", c) + f"_{i}", real=True)
            for i in range(1, n + 1)
            for c in letters
        )

    q, rates, accelerations = names("@"), names(r"\dot{@}"), names(r"\ddot{@}")
    table = SymbolTable(source)
    bodies = tuple((table.mass(b.mass), table.inertia(b.inertia)) for b in free)
    T = sp.Add(
        *(
            m * (rates[3 * i] ** 2 + rates[3 * i + 1] ** 2) / 2 + J * rates[3 * i + 2] ** 2 / 2
            for i, (m, J) in enumerate(bodies)
        )
    )
    M = {
        (3 * i + j, 3 * i + j): v
        for i, (m, J) in enumerate(bodies)
        for j, v in enumerate((m, m, J))
    }
    generic = generic_hinge()
    hinges = tuple(
        HingeConstants(
            name=h.name,
            bodies=(numbers.get(h.bodies[0], 0), numbers.get(h.bodies[1], 0)),
            constants=hinge_constants(source, table, i, damping),
        )
        for i, h in enumerate(source.hinges)
    )
    K, V = assemble_blocks(hinges, generic.block, generic.potential_energy, generic.coordinates, q)
    if damping == "hinge":
        C, D = assemble_blocks(
            hinges, generic.damping_block, generic.dissipation, generic.rates, rates
        )
    elif damping == "rayleigh":
        alpha, beta = table.rayleigh()
        C = {key: beta * value for key, value in K.items()}
        for key, value in M.items():
            C[key] = C.get(key, sp.S.Zero) + alpha * value
        D = alpha * T + beta * V.xreplace(dict(zip(q, rates, strict=True)))
    else:
        C, D = {}, sp.S.Zero

    def port(sight: Sight, i: int) -> SymbolicPort:
        stiffness = (
            table.drive_stiffness(i, sight.stiffness)
            if sight.stiffness
            else (None if sight.stiffness is None else sp.S.Zero)
        )
        return SymbolicPort(
            name=sight.name, vector=sight_vector(source, table, sight, numbers), stiffness=stiffness
        )

    return SymbolicModel(
        name=source.name,
        bodies=tuple(b.name for b in free),
        fixed=tuple(b.name for b in source.bodies if b.fixed),
        coordinates=q,
        rates=rates,
        accelerations=accelerations,
        forces=tuple(sp.Symbol(f"Q_{{{i}}}", real=True) for i in range(1, 3 * n + 1)),
        kinetic_energy=T,
        potential_energy=V,
        dissipation=D,
        M=sp.ImmutableSparseMatrix(3 * n, 3 * n, M),
        C=sp.ImmutableSparseMatrix(3 * n, 3 * n, C),
        K=sp.ImmutableSparseMatrix(3 * n, 3 * n, K),
        hinges=hinges,
        body_constants=bodies,
        drives=tuple(port(d, i + 1) for i, d in enumerate(source.drives)),
        probes=tuple(port(p, i + 1) for i, p in enumerate(source.probes)),
        values=table.values,
        damping=damping,
        source=source,
    )
