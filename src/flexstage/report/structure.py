"""The sections of the report on the equations of motion, and on their structural diagram."""

import re
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

from flexstage.errors import FlexstageError
from flexstage.quantities import number
from flexstage.report.page import figure, row_of
from flexstage.stage import PiezoStack

if TYPE_CHECKING:
    from flexstage.report.study import Study


def equations_section(study: "Study") -> str:
    """Return what the lumped model rests on; empty where the study has none."""
    if "lumped" not in study.analyses:
        return ""
    order = study.analyses["lumped"].system.order
    return (
        "<p>Kinetic energy of the bodies, potential energy of the hinges with their deformations "
        "<i>e</i>, and Lagrange's equations:</p>"
        '<p class="formula"><i>T</i> = ½ Σ [ <i>m</i> (<i>ẋ</i>² + <i>ẏ</i>²) + <i>J</i> '
        "<i>θ̇</i>² ],&emsp; <i>V</i> = ½ Σ <i>e</i><sup>T</sup> <i>k e</i>,&emsp; "
        "<b>M</b> <i>q̈</i> + <b>C</b> <i>q̇</i> + <b>K</b> <i>q</i> = Σ <i>d F</i></p>"
        f"<p>Here <i>q</i> has {order} coordinates. "
        "<code>flexstage equations STAGE</code> derives all of it in "
        "symbols, with transfer functions of a reduced model.</p>"
    )


def diagram_section(study: "Study") -> str:
    """Return the structural diagrams of a stage: of each axis, then of the whole stage.

    Empty where the study has no lumped model, or the stage no drive.
    """
    lumped = study.analyses.get("lumped")
    if lumped is None or not study.stage.drives:
        return ""
    from flexstage.export import dynamic_model
    from flexstage.export.diagram.svg import diagram_files

    identified = {
        axis: made.runs[0].identification.model for axis, made in study.experiments.items()
    }
    try:
        model = dynamic_model(study.stage, lumped.system, hysteresis=identified or "usual")
        files = diagram_files(study.stage, model=model)
    except FlexstageError as error:
        return f"<p>No diagram could be drawn: {escape(str(error))}</p>"
    whole = files.pop("diagram.svg")
    said = (
        "with the hysteresis that the experiment of this report identified"
        if identified
        else "stacks with hysteresis of a usual width"
    )
    stacks = f", {said}" if any(isinstance(d, PiezoStack) for d in study.stage.drives) else ""
    found = f" {_difference(study)}" if _difference(study) else ""
    axes = row_of(
        figure(_drawing(svg, "plot"), f"{escape(name)}: lumped model{stacks}.{found}")
        for name, svg in zip(_names(study, files), files.values(), strict=True)
    )
    return (
        "<p>Lagrange's equations as blocks and lines, each axis by itself. "
        "<code>flexstage export STAGE --to simulink</code> builds that of the whole stage.</p>"
        f'<div class="diagrams">{axes}</div>'
        '<details class="screen"><summary>The whole stage, bodies and hinges that are alike drawn '
        f'once</summary><div class="wide">{_drawing(whole, "natural")}</div></details>'
    )


def _names(study: "Study", files: Mapping[str, bytes]) -> list[str]:
    axes = [axis.name for axis in study.stage.axes]
    named = [f"Axis {name}" for name in axes]
    return named if len(named) == len(files) else [f"Diagram {i + 1}" for i in range(len(files))]


def _difference(study: "Study") -> str:
    """Say by how much its frequencies are not those of the Bode diagrams."""
    if study.main.system.model == "lumped" or not study.main.axes:
        return ""
    pairs = [
        float(a.modes["in place"].frequency_hz[0]) for a in (study.analyses["lumped"], study.main)
    ]
    return (
        f"Its lowest natural frequency with the drives in place is {number(pairs[0])} Hz; the Bode "
        f"diagrams are of the {study.main.system.model} model, which has {number(pairs[1])} Hz."
    )


def _drawing(svg: bytes, kind: str) -> str:
    """Return a drawing as a part of the page, without what only a file of its own has."""
    text = re.sub(r"^\s*<\?xml[^>]*\?>\s*", "", svg.decode())
    # in a page a drawing needs no name of its format, and a page that names no address loads none
    text = re.sub(r'\sxmlns="[^"]*"', "", text, count=1)
    return text.replace("<svg", f'<svg class="{kind}"', 1)
