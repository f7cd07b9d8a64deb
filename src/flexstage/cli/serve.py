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
    open_browser = not no_open and not json and _has_screen()
    redirect = options.folder / "open-the-panel.html"

    def announce(address: str) -> None:
        nonlocal open_browser
        redirect.unlink(missing_ok=True)  # its address has been used
        line = f"the front panel is at {address} (valid once); Ctrl-C stops it"
        typer.echo(dumps({"address": address}) if json else line)
        typer.get_text_stream("stdout").flush()
        if open_browser:
            open_browser = False
            _open(address, redirect)

    try:
        serve_panel(options, announce)
    finally:
        redirect.unlink(missing_ok=True)


def _open(address: str, redirect: Path) -> None:
    """Open an address in the browser by a file that redirects to it.

    Other users of the computer can read the arguments of programs, and the address admits the first
    browser that opens it.
    """
    text = f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={escape(address)}">'
    with suppress(OSError):  # the address was printed
        redirect.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(redirect, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
        webbrowser.open(redirect.as_uri())


def _has_screen() -> bool:
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) or sys.platform in {"darwin", "win32"}
