"""Tables and page of what the workshop makes of a stage."""

import math
from collections.abc import Iterator

from flexstage.base.version import __version__
from flexstage.quantities.quantity import number
from flexstage.quantities.section import Bullets, Picture, Section
from flexstage.quantities.table import Table, table
from flexstage.report.page import page_html
from flexstage.report.tables import value_text
from flexstage.studies.explore.deviations import KINDS, LABELS, scatter_dimensions
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.spread import Spread, Yield, samples_for
from flexstage.studies.explore.tolerance import VALIDITY, ToleranceChoice, ToleranceStudy
from flexstage.studies.explore.tolerance_choice import COARSEST, FINEST
from flexstage.virtual.imperfections import Scatter

_LEAST = 0.01  # share of the variance that is told [1]


def spread_table(study: ToleranceStudy) -> Table:
    """Return how every figure is spread."""
    return table(
        f"{study.stage.name}: {study.samples} stages as they come from the machine.",
        ("figure", "as drawn", "mean", "95 % lie from", "to", "standard deviation", "~in parts"),
        [(spread.figure.heading, *_cells(spread)) for spread in study.spreads],
        notes=tuple(_few(study)),
    )


def _few(study: ToleranceStudy) -> Iterator[str]:
    needed = samples_for(2.5)
    few = [spread.figure.name for spread in study.spreads if spread.count < needed]
    if few:
        names = "" if len(few) == len(study.spreads) else f" of {', '.join(few)}"
        yield f"what 95 %{names} lie between needs at least {needed} samples"


def _cells(spread: Spread) -> tuple[str, ...]:
    most_decimals = 9  # that a figure has at most
    shown = spread.figure.display
    deviation = spread.standard_deviation * shown.factor
    if spread.constant:
        same = shown.text(spread.nominal)
        return (same, same, same, same, "≈ 0", "")
    # what is known of a standard deviation, in parts: 1 / sqrt(2 (n - 1)) of normal values
    known = 1.0 / math.sqrt(2.0 * max(spread.count - 1, 1))
    digits = 1 if known > 0.1 else 2 if known > 0.01 else 3
    # the same decimals in all of a row, of which the deviation has one digit or two
    last = math.floor(math.log10(float(f"{deviation:.1e}"))) - (digits > 1)
    decimals = min(max(-last, 0), most_decimals)
    plain = 1e-3 <= abs(spread.nominal * shown.factor) < 1e6

    def text(value: float) -> str:
        if not math.isfinite(value):
            return "–"
        return f"{value * shown.factor:.{decimals}f}" if plain else number(value * shown.factor)

    texts = [text(value) for value in (spread.nominal, spread.mean, *spread.middle)]
    share = "" if shown.zero else _percent(spread.standard_deviation / abs(spread.nominal), digits)
    if digits == 1:
        return (*texts, f"{float(f'{deviation:.1g}'):g}", share)
    return (*texts, f"{deviation:.{decimals}f}" if plain else number(deviation, 2), share)


def yield_table(yields: tuple[Yield, ...], caption: str = "Yield.") -> Table:
    """Return the share of stages that meet each requirement, and all."""
    return table(
        caption,
        ("required", "good", "share", "95 % interval from", "to"),
        [
            (
                "all of these" if y.requirement is None else y.requirement.text,
                f"{y.met} of {y.count}",
                _percent(y.share, 4),
                _percent(y.low, 4),
                _percent(y.high, 4),
            )
            for y in yields
        ],
    )


def share_table(study: ToleranceStudy) -> Table:
    """Return which deviations spread each figure, the largest first."""
    most_named = 3  # hinges that are named
    rows = []
    deviations = {spread.figure: spread.standard_deviation for spread in study.spreads}
    for of in study.shares:
        for i, part in enumerate(p for p in of.contributions if p.share >= _LEAST):
            most = ", ".join(
                f"{name} {100.0 * share:.0f} %"
                for name, share in part.largest[:most_named]
                if share >= _LEAST
            )
            rows.append(
                (
                    of.figure.label if i == 0 else "",
                    LABELS[part.kind],
                    scatter_text(study.scatter, part.kind),
                    f"{100.0 * part.share:.1f} %",
                    _change(of.figure, part.slope, deviations[of.figure]),
                    most,
                )
            )
        if of.unexplained >= _LEAST:
            rows.append(
                ("", "joint or bent effects", "", f"{100.0 * of.unexplained:.1f} %", "", "")
            )
    return table(
        "What spreads them: shares of the variance.",
        ("figure", "<deviation", "scatter", "share", "one deviation changes", "<most of it by"),
        rows,
    )


def _change(figure: Figure, slope: float, deviation: float) -> str:
    """Write what a deviation changes, with the decimals that a hundredth of the spread has."""
    shown = figure.display
    size = deviation * shown.factor
    if not 1e-5 <= size < 1e6:
        return figure.text(slope)
    decimals = max(0, 2 - math.floor(math.log10(size)))
    return f"{slope * shown.factor:.{decimals}f} {shown.shown_unit}".strip()


def choice_table(choice: ToleranceChoice) -> Table:
    """Return the tolerances that reach a yield beside the usual ones."""
    return table(
        f"Cheapest scatter for a yield of {_percent(choice.target)}.",
        ("deviation", "now", "allowed", "in parts of now"),
        [
            (
                LABELS[kind],
                scatter_text(choice.initial, kind),
                scatter_text(choice.selected, kind),
                f"{choice.factor(kind):.2f}",
            )
            # those at one end of what is looked at differ by rounding: they stay in their order
            for kind in sorted(choice.kinds, key=lambda k: round(choice.factor(k), 2))
        ],
        notes=(
            "standard deviations; 95 % of parts are within twice as much",
            f"{FINEST:g} to {COARSEST:g} times what is now is looked at",
        ),
    )


def scatter_table(scatter: Scatter) -> Table:
    """Return what a process scatters."""
    return table(
        "The process: standard deviations.",
        ("deviation", "<name", "scatter"),
        [(kind.label, kind.name, scatter_text(scatter, kind.name)) for kind in KINDS],
    )


def scatter_text(scatter: Scatter, name: str) -> str:
    """Return a field of a scatter with its unit."""
    value, dimension = getattr(scatter, name), scatter_dimensions()[name]
    return _percent(value) if dimension is None else value_text(value, dimension.name, 3)


def _percent(share: float, digits: int = 3) -> str:
    text = f"{100.0 * share:.{digits}g}"
    return f"{100.0 * share:.0f} %" if "e+" in text else f"{text} %"


def tolerance_page(study: ToleranceStudy) -> str:
    """Return a page of what the workshop makes of a stage, and what to tighten."""
    return page_html(
        heading=f"{study.stage.name}: what the workshop makes of it",
        lead=(
            f"{study.samples} simulated stages, seed {study.monte_carlo.seed}; {study.model}; "
            "intervals are those of 95 %"
        ),
        version=__version__,
        sections=_sections(study),
        # the first says what the description is, such as a reconstruction
        notes=(*study.notes, *study.stage.notes[:1]),
    )


def _sections(study: ToleranceStudy) -> Iterator[Section]:
    choice = study.choice
    if study.yields:
        yield Section(key="yield", title="Yield", content=(yield_table(study.yields),))
    histograms = Picture(
        result=study,
        title="Histograms of the figures",
        caption="Distribution of every figure; grey is what 95 % of the stages lie between.",
    )
    yield Section(key="figures", title="Figures", content=(spread_table(study), histograms))
    if study.shares:
        bars = Picture(
            result=study,
            view="shares",
            title="Shares of the variance",
            caption="What the variance of every figure consists of.",
        )
        yield Section(key="shares", title="What spreads them", content=(bars, share_table(study)))
    if choice is not None:
        verdict = choice.conclusion[0].upper() + choice.conclusion[1:] + "."
        tables = (choice_table(choice), yield_table(choice.after, "Yield with these."))
        yield Section(
            key="tighten",
            title=f"Tolerances for {_percent(choice.target)}",
            content=(verdict, *(tables if choice.available else ())),
        )
    yield Section(
        key="process",
        title="Process and model",
        content=(scatter_table(study.scatter), Bullets(VALIDITY)),
    )
