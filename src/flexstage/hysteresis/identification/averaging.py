"""A long record made shorter: the means of neighbouring samples, and where they say enough."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.hysteresis.identification.measurement import (
    Section,
    with_history,
    without_history,
)
from flexstage.records.quality import difference_noise

#: From mean to mean a signal runs in a straight line, within this share of its range, rms, ...
_STRAIGHT = 3e-4
#: ... and this many times its noise. Samples where it does not are left out; at most this share.
_NOISE = 3.0
_LEFT_OUT = 0.04
#: Means may miss turning points of the input by this share of its range, rms, beside its noise.
_BLUNT = 3e-4


def averaged(section: Section, most: int, loose: float = 1.0) -> Section:
    """Take the mean of so many neighbouring samples that a long record becomes short.

    Input and output are averaged alike, so that a linear chain does not see it and a delay stays
    what it is; noise that is white falls with the square root of their number. Where input or
    output run otherwise than in a straight line from mean to mean, as in sharp turns, jumps and
    tones, a hysteresis of the mean is not the mean of a hysteresis: those samples are left out of
    fits. Blocks are kept so short that they are few, and that no turning point is blunted. `loose`
    is how much more than usual means may miss of the motion. Returned as it was where it is short
    enough, or moves too quickly.
    """
    if section.measured is not None:
        return section
    measured = without_history(section)
    every = -(-measured.u.size // most)
    noise = difference_noise(measured.u, 3), measured.noise
    while every >= 2:
        made = _means(measured, every, noise, loose)
        if made is not None:
            return with_history(made) if section.history else made
        every = min(every - 1, int(0.8 * every))
    return section


def _means(
    section: Section, every: int, noise: tuple[float, float], loose: float
) -> Section | None:
    """The section of means; None where they would not do."""
    u, y = (_blocks(x, every).mean(axis=1) for x in (section.u, section.y))
    straight = np.ones(u.size, dtype=bool)
    for values, means, own in zip((section.u, section.y), (u, y), noise, strict=True):
        bound = (loose * _STRAIGHT * np.ptp(values)) ** 2 + (_NOISE * own) ** 2
        straight &= _bend(values, means, every) <= bound
    if np.mean(~straight) > _LEFT_OUT:
        return None
    # the line to a mean that does not stand for its samples is wrong for the one beside it as well
    straight[1:-1] &= straight[2:] & straight[:-2]
    turning = section.cycles.turning
    bound = loose * _BLUNT * float(np.ptp(section.u)) + _NOISE * noise[0]
    if _blunting(section.u, u, turning, every) > bound:
        return None
    moves = section.cycles
    nuisance = [_blocks(c, every).mean(axis=1) for c in section.nuisance.T]
    return replace(
        section,
        u=u,
        y=y,
        dt=section.dt * every,
        cycles=replace(moves, bounds=moves.bounds // every, turning=moves.turning // every),
        warm_up=-(-section.warm_up // every),
        nuisance=np.column_stack(nuisance),
        noise=section.noise / np.sqrt(every),
        straight=straight,
    )


def _blocks(values: Array, every: int) -> Array:
    """Values in rows of neighbours; the last ones, which fill no row, are left out."""
    count = values.size // every
    return values[: count * every].reshape(count, every)


def _bend(values: Array, means: Array, every: int) -> Array:
    """Mean square distance of each block from straight lines between the means of neighbours."""
    place = (np.arange(every) + 0.5) / every - 0.5
    before = np.concatenate((2.0 * means[:1] - means[1:2], means[:-1]))
    after = np.concatenate((means[1:], 2.0 * means[-1:] - means[-2:-1]))
    square = np.zeros(means.size)
    for own, column in zip(place, _blocks(values, every).T, strict=True):
        other = before if own < 0.0 else after
        square += (column - means - abs(own) * (other - means)) ** 2
    return square / every


def _blunting(u: Array, means: Array, turning: NDArray[np.intp], every: int) -> float:
    """How far the means stay behind the turning points, rms."""
    at = np.clip(turning // every, 1, means.size - 2)
    if at.size == 0 or means.size < 3:
        return 0.0
    near = np.stack((means[at - 1], means[at], means[at + 1]))
    return float(np.sqrt(np.mean(np.min(np.abs(near - u[turning]), axis=0) ** 2)))
