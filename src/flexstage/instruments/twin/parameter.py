"""What a parameter of the simulated controller is, to whom it belongs, how it is written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexstage.instruments.protocol import Capability
from flexstage.instruments.twin.servo_draft import ServoDraft
from flexstage.instruments.twin.state import ControllerState
from flexstage.instruments.twin.words import printed

__all__ = ["Edit", "Get", "Parameter", "Set", "Value", "items_of", "value_text"]

Value = float | int | str
Get = Callable[[ControllerState, str], Value]
Set = Callable[[ControllerState, str, str], None]
Edit = Callable[[ServoDraft, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter.

    Parameters
    ----------
    item : {"system", "axis", "piezo", "servo", "channel"}
        What it belongs to; ``piezo``: an axis with a voltage; ``servo``: one with a position
        control that can be set.
    group, name : str
        How it is listed.
    get : callable
        Returns the value, from state and item.
    set : callable, optional
        Sets it, from state, item and word.
    edit : callable, optional
        Sets a number of the position control, all of which are changed at once.
    """

    item: str
    group: str
    name: str
    get: Get
    set: Set | None = None
    edit: Edit | None = None


def items_of(state: ControllerState, parameter: Parameter) -> Sequence[str]:
    """Return the items that have a parameter.

    Parameters
    ----------
    state : ControllerState
        State of the controller.
    parameter : Parameter
        The parameter.

    Returns
    -------
    sequence of str
        Identifiers of axes or channels, or ``"1"`` for the system.
    """
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
    """Return a value as it is sent.

    Parameters
    ----------
    value : float, int or str
        The value.

    Returns
    -------
    str
        Its text.
    """
    return printed(value) if isinstance(value, float) else str(value)
