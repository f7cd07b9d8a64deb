"""From a fit to modes: poles and residues with their covariance, and which poles are modes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.measure.modal.mode_selection import without
from flexstage.measure.modal.prepare import Prepared
from flexstage.measure.modal.result import Mode
from flexstage.measure.modal.variable_projection import (
    ModalBasis,
    Projected,
    ResponseBlock,
    minimise,
    project,
)
from flexstage.quantities.estimate import Component

_LAGS = 8
# a correlation of noise goes beyond this, over the root of the number of lines, once in 500 times
_SIGNIFICANT = 2.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Worth:
    """A fit at its end, with covariances."""

    covariance: Array
    """Covariance of the parameters, shape (p, p)."""
    columns: tuple[Projected, ...]
    """Each response in turn, block by block."""
    members: tuple[tuple[int, ...], ...]
    """Numbers of the responses of each block."""
    scale: float
    """Sum of squares over degrees of freedom."""
    degrees_of_freedom: int
    """Values less parameters."""
    lags: Complex
    """Correlation of the residual with that of the next lines, shape (l,)."""
    shared: tuple[Complex, ...]
    """Correlation among the responses of each block, shape (m, m)."""
    crossed: tuple[Array, ...]
    """Covariance of the parameters with the own noise of the factors of each response, shape (p,
    q).
    """

    def factors(self, number: int) -> tuple[Array, Array]:
        """Return how the factors of a response and the parameters vary together.

        The covariance of parameters and factors, shape (p + q, p + q), and the derivative of the
        factors by the parameters, shape (q, p).
        """
        column = self.columns[number]
        follow = -column.inverse.T @ column.jacobian
        variance = self.scale * meat(_complex(column.inverse), _complex(column.inverse), self.lags)
        cross = self.covariance @ follow.T + self.crossed[number]
        inner = (
            variance
            + follow @ self.covariance @ follow.T
            + follow @ self.crossed[number]
            + self.crossed[number].T @ follow.T
        )
        return np.block([[self.covariance, cross], [cross.T, inner]]), follow


def _complex(stacked: Array) -> Complex:
    half = stacked.shape[0] // 2
    return stacked[:half] + 1j * stacked[half:]


def meat(left: Complex, right: Complex, lags: Complex) -> Array:
    """Return Re(left^H R right), where R holds the correlations of lines.

    `left` and `right` are influences of each line, shapes (k, a) and (k, b); `lags` its correlation
    with the next lines.
    """
    total = left.conj().T @ right
    for lag, rho in enumerate(lags, start=1):
        total = total + rho * (left[:-lag].conj().T @ right[lag:])
        total = total + rho.conjugate() * (left[lag:].conj().T @ right[:-lag])
    return total.real


def assess(basis: ModalBasis, theta: Array, blocks: Sequence[ResponseBlock]) -> Worth:
    """Find the covariance of a fit from its Jacobian and its residual.

    Were the errors of all lines and responses independent, it would be s^2 (J^T J)^-1. Where the
    residual shows that they are not, as after a window or with a noisy input, their correlation is
    put between: (J^T J)^-1 J^T C J (J^T J)^-1.
    """
    columns: list[Projected] = []
    members: list[tuple[int, ...]] = []
    for block in blocks:
        first = len(columns)
        columns += [project(basis, theta, block, c) for c in range(block.values.shape[1])]
        members.append(tuple(range(first, len(columns))))
    counted = 2 * sum(int(np.count_nonzero(block.weights)) for block in blocks)
    free = max(counted - basis.size - basis.linear * len(columns), 1)
    scale = sum(float(c.residual @ c.residual) for c in columns) / free
    noise = [
        np.stack([_complex(columns[i].residual) for i in member], axis=1) for member in members
    ]
    lags = _line_correlation(noise)
    shared = tuple(_shared(part) for part in noise)
    square = sum((c.orthogonal.T @ c.orthogonal for c in columns), np.zeros((basis.size,) * 2))
    # without poles there is nothing to invert
    inverse = np.linalg.pinv(square, hermitian=True) if basis.size else square
    middle = np.zeros_like(square)
    crossed: list[Array] = []
    for member, together in zip(members, shared, strict=True):
        slopes = np.stack([_complex(columns[i].orthogonal) for i in member])
        # J_b^H C_ba X_a summed over b
        mixed = (together.T.conj() @ slopes.reshape(len(member), -1)).reshape(slopes.shape)
        for i, slope, mix in zip(member, slopes, mixed, strict=True):
            middle += meat(mix, slope, lags)
            crossed.append(scale * inverse @ meat(mix, _complex(columns[i].inverse), lags))
    middle = 0.5 * (middle + middle.T)
    return Worth(
        covariance=scale * inverse @ middle @ inverse,
        columns=tuple(columns),
        members=tuple(members),
        scale=scale,
        degrees_of_freedom=free,
        lags=lags,
        shared=shared,
        crossed=tuple(crossed),
    )


def _line_correlation(noise: Sequence[Complex]) -> Complex:
    """Correlation of the residual with itself some lines on, as far as it stands out."""
    power = sum(float(np.sum(np.abs(part) ** 2)) for part in noise)
    size = sum(part.size for part in noise)
    correlation = np.zeros(_LAGS, dtype=np.complex128)
    if power == 0.0:
        return correlation[:0]
    for lag in range(1, _LAGS + 1):
        correlation[lag - 1] = (
            sum(np.sum(part[:-lag] * part[lag:].conj()) for part in noise) / power
        )
    out = np.abs(correlation) * math.sqrt(size) > _SIGNIFICANT
    if not out[0]:
        return correlation[:0]
    # up to the first that does not stand out
    correlation = correlation[: int(np.argmin(out)) if not out.all() else _LAGS]
    # neighbours that cancel leave so little that their correlation is not known well enough for it
    return correlation if correlation.real.sum() > 0.0 else correlation[:0]


def _shared(noise: Complex) -> Complex:
    """Correlation of the residuals of responses that were measured together."""
    lines, count = noise.shape
    size = np.sqrt(np.sum(np.abs(noise) ** 2, axis=0))
    if count == 1 or np.any(size == 0.0):
        return np.eye(count, dtype=np.complex128)
    unit = noise / size
    together = unit.T @ unit.conj()
    others = np.abs(together - np.diag(np.diagonal(together)))
    pairs = 0.5 * count * (count - 1)
    # the largest of that many correlations by chance
    if others.max() * math.sqrt(lines) < math.sqrt(math.log(pairs) + _SIGNIFICANT**2):
        return np.eye(count, dtype=np.complex128)
    return together


def frequencies_of(basis: ModalBasis, theta: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and dampings without the window's, and their slopes by theta."""
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


def residues_of(
    basis: ModalBasis,
    theta: Array,
    worth: Worth,
    parts: Sequence[Prepared],
    mode: int,
    names: tuple[tuple[str, ...], tuple[str, ...]],
) -> tuple[Complex, Array]:
    """Return residues over all outputs and inputs, and the covariance of their parts in turn."""
    weights = basis.residue_weights(theta, mode)
    turn = np.stack([weights.real, weights.imag], axis=1)
    columns = slice(basis.per_mode * mode, basis.per_mode * (mode + 1))
    slopes = _weight_slopes(basis, theta, mode)
    residues, follow, crossed, influence = [], [], [], []
    for column, cross in zip(worth.columns, worth.crossed, strict=True):
        factors = column.factors[columns]
        residues.append(weights @ factors)
        moved = np.stack([(slopes @ factors).real, (slopes @ factors).imag])
        follow.append(moved - turn.T @ (column.inverse.T @ column.jacobian)[columns])
        crossed.append(cross[:, columns] @ turn)
        stacked = column.inverse[:, columns] @ turn
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
    has_weight = total > 0.0
    mean[has_weight] /= total[has_weight][:, None]
    merged = np.where(has_weight, mean @ residues, np.nan + 0.0j)
    both = np.kron(mean, np.eye(2))
    return merged.reshape(len(outputs), len(inputs)), both @ matrix[:size, :size] @ both.T


# with more damping than this a pole lifts its response by less than 1.75 above that at standstill
_MOST_DAMPING = 0.3
# half-power widths of a broad mode within which a sharper one may be all that it stands for
_FLANK = 2.0


def listed_modes(
    poles: Sequence[Mode],
    parts: Sequence[Prepared],
    band: tuple[float, float],
    frequencies: int | Sequence[float] | None,
    scale: float,
) -> tuple[list[int], dict[str, list[Mode]]]:
    """Tell modes from poles that stand for something else.

    A mode is inside the band, has a peak, and is known within the width of that peak or the
    distance of lines. Others stand for modes beyond the band, a drift, an amplifier or a
    nonlinearity. All are modes where a number was `wanted`; else those near the frequencies [Hz].
    `scale` is the mean square of noise over that of the weights. Returned are numbers of the modes,
    and the others by the reason against them.
    """
    if isinstance(frequencies, int):
        return list(range(len(poles))), {}
    if frequencies is not None:
        listed = sorted({_nearest(poles, frequency) for frequency in frequencies})
        rest = [mode for n, mode in enumerate(poles) if n not in listed]
        return listed, {"not requested": rest} if rest else {}
    names = names_of(parts)
    lines = np.sort(np.concatenate([part.measured.frequency_hz for part in parts]))
    listed = []
    others: dict[str, list[Mode]] = {}
    # least reduction of the sum of squares by a mode, next to its line, over noise
    least_gain = 25.0
    for n, mode in enumerate(poles):
        f, zeta = mode.frequency_hz, mode.damping_ratio
        width = max(2.0 * zeta.value * f.value, line_spacing(lines, f.value))
        if not band[0] <= f.value <= band[1]:
            reason = "outside the band"
        elif zeta.value + min(zeta.expanded, zeta.value) > _MOST_DAMPING:
            reason = "damping too high for a peak"
        elif f.expanded > width:
            reason = "frequency uncertain by more than its width"
        elif _beside(mode, parts, names, scale) < least_gain:
            reason = "on a single line"
        elif any(on_flank(mode, other) for other in poles):
            reason = "on the flank of a sharper mode"
        else:
            listed.append(n)
            continue
        others.setdefault(reason, []).append(mode)
    return listed, others


def on_flank(mode: Mode, other: Mode) -> bool:
    """Return whether a mode is within the width of a sharper one, and always below its flank."""
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
    listed, rising = places
    peaks = {*listed, *listed_modes(poles, parts, band, None, worth.scale)[0]}
    gone = [rising[n] for n in range(len(poles)) if n not in peaks]
    out = list(poles)
    if not gone:
        return out
    fewer, start = without(basis, theta, gone)
    values = frequencies_of(fewer, minimise(fewer, start, blocks, rough=True)[0], 0.0)[0]
    left = [r for r in range(basis.count) if r not in gone]
    for n in listed:
        other = 2 * left.index(rising[n])
        mode = out[n]
        f, zeta = (
            full.plus(
                Component(name="background", uncertainty=abs(full.value - v) / 1.95, kind="B")
            )
            for full, v in (
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
        if part.has_final_weights and not part.has_variance:
            # weights that were chosen do not say where the noise is: the lines do
            relative_scatter = (part.scatter / part.deviation) ** 2
            noise = np.maximum(noise, relative_scatter.reshape(noise.shape))
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
            f"there is no mode within {100.0 * near:g} % of {frequency:g} Hz: guess another "
            "frequency, or fit another band"
        )
    return int(np.argmin(off))


def not_listed(others: dict[str, list[Mode]]) -> list[str]:
    """Return a note on the poles that are not listed."""
    if not others:
        return []
    groups = []
    for reason, modes in sorted(others.items()):
        figures = [(mode.frequency_hz.value, 100.0 * mode.damping_ratio.value) for mode in modes]
        poles_text = ", ".join(f"{f:.4g} Hz with {zeta:.2g} % damping" for f, zeta in figures)
        groups.append(f"{poles_text} ({reason})")
    return [f"poles of the fit that are not listed as modes: {'; '.join(groups)}"]


def names_of(parts: Sequence[Prepared]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of all outputs and of all inputs, each once."""
    outputs = dict.fromkeys(name for part in parts for name in part.measured.outputs)
    inputs = dict.fromkeys(name for part in parts for name in part.measured.inputs)
    return tuple(outputs), tuple(inputs)


def line_spacing(lines: Array, frequency: float) -> float:
    """Return the distance of rising lines about a frequency [Hz]."""
    at = int(np.clip(np.searchsorted(lines, frequency), 1, lines.size - 1))
    return float(lines[at] - lines[at - 1])
