"""Requests about drives: identification, prediction of records, following a reference."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from flexstage.base.errors import ModelError, UnitError
from flexstage.files.ranges import (
    NOT_NEGATIVE,
    POSITIVE,
    PositiveFrequency,
    Range,
    Seed,
    Written,
)
from flexstage.files.request import Request
from flexstage.quantities.units import DIMENSIONS, parse
from flexstage.quantities.units.dimension import MEASURED
from flexstage.records.read_options import Rows
from flexstage.stage.assumptions import DAMPING_RATIO

#: Lowest and highest voltage [V].
Voltages = Annotated[tuple[float, float], DIMENSIONS["voltage"], Written("LOW:HIGH", bare="V")]
_CURRENT = Annotated[float, MEASURED["current"], POSITIVE]
#: Model of a stage that resonates within the band of its command, identified alone.
OSCILLATOR = "bouc-wen-oscillator"
_SHARE = Range(low=0.0, high=1.0, below=True)
#: Zero of the sensor of an output: one of all records, one of each, or with a linear drift as well.
Zero = Literal["one", "each", "drift"]


def read_after(text: str) -> float | str:
    """Return a time [s], inf for ever, or a word or names of files as they are."""
    if text.strip().lower() == "inf":
        return float("inf")
    try:
        return parse(text, "time", bare_unit="s")
    except UnitError:
        return text.strip()


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownChain(Request):
    """Known values of a drive, which are not identified."""

    one_value: ClassVar[bool] = True

    resonance: PositiveFrequency | None = None
    """Resonance of the stage with its drives in place."""
    damping: Annotated[float, Range(low=1e-4, high=0.9), Written("RATIO")] = DAMPING_RATIO
    """Damping ratio of that resonance."""
    delay: Annotated[float, DIMENSIONS["time"], NOT_NEGATIVE] | None = None
    """Delay of the output; creep is then not fitted either."""
    creep: Annotated[float, _SHARE, Written("SHARE")] | None = None
    """Creep per decade of time; delay is then not fitted either."""

    @property
    def mode(self) -> tuple[float, float] | None:
        """Frequency [Hz] and damping ratio of the known mode."""
        return None if self.resonance is None else (self.resonance, self.damping)

    @property
    def has_lag(self) -> bool:
        """True if delay or creep is known; the other is then zero."""
        return self.delay is not None or self.creep is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyRequest(Request):
    """Identification of the hysteresis, lag, creep and resonance of a drive."""

    model: Annotated[tuple[str, ...], Written("NAME", commas=True)] = ("auto",)
    """A hysteresis model, or several separated by commas, of line, bouc-wen, maxwell-slip,
    modified-prandtl-ishlinskii, preisach (auto tries these five), asymmetric-bouc-wen, dahl, duhem,
    generalised-bouc-wen, prandtl-ishlinskii. The simplest model is chosen that predicts held-out
    cycles as well as the best. bouc-wen-oscillator, alone and on the command line: a stage that
    resonates within the band of its command.
    """
    train: Rows | None = None
    """Samples to fit, numbered from 0 in the whole file; all others are held out (default: all are
    fitted, and held-out errors come from cross-validation over whole cycles).
    """
    known: KnownChain = KnownChain()
    """Known values of the drive, which are not identified, such as "resonance=808 Hz,damping=0.01"
    or "delay=5 ms,creep=1.2 %".
    """
    periodic: bool = False
    """Each record is one whole period of a steady motion, which may begin anywhere (default: where
    it has one major cycle and its first and last row agree).
    """
    zero: Zero = "one"
    """Zero of the output: one of all records; each: every record has its own constant, as of an
    interferometer, an encoder or an AC coupling; drift: and a linear drift. Neither is in the
    model.
    """

    def __post_init__(self) -> None:
        super(IdentifyRequest, self).__post_init__()
        for option, value in (
            ("--train", self.train is not None),
            ("--zero drift", self.zero == "drift"),
        ):
            if self.periodic and value:
                raise ModelError(
                    f"--periodic is for a steady motion without its time: omit {option}"
                )


def rowwise(request: IdentifyRequest) -> IdentifyRequest:
    """Return a request for rows without times, which show neither delay nor creep."""
    known = request.known
    return request if known.has_lag else replace(request, known=replace(known, delay=0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicRequest(Request):
    """Dynamic model of a stage, sample by sample."""

    time_step: Annotated[
        float, DIMENSIONS["time"], Range(low=1e-12, high=1e6), Written(bare="s")
    ] = 1e-4
    """Time between samples."""
    bandwidth: PositiveFrequency | None = None
    """Bandwidth of the amplifiers, such as "2 kHz" (default: no amplifier)."""
    current: _CURRENT | None = None
    """Largest current of the amplifier, such as "50 mA"."""
    keep_modes: Annotated[int, Range(low=1)] | None = None
    """Number of modes to keep (default: all)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierLimits(Request):
    """Limits of the amplifier of a piezo stack."""

    one_value: ClassVar[bool] = True

    slew: (
        Annotated[float, DIMENSIONS["slew rate"], POSITIVE, Written("SLOPE", bare="V/s")] | None
    ) = None
    """Largest slope of the voltage."""
    current: _CURRENT | None = None
    """Largest current, which is the capacitance times the slope."""
    capacitance: Annotated[float, DIMENSIONS["capacitance"], POSITIVE] | None = None
    """Capacitance of the stack."""

    @property
    def largest_rate(self) -> float | None:
        """Largest slope within both limits [V/s]; None if unlimited."""
        rates = [] if self.slew is None else [self.slew]
        if self.current is not None and self.capacitance is not None:
            rates.append(self.current / self.capacitance)
        return min(rates, default=None)

    def require_load(self) -> None:
        """Refuse a limit of the current without a capacitance."""
        if self.current is not None and self.capacitance is None:
            raise ModelError(
                "amplifier: a current limit needs the capacitance of the stack: give both"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExciteRequest(Request):
    """Drive record for the identification of a piezo stage."""

    voltage: Voltages | None = None
    """Voltage range, such as "0:120" (default: that of the stack)."""
    rates: Annotated[
        tuple[PositiveFrequency, ...], Written("FREQUENCIES", bare="Hz", commas=True)
    ] = ()
    """Repetition rates of the major loop, such as "0.5,5" in Hz (default: two, a factor of 10
    apart).
    """
    duration: Annotated[float, DIMENSIONS["time"], POSITIVE, Written(bare="s")] | None = None
    """Longest duration of the record, such as "60 s" (default: as long as its content takes)."""
    sample_rate: Annotated[PositiveFrequency, Written("RATE", bare="Hz")] | None = None
    """Sample rate, such as "10 kHz" (default: as the fastest loop and the multisine require)."""
    amplifier: AmplifierLimits = AmplifierLimits()
    """Limits of the amplifier, such as "slew=2000 V/s,current=50 mA" (default of the capacitance:
    that of the stack of STAGE).
    """
    frequency: PositiveFrequency | None = None
    """Lowest natural frequency with the drives in place (default: that of the lumped model of
    STAGE). Loops stay below a tenth of it, smooth movements begin and end over two of its periods.
    """
    shape: Literal["smooth", "sine", "triangle"] = "smooth"
    """Shape of the voltage between turning points; smooth: the speed has no jumps."""
    hold_time: Annotated[float, DIMENSIONS["time"], NOT_NEGATIVE, Written(bare="s")] | None = None
    """Hold time after the step, for creep; "0 s" for none (default: 12 s, or a fifth of the
    duration).
    """
    rest: Annotated[float, DIMENSIONS["voltage"], Written(bare="V")] | None = None
    """Voltage before and after the record (default: 0 V if within the range)."""
    multisine: bool = True
    """Add a small multisine at the natural frequency."""
    seed: Seed = 0
    """Random seed of the phases of the multisine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictRequest(Request):
    """Prediction of independent records by a model."""

    after: Annotated[float | str, Written("auto|rest|TIME|RECORD", read=read_after)] = "auto"
    """State before the record: rest at the first command; motion for a time, such as "30 s" or inf,
    since the low end of the range; or the end of RECORD, a file with the same columns (several
    separated by commas), after which the records follow one another. auto estimates it from the
    first samples.
    """

    def __post_init__(self) -> None:
        super(PredictRequest, self).__post_init__()
        require_after(self.after, "auto", "rest")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompensateRequest(Request):
    """Command by which a drive follows a reference."""

    relative: bool = False
    """Count the reference from the lowest reading that the drive reaches, and not from the zero of
    the sensor.
    """
    voltage: Voltages | None = None
    """Voltage range of the command, such as "0:120" (default: the range of the identification). Of
    coupled drives: deviations from the operating point, such as "-20:20" (default: the smallest
    largest deviation of an input in their records).
    """
    amplifier: AmplifierLimits = AmplifierLimits()
    """Limits of the amplifier, such as "slew=2000 V/s,current=50 mA,capacitance=6.4 uF"."""
    reference_bandwidth: PositiveFrequency | None = None
    """Bandwidth of the smoothed reference (default: a quarter of the resonance of the model; of
    coupled drives half the band of their records).
    """
    after: Annotated[float | str, Written("conditioned|rest|TIME|RECORD", read=read_after)] = (
        "conditioned"
    )
    """State before the first sample: conditioned by cycles over the whole range that end at its low
    end, with creep as before the record of the model; rest: unused; a time, such as "30 s" or inf:
    conditioned, and then in motion as in the reference for that time; or the end of RECORD, a file
    with time and command (several separated by commas).
    """

    def __post_init__(self) -> None:
        super(CompensateRequest, self).__post_init__()
        require_after(self.after, "conditioned", "rest")
        if self.amplifier.capacitance is not None and self.amplifier.current is None:
            raise ModelError(
                "--amplifier: the capacitance needs the current limit: both limit the slope"
            )
        self.amplifier.require_load()


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeTolerance(Request):
    """Uncertainty of a plant, as half-widths relative to its values."""

    one_value: ClassVar[bool] = True

    frequency: Annotated[float, _SHARE, Written("SHARE")] = 0.03
    """Natural frequencies, all by the same factor."""
    damping: Annotated[float, _SHARE, Written("SHARE")] = 0.2
    """Damping ratios, likewise."""
    inverse: Annotated[float, _SHARE, Written("SHARE")] = 0.01
    """Error that the inverse of the hysteresis leaves, over the move."""


def require_after(after: float | str, *words: str) -> None:
    """Refuse an invalid state before the first sample; a file has an ending."""
    if isinstance(after, str):
        files = earlier_files(after)
        valid = after in words or (bool(files) and all(file.suffix for file in files))
    else:
        valid = isinstance(after, (int, float)) and after is not True and after >= 0.0
    if valid:
        return
    renamed = "; rested is called rest" if after == "rested" else ""
    raise ModelError(
        f"--after must be {', '.join(words)}, a time that is not negative, such as 30 s, or the "
        f"file of a record, got '{after}'{renamed}"
    )


def earlier_files(after: object) -> tuple[Path, ...]:
    """Return the files in a state before the first sample; none for a word or a time."""
    if not isinstance(after, str) or after in ("auto", "conditioned", "rest"):
        return ()
    return tuple(Path(name.strip()) for name in after.split(","))
