"""The table of evidence: what tests compare, with which reference, and how far apart they are.

A test's module says so in its docstring, in a paragraph that begins with ``Evidence (part of the
table):``. The manual shows all of them; ``--evidence-page`` writes them with the outcome of a run.
"""

import ast
import platform
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pytest

TESTS = Path(__file__).parent
PARTS = (
    "Hinges",
    "Stages, tolerances, designs",
    "The two stages of the study",
    "Finite elements",
    "Hysteresis and records",
    "Measuring and centring",
    "Coverage of 95 % intervals",
    "Instruments, twin, control",
    "Exported files",
)
_MARK = "Evidence ("


class Evidence(NamedTuple):
    """One row: what is compared, and the file of its test."""

    part: str
    text: str
    file: str


@cache
def rows() -> list[Evidence]:
    """Return the rows of all tests, by part and file."""
    every = [row for file in sorted(TESTS.glob("*/test_*.py")) for row in rows_of(file)]
    return sorted(every, key=lambda row: PARTS.index(row.part))


def rows_of(file: Path) -> Iterator[Evidence]:
    """Yield the rows that the docstring of a test's module has."""
    name = file.relative_to(TESTS).as_posix()
    with file.open(encoding="utf-8") as stream:
        docstring = next(tokenize.generate_tokens(stream.readline)).string
    for paragraph in str(ast.literal_eval(docstring)).split("\n\n"):
        if paragraph.startswith(_MARK):
            part, _, text = " ".join(paragraph.split())[len(_MARK) :].partition("): ")
            yield Evidence(part, text, name)


def page(outcomes: dict[str, str] | None = None) -> str:
    """Return the page of the table; `outcomes` are those of the files that a run has tested."""
    lines = ["# Table of evidence", ""]
    if outcomes is None:
        lines += ["[Verification](../explanation/verification.md) says how to read it.", ""]
    else:
        machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
        lines += [f"Revision {_revision()}, {machine}.", ""]
    outcome, rule = ("", "") if outcomes is None else (" outcome |", "---|")
    for part in PARTS:
        lines += [f"## {part}", "", f"| quantity (reference): difference | test |{outcome}"]
        lines += [f"|---|---|{rule}"]
        for row in (row for row in rows() if row.part == part):
            result = "" if outcomes is None else f" {outcomes.get(row.file, 'not run')} |"
            lines.append(f"| {row.text.replace('|', '&#124;')} | `{row.file}` |{result}")
        lines.append("")
    return "\n".join(lines)


def outcomes_of(reporter: "pytest.TerminalReporter") -> dict[str, str]:
    """Return how many tests of each file passed, failed and were skipped in a run."""
    counts: dict[str, dict[str, int]] = {}
    for outcome in ("passed", "failed", "error", "skipped"):
        for report in reporter.stats.get(outcome, ()):
            file = report.nodeid.partition("::")[0].removeprefix("tests/")
            of_file = counts.setdefault(file, {})
            of_file[outcome] = of_file.get(outcome, 0) + 1
    return {file: ", ".join(f"{n} {what}" for what, n in c.items()) for file, c in counts.items()}


def _revision() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    try:
        return subprocess.run(
            command, cwd=TESTS, capture_output=True, text=True, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
