"""Which poles may be modes: candidates that are apart, and those that the residual shows."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array, Complex
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.projection import Block, eliminate, gram_of, minimise
from flexstage.experiment.modal.significance import (
    LEAST_DAMPING,
    MOST_DAMPING,
    rising,
    rounding_level,
    significances,
    threshold,
)

# damping that a peak of the residual is tried with
_PEAK_DAMPING = 0.005
# how many candidates are tried before it is believed that there is no other mode
_TRIALS = 3


def distinct(poles: Complex, rank: Array) -> Complex:
    """Leave out poles that are too close to a better one to be another mode.

    Those that are left are half of their decay rate apart at least, and rise in frequency.
    """
    kept: list[complex] = []
    for n in np.argsort(-rank, kind="stable"):
        pole = complex(poles[n])
        if all(abs(pole - k) > 0.5 * max(-pole.real, -k.real) for k in kept):
            kept.append(pole)
    return np.array(sorted(kept, key=abs), dtype=np.complex128)


def extended(
    basis: ModalBasis,
    theta: Array,
    blocks: Sequence[Block],
    candidates: Complex,
    count: int | None,
) -> tuple[ModalBasis, Array]:
    """Add modes that no stable pole led to, as of two close modes that looked like one.

    `count` is how many there are to be; None adds all that are significant.
    """
    while count is None or basis.count < count:
        own = basis.poles(theta)[:, 0]
        every = np.concatenate([candidates, _halves(own), _peaks(basis, theta, blocks)])
        every = every[_apart(every, own)]
        if not every.size:
            break
        falls, level = _falls(basis, theta, blocks, every)
        needed = threshold(basis, blocks)
        best = np.argsort(-falls, kind="stable")
        best = best[: _TRIALS if count is None else 4 * _TRIALS]
        if count is None:
            best = best[falls[best] > 0.25 * needed * level]
        more = _added(basis, theta, blocks, every[best], needed if count is None else 0.0)
        if more is None:
            break
        basis, theta = more
    return basis, rising(theta)


def _added(
    basis: ModalBasis, theta: Array, blocks: Sequence[Block], poles: Complex, needed: float
) -> tuple[ModalBasis, Array] | None:
    """Return the model with the first of some poles that is a mode beside the others."""
    from dataclasses import replace

    more = replace(basis, count=basis.count + 1)
    for pole in poles:
        single = replace(basis, count=1).start(np.array([pole]))
        trial = minimise(more, np.concatenate([theta, single]), blocks, rough=True)[0]
        zeta = trial[1::2]
        if (
            np.all((zeta > LEAST_DAMPING) & (zeta < MOST_DAMPING))
            and significances(more, trial, blocks).min() > needed
        ):
            return more, trial
    return None


def _halves(poles: Complex) -> Complex:
    """Where the two modes may be that a pole stands for."""
    aside = 0.8 * poles.real * 1j
    return np.concatenate([poles + aside, poles - aside])


def _apart(candidates: Complex, poles: Complex) -> NDArray[np.bool_]:
    near = np.abs(candidates[:, None] - poles[None, :]) < 0.2 * np.abs(poles.real)[None, :]
    return ~near.any(axis=1) & (candidates.imag > 0.0)


def _peaks(basis: ModalBasis, theta: Array, blocks: Sequence[Block]) -> Complex:
    """Poles at the frequencies where the residual is largest over some lines."""
    found = []
    for block in blocks:
        now = eliminate(basis, theta, block)
        power = np.sum(now.square * np.abs(now.residual) ** 2, axis=1)
        omega = block.s.imag * basis.reference
        for width in (1, 5, 25):
            if 4 * width > power.size:
                break
            # noise shared by many lines stands out less than the motion they share
            mean = np.convolve(power, np.full(width, 1.0 / width), "same")
            top = omega[int(np.argmax(mean))]
            spacing = float(omega[-1] - omega[0]) / (omega.size - 1)
            found.append(complex(-max(width * spacing, _PEAK_DAMPING * top), top))
    return np.array(found, dtype=np.complex128)


def _falls(
    basis: ModalBasis, theta: Array, blocks: Sequence[Block], candidates: Complex
) -> tuple[Array, float]:
    """By how much each pole would lower the sum of squares, and the mean square of noise."""
    from dataclasses import replace

    one = replace(basis, count=1, residuals=False)
    falls = np.zeros(candidates.size)
    total, values = 0.0, 0
    for block in blocks:
        now = eliminate(basis, theta, block)
        total += now.total
        values += 2 * now.residual.size - basis.linear * now.residual.shape[1]
        weighted = now.square * now.residual
        square = now.square[:, : now.inverse.shape[0]]
        for n, pole in enumerate(candidates):
            pair = one.functions(one.start(np.array([pole])), block.s)
            right = (pair.conj().T @ weighted).real.T[:, :, None]
            cross = gram_of(now.functions, pair, square)
            own = gram_of(pair, pair, square)
            left = own - cross.transpose(0, 2, 1) @ now.inverse @ cross
            # a candidate like one that is there has nothing of its own
            lifted = left + 1e-9 * own * np.eye(own.shape[1])
            falls[n] += float(np.sum(right * np.linalg.solve(lifted, right)))
    return falls, max(total / max(values - basis.size, 1), rounding_level(blocks))
