"""Experiments on the virtual stage: it is measured, compensated, and centres a scale."""

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import FlexstageError, ModelError
from flexstage.files.cache.memory import Memory
from flexstage.files.plain import picked
from flexstage.quantities.characteristic import Characteristics
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

    def data(self) -> dict[str, Any]:
        """Return what is left of the eccentricity [m] and every step as plain data."""
        return {
            "kind": "virtual experiment",
            **picked(self, "left", "reached=done.reached", "reason=done.reason"),
            "steps": [
                {
                    **picked(step, "kind", "command"),
                    **picked(step.reading.length, "length=value", "interval"),
                    "predicted": None if step.predicted is None else step.predicted.value,
                }
                for step in self.done.steps
            ],
        }


def carry_out(
    stage: Stage,
    system: MechanicalSystem,
    *,
    measure: bool,
    compensate: bool,
    seed: int,
    memory: Memory,
) -> dict[tuple[str, str], Any]:
    """Carry out experiments on the virtual stage; a text says why one could not be.

    It is measured (``characterise``), and centres a scale (``centre``); and the hysteresis of each
    axis that a piezo stack drives is identified and undone (``verify``). Results are by verb and
    the axis or axes that it is about. `system` is the model by which the stage moves fast; the seed
    is that of the virtual stage, of its measurement, of noise, and of the lines of the scale. What
    a memory knows is read.
    """
    both = "".join(axis.name for axis in stage.axes)
    steps: dict[tuple[str, str], partial[Any]] = {}
    if measure:
        steps["characterise", both] = partial(_characterise, stage, seed)
        steps["centre", both] = partial(_centre, stage, seed)
    for axis in stage.axes if compensate else ():
        if axis.drive is not None and isinstance(stage.drive(axis.drive), PiezoStack):
            steps["verify", axis.name] = partial(_verify, stage, system, axis.name)
    found: dict[tuple[str, str], Any] = {}
    for i, (name, step) in enumerate(steps.items()):
        with progress.subtask(i / len(steps), (i + 1) / len(steps)):
            try:
                found[name] = memory.recall(" ".join(name), step.func, *step.args)
            except FlexstageError as error:  # as of a stage that is not held: the rest stands
                found[name] = str(error)
    return found


def _characterise(stage: Stage, seed: int) -> MeasurementComparison:
    """It is made from published values and random errors: its figures are compared with none."""
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.virtual.as_built import as_built

    made = virtual_campaign(as_built(stage, seed=seed), seed=seed)
    return compare_with_references(made.evaluated(), stage, Characteristics())


def _centre(stage: Stage, seed: int) -> CentringTrial:
    from flexstage.centring import ARCSEC, fit_harmonics
    from flexstage.centring.procedure import centre
    from flexstage.experiments.verbs.centre import Centre
    from flexstage.virtual.table import TableMounting, VirtualBench, VirtualPositioner, scale_errors

    # angle of the stage on the table, which trial moves find out [rad]
    mounting_angle = 0.7
    # direction that the scale is off in, in the axes of the stage: one that both can push [rad]
    direction = 0.8

    mounting = TableMounting(angle=mounting_angle, mirrored=True)
    positioner = VirtualPositioner(stage, start=(-1.0, -1.0), mounting=mounting, seed=seed)
    towards = positioner.matrix @ np.array((np.cos(direction), np.sin(direction)))
    mount = -ECCENTRICITY * towards / np.hypot(*towards) - positioner.true_position
    action = Centre(
        radius=SCALE_RADIUS,
        eccentricity=(float(mount[0]), float(mount[1])),
        heads=HEADS,
        mounting_angle=mounting_angle,
        noise=HEAD_NOISE * ARCSEC,
        closed_loop=False,
        seed=seed,
    )
    lines = scale_errors(range(2, 20), LINE_ERRORS * ARCSEC, seed=seed)
    table = replace(action.table(), scale=lines)
    bench = VirtualBench(table, positioner)

    def turn(index: int) -> tuple[Array, Any]:
        x, y = positioner.true_position
        record = table.moved(float(x), float(y)).record(index=index)
        angle, error = (channel.values for channel in record.channels[:2])
        return angle, fit_harmonics(angle, error, orders=12)

    before = turn(1000)
    done = centre(bench.measure, positioner, target=action.target, moves=action.moves)
    after = turn(1001)
    return CentringTrial(
        done=done,
        left=float(np.hypot(*bench.true_eccentricity)),
        fits=(before[1], after[1]),
        angles=(before[0], after[0]),
    )


def _verify(stage: Stage, system: MechanicalSystem, axis: str) -> "AxisExperiment":
    from flexstage.studies.compensation import virtual_experiment

    drive = stage.drive_of(axis)
    if isinstance(drive, PiezoStack) and drive.voltage_range is None:
        raise ModelError(
            f"drive '{drive.name}' has no voltage range: add it to the drive in the stage file, "
            "as in 'voltage_range: [0 V, 120 V]'"
        )
    # its noise is the same whatever stage is measured
    return virtual_experiment(stage, system, axis)
