"""From the end of a fit to modes: which poles are modes of the stage, and what to beware of."""

import math
from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.errors import ModelError
from flexstage.estimate import Estimate
from flexstage.measure.modal.basis import ModalBasis
from flexstage.measure.modal.covariance import Worth, assess, frequencies_of, residues_of
from flexstage.measure.modal.mode_selection import significances, threshold
from flexstage.measure.modal.prepare import Prepared
from flexstage.measure.modal.result import (
    FittedResponse,
    ModalFit,
    Mode,
    noisy_estimate,
    shape_from_residues,
)
from flexstage.measure.modal.stabilisation import Stabilisation

# with more damping than this a pole lifts its response by less than 1.75 above that at standstill
_MOST_DAMPING = 0.3
# what a mode must make of the sum of squares beside the line that it stands on, over noise
_SEEN = 25.0
# share of a guessed frequency within which its mode lies
_NEAR = 0.1
# share of a response that a fit may leave before it is said
_UNEXPLAINED = 0.2


def assembled(
    basis: ModalBasis,
    theta: Array,
    parts: Sequence[Prepared],
    *,
    band: tuple[float, float],
    stabilisation: Stabilisation | None,
    added_damping_rate: float,
    wanted: int | Sequence[float] | None,
    hints: Sequence[str] = (),
) -> ModalFit:
    """Make the result of a fit.

    `added_damping_rate` [1/s] is taken off. Where no modes are `wanted`, by number or near
    frequencies [Hz], poles that are no modes of the stage are left out of the list.
    """
    blocks = [part.block for part in parts]
    worth = assess(basis, theta, blocks)
    strength = significances(basis, theta, blocks) if basis.count else np.zeros(0)
    outputs, inputs = _names(parts)
    values, slopes = frequencies_of(basis, theta, added_damping_rate)
    covariance = slopes @ worth.covariance @ slopes.T
    rate = max(part.measured.rate_uncertainty for part in parts)
    poles = []
    rising = [int(r) for r in np.argsort(values[::2], kind="stable")]
    for r in rising:
        residues, matrix = residues_of(basis, theta, worth, parts, r, (outputs, inputs))
        shape, spread = shape_from_residues(residues, matrix)
        deviation = np.sqrt(np.maximum(np.diagonal(matrix), 0.0)).reshape(*residues.shape, 2)
        poles.append(
            Mode(
                frequency_hz=_estimate(
                    values[2 * r], covariance[2 * r, 2 * r], "Hz", worth, rate * values[2 * r]
                ),
                damping_ratio=_estimate(
                    values[2 * r + 1], covariance[2 * r + 1, 2 * r + 1], "1", worth
                ),
                shape=shape,
                shape_uncertainty=spread,
                residues=residues,
                residue_uncertainty=np.where(np.isfinite(residues)[:, :, None], deviation, np.nan),
                significance=float(strength[r]),
            )
        )
    kept, others = _listed(poles, parts, band, wanted, worth.scale)
    modes = [poles[n] for n in kept]
    own = [2 * rising[n] + d for n in kept for d in (0, 1)]
    covariance = covariance[np.ix_(own, own)]
    size = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    size[size == 0.0] = 1.0
    extra: dict[str, Estimate | None] = {"delay": None, "lag": None}
    number = 2 * basis.count
    for name, there in (("delay", basis.delay), ("lag", basis.lag)):
        if there:
            extra[name] = _estimate(
                theta[number] / basis.reference,
                worth.covariance[number, number] / basis.reference**2,
                "s",
                worth,
            )
            number += 1
    fitted = _fitted(worth, parts)
    notes = [*_notes(modes, parts, band, worth, fitted, added_damping_rate), *_not_listed(others)]
    if wanted is not None:
        needed = threshold(basis, blocks)
        notes += [
            f"the mode at {mode.frequency_hz.value:.5g} Hz does not rise above the noise"
            for mode in modes
            if mode.significance < needed
        ]
    return ModalFit(
        modes=tuple(modes),
        background=tuple(mode for group in others.values() for mode in group),
        outputs=outputs,
        inputs=inputs,
        band=band,
        fitted=tuple(fitted),
        delay=extra["delay"],
        lag=extra["lag"],
        correlation=covariance / np.outer(size, size),
        reduced_chi_squared=worth.scale,
        line_correlation=float(2.0 * worth.lags.real.sum()),
        stabilisation=stabilisation,
        notes=(*notes, *hints),
        basis=basis,
        theta=theta,
    )


def _listed(
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
    names = _names(parts)
    lines = np.sort(np.concatenate([part.measured.frequency_hz for part in parts]))
    kept = []
    others: dict[str, list[Mode]] = {}
    for n, mode in enumerate(poles):
        f, zeta = mode.frequency_hz, mode.damping_ratio
        width = max(2.0 * zeta.value * f.value, _spacing(lines, f.value))
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


def _not_listed(others: dict[str, list[Mode]]) -> list[str]:
    """Name the poles that are not listed, in one note."""
    if not others:
        return []
    said = []
    for reason, modes in sorted(others.items()):
        figures = [(mode.frequency_hz.value, 100.0 * mode.damping_ratio.value) for mode in modes]
        named = ", ".join(f"{f:.4g} Hz with {zeta:.2g} % damping" for f, zeta in figures)
        said.append(f"{named} ({reason})")
    return [f"poles of the fit that are not listed as modes: {'; '.join(said)}"]


def _names(parts: Sequence[Prepared]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    outputs = dict.fromkeys(name for part in parts for name in part.measured.outputs)
    inputs = dict.fromkeys(name for part in parts for name in part.measured.inputs)
    return tuple(outputs), tuple(inputs)


def _estimate(
    value: float, variance: float, unit: str, worth: Worth, clock: float = 0.0
) -> Estimate:
    uncertainty = math.sqrt(max(float(variance), 0.0))
    freedom = float(worth.degrees_of_freedom)
    return noisy_estimate(float(value), uncertainty, unit, freedom, float(clock))


def _fitted(worth: Worth, parts: Sequence[Prepared]) -> list[FittedResponse]:
    out = []
    for part, members in zip(parts, worth.members, strict=True):
        shape = part.measured.response.shape[1:]
        lines = part.measured.frequency_hz.size
        joint = np.array([worth.factors(i)[0] for i in members])
        residual = np.stack([worth.columns[i].residual for i in members], axis=1)
        complex_residual = (residual[:lines] + 1j * residual[lines:]).reshape(lines, *shape)
        known = np.where(np.isfinite(part.deviation), part.deviation, 0.0)
        rms = np.abs(complex_residual) * known / math.sqrt(2.0)
        size = np.sqrt(np.mean(np.abs(part.measured.response) ** 2, axis=0))
        out.append(
            FittedResponse(
                measured=part.measured,
                powers=part.powers,
                factors=np.array([worth.columns[i].factors for i in members]).reshape(*shape, -1),
                covariance=joint.reshape(*shape, *joint.shape[1:]),
                deviation=math.sqrt(worth.scale) * part.deviation,
                residual_rms=np.sqrt(np.mean(rms**2, axis=0)) / size,
            )
        )
    return out


def _notes(
    modes: Sequence[Mode],
    parts: Sequence[Prepared],
    band: tuple[float, float],
    worth: Worth,
    fitted: Sequence[FittedResponse],
    added_damping_rate: float,
) -> list[str]:
    notes = []
    if not modes:
        notes.append("no mode rises above the noise in the band")
    if not any(part.given for part in parts):
        notes.append("no variance was given: it is estimated from the residuals")
    largest = max(float(one.residual_rms.max()) for one in fitted)
    if largest > _UNEXPLAINED and modes:
        notes.append(
            f"the residual is {100.0 * largest:.2g} % of a response: fit it in a narrower band, "
            "with a delay, or with complex modes"
        )
    windowed = added_damping_rate > 0.0 or any(part.measured.blur > 0.0 for part in parts)
    for mode in modes:
        f, zeta = mode.frequency_hz.value, mode.damping_ratio.value
        width = 2.0 * max(zeta, 0.0) * f
        if f - 0.5 * width < band[0] or f + 0.5 * width > band[1]:
            notes.append(
                f"the mode at {f:.5g} Hz is at the edge of the band: half of its peak is outside"
            )
        if zeta <= 0.0:
            notes.append(f"the mode at {f:.5g} Hz has a damping not distinguishable from 0")
        spacing = min(_spacing(part.measured.frequency_hz, f) for part in parts)
        if 0.0 < width < 2.0 * spacing:
            doubt = "that of the window" if windowed else "known badly"
            notes.append(
                f"the peak at {f:.5g} Hz is {width:.2g} Hz wide, with lines {spacing:.2g} Hz "
                f"apart: its damping may be {doubt}"
            )
    if all(part.given for part in parts) and worth.scale > 2.0:
        notes.append(
            f"the residual is {math.sqrt(worth.scale):.2g} times the noise that was stated: the "
            "model lacks something; the uncertainties are enlarged by as much"
        )
    if worth.lags.size:
        notes.append("noise of neighbouring lines is correlated: the uncertainties contain that")
    if any(not np.array_equal(c, np.eye(c.shape[0])) for c in worth.shared):
        notes.append("noise of the responses is correlated: the uncertainties contain that")
    return notes


def _spacing(lines: Array, frequency: float) -> float:
    """Distance of rising lines about a frequency [Hz]."""
    at = int(np.clip(np.searchsorted(lines, frequency), 1, lines.size - 1))
    return float(lines[at] - lines[at - 1])
