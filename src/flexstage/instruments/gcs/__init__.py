"""Controllers that speak PI's General Command Set, over the network, a serial port or a gateway."""

from typing import TYPE_CHECKING

from flexstage.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.gcs.client import GcsClient
    from flexstage.instruments.gcs.codes import error_sentence
    from flexstage.instruments.gcs.controller import PiController
    from flexstage.instruments.gcs.gateway import GatewayLink
    from flexstage.instruments.gcs.profile import Profile, Wire
    from flexstage.instruments.gcs.serial_port import SerialLink
    from flexstage.instruments.gcs.tcp import TcpLink
    from flexstage.instruments.gcs.transport import InProcess, NoAnswerError, Transport

__all__ = [
    "GatewayLink",
    "GcsClient",
    "InProcess",
    "NoAnswerError",
    "PiController",
    "Profile",
    "SerialLink",
    "TcpLink",
    "Transport",
    "Wire",
    "error_sentence",
]

import_on_use(__name__)
