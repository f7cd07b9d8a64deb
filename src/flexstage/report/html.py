"""A study as one HTML file that needs nothing else: no network, no other file."""

from collections.abc import Callable
from html import escape
from importlib.resources import files
from string import Template

from flexstage.report.figures import (
    body_symbols,
    draw_bode,
    draw_stage,
    draw_static_shape,
    draw_stress,
    draw_stroke,
    inline_svg,
    mode_cards,
)
from flexstage.report.figures.style import css_variables
from flexstage.report.study import Study
from flexstage.report.tables import characteristics_table, hinge_table, published_table

__all__ = ["SECTIONS", "report_html"]


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
    for key, (title, write) in SECTIONS.items():
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


def _equations(study: Study) -> str:
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
    "equations": ("Equations", _equations),
    "validity": ("Validity", _validity),
    "provenance": ("Provenance", _provenance),
}


def _list(notes: tuple[str, ...]) -> str:
    if len(notes) == 1:
        return f"<p>{escape(notes[0])}</p>"
    return f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in notes)}</ul>"


def _plot(svg: str, *, narrow: bool = False) -> str:
    return svg.replace('class="plot"', 'class="plot narrow"', 1) if narrow else svg


def _plots(plots: list[str], *, two: bool = False) -> str:
    return f'<div class="plots{" two" if two else ""}">{"".join(plots)}</div>'
