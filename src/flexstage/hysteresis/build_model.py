"""Assembly of a dynamic model, from the description of a stage or a mechanical system."""

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
from flexstage.system.seated_drives import seat_notes
from flexstage.system.statics import imposed_shape

# Shortest and longest step [s]; far beyond, powers of the step over a period overflow.
_STEPS = (1e-12, 1e6)

# Smallest relative distance of a lag of the creep and an overdamped mode.
_APART = 1e-6


def dynamic_model(
    stage: Stage,
    system: MechanicalSystem,
    request: DynamicRequest | None = None,
    *,
    hysteresis: Hysteresis = "usual",
    creep: Creep | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    **options: Any,
) -> DynamicModel:
    """Return the dynamic model of a stage, with the data of its stacks.

    Parameters
    ----------
    stage : Stage
        The stage, whose drives include the data of their stacks.
    system : MechanicalSystem
        A model of the stage.
    request : DynamicRequest, optional
        Time between samples, bandwidth and largest current of the amplifiers, and number of modes;
        the static contribution of the others is a feedthrough.
    hysteresis : Mapping or str
        For each drive, or axis, the model from voltage [V] to free displacement [m], or the model
        identified from voltage [V] to the reading of the axis; ``usual`` for `usual_hysteresis` of
        every stack, ``none`` for linear stacks. Of an identified model, hysteresis and creep are
        used, so that the static readings agree with it; the modes are those of the stage.
    creep : Creep, optional
        Creep of every stack without an identified creep; none where not given.
    sensors : Mapping, optional
        Sensors by probe; the true motion without a sensor.
    **options
        Fields of `DynamicRequest`, in place of those of `request`.

    Returns
    -------
    DynamicModel
        The model.

    Raises
    ------
    ModelError
        The stage is not constrained, a name is neither a drive nor an axis, a drive with hysteresis
        is no stack, an identified model has other units, or the stroke of a model is far from that
        of its stack.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> model = dynamic_model(stage, lumped_system(stage), bandwidth=2000.0)
    >>> [d.unit for d in model.drives], model.omega.size
    (['V', 'V'], 60)
    """
    request = request_of(DynamicRequest, request, options)
    if not stage.drives:
        raise ModelError(f"stage '{stage.name}' has no drive: another program could not command it")
    models = models_by_drive(stage, hysteresis)
    model = assembled_model(
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
    for drive, model_drive in zip(stage.drives, model.drives, strict=True):
        source = models.get(drive.name)
        # a preload spring takes a part of the stroke
        share = (drive.mounted.stroke or 0.0) / drive.stroke if drive.stroke else 1.0
        scale = share
        if isinstance(drive, PiezoStack) and model_drive.hysteresis is not None:
            if isinstance(source, DriveModel):
                scale = scale_of(model, drive, source)
            refuse_stroke(drive, model_drive.hysteresis, scale / share)
        drives.append(model_drive if scale == 1.0 else _scaled(model_drive, scale))
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
            "Of identified drives, hysteresis and creep are used; their identified delay, offset "
            "and modes are not, and the modes are those of the stage."
        )
    return replace(
        model,
        name=stage.name,
        title=stage.title,
        drives=tuple(drives),
        notes=(*system.validity, *seat_notes(stage, system), *notes, *model.notes),
    )


def assembled_model(
    system: MechanicalSystem,
    drives: Sequence[ModelDrive],
    *,
    step: float = 1e-4,
    sensors: Mapping[str, Sensor] | None = None,
    mode_count: int | None = None,
) -> DynamicModel:
    """Return the dynamic model of a mechanical system with models of its drives.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    drives : sequence of ModelDrive
        Models of the drives, from command to free displacement; their weights are set here. Other
        drives are at rest, with their stiffness.
    step : float
        Step between samples [s].
    sensors : Mapping, optional
        Sensors by probe; the true motion without a sensor.
    mode_count : int, optional
        Number of modes, all where not given; the static contribution of the others is a
        feedthrough.

    Returns
    -------
    DynamicModel
        The model.

    Raises
    ------
    ModelError
        There is no drive, or it does not exist, or has hysteresis and no stiffness; a probe does
        not exist; the system has a motion without stiffness.

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
        raise ModelError("a model needs at least one drive")
    for drive in drives:
        if drive.hysteresis is not None:
            required_stiffness(system, drive.name)
    stage_modes = modes(system, drives="in place", count=None)
    if not np.all(stage_modes.omega > 0.0):
        raise ModelError(
            f"stage '{system.name}' has a motion without stiffness: constrain it before the export"
        )
    count = stage_modes.omega.size
    retained = count if mode_count is None else min(int(mode_count), count)
    if retained < 1:
        raise ModelError(f"a model needs at least one mode, got {mode_count!r}")
    sensors_by_probe = dict(sensors or {})
    for name in sensors_by_probe:
        system.probe(name)
    probes = np.array([p.vector for p in system.probes]).reshape(-1, system.order)
    notes = []
    if retained < count:
        notes.append(
            f"{retained} of {count} modes are included, up to "
            f"{stage_modes.omega[retained - 1] / (2.0 * np.pi):.4g} Hz; the static contribution of "
            "the others follows without delay."
        )
    if any(s.noise_rms > 0.0 for s in sensors_by_probe.values()):
        notes.append("The noise of the sensors is not included in files for other programs.")
    return DynamicModel(
        name=system.name,
        title="",
        step=float(step),
        omega=stage_modes.omega[:retained],
        damping_ratio=np.asarray(stage_modes.damping_ratio, dtype=np.float64)[:retained],
        drives=tuple(
            _with_weights(drive, system, stage_modes, probes, retained) for drive in drives
        ),
        probes=tuple(
            ModelProbe(name=p.name, unit=p.unit, sensor=sensors_by_probe.get(p.name))
            for p in system.probes
        ),
        probe_shapes=(probes @ stage_modes.shapes)[:, :retained],
        system=system,
        notes=tuple(notes),
    )


def _with_weights(
    drive: ModelDrive, system: MechanicalSystem, stage_modes: Modes, probes: Array, count: int
) -> ModelDrive:
    r"""Return a drive with the weights of its readings.

    With creep, :math:`x = 1/(\tau\omega)` and :math:`c = 1/(1 - 2\zeta x + x^2)`, a mode behind a
    lag is :math:`(1 - c) z - c \dot z/(\tau\omega^2) + c\, l`.
    """
    port = system.drive(drive.name)
    omega = stage_modes.omega[:count]
    zeta = np.asarray(stage_modes.damping_ratio, dtype=np.float64)[:count]
    rate_time = np.zeros(count)
    if port.stiffness is not None:
        force = port.stiffness or 1.0
        gain = force * (port.vector @ stage_modes.shapes) / stage_modes.omega**2
        reach = probes @ stage_modes.shapes * gain
        feed, reach = reach[:, count:].sum(axis=1), reach[:, :count]
    else:
        # the part of the imposed shape outside the retained modes moves with the drive
        shape = imposed_shape(system, port)
        mass = system.mass_matrix("in place")
        gain = np.asarray(stage_modes.shapes.T @ (mass @ shape), dtype=np.float64)
        reach = (probes @ stage_modes.shapes * gain)[:, :count]
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
                "an overdamped mode coincides with a lag of the creep: change the number of lags "
                "per decade"
            )
        c, a = 1.0 / below, drive.creep.lag_gains
        by_z = 1.0 + a @ (1.0 - c)
        by_v = -(a * rate) @ c / omega**2
        weights = np.hstack((reach * by_z, reach * by_v))
        # the motion with the free displacement creeps with it
        lags = a * (reach @ c.T) + np.outer(feed, a)
    return replace(
        drive,
        stiffness=port.stiffness,
        mode_weights=weights,
        lag_weights=lags,
        feedthrough=feed,
        rate_time=rate_time,
        modal_gain=gain[:count],
    )


def _scaled(drive: ModelDrive, scale: float) -> ModelDrive:
    """Return a drive whose free displacement is the output of its hysteresis times a scale."""
    return replace(
        drive,
        mode_weights=scale * drive.mode_weights,
        lag_weights=scale * drive.lag_weights,
        feedthrough=scale * drive.feedthrough,
        modal_gain=scale * drive.modal_gain,
    )
