"""`flexstage` without a command: what it is, and the front panel for who has none in mind."""

import sys
from importlib.util import find_spec

import typer

from flexstage.cli.serve import serve

_WAYS = """
  flexstage serve    the front panel, in a browser
  flexstage new      designs to start from
  flexstage --help   every command
"""


def without_command(context: typer.Context) -> None:
    """Offer the front panel at a terminal; else print the help, with how to get the panel."""
    # looked for and not imported, which takes a second
    has_panel = find_spec("nicegui") is not None
    if has_panel and sys.stdin.isatty() and sys.stdout.isatty():
        typer.echo(f"{context.command.help}\n{_WAYS}")
        if typer.confirm("Open the front panel?", default=True):
            serve()
        return
    first = "" if has_panel else 'pip install "flexstage[web]", then '
    typer.echo(f"{context.get_help()}\n\nThe front panel, in a browser: {first}flexstage serve")
