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
