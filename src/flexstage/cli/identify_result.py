"""What `flexstage identify` finds, as data and for people."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexstage.cli.output import print_notes, print_shown
from flexstage.cli.predict import start_value
from flexstage.files.plain import picked

if TYPE_CHECKING:
    from rich.console import Console

    from flexstage.hysteresis.identification.identify import Identification
    from flexstage.records import Record


def identification_result(
    found: "Identification", read: "list[Record]", files: list[Path]
) -> dict[str, Any]:
    """Return an identification as plain data."""
    from flexstage.report.identification import chain_found, parameters_found

    return {
        "records": [r.source for r in read],
        **picked(
            found,
            "model=kind",
            "rms_percent",
            "max_percent",
            "heldout_rms_percent",
            "heldout_free_constant_rms_percent=heldout_free_rms_percent",
            "heldout_standard_error_percent=heldout_standard_error",
            "heldout_max_percent",
            "heldout_band_percent",
        ),
        "start": start_value(found.model.start),
        "settling": {"value": found.settling, "unit": found.model.output_unit},
        "noise_percent": found.noise_percent,
        "fitted": found.settings["fitted"],
        "stroke": {"value": found.stroke, "unit": found.model.output_unit},
        "parameters": parameters_found(found),
        "chain": chain_found(found),
        "candidates": [
            {
                **picked(c, "model=kind", "parameters=size", "rms_percent", "heldout_rms_percent"),
                "heldout_free_constant_rms_percent": c.heldout_free_rms_percent,
                "failed": c.failed or None,
            }
            for c in found.candidates
        ],
        **picked(found, "verdict", "warnings"),
        "notes": sorted({note for r in read for note in r.notes}),
        "files": [str(file) for file in files],
    }


def print_identification(
    screen: "Console", found: "Identification", result: dict[str, Any]
) -> None:
    """Print candidates, how well the best one fits, parameters, warnings and files."""
    from flexstage.report.identification import (
        candidates_table,
        failures,
        identification_in_words,
        parameters_table,
    )

    caption = f"{found.kind}: {', '.join(result['records'])}"
    print_shown(screen, candidates_table(found, caption))
    for failed in failures(found):
        screen.print(failed, style="yellow", markup=False)
    for line in identification_in_words(found):
        screen.print(line, markup=False)
    print_shown(screen, parameters_table(found))
    for warning in found.warnings:
        screen.print(f"warning: {warning}", style="yellow", markup=False)
    print_notes(screen, result["notes"], result["files"])
