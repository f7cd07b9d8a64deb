"""A mesh of many thousand unknowns as a system of a few dozen coordinates."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage import progress
from flexstage.arrays import Array
from flexstage.elasticity import AttachedMass, Continuum

# what is left of a response once the others are taken out of it, below which it is rounding
_DEPENDENT = 1e-12


def project(
    continuum: Continuum,
    loads: Array,
    count: int,
    attached: Sequence[AttachedMass] = (),
) -> tuple[Array, Array, NDArray[np.bool_]]:
    r"""Project a continuum on its lowest modes and on its static responses to some loads.

    Statics under these loads are exact, and so are the modes; drives that are put in place or
    locked afterwards act through their own static responses, which is what residual attachment
    modes are for (R. H. MacNeal, Computers & Structures 1 (1971) 581; S. Rubin, AIAA J. 13 (1975)
    995).
    """
    with progress.subtask(0.0, 0.3):
        continuum.factorise()
    with progress.subtask(0.3, 0.75):
        omega, shapes = continuum.modes(count, attached=attached)
    modal_mass = _mass(continuum, attached, shapes)
    progress.update("static responses", 0.75)
    response = continuum.solve(loads)
    # take the modes out, then what the responses share
    within = modal_mass.T @ response
    rest = response - shapes @ within
    stiff_rest = _effective(continuum, loads) - modal_mass @ (omega[:, None] ** 2 * within)
    mass_rest = _mass(continuum, attached, rest)
    own = np.einsum("ij,ij->j", response, _mass(continuum, attached, response))
    left = np.einsum("ij,ij->j", rest, mass_rest)
    kept = np.flatnonzero(left > _DEPENDENT * own)
    if not kept.size:
        return omega, shapes, np.ones(count, dtype=bool)
    size = np.sqrt(left[kept])
    rest, mass_rest, stiff_rest = (a[:, kept] / size for a in (rest, mass_rest, stiff_rest))
    gram = rest.T @ mass_rest
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    good = values > _DEPENDENT * values.max()
    basis = vectors[:, good] / np.sqrt(values[good])
    stiffness = basis.T @ (rest.T @ stiff_rest) @ basis
    squares, turn = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    residual = rest @ (basis @ turn)
    all_omega = np.concatenate((omega, np.sqrt(np.clip(squares, 0.0, None))))
    is_mode = np.arange(all_omega.size) < count
    return all_omega, np.column_stack((shapes, residual)), is_mode


def _effective(continuum: Continuum, loads: Array) -> Array:
    return np.where(continuum.free[:, None], loads, 0.0)


def _mass(continuum: Continuum, attached: Sequence[AttachedMass], u: Array) -> Array:
    total = continuum.mass_times(u)
    for rider in attached:
        total = total + rider.motion.T @ (rider.inertia[:, None] * (rider.motion @ u))
    return total
