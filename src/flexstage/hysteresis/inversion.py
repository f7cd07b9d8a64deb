"""The command that makes a drive follow a reference."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

from flexstage.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.drive_model import PREFIX, DriveModel, Start, creep_start, unsuited
from flexstage.hysteresis.model import Array, Response, samples
from flexstage.units import readable

#: A reference is made smooth up to this share of the lowest resonance.
_BAND = 0.25
#: A reference that changes less than this by smoothing, over its range, was smooth.
_SMOOTH = 1e-6
#: A first sample farther from where the drive stands than this share of the limits is told.
_JUMP = 0.01
#: Samples that are inverted at once: a limit makes the rest of them be inverted again.
_BLOCK = 4096
#: What the lags of creep begin with is known from the command, and that from them: they are found
#: in turn, until they change by less than this share of the range, at most so many times.
_ALIKE = 1e-12
_TURNS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feedforward:
    """A command, what it should give, and what had to be changed."""

    time: Array
    """Times [s], shape (n,)."""
    command: Array
    """The command [unit of the input], shape (n,)."""
    reference: Array
    """The reference that it follows, after smoothing [unit of the output], shape (n,)."""
    wanted: Array
    """The reference as it was given, shape (n,)."""
    predicted: Array
    """What the model gives for the command, shape (n,)."""
    start: Array
    """State of the hysteresis before the first sample."""
    smoothing: float
    """Largest change of the reference by smoothing [unit of the output]."""
    limited: int
    """Number of samples at which a limit changed the command."""
    notes: tuple[str, ...]
    """What was changed, and how much of the reference is lost by it."""

    @property
    def rms_error(self) -> float:
        """Root mean square of the prediction less the given reference [unit of the output]."""
        return float(np.sqrt(np.mean((self.predicted - self.wanted) ** 2)))

    @property
    def largest_error(self) -> float:
        """Largest absolute value of the prediction less the given reference."""
        return float(np.max(np.abs(self.predicted - self.wanted)))


def feedforward(
    model: DriveModel,
    reference: ArrayLike,
    dt: float,
    *,
    limits: tuple[float, float] | None = None,
    largest_rate: float | None = None,
    state: ArrayLike | None = None,
    band_hz: float | None = None,
    start: Start | None = None,
) -> Feedforward:
    r"""Return the command that makes a drive follow a reference.

    .. math:: u = H^{-1} \circ C^{-1} \circ S^{-1} (r(t + t_d))

    The delay is led, the modes are undone by the derivatives of the reference, creep by its exact
    recursion, and the hysteresis sample by sample. The reference must have two derivatives for
    this: where the model has a resonance, corners are rounded first.

    Parameters
    ----------
    model : DriveModel
        The drive.
    reference : array_like
        Readings that are wanted [unit of the output], shape (n,).
    dt : float
        Time from one sample to the next [s].
    limits : tuple of float, optional
        Lowest and highest command; the range that the model was identified on where not given.
    largest_rate : float, optional
        Largest rate of the command [unit of the input per second].
    state : array_like, optional
        State of the hysteresis before the first sample; that after conditioning cycles where not
        given.
    band_hz : float, optional
        Band that the reference is smoothed to [Hz]; a quarter of the lowest resonance where not
        given, and none where the model has no resonance.
    start : "rested" or float, optional
        What the drive did before, for its creep, as in `DriveModel.simulate`. Where not given it
        had settled at the first reference if a state is given, and else did what it did before the
        record that the model was identified from.

    Returns
    -------
    Feedforward
        The command.

    Raises
    ------
    ModelError
        The reference is no finite sequence or wholly out of reach, or the model has no inverse.
    """
    wanted = samples(reference, "reference")
    if not (dt > 0.0 and np.isfinite(dt)):
        raise ModelError(f"the step between samples must be positive and finite, got {dt!r} s")
    if start is None:
        start = model.start if state is None else "rested"
    memory = np.array(model.conditioned() if state is None else state, dtype=np.float64)
    low, high = _limits(model, limits)
    smooth, notes = _made_smooth(model, wanted, dt, band_hz)
    target = model.sign * (smooth - model.offset)
    if model.lag is not None:
        target = model.lag.lead(target, dt)
    if model.modes is not None:
        target = model.modes.inverse(target, dt).values
    if model.creep is not None:
        target = _without_creep(model.creep, target, dt, start)
    reach = _reach(model, memory, low, high)
    inside = np.clip(target, *reach)
    beyond = np.abs(inside - target) > 1e-9 * (reach[1] - reach[0])
    if beyond.all():
        raise ModelError(_out_of_reach(model, wanted, reach))
    command = _within(model, inside, memory, low, high)
    slow = _rate_limited(command, largest_rate, dt)
    # what the ends reach depends on the memory, so that a sample in the range can be missed as well
    missed = np.abs(model.hysteresis.simulate(command, memory).values - inside)
    limited = beyond | (missed > 1e-9 * (reach[1] - reach[0]))
    limited |= np.abs(slow - command) > 1e-9 * (high - low)
    predicted = model.simulate(slow, dt, memory, start=start)
    if limited.any():
        lost = float(np.max(np.abs(predicted - smooth)))
        notes.append(
            f"limits changed {int(limited.sum())} of {wanted.size} samples of the command; the "
            f"largest error that follows is {readable(model.output_unit, lost)}"
        )
    before = float(memory[0])
    if abs(slow[0] - before) > max(_JUMP * (high - low), (largest_rate or 0.0) * dt):
        notes.append(
            f"the command begins at {readable(model.input_unit, slow[0], digits=5)}, the drive "
            f"stands at {readable(model.input_unit, before, digits=5)} before: lead it there "
            "slowly, in one movement"
        )
    return Feedforward(
        time=(np.arange(wanted.size) * dt).astype(np.float64),
        command=slow,
        reference=smooth,
        wanted=wanted,
        predicted=predicted,
        start=memory,
        smoothing=float(np.max(np.abs(smooth - wanted))),
        limited=int(limited.sum()),
        notes=(*notes, *unsuited(model, dt, command=slow, reading=wanted)),
    )


def _without_creep(creep: Creep, target: Array, dt: float, start: Start) -> Array:
    """Undo creep, by what the drive did before: that is told by the command which is looked for."""
    if start == "rested":
        return creep.inverse(target, dt).values
    x = target / creep.static_gain
    for _ in range(_TURNS):
        change = creep.inverse(target, dt, creep_start(creep, x, dt, start)).values - x
        # a state too high makes it too low, by less than the gain of all lags
        x = x + change / creep.static_gain
        if np.max(np.abs(change)) <= _ALIKE * max(float(np.ptp(x)), 1e-300):
            break
    return x


def _limits(model: DriveModel, limits: tuple[float, float] | None) -> tuple[float, float]:
    if limits is None:
        if model.validity is None:
            raise ModelError("the model has no range of its own: give the limits of the command")
        limits = model.validity.input_range
    low, high = limits
    if not low < high:
        raise ModelError(f"the limits of the command must rise, got {limits!r}")
    own = model.hysteresis.input_limits
    if own is not None:
        # a polynomial says nothing beyond its ends, and its inverse keeps to them
        low, high = max(low, own[0]), min(high, own[1])
        if not low < high:
            raise ModelError(
                f"the limits of the command must meet those of the model, {own[0]:g} to "
                f"{own[1]:g}, got {limits!r}"
            )
    return low, high


def _reach(model: DriveModel, start: Array, low: float, high: float) -> tuple[float, float]:
    """Outputs of the hysteresis at both ends of the command."""
    at = model.hysteresis.simulate([high, low], start).values
    return float(at[1]), float(at[0])


def _within(model: DriveModel, target: Array, start: Array, low: float, high: float) -> Array:
    """Return the inverse between limits: after a stretch at one, from the state that it left."""
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
    return command


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


def _made_smooth(
    model: DriveModel, wanted: Array, dt: float, band_hz: float | None
) -> tuple[Array, list[str]]:
    if band_hz is None and model.modes is not None:
        band_hz = _BAND * min(model.modes.frequency_hz)
    if band_hz is None:
        return wanted, []
    smooth = smoothed(wanted, dt, band_hz)
    change = np.abs(smooth - wanted)
    if change.max() <= _SMOOTH * max(float(np.ptp(wanted)), 1e-300):
        return wanted, []
    unit = model.output_unit
    return smooth, [
        f"the reference was smoothed to a band of {band_hz:.3g} Hz: it changed by at most "
        f"{readable(unit, change.max())}, {readable(unit, np.sqrt(np.mean(change**2)))} rms"
    ]


def smoothed(values: ArrayLike, dt: float, band_hz: float) -> Array:
    """Return a sequence without what is above a band, and without delay.

    Parameters
    ----------
    values : array_like
        The sequence, shape (n,); it is taken to stand still before and after.
    dt : float
        Time from one sample to the next [s].
    band_hz : float
        Frequency at which 3 dB are lost [Hz].

    Returns
    -------
    numpy.ndarray
        The sequence after a Gaussian filter, shape (n,).

    Raises
    ------
    ModelError
        The band is not positive and finite, or lower than a tenth of a cycle in the sequence.

    Examples
    --------
    >>> corner = np.abs(np.arange(-50, 51) * 1.0)
    >>> round(float(smoothed(corner, 1e-3, 50.0)[50]), 3)
    2.089
    """
    given = samples(values, "sequence")
    if not (band_hz > 0.0 and np.isfinite(band_hz)):
        raise ModelError(f"a band must be positive and finite, got {band_hz!r} Hz")
    duration = given.size * dt
    if band_hz * duration < 0.1:
        raise ModelError(
            f"a band of {band_hz:g} Hz leaves nothing of a sequence of {duration:g} s: take at "
            f"least {0.1 / duration:.3g} Hz"
        )
    # exp(-(2 pi f s)^2 / 2) = 1/sqrt(2) at the band
    spread = np.sqrt(np.log(2.0)) / (2.0 * np.pi * band_hz * dt)
    return np.asarray(gaussian_filter1d(given, spread, mode="nearest", truncate=6.0))


def _rate_limited(command: Array, largest_rate: float | None, dt: float) -> Array:
    if largest_rate is None:
        return command
    if not largest_rate > 0.0:
        raise ModelError(f"the largest rate must be positive, got {largest_rate!r}")
    step = largest_rate * dt
    if np.max(np.abs(np.diff(command)), initial=0.0) <= step:
        return command
    made = command.copy()
    for k in range(1, made.size):
        made[k] = min(max(command[k], made[k - 1] - step), made[k - 1] + step)
    return made
