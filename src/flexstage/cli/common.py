"""What all commands share: reading a stage, printing tables and JSON."""

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexstage.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console
    from rich.table import Table

    from flexstage.stage import Stage

__all__ = [
    "JsonOption",
    "ModelOption",
    "PlaneOption",
    "StageArgument",
    "console",
    "count",
    "load_stage",
    "make_table",
    "name_for_files",
    "output_path",
    "positive_length",
    "print_json",
    "progress_bar",
    "relative",
    "require_image",
    "write_file",
]

_IMAGES = (".svg", ".png", ".pdf")
#: Time between two lines of progress where standard error is no terminal, and before the first [s].
_SILENT = 10.0

StageArgument = Annotated[
    str, typer.Argument(metavar="STAGE", help="A stage file, or the name of a built-in design.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
ModelOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="lumped: rigid bodies; superelement: bodies condensed to their hinges; plane: finite "
        "elements in the plane; solid: in three dimensions.",
    ),
]
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
    from flexstage.designs import find_stage

    return find_stage(text)


def positive_length(text: str, name: str, bare_unit: str | None = None) -> float:
    """Return the length that an option gives.

    Parameters
    ----------
    text : str
        What the option was given.
    name : str
        What it is the length of, for messages.
    bare_unit : str, optional
        The unit of a number that comes without one.

    Returns
    -------
    float
        The length [m], positive and within what a stage may have.

    Raises
    ------
    UnitError
        It is no length.
    ModelError
        It is too short or too long for a stage.

    Examples
    --------
    >>> positive_length("20 mm", "the radius")
    0.02
    """
    from flexstage.stage.outline import LARGEST, SMALLEST
    from flexstage.units import parse

    value = parse(text, "length", bare_unit=bare_unit)
    if not SMALLEST <= value <= LARGEST:
        raise ModelError(
            f"{name} must be positive, between {SMALLEST:g} and {LARGEST:g} m, got '{text}'"
        )
    return value


def output_path(text: str | Path) -> Path:
    """Return the path that an option names.

    Parameters
    ----------
    text : str or pathlib.Path
        What the option was given, or its default, which is handed on in the same way.

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
    if not str(text).strip():
        raise typer.BadParameter("expected a path, got an empty text")
    return Path(text)


def require_image(figure: Path | None) -> None:
    """Refuse a figure whose suffix says no format, before any work is done.

    Parameters
    ----------
    figure : pathlib.Path or None
        Where it goes.

    Raises
    ------
    ModelError
        The suffix says none.
    """
    if figure is not None and figure.suffix.lower() not in _IMAGES:
        raise ModelError(
            f"--figure must end in one of {', '.join(_IMAGES)}, got '{figure.name}': the suffix "
            "says the format"
        )


def name_for_files(name: str) -> str:
    """Return a name that a directory can have.

    Parameters
    ----------
    name : str
        Any name.

    Returns
    -------
    str
        The same with every character that is special to some system replaced by a dash, and none of
        these at the beginning, where programs take it for an option.

    Examples
    --------
    >>> name_for_files("a/b: c")
    'a-b--c'
    """
    kept = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip(".").lstrip("-.")
    # no system takes a name of more than 255 bytes, and endings are put behind it
    return kept[:60].encode()[:180].decode(errors="ignore") or "stage"


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


def relative(text: str) -> float:
    """Return the share that an option gives, as a percentage or as a plain number.

    Parameters
    ----------
    text : str
        What the option was given.

    Returns
    -------
    float
        The share [1].

    Raises
    ------
    typer.BadParameter
        It is no number, or not between nothing and one.

    Examples
    --------
    >>> relative("0.1%"), relative("2e-3")
    (0.001, 0.002)
    """
    plain = text.strip()
    try:
        value = float(plain.removesuffix("%")) / (100.0 if plain.endswith("%") else 1.0)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1.0:
        raise typer.BadParameter(
            f"expected a share between 0 and 100 %, such as 0.1% or 0.001, got '{text}'"
        )
    return value


@contextmanager
def progress_bar() -> "Iterator[None]":
    """Show on standard error how far the work in this block has come, with the time left.

    Where standard error is no terminal, work that takes long writes a line there now and then.

    Yields
    ------
    None
    """
    import sys

    from flexstage.progress import now_and_then, reporting

    if not sys.stderr.isatty():
        with reporting(now_and_then(lambda line: typer.echo(line, err=True), _SILENT)):
            yield
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<17}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        with reporting(lambda what, done: bar.update(task, description=what, completed=done)):
            yield


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
