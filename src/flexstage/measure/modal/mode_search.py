"""Finding the modes in responses: candidates, how many, weights, delay and lag of the outputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.measure.modal.mode_selection import (
    asked_for,
    cleaned,
    distinct,
    extended,
    nearest_pole,
    pruned,
    selected,
    threshold,
)
from flexstage.measure.modal.prepare import Prepared, local_poles, reweighted
from flexstage.measure.modal.stabilisation import Stabilisation, WeightedLines, stabilised
from flexstage.measure.modal.variable_projection import (
    ModalBasis,
    ResponseBlock,
    eliminate,
    minimise,
    remaining,
)
from flexstage.quantities.units import readable

# delays are tried an eighth of the shortest period apart
_DELAYS = np.arange(-8, 97) / 8.0
# and closer about the one that is known
_NEAR = np.arange(-16, 17) / 16.0
# so many of these are followed
_STARTS = 2
# part of a turn that a delay must make over the band before it is spoken of, and what it must leave
# of the sum of squares
_LEAST_TURN, _FAR_BETTER = 0.1, 0.5
# and of the delays that a first look finds, so many
_LIKELY = 2
# lags, in radians of the highest frequency
_LAGS = np.array([0.0, 0.15, 0.5, 1.5, 4.0])
# share of the work that is left after each time
_PART = 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeSearch:
    """Modes of a search, before the final refinement."""

    parts: tuple[Prepared, ...]
    """The responses, with the weights that they have now."""
    stabilisation: Stabilisation
    """Where the poles come from."""
    local_poles: Complex
    """Poles that the search began with [rad/s], shape (p,)."""
    basis: ModalBasis
    """The model."""
    theta: Array
    """Its parameters."""


def search(
    parts: tuple[Prepared, ...],
    template: ModalBasis,
    *,
    band: tuple[float, float],
    count: int | None,
    guess: Sequence[float] | None,
) -> ModeSearch:
    """Find the modes of responses.

    As many as are significant, or `count`; near each of the guesses [Hz] there is to be one,
    significant or not.
    """
    progress.update("poles")
    diagram, start = started(parts, band)
    progress.update("which are modes", 0.1)
    blocks = [part.block for part in parts]
    basis, theta = selected(template, start, blocks, count, guess or ())
    # noise in proportion to the response looks like modes until it is known, and two modes that are
    # taken for one look like such noise: so by turns
    is_complete = count is not None or all(part.has_final_weights for part in parts)
    for turn in range(1 if is_complete else 2):
        progress.update("search for further modes", 0.4 + 0.2 * turn)
        if not is_complete:
            parts = _reweighted(parts, basis, theta)
        blocks = [part.block for part in parts]
        others = _others(diagram, basis.poles(theta)[:, 0])
        basis, theta = extended(basis, theta, blocks, others, count)
    progress.update("which are needed", 0.8)
    if not is_complete:
        parts = _reweighted(parts, basis, theta)
        basis, theta = pruned(basis, theta, [part.block for part in parts], None, guess or ())
    if count is None and guess is None:
        basis, theta = cleaned(basis, theta, [part.block for part in parts])
    if guess is not None:
        for frequency in guess:
            basis, theta = _with_guess(basis, theta, parts, frequency)
        basis, theta = asked_for(basis, theta, [part.block for part in parts], guess)
    if count is not None and basis.count < count:
        raise ModelError(
            f"{count} modes were requested, but only {basis.count} found from {band[0]:g} to "
            f"{band[1]:g} Hz: request fewer, or guess their frequencies"
        )
    return ModeSearch(
        parts=parts, stabilisation=diagram, local_poles=start, basis=basis, theta=theta
    )


def settled(
    parts: tuple[Prepared, ...], basis: ModalBasis, theta: Array
) -> tuple[tuple[Prepared, ...], Array]:
    """Fit to the end; where no variance was given, weights and fit in turn."""
    turns = 1 if all(part.has_final_weights for part in parts) else 3
    progress.update("fit", 0.9)
    for turn in range(turns):
        if basis.size:
            blocks = [part.block for part in parts]
            theta = minimise(basis, theta, blocks, rough=turn + 1 < turns)[0]
        if turn + 1 < turns:
            parts = _reweighted(parts, basis, theta)
    return parts, theta


def started(parts: Sequence[Prepared], band: tuple[float, float]) -> tuple[Stabilisation, Complex]:
    """Return poles to start from: stable ones, and those that stretches of a response show."""
    lines = [
        WeightedLines(
            frequency_hz=part.measured.frequency_hz,
            response=part.measured.response,
            weight=1.0 / np.mean(part.deviation**2, axis=2),
        )
        for part in parts
    ]
    if len({part.measured.inputs for part in parts}) > 1:
        # each input by itself, as they share no more than the poles
        lines = [
            replace(one, response=one.response[:, :, i : i + 1])
            for one in lines
            for i in range(one.response.shape[2])
        ]
    diagram = stabilised(lines, band=band)
    local, gains = zip(*(local_poles(one.frequency_hz, one.response) for one in lines), strict=True)
    likelier = np.concatenate(gains)
    # a pole that a window shows ranks with one that half of the orders have where it is this much
    # likelier than none
    sure_gain = 100.0
    poles = distinct(
        np.concatenate([diagram.poles, *local]),
        np.concatenate([diagram.persistence, likelier / (likelier + sure_gain)]),
    )
    return diagram, poles


def _others(diagram: Stabilisation, poles: Complex) -> Complex:
    """Poles of some orders, stable or not, that are not among those given."""
    last = len(diagram.orders) - 1
    starts = [diagram.orders[last * n // 6].poles for n in (6, 4, 3, 2)]
    every = np.concatenate([poles, *starts])
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
    # damping that a guessed frequency starts from where no pole is near
    guessed_damping = 0.01
    start = omega * complex(-guessed_damping, math.sqrt(1.0 - guessed_damping**2))
    single = replace(basis, count=1).start(np.array([start]))
    more = replace(basis, count=basis.count + 1)
    blocks = [part.block for part in parts]
    return more, minimise(more, np.concatenate([theta, single]), blocks, rough=True)[0]


def _reweighted(
    parts: tuple[Prepared, ...], basis: ModalBasis, theta: Array
) -> tuple[Prepared, ...]:
    return tuple(
        part if part.has_final_weights else _weighted(part, basis, theta) for part in parts
    )


def _weighted(part: Prepared, basis: ModalBasis, theta: Array) -> Prepared:
    block, shape = part.block, part.measured.response.shape
    now = eliminate(basis, theta, block)
    motion = (block.s * basis.reference)[:, None] ** np.array(part.powers)[None, :]
    values = (now.functions @ now.factors).reshape(shape) * motion[:, :, None]
    left = remaining(basis, theta, block, now).reshape(shape)
    return reweighted(part, values, left, basis.reference)


def search_with_sensor(
    parts: tuple[Prepared, ...],
    template: ModalBasis,
    sensor: tuple[bool, bool, bool],
    options: dict[str, Any],
) -> ModeSearch:
    """Fit delay and lag, and look for the modes once more in the responses without them.

    `sensor` says whether residues are real, and whether there are a delay and a lag.
    """
    real_modes, delay, lag = sensor

    def with_sensor(basis: ModalBasis) -> ModalBasis:
        return replace(basis, real_modes=real_modes, delay=delay, lag=lag)

    # poles that stretches of a response show are there whatever turns its phase
    _, poles = started(parts, options["band"])
    first = with_sensor(replace(template, count=poles.size))
    begins = [first.start(poles)]
    if delay:
        begins = likely_delays(first, begins[0], parts)
    candidates = [
        _searched(first, begin, parts, template, options, n) for n, begin in enumerate(begins)
    ]
    best = min(candidates, key=lambda one: one.cost)
    weighed = tuple(map(_weighed_as, parts, best.result.parts))
    best = replace(best, cost=math.inf)
    # as long as the delay was not known, modes needed a phase of their own
    inner = replace(template, real_modes=real_modes)
    # how often modes are looked for again, with delay and lag taken off
    most_turns = 4
    for n in range(most_turns):
        trial = _searched(best.basis, best.theta, weighed, inner, options, len(begins) + n)
        if trial.cost >= best.cost - 1e-6 * abs(best.cost):
            break
        best = trial
    basis, theta = best.basis, best.theta
    if options["count"] is None and options["guess"] is None:
        basis, theta = cleaned(basis, theta, [part.block for part in weighed])
    return replace(best.result, parts=weighed, basis=basis, theta=theta)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Late:
    """A fit with delay or lag on the way, and what it costs."""

    result: ModeSearch
    basis: ModalBasis
    theta: Array
    cost: float


def _searched(
    basis: ModalBasis,
    theta: Array,
    parts: tuple[Prepared, ...],
    template: ModalBasis,
    options: dict[str, Any],
    number: int,
) -> _Late:
    """Look for modes in responses without the delay and lag that are known; fit all together."""
    undone = tuple(without_sensor(basis, theta, part) for part in parts)
    # the number of searches is unknown: each one is a share of the remaining progress
    with progress.subtask(1.0 - _PART**number, 1.0 - _PART ** (number + 1)):
        match = search(undone, template, **options)
    more = replace(basis, count=match.basis.count)
    start = np.concatenate([match.theta, theta[2 * basis.count :]])
    trial, total = joined(more, start, parts)
    return _Late(result=match, basis=more, theta=trial, cost=_cost(more, total, parts))


def _cost(basis: ModalBasis, total: float, parts: Sequence[Prepared]) -> float:
    """Return by how much a model is worse than another, with what its modes must be worth."""
    blocks = [part.block for part in parts]
    values = sum(2 * block.values.size for block in blocks)
    return values * math.log(max(total, 1e-300)) + threshold(basis, blocks) * basis.count


def _weighed_as(part: Prepared, other: Prepared) -> Prepared:
    """Return a response with the weights that one without its delay was given."""
    return replace(
        part, deviation=other.deviation, block=replace(part.block, weights=other.block.weights)
    )


def joined(basis: ModalBasis, theta: Array, parts: Sequence[Prepared]) -> tuple[Array, float]:
    """Find delay and lag by trying many near those given, as a fit finds the nearest alone.

    Returned are the parameters and the sum of squares.
    """
    blocks = [part.block for part in parts]
    coarse = [_fewer(block) for block in blocks]
    top = max(float(block.s[-1].imag) for block in blocks)
    pole_parameters = 2 * basis.count
    delays = np.zeros(1)
    if basis.delay:
        delays = theta[pole_parameters] + 2.0 * math.pi / top * _NEAR
    starts: list[tuple[float, Array]] = []
    for lag in np.append(_LAGS / top, theta[-1]) if basis.lag else np.zeros(1):
        trials = np.repeat(theta[None], delays.size, axis=0)
        if basis.lag:
            trials[:, -1] = lag
        if basis.delay:
            trials[:, pole_parameters] = delays
        candidates = list(zip(_totals(basis, trials, coarse).tolist(), trials, strict=True))
        starts += sorted(candidates, key=lambda item: item[0])[: 1 if basis.lag else _STARTS]
    best, least = min(starts, key=lambda item: item[0])[1], math.inf
    for _, start in starts:
        trial, total = minimise(basis, start, blocks, rough=True)
        if total < least:
            best, least = trial, total
    return best, least


def likely_delays(basis: ModalBasis, theta: Array, parts: Sequence[Prepared]) -> list[Array]:
    """Return parameters with delays that explain responses better than neighbouring delays."""
    coarse = [_fewer(part.block) for part in parts]
    top = max(float(block.s[-1].imag) for block in coarse)
    trials = np.repeat(theta[None], _DELAYS.size, axis=0)
    trials[:, 2 * basis.count] = 2.0 * math.pi / top * _DELAYS
    totals = _totals(basis, trials, coarse)
    beside = np.concatenate([[math.inf], totals, [math.inf]])
    lowest = np.flatnonzero((totals <= beside[:-2]) & (totals <= beside[2:]))
    return [trials[n] for n in lowest[np.argsort(totals[lowest])][:_LIKELY]]


def _totals(basis: ModalBasis, trials: Array, blocks: Sequence[ResponseBlock]) -> Array:
    """Return the sums of squares of parameters that differ in their delay alone, shape (trials,).

    A delay turns the phase of responses, which leaves the products of all functions as they are.
    """
    turns = trials[:, 2 * basis.count] - trials[0, 2 * basis.count] if basis.delay else np.zeros(1)
    totals = np.zeros(len(trials))
    for block in blocks:
        now = eliminate(basis, trials[0], block)
        turned = np.exp(block.s[:, None] * turns)
        inverse = np.broadcast_to(now.inverse, (block.values.shape[1], *now.inverse.shape[1:]))
        for values, square, inverse_block in zip(
            block.values.T, now.square.T, inverse, strict=True
        ):
            right = (now.functions.conj().T @ (turned * (square * values)[:, None])).real
            totals += float(square @ np.abs(values) ** 2) - np.sum(
                right * (inverse_block @ right), axis=0
            )
    return totals


def likelier(late: ModeSearch, match: ModeSearch) -> bool:
    """Whether one model is better than another, by the weights of the first."""
    blocks = [part.block for part in late.parts]
    costs = []
    for one in (late, match):
        total = minimise(one.basis, one.theta, blocks, rough=True)[1]
        costs.append(_cost(one.basis, total, late.parts))
    return costs[0] < costs[1]


def steady_phase(poles: Complex, template: ModalBasis, parts: Sequence[Prepared]) -> str:
    """Say that the phase falls as of a delay, where poles explain responses far better with one."""
    basis = replace(template, count=poles.size, delay=True)
    theta = basis.start(poles)
    late = likely_delays(basis, theta, parts)[0]
    blocks = [_fewer(part.block) for part in parts]
    without, with_it = (sum(eliminate(basis, t, b).total for b in blocks) for t in (theta, late))
    delay = float(late[-1]) / basis.reference
    lines = [part.measured.frequency_hz for part in parts]
    band = max(float(f[-1]) for f in lines) - min(float(f[0]) for f in lines)
    if delay * band < _LEAST_TURN or with_it > _FAR_BETTER * without:
        return ""
    return (
        f"the phase falls by about {360.0e3 * delay:.2g} deg per kHz, as for a delay of "
        f"{readable('s', delay, digits=2)}"
    )


def _fewer(block: ResponseBlock) -> ResponseBlock:
    # lines that suffice to try delays
    coarse = 500
    few = slice(None, None, max(1, block.s.size // coarse))
    return replace(block, s=block.s[few], values=block.values[few], weights=block.weights[few])


def without_sensor(basis: ModalBasis, theta: Array, part: Prepared) -> Prepared:
    """Return a response as it was before the delay and lag of the sensor.

    Its weights change to match.
    """
    block = part.block
    factor = basis.transfer(theta, block.s)
    measured = replace(
        part.measured, response=part.measured.response / factor[:, None, None], variance=None
    )
    return replace(
        part,
        measured=measured,
        deviation=part.deviation / np.abs(factor)[:, None, None],
        scatter=part.scatter / np.abs(factor)[:, None, None],
        block=replace(
            block,
            values=block.values / factor[:, None],
            weights=block.weights * np.abs(factor)[:, None],
        ),
    )
