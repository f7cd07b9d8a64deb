"""Frequency responses from measured records."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.spectra.averaging import (
    SegmentSpectra,
    hop_of,
    segment_length,
    welch_spectra,
    whole_spectra,
    window_blur,
    window_values,
)
from flexstage.measure.spectra.checks import (
    Excitation,
    HitOptions,
    PeriodOptions,
    Signals,
    all_extremes,
    gather_signals,
    require_sound,
)
from flexstage.measure.spectra.repeated import (
    find_period,
    hammer_spectra,
    periodic_response,
    self_similarity,
    step_spectra,
)
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.measure.spectra.sums import Estimator, Spectra, require_estimator, transfer
from flexstage.records import Record
from flexstage.records.sampling import extreme_steps

# largest correlation between the spectra of parts of a sweep
_COMMON = 0.3
_PARTS = 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseOptions:
    """Options of the estimation of frequency responses from records."""

    estimator: Estimator = "H1"
    """H1 for noise in the outputs, H2 for noise in the input, Hv for both; not used for periodic
    excitation.
    """
    excitation: Excitation = "auto"
    """Kind of excitation; ``auto`` recognises it from the first input of the first record."""
    segment: int | None = None
    """Samples of a segment, hit or step."""
    resolution_hz: float | None = None
    """Instead of a segment, the frequency resolution [Hz]."""
    overlap: float | None = None
    """Overlap of random segments, as a share of their length [1]; one half if not given."""
    window: str | Array = "hann"
    """Window of random segments: ``hann``, ``hamming``, ``blackman``, ``boxcar``, or its values."""
    noise_ratio: float | None = None
    """For Hv: noise power of an output over that of an input [(output unit/input unit)^2]."""
    hits: HitOptions = field(default_factory=HitOptions)
    """Detection and segmentation of hits and steps."""
    periods: PeriodOptions = field(default_factory=PeriodOptions)
    """Segmentation of periods."""
    power_floor: float = 1e-6
    """Share of the power of the strongest line of an input [1]. Weaker lines of a periodic
    excitation are omitted; of others, those before the first and after the last stronger line.
    """
    allow_clipped: bool = False
    """Whether a channel may rest at its least or greatest value."""

    def __post_init__(self) -> None:
        kinds = get_args(Excitation)
        if self.excitation not in kinds:
            raise ModelError(
                f"the excitation must be one of {', '.join(kinds)}, got {self.excitation!r}"
            )
        if not 0.0 <= self.power_floor < 1.0:
            raise ModelError(
                f"the power floor must be from 0 to less than 1, got {self.power_floor!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseEstimate:
    """Estimated frequency response, with its spectra and segments."""

    response: MeasuredResponse
    """The response."""
    spectra: Spectra
    """The averaged spectra behind it, at the same frequencies."""
    excitation: Excitation
    """Kind of excitation."""
    segment: int
    """Samples of a segment, hit or period."""
    added_damping_rate: float = 0.0
    """Decay rate that an exponential window adds to every mode [1/s]: subtract it from the decay
    rates of the modes.
    """
    rejected: tuple[str, ...] = ()
    """Rejected hits, with reasons."""
    notes: tuple[str, ...] = ()
    """Remarks on the estimate."""


def estimate_response(
    records: Record | Sequence[Record],
    inputs: str | int | Sequence[str | int],
    outputs: str | int | Sequence[str | int],
    options: ResponseOptions | None = None,
    **fields: Any,
) -> ResponseEstimate:
    """Return the frequency responses from inputs to outputs, averaged over records.

    The segmentation of the records depends on the excitation: *random* has overlapping windowed
    segments (Welch, 1967); *periodic* has full periods without a window, except settling ones;
    *hammer* has hits; *step* has the differences of steps; *sweep* is one segment. See `transfer`
    for the estimators and their variance, `periodic_response` for that of periods.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of the same channels at the same rate.
    inputs, outputs : str, int or sequence
        The channels, by name or number.
    options : ResponseOptions, optional
        Estimator, excitation, segments and window.
    **fields
        Fields of `ResponseOptions`, in place of those of `options`.

    Returns
    -------
    ResponseEstimate
        The response, without the lines at 0 and at half the sample rate, and its spectra.

    Validity
    --------
    A linear time-invariant system. The lines of random segments must be narrower than its
    resonances, about four in the half-power width with a Hann window. Otherwise peaks are low and
    wide, a bias that the variance does not include; `fit_modes` corrects it to second order, by
    `MeasuredResponse.blur`. A hit or a sweep must be over, and its motion decayed, at the end of
    the segment. Before a step the stage must be at rest; creep is not separated from slow response.

    Raises
    ------
    RecordError
        Records are not uniformly sampled, not finite, constant or clipped, too short, or without
        hit, period or step; the inputs are not separable.
    ModelError
        The options contradict each other.

    Examples
    --------
    >>> from flexstage.records import Channel
    >>> u = np.random.default_rng(1).standard_normal(20_000)
    >>> y = 3e-6 * u + 2e-6 * np.roll(u, 1)
    >>> record = Record(
    ...     channels=(Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m")),
    ...     time=np.arange(u.size) / 1e3,
    ... )
    >>> h = estimate_response(record, "u", "y", resolution_hz=10.0).response
    >>> print(f"{h.frequency_hz[0]:.0f} Hz: {abs(h.response[0, 0, 0]):.3e} m/V")
    10 Hz: 4.990e-06 m/V
    """
    signals = gather_signals(
        [records] if isinstance(records, Record) else list(records),
        _listed(inputs),
        _listed(outputs),
    )
    settings = replace(options or ResponseOptions(), **fields)
    require_estimator(settings.estimator, signals.inputs, settings.noise_ratio)
    kind, notes = _kind(signals, settings)
    if kind in {"hammer", "step"} and signals.inputs > 1:
        raise ModelError(
            f"a {kind} has one input, got {signals.inputs}: estimate the responses one by one"
        )
    if kind == "periodic":
        return _periodic(signals, settings, notes)
    sizes, rate, length = signals.sizes, signals.sample_rate_hz, settings.segment
    if kind == "sweep":
        cut = SegmentSpectra(spectra=whole_spectra(signals), segment=sizes[0])
    elif kind == "random":
        length = segment_length(sizes, rate, length, settings.resolution_hz, resolving=True)
        hop = hop_of(length, settings.window, settings.overlap)
        spectra = welch_spectra(
            signals, length, settings.window, hop, allow_clipped=settings.allow_clipped
        )
        cut = SegmentSpectra(spectra=spectra, segment=length)
    else:
        if length is not None or settings.resolution_hz is not None:
            length = segment_length(sizes, rate, length, settings.resolution_hz)
        work = hammer_spectra if kind == "hammer" else step_spectra
        cut = work(signals, settings.hits, length)
    estimate = _estimate(signals, kind, cut, settings, notes)
    if kind != "random":
        return estimate
    blur = window_blur(window_values(settings.window, cut.segment))
    return replace(estimate, response=replace(estimate.response, blur=blur))


def _listed(columns: str | int | Sequence[str | int]) -> list[str | int]:
    return [columns] if isinstance(columns, str | int) else list(columns)


def _kind(signals: Signals, options: ResponseOptions) -> tuple[Excitation, list[str]]:
    """Return the kind of excitation, after the checks of channels that averaging does not do."""
    if options.excitation == "random":
        return "random", []
    ends = all_extremes(signals)
    require_sound(signals, ends, allow_clipped=True)
    kind, notes = options.excitation, []
    if kind == "auto":
        kind = recognise_excitation(signals.channels[0][0], step_allowed=signals.inputs == 1)
        notes = [f"recognised as {kind} excitation"]
    # clipped hits are rejected later, and a step rests at its new level
    if kind in {"periodic", "sweep"}:
        require_sound(signals, ends, allow_clipped=options.allow_clipped)
    return kind, notes


def _periodic(signals: Signals, options: ResponseOptions, notes: list[str]) -> ResponseEstimate:
    periodic = periodic_response(signals, options.periods, options.power_floor)
    settling = ", ".join(map(str, periodic.dropped))
    notes = [
        *notes,
        f"{periodic.spectra.segments} periods of {periodic.period} samples, {settling} settling "
        "periods omitted",
    ]
    response = _measured(
        signals,
        periodic.spectra,
        periodic.response,
        periodic.variance,
        periodic.coherence,
        "",
        notes,
    )
    return ResponseEstimate(
        response=response,
        spectra=periodic.spectra,
        excitation="periodic",
        segment=periodic.period,
        notes=tuple(notes),
    )


def _estimate(
    signals: Signals,
    kind: Excitation,
    cut: SegmentSpectra,
    options: ResponseOptions,
    notes: list[str],
) -> ResponseEstimate:
    spectra = _excited(cut.spectra, cut.segment, options.power_floor)
    h, variance, coherence = transfer(spectra, options.estimator, options.noise_ratio)
    if variance is None:
        notes = [*notes, "too few averages to separate noise from response"]
    if cut.added_damping_rate > 0.0:
        rate = f"{cut.added_damping_rate:.6g}"
        notes = [*notes, f"an exponential window adds {rate} 1/s to every decay rate"]
    response_notes = notes
    if cut.rejected:
        response_notes = [*notes, f"{len(cut.rejected)} rejected: {'; '.join(cut.rejected)}"]
    return ResponseEstimate(
        response=_measured(
            signals, spectra, h, variance, coherence, options.estimator, response_notes
        ),
        spectra=spectra,
        excitation=kind,
        segment=cut.segment,
        added_damping_rate=cut.added_damping_rate,
        rejected=cut.rejected,
        notes=tuple(notes),
    )


def _excited(spectra: Spectra, segment: int, power_floor: float) -> Spectra:
    """Return the spectra between the first and the last excited line."""
    # at 0 and at half the sample rate transforms are real, and the mean was subtracted
    stop = (segment - 1) // 2 + 1
    power = np.einsum("kii->ki", spectra.input_power[1:stop]).real
    strong = np.all((power > power_floor * power.max(axis=0)) & (power > 0.0), axis=1)
    lines = 1 + np.flatnonzero(strong)
    if lines.size < 2:
        raise RecordError(
            f"the inputs excite {lines.size} of {stop - 1} lines: use longer segments, or other "
            "columns as inputs"
        )
    band = np.arange(lines[0], lines[-1] + 1)
    # power of rounding errors, relative to the strongest line
    rounding = 1e-26
    # lines in the band whose only power is rounding have no response
    band = band[np.all(power[band - 1] > rounding * power.max(axis=0), axis=1)]
    return replace(
        spectra,
        frequency_hz=spectra.frequency_hz[band],
        input_power=spectra.input_power[band],
        cross=spectra.cross[band],
        output_power=spectra.output_power[band],
    )


def _measured(
    signals: Signals,
    spectra: Spectra,
    h: Complex,
    variance: Array | None,
    coherence: Array | None,
    estimator: str,
    notes: list[str],
) -> MeasuredResponse:
    q = signals.inputs
    return MeasuredResponse(
        frequency_hz=spectra.frequency_hz,
        response=h,
        inputs=signals.names[:q],
        outputs=signals.names[q:],
        input_units=signals.units[:q],
        output_units=signals.units[q:],
        variance=variance,
        coherence=coherence,
        averages=spectra.averages,
        estimator=estimator,
        source=", ".join(s.strip("'") for s in signals.sources),
        notes=tuple(notes),
        rate_uncertainty=signals.rate_uncertainty,
    )


def recognise_excitation(values: Array, *, step_allowed: bool = True) -> Excitation:
    """Return the kind of excitation of a signal.

    Hammer: it leaves its median for less than 2 % of the time. Step: its differences do, and it
    stays at its new level. Periodic: its period is less than half of the record, and of its first
    million samples. Sweep: the spectra of its sixteenths have little in common. Random: none of
    these. Steps and hits have one input, and are not expected with several.

    Examples
    --------
    >>> recognise_excitation(np.random.default_rng(1).standard_normal(4096))
    'random'
    """
    # largest number of samples for the search for a period
    look = 1_048_576
    x = values[:look]
    # samples per block, which fits in the cache
    piece = 65_536
    if step_allowed:
        middle = float(np.median(x))
        largest = max(float(values.max()) - middle, middle - float(values.min()))
        # a step soon after the start is rare too, but does not return
        back = max(abs(values[0] - middle), abs(values[-1] - middle)) <= 0.1 * largest
        starts = range(0, values.size, piece)
        if back and _rare((values[i : i + piece] - middle for i in starts), values.size, largest):
            return "hammer"
        low, high = extreme_steps(values)
        steps = (np.diff(values[i : i + piece + 1]) for i in starts)
        if _rare(steps, values.size - 1, max(-low, high)):
            return "step"
    try:
        period = find_period(x)
    except RecordError:
        period = 0
    if period:
        r = self_similarity(x)
        last = (r.size - 1) // period * period
        # a decaying oscillation is not similar to itself after many periods
        if min(r[period], r[last]) > 0.95:
            return "periodic"
    return "sweep" if _moves(values) else "random"


def _rare(pieces: Iterable[Array], size: int, largest: float) -> bool:
    """Return whether few of the numbers exceed a tenth of the largest."""
    # share of the time that pulses exceed a tenth of their height
    rare = 0.02
    most, count = max(rare * size, 2), 0
    for piece in pieces:
        count += int(np.count_nonzero(np.abs(piece) > 0.1 * largest))
        if count >= most:
            return False
    return largest > 0.0


def _moves(values: Array) -> bool:
    """Return whether the spectrum changes along the record."""
    length = values.size // _PARTS
    if length < 64:
        return False
    # every part in a moderate length, so that a long record costs no more
    take = min(length, 4096)
    parts = values[: _PARTS * length].reshape(_PARTS, length)[:, :take]
    power = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * np.hanning(take))) ** 2
    bands = np.add.reduceat(power, np.arange(0, power.shape[1], max(1, take // 64)), axis=1)
    norm = np.linalg.norm(bands, axis=1)
    # before and after a sweep there may be quiet
    loud = norm > 1e-3 * norm.max()
    if loud.sum() < 4:
        return False
    shape = bands[loud] / norm[loud, None]
    common = (shape @ shape.T)[np.triu_indices(int(loud.sum()), 1)]
    return float(np.median(common)) < _COMMON
