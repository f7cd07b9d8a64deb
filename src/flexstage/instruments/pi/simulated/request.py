"""What is asked of a twin: a simulated stage behind a GCS controller."""

from dataclasses import dataclass
from typing import Annotated, Literal

from flexstage.errors import ModelError
from flexstage.files.ranges import Range, Seed, Written
from flexstage.files.request import Request
from flexstage.units import DIMENSIONS


def read_names(text: str) -> tuple[str, ...]:
    """Return names as they are, without a thought of what they may be."""
    return tuple(text.split(",")) if text else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinRequest(Request):
    """A simulated stage behind a GCS controller."""

    port: Annotated[int, Range(low=0, high=65535)] = 50000
    """TCP port; 0 for any free port."""
    host: Annotated[str, Written("ADDRESS")] = "127.0.0.1"
    """Address to listen on; any address but 127.0.0.1 lets others on the network move the stage."""
    seed: Seed = 0
    """Random seed of the simulated stage."""
    model: Literal["lumped", "superelement"] = "lumped"
    """Model of the mechanics: rigid bodies, or finite elements, condensed."""
    servo_rate: Annotated[
        float, DIMENSIONS["frequency"], Range(low=1e3, high=50e3), Written(bare="Hz")
    ] = 10e3
    """Rate of the servo loop, such as "10 kHz"."""
    amplifier: Literal["voltage", "charge"] = "voltage"
    """Amplifier of the piezo stacks; no effect on screw drives."""
    fast: bool = False
    """Advance simulated time by commands instead of real time."""
    identity: (
        Literal[
            "E-727", "E-709", "E-712", "E-725", "E-753", "E-754", "E-516", "E-517", "C-863",
            "C-884", "flexstage",
        ]
        | None
    ) = None  # fmt: skip
    """Controller type that it reports, by which programs choose their driver (default: E-727, or
    C-884 for screws); flexstage: own name and all commands.
    """
    axes: Annotated[tuple[str, ...], Written("NAMES", read=read_names, write=",".join)] = ()
    """Identifiers of its axes, such as "Z" or "X,Y" (default: 1,2,...)."""
    serial_number: Annotated[str, Written("TEXT")] = ""
    """Serial number that it reports (default: twin-SEED)."""
    hold_control: bool = False
    """The first program that sends a motion or a change keeps control until it disconnects
    (default: all have control, as with a real controller).
    """

    def __post_init__(self) -> None:
        super(TwinRequest, self).__post_init__()
        if not (self.serial_number.isascii() and self.serial_number.isprintable()):
            raise ModelError("--serial-number must be of plain printable characters")
