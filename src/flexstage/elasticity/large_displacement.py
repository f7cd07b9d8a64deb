"""Finite displacements of a meshed part: equilibria along a path."""

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity.continuum import Continuum, inverse_of
from flexstage.elasticity.loaded import green_strain, volume_unit
from flexstage.elasticity.resources import parallel

# Last correction over the displacement, in the norm of the energy, whose square is about the error
# that is left; and factorisations before a step is halved.
_TOLERANCE, _MOST = 1e-8, 25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equilibria:
    """Equilibria of a part along a path."""

    values: Array
    """Imposed values: the reading of the drive [m or rad] or the factor of the load [1], shape
    (steps,).
    """
    displacement: Array
    """Displacements [m], shape (steps, n); ``displacement @ row`` is any reading along the path."""
    force: Array
    """Force of the drive [N], or N m where its reading is an angle; of a path of loads the factor
    itself, shape (steps,).
    """
    compliance: Array
    """Slope of the reading over the force at each equilibrium [m/N], for a path of loads of ``load
    @ u`` over the factor [J], shape (steps,). It passes through zero where the part snaps
    through under an imposed motion, and through infinity where it does under a force.
    """
    iterations: NDArray[np.int64]
    """Factorisations that each step took, with those of halved steps, shape (steps,)."""


class _Path:
    """Newton's method for one part, one vector of load and further loads."""

    def __init__(
        self,
        continuum: Continuum,
        vector: Array,
        *,
        driven: bool,
        load: Array | None = None,
    ) -> None:
        space = continuum.space
        self.free = np.array(space.FreeDofs(), dtype=bool)
        if self.free.all():
            raise ModelError(
                "the part is not constrained, so it has no static solution: fix a boundary (a "
                "shift does not work with finite displacements)"
            )
        self.vector = self._checked("the row or load", vector)
        self.load = 0.0 if load is None else self._checked("the other load", load)
        self.driven = driven
        self.space = space
        strain = green_strain(ng.Grad(space.TrialFunction()))
        energy = 0.5 * continuum.lame * ng.Trace(strain) ** 2
        energy += continuum.shear_modulus * ng.InnerProduct(strain, strain)
        self.form = ng.BilinearForm(space, symmetric=True, condense=True)
        self.form += ng.Variation(volume_unit(continuum) * energy.Compile() * ng.dx)
        self.state, self.right, self.left = (ng.GridFunction(space).vec for _ in range(3))
        self.last: ng.BaseMatrix | None = None  # of the last equilibrium, for the way on from it

    def _checked(self, name: str, vector: Array) -> Array:
        if vector.shape != self.free.shape or not np.isfinite(vector).all():
            raise ModelError(
                f"{name} must hold one finite number for each of the {self.free.size} degrees of "
                f"freedom of the part, got shape {vector.shape}"
            )
        return np.where(self.free, vector, 0.0)

    def _tangent(self) -> ng.BaseMatrix:
        """Inverse of the tangent stiffness at the state, interiors of elements put back."""
        self.form.AssembleLinearization(self.state)
        return inverse_of(self.form, self.space.FreeDofs(True))

    def _solve(self, tangent: ng.BaseMatrix, load: Array) -> Array:
        self.right.FV().NumPy()[:] = load
        self.left.data = tangent * self.right
        return self.left.FV().NumPy().copy()

    def settle(
        self, start: Array, force: float, value: float, share: float
    ) -> tuple[Array, float, float, int, bool]:
        r"""Find the equilibrium near a start.

        With an imposed reading, :math:`K_t\,du - df\,d = r,\ d^T(u + du) = s`, by two solutions
        with one factorisation: the many degrees of freedom of d never fill the matrix.

        Returns displacement, force, compliance, number of factorisations, and whether it is an
        equilibrium.
        """
        u, d, first, compliance = start.copy(), self.vector, 0.0, 0.0
        if not self.driven:
            force = value
        # where the last step ended its last correction was tiny, so that its tangent is still good;
        # a form that is assembled again takes it away
        tangent, self.last, made = self.last, None, 0
        for count in range(1, _MOST + 1):
            self.state.FV().NumPy()[:] = u
            if count > 1 or tangent is None:
                tangent, made = self._tangent(), made + 1
            self.form.Apply(self.state, self.right)
            inner = self.right.FV().NumPy()
            rest = np.where(self.free, share * self.load + force * d - inner, 0.0)
            du, along = self._solve(tangent, rest), self._solve(tangent, d)
            compliance = float(d @ along)
            if self.driven:
                more = (value - float(d @ (u + du))) / compliance if compliance else np.nan
                du, rest, force = du + more * along, rest + more * d, force + more
            u = u + du
            work = abs(float(du @ rest))
            if not np.isfinite(work):
                return u, force, compliance, made, False
            # Slender parts first stretch as they turn, by much more than they end up stretched;
            # beyond that the iterates have left for good.
            first = max(first, work) if count <= 2 else first
            if work > 1e6 * first:
                return u, force, compliance, made, False
            self.state.FV().NumPy()[:] = u
            if work <= _TOLERANCE**2 * abs(float(self.form.Energy(self.state))):
                self.last = tangent
                return u, force, compliance, made, True
        return u, force, compliance, made, False

    def follow(self, values: Sequence[float] | Array, most_halvings: int = 6) -> Equilibria:
        """Continue from rest to each value in turn, in smaller steps where a full one fails."""
        u, force, at, share = np.zeros(self.free.size), 0.0, 0.0, 0.0
        found: list[tuple[Array, float, float, int]] = []
        with parallel():
            for value in (float(v) for v in values):
                begin, base, part, width, total = at, share, 0.0, 1.0, 0
                compliance = 0.0
                while part < 1.0:
                    end = min(part + width, 1.0)
                    goal = begin + end * (value - begin)
                    tried = self.settle(u, force, goal, base + end * (1.0 - base))
                    total += tried[3]
                    if tried[4]:
                        u, force, compliance, part = tried[0], tried[1], tried[2], end
                        continue
                    width *= 0.5
                    if width < 0.5**most_halvings:
                        raise ConvergenceError(_no_equilibrium(self.driven, begin, value, part))
                at, share = value, 1.0
                found.append((u, force, compliance, total))
        return Equilibria(
            values=np.array([float(v) for v in values]),
            displacement=np.array([f[0] for f in found]).reshape(-1, self.free.size),
            force=np.array([f[1] for f in found]),
            compliance=np.array([f[2] for f in found]),
            iterations=np.array([f[3] for f in found], dtype=np.int64),
        )


def _no_equilibrium(driven: bool, begin: float, value: float, part: float) -> str:
    reached = begin + part * (value - begin)
    what, mend = (
        ("reading of the drive", "give values that lie closer together, or a finer mesh")
        if driven
        else ("factor of the load", "give closer values, or impose a motion instead of the load")
    )
    return (
        f"no equilibrium was found beyond a {what} of {reached:.6g} on the way to {value:.6g}: the "
        f"part may buckle or snap through there; {mend}"
    )


def follow_drive(
    continuum: Continuum,
    row: Array,
    values: Sequence[float] | Array,
    *,
    load: Array | None = None,
    most_halvings: int = 6,
) -> Equilibria:
    r"""Return the equilibria of a part as a drive imposes its reading, with finite displacements.

    .. math:: \int S : \delta E\,dV = f\,d^T \delta u + p^T \delta u, \quad d^T u = s, \quad
       E = \tfrac12 (F^T F - I), \quad S = \lambda\,\mathrm{tr}(E)\,I + 2\mu E

    Parameters
    ----------
    continuum : Continuum
        The part; its mesh, supports, material and state of plane stress or strain are used.
    row : numpy.ndarray
        The reading d; the force of the drive acts along it, shape (n,).
    values : sequence of float
        Values of the reading in turn [m or rad], from rest.
    load : numpy.ndarray, optional
        Other loads that keep their direction [N], shape (n,); they are applied with the first
        value.
    most_halvings : int
        Largest number of halvings of the step to a value.

    Returns
    -------
    Equilibria
        One equilibrium for each value.

    Raises
    ------
    ModelError
        The part is free, or a vector has another size.
    ConvergenceError
        No equilibrium was found.

    Notes
    -----
    Total Lagrangian form with the material of St Venant and Kirchhoff (Bonet and Wood 2008,
    *Nonlinear Continuum Mechanics for Finite Element Analysis*, sec. 6.4). Plane stress is exact in
    it: S_33 = 0 leaves the same law with another first constant.

    Validity: any rotation, strains up to some percent (the material softens without reason when
    squeezed to less than about 0.6 of its length). Loads keep their direction and the reading its
    weights, so a drive that turns with the part is excluded. One branch is followed, and it may be
    one that is no longer stable beyond a bifurcation: `stress_stiffening` at the last state tells
    of one that a force holds (a drive that holds it may keep stable what a force does not), and a
    small load across makes the path bend off where a real part would.

    Examples
    --------
    A leaf of 40 x 0.5 x 10 mm whose end is pushed aside by 10 mm, and by a thousandth of it:

    >>> import ngsolve as ng
    >>> from netgen.occ import OCCGeometry, Rectangle
    >>> from flexstage.elasticity import Continuum
    >>> from flexstage.quantities.material import material
    >>> leaf = Rectangle(40, 0.5).Face()
    >>> for edge in leaf.edges:
    ...     edge.name = {0.0: "clamp", 40.0: "tip"}.get(round(edge.center.x, 6), "side")
    >>> mesh = ng.Mesh(OCCGeometry(leaf, dim=2).GenerateMesh(maxh=4))
    >>> part = Continuum(
    ...     mesh, material("Al 7075-T6"), order=4, thickness=10e-3, held="clamp"
    ... )
    >>> path = follow_drive(part, part.mean("tip", (0, 1)), (10e-6, 10e-3))
    >>> round(float(path.force[1] / path.force[0] / 1000), 4)  # stiffens as it bends
    1.0693
    """
    path = _Path(continuum, row, driven=True, load=load)
    if not path.vector.any():
        raise ModelError("the row of the drive reads no free displacement")
    return path.follow(values, most_halvings)


def follow_load(
    continuum: Continuum,
    load: Array,
    factors: Sequence[float] | Array,
) -> Equilibria:
    """Return the equilibria of a part under multiples of a load, with finite displacements.

    Parameters
    ----------
    continuum : Continuum
        The part.
    load : numpy.ndarray
        The load, which keeps its direction [N], shape (n,).
    factors : sequence of float
        Its factors in turn [1], from rest.

    Returns
    -------
    Equilibria
        One equilibrium for each factor.

    Raises
    ------
    ModelError
        The part is free, or the load has another size.
    ConvergenceError
        No equilibrium was found.

    Notes
    -----
    Validity: as `follow_drive`. Where the load passes a maximum the part snaps through, and only an
    imposed motion can follow it.
    """
    path = _Path(continuum, load, driven=False)
    return path.follow(factors)
