"""Every built-in design by three models: the table of the manual, and what its test compares.

``python -m tests.designs_by_models [NAME ...]`` prints the rows of the table.
"""

import csv
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from flexstage.fem import plane_model, superelement_model
from flexstage.lumped import lumped_system
from flexstage.stage import Stage
from flexstage.stage.designs import DESIGNS, design
from flexstage.system import MechanicalSystem, analyse

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "designs-by-models.csv"
MODELS = ("lumped", "superelement", "plane")
#: What the table has: natural frequency [Hz], ratio [1, rad/m], largest stress [MPa].
COLUMNS = ("frequency", "ratio", "stress")


class Figures(NamedTuple):
    """What the models say of an axis: for each of `COLUMNS` one figure of each of `MODELS`."""

    design: str
    axis: str
    values: tuple[tuple[float, ...], ...]


def systems(name: str) -> tuple[MechanicalSystem, ...]:
    """Return the models of a design, by the order of `MODELS`."""
    stage = design(name)
    return (lumped_system(stage), superelement_model(stage).system, plane_model(stage).system)


def said(stage: Stage, system: MechanicalSystem) -> list[tuple[float, ...]]:
    """Return what one model says of each axis, by the order of `COLUMNS`."""
    analysis = analyse(stage, system)
    rows = {(r.axis, r.quantity): r.value for r in analysis.characteristics}
    return [
        (
            rows[axis.axis, "natural_frequency_hz"],
            axis.output_displacement / axis.input_displacement,
            1e-6 * max(axis.static.hinge_stress.values()),
        )
        for axis in analysis.axes
    ]


def computed(name: str) -> list[Figures]:
    """Return what the models say of a design."""
    stage = design(name)
    found = zip(*(said(stage, system) for system in systems(name)), strict=True)
    return [
        Figures(name, axis.name, tuple(zip(*by_model, strict=True)))
        for axis, by_model in zip(stage.axes, found, strict=True)
    ]


def row(figures: Figures) -> str:
    """Write a row of the table."""
    cells = [" / ".join(f"{v:#.4g}".rstrip(".") for v in values) for values in figures.values]
    return ",".join([figures.design, figures.axis, *cells])


def printed() -> dict[tuple[str, str], Figures]:
    """Return the rows of the table in the manual."""
    _, *lines = PAGE.read_text(encoding="utf-8").splitlines()
    rows = {}
    for name, axis, *cells in csv.reader(lines):
        values = tuple(tuple(map(float, cell.split(" / "))) for cell in cells)
        rows[name, axis] = Figures(name, axis, values)
    return rows


def main(names: Iterable[str]) -> None:
    """Print the rows of designs."""
    for name in names:
        for figures in computed(name):
            sys.stdout.write(f"{row(figures)}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:] or DESIGNS)
