"""Reports of the front panel: writing, listing and serving them."""

import base64
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexstage.base import progress
from flexstage.files.names import file_name
from flexstage.files.write import write_files

if TYPE_CHECKING:
    from flexstage.studies.requests import StudyRequest
    from flexstage.web.design.state import Variant

#: Files of a report, with their names in the page.
FILES: Mapping[str, str] = MappingProxyType(
    {
        "report.html": "Report",
        "virtual-measurement.html": "Simulated measurement",
        "results.json": "Results (JSON)",
    }
)
_MAIN_FILE = next(iter(FILES))
_ADDRESS = "/reports"


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """A report, with its own folder."""

    folder: Path
    """The folder."""

    @property
    def name(self) -> str:
        """The name of its folder, which begins with that of the stage."""
        return self.folder.name

    @property
    def title(self) -> str:
        """Name of the stage and time of writing."""
        stage = self.name.rpartition("_")[0] or self.name
        return f"{stage}, {datetime.fromtimestamp(self._written_at):%d %b %Y %H:%M:%S}"

    @property
    def files(self) -> list[str]:
        """The files of the report that exist."""
        return [name for name in FILES if (self.folder / name).is_file()]

    def address(self, file: str = _MAIN_FILE) -> str:
        """Return the address of a file of the report in the panel."""
        return f"{_ADDRESS}/{self.name}/{file}"

    @property
    def _written_at(self) -> float:
        return (self.folder / _MAIN_FILE).stat().st_mtime


def written_reports(folder: Path) -> list[WrittenReport]:
    """Return the reports in a folder, the newest first."""
    reports = [WrittenReport(path.parent) for path in folder.glob(f"*/{_MAIN_FILE}")]
    return sorted(reports, key=lambda report: (report._written_at, report.name), reverse=True)


def new_folder(folder: Path, stage: str) -> Path:
    """Return a folder for a new report of a stage."""
    stem = f"{stage}_{datetime.now():%Y%m%d-%H%M%S}"
    existing = {path.name for path in folder.glob(f"{stem}*")}
    count = next(k for k in range(len(existing) + 1) if _numbered(stem, k) not in existing)
    return folder / _numbered(stem, count)


def _numbered(stem: str, count: int) -> str:
    return f"{stem}-{count + 1}" if count else stem


def serve_reports(application: Any, folder: Path) -> None:
    """Add a route to an application (FastAPI) that serves report files alone."""
    from fastapi import HTTPException
    from fastapi.responses import FileResponse

    @application.get(f"{_ADDRESS}/{{name}}/{{file}}")
    def _serve(name: str, file: str) -> FileResponse:
        for report in written_reports(folder):
            if report.name == name and file in report.files:
                headers = {"content-security-policy": _policy()}
                return FileResponse(report.folder / file, headers=headers)
        raise HTTPException(404, "there is no such report")


@cache
def _policy() -> str:
    """Return the content security policy of a report: it allows the script of its template alone.

    It applies in addition to the policy of the panel. A report contains names and texts of stage
    files and plans, which may come from others.
    """
    page = (files("flexstage.report") / "templates" / "page.html").read_text("utf-8")
    script = page.split("<script>")[1].split("</script>")[0]
    script_hash = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{script_hash}'; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'"
    )


def write_report(
    folder: Path, variant: "Variant", request: "StudyRequest", *, cache: bool = True
) -> WrittenReport:
    """Write the report of a variant into a new folder within `folder`, as `flexstage study` does.

    It runs in a worker process.
    """
    from flexstage.files.cache import Memory, open_cache
    from flexstage.report.study import study_files
    from flexstage.studies import run_study

    stage = variant.stage()
    with progress.subtask(0.0, 0.8):
        study = run_study(stage, request, cache=cache)
    progress.update("pages", 0.8)
    files = study_files(study, Memory(open_cache(cache)))
    name = file_name(f"{stage.name}-changed" if variant.values else stage.name)
    report = new_folder(folder, name)
    write_files(report, files)
    return WrittenReport(report)
