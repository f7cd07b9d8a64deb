"""The files of a run, given to the browser, and the command line that writes the same."""

import asyncio
import io
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from nicegui import ui

from flexstage.files.request import Request, command_line
from flexstage.stage.designs import StageTemplate
from flexstage.web.explore.state import Run
from flexstage.web.page import div, quiet_button, remark


def show_downloads(run: Run, files: tuple[Path, ...]) -> None:
    """Show a button for each file of data, and one for all."""
    with ui.row().classes("items-center downloads"):
        for path in _given_first(files):
            quiet_button(path.name, icon="download", on_click=_download(path)).props("dense")
        name = f"{run.folder.name}.zip"
        button = quiet_button("all (ZIP)", icon="download", on_click=lambda: _all(files, name))
        button.props("dense")


def show_command(run: Run) -> None:
    """Show the command line that does the same, to be copied."""
    text = same_command(run.facts.template, run.request)
    with div("command"):
        remark("The same at the prompt")
        ui.label(text).classes("code").props("tabindex=0")

        def copy() -> None:
            ui.clipboard.write(text)
            ui.notify("copied", type="positive")

        quiet_button(icon="content_copy", on_click=copy).props("dense").props["aria-label"] = (
            "Copy the command line"
        )


def same_command(template: StageTemplate, request: Request) -> str:
    """Return the command line of a request about a stage with what was set of it."""
    settings = (word for n, text in template.settings for word in ("--set", f"{n}={text}"))
    return command_line(request, template.source, *settings)


def _given_first(files: Iterable[Path]) -> list[Path]:
    order = (".csv", ".json", ".yaml", ".parquet", ".html")
    data = [path for path in files if path.suffix in order]
    return sorted(data, key=lambda path: order.index(path.suffix))


def _download(path: Path) -> Callable[[], Any]:
    async def download() -> None:
        ui.download.content(await asyncio.to_thread(path.read_bytes), path.name)

    return download


async def _all(files: Iterable[Path], name: str) -> None:
    def packed() -> bytes:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in files:
                archive.write(path, path.name)
        return content.getvalue()

    ui.download.content(await asyncio.to_thread(packed), name)
