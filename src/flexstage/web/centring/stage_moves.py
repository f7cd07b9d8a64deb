"""The stage at the bench as the one that carries the scale: where it stands, and its moves."""

import time

import numpy as np

from flexstage.base.errors import ControllerError, ModelError
from flexstage.instruments.limits import check_position
from flexstage.web.bench.link import BenchLink

_PATIENCE = 30.0  # s


def axes_of(bench: BenchLink) -> tuple[str, str] | None:
    """Return the two axes that carry the scale, where a stage with such is connected."""
    names = tuple(bench.device.axes) if bench.device is not None else ()
    return (names[0], names[1]) if len(names) >= 2 else None


def place_of(bench: BenchLink) -> tuple[float, float] | None:
    """Return where a connected stage stands [m]."""
    axes = axes_of(bench)
    if axes is None or not all(axis in bench.readings for axis in axes):
        return None
    x, y = (bench.readings[axis].position for axis in axes)
    return x, y


def limits_of(bench: BenchLink) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return how far the axes of a connected stage go [m], where that is known."""
    axes, device = axes_of(bench), bench.device
    if axes is None or device is None:
        return None
    x, y = (device.axes[axis].limits.position for axis in axes)
    return None if x is None or y is None else (x, y)


def noise_of(bench: BenchLink) -> tuple[float, float]:
    """Return what the sensors of a connected stage do not tell from rest [m]: three deviations."""
    axes, history = axes_of(bench), bench.history
    span = history.span if history is not None else None
    if axes is None or history is None or span is None:
        return 0.0, 0.0
    last = history.samples(span[1] - 0.5, span[1])  # enough to tell the noise [s]
    names = [channel.name for channel in history.channels]
    x, y = (3.0 * float(np.std(last.low[:, names.index(f"{axis} position")])) for axis in axes)
    return x, y


def move_to(bench: BenchLink, session: str, target: tuple[float, float]) -> tuple[float, float]:
    """Lead both axes to a place [m] and wait until they rest; return where they stand then.

    Raises
    ------
    FlexstageError
        This browser does not drive, the limits forbid it, or position control is off.
    """
    axes = axes_of(bench)
    if axes is None:
        raise ModelError("no stage of two axes is connected: connect one in the view Bench")
    bench.control.require(session)
    off = [name for name in axes if not bench.readings[name].closed_loop]
    if off:
        raise ModelError(
            f"axis {' and '.join(off)} is driven by its voltage: switch its position control on "
            "in the view Bench, so that it goes to a position"
        )
    # both are refused before either moves
    for name, value in zip(axes, target, strict=True):
        check_position(bench.linked().axes[name].limits, value, name)
    for name, value, noise in zip(axes, target, noise_of(bench), strict=True):
        if abs(value - bench.readings[name].position) > noise:
            bench.go(session, name, value).result()
    end = time.monotonic() + _PATIENCE
    while any(bench.readings[name].moving for name in axes):
        if time.monotonic() > end:
            raise ControllerError(f"the stage does not come to rest within {_PATIENCE:g} s")
        time.sleep(0.05)
    time.sleep(0.15)  # for a reading of where it rests
    bench.linked()
    x, y = (bench.readings[name].position for name in axes)
    return x, y
