"""The delay of an identified drive, set right by a run at the rate that is to be used.

Hysteresis is a lag as well, so that an identification tells the delay of a drive only to some
microseconds. A fast motion shows what is left: at its first harmonic a delay is an angle.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexstage.control.trajectories.trajectory import Trajectory
from flexstage.errors import ModelError, RecordError
from flexstage.hysteresis import DriveModel, Lag


def trimmed_model(
    model: DriveModel,
    trajectory: Trajectory,
    axis: str,
    reading: ArrayLike,
    *,
    skip: int = 0,
) -> DriveModel:
    r"""Return a drive with the delay that a run by its inverse shows.

    The phases of wanted motion and reading at the first harmonic, frequency f, differ by
    :math:`2 \pi f` times what the delay of the model lacks.

    Parameters
    ----------
    model : DriveModel
        The drive whose inverse was run.
    trajectory : Trajectory
        What was wanted; a sine at the highest rate that is to be followed is best.
    axis : str
        The axis.
    reading : array_like
        What the sensor read in open loop, feedforward alone, from the first sample of the
        trajectory on and at its rate [m], shape (n,).
    skip : int
        First periods that are left out.

    Returns
    -------
    DriveModel
        The drive, with another delay.

    Raises
    ------
    RecordError
        There is no whole period, or the reading does not move with the trajectory.
    ModelError
        The delay would be negative.

    Notes
    -----
    Validity: what the sensor picks up at the rate of the motion, such as mains at 50 Hz of an
    amplitude a, is taken for an angle of up to a over the amplitude of the motion. What an
    amplifier does beyond a pure delay is one only at this rate.

    Examples
    --------
    >>> from flexstage.control.trajectories.sine import sine
    >>> from flexstage.hysteresis import PrandtlIshlinskii
    >>> drive = DriveModel(
    ...     hysteresis=PrandtlIshlinskii(gain=5e-7, thresholds=[5.0], weights=[1e-7]),
    ...     lag=Lag(delay=2.36e-4))
    >>> wanted = sine("x", 10e-6, 60e-6, 50.0, sample_rate_hz=10e3)
    >>> t = np.arange(600) / 10e3
    >>> late = 35e-6 - 25e-6 * np.cos(2.0 * np.pi * 50.0 * (t - 6e-6))
    >>> print(f"{1e6 * trimmed_model(drive, wanted, 'x', late).lag.delay:.2f} us")
    242.00 us
    """
    size = trajectory.size
    values = np.asarray(reading, dtype=np.float64)
    periods = values.size // size - skip
    if periods < 1:
        raise RecordError(
            f"the reading has {values.size} samples, and {skip} periods of {size} are left out: "
            "there is no whole one to look at; record more periods"
        )
    late = values[skip * size : (skip + periods) * size].reshape(periods, size).mean(axis=0)
    wanted = np.fft.rfft(trajectory.positions[axis])[1]
    came = np.fft.rfft(late)[1]
    if not 0.5 * abs(wanted) < abs(came) < 2.0 * abs(wanted):
        raise RecordError(
            f"the reading moves {abs(came) / max(abs(wanted), 1e-300):.3g} times as far as the "
            f"trajectory of axis '{axis}' at its first harmonic: give the run that followed it"
        )
    by = float(-np.angle(came / wanted)) / (2.0 * math.pi) * trajectory.period
    lag = model.lag or Lag()
    if lag.delay + by < 0.0:
        raise ModelError(
            f"the reading is {-by:.3g} s ahead of the trajectory, more than the model's delay of "
            f"{lag.delay:.3g} s: does its first sample belong to that of the trajectory?"
        )
    return replace(model, lag=replace(lag, delay=lag.delay + by))
