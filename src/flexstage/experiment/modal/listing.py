"""Which poles of an automatic fit are modes of the stage, and which stand for something else."""

import math
from collections.abc import Sequence

import numpy as np

from flexstage.errors import ModelError
from flexstage.experiment.modal.prepare import Prepared
from flexstage.experiment.modal.result import Mode

# with more damping than this a pole lifts its response by less than 1.75 above that at standstill
_MOST_DAMPING = 0.3
# what a mode must make of the sum of squares beside the line that it stands on, over noise
_SEEN = 25.0
# share of a guessed frequency within which its mode lies
_NEAR = 0.1


def listed(
    poles: Sequence[Mode],
    parts: Sequence[Prepared],
    band: tuple[float, float],
    wanted: int | Sequence[float] | None,
    scale: float,
) -> tuple[list[int], dict[str, list[Mode]]]:
    """Tell modes from poles that stand for something else.

    A mode is inside the band, has a peak, and is known within the width of that peak or the
    distance of lines. Others stand for modes beyond the band, a drift, an amplifier or a
    nonlinearity. All are modes where a number was `wanted`; else those near the frequencies [Hz].
    `scale` is the mean square of noise over that of the weights. Returned are numbers of the modes,
    and the others by the reason against them.
    """
    if isinstance(wanted, int):
        return list(range(len(poles))), {}
    if wanted is not None:
        kept = sorted({_nearest(poles, frequency) for frequency in wanted})
        rest = [mode for n, mode in enumerate(poles) if n not in kept]
        return kept, {"not asked for": rest} if rest else {}
    names = (
        tuple(dict.fromkeys(name for part in parts for name in part.measured.outputs)),
        tuple(dict.fromkeys(name for part in parts for name in part.measured.inputs)),
    )
    lines = np.sort(np.concatenate([part.measured.frequency_hz for part in parts]))
    kept = []
    others: dict[str, list[Mode]] = {}
    for n, mode in enumerate(poles):
        f, zeta = mode.frequency_hz, mode.damping_ratio
        at = int(np.clip(np.searchsorted(lines, f.value), 1, lines.size - 1))
        width = max(2.0 * zeta.value * f.value, float(lines[at] - lines[at - 1]))
        if not band[0] <= f.value <= band[1]:
            reason = "beyond the band"
        elif zeta.value + min(zeta.expanded, zeta.value) > _MOST_DAMPING:
            reason = "damped too much for a peak"
        elif f.expanded > width:
            reason = "not known within its width"
        elif _beside(mode, parts, names, scale) < _SEEN:
            reason = "on a single line"
        else:
            kept.append(n)
            continue
        others.setdefault(reason, []).append(mode)
    return kept, others


def _beside(
    mode: Mode,
    parts: Sequence[Prepared],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    scale: float,
) -> float:
    """Sum of squares over noise that a mode makes on all lines but the nearest."""
    total = 0.0
    for part in parts:
        rows = [names[0].index(name) for name in part.measured.outputs]
        columns = [names[1].index(name) for name in part.measured.inputs]
        omega = 2.0 * math.pi * part.measured.frequency_hz
        residues = mode.residues[np.ix_(rows, columns)].ravel()
        motion = residues[None, :] / (1j * omega - mode.pole)[:, None]
        # weights are the root of two over the noise
        square = 0.5 * np.abs(motion * part.block.weights) ** 2
        square[int(np.argmin(np.abs(omega - abs(mode.pole))))] = 0.0
        noise = np.full_like(square, scale)
        if part.kept and not part.given:
            # weights that were chosen do not say where the noise is: the lines do
            own = (part.scatter / part.deviation) ** 2
            noise = np.maximum(noise, own.reshape(noise.shape))
        total += float((square / noise).sum())
    return total


def _nearest(poles: Sequence[Mode], frequency: float) -> int:
    """Number of the mode near a frequency."""
    off = [
        abs(mode.frequency_hz.value / frequency - 1.0)
        if mode.damping_ratio.value <= _MOST_DAMPING
        else math.inf
        for mode in poles
    ]
    if not off or min(off) > _NEAR:
        raise ModelError(
            f"no mode is found within {100.0 * _NEAR:g} % of {frequency:g} Hz: guess another "
            "frequency, or fit another band"
        )
    return int(np.argmin(off))


def not_listed(others: dict[str, list[Mode]]) -> list[str]:
    """Name the poles that are not listed, in one note."""
    if not others:
        return []
    said = [
        f"{', '.join(_named(mode) for mode in modes)} ({reason})"
        for reason, modes in sorted(others.items())
    ]
    return [f"poles of the fit that are not listed as modes: {'; '.join(said)}"]


def _named(mode: Mode) -> str:
    return f"{mode.frequency_hz.value:.4g} Hz with {100.0 * mode.damping_ratio.value:.2g} % damping"
