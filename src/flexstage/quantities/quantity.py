"""Quantities of a stage: names, units and formats of their values."""

import math
from dataclasses import dataclass, replace

_ARCSEC = 180.0 * 3600.0 / math.pi
_SMALLER = {"µ": "n", "n": "p"}
_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p"))


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity of a stage."""

    name: str
    """Name in files and results."""
    unit: str
    """Unit of stored values: SI, but Hz for frequencies, whose names say so."""
    label: str
    """Name in words."""
    shown_unit: str
    """Unit of printed values; empty for a plain number."""
    factor: float
    """Factor from `unit` to `shown_unit`."""
    zero: float = 0.0
    """Magnitude below which a value is rounding error, in `unit`."""
    at_least: float = -math.inf
    """Least permissible value, in `unit`."""
    at_most: float = math.inf
    """Largest possible value, in `unit`."""

    def failing(self, value: float) -> str:
        """Return the limit that a value in `unit` violates, as text; empty if none."""
        if value < self.at_least:
            return f"at least {self.at_least * self.factor:g} is required"
        unit = f" {self.shown_unit}" if self.shown_unit else ""
        most = f"at most {self.at_most * self.factor:g}{unit} is possible"
        return most if value > self.at_most else ""

    @property
    def heading(self) -> str:
        """Name and unit of printed values."""
        return f"{self.label} [{self.shown_unit}]" if self.shown_unit else self.label

    def text(self, value: float | None) -> str:
        """Write a value in `unit` with four significant digits; a dash for none.

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

    def fitting(self, largest: float) -> "Quantity":
        """Return the same quantity in a smaller unit where its values are tiny.

        Nanometres or nanoradians where the largest magnitude, in `unit`, is below a tenth of a
        micrometre or microradian, pico units below that; unchanged where all are rounding errors.

        Examples
        --------
        >>> display("resolution").fitting(4.033e-10).shown_unit
        'nm'
        """
        scaled = self
        while (
            scaled.shown_unit[:1] in _SMALLER
            and scaled.shown_unit[1:]
            and self.zero <= largest
            and 0.0 < largest * scaled.factor < 0.1
        ):
            if scaled.shown_unit.endswith("²"):
                break
            unit = _SMALLER[scaled.shown_unit[0]] + scaled.shown_unit[1:]
            scaled = replace(scaled, shown_unit=unit, factor=1e3 * scaled.factor)
        return scaled


#: Quantities in the order of tables; a new one needs a line here and a function that computes it.
#:
#: :meta hide-value:
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        # name, unit, label, printed unit and factor, rounding error
        Quantity("input_displacement", "m", "Input displacement", "µm", 1e6),
        Quantity("output_displacement", "m", "Output displacement", "µm", 1e6),
        Quantity("working_displacement", "m", "Output displacement, drives in place", "µm", 1e6),
        Quantity("rotation_stroke", "rad", "Stroke in rotation", "µrad", 1e6),
        Quantity("transmission_ratio", "1", "Transmission ratio", "", 1.0),
        Quantity("max_stress", "Pa", "Largest stress", "MPa", 1e-6),
        Quantity("safety_factor", "1", "Safety factor (yield)", "", 1.0, at_least=1.0),
        Quantity("fatigue_safety", "1", "Safety factor (fatigue)", "", 1.0, at_least=1.0),
        Quantity("resolution", "m", "Resolution", "µm", 1e6),
        Quantity("rotation_resolution", "rad", "Resolution in rotation", "µrad", 1e6),
        Quantity("natural_frequency_hz", "Hz", "Natural frequency", "Hz", 1.0),
        Quantity(
            "natural_frequency_with_stack_hz", "Hz", "Natural frequency with stack", "Hz", 1.0
        ),
        Quantity("lift_off_frequency_hz", "Hz", "Frequency at which a drive lifts off", "Hz", 1.0),
        Quantity("cross_coupling", "1", "Cross-coupling", "%", 100.0, 1e-9),
        Quantity("cross_displacement", "m", "Displacement of other axes", "µm", 1e6, 1e-15),
        Quantity("cross_rotation", "rad", "Rotation of other axes", "µrad", 1e6, 1e-12),
        Quantity("parasitic_rotation", "rad", "Parasitic rotation", "µrad", 1e6, 1e-12),
        Quantity("input_stiffness", "N/m", "Input stiffness", "N/µm", 1e-6),
        Quantity("output_stiffness", "N/m", "Output stiffness", "N/µm", 1e-6),
        Quantity("rotational_stiffness", "N*m/rad", "Stiffness in rotation", "N m/rad", 1.0),
        Quantity("effective_mass", "kg", "Effective mass at the probe", "g", 1e3),
        Quantity("effective_inertia", "kg*m^2", "Effective inertia at the probe", "kg mm²", 1e6),
        Quantity("gravity_sag", "m", "Deflection under 1 g", "µm", 1e6, 1e-12),
        Quantity("thermal_drift", "m/K", "Thermal drift", "nm/K", 1e9, 1e-13),
        Quantity(
            "thermal_drift_in_place", "m/K", "Thermal drift, drives in place", "nm/K", 1e9, 1e-13
        ),
        Quantity(
            "thermal_rotation_in_place", "rad/K", "Thermal rotation, drives in place",
            "µrad/K", 1e6, 1e-12,
        ),
        Quantity("drift_in_time", "m", "Thermal drift in time, largest", "µm", 1e6, 1e-13),
        Quantity(
            "rotation_in_time", "rad", "Thermal rotation in time, largest", "µrad", 1e6, 1e-12
        ),
        Quantity("thermal_time_constant", "s", "Thermal time constant", "s", 1.0),
        Quantity("rms_displacement", "m", "Rms in its environment", "nm", 1e9),
        Quantity("rms_rotation", "rad", "Rms of rotation in its environment", "nrad", 1e9),
        Quantity("out_of_plane_frequency_hz", "Hz", "Lowest mode out of plane", "Hz", 1.0),
        Quantity("out_of_plane_stiffness", "N/m", "Stiffness out of plane", "N/µm", 1e-6),
        Quantity("buckling_factor", "1", "Buckling factor", "", 1.0, at_least=1.0),
        Quantity("drive_force", "N", "Force of the drive", "N", 1.0),
        Quantity("drive_force_share", "1", "Force over blocking force", "%", 100.0, at_most=1.0),
        Quantity("stroke_left", "1", "Stroke left of the free stroke", "%", 100.0),
        Quantity("smallest_neck", "m", "Thinnest neck", "mm", 1e3),
        Quantity("smallest_slot", "m", "Narrowest slot", "mm", 1e3),
        Quantity("smallest_wall", "m", "Thinnest wall of a body", "mm", 1e3),
        Quantity("output_wall", "m", "Thinnest wall of the output body", "mm", 1e3),
        Quantity("straightness", "m", "Straightness in plane", "µm", 1e6, 1e-15),
        Quantity("straightness_out_of_plane", "m", "Straightness out of plane", "µm", 1e6, 1e-15),
        Quantity("linearity", "m", "Linearity along the stroke", "µm", 1e6),
        Quantity("pitch", "rad", "Pitch", "µrad", 1e6),
        Quantity("roll", "rad", "Roll", "µrad", 1e6),
        Quantity("positioning_accuracy", "m", "Accuracy of positioning A", "µm", 1e6),
        Quantity("positioning_repeatability", "m", "Repeatability of positioning R", "µm", 1e6),
        Quantity("positioning_systematic_deviation", "m", "Systematic deviation E", "µm", 1e6),
        Quantity("positioning_mean_deviation", "m", "Mean deviation M", "µm", 1e6),
        Quantity("repeatability", "m", "Repeatability (standard deviation)", "nm", 1e9),
        Quantity("reversal", "m", "Reversal B", "µm", 1e6),
        Quantity("mean_reversal", "m", "Mean reversal", "µm", 1e6),
        Quantity("rotation_accuracy", "rad", "Accuracy of rotation A", "arcsec", _ARCSEC),
        Quantity("rotation_repeatability", "rad", "Repeatability of rotation R", "arcsec", _ARCSEC),
        Quantity("rotation_systematic", "rad", "Systematic deviation E", "arcsec", _ARCSEC),
        Quantity("rotation_mean_deviation", "rad", "Mean deviation M", "arcsec", _ARCSEC),
        Quantity("rotation_reversal", "rad", "Reversal B", "arcsec", _ARCSEC),
        Quantity("rotation_mean_reversal", "rad", "Mean reversal", "arcsec", _ARCSEC),
        Quantity("eccentricity", "m", "Eccentricity of the artefact", "µm", 1e6),
        Quantity("radial_synchronous", "m", "Radial motion, synchronous", "µm", 1e6),
        Quantity("radial_asynchronous", "m", "Radial motion, asynchronous", "µm", 1e6),
        Quantity("rotating_synchronous", "m", "Rotating direction, synchronous", "µm", 1e6),
        Quantity("rotating_asynchronous", "m", "Rotating direction, asynchronous", "µm", 1e6),
        Quantity("axial_synchronous", "m", "Axial motion, synchronous", "µm", 1e6),
        Quantity("axial_asynchronous", "m", "Axial motion, asynchronous", "µm", 1e6),
        Quantity("axial_once_per_turn", "m", "Axial motion, order 1 (face run-out)", "µm", 1e6),
        Quantity("tilt_synchronous", "rad", "Tilt, synchronous", "arcsec", _ARCSEC),
        Quantity("tilt_asynchronous", "rad", "Tilt, asynchronous", "arcsec", _ARCSEC),
        Quantity("tilt_once_per_turn", "rad", "Tilt, order 1", "arcsec", _ARCSEC),
        Quantity("squareness", "rad", "Squareness", "µrad", 1e6),
        Quantity("workspace_area", "m^2", "Area of the workspace", "µm²", 1e12),
        Quantity("condition_number", "1", "Condition number of the Jacobian", "", 1.0),
        Quantity("isotropy", "1", "Isotropy of the Jacobian", "", 1.0),
        Quantity("mass", "kg", "Mass without drives", "g", 1e3),
        Quantity("moving_mass", "kg", "Mass of all moving bodies", "g", 1e3),
        Quantity("width", "m", "Width along x", "mm", 1e3),
        Quantity("height", "m", "Height along y", "mm", 1e3),
        Quantity("thickness", "m", "Thickness", "mm", 1e3),
        Quantity("damping_ratio", "1", "Damping ratio", "%", 100.0),
        Quantity("noise", "m", "Noise (rms)", "nm", 1e9),
        Quantity("drift", "m/s", "Drift", "nm/s", 1e9),
        Quantity("hysteresis_loop_width", "m", "Hysteresis loop width", "µm", 1e6),
        Quantity("compensated_loop_width", "m", "Loop width, compensated", "µm", 1e6),
        Quantity("hysteresis_deviation", "m", "Hysteresis model, largest error", "µm", 1e6),
    )
}  # fmt: skip


#: Short names of quantities; ``_hz`` can be omitted as well.
ALIASES = {
    "stroke": "output_displacement",
    "ratio": "transmission_ratio",
    "stress": "max_stress",
    "coupling": "cross_coupling",
    "frequency": "natural_frequency_hz",
    "rms": "rms_displacement",
}


def full_name(name: str) -> str:
    """Return the full name of a quantity for a short one; any other name unchanged."""
    quantity = ALIASES.get(name, name)
    return quantity if quantity in QUANTITIES or f"{name}_hz" not in QUANTITIES else f"{name}_hz"


def display(name: str) -> Quantity:
    """Return a quantity by name; an unknown one is a plain number with that name."""
    plain = Quantity(name, "", name.replace("_", " ").capitalize(), "", 1.0)
    return QUANTITIES.get(name, plain)


def number(value: float, digits: int = 4) -> str:
    """Write a number with a fixed number of significant digits, including trailing zeros.

    The notation is fixed-point from 1e-3 to 1e6 and scientific outside that range.

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


def prefixed(largest: float, least: float = 0.5) -> tuple[float, str]:
    """Return factor and prefix, none to pico, of a unit that suits the size of values.

    The largest magnitude, in the unit without prefix, is then `least` or more.

    Examples
    --------
    >>> prefixed(63e-6)
    (1000000.0, 'µ')
    """
    for factor, prefix in _PREFIXES:
        if factor * largest >= least:
            return factor, prefix
    return _PREFIXES[-1] if largest > 0.0 else (1.0, "")


def round_below(limit: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not over a limit.

    Examples
    --------
    >>> round_below(7.3), round_below(0.3)
    (5.0, 0.2)
    """
    power = math.floor(math.log10(limit))
    steps = [s * 10.0**p for p in (power - 1, power, power + 1) for s in (1.0, 2.0, 5.0)]
    return float(f"{max(s for s in steps if s <= limit * (1.0 + 1e-9)):.1g}")


def within_digits(value: str, uncertainty: float) -> str:
    """Write an uncertainty with the decimals of its value: 353.2 ± 0.4, 97.50 ± < 0.01.

    It is empty for a value that is a rounding error.
    """
    if value == "≈ 0":
        return ""
    if "e" in value or not math.isfinite(uncertainty):
        return number(uncertainty, 2)
    decimals = len(value.partition(".")[2])
    last = 10.0**-decimals
    return f"{uncertainty:.{decimals}f}" if uncertainty >= 0.5 * last else f"< {last:.{decimals}f}"


def value_and_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Write a value and its uncertainty, in one unit, with the same decimals.

    The uncertainty has two significant digits, and the value seven at most.

    Examples
    --------
    >>> value_and_uncertainty(338.9104, 0.00243), value_and_uncertainty(63.1234, 0.0671)
    (('338.9104', '0.0024'), ('63.123', '0.067'))
    >>> value_and_uncertainty(-729.23, 2814.0)
    ('-729', '2814')
    """
    if not (math.isfinite(value) and 0.0 < uncertainty < math.inf):
        return number(value), f"{uncertainty:g}" if uncertainty == 0.0 else number(uncertainty, 2)
    size = max(abs(value), uncertainty)
    last = math.floor(math.log10(float(f"{uncertainty:.1e}"))) - 1
    first = math.floor(math.log10(size))
    if not -3 <= first < 6:
        return number(value), number(uncertainty, 2)
    text = f"{value:.{max(min(-last, 6 - first), 0)}f}"
    return text, within_digits(text, uncertainty)
