"""A dynamic model of a stage for other programs, from its description and its models."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive, ModelProbe
from flexstage.hysteresis.model import Array, HysteresisModel
from flexstage.hysteresis.stack_models import (
    Hysteresis,
    amplifier_of,
    bare_drive,
    models_by_drive,
    scale_of,
)
from flexstage.hysteresis.stage_plant import refuse_stroke
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import LOOP_WIDTH
from flexstage.system import MechanicalSystem, Modes, modes
from flexstage.system.mechanical import DrivePort
from flexstage.system.statics import imposed_shape

# s; far beyond, powers of the step over a period overflow.
_STEPS = (1e-12, 1e6)

# A lag of the creep and a mode that fall together this closely cannot be told apart.
_APART = 1e-6


def dynamic_model(
    stage: Stage,
    system: MechanicalSystem,
    *,
    step: float = 1e-4,
    hysteresis: Hysteresis = "usual",
    creep: Creep | None = None,
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
        For each drive, or axis, the model from voltage [V] to free displacement [m], or the model
        that was identified from voltage [V] to the reading of the axis; ``usual`` for
        `usual_hysteresis` of every stack, ``none`` for stacks that are linear. Of an identified
        model the hysteresis and the creep are taken, so that the stage reads at rest what it says;
        modes are those of the stage.
    creep : Creep, optional
        Creep of every stack but those whose identified model has its own; none where not given.
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
        stack, an identified model has other units, or the stroke of a model is far from that of its
        stack.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> model = dynamic_model(stage, lumped_system(stage), bandwidth_hz=2000.0)
    >>> [d.unit for d in model.drives], model.omega.size
    (['V', 'V'], 60)
    """
    shortest, longest = _STEPS
    if not shortest <= step <= longest:
        raise ModelError(
            f"the step of a model must be {shortest:g} to {longest:g} s, got {step:g} s"
        )
    if not stage.drives:
        raise ModelError(
            f"stage '{stage.name}' has no drive: there is nothing to command in another program"
        )
    found = modes(system, drives="in place", count=None)
    if not np.all(found.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: constrain it before the export"
        )
    kept = found.omega.size if mode_count is None else min(int(mode_count), found.omega.size)
    if kept < 1:
        raise ModelError(f"a model keeps at least one mode, got {mode_count!r}")
    models = models_by_drive(stage, hysteresis)
    probes = np.array([p.vector for p in system.probes]).reshape(-1, system.order)
    stacks = {d.name: models.get(d.name) for d in stage.drives if isinstance(d, PiezoStack)}
    drives = []
    for drive in stage.drives:
        port = system.drive(drive.name)
        given = models.get(drive.name)
        model, own = (
            (given.hysteresis, given.creep) if isinstance(given, DriveModel) else (given, None)
        )
        amplifier = amplifier_of(drive, bandwidth_hz, current_limit)
        gain, shape = _modal_gain(system, port, found)
        if given is not None:
            assert isinstance(drive, PiezoStack)
            scale = scale_of(system, drive, given, probes @ found.shapes @ gain)
            assert model is not None
            refuse_stroke(drive, model, scale)
            gain = scale * gain
        own = own or (creep if model is not None else None)
        made = bare_drive(drive, model, amplifier, own)
        drives.append(_weights(made, gain, shape, probes=probes, found=found, kept=kept))
    readers = dict(sensors or {})
    for name in readers:
        system.probe(name)
    return DynamicModel(
        name=stage.name,
        title=stage.title,
        step=float(step),
        omega=found.omega[:kept],
        damping_ratio=np.asarray(found.damping_ratio, dtype=np.float64)[:kept],
        drives=tuple(drives),
        probes=tuple(
            ModelProbe(name=p.name, unit=p.unit, sensor=_noiseless(readers.get(p.name)))
            for p in system.probes
        ),
        probe_shapes=(probes @ found.shapes)[:, :kept],
        system=system,
        notes=(
            *system.validity,
            *_notes(found.omega, kept, step, stacks, hysteresis == "usual", readers),
        ),
    )


def _noiseless(sensor: Sensor | None) -> Sensor | None:
    return None if sensor is None else replace(sensor, noise_rms=0.0)


def _modal_gain(
    system: MechanicalSystem, port: DrivePort, found: Modes
) -> tuple[Array, Array | None]:
    """Static deflection of each mode for a unit of the drive; the static shape where imposed."""
    if port.stiffness is not None:
        force = port.stiffness or 1.0
        return force * (port.vector @ found.shapes) / found.omega**2, None
    shape = imposed_shape(system, port)
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
        c, a = 1.0 / below, drive.creep.lag_gains
        by_z = 1.0 + a @ (1.0 - c)
        by_v = -(a * rate) @ c / omega**2
        weights = np.hstack((reach * by_z, reach * by_v))
        # what moves with the free displacement creeps with it
        lags = a * (reach @ c.T) + np.outer(feed, a)
    return replace(
        drive,
        mode_weights=weights,
        lag_weights=lags,
        feedthrough=feed,
        rate_time=rate_time,
        modal_gain=gain[:kept],
    )


def _notes(
    omega: Array,
    kept: int,
    step: float,
    stacks: Mapping[str, HysteresisModel | DriveModel | None],
    usual: bool,
    sensors: Mapping[str, Sensor],
) -> tuple[str, ...]:
    notes = [f"Commands move on straight lines between samples {step:g} s apart."]
    if usual and stacks:
        notes.append(
            "The hysteresis of the stacks is not measured: a Bouc-Wen loop of a usual width, "
            f"{100.0 * LOOP_WIDTH:g} % of the stroke."
        )
    linear = [name for name, model in stacks.items() if model is None]
    if linear:
        notes.append(f"Stacks without hysteresis: {', '.join(linear)}.")
    if any(isinstance(m, DriveModel) for m in stacks.values()):
        notes.append(
            "Of identified drives the hysteresis and the creep are taken; delay, offset and modes "
            "that were identified with them are left out, the modes are those of the stage."
        )
    if kept < omega.size:
        notes.append(
            f"{kept} of {omega.size} modes are kept, up to {omega[kept - 1] / (2.0 * np.pi):.4g} "
            "Hz; what the others add at rest follows at once."
        )
    if any(s.noise_rms > 0.0 for s in sensors.values()):
        notes.append("The noise of the sensors is left out.")
    return tuple(notes)
