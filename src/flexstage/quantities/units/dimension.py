"""Physical dimensions of fields and columns, and their accepted units."""

from dataclasses import dataclass
from typing import Annotated


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimension:
    """A physical dimension that a field of a description can have."""

    name: str
    """Name in messages."""
    si: str
    """SI unit of stored numbers."""
    units: tuple[str, ...]
    """Accepted units; files are written in the first one."""

    @property
    def noun(self) -> str:
        """Name with the article."""
        return f"{'an' if self.name[0] in 'aeiou' else 'a'} {self.name}"


DIMENSIONS: dict[str, Dimension] = {
    d.name: d
    for d in (
        Dimension(name="length", si="m", units=("mm", "um", "nm", "m", "inch")),
        Dimension(name="angle", si="rad", units=("deg", "rad", "mrad", "urad", "arcsec", "arcmin")),
        Dimension(name="mass", si="kg", units=("g", "kg", "mg")),
        Dimension(name="inertia", si="kg*m^2", units=("g*mm^2", "kg*m^2")),
        Dimension(name="force", si="N", units=("N", "mN", "kN")),
        Dimension(name="stiffness", si="N/m", units=("N/um", "N/mm", "N/m", "kN/mm")),
        Dimension(name="rotational stiffness", si="N*m/rad", units=("N*m/rad",)),
        Dimension(name="pressure", si="Pa", units=("MPa", "GPa", "Pa", "kPa")),
        Dimension(name="density", si="kg/m^3", units=("kg/m^3", "g/cm^3")),
        Dimension(name="voltage", si="V", units=("V", "mV", "kV")),
        Dimension(name="capacitance", si="F", units=("uF", "nF", "F")),
        Dimension(name="frequency", si="Hz", units=("Hz", "kHz", "MHz")),
        Dimension(name="temperature", si="K", units=("K", "mK")),
        Dimension(name="expansion", si="1/K", units=("1/K", "um/m/K")),
        Dimension(name="drift", si="m/K", units=("nm/K", "um/K", "m/K")),
        Dimension(name="angular drift", si="rad/K", units=("urad/K", "rad/K")),
        Dimension(name="conductivity", si="W/m/K", units=("W/m/K",)),
        Dimension(name="specific heat", si="J/kg/K", units=("J/kg/K",)),
        Dimension(name="film coefficient", si="W/m^2/K", units=("W/m^2/K",)),
        Dimension(name="thermal conductance", si="W/K", units=("W/K", "mW/K")),
        Dimension(name="heat capacity", si="J/K", units=("J/K",)),
        Dimension(name="power", si="W", units=("W", "mW")),
        Dimension(name="area", si="m^2", units=("um^2", "mm^2", "m^2")),
        Dimension(name="speed", si="m/s", units=("nm/s", "um/s", "mm/s", "m/s")),
        Dimension(name="angular speed", si="rad/s", units=("rpm", "deg/s", "rad/s")),
        Dimension(name="slew rate", si="V/s", units=("V/s", "V/ms")),
        Dimension(name="time", si="s", units=("s", "ms", "us", "min", "hour")),
    )
}

#: Numbers in SI that have a unit in files and commands.
Angle = Annotated[float, DIMENSIONS["angle"]]
Frequency = Annotated[float, DIMENSIONS["frequency"]]
Length = Annotated[float, DIMENSIONS["length"]]
Stiffness = Annotated[float, DIMENSIONS["stiffness"]]
Time = Annotated[float, DIMENSIONS["time"]]
Voltage = Annotated[float, DIMENSIONS["voltage"]]

#: Dimensions of columns in measured files; no field of a description has them.
MEASURED: dict[str, Dimension] = {
    d.name: d
    for d in (
        Dimension(name="current", si="A", units=("A", "mA")),
        Dimension(name="charge", si="C", units=("C", "uC")),
        Dimension(name="resistance", si="ohm", units=("ohm", "kohm")),
        Dimension(name="torque", si="N*m", units=("N*m", "N*mm")),
        Dimension(name="acceleration", si="m/s^2", units=("m/s^2", "mm/s^2")),
        Dimension(name="gain", si="m/V", units=("um/V", "nm/V")),
    )
}
