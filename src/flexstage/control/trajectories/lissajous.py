"""A Lissajous figure: a sine on each of two axes, at rates in the ratio of whole numbers."""

import math

import numpy as np

from flexstage.control.trajectories.trajectory import Trajectory, period_samples
from flexstage.errors import ModelError


def lissajous(
    axes: tuple[str, str],
    centre: tuple[float, float],
    amplitude: tuple[float, float],
    rate_hz: float,
    *,
    ratio: tuple[int, int],
    sample_rate_hz: float,
    phase: float | None = None,
) -> Trajectory:
    """Return a Lissajous figure.

    Parameters
    ----------
    axes : tuple of str
        The two axes.
    centre : tuple of float
        Middle of the figure [m].
    amplitude : tuple of float
        Half of its width and height [m].
    rate_hz : float
        How often the whole figure is drawn in a second [Hz].
    ratio : tuple of int
        Oscillations of the two axes in one figure, without a common divisor.
    sample_rate_hz : float
        Samples in a second [Hz].
    phase : float, optional
        Lead of the first axis [rad]. Where not given, a quarter of a turn over the ratio of the
        second: then no path is run twice.

    Returns
    -------
    Trajectory
        One figure.

    Raises
    ------
    ModelError
        The ratio is no pair of whole numbers without a common divisor, an amplitude is not
        positive, or the faster axis has fewer than 8 samples an oscillation.

    Examples
    --------
    >>> made = lissajous(("x", "y"), (30e-6, 31e-6), (25e-6, 20e-6), 0.5, ratio=(8, 9),
    ...                  sample_rate_hz=1e3)
    >>> made.period, round(made.largest_speed("x") * 1e6, 1)
    (2.0, 628.3)
    """
    p, q = ratio
    if p < 1 or q < 1 or math.gcd(p, q) != 1:
        raise ModelError(
            "a Lissajous figure needs two whole numbers of oscillations without a common divisor, "
            f"got {ratio!r}"
        )
    if not (0.0 < amplitude[0] < math.inf and 0.0 < amplitude[1] < math.inf):
        raise ModelError(f"the amplitudes of a figure must be positive, got {amplitude!r} m")
    count, notes = period_samples(rate_hz, sample_rate_hz)
    period_samples(sample_rate_hz / count * max(p, q), sample_rate_hz)
    angle = 2.0 * np.pi * np.arange(count) / count
    lead = 0.5 * math.pi / q if phase is None else phase
    return Trajectory(
        positions={
            axes[0]: centre[0] + amplitude[0] * np.sin(p * angle + lead),
            axes[1]: centre[1] + amplitude[1] * np.sin(q * angle),
        },
        sample_rate_hz=float(sample_rate_hz),
        linear=np.ones(count, dtype=np.bool_),
        kind="Lissajous figure",
        notes=notes,
    )
