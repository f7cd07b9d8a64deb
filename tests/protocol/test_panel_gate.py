"""The gate of the front panel: nobody comes in unasked, and nothing from another page."""

import asyncio
import stat
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from urllib.request import url2pathname

import httpx
import pytest

from flexstage import web
from flexstage.base.errors import ModelError
from flexstage.cli import main
from flexstage.files.request import request_of
from flexstage.web.access_control import LOG, SESSION, AccessControl
from flexstage.web.options import Certificate, PanelOptions
from flexstage.web.sessions import Access, Session

HERE = "http://127.0.0.1:8321"
PASSWORD = "correct horse"


class Behind:
    """What stands behind the gate: it answers, and remembers who asked."""

    def __init__(self) -> None:
        self.sessions: list[Session] = []
        self.bodies: list[bytes] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.sessions.append(scope[SESSION])
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            return
        body, more = b"", True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise ConnectionError("gone")
            body += message.get("body", b"")
            more = message.get("more_body", False)
        self.bodies.append(body)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"the panel"})


class Door:
    """A gate with something behind it, and a client before it."""

    def __init__(self, **options: Any) -> None:
        self.options = PanelOptions(folder=Path("files"), **options)
        self.access = Access(self.options.password, clock=lambda: self.now)
        self.behind, self.opened, self.now = Behind(), 0, 0.0
        self.gate = AccessControl(self.behind, self.options, self.access, self._open)

    def _open(self) -> None:
        self.opened += 1

    def run(self, visit: Callable[[httpx.AsyncClient], Awaitable[None]], base: str = HERE) -> None:
        async def inside() -> None:
            transport = httpx.ASGITransport(self.gate, client=("127.0.0.1", 50123))
            async with httpx.AsyncClient(transport=transport, base_url=base) as client:
                await visit(client)

        asyncio.run(inside())

    def inside(self, visit: Callable[[httpx.AsyncClient], Awaitable[None]]) -> None:
        """Call a function with a client that has come in."""

        async def entered(client: httpx.AsyncClient) -> None:
            await client.get("/", params={"token": self.access.new_token()})
            await visit(client)

        self.run(entered)

    def status(self, method: str = "GET", path: str = "/", **given: Any) -> int:
        """Return how a request of one who has come in is answered."""
        found: list[int] = []

        async def ask(client: httpx.AsyncClient) -> None:
            found.append((await client.request(method, path, **given)).status_code)

        self.inside(ask)
        return found[0]

    def handshake(self, **headers: str) -> str:
        """Return what a websocket is answered, with the cookie of one who has come in."""
        return self.on_the_wire("/_nicegui_ws/socket.io/", "websocket", **headers)["type"]

    def on_the_wire(self, path: str, kind: str = "http", **headers: str) -> Any:
        """Return the first answer to a request that no client has tidied."""
        answers: list[Any] = []

        async def ask(client: httpx.AsyncClient) -> None:
            cookies = "; ".join(f"{k}={v}" for k, v in client.cookies.items())
            given = {"host": "127.0.0.1:8321", "cookie": cookies} | headers
            scope = {
                "type": kind,
                "method": "GET",
                "path": unquote(path),
                "raw_path": path.encode(),
                "query_string": b"",
                "headers": [(k.encode(), v.encode()) for k, v in given.items()],
                "server": ("127.0.0.1", 8321),
                "client": ("127.0.0.1", 50124),
                "scheme": "http",
            }

            async def receive() -> dict[str, Any]:
                return {"type": f"{kind}.{'request' if kind == 'http' else 'connect'}"}

            async def send(message: Any) -> None:
                answers.append(message)

            await self.gate(scope, receive, send)

        self.inside(ask)
        return answers[0]


@pytest.fixture(autouse=True)
def _heard(monkeypatch: pytest.MonkeyPatch) -> None:
    # libraries that other tests use switch off the loggers that they find
    monkeypatch.setattr(LOG, "disabled", False)


def test_without_a_token_nothing_is_seen(caplog: pytest.LogCaptureFixture) -> None:
    door = Door()

    async def visit(client: httpx.AsyncClient) -> None:
        for path in ("/", "/bench", "/_nicegui/3/static/nicegui.js", "/_nicegui/client/1/upload/2"):
            assert (await client.get(path)).status_code == 401
        client.cookies.set("flexstage-8321", "guessed")
        assert (await client.get("/")).status_code == 401
        post = await client.post("/_nicegui/client/1/upload/2", headers={"origin": HERE})
        assert post.status_code == 401

    door.run(visit)
    assert not door.behind.sessions
    assert "refused GET '/bench' of 127.0.0.1: no session" in caplog.text


def test_a_token_opens_once_and_its_cookie_goes_nowhere_else() -> None:
    door = Door()
    token = door.access.new_token()

    async def visit(client: httpx.AsyncClient) -> None:
        entered = await client.get("/", params={"token": token})
        cookie = entered.headers["set-cookie"]
        assert entered.status_code == 200
        assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
        assert (await client.get("/")).text == "the panel"
        # the browser of the same person reloads the address; another one has it too late
        assert (await client.get("/", params={"token": token})).status_code == 200
        client.cookies.clear()
        assert (await client.get("/", params={"token": token})).status_code == 401

    door.run(visit)
    assert door.opened == 1


def test_each_browser_has_a_session_of_its_own() -> None:
    door = Door()

    async def visit(client: httpx.AsyncClient) -> None:
        await client.get("/")

    door.inside(visit)
    door.inside(visit)
    assert len({session.id for session in door.behind.sessions}) == 2


@pytest.mark.parametrize(
    "host",
    ["lab.example", "127.0.0.1.lab.example:8321", "127.0.0.1:80", "me@127.0.0.1:8321", "x y", ":"],
)
def test_another_name_for_this_computer_is_refused(host: str) -> None:
    assert Door().status(headers={"host": host}) in {400, 421}


@pytest.mark.parametrize("host", ["localhost:8321", "127.0.0.1:8321", "[::1]:8321"])
def test_its_own_names_are_known(host: str) -> None:
    assert Door().status(headers={"host": host}) == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://lab.example"},
        {"origin": "http://127.0.0.1:9999"},
        {"origin": "null"},
        {"origin": HERE, "sec-fetch-site": "cross-site"},
        {"origin": HERE, "sec-fetch-site": "same-site"},
        {},
    ],
)
def test_what_another_page_sends_is_refused(headers: dict[str, str]) -> None:
    door = Door()
    assert door.status("POST", "/upload", headers=headers, content=b"x") == 403
    assert not door.behind.bodies
    assert door.handshake(**headers) == "websocket.close"


def test_what_its_own_page_sends_comes_through() -> None:
    door = Door()
    own = {"origin": HERE, "sec-fetch-site": "same-origin"}
    assert door.status("POST", "/upload", headers=own, content=b"stage") == 200
    assert door.behind.bodies == [b"stage"]
    assert door.handshake(origin=HERE) == "websocket.accept"


def test_a_websocket_without_a_session_is_refused() -> None:
    assert Door().handshake(origin=HERE, cookie="flexstage-8321=guessed") == "websocket.close"


def test_a_link_from_another_page_may_open_it_but_reads_nothing() -> None:
    link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert Door().status(headers=link) == 200
    assert Door().status(headers=link | {"sec-fetch-mode": "no-cors"}) == 403


@pytest.mark.parametrize(
    "path",
    [
        "/../etc/passwd",
        "/static/..%2f..%2fetc/passwd",
        "/static/%2e%2e/%2e%2e/x",
        "/static/%252e%252e/x",
        "/a\\..\\b",
        "/a%00b",
    ],
)
def test_a_path_that_leaves_is_refused(path: str) -> None:
    assert Door().on_the_wire(path)["status"] == 400


def test_a_path_with_dots_in_a_name_is_none_of_them() -> None:
    assert Door().on_the_wire("/static/..panel...css")["status"] == 200


def test_a_large_request_is_refused_however_it_is_sent() -> None:
    door = Door(upload_limit=1000)
    own = {"origin": HERE}
    assert door.status("POST", "/upload", headers=own, content=b"x" * 1000) == 200
    assert door.status("POST", "/upload", headers=own, content=b"x" * 1001) == 413

    async def pieces() -> Any:
        for _ in range(5):
            yield b"x" * 400

    assert door.status("POST", "/upload", headers=own, content=pieces()) == 413
    assert len(door.behind.bodies) == 1
    lying = own | {"content-length": "-5"}
    assert door.status("POST", "/upload", headers=lying, content=b"x") == 400


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE"])
def test_other_methods_are_refused(method: str) -> None:
    assert Door().status(method, headers={"origin": HERE}) == 405


def test_answers_say_what_a_browser_may_do_with_them() -> None:
    async def visit(client: httpx.AsyncClient) -> None:
        headers = (await client.get("/")).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "frame-ancestors 'self'" in policy
        assert "http:" not in policy
        assert "*" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"

    Door().inside(visit)


def test_the_pages_of_the_gate_run_no_script() -> None:
    async def visit(client: httpx.AsyncClient) -> None:
        client.cookies.clear()
        refused = await client.get("/")
        assert refused.status_code == 401
        (policy,) = refused.headers.get_list("content-security-policy")
        assert "default-src 'none'" in policy
        assert "script-src" not in policy
        assert "unsafe-eval" not in policy

    Door().inside(visit)


@pytest.mark.skipif(sys.platform == "win32", reason="no modes of files")
def test_the_address_that_lets_in_stands_in_no_argument_of_the_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, int, str]] = []

    def browse(address: str) -> None:
        file = Path(url2pathname(urlsplit(address).path))
        opened.append((address, stat.S_IMODE(file.stat().st_mode), file.read_text()))

    def serve_panel(options: PanelOptions, announce: Callable[[str], object]) -> None:
        announce("http://127.0.0.1:8321/?token=once")
        announce("http://127.0.0.1:8321/?token=another")  # the first was used
        assert not list(options.folder.glob("*.html"))

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", browse)
    monkeypatch.setattr(web, "serve", serve_panel)
    with pytest.raises(SystemExit) as end:
        main(["serve", "--folder", str(tmp_path / "panel")])
    assert not end.value.code
    ((address, mode, text),) = opened
    assert address.startswith("file:")
    assert "token" not in address
    assert mode == 0o600
    assert 'url=http://127.0.0.1:8321/?token=once"' in text


def test_a_password_opens_it_and_guessing_ends(caplog: pytest.LogCaptureFixture) -> None:
    door = Door(address=("0.0.0.0", 8321), password=PASSWORD)
    own = {"origin": HERE}

    async def visit(client: httpx.AsyncClient) -> None:
        assert "password" in (await client.get("/enter")).text
        foreign = {"origin": "http://lab.example"}
        given = {"password": PASSWORD}
        assert (await client.post("/enter", data=given, headers=foreign)).status_code == 403
        for _ in range(5):
            wrong = await client.post("/enter", data={"password": "guess"}, headers=own)
            assert wrong.status_code == 401
        late = await client.post("/enter", data=given, headers=own)
        assert late.status_code == 429
        door.now = 61.0
        right = await client.post("/enter", data=given, headers=own)
        assert right.status_code == 200
        assert (await client.get("/")).text == "the panel"

    door.run(visit)
    assert "wrong password" in caplog.text
    assert PASSWORD not in caplog.text
    assert "guess" not in caplog.text


def test_without_a_password_there_is_no_such_page() -> None:
    async def visit(client: httpx.AsyncClient) -> None:
        given = {"password": ""}
        answer = await client.post("/enter", data=given, headers={"origin": HERE})
        assert answer.status_code == 401

    Door().run(visit)


def test_over_tls_the_cookie_stays_there() -> None:
    door = Door(tls=Certificate(certificate=Path("cert.pem"), key=Path("key.pem")))

    async def visit(client: httpx.AsyncClient) -> None:
        entered = await client.get("/", params={"token": door.access.new_token()})
        assert "Secure" in entered.headers["set-cookie"].split("; ")

    door.run(visit, "https://127.0.0.1:8321")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"address": ("0.0.0.0", 8321)}, "give a password"),
        ({"address": ("192.168.7.3", 8321), "password": "short"}, "10 letters or more, got 5"),
        ({"tls": {"certificate": Path("cert.pem")}}, "needs both a certificate and its key"),
        ({"address": ("127.0.0.1", 70000)}, r"\[HOST:\]PORT .* got .*70000"),
    ],
)
def test_options_that_leave_it_open_are_refused(given: dict[str, Any], told: str) -> None:
    with pytest.raises(ModelError, match=told):
        request_of(PanelOptions, None, {"folder": Path("files"), **given})


def test_a_named_host_is_known_and_a_foreign_one_is_not() -> None:
    options = PanelOptions(
        folder=Path("files"), address=("0.0.0.0", 8321), password=PASSWORD, host_name=("stage.lab",)
    )
    assert options.is_own_name("Stage.Lab")
    assert options.is_own_name("192.168.7.3")
    assert not options.is_own_name("lab.example")


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("--password-file", b"\xff\xfe\x00", "is not a text file in UTF-8"),
        ("--password-file", b"", "is empty: its first line is the password"),
        ("--tls", b"garbage", "are not a certificate and its private key"),
    ],
)
def test_files_that_are_none_are_refused_before_an_address_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, told: str
) -> None:
    file = tmp_path / "given.pem"
    file.write_bytes(content)
    given = f"certificate={file},key={file}" if name == "--tls" else str(file)
    with pytest.raises(SystemExit) as end:
        main(["serve", "--address", "0", "--no-open", name, given])
    said = capsys.readouterr()
    assert end.value.code == 2
    assert said.out == ""
    assert told in " ".join(said.err.split())
    assert "Traceback" not in said.err
