"""The front panel in a browser: each view's main task, at all sizes, light and dark."""

import shutil
import ssl
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from tests.panel import browser, looked_at, served

pytestmark = pytest.mark.slow


def test_the_shell_is_sound_and_works_by_keyboard(tmp_path: Path) -> None:
    with looked_at(tmp_path) as look:
        look.require_sound("shell")
        page = look.page
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "To the content"
        page.get_by_role("button", name="Units and look").click()
        page.get_by_role("combobox", name="Look").click()
        page.get_by_role("option", name="dark").click()
        page.wait_for_selector("body.body--dark")
        page.reload()
        page.wait_for_selector("body.body--dark")
        assert not look.complaints


def test_a_used_address_and_a_foreign_page_are_refused(tmp_path: Path) -> None:
    with browser() as running, served(tmp_path) as (address, process):
        first = running.new_context().new_page()
        first.goto(address)
        first.wait_for_selector("main.view h1")
        again = running.new_context().new_page()
        assert again.goto(address).status == 401
        assert "opens the panel once" in again.inner_text("main")
        assert process.stdout is not None
        # the next address was printed when the first one was used
        assert "token=" in process.stdout.readline()
        base = "{0.scheme}://{0.netloc}".format(urlsplit(address))
        foreign = {"Origin": "http://lab.example"}
        assert httpx.post(f"{base}/", headers=foreign).status_code == 403
        assert httpx.get(f"{base}/", headers={"Host": "lab.example"}).status_code == 421
        assert httpx.post(f"{base}/", headers={"Origin": base}, content=b"x").status_code == 401
        # what is no request at all ends its connection, and nothing else
        first.reload()
        first.wait_for_selector("main.view h1")
    told = (tmp_path / "panel.log").read_text()
    assert told.count("refused") >= 4
    assert "Traceback" not in told


def test_it_is_served_with_a_password_over_tls(tmp_path: Path) -> None:
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("there is no openssl to make a certificate with")
    made = "req -x509 -newkey rsa:2048 -nodes -subj /CN=localhost -keyout key.pem -out cert.pem"
    subprocess.run([openssl, *made.split()], cwd=tmp_path, check=True, capture_output=True)
    (tmp_path / "password.txt").write_text("a long password\n", encoding="utf-8")
    options = ("--host", "0.0.0.0", "--password-file", str(tmp_path / "password.txt"))
    options += ("--certificate", str(tmp_path / "cert.pem"), "--key", str(tmp_path / "key.pem"))
    with served(tmp_path, *options) as (address, _):
        assert address.startswith("https://")
        base = "{0.scheme}://{0.netloc}".format(urlsplit(address))
        trusted = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
        trusted.check_hostname = False
        with httpx.Client(base_url=base, verify=trusted, headers={"Origin": base}) as client:
            assert client.get("/").status_code == 401
            assert client.post("/enter", data={"password": "wrong"}).status_code == 401
            assert client.post("/enter", data={"password": "a long password"}).status_code == 200
            assert client.get("/").headers["X-Nicegui-Content"] == "page"
