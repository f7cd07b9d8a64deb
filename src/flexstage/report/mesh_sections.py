"""Sections of the report on models with a mesh: stress, modes, convergence."""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

from flexstage.quantities import display
from flexstage.report.figures.convergence import draw_convergence
from flexstage.report.figures.fe_modes import draw_fe_modes
from flexstage.report.figures.neck_stress import draw_neck_stress, neck_sampler
from flexstage.report.figures.style import inline_svg
from flexstage.report.page import figure, row_of

if TYPE_CHECKING:
    from flexstage.report.models import ModelRun
    from flexstage.report.study import Study


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
            figure(
                inline_svg(
                    draw_neck_stress(run.mesh, run.analysis, axis, sampler=sampler),
                    f"necks-{name}-{i}",
                    f"stress at the necks, {axis}, model {name}",
                ),
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
            svg = inline_svg(
                draw_fe_modes(run.mesh, run.analysis), f"fem-modes-{name}", f"modes, model {name}"
            )
            return figure(
                svg,
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
        svg = inline_svg(
            draw_convergence(found), f"convergence-{name}", f"convergence of model {name}"
        )
        words = (
            f"Change from mesh to mesh; {mesh_words(name, run)}. Requested: {escape(asked)} to "
            f"{100.0 * found.accuracy:.3g} %; estimate of the last mesh: "
            f"{100.0 * found.estimate:.2g} %. Stress is read at points on the notches and settles "
            "last."
        )
        parts.append(figure(svg, words, kind="small"))
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
