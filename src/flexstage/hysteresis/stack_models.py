"""What a drive of a stage does between its command and its free displacement."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from flexstage.base.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.dynamic_model import DynamicModel, ModelDrive
from flexstage.hysteresis.loops import loop_width
from flexstage.hysteresis.model import Array, HysteresisModel
from flexstage.hysteresis.models.bouc_wen.law import BoucWen
from flexstage.stage import Drive, PiezoStack, Stage
from flexstage.stage.assumptions import LOOP_WIDTH

#: What a stack does, by drive or axis; or a word for all of them.
Hysteresis = Mapping[str, HysteresisModel | DriveModel] | Literal["usual", "none"]

# A model in um instead of m is a million times off; a stack differs from its data sheet by less.
_STROKE_FACTOR = 5.0

_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}


def usual_hysteresis(stack: PiezoStack) -> BoucWen:
    """Return a Bouc-Wen model with the stroke of a stack and a usual width of its loop.

    It goes from voltage [V] to free displacement [m]; the width of the loop is `LOOP_WIDTH` of the
    stroke.

    Notes
    -----
    Validity: a stand-in until a stack has been measured: stroke by its data sheet, loop by what is
    usual. `flexstage identify` gives the model of a real one.

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
    low, high = stack.voltage_range
    span = high - low
    line = np.linspace(low, high, 600)
    cycle = np.concatenate((line, line[::-1][1:]))
    u = np.concatenate((cycle, *(cycle[1:],) * 3))
    bounds = np.arange(5) * (cycle.size - 1)
    # beta + gamma is 6 over the range: past half of it h has settled but for some per cent

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
        return loop_width(voltage, y, ends) / float(np.ptp(y)) - LOOP_WIDTH

    share = float(brentq(excess, 1e-4, 0.79, xtol=1e-12))  # type: ignore[arg-type]
    stroke = float(np.ptp(settled(made(share))[1]))
    return made(share, stack.free_stroke / stroke)


def models_by_drive(stage: Stage, given: Hysteresis) -> dict[str, HysteresisModel | DriveModel]:
    """Return models by drive from those given by drive or axis, or by a word for all stacks."""
    stacks = {d.name: d for d in stage.drives if isinstance(d, PiezoStack)}
    if isinstance(given, str):
        if given not in ("usual", "none"):
            raise ModelError(f"hysteresis is a model for each drive, usual or none, got '{given}'")
        return {n: usual_hysteresis(d) for n, d in stacks.items()} if given == "usual" else {}
    by_axis = {axis.name: axis.drive or "" for axis in stage.axes}
    made: dict[str, HysteresisModel | DriveModel] = {}
    for name, model in given.items():
        target = name if name in {d.name for d in stage.drives} else by_axis.get(name, "")
        if target not in stacks:
            known = ", ".join(stacks) or "none"
            raise ModelError(
                f"'{name}' is no piezo stack, nor an axis of one, so it has no hysteresis: the "
                f"stacks of '{stage.name}' are {known}"
            )
        made[target] = model
    return made


def scale_of(model: DynamicModel, stack: PiezoStack, given: DriveModel) -> float:
    """Return the free displacement over what a model of the reading of an axis gives."""
    if given.input_unit not in ("V", "") or given.output_unit not in _LENGTHS:
        raise ModelError(
            f"the model of drive '{stack.name}' goes from {given.input_unit or 'nothing'} to "
            f"{given.output_unit or 'nothing'}: it must go from V to one of {', '.join(_LENGTHS)}"
        )
    read = [axis.probe for axis in model.system.axes if axis.drives == (stack.name,)]
    static = model.static_gain(stack.name, read[0]) if read else 0.0
    if static == 0.0:
        raise ModelError(
            f"no axis is moved by drive '{stack.name}', so a model of its reading says nothing of "
            "its stack: give the stage file an axis"
        )
    return given.sign * _LENGTHS[given.output_unit] / static


def drive_of(
    drive: Drive,
    model: HysteresisModel | DriveModel | None,
    creep: Creep | None,
    bandwidth_hz: float | None,
    current_limit: float | None,
) -> ModelDrive:
    """Return what lies before the free displacement of a drive.

    Creep is that of an identified model, else the one given, of a stack with hysteresis.
    """
    hysteresis, own = (
        (model.hysteresis, model.creep) if isinstance(model, DriveModel) else (model, None)
    )
    gain, unit, allowed = 1.0, "m" if drive.spring != 0.0 else "N", None
    if isinstance(drive, PiezoStack) and drive.voltage_range is not None:
        allowed, unit = drive.voltage_range, "V"
        gain = drive.free_stroke / (drive.voltage_range[1] - drive.voltage_range[0])
    if hysteresis is not None:
        unit, own = "V", own or creep
    amplifier = _amplifier_of(drive, bandwidth_hz, current_limit)
    return ModelDrive(
        name=drive.name,
        kind=drive.kind,
        unit=unit,
        gain=gain,
        hysteresis=hysteresis,
        amplifier=amplifier if unit == "V" else None,
        creep=own,
        input_range=allowed,
    )


def _amplifier_of(
    drive: Drive, bandwidth_hz: float | None, current_limit: float | None
) -> Amplifier | None:
    """Return the amplifier of a stack, with its range of voltage.

    None for other drives, and where there is no bandwidth [Hz].
    """
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


def refuse_stroke(stack: PiezoStack, model: HysteresisModel, scale: float = 1.0) -> None:
    """Refuse a model whose stroke over the voltage range is far from the free stroke.

    That is, five times larger or smaller; `scale` is the free displacement over what the model
    gives.
    """
    if stack.voltage_range is None:
        return
    ends = model.simulate(np.array(stack.voltage_range)).values
    stroke = float(abs(scale * (ends[1] - ends[0])))
    if not stack.free_stroke / _STROKE_FACTOR < stroke < stack.free_stroke * _STROKE_FACTOR:
        low, high = stack.voltage_range
        raise ModelError(
            f"the model of drive '{stack.name}' moves {stroke:.3g} m from {low:g} to {high:g} V, "
            f"and the stack's free stroke is {stack.free_stroke:.3g} m: its output must be the "
            "free displacement in m, and its input the voltage in V"
        )
