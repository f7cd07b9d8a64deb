r"""The linear part of the loop's stage, exactly as it is sampled: for the design of its control.

With z the shift by one sample, from the voltage that is asked for to the position in the same
sample:

.. math:: \frac{Y}{U} = z^{-1} \cdot \frac{(1 - d) z^{-1}}{1 - d z^{-1}} \cdot s \cdot C(z)
          \cdot \sum_i r_i g_i M_i(z)

converter, amplifier, slope of the stack, creep, modes. A mode and a lag are driven by straight
lines between the samples, as in the loop itself.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from flexstage.arrays import Complex
from flexstage.hysteresis.chain.creep import Creep
from flexstage.hysteresis.chain.lag import decay_share, ramp_share
from flexstage.instruments.twin.loop import ModeArrays


def sampled_response(
    modes: ModeArrays,
    drive: int,
    sensor: int,
    frequency_hz: ArrayLike,
    sample_rate_hz: float,
    *,
    slope: float,
    bandwidth_hz: float,
    creep: Creep | None,
) -> Complex:
    """Return position over voltage asked for [m/V], for small signals.

    Of the axis numbered `sensor` by that numbered `drive`; `slope` is that of the stack, without
    creep [m/V].
    """
    f = np.asarray(frequency_hz, dtype=np.float64)
    late = np.exp(-2j * np.pi * f / sample_rate_hz)
    d = math.exp(-2.0 * math.pi * bandwidth_hz / sample_rate_hz)
    total = slope * late * (1.0 - d) * late / (1.0 - d * late)
    if creep is not None:
        ratio = 1.0 / (sample_rate_hz * creep.time_constants)
        decay, ramp = decay_share(ratio), ramp_share(ratio)
        lag = decay * late[:, None] + ramp * (1.0 - late[:, None])
        lag /= 1.0 - (1.0 - decay) * late[:, None]
        total = total * (1.0 + lag @ creep.lag_gains)
    return total * _modes(modes, drive, sensor, late)


def _modes(modes: ModeArrays, drive: int, sensor: int, late: Complex) -> Complex:
    """Sum of the modes, each a state of two that a force on straight lines drives."""
    t, m = modes.transition, modes.moments
    step = late[:, None]
    by_z = m[1] * step + m[2] * (1.0 - step)
    by_v = m[0] * step + m[1] * (1.0 - step)
    # (1 - zz/z) a - zv/z b = by_z;  -vz/z a + (1 - vv/z) b = by_v
    one, four = 1.0 - t[0] * step, 1.0 - t[3] * step
    a = (four * by_z + t[1] * step * by_v) / (one * four - t[1] * t[2] * step**2)
    return a @ (modes.force[drive] * modes.reader[sensor])
