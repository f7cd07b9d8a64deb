"""Requests of analyses and studies of a stage."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from flexstage.base.errors import ModelError, UnitError
from flexstage.files.ranges import INNER_SHARE, POSITIVE, Range, Seed, Written
from flexstage.files.request import Request
from flexstage.hinges.requests import Plane
from flexstage.hysteresis.requests import AmplifierLimits, ModeTolerance, Voltages
from flexstage.quantities.units import DIMENSIONS, Time, parse, readable
from flexstage.quantities.units.dimension import MEASURED
from flexstage.stage.bench import Bench
from flexstage.system.requests import ModelName, ModelNames

if TYPE_CHECKING:
    from flexstage.files.cache.cache import Cache
    from flexstage.stage import Stage
else:  # their classes need NumPy, which the help of a command does not import
    Cache = Stage = object

#: Parts of a study in addition to the models of a stage.
StudyPart = Literal["identification", "virtual", "traditional", "none"]
ALL_PARTS: tuple[StudyPart, ...] = ("identification", "virtual", "traditional")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions(Request):
    """Options of a model."""

    plane: Plane = "auto"
    """Plane state of the notches."""
    accuracy: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Refine the mesh of the plane or solid model until --quantity changes by less than this share,
    such as 0.1%.
    """
    quantity: Annotated[str, Written("NAME")] = "natural_frequency_hz"
    """Quantity for --accuracy, such as max_stress."""
    estimate: bool = False
    """Estimate the error of each figure, with bodies of a lower order and with more modes
    (superelement models; doubles the time of the first analysis).
    """
    supports: Literal["rigid", "elastic"] = "rigid"
    """Rigid or elastic frame under the reactions of the drives (all models except lumped)."""
    stroke: bool = False
    """Compute each axis over its stroke with large displacements (plane model): straightness,
    stiffening, buckling.
    """
    bench: Bench | None = None
    """Base plate and sensor holder, for the thermal drift with the drives in place, instead of
    those of the stage file: "base=aluminium,holder=invar,holder_length=60 mm".
    """
    cache: Cache | bool = field(default=True, compare=False)
    """Cache of condensed bodies of superelements, True for the user's cache."""
    near: Stage | None = field(default=None, compare=False)
    """A similar stage, whose superelements are reused for equal bodies."""


def _read_rate(text: str) -> float | str:
    """Return a frequency [Hz], or the word natural."""
    if text.strip().lower() == "natural":
        return "natural"
    try:
        return parse(text, "frequency", bare_unit="Hz")
    except UnitError as error:
        raise UnitError(f"{error}; or natural") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class StackOptions(Request):
    """Stacks at work, if a rate is given."""

    heading: ClassVar[str] = "Stacks"

    rate: Annotated[float | str, Written("RATE|natural", read=_read_rate)] | None = None
    """Also print the working line of each stack, and what its amplifier must give for a sine at
    this rate, such as "50 Hz", or at the natural frequency of its axis.
    """
    voltage: Voltages | None = None
    """Voltage range of the sine, such as "0:100" (default: that of the stack)."""
    amplifier: AmplifierLimits = AmplifierLimits()
    """Limits of the amplifier, such as "slew=2000 V/s,current=50 mA" (default: current=0.3 A, the
    slew and the capacitance of the stack).
    """
    loss_factor: Annotated[float, INNER_SHARE, Written("SHARE")] | None = None
    """Dielectric loss factor of the stacks, for their heat."""
    thermal_resistance: Annotated[float, POSITIVE, Written("K/W")] | None = None
    """Rise of temperature of a stack over its heat [K/W]."""

    def __post_init__(self) -> None:
        super(StackOptions, self).__post_init__()
        rate = self.rate
        above = isinstance(rate, int | float) and not isinstance(rate, bool) and rate > 0.0
        if not (rate is None or rate == "natural" or above):
            raise ModelError(f"rate must be a frequency above 0, or natural, got '{rate}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyseRequest(Request):
    """Analysis of a stage by one or several models."""

    model: ModelNames = ("superelement",)
    """Models, separated by commas, or all."""
    options: ModelOptions = ModelOptions()
    """Options of each model."""
    stacks: StackOptions = StackOptions()
    """Stacks at work."""
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget: also print the rms of every axis by
    source, without position control.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRequest(Request):
    """Study: models of a stage compared with published values."""

    model: ModelNames = ("lumped", "superelement", "plane", "superelement-3d")
    """Models, separated by commas, or all."""
    plane: Plane = "auto"
    """Plane state of the notches."""
    parts: Annotated[tuple[StudyPart, ...], Written("NAMES", commas=True)] = ALL_PARTS
    """Further parts, separated by commas: identification (identify and compensate the hysteresis of
    piezo drives on a simulated stage), virtual (simulate measurements of the stage, and the
    centring of an encoder scale), traditional (compare motion errors and drift of a stage of the
    study with those of traditional stages); or none.
    """
    seed: Seed = 1
    """Random seed of the simulated stage, and of manufactured samples."""
    widths: Annotated[str, Written("FILE")] | None = None
    """Measured necks, as of tolerance: bias and scatter of the simulated stage, and scatter of
    manufactured samples.
    """
    environment: Path | None = None
    """Description of disturbances in YAML, as of budget, for the rms of every axis by source
    (default: an assumed laboratory of a stage of the study, unless without further parts).
    """

    @classmethod
    def of_models(cls, *model: ModelName) -> "StudyRequest":
        """Return a study of models without further parts."""
        return cls(model=model, parts=("none",))


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleRequest(Request):
    """Stages that a rotary table needs to centre its scale."""

    stage: Annotated[tuple[str, ...], Written("NAME")] = ()
    """Stage to judge, a file or a built-in design (default: all built-in designs that move along x
    and y).
    """
    model: ModelName = "lumped"
    """Model of the stages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRequest(Request):
    """Comparison of measurements of a stage with models and published values."""

    model: ModelNames = ("lumped", "superelement")
    """Models, separated by commas, or all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRequest(Request):
    """Dynamic error budget of a stage."""

    environment: Path
    """Description of the disturbances in YAML: sources, band, points of interest."""
    loop: Annotated[tuple[str, ...], Written("LOOP")] = ()
    """Position control to compare with the open stage: a crossover of integral control with a notch
    such as "100 Hz", tune for the largest gain with margins, or a file of a loop.
    """
    axis: Annotated[str, Written("NAME")] | None = None
    """Axis under control (default: the first)."""
    exposure: Annotated[Time, POSITIVE] | None = None
    """Also print moving average and moving standard deviation of this duration, such as "10 ms"."""
    duration: Annotated[Time, POSITIVE] | None = None
    """Also print the largest value expected in this time, such as "10 s", and how far the rms of a
    record of it scatters.
    """
    wanted_rms: Annotated[float, DIMENSIONS["length"], POSITIVE, Written(bare="m")] | None = None
    """Also print the smallest bandwidth that reaches this rms, such as "3 nm", by the gain of the
    last loop.
    """
    model: ModelName = "lumped"
    """Model of the stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettleRequest(Request):
    """Settling of a move from rest to rest."""

    move: Annotated[float, DIMENSIONS["length"], POSITIVE, Written(bare="m")]
    """Distance, such as "10 um", about the middle of the voltage range."""
    within: Annotated[float, DIMENSIONS["length"], POSITIVE, Written(bare="m")] | None = None
    """Largest distance from the end of the move, on both sides (default: a thousandth of it)."""
    modes: Annotated[int, Range(low=1, high=4)] = 1
    """Number of modes that the shapers suppress, those that move the probe most."""
    modal_fit: Annotated[str, Written("FILE")] | None = None
    """Result of `flexstage frf --json`: the shapers are those of its modes, and the tolerance is
    their expanded uncertainty.
    """
    tolerance: ModeTolerance = ModeTolerance()
    """Tolerance over which settling scatters, such as "frequency=1 %,damping=30 %"."""
    amplifier: AmplifierLimits = AmplifierLimits()
    """Limits of the amplifier, such as "current=100 mA" (default: those of the stage)."""
    acceleration: Annotated[float, MEASURED["acceleration"], POSITIVE] | None = None
    """Largest acceleration of jerk-limited and minimum-time moves (default: that at which the drive
    would lose its preload).
    """
    servo_rate: Annotated[
        float, DIMENSIONS["frequency"], Range(low=1e3, high=50e3), Written(bare="Hz")
    ] = 10e3
    """Rate of the servo loop and of the commands, such as "10 kHz"."""
    model: Literal["lumped", "superelement"] = "lumped"
    """Model of the mechanics: rigid bodies, or condensed finite elements."""

    def __post_init__(self) -> None:
        super(SettleRequest, self).__post_init__()
        if not self.band < self.move:
            raise ModelError(
                f"a move of {readable('m', self.move)} needs a smaller distance from its end, got "
                f"{readable('m', self.band)}: reduce --within"
            )

    @property
    def band(self) -> float:
        """Largest distance from the end of the move [m]."""
        return 1e-3 * self.move if self.within is None else self.within
