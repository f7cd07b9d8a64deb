"""What was measured: a page of its own, or a section of the report of a study; ISO 230-2."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from flexstage.base.version import __version__
from flexstage.experiments.campaign.results import TestResult
from flexstage.files.cache.memory import Memory
from flexstage.measure.motion.positioning import Positioning
from flexstage.quantities.characteristic import shown_units
from flexstage.quantities.quantity import Quantity, display, number, prefixed, value_and_uncertainty
from flexstage.quantities.section import Bullets, Content, Definitions, Picture, Pictures, Section
from flexstage.quantities.table import Cell, Column, Table, table
from flexstage.quantities.units import readable
from flexstage.report.page import page_html
from flexstage.report.tables import column_title
from flexstage.studies.measurement import MeasuredRow, MeasurementComparison

#: Figures of an axis: symbol, name, field of both directions; upward and downward have suffixes.
_AXIS: tuple[tuple[str, str, str], ...] = (
    ("A", "accuracy", "accuracy"),
    ("R", "repeatability", "repeatability"),
    ("E", "systematic deviation", "systematic"),
    ("M", "mean bidirectional deviation", "mean_deviation"),
    ("B", "reversal value", "reversal"),
    ("B̄", "mean reversal value", "mean_reversal"),
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


def positioning_tables(found: Positioning) -> PositioningTables:
    """Write the figures of an axis and of its targets, in unit and decimals of the accuracy."""
    # digits of A that are shown, which is one more than machines are tested to
    shown_digits = 5
    accuracy = abs(found.accuracy.value)
    factor, prefix = prefixed(accuracy)
    shown = factor * accuracy
    digits = shown_digits - 1 - math.floor(math.log10(shown)) if shown > 0.0 else 0
    decimals = min(max(digits, 0), shown_digits - 1)  # of exact positions what is left is rounding

    def text(value: float) -> str:
        return f"{factor * value:.{decimals}f}".replace("-", "−")

    def given(name: str) -> tuple[str, ...]:
        estimate = getattr(found, name, None)
        if estimate is None:
            return "", ""
        return text(estimate.value), f"{float(f'{factor * estimate.expanded:.2g}'):g}"

    across, of_target = prefixed(float(abs(found.target).max()))
    columns = (
        found.mean_upward, found.mean_downward, found.mean_bidirectional, found.reversal_at_targets,
        found.spread_upward, found.spread_downward, 4.0 * found.spread_upward,
        4.0 * found.spread_downward, found.repeatability_at_targets,
    )  # fmt: skip
    pm = "± (95 %)"
    of_axis = (
        (symbol, label, *given(f"{name}_upward"), *given(f"{name}_downward"), *given(name))
        for symbol, label, name in _AXIS
    )
    at_targets = (
        (f"{across * at:.7g}".replace("-", "−"), *(text(float(v[i])) for v in columns))
        for i, at in enumerate(found.target)
    )
    heads = ("x̄ ↑", "x̄ ↓", "x̄", "B", "s ↑", "s ↓", "R ↑", "R ↓", "R")
    return PositioningTables(
        unit=f"{prefix}m",
        axis=table("", ("", "<ISO 230-2", "upward", pm, "downward", pm, "both", pm), of_axis),
        targets=table("", (f"target [{of_target}m]", *heads), at_targets),
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
    """Return a page of what was measured, which needs nothing else."""
    return page_html(
        heading=result.title,
        lead=(
            f"{len(result.characterisation.results)} tests, {len(result.rows)} figures; intervals "
            "are those of 95 %"
        ),
        version=__version__,
        sections=_sections(result),
        notes=result.characterisation.notes,
        memory=memory,
    )


def measurement_section(result: MeasurementComparison, *further: Content) -> Section:
    """Return what was measured as one section of another page, with more behind its figures."""
    figures, *others = _sections(result)
    notes = "; ".join(result.characterisation.notes)
    return Section(
        title="",
        content=(*figures.content, *others, *further),
        notes=(notes,) if notes else (),
    )


def _sections(result: MeasurementComparison) -> Iterator[Section]:
    yield Section(key="figures", title="Figures", content=tuple(_figures(result)))
    named = (
        ("motion", "Motion over the stroke", _motion),
        ("positioning", "Positioning", _positioning),
        ("workspace", "Workspace", _workspace),
        ("response", "Frequency responses and modes", _response),
        ("standing", "Steps and noise", _standing),
    )
    for key, title, show in named:
        content = tuple(part for r in result.characterisation.results for part in show(r))
        if content:
            yield Section(key=key, title=title, content=content)
    yield Section(
        key="budgets", title="Budgets of uncertainty", content=(_BUDGETS, _budgets(result))
    )
    words = [n for n in result.notes if n not in result.characterisation.notes]
    sources = {
        name: f"SHA-256 {digest}" for name, digest in result.characterisation.sources.items()
    }
    if words or sources:
        content = (Bullets(words), Definitions(sources))
        yield Section(key="records", title="Records", content=content)


def _figures(result: MeasurementComparison) -> Iterator[Content]:
    simulated = result.characterisation.origin == "virtual"
    # a simulated stage is made from published values and random errors: it tests no model
    references = () if simulated else result.references
    here = "simulated measurement" if simulated else "measured here"
    heads = [Column("value", group=here), Column(_SPREAD, group=here)]
    for origin in references:
        group = "published" if origin.startswith("published") else "computed here"
        heads.append(Column(column_title(origin), group=group))
    of = (c for row in result.rows for c in (row.figure, *row.references.values()))
    units = shown_units(of)
    rows = (_cells(row, references, units[row.figure.quantity]) for row in result.rows)
    yield table("", (*_LABELS, *heads), rows, divided=True)
    if references:
        yield (
            "Small print: (measured − reference)/reference; * = larger than its 95 % uncertainty. "
            "A model or a publication that states no uncertainty counts as exact."
        )
    elif simulated:
        yield "Simulated, not measured: no figure is compared with a model or a publication."


def _cells(row: MeasuredRow, origins: tuple[str, ...], shown: Quantity) -> list[Cell | str]:
    estimate = row.figure.estimate
    value, spread = value_and_uncertainty(
        shown.factor * estimate.value, shown.factor * estimate.expanded
    )
    cells: list[Cell | str] = [
        f"{shown.heading}, assumed" if row.assumed else shown.heading,
        row.figure.axis,
        Cell(value, note=estimate.note, mark="ours", failing=row.figure.failing),
        Cell(spread, mark="ours"),
    ]
    for origin in origins:
        other, found = row.references.get(origin), row.differences.get(origin)
        if other is None or found is None:
            cells.append("–")
        else:
            cells.append(Cell(other.text(shown), note=other.note, small=_difference(found)))
    return cells


def _difference(found: Any) -> str:
    # against something near nothing a percentage says nothing
    if found.percent is None or abs(found.percent) > 1e4:
        return "*" if found.significant else ""
    mark = " *" if found.significant else ""
    return f"{found.percent:+.2f} %{mark}"


_BUDGETS = (
    "Standard uncertainty, its degrees of freedom, and the share of each contribution in its "
    "square [%]."
)


def _budgets(result: MeasurementComparison) -> Table:
    names = list(
        dict.fromkeys(c.name for row in result.rows for c in row.figure.estimate.components)
    )
    rows = []
    units = shown_units(row.figure for row in result.rows)
    for row in result.rows:
        estimate = row.figure.estimate
        shown = units[row.figure.quantity]
        own: dict[str, float] = {}
        for c in estimate.components:
            own[c.name] = (own.get(c.name, 0.0) ** 2 + c.uncertainty**2) ** 0.5
        u = estimate.uncertainty
        shares = (f"{100.0 * (own[n] / u) ** 2:.0f}" if u > 0.0 and n in own else "" for n in names)
        nu = estimate.degrees_of_freedom
        freedom = "∞" if nu > 1e4 else f"{nu:.0f}"
        label = (shown.heading, row.figure.axis)
        rows.append((*label, number(shown.factor * u, 2), freedom, *shares))
    return table("", (*_LABELS, "u", "degrees", *(Column(name) for name in names)), rows)


def stroke_ranges(result: TestResult) -> Table | None:
    """Return the stroke over each range of the command; None where it has one range, or none."""
    ranges = result.details.get("ranges", ())
    if len(ranges) < 2:
        return None
    shown = display("output_displacement").fitting(ranges[0].stroke.value)
    rows = []
    for one in ranges:
        basis, size = one.curve.basis, one.stroke
        ends = readable(one.curve.position_unit, basis.low, basis.high)
        length = value_and_uncertainty(shown.factor * size.value, shown.factor * size.expanded)
        rows.append((ends, one.of_cycles.size, *length))
    title = f"{result.test.name}, axis {result.test.axis}: stroke by range of the command"
    return table(title, ("command", "cycles", f"stroke [{shown.shown_unit}]", _SPREAD), rows)


def _motion(result: TestResult) -> Iterator[Content]:
    curves = result.details.get("curves")
    if curves is None:
        return
    if (ranges := stroke_ranges(result)) is not None:
        yield ranges
    axis = result.test.axis
    band = f", test {result.test.name}, with 95 % band (statistical)"
    # the legend of the first serves all
    shown = [
        Picture(
            result=result.details["stroke"].curve,
            title=f"{axis}: position less its least-squares line",
            caption=f"{axis}: position less its least-squares line{band}.",
            options={
                "title": f"{axis}: position less its line",
                "position_label": "command",
                "label": "distance from the line",
            },
        )
    ]
    for name, curve in curves.items():
        turning = curve.unit == "rad"
        words = f"{axis}: {_MOTIONS[name]}"
        options = {
            "title": words,
            "position_label": f"position {axis}",
            "label": "rotation" if turning else "distance from the line",
            "line": "none" if turning else "least_squares",
            "legend": False,
        }
        shown.append(Picture(result=curve, title=words, caption=f"{words}{band}.", options=options))
    yield Pictures(pictures=tuple(shown), columns=2)


def _positioning(result: TestResult) -> Iterator[Content]:
    found = result.details.get("positioning")
    if found is None:
        return
    tables = positioning_tables(found)
    name = result.test.name
    yield f"Test {name}: {found.runs} runs upward and downward; values in {tables.unit}."
    shown = Picture(
        result=found,
        title=name,
        caption=f"Positioning by ISO 230-2, test {name}.",
        options={"title": f"{result.test.axis}: ISO 230-2"},
    )
    yield Pictures(pictures=(shown,))
    yield tables.axis
    yield tables.targets


def _workspace(result: TestResult) -> Iterator[Content]:
    found = result.details.get("workspace")
    if found is not None:
        words = f"Workspace, test {result.test.name}; ± of its title is statistical."
        shown = Picture(result=found, title="workspace", caption=words)
        yield Pictures(pictures=(shown,), columns=2)


def _response(result: TestResult) -> Iterator[Content]:
    fit = result.details.get("fit")
    if fit is None:
        return
    name = result.test.name
    shown = [
        Picture(
            result=fit,
            title=f"{name}: response and fit",
            caption=f"Frequency response and modal fit, test {name}.",
            options={"output": None},
        )
    ]
    if fit.stabilisation is not None:
        shown.append(
            Picture(
                result=fit,
                view="stabilisation",
                title=f"{name}: stabilisation",
                caption=f"Stabilisation diagram, test {name}.",
            )
        )
    yield Pictures(pictures=tuple(shown))


def _standing(result: TestResult) -> Iterator[Content]:
    details = result.details
    if "hold" in details:
        kind, shown = "Reading while held", details["hold"]
        options = {"values": details["values"], "allan": details["allan"]}
    elif "staircase" in details:
        kind, shown = "Staircase of small steps", details["staircase"]
        time = details["time"]
        rate = (time.size - 1) / float(time[-1] - time[0])
        options = {"values": details["along"], "sample_rate_hz": rate}
    else:
        return
    name = f"test {result.test.name}"
    picture = Picture(result=shown, title=name, caption=f"{kind}, {name}.", options=options)
    yield Pictures(pictures=(picture,))
