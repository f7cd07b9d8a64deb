"""Integrals over the plane of a part, and the Cholesky factor of a plate in dense fronts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.sparse.linalg import SuperLU, splu

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.elasticity.shapes import METRE

(_inverse,) = get_lapack_funcs(("trtri",), dtype=np.float64)
_NOTHING = np.zeros((0, 0))
_BRANCH = 9  # places of a branch of the tree that are eliminated at once


@dataclass(frozen=True, slots=True, eq=False)
class EliminationFront:
    """Places that are eliminated at once, from `first` to before `end`."""

    first: int
    end: int
    coupled: NDArray[np.intp]
    """Later places that their elimination acts on, in order."""
    branches: list[tuple[int, list[tuple[int, int, int]]]]
    """Fronts that act on this one: number of each, and ranges of its coupled places, with their
    position among the places and coupled places of this front.
    """


class Fronts:
    """The tree of fronts in which the places of a mesh are eliminated.

    Rows and columns say which places share an element, in an order of elimination that fills
    little.

    Notes
    -----
    J. W. H. Liu, SIAM Review 34 (1992) 82.
    """

    def __init__(self, rows: NDArray[np.intp], columns: NDArray[np.intp], size: int) -> None:
        # a matrix in whose factor nothing cancels
        shared = np.where(rows == columns, np.bincount(rows)[rows], -1.0)
        lower = splu(
            sp.csc_matrix((shared, (rows, columns)), shape=(size, size)),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        ).L
        lower.sort_indices()
        starts, count = lower.indptr, np.diff(lower.indptr)
        # the first place that each acts on, and how many are eliminated for it
        parent = np.where(
            count > 1, lower.indices[np.minimum(starts[:-1] + 1, lower.nnz - 1)], size
        )
        over, branch, free = parent.tolist(), [1] * size + [0], [size - 1] * (size + 1)
        for i in range(size):
            branch[over[i]] += branch[i]
        turned = [0] * size
        top = list(range(size + 1))
        for i in reversed(range(size)):
            turned[i] = free[over[i]]
            free[over[i]] -= branch[i]
            free[i] = turned[i] - 1
            if over[i] < size and branch[over[i]] <= _BRANCH:
                top[i] = top[over[i]]
        #: Place of each place when branches follow one another.
        self.rank = np.array(turned)
        old = np.argsort(self.rank)
        tops, sizes = np.array(top)[old], np.array(branch)[old]
        follows = (parent[old[:-1]] == old[1:]) & (count[old[:-1]] == count[old[1:]] + 1)
        follows &= sizes[:-1] > _BRANCH
        firsts = np.flatnonzero(np.append(True, ~follows & (tops[1:] != tops[:-1]))).tolist()
        ends = [*firsts[1:], size]
        #: Front of each place.
        self.owner = np.repeat(np.arange(len(firsts)), np.subtract(ends, firsts))
        self.fronts: list[EliminationFront] = []
        branches: list[list[int]] = [[] for _ in firsts]
        for i, (first, end) in enumerate(zip(firsts, ends, strict=True)):
            last = old[end - 1]
            coupled = np.sort(self.rank[lower.indices[starts[last] + 1 : starts[last + 1]]])
            here = np.concatenate((np.arange(first, end), coupled))
            acting = []
            for j in branches[i]:
                at = np.searchsorted(here, self.fronts[j].coupled)
                cuts = np.flatnonzero((np.diff(at) != 1) | (at[1:] == end - first)) + 1
                bounds = [0, *cuts.tolist(), at.size]
                stretches = zip(bounds[:-1], bounds[1:], at[bounds[:-1]].tolist(), strict=True)
                acting.append((j, list(stretches)))
            self.fronts.append(EliminationFront(first, end, coupled, acting))
            if coupled.size:
                branches[self.owner[coupled[0]]].append(i)
        rows, columns = self.rank[rows], self.rank[columns]
        #: The rows and columns in use: of two places those in which the column is later.
        self.entries = np.flatnonzero(columns >= rows)
        self.row, self.column = rows[self.entries], columns[self.entries]
        # coupled places, of all fronts one after another
        self.every = np.concatenate([front.coupled for front in self.fronts])
        self.bounds = np.cumsum([0, *(front.coupled.size for front in self.fronts)])
        keys = np.repeat(np.arange(len(firsts)), np.diff(self.bounds)) * size + self.every
        #: Position of the columns among the coupled places, where they are not of the front itself.
        self.at = np.searchsorted(keys, self.owner[self.row] * size + self.column)
        self.at[self.owner[self.row] == self.owner[self.column]] = -1


class FrontalFactor:
    """Cholesky factor of a symmetric matrix, of which places of a mesh have some unknowns each.

    `first` and `height` are the first unknown and the number of unknowns of each place, in the
    order of `Fronts`. Blocks of the matrix have to be put into `data` before it is factorised.
    """

    def __init__(self, fronts: Fronts, first: NDArray[np.intp], height: NDArray[np.intp]) -> None:
        self.fronts = fronts
        ends = np.concatenate(([0], np.cumsum(height)))
        number = np.arange(ends[-1])
        self._unknowns = np.repeat(first - ends[:-1], height) + number
        # coupled unknowns, of all fronts one after another
        ahead = np.concatenate(([0], np.cumsum(height[fronts.every])))
        later = np.repeat(ends[fronts.every] - ahead[:-1], height[fronts.every])
        later += np.arange(ahead[-1])
        bounds = ahead[fronts.bounds]
        low = ends[[front.first for front in fronts.fronts]]
        high, wide = np.diff(np.append(low, ends[-1])), np.diff(bounds)
        # of each front the square of its unknowns, then their block with the coupled ones
        begin = np.cumsum(high * (high + wide)) - high * (high + wide)
        owner, inside = fronts.owner[fronts.row], fronts.at < 0
        #: Distance of the rows of each block of the matrix in `data`.
        self.apart = np.where(inside, high[owner], wide[owner])
        #: Start of each of these blocks in `data`.
        self.start = self.apart * (ends[fronts.row] - low[owner]) + np.where(
            inside,
            begin[owner] + ends[fronts.column] - low[owner],
            begin[owner] + high[owner] ** 2 + ahead[fronts.at] - bounds[owner],
        )
        #: Values of the matrix, front by front.
        self.data = np.zeros(int(np.sum(high * (high + wide))))
        front_of_unknown = np.repeat(fronts.owner, height)
        #: Position of the diagonal of each unknown in `data`.
        self.diagonal = np.empty(number.size, dtype=np.intp)
        self.diagonal[self._unknowns] = begin[front_of_unknown] + (
            number - low[front_of_unknown]
        ) * (high[front_of_unknown] + 1)
        self._ends = [
            (ends[f.first : f.end] - a).tolist() + (m + ahead[i : j + 1] - ahead[i]).tolist()
            for f, a, m, i, j in zip(
                fronts.fronts, low, high, fronts.bounds[:-1], fronts.bounds[1:], strict=True
            )
        ]
        #: Unknowns, coupled unknowns and both matrices of each front.
        self._blocks = [
            (
                slice(a, a + m),
                later[i : i + n],
                self.data[s : s + m * m].reshape(m, m),
                self.data[s + m * m : s + m * (m + n)].reshape(m, n),
            )
            for a, m, n, i, s in np.column_stack((low, high, wide, bounds[:-1], begin)).tolist()
        ]

    def factorise(self) -> None:
        """Factorise `data`; raise `numpy.linalg.LinAlgError` if it is not positive definite."""
        rest: list[Array] = []
        for number, (front, ends) in enumerate(zip(self.fronts.fronts, self._ends, strict=True)):
            _, _, square, right = self._blocks[number]
            m, n = right.shape
            later = np.zeros((n, n))
            for other, stretches in front.branches:
                acts, rest[other] = rest[other], _NOTHING
                of = self._ends[other][-1 - len(self.fronts.fronts[other].coupled) :]
                pieces = [(of[i] - of[0], of[j] - of[0], ends[k]) for i, j, k in stretches]
                for k, (i, j, row) in enumerate(pieces):
                    for p, q, column in pieces[k:]:
                        add = acts[i:j, p:q]
                        if row >= m:
                            later[row - m : row - m + j - i, column - m : column - m + q - p] += add
                        elif column >= m:
                            right[row : row + j - i, column - m : column - m + q - p] += add
                        else:
                            square[row : row + j - i, column : column + q - p] += add
            if m:
                # of the upper triangle; by its inverse, solutions are products
                square[:] = _inverse(np.linalg.cholesky(square.T), lower=1)[0]
                right[:] = square @ right
                later -= right.T @ right
            rest.append(later)

    def solve(self, loads: Array) -> Array:
        """Return the solutions for right sides, shape (n, k)."""
        x = np.ascontiguousarray(loads[self._unknowns])
        for pivots, coupled, square, right in self._blocks:
            x[pivots] = square @ x[pivots]
            x[coupled] -= right.T @ x[pivots]
        for pivots, coupled, square, right in reversed(self._blocks):
            x[pivots] = square.T @ (x[pivots] - right @ x[coupled])
        solution = np.empty_like(x)
        solution[self._unknowns] = x
        return solution


#: Message about a stiffness that is singular.
SINGULAR = (
    "the stiffness of a body is singular, because a part of it is almost detached or can move "
    "freely: run `flexstage check`, and look for thin walls around holes"
)


def factorised(stiffness: sp.csc_matrix, *, ordered: bool = True) -> SuperLU:
    """Factorise the stiffness of a part; refuse one that is almost free.

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
        raise ModelError(SINGULAR) from None


def _indicator(mesh: ng.Mesh, regions: str) -> ng.CoefficientFunction | None:
    """Return 1 in regions by a regular expression and 0 elsewhere; None without an expression."""
    if not regions:
        return None
    inside = mesh.Materials(regions).Mask()
    return ng.CoefficientFunction([float(inside[i]) for i in range(len(mesh.GetMaterials()))])


class PlaneIntegrals:
    """Integrals over the plane of a part, which all motions of the plate share.

    `strain` is the regular expression of the regions in plane strain, for a plane model, and
    `other` that of regions of another material.
    """

    def __init__(
        self, mesh: ng.Mesh, *, order: int, fixed: str, strain: str = "", other: str = ""
    ) -> None:
        self.mesh, self.order = mesh, order
        #: 1 in regions in plane strain, 0 elsewhere; None where there is no such region.
        self.strained = _indicator(mesh, strain)
        #: The same of regions of another material.
        self.other = _indicator(mesh, other)
        self.scalar = ng.H1(mesh, order=order, dirichlet=fixed)
        self.width = int(self.scalar.ndof)
        # at once, as the mesh is used by one thread at a time
        #: Shape functions in the order in which a plate eliminates them; rows, columns and values
        #: of the integrals of their derivatives, by rows and columns in this order.
        self.order_of_elimination, self.pattern = self._integrals()
        #: Factors of the shape functions that make up 1, x and y [m], shape (n, 3).
        self.places = self._places()

    def _integrals(
        self,
    ) -> tuple[NDArray[np.intp], tuple[NDArray[np.int64], NDArray[np.int64], Array]]:
        """Return the order of elimination, and integrals of derivatives of shape functions.

        Values 3 m + n are of derivative m of the test function and n of the trial function, in
        metres; the third is no derivative. Nine more are of the regions in plane strain alone, if
        there are any, and nine of those of another material. Rows, columns and values have shapes
        (k,), (k,) and (9, k), (18, k) or (27, k).

        The order of the shape functions is one for all fields on them, found in a twentieth of the
        time.
        """
        p, q = self.scalar.TnT()
        tests = (ng.Grad(q)[0], ng.Grad(q)[1], q)
        trials = (ng.Grad(p)[0], ng.Grad(p)[1], p)
        weights = [1.0, *(w for w in (self.strained, self.other) if w is not None)]
        pairs = [(m, n) for m in range(3) for n in range(m, 3)]
        integrals: dict[tuple[int, int, int], Array] = {}
        columns = ends = np.zeros(0, dtype=np.intp)
        for (w, weight), (m, n) in product(enumerate(weights), pairs):
            if w and n == 2 and weight is self.strained:  # it adds nothing to what is no derivative
                continue
            form = ng.BilinearForm(self.scalar)
            form += weight * tests[m] * trials[n] * ng.dx
            form.Assemble()
            values, *places = (np.asarray(a) for a in form.mat.CSR())
            integrals[w, m, n] = METRE ** -((m == 2) + (n == 2)) * values
            columns, ends = (a.astype(np.intp) for a in places)
        rows = np.repeat(np.arange(self.width), np.diff(ends))
        mass = sp.csc_matrix((integrals[0, 2, 2], columns, ends))
        order = np.argsort(factorised(mass, ordered=False).perm_c)
        rank = np.argsort(order)
        # a matrix that is turned has its entries in order, and the pattern is that of the transpose
        turned = sp.coo_matrix((np.arange(rows.size), (rank[rows], rank[columns]))).tocsc()
        by, across = (np.asarray(a.data, dtype=np.intp) for a in (turned.tocsr(), turned))
        planes = np.zeros((9 * len(weights), by.size))
        for (w, m, n), integral in integrals.items():
            planes[9 * w + 3 * m + n] = integral[by]
            if n != m:
                planes[9 * w + 3 * n + m] = integral[across]
        return order, (rows[by], columns[by], planes)

    @cached_property
    def fronts(self) -> Fronts:
        """The fronts in which a plate with many fields is eliminated."""
        rank = np.argsort(self.order_of_elimination)
        rows, columns, _ = self.pattern
        return Fronts(rank[rows], rank[columns], self.width)

    def _places(self) -> Array:
        one = np.zeros(self.width)
        one[: self.mesh.nv] = 1.0  # the shape functions of the vertices make up a constant
        place = ng.GridFunction(ng.H1(self.mesh, order=self.order, dim=2))
        place.Set(ng.CoefficientFunction((ng.x / METRE, ng.y / METRE)))
        return np.column_stack((one, place.vec.FV().NumPy().reshape(-1, 2)))

    def inside(
        self, notches: Sequence[tuple[str, tuple[float, float], float]]
    ) -> NDArray[np.bool_]:
        """Return which unknowns lie in notches alone, with all elements that share them.

        Each notch has its region, its centre [m], and its radius about it [m].
        """
        elements = list(self.mesh.Elements(ng.VOL))
        corners = [[self.mesh[v].point for v in e.vertices] for e in elements]
        middles = np.mean(corners, axis=1) / METRE
        index = np.array([e.index for e in elements])
        near = np.zeros(len(elements), dtype=bool)
        for region, (x, y), reach in notches:
            near |= np.hypot(middles[:, 0] - x, middles[:, 1] - y) <= reach
            near |= np.array(self.mesh.Materials(region).Mask(), dtype=bool)[index]
        in_notches = np.ones(self.width, dtype=bool)
        for e in (e for e, within in zip(elements, near, strict=True) if not within):
            in_notches[list(self.scalar.GetDofNrs(ng.ElementId(e)))] = False
        return in_notches

    def linear(self, integrand: Callable[[Any], Any], region: str = ".*") -> Array:
        """Assemble an integral over regions of the plane [mm^2] with the scalar test function."""
        form = ng.LinearForm(self.scalar)
        form += integrand(self.scalar.TestFunction()) * ng.dx(region, bonus_intorder=2)
        form.Assemble()
        return form.vec.FV().NumPy().copy()
