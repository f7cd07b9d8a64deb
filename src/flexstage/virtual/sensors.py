"""Simulated sensors of a stage: their errors, and the error motions of the axes that they read.

Error motions are polynomials of the position, which a compiled loop evaluates. Noise, mains pick-up
and drift of the room come in blocks, each from its own random stream: a record is the same however
it is divided.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.hysteresis.compiled import compiled
from flexstage.quantities.sensor import SensorSpecification
from flexstage.stage.assumptions import (
    ANGLE_NOISE,
    EDDY_CURRENT_NOISE,
    GUIDE_LENGTH,
    POSITION_NOISE,
    TRANSVERSE_NOISE,
)
from flexstage.system.environment import Environment, GroundMotion, NoiseSource, SensorNoise
from flexstage.virtual.imperfections import ANGLES, MOTIONS, GuideErrors, require_size


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedSensor(SensorSpecification):
    """A simulated sensor: its errors are random, of the size that its specification states."""

    noise_rms: float
    """Rms of its white noise, in the unit of the reading."""
    mains_amplitude: float = 0.0
    """Amplitude of its mains pick-up, in the unit of the reading."""
    unit: str = "m"
    """Unit of the reading."""

    def __post_init__(self) -> None:
        SensorSpecification.__post_init__(self)
        for name in ("noise_rms", "mains_amplitude"):
            require_size(f"the {name} of a sensor", getattr(self, name))


#: External sensors in a laboratory: capacitive sensors and an autocollimator.
LABORATORY_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=POSITION_NOISE, calibration=5e-4, alignment=1e-3, drift=2e-11
    ),
    "transverse": SimulatedSensor(
        noise_rms=TRANSVERSE_NOISE, calibration=2e-3, alignment=5e-4, drift=2e-11
    ),
    "angle": SimulatedSensor(noise_rms=ANGLE_NOISE, calibration=2e-3, drift=1e-10, unit="rad"),
}
#: Built-in sensors of a piezo stage; the servo uses the first.
BUILT_IN_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=POSITION_NOISE, mains_amplitude=10e-9, resolution_step=1e-10, calibration=5e-5
    ),
    "transverse": SimulatedSensor(
        noise_rms=TRANSVERSE_NOISE, mains_amplitude=6e-9, resolution_step=1e-10, calibration=2e-3
    ),
    "angle": SimulatedSensor(
        noise_rms=ANGLE_NOISE,
        mains_amplitude=5e-8,
        resolution_step=1e-9,
        calibration=2e-3,
        unit="rad",
    ),
}
#: Sensors of a screw-driven stage: eddy-current sensors.
EDDY_CURRENT_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=EDDY_CURRENT_NOISE,
        mains_amplitude=20e-9,
        resolution_step=1e-10,
        calibration=5e-4,
    ),
    "transverse": SimulatedSensor(
        noise_rms=EDDY_CURRENT_NOISE,
        mains_amplitude=20e-9,
        resolution_step=1e-10,
        calibration=2e-3,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorBench:
    """The sensors of a stage, and the thermal drift of the room.

    Notes
    -----
    Validity: usual figures of capacitive sensors and an autocollimator in a quiet laboratory, not
    of one instrument. Noise is white up to half the loop rate, whatever that is.
    """

    along: SimulatedSensor = BUILT_IN_SENSORS["along"]
    """Sensor along an axis, which its servo uses."""
    transverse: SimulatedSensor = BUILT_IN_SENSORS["transverse"]
    """Sensor across the axis, in the plane and out of it."""
    angle: SimulatedSensor = BUILT_IN_SENSORS["angle"]
    """Sensor of rotations [rad]."""
    mains_frequency_hz: float = 50.0
    """Frequency of the mains [Hz]."""
    drift_rate: float = 10e-9 / 60.0
    """Rms rate of the platform's motion by the temperature of the room [m/s]."""
    room_time: float = 600.0
    """Correlation time of the room temperature [s]."""
    stage_time: float = 300.0
    """Time constant with which the stage follows the room [s]."""
    lever: float = GUIDE_LENGTH
    """Length over which the drift becomes a rotation [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorErrors:
    """Random errors of one sensor."""

    gain: float
    """Gain error [1]."""
    angle: float
    """Misalignment [rad]."""
    drift: float
    """Drift [unit of the reading per second]."""

    def read(self, truth: Array, along: Array | float, time: Array) -> Array:
        """Return the noiseless reading: gain error, cross-talk of the motion along, drift."""
        motion = truth * np.cos(self.angle) + np.sin(self.angle) * along
        return (1.0 + self.gain) * motion + self.drift * time


def sensor_errors(sensor: SimulatedSensor, rng: np.random.Generator) -> SensorErrors:
    """Draw gain error, misalignment and drift of a sensor from its specification."""
    g, a, d = rng.standard_normal(3)
    return SensorErrors(
        gain=sensor.calibration * g, angle=sensor.alignment * a, drift=sensor.drift * d
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelDescription:
    """A sensor channel of a virtual stage."""

    number: int
    """Number from 1; the sensors of the axes come first, in their order."""
    name: str
    """Name of the motion: ``x``, ``y``, then ``across``, ``vertical``, ``roll``, ``pitch``, ``yaw``
    of each axis as ``x.across`` and so on.
    """
    unit: str
    """``m`` or ``rad``."""


#: Number of coefficients of a polynomial: curves of guides are of order 5.
TERMS = 6


def polynomial(guide: GuideErrors, motion: str, low: float) -> Array:
    """Return a curve of a guide as a polynomial of the position from the relaxed stage.

    `low` is the position of the low end of the stroke [m]. Coefficients are from the constant up,
    which makes the motion of the relaxed stage zero, shape (6,).

    Examples
    --------
    >>> guide = GuideErrors(stroke=60e-6, coefficients={"across": np.array([0.0, 0.0, 1e-7])})
    >>> c = polynomial(guide, "across", 5e-6)
    >>> print(f"{np.polynomial.polynomial.polyval(35e-6, c) * 1e9:.1f} nm")
    -204.2 nm
    """
    out = np.zeros(TERMS)
    curve = guide.coefficients.get(motion)
    if curve is not None:
        series = np.polynomial.Legendre(curve, domain=[low, low + guide.stroke])
        powers = series.convert(kind=np.polynomial.Polynomial).coef
        out[: powers.size] = powers
        out[0] = 0.0
    return out


def neighbour(axes: Sequence[str], axis: str) -> str | None:
    """Return the other axis, which is across the first one; None where there is one axis."""
    return next((name for name in axes if name != axis), None)


def sensor_channels(axes: Sequence[str]) -> tuple[ChannelDescription, ...]:
    """Return the sensors of a stage: those of the axes, then those of their error motions."""
    names = [(axis, "m") for axis in axes]
    names += [(f"{a}.{m}", "rad" if m in ANGLES else "m") for a in axes for m in MOTIONS]
    return tuple(
        ChannelDescription(number=i, name=name, unit=unit)
        for i, (name, unit) in enumerate(names, start=1)
    )


def kinds_of(channels: Sequence[ChannelDescription]) -> list[str]:
    """Return the kind of sensor of each channel: ``along``, ``transverse`` or ``angle``."""
    return [
        "angle" if c.unit == "rad" else ("transverse" if "." in c.name else "along")
        for c in channels
    ]


def error_motion_sources(
    axes: Sequence[str], guides: Mapping[str, GuideErrors], low: Mapping[str, float]
) -> tuple[NDArray[np.int64], Array]:
    """Return axis number and polynomial of each sensor of an error motion.

    The reading is the polynomial of the position of that axis. Numbers have shape (c,),
    coefficients shape (c, 6); `low` is the low end of the stroke of each axis [m].
    """
    source, rows = [], []
    for number, axis in enumerate(axes):
        other = neighbour(axes, axis)
        for motion in MOTIONS:
            row = polynomial(guides[axis], motion, low[axis])
            at = number
            if motion == "across" and other is not None:
                # motion across this axis is motion along the other one
                at, row = axes.index(other), np.eye(TERMS)[1]
            source.append(at)
            rows.append(row)
    return np.array(source, dtype=np.int64), np.array(rows)


@compiled
def read_error_motions(
    source: NDArray[np.int64],
    rows: Array,
    position: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    reading: Array,
) -> None:
    """Write the readings of the error-motion sensors.

    `position` has the shape (axes, n); drift, noise and reading (axes + c, n) and gain and step
    (axes + c,), the sensors of the axes first. Only the last c rows of the reading are written.
    """
    axes, n = position.shape
    for c in range(source.size):
        row, p, to = rows[c], position[source[c]], axes + c
        # the positions of the axes already include their drift
        drift_share = 0.0 if row[1] == 1.0 else 1.0
        for k in range(n):
            x = p[k]
            value = row[5]
            for i in range(4, -1, -1):
                value = value * x + row[i]
            value = gain[to] * (value + drift_share * drift[to, k]) + noise[to, k]
            if step[to] > 0.0:
                value = step[to] * np.round(value / step[to])
            reading[to, k] = value


_BLOCK = 4096
#: Random streams of one seed.
_NOISE, _ROOM, _FIXED, _SOURCES = 0, 1, 2, 3


class Disturbances:
    """Drift of motions and noise of readings, sample by sample.

    `kinds` are ``along``, ``transverse`` or ``angle`` for each sensor. Quiet sensors have neither
    noise nor mains pick-up, drift or steps; without scatter gains are exact.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        bench: SensorBench,
        sample_rate_hz: float,
        seed: int,
        *,
        quiet: bool = False,
        scatter: bool = True,
    ) -> None:
        sensors: list[SimulatedSensor] = [getattr(bench, kind) for kind in kinds]
        self._seed, self._rate, self._quiet = seed, sample_rate_hz, quiet
        self._size = len(sensors)
        rng = self._stream(_FIXED)
        draw = rng.standard_normal(self._size)
        self._phase = rng.uniform(0.0, 2.0 * np.pi, self._size)[:, None]
        weight = rng.uniform(0.6, 1.4, self._size) * rng.choice((-1.0, 1.0), self._size)
        spread = np.array([s.calibration for s in sensors])
        #: Gain of each sensor [1], and its smallest step, shape (sensors,).
        self.gain: Array = 1.0 + spread * draw if scatter else np.ones(self._size)
        self.step: Array = np.array([0.0 if quiet else s.resolution_step for s in sensors])
        self._rms = np.array([s.noise_rms for s in sensors])[:, None]
        self._mains = np.array([s.mains_amplitude for s in sensors])[:, None]
        self._mains_hz = bench.mains_frequency_hz
        levers = np.array([1.0 / bench.lever if kind == "angle" else 1.0 for kind in kinds])
        self._drift = (weight * levers)[:, None]
        self._room = _Room(bench, _BLOCK / sample_rate_hz)
        self._blocks: dict[int, tuple[Array, Array]] = {}

    def take(self, first: int, count: int) -> tuple[Array, Array]:
        """Return drift of the motion, and noise with mains pick-up, from sample `first` on.

        Both have the shape (sensors, count).
        """
        if self._quiet:
            return np.zeros((self._size, count)), np.zeros((self._size, count))
        drift, noise = np.empty((self._size, count)), np.empty((self._size, count))
        filled = 0
        while filled < count:
            number, start = divmod(first + filled, _BLOCK)
            size = min(_BLOCK - start, count - filled)
            for out, block in zip((drift, noise), self._block(number), strict=True):
                out[:, filled : filled + size] = block[:, start : start + size]
            filled += size
        return drift, noise

    def _block(self, number: int) -> tuple[Array, Array]:
        if number not in self._blocks:
            samples = number * _BLOCK + np.arange(_BLOCK)
            turn = 2.0 * np.pi * self._mains_hz / self._rate * samples
            noise = self._stream(_NOISE, number).standard_normal((self._size, _BLOCK))
            noise *= self._rms
            noise += self._mains * np.sin(turn + self._phase)
            before = self._room.at(number, self._stream)
            after = self._room.at(number + 1, self._stream)
            line = before + (after - before) * (np.arange(_BLOCK) / _BLOCK)
            # samples are taken in order: the last two blocks are enough
            self._blocks = {k: v for k, v in self._blocks.items() if k == number - 1}
            self._blocks[number] = (self._drift * line, noise)
        return self._blocks[number]

    def _stream(self, *key: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(7, *key)))


class SourceSignals:
    """Sources of an environment as stationary Gaussian signals, sample by sample.

    Each is a sum of blocks that overlap by half, drawn with its density between the ends of the
    band and weighted by a half sine, so that its variance is that of its density; lines are sines
    of random phase. Ground motion becomes an acceleration.

    Notes
    -----
    Validity: a block lasts four of the slowest periods of the band, but at most `longest` samples:
    slower motion, and what lies above half the rate, is omitted, and a peak of a density narrower
    than the inverse of a block is not resolved. All signals but those of sensors
    are raised by the square of a sinc, since the loop takes straight lines between samples.
    """

    def __init__(
        self, environment: Environment, rate_hz: float, seed: int, *, longest: int = 2**19
    ) -> None:
        if not environment.band[0] < 0.5 * rate_hz:
            raise ModelError(
                f"the band of environment '{environment.name}' begins at {environment.band[0]:g} "
                f"Hz, and a loop at {rate_hz:g} Hz has nothing from half its rate on: lower the "
                "band, or raise the rate"
            )
        slowest = 4.0 * rate_hz / environment.band[0]
        self._half = int(2.0 ** math.ceil(math.log2(min(slowest, float(longest))))) // 2
        self._environment, self._rate, self._seed = environment, rate_hz, seed
        self._blocks: dict[tuple[int, int, int], Array] = {}

    def take(self, number: int, first: int, count: int, *, stream: int = 0) -> Array:
        """Return the signal of source `number` from sample `first` on, shape (count,).

        Different streams are independent signals of the source.
        """
        half, out, filled = self._half, self._hum(number, stream, first, count), 0
        while filled < count:
            block, start = divmod(first + filled, half)
            at = start + np.arange(min(half - start, count - filled))
            phase = 0.5 * np.pi * (at + 0.5) / half
            before, now = (self._block(number, stream, b) for b in (block - 1, block))
            out[filled : filled + at.size] += np.cos(phase) * before[half + at]
            out[filled : filled + at.size] += np.sin(phase) * now[at]
            filled += at.size
        return out

    def _scale(self, source: NoiseSource, f: Array) -> Array:
        scale = np.ones_like(f)
        if not isinstance(source, SensorNoise):
            scale /= np.sinc(f / self._rate) ** 2
        if isinstance(source, GroundMotion):
            scale *= (2.0 * np.pi * f) ** source.derivatives
        return scale

    def _block(self, number: int, stream: int, block: int) -> Array:
        key = (number, stream, block)
        if key not in self._blocks:
            size, rate = 2 * self._half, self._rate
            source = self._environment.sources[number]
            f = np.linspace(0.0, 0.5 * rate, self._half + 1)
            low, high = self._environment.band
            within = (f >= low) & (f <= high)
            inside = f[within]
            amplitude = np.zeros_like(f)
            amplitude[within] = self._scale(source, inside) * np.sqrt(
                0.25 * rate * size * source.density(inside)
            )
            draw = self._draws(*key).standard_normal((2, f.size))
            # samples are taken in order: the last two blocks are enough
            self._blocks = {
                k: v for k, v in self._blocks.items() if k[:2] != key[:2] or k[2] == block - 1
            }
            self._blocks[key] = np.fft.irfft(amplitude * (draw[0] + 1j * draw[1]), n=size)
        return self._blocks[key]

    def _hum(self, number: int, stream: int, first: int, count: int) -> Array:
        source, total = self._environment.sources[number], np.zeros(count)
        lines = [line for line in source.spectrum.lines if line[0] < 0.5 * self._rate]
        phases = self._draws(number, stream, -2).uniform(0.0, 2.0 * np.pi, len(lines))
        for (f, variance), phase in zip(lines, phases, strict=True):
            amplitude = math.sqrt(2.0 * variance) * self._scale(source, np.array([f]))[0]
            turn = 2.0 * np.pi * f / self._rate * (first + np.arange(count))
            total += amplitude * np.sin(turn + phase)
        return total

    def _draws(self, *key: int) -> np.random.Generator:
        # a block before the first sample has the number -1
        spawn_key = (7, _SOURCES, *(k + 2 for k in key))
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=spawn_key))


class _Room:
    """Room temperature as a Markov process, and a stage that expands with it behind a lag."""

    def __init__(self, bench: SensorBench, step: float) -> None:
        self._keep = math.exp(-step / bench.room_time)
        ratio = step / bench.stage_time
        self._decay, self._ramp = float(decay_share(ratio)), float(ramp_share(ratio))
        # scaled for the rms rate of the expansion
        slow = math.sqrt(bench.stage_time * (bench.stage_time + bench.room_time))
        self._rms = bench.drift_rate * slow
        self._share = bench.room_time / (bench.room_time + bench.stage_time)
        self._air = self._stage = self._first = 0.0
        self._expansion: list[float] = []

    def at(self, number: int, stream: Callable[[int, int], np.random.Generator]) -> float:
        """Return the expansion since time 0 at the start of a block [m]."""
        while len(self._expansion) <= number:
            k = len(self._expansion)
            draw, other = stream(_ROOM, k).standard_normal(2).tolist()
            if k == 0:
                # stationary values
                self._air = self._rms * draw
                self._first = self._share * self._air
                self._first += math.sqrt(self._share - self._share**2) * self._rms * other
                self._stage = self._first
            else:
                last = self._air
                self._air = self._keep * last + math.sqrt(1.0 - self._keep**2) * self._rms * draw
                rise = self._air - last
                self._stage += (last - self._stage) * self._decay + rise * self._ramp
            self._expansion.append(self._stage - self._first)
        return self._expansion[number]
