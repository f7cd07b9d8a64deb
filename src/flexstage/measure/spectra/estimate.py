"""Frequency responses from measured records."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, RecordError
from flexstage.measure.spectra.averaging import (
    CutSpectra,
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
    gathered,
    require_sound,
)
from flexstage.measure.spectra.repeated import find_period, likeness, periodic_response
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.measure.spectra.sums import Estimator, Spectra, require_estimator, transfer
from flexstage.measure.spectra.transient import hammer_spectra, step_spectra
from flexstage.records import Record
from flexstage.records.sampling import extreme_steps

# parts of a sweep have less of their spectra in common than this
_COMMON = 0.3
_PARTS = 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseOptions:
    """How frequency responses are estimated from records."""

    estimator: Estimator = "H1"
    """For noise of the outputs (H1), of the input (H2), or of both (Hv); that of a periodic
    excitation needs none.
    """
    excitation: Excitation = "auto"
    """What excites; found from the first input of the first record where ``auto``."""
    segment: int | None = None
    """Samples of a segment, hit or step."""
    resolution_hz: float | None = None
    """Instead of it, the distance of lines [Hz]."""
    overlap: float | None = None
    """Share of a random segment that the next one has too [1]; one half where not given."""
    window: str | Array = "hann"
    """Window of random segments: ``hann``, ``hamming``, ``blackman``, ``boxcar``, or its values."""
    noise_ratio: float | None = None
    """For Hv: noise power of an output over that of an input [(output unit/input unit)^2]."""
    hits: HitOptions = field(default_factory=HitOptions)
    """How hits and steps are found and cut out."""
    periods: PeriodOptions = field(default_factory=PeriodOptions)
    """How periods are cut out."""
    power_floor: float = 1e-6
    """Lines at which an input has less than this share of the power of its strongest line are left
    out: all of them of a periodic excitation, else those before the first and after the last line
    above [1].
    """
    allow_clipped: bool = False
    """Whether a channel may rest at its least or greatest value."""

    def __post_init__(self) -> None:
        kinds = get_args(Excitation)
        if self.excitation not in kinds:
            raise ModelError(f"an excitation is one of {', '.join(kinds)}, got {self.excitation!r}")
        if not 0.0 <= self.power_floor < 1.0:
            raise ModelError(
                f"a share of the power is from 0 to less than 1, got {self.power_floor!r}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseEstimate:
    """An estimated frequency response, and how it was come by."""

    response: MeasuredResponse
    """The response."""
    spectra: Spectra
    """The averaged spectra behind it, at the same frequencies."""
    excitation: Excitation
    """Kind of excitation that was taken."""
    segment: int
    """Samples of a segment, hit or period."""
    added_damping_rate: float = 0.0
    """Rate by which an exponential window makes every motion of the response decay faster [1/s]: to
    be taken off the decay rates of its modes.
    """
    left_out: tuple[str, ...] = ()
    """Hits that were left out, and why."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


def estimate_response(
    records: Record | Sequence[Record],
    inputs: str | int | Sequence[str | int],
    outputs: str | int | Sequence[str | int],
    options: ResponseOptions | None = None,
    **asked: Any,
) -> ResponseEstimate:
    """Return the frequency responses from inputs to outputs, averaged over records.

    How the records are cut depends on what excites: *random* into overlapping windowed segments
    (Welch, 1967); *periodic* into whole periods without a window, those left out in which the
    motion settles; *hammer* into hits; *step* into steps, of which the differences are taken;
    *sweep* not at all. See `transfer` for the estimators and their variance, `periodic_response`
    for that of repeated periods.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of the same channels at the same rate.
    inputs, outputs : str, int or sequence
        The channels, by name or number.
    options : ResponseOptions, optional
        Estimator, excitation, segments and window.
    **asked
        Fields of `ResponseOptions`, in place of those of `options`.

    Returns
    -------
    ResponseEstimate
        The response, without the lines at 0 and at half the sample rate, and how it was come by.

    Validity
    --------
    A linear system that does not change. The lines of random segments must be narrower than its
    resonances, some four to the half-power width with a Hann window, or peaks come out low and
    wide, which the variance does not contain; `fit_modes` undoes it to second order, by
    `MeasuredResponse.blur`. A hit or a sweep must be over, and its motion
    decayed, at the end of the segment; before a step the motion rests, and creep is not told from
    slow response.

    Raises
    ------
    RecordError
        Records are not over even times, not finite, dead or cut off, too short, or without hit,
        period or step; the inputs cannot be told apart.
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
    >>> found = estimate_response(record, "u", "y", resolution_hz=10.0)
    >>> h = found.response
    >>> print(f"{h.frequency_hz[0]:.0f} Hz: {abs(h.response[0, 0, 0]):.3e} m/V")
    10 Hz: 4.990e-06 m/V
    """
    signals = gathered(
        [records] if isinstance(records, Record) else list(records),
        _listed(inputs),
        _listed(outputs),
    )
    how = replace(options or ResponseOptions(), **asked)
    require_estimator(how.estimator, signals.inputs, how.noise_ratio)
    kind, notes = _kind(signals, how)
    if kind in {"hammer", "step"} and signals.inputs > 1:
        raise ModelError(
            f"a {kind} has one input, got {signals.inputs}: estimate the responses one by one"
        )
    if kind == "periodic":
        return _periodic(signals, how, notes)
    sizes, rate, length = signals.sizes, signals.sample_rate_hz, how.segment
    if kind == "sweep":
        cut = CutSpectra(spectra=whole_spectra(signals), segment=sizes[0])
    elif kind == "random":
        length = segment_length(sizes, rate, length, how.resolution_hz, resolving=True)
        hop = hop_of(length, how.window, how.overlap)
        spectra = welch_spectra(signals, length, how.window, hop, allow_clipped=how.allow_clipped)
        cut = CutSpectra(spectra=spectra, segment=length)
    else:
        if length is not None or how.resolution_hz is not None:
            length = segment_length(sizes, rate, length, how.resolution_hz)
        work = hammer_spectra if kind == "hammer" else step_spectra
        cut = work(signals, how.hits, length)
    done = _completed(signals, kind, cut, how, notes)
    if kind != "random":
        return done
    blur = window_blur(window_values(how.window, cut.segment))
    return replace(done, response=replace(done.response, blur=blur))


def _listed(columns: str | int | Sequence[str | int]) -> list[str | int]:
    return [columns] if isinstance(columns, str | int) else list(columns)


def _kind(signals: Signals, how: ResponseOptions) -> tuple[Excitation, list[str]]:
    """Kind of excitation, having looked at the channels where its averaging does not."""
    if how.excitation == "random":
        return "random", []
    ends = all_extremes(signals)
    require_sound(signals, ends, allow_clipped=True)
    kind, notes = how.excitation, []
    if kind == "auto":
        kind = recognised(signals.channels[0][0], step_allowed=signals.inputs == 1)
        notes = [f"taken as {kind} excitation"]
    # single hits that are cut off are left out later, and a step rests where it went
    if kind in {"periodic", "sweep"}:
        require_sound(signals, ends, allow_clipped=how.allow_clipped)
    return kind, notes


def _periodic(signals: Signals, how: ResponseOptions, notes: list[str]) -> ResponseEstimate:
    found = periodic_response(signals, how.periods, how.power_floor)
    dropped = ", ".join(map(str, found.dropped))
    notes = [
        *notes,
        f"{found.spectra.segments} periods of {found.period} samples, after {dropped} left out",
    ]
    response = _measured(
        signals, found.spectra, found.response, found.variance, found.coherence, "", notes
    )
    return ResponseEstimate(
        response=response,
        spectra=found.spectra,
        excitation="periodic",
        segment=found.period,
        notes=tuple(notes),
    )


def _completed(
    signals: Signals,
    kind: Excitation,
    cut: CutSpectra,
    how: ResponseOptions,
    notes: list[str],
) -> ResponseEstimate:
    spectra = _excited(cut.spectra, cut.segment, how.power_floor)
    h, variance, coherence = transfer(spectra, how.estimator, how.noise_ratio)
    if variance is None:
        notes = [*notes, "too few averages to separate noise from response"]
    if cut.added_damping_rate > 0.0:
        rate = f"{cut.added_damping_rate:.6g}"
        notes = [*notes, f"an exponential window adds {rate} 1/s to every decay rate"]
    said = notes
    if cut.left_out:
        said = [*notes, f"{len(cut.left_out)} left out: {'; '.join(cut.left_out)}"]
    return ResponseEstimate(
        response=_measured(signals, spectra, h, variance, coherence, how.estimator, said),
        spectra=spectra,
        excitation=kind,
        segment=cut.segment,
        added_damping_rate=cut.added_damping_rate,
        left_out=cut.left_out,
        notes=tuple(notes),
    )


def _excited(spectra: Spectra, segment: int, power_floor: float) -> Spectra:
    """The lines between the first and the last that the inputs excite."""
    # at 0 and at half the sample rate transforms are real, and the mean has been taken off
    stop = (segment - 1) // 2 + 1
    power = np.einsum("kii->ki", spectra.input_power[1:stop]).real
    strong = np.all((power > power_floor * power.max(axis=0)) & (power > 0.0), axis=1)
    lines = 1 + np.flatnonzero(strong)
    if lines.size < 2:
        raise RecordError(
            f"the inputs excite {lines.size} lines of {stop - 1}: take longer segments, or other "
            "columns as inputs"
        )
    kept = np.arange(lines[0], lines[-1] + 1)
    # power of a line, relative to that of the strongest, that rounding gives
    rounding = 1e-26
    # within, lines without any power but that of rounding have no response
    kept = kept[np.all(power[kept - 1] > rounding * power.max(axis=0), axis=1)]
    return replace(
        spectra,
        frequency_hz=spectra.frequency_hz[kept],
        input_power=spectra.input_power[kept],
        cross=spectra.cross[kept],
        output_power=spectra.output_power[kept],
    )


def _measured(
    signals: Signals,
    spectra: Spectra,
    response: Complex,
    variance: Array | None,
    coherence: Array | None,
    estimator: str,
    notes: list[str],
) -> MeasuredResponse:
    q = signals.inputs
    return MeasuredResponse(
        frequency_hz=spectra.frequency_hz,
        response=response,
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


def recognised(values: Array, *, step_allowed: bool = True) -> Excitation:
    """Say what kind of excitation a signal is.

    Hammer: it leaves its median for less than 2 % of the time. Step: its differences do, and it
    stays where it went. Periodic: it repeats itself after less than half of the record, and of its
    first million samples. Sweep: the spectra of its sixteenths have little in common. Random: none
    of these. Steps and hits have one input, and are not looked for among several.

    Examples
    --------
    >>> recognised(np.random.default_rng(1).standard_normal(4096))
    'random'
    """
    # samples in which a period is looked for
    look = 1_048_576
    x = values[:look]
    # samples that are looked at together, which stay in the cache
    piece = 65_536
    if step_allowed:
        middle = float(np.median(x))
        largest = max(float(values.max()) - middle, middle - float(values.min()))
        # a step soon after the start is rare as well, but does not come back
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
        r = likeness(x)
        last = (r.size - 1) // period * period
        # what merely swings for a while is unlike itself after many swings
        if min(r[period], r[last]) > 0.95:
            return "periodic"
    return "sweep" if _moves(values) else "random"


def _rare(pieces: Iterable[Array], size: int, largest: float) -> bool:
    """Whether few of so many numbers are more than a tenth of the largest."""
    # pulses take up less of the time than this, above a tenth of their height
    rare = 0.02
    most, count = max(rare * size, 2), 0
    for piece in pieces:
        count += int(np.count_nonzero(np.abs(piece) > 0.1 * largest))
        if count >= most:
            return False
    return largest > 0.0


def _moves(values: Array) -> bool:
    """Whether the spectrum moves along the record."""
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
    alike = (shape @ shape.T)[np.triu_indices(int(loud.sum()), 1)]
    return float(np.median(alike)) < _COMMON
