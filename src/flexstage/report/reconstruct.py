"""Tables of a reconstruction: given figures, ranges, dimensions; and notes on its validity."""

import math
from collections.abc import Iterator

from flexstage.quantities.quantity import number
from flexstage.quantities.table import Column, Table, table
from flexstage.studies.explore.ensemble import (
    FEWEST_MEMBERS,
    MODEL_ERROR,
    STRESS_ERROR,
    Ensemble,
    FigureRow,
    disagreement,
)

#: Part of the spread above which a further measurement is not named [1].
_WORTH = 0.95
#: Dimensions that keep more of their spread are named in a note.
_INFORMED = 0.95
#: Standard deviations beyond which a given figure is missed.
_MISSED = 3.0
#: Probability of a chi-squared below which given figures contradict form or prior [1].
_UNLIKELY = 0.01
#: Distance of the most probable stage from that without limits, in standard deviations before.
_LIMITED = 0.05


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
    compared = any(row.agreement is not None for row in figures)
    for row in figures:
        text = row.figure.display.text
        measure = ""
        if row.kind == "predicted" and not row.zero:
            first = next(iter(ensemble.next(row.figure.name)), None)
            if first is not None and first.remaining < _WORTH:
                measure = f"{first.name} to {first.noise_text}"
                # Laplace's share says nothing of a range that the members gave
                if row.by == "Laplace":
                    measure += f" leaves {100.0 * first.remaining:.0f} %"
        rows.append(
            (
                row.figure.label,
                row.figure.display.shown_unit,
                row.kind,
                text(0.0 if row.zero else row.described),
                text(row.median),
                *(("", "") if row.zero else (text(row.low), text(row.high))),
                "" if row.zero else f"{100.0 * row.remaining:.0f} %",
                "" if row.zero else row.by,
                "" if row.agreement is None else f"{row.agreement:.2f}",
                measure,
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
        "spread left",
        Column("by", "words", spare=True),
        Column("members over Laplace" if compared else "", spare=True),
        Column("measure next", "long words"),
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
        f"{100.0 * STRESS_ERROR:g} % of a stress, none of mass and geometry; that of the model is "
        "in the range of a predicted figure",
        *_residuals(ensemble),
        _members(ensemble),
    ]
    if len(ensemble.points) and (text := _agreement(ensemble)):
        notes.append(text)
    notes.append(f"figures by the {ensemble.model} model")
    if ensemble.model == "lumped":
        notes.append(
            "ranges leave out what rigid bodies leave out: output stiffness and sag by tens of per "
            "cent"
        )
    return tuple(notes)


def _residuals(ensemble: Ensemble) -> Iterator[str]:
    """Yield notes on what the most probable stage leaves of the given figures."""
    probability = ensemble.probability
    text = (
        f"chi-squared of given figures and dimensions {number(ensemble.chi_squared, 2)}, "
        f"probability {'below 1e-6' if probability < 1e-6 else number(probability, 2)}"
    )
    contradicted = "; figures, form or what is known before contradict each other: doubt the ranges"
    yield text + contradicted * (probability < _UNLIKELY)
    missed = [
        f"{o.figure.name} ({residual:+.0f})"
        for o, residual in zip(ensemble.observations, ensemble.residuals.tolist(), strict=True)
        if abs(residual) > _MISSED
    ]
    if missed:
        yield (
            f"the most probable stage misses {', '.join(missed)}: more than {_MISSED:g} standard "
            "deviations"
        )
    apart = ensemble.coordinates - ensemble.best_coordinates
    if math.sqrt(float(apart @ apart)) > _LIMITED:
        yield (
            "limits of the geometry keep the most probable stage from the given figures; Laplace's "
            "ranges do not know them"
        )


def _members(ensemble: Ensemble) -> str:
    count, requested = len(ensemble.points), ensemble.requested
    text = f"Laplace's approximation in {ensemble.seconds['laplace']:.0f} s"
    if not requested:
        return f"{text}; no members (--members 0)"
    refused = ensemble.refused
    text += (
        f"; {count} of {requested} members in {ensemble.seconds['members']:.0f} s; "
        f"{refused['impossible']} draws could not be built, and {refused['off']} were too far from "
        "the given figures by finite elements"
    )
    if ensemble.stopped == "time":
        return f"{text}; --time-limit gives more"
    if ensemble.stopped == "interrupted":
        return f"{text}; interrupted"
    if count < requested:
        off = refused["off"] > refused["impossible"]
        reason = "the given figures" if off else "the limits of the geometry"
        return f"{text}; {reason} refuse more"
    return text


def _agreement(ensemble: Ensemble) -> str:
    rows = [row for row in ensemble.figure_rows() if not row.zero]
    ratios = [row.agreement for row in rows if row.agreement is not None]
    if not ratios:
        return f"a comparison with Laplace's approximation needs {FEWEST_MEMBERS} members"
    geometric = math.exp(sum(math.log(r) for r in ratios) / len(ratios))
    limit = disagreement(len(ensemble.points))
    replaced = sum(row.by == "ensemble" for row in rows)
    return (
        f"standard deviation of the members over Laplace's: {geometric:.2f} in the mean of "
        f"{len(ratios)} figures, {min(ratios):.2f} to {max(ratios):.2f}; where it or the median "
        f"differs by more than {100.0 * limit:.0f} % ({replaced} figures), the members count"
    )
