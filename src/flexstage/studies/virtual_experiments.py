"""Experiments on the virtual stage: it is measured, compensated, and centres a scale."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage import progress
from flexstage.arrays import Array
from flexstage.characteristic import Characteristics
from flexstage.errors import FlexstageError
from flexstage.stage import PiezoStack, Stage
from flexstage.studies.measurement import MeasurementComparison, compare_with_references
from flexstage.system import MechanicalSystem

if TYPE_CHECKING:
    from flexstage.centring.harmonic_fit import HarmonicFit
    from flexstage.centring.procedure import Centring
    from flexstage.studies.compensation import AxisExperiment

#: The scale that is centred: where it is read [m], how far it is off at first [m], and its heads.
SCALE_RADIUS, ECCENTRICITY = 50e-3, 50e-6
HEADS = (0.0, 1.6, 3.1, 4.8)
#: Noise of a head, and errors of the lines of the scale [arcsec].
HEAD_NOISE, LINE_ERRORS = 1.0, 2.0
#: Direction that the scale is off in, in the axes of the stage: one that both can push [rad].
_DIRECTION = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringTrial:
    """A scale that was centred on the virtual table."""

    done: "Centring"
    """The procedure, step by step."""
    left: float
    """Eccentricity that is truly left [m]."""
    fits: "tuple[HarmonicFit, HarmonicFit]"
    """Readings of the first head before and after."""
    angles: tuple[Array, Array]
    """Angles of their samples [rad]."""


def run_measurement(stage: Stage, *, seed: int) -> MeasurementComparison | str:
    """Measure a virtual stage; a text says why that could not be done.

    It is made from published values and random errors, so that its figures are compared with none.
    The seed is that of the virtual stage and of its measurement.
    """
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.virtual.as_built import as_built

    try:
        made = virtual_campaign(as_built(stage, seed=seed), seed=seed)
        found = made.evaluated()
    except FlexstageError as error:
        return str(error)
    return compare_with_references(found, stage, Characteristics())


def run_centring(stage: Stage, *, seed: int) -> CentringTrial | str:
    """Centre a scale with the virtual stage on a virtual table; a text says why it failed.

    The seed is that of noise and of the lines of the scale.
    """
    from flexstage.centring import ARCSEC, fit_harmonics
    from flexstage.centring.procedure import centre
    from flexstage.virtual.positioner import VirtualPositioner
    from flexstage.virtual.table import VirtualBench, VirtualTable, scale_errors

    try:
        positioner = VirtualPositioner(
            stage, start=(-1.0, -1.0), mounting_angle=0.7, mirrored=True, seed=seed
        )
        towards = positioner.matrix @ np.array((np.cos(_DIRECTION), np.sin(_DIRECTION)))
        mount = -ECCENTRICITY * towards / np.hypot(*towards) - positioner.true_position
        table = VirtualTable(
            radius=SCALE_RADIUS,
            heads=HEADS,
            eccentricity=(float(mount[0]), float(mount[1])),
            noise=HEAD_NOISE * ARCSEC,
            scale=scale_errors(range(2, 20), LINE_ERRORS * ARCSEC, seed=seed),
            seed=seed,
        )
        bench = VirtualBench(table, positioner)

        def turn(index: int) -> tuple[Array, Any]:
            x, y = positioner.true_position
            record = table.moved(float(x), float(y)).record(index=index)
            angle, error = (channel.values for channel in record.channels[:2])
            return angle, fit_harmonics(angle, error, orders=12)

        before = turn(1000)
        done = centre(bench.measure, positioner)
        after = turn(1001)
    except FlexstageError as error:
        return str(error)
    return CentringTrial(
        done=done,
        left=float(np.hypot(*bench.true_eccentricity)),
        fits=(before[1], after[1]),
        angles=(before[0], after[0]),
    )


def run_experiments(
    stage: Stage, system: MechanicalSystem
) -> "tuple[dict[str, AxisExperiment], dict[str, str]]":
    """Identify and compensate each axis of a stage that is driven by a piezo stack.

    Returns the experiment by axis, and why it could not be made, by axis; both are empty where no
    axis has a stack.
    """
    from flexstage.studies.compensation import virtual_experiment

    stacks = {a.name: stage.drive(a.drive) for a in stage.axes}
    stacks = {name: d for name, d in stacks.items() if isinstance(d, PiezoStack)}
    driven = [name for name, stack in stacks.items() if stack.voltage_range is not None]
    made: dict[str, AxisExperiment] = {}
    left_out = {
        name: f"drive '{stack.name}' has no voltage range: add it to the drive in the stage file, "
        "as in 'voltage_range: [0 V, 120 V]'"
        for name, stack in stacks.items()
        if stack.voltage_range is None
    }
    for i, axis in enumerate(driven):
        with progress.subtask(i / len(driven), (i + 1) / len(driven)):
            try:
                made[axis] = virtual_experiment(stage, system, axis)
            except FlexstageError as error:  # as of a stage that is not held: the rest stands
                left_out[axis] = str(error)
    return made, left_out
