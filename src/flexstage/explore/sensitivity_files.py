"""Sensitivities as plain data and as a table of numbers, in SI units with all digits."""

import csv
import io
from typing import Any

import numpy as np

from flexstage.explore.sensitivity import Sensitivities
from flexstage.explore.variables import Variable
from flexstage.files.plain import picked, plain
from flexstage.units import DIMENSIONS


def sensitivity_results(found: Sensitivities, length: float | None = None) -> dict[str, Any]:
    """Return sensitivities as plain data: slopes, parts, and changes by the steps of a table."""
    slopes, parts, changes = found.slopes.T, found.elasticities.T, found.changes(length).T
    steps = found.steps(length)
    return {
        **picked(found, "stage", "model"),
        "figures": [
            {**picked(f, "name", "quantity", "axis"), "value": plain(v), "unit": f.shown.unit}
            for f, v in zip(found.figures, found.values, strict=True)
        ],
        "parameters": [
            {
                "name": variable.name,
                "alike": list(found.alike[k]),
                "value": variable.usual,
                "unit": _unit(variable),
                "slopes": plain(slopes[k]),
                "elasticities": plain(parts[k]),
                "step": plain(steps[k]),
                "changes": plain(changes[k]),
            }
            for k, variable in enumerate(found.variables)
        ],
        "left_out": found.left_out,
        "provenance": plain(found.provenance),
    }


def sensitivity_csv(found: Sensitivities) -> str:
    """Return a line for each parameter: its value, the slope of each figure, and its part."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    slopes = [f"d {f.name} [{f.shown.unit}] / d parameter" for f in found.figures]
    parts = [f"d ln {f.name} / d ln parameter" for f in found.figures]
    lines.writerow(["parameter", "value", "unit", *slopes, *parts])
    for k, variable in enumerate(found.variables):
        numbers = np.concatenate((found.slopes[:, k], found.elasticities[:, k]))
        cells = [repr(float(v)) if np.isfinite(v) else "" for v in numbers]
        for name in found.alike[k]:
            lines.writerow([name, repr(variable.usual), _unit(variable), *cells])
    return out.getvalue()


def _unit(variable: Variable) -> str:
    return DIMENSIONS[variable.dimension].si if variable.dimension else "1"
