"""Tables of a reconstruction: given figures, ranges, dimensions; and notes on its validity."""

import math
from collections.abc import Iterator

from flexstage.quantities.quantity import number
from flexstage.quantities.table import Column, Table, table
from flexstage.studies.explore.ensemble import (
    DISAGREEMENT,
    MODEL_ERROR,
    STRESS_ERROR,
    Ensemble,
    FigureRow,
)

#: Part of the spread above which a further measurement is not worth its name [1].
_WORTH = 0.95
#: Dimensions that keep more of their spread are named in a note.
_INFORMED = 0.95


def ensemble_tables(ensemble: Ensemble) -> Iterator[Table]:
    """Yield the tables of an ensemble: given figures, all figures, dimensions."""
    rows = ensemble.figure_rows()
    yield _observations(ensemble)
    yield _figures(ensemble, rows)
    yield _dimensions(ensemble)


def _observations(ensemble: Ensemble) -> Table:
    rows = []
    for observation in ensemble.observations:
        i = ensemble.figures.index(observation.figure)
        text = observation.figure.display.text
        described, best = float(ensemble.described[i]), float(ensemble.best_values[i])
        spread = observation.spread * (observation.value if observation.logarithmic else 1.0)
        rows.append(
            (
                observation.figure.label,
                observation.figure.display.shown_unit,
                text(observation.value),
                number(spread * observation.figure.display.factor, 2),
                text(described),
                text(best),
                f"{100.0 * (best / observation.value - 1.0):+.2f} %" if observation.value else "",
            )
        )
    columns = (
        Column("figure", "title"),
        Column("unit", "words"),
        "given",
        "± standard",
        "described stage",
        "most probable stage",
        "difference",
    )
    return table(f"{ensemble.template.source}: given figures", columns, rows)


def _figures(ensemble: Ensemble, figures: tuple[FigureRow, ...]) -> Table:
    rows = []
    for row in figures:
        text = row.figure.display.text
        first = next(iter(ensemble.next(row.figure.name)), None)
        measure = ""
        if row.kind == "predicted" and first is not None and first.remaining < _WORTH:
            measure = f"{first.name} to {first.noise_text}"
        rows.append(
            (
                row.figure.label,
                row.figure.display.shown_unit,
                row.kind,
                text(row.described),
                text(row.median),
                text(row.low),
                text(row.high),
                row.by,
                "" if row.agreement is None else f"{row.agreement:.2f}",
                measure,
                f"{100.0 * first.remaining:.0f} %" if measure and first is not None else "",
            )
        )
    columns = (
        Column("figure", "title"),
        Column("unit", "words"),
        Column("", "words"),
        "described",
        "median",
        "95 % range from",
        "to",
        Column("by", "words"),
        Column("members over Laplace", spare=True),
        Column("measure next", "long words"),
        "leaves",
    )
    return table("figures: given, or predicted from them", columns, rows)


def _dimensions(ensemble: Ensemble) -> Table:
    rows = []
    for row in ensemble.dimension_rows():
        variable, sigma = row.dimension.variable, row.dimension.sigma
        rows.append(
            (
                row.dimension.name,
                variable.unit,
                number(row.dimension.median * variable.factor),
                f"{100.0 * sigma:.0f} %",
                *(number(v * variable.factor) for v in (row.median, row.low, row.high)),
                f"{100.0 * row.remaining:.0f} %",
            )
        )
    heads = (
        "dimension",
        "<unit",
        "before",
        "± standard",
        "median",
        "95 % range from",
        "to",
        "spread left",
    )
    return table("dimensions before and after", heads, rows)


def ensemble_notes(ensemble: Ensemble) -> tuple[str, ...]:
    """Return notes on what is informed, on the members, and on the validity of the ranges."""
    uninformed = [row for row in ensemble.dimension_rows() if row.laplace > _INFORMED]
    count = len(ensemble.observations)
    notes = [
        f"{count} given figure{' informs' if count == 1 else 's inform'} {ensemble.informed:.1f} "
        f"of {len(ensemble.dimensions)} dimensions; {len(uninformed)} keep more than "
        f"{100.0 * _INFORMED:.0f} % of their spread",
        "before: each dimension is log-normal about its value, independent of the others, in a "
        "stage of this form; limits of the geometry count in the members alone",
        f"noise of a given figure: its own and that of the model, {100.0 * MODEL_ERROR:g} % and "
        f"{100.0 * STRESS_ERROR:g} % of a stress",
        _members(ensemble),
    ]
    if len(ensemble.points) and (text := _agreement(ensemble.figure_rows())):
        notes.append(text)
    notes.append(f"figures by the {ensemble.model} model")
    return tuple(notes)


def _members(ensemble: Ensemble) -> str:
    count, requested = len(ensemble.points), ensemble.requested
    text = f"Laplace's approximation in {ensemble.seconds['laplace']:.0f} s"
    if not requested:
        return f"{text}; no members (--members 0)"
    refused = ensemble.refused
    text += (
        f"; {count} of {requested} members in {ensemble.seconds['members']:.0f} s; "
        f"{refused['impossible']} draws were no stage, and {refused['off']} were too far from the "
        "given figures by finite elements"
    )
    return text if count >= requested else f"{text}; --time gives more"


def _agreement(rows: tuple[FigureRow, ...]) -> str:
    ratios = [row.agreement for row in rows if row.agreement is not None]
    if not ratios:
        return "too few members to compare with Laplace's approximation"
    geometric = math.exp(sum(math.log(r) for r in ratios) / len(ratios))
    replaced = sum(row.by == "ensemble" for row in rows)
    return (
        f"standard deviation of the members over Laplace's: {geometric:.2f} in the mean of "
        f"{len(ratios)} figures, {min(ratios):.2f} to {max(ratios):.2f}; where it or the median "
        f"differs by more than {100.0 * DISAGREEMENT:.0f} % ({replaced} figures), the members count"
    )
