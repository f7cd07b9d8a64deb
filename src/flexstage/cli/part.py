"""`flexstage part`: a solid that was drawn elsewhere: faces, mass, modes, stiffness."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.common import JsonOption, console, make_table, print_json, progress_bar

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.fem.part import Part
    from flexstage.fem.part_analysis import PartAnalysis

__all__ = ["part"]

_MOTIONS = ("x", "y", "z", "about x", "about y", "about z")


def part(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A STEP file with a solid.")],
    material: Annotated[
        str, typer.Option(metavar="NAME", help="What it is made of, from the catalogue.")
    ] = "Al 7075-T6",
    hold: Annotated[
        str,
        typer.Option(
            metavar="FACES",
            help="Faces that are held, with commas between: names, or x-min, z-max, ... for the "
            "plane faces at an end.",
        ),
    ] = "",
    move: Annotated[
        str, typer.Option(metavar="FACES", help="Faces whose stiffness against them is wanted.")
    ] = "",
    order: Annotated[
        int, typer.Option(metavar="N", help="Order of the elements; 0 only lists the faces.")
    ] = 3,
    size: Annotated[
        float | None, typer.Option(metavar="MM", help="Largest element in millimetres.")
    ] = None,
    modes: Annotated[int, typer.Option(metavar="N", help="Number of natural frequencies.")] = 6,
    json: JsonOption = False,
) -> None:
    """List the faces of a part from a STEP file; find its mass, modes and stiffness."""
    from flexstage.fem.part import read_step
    from flexstage.fem.part_analysis import analyse_part, named_faces
    from flexstage.fem.part_mesh import PartMesh
    from flexstage.material import material as find

    what = find(material)
    read = read_step(file)
    held = named_faces(read, hold) if hold else ()
    moved = named_faces(read, move) if move else ()
    found = None
    if order:
        mesh = PartMesh(order=order, size=None if size is None else size * 1e-3)
        with progress_bar():
            found = analyse_part(read, what, hold=held, move=moved, mesh=mesh, modes=modes)
    if json:
        print_json(_plain(read, read.mass(what), found))
        return
    screen = console()
    _faces(screen, read)
    screen.print(
        f"volume {read.volume * 1e9:.6g} mm³; {what.name}: {read.mass(what) * 1e3:.5g} g",
        markup=False,
    )
    if found is not None:
        _found(screen, found)


def _faces(screen: "Console", read: "Part") -> None:
    table = make_table(f"faces of {read.source}", "face", "<kind", "area, mm²", "<centre, mm")
    for face in read.faces:
        centre = ", ".join(f"{1e3 * c:.4g}" for c in face.centre)
        table.add_row(face.name, face.kind, f"{face.area * 1e6:.4g}", centre)
    screen.print(table)


def _found(screen: "Console", found: "PartAnalysis") -> None:
    from flexstage.report import number

    how = f"held at {', '.join(found.held)}" if found.held else "free"
    table = make_table(f"natural frequencies in Hz, {how}", "mode", "frequency")
    for k, f in enumerate(found.frequency_hz, start=1):
        table.add_row(str(k), number(float(f)))
    screen.print(table)
    if found.stiffness is not None:
        at = ", ".join(f"{1e3 * c:.4g}" for c in found.at)
        table = make_table(
            f"stiffness of {', '.join(found.moved)} about ({at}) mm, in N, m and rad",
            "force \\ motion",
            *_MOTIONS,
        )
        scale = abs(found.stiffness).max()
        for name, row in zip(_MOTIONS, found.stiffness, strict=True):
            table.add_row(name, *("≈ 0" if abs(v) < 1e-9 * scale else number(v) for v in row))
        screen.print(table)
    screen.print(
        f"note: finite elements of order {found.order}, {found.unknowns} unknowns; small "
        "displacements, one isotropic material; held and moved faces are rigid",
        style="dim",
        markup=False,
    )


def _plain(read: "Part", mass: float, found: "PartAnalysis | None") -> dict[str, Any]:
    out: dict[str, Any] = {
        "source": read.source,
        "volume": read.volume,
        "mass": mass,
        "faces": [
            {"name": f.name, "kind": f.kind, "area": f.area, "centre": list(f.centre)}
            for f in read.faces
        ],
    }
    if found is not None:
        out |= {
            "order": found.order,
            "unknowns": found.unknowns,
            "held": list(found.held),
            "natural_frequency_hz": found.frequency_hz.tolist(),
            "moved": list(found.moved),
            "stiffness": None if found.stiffness is None else found.stiffness.tolist(),
        }
    return out
