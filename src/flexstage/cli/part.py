"""`flexstage part`: faces, mass, modes, stiffness and ratio of solids from a STEP file."""

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
_ROUNDING = 1e-9  # relative to the largest value of a table, or to the size of the part


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
        Draw the part from four sides with the names of its faces (.svg, .png or .pdf).
    """
    from flexstage.fem.part_analysis import part_result

    with progress_bar("part", quiet=quiet or not request.order):
        result = part_result(
            file, request, expect=lambda e: typer.echo(f"expected: {e.words()}", err=True)
        )
    write_picture(figure, result.plot)
    if json:
        print_json(result.to_dict())
        return
    screen = console()
    _faces(screen, result.part)
    _bodies(screen, result.part, result.materials)
    if result.analysis is not None:
        _print_analysis(screen, result.analysis)
    if figure is not None:
        screen.print(f"picture: {figure}", markup=False)


def _millimetres(part: "Part", point: Sequence[float]) -> str:
    smallest = _ROUNDING * math.dist(*part.bounding_box)
    return ", ".join(f"{0.0 if abs(c) < smallest else 1e3 * c:.4g}" for c in point)


def _faces(screen: "Console", part: "Part") -> None:
    several = len(part.bodies) > 1
    heads = ["face", "<kind", "area, mm²", "<centre, mm"]
    rows = [
        [face.name, face.kind, f"{face.area * 1e6:.4g}", _millimetres(part, face.centre)]
        for face in part.faces
    ]
    if several:
        heads.append("<solid")
        rows = [[*row, " and ".join(f.bodies)] for row, f in zip(rows, part.faces, strict=True)]
    print_table(screen, f"faces of {part.source}", heads, rows)


def _bodies(screen: "Console", part: "Part", of: Mapping[str, "Material"]) -> None:
    if len(part.bodies) == 1:
        (material,) = of.values()
        screen.print(
            f"volume {part.volume * 1e9:.6g} mm³; {material.name}: {part.mass(of) * 1e3:.5g} g",
            markup=False,
        )
        return
    rows = [
        (name, of[name].name, f"{solid.mass:.6g}", f"{of[name].density * solid.mass * 1e-6:.5g}")
        for name, solid in zip(part.bodies, part.shape.solids, strict=True)
    ]
    rows.append(("all", "", f"{part.volume * 1e9:.6g}", f"{part.mass(of) * 1e3:.5g}"))
    print_table(screen, "solids", ("solid", "<material", "volume, mm³", "mass, g"), rows)
    joints = [f for f in part.faces if len(f.bodies) > 1]
    joints_text = "; ".join(f"{' and '.join(f.bodies)} at {f.name}" for f in joints)
    screen.print(f"bonded joints: {joints_text or 'none'}", markup=False)


def _print_analysis(screen: "Console", analysis: "PartAnalysis") -> None:
    import numpy as np

    from flexstage.quantities.quantity import number

    support = f"fixed at {', '.join(analysis.fixed)}" if analysis.fixed else "free"
    kinds = list(analysis.results)
    count = max(len(r.frequency_hz) for r in analysis.results.values())
    if count:
        columns = kinds if analysis.fixed else ["frequency"]
        rows = (
            (k + 1, *(number(float(r.frequency_hz[k])) for r in analysis.results.values()))
            for k in range(count)
        )
        print_table(screen, f"natural frequencies in Hz, {support}", ("mode", *columns), rows)
    interfaces = (*analysis.fixed_interfaces, *analysis.moved_interfaces)
    if len(interfaces) > 2:
        purposes = ["fixed"] * len(analysis.fixed_interfaces)
        purposes += ["moved"] * len(analysis.moved_interfaces)
        interface_rows = (
            (
                i.name,
                purpose,
                ", ".join(analysis.part.faces[k].name for k in i.faces),
                f"{i.area * 1e6:.4g}",
                _millimetres(analysis.part, i.centre),
            )
            for i, purpose in zip(interfaces, purposes, strict=True)
        )
        heads = ("interface", "<", "<faces", "area, mm²", "<centre, mm")
        print_table(screen, "interfaces", heads, interface_rows)
    at = _millimetres(analysis.part, analysis.at)
    for kind, result in analysis.results.items():
        if result.stiffness is not None:
            scale = abs(result.stiffness).max()
            matrix_rows = [
                (name, *("≈ 0" if abs(v) < _ROUNDING * scale else number(v) for v in row))
                for name, row in zip(_MOTIONS, result.stiffness, strict=True)
            ]
            free_stiffness = 1.0 / np.diag(np.linalg.inv(result.stiffness))
            print_table(
                screen,
                f"stiffness matrix of {', '.join(analysis.moved)} about ({at}) mm, in N, m and "
                f"rad, {kind} interfaces",
                ("force \\ motion", *_MOTIONS),
                (*matrix_rows, ("others free", *(number(float(v)) for v in free_stiffness))),
            )
    _ratio(screen, analysis)
    advice = (
        "; a part on stiff attachments that cover its interfaces lies between rigid and mean ones"
        if len(kinds) > 1
        else ""
    )
    note = (
        f"{analysis.elements} elements of order {analysis.order}, {analysis.unknowns} unknowns; "
        f"small displacements, isotropic materials{advice}"
    )
    print_notes(screen, [note])


def _ratio(screen: "Console", analysis: "PartAnalysis") -> None:
    from flexstage.quantities.quantity import number

    ratios = {kind: r.ratio for kind, r in analysis.results.items() if r.ratio is not None}
    if not ratios:
        return
    axis = ", ".join(f"{c + 0.0:.4g}" for c in next(iter(ratios.values())).direction.round(6))
    motions = (f"{m}, {'rad/m' if 'about' in m else 'm/m'}" for m in _MOTIONS)
    table_rows = []
    for kind, ratio in ratios.items():
        size = abs(ratio.motion).max()
        motion = ("≈ 0" if abs(v) < 1e-6 * size else number(v) for v in ratio.motion)
        table_rows.append((kind, *motion, number(ratio.ratio), number(ratio.stiffness)))
    print_table(
        screen,
        f"motion of the output per metre of relative motion of the ends along ({axis})",
        ("interfaces", *motions, "ratio", "stiffness at the ends, N/m"),
        table_rows,
    )
