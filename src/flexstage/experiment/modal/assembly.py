"""From the end of a fit to modes: units, uncertainties, shapes, and what to beware of."""

import math
from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.estimate import Component, Estimate
from flexstage.experiment.modal.basis import ModalBasis
from flexstage.experiment.modal.covariance import Worth, assess, meat
from flexstage.experiment.modal.listing import listed, not_listed
from flexstage.experiment.modal.mode_selection import significances, threshold
from flexstage.experiment.modal.prepare import Prepared
from flexstage.experiment.modal.result import FittedResponse, ModalFit, Mode
from flexstage.experiment.modal.shapes import shape_from_residues
from flexstage.experiment.modal.stabilisation import Stabilisation

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
    values, slopes = _frequencies(basis, theta, added_damping_rate)
    covariance = slopes @ worth.covariance @ slopes.T
    rate = max(part.measured.rate_uncertainty for part in parts)
    poles = []
    rising = [int(r) for r in np.argsort(values[::2], kind="stable")]
    for r in rising:
        residues, matrix = _residues(basis, theta, worth, parts, r, (outputs, inputs))
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
    kept, others = listed(poles, parts, band, wanted, worth.scale)
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
    notes = [*_notes(modes, parts, band, worth, fitted, added_damping_rate), *not_listed(others)]
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


def _names(parts: Sequence[Prepared]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    outputs = dict.fromkeys(name for part in parts for name in part.measured.outputs)
    inputs = dict.fromkeys(name for part in parts for name in part.measured.inputs)
    return tuple(outputs), tuple(inputs)


def _estimate(
    value: float, variance: float, unit: str, worth: Worth, clock: float = 0.0
) -> Estimate:
    noise = Component(
        name="noise",
        uncertainty=math.sqrt(max(float(variance), 0.0)),
        degrees_of_freedom=float(worth.degrees_of_freedom),
    )
    components = (noise, Component(name="sample rate", uncertainty=float(clock), kind="B"))
    return Estimate(value=float(value), unit=unit, components=components[: 1 + (clock > 0.0)])


def _frequencies(basis: ModalBasis, theta: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and damping ratios without the window's, and their slopes by theta."""
    values = np.empty(2 * basis.count)
    slopes = np.zeros((2 * basis.count, basis.size))
    added = rate / basis.reference
    for r, (w, zeta) in enumerate(theta[: 2 * basis.count].reshape(-1, 2)):
        # the window moves real parts alone: sigma = zeta w - added, and w_d stays
        size = math.sqrt(w * w - 2.0 * zeta * w * added + added * added)
        damping = (zeta * w - added) / size
        by_w, by_zeta = (w - zeta * added) / size, -w * added / size
        hertz = basis.reference / (2.0 * math.pi)
        values[2 * r : 2 * r + 2] = hertz * size, damping
        slopes[2 * r, 2 * r : 2 * r + 2] = hertz * by_w, hertz * by_zeta
        slopes[2 * r + 1, 2 * r : 2 * r + 2] = (
            (zeta - damping * by_w) / size,
            (w - damping * by_zeta) / size,
        )
    return values, slopes


def _residues(
    basis: ModalBasis,
    theta: Array,
    worth: Worth,
    parts: Sequence[Prepared],
    mode: int,
    names: tuple[tuple[str, ...], tuple[str, ...]],
) -> tuple[Complex, Array]:
    """Residues of a mode over all outputs and inputs, and the covariance of their parts in turn."""
    weights = basis.residue_weights(theta, mode)
    turn = np.stack([weights.real, weights.imag], axis=1)
    own = slice(basis.per_mode * mode, basis.per_mode * (mode + 1))
    slopes = _weight_slopes(basis, theta, mode)
    residues, follow, crossed, influence = [], [], [], []
    for column, cross in zip(worth.columns, worth.crossed, strict=True):
        factors = column.factors[own]
        residues.append(weights @ factors)
        moved = np.stack([(slopes @ factors).real, (slopes @ factors).imag])
        follow.append(moved - turn.T @ (column.inverse.T @ column.jacobian)[own])
        crossed.append(cross[:, own] @ turn)
        stacked = column.inverse[:, own] @ turn
        half = stacked.shape[0] // 2
        influence.append(stacked[:half] + 1j * stacked[half:])
    size = 2 * len(residues)
    v = np.concatenate(follow)
    x = np.concatenate(crossed, axis=1)
    matrix = v @ worth.covariance @ v.T + v @ x + (v @ x).T
    for members, together in zip(worth.members, worth.shared, strict=True):
        within = slice(2 * members[0], 2 * members[-1] + 2)
        stacked = [influence[i] for i in members]
        if np.array_equal(together, np.eye(len(members))):
            for i, one in zip(members, stacked, strict=True):
                pair = slice(2 * i, 2 * i + 2)
                matrix[pair, pair] += worth.scale * meat(one, one, worth.lags)
            continue
        for a, i in enumerate(members):
            joint = np.concatenate([together[a, b] * one for b, one in enumerate(stacked)], axis=1)
            matrix[2 * i : 2 * i + 2, within] += worth.scale * meat(stacked[a], joint, worth.lags)
    return _merged(np.array(residues), 0.5 * (matrix + matrix.T), parts, names, size)


def _weight_slopes(basis: ModalBasis, theta: Array, mode: int) -> Complex:
    """How the factors of a residue change with the parameters, shape (p, per_mode)."""
    out = np.zeros((basis.size, basis.per_mode), dtype=np.complex128)
    for p in (2 * mode, 2 * mode + 1):
        step = np.zeros(basis.size)
        step[p] = 1e-6 * max(abs(theta[p]), 1e-3)
        change = basis.residue_weights(theta + step, mode) - basis.residue_weights(
            theta - step, mode
        )
        out[p] = change / (2.0 * step[p])
    return out


def _merged(
    residues: Complex,
    matrix: Array,
    parts: Sequence[Prepared],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    size: int,
) -> tuple[Complex, Array]:
    """Put residues in their places; those measured more than once are averaged by variance."""
    outputs, inputs = names
    places = [
        outputs.index(o) * len(inputs) + inputs.index(i)
        for part in parts
        for o in part.measured.outputs
        for i in part.measured.inputs
    ]
    variance = np.diagonal(matrix).reshape(-1, 2).sum(axis=1)
    precision = 1.0 / np.where(variance > 0.0, variance, 1.0)
    mean = np.zeros((len(outputs) * len(inputs), residues.size))
    mean[places, np.arange(residues.size)] = precision
    total = mean.sum(axis=1)
    known = total > 0.0
    mean[known] /= total[known][:, None]
    merged = np.where(known, mean @ residues, np.nan + 0.0j)
    both = np.kron(mean, np.eye(2))
    return merged.reshape(len(outputs), len(inputs)), both @ matrix[:size, :size] @ both.T


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
        spacing = min(_spacing(part, f) for part in parts)
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


def _spacing(part: Prepared, frequency: float) -> float:
    """Distance of the lines about a frequency [Hz]."""
    lines = part.measured.frequency_hz
    at = int(np.clip(np.searchsorted(lines, frequency), 1, lines.size - 1))
    return float(lines[at] - lines[at - 1])
