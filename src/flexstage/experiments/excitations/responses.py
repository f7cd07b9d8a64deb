"""What an axis responds to: small sines, all at once or of rising frequency, and blows."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import PlanError
from flexstage.experiments.axis_limits import AxisSetting
from flexstage.experiments.command import BASE_RATE_HZ, CommandWaveform, Strike, require_size
from flexstage.experiments.verb import PlanContext, PlannedStep
from flexstage.experiments.verbs.excite import (
    SAMPLES_PER_CYCLE,
    SOME,
    Excite,
    command_of,
    require_stack,
)
from flexstage.files.ranges import Count, Range, Seed, Share
from flexstage.quantities.units import DIMENSIONS, Time, Voltage

Band = Annotated[tuple[float, float], DIMENSIONS["frequency"]]


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
    """Time of a period, whose inverse is the distance of the lines [s]."""
    periods: Annotated[int, Range(low=2, high=1e6)] = 5
    """How many; one more runs before them, to settle."""
    at: Share = 0.5
    """Where in the range, as a share [1]."""

    def __post_init__(self) -> None:
        Excite.__post_init__(self)
        if not 0.0 < self.band[0] < self.band[1] < math.inf:
            raise PlanError(
                f"the band of a {self.kind} must rise from above 0 Hz, got {self.band[0]:g} to "
                f"{self.band[1]:g} Hz"
            )

    def design(self, settings: Sequence[AxisSetting], fs: float, base: float) -> CommandWaveform:
        # small sines are made up to this share of the highest rate of samples
        highest = 0.35
        s, top = settings[0], self.band[1]
        require_stack(s, "small sines in open loop are")
        if top > highest * base:
            raise PlanError(
                f"a band up to {top:g} Hz needs an instrument of {top / highest:g} "
                f"samples a second, got {base:g}"
            )
        # no slower than the usual rate, and fast enough for the highest line where it can be
        wanted = max(SAMPLES_PER_CYCLE * top, fs)
        rate = base / max(math.floor(base / wanted), 1)
        n = round(self.period * rate)
        if n < 2.0 * SAMPLES_PER_CYCLE:
            raise PlanError(
                f"a period of {self.period:g} s of the {self.kind} has {n} samples at {rate:g} Hz, "
                f"and needs {2.0 * SAMPLES_PER_CYCLE:g} at least: make it longer"
            )
        require_size(n * (self.periods + 1), self.kind)
        one = self.one(n, rate)
        middle = min(max(s.place(self.at), s.low + self.amplitude), s.high - self.amplitude)
        if middle < s.low + self.amplitude * (1.0 - 1e-9):
            raise PlanError(
                f"an amplitude of {self.amplitude:g} V does not fit into {s.low:g} to {s.high:g} V"
            )
        values = middle + self.amplitude * np.tile(one, self.periods + 1)
        return command_of(s, np.append(values, values[0]), rate, first=n, period=n)

    def one(self, n: int, rate: float) -> Array:
        """Return one period of n samples, from -1 to 1."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class Multisine(_SmallSines):
    """A small sum of sines with all lines of a band, repeated."""

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
        # of some draws that with the lowest crest has most power for its amplitude
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
    """Time of one sweep [s]."""

    def one(self, n: int, rate: float) -> Array:
        t = np.arange(n) / rate
        # up and down again, so that the next sweep goes on without a jump
        half = 0.5 * self.period
        climb = (self.band[1] - self.band[0]) / half
        up = np.minimum(t, self.period - t)
        phase = self.band[0] * up + 0.5 * climb * up**2
        total = self.band[0] * half + 0.5 * climb * half**2
        # whole half cycles each way, so that a period ends where it began
        whole = max(round(2.0 * total), 1) / (2.0 * total)
        phase, total = whole * phase, whole * total
        return np.sin(2.0 * np.pi * np.where(t < half, phase, 2.0 * total - phase))


@dataclass(frozen=True, slots=True, kw_only=True)
class Blows(Excite):
    """Blows of a hammer along an axis, its drives taken out."""

    kind: ClassVar[str] = "blows"
    response: ClassVar[str] = "hammer"

    axis: str
    """The axis."""
    hits: Count = 5
    """How many."""

    def command(
        self,
        settings: Mapping[str, AxisSetting],
        sample_rate_hz: float,
        *,
        base_rate_hz: float = BASE_RATE_HZ,
    ) -> Strike:
        del settings, sample_rate_hz, base_rate_hz
        return Strike(axis=self.axis, hits=self.hits)

    def preview(self, context: PlanContext, name: str) -> PlannedStep:
        self.settings(context)
        what = f"{self.hits} blows along {self.axis}, drives taken out"
        return PlannedStep(name=name, verb=self.verb, what=what)
