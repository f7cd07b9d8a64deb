"""Studies of the built-in stages, made once in a test process, and their reports, once in a run.

Tests change nothing in them.
"""

import functools
import os
from pathlib import Path

from filelock import FileLock

from flexstage.report import report_html
from flexstage.report.page import sections_html
from flexstage.report.study import study_section
from flexstage.stage.designs import design
from flexstage.studies import Study, run_study


@functools.cache
def study_of(name: str) -> Study:
    """The study of a built-in stage with the models that a study has by default."""
    return run_study(design(name))


@functools.cache
def page_of(name: str) -> str:
    """The report of that study, with its figures: drawn by the first process that asks for it."""
    file = Path(os.environ["FLEXSTAGE_CACHE"]) / f"report-{name}.html"
    with FileLock(file.with_suffix(".lock")):
        if not file.exists():
            file.write_text(report_html(study_of(name)), "utf-8")
        return file.read_text("utf-8")


def sections_of(study: Study, *keys: str) -> str:
    """Some sections of the report of a study, those that have something to show."""
    shown = (study_section(study, key) for key in keys)
    return sections_html(*(section for section in shown if section.content))
