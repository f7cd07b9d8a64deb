"""Which poles of a fit are modes of the stage, and what the others stand for."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Component
from flexstage.measure.modal.covariance import Worth, frequencies_of
from flexstage.measure.modal.mode_selection import without
from flexstage.measure.modal.prepare import Prepared
from flexstage.measure.modal.result import Mode
from flexstage.measure.modal.variable_projection import ModalBasis, ResponseBlock, minimise

# with more damping than this a pole lifts its response by less than 1.75 above that at standstill
_MOST_DAMPING = 0.3
# half-power widths of a broad mode within which a sharper one may be all that it stands for
_FLANK = 2.0


def listed_modes(
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
    names = names_of(parts)
    lines = np.sort(np.concatenate([part.measured.frequency_hz for part in parts]))
    kept = []
    others: dict[str, list[Mode]] = {}
    # what a mode must make of the sum of squares beside the line that it stands on, over noise
    seen = 25.0
    for n, mode in enumerate(poles):
        f, zeta = mode.frequency_hz, mode.damping_ratio
        width = max(2.0 * zeta.value * f.value, line_spacing(lines, f.value))
        if not band[0] <= f.value <= band[1]:
            reason = "beyond the band"
        elif zeta.value + min(zeta.expanded, zeta.value) > _MOST_DAMPING:
            reason = "damped too much for a peak"
        elif f.expanded > width:
            reason = "not known within its width"
        elif _beside(mode, parts, names, scale) < seen:
            reason = "on a single line"
        elif any(on_flank(mode, other) for other in poles):
            reason = "on the flank of a sharper mode"
        else:
            kept.append(n)
            continue
        others.setdefault(reason, []).append(mode)
    return kept, others


def on_flank(mode: Mode, other: Mode) -> bool:
    """Say whether a mode is within the width of a sharper one, and nowhere above its flank."""
    width, sharper = -mode.pole.real, -other.pole.real
    apart = abs(mode.pole.imag - other.pole.imag)
    if not width > sharper > 0.0 or apart > _FLANK * width:
        return False
    flank = np.abs(other.residues / (1j * mode.pole.imag - other.pole))
    return bool(np.all((np.abs(mode.residues) / width < flank)[np.isfinite(flank)]))


def with_and_without(
    poles: Sequence[Mode],
    basis: ModalBasis,
    theta: Array,
    blocks: Sequence[ResponseBlock],
    places: tuple[Sequence[int], Sequence[int]],
    parts: Sequence[Prepared],
    band: tuple[float, float],
    worth: Worth,
) -> list[Mode]:
    """Widen the intervals of the kept modes to hold what a fit without the background gives.

    `places` are the numbers of the kept modes, and that of each mode in the parameters.
    """
    kept, rising = places
    peaks = {*kept, *listed_modes(poles, parts, band, None, worth.scale)[0]}
    gone = [rising[n] for n in range(len(poles)) if n not in peaks]
    out = list(poles)
    if not gone:
        return out
    fewer, start = without(basis, theta, gone)
    values = frequencies_of(fewer, minimise(fewer, start, blocks, rough=True)[0], 0.0)[0]
    left = [r for r in range(basis.count) if r not in gone]
    for n in kept:
        other = 2 * left.index(rising[n])
        mode = out[n]
        f, zeta = (
            own.plus(Component(name="background", uncertainty=abs(own.value - v) / 1.95, kind="B"))
            for own, v in (
                (mode.frequency_hz, values[other]),
                (mode.damping_ratio, values[other + 1]),
            )
        )
        out[n] = replace(mode, frequency_hz=f, damping_ratio=zeta)
    return out


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
    # share of a guessed frequency within which its mode lies
    near = 0.1
    if not off or min(off) > near:
        raise ModelError(
            f"no mode is found within {100.0 * near:g} % of {frequency:g} Hz: guess another "
            "frequency, or fit another band"
        )
    return int(np.argmin(off))


def not_listed(others: dict[str, list[Mode]]) -> list[str]:
    """Return a note that names the poles that are not listed."""
    if not others:
        return []
    said = []
    for reason, modes in sorted(others.items()):
        figures = [(mode.frequency_hz.value, 100.0 * mode.damping_ratio.value) for mode in modes]
        named = ", ".join(f"{f:.4g} Hz with {zeta:.2g} % damping" for f, zeta in figures)
        said.append(f"{named} ({reason})")
    return [f"poles of the fit that are not listed as modes: {'; '.join(said)}"]


def names_of(parts: Sequence[Prepared]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of all outputs and of all inputs, each once."""
    outputs = dict.fromkeys(name for part in parts for name in part.measured.outputs)
    inputs = dict.fromkeys(name for part in parts for name in part.measured.inputs)
    return tuple(outputs), tuple(inputs)


def line_spacing(lines: Array, frequency: float) -> float:
    """Return the distance of rising lines about a frequency [Hz]."""
    at = int(np.clip(np.searchsorted(lines, frequency), 1, lines.size - 1))
    return float(lines[at] - lines[at - 1])
