"""Continuous excitations: cycles, small sines, designed records, and hammer impacts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError, PlanError, StageError
from flexstage.experiments.axis_limits import AxisSetting, lowest_frequency
from flexstage.experiments.command import BASE_RATE_HZ, CommandWaveform, Strike, require_size
from flexstage.experiments.verb import PlanContext, PlannedStep
from flexstage.experiments.verbs.excite import (
    SAMPLES_PER_CYCLE,
    SOME,
    Excite,
    command_of,
    require_span,
    require_stack,
    whole_part,
)
from flexstage.files.ranges import Count, CountOrZero, Range, Seed, Share
from flexstage.files.request import require_fields
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.excitations.excitation import Excitation
from flexstage.hysteresis.requests import ExciteRequest
from flexstage.quantities.units import DIMENSIONS, Frequency, Time, Voltage
from flexstage.stage import PiezoStack, Stage

Band = Annotated[tuple[float, float], DIMENSIONS["frequency"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class EqualCycles(Excite):
    """Equal cycles, which start and end at their low end."""

    kind: ClassVar[str] = "cycles"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, SOME]
    """Frequency of the cycles [Hz]."""
    cycles: Count = 3
    """Number of evaluated cycles."""
    condition: CountOrZero = 1
    """Number of conditioning cycles before them, which are not evaluated."""
    shape: Literal["triangle", "cosine", "steps"] = "triangle"
    """Shape of a cycle; steps are jerk-limited moves between the ends, with rests."""
    low: float = 0.0
    """Low end, as a fraction of the range [1]."""
    high: float = 1.0
    """High end, as a fraction of the range [1]."""
    closed_loop: bool = False
    """Command positions under control instead of voltages."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        require_span(self.kind, self.low, self.high)

    @property
    def motion_cycles(self) -> int | None:
        return self.cycles

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        n = samples_of_cycle(self.kind, self.rate, fs, self.cycles + self.condition)
        index = np.arange(int((self.cycles + self.condition) * n) + 1)
        phase = index / n
        if self.shape == "cosine":
            share = 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)
        elif self.shape == "steps":
            from flexstage.control.trajectory import steps

            cycle = steps("", 0.0, 1.0, fs / n, sample_rate_hz=fs).positions[""]
            share = cycle[index % n]
        else:
            share = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
        low, high = s.place(self.low), s.place(self.high)
        return command_of(s, low + (high - low) * share, fs, first=self.condition * n, period=n)


def samples_of_cycle(kind: str, rate_hz: float, sample_rate_hz: float, cycles: float) -> int:
    """Return the number of samples of a cycle; refuse too few and too many."""
    n = round(sample_rate_hz / rate_hz)
    if n < SAMPLES_PER_CYCLE:
        raise PlanError(
            f"cycles of {rate_hz:g} Hz need commands at {SAMPLES_PER_CYCLE * rate_hz:g} samples "
            f"per second, got {sample_rate_hz:g}: raise command_rate"
        )
    require_size(n * cycles, kind)
    return n


@dataclass(frozen=True, slots=True, kw_only=True)
class DescendingLoops(Excite):
    """Cosine cycles over the full range, then cycles of descending range about the middle."""

    kind: ClassVar[str] = "descending-loops"

    axis: str
    """The axis."""
    rate: Annotated[Frequency, SOME]
    """Frequency of the cycles [Hz]."""
    full: Count = 4
    """Number of cycles over the full range."""
    descending: Count = 6
    """Number of cycles over which the range descends."""
    smallest: Annotated[float, Range(low=0.001, high=0.999)] = 0.1
    """Range of the last cycle, as a fraction of the full range [1]."""
    condition: CountOrZero = 2
    """Number of conditioning cycles before them, which are not evaluated."""

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        del base
        s = settings[0]
        conditioning, cycles = self.condition, self.full + self.descending
        n = samples_of_cycle(self.kind, self.rate, fs, conditioning + cycles)
        cycle = np.arange(int((conditioning + cycles) * n) + 1) / n - conditioning
        swing = np.interp(cycle, [0.0, self.full, cycles], [1.0, 1.0, self.smallest])
        share = 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * cycle)
        values = s.low + (s.high - s.low) * share
        return command_of(s, values, fs, first=int(conditioning) * n, period=n)


@dataclass(frozen=True, slots=True, kw_only=True)
class _SmallSines(Excite):
    response: ClassVar[str] = "periodic"

    axis: str
    """The axis, of a piezo stack."""
    band: Band
    """Ends of the band [Hz]."""
    amplitude: Annotated[Voltage, SOME]
    """Largest voltage from the mean [V]."""
    period: Annotated[Time, SOME] = 1.0
    """Duration of a period, the inverse of the line spacing [s]."""
    periods: Annotated[int, Range(low=2, high=1e6)] = 5
    """Number of periods, after one settling period."""
    at: Share = 0.5
    """Mean value, as a fraction of the range [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if not 0.0 < self.band[0] < self.band[1] < math.inf:
            raise PlanError(
                f"the band of a {self.kind} must rise from above 0 Hz, got {self.band[0]:g} to "
                f"{self.band[1]:g} Hz"
            )

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        # highest frequency of small sines over the highest sample rate
        highest = 0.35
        s, top = settings[0], self.band[1]
        require_stack(s, "a small excitation in open loop is")
        if top > highest * base:
            raise PlanError(
                f"a band up to {top:g} Hz needs an instrument with {top / highest:g} samples per "
                f"second, got {base:g}"
            )
        # at least the default rate, and fast enough for the highest line where possible
        lowest_rate = max(SAMPLES_PER_CYCLE * top, fs)
        rate = base / max(math.floor(base / lowest_rate), 1)
        n = round(self.period * rate)
        if n < 2.0 * SAMPLES_PER_CYCLE:
            raise PlanError(
                f"a period of {self.period:g} s of the {self.kind} has {n} samples at {rate:g} Hz, "
                f"and needs at least {2.0 * SAMPLES_PER_CYCLE:g}: make it longer"
            )
        require_size(n * (self.periods + 1), self.kind)
        one_period = self.one(n, rate)
        middle = min(max(s.place(self.at), s.low + self.amplitude), s.high - self.amplitude)
        if middle < s.low + self.amplitude * (1.0 - 1e-9):
            raise PlanError(
                f"an amplitude of {self.amplitude:g} V exceeds the range {s.low:g} to {s.high:g} V"
            )
        values = middle + self.amplitude * np.tile(one_period, self.periods + 1)
        return command_of(s, np.append(values, values[0]), rate, first=n, period=n)

    def one(self, n: int, rate: float) -> Array:
        """Return one period of n samples, from -1 to 1."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class Multisine(_SmallSines):
    """A small multisine with all lines of a band, repeated."""

    kind: ClassVar[str] = "multisine"

    seed: Seed = 0
    """Seed of the phases."""

    def __post_init__(self) -> None:
        _SmallSines.__post_init__(self)
        if self.band[1] - self.band[0] < 1.0 / self.period:
            raise PlanError(
                f"a period of {self.period:g} s has no line between {self.band[0]:g} and "
                f"{self.band[1]:g} Hz: make it longer"
            )

    def one(self, n: int, rate: float) -> Array:
        low, high = self.band
        lines = np.arange(math.ceil(low * n / rate - 1e-9), math.floor(high * n / rate) + 1)
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(7,)))
        best: Array | None = None
        # the draw with the lowest crest factor has the highest power for its amplitude
        for _ in range(32):
            spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
            spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
            x = np.fft.irfft(spectrum, n)
            x /= np.max(np.abs(x))
            if best is None or np.mean(x**2) > np.mean(best**2):
                best = x
        assert best is not None
        return best


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp(_SmallSines):
    """A small sine whose frequency rises over a band, repeated."""

    kind: ClassVar[str] = "chirp"

    amplitude: Annotated[Voltage, SOME]
    """Its amplitude [V]."""
    period: Annotated[Time, SOME] = 1.0
    """Duration of one sweep [s]."""

    def one(self, n: int, rate: float) -> Array:
        t = np.arange(n) / rate
        # up and down again, so that the next sweep continues without a step
        half = 0.5 * self.period
        climb = (self.band[1] - self.band[0]) / half
        up = np.minimum(t, self.period - t)
        phase = self.band[0] * up + 0.5 * climb * up**2
        total = self.band[0] * half + 0.5 * climb * half**2
        # an integer number of half cycles, so that the period ends where it started
        rounding = max(round(2.0 * total), 1) / (2.0 * total)
        phase, total = rounding * phase, rounding * total
        return np.sin(2.0 * np.pi * np.where(t < half, phase, 2.0 * total - phase))


def of_stage(
    request: ExciteRequest, stage: Stage, axis: str | None = None
) -> tuple[str, ExciteRequest]:
    """Return the axis, by default the first, and the request with the limits of its stack."""
    if not stage.axes:
        raise StageError(f"{stage.name} has no axis: give it one, or omit STAGE")
    name = stage.axis(axis).name if axis is not None else stage.axes[0].name
    drive = stage.drive_of(name)
    if not isinstance(drive, PiezoStack):
        raise StageError(
            f"axis '{name}' of {stage.name} is driven by a {drive.kind}, not by a piezo stack: "
            "choose another axis, or omit STAGE"
        )
    requested, allowed = request.voltage or drive.voltage_range, drive.voltage_range
    if requested and allowed and not allowed[0] <= requested[0] < requested[1] <= allowed[1]:
        raise ModelError(
            f"--voltage must be within {allowed[0]:g} V to {allowed[1]:g} V, the range of the "
            f"stack of axis '{name}' of {stage.name}, got {requested[0]:g} V to {requested[1]:g} V"
        )
    return name, replace(
        request,
        voltage=requested,
        amplifier=replace(
            request.amplifier, capacitance=request.amplifier.capacitance or drive.capacitance
        ),
        frequency=request.frequency or lowest_frequency(stage),
    )


def excitation_of(stage: Stage, request: ExciteRequest, axis: str | None = None) -> Excitation:
    """Design the record that identifies an axis of a stage, by default the first."""
    name, stage_request = of_stage(request, stage, axis)
    return replace(
        excitation(request=stage_request),
        request=request,
        stage=stage.name,
        axis=name,
        natural_frequency_hz=None if request.frequency else stage_request.frequency,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Designed(Excite, ExciteRequest):
    """The drive record of `hysteresis.excitation`, which identifies hysteresis, lag and creep.

    By default, options follow from the stage, its instrument and the plan.
    """

    kind: ClassVar[str] = "designed"
    needs_frequency: ClassVar[bool] = True

    axis: str
    """The axis, of a piezo stack."""
    multisine: bool = False
    """Add a small multisine at the natural frequency."""

    def __post_init__(self) -> None:
        require_fields(self, ExciteRequest, PlanError, " of designed")

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        s = settings[0]
        require_stack(s, "a designed record is")
        options = {f.name: getattr(self, f.name) for f in fields(ExciteRequest)}
        low, high = self.voltage or (s.low, s.high)
        if not s.low <= low < high <= s.high:
            raise PlanError(
                f"the voltage of designed must be within {s.low:g} V to {s.high:g} V, the range of "
                f"axis '{s.axis}', got {low:g} V to {high:g} V"
            )
        fs = whole_part(self.sample_rate, base) if self.sample_rate else fs
        frequency = self.frequency or s.natural_frequency_hz
        options |= {
            "voltage": (low, high),
            "sample_rate": fs,
            "amplifier": replace(
                self.amplifier,
                slew=min((r for r in (self.amplifier.slew, s.largest_rate) if r), default=None),
                capacitance=self.amplifier.capacitance or s.capacitance,
            ),
            "frequency": frequency,
            "multisine": self.multisine and frequency is not None,
        }
        try:
            designed = excitation(request=ExciteRequest(**options))
        except FlexstageError as error:
            raise PlanError(str(error)) from error
        return command_of(s, designed.voltage, fs, notes=designed.warnings)


@dataclass(frozen=True, slots=True, kw_only=True)
class HammerImpacts(Excite):
    """Hammer impacts along an axis, with its drives removed."""

    kind: ClassVar[str] = "hammer-impacts"
    response: ClassVar[str] = "hammer"

    axis: str
    """The axis."""
    impacts: Count = 5
    """Number of impacts."""

    def command(
        self,
        settings: Mapping[str, AxisSetting],
        sample_rate_hz: float,
        *,
        base_rate_hz: float = BASE_RATE_HZ,
    ) -> Strike:
        del settings, sample_rate_hz, base_rate_hz
        return Strike(axis=self.axis, impacts=self.impacts)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        self.settings(context)
        what = f"{self.impacts} hammer impacts along {self.axis}, drives removed"
        return PlannedStep(name=name, verb=self.verb, what=what)
