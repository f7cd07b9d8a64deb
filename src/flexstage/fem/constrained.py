"""A part whose interfaces move as told, held or floating, and the tractions in them that tell."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.fem.block_lanczos import softest_modes
from flexstage.fem.layered_plate import LayeredPlate

_ALIKE = 1e11  # two interfaces are one if a unit force on both in turn moves them so little apart
_SPRING = 1e3  # as many times as stiff as the mesh is there
_SETTLED = 1e-3  # of the squares of frequencies, from one step to the next
_BLOCK = 8  # loads that the search for modes starts with


class Constrained:
    r"""A body whose interface motions q = P u are given.

    A floating body is solved for balanced loads alone, up to its rigid motions R, whatever holds
    it: the flexibility with inertia relief. Interface forces and rigid motion are then found
    together, with :math:`X = K^+ P^T`, :math:`G = P X`, :math:`A = P R`:

    .. math:: \begin{bmatrix} G & A\\ A^T & 0\end{bmatrix}
              \begin{bmatrix}\lambda\\ a\end{bmatrix}
              = \begin{bmatrix} q - P K^+ f\\ -R^T f\end{bmatrix},
              \quad u = K^+ f + X\lambda + R a

    The rows P have shape (m, n); where `mixed` is given, it says of the flexibility of what rows,
    shape (m, m), they are made up, shape (k, m). Loads and displacements are one a column.
    """

    def __init__(
        self,
        part: LayeredPlate,
        P: Array,
        mixed: Callable[[Array], Array] | None = None,
        *,
        floating: bool,
    ) -> None:
        self.part = part
        self.rigid = part.rigid
        self.weighted = part.mass_times(self.rigid)
        self._balance = np.zeros((part.size, 0)), np.zeros((part.size, 0))
        if floating:
            factor = np.linalg.cholesky(self.rigid.T @ self.weighted)
            self._balance = (
                np.linalg.solve(factor, self.rigid.T).T,
                np.linalg.solve(factor, self.weighted.T).T,
            )
        # balanced loads leave nothing to stiff springs at three unknowns, whichever they are
        self._factor = part.factorised(part.pins if floating else None, _SPRING)
        X = self.loose(P.T)
        if mixed is not None:
            mix = mixed(P @ X)
            P, X = mix @ P, X @ mix.T
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
        u = self._factor.solve(load - weighted @ (rigid.T @ load))
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
