"""Catalogue of materials, each with the sources of its properties."""

from dataclasses import dataclass
from typing import Annotated

from flexstage.base.choose import nearest
from flexstage.base.errors import StageError
from flexstage.quantities.units import DIMENSIONS

# Plausible ranges, from foams to diamond; a value outside has a wrong unit.
_PLAUSIBLE = {
    "youngs_modulus": (1e3, 1e14),
    "density": (1e-2, 1e5),
    "yield_strength": (1.0, 1e12),
    "fatigue_limit": (1.0, 1e12),
    "thermal_conductivity": (1e-4, 1e5),
    "specific_heat": (1.0, 1e5),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """An isotropic, linearly elastic material.

    Raises
    ------
    StageError
        A figure is impossible (a negative modulus, nu outside -1 to 0.5, ...).
    """

    name: str
    """Its designation."""
    youngs_modulus: Annotated[float, DIMENSIONS["pressure"]]
    """Young's modulus E [Pa]."""
    poissons_ratio: float
    """Poisson's ratio nu [1]."""
    density: Annotated[float, DIMENSIONS["density"]]
    """Density rho [kg/m^3]."""
    yield_strength: Annotated[float, DIMENSIONS["pressure"]] | None = None
    """0.2 % yield strength [Pa]; None for a brittle material, which has none."""
    fatigue_limit: Annotated[float, DIMENSIONS["pressure"]] | None = None
    """Fatigue strength: amplitude of fully reversed stress at `fatigue_cycles` [Pa]."""
    fatigue_cycles: float | None = None
    """Number of cycles to which `fatigue_limit` belongs [1]."""
    thermal_expansion: Annotated[float, DIMENSIONS["expansion"]] | None = None
    """Coefficient of linear expansion near 20 degC [1/K]."""
    thermal_conductivity: Annotated[float, DIMENSIONS["conductivity"]] | None = None
    """Thermal conductivity near 20 degC [W/(m K)]."""
    specific_heat: Annotated[float, DIMENSIONS["specific heat"]] | None = None
    """Specific heat near 20 degC [J/(kg K)]."""
    source: str = ""
    """Source of the values."""

    def __post_init__(self) -> None:
        for field, (low, high) in _PLAUSIBLE.items():
            value = getattr(self, field)
            if value is not None and not low <= value <= high:
                raise StageError(
                    f"material '{self.name}': {field} must lie between {low:g} and {high:g} (SI), "
                    f"got {value!r}"
                )
        if not -1.0 < self.poissons_ratio < 0.5:
            raise StageError(
                f"material '{self.name}': poissons_ratio must lie between -1 and 0.5, "
                f"got {self.poissons_ratio!r}"
            )


_ASM = "ASM Metals Handbook vol. 2 (1990), typical values"
_MIL = "MIL-HDBK-5J (2003) and ASM Metals Handbook vol. 1-2 (1990), typical values"

#: Specific heats are those of W. D. Callister, Fundamentals of Materials Science and Engineering,
#: table B.8; for Ti-6Al-4V handbooks disagree (526 to 610), so that none is given.
CATALOGUE: dict[str, Material] = {
    m.name: m
    for m in (
        Material(
            name="Al 7075-T6",
            youngs_modulus=71.7e9,
            poissons_ratio=0.33,
            density=2810.0,
            yield_strength=505e6,
            fatigue_limit=159e6,
            fatigue_cycles=5e8,
            thermal_expansion=23.6e-6,
            thermal_conductivity=130.0,
            specific_heat=960.0,
            source=f"{_ASM}; yield 505 MPa as used by the study of the two XY stages "
            "(454.5 MPa is called 90 % of it), against 503 MPa in the handbook; fatigue: "
            "R. R. Moore rotating bending",
        ),
        Material(
            name="Al 6061-T6",
            youngs_modulus=68.9e9,
            poissons_ratio=0.33,
            density=2700.0,
            yield_strength=276e6,
            fatigue_limit=96.5e6,
            fatigue_cycles=5e8,
            thermal_expansion=23.6e-6,
            thermal_conductivity=167.0,
            specific_heat=896.0,
            source=f"{_ASM}; fatigue: R. R. Moore rotating bending",
        ),
        Material(
            name="Al 2024-T3",
            youngs_modulus=73.1e9,
            poissons_ratio=0.33,
            density=2780.0,
            yield_strength=345e6,
            fatigue_limit=138e6,
            fatigue_cycles=5e8,
            thermal_expansion=23.2e-6,
            thermal_conductivity=121.0,
            source=f"{_ASM}; fatigue: R. R. Moore rotating bending",
        ),
        Material(
            name="Stainless steel 17-4PH H900",
            youngs_modulus=196e9,
            poissons_ratio=0.272,
            density=7800.0,
            yield_strength=1170e6,
            thermal_expansion=10.8e-6,
            thermal_conductivity=17.9,
            source=f"{_MIL}; yield: minimum of AMS 5604; conductivity: AK Steel 17-4 PH "
            "data sheet, at 149 degC",
        ),
        Material(
            name="Stainless steel 304",
            youngs_modulus=193e9,
            poissons_ratio=0.29,
            density=8000.0,
            yield_strength=215e6,
            fatigue_limit=241e6,
            fatigue_cycles=1e7,
            thermal_expansion=17.2e-6,
            thermal_conductivity=16.2,
            specific_heat=500.0,
            source=f"{_MIL}; annealed",
        ),
        Material(
            name="Ti-6Al-4V",
            youngs_modulus=113.8e9,
            poissons_ratio=0.342,
            density=4430.0,
            yield_strength=880e6,
            fatigue_limit=510e6,
            fatigue_cycles=1e7,
            thermal_expansion=8.6e-6,
            thermal_conductivity=6.7,
            source=f"{_ASM}; annealed bar, unnotched fatigue",
        ),
        Material(
            name="Invar 36",
            youngs_modulus=141e9,
            poissons_ratio=0.29,
            density=8055.0,
            yield_strength=276e6,
            thermal_expansion=1.3e-6,
            thermal_conductivity=10.5,
            specific_heat=500.0,
            source="Carpenter Technology, Invar 36 data sheet; annealed bar",
        ),
        Material(
            name="Silicon <110>",
            youngs_modulus=169e9,
            poissons_ratio=0.064,
            density=2329.0,
            thermal_expansion=2.6e-6,
            thermal_conductivity=148.0,
            specific_heat=700.0,
            source="M. A. Hopcroft, W. D. Nix, T. W. Kenny, J. MEMS 19 (2010) 229: in the plane of "
            "a (100) wafer along <110>; brittle, so no yield strength is given; as an isotropic "
            "stand-in it misses nu 0.36 through the wafer and G 50.9 GPa in its plane",
        ),
    )
}


def material(name: str) -> Material:
    """Look a material up in the catalogue.

    Parameters
    ----------
    name : str
        Its designation, upper or lower case.

    Returns
    -------
    Material
        The entry.

    Raises
    ------
    StageError
        The catalogue has no such material; the nearest name is in the message.

    Examples
    --------
    >>> material("al 7075-t6").youngs_modulus
    71700000000.0
    """
    by_key = {key.casefold(): entry for key, entry in CATALOGUE.items()}
    entry = by_key.get(name.casefold())
    if entry is None:
        near = nearest(name, (m.name for m in CATALOGUE.values()), 0.3)
        hint = f" (did you mean '{near}'?)" if near else ""
        raise StageError(
            f"no material '{name}' in the catalogue{hint}: it has "
            f"{', '.join(CATALOGUE)}; or write the material out with its values"
        )
    return entry
