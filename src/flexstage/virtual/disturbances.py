"""What is added to motions and readings sample by sample: noise, mains, drift of the room.

It is drawn in blocks of samples, each from a stream of its own: a record does not depend on how it
is cut.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.virtual.sensors import SensorBench, SimulatedSensor

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
