"""The smallest driver: what it does not write is refused in a sentence; waiting ends in a stop."""

import math
from collections.abc import Mapping

import pytest

from flexstage.base.errors import ControllerError, LimitError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_voltage
from flexstage.instruments.protocol import Capability, Identity, Instrument, MotionAxis
from flexstage.instruments.ramp import lead_to, to_safe, wait_for_rest
from flexstage.stage.limits import AxisLimits
from flexstage.system.servo import ServoSettings


class Axis(MotionAxis):
    limits = AxisLimits(voltage=(-20.0, 120.0), slew=1e4)  # type: ignore[assignment]
    name = "x"
    capabilities = frozenset({Capability.OPEN_LOOP})

    def __init__(self, owner: "Minimal") -> None:
        self.owner, self.volts, self.busy = owner, 7.0, 0

    def position(self) -> float:
        return 0.4e-6 * self.volts

    def voltage(self) -> float:
        return self.volts

    def set_voltage(self, voltage: float) -> None:
        check_voltage(self.limits, voltage, self.name)
        self.volts = voltage

    def moving(self) -> bool:
        self.busy -= 1
        if self.owner.gone:
            raise NotConnectedError("the link is gone")
        return self.busy >= 0

    def wait(self, timeout: float = 30.0) -> None:
        wait_for_rest(self.owner, self.moving, timeout, f"axis '{self.name}' still moved")


class Minimal(Instrument):
    identity = Identity(vendor="v", model="m", simulated=True)

    def __init__(self) -> None:
        self.x, self.stops, self.gone, self.paused = Axis(self), 0, False, 0.0

    @property
    def axes(self) -> Mapping[str, Axis]:
        return {"x": self.x}

    def pause(self, seconds: float) -> None:
        self.paused += seconds

    def stop(self) -> None:
        self.stops += 1
        if self.gone:
            raise NotConnectedError("nothing was sent")

    def close(self) -> None:
        pass


def test_what_every_instrument_can_be_told_works_on_it() -> None:
    made = Minimal()
    assert made.capabilities == {Capability.OPEN_LOOP}
    assert not made.x.closed_loop
    made.x.set_closed_loop(False)  # which it is
    lead_to(made, {"x": 55.0}, "voltage")
    assert made.x.volts == 55.0
    with pytest.raises(LimitError, match="cannot be sent to 121 V"):
        lead_to(made, {"x": 121.0}, "voltage")
    to_safe(made)
    assert (made.x.volts, made.settings()) == (0.0, {})


def test_an_instrument_and_its_axes_say_what_they_are_without_being_asked() -> None:
    made = Minimal()
    made.gone = True
    assert repr(made) == "<simulated v m, axes x>"
    assert repr(made.x) == "<axis 'x': open loop>"
    made.identity = Identity(vendor="v", model="m", serial_number="17")  # type: ignore[misc]
    assert str(made) == "<v m no. 17, axes x>"


def test_what_it_cannot_do_is_refused_with_a_sentence() -> None:
    made = Minimal()
    calls = {
        "it has no position control by a sensor": lambda: made.x.move_to(1e-6),
        "axis 'x' of this controller does not support this": lambda: made.x.set_closed_loop(True),
        "setting of the position control": made.x.servo,
        "does not support this: it has no": lambda: made.x.set_servo(ServoSettings(integral=1.0)),
        "has no data recorder": lambda: made.recorder,
        "has no wave generator": lambda: made.waves,
        "no sensor 3: this instrument has no sensors": lambda: made.channel(3),
        "excite the stage by hand": lambda: made.strike("x"),
    }
    for said, call in calls.items():
        with pytest.raises(ModelError, match=said):
            call()
    assert (made.stops, made.x.volts) == (0, 7.0)


def test_an_axis_with_position_control_alone_is_always_under_it() -> None:
    class Screw(Axis):
        capabilities = frozenset({Capability.CLOSED_LOOP})  # type: ignore[assignment]
        voltage, set_voltage = MotionAxis.voltage, MotionAxis.set_voltage

    screw = Screw(Minimal())
    assert screw.closed_loop
    assert math.isnan(screw.voltage())
    for call in (lambda: screw.set_voltage(1.0), lambda: screw.set_closed_loop(False)):
        with pytest.raises(ModelError, match="it has no command of the voltage"):
            call()


def test_waiting_ends_with_rest_or_with_a_stop() -> None:
    made = Minimal()
    made.x.busy = 7
    made.x.wait()
    assert (made.stops, round(made.paused, 9)) == (0, 0.07)
    made.x.busy = 10**9
    with pytest.raises(
        ControllerError, match=r"axis .x. still moved after 0\.5 s: the stage was stopped"
    ):
        made.x.wait(0.5)
    assert made.stops == 1
    made.gone = True
    # what was first is said, and not that the stop did not arrive either
    with pytest.raises(NotConnectedError, match="the link is gone"):
        made.x.wait()
    assert made.stops == 2


def test_an_interruption_stays_one_where_the_stop_does_not_arrive() -> None:
    class Interrupted(Minimal):
        def pause(self, seconds: float) -> None:
            self.gone = True
            raise KeyboardInterrupt

    made = Interrupted()
    made.x.busy = 7
    with pytest.raises(KeyboardInterrupt):
        made.x.wait()
    assert made.stops == 1
