"""What a step gave that identified a model, or followed a reference."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexstage.arrays import Array
from flexstage.errors import PlanError
from flexstage.experiment.campaign.results import Figure
from flexstage.hysteresis import DriveModel, Tracking


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedStep:
    """A model that was identified."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    model: DriveModel
    """The model."""
    kind: str
    """Name of the hysteresis model."""
    file: Path
    """Its file."""
    errors_percent: Mapping[str, float]
    """Errors of the fit by what they are, over the stroke [%]."""
    time: Array
    """Times of the record that it was identified from, the last of them where there were several
    [s], shape (n,).
    """
    voltage: Array
    """Command [V], reading and model [m] there, each of shape (n,); the model's mean is set to that
    of the reading.
    """
    measured: Array
    """Command [V], reading and model [m] there, each of shape (n,); the model's mean is set to that
    of the reading.
    """
    modelled: Array
    """Command [V], reading and model [m] there, each of shape (n,); the model's mean is set to that
    of the reading.
    """
    deviation: float
    """Largest difference of the two, after the first tenth of the record [m]."""
    warnings: tuple[str, ...] = ()
    """What the records cannot tell."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """A reference that was followed in one way."""

    way: str
    """``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``."""
    time: Array
    """Times of the compared cycles [s], shape (n,)."""
    reference: Array
    """What was wanted [m], shape (n,)."""
    output: Array
    """What the sensor read [m], shape (n,); in open loop less the mean difference from the
    reference.
    """
    voltage: Array
    """Voltage at the drive [V], shape (n,)."""
    tracking: Tracking
    """Width of the loop, and errors [m]."""
    widths: tuple[float, ...]
    """Width of the loop of each cycle [m]."""
    reduction_percent: float | None
    """By how much the loop is narrower than in open loop [%]; None without that."""
    errors: tuple[float, ...] = ()
    """Of learning: rms of the error at each trial [m]."""
    file: Path
    """The file of the record."""
    notes: tuple[str, ...] = ()
    """What a reader should know."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep:
    """A reference that was followed in several ways."""

    name: str
    """Name of the step."""
    axis: str
    """The axis."""
    model: str
    """Step that identified the model."""
    kind: str
    """Name of its hysteresis model."""
    stroke: float
    """Range of the reference [m]."""
    rate_hz: float
    """Cycles in a second [Hz]."""
    runs: tuple[FollowedRun, ...]
    """One of each way."""
    figures: tuple[Figure, ...]
    """Width of the loop in open loop, and compensated."""

    def run(self, way: str) -> FollowedRun:
        """Return one run.

        Parameters
        ----------
        way : str
            The way.

        Returns
        -------
        FollowedRun
            The run.

        Raises
        ------
        PlanError
            The reference was not followed in that way.
        """
        for run in self.runs:
            if run.way == way:
                return run
        done = ", ".join(run.way for run in self.runs)
        raise PlanError(f"step '{self.name}' was not run in the way '{way}': there is {done}")
