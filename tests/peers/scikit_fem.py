"""scikit-fem (T. Gustafsson, G. D. McBain, J. Open Source Softw. 5 (2020) 2369) as a peer.

Its elements of a higher order need corners in ascending order: otherwise they answer wrongly,
without a word, on curved meshes.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.elasticity.loaded import von_mises_of
from flexstage.quantities.material import Material
from tests.peers.grids import Grid, Index

# SciPy's types are guessed, and some guesses are wrong
sp: Any = scipy.sparse
spl: Any = scipy.sparse.linalg

# middle of the edge between two corners of a triangle, by column of the elements of a grid
_MIDDLES = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])


class Part:
    """A plane part of curved triangles, assembled and factorised once.

    Stiffness and inertia are put together from integrals over scalar functions, which takes a
    quarter of the time that those over vectors take. Coordinates are all x, then all y.
    """

    def __init__(
        self,
        grid: Grid,
        material: Material,
        *,
        thickness: float,
        plane_strain: bool,
        held: Index,
        order: int = 2,
        threads: int = 0,
    ) -> None:
        pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install scikit-fem")
        import skfem

        corners = np.argsort(grid.elements[:, :3], axis=1)
        pairs = ((0, 1), (1, 2), (0, 2))
        middles = np.stack([_MIDDLES[corners[:, a], corners[:, b]] for a, b in pairs], axis=1)
        triangles = np.take_along_axis(grid.elements, np.hstack((corners, middles)), axis=1)
        self.mesh: Any = skfem.MeshTri2(
            doflocs=np.ascontiguousarray(grid.nodes.T), t=np.ascontiguousarray(triangles.T)
        )
        # the mesh numbers corners alone
        self._corner = np.full(grid.nodes.shape[0], -1)
        used = np.unique(triangles[:, :3])
        self._corner[used] = np.arange(used.size)
        self.order, self.element = order, getattr(skfem, f"ElementTriP{order}")()
        self.basis = skfem.Basis(self.mesh, self.element, intorder=2 * order)
        E, nu = material.youngs_modulus, material.poissons_ratio
        self.mu = 0.5 * E / (1.0 + nu)
        self.lam = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu) if plane_strain else 1.0 - nu**2)
        self.strain_nu = nu if plane_strain else 0.0

        def integral(form: Callable[..., Any], basis: object) -> Any:
            return thickness * skfem.BilinearForm(form, nthreads=threads).assemble(basis)

        # slopes are of one degree less, and exact where sides are straight
        slopes = skfem.Basis(self.mesh, self.element, intorder=max(4, 2 * order - 2))
        xx = integral(lambda u, v, _: u.grad[0] * v.grad[0], slopes)
        yy = integral(lambda u, v, _: u.grad[1] * v.grad[1], slopes)
        yx = integral(lambda u, v, _: u.grad[1] * v.grad[0], slopes)
        m = material.density * integral(lambda u, v, _: u * v, self.basis)
        stiff, mu = self.lam + 2.0 * self.mu, self.mu
        across = self.lam * yx + mu * yx.T
        K = sp.bmat([[stiff * xx + mu * yy, across], [across.T, stiff * yy + mu * xx]]).tocsr()
        M = sp.block_diag((m, m)).tocsr()
        fixed = self.basis.get_dofs(self.facets(held)).flatten()
        self.free = np.setdiff1d(np.arange(K.shape[0]), [fixed, fixed + self.basis.N])
        self.K, self.M = (A[self.free][:, self.free].tocsc() for A in (K, M))
        # a stiffness needs no pivots, and its pattern is symmetric: half the fill of the default
        self.factor = spl.splu(
            self.K,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    @property
    def size(self) -> int:
        """Number of unknowns, held ones included."""
        return 2 * self.basis.N

    def facets(self, edges: Index) -> Index:
        """Numbers of edges of the grid in the mesh."""
        count = np.int64(self._corner.max() + 1)
        a, b = np.sort(self._corner[edges[:, [0, 2]]], axis=1).T
        keys = self.mesh.facets[0] * count + self.mesh.facets[1]
        order = np.argsort(keys)
        return np.unique(order[np.searchsorted(keys[order], a * count + b)])

    def mean(self, edges: Index, along: tuple[float, float]) -> Array:
        """Return the mean displacement of a side along a direction, or a force spread over it."""
        import skfem

        side = skfem.FacetBasis(
            self.mesh, self.element, facets=self.facets(edges), intorder=self.order + 1
        )
        shares = skfem.LinearForm(lambda v, _: v).assemble(side)
        return np.outer(along, shares / shares.sum()).ravel()

    def region(self, elements: Index) -> Any:
        """Return the basis of some elements alone."""
        import skfem

        return skfem.Basis(self.mesh, self.element, elements=elements, intorder=2 * self.order)

    def integral(self, region: Any, weights: Array) -> Array:
        """Integrate the functions of the part over a region, weighted at its points."""
        import skfem

        return skfem.LinearForm(lambda v, w: w.weights * v).assemble(region, weights=weights)

    def displacements(self, loads: Array) -> Array:
        """Solve for loads, shape (size, k)."""
        u = np.zeros(loads.shape)
        u[self.free] = self.factor.solve(np.ascontiguousarray(loads[self.free]))
        return u

    def frequencies(self, modes: int) -> Array:
        """Find the lowest natural frequencies [Hz]."""
        inner = spl.LinearOperator(self.K.shape, matvec=self.factor.solve, dtype=float)
        squares = spl.eigsh(
            self.K, k=modes, M=self.M, sigma=0.0, OPinv=inner, return_eigenvectors=False,
            v0=self.factor.solve(np.ones(self.free.size)), tol=1e-6,
        )  # fmt: skip
        return np.sqrt(np.sort(squares)) / (2.0 * np.pi)

    def peak(self, u: Array, elements: Index | None = None, points: int = 2) -> float:
        """Largest von Mises stress, of the whole part or of some elements.

        It is taken at the ends of so many parts of each edge, and at as fine a lattice within;
        where these elements meet it is averaged.
        """
        import skfem

        n = points
        at = np.array([(i / n, j / n) for j in range(n + 1) for i in range(n + 1 - j)]).T
        places: Any = skfem.Basis(
            self.mesh, self.element, elements=elements, quadrature=(at, np.ones(at.shape[1]))
        )
        x = np.round(np.asarray(places.global_coordinates()).reshape(2, -1).T * 1e8).astype(
            np.int64
        )
        shared = np.unique(x, axis=0, return_inverse=True)[1].ravel()
        gx, gy = (places.interpolate(part).grad for part in np.split(u, 2))
        share = self.lam * (gx[0] + gy[1])
        xx, yy, xy = 2 * self.mu * gx[0] + share, 2 * self.mu * gy[1] + share, gx[1] + gy[0]
        zero = np.zeros_like(xx)
        parts = (xx, yy, self.strain_nu * (xx + yy), zero, zero, self.mu * xy)
        count = np.bincount(shared)
        means = [np.bincount(shared, part.ravel()) / count for part in parts]
        return float(von_mises_of(np.stack(means, axis=-1)).max())


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneFigures:
    """A plane part under a force of 1 N along y that is spread over one side."""

    compliance: float  # mean displacement of that side [m/N]
    frequencies: Array  # [Hz]
    peak_stress: float  # largest von Mises stress at a node, mean of its elements [Pa]
    unknowns: int
    seconds: float  # from the arrays to the figures


def solve(
    grid: Grid,
    material: Material,
    *,
    thickness: float,
    plane_strain: bool,
    held: Callable[[Array], NDArray[np.bool_]],
    loaded: Callable[[Array], NDArray[np.bool_]],
    modes: int = 3,
    order: int = 2,
) -> PlaneFigures:
    """Solve a plane part of curved triangles; sides are told by their points, shape (n, 2)."""
    start = time.perf_counter()
    part = Part(
        grid,
        material,
        thickness=thickness,
        plane_strain=plane_strain,
        held=grid.edges(held),
        order=order,
    )
    load = part.mean(grid.edges(loaded), (0.0, 1.0))
    u = part.displacements(load[:, None])[:, 0]
    return PlaneFigures(
        compliance=float(load @ u),
        frequencies=part.frequencies(modes),
        peak_stress=part.peak(u),
        unknowns=part.size,
        seconds=time.perf_counter() - start,
    )
