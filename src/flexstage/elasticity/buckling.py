"""Linear buckling of a meshed part: by what factor a load may grow before it gives way."""

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from flexstage.arrays import Array
from flexstage.elasticity.continuum import Continuum
from flexstage.elasticity.loaded import holding, volume_unit
from flexstage.elasticity.resources import parallel
from flexstage.elasticity.shapes import METRE
from flexstage.errors import ConvergenceError, ModelError

_MOST = 150  # vectors; 20 to 40 are usual


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BucklingFactors:
    """Factors of a reference load at which a part buckles."""

    positive: Array
    """Factors of the load as it acts, the smallest first [1]; empty where it cannot buckle the
    part, shape (k,).
    """
    positive_shapes: Array
    """Their shapes, of unit strain energy times two, shape (n, k)."""
    negative: Array
    """Factors of the reversed load, the smallest magnitude first [1], shape (m,)."""
    negative_shapes: Array
    """Their shapes, shape (n, m)."""


def buckling(
    continuum: Continuum,
    u: Array,
    *,
    count: int = 1,
    change: ng.CoefficientFunction | float = 0.0,
    locked: Array | None = None,
    reach: float = 100.0,
    tolerance: float = 1e-6,
) -> BucklingFactors:
    r"""Return the load factors of linear buckling.

    .. math:: (K + \lambda K_g)\,\phi = 0, \quad
       K_g = \int \sigma_0 : (\nabla\phi^T \nabla\psi)\,dV

    with the stress sigma_0 of the reference state. It is solved for 1/lambda, whose extremes are
    the factors wanted, with the factorised stiffness that the part has already.

    Parameters
    ----------
    continuum : Continuum
        The part; something must hold it.
    u : numpy.ndarray
        Displacements of the reference state by `Continuum.solve` [m], shape (n,).
    count : int
        How many factors of each sign.
    change : ngsolve.CoefficientFunction or float
        Change of temperature of the reference state [K].
    locked : numpy.ndarray, optional
        Readings that stay as they are while the part buckles, such as the elongation of a stiff
        drive, shape (k, n).
    reach : float
        Factors beyond this multiple of the smallest of both signs are left out [1].
    tolerance : float
        Relative tolerance of the residuals; that of the factors is about its square.

    Returns
    -------
    BucklingFactors
        The factors and their shapes.

    Raises
    ------
    ModelError
        Nothing holds the part, or the reference state has no stress.
    ConvergenceError
        The iteration did not end.

    Notes
    -----
    Bathe 1996, *Finite Element Procedures*, sec. 6.8.2.

    Validity: bifurcation from a straight path: the displacements before buckling are small and grow
    with the load, which keeps its direction. A part that bends as it is loaded, or snaps through,
    needs `follow_drive`; imperfections lower what real parts reach.

    Examples
    --------
    A column of 60 x 1 x 10 mm, clamped at its foot; Euler: pi^2 E I / (4 L^2) = 40.95 N.

    >>> import ngsolve as ng
    >>> from netgen.occ import OCCGeometry, Rectangle
    >>> from flexstage.elasticity import Continuum
    >>> from flexstage.material import material
    >>> column = Rectangle(60, 1).Face()
    >>> for edge in column.edges:
    ...     edge.name = {0.0: "foot", 60.0: "top"}.get(round(edge.center.x, 6), "side")
    >>> mesh = ng.Mesh(OCCGeometry(column, dim=2).GenerateMesh(maxh=5))
    >>> part = Continuum(
    ...     mesh, material("Al 7075-T6"), order=4, thickness=10e-3, held="foot"
    ... )
    >>> u = part.solve(part.mean("top", (-1, 0)))
    >>> round(float(buckling(part, u).positive[0]), 1)
    41.0
    """
    if continuum.shift:
        raise ModelError(
            "buckling needs the stiffness alone, and this part has a shift: make it without one"
        )
    geometric = _geometric(continuum, u, change)
    if not np.abs(geometric.data).max() > 0.0:
        raise ModelError("the reference state has no stress, so it cannot buckle: load the part")
    solve = continuum.solve
    if locked is not None:
        solve = holding(solve, np.atleast_2d(locked))
    inverse, shapes = _extremes(-geometric, solve, count, reach, tolerance)
    up, down = inverse > 0.0, inverse < 0.0
    return BucklingFactors(
        positive=1.0 / inverse[up],
        positive_shapes=shapes[:, up],
        negative=1.0 / inverse[down],
        negative_shapes=shapes[:, down],
    )


def _geometric(
    continuum: Continuum, u: Array, change: ng.CoefficientFunction | float
) -> sp.csr_matrix:
    """What the stress of the reference state adds to the stiffness."""
    d = continuum.dimension
    trial, test = continuum.space.TnT()
    a, b = METRE * ng.Grad(trial), METRE * ng.Grad(test)
    full = continuum.stress(u, change)
    # nothing varies through the thickness, so the stress through it does no work
    stress = ng.CoefficientFunction(
        tuple(full[i, j] for i in range(d) for j in range(d)), dims=(d, d)
    )
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
    reach: float,
    tolerance: float,
) -> tuple[Array, Array]:
    """Eigenvalues of a matrix against the stiffness at both ends, and their vectors.

    Lanczos' method with two starting vectors, so that a double factor is found as such, orthogonal
    in the energy. A vector is kept with the load that makes it, v = K^-1 g: the stiffness itself is
    then never needed. At either end it stops where no eigenvalue stands out from nothing, which is
    where a restarted method would wait for ever.
    """
    n = matrix.indptr.size - 1
    vectors, loads = np.empty((_MOST, n)), np.empty((_MOST, n))
    projected = np.zeros((_MOST, _MOST))
    kept = 0

    def keep(load: Array) -> None:
        nonlocal kept
        v = solve(load)
        before = np.sqrt(abs(load @ v))
        for _ in range(2):  # the second time for what the first one's rounding left
            parts = loads[:kept] @ v
            v, load = v - parts @ vectors[:kept], load - parts @ loads[:kept]
        norm = np.sqrt(max(load @ v, 0.0))
        if norm > 1e-7 * before and kept < _MOST:
            vectors[kept], loads[kept] = v / norm, load / norm
            kept += 1

    for start in np.random.default_rng(0).standard_normal((2, n)):
        keep(start)
    for i in range(_MOST):
        load = matrix @ vectors[i]
        keep(load)
        projected[: i + 1, i] = projected[i, : i + 1] = vectors[: i + 1] @ load
        done = i + 1 == kept
        if not done and i < 2 * count + 8:
            continue
        values, turns = np.linalg.eigh(projected[: i + 1, : i + 1])
        wrong = np.zeros_like(values)
        if not done:
            # what is left of K^-1 A v - value v lies in the vectors that were not multiplied yet;
            # of the others than the outermost nothing is asked
            outer = np.unique(np.r_[:count, -count:0] % values.size)
            rest = vectors[i + 1 : kept] @ (matrix @ (turns[:, outer].T @ vectors[: i + 1]).T)
            wrong[outer] = np.linalg.norm(rest, axis=0)
        chosen = _chosen(values, wrong, count, reach, tolerance)
        if chosen is not None:
            return values[chosen], vectors[: i + 1].T @ turns[:, chosen]
    raise ConvergenceError(
        f"the buckling factors were not found in {_MOST} iterations: ask for fewer of them, or for "
        "a smaller reach"
    )


def _chosen(
    values: Array, wrong: Array, count: int, reach: float, tolerance: float
) -> list[int] | None:
    """Pick the wanted eigenvalues of both signs, largest first; None where more work is needed."""
    least = np.abs(values).max() / reach
    found: list[int] = []
    for sign in (1.0, -1.0):
        for k in np.argsort(-sign * values)[:count]:
            if sign * values[k] > least:
                if wrong[k] > tolerance * abs(values[k]):
                    return None
                found.append(int(k))
            elif wrong[k] > least:
                return None
            else:
                break
    return found
