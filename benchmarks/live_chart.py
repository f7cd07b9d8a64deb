"""A live chart: what a page and the server take while it follows, for one viewer and for ten.

`python -m benchmarks.live_chart` serves one hour of 100 Hz and four channels, which goes on, and
opens it in Chromium (`scripts/debian-packages.sh`), which draws without a graphics card. Then nine
viewers come in from elsewhere: they ask as a page does, and draw nothing. Last, all ten are windows
of Chromium on this computer. Shares are of one core; ages are those of the newest sample of a page.
"""

import argparse
import contextlib
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
import psutil

__all__ = ["Shown", "live_chart"]

SECONDS = 3600.0
WINDOWS = ("10 s", "1 min", "10 min", "1 h")
VIEWERS = 10
_SIZE = {"width": 1280, "height": 800}

#: Notes how old the newest sample of the page is.
_NOTE = """() => {
  window.ages = [];
  const live = document.querySelector(".live-chart").live;
  window.noting = setInterval(() => ages.push(Date.now() / 1000 - live.latest.newest), 100);
}"""
_NOTED = "() => { clearInterval(noting); return ages }"
_COUNTS = """() => {
  const live = document.querySelector(".live-chart").live;
  return [live.answers, live.frames];
}"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What viewers of one window took; of pages the mean, of ages those of all viewers."""

    viewers: str
    window: str
    followed_hz: float
    drawn_hz: float
    page: float
    browser: float
    page_mb: float
    heap_mb: float
    server: float
    age: float
    oldest: float


def live_chart(windows: tuple[str, ...] = WINDOWS, seconds: float = 10.0) -> Iterator[Shown]:
    """Look at a live chart, alone with each window and then with others."""
    from tests.live_panel import served_live
    from tests.panel import browser

    with (
        tempfile.TemporaryDirectory() as folder,
        browser() as running,
        served_live(Path(folder), SECONDS, charts=1) as (address, served),
    ):
        process = psutil.Process(served.pid)
        first = running.new_context(viewport=_SIZE)
        page = first.new_page()
        page.goto(address)
        page.get_by_role("link", name="Live").click()
        pages = [page]
        for window in windows:
            yield _looked(running, pages, process, window, seconds)
        state = first.storage_state()
        with _others(page, state, VIEWERS - 1) as ages:
            yield _looked(running, pages, process, windows[-1], seconds, ages)
        while len(pages) < VIEWERS:
            # of its own window: the pages behind another one in a window are not drawn
            pages.append(running.new_context(viewport=_SIZE, storage_state=state).new_page())
            pages[-1].goto(page.url)
        yield _looked(running, pages, process, windows[-1], seconds)


@contextlib.contextmanager
def _others(page: Any, state: Any, count: int) -> Iterator[list[float]]:
    """Let viewers in that ask as a page does; give the ages of what they get."""
    address = urlsplit(page.url).netloc
    path = page.evaluate("document.querySelector('.live-chart').live.address")
    (cookie,) = state["cookies"]
    headers = {"Cookie": f"{cookie['name']}={cookie['value']}"}
    asked = {"mode": "time", "length": f"{SECONDS:g}"}
    over, ages = threading.Event(), list[float]()

    def view() -> None:
        connection, known = HTTPConnection(address), dict[str, str]()
        while not over.is_set():
            began = time.time()
            connection.request("GET", f"{path}?{urlencode(asked | known)}", headers=headers)
            body = connection.getresponse().read()
            head = np.frombuffer(body, "<f8", 9)
            count, channels = int(head[6]), 4
            if count > 1:
                last = np.frombuffer(body, "<f8", count, 8 * (9 + channels))[-2]
                given = zip(("generation", "tier", "after"), (*head[:2], last), strict=True)
                known = {n: repr(float(v)) if n == "after" else str(int(v)) for n, v in given}
            ages.append(time.time() - head[3])
            over.wait(max(began + 0.04 - time.time(), 0.0))

    threads = [threading.Thread(target=view) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield ages
    finally:
        over.set()
        for thread in threads:
            thread.join()


def _looked(
    running: Any,
    pages: list[Any],
    server: psutil.Process,
    window: str,
    seconds: float,
    others: list[float] | None = None,
) -> Shown:
    for page in pages:
        page.get_by_role("button", name=window, exact=True).click()
    pages[0].wait_for_timeout(3000)
    system = running.new_browser_cdp_session()
    for page in pages:
        page.evaluate(_NOTE)
    began, counts = time.monotonic(), [page.evaluate(_COUNTS) for page in pages]
    asked = len(others or [])
    before, served = _busy(system), sum(server.cpu_times()[:2])
    pages[0].wait_for_timeout(1e3 * seconds)
    took = time.monotonic() - began
    after, served = _busy(system), sum(server.cpu_times()[:2]) - served
    counted = [page.evaluate(_COUNTS) for page in pages]
    ages = [age for page in pages for age in page.evaluate(_NOTED)] + (others or [])[asked:]
    used = {pid: busy - before[pid][1] for pid, (_, busy) in after.items() if pid in before}
    drawing = [pid for pid in used if after[pid][0] == "renderer" and used[pid] > 0.01 * took]
    rates = [
        [(b - a) / took for a, b in zip(*both, strict=True)]
        for both in zip(counts, counted, strict=True)
    ]
    heaps = [page.evaluate("performance.memory.usedJSHeapSize") for page in pages]
    return Shown(
        viewers=f"{len(pages)}" if others is None else f"{len(pages)} + {VIEWERS - 1}",
        window=window,
        followed_hz=statistics.mean(rate[0] for rate in rates),
        drawn_hz=statistics.mean(rate[1] for rate in rates),
        page=sum(used[pid] for pid in drawing) / took / len(pages),
        browser=sum(used.values()) / took,
        page_mb=max(psutil.Process(pid).memory_info().rss for pid in drawing) / 1e6,
        heap_mb=max(heaps) / 1e6,
        server=served / took,
        age=statistics.median(ages),
        oldest=statistics.quantiles(ages, n=20)[-1],
    )


def _busy(system: Any) -> dict[int, tuple[str, float]]:
    """Return the kind and the processor time of each process of the browser."""
    found = system.send("SystemInfo.getProcessInfo")["processInfo"]
    return {process["id"]: (process["type"], process["cpuTime"]) for process in found}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live_chart", description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each line")
    options = parser.parse_args()
    print(
        "viewers  window  followed    drawn     page  browser    memory  JS heap  server  age, 95 %"
    )
    for row in live_chart(seconds=options.seconds):
        print(
            f"{row.viewers:>7}  {row.window:>6}  {row.followed_hz:5.1f} Hz  {row.drawn_hz:5.1f} Hz"
            f"  {row.page:6.1%}  {row.browser:7.0%}  {row.page_mb:5.0f} MB  {row.heap_mb:4.0f} MB"
            f"  {row.server:6.1%}  {1e3 * row.age:.0f} ms, {1e3 * row.oldest:.0f} ms",
            flush=True,
        )


if __name__ == "__main__":
    main()
