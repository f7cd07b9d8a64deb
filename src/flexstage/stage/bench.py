"""The bench of a stage, its base plate, sensor holder and air, for thermal drift."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flexstage.base.choose import did_you_mean
from flexstage.base.errors import FlexstageError, StageError
from flexstage.files.ranges import POSITIVE, Range, Written
from flexstage.files.request import Request
from flexstage.quantities.material import CATALOGUE
from flexstage.quantities.units import DIMENSIONS, Length, parse, to_text

#: Typical coefficients of linear expansion near 20 degC [1/K], besides those of the catalogue of
#: materials. Aluminium, carbon steel and invar: ASM Metals Handbook vol. 1-2 (1990); granite of
#: surface plates: 5e-6 to 8e-6.
USUAL_EXPANSION: Mapping[str, float] = {
    "aluminium": 23.6e-6,
    "steel": 11.5e-6,
    "granite": 6.5e-6,
    "invar": 1.3e-6,
}


def read_expansion(text: str) -> float:
    """Return the coefficient of expansion of a material, or of a number with its unit [1/K].

    Examples
    --------
    >>> read_expansion("granite"), read_expansion("Ti-6Al-4V"), read_expansion("12 um/m/K")
    (6.5e-06, 8.6e-06, 1.2e-05)
    """
    named = {name.casefold(): alpha for name, alpha in USUAL_EXPANSION.items()}
    for entry in CATALOGUE.values():
        if entry.thermal_expansion is not None:
            named[entry.name.casefold()] = entry.thermal_expansion
    word = text.strip().casefold()
    if word in named:
        return named[word]
    if word[:1].isalpha():
        names = [*USUAL_EXPANSION, *CATALOGUE]
        raise StageError(
            f"expected a coefficient such as '11.5e-6 1/K' or a material ({', '.join(names)}), "
            f"got '{text[:40]}'{did_you_mean(text, names)}"
        )
    return parse(text, "expansion")


def _expansion_text(value: float) -> str:
    return to_text(value, "expansion")


#: Coefficient of linear expansion [1/K], as a number with its unit or as the name of a material.
Expansion = Annotated[
    float, Range(), Written("MATERIAL", read=read_expansion, write=_expansion_text)
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench(Request):
    """Base plate, sensor holder and air of a stage, for its thermal drift.

    Raises
    ------
    StageError
        The holder has no length, or the length no holder; the air changes without a film
        coefficient, or nothing changes with a period.
    """

    one_value: ClassVar[bool] = True
    refused_as: ClassVar[type[FlexstageError]] = StageError

    base: Expansion
    """Coefficient of linear expansion of the base plate that the fixed bodies are bolted to, or its
    material [1/K].
    """
    holder: Expansion | None = None
    """The same of the holder of the sensors; without it the sensors are fixed to the base next to
    the body that they read.
    """
    holder_length: Annotated[Length, Range()] | None = None
    """Free length of the holder, from its foot on the base to the sensor in the direction of the
    axis [m]; negative where it extends against this direction.
    """
    temperature_change: Annotated[float, DIMENSIONS["temperature"], POSITIVE] | None = None
    """Largest change of temperature in either sense [K], over which the preload of drives is
    checked.
    """
    film_coefficient: Annotated[float, DIMENSIONS["film coefficient"], POSITIVE] | None = None
    """Heat flow from the surface of plate and drives to the air, per area and kelvin, 5 to 10 in
    still air [W/(m^2 K)]; without it there is none.
    """
    mount_conductance: Annotated[float, DIMENSIONS["thermal conductance"], POSITIVE] | None = None
    """Thermal conductance between each fixed body and the base [W/K]; where not given, fixed bodies
    have the temperature of the base.
    """
    air_change: Annotated[float, DIMENSIONS["temperature"]] = 0.0
    """Step of the temperature of the air, or amplitude with a period [K]."""
    base_change: Annotated[float, DIMENSIONS["temperature"]] = 0.0
    """The same of the temperature of the base [K]."""
    period: Annotated[float, DIMENSIONS["time"], POSITIVE] | None = None
    """Period of a sine by which air and base change, such as 24 hour [s]; steps where not given."""

    def __post_init__(self) -> None:
        # a class with slots is another than the one that super() knows
        Request.__post_init__(self)
        if (self.holder is None) != (self.holder_length is None):
            raise StageError(
                "the holder of the sensors needs both its coefficient and its length, got only "
                f"{'holder_length' if self.holder is None else 'holder'}: give holder and "
                "holder_length, or neither"
            )
        if self.air_change and self.film_coefficient is None:
            raise StageError(
                "a change of the air needs film_coefficient, such as 5 W/m^2/K in still air: give "
                "it, or omit air_change"
            )
        if self.period is not None and not (self.air_change or self.base_change):
            raise StageError(
                "a period needs air_change or base_change, the amplitude of what has it: give one, "
                "or omit period"
            )
