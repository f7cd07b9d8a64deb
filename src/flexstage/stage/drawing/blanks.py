"""The stage file of a drawing, with what the drawing does not say as marked blanks."""

import re

from flexstage.stage.drawing.drawn_stage import DrawnStage
from flexstage.stage.file import stage_to_text

#: What marks a blank.
BLANK = "# FILL IN"

_TEXTS = {
    "thickness": "thickness of the plate, such as 10 mm",
    "material": "name of the material, such as Al 7075-T6",
}
_DRIVES = """\
{blank}: what drives the stage, such as
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
{blank}: where its motion is read, and which drive belongs to which probe, such as
# probes:
#   x: {{body: body-1, at: [0, 0], direction: 0 deg}}
# axes:
#   x: {{drive: x, probe: x}}
"""


def stage_file_text(drawn: DrawnStage) -> str:
    """Return the text of a stage file; `BLANK` stands where something has to be filled in.

    A file whose thickness or material is blank is refused, with its line, until it is filled in.
    """
    text = stage_to_text(drawn.stage, shared=True)
    for key, what in _TEXTS.items():
        if key in drawn.blanks:
            text = re.sub(
                rf"^{key}:.*\n((?:[ -].*\n)*)", f"{key}:  {BLANK}: {what}\n", text, flags=re.M
            )
    for drive in drawn.stage.drives:
        if drive.name in drawn.blanks:
            text = text.replace(
                f"  {drive.name}:\n    kind: force\n",
                f"  {drive.name}:  {BLANK}: its actuator; a force of 1 N stands in\n"
                "    kind: force\n",
            )
    held = next(b.name for b in drawn.stage.bodies if b.fixed)
    if "drives" in drawn.blanks:
        text += _DRIVES.format(blank=BLANK, held=held)
    if "probes" in drawn.blanks:
        text += _PROBES.format(blank=BLANK)
    return text
