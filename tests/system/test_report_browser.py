"""The report in a browser: it opens without a complaint or a load, and its modes move."""

import base64
import json
import os
import re
import select
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.studies import page_of

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    # what a graphics card draws is drawn without one
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--window-size=1280,900",
    "--remote-debugging-pipe",
)
fcntl = pytest.importorskip("fcntl", reason="the browser is spoken to through POSIX pipes")
PATIENCE = 60.0


class Browser:
    """A browser without a window, spoken to through a pair of pipes (DevTools protocol)."""

    def __init__(self, program: str, profile: Path) -> None:
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        # the browser reads from descriptor 3 and writes to 4; out of their way first
        high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs_in, theirs_out)]
        actions = [(os.POSIX_SPAWN_OPEN, n, os.devnull, os.O_RDWR, 0) for n in (0, 1, 2)]
        actions += [(os.POSIX_SPAWN_DUP2, end, n) for end, n in zip(high, (3, 4), strict=True)]
        arguments = [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self._process = os.posix_spawn(program, arguments, os.environ, file_actions=actions)
        for end in (theirs_in, theirs_out, *high):
            os.close(end)
        self._count = 0
        self._rest = b""
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def run(self, script: str) -> Any:
        result = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def named(self, *methods: str) -> list[dict[str, Any]]:
        return [event for event in self.events if event.get("method") in methods]

    def close(self) -> None:
        os.close(self._out)
        os.close(self._in)
        end = time.monotonic() + 10.0
        os.kill(self._process, signal.SIGTERM)
        while os.waitpid(self._process, os.WNOHANG) == (0, 0):
            if time.monotonic() > end:
                os.kill(self._process, signal.SIGKILL)
            time.sleep(0.05)

    def _read(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(end - time.monotonic(), 0.0))
            assert ready, f"the browser said nothing for {PATIENCE:.0f} s"
            more = os.read(self._in, 1 << 16)
            assert more, "the browser ended"
            self._rest += more
        first, self._rest = self._rest.split(b"\0", 1)
        return json.loads(first)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(BROWSERS)})")
    started = Browser(program, tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


WAIT = "new Promise(done => setTimeout(done, {}))"
LOADED = """new Promise(done => document.readyState === "complete" ? done() :
    window.addEventListener("load", () => done()))"""
SETUP = """
var group = document.querySelector(".modes:not([hidden])");
var use = Array.from(group.querySelectorAll("use.moving")).find(
    u => Math.abs(Number(u.dataset.motion.split(" ")[0])) > 1);
var place = () => use.getAttribute("transform");
var press = text => Array.from(document.querySelectorAll("button")).find(
    b => b.textContent === text).click();
"""


@pytest.mark.slow
def test_the_report_opens_and_its_modes_move(browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    file.write_text(page_of("vgtu-piezo"), encoding="utf-8")
    browser.call("Page.navigate", url=file.as_uri())
    browser.run(LOADED)
    browser.run(SETUP)

    seen = set()
    for _ in range(5):
        seen.add(browser.run("place()"))
        browser.run(WAIT.format(120))
    assert len(seen) > 2, "the modes do not move"

    browser.run('press("Pause")')
    still = browser.run("place()")
    browser.run(WAIT.format(200))
    assert browser.run("place()") == still
    browser.run('press("Play")')
    browser.run(WAIT.format(200))
    assert browser.run("place()") != still

    browser.run('press("Pause")')
    browser.run(
        'var a = document.getElementById("amplitude"); a.value = 0;'
        'a.dispatchEvent(new Event("input"))'
    )
    numbers = browser.run("place().match(/-?[0-9.]+/g).slice(0, 3).map(Number)")
    assert numbers == [0, 0, 0]

    browser.run('press("drives locked")')
    groups = 'document.querySelectorAll(".modes:not([hidden])")'
    assert browser.run(f"Array.from({groups}, g => g.dataset.condition)") == ["locked"]

    # chapters are folded, and unfold for paper and for whoever asks for one
    closed = (
        'Array.from(document.querySelectorAll(".chapter > details")).filter(d => !d.open).length'
    )
    folded = browser.run(closed)
    assert folded >= 6
    browser.run('window.dispatchEvent(new Event("beforeprint"))')
    assert browser.run(closed) == 0
    browser.run('window.dispatchEvent(new Event("afterprint"))')
    assert browser.run(closed) == folded
    browser.run('location.hash = "#dynamics"')
    browser.run(WAIT.format(200))
    assert browser.run('document.querySelector("#dynamics > details").open')
    pages = base64.b64decode(browser.call("Page.printToPDF")["data"])
    assert 2 <= len(re.findall(rb"/Type /Page\b", pages)) <= 10
    browser.run('press("Expand all")')
    assert browser.run(closed) == 0

    # nothing is wider than the window, nothing but the page was asked for, nobody complained
    root = "document.documentElement"
    assert browser.run(f"{root}.scrollWidth - {root}.clientWidth") <= 0
    asked = {e["params"]["request"]["url"] for e in browser.named("Network.requestWillBeSent")}
    assert {url for url in asked if not url.startswith("data:")} == {file.as_uri()}
    assert not browser.named(
        "Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"
    )


@pytest.mark.slow
def test_lines_of_a_sweep_are_brushed_and_saved(browser: Browser, tmp_path: Path) -> None:
    from flexstage.report.sweep import sweep_html
    from flexstage.stage.designs import StageTemplate
    from flexstage.studies.explore import Family, Figure, SweepPlan, sweep, variables_of

    template = StageTemplate.of("parallelogram")
    necks = variables_of(template, ["leg.notch.neck_thickness=0.3..0.5 mm", "leg_spacing=20 %"])
    found = sweep(
        Family(template=template, variables=necks),
        [Figure(quantity=q, axis="x") for q in ("natural_frequency_hz", "max_stress")],
        SweepPlan(sampling="grid", samples=16),
    )
    file = tmp_path / "sweep.html"
    file.write_text(sweep_html(found), encoding="utf-8")
    browser.events.clear()
    browser.call("Page.navigate", url=file.as_uri())
    browser.run(LOADED)
    browser.run(
        'var lines = document.getElementById("parallel-coordinates");'
        'var spread = range => Plotly.restyle(lines, "dimensions[0].constraintrange", [range]);'
        'var picture = () => Plotly.toImage(lines, {format: "png"});'
    )
    browser.run(WAIT.format(500))
    assert browser.run("lines.data[0].dimensions.length") == 4
    # with a stretch of an axis other lines are drawn: so the lines are drawn at all
    whole = browser.run("picture()")
    browser.run("spread([0.3, 0.35]).then(() => true)")
    browser.run(WAIT.format(500))
    part = browser.run("picture()")
    assert whole.startswith("data:image/png")
    assert part != whole
    # what the menu does: another figure colours the lines
    browser.run(
        "Plotly.restyle(lines, lines.layout.updatemenus[0].buttons[3].args[0]).then(() => true)"
    )
    browser.run(WAIT.format(300))
    assert browser.run("picture()") != part
    stress = "lines.data[0].dimensions[3].values"
    assert browser.run("lines.data[0].line.color[1]") == browser.run(f"{stress}[1]")

    asked = {e["params"]["request"]["url"] for e in browser.named("Network.requestWillBeSent")}
    loaded = {url for url in asked if not url.startswith(("data:", "blob:"))}
    assert loaded == {file.as_uri()}
    assert not browser.named("Runtime.exceptionThrown", "Runtime.consoleAPICalled")
    # a reader of pixels without a graphics card is told that it is slow
    entries = [event["params"]["entry"] for event in browser.named("Log.entryAdded")]
    assert [e for e in entries if e["level"] == "error" or e["source"] != "rendering"] == []
