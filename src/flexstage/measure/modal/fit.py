"""Modes of a stage from its measured frequency responses, each with its uncertainty."""

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.measure.modal.assessment import (
    Worth,
    assess,
    frequencies_of,
    line_spacing,
    listed_modes,
    names_of,
    not_listed,
    residues_of,
    with_and_without,
)
from flexstage.measure.modal.mode_search import (
    likelier,
    search,
    search_with_sensor,
    settled,
    steady_phase,
)
from flexstage.measure.modal.mode_selection import significances, threshold
from flexstage.measure.modal.prepare import Prepared, prepared
from flexstage.measure.modal.result import (
    FittedResponse,
    ModalFit,
    Mode,
    noisy_estimate,
    shape_from_residues,
)
from flexstage.measure.modal.stabilisation import Stabilisation
from flexstage.measure.modal.variable_projection import (
    ModalBasis,
    reference_frequency,
)
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.quantities.estimate import Estimate


def fit_modes(
    responses: MeasuredResponse | Sequence[MeasuredResponse],
    *,
    band: tuple[float, float] | None = None,
    count: int | Literal["auto"] | None = "auto",
    frequency_guess: Sequence[float] | None = None,
    delay: bool | None = None,
    lag: bool = False,
    weighting: Literal["variance", "uniform", "relative"] = "variance",
    real_modes: bool = False,
    added_damping_rate: float = 0.0,
) -> ModalFit:
    """Fit natural frequencies, damping ratios, residues and mode shapes to frequency responses.

    A least-squares complex frequency estimate (`stable_poles`) is the start. From there poles,
    which all responses share, and residues, each response its own, with a constant and a term
    1/omega^2 for modes beyond the band, are those of greatest likelihood for the variance of each
    line (Guillaume, Verboven and Vanlanduit, 1998, ISMA 23): Gauss-Newton on the poles, with the
    residues projected out (Golub and Pereyra, 1973). Covariances are those of the linearised fit at
    its end, times the reduced chi-square; where the residual is correlated from line to line, or
    between outputs, that correlation is in them.

    Without variances, the noise of each response is modelled as ``a + b |H|^2``, of which a and b
    are found from the residual.

    Parameters
    ----------
    responses : MeasuredResponse or sequence of MeasuredResponse
        One or several, as of roving sensors, repeated records or several inputs; each with its own
        frequencies. Outputs whose unit is none of motion count as displacements, which bears on
        residues and on the terms for other modes.
    band : tuple of float, optional
        Ends of the band [Hz]; all frequencies above 0 where not given.
    count : int or "auto", optional
        Number of modes; "auto" or None takes those without which the residual would grow by more
        than noise explains (Schwarz 1978).
    frequency_guess : sequence of float, optional
        Frequencies near those of the modes [Hz]: these are fitted, with terms for modes beyond the
        band, and other poles only where they explain half of what these leave. Of those that are no
        modes themselves, as an amplifier's, the interval holds the fit with and without.
    delay : bool, optional
        Whether a common delay exp(-i omega tau) of the outputs is fitted too; where not given and
        the number of modes is "auto", it is, with residues in phase, if that explains more.
    lag : bool
        Whether a common lag 1 / (1 + i omega T) of the outputs is fitted too.
    weighting : {"variance", "uniform", "relative"}
        Weights of the lines: by their variance or else by the noise from the fit, uniform, or by
        the inverse of their magnitude, down to their scatter.
    real_modes : bool
        Whether residues are those of proportional damping, in phase with all others; a delay or lag
        is hard to tell from complex modes in a narrow band without it.
    added_damping_rate : float
        Decay rate that an exponential window exp(-rate t) has added to all poles [1/s]: it is taken
        off.

    Returns
    -------
    ModalFit
        Modes, each with its uncertainty, and the fitted response. There are none where no pole
        stands out of the noise.

    Validity
    --------
    Linear, time-invariant, lightly to moderately damped (found at up to 30 % of critical), modes at
    least about one half-power bandwidth apart. Errors of the lines are taken as normal and free of
    bias. Lines that a window has mixed (`MeasuredResponse.blur`) are parted to second order first,
    which is enough where a peak has three lines or more in its half-power width. Uncertainties
    contain noise alone: no calibration, no loading by sensors.

    Raises
    ------
    RecordError
        Too few lines are in the band, an output is dead, or a variance is impossible.
    ModelError
        An option is impossible, or fewer poles are found than modes were asked for.
    ConvergenceError
        The fit did not converge.

    Examples
    --------
    >>> import numpy as np
    >>> f = np.arange(2.0, 400.0, 0.5)
    >>> s, poles = 2j * np.pi * f, (-4.7 + 541.0j, -21.0 + 1330.0j)
    >>> clean = sum(1 / ((s - p) * (s - p.conjugate())) for p in poles)
    >>> rng = np.random.default_rng(1)
    >>> noise = 9e-7 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    >>> measured = MeasuredResponse(
    ...     frequency_hz=f, response=(clean + noise)[:, None, None], inputs=("force",),
    ...     outputs=("table",), output_units=("m",))
    >>> for mode in fit_modes(measured).modes:
    ...     fn, zeta = mode.frequency_hz, mode.damping_ratio
    ...     print(f"{fn.value:.3f} +- {fn.expanded:.3f} Hz, {100 * zeta.value:.3f} %")
    86.104 +- 0.006 Hz, 0.870 %
    211.644 +- 0.150 Hz, 1.572 %
    """
    listed = [responses] if isinstance(responses, MeasuredResponse) else list(responses)
    if not listed:
        raise ModelError("a modal fit needs at least one response, got none")
    targets = _target_count(count, frequency_guess)
    edges = _edges(listed, band)
    outside = [g for g in frequency_guess or () if not edges[0] <= g <= edges[1]]
    if outside:
        raise ModelError(
            f"guessed frequencies must be in the band from {edges[0]:g} to {edges[1]:g} Hz, got "
            f"{outside[0]:g} Hz"
        )
    if not 0.0 <= added_damping_rate < math.inf:
        raise ModelError(
            f"the added damping of a window must be 0 or more, got {added_damping_rate!r} 1/s"
        )
    reference = reference_frequency(edges)
    parts = prepared(listed, edges, weighting, reference)
    template = ModalBasis(
        count=0,
        reference=reference,
        # with complex residues, modes can have the phase that a delay or lag gives them
        real_modes=real_modes and not (delay or lag),
    )
    options: dict[str, Any] = {
        "band": edges,
        "count": targets if frequency_guess is None else None,
        "guess": frequency_guess,
    }
    if delay or lag:
        match = search_with_sensor(parts, template, (real_modes, bool(delay), lag), options)
    else:
        match = search(parts, template, **options)
    falls = "" if delay else steady_phase(match.local_poles, template, parts)
    hints = [f"{falls}: fit a delay as well"] if falls else []
    if falls and delay is None and not lag and targets is None:
        with progress.subtask(0.85, 0.9):
            late = search_with_sensor(parts, template, (True, True, False), options)
        if likelier(late, match):
            match, hints = late, [f"{falls}: it is fitted too, with real modes"]
    basis = match.basis
    parts, theta = settled(match.parts, basis, match.theta)
    return _assembled(
        basis,
        theta,
        parts,
        band=edges,
        stabilisation=match.stabilisation,
        added_damping_rate=added_damping_rate,
        targets=targets if frequency_guess is None else list(frequency_guess),
        hints=hints,
    )


def _target_count(count: int | str | None, guess: Sequence[float] | None) -> int | None:
    if guess is not None:
        if not len(guess) or not all(0.0 < g < math.inf for g in guess):
            raise ModelError(f"guessed frequencies must be positive, got {list(guess)}")
        if count not in (None, "auto", len(guess)):
            raise ModelError(f"{len(guess)} frequencies are guessed, but {count} modes requested")
        return len(guess)
    if count is None or count == "auto":
        return None
    if isinstance(count, str | bool) or count < 1:
        raise ModelError(f"the number of modes must be 'auto' or 1 and more, got {count!r}")
    return int(count)


def _edges(
    responses: Sequence[MeasuredResponse], band: tuple[float, float] | None
) -> tuple[float, float]:
    positive = [r.frequency_hz[r.frequency_hz > 0.0] for r in responses]
    low, high = min(float(f[0]) for f in positive), max(float(f[-1]) for f in positive)
    if band is None:
        return low, high
    if not 0.0 <= band[0] < band[1]:
        raise ModelError(f"a band must rise from 0 Hz or more, got {band[0]!r} to {band[1]!r} Hz")
    return max(low, float(band[0])), min(high, float(band[1]))


def _assembled(
    basis: ModalBasis,
    theta: Array,
    parts: Sequence[Prepared],
    *,
    band: tuple[float, float],
    stabilisation: Stabilisation | None,
    added_damping_rate: float,
    targets: int | Sequence[float] | None,
    hints: Sequence[str],
) -> ModalFit:
    """Make the result of a fit.

    `added_damping_rate` [1/s] is subtracted. Without `targets`, a number or frequencies [Hz], poles
    that are no modes of the stage are omitted from the list.
    """
    blocks = [part.block for part in parts]
    worth = assess(basis, theta, blocks)
    strength = significances(basis, theta, blocks) if basis.count else np.zeros(0)
    outputs, inputs = names_of(parts)
    values, slopes = frequencies_of(basis, theta, added_damping_rate)
    covariance = slopes @ worth.covariance @ slopes.T
    rate = max(part.measured.rate_uncertainty for part in parts)
    poles = []
    rising = [int(r) for r in np.argsort(values[::2], kind="stable")]
    for r in rising:
        residues, matrix = residues_of(basis, theta, worth, parts, r, (outputs, inputs))
        shape, spread = shape_from_residues(residues, matrix)
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
                significance=float(strength[r]),
            )
        )
    listed, others = listed_modes(poles, parts, band, targets, worth.scale)
    if targets is not None and not isinstance(targets, int) and others:
        poles = with_and_without(poles, basis, theta, blocks, (listed, rising), parts, band, worth)
    modes = [poles[n] for n in listed]
    parameters = [2 * rising[n] + d for n in listed for d in (0, 1)]
    covariance = covariance[np.ix_(parameters, parameters)]
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
    if targets is not None:
        needed = threshold(basis, blocks)
        notes += [
            f"the mode at {mode.frequency_hz.value:.5g} Hz does not exceed the noise"
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
        deviation = np.where(np.isfinite(part.deviation), part.deviation, 0.0)
        rms = np.abs(complex_residual) * deviation / math.sqrt(2.0)
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
    largest = max(float(one.residual_rms.max()) for one in fitted)
    # residual, as a share of a response, from which a note reports it
    unexplained = 0.2
    if largest > unexplained and modes:
        notes.append(
            f"the residual is {100.0 * largest:.0f} % of a response: fit it in a narrower band, "
            "with a delay, or with complex modes, and check that input and output are not swapped"
        )
    if not modes:
        notes.append(_no_mode_note(parts))
    if not any(part.has_variance for part in parts):
        notes.append("the variance is estimated from the residuals, as none is given")
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
        spacing = min(line_spacing(part.measured.frequency_hz, f) for part in parts)
        if 0.0 < width < 2.0 * spacing:
            doubt = "due to the window" if windowed else "inaccurate"
            notes.append(
                f"the peak at {f:.5g} Hz is {width:.2g} Hz wide, with lines {spacing:.2g} Hz "
                f"apart: its damping may be {doubt}"
            )
    if all(part.has_variance for part in parts) and worth.scale > 2.0:
        notes.append(
            f"the residual is {math.sqrt(worth.scale):.2g} times the stated noise: the model is "
            "incomplete; the uncertainties are increased by this factor"
        )
    if worth.lags.size:
        notes.append("noise of neighbouring lines is correlated: the uncertainties include this")
    if any(not np.array_equal(c, np.eye(c.shape[0])) for c in worth.shared):
        notes.append("noise of the responses is correlated: the uncertainties include this")
    return notes


def _no_mode_note(parts: Sequence[Prepared]) -> str:
    """Return a note that no mode was found, with the largest peak of the responses."""
    peaks = []
    for part in parts:
        size = np.abs(part.measured.response).reshape(part.measured.frequency_hz.size, -1)
        above = size / np.maximum(np.median(size, axis=0), 1e-300)
        line, column = np.unravel_index(np.argmax(above), above.shape)
        half = int(np.count_nonzero(size[:, column] > size[line, column] / math.sqrt(2.0)))
        peaks.append((float(above[line, column]), float(part.measured.frequency_hz[line]), half))
    ratio, frequency, lines = max(peaks)
    # over its median, a response of noise alone has no line as high as this
    peak = 5.0
    if ratio < peak:
        return "no mode exceeds the noise in the band"
    return (
        f"no decaying mode explains the response, which peaks at {frequency:.5g} Hz, {ratio:.2g} "
        f"times its median, with {lines} line{'s' * (lines > 1)} above half of its power: use "
        "longer segments if these are few, or fit that peak in a band about it"
    )
