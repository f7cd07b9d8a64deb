"""What the view Report does in a process of its own: a study, as `flexstage study` makes it."""

from dataclasses import dataclass
from pathlib import Path

from flexstage.cache.cache import open_cache
from flexstage.cache.memory import Memory
from flexstage.files.names import file_name
from flexstage.files.write import write_files
from flexstage.progress import subtask
from flexstage.progress import update as tell
from flexstage.report.study import study_files
from flexstage.studies import run_study
from flexstage.web.design.state import Variant
from flexstage.web.report.written import WrittenReport, new_folder

_PAGES = 0.8  # share of the time after which the pages are written


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyChoice:
    """What a report holds, as the options of `flexstage study` say it."""

    models: tuple[str, ...] = ("lumped", "superelement")
    """Models of the stage."""
    hysteresis: bool = True
    """Whether the hysteresis of piezo drives is identified and compensated on a simulated stage."""
    virtual: bool = True
    """Whether measurements of the stage are simulated, and centring a scale with it."""
    traditional: bool = True
    """Whether a stage of the study is set against traditional ones."""


def write_report(
    folder: Path, variant: Variant, choice: StudyChoice, *, cache: bool = True
) -> WrittenReport:
    """Write the report of a variant into a new folder within `folder`."""
    stage = variant.stage()
    with subtask(0.0, _PAGES):
        study = run_study(
            stage,
            choice.models,
            hysteresis=choice.hysteresis,
            virtual=choice.virtual,
            traditional=choice.traditional,
            cache=cache,
        )
    tell("pages", _PAGES)
    files = study_files(study, Memory(open_cache(cache)))
    name = file_name(f"{stage.name}-changed" if variant.values else stage.name)
    report = new_folder(folder, name)
    write_files(report, files)
    return WrittenReport(report)
