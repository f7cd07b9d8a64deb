"""`flexstage serve`: the front panel in the browser."""

import logging
import os
import sys
import webbrowser
from contextlib import suppress
from html import escape
from json import dumps
from pathlib import Path

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.web.options import PanelOptions, ServeRequest


@from_docstring
def serve(
    request: ServeRequest,
    no_open: bool = False,
    json: JsonOption = False,
) -> None:
    """Serve the front panel: flexstage in a browser.

    Parameters
    ----------
    no_open
        Do not open a browser.
    """
    from flexstage.web import serve as serve_panel

    options = PanelOptions.of(request)
    logging.basicConfig(format="flexstage: %(message)s", stream=sys.stderr)
    opens = not no_open and not json and _has_screen()
    way = options.folder / "open-the-panel.html"

    def announce(address: str) -> None:
        nonlocal opens
        way.unlink(missing_ok=True)  # what it leads to was used
        said = f"the front panel is at {address} (opens it once); Ctrl-C ends it"
        typer.echo(dumps({"address": address}) if json else said)
        typer.get_text_stream("stdout").flush()
        if opens:
            opens = False
            _open(address, way)

    try:
        serve_panel(options, announce)
    finally:
        way.unlink(missing_ok=True)


def _open(address: str, way: Path) -> None:
    """Have the browser open an address by a file that leads to it.

    What programs are started with can be read by other users of the computer, and the address lets
    in whoever is first.
    """
    text = f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={escape(address)}">'
    with suppress(OSError):  # the address was printed
        way.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(way, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
        webbrowser.open(way.as_uri())


def _has_screen() -> bool:
    shown = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(shown) or sys.platform in {"darwin", "win32"}
