"""A study as plain data: what `results.json` holds."""

import json
import math
from typing import Any

from flexstage.characteristic import Characteristic
from flexstage.report.study import Study
from flexstage.system import Analysis

__all__ = ["analysis_results", "characteristic_row", "results_json", "study_results"]


def characteristic_row(row: Characteristic) -> dict[str, Any]:
    """Return a characteristic as a row of the tidy table.

    Parameters
    ----------
    row : Characteristic
        The characteristic.

    Returns
    -------
    dict
        quantity, axis, origin, value, unit, uncertainty, note.
    """
    return {
        "quantity": row.quantity,
        "axis": row.axis,
        "origin": row.origin,
        "value": _finite(row.value),
        "unit": row.unit,
        "uncertainty": _finite(row.uncertainty),
        "note": row.note,
    }


def analysis_results(analysis: Analysis, *, responses: bool = False) -> dict[str, Any]:
    """Return an analysis as plain data.

    Parameters
    ----------
    analysis : Analysis
        The analysis.
    responses : bool
        Whether to give the frequency responses as well, which are long.

    Returns
    -------
    dict
        model, characteristics, modes by condition of the drives, stress by axis and hinge,
        validity, provenance; SI units, frequencies in Hz.
    """
    origin = analysis.provenance
    out: dict[str, Any] = {
        "model": analysis.system.model,
        "characteristics": [characteristic_row(row) for row in analysis.characteristics],
        "modes": {
            condition: [
                {"natural_frequency_hz": _finite(f), "damping_ratio": _finite(zeta)}
                for f, zeta in zip(found.frequency_hz, found.damping_ratio, strict=True)
            ]
            for condition, found in analysis.modes.items()
        },
        "hinge_stress": {
            axis: {hinge: _finite(value) for hinge, value in stress.items()}
            for axis, stress in analysis.hinge_stress.items()
        },
        "validity": list(analysis.validity),
        "provenance": {
            "version": origin.version,
            "input_hash": origin.input_hash,
            "created": origin.created,
            "settings": dict(origin.settings),
            "python": origin.python,
            "machine": origin.machine,
        },
    }
    if responses:
        out["responses"] = [
            {
                "drive": response.drive,
                "probe": response.probe,
                "drives": response.drives,
                "input": response.input_kind,
                "unit": response.unit,
                "frequency_hz": [_finite(f) for f in response.frequency_hz],
                "real": [_finite(value.real) for value in response.value],
                "imaginary": [_finite(value.imag) for value in response.value],
            }
            for response in analysis.responses
        ]
    return out


def study_results(study: Study) -> dict[str, Any]:
    """Return a study as plain data.

    Parameters
    ----------
    study : Study
        The study.

    Returns
    -------
    dict
        The tidy table of characteristics, and each model's modes, stress, validity, provenance.
    """
    stage = study.stage
    return {
        "stage": {"name": stage.name, "title": stage.title, "notes": list(stage.notes)},
        "characteristics": [characteristic_row(row) for row in study.characteristics],
        "models": {name: _without_table(a) for name, a in study.analyses.items()},
        "variants": {name: analysis_results(a) for name, a in study.variants.items()},
    }


def results_json(results: dict[str, Any]) -> bytes:
    """Write plain data as JSON.

    Parameters
    ----------
    results : dict
        What `study_results` or `analysis_results` gives.

    Returns
    -------
    bytes
        Indented, UTF-8.
    """
    text = json.dumps(results, indent=2, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def _without_table(analysis: Analysis) -> dict[str, Any]:
    """All of an analysis but its characteristics, which stand in the table of the study."""
    results = analysis_results(analysis)
    del results["characteristics"]
    return results


def _finite(value: float | None) -> float | None:
    """JSON knows no infinity."""
    return None if value is None or not math.isfinite(value) else float(value)
