"""The report of a study as a self-contained HTML file."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from flexstage.files.cache.memory import Memory
from flexstage.quantities.quantity import QUANTITIES
from flexstage.quantities.table import Bullets, Content, Definitions, Picture, Pictures, Section
from flexstage.report import findings
from flexstage.report.figures.body_motion import (
    body_outlines,
    draw_static_shape,
    draw_stroke,
    mode_cards,
    stroke_curves,
)
from flexstage.report.figures.drawing import draw_stage
from flexstage.report.figures.drawn_stage import draw_bench
from flexstage.report.figures.hinges import draw_stress
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.style import FIXED, css_name
from flexstage.report.measurement import measurement_section, measurement_text
from flexstage.report.page import fragment, page_html
from flexstage.report.stacks import stack_section
from flexstage.report.study_sections import (
    bench_section,
    centring_section,
    convergence_section,
    diagram_section,
    equations_section,
    fe_modes_section,
    hysteresis_section,
    neck_stress_section,
    quiet_section,
)
from flexstage.report.tables import (
    characteristics_table,
    coupling_section,
    differences_table,
    full_stroke_words,
    hinge_table,
    published_table,
)
from flexstage.report.traditional import assumption_section, drift_section, motion_error_section
from flexstage.stage.designs.vgtu import predicted_ranges
from flexstage.studies.measurement import MeasurementComparison
from flexstage.studies.results import results_json
from flexstage.studies.study import Study

_FREQUENCIES = ("natural_frequency_hz", "natural_frequency_with_stack_hz")
_DYNAMICS = (*_FREQUENCIES, "out_of_plane_frequency_hz", "damping_ratio")
_STRESS = ("max_stress", "safety_factor", "fatigue_safety")
_STATICS = tuple(name for name in QUANTITIES if name not in (*_DYNAMICS, *_STRESS))
_VIRTUAL_FILE = "virtual-measurement.html"
#: The content of a section; None is omitted.
_Show = Callable[[Study], Iterable[Content | None]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """A chapter of the report."""

    title: str
    """Its title."""
    finding: Callable[[Study], str]
    """Its result in one line, from the rows of the study."""
    sections: Mapping[str, tuple[str, _Show]]
    """Title and content of each section, by its id; a single section may have no title."""


def report_html(study: Study, memory: Memory | None = None) -> str:
    """Return the report of a study as one page: a summary, then folded chapters.

    Empty chapters are omitted. Pictures are read from the memory, if it has them.
    """
    stage = study.stage
    chapters: list[dict[str, Any]] = []
    for key, chapter in CHAPTERS.items():
        if sections := tuple(s for k in chapter.sections if (s := study_section(study, k)).content):
            title = f"{len(chapters) + 1}\u00a0{chapter.title}"
            finding = chapter.finding(study)
            chapters.append({"key": key, "title": title, "finding": finding, "sections": sections})
    free = sum(not body.fixed for body in stage.bodies)
    drives = f"{len(stage.drives)}\u00a0drive{'s'[len(stage.drives) == 1 :]}"
    return page_html(
        template="study.html",
        title=f"{stage.name}: flexstage study",
        heading=f"{stage.name}: {stage.title}" if stage.title else stage.name,
        lead=f"{findings.size_and_mass(study)}; {stage.materials}; {len(stage.bodies)} bodies "
        f"({free} free), {len(stage.hinges)} hinges, {drives}",
        version=study.main.provenance.version,
        links=(("summary", "Summary"), *((c["key"], c["title"]) for c in chapters)),
        notes=stage.notes[:1],
        front=findings.front_page(study),
        outlines=body_outlines(stage),
        chapters=chapters,
        memory=memory,
    )


def report_pages(study: Study, memory: Memory | None = None) -> dict[str, str]:
    """Return the report of a study, and that of its simulated measurement, by name of the file.

    They belong in one folder. Pictures are read from the memory, if it has them.
    """
    pages = {"report.html": report_html(study, memory)}
    if isinstance(study.virtual, MeasurementComparison):
        pages[_VIRTUAL_FILE] = measurement_text(study.virtual, memory)
    return pages


def study_files(study: Study, memory: Memory | None = None) -> dict[str, bytes]:
    """Return the pages of a study, and its results as JSON, by name of the file."""
    pages = {name: page.encode() for name, page in report_pages(study, memory).items()}
    return pages | {"results.json": results_json(study.to_dict())}


def study_section(study: Study, key: str) -> Section:
    """Return one section of the report of a study, which may be empty."""
    title, show = SECTIONS[key]
    content = tuple(part for part in show(study) if part is not None)
    return Section(key=key, title=title, content=content)


def _drawing(study: Study) -> Iterator[Content]:
    yield Picture(
        result=partial(draw_stage, study.stage),
        title=f"drawing of {study.stage.name}",
        caption=f"The stage to scale: {findings.size_and_mass(study)}.",
        size="small",
    )


def _by_model(quantities: Collection[str], caption: str) -> _Show:
    """Return the content of a section with quantities by all models."""

    def show(study: Study) -> Iterator[Content | None]:
        ranges = predicted_ranges(study.stage)
        yield characteristics_table(study.comparison, quantities, caption, ranges)

    return show


def _against(study: Study) -> Iterator[Content | None]:
    for model, why in study.skipped_models.items():
        yield f"The {model} model was skipped: {why}."
    yield differences_table(study.comparison, predicted_ranges(study.stage))


def _bench(study: Study) -> Iterator[Content]:
    if study.stage.probes:
        yield Picture(
            result=partial(draw_bench, study.stage),
            title="sketch of the bench",
            caption="Sketch of the test bench: drives (orange) and displacement sensors (green) in "
            "line with the probes of the stage.",
            size="tiny",
        )


def _bode(study: Study) -> Iterator[Content]:
    plots = [
        Picture(
            result=partial(draw_bode, study.main, a.axis),
            title=f"Bode diagram of {a.axis}",
            caption=f"Bode diagrams of {a.axis}, {study.main.system.model} model. Left: force in "
            "place of the drive, without its stiffness. Right: free displacement of the drive, "
            "through its stiffness; for a rigid drive its length.",
            size="small",
        )
        for a in study.main.axes
    ]
    if plots:
        yield Pictures(pictures=tuple(plots))


def _modes(study: Study) -> Iterator[Content]:
    yield fragment(
        "modes.html",
        model=study.main.system.model,
        cards=mode_cards(study.main),
        fixed=css_name(FIXED),
    )


def _capitalised(words: str) -> str:
    return words[:1].upper() + words[1:]


def _static(study: Study) -> Iterator[Content]:
    plots = [
        Picture(
            result=partial(draw_static_shape, study.main, a.axis),
            title=f"static shape of {a.axis}",
            caption=f"{_capitalised(full_stroke_words(a))}; "
            f"{study.main.system.model} model; dashed: at rest.",
        )
        for a in study.main.axes
    ]
    if plots:
        yield Pictures(pictures=tuple(plots), columns=2)


def _stroke(study: Study) -> Iterator[Content]:
    plots = [
        Picture(
            result=partial(draw_stroke, path, axis),
            title=f"motion of {axis} over its stroke",
            caption=f"Motion of {axis} beyond first order, by finite rotations; lumped model.",
        )
        for axis, path in study.paths.items()
    ]
    if plots:
        # axes that move straight have one curve, and are placed side by side
        narrow = all(len(stroke_curves(path)) == 1 for path in study.paths.values())
        yield Pictures(pictures=tuple(plots), columns=2 if narrow else 1)


def _stress(study: Study) -> Iterator[Content]:
    if any(study.main.hinge_stress.values()):
        yield Picture(
            result=partial(draw_stress, study.main),
            title="largest stress in every hinge",
            caption="Equivalent stress at the surface of each notch at full stroke, "
            f"{study.main.system.model} model. The number after a hinge's name is the one in the "
            "drawing. Lines: yield strength, and the allowable peak of a pulsating stress "
            "(Soderberg).",
            size="small",
        )


def _measured(study: Study) -> Iterator[Content]:
    if (measured := study.measurement_comparison) is not None:
        yield measurement_section(measured)


def _hinges(study: Study) -> Iterator[Content]:
    if study.stage.hinges:
        yield hinge_table(study.stage, study.springs)


def _validity(study: Study) -> Iterator[Content]:
    """Yield the limits of validity of the stage and its models."""
    notes = dict.fromkeys(note for a in study.analyses.values() for note in a.validity)
    notes = tuple(dict.fromkeys((*study.stage.notes, *notes)))
    if notes:
        yield fragment("columns.html", part=notes[0] if len(notes) == 1 else Bullets(notes))


def _provenance(study: Study) -> Iterator[Content]:
    """Yield the provenance of the results: settings of each model, versions, hash of the stage."""
    entries: dict[str, str] = {}
    for name, analysis in study.analyses.items():
        settings = ", ".join(f"{k}: {v}" for k, v in analysis.provenance.settings.items())
        entries[f"{name}, {analysis.system.order} coordinates"] = settings
    for title, of in (
        ("flexstage", lambda origin: origin.version),
        ("description, SHA-256", lambda origin: origin.input_hash),
        ("computed", lambda origin: origin.created),
        ("software", lambda origin: f"Python {origin.python}, {origin.machine}"),
    ):
        values = dict.fromkeys(of(analysis.provenance) for analysis in study.analyses.values())
        entries[title] = "; ".join(values)
    if study.read:
        entries["read from the cache"] = ", ".join(study.read)
    stage = study.stage
    every = (stage.material, *map(stage.material_of, stage.bodies))
    sources = dict.fromkeys(f"{m.name}: {m.source}" for m in every)
    yield Definitions(entries | {"material": "; ".join(sources)})


#: The chapters in order, by id.
CHAPTERS: dict[str, Chapter] = {
    "theory": Chapter(
        title="Theory",
        finding=findings.theory,
        sections={
            "equations": ("Equations of motion", equations_section),
            "diagram": ("Structural diagrams", diagram_section),
        },
    ),
    "models": Chapter(
        title="Models",
        finding=findings.models,
        sections={
            "drawing": ("Drawing", _drawing),
            "differences": ("Differences from published values", _against),
            "hinges": ("Hinges", _hinges),
            "convergence": ("Mesh convergence", convergence_section),
        },
    ),
    "statics": Chapter(
        title="Statics",
        finding=findings.statics,
        sections={
            "characteristics": (
                "Displacement, stiffness, coupling",
                _by_model(
                    _STATICS,
                    "Statics at full stroke by model; hover over a value for its condition. Drives "
                    "are in place unless the condition says otherwise.",
                ),
            ),
            "coupling": (
                "Coupling of the drives",
                lambda study: coupling_section(study.main.coupling),
            ),
            "static": ("Static shapes", _static),
            "stroke": ("Motion over the stroke", _stroke),
            "stacks": ("Stacks at work", stack_section),
        },
    ),
    "dynamics": Chapter(
        title="Dynamics",
        finding=findings.dynamics,
        sections={
            "frequencies": (
                "Natural frequencies",
                _by_model(
                    _DYNAMICS,
                    "Natural frequencies by model, drives removed unless stated otherwise.",
                ),
            ),
            "bode": ("Bode diagrams", _bode),
            "quiet": ("How quiet", quiet_section),
            "modes": ("Mode shapes", _modes),
            "fem-modes": ("Finite-element modes", fe_modes_section),
        },
    ),
    "strength": Chapter(
        title="Stress",
        finding=findings.stress,
        sections={
            "safety": (
                "Largest stress and safety factors",
                _by_model(
                    _STRESS,
                    "Largest stress by model, and safety factors against yield and against fatigue "
                    "by a pulsating stroke (Soderberg, stress from 0 to peak).",
                ),
            ),
            "stress": ("Stress in the hinges", _stress),
            "fem-stress": ("Stress at the necks", neck_stress_section),
        },
    ),
    "measurements": Chapter(
        title="Measurements",
        finding=findings.measured,
        sections={
            "published": ("Published values", lambda study: (published_table(study.comparison),)),
            "measured": ("Test campaign", _measured),
            "bench": ("Test bench", _bench),
            "virtual": (
                "Simulated measurement",
                lambda study: bench_section(study.virtual, _VIRTUAL_FILE),
            ),
        },
    ),
    "traditional": Chapter(
        title="Traditional stages",
        finding=findings.traditional,
        sections={
            "motion-errors": ("Motion errors", motion_error_section),
            "drift": ("Drift with temperature", drift_section),
            "traditional-assumptions": ("Assumptions", assumption_section),
        },
    ),
    "compensation": Chapter(
        title="Hysteresis",
        finding=findings.hysteresis,
        sections={"hysteresis": ("", hysteresis_section)},
    ),
    "scale": Chapter(
        title="Centring",
        finding=findings.centring,
        sections={"centring": ("", lambda study: centring_section(study.centring))},
    ),
    "record": Chapter(
        title="Provenance",
        finding=findings.record,
        sections={
            "validity": ("Validity", _validity),
            "provenance": ("Provenance", _provenance),
        },
    ),
}

#: Title and content of every section, by the id that it has in the page.
SECTIONS: dict[str, tuple[str, _Show]] = {
    key: section for chapter in CHAPTERS.values() for key, section in chapter.sections.items()
}
