"""What words say a part is made of: a name, or figures; of all solids, or of one."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from flexstage.elasticity.requests import DEFAULT_MATERIAL
from flexstage.errors import StageError, UnitError
from flexstage.material import Material, material
from flexstage.units import parse

if TYPE_CHECKING:
    from flexstage.fem.part import Part

_FIGURES = {"e": ("pressure", "Pa"), "nu": ("", ""), "rho": ("density", "kg/m^3")}


def materials_of(part: "Part", given: Sequence[str]) -> Mapping[str, Material]:
    """Return what each solid of a part is made of, by its name.

    Each text is a material for all solids, or ``SOLID=MATERIAL`` with a name or number from 1; a
    material is a name from the catalogue, or ``E=..., nu=..., rho=...``, bare numbers in SI.
    """
    every: Material | None = None
    of: dict[str, Material] = {}
    for text in given:
        head, sign, rest = text.partition("=")
        if sign and head.strip().casefold() not in _FIGURES:
            name = _solid(part, head.strip())
            if name in of:
                raise StageError(f"solid '{name}' is given two materials: give it one")
            of[name] = _material(rest)
        elif every is not None:
            raise StageError(
                f"'{given[0]}' and '{text}' are both for all solids: write SOLID=MATERIAL for one "
                f"of {', '.join(part.bodies)}"
            )
        else:
            every = _material(text)
    lacking = [name for name in part.bodies if name not in of]
    if lacking and every is None:
        if given:
            raise StageError(
                f"solid '{lacking[0]}' has no material: give it one as --material "
                f'"{lacking[0]}=...", or one for all others without a name'
            )
        every = _material(DEFAULT_MATERIAL)
    return {name: of.get(name, every) for name in part.bodies}  # type: ignore[misc]


def _solid(part: "Part", word: str) -> str:
    if word in part.bodies:
        return word
    if word.isdigit() and 0 < int(word) <= len(part.bodies):
        return part.bodies[int(word) - 1]
    known = ", ".join(f"{k} {name}" for k, name in enumerate(part.bodies, 1))
    raise StageError(f"{part.source} has no solid '{word}' to give a material to: it has {known}")


def _material(text: str) -> Material:
    if "=" not in text:
        return material(text.strip())
    figures: dict[str, float] = {}
    for word in text.split(","):
        key, _, value = (w.strip() for w in word.partition("="))
        if key.casefold() not in _FIGURES or key.casefold() in figures:
            raise StageError(
                f"a material is a name, or 'E=193 GPa, nu=0.31, rho=7750 kg/m^3' with each of the "
                f"three once, got '{word.strip()}'"
            )
        dimension, unit = _FIGURES[key.casefold()]
        try:
            figures[key.casefold()] = (
                parse(value, dimension, bare_unit=unit) if dimension else float(value)
            )
        except UnitError as error:
            raise UnitError(f"{key} of the material '{text.strip()}': {error}") from error
        except ValueError as error:
            raise StageError(f"{key} of a material is a plain number, got '{value}'") from error
    missing = [key for key in _FIGURES if key not in figures]
    if missing:
        raise StageError(f"the material '{text.strip()}' lacks {' and '.join(missing)}")
    return Material(
        name=" ".join(text.split()),
        youngs_modulus=figures["e"],
        poissons_ratio=figures["nu"],
        density=figures["rho"],
        source="command line",
    )
