"""Access control of the front panel: sessions, login, and requests of other sites."""

import logging
from collections.abc import Awaitable, Callable, MutableMapping
from html import escape
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from flexstage.web.options import PanelOptions
from flexstage.web.sessions import Access

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>{head}
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 16px/1.5 sans-serif; max-width: 34rem; margin: 15vh auto; padding: 0 1rem; }}
input, button {{ font: inherit; padding: .4rem .7rem; }}
form {{ display: flex; gap: .6rem; align-items: end; flex-wrap: wrap; }}
label {{ display: grid; gap: .2rem; }}
</style></head><body><main><h1>flexstage</h1>{body}</main></body></html>
"""


def redirect_page() -> str:
    """Return the page that redirects to the panel."""
    return _PAGE.format(
        title="flexstage",
        head='<meta http-equiv="refresh" content="0; url=/">',
        body='<p><a href="/">To the front panel</a></p>',
    )


def login_page(action: str, message: str = "") -> str:
    """Return the page with the password form, and the message of a failed attempt."""
    alert = f'<p role="alert">{escape(message.capitalize())}.</p>' if message else ""
    return _PAGE.format(
        title="flexstage: password",
        head="",
        body=f'{alert}<form method="post" action="{action}"><label>Password'
        '<input type="password" name="password" autocomplete="current-password" required autofocus>'
        "</label><button>Open the front panel</button></form>",
    )


def refusal_page(reason: str, login: str | None = None) -> str:
    """Return the page with the reason of a refusal, and the way to log in."""
    hint = (
        f'<p><a href="{login}">Enter the password</a>.</p>'
        if login
        else "<p>Open the newest address that <code>flexstage serve</code> printed. Each opens the "
        "panel once, in one browser.</p>"
    )
    return _PAGE.format(
        title="flexstage: refused", head="", body=f"<p>Refused: {escape(reason)}.</p>{hint}"
    )


#: Log of refusals.
LOG = logging.getLogger("flexstage.web")

#: Key of the session in the scope of a request.
SESSION = "flexstage.session"

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

_PASSWORD_PAGE = "/enter"
_MAX_FORM = 4096
_METHODS = frozenset({"GET", "HEAD", "POST"})

# NiceGUI builds its pages from inline scripts, and its `nicegui.js` evaluates properties, handlers
# and calls from the server (`eval`, `new Function`); no build works without. The policy forbids
# resources of other sites, and frames in other sites.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "media-src 'self' blob:; worker-src 'self' blob:; frame-src 'self' blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
# the pages of this module have no script
_PLAIN_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=()"),
)


class AccessDenied(Exception):  # noqa: N818 - not an error of the program
    """A refused request: its HTTP status and the reason."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class AccessControl:
    """An ASGI application in front of the panel that passes requests of its own pages in a session.

    Parameters
    ----------
    app
        The panel.
    options
        Accepted host names, and largest size of a request.
    access
        Tokens, sessions and the password.
    on_login
        Called after the use of a token, to issue the next one.
    """

    def __init__(
        self,
        app: Callable[[Scope, Receive, Send], Awaitable[None]],
        options: PanelOptions,
        access: Access,
        on_login: Callable[[], object] = lambda: None,
    ) -> None:
        self.app, self._options, self._access, self._on_login = app, options, access, on_login

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        try:
            if await self._check(scope, receive, send):
                return
            scope[SESSION] = self._session(scope)
        except AccessDenied as refusal:
            await self._refuse(scope, send, refusal)
            return
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._limited(scope, receive, send)

    async def _check(self, scope: Scope, receive: Receive, send: Send) -> bool:
        """Check a request; answer it if it is a login, and return whether it was one."""
        _require_plain_path(scope)
        self._require_own_host(scope)
        _require_own_origin(scope)
        if scope["type"] != "http":
            return False
        if scope["method"] not in _METHODS:
            raise AccessDenied(405, f"the method {scope['method'][:20]} is not supported")
        self._require_length(scope)
        path = scope["path"]
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token")
        if path == "/" and token and scope["method"] == "GET":
            if not self._access.redeem(token[0]):
                if self._access.session(_secret(scope)):
                    return False
                raise AccessDenied(
                    401, "this address was used before, or belongs to another server"
                )
            self._on_login()
            await self._log_in(scope, send)
            return True
        if path == _PASSWORD_PAGE and self._access.has_password:
            if scope["method"] == "POST":
                await self._check_password(scope, receive, send)
            else:
                await _page(send, 200, login_page(_PASSWORD_PAGE))
            return True
        return False

    async def _check_password(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = b""
        while len(body) <= _MAX_FORM:
            message = await receive()
            body += message.get("body", b"")
            if not message.get("more_body"):
                break
        password = parse_qs(body[:_MAX_FORM].decode("utf-8", "replace")).get("password", [""])[0]
        is_valid = self._access.is_password(password, _client(scope))
        if is_valid:
            await self._log_in(scope, send)
            return
        message = (
            "too many wrong passwords: wait a minute" if is_valid is None else "wrong password"
        )
        LOG.warning("refused %s: %s", _log_text(scope), message)
        status = 429 if is_valid is None else 401
        await _page(send, status, login_page(_PASSWORD_PAGE, message))

    async def _log_in(self, scope: Scope, send: Send) -> None:
        secret = self._access.open_session()
        cookie = f"{_cookie_name(scope)}={secret}; HttpOnly; SameSite=Strict; Path=/"
        if scope.get("scheme") == "https":
            cookie += "; Secure"
        # a page that redirects itself: after an HTTP redirect from a link in another page, the
        # browser would not send the strict cookie
        await _page(send, 200, redirect_page(), (b"set-cookie", cookie.encode()))

    def _session(self, scope: Scope) -> object:
        session = self._access.session(_secret(scope))
        if session is None:
            raise AccessDenied(401, "no session: open the panel with the address that it printed")
        return session

    def _require_own_host(self, scope: Scope) -> None:
        hosts = _all(scope, b"host")
        try:
            parts = urlsplit(f"//{hosts[0]}") if len(hosts) == 1 else None
            name = parts.hostname if parts and not (parts.path or parts.query) else None
            port = parts.port if parts else None
        except ValueError:
            name = port = None
        if not name or "@" in hosts[0]:
            raise AccessDenied(400, "the request names no host")
        own_port = (scope.get("server") or (None, None))[1]
        default = 443 if self._options.scheme == "https" else 80
        is_alias = name.casefold() in {n.casefold() for n in self._options.host_name}
        if not self._options.is_own_name(name) or not (is_alias or (port or default) == own_port):
            raise AccessDenied(421, f"the front panel is not called '{hosts[0][:80]}'")

    def _require_length(self, scope: Scope) -> None:
        lengths = _all(scope, b"content-length")
        if any(not text.isascii() or not text.isdigit() for text in lengths) or len(lengths) > 1:
            raise AccessDenied(400, "the length of the request is not a number")
        if lengths and int(lengths[0]) > self._options.upload_limit:
            raise AccessDenied(413, self._too_large())

    def _too_large(self) -> str:
        return f"the limit of a request is {self._options.upload_limit / 2**20:.0f} MB"

    async def _limited(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, and refuse a body above the limit in any transfer encoding."""
        size, exceeded, answered = 0, False, False

        async def counted() -> MutableMapping[str, Any]:
            nonlocal size, exceeded, answered
            message = await receive()
            size += len(message.get("body", b""))
            if size <= self._options.upload_limit:
                return message
            if not exceeded and not answered:
                await self._refuse(scope, send, AccessDenied(413, self._too_large()))
            exceeded = answered = True
            return {"type": "http.disconnect"}

        async def guarded(message: MutableMapping[str, Any]) -> None:
            nonlocal answered
            if exceeded:
                return
            answered = True
            if message["type"] == "http.response.start":
                policy = (b"content-security-policy", _POLICY.encode())
                message["headers"] = [*message.get("headers", ()), policy, *_HEADERS]
                if not any(n.lower() == b"cache-control" for n, _ in message["headers"]):
                    message["headers"].append((b"cache-control", b"no-store"))
            await send(message)

        try:
            await self.app(scope, counted, guarded)
        except Exception:
            if not exceeded:
                raise

    async def _refuse(self, scope: Scope, send: Send, refusal: AccessDenied) -> None:
        LOG.warning("refused %s: %s", _log_text(scope), refusal.reason)
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
            return
        login = _PASSWORD_PAGE if self._access.has_password and refusal.status == 401 else None
        await _page(send, refusal.status, refusal_page(refusal.reason, login))


def _require_plain_path(scope: Scope) -> None:
    raw = scope.get("raw_path") or scope["path"].encode("utf-8", "replace")
    path = raw.decode("latin-1")
    for _ in range(3):  # also if it is encoded twice
        if "\\" in path or "\0" in path or ".." in path.split("/"):
            raise AccessDenied(400, "the path is outside the panel")
        path = unquote(path)


def _require_own_origin(scope: Scope) -> None:
    """Refuse requests of pages of other sites, by the headers of the browser."""
    changes = scope["type"] == "websocket" or scope.get("method") not in {"GET", "HEAD"}
    origins, host = _all(scope, b"origin"), _all(scope, b"host")[0]
    for origin in origins:
        parts = urlsplit(origin)
        if parts.scheme not in {"http", "https"} or parts.netloc.casefold() != host.casefold():
            raise AccessDenied(403, f"a page of another site sent the request: '{origin[:80]}'")
    if changes and not origins:
        raise AccessDenied(403, "the request does not name its origin")
    sites, modes = _all(scope, b"sec-fetch-site"), _all(scope, b"sec-fetch-mode")
    foreign = any(site in {"cross-site", "same-site"} for site in sites)
    if foreign and (changes or modes != ["navigate"]):
        raise AccessDenied(403, "a page of another site sent the request")


def _all(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


def _cookie_name(scope: Scope) -> str:
    # cookies are shared between ports: the port in the name separates two panels on one computer
    return f"flexstage-{(scope.get('server') or ('', 0))[1]}"


def _secret(scope: Scope) -> str:
    try:
        cookie = SimpleCookie("; ".join(_all(scope, b"cookie")))
    except CookieError:
        return ""
    morsel = cookie.get(_cookie_name(scope))
    return morsel.value if morsel else ""


def _client(scope: Scope) -> str:
    return str((scope.get("client") or ("unknown",))[0])


def _log_text(scope: Scope) -> str:
    """Return method, path and client of a request, without secrets."""
    method = scope.get("method", "websocket")
    return f"{method} {scope['path'][:120]!a} of {_client(scope)}"


async def _page(send: Send, status: int, html: str, *extra_headers: tuple[bytes, bytes]) -> None:
    headers = [(b"content-type", b"text/html; charset=utf-8"), (b"cache-control", b"no-store")]
    headers.append((b"content-security-policy", _PLAIN_POLICY.encode()))
    await send(
        {
            "type": "http.response.start",
            "status": status,
            "headers": [*headers, *_HEADERS, *extra_headers],
        }
    )
    await send({"type": "http.response.body", "body": html.encode()})
