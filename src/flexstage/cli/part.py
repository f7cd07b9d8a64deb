"""`flexstage part`: solids that were drawn elsewhere: faces, mass, modes, stiffness, ratio."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexstage.cli.options import JsonOption, QuietOption, from_docstring
from flexstage.cli.output import (
    FigureFile,
    console,
    print_json,
    print_notes,
    print_table,
    progress_bar,
    write_picture,
)
from flexstage.elasticity.requests import PartRequest

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.fem.part import Part
    from flexstage.fem.part_analysis import PartAnalysis
    from flexstage.quantities.material import Material

_MOTIONS = ("x", "y", "z", "about x", "about y", "about z")
_NOTHING = 1e-9  # part of the largest figure of a table, or of the part's size, that counts as none


@from_docstring
def part(
    file: Annotated[Path, typer.Argument()],
    request: PartRequest,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute faces, mass, modes and stiffness of a STEP part.

    Parameters
    ----------
    file
        FILE: A STEP file with solids.
    figure
        Draw the part from both sides, with the names of its faces. (.svg, .png or .pdf)
    """
    from flexstage.fem.part_analysis import part_result

    with progress_bar("part", quiet=quiet or not request.order):
        found = part_result(
            file, request, expect=lambda e: typer.echo(f"expected: {e.words()}", err=True)
        )
    write_picture(figure, found.plot)
    if json:
        print_json(found.to_dict())
        return
    screen = console()
    _faces(screen, found.part)
    _bodies(screen, found.part, found.materials)
    if found.analysis is not None:
        _found(screen, found.analysis)
    if figure is not None:
        screen.print(f"picture: {figure}", markup=False)


def _millimetres(read: "Part", point: Sequence[float]) -> str:
    nothing = _NOTHING * math.dist(*read.bounding_box)
    return ", ".join(f"{0.0 if abs(c) < nothing else 1e3 * c:.4g}" for c in point)


def _faces(screen: "Console", read: "Part") -> None:
    several = len(read.bodies) > 1
    heads = ["face", "<kind", "area, mm²", "<centre, mm"]
    rows = [
        [face.name, face.kind, f"{face.area * 1e6:.4g}", _millimetres(read, face.centre)]
        for face in read.faces
    ]
    if several:
        heads.append("<of")
        rows = [[*row, " and ".join(f.bodies)] for row, f in zip(rows, read.faces, strict=True)]
    print_table(screen, f"faces of {read.source}", heads, rows)


def _bodies(screen: "Console", read: "Part", of: Mapping[str, "Material"]) -> None:
    if len(read.bodies) == 1:
        (what,) = of.values()
        screen.print(
            f"volume {read.volume * 1e9:.6g} mm³; {what.name}: {read.mass(of) * 1e3:.5g} g",
            markup=False,
        )
        return
    rows = [
        (name, of[name].name, f"{solid.mass:.6g}", f"{of[name].density * solid.mass * 1e-6:.5g}")
        for name, solid in zip(read.bodies, read.shape.solids, strict=True)
    ]
    rows.append(("all", "", f"{read.volume * 1e9:.6g}", f"{read.mass(of) * 1e3:.5g}"))
    print_table(screen, "solids", ("solid", "<material", "volume, mm³", "mass, g"), rows)
    joints = [f for f in read.faces if len(f.bodies) > 1]
    said = "; ".join(f"{' and '.join(f.bodies)} at {f.name}" for f in joints)
    screen.print(f"joined, as if bonded: {said or 'none'}", markup=False)


def _found(screen: "Console", found: "PartAnalysis") -> None:
    import numpy as np

    from flexstage.quantities.quantity import number

    how = f"held at {', '.join(found.fixed)}" if found.fixed else "free"
    kinds = list(found.results)
    count = max(len(r.frequency_hz) for r in found.results.values())
    if count:
        columns = kinds if found.fixed else ["frequency"]
        rows = (
            (k + 1, *(number(float(r.frequency_hz[k])) for r in found.results.values()))
            for k in range(count)
        )
        print_table(screen, f"natural frequencies in Hz, {how}", ("mode", *columns), rows)
    at = _millimetres(found.part, found.at)
    for kind, result in found.results.items():
        if result.stiffness is not None:
            scale = abs(result.stiffness).max()
            shown = [
                (name, *("≈ 0" if abs(v) < _NOTHING * scale else number(v) for v in row))
                for name, row in zip(_MOTIONS, result.stiffness, strict=True)
            ]
            alone = 1.0 / np.diag(np.linalg.inv(result.stiffness))
            print_table(
                screen,
                f"stiffness of {', '.join(found.moved)} about ({at}) mm, in N, m and rad, "
                f"{kind} interfaces",
                ("force \\ motion", *_MOTIONS),
                (*shown, ("others free", *(number(float(v)) for v in alone))),
            )
    _ratio(screen, found)
    kinds_said = (
        "; what is built is as a rule between rigid and mean interfaces" if len(kinds) > 1 else ""
    )
    said = (
        f"{found.elements} elements of order {found.order}, {found.unknowns} unknowns; small "
        f"displacements, isotropic materials{kinds_said}"
    )
    print_notes(screen, [said])


def _ratio(screen: "Console", found: "PartAnalysis") -> None:
    from flexstage.quantities.quantity import number

    rows = {kind: r.ratio for kind, r in found.results.items() if r.ratio is not None}
    if not rows:
        return
    axis = ", ".join(f"{c + 0.0:.4g}" for c in next(iter(rows.values())).direction.round(6))
    motions = (f"{m}, {'rad/m' if 'about' in m else 'm/m'}" for m in _MOTIONS)
    shown = []
    for kind, found_ratio in rows.items():
        size = abs(found_ratio.motion).max()
        motion = ("≈ 0" if abs(v) < 1e-6 * size else number(v) for v in found_ratio.motion)
        shown.append((kind, *motion, number(found_ratio.ratio), number(found_ratio.stiffness)))
    print_table(
        screen,
        f"motion of the output for each metre that the ends move apart along ({axis})",
        ("interfaces", *motions, "ratio", "stiffness at the ends, N/m"),
        shown,
    )
