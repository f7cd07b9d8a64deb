"""The inverse of a hysteresis between the limits of its input, once and over whole periods.

Over whole periods the linear chain is undone harmonic by harmonic, the hysteresis until it repeats.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexstage.base.arrays import Complex
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.hysteresis.drive_model import PREFIX, DriveModel
from flexstage.hysteresis.model import Array, Response, checked
from flexstage.quantities.units import readable

#: Samples that are inverted at once: a limit makes the rest of them be inverted again.
_BLOCK = 4096
#: What is missed by more than this share of all that the drive reaches, a limit has changed.
_MISSED = 1e-9

#: Harmonics above this part of the rate of samples are left out.
HIGHEST = 0.4
#: A hysteresis repeats when its input changes by less than this share of the range in a period.
_SAME = 1e-9
_MOST_PERIODS = 40


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
    """Return what the hysteresis must give for a reading that repeats, each of one period.

    Harmonics above the band, 0.4 of the sample rate where not given, are left out. Creep is undone
    as if it had repeated for long.
    """
    y = np.asarray(reading, dtype=np.float64) - model.offset
    f = np.fft.rfftfreq(y.size, 1.0 / sample_rate_hz)
    highest = HIGHEST * sample_rate_hz if band_hz is None else band_hz
    kept = f <= highest
    spectrum = np.zeros(f.size, dtype=np.complex128)
    spectrum[kept] = np.fft.rfft(y)[kept] / chain_response(model, f[kept], creep=creep)
    return np.asarray(np.fft.irfft(spectrum, y.size), dtype=np.float64)


def within_band(values: Array, sample_rate_hz: float, band_hz: float) -> Array:
    """Return one period without its harmonics above a band."""
    checked(band_hz, "band", "positive and finite", "Hz")
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(values.size, 1.0 / sample_rate_hz) > band_hz] = 0.0
    return np.asarray(np.fft.irfft(spectrum, values.size))


def steady_output(model: DriveModel, u: ArrayLike) -> Array:
    """Return the output of the hysteresis for an input that has long repeated."""
    given = np.asarray(u, dtype=np.float64)
    state = steady_start(model)
    before = np.zeros(given.size)
    for _ in range(_MOST_PERIODS):
        made = model.hysteresis.simulate(given, state)
        if np.max(np.abs(made.values - before)) <= _SAME * max(float(np.ptp(made.values)), 1e-300):
            return made.values
        before, state = made.values, made.state
    raise ConvergenceError(_no_repeat(model, "output"))


def steady_reading(model: DriveModel, u: ArrayLike, sample_rate_hz: float, settled: float) -> Array:
    """Return one period of the reading for an input that repeats, settled [s] after its start."""
    x = steady_output(model, u)
    f = np.fft.rfftfreq(x.size, 1.0 / sample_rate_hz)
    y = np.fft.irfft(np.fft.rfft(x) * chain_response(model, f), x.size)
    gain = 1.0 if model.creep is None else float(model.creep.step_response([settled])[0])
    return np.asarray(model.offset + y + (model.sign * gain * np.mean(x) - np.mean(y)))


def steady_input(
    model: DriveModel,
    x: ArrayLike,
    limits: tuple[float, float] | None = None,
    *,
    wanted: Array | None = None,
) -> LimitedInverse:
    """Return the input for which the hysteresis gives an output that repeats.

    The inverse is run over the same period until what it remembers is the same at the beginning
    of each: three periods for models whose memory is wiped out, some more for those that forget.
    The readings that are wanted, for a message, are those of the output itself where not given.
    """
    target = np.asarray(x, dtype=np.float64)
    readings = model.offset + model.sign * target if wanted is None else wanted
    low, high = command_limits(model, limits)
    state, before = steady_start(model), np.full(target.size, np.inf)
    for _ in range(_MOST_PERIODS):
        made = limited_inverse(model, target, state, (low, high), readings)
        if np.max(np.abs(made.command - before)) <= _SAME * (high - low):
            return made
        before, state = made.command, made.state
    raise ConvergenceError(_no_repeat(model, "input"))


def steady_start(model: DriveModel) -> Array:
    """Return the memory that the search for a motion that repeats begins with."""
    return model.hysteresis.initial_state() if model.validity is None else model.conditioned()


def _no_repeat(model: DriveModel, what: str) -> str:
    return (
        f"the {what} of the {model.hysteresis.kind} model does not repeat within {_MOST_PERIODS} "
        "periods: its memory fades too slowly; identify another model"
    )
