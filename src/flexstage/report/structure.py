"""The sections of the report on the equations of motion, and on their structural diagram."""

import re
from html import escape
from typing import TYPE_CHECKING

from flexstage.errors import FlexstageError

if TYPE_CHECKING:
    from flexstage.report.study import Study

__all__ = ["diagram_section", "equations_section"]


def equations_section(study: "Study") -> str:
    """Return what the lumped model rests on.

    Parameters
    ----------
    study : Study
        The study.

    Returns
    -------
    str
        HTML; empty where the study has no lumped model.
    """
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

    Parameters
    ----------
    study : Study
        The study.

    Returns
    -------
    str
        HTML with the drawings in it; empty where the study has no lumped model, or the stage no
        drive.
    """
    lumped = study.analyses.get("lumped")
    if lumped is None or not study.stage.drives:
        return ""
    from flexstage.export import dynamic_model
    from flexstage.export.diagram import diagram_files

    try:
        model = dynamic_model(study.stage, lumped.system)
        files = diagram_files(study.stage, model=model)
    except FlexstageError as error:
        return f"<p>No diagram could be drawn: {escape(str(error))}</p>"
    whole = files.pop("diagram.svg")
    axes = "".join(_drawing(svg, "plot") for svg in files.values())
    return (
        "<p>Lagrange's equations as blocks and lines, each axis by itself. "
        "<code>flexstage export STAGE --to simulink</code> builds that of the whole stage.</p>"
        f'<div class="plots">{axes}</div>'
        "<details><summary>The whole stage, bodies and hinges that are alike drawn once</summary>"
        f'<div class="wide">{_drawing(whole, "natural")}</div></details>'
    )


def _drawing(svg: bytes, kind: str) -> str:
    """Return a drawing as a part of the page, without what only a file of its own has."""
    text = re.sub(r"^\s*<\?xml[^>]*\?>\s*", "", svg.decode())
    # in a page a drawing needs no name of its format, and a page that names no address loads none
    text = re.sub(r'\sxmlns="[^"]*"', "", text, count=1)
    return text.replace("<svg", f'<svg class="{kind}"', 1)
