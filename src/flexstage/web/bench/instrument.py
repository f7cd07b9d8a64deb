"""Readings of an instrument at the bench, and pauses that a stop interrupts."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

from flexstage.base.errors import ModelError
from flexstage.instruments.protocol import Capability, Instrument, MotionAxis
from flexstage.web.jobs import Cancelled
from flexstage.web.live_history import POSITION, VOLTAGE, LiveChannel

_MAX_PAUSE = 0.1  # longest pause without a check for a stop [s]


@dataclass(frozen=True, slots=True)
class AxisReading:
    """The last reading of an axis."""

    position: float = math.nan
    """Position [m]."""
    voltage: float = math.nan
    """Voltage [V]; NaN for an axis without voltage."""
    moving: bool = False
    """The axis moves."""
    closed_loop: bool = False
    """Position control is on."""


class InterruptibleInstrument:
    """An instrument whose pauses a stop interrupts, so that the waiting run is cancelled."""

    def __init__(self, device: Instrument, stop_event: threading.Event) -> None:
        self._device, self._stop_event = device, stop_event

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def pause(self, seconds: float) -> None:
        """Wait for a time [s]."""
        while True:
            if self._stop_event.is_set():
                # once, so that the clean-up after it can wait
                self._stop_event.clear()
                raise Cancelled
            if seconds <= 0.0:
                return
            self._device.pause(min(seconds, _MAX_PAUSE))
            seconds -= _MAX_PAUSE


def real_time_address(address: str) -> str:
    """Return an address with which a simulated instrument runs in real time.

    Examples
    --------
    >>> real_time_address("twin://?seed=3"), real_time_address("gcs://127.0.0.1:50000")
    ('twin://?seed=3&fast=0', 'gcs://127.0.0.1:50000')
    """
    address = address.strip()
    parts = urlsplit(address)
    options = parse_qs(parts.query, keep_blank_values=True)
    # the messages of its readers quote a file
    if parts.scheme == "twin" and (named := {"environment", "table"} & options.keys()):
        raise ModelError(
            f"the panel reads no {min(named)} that an address names: run flexstage twin "
            f"--{min(named)}, and give its address"
        )
    if parts.scheme != "twin" or "fast" in options:
        return address
    return f"{address}{'&' if '?' in address else '?'}fast=0"


def has_voltage(device: Instrument, axis: str) -> bool:
    """Return whether an axis of an instrument has a voltage."""
    return Capability.OPEN_LOOP in device.axes[axis].capabilities


def live_channels(device: Instrument) -> list[LiveChannel]:
    """Return the channels of the history of an instrument."""
    return [
        LiveChannel(f"{axis} {quantity.label.lower()}", quantity)
        for axis in device.axes
        for quantity in (POSITION, VOLTAGE)
        if quantity is POSITION or has_voltage(device, axis)
    ]


def live_values(device: Instrument, readings: Mapping[str, AxisReading]) -> list[float]:
    """Return the values of the channels of `live_channels`."""
    values: list[float] = []
    for axis, reading in readings.items():
        values.append(reading.position)
        if has_voltage(device, axis):
            values.append(reading.voltage)
    return values


def read_axis(axis: MotionAxis, previous: AxisReading | None, *, slow: bool) -> AxisReading:
    """Read an axis; read the states that change seldom only with `slow`, else keep the previous."""
    with_voltage = Capability.OPEN_LOOP in axis.capabilities
    if slow or previous is None:
        moving, closed_loop = axis.moving(), axis.closed_loop
    else:
        moving, closed_loop = previous.moving, previous.closed_loop
    voltage = axis.voltage() if with_voltage else math.nan
    return AxisReading(axis.position(), voltage, moving, closed_loop)
