"""Identification and compensation of a piezo stage, carried out on its entire dynamic model."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.files.plain import picked
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.result import Identification
from flexstage.hysteresis.inversion import feedforward
from flexstage.hysteresis.loops import Tracking, loop_width, tracking
from flexstage.hysteresis.models.registry import MODELS
from flexstage.records import Record
from flexstage.stage import Stage
from flexstage.system import MechanicalSystem
from flexstage.virtual.driven_axis import (
    BOUNDS,
    CYCLES,
    LATE,
    RATE_HZ,
    SAMPLE_RATE_HZ,
    DrivenAxis,
    driven_axis,
)

#: Share of the stroke that the reference runs over, which leaves the inverse some room.
_SHARE = 0.99
#: Models that are tried on the designed record.
_MODELS = ("bouc-wen", "preisach")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedRun:
    """One inverse on the virtual stage."""

    title: str
    """What it is called."""
    identification: Identification
    """The model whose inverse it is."""
    output: Array
    """Reading over the compared cycles [m], shape (n,)."""
    tracking: Tracking
    """Width of the loop, and errors [m]."""
    reduction_percent: float
    """By how much the loop is narrower than in open loop [%]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisExperiment:
    """What the experiment gave on one axis."""

    axis: str
    """The axis."""
    voltage: Array
    """Voltage of the major loop [V], shape (n,)."""
    measured: Array
    """Reading of the virtual sensor [m], shape (n,)."""
    modelled: Array
    """What the Bouc-Wen model gives there [m], shape (n,)."""
    deviation: float
    """Largest difference of the two over the loop [m]."""
    stroke: float
    """Range of the reading over the whole range of the voltage [m]."""
    width: float
    """Width of that loop [m]."""
    time: Array
    """Time of the compared cycles [s], shape (n,)."""
    reference: Array
    """What was wanted over them [m], shape (n,)."""
    open_output: Array
    """Reading with the voltage in proportion to the reference [m], shape (n,)."""
    open_loop: Tracking
    """Width of that loop, and errors [m]."""
    runs: tuple[CompensatedRun, ...]
    """With the inverse of each model."""

    def data(self) -> dict[str, Any]:
        """Return its figures as plain data.

        Stroke, widths, errors [m], reductions [%], and how good each model is [%].
        """
        return {
            "kind": "virtual experiment",
            **picked(self, "stroke", "loop_width=width", "model_deviation=deviation"),
            "open_loop": _errors(self.open_loop),
            "runs": [
                {
                    **picked(
                        run.identification, "model=kind", "rms_percent", "heldout_rms_percent"
                    ),
                    "reduction_percent": run.reduction_percent,
                    **_errors(run.tracking),
                }
                for run in self.runs
            ],
        }


def _errors(tracked: Tracking) -> dict[str, float]:
    return picked(tracked, "loop_width", "tracking_rms=rms", "tracking_max=largest")


def virtual_experiment(
    stage: Stage, system: MechanicalSystem, axis: str, *, seed: int = 0
) -> AxisExperiment:
    """Measure, identify and compensate the hysteresis of one axis of a virtual stage.

    It is carried out on the entire dynamic model: amplifier, a stack of a class that is not fitted,
    creep, all modes of the stage with the stacks in place, and a noisy sensor. Its stroke and the
    width of its loop are set to what was measured of the stage, where that is published, since no
    model knows them; everything else follows. A Bouc-Wen model is identified from loops at one
    rate, full ones and falling ones, and inverted; beside it the model that is best on a designed
    record.

    Parameters
    ----------
    stage : Stage
        The stage; its axis is driven by a piezo stack with a voltage range.
    system : MechanicalSystem
        A model of the stage.
    axis : str
        The axis.
    seed : int
        Seed of the noise of the sensor.

    Returns
    -------
    AxisExperiment
        The loops, and what the inverses leave of them.

    Raises
    ------
    ModelError
        The axis has no piezo stack with a voltage range, or the stage cannot be driven.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> made = virtual_experiment(stage, lumped_system(stage), "x")
    >>> made.open_loop.loop_width > 7e-6 and made.runs[0].reduction_percent > 93.0
    True
    """
    bench = driven_axis(stage, system, axis, seed=seed)
    first = _study_record(bench)
    progress.update(f"hysteresis, {axis}", 0.2)
    bouc_wen = identify(first, "voltage", "position", model="bouc-wen")
    progress.update(f"hysteresis, {axis}", 0.4)
    best = identify(_designed_record(bench), "voltage", "position", model=_MODELS)
    voltage = bench.cosine(CYCLES)
    measured = bench.run(voltage)[LATE]
    modelled = _modelled(bouc_wen.model, bench, voltage)[LATE]
    difference = measured - modelled
    whole = _reference(bench, measured)
    reference = whole[LATE]
    open_output = bench.run(bench.cosine(CYCLES, _SHARE))[LATE]
    # what a constant gain, and the best offset, would have given
    offset = float(np.mean(open_output) - np.mean(reference))
    open_loop = tracking(reference + offset, open_output, BOUNDS)
    runs = []
    for found in (bouc_wen, best):
        made = feedforward(found.model, whole, 1.0 / SAMPLE_RATE_HZ, limits=bench.limits)
        output = bench.run(made.command)[LATE]
        errors = tracking(reference, output, BOUNDS)
        runs.append(
            CompensatedRun(
                title=MODELS[found.kind].title,
                identification=found,
                output=output,
                tracking=errors,
                reduction_percent=100.0 * (1.0 - errors.loop_width / open_loop.loop_width),
            )
        )
    return AxisExperiment(
        axis=axis,
        voltage=voltage[LATE],
        measured=measured,
        modelled=modelled + float(np.mean(difference)),
        deviation=float(np.max(np.abs(difference - np.mean(difference)))),
        stroke=float(np.ptp(measured)),
        width=loop_width(voltage[LATE], measured, BOUNDS),
        time=np.arange(open_output.size) / SAMPLE_RATE_HZ,
        reference=reference,
        open_output=open_output - offset,
        open_loop=open_loop,
        runs=tuple(runs),
    )


def _study_record(bench: DrivenAxis) -> Record:
    """Full loops at one rate, then falling ones: what is usually recorded."""
    low, high = bench.limits
    t = np.arange(int(10.0 / RATE_HZ * SAMPLE_RATE_HZ)) / SAMPLE_RATE_HZ
    swing = 0.5 * (high - low) * np.interp(t * RATE_HZ, [0.0, 4.0, 10.0], [1.0, 1.0, 0.1])
    voltage = 0.5 * (low + high) - swing * np.cos(2.0 * np.pi * RATE_HZ * t)
    return bench.record(voltage)


def _designed_record(bench: DrivenAxis) -> Record:
    made = excitation(
        bench.limits,
        sample_rate=SAMPLE_RATE_HZ,
        rates=(0.5, 5.0),
        frequency=bench.resonance_hz,
        multisine=False,
        hold_time=5.0,
    )
    return bench.record(made.voltage)


def _modelled(model: DriveModel, bench: DrivenAxis, voltage: Array) -> Array:
    before = bench.cosine(2)
    whole = np.concatenate((before, voltage))
    return model.simulate(whole, 1.0 / SAMPLE_RATE_HZ, model.conditioned())[before.size :]


def _reference(bench: DrivenAxis, measured: Array) -> Array:
    """A cosine over the share of the stroke that the inverse is given, about its middle."""
    low, high = float(measured.min()), float(measured.max())
    unit = (bench.cosine(CYCLES) - bench.limits[0]) / (bench.limits[1] - bench.limits[0])
    return 0.5 * (low + high) + _SHARE * (high - low) * (unit - 0.5)
