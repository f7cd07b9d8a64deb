"""What commands print and write: tables, JSON and progress; files, refused before the work."""

import json
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure
    from rich.console import Console

    from flexstage.quantities.table import Cell, Column, Table
import errno
from pathlib import Path

#: Work that is shorter says nothing of its progress where standard error is no terminal [s].
_SILENT = 5.0


def console() -> "Console":
    """Return the console that tables are printed on, without colours where it is no terminal."""
    import sys

    from rich.console import Console

    # a file or a pipe has no width of its own, unless COLUMNS says what it is for
    known = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    return Console(highlight=False, width=None if known else 140)


def print_table(
    screen: "Console",
    caption: str,
    headings: "Iterable[str | Column]",
    rows: "Iterable[Sequence[str | int | Cell]]",
) -> None:
    """Print a table, as `flexstage.quantities.table.table` makes it of headings and cells."""
    from flexstage.quantities.table import table

    print_shown(screen, table(caption, headings, rows))


def print_shown(screen: "Console", shown: "Table") -> None:
    """Print a table; a path above or below it stays whole, and is wider than the screen then."""
    from flexstage.cli.tables import Printed

    screen.print(Printed(shown), crop=False)


def count(number: int, noun: str) -> str:
    """Return a number of things in words.

    Examples
    --------
    >>> count(1, "body"), count(2, "body")
    ('1 body', '2 bodies')
    """
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


def print_json(value: Any) -> None:
    """Print plain data as one JSON object on standard output."""
    typer.echo(json.dumps(value, indent=2, allow_nan=False))


def print_result(result: "dict[str, Any]", files: "Iterable[object]") -> None:
    """Print a result as one JSON object, with the files that were written of it."""
    print_json(result | {"files": [str(file) for file in files]})


def print_text(screen: "Console", text: str, style: str = "") -> None:
    """Print a text, broken where a line may end."""
    from flexstage.cli.tables import wrapped

    lines = "\n".join(wrapped(text, screen.width))
    screen.print(lines, style=style or None, markup=False, soft_wrap=True)


def print_notes(
    screen: "Console", notes: "Iterable[str]", files: "Iterable[object]" = (), *, style: str = "dim"
) -> None:
    """Print notes, and which files were written."""
    for note in notes:
        print_text(screen, f"note: {note}", style)
    for file in files:
        screen.print(f"wrote {file}", markup=False, soft_wrap=True)


@contextmanager
def progress_bar(command: str, *, quiet: bool = False) -> "Iterator[None]":
    """Show on standard error how far the work in this block has come.

    On a terminal it is a bar with the time left; else a line where a long phase begins, and one
    every ten seconds.
    """
    import sys

    if quiet:
        yield
        return
    if not sys.stderr.isatty():
        from flexstage.base.progress import in_lines

        with in_lines(lambda line: typer.echo(line, err=True), command, _SILENT):
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

    from flexstage.base.progress import listen

    columns = (
        TextColumn("{task.description:<17}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        with listen(lambda what, done: bar.update(task, description=what, completed=done)):
            yield


_IMAGES = (".svg", ".png", ".pdf")


def output_path(text: str | Path) -> Path:
    """Return the path that a word names.

    An empty text is refused, as of a variable of the shell that is not set: the working directory
    would be meant instead. A default of an option is handed on in the same way.
    """
    if not str(text).strip():
        raise typer.BadParameter("expected a path, got an empty text")
    if "\0" in str(text):
        raise typer.BadParameter(f"expected a path, got {text!r}: no path holds a NUL character")
    return Path(text)


def writable(path: Path) -> Path:
    """Return the path of a file, refusing it before the work where none can be written there."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder: name a file in it", str(path))
    _folder(path.parent)
    return path


def stage_file(out: Path | None, name: str, *, force: bool) -> Path:
    """Return where a stage file goes that people then edit, refusing to replace one unasked."""
    from flexstage.base.errors import StageError

    path = out if out is not None else writable(Path(name))
    if path.exists() and not force:
        raise StageError(
            f"{path} exists: give --force to replace it, or the name of another file by --out"
        )
    return path


def _file(text: str | Path) -> Path:
    return writable(output_path(text))


def _figure(text: str | Path) -> Path:
    path = output_path(text)
    if path.suffix.lower() not in _IMAGES:
        raise typer.BadParameter(
            f"the name must end in one of {', '.join(_IMAGES)}, which says the format, got "
            f"'{path.name}'"
        )
    return writable(path)


def _folder(text: str | Path) -> Path:
    from flexstage.files.write import require_writable

    path = output_path(text)
    require_writable(path)
    return path


#: The one file that a command writes: refused before the work where none can be written there.
OutputFile = Annotated[Path | None, typer.Option("--out", parser=_file, metavar="FILE")]
#: A picture of the result, refused as well where its ending is that of no picture.
FigureFile = Annotated[Path | None, typer.Option("--figure", parser=_figure, metavar="FILE")]
#: Where a command writes several files: refused before the work where no folder can be.
FOLDER = typer.Option("--folder", parser=_folder, metavar="FOLDER")
OutputFolder = Annotated[Path | None, FOLDER]


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    from flexstage.files.write import write_files

    write_files(path.parent, {path.name: content})


def write_folder(folder: Path | None, files: "Callable[[], Mapping[str, bytes]]") -> list[Path]:
    """Write the files of a result where a folder was asked for; return which."""
    from flexstage.files.write import write_files

    return [] if folder is None else write_files(folder, files())


def write_picture(path: Path | None, draw: "Callable[[], Figure]") -> list[Path]:
    """Write a picture where one was asked for, in the format that its ending says; return it."""
    if path is None:
        return []
    from flexstage.report.figures.style import encode

    write_file(path, encode(draw(), path.suffix.lower().lstrip(".")))
    return [path]
