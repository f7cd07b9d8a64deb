"""Addresses of instruments: what they lead to, and the sentence where they lead nowhere."""

import time
from contextlib import closing

import pytest

from flexstage.base.errors import ModelError, NotConnectedError, StageError
from flexstage.instruments.connect import connect, whole_number
from flexstage.instruments.pi.controller import PiController
from flexstage.stage.designs import design
from tests.gcs_script import ScriptedController, served

STAGE = design("vgtu-piezo")


class Gateway:
    def __init__(self, script: ScriptedController):
        self.script, self.text = script, ""

    def send(self, msg: str) -> None:
        self.text += self.script.take(msg.encode("latin-1")).decode("latin-1")

    def read(self) -> str:
        text, self.text = self.text, ""
        return text


def test_a_controller_in_the_network():
    script = ScriptedController()
    with (
        served(script) as port,
        closing(connect(f"gcs://127.0.0.1:{port}", STAGE, axes={"x": "2"})) as controller,
    ):
        assert isinstance(controller, PiController)
        assert controller.axes["x"].limits.position == pytest.approx((2.5e-6, 88.25e-6))
        assert controller.settings()["link"] == f"127.0.0.1:{port}"


def test_a_seed_keeps_all_its_digits():
    seed = 2**53 + 1  # the least that no float holds
    assert whole_number({"seed": str(seed)}, "seed", 0, f"twin://?seed={seed}") == seed


def test_an_object_of_the_users_own():
    with closing(connect(Gateway(ScriptedController()), STAGE)) as controller:
        assert sorted(controller.axes) == ["x", "y"]


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("", "is not an address of an instrument: write gcs://HOST:PORT"),
        ("192.168.0.3:50000", "is not an address of an instrument"),
        ("http://host", "is not an address of an instrument"),
        ("gcs://[::1", "is not an address of an instrument"),
        ("gcs://", "names no host"),
        ("gcs:///dev/ttyUSB0", "names no host"),
        ("gcs://host:99999999", "port of .* must be a number from 1 to 65535"),
        ("gcs://host:ten", "port of .* must be a number from 1 to 65535"),
        ("gcs://host?speed=3", "has the unknown option 'speed' .this address has no options"),
        ("serial://", "names no port"),
        ("serial:///dev/ttyUSB0?baud=fast", "baud rate of .* must be 300 to 12000000, got 'fast'"),
        ("serial:///dev/ttyUSB0?baud=5", "baud rate of .* must be 300 to 12000000, got '5'"),
        ("serial:///dev/ttyUSB0?rate=5", "has the unknown option 'rate' .options: baud"),
        ("twin://vgtu-mechanical", "is a twin of 'vgtu-mechanical', and the stage is 'vgtu-piezo'"),
        ("twin://?seed=-1", "'seed' of .* must be a whole number from 0, got '-1'"),
        ("twin://?seed=" + "9" * 400, "'seed' of .* must be a whole number from 0"),
        ("twin://?seed=1.5", "'seed' of .* must be a whole number from 0, got '1.5'"),
        ("twin://?servo_rate=nan", "'servo_rate' of .*: expected a frequency .*, got 'nan'"),
        ("twin://?model=solid", "must be lumped or superelement, got 'solid'"),
        ("twin://?amplifier=tube", "must be voltage or charge, got 'tube'"),
        ("twin://?fast=maybe", "'fast' of .* must be 1 or 0, got 'maybe'"),
        ("twin://?speed=3", "has the unknown option 'speed' .options: seed, model"),
        ("twin://?seed=1&seed=2", "has an option twice"),
    ],
)
def test_an_address_that_leads_nowhere_is_one_sentence(address, sentence):
    with pytest.raises(ModelError, match=sentence) as info:
        connect(address, STAGE)
    assert "\n" not in str(info.value)


@pytest.mark.parametrize("thing", [None, 3, b"gcs://host", object()])
def test_what_is_neither_an_address_nor_a_gateway_is_refused(thing):
    with pytest.raises(ModelError, match=r"is an address .* or an object with the methods"):
        connect(thing, STAGE)


def test_a_stage_must_be_known_to_connect_to_hardware():
    for address in ("gcs://127.0.0.1:1", "serial:///dev/ttyUSB0"):
        with pytest.raises(ModelError, match="needs the stage that is mounted there"):
            connect(address)
    with pytest.raises(ModelError, match="has no name of a stage"):
        connect("twin://")
    with pytest.raises(StageError, match="no built-in design 'nonsense'"):
        connect("twin://nonsense")


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan"), float("inf")])
def test_a_time_out_is_positive(timeout):
    with pytest.raises(ModelError, match="timeout must be positive"):
        connect(Gateway(ScriptedController()), STAGE, timeout=timeout)


def test_where_nothing_is_nobody_connects():
    with served(ScriptedController()) as port:
        pass
    with pytest.raises(NotConnectedError, match="cannot connect"):
        connect(f"gcs://127.0.0.1:{port}", STAGE)
    with pytest.raises(NotConnectedError, match="cannot open the serial port"):
        connect("serial:///dev/no-such-port", STAGE)


def test_a_simulated_controller_in_step_with_real_time_ends_its_clock_when_it_is_closed():
    with closing(connect("twin://?model=lumped&fast=0&quiet=1", STAGE)) as twin:
        assert twin.identity.simulated
        began = time.monotonic()
        twin.pause(0.05)
        assert time.monotonic() - began >= 0.05
        twin.axes["x"].set_voltage(3.0)
        twin.axes["x"].wait()
        # its amplifier settles in its own time, of which a busy machine may give it little
        end = time.monotonic() + 300.0
        while abs(twin.axes["x"].voltage() - 3.0) > 1e-3 and time.monotonic() < end:
            twin.pause(0.01)
        assert twin.axes["x"].voltage() == pytest.approx(3.0, abs=1e-3)
