"""`flexstage records`: contents of measured files."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.cli.output import console, display_table, print_json, print_notes, print_text
from flexstage.files.request import option_words
from flexstage.records.read_options import ReadOptions

if TYPE_CHECKING:
    from rich.console import Console


@from_docstring
def records(
    files: Annotated[list[Path], typer.Argument()],
    *,
    read_options: ReadOptions,
    json: JsonOption = False,
) -> None:
    """List columns, units, rate and gaps of measured files.

    Parameters
    ----------
    files
        FILE...: Measured files.
    """
    from flexstage.records.contents import contents, read_whole

    options = read_options.of_each(len(files))
    listings = [
        contents(*read_whole(file, file_options))
        for file, file_options in zip(files, options, strict=True)
    ]
    if read_options.resample:
        for listing in listings:
            listing["notes"].append(
                "listed as stored in the file: --resample applies to the next command"
            )
    if json:
        print_json({"files": listings})
        return
    for listing, file_options in zip(listings, options, strict=True):
        _print(console(), listing, option_words(file_options))


def _print(screen: "Console", listing: dict[str, Any], options: list[str]) -> None:
    from flexstage.records.contents import contents_table, length_in_words, next_job

    display_table(screen, contents_table(listing, listing["file"]))
    print_text(screen, length_in_words(listing))
    gaps = listing.get("gaps", [])
    for gap in gaps[:5]:
        screen.print(f"gap of {gap['seconds']:.4g} s after sample {gap['after_sample']}")
    if len(gaps) > 5:
        screen.print(f"and {len(gaps) - 5} more gaps")
    print_notes(screen, listing["notes"])
    if job := next_job(listing):
        line = shlex.join(["flexstage", job, listing["file"], *options])
        screen.print(f"next command: {line}", markup=False, soft_wrap=True)
