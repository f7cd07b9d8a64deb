"""Sections of the report on models: equations, diagrams; stress, modes, convergence of meshes."""

import re
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from flexstage.errors import FlexstageError
from flexstage.quantities import display, number
from flexstage.report.figures.convergence import draw_convergence
from flexstage.report.figures.fields import draw_fe_modes
from flexstage.report.figures.neck_stress import draw_neck_stress, neck_sampler
from flexstage.report.page import fragment
from flexstage.report.tables import full_stroke_words
from flexstage.section import Content, Picture, Pictures
from flexstage.stage import PiezoStack

if TYPE_CHECKING:
    from flexstage.studies.models import ModelRun
    from flexstage.studies.study import Study


def equations_section(study: "Study") -> Iterator[Content]:
    """Say what the lumped model rests on, where the study has one."""
    if "lumped" in study.analyses:
        yield fragment("equations.html", order=study.analyses["lumped"].system.order)


def diagram_section(study: "Study") -> Iterator[Content]:
    """Show the structural diagram of each axis that one drive moves.

    Nothing where the study has no lumped model, or the stage no such axis.
    """
    named = [f"Axis {axis.name}" for axis in study.stage.axes if axis.drive is not None]
    if "lumped" not in study.analyses or not named:
        return
    try:
        drawings = [_inline(svg) for svg in study.diagrams().values()]
    except FlexstageError as error:
        yield f"No diagram could be drawn: {error}"
        return
    said = (
        "with the hysteresis that the experiment of this report identified"
        if study.experiments
        else "stacks with hysteresis of a usual width"
    )
    stacks = f", {said}" if any(isinstance(d, PiezoStack) for d in study.stage.drives) else ""
    found = _difference(study)
    captions = [f"{name}: lumped model{stacks}.{found and ' '}{found}" for name in named]
    axes = tuple(zip(drawings, captions, strict=True))
    yield fragment("diagrams.html", axes=axes)


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


def _inline(svg: bytes) -> str:
    """Return what a drawing consists of, without what only a file of its own has."""
    text = re.sub(r"^\s*<\?xml[^>]*\?>\s*", "", svg.decode())
    # in a page a drawing needs no name of its format, and a page that names no address loads none
    return re.sub(r'\sxmlns="[^"]*"', "", text, count=1).replace("<svg", "", 1)


def neck_stress_section(study: "Study") -> Iterator[Content]:
    """Show the stress at the necks, by the model with a mesh that leaves the least out."""
    for name, run in _meshed(study):
        shown = [a for a in run.analysis.axes if any(a.static.hinge_stress.values())]
        if not shown:
            continue
        assert run.mesh is not None
        sampler = neck_sampler(run.mesh)
        where = ", middle plane" if run.mesh.system.model == "solid" else ""
        yield (
            "Displacements are magnified by the factor given; dashed: at rest. Identical necks "
            "are shown once; each close-up moves with its neck. The ring marks the largest stress "
            "on the surface of the notch; the title gives its value, its place at rest and the "
            "number of the hinge. Stress at held edges is in no figure of this chapter."
        )
        yield Pictures(
            shown=tuple(
                Picture(
                    result=partial(
                        draw_neck_stress, run.mesh, run.analysis, axis.axis, sampler=sampler
                    ),
                    title=f"stress at the necks, {axis.axis}, model {name}",
                    caption=f"Equivalent stress (von Mises), {full_stroke_words(axis)}; "
                    f"{mesh_words(name, run)}{where}.",
                    size="small",
                )
                for axis in shown
            )
        )
        return


def fe_modes_section(study: "Study") -> Iterator[Content]:
    """Show the modes by the model with a mesh that leaves the least out."""
    for name, run in _meshed(study):
        if run.analysis.modes["removed"].frequency_hz.size:
            assert run.mesh is not None
            where = "" if name == "solid" else " in the plane"
            yield Picture(
                result=partial(draw_fe_modes, run.mesh, run.analysis),
                title=f"modes, model {name}",
                caption=f"Lowest modes{where}, drives removed; {mesh_words(name, run)}. Amplitudes "
                "are not to scale, so that bodies may overlap; thin: at rest.",
                size="small",
            )
            return


def convergence_section(study: "Study") -> Iterator[Content]:
    """Show how models settled as their meshes became finer, where one was refined."""
    shown = []
    for name, run in _meshed(study):
        found = run.refinement
        if found is None or len(found.steps) < 2:
            continue
        asked = display(found.quantity).label.lower()
        caption = (
            f"Change from mesh to mesh; {mesh_words(name, run)}. Requested: {asked} to "
            f"{100.0 * found.accuracy:.3g} %; estimate of the last mesh: "
            f"{100.0 * found.estimate:.2g} %. Stress is read at points on the notches and settles "
            "last."
        )
        title = f"convergence of model {name}"
        draw = partial(draw_convergence, found)
        shown.append(Picture(result=draw, title=title, caption=caption, size="small"))
    if shown:
        yield "Refinement cannot reveal errors common to all meshes: geometry, material, supports."
        yield Pictures(shown=tuple(shown))


def mesh_words(name: str, run: "ModelRun") -> str:
    """Return a model with a mesh in a few words without a full stop."""
    mesh = run.mesh
    assert mesh is not None
    held = mesh.system.settings.get("held", "")
    unknowns = f"{mesh.unknowns:,}".replace(",", "\u00a0")
    return (
        f"model {name}, elements of order {mesh.mesh_settings.order}, {unknowns} unknowns, "
        f"{held or 'nothing is fixed'}"
    )


def _meshed(study: "Study") -> "Iterator[tuple[str, ModelRun]]":
    """Models with a mesh, the one that leaves the least out first."""
    for name in ("solid", "plane"):
        run = study.runs.get(name)
        if run is not None and run.mesh is not None:
            yield name, run
