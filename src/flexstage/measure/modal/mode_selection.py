"""Which poles are modes: significance, poles that the data can spare, and modes that they lack."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array, Complex
from flexstage.measure.modal.variable_projection import (
    Eliminated,
    ModalBasis,
    ResponseBlock,
    deviations_of,
    eliminate,
    gram_of,
    minimise,
)

# how many candidates are tried before it is believed that there is no other mode
_CANDIDATES = 3
#: Damping of what may pass for a pole.
LEAST_DAMPING, MOST_DAMPING = 1e-7, 9.0
# half-power widths within which one pole may stand for two, and how many such are tried
_SIDE, _TRIALS = 3.0, 3
# damping below which a pole makes a peak, and correlation of residues that tells no two modes apart
_PEAKED, _CORRELATION = 0.5**0.5, 0.9
# a pole next to the requested ones is included if it halves the residual, and on the peak of one of
# those only if it is wider by this factor
_EARNED, _BROAD = 1.0, 10.0
# of more poles than the first, those are refined that a change is near to, so many; and lines that
# each of their factors is to have
_MANY, _NEIGHBOURS, _LINES = 16, 8, 6
# so many poles are refined together before any is taken away; of more, the weakest go first
_REFINED = 30


def significances(basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]) -> Array:
    """Return by how much each mode lowers the sum of squares, over the mean square of noise.

    With the poles of the others as they are, shape (count,).
    """
    falls = np.zeros(basis.count)
    eliminated = [eliminate(basis, theta, block) for block in blocks]
    for now in eliminated:
        for r in range(basis.count):
            columns = slice(basis.per_mode * r, basis.per_mode * (r + 1))
            factors = now.factors[columns].T[:, :, None]
            falls[r] += float(
                np.sum(factors * np.linalg.solve(now.inverse[:, columns, columns], factors))
            )
    return falls / noise_level(basis, blocks, eliminated)


def noise_level(
    basis: ModalBasis, blocks: Sequence[ResponseBlock], eliminated: Sequence[Eliminated]
) -> float:
    """Return the mean square of noise, times by how much more it may look like a mode."""
    total, lagged, counted = 0.0, 0.0, 0
    for block, now in zip(blocks, eliminated, strict=True):
        noise = now.residual * block.weights
        total += now.total
        lagged += float(np.sum(noise[:-1] * noise[1:].conj()).real)
        counted += 2 * noise.size - basis.linear * noise.shape[1]
    level = max(total / max(counted - basis.size, 1), rounding_level(blocks))
    # noise that neighbouring lines share forms peaks as wide as they are
    return level * (1.0 + 2.0 * max(lagged / max(total, 1e-300), 0.0))


def threshold(basis: ModalBasis, blocks: Sequence[ResponseBlock]) -> float:
    """Return the fall of the sum of squares that a mode must make.

    Number of parameters times logarithm of the number of values (Schwarz 1978), and twice the
    logarithm of the number of lines, as the place of a mode is the best of so many. The fall is
    over the mean square of noise.
    """
    values = sum(2 * block.values.size for block in blocks)
    lines = sum(block.values.shape[0] for block in blocks)
    columns = sum(block.values.shape[1] for block in blocks)
    return (basis.per_mode * columns + 2) * math.log(values) + 2.0 * math.log(lines)


def rounding_level(blocks: Sequence[ResponseBlock]) -> float:
    """Return the least mean square of noise that is believed: a smaller one is the computer's."""
    power = [np.sum((block.weights * np.abs(block.values)) ** 2) for block in blocks]
    # what noise is of the response, at least, in anything measured
    dynamic_range = 1e-8
    return float(dynamic_range**2 * sum(power) / sum(2 * block.values.size for block in blocks))


def without(basis: ModalBasis, theta: Array, modes: Sequence[int]) -> tuple[ModalBasis, Array]:
    """Leave modes out of a model."""
    gone = [2 * m + d for m in modes for d in (0, 1)]
    return replace(basis, count=basis.count - len(modes)), np.delete(theta, gone)


def rising(theta: Array) -> Array:
    """Return frequencies and damping ratios of modes, in turn, in the order of the frequencies."""
    pairs = theta.reshape(-1, 2)
    return pairs[np.argsort(pairs[:, 0], kind="stable")].ravel()


def selected(
    template: ModalBasis,
    poles: Complex,
    blocks: Sequence[ResponseBlock],
    count: int | None,
    guess: Sequence[float] = (),
) -> tuple[ModalBasis, Array]:
    """Refine poles, and take away one by one those that the data can spare.

    At most `count` significant modes are left; poles nearest to the guesses [Hz] stay, significant
    or not.
    """
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
    blocks: Sequence[ResponseBlock],
    count: int | None,
    guess: Sequence[float] = (),
) -> tuple[ModalBasis, Array]:
    """Refine modes, and take away one by one those that are not significant.

    As in `selected`; the model is without delay and lag.
    """
    changed = math.nan
    while basis.count:
        theta = refined(basis, theta, blocks, changed)[0]
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
            changed = theta[2 * weakest]
            basis, theta = without(basis, theta, [weakest])
            continue
        if basis.count > _MANY and not math.isnan(changed):
            # what was not refined with the others looks like noise, which hides what is needed
            changed = math.nan
            continue
        fewer = _spared(basis, theta, blocks, strength)
        if fewer is None:
            break
        basis, theta, changed = fewer
    return basis, rising(theta)


def refined(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], changed: float
) -> tuple[Array, float]:
    """Refine modes; of many, those about a frequency at which the model has changed.

    The frequency is over the reference, and not a number where all are refined. Returned are the
    parameters and the sum of squares.
    """
    if basis.count <= _MANY or math.isnan(changed):
        return minimise(basis, theta, blocks, rough=True)
    pairs = theta.reshape(-1, 2).copy()
    off = np.abs(pairs[:, 0] - changed)
    near = np.argsort(off, kind="stable")[:_NEIGHBOURS]
    # a pole at the end of the lines would be determined by half of its peak
    reach = np.sort(off)[min(2 * _NEIGHBOURS, off.size - 1)]
    few = replace(basis, count=near.size)
    parts = []
    for block in blocks:
        now = eliminate(basis, theta, block)
        factors = now.factors.copy()
        columns = basis.per_mode * near[:, None] + np.arange(basis.per_mode)
        factors[columns.ravel()] = 0.0
        factors[basis.per_mode * basis.count :] = 0.0
        away = np.abs(block.s.imag - changed)
        lines = np.argsort(away, kind="stable")
        lines = np.sort(lines[: max(int(np.sum(away < reach)), _LINES * few.linear)])
        values = block.values[lines] - now.functions[lines] @ factors
        parts.append(ResponseBlock(s=block.s[lines], values=values, weights=block.weights[lines]))
    pairs[near] = minimise(few, pairs[near].ravel(), parts, rough=True)[0].reshape(-1, 2)
    theta = pairs.ravel()
    return theta, sum(eliminate(basis, theta, block).total for block in blocks)


def _spared(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], strength: Array
) -> tuple[ModalBasis, Array, float] | None:
    """Return the model without a pole that a neighbour can replace, and the place of that pole."""
    poles = basis.poles(theta)[:, 0]
    width = -poles.real
    apart = np.abs(poles.imag[:, None] - poles.imag[None, :])
    near = apart < _SIDE * np.maximum(width[:, None], width[None, :])
    np.fill_diagonal(near, False)
    close = [int(n) for n in np.argsort(strength) if near[n].any() and np.isfinite(strength[n])]
    eliminated = [eliminate(basis, theta, block) for block in blocks]
    total = sum(now.total for now in eliminated)
    allowed = total + threshold(basis, blocks) * noise_level(basis, blocks, eliminated)
    for n in close[:_TRIALS]:
        fewer, start = without(basis, theta, [n])
        trial, value = refined(fewer, start, blocks, theta[2 * n])
        if value <= allowed:
            return fewer, trial, theta[2 * n]
    return None


def nearest_pole(basis: ModalBasis, theta: Array, frequency: float) -> int | None:
    """Return the number of the pole that a guessed frequency means.

    None where no pole with a peak is near.
    """
    w, zeta = theta[: 2 * basis.count].reshape(-1, 2).T
    off = np.abs(basis.reference * w / (2.0 * math.pi * frequency) - 1.0)
    off = np.where(zeta < _PEAKED, off, math.inf)
    # how far from a guess a pole may be to be the one that is meant
    near_guess = 0.05
    if not off.size or off.min() > near_guess:
        return None
    return int(np.argmin(off))


def cleaned(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]
) -> tuple[ModalBasis, Array]:
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


def asked_for(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], guess: Sequence[float]
) -> tuple[ModalBasis, Array]:
    """Leave the poles that guesses [Hz] mean, and others that explain half of what those leave.

    That a pole is significant is not enough for it: in a response with little noise whatever the
    model lacks is, and a pole that stands on the peak of another takes a part of its damping.
    """
    places = [nearest_pole(basis, theta, frequency) for frequency in guess]
    distinct_places = list(dict.fromkeys(place for place in places if place is not None))
    order = [*distinct_places, *(n for n in range(basis.count) if n not in distinct_places)]
    theta = theta.reshape(-1, 2)[order].ravel()
    while True:
        theta = minimise(basis, theta, blocks, rough=True)[0]
        if basis.count == len(distinct_places):
            return basis, rising(theta)
        poles = basis.poles(theta)[:, 0]
        width, place = -poles.real, poles.imag
        eliminated = [eliminate(basis, theta, block) for block in blocks]
        total = sum(now.total for now in eliminated)
        earned = (
            significances(basis, theta, blocks) * noise_level(basis, blocks, eliminated) / total
        )
        for n in range(len(distinct_places), basis.count):
            wide = np.maximum(width[n], width[: len(distinct_places)])
            shared = np.abs(place[n] - place[: len(distinct_places)]) < _SIDE * wide
            if np.any(shared & (width[n] < _BROAD * width[: len(distinct_places)])):
                earned[n] = 0.0
        weakest = len(distinct_places) + int(np.argmin(earned[len(distinct_places) :]))
        if earned[weakest] > _EARNED:
            return basis, rising(theta)
        basis, theta = without(basis, theta, [weakest])


def _needless(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], strength: Array
) -> NDArray[np.bool_]:
    w, zeta = theta[: 2 * basis.count].reshape(-1, 2).T
    now = [eliminate(basis, theta, block) for block in blocks]
    values = sum(2 * block.values.size for block in blocks)
    level = max(sum(one.total for one in now) / max(values - basis.size, 1), rounding_level(blocks))
    deviation = deviations_of(basis, theta, blocks)[: 2 * basis.count : 2]
    # a pole that is not known to this share of its frequency is nowhere
    nowhere = 0.3
    out = (math.sqrt(level) * deviation > nowhere * w) | (zeta <= 0.0) | (zeta > MOST_DAMPING)
    poles = basis.poles(theta)[:, 0]
    for a, b in itertools.permutations(np.flatnonzero(zeta < _PEAKED), 2):
        half = -0.5 * (poles[a] + poles[b]).real
        if strength[a] < strength[b] and abs(poles[a].imag - poles[b].imag) < half:
            first, second = (_residues(basis, theta, now, int(n)) for n in (a, b))
            size = np.vdot(first, first).real * np.vdot(second, second).real
            out[a] |= bool(abs(np.vdot(first, second)) ** 2 > _CORRELATION * size)
    return out


def _residues(
    basis: ModalBasis, theta: Array, eliminated: Sequence[Eliminated], mode: int
) -> Complex:
    """Residues of a mode in all responses."""
    columns = slice(basis.per_mode * mode, basis.per_mode * (mode + 1))
    weights = basis.residue_weights(theta, mode)
    return np.concatenate(
        [(weights / now.scale[columns]) @ now.factors[columns] for now in eliminated]
    )


def _thinned(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]
) -> tuple[ModalBasis, Array]:
    """Take away what is far from significant even before it is refined."""
    while basis.count:
        strength = significances(basis, theta, blocks)
        weak = np.flatnonzero(strength < 0.25 * threshold(basis, blocks))
        if not weak.size:
            break
        weak = weak[np.argsort(strength[weak], kind="stable")]
        basis, theta = without(basis, theta, [int(n) for n in weak[: (weak.size + 1) // 2]])
    return basis, theta


def distinct(poles: Complex, rank: Array) -> Complex:
    """Leave out poles that are too close to a better one to be another mode.

    Those that are left are half of their decay rate apart at least, and rise in frequency.
    """
    retained: list[complex] = []
    for n in np.argsort(-rank, kind="stable"):
        pole = complex(poles[n])
        if all(abs(pole - k) > 0.5 * max(-pole.real, -k.real) for k in retained):
            retained.append(pole)
    return np.array(sorted(retained, key=abs), dtype=np.complex128)


def extended(
    basis: ModalBasis,
    theta: Array,
    blocks: Sequence[ResponseBlock],
    candidates: Complex,
    count: int | None,
) -> tuple[ModalBasis, Array]:
    """Add modes that no stable pole led to, as of two close modes that looked like one.

    `count` is how many there are to be; None adds all that are significant.
    """
    while count is None or basis.count < count:
        poles_now = basis.poles(theta)[:, 0]
        every = np.concatenate([candidates, _halves(poles_now), _peaks(basis, theta, blocks)])
        every = every[_apart(every, poles_now)]
        if not every.size:
            break
        falls, level = _falls(basis, theta, blocks, every)
        needed = threshold(basis, blocks)
        best = np.argsort(-falls, kind="stable")
        best = best[: _CANDIDATES if count is None else 4 * _CANDIDATES]
        if count is None:
            best = best[falls[best] > 0.25 * needed * level]
        more = _added(basis, theta, blocks, every[best], needed if count is None else 0.0)
        if more is None:
            break
        basis, theta = more
    return basis, rising(theta)


def _added(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], poles: Complex, needed: float
) -> tuple[ModalBasis, Array] | None:
    """Return the model with the first of some poles that is a further mode."""
    more = replace(basis, count=basis.count + 1)
    for pole in poles:
        single = replace(basis, count=1).start(np.array([pole]))
        trial = refined(more, np.concatenate([theta, single]), blocks, single[0])[0]
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


def _peaks(basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]) -> Complex:
    """Poles at the frequencies where the residual is largest over some lines."""
    peaks = []
    # damping that a peak of the residual is tried with
    peak_damping = 0.005
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
            peaks.append(complex(-max(width * spacing, peak_damping * top), top))
    return np.array(peaks, dtype=np.complex128)


def _falls(
    basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock], candidates: Complex
) -> tuple[Array, float]:
    """By how much each pole would lower the sum of squares, and the mean square of noise."""
    every = replace(basis, count=candidates.size, residuals=False)
    falls = np.zeros(candidates.size)
    total, values = 0.0, 0
    for block in blocks:
        now = eliminate(basis, theta, block)
        total += now.total
        values += 2 * now.residual.size - basis.linear * now.residual.shape[1]
        square = now.square[:, : now.inverse.shape[0]]
        pairs = every.functions(every.start(candidates), block.s)
        right = (pairs.conj().T @ (now.square * now.residual)).real.T[:, :, None]
        crossed, owned = gram_of(now.functions, pairs, square), gram_of(pairs, pairs, square)
        for n in range(candidates.size):
            pair = slice(basis.per_mode * n, basis.per_mode * (n + 1))
            cross, self_term = crossed[:, :, pair], owned[:, pair, pair]
            left = self_term - cross.transpose(0, 2, 1) @ now.inverse @ cross
            # a candidate like one that is there has nothing of its own
            lifted = left + 1e-9 * self_term * np.eye(self_term.shape[1])
            falls[n] += float(np.sum(right[:, pair] * np.linalg.solve(lifted, right[:, pair])))
    return falls, max(total / max(values - basis.size, 1), rounding_level(blocks))
