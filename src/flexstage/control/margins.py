"""Margins of a sampled position control: gain, phase, sensitivity, bandwidth."""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.arrays import Array, Complex
from flexstage.control.loop_plant import LoopPlant
from flexstage.instruments.servo import ServoSettings

#: Frequencies at which a loop is looked at: over this part of half the rate, and this many.
_LOWEST = 1e-5
_POINTS = 1500
#: About every mode and notch, this many more, over this many half widths.
_NEAR, _WIDTHS = 300, 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """How far a loop is from swinging by itself."""

    stable: bool
    """Whether it is stable at all."""
    gain_margin: float
    """Factor by which the gain may still rise [1]; infinite where nothing limits it."""
    phase_margin: float
    """Phase that may still be lost [rad]; infinite where the gain is below one throughout."""
    sensitivity_peak: float
    """Largest of the sensitivity ``1/|1 + L|`` [1], Ms."""
    complementary_peak: float
    """Largest of ``|L/(1 + L)|`` [1], Mt."""
    crossover_hz: float
    """Lowest frequency at which the gain of the loop is one [Hz]."""
    bandwidth_hz: float
    """Frequency up to which errors are at least halved in power, ``|S| < 0.71`` [Hz]."""


def loop_frequencies(plant: LoopPlant, settings: ServoSettings | None = None) -> Array:
    """Return frequencies up to half the rate, dense about modes and notches, to look at a loop."""
    half = 0.5 * plant.sample_rate_hz
    parts = [np.geomspace(_LOWEST * half, half, _POINTS)]
    peaks: list[tuple[float, float]] = []
    if plant.modes is not None:
        peaks += list(zip(plant.modes.frequency_hz, plant.modes.damping_ratio, strict=True))
    if settings is not None:
        peaks += [(n.frequency_hz, min(n.pole_damping, 0.05)) for n in settings.notches]
    for f, zeta in peaks:
        if f < half:
            reach = min(_WIDTHS * max(zeta, 1e-3), 0.9)
            s = np.sinh(np.linspace(-4.0, 4.0, _NEAR)) / np.sinh(4.0)
            parts.append(f * (1.0 + reach * s))
    every = np.unique(np.concatenate(parts))
    return every[(every > 0.0) & (every <= half)]


def loop_margins(plant: LoopPlant, settings: ServoSettings) -> Margins:
    r"""Return the margins of a loop at one gain of its plant.

    With the loop :math:`L = C P` of `ServoSettings.response` and `LoopPlant.response`, both exact
    for the sampled loop. Stability is that of the Nyquist criterion: L has one pole, that of the
    integrator, on the unit circle and none beyond it, so that the loop is stable when the curve
    does not go round -1.

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
    An integrator with a delay of d samples meets -180 degrees at ``omega T = pi / (2 d - 1)``, so
    that its gain margin is ``2 sin(pi / (4 d - 2)) / (k g T)``:

    >>> plant = LoopPlant(gain=5e-7, gain_range=(5e-7, 5e-7), delay=3e-4, sample_rate_hz=10e3)
    >>> made = loop_margins(plant, ServoSettings(integral=2e9))
    >>> round(made.gain_margin, 4), round(2.0 * math.sin(math.pi / 10.0) / 0.1, 4)
    (6.1803, 6.1803)
    """
    f = loop_frequencies(plant, settings)
    loop = settings.response(f, plant.sample_rate_hz) * plant.response(f)
    distance = np.abs(1.0 + loop)
    worst = float(distance.min())
    high = np.abs(loop) > 1.0
    halved = distance > math.sqrt(2.0)
    upto = f[-1] if halved.all() else (f[int(np.argmin(halved))] if halved[0] else 0.0)
    return Margins(
        stable=_stable(loop),
        gain_margin=_gain_margin(loop),
        phase_margin=_phase_margin(loop) if high.any() else math.inf,
        sensitivity_peak=1.0 / worst if worst > 0.0 else math.inf,
        complementary_peak=float(np.max(np.abs(loop) / np.maximum(distance, 1e-300))),
        crossover_hz=_first_fall(f, np.abs(loop)),
        bandwidth_hz=float(upto),
    )


def _first_fall(f: Array, size: Array) -> float:
    """Return the frequency at which the gain first falls through one, 0 where it starts below."""
    below = np.flatnonzero(size < 1.0)
    if below.size == 0:
        return float(f[-1])
    k = int(below[0])
    if k == 0:
        return 0.0
    a, b = np.log(size[k - 1]), np.log(size[k])
    return float(np.exp(np.interp(0.0, [b, a], [np.log(f[k]), np.log(f[k - 1])])))


def _gain_margin(loop: Complex) -> float:
    """Return the inverse of the largest distance at which the curve meets the negative axis."""
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
    return 1.0 / max(at) if at else math.inf


def _phase_margin(loop: Complex) -> float:
    """Return the least angle between the curve and -180 degrees where its size is one."""
    size = np.abs(loop)
    k = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0)
    if k.size == 0:
        return math.inf
    share = np.log(size[k]) / (np.log(size[k]) - np.log(size[k + 1]) + 1e-300)
    away = np.angle(-loop[k])
    turn = np.angle(loop[k + 1] / loop[k])
    return float(np.min(np.abs(away + share * turn)))


def _stable(loop: Complex) -> bool:
    """Return whether the curve from zero to half the rate leaves -1 on its left throughout.

    1 + L turns by -90 degrees on the small circle about the integrator, and by as much back on the
    curve, if none of its zeros lies outside the unit circle.
    """
    curve = 1.0 + loop
    turned = float(np.sum(np.angle(curve[1:] / curve[:-1])))
    # an integrator begins at -90 degrees, a finite gain at 0: both end at 0 or the real axis
    start = float(np.angle(curve[0]))
    return abs(turned + start) < 0.5 * math.pi
