"""Electrical supply of a stack: current, power and heat of a sine, and control of its charge."""

import math
from dataclasses import dataclass
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.files.plain import picked

# keys of the plain data of a supply
_KEYS = (
    "capacitance", "voltage", "rate", "charge", "peak_current", "mean_current", "slew",
    "reactive_power", "heat", "temperature_rise", "limits", "limited_by", "largest_rate",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class StackSupply:
    r"""What the amplifier of a stack gives for a sine of the voltage.

    .. math:: Q = C U, \quad \hat I = \pi f C U, \quad \bar I = f C U, \quad
              P_r = \tfrac{\pi}{4} f C U^2, \quad P = P_r \tan\delta

    U is the voltage from peak to peak [V], f the rate [Hz] and C the capacitance [F].

    Notes
    -----
    Currents: PI, user manual PZ259E of the P-88x/P-08x actuators, section 6.2.5, and Piezomechanik,
    "Useful formulas"; rate: PiezoDrive, "Driving piezoelectric actuators". The heat is the loss of
    a capacitor at the effective voltage of the sine, :math:`2\pi f C U_{eff}^2\tan\delta` with
    :math:`U_{eff} = U/(2\sqrt 2)`; PI Ceramic ("Electrical operation") and Noliac ("Heat
    dissipation") give it by the same quantities.

    Validity: well below the resonance, and a linear capacitor. Makers print C and the loss factor
    for small signals: at the full voltage C is up to 70 % larger (PI) and their product 7 to 10
    times (Noliac). The rise of temperature is that of steady operation.

    Examples
    --------
    >>> supply = StackSupply(capacitance=1e-6, voltage=200.0, rate=30.0, voltage_span=200.0)
    >>> round(supply.peak_current, 4)
    0.0188
    """

    capacitance: float
    """Capacitance [F]."""
    voltage: float
    """Voltage from peak to peak [V]."""
    rate: float
    """Rate of the sine [Hz]."""
    voltage_span: float
    """Largest voltage from peak to peak [V]."""
    largest_current: float = math.inf
    """Largest current of the amplifier [A]."""
    largest_slew: float = math.inf
    """Largest slope of the voltage [V/s]."""
    loss_factor: float | None = None
    """Dielectric loss factor tan delta [1]."""
    thermal_resistance: float | None = None
    """Rise of temperature of the stack over its heat [K/W]."""

    def __post_init__(self) -> None:
        if self.voltage > self.voltage_span * (1.0 + 1e-9):
            raise ModelError(
                f"the voltage of {self.voltage:g} V from peak to peak is more than the "
                f"{self.voltage_span:g} V of the stack"
            )

    @property
    def charge(self) -> float:
        """Charge from end to end [C]."""
        return self.capacitance * self.voltage

    @property
    def peak_current(self) -> float:
        """Largest current [A]."""
        return math.pi * self.mean_current

    @property
    def mean_current(self) -> float:
        """Average current, the charge of a cycle times the rate [A]."""
        return self.rate * self.charge

    @property
    def slew(self) -> float:
        """Largest slope of the voltage [V/s]."""
        return math.pi * self.rate * self.voltage

    @property
    def reactive_power(self) -> float:
        """Reactive power of the sine [var]."""
        return 0.25 * self.peak_current * self.voltage

    @property
    def heat(self) -> float | None:
        """Heat in the stack [W]; None without a loss factor."""
        return None if self.loss_factor is None else self.loss_factor * self.reactive_power

    @property
    def temperature_rise(self) -> float | None:
        """Rise of temperature [K]; None without heat or thermal resistance."""
        if self.heat is None or self.thermal_resistance is None:
            return None
        return self.heat * self.thermal_resistance

    @property
    def limits(self) -> dict[str, float]:
        """Largest voltage from peak to peak at this rate, by what limits it [V]."""
        return {
            "voltage": self.voltage_span,
            "current": self.largest_current / (math.pi * self.rate * self.capacitance),
            "slew": self.largest_slew / (math.pi * self.rate),
        }

    @property
    def limited_by(self) -> str:
        """What limits the voltage at this rate: voltage, current or slew."""
        return min(self.limits, key=lambda name: self.limits[name])

    @property
    def largest_rate(self) -> float:
        """Largest rate at this voltage within the limits of current and slew [Hz]."""
        return min(self.largest_current / self.charge, self.largest_slew / self.voltage) / math.pi

    def data(self) -> dict[str, Any]:
        """Return the supply as plain data."""
        return picked(self, *_KEYS)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargeControl:
    r"""A circuit that sets the charge of a stack, and its voltage at low frequencies.

    The charge is measured as the voltage on a capacitor in series with the stack, whose gain is
    one over its capacitance. The leak resistance R over the stack of capacitance C lets charge flow
    off, so that below the corner :math:`f_c = 1/(2\pi R C)` the voltage is set:

    .. math:: h(f) = \sqrt{\frac{h_u^2 + r^2 h_q^2}{1 + r^2}}, \quad r = f/f_c

    with the width of the loop h_u under a set voltage, and h_q under a set charge.

    Notes
    -----
    A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, Springer
    2014, chapter 12: a set charge makes the hysteresis about a fifth. Validity: the two parts are
    superposed as linear ones a quarter of a period apart; without creep, amplifier or load.
    """

    capacitance: float
    """Capacitance of the stack [F]."""
    sensing_capacitance: float
    """Capacitance in series with it [F]."""
    leak_resistance: float
    """Resistance over the stack [ohm]."""

    @property
    def gain(self) -> float:
        """Measured voltage over charge [V/C]."""
        return 1.0 / self.sensing_capacitance

    @property
    def corner(self) -> float:
        """Frequency below which the voltage is set [Hz]."""
        return 1.0 / (2.0 * math.pi * self.leak_resistance * self.capacitance)

    def loop_width(self, rate: float, width: float, *, share: float = 0.2) -> float:
        """Return the width of the loop at a rate [Hz], from its width under a set voltage.

        `share` is the part of the width that a set charge leaves.
        """
        r = rate / self.corner
        return width * math.sqrt((1.0 + (r * share) ** 2) / (1.0 + r * r))
