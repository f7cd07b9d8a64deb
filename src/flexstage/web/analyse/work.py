"""What the view Analyse has computed: by the library, each model in a process of its own."""

import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexstage.base import progress
from flexstage.files.names import file_name
from flexstage.files.write import write_files
from flexstage.report.figures.fields import draw_convergence
from flexstage.report.figures.surface import StageSurface, stage_surface
from flexstage.report.result_files import analysis_files
from flexstage.studies.models import run_models
from flexstage.studies.requests import AnalyseRequest, ModelOptions
from flexstage.system import Analysis, FrequencyResponse
from flexstage.system.modes import modes
from flexstage.system.response import default_frequencies_hz, response_of_modes
from flexstage.web.design.state import Variant
from flexstage.web.pictures import inline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysed:
    """What one model found of a stage; the mesh behind it stays where it was made."""

    variant: Variant
    """The stage."""
    options: ModelOptions
    """What was asked for."""
    analysis: Analysis
    """What it says of the stage."""
    results: Mapping[str, Any]
    """All of it as plain data, as `flexstage analyse --json` prints it."""
    surface: StageSurface
    """The stage with its states, for pictures."""
    responses: tuple[FrequencyResponse, ...]
    """Response of each probe to each drive, drives removed and in place."""
    convergence: str
    """How its mesh was refined, as a picture for a page; empty where it was not."""
    fields: Path | None
    """Folder with its fields for ParaView; None where they were not asked for."""
    seconds: float
    """How long it took [s]."""

    @property
    def model(self) -> str:
        """The model."""
        return self.analysis.system.model


def analysed(
    variant: Variant, model: str, options: ModelOptions, fields: Path | None = None
) -> Analysed:
    """Analyse a variant by one model; write fields of its mesh into a folder, if one is given."""
    began = time.monotonic()
    with progress.subtask(0.0, 0.85):
        request = AnalyseRequest(model=(model,), options=options)  # type: ignore[arg-type]
        found = run_models(variant.stage(), request)
    (run,) = found.runs.values()
    analysis, refinement = run.analysis, run.refinement
    with progress.subtask(0.85, 0.95):
        surface = stage_surface(analysis, run.mesh)
    drawn = ""
    if refinement is not None:
        said = f"Convergence of the {model} model"
        drawn = inline(lambda: draw_convergence(refinement), f"convergence-{model}", said)
    progress.update("responses", 0.95)
    responses = tuple(every_response(analysis))
    if fields is not None and run.mesh is not None:
        from flexstage.export import field_files

        progress.update("fields", 0.97)
        write_files(fields, field_files(analysis.stage, analysis, mesh=run.mesh))
    return Analysed(
        variant=variant,
        options=options,
        analysis=analysis,
        results=found.to_dict(),
        surface=surface,
        responses=responses,
        convergence=drawn,
        fields=None if run.mesh is None else fields,
        seconds=time.monotonic() - began,
    )


def every_response(analysis: Analysis) -> Iterator[FrequencyResponse]:
    """Return the response of each probe to each drive, at the frequencies of the analysis."""
    system = analysis.system
    for condition, shown in analysis.modes.items():
        if condition == "locked" or not system.drives:
            continue
        every, f = modes(system, drives=condition, count=None), default_frequencies_hz(shown)
        for drive in system.drives:
            for probe in system.probes:
                yield response_of_modes(system, every, f, drive.name, probe.name)


def saved(folder: Path, found: Sequence[Analysed]) -> Path:
    """Write the files of some analyses of one stage as one archive (ZIP), a folder for each model.

    Returns its path.
    """
    path = folder / f"{file_name(found[0].analysis.stage.name)}-analysis.zip"
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for done, one in enumerate(found):
            progress.update(one.model, done / len(found))
            for name, content in analysis_files(one.analysis, one.results).items():
                archive.writestr(zipfile.ZipInfo(f"{one.model}/{name}"), content)
            for file in sorted(one.fields.iterdir()) if one.fields else ():
                archive.write(file, f"{one.model}/vtu/{file.name}")
    return path
