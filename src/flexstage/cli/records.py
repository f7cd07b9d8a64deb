"""`flexstage records`: what is in measured files, before anything is asked of them."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import console, print_json, print_notes, print_shown, print_text
from flexstage.files.request import option_words
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    from rich.console import Console


@from_docstring
def records(
    files: Annotated[list[Path], typer.Argument()],
    *,
    how: ReadOptions,
    json: JsonOption = False,
) -> None:
    """List columns, units, rate and gaps of measured files.

    Parameters
    ----------
    files
        FILE...: Measured files.
    """
    from flexstage.records.contents import contents, read_whole

    each = how.of_each(len(files))
    found = [contents(*read_whole(file, own)) for file, own in zip(files, each, strict=True)]
    if how.resample:
        for one in found:
            one["notes"].append("listed as it is in the file: --resample is for the next command")
    if json:
        print_json({"files": found})
        return
    for one, own in zip(found, each, strict=True):
        _print(console(), one, option_words(own))


def _print(screen: "Console", one: dict[str, Any], asked: list[str]) -> None:
    from flexstage.records.contents import contents_table, length_in_words, next_job

    print_shown(screen, contents_table(one, one["file"]))
    print_text(screen, length_in_words(one))
    gaps = one.get("gaps", [])
    for gap in gaps[:5]:
        screen.print(f"gap of {gap['seconds']:.4g} s after sample {gap['after_sample']}")
    if len(gaps) > 5:
        screen.print(f"and {len(gaps) - 5} more gaps")
    print_notes(screen, one["notes"])
    if job := next_job(one):
        line = shlex.join(["flexstage", job, one["file"], *asked])
        screen.print(f"to go on: {line}", markup=False, soft_wrap=True)
