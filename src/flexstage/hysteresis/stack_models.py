"""Models of the drives of a stage, from command to free displacement."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.hysteresis.loops import settled_loop
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.stage import Drive, PiezoStack, Stage
from flexstage.stage.assumptions import LOOP_WIDTH

#: Model of a stack by drive or axis, or one word for all stacks.
Hysteresis = Mapping[str, HysteresisModel | DriveModel] | Literal["usual", "none"]

# Largest ratio of the strokes of a model and a data sheet; a wrong unit gives at least 1000.
_STROKE_FACTOR = 5.0

_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}


def usual_hysteresis(stack: PiezoStack) -> BoucWen:
    """Return a Bouc-Wen model with the stroke of a stack and a usual loop width.

    It is from voltage [V] to free displacement [m]; the width of the loop is `LOOP_WIDTH` of the
    stroke.

    Notes
    -----
    Validity: a substitute until the stack is measured: stroke by its data sheet, usual loop width.
    `flexstage identify` returns the model of a real stack.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> model = usual_hysteresis(design("vgtu-piezo").drives[0])
    >>> ends = model.simulate([120.0, 0.0, 120.0, 0.0]).values
    >>> round(float(ends[2] - ends[3]) * 1e6, 3)
    38.0
    """
    if stack.voltage_range is None:
        raise ModelError(
            f"drive '{stack.name}' has no voltage range, which its hysteresis needs: add it to the "
            "drive in the stage file, as in 'voltage_range: [0 V, 120 V]', or export without "
            "hysteresis (--hysteresis none)"
        )
    voltages = stack.voltage_range
    span = voltages[1] - voltages[0]
    # beta + gamma is 6 over the range: past half of it h has settled within a few per cent

    def bouc_wen(share: float, gain: float = 1.0) -> BoucWen:
        return BoucWen(
            gain=gain / span, hysteresis_gain=share * gain / span, beta=3.7 / span, gamma=2.3 / span
        )

    def excess(share: float) -> float:
        width, stroke = settled_loop(bouc_wen(share), voltages, 600)
        return width / stroke - LOOP_WIDTH

    share = float(brentq(excess, 1e-4, 0.79, xtol=1e-12))  # type: ignore[arg-type]
    _, stroke = settled_loop(bouc_wen(share), voltages, 600)
    return bouc_wen(share, stack.free_stroke / stroke)


def models_by_drive(
    stage: Stage, hysteresis: Hysteresis
) -> dict[str, HysteresisModel | DriveModel]:
    """Return models by drive, from models by drive or axis or one word for all stacks."""
    stacks = {d.name: d for d in stage.drives if isinstance(d, PiezoStack)}
    if isinstance(hysteresis, str):
        if hysteresis not in ("usual", "none"):
            raise ModelError(
                f"hysteresis is a model for each drive, usual or none, got '{hysteresis}'"
            )
        return {n: usual_hysteresis(d) for n, d in stacks.items()} if hysteresis == "usual" else {}
    by_axis = {axis.name: axis.drive or "" for axis in stage.axes}
    models: dict[str, HysteresisModel | DriveModel] = {}
    for name, model in hysteresis.items():
        target = name if name in {d.name for d in stage.drives} else by_axis.get(name, "")
        if target not in stacks:
            stack_names = ", ".join(stacks) or "none"
            raise ModelError(
                f"'{name}' is no piezo stack, nor an axis of one, so it has no hysteresis: the "
                f"stacks of '{stage.name}' are {stack_names}"
            )
        models[target] = model
    return models


def scale_of(model: DynamicModel, stack: PiezoStack, identified: DriveModel) -> float:
    """Return the free displacement over the output of a model of the reading of an axis."""
    if identified.input_unit not in ("V", "") or identified.output_unit not in _LENGTHS:
        raise ModelError(
            f"the model of drive '{stack.name}' is from {identified.input_unit or 'no unit'} to "
            f"{identified.output_unit or 'no unit'}: it must be from V to "
            f"one of {', '.join(_LENGTHS)}"
        )
    probes = [axis.probe for axis in model.system.axes if axis.drives == (stack.name,)]
    static = model.static_gain(stack.name, probes[0]) if probes else 0.0
    if static == 0.0:
        raise ModelError(
            f"drive '{stack.name}' moves no axis, so that a model of a reading does not determine "
            "its stack: add an axis to the stage file"
        )
    return identified.sign * _LENGTHS[identified.output_unit] / static


def drive_of(
    drive: Drive,
    model: HysteresisModel | DriveModel | None,
    creep: Creep | None,
    bandwidth_hz: float | None,
    current_limit: float | None,
) -> ModelDrive:
    """Return the model of a drive, from command to free displacement.

    Creep is that of an identified model, otherwise the given one, for a stack with hysteresis.
    """
    hysteresis, creep_used = (
        (model.hysteresis, model.creep) if isinstance(model, DriveModel) else (model, None)
    )
    gain, unit, allowed = 1.0, "m" if drive.spring != 0.0 else "N", None
    if isinstance(drive, PiezoStack) and drive.voltage_range is not None:
        allowed, unit = drive.voltage_range, "V"
        gain = drive.free_stroke / (drive.voltage_range[1] - drive.voltage_range[0])
    if hysteresis is not None:
        unit, creep_used = "V", creep_used or creep
    amplifier = _amplifier_of(drive, bandwidth_hz, current_limit)
    return ModelDrive(
        name=drive.name,
        kind=drive.kind,
        unit=unit,
        gain=gain,
        hysteresis=hysteresis,
        amplifier=amplifier if unit == "V" else None,
        creep=creep_used,
        input_range=allowed,
    )


def _amplifier_of(
    drive: Drive, bandwidth_hz: float | None, current_limit: float | None
) -> Amplifier | None:
    """Return the amplifier of a stack, with its voltage range.

    None for other drives, and without a bandwidth [Hz].
    """
    if not isinstance(drive, PiezoStack) or bandwidth_hz is None:
        if current_limit is not None and bandwidth_hz is None:
            raise ModelError("a current limit needs an amplifier: give its bandwidth too")
        return None
    if current_limit is not None and drive.capacitance is None:
        raise ModelError(
            f"drive '{drive.name}' has no capacitance, which the current limit needs: add it to "
            "the stage file, or omit the limit"
        )
    return Amplifier(
        bandwidth_hz=bandwidth_hz,
        capacitance=drive.capacitance or 0.0,
        current_limit=current_limit,
        slew_limit=drive.largest_slew,
        voltage_range=drive.voltage_range,
    )


def refuse_stroke(stack: PiezoStack, model: HysteresisModel, scale: float = 1.0) -> None:
    """Refuse a model whose stroke over the voltage range is far from the free stroke.

    That is, five times larger or smaller; `scale` is the free displacement over the output of the
    model.
    """
    if stack.voltage_range is None:
        return
    ends = model.simulate(np.array(stack.voltage_range)).values
    stroke = float(abs(scale * (ends[1] - ends[0])))
    if not stack.free_stroke / _STROKE_FACTOR < stroke < stack.free_stroke * _STROKE_FACTOR:
        low, high = stack.voltage_range
        raise ModelError(
            f"the stroke of the model of drive '{stack.name}' is {stroke:.3g} m from {low:g} to "
            f"{high:g} V, and the free stroke of the stack is {stack.free_stroke:.3g} m: the "
            "output of the model must be the free displacement in m, and its input the voltage in V"
        )
