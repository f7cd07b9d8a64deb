"""Output of commands: tables, JSON, progress and files; bad paths are refused before the work."""

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

#: Without a terminal, work shorter than this prints no progress [s].
_QUIET_PERIOD = 5.0


def console() -> "Console":
    """Return the console for tables, without colours where it is no terminal."""
    import sys

    from rich.console import Console

    # a file or a pipe has no width of its own, except by COLUMNS
    has_width = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    return Console(highlight=False, width=None if has_width else 140)


def print_table(
    screen: "Console",
    caption: str,
    headings: "Iterable[str | Column]",
    rows: "Iterable[Sequence[str | int | Cell]]",
) -> None:
    """Print a table of headings and cells, as `flexstage.quantities.table.table` makes it."""
    from flexstage.quantities.table import table

    display_table(screen, table(caption, headings, rows))


def display_table(screen: "Console", table: "Table") -> None:
    """Print a table; a path above or below it is never broken, even if wider than the screen."""
    from flexstage.cli.tables import TableLayout

    screen.print(TableLayout(table), crop=False)


def count(number: int, noun: str) -> str:
    """Return a number of things with its noun.

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
    """Print a result as one JSON object, with the files that were written."""
    print_json(result | {"files": [str(file) for file in files]})


def print_text(screen: "Console", text: str, style: str = "") -> None:
    """Print a text, wrapped to the width of the screen."""
    from flexstage.cli.tables import wrapped

    lines = "\n".join(wrapped(text, screen.width))
    screen.print(lines, style=style or None, markup=False, soft_wrap=True)


def print_notes(
    screen: "Console", notes: "Iterable[str]", files: "Iterable[object]" = (), *, style: str = "dim"
) -> None:
    """Print notes, and the files that were written."""
    for note in notes:
        print_text(screen, f"note: {note}", style)
    for file in files:
        screen.print(f"wrote {file}", markup=False, soft_wrap=True)


def print_tables(
    tables: "Iterable[Table]", notes: "Iterable[str]", files: "Iterable[object]" = ()
) -> None:
    """Print tables, notes, and the files that were written."""
    screen = console()
    for table in tables:
        display_table(screen, table)
    print_notes(screen, notes, files)


@contextmanager
def progress_bar(command: str, *, quiet: bool = False) -> "Iterator[None]":
    """Show the progress of the work in this block on standard error.

    On a terminal a bar with the remaining time; otherwise a line when a long phase begins, and one
    every ten seconds.
    """
    import sys

    if quiet:
        yield
        return
    if not sys.stderr.isatty():
        from flexstage.base.progress import in_lines

        with in_lines(lambda line: typer.echo(line, err=True), command, _QUIET_PERIOD):
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
        TextColumn("remaining:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        with listen(
            lambda phase, fraction: bar.update(task, description=phase, completed=fraction)
        ):
            yield


_IMAGES = (".svg", ".png", ".pdf")


def output_path(text: str | Path) -> Path:
    """Return the path of an argument, or of the default of an option.

    An empty text, as of an unset variable of the shell, is refused: it would mean the working
    directory.
    """
    if not str(text).strip():
        raise typer.BadParameter("expected a path, got an empty text")
    if "\0" in str(text):
        raise typer.BadParameter(
            f"expected a path, got {text!r}: no path can contain a NUL character"
        )
    return Path(text)


def writable(path: Path) -> Path:
    """Return the path of a file; refuse one that cannot be written."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder: name a file in it", str(path))
    _folder(path.parent)
    return path


def stage_file(out: Path | None, name: str, *, force: bool) -> Path:
    """Return the path of a new stage file; refuse to replace one without `force`."""
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
            f"the name must end in one of {', '.join(_IMAGES)}, which selects the format, got "
            f"'{path.name}'"
        )
    return writable(path)


def _folder(text: str | Path) -> Path:
    from flexstage.files.write import require_writable

    path = output_path(text)
    require_writable(path)
    return path


#: The single file that a command writes: an unwritable path is refused before the work.
OutputFile = Annotated[Path | None, typer.Option("--out", parser=_file, metavar="FILE")]
#: A picture of the result: a suffix of no picture is refused as well.
FigureFile = Annotated[Path | None, typer.Option("--figure", parser=_figure, metavar="FILE")]
#: The folder of several files: an unwritable one is refused before the work.
FOLDER = typer.Option("--folder", parser=_folder, metavar="FOLDER")
OutputFolder = Annotated[Path | None, FOLDER]


#: The format of a record by the suffix of its file.
_RECORD_FORMATS = {
    ".csv": "csv", ".npz": "npz", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat",
}  # fmt: skip


def record_format(out: Path | None) -> str:
    """Return the format of a record by the suffix of its file; CSV without a file.

    Examples
    --------
    >>> record_format(Path("drive.h5"))
    'hdf5'
    """
    if out is None:
        return "csv"
    if out.suffix.lower() not in _RECORD_FORMATS:
        from flexstage.base.errors import ModelError

        raise ModelError(
            f"--out must end in one of {', '.join(_RECORD_FORMATS)}, got '{out.name}': the suffix "
            "selects the format"
        )
    return _RECORD_FORMATS[out.suffix.lower()]


def write_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all."""
    from flexstage.files.write import write_files

    write_files(path.parent, {path.name: content})


def write_folder(folder: Path | None, files: "Callable[[], Mapping[str, bytes]]") -> list[Path]:
    """Write the files of a result to a folder, if one is named; return their paths."""
    from flexstage.files.write import write_files

    return [] if folder is None else write_files(folder, files())


def write_picture(path: Path | None, draw: "Callable[[], Figure]") -> list[Path]:
    """Write a picture, if a path is named, in the format of its suffix; return the path."""
    if path is None:
        return []
    from flexstage.report.figures.style import encode

    write_file(path, encode(draw(), path.suffix.lower().lstrip(".")))
    return [path]
