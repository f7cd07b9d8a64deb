"""Mode shapes: taken from residues, and compared."""

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Complex
from flexstage.errors import ModelError


def modal_assurance(first: ArrayLike, second: ArrayLike) -> Array:
    """Return the modal assurance criterion of each shape with each.

    ``MAC = |a^H b|^2 / (a^H a b^H b)`` (Allemang and Brown, 1982, IMAC I): 1 where two shapes
    differ by a factor alone, 0 where they are orthogonal.

    Parameters
    ----------
    first, second : array_like
        Shapes, real or complex, shapes (outputs,) or (outputs, modes).

    Returns
    -------
    numpy.ndarray
        The criterion, shape (modes of the first, modes of the second).

    Raises
    ------
    ModelError
        The shapes do not have the same outputs, or one is zero or not finite.

    Examples
    --------
    >>> a, b = np.array([1.0, 0.4 + 0.1j]), np.array([[2j, 0.3], [0.8j - 0.2, -1.0]])
    >>> [round(float(v), 4) for v in modal_assurance(a, b)[0]]
    [1.0, 0.016]
    """
    a = np.asarray(first, dtype=np.complex128)
    b = np.asarray(second, dtype=np.complex128)
    a, b = (x[:, None] if x.ndim == 1 else x for x in (a, b))
    if a.ndim != 2 or b.ndim != 2 or a.shape[0] != b.shape[0]:
        raise ModelError(f"shapes must have the same outputs, got {a.shape} and {b.shape}")
    sizes = [np.sum(np.abs(x) ** 2, axis=0) for x in (a, b)]
    if not all(np.all(np.isfinite(s)) and np.all(s > 0.0) for s in sizes):
        raise ModelError("a mode shape must be finite and not zero to be compared")
    return np.abs(a.conj().T @ b) ** 2 / np.outer(*sizes)


def shape_from_residues(residues: Complex, covariance: Array) -> tuple[Complex, Array]:
    """Return the shape that residues have over the outputs, with its uncertainty.

    Residues of one mode are psi_o l_i. Their mean over the inputs, weighted so that each adds in
    phase, over that of the output that moves most is psi; where that product holds, it does not
    depend on the weights. Residues have shape (outputs, inputs), not a number where there is none;
    the covariance is of real and imaginary parts in turn. The uncertainty is that of real and
    imaginary part, shape (outputs, 2).
    """
    outputs, inputs = residues.shape
    known = np.isfinite(residues)
    # the inputs that all outputs answer to, else the one that most do
    use = known.all(axis=0)
    if not use.any():
        use = np.arange(inputs) == int(np.argmax(known.sum(axis=0)))
    rows = known[:, use].all(axis=1)
    part = residues[np.ix_(rows, use)]
    _, _, right = np.linalg.svd(part, full_matrices=False)
    weights = right[0].conj()
    mean = part @ weights
    largest = int(np.argmax(np.abs(mean)))
    shape = np.full(outputs, np.nan + 0.0j)
    spread = np.full((outputs, 2), np.nan)
    if mean[largest] == 0.0:
        return shape, spread
    values = mean / mean[largest]
    shape[rows] = values
    chosen, taken = np.flatnonzero(rows), np.flatnonzero(use)
    for n, o in enumerate(chosen):
        slope = np.zeros((outputs, inputs), dtype=np.complex128)
        slope[o, taken] += weights / mean[largest]
        slope[chosen[largest], taken] -= values[n] * weights / mean[largest]
        flat = slope.ravel()
        # real and imaginary part of slope times residue
        turn = np.stack([np.stack([flat.real, -flat.imag]), np.stack([flat.imag, flat.real])])
        rotated = turn.transpose(0, 2, 1).reshape(2, -1)
        spread[o] = np.sqrt(np.maximum(np.einsum("ap,pq,aq->a", rotated, covariance, rotated), 0.0))
    return shape, spread
