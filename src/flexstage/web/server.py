"""The server of the front panel."""

import os
import socket
import ssl
from collections.abc import Callable
from functools import partial
from typing import Any

from flexstage.base.errors import ModelError, NotConnectedError
from flexstage.base.lazy import require_extra
from flexstage.instruments.requests import write_address
from flexstage.web.options import PanelOptions

_LONGEST_MESSAGE = 8 * 2**20  # of a browser to the server in one piece [byte]


def serve(options: PanelOptions, announce: Callable[[str], object]) -> None:
    """Serve the front panel until it is interrupted.

    Parameters
    ----------
    options : PanelOptions
        Where, to whom, and where its files lie.
    announce : callable
        Given the address that opens it once, and a new one whenever that was used.

    Raises
    ------
    ModelError
        What it needs is not installed, or certificate and key are none.
    NotConnectedError
        The port is taken, or the address is none of this computer.
    """
    require_extra("web", "nicegui", "the front panel", ModelError)
    _require_certificate(options)
    listener = _listener(options)
    try:
        _run(options, listener, announce)
    finally:
        listener.close()


def application(options: PanelOptions, announce: Callable[[], object] = lambda: None) -> Any:
    """Return the front panel as an ASGI application behind its gate, and the panel itself.

    `announce` is called when a token was used.
    """
    # what the library keeps by itself is nothing of ours
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(options.folder / "nicegui"))
    from fastapi import FastAPI
    from nicegui import ui

    from flexstage.web.access_control import Gate
    from flexstage.web.live_chart import add_live_data
    from flexstage.web.page import Panel
    from flexstage.web.reports import serve_reports
    from flexstage.web.sessions import Access
    from flexstage.web.shell import add_style, build_page

    panel = Panel(options, Access(options.password))
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    add_style()
    serve_reports(outer, panel.options.folder / "report")
    add_live_data(outer, panel)
    ui.run_with(
        outer,
        root=partial(build_page, panel),
        title="flexstage",
        language="en-US",
        tailwind=False,
        reconnect_timeout=30.0,
        show_welcome_message=False,
    )
    return Gate(outer, options, panel.access, announce), panel


def _run(options: PanelOptions, listener: socket.socket, announce: Callable[[str], object]) -> None:
    import uvicorn

    address = options.url(listener.getsockname()[1])

    def say() -> None:
        announce(f"{address}?token={panel.access.new_token()}")

    gate, panel = application(options, say)
    config = uvicorn.Config(
        gate,
        log_level="warning",
        access_log=False,
        ws="wsproto",
        ws_max_size=_LONGEST_MESSAGE,
        server_header=False,
        # nobody stands before it, so nobody's word about who asks is taken
        proxy_headers=False,
        ssl_certfile=options.tls.certificate,
        ssl_keyfile=options.tls.key,
        timeout_graceful_shutdown=3,
    )
    say()
    try:
        uvicorn.Server(config).run(sockets=[listener])
    finally:
        panel.stops.stop()
        panel.jobs.close()


def _require_certificate(options: PanelOptions) -> None:
    """Refuse what is no certificate with its key, before an address is said."""
    if options.tls.certificate is None:
        return
    try:
        # an empty password, as the library would ask for one at the terminal
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
            options.tls.certificate, options.tls.key, password=""
        )
    except (ssl.SSLError, ValueError) as error:
        raise ModelError(
            f"'{options.tls.certificate}' and '{options.tls.key}' are no certificate and its "
            f"private key in PEM, the key without a password ({error})"
        ) from None


def _listener(options: PanelOptions) -> socket.socket:
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    where = write_address(options.address)
    try:
        return socket.create_server(options.address, family=family, backlog=128)
    except OSError as error:
        raise NotConnectedError(
            f"the front panel cannot listen at {where}: {error.strerror or error}; another "
            "port of --address may be free (0 takes any)"
        ) from error
