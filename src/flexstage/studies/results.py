"""Parts of a study as plain data; `results.schema.json` describes `results.json`."""

from collections.abc import Iterable
from typing import Any

from flexstage.files.plain import json_text, picked, plain
from flexstage.quantities.characteristic import Characteristic, fitted_to, kind_of
from flexstage.system import Analysis, Modes, load_readings
from flexstage.system.coupled_axes import CoupledAxes


def characteristic_row(
    row: Characteristic, published: Iterable[Characteristic] = ()
) -> dict[str, Any]:
    """Return a characteristic as a row of the table, with its kind and the violated criterion.

    It names the origins of the published figures that it was fitted to.
    """
    published = tuple(published)
    fields = ("quantity", "axis", "origin", "value", "unit", "uncertainty", "note", "failing")
    kind = {"kind": kind_of(row, published), "fitted_to": list(fitted_to(row, published))}
    return picked(row, *fields) | kind


def analysis_results(analysis: Analysis, *, responses: bool = False) -> dict[str, Any]:
    """Return an analysis as plain data; SI units, frequencies in Hz.

    It has the motion of the probes under a unit of each load on the stage [m]; with `responses`
    also the frequency responses.
    """
    readings = load_readings(analysis.system) if _is_constrained(analysis) else {}
    out: dict[str, Any] = {
        "model": analysis.system.model,
        "characteristics": [
            characteristic_row(row, analysis.stage.published) for row in analysis.characteristics
        ],
        "modes": {condition: _mode_rows(modes) for condition, modes in analysis.modes.items()},
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


def _mode_rows(modes: Modes) -> list[dict[str, Any]]:
    """Return modes as plain data, with the estimated error of each frequency, if known."""
    rows = [
        {"natural_frequency_hz": plain(f), "damping_ratio": plain(zeta)}
        for f, zeta in zip(modes.frequency_hz, modes.damping_ratio, strict=True)
    ]
    if modes.uncertainty_hz is not None:
        for row, u in zip(rows, modes.uncertainty_hz, strict=True):
            row["uncertainty_hz"] = plain(u)
    return rows


def coupling_results(coupling: CoupledAxes) -> dict[str, Any]:
    """Return the coupling of drives and axes as plain data, in SI units.

    Rows of the Jacobian are axes and its columns drives. The decoupling matrix, with rows for
    drives, is None if the drives cannot move one axis alone.
    """
    workspace = coupling.workspace
    return {
        **picked(
            coupling,
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
        "decoupling": plain(coupling.decoupling) if coupling.independent else None,
        "workspace": None
        if workspace is None
        else {
            **picked(workspace, "axes", "middle", "area", "projected_area", "volume"),
            "outline": plain(workspace.section()),
            "projection": plain(workspace.projection),
        },
    }


def results_json(results: dict[str, Any]) -> bytes:
    """Write plain data, such as `Study.to_dict` gives, as indented JSON in UTF-8."""
    return json_text(results).encode()


def _is_constrained(analysis: Analysis) -> bool:
    """Return whether the stage has no rigid-body mode, so that static loads have a solution."""
    f = analysis.modes["removed"].frequency_hz
    return bool(f.size) and float(f[0]) > 1e-6 * float(f.max())
