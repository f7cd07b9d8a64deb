"""`flexstage serve`: the front panel in the browser."""

import logging
import os
import sys
import webbrowser
from json import dumps
from pathlib import Path

import typer

from flexstage.cli.options import JsonOption, from_docstring
from flexstage.errors import ModelError


@from_docstring
def serve(
    port: int = 8321,
    host: str = "127.0.0.1",
    password_file: Path | None = None,
    certificate: Path | None = None,
    key: Path | None = None,
    host_name: list[str] | None = None,
    folder: Path = Path("front-panel"),
    no_open: bool = False,
    json: JsonOption = False,
) -> None:
    """Serve the front panel: flexstage in a browser.

    Parameters
    ----------
    port
        NUMBER: TCP port; 0 for any free port.
    host
        ADDRESS: Address to listen on; any address but 127.0.0.1 lets others on the network in, and
        needs a password.
    password_file
        FILE: File whose first line is the password that opens the panel.
    certificate
        FILE: Certificate for TLS (PEM).
    key
        FILE: Private key of the certificate (PEM).
    host_name
        NAME: Name by which browsers reach it, beside that of this computer; may be repeated.
    folder
        FOLDER: Where files that are given to the panel, and those it makes, are kept.
    no_open
        Do not open a browser.
    """
    from flexstage.web import PanelOptions
    from flexstage.web import serve as serve_panel

    options = PanelOptions(
        folder=folder.absolute(),
        host=host,
        port=port,
        password=None if password_file is None else _first_line(password_file),
        certificate=_there(certificate),
        key=_there(key),
        host_names=tuple(host_name or ()),
    )
    logging.basicConfig(format="flexstage: %(message)s", stream=sys.stderr)
    opens = not no_open and not json and _has_screen()

    def announce(address: str) -> None:
        nonlocal opens
        said = f"the front panel is at {address} (opens it once); Ctrl-C ends it"
        typer.echo(dumps({"address": address}) if json else said)
        typer.get_text_stream("stdout").flush()
        if opens:
            opens = False
            webbrowser.open(address)

    serve_panel(options, announce)


def _first_line(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ModelError(f"the password file '{path}' is no text in UTF-8") from None
    if not lines:
        raise ModelError(f"the password file '{path}' is empty: its first line is the password")
    return lines[0]


def _there(path: Path | None) -> Path | None:
    if path is not None and not path.is_file():
        raise ModelError(f"there is no file '{path}': TLS needs its certificate and key")
    return path


def _has_screen() -> bool:
    shown = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(shown) or sys.platform in {"darwin", "win32"}
