"""A part under finite loads: equilibria along a path, modes about a state, buckling factors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.elasticity.continuum import Continuum, inverse_of
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE


def volume_unit(continuum: Continuum) -> float:
    """Return the volume of one square or cubic millimetre of the part's mesh [m^3]."""
    thickness = continuum.thickness
    return (1.0 / METRE if thickness is None else thickness) / METRE**2


def green_strain(gradient: ng.CoefficientFunction) -> ng.CoefficientFunction:
    """Return Green's strain of a gradient of the displacement [m] by millimetres of the mesh."""
    turn = METRE * gradient
    return 0.5 * (turn + turn.trans + turn.trans * turn)


def holding(solve: Callable[[Array], Array], rows: Array) -> Callable[[Array], Array]:
    """Return the solution of a part with some readings constrained to zero.

    `solve` gives the solution of the part under a load, shape (n,); `rows` are the readings, shape
    (k, n).
    """
    pushed = np.column_stack([solve(row) for row in rows])
    reaction = np.linalg.inv(rows @ pushed)

    def constrained(load: Array) -> Array:
        u = solve(load)
        for _ in range(2):  # the second time for what the first one's rounding left
            u = u - pushed @ (reaction @ (rows @ u))
        return u

    return constrained


class Loaded(Continuum):
    """A part for small motions about a loaded state: its stiffness is the tangent there.

    `solve` and `modes` use it, and the mass, the loads and the readings are those of the part
    `base`; `u0` are the displacements of the state [m], from `follow_drive`, or from
    `Continuum.solve` where they are small, shape (n,). Its `stress` is not defined.
    """

    def __init__(self, base: Continuum, u0: Array) -> None:
        self.__dict__.update(base.__dict__)  # the same mesh, space, mass and readings
        self._solver = None
        self._matrices = {"mass": base._mass}
        self._state = base.field(u0)

    def _form(self) -> ng.BilinearForm:
        d = self.dimension
        trial, test = self.space.TnT()
        turn = METRE * ng.Grad(self._state)
        strain = green_strain(ng.Grad(self._state))
        stress = self.lame * ng.Trace(strain) * ng.Id(d) + 2.0 * self.shear_modulus * strain
        a, b = METRE * ng.Grad(trial), METRE * ng.Grad(test)
        now = (ng.Id(d) + turn).trans
        da, db = ng.Sym(now * a), ng.Sym(now * b)
        density = self.lame * ng.Trace(da) * ng.Trace(db)
        density += 2.0 * self.shear_modulus * ng.InnerProduct(da, db)
        density += ng.InnerProduct(stress, a.trans * b)  # what the stress adds
        density += self.shift * self.density * ng.InnerProduct(trial, test)
        form = ng.BilinearForm(self.space, symmetric=True, condense=True)
        form += volume_unit(self) * density * ng.dx
        return form


def stress_stiffening(continuum: Continuum, u0: Array, count: int) -> tuple[Array, Array]:
    """Return the lowest natural modes about a loaded state.

    Parameters
    ----------
    continuum : Continuum
        The part.
    u0 : numpy.ndarray
        Displacements of the loaded state [m], shape (n,).
    count : int
        How many.

    Returns
    -------
    tuple of numpy.ndarray
        omega [rad/s], shape (count,), and shapes with phi^T M phi = 1, shape (n, count), as
        `Continuum.modes` gives them.

    Raises
    ------
    ModelError
        The state is not stable: the part has buckled before it.
    ConvergenceError
        The iteration did not end.

    Notes
    -----
    The error for an unstable state is the test of a branch that was followed too far under a force.

    Validity: undamped small vibrations; the loads of the state keep their direction. A drive that
    holds the state adds no mass and no stiffness.
    """
    omega, shapes = Loaded(continuum, u0).modes(count)
    # `modes` cuts a negative square off at nothing, and a held part has no mode at nothing
    if continuum.shift == 0.0 and omega[0] == 0.0:
        raise ModelError(
            "the loaded state is not stable, so it has no natural frequencies: the load is beyond "
            "buckling; lower it"
        )
    return omega, shapes


#: Order of the six components of a stress.
COMPONENTS: tuple[tuple[int, int], ...] = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def von_mises(stress: ng.CoefficientFunction) -> ng.CoefficientFunction:
    """Return the equivalent stress of von Mises of a stress on a mesh [Pa].

    Parameters
    ----------
    stress : ngsolve.CoefficientFunction
        The tensor, 3 x 3 [Pa].

    Returns
    -------
    ngsolve.CoefficientFunction
        The equivalent stress.
    """
    s = stress
    normal = (s[0, 0] - s[1, 1]) ** 2 + (s[1, 1] - s[2, 2]) ** 2 + (s[2, 2] - s[0, 0]) ** 2
    shear = s[0, 1] ** 2 + s[1, 2] ** 2 + s[0, 2] ** 2
    return ng.sqrt(0.5 * normal + 3.0 * shear)


def von_mises_of(components: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the equivalent stress of von Mises of stress components [Pa].

    xx, yy, zz, yz, xz, xy are the last axis [Pa], shape (..., 6).
    """
    xx, yy, zz, yz, xz, xy = np.moveaxis(components, -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(0.5 * normal + 3.0 * (yz**2 + xz**2 + xy**2))


_MOST = 150  # vectors; 20 to 40 are usual
# factors beyond this multiple of the smallest of both signs are omitted
_REACH = 100.0
# of the residuals; that of the factors is about its square
_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BucklingFactors:
    """Factors of a reference load at which a part buckles."""

    positive: Array
    """Factors of the load as it acts, the smallest first [1]; empty where it cannot buckle the
    part, shape (k,).
    """
    negative: Array
    """Factors of the reversed load, the smallest magnitude first [1], shape (m,)."""


def buckling(
    continuum: Continuum,
    u: Array,
    *,
    count: int = 1,
    locked: Array | None = None,
) -> BucklingFactors:
    r"""Return the load factors of linear buckling.

    .. math:: (K + \lambda K_g)\,\phi = 0, \quad
       K_g = \int \sigma_0 : (\nabla\phi^T \nabla\psi)\,dV

    with the stress sigma_0 of the reference state. It is solved for 1/lambda, whose extremes are
    the factors wanted, with the factorised stiffness that the part has already.

    Parameters
    ----------
    continuum : Continuum
        The part; it must be supported.
    u : numpy.ndarray
        Displacements of the reference state by `Continuum.solve` [m], shape (n,).
    count : int
        How many factors of each sign.
    locked : numpy.ndarray, optional
        Readings that stay as they are while the part buckles, such as the elongation of a stiff
        drive, shape (k, n).

    Returns
    -------
    BucklingFactors
        The factors; those beyond 100 times the smallest of both signs are omitted.

    Raises
    ------
    ModelError
        The part is free, or the reference state has no stress.
    ConvergenceError
        The iteration did not end.

    Notes
    -----
    Bathe 1996, *Finite Element Procedures*, sec. 6.8.2.

    Validity: bifurcation from a straight path: the displacements before buckling are small and grow
    with the load, which keeps its direction. A part that bends as it is loaded, or snaps through,
    needs `follow_drive`; imperfections reduce the factors of real parts.

    Examples
    --------
    A column of 60 x 1 x 10 mm, clamped at its foot; Euler: pi^2 E I / (4 L^2) = 40.95 N.

    >>> import ngsolve as ng
    >>> from netgen.occ import OCCGeometry, Rectangle
    >>> from flexstage.elasticity import Continuum
    >>> from flexstage.quantities.material import material
    >>> column = Rectangle(60, 1).Face()
    >>> for edge in column.edges:
    ...     edge.name = {0.0: "foot", 60.0: "top"}.get(round(edge.center.x, 6), "side")
    >>> mesh = ng.Mesh(OCCGeometry(column, dim=2).GenerateMesh(maxh=5))
    >>> part = Continuum(
    ...     mesh, material("Al 7075-T6"), order=4, thickness=10e-3, fixed="foot"
    ... )
    >>> u = part.solve(part.mean("top", (-1, 0)))
    >>> round(float(buckling(part, u).positive[0]), 1)
    41.0
    """
    if continuum.shift:
        raise ModelError(
            "buckling needs the stiffness alone, and this part has a shift: make it without one"
        )
    geometric = _geometric(continuum, u)
    if not np.abs(geometric.data).max() > 0.0:
        raise ModelError("the reference state has no stress, so it cannot buckle: load the part")
    solve = continuum.solve
    if locked is not None:
        solve = holding(solve, np.atleast_2d(locked))
    inverse = _extremes(-geometric, solve, count)
    return BucklingFactors(
        positive=1.0 / inverse[inverse > 0.0], negative=1.0 / inverse[inverse < 0.0]
    )


def _geometric(continuum: Continuum, u: Array) -> sp.csr_matrix:
    """Return the geometric stiffness by the stress of the reference state."""
    d = continuum.dimension
    trial, test = continuum.space.TnT()
    a, b = METRE * ng.Grad(trial), METRE * ng.Grad(test)
    full = continuum.stress(u)
    # nothing varies through the thickness, so the stress through it does no work
    stress = ng.CoefficientFunction(
        tuple(full[i, j] for i in range(d) for j in range(d)), dims=(d, d)
    ).Compile()
    with parallel():
        form = ng.BilinearForm(continuum.space)
        form += volume_unit(continuum) * ng.InnerProduct(stress, a.trans * b) * ng.dx
        form.Assemble()
    rows, columns, values = (np.asarray(part) for part in form.mat.COO())
    return sp.csr_matrix((values, (rows, columns)), (continuum.size, continuum.size))


def _extremes(
    matrix: sp.csr_matrix,
    solve: Callable[[Array], Array],
    count: int,
) -> Array:
    """Eigenvalues of a matrix against the stiffness at both ends.

    Lanczos' method with two starting vectors, so that a double factor is found as such, orthogonal
    in the energy. A vector is stored with its load, v = K^-1 g: the stiffness itself is
    then never needed. At either end it stops where no eigenvalue differs from zero, where a
    restarted method would not converge.
    """
    n = matrix.indptr.size - 1
    vectors, loads = np.empty((_MOST, n)), np.empty((_MOST, n))
    projected = np.zeros((_MOST, _MOST))
    size = 0

    def keep(load: Array) -> None:
        nonlocal size
        v = solve(load)
        before = np.sqrt(abs(load @ v))
        for _ in range(2):  # the second time for what the first one's rounding left
            parts = loads[:size] @ v
            v, load = v - parts @ vectors[:size], load - parts @ loads[:size]
        norm = np.sqrt(max(load @ v, 0.0))
        if norm > 1e-7 * before and size < _MOST:
            vectors[size], loads[size] = v / norm, load / norm
            size += 1

    for start in np.random.default_rng(0).standard_normal((2, n)):
        keep(start)
    for i in range(_MOST):
        load = matrix @ vectors[i]
        keep(load)
        projected[: i + 1, i] = projected[i, : i + 1] = vectors[: i + 1] @ load
        done = i + 1 == size
        if not done and i < 2 * count + 8:
            continue
        values, turns = np.linalg.eigh(projected[: i + 1, : i + 1])
        wrong = np.zeros_like(values)
        if not done:
            # what is left of K^-1 A v - value v lies in the vectors that were not multiplied yet;
            # of the others than the outermost nothing is asked
            outer = np.unique(np.r_[:count, -count:0] % values.size)
            rest = vectors[i + 1 : size] @ (matrix @ (turns[:, outer].T @ vectors[: i + 1]).T)
            wrong[outer] = np.linalg.norm(rest, axis=0)
        selected = _select_extremes(values, wrong, count)
        if selected is not None:
            return values[selected]
    raise ConvergenceError(
        f"the buckling factors were not found in {_MOST} iterations: request fewer"
    )


def _select_extremes(values: Array, wrong: Array, count: int) -> list[int] | None:
    """Select the required eigenvalues of both signs, largest first; None if not converged yet."""
    least = np.abs(values).max() / _REACH
    selected: list[int] = []
    for sign in (1.0, -1.0):
        for k in np.argsort(-sign * values)[:count]:
            if sign * values[k] > least:
                if wrong[k] > _TOLERANCE * abs(values[k]):
                    return None
                selected.append(int(k))
            elif wrong[k] > least:
                return None
            else:
                break
    return selected


# Last correction over the displacement, in the norm of the energy, whose square is about the error
# that is left; and factorisations before a step is halved.
_CONVERGED, _FACTORISATIONS = 1e-8, 25


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
        tangent, self.last, factorisations = self.last, None, 0
        for count in range(1, _FACTORISATIONS + 1):
            self.state.FV().NumPy()[:] = u
            if count > 1 or tangent is None:
                tangent, factorisations = self._tangent(), factorisations + 1
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
                return u, force, compliance, factorisations, False
            # Slender parts first stretch as they turn, by much more than they end up stretched;
            # beyond that the iterates have left for good.
            first = max(first, work) if count <= 2 else first
            if work > 1e6 * first:
                return u, force, compliance, factorisations, False
            self.state.FV().NumPy()[:] = u
            if work <= _CONVERGED**2 * abs(float(self.form.Energy(self.state))):
                self.last = tangent
                return u, force, compliance, factorisations, True
        return u, force, compliance, factorisations, False

    def follow(self, values: Sequence[float] | Array, most_halvings: int = 6) -> Equilibria:
        """Continue from rest to each value in turn, in smaller steps where a full one fails."""
        u, force, at, share = np.zeros(self.free.size), 0.0, 0.0, 0.0
        equilibria: list[tuple[Array, float, float, int]] = []
        with parallel():
            for value in (float(v) for v in values):
                begin, base, part, width, total = at, share, 0.0, 1.0, 0
                compliance = 0.0
                while part < 1.0:
                    end = min(part + width, 1.0)
                    goal = begin + end * (value - begin)
                    trial = self.settle(u, force, goal, base + end * (1.0 - base))
                    total += trial[3]
                    if trial[4]:
                        u, force, compliance, part = trial[0], trial[1], trial[2], end
                        continue
                    width *= 0.5
                    if width < 0.5**most_halvings:
                        raise ConvergenceError(_no_equilibrium(self.driven, begin, value, part))
                at, share = value, 1.0
                equilibria.append((u, force, compliance, total))
        return Equilibria(
            values=np.array([float(v) for v in values]),
            displacement=np.array([f[0] for f in equilibria]).reshape(-1, self.free.size),
            force=np.array([f[1] for f in equilibria]),
            compliance=np.array([f[2] for f in equilibria]),
            iterations=np.array([f[3] for f in equilibria], dtype=np.int64),
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
    ...     mesh, material("Al 7075-T6"), order=4, thickness=10e-3, fixed="clamp"
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
