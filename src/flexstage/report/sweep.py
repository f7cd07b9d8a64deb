"""Results of a sweep: tables, and a page with parallel coordinates."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.version import __version__
from flexstage.quantities.table import Definitions, Picture, Section, Table, table
from flexstage.report.figures.style import CYCLE, INK, PAPER
from flexstage.report.page import page_html
from flexstage.report.tables import LUMPED_NOTE, value_text
from flexstage.studies.explore.sampling import SobolIndices
from flexstage.studies.explore.sweep import Sweep

if TYPE_CHECKING:
    from markupsafe import Markup

#: Most rows of a sweep of one variable, and most columns of figures.
_ROWS, _COLUMNS = 13, 8
#: Most lines of parallel coordinates: more cannot be distinguished and make the page slow.
_LINES = 2000
#: Most variables with an axis in parallel coordinates: with more, a line cannot be followed.
_AXES = 8
#: Smallest total index of a variable that is listed.
_LEAST_INDEX = 0.01
#: Use of parallel coordinates.
INSTRUCTIONS = (
    "Drag along an axis to select lines, click outside the selection to clear it, drag a heading "
    "to move its axis."
)


def sweep_tables(sweep: Sweep) -> Iterator[Table]:
    """Yield the tables of a sweep."""
    if len(sweep.variables) == 1 and sweep.varying:
        yield _rows(sweep)
    yield from range_tables(sweep)


def range_tables(sweep: Sweep) -> Iterator[Table]:
    """Yield the ranges of the figures of a sweep, and the points of their extremes."""
    # most variables in the table of extremes
    variables = 6
    yield _ranges(sweep)
    if 1 < len(sweep.variables) <= variables:
        yield _extremes(sweep)
    if sweep.indices is not None:
        yield _indices(sweep)


def sweep_notes(sweep: Sweep) -> tuple[str, ...]:
    """Return notes on a sweep: infeasible points, their reasons, and figures that do not vary."""
    notes = list(sweep.notes)
    infeasible = int((~sweep.possible).sum())
    if infeasible:
        verb = "is" if infeasible == 1 else "are"
        notes.append(f"{infeasible} of {len(sweep.points)} points {verb} infeasible")
        notes += [f"{reason.count} of them: {reason.text}" for reason in sweep.common_faults[:3]]
        if sweep.advice:
            notes.append(sweep.advice)
    constant = [figure.name for k, figure in enumerate(sweep.figures) if k not in sweep.varying]
    if constant:
        notes.append(f"variation below 0.1 %: {', '.join(constant)}")
    if sweep.indices is not None and sweep.indices.excluded:
        notes.append(
            f"Sobol' indices exclude {sweep.indices.excluded} base samples with an infeasible stage"
        )
    if sweep.indices is not None and _beyond(sweep.indices, sweep.varying):
        notes.append(
            "an index is between 0 and 1: an interval beyond these limits shows the sampling "
            "error, which more --samples reduce"
        )
    if sweep.model == "lumped":
        notes.append(LUMPED_NOTE)
    return tuple(notes)


def _beyond(indices: SobolIndices, moving: Sequence[int]) -> bool:
    """Return whether a listed interval, with two decimals, exceeds 0 to 1."""
    rows = list(moving)
    listed = indices.total[rows] >= _LEAST_INDEX
    low = np.minimum(indices.first_low, indices.total_low)[rows][listed].min(initial=0.0)
    high = np.maximum(indices.first_high, indices.total_high)[rows][listed].max(initial=0.0)
    return bool(low < -0.005 or high > 1.005)


def sweep_title(sweep: Sweep) -> str:
    """Return stage, model and sampling of a sweep."""
    shape = " × ".join(map(str, sweep.counts))
    sampling = {
        "grid": f"grid of {shape}",
        "latin-hypercube": "Latin hypercube",
        "sobol": "Sobol' sequence",
    }[sweep.plan.sampling]
    points = len(sweep.points)
    if sweep.plan.indices:
        sampling = f"{points // (len(sweep.variables) + 2)} base samples of a Sobol' sequence"
    return f"{sweep.stage}: {sweep.model}, {points} points, {sampling}"


def sweep_html(sweep: Sweep) -> str:
    """Return one self-contained HTML page: parallel coordinates, pictures and tables.

    Raises
    ------
    ModelError
        Plotly is not installed, or no figure varies.
    """
    require_extra("explore", "plotly", "a page of parallel coordinates", ModelError)
    sections = tuple(_sections(sweep))
    return page_html(
        heading=f"{sweep.stage}: sweep",
        lead=sweep_title(sweep),
        version=__version__,
        links=(("coordinates", "Parallel coordinates"), *((s.key, s.title) for s in sections)),
        sections=sections,
        notes=sweep_notes(sweep),
        template="sweep.html",
        instructions=_instructions(sweep),
        drawing=_coordinates(sweep),
    )


def _sections(sweep: Sweep) -> Iterator[Section]:
    overview = Picture(
        result=sweep,
        title="Figures over the parameters",
        caption="Figures that vary, over the varied parameters.",
    )
    tables = sweep_tables(replace(sweep, indices=None))
    yield Section(key="figures", title="Figures", content=(overview, *tables))
    if sweep.indices is not None:
        indices_picture = Picture(
            result=sweep,
            view="indices",
            title="Sobol' indices",
            caption="Shares of the variance of each figure between the bounds of all variables.",
        )
        yield Section(
            key="indices", title="Sobol' indices", content=(indices_picture, _indices(sweep))
        )
    ranges = {
        v.name: f"{value_text(v.low, v.dimension)} to {value_text(v.high, v.dimension)}"
        for v in sweep.variables
    }
    provenance = sweep.provenance
    settings = Definitions(
        {
            **ranges,
            **{key: text for key, text in provenance.settings.items() if key not in ranges},
            "software": f"flexstage {provenance.version}, Python {provenance.python}, "
            f"{provenance.machine}",
            "date": provenance.created,
            "description, SHA-256": provenance.input_hash,
        }
    )
    yield Section(key="settings", title="Settings", content=(settings,))


def _instructions(sweep: Sweep) -> str:
    possible = int(sweep.possible.sum())
    drawn_lines = min(possible, _LINES)
    of = "" if drawn_lines == possible else f"{drawn_lines} of "
    infeasible = len(sweep.points) - possible
    omitted = f" {infeasible} infeasible points are omitted." if infeasible else ""
    count = len(sweep.variables)
    if count > _AXES:
        omitted += f" The {_AXES} most influential of {count} variables have an axis."
    return f"Each line is one of {of}{possible} stages. {INSTRUCTIONS}{omitted}"


def _coordinates(sweep: Sweep) -> "Markup":
    """Return parallel coordinates of the varied parameters and the figures that vary."""
    rows = np.flatnonzero(sweep.possible)
    if len(rows) > _LINES:
        # a sequence is uniform from its start; a grid is sampled at random
        order = np.random.default_rng(0).permutation(rows) if sweep.counts else rows
        rows = np.sort(order[:_LINES])
    axes: list[tuple[str, np.ndarray]] = [
        (sweep.variables[i].heading, sweep.points[rows, i] * sweep.variables[i].factor)
        for i in sweep.strongest(_AXES)
    ]
    first = len(axes) if sweep.varying else 0
    for k in sweep.varying:
        quantity = sweep.display(k)
        axes.append(
            (sweep.figures[k].heading_in(quantity), sweep.values[rows, k] * quantity.factor)
        )
    return parallel_coordinates(axes, first)


def parallel_coordinates(axes: Sequence[tuple[str, np.ndarray]], first: int) -> "Markup":
    """Return parallel coordinates with their drawing library, as HTML.

    An axis is a heading and a value of each line; `first` is the axis that colours them at first.
    """
    import plotly.graph_objects as go
    from markupsafe import Markup

    # with the visible digits
    values = [[float(f"{value:.6g}") for value in column] for _, column in axes]

    def colour(i: int) -> dict[str, Any]:
        return {"line.color": [values[i]], "line.colorbar.title.text": _broken(axes[i][0])}

    lines = go.Parcoords(
        dimensions=[
            {"label": _broken(heading), "values": column, "tickformat": ".4~g"}
            for (heading, _), column in zip(axes, values, strict=True)
        ],
        line={
            "color": values[first],
            "colorscale": [[0.0, CYCLE[0]], [0.5, CYCLE[3]], [1.0, CYCLE[1]]],
            "showscale": True,
            "colorbar": {"title": {"text": _broken(axes[first][0])}, "thickness": 12},
        },
        labelfont={"size": 11},
        tickfont={"size": 10},
        rangefont={"size": 1, "color": PAPER},
    )
    figure = go.Figure(lines)
    choice = {
        "buttons": [
            {"label": f"colour: {heading}", "method": "restyle", "args": [colour(i)]}
            for i, (heading, _) in enumerate(axes)
        ],
        "active": first, "x": 0.0, "xanchor": "left", "y": 1.33, "yanchor": "top",
    }  # fmt: skip
    figure.update_layout(
        updatemenus=[choice], height=520, width=max(1120, 122 * len(axes) + 200),
        margin={"l": 70, "r": 40, "t": 130, "b": 30},
        paper_bgcolor=PAPER, font={"family": "DejaVu Sans, Verdana, Arial", "color": INK},
    )  # fmt: skip
    return Markup(
        figure.to_html(
            full_html=False,
            include_plotlyjs=True,
            div_id="parallel-coordinates",
            config={"displaylogo": False, "modeBarButtons": [["toImage"]]},
        )
    )


def _broken(heading: str) -> str:
    """Break a heading into two lines of about equal length, as axes are narrow."""
    places = [m.end() for m in re.finditer(r"[ ._]", heading)]
    if len(heading) <= 14 or not places:
        return heading
    at = min(places, key=lambda place: max(place, len(heading) - place))
    return f"{heading[:at].rstrip()}<br>{heading[at:]}"


def _rows(sweep: Sweep) -> Table:
    """Return rows of a sweep of one variable, evenly over its range."""
    variable, possible = sweep.variables[0], sweep.possible
    order = np.argsort(sweep.points[:, 0], kind="stable")
    count = min(_ROWS, len(order))
    selected = order[np.unique(np.round(np.linspace(0, len(order) - 1, count)).astype(int))]
    columns = sweep.varying[:_COLUMNS]
    quantities = [sweep.display(k) for k in columns]
    headings = [sweep.figures[k].heading_in(q) for k, q in zip(columns, quantities, strict=True)]
    places = [_place(sweep, row, 0) for row in selected]
    decimals = max(len(place.partition(".")[2]) for place in places)
    rows = []
    for row, place in zip(selected, places, strict=True):
        cells = [
            q.text(float(sweep.values[row, k])) if possible[row] else "–"
            for k, q in zip(columns, quantities, strict=True)
        ]
        rows.append([f"{float(place):.{decimals}f}", *cells])
    of = f"{len(rows)} of {len(order)} points" if len(rows) < len(order) else ""
    return table(of, [variable.heading, *headings], rows)


def _ranges(sweep: Sweep) -> Table:
    """Return the range of each figure, and its most influential variables."""
    single = len(sweep.variables) == 1
    headings = ["figure", "<unit", "as described", "minimum", "maximum"]
    headings.append("rank correlation" if single else "<main variables (rank correlation)")
    rows = []
    correlations, least, greatest = sweep.correlations, sweep.least, sweep.greatest
    for k, figure in enumerate(sweep.figures):
        quantity = sweep.display(k)
        ends = [sweep.values[row, k] for row in (least[k], greatest[k])]
        described = sweep.described[k]
        texts = [
            "–" if np.isnan(value) else quantity.text(float(value)) for value in (described, *ends)
        ]
        rows.append([figure.label, quantity.shown_unit, *texts, _trend(sweep, correlations[k])])
    return table(sweep_title(sweep), headings, rows)


def _trend(sweep: Sweep, correlations: Array) -> str:
    """Return the most influential variables of a figure, with their correlations."""
    if np.isnan(correlations).all():
        return "–"
    if len(correlations) == 1:
        return f"{correlations[0]:+.2f}"
    strongest = np.argsort(-np.abs(correlations), kind="stable")[:2]
    words = (
        f"{sweep.variables[i].name} {correlations[i]:+.2f}"
        for i in strongest
        if abs(correlations[i]) >= 0.1
    )
    return ", ".join(words) or "none alone"


def _extremes(sweep: Sweep) -> Table:
    """Return the points of the minimum and maximum of each figure."""
    rows = []
    least, greatest = sweep.least, sweep.greatest
    for k in sweep.varying:
        figure, quantity = sweep.figures[k], sweep.display(k)
        for word, row in (("minimum", least[k]), ("maximum", greatest[k])):
            at = (_place(sweep, row, i) for i in range(len(sweep.variables)))
            value = f"{quantity.text(float(sweep.values[row, k]))} {quantity.shown_unit}".strip()
            rows.append([figure.label, word, value, *at])
    heads = ["figure", "<", "value", *(variable.heading for variable in sweep.variables)]
    return table("Minima and maxima of the figures.", heads, rows, divided=True)


def _indices(sweep: Sweep) -> Table:
    """Return the Sobol' indices of the influential variables of each figure."""
    indices = sweep.indices
    assert indices is not None
    rows = []
    for k in sweep.varying:
        figure = sweep.figures[k]
        for i in np.argsort(-indices.total[k], kind="stable"):
            if indices.total[k, i] < _LEAST_INDEX:
                continue
            rows.append(
                [
                    figure.label,
                    sweep.variables[i].name,
                    f"{indices.first[k, i]:.3f}",
                    f"{indices.first_low[k, i]:.2f} to {indices.first_high[k, i]:.2f}",
                    f"{indices.total[k, i]:.3f}",
                    f"{indices.total_low[k, i]:.2f} to {indices.total_high[k, i]:.2f}",
                ]
            )
    percent = f"{100.0 * indices.confidence:g} %"
    return table(
        f"Sobol' indices: shares of the variance between the bounds, at least {_LEAST_INDEX:g}",
        ["figure", "<variable", "first order", percent, "total", percent],
        rows,
        divided=True,
    )


def _place(sweep: Sweep, row: int, i: int) -> str:
    """Return the value of a variable without trailing zeros."""
    return f"{float(f'{sweep.points[row, i] * sweep.variables[i].factor:.4g}'):.10g}"
