"""What `flexstage characterise` prints for people."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.cli.output import print_notes, print_shown, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.experiments.campaign.results import TestResult
    from flexstage.studies import MeasurementComparison


def print_measurement(
    screen: "Console", result: "MeasurementComparison", saved: list[Path]
) -> None:
    """Print figures, tests of positioning, notes, and the files that were written."""
    from flexstage.quantities.characteristic import shown_units
    from flexstage.quantities.quantity import value_and_uncertainty
    from flexstage.quantities.table import Column
    from flexstage.report.measurement import stroke_ranges
    from flexstage.report.tables import column_title

    columns = list(result.references)
    groups = {c: "published" for c in columns if c.startswith("published")}
    kept = ("published-measured", *columns[-1:])
    titles = [Column(column_title(c), "figures", groups.get(c, ""), c not in kept) for c in columns]
    rows = []
    units = shown_units(row.figure for row in result.rows)
    for row in result.rows:
        shown = units[row.figure.quantity]
        estimate = row.figure.estimate
        cells = [
            *value_and_uncertainty(estimate.value * shown.factor, estimate.expanded * shown.factor),
            shown.shown_unit,
        ]
        for name in columns:
            found = row.differences.get(name)
            cells.append("" if found is None else _difference(found))
        label = f"{shown.label}, assumed" if row.assumed else shown.label
        rows.append((label, row.figure.axis, *cells))
    heads = "quantity", "<axis", "value", "± (95 %)", "<unit"
    print_table(screen, result.title, (*heads, *titles), rows)
    if columns:
        screen.print(
            "Differences of what was measured to each model and publication; * significant at 95 %."
        )
    for measured in result.characterisation.results:
        if (ranges := stroke_ranges(measured)) is not None:
            print_shown(screen, ranges)
        if "positioning" in measured.details:
            _print_positioning(screen, measured)
    print_notes(screen, result.notes, saved)


def _print_positioning(screen: "Console", result: "TestResult") -> None:
    from flexstage.report.measurement import positioning_tables

    tables = positioning_tables(result.details["positioning"])
    title = f"{result.test.name}, axis {result.test.axis}: ISO 230-2, values in {tables.unit}"
    for found in (tables.axis, tables.targets):
        print_table(screen, title, found.columns, found.rows)
        title = ""


def _difference(found: Any) -> str:
    mark = "*" if found.significant else ""
    # against something near nothing a percentage says nothing
    if found.percent is None or abs(found.percent) > 1e4:
        return f"–{mark}"
    return f"{found.percent:+.2f} %{mark}".replace("-", "−")
