r"""Dynamic error budget: from the spectra of disturbances to the rms at a point of interest.

The loop of one axis reads y and commands the voltage u. With the response of the open stage to a
disturbance d, :math:`y_d`, the sampled controller C, the sampled plant P, and the hold with its
delay H, every response z becomes, below half the rate of the loop,

.. math:: z = z_d - z_u H \frac{C}{1 + C P} (y_d + n)

with the noise n of the sensor. Variances of independent sources add.

An inner loop by the force f of the stack adds its feedback of :math:`f_d`, and that of the sampled
force to :math:`C P`.

Validity: linear about one position, stationary, sources independent; sensor and drives stand on the
base, which is rigid; one axis under control, its drive with the mean gain of its stroke, without
hysteresis and creep; amplifier and sensor without a lag other than the delay of the loop. Above
half the rate of the loop the stage is open: what a sampled loop folds to lower frequencies is
neglected. C and P are exact for the sampled loop, H is that of the band below half the rate.
"""

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.control.design import tune_plant
from flexstage.control.loop_plant import (
    LoopPlant,
    Margins,
    blocked_force,
    controlled_axis,
    loop_frequencies,
    margins_of,
)
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.hysteresis import StageModes
from flexstage.measure.uncertainty.propagate import Influence, Propagated, propagate
from flexstage.quantities.quantity import display
from flexstage.stage import Stage
from flexstage.system.environment import (
    DriveVoltage,
    Environment,
    GroundMotion,
    NoiseSource,
    Point,
    PositionLoop,
    SensorNoise,
    crossover_of,
    integral_loop,
    read_loop,
)
from flexstage.system.figure_source import Key
from flexstage.system.mechanical import (
    Damping,
    DrivePort,
    GroundDirection,
    LossFactor,
    MechanicalSystem,
    ModalDamping,
    RayleighDamping,
)
from flexstage.system.modes import Modes, modes
from flexstage.system.response import modal_response
from flexstage.system.servo import ServoSettings
from flexstage.system.statics import analyse_axis, static_loads
from flexstage.system.thermal import has_bench, thermal_drift, why_no_drift

#: Name of the stage without control.
OPEN = "open"
#: Name of the rms of a point by the unit of its probe.
_RMS = {"m": "rms_displacement", "rad": "rms_rotation"}
#: Lines of a band, and about each mode over so many half widths.
_LINES, _NEAR, _WIDTHS = 1500, 300, 12.0
#: Largest change of the logarithm of the total from line to line, and rounds to reach it.
_CHANGE, _ROUNDS = 0.1, 12
#: Smallest relative distance of two lines [1].
_APART = 1e-7
#: Relative step of a derivative by a parameter [1].
_STEP = 0.01
#: Number of lines of the cumulative amplitudes in the plain data.
_PRINTED = 120


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SourceBudget:
    """Motion of a point by one source."""

    name: str
    """Name of the source."""
    kind: str
    """Where it acts: ground, force, voltage or sensor."""
    density: Array
    """One-sided power spectral density [unit^2/Hz], shape (k,)."""
    lines: tuple[tuple[float, float], ...]
    """Frequency [Hz] and variance [unit^2] of each line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointBudget:
    """Budget of one point of interest with one loop."""

    loop: str
    """Name of the loop."""
    point: str
    """Name of the point."""
    unit: str
    """Unit of the motion."""
    frequency_hz: Array
    """Lines [Hz], shape (k,)."""
    sources: tuple[SourceBudget, ...]
    """Motion by source."""
    margins: Margins | None
    """Margins of the loop; None without one."""
    levers: dict[str, float]
    """Change of the total in per cent for one per cent of damping, stiffness of the stage and gain
    of the loop [1].
    """
    tree: Propagated | None = None
    """Static errors and the rms together, with the origin of each; None without static errors."""

    def cumulative(self, source: SourceBudget, weight: Array | None = None) -> Array:
        r"""Return the variance up to each line, :math:`\int_{f_1}^{f} w S\,df` [unit^2]."""
        f = self.frequency_hz
        w = np.ones_like(f) if weight is None else weight
        steps = 0.5 * np.diff(f) * ((w * source.density)[1:] + (w * source.density)[:-1])
        total = np.concatenate(([0.0], np.cumsum(steps)))
        for at, variance in source.lines:
            total += np.where(f >= at, variance * np.interp(at, f, w), 0.0)
        return total

    def rms(self, source: SourceBudget, band: tuple[float, float] | None = None) -> float:
        """Return the rms by one source, over a band [Hz] or all lines [unit]."""
        variance = self.cumulative(source)
        ends = variance[[0, -1]] if band is None else np.interp(band, self.frequency_hz, variance)
        start = 0.0 if band is None else ends[0]
        return math.sqrt(max(float(ends[1] - start), 0.0))

    @property
    def total(self) -> float:
        """Rms of all sources together [unit]."""
        return math.sqrt(sum(self.rms(s) ** 2 for s in self.sources))

    def exposed(self, duration: float) -> tuple[float, float]:
        r"""Return the rms of the moving average and of the moving standard deviation [unit].

        The weights of the densities are :math:`\mathrm{sinc}^2(\pi f T)` and one less it (H.
        Butler, IEEE Control Systems 31 (2011) no. 5, 28, from memory), for an exposure T [s].
        """
        average = np.sinc(self.frequency_hz * duration) ** 2
        return (
            math.sqrt(sum(float(self.cumulative(s, average)[-1]) for s in self.sources)),
            math.sqrt(sum(float(self.cumulative(s, 1.0 - average)[-1]) for s in self.sources)),
        )

    def moment(self, power: int) -> float:
        r"""Return a spectral moment, :math:`\int (2\pi f)^n S\,df` [unit^2/s^n], of all sources."""
        weight = (2.0 * np.pi * self.frequency_hz) ** power
        return sum(float(self.cumulative(s, weight)[-1]) for s in self.sources)

    def peak(self, duration: float) -> float:
        r"""Return the expected largest absolute value in a duration T [unit].

        .. math:: \sigma\left(a + \frac{0.5772}{a}\right), \quad a = \sqrt{2\ln(2\nu T)}, \quad
                  \nu = \frac{1}{2\pi}\sqrt{m_2/m_0}

        with the rate :math:`\nu` of upward crossings of zero (S. O. Rice, Bell Syst. Tech. J. 24
        (1945) 46) and both signs (A. G. Davenport, Proc. Inst. Civ. Eng. 28 (1964) 187), from
        memory. Validity: a Gaussian motion of many periods; of one lightly damped mode the peaks
        come in groups, and it is up to about 10 % too high; too high for lines as well.
        """
        variance = self.moment(0)
        if not variance > 0.0:
            return 0.0
        rate = math.sqrt(self.moment(2) / variance) / (2.0 * math.pi)
        if not rate * duration > 1.0:
            raise ModelError(
                f"'{self.point}' crosses zero upward {rate:.3g} times a second, and a duration of "
                f"{duration:g} s is shorter than one period: give a longer one"
            )
        a = math.sqrt(2.0 * math.log(2.0 * rate * duration))
        return math.sqrt(variance) * (a + float(np.euler_gamma) / a)

    def spread(self, duration: float) -> float:
        r"""Return the relative standard deviation of the rms of a record of a duration T [1].

        .. math:: \frac{1}{2}\frac{\sqrt{\int S^2\,df/T}}{\int S\,df}

        Validity: Gaussian; a record of many times the decay of the modes; lines do not scatter.
        """
        variance = self.moment(0)
        density = sum(s.density for s in self.sources)
        squares = float(np.trapezoid(density**2, self.frequency_hz))
        return 0.5 * math.sqrt(squares / duration) / variance if variance > 0.0 else 0.0

    def ranking(self) -> list[tuple[str, float]]:
        """Return what to improve first: change of the total in per cent for one per cent of each.

        For the level of a source that is its share of the variance. The largest comes first.
        """
        variance = self.total**2
        by = [(s.name, self.rms(s) ** 2 / variance if variance else 0.0) for s in self.sources]
        return sorted([*by, *self.levers.items()], key=lambda item: -abs(item[1]))

    @cached_property
    def bands(self) -> tuple[tuple[float, float], ...]:
        """Decades within the lines [Hz]."""
        low, high = float(self.frequency_hz[0]), float(self.frequency_hz[-1])
        first, last = math.floor(math.log10(low)) + 1, math.ceil(math.log10(high))
        ends = [low, *(10.0**k for k in range(first, last) if low < 10.0**k < high), high]
        return tuple(itertools.pairwise(ends))


@dataclass(frozen=True, slots=True, kw_only=True)
class RequiredBandwidth:
    """Smallest bandwidth of a kind of loop for an rms, by the gain of a loop."""

    loop: str
    """Loop whose gain is varied."""
    point: str
    """Name of the point."""
    rms: float
    """Required rms [m]."""
    bandwidth_hz: float | None
    """Smallest crossover that reaches it [Hz], 0 without control; None where none does. Where the
    smallest gain tried does, as with an inner loop alone, it is that of this gain.
    """
    least: float
    """Least rms that the loop reaches [m]."""
    least_bandwidth_hz: float
    """Crossover there [Hz], 0 without control."""
    sentence: str
    """What forbids a smaller rms."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DynamicBudget(Result):
    """Dynamic error budget of a stage, with every loop and at every point of interest."""

    table_key: ClassVar[str] = "rms"

    stage: str
    """Name of the stage."""
    model: str
    """Model of the stage."""
    axis: str
    """Axis under control."""
    environment: Environment
    """The environment."""
    budgets: tuple[PointBudget, ...]
    """Budget of each loop at each point."""
    exposure: float | None
    """Exposure [s]."""
    duration: float | None
    """Duration of a record [s]."""
    required: RequiredBandwidth | None
    """Required bandwidth."""
    notes: tuple[str, ...]
    """Limits of validity, and choices."""

    def budget(self, loop: str = "", point: str = "") -> PointBudget:
        """Return the budget of a loop at a point; by default the last loop at the first point."""
        point = point or self.budgets[0].point
        for one in reversed(self.budgets):
            if one.point == point and loop in ("", one.loop):
                return one
        known = ", ".join(f"'{b.loop}' at '{b.point}'" for b in self.budgets)
        raise ModelError(f"there is no budget of '{loop}' at '{point}': there are {known}")

    def data(self) -> dict[str, Any]:
        rows = [
            {
                "loop": b.loop, "point": b.point, "source": s.name, "acts": s.kind,
                "rms": b.rms(s), "unit": b.unit,
            }
            for b in self.budgets for s in b.sources
        ]  # fmt: skip
        return {
            **picked(self, "stage", "model", "axis", "environment=environment.name"),
            "band_hz": list(self.environment.band),
            "rms": rows,
            "totals": [self._total_data(b) for b in self.budgets],
            **({} if self.required is None else {"required": plain(self.required)}),
            "notes": list(self.notes),
        }

    def _total_data(self, b: PointBudget) -> dict[str, Any]:
        f = b.frequency_hz
        printed = np.unique(np.linspace(0, f.size - 1, _PRINTED).astype(np.intp))
        exposed = {}
        if self.exposure is not None:
            average, deviation = b.exposed(self.exposure)
            exposed = {"exposure": self.exposure, "average": average, "deviation": deviation}
        if self.duration is not None:
            exposed |= {"duration": self.duration, "peak": b.peak(self.duration)}
            exposed["rms_spread"] = b.spread(self.duration)
        tree = {}
        if b.tree is not None:
            names = ("name", "source", "distribution", "uncertainty", "share")
            lines = [picked(line, *names) for line in b.tree.lines]
            tree = {"tree": {"uncertainty": b.tree.uncertainty, "lines": lines}}
        return {
            **picked(b, "loop", "point", "unit", "rms=total"),
            **tree,
            "margins": plain(b.margins),
            **exposed,
            "bands": [
                {s.name: b.rms(s, band) for s in b.sources} | {"band_hz": list(band)}
                for band in b.bands
            ],
            "ranking": [{"lever": name, "percent": change} for name, change in b.ranking()],
            "cumulative": {
                "frequency_hz": plain(f[printed]),
                "amplitude": {s.name: plain(np.sqrt(b.cumulative(s)[printed])) for s in b.sources},
            },
        }


def dynamic_budget(
    stage: Stage,
    system: MechanicalSystem,
    environment: Environment,
    loops: Sequence[str | PositionLoop] = (),
    *,
    axis: str | None = None,
    exposure: float | None = None,
    duration: float | None = None,
    wanted_rms: float | None = None,
) -> DynamicBudget:
    r"""Return the dynamic error budget of a stage, its drives in place.

    Parameters
    ----------
    stage : Stage
        The stage, for the voltages of its drives.
    system : MechanicalSystem
        Its model.
    environment : Environment
        Its disturbances and points of interest.
    loops : sequence of str or PositionLoop
        Loops to compare with the open stage, which comes first: a crossover such as ``100 Hz`` of
        integral control with a notch at the mode that the drive excites most; ``tune`` for the
        settings of `tune_plant`; the file of a loop; or a `PositionLoop`.
    axis : str, optional
        The axis under control (default: the first).
    exposure : float, optional
        Exposure for moving average and moving standard deviation [s].
    duration : float, optional
        Duration of a record, for its largest value and the scatter of its rms [s].
    wanted_rms : float, optional
        Rms at the first point for which the last loop needs a bandwidth [m].

    Returns
    -------
    DynamicBudget
        The budget.

    Raises
    ------
    ModelError
        A body, drive or probe does not exist, a drive has no voltage, a mode has no damping, a loop
        is unstable, or two loops have one name.

    Notes
    -----
    Validity: see the module. The base of the stage is rigid and moves with the ground.
    """
    setup = _open_setup(stage, system, environment, axis)
    controlled = stage.axis(setup.axis)
    unit = stage.probe(controlled.probe).unit
    for source in environment.sources:
        if isinstance(source, SensorNoise) and source.spectrum.unit != unit:
            raise ModelError(
                f"source '{source.name}' is noise in {source.spectrum.unit}, but the sensor of "
                f"axis '{controlled.name}' reads {unit}: convert it"
            )
    closed = [replace(setup, loop=_loop_of(loop, setup)) for loop in loops]
    names = [OPEN, *(one.loop.name for one in closed if one.loop is not None)]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ModelError(f"two loops are named '{twice}', the stage without one '{OPEN}': rename")
    if wanted_rms is not None and not closed:
        raise ModelError(
            "a required rms needs a loop, whose gain is varied: name one, such as 50 Hz"
        )
    budgets = [
        replace(budget, tree=error_tree(one, budget))
        for one in (setup, *closed) for budget in _budgets(one)
    ]  # fmt: skip
    return DynamicBudget(
        stage=stage.name,
        model=system.model,
        axis=controlled.name,
        environment=environment,
        budgets=tuple(budgets),
        exposure=exposure,
        duration=duration,
        required=None if wanted_rms is None else required_bandwidth(closed[-1], wanted_rms),
        notes=_notes(setup),
    )


def error_tree(setup: "_Setup", budget: PointBudget) -> Propagated | None:
    r"""Return static errors of a point and its rms, combined; None without static errors.

    .. math:: u^2 = \sum_i u_i^2, \qquad u_i = a_i/\sqrt 3

    of independent errors whose range has the half-width :math:`a_i` (JCGM 100:2008, 4.3.7 and
    5.1.2), with the rms as a standard uncertainty. Over a travel L, with a rotation :math:`\psi`:
    Abbe :math:`d\psi/2`, cosine :math:`L(1 - \cos\alpha)`, sensor :math:`nL` and, of its mount,
    :math:`\alpha_h l\,\Delta T`; creep and hysteresis are shares of L.

    Validity: independent errors, first order. At the probe of its axis control removes creep,
    hysteresis and the drift of the stage, and brings in the errors of its sensor, other than noise
    and steps. A travel below the stroke reduces all motion of the axis in proportion.
    """
    static = setup.environment.static
    if static is None:
        return None
    probe = next(p.probe for p in setup.points if p.name == budget.point)
    port = setup.system.probe(probe)
    ports = [a for a in setup.system.axes if a.probe == probe]
    ports += [a for a in setup.system.axes if a.name == setup.axis]
    axis = ports[0]
    moved = analyse_axis(setup.system, axis)
    stroke = abs(moved.static.readings[axis.probe])
    in_metres = setup.system.probe(axis.probe).unit == "m"
    share = 1.0 if static.travel is None or not in_metres else static.travel / stroke
    travel = share * abs(moved.static.readings[probe])
    over = f"of {1e6 * travel:.4g} u{port.unit} travel"
    sensor, errors = static.sensor, []

    def add(name: str, described: float, factor: float, source: str) -> None:
        """Add an error that is described, even where the stage makes nothing of it."""
        if described:
            width = abs(described * factor)
            errors.append(
                Influence(name=name, value=0.0, half_width=width, unit=port.unit, source=source)
            )

    change = f"temperature {static.temperature:g} K"
    if setup.loop is None or axis.name != setup.axis:
        if static.temperature:
            rate, model = _drift_rate(setup, probe)
            add("thermal drift", static.temperature, rate, f"{change}; {model}")
        add("creep", static.creep, travel, f"creep {100.0 * static.creep:g} % {over}")
        add("hysteresis", static.hysteresis, travel, f"{100.0 * static.hysteresis:g} % {over}")
    elif sensor is not None:
        scale = f"sensor, nonlinearity {100.0 * sensor.nonlinearity:g} % {over}"
        add("nonlinearity", sensor.nonlinearity, travel, scale)
        if port.unit == "m":
            mount = sensor.expansion * sensor.length_of_loop
            add(
                "sensor mount",
                mount,
                static.temperature,
                f"{change}, sensor, expansion and length_of_loop",
            )
        for name, key, size in (
            ("calibration", "calibration", sensor.calibration),
            # of a normal angle
            ("cosine", "alignment", -math.expm1(-(sensor.alignment**2)) / math.sqrt(2.0)),
        ):
            if size:
                source = f"sensor, {key} {getattr(sensor, key):g} {over}"
                errors.append(
                    Influence(
                        name=name, value=0.0, uncertainty=size * travel, unit=port.unit,
                        source=source,
                    )
                )  # fmt: skip
    if sensor is not None and port.unit == "m":
        turn = moved.static.body_motion[port.body][2] * share
        if abs(turn) < display("parasitic_rotation").zero:
            turn = 0.0
        place = f"abbe_offset {1e3 * sensor.abbe_offset:g} mm, rotation {1e6 * turn:.3g} urad"
        add("Abbe", sensor.abbe_offset, 0.5 * turn, f"{place} {over}, {setup.system.model} model")
    rms = Influence(
        name="vibration and noise", value=0.0, uncertainty=budget.total, unit=port.unit,
        source=f"environment '{setup.environment.name}'",
    )  # fmt: skip
    return propagate(lambda *parts: sum(parts), [rms, *errors], unit=port.unit)


def _drift_rate(setup: "_Setup", probe: str) -> tuple[float, str]:
    """Return the drift of a probe per kelvin [m/K, or rad/K], and the model that it is from."""
    stage, system = setup.stage, setup.system
    if has_bench(stage) and not why_no_drift(stage, system):
        return thermal_drift(stage, system).readings[probe], "stage on its bench, drives in place"
    if all(load.name != "temperature" for load in system.loads):
        raise ModelError(
            f"the {system.model} model of stage '{stage.name}' has no thermal expansion: choose "
            "--model superelement and give the material one, or omit the temperature of static"
        )
    rate = static_loads(system, {"temperature": 1.0}).readings[probe]
    return rate, f"{system.model} model, drives removed, base without expansion"


def required_bandwidth(setup: "_Setup", target: float) -> RequiredBandwidth:
    """Return the smallest bandwidth with which a loop of other gains reaches an rms [m].

    Bandwidth is the crossover of the loop, whose filters and notches stay. Gains from a thousandth
    of the largest stable one are tried on a logarithmic grid, and refined where the rms falls below
    the required one, or is least.

    Validity: the rms has no narrow dip between two gains of the grid, and the loop is stable at
    every smaller gain.
    """
    from scipy.optimize import brentq, minimize_scalar

    assert setup.loop is not None
    point = setup.points[0]
    if (unit := setup.system.probe(point.probe).unit) != "m":
        raise ModelError(f"point '{point.name}' reads {unit}, and the required rms is a distance")
    largest = math.log(0.98) + _largest_gain(setup)

    def rms(gain: float) -> float:
        return float(_totals(_scaled_gain(setup, math.exp(gain)))[0])

    def crossover(gain: float) -> float:
        return _loop_margins(_scaled_gain(setup, math.exp(gain))).crossover_hz

    opened = float(_totals(replace(setup, loop=None))[0])
    gains = np.linspace(largest - math.log(1000.0), largest, 40)
    values = np.array([rms(gain) for gain in gains.tolist()])
    k = int(np.argmin(values))
    around = gains[[max(k - 1, 0), min(k + 1, gains.size - 1)]].tolist()
    best = minimize_scalar(rms, bounds=around, method="bounded", options={"xatol": 1e-3})
    at, least = (float(best.x), float(best.fun)) if best.fun < values[k] else (gains[k], values[k])
    open_is_best = opened <= least
    bandwidth = 0.0 if opened <= target else None
    if bandwidth is None and least <= target:
        below = values <= target
        first = int(np.argmax(below))
        low, high = (gains[max(first - 1, 0)], gains[first]) if below.any() else (around[0], at)
        smallest = low if below[0] else brentq(lambda g: rms(g) - target, low, high, xtol=1e-4)
        bandwidth = crossover(float(smallest))
    reached = replace(setup, loop=None) if open_is_best else _scaled_gain(setup, math.exp(at))
    return RequiredBandwidth(
        loop=setup.loop.name,
        point=point.name,
        rms=target,
        bandwidth_hz=bandwidth,
        least=min(opened, float(least)),
        least_bandwidth_hz=0.0 if open_is_best else crossover(float(at)),
        sentence=_limit_sentence(reached, setup.plant()),
    )


def _largest_gain(setup: "_Setup") -> float:
    """Return the logarithm of the largest factor of a gain, to 100, that leaves a loop stable."""
    low, high = 0.0, math.log(100.0)
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        if _loop_margins(_scaled_gain(setup, math.exp(middle))).stable:
            low = middle
        else:
            high = middle
    return low


def _limit_sentence(setup: "_Setup", plant: LoopPlant) -> str:
    """Return what most of the variance at the first point is from, as a sentence."""
    budget = _budgets(setup)[0]
    variance = budget.total**2
    if not variance > 0.0:
        return "nothing moves the point"
    largest = max(budget.sources, key=budget.rms)
    share = budget.rms(largest) ** 2 / variance
    words = f"{100.0 * share:.0f} % of the variance is from '{largest.name}'"
    if largest.kind == "sensor":
        return f"the noise of the sensor forbids less: {words}"
    peak = _loudest_mode(plant)
    low, high = budget.frequency_hz[[0, -1]].tolist()
    ends = (max(low, 0.7 * peak), min(high, 1.4 * peak))
    if ends[0] < ends[1]:
        near = sum(budget.rms(s, ends) ** 2 for s in budget.sources) / variance
        if near > 0.5:
            return (
                f"the mode at {peak:.4g} Hz forbids less: {100.0 * near:.0f} % of the variance is "
                f"about it, and {words}"
            )
    return words


def open_rms(
    stage: Stage,
    system: MechanicalSystem,
    environment: Environment,
    keys: Collection[Key] | None = None,
) -> dict[Key, float]:
    r"""Return the rms that an environment leaves without control, its drives in place.

    .. math:: \sigma = \Bigl(\sum_d \int |H_d|^2 S_d\,df\Bigr)^{1/2}

    over the sources d, as `dynamic_budget` integrates it for the open stage.

    Parameters
    ----------
    stage : Stage
        The stage, for the voltages of its drives.
    system : MechanicalSystem
        Its model.
    environment : Environment
        Its disturbances and points of interest.
    keys : Collection of tuple, optional
        Figures as quantity and axis; all where not given.

    Returns
    -------
    dict
        By quantity, ``rms_displacement`` [m] or ``rms_rotation`` [rad], and by point of interest
        the rms; without points, by axis that of its probe against the base.

    Raises
    ------
    ModelError
        A body, drive or probe does not exist, a drive has no voltage, or a mode has no damping.

    Notes
    -----
    Validity: as `dynamic_budget`; noise of a sensor does nothing without control.
    """
    setup = _open_setup(stage, system, environment)
    each = {
        axis.name: replace(setup, points=(Point(name=axis.name, probe=axis.probe),))
        for axis in stage.axes
    }
    figures: dict[Key, float] = {}
    for one in (setup,) if environment.points else each.values():
        units = (system.probe(point.probe).unit for point in one.points)
        named = [(_RMS[u], p.name) for u, p in zip(units, one.points, strict=True)]
        if keys is None or not set(named).isdisjoint(keys):
            figures |= zip(named, _totals(one).tolist(), strict=True)
    return figures


def _open_setup(
    stage: Stage, system: MechanicalSystem, environment: Environment, axis: str | None = None
) -> "_Setup":
    """Return the setup without a loop, by default of the first axis."""
    controlled = controlled_axis(stage, axis)
    points = environment.points or (Point(name=controlled.probe, probe=controlled.probe),)
    return _Setup(stage, system, environment, controlled.name, points)


def _notes(setup: "_Setup") -> tuple[str, ...]:
    (low, high), system = setup.environment.band, setup.system
    first = modes(system, drives="in place", count=1)
    return (
        f"first mode of the {system.model} model with the drives in place: "
        f"{first.frequency_hz[0]:.4g} Hz, damping ratio {first.damping_ratio[0]:.3g}: measure it, "
        "since the rms depends on it most",
        f"linear, stationary and independent sources, from {low:g} to {high:g} Hz: without slower "
        "drift, hysteresis, creep, and what a loop folds from above half its rate",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Setup:
    """A stage in its environment, with a loop or none."""

    stage: Stage
    system: MechanicalSystem
    environment: Environment
    axis: str
    points: tuple[Point, ...]
    loop: PositionLoop | None = None

    @property
    def sensor(self) -> Array:
        """Reading of the sensor of the loop for each coordinate, shape (n,)."""
        return self.system.probe(self.stage.axis(self.axis).probe).vector

    def force_of_voltage(self, drive: str) -> Array:
        """Return the force on each coordinate for one volt of a drive [N/V], shape (n,)."""
        return blocked_force(self.stage, self.system, drive) * self.system.drive(drive).vector

    @property
    def port(self) -> DrivePort:
        """Drive of the loop."""
        return self.system.drive(self.stage.drive_of(self.axis).name)

    @property
    def force(self) -> Array:
        """Force on each coordinate for one volt of the drive of the loop [N/V], shape (n,)."""
        return self.force_of_voltage(self.port.name)

    def plant(self) -> LoopPlant:
        """Return the plant of the axis as its loop samples it, or as a new loop would."""
        every = modes(self.system, drives="in place", count=None)
        static = (self.sensor @ every.shapes) * (self.force @ every.shapes) / every.omega**2
        gain, port = float(static.sum()), self.port
        shares = (port.stiffness or 0.0) * (port.vector @ every.shapes) ** 2 / every.omega**2
        loop = self.loop or PositionLoop(name="new", settings=ServoSettings(integral=1.0))
        if not gain > 0.0:
            raise ModelError(
                f"the probe of axis '{self.axis}' falls as its voltage rises: turn the probe"
            )
        return LoopPlant(
            gain=gain,
            gain_range=(gain, gain),
            modes=StageModes(
                frequency_hz=every.frequency_hz.tolist(),
                damping_ratio=every.damping_ratio.tolist(),
                share=(static / gain).tolist(),
            ),
            delay=loop.latency,
            sample_rate_hz=loop.sample_rate,
            blocked_force=blocked_force(self.stage, self.system, port.name),
            force_share=tuple(shares.tolist()),
        )


def _loop_of(text: str | PositionLoop, setup: _Setup) -> PositionLoop:
    """Return the loop of a word, crossover or file."""
    if isinstance(text, PositionLoop):
        return text
    if text.strip() == "tune":
        return PositionLoop(name="tune", settings=tune_plant(_within(setup.plant())).settings)
    crossover = crossover_of(text)
    if crossover is None and (Path(text).is_file() or Path(text).suffix[1:].isalpha()):
        return read_loop(Path(text))
    if crossover is None or not crossover > 0.0:
        raise ModelError(
            "a loop is a crossover above 0 such as '100 Hz', tune, or the file of a loop, got "
            f"'{text[:60]}'"
        )
    plant = setup.plant()
    mode = _loudest_mode(plant)
    # a loop has no notch above half its rate
    within = mode < 0.5 * plant.sample_rate_hz
    return integral_loop(crossover, plant.gain, mode if within else None)


def _loudest_mode(plant: LoopPlant) -> float:
    """Return the frequency of the mode that the drive excites most [Hz]."""
    assert plant.modes is not None
    peak = int(np.argmax(np.abs(plant.modes.share) / np.array(plant.modes.damping_ratio)))
    return plant.modes.frequency_hz[peak]


def _within(plant: LoopPlant) -> LoopPlant:
    """Return the plant with the modes below half the rate, the others without delay."""
    assert plant.modes is not None
    every = plant.modes
    rows = [
        row
        for row in zip(every.frequency_hz, every.damping_ratio, every.share, strict=True)
        if row[0] < 0.5 * plant.sample_rate_hz
    ]
    if not rows:
        return replace(plant, modes=None)
    f, zeta, share = zip(*rows, strict=True)
    return replace(plant, modes=StageModes(frequency_hz=f, damping_ratio=zeta, share=share))


def _loop_margins(setup: _Setup) -> Margins:
    """Return the margins of a loop, with that by a force sensor inside it."""
    assert setup.loop is not None
    plant = setup.plant()
    f = loop_frequencies(plant, setup.loop.settings)
    by_reading, by_force = setup.loop.feedback(f)
    inner = 0.0 if by_force is None else by_force * plant.force_response(f)
    return margins_of(f, by_reading * plant.response(f) + inner, setup.loop.lag, inner)


def _margins(setup: _Setup) -> Margins | None:
    """Return the margins of the loop; refuse an unstable one."""
    if setup.loop is None:
        return None
    margins = _loop_margins(setup)
    if not margins.stable:
        plant = setup.plant()
        mode = plant.modes.frequency_hz[0] if plant.modes else 0.0
        within = mode < 0.5 * plant.sample_rate_hz
        other = "notch the" if within else "raise its rate beyond twice the"
        raise ModelError(
            f"loop '{setup.loop.name}' is unstable on this stage: reduce its gain, or {other} mode "
            f"at {mode:.4g} Hz"
        )
    return margins


def _budgets(setup: _Setup) -> list[PointBudget]:
    """Return the budget at every point."""
    margins = _margins(setup)
    f, responses = _resolved(setup)
    levers: dict[str, Array] = {}
    for name, change in _LEVERS.items():
        if setup.loop is not None or name != "loop gain":
            low, high = (
                np.log(np.maximum(_totals(change(setup, 1.0 + step)), 1e-300))
                for step in (-_STEP, _STEP)
            )
            levers[name] = (high - low) / math.log((1.0 + _STEP) / (1.0 - _STEP))
    return [
        PointBudget(
            loop=OPEN if setup.loop is None else setup.loop.name,
            point=point.name,
            unit=setup.system.probe(point.probe).unit,
            frequency_hz=f,
            sources=tuple(
                _source_budget(source, response, f)
                for source, response in zip(setup.environment.sources, responses[k], strict=True)
            ),
            margins=margins,
            levers={name: float(slopes[k]) for name, slopes in levers.items()},
        )
        for k, point in enumerate(setup.points)
    ]


def _source_budget(source: NoiseSource, response: Complex, f: Array) -> SourceBudget:
    squared = np.abs(response) ** 2
    spectrum = source.spectrum
    return SourceBudget(
        name=source.name,
        kind=source.kind,
        density=squared * source.density(f),
        lines=tuple(
            (at, variance * float(np.interp(at, f, squared))) for at, variance in spectrum.lines
        ),
    )


def _totals(setup: _Setup) -> Array:
    """Return the rms of all sources at each point, shape (points,)."""
    f, responses = _resolved(setup)
    totals = []
    for of_point in responses:
        variance = 0.0
        for source, response in zip(setup.environment.sources, of_point, strict=True):
            budget = _source_budget(source, response, f)
            variance += float(np.trapezoid(budget.density, f)) + sum(v for _, v in budget.lines)
        totals.append(math.sqrt(variance))
    return np.array(totals)


def _scaled_damping(setup: _Setup, factor: float) -> _Setup:
    damping: Damping = setup.system.damping
    if isinstance(damping, ModalDamping):
        damping = ModalDamping(ratio=factor * damping.ratio)
    elif isinstance(damping, RayleighDamping):
        damping = RayleighDamping(alpha=factor * damping.alpha, beta=factor * damping.beta)
    else:
        damping = LossFactor(eta=factor * damping.eta)
    return replace(setup, system=setup.system.with_damping(damping))


def _scaled_stiffness(setup: _Setup, factor: float) -> _Setup:
    return replace(setup, system=replace(setup.system, K=factor * setup.system.K))


def _scaled_gain(setup: _Setup, factor: float) -> _Setup:
    assert setup.loop is not None
    return replace(setup, loop=replace(setup.loop, settings=setup.loop.settings.scaled(factor)))


#: Parameters of stage and loop by name; the loop keeps its settings while the stage changes.
_LEVERS: dict[str, Callable[[_Setup, float], _Setup]] = {
    "damping": _scaled_damping,
    "stiffness of the stage": _scaled_stiffness,
    "loop gain": _scaled_gain,
}


def _resolved(setup: _Setup) -> tuple[Array, Complex]:
    """Return lines that resolve the total at every point, and the responses at them.

    Lines are spread over the logarithm of the band, and dense about every mode of the open stage.
    Where the total changes by more than a tenth from one to the next, a line is added between.
    """
    every = modes(setup.system, drives="in place", count=None)
    respond = _responder(setup, every)
    f = _first_lines(setup.environment, every)
    responses = respond(f)
    for _ in range(_ROUNDS):
        total = sum(
            np.abs(responses[:, k]) ** 2 * source.density(f)
            for k, source in enumerate(setup.environment.sources)
        )
        logarithm = np.log(np.maximum(total, 1e-300))
        steep = np.any(np.abs(np.diff(logarithm, axis=-1)) > _CHANGE, axis=0)
        steep &= np.diff(f) > _APART * f[1:]
        if not steep.any():
            break
        new = 0.5 * (f[1:] + f[:-1])[steep]
        order = np.argsort(np.concatenate((f, new)), kind="stable")
        f = np.concatenate((f, new))[order]
        responses = np.concatenate((responses, respond(new)), axis=-1)[..., order]
    return f, responses


def _first_lines(environment: Environment, every: Modes) -> Array:
    low, high = environment.band
    parts = [np.geomspace(low, high, _LINES)]
    s = np.sinh(np.linspace(-4.0, 4.0, _NEAR)) / np.sinh(4.0)
    for mode, zeta in zip(every.frequency_hz, every.damping_ratio, strict=True):
        if low <= mode <= high and not zeta > 0.0:
            raise ModelError(
                f"the mode at {mode:.4g} Hz has no damping, and its rms no limit: give the stage "
                "its damping"
            )
        if mode < high:
            parts.append(mode * (1.0 + min(_WIDTHS * max(zeta, 1e-4), 0.9) * s))
    for source in environment.sources:
        spectrum = source.spectrum
        jumps = np.array(spectrum.jumps)
        parts += [jumps * (1.0 - 1e-9), jumps * (1.0 + 1e-9)]
        parts.append(np.array([at for at, _ in spectrum.lines]))
    lines = np.unique(np.concatenate(parts))
    return lines[(lines >= low) & (lines <= high)]


def _responder(setup: _Setup, every: Modes) -> Callable[[Array], Complex]:
    """Return the function that gives the response of each point to each source at frequencies.

    Its result has the shape (points, sources, k), in unit of the point over that of the source.
    """
    system, sources = setup.system, setup.environment.sources
    readers = np.array([*(_reader(system, point) for point in setup.points), setup.sensor])
    forces = [_force(setup, source) for source in sources]
    loop = setup.loop
    plant = None if loop is None else setup.plant()
    if loop is not None:
        readers = np.vstack((readers, setup.port.vector))
        forces.append(setup.force)
    grounds = [(k, s) for k, s in enumerate(sources) if isinstance(s, GroundMotion)]
    carried = {
        (j, k): _carried(setup.stage, point.probe, source.along)
        for j, point in enumerate(setup.points) if point.relative_to == "room"
        for k, source in grounds
    }  # fmt: skip

    def respond(f: Array) -> Complex:
        response = modal_response(every, readers, np.array(forces), f)
        omega = 2.0j * np.pi * f
        for k, source in grounds:
            # a motion of the ground is an acceleration of the base
            powers = source.derivatives
            response[:, k] *= omega**powers
            for j in range(len(setup.points)):
                response[j, k] += carried.get((j, k), 0.0) * omega ** (powers - 2)
        if loop is None or plant is None:
            return response[:-1]
        motion, read = response[:-2], response[-2, :-1].copy()
        read[[k for k, s in enumerate(sources) if s.kind == "sensor"]] = 1.0
        command = np.zeros_like(read)
        low = f < 0.5 * loop.sample_rate
        by_reading, by_force = loop.feedback(f[low])
        hold = np.sinc(f / loop.sample_rate) * np.exp(
            -omega * (0.5 / loop.sample_rate + loop.latency)
        )
        fed, around = by_reading * read[:, low], by_reading * plant.response(f[low])
        if by_force is not None:
            around += by_force * plant.force_response(f[low])
            # the blocked force of the voltage, less what the elongation takes away
            stack = -(setup.port.stiffness or 0.0) * response[-1, :-1]
            for k, source in enumerate(sources):
                if isinstance(source, DriveVoltage) and source.drive == setup.port.name:
                    stack[k] += plant.blocked_force
            fed += by_force * stack[:, low]
        command[:, low] = -fed / (1.0 + around) * hold[low]
        return motion[:, :-1] + motion[:, -1:] * command

    return respond


def _carried(stage: Stage, probe: str, along: GroundDirection) -> float:
    """Return the reading in the room of a stage that moves with the ground, undeformed."""
    described = stage.probe(probe)
    if described.relative_to is not None:
        return 0.0
    x, y = described.at
    motion = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "rotation": (-y, x, 1.0)}[along]
    return float(np.dot(described.row, motion))


def _reader(system: MechanicalSystem, point: Point) -> Array:
    vector = system.probe(point.probe).vector
    if point.relative_to in ("base", "room"):
        return vector
    other = system.probe(point.relative_to)
    if other.unit != system.probe(point.probe).unit:
        raise ModelError(
            f"point '{point.name}': probe '{point.probe}' reads {system.probe(point.probe).unit}, "
            f"and '{other.name}' reads {other.unit}: name a probe of the same unit"
        )
    return vector - other.vector


def _force(setup: _Setup, source: NoiseSource) -> Array:
    """Return the force on each coordinate for a unit of a source; none of a sensor."""
    if isinstance(source, DriveVoltage):
        return setup.force_of_voltage(source.drive)
    return source.force(setup.system)
