"""Experiments on the virtual stage: measurement, hysteresis compensation, centring of a scale."""

from collections.abc import Sequence
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
    from flexstage.fem.stroke import FiniteStroke
    from flexstage.studies.compensation import AxisExperiment
    from flexstage.virtual.neck_widths import NeckWidths

#: Scale of the centring: radius and initial eccentricity [m], and angles of its heads [rad].
SCALE_RADIUS, ECCENTRICITY = 50e-3, 50e-6
HEADS = (0.0, 1.6, 3.1, 4.8)
#: Noise of a head, and graduation errors of the scale [arcsec].
HEAD_NOISE, LINE_ERRORS = 1.0, 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentringTrial:
    """Simulated centring of a scale on the virtual table."""

    procedure: "Centring"
    """Steps and result of the procedure."""
    residual: float
    """True residual eccentricity [m]."""
    fits: "tuple[HarmonicFit, HarmonicFit]"
    """Readings of the first head before and after."""
    angles: tuple[Array, Array]
    """Angles of the readings [rad]."""

    def data(self) -> dict[str, Any]:
        """Return the residual eccentricity [m] and all steps as plain data."""
        return {
            "kind": "virtual experiment",
            **picked(self, "residual", "reached=procedure.reached", "reason=procedure.reason"),
            "steps": [
                {
                    **picked(step, "kind", "command"),
                    **picked(step.reading.length, "length=value", "interval"),
                    "predicted": None if step.predicted is None else step.predicted.value,
                }
                for step in self.procedure.steps
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
    strokes: "Sequence[FiniteStroke]" = (),
    widths: "NeckWidths | None" = None,
) -> dict[tuple[str, str], Any]:
    """Return the results of experiments on the virtual stage, or the reasons for missing ones.

    Experiments are the measurement of the stage (``characterise``), the centring of a scale
    (``centre``), and the identification and compensation of the hysteresis of each axis with a
    piezo stack (``verify``). Results are by verb and axes. `system` is the dynamic model of the
    stage, `strokes` are paths over the stroke by finite elements, if there are any, and `widths`
    are measured necks. The seed is that of the virtual stage, its measurement, noise, and
    graduation errors. Results in the memory are not computed again.
    """
    both = "".join(axis.name for axis in stage.axes)
    steps: dict[tuple[str, str], partial[Any]] = {}
    if measure:
        steps["characterise", both] = partial(_characterise, stage, seed, tuple(strokes), widths)
        steps["centre", both] = partial(_centre, stage, seed)
    for axis in stage.axes if compensate else ():
        if axis.drive is not None and isinstance(stage.drive(axis.drive), PiezoStack):
            steps["verify", axis.name] = partial(_verify, stage, system, axis.name)
    results: dict[tuple[str, str], Any] = {}
    for i, (name, step) in enumerate(steps.items()):
        with progress.subtask(i / len(steps), (i + 1) / len(steps)):
            try:
                results[name] = memory.recall(" ".join(name), step.func, *step.args)
            except FlexstageError as error:  # such as for an unconstrained stage
                results[name] = str(error)
    return results


def _characterise(
    stage: Stage, seed: int, strokes: "tuple[FiniteStroke, ...]", widths: "NeckWidths | None"
) -> MeasurementComparison:
    """Return simulated measurements without references, as published values are their input."""
    from flexstage.experiments.virtual_campaign import virtual_campaign
    from flexstage.virtual.as_built import as_built

    paths = {path.axis: path for path in strokes}
    built = as_built(stage, seed=seed, strokes=paths, widths=widths)
    campaign = virtual_campaign(built, seed=seed)
    return compare_with_references(campaign.evaluated(), stage, Characteristics())


def _centre(stage: Stage, seed: int) -> CentringTrial:
    from flexstage.centring import ARCSEC, fit_harmonics
    from flexstage.centring.procedure import centre
    from flexstage.experiments.verbs.centre import Centre
    from flexstage.virtual.table import TableMounting, VirtualBench, VirtualPositioner, scale_errors

    # angle of the stage on the table, which calibration moves determine [rad]
    mounting_angle = 0.7
    # direction of the eccentricity in the axes of the stage, within reach of both [rad]
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
    procedure = centre(bench.measure, positioner, target=action.target, moves=action.moves)
    after = turn(1001)
    return CentringTrial(
        procedure=procedure,
        residual=float(np.hypot(*bench.true_eccentricity)),
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
    # the seed of the noise is the default one for every stage
    return virtual_experiment(stage, system, axis)
