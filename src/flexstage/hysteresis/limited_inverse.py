"""The inverse of a hysteresis between the limits of its input."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import ModelError
from flexstage.hysteresis.drive_model import PREFIX, DriveModel
from flexstage.hysteresis.model import Array, Response
from flexstage.units import readable

#: Samples that are inverted at once: a limit makes the rest of them be inverted again.
_BLOCK = 4096
#: What is missed by more than this share of all that the drive reaches, a limit has changed.
_MISSED = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitedInverse:
    """An input between limits."""

    command: Array
    """The input, shape (n,)."""
    state: Array
    """State of the hysteresis after it."""
    missed: NDArray[np.bool_]
    """Where the output is not what was wanted, shape (n,)."""


def command_limits(model: DriveModel, limits: tuple[float, float] | None) -> tuple[float, float]:
    """Return the range of the command: the given one, or that the model was identified on.

    It keeps to the ends of a model that has such, as a polynomial says nothing beyond them.
    """
    if limits is None:
        if model.validity is None:
            raise ModelError("the model has no range of its own: give the limits of the command")
        limits = model.validity.input_range
    low, high = limits
    if not low < high:
        raise ModelError(f"the limits of the command must rise, got {limits!r}")
    own = model.hysteresis.input_limits
    if own is not None:
        low, high = max(low, own[0]), min(high, own[1])
        if not low < high:
            raise ModelError(
                f"the limits of the command must meet those of the model, {own[0]:g} to "
                f"{own[1]:g}, got {limits!r}"
            )
    return low, high


def limited_inverse(
    model: DriveModel, target: Array, state: Array, limits: tuple[float, float], wanted: Array
) -> LimitedInverse:
    """Return the input between limits whose output comes nearest to a target.

    Target and output are of the hysteresis; a ModelError where none of the target is in reach says
    so in readings, those that are wanted.
    """
    low, high = limits
    # what the ends reach depends on the memory, so that a sample in the range can be missed as well
    top, bottom = model.hysteresis.simulate([high, low], state).values.tolist()
    inside = np.clip(target, bottom, top)
    beyond = np.abs(inside - target) > _MISSED * (top - bottom)
    if beyond.all():
        raise ModelError(_out_of_reach(model, wanted, (bottom, top)))
    command, after = _within(model, inside, state, low, high)
    left = np.abs(model.hysteresis.simulate(command, state).values - inside)
    return LimitedInverse(
        command=command, state=after, missed=beyond | (left > _MISSED * (top - bottom))
    )


def _within(
    model: DriveModel, target: Array, start: Array, low: float, high: float
) -> tuple[Array, Array]:
    """Invert between limits: after a stretch at one, from the state that it left."""
    command = np.empty_like(target)
    at, state = 0, start
    while at < target.size:
        raw = _nearest(model, target[at : at + _BLOCK], state)
        cut = np.clip(raw.values, low, high)
        off = cut != raw.values
        if off.any():
            first = int(np.argmax(off))
            back = np.flatnonzero(~off[first:])
            cut = cut[: first + int(back[0])] if back.size else cut
            state = model.hysteresis.simulate(cut, state).state
        else:
            state = raw.state
        command[at : at + cut.size] = cut
        at += cut.size
    return command, state


def _nearest(model: DriveModel, target: Array, start: Array) -> Response:
    try:
        return model.hysteresis.nearest(target, start)
    except ModelError as error:
        if all(c.holds for c in model.hysteresis.properties() if c.name == "invertible"):
            raise
        raise ModelError(
            f"the {model.hysteresis.kind} model has no inverse for this reference, since its "
            "reading may fall where the command rises: take a smaller reference, or identify "
            "another model, such as preisach"
        ) from error


def _out_of_reach(model: DriveModel, wanted: Array, reach: tuple[float, float]) -> str:
    # creep adds to what the hysteresis reaches, so what was seen says more where it is known
    seen = None if model.validity is None else model.validity.output_range
    ends = seen or sorted(model.offset + model.sign * r for r in reach)
    unit = model.output_unit
    times = float(np.ptp(wanted)) / (ends[1] - ends[0])
    slip = f"; it spans {times:.3g} times as much: is its unit right?" if times > PREFIX else ""
    return (
        f"the reference runs from {readable(unit, wanted.min(), wanted.max(), digits=4)}, the "
        f"drive reaches {readable(unit, *ends, digits=4)}: shift the reference into that range"
        f"{slip}"
    )
