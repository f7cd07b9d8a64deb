"""Finding the modes in responses: candidates, how many, and weights where none are given."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.errors import ModelError
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.prepare import Prepared, reweighted
from flexstage.experiment.modal.projection import eliminate, minimise, remaining
from flexstage.experiment.modal.pruning import cleaned, nearest_pole, pruned, selected
from flexstage.experiment.modal.scatter import local_poles
from flexstage.experiment.modal.selection import distinct, extended
from flexstage.experiment.modal.stabilisation import Stabilisation, stabilised

# a pole that a window shows ranks with one that half of the orders have where it is this much
# likelier than none
_SURE = 100.0
# damping that a guessed frequency starts from where no pole is near
_GUESSED_DAMPING = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """Modes that were found, not yet refined to the end."""

    parts: tuple[Prepared, ...]
    """The responses, with the weights that they have now."""
    stabilisation: Stabilisation
    """Where the poles come from."""
    shown: Complex
    """Poles that the search began with [rad/s], shape (p,)."""
    basis: ModalBasis
    """The model."""
    theta: Array
    """Its parameters."""


def search(
    parts: tuple[Prepared, ...],
    template: ModalBasis,
    *,
    orders: Sequence[int] | None,
    band: tuple[float, float],
    count: int | None,
    guess: Sequence[float] | None,
) -> Found:
    """Find the modes of responses.

    As many as are significant, or `count`; near each of the guesses [Hz] there is to be one,
    significant or not.
    """
    diagram, start = started(parts, orders, band)
    blocks = [part.block for part in parts]
    basis, theta = selected(template, start, blocks, count, guess or ())
    # noise in proportion to the response looks like modes until it is known, and two modes that are
    # taken for one look like such noise: so by turns
    known = count is not None or all(part.kept for part in parts)
    for _ in range(1 if known else 2):
        if not known:
            parts = _reweighted(parts, basis, theta)
        blocks = [part.block for part in parts]
        others = _others(diagram, basis.poles(theta)[:, 0])
        basis, theta = extended(basis, theta, blocks, others, count)
    if not known:
        parts = _reweighted(parts, basis, theta)
        basis, theta = pruned(basis, theta, [part.block for part in parts], None, guess or ())
    if count is None and guess is None:
        basis, theta = cleaned(basis, theta, [part.block for part in parts])
    for frequency in guess or ():
        basis, theta = _with_guess(basis, theta, parts, frequency)
    if count is not None and basis.count < count:
        raise ModelError(
            f"{count} modes were asked for but only {basis.count} found from {band[0]:g} to "
            f"{band[1]:g} Hz: ask for fewer, or guess their frequencies"
        )
    return Found(parts=parts, stabilisation=diagram, shown=start, basis=basis, theta=theta)


def settled(
    parts: tuple[Prepared, ...], basis: ModalBasis, theta: Array
) -> tuple[tuple[Prepared, ...], Array]:
    """Fit to the end; where no variance was given, weights and fit in turn."""
    turns = 1 if all(part.kept for part in parts) else 3
    for turn in range(turns):
        if basis.size:
            blocks = [part.block for part in parts]
            theta = minimise(basis, theta, blocks, rough=turn + 1 < turns)[0]
        if turn + 1 < turns:
            parts = _reweighted(parts, basis, theta)
    return parts, theta


def started(
    parts: Sequence[Prepared],
    orders: Sequence[int] | None,
    band: tuple[float, float],
) -> tuple[Stabilisation, Complex]:
    """Return poles to start from: stable ones, and those that stretches of a response show."""
    lines = [part.lines() for part in parts]
    if len({part.measured.inputs for part in parts}) > 1:
        # each input by itself, as they share no more than the poles
        lines = [
            replace(one, response=one.response[:, :, i : i + 1])
            for one in lines
            for i in range(one.response.shape[2])
        ]
    diagram = stabilised(lines, orders=orders, band=band)
    shown, gains = zip(*(local_poles(one.frequency_hz, one.response) for one in lines), strict=True)
    likelier = np.concatenate(gains)
    poles = distinct(
        np.concatenate([diagram.poles, *shown]),
        np.concatenate([diagram.persistence, likelier / (likelier + _SURE)]),
    )
    return diagram, poles


def _others(diagram: Stabilisation, poles: Complex) -> Complex:
    """Poles of some orders, stable or not, that are not among those given."""
    last = len(diagram.orders) - 1
    chosen = [diagram.orders[last * n // 6].poles for n in (6, 4, 3, 2)]
    every = np.concatenate([poles, *chosen])
    # rank by turn: the given ones first, then those of high orders
    apart = distinct(every, -np.arange(float(every.size)))
    return apart[~np.isin(apart, poles)]


def _with_guess(
    basis: ModalBasis, theta: Array, parts: Sequence[Prepared], frequency: float
) -> tuple[ModalBasis, Array]:
    """Return the model with a mode near a frequency, where it has none yet."""
    omega = 2.0 * math.pi * frequency
    if nearest_pole(basis, theta, frequency) is not None:
        return basis, theta
    start = omega * complex(-_GUESSED_DAMPING, math.sqrt(1.0 - _GUESSED_DAMPING**2))
    single = replace(basis, count=1).start(np.array([start]))
    more = replace(basis, count=basis.count + 1)
    blocks = [part.block for part in parts]
    return more, minimise(more, np.concatenate([theta, single]), blocks, rough=True)[0]


def _reweighted(
    parts: tuple[Prepared, ...], basis: ModalBasis, theta: Array
) -> tuple[Prepared, ...]:
    return tuple(part if part.kept else _weighted(part, basis, theta) for part in parts)


def _weighted(part: Prepared, basis: ModalBasis, theta: Array) -> Prepared:
    block, shape = part.block, part.measured.response.shape
    now = eliminate(basis, theta, block)
    motion = (block.s * basis.reference)[:, None] ** np.array(part.powers)[None, :]
    values = (now.functions @ now.factors).reshape(shape) * motion[:, :, None]
    left = remaining(basis, theta, block, now).reshape(shape)
    return reweighted(part, values, left, basis.reference)
