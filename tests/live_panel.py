"""A panel with a view of live charts, fed by no stage: `python -m tests.live_panel`."""

import argparse
import contextlib
import subprocess
import sys
import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexstage.web import server, shell, views
from flexstage.web.live_history import POSITION, VOLTAGE, LiveChannel, LiveHistory
from flexstage.web.options import PanelOptions
from flexstage.web.page import Page

RATE_HZ = 100.0
CHANNELS = (
    LiveChannel("x voltage", VOLTAGE),
    LiveChannel("y voltage", VOLTAGE),
    LiveChannel("x position", POSITION),
    LiveChannel("y position", POSITION),
)
_EVERY = 0.02  # from one reading to the next [s]


def values(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two voltages, and two positions that lag behind them, with noise."""
    # seconds since 1970 lose no digits that matter here
    turn = 2.0 * np.pi * np.mod(times, 1e5)
    x, y = 50.0 - 45.0 * np.cos(0.3 * turn), 50.0 - 30.0 * np.cos(0.07 * turn)
    noise = np.random.default_rng(int(1e3 * times[0])).standard_normal((2, times.size))
    across = 1e-6 * (0.6 * x - 3.0 * np.sin(0.3 * turn)) + 3e-8 * noise[0]
    return np.stack([x, y, across, -0.4e-6 * y + 1e-7 * noise[1]], axis=1)


def fed(seconds: float) -> LiveHistory:
    """Return a history of so long that goes on by itself; its times are those of the computer."""
    history = LiveHistory(CHANNELS, RATE_HZ)
    first = round((time.time() - seconds) * RATE_HZ)

    def until_now(first: int) -> int:
        end = round(time.time() * RATE_HZ)
        times = np.arange(first, end) / RATE_HZ
        if times.size:
            history.append(times, values(times))
        return end

    def feed(first: int) -> None:
        while True:
            time.sleep(_EVERY)
            first = until_now(first)

    threading.Thread(target=feed, args=(until_now(first),), daemon=True).start()
    return history


def add_view(history: LiveHistory, charts: int) -> None:
    """Let panels have a view of one chart, or of it and its loop."""

    def build(page: Page) -> None:
        from nicegui import ui

        from flexstage.web.live_chart import LiveChart

        loops = (None, ("x voltage", "x position"))
        for alt_text, loop in zip(
            ("Voltage and position", "Loop of x")[:charts], loops, strict=False
        ):
            with ui.element("section").classes("panel"):
                LiveChart(page, history, alt_text=alt_text, loop=loop)

    name = f"{views.__name__}.live"
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].build = build  # type: ignore[attr-defined]
    view = views.PanelView("Live", "show_chart", "live", "Live charts")
    shell.VIEWS = views.VIEWS = (*views.VIEWS, view)


@contextlib.contextmanager
def served_live(
    folder: Path, seconds: float = 60.0, charts: int = 2
) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Serve the panel in a process of its own; give the address that opens it, and the process."""
    words = ["--folder", str(folder), "--seconds", f"{seconds:g}", "--charts", f"{charts}"]
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, *words],
        cwd=Path(__file__).resolve().parents[1],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip(), process
    finally:
        process.terminate()
        process.wait(20.0)
        process.stdout.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--charts", type=int, default=2)
    options = parser.parse_args()
    add_view(fed(options.seconds), options.charts)
    server.serve(PanelOptions(folder=options.folder, address=("127.0.0.1", 0)), _say)


def _say(address: str) -> None:
    sys.stdout.write(f"{address}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
