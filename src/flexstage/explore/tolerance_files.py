"""What the workshop makes of a stage as plain data and as a table of samples: SI units."""

import csv
import io
from typing import Any

import numpy as np

from flexstage.explore.deviations import KINDS
from flexstage.explore.spread import Shares, Spread, Yield
from flexstage.explore.tolerance import ToleranceStudy
from flexstage.explore.tolerance_choice import ToleranceChoice
from flexstage.files.plain import picked, plain


def tolerance_results(
    study: ToleranceStudy, choice: ToleranceChoice | None = None
) -> dict[str, Any]:
    """Return a lot as plain data: spreads, shares, yields, and the tolerances that were chosen."""
    found = {
        **picked(study, "stage=stage.name", "samples", "seed=lot.seed", "model"),
        "scatter": picked(study.scatter, *(kind.name for kind in KINDS)),
        "figures": [_spread(spread) for spread in study.spreads],
        "variance": [_shares(of) for of in study.shares],
        "yields": [_yield(y) for y in study.yields],
        **picked(study, "notes", "provenance"),
    }
    if choice is not None:
        found["tighten"] = {
            **picked(choice, "target", "reached", "verdict", "cost"),
            "scatter": picked(choice.chosen, *choice.kinds),
            "yields": [_yield(y) for y in choice.after],
        }
    return found


def samples_csv(study: ToleranceStudy) -> bytes:
    """Return the figures of every sample, a line each; nothing where it has none.

    Headings have the SI unit in brackets; numbers have the digits that give back the same bits.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow([f"{f.name} [{f.shown.unit}]" for f in study.lot.figures])
    for row, known in zip(study.values.tolist(), np.isfinite(study.values).tolist(), strict=True):
        rows.writerow([repr(v) if is_one else "" for v, is_one in zip(row, known, strict=True)])
    return text.getvalue().encode()


def _spread(spread: Spread) -> dict[str, Any]:
    return {
        **picked(spread, "name=figure.name", "quantity=figure.quantity", "axis=figure.axis"),
        **picked(spread, "unit=figure.shown.unit", "nominal", "mean", "standard_deviation"),
        **picked(spread, "count", "apart", "percentiles"),
        "histogram": picked(spread, "edges", "counts"),
    }


def _shares(of: Shares) -> dict[str, Any]:
    return {
        **picked(of, "figure=figure.name", "explained"),
        "contributions": [
            {**picked(c, "kind", "share", "slope"), "largest": plain(dict(c.largest))}
            for c in of.contributions
        ],
    }


def _yield(found: Yield) -> dict[str, Any]:
    required = found.requirement
    return {
        "required": "all" if required is None else required.text,
        **picked(found, "met", "count", "share", "low", "high"),
    }
