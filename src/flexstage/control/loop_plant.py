r"""A sampled position control: its plant for small motions, and the margins of its loop.

The plant is a drive linearised about a point of the loop of its hysteresis.

The voltage of a sampled controller is constant from one sample to the next. For the continuous
part :math:`G(s)` (modes, lag, at unit static gain) and a delay :math:`\tau`, the readings are

.. math:: P(z) = g\,(1 - z^{-1}) \sum_{k \ge 0} s(kT - \tau)\, z^{-k}

with the step response s in closed form from the poles of G. So there is no error of discretisation,
and a delay may be any fraction of a sample (E. I. Jury's modified z transform).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.hysteresis import DriveModel, StageModes
from flexstage.stage import Axis, PiezoStack, Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.servo import ServoSettings


@dataclass(frozen=True, slots=True)
class _Grid:
    """Sampling of a loop in frequency, and of the hysteresis in it."""

    lowest: float = 1e-5
    """Lowest frequency, over half the rate."""
    points: int = 1500
    """Number of frequencies from there to half the rate."""
    near: int = 300
    """Number of additional frequencies about every mode and notch, ..."""
    widths: float = 12.0
    """... over this many half widths."""
    steps: int = 200
    """Steps over the range for the slope of a hysteresis."""
    cycles: int = 3
    """Conditioning cycles before the slope is computed."""


_GRID = _Grid()
#: Poles closer together than this fraction of their size count as double, and are moved apart.
_APART = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopPlant:
    """A drive and its stage for small motions, as a sampled control sees them.

    Validity: small motion about one point of the hysteresis loop, whose slope is within
    `gain_range`; creep, which adds a few per cent at low frequency, is neglected.

    Examples
    --------
    >>> plant = LoopPlant(gain=5e-7, gain_range=(4e-7, 6e-7), delay=2e-4, sample_rate_hz=10e3)
    >>> print(f"{plant.response([0.0])[0].real:.2g} m/V")
    5e-07 m/V
    """

    gain: float
    """Static gain, reading over voltage [m/V], positive."""
    gain_range: tuple[float, float]
    """Smallest and largest slope of the hysteresis loop [m/V]."""
    modes: StageModes | None = None
    """Modes of the stage; None for none."""
    time_constant: float = 0.0
    """First-order lag, such as that of an amplifier [s]."""
    delay: float = 0.0
    """Time from the sample at which a voltage is computed to the first sample that it affects [s],
    without the zero-order hold, which is added exactly.
    """
    sample_rate_hz: float = 10e3
    """Rate of the loop [Hz]."""
    blocked_force: float = 0.0
    """Force of the stack with both ends held, over voltage [N/V]; 0 without a force sensor."""
    force_share: tuple[float, ...] = ()
    """Share of it that the elongation in each mode takes away at rest [1]."""

    def __post_init__(self) -> None:
        low, high = self.gain_range
        if not 0.0 < low <= self.gain <= high < math.inf:
            raise ModelError(
                "the gain of a plant must be positive and within its range, got "
                f"{self.gain!r} in {self.gain_range!r} m/V"
            )
        if not (0.0 <= self.delay < math.inf and 0.0 <= self.time_constant < math.inf):
            raise ModelError(
                "delay and time constant of a plant must be 0 or more and finite, got "
                f"{self.delay!r} and {self.time_constant!r} s"
            )
        if not 0.0 < self.sample_rate_hz < math.inf:
            raise ModelError(f"the rate of a loop must be positive, got {self.sample_rate_hz!r} Hz")

    def response(self, frequency_hz: ArrayLike) -> Complex:
        """Return the frequency response from the voltages of the controller to the readings."""
        step = 1.0 / self.sample_rate_hz
        z1 = np.exp(-2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * step)
        whole_samples = math.ceil(self.delay / step - 1e-9)
        within = max(whole_samples * step - self.delay, 0.0)
        poles, residues = step_response(self.modes, self.time_constant)
        total = np.ones_like(z1)
        for p, c in zip(poles, residues, strict=True):
            total += (1.0 - z1) * c * np.exp(p * within) / (1.0 - np.exp(p * step) * z1)
        return np.asarray(self.gain * z1**whole_samples * total, dtype=np.complex128)

    def force_response(self, frequency_hz: ArrayLike) -> Complex:
        r"""Return the frequency response from voltage to compression of the stack [N/V].

        .. math:: f/u = b\,\Bigl(1 - \sum_i a_i \frac{\omega_i^2}
                  {s^2 + 2\zeta_i\omega_i s + \omega_i^2}\Bigr)

        with the blocked force b and shares :math:`a_i`, sampled as the reading is.
        """
        step, share = 1.0 / self.sample_rate_hz, math.fsum(self.force_share)
        whole_samples = math.ceil(self.delay / step - 1e-9)
        f = np.asarray(frequency_hz, dtype=np.float64)
        force = np.exp(-2j * np.pi * f * step * whole_samples)
        if self.modes is not None and share:
            modes = replace(self.modes, share=[a / share for a in self.force_share])
            relief = replace(self, gain=share, gain_range=(share, share), modes=modes)
            force -= relief.response(f)
        return np.asarray(self.blocked_force * force, dtype=np.complex128)

    def scattered(self, gain: float, frequency: float) -> "LoopPlant":
        """Return the plant with other gains and frequencies."""
        modes = self.modes
        if modes is not None:
            modes = replace(modes, frequency_hz=[frequency * f for f in modes.frequency_hz])
        scaled = gain * self.gain
        return replace(self, gain=scaled, gain_range=(scaled, scaled), modes=modes)


def step_response(modes: StageModes | None, time_constant: float) -> tuple[Complex, Complex]:
    """Return poles and amplitudes of the step response, ``1 + sum c exp(p t)``."""
    poles: list[complex] = []
    residues: list[complex] = []
    pairs: list[tuple[complex, complex, float, float]] = []
    if modes is not None:
        rows = zip(modes.omega.tolist(), modes.damping_ratio, modes.share, strict=True)
        for w, zeta, share in rows:
            root = w * np.emath.sqrt(zeta * zeta - 1.0 + 0j)
            if abs(root) < _APART * w:
                root = _APART * w
            pairs.append((-zeta * w + root, -zeta * w - root, w, share))
    lag_pole = -1.0 / time_constant if time_constant > 0.0 else None
    for p, q, w, share in pairs:
        for one, other in ((p, q), (q, p)):
            c = share * w * w / (one - other) / one
            if lag_pole is not None:
                c /= 1.0 - one / lag_pole
            poles.append(one)
            residues.append(c)
    if lag_pole is not None:
        at = 1.0 if modes is None else modes.static_share + sum(
            share * w * w / ((lag_pole - p) * (lag_pole - q)) for p, q, w, share in pairs
        )  # fmt: skip
        poles.append(lag_pole)
        residues.append(-at)
    return np.array(poles, dtype=np.complex128), np.array(residues, dtype=np.complex128)


def local_gains(model: DriveModel) -> tuple[float, float, float]:
    """Return mean, smallest and largest slope of the loop of a drive [unit of output over input].

    The loop runs over the entire range. The smallest slope is that after a reversal, where a
    control works that holds a position.
    """
    if model.validity is None:
        raise ModelError("the slope of a drive needs its range: give the model a validity")
    low, high = model.validity.input_range
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    line = middle + half * np.linspace(-1.0, 1.0, _GRID.steps + 1)
    cycle = np.concatenate((line[:-1], line[::-1][:-1]))
    u = np.concatenate((np.tile(cycle, _GRID.cycles), line[:1]))
    y = model.hysteresis.simulate(u, model.conditioned()).values
    late = slice(-cycle.size - 1, None)
    slope = np.diff(y[late]) / np.diff(u[late])
    if not slope.min() > 0.0:
        raise ModelError(
            f"the slope of the model is {slope.min():.3g} at some point of its loop: a control "
            "needs a slope above zero; identify another model"
        )
    # the reversals themselves, finer than a step of the loop
    tiny = 1e-4 * (high - low)
    after = []
    for end, way in ((line[-1], -1.0), (line[0], 1.0)):
        state = model.hysteresis.simulate(np.append(u, end)).state
        before = float(model.hysteresis.simulate([end], state).values[0])
        after.append(
            abs(float(model.hysteresis.simulate([end + way * tiny], state).values[0]) - before)
            / tiny
        )
    least = min(float(slope.min()), *(a for a in after if a > 0.0))
    mean = float((y[late].max() - y[late].min()) / (2.0 * half))
    return mean, min(least, mean), max(float(slope.max()), mean)


def loop_plant(
    model: DriveModel,
    sample_rate_hz: float,
    *,
    delay: float | None = None,
) -> LoopPlant:
    """Return the plant of an identified drive: voltage [V] to reading [m], rising.

    The delay is that from a computed voltage to the reading that the control uses [s], without the
    zero-order hold. By default it is that of the model, less the half sample of mean delay by the
    hold, which is added exactly, plus one sample for the conversion of the reading. Creep raises
    the largest gain by its increase within a tenth of a second.
    """
    if model.sign < 0.0:
        raise ModelError(
            "the reading falls as the voltage rises: reverse the sign of the reading, or of the "
            "voltage, before the loop is closed"
        )
    mean, least, largest = local_gains(model)
    if model.creep is not None:
        largest *= float(abs(model.creep.frequency_response([10.0])[0]))
    lag = model.lag
    model_delay = 0.0 if lag is None else lag.delay
    if delay is None:
        delay = max(model_delay - 0.5 / sample_rate_hz, 0.0) + 1.0 / sample_rate_hz
    return LoopPlant(
        gain=mean,
        gain_range=(least, largest),
        modes=model.modes,
        time_constant=0.0 if lag is None else lag.time_constant,
        delay=delay,
        sample_rate_hz=float(sample_rate_hz),
    )


def controlled_axis(stage: Stage, name: str | None = None) -> Axis:
    """Return an axis of a stage, by default the first."""
    if not stage.axes:
        raise ModelError(f"stage '{stage.name}' has no axis to control: add one")
    return stage.axis(name or stage.axes[0].name)


def blocked_force(stage: Stage, system: MechanicalSystem, drive: str) -> float:
    """Return the force of a stack with both ends held, for one volt [N/V]."""
    described, port = stage.drive(drive), system.drive(drive)
    if not isinstance(described, PiezoStack) or described.voltage_range is None:
        raise ModelError(
            f"drive '{drive}' is a {described.kind} without a voltage range: only a piezo stack "
            "with one has noise of a voltage or a position control here"
        )
    low, high = described.voltage_range
    if port.stroke is None or not port.stiffness:
        raise ModelError(f"drive '{drive}' needs a stiffness and a free stroke: add them")
    return port.stiffness * port.stroke / (high - low)


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Stability margins of a loop."""

    stable: bool
    """Whether the loop is stable."""
    gain_margin: float
    """Gain margin [1]; infinite where the phase does not cross -180 degrees."""
    phase_margin: float
    """Phase margin [rad]; infinite where the gain is below one at all frequencies."""
    sensitivity_peak: float
    """Peak Ms of the sensitivity ``1/|1 + L|`` [1]."""
    crossover_hz: float
    """Lowest frequency at which the gain of the loop is one [Hz]."""
    bandwidth_hz: float
    """Bandwidth, the frequency up to which errors are halved in power, ``|S| < 0.71`` [Hz]."""


_M = TypeVar("_M", bound=Margins)


def worst_of(margins: Iterable[_M]) -> _M:
    """Return the worst of each margin over loops; bandwidth and crossover are the lowest."""
    every = list(margins)
    least: dict[str, Any] = {
        f.name: min(getattr(m, f.name) for m in every) for f in fields(every[0])
    }
    least["sensitivity_peak"] = max(m.sensitivity_peak for m in every)
    return replace(every[0], **least)


def loop_frequencies(plant: LoopPlant, settings: ServoSettings | None = None) -> Array:
    """Return frequencies of a loop up to half the rate, dense about modes and notches."""
    half = 0.5 * plant.sample_rate_hz
    parts = [np.geomspace(_GRID.lowest * half, half, _GRID.points)]
    peaks: list[tuple[float, float]] = []
    if plant.modes is not None:
        peaks += list(zip(plant.modes.frequency_hz, plant.modes.damping_ratio, strict=True))
    if settings is not None:
        peaks += [(n.frequency_hz, min(n.pole_damping, 0.05)) for n in settings.notches]
    for f, zeta in peaks:
        if f < half:
            reach = min(_GRID.widths * max(zeta, 1e-3), 0.9)
            s = np.sinh(np.linspace(-4.0, 4.0, _GRID.near)) / np.sinh(4.0)
            parts.append(f * (1.0 + reach * s))
    every = np.unique(np.concatenate(parts))
    return every[(every > 0.0) & (every <= half)]


def loop_margins(plant: LoopPlant, settings: ServoSettings) -> Margins:
    r"""Return the margins of a loop at one gain of its plant.

    With the loop :math:`L = C P` of `ServoSettings.response` and `LoopPlant.response`, both exact
    for the sampled loop. Stability follows from the Nyquist criterion: L has one pole, that of the
    integrator, on the unit circle and none outside it, so that the loop is stable when the curve
    does not encircle -1.

    Parameters
    ----------
    plant : LoopPlant
        The plant.
    settings : ServoSettings
        The controller.

    Returns
    -------
    Margins
        The margins.

    Examples
    --------
    An integrator with a delay of d samples reaches -180 degrees at ``omega T = pi / (2 d - 1)``, so
    that its gain margin is ``2 sin(pi / (4 d - 2)) / (k g T)``:

    >>> plant = LoopPlant(gain=5e-7, gain_range=(5e-7, 5e-7), delay=3e-4, sample_rate_hz=10e3)
    >>> margins = loop_margins(plant, ServoSettings(integral=2e9))
    >>> round(margins.gain_margin, 4), round(2.0 * math.sin(math.pi / 10.0) / 0.1, 4)
    (6.1803, 6.1803)
    """
    f = loop_frequencies(plant, settings)
    return margins_of(f, settings.response(f, plant.sample_rate_hz) * plant.response(f))


def margins_of(
    f: Array, loop: Complex, lag: float = 0.5 * math.pi, inner: Complex | float = 0.0
) -> Margins:
    """Return the margins of a loop at dense frequencies [Hz], that is stable without feedback.

    `lag` is that of its integrals [rad]. `inner` is the part of the loop by another sensor than
    that of the position: the sensitivity is then the larger of those to errors of the voltage and
    of the reading; crossover and bandwidth are those of the reading, with the inner loop closed.
    """
    distance = np.abs(1.0 + loop) / np.abs(1.0 + inner)
    worst = min(float(distance.min()), float(np.abs(1.0 + loop).min()))
    high = np.abs(loop) > 1.0
    halved = distance > math.sqrt(2.0)
    upto = f[-1] if halved.all() else (f[int(np.argmin(halved))] if halved[0] else 0.0)
    return Margins(
        stable=is_stable(loop, lag),
        gain_margin=gain_margin(loop),
        phase_margin=_phase_margin(loop) if high.any() else math.inf,
        sensitivity_peak=1.0 / worst if worst > 0.0 else math.inf,
        crossover_hz=_first_fall(f, np.abs((loop - inner) / (1.0 + inner))),
        bandwidth_hz=float(upto),
    )


def _first_fall(f: Array, size: Array) -> float:
    """Return the frequency at which the gain first falls below one, 0 where it starts below."""
    below = np.flatnonzero(size < 1.0)
    if below.size == 0:
        return float(f[-1])
    k = int(below[0])
    if k == 0:
        return 0.0
    a, b = np.log(size[k - 1]), np.log(size[k])
    return float(np.exp(np.interp(0.0, [b, a], [np.log(f[k]), np.log(f[k - 1])])))


def gain_margin(loop: Complex) -> float:
    """Return the inverse of the largest distance at which the curve crosses the negative axis."""
    at = negative_crossings(loop)
    return 1.0 / max(at) if at else math.inf


def negative_crossings(loop: Complex) -> list[float]:
    """Return the distances at which the curve crosses the negative axis."""
    at: list[float] = []
    im, re = loop.imag, loop.real
    turns = np.flatnonzero((im[:-1] * im[1:] < 0.0) & (np.minimum(re[:-1], re[1:]) < 0.0))
    for k in turns.tolist():
        share = im[k] / (im[k] - im[k + 1])
        crossing = re[k] + share * (re[k + 1] - re[k])
        if crossing < 0.0:
            at.append(-float(crossing))
    if abs(loop[-1].imag) < 1e-9 * abs(loop[-1]) and loop[-1].real < 0.0:
        at.append(-float(loop[-1].real))
    return at


def _phase_margin(loop: Complex) -> float:
    """Return the smallest angle between the curve and -180 degrees where its magnitude is one."""
    size = np.abs(loop)
    k = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0)
    if k.size == 0:
        return math.inf
    share = np.log(size[k]) / (np.log(size[k]) - np.log(size[k + 1]) + 1e-300)
    away = np.angle(-loop[k])
    turn = np.angle(loop[k + 1] / loop[k])
    return float(np.min(np.abs(away + share * turn)))


def is_stable(loop: Complex, lag: float = 0.5 * math.pi) -> bool:
    """Return whether -1 is always to the left of the curve from zero to half the rate.

    1 + L turns by -90 degrees on the small circle about the integrator, and by +90 degrees on the
    curve, if none of its zeros is outside the unit circle. `lag` is that of the integrals [rad].
    """
    curve = 1.0 + loop
    turned = float(np.sum(np.angle(curve[1:] / curve[:-1])))
    # an integrator begins at -90 degrees, two at -180: all end at 0 or the real axis
    start = float(np.angle(curve[0] * np.exp(1j * lag))) - lag
    return abs(turned + start) < 0.5 * math.pi
