"""Every report is one HTML file: templates filled, results drawn by type, all of it numbered."""

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
from flexstage.quantities.section import Picture, Section
from flexstage.quantities.table import Table

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from matplotlib.figure import Figure


#: A hyphen that is a minus sign: before a digit, and after nothing that it could belong to.
_HYPHEN_MINUS = re.compile(r"(?<![\w\])−–-])-(?=\.?\d)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fragment(Section):
    """A section that has a template of its own, as a formula needs."""

    template: str
    """Name of the template."""
    given: Mapping[str, Any] = field(default_factory=dict)
    """What it shows, as ``given`` in it."""


def fragment(template: str, **given: Any) -> Fragment:
    """Return a part of a section that has a template of its own."""
    return Fragment(title="", content=(), template=template, given=given)


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
    **given: Any,
) -> str:
    """Return a whole page.

    `links` are id and title of what the navigation names: the sections where not given. A template
    that extends ``page.html`` may be `given` more.
    """
    from flexstage.report.figures.style import css_variables

    sections = tuple(sections)
    return _filled(
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
        **given,
    )


def sections_html(*sections: Section) -> str:
    """Return sections alone, without the frame of a page."""
    return _filled("sections.html", sections=sections)


def table_html(shown: Table) -> str:
    """Return one table alone, as a notebook shows it."""
    return _filled("table.html", table=shown)


def _filled(template: str, **given: Any) -> str:
    # what is counted in a page is counted from 1
    numbers: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
    page = _environment().get_template(template)
    return page.render(next=lambda what: next(numbers[what]), **given)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined, pass_context

    made = Environment(
        loader=PackageLoader("flexstage.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    kind = {"kind": lambda item: type(item).__name__}
    made.filters |= kind | {"svg": pass_context(_svg), "typeset": _typeset}
    return made


def _svg(context: Mapping[str, Any], picture: Picture, key: str) -> "Markup":
    """Draw a picture, or read it where the page has a memory; the key is unique in the page."""
    from markupsafe import Markup

    memory: Memory = context.get("memory") or Memory(None)
    return Markup(memory.recall(picture.title, drawn_inline, picture, key))


def drawn_inline(picture: Picture, key: str) -> str:
    """Draw a picture as it stands in a page, in which the key is unique."""
    from flexstage.report.figures.style import inline_svg

    return inline_svg(drawn(picture), key, picture.title)


def typeset(words: str) -> str:
    """Write hyphens that are minus signs as such."""
    return _HYPHEN_MINUS.sub("−", words)


def _typeset(text: str) -> "Markup":
    """Write hyphens that are minus signs as such, in words and not in tags."""
    from markupsafe import Markup

    return Markup(re.sub(r">[^<]+", lambda words: typeset(words[0]), text))


#: By type and view: the function that draws it, of `flexstage.report.figures`, and what that calls
#: the result, or takes of it: "profile=profile".
DRAWINGS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("HingeResult", ""): ("hinges.draw_notch", "profile=profile"),
    ("HoldNoise", ""): ("noise.draw_hold", "noise"),
    ("Identification", ""): ("identification.draw_identification", "found"),
    ("IdentifiedStep", ""): ("tracking.draw_drive_fit", "step"),
    ("MeasuredResponse", ""): ("responses.draw_response", "response"),
    ("ModalFit", ""): ("modal_fit.draw_modal_fit", "fit"),
    ("ModalFit", "resonance"): ("modal_fit.draw_resonance", "fit"),
    ("ModalFit", "stabilisation"): ("modal_fit.draw_stabilisation", "fit"),
    ("CentredRecords", ""): ("centring.draw_centred", "found"),
    ("CompensationCommand", ""): (
        "tracking.draw_feedforward",
        "made=feedforward model=drive band_percent=band",
    ),
    ("DecayResult", ""): ("modal_fit.draw_ring_down", "fit=fit record=record"),
    ("EvaluatedBudget", ""): (
        "distributions.draw_budget",
        "propagated=propagated drawn=drawn quantity=budget.quantity unit=budget.unit "
        "factor=budget.factor",
    ),
    ("FrfResult", ""): ("modal_fit.draw_frf", "found"),
    ("FrfResult", "stabilisation"): ("modal_fit.draw_stabilisation", "fit=fit"),
    ("Front", ""): ("optimum.draw_front", "found"),
    ("MotionCurve", ""): ("motion_error.draw_motion_error", "curve"),
    ("HingeFigures", ""): ("hinges.draw_notch", "profile=profile"),
    ("Optimum", ""): ("optimum.draw_before_after", "found"),
    ("Optimum", "figures"): ("optimum.draw_figures", "found"),
    ("Optimum", "history"): ("optimum.draw_history", "found"),
    ("PartResult", ""): ("part.draw_part", "part=part held=held moved=moved"),
    ("Positioning", ""): ("motion_error.draw_positioning", "found"),
    ("ReachableArea", ""): ("body_motion.draw_reachable_area", "found"),
    ("Predictions", ""): (
        "identification.draw_prediction",
        "found=first model=file.model band=band",
    ),
    ("Record", ""): ("identification.draw_record", "record"),
    ("Refinement", ""): ("fields.draw_convergence", "refinement"),
    ("Sensitivities", ""): ("sensitivity.draw_sensitivities", "found"),
    ("Stage", ""): ("drawing.draw_stage", "stage"),
    ("Staircase", ""): ("noise.draw_staircase", "found"),
    ("Sweep", ""): ("sweep.draw_sweep", "sweep"),
    ("Sweep", "indices"): ("sweep.draw_indices", "sweep"),
    ("ToleranceStudy", ""): ("distributions.draw_spreads", "study"),
    ("ToleranceStudy", "shares"): ("distributions.draw_shares", "study"),
    ("VerifiedStep", ""): ("tracking.draw_following", "step"),
    ("Workspace", ""): ("motion_error.draw_workspace", "found"),
}


def drawn(picture: Picture) -> "Figure":
    """Draw the result of a picture; a function that draws one is called."""
    if isinstance(picture.result, partial):
        return picture.result(**picture.options)
    return plotted(picture.result, picture.view, **picture.options)


def plotted(result: Any, view: str = "", **options: Any) -> "Figure":
    """Draw a result, in one of its views."""
    kind = type(result).__name__
    if (kind, view) not in DRAWINGS:
        shown = f" as '{view}'" if view else ""
        known = ", ".join(sorted({name for name, _ in DRAWINGS}))
        raise ModelError(f"no drawing shows a {kind}{shown}: there are drawings of {known}")
    function, parameters = DRAWINGS[kind, view]
    module, _, name = function.partition(".")
    draw = getattr(import_module(f"flexstage.report.figures.{module}"), name)
    named = (parameter.partition("=") for parameter in parameters.split())
    taken = {name: attrgetter(path)(result) if path else result for name, _, path in named}
    return draw(**taken, **options)
