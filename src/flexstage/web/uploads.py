"""Uploads to the front panel: accepted types, a size limit, and safe file names."""

import re
import weakref
from collections.abc import Awaitable, Callable, Iterable
from html import escape
from pathlib import Path, PurePosixPath
from typing import Any

from nicegui import app, events, ui
from starlette.routing import Route

from flexstage.base.errors import ModelError
from flexstage.files.write import write_whole
from flexstage.web.page import Page, show_error

_MB = 2**20
# the header of NiceGUI is a link and an input, both without an accessible name
_HEADER = """
<q-btn flat no-caps no-wrap class="full-width" icon="upload_file" label="{label}"
    @click="props.pickFiles" />
<div style="display: none"><q-uploader-add-trigger /></div>
"""


def plain_name(raw_name: str) -> str:
    r"""Return a safe file name without a folder, in ASCII.

    Examples
    --------
    >>> plain_name("../../etc/My stage (2).yaml"), plain_name("C:\\x\\.dxf")
    ('My_stage_2_.yaml', 'dxf')
    """
    last = PurePosixPath(raw_name.replace("\\", "/")).name
    name = re.sub(r"[^\w.-]+", "_", last, flags=re.ASCII).strip("._-")
    return name[-100:] or "file"


def require_ending(name: str, endings: Iterable[str]) -> None:
    """Require that a file name has one of the accepted endings.

    Raises
    ------
    ModelError
        The name has another ending.
    """
    accepted = tuple(endings)
    if not name.casefold().endswith(accepted):
        raise ModelError(f"'{name[:80]}' is not of an accepted type: {', '.join(accepted)}")


def upload(
    page: Page,
    label: str,
    endings: Iterable[str],
    on_file: Callable[[Path], Awaitable[None] | None],
    *,
    view: str,
    max_size: int = 32 * _MB,
) -> Any:
    """Show an upload field; call `on_file` with the path of each saved file.

    Parameters
    ----------
    page
        The page.
    label
        Label of the field.
    endings
        Accepted endings of the name, such as ``.yaml``.
    on_file
        Called with the path; an error of the library is shown as a message.
    view
        View whose folder receives the files, in a subfolder for each browser.
    max_size
        Largest size [byte].
    """
    accepted = tuple(endings)

    async def handle(event: events.UploadEventArguments) -> None:
        field.reset()
        with page.show_errors():
            name = plain_name(event.file.name)
            require_ending(name, accepted)
            content = await event.file.read()
            if len(content) > max_size:
                raise ModelError(f"'{name}' is larger than {max_size / _MB:g} MB")
            path = page.panel.folder(f"{view}/{page.session.id}") / name
            write_whole(path, content)
            pending = on_file(path)
            if pending is not None:
                await pending

    def rejected() -> None:
        show_error(f"Accepted: {', '.join(accepted)}; up to {max_size / _MB:g} MB")

    field = (
        ui.upload(label=label, auto_upload=True, max_file_size=max_size, max_files=1)
        .props(f'accept="{",".join(accepted)}" flat bordered hide-upload-btn')
        .classes("upload")
        .on_upload(handle)
    )
    _weaken_route(field)
    field.add_slot("header", _HEADER.format(label=escape(label, quote=True)))
    field.on("rejected", rejected)
    return field


def _weaken_route(field: ui.upload) -> None:
    """Replace the reference that the route of an upload field has to it by a weak one.

    FastAPI caches the functions of up to 4096 routes. The function of this route references the
    field, so that without a weak reference all elements of the page would stay in memory.
    """
    address = field.props["url"]
    (route,) = (r for r in app.routes if isinstance(r, Route) and r.path == address)
    for cell in route.endpoint.__closure__ or ():
        if cell.cell_contents is field:
            cell.cell_contents = weakref.proxy(field)
