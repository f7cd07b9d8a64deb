"""A dynamic model of a stage for other programs, from its description and its models."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from flexstage.errors import ModelError
from flexstage.export.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis import (
    Amplifier,
    BoucWen,
    HysteresisModel,
    LogCreep,
    Sensor,
    loop_width,
)
from flexstage.hysteresis.model import Array
from flexstage.stage import Drive, PiezoStack, Stage
from flexstage.system import DrivePort, MechanicalSystem, Modes, modes

__all__ = ["USUAL_LOOP_WIDTH", "dynamic_model", "usual_hysteresis"]

#: Width of the loop of a usual multilayer stack over its stroke [1]: data sheets of stacks under
#: voltage control state 10 to 15 %.
USUAL_LOOP_WIDTH = 0.125

# A lag of the creep and a mode that fall together this closely cannot be told apart.
_APART = 1e-6
# A model in um instead of m is a million times off; a stack differs from its data sheet by less.
_STROKE_FACTOR = 5.0


def usual_hysteresis(stack: PiezoStack, *, width: float = USUAL_LOOP_WIDTH) -> BoucWen:
    """Return a Bouc-Wen model with the stroke of a stack and a usual width of its loop.

    Parameters
    ----------
    stack : PiezoStack
        The stack, with its voltage range.
    width : float
        Width of the loop over the stroke [1], from 0.01 to 0.2.

    Returns
    -------
    BoucWen
        From voltage [V] to free displacement [m].

    Raises
    ------
    ModelError
        The stack has no voltage range, or no loop of this family is as wide.

    Notes
    -----
    Validity: a stand-in until a stack has been measured: stroke by its data sheet, loop by what is
    usual. `flexstage identify` gives the model of a real one.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> model = usual_hysteresis(design("vgtu-piezo").drives[0])
    >>> ends = model.simulate([120.0, 0.0, 120.0, 0.0]).values
    >>> round(float(ends[2] - ends[3]) * 1e6, 3)
    38.0
    """
    if stack.voltage_range is None:
        raise ModelError(
            f"drive '{stack.name}' has no voltage range, which its hysteresis needs: add it to the "
            "stage file"
        )
    if not 0.01 <= width <= 0.2:
        raise ModelError(f"the width of a loop must be 0.01 to 0.2 of the stroke, got {width:g}")
    low, high = stack.voltage_range
    span = high - low
    line = np.linspace(low, high, 600)
    cycle = np.concatenate((line, line[::-1][1:]))
    u = np.concatenate((cycle, *(cycle[1:],) * 3))
    bounds = np.arange(5) * (cycle.size - 1)
    # h saturates within about a third of the range, as the loop of a stack does

    def made(share: float, gain: float = 1.0) -> BoucWen:
        return BoucWen(
            gain=gain / span, hysteresis_gain=share * gain / span, beta=3.7 / span, gamma=2.3 / span
        )

    def settled(model: BoucWen) -> tuple[Array, Array, Array]:
        y = model.simulate(u).values
        late = slice(bounds[2], None)
        return u[late], y[late], bounds[2:] - bounds[2]

    def excess(share: float) -> float:
        voltage, y, ends = settled(made(share))
        return loop_width(voltage, y, ends) / float(np.ptp(y)) - width

    share = float(brentq(excess, 1e-4, 0.79, xtol=1e-12))  # type: ignore[arg-type]
    stroke = float(np.ptp(settled(made(share))[1]))
    return made(share, stack.free_stroke / stroke)


def dynamic_model(
    stage: Stage,
    system: MechanicalSystem,
    *,
    step: float = 1e-4,
    hysteresis: Mapping[str, HysteresisModel] | Literal["usual", "none"] = "usual",
    creep: LogCreep | None = None,
    bandwidth_hz: float | None = None,
    current_limit: float | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    mode_count: int | None = None,
) -> DynamicModel:
    """Return a stage with its drives as other programs run it.

    Parameters
    ----------
    stage : Stage
        The stage, whose drives hold the data of their stacks.
    system : MechanicalSystem
        A model of the stage.
    step : float
        Step between samples [s].
    hysteresis : Mapping or str
        For each drive, or axis, the model from voltage [V] to free displacement [m]; ``usual`` for
        `usual_hysteresis` of every stack, ``none`` for stacks that are linear.
    creep : LogCreep, optional
        Creep of every stack; none where not given.
    bandwidth_hz : float, optional
        Bandwidth of the amplifiers of stacks [Hz]; the command is the voltage where not given.
    current_limit : float, optional
        Largest current of an amplifier [A].
    sensors : Mapping, optional
        Sensors by probe; the true motion where there is none.
    mode_count : int, optional
        Number of modes that are kept, all where not given; what the others would add at rest is
        kept as feedthrough.

    Returns
    -------
    DynamicModel
        The model.

    Raises
    ------
    ModelError
        The stage is not held, a name is neither a drive nor an axis, a drive with hysteresis is no
        stack, or the stroke of a model is far from that of its stack.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> model = dynamic_model(stage, lumped_system(stage), bandwidth_hz=2000.0)
    >>> [d.unit for d in model.drives], model.omega.size
    (['V', 'V'], 60)
    """
    if not (step > 0.0 and np.isfinite(step)):
        raise ModelError(f"the step of a model must be positive and finite, got {step!r} s")
    if not stage.drives:
        raise ModelError(
            f"stage '{stage.name}' has no drive: there is nothing to command in another program"
        )
    found = modes(system, drives="in place", count=None)
    if not np.all(found.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: hold it before it is handed to "
            "another program"
        )
    kept = found.omega.size if mode_count is None else min(int(mode_count), found.omega.size)
    if kept < 1:
        raise ModelError(f"a model keeps at least one mode, got {mode_count!r}")
    models = _by_drive(stage, hysteresis)
    probes = np.array([p.vector for p in system.probes]).reshape(-1, system.order)
    drives = []
    for drive in stage.drives:
        port = system.drive(drive.name)
        model = models.get(drive.name)
        amplifier = _amplifier(drive, bandwidth_hz, current_limit)
        own = creep if isinstance(drive, PiezoStack) and model is not None else None
        drives.append(
            _weights(
                _chain(drive, model, amplifier, own),
                *_modal_gain(system, port, found),
                probes=probes,
                found=found,
                kept=kept,
            )
        )
    given = dict(sensors or {})
    for name in given:
        system.probe(name)
    return DynamicModel(
        name=stage.name,
        title=stage.title,
        step=float(step),
        omega=found.omega[:kept],
        damping_ratio=np.asarray(found.damping_ratio, dtype=np.float64)[:kept],
        drives=tuple(drives),
        probes=tuple(
            ModelProbe(name=p.name, unit=p.unit, sensor=_noiseless(given.get(p.name)))
            for p in system.probes
        ),
        system=system,
        notes=(*system.validity, *_notes(found.omega, kept, step, hysteresis, given)),
    )


def _noiseless(sensor: Sensor | None) -> Sensor | None:
    return None if sensor is None else replace(sensor, noise_rms=0.0)


def _by_drive(
    stage: Stage, given: Mapping[str, HysteresisModel] | Literal["usual", "none"]
) -> dict[str, HysteresisModel]:
    stacks = {d.name: d for d in stage.drives if isinstance(d, PiezoStack)}
    if isinstance(given, str):
        if given not in ("usual", "none"):
            raise ModelError(f"hysteresis is a model for each drive, usual or none, got '{given}'")
        return {n: usual_hysteresis(d) for n, d in stacks.items()} if given == "usual" else {}
    by_axis = {axis.name: axis.drive for axis in stage.axes}
    made: dict[str, HysteresisModel] = {}
    for name, model in given.items():
        target = name if name in {d.name for d in stage.drives} else by_axis.get(name, "")
        if target not in stacks:
            known = ", ".join(stacks) or "none"
            raise ModelError(
                f"'{name}' is no piezo stack, nor an axis of one, so it has no hysteresis: the "
                f"stacks of '{stage.name}' are {known}"
            )
        _refuse_stroke(stacks[target], model)
        made[target] = model
    return made


def _refuse_stroke(stack: PiezoStack, model: HysteresisModel) -> None:
    """Refuse a model whose stroke over the voltage range is far from the free stroke."""
    if stack.voltage_range is None:
        return
    ends = model.simulate(np.array(stack.voltage_range)).values
    stroke = float(abs(ends[1] - ends[0]))
    if not stack.free_stroke / _STROKE_FACTOR < stroke < stack.free_stroke * _STROKE_FACTOR:
        low, high = stack.voltage_range
        raise ModelError(
            f"the model of drive '{stack.name}' moves {stroke:.3g} m from {low:g} to {high:g} V, "
            f"and the stack's free stroke is {stack.free_stroke:.3g} m: its output must be the "
            "free displacement in m, and its input the voltage in V"
        )


def _amplifier(
    drive: Drive, bandwidth_hz: float | None, current_limit: float | None
) -> Amplifier | None:
    if not isinstance(drive, PiezoStack) or bandwidth_hz is None:
        if current_limit is not None and bandwidth_hz is None:
            raise ModelError("a current limit belongs to an amplifier: give its bandwidth too")
        return None
    if current_limit is not None and drive.capacitance is None:
        raise ModelError(
            f"drive '{drive.name}' has no capacitance, which turns the current limit into a rate: "
            "add it to the stage file, or leave the limit out"
        )
    return Amplifier(
        bandwidth_hz=bandwidth_hz,
        capacitance=drive.capacitance or 0.0,
        current_limit=current_limit,
        slew_limit=drive.largest_slew,
        voltage_range=drive.voltage_range,
    )


def _chain(
    drive: Drive,
    model: HysteresisModel | None,
    amplifier: Amplifier | None,
    creep: LogCreep | None,
) -> ModelDrive:
    """What lies before the modes; the weights are filled in later."""
    gain, unit, allowed = 1.0, "m" if drive.spring != 0.0 else "N", None
    if isinstance(drive, PiezoStack) and drive.voltage_range is not None:
        allowed, unit = drive.voltage_range, "V"
        gain = drive.free_stroke / (drive.voltage_range[1] - drive.voltage_range[0])
    none = np.zeros(0)
    return ModelDrive(
        name=drive.name,
        kind=drive.kind,
        unit="V" if model is not None else unit,
        gain=gain,
        hysteresis=model,
        amplifier=amplifier if unit == "V" or model is not None else None,
        creep=creep,
        input_range=allowed,
        mode_weights=none,
        lag_weights=none,
        feedthrough=none,
        rate_time=none,
        stiffness=drive.spring,
    )


def _modal_gain(
    system: MechanicalSystem, port: DrivePort, found: Modes
) -> tuple[Array, Array | None]:
    """Static deflection of each mode for a unit of the drive; the static shape where imposed."""
    if port.stiffness is not None:
        force = port.stiffness or 1.0
        return force * (port.vector @ found.shapes) / found.omega**2, None
    added, vectors = system.drive_springs("in place")
    n, m = vectors.shape
    saddle = np.block([[system.K + added, vectors], [vectors.T, np.zeros((m, m))]])
    right = np.zeros(n + m)
    right[n + int(np.argmax([np.array_equal(v, port.vector) for v in vectors.T]))] = 1.0
    shape = np.asarray(np.linalg.solve(saddle, right)[:n], dtype=np.float64)
    return np.asarray(found.shapes.T @ system.M @ shape, dtype=np.float64), shape


def _weights(
    drive: ModelDrive, gain: Array, shape: Array | None, *, probes: Array, found: Modes, kept: int
) -> ModelDrive:
    r"""Fill in what the probes read.

    With creep, :math:`x = 1/(\tau\omega)` and :math:`c = 1/(1 - 2\zeta x + x^2)`, a mode behind a
    lag is :math:`(1 - c) z - c \dot z/(\tau\omega^2) + c\, l`.
    """
    reach = probes @ found.shapes * gain
    feed = reach[:, kept:].sum(axis=1)
    omega = found.omega[:kept]
    zeta = np.asarray(found.damping_ratio, dtype=np.float64)[:kept]
    reach = reach[:, :kept]
    rate_time = np.zeros(kept)
    if shape is not None:
        # the part of the imposed shape that the kept modes do not hold moves with the drive
        feed = probes @ shape - reach.sum(axis=1)
        rate_time = 2.0 * zeta / omega
    weights = np.hstack((reach, np.zeros_like(reach)))
    lags = np.zeros((probes.shape[0], 0))
    if drive.creep is not None:
        rate = 1.0 / drive.creep.time_constants
        x = rate[:, None] / omega
        below = 1.0 - 2.0 * zeta * x + x**2
        if np.any(np.abs(below) < _APART):
            raise ModelError(
                "a mode that does not swing falls together with a lag of the creep: change the "
                "number of lags in a decade"
            )
        c, a = 1.0 / below, drive.creep.lag_gain
        by_z = 1.0 + a * (1.0 - c).sum(axis=0)
        by_v = -a * (c * rate[:, None]).sum(axis=0) / omega**2
        weights = np.hstack((reach * by_z, reach * by_v))
        # what moves with the free displacement creeps with it
        lags = a * (reach @ c.T) + np.outer(feed, np.full(rate.size, a))
    return replace(
        drive, mode_weights=weights, lag_weights=lags, feedthrough=feed, rate_time=rate_time
    )


def _notes(
    omega: Array,
    kept: int,
    step: float,
    hysteresis: Mapping[str, HysteresisModel] | Literal["usual", "none"],
    sensors: Mapping[str, Sensor],
) -> tuple[str, ...]:
    notes = [f"commands move on straight lines between samples {step:g} s apart"]
    if hysteresis == "usual":
        notes.append(
            f"the hysteresis of the stacks is not measured: a Bouc-Wen loop of a usual width, "
            f"{100.0 * USUAL_LOOP_WIDTH:g} % of the stroke"
        )
    if kept < omega.size:
        notes.append(
            f"{kept} of {omega.size} modes are kept, up to {omega[kept - 1] / (2.0 * np.pi):.4g} "
            "Hz; what the others add at rest follows at once"
        )
    if any(s.noise_rms > 0.0 for s in sensors.values()):
        notes.append("the noise of the sensors is left out")
    return tuple(notes)
