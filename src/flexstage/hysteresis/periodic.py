"""Whole periods: the linear chain undone harmonic by harmonic, the hysteresis until it repeats."""

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Complex
from flexstage.errors import ConvergenceError
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.limited_inverse import LimitedInverse, command_limits, limited_inverse
from flexstage.hysteresis.model import checked

#: Harmonics above this part of the rate of samples are left out.
HIGHEST = 0.4
#: A hysteresis repeats when its input changes by less than this share of the range in a period.
_SAME = 1e-9
_MOST_PERIODS = 40


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
