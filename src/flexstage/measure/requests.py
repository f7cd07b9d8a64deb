"""Requests for frequency responses and modes, and for an uncertainty budget."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from flexstage.base.errors import ModelError
from flexstage.files.ranges import (
    INNER_SHARE,
    NOT_NEGATIVE,
    POSITIVE,
    PositiveFrequency,
    Range,
    Seed,
    Written,
)
from flexstage.files.request import Request, read_number, request_fields
from flexstage.quantities.units import DIMENSIONS, Time
from flexstage.records.read_options import ONE_COLUMN, ColumnList
from flexstage.system.requests import ModelName

#: The excitation of a free decay.
RING_DOWN = "ring-down"


def read_count(text: str) -> int | str:
    """Return a number of modes, or auto."""
    word = text.strip().lower()
    if word != "auto" and not word.isdecimal():
        raise ModelError(f"must be a number or auto, got '{text}'")
    return word if word == "auto" else int(word)


def read_trials(text: str) -> int | str:
    """Return a number of trials, also in the form 1e6, or auto."""
    word = text.strip().lower()
    if word == "auto":
        return word
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number == int(number)):
        raise ModelError(f"must be a whole number or auto, got '{text}'")
    return int(number)


#: Windows of random segments (`measure.spectra.averaging.WINDOWS`, which needs NumPy).
_WINDOWS = ("hann", "hamming", "blackman", "boxcar")


def _exponential(window: str) -> float | None:
    """Return the final value of an exponential window; None for another window."""
    name, _, share = window.strip().partition(" ")
    if name != "exponential":
        if window not in _WINDOWS:
            raise ModelError(
                f"the window '{window}' is unknown: use one of {', '.join(_WINDOWS)}, or "
                'exponential with its value at the end of a hit, such as "exponential 5 %"'
            )
        return None
    value = read_number(share, 'the value of the window at the end of a hit, such as "5 %"')
    if not 0.0 < value < 1.0:
        raise ModelError(f"--window exponential needs a final value between 0 and 1, got {share}")
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyRequest(Request):
    """Propagation of an uncertainty budget."""

    trials: Annotated[int | Literal["auto"], Written("NUMBER|auto", read=read_trials)] = "auto"
    """Number of Monte Carlo trials; auto draws until two digits of the uncertainty are stable."""
    seed: Seed = 0
    """Random seed of the trials."""
    confidence: Annotated[float, INNER_SHARE, Written("SHARE")] = 0.95
    """Coverage probability of the intervals, 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrfRequest(Request):
    """Frequency responses and modes of records."""

    input: Annotated[ColumnList, ONE_COLUMN] = ()
    """Number or name of the input column (default, for a record over time: the column in N, else in
    V, by its unit or name).
    """
    output: ColumnList = ()
    """Numbers or names of the output columns, separated by commas (default: the columns in units of
    motion, by their units or names).
    """
    response: Annotated[tuple[str, ...], Written("COLUMNS", commas=True)] = ()
    """Columns of a measured response, if the headings do not name them: frequency, real and
    imaginary part, "0,1 um/V,2 um/V", or magnitude and phase, "0,1 dB,2 deg".
    """
    estimator: Literal["H1", "H2", "Hv"] = "H1"
    """H1 for noise in the outputs, H2 for noise in the input, Hv for both."""
    excitation: Literal["auto", "random", "periodic", "hammer", "step", "sweep", "ring-down"] = (
        "auto"
    )
    """Kind of excitation; auto recognises it from the input; ring-down is a free decay, with
    outputs only.
    """
    resolution: PositiveFrequency | None = None
    """Frequency resolution, such as "0.5 Hz"."""
    window: Annotated[str, Written("NAME")] = "hann"
    """Window of random segments: hann, hamming, blackman, boxcar; or of hammer hits, such as
    "exponential 5 %", with its value at the end of a hit; its added damping is subtracted.
    """
    band: (
        Annotated[tuple[float, float], DIMENSIONS["frequency"], POSITIVE, Written(bare="Hz")] | None
    ) = None
    """Frequency band of the modal fit, such as "200:800" in Hz or "0.2 kHz:0.8 kHz"."""
    fit_modes: Annotated[int | Literal["auto"], Written("NUMBER|auto", read=read_count)] = "auto"
    """Number of modes to fit; 0 for none."""
    near: Annotated[
        tuple[PositiveFrequency, ...], Written("FREQUENCIES", bare="Hz", commas=True)
    ] = ()
    """Fit only modes near these frequencies, such as "365,660" in Hz."""
    weight: Literal["noise", "relative", "uniform"] = "noise"
    """Weight of the frequency lines: noise, by their variance or the residual of the fit; relative,
    by the inverse of their magnitude, for responses over decades; uniform.
    """
    fit: Annotated[
        tuple[Literal["delay", "lag", "complex"], ...], Written("NAMES", commas=True)
    ] = ()
    """Additional parameters to fit, separated by commas: delay (of the outputs; --fit-modes auto
    tries it if the phase suggests one), lag (first order, of the outputs), and with either complex
    (modes, for nonproportional damping; needs a wide band).
    """

    def __post_init__(self) -> None:
        super(FrfRequest, self).__post_init__()
        if self.excitation == RING_DOWN:
            self._require_no_drive()
        if self.fit == ("complex",):
            raise ModelError(
                "--fit complex needs delay or lag, which otherwise assume real modes; without them "
                "all modes are complex: omit it"
            )
        _exponential(self.window)
        if self.near and self.fit_modes not in ("auto", len(self.near)):
            raise ModelError(
                f"--fit-modes {self.fit_modes} contradicts --near with {len(self.near)} "
                "frequencies: omit --fit-modes"
            )
        if self.response and (self.input or self.output):
            raise ModelError(
                "--response names columns of a measured response, --input and --output columns of "
                "a record over time: give one or the other"
            )

    @property
    def exponential(self) -> float | None:
        """Value of an exponential window at the end of a hit; None for another window."""
        return _exponential(self.window)

    def _require_no_drive(self) -> None:
        """Refuse options that do not apply to a free decay."""
        used = ("output", "fit_modes", "excitation")
        idle = [
            field.option
            for name, field in request_fields(FrfRequest).items()
            if name not in used and getattr(self, name) != field.default
        ]
        if idle:
            raise ModelError(
                f"{', '.join(idle)} does not apply to --excitation ring-down, which has outputs "
                "only: omit it"
            )
        if self.fit_modes == 0:
            raise ModelError(
                "--fit-modes 0 does not apply to --excitation ring-down, which only fits modes: "
                "omit it"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneRequest(Request):
    """Position control from a stage or measured frequency responses."""

    frf: Annotated[tuple[str, ...], Written("FILE")] = ()
    """Measured frequency response, or record of input and output over time, in place of STAGE; give
    the option again for each repetition.
    """
    axis: Annotated[str, Written("NAME")] | None = None
    """Axis of STAGE (default: the first)."""
    model: ModelName = "lumped"
    """Model of STAGE."""
    input: Annotated[ColumnList, ONE_COLUMN] = ()
    """Number or name of the input column of a record over time."""
    output: ColumnList = ()
    """Number or name of its output column."""
    response: Annotated[tuple[str, ...], Written("COLUMNS", commas=True)] = ()
    """Columns of a response, if the headings do not name them, as of frf: "0,1 um/V,2 um/V"."""
    repeated: bool = False
    """Several responses of a file repeat one measurement."""
    resolution: PositiveFrequency | None = None
    """Frequency resolution of records over time, such as "0.5 Hz"."""
    uncertainty: Annotated[float, Range(low=0.0, high=1.0, below=True), Written("SHARE")] | None = (
        None
    )
    """Relative uncertainty of the response at all lines (default: by variance or coherence in the
    file, else none for repeated measurements, else 10 %, as tuning from a model assumes for gain).
    """
    coverage: Annotated[float, INNER_SHARE, Written("SHARE")] = 0.95
    """Coverage of the uncertainty at each line, 0 to 1, by variance or coherence."""
    averages: Annotated[int, Range(low=1)] = 1
    """Number of averages behind a coherence, if the file does not state it."""
    shift: Annotated[float, Range(low=0.0, high=0.5, below=True), Written("SHARE")] | None = None
    """Relative shift of all frequencies, up and down (default: 3 % for one measurement, as tuning
    from a model assumes for its modes; 0 for several).
    """
    control: Literal[
        "auto", "integral", "pi", "damping", "pid", "lead", "double-integral", "ppf", "iff",
        "h-infinity",
    ] = "auto"  # fmt: skip
    """Structure, with notches at resonances: integral, pi, damping (pi with a low-pass), pid (with
    filtered derivative), lead (no integral), double-integral (pi with a second one); auto chooses.
    ppf and iff damp the resonance by an inner loop: positive position feedback, integral force
    feedback (with the force in the stack as the second output). h-infinity adds filters to integral
    and pi that let the stage err most.
    """
    decouple: Annotated[
        float, DIMENSIONS["frequency"], NOT_NEGATIVE, Written(bare="Hz")
    ] | None = None  # fmt: skip
    """Control all axes, decoupled by a constant matrix from the responses at this frequency, such
    as "0 Hz" for those of the lowest line.
    """
    goal: Literal["rejection", "noise", "bandwidth"] = "rejection"
    """Least error after small steps of the drive, least rms by its white noise, which damps the
    resonance most, or largest bandwidth, best for iff, which rejects errors of the drive anyway.
    """
    servo_rate: PositiveFrequency = 10e3
    """Rate of the loop, such as "10 kHz"."""
    delay: Annotated[Time, NOT_NEGATIVE] | None = None
    """Delay that the response does not contain, such as "0.1 ms" (default: 1.5 samples, one of
    computation and half of the hold; for STAGE one, as its response has the hold).
    """
    gain_margin: Annotated[float, Range(low=1.0, above=True), Written("NUMBER")] = 2.0
    """Smallest gain margin, up and down."""
    phase_margin: Annotated[
        float, DIMENSIONS["angle"], Range(low=0.0, high=0.5 * math.pi, above=True, below=True),
        Written(bare="deg"),
    ] = math.radians(40.0)  # fmt: skip
    """Smallest phase margin."""
    modulus: Annotated[float, Range(low=1.0, above=True), Written("NUMBER")] = 2.0
    """Largest sensitivity Ms, the inverse of the modulus margin."""
    delay_margin: Annotated[Time, NOT_NEGATIVE] = 0.0
    """Smallest delay margin, such as "50 us"."""
    notches: Annotated[int, Range(low=0, high=4)] = 2
    """Largest number of notches."""
    derivative_ratio: Annotated[float, Range(low=1.0, above=True), Written("NUMBER")] = 10.0
    """Pole over zero of the lead, of the derivative and its filter."""
    phase_step: Annotated[
        float, DIMENSIONS["angle"], Range(low=0.0, high=0.5 * math.pi, above=True, below=True),
        Written(bare="deg"),
    ] = math.radians(60.0)  # fmt: skip
    """Largest change of phase between two lines where the loop is large: one mode passes it at
    lines as far apart as half its half-power width, and may be up to 1/cos(step/2) higher.
    """

    @property
    def latency(self) -> float:
        """Delay that the response does not contain [s]."""
        return 1.5 / self.servo_rate if self.delay is None else self.delay
