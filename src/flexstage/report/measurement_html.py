"""What was measured, as HTML: a page of its own, or a section of the report of a study."""

from collections.abc import Iterator
from html import escape
from typing import Any

import flexstage
from flexstage.experiments.campaign.results import TestResult
from flexstage.quantities import beside, display, number
from flexstage.report.figures.modal_fit import draw_modal_fit, draw_stabilisation, strongest_output
from flexstage.report.figures.motion_error import (
    draw_motion_error,
    draw_positioning,
    draw_workspace,
)
from flexstage.report.figures.noise import draw_hold, draw_staircase
from flexstage.report.page import bullets, cells, definitions, drawn, page_html, row_of, table_html
from flexstage.report.positioning import positioning_tables
from flexstage.report.tables import LABEL_HEADS, column_title
from flexstage.studies.measurement import MeasuredRow, MeasurementComparison

_MOTIONS = {
    "across": "motion across, in the plane",
    "vertical": "motion out of the plane",
    "roll": "roll",
    "pitch": "pitch",
    "yaw": "yaw",
}


def measurement_text(result: MeasurementComparison) -> str:
    """Write a page of what was measured, which needs nothing else."""
    parts = dict(_parts(result))
    notes = bullets(result.found.campaign.notes)
    return page_html(
        title=result.title,
        heading=result.title,
        lead=(
            f"{len(result.found.results)} tests, {len(result.rows)} figures; intervals are those "
            "of 95 %"
        ),
        version=flexstage.__version__,
        links=((key, title) for key, (title, _) in parts.items()),
        body="".join(
            f'<section id="{key}"><h2>{title}</h2>{content}</section>'
            for key, (title, content) in parts.items()
        ),
        notes=f'<div class="note">{notes}</div>' if notes else "",
    )


def measurement_section(result: MeasurementComparison) -> str:
    """Write what was measured as a section of another page."""
    whole = "".join(
        content if key == "figures" else f"<h3>{title}</h3>{content}"
        for key, (title, content) in _parts(result)
    )
    notes = "; ".join(result.found.campaign.notes)
    return (f'<div class="note"><p>{escape(notes)}</p></div>' if notes else "") + whole


def _parts(result: MeasurementComparison) -> Iterator[tuple[str, tuple[str, str]]]:
    yield "figures", ("Figures", _table(result))
    named = (
        ("motion", "Motion over the stroke", _motion),
        ("positioning", "Positioning", _positioning),
        ("workspace", "Workspace", _workspace),
        ("response", "Frequency responses and modes", _response),
        ("standing", "Steps and noise", _standing),
    )
    for key, title, draw in named:
        content = "".join(draw(r, f"{key}-{i}") for i, r in enumerate(result.found.results))
        if content:
            yield key, (title, content)
    yield "budgets", ("Budgets of uncertainty", _budgets(result))
    words = [n for n in result.notes if n not in result.found.campaign.notes]
    if words or result.found.sources:
        yield "records", ("Records", _records(result, words))


def _table(result: MeasurementComparison) -> str:
    simulated = result.found.campaign.origin == "virtual"
    # a simulated stage is made from published values and random errors: it tests no model
    references = () if simulated else result.references
    heads = [*LABEL_HEADS, "<th>value</th><th>±&nbsp;(95&nbsp;%)</th>"]
    heads += [f"<th>{escape(column_title(origin))}</th>" for origin in references]
    here = "simulated measurement" if simulated else "measured here"
    groups = f'<th></th><th></th><th colspan="2">{here}</th>'
    published = [o for o in references if o.startswith("published")]
    models = [o for o in references if not o.startswith("published")]
    for title, origins in (("published", published), ("computed here", models)):
        if origins:
            groups += f'<th colspan="{len(origins)}">{title}</th>'
    lines, before = [], ""
    for row in result.rows:
        opening = '<tr class="next">' if row.figure.quantity != before else "<tr>"
        lines.append(f"{opening}{_cells(row, references)}</tr>")
        before = row.figure.quantity
    key = (
        "<p>Small print: (measured − reference)/reference; * = larger than its 95 % uncertainty. "
        "A model or a publication that states no uncertainty counts as exact.</p>"
        if references
        else "<p>Simulated, not measured: no figure is compared with a model or a publication.</p>"
        if simulated
        else ""
    )
    return table_html(heads, lines, groups=groups) + key


def _cells(row: MeasuredRow, origins: tuple[str, ...]) -> str:
    estimate = row.figure.estimate
    sizes = [abs(estimate.value), *(abs(other.value) for other in row.references.values())]
    shown = display(row.figure.quantity).fitting(max(sizes))
    value, spread = beside(shown.factor * estimate.value, shown.factor * estimate.expanded)
    cells = [
        f'<td class="text">{escape(shown.heading)}</td>',
        f'<td class="text">{escape(row.figure.axis)}</td>',
        f'<td class="ours" title="{escape(estimate.note, quote=True)}">{value}</td>',
        f'<td class="ours">{spread}</td>',
    ]
    for origin in origins:
        other, found = row.references.get(origin), row.differences.get(origin)
        if other is None or found is None:
            cells.append("<td>–</td>")
            continue
        note = f' title="{escape(other.note, quote=True)}"' if other.note else ""
        cells.append(f"<td{note}>{other.text(shown)}<br><small>{_difference(found)}</small></td>")
    return "".join(cells)


def _difference(found: Any) -> str:
    # against something near nothing a percentage says nothing
    if found.percent is None or abs(found.percent) > 1e4:
        return "*" if found.significant else ""
    mark = " *" if found.significant else ""
    return f"{found.percent:+.2f} %{mark}"


def _budgets(result: MeasurementComparison) -> str:
    names = list(
        dict.fromkeys(c.name for row in result.rows for c in row.figure.estimate.components)
    )
    lines = []
    for row in result.rows:
        estimate = row.figure.estimate
        shown = display(row.figure.quantity).fitting(abs(estimate.value))
        own: dict[str, float] = {}
        for c in estimate.components:
            own[c.name] = (own.get(c.name, 0.0) ** 2 + c.uncertainty**2) ** 0.5
        u = estimate.uncertainty
        shares = (f"{100.0 * (own[n] / u) ** 2:.0f}" if u > 0.0 and n in own else "" for n in names)
        nu = estimate.degrees_of_freedom
        freedom = "∞" if nu > 1e4 else f"{nu:.0f}"
        lines.append(
            f'<tr><td class="text">{escape(shown.heading)}</td>'
            f'<td class="text">{escape(row.figure.axis)}</td>'
            f"{cells((number(shown.factor * u, 2), freedom, *shares))}</tr>"
        )
    heads = (f"<th>{escape(name)}</th>" for name in names)
    return (
        "<p>Standard uncertainty, its degrees of freedom, and the share of each contribution in "
        "its square [%].</p>"
        + table_html([*LABEL_HEADS, "<th>u</th><th>degrees</th>", *heads], lines)
    )


def _motion(result: TestResult, key: str) -> str:
    curves = result.details.get("curves")
    if curves is None:
        return ""
    axis = result.test.axis
    # the legend of the first serves all
    plots = [
        drawn(
            draw_motion_error(
                result.details["stroke"].curve,
                title=f"{axis}: position less its line",
                position_label="command",
                label="distance from the line",
            ),
            f"{key}-along",
            f"{axis}: position less its least-squares line",
            f"{escape(axis)}: position less its least-squares line{_band(result)}.",
        )
    ]
    for name, curve in curves.items():
        turning = curve.unit == "rad"
        plot = draw_motion_error(
            curve,
            title=f"{axis}: {_MOTIONS[name]}",
            position_label=f"position {axis}",
            label="rotation" if turning else "distance from the line",
            line="none" if turning else "least_squares",
            legend=False,
        )
        words = f"{axis}: {_MOTIONS[name]}"
        plots.append(drawn(plot, f"{key}-{name}", words, f"{escape(words)}{_band(result)}."))
    return row_of(plots, columns=2)


def _band(result: TestResult) -> str:
    return f", test {escape(result.test.name)}, with 95 % band (statistical)"


def _positioning(result: TestResult, key: str) -> str:
    found = result.details.get("positioning")
    if found is None:
        return ""
    tables = positioning_tables(found)
    name = escape(result.test.name)
    plot = draw_positioning(found, title=f"{result.test.axis}: ISO 230-2")
    return (
        f"<p>Test {name}: {found.runs} runs upward and downward; values in {tables.unit}.</p>"
        f"{row_of([drawn(plot, key, name, f'Positioning by ISO 230-2, test {name}.')])}"
        f"{_cells_of(tables.axis_heads, tables.axis, 2)}"
        f"{_cells_of(tables.target_heads, tables.targets, 0)}"
    )


def _cells_of(heads: tuple[str, ...], rows: tuple[tuple[str, ...], ...], words: int) -> str:
    """Write a table whose first columns are words."""
    kind = ['<{} class="text">' if i < words else "<{}>" for i in range(len(heads))]
    top = (k.format("th") + f"{escape(h)}</th>" for k, h in zip(kind, heads, strict=True))
    lines = (
        f"<tr>{''.join(k.format('td') + escape(c) + '</td>' for k, c in zip(kind, r, strict=True))}"
        "</tr>"
        for r in rows
    )
    return table_html(top, lines)


def _workspace(result: TestResult, key: str) -> str:
    found = result.details.get("workspace")
    if found is None:
        return ""
    words = f"Workspace, test {escape(result.test.name)}; ± of its title is statistical."
    return row_of([drawn(draw_workspace(found), key, "workspace", words)], columns=2)


def _response(result: TestResult, key: str) -> str:
    fit = result.details.get("fit")
    if fit is None:
        return ""
    name = escape(result.test.name)
    shown = [
        (draw_modal_fit(fit, output=strongest_output(fit)), "fit", "response and fit",
         "Frequency response and modal fit"),
    ]  # fmt: skip
    if fit.stabilisation is not None:
        plot = draw_stabilisation(fit)
        shown.append((plot, "stabilisation", "stabilisation", "Stabilisation diagram"))
    return row_of(
        drawn(plot, f"{key}-{kind}", f"{result.test.name}: {title}", f"{words}, test {name}.")
        for plot, kind, title, words in shown
    )


def _standing(result: TestResult, key: str) -> str:
    details = result.details
    if "hold" in details:
        plot = draw_hold(details["values"], details["hold"], details["allan"])
    elif "staircase" in details:
        time = details["time"]
        rate = (time.size - 1) / float(time[-1] - time[0])
        plot = draw_staircase(details["along"], rate, details["staircase"])
    else:
        return ""
    kind = "Reading while held" if "hold" in details else "Staircase of small steps"
    name = f"test {result.test.name}"
    return row_of([drawn(plot, key, name, f"{kind}, {escape(name)}.")])


def _records(result: MeasurementComparison, words: list[str]) -> str:
    sources = result.found.sources.items()
    return bullets(words) + definitions((name, f"SHA-256 {digest}") for name, digest in sources)
