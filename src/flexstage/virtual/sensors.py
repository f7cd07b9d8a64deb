"""The sensors around a stage: what they are off by, and the motions beside its axes that they see.

The motions are polynomials of the position, so that a loop can follow them. What is added sample by
sample (noise, mains, drift of the room) is drawn in blocks, each from a stream of its own: a record
does not depend on how it is cut.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
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
from flexstage.virtual.imperfections import ANGLES, MOTIONS, GuideErrors, require_size


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedSensor(SensorSpecification):
    """A sensor that is simulated: what it is off by is drawn as its specification states it."""

    noise_rms: float
    """Rms of its white noise, in the unit of its reading."""
    mains_amplitude: float = 0.0
    """Amplitude of what it picks up of the mains, in the unit of its reading."""
    unit: str = "m"
    """Unit of its reading."""

    def __post_init__(self) -> None:
        SensorSpecification.__post_init__(self)
        for name in ("noise_rms", "mains_amplitude"):
            require_size(f"the {name} of a sensor", getattr(self, name))


#: Sensors that a laboratory puts around a stage: capacitive ones, and an autocollimator.
LABORATORY_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=POSITION_NOISE, calibration=5e-4, alignment=1e-3, drift=2e-11
    ),
    "beside": SimulatedSensor(
        noise_rms=TRANSVERSE_NOISE, calibration=2e-3, alignment=5e-4, drift=2e-11
    ),
    "angle": SimulatedSensor(noise_rms=ANGLE_NOISE, calibration=2e-3, drift=1e-10, unit="rad"),
}
#: Those of a piezo stage itself, of which the first closes its loop.
OWN_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=POSITION_NOISE, mains_amplitude=10e-9, resolution_step=1e-10, calibration=5e-5
    ),
    "beside": SimulatedSensor(
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
#: Those of a screw-driven stage: eddy-current ones.
EDDY_CURRENT_SENSORS = {
    "along": SimulatedSensor(
        noise_rms=EDDY_CURRENT_NOISE,
        mains_amplitude=20e-9,
        resolution_step=1e-10,
        calibration=5e-4,
    ),
    "beside": SimulatedSensor(
        noise_rms=EDDY_CURRENT_NOISE,
        mains_amplitude=20e-9,
        resolution_step=1e-10,
        calibration=2e-3,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorBench:
    """The sensors around a stage, and the room that it stands in.

    Notes
    -----
    Validity: usual figures of capacitive sensors and an autocollimator in a quiet laboratory, and
    no one's own. Noise is white up to half the rate of the loop, whatever that is.
    """

    along: SimulatedSensor = OWN_SENSORS["along"]
    """Reads along an axis, and closes its loop."""
    beside: SimulatedSensor = OWN_SENSORS["beside"]
    """Reads across it, in the plane and out of it."""
    angle: SimulatedSensor = OWN_SENSORS["angle"]
    """Reads rotations [rad]."""
    mains_frequency_hz: float = 50.0
    """Frequency of the mains [Hz]."""
    drift_rate: float = 10e-9 / 60.0
    """Rms rate of the platform's motion by the temperature of the room [m/s]."""
    room_time: float = 600.0
    """Time in which the room forgets its temperature [s]."""
    stage_time: float = 300.0
    """Time in which the stage follows the room [s]."""
    lever: float = GUIDE_LENGTH
    """Length over which the same drift is a rotation [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawn:
    gain: float
    angle: float
    drift: float

    def read(self, truth: Array, along: Array | float, time: Array) -> Array:
        """Reading without noise: gain, a share of the motion along the axis, drift."""
        seen = truth * np.cos(self.angle) + np.sin(self.angle) * along
        return (1.0 + self.gain) * seen + self.drift * time


def drawn(sensor: SimulatedSensor, rng: np.random.Generator) -> _Drawn:
    """Draw what a sensor is off by, of what is stated of it: gain, angle and drift."""
    g, a, d = rng.standard_normal(3)
    return _Drawn(gain=sensor.calibration * g, angle=sensor.alignment * a, drift=sensor.drift * d)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelDescription:
    """A sensor of a virtual stage, as its controller numbers it."""

    number: int
    """Its number, from 1; the first ones are the sensors of the axes, in their order."""
    name: str
    """What it reads: ``x``, ``y``, then ``across``, ``vertical``, ``roll``, ``pitch``, ``yaw`` of
    each axis as ``x.across`` and so on.
    """
    unit: str
    """``m`` or ``rad``."""


#: Coefficients of a polynomial: those of the curves of guides, of order 5.
TERMS = 6


def polynomial(guide: GuideErrors, motion: str, low: float) -> Array:
    """Return a curve of a guide as a polynomial of the position from where the stage is relaxed.

    `low` is the position of the low end of the stroke [m]. Coefficients from the constant up, which
    is such that the motion is zero where the stage is relaxed, shape (6,).

    Examples
    --------
    >>> guide = GuideErrors(stroke=60e-6, coefficients={"across": np.array([0.0, 0.0, 1e-7])})
    >>> c = polynomial(guide, "across", 5e-6)
    >>> print(f"{np.polynomial.polynomial.polyval(35e-6, c) * 1e9:.1f} nm")
    -204.2 nm
    """
    out = np.zeros(TERMS)
    given = guide.coefficients.get(motion)
    if given is not None:
        series = np.polynomial.Legendre(given, domain=[low, low + guide.stroke])
        powers = series.convert(kind=np.polynomial.Polynomial).coef
        out[: powers.size] = powers
        out[0] = 0.0
    return out


def neighbour(axes: Sequence[str], axis: str) -> str | None:
    """Return the axis whose direction is across another one; None where there is no other."""
    return next((name for name in axes if name != axis), None)


def beside_channels(axes: Sequence[str]) -> tuple[ChannelDescription, ...]:
    """Return the sensors of a stage: those of the axes, then those beside each of them."""
    names = [(axis, "m") for axis in axes]
    names += [(f"{a}.{m}", "rad" if m in ANGLES else "m") for a in axes for m in MOTIONS]
    return tuple(
        ChannelDescription(number=i, name=name, unit=unit)
        for i, (name, unit) in enumerate(names, start=1)
    )


def kinds_of(channels: Sequence[ChannelDescription]) -> list[str]:
    """Return the kind of sensor of each channel: ``along``, ``beside`` or ``angle``."""
    return [
        "angle" if c.unit == "rad" else ("beside" if "." in c.name else "along") for c in channels
    ]


def sources(
    axes: Sequence[str], guides: Mapping[str, GuideErrors], low: Mapping[str, float]
) -> tuple[NDArray[np.int64], Array]:
    """Return which position each sensor beside an axis follows, and by which polynomial.

    Number of the axis, shape (c,), and coefficients, shape (c, 6); `low` is the low end of each
    axis's stroke [m].
    """
    source, rows = [], []
    for number, axis in enumerate(axes):
        other = neighbour(axes, axis)
        for motion in MOTIONS:
            row = polynomial(guides[axis], motion, low[axis])
            at = number
            if motion == "across" and other is not None:
                # the platform moves across this axis as it moves along the other one
                at, row = axes.index(other), np.eye(TERMS)[1]
            source.append(at)
            rows.append(row)
    return np.array(source, dtype=np.int64), np.array(rows)


@compiled
def readings_beside(
    source: NDArray[np.int64],
    rows: Array,
    position: Array,
    drift: Array,
    noise: Array,
    gain: Array,
    step: Array,
    reading: Array,
) -> None:
    """Write what the sensors beside the axes read.

    `position` has the shape (axes, n); drift, noise and reading (axes + c, n) and gain and step
    (axes + c,), the sensors of the axes first: only the last c rows of the reading are written.
    """
    axes, n = position.shape
    for c in range(source.size):
        row, p, to = rows[c], position[source[c]], axes + c
        # the positions of the axes have their drift in them already
        own = 0.0 if row[1] == 1.0 else 1.0
        for k in range(n):
            x = p[k]
            value = row[5]
            for i in range(4, -1, -1):
                value = value * x + row[i]
            value = gain[to] * (value + own * drift[to, k]) + noise[to, k]
            if step[to] > 0.0:
                value = step[to] * np.round(value / step[to])
            reading[to, k] = value


_BLOCK = 4096
#: Streams of one seed.
_NOISE, _ROOM, _FIXED = 0, 1, 2


class Disturbances:
    """What is added to motions and readings, sample by sample.

    `kinds` says of each sensor whether it reads ``along``, ``beside`` or ``angle``. Where it is
    quiet there is neither noise nor mains, drift, or steps; without scatter gains are right.
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
        #: Gain of each sensor [1], and its smallest step; shape (sensors,).
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
        """Return drift of the motion, and noise with mains of the reading, from sample `first` on.

        Both have the shape (sensors, count).
        """
        if self._quiet:
            return np.zeros((self._size, count)), np.zeros((self._size, count))
        drift, noise = np.empty((self._size, count)), np.empty((self._size, count))
        done = 0
        while done < count:
            number, start = divmod(first + done, _BLOCK)
            size = min(_BLOCK - start, count - done)
            for out, drawn in zip((drift, noise), self._block(number), strict=True):
                out[:, done : done + size] = drawn[:, start : start + size]
            done += size
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
            # the last block is asked for again and again, the ones before it are not
            self._blocks = {k: v for k, v in self._blocks.items() if k == number - 1}
            self._blocks[number] = (self._drift * line, noise)
        return self._blocks[number]

    def _stream(self, *key: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(7, *key)))


class _Room:
    """A temperature that forgets itself, and a stage that follows it: expansion at even times."""

    def __init__(self, bench: SensorBench, step: float) -> None:
        self._keep = math.exp(-step / bench.room_time)
        ratio = step / bench.stage_time
        self._decay, self._ramp = float(decay_share(ratio)), float(ramp_share(ratio))
        # so that the expansion has the rms rate that is wanted
        slow = math.sqrt(bench.stage_time * (bench.stage_time + bench.room_time))
        self._rms = bench.drift_rate * slow
        self._share = bench.room_time / (bench.room_time + bench.stage_time)
        self._air = self._follow = self._first = 0.0
        self._found: list[float] = []

    def at(self, number: int, stream: Callable[[int, int], np.random.Generator]) -> float:
        """Return the expansion at a time, from the one at time 0 [m]."""
        while len(self._found) <= number:
            k = len(self._found)
            draw, other = stream(_ROOM, k).standard_normal(2).tolist()
            if k == 0:
                # air and stage as they are after a long time
                self._air = self._rms * draw
                self._first = self._share * self._air
                self._first += math.sqrt(self._share - self._share**2) * self._rms * other
                self._follow = self._first
            else:
                last = self._air
                self._air = self._keep * last + math.sqrt(1.0 - self._keep**2) * self._rms * draw
                rise = self._air - last
                self._follow += (last - self._follow) * self._decay + rise * self._ramp
            self._found.append(self._follow - self._first)
        return self._found[number]
