"""Simulated stages from their description: made with scatter, and set to what was measured."""

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
from flexstage.system.servo import Notch, ServoSettings
from flexstage.virtual.as_built import AsBuilt, as_built, loop_share
from flexstage.virtual.imperfections import (
    Scatter,
    displaced_system,
    displacements,
    manufactured,
)
from flexstage.virtual.laboratory import Hammer
from flexstage.virtual.piezo_loop import amplifier_of, sampled_response
from flexstage.virtual.piezo_stage import PiezoAxis, PiezoStage, stack_of
from flexstage.virtual.sensors import EDDY_CURRENT_SENSORS, SensorBench
from flexstage.virtual.stack import FINE_PLAYS, WIDTHS, ChargeDrive, matched_stacks, virtual_stack
from flexstage.virtual.stage import Conditions, ScrewAxis, ScrewStage

#: Part of the stroke that is kept free at each end.
_KEPT_FREE = 0.015
_CYCLES = 4
_EXACT = Scatter(neck_common=0.0, neck_own=0.0, position=0.0, modulus=0.0)


def virtual_stage(
    stage: Stage,
    *,
    model: Literal["superelement", "lumped"] = "superelement",
    seed: int = 0,
    sample_rate_hz: float = 10e3,
    amplifier: Literal["voltage", "charge"] = "voltage",
    quiet: bool = False,
    scatter: bool = True,
) -> PiezoStage | ScrewStage:
    """Make a stage that runs sample by sample.

    What has been measured of the stage and published is set: natural frequencies, stroke, width of
    the loop, straightness. What no model knows is drawn: how its guides bend, and the gains of its
    sensors. With scatter, necks and notches are off as from wire erosion, so that frequencies
    differ by some percent, strokes by 2 % and widths by 4 %.

    Parameters
    ----------
    stage : Stage
        The stage as drawn; all its axes have piezo stacks with a voltage range, or all screws.
    model : {"superelement", "lumped"}
        Its mechanics: finite elements of each body, or rigid bodies on hinges. Both have the same
        natural frequencies along the axes. Screws need the second alone.
    seed : int
        Seed of all draws.
    sample_rate_hz : float
        Rate of the loop [Hz], 1 to 50 kHz.
    amplifier : {"voltage", "charge"}
        What drives the stacks.
    quiet : bool
        Whether to leave out noise, mains, drift and all steps of converters and sensors.
    scatter : bool
        Whether the stage is made with scatter.

    Returns
    -------
    PiezoStage or ScrewStage
        The stage, relaxed.

    Raises
    ------
    ModelError
        The axes are driven by something else, or by both; or an option is not one of those named.

    Notes
    -----
    Validity: an invention for trials, of the size and kind that such stages have; `PiezoStage` and
    `ScrewStage` say what is left out. The positions that may be commanded of a piezo stage are
    those of cycles at 1 Hz over the whole range, less 1.5 % of the stroke at each end. Creep takes
    some percent of the stroke after hours at one end, so that the other may then be out of reach.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> made = virtual_stage(design("vgtu-piezo"), model="lumped", seed=1, quiet=True)
    >>> ramp = np.linspace(0.0, 120.0, 5000)
    >>> moved = made.run(np.array([ramp, 0.0 * ramp]), (False, False))
    >>> round(float(moved.position[0, -1]) * 1e6, 1)
    69.7
    """
    if model not in ("superelement", "lumped"):
        raise ModelError(f"the model of a twin is 'superelement' or 'lumped', got {model!r}")
    if amplifier not in ("voltage", "charge"):
        raise ModelError(f"an amplifier drives by 'voltage' or 'charge', got {amplifier!r}")
    if not 1e3 <= sample_rate_hz <= 50e3:
        raise ModelError(f"the rate of a twin's loop is 1 to 50 kHz, got {sample_rate_hz:g} Hz")
    drives = [stage.drive_of(axis.name) for axis in stage.axes]
    screws = all(isinstance(d, Screw) for d in drives)
    if twice := sorted({d.name for d in drives if drives.count(d) > 1}):
        raise ModelError(
            f"two axes of stage '{stage.name}' have the drive '{twice[0]}': a twin needs one for "
            "each axis"
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
    built = _as_made(stage, model, seed, scatter=scatter, screws=screws)
    conditions = Conditions(
        sample_rate_hz=sample_rate_hz,
        seed=seed,
        quiet=quiet,
        scatter=scatter,
        sensors=replace(SensorBench(), **EDDY_CURRENT_SENSORS) if screws else SensorBench(),
        hammer=Hammer(built, seed),
        notes=tuple(built.notes),
    )
    if screws:
        return _screws(built, conditions)
    return _piezos(built, conditions, charge=amplifier == "charge")


def _as_made(stage: Stage, model: str, seed: int, *, scatter: bool, screws: bool) -> AsBuilt:
    """Set what was measured first, and let the process miss it then."""
    exact = as_built(stage, seed=seed, scatter=_EXACT)
    made, moved = exact.made, {}
    if scatter:
        made = manufactured(exact.made, Scatter(), seed=seed)
        moved = displacements(stage, Scatter(), seed=seed)
    damping = exact.system.damping
    system = displaced_system(made, moved)
    if model == "superelement" and not screws:
        from flexstage.fem.superelement import superelement_model

        system = _with_frequencies(superelement_model(stage).system, system)
    if damping is not None:
        system = system.with_damping(damping)
    return replace(exact, made=made, system=system)


def _with_frequencies(system: MechanicalSystem, wanted: MechanicalSystem) -> MechanicalSystem:
    """Stiffen the modes along the axes until they have the frequencies of another model."""
    found, aim = modes(system, count=None), modes(wanted, count=None)
    K = system.K.copy()
    for axis in system.axes:
        i = axis_mode(system, found, axis.drive, axis.probe)
        j = axis_mode(wanted, aim, axis.drive, axis.probe)
        force = system.M @ found.shapes[:, i]
        K += np.outer(force, force) * (aim.omega[j] ** 2 - found.omega[i] ** 2)
    return replace(system, K=0.5 * (K + K.T))


def _piezos(built: AsBuilt, conditions: Conditions, *, charge: bool) -> PiezoStage:
    rng = _draws(conditions.seed)
    aims, parts = [], []
    for state in built.axes:
        off = rng.standard_normal(2).tolist() if conditions.scatter else (0.0, 0.0)
        share = loop_share(built.stage, state.name, state.stroke)
        share *= 1.0 + LOOP_WIDTH_SPREAD * off[0]
        aims.append((state.stroke * (1.0 + STROKE_SPREAD * off[1]), float(np.clip(share, *WIDTHS))))
        drive = built.stage.drive_of(state.name).name
        probe = built.stage.axis(state.name).probe
        limits = stage_limits(built.stage, state.name)
        parts.append(PiezoAxis(name=state.name, drive=drive, probe=probe, limits=limits))
    model = assembled_model(built.system, [_drive_of(built.stage, part) for part in parts])

    def measured(sizes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        return [f[:2] for f in _conditioned(built.stage, _with_stacks(model, sizes), parts)]

    free = [built.stage.drive(part.drive).stroke or 0.0 for part in parts]
    start = [(f, share) for f, (_, share) in zip(free, aims, strict=True)]
    model = _with_stacks(model, matched_stacks(start, aims, measured))
    final = []
    rows = zip(parts, model.drives, _conditioned(built.stage, model, parts), strict=True)
    for part, drive, (stroke, _, low) in rows:
        margin = _KEPT_FREE * stroke
        slew = amplifier_of(drive).largest_rate
        limits = part.limits if math.isinf(slew) else part.limits.within(AxisLimits(slew=slew))
        limits = replace(limits, position=(low + margin, low + stroke - margin))
        guide = replace(built.axis(part.name).guide, stroke=stroke)
        final.append(replace(part, limits=limits, guide=guide, low=low))
    final = delivered_settings(model, final, conditions.sample_rate_hz)
    return PiezoStage(
        stage=built.stage,
        model=model,
        axes=final,
        charge=ChargeDrive(voltage_range=final[0].limits.voltage or (0.0, 1.0)) if charge else None,
        conditions=conditions,
    )


def _drive_of(stage: Stage, part: PiezoAxis) -> ModelDrive:
    """Return what lies before the stack of an axis, and its creep."""
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
    """Return stroke, width of the loop over it, and low end of each axis after some cycles."""
    rate = 1000.0
    alone = Conditions(sample_rate_hz=rate, quiet=True, scatter=False)
    made = PiezoStage(stage=stage, model=model, axes=parts, conditions=alone)
    n = int(rate)
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(_CYCLES * n) / n)
    ends = np.array([d.input_range for d in model.drives])
    block = made.run(ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * swing, [False] * len(parts))
    found = []
    for u, y in zip(block.voltage[:, -2 * n :], block.position[:, -2 * n :], strict=True):
        stroke = float(np.ptp(y))
        found.append((stroke, loop_width(u, y, np.array([0, n])) / stroke, float(y.min())))
    return found


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
class _Delivered:
    """How a position control is set as a stage is delivered: slow enough to be safe."""

    sensitivity: float = 1.6
    """Largest of |1 / (1 + L)|: by it the gain may double (6 dB) before the loop is unstable."""
    share: float = 0.7
    """Part of the gain that would reach this."""
    notch_damping: float = 0.5
    """Damping ratio of the poles of a notch."""
    grid: int = 4000
    """Frequencies that are looked at."""


_DELIVERED = _Delivered()


def delivered_settings(
    model: DynamicModel, parts: Sequence[PiezoAxis], sample_rate_hz: float
) -> list[PiezoAxis]:
    """Give each axis an integral control with a notch at the mode that it excites most.

    Notes
    -----
    Validity: each axis by itself, at the steepest slope of its major loop, with all modes and the
    delay of the loop.
    """
    model = replace(model, step=1.0 / sample_rate_hz)
    natural = model.omega / (2.0 * np.pi)
    frequency = np.geomspace(0.1, 0.499 * sample_rate_hz, _DELIVERED.grid)
    # and close to each mode, whose peak is narrower than any grid
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
        settings = ServoSettings(integral=_DELIVERED.share * _largest_gain(loop), notches=notches)
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
            pole_damping=_DELIVERED.notch_damping,
        ),
    )


def _largest_gain(loop: NDArray[np.complex128]) -> float:
    """Return the gain at which the sensitivity reaches its bound, coming from zero."""

    def peak(gain: float) -> float:
        return float(np.max(1.0 / np.abs(1.0 + gain * loop)))

    gain = 1e-3 / float(np.max(np.abs(loop)))
    while peak(gain) < _DELIVERED.sensitivity:
        gain *= 1.03
    low, high = gain / 1.03, gain
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if peak(middle) < _DELIVERED.sensitivity else (low, middle)
    return low
