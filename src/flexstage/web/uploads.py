"""Files that are given to the front panel: of known kinds, of limited size, under a plain name."""

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
from flexstage.web.page import Page, complain

_MB = 2**20
# the library's own header is a link without a name around an input without one
_HEADER = """
<q-btn flat no-caps no-wrap class="full-width" icon="upload_file" label="{label}"
    @click="props.pickFiles" />
<div style="display: none"><q-uploader-add-trigger /></div>
"""


def plain_name(given: str) -> str:
    r"""Return a name for a given file that is a name alone, in letters that every system has.

    Examples
    --------
    >>> plain_name("../../etc/My stage (2).yaml"), plain_name("C:\\x\\.dxf")
    ('My_stage_2_.yaml', 'dxf')
    """
    last = PurePosixPath(given.replace("\\", "/")).name
    name = re.sub(r"[^\w.-]+", "_", last, flags=re.ASCII).strip("._-")
    return name[-100:] or "file"


def require_ending(name: str, endings: Iterable[str]) -> None:
    """Refuse a file of another kind.

    Raises
    ------
    ModelError
        Its name ends otherwise.
    """
    known = tuple(endings)
    if not name.casefold().endswith(known):
        raise ModelError(f"'{name[:80]}' is no file of these: {', '.join(known)}")


def upload(
    page: Page,
    label: str,
    endings: Iterable[str],
    taken: Callable[[Path], Awaitable[None] | None],
    *,
    view: str,
    most: int = 32 * _MB,
) -> Any:
    """Show a place to drop a file on, or to choose one; call `taken` with its path once it is kept.

    Parameters
    ----------
    page
        The page.
    label
        What is asked for.
    endings
        What its name may end with, as ``.yaml``.
    taken
        Called with the path; an error of the library is shown as its sentence.
    view
        The view that it belongs to: its files lie in a folder of that name, by browser.
    most
        Largest size [byte].
    """
    known = tuple(endings)

    async def handle(event: events.UploadEventArguments) -> None:
        place.reset()
        with page.sentences():
            name = plain_name(event.file.name)
            require_ending(name, known)
            content = await event.file.read()
            if len(content) > most:
                raise ModelError(f"'{name}' is larger than {most / _MB:g} MB")
            path = page.panel.folder(f"{view}/{page.session.id}") / name
            write_whole(path, content)
            done = taken(path)
            if done is not None:
                await done

    def rejected() -> None:
        complain(f"a file here ends with {', '.join(known)} and has {most / _MB:g} MB at most")

    place = (
        ui.upload(label=label, auto_upload=True, max_file_size=most, max_files=1)
        .props(f'accept="{",".join(known)}" flat bordered hide-upload-btn')
        .classes("upload")
        .on_upload(handle)
    )
    _let_go(place)
    place.add_slot("header", _HEADER.format(label=escape(label, quote=True)))
    place.on("rejected", rejected)
    return place


def _let_go(place: ui.upload) -> None:
    """Let the route of an element hold it weakly.

    FastAPI remembers the function of every route that there was (4096 of them), and this one holds
    the element: without this all that its page ever showed would stay for good.
    """
    address = place.props["url"]
    (route,) = (r for r in app.routes if isinstance(r, Route) and r.path == address)
    for cell in route.endpoint.__closure__ or ():
        if cell.cell_contents is place:
            cell.cell_contents = weakref.proxy(place)
