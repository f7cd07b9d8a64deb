"""Samples of commands and readings with which a target is checked."""

from dataclasses import dataclass

import numpy as np

from flexstage.export.model import DynamicModel, ModelDrive
from flexstage.hysteresis.model import Array

_COUNT = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckSamples:
    """Commands, and what the stage reads under them, from rest at zero commands."""

    commands: Array
    """Commands in order of the drives, exact in single precision too, shape (n, m)."""
    readings: Array
    """Readings in order of the probes, shape (n, p)."""


def command_span(model: DynamicModel, drive: ModelDrive) -> tuple[float, float]:
    """Return between what a drive may well be commanded [unit of the command].

    Its range where that is known, else its stroke or largest force to both sides, else 10 um or
    1 N.
    """
    if drive.input_range is not None:
        return drive.input_range
    port = model.system.drive(drive.name)
    size = port.largest_force if drive.unit == "N" else port.stroke
    if not size:
        size = 1.0 if drive.unit == "N" else 1e-5
    if drive.unit == "V" and drive.gain != 0.0:
        size = abs(size / drive.gain)
    return -size, size


def check_samples(model: DynamicModel, count: int = _COUNT) -> CheckSamples:
    """Return commands that take every drive through loops, steps and rest, and the readings.

    They are stepped one sample at a time, as a target steps.
    """
    share = np.arange(1, count + 1) / count
    commands = np.empty((count, len(model.drives)))
    for j, drive in enumerate(model.drives):
        low, high = command_span(model, drive)
        loops = 0.5 - 0.5 * np.cos(2.0 * np.pi * (3.0 + 1.3 * j) * share)
        commands[:, j] = low + (high - low) * (0.05 + 0.8 * loops * (1.0 - 0.45 * share))
        # a step up in the first half, one down in the second, and rest at the end
        commands[int(count * (0.31 + 0.07 * j)) : count // 2, j] += 0.08 * (high - low)
        commands[int(0.88 * count) :, j] = low + (0.37 + 0.1 * (j % 3)) * (high - low)
    commands = commands.astype(np.float32).astype(np.float64)
    memory = model.settled()
    readings = np.empty((count, len(model.probes)))
    for i in range(count):
        u = {d.name: commands[i : i + 1, j] for j, d in enumerate(model.drives)}
        read, memory = model.simulate(u, memory)
        readings[i] = [read[p.name][0] for p in model.probes]
    return CheckSamples(commands=commands, readings=readings)
