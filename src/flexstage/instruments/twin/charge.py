r"""A stack driven by charge in place of voltage: its hysteresis, but not that of slow motion.

The displacement of a stack is nearly proportional to its charge; the hysteresis lies between charge
and voltage. No amplifier holds a charge for ever, so that below a corner it becomes one of voltage.
With e the deviation of the displacement from its chord over the voltage range,

.. math:: w = w_{chord} + \rho\, e + (1 - \rho)\, \mathrm{lowpass}(e)
"""

import math
from dataclasses import dataclass

import numpy as np

from flexstage.errors import ModelError
from flexstage.hysteresis.chain.first_order import decay_share, ramp_share
from flexstage.hysteresis.virtual_stack import VirtualStack

_CYCLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargeDrive:
    """What a charge amplifier leaves of the hysteresis.

    Notes
    -----
    Validity: a description of what such amplifiers do, with usual figures, and no model of a
    circuit: saturation, leakage of the stack, and the slow return of its offset are left out, and
    so is the voltage that the charge really needs. Creep is that of voltage.
    """

    corner_hz: float = 0.1
    """Frequency below which it drives by voltage [Hz]."""
    remainder: float = 0.08
    """Part of the hysteresis that is left far above the corner [1]."""
    voltage_range: tuple[float, float] = (0.0, 120.0)
    """Ends of the chord [V]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.corner_hz < math.inf:
            raise ModelError(
                f"the corner of a charge drive must be positive and finite, got {self.corner_hz!r}"
            )
        if not 0.0 <= self.remainder < 1.0:
            raise ModelError(
                "the part of the hysteresis that a charge drive leaves must be 0 or more and less "
                f"than 1, got {self.remainder!r}"
            )
        if not self.voltage_range[0] < self.voltage_range[1]:
            raise ModelError(f"the ends of a chord must rise, got {self.voltage_range!r} V")

    def row(self, stack: VirtualStack, dt: float) -> tuple[float, float, float, float, float]:
        """Return its numbers for one stack, as the stack is stepped."""
        low, high = self.voltage_range
        ends = stack.simulate(np.tile([low, high], _CYCLES)).values[-2:]
        slope = float(ends[1] - ends[0]) / (high - low)
        ratio = 2.0 * math.pi * self.corner_hz * dt
        return (
            float(ends[0]) - slope * low,
            slope,
            self.remainder,
            float(decay_share(ratio)),
            float(ramp_share(ratio)),
        )
