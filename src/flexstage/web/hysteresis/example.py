"""Records to start from without own data: of a simulated piezo stack, as the manual makes them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis import LogCreep, Sensor, excitation
from flexstage.records import Channel, Record, write_record
from flexstage.virtual import virtual_stack

_RATE_HZ = 400.0


def example_record(folder: Path) -> Path:
    """Write the record of a simulated piezo stack that was driven as `flexstage excite` does."""
    drive = excitation(
        (0.0, 120.0),
        sample_rate=_RATE_HZ,
        duration=16.0,
        rates=(0.5, 5.0),
        frequency=640.0,
        multisine=False,
    )
    return _simulated(folder / "example.csv", drive.voltage, seed=4)


def other_example(folder: Path) -> Path:
    """Write another record of the same simulated stack: 2 Hz, with falling amplitude."""
    t = np.arange(round(12.0 * _RATE_HZ)) / _RATE_HZ
    envelope = np.interp(t, [0.0, 3.0, 12.0], [1.0, 1.0, 0.2])
    return _simulated(
        folder / "example-2-hz.csv", 60.0 - 60.0 * envelope * np.cos(4.0 * np.pi * t), seed=5
    )


def _simulated(path: Path, volts: Sequence[float] | Array, seed: int) -> Path:
    u = np.asarray(volts, dtype=np.float64)
    dt = 1.0 / _RATE_HZ
    free = virtual_stack((0.0, 120.0), 38e-6, 0.13).simulate(u).values
    moved = LogCreep(rate_per_decade=0.015).simulate(free, dt).values
    sensor = Sensor(bandwidth_hz=150.0, noise_rms=8e-9, offset=3.1e-6, seed=seed)
    channels = (
        Channel(name="voltage", values=u, unit="V"),
        Channel(name="position", values=sensor.simulate(moved, dt).values, unit="m"),
    )
    return write_record(
        Record(channels=channels, time=np.arange(u.size, dtype=np.float64) * dt), path
    )
