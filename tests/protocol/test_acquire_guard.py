"""Whatever ends a block: the stage is stopped, led to its safe voltage, and the error told."""

import gc
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, NotConnectedError
from flexstage.instruments.guard import Guard, guarded
from tests.simple_instrument import SimpleInstrument

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX are sent")

#: Real time within which a block that waits has been ended [s]: it takes milliseconds.
SOON = 60.0


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    """Every test leaves the handlers of signals as it found them."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(n) for n in numbers]
    yield
    assert [signal.getsignal(n) for n in numbers] == before


def raised() -> SimpleInstrument:
    """An instrument whose stage is under 70 V."""
    instrument = SimpleInstrument()
    instrument.axes["x"].set_voltage(70.0)
    instrument.pause(1.0)
    return instrument


def is_safe(instrument: SimpleInstrument) -> bool:
    instrument.pause(0.1)
    return bool(instrument.axes["x"].voltages_at(np.array([instrument.now]))[0] == 0.0)


def test_an_error_stops_first_and_then_leads_to_safety() -> None:
    instrument = raised()
    error = ValueError("something else")
    with pytest.raises(ValueError, match="something else") as caught, guarded(instrument):
        raise error
    assert caught.value is error
    assert not hasattr(error, "__notes__")
    assert instrument.log[1] == "stop"
    assert instrument.log[2].startswith("voltage x 69.9")
    assert is_safe(instrument)


def test_a_block_that_ends_well_moves_nothing() -> None:
    instrument = raised()
    with guarded(instrument, timeout=60.0) as guard:
        guard.check()
    assert instrument.log == ["voltage x 70"]


def test_without_a_ramp_it_only_stops() -> None:
    instrument = raised()
    with pytest.raises(KeyError), guarded(instrument, lead_to_safe=False):
        raise KeyError
    assert instrument.log[1:] == ["stop"]


def test_trouble_of_the_ramp_does_not_hide_the_error() -> None:
    instrument = raised()
    instrument.cut_link_at = 0.0
    with pytest.raises(NotConnectedError, match="cable") as caught, guarded(instrument):
        raise NotConnectedError("the cable is out")
    assert any("could not be ramped to their safe voltages" in n for n in caught.value.__notes__)
    assert instrument.log[-1] == "stop that nobody heard"

    class Wrong(SimpleInstrument):
        def stop(self) -> None:
            raise RuntimeError("a driver that breaks its word")

    broken = Wrong()
    broken.axes["x"].set_voltage(5.0)
    with pytest.raises(ValueError, match="first") as second, guarded(broken):
        raise ValueError("first")
    assert second.value.__notes__ == [
        "the stage could not be stopped: a driver that breaks its word"
    ]
    assert is_safe(broken)  # the ramp was tried all the same


def test_a_second_and_third_interrupt_do_not_come_between() -> None:
    class Nervous(SimpleInstrument):
        def stop(self) -> None:
            signal.raise_signal(signal.SIGINT)
            super().stop()
            signal.raise_signal(signal.SIGTERM)

        def pause(self, seconds: float) -> None:
            super().pause(seconds)
            if self.stops:
                signal.raise_signal(signal.SIGINT)

    instrument = Nervous()
    instrument.axes["x"].set_voltage(70.0)
    with pytest.raises(KeyError), guarded(instrument):
        raise KeyError
    assert instrument.stops == 1
    assert instrument.axes["x"].voltages_at(np.array([instrument.now]))[0] == 0.0


def test_ctrl_c_stops_and_is_raised() -> None:
    instrument = raised()
    with pytest.raises(KeyboardInterrupt), guarded(instrument):
        signal.raise_signal(signal.SIGINT)
    assert instrument.log[1] == "stop"
    assert is_safe(instrument)


def test_a_stop_that_comes_late_does_not_halt_the_ramp() -> None:
    class Slow(SimpleInstrument):
        def stop(self) -> None:
            if threading.current_thread() is not threading.main_thread():
                time.sleep(0.05)
            super().stop()

    instrument = Slow()
    instrument.axes["x"].set_voltage(70.0)
    instrument.pause(1.0)
    with pytest.raises(KeyboardInterrupt), guarded(instrument):
        signal.raise_signal(signal.SIGINT)
    time.sleep(0.1)
    assert instrument.stops == 2
    assert instrument.log[1:3] == ["stop", "stop"]
    assert is_safe(instrument)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_polite_kill_stops_and_ends_the_program(number: int) -> None:
    instrument = raised()
    # what is started by `nohup` ignores the one of them
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(SystemExit) as caught, guarded(instrument):
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)
    assert caught.value.code == 128 + number
    assert is_safe(instrument)


def test_what_the_surroundings_ignore_is_ignored() -> None:
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGHUP)}
    try:
        for number in before:
            signal.signal(number, signal.SIG_IGN)
        instrument = raised()
        with guarded(instrument):
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGHUP)
        assert instrument.stops == 0
        # A time-out ends the block all the same.
        with pytest.raises(ControllerError, match="time limit"), guarded(instrument, timeout=0.02):
            time.sleep(SOON)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_nested_guards_stop_both() -> None:
    outer, inner = raised(), raised()
    with pytest.raises(KeyboardInterrupt), guarded(outer), guarded(inner):
        signal.raise_signal(signal.SIGINT)
    assert is_safe(outer)
    assert is_safe(inner)


@pytest.mark.parametrize("wait", ["sleep", "socket", "compute"])
def test_a_block_that_takes_too_long_is_ended(wait: str) -> None:
    def compute() -> None:
        end = time.monotonic() + SOON
        while time.monotonic() < end:
            pass

    a, b = socket.socketpair()
    with a, b:
        a.settimeout(SOON)
        how: dict[str, Callable[[], object]] = {
            "sleep": lambda: time.sleep(SOON),
            "socket": lambda: a.recv(1),
            "compute": compute,
        }
        instrument, begin = raised(), time.monotonic()
        with (
            pytest.raises(ControllerError, match=r"time limit of 0\.05 s"),
            guarded(instrument, timeout=0.05),
        ):
            how[wait]()
        assert 0.04 < time.monotonic() - begin < 0.7 * SOON
    assert is_safe(instrument)


def test_more_time_may_be_given() -> None:
    instrument = raised()
    with guarded(instrument, timeout=0.05) as guard:
        guard.allow(60.0)
        time.sleep(0.1)
    assert instrument.stops == 0


def test_another_thread_stops_at_once() -> None:
    instrument = raised()
    begin = time.monotonic()
    guard = guarded(instrument)
    thread = threading.Timer(0.02, guard.stop, ["the red button"])
    thread.start()
    with pytest.raises(ControllerError, match="red button"), guard:
        time.sleep(SOON)
    thread.join(SOON)
    assert time.monotonic() - begin < 0.7 * SOON
    assert is_safe(instrument)


def test_the_block_itself_may_stop() -> None:
    instrument = raised()
    with pytest.raises(ControllerError, match="enough"), guarded(instrument) as guard:
        guard.stop("enough")
    assert instrument.stops >= 2
    assert is_safe(instrument)


def test_a_block_in_another_thread_is_told_when_it_asks_and_at_its_end() -> None:
    told: list[str] = []

    def block(*, ask: bool) -> None:
        instrument = raised()
        try:
            with guarded(instrument, timeout=0.02) as guard:
                end = time.monotonic() + 0.3
                while time.monotonic() < end and not (ask and instrument.stops):
                    time.sleep(0.005)
                if ask:
                    guard.check()
                    raise AssertionError
        except ControllerError as error:
            told.append(f"{error} {is_safe(instrument)}")

    for ask in (True, False):
        thread = threading.Thread(target=block, kwargs={"ask": ask})
        thread.start()
        thread.join(SOON)
    assert told == ["the run exceeded its time limit of 0.02 s True"] * 2


def test_a_stop_after_the_block_only_stops() -> None:
    instrument = raised()
    with guarded(instrument) as guard:
        pass
    guard.stop()
    assert instrument.stops == 1


@pytest.fixture
def uncollected() -> Iterator[None]:
    """Collect no garbage: an interrupt in a callback of the collector is lost, and warned of."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("uncollected")
def test_an_interrupt_at_any_moment_leaves_the_stage_stopped_or_the_block_done() -> None:
    """Interrupts at 150 moments: never a block half done and a stage that moves."""
    rng = np.random.default_rng(8)
    main = threading.get_ident()
    interrupted = 0
    for delay in rng.uniform(0.0, 3e-3, 150):
        instrument, done, reached = raised(), False, threading.Event()

        def fire(after: float = delay, event: threading.Event = reached) -> None:
            event.wait(SOON)
            time.sleep(after)
            signal.pthread_kill(main, signal.SIGINT)

        thread = threading.Thread(target=fire)
        thread.start()
        guard = Guard(instrument)
        try:
            reached.set()
            with guard:
                end = time.perf_counter() + 2e-3
                while time.perf_counter() < end:
                    instrument.pause(1e-4)
                    time.sleep(0.0)  # lets the other thread come
                done = True
            thread.join(SOON)
        except KeyboardInterrupt:
            pass
        while thread.is_alive():
            with suppress(KeyboardInterrupt):
                thread.join(SOON)
        entered = len(instrument.log) > 1 or done
        interrupted += instrument.stops > 0
        if instrument.stops:
            assert is_safe(instrument)
        else:
            assert done or not entered
    assert interrupted > 0


def test_an_interrupt_before_the_block_and_at_its_end_leaves_signals_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    instrument = raised()
    with monkeypatch.context() as patch:
        patch.setattr(Guard, "allow", lambda *_: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt), guarded(instrument, timeout=1.0):
            pytest.fail("the block runs")
    assert is_safe(instrument)

    instrument = raised()
    with pytest.raises(KeyboardInterrupt), guarded(instrument) as guard:
        guard._handle(signal.SIGINT, SimpleNamespace(f_code=Guard.__exit__.__code__))
    assert is_safe(instrument)

    # while the handlers are given back one after the other
    own = signal.signal
    with pytest.raises(KeyboardInterrupt), guarded(raised()):
        monkeypatch.setattr(
            signal, "signal", lambda *a: [own(*a), signal.raise_signal(signal.SIGINT)]
        )
    monkeypatch.undo()


PROGRAM = """
import os, sys, time
sys.path.insert(0, {root!r})
from tests.simple_instrument import SimpleInstrument
from flexstage.instruments.guard import guarded

class Told(SimpleInstrument):
    def stop(self):
        super().stop()
        os.write(1, b"stopped" + bytes([10]))
    def pause(self, seconds):
        super().pause(seconds)
        time.sleep(0.001)

instrument = Told()
instrument.axes["x"].set_voltage(70.0)
instrument.now = 1.0
try:
    with guarded(instrument):
        print("runs", flush=True)
        time.sleep(60.0)
finally:
    print(instrument.axes["x"].voltage(), flush=True)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, -2)])
def test_a_program_that_is_told_to_end_twice_leaves_the_stage_safe(
    number: int, status: int
) -> None:
    root = str(Path(__file__).resolve().parents[2])
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(root=root)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "runs\n"
            process.send_signal(number)
            assert process.stdout.readline() == "stopped\n"
            process.send_signal(number)
            out, _ = process.communicate(timeout=300)
        finally:
            process.kill()
    assert out.splitlines()[-1] == "0.0"
    assert process.returncode == status
