"""The dialogs of the view Design: saving a stage file, and exporting."""

from collections.abc import Sequence

from nicegui import ui

from flexstage.export.formats import FORMATS
from flexstage.files.names import file_name
from flexstage.files.write import write_whole
from flexstage.web.design.state import Variant
from flexstage.web.design.work import exported_into, stage_file
from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, PanelHeading, named_dialog, quiet_button, show_job

_USUAL = ("dxf", "csv")


def ask_file_name(page: Page, variant: Variant) -> None:
    """Ask for a name, and save the stage file of a variant under it: here and in the browser."""
    name = variant.template.stage().name
    if variant.values:
        name = f"{name}-changed"
    with named_dialog("Save a stage file") as dialog, ui.card().classes("dialog"):
        PanelHeading("Save a stage file")
        field = ui.input("Name of the stage", value=name).classes("full-width")

        def save() -> None:
            with page.sentences():
                stem = file_name((field.value or name).strip())
                content = stage_file(variant, stem).encode("utf-8")
                path = page.panel.folder("design") / f"{stem}.yaml"
                write_whole(path, content)
                ui.download.content(content, path.name)
                ui.notify(f"saved as {path}", type="positive")
                dialog.close()

        with ui.row():
            ui.button("Save", on_click=save)
            quiet_button("Cancel", on_click=dialog.close)
    dialog.open()


def ask_export(page: Page, variant: Variant) -> None:
    """Ask for formats, and export a variant in a process of its own."""
    with named_dialog("Export") as dialog, ui.card().classes("dialog"):
        PanelHeading("Export")
        boxes = {
            name: ui.checkbox(f"{name}: {known.about}", value=name in _USUAL).props("dense")
            for name, known in FORMATS.items()
        }
        working = ui.column().classes("full-width")

        def start() -> None:
            formats: Sequence[str] = [name for name, box in boxes.items() if box.value]
            if not formats:
                ui.notify("choose a format", type="warning")
                return
            go.disable()
            folder, owner = page.panel.folder("design"), page.session.id
            job = page.panel.jobs.start(
                "export", exported_into, folder, variant, formats, owner=owner
            )
            with working:
                show_job(page, job, over)

        def over(job: BackgroundJob) -> None:
            go.enable()
            if job.state == "done":
                path, remarks = job.result
                ui.download.content(path.read_bytes(), path.name)
                with working:
                    for remark in remarks:
                        ui.label(remark).classes("muted small")

        with ui.row():
            go = ui.button("Export", on_click=start)
            quiet_button("Close", on_click=dialog.close)
    dialog.open()
