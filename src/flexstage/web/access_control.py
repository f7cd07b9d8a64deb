"""The gate of the front panel: nobody comes in without a session, and no other page through it."""

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


def page_of_entrance() -> str:
    """Return the page that goes on to the panel."""
    return _PAGE.format(
        title="flexstage",
        head='<meta http-equiv="refresh" content="0; url=/">',
        body='<p><a href="/">To the front panel</a></p>',
    )


def page_of_password(action: str, said: str = "") -> str:
    """Return the page that asks for the password, with what was wrong before."""
    alert = f'<p role="alert">{escape(said.capitalize())}.</p>' if said else ""
    return _PAGE.format(
        title="flexstage: password",
        head="",
        body=f'{alert}<form method="post" action="{action}"><label>Password'
        '<input type="password" name="password" autocomplete="current-password" required autofocus>'
        "</label><button>Open the front panel</button></form>",
    )


def page_of_refusal(reason: str, enter: str | None = None) -> str:
    """Return the page that says why a request was refused, and how to come in."""
    way = (
        f'<p><a href="{enter}">Enter the password</a>.</p>'
        if enter
        else "<p>Open the newest address that <code>flexstage serve</code> printed; each opens the "
        "panel once, in one browser.</p>"
    )
    return _PAGE.format(
        title="flexstage: refused", head="", body=f"<p>Refused: {escape(reason)}.</p>{way}"
    )


#: Refusals are logged here.
LOG = logging.getLogger("flexstage.web")

#: Where the session of a request stands in its scope.
SESSION = "flexstage.session"

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

_PASSWORD_PAGE = "/enter"
_LONGEST_FORM = 4096
_METHODS = frozenset({"GET", "HEAD", "POST"})

# NiceGUI builds its pages of inline scripts, and its `nicegui.js` evaluates what the server sends:
# properties, handlers and calls (`eval`, `new Function`); there is no build of it without. Nothing
# comes from elsewhere, and no other page may frame this one.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "media-src 'self' blob:; worker-src 'self' blob:; frame-src 'self' blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
# the pages of the gate have no script
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


class Refused(Exception):  # noqa: N818 - no error of the program: a request that is not let in
    """A request is not let in: a status and the reason, in a sentence."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class Gate:
    """An ASGI application before the panel: it lets requests of a session through, of its own page.

    Parameters
    ----------
    app
        The panel.
    options
        By which names it may be called, and how large a request may be.
    access
        Tokens, sessions and the password.
    opened
        Called when a token was used, to make the next one.
    """

    def __init__(
        self,
        app: Callable[[Scope, Receive, Send], Awaitable[None]],
        options: PanelOptions,
        access: Access,
        opened: Callable[[], object] = lambda: None,
    ) -> None:
        self.app, self._options, self._access, self._opened = app, options, access, opened

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        try:
            if await self._entered(scope, receive, send):
                return
            scope[SESSION] = self._session(scope)
        except Refused as refused:
            await self._refuse(scope, send, refused)
            return
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._limited(scope, receive, send)

    async def _entered(self, scope: Scope, receive: Receive, send: Send) -> bool:
        """Check what every request must have; answer those that come to be let in."""
        _require_plain_path(scope)
        self._require_own_host(scope)
        _require_own_origin(scope)
        if scope["type"] != "http":
            return False
        if scope["method"] not in _METHODS:
            raise Refused(405, f"the method {scope['method'][:20]} is none that the panel has")
        self._require_length(scope)
        path = scope["path"]
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token")
        if path == "/" and token and scope["method"] == "GET":
            if not self._access.spend(token[0]):
                if self._access.session(_secret(scope)):
                    return False
                raise Refused(401, "this address was opened before, or is not of this server")
            self._opened()
            await self._let_in(scope, send)
            return True
        if path == _PASSWORD_PAGE and self._access.has_password:
            if scope["method"] == "POST":
                await self._by_password(scope, receive, send)
            else:
                await _page(send, 200, page_of_password(_PASSWORD_PAGE))
            return True
        return False

    async def _by_password(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = b""
        while len(body) <= _LONGEST_FORM:
            message = await receive()
            body += message.get("body", b"")
            if not message.get("more_body"):
                break
        given = parse_qs(body[:_LONGEST_FORM].decode("utf-8", "replace")).get("password", [""])[0]
        right = self._access.is_password(given, _client(scope))
        if right:
            await self._let_in(scope, send)
            return
        said = "too many wrong passwords: wait a minute" if right is None else "wrong password"
        LOG.warning("refused %s: %s", _told(scope), said)
        status = 429 if right is None else 401
        await _page(send, status, page_of_password(_PASSWORD_PAGE, said))

    async def _let_in(self, scope: Scope, send: Send) -> None:
        secret = self._access.open_session()
        cookie = f"{_cookie_name(scope)}={secret}; HttpOnly; SameSite=Strict; Path=/"
        if scope.get("scheme") == "https":
            cookie += "; Secure"
        # a page that goes on by itself: behind a redirect from a link in another page the browser
        # would hold the strict cookie back
        await _page(send, 200, page_of_entrance(), (b"set-cookie", cookie.encode()))

    def _session(self, scope: Scope) -> object:
        session = self._access.session(_secret(scope))
        if session is None:
            raise Refused(401, "no session: the front panel is opened by the address it printed")
        return session

    def _require_own_host(self, scope: Scope) -> None:
        given = _all(scope, b"host")
        try:
            parts = urlsplit(f"//{given[0]}") if len(given) == 1 else None
            name = parts.hostname if parts and not (parts.path or parts.query) else None
            port = parts.port if parts else None
        except ValueError:
            name = port = None
        if not name or "@" in given[0]:
            raise Refused(400, "the request does not say which host it is for")
        own_port = (scope.get("server") or (None, None))[1]
        usual = 443 if self._options.scheme == "https" else 80
        behind = name.casefold() in {n.casefold() for n in self._options.host_name}
        if not self._options.is_own_name(name) or not (behind or (port or usual) == own_port):
            raise Refused(421, f"the front panel is not called '{given[0][:80]}'")

    def _require_length(self, scope: Scope) -> None:
        given = _all(scope, b"content-length")
        if any(not text.isascii() or not text.isdigit() for text in given) or len(given) > 1:
            raise Refused(400, "the length of the request is no number")
        if given and int(given[0]) > self._options.upload_limit:
            raise Refused(413, self._too_large())

    def _too_large(self) -> str:
        return f"a request may have {self._options.upload_limit / 2**20:.0f} MB at most"

    async def _limited(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request whose body is cut off where it is too large, however it is sent."""
        got, over, answered = 0, False, False

        async def counted() -> MutableMapping[str, Any]:
            nonlocal got, over, answered
            message = await receive()
            got += len(message.get("body", b""))
            if got <= self._options.upload_limit:
                return message
            if not over and not answered:
                await self._refuse(scope, send, Refused(413, self._too_large()))
            over = answered = True
            return {"type": "http.disconnect"}

        async def guarded(message: MutableMapping[str, Any]) -> None:
            nonlocal answered
            if over:
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
            if not over:
                raise

    async def _refuse(self, scope: Scope, send: Send, refused: Refused) -> None:
        LOG.warning("refused %s: %s", _told(scope), refused.reason)
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
            return
        enter = _PASSWORD_PAGE if self._access.has_password and refused.status == 401 else None
        await _page(send, refused.status, page_of_refusal(refused.reason, enter))


def _require_plain_path(scope: Scope) -> None:
    raw = scope.get("raw_path") or scope["path"].encode("utf-8", "replace")
    path = raw.decode("latin-1")
    for _ in range(3):  # also where it is encoded twice
        if "\\" in path or "\0" in path or ".." in path.split("/"):
            raise Refused(400, "the path leaves the panel")
        path = unquote(path)


def _require_own_origin(scope: Scope) -> None:
    """Refuse what a page of another site sends: browsers say where a request comes from."""
    changes = scope["type"] == "websocket" or scope.get("method") not in {"GET", "HEAD"}
    origins, host = _all(scope, b"origin"), _all(scope, b"host")[0]
    for origin in origins:
        parts = urlsplit(origin)
        if parts.scheme not in {"http", "https"} or parts.netloc.casefold() != host.casefold():
            raise Refused(403, f"another page sent it: '{origin[:80]}'")
    if changes and not origins:
        raise Refused(403, "it does not say which page sent it")
    sites, modes = _all(scope, b"sec-fetch-site"), _all(scope, b"sec-fetch-mode")
    foreign = any(site in {"cross-site", "same-site"} for site in sites)
    if foreign and (changes or modes != ["navigate"]):
        raise Refused(403, "a page of another site sent it")


def _all(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


def _cookie_name(scope: Scope) -> str:
    # cookies do not tell ports apart: two panels on one computer have one each
    return f"flexstage-{(scope.get('server') or ('', 0))[1]}"


def _secret(scope: Scope) -> str:
    try:
        cookie = SimpleCookie("; ".join(_all(scope, b"cookie")))
    except CookieError:
        return ""
    found = cookie.get(_cookie_name(scope))
    return found.value if found else ""


def _client(scope: Scope) -> str:
    return str((scope.get("client") or ("unknown",))[0])


def _told(scope: Scope) -> str:
    """Say who asked for what, without what may be secret."""
    what = scope.get("method", "websocket")
    return f"{what} {scope['path'][:120]!a} of {_client(scope)}"


async def _page(send: Send, status: int, html: str, *more: tuple[bytes, bytes]) -> None:
    headers = [(b"content-type", b"text/html; charset=utf-8"), (b"cache-control", b"no-store")]
    headers.append((b"content-security-policy", _PLAIN_POLICY.encode()))
    await send(
        {"type": "http.response.start", "status": status, "headers": [*headers, *_HEADERS, *more]}
    )
    await send({"type": "http.response.body", "body": html.encode()})
