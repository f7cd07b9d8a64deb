"""The notches of notch-fe.csv, with their dimensions; the numbers are in the file."""

import csv
from pathlib import Path

from flexstage.hinges import (
    CornerFilleted,
    Elliptical,
    Hyperbolic,
    Leaf,
    Parabolic,
    PowerFunction,
    Profile,
    RightCircular,
    VFillet,
)

POISSON = 0.33

CASES: dict[str, Profile] = {
    "circular-check": RightCircular(neck_thickness=0.2, radius=1.0),
    "leaf-short": Leaf(neck_thickness=0.35, leaf_length=1.6, notch_depth=0.9),
    "leaf-long": Leaf(neck_thickness=0.2, leaf_length=3.1, notch_depth=0.35),
    "leaf-low-step": Leaf(neck_thickness=0.5, leaf_length=1.7, notch_depth=0.14),
    "corner-filleted-short": CornerFilleted(
        neck_thickness=0.3, notch_length=2.1, fillet_radius=0.45
    ),
    "corner-filleted-long": CornerFilleted(
        neck_thickness=0.22, notch_length=3.3, fillet_radius=0.13
    ),
    "elliptical": Elliptical(neck_thickness=0.24, half_length=1.7, notch_depth=0.8),
    "elliptical-deep": Elliptical(neck_thickness=0.24, half_length=0.8, notch_depth=1.1),
    "parabolic": Parabolic(neck_thickness=0.3, half_length=1.3, notch_depth=0.9),
    "hyperbolic": Hyperbolic(neck_thickness=0.35, half_length=1.2, notch_depth=0.7),
    "v": VFillet(neck_thickness=0.25, half_opening_angle=0.6, fillet_radius=0.4, notch_depth=1.1),
    "power": PowerFunction(neck_thickness=0.2, half_length=1.1, notch_depth=0.6, exponent=3.5),
    "circular-one-sided-thin": RightCircular(neck_thickness=0.12, radius=1.0, one_sided=True),
    "circular-one-sided": RightCircular(neck_thickness=0.3, radius=1.0, one_sided=True),
    "leaf-one-sided": Leaf(neck_thickness=0.3, leaf_length=1.7, notch_depth=0.8, one_sided=True),
    "corner-filleted-one-sided": CornerFilleted(
        neck_thickness=0.3, notch_length=2.3, fillet_radius=0.4, one_sided=True
    ),
    "elliptical-one-sided": Elliptical(
        neck_thickness=0.2, half_length=1.7, notch_depth=0.8, one_sided=True
    ),
    "hyperbolic-one-sided": Hyperbolic(
        neck_thickness=0.35, half_length=1.2, notch_depth=0.7, one_sided=True
    ),
    "v-one-sided": VFillet(
        neck_thickness=0.25,
        half_opening_angle=0.6,
        fillet_radius=0.4,
        notch_depth=1.1,
        one_sided=True,
    ),
    "parabolic-one-sided": Parabolic(
        neck_thickness=0.3, half_length=1.3, notch_depth=0.9, one_sided=True
    ),
}


def read_table() -> dict[str, dict[str, float]]:
    """Return the rows of notch-fe.csv by case; columns that a case does not have are left out."""
    path = Path(__file__).with_name("notch-fe.csv")
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return {
        row.pop("case"): {name: float(text) for name, text in row.items() if text}
        for row in csv.DictReader(lines)
    }
