"""A stand-in for NI's Python package that minds every name and argument of the real one.

Each call is bound to the signature of the real method, so that a name or an argument that NI's
package does not have fails here as it would there. Behind it is a card of which each input reads
a number of its own plus the number of the sample, and whose outputs hold what was put out last.
"""

import inspect
import re
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import nidaqmx
import nidaqmx.constants
import nidaqmx.errors
import nidaqmx.stream_readers
import nidaqmx.stream_writers
import nidaqmx.system
import numpy as np
from nidaqmx.task import InStream, OutStream, Task, Timing
from nidaqmx.task.collections import AIChannelCollection, AOChannelCollection
from nidaqmx.task.triggering import StartTrigger, Triggers

#: What the properties of NI's classes give.
PARTS: dict[tuple[type, str], type] = {
    (Task, "ai_channels"): AIChannelCollection,
    (Task, "ao_channels"): AOChannelCollection,
    (Task, "timing"): Timing,
    (Task, "triggers"): Triggers,
    (Task, "in_stream"): InStream,
    (Task, "out_stream"): OutStream,
    (Triggers, "start_trigger"): StartTrigger,
}

#: A multiplexed card of the X series.
FACTS: dict[str, Any] = {
    "product_type": "PCIe-6363",
    "product_category": nidaqmx.constants.ProductCategory.X_SERIES_DAQ,
    "serial_num": 0x1D0C2AF,
    "is_simulated": False,
    "ai_max_single_chan_rate": 2e6,
    "ai_max_multi_chan_rate": 1e6,
    "ai_simultaneous_sampling_supported": False,
    "ao_max_rate": 2.86e6,
    "ao_samp_clk_supported": True,
}

PER_POLL = 250  # samples that come with each question


class Card:
    """What the stand-in's tasks share: a log, a clock, what was put out, and faults."""

    def __init__(self) -> None:
        self.log: list[tuple[str, dict[str, Any]]] = []
        self.tasks: list[Node] = []
        self.faults: dict[str, int] = {}  # name of a call: number of the error it raises
        self.held: dict[str, float] = {}
        self.ready: list[bool] = []  # whether who takes the clock of the inputs was started first
        self.facts: dict[str, Any] = dict(FACTS)  # what the card answers
        self.readable = True  # it has channels inside that read its outputs
        self.ahead = 0  # samples in its memory that count as put out

    def names(self) -> list[str]:
        return [name for name, _ in self.log]

    def only(self, name: str) -> dict[str, Any]:
        found = [arguments for n, arguments in self.log if n == name]
        assert len(found) == 1, (name, len(found))
        return found[0]

    def library(self) -> ModuleType:
        """The package, as `DaqmxBackend` takes it."""
        for name in ("Task", "constants", "errors", "stream_readers", "stream_writers", "system"):
            assert hasattr(nidaqmx, name)
        found = SimpleNamespace(
            __version__="of the tests",
            Task=lambda *a, **k: self._made(Task, "Task", a, k),
            constants=nidaqmx.constants,
            errors=nidaqmx.errors,
            stream_readers=self._module(nidaqmx.stream_readers, "AnalogMultiChannelReader"),
            stream_writers=self._module(nidaqmx.stream_writers, "AnalogMultiChannelWriter"),
            system=self._module(nidaqmx.system, "Device"),
        )
        return cast("ModuleType", found)

    def _module(self, real: ModuleType, name: str) -> SimpleNamespace:
        kind = getattr(real, name)
        return SimpleNamespace(**{name: lambda *a, **k: self._made(kind, name, a, k)})

    def _made(self, kind: type, name: str, args: Any, options: Any) -> "Node":
        bound = inspect.signature(kind.__init__).bind(None, *args, **options)
        bound.apply_defaults()
        node = Node(self, kind, name, None)
        given = {k: v for k, v in bound.arguments.items() if k != "self"}
        node.task = next((v.task for v in given.values() if isinstance(v, Node)), node)
        if kind is Task:
            self.tasks.append(node)
            node.state = State()
        self.raise_fault(name)
        self.log.append((name, given))
        return node

    def raise_fault(self, name: str) -> None:
        if name in self.faults:
            raise nidaqmx.errors.DaqError("The words of the driver.\nMore.", self.faults[name])


class State:
    """What a task knows."""

    def __init__(self) -> None:
        self.channels: list[str] = []
        self.rate, self.size = 0.0, 0
        self.started = self.stopped = self.closed = False
        self.source = self.trigger = ""
        self.acquired = self.read = 0
        self.samples = np.empty((0, 0))
        self.generated = 0


class Node:
    """An object of NI's package: only what the real class has can be had, called as it is there."""

    task: "Node"
    state: State

    def __init__(self, card: Card, kind: type, name: str, task: "Node | None") -> None:
        self._card, self._kind, self._name = card, kind, name
        if task is not None:
            self.task = task

    def __getattr__(self, attribute: str) -> Any:
        if attribute in ("task", "state"):
            raise AttributeError(attribute)
        member = inspect.getattr_static(self._kind, attribute)  # AttributeError as the real one
        name = f"{self._name}.{attribute}"
        if isinstance(member, property):
            if (part := PARTS.get((self._kind, attribute))) is not None:
                return Node(self._card, part, name, self.task)
            self._card.raise_fault(name)
            if self._kind is nidaqmx.system.Device:
                return self._card.facts[attribute]
            return ANSWERS[name](self._card, self.task.state)
        signature = inspect.signature(member)

        def call(*args: Any, **options: Any) -> Any:
            bound = signature.bind(self, *args, **options)
            bound.apply_defaults()
            given = {k: v for k, v in bound.arguments.items() if k != "self"}
            self._card.log.append((name, given))
            self._card.raise_fault(name)
            return ACTIONS.get(name, lambda *_: None)(self._card, self.task.state, given)

        return call


def advance(card: Card, count: int) -> None:
    """Let the inputs sample, and the outputs that go with their clock follow."""
    for node in card.tasks:
        s = node.state
        if s.started and not s.closed and not s.stopped:
            s.acquired += count
            if s.samples.size:
                s.generated = min(s.generated + count, s.samples.shape[1])


def available(card: Card, state: State) -> int:
    advance(card, PER_POLL)
    return state.acquired - state.read


def read_many(card: Card, state: State, given: dict[str, Any]) -> int:
    data, count = given["data"], given["number_of_samples_per_channel"]
    assert data.dtype == np.float64
    assert data.flags.c_contiguous
    assert data.shape == (len(state.channels), count)
    k = np.arange(state.read, state.read + count)
    for row, channel in zip(data, state.channels, strict=True):
        row[:] = value(channel) + 1e-6 * k
    state.read += count
    return count


def value(channel: str) -> float:
    """What an input reads."""
    return 0.1 * (1 + int(channel.split("ai")[1]))


def output_inside(channel: str) -> str:
    """The output that a channel inside the card reads; empty where it is an input."""
    found = re.fullmatch(r"(\w+)/_(ao\d+)_vs_aognd", channel)
    return "/".join(found.groups()) if found else ""


def read_one(card: Card, state: State, given: dict[str, Any]) -> None:
    given["data"][:] = [
        card.held.get(output, 0.0) if (output := output_inside(c)) else value(c)
        for c in state.channels
    ]


def add_input(card: Card, state: State, given: dict[str, Any]) -> None:
    channel = given["physical_channel"]
    if output_inside(channel) and not card.readable:
        raise nidaqmx.errors.DaqError("Physical channel does not exist.", -200170)
    state.channels.append(channel)


def write_many(card: Card, state: State, given: dict[str, Any]) -> int:
    data = given["data"]
    assert data.dtype == np.float64
    assert data.flags.c_contiguous
    assert data.shape == (len(state.channels), state.size)
    state.samples = data.copy()
    return state.size


def write_one(card: Card, state: State, given: dict[str, Any]) -> None:
    assert given["data"].shape == (len(state.channels),)
    card.held |= dict(zip(state.channels, given["data"].tolist(), strict=True))


def clock(card: Card, state: State, given: dict[str, Any]) -> None:
    state.rate, state.size, state.source = given["rate"], given["samps_per_chan"], given["source"]


def start(card: Card, state: State, given: dict[str, Any]) -> None:
    others = (node.state for node in card.tasks if not node.state.closed)
    waiting = [s for s in others if s.source]
    if not state.samples.size:
        card.ready.append(all(s.started for s in waiting))
    state.started = True


def trigger(card: Card, state: State, given: dict[str, Any]) -> None:
    state.trigger = given["trigger_source"]


def done(card: Card, state: State, given: dict[str, Any]) -> bool:
    advance(card, PER_POLL)
    hold(card, state)
    return state.stopped or state.generated >= state.samples.shape[1]


def stop(card: Card, state: State, given: dict[str, Any]) -> None:
    state.stopped = True
    hold(card, state)


def hold(card: Card, state: State) -> None:
    """Outputs go on giving what they gave."""
    if state.generated:
        card.held |= dict(zip(state.channels, state.samples[:, state.generated - 1], strict=True))


def counted(card: Card, state: State) -> int:
    return min(state.generated + card.ahead, state.samples.shape[1])


def close(card: Card, state: State, given: dict[str, Any]) -> None:
    state.closed = True


ACTIONS: dict[str, Callable[[Card, State, dict[str, Any]], Any]] = {
    "Task.ai_channels.add_ai_voltage_chan": add_input,
    "Task.ao_channels.add_ao_voltage_chan": lambda c, s, g: s.channels.append(
        g["physical_channel"]
    ),
    "Task.timing.cfg_samp_clk_timing": clock,
    "Task.start": start,
    "Task.triggers.start_trigger.cfg_dig_edge_start_trig": trigger,
    "Task.stop": stop,
    "Task.close": close,
    "Task.is_task_done": done,
    "AnalogMultiChannelReader.read_many_sample": read_many,
    "AnalogMultiChannelReader.read_one_sample": read_one,
    "AnalogMultiChannelWriter.write_many_sample": write_many,
    "AnalogMultiChannelWriter.write_one_sample": write_one,
}

ANSWERS: dict[str, Callable[[Card, State], Any]] = {
    "Task.timing.samp_clk_rate": lambda c, s: s.rate,
    "Task.in_stream.avail_samp_per_chan": available,
    "Task.timing.ai_conv_rate": lambda c, s: 1e6 / 11.0,  # 1 us, and 10 us to settle
    "Task.out_stream.total_samp_per_chan_generated": counted,
}
