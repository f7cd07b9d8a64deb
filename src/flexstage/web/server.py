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

_MAX_MESSAGE = 8 * 2**20  # largest WebSocket message from a browser [byte]


def serve(options: PanelOptions, announce: Callable[[str], object]) -> None:
    """Serve the front panel until it is interrupted.

    Parameters
    ----------
    options : PanelOptions
        Address, access and folder of the panel.
    announce : callable
        Called with an address that opens the panel once, and with a new one after each use.

    Raises
    ------
    ModelError
        The extra `web` is not installed, or the certificate or key is invalid.
    NotConnectedError
        The port is in use, or the address does not belong to this computer.
    """
    require_extra("web", "nicegui", "the front panel", ModelError)
    _require_certificate(options)
    listener = _listener(options)
    try:
        _run(options, listener, announce)
    finally:
        listener.close()


def application(options: PanelOptions, announce: Callable[[], object] = lambda: None) -> Any:
    """Return the front panel as an ASGI application with access control, and the panel itself.

    `announce` is called after the use of a token.
    """
    # the storage of NiceGUI belongs in the folder of the panel
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(options.folder / "nicegui"))
    from fastapi import FastAPI
    from nicegui import ui

    from flexstage.web.access_control import AccessControl
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
    return AccessControl(outer, options, panel.access, announce), panel


def _run(options: PanelOptions, listener: socket.socket, announce: Callable[[str], object]) -> None:
    import uvicorn

    address = options.url(listener.getsockname()[1])

    def announce_address() -> None:
        announce(f"{address}?token={panel.access.new_token()}")

    asgi, panel = application(options, announce_address)
    config = uvicorn.Config(
        asgi,
        log_level="warning",
        access_log=False,
        ws="wsproto",
        ws_max_size=_MAX_MESSAGE,
        server_header=False,
        # there is no proxy in front, so headers about the client are not trusted
        proxy_headers=False,
        ssl_certfile=options.tls.certificate,
        ssl_keyfile=options.tls.key,
        timeout_graceful_shutdown=3,
    )
    announce_address()
    try:
        uvicorn.Server(config).run(sockets=[listener])
    finally:
        panel.emergency_stop.stop()
        panel.jobs.close()


def _require_certificate(options: PanelOptions) -> None:
    """Require a valid certificate and key before an address is announced."""
    if options.tls.certificate is None:
        return
    try:
        # an empty password; else the library prompts for one in the terminal
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
            options.tls.certificate, options.tls.key, password=""
        )
    except (ssl.SSLError, ValueError) as error:
        raise ModelError(
            f"'{options.tls.certificate}' and '{options.tls.key}' are not a certificate and its "
            f"private key in PEM format; the key must have no password ({error})"
        ) from None


def _listener(options: PanelOptions) -> socket.socket:
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    address_text = write_address(options.address)
    try:
        return socket.create_server(options.address, family=family, backlog=128)
    except OSError as error:
        raise NotConnectedError(
            f"the front panel cannot listen at {address_text}: {error.strerror or error}; choose "
            "another port with --address (0 selects a free port)"
        ) from error
