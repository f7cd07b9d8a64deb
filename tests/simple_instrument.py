"""An instrument in memory whose every reading has a closed form: for tests of what drives one.

Axes are straight lines between voltage and position, motion is exact at every instant, and time
passes only by `pause` and by a millisecond with each question, so that a loop without a pause
ends. Faults are put in by hand: `cut_link_at`, `nan_from`, `fail_at`; `log` holds every order.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_position, check_voltage, check_waveform
from flexstage.instruments.protocol import Capability, Identity, Signal, Waveform
from flexstage.records import Channel, Record
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings

GAINS = {"x": 4.8e-7, "y": 4.3e-7}  # m/V
PIEZO = AxisLimits(position=(-1e-6, 58e-6), voltage=(0.0, 120.0), slew=4e4)
SCREW = AxisLimits(position=(0.0, 6e-3), speed=1e-3)
QUESTION = 1e-3  # what a question takes [s]


class Stretch(NamedTuple):
    """What an axis is told from an instant on: samples joined by straight lines, then the last."""

    begin: float
    closed: bool  # the values are positions
    values: Array
    rate: float
    cycles: int

    @property
    def end(self) -> float:
        if self.values.size == 1:
            return self.begin
        return self.begin + (self.values.size * self.cycles / self.rate if self.cycles else np.inf)

    def at(self, time: Array) -> Array:
        n = self.values.size
        k = np.maximum(time - self.begin, 0.0) * self.rate
        k = np.where(np.abs(k - np.round(k)) < 1e-6, np.round(k), k)  # on a sample: exactly it
        if self.cycles:
            k = np.minimum(k, n * self.cycles - 1)
        return np.interp(k % n, np.arange(n + 1), np.append(self.values, self.values[0]))


class SimpleAxis:
    """An axis that is where it is told to be."""

    def __init__(self, owner: "SimpleInstrument", name: str, limits: AxisLimits, gain: float):
        self._owner, self.name, self._limits, self.gain = owner, name, limits, gain
        self.kind = "screw" if limits.voltage is None else "piezo"
        first = Stretch(0.0, self.kind == "screw", np.zeros(1), 1.0, 1)
        self.told = [first]
        self._servo = ServoSettings(integral=3.1e8)

    @property
    def capabilities(self) -> frozenset[Capability]:
        if self.kind == "screw":
            return frozenset({Capability.CLOSED_LOOP})
        return frozenset(
            {
                Capability.CLOSED_LOOP,
                Capability.OPEN_LOOP,
                Capability.SERVO_TUNING,
                Capability.FEEDFORWARD_TABLE,
            }
        )

    @property
    def limits(self) -> AxisLimits:
        return self._limits

    @property
    def closed_loop(self) -> bool:
        self._owner.ask()
        return self.told[-1].closed

    def reference(self):
        pass

    def set_closed_loop(self, on: bool) -> None:
        self._owner.order(f"servo {self.name} {'on' if on else 'off'}")
        if self.kind == "screw":
            return
        now = self._owner.now
        value = self.positions_at(np.array([now])) if on else self.voltages_at(np.array([now]))
        self.told.append(Stretch(now, on, value, 1.0, 1))

    def positions_at(self, time: Array) -> Array:
        return self._commands_at(time, position=True)

    def voltages_at(self, time: Array) -> Array:
        return self._commands_at(time, position=False)

    def _commands_at(self, time: Array, *, position: bool) -> Array:
        begins = [stretch.begin for stretch in self.told]
        which = np.searchsorted(begins, time, side="right") - 1
        out = np.empty(time.size)
        for k in np.unique(which):
            stretch, chosen = self.told[k], which == k
            v = stretch.at(time[chosen])
            if position:
                out[chosen] = v if stretch.closed else v * self.gain
            else:
                out[chosen] = v / self.gain if stretch.closed else v
        return out

    def position(self) -> float:
        self._owner.ask()
        return self._owner.reading(f"{self.name}", self.positions_at)

    def voltage(self) -> float:
        self._owner.ask()
        if self.kind == "screw":
            raise ModelError(f"axis '{self.name}' has no voltage")
        return float(self.voltages_at(np.array([self._owner.now]))[0])

    def move_to(self, position: float, *, wait: bool = True) -> None:
        check_position(self._limits, position, self.name)
        if not self.closed_loop:
            raise ControllerError(f"the position control of axis '{self.name}' is off", 2)
        self._owner.order(f"move {self.name} {position:.9g}")
        self._ramp(position, self._limits.speed or 1e-2)
        if wait:
            self.wait()

    def set_voltage(self, voltage: float) -> None:
        check_voltage(self._limits, voltage, self.name)
        if self.closed_loop:
            raise ControllerError(f"the position control of axis '{self.name}' is on", 1)
        self._owner.order(f"voltage {self.name} {voltage:.9g}")
        self._ramp(voltage, self._limits.slew or np.inf)

    def _ramp(self, value: float, speed: float) -> None:
        now, closed = self._owner.now, self.told[-1].closed
        here = float(self.told[-1].at(np.array([now]))[0])
        time = abs(value - here) / speed
        if time == 0.0:
            self.told.append(Stretch(now, closed, np.array([value]), 1.0, 1))
        else:
            self.told.append(Stretch(now, closed, np.array([here, value]), 1.0 / time, 1))

    def moving(self) -> bool:
        self._owner.ask()
        last = self.told[-1]
        if last.values.size == 2 and last.cycles == 1:  # a ramp ends at its second sample
            return self._owner.now < last.begin + 1.0 / last.rate
        return self._owner.now < last.end

    def wait(self, timeout: float = 30.0) -> None:
        end = self._owner.now + timeout
        while self.moving():
            if self._owner.now > end:
                self._owner.stop()
                raise ControllerError(f"axis '{self.name}' did not stand after {timeout:g} s")
            self._owner.pause(0.01)

    def servo(self) -> ServoSettings:
        return self._servo

    def set_servo(self, settings: ServoSettings) -> None:
        self._servo = settings

    def hold(self) -> None:
        now, closed = self._owner.now, self.told[-1].closed
        self.told.append(Stretch(now, closed, self.told[-1].at(np.array([now])), 1.0, 1))


class SimpleRecorder:
    """Samples the closed forms."""

    base_rate_hz = 1e4
    capacity = 2**18
    signals = 8

    def __init__(self, owner: "SimpleInstrument"):
        self._owner = owner
        self.chosen: tuple[Signal, ...] = ()
        self.rate, self.samples = self.base_rate_hz, 0
        self.armed, self.begin = False, np.inf

    def configure(self, signals: Sequence[Signal], rate_hz: float, samples: int) -> float:
        if not 0 < len(signals) <= self.signals or not 0 < samples <= self.capacity:
            raise ModelError(f"cannot record {len(signals)} signals of {samples} samples")
        for signal in signals:
            self._owner.values(signal, np.zeros(1))
        self._owner.order(f"record {' '.join(s.name for s in signals)} {samples}")
        self.chosen, self.samples, self.begin = tuple(signals), samples, np.inf
        self.rate = self.base_rate_hz / max(round(self.base_rate_hz / rate_hz), 1)
        return self.rate

    def arm(self) -> None:
        self._owner.order("arm")
        self.armed, self.begin = True, np.inf

    def start(self) -> None:
        self._owner.order("start record")
        self.armed, self.begin = False, self._owner.now

    def trigger(self) -> None:
        if self.armed:
            self.armed, self.begin = False, self._owner.now

    def available(self) -> int:
        self._owner.ask()
        if self._owner.now < self.begin:
            return 0
        return min(self.samples, int((self._owner.now - self.begin) * self.rate + 1e-6) + 1)

    def read(self, first: int, count: int) -> Record:
        if first < 0 or count < 2 or first + count > self.available():
            raise ModelError(f"there are no samples {first} to {first + count - 1}")
        k = np.arange(first, first + count)
        time = self.begin + k / self.rate
        found = tuple(
            Channel(name=s.name, values=self._owner.values(s, time), unit=s.unit)
            for s in self.chosen
        )
        return Record(channels=found, time=k / self.rate, source="simple instrument")


class SimpleWaves:
    """Runs waveforms exactly."""

    base_rate_hz = 1e4
    capacity = 2**18

    def __init__(self, owner: "SimpleInstrument"):
        self._owner = owner
        self.loaded: Waveform | None = None
        self.feedforward: Waveform | None = None
        self.end = -np.inf

    def load(self, waveform: Waveform, *, feedforward: Waveform | None = None) -> None:
        for given in (waveform, feedforward):
            if given is not None:
                check_waveform({n: a.limits for n, a in self._owner.axes.items()}, given)
        self._owner.order(f"load {waveform.quantity} {' '.join(waveform.values)} {waveform.size}")
        self.loaded, self.feedforward = waveform, feedforward

    def start(self, cycles: int = 1) -> None:
        wave, axes, now = self.loaded, self._owner.axes, self._owner.now
        if wave is None:
            raise ControllerError("there is no waveform")
        closed, at = wave.quantity == "position", np.array([now])
        stand = {
            n: float((axes[n].positions_at if closed else axes[n].voltages_at)(at)[0])
            for n in wave.values
        }
        limits = {n: a.limits for n, a in axes.items()}
        check_waveform(limits, wave, cycles=cycles, start=stand, tolerance=1e-9)
        if wrong := [n for n in wave.values if axes[n].told[-1].closed != closed]:
            raise ControllerError(f"axis '{wrong[0]}' does not take a {wave.quantity} now")
        self._owner.order(f"start wave {cycles}")
        for name, values in wave.values.items():
            stretch = Stretch(now, closed, np.asarray(values), wave.sample_rate_hz, cycles)
            axes[name].told.append(stretch)
            self.end = stretch.end
        self._owner.recorder.trigger()

    def running(self) -> bool:
        self._owner.ask()
        return self._owner.now < self.end

    def stop(self) -> None:
        self._owner.order("stop wave")
        self.end = self._owner.now
        for axis in self._owner.axes.values():
            axis.hold()


@dataclass(kw_only=True)
class SimpleInstrument:
    """Two piezo axes (or screws), a recorder, waveforms, and sensors that are sums of positions."""

    limits: Mapping[str, AxisLimits] = field(default_factory=lambda: {"x": PIEZO, "y": PIEZO})
    gains: Mapping[str, float] = field(default_factory=lambda: GAINS)
    #: Unit of each channel, and what it reads of each axis; those of the axes come first.
    sensors: Mapping[int, tuple[str, Mapping[str, float]]] = field(
        default_factory=lambda: {
            1: ("m", {"x": 1.0}),
            2: ("m", {"y": 1.0}),
            3: ("m", {"x": 0.013, "y": -0.004}),
            4: ("rad", {"x": 0.31}),
        }
    )
    generator: bool = True
    simulated: bool = True
    concurrent: bool = False
    cut_link_at: float = np.inf  # from this time on no order and no question is answered [s]
    fail_at: float = np.inf  # the controller refuses orders from this time on [s]
    nan_from: Mapping[str, float] = field(default_factory=dict)  # name of a column: time [s]
    noise: float = 0.0  # standard deviation of sensors [m]
    seed: int = 0

    def __post_init__(self) -> None:
        self.now, self.stops, self.closed = 0.0, 0, False
        self.log: list[str] = []
        self.axes = {
            name: SimpleAxis(self, name, given, self.gains.get(name, 1.0))
            for name, given in self.limits.items()
        }
        self.recorder = SimpleRecorder(self)
        self._waves = SimpleWaves(self)
        self._rng = np.random.default_rng(self.seed)
        self._struck: tuple[str, float] | None = None

    @property
    def identity(self) -> Identity:
        return Identity(
            vendor="flexstage", model="in memory", serial_number="S7", simulated=self.simulated
        )

    @property
    def capabilities(self) -> frozenset[Capability]:
        found = {Capability.DATA_RECORDER, Capability.CHANNELS, Capability.IMPACT}
        for axis in self.axes.values():
            found |= axis.capabilities
        return frozenset(found | ({Capability.WAVE_GENERATOR} if self.generator else set()))

    @property
    def waves(self) -> SimpleWaves:
        if not self.generator:
            raise ModelError("this instrument runs no waveforms")
        return self._waves

    def ask(self) -> None:
        """A question: it takes its time, and needs the link."""
        if self.now >= self.cut_link_at:
            raise NotConnectedError("the link to the instrument is gone")
        self.now += QUESTION

    def order(self, text: str) -> None:
        """An order: it needs the link, and that nothing is wrong."""
        if self.now >= self.cut_link_at:
            raise NotConnectedError("the link to the instrument is gone")
        if self.now >= self.fail_at:
            raise ControllerError("the controller refuses", 5)
        self.log.append(text)

    def values(self, signal: Signal, time: Array) -> Array:
        """What a signal is at some times [SI]."""
        if signal.kind in ("position", "target", "voltage"):
            axis = self.axes[signal.source]
            v = (axis.voltages_at if signal.kind == "voltage" else axis.positions_at)(time)
        elif signal.kind == "channel":
            v = self._sensor(int(signal.source), time)
        else:
            v = self._blow(signal.kind, time)
        if signal.kind in ("position", "channel") and self.noise:
            v = v + self.noise * self._rng.standard_normal(time.size)
        bad = time >= self.nan_from.get(signal.name, np.inf)
        return np.where(bad, np.nan, v)

    def reading(self, name: str, function: Callable[[Array], Array]) -> float:
        """What a sensor says now."""
        v = function(np.array([self.now]))[0] + self.noise * self._rng.standard_normal()
        return float("nan") if self.now >= self.nan_from.get(name, np.inf) else float(v)

    def _sensor(self, number: int, time: Array) -> Array:
        if number not in self.sensors:
            raise ModelError(f"there is no sensor {number}")
        factors = self.sensors[number][1]
        return sum((f * self.axes[a].positions_at(time) for a, f in factors.items()), 0.0 * time)

    def _blow(self, kind: str, time: Array) -> Array:
        t = time - (self._struck[1] if self._struck else np.inf)
        t = np.where(np.isfinite(t), t, -1.0)
        if kind == "force":
            return np.where((t >= 0.0) & (t < 3e-3), 21.0 * np.sin(np.pi * t / 3e-3), 0.0)
        return np.where(t >= 0.0, 1e-6 * np.exp(-17.0 * t) * np.sin(2e3 * t), 0.0)

    def channel(self, number: int) -> float:
        self.ask()
        return self.reading(str(number), lambda time: self._sensor(number, time))

    def strike(self, axis: str) -> None:
        self.order(f"strike {axis}")
        self.recorder.trigger()
        self._struck = (axis, self.now + 0.01)

    def pause(self, seconds: float) -> None:
        self.now += seconds

    def stop(self) -> None:
        if self.now >= self.cut_link_at:
            self.log.append("stop that nobody heard")
            return
        self.stops += 1
        self.log.append("stop")
        self._waves.end = self.now
        for axis in self.axes.values():
            axis.hold()

    def settings(self) -> Mapping[str, str]:
        return {"servo": " ".join(f"{n}={a.told[-1].closed}" for n, a in self.axes.items())}

    def close(self) -> None:
        self.closed = True
