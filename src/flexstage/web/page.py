"""What a view of the front panel is given: the panel, the person, long work, complaints."""

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
from flexstage.web.emergency_stop import Stops
from flexstage.web.jobs import BackgroundJob, Jobs
from flexstage.web.options import PanelOptions
from flexstage.web.preferences import Preferences
from flexstage.web.sessions import Access, Session, States

_LOOK_AT_JOBS = 0.25  # s
_OPTION = re.compile(r"`[^`]*`|(?<![\w-])--([a-z][a-z-]*[a-z])")
_MICRO = re.compile(r"\bu(?=(m|rad|V|A)\b)|(?<=\d )u(?=s\b)")


@dataclass(eq=False)
class Panel(States):
    """A front panel: what all of its pages share, such as a connected stage."""

    options: PanelOptions
    """How it is served."""
    access: Access
    """Who may come in."""
    jobs: Jobs = field(default_factory=Jobs)
    """Long work."""
    stops: Stops = field(default_factory=Stops)
    """What the button STOP stops."""

    def folder(self, name: str) -> Path:
        """Return a folder for the files of a view, made where it is not there."""
        folder = self.options.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


@dataclass(eq=False)
class Page:
    """A page of the panel in one browser."""

    panel: Panel
    """The panel."""
    session: Session
    """Who looks at it, with what stays open through a reload."""
    client: Client = field(default_factory=lambda: ui.context.client)
    """Its end in the library: whatever is shown ends with it."""
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.client.on_delete(self.leave)

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Do something beside the view that is open; it ends with it."""
        task = background_tasks.create(work, name=work.__qualname__, context=self.client)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def leave(self) -> None:
        """End what is done beside the view that is open: it is left, or the browser is gone."""
        for task in self._tasks:
            task.cancel()

    @property
    def preferences(self) -> Preferences:
        """Units and look."""
        return self.session.preferences

    @contextmanager
    def sentences(self, card: ui.element | None = None) -> Iterator[None]:
        """Show an error of the library as its sentence, and go on; else forget the one before."""
        card = card or _card()
        try:
            yield
        except (FlexstageError, OSError) as error:
            complain(self.words(str(error)), card)
        else:
            _forget(card)

    def words(self, sentence: str) -> str:
        """Return what the library says as the page says it, without where the panel's files lie."""
        folder = re.escape(f"{self.panel.options.folder}{os.sep}")
        return in_page_words(re.sub(rf"{folder}(?:[\w.-]+[/\\])*", "", sentence))

    def watch(
        self,
        job: BackgroundJob,
        over: Callable[[BackgroundJob], None],
    ) -> ui.timer:
        """Call a function in this page once when a job is over; it may be over already."""

        def look() -> None:
            if job.is_over:
                timer.cancel()
                over(job)

        timer = ui.timer(_LOOK_AT_JOBS, look)
        return timer


def pages_of(session: Session) -> list[Client]:
    """Return the pages that a browser has open now."""
    return [
        client
        for client in Client.instances.values()
        if client.has_socket_connection and client.request.scope.get(SESSION) is session
    ]


def in_page_words(sentence: str) -> str:
    """Return what the library says as the page says it.

    An option of a command is the field of that name; units and signs are typeset.

    Examples
    --------
    >>> in_page_words("give --sample-rate, such as 200 Hz: 4.5 um +- -0.1")
    'give “Sample rate”, such as 200 Hz: 4.5 µm ± −0.1'
    """

    def field(option: re.Match[str]) -> str:
        if option[1] is None:
            return option[0]  # a command as one types it
        return f"“{option[1].replace('-', ' ').capitalize()}”"

    said = _OPTION.sub(field, sentence)
    return typeset(_MICRO.sub("µ", said.replace("+-", "±")))


def complain(sentence: str, card: ui.element | None = None) -> None:
    """Show what is wrong inside the card that refused, until it accepts something.

    It is that of whoever is answered; where there is none the sentence stands above the page until
    it is read.
    """
    card = card or _card()
    if card is not None and not card.is_deleted:
        _forget(card)
        with card:
            said = ui.label(in_page_words(sentence)).classes("issue error refused")
        said.props("role=alert")
        card.client.run_javascript(
            f"getHtmlElement({said.id})?.scrollIntoView({{block: 'nearest'}})"
        )
        return
    ui.notify(
        in_page_words(sentence),
        type="negative",
        multi_line=True,
        close_button="OK",
        timeout=0,
        position="top",
    )


def _card() -> ui.element | None:
    """Return the card or dialog in which something is being answered."""
    with suppress(RuntimeError):  # where it has gone meanwhile
        inner = ui.context.slot.parent
        around = (inner, *inner.ancestors())
        return next((e for e in around if {"panel", "dialog"} & {*e.classes}), None)
    return None


def _forget(card: ui.element | None) -> None:
    """Take away what a card has refused."""
    for each in [] if card is None or card.is_deleted else [*card]:
        if "refused" in each.classes:
            each.delete()


class PanelHeading(TextElement):
    """A heading.

    Parameters
    ----------
    text
        What it says; shown as text, whoever wrote it.
    level
        1 to 6.
    """

    def __init__(self, text: str = "", level: int = 2) -> None:
        super().__init__(tag=f"h{level}", text=text)


def div(classes: str) -> ui.element:
    """Return a part of a page, by its classes in `static/panel.css`."""
    return ui.element("div").classes(classes)


def panel(classes: str = "") -> ui.element:
    """Return a part of a page with a ground of its own."""
    return ui.element("section").classes(f"panel {classes}")


def remark(text: str) -> ui.label:
    """Return a text that is set back: small and pale."""
    return ui.label(text).classes("muted small")


def choice(
    options: Any,
    value: Any,
    label: str,
    changed: Callable[..., object] | None = None,
    **more: Any,
) -> ui.select:
    """Return a field whose value is one of some, or several of them."""
    field = ui.select(options, value=value, label=label, on_change=changed, **more)
    return field.props("dense options-dense outlined")


def named_dialog(name: str) -> ui.dialog:
    """Return a dialog whose name is read aloud when it opens."""
    dialog = ui.dialog()
    dialog.props["aria-label"] = name
    return dialog


def quiet_button(text: str = "", **given: Any) -> ui.button:
    """Return a button without a ground of its own, readable on light and dark."""
    return ui.button(text, color="link", **given).props("flat")


def show_job(
    page: Page, job: BackgroundJob, over: Callable[[BackgroundJob], None] | None = None
) -> None:
    """Show how far a job has come, with a button that cancels it; tell when it is over.

    Who waits for it is told why it failed.
    """
    _forget(_card())
    with ui.row().classes("job items-center no-wrap") as row:
        ui.label(job.name)
        bar = ui.linear_progress(0.0, show_value=False)
        bar.props["aria-label"] = f"Progress: {job.name}"
        doing = ui.label().classes("muted")
        quiet_button("Cancel", on_click=job.cancel).props("dense")

    def look() -> None:
        if row.is_deleted:
            return  # between two looks at the same moment
        bar.value = job.share
        doing.text = f"{job.what or job.state}, {100.0 * job.share:.0f} %"

    timer = ui.timer(_LOOK_AT_JOBS, look)

    def ended(job: BackgroundJob) -> None:
        timer.cancel()
        row.delete()
        if over is not None:
            if job.state == "failed":
                complain(page.words(f"{job.name}: {job.error}"))
            over(job)

    page.watch(job, ended)


class Task:
    """Long work of one kind.

    Parameters
    ----------
    page
        The page.
    jobs
        Jobs of the session whose result nobody has taken, by what they are for.
    key
        What it is for.
    place
        Where its progress is shown.
    done
        Called with the result.
    failed
        Called with the sentence that says why there is none; it is shown where not given.
    elsewhere
        Called where another page of this browser has taken the result: that before a reload.
    """

    def __init__(
        self,
        page: Page,
        jobs: dict[str, BackgroundJob],
        key: str,
        place: ui.element,
        done: Callable[[Any], object],
        failed: Callable[[str], object] | None = None,
        elsewhere: Callable[[], object] | None = None,
    ) -> None:
        self._page, self._jobs, self._key, self._place = page, jobs, key, place
        self._done, self._failed, self._elsewhere = done, failed or _complain, elsewhere
        self.attach()

    @property
    def running(self) -> bool:
        """Whether it is being done."""
        job = self._jobs.get(self._key)
        return job is not None and not job.is_over

    def stop(self) -> None:
        """Let nobody wait for it any more."""
        if (before := self._jobs.pop(self._key, None)) is not None:
            before.cancel()

    def start(self, name: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Start it, in place of what is being done."""
        self.stop()
        owner = self._page.session.id
        self._jobs[self._key] = self._page.panel.jobs.start(name, function, *arguments, owner=owner)
        self.attach()

    def attach(self) -> None:
        """Show how far it is, and take its result."""
        job = self._jobs.get(self._key)
        if job is not None:
            with self._place:
                show_job(self._page, job)
                self._page.watch(job, self._over)

    def _over(self, job: BackgroundJob) -> None:
        if self._jobs.get(self._key) is not job:
            if self._elsewhere is not None and job.state == "done":
                self._elsewhere()
            return
        del self._jobs[self._key]
        if job.state == "done":
            self._done(job.result)
        elif job.state == "failed":
            self._failed(self._page.words(job.error))
        else:
            self._failed("")


def _complain(sentence: str) -> None:
    """Show why there is no result; who has cancelled it knows."""
    if sentence:
        complain(sentence)
