"""Measurements, as a page or as a section of the report of a study; ISO 230-2."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from flexstage.base.version import __version__
from flexstage.experiments.campaign.results import TestResult
from flexstage.files.cache.memory import Memory
from flexstage.measure.motion.positioning import Positioning
from flexstage.quantities.characteristic import shown_units
from flexstage.quantities.quantity import Quantity, display, number, value_and_uncertainty
from flexstage.quantities.table import (
    Bullets,
    Cell,
    Column,
    Content,
    Definitions,
    Picture,
    Pictures,
    Section,
    Table,
    table,
)
from flexstage.quantities.units import readable
from flexstage.report.page import page_html
from flexstage.report.tables import column_group, column_title
from flexstage.studies.measurement import MeasuredRow, MeasurementComparison

#: Figures of an axis: symbol, name, field for both directions; upward and downward have suffixes.
_AXIS: tuple[tuple[str, str, str], ...] = (
    ("A", "accuracy", "accuracy"),
    ("R", "repeatability", "repeatability"),
    ("E", "systematic deviation", "systematic"),
    ("M", "mean bidirectional deviation", "mean_deviation"),
    ("B", "reversal value", "reversal"),
    ("B̄", "mean reversal value", "mean_reversal"),
    ("", "closure error of the turn", "closure"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PositioningTables:
    """The two tables of a test: figures of the axis, and values at the targets."""

    unit: str
    """Unit of all figures but the targets."""
    axis: Table
    """Figures of the axis."""
    targets: Table
    """Values at the targets."""


def positioning_tables(positioning: Positioning) -> PositioningTables:
    """Return the figures of an axis and of its targets, in unit and decimals of the accuracy."""
    # digits of A, one more than in tests of machines
    shown_digits = 5
    accuracy = abs(positioning.accuracy.value)
    (target_factor, target_unit), (factor, unit) = positioning.shown_units
    size = factor * accuracy
    digits = shown_digits - 1 - math.floor(math.log10(size)) if size > 0.0 else 0
    decimals = min(max(digits, 0), shown_digits - 1)  # the remainder of exact positions is rounding

    def text(value: float) -> str:
        return f"{factor * value:.{decimals}f}".replace("-", "−")

    def value_and_interval(name: str) -> tuple[str, ...]:
        estimate = getattr(positioning, name, None)
        if estimate is None:
            return "", ""
        return text(estimate.value), f"{float(f'{factor * estimate.expanded:.2g}'):g}"

    columns = (
        positioning.mean_upward,
        positioning.mean_downward,
        positioning.mean_bidirectional,
        positioning.reversal_at_targets,
        positioning.spread_upward,
        positioning.spread_downward,
        4.0 * positioning.spread_upward,
        4.0 * positioning.spread_downward,
        positioning.repeatability_at_targets,
    )
    pm = "± (95 %)"
    of_axis = (
        (
            symbol,
            label,
            *value_and_interval(f"{name}_upward"),
            *value_and_interval(f"{name}_downward"),
            *value_and_interval(name),
        )
        for symbol, label, name in _AXIS
        if name != "closure" or positioning.closure is not None
    )
    at_targets = (
        (f"{target_factor * at:.7g}".replace("-", "−"), *(text(float(v[i])) for v in columns))
        for i, at in enumerate(positioning.target)
    )
    heads = ("x̄ ↑", "x̄ ↓", "x̄", "B", "s ↑", "s ↓", "R ↑", "R ↓", "R")
    return PositioningTables(
        unit=unit,
        axis=table("", ("", "<ISO 230-2", "upward", pm, "downward", pm, "both", pm), of_axis),
        targets=table("", (f"target [{target_unit}]", *heads), at_targets),
    )


_MOTIONS = {
    "across": "motion across, in the plane",
    "vertical": "motion out of the plane",
    "roll": "roll",
    "pitch": "pitch",
    "yaw": "yaw",
}
_LABELS = ("Quantity", "<Axis")
_SPREAD = "±\u00a0(95\u00a0%)"


def measurement_text(result: MeasurementComparison, memory: Memory | None = None) -> str:
    """Return a self-contained page of a measurement."""
    return page_html(
        heading=result.title,
        lead=(
            f"{len(result.characterisation.results)} tests, {len(result.rows)} characteristics; "
            "95 % intervals"
        ),
        version=__version__,
        sections=_sections(result),
        notes=result.characterisation.notes,
        memory=memory,
    )


def measurement_section(result: MeasurementComparison, *further: Content) -> Section:
    """Return a measurement as one section of another page, with `further` content after it."""
    figures, *others = _sections(result)
    notes = "; ".join(result.characterisation.notes)
    return Section(
        title="",
        content=(*figures.content, *others, *further),
        notes=(notes,) if notes else (),
    )


def _sections(result: MeasurementComparison) -> Iterator[Section]:
    yield Section(key="figures", title="Characteristics", content=tuple(_figures(result)))
    chapters = (
        ("motion", "Motion over the stroke", _motion),
        ("positioning", "Positioning", _positioning),
        ("workspace", "Workspace", _workspace),
        ("response", "Frequency responses and modes", _response),
        ("standing", "Steps and noise", _standing),
    )
    for key, title, contents in chapters:
        content = tuple(part for r in result.characterisation.results for part in contents(r))
        if content:
            yield Section(key=key, title=title, content=content)
    yield Section(key="budgets", title="Uncertainty budgets", content=(_BUDGETS, _budgets(result)))
    words = [n for n in result.notes if n not in result.characterisation.notes]
    sources = {
        name: f"SHA-256 {digest}" for name, digest in result.characterisation.sources.items()
    }
    if words or sources:
        content = (Bullets(words), Definitions(sources))
        yield Section(key="records", title="Records", content=content)


def _figures(result: MeasurementComparison) -> Iterator[Content]:
    simulated = result.characterisation.origin == "virtual"
    # a simulated stage is generated from published values and random errors: it tests no model
    references = () if simulated else result.references
    here = "simulated measurement" if simulated else "measured here"
    heads = [Column("value", group=here), Column(_SPREAD, group=here)]
    if simulated:
        heads.append(Column("source", "words", here))
    for origin in references:
        heads.append(Column(column_title(origin), group=column_group(origin)))
    of = (c for row in result.rows for c in (row.figure, *row.references.values()))
    units = shown_units(of)
    rows = (
        _cells(row, references, units[row.figure.quantity], simulated=simulated)
        for row in result.rows
    )
    yield table("", (*_LABELS, *heads), rows, divided=True)
    if references:
        yield (
            "Small print: (measured − reference)/reference; * = larger than its 95 % uncertainty. "
            "A model or a publication that states no uncertainty counts as exact."
        )
    elif simulated:
        yield "Simulated, not measured: no value is compared with a model or a publication."


def _cells(
    row: MeasuredRow, origins: tuple[str, ...], quantity: Quantity, *, simulated: bool
) -> list[Cell | str]:
    estimate = row.figure.estimate
    value, spread = value_and_uncertainty(
        quantity.factor * estimate.value, quantity.factor * estimate.expanded
    )
    cells: list[Cell | str] = [
        quantity.heading,
        row.figure.axis,
        Cell(value, note=estimate.note, mark="ours", failing=row.figure.failing),
        Cell(spread, mark="ours"),
    ]
    if simulated:
        cells.append(row.source)
    for origin in origins:
        other, difference = row.references.get(origin), row.differences.get(origin)
        if other is None or difference is None:
            cells.append("–")
        else:
            cells.append(Cell(other.text(quantity), note=other.note, small=_difference(difference)))
    return cells


def _difference(difference: Any) -> str:
    # relative to a value near zero a percentage has no meaning
    if difference.percent is None or abs(difference.percent) > 1e4:
        return "*" if difference.significant else ""
    mark = " *" if difference.significant else ""
    return f"{difference.percent:+.2f} %{mark}"


_BUDGETS = (
    "Standard uncertainty u, its degrees of freedom, and the share of each contribution in the "
    "variance [%]."
)


def _budgets(result: MeasurementComparison) -> Table:
    names = list(
        dict.fromkeys(c.name for row in result.rows for c in row.figure.estimate.components)
    )
    rows = []
    units = shown_units(row.figure for row in result.rows)
    for row in result.rows:
        estimate = row.figure.estimate
        quantity = units[row.figure.quantity]
        contributions: dict[str, float] = {}
        for c in estimate.components:
            contributions[c.name] = (contributions.get(c.name, 0.0) ** 2 + c.uncertainty**2) ** 0.5
        u = estimate.uncertainty
        shares = (
            f"{100.0 * (contributions[n] / u) ** 2:.0f}" if u > 0.0 and n in contributions else ""
            for n in names
        )
        nu = estimate.degrees_of_freedom
        freedom = "∞" if nu > 1e4 else f"{nu:.0f}"
        label = (quantity.heading, row.figure.axis)
        rows.append((*label, number(quantity.factor * u, 2), freedom, *shares))
    return table("", (*_LABELS, "u", "degrees of freedom", *(Column(name) for name in names)), rows)


def stroke_ranges(result: TestResult) -> Table | None:
    """Return the stroke over each range of the command; None for fewer than two ranges."""
    ranges = result.details.get("ranges", ())
    if len(ranges) < 2:
        return None
    quantity = display("output_displacement").fitting(ranges[0].stroke.value)
    rows = []
    for stroke_range in ranges:
        basis, size = stroke_range.curve.basis, stroke_range.stroke
        ends = readable(stroke_range.curve.position_unit, basis.low, basis.high)
        length = value_and_uncertainty(
            quantity.factor * size.value, quantity.factor * size.expanded
        )
        rows.append((ends, stroke_range.of_cycles.size, *length))
    title = f"{result.test.name}, axis {result.test.axis}: stroke by range of the command"
    return table(title, ("command", "cycles", f"stroke [{quantity.shown_unit}]", _SPREAD), rows)


def _motion(result: TestResult) -> Iterator[Content]:
    curves = result.details.get("curves")
    if curves is None:
        return
    if (ranges := stroke_ranges(result)) is not None:
        yield ranges
    axis = result.test.axis
    band = f", test {result.test.name}, with 95 % band (statistical)"
    # all share the legend of the first
    pictures = [
        Picture(
            result=result.details["stroke"].curve,
            title=f"{axis}: deviation from the least-squares line",
            caption=f"{axis}: deviation from the least-squares line{band}.",
            options={
                "title": f"{axis}: deviation from the line",
                "position_label": "command",
                "label": "deviation from the line",
            },
        )
    ]
    for name, curve in curves.items():
        turning = curve.unit == "rad"
        words = f"{axis}: {_MOTIONS[name]}"
        options = {
            "title": words,
            "position_label": f"position {axis}",
            "label": "rotation" if turning else "deviation from the line",
            "line": "none" if turning else "least_squares",
            "legend": False,
        }
        pictures.append(
            Picture(result=curve, title=words, caption=f"{words}{band}.", options=options)
        )
    yield Pictures(pictures=tuple(pictures), columns=2)


def _positioning(result: TestResult) -> Iterator[Content]:
    positioning = result.details.get("positioning")
    if positioning is None:
        return
    tables = positioning_tables(positioning)
    name = result.test.name
    yield f"Test {name}: {positioning.runs} runs upward and downward; values in {tables.unit}."
    picture = Picture(
        result=positioning,
        title=name,
        caption=f"Positioning test by ISO 230-2, test {name}.",
        options={"title": f"{result.test.axis}: ISO 230-2"},
    )
    yield Pictures(pictures=(picture,))
    yield tables.axis
    yield tables.targets


def _workspace(result: TestResult) -> Iterator[Content]:
    workspace = result.details.get("workspace")
    if workspace is not None:
        words = f"Workspace, test {result.test.name}; the ± in its title is statistical."
        picture = Picture(result=workspace, title="workspace", caption=words)
        yield Pictures(pictures=(picture,), columns=2)


def _response(result: TestResult) -> Iterator[Content]:
    fit = result.details.get("fit")
    if fit is None:
        return
    name = result.test.name
    pictures = [
        Picture(
            result=fit,
            title=f"{name}: response and fit",
            caption=f"Frequency response and modal fit, test {name}.",
            options={"output": None},
        )
    ]
    if fit.stabilisation is not None:
        pictures.append(
            Picture(
                result=fit,
                view="stabilisation",
                title=f"{name}: stabilisation",
                caption=f"Stabilisation diagram, test {name}.",
            )
        )
    yield Pictures(pictures=tuple(pictures))


def _standing(result: TestResult) -> Iterator[Content]:
    details = result.details
    if "hold" in details:
        kind, result_shown = "Reading at a constant command", details["hold"]
        options = {"values": details["values"], "allan": details["allan"]}
    elif "staircase" in details:
        kind, result_shown = "Staircase of small steps", details["staircase"]
        time = details["time"]
        rate = (time.size - 1) / float(time[-1] - time[0])
        options = {"values": details["along"], "sample_rate_hz": rate}
    else:
        return
    name = f"test {result.test.name}"
    picture = Picture(result=result_shown, title=name, caption=f"{kind}, {name}.", options=options)
    yield Pictures(pictures=(picture,))
