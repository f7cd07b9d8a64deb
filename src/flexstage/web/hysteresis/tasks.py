"""Long work of one kind in a view: one at a time, found again after a reload."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from flexstage.web.jobs import BackgroundJob
from flexstage.web.page import Page, complain, show_job


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
