"""A part whose interfaces move as told, held or floating, and the tractions in them that tell."""

from collections.abc import Sequence
from typing import Protocol

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.sparse.linalg import SuperLU, splu

from flexstage.arrays import Array
from flexstage.elasticity import Continuum
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ModelError
from flexstage.fem.block_lanczos import softest_modes
from flexstage.fem.neck_rows import shaped

_ALIKE = 1e11  # two interfaces are one if a unit force on both in turn moves them so little apart
_SETTLED = 1e-3  # of the squares of frequencies, from one step to the next
_BLOCK = 8  # loads that the search for modes starts with


class Elastic(Protocol):
    """A part that was meshed: unknowns, stiffness, mass, and how it moves as a whole."""

    ordered: bool
    """Whether elimination in the order of its unknowns fills little."""

    @property
    def size(self) -> int:
        """Number of unknowns, n."""
        ...

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which of them nothing holds, shape (n,)."""
        ...

    @property
    def rigid(self) -> Array:
        """Displacements of its three rigid motions, shape (n, 3)."""
        ...

    @property
    def pins(self) -> NDArray[np.intp]:
        """Three unknowns that hold it if nothing else does."""
        ...

    @property
    def stiffness(self) -> sp.csc_matrix:
        """Stiffness of the unknowns that are free [N/m]."""
        ...

    def mass_times(self, u: Array) -> Array:
        """Multiply displacements, shape (n,) or (n, k), by the mass matrix [kg]."""
        ...


class PlanePart:
    """A plane continuum as an elastic part."""

    ordered = False

    def __init__(self, continuum: Continuum) -> None:
        self.size, self.free = continuum.size, continuum.free
        self.rigid = _rigid_motions(continuum)
        half = continuum.size // 2
        x, y = self.rigid[half:, 2], -self.rigid[:half, 2]
        self.pins = plane_pins(x[: continuum.mesh.nv], y[: continuum.mesh.nv], half)
        kept = np.flatnonzero(self.free)
        self.stiffness = _stiffness(continuum)[kept][:, kept]
        self.mass_times = continuum.mass_times


class Constrained:
    r"""A body whose interface motions q = P u are given.

    A floating body is solved for balanced loads alone, up to its rigid motions R, whatever holds
    it: the flexibility with inertia relief. Interface forces and rigid motion are then found
    together, with :math:`X = K^+ P^T`, :math:`G = P X`, :math:`A = P R`:

    .. math:: \begin{bmatrix} G & A\\ A^T & 0\end{bmatrix}
              \begin{bmatrix}\lambda\\ a\end{bmatrix}
              = \begin{bmatrix} q - P K^+ f\\ -R^T f\end{bmatrix},
              \quad u = K^+ f + X\lambda + R a

    The rows P have shape (m, n); `blocks` are for each neck the numbers of its rows without
    resultant, of which `shaped` makes a part of the others. Loads and displacements are one a
    column.
    """

    def __init__(
        self, part: Elastic, P: Array, blocks: Sequence[tuple[int, int]], *, floating: bool
    ) -> None:
        self.part = part
        self.rigid = part.rigid
        self.weighted = part.mass_times(self.rigid)
        self._balance = np.zeros((part.size, 0)), np.zeros((part.size, 0))
        stiffness, free = part.stiffness, part.free.copy()
        if floating:
            # Balanced loads leave nothing to the three unknowns that are held, whichever they are.
            free[part.pins] = False
            kept = np.flatnonzero(free[part.free])
            stiffness = stiffness[kept][:, kept]
            factor = np.linalg.cholesky(self.rigid.T @ self.weighted)
            self._balance = (
                np.linalg.solve(factor, self.rigid.T).T,
                np.linalg.solve(factor, self.weighted.T).T,
            )
        self._free = np.flatnonzero(free)
        self._factor = factorised(stiffness, ordered=part.ordered)
        P, X = shaped(P, self.loose(P.T), blocks)
        # most of the rows are of the unknowns on one neck
        self.P, self.X = sp.csr_matrix(P), X
        G = P @ X
        G = 0.5 * (G + G.T)
        A = P @ self._balance[0]
        # rows scaled alike, and rigid motions like them: metres and radians become comparable
        self._row = 1.0 / np.sqrt(np.diag(G))
        A = A * self._row[:, None]
        if floating and (len(A) < 3 or np.linalg.matrix_rank(A, tol=1e-9 * np.abs(A).max()) < 3):
            raise ModelError(
                "a body has no hinge and is not fixed, so it cannot be condensed: add a hinge, or "
                "fix it"
            )
        self._column = 1.0 / np.abs(A).max(axis=0, initial=0.0) if len(A) else np.zeros(0)
        A = A * self._column
        none = np.zeros((A.shape[1], A.shape[1]))
        saddle = np.block([[G * np.outer(self._row, self._row), A], [A.T, none]])
        self._saddle = np.linalg.inv(saddle) if len(A) else np.zeros((0, 0))
        if np.abs(self._saddle).max(initial=0.0) > _ALIKE:
            raise ModelError(
                "two drives touch a body at the same place in the same direction, so that their "
                "patches move alike: move one of them"
            )

    def loose(self, load: Array) -> Array:
        """Return the response to the balanced part of loads, free of rigid motions.

        Of a body that is held, the response to all of the load.
        """
        rigid, weighted = self._balance
        u = np.zeros_like(load)
        u[self._free] = self._factor.solve((load - weighted @ (rigid.T @ load))[self._free])
        return u - rigid @ (weighted.T @ u)

    def _multipliers(self, gap: Array, moment: Array) -> tuple[Array, Array]:
        """Interface forces and rigid motion that close a gap and balance the loads."""
        m = len(self._row)
        right = np.concatenate((self._row[:, None] * gap, self._column[:, None] * moment))
        found = self._saddle @ right if m else np.zeros_like(right)
        return self._row[:, None] * found[:m], self._column[:, None] * found[m:]

    def interface_shapes(self) -> tuple[Array, Array]:
        """Return displacements for unit motions of the interfaces, and the stiffness.

        Shapes (n, m) and (m, m).
        """
        m = len(self._row)
        force, rigid = self._multipliers(np.eye(m), np.zeros((self._balance[0].shape[1], m)))
        return self.X @ force + self._balance[0] @ rigid, 0.5 * (force + force.T)

    def held(self, load: Array) -> Array:
        """Return the response to loads with the interfaces held."""
        u = self.loose(load)
        force, rigid = self._multipliers(-self.P @ u, -self._balance[0].T @ load)
        return u + self.X @ force + self._balance[0] @ rigid

    def modes(self, count: int) -> tuple[Array, Array]:
        """Return the lowest modes with the interfaces held.

        Squares of their angular frequencies [rad^2/s^2], shape (count,), and shapes with these as
        modal stiffness, shape (n, count).
        """
        if not count or not len(self._row):
            return np.zeros(0), np.zeros((self.part.size, 0))
        mass_times = self.part.mass_times
        start = mass_times(np.random.default_rng(0).standard_normal((self.part.size, _BLOCK)))
        return softest_modes(self.held, mass_times, start, count, _SETTLED)

    def reduced(self, loads: Array, count: int) -> tuple[Array, Array, int]:
        """Return the coordinates of the body: interfaces, modes, responses to loads inside it.

        Loads are one a row, shape (k, n), and `count` is the number of modes. Returns displacements
        for each coordinate, shape (n, r), their stiffness, shape (r, r), and the number of
        interfaces.
        """
        T, stiff = self.interface_shapes()
        squares, modes = self.modes(count)
        U, inner = self.responses(loads, squares, modes)
        stiffness = np.asarray(block_diag(stiff, np.diag(squares), inner))
        return np.column_stack((T, modes, U)), stiffness, len(stiff)

    def responses(self, loads: Array, squares: Array, modes: Array) -> tuple[Array, Array]:
        """Return responses to loads with held interfaces, less the part that modes have in them.

        Loads are one a row here, shape (k, n). Returns displacements, shape (n, k), and their
        stiffness, shape (k, k).
        """
        whole = self.held(loads.T)
        share = modes.T @ loads.T
        rest = share / squares[:, None]
        stiff = whole.T @ loads.T - share.T @ rest
        return whole - modes @ rest, 0.5 * (stiff + stiff.T)


def plane_pins(x: Array, y: Array, second: int) -> NDArray[np.intp]:
    """Choose unknowns that hold a plane part: a vertex, and another from turning about it.

    Vertices are the first unknowns of displacement along x, and from `second` on along y.
    """
    far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
    sideways = far if abs(y[far] - y[0]) > abs(x[far] - x[0]) else second + far
    return np.array([0, second, sideways])


def _rigid_motions(continuum: Continuum) -> Array:
    """Displacements x, y of all of a part and its rotation about the origin, shape (n, 3)."""
    place = ng.GridFunction(ng.H1(continuum.mesh, order=continuum.order, dim=2))
    place.Set(ng.CoefficientFunction((ng.x / METRE, ng.y / METRE)))
    x, y = place.vec.FV().NumPy().reshape(-1, 2).T
    # of the shape functions those of the vertices, which come first, make up a constant
    one, none = np.zeros_like(x), np.zeros_like(x)
    one[: continuum.mesh.nv] = 1.0
    return np.column_stack([np.concatenate(f) for f in ((one, none), (none, one), (-y, x))])


def factorised(stiffness: sp.csc_matrix, *, ordered: bool = False) -> SuperLU:
    """Factorise the stiffness of a part; what next to nothing holds has none that can be.

    `ordered` says whether its unknowns come in the order in which they are to be eliminated.
    """
    try:
        return splu(
            stiffness,
            permc_spec="NATURAL" if ordered else "MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        raise ModelError(
            "the stiffness of a body is singular, as a part of it hangs by next to nothing or can "
            "move freely: look at `flexstage check`, and for thin walls about holes"
        ) from None


def elimination_order(matrix: sp.csc_matrix) -> NDArray[np.intp]:
    """Return an order in which the unknowns of a symmetric matrix are eliminated with little fill.

    That of the shape functions of a mesh is one for all fields on it, found in a twentieth of the
    time.
    """
    return np.argsort(factorised(matrix).perm_c)


def _stiffness(continuum: Continuum) -> sp.csc_matrix:
    """Assemble the stiffness of a plane part [N/m]."""
    u, v = continuum.space.TnT()
    inner = ng.InnerProduct(ng.Sym(ng.Grad(u)), ng.Sym(ng.Grad(v)))
    density = continuum.lame * ng.div(u) * ng.div(v) + 2.0 * continuum.shear_modulus * inner
    form = ng.BilinearForm(continuum.space)
    form += continuum.thickness * density * ng.dx
    form.Assemble()
    rows, columns, values = (np.asarray(part) for part in form.mat.COO())
    return sp.csc_matrix((values, (rows, columns)), shape=(continuum.size, continuum.size))
