"""`flexstage part`: solids that were drawn elsewhere: faces, mass, modes, stiffness, ratio."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import (
    JsonOption,
    QuietOption,
    from_docstring,
    one_of,
    option,
    optional,
    quantity,
    refuse,
)
from flexstage.cli.output import (
    FigureFile,
    console,
    print_json,
    print_notes,
    print_table,
    progress_bar,
    write_picture,
)
from flexstage.cli.part_materials import DEFAULT, materials_of
from flexstage.files.plain import picked

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from flexstage.fem.part import Part
    from flexstage.fem.part_analysis import PartAnalysis
    from flexstage.material import Material

_MOTIONS = ("x", "y", "z", "about x", "about y", "about z")
_NOTHING = 1e-9  # part of the largest figure of a table, or of the part's size, that counts as none


@from_docstring
def part(
    file: Annotated[Path, typer.Argument()],
    solids: str = "all",
    material: Annotated[
        list[str] | None,
        option(
            "[SOLID=]MATERIAL",
            f'Material: a name from the catalogue (default: {DEFAULT}), or "E=193 GPa, '
            'nu=0.31, rho=7750 kg/m^3"; for one solid with its name or number first, such '
            'as "2=E=46 GPa, nu=0.3, rho=7600 kg/m^3"; may be repeated.',
        ),
    ] = None,
    hold: str = "",
    move: str = "",
    at: str = "",
    ratio: str = "",
    interfaces: Annotated[str, one_of(("rigid", "mean", "both"))] = "both",
    order: int = 3,
    size: str | None = None,
    thin: float = 1.5,
    modes: Annotated[int, typer.Option(min=0)] = 6,
    force: bool = False,
    figure: FigureFile = None,
    quiet: QuietOption = False,
    json: JsonOption = False,
) -> None:
    """Compute faces, mass, modes and stiffness of a STEP part.

    Parameters
    ----------
    file
        FILE: A STEP file with solids.
    solids
        NAMES: Solids to use, by name or number from 1, separated by commas; solids whose faces
        touch are joined.
    hold
        FACES: Fixed faces, separated by commas: names, or x-min, z-max, ... for the plane faces at
        an end of the part.
    move
        FACES: Faces to move: their stiffness against the fixed faces is computed.
    at
        X,Y,Z: Reference point of the stiffness, such as "0 mm,0 mm,7.5 mm"; bare numbers are in
        millimetres (default: the centroid of the moved faces).
    ratio
        FACES:FACES:FACES: Two faces that a drive pushes apart, and the output face: its motion for
        each micrometre of the drive is computed, with one end fixed.
    interfaces
        Fixed, moved and pushed faces are rigid, or deform and count by their mean
        motion, fixed and moved ones by that of each group that touches.
    order
        N: Order of the elements; 0 lists the faces only.
    size
        LENGTH: Largest element, such as "2 mm"; a bare number is in millimetres.
    thin
        N: Largest element in thin places, in local thicknesses.
    modes
        N: Number of natural frequencies to compute.
    force
        Continue although the memory may not suffice.
    figure
        Draw the part from both sides, with the names of its faces. (.svg, .png or .pdf)
    """
    from flexstage.errors import StageError
    from flexstage.fem.part import read_step
    from flexstage.fem.part_analysis import INTERFACES, analyse_part, named_faces
    from flexstage.fem.part_mesh import PartMesh

    words = solids if solids == "all" else [w.strip() for w in solids.split(",")]
    read = read_step(file, solid=words)
    of = materials_of(read, material or [])
    held = named_faces(read, hold) if hold else ()
    moved = named_faces(read, move) if move else ()
    about = _point(at) if at else None
    three = [named_faces(read, text) for text in ratio.split(":")] if ratio else []
    refuse(
        ratio and len(three) != 3,
        f"--ratio is between three faces, END:END:OUTPUT, such as face7:face9:z-max, got '{ratio}'",
        StageError,
    )
    found = None
    if order:
        mesh = PartMesh(
            order=order,
            size=optional(size, "length", bare_unit="mm"),
            thin=thin,
        )
        kinds = INTERFACES if interfaces == "both" else (interfaces,)
        with progress_bar("part", quiet=quiet):
            found = analyse_part(
                read,
                of,
                hold=held,
                move=moved,
                at=about,
                ratio=(three[0], three[1], three[2]) if three else None,
                interfaces=kinds,
                mesh=mesh,
                modes=modes,
                force=force,
                expect=lambda e: typer.echo(f"expected: {e.words()}", err=True),
            )
    write_picture(figure, lambda: _drawn(read, held, moved))
    if json:
        print_json(_plain(read, of, found))
        return
    screen = console()
    _faces(screen, read)
    _bodies(screen, read, of)
    if found is not None:
        _found(screen, found)
    if figure is not None:
        screen.print(f"picture: {figure}", markup=False)


def _drawn(read: "Part", held: Any, moved: Any) -> "Figure":
    from flexstage.report.figures.part import draw_part  # it loads what draws

    return draw_part(read, held=held, moved=moved)


def _point(text: str) -> tuple[float, ...]:
    words = text.split(",")
    sentence = f"--at is three lengths X,Y,Z, such as 0,0,7.5 in millimetres, got '{text}'"
    refuse(len(words) != 3, sentence, typer.BadParameter)
    return tuple(quantity(word, "length", bare_unit="mm") for word in words)


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

    from flexstage.quantities import number

    how = f"held at {', '.join(found.held)}" if found.held else "free"
    kinds = list(found.results)
    count = max(len(r.frequency_hz) for r in found.results.values())
    if count:
        columns = kinds if found.held else ["frequency"]
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
    from flexstage.quantities import number

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


def _plain(
    read: "Part",
    of: Mapping[str, "Material"],
    found: "PartAnalysis | None",
) -> dict[str, Any]:
    out: dict[str, Any] = {
        "source": read.source,
        "volume": read.volume,
        "mass": read.mass(of),
        "solids": [
            {
                "name": name,
                "volume": solid.mass * 1e-9,
                "material": of[name].name,
                **picked(of[name], "youngs_modulus", "poissons_ratio", "density"),
            }
            for name, solid in zip(read.bodies, read.shape.solids, strict=True)
        ],
        "faces": [
            picked(face, "name", "kind", "area", "centre", "solids=bodies") for face in read.faces
        ],
    }
    if found is None:
        return out
    return out | {
        **picked(found, "order", "elements", "unknowns"),
        "expected": picked(found.expected, "elements", "unknowns", "memory", "seconds"),
        **picked(found, "held", "moved", "at"),
        "interfaces": {
            kind: picked(r, "natural_frequency_hz=frequency_hz", "stiffness")
            | {
                "ratio": None
                if r.ratio is None
                else picked(r.ratio, "direction", "motion", "ratio", "stiffness")
            }
            for kind, r in found.results.items()
        },
    }
