"""Taking away poles that the data can spare."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array, Complex
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.projection import (
    Block,
    Eliminated,
    deviations_of,
    eliminate,
    minimise,
)
from flexstage.experiment.modal.significance import (
    LEAST_DAMPING,
    MOST_DAMPING,
    noise_level,
    rising,
    rounding_level,
    significances,
    threshold,
    without,
)

# how far from a guess a pole may be to be the one that is meant
_NEAR = 0.05
# half-power widths within which one pole may stand for two, and how many such are tried
_SIDE, _TRIALS = 3.0, 3
# a pole that is not known to this share of its frequency is nowhere
_NOWHERE = 0.3
# damping below which a pole makes a peak, and correlation of residues that tells no two modes apart
_PEAKED, _ALIKE = 0.5**0.5, 0.9
# so many poles are refined together before any is taken away; of more, the weakest go first
_REFINED = 30


def selected(
    template: ModalBasis,
    poles: Complex,
    blocks: Sequence[Block],
    count: int | None,
    guess: Sequence[float] = (),
) -> tuple[ModalBasis, Array]:
    """Refine poles, and take away one by one those that the data can spare.

    At most `count` significant modes are left; poles nearest to the guesses [Hz] stay, significant
    or not.
    """
    from dataclasses import replace

    basis = replace(template, count=poles.size)
    theta = basis.start(poles)
    if basis.count <= _REFINED:
        theta = minimise(basis, theta, blocks, rough=True)[0]
    if not guess:
        basis, theta = _thinned(basis, theta, blocks)
    return pruned(basis, theta, blocks, count, guess)


def pruned(
    basis: ModalBasis,
    theta: Array,
    blocks: Sequence[Block],
    count: int | None,
    guess: Sequence[float] = (),
) -> tuple[ModalBasis, Array]:
    """Refine modes, and take away one by one those that are not significant.

    As in `selected`; the model is without delay and lag.
    """
    while basis.count:
        theta = minimise(basis, theta, blocks, rough=True)[0]
        strength = significances(basis, theta, blocks)
        zeta = theta[1 : 2 * basis.count : 2]
        strength[(zeta < LEAST_DAMPING) | (zeta > MOST_DAMPING)] = -1.0
        for frequency in guess:
            place = nearest_pole(basis, theta, frequency)
            if place is not None:
                strength[place] = math.inf
        weakest = int(np.argmin(strength))
        if strength[weakest] <= threshold(basis, blocks) or (
            count is not None and basis.count > count
        ):
            basis, theta = without(basis, theta, [weakest])
            continue
        fewer = _spared(basis, theta, blocks, strength)
        if fewer is None:
            break
        basis, theta = fewer
    return basis, rising(theta)


def _spared(
    basis: ModalBasis, theta: Array, blocks: Sequence[Block], strength: Array
) -> tuple[ModalBasis, Array] | None:
    """Return the model without a pole whose part one beside it can take, where one can."""
    poles = basis.poles(theta)[:, 0]
    width = -poles.real
    apart = np.abs(poles.imag[:, None] - poles.imag[None, :])
    near = apart < _SIDE * np.maximum(width[:, None], width[None, :])
    np.fill_diagonal(near, False)
    close = [int(n) for n in np.argsort(strength) if near[n].any() and np.isfinite(strength[n])]
    found = [eliminate(basis, theta, block) for block in blocks]
    total = sum(now.total for now in found)
    allowed = total + threshold(basis, blocks) * noise_level(basis, blocks, found)
    for n in close[:_TRIALS]:
        fewer, start = without(basis, theta, [n])
        trial, value = minimise(fewer, start, blocks, rough=True)
        if value <= allowed:
            return fewer, trial
    return None


def nearest_pole(basis: ModalBasis, theta: Array, frequency: float) -> int | None:
    """Return the number of the pole that a guessed frequency means.

    None where no pole with a peak is near.
    """
    w, zeta = theta[: 2 * basis.count].reshape(-1, 2).T
    off = np.abs(basis.reference * w / (2.0 * math.pi * frequency) - 1.0)
    off = np.where(zeta < _PEAKED, off, math.inf)
    if not off.size or off.min() > _NEAR:
        return None
    return int(np.argmin(off))


def cleaned(basis: ModalBasis, theta: Array, blocks: Sequence[Block]) -> tuple[ModalBasis, Array]:
    """Take away poles that are nowhere, or that only mend a stronger one which they stand on.

    Others stay, significant or not without those: what a model lacks counts as noise.
    """
    while basis.count:
        strength = significances(basis, theta, blocks)
        needless = np.flatnonzero(_needless(basis, theta, blocks, strength))
        if not needless.size:
            break
        weakest = int(needless[np.argmin(strength[needless])])
        basis, theta = without(basis, theta, [weakest])
        theta = minimise(basis, theta, blocks, rough=True)[0]
    return basis, theta


def _needless(
    basis: ModalBasis, theta: Array, blocks: Sequence[Block], strength: Array
) -> NDArray[np.bool_]:
    w, zeta = theta[: 2 * basis.count].reshape(-1, 2).T
    now = [eliminate(basis, theta, block) for block in blocks]
    values = sum(2 * block.values.size for block in blocks)
    level = max(sum(one.total for one in now) / max(values - basis.size, 1), rounding_level(blocks))
    deviation = deviations_of(basis, theta, blocks)[: 2 * basis.count : 2]
    out = (math.sqrt(level) * deviation > _NOWHERE * w) | (zeta <= 0.0) | (zeta > MOST_DAMPING)
    poles = basis.poles(theta)[:, 0]
    for a, b in itertools.permutations(np.flatnonzero(zeta < _PEAKED), 2):
        half = -0.5 * (poles[a] + poles[b]).real
        if strength[a] < strength[b] and abs(poles[a].imag - poles[b].imag) < half:
            first, second = (_residues(basis, theta, now, int(n)) for n in (a, b))
            size = np.vdot(first, first).real * np.vdot(second, second).real
            out[a] |= bool(abs(np.vdot(first, second)) ** 2 > _ALIKE * size)
    return out


def _residues(basis: ModalBasis, theta: Array, found: Sequence[Eliminated], mode: int) -> Complex:
    """Residues of a mode in all responses."""
    own = slice(basis.per_mode * mode, basis.per_mode * (mode + 1))
    weights = basis.residue_weights(theta, mode)
    return np.concatenate([(weights / now.scale[own]) @ now.factors[own] for now in found])


def _thinned(basis: ModalBasis, theta: Array, blocks: Sequence[Block]) -> tuple[ModalBasis, Array]:
    """Take away what is far from significant even before it is refined."""
    while basis.count:
        strength = significances(basis, theta, blocks)
        weak = np.flatnonzero(strength < 0.25 * threshold(basis, blocks))
        if not weak.size:
            break
        weak = weak[np.argsort(strength[weak], kind="stable")]
        basis, theta = without(basis, theta, [int(n) for n in weak[: (weak.size + 1) // 2]])
    return basis, theta
