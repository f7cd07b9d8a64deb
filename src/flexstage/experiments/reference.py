"""References that an axis shall follow, about the middle of what its drive reaches."""

import math

import numpy as np

from flexstage.control import Trajectory, sine, triangle
from flexstage.errors import PlanError
from flexstage.experiments.command import require_size
from flexstage.experiments.verbs import Reference, Verify
from flexstage.hysteresis import DriveModel

#: Samples in a cycle, at least.
_SAMPLES_PER_CYCLE = 200
#: A cycle that is compared has at least so many samples.
_FEWEST = 20.0
#: Cycles after which the model repeats itself.
_STEADY = 4


def settled_range(
    model: DriveModel, voltage_range: tuple[float, float], rate_hz: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the voltages that a model may be asked for, and the readings that they lead to."""
    low, high = voltage_range
    if model.validity is not None:
        own = model.validity.input_range
        low, high = max(low, own[0]), min(high, own[1])
    if not low < high:
        raise PlanError(
            f"the drive takes {voltage_range[0]:g} to {voltage_range[1]:g} V, and its model was "
            "identified outside of it: identify it again"
        )
    n = _SAMPLES_PER_CYCLE
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(_STEADY * n) / n)
    reading = model.simulate(low + (high - low) * swing, 1.0 / (n * rate_hz), model.conditioned())
    late = reading[-n:]
    return (low, high), (float(late.min()), float(late.max()))


def reference_rate(wanted: Reference, sample_rate_hz: float, base_rate_hz: float) -> float:
    """Return the rate of samples of a reference.

    Examples
    --------
    >>> reference_rate(Reference(rate=2.0), 1000.0, 10e3)
    1000.0
    """
    rate = base_rate_hz / max(
        math.floor(base_rate_hz / max(sample_rate_hz, _SAMPLES_PER_CYCLE * wanted.rate)), 1
    )
    samples = rate / wanted.rate
    if not _is_whole(samples):
        raise PlanError(
            f"a reference of {wanted.rate:g} Hz has no whole number of samples at {rate:g} Hz, 20 "
            "at least: choose another rate"
        )
    require_size(samples * (wanted.cycles + wanted.settle), "reference")
    return rate


def require_whole_cycles(name: str, action: Verify, usual_rate_hz: float) -> None:
    """Refuse a rate of samples at which cycles cannot be compared."""
    rate = action.rate or usual_rate_hz
    samples = rate / action.reference.rate
    if not _is_whole(samples):
        raise PlanError(
            f"step '{name}' compares cycles, which need a whole number of samples, "
            f"{_FEWEST:g} at least: {rate:g} Hz gives {samples:g}; choose another rate"
        )


def reference_trajectory(
    wanted: Reference,
    axis: str,
    readings: tuple[float, float],
    sample_rate_hz: float,
    base_rate_hz: float,
) -> Trajectory:
    """Return one period of a reference."""
    rate = reference_rate(wanted, sample_rate_hz, base_rate_hz)
    middle = 0.5 * (readings[0] + readings[1])
    half = 0.5 * wanted.share * (readings[1] - readings[0])
    make = triangle if wanted.shape == "triangle" else sine
    return make(axis, middle - half, middle + half, wanted.rate, sample_rate_hz=rate)


def _is_whole(samples: float) -> bool:
    return samples >= _FEWEST and abs(samples - round(samples)) <= 1e-6 * samples
