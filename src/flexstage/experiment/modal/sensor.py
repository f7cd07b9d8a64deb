"""Delay and lag of the outputs, which all responses share."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.prepare import Prepared
from flexstage.experiment.modal.projection import Block, eliminate, minimise
from flexstage.experiment.modal.scatter import line_scatter

__all__ = ["joined", "steady_delay", "without_sensor"]

Array = NDArray[np.float64]

# lines that suffice to try delays
_COARSE = 500
# lines this many times their noise have a phase
_CLEAR = 5.0
# delays are tried an eighth of the shortest period apart
_DELAYS = np.arange(-32, 33) / 8.0
# lags, in radians of the highest frequency
_LAGS = np.array([0.0, 0.15, 0.5, 1.5, 4.0])


def steady_delay(parts: Sequence[Prepared]) -> float:
    """Return the delay by which the phase falls in most of the band, whatever resonances do.

    The median of the slopes from line to line, each with the width that it holds over: resonances
    and antiresonances turn the phase in less than half of a band.

    Parameters
    ----------
    parts : sequence of Prepared
        The responses.

    Returns
    -------
    float
        The delay [s]; 0 where the phase is of noise.
    """
    slopes, widths = [np.zeros(0)], [np.zeros(0)]
    for part in parts:
        f, h = part.measured.frequency_hz, part.measured.response
        clear = np.abs(h) > _CLEAR * line_scatter(f, h)
        step = np.broadcast_to(np.diff(f)[:, None, None], h[1:].shape)
        both = clear[1:] & clear[:-1]
        turn = np.angle(h[1:] * h[:-1].conj())
        slopes.append(-(turn / step)[both] / (2.0 * math.pi))
        widths.append(step[both])
    slope, width = np.concatenate(slopes), np.concatenate(widths)
    if not slope.size:
        return 0.0
    order = np.argsort(slope, kind="stable")
    held = np.cumsum(width[order])
    return float(slope[order[int(np.searchsorted(held, 0.5 * held[-1]))]])


def joined(
    basis: ModalBasis, theta: Array, parts: Sequence[Prepared], near: float = 0.0
) -> tuple[Array, float]:
    """Find delay and lag by trying many, as a fit finds the nearest alone.

    Parameters
    ----------
    basis : ModalBasis
        The model, with delay or lag.
    theta : numpy.ndarray
        Its parameters: of these, those of modes are the start, shape (p,).
    parts : sequence of Prepared
        The responses.
    near : float
        A delay that others are tried about [s].

    Returns
    -------
    tuple of numpy.ndarray and float
        The parameters, and the sum of squares.
    """
    blocks = [part.block for part in parts]
    coarse = [_fewer(block) for block in blocks]
    top = max(float(block.s[-1].imag) for block in blocks)
    about = near * basis.reference
    delays = about + 2.0 * math.pi / top * _DELAYS if basis.delay else np.zeros(1)
    starts: list[tuple[float, Array]] = []
    for lag in _LAGS / top if basis.lag else np.zeros(1):
        tried = []
        for delay in delays:
            trial = theta.copy()
            if basis.lag:
                trial[-1] = lag
            if basis.delay:
                trial[2 * basis.count] = delay
            tried.append((sum(eliminate(basis, trial, b).total for b in coarse), trial))
        starts.append(min(tried, key=lambda item: item[0]))
    best, least = min(starts, key=lambda item: item[0])[1], math.inf
    for _, start in starts:
        trial, total = minimise(basis, start, blocks, rough=True)
        if total < least:
            best, least = trial, total
    return best, least


def _fewer(block: Block) -> Block:
    few = slice(None, None, max(1, block.s.size // _COARSE))
    return replace(block, s=block.s[few], values=block.values[few], weights=block.weights[few])


def without_sensor(basis: ModalBasis, theta: Array, part: Prepared) -> Prepared:
    """Return a response as it was before the delay and lag of the sensor.

    Parameters
    ----------
    basis : ModalBasis
        The model, with delay or lag.
    theta : numpy.ndarray
        Its parameters, shape (p,).
    part : Prepared
        The response.

    Returns
    -------
    Prepared
        The response without them, and with weights to match.
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
        block=replace(
            block,
            values=block.values / factor[:, None],
            weights=block.weights * np.abs(factor)[:, None],
        ),
    )
