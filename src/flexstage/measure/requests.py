"""Requests for frequency responses and modes, and for an uncertainty budget."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from flexstage.base.errors import ModelError
from flexstage.files.ranges import INNER_SHARE, POSITIVE, PositiveFrequency, Seed, Written
from flexstage.files.request import Request, read_number, request_fields
from flexstage.quantities.units import DIMENSIONS
from flexstage.records.read_options import ONE_COLUMN, ColumnList

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
