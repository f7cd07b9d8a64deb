"""A study as HTML that needs nothing else: no network, no other file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape

from flexstage.characteristic import Characteristics
from flexstage.quantities import QUANTITIES
from flexstage.report.figures.bench import draw_bench
from flexstage.report.figures.body_motion import (
    body_symbols,
    draw_static_shape,
    draw_stroke,
    mode_cards,
)
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.hinges import draw_stress
from flexstage.report.figures.responses import draw_bode
from flexstage.report.findings import FINDINGS
from flexstage.report.front_page import front_page, outer_size
from flexstage.report.hysteresis import hysteresis_section
from flexstage.report.measurement_html import measurement_section, measurement_text
from flexstage.report.model_sections import (
    convergence_section,
    diagram_section,
    equations_section,
    fe_modes_section,
    neck_stress_section,
)
from flexstage.report.page import bullets, definitions, drawn, folded, page_html, row_of
from flexstage.report.tables import (
    characteristics_table,
    differences_table,
    hinge_table,
    published_table,
)
from flexstage.report.virtual_stage import bench_section, centring_section
from flexstage.studies.measurement import MeasurementComparison, compare_with_references
from flexstage.studies.study import Study

_DYNAMICS = ("natural_frequency_hz", "out_of_plane_frequency_hz", "damping_ratio")
_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
_STATICS = tuple(name for name in QUANTITIES if name not in (*_DYNAMICS, *_STRESS))
_VIRTUAL_FILE = "virtual-measurement.html"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """A chapter of the report."""

    title: str
    """Its title."""
    sections: Mapping[str, tuple[str, Callable[[Study], str]]]
    """Title and writer of each section, by its id; a chapter of one section without a title is that
    section.
    """


def report_html(study: Study) -> str:
    """Write the report of a study as one page: what was found, then chapters that are folded.

    Chapters that have nothing to show are left out.
    """
    stage = study.stage
    parts, links = [front_page(study)], [("summary", "Result")]
    for key, chapter in CHAPTERS.items():
        number = len(links)
        content = _content(study, chapter, number)
        if content:
            title = f"{number} {chapter.title}"
            parts.append(folded(key, title, FINDINGS[key](study), content))
            links.append((key, title))
    free = sum(not body.fixed for body in stage.bodies)
    lead = (
        f"{outer_size(study)}; {stage.material.name}; {len(stage.bodies)} bodies ({free} free), "
        f"{len(stage.hinges)} hinges, {len(stage.drives)} drives"
    )
    first = f'<div class="note"><p>{escape(stage.notes[0])}</p></div>' if stage.notes else ""
    return page_html(
        title=f"{stage.name}: flexstage study",
        heading=f"{stage.name}: {stage.title}" if stage.title else stage.name,
        lead=lead,
        version=study.main.provenance.version,
        links=links,
        body="".join(parts),
        notes=first,
        symbols=body_symbols(stage),
    )


def report_pages(study: Study) -> dict[str, str]:
    """Write the report of a study, and that of its simulated measurement, by name of the file.

    They stand in one folder.
    """
    pages = {"report.html": report_html(study)}
    if isinstance(study.virtual, MeasurementComparison):
        pages[_VIRTUAL_FILE] = measurement_text(study.virtual)
    return pages


def _content(study: Study, chapter: Chapter, number: int) -> str:
    written = [(key, title, write(study)) for key, (title, write) in chapter.sections.items()]
    shown = [part for part in written if part[2]]
    out = []
    for i, (key, title, content) in enumerate(shown, start=1):
        heading = f"<h3>{number}.{i} {title}</h3>" if title else ""
        out.append(f'<section id="{key}">{heading}{content}</section>')
    return "".join(out)


def _drawing(study: Study) -> str:
    words = f"The stage to scale: {escape(outer_size(study))}."
    title = f"drawing of {study.stage.name}"
    return drawn(draw_stage(study.stage), "stage", title, words, kind="small")


def _statics_table(study: Study) -> str:
    caption = (
        "Statics at full stroke by model; hold the pointer on a value for its condition. Drives "
        "are in place unless the condition says otherwise."
    )
    return characteristics_table(study.comparison, _STATICS, caption)


def _dynamics_table(study: Study) -> str:
    caption = "Natural frequencies by model, drives removed."
    return characteristics_table(study.comparison, _DYNAMICS, caption)


def _stress_table(study: Study) -> str:
    caption = (
        "Largest stress by model, and safety: against yield, and against fatigue when the stroke "
        "is gone through again and again (Soderberg, stress from nothing to peak)."
    )
    return characteristics_table(study.comparison, _STRESS, caption)


def _against(study: Study) -> str:
    left_out = "".join(
        f"<p>The {escape(model)} model was left out: {escape(why)}.</p>"
        for model, why in study.left_out.items()
    )
    return left_out + differences_table(study.comparison)


def _bench(study: Study) -> str:
    if not study.stage.probes:
        return ""
    words = (
        "Sketch of the bench: drives (orange) and displacement sensors (green) on the lines of the "
        "probes of the stage."
    )
    return drawn(draw_bench(study.stage), "bench", "sketch of the bench", words, kind="tiny")


def _bode(study: Study) -> str:
    model = study.main.system.model
    plots = [
        drawn(
            draw_bode(study.main, a.axis),
            f"bode{i}",
            f"Bode diagram of {a.axis}",
            f"Bode diagrams of {escape(a.axis)}, {model} model. Left: a force in place of the "
            "drive, whose stiffness is removed. Right: the free displacement of the drive, acting "
            "through its stiffness; of a rigid drive its length itself.",
            kind="small",
        )
        for i, a in enumerate(study.main.axes)
    ]
    return row_of(plots)


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
        f"<p>The lowest modes in the plane, {study.main.system.model} model. A body of stronger "
        f"colour moves further; amplitudes are not to scale.</p>{controls}{groups}"
    )


def _static(study: Study) -> str:
    plots = [
        drawn(
            draw_static_shape(study.main, a.axis),
            f"static{i}",
            f"static shape of {a.axis}",
            f"Drive of {escape(a.axis)} at full stroke, the others removed; "
            f"{study.main.system.model} model; dashed: at rest.",
        )
        for i, a in enumerate(study.main.axes)
    ]
    return row_of(plots, columns=2)


def _stroke(study: Study) -> str:
    figures = {axis: draw_stroke(path, axis) for axis, path in study.paths.items()}
    plots = [
        drawn(
            plot,
            f"stroke{i}",
            f"motion of {axis} over its stroke",
            f"What finite rotations add to the first-order motion of {escape(axis)}; lumped model.",
        )
        for i, (axis, plot) in enumerate(figures.items())
    ]
    # axes that go straight have one curve, and stand side by side
    narrow = all(len(plot.axes) == 1 for plot in figures.values())
    return row_of(plots, columns=2 if narrow else 1)


def _stress(study: Study) -> str:
    if not any(study.main.hinge_stress.values()):
        return ""
    words = (
        f"Equivalent stress at the surface of each notch at full stroke, {study.main.system.model} "
        "model. The number after a hinge's name is the one in the drawing. Lines: yield, and the "
        "peak that fatigue allows when the stress goes from nothing to it and back (Soderberg)."
    )
    title = "largest stress in every hinge"
    return drawn(draw_stress(study.main), "stress-bars", title, words, kind="small")


def _measured(study: Study) -> str:
    if study.measured is None:
        return ""
    others = Characteristics(r for r in study.characteristics if r.origin != "measured")
    return measurement_section(compare_with_references(study.measured, study.stage, others))


def _hinges(study: Study) -> str:
    settings = study.main.provenance.settings
    if not study.stage.hinges:
        return ""
    used = settings.get("plane", "")
    plane = used if used in ("stress", "strain") else "auto"
    return hinge_table(study.stage, method=settings.get("method", "wedge"), plane=plane)


def _validity(study: Study) -> str:
    """Return where the stage and its models stop being valid; empty where nothing is said of it."""
    notes = dict.fromkeys(note for a in study.analyses.values() for note in a.validity)
    notes = tuple(dict.fromkeys((*study.stage.notes, *notes)))
    shown = f"<p>{escape(notes[0])}</p>" if len(notes) == 1 else bullets(notes)
    return f'<div class="columns">{shown}</div>' if notes else ""


def _provenance(study: Study) -> str:
    """Return what the results rest on: settings of each model, versions, hash of the stage."""
    entries: list[tuple[str, str]] = []
    for name, analysis in study.analyses.items():
        settings = ", ".join(f"{k}: {v}" for k, v in analysis.provenance.settings.items())
        entries.append((f"{name}, {analysis.system.order} coordinates", settings))
    for title, of in (
        ("flexstage", lambda origin: origin.version),
        ("description, SHA-256", lambda origin: origin.input_hash),
        ("computed", lambda origin: origin.created),
        ("with", lambda origin: f"Python {origin.python}, {origin.machine}"),
    ):
        values = dict.fromkeys(of(analysis.provenance) for analysis in study.analyses.values())
        entries.append((title, "; ".join(values)))
    material = study.stage.material
    entries.append(("material", f"{material.name}: {material.source}"))
    return definitions(entries)


#: The chapters in order, by id.
CHAPTERS: dict[str, Chapter] = {
    "theory": Chapter(
        title="Theory",
        sections={
            "equations": ("Equations of motion", equations_section),
            "diagram": ("Structural diagrams", diagram_section),
        },
    ),
    "models": Chapter(
        title="Models",
        sections={
            "drawing": ("Drawing", _drawing),
            "differences": ("Differences to published figures", _against),
            "hinges": ("Hinges", _hinges),
            "convergence": ("Convergence of the mesh", convergence_section),
        },
    ),
    "statics": Chapter(
        title="Statics",
        sections={
            "characteristics": ("Displacement, stiffness, coupling", _statics_table),
            "static": ("Static shapes", _static),
            "stroke": ("Motion over the stroke", _stroke),
        },
    ),
    "dynamics": Chapter(
        title="Dynamics",
        sections={
            "frequencies": ("Natural frequencies", _dynamics_table),
            "bode": ("Bode diagrams", _bode),
            "modes": ("Mode shapes", _modes),
            "fem-modes": ("Modes of the finite elements", fe_modes_section),
        },
    ),
    "strength": Chapter(
        title="Stress",
        sections={
            "safety": ("Largest stress and safety", _stress_table),
            "stress": ("Stress in the hinges", _stress),
            "fem-stress": ("Stress at the necks", neck_stress_section),
        },
    ),
    "measurements": Chapter(
        title="Measured",
        sections={
            "published": ("Published figures", lambda study: published_table(study.comparison)),
            "measured": ("Campaign of tests", _measured),
            "bench": ("The bench", _bench),
            "virtual": (
                "Simulated measurement",
                lambda study: bench_section(study.virtual, _VIRTUAL_FILE),
            ),
        },
    ),
    "compensation": Chapter(title="Hysteresis", sections={"hysteresis": ("", hysteresis_section)}),
    "scale": Chapter(
        title="Centring",
        sections={"centring": ("", lambda study: centring_section(study.centring))},
    ),
    "record": Chapter(
        title="Record",
        sections={
            "validity": ("Validity", _validity),
            "provenance": ("Provenance", _provenance),
        },
    ),
}

#: Title and writer of every section, by the id that it has in the page.
SECTIONS: dict[str, tuple[str, Callable[[Study], str]]] = {
    key: section for chapter in CHAPTERS.values() for key, section in chapter.sections.items()
}
