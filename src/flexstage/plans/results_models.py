"""What a step gave that identified a model, or followed a reference."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.errors import PlanError
from flexstage.experiment.campaign import Figure
from flexstage.hysteresis import DriveModel, Tracking

__all__ = [
    "FollowedRun",
    "IdentifiedStep",
    "VerifiedStep",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedStep:
    """A model that was identified.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    model : DriveModel
        The model.
    kind : str
        Name of the hysteresis model.
    file : pathlib.Path
        Its file.
    errors_percent : Mapping
        Errors of the fit by what they are, over the stroke [%].
    time : numpy.ndarray
        Times of the record that it was identified from, the last of them where there were several
        [s], shape (n,).
    voltage, measured, modelled : numpy.ndarray
        Command [V], reading and model [m] there, each of shape (n,); the model's mean is set to
        that of the reading.
    deviation : float
        Largest difference of the two, after the first tenth of the record [m].
    warnings : tuple of str
        What the records cannot tell.
    """

    name: str
    axis: str
    model: DriveModel
    kind: str
    file: Path
    errors_percent: Mapping[str, float]
    time: Array
    voltage: Array
    measured: Array
    modelled: Array
    deviation: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowedRun:
    """A reference that was followed in one way.

    Parameters
    ----------
    way : str
        ``open loop``, ``inverse``, ``feedback``, ``both`` or ``learning``.
    time : numpy.ndarray
        Times of the compared cycles [s], shape (n,).
    reference : numpy.ndarray
        What was wanted [m], shape (n,).
    output : numpy.ndarray
        What the sensor read [m], shape (n,); in open loop less the mean difference from the
        reference.
    voltage : numpy.ndarray
        Voltage at the drive [V], shape (n,).
    tracking : Tracking
        Width of the loop, and errors [m].
    widths : tuple of float
        Width of the loop of each cycle [m].
    reduction_percent : float or None
        By how much the loop is narrower than in open loop [%]; None without that.
    errors : tuple of float
        Of learning: rms of the error at each trial [m].
    file : pathlib.Path
        The file of the record.
    notes : tuple of str
        What a reader should know.
    """

    way: str
    time: Array
    reference: Array
    output: Array
    voltage: Array
    tracking: Tracking
    widths: tuple[float, ...]
    reduction_percent: float | None
    errors: tuple[float, ...] = ()
    file: Path
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VerifiedStep:
    """A reference that was followed in several ways.

    Parameters
    ----------
    name : str
        Name of the step.
    axis : str
        The axis.
    model : str
        Step that identified the model.
    kind : str
        Name of its hysteresis model.
    stroke : float
        Range of the reference [m].
    rate_hz : float
        Cycles in a second [Hz].
    runs : tuple of FollowedRun
        One of each way.
    figures : tuple of Figure
        Width of the loop in open loop, and compensated.
    """

    name: str
    axis: str
    model: str
    kind: str
    stroke: float
    rate_hz: float
    runs: tuple[FollowedRun, ...]
    figures: tuple[Figure, ...]

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
