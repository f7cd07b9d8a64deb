"""A device that is exact by formula, to test servers of commands with: no physics, no noise."""

import dataclasses
import math

import numpy as np

from flexstage.instruments.pi.simulated.clock import FastTime
from flexstage.instruments.pi.simulated.device import AxisDescription, Refusal, RefusedError
from flexstage.instruments.pi.simulated.gcs_state import GENERIC
from flexstage.instruments.pi.simulated.interpreter import Interpreter
from flexstage.instruments.pi.simulated.server import ServerSession
from flexstage.instruments.protocol import Capability, Identity
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.sensors import ChannelDescription

RATE = 10e3
#: Displacement of the drives [m/V].
GAIN = (0.5e-6, 0.25e-6)
PIEZO = frozenset(
    {
        Capability.CLOSED_LOOP,
        Capability.OPEN_LOOP,
        Capability.SERVO_TUNING,
        Capability.FEEDFORWARD_TABLE,
    }
)
SCREW = frozenset({Capability.CLOSED_LOOP})


DELIVERED = ServoSettings(
    integral=1.9e9, notches=(Notch(frequency_hz=800.0, zero_damping=0.01, pole_damping=0.25),)
)


@dataclasses.dataclass
class Axis:
    """What is commanded: a straight line from one value to another; or a wave."""

    speed: float
    servo: bool = False
    start: float = 0.0
    end: float = 0.0
    since: float = 0.0
    target: float = 0.0
    settings: ServoSettings = DELIVERED
    choice: tuple = (0, 0)
    cycles: int = 1
    wave: np.ndarray | None = None


def refuse(reason):
    raise RefusedError(reason)


class FormulaRecorder:
    """The tables of records of a device by formula."""

    count, capacity = 3, 2000

    def __init__(self, device):
        self.device = device

    def signal(self, table):
        return self.device.signals.get(table)

    @property
    def divider(self):
        return self.device.divider

    def set_divider(self, divider):
        self.device.divider = divider

    @property
    def recorded(self):
        return self.device.filled

    @property
    def recording(self):
        return self.device.filled < self.device.full

    def read(self, table, first, count):
        return np.array(self.device.data[table][first : first + count])


class FormulaTables:
    """The tables of waveforms of a device by formula."""

    count, capacity = 4, 5000

    def __init__(self, device):
        self.device = device

    def samples(self, table):
        return self.device.waves.get(table, np.empty(0))

    def size(self, table):
        return self.samples(table).size

    def room(self, table):
        return self.capacity - sum(w.size for k, w in self.device.waves.items() if k != table)


class FormulaDevice:
    """Two axes, `piezo` (moved by a voltage, exact under control) or screws."""

    sample_rate_hz = RATE

    def __init__(self, kind="piezo"):
        limits = (
            AxisLimits(position=(-2e-6, 60e-6), voltage=(-5.0, 120.0), slew=4e4, speed=2e-3),
            AxisLimits(position=(1e-6, 31e-6), voltage=(0.0, 100.0), slew=4e4, speed=1e-3),
        )
        if kind == "screw":
            limits = tuple(AxisLimits(position=(0.0, 1e-3), speed=1e-4) for _ in limits)
        self.axes = {
            str(i): AxisDescription(
                name=str(i),
                stage_axis=axis,
                kind=kind,
                limits=limit,
                capabilities=PIEZO if kind == "piezo" else SCREW,
            )
            for i, axis, limit in zip((1, 2), "xy", limits, strict=True)
        }
        self.kind = kind
        self.channels = tuple(
            ChannelDescription(number=i, name=name, unit=unit)
            for i, name, unit in ((1, "x", "m"), (2, "y", "m"), (3, "x.yaw", "rad"))
        )
        self.identity = Identity(
            vendor="flexstage", model="formula", serial_number="7", firmware="1.2", simulated=True
        )
        self.gain = dict(zip(self.axes, GAIN, strict=True))
        self.recorder, self.tables = FormulaRecorder(self), FormulaTables(self)
        self.samples = 0
        self.calls = []
        self.fresh()

    def fresh(self):
        speeds = (2e-3, 1e-3) if self.kind == "piezo" else (1e-4, 1e-4)
        self.state = {
            name: Axis(speed=v, servo=self.kind == "screw")
            for name, v in zip(self.axes, speeds, strict=True)
        }
        self.part = 0.0
        self.zeros = set()
        self.waves = {}
        self.wave_divider = self.divider = 1
        self.signals = {}
        self.armed = None
        self.kept, self.data, self.first, self.filled, self.full = {}, {}, 0, 0, 0
        self.drives_out = False
        self.blow = False

    @property
    def now(self):
        return self.samples / RATE

    def advance(self, seconds):
        self.part += seconds * RATE
        count = round(self.part // 1.0)
        self.part -= count
        if self.filled < self.full:
            numbers = np.arange(self.samples + 1, self.samples + count + 1)
            wanted = numbers[(numbers - self.first) % self.divider == 0][: self.full - self.filled]
            for table, signal in self.kept.items():
                self.data[table].extend(self.values(signal, wanted / RATE).tolist())
            self.filled += wanted.size
        self.samples += count
        for axis in self.state.values():
            if axis.wave is not None and axis.cycles and self.now >= self.wave_end(axis):
                axis.start = axis.end = float(axis.wave[-1])
                if axis.servo:
                    axis.target = axis.end
                axis.wave = None

    def wave_end(self, axis):
        return axis.since + axis.cycles * axis.wave.size * self.wave_divider / RATE

    def line(self, axis, t):
        """The commanded value at times."""
        if axis.wave is not None:
            steps = np.floor((t - axis.since) * RATE / self.wave_divider + 1e-6).astype(int)
            return axis.wave[np.clip(steps, 0, None) % axis.wave.size]
        rate = axis.speed if axis.servo else 4e4
        way = abs(axis.end - axis.start)
        gone = np.clip((t - axis.since) * rate, 0.0, way)
        return np.where(gone >= way, axis.end, axis.start + np.sign(axis.end - axis.start) * gone)

    def position_at(self, name, t):
        axis = self.state[name]
        return self.line(axis, t) * (1.0 if axis.servo else self.gain[name])

    def values(self, signal, t):
        axis = self.state.get(signal.source)
        if signal.kind == "channel":
            return np.full(t.shape, self.channel(int(signal.source)))
        if signal.kind == "position":
            return self.position_at(signal.source, t)
        if signal.kind == "error":
            return axis.target - self.position_at(signal.source, t)
        if signal.kind == "target":
            return np.full(t.shape, axis.target)
        if signal.kind == "voltage":
            return self.position_at(signal.source, t) / self.gain[signal.source]
        return np.sin(np.arange(t.size) + 1.0) * self.blow

    def begin(self, name, end):
        axis = self.state[name]
        axis.start, axis.end, axis.since = self.line_now(axis), end, self.now

    def line_now(self, axis):
        """The same now, without arrays of one number: most of what a conversation asks for."""
        if axis.wave is not None:
            return float(self.line(axis, np.array([self.now]))[0])
        rate = axis.speed if axis.servo else 4e4
        way = abs(axis.end - axis.start)
        gone = min(max((self.now - axis.since) * rate, 0.0), way)
        return axis.end if gone >= way else axis.start + math.copysign(gone, axis.end - axis.start)

    def reboot(self):
        self.calls.append("reboot")
        self.fresh()

    def servo_on(self, axis):
        return self.state[axis].servo

    def set_servo(self, axis, on):
        self.calls.append(("servo", axis, on))
        if self.kind == "screw":
            refuse(Refusal.NOT_ABLE)
        state = self.state[axis]
        if state.wave is not None:
            refuse(Refusal.WAVE_RUNNING)
        position = self.position(axis)
        state.servo = on
        value = position if on else position / self.gain[axis]
        state.start = state.end = value
        if on:
            state.target = position

    def target(self, axis):
        return self.state[axis].target

    def set_targets(self, targets):
        for name, value in targets.items():
            low, high = self.axes[name].limits.position
            if self.state[name].wave is not None:
                refuse(Refusal.WAVE_RUNNING)
            if not self.state[name].servo:
                refuse(Refusal.SERVO_OFF)
            if not low <= value <= high:
                refuse(Refusal.OUT_OF_LIMITS)
        self.calls.append(("targets", dict(targets)))
        self.trigger("move")
        for name, value in targets.items():
            self.begin(name, value)
            self.state[name].target = value

    def command(self, axis):
        return self.state[axis].end if not self.state[axis].servo else self.voltage(axis)

    def set_commands(self, commands):
        for name, value in commands.items():
            if self.kind == "screw":
                refuse(Refusal.NOT_ABLE)
            low, high = self.axes[name].limits.voltage
            if self.state[name].wave is not None:
                refuse(Refusal.WAVE_RUNNING)
            if self.state[name].servo:
                refuse(Refusal.SERVO_ON)
            if not low <= value <= high:
                refuse(Refusal.VOLTAGE_OUT_OF_LIMITS)
        self.calls.append(("commands", dict(commands)))
        self.trigger("move")
        for name, value in commands.items():
            self.begin(name, value)

    def speed(self, axis):
        return self.state[axis].speed

    def set_speed(self, axis, speed):
        if not 0.0 < speed <= self.axes[axis].limits.speed * (1.0 + 1e-6):
            refuse(Refusal.SPEED_OUT_OF_LIMITS)
        self.begin(axis, self.state[axis].end)
        self.state[axis].speed = speed

    def set_zero(self, voltages):
        for name, value in voltages.items():
            low, high = self.axes[name].limits.voltage
            if self.state[name].wave is not None:
                refuse(Refusal.WAVE_RUNNING)
            if value is not None and not low <= value <= high:
                refuse(Refusal.VOLTAGE_OUT_OF_LIMITS)
        for name in voltages:
            if self.state[name].servo:
                self.set_servo(name, False)
        lowest = {name: max(self.axes[name].limits.voltage[0], 0.0) for name in voltages}
        self.set_commands({n: lowest[n] if v is None else v for n, v in voltages.items()})
        self.zeros |= set(voltages)

    def zeroing(self, axis):
        self.zeros -= {name for name in self.zeros if not self.moving(name)}
        return axis in self.zeros

    def position(self, axis):
        state = self.state[axis]
        return self.line_now(state) * (1.0 if state.servo else self.gain[axis])

    def voltage(self, axis):
        return self.position(axis) / self.gain[axis]

    def on_target(self, axis):
        return not self.moving(axis)

    def moving(self, axis):
        state = self.state[axis]
        return state.wave is not None or self.line_now(state) != state.end

    def channel(self, number):
        return 1e-6 * number if number == 3 else self.position(str(number))

    def stop(self, axes=None):
        self.calls.append(("stop", axes))
        for name in axes if axes is not None else self.axes:
            state = self.state[name]
            value = self.line_now(state)
            state.wave = None
            state.start = state.end = value
            if state.servo:
                state.target = value

    def servo(self, axis):
        return self.state[axis].settings

    def set_servo_settings(self, axis, settings):
        if self.kind == "screw":
            refuse(Refusal.NOT_ABLE)
        self.state[axis].settings = settings

    def set_wave(self, table, samples):
        if samples.size > self.tables.room(table):
            refuse(Refusal.TABLE_FULL)
        if any(axis.wave is not None and table in axis.choice for axis in self.state.values()):
            refuse(Refusal.WAVE_RUNNING)
        self.waves[table] = np.array(samples)

    def append_wave(self, table, samples):
        self.set_wave(table, np.concatenate((self.tables.samples(table), samples)))

    def set_wave_rate_divider(self, divider):
        if not 1 <= divider <= 10000:
            refuse(Refusal.BAD_VALUE)
        if any(axis.wave is not None for axis in self.state.values()):
            refuse(Refusal.WAVE_RUNNING)
        self.wave_divider = divider

    def wave_choice(self, axis):
        return self.state[axis].choice

    def choose_wave(self, axis, table, feedforward=0):
        self.state[axis].choice = (table, feedforward)

    def set_wave_cycles(self, axis, cycles):
        if self.state[axis].wave is not None:
            refuse(Refusal.WAVE_RUNNING)
        self.state[axis].cycles = cycles

    def largest_speed(self, axis):
        return self.axes[axis].limits.speed

    def start_waves(self, axes, onward, scales):
        tables = {}
        for name in axes:
            state, limits = self.state[name], self.axes[name].limits
            unit, offset = scales[name]
            table = tables[name] = (self.tables.samples(state.choice[0]) + offset) * unit
            if not table.size:
                refuse(Refusal.NO_WAVE)
            low, high = limits.position if state.servo else limits.voltage
            if not (np.all(table >= low) and np.all(table <= high)):
                refuse(Refusal.OUT_OF_LIMITS)
        self.calls.append(("waves", tuple(axes)))
        self.trigger("wave")
        for name in axes:
            state = self.state[name]
            state.wave, state.since = tables[name], self.now

    def stop_waves(self, axes):
        self.stop([name for name in axes if self.state[name].wave is not None])

    def wave_running(self, axis):
        return self.state[axis].wave is not None

    def set_record_signal(self, table, signal):
        self.signals.pop(table, None)
        if signal is not None:
            self.signals[table] = signal

    def arm_recorder(self, trigger):
        self.full = self.filled
        self.armed = trigger
        if trigger == "now":
            self.trigger("now")

    def trigger(self, what):
        if self.armed == what:
            self.armed = None
            self.kept = dict(self.signals)
            self.data = {table: [] for table in self.kept}
            self.first, self.filled = self.samples + 1, 0
            self.full = self.recorder.capacity if self.kept else 0

    def remove_drives(self, removed):
        if any(axis.servo for axis in self.state.values()):
            refuse(Refusal.SERVO_ON)
        self.drives_out = removed

    def strike(self, axis):
        self.calls.append(("strike", axis))
        self.blow = True
        self.trigger("wave")


def controller(kind="piezo", *, model=GENERIC):
    """A controller on the device by formula, whose time passes with commands."""
    device = FormulaDevice(kind)
    return Interpreter(device, FastTime(device), model=model)


def talk(session, text):
    """Say lines; return what is answered and, line by line, which errors there were."""
    answers, errors = b"", []
    for line in text.strip().split("\n"):
        answers += session.feed(line.strip().encode("latin-1") + b"\n")
        errors.append(int(session.feed(b"ERR?\n")))
    return answers.decode("latin-1"), [e for e in errors if e] or 0


def opened(kind="piezo", *, model=GENERIC):
    """A session of a controller of its own."""
    return ServerSession(controller(kind, model=model))
