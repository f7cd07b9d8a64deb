"""An instrument as the bench has it: read axis by axis, with pauses that a stop ends."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

from flexstage.instruments.protocol import Capability, Instrument, MotionAxis
from flexstage.web.jobs import Cancelled
from flexstage.web.live_history import POSITION, VOLTAGE, LiveChannel

_PIECE = 0.1  # longest pause in which a stop is not seen [s]


@dataclass(frozen=True, slots=True)
class AxisReading:
    """What an axis was last read as."""

    position: float = math.nan
    """Position [m]."""
    voltage: float = math.nan
    """Voltage [V]; not a number where there is none."""
    moving: bool = False
    """Whether it moves."""
    closed_loop: bool = False
    """Whether its position control is on."""


class WatchedInstrument:
    """An instrument whose pauses a stop ends: whatever waits for it goes no further."""

    def __init__(self, device: Instrument, stopped: threading.Event) -> None:
        self._device, self._stopped = device, stopped

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        while True:
            if self._stopped.is_set():
                # once: what cleans up after it waits too
                self._stopped.clear()
                raise Cancelled
            if seconds <= 0.0:
                return
            self._device.pause(min(seconds, _PIECE))
            seconds -= _PIECE


def real_time_address(address: str) -> str:
    """Return an address at which a simulated clock is in step with that of the room.

    Examples
    --------
    >>> real_time_address("twin://?seed=3"), real_time_address("gcs://127.0.0.1:50000")
    ('twin://?seed=3&fast=0', 'gcs://127.0.0.1:50000')
    """
    address = address.strip()
    if not address.startswith("twin:") or "fast" in parse_qs(urlsplit(address).query):
        return address
    return f"{address}{'&' if '?' in address else '?'}fast=0"


def has_voltage(device: Instrument, axis: str) -> bool:
    """Say whether an axis of an instrument has a voltage."""
    return Capability.OPEN_LOOP in device.axes[axis].capabilities


def live_channels(device: Instrument) -> list[LiveChannel]:
    """Return what the history of an instrument holds."""
    return [
        LiveChannel(f"{axis} {quantity.label.lower()}", quantity)
        for axis in device.axes
        for quantity in (POSITION, VOLTAGE)
        if quantity is POSITION or has_voltage(device, axis)
    ]


def live_values(device: Instrument, readings: Mapping[str, AxisReading]) -> list[float]:
    """Return what the channels of `live_channels` are read as."""
    found: list[float] = []
    for axis, reading in readings.items():
        found.append(reading.position)
        if has_voltage(device, axis):
            found.append(reading.voltage)
    return found


def read_axis(axis: MotionAxis, before: AxisReading | None, *, slow: bool) -> AxisReading:
    """Read an axis; what changes seldom only where it is `slow`, else it is as it was before."""
    with_voltage = Capability.OPEN_LOOP in axis.capabilities
    if slow or before is None:
        moving, closed_loop = axis.moving(), axis.closed_loop
    else:
        moving, closed_loop = before.moving, before.closed_loop
    voltage = axis.voltage() if with_voltage else math.nan
    return AxisReading(axis.position(), voltage, moving, closed_loop)
