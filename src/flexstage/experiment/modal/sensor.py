"""Delay and lag of the outputs, which all responses share."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.prepare import Prepared
from flexstage.experiment.modal.projection import Block, eliminate, minimise
from flexstage.units import readable

# lines that suffice to try delays
_COARSE = 500
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


def joined(basis: ModalBasis, theta: Array, parts: Sequence[Prepared]) -> tuple[Array, float]:
    """Find delay and lag by trying many near those given, as a fit finds the nearest alone.

    Returned are the parameters and the sum of squares.
    """
    blocks = [part.block for part in parts]
    coarse = [_fewer(block) for block in blocks]
    top = max(float(block.s[-1].imag) for block in blocks)
    own = 2 * basis.count
    delays = np.zeros(1)
    if basis.delay:
        delays = theta[own] + 2.0 * math.pi / top * _NEAR
    starts: list[tuple[float, Array]] = []
    for lag in np.append(_LAGS / top, theta[-1]) if basis.lag else np.zeros(1):
        tried = []
        for delay in delays:
            trial = theta.copy()
            if basis.lag:
                trial[-1] = lag
            if basis.delay:
                trial[own] = delay
            tried.append((sum(eliminate(basis, trial, b).total for b in coarse), trial))
        starts += sorted(tried, key=lambda item: item[0])[: 1 if basis.lag else _STARTS]
    best, least = min(starts, key=lambda item: item[0])[1], math.inf
    for _, start in starts:
        trial, total = minimise(basis, start, blocks, rough=True)
        if total < least:
            best, least = trial, total
    return best, least


def likely_delays(basis: ModalBasis, theta: Array, parts: Sequence[Prepared]) -> list[Array]:
    """Return parameters with delays that explain responses better than those beside them."""
    coarse = [_fewer(part.block) for part in parts]
    top = max(float(block.s[-1].imag) for block in coarse)
    trials = np.repeat(theta[None], _DELAYS.size, axis=0)
    trials[:, 2 * basis.count] = 2.0 * math.pi / top * _DELAYS
    totals = np.array([sum(eliminate(basis, one, b).total for b in coarse) for one in trials])
    beside = np.concatenate([[math.inf], totals, [math.inf]])
    lowest = np.flatnonzero((totals <= beside[:-2]) & (totals <= beside[2:]))
    return [trials[n] for n in lowest[np.argsort(totals[lowest])][:_LIKELY]]


def steady_phase(poles: Complex, template: ModalBasis, parts: Sequence[Prepared]) -> list[str]:
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
        return []
    return [
        f"the phase falls by some {360.0e3 * delay:.2g} deg per kHz, as of a delay of "
        f"{readable('s', delay, digits=2)}: try the option delay"
    ]


def _fewer(block: Block) -> Block:
    few = slice(None, None, max(1, block.s.size // _COARSE))
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
