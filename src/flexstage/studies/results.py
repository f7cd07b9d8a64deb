"""Parts of a study as plain data: `results.schema.json` describes `results.json`, their whole."""

from typing import Any

from flexstage.files.plain import json_text, picked, plain
from flexstage.quantities.characteristic import Characteristic
from flexstage.system import Analysis, Modes, load_readings
from flexstage.system.coupled_axes import CoupledAxes


def characteristic_row(row: Characteristic) -> dict[str, Any]:
    """Return a characteristic as a row of the tidy table, with the criterion that it fails."""
    named = ("quantity", "axis", "origin", "value", "unit", "uncertainty", "note", "failing")
    return picked(row, *named)


def analysis_results(analysis: Analysis, *, responses: bool = False) -> dict[str, Any]:
    """Return an analysis as plain data; SI units, frequencies in Hz.

    With the motion of the probes under one unit of each load on the whole stage [m]; the frequency
    responses, which are long, where asked for.
    """
    readings = load_readings(analysis.system) if _is_held(analysis) else {}
    out: dict[str, Any] = {
        "model": analysis.system.model,
        "characteristics": [characteristic_row(row) for row in analysis.characteristics],
        "modes": {condition: _mode_rows(found) for condition, found in analysis.modes.items()},
        **picked(analysis, "hinge_stress"),
        "loads": {
            load.name: {"unit": load.unit, "readings": readings[load.name]}
            for load in analysis.system.loads
            if load.name in readings
        },
        **picked(analysis, "validity", "provenance"),
    }
    if analysis.coupling is not None:
        out["coupling"] = coupling_results(analysis.coupling)
    if responses:
        out["responses"] = [
            picked(
                response,
                "drive",
                "probe",
                "drives",
                "input=input_kind",
                "unit",
                "frequency_hz",
                "real=value.real",
                "imaginary=value.imag",
            )
            for response in analysis.responses
        ]
    return out


def _mode_rows(found: Modes) -> list[dict[str, Any]]:
    """Return modes as plain data, with the estimate of the error of each frequency if there is."""
    rows = [
        {"natural_frequency_hz": plain(f), "damping_ratio": plain(zeta)}
        for f, zeta in zip(found.frequency_hz, found.damping_ratio, strict=True)
    ]
    if found.uncertainty_hz is not None:
        for row, u in zip(rows, found.uncertainty_hz, strict=True):
            row["uncertainty_hz"] = plain(u)
    return rows


def coupling_results(found: CoupledAxes) -> dict[str, Any]:
    """Return what all drives do to all axes as plain data, in SI units.

    Rows of the Jacobian are axes and its columns drives; of the decoupling matrix, which is None
    where the drives cannot move one axis alone, it is the other way round.
    """
    reached = found.workspace
    return {
        **picked(
            found,
            "axes=names",
            "units",
            "drives",
            "strokes",
            "jacobian",
            "characteristic_length=length",
            "singular_values",
            "condition_number",
            "isotropy",
            "manipulability",
            "coupled",
        ),
        "decoupling": plain(found.decoupling) if found.independent else None,
        "workspace": None
        if reached is None
        else {
            **picked(reached, "axes", "middle", "area", "projected_area", "volume"),
            "outline": plain(reached.section()),
            "projection": plain(reached.projection),
        },
    }


def results_json(results: dict[str, Any]) -> bytes:
    """Write plain data, such as `Study.to_dict` gives, as indented JSON in UTF-8."""
    return json_text(results).encode()


def _is_held(analysis: Analysis) -> bool:
    """Tell whether every body resists motion, so that loads have a static answer."""
    f = analysis.modes["removed"].frequency_hz
    return bool(f.size) and float(f[0]) > 1e-6 * float(f.max())
