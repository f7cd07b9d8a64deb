"""What a sweep found: tables, and one page with parallel coordinates to brush."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import ModelError
from flexstage.base.lazy import require_extra
from flexstage.base.version import __version__
from flexstage.quantities.section import Definitions, Picture, Section
from flexstage.quantities.table import Table, table
from flexstage.report.figures.style import CYCLE, INK, PAPER
from flexstage.report.figures.sweep import draw_indices, draw_sweep
from flexstage.report.page import page_html
from flexstage.report.tables import LUMPED_NOTE, value_text
from flexstage.studies.explore.sampling import SobolIndices
from flexstage.studies.explore.sweep import Sweep

if TYPE_CHECKING:
    from markupsafe import Markup

#: Rows of a sweep of one variable that are shown, and columns of figures.
_ROWS, _COLUMNS = 13, 8
#: Lines of parallel coordinates beyond which nobody sees more, and a page becomes slow.
_LINES = 2000
#: Variables that have an axis among parallel coordinates: with more a line cannot be followed.
_AXES = 8
#: Smallest total index of a variable that is listed.
_SHARE = 0.01


def sweep_tables(sweep: Sweep) -> Iterator[Table]:
    """Yield what people read of a sweep first."""
    if len(sweep.variables) == 1 and sweep.varying:
        yield _rows(sweep)
    yield from range_tables(sweep)


def range_tables(sweep: Sweep) -> Iterator[Table]:
    """Yield between what the figures of a sweep lie, and where they are least and greatest."""
    # variables whose values are shown where a figure is least and greatest
    variables = 6
    yield _ranges(sweep)
    if 1 < len(sweep.variables) <= variables:
        yield _extremes(sweep)
    if sweep.indices is not None:
        yield _indices(sweep)


def sweep_notes(sweep: Sweep) -> tuple[str, ...]:
    """Return what is to be known of a sweep: what is no stage and why, and what does not vary."""
    notes = list(sweep.notes)
    gone = int((~sweep.possible).sum())
    if gone:
        are = "is" if gone == 1 else "are"
        notes.append(f"{gone} of {len(sweep.points)} points {are} no possible stage")
        notes += [f"{reason.count} of them: {reason.text}" for reason in sweep.common_faults[:3]]
        if sweep.advice:
            notes.append(sweep.advice)
    still = [figure.name for k, figure in enumerate(sweep.figures) if k not in sweep.varying]
    if still:
        notes.append(f"vary by less than 0.1 %: {', '.join(still)}")
    if sweep.indices is not None and sweep.indices.excluded:
        notes.append(
            f"Sobol' indices without {sweep.indices.excluded} base samples, which hold an "
            "impossible stage"
        )
    if sweep.indices is not None and _beyond(sweep.indices, sweep.varying):
        notes.append(
            "an index lies from 0 to 1: an interval that goes beyond shows how much chance is in "
            "its estimate, and more --samples narrow it"
        )
    if sweep.model == "lumped":
        notes.append(LUMPED_NOTE)
    return tuple(notes)


def _beyond(found: SobolIndices, moving: Sequence[int]) -> bool:
    """Say whether an interval that is listed, with two decimals, leaves 0 to 1."""
    rows = list(moving)
    listed = found.total[rows] >= _SHARE
    low = np.minimum(found.first_low, found.total_low)[rows][listed].min(initial=0.0)
    high = np.maximum(found.first_high, found.total_high)[rows][listed].max(initial=0.0)
    return bool(low < -0.005 or high > 1.005)


def sweep_title(sweep: Sweep) -> str:
    """Return what was done, in a line."""
    shape = " × ".join(map(str, sweep.counts))
    how = {
        "grid": f"grid of {shape}",
        "latin-hypercube": "Latin hypercube",
        "sobol": "Sobol' sequence",
    }[sweep.plan.sampling]
    points = len(sweep.points)
    if sweep.plan.indices:
        how = f"{points // (len(sweep.variables) + 2)} base samples of a Sobol' sequence"
    return f"{sweep.stage}: {sweep.model}, {points} points, {how}"


def sweep_html(sweep: Sweep) -> str:
    """Return one HTML page: parallel coordinates, pictures and tables; it needs nothing else.

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
        said=_said_of_lines(sweep),
        drawing=_coordinates(sweep),
    )


def _sections(sweep: Sweep) -> Iterator[Section]:
    picture = Picture(
        result=partial(draw_sweep, sweep),
        title="Figures over what was varied",
        caption="Figures that vary, over what was varied.",
    )
    first = sweep_tables(replace(sweep, indices=None))
    yield Section(key="figures", title="Figures", content=(picture, *first))
    if sweep.indices is not None:
        bars = Picture(
            result=partial(draw_indices, sweep),
            title="Sobol' indices",
            caption="Shares of the variance of each figure between the bounds of all variables.",
        )
        yield Section(key="indices", title="Sobol' indices", content=(bars, _indices(sweep)))
    ranges = {
        v.name: f"{value_text(v.low, v.dimension)} to {value_text(v.high, v.dimension)}"
        for v in sweep.variables
    }
    made = sweep.provenance
    settings = Definitions(
        {
            **ranges,
            **{key: text for key, text in made.settings.items() if key not in ranges},
            "computed by": f"flexstage {made.version}, Python {made.python}, {made.machine}",
            "on": made.created,
            "from the description": made.input_hash,
        }
    )
    yield Section(key="settings", title="Settings", content=(settings,))


def _said_of_lines(sweep: Sweep) -> str:
    possible = int(sweep.possible.sum())
    shown = min(possible, _LINES)
    of = "" if shown == possible else f"{shown} of "
    gone = len(sweep.points) - possible
    left_out = f" {gone} points that are no possible stage are left out." if gone else ""
    count = len(sweep.variables)
    if count > _AXES:
        left_out += f" Of {count} variables the {_AXES} that move a figure most have an axis."
    return (
        f"A line for each of {of}{possible} stages. Draw along an axis to keep the lines that pass "
        "there, click beside the stretch to let go, drag a heading to move its axis."
        f"{left_out}"
    )


def _coordinates(sweep: Sweep) -> "Markup":
    """Return parallel coordinates of what was varied and what varies."""
    rows = np.flatnonzero(sweep.possible)
    if len(rows) > _LINES:
        # a sequence is even from its start; of a grid every so many would be the same values
        drawn = np.random.default_rng(0).permutation(rows) if sweep.counts else rows
        rows = np.sort(drawn[:_LINES])
    axes: list[tuple[str, np.ndarray]] = [
        (sweep.variables[i].heading, sweep.points[rows, i] * sweep.variables[i].factor)
        for i in sweep.strongest(_AXES)
    ]
    first = len(axes) if sweep.varying else 0
    for k in sweep.varying:
        shown = sweep.display(k)
        axes.append((sweep.figures[k].heading_in(shown), sweep.values[rows, k] * shown.factor))
    return parallel_coordinates(axes, first)


def parallel_coordinates(axes: Sequence[tuple[str, np.ndarray]], first: int) -> "Markup":
    """Return parallel coordinates with the library that draws them, as HTML.

    An axis is a heading and a value of each line; `first` is the axis that colours them at first.
    """
    import plotly.graph_objects as go
    from markupsafe import Markup

    # with the digits that are seen
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
    """Break a heading into two lines of about the same length, as axes stand close."""
    places = [m.end() for m in re.finditer(r"[ ._]", heading)]
    if len(heading) <= 14 or not places:
        return heading
    at = min(places, key=lambda place: max(place, len(heading) - place))
    return f"{heading[:at].rstrip()}<br>{heading[at:]}"


def _rows(sweep: Sweep) -> Table:
    """Some rows of a sweep of one variable, evenly over its range."""
    variable, possible = sweep.variables[0], sweep.possible
    order = np.argsort(sweep.points[:, 0], kind="stable")
    count = min(_ROWS, len(order))
    chosen = order[np.unique(np.round(np.linspace(0, len(order) - 1, count)).astype(int))]
    shown = sweep.varying[:_COLUMNS]
    quantities = [sweep.display(k) for k in shown]
    headings = [sweep.figures[k].heading_in(q) for k, q in zip(shown, quantities, strict=True)]
    places = [_place(sweep, row, 0) for row in chosen]
    decimals = max(len(place.partition(".")[2]) for place in places)
    rows = []
    for row, place in zip(chosen, places, strict=True):
        cells = [
            q.text(float(sweep.values[row, k])) if possible[row] else "–"
            for k, q in zip(shown, quantities, strict=True)
        ]
        rows.append([f"{float(place):.{decimals}f}", *cells])
    of = f"{len(rows)} of {len(order)} points" if len(rows) < len(order) else ""
    return table(of, [variable.heading, *headings], rows)


def _ranges(sweep: Sweep) -> Table:
    """Range of each figure, and which variable moves it most."""
    one = len(sweep.variables) == 1
    headings = ["figure", "<unit", "as described", "least", "greatest"]
    headings.append("rank correlation" if one else "<moved most by (rank correlation)")
    rows = []
    correlations, least, greatest = sweep.correlations, sweep.least, sweep.greatest
    for k, figure in enumerate(sweep.figures):
        shown = sweep.display(k)
        ends = [sweep.values[row, k] for row in (least[k], greatest[k])]
        described = sweep.described[k]
        texts = [
            "–" if np.isnan(value) else shown.text(float(value)) for value in (described, *ends)
        ]
        rows.append([figure.label, shown.shown_unit, *texts, _trend(sweep, correlations[k])])
    return table(sweep_title(sweep), headings, rows)


def _trend(sweep: Sweep, found: Array) -> str:
    """Which variables move a figure most, and which way, by its correlations."""
    if np.isnan(found).all():
        return "–"
    if len(found) == 1:
        return f"{found[0]:+.2f}"
    best = np.argsort(-np.abs(found), kind="stable")[:2]
    words = (f"{sweep.variables[i].name} {found[i]:+.2f}" for i in best if abs(found[i]) >= 0.1)
    return ", ".join(words) or "none alone"


def _extremes(sweep: Sweep) -> Table:
    """Where each figure is least and greatest."""
    rows = []
    least, greatest = sweep.least, sweep.greatest
    for k in sweep.varying:
        figure, shown = sweep.figures[k], sweep.display(k)
        for word, row in (("least", least[k]), ("greatest", greatest[k])):
            at = (_place(sweep, row, i) for i in range(len(sweep.variables)))
            value = f"{shown.text(float(sweep.values[row, k]))} {shown.shown_unit}".strip()
            rows.append([figure.label, word, value, *at])
    heads = ["figure", "<", "value", *(variable.heading for variable in sweep.variables)]
    return table("Where figures are least and greatest.", heads, rows, divided=True)


def _indices(sweep: Sweep) -> Table:
    """Sobol' indices of the variables that have a part in a figure."""
    found = sweep.indices
    assert found is not None
    rows = []
    for k in sweep.varying:
        figure = sweep.figures[k]
        for i in np.argsort(-found.total[k], kind="stable"):
            if found.total[k, i] < _SHARE:
                continue
            rows.append(
                [
                    figure.label,
                    sweep.variables[i].name,
                    f"{found.first[k, i]:.3f}",
                    f"{found.first_low[k, i]:.2f} to {found.first_high[k, i]:.2f}",
                    f"{found.total[k, i]:.3f}",
                    f"{found.total_low[k, i]:.2f} to {found.total_high[k, i]:.2f}",
                ]
            )
    percent = f"{100.0 * found.confidence:g} %"
    return table(
        f"Sobol' indices: shares of the variance between the bounds, from {_SHARE:g} on",
        ["figure", "<variable", "first order", percent, "total", percent],
        rows,
        divided=True,
    )


def _place(sweep: Sweep, row: int, i: int) -> str:
    """Write the value of a variable, without zeros at its end, as on a grid it is a round one."""
    return f"{float(f'{sweep.points[row, i] * sweep.variables[i].factor:.4g}'):.10g}"
