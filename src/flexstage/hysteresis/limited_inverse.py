"""Inverse of a hysteresis between limits of its input, for a single motion or whole periods.

Over whole periods the linear chain is inverted for each harmonic, and the hysteresis until it is
periodic.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Complex
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.hysteresis.drive_model import PREFIX, DriveModel
from flexstage.hysteresis.model import Array, Response, checked
from flexstage.quantities.units import readable

#: Number of samples that are inverted at once; after a limit the remaining ones are inverted again.
_BLOCK = 4096
#: Largest change, as a share of the range, that counts as none.
_ROUNDING = 1e-9

#: Highest harmonic, as a share of the sample rate.
HIGHEST = 0.4
#: Time after the start of an endless repetition for the mean of its creep, which never settles [s].
_SETTLED = 10.0
#: Most periods until the memory of a hysteresis is periodic.
_MOST_PERIODS = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitedInverse:
    """An input between limits."""

    command: Array
    """The input, shape (n,)."""
    state: Array
    """State of the hysteresis after it."""
    missed: NDArray[np.bool_]
    """True for samples at which the output is not the requested one, shape (n,)."""


def command_limits(model: DriveModel, limits: tuple[float, float] | None) -> tuple[float, float]:
    """Return the range of the command: the given one, or that of the identification.

    It is limited to the input limits of the model, as a polynomial is invalid beyond them.
    """
    if limits is None:
        if model.validity is None:
            raise ModelError("the model has no validity range: give the limits of the command")
        limits = model.validity.input_range
    low, high = limits
    if not low < high:
        raise ModelError(f"the limits of the command must rise, got {limits!r}")
    model_limits = model.hysteresis.input_limits
    if model_limits is not None:
        low, high = max(low, model_limits[0]), min(high, model_limits[1])
        if not low < high:
            raise ModelError(
                f"the limits of the command must meet those of the model, {model_limits[0]:g} to "
                f"{model_limits[1]:g}, got {limits!r}"
            )
    return low, high


def limited_inverse(
    model: DriveModel, target: Array, state: Array, limits: tuple[float, float], requested: Array
) -> LimitedInverse:
    """Return the input between limits whose output is nearest to a target.

    Target and output are of the hysteresis. A ModelError if all of the target is out of reach; its
    message contains the requested readings.
    """
    low, high = limits
    # the output range depends on the memory, so that a sample inside it can be missed as well
    top, bottom = model.hysteresis.simulate([high, low], state).values.tolist()
    inside = np.clip(target, bottom, top)
    beyond = np.abs(inside - target) > _ROUNDING * (top - bottom)
    if beyond.all():
        raise ModelError(_out_of_reach(model, requested, reach(model, limits, state)))
    command, after = _within(model, inside, state, low, high)
    error = np.abs(model.hysteresis.simulate(command, state).values - inside)
    return LimitedInverse(
        command=command, state=after, missed=beyond | (error > _ROUNDING * (top - bottom))
    )


def _within(
    model: DriveModel, target: Array, start: Array, low: float, high: float
) -> tuple[Array, Array]:
    """Invert between limits; after a stretch at a limit, from the state at its end."""
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
            "reading may fall while the command rises: reduce the reference, or identify another "
            "model, such as preisach"
        ) from error


def reach(model: DriveModel, limits: tuple[float, float], state: Array) -> tuple[float, float]:
    """Return the lowest and the highest reading for commands between limits."""
    low, high = limits
    known = model.validity
    # creep adds to the output of the hysteresis, so the identified range is the better one
    if known and low <= known.input_range[0] and known.input_range[1] <= high:
        return known.output_range
    ends = model.offset + model.sign * model.hysteresis.simulate([high, low], state).values
    return float(ends.min()), float(ends.max())


def _out_of_reach(model: DriveModel, requested: Array, ends: tuple[float, float]) -> str:
    unit = model.output_unit
    times = float(np.ptp(requested)) / (ends[1] - ends[0])
    hint = f"; it spans {times:.3g} times as much: check its unit" if times > PREFIX else ""
    return (
        f"the reference, {readable(unit, requested.min(), requested.max(), digits=4)}, is outside "
        f"the range of the drive, {readable(unit, *ends, digits=4)}: shift the reference into that "
        f"range{hint}"
    )


def chain_response(model: DriveModel, frequency_hz: ArrayLike, *, creep: bool = True) -> Complex:
    """Return the response [1] of reading over displacement: creep, modes and lag of a drive."""
    f = np.asarray(frequency_hz, dtype=np.float64)
    total = np.full(f.shape, model.sign, dtype=np.complex128)
    for element in (model.creep if creep else None, model.modes, model.lag):
        if element is not None:
            total = total * element.frequency_response(f)
    return total


def steady_displacement(
    model: DriveModel,
    reading: ArrayLike,
    sample_rate_hz: float,
    *,
    creep: bool = True,
    band_hz: float | None = None,
) -> Array:
    """Return the output of the hysteresis for a periodic reading, both over one period.

    Harmonics above the bandwidth, 0.4 of the sample rate where not given, are omitted. Creep is
    inverted as after many periods, and its mean as `_SETTLED` after the start.
    """
    y = np.asarray(reading, dtype=np.float64) - model.offset
    f = np.fft.rfftfreq(y.size, 1.0 / sample_rate_hz)
    highest = HIGHEST * sample_rate_hz if band_hz is None else band_hz
    in_band = f <= highest
    spectrum = np.zeros(f.size, dtype=np.complex128)
    spectrum[in_band] = np.fft.rfft(y)[in_band] / chain_response(model, f[in_band], creep=creep)
    x = np.asarray(np.fft.irfft(spectrum, y.size), dtype=np.float64)
    if creep and model.creep is not None:
        x += model.sign * float(np.mean(y)) / _settled(model) - float(np.mean(x))
    return x


def within_band(values: Array, sample_rate_hz: float, band_hz: float) -> Array:
    """Return one period without its harmonics above a bandwidth."""
    checked(band_hz, "band", "positive and finite", "Hz")
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(values.size, 1.0 / sample_rate_hz) > band_hz] = 0.0
    return np.asarray(np.fft.irfft(spectrum, values.size))


def steady_output(model: DriveModel, u: ArrayLike) -> Array:
    """Return the output of the hysteresis after many periods of an input."""
    inputs = np.asarray(u, dtype=np.float64)
    state = model.before().hysteresis
    before = np.zeros(inputs.size)
    for _ in range(_MOST_PERIODS):
        response = model.hysteresis.simulate(inputs, state)
        if np.max(np.abs(response.values - before)) <= _ROUNDING * max(
            float(np.ptp(response.values)), 1e-300
        ):
            return response.values
        before, state = response.values, response.state
    raise ConvergenceError(_no_repeat(model, "output"))


def steady_reading(model: DriveModel, u: ArrayLike, sample_rate_hz: float) -> Array:
    """Return one period of the reading for a periodic input, `_SETTLED` after its start."""
    x = steady_output(model, u)
    f = np.fft.rfftfreq(x.size, 1.0 / sample_rate_hz)
    y = np.fft.irfft(np.fft.rfft(x) * chain_response(model, f), x.size)
    return np.asarray(model.offset + y + (model.sign * _settled(model) * np.mean(x) - np.mean(y)))


def _settled(model: DriveModel) -> float:
    """Return the gain of the creep for the mean of a periodic input."""
    return 1.0 if model.creep is None else float(model.creep.step_response([_SETTLED])[0])


def steady_input(
    model: DriveModel,
    x: ArrayLike,
    limits: tuple[float, float] | None = None,
    *,
    requested: Array | None = None,
) -> LimitedInverse:
    """Return the periodic input of the hysteresis for a periodic output.

    The inverse is repeated over the same period until its memory is the same at the beginning of
    each: three periods for models whose memory is erased, a few more for fading memory. The
    requested readings, for a message, are those of the output where not given.
    """
    target = np.asarray(x, dtype=np.float64)
    readings = model.offset + model.sign * target if requested is None else requested
    low, high = command_limits(model, limits)
    state, before = model.before().hysteresis, np.full(target.size, np.inf)
    for _ in range(_MOST_PERIODS):
        inverse = limited_inverse(model, target, state, (low, high), readings)
        if np.max(np.abs(inverse.command - before)) <= _ROUNDING * (high - low):
            return inverse
        before, state = inverse.command, inverse.state
    raise ConvergenceError(_no_repeat(model, "input"))


def _no_repeat(model: DriveModel, what: str) -> str:
    return (
        f"the {what} of the {model.hysteresis.kind} model is not periodic within {_MOST_PERIODS} "
        "periods: its memory fades too slowly; identify another model"
    )
