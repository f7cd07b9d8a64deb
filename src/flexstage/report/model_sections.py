"""Sections of the report on models: equations, diagrams; stress, modes, convergence of meshes."""

import re
from collections.abc import Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING

from flexstage.errors import FlexstageError
from flexstage.quantities import display, number
from flexstage.report.figures.convergence import draw_convergence
from flexstage.report.figures.fields import draw_fe_modes
from flexstage.report.figures.neck_stress import draw_neck_stress, neck_sampler
from flexstage.report.page import drawn, figure, row_of
from flexstage.stage import PiezoStack

if TYPE_CHECKING:
    from flexstage.studies.models import ModelRun
    from flexstage.studies.study import Study


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
    from flexstage.export.diagram.svg import diagram_files
    from flexstage.hysteresis import dynamic_model

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


def neck_stress_section(study: "Study") -> str:
    """Return the stress at the necks, by the model with a mesh that leaves the least out.

    Empty where no model has a mesh.
    """
    for name, run in _meshed(study):
        shown = [a.axis for a in run.analysis.axes if any(a.static.hinge_stress.values())]
        if not shown:
            continue
        assert run.mesh is not None
        sampler = neck_sampler(run.mesh)
        where = ", middle plane" if run.mesh.system.model == "solid" else ""
        plots = [
            drawn(
                draw_neck_stress(run.mesh, run.analysis, axis, sampler=sampler),
                f"necks-{name}-{i}",
                f"stress at the necks, {axis}, model {name}",
                f"Equivalent stress (von Mises), drive of {escape(axis)} at full stroke, the "
                f"others removed; {mesh_words(name, run)}{where}.",
                kind="small",
            )
            for i, axis in enumerate(shown)
        ]
        return (
            "<p>Displacements are magnified by the factor given; dashed: at rest. Identical necks "
            "are shown once; each close-up moves with its neck. The ring marks the largest stress "
            "on the surface of the notch; the title gives its value, its place at rest and the "
            "number of the hinge. Stress at held edges is in no figure of this chapter.</p>"
            + row_of(plots)
        )
    return ""


def fe_modes_section(study: "Study") -> str:
    """Return the modes by the model with a mesh that leaves the least out.

    Empty where no model has a mesh.
    """
    for name, run in _meshed(study):
        if run.analysis.modes["removed"].frequency_hz.size:
            assert run.mesh is not None
            return drawn(
                draw_fe_modes(run.mesh, run.analysis),
                f"fem-modes-{name}",
                f"modes, model {name}",
                f"Lowest modes, drives removed; {mesh_words(name, run)}. Amplitudes are not to "
                "scale, so that bodies may overlap; thin: at rest.",
                kind="small",
            )
    return ""


def convergence_section(study: "Study") -> str:
    """Return how models settled as their meshes became finer; empty where no mesh was refined."""
    parts = []
    for name, run in _meshed(study):
        found = run.refinement
        if found is None or len(found.steps) < 2:
            continue
        asked = display(found.quantity).label.lower()
        words = (
            f"Change from mesh to mesh; {mesh_words(name, run)}. Requested: {escape(asked)} to "
            f"{100.0 * found.accuracy:.3g} %; estimate of the last mesh: "
            f"{100.0 * found.estimate:.2g} %. Stress is read at points on the notches and settles "
            "last."
        )
        title = f"convergence of model {name}"
        plot = draw_convergence(found)
        parts.append(drawn(plot, f"convergence-{name}", title, words, kind="small"))
    if not parts:
        return ""
    return (
        "<p>Refinement cannot reveal errors common to all meshes: geometry, material, supports."
        f"</p>{row_of(parts)}"
    )


def mesh_words(name: str, run: "ModelRun") -> str:
    """Return a model with a mesh in a few words of HTML without a full stop."""
    mesh = run.mesh
    assert mesh is not None
    held = mesh.system.settings.get("held", "")
    unknowns = f"{mesh.unknowns:,}".replace(",", "\u00a0")
    return (
        f"model {escape(name)}, elements of order {mesh.mesh_settings.order}, {unknowns} unknowns, "
        f"{escape(held or 'nothing is fixed')}"
    )


def _meshed(study: "Study") -> "Iterator[tuple[str, ModelRun]]":
    """Models with a mesh, the one that leaves the least out first."""
    for name in ("solid", "plane"):
        run = study.runs.get(name)
        if run is not None and run.mesh is not None:
            yield name, run
