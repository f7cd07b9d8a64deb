"""The dynamic model of a stage, from its description and its models; or of a mechanical system."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexstage.base.errors import ModelError
from flexstage.files.request import request_of
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.dynamic_model import (
    DynamicModel,
    ModelDrive,
    ModelProbe,
    required_stiffness,
)
from flexstage.hysteresis.model import Array
from flexstage.hysteresis.requests import DynamicRequest
from flexstage.hysteresis.stack_models import (
    Hysteresis,
    drive_of,
    models_by_drive,
    refuse_stroke,
    scale_of,
)
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import LOOP_WIDTH
from flexstage.system import MechanicalSystem, Modes, modes
from flexstage.system.statics import imposed_shape

# s; far beyond, powers of the step over a period overflow.
_STEPS = (1e-12, 1e6)

# A lag of the creep and a mode that fall together this closely cannot be told apart.
_APART = 1e-6


def dynamic_model(
    stage: Stage,
    system: MechanicalSystem,
    request: DynamicRequest | None = None,
    *,
    hysteresis: Hysteresis = "usual",
    creep: Creep | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    **asked: Any,
) -> DynamicModel:
    """Return the dynamic model of a stage, with the data of its stacks.

    Parameters
    ----------
    stage : Stage
        The stage, whose drives hold the data of their stacks.
    system : MechanicalSystem
        A model of the stage.
    request : DynamicRequest, optional
        Time between samples, bandwidth and largest current of the amplifiers, and how many modes
        are kept; what the others would add at rest is kept as feedthrough.
    hysteresis : Mapping or str
        For each drive, or axis, the model from voltage [V] to free displacement [m], or the model
        that was identified from voltage [V] to the reading of the axis; ``usual`` for
        `usual_hysteresis` of every stack, ``none`` for stacks that are linear. Of an identified
        model the hysteresis and the creep are taken, so that the stage reads at rest what it says;
        modes are those of the stage.
    creep : Creep, optional
        Creep of every stack but those whose identified model has its own; none where not given.
    sensors : Mapping, optional
        Sensors by probe; the true motion where there is none.
    **asked
        Fields of `DynamicRequest`, in place of those of `request`.

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
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> model = dynamic_model(stage, lumped_system(stage), bandwidth=2000.0)
    >>> [d.unit for d in model.drives], model.omega.size
    (['V', 'V'], 60)
    """
    request = request_of(DynamicRequest, request, asked)
    if not stage.drives:
        raise ModelError(
            f"stage '{stage.name}' has no drive: there is nothing to command in another program"
        )
    models = models_by_drive(stage, hysteresis)
    made = assembled_model(
        system,
        [
            drive_of(drive, models.get(drive.name), creep, request.bandwidth, request.current)
            for drive in stage.drives
        ],
        step=request.time_step,
        sensors=sensors,
        mode_count=request.keep_modes,
    )
    drives = []
    for drive, own in zip(stage.drives, made.drives, strict=True):
        given, scale = models.get(drive.name), 1.0
        if isinstance(drive, PiezoStack) and own.hysteresis is not None:
            if isinstance(given, DriveModel):
                scale = scale_of(made, drive, given)
            refuse_stroke(drive, own.hysteresis, scale)
        drives.append(own if scale == 1.0 else _scaled(own, scale))
    linear = [d.name for d in stage.drives if isinstance(d, PiezoStack) and d.name not in models]
    notes = [f"Commands move on straight lines between samples {request.time_step:g} s apart."]
    if hysteresis == "usual" and models:
        notes.append(
            "The hysteresis of the stacks is not measured: a Bouc-Wen loop of a usual width, "
            f"{100.0 * LOOP_WIDTH:g} % of the stroke."
        )
    if linear:
        notes.append(f"Stacks without hysteresis: {', '.join(linear)}.")
    if any(isinstance(m, DriveModel) for m in models.values()):
        notes.append(
            "Of identified drives the hysteresis and the creep are taken; delay, offset and modes "
            "that were identified with them are left out, the modes are those of the stage."
        )
    return replace(
        made,
        name=stage.name,
        title=stage.title,
        drives=tuple(drives),
        notes=(*system.validity, *notes, *made.notes),
    )


def assembled_model(
    system: MechanicalSystem,
    drives: Sequence[ModelDrive],
    *,
    step: float = 1e-4,
    sensors: Mapping[str, Sensor] | None = None,
    mode_count: int | None = None,
) -> DynamicModel:
    """Return the dynamic model of a mechanical system, from what lies before its drives.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : sequence of ModelDrive
        What lies between the command of each drive and its free displacement; the weights are
        filled in. Other drives stand still, with their stiffness.
    step : float
        Step between samples [s].
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
        There is no drive, or it does not exist, or has hysteresis and no stiffness; a probe does
        not exist; the system moves without resistance.

    Examples
    --------
    >>> from flexstage.hysteresis import BoucWen
    >>> from flexstage.system.mechanical import DrivePort, ProbePort
    >>> stage = MechanicalSystem(
    ...     name="a mass on a spring",
    ...     model="lumped",
    ...     M=np.array([[0.31]]),
    ...     K=np.array([[2.4e6]]),
    ...     coordinates=("u [m]",),
    ...     drives=(DrivePort(name="x", vector=np.ones(1), stiffness=4.1e7),),
    ...     probes=(ProbePort(name="x", vector=np.ones(1)),),
    ... )
    >>> stack = BoucWen(gain=3.8e-7, hysteresis_gain=1.1e-7, beta=0.05, gamma=0.03)
    >>> model = assembled_model(stage, [ModelDrive(name="x", hysteresis=stack)], step=1e-4)
    >>> round(model.load_factor("x"), 4)
    0.9447
    >>> u = 60.0 - 60.0 * np.cos(2.0 * np.pi * 5.0 * np.arange(2000) * 1e-4)
    >>> round(float(model.simulate({"x": u}).readings["x"].max()) * 1e6, 3)
    41.78
    """
    shortest, longest = _STEPS
    if not shortest <= step <= longest:
        raise ModelError(
            f"the step of a model must be {shortest:g} to {longest:g} s, got {step:g} s"
        )
    if not drives:
        raise ModelError("a model needs at least one drive: nothing else moves it")
    for drive in drives:
        if drive.hysteresis is not None:
            required_stiffness(system, drive.name)
    found = modes(system, drives="in place", count=None)
    if not np.all(found.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: constrain it before the export"
        )
    count = found.omega.size
    kept = count if mode_count is None else min(int(mode_count), count)
    if kept < 1:
        raise ModelError(f"a model keeps at least one mode, got {mode_count!r}")
    given = dict(sensors or {})
    for name in given:
        system.probe(name)
    probes = np.array([p.vector for p in system.probes]).reshape(-1, system.order)
    notes = []
    if kept < count:
        notes.append(
            f"{kept} of {count} modes are kept, up to "
            f"{found.omega[kept - 1] / (2.0 * np.pi):.4g} Hz; what the others add at rest follows "
            "at once."
        )
    if any(s.noise_rms > 0.0 for s in given.values()):
        notes.append("The noise of the sensors is left out of files for other programs.")
    return DynamicModel(
        name=system.name,
        title="",
        step=float(step),
        omega=found.omega[:kept],
        damping_ratio=np.asarray(found.damping_ratio, dtype=np.float64)[:kept],
        drives=tuple(_with_weights(drive, system, found, probes, kept) for drive in drives),
        probes=tuple(
            ModelProbe(name=p.name, unit=p.unit, sensor=given.get(p.name)) for p in system.probes
        ),
        probe_shapes=(probes @ found.shapes)[:, :kept],
        system=system,
        notes=tuple(notes),
    )


def _with_weights(
    drive: ModelDrive, system: MechanicalSystem, found: Modes, probes: Array, kept: int
) -> ModelDrive:
    r"""Fill in what the probes read.

    With creep, :math:`x = 1/(\tau\omega)` and :math:`c = 1/(1 - 2\zeta x + x^2)`, a mode behind a
    lag is :math:`(1 - c) z - c \dot z/(\tau\omega^2) + c\, l`.
    """
    port = system.drive(drive.name)
    omega = found.omega[:kept]
    zeta = np.asarray(found.damping_ratio, dtype=np.float64)[:kept]
    rate_time = np.zeros(kept)
    if port.stiffness is not None:
        force = port.stiffness or 1.0
        gain = force * (port.vector @ found.shapes) / found.omega**2
        reach = probes @ found.shapes * gain
        feed, reach = reach[:, kept:].sum(axis=1), reach[:, :kept]
    else:
        # the part of the imposed shape that the kept modes do not hold moves with the drive
        shape = imposed_shape(system, port)
        gain = np.asarray(found.shapes.T @ system.M @ shape, dtype=np.float64)
        reach = (probes @ found.shapes * gain)[:, :kept]
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
        stiffness=port.stiffness,
        mode_weights=weights,
        lag_weights=lags,
        feedthrough=feed,
        rate_time=rate_time,
        modal_gain=gain[:kept],
    )


def _scaled(drive: ModelDrive, scale: float) -> ModelDrive:
    """Return a drive whose free displacement is so many times what its hysteresis gives."""
    return replace(
        drive,
        mode_weights=scale * drive.mode_weights,
        lag_weights=scale * drive.lag_weights,
        feedthrough=scale * drive.feedthrough,
        modal_gain=scale * drive.modal_gain,
    )
