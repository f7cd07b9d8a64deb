"""A front panel for tests: without a browser, and served with a browser that looks at it."""

import asyncio
import contextlib
import gc
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

#: What the page must fit: a laptop, a tablet lying and standing.
SIZES = {"laptop": (1280, 800), "tablet": (1024, 768), "upright": (820, 1180)}
CHROMIUM = Path("/usr/bin/chromium")
OUT = Path(__file__).resolve().parent.parent / "out" / "web"
# faults of these weights are none that a page may have
_GRAVE = {"serious", "critical"}
HERE = "http://127.0.0.1:8321"
# jobs have the lowest priority: a few seconds of work take minutes beside other tests
_PATIENCE = 300.0


def simulated(folder: Path, body: Callable[[Any, Any], Awaitable[None]]) -> None:
    """Call a function with a simulated person in the panel (NiceGUI's `User`), and the panel."""

    async def run() -> None:
        async with person(folder) as (user, panel):
            await body(user, panel)

    asyncio.run(run())


@contextlib.asynccontextmanager
async def person(folder: Path) -> AsyncIterator[tuple[Any, Any]]:
    """Give a person with a session in a panel that is not served."""
    from nicegui import core
    from nicegui.testing.general import nicegui_reset_globals
    from nicegui.testing.user import User

    from flexstage.web.options import PanelOptions
    from flexstage.web.server import application

    with nicegui_reset_globals():
        # it has collected garbage, and does so again at its end: only that of this panel is new
        gc.freeze()
        os.environ["NICEGUI_USER_SIMULATION"] = "true"
        try:
            gate, panel = application(PanelOptions(folder=folder))
            _work_here(panel)
            async with core.app.router.lifespan_context(core.app):
                transport = httpx.ASGITransport(gate)
                async with httpx.AsyncClient(transport=transport, base_url=HERE) as client:
                    token = panel.access.new_token()
                    await client.get("/", params={"token": token})
                    yield User(client), panel
        finally:
            os.environ.pop("NICEGUI_USER_SIMULATION")
            panel.jobs.close()


def _work_here(panel: Any) -> None:
    """Let jobs run in threads: a process takes longer to start than their work.

    What they are given is copied as for another process, which tests in a browser have.
    """

    def start(name: str, function: Callable[..., Any], *arguments: Any, owner: str = "") -> Any:
        function, arguments = pickle.loads(pickle.dumps((function, arguments)))
        return panel.jobs.start_thread(name, function, *arguments, owner=owner)

    panel.jobs.start = start


@contextlib.contextmanager
def served(folder: Path, *options: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Serve the panel in a process of its own; give the address that opens it, and the process."""
    command = [sys.executable, "-m", "flexstage", "serve", "--address", "0", "--no-open", "--json"]
    with (folder / "panel.log").open("w") as log:
        process = subprocess.Popen(
            [*command, "--folder", str(folder / "files"), *options],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            assert line, (folder / "panel.log").read_text()
            yield json.loads(line)["address"], process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise
            finally:
                process.stdout.close()


#: Charts of Plotly, and live charts, which say what titles they drew.
_UNLABELLED = """
[...document.querySelectorAll('.js-plotly-plot')].flatMap(plot =>
  Object.entries(plot._fullLayout ?? {}).filter(([name, axis]) =>
    /^[xy]axis\\d*$/.test(name) && axis.visible && !axis.title?.text)).length
+ [...document.querySelectorAll('.live-chart canvas')].flatMap(canvas => {
    const axes = JSON.parse(canvas.dataset.axes ?? '[]');
    const letters = new Set(axes.map(({axis}) => axis[0]));
    return [...axes.map(({title}) => title), letters.has('x') && letters.has('y')];
  }).filter(title => !title).length
"""


class Look:
    """A page in a browser, with what is wrong with it."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("console", self._heard)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", self._asked)

    def _heard(self, message: Any) -> None:
        if message.type == "error":
            self.complaints.append(message.text)

    def _asked(self, request: Any) -> None:
        if not re.match(r"(https?|wss?)://127\.0\.0\.1:|data:|blob:", request.url):
            self.complaints.append(f"asked for {request.url}")

    def _evaluated(self, script: str, *arguments: Any) -> Any:
        """Evaluate in the page, again where it loaded itself anew after a lost connection."""
        from playwright.sync_api import Error

        for _ in range(3):
            try:
                return self.page.evaluate(script, *arguments)
            except Error as error:
                if "Execution context was destroyed" not in error.message:
                    raise
                self.page.wait_for_load_state()
        return self.page.evaluate(script, *arguments)

    def overflow(self) -> int:
        """Return by how many pixels the page is wider than its window."""
        return self._evaluated(
            "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )

    def shot(self, name: str) -> None:
        """Keep a picture of the whole page among the outputs of the tests."""
        OUT.mkdir(parents=True, exist_ok=True)
        self._evaluated("scrollTo(0, 0)")  # the bar stands where it is scrolled to
        self.page.screenshot(path=OUT / f"{name}.png", full_page=True)

    def unlabelled_axes(self) -> int:
        """Return how many axes of charts have no title; of a chart without axes, one."""
        return self._evaluated(_UNLABELLED)

    def grave_faults(self) -> list[str]:
        """Return serious faults of accessibility by axe-core."""
        from axe_playwright_python import base

        # a message that comes or goes has the contrast of neither
        self.page.wait_for_function(
            "() => [...document.querySelectorAll('.q-notification')]"
            ".every(e => getComputedStyle(e).opacity === '1')"
        )
        script = Path(base.__file__).with_name("axe.min.js").read_text(encoding="utf-8")
        # it takes the shade behind a dialog for the ground of what is placed inside
        dialog = self.page.locator(".q-dialog").count() > 0
        options = {
            "resultTypes": ["violations"],
            "rules": {"color-contrast": {"enabled": not dialog}},
        }
        found = self._evaluated(
            f"options => {{ {script}; return axe.run(document, options); }}", options
        )
        return [
            f"{fault['id']}: {node['failureSummary']}: {node['html'][:200]}"
            for fault in found["violations"]
            if fault["impact"] in _GRAVE
            for node in fault["nodes"]
        ]

    def require_sound(self, name: str) -> None:
        """Look at the page at all sizes, light, and dark at one: nothing sticks out or complains.

        What fits in the light fits in the dark.
        """
        # no tooltip that is on its way
        self.page.mouse.move(0, 0)
        for look, sizes in (("light", SIZES), ("dark", {"laptop": SIZES["laptop"]})):
            self.page.emulate_media(color_scheme=look)
            for size, (width, height) in sizes.items():
                self.page.set_viewport_size({"width": width, "height": height})
                self.page.wait_for_timeout(400)
                if size == "laptop":
                    self.shot(f"{name}-{look}")
                # a diagram follows the new width when the browser has time
                until(lambda: self.overflow() <= 0, f"{name} at {size} is too wide")
            faults = self.grave_faults()
            assert not faults, "\n".join(faults)
        assert self.unlabelled_axes() == 0
        assert not self.complaints, "\n".join(self.complaints)


@contextlib.contextmanager
def browser() -> Iterator[Any]:
    """Give a browser, or skip the test where there is none."""
    if not CHROMIUM.exists():
        pytest.skip(f"there is no browser at {CHROMIUM} (scripts/debian-packages.sh)")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-gpu"]
        )
        for name in ("new_context", "new_page"):
            setattr(running, name, _patient(getattr(running, name)))
        try:
            yield running
        finally:
            running.close()


def _patient(make: Callable[..., Any]) -> Callable[..., Any]:
    """Let what a browser makes wait as long as the slowest machine needs."""

    def made(**options: Any) -> Any:
        new = make(**options)
        new.set_default_timeout(_PATIENCE * 1e3)
        return new

    return made


@contextlib.contextmanager
def looked_at(folder: Path, *options: str) -> Iterator[Look]:
    """Serve the panel and give a browser's page of it, with a piezo stage opened in Design."""
    with browser() as running, served(folder, *options) as (address, _):
        # what moves takes the time of the server, and of tests beside this one
        page = running.new_page(reduced_motion="reduce")
        look = Look(page)
        page.goto(address)
        page.wait_for_selector("main.view h1")
        open_piezo_stage(page)
        yield look


def open_piezo_stage(page: Any) -> None:
    """Open it in Design, from any page."""
    page.get_by_role("navigation").get_by_role("link", name="Design").click()
    page.get_by_role("combobox", name="Design").fill("vgtu-piezo")
    page.get_by_role("option", name="vgtu-piezo", exact=True).click()
    page.get_by_role("heading", name="vgtu-piezo", exact=True).wait_for()


async def come(condition: Callable[[], Any]) -> None:
    """Wait until something holds, and let others work meanwhile."""
    end = time.monotonic() + _PATIENCE
    while not condition():
        assert time.monotonic() < end, "it never came"
        await asyncio.sleep(0.02)


def until(condition: Callable[[], bool], fault: str = "it never came") -> None:
    """Wait until something holds."""
    end = time.monotonic() + _PATIENCE
    while not condition():
        assert time.monotonic() < end, fault
        time.sleep(0.05)
