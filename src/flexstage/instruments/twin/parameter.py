"""What a parameter of the simulated controller is, to whom it belongs, how it is written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexstage.instruments.protocol import Capability
from flexstage.instruments.twin.servo_draft import ServoDraft
from flexstage.instruments.twin.state import ControllerState
from flexstage.instruments.twin.words import printed

Value = float | int | str
Get = Callable[[ControllerState, str], Value]
Set = Callable[[ControllerState, str, str], None]
Edit = Callable[[ServoDraft, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter."""

    item: str
    """What it belongs to; ``piezo``: an axis with a voltage; ``servo``: one with a position control
    that can be set.
    """
    group: str
    """How it is listed."""
    name: str
    """How it is listed."""
    get: Get
    """Returns the value, from state and item."""
    set: Set | None = None
    """Sets it, from state, item and word."""
    edit: Edit | None = None
    """Sets a number of the position control, all of which are changed at once."""


def items_of(state: ControllerState, parameter: Parameter) -> Sequence[str]:
    """Return the items that have a parameter."""
    if parameter.item == "system":
        return ("1",)
    if parameter.item == "channel":
        return tuple(state.channels)
    if parameter.item == "piezo":
        return tuple(state.outputs.values())
    return tuple(
        name
        for name, axis in state.axes.items()
        if parameter.item == "axis" or Capability.SERVO_TUNING in axis.capabilities
    )


def value_text(value: Value) -> str:
    """Return a value as it is sent."""
    return printed(value) if isinstance(value, float) else str(value)
