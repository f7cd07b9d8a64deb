"""Simulated identification and compensation of a piezo stage with its complete dynamic model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexstage.base import progress
from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.files.plain import picked
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.drive_model import DriveModel
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.result import Identification
from flexstage.hysteresis.inversion import feedforward
from flexstage.hysteresis.loops import Tracking, loop_width, tracking
from flexstage.hysteresis.models.registry import MODELS
from flexstage.quantities.characteristic import measured_value
from flexstage.records import Channel, Record
from flexstage.stage import PiezoStack, Stage
from flexstage.stage.assumptions import (
    AMPLIFIER_BANDWIDTH_HZ,
    CREEP,
    LOOP_WIDTH,
    POSITION_NOISE,
)
from flexstage.system import MechanicalSystem, modes
from flexstage.virtual.as_built import loop_share
from flexstage.virtual.stack import matched_stacks, virtual_stack

#: Sample rate [Hz].
SAMPLE_RATE_HZ = 1000.0
#: Rate of the loops [Hz], and their number; the first ones are not compared.
RATE_HZ = 1.0
CYCLES, _FIRST = 6, 3
#: Samples of the loops that are compared, and their beginnings.
LATE = slice(int(_FIRST * SAMPLE_RATE_HZ / RATE_HZ), None)
BOUNDS = np.arange(CYCLES - _FIRST) * int(SAMPLE_RATE_HZ / RATE_HZ)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivenAxis:
    """A virtual stage on a bench with one axis connected."""

    model: DynamicModel
    """Dynamic model with all modes."""
    drive: str
    """Drive of the axis."""
    probe: str
    """Probe of the axis."""
    limits: tuple[float, float]
    """Range of its voltage [V]."""
    resonance_hz: float
    """Lowest natural frequency with the drives in place [Hz]."""

    def run(self, voltage: Array) -> Array:
        """Condition the stage by two cycles, and return the reading under a command [m]."""
        before = self.cosine(2)
        full = np.concatenate((before, voltage))
        return self.model.simulate({self.drive: full}).readings[self.probe][before.size :]

    def record(self, voltage: Array) -> Record:
        """Return command and reading as a record with columns ``voltage`` and ``position``."""
        return Record(
            channels=(
                Channel(name="voltage", values=voltage, unit="V"),
                Channel(name="position", values=self.run(voltage), unit="m"),
            ),
            time=np.arange(voltage.size) / SAMPLE_RATE_HZ,
            source="virtual stage",
        )

    def cosine(self, cycles: int, share: float = 1.0) -> Array:
        """Return cosine cycles about the middle of the range, from their low end to it [V]."""
        low, high = self.limits
        t = np.arange(int(cycles * SAMPLE_RATE_HZ / RATE_HZ)) / SAMPLE_RATE_HZ
        swing = 0.5 * share * (high - low)
        return 0.5 * (low + high) - swing * np.cos(2.0 * np.pi * RATE_HZ * t)


def driven_axis(stage: Stage, system: MechanicalSystem, axis: str, *, seed: int = 0) -> DrivenAxis:
    """Connect an axis: amplifier, virtual stack, creep, all modes of the stage, and a noisy sensor.

    Stroke and loop width are set to published measurements where there are any, since no model
    predicts them. `system` is a model of the stage; `seed` is that of the sensor noise.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> stage = design("vgtu-piezo")
    >>> bench = driven_axis(stage, lumped_system(stage), "x")
    >>> print(f"{np.ptp(bench.run(bench.cosine(3))) * 1e6:.1f} um")
    63.2 um
    """
    port = stage.axis(axis)
    drive = stage.drive_of(axis)
    if not isinstance(drive, PiezoStack) or drive.voltage_range is None:
        raise ModelError(
            f"axis '{axis}' of {stage.name} has no piezo stack with a voltage range: it has no "
            "hysteresis to compensate"
        )
    limits = drive.voltage_range
    lowest = float(modes(system, drives="in place", count=1).frequency_hz[0])
    stroke = measured_value(stage.published, "output_displacement", axis)
    share = LOOP_WIDTH if stroke is None else loop_share(stage, axis, stroke)

    def bench(free: float, width: float) -> DrivenAxis:
        model = dynamic_model(
            stage,
            system,
            time_step=1.0 / SAMPLE_RATE_HZ,
            hysteresis={drive.name: virtual_stack(limits, free, width)},
            creep=LogCreep(rate_per_decade=CREEP),
            bandwidth=AMPLIFIER_BANDWIDTH_HZ,
            sensors={port.probe: Sensor(noise_rms=POSITION_NOISE, seed=seed)},
        )
        return DrivenAxis(
            model=model, drive=drive.name, probe=port.probe, limits=limits, resonance_hz=lowest
        )

    def measure(sizes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        axis_bench = bench(*sizes[0])
        voltage = axis_bench.cosine(CYCLES)
        reading = axis_bench.run(voltage)[LATE]
        swing = float(np.ptp(reading))
        return [(swing, loop_width(voltage[LATE], reading, BOUNDS) / swing)]

    (size,) = matched_stacks([(drive.free_stroke, share)], [(stroke, share)], measure)
    return bench(*size)


#: Share of the reference in the stroke, with a margin for the inverse.
_SHARE = 0.99
#: Candidate models for the designed record.
_MODELS = ("bouc-wen", "preisach")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensatedRun:
    """Compensation of the virtual stage by one inverse model."""

    title: str
    """Name of the model."""
    identification: Identification
    """The identified model."""
    output: Array
    """Reading over the compared cycles [m], shape (n,)."""
    tracking: Tracking
    """Loop width and tracking errors [m]."""
    reduction_percent: float
    """Reduction of the loop width relative to open loop [%]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisExperiment:
    """Results of the experiment on one axis."""

    axis: str
    """The axis."""
    voltage: Array
    """Voltage of the major loop [V], shape (n,)."""
    measured: Array
    """Reading of the virtual sensor [m], shape (n,)."""
    modelled: Array
    """Output of the Bouc-Wen model [m], shape (n,)."""
    deviation: float
    """Largest difference between reading and model [m]."""
    stroke: float
    """Range of the reading over the full voltage range [m]."""
    width: float
    """Width of that loop [m]."""
    time: Array
    """Time of the compared cycles [s], shape (n,)."""
    reference: Array
    """Reference over these cycles [m], shape (n,)."""
    open_output: Array
    """Reading with a voltage proportional to the reference [m], shape (n,)."""
    open_loop: Tracking
    """Loop width and tracking errors in open loop [m]."""
    runs: tuple[CompensatedRun, ...]
    """Results with the inverse of each model."""

    def data(self) -> dict[str, Any]:
        """Return the figures as plain data.

        They are stroke, widths, errors [m], reductions [%], and model errors [%].
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


def _errors(result: Tracking) -> dict[str, float]:
    return picked(result, "loop_width", "tracking_rms=rms", "tracking_max=largest")


def virtual_experiment(
    stage: Stage, system: MechanicalSystem, axis: str, *, seed: int = 0
) -> AxisExperiment:
    """Measure, identify and compensate the hysteresis of one axis of a virtual stage.

    The virtual stage has a complete dynamic model: amplifier, a stack whose class is not among the
    fitted ones, creep, all modes of the stage with the stacks in place, and a noisy sensor. Stroke
    and loop width are published measurements of the stage, if available, as no model predicts them.
    A Bouc-Wen model is identified from full and descending loops at one rate, and inverted, as is
    the best model for a designed record.

    Parameters
    ----------
    stage : Stage
        The stage; a piezo stack with a voltage range drives the axis.
    system : MechanicalSystem
        A model of the stage.
    axis : str
        The axis.
    seed : int
        Seed of the noise of the sensor.

    Returns
    -------
    AxisExperiment
        The loops without and with compensation.

    Raises
    ------
    ModelError
        The axis has no piezo stack with a voltage range, or the stage cannot be actuated.
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
    full_reference = _reference(bench, measured)
    reference = full_reference[LATE]
    open_output = bench.run(bench.cosine(CYCLES, _SHARE))[LATE]
    # open loop with a constant gain and the best offset
    offset = float(np.mean(open_output) - np.mean(reference))
    open_loop = tracking(reference + offset, open_output, BOUNDS)
    runs = []
    for identification in (bouc_wen, best):
        inverse = feedforward(
            identification.model, full_reference, 1.0 / SAMPLE_RATE_HZ, limits=bench.limits
        )
        output = bench.run(inverse.command)[LATE]
        errors = tracking(reference, output, BOUNDS)
        runs.append(
            CompensatedRun(
                title=MODELS[identification.kind].title,
                identification=identification,
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
    """Return a typical record: full loops at one rate, then descending ones."""
    low, high = bench.limits
    t = np.arange(int(10.0 / RATE_HZ * SAMPLE_RATE_HZ)) / SAMPLE_RATE_HZ
    swing = 0.5 * (high - low) * np.interp(t * RATE_HZ, [0.0, 4.0, 10.0], [1.0, 1.0, 0.1])
    voltage = 0.5 * (low + high) - swing * np.cos(2.0 * np.pi * RATE_HZ * t)
    return bench.record(voltage)


def _designed_record(bench: DrivenAxis) -> Record:
    design = excitation(
        bench.limits,
        sample_rate=SAMPLE_RATE_HZ,
        rates=(0.5, 5.0),
        frequency=bench.resonance_hz,
        multisine=False,
        hold_time=5.0,
    )
    return bench.record(design.voltage)


def _modelled(model: DriveModel, bench: DrivenAxis, voltage: Array) -> Array:
    lead_in = bench.cosine(2)
    full_voltage = np.concatenate((lead_in, voltage))
    output = model.simulate(full_voltage, 1.0 / SAMPLE_RATE_HZ, model.conditioned())
    return output[lead_in.size :]


def _reference(bench: DrivenAxis, measured: Array) -> Array:
    """Return a cosine over a share of the stroke, about its middle."""
    low, high = float(measured.min()), float(measured.max())
    unit = (bench.cosine(CYCLES) - bench.limits[0]) / (bench.limits[1] - bench.limits[0])
    return 0.5 * (low + high) + _SHARE * (high - low) * (unit - 0.5)
