"""A study as one HTML file that needs nothing else: no network, no other file."""

from collections.abc import Callable
from html import escape
from importlib.resources import files
from string import Template

from flexstage.characteristic import Characteristics
from flexstage.report.bench import bench_section, centring_section
from flexstage.report.figures import (
    body_symbols,
    draw_bode,
    draw_convergence,
    draw_fe_modes,
    draw_neck_stress,
    draw_stage,
    draw_static_shape,
    draw_stress,
    draw_stroke,
    inline_svg,
    mode_cards,
)
from flexstage.report.figures.neck_stress import neck_sampler
from flexstage.report.figures.style import css_variables
from flexstage.report.hysteresis import hysteresis_section
from flexstage.report.measurement_html import measurement_section
from flexstage.report.models import ModelRun
from flexstage.report.quantities import display
from flexstage.report.structure import diagram_section, equations_section
from flexstage.report.study import Study
from flexstage.report.tables import (
    characteristics_table,
    differences_table,
    hinge_table,
    published_table,
)

__all__ = ["BENCH_SECTIONS", "DRIVE_SECTIONS", "MESH_SECTIONS", "SECTIONS", "report_html"]


def report_html(study: Study) -> str:
    """Write the report of a study.

    Parameters
    ----------
    study : Study
        The study.

    Returns
    -------
    str
        The page. Sections that have nothing to show are left out.
    """
    stage = study.stage
    sections, links = [], []
    for key, (title, write) in _in_order().items():
        content = write(study)
        if content:
            sections.append(f'<section id="{key}"><h2>{title}</h2>{content}</section>')
            links.append(f'<a href="#{key}">{title}</a>')
    free = sum(not body.fixed for body in stage.bodies)
    lead = (
        f"bodies: {len(stage.bodies)} ({free} free); hinges: {len(stage.hinges)}; "
        f"drives: {len(stage.drives)}; {stage.material.name}, {stage.thickness * 1e3:g} mm thick"
    )
    page = Template(files("flexstage.report").joinpath("template.html").read_text("utf-8"))
    return page.substitute(
        version=escape(study.main.provenance.version),
        title=escape(f"{stage.name}: flexstage study"),
        light=css_variables(),
        heading=escape(f"{stage.name}: {stage.title}" if stage.title else stage.name),
        lead=escape(lead),
        notes=f'<div class="note">{_list(stage.notes)}</div>' if stage.notes else "",
        navigation="".join(links),
        symbols=body_symbols(stage),
        sections="".join(sections),
    )


def _drawing(study: Study) -> str:
    return _plot(inline_svg(draw_stage(study.stage), "stage", f"drawing of {study.stage.name}"))


def _characteristics(study: Study) -> str:
    if not study.comparison.rows:
        return ""
    return (
        "<p>Each quantity by where it comes from; hold the pointer on a value for its "
        "condition. Natural frequencies belong to the bare stage, drives removed.</p>"
        + characteristics_table(study.comparison)
        + _against(study)
    )


def _against(study: Study) -> str:
    table = differences_table(study.comparison)
    left_out = "".join(
        f"<p>The {escape(model)} model was left out: {escape(why)}.</p>"
        for model, why in study.left_out.items()
    )
    return left_out + (
        f"<p>The same as differences, in percent of what was published:</p>{table}" if table else ""
    )


def _published(study: Study) -> str:
    table = published_table(study.comparison)
    if not table:
        return ""
    return (
        "<p>What was published for this stage, and how its analytic model, finite elements and "
        "measurements differ among themselves.</p>" + table
    )


def _bode(study: Study) -> str:
    axes = [a.axis for a in study.main.axes]
    plots = [
        inline_svg(draw_bode(study.main, axis), f"bode{i}", f"Bode diagram of {axis}")
        for i, axis in enumerate(axes)
    ]
    if not plots:
        return ""
    return (
        "<p>Left: a force in place of the drive, whose own stiffness is removed. Right: the free "
        "displacement of the drive, acting through its stiffness; of a rigid drive its length "
        f"itself.</p>{_plots(plots)}"
    )


def _modes(study: Study) -> str:
    cards = mode_cards(study.main)
    if len(cards) > 1:
        choice = "".join(
            f'<button type="button" data-condition="{escape(c)}">drives {escape(c)}</button>'
            for c in cards
        )
    else:
        choice = ""
    controls = (
        f'<div class="controls">{choice}<button type="button" id="play">Pause</button>'
        '<label>amplitude <input type="range" id="amplitude" min="0" max="2" step="0.05" value="1">'
        "</label></div>"
    )
    groups = "".join(
        f'<div class="modes" data-condition="{escape(c)}">{group}</div>'
        for c, group in cards.items()
    )
    return (
        "<p>The lowest modes in the plane. A body of stronger colour moves further; amplitudes "
        f"are not to scale.</p>{controls}{groups}"
    )


def _static(study: Study) -> str:
    plots = [
        inline_svg(draw_static_shape(study.main, a.axis), f"static{i}", f"static shape of {a.axis}")
        for i, a in enumerate(study.main.axes)
    ]
    if not plots:
        return ""
    return "<p>One drive at full stroke, the others removed; dashed: at rest.</p>" + _plots(
        plots, two=True
    )


def _stroke(study: Study) -> str:
    figures = {axis: draw_stroke(path, axis) for axis, path in study.paths.items()}
    if not figures:
        return ""
    plots = [
        inline_svg(figure, f"stroke{i}", f"motion of {axis} over its stroke")
        for i, (axis, figure) in enumerate(figures.items())
    ]
    # axes that go straight have one curve, and stand side by side
    narrow = all(len(figure.axes) == 1 for figure in figures.values())
    return (
        "<p>Lumped model with finite rotations: what levers and links add to the first-order "
        "model. Rigid bodies joined symmetrically go straight; what was measured comes from "
        f"bending of the platform and from manufacture.</p>{_plots(plots, two=narrow)}"
    )


def _stress(study: Study) -> str:
    if not any(study.main.hinge_stress.values()):
        return ""
    svg = inline_svg(draw_stress(study.main), "stress", "largest stress in every hinge")
    return (
        "<p>Equivalent stress at the surface of each notch at full stroke. The number after a "
        f"hinge's name is the one in the drawing.</p>{_plot(svg, narrow=True)}"
    )


def _meshed(study: Study, draw: Callable[[str, ModelRun], str]) -> str:
    """What each model with a mesh has to show, under its name where there are several."""
    runs = {name: run for name, run in study.runs.items() if run.mesh is not None}
    parts = {name: draw(name, run) for name, run in runs.items()}
    parts = {name: part for name, part in parts.items() if part}
    if len(parts) < 2:
        return "".join(parts.values())
    return "".join(f"<h3>Model {escape(name)}</h3>{part}" for name, part in parts.items())


def _mesh_words(name: str, run: ModelRun) -> str:
    """The model of a picture in a few words."""
    mesh = run.mesh
    assert mesh is not None
    held = mesh.system.settings.get("held", "")
    unknowns = f"{mesh.unknowns:,}".replace(",", "\u00a0")
    return (
        f"Model {escape(name)}, elements of order {mesh.mesh_settings.order}, {unknowns} unknowns; "
        f"{escape(held or 'nothing is fixed')}."
    )


def _neck_stress(study: Study) -> str:
    def draw(name: str, run: ModelRun) -> str:
        assert run.mesh is not None
        shown = [a.axis for a in run.analysis.axes if any(a.static.hinge_stress.values())]
        sampler = neck_sampler(run.mesh)
        plots = [
            inline_svg(
                draw_neck_stress(run.mesh, run.analysis, axis, sampler=sampler),
                f"necks-{name}-{i}",
                f"stress at the necks, {axis}, model {name}",
            )
            for i, axis in enumerate(shown)
        ]
        if not plots:
            return ""
        solid = run.mesh.system.model == "solid"
        where = " on the middle plane; the largest may lie at another height" if solid else ""
        return (
            f"<p>Equivalent stress of von Mises{where}. Imposed: the elongation of one drive at "
            "full stroke, the others removed. "
            f"{_mesh_words(name, run)}</p>{_plots(plots)}"
        )

    drawn = _meshed(study, draw)
    if not drawn:
        return ""
    return (
        "<p>The stage as it is deformed, motion exaggerated as told, and its most stressed necks, "
        "one for all of the same profile and stress, each held still in its picture; dashed: at "
        "rest. The ring marks the largest stress on the surface of the notch, and the title its "
        "value, its place at rest, and the number of the hinge in the drawing. Stress elsewhere, "
        "as at held edges, is in none of the figures above; where it exceeds the scale it has the "
        f"colour of the scale's end.</p>{drawn}"
    )


def _fe_modes(study: Study) -> str:
    def draw(name: str, run: ModelRun) -> str:
        assert run.mesh is not None
        if not run.analysis.modes["removed"].frequency_hz.size:
            return ""
        svg = inline_svg(
            draw_fe_modes(run.mesh, run.analysis), f"fem-modes-{name}", f"modes, model {name}"
        )
        return f"<p>Imposed: nothing, drives removed. {_mesh_words(name, run)}</p>{svg}"

    drawn = _meshed(study, draw)
    if not drawn:
        return ""
    return (
        "<p>The lowest modes; amplitudes are not to scale, and bodies may lie over one another for "
        f"it. Thin: at rest.</p>{drawn}"
    )


def _convergence(study: Study) -> str:
    def draw(name: str, run: ModelRun) -> str:
        found = run.refinement
        if found is None or len(found.steps) < 2:
            return ""
        asked = display(found.quantity).label.lower()
        svg = inline_svg(
            draw_convergence(found), f"convergence-{name}", f"convergence of model {name}"
        )
        return (
            f"<p>Asked for: {escape(asked)} to {100.0 * found.accuracy:.3g} %; estimate of the "
            f"last mesh: {100.0 * found.estimate:.2g} %. {_mesh_words(name, run)}</p>{svg}"
        )

    drawn = _meshed(study, draw)
    if not drawn:
        return ""
    return (
        "<p>Finer meshes of rising order, until the change from one to the next says that the "
        "quantity is accurate enough. Stress is read at points on the notches and settles last. "
        "What all meshes share, the geometry, the material and how the stage is held, no "
        f"refinement shows.</p>{drawn}"
    )


def _hysteresis(study: Study) -> str:
    return hysteresis_section(study.stage, study.experiments, study.experiments_left_out)


def _measured(study: Study) -> str:
    if study.measured is None:
        return ""
    from flexstage.report.measurement import set_beside

    others = Characteristics(r for r in study.characteristics if r.origin != "measured")
    return measurement_section(set_beside(study.measured, study.stage, others))


def _virtual(study: Study) -> str:
    return bench_section(study.virtual)


def _centring(study: Study) -> str:
    return centring_section(study.centring)


def _hinges(study: Study) -> str:
    settings = study.main.provenance.settings
    if not study.stage.hinges:
        return ""
    used = settings.get("plane", "")
    plane = used if used in ("stress", "strain") else "auto"
    return (
        "<p>Stiffness about the neck; hinges that are alike in notch and adjoining bodies share "
        "a row.</p>" + hinge_table(study.stage, method=settings.get("method", "wedge"), plane=plane)
    )


def _validity(study: Study) -> str:
    notes = dict.fromkeys(note for a in study.analyses.values() for note in a.validity)
    # what belongs to the stage stands at the head of the page
    notes = [note for note in notes if note not in study.stage.notes]
    return _list(tuple(notes)) if notes else ""


def _provenance(study: Study) -> str:
    entries: list[tuple[str, str]] = []
    for name, analysis in study.analyses.items():
        origin = analysis.provenance
        settings = ", ".join(f"{k}: {v}" for k, v in origin.settings.items())
        entries += [
            ("model", f"{name}, {analysis.system.order} coordinates"),
            ("settings", settings),
            ("flexstage", origin.version),
            ("description, SHA-256", origin.input_hash),
            ("computed", origin.created),
            ("with", f"Python {origin.python}, {origin.machine}"),
        ]
    material = study.stage.material
    entries.append(("material", f"{material.name}: {material.source}"))
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in entries)
    return f"<dl>{rows}</dl>"


#: Sections of the report: title and what writes it, by the id of the section in the page.
SECTIONS: dict[str, tuple[str, Callable[[Study], str]]] = {
    "drawing": ("Drawing", _drawing),
    "characteristics": ("Characteristics by origin", _characteristics),
    "published": ("The published figures", _published),
    "bode": ("Bode diagrams", _bode),
    "modes": ("Mode shapes", _modes),
    "static": ("Static shapes", _static),
    "stroke": ("Motion over the stroke", _stroke),
    "stress": ("Stress in the hinges", _stress),
    "hinges": ("Hinges", _hinges),
    "equations": ("Equations", equations_section),
    "diagram": ("Structural diagram", diagram_section),
    "validity": ("Validity", _validity),
    "provenance": ("Provenance", _provenance),
}

#: Sections of models with a mesh, which stand after that on stress.
MESH_SECTIONS: dict[str, tuple[str, Callable[[Study], str]]] = {
    "fem-stress": ("Finite elements: stress at the necks", _neck_stress),
    "fem-modes": ("Finite elements: modes", _fe_modes),
    "convergence": ("Convergence of the mesh", _convergence),
}

#: Section of stages with piezo drives, which stands after those.
DRIVE_SECTIONS: dict[str, tuple[str, Callable[[Study], str]]] = {
    "hysteresis": ("Hysteresis and its inverse", _hysteresis),
}

#: Sections on what was measured, of the stage and of the virtual one, which stand after that.
BENCH_SECTIONS: dict[str, tuple[str, Callable[[Study], str]]] = {
    "measured": ("Measured", _measured),
    "virtual": ("Virtual measurement", _virtual),
    "centring": ("Centring an encoder scale", _centring),
}


def _in_order() -> dict[str, tuple[str, Callable[[Study], str]]]:
    ordered = {}
    for key, section in SECTIONS.items():
        ordered[key] = section
        if key == "stress":
            ordered |= MESH_SECTIONS | DRIVE_SECTIONS | BENCH_SECTIONS
    return ordered


def _list(notes: tuple[str, ...]) -> str:
    if len(notes) == 1:
        return f"<p>{escape(notes[0])}</p>"
    return f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in notes)}</ul>"


def _plot(svg: str, *, narrow: bool = False) -> str:
    return svg.replace('class="plot"', 'class="plot narrow"', 1) if narrow else svg


def _plots(plots: list[str], *, two: bool = False) -> str:
    return f'<div class="plots{" two" if two else ""}">{"".join(plots)}</div>'
