"""Simulated stages from their description: with scatter, and set to measured figures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.build_model import assembled_model
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.hysteresis.loops import loop_width
from flexstage.stage import PiezoStack, Screw, Stage
from flexstage.stage.assumptions import (
    AMPLIFIER_BANDWIDTH_HZ,
    AMPLIFIER_CURRENT,
    BACKLASH,
    BACKLASH_SPREAD,
    CREEP,
    LOOP_WIDTH_SPREAD,
    STROKE_SPREAD,
)
from flexstage.stage.limits import AxisLimits, stage_limits
from flexstage.system import MechanicalSystem, modes
from flexstage.system.characteristics import axis_mode
from flexstage.system.environment import Environment
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.as_built import AsBuilt, as_built, loop_share
from flexstage.virtual.imperfections import (
    Scatter,
    displaced_system,
    displacements,
    manufactured,
)
from flexstage.virtual.laboratory import Hammer
from flexstage.virtual.model_path import model_paths
from flexstage.virtual.neck_widths import NeckWidths
from flexstage.virtual.piezo_loop import amplifier_of, sampled_response
from flexstage.virtual.piezo_stage import PiezoAxis, PiezoStage, stack_of
from flexstage.virtual.sensors import EDDY_CURRENT_SENSORS, SensorBench
from flexstage.virtual.stack import FINE_PLAYS, WIDTHS, ChargeDrive, matched_stacks, virtual_stack
from flexstage.virtual.stage import Conditions, ScrewAxis, ScrewStage

#: Margin of the stroke at each end [1].
_MARGIN = 0.015
_CYCLES = 4
_EXACT = Scatter(neck_common=0.0, neck_own=0.0, position=0.0, modulus=0.0, lean=0.0, drive=0.0)


def virtual_stage(
    stage: Stage,
    *,
    model: Literal["superelement", "lumped"] = "superelement",
    seed: int = 0,
    sample_rate_hz: float = 10e3,
    amplifier: Literal["voltage", "charge"] = "voltage",
    quiet: bool = False,
    scatter: bool = True,
    widths: NeckWidths | None = None,
    environment: Environment | None = None,
) -> PiezoStage | ScrewStage:
    """Return a stage that runs sample by sample.

    Natural frequencies, stroke, loop width and straightness equal published measurements of the
    stage; without them, its path over the stroke is that of rigid bodies with finite rotations.
    Other guide errors and the gains of its sensors are random. With scatter, necks and notches
    deviate as from wire erosion: frequencies differ by a few percent, strokes by 2 % and widths by
    4 %.

    Parameters
    ----------
    stage : Stage
        The nominal stage; all its axes have piezo stacks with a voltage range, or all screws.
    model : {"superelement", "lumped"}
        Its mechanics: finite elements of each body, or rigid bodies on hinges. Both have the same
        natural frequencies along the axes. Stages with screws always use rigid bodies.
    seed : int
        Seed of all draws.
    sample_rate_hz : float
        Rate of the loop [Hz], 1 to 50 kHz.
    amplifier : {"voltage", "charge"}
        Kind of amplifier of the stacks.
    quiet : bool
        Without noise, mains, drift, and steps of converters and sensors.
    scatter : bool
        With manufacturing scatter.
    widths : NeckWidths, optional
        Measured necks: their bias, where no measured frequencies are published, and their scatter.
    environment : Environment, optional
        Sources of disturbance, drawn as signals in place of noise, mains, drift and steps; only
        with piezo stacks.

    Returns
    -------
    PiezoStage or ScrewStage
        The stage, relaxed.

    Raises
    ------
    ModelError
        The axes have other drives, or both kinds; or an option has another value.

    Notes
    -----
    Validity: synthetic, for trials; see `PiezoStage` and `ScrewStage` for neglected effects. The
    position range of a piezo stage is that of cycles at 1 Hz over the voltage range, less 1.5 % of
    the stroke at each end. After hours at one end creep amounts to a few percent of the stroke, and
    the other end may be out of reach.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> twin = virtual_stage(design("vgtu-piezo"), model="lumped", seed=1, quiet=True)
    >>> ramp = np.linspace(0.0, 120.0, 5000)
    >>> samples = twin.run(np.array([ramp, 0.0 * ramp]), (False, False))
    >>> round(float(samples.position[0, -1]) * 1e6, 1)
    69.7
    """
    if model not in ("superelement", "lumped"):
        raise ModelError(f"the model of a twin must be 'superelement' or 'lumped', got {model!r}")
    if amplifier not in ("voltage", "charge"):
        raise ModelError(
            f"the amplifier of a twin must be 'voltage' or 'charge', got {amplifier!r}"
        )
    if not 1e3 <= sample_rate_hz <= 50e3:
        raise ModelError(f"the loop rate of a twin must be 1 to 50 kHz, got {sample_rate_hz:g} Hz")
    drives = [stage.drive_of(axis.name) for axis in stage.axes]
    screws = all(isinstance(d, Screw) for d in drives)
    if twice := sorted({d.name for d in drives if drives.count(d) > 1}):
        raise ModelError(
            f"two axes of stage '{stage.name}' have the drive '{twice[0]}': a twin needs a drive "
            "for each axis"
        )
    if not screws and not all(isinstance(d, PiezoStack) and d.voltage_range for d in drives):
        kinds = ", ".join(
            f"'{d.name}' {d.kind}"
            + (" without a voltage_range" if isinstance(d, PiezoStack) and not d.voltage_range
               else "")
            for d in drives
        )  # fmt: skip
        raise ModelError(
            f"a twin needs screws on all axes, or piezo stacks with a voltage range, got {kinds}"
        )
    if screws and environment is not None:
        raise ModelError(
            f"the twin of '{stage.name}' has screws and is quasi-static, so no environment moves "
            "it: omit the environment, or choose a stage with piezo stacks"
        )
    process = Scatter() if widths is None else widths.scattered(Scatter())
    exact = as_built(stage, seed=seed, scatter=_EXACT, widths=widths)
    built = _manufactured(exact, model, seed, process if scatter else None, screws=screws)
    conditions = Conditions(
        sample_rate_hz=sample_rate_hz,
        seed=seed,
        quiet=quiet or environment is not None,
        scatter=scatter,
        environment=environment,
        sensors=replace(SensorBench(), **EDDY_CURRENT_SENSORS) if screws else SensorBench(),
        hammer=Hammer(built, seed),
        notes=tuple(built.notes),
    )
    if screws:
        return _screws(built, conditions)
    return _piezos(built, conditions, charge=amplifier == "charge")


def _manufactured(
    exact: AsBuilt, model: str, seed: int, process: Scatter | None, *, screws: bool
) -> AsBuilt:
    """Add the scatter of a process to a stage that is set to the measured figures."""
    stage = exact.stage
    specimen, moved, axes = exact.manufactured, {}, exact.axes
    if process is not None:
        specimen = manufactured(exact.manufactured, process, seed=seed)
        moved = displacements(stage, process, seed=seed)
        paths = model_paths(stage, specimen, moved, exact.followed, process, seed=seed)
        axes = tuple(
            replace(axis, guide=paths[axis.name].over(axis.guide)) if axis.name in paths else axis
            for axis in axes
        )
    damping = exact.system.damping
    system = displaced_system(specimen, moved)
    if model == "superelement" and not screws:
        from flexstage.fem.superelement import superelement_model

        system = _with_frequencies(superelement_model(stage).system, system)
    if damping is not None:
        system = system.with_damping(damping)
    return replace(exact, manufactured=specimen, system=system, axes=axes)


def _with_frequencies(system: MechanicalSystem, reference: MechanicalSystem) -> MechanicalSystem:
    """Return the system with the natural frequencies of a reference along its axes."""
    own_modes, target = modes(system, count=None), modes(reference, count=None)
    K = system.K.copy()
    for axis in system.axes:
        i = axis_mode(system, own_modes, axis.drive, axis.probe)
        j = axis_mode(reference, target, axis.drive, axis.probe)
        force = system.M @ own_modes.shapes[:, i]
        K += np.outer(force, force) * (target.omega[j] ** 2 - own_modes.omega[i] ** 2)
    return replace(system, K=0.5 * (K + K.T))


def _piezos(built: AsBuilt, conditions: Conditions, *, charge: bool) -> PiezoStage:
    rng = _draws(conditions.seed)
    targets, parts = [], []
    for state in built.axes:
        off = rng.standard_normal(2).tolist() if conditions.scatter else (0.0, 0.0)
        share = loop_share(built.stage, state.name, state.stroke)
        share *= 1.0 + LOOP_WIDTH_SPREAD * off[0]
        targets.append(
            (state.stroke * (1.0 + STROKE_SPREAD * off[1]), float(np.clip(share, *WIDTHS)))
        )
        drive = built.stage.drive_of(state.name).name
        probe = built.stage.axis(state.name).probe
        limits = stage_limits(built.stage, state.name)
        parts.append(PiezoAxis(name=state.name, drive=drive, probe=probe, limits=limits))
    model = assembled_model(built.system, [_drive_of(built.stage, part) for part in parts])

    def measure(sizes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        return [f[:2] for f in _conditioned(built.stage, _with_stacks(model, sizes), parts)]

    free = [built.stage.drive(part.drive).stroke or 0.0 for part in parts]
    start = [(f, share) for f, (_, share) in zip(free, targets, strict=True)]
    model = _with_stacks(model, matched_stacks(start, targets, measure))
    final = []
    rows = zip(parts, model.drives, _conditioned(built.stage, model, parts), strict=True)
    for part, drive, (stroke, _, low) in rows:
        margin = _MARGIN * stroke
        slew = amplifier_of(drive).largest_rate
        limits = part.limits if math.isinf(slew) else part.limits.within(AxisLimits(slew=slew))
        limits = replace(limits, position=(low + margin, low + stroke - margin))
        guide = replace(built.axis(part.name).guide, stroke=stroke)
        final.append(replace(part, limits=limits, guide=guide, low=low))
    final = default_servo_settings(model, final, conditions.sample_rate_hz)
    return PiezoStage(
        stage=built.stage,
        model=model,
        axes=final,
        charge=ChargeDrive(voltage_range=final[0].limits.voltage or (0.0, 1.0)) if charge else None,
        conditions=conditions,
    )


def _drive_of(stage: Stage, part: PiezoAxis) -> ModelDrive:
    """Return amplifier and creep of the drive of an axis."""
    drive = stage.drive(part.drive)
    capacitance = drive.capacitance if isinstance(drive, PiezoStack) else None
    return ModelDrive(
        name=part.drive,
        amplifier=Amplifier(
            bandwidth_hz=AMPLIFIER_BANDWIDTH_HZ,
            capacitance=capacitance or 0.0,
            current_limit=AMPLIFIER_CURRENT,
        ),
        creep=LogCreep(rate_per_decade=CREEP),
        input_range=part.limits.voltage,
    )


def _with_stacks(model: DynamicModel, sizes: Sequence[tuple[float, float]]) -> DynamicModel:
    """Give each drive a stack of a free stroke [m] and a width of its loop over it [1]."""
    drives = [
        replace(d, hysteresis=virtual_stack(d.input_range or (0.0, 1.0), *size, plays=FINE_PLAYS))
        for d, size in zip(model.drives, sizes, strict=True)
    ]
    return replace(model, drives=tuple(drives))


def _conditioned(
    stage: Stage, model: DynamicModel, parts: list[PiezoAxis]
) -> list[tuple[float, float, float]]:
    """Return stroke, relative loop width and low end of each axis, measured after four cycles."""
    rate = 1000.0
    alone = Conditions(sample_rate_hz=rate, quiet=True, scatter=False)
    twin = PiezoStage(stage=stage, model=model, axes=parts, conditions=alone)
    n = int(rate)
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(_CYCLES * n) / n)
    ends = np.array([d.input_range for d in model.drives])
    block = twin.run(ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * swing, [False] * len(parts))
    figures = []
    for u, y in zip(block.voltage[:, -2 * n :], block.position[:, -2 * n :], strict=True):
        stroke = float(np.ptp(y))
        figures.append((stroke, loop_width(u, y, np.array([0, n])) / stroke, float(y.min())))
    return figures


def _screws(built: AsBuilt, conditions: Conditions) -> ScrewStage:
    rng = _draws(conditions.seed)
    axes = []
    for state in built.axes:
        drive = cast(Screw, built.stage.drive_of(state.name))
        off = rng.standard_normal(2).tolist() if conditions.scatter else (0.0, 0.0)
        stroke = state.stroke * (1.0 + STROKE_SPREAD * off[0])
        backlash = BACKLASH * float(np.clip(1.0 + BACKLASH_SPREAD * off[1], 0.3, 1.7))
        axes.append(
            ScrewAxis(
                name=state.name,
                limits=stage_limits(built.stage, state.name),
                smallest_step=drive.smallest_step,
                backlash=backlash,
                ratio=stroke / (drive.travel - backlash),
                guide=replace(state.guide, stroke=stroke),
            )
        )
    return ScrewStage(stage=built.stage, axes=axes, conditions=conditions)


def _draws(seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(8,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _ServoTuning:
    """Default tuning of the servo: slow enough to be safe."""

    sensitivity: float = 1.6
    """Largest sensitivity |1 / (1 + L)|: the gain margin is at least 6 dB."""
    share: float = 0.7
    """Share of the gain that reaches this sensitivity."""
    notch_damping: float = 0.5
    """Damping ratio of the poles of a notch."""
    grid: int = 4000
    """Number of frequencies."""


_TUNING = _ServoTuning()


def default_servo_settings(
    model: DynamicModel, parts: Sequence[PiezoAxis], sample_rate_hz: float
) -> list[PiezoAxis]:
    """Return the axes with integral control and a notch at the mode that each excites most.

    Notes
    -----
    Validity: each axis alone, at the steepest slope of its major loop, with all modes and the delay
    of the loop.
    """
    model = replace(model, step=1.0 / sample_rate_hz)
    natural = model.omega / (2.0 * np.pi)
    frequency = np.geomspace(0.1, 0.499 * sample_rate_hz, _TUNING.grid)
    # a fine grid about each mode, whose peak is narrower than the coarse one
    near = natural[natural < 0.49 * sample_rate_hz]
    fine = near[:, None] * (1.0 + 0.05 * np.linspace(-1.0, 1.0, 201) ** 3)
    frequency = np.sort(np.concatenate((frequency, fine.ravel())))
    frequency = frequency[frequency < 0.5 * sample_rate_hz]
    out = []
    for part in parts:
        drive = model.drive(part.drive)
        response = sampled_response(
            model, part.drive, part.probe, frequency, slope=largest_slope(drive)
        ) * np.exp(-2j * np.pi * frequency / sample_rate_hz)
        weights = drive.modal_gain * model.probe_shapes[model.row(part.probe)]
        notches = _notch(np.abs(weights), natural, sample_rate_hz)
        unit = ServoSettings(integral=1.0, notches=notches)
        loop = response * unit.response(frequency, sample_rate_hz)
        settings = ServoSettings(integral=_TUNING.share * _largest_gain(loop), notches=notches)
        out.append(replace(part, settings=settings))
    return out


def largest_slope(drive: ModelDrive) -> float:
    """Return the steepest slope of the major loop of a virtual stack, without creep [m/V]."""
    low, high = drive.input_range or (0.0, 1.0)
    line = np.linspace(low, high, 300)
    u = np.concatenate([line, line[::-1], line, line[::-1]])
    du, dw = np.diff(u), np.diff(stack_of(drive).simulate(u).values)
    return float(np.max(dw[du != 0.0] / du[du != 0.0]))


def _notch(size: Array, frequency_hz: Array, sample_rate_hz: float) -> tuple[Notch, ...]:
    size[frequency_hz > 0.4 * sample_rate_hz] = 0.0
    if not np.any(size):
        return ()
    return (
        Notch(
            frequency_hz=float(frequency_hz[int(np.argmax(size))]),
            zero_damping=0.02,
            pole_damping=_TUNING.notch_damping,
        ),
    )


def _largest_gain(loop: NDArray[np.complex128]) -> float:
    """Return the smallest gain at which the sensitivity reaches its bound."""

    def peak(gain: float) -> float:
        return float(np.max(1.0 / np.abs(1.0 + gain * loop)))

    gain = 1e-3 / float(np.max(np.abs(loop)))
    while peak(gain) < _TUNING.sensitivity:
        gain *= 1.03
    low, high = gain / 1.03, gain
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if peak(middle) < _TUNING.sensitivity else (low, middle)
    return low
