"""Controllers by their addresses: in the network, at a serial port, behind a gateway."""

from collections.abc import Mapping
from urllib.parse import urlsplit

from flexstage.errors import ModelError
from flexstage.instruments.address import longest_silence, options_of
from flexstage.instruments.pi.controller import PiController
from flexstage.instruments.transport import (
    DEFAULT_BAUD,
    DEFAULT_PORT,
    GatewayLink,
    SerialLink,
    TcpLink,
)
from flexstage.stage import Stage


def open_network(
    address: str, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller in the network: ``gcs://HOST:PORT``."""
    parts = urlsplit(address.strip())
    options_of(address, parts, ())
    try:
        port = parts.port
    except ValueError as error:
        raise ModelError(
            f"the port of '{address}' must be a number from 1 to 65535, as in gcs://192.168.0.10:"
            f"{DEFAULT_PORT}"
        ) from error
    if not parts.hostname or parts.path.strip("/"):
        raise ModelError(
            f"'{address}' names no host: write gcs://HOST:PORT, as in gcs://127.0.0.1:50000"
        )
    link = TcpLink(parts.hostname, DEFAULT_PORT if port is None else port)
    return PiController.open(link, stage, axes=axes, timeout=longest_silence(timeout))


def open_serial(
    address: str, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller at a serial port: ``serial:///dev/ttyUSB0?baud=115200``."""
    parts = urlsplit(address.strip())
    options = options_of(address, parts, ("baud",))
    baud = options.get("baud", str(DEFAULT_BAUD))
    port = parts.netloc or parts.path
    if not port.strip("/") or (parts.netloc and parts.path.strip("/")):
        raise ModelError(f"'{address}' names no port: write serial:///dev/ttyUSB0 or serial://COM3")
    if not baud.isdecimal() or not 300 <= int(baud) <= 12_000_000:
        raise ModelError(f"the baud rate of '{address}' must be 300 to 12000000, got '{baud}'")
    link = SerialLink(port, baud=int(baud))
    return PiController.open(link, stage, axes=axes, timeout=longest_silence(timeout))


def open_gateway(
    gateway: object, stage: Stage, *, axes: Mapping[str, str] | None, timeout: float | None
) -> PiController:
    """Connect to a controller through an object of the user's own."""
    return PiController.open(
        GatewayLink(gateway), stage, axes=axes, timeout=longest_silence(timeout)
    )
