r"""Moves from rest to rest: input shapers, jerk-limited and minimum-time commands, settling.

A lightly damped mode rings after a move for :math:`\ln(d/b)/(\zeta\omega)`, a hundred periods and
more until a distance d has decayed to a band b. A command that leaves no energy in the mode avoids
it, as far as the frequency of the mode is known: so a settling time is stated with its scatter over
the tolerance of the modes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import LimitError, ModelError
from flexstage.control.loop_plant import LoopPlant, step_response
from flexstage.hysteresis import StageModes
from flexstage.hysteresis.requests import ModeTolerance
from flexstage.system.servo import ServoSettings

#: Residual vibration that an EI shaper allows at the frequency of its mode, over that of a step.
EI_RESIDUAL = 0.05
#: Share of the band below which a pole needs no condition in a minimum-time command.
_NEGLIGIBLE = 0.1
#: Largest number of samples of a minimum-time command.
_LONGEST = 512
#: Largest number of steps of the linear programme, which is taken to have no solution then.
_STEPS = 10_000
#: Samples between those of the loop at which the position is computed.
_FINE = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shaper:
    """Impulses whose convolution with a command leaves one mode at rest.

    Examples
    --------
    >>> zv = shaper("zv", 100.0, 0.0)
    >>> zv.times.tolist(), zv.amplitudes.tolist(), round(float(zv.residual(110.0)), 4)
    ([0.0, 0.005], [0.5, 0.5], 0.1564)
    """

    times: Array
    """Times of the impulses [s], from 0, shape (n,)."""
    amplitudes: Array
    """Amplitudes [1], positive, of sum 1, shape (n,)."""
    frequency_hz: float
    """Frequency of the mode [Hz]."""
    damping_ratio: float
    """Damping ratio of the mode [1]."""

    def residual(self, frequency_hz: ArrayLike, damping_ratio: float | None = None) -> Array:
        """Return `residual_vibration` for modes of other frequencies [Hz]."""
        zeta = self.damping_ratio if damping_ratio is None else damping_ratio
        return residual_vibration(self.times, self.amplitudes, frequency_hz, zeta)

    def taps(self, sample_rate_hz: float) -> Array:
        """Return the impulses at the samples of a command, of sum 1.

        Two samples share an impulse between them so that the sum of their motions of the mode is
        that of the impulse. Rounded times, or shares by distance, would leave per cents of the
        step: a half period has few samples.
        """
        if not self.frequency_hz < 0.5 * sample_rate_hz:
            raise ModelError(
                f"a shaper for {self.frequency_hz:.4g} Hz needs a command faster than twice that, "
                f"got {sample_rate_hz:g} Hz: shape a lower mode, or raise the rate"
            )
        pole = complex(_pole(self.frequency_hz, self.damping_ratio)) / sample_rate_hz
        at = self.times * sample_rate_hz
        first = np.floor(at + 1e-9).astype(np.intp)
        turn: Complex = np.exp(-pole * (at - first))
        sample = complex(np.exp(-pole))
        later = turn.imag / sample.imag
        taps = np.zeros(first[-1] + 2)
        np.add.at(taps, first, self.amplitudes * (turn.real - later * sample.real))
        np.add.at(taps, first + 1, self.amplitudes * later)
        taps[np.abs(taps) < 1e-12] = 0.0
        return np.trim_zeros(taps / taps.sum(), "b")


def _pole(frequency_hz: ArrayLike, damping_ratio: ArrayLike) -> Complex:
    """Return the upper pole of modes [rad/s]."""
    omega, zeta = 2.0 * np.pi * np.asarray(frequency_hz), np.asarray(damping_ratio)
    return np.asarray(omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))


def residual_vibration(
    times: Array, amplitudes: Array, frequency_hz: ArrayLike, damping_ratio: float
) -> Array:
    r"""Return the vibration after the last impulse over that of one unit impulse at its time.

    .. math:: V = \left| \sum_i A_i\, e^{\zeta\omega (t_i - t_n)} e^{j \omega_d t_i} \right|

    of N. C. Singer and W. P. Seering (J. Dyn. Syst. Meas. Control 112 (1990) 76). Without damping
    it is :math:`|\cos(\pi r / 2)|` for a ZV shaper at r times the frequency, for a ZVD its square.

    Parameters
    ----------
    times, amplitudes : ndarray
        The impulses [s, 1], shape (n,).
    frequency_hz : array_like
        Frequencies of the mode [Hz].
    damping_ratio : float
        Its damping ratio [1], below 1.

    Returns
    -------
    ndarray
        The ratio [1], of the shape of the frequencies.
    """
    poles = _pole(frequency_hz, damping_ratio)
    return np.abs(np.exp(poles[..., None] * (times[-1] - times)) @ amplitudes)


def shaper(kind: str, frequency_hz: float, damping_ratio: float) -> Shaper:
    r"""Return an input shaper for one mode.

    With :math:`K = e^{-\zeta\pi/\sqrt{1-\zeta^2}}` and the period T of the damped mode: *zv* has
    the impulses (1, K) at 0, T/2 and leaves no vibration. *zvd* has (1, 2K, K²) at 0, T/2, T: its
    vibration does not change with the frequency to first order either. *ei*, extra-insensitive,
    allows 5 % at the mode itself and none at a frequency on both sides, so that it stays below 5 %
    over 40 % of the frequency (W. E. Singhose, W. P. Seering, N. C. Singer, J. Mech. Des. 116
    (1994) 654); its conditions are solved here.

    Parameters
    ----------
    kind : {"zv", "zvd", "ei"}
        The shaper.
    frequency_hz : float
        Undamped frequency of the mode [Hz].
    damping_ratio : float
        Its damping ratio [1], from 0 to 0.3.

    Returns
    -------
    Shaper
        The impulses.

    Raises
    ------
    ModelError
        The kind does not exist, or the mode has no such shaper.

    Notes
    -----
    Validity: linear modes. Every amplitude is positive, so that a shaped command keeps the limits
    of the command in position and rate.

    Examples
    --------
    >>> ei = shaper("ei", 100.0, 0.05)
    >>> ei.amplitudes.round(5).tolist()
    [0.30676, 0.46765, 0.22559]
    """
    if kind not in ("zv", "zvd", "ei"):
        raise ModelError(f"a shaper is 'zv', 'zvd' or 'ei', got {kind!r}")
    # above 0.3 a mode decays within a period, and no command needs a shaper
    if not (0.0 < frequency_hz < math.inf and 0.0 <= damping_ratio <= 0.3):
        raise ModelError(
            "a shaper needs a mode of positive frequency and a damping ratio of 0 to 0.3, got "
            f"{frequency_hz!r} Hz and {damping_ratio!r}"
        )
    pole = _pole(frequency_hz, damping_ratio)
    period = 2.0 * math.pi / float(pole.imag)
    k = math.exp(float(pole.real) * 0.5 * period)
    impulses = {"zv": (1.0, k), "zvd": (1.0, 2.0 * k, k * k)}
    if kind == "ei":
        times, amplitudes = _extra_insensitive(damping_ratio)
        times = times / frequency_hz
    else:
        amplitudes = np.array(impulses[kind]) / sum(impulses[kind])
        times = 0.5 * period * np.arange(amplitudes.size)
    return Shaper(
        times=np.asarray(times, dtype=np.float64),
        amplitudes=np.asarray(amplitudes, dtype=np.float64),
        frequency_hz=float(frequency_hz),
        damping_ratio=float(damping_ratio),
    )


def _extra_insensitive(zeta: float) -> tuple[Array, Array]:
    """Return times, in periods of the undamped mode, and amplitudes of an EI shaper."""
    from scipy.optimize import fsolve

    v = EI_RESIDUAL
    half = 0.5 / math.sqrt(1.0 - zeta * zeta)

    def split(x: Array) -> tuple[Array, Array]:
        return np.array([0.0, x[2], x[3]]), np.array([x[0], x[1], 1.0 - x[0] - x[1]])

    def conditions(x: Array) -> Array:
        times, amplitudes = split(x)
        # no vibration at two frequencies; 5 % and no slope at the mode between them
        pole = _pole([x[4], x[5], 1.0], zeta)
        turn = np.exp(pole[:, None] * (times[-1] - times))
        low, high, middle = turn @ amplitudes
        slope = pole[2] * (turn[2] * (times[-1] - times)) @ amplitudes
        return np.array([low.real, low.imag, high.real, high.imag, abs(middle) - v,
                         (middle.conjugate() * slope).real])  # fmt: skip

    # exact without damping, whose nulls are where the cosine of the phase is -(1-v)/(1+v)
    null = math.acos(-(1.0 - v) / (1.0 + v)) / math.pi
    start = np.array([0.25 * (1.0 + v), 0.5 * (1.0 - v), half, 2.0 * half, null, 2.0 - null])
    x, _, status, message = fsolve(conditions, start, xtol=1e-13, full_output=True)
    if status != 1 and np.max(np.abs(conditions(x))) > 1e-9:
        raise ModelError(f"no EI shaper of damping ratio {zeta:g} was found: {message}")
    return split(np.asarray(x))


def convolved(shapers: Sequence[Shaper]) -> tuple[Array, Array]:
    """Return times [s] and amplitudes of shapers in series, for several modes, in order of time."""
    times, amplitudes = np.zeros(1), np.ones(1)
    for one in shapers:
        times = np.add.outer(times, one.times).ravel()
        amplitudes = np.multiply.outer(amplitudes, one.amplitudes).ravel()
    order = np.argsort(times, kind="stable")
    times, amplitudes = times[order], amplitudes[order]
    # impulses at one time are one impulse
    new = np.concatenate(([True], np.diff(times) > 1e-9 * max(times[-1], 1e-300)))
    return times[new], np.add.reduceat(amplitudes, np.flatnonzero(new))


def shaped(command: Array, shapers: Sequence[Shaper], sample_rate_hz: float) -> Array:
    """Return a command from 0, held at its last value, after shapers in series."""
    taps = (one.taps(sample_rate_hz) for one in shapers)
    rise = reduce(np.convolve, taps, np.diff(command, prepend=0.0))
    return np.cumsum(rise)


def jerk_limited(
    distance: float,
    *,
    jerk: float,
    speed: float = math.inf,
    acceleration: float = math.inf,
    sample_rate_hz: float,
) -> Array:
    r"""Return the fastest move from rest to rest within limits of speed, acceleration and jerk.

    Seven phases of constant jerk, acceleration and speed, with :math:`t_j = a/j`,
    :math:`t_a = v/a - t_j` and :math:`t_v = d/v - 2 t_j - t_a`; limits that are not reached shorten
    or remove phases. The duration is :math:`4 t_j + 2 t_a + t_v`.

    Parameters
    ----------
    distance : float
        Distance [m], positive.
    jerk, speed, acceleration : float
        Largest jerk [m/s^3], speed [m/s] and acceleration [m/s^2].
    sample_rate_hz : float
        Samples in a second [Hz].

    Returns
    -------
    ndarray
        Positions [m] from 0 to the distance, shape (n,).

    Raises
    ------
    ModelError
        A value is not positive, or the jerk or the distance is infinite.

    Examples
    --------
    >>> way = jerk_limited(10e-6, jerk=1e6, speed=5e-3, acceleration=50.0, sample_rate_hz=1e6)
    >>> way.size - 1, float(way[-1])
    (2150, 1e-05)
    """
    values = (distance, jerk, speed, acceleration, sample_rate_hz)
    if not (all(v > 0.0 for v in values) and math.isfinite(distance) and math.isfinite(jerk)):
        raise ModelError(
            "distance, jerk, speed, acceleration and rate of a move must be positive, distance and "
            f"jerk finite, got {', '.join(f'{v:g}' for v in values)}"
        )
    tj = min(acceleration / jerk, math.sqrt(speed / jerk), math.cbrt(0.5 * distance / jerk))
    peak = jerk * tj
    longest = 0.5 * (-3.0 * tj + math.sqrt(tj * tj + 4.0 * distance / peak))
    ta = max(min(speed / peak - tj, longest), 0.0)
    tv = max(distance / (peak * (tj + ta)) - (2.0 * tj + ta), 0.0)
    total = 4.0 * tj + 2.0 * ta + tv
    t = np.arange(math.ceil(total * sample_rate_hz - 1e-9) + 1) / sample_rate_hz
    # the second half is the first one reversed, so that the sums of cubes stay small
    early = np.minimum(t, np.maximum(total - t, 0.0))
    rising = 2.0 * tj + ta
    changes = ((0.0, 1.0), (tj, -1.0), (tj + ta, -1.0))
    cubes = sum(s * np.maximum(np.minimum(early, rising) - at, 0.0) ** 3 for at, s in changes)
    way = jerk / 6.0 * cubes + peak * (tj + ta) * np.maximum(early - rising, 0.0)
    return np.where(t <= 0.5 * total, way, distance - way)


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageLimits:
    """Limits of the command of a move, counted from its start."""

    low: float = -math.inf
    """Lowest voltage [V], 0 or below."""
    high: float = math.inf
    """Highest voltage [V]."""
    slew: float = math.inf
    """Largest rate of the voltage behind the amplifier [V/s], by its slew, or by its current over
    the capacitance.
    """
    acceleration: float = math.inf
    """Largest acceleration of the stage [m/s^2], by a force such as a preload; in minimum-time and
    jerk-limited moves.
    """

    def largest_lead(self, plant: LoopPlant) -> float:
        """Return by how much the command may lead the output of the amplifier [V].

        The output of a first-order amplifier of time constant T rises at that lead over T.
        """
        return self.slew * (plant.time_constant or 1.0 / plant.sample_rate_hz)


def fastest_ramp(plant: LoopPlant, distance: float, limits: VoltageLimits) -> Array:
    """Return the voltages of the fastest ramp over a distance [m], a step without limits."""
    volts, hold = distance / plant.gain, 1.0 / plant.sample_rate_hz
    share = -math.expm1(-hold / plant.time_constant) if plant.time_constant else 1.0
    # below this, the voltage behind the amplifier never rises faster than its limit
    count = max(math.ceil(volts / (limits.largest_lead(plant) * share) - 1e-9), 1)
    return volts * np.arange(1, count + 1) / count


def minimum_time(
    plant: LoopPlant,
    distance: float,
    limits: VoltageLimits,
    *,
    band: float,
    robust: bool = False,
) -> Array:
    r"""Return the shortest voltages that end a move with every mode at rest.

    The increments :math:`\Delta u_k` of the sampled voltages are the unknowns of a linear
    programme: their sum is that of the distance, :math:`\sum_k \Delta u_k e^{-p t_k} = 0` for
    every pole p that would leave more than a tenth of the band, and voltage, slew and acceleration
    keep their limits at every sample. The number of samples is the smallest for which
    a solution is found.

    Parameters
    ----------
    plant : LoopPlant
        The plant.
    distance : float
        Distance [m], positive.
    limits : VoltageLimits
        Limits of the voltages.
    band : float
        Band of settling [m].
    robust : bool
        The vibration of the first mode does not change with its frequency to first order.

    Returns
    -------
    ndarray
        Voltages from the start [V], shape (n,); the last one is held.

    Raises
    ------
    LimitError
        The voltages do not reach the distance, or no command of 512 samples keeps the limits.

    Notes
    -----
    Validity: small motion, a linear plant. The command is tuned to one frequency, so that its
    settling scatters more than that of a shaper; see `settling`.
    """
    volts = distance / plant.gain
    if not limits.low <= 0.0 < volts <= limits.high:
        raise LimitError(
            f"the move needs {volts:.4g} V, and its limits are {limits.low:.4g} to "
            f"{limits.high:.4g} V from its start: make it smaller, or start lower"
        )
    low, high = 1, 1
    while (voltages := _programme(plant, distance, limits, band, high, robust=robust)) is None:
        low, high = high + 1, 2 * high
        if high > _LONGEST:
            raise LimitError(
                f"no command of up to {_LONGEST} samples ends the vibration within the limits: "
                "allow a larger slew or acceleration, or a lower rate of the loop"
            )
    while low < high:
        middle = (low + high) // 2
        shorter = _programme(plant, distance, limits, band, middle, robust=robust)
        if shorter is None:
            low = middle + 1
        else:
            high, voltages = middle, shorter
    return voltages


def _programme(
    plant: LoopPlant,
    distance: float,
    limits: VoltageLimits,
    band: float,
    count: int,
    *,
    robust: bool,
) -> Array | None:
    """Return voltages of a number of samples, or None where the limits allow none."""
    from scipy.optimize import linprog

    step, volts = 1.0 / plant.sample_rate_hz, distance / plant.gain
    poles, residues = step_response(plant.modes, plant.time_constant)
    left = step * np.arange(count)[::-1]
    conditions = [np.ones(count)]
    for pole, residue in zip(poles, residues, strict=True):
        if pole.imag < 0.0 or abs(residue) * distance < _NEGLIGIBLE * band:
            continue
        decay = np.exp(pole * left)
        rows = [decay]
        if robust and plant.modes is not None and _is_first(pole, plant.modes):
            rows.append(abs(pole) * left * decay)
        for row in rows:
            conditions += [row.real, row.imag] if pole.imag > 0.0 else [row.real]
    equal = np.zeros(len(conditions))
    equal[0] = 1.0
    # rows of upper and lower bounds: voltage, rate behind the amplifier, acceleration
    since = np.maximum(np.subtract.outer(np.arange(count), np.arange(count)), 0)
    passed = np.tri(count)
    bounded = [(passed, limits.low / volts, limits.high / volts)]
    tau = plant.time_constant
    lead = passed * np.exp(-since * step / tau) if tau else np.eye(count)
    ahead = limits.largest_lead(plant) / volts
    bounded.append((lead, -ahead, ahead))
    if math.isfinite(limits.acceleration):
        # largest at the end of a sample, which the amplifier approaches
        later = (since + 1.0) * step
        bend = passed * ((poles**2 * residues) @ np.exp(poles[:, None, None] * later[None, :, :])
                         .reshape(poles.size, -1)).real.reshape(count, count)  # fmt: skip
        most = limits.acceleration / distance
        bounded.append((bend, -most, most))
    above = [(m, b) for m, _, b in bounded if math.isfinite(b)]
    above += [(-m, -a) for m, a, _ in bounded if math.isfinite(a)]
    # accelerations are of 1e9, voltages of 1: rows of one size, or the solver has no end
    above = [(m / size, b / size) for m, b in above if (size := np.abs(m).max())]
    solution = linprog(
        np.zeros(count),
        A_ub=np.vstack([m for m, _ in above]) if above else None,
        b_ub=np.concatenate([np.full(count, b) for _, b in above]) if above else None,
        A_eq=np.array(conditions),
        b_eq=equal,
        bounds=(None, None),
        method="highs",
        options={"maxiter": _STEPS},
    )
    if not solution.success:
        return None
    return volts * np.cumsum(solution.x)


def _is_first(pole: complex, modes: StageModes) -> bool:
    first = int(np.argmax(np.abs(modes.share)))
    return abs(abs(pole) - modes.omega[first]) < 1e-6 * abs(pole)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MoveResponse:
    """MoveResponse of a stage after a command, from its start."""

    time: Array
    """Times [s], shape (n,)."""
    position: Array
    """Positions [m], shape (n,)."""
    end: float
    """Position at which it comes to rest [m]."""

    def settling(self, band: float) -> float:
        """Return the time after which it stays within a band about its end [s]; inf for never."""
        out = np.flatnonzero(np.abs(self.position - self.end) > band)
        if out.size == 0:
            return 0.0
        k = int(out[-1])
        if k == self.time.size - 1:
            return math.inf
        a, b = np.abs(self.position[k : k + 2] - self.end)
        return float(self.time[k] + (a - band) / (a - b) * (self.time[k + 1] - self.time[k]))


class MovePlant:
    """A plant and its control, for the motion after any command.

    Every signal is the sum of its increments, which vanish after a move, so that their discrete
    Fourier transform over a time longer than the decay is exact: no step of integration, and the
    sampled responses of `LoopPlant` and `ServoSettings`.

    Parameters
    ----------
    plant
        The plant, with the delay of the loop.
    settings
        Settings of the control; None for open loop.
    reading_delay
        Part of the delay by which a reading is older than its use [s].
    seconds
        Duration of the motion [s], longer than the decay.
    """

    def __init__(
        self,
        plant: LoopPlant,
        settings: ServoSettings | None,
        *,
        reading_delay: float,
        seconds: float,
    ) -> None:
        rate = plant.sample_rate_hz
        self.gain, self.rate = plant.gain, rate
        self.size = 2 ** math.ceil(math.log2(seconds * rate))
        # under control, what corrects a drift at the end of the motion decays after it
        self._span = self.size if settings is None else 2 * self.size
        line = np.fft.rfftfreq(self._span, 1.0 / rate)
        fine = replace(plant, delay=plant.delay - reading_delay, sample_rate_hz=_FINE * rate)
        self._fine = fine.response(np.fft.rfftfreq(_FINE * self._span, 1.0 / fine.sample_rate_hz))
        self._loop = plant.response(line)
        self._late = np.exp(-2j * np.pi * line * reading_delay)
        self._control: Complex | None = None
        if settings is not None:
            self._control = np.zeros(line.size, dtype=np.complex128)
            self._control[1:] = settings.response(line[1:], rate)

    def readings(self, voltage: Array) -> Array:
        """Return the readings that the control uses, after voltages in open loop [m]."""
        rise = np.fft.irfft(self._rise(voltage) * self._loop, self._span)
        return np.cumsum(rise)[: self.size]

    def motion(
        self, voltage: Array, target: Array | None = None, drift: Array | None = None
    ) -> MoveResponse:
        """Return the motion after voltages [V], or after targets [m] with voltages added.

        Both are counted from the start and hold their last value. A drift [m] adds to the position
        of the plant; it ends with the motion.
        """
        drift = np.zeros(self.size) if drift is None else drift[: self.size]
        total = self._rise(voltage)
        end = float(voltage[-1]) * self.gain + float(drift[-1])
        if self._control is not None and target is not None:
            error = self._rise(target) - self._late * self._rise(drift)
            total = (total + self._control * error) / (1.0 + self._control * self._loop)
            # the integral term makes the reading equal to the target at rest
            total[0] = error[0] / self._loop[0]
            end = float(target[-1])
        rise = np.zeros(_FINE * self._span)
        rise[::_FINE] = np.fft.irfft(total, self._span)
        moved = np.cumsum(np.fft.irfft(np.fft.rfft(rise) * self._fine, rise.size))
        at = np.arange(_FINE * self.size) / _FINE
        drifted = np.interp(at, np.arange(drift.size), drift)
        return MoveResponse(time=at / self.rate, position=moved[: at.size] + drifted, end=end)

    def _rise(self, signal: Array) -> Complex:
        return np.fft.rfft(np.diff(signal, prepend=0.0), self._span)


def scattered_plants(
    plant: LoopPlant, tolerance: ModeTolerance
) -> Iterator[tuple[LoopPlant, float]]:
    """Yield plants that fill a tolerance evenly, and the factor of voltages added to their control.

    The slope of small motions is anywhere within the range of the plant; the voltages are those of
    an inverse with its own error. The 37 points are the same every time.
    """
    # a lattice of N. M. Korobov: each value once in every 37th part of each tolerance
    count, generators = 37, np.array([1, 16, 34, 26])
    at = (np.outer(np.arange(count), generators) % count + 0.5) / count
    low, high = plant.gain_range
    for f, zeta, error, slope in at.tolist():
        gain = (low + (high - low) * slope) / plant.gain
        scattered = plant.scattered(gain, 1.0 + tolerance.frequency * (2.0 * f - 1.0))
        if scattered.modes is not None:
            factor = 1.0 + tolerance.damping * (2.0 * zeta - 1.0)
            damping = [factor * z for z in scattered.modes.damping_ratio]
            scattered = replace(scattered, modes=replace(scattered.modes, damping_ratio=damping))
        yield scattered, (1.0 + tolerance.inverse * (2.0 * error - 1.0)) / gain


def decay_time(plant: LoopPlant, ratio: float) -> float:
    """Return the time in which the slowest mode decays by a ratio [s]."""
    poles, _ = step_response(plant.modes, plant.time_constant)
    slowest = -np.max(poles.real) if poles.size else math.inf
    return math.log(ratio) / float(slowest) if slowest > 0.0 else math.inf
