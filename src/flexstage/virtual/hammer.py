"""A hammer that strikes a virtual stage: many blows as a record, or one after the other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.arrays import Array
from flexstage.choose import has_no
from flexstage.errors import ModelError
from flexstage.records import Record
from flexstage.system import modes
from flexstage.virtual.as_built import AsBuilt
from flexstage.virtual.laboratory import Laboratory, stream, virtual_record

#: A blow: half a sine of this length [s], of about this size [N].
_BLOW, _FORCE = 0.5e-3, 8.0
_HAMMER_RATE_HZ, _HAMMER_TIME, _PRE_TRIGGER = 8192.0, 0.8, 0.02
#: Samples after the last blow has decayed.
_REST = 1024


class HammerBench:
    """A virtual stage struck by a hammer at its platform, drives removed.

    Force and acceleration belong together as of the continuous system: the response is that of all
    its modes, up to half the sample rate.
    """

    def __init__(self, built: AsBuilt, laboratory: Laboratory) -> None:
        self._built = built
        self._laboratory = laboratory
        self._block = int(_HAMMER_RATE_HZ * _HAMMER_TIME)
        found = modes(built.system, drives="removed", count=None)
        f = np.fft.rfftfreq(self._block, 1.0 / _HAMMER_RATE_HZ)
        omega = 2.0 * np.pi * f[:, None]
        own = found.omega[None, :]
        dynamic = own**2 - omega**2 + 2j * found.damping_ratio[None, :] * own * omega
        self._response: dict[tuple[str, str], NDArray[np.complex128]] = {}
        for struck in built.system.axes:
            for read in built.system.axes:
                weight = (built.system.probe(struck.probe).vector @ found.shapes) * (
                    built.system.probe(read.probe).vector @ found.shapes
                )
                value = np.sum(weight / dynamic, axis=1) * -(omega[:, 0] ** 2)
                self._response[struck.name, read.name] = value

    def record(self, axis: str, *, seed: int = 0) -> Record:
        """Strike along an axis; returned are force, and acceleration along every axis."""
        lab = self._laboratory
        names = [a.name for a in self._built.axes]
        rng = stream(seed, 60 + names.index(axis))
        size = lab.hits * self._block
        time = np.arange(size + _REST) / _HAMMER_RATE_HZ
        force = np.zeros((lab.hits, self._block))
        local = np.arange(self._block) / _HAMMER_RATE_HZ
        for k in range(lab.hits):
            height = _FORCE * (1.0 + 0.2 * rng.standard_normal())
            since = local - _PRE_TRIGGER * (1.0 + 0.3 * rng.random())
            inside = (since > 0.0) & (since < _BLOW)
            force[k, inside] = height * np.sin(np.pi * since[inside] / _BLOW)
        spectrum = np.fft.rfft(force, axis=1)
        channels: dict[str, tuple[Array, str]] = {}
        clean = {
            name: np.append(
                np.fft.irfft(spectrum * self._response[axis, name], n=self._block, axis=1),
                np.zeros(_REST),
            )
            for name in names
        }
        noise = float(np.sqrt(np.mean(clean[axis] ** 2))) / lab.signal_to_noise
        pressed = np.append(force, np.zeros(_REST))
        pressed = pressed + 1e-4 * _FORCE * rng.standard_normal(pressed.size)
        channels["force"] = (pressed, "N")
        for name in names:
            reading = clean[name] + noise * rng.standard_normal(time.size)
            channels[f"acceleration {name}"] = (reading, "m/s^2")
        return virtual_record(self._built, channels, time)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blow:
    """One blow of a hammer on the platform, the drives taken out."""

    time: Array
    """Times [s], shape (n,)."""
    force: Array
    """Force of the hammer [N], shape (n,)."""
    response: Array
    """Acceleration of the platform along the axis that was struck [m/s^2], shape (n,)."""
    sample_rate_hz: float
    """Samples in a second [Hz]."""


class Hammer:
    """A hammer with a force sensor, and an accelerometer on the platform."""

    def __init__(self, built: AsBuilt, seed: int) -> None:
        self._bench = HammerBench(built, Laboratory(hits=1))
        self._axes = [a.name for a in built.axes]
        self._seed, self._struck = seed, 0

    def strike(self, axis: str) -> Blow:
        """Strike once along an axis; the next blow differs from it."""
        if axis not in self._axes:
            raise ModelError(has_no("the stage", "axis", axis, self._axes))
        # each blow has a seed of its own, far from those of other stages
        record = self._bench.record(axis, seed=1_000_003 * (self._seed + 1) + self._struck)
        self._struck += 1
        time = record.time
        return Blow(
            time=time,
            force=record.channel("force").values,
            response=record.channel(f"acceleration {axis}").values,
            sample_rate_hz=float(1.0 / (time[1] - time[0])),
        )

    def reset(self) -> None:
        """Begin with the first blow again."""
        self._struck = 0
