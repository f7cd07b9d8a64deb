"""What all commands share: reading a stage, printing tables and JSON."""

import difflib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.errors import StageError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from flexstage.stage import Stage

__all__ = [
    "JsonOption",
    "PlaneOption",
    "StageArgument",
    "console",
    "count",
    "load_stage",
    "make_table",
    "name_for_files",
    "output_path",
    "print_json",
    "write_file",
]

StageArgument = Annotated[
    str, typer.Argument(metavar="STAGE", help="A stage file, or the name of a built-in design.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
PlaneOption = Annotated[
    str,
    typer.Option(
        metavar="auto|stress|strain",
        help="Plane state of the notches; auto chooses by width against neck.",
    ),
]


def load_stage(text: str) -> "Stage":
    """Return the stage that the command line names.

    Parameters
    ----------
    text : str
        Name of a built-in design, or path of a stage file.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    StageError
        There is neither such a design nor such a file, or the file is no stage.

    Examples
    --------
    >>> load_stage("vgtu-piezo").name
    'vgtu-piezo'
    """
    from flexstage.designs import DESIGNS, build, design

    if text.casefold() in DESIGNS:
        return design(text)
    path = Path(text)
    if not text or not _exists(path):
        near = difflib.get_close_matches(text.casefold(), DESIGNS, n=1, cutoff=0.4)
        hint = f"did you mean '{near[0]}'?" if near else f"the designs are {', '.join(DESIGNS)}"
        raise StageError(f"no built-in design and no file is called '{text[:200]}': {hint}")
    from flexstage.stage.file import read_stage

    return read_stage(path, designs=build)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long for any file
        return False


def output_path(text: str) -> Path:
    """Return the path that an option names.

    Parameters
    ----------
    text : str
        What the option was given.

    Returns
    -------
    pathlib.Path
        The path.

    Raises
    ------
    typer.BadParameter
        It was given nothing, as by a variable of the shell that is not set; the working directory
        would be taken instead.
    """
    if not text.strip():
        raise typer.BadParameter("expected a path, got an empty text")
    return Path(text)


def name_for_files(name: str) -> str:
    """Return a name that a directory can have.

    Parameters
    ----------
    name : str
        Any name.

    Returns
    -------
    str
        The same with every character that is special to some system replaced by a dash.

    Examples
    --------
    >>> name_for_files("a/b: c")
    'a-b--c'
    """
    kept = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip(".")
    # no system takes a name of more than 255 bytes
    return kept[:60] or "stage"


def count(number: int, noun: str) -> str:
    """Return a number of things in words.

    Parameters
    ----------
    number : int
        How many.
    noun : str
        What one of them is called.

    Returns
    -------
    str
        Number and noun.

    Examples
    --------
    >>> count(1, "body"), count(2, "body")
    ('1 body', '2 bodies')
    """
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


def console() -> "Console":
    """Return the console that tables are printed on.

    Returns
    -------
    rich.console.Console
        Standard output, without colours where it is no terminal.
    """
    import sys

    from rich.console import Console

    # a file or a pipe has no width of its own, and a table must not be cut there
    return Console(highlight=False, width=None if sys.stdout.isatty() else 140)


def make_table(title: str, *columns: str) -> "Table":
    """Start a table.

    Parameters
    ----------
    title : str
        What it shows.
    *columns : str
        Its columns; the first one is text, the others are numbers and stand at the right, unless
        they begin with ``<``, which is taken off.

    Returns
    -------
    rich.table.Table
        A table without rows.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for i, column in enumerate(columns):
        left = i == 0 or column.startswith("<")
        table.add_column(
            Text(column.removeprefix("<")),
            justify="left" if left else "right",
            # where there is no room a line is broken; no digit is ever left out
            overflow="fold",
            no_wrap=i == 0,
            vertical="bottom",
        )
    return table


def print_json(value: Any) -> None:
    """Print one JSON object on standard output.

    Parameters
    ----------
    value : Any
        Plain data.
    """
    typer.echo(json.dumps(value, indent=2, allow_nan=False))


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    content : bytes
        What goes into it.

    Raises
    ------
    OSError
        It cannot be written.
    """
    from flexstage.report.files import write_files

    write_files(path.parent, {path.name: content})
