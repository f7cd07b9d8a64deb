"""How simulated time passes beside a conversation: with injected clocks, and once with the real."""

import threading
import time
from collections.abc import Callable

import pytest
from numpy.testing import assert_allclose

from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.pi.simulated.clock import Clock, FastTime, Pace, Pacemaker
from flexstage.instruments.pi.simulated.controller import VirtualController
from flexstage.instruments.pi.simulated.controller_core import duration
from flexstage.instruments.pi.simulated.device import Refusal, RefusedError
from flexstage.instruments.protocol import Signal
from tests.simple_stage import SimpleStage


@pytest.fixture
def device() -> VirtualController:
    return VirtualController(SimpleStage(), zero_at_start=False)


class StepClock(Clock):
    """A clock that stands until it is told to go on; it tells of each wait before."""

    def __init__(self, on_wait: Callable[[float], None] | None = None) -> None:
        self._now = 0.0
        self._on_wait = on_wait

    def now(self) -> float:
        return self._now

    def advance(self, seconds: float) -> None:
        """Go on."""
        self._now += duration(seconds)

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        """Go on at once by the time that is waited for."""
        if self._on_wait is not None:
            self._on_wait(seconds)
        self.advance(seconds)
        return ended.is_set()


class Told(StepClock):
    """A clock that goes on by what it is told at each wait, and then ends the pacemaker."""

    def __init__(self, *waits: float) -> None:
        super().__init__()
        self._waits = list(waits)

    def wait(self, seconds: float, ended: threading.Event) -> bool:
        if self._waits:
            self.advance(self._waits.pop(0))
            return ended.is_set()
        return ended.wait(10.0)


def until(condition: object, seconds: float = 10.0) -> None:
    """Wait for another thread, with an end."""
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "it never came"
        time.sleep(1e-3)


# in step with real time -------------------------------------------------------------------------


def test_the_device_follows_the_clock(device: VirtualController) -> None:
    pace: Pace = Pacemaker(device, clock=Told(0.0051, 0.0048, 0.0072))
    pace.start()
    pace.start()
    until(lambda: device.now > 0.01705)
    pace.close()
    pace.close()
    assert_allclose(device.now, 0.0171, rtol=1e-12)
    assert not pace.fast


def test_late_ticks_are_counted_and_made_up_for(device: VirtualController) -> None:
    pace = Pacemaker(device, clock=Told(0.005, 0.3, 0.005))
    pace.start()
    until(lambda: device.now > 0.3095)
    pace.close()
    assert_allclose(device.now, 0.31, rtol=1e-12)
    # 0.3 s in pieces of 20 ms: late as long as more than 10 ms are due
    assert pace.late == 15
    assert pace.lost == 0.0


def test_no_more_than_a_second_is_made_up_for(device: VirtualController) -> None:
    pace = Pacemaker(device, clock=Told(3.7))
    pace.start()
    until(lambda: device.now > 0.9995)
    pace.close()
    assert_allclose(device.now, 1.0, rtol=1e-12)
    assert_allclose(pace.lost, 2.7, rtol=1e-12)


def test_a_command_acts_at_its_own_moment(device: VirtualController) -> None:
    clock = Told()  # no tick comes
    pace = Pacemaker(device, clock=clock)
    pace.start()
    clock.advance(0.0033)
    with pace.lock:
        pace.before_command(poll=False)
    pace.close()
    assert_allclose(device.now, 0.0033)


def test_a_stop_does_not_wait_until_all_is_made_up_for(device: VirtualController) -> None:
    clock = Told()
    pace = Pacemaker(device, clock=clock)
    pace.start()
    clock.advance(0.9)
    pace.before_command(poll=True)
    pace.close()
    assert_allclose(device.now, 0.02)


def test_nothing_passes_before_the_start_or_after_the_end(device: VirtualController) -> None:
    clock = StepClock()
    pace = Pacemaker(device, clock=clock)
    clock.advance(1.0)
    pace.before_command()
    assert device.now == 0.0
    pace.close()
    with pytest.raises(ModelError, match="closed"):
        pace.start()


def test_real_time_cannot_be_led_on(device: VirtualController) -> None:
    pace = Pacemaker(device)
    with pytest.raises(RefusedError) as caught:
        pace.pass_time(1.0)
    assert caught.value.reason is Refusal.NOT_ABLE


@pytest.mark.parametrize(("tick", "catch_up"), [(0.0, 1.0), (5e-3, 1e-3), (float("nan"), 1.0)])
def test_a_pacemaker_needs_a_tick(device: VirtualController, tick: float, catch_up: float) -> None:
    with pytest.raises(ModelError, match="positive tick"):
        Pacemaker(device, tick=tick, catch_up=catch_up)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_simulation_that_broke_down_is_told_to_the_next_command() -> None:
    class Broken(SimpleStage):
        def run(self, *args: object, **kwargs: object) -> object:  # type: ignore[override]
            if self.samples > 100:
                raise FloatingPointError("a mode overflowed")
            return super().run(*args, **kwargs)  # type: ignore[arg-type]

    pace = Pacemaker(
        VirtualController(Broken(), zero_at_start=False), clock=Told(0.011, 0.011, 0.011)
    )
    pace.start()
    thread = pace._thread
    assert thread is not None
    thread.join(10.0)
    with pytest.raises(ControllerError, match="a mode overflowed"):
        pace.before_command()
    pace.close()


def test_the_real_clock_drives_it_too(device: VirtualController) -> None:
    pace = Pacemaker(device)
    began = Clock().now()
    pace.start()
    until(lambda: device.now > 0.03)
    pace.close()
    # never ahead of real time
    assert device.now <= Clock().now() - began + 1e-3


@pytest.mark.slow
@pytest.mark.alone
def test_the_lock_comes_to_others_while_it_is_behind() -> None:
    """A computer that is far too slow still answers at once."""

    class Slow(SimpleStage):
        def run(self, *args: object, **kwargs: object) -> object:  # type: ignore[override]
            time.sleep(0.025)
            return super().run(*args, **kwargs)  # type: ignore[arg-type]

    pace = Pacemaker(
        VirtualController(Slow(sample_rate_hz=1e3), zero_at_start=False), tick=1e-4, catch_up=1.0
    )
    pace.start()
    worst = 0.0
    for _ in range(10):
        began = time.monotonic()
        with pace.lock:
            worst = max(worst, time.monotonic() - began)
        time.sleep(2e-3)
    pace.close()
    # one piece of 20 ms takes 25 ms here, so that it is behind all the time; a machine that does
    # other things may add a good deal
    assert worst < 2.0


# as fast as it can ------------------------------------------------------------------------------


def test_each_command_takes_a_millisecond(device: VirtualController) -> None:
    pace: Pace = FastTime(device)
    pace.start()
    for _ in range(7):
        with pace.lock:
            pace.before_command(poll=False)
    assert_allclose(device.now, 0.007)
    pace.pass_time(0.25)
    assert_allclose(device.now, 0.257)
    assert pace.fast
    pace.close()


def test_a_question_while_nothing_goes_on_takes_no_longer(device: VirtualController) -> None:
    pace = FastTime(device)
    for _ in range(5):
        pace.before_command(poll=True)
    assert_allclose(device.now, 0.005)


def test_a_question_leads_on_to_the_next_change(device: VirtualController) -> None:
    pace = FastTime(device)
    device.set_servo("1", True)
    device.set_speed("1", 1e-3)
    device.set_targets({"1": 10e-6})  # the ramp takes 10 ms
    pace.before_command(poll=True)
    assert not device.moving("1")
    assert not device.on_target("1")
    assert 0.01 <= device.now <= 0.016 + 1e-12
    pace.before_command(poll=True)
    assert device.on_target("1")
    assert device.now < 0.1


def test_a_question_gives_up_after_a_quarter_of_a_second(device: VirtualController) -> None:
    pace = FastTime(device)
    device.set_servo("1", True)
    device.set_speed("1", 40e-6)
    device.set_targets({"1": 30e-6})  # 0.75 s
    asked = 0
    while device.moving("1"):
        pace.before_command(poll=True)
        asked += 1
    assert asked == 3  # of 0.251 s each
    assert_allclose(device.now, 0.75, atol=0.02)


def test_a_question_about_a_recording_leads_on_to_its_end(device: VirtualController) -> None:
    pace = FastTime(device)
    device.set_record_signal(1, Signal(kind="position", source="1", name="x"))
    device.arm_recorder("now")
    device.recorder._length = 777
    pace.before_command(poll=True)
    assert not device.recorder.recording
    assert device.now < 0.085


def test_time_passes_by_a_finite_amount(device: VirtualController) -> None:
    pace = FastTime(device)
    with pytest.raises(ModelError):
        pace.pass_time(float("inf"))
    with pytest.raises(ModelError):
        StepClock().advance(-1.0)


def test_a_step_clock_tells_of_its_waits() -> None:
    waits: list[float] = []
    clock = StepClock(waits.append)
    event = threading.Event()
    assert not clock.wait(0.3, event)
    event.set()
    assert clock.wait(0.2, event)
    assert waits == [0.3, 0.2]
    assert_allclose(clock.now(), 0.5)
