"""Who does work that can be shared: processes of this machine, or a cluster."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from flexstage.explore import Workers


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Who does the work.

    Parameters
    ----------
    workers
        --workers N: Number of processes that share long work (default: one for each core); 1 is
        this process alone. The numbers are the same whatever it is.
    scheduler
        --scheduler ADDRESS: Have a Dask cluster do the work, by the address of its scheduler, such
        as tls://HOST:8786.
    """

    panel: ClassVar[str] = "Workers"
    workers: int | None = None
    scheduler: str | None = None

    def open(self) -> "AbstractContextManager[Workers]":
        """Return the workers, for a `with` block."""
        from flexstage.explore import open_workers

        return open_workers(self.workers, self.scheduler)


#: None of them given.
USUAL_WORKERS = WorkerOptions()
