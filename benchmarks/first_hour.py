"""A new user's way in the front panel: how long until a stage of one's own, and a straight loop.

`python -m benchmarks.first_hour` serves the panel in an empty folder and does in Chromium
(`scripts/debian-packages.sh`) what a person would, without a pause to think: changes a design and
analyses it by finite elements; then records the loop of the twin's x axis, identifies it, makes the
command that undoes it, and runs that. It prints when each step is done, counted from the start of
the server, and how wide both loops are.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["first_hour"]

_PATIENCE = 120e3  # of one step [ms]


def _own_stage(page: Any, done: Callable[[str], None]) -> None:
    _design(page, "parallelogram")
    page.get_by_text("other dimensions").click()
    thickness = page.get_by_label("Value of thickness [mm]")
    thickness.fill("9")
    thickness.press("Enter")
    page.get_by_role("heading", name="parallelogram (changed)").wait_for()
    done("figures of the changed stage by the lumped model")
    page.get_by_role("link", name="Analyse").click()
    page.get_by_role("checkbox", name="finite elements of the whole", exact=True).click()
    page.get_by_role("button", name="Analyse", exact=True).click()
    page.locator(".model", has_text="finite elements of the whole").get_by_text(
        "done in"
    ).wait_for()
    done("the same by finite elements")


def _straight_loop(page: Any, done: Callable[[str], None], folder: Path) -> None:
    page.get_by_role("link", name="Design").click()
    _design(page, "vgtu-piezo")
    page.get_by_role("link", name="Bench").click()
    page.get_by_role("button", name="Connect").click()
    page.get_by_role("heading", name="Axis x").wait_for()
    _choose(page, "Shape", "triangle")
    page.get_by_label("Frequency [Hz]").fill("1")
    page.get_by_label("Cycles").fill("4")
    page.get_by_role("button", name="Run the waveform").click()
    loop = page.get_by_text("Loop over the command")
    loop.wait_for()
    record = _saved(page, "Download the record", folder / "loop.h5")
    done(f"recorded on the twin. {loop.inner_text()}")
    page.get_by_role("link", name="Hysteresis").click()
    page.locator("input[type=file]").first.set_input_files(record)
    page.get_by_text("loop.h5: ").wait_for()
    page.get_by_role("button", name="Identify").click()
    page.get_by_role("button", name="Download the model").wait_for()
    done("all models identified")
    page.get_by_role("tab", name="3 Compensate").click()
    page.get_by_role("button", name="Triangle").click()
    page.get_by_text("Predicted error").wait_for()
    command = _saved(page, "Download the waveform", folder / "command.csv")
    done("command made")
    page.get_by_role("link", name="Bench").click()
    _choose(page, "Shape", "from a file")
    page.locator("input[type=file]").first.set_input_files(command)
    page.get_by_label("Cycles").fill("1")
    page.get_by_text("within the limits").wait_for()
    page.get_by_role("button", name="Run the waveform").click()
    loop = page.get_by_text("Loop over the reference")
    loop.wait_for()
    done(f"run on the twin. {loop.inner_text()}")


def _design(page: Any, name: str) -> None:
    page.get_by_role("combobox", name="Design").fill(name)
    page.get_by_role("option", name=name, exact=True).click()
    page.get_by_role("heading", name=name, exact=True).wait_for()


def _choose(page: Any, label: str, option: str) -> None:
    page.get_by_role("combobox", name=label).click()
    page.get_by_role("option", name=option).click()


def _saved(page: Any, button: str, file: Path) -> Path:
    with page.expect_download() as waiting:
        page.get_by_role("button", name=button).click()
    waiting.value.save_as(file)
    return file


def first_hour() -> list[tuple[float, str]]:
    """Return when each step was done [s], and what it was."""
    from tests.panel import looked_at

    steps: list[tuple[float, str]] = []
    with tempfile.TemporaryDirectory() as name:
        began = time.monotonic()

        def done(step: str) -> None:
            steps.append((time.monotonic() - began, step))

        with looked_at(Path(name)) as look:
            look.page.set_default_timeout(_PATIENCE)
            done("panel open")
            _own_stage(look.page, done)
            _straight_loop(look.page, done, Path(name))
            if look.complaints:
                raise RuntimeError("the page complains: " + "; ".join(look.complaints))
    return steps


if __name__ == "__main__":
    for seconds, step in first_hour():
        print(f"{seconds:6.1f} s  {step}")
