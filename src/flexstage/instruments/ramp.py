"""Slow ramps to the start of a waveform and to the safe voltage, and waiting for their end."""

import contextlib
import math
from collections.abc import Callable, Mapping

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ControllerError, ModelError, NotConnectedError
from flexstage.instruments.limits import check_position, check_voltage, range_of, rate_of
from flexstage.instruments.protocol import Capability, Instrument, MotionAxis, Quantity, Waveform
from flexstage.stage.limits import AxisLimits

_KNOTS = 64  # of a smooth ramp: its slope changes at a knot by at most 1/12 of the mean slope
_STEP_TIME = 0.01  # between the steps of a staircase [s]
_STEEPEST = 1.875  # largest slope of a smooth ramp over its mean
_STANDING = 30.0  # longest settling time of an axis after a motion [s]
_THERE = 1e-6  # tolerance of a target, over the range


def lead_to(
    instrument: Instrument,
    targets: Mapping[str, float],
    quantity: Quantity,
    *,
    time: float = 0.5,
) -> None:
    r"""Ramp axes slowly to the start of a waveform, synchronously where the instrument can.

    With a wave generator the axes follow :math:`10 s^3 - 15 s^4 + 6 s^5` over time, which starts
    and ends with zero speed and acceleration; otherwise small steps are commanded one by one. All
    targets [V, or m] are checked before any motion. The motion takes `time` [s], longer where speed
    or slew requires it; the axes must be at rest within half a minute after it.
    """
    limits = {name: _axis(instrument, name).limits for name in targets}
    for name, value in targets.items():
        (check_voltage if quantity == "voltage" else check_position)(limits[name], value, name)
    require_loop(instrument, targets, quantity)
    here = {name: _here(instrument.axes[name], quantity) for name in targets}
    ends = {
        n: float(v) for n, v in targets.items() if not _is_there(limits[n], here[n], v, quantity)
    }
    if not ends:
        return
    # An axis that stands outside its range, as a stage at rest may, is first moved to its end.
    begins = {n: _led(limits[n], here[n], quantity) for n in ends}
    outside = [n for n, b in begins.items() if quantity == "position" and b != here[n]]
    for name in outside:
        instrument.axes[name].move_to(begins[name], wait=False)
    for name in outside:
        instrument.axes[name].wait(_STANDING)
    screws = [n for n in ends if limits[n].voltage is None]
    if Capability.WAVE_GENERATOR in instrument.capabilities and not screws:
        _run_smooth(instrument, begins, ends, quantity, time)
    elif quantity == "voltage":
        _climb(instrument, begins, ends, time)
    else:
        _travel(instrument, begins, ends, time)
    for name in ends:
        instrument.axes[name].wait(_STANDING)


def to_safe(instrument: Instrument) -> None:
    """Lead every drive with a voltage to its safe voltage, by small steps of plain commands.

    Position control is switched off first, which leaves the voltage as it is. Drives without a
    voltage, such as screws, stay where they are. It takes half a second, longer where the slew asks
    for it.
    """
    begins, ends = {}, {}
    for name, axis in instrument.axes.items():
        limits = axis.limits
        if limits.voltage is None or Capability.OPEN_LOOP not in axis.capabilities:
            continue
        if axis.closed_loop:
            axis.set_closed_loop(False)
        voltage = _here(axis, "voltage")
        if not _is_there(limits, voltage, limits.safe_voltage, "voltage"):
            begins[name] = _led(limits, voltage, "voltage")
            ends[name] = limits.safe_voltage
    if ends:
        _climb(instrument, begins, ends, 0.5)


def wait_for_rest(
    instrument: Instrument,
    moving: Callable[[], bool],
    timeout: float,
    what: str,
    *,
    step: float = _STEP_TIME,
) -> None:
    """Wait until motion ends; stop the instrument on timeout [s], lost connection, or Ctrl-C.

    `what` is for the message: ``axis 'x' still moved``. Motion is checked after each `step` [s].
    """
    waited = 0.0
    try:
        while moving():
            if waited > timeout:
                instrument.stop()
                raise ControllerError(f"{what} after {timeout:g} s: the stage was stopped")
            instrument.pause(step)
            waited += step
    except (KeyboardInterrupt, NotConnectedError):
        with contextlib.suppress(NotConnectedError):  # a lost link may not carry the stop
            instrument.stop()
        raise


def require_loop(instrument: Instrument, axes: Mapping[str, float], quantity: Quantity) -> None:
    """Refuse axes whose position control is off for positions, or on for voltages."""
    for name in axes:
        on = instrument.axes[name].closed_loop
        if on and quantity == "voltage":
            raise ControllerError(
                f"axis '{name}' is under position control and accepts no voltages: switch the "
                "control off first"
            )
        if not on and quantity == "position":
            raise ControllerError(
                f"axis '{name}' is not under position control and accepts no positions: switch the "
                "control on first"
            )


def _axis(instrument: Instrument, name: str) -> MotionAxis:
    if name not in instrument.axes:
        raise ModelError(
            f"the instrument has no axis '{name}': it has {', '.join(map(repr, instrument.axes))}"
        )
    return instrument.axes[name]


def _here(axis: MotionAxis, quantity: Quantity) -> float:
    value = axis.voltage() if quantity == "voltage" else axis.position()
    if math.isfinite(value):
        return value
    if quantity == "voltage":
        raise ControllerError(
            f"the voltage of axis '{axis.name}' is unknown: measure it at the drive before you "
            "move the stage"
        )
    raise ControllerError(
        f"axis '{axis.name}' reads {value} as its position: check its sensor and cable"
    )


def _is_there(limits: AxisLimits, value: float, target: float, quantity: Quantity) -> bool:
    # On the scale of the range; exactly where there is none.
    bounds = range_of(limits, quantity)
    span = bounds[1] - bounds[0] if bounds is not None else 0.0
    return abs(value - target) <= _THERE * span


def _led(limits: AxisLimits, value: float, quantity: Quantity) -> float:
    bounds = range_of(limits, quantity)
    return value if bounds is None else min(max(value, bounds[0]), bounds[1])


def _duration(
    instrument: Instrument,
    begins: Mapping[str, float],
    ends: Mapping[str, float],
    quantity: Quantity,
    time: float,
) -> float:
    """Return the duration of a smooth ramp, long enough for the rate limit of every axis [s]."""
    needed = [time]
    for name, end in ends.items():
        rate = rate_of(instrument.axes[name].limits, quantity)
        if rate is not None:
            needed.append(1.01 * _STEEPEST * abs(end - begins[name]) / rate)
    return max(needed)


def _smooth(knots: int) -> Array:
    s = np.linspace(0.0, 1.0, knots)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _run_smooth(
    instrument: Instrument,
    begins: Mapping[str, float],
    ends: Mapping[str, float],
    quantity: Quantity,
    time: float,
) -> None:
    waves = instrument.waves
    duration = _duration(instrument, begins, ends, quantity, time)
    divider = max(math.floor(waves.base_rate_hz * duration / _KNOTS), 1)
    rate = waves.base_rate_hz / divider
    knots = max(math.ceil(duration * rate), 2) + 1
    shape = _smooth(knots)
    values = {n: begins[n] + (end - begins[n]) * shape for n, end in ends.items()}
    waves.load(Waveform(values=values, sample_rate_hz=rate, quantity=quantity))
    waves.start(1)
    wait_for_rest(
        instrument,
        waves.running,
        duration + _STANDING,
        f"the ramp to the start has a duration of {duration:g} s and still ran",
        step=min(max(duration / 20.0, 0.005), 0.05),
    )


def _climb(
    instrument: Instrument, begins: Mapping[str, float], ends: Mapping[str, float], time: float
) -> None:
    duration = _duration(instrument, begins, ends, "voltage", time)
    shape = _smooth(max(math.ceil(duration / _STEP_TIME), 2) + 1)
    for share in shape[1:]:
        for name, end in ends.items():
            value = end if share == 1.0 else begins[name] + (end - begins[name]) * float(share)
            instrument.axes[name].set_voltage(value)
        instrument.pause(_STEP_TIME)


def _travel(
    instrument: Instrument, begins: Mapping[str, float], ends: Mapping[str, float], time: float
) -> None:
    for name, end in ends.items():
        axis = instrument.axes[name]
        if axis.limits.speed is None:  # without a speed limit, it would step
            for share in _smooth(max(math.ceil(time / _STEP_TIME), 2) + 1)[1:-1]:
                axis.move_to(begins[name] + (end - begins[name]) * float(share), wait=False)
                instrument.pause(_STEP_TIME)
        axis.move_to(end, wait=False)
