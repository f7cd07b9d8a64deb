"""How quantities are written for people: names, prefixed units, four digits."""

import math
from dataclasses import dataclass, replace

from flexstage.characteristic import QUANTITIES, Characteristic

_SMALLER = {"µ": "n", "n": "p"}
_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Display:
    """How a quantity is shown."""

    label: str
    """Its name in words."""
    unit: str
    """The unit that it is shown in; empty for a plain number."""
    factor: float
    """What a value in the unit of `flexstage.characteristic.QUANTITIES` is multiplied by."""
    zero: float = 0.0
    """Magnitude below which a value is rounding and no motion, in that same unit."""

    def text(self, value: float | None) -> str:
        """Write a value in the unit of `QUANTITIES` with four significant digits; a dash for none.

        Examples
        --------
        >>> display("output_displacement").text(64.6e-6)
        '64.60'
        """
        if value is None:
            return "–"
        if abs(value) < self.zero:
            return "≈ 0"
        return number(value * self.factor)

    def cell(self, row: Characteristic) -> str:
        """Write the value of a characteristic with the digits that are known of it.

        Published values as they are printed; measured ones to the second digit of their
        uncertainty; those of models with four significant digits, or fewer where their uncertainty
        says so.

        Examples
        --------
        >>> row = Characteristic(quantity="straightness", axis="x", origin="published-measured",
        ...     value=9e-08, unit="m")
        >>> display("straightness").cell(row)
        '0.09'
        """
        if row.origin.startswith("published"):
            return f"{row.value * self.factor:.10g}"
        plain = self.text(row.value)
        if row.uncertainty and abs(row.value) >= self.zero:
            known = beside(row.value * self.factor, row.uncertainty * self.factor)[0]
            # of a model four digits are enough, however well its mesh has settled
            return known if row.origin == "measured" else min(known, plain, key=len)
        return plain

    def fitting(self, largest: float) -> "Display":
        """Return the same quantity in a smaller unit where its values are tiny.

        In nanometres or nanoradians where the largest magnitude, in the unit of `QUANTITIES`, is
        below a tenth of a micrometre or microradian, and in pico units below that.

        Examples
        --------
        >>> display("resolution").fitting(4.033e-10).unit
        'nm'
        """
        shown = self
        while shown.unit[:1] in _SMALLER and shown.unit[1:] and 0.0 < largest * shown.factor < 0.1:
            unit = _SMALLER[shown.unit[0]] + shown.unit[1:]
            if shown.unit.endswith("²"):
                break
            shown = replace(shown, unit=unit, factor=1e3 * shown.factor)
        return shown


_SHOWN: dict[str, Display] = {
    "input_displacement": Display(label="Input displacement", unit="µm", factor=1e6),
    "output_displacement": Display(label="Output displacement", unit="µm", factor=1e6),
    "transmission_ratio": Display(label="Transmission ratio", unit="", factor=1.0),
    "max_stress": Display(label="Largest stress", unit="MPa", factor=1e-6),
    "safety_factor": Display(label="Safety factor (yield)", unit="", factor=1.0),
    "fatigue_safety": Display(label="Safety factor (fatigue)", unit="", factor=1.0),
    "resolution": Display(label="Resolution", unit="µm", factor=1e6),
    "natural_frequency_hz": Display(label="Natural frequency", unit="Hz", factor=1.0),
    "cross_coupling": Display(label="Cross-coupling", unit="%", factor=100.0, zero=1e-9),
    "parasitic_rotation": Display(label="Parasitic rotation", unit="µrad", factor=1e6, zero=1e-12),
    "input_stiffness": Display(label="Input stiffness", unit="N/µm", factor=1e-6),
    "output_stiffness": Display(label="Output stiffness", unit="N/µm", factor=1e-6),
    "gravity_sag": Display(label="Deflection under 1 g", unit="µm", factor=1e6, zero=1e-12),
    "thermal_drift": Display(label="Thermal drift", unit="nm/K", factor=1e9, zero=1e-13),
    "out_of_plane_frequency_hz": Display(label="Lowest mode out of plane", unit="Hz", factor=1.0),
    "out_of_plane_stiffness": Display(label="Stiffness out of plane", unit="N/µm", factor=1e-6),
    "buckling_factor": Display(label="Buckling factor", unit="", factor=1.0),
    "straightness": Display(label="Straightness in plane", unit="µm", factor=1e6, zero=1e-15),
    "straightness_out_of_plane": Display(
        label="Straightness out of plane", unit="µm", factor=1e6, zero=1e-15
    ),
    "linearity": Display(label="Linearity along the stroke", unit="µm", factor=1e6),
    "pitch": Display(label="Pitch", unit="µrad", factor=1e6),
    "roll": Display(label="Roll", unit="µrad", factor=1e6),
    "positioning_accuracy": Display(label="Accuracy of positioning A", unit="µm", factor=1e6),
    "positioning_repeatability": Display(
        label="Repeatability of positioning R", unit="µm", factor=1e6
    ),
    "positioning_systematic_deviation": Display(
        label="Systematic deviation E", unit="µm", factor=1e6
    ),
    "positioning_mean_deviation": Display(label="Mean deviation M", unit="µm", factor=1e6),
    "repeatability": Display(label="Repeatability (standard deviation)", unit="nm", factor=1e9),
    "reversal": Display(label="Reversal B", unit="µm", factor=1e6),
    "mean_reversal": Display(label="Mean reversal", unit="µm", factor=1e6),
    "squareness": Display(label="Squareness", unit="µrad", factor=1e6),
    "workspace_area": Display(label="Area of the workspace", unit="µm²", factor=1e12),
    "damping_ratio": Display(label="Damping ratio", unit="%", factor=100.0),
    "noise": Display(label="Noise (rms)", unit="nm", factor=1e9),
    "drift": Display(label="Drift", unit="nm/s", factor=1e9),
    "hysteresis_loop_width": Display(label="Hysteresis loop width", unit="µm", factor=1e6),
    "compensated_loop_width": Display(label="Loop width, compensated", unit="µm", factor=1e6),
    "hysteresis_deviation": Display(label="Hysteresis model, largest error", unit="µm", factor=1e6),
}


def display(quantity: str) -> Display:
    """Return how a quantity, one of `flexstage.characteristic.QUANTITIES`, is shown.

    The name itself and its own unit where nothing nicer is known.
    """
    plain = Display(
        label=quantity.replace("_", " ").capitalize(),
        unit=QUANTITIES.get(quantity, ""),
        factor=1.0,
    )
    return _SHOWN.get(quantity, plain)


def number(value: float, digits: int = 4) -> str:
    """Write a number with a fixed count of significant digits, trailing zeros kept.

    Plain from 1e-3 to 1e6, with an exponent outside.

    Examples
    --------
    >>> number(0.30814), number(705.0), number(12345.6)
    ('0.3081', '705.0', '12346')
    """
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -3 <= exponent < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def prefixed(largest: float) -> tuple[float, str]:
    """Return factor and prefix, none to pico, of a unit in which values are neither long nor tiny.

    The largest magnitude is in the unit without prefix.

    Examples
    --------
    >>> prefixed(63e-6)
    (1000000.0, 'µ')
    """
    for factor, prefix in _PREFIXES:
        if factor * largest >= 0.5:
            return factor, prefix
    return _PREFIXES[-1] if largest > 0.0 else (1.0, "")


def beside(value: float, uncertainty: float) -> tuple[str, str]:
    """Write a value and its uncertainty, in one unit, with the same decimals.

    Two digits of the uncertainty are seen, and seven of the value at most.

    Examples
    --------
    >>> beside(338.9104, 0.00243), beside(-729.23, 2814.0), beside(63.1234, 0.0671)
    (('338.9104', '0.0024'), ('-729', '2814'), ('63.123', '0.067'))
    """
    if not (math.isfinite(value) and 0.0 < uncertainty < math.inf):
        return number(value), f"{uncertainty:g}" if uncertainty == 0.0 else number(uncertainty, 2)
    size = max(abs(value), uncertainty)
    last = math.floor(math.log10(float(f"{uncertainty:.1e}"))) - 1
    first = math.floor(math.log10(size))
    if not -3 <= first < 6 or first - last > 6:
        return number(value), number(uncertainty, 2)
    decimals = max(-last, 0)
    return f"{value:.{decimals}f}", f"{uncertainty:.{decimals}f}"
