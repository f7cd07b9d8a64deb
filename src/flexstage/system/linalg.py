"""The two linear-algebra jobs of the room, with errors that an engineer can act on."""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh, null_space

from flexstage.arrays import Array
from flexstage.errors import ModelError

# Cholesky of a singular matrix succeeds when rounding leaves a tiny positive pivot; this is that
# pivot's size relative to the stiffest one that is taken for zero.
_PIVOT = 1e-13


def solve_stiffness(stiffness: Array, right: Array, held: Array) -> tuple[Array, Array]:
    """Solve K q = f with some linear combinations of q held at zero.

    K is symmetric, f and q have one column for each load, and each column v of `held` gives v^T q =
    0. Returns q and the forces that hold, one row for each column of `held`.
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
    if stiffness.size and np.diag(factor[0]).min() ** 2 < _PIVOT:
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
    try:
        # the divide-and-conquer driver is the fast one, and a subset costs more than all of a few
        values, vectors = eigh(stiffness, mass, driver="gvd", check_finite=False)
    except LinAlgError as error:
        raise ModelError("a body has no mass, so the stage has no natural frequencies") from error
    omega = np.sqrt(np.clip(values[:last], 0.0, None))
    shapes = vectors[:, :last]
    return omega, shapes if basis is None else basis @ shapes
