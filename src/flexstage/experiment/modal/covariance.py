"""What poles and residues are worth, with noise that neighbouring lines and outputs share."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.variable_projection import Projected, ResponseBlock, project

_LAGS = 8
# a correlation of noise goes beyond this, over the root of the number of lines, once in 500 times
_SIGNIFICANT = 2.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Worth:
    """A fit at its end, with covariances."""

    covariance: Array
    """Covariance of the parameters, shape (p, p)."""
    columns: tuple[Projected, ...]
    """Each response in turn, block by block."""
    members: tuple[tuple[int, ...], ...]
    """Numbers of the responses of each block."""
    scale: float
    """Sum of squares over degrees of freedom."""
    degrees_of_freedom: int
    """Values less parameters."""
    lags: Complex
    """Correlation of the residual with that of the next lines, shape (l,)."""
    shared: tuple[Complex, ...]
    """Correlation among the responses of each block, shape (m, m)."""
    crossed: tuple[Array, ...]
    """Covariance of the parameters with the own noise of the factors of each response, shape (p,
    q).
    """

    def factors(self, number: int) -> tuple[Array, Array]:
        """Return how the factors of a response and the parameters vary together.

        The covariance of parameters and factors, shape (p + q, p + q), and the derivative of the
        factors by the parameters, shape (q, p).
        """
        column = self.columns[number]
        follow = -column.inverse.T @ column.jacobian
        own = self.scale * meat(_complex(column.inverse), _complex(column.inverse), self.lags)
        cross = self.covariance @ follow.T + self.crossed[number]
        inner = (
            own
            + follow @ self.covariance @ follow.T
            + follow @ self.crossed[number]
            + self.crossed[number].T @ follow.T
        )
        return np.block([[self.covariance, cross], [cross.T, inner]]), follow


def _complex(stacked: Array) -> Complex:
    half = stacked.shape[0] // 2
    return stacked[:half] + 1j * stacked[half:]


def meat(left: Complex, right: Complex, lags: Complex) -> Array:
    """Return Re(left^H R right), where R holds the correlations of lines.

    `left` and `right` are influences of each line, shapes (k, a) and (k, b); `lags` its correlation
    with the next lines.
    """
    total = left.conj().T @ right
    for lag, rho in enumerate(lags, start=1):
        total = total + rho * (left[:-lag].conj().T @ right[lag:])
        total = total + rho.conjugate() * (left[lag:].conj().T @ right[:-lag])
    return total.real


def assess(basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]) -> Worth:
    """Find the covariance of a fit from its Jacobian and its residual.

    Were the errors of all lines and responses independent, it would be s^2 (J^T J)^-1. Where the
    residual shows that they are not, as after a window or with a noisy input, their correlation is
    put between: (J^T J)^-1 J^T C J (J^T J)^-1.
    """
    columns: list[Projected] = []
    members: list[tuple[int, ...]] = []
    for block in blocks:
        first = len(columns)
        columns += [project(basis, theta, block, c) for c in range(block.values.shape[1])]
        members.append(tuple(range(first, len(columns))))
    counted = 2 * sum(int(np.count_nonzero(block.weights)) for block in blocks)
    free = max(counted - basis.size - basis.linear * len(columns), 1)
    scale = sum(float(c.residual @ c.residual) for c in columns) / free
    noise = [np.stack([_complex(columns[i].residual) for i in own], axis=1) for own in members]
    lags = _line_correlation(noise)
    shared = tuple(_shared(part) for part in noise)
    square = sum((c.orthogonal.T @ c.orthogonal for c in columns), np.zeros((basis.size,) * 2))
    # without poles there is nothing to invert
    inverse = np.linalg.pinv(square, hermitian=True) if basis.size else square
    middle = np.zeros_like(square)
    crossed: list[Array] = []
    for own, together in zip(members, shared, strict=True):
        slopes = np.stack([_complex(columns[i].orthogonal) for i in own])
        # J_b^H C_ba X_a summed over b
        mixed = (together.T.conj() @ slopes.reshape(len(own), -1)).reshape(slopes.shape)
        for i, slope, mix in zip(own, slopes, mixed, strict=True):
            middle += meat(mix, slope, lags)
            crossed.append(scale * inverse @ meat(mix, _complex(columns[i].inverse), lags))
    middle = 0.5 * (middle + middle.T)
    return Worth(
        covariance=scale * inverse @ middle @ inverse,
        columns=tuple(columns),
        members=tuple(members),
        scale=scale,
        degrees_of_freedom=free,
        lags=lags,
        shared=shared,
        crossed=tuple(crossed),
    )


def _line_correlation(noise: Sequence[Complex]) -> Complex:
    """Correlation of the residual with itself some lines on, as far as it stands out."""
    power = sum(float(np.sum(np.abs(part) ** 2)) for part in noise)
    size = sum(part.size for part in noise)
    found = np.zeros(_LAGS, dtype=np.complex128)
    if power == 0.0:
        return found[:0]
    for lag in range(1, _LAGS + 1):
        found[lag - 1] = sum(np.sum(part[:-lag] * part[lag:].conj()) for part in noise) / power
    out = np.abs(found) * math.sqrt(size) > _SIGNIFICANT
    if not out[0]:
        return found[:0]
    # up to the first that does not stand out
    found = found[: int(np.argmin(out)) if not out.all() else _LAGS]
    # neighbours that cancel leave so little that their correlation is not known well enough for it
    return found if found.real.sum() > 0.0 else found[:0]


def _shared(noise: Complex) -> Complex:
    """Correlation of the residuals of responses that were measured together."""
    lines, count = noise.shape
    size = np.sqrt(np.sum(np.abs(noise) ** 2, axis=0))
    if count == 1 or np.any(size == 0.0):
        return np.eye(count, dtype=np.complex128)
    unit = noise / size
    together = unit.T @ unit.conj()
    others = np.abs(together - np.diag(np.diagonal(together)))
    pairs = 0.5 * count * (count - 1)
    # the largest of that many correlations by chance
    if others.max() * math.sqrt(lines) < math.sqrt(math.log(pairs) + _SIGNIFICANT**2):
        return np.eye(count, dtype=np.complex128)
    return together
