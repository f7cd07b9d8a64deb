"""What commands print: tables and JSON on standard output, progress on standard error."""

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console
    from rich.table import Table

#: Work that is shorter says nothing of its progress where standard error is no terminal [s].
_SILENT = 5.0


def console() -> "Console":
    """Return the console that tables are printed on, without colours where it is no terminal."""
    import sys

    from rich.console import Console

    # a file or a pipe has no width of its own, and a table must not be cut there
    return Console(highlight=False, width=None if sys.stdout.isatty() else 140)


def make_table(title: str, *columns: str) -> "Table":
    """Start a table.

    The first column is text; the others are numbers and stand at the right, unless they begin with
    ``<``, which is taken off.
    """
    from rich import box
    from rich.align import Align
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for i, column in enumerate(columns):
        left = i == 0 or column.startswith("<")
        head = Text(column.removeprefix("<"))
        table.add_column(
            # a heading is beside its column, a cell beside the first line of its row
            Align(head, "left" if left else "right", vertical="bottom"),
            justify="left" if left else "right",
            # where there is no room a line is broken; no digit is ever left out
            overflow="fold",
            no_wrap=i == 0,
            vertical="top",
        )
    return table


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
        from flexstage.progress import in_lines

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

    from flexstage.progress import listen

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
