"""What the virtual stage is measured with: sensors whose errors are drawn as they are stated."""

from dataclasses import dataclass, field

import numpy as np

from flexstage.arrays import Array
from flexstage.experiment.uncertainty.sensor import SensorSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSensor:
    """A sensor: what is stated of it, and its noise."""

    setup: SensorSetup
    """Standard uncertainties of calibration, alignment and drift."""
    noise: float
    """Rms of its noise from sample to sample, in the unit of its reading."""
    unit: str = "m"
    """Unit of its reading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Laboratory:
    """Sensors and procedures of a virtual laboratory.

    Notes
    -----
    Validity: the usual values are those of capacitive sensors and an autocollimator in a quiet
    room, and no one's own.
    """

    position: BenchSensor = field(
        default_factory=lambda: BenchSensor(
            setup=SensorSetup(calibration=5e-4, alignment=1e-3, drift=2e-11), noise=5e-9
        )
    )
    """Reads along the axis."""
    transverse: BenchSensor = field(
        default_factory=lambda: BenchSensor(
            setup=SensorSetup(calibration=2e-3, alignment=5e-4, drift=2e-11), noise=3e-9
        )
    )
    """Read across it, in the plane and out of it."""
    angle: BenchSensor = field(
        default_factory=lambda: BenchSensor(
            setup=SensorSetup(calibration=2e-3, drift=1e-10), noise=5e-8, unit="rad"
        )
    )
    """Reads roll, pitch and yaw [rad]."""
    cycles: int = 8
    """Cycles over the whole stroke."""
    samples: int = 400
    """Samples of a cycle."""
    sample_rate_hz: float = 50.0
    """Rate of those samples [Hz]."""
    hold: int = 4096
    """Samples of a record with the stage held."""
    levels: int = 20
    """Levels of a staircase."""
    per_level: int = 80
    """Samples of each."""
    hits: int = 6
    """Blows of a hammer."""
    signal_to_noise: float = 100.0
    """Rms of the response to a blow over the rms of the noise [1]."""
    repeats: int = 10
    """How often each corner of the workspace is gone to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawn:
    gain: float
    angle: float
    drift: float

    def read(self, truth: Array, along: Array | float, time: Array) -> Array:
        """Reading without noise: gain, a share of the motion along the axis, drift."""
        seen = truth * np.cos(self.angle) + np.sin(self.angle) * along
        return (1.0 + self.gain) * seen + self.drift * time


def drawn(sensor: BenchSensor, rng: np.random.Generator) -> _Drawn:
    """Draw what a sensor is off by, of what is stated of it: gain, angle and drift."""
    s = sensor.setup
    g, a, d = rng.standard_normal(3)
    return _Drawn(gain=s.calibration * g, angle=s.alignment * a, drift=s.drift * d)
