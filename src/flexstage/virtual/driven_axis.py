"""One axis of a virtual piezo stage on a bench: its full dynamics, driven by a voltage."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.hysteresis.build_model import dynamic_model
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.sensor import Sensor
from flexstage.hysteresis.dynamic_model import DynamicModel
from flexstage.hysteresis.loops import loop_width
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
