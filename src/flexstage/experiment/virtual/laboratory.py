"""What the virtual stage is measured with: sensors whose errors are drawn as they are stated."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexstage.experiment.uncertainty import SensorSetup

__all__ = ["Laboratory", "Sensor", "drawn"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A sensor: what is stated of it, and its noise.

    Parameters
    ----------
    setup : SensorSetup
        Standard uncertainties of calibration, alignment and drift.
    noise : float
        Rms of its noise from sample to sample, in the unit of its reading.
    unit : str
        Unit of its reading.
    """

    setup: SensorSetup
    noise: float
    unit: str = "m"


@dataclass(frozen=True, slots=True, kw_only=True)
class Laboratory:
    """Sensors and procedures of a virtual laboratory.

    Parameters
    ----------
    position : Sensor
        Reads along the axis.
    transverse : Sensor
        Read across it, in the plane and out of it.
    angle : Sensor
        Reads roll, pitch and yaw [rad].
    cycles : int
        Cycles over the whole stroke.
    samples : int
        Samples of a cycle.
    sample_rate_hz : float
        Rate of those samples [Hz].
    hold : int
        Samples of a record with the stage held.
    levels : int
        Levels of a staircase.
    per_level : int
        Samples of each.
    hits : int
        Blows of a hammer.
    signal_to_noise : float
        Rms of the response to a blow over the rms of the noise [1].
    repeats : int
        How often each corner of the workspace is gone to.

    Notes
    -----
    Validity: the usual values are those of capacitive sensors and an autocollimator in a quiet
    room, and no one's own.
    """

    position: Sensor = field(
        default_factory=lambda: Sensor(
            setup=SensorSetup(calibration=5e-4, alignment=1e-3, drift=2e-11), noise=5e-9
        )
    )
    transverse: Sensor = field(
        default_factory=lambda: Sensor(
            setup=SensorSetup(calibration=2e-3, alignment=5e-4, drift=2e-11), noise=3e-9
        )
    )
    angle: Sensor = field(
        default_factory=lambda: Sensor(
            setup=SensorSetup(calibration=2e-3, drift=1e-10), noise=5e-8, unit="rad"
        )
    )
    cycles: int = 8
    samples: int = 400
    sample_rate_hz: float = 50.0
    hold: int = 4096
    levels: int = 20
    per_level: int = 80
    hits: int = 6
    signal_to_noise: float = 100.0
    repeats: int = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawn:
    gain: float
    angle: float
    drift: float

    def read(self, truth: Array, along: Array | float, time: Array) -> Array:
        """Reading without noise: gain, a share of the motion along the axis, drift."""
        seen = truth * np.cos(self.angle) + np.sin(self.angle) * along
        return (1.0 + self.gain) * seen + self.drift * time


def drawn(sensor: Sensor, rng: np.random.Generator) -> _Drawn:
    """Draw what a sensor is off by, of what is stated of it.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    rng : numpy.random.Generator
        Source of the draw.

    Returns
    -------
    object
        Gain [1], angle [rad] and drift of one such sensor, with a method ``read``.
    """
    s = sensor.setup
    g, a, d = rng.standard_normal(3)
    return _Drawn(gain=s.calibration * g, angle=s.alignment * a, drift=s.drift * d)
