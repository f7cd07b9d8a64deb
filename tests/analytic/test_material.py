"""Materials: what the catalogue holds, and what is refused."""

import pytest

from flexstage.errors import StageError
from flexstage.material import CATALOGUE, Material, material


def test_every_entry_says_where_it_comes_from_and_is_a_solid() -> None:
    for entry in CATALOGUE.values():
        assert len(entry.source) > 20
        # speed of sound in a bar of a metal or of silicon
        assert 3000.0 < (entry.youngs_modulus / entry.density) ** 0.5 < 9000.0
        assert (entry.fatigue_limit is None) == (entry.fatigue_cycles is None)


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
