"""Tables and page of a tolerance analysis."""

import math
from collections.abc import Iterator

from flexstage.base.version import __version__
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Bullets, Picture, Section, Table, table
from flexstage.report.page import page_html
from flexstage.report.tables import value_text
from flexstage.studies.explore.deviations import KINDS, LABELS, scatter_dimensions
from flexstage.studies.explore.figures import Figure
from flexstage.studies.explore.spread import Spread, Yield, samples_for
from flexstage.studies.explore.tolerance import VALIDITY, ToleranceChoice, ToleranceStudy
from flexstage.studies.explore.tolerance_choice import COARSEST, FINEST
from flexstage.virtual.imperfections import Scatter

_LEAST = 0.01  # smallest share of the variance in a table [1]


def spread_table(study: ToleranceStudy) -> Table:
    """Return mean and scatter of every figure."""
    return table(
        f"{study.stage.name}: {study.samples} simulated parts.",
        ("figure", "nominal", "mean", "95 % range from", "to", "standard deviation", "~relative σ"),
        [(spread.figure.heading, *_cells(spread)) for spread in study.spreads],
        notes=tuple(_few(study)),
    )


def _few(study: ToleranceStudy) -> Iterator[str]:
    needed = samples_for(2.5)
    uncertain = [spread.figure.name for spread in study.spreads if spread.count < needed]
    if uncertain:
        names = "" if len(uncertain) == len(study.spreads) else f" of {', '.join(uncertain)}"
        yield f"the 95 % range{names} needs at least {needed} samples"


def _cells(spread: Spread) -> tuple[str, ...]:
    most_decimals = 9
    quantity = spread.figure.display
    deviation = spread.standard_deviation * quantity.factor
    if spread.constant:
        same = quantity.text(spread.nominal)
        return (same, same, same, same, "≈ 0", "")
    # relative uncertainty of a standard deviation: 1 / sqrt(2 (n - 1)) for normal values
    relative_error = 1.0 / math.sqrt(2.0 * max(spread.count - 1, 1))
    digits = 1 if relative_error > 0.1 else 2 if relative_error > 0.01 else 3
    # the same decimals throughout a row, so that the deviation has one digit or two
    last = math.floor(math.log10(float(f"{deviation:.1e}"))) - (digits > 1)
    decimals = min(max(-last, 0), most_decimals)
    plain = 1e-3 <= abs(spread.nominal * quantity.factor) < 1e6

    def text(value: float) -> str:
        if not math.isfinite(value):
            return "–"
        return (
            f"{value * quantity.factor:.{decimals}f}" if plain else number(value * quantity.factor)
        )

    texts = [text(value) for value in (spread.nominal, spread.mean, *spread.middle)]
    share = (
        "" if quantity.zero else _percent(spread.standard_deviation / abs(spread.nominal), digits)
    )
    if digits == 1:
        return (*texts, f"{float(f'{deviation:.1g}'):g}", share)
    return (*texts, f"{deviation:.{decimals}f}" if plain else number(deviation, 2), share)


def yield_table(yields: tuple[Yield, ...], caption: str = "Yield.") -> Table:
    """Return the share of parts that meet each requirement, and all of them."""
    return table(
        caption,
        ("requirement", "good", "yield", "95 % interval from", "to"),
        [
            (
                "all requirements" if y.requirement is None else y.requirement.text,
                f"{y.met} of {y.count}",
                _percent(y.share, 4),
                _percent(y.low, 4),
                _percent(y.high, 4),
            )
            for y in yields
        ],
    )


def share_table(study: ToleranceStudy) -> Table:
    """Return the contributions of deviations to the scatter of each figure, the largest first."""
    most_named = 3  # most hinges of a row
    rows = []
    deviations = {spread.figure: spread.standard_deviation for spread in study.spreads}
    for of in study.shares:
        for i, part in enumerate(p for p in of.contributions if p.share >= _LEAST):
            main_contributors = ", ".join(
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
                    main_contributors,
                )
            )
        if of.unexplained >= _LEAST:
            rows.append(
                ("", "interactions, nonlinearity", "", f"{100.0 * of.unexplained:.1f} %", "", "")
            )
    return table(
        "Contributions to the scatter: shares of the variance.",
        ("figure", "<deviation", "scatter", "share", "effect of 1 σ", "<main contributors"),
        rows,
    )


def _change(figure: Figure, slope: float, deviation: float) -> str:
    """Return the effect of a deviation, with the decimals of a hundredth of the scatter."""
    quantity = figure.display
    size = deviation * quantity.factor
    if not 1e-5 <= size < 1e6:
        return figure.text(slope)
    decimals = max(0, 2 - math.floor(math.log10(size)))
    return f"{slope * quantity.factor:.{decimals}f} {quantity.shown_unit}".strip()


def choice_table(choice: ToleranceChoice) -> Table:
    """Return the tolerances for a yield, compared with the present ones."""
    return table(
        f"Least expensive scatter for a yield of {_percent(choice.target)}.",
        ("deviation", "present", "allowed", "allowed/present"),
        [
            (
                LABELS[kind],
                scatter_text(choice.initial, kind),
                scatter_text(choice.selected, kind),
                f"{choice.factor(kind):.2f}",
            )
            # factors at one end of the search range differ by rounding: they stay in their order
            for kind in sorted(choice.kinds, key=lambda k: round(choice.factor(k), 2))
        ],
        notes=(
            "standard deviations σ; 95 % of parts are within ±2 σ",
            f"search range: {FINEST:g} to {COARSEST:g} times the present scatter",
        ),
    )


def scatter_table(scatter: Scatter) -> Table:
    """Return the scatter of a manufacturing process."""
    return table(
        "Manufacturing process: standard deviations.",
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
    """Return the page of a tolerance analysis."""
    return page_html(
        heading=f"{study.stage.name}: tolerance analysis",
        lead=(
            f"{study.samples} simulated parts, seed {study.monte_carlo.seed}; "
            f"{study.model}; 95 % intervals"
        ),
        version=__version__,
        sections=_sections(study),
        # the first states the kind of the description, such as a reconstruction
        notes=(*study.notes, *study.stage.notes[:1]),
    )


def _sections(study: ToleranceStudy) -> Iterator[Section]:
    choice = study.choice
    if study.yields:
        yield Section(key="yield", title="Yield", content=(yield_table(study.yields),))
    histograms = Picture(
        result=study,
        title="Histograms of the figures",
        caption="Distribution of every figure; grey: range of 95 % of the parts.",
    )
    yield Section(key="figures", title="Characteristics", content=(spread_table(study), histograms))
    if study.shares:
        picture = Picture(
            result=study,
            view="shares",
            title="Shares of the variance",
            caption="Contributions to the variance of every figure.",
        )
        yield Section(
            key="shares",
            title="Contributions to the scatter",
            content=(picture, share_table(study)),
        )
    if choice is not None:
        conclusion = choice.conclusion[0].upper() + choice.conclusion[1:] + "."
        tables = (choice_table(choice), yield_table(choice.after, "Yield with these tolerances."))
        yield Section(
            key="tighten",
            title=f"Tolerances for a yield of {_percent(choice.target)}",
            content=(conclusion, *(tables if choice.available else ())),
        )
    yield Section(
        key="process",
        title="Process and model",
        content=(scatter_table(study.scatter), Bullets(VALIDITY)),
    )
