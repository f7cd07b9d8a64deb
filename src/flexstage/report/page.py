"""Reports as single HTML files: templates, drawings of results by type, numbered captions."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from itertools import count
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from flexstage.base.errors import ModelError
from flexstage.files.cache.memory import Memory
from flexstage.quantities.table import Picture, Section, Table

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from matplotlib.figure import Figure


#: A hyphen that is a minus sign: before a digit, and not after a letter, digit or bracket.
_HYPHEN_MINUS = re.compile(r"(?<![\w\])−–-])-(?=\.?\d)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fragment(Section):
    """A section with a template of its own, as formulas need."""

    template: str
    """Name of the template."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values of the template, as ``values`` in it."""


def fragment(template: str, **values: Any) -> Fragment:
    """Return a part of a section with a template of its own."""
    return Fragment(title="", content=(), template=template, values=values)


def page_html(
    *,
    heading: str,
    lead: str,
    version: str,
    links: Iterable[tuple[str, str]] = (),
    sections: Iterable[Section] = (),
    notes: Iterable[str] = (),
    title: str = "",
    template: str = "page.html",
    **values: Any,
) -> str:
    """Return a complete page.

    `links` are id and title of the entries of the navigation, by default the sections. `values` are
    those of a template that extends ``page.html``.
    """
    from flexstage.report.figures.style import css_variables

    sections = tuple(sections)
    return _render(
        template,
        heading=heading,
        lead=lead,
        version=version,
        links=tuple(links) or tuple((s.key, s.title) for s in sections),
        sections=sections,
        notes=tuple(notes),
        title=title or heading,
        light=css_variables(),
        dark=css_variables(dark=True),
        **values,
    )


def sections_html(*sections: Section) -> str:
    """Return sections alone, without the frame of a page."""
    return _render("sections.html", sections=sections)


def table_html(table: Table) -> str:
    """Return one table alone, for a notebook."""
    return _render("table.html", table=table)


def _render(template: str, **values: Any) -> str:
    # numbers of figures, tables and pictures begin at 1 in each page
    numbers: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
    page = _environment().get_template(template)
    return page.render(next=lambda kind: next(numbers[kind]), **values)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined, pass_context

    environment = Environment(
        loader=PackageLoader("flexstage.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    kind = {"kind": lambda item: type(item).__name__}
    environment.filters |= kind | {"svg": pass_context(_svg), "typeset": _typeset}
    return environment


def _svg(context: Mapping[str, Any], picture: Picture, key: str) -> "Markup":
    """Draw a picture, or read it from the memory of the page; the key is unique in the page."""
    from markupsafe import Markup

    memory: Memory = context.get("memory") or Memory(None)
    return Markup(memory.recall(picture.title, inline_picture, picture, key))


def inline_picture(picture: Picture, key: str) -> str:
    """Draw a picture as inline SVG of a page, in which the key is unique."""
    from flexstage.report.figures.style import inline_svg

    return inline_svg(draw_picture(picture), key, picture.title)


def typeset(words: str) -> str:
    """Replace hyphens that are minus signs."""
    return _HYPHEN_MINUS.sub("−", words)


def _typeset(text: str) -> "Markup":
    """Replace hyphens that are minus signs in texts, not in tags."""
    from markupsafe import Markup

    return Markup(re.sub(r">[^<]+", lambda words: typeset(words[0]), text))


#: By type and view: the drawing function in `flexstage.report.figures`, and its parameter for the
#: result, or those for attributes of it: "profile=profile".
DRAWINGS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("HeadArrangement", ""): ("centring.draw_gains", "arrangement"),
    ("HingeResult", ""): ("hinges.draw_notch", "profile=profile"),
    ("HoldNoise", ""): ("noise.draw_hold", "noise"),
    ("Identification", ""): ("identification.draw_identification", "result"),
    ("IdentifiedStep", ""): ("tracking.draw_drive_fit", "step"),
    ("MeasuredResponse", ""): ("responses.draw_response", "response"),
    ("ModalFit", ""): ("modal_fit.draw_modal_fit", "fit"),
    ("ModalFit", "resonance"): ("modal_fit.draw_resonance", "fit"),
    ("ModalFit", "stabilisation"): ("modal_fit.draw_stabilisation", "fit"),
    ("CoupledPredictions", ""): ("drives.draw_coupled_prediction", "result"),
    ("CoupledCommand", ""): ("drives.draw_coupled_command", "result"),
    ("OscillatorIdentification", ""): ("drives.draw_coupled_prediction", "result=fitted"),
    ("CoupledDriveIdentification", ""): ("drives.draw_coupled_drives", "result"),
    ("Calibration", ""): ("centring.draw_calibration", "calibration"),
    ("CentredRecords", ""): ("centring.draw_centred", "centred"),
    ("CompensationCommand", ""): (
        "tracking.draw_feedforward",
        "feedforward=feedforward model=drive band_percent=band",
    ),
    ("DynamicBudget", ""): ("noise.draw_cumulative", "result"),
    ("DecayResult", ""): ("modal_fit.draw_ring_down", "fit=fit record=record"),
    ("Ensemble", ""): ("distributions.draw_ranges", "ensemble"),
    ("EvaluatedBudget", ""): (
        "distributions.draw_budget",
        "propagated=propagated monte_carlo=simulated quantity=budget.quantity unit=budget.unit "
        "factor=budget.factor",
    ),
    ("FrfResult", ""): ("modal_fit.draw_frf", "result"),
    ("FrfResult", "stabilisation"): ("modal_fit.draw_stabilisation", "fit=fit"),
    ("Front", ""): ("optimum.draw_front", "front"),
    ("MotionCurve", ""): ("motion_error.draw_motion_error", "curve"),
    ("HingeFigures", ""): ("hinges.draw_notch", "profile=profile"),
    ("Optimum", ""): ("optimum.draw_before_after", "optimum"),
    ("Optimum", "figures"): ("optimum.draw_figures", "optimum"),
    ("Optimum", "history"): ("optimum.draw_history", "optimum"),
    ("PartResult", ""): ("part.draw_part", "part=part fixed=fixed moved=moved"),
    ("Positioning", ""): ("motion_error.draw_positioning", "positioning"),
    ("ReachableArea", ""): ("body_motion.draw_reachable_area", "workspace"),
    ("Predictions", ""): (
        "identification.draw_prediction",
        "prediction=first model=file.model band=band",
    ),
    ("Record", ""): ("identification.draw_record", "record"),
    ("Refinement", ""): ("fields.draw_convergence", "refinement"),
    ("AxesDesign", ""): ("noise.draw_axes", "design"),
    ("ResponseDesign", ""): ("noise.draw_loops", "design"),
    ("ScaleStudy", ""): ("centring.draw_error_budget", "study"),
    ("Sensitivities", ""): ("sensitivity.draw_sensitivities", "sensitivities"),
    ("Stage", ""): ("drawing.draw_stage", "stage"),
    ("Staircase", ""): ("noise.draw_staircase", "staircase"),
    ("Sweep", ""): ("sweep.draw_sweep", "sweep"),
    ("Sweep", "indices"): ("sweep.draw_indices", "sweep"),
    ("ThermalTransient", ""): ("responses.draw_thermal_transient", "result"),
    ("ToleranceStudy", ""): ("distributions.draw_spreads", "study"),
    ("ToleranceStudy", "shares"): ("distributions.draw_shares", "study"),
    ("VerifiedStep", ""): ("tracking.draw_following", "step"),
    ("Workspace", ""): ("motion_error.draw_workspace", "workspace"),
    ("SettlingStudy", ""): ("tracking.draw_settling", "study"),
}


def draw_picture(picture: Picture) -> "Figure":
    """Draw the result of a picture, or call its drawing function."""
    if isinstance(picture.result, partial):
        return picture.result(**picture.options)
    return plotted(picture.result, picture.view, **picture.options)


def plotted(result: Any, view: str = "", **options: Any) -> "Figure":
    """Draw a result, in one of its views."""
    kind = type(result).__name__
    if (kind, view) not in DRAWINGS:
        view_text = f" as '{view}'" if view else ""
        kinds = ", ".join(sorted({name for name, _ in DRAWINGS}))
        raise ModelError(f"a {kind} cannot be drawn{view_text}: there are drawings of {kinds}")
    function, parameters = DRAWINGS[kind, view]
    module, _, name = function.partition(".")
    draw = getattr(import_module(f"flexstage.report.figures.{module}"), name)
    pairs = (parameter.partition("=") for parameter in parameters.split())
    arguments = {name: attrgetter(path)(result) if path else result for name, _, path in pairs}
    return draw(**arguments, **options)
