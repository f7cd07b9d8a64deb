"""Whole periods: the linear chain undone harmonic by harmonic, the hysteresis until it repeats."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Array, Complex
from flexstage.control.trajectories.trajectory import Trajectory
from flexstage.errors import ConvergenceError, ModelError
from flexstage.hysteresis import DriveModel

#: Harmonics above this part of the rate of samples are left out.
_HIGHEST = 0.4
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


def delayed(trajectory: Trajectory, delay: float) -> Trajectory:
    """Return a trajectory later by a delay [s], any part of a sample; earlier below 0."""
    n = trajectory.size
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n, 1.0 / trajectory.sample_rate_hz) * delay)
    moved = {a: np.asarray(np.fft.irfft(np.fft.rfft(x) * turn, n), dtype=np.float64)
             for a, x in trajectory.positions.items()}  # fmt: skip
    whole = round(delay * trajectory.sample_rate_hz)
    return replace(trajectory, positions=moved, linear=np.roll(trajectory.linear, whole))


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
    highest = _HIGHEST * sample_rate_hz if band_hz is None else band_hz
    kept = f <= highest
    spectrum = np.zeros(f.size, dtype=np.complex128)
    spectrum[kept] = np.fft.rfft(y)[kept] / chain_response(model, f[kept], creep=creep)
    return np.asarray(np.fft.irfft(spectrum, y.size), dtype=np.float64)


def steady_output(model: DriveModel, u: ArrayLike) -> Array:
    """Return the output of the hysteresis for an input that has long repeated."""
    given = np.asarray(u, dtype=np.float64)
    state = _start(model)
    before = np.zeros(given.size)
    for _ in range(_MOST_PERIODS):
        made = model.hysteresis.simulate(given, state)
        if np.max(np.abs(made.values - before)) <= _SAME * max(float(np.ptp(made.values)), 1e-300):
            return made.values
        before, state = made.values, made.state
    raise ConvergenceError(_no_repeat(model, "output"))


def steady_input(
    model: DriveModel, x: ArrayLike, limits: tuple[float, float] | None = None
) -> tuple[Array, int]:
    """Return the input for which the hysteresis gives an output that repeats.

    Beside it, how many samples were out of reach and led back to what the drive reaches.
    The inverse is run over the same period until what it remembers is the same at the beginning
    of each: three periods for models whose memory is wiped out, some more for those that forget.
    """
    wanted = np.asarray(x, dtype=np.float64)
    low, high = reach_limits(model, limits)
    start = _start(model)
    inside, beyond = within_reach(model, wanted, start, (low, high))
    state, before = start, np.full(wanted.size, np.inf)
    for _ in range(_MOST_PERIODS):
        made = model.hysteresis.inverse(inside, state)
        u = np.clip(made.values, low, high)
        if np.max(np.abs(u - before)) <= _SAME * (high - low):
            return u, beyond
        before, state = u, made.state
    raise ConvergenceError(_no_repeat(model, "input"))


def within_reach(
    model: DriveModel, wanted: Array, state: Array, limits: tuple[float, float]
) -> tuple[Array, int]:
    """Return displacements as far as the drive reaches them, and how many it does not reach."""
    top, bottom = model.hysteresis.simulate(limits[::-1], state).values
    inside = np.clip(wanted, bottom, top)
    beyond = np.abs(inside - wanted) > 1e-9 * (top - bottom)
    if beyond.all():
        raise ModelError(
            f"the motion needs displacements of {wanted.min():.4g} to {wanted.max():.4g}, the "
            f"drive gives {bottom:.4g} to {top:.4g} {model.output_unit}: shift it into that range"
        )
    return inside, int(beyond.sum())


def reach_limits(model: DriveModel, limits: tuple[float, float] | None) -> tuple[float, float]:
    """Return the range of the input that a model and its limits allow."""
    if limits is None:
        if model.validity is None:
            raise ModelError("the model has no range of its own: give the limits of the command")
        limits = model.validity.input_range
    low, high = limits
    own = model.hysteresis.input_limits
    if own is not None:
        low, high = max(low, own[0]), min(high, own[1])
    if not low < high:
        raise ModelError(f"the limits of the command must rise and meet the model, got {limits!r}")
    return low, high


def _start(model: DriveModel) -> Array:
    return model.hysteresis.initial_state() if model.validity is None else model.conditioned()


def _no_repeat(model: DriveModel, what: str) -> str:
    return (
        f"the {what} of the {model.hysteresis.kind} model does not repeat within {_MOST_PERIODS} "
        "periods: its memory fades too slowly; identify another model"
    )
