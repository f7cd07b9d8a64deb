"""An amplifier, from its command and the voltage at its output."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from flexstage.arrays import Array
from flexstage.errors import RecordError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.model import samples

#: A limit of the rate is believed where it takes this share of the misfit away.
_WORTH = 0.05
#: A bandwidth above this share of the sample rate cannot be seen.
_FASTEST = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundAmplifier:
    """An amplifier as it was identified."""

    amplifier: Amplifier
    """The amplifier; its slew limit is None where the record never reached one."""
    offset: float
    """Voltage at no command [V]."""
    bandwidth_error_hz: float
    """Standard error of the bandwidth [Hz]."""
    rms: float
    """Root mean square of what is left [V]."""
    warnings: tuple[str, ...]
    """What the record cannot tell."""


def identify_amplifier(command: ArrayLike, output: ArrayLike, dt: float) -> FoundAmplifier:
    """Identify gain, bandwidth and limit of the rate of an amplifier.

    Steps of two sizes tell all three: a small one follows the bandwidth, a large one the limit.

    Parameters
    ----------
    command : array_like
        Command [V], shape (n,).
    output : array_like
        Voltage at the output, with the stack connected [V], shape (n,).
    dt : float
        Time from one sample to the next [s].

    Returns
    -------
    FoundAmplifier
        The amplifier, exact stepping between the samples.

    Raises
    ------
    RecordError
        The sequences do not fit together, or nothing moves.

    Examples
    --------
    >>> true = Amplifier(bandwidth_hz=730.0, slew_limit=21e3, gain=12.4)
    >>> steps = np.repeat([0.0, 0.3, 0.0, 9.0, 0.0], 100)
    >>> found = identify_amplifier(steps, true.simulate(steps, 1e-4).values, 1e-4)
    >>> round(found.amplifier.bandwidth_hz), round(found.amplifier.slew_limit)
    (730, 21000)
    """
    c, v = samples(command, "command"), samples(output, "output")
    if c.shape != v.shape or c.size < 20:
        raise RecordError(
            f"command and output must be equally long, at least 20 samples, got {c.size} and "
            f"{v.size}"
        )
    if not np.ptp(c) > 0.0 or not np.ptp(v) > 0.0:
        raise RecordError("command and output must move: choose other columns")
    gain = float(np.polyfit(c, v, 1)[0])
    steepest = float(np.max(np.abs(np.diff(v)))) / dt
    free = _best(c, v, dt, gain, None)
    limited = _best(c, v, dt, gain, steepest)
    has_limit = limited.cost < (1.0 - _WORTH) * free.cost
    chosen = limited if has_limit else free
    bandwidth = float(10.0 ** chosen.x[0])
    J = chosen.jac
    variance = np.linalg.pinv(J.T @ J) * 2.0 * chosen.cost / max(c.size - J.shape[1], 1)
    error = float(np.sqrt(max(variance[0, 0], 0.0))) * np.log(10.0) * bandwidth
    warnings = []
    if bandwidth > _FASTEST * 0.9 / dt or error > 0.5 * bandwidth:
        warnings.append(
            "the bandwidth is not determined: record small steps at a higher sample rate"
        )
    if not has_limit:
        warnings.append(
            "no limit of the rate was reached: record a step over all of the range to find it"
        )
    made, offset, left = _evaluate(chosen.x, c, v, dt)
    return FoundAmplifier(
        amplifier=made,
        offset=offset,
        bandwidth_error_hz=float(error),
        rms=float(np.sqrt(np.mean(left**2))),
        warnings=tuple(warnings),
    )


def _evaluate(x: Array, c: Array, v: Array, dt: float) -> tuple[Amplifier, float, Array]:
    """Amplifier of logarithms of bandwidth and (where it is searched for) limit, and the gain."""
    amplifier = Amplifier(
        bandwidth_hz=float(10.0 ** x[0]),
        gain=float(x[1]),
        slew_limit=float(10.0 ** x[2]) if x.size > 2 else None,
    )
    left = v - amplifier.simulate(c, dt).values
    offset = float(left.mean())
    return amplifier, offset, left - offset


def _best(c: Array, v: Array, dt: float, gain: float, steepest: float | None) -> Any:
    fastest = _FASTEST / dt
    slowest = 1.0 / (c.size * dt)
    scale = float(np.ptp(v))

    def left(x: Array) -> Array:
        return _evaluate(x, c, v, dt)[2] / scale

    def start(bandwidth: float, share: float) -> Array:
        first = [np.log10(bandwidth), gain]
        return np.array(first if steepest is None else [*first, np.log10(share * steepest)])

    low = [np.log10(slowest), gain - 0.5 * abs(gain)]
    high = [np.log10(fastest), gain + 0.5 * abs(gain)]
    if steepest is not None:
        low, high = [*low, np.log10(0.01 * steepest)], [*high, np.log10(3.0 * steepest)]
    rates = np.geomspace(3.0 * slowest, 0.7 * fastest, 8)
    points = [start(float(b), s) for b in rates for s in (1.0, 0.7)]
    begin = min(points, key=lambda x: float(np.sum(left(x) ** 2)))
    return least_squares(left, begin, bounds=(low, high), diff_step=1e-6, xtol=1e-12, ftol=1e-14)
