"""The plant of a stage, with the data of its stacks."""

from collections.abc import Mapping

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.model import HysteresisModel
from flexstage.hysteresis.plant import DriveChain, Plant
from flexstage.stage import PiezoStack, Stage
from flexstage.system import MechanicalSystem

# A model in um instead of m is a million times off; a stack differs from its data sheet by less.
_STROKE_FACTOR = 5.0


def stage_plant(
    stage: Stage,
    system: MechanicalSystem,
    models: Mapping[str, HysteresisModel],
    *,
    creep: Creep | None = None,
    bandwidth_hz: float | None = None,
    current_limit: float | None = None,
    sensors: Mapping[str, Sensor] | None = None,
) -> Plant:
    """Return the plant of a stage, with the voltage range and capacitance of its stacks.

    Parameters
    ----------
    stage : Stage
        The stage, whose drives hold the data of their stacks.
    system : MechanicalSystem
        A model of the stage.
    models : Mapping
        For each drive, or axis, the hysteresis from voltage [V] to free displacement [m].
    creep : Creep, optional
        Creep of every stack; none where not given.
    bandwidth_hz : float, optional
        Bandwidth of the amplifiers [Hz]; the command is the voltage where not given.
    current_limit : float, optional
        Largest current of an amplifier [A].
    sensors : Mapping, optional
        Sensors by probe.

    Returns
    -------
    Plant
        The plant.

    Raises
    ------
    ModelError
        A name is neither a drive nor an axis, a drive is no stack, a current limit is given without
        bandwidth or for a stack without capacitance, or the stroke of a model is far from the
        stack's.
    """
    if current_limit is not None and bandwidth_hz is None:
        raise ModelError("a current limit belongs to an amplifier: give its bandwidth too")
    by_axis = {axis.name: axis.drive for axis in system.axes}
    by_name = {drive.name: drive for drive in stage.drives}
    chains: dict[str, DriveChain] = {}
    for name, model in models.items():
        drive = by_name.get(name) or by_name.get(by_axis.get(name, ""))
        if drive is None:
            known = ", ".join([*by_name, *by_axis])
            raise ModelError(f"'{name}' is neither a drive nor an axis: the stage has {known}")
        if not isinstance(drive, PiezoStack):
            raise ModelError(
                f"drive '{drive.name}' is no piezo stack but a {drive.kind}: it has no hysteresis"
            )
        refuse_stroke(drive, model)
        amplifier = None
        if bandwidth_hz is not None:
            amplifier = _amplifier(drive, bandwidth_hz, current_limit)
        chains[drive.name] = DriveChain(
            model=model, amplifier=amplifier, creep=creep, voltage_range=drive.voltage_range
        )
    return Plant(system=system, drives=chains, sensors=dict(sensors or {}))


def _amplifier(stack: PiezoStack, bandwidth_hz: float, current_limit: float | None) -> Amplifier:
    if current_limit is not None and stack.capacitance is None:
        raise ModelError(
            f"drive '{stack.name}' has no capacitance, which turns the current limit into a rate: "
            "add it to the stage file, or leave the limit out"
        )
    return Amplifier(
        bandwidth_hz=bandwidth_hz,
        capacitance=stack.capacitance or 0.0,
        current_limit=current_limit,
        voltage_range=stack.voltage_range,
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
