r"""The environment of a stage: its disturbances as spectra, and its loop, each from a YAML file.

Every spectrum is a one-sided power spectral density :math:`S_1(f)`, :math:`f \ge 0`, in unit^2/Hz:
the variance is :math:`\int S_1\,df`. A two-sided density over frequency in Hz is half of it. An
amplitude density, in unit/rtHz, is the square root of a density.
"""

import itertools
import math
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from string import Template
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError, UnitError
from flexstage.files.decoder import read, read_file
from flexstage.files.format import Format
from flexstage.files.ranges import (
    NOT_NEGATIVE,
    POSITIVE,
    CountOrZero,
    PositiveFrequency,
    Written,
    require_ranges,
)
from flexstage.quantities.sensor import SensorSpecification
from flexstage.quantities.units import DIMENSIONS, Length, Time, parse, si_unit
from flexstage.records.read_options import TextLayout
from flexstage.records.text import read_text
from flexstage.stage import Stage
from flexstage.system.mechanical import STANDARD_GRAVITY, GroundDirection, MechanicalSystem
from flexstage.system.servo import (
    ForceFeedback,
    InnerLoop,
    Notch,
    PositionFeedback,
    ServoSettings,
)

#: Whether a density counts positive frequencies alone, or negative ones as well.
Sided = Literal["one", "two"]
#: Densities outside the frequencies of a table: refused, or zero.
Outside = Literal["refused", "zero"]

# an exponent is no unit
_QUANTITY = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?![eE][-+]?\d)([^\d\s.].*?)\s*"
)
_AMPLITUDE = re.compile(r"(.+?)/(?:rtHz|√Hz|sqrt\(Hz\)|Hz\^0\.5)")
# m/s^2/Hz could be of a speed or of an acceleration: a quotient has brackets
_POWER = re.compile(r"(?:\(([^()]+)\)|([^()/^]+))\^2/Hz")


@dataclass(frozen=True, slots=True)
class SpectralLevel:
    """A size with its unit."""

    value: float
    """Value, positive [`unit`]; of a density [`unit`^2/Hz]."""
    unit: str
    """SI unit of the quantity."""


def read_level(text: str) -> SpectralLevel:
    """Read a size such as ``1 mV``.

    Examples
    --------
    >>> read_level("1 mV")
    SpectralLevel(value=0.001, unit='V')
    """
    number, unit = _split(text, "a size with its unit, such as '1 mV'")
    factor, si = si_unit(unit)
    return SpectralLevel(factor * number, si)


def read_density(text: str) -> SpectralLevel:
    """Read a density, of amplitude or of power, as one of power.

    Examples
    --------
    >>> read_density("2 nm/rtHz"), read_density("4e-18 m^2/Hz")
    (SpectralLevel(value=4e-18, unit='m'), SpectralLevel(value=4e-18, unit='m'))
    """
    expected = "a density with its unit, such as '0.02 nm/rtHz' or '4e-22 m^2/Hz'"
    number, unit = _split(text, expected)
    factor, si = density_unit(unit, expected)
    return SpectralLevel(factor * (number**2 if _AMPLITUDE.fullmatch(unit) else number), si)


def density_unit(
    text: str, expected: str = "a unit of density, such as m/rtHz"
) -> tuple[float, str]:
    """Return the factor of a unit of density to its power in SI, and the SI unit of the quantity.

    Examples
    --------
    >>> density_unit("mm/s/rtHz"), density_unit("(m/s^2)^2/Hz")
    ((1e-06, 'm/s'), (1.0, 'm/s^2'))
    """
    match = _AMPLITUDE.fullmatch(text) or _POWER.fullmatch(text)
    if match is None:
        brackets = ": write (m/s)^2/Hz or (m/s^2)^2/Hz" if text.endswith("^2/Hz") else ""
        raise UnitError(f"expected {expected}, got '{text[:60]}'{brackets}")
    factor, si = si_unit(match[match.lastindex or 1])
    return factor**2, si


def _split(text: str, expected: str) -> tuple[float, str]:
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UnitError(f"expected {expected}, got '{text[:60]}'")
    number = float(match[1])
    if not 0.0 < number < math.inf:
        raise UnitError(f"expected {expected} and above 0, got '{text[:60]}'")
    return number, match[2]


_LEVEL = Annotated[SpectralLevel, Written("LEVEL", read=read_level)]
_DENSITY = Annotated[SpectralLevel, Written("DENSITY", read=read_density)]


class Spectrum:
    """Base of spectra."""

    __slots__ = ()
    kind: ClassVar[str]

    @property
    def unit(self) -> str:
        """SI unit of the quantity."""
        raise NotImplementedError

    def density(self, f: Array) -> Array:
        """Return the one-sided density at frequencies [Hz], in unit^2/Hz."""
        raise NotImplementedError

    @property
    def jumps(self) -> tuple[float, ...]:
        """Frequencies of its jumps and bends [Hz]."""
        return ()

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Frequency [Hz] and variance [unit^2] of each line."""
        return ()

    def require(self, band: tuple[float, float]) -> None:
        """Refuse values out of range, and a band of frequencies [Hz] on which it is not stated."""
        del band
        require_ranges(self, ModelError, f"a spectrum of kind {self.kind}")

    def loaded(self, folder: Path | None) -> "Spectrum":
        """Return the spectrum with the content of its file in a folder; None refuses files."""
        del folder
        return self


#: rms velocity in a third of an octave [m/s], lowest frequency [Hz], and the acceleration below
#: 8 Hz [m/s^2] of the curves A and B.
_CURVES: dict[str, tuple[float, float, float | None]] = {
    "A": (50e-6, 4.0, 260e-6 * STANDARD_GRAVITY),
    "B": (25e-6, 4.0, 130e-6 * STANDARD_GRAVITY),
    "C": (12.5e-6, 1.0, None),
    "D": (6.25e-6, 1.0, None),
    "E": (3.12e-6, 1.0, None),
    "F": (1.56e-6, 1.0, None),
    "G": (0.78e-6, 1.0, None),
}
#: Upper end of the curves [Hz], and of their constant acceleration.
_TOP, _BEND = 80.0, 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VibrationCriterion(Spectrum):
    r"""A floor that fills a vibration criterion in every third of an octave.

    .. math:: S_v = \frac{3 v^2}{f \ln 2}

    has the rms velocity v in each (C. G. Gordon, Proc. SPIE 1619 (1991) 71; H. Amick and others,
    Proc. SPIE 5933 (2005), from memory). Validity: an upper envelope, since a real floor reaches
    its curve in one or two bands; zero below 1 Hz, or 4 Hz for A and B; nothing is agreed above
    80 Hz, where the slope is yours.
    """

    kind: ClassVar[str] = "vc"
    curve: Literal["A", "B", "C", "D", "E", "F", "G"]
    """The curve."""
    slope_above: float | None = None
    """Exponent of the density of displacement over frequency above 80 Hz, such as -5."""

    @property
    def unit(self) -> str:
        return "m/s"

    def density(self, f: Array) -> Array:
        velocity, lowest, acceleration = _CURVES[self.curve]
        bounded = np.minimum(f, _TOP)
        v = np.full_like(f, velocity)
        if acceleration is not None:
            v = np.where(f < _BEND, acceleration / (2.0 * np.pi * f), v)
        density = 3.0 * v**2 / (bounded * math.log(2.0))
        if self.slope_above is not None:
            # a velocity has two powers more than a displacement
            density *= (f / bounded) ** (self.slope_above + 2.0)
        return np.where(f < lowest, 0.0, density)

    @property
    def jumps(self) -> tuple[float, ...]:
        return (_CURVES[self.curve][1], _BEND, _TOP)

    def require(self, band: tuple[float, float]) -> None:
        Spectrum.require(self, band)
        if band[1] > _TOP and self.slope_above is None:
            raise ModelError(
                f"no vibration criterion says anything above {_TOP:g} Hz, and the band ends at "
                f"{band[1]:g} Hz: give slope_above, the exponent of the density of displacement "
                "there, such as -5"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class White(Spectrum):
    r"""White noise with 1/f noise below a corner.

    .. math:: S = S_w (1 + f_c/f)
    """

    kind: ClassVar[str] = "white"
    level: _DENSITY
    """Density of the white part, of amplitude or power."""
    sided: Sided
    """One- or two-sided."""
    corner: PositiveFrequency | None = None
    """Corner of the 1/f noise [Hz]."""

    @property
    def unit(self) -> str:
        return self.level.unit

    def density(self, f: Array) -> Array:
        white = _one_sided(self.level.value, self.sided)
        return white * (1.0 + (self.corner or 0.0) / f)


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass(Spectrum):
    r"""White noise behind a first-order low-pass, by its rms u.

    .. math:: S = \frac{u^2}{\frac{\pi}{2} f_b} \frac{1}{1 + (f/f_b)^2}
    """

    kind: ClassVar[str] = "lowpass"
    rms: _LEVEL
    """Rms over all frequencies."""
    bandwidth: PositiveFrequency
    """Corner [Hz]."""

    @property
    def unit(self) -> str:
        return self.rms.unit

    def density(self, f: Array) -> Array:
        white = self.rms.value**2 / (0.5 * np.pi * self.bandwidth)
        return white / (1.0 + (f / self.bandwidth) ** 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantiser(Spectrum):
    r"""Rounding to steps q at a rate :math:`f_s`.

    .. math:: S = \frac{q^2}{6 f_s}, \quad f < f_s/2

    Validity: the signal moves by a third of a step or more from sample to sample (B. Widrow, I.
    Kollar, Quantization Noise, 2008, from memory).
    """

    kind: ClassVar[str] = "quantiser"
    step: _LEVEL
    """Step q."""
    rate: PositiveFrequency
    """Rate [Hz]."""

    @property
    def unit(self) -> str:
        return self.step.unit

    def density(self, f: Array) -> Array:
        return np.where(f < 0.5 * self.rate, self.step.value**2 / (6.0 * self.rate), 0.0)

    def held_density(self, f: Array) -> Array:
        r"""Return the density of a converter that holds each value.

        .. math:: S = \frac{q^2}{6 f_s} \mathrm{sinc}^2(\pi f/f_s)

        at all frequencies, with the variance :math:`q^2/12` over them.
        """
        return self.step.value**2 / (6.0 * self.rate) * np.sinc(f / self.rate) ** 2

    @property
    def jumps(self) -> tuple[float, ...]:
        return (0.5 * self.rate,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines(Spectrum):
    """Lines of a spectrum, such as the hum of the mains."""

    kind: ClassVar[str] = "lines"
    at: tuple[tuple[PositiveFrequency, _LEVEL], ...]
    """Frequency [Hz] and rms of each line."""

    def __post_init__(self) -> None:
        if not self.at or len({level.unit for _, level in self.at}) > 1:
            raise ModelError(
                f"lines need at least one entry [frequency, rms], all of one unit; got "
                f"{len(self.at)}: give each in the same unit"
            )

    @property
    def unit(self) -> str:
        return self.at[0][1].unit

    def density(self, f: Array) -> Array:
        return np.zeros_like(f)

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        return tuple((f, level.value**2) for f, level in self.at)

    def require(self, band: tuple[float, float]) -> None:
        for f, _ in self.at:
            if not band[0] < f < band[1]:
                raise ModelError(
                    f"the line at {f:g} Hz lies outside the band of {band[0]:g} to {band[1]:g} Hz: "
                    "remove it, or widen the band"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tabulated(Spectrum):
    """A density by points: a straight line in the logarithms of frequency and density."""

    kind: ClassVar[str] = "table"
    points: tuple[tuple[PositiveFrequency, _DENSITY], ...]
    """Frequency [Hz] and density of each point."""
    sided: Sided
    """One- or two-sided."""
    outside: Outside = "refused"
    """Outside its frequencies: refused, or zero."""

    def __post_init__(self) -> None:
        f = [at for at, _ in self.points]
        if len(f) < 2 or any(b <= a for a, b in itertools.pairwise(f)):
            raise ModelError(
                f"a table of densities needs two frequencies or more, rising, got {len(f)}: sort it"
            )
        if len({level.unit for _, level in self.points}) > 1:
            raise ModelError("the densities of a table must have one unit, got several: convert")

    @property
    def unit(self) -> str:
        return self.points[0][1].unit

    def density(self, f: Array) -> Array:
        low, high = self.jumps
        at = np.log([at for at, _ in self.points])
        values = np.log([_one_sided(level.value, self.sided) for _, level in self.points])
        inside = (f >= low) & (f <= high)
        return np.where(inside, np.exp(np.interp(np.log(f), at, values)), 0.0)

    @property
    def jumps(self) -> tuple[float, ...]:
        return (self.points[0][0], self.points[-1][0])

    def require(self, band: tuple[float, float]) -> None:
        low, high = self.jumps
        if self.outside == "refused" and not (low <= band[0] and band[1] <= high):
            raise ModelError(
                f"its densities from {low:g} to {high:g} Hz do not cover the band of {band[0]:g} "
                f"to {band[1]:g} Hz: narrow the band, or give outside: zero"
            )
        if high <= band[0] or low >= band[1]:
            raise ModelError(
                f"its densities from {low:g} to {high:g} Hz lie outside the band of {band[0]:g} to "
                f"{band[1]:g} Hz: move the band"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class FromFile(Spectrum):
    """A density in two columns of a text file, such as one that an analyser wrote."""

    kind: ClassVar[str] = "file"
    path: str
    """The file, in the folder of the environment unless its path is absolute."""
    density_unit: str
    """Unit of the densities, such as um/s/rtHz or (m/s^2)^2/Hz."""
    sided: Sided
    """One- or two-sided."""
    columns: tuple[CountOrZero, CountOrZero] = (0, 1)
    """Columns of frequencies [Hz] and densities, counted from 0."""
    outside: Outside = "refused"
    """Outside its frequencies: refused, or zero."""

    def loaded(self, folder: Path | None) -> Spectrum:
        if folder is None:
            raise ModelError(
                f"no file is read here, got '{self.path[:60]}': give its densities as kind: table"
            )
        factor, unit = density_unit(self.density_unit)
        columns = read_text(folder / self.path, TextLayout()).columns
        if max(self.columns) >= len(columns):
            raise ModelError(
                f"'{self.path}' has {len(columns)} columns, got {list(self.columns)}: name two of "
                "them, counted from 0"
            )
        f, values = (columns[k].values for k in self.columns)
        # an analyser begins at 0 Hz, which has no logarithm
        stated = f != 0.0
        if not np.all((f[stated] > 0.0) & (values[stated] > 0.0) & np.isfinite(values[stated])):
            raise ModelError(
                f"'{self.path}' has frequencies or densities that are not above 0: remove those "
                f"rows, or convert decibels to {self.density_unit}"
            )
        values = factor * (values**2 if _AMPLITUDE.fullmatch(self.density_unit) else values)
        rows = zip(f[stated].tolist(), values[stated].tolist(), strict=True)
        return Tabulated(
            points=tuple((at, SpectralLevel(value, unit)) for at, value in rows),
            sided=self.sided,
            outside=self.outside,
        )


def _one_sided(value: Any, sided: Sided) -> Any:
    return value if sided == "one" else 2.0 * value


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseSource:
    """Base of sources of disturbance, independent of each other."""

    kind: ClassVar[str]
    units: ClassVar[tuple[str, ...]] = ()
    name: str
    """Name."""
    spectrum: Spectrum
    """Spectrum."""

    def allowed_units(self) -> tuple[str, ...]:
        """Return the SI units that its spectrum may have."""
        return self.units

    def density(self, f: Array) -> Array:
        """Return its one-sided density at frequencies [Hz], in unit^2/Hz."""
        return self.spectrum.density(f)

    def force(self, system: MechanicalSystem) -> Array:
        """Return the force on each coordinate for a unit of it, drives in place, shape (n,).

        Of the ground it is that for a unit of its acceleration; zero of sensors and voltages.
        """
        return np.zeros(system.order)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundMotion(NoiseSource):
    """Motion of the ground on which the stage stands."""

    kind: ClassVar[str] = "ground"
    along: GroundDirection
    """x, y, or rotation about the origin of the stage."""

    def allowed_units(self) -> tuple[str, ...]:
        # no unit of rad/s^2 is known
        return ("rad", "rad/s") if self.along == "rotation" else ("m", "m/s", "m/s^2")

    @property
    def derivatives(self) -> int:
        """Number of derivatives from its spectrum to an acceleration."""
        unit = self.spectrum.unit
        return 0 if unit.endswith("/s^2") else 1 if unit.endswith("/s") else 2

    def force(self, system: MechanicalSystem) -> Array:
        return -system.base_force(self.along, "in place")


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyForce(NoiseSource):
    """A force at the centre of a body, such as that of sound."""

    kind: ClassVar[str] = "force"
    units: ClassVar[tuple[str, ...]] = ("N",)
    body: str
    """The body."""
    along: Literal["x", "y"]
    """Its direction."""

    def force(self, system: MechanicalSystem) -> Array:
        force = system.body(self.body).matrix["xy".index(self.along)]
        if not np.any(force):
            raise ModelError(f"source '{self.name}': body '{self.body}' is fixed: name another")
        return force


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveVoltage(NoiseSource):
    """Noise of the voltage of a piezo drive."""

    kind: ClassVar[str] = "voltage"
    units: ClassVar[tuple[str, ...]] = ("V",)
    drive: str
    """The drive."""

    def density(self, f: Array) -> Array:
        if isinstance(self.spectrum, Quantiser):
            return self.spectrum.held_density(f)
        return self.spectrum.density(f)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise(NoiseSource):
    """Noise of the sensor of the loop; it moves the stage under control only."""

    kind: ClassVar[str] = "sensor"
    units: ClassVar[tuple[str, ...]] = ("m", "rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A point of interest: what a probe reads."""

    name: str
    """Name."""
    probe: str
    """The probe."""
    relative_to: str = "base"
    """base, on which the stage stands; room, which does not move; or another probe."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticErrors:
    """Causes of errors that do not vibrate, for a tree of errors with the rms."""

    temperature: Annotated[float, DIMENSIONS["temperature"], NOT_NEGATIVE] = 0.0
    """Half the range of the change of temperature [K]."""
    travel: Annotated[Length, POSITIVE] | None = None
    """Travel over which errors that grow with it count [m]; the stroke of the axis by default."""
    creep: Annotated[float, NOT_NEGATIVE] = 0.0
    """Creep in the time that counts, over the travel [1]; control removes it."""
    hysteresis: Annotated[float, NOT_NEGATIVE] = 0.0
    """Half the range of what an inverse leaves of the hysteresis, over the travel [1]; control
    removes it.
    """
    sensor: SensorSpecification | None = None
    """Sensor of the loop, and its place."""

    def __post_init__(self) -> None:
        require_ranges(self, ModelError, "static errors")


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Sources of disturbance, the band in which they count, and points of interest.

    Validity: stationary sources, independent of each other.

    Raises
    ------
    ModelError
        There is no source, a unit does not suit its source, or a spectrum does not cover the band.
    """

    name: str
    """Name."""
    band: tuple[PositiveFrequency, PositiveFrequency]
    """Lowest and highest frequency that count [Hz]; the lowest is one over the time between two
    zeroings.
    """
    sources: tuple[NoiseSource, ...]
    """Sources."""
    points: tuple[Point, ...] = ()
    """Points of interest; by default the probe of the axis against the base."""
    static: StaticErrors | None = None
    """Causes of static errors."""
    folder: Path | None = Path()
    """Folder of its files, None to refuse files; not in the file."""

    def __post_init__(self) -> None:
        require_ranges(self, ModelError, "the environment")
        if not self.band[0] < self.band[1]:
            raise ModelError(f"band must rise, got {self.band[0]:g} to {self.band[1]:g} Hz")
        if not self.sources:
            raise ModelError("an environment needs at least one source, got none: give sources")
        loaded = [replace(s, spectrum=s.spectrum.loaded(self.folder)) for s in self.sources]
        object.__setattr__(self, "sources", tuple(loaded))
        for source in self.sources:
            allowed = source.allowed_units()
            if source.spectrum.unit not in allowed:
                raise ModelError(
                    f"source '{source.name}' acts as {source.kind}, in {', '.join(allowed)}, got a "
                    f"spectrum in {source.spectrum.unit}"
                )
            try:
                source.spectrum.require(self.band)
            except ModelError as error:
                raise ModelError(f"source '{source.name}': {error}") from None


_SPECTRA: tuple[type, ...] = (VibrationCriterion, White, LowPass, Quantiser, Lines, Tabulated,
                              FromFile)  # fmt: skip
_SOURCES: tuple[type, ...] = (GroundMotion, BodyForce, DriveVoltage, SensorNoise)
#: Format of the description of an environment.
ENVIRONMENT_FILE = Format(
    noun="description of an environment",
    key="environment",
    error=ModelError,
    only=True,
    families={
        Spectrum: {kind.kind: kind for kind in _SPECTRA},
        NoiseSource: {kind.kind: kind for kind in _SOURCES},
    },
)


def read_environment(path: str | os.PathLike[str]) -> Environment:
    """Read the description of an environment from a YAML file that begins ``environment: 1``.

    Messages about mistakes name the line.
    """
    decoder, root = read_file(Path(path), ENVIRONMENT_FILE)
    return decoder.build(Environment, root, "", {"folder": Path(path).parent})


def ready_environment(stage: Stage) -> Environment | None:
    """Return the assumed environment of a built-in stage, by its axes in their order; else None."""
    text = ready_text(stage)
    return None if text is None else environment_from_text(text, f"{stage.name}.yaml")


def ready_text(stage: Stage) -> str | None:
    """Return the description of the assumed environment of a built-in stage; else None."""
    ready = {path.stem: path for path in (Path(__file__).parent / "ready").glob("*.yaml")}
    if stage.name not in ready or len(stage.axes) != len("xy"):
        return None
    parts = {}
    for letter, axis in zip("xy", stage.axes, strict=True):
        parts |= {letter: axis.name, f"{letter}_drive": axis.drive, f"{letter}_probe": axis.probe}
    return Template(ready[stage.name].read_text("utf-8")).substitute(parts)


def environment_from_text(
    text: str, source: str = "environment", *, folder: Path | None = Path()
) -> Environment:
    """Read the description of an environment from text, its files in a folder; None refuses them.

    Examples
    --------
    >>> environment = environment_from_text('''
    ... environment: 1
    ... name: floor alone
    ... band: [1 Hz, 2 kHz]
    ... sources:
    ...   floor: {kind: ground, along: x, spectrum: {kind: vc, curve: E, slope_above: -5}}
    ... ''')
    >>> density = environment.sources[0].spectrum.density(np.array([10.0]))
    >>> print(f"{1e6 * math.sqrt(density[0]):.2f} um/s/rtHz")
    2.05 um/s/rtHz
    """
    decoder, root = read(text, source, ENVIRONMENT_FILE)
    return decoder.build(Environment, root, "", {"folder": folder})


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionLoop:
    """A position control of one axis."""

    name: str
    """Name."""
    settings: ServoSettings
    """Its settings."""
    sample_rate: PositiveFrequency = 10e3
    """Its rate [Hz]."""
    delay: Annotated[Time, NOT_NEGATIVE] | None = None
    """Time from a reading to its voltage, without the hold [s]; one sample where not given."""
    damping: InnerLoop | None = None
    """Loop inside that damps a mode; none where not given."""

    def __post_init__(self) -> None:
        require_ranges(self, ModelError, f"loop '{self.name}'")
        if not (self.settings.integral or self.settings.proportional):
            raise ModelError(f"loop '{self.name}' has no gain: give its settings integral")

    @property
    def latency(self) -> float:
        """Time from a reading to its voltage, without the hold [s]."""
        return 1.0 / self.sample_rate if self.delay is None else self.delay

    @property
    def lag(self) -> float:
        """Phase lag of its feedback at zero frequency [rad]."""
        settings, inner = self.settings, 0 if self.damping is None else self.damping.integrals
        outer = bool(settings.integral) + (settings.second_integral_hz is not None)
        return 0.5 * math.pi * (outer + inner)

    def feedback(self, frequency_hz: Array) -> tuple[Complex, Complex | None]:
        """Return the negative feedback of the reading [V/m], and of the force of the stack [V/N].

        The second is None without a force sensor. Neither has the delay.
        """
        control = self.settings.response(frequency_hz, self.sample_rate)
        if self.damping is None:
            return control, None
        reading, force = self.damping.around(control, frequency_hz, self.sample_rate)
        return reading, force if isinstance(self.damping, ForceFeedback) else None


_INNER: tuple[type, ...] = (PositionFeedback, ForceFeedback)
#: Format of the description of a loop.
LOOP_FILE = Format(
    noun="description of a loop",
    key="loop",
    error=ModelError,
    only=True,
    families={InnerLoop: {kind.kind: kind for kind in _INNER}},
)


def read_loop(path: str | os.PathLike[str]) -> PositionLoop:
    """Read a loop from a YAML file that begins ``loop: 1``."""
    decoder, root = read_file(Path(path), LOOP_FILE)
    name = {} if "name" in root.items else {"name": Path(path).stem}
    return decoder.build(PositionLoop, root, "", name)


def integral_loop(crossover_hz: float, gain: float, mode: float | None) -> PositionLoop:
    """Return an integral loop of a gain crossover [Hz], with a notch that blocks a mode.

    `gain` is that of the stage [m/V], `mode` the frequency of the mode [Hz]; None for no notch.
    """
    notches = () if mode is None else (Notch(frequency_hz=mode, zero_damping=0.0),)
    return PositionLoop(
        name=f"{crossover_hz:g} Hz",
        settings=ServoSettings(integral=2.0 * math.pi * crossover_hz / gain, notches=notches),
    )


def crossover_of(text: str) -> float | None:
    """Return the crossover that a text such as ``100 Hz`` names [Hz]; None for any other text."""
    try:
        return parse(text, "frequency")
    except UnitError:
        return None
