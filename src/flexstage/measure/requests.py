"""What is asked of records of vibration: responses and modes."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from flexstage.errors import ModelError
from flexstage.files.ranges import INNER_SHARE, POSITIVE, Range, Seed, Written
from flexstage.files.request import Request, request_fields
from flexstage.records.read_options import ColumnList, columns_text, read_columns
from flexstage.units import DIMENSIONS

_FREQUENCY = Annotated[float, DIMENSIONS["frequency"], POSITIVE]
_ONE = Written("COLUMN", read=read_columns, write=columns_text)
_UNIT = Annotated[str, Written("UNIT")]


def read_count(text: str) -> int | str:
    """Return a number of modes, or auto."""
    word = text.strip().lower()
    if word != "auto" and not word.isdecimal():
        raise ModelError(f"must be a number or auto, got '{text}'")
    return word if word == "auto" else int(word)


def read_trials(text: str) -> int | str:
    """Return a number of trials, which may be written as 1e6, or auto."""
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

    input: Annotated[ColumnList, _ONE] = ()
    """Number or name of the input column (default: of a record over time the one in N, else in V,
    or called so).
    """
    output: ColumnList = ()
    """Numbers or names of the output columns, separated by commas (default: those in units of
    motion, or called so).
    """
    response: Annotated[tuple[str, ...], Written("COLUMNS", commas=True)] = ()
    """Columns of a measured response, if the headings do not name them: frequency, real and
    imaginary part, "0,1,2", or magnitude and phase, "0,1 dB,2 deg".
    """
    estimator: Literal["H1", "H2", "Hv"] = "H1"
    """H1 for noise in the outputs, H2 for noise in the input, Hv for both."""
    excitation: Literal["auto", "random", "periodic", "hammer", "step", "sweep"] = "auto"
    """Kind of excitation; auto recognises it from the input."""
    resolution: Annotated[_FREQUENCY, Written(bare="Hz")] | None = None
    """Frequency resolution, such as "0.5 Hz"."""
    segment: Annotated[int, Range(low=8)] | None = None
    """Samples of a segment, instead of --resolution."""
    window: Annotated[str, Written("NAME")] = "hann"
    """Window of random segments: hann, hamming, blackman, boxcar."""
    exponential: Annotated[float, Written("SHARE")] | None = None
    """For hammer tests: value of the exponential window at the end of a hit; the damping that it
    adds is subtracted.
    """
    band: (
        Annotated[tuple[float, float], DIMENSIONS["frequency"], POSITIVE, Written(bare="Hz")] | None
    ) = None
    """Band in which modes are fitted, such as "200:800" in Hz or "0.2 kHz:0.8 kHz"."""
    fit_modes: Annotated[int | Literal["auto"], Written("NUMBER|auto", read=read_count)] = "auto"
    """Number of modes to fit; 0 for none."""
    near: Annotated[tuple[_FREQUENCY, ...], Written("FREQUENCIES", bare="Hz", commas=True)] = ()
    """Fit modes near these frequencies alone, such as "365,660" in Hz."""
    weight: Literal["noise", "relative", "uniform"] = "noise"
    """Weight of the frequency lines: noise, by their variance or the residual of the fit; relative,
    by the inverse of their magnitude, for responses over decades; uniform.
    """
    fit_delay: bool = False
    """Also fit a delay of the outputs; --fit-modes auto tries it where the phase falls as of one.
    """
    fit_lag: bool = False
    """Also fit a first-order lag of the outputs."""
    complex: bool = False
    """With --fit-delay or --fit-lag: fit complex modes, for damping that is not proportional; needs
    a wide band.
    """
    ring_down: bool = False
    """The record is a free decay: outputs only, no input."""
    input_unit: _UNIT | None = None
    """Unit of the input, such as "V" or "N"."""
    output_unit: _UNIT | None = None
    """Unit of the output, such as "um" or "m/s^2"."""

    def __post_init__(self) -> None:
        super(FrfRequest, self).__post_init__()
        if self.ring_down:
            self._require_no_drive()
        if self.complex and not (self.fit_delay or self.fit_lag):
            raise ModelError(
                "--complex applies to fits with --fit-delay or --fit-lag, which assume real modes "
                "otherwise; without them all modes are complex: leave it out"
            )
        if self.near and self.fit_modes not in ("auto", len(self.near)):
            raise ModelError(
                f"--fit-modes {self.fit_modes} and --near with {len(self.near)} frequencies "
                "differ: leave --fit-modes out"
            )
        if self.response and (self.input or self.output):
            raise ModelError(
                "--response names columns of a response that exists, --input and --output those of "
                "a record over time: give one or the other"
            )

    def _require_no_drive(self) -> None:
        """Refuse what a free decay has no use for."""
        used = ("output", "output_unit", "fit_modes", "ring_down")
        idle = [
            field.option
            for name, field in request_fields(FrfRequest).items()
            if name not in used and getattr(self, name) != field.default
        ]
        if idle:
            raise ModelError(
                f"{', '.join(idle)} has no meaning with --ring-down, which fits outputs alone: "
                "leave it out"
            )
        if self.fit_modes == 0:
            raise ModelError("--ring-down fits modes and nothing else: leave --fit-modes 0 out")
