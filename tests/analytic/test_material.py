"""Materials: what the catalogue holds, and what is refused."""

import pytest

from flexstage.base.errors import StageError
from flexstage.quantities.material import CATALOGUE, Material, material


def test_every_entry_says_where_it_comes_from_and_is_a_solid() -> None:
    for entry in CATALOGUE.values():
        assert len(entry.source) > 20
        # speed of sound in a bar of a metal or of silicon
        assert 3000.0 < (entry.youngs_modulus / entry.density) ** 0.5 < 9000.0
        assert (entry.fatigue_limit is None) == (entry.fatigue_cycles is None)


@pytest.mark.parametrize(
    ("name", "gigapascal", "density", "strength", "fatigue", "expansion"),
    [
        # typical values as ASM prints them; the strength of 7075 is that of the study
        ("Al 7075-T6", 71.7, 2810.0, 505.0, 159.0, 23.6),
        ("Al 6061-T6", 68.9, 2700.0, 276.0, 96.5, 23.6),
        ("Al 2024-T3", 73.1, 2780.0, 345.0, 138.0, 23.2),
    ],
)
def test_wrought_aluminium_is_as_in_the_handbook(
    name: str, gigapascal: float, density: float, strength: float, fatigue: float, expansion: float
) -> None:
    found = material(name)
    assert (found.youngs_modulus, found.poissons_ratio) == (gigapascal * 1e9, 0.33)
    assert (found.density, found.yield_strength) == (density, strength * 1e6)
    # five hundred million cycles of rotating bending, by the machine of R. R. Moore
    assert (found.fatigue_limit, found.fatigue_cycles) == (fatigue * 1e6, 5e8)
    assert found.thermal_expansion == pytest.approx(expansion * 1e-6, rel=1e-12)


def test_the_nearest_name_is_offered() -> None:
    with pytest.raises(StageError, match="did you mean 'Al 7075-T6'"):
        material("Al 7075 T6")


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"youngs_modulus": -1.0}, "youngs_modulus"),
        ({"youngs_modulus": 71.7}, "between 1000 and 1e\\+14"),
        ({"density": 1e-300}, "density"),
        ({"poissons_ratio": 0.5}, "poissons_ratio"),
        ({"yield_strength": float("nan")}, "yield_strength"),
    ],
)
def test_impossible_materials_are_refused(changes: dict, part: str) -> None:
    sound = {"name": "x", "youngs_modulus": 7e10, "poissons_ratio": 0.31, "density": 2700.0}
    Material(**sound)
    with pytest.raises(StageError, match=part):
        Material(**{**sound, **changes})
