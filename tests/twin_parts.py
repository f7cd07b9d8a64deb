"""Small simulated stages whose behaviour is known, for tests of the twin."""

import math
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import ArrayLike

from flexstage.base.arrays import Array, Complex
from flexstage.hysteresis import (
    Amplifier,
    Duhem,
    ModelDrive,
    ModifiedPrandtlIshlinskii,
    assembled_model,
)
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.stage.limits import AxisLimits
from flexstage.system import MechanicalSystem, ModalDamping
from flexstage.system.environment import Environment
from flexstage.system.servo import ServoSettings
from flexstage.virtual.piezo_loop import sampled_response
from flexstage.virtual.piezo_stage import PiezoAxis, PiezoStage
from flexstage.virtual.sensors import SensorBench
from flexstage.virtual.stack import (
    ChargeDrive,
    StackArrays,
    StackState,
    VirtualStack,
    relaxed_stacks,
    step_stack,
    virtual_stack,
)
from flexstage.virtual.stage import Conditions

#: Slopes of stacks without hysteresis, by axis [m/V].
SLOPES = {"x": 3.1e-7, "y": 2.6e-7}
STAGE = design("vgtu-piezo")


def damped_system() -> MechanicalSystem:
    """Return the model of the study's piezo stage, damped."""
    return lumped_system(STAGE).with_damping(ModalDamping(ratio=0.013))


def straight_stack(slope: float) -> VirtualStack:
    """Return a stack without hysteresis: all its parts are proportional to the voltage."""
    bent = ModifiedPrandtlIshlinskii(
        gain=0.9 * slope,
        thresholds=np.array([7.0, 31.0]),
        weights=np.zeros(2),
        dead_zones=np.array([9e-6]),
        dead_zone_weights=np.zeros(1),
    )
    fading = Duhem(
        rate=0.05,
        anhysteretic=np.array([0.0, 0.1 * slope]),
        tangent=np.array([0.1 * slope]),
        input_range=(0.0, 120.0),
    )
    return VirtualStack(bent=bent, fading=fading)


def small_stage(
    *,
    straight: bool,
    plays: int = 37,
    settings: ServoSettings | None = None,
    sample_rate_hz: float = 10e3,
    creep: LogCreep | None = None,
    largest_rate: float = float("inf"),
    quiet: bool = True,
    sensors: SensorBench | None = None,
    seed: int = 0,
    charge: ChargeDrive | None = None,
    environment: Environment | None = None,
) -> PiezoStage:
    """Return the study's piezo stage with stacks of the test's own, and nothing set or drawn."""
    amplifier = Amplifier(
        bandwidth_hz=2000.0, slew_limit=None if math.isinf(largest_rate) else largest_rate
    )
    parts, drives = [], []
    for name, free, width in (("x", 38e-6, 0.131), ("y", 33e-6, 0.117)):
        stack = straight_stack(SLOPES[name])
        if not straight:
            stack = virtual_stack((0.0, 120.0), free, width, plays=plays)
        drives.append(
            ModelDrive(
                name=name,
                hysteresis=stack,
                amplifier=amplifier,
                creep=creep,
                input_range=(0.0, 120.0),
            )
        )
        parts.append(
            PiezoAxis(
                name=name,
                drive=name,
                probe=name,
                limits=AxisLimits(voltage=(0.0, 120.0), slew=40e3),
            )
        )
    if settings is not None:
        parts = [replace(part, settings=settings) for part in parts]
    return PiezoStage(
        stage=STAGE,
        model=assembled_model(damped_system(), drives),
        axes=parts,
        charge=charge,
        conditions=Conditions(
            sample_rate_hz=sample_rate_hz,
            quiet=quiet,
            scatter=False,
            sensors=sensors or SensorBench(),
            seed=seed,
            environment=environment,
        ),
    )


def free_displacements(arrays: StackArrays, voltage: ArrayLike) -> Array:
    """Return what relaxed stacks do under sequences of voltages, shape (axes, n), with creep."""
    u = np.array(voltage, dtype=np.float64, order="C")
    return _all_steps(arrays, relaxed_stacks(arrays), u, np.empty_like(u))


# not kept: what is kept beside a test would outlive the functions that it calls
@numba.njit(error_model="numpy")
def _all_steps(arrays: StackArrays, state: StackState, u: Array, out: Array) -> Array:
    for a in range(u.shape[0]):
        for k in range(u.shape[1]):
            out[a, k] = step_stack(arrays, state, a, u[a, k])
    return out


def small_signal_response(
    stage: PiezoStage, axis: str, frequency_hz: ArrayLike, *, slope: float
) -> Complex:
    """Return the response from the voltage asked for to the position, for small signals."""
    part = next(part for part in stage.parts if part.name == axis)
    return sampled_response(stage.model, part.drive, part.probe, frequency_hz, slope=slope)
