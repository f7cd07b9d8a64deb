"""Modes of a stage from its measured frequency responses, each with its uncertainty."""

import math
from collections.abc import Sequence
from typing import Any, Literal

from flexstage.errors import ModelError
from flexstage.measure.modal.assembly import assembled
from flexstage.measure.modal.basis import ModalBasis, reference_frequency
from flexstage.measure.modal.mode_search import search, search_with_sensor, settled, steady_phase
from flexstage.measure.modal.prepare import prepared
from flexstage.measure.modal.result import ModalFit
from flexstage.measure.spectra.response import MeasuredResponse


def fit_modes(
    responses: MeasuredResponse | Sequence[MeasuredResponse],
    *,
    band: tuple[float, float] | None = None,
    count: int | Literal["auto"] | None = "auto",
    frequency_guess: Sequence[float] | None = None,
    delay: bool = False,
    lag: bool = False,
    weighting: Literal["variance", "uniform", "relative"] = "variance",
    residuals: bool = True,
    real_modes: bool = False,
    added_damping_rate: float = 0.0,
    motion: Literal["displacement", "velocity", "acceleration"] | None = None,
    orders: Sequence[int] | None = None,
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
        frequencies.
    band : tuple of float, optional
        Ends of the band [Hz]; all frequencies above 0 where not given.
    count : int or "auto", optional
        Number of modes; "auto" or None takes those without which the residual would grow by more
        than noise explains (Schwarz 1978).
    frequency_guess : sequence of float, optional
        Frequencies near those of the modes [Hz]; of the fit, the modes nearest to them are given.
    delay : bool
        Whether a common delay exp(-i omega tau) of the outputs is fitted too.
    lag : bool
        Whether a common lag 1 / (1 + i omega T) of the outputs is fitted too.
    weighting : {"variance", "uniform", "relative"}
        Whether lines count by the variance they come with, all alike until the fit shows their
        noise, or by the inverse of their magnitude, down to where they scatter.
    residuals : bool
        Whether there are terms for modes beyond the band.
    real_modes : bool
        Whether residues are those of proportional damping, in phase with all others; a delay or lag
        is hard to tell from complex modes in a narrow band without it.
    added_damping_rate : float
        Decay rate that an exponential window exp(-rate t) has added to all poles [1/s]: it is taken
        off.
    motion : {"displacement", "velocity", "acceleration"}, optional
        What the outputs measure whose unit does not say it; displacement where not given. It bears
        on residues and on the terms for other modes.
    orders : sequence of int, optional
        Orders of the polynomials of the start.

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
        The fit did not settle.

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
    given = [responses] if isinstance(responses, MeasuredResponse) else list(responses)
    if not given:
        raise ModelError("a modal fit needs one response at least, got none")
    wanted = _wanted(count, frequency_guess)
    edges = _edges(given, band)
    outside = [g for g in frequency_guess or () if not edges[0] <= g <= edges[1]]
    if outside:
        raise ModelError(
            f"guessed frequencies must lie in the band from {edges[0]:g} to {edges[1]:g} Hz, got "
            f"{outside[0]:g} Hz"
        )
    if not 0.0 <= added_damping_rate < math.inf:
        raise ModelError(
            f"the damping that a window adds must be 0 or more, got {added_damping_rate!r} 1/s"
        )
    reference = reference_frequency(edges)
    parts = prepared(given, edges, weighting, motion, reference)
    template = ModalBasis(
        count=0,
        reference=reference,
        residuals=residuals,
        # with complex residues, modes can have the phase that a delay or lag gives them
        real_modes=real_modes and not (delay or lag),
    )
    options: dict[str, Any] = {
        "orders": orders,
        "band": edges,
        "count": wanted if frequency_guess is None else None,
        "guess": frequency_guess,
    }
    if delay or lag:
        found = search_with_sensor(parts, template, (real_modes, delay, lag), options)
    else:
        found = search(parts, template, **options)
    hints = [] if delay else steady_phase(found.shown, template, parts)
    basis = found.basis
    parts, theta = settled(found.parts, basis, found.theta)
    return assembled(
        basis,
        theta,
        parts,
        band=edges,
        stabilisation=found.stabilisation,
        added_damping_rate=added_damping_rate,
        wanted=wanted if frequency_guess is None else list(frequency_guess),
        hints=hints,
    )


def _wanted(count: int | str | None, guess: Sequence[float] | None) -> int | None:
    if guess is not None:
        if not len(guess) or not all(0.0 < g < math.inf for g in guess):
            raise ModelError(f"guessed frequencies must be positive, got {list(guess)}")
        if count not in (None, "auto", len(guess)):
            raise ModelError(f"{len(guess)} frequencies are guessed but {count} modes asked for")
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
