"""Services for the views of the front panel: session, page elements, jobs and error messages."""

import asyncio
import os
import re
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nicegui import Client, background_tasks, ui
from nicegui.elements.mixins.text_element import TextElement

from flexstage.base.errors import FlexstageError
from flexstage.report.page import typeset
from flexstage.web.access_control import SESSION
from flexstage.web.jobs import BackgroundJob, EmergencyStop, Jobs
from flexstage.web.options import PanelOptions
from flexstage.web.sessions import Access, Preferences, Session, States

_JOB_INTERVAL = 0.25  # between two looks at a job [s]
_OPTION = re.compile(r"`[^`]*`|(?<![\w-])--([a-z][a-z-]*[a-z])")
_MICRO = re.compile(r"\bu(?=(m|rad|V|A)\b)|(?<=\d )u(?=s\b)")


@dataclass(eq=False)
class Panel(States):
    """A front panel: the objects that all pages share, such as a connected stage."""

    options: PanelOptions
    """Options of the server."""
    access: Access
    """Tokens, password and sessions."""
    jobs: Jobs = field(default_factory=Jobs)
    """Background jobs."""
    emergency_stop: EmergencyStop = field(default_factory=EmergencyStop)
    """Target of the STOP button."""

    def folder(self, name: str) -> Path:
        """Return the folder for the files of a view; create it if necessary."""
        folder = self.options.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


@dataclass(eq=False)
class Page:
    """A page of the panel in one browser tab."""

    panel: Panel
    """The panel."""
    session: Session
    """The session of the browser; its state survives a reload."""
    client: Client = field(default_factory=lambda: ui.context.client)
    """The client of NiceGUI; the elements of the page are deleted with it."""
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.client.on_delete(self.leave)

    def begin(self, work: Callable[..., Coroutine[Any, Any, None]], *arguments: object) -> None:
        """Start a task of the open view; it is cancelled with the view."""
        task = background_tasks.create(
            work(*arguments), name=work.__qualname__, context=self.client
        )
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def leave(self) -> None:
        """Cancel the tasks of the view, because the user left it or closed the browser."""
        for task in self._tasks:
            task.cancel()

    @property
    def preferences(self) -> Preferences:
        """Units and theme."""
        return self.session.preferences

    @contextmanager
    def show_errors(self, card: ui.element | None = None) -> Iterator[None]:
        """Show an error of the library as a message, and continue; without one clear the last."""
        card = card or _card()
        try:
            yield
        except (FlexstageError, OSError) as error:
            show_error(self.message(str(error)), card)
        else:
            _clear_errors(card)

    def message(self, sentence: str) -> str:
        """Return a message of the library for the page, without the folder of the panel."""
        folder = re.escape(f"{self.panel.options.folder}{os.sep}")
        return display_text(re.sub(rf"{folder}(?:[\w.-]+[/\\])*", "", sentence))

    def watch(
        self,
        job: BackgroundJob,
        on_end: Callable[[BackgroundJob], None],
    ) -> ui.timer:
        """Call a function in this page once, when a job is over or if it is over already."""

        def update() -> None:
            if job.is_over:
                timer.cancel()
                on_end(job)

        timer = ui.timer(_JOB_INTERVAL, update)
        return timer


def pages_of(session: Session) -> list[Client]:
    """Return the pages that a browser has open."""
    return [
        client
        for client in Client.instances.values()
        if client.has_socket_connection and client.request.scope.get(SESSION) is session
    ]


def display_text(sentence: str) -> str:
    """Return a message of the library for the page.

    An option of a command becomes the name of its field; units and signs are typeset.

    Examples
    --------
    >>> display_text("give --sample-rate, such as 200 Hz: 4.5 um +- -0.1")
    'give “Sample rate”, such as 200 Hz: 4.5 µm ± −0.1'
    """

    def field(match: re.Match[str]) -> str:
        if match[1] is None:
            return match[0]  # a command line
        return f"“{match[1].replace('-', ' ').capitalize()}”"

    text = _OPTION.sub(field, sentence)
    return typeset(_MICRO.sub("µ", text.replace("+-", "±")))


def show_error(sentence: str, card: ui.element | None = None) -> None:
    """Show an error message in a card, until the card accepts an input.

    The default is the card of the event that is being handled. Without a card the message is a
    notification that the user closes.
    """
    card = card or _card()
    if card is not None and not card.is_deleted:
        _clear_errors(card)
        with card:
            label = ui.label(display_text(sentence)).classes("issue error refused")
        label.props("role=alert")
        card.client.run_javascript(
            f"getHtmlElement({label.id})?.scrollIntoView({{block: 'nearest'}})"
        )
        return
    ui.notify(
        display_text(sentence),
        type="negative",
        multi_line=True,
        close_button="OK",
        timeout=0,
        position="top",
    )


def _card() -> ui.element | None:
    """Return the card or dialog of the event that is being handled."""
    with suppress(RuntimeError):  # if it was deleted meanwhile
        inner = ui.context.slot.parent
        around = (inner, *inner.ancestors())
        return next((e for e in around if {"panel", "dialog"} & {*e.classes}), None)
    return None


def _clear_errors(card: ui.element | None) -> None:
    """Remove the error messages of a card."""
    for each in [] if card is None or card.is_deleted else [*card]:
        if "refused" in each.classes:
            each.delete()


class PanelHeading(TextElement):
    """A heading.

    Parameters
    ----------
    text
        The text; HTML in it is escaped.
    level
        1 to 6.
    """

    def __init__(self, text: str = "", level: int = 2) -> None:
        super().__init__(tag=f"h{level}", text=text)


def div(classes: str) -> ui.element:
    """Return a container with classes of `static/panel.css`."""
    return ui.element("div").classes(classes)


def panel(classes: str = "") -> ui.element:
    """Return a section with a frame and background."""
    return ui.element("section").classes(f"panel {classes}")


def remark(text: str) -> ui.label:
    """Return a small text in a muted colour."""
    return ui.label(text).classes("muted small")


def choice(
    options: Any,
    value: Any,
    label: str,
    on_change: Callable[..., object] | None = None,
    **properties: Any,
) -> ui.select:
    """Return a field with one or several of a list of options."""
    field = ui.select(options, value=value, label=label, on_change=on_change, **properties)
    return field.props("dense options-dense outlined")


def named_dialog(name: str) -> ui.dialog:
    """Return a dialog with an accessible name."""
    dialog = ui.dialog()
    dialog.props["aria-label"] = name
    return dialog


def quiet_button(text: str = "", **properties: Any) -> ui.button:
    """Return a flat button that is readable on light and dark pages."""
    return ui.button(text, color="link", **properties).props("flat")


def show_job(
    page: Page, job: BackgroundJob, on_end: Callable[[BackgroundJob], None] | None = None
) -> None:
    """Show the progress of a job and a button to cancel it; call `on_end` at its end.

    With `on_end`, the page shows the message of a failed job.
    """
    _clear_errors(_card())
    with ui.row().classes("job items-center no-wrap") as row:
        ui.label(job.name)
        bar = ui.linear_progress(0.0, show_value=False)
        bar.props["aria-label"] = f"Progress: {job.name}"
        status = ui.label().classes("muted")
        quiet_button("Cancel", on_click=job.cancel).props("dense")

    def update() -> None:
        if row.is_deleted:
            return  # deleted between two calls of the timer
        bar.value = job.share
        status.text = f"{job.activity or job.state}, {100.0 * job.share:.0f} %"

    timer = ui.timer(_JOB_INTERVAL, update)

    def finish(job: BackgroundJob) -> None:
        timer.cancel()
        row.delete()
        if on_end is not None:
            if job.state == "failed":
                show_error(page.message(f"{job.name}: {job.error}"))
            on_end(job)

    page.watch(job, finish)


class Task:
    """A background job for one purpose, whose result a page takes.

    Parameters
    ----------
    page
        The page.
    jobs
        Jobs of the session whose result no page has taken, by purpose.
    key
        The purpose.
    place
        Element for the progress.
    on_result
        Called with the result.
    on_failure
        Called with the message of a failure; by default the page shows it.
    elsewhere
        Called if another page of this browser has taken the result, such as the one before a
        reload.
    """

    def __init__(
        self,
        page: Page,
        jobs: dict[str, BackgroundJob],
        key: str,
        place: ui.element,
        on_result: Callable[[Any], object],
        on_failure: Callable[[str], object] | None = None,
        elsewhere: Callable[[], object] | None = None,
    ) -> None:
        self._page, self._jobs, self._key, self._place = page, jobs, key, place
        self._watched: BackgroundJob | None = None
        self._on_result, self._on_failure, self._elsewhere = (
            on_result,
            on_failure or _show_failure,
            elsewhere,
        )
        self.attach()

    @property
    def running(self) -> bool:
        """The job is not over."""
        job = self._jobs.get(self._key)
        return job is not None and not job.is_over

    def stop(self) -> None:
        """Cancel the job, and discard its result."""
        if (previous := self._jobs.pop(self._key, None)) is not None:
            previous.cancel()

    def start(
        self, name: str, function: Callable[..., Any], *arguments: Any, in_thread: bool = False
    ) -> None:
        """Start the job in place of a running one, in a process or in a thread of the panel."""
        self.stop()
        jobs = self._page.panel.jobs
        start = jobs.start_thread if in_thread else jobs.start
        self._jobs[self._key] = start(name, function, *arguments, owner=self._page.session.id)
        self.attach()

    def attach(self) -> None:
        """Show the progress of the job, and take its result; another page can have started it."""
        job = self._jobs.get(self._key)
        if job is not None and job is not self._watched:
            self._watched = job
            with self._place:
                show_job(self._page, job)
                self._page.watch(job, self._take_result)

    def _take_result(self, job: BackgroundJob) -> None:
        if self._jobs.get(self._key) is not job:
            if self._elsewhere is not None and job.state == "done":
                self._elsewhere()
            self.attach()
            return
        del self._jobs[self._key]
        if job.state == "done":
            self._on_result(job.result)
        elif job.state == "failed":
            self._on_failure(self._page.message(job.error))
        else:
            self._on_failure("")


def _show_failure(sentence: str) -> None:
    """Show the message of a failed job; a cancelled one has none."""
    if sentence:
        show_error(sentence)
