"""A stage from a drawing: names by position, fixed bodies, and data that the drawing lacks.

The stage file of the drawing marks these data as blanks.
"""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexstage.base.errors import StageError
from flexstage.files.names import file_name
from flexstage.quantities.material import Material, material
from flexstage.stage.drawing import DRAWINGS, DXF, STEP
from flexstage.stage.drawing.bodies import DrawnBody, bodies_of, certainty, find_necks
from flexstage.stage.drawing.contours import GAP, DrawnPart, part_of
from flexstage.stage.drawing.marks import Places, add_axes, drives_of, probes_of, whole_degrees
from flexstage.stage.drawing.profiles import Neck
from flexstage.stage.drawing.requests import DrawingOptions
from flexstage.stage.drawing.sheet import Sheet, read_dxf, read_step_plate
from flexstage.stage.file import stage_to_text
from flexstage.stage.model import Body, Hinge, Stage
from flexstage.stage.outline import Circle, Loop

#: Largest round hole that counts as one to bolt through where no layer tells [m].
LARGEST_MOUNTING_HOLE = 12e-3

_HOLES_LAYER = "HOLES"
_THICKNESS, _MATERIAL = 10e-3, "Al 7075-T6"  # where neither drawing nor options give them
_ROW = 0.02  # centres are in one row where they are this near, in heights of the part


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnNeck:
    """A neck of a drawing."""

    hinge: str
    """Name of its hinge."""
    certainty: str
    """``sure``, ``likely`` or ``doubtful``."""
    ratio: float
    """Thickness of the thinner of its two bodies over that of the neck [1]."""
    off: float
    """Largest distance of the drawn contour from its profile [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnStage:
    """A stage from a drawing."""

    stage: Stage
    """The stage; blanks have default values."""
    necks: tuple[DrawnNeck, ...]
    """Data of each neck, in the order of the hinges."""
    blanks: tuple[str, ...]
    """Data that the drawing lacks: ``thickness``, ``material``, ``drives``, ``probes``, or the
    name of a drive without an actuator.
    """
    excluded: tuple[tuple[str, int], ...]
    """Kinds of entities that are no contours, and how many of each."""
    unit_name: str
    """Unit of the drawing."""


def read_drawing(path: str | os.PathLike[str], options: DrawingOptions | None = None) -> DrawnStage:
    """Read a drawing of a plate, and find the bodies and necks in it.

    Parameters
    ----------
    path : str or os.PathLike
        A DXF file with the contours of a plate, or a STEP file with a plate of one thickness.
    options : DrawingOptions, optional
        Data beyond the file.

    Returns
    -------
    DrawnStage
        The stage, the certainty of its necks, and the data that the drawing lacks.

    Raises
    ------
    StageError
        The file is no such drawing, its contours are not closed or cross, or a neck matches no
        hinge profile; the message gives the place in the drawing.

    Notes
    -----
    Validity: necks are at least 1.5 times thinner than the bodies next to them, or as thin as
    `ContourOptions.neck_limit`; profiles are within 0.5 um of the drawn contour, or twice the
    rounding of a file with few digits. Strips around corners are leaves with a body in each corner.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from flexstage.stage.designs import design
    >>> from flexstage.export import dxf_files
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "guide.dxf"
    ...     _ = path.write_bytes(dxf_files(design("parallelogram"))["parallelogram.dxf"])
    ...     drawn = read_drawing(path, DrawingOptions(thickness=8e-3, material="Al 7075-T6"))
    >>> len(drawn.stage.bodies), [neck.certainty for neck in drawn.necks]
    (4, ['sure', 'sure', 'sure', 'sure'])
    """
    o = options or DrawingOptions()
    suffix = Path(path).suffix.lower()
    if suffix in DXF:
        sheet = read_dxf(path, unit=o.contours.unit, layers=o.contours.layers or None)
    elif suffix in STEP:
        sheet = read_step_plate(path)
        _agree(path, sheet, o)
    else:
        raise StageError(
            f"a drawing ends in {', '.join(DRAWINGS)}, got '{path}': export it as one of them"
        )
    part = part_of(
        sheet.curves,
        gap=GAP if o.contours.gap is None else o.contours.gap,
        unit=sheet.unit,
        unit_name=sheet.unit_name,
        rounding=sheet.rounding,
    )
    drawn_necks, gap = find_necks(part, o.contours.neck_limit)
    drawn_bodies = bodies_of(part, drawn_necks)
    bodies, order = _named_bodies(part, drawn_bodies, o, sheet)
    hinges, necks = _hinges(part, drawn_necks, drawn_bodies, bodies, order, gap)
    at = Places(sheet.unit, sheet.unit_name)
    driven = drives_of(bodies, sheet, o.drive, at)
    probes = probes_of(bodies, sheet, o.probe, at)
    thickness = o.thickness if o.thickness is not None else sheet.thickness
    blanks = ["thickness"] * (thickness is None) + ["material"] * (o.material is None)
    blanks += [d.name for d, stands_in in driven if stands_in]
    blanks += ["drives"] * (not driven) + ["probes"] * (not probes)
    stage = add_axes(
        Stage(
            name=file_name(Path(path).stem),
            title=f"From the drawing {Path(path).name}",
            thickness=_THICKNESS if thickness is None else thickness,
            material=_material(o.material),
            bodies=tuple(bodies),
            hinges=tuple(hinges),
            drives=tuple(d for d, _ in driven),
            probes=tuple(probes),
        )
    )
    return DrawnStage(
        stage=stage,
        necks=tuple(necks),
        blanks=tuple(blanks),
        excluded=sheet.excluded,
        unit_name=sheet.unit_name,
    )


def stage_of_drawing(path: str | os.PathLike[str], options: DrawingOptions) -> Stage:
    """Return the stage of a drawing, whose thickness and material must be known."""
    drawing = read_drawing(path, options)
    for what in ("thickness", "material"):
        if what in drawing.blanks:
            raise StageError(
                f"the drawing '{path}' does not give the {what} of the plate: give --{what} to "
                "'flexstage import', which writes a stage file"
            )
    return drawing.stage


def _agree(path: str | os.PathLike[str], sheet: Sheet, o: DrawingOptions) -> None:
    for name in ("unit", "layers"):
        if getattr(o.contours, name):
            raise StageError(f"{name} of --contours is for DXF files: '{path}' says its own")
    has = sheet.thickness
    if o.thickness is not None and has is not None and abs(o.thickness - has) > 1e-6 * has:
        raise StageError(
            f"the plate in '{path}' is {has * 1e3:.6g} mm thick, and --thickness says "
            f"{o.thickness * 1e3:.6g} mm: omit the option"
        )


def _material(name: str | None) -> Material:
    return material(_MATERIAL if name is None else name)


# ----------------------------------------------------------------------------------- names


def _reading_order(places: Sequence[tuple[float, float]], part: DrawnPart) -> list[int]:
    """Return the order of places by rows from above, each from the left."""
    corners = part.outline.loop.polyline(1e-5)
    height = float(corners[:, 1].max() - corners[:, 1].min())
    by_height = sorted(range(len(places)), key=lambda k: -places[k][1])
    rows: list[list[int]] = []
    for k in by_height:
        if rows and places[rows[-1][-1]][1] - places[k][1] < _ROW * height:
            rows[-1].append(k)
        else:
            rows.append([k])
    return [k for row in rows for k in sorted(row, key=lambda k: places[k][0])]


def _named_bodies(
    part: DrawnPart, drawn_bodies: Sequence[DrawnBody], o: DrawingOptions, sheet: Sheet
) -> tuple[list[Body], list[int]]:
    """Return the bodies with names and supports, and the place of each in the list."""
    centres = []
    for body in drawn_bodies:
        a = body.outline.integrals()
        centres.append((a.x / a.area, a.y / a.area))
    order = _reading_order(centres, part)
    own_layers = any(c.layer.upper() == _HOLES_LAYER for c in part.openings)
    bodies: list[Body] = []
    for k in order:
        holes: list[Loop | Circle] = []
        mounting: list[Circle] = []
        for hole, layer in zip(drawn_bodies[k].holes, drawn_bodies[k].holes_layers, strict=True):
            if isinstance(hole, Circle) and (
                layer.upper() == _HOLES_LAYER
                if own_layers
                else 2.0 * hole.radius <= LARGEST_MOUNTING_HOLE
            ):
                mounting.append(hole)
            else:
                holes.append(hole)
        bodies.append(
            Body(
                name=f"body-{k}",
                outline=drawn_bodies[k].outline,
                holes=tuple(holes),
                mounting_holes=tuple(mounting),
            )
        )
    fixed_bodies = _fixed_bodies(bodies, drawn_bodies, order, o, sheet)
    others: dict[int, tuple[Material | None, bool]] = {}
    for option in o.body:
        point, _, rest = option.partition(":")
        words = [w.strip() for w in rest.split(",")]
        names = [w for w in words if w != "rigid"]
        if len(names) > 1 or not all(words):
            raise StageError(
                'a body is its point, then a material or "rigid" or both, such as "12,4: Invar 36, '
                f"rigid\", got '{option}'"
            )
        body_material = material(names[0]) if names else None
        n = _body_of_option(bodies, point, sheet, "body")
        if n in others:
            raise StageError(
                f"'{option}' names a body twice, which another point lies on: give its material "
                'and "rigid" with one point'
            )
        others[n] = (body_material, "rigid" in words)
    renamed, number = [], 0
    for n, body in enumerate(bodies):
        if n in fixed_bodies:
            # one that others lie in is a frame
            name = "frame" if any(isinstance(h, Loop) for h in body.holes) else "base"
            name += "" if len(fixed_bodies) == 1 else f"-{sorted(fixed_bodies).index(n) + 1}"
        else:
            number += 1
            name = f"body-{number}"
        body_material, rigid = others.get(n, (None, False))
        renamed.append(
            Body(
                name=name,
                outline=body.outline,
                holes=body.holes,
                mounting_holes=body.mounting_holes,
                fixed=n in fixed_bodies,
                material=body_material,
                rigid=rigid,
            )
        )
    place = [0] * len(drawn_bodies)
    for n, k in enumerate(order):
        place[k] = n
    return renamed, place


def _fixed_bodies(
    bodies: list[Body],
    drawn_bodies: Sequence[DrawnBody],
    order: Sequence[int],
    o: DrawingOptions,
    sheet: Sheet,
) -> set[int]:
    """Return the numbers of the fixed bodies."""
    if o.fixed:
        return {_body_of_option(bodies, text, sheet, "fixed body") for text in o.fixed}
    sizes = [b.outline.integrals().area for b in bodies]

    def rank(n: int) -> tuple[int, float]:
        return (len(bodies[n].mounting_holes), sizes[n])

    outside = [n for n in range(len(bodies)) if _is_outside(bodies, n)]
    return {max(outside or range(len(bodies)), key=rank)}


def _is_outside(bodies: list[Body], n: int) -> bool:
    """Return whether no other body encloses one."""
    from flexstage.stage.shapes import ring

    inner_point = ring(bodies[n].outline).representative_point()
    return not any(
        k != n and any(isinstance(h, Loop) and ring(h).contains(inner_point) for h in other.holes)
        for k, other in enumerate(bodies)
    )


def _body_of_option(bodies: list[Body], text: str, sheet: Sheet, what: str) -> int:
    option = what.split(maxsplit=1)[0]
    verb = "holds" if option == "fixed" else "names"
    words = text.split(",")
    if len(words) == 2:
        try:
            point = (float(words[0]) * sheet.unit, float(words[1]) * sheet.unit)
        except ValueError:
            point = None
        if point is not None:
            at = Places(sheet.unit, sheet.unit_name)
            name = at.body(bodies, point, f"--{option} {verb}")
            return next(n for n, b in enumerate(bodies) if b.name == name)
    raise StageError(
        f"--{option} is a point on the {what}, such as 12,4 in the unit of the drawing, got "
        f"'{text}'"
    )


def _hinges(
    part: DrawnPart,
    necks: Sequence[Neck],
    drawn_bodies: Sequence[DrawnBody],
    bodies: Sequence[Body],
    place: Sequence[int],
    gap: tuple[float, float] | None,
) -> tuple[list[Hinge], list[DrawnNeck]]:
    owner: dict[tuple[int, int], int] = {}
    for k, body in enumerate(drawn_bodies):
        for root in body.roots:
            owner[root] = place[k]
    order = _reading_order([n.frame.at for n in necks], part)
    hinges, drawn_necks = [], []
    for number, n in enumerate(order, start=1):
        neck = necks[n]
        a, b = owner[n, 0], owner[n, 1]
        frame = neck.frame
        if a == b:
            raise StageError(
                f"the neck about {part.place(frame.at)} joins one body to itself: give "
                "--contours neck_limit=LENGTH, the thickest neck that counts"
            )
        direction = whole_degrees(frame.direction)
        # to the right, or else upward, where the notch has no side of its own
        if not neck.profile.one_sided and not -0.5 * math.pi < direction <= 0.5 * math.pi:
            a, b, direction = b, a, whole_degrees(frame.turned().direction)
        name = f"neck-{number}"
        x, y = (round(c, 13) + 0.0 for c in frame.at)
        hinges.append(
            Hinge(
                name=name,
                bodies=(bodies[a].name, bodies[b].name),
                at=(x, y),
                direction=direction,
                profile=neck.profile,
            )
        )
        drawn_necks.append(
            DrawnNeck(
                hinge=name,
                certainty=certainty(neck, gap),
                ratio=neck.thin_place.ratio,
                off=neck.off,
            )
        )
    return hinges, drawn_necks


#: Mark of a blank.
BLANK = "# FILL IN"

_TEXTS = {
    "thickness": "thickness of the plate, such as 10 mm",
    "material": "name of the material, such as Al 7075-T6",
}
_DRIVES = """\
{blank}: the drives of the stage, such as
# drives:
#   x:
#     kind: piezo
#     pushes: body-1
#     reacts: {held}
#     at: [[10, 0], [46, 0]]  # on the edge of the pushed body, on that of the other
#     direction: 180 deg
#     free_stroke: 38 um
#     stiffness: 50 N/um
"""
_PROBES = """\
{blank}: the probes that read the motion, and the axes that join drives and probes, such as
# probes:
#   x: {{body: body-1, at: [0, 0], direction: 0 deg}}
# axes:
#   x: {{drive: x, probe: x}}
"""


def stage_file_text(drawing: DrawnStage) -> str:
    """Return the text of a stage file; `BLANK` marks data that have to be filled in.

    A file whose thickness or material is blank is refused, with its line, until it is filled in.
    """
    text = stage_to_text(drawing.stage, shared=True)
    for key, what in _TEXTS.items():
        if key in drawing.blanks:
            text = re.sub(
                rf"^{key}:.*\n((?:[ -].*\n)*)", f"{key}:  {BLANK}: {what}\n", text, flags=re.M
            )
    for drive in drawing.stage.drives:
        if drive.name in drawing.blanks:
            text = text.replace(
                f"  {drive.name}:\n    kind: force\n",
                f"  {drive.name}:  {BLANK}: its actuator; a force of 1 N is assumed\n    kind: "
                "force\n",
            )
    fixed_body = next(b.name for b in drawing.stage.bodies if b.fixed)
    if "drives" in drawing.blanks:
        text += _DRIVES.format(blank=BLANK, held=fixed_body)
    if "probes" in drawing.blanks:
        text += _PROBES.format(blank=BLANK)
    return text
