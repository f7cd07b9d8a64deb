"""Axes and waveforms as scans of laboratory frameworks drive them; none of these is needed."""

import threading
import time

import numpy as np
import pytest

from flexstage.base.errors import ControllerError, LimitError
from flexstage.instruments import FlyScan, MotionStatus, ScanAxis, Signal, Waveform
from flexstage.instruments.pi.connection import TransferLimits
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.pi.simulated.address import Loopback
from flexstage.instruments.transport import InProcess
from flexstage.stage.designs import design
from tests.gcs_device import controller


@pytest.fixture
def stage():
    link = InProcess(Loopback(controller()))
    made = PiController.open(link, design("vgtu-piezo"), transfer=TransferLimits(line_limit=9999))
    yield made
    made.close()


def test_a_status_tells_of_the_end_to_whoever_asks():
    go, told = threading.Event(), []
    status = MotionStatus(lambda: go.wait(10.0))
    status.add_callback(told.append)
    assert (status.done, status.success, told) == (False, False, [])
    assert repr(status) == "<motion in progress>"
    with pytest.raises(TimeoutError, match=r"within 0.01 s"):
        status.wait(timeout=0.01)
    go.set()
    status.wait(timeout=300.0)
    assert (status.done, status.success, status.exception()) == (True, True, None)
    status.add_callback(told.append)  # of one that has ended it is told at once
    for _ in range(1000):
        if len(told) == 2:
            break
        time.sleep(0.01)
    assert told == [status, status]
    assert repr(status) == "<motion complete>"


def test_a_status_of_a_motion_that_failed_has_its_error():
    def failing():
        raise ControllerError("stuck", 7)

    status = MotionStatus(failing)
    with pytest.raises(ControllerError, match="stuck"):
        status.wait(timeout=300.0)
    assert (status.done, status.success) == (True, False)
    assert str(status.exception()) == "stuck"
    assert repr(status) == "<motion failed: stuck>"


def test_an_axis_is_moved_and_read(stage):
    x = ScanAxis(stage, "x", name="stage_x")
    status = x.set(12.5e-6)
    status.wait(timeout=300.0)
    assert status.success
    assert stage.axes["x"].closed_loop
    read = x.read()
    assert {field: entry["value"] for field, entry in read.items()} == {
        "stage_x": pytest.approx(12.5e-6),
        "stage_x_setpoint": 12.5e-6,
    }
    assert abs(read["stage_x"]["timestamp"] - time.time()) < 60.0
    assert x.locate() == {"setpoint": 12.5e-6, "readback": x.position}
    described = x.describe()
    assert described.keys() == read.keys()
    assert (described["stage_x"]["units"], described["stage_x"]["lower_ctrl_limit"]) == ("m", -2e-6)
    assert x.hints == {"fields": ["stage_x"]}
    # a target outside is refused by the call itself, and nothing has moved
    for outside in (61e-6, -2.1e-6):
        with pytest.raises(LimitError, match="its limits are -2 to 60 um"):
            x.set(outside)
    assert x.locate()["setpoint"] == 12.5e-6


def test_a_motion_that_is_stopped_fails(stage):
    x = ScanAxis(stage, "x")
    stage.axes["x"].set_closed_loop(True)
    stage.client.tell("VEL 1 0.5")
    status = x.set(50e-6)
    x.stop()
    assert "stopped" in str(status.exception(timeout=300.0))
    assert x.position < 49e-6


def test_a_waveform_is_flown_and_collected(stage):
    t = np.arange(100) / 1000.0
    wave = Waveform(
        values={"x": 20e-6 - 5e-6 * np.cos(2.0 * np.pi * 10.0 * t)},
        sample_rate_hz=1000.0,
        quantity="position",
    )
    signals = [Signal(kind=kind, source="x", name=kind) for kind in ("position", "target")]
    flight = FlyScan(stage, wave, signals, rate_hz=1000.0, name="sine")
    with pytest.raises(ControllerError, match="was not started"):
        flight.complete()
    with pytest.raises(ControllerError, match="has no record"):
        list(flight.collect())
    flight.kickoff().wait(timeout=300.0)
    flight.complete().wait(timeout=300.0)
    events = list(flight.collect())
    described = flight.describe_collect()
    assert described.keys() == {"sine"}
    assert all(event["data"].keys() == described["sine"].keys() for event in events)
    assert all(event["timestamps"].keys() == event["data"].keys() for event in events)
    assert flight.record is not None
    values = np.array([event["data"]["position"] for event in events])
    np.testing.assert_array_equal(values, flight.record.channel("position").values)
    np.testing.assert_allclose(values, wave.values["x"], atol=1e-11)
    steps = np.diff([event["time"] for event in events])
    np.testing.assert_allclose(steps, 1e-3, atol=1e-6)
    # one that leaves the limits fails, and says so
    high = Waveform(values={"x": wave.values["x"] + 40e-6}, sample_rate_hz=1e3, quantity="position")
    flight = FlyScan(stage, high, signals, rate_hz=1000.0)
    flight.kickoff()
    with pytest.raises(LimitError):
        flight.complete().wait(timeout=300.0)
    with pytest.raises(ControllerError, match="has no record"):
        list(flight.collect())
