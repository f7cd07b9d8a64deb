"""The softest modes of a body or of a stage, by block Lanczos iteration."""

from collections.abc import Callable

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ConvergenceError

_STEPS = 60
_DEPENDENT = 1e-13  # mass that rounding leaves of displacements that others make up


def softest_modes(
    respond: Callable[[Array], Array],
    mass_times: Callable[[Array], Array],
    start: Array,
    count: int,
    settled: float,
) -> tuple[Array, Array]:
    r"""Return the lowest modes of an elastic part.

    Parameters
    ----------
    respond : callable
        Returns the displacements under loads, one a column.
    mass_times : callable
        Multiplies displacements by the mass matrix.
    start : Array
        Loads to begin with, shape (n, b), which excite all modes that are wanted.
    count : int
        Number of modes.
    settled : float
        By how much the squares of frequencies may change in the last step, in parts of them. They
        are off by less than a tenth of it then, as a rule.

    Returns
    -------
    tuple
        Squares of angular frequencies [rad^2/s^2], shape (count,), and modes with these as modal
        stiffness, shape (n, count).

    Raises
    ------
    ConvergenceError
        They are not found in 60 steps.

    Notes
    -----
    G. H. Golub, R. Underwood, in Mathematical Software III (1977) 361. Each block is made
    orthogonal to all before it, so that no mode comes twice.
    """
    basis: list[Array] = []
    weighted: list[Array] = []
    answers: list[Array] = []
    flexible = np.zeros((0, 0))
    last = np.zeros(count)
    block = respond(start)
    heavy = mass_times(block)
    for _ in range(_STEPS):
        for _ in range(2):
            for earlier, its in zip(basis, weighted, strict=True):
                share = its.T @ block
                block = block - earlier @ share
                heavy = heavy - its @ share
            mix = independent(block.T @ heavy)
            block, heavy = block @ mix, heavy @ mix
        answer = respond(heavy)
        basis.append(block)
        weighted.append(heavy)
        answers.append(answer)
        # K answers = weighted + P^T lambda, and P answers = 0, where interfaces P are held
        new = np.concatenate([w.T @ answer for w in weighted])
        at = len(flexible)
        flexible = np.block([[flexible, new[:at]], [new[:at].T, new[at:]]])
        flexible = 0.5 * (flexible + flexible.T)
        if len(flexible) >= count:
            found = 1.0 / np.linalg.eigvalsh(flexible)[: -count - 1 : -1]
            if np.all(np.abs(found - last) <= settled * found):
                values, turn = np.linalg.eigh(flexible)
                values, turn = values[: -count - 1 : -1], turn[:, : -count - 1 : -1]
                # by one more iteration than the basis, these are orthogonal in K
                return 1.0 / values, np.hstack(answers) @ (turn / values)
            last = found
        block, heavy = answer, mass_times(answer)
    raise ConvergenceError(f"the {count} lowest modes were not found in {_STEPS} steps")


def independent(mass: Array) -> Array:
    """Return combinations of displacements with unit mass; dependent ones are left out."""
    size = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(0.5 * (mass + mass.T) * np.outer(size, size))
    kept = values > _DEPENDENT * values.max(initial=0.0)
    return size[:, None] * vectors[:, kept] / np.sqrt(values[kept])
