"""Cholesky factor of a plate with many fields: groups of places of its mesh in dense fronts."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.sparse.linalg import splu

from flexstage.base.arrays import Array

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
        self.taken = np.flatnonzero(columns >= rows)
        self.row, self.column = rows[self.taken], columns[self.taken]
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
