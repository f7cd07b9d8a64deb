"""Whatever a client says: time in portions makes no difference, and limits are never left."""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.device import RefusedError
from flexstage.instruments.protocol import Signal
from flexstage.system.servo import ServoSettings
from tests.simple_stage import PIEZO, RANGE, SCREW, SimpleStage

Command = tuple[str, tuple[Any, ...]]

axes = st.sampled_from(["1", "2"])
volts = st.one_of(st.floats(-20.0, 130.0), st.sampled_from([*RANGE, 0.0]))
metres = st.one_of(st.floats(-5e-6, 5e-5), st.sampled_from([4e-7, 41e-6, 1e-5]))
tables = st.integers(1, 3)


@st.composite
def samples(draw: st.DrawFn) -> list[float]:
    """A table that is often one that may run."""
    first = draw(st.floats(0.0, 110.0))
    steps = draw(st.lists(st.floats(-3.0, 3.0), max_size=12))
    scale = draw(st.sampled_from([1.0, 1.0, 3.5e-7]))
    return [float(v) for v in scale * np.cumsum([first, *steps])]


commands = st.one_of(
    st.tuples(st.just("set_servo"), st.tuples(axes, st.booleans())),
    st.tuples(st.just("set_commands"), st.tuples(st.dictionaries(axes, volts, min_size=1))),
    st.tuples(st.just("set_targets"), st.tuples(st.dictionaries(axes, metres, min_size=1))),
    st.tuples(st.just("set_speed"), st.tuples(axes, st.floats(1e-5, 2e-2))),
    st.tuples(st.just("stop"), st.tuples()),
    st.tuples(st.just("stop"), st.tuples(axes.map(lambda a: [a]))),
    st.tuples(st.sampled_from(["set_wave", "append_wave"]), st.tuples(tables, samples())),
    st.tuples(st.just("choose_wave"), st.tuples(axes, tables, st.sampled_from([0, 0, 3]))),
    st.tuples(st.just("set_wave_cycles"), st.tuples(axes, st.integers(0, 3))),
    st.tuples(st.just("set_wave_rate_divider"), st.tuples(st.integers(1, 5))),
    st.tuples(st.just("follow"), st.tuples(axes, samples())),
    st.tuples(st.just("stop_waves"), st.tuples(axes.map(lambda a: [a]))),
    st.tuples(st.just("recorder.set_divider"), st.tuples(st.integers(1, 9))),
    st.tuples(st.just("arm_recorder"), st.tuples(st.sampled_from(["wave", "move", "now"]))),
    st.tuples(
        st.just("set_servo_settings"),
        st.tuples(axes, st.floats(1e7, 9e8).map(lambda k: ServoSettings(integral=k))),
    ),
)
conversations = st.lists(
    st.tuples(st.lists(commands, max_size=4), st.integers(0, 260)), min_size=1, max_size=8
)


def follow(device: VirtualController, axis: str, table: list[float]) -> None:
    """Run a table from where the axis stands, as a client would."""
    piezo = device.axes[axis].kind == "piezo"
    closed = device.servo_on(axis)
    here = device.target(axis) if closed else device.command(axis)
    scale = (4e-7 if piezo else 1e-8) if closed else 1.0
    device.set_wave(2, here + scale * 0.3 * (np.array(table) - table[0]))
    device.choose_wave(axis, 2, 0)
    device.start_waves([axis])


def say(device: VirtualController, command: Command) -> str:
    """Carry out a command; return what came of it."""
    name, args = command
    call: Callable[..., None] = (
        (lambda *a: follow(device, *a)) if name == "follow" else attrgetter(name)(device)
    )
    try:
        call(*args)
    except RefusedError as error:
        return error.reason.name
    return "done"


def state(device: VirtualController) -> list[Any]:
    """Everything that can be asked."""
    per_axis = ["servo_on", "target", "position", "on_target", "moving", "speed", "wave_choice",
                "wave_running"]  # fmt: skip
    if device.axes["1"].kind == "piezo":
        per_axis += ["command", "voltage", "servo"]
    answers: list[Any] = [[getattr(device, ask)(a) for a in device.axes] for ask in per_axis]
    answers += [[device.channel(c.number) for c in device.channels], device.now]
    answers += [device.recorder.recorded, device.recorder.recording, device.recorder.divider]
    return [*answers, device.wave_divider, *(list(device.tables.samples(t)) for t in (1, 2, 3))]


def new_device(kind: Any) -> tuple[SimpleStage, VirtualController]:
    stage = SimpleStage(kind)
    device = VirtualController(stage, zero_at_start=False)
    for table, what, source in ((1, "position", "1"), (2, "target", "2"), (5, "channel", "3")):
        device.set_record_signal(table, Signal(kind=what, source=source, name=what))
    return stage, device


def portions(total: int, draw: st.DataObject) -> list[float]:
    """Cut a number of samples into times that are no whole samples."""
    cuts = draw.draw(st.lists(st.floats(0.0, total), max_size=6).map(sorted))
    return [1e-4 * float(v) for v in np.diff([0.0, *cuts, total])]


@pytest.mark.parametrize("kind", ["piezo", "screw"])
@given(conversation=conversations, data=st.data())
def test_time_in_portions_makes_no_difference(
    kind: str, conversation: list[tuple[list[Command], int]], data: st.DataObject
) -> None:
    one_stage, one = new_device(kind)
    two_stage, two = new_device(kind)
    for said, count in conversation:
        assert [say(one, c) for c in said] == [say(two, c) for c in said]
        one.advance(count * 1e-4)
        for seconds in portions(count, data):
            two.advance(seconds)
        # the rest of a sample that rounding has left
        assert state(one) == state(two)
    assert_array_equal(one_stage.commands, two_stage.commands)
    assert_array_equal(one_stage.beside, two_stage.beside)
    for table in (1, 2, 5):
        if one.recorder.recorded:
            n = one.recorder.recorded
            assert_array_equal(one.recorder.read(table, 0, n), two.recorder.read(table, 0, n))


@pytest.mark.parametrize("kind", ["piezo", "screw"])
@given(conversation=conversations)
def test_nothing_that_is_said_leads_outside_the_limits(
    kind: str, conversation: list[tuple[list[Command], int]]
) -> None:
    stage, device = new_device(kind)
    closed: list[np.ndarray] = []
    for said, count in conversation:
        for command in said:
            before = state(device)
            # `follow` is several commands, of which the first may have been carried out
            if say(device, command) != "done" and command[0] != "follow":
                assert state(device) == before, command  # a refusal changes nothing
        on = [device.servo_on(a) for a in device.axes]
        device.advance(count * 1e-4)
        closed.append(np.repeat(np.array(on)[:, None], count, axis=1))
    under = np.hstack([np.zeros((2, 1), dtype=bool) | (kind == "screw"), *closed])
    sent = stage.commands
    assert sent.shape == under.shape
    assert np.isfinite(sent).all()
    positions, voltages = sent[under], sent[~under]
    if kind == "screw":
        low, high = SCREW.position or (0.0, 0.0)
        assert np.all((positions >= low) & (positions <= high))
        # a thousandth of slack for texts, and rounding
        assert np.all(np.abs(np.diff(sent)) <= 1.1e-3 * 1e-4 * 1.0011 + 1e-15)
        return
    # Where control is switched on, or motion is stopped, the target is what is read: anything that
    # the range of the voltage reaches.
    assert np.all((positions >= -7.0 * 4.8e-7) & (positions <= 113.0 * 4.8e-7))
    assert np.all((voltages >= RANGE[0]) & (voltages <= RANGE[1]))
    assert PIEZO.slew is not None
    steps = np.abs(np.diff(sent))[~under[:, 1:] & ~under[:, :-1]]
    assert np.all(steps <= PIEZO.slew * 1e-4 * 1.0011 + 1e-12)
