"""scikit-fem (T. Gustafsson, G. D. McBain, J. Open Source Softw. 5 (2020) 2369) as a peer.

Quadratic triangles only: of a higher order it answers wrongly, without a word, on curved meshes of
the second order.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.elasticity.loaded import von_mises_of
from flexstage.material import Material
from tests.peers.grids import Grid

# SciPy's types are guessed, and some guesses are wrong
spl: Any = scipy.sparse.linalg


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
) -> PlaneFigures:
    """Solve a plane part of quadratic triangles; places are told by their points, shape (2, n)."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install scikit-fem")
    from skfem import (
        Basis,
        BilinearForm,
        ElementTriP2,
        ElementVector,
        FacetBasis,
        LinearForm,
        MeshTri2,
    )
    from skfem.helpers import ddot, dot, sym_grad, trace

    start = time.perf_counter()
    # its middles are those of the edges 0-1, 1-2, 0-2, as ours
    mesh = MeshTri2(
        doflocs=np.ascontiguousarray(grid.nodes.T),
        t=np.ascontiguousarray(grid.elements.T),
        sort_t=False,
    )
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=6)
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    mu = 0.5 * E / (1.0 + nu)
    lam = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)) if plane_strain else E * nu / (1.0 - nu**2)

    def stiffness(u, v, _):
        e, f = sym_grad(u), sym_grad(v)
        return thickness * (2.0 * mu * ddot(e, f) + lam * trace(e) * trace(f))

    def inertia(u, v, _):
        return rho * thickness * dot(u, v)

    def push(v, _):
        return v[1]

    K, M = (BilinearForm(form).assemble(basis).tocsc() for form in (stiffness, inertia))
    side = FacetBasis(mesh, basis.elem, facets=mesh.facets_satisfying(loaded, True), intorder=6)
    load = LinearForm(push).assemble(side)
    load /= np.sum(load)
    fixed = basis.get_dofs(mesh.facets_satisfying(held, True)).flatten()
    free = np.setdiff1d(np.arange(basis.N), fixed)
    factor = spl.splu(K[free][:, free])
    u = np.zeros(basis.N)
    u[free] = factor.solve(load[free])
    inner = spl.LinearOperator((free.size, free.size), matvec=factor.solve, dtype=float)
    squares = spl.eigsh(
        K[free][:, free], k=modes, M=M[free][:, free], sigma=0.0, OPinv=inner,
        return_eigenvectors=False, v0=factor.solve(np.ones(free.size)), tol=1e-6,
    )  # fmt: skip
    peak = _peak(grid, basis, u, lam, mu, nu if plane_strain else None)
    return PlaneFigures(
        compliance=float(load @ u),
        frequencies=np.sqrt(np.sort(squares)) / (2.0 * np.pi),
        peak_stress=peak,
        unknowns=basis.N,
        seconds=time.perf_counter() - start,
    )


def _peak(
    grid: Grid, basis: object, u: Array, lam: float, mu: float, strain_nu: float | None
) -> float:
    """Stress at the nodes of each element, averaged over the elements that share one."""
    from skfem import Basis

    at = np.array([[0.0, 1.0, 0.0, 0.5, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0, 0.5, 0.5]])
    nodal = Basis(basis.mesh, basis.elem, quadrature=(at, np.ones(6)))  # type: ignore[attr-defined]
    g = nodal.interpolate(u).grad
    share = lam * (g[0, 0] + g[1, 1])
    xx, yy, xy = 2 * mu * g[0, 0] + share, 2 * mu * g[1, 1] + share, mu * (g[0, 1] + g[1, 0])
    zz = np.zeros_like(xx) if strain_nu is None else strain_nu * (xx + yy)
    zero = np.zeros_like(xx)
    parts = np.stack((xx, yy, zz, zero, zero, xy), axis=-1)
    total, count = np.zeros((grid.nodes.shape[0], 6)), np.zeros(grid.nodes.shape[0])
    np.add.at(total, grid.elements, parts)
    np.add.at(count, grid.elements, 1.0)
    return float(von_mises_of(total / count[:, None]).max())
