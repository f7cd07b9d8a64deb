"""The two linear-algebra jobs of the room, with errors that an engineer can act on."""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh, get_lapack_funcs, null_space

from flexstage.arrays import Array
from flexstage.errors import ModelError

# Rounding may leave any pivot of a singular matrix positive, so the last pivots say little: a small
# one before has left 1e-16 over itself in them. The reciprocal condition number of K with a unit
# diagonal tells: at most 1e-16 of a thousand mechanisms drawn at random, 5e-6 or more of all
# designs, and still 7e-15 of these with necks of some nanometres.
_CONDITION = 1e-15


def solve_stiffness(stiffness: Array, right: Array, held: Array) -> tuple[Array, Array]:
    """Solve K q = f with some linear combinations of q held at zero.

    K is symmetric, f and q have one column for each load, and each column v of `held` gives v^T q =
    0. Returns q and the forces that hold, one row for each column of `held`. K is singular where
    rounding to 16 digits could have made it what it is, by the condition number that N. J. Higham,
    ACM Trans. Math. Softw. 14 (1988) 381, estimates from its factor.
    """
    # scaling to a unit diagonal makes metres and radians comparable
    diagonal = np.diag(stiffness)
    if stiffness.size and diagonal.min() <= 0.0:
        raise ModelError(_SINGULAR)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = stiffness * np.outer(scale, scale)
    try:
        factor = cho_factor(scaled, lower=True)
    except LinAlgError as error:
        raise ModelError(_SINGULAR) from error
    if stiffness.size:
        (pocon,) = get_lapack_funcs(("pocon",), factor[:1])
        reciprocal_condition, _ = pocon(factor[0], np.abs(scaled).sum(axis=0).max(), uplo="L")
        if reciprocal_condition < _CONDITION:
            raise ModelError(_SINGULAR)
    both = np.concatenate((right, held), axis=1) * scale[:, None]
    solution = cho_solve(factor, both) * scale[:, None]
    free, compliance = solution[:, : right.shape[1]], solution[:, right.shape[1] :]
    if held.shape[1] == 0:
        return free, np.zeros((0, right.shape[1]))
    holding = -np.linalg.solve(held.T @ compliance, held.T @ free)
    return free + compliance @ holding, holding


_SINGULAR = (
    "the stage can move without deforming a hinge, so its stiffness matrix is singular: fix a "
    "body, add a hinge, or run 'flexstage check' on it"
)


def generalized_modes(
    stiffness: Array, mass: Array, held: Array, count: int | None = None
) -> tuple[Array, Array]:
    """Solve K phi = omega^2 M phi, lowest first.

    K and M are symmetric, and each column v of `held` gives v^T phi = 0. Returns omega [rad/s],
    shape (k,), and shapes with phi^T M phi = 1, shape (n, k); all modes where `count` is None.
    """
    basis = null_space(held.T) if held.shape[1] else None
    if basis is not None:
        stiffness, mass = basis.T @ stiffness @ basis, basis.T @ mass @ basis
    n = stiffness.shape[0]
    last = n if count is None else min(count, n)
    if last == 0:
        return np.zeros(0), np.zeros((held.shape[0], 0))
    values, vectors = _softest_modes(stiffness, mass)
    omega = np.sqrt(np.clip(values[:last], 0.0, None))
    shapes = vectors[:, :last]
    return omega, shapes if basis is None else basis @ shapes


def _softest_modes(stiffness: Array, mass: Array) -> tuple[Array, Array]:
    """All eigenvalues of K against M and shapes, the lowest as exact as rounding lets them be.

    A solver errs by rounding of the largest eigenvalue that it finds: of M against K that is the
    softest mode, of K against M the stiffest, which may be 1e8 times as high. Only a stage that is
    held allows the first.
    """
    try:
        # the divide-and-conquer driver is the fast one, and a subset costs more than all of a few
        inverse, vectors = eigh(mass, stiffness, driver="gvd", check_finite=False)
        if inverse[0] > 0.0:
            values = 1.0 / inverse[::-1]
            return values, vectors[:, ::-1] * np.sqrt(values)
    except LinAlgError:
        pass  # a stage that can move without deforming anything
    try:
        return eigh(stiffness, mass, driver="gvd", check_finite=False)
    except LinAlgError as error:
        raise ModelError("a body has no mass, so the stage has no natural frequencies") from error
