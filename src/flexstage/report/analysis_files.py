"""The files of an analysis: its figures as plain data, and its diagrams."""

from collections.abc import Mapping
from typing import Any

from flexstage.files.names import file_names
from flexstage.report.figures.body_motion import draw_reachable_area
from flexstage.report.figures.responses import draw_bode
from flexstage.report.figures.style import encode
from flexstage.studies.results import results_json
from flexstage.system import Analysis


def analysis_files(analysis: Analysis, results: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of what one model found, by name; `results` are those of its `ModelRun`."""
    files = {"analysis.json": results_json(dict(results))} | bode_files(analysis)
    reached = None if analysis.coupling is None else analysis.coupling.workspace
    if reached is not None:
        files["workspace.svg"] = encode(draw_reachable_area(reached), "svg")
    return files


def bode_files(analysis: Analysis, stem: str = "bode", kind: str = "svg") -> dict[str, bytes]:
    """Return a Bode diagram of each axis, by the name of its file."""
    names = file_names([a.axis for a in analysis.axes])
    return {
        f"{stem}-{name}.{kind}": encode(draw_bode(analysis, a.axis), kind.lower())
        for name, a in zip(names, analysis.axes, strict=True)
    }
